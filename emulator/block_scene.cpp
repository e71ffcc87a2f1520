// SPDX-License-Identifier: Apache-2.0
#include "emulator/block_scene.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace slabd::emulator {
namespace {

constexpr double kDomeSigma_mm = 25.0;
/// The dome ends where it is below 1e-5 of its height, to save the time of the exponential.
constexpr double kDomeReach_mm = 4.8 * kDomeSigma_mm;

constexpr double kChipX = 20.0;
constexpr double kChipS = -30.0;
constexpr double kChipRadius_mm = 3.0;
constexpr double kBurrX = -20.0;
constexpr double kBurrS = 40.0;
constexpr double kBurrHalfX_mm = 7.5;
constexpr double kBurrHalfS_mm = 2.0;

constexpr double kSunkBeyondX = 55.0;
/// Position of the corner that a defect breaks out.
constexpr double kCornerX = 57.0;
constexpr double kCornerY = 155.0;

/// Half axes of a flat work glove: the upper half of this ellipsoid is above the bearing plane.
const Vec3 kGloveHalf_mm(60.0, 50.0, 15.0);
constexpr double kCableRadius_mm = 5.0;
/// The cable touches the shoulders, whose upper edge is at 29.75 mm.
constexpr double kCableAxisZ_mm = 35.0;

/// A point of the cross-section: `s` along the bearing plane outward, `h` along its normal.
Vec3 on_section(double slope_rad, double s, double h) {
  return {0.0, s * std::cos(slope_rad) - h * std::sin(slope_rad), s * std::sin(slope_rad) + h * std::cos(slope_rad)};
}

/// Normal of a face along the rail, `tilt_rad` from vertical, turning towards -Y.
Vec3 along_rail(double tilt_rad) {
  return {0.0, -std::sin(tilt_rad), std::cos(tilt_rad)};
}

}  // namespace

BlockTruth nominal_truth(const Recipe& recipe) {
  const BlockGeometry& b = recipe.block;
  BlockTruth truth;
  truth.slope_rad = std::atan(1.0 / b.cant_ratio.value);
  truth.jaw_angle_inner_rad = b.jaw_angle_rad.value;
  truth.jaw_angle_outer_rad = b.jaw_angle_rad.value;
  truth.jaw_distance_mm = 2.0 * b.jaw_half_distance_mm.value;
  truth.casing_spacing_mm = 2.0 * b.casing_half_spacing_mm.value;
  truth.protrusion_inner_mm = b.casing_rim_height_mm.value;
  truth.protrusion_outer_mm = b.casing_rim_height_mm.value;
  return truth;
}

double relief_mm(const BlockTruth& truth, double x_mm, double s_mm) {
  double height = 0.0;
  const double r2 = x_mm * x_mm + s_mm * s_mm;
  if (truth.bump_mm != 0.0 && r2 <= kDomeReach_mm * kDomeReach_mm)
    height += truth.bump_mm * std::exp(-r2 / (2.0 * kDomeSigma_mm * kDomeSigma_mm));
  if (std::hypot(x_mm - kChipX, s_mm - kChipS) < kChipRadius_mm) height -= truth.chip_mm;
  if (std::abs(x_mm - kBurrX) < kBurrHalfX_mm && std::abs(s_mm - kBurrS) < kBurrHalfS_mm) height += truth.burr_mm;
  if (x_mm > kSunkBeyondX) height -= truth.sunk_mm;
  return height;
}

