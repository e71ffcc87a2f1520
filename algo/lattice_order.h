// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/lattice.h"
#include "algo/team.h"

namespace slabd::algo {

/// Memory for `order_points`.
struct OrderMemory {
  std::array<std::span<float>, 3> points;  ///< for a little more than half of the cloud in all
  std::span<std::uint32_t> words;          ///< kOrderWords
};
inline constexpr std::size_t kOrderWords = 400'000;

/// Do consecutive points lie near each other, as a scanner exports them? Told from a thousand places in the cloud.
[[nodiscard]] bool is_in_order(const Cloud& cloud, const Lattice& lattice);

/// Brings the points into the order of their lattice: row by row, each from left to right. Where several share a cell
/// the lowest has its place; the others follow at the end of a band of rows. Points without a cell come last. So the
/// same points come to the same order, whatever it was. False, and nothing changed, when the memory is too small or
/// most points have no cell. O(points), five passes.
[[nodiscard]] bool order_points(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team);

}  // namespace slabd::algo
