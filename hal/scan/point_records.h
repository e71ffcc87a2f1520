// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "base/jobs.h"
#include "base/team.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"

/// Points in records of one length, as binary PLY and PCD have them.
namespace slabd::hal {

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

}  // namespace slabd::hal
