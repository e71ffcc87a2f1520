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

// Points in records of one length, as in binary PLY and PCD.

struct PointRecord {
  std::size_t bytes = 0;
  std::array<std::size_t, 3> offset = {};  ///< of x, y, z
  std::array<bool, 3> is_double = {};
  bool big_endian = false;
};

/// A file's points as one sequence of records.
struct PointRun {
  PointRecord record;
  ScanShape shape;  ///< the number of finite points is not known yet
};
[[nodiscard]] Error not_in_records(const char* name);

/// Reads xyz.size() / 3 records into `xyz` (mm), settles them (hal/scan/scan_points.h) and adds the counts to
/// `settled`. False if reading failed; `window.failure()` returns the reason. Records of three floats in mm cost little
/// more than a copy; all others about 2 ns a point. Two threads of a team read in parallel, with the same result. No
/// heap.
template <typename Real>  // float or double
[[nodiscard]] bool read_point_records(ScanWindow& window, const PointRecord& record, double mm_per_unit,
                                      std::span<Real> xyz, Settled& settled, Team& team);

// ---- files with a header -----------------------------------------------------------------------------------------

/// A file's length as stated in its own header.
struct StatedBytes {
  std::uint64_t least = 0;  ///< minimum of header and data; 0: it has no such header
  std::uint64_t exact = 0;  ///< of header and data; 0: not stated by the header (ascii, lists)
};

/// Parses and consumes the header at the start of `window`. `parse` as parse_ply_header.
template <typename Layout>
[[nodiscard]] Result<Layout> read_header(ScanWindow& window, LengthUnit unit,
                                         Result<Layout> (*parse)(std::string_view, const char*, LengthUnit)) {
  static_cast<void>(window.have(limits::kScanHeaderBytesMax));  // a shorter file is read completely
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

/// Success: if the header states the length of the data, the window ends there.
template <typename Layout>
[[nodiscard]] Status check_size(ScanWindow& window, const Layout& layout) {
  const std::uint64_t file_bytes = window.file_bytes();
  if (file_bytes < layout.bytes_min)
    return error(Code::frame_incomplete, "%s: byte %llu: the file ends here, its header requires %s%llu bytes",
                 window.name(), static_cast<unsigned long long>(file_bytes), layout.bytes_exact ? "" : "at least ",
                 static_cast<unsigned long long>(layout.bytes_min));
  return layout.bytes_exact ? end_data_at(window, layout.header_bytes, layout.bytes_min) : success();
}

/// Reads the PLY file in `window` (of which nothing is consumed yet) as specified for `read_scan`: ascii or binary,
/// lists skipped, exactly as long as its header states, lists included. Both threads of `team` read points that are
/// records. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_ply(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team);

/// Moves to the first point of a file whose points are records. frame_incomplete if they are not, or as `read_ply`.
[[nodiscard]] Result<PointRun> find_ply_records(ScanWindow& window, LengthUnit unit);

[[nodiscard]] StatedBytes bytes_stated_by_ply(ScanWindow& window, LengthUnit unit);

/// Reads the PCD file in `window` (of which nothing is consumed yet) as specified for `read_scan`: ascii, binary and
/// binary_compressed (decoded through a fixed window, whatever the decoded size). Both threads of `team` read binary
/// points. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_pcd(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team);

/// Moves to the first point of a file whose points are records. frame_incomplete if they are not, or as `read_pcd`.
[[nodiscard]] Result<PointRun> find_pcd_records(ScanWindow& window, LengthUnit unit);

[[nodiscard]] StatedBytes bytes_stated_by_pcd(ScanWindow& window, LengthUnit unit);

/// Reads points as lines of numbers (XYZ, ASC, TXT, CSV) from `window`, of which nothing is consumed yet, as specified
/// for `read_scan`. Separators: blanks, tab, comma or semicolon, one kind per file. `#` and `//` begin a comment; empty
/// lines are ignored. The number of points may be given alone in a line before them; it must match. One line of column
/// names may precede the points, or be in a comment above them (as many names as columns). x, y and z must be among
/// them unless `columns` chooses others; further columns are ignored. nan, inf or an empty field is a missing point.
/// Rejected, because x, y and z are not known or missing: other names, more than kTableColumnsMax columns without
/// names, first columns that are not coordinates (FirstRows, hal/scan/text_columns.h), a decimal comma. A first line of
/// whole numbers above lines with decimals is a header: skipped if its meaning is known, else rejected. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_text_points(ScanWindow& window, const ScanForm& form, std::span<Real> xyz);

}  // namespace slabd::hal
