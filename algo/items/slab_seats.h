// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "algo/algo.h"
#include "algo/items/slab_fit.h"
#include "base/thermal.h"

namespace slabd::algo {

/// One seat in the slab frame. mm, rad.
struct Seat {
  bool ok = false;
  bool jaw_ok = false;
  bool tilt_ok = false;
  bool counts = false;  ///< has weight in the frame and in its row's warp
  Vec3 p = Vec3::Zero();
  Vec3 n = Vec3::UnitZ();
  Vec3 nominal = Vec3::Zero();
  Vec3 jaw_outer = Vec3::Zero();
  double slope_rad = kNoValue;  ///< about the block's X
};

/// All seats, and each row's warp. Two rows: Y > 0, Y < 0.
struct Seats {
  std::array<Seat, limits::kStationsMax + 1> at;  ///< [station], 1-based; 0 unused
  std::array<RowParabola, 2> warp;
  /// Index of a station in its row's warp, [station]; -1 if not part of it.
  std::array<int, limits::kStationsMax + 1> place_in_row{};

  [[nodiscard]] const Seat& operator[](int station) const { return at[static_cast<std::size_t>(station)]; }
};

/// The block of a station; nullptr if it was never inspected.
[[nodiscard]] inline const BlockResult* block_of(std::span<const BlockResult> blocks, int station) {
  const auto index = static_cast<std::size_t>(station - 1);
  return index < blocks.size() && blocks[index].verdict != Verdict::none ? &blocks[index] : nullptr;
}

/// Items that gauges measure, after the other items of `out`: those that the recipe has. Copies the slab's readings to
/// `out`, with the state not_plausible for a gauge that is far from the nominal (limits::kGaugeOffShareMax). An item of
/// which a gauge has no usable value is not measured.
void measure_gauge_items(const Recipe& recipe, const SlabFacts& slab, const Thermal& thermal, SlabResult& out);

/// Computes verdicts, reasons and masks of the stations and of the slab from block items and the slab items in `out`.
void reach_verdicts(const Recipe& recipe, std::span<const BlockResult> blocks, const Seats& seats, SlabResult& out);

}  // namespace slabd::algo
