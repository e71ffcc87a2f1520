// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "base/base.h"
#include "base/recipe.h"

/// Where the flange has to stand over every block, and what the scanner sees from there. Pure.
namespace slabd::cli {

/// The volume a scanner measures in: a frustum about its Z axis. Defaults: a 500 x 350 x 300 mm imager, its long side
/// across the rail, at the nominal stand-off.
struct ScannerView {
  double distance_mm = 600.0;  ///< where width and height hold; the view grows in proportion to the distance
  double x_mm = 350.0;
  double y_mm = 500.0;
  double near_mm = 450.0;
  double far_mm = 750.0;
  double incidence_max_rad = rad_from_deg(70.0);  ///< between ray and normal; beyond it surfaces give no good points
};

/// What the recipe measures on a block, and needs to see.
enum class Feature : std::uint8_t {
  seat,       ///< the evaluation region
  jaw_inner,  ///< the faces between the bearing plane and the shoulders
  jaw_outer,
  casing_inner,  ///< the rims
  casing_outer,
  slab_top,  ///< around the block: datum of the slope and of the registration
};
inline constexpr std::size_t kFeatures = 6;
[[nodiscard]] std::string_view name(Feature feature);

struct FeatureView {
  double seen = 0.0;               ///< share of the feature that is inside the view, not hidden and within incidence
  double incidence_max_rad = 0.0;  ///< worst of the feature
  double margin_mm = 0.0;          ///< to the view's nearest border, at the feature; negative: outside by so much
  double needed = 1.0;             ///< share that must be seen
  [[nodiscard]] bool ok() const { return seen >= needed; }
};

struct StationView {
  double off_axis_mm = 0.0;  ///< of the block's centre: the daemon allows [robot] look_mm
  double distance_mm = 0.0;  ///< of the block's centre along the scanner's axis
  std::array<FeatureView, kFeatures> feature{};
  [[nodiscard]] bool ok(double look_mm) const;
};

/// The flange over block `station` so that the scanner stands at `T_block_scanner`.
[[nodiscard]] Pose planned_flange(const Recipe& recipe, const Pose& T_base_slab, const Pose& T_flange_scanner,
                                  const Pose& T_block_scanner, int station);
/// What the scanner sees of block `station` when the flange stands at `T_base_flange`.
[[nodiscard]] StationView look_at(const Recipe& recipe, const ScannerView& view, const Pose& T_base_slab,
                                  const Pose& T_flange_scanner, const Pose& T_base_flange, int station);

}  // namespace slabd::cli