double true_flatness_mm(const Recipe& recipe, const BlockTruth& truth) {
  if (truth.bump_mm == 0.0 && truth.chip_mm == 0.0 && truth.burr_mm == 0.0) return 0.0;
  // Points every quarter of a cell, relative to their own plane. The casings (at s = +-116.5) are outside the region.
  const EvaluationSettings& e = recipe.evaluation;
  const double step = 0.25 * e.cell_mm;
  const auto each_point = [&](const auto& visit) {
    for (double x = -e.crop_half_x_mm + 0.5 * step; x < e.crop_half_x_mm; x += step)
      for (double s = -e.crop_half_s_mm + 0.5 * step; s < e.crop_half_s_mm; s += step)
        visit(Vec3(1.0, x, s), relief_mm(truth, x, s));
  };
  Mat3 normal_matrix = Mat3::Zero();
  Vec3 right = Vec3::Zero();
  each_point([&](const Vec3& basis, double h) {
    normal_matrix += basis * basis.transpose();
    right += h * basis;
  });
  const Vec3 plane = normal_matrix.ldlt().solve(right);
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  each_point([&](const Vec3& basis, double h) {
    const double distance = h - plane.dot(basis);
    low = std::min(low, distance);
    high = std::max(high, distance);
  });
  return high - low;
}

Vec3 BlockSurface::direction(double x, double y) const {
  if (projection_ == Projection::parallel) return Vec3::UnitZ();
  return {x / kPictureDistance_mm, y / kPictureDistance_mm, 1.0};
}

BlockSurface::Face BlockSurface::seen(const Vec3& n_block, double d_block) const {
  const Vec3 n = T_scanner_block_.rotation * n_block;
  const double d = d_block + n.dot(T_scanner_block_.translation_mm);
  // A face parallel to all rays would begin at infinity; it is turned by a millionth of a degree instead.
  const auto not_zero = [](double v) { return std::abs(v) < 1e-8 ? -1e-8 : v; };
  if (projection_ == Projection::parallel) {
    const double nz = not_zero(n.z());
    return {-d / nz, n.x() / nz, n.y() / nz, nz < 0.0};
  }
  const double from_centre = not_zero(d);
  const double scale = 1.0 / (kPictureDistance_mm * from_centre);
  return {n.z() / from_centre, n.x() * scale, n.y() * scale, from_centre < 0.0};
}

