// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/denoise/lattice.h"
#include "base/team.h"

namespace slabd::algo {

/// Memory for `order_points`: arrays that begin on a cache line, or it takes longer.
struct OrderMemory {
  std::array<std::span<float>, 3> points;  ///< for a little more than half of the cloud in all
  std::span<std::uint32_t> words;          ///< kOrderWords
};
inline constexpr std::size_t kOrderWords = limits::kDenoiseCellsMax;

/// Do consecutive points lie near each other, as a scanner exports them? Told from a thousand places in the cloud.
[[nodiscard]] bool is_in_order(const Cloud& cloud, const Lattice& lattice);

/// What `order_points` saw.
struct Ordered {
  std::size_t finite = 0;
  std::size_t met = 0;      ///< points that share their cell with a lower one
  std::size_t outside = 0;  ///< of the lattice
};

/// Makes the cloud an organised scan: columns * rows cells of the lattice, each with the lowest of its points or NaN.
/// What is left over follows in order of height: the other points of a cell, and those that have none; then width and
/// height are 0. Points that lack a coordinate are dropped. So the same points come to the same cloud, whatever their
/// order was. False where `memory` or the cloud's buffer is too small, more points than one in 2 000 have no cell, a
/// band of rows has more points than cells, or more points share a cell than there is memory for: then nothing has
/// changed, or all points that lacked nothing are sorted by height, which takes half a second. O(points), two passes.
[[nodiscard]] bool order_points(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team,
                                Ordered& found);

}  // namespace slabd::algo
