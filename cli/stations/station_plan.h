// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "base/base.h"
#include "base/recipe.h"

/// Flange poses over all blocks, and the visible features from there. Pure functions.
namespace slabd::cli {

/// Measuring volume of a scanner: a frustum about its Z axis. Defaults: a 500 x 350 x 300 mm scanner, its long side
/// across the rail, at the nominal stand-off.
struct ScannerView {
  double distance_mm = 600.0;  ///< distance of width and height; the view grows in proportion to the distance
  double x_mm = 350.0;
  double y_mm = 500.0;
  double near_mm = 450.0;
  double far_mm = 750.0;
  double incidence_max_rad = rad_from_deg(70.0);  ///< between ray and normal; surfaces beyond it give bad points
};

/// Features of a block that the recipe measures and that must be visible.
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
  double seen = 0.0;  ///< share of the feature that is in the view, not occluded and within the incidence limit
  double incidence_max_rad = 0.0;  ///< largest angle of the feature
  double margin_mm = 0.0;          ///< distance to the view's nearest border at the feature; negative: outside
  double needed = 1.0;             ///< share that must be seen
  [[nodiscard]] bool ok() const { return seen >= needed; }
};

struct StationView {
  double off_axis_mm = 0.0;  ///< of the block's centre: the daemon accepts [robot] look_mm
  double distance_mm = 0.0;  ///< of the block's centre along the scanner's axis
  std::array<FeatureView, kFeatures> feature{};
  [[nodiscard]] bool ok(double look_mm) const;
};

/// Flange pose over block `station` for the scanner pose `T_block_scanner`.
[[nodiscard]] Pose planned_flange(const Recipe& recipe, const Pose& T_base_slab, const Pose& T_flange_scanner,
                                  const Pose& T_block_scanner, int station);
/// View of block `station` from the flange pose `T_base_flange`.
[[nodiscard]] StationView look_at(const Recipe& recipe, const ScannerView& view, const Pose& T_base_slab,
                                  const Pose& T_flange_scanner, const Pose& T_base_flange, int station);

}  // namespace slabd::cli