Result<BlockSurface> BlockSurface::make(const Recipe& recipe, const BlockTruth& truth, const Pose& T_scanner_block,
                                        Projection projection) {
  const BlockGeometry& b = recipe.block;
  BlockSurface surface;
  surface.projection_ = projection;
  surface.T_scanner_block_ = T_scanner_block;
  surface.T_block_scanner_ = T_scanner_block.inverse();
  surface.truth_ = truth;
  surface.has_relief_ = truth.bump_mm != 0.0 || truth.chip_mm != 0.0 || truth.burr_mm != 0.0 || truth.sunk_mm != 0.0;
  surface.has_clutter_ = has_value(truth.glove_s_mm) || has_value(truth.cable_x_mm);

  surface.slab_top_ = surface.seen(Vec3::UnitZ(), b.slab_top_z_mm.value + truth.slab_top_shift_mm);
  const double slope = truth.slope_rad;
  const Vec3 n_bearing = along_rail(slope);
  surface.bearing_ = surface.seen(n_bearing, 0.0);
  surface.bearing_n_ = T_scanner_block.rotation * n_bearing;
  if (!surface.bearing_.entered || !surface.slab_top_.entered || T_scanner_block.translation_mm.z() < 100.0)
    return error(Code::config, "the block is not in front of the scanner");

  // The jaw face leans away from the free space. Its normal is the bearing normal turned by 180 degrees minus the
  // angle between the faces: towards the track centre line (outer jaw) or away from it (inner jaw).
  const double jaw_half = 0.5 * truth.jaw_distance_mm;
  const double height = b.jaw_reference_height_mm.value;
  const auto through = [&](const Vec3& n, const Vec3& p) { return surface.seen(n, n.dot(p)); };
  surface.jaw_outer_ = through(along_rail(slope + (kPi - truth.jaw_angle_outer_rad)),
                               on_section(slope, truth.jaw_shift_mm + jaw_half, height));
  surface.jaw_inner_ = through(along_rail(slope - (kPi - truth.jaw_angle_inner_rad)),
                               on_section(slope, truth.jaw_shift_mm - jaw_half, height));
  surface.shoulder_outer_ = surface.seen(Vec3::UnitZ(), b.shoulder_outer_z_mm.value);
  surface.shoulder_inner_ = surface.seen(Vec3::UnitZ(), b.shoulder_inner_z_mm.value);

  const Vec3 deeper(0.0, 0.0, -truth.corner_mm);
  surface.bearing_low_ = through(n_bearing, deeper);
  surface.jaw_outer_low_ = through(along_rail(slope + (kPi - truth.jaw_angle_outer_rad)),
                                   on_section(slope, truth.jaw_shift_mm + jaw_half, height) + deeper);
  surface.shoulder_outer_low_ = surface.seen(Vec3::UnitZ(), b.shoulder_outer_z_mm.value - truth.corner_mm);

  // x| = half - z tan(draft); side faces with X and Y exchanged.
  const double c = std::cos(b.draft_rad.value);
  const double s = std::sin(b.draft_rad.value);
  const double end = b.end_half_length_mm.value * c;
  const double side = b.side_half_width_mm.value * c;
  surface.outline_ = {surface.seen(Vec3(c, 0.0, s), end), surface.seen(Vec3(-c, 0.0, s), end),
                      surface.seen(Vec3(0.0, c, s), side), surface.seen(Vec3(0.0, -c, s), side)};

  const double bore_radius = 0.5 * b.casing_bore_diameter_mm.value;
  const double rim_radius = 0.5 * b.casing_rim_diameter_mm.value;
  surface.bore_radius2_mm2_ = bore_radius * bore_radius;
  surface.rim_radius2_mm2_ = rim_radius * rim_radius;
  if (has_value(truth.top_end_minus_mm))
    (void)surface.slab_ends_.push(surface.seen(-Vec3::UnitX(), truth.top_end_minus_mm));
  if (has_value(truth.top_end_plus_mm))
    (void)surface.slab_ends_.push(surface.seen(Vec3::UnitX(), truth.top_end_plus_mm));
  const double bottom = b.slab_top_z_mm.value + truth.slab_top_shift_mm - recipe.slab.thickness_mm.value;
  if (!surface.slab_ends_.empty()) (void)surface.slab_ends_.push(surface.seen(-Vec3::UnitZ(), -bottom));

  const std::array<double, 2> rim_s = {-0.5 * truth.casing_spacing_mm, 0.5 * truth.casing_spacing_mm};
  const std::array<double, 2> rim_h = {truth.protrusion_inner_mm, truth.protrusion_outer_mm};
  for (std::size_t i = 0; i < 2; ++i) {
    const Vec3 centre = on_section(slope, rim_s[i], rim_h[i]);
    Rim& rim = surface.rims_[i];
    rim.plane = through(n_bearing, centre);
    rim.centre = T_scanner_block * centre;
    const double magnified = projection == Projection::parallel ? 1.0 : kPictureDistance_mm / rim.centre.z();
    rim.picture_x = magnified * rim.centre.x();
    rim.picture_y = magnified * rim.centre.y();
    // The margin of a fifth of the rim covers the slant of the rays.
    surface.reach_mm_ = std::max(surface.reach_mm_, magnified * (1.2 * rim_radius + 1.0));
  }
  return surface;
}

double BlockSurface::seat_key(double x, double y) const {
  const double key = bearing_.key(x, y);
  if (!has_relief_) return key;
  // An object on the plane is met earlier by its height over the cosine of the ray. The point on the plane then
  // differs by a few per cent of the height, which is neglected.
  const double depth = depth_of(key);
  const Vec3 p = T_block_scanner_ * point(x, y, depth, 0.0);
  const double along = p.y() * std::cos(truth_.slope_rad) + p.z() * std::sin(truth_.slope_rad);
  const double height = relief_mm(truth_, p.x(), along);
  return height == 0.0 ? key : key_of(depth + height / bearing_n_.dot(direction(x, y)));
}

