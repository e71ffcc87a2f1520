// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/point_readers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <concepts>
#include <cstring>

#include "hal/scan/plain_rows.h"
#include "hal/scan/ply.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"
#include "hal/scan/text_lines.h"

// Problem: five million vertices in one of several layouts, between elements that are not needed. Idea: read the
// elements in the order of the file: vertices of one length as records, elements with lists item by item, text line by
// line. Other elements are skipped. Invariant: reading ends exactly at the end of the file, so a wrong count of any
// element is detected.
namespace slabd::hal {

// Problem: the header, which is untrusted, decides how five million vertices are read. Idea: one pass over its lines;
// one small function for each line either extends the layout or rejects it with the line's number. Invariants: a layout
// is returned only if x, y, z are known; every length was summed without overflow.

namespace {

/// Bytes of a PLY scalar type, 0 for an unknown name.
std::size_t bytes_of(std::string_view type) {
  if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
  if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
  if (type == "int" || type == "uint" || type == "float" || type == "int32" || type == "uint32" || type == "float32")
    return 4;
  if (type == "double" || type == "float64" || type == "int64" || type == "uint64") return 8;
  return 0;
}

bool is_float(std::string_view type) {
  return type == "float" || type == "float32";
}
bool is_double(std::string_view type) {
  return type == "double" || type == "float64";
}

/// True for types that can hold the length of a list.
bool is_integer(std::string_view type) {
  return bytes_of(type) != 0 && !is_float(type) && !is_double(type);
}
bool is_signed(std::string_view type) {
  return is_integer(type) && !type.starts_with('u');
}

class HeaderParser : HeaderLines {
 public:
  HeaderParser(std::string_view head, const char* file, LengthUnit unit) : HeaderLines(head, file), unit_(unit) {}

  Result<PlyLayout> parse() {
    if (!head_.starts_with("ply") || head_.find_first_not_of(" \t", 3) != head_.find_first_of("\r\n"))
      return error(Code::frame_incomplete, "%s: byte 0: not a PLY file (expected the line \"ply\")", file_);
    layout_.line_end = line_end_;
    for (std::string_view line; next_line(line);) {
      if (line_number_ == 1) continue;
      if (trimmed(line) == "end_header") return finish();
      if (Status status = statement(line); !status) return status.error();
    }
    return error(Code::frame_incomplete, "%s: no end_header line in the first %zu bytes (at most %zu are a header)",
                 file_, head_.size(), limits::kScanHeaderBytesMax);
  }

 private:
  Status statement(std::string_view line) {
    std::string_view rest = line;
    const std::string_view keyword = take_word(rest);
    if (keyword == "comment") return comment(rest);
    if (keyword == "obj_info") return unit_declared_in(rest);
    if (keyword == "format") return format(rest);
    if (keyword == "element") return element(rest);
    if (keyword == "property") return property(rest);
    return refuse("unknown statement", keyword, "known: format, comment, obj_info, element, property, end_header");
  }

  Status format(std::string_view rest) {
    const std::string_view name = take_word(rest);
    const std::string_view version = take_word(rest);
    if (format_seen_) return refuse("second format line", name);
    if (name == "ascii")
      layout_.encoding = PlyEncoding::ascii;
    else if (name == "binary_little_endian")
      layout_.encoding = PlyEncoding::little_endian;
    else if (name == "binary_big_endian")
      layout_.encoding = PlyEncoding::big_endian;
    else
      return refuse("unknown format", name, "supported: ascii, binary_little_endian, binary_big_endian");
    if (version != "1.0") return refuse("unknown PLY version", version, "supported: 1.0");
    format_seen_ = true;
    return success();
  }

  /// Evaluates `comment organized width W height H`, units, and declarations of the scanner; all other comments are
  /// ignored.
  Status comment(std::string_view rest) {
    std::string_view words = rest;
    if (take_word(words) == "organized" && is_shape(words)) return organised(words);
    layout_.emulation.take(rest);
    if (std::string_view found; !layout_.scanner.take(rest, found))
      return temperature_refused(file_, line_number_, found);
    return unit_declared_in(rest);
  }

