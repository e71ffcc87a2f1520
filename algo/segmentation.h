// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/points.h"

namespace slabd::algo {

/// What a point is measured for. The two seat parts are neighbours so that together they are the full plane.
enum class Region : std::uint8_t { none, seat_crop, seat_rest, jaw_inner, jaw_outer, top, casing_inner, casing_outer };
inline constexpr std::size_t kRegions = 8;

/// Indices of the cloud's points, grouped by region.
struct Segments {
  std::span<std::uint32_t> order;
  std::array<std::size_t, kRegions + 1> start{};

  [[nodiscard]] std::span<std::uint32_t> of(Region region) const {
    const auto r = static_cast<std::size_t>(region);
    return order.subspan(start[r], start[r + 1] - start[r]);
  }
  [[nodiscard]] std::span<std::uint32_t> full_seat() const {
    const auto crop = static_cast<std::size_t>(Region::seat_crop);
    return order.subspan(start[crop], start[crop + 2] - start[crop]);
  }
};

/// Divides a registered cloud by the model (paper 2.2): a point belongs to a face when it is within
/// registration_gate_mm of it and at least edge_margin_mm, measured on the face, away from every edge. Points of no
/// region are left out of `order`. `label` and `order` need room for every point. O(points).
[[nodiscard]] Segments segment(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                               const FastTransform& T_block_scanner, std::span<std::uint8_t> label,
                               std::span<std::uint32_t> order);

}  // namespace slabd::algo
