// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/jobs.h"
#include "base/team.h"
#include "hal/hal.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"
#include "hal/scan/text_lines.h"

namespace slabd::hal {

// Points in records of one length, as binary PLY and PCD have them.

struct PointRecord {
  std::size_t bytes = 0;
  std::array<std::size_t, 3> offset = {};  ///< of x, y, z
  std::array<bool, 3> is_double = {};
  bool big_endian = false;
};

/// A file's points as one run of records.
struct PointRun {
  PointRecord record;
  ScanShape shape;  ///< how many are finite is not known yet
};
[[nodiscard]] Error not_in_records(const char* name);

/// Reads xyz.size() / 3 records into `xyz` (mm), settles them (hal/scan/scan_points.h) and adds to `settled` what was
/// found. False: the window could not, `window.failure()` says why. What the bytes of the file may become as they are,
/// three floats in mm, costs little more than copying them; everything else about 2 ns a point. Two threads of a team
/// read at once, with the same result. No heap.
template <typename Real>  // float or double
[[nodiscard]] bool read_point_records(ScanWindow& window, const PointRecord& record, double mm_per_unit,
                                      std::span<Real> xyz, Settled& settled, Team& team);

// ---- files with a header -----------------------------------------------------------------------------------------

/// A file's length as its own header states it.
struct StatedBytes {
  std::uint64_t least = 0;  ///< header and data have at least so many; 0: it has no such header
  std::uint64_t exact = 0;  ///< header and data; 0: the header does not tell (ascii, lists)
};

/// The header at the beginning of `window`, with its bytes consumed. `parse` as parse_ply_header.
template <typename Layout>
[[nodiscard]] Result<Layout> read_header(ScanWindow& window, LengthUnit unit,
                                         Result<Layout> (*parse)(std::string_view, const char*, LengthUnit)) {
  static_cast<void>(window.have(limits::kScanHeaderBytesMax));  // a shorter file is all header
  if (window.broken()) return window.failure();
  const std::string_view head = window.view().substr(0, limits::kScanHeaderBytesMax);
  const std::size_t mark_bytes = byte_order_mark_bytes(head);
  Result<Layout> layout = parse(head.substr(mark_bytes), window.name(), unit);
  if (!layout) return layout;
  layout.value().header_bytes += mark_bytes;
  layout.value().bytes_min += mark_bytes;
  window.consume(layout.value().header_bytes);
  return layout;
}

/// Success: where the header tells the length of the data, the window ends behind them.
template <typename Layout>
[[nodiscard]] Status check_size(ScanWindow& window, const Layout& layout) {
  const std::uint64_t file_bytes = window.file_bytes();
  if (file_bytes < layout.bytes_min)
    return error(Code::frame_incomplete, "%s: byte %llu: the file ends here, its header asks for %s%llu bytes",
                 window.name(), static_cast<unsigned long long>(file_bytes), layout.bytes_exact ? "" : "at least ",
                 static_cast<unsigned long long>(layout.bytes_min));
  return layout.bytes_exact ? end_data_at(window, layout.header_bytes, layout.bytes_min) : success();
}

/// Reads the PLY file in `window` (nothing of it consumed yet) as `read_scan` promises: ascii or binary, lists stepped
/// over, exactly as long as its header says, lists included. Points that are records are read by both threads of
/// `team`. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_ply(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team);

/// Goes to the first point of a file whose points are records. frame_incomplete: it is none, or as `read_ply`.
[[nodiscard]] Result<PointRun> find_ply_records(ScanWindow& window, LengthUnit unit);

[[nodiscard]] StatedBytes bytes_stated_by_ply(ScanWindow& window, LengthUnit unit);

/// Reads the PCD file in `window` (nothing of it consumed yet) as `read_scan` promises: ascii, binary and
/// binary_compressed (decoded through a fixed window, whatever the data grow to); binary points are read by both
/// threads of `team`. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_pcd(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team);

/// Goes to the first point of a file whose points are records. frame_incomplete: it is none, or as `read_pcd`.
[[nodiscard]] Result<PointRun> find_pcd_records(ScanWindow& window, LengthUnit unit);

[[nodiscard]] StatedBytes bytes_stated_by_pcd(ScanWindow& window, LengthUnit unit);

/// Reads points as lines of numbers (XYZ, ASC, TXT, CSV) from `window`, of which nothing is consumed yet, as
/// `read_scan` promises. Separators: blanks, tab, comma or semicolon, one kind per file. `#` and `//` begin a comment,
/// empty lines count for nothing. The number of points may stand alone in a line before them; then there are as many.
/// One line of column names may stand before the points, or in a comment above them (as many names as columns); x, y
/// and z must be among them unless `columns` chooses others; further columns are ignored. nan, inf or nothing between
/// two separators: a missing point. Refused, because x, y and z are not known or not there: other names, more than
/// kTableColumnsMax columns without names, a first column that counts the rows, a decimal comma. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_text_points(ScanWindow& window, const ScanForm& form, std::span<Real> xyz);

}  // namespace slabd::hal