double BlockSurface::clutter_depth_mm(double x, double y) const {
  const bool parallel = projection_ == Projection::parallel;
  const Vec3 from = T_block_scanner_ * (parallel ? Vec3(x, y, 0.0) : Vec3(0.0, 0.0, 0.0));
  const Vec3 along = T_block_scanner_.rotation * direction(x, y);
  double nearest = std::numeric_limits<double>::infinity();
  // The first root of |from + t along| = 1 after scaling to a unit sphere or cylinder; t is the depth.
  const auto meet = [&](const Vec3& f, const Vec3& a) {
    const double aa = a.squaredNorm();
    const double half_b = f.dot(a);
    const double discriminant = half_b * half_b - aa * (f.squaredNorm() - 1.0);
    if (discriminant > 0.0) nearest = std::min(nearest, (-half_b - std::sqrt(discriminant)) / aa);
  };
  if (has_value(truth_.glove_s_mm)) {
    const Vec3 centre = on_section(truth_.slope_rad, truth_.glove_s_mm, 0.0);
    meet((from - centre).cwiseQuotient(kGloveHalf_mm), along.cwiseQuotient(kGloveHalf_mm));
  }
  if (has_value(truth_.cable_x_mm)) {
    const Vec3 f = (from - Vec3(truth_.cable_x_mm, 0.0, kCableAxisZ_mm)) / kCableRadius_mm;
    const Vec3 a = along / kCableRadius_mm;
    meet(Vec3(f.x(), 0.0, f.z()), Vec3(a.x(), 0.0, a.z()));
  }
  return nearest;
}

double BlockSurface::bodies_key(double x, double y, bool low) const {
  Inside outline;
  for (const Face& face : outline_) outline.cut(face, x, y);
  Inside seat = outline;
  if (low)
    seat.cut(bearing_low_, x, y);
  else
    seat.in = std::min(seat.in, seat_key(x, y));
  Inside outer = outline;
  outer.cut(low ? jaw_outer_low_ : jaw_outer_, x, y);
  outer.cut(low ? shoulder_outer_low_ : shoulder_outer_, x, y);
  Inside inner = outline;
  inner.cut(jaw_inner_, x, y);
  inner.cut(shoulder_inner_, x, y);
  return std::max({seat.first(), outer.first(), inner.first()});
}

double BlockSurface::top_key(double x, double y) const {
  if (slab_ends_.empty()) return slab_top_.key(x, y);
  Inside slab;
  slab.cut(slab_top_, x, y);
  for (const Face& face : slab_ends_) slab.cut(face, x, y);
  return slab.first();
}

double BlockSurface::depth_mm(double x, double y) const {
  const double top_key = this->top_key(x, y);
  const double nearest_key = truth_.present ? std::max(top_key, bodies_key(x, y, false)) : top_key;
  if (nearest_key == -std::numeric_limits<double>::infinity()) return kNoValue;
  double depth = depth_of(nearest_key);
  if (truth_.present && truth_.corner_mm != 0.0) {
    const Vec3 p = T_block_scanner_ * point(x, y, depth, 0.0);
    if (p.x() > kCornerX && p.y() > kCornerY) depth = depth_of(std::max(top_key, bodies_key(x, y, true)));
  }

  // The ray is in the ring or the bore according to its intersection with the rim's plane. The 0.25 mm wall between
  // rim and bearing plane is seen at a few degrees, hundredths of a millimetre wide, and is neglected.
  if (truth_.present) {
    for (const Rim& rim : rims_) {
      if (std::abs(x - rim.picture_x) > reach_mm_ || std::abs(y - rim.picture_y) > reach_mm_) continue;
      const double rim_depth = depth_of(rim.plane.key(x, y));
      const double r2 = (point(x, y, rim_depth, 0.0) - rim.centre).squaredNorm();
      if (r2 < bore_radius2_mm2_)
        depth = kNoValue;
      else if (r2 < rim_radius2_mm2_)
        depth = rim_depth;
    }
  }
  if (!has_clutter_) return depth;
  const double clutter = clutter_depth_mm(x, y);
  return clutter < depth || (std::isnan(depth) && std::isfinite(clutter)) ? clutter : depth;
}

Vec3 BlockSurface::point(double x, double y, double z, double further) const {
  if (projection_ == Projection::parallel) return {x, y, z + further};
  const Vec3 along = direction(x, y);
  return (z + further / along.norm()) * along;
}

}  // namespace slabd::emulator