  /// False for free text such as "organized point cloud by Foo".
  static bool is_shape(std::string_view rest) {
    const std::string_view word = take_word(rest);
    return word == "width" || word == "height" || word.find_first_of("0123456789") == 0;
  }

  Status organised(std::string_view rest) {
    const std::string_view text = trimmed(rest);
    const bool width_named = take_word(rest) == "width";
    std::uint64_t width = 0;
    const bool width_known = parse_count(take_word(rest), width);
    const bool height_named = take_word(rest) == "height";
    std::uint64_t height = 0;
    const bool height_known = parse_count(take_word(rest), height);
    // Both sides stay below 2^31 so that their product cannot wrap.
    constexpr std::uint64_t kSideMax = std::uint64_t{1} << 31U;
    if (!width_named || !height_named || !width_known || !height_known || width == 0 || height == 0 ||
        width > kSideMax || height > kSideMax || !take_word(rest).empty())
      return refuse("malformed comment organized", text, "expected: comment organized width W height H, both 1..2^31");
    if (layout_.width != 0) return refuse("second comment organized", text);
    layout_.width = width;
    layout_.height = height;
    return success();
  }

  Status unit_declared_in(std::string_view text) const {
    std::string_view found;
    if (comment_agrees(text, unit_, found)) return success();
    return unit_contradicted(file_, line_number_, found, unit_);
  }

  Status element(std::string_view rest) {
    const std::string_view name = take_word(rest);
    const std::string_view number = take_word(rest);
    PlyElement element;
    if (name.empty() || !parse_count(number, element.count)) return refuse("element count", number, "allowed: 0..2^40");
    element.is_vertex = name == "vertex";
    element.first_property = layout_.properties.size();
    if (element.is_vertex && vertex_seen_) return refuse("second element", name);
    vertex_seen_ = vertex_seen_ || element.is_vertex;
    if (!layout_.elements.push(element)) return refuse("too many elements at", name, "allowed: 32");
    return success();
  }

  Status property(std::string_view rest) {
    const std::string_view type = take_word(rest);
    if (layout_.elements.empty()) return refuse("property before any element:", type);
    return type == "list" ? list_property(rest) : scalar_property(type, take_word(rest));
  }

  Status scalar_property(std::string_view type, std::string_view name) {
    PlyProperty property;
    property.bytes = static_cast<std::uint8_t>(bytes_of(type));
    property.is_double = is_double(type);
    if (property.bytes == 0 || name.empty()) return refuse("unknown property type", type, kKnownTypes);
    if (layout_.elements.back().is_vertex) {
      if (Status status = find_axis(type, name, property); !status) return status;
    }
    return append(property, property.bytes, name);
  }

  Status find_axis(std::string_view type, std::string_view name, PlyProperty& property) {
    constexpr std::string_view kAxes = "xyz";
    const std::size_t axis = name.size() == 1 ? kAxes.find(name[0]) : std::string_view::npos;
    if (axis == std::string_view::npos) return success();
    if (!is_float(type) && !is_double(type)) return refuse("coordinate of type", type, "supported: float, double");
    if (axis_seen_[axis]) return refuse("second property", name);
    axis_seen_[axis] = true;
    property.axis = static_cast<std::int8_t>(axis);
    return success();
  }

  Status list_property(std::string_view rest) {
    const std::string_view count_type = take_word(rest);
    const std::string_view value_type = take_word(rest);
    const std::string_view name = take_word(rest);
    PlyProperty property;
    if (!is_integer(count_type)) return refuse("list counted by type", count_type, "supported: char .. uint");
    property.count_bytes = static_cast<std::uint8_t>(bytes_of(count_type));
    property.count_signed = is_signed(count_type);
    property.bytes = static_cast<std::uint8_t>(bytes_of(value_type));
    if (property.bytes == 0 || name.empty()) return refuse("unknown property type", value_type, kKnownTypes);
    if (layout_.elements.back().is_vertex && (name == "x" || name == "y" || name == "z"))
      return refuse("a list as coordinate", name, "supported: float, double");
    layout_.elements.back().has_list = true;
    return append(property, property.count_bytes, name);  // an empty list still stores its count
  }

