// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/point_readers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "hal/scan/lzf.h"
#include "hal/scan/pcd.h"
#include "hal/scan/plain_rows.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"
#include "hal/scan/text_lines.h"

// Problem: three body types follow one header. The compressed body is transposed (all x, then all y, then all z), and
// its size does not limit the decoded size. Idea: decode it as a stream and fill the caller's points one coordinate at
// a time. Binary numbers are read as little-endian; the format does not define it, but its writers use it.
namespace slabd::hal {

// Problem: as for PLY, but each field is described on four lines (FIELDS, SIZE, TYPE, COUNT) whose order is not fixed.
// Idea: every line is first read as a row of words or numbers; the rows are combined at DATA, the last line. Invariant:
// a layout is returned only if all four rows have one length, x, y and z are known and no length can have overflowed.

namespace {

struct Field {
  FixedString<8> name;  ///< only "x", "y" and "z" matter; longer names are cut
  std::uint64_t size = 0;
  char type = 0;
  std::uint64_t count = 1;
};

class HeaderParser : HeaderLines {
 public:
  HeaderParser(std::string_view head, const char* file, LengthUnit unit) : HeaderLines(head, file), unit_(unit) {}

  Result<PcdLayout> parse() {
    layout_.line_end = line_end_;
    for (std::string_view line; next_line(line);) {
      if (Status status = statement(line); !status) return status.error();
      if (data_seen_) return finish();
    }
    return error(Code::frame_incomplete,
                 "%s: not a PCD file, or a cut one: no DATA line in the first %zu bytes (at most %zu are a header)",
                 file_, head_.size(), limits::kScanHeaderBytesMax);
  }

 private:
  Status statement(std::string_view line) {
    std::string_view rest = line;
    const std::string_view keyword = take_word(rest);
    if (keyword.empty()) return success();
    if (keyword.starts_with('#')) return comment(trimmed(line).substr(1));
    if (keyword == "VERSION") return version(rest);
    if (keyword == "FIELDS") return fields(rest);
    if (keyword == "SIZE") return sizes(rest);
    if (keyword == "TYPE") return types(rest);
    if (keyword == "COUNT") return counts(rest);
    if (keyword == "WIDTH") return number(keyword, rest, width_seen_, width_);
    if (keyword == "HEIGHT") return number(keyword, rest, height_seen_, height_);
    if (keyword == "POINTS") return number(keyword, rest, points_seen_, points_);
    if (keyword == "VIEWPOINT") return viewpoint(rest);
    if (keyword == "DATA") return data(rest);
    return refuse("unknown statement", keyword,
                  "known: VERSION FIELDS SIZE TYPE COUNT WIDTH HEIGHT VIEWPOINT POINTS DATA");
  }

  Status comment(std::string_view text) {
    std::string_view found;
    layout_.emulation.take(text);
    if (!layout_.scanner.take(text, found)) return temperature_refused(file_, line_number_, found);
    if (comment_agrees(text, unit_, found)) return success();
    return unit_contradicted(file_, line_number_, found, unit_);
  }

  Status version(std::string_view rest) {
    const std::string_view word = take_word(rest);
    if (word == "0.7" || word == ".7" || word == "0.6" || word == ".6") return success();
    return refuse("unknown PCD version", word, "supported: 0.6, 0.7");
  }

  // ---- the four rows

  Status fields(std::string_view rest) {
    if (names_ != 0) return refuse("second FIELDS line");
    for (std::string_view word = take_word(rest); !word.empty(); word = take_word(rest)) {
      if (names_ == kPcdFieldsMax) return refuse("too many fields at", word, "allowed: 64");
      fields_[names_++].name = word.size() == 1 ? word : "other";
    }
    return names_ != 0 ? success() : refuse("FIELDS without a name");
  }

  Status sizes(std::string_view rest) {
    return row(rest, sizes_, [this](Field& field, std::string_view word) {
      const bool known =
          parse_count(word, field.size) && (field.size == 1 || field.size == 2 || field.size == 4 || field.size == 8);
      return known ? success() : refuse("SIZE", word, "allowed: 1, 2, 4, 8");
    });
  }

