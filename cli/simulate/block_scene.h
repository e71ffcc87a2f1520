// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "base/base.h"

/// What the emulated scanner sees: one supporting block with known dimensions, drawn by rays.
///
/// The block is an intersection and union of half-spaces, and all rays of one scan are parallel to the scanner's Z.
/// Seen from the scanner every face is then a linear function z(x, y), a ray enters an intersection at the largest of
/// the heights and a union at the smallest, and a whole scan is a few additions and comparisons per ray. This is exact
/// as long as every face looks towards the scanner, which `BlockSurface::make` checks.
///
/// Written from the drawing, on purpose without a line of algo: what measures must not share errors with what is
/// measured.
namespace slabd::simulate {

/// One block as it was really cast. Angles rad, lengths mm, block frame (X along the rail, Y outward, Z up).
struct BlockTruth {
  bool present = true;               ///< false: the scanner sees nothing but the slab's top
  double slope_rad = 0.0;            ///< bearing plane about X; positive climbs outward
  double jaw_angle_inner_rad = 0.0;  ///< between bearing plane and jaw face, in the free space
  double jaw_angle_outer_rad = 0.0;
  double jaw_distance_mm = 0.0;  ///< at the reference height, half of it on either side of the origin
  double casing_spacing_mm = 0.0;
  double protrusion_inner_mm = 0.0;  ///< rim above the bearing plane; negative = sunk
  double protrusion_outer_mm = 0.0;
  double bump_mm = 0.0;            ///< height of a smooth dome in the middle of the bearing plane
  double slab_top_shift_mm = 0.0;  ///< the slab's top against its nominal height in the block's frame
};

/// The block as drawn.
[[nodiscard]] BlockTruth nominal_truth(const Recipe& recipe);

/// Height of the dome of `bump_mm` = 1 at (x, s) on the bearing plane: exp(-r^2 / (2 * 25^2)). Symmetric about the
/// origin, so that it spoils the flatness and not the slope.
[[nodiscard]] double dome(double x_mm, double s_mm);

/// Peak to valley that a perfect instrument finds in the recipe's evaluation region: the dome against its own
/// least-squares plane there, casings left out. 0 without a dome.
[[nodiscard]] double true_flatness_mm(const Recipe& recipe, const BlockTruth& truth);

/// The visible surface of one block, in the scanner frame, for rays parallel to the scanner's +Z.
class BlockSurface {
 public:
  /// config when a face does not look towards the scanner (the view is tilted by more than about 8 degrees).
  [[nodiscard]] static Result<BlockSurface> make(const Recipe& recipe, const BlockTruth& truth,
                                                 const Pose& T_scanner_block);

  /// z (mm, scanner frame) where the ray through (x, y) meets the block; NaN inside a casing's bore.
  [[nodiscard]] float depth_mm(float x_mm, float y_mm) const;

 private:
  /// z = at_origin + slope_x * x + slope_y * y.
  struct Face {
    float at_origin = 0.0F;
    float slope_x = 0.0F;
    float slope_y = 0.0F;
    [[nodiscard]] float z(float x, float y) const { return at_origin + slope_x * x + slope_y * y; }
  };
  /// The casing's rim: a ring in a plane parallel to the bearing plane, open in the middle.
  struct Rim {
    Face plane;
    float centre_x = 0.0F;
    float centre_y = 0.0F;
    float centre_z = 0.0F;
  };

  [[nodiscard]] float dome_lift(float x_mm, float y_mm) const;

  bool present_ = true;
  Face slab_top_, bearing_, jaw_inner_, jaw_outer_, shoulder_inner_, shoulder_outer_;
  std::array<Face, 4> outline_{};  ///< end faces, side faces
  std::array<Rim, 2> rims_{};
  float bore_radius2_mm2_ = 0.0F;
  float rim_radius2_mm2_ = 0.0F;
  float reach_mm_ = 0.0F;  ///< no rim point is further than this from its centre, seen by the scanner
  float bump_mm_ = 0.0F;
  float bump_x_ = 0.0F;  ///< block origin, seen by the scanner
  float bump_y_ = 0.0F;
};

/// What the emulated scanner adds to the truth.
struct ScannerTraits {
  std::size_t columns = 2048;  ///< along scanner X
  std::size_t rows = 2448;     ///< along scanner Y
  double field_x_mm = 350.0;
  double field_y_mm = 500.0;
  bool organised = true;         ///< keep the grid, NaN for missing points
  double noise_mm = 0.03;        ///< standard deviation along the view
  double outlier_share = 0.005;  ///< of the returned points, evenly 1..60 mm before or behind the surface
  double missing_share = 0.02;
};
inline constexpr double kOutlierMinMm = 1.0;
inline constexpr double kOutlierMaxMm = 60.0;

struct DrawnScan {
  std::size_t width = 0;  ///< 0 = unorganised
  std::size_t height = 0;
  std::size_t valid = 0;  ///< finite points, outliers included
  std::size_t outliers = 0;
  std::size_t missing = 0;    ///< dropped at random
  std::size_t no_return = 0;  ///< rays into a bore
};

/// Draws one scan into `xyz` (3 floats a point; resized). The same seed gives the same bits. About 0.1 s for the full
/// grid.
[[nodiscard]] DrawnScan draw_scan(const BlockSurface& surface, const ScannerTraits& traits, std::uint64_t seed,
                                  std::vector<float>& xyz);

}  // namespace slabd::simulate
