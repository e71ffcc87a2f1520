// SPDX-License-Identifier: Apache-2.0
#include "cli/simulate/block_scene.h"

#include <algorithm>
#include <cmath>

namespace slabd::simulate {
namespace {

constexpr double kDomeSigmaMm = 25.0;
/// The dome ends where it is below 1e-5 of its height; beyond, the exponential is not worth its time.
constexpr double kDomeReachMm = 4.8 * kDomeSigmaMm;

/// n . p = d with n pointing out of the material; block frame.
struct Plane {
  Vec3 n = Vec3::UnitZ();
  double d = 0.0;
};

/// Through (y, z), with the outward normal at `tilt_rad` from vertical, turning towards -Y.
Plane along_rail(double y, double z, double tilt_rad) {
  const Vec3 n(0.0, -std::sin(tilt_rad), std::cos(tilt_rad));
  return {n, n.y() * y + n.z() * z};
}

Plane horizontal(double z) {
  return {Vec3::UnitZ(), z};
}

/// An end face (|x| = half - z tan(draft), sign +-1 of x); with X and Y exchanged a side face.
Plane drafted(double half, double draft_rad, double sign, bool is_side) {
  const double c = std::cos(draft_rad);
  const double s = std::sin(draft_rad);
  const Vec3 n = is_side ? Vec3(0.0, sign * c, s) : Vec3(sign * c, 0.0, s);
  return {n, half * c};
}

/// A point of the cross-section: `s` along the bearing plane outward, `h` along its normal.
Vec3 on_section(double slope_rad, double s, double h) {
  return {0.0, s * std::cos(slope_rad) - h * std::sin(slope_rad), s * std::sin(slope_rad) + h * std::cos(slope_rad)};
}

/// Standard normal deviates as 2^16 equally likely values, the quantiles of the distribution: one table look-up per
/// point instead of a logarithm and a cosine. Ends at +-4.3 sigma.
const std::vector<float>& normal_table() {
  static const std::vector<float> table = [] {
    constexpr std::size_t kSize = 1U << 16U;
    std::vector<float> values(kSize);
    double z = -4.4;
    for (std::size_t i = 0; i < kSize; ++i) {
      const double p = (static_cast<double>(i) + 0.5) / static_cast<double>(kSize);
      // Newton on the distribution function, started at the previous quantile (below the root, where it is convex on
      // the left half; a few steps suffice everywhere).
      for (int step = 0; step < 60; ++step) {
        const double excess = 0.5 * std::erfc(-z / std::sqrt(2.0)) - p;
        const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * kPi);
        const double move = std::clamp(excess / density, -0.1, 0.1);
        z -= move;
        if (std::abs(move) < 1e-12) break;
      }
      values[i] = static_cast<float>(z);
    }
    return values;
  }();
  return table;
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

double dome(double x_mm, double s_mm) {
  const double r2 = x_mm * x_mm + s_mm * s_mm;
  if (r2 > kDomeReachMm * kDomeReachMm) return 0.0;
  return std::exp(-r2 / (2.0 * kDomeSigmaMm * kDomeSigmaMm));
}

double true_flatness_mm(const Recipe& recipe, const BlockTruth& truth) {
  if (truth.bump_mm == 0.0) return 0.0;
  // The dome and the region are symmetric in x and s, so the least-squares plane is level and peak to valley is the
  // difference of the extremes. The casings (at s = +-116.5) lie outside the region.
  const EvaluationSettings& e = recipe.evaluation;
  const double half_cell = 0.5 * e.cell_mm;
  return std::abs(truth.bump_mm) *
         (dome(half_cell, half_cell) - dome(e.crop_half_x_mm - half_cell, e.crop_half_s_mm - half_cell));
}

Result<BlockSurface> BlockSurface::make(const Recipe& recipe, const BlockTruth& truth, const Pose& T_scanner_block) {
  const BlockGeometry& b = recipe.block;
  const Mat3 rotation = T_scanner_block.rotation.toRotationMatrix();
  const Vec3& origin = T_scanner_block.translation_mm;
  bool all_visible = true;

  const auto seen = [&](const Plane& plane) {
    const Vec3 n = rotation * plane.n;
    const double d = plane.d + n.dot(origin);
    // 0.03: a face seen at less than 1.7 degrees is as good as hidden.
    all_visible = all_visible && n.z() < -0.03;
    return Face{static_cast<float>(d / n.z()), static_cast<float>(-n.x() / n.z()), static_cast<float>(-n.y() / n.z())};
  };

  BlockSurface surface;
  surface.present_ = truth.present;
  surface.slab_top_ = seen(horizontal(b.slab_top_z_mm.value + truth.slab_top_shift_mm));

  const double slope = truth.slope_rad;
  surface.bearing_ = seen(along_rail(0.0, 0.0, slope));

  // A jaw face leans away from the free space: its normal turns from the bearing normal towards the track centre line
  // (outer jaw) or away from it (inner jaw) by 180 degrees minus the angle between the two faces.
  const double jaw_half = 0.5 * truth.jaw_distance_mm;
  const double height = b.jaw_reference_height_mm.value;
  const Vec3 outer = on_section(slope, jaw_half, height);
  const Vec3 inner = on_section(slope, -jaw_half, height);
  surface.jaw_outer_ = seen(along_rail(outer.y(), outer.z(), slope + (kPi - truth.jaw_angle_outer_rad)));
  surface.jaw_inner_ = seen(along_rail(inner.y(), inner.z(), slope - (kPi - truth.jaw_angle_inner_rad)));
  surface.shoulder_outer_ = seen(horizontal(b.shoulder_outer_z_mm.value));
  surface.shoulder_inner_ = seen(horizontal(b.shoulder_inner_z_mm.value));

  const double draft = b.draft_rad.value;
  surface.outline_ = {seen(drafted(b.end_half_length_mm.value, draft, 1.0, false)),
                      seen(drafted(b.end_half_length_mm.value, draft, -1.0, false)),
                      seen(drafted(b.side_half_width_mm.value, draft, 1.0, true)),
                      seen(drafted(b.side_half_width_mm.value, draft, -1.0, true))};

  const std::array<double, 2> rim_s = {-0.5 * truth.casing_spacing_mm, 0.5 * truth.casing_spacing_mm};
  const std::array<double, 2> rim_h = {truth.protrusion_inner_mm, truth.protrusion_outer_mm};
  for (std::size_t i = 0; i < 2; ++i) {
    const Vec3 centre = on_section(slope, rim_s[i], rim_h[i]);
    const Vec3 centre_scanner = T_scanner_block * centre;
    surface.rims_[i] = {seen(along_rail(centre.y(), centre.z(), slope)), static_cast<float>(centre_scanner.x()),
                        static_cast<float>(centre_scanner.y()), static_cast<float>(centre_scanner.z())};
  }
  const double bore_radius = 0.5 * b.casing_bore_diameter_mm.value;
  const double rim_radius = 0.5 * b.casing_rim_diameter_mm.value;
  surface.bore_radius2_mm2_ = static_cast<float>(bore_radius * bore_radius);
  surface.rim_radius2_mm2_ = static_cast<float>(rim_radius * rim_radius);
  surface.reach_mm_ = static_cast<float>(rim_radius + 1.0);
  surface.bump_mm_ = static_cast<float>(truth.bump_mm);
  surface.bump_x_ = static_cast<float>(origin.x());
  surface.bump_y_ = static_cast<float>(origin.y());

  if (!all_visible)
    return error(Code::config, "a face of the block does not look towards the scanner: the view is tilted too far");
  return surface;
}

float BlockSurface::dome_lift(float x_mm, float y_mm) const {
  if (bump_mm_ == 0.0F) return 0.0F;
  // The few degrees between view and bearing plane shorten the dome by less than 0.1 % sideways.
  return bump_mm_ * static_cast<float>(dome(static_cast<double>(x_mm - bump_x_), static_cast<double>(y_mm - bump_y_)));
}

float BlockSurface::depth_mm(float x, float y) const {
  const float top = slab_top_.z(x, y);
  if (!present_) return top;

  // Closer to the scanner is smaller: a union is entered at the minimum, an intersection at the maximum.
  float outline = outline_[0].z(x, y);
  for (std::size_t i = 1; i < outline_.size(); ++i) outline = std::max(outline, outline_[i].z(x, y));
  const float seat = bearing_.z(x, y) - dome_lift(x, y);
  const float jaw_outer = std::max(jaw_outer_.z(x, y), shoulder_outer_.z(x, y));
  const float jaw_inner = std::max(jaw_inner_.z(x, y), shoulder_inner_.z(x, y));
  const float body = std::min(seat, std::min(jaw_outer, jaw_inner));
  const float z = std::min(top, std::max(outline, body));

  // Ring or bore is decided where the ray meets the rim's plane. The 0.25 mm wall between rim and bearing plane is
  // seen under 1.5 degrees, 0.007 mm wide: left out.
  for (const Rim& rim : rims_) {
    if (std::abs(x - rim.centre_x) > reach_mm_ || std::abs(y - rim.centre_y) > reach_mm_) continue;
    const float z_rim = rim.plane.z(x, y);
    const float dx = x - rim.centre_x;
    const float dy = y - rim.centre_y;
    const float dz = z_rim - rim.centre_z;
    const float r2 = dx * dx + dy * dy + dz * dz;
    if (r2 < bore_radius2_mm2_) return std::numeric_limits<float>::quiet_NaN();
    if (r2 < rim_radius2_mm2_) return z_rim;
  }
  return z;
}

DrawnScan draw_scan(const BlockSurface& surface, const ScannerTraits& traits, std::uint64_t seed,
                    std::vector<float>& xyz) {
  const std::vector<float>& normals = normal_table();
  const auto noise = static_cast<float>(traits.noise_mm);
  // Shares as 16-bit thresholds: steps of 1/65536, finer than anybody can count in one scan.
  const auto missing_below = static_cast<std::uint32_t>(std::lround(traits.missing_share * 65536.0));
  const auto outlier_below = static_cast<std::uint32_t>(std::lround(traits.outlier_share * 65536.0));
  const auto outlier_span = static_cast<float>((kOutlierMaxMm - kOutlierMinMm) / 32768.0);
  const float missing_point = std::numeric_limits<float>::quiet_NaN();

  xyz.resize(traits.columns * traits.rows * 3);
  Prng random(seed);
  DrawnScan drawn;
  const double step_x = traits.field_x_mm / static_cast<double>(traits.columns);
  const double step_y = traits.field_y_mm / static_cast<double>(traits.rows);
  std::size_t at = 0;
  for (std::size_t row = 0; row < traits.rows; ++row) {
    const auto y = static_cast<float>((static_cast<double>(row) + 0.5) * step_y - 0.5 * traits.field_y_mm);
    for (std::size_t column = 0; column < traits.columns; ++column) {
      const auto x = static_cast<float>((static_cast<double>(column) + 0.5) * step_x - 0.5 * traits.field_x_mm);
      // One draw feeds all decisions about a ray, 16 bits each.
      const std::uint64_t bits = random.next();
      float z = surface.depth_mm(x, y);
      const bool no_return = std::isnan(z);
      const bool missing = (bits & 0xFFFFU) < missing_below;
      drawn.no_return += no_return ? 1U : 0U;
      drawn.missing += (missing && !no_return) ? 1U : 0U;
      if (no_return || missing) {
        if (!traits.organised) continue;
        xyz[at++] = missing_point;
        xyz[at++] = missing_point;
        xyz[at++] = missing_point;
        continue;
      }
      if (((bits >> 16U) & 0xFFFFU) < outlier_below) {
        const auto size =
            static_cast<float>((bits >> 48U) & 0x7FFFU) * outlier_span + static_cast<float>(kOutlierMinMm);
        z += (bits >> 63U) != 0 ? size : -size;
        ++drawn.outliers;
      } else {
        z += noise * normals[(bits >> 32U) & 0xFFFFU];
      }
      xyz[at++] = x;
      xyz[at++] = y;
      xyz[at++] = z;
      ++drawn.valid;
    }
  }
  xyz.resize(at);
  if (traits.organised) {
    drawn.width = traits.columns;
    drawn.height = traits.rows;
  }
  return drawn;
}

}  // namespace slabd::simulate