  Status types(std::string_view rest) {
    return row(rest, types_, [this](Field& field, std::string_view word) {
      field.type = word[0];
      const bool known = word == "F" || word == "I" || word == "U";
      return known ? success() : refuse("TYPE", word, "allowed: F, I, U");
    });
  }

  Status counts(std::string_view rest) {
    return row(rest, counts_, [this](Field& field, std::string_view word) {
      const bool known = parse_count(word, field.count) && field.count >= 1 && field.count <= kScanPointBytesMax;
      return known ? success() : refuse("COUNT", word, "allowed: 1..4096");
    });
  }

  /// Reads one word per field, in the order of the fields; their number is checked at the end.
  template <typename Use>
  Status row(std::string_view rest, std::size_t& words, Use use) {
    if (words != 0) return refuse("a second line of this kind");
    for (std::string_view word = take_word(rest); !word.empty(); word = take_word(rest)) {
      if (words == kPcdFieldsMax) return refuse("too many values at", word, "allowed: one per field, at most 64");
      if (Status status = use(fields_[words++], word); !status) return status;
    }
    return success();
  }

  // ---- other lines

  Status number(std::string_view keyword, std::string_view rest, bool& seen, std::uint64_t& value) {
    const std::string_view word = take_word(rest);
    if (seen) return refuse("second line", keyword);
    if (!parse_count(word, value) || !take_word(rest).empty()) return refuse("not a count:", word, "allowed: 0..2^40");
    seen = true;
    return success();
  }

  /// tx ty tz qw qx qy qz of the sensor at the exposure. Checked, so that no other content is accepted here.
  Status viewpoint(std::string_view rest) {
    for (int i = 0; i < 7; ++i) {
      const std::string_view word = take_word(rest);
      double value = 0.0;
      if (!parse_number(word, value) || !std::isfinite(value))
        return refuse("VIEWPOINT", word,
                      word.find(',') != std::string_view::npos ? "expected: seven numbers with decimal points"
                                                               : "expected: seven numbers tx ty tz qw qx qy qz");
    }
    return take_word(rest).empty() ? success() : refuse("VIEWPOINT of more than seven numbers");
  }

  Status data(std::string_view rest) {
    const std::string_view word = take_word(rest);
    if (word == "ascii")
      layout_.data = PcdData::ascii;
    else if (word == "binary")
      layout_.data = PcdData::binary;
    else if (word == "binary_compressed")
      layout_.data = PcdData::binary_compressed;
    else
      return refuse("unknown DATA", word, "supported: ascii, binary, binary_compressed");
    data_seen_ = true;
    return success();
  }

  // ---- combining the rows

  Result<PcdLayout> finish() {
    if (names_ == 0) return refuse("no FIELDS line before DATA");
    if (sizes_ != names_ || types_ != names_ || (counts_ != 0 && counts_ != names_))
      return error(Code::frame_incomplete, "%s: header: %zu FIELDS, but %zu SIZE, %zu TYPE, %zu COUNT", file_, names_,
                   sizes_, types_, counts_);
    if (!width_seen_ || !height_seen_) return refuse("no WIDTH or no HEIGHT line before DATA");
    if (Status status = find_places(); !status) return status.error();
    if (Status status = count_points(); !status) return status.error();
    layout_.header_bytes = position_;
    layout_.header_lines = line_number_;
    sum_lengths();
    return layout_;
  }

