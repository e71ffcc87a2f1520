// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>

#include "base/base.h"

/// Ray casting of one supporting block with known dimensions, the object of the emulated scanner.
///
/// The block is a union of convex bodies, each an intersection of half-spaces. A picture point (x, y) is a ray, either
/// parallel to the scanner's Z (an orthographic scan) or through the scanner's origin (projector and camera as one
/// centre). Along the ray every half-space begins or ends at a depth. Its key is minus the depth (parallel) or one
/// over the depth (perspective), which is linear in x and y; nearer is larger. A convex body is met at the smallest
/// key of its beginnings, if that is before the largest of its ends. A union is met at the largest key of its bodies.
/// A scan is thus a few additions and comparisons per ray, exact, with hidden faces and shadows.
///
/// The code follows the drawing and shares nothing with algo, so that the emulator and the measurement do not share
/// errors.
namespace slabd::emulator {

/// Actual dimensions of one block. Angles rad, lengths mm, block frame (X along the rail, Y outward, Z up).
struct BlockTruth {
  bool present = true;               ///< false: the scanner sees only the slab's top
  double slope_rad = 0.0;            ///< bearing plane about X; positive rises outward
  double jaw_angle_inner_rad = 0.0;  ///< between bearing plane and jaw face, in the free space
  double jaw_angle_outer_rad = 0.0;
  double jaw_distance_mm = 0.0;  ///< at the reference height, symmetric about the origin
  double casing_spacing_mm = 0.0;
  double protrusion_inner_mm = 0.0;  ///< rim above the bearing plane; negative = sunk
  double protrusion_outer_mm = 0.0;
  double jaw_shift_mm = 0.0;       ///< shift of both jaws outward along the bearing plane; the casings stay in place
  double slab_top_shift_mm = 0.0;  ///< the slab's top relative to its nominal height in the block's frame
  // End of the slab along the rail, |x| from the block's origin; NaN: another block comes first.
  double top_end_minus_mm = kNoValue;
  double top_end_plus_mm = kNoValue;

  // Relief of the bearing plane (see `relief_mm`).
  double bump_mm = 0.0;  ///< height of the centre of a smooth dome
  double chip_mm = 0.0;  ///< depth of a spalled spot
  double burr_mm = 0.0;  ///< height of a ridge
  double sunk_mm = 0.0;  ///< depth by which the bearing plane beyond x = 55 is sunk

  double corner_mm = 0.0;  ///< depth of the corner broken out of the block: x > 57, y > 155, an area of 48 x 85 mm

  // Foreign objects; NaN: absent.
  double glove_s_mm = kNoValue;  ///< position of a glove along the bearing plane
  double cable_x_mm = kNoValue;  ///< position along the rail of a cable that crosses the block
};

/// The block as drawn.
[[nodiscard]] BlockTruth nominal_truth(const Recipe& recipe);

/// Height of the relief on the bearing plane at (x, s), negative for missing material. A dome exp(-r^2 / (2 * 25^2))
/// about the origin affects the flatness and not the slope. A round chip of 6 mm is at (20, -30), a burr of 4 mm along
/// s and 15 mm along x at (-20, 40). Chip and burr have vertical walls, and each covers a whole cell of 1.5 mm for any
/// cell origin. Beyond x = 55 the whole plane may be sunk.
[[nodiscard]] double relief_mm(const BlockTruth& truth, double x_mm, double s_mm);

/// Peak to valley of an ideal measurement in the recipe's evaluation region: the relief relative to its own
/// least-squares plane. 0 without relief.
[[nodiscard]] double true_flatness_mm(const Recipe& recipe, const BlockTruth& truth);

enum class Projection : std::uint8_t { parallel, perspective };
/// Distance at which a perspective picture is as large as a parallel one: the nominal stand-off.
inline constexpr double kPictureDistance_mm = 600.0;

/// The visible surface of one block, in the scanner frame.
class BlockSurface {
 public:
  /// Code::config if the block is not in front of the scanner.
  [[nodiscard]] static Result<BlockSurface> make(const Recipe& recipe, const BlockTruth& truth,
                                                 const Pose& T_scanner_block,
                                                 Projection projection = Projection::parallel);

  /// z (mm, scanner frame) where the ray of picture point (x, y) meets block or slab; NaN inside a casing's bore and
  /// beyond the slab's end.
  [[nodiscard]] double depth_mm(double x_mm, double y_mm) const;
  /// The point of that ray at depth z, moved away from the scanner along the ray by `further_mm`.
  [[nodiscard]] Vec3 point(double x_mm, double y_mm, double z_mm, double further_mm) const;

 private:
  /// A half-space along the rays: it begins (`entered`) or ends at the key at_origin + per_x * x + per_y * y.
  struct Face {
    double at_origin = 0.0;
    double per_x = 0.0;
    double per_y = 0.0;
    bool entered = true;
    [[nodiscard]] double key(double x, double y) const { return at_origin + per_x * x + per_y * y; }
  };
  /// Part of a ray inside a convex body: from key `in` down to key `out`.
  struct Inside {
    double in = std::numeric_limits<double>::infinity();
    double out = -std::numeric_limits<double>::infinity();
    void cut(const Face& face, double x, double y) {
      if (face.entered)
        in = std::min(in, face.key(x, y));
      else
        out = std::max(out, face.key(x, y));
    }
    [[nodiscard]] double first() const { return in > out ? in : -std::numeric_limits<double>::infinity(); }
  };
  /// The casing's rim: a ring in a plane parallel to the bearing plane, open in the middle.
  struct Rim {
    Face plane;
    Vec3 centre = Vec3::Zero();
    double picture_x = 0.0;  ///< picture point of its centre
    double picture_y = 0.0;
  };

  [[nodiscard]] double depth_of(double key) const { return projection_ == Projection::parallel ? -key : 1.0 / key; }
  [[nodiscard]] double key_of(double depth) const { return projection_ == Projection::parallel ? -depth : 1.0 / depth; }
  /// Direction of a ray with z = 1.
  [[nodiscard]] Vec3 direction(double x, double y) const;
  [[nodiscard]] Face seen(const Vec3& n_block, double d_block) const;
  /// Key of the block's bodies at (x, y); `low`: with the surfaces of the broken corner.
  [[nodiscard]] double bodies_key(double x, double y, bool low) const;
  [[nodiscard]] double seat_key(double x, double y) const;
  [[nodiscard]] double top_key(double x, double y) const;
  [[nodiscard]] double clutter_depth_mm(double x, double y) const;

  Projection projection_ = Projection::parallel;
  Pose T_scanner_block_;
  Pose T_block_scanner_;
  BlockTruth truth_;
  bool has_relief_ = false;
  bool has_clutter_ = false;
  Face slab_top_, bearing_, jaw_inner_, jaw_outer_, shoulder_inner_, shoulder_outer_;
  Vec3 bearing_n_ = Vec3::UnitZ();                         ///< scanner frame
  Face bearing_low_, jaw_outer_low_, shoulder_outer_low_;  ///< surfaces of the broken corner
  std::array<Face, 4> outline_{};                          ///< end faces, side faces
  FixedVector<Face, 3> slab_ends_;                         ///< and the slab's bottom; empty: the top is unlimited
  std::array<Rim, 2> rims_{};
  double bore_radius2_mm2_ = 0.0;
  double rim_radius2_mm2_ = 0.0;
  double reach_mm_ = 0.0;  ///< largest distance of a rim point from its centre, in the picture
};

}  // namespace slabd::emulator