  Status append(const PlyProperty& property, std::size_t bytes_min, std::string_view name) {
    PlyElement& element = layout_.elements.back();
    if (!layout_.properties.push(property)) return refuse("too many properties at", name, "allowed: 256");
    ++element.properties;
    element.bytes += bytes_min;
    if (element.bytes > kScanPointBytesMax) return refuse("element too long at property", name, "at most 4096 bytes");
    return success();
  }

  Result<PlyLayout> finish() {
    if (!format_seen_) return refuse("no format line before end_header");
    if (!vertex_seen_) return refuse("no element vertex");
    if (!axis_seen_[0] || !axis_seen_[1] || !axis_seen_[2]) return refuse("element vertex lacks property x, y or z");
    layout_.header_bytes = position_;
    layout_.header_lines = line_number_;
    sum_lengths();
    if (layout_.vertices == 0) return error(Code::too_few_points, "%s: element vertex 0: no points at all", file_);
    if (layout_.width != 0 && layout_.width * layout_.height != layout_.vertices)
      return error(Code::frame_incomplete, "%s: organized width %llu height %llu is not the vertex count %llu", file_,
                   static_cast<unsigned long long>(layout_.width), static_cast<unsigned long long>(layout_.height),
                   static_cast<unsigned long long>(layout_.vertices));
    return layout_;
  }

  /// Cannot overflow: 32 elements of at most 2^40 items of at most 2^12 bytes.
  void sum_lengths() {
    static_assert(kPlyElementsMax * kScanPointBytesMax <= std::uint64_t{1} << 23U);
    const bool ascii = layout_.encoding == PlyEncoding::ascii;
    std::uint64_t body = 0;
    bool any_list = false;
    for (const PlyElement& element : layout_.elements) {
      if (element.is_vertex) layout_.vertices = element.count;
      // A value as text has at least one digit and a separator.
      body += element.count * (ascii ? 2 * element.properties : element.bytes);
      any_list = any_list || (element.has_list && element.count > 0);
    }
    if (ascii && body > 0) --body;  // the last value needs no separator
    layout_.bytes_min = position_ + body;
    layout_.bytes_exact = !ascii && !any_list;
  }

  static constexpr const char* kKnownTypes = "known: char uchar short ushort int uint float double, int8..float64";

  LengthUnit unit_;
  PlyLayout layout_;
  bool format_seen_ = false;
  bool vertex_seen_ = false;
  std::array<bool, 3> axis_seen_{};
};

}  // namespace

Result<PlyLayout> parse_ply_header(std::string_view head, const char* file, LengthUnit unit) {
  return HeaderParser(head, file, unit).parse();
}

namespace {

static_assert(std::endian::native == std::endian::little, "the direct read takes the file's bytes as floats");

std::uint64_t load_integer(const char* from, std::size_t bytes, bool big_endian) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < bytes; ++i) {
    const std::size_t place = big_endian ? bytes - 1 - i : i;
    value |= std::uint64_t{static_cast<unsigned char>(from[i])} << (8 * place);
  }
  return value;
}

double load_coordinate(const char* from, bool is_double, bool big_endian) {
  if (is_double) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, from, sizeof bits);
    return std::bit_cast<double>(big_endian ? __builtin_bswap64(bits) : bits);
  }
  std::uint32_t bits = 0;
  std::memcpy(&bits, from, sizeof bits);
  return static_cast<double>(std::bit_cast<float>(big_endian ? __builtin_bswap32(bits) : bits));
}

PointRecord record_of(const PlyLayout& layout, const PlyElement& vertex) {
  PointRecord record;
  record.bytes = vertex.bytes;
  record.big_endian = layout.encoding == PlyEncoding::big_endian;
  std::size_t offset = 0;
  for (const PlyProperty& property : layout.of(vertex)) {
    if (property.axis >= 0) {
      const auto axis = static_cast<std::size_t>(static_cast<unsigned char>(property.axis));
      record.offset[axis] = offset;
      record.is_double[axis] = property.is_double;
    }
    offset += property.bytes;
  }
  return record;
}

/// Reads one file into `xyz`.
template <typename Real>
class PlyBody {
 public:
  PlyBody(ScanWindow& window, const PlyLayout& layout, LengthUnit unit, std::span<Real> xyz, Team& team)
      : window_(window), layout_(layout), mm_(mm_per(unit)), xyz_(xyz.first(3 * layout.vertices)), team_(team) {}