  Status find_places() {
    std::array<bool, 3> seen{};
    for (std::size_t i = 0; i < names_; ++i) {
      const Field& field = fields_[i];
      const std::size_t axis = std::string_view("xyz").find(field.name.view());
      if (axis != std::string_view::npos) {
        if (seen[axis]) return refuse("second field", field.name.view());
        if (field.type != 'F' || field.count != 1 || field.size < 4)
          return refuse("unsupported coordinate", field.name.view(), "supported: TYPE F, SIZE 4 or 8, COUNT 1");
        seen[axis] = true;
        layout_.xyz[axis] = {layout_.stride, layout_.values, field.size == 8};
      }
      layout_.stride += field.size * field.count;
      layout_.values += field.count;
      if (layout_.stride > kScanPointBytesMax) return refuse("a point of more than 4096 bytes");
    }
    return seen[0] && seen[1] && seen[2] ? success() : refuse("FIELDS lacks x, y or z");
  }

  Status count_points() {
    constexpr std::uint64_t kSideMax = std::uint64_t{1} << 31U;  // so that their product cannot wrap
    if (width_ > kSideMax || height_ > kSideMax) return refuse("WIDTH or HEIGHT beyond 2^31");
    layout_.points = width_ * height_;
    if (layout_.points > kScanCountMax) return refuse("WIDTH * HEIGHT beyond 2^40");
    if (points_seen_ && points_ != layout_.points)
      return error(Code::frame_incomplete, "%s: header: POINTS %llu is not WIDTH %llu * HEIGHT %llu", file_,
                   static_cast<unsigned long long>(points_), static_cast<unsigned long long>(width_),
                   static_cast<unsigned long long>(height_));
    if (layout_.points == 0) return error(Code::too_few_points, "%s: WIDTH * HEIGHT is 0: no points at all", file_);
    if (height_ > 1) {
      layout_.width = width_;
      layout_.height = height_;
    }
    return success();
  }

  void sum_lengths() {
    switch (layout_.data) {
      case PcdData::ascii:  // a value as text has a digit and a separator; the last one needs no separator
        layout_.bytes_min = position_ + layout_.points * layout_.values * 2 - 1;
        break;
      case PcdData::binary:
        layout_.bytes_min = position_ + layout_.points * layout_.stride;
        layout_.bytes_exact = true;
        break;
      case PcdData::binary_compressed: layout_.bytes_min = position_ + kPcdCompressedPrefixBytes; break;
    }
  }

  LengthUnit unit_;
  PcdLayout layout_;
  std::array<Field, kPcdFieldsMax> fields_;
  std::size_t names_ = 0, sizes_ = 0, types_ = 0, counts_ = 0;  ///< words in each of the four rows
  std::uint64_t width_ = 0, height_ = 0, points_ = 0;
  bool width_seen_ = false, height_seen_ = false, points_seen_ = false, data_seen_ = false;
};

}  // namespace

Result<PcdLayout> parse_pcd_header(std::string_view head, const char* file, LengthUnit unit) {
  return HeaderParser(head, file, unit).parse();
}

namespace {

static_assert(std::endian::native == std::endian::little, "PCD's numbers are taken as they are");

double load_coordinate(const char* from, bool is_double) {
  if (is_double) {
    double value = 0.0;
    std::memcpy(&value, from, sizeof value);
    return value;
  }
  float value = 0.0F;
  std::memcpy(&value, from, sizeof value);
  return static_cast<double>(value);
}

PointRecord record_of(const PcdLayout& layout) {
  PointRecord record;
  record.bytes = layout.stride;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    record.offset[axis] = layout.xyz[axis].offset;
    record.is_double[axis] = layout.xyz[axis].is_double;
  }
  return record;
}

/// Reads one file into `xyz`.
template <typename Real>
class PcdBody {
 public:
  PcdBody(ScanWindow& window, const PcdLayout& layout, LengthUnit unit, std::span<Real> xyz, Team& team)
      : window_(window), layout_(layout), mm_(mm_per(unit)), xyz_(xyz.first(3 * layout.points)), team_(team) {}

  /// Counts of the points, valid after all of them are read.
  [[nodiscard]] const Settled& settled() const { return settled_; }

  Status read() {
    switch (layout_.data) {
      case PcdData::ascii: return read_ascii();
      case PcdData::binary: return read_binary();
      case PcdData::binary_compressed: return read_compressed();
    }
    return success();
  }

