// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "base/base.h"

namespace slabd::algo {

/// The two strips along the rail that the casings must lie in, as point counts in 1 mm cells: columns along the rail
/// around x = 0, rows along the seat around s = -half_spacing (first half of `cells`) and +half_spacing.
struct CasingStrips {
  /// Half width of a strip: bore, ring and a few millimetres.
  static constexpr int kHalfRows = 30;
  static constexpr int kShiftMax_mm = 100;
  static constexpr int kHalfColumns = kShiftMax_mm + kHalfRows;
  static constexpr std::size_t kRows = 2 * kHalfRows;
  static constexpr std::size_t kColumns = 2 * kHalfColumns;
  static constexpr std::size_t kCells = kRows * kColumns;
  /// Points this far from the bearing plane belong to a strip: rims are sunk by less than a millimetre.
  static constexpr double kHeight_mm = 3.0;

  /// Rows: along the rail, along the seat, above the bearing plane; from the scanner frame, R p + t.
  Mat3 R_seat_scanner = Mat3::Identity();
  Vec3 t_seat_scanner = Vec3::Zero();
  double half_spacing_mm = 0.0;
};

/// Counts the cloud's points in `cells` (2 * kCells, cleared here) and writes the indices of those counted; returns how
/// many. Points that are not finite are in no strip. Places to 1e-3 mm. One pass over the cloud, half a nanosecond a
/// point, and three for each counted. `index`: as long as the cloud.
[[nodiscard]] std::size_t count_strips(const Cloud& cloud, const CasingStrips& strips, std::span<std::uint32_t> index,
                                       std::span<std::uint32_t> cells);

}  // namespace slabd::algo
