// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/point_readers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <concepts>
#include <cstring>

#include "hal/scan/plain_rows.h"
#include "hal/scan/ply_header.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"
#include "hal/scan/text_lines.h"

// Problem: five million vertices in one of several layouts, between elements nobody asked for. Idea: walk the
// elements in the order of the file; vertices of one length are records, whatever has lists item by item, text
// line by line; everything else is stepped over. Invariant: the walk ends exactly where the file ends, so a header that
// lies about any element is found out.
namespace slabd::hal {
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

/// One file on its way into `xyz`.
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
        return lines.refuse("\"%s\": the file goes on after its last element", shown(line).c_str());
    return lines.status();
  }

  /// What the points are, once all is read.
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

  /// Items with lists: each has its own length, which only its content tells.
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
    if (element.properties == 0) return success();  // nothing to write a line about
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

  /// x, y, z first, then single values.
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

/// Success: where the header tells the length of the data, the window ends behind them.
Status check_size(ScanWindow& window, const PlyLayout& layout) {
  const std::uint64_t file_bytes = window.file_bytes();
  if (file_bytes < layout.bytes_min)
    return error(Code::frame_incomplete, "%s: byte %llu: the file ends here, its header asks for %s%llu bytes",
                 window.name(), static_cast<unsigned long long>(file_bytes), layout.bytes_exact ? "" : "at least ",
                 static_cast<unsigned long long>(layout.bytes_min));
  return layout.bytes_exact ? end_data_at(window, layout.header_bytes, layout.bytes_min) : success();
}

/// The header, with its bytes consumed.
Result<PlyLayout> read_header(ScanWindow& window, LengthUnit unit) {
  static_cast<void>(window.have(limits::kScanHeaderBytesMax));  // a shorter file is all header
  if (window.broken()) return window.failure();
  const std::string_view head = window.view().substr(0, limits::kScanHeaderBytesMax);
  const std::size_t mark_bytes = byte_order_mark_bytes(head);
  Result<PlyLayout> layout = parse_ply_header(head.substr(mark_bytes), window.name(), unit);
  if (!layout) return layout;
  layout.value().header_bytes += mark_bytes;
  layout.value().bytes_min += mark_bytes;
  window.consume(layout.value().header_bytes);
  return layout;
}

}  // namespace

template <typename Real>
Result<ScanShape> read_ply(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team) {
  const Result<PlyLayout> header = read_header(window, unit);
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
  return ScanShape{
      layout.vertices,           settled.finite,        layout.width, layout.height, layout.bytes_exact, settled.zeros,
      layout.emulation.emulated, layout.emulation.block};
}

template Result<ScanShape> read_ply(ScanWindow&, LengthUnit, std::span<float>, Team&);
template Result<ScanShape> read_ply(ScanWindow&, LengthUnit, std::span<double>, Team&);

Result<PointRun> find_ply_records(ScanWindow& window, LengthUnit unit) {
  const Result<PlyLayout> header = read_header(window, unit);
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

bool is_complete_ply(ScanWindow& window, LengthUnit unit) {
  const Result<PlyLayout> layout = read_header(window, unit);
  return layout && layout.value().bytes_exact && layout.value().bytes_min <= window.file_bytes() &&
         is_tail(window, layout.value().bytes_min);
}

std::uint64_t bytes_told_by_ply(ScanWindow& window, LengthUnit unit) {
  const Result<PlyLayout> layout = read_header(window, unit);
  return layout && layout.value().bytes_exact ? layout.value().bytes_min : 0;
}

bool lacks_bytes_of_ply(ScanWindow& window, LengthUnit unit) {
  const Result<PlyLayout> layout = read_header(window, unit);
  return layout && layout.value().bytes_min > window.file_bytes();
}

}  // namespace slabd::hal