 private:
  Status read_ascii() {
    TextLines lines(window_, layout_.header_lines, layout_.line_end);
    Real* out = xyz_.data();
    std::uint64_t points = 0;
    for (std::string_view line;;) {
      if (has_plain_rows()) {
        const PlainRows plain =
            read_plain_rows(lines.ahead(), PlainRowForm{Separator::blanks, false, layout_.values - 3}, mm_, out,
                            layout_.points - points);
        lines.took(plain.bytes, plain.rows);
        out += 3 * plain.rows;
        points += plain.rows;
      }
      if (!lines.next(line)) break;
      if (trimmed(line).empty()) continue;
      if (points == layout_.points)
        return lines.refuse("\"%s\": more points than the %llu of the header", shown(line).c_str(),
                            static_cast<unsigned long long>(layout_.points));
      if (Status status = read_row(lines, line, out); !status) return status;
      ++points;
      out += 3;
    }
    if (!lines.status()) return lines.status();
    if (points == layout_.points) return settle();
    return lines.refuse("the file ends here, after %llu of %llu points", static_cast<unsigned long long>(points),
                        static_cast<unsigned long long>(layout_.points));
  }

  [[nodiscard]] bool has_plain_rows() const {
    return layout_.xyz[0].column == 0 && layout_.xyz[1].column == 1 && layout_.xyz[2].column == 2;
  }

  Status read_row(const TextLines& lines, std::string_view line, Real* out) const {
    std::string_view rest = line;
    for (std::size_t column = 0; column < layout_.values; ++column) {
      const std::string_view word = take_word(rest);
      if (word.empty() && column == 1 && hint_of_comma(line) != nullptr)
        return lines.refuse("\"%s\": values are separated by blanks in a PCD file", shown(line).c_str());
      if (word.empty())
        return lines.refuse("%zu values, the header declares %zu for each point", column, layout_.values);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (layout_.xyz[axis].column != column) continue;
        if (!parse_coordinate(word, mm_, out[axis])) return lines.not_a_number(line, word, hint_of_comma(word));
      }
    }
    if (const std::string_view more = take_word(rest); !more.empty())
      return lines.refuse("\"%s\": more values than the %zu that the header declares", shown(more).c_str(),
                          layout_.values);
    return success();
  }

  Status read_binary() {
    return read_point_records(window_, record_of(layout_), mm_, xyz_, settled_, team_) ? success()
                                                                                       : Status(window_.failure());
  }

  Status read_compressed() {
    const std::uint64_t decoded_bytes = layout_.points * layout_.stride;
    if (Status status = check_lengths(decoded_bytes); !status) return status;
    LzfReader decoded(window_, decoded_bytes);
    std::array<std::size_t, 3> axes = {0, 1, 2};  // in the order of their planes
    std::sort(axes.begin(), axes.end(),
              [this](std::size_t a, std::size_t b) { return layout_.xyz[a].offset < layout_.xyz[b].offset; });
    std::uint64_t position = 0;
    for (const std::size_t axis : axes) {
      const std::uint64_t plane = layout_.xyz[axis].offset * layout_.points;
      if (Status status = decoded.skip(plane - position); !status) return status;
      if (Status status = read_plane(decoded, axis); !status) return status;
      position = plane + layout_.points * value_bytes(axis);
    }
    if (Status status = decoded.skip(decoded_bytes - position); !status) return status;
    if (Status status = decoded.finish(); !status) return status;
    return settle();
  }

  Status settle() {
    settled_ = settle_points(xyz_.data(), layout_.points);
    return success();
  }

  [[nodiscard]] std::size_t value_bytes(std::size_t axis) const { return layout_.xyz[axis].is_double ? 8 : 4; }

