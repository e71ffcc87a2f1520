// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/ply_header.h"

#include <algorithm>

#include "hal/scan/text_lines.h"

// Problem: the header decides how five million vertices are read, and it comes from outside. Idea: one pass over
// lines, each line one small function that either extends the layout or refuses with its number. Invariants: a layout
// is returned only when x, y, z are known; every length was summed without overflow.
namespace slabd::hal {
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

/// What can count the values of a list.
bool is_integer(std::string_view type) {
  return bytes_of(type) != 0 && !is_float(type) && !is_double(type);
}
bool is_signed(std::string_view type) {
  return is_integer(type) && !type.starts_with('u');
}

class HeaderParser {
 public:
  HeaderParser(std::string_view head, const char* file, LengthUnit unit) : head_(head), file_(file), unit_(unit) {}

  Result<PlyLayout> parse() {
    if (!head_.starts_with("ply\n") && !head_.starts_with("ply\r"))
      return error(Code::frame_incomplete, "%s: byte 0: not a PLY file (expected the line \"ply\")", file_);
    layout_.line_end = first_line_end(head_);
    for (std::string_view line; next_line(line);) {
      if (line_number_ == 1) continue;
      if (line == "end_header") return finish();
      if (Status status = statement(line); !status) return status.error();
    }
    return error(Code::frame_incomplete, "%s: no end_header line in the first %zu bytes (at most %zu are a header)",
                 file_, head_.size(), limits::kScanHeaderBytesMax);
  }

 private:
  bool next_line(std::string_view& line) {
    if (!next_header_line(head_, layout_.line_end, position_, line)) return false;
    ++line_number_;
    return true;
  }

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

  /// `comment organized width W height H` and units mean something; every other comment is for people.
  Status comment(std::string_view rest) {
    std::string_view words = rest;
    if (take_word(words) == "organized" && is_shape(words)) return organised(words);
    layout_.emulation.take(rest);
    return unit_declared_in(rest);
  }

  /// "organized point cloud by Foo" is for people too.
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
    if (!format_seen_) return refuse("no format line before end_header").error();
    if (!vertex_seen_) return refuse("no element vertex").error();
    if (!axis_seen_[0] || !axis_seen_[1] || !axis_seen_[2])
      return refuse("element vertex lacks property x, y or z").error();
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
      // A value as text has at least one digit and something behind it.
      body += element.count * (ascii ? 2 * element.properties : element.bytes);
      any_list = any_list || (element.has_list && element.count > 0);
    }
    if (ascii && body > 0) --body;  // nothing needs to stand behind the last one
    layout_.bytes_min = position_ + body;
    layout_.bytes_exact = !ascii && !any_list;
  }

  /// "file: header line n: what "subject" (hint)".
  Status refuse(const char* what, std::string_view subject = {}, const char* hint = nullptr) const {
    FixedString<70> quoted;
    if (!subject.empty()) quoted.printf(" \"%s\"", shown(subject).c_str());
    const bool hinted = hint != nullptr;
    return error(Code::frame_incomplete, "%s: header line %zu: %s%s%s%s%s", file_, line_number_, what, quoted.c_str(),
                 hinted ? " (" : "", hinted ? hint : "", hinted ? ")" : "");
  }

  static constexpr const char* kKnownTypes = "known: char uchar short ushort int uint float double, int8..float64";

  std::string_view head_;
  const char* file_;
  LengthUnit unit_;
  std::size_t position_ = 0;
  std::size_t line_number_ = 0;

  PlyLayout layout_;
  bool format_seen_ = false;
  bool vertex_seen_ = false;
  std::array<bool, 3> axis_seen_{};
};

}  // namespace

Result<PlyLayout> parse_ply_header(std::string_view head, const char* file, LengthUnit unit) {
  return HeaderParser(head, file, unit).parse();
}

}  // namespace slabd::hal