  Status read_binary() {
    for (const PlyElement& element : layout_.elements) {
      if (Status status = read_element(element); !status) return status;
    }
    return end_data_at(window_, layout_.header_bytes, window_.offset());
  }

  Status read_ascii() {
    TextLines lines(window_, layout_.header_lines, layout_.line_end);
    for (const PlyElement& element : layout_.elements) {
      if (Status status = read_lines(lines, element); !status) return status;
    }
    for (std::string_view line; lines.next(line);)
      if (!trimmed(line).empty())
        return lines.refuse("\"%s\": the file continues after its last element", shown(line).c_str());
    return lines.status();
  }

  /// Counts of the points, valid after all of them are read.
  [[nodiscard]] const Settled& settled() const { return settled_; }

 private:
  [[nodiscard]] bool big_endian() const { return layout_.encoding == PlyEncoding::big_endian; }

  // ---- binary

  Status read_element(const PlyElement& element) {
    if (element.has_list) return read_items(element);
    if (!element.is_vertex) {
      if (element.count * element.bytes > window_.left()) return window_.failure();
      window_.skip(element.count * element.bytes);
      return success();
    }
    return read_point_records(window_, record_of(layout_, element), mm_, xyz_, settled_, team_)
               ? success()
               : Status(window_.failure());
  }

  /// Items with lists: the length of each is known only from its content.
  Status read_items(const PlyElement& element) {
    Real* out = xyz_.data();
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (const PlyProperty& property : layout_.of(element)) {
        Status status = property.count_bytes != 0 ? step_over_list(property, i) : read_scalar(property, out);
        if (!status) return status;
      }
      if (element.is_vertex) out += 3;
    }
    if (element.is_vertex) settled_ += settle_points(xyz_.data(), element.count);
    return success();
  }

  Status read_scalar(const PlyProperty& property, Real* out) {
    if (!window_.have(property.bytes)) return window_.failure();
    if (property.axis >= 0)
      out[property.axis] =
          coordinate_mm<Real>(load_coordinate(window_.view().data(), property.is_double, big_endian()), mm_);
    window_.consume(property.bytes);
    return success();
  }

  Status step_over_list(const PlyProperty& property, std::uint64_t item) {
    if (!window_.have(property.count_bytes)) return window_.failure();
    const std::uint64_t count = load_integer(window_.view().data(), property.count_bytes, big_endian());
    const std::uint64_t sign = property.count_signed ? std::uint64_t{1} << (8U * property.count_bytes - 1U) : 0;
    window_.consume(property.count_bytes);
    if ((count & sign) != 0 || count > window_.left() / property.bytes)
      return error(Code::frame_incomplete, "%s: byte %llu: item %llu has a list of %s%llu values, %llu bytes are left",
                   window_.name(), static_cast<unsigned long long>(window_.offset() - property.count_bytes),
                   static_cast<unsigned long long>(item), (count & sign) != 0 ? "a negative number, " : "",
                   static_cast<unsigned long long>(count), static_cast<unsigned long long>(window_.left()));
    window_.skip(count * property.bytes);
    return success();
  }

  // ---- ascii

  Status read_lines(TextLines& lines, const PlyElement& element) {
    if (element.properties == 0) return success();  // such elements have no lines
    if (!element.is_vertex) return step_over_lines(lines, element.count);
    Real* out = xyz_.data();
    for (std::uint64_t i = 0; i < element.count; ++i, out += 3) {
      if (has_plain_rows(element)) {
        const PlainRows plain = read_plain_rows(
            lines.ahead(), PlainRowForm{Separator::blanks, false, element.properties - 3}, mm_, out, element.count - i);
        lines.took(plain.bytes, plain.rows);
        out += 3 * plain.rows;
        i += plain.rows;
        if (i == element.count) break;
      }
      std::string_view line;
      do {
        if (!lines.next(line)) return ended_early(lines, i, element.count);
      } while (trimmed(line).empty());
      if (Status status = read_row(lines, line, element, out); !status) return status;
    }
    settled_ += settle_points(xyz_.data(), element.count);
    return success();
  }

  /// True if x, y, z come first, followed by single values.
  [[nodiscard]] bool has_plain_rows(const PlyElement& vertex) const {
    const auto p = layout_.of(vertex);
    return !vertex.has_list && p[0].axis == 0 && p[1].axis == 1 && p[2].axis == 2;
  }

  static Status step_over_lines(TextLines& lines, std::uint64_t count) {
    for (std::uint64_t i = 0; i < count; ++i)
      if (!lines.skip()) return ended_early(lines, i, count);
    return success();
  }

  static Status ended_early(const TextLines& lines, std::uint64_t have, std::uint64_t count) {
    if (!lines.status()) return lines.status();
    return lines.refuse("the file ends here, after %llu of %llu items", static_cast<unsigned long long>(have),
                        static_cast<unsigned long long>(count));
  }

  Status read_row(const TextLines& lines, std::string_view line, const PlyElement& vertex, Real* out) {
    std::string_view rest = line;
    for (const PlyProperty& property : layout_.of(vertex)) {
      const std::string_view word = take_word(rest);
      if (word.empty()) return too_few_values(lines);
      if (property.axis >= 0) {
        if (!parse_coordinate(word, mm_, out[property.axis]))
          return lines.not_a_number(line, word, hint_of_comma(word));
      } else if (property.count_bytes != 0) {
        std::uint64_t count = 0;
        if (!parse_count(word, count)) return lines.not_a_number(line, word, "the length of a list");
        for (; count > 0; --count)
          if (take_word(rest).empty()) return too_few_values(lines);
      }
    }
    if (const std::string_view more = take_word(rest); !more.empty())
      return lines.refuse("\"%s\": more values than the header declares", shown(more).c_str());
    return success();
  }

  static Status too_few_values(const TextLines& lines) { return lines.refuse("fewer values than the header declares"); }

  ScanWindow& window_;
  const PlyLayout& layout_;
  double mm_;
  std::span<Real> xyz_;
  Team& team_;
  Settled settled_;
};

}  // namespace

