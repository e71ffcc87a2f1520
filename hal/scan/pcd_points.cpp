// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/point_readers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "hal/scan/lzf.h"
#include "hal/scan/pcd_header.h"
#include "hal/scan/plain_rows.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"
#include "hal/scan/text_lines.h"

// Problem: three bodies under one header; the compressed one is turned round (all x, then all y, then all z) and its
// size is no measure of what it decodes to. Idea: decode it as a stream and fill the caller's points one coordinate at
// a time. Binary numbers are little-endian: the format does not say, its writers are.
namespace slabd::hal {
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

/// One file on its way into `xyz`.
template <typename Real>
class PcdBody {
 public:
  PcdBody(ScanWindow& window, const PcdLayout& layout, LengthUnit unit, std::span<Real> xyz, Team& team)
      : window_(window), layout_(layout), mm_(mm_per(unit)), xyz_(xyz.first(3 * layout.points)), team_(team) {}

  /// What the points are, once all is read.
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

  /// Both lengths in front of the compressed data must be what file and header say.
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

/// The header, with its bytes consumed.
Result<PcdLayout> read_header(ScanWindow& window, LengthUnit unit) {
  static_cast<void>(window.have(limits::kScanHeaderBytesMax));  // a shorter file is all header
  if (window.broken()) return window.failure();
  const std::string_view head = window.view().substr(0, limits::kScanHeaderBytesMax);
  const std::size_t mark_bytes = byte_order_mark_bytes(head);
  Result<PcdLayout> layout = parse_pcd_header(head.substr(mark_bytes), window.name(), unit);
  if (!layout) return layout;
  layout.value().header_bytes += mark_bytes;
  layout.value().bytes_min += mark_bytes;
  window.consume(layout.value().header_bytes);
  return layout;
}

/// Success: where the header tells the length of the data, the window ends behind them.
Status check_size(ScanWindow& window, const PcdLayout& layout) {
  const std::uint64_t file_bytes = window.file_bytes();
  if (file_bytes < layout.bytes_min)
    return error(Code::frame_incomplete, "%s: byte %llu: the file ends here, its header asks for %s%llu bytes",
                 window.name(), static_cast<unsigned long long>(file_bytes), layout.bytes_exact ? "" : "at least ",
                 static_cast<unsigned long long>(layout.bytes_min));
  return layout.bytes_exact ? end_data_at(window, layout.header_bytes, layout.bytes_min) : success();
}

}  // namespace

template <typename Real>
Result<ScanShape> read_pcd(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team) {
  const Result<PcdLayout> header = read_header(window, unit);
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
                   layout.emulation.block};
}

template Result<ScanShape> read_pcd(ScanWindow&, LengthUnit, std::span<float>, Team&);
template Result<ScanShape> read_pcd(ScanWindow&, LengthUnit, std::span<double>, Team&);

Result<PointRun> find_pcd_records(ScanWindow& window, LengthUnit unit) {
  const Result<PcdLayout> header = read_header(window, unit);
  if (!header) return header.error();
  const PcdLayout& layout = header.value();
  if (Status status = check_size(window, layout); !status) return status.error();
  if (layout.data != PcdData::binary) return not_in_records(window.name());
  return PointRun{record_of(layout), {layout.points, 0, layout.width, layout.height, true}};
}

namespace {

/// Of a binary file as its header says them, 0 where nothing says them yet.
std::uint64_t bytes_told(ScanWindow& window, const PcdLayout& layout) {
  if (layout.data == PcdData::binary) return layout.bytes_min;
  std::uint32_t compressed_bytes = 0;
  if (layout.data != PcdData::binary_compressed || !window.read(&compressed_bytes, sizeof compressed_bytes)) return 0;
  return layout.bytes_min + compressed_bytes;
}

}  // namespace

bool is_complete_pcd(ScanWindow& window, LengthUnit unit) {
  const std::uint64_t told = bytes_told_by_pcd(window, unit);
  return told != 0 && told <= window.file_bytes() && is_tail(window, told);
}

std::uint64_t bytes_told_by_pcd(ScanWindow& window, LengthUnit unit) {
  const Result<PcdLayout> header = read_header(window, unit);
  return header ? bytes_told(window, header.value()) : 0;
}

bool lacks_bytes_of_pcd(ScanWindow& window, LengthUnit unit) {
  const Result<PcdLayout> header = read_header(window, unit);
  if (!header) return false;
  const std::uint64_t bytes = window.file_bytes();
  return header.value().bytes_min > bytes || bytes_told(window, header.value()) > bytes;
}

}  // namespace slabd::hal
