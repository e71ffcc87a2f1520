// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "base/jobs.h"
#include "base/team.h"
#include "hal/hal.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"

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

/// Reads the PLY file in `window` (nothing of it consumed yet) as `read_scan` promises: ascii or binary, lists stepped
/// over, exactly as long as its header says, lists included. Points that are records are read by both threads of
/// `team`. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_ply(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team);

/// Goes to the first point of a file whose points are records. frame_incomplete: it is none, or as `read_ply`.
[[nodiscard]] Result<PointRun> find_ply_records(ScanWindow& window, LengthUnit unit);

/// Whether the file in `window` has a binary header that accounts for exactly its bytes: it is complete, nobody is
/// still writing it. False also for everything that cannot tell (ascii, lists, not a PLY).
[[nodiscard]] bool is_complete_ply(ScanWindow& window, LengthUnit unit);
/// Header and data as the header tells their length; 0: it does not, or it is none.
[[nodiscard]] std::uint64_t bytes_told_by_ply(ScanWindow& window, LengthUnit unit);
/// The file has fewer bytes than its header says that there are at least.
[[nodiscard]] bool lacks_bytes_of_ply(ScanWindow& window, LengthUnit unit);

/// Reads the PCD file in `window` (nothing of it consumed yet) as `read_scan` promises: ascii, binary and
/// binary_compressed (decoded through a fixed window, whatever the data grow to); binary points are read by both
/// threads of `team`. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_pcd(ScanWindow& window, LengthUnit unit, std::span<Real> xyz, Team& team);

/// Goes to the first point of a file whose points are records. frame_incomplete: it is none, or as `read_pcd`.
[[nodiscard]] Result<PointRun> find_pcd_records(ScanWindow& window, LengthUnit unit);

/// Whether the file in `window` has a binary header that accounts for exactly its bytes: it is complete, nobody is
/// still writing it. False also for everything that cannot tell (ascii, not a PCD).
[[nodiscard]] bool is_complete_pcd(ScanWindow& window, LengthUnit unit);
/// Header and data as header and prefix tell their length; 0: they do not, or it is none.
[[nodiscard]] std::uint64_t bytes_told_by_pcd(ScanWindow& window, LengthUnit unit);
/// The file has fewer bytes than its header says that there are at least.
[[nodiscard]] bool lacks_bytes_of_pcd(ScanWindow& window, LengthUnit unit);

/// Reads points as lines of numbers (XYZ, ASC, TXT, CSV) from `window`, of which nothing is consumed yet, as
/// `read_scan` promises. Separators: blanks, tab, comma or semicolon, one kind per file. `#` and `//` begin a comment,
/// empty lines count for nothing. The number of points may stand alone in a line before them; then there are as many.
/// One line of column names may stand before the points, or in a comment above them (as many names as columns); x, y
/// and z must be among them unless `columns` chooses others; further columns are ignored. nan, inf or nothing between
/// two separators: a missing point. Refused, because x, y and z are not known or not there: other names, more than
/// kTableColumnsMax columns without names, a first column that counts the rows, a decimal comma. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_text_points(ScanWindow& window, LengthUnit unit, std::span<Real> xyz,
                                                 const TableColumns& columns = {});

}  // namespace slabd::hal
