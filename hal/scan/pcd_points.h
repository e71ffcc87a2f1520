// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "hal/hal.h"
#include "hal/scan/point_records.h"
#include "hal/scan/scan_window.h"

namespace slabd::hal {

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

}  // namespace slabd::hal