  Status read_plane(LzfReader& decoded, std::size_t axis) {
    constexpr std::size_t kPieceValues = 1'024;
    std::array<char, kPieceValues * sizeof(double)> piece;
    const std::size_t bytes = value_bytes(axis);
    Real* out = xyz_.data() + axis;
    for (std::uint64_t left = layout_.points; left > 0;) {
      const std::size_t values = std::min<std::uint64_t>(left, kPieceValues);
      if (Status status = decoded.read(piece.data(), values * bytes); !status) return status;
      for (std::size_t i = 0; i < values; ++i, out += 3)
        *out = coordinate_mm<Real>(load_coordinate(&piece[i * bytes], layout_.xyz[axis].is_double), mm_);
      left -= values;
    }
    return success();
  }

  /// Both lengths in front of the compressed data must match the file and the header.
  Status check_lengths(std::uint64_t decoded_bytes) {
    std::array<std::uint32_t, 2> lengths{};
    static_assert(sizeof lengths == kPcdCompressedPrefixBytes);
    const auto at = static_cast<unsigned long long>(window_.offset());
    if (!window_.read(lengths.data(), sizeof lengths)) return window_.failure();
    if (lengths[0] > window_.left())
      return error(Code::frame_incomplete, "%s: byte %llu: %u bytes of compressed data, the file has %llu",
                   window_.name(), at, lengths[0], static_cast<unsigned long long>(window_.left()));
    if (Status status = end_data_at(window_, layout_.header_bytes, window_.offset() + lengths[0]); !status)
      return status;
    if (lengths[1] != decoded_bytes)
      return error(Code::frame_incomplete, "%s: byte %llu: data of %u bytes, the header's points need %llu",
                   window_.name(), at + 4, lengths[1], static_cast<unsigned long long>(decoded_bytes));
    return success();
  }

  ScanWindow& window_;
  const PcdLayout& layout_;
  double mm_;
  std::span<Real> xyz_;
  Team& team_;
  Settled settled_;
};

}  // namespace

template <typename Real>
Result<ScanShape> read_pcd(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team) {
  const Result<PcdLayout> header = read_header(window, unit, parse_pcd_header);
  if (!header) return header.error();
  const PcdLayout& layout = header.value();
  if (Status status = check_size(window, layout); !status) return status.error();
  if (layout.points > xyz.size() / 3)
    return error(Code::frame_incomplete, "%s: %llu points, allowed are at most %zu", window.name(),
                 static_cast<unsigned long long>(layout.points), xyz.size() / 3);
  PcdBody<Real> body(window, layout, unit, xyz, team);
  if (Status status = body.read(); !status) return status.error();
  const Settled& settled = body.settled();
  return ScanShape{layout.points,
                   settled.finite,
                   layout.width,
                   layout.height,
                   layout.data == PcdData::binary,
                   settled.zeros,
                   layout.emulation.emulated,
                   layout.emulation.block,
                   layout.scanner.temperature_c};
}

template Result<ScanShape> read_pcd(ScanWindow&, LengthUnit, std::span<float>, Team&);
template Result<ScanShape> read_pcd(ScanWindow&, LengthUnit, std::span<double>, Team&);

Result<PointRun> find_pcd_records(ScanWindow& window, LengthUnit unit) {
  const Result<PcdLayout> header = read_header(window, unit, parse_pcd_header);
  if (!header) return header.error();
  const PcdLayout& layout = header.value();
  if (Status status = check_size(window, layout); !status) return status.error();
  if (layout.data != PcdData::binary) return not_in_records(window.name());
  return PointRun{record_of(layout), {layout.points, 0, layout.width, layout.height, true}};
}

StatedBytes bytes_stated_by_pcd(ScanWindow& window, LengthUnit unit) {
  const Result<PcdLayout> header = read_header(window, unit, parse_pcd_header);
  if (!header) return {};
  const PcdLayout& layout = header.value();
  if (layout.data == PcdData::binary) return {layout.bytes_min, layout.bytes_min};
  std::uint32_t compressed_bytes = 0;
  if (layout.data != PcdData::binary_compressed || !window.read(&compressed_bytes, sizeof compressed_bytes))
    return {layout.bytes_min, 0};
  return {layout.bytes_min, layout.bytes_min + compressed_bytes};
}

}  // namespace slabd::hal