template <typename Real>
Result<ScanShape> read_ply(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team) {
  const Result<PlyLayout> header = read_header(window, unit, parse_ply_header);
  if (!header) return header.error();
  const PlyLayout& layout = header.value();
  if (Status status = check_size(window, layout); !status) return status.error();
  if (layout.vertices > xyz.size() / 3)
    return error(Code::frame_incomplete, "%s: %llu points, allowed are at most %zu", window.name(),
                 static_cast<unsigned long long>(layout.vertices), xyz.size() / 3);

  PlyBody<Real> body(window, layout, unit, xyz, team);
  const Status status = layout.encoding == PlyEncoding::ascii ? body.read_ascii() : body.read_binary();
  if (!status) return status.error();
  const Settled& settled = body.settled();
  return ScanShape{layout.vertices,
                   settled.finite,
                   layout.width,
                   layout.height,
                   layout.bytes_exact,
                   settled.zeros,
                   layout.emulation.emulated,
                   layout.emulation.block,
                   layout.scanner.temperature_c};
}

template Result<ScanShape> read_ply(ScanWindow&, LengthUnit, std::span<float>, Team&);
template Result<ScanShape> read_ply(ScanWindow&, LengthUnit, std::span<double>, Team&);

Result<PointRun> find_ply_records(ScanWindow& window, LengthUnit unit) {
  const Result<PlyLayout> header = read_header(window, unit, parse_ply_header);
  if (!header) return header.error();
  const PlyLayout& layout = header.value();
  if (Status status = check_size(window, layout); !status) return status.error();
  if (!layout.bytes_exact) return not_in_records(window.name());
  PointRun run;
  run.shape = {layout.vertices, 0, layout.width, layout.height, true};
  for (const PlyElement& element : layout.elements) {
    if (element.is_vertex) {
      run.record = record_of(layout, element);
      break;
    }
    window.skip(element.count * element.bytes);
  }
  return run;
}

StatedBytes bytes_stated_by_ply(ScanWindow& window, LengthUnit unit) {
  const Result<PlyLayout> layout = read_header(window, unit, parse_ply_header);
  if (!layout) return {};
  return {layout.value().bytes_min, layout.value().bytes_exact ? layout.value().bytes_min : 0};
}

}  // namespace slabd::hal
