// SPDX-License-Identifier: Apache-2.0
#include "cli/stations/station_plan.h"

#include <algorithm>
#include <cmath>

// Problem: from a reachable pose a jaw face may still be edge on, or the seat may be cut off, which production reports
// only as "not measured". Idea: put points with normals on every measured face. For each point test the field of view,
// the angle of incidence, and occlusion by the block. The block is the recipe's height z(x, y); a ray is occluded if
// it passes below that height.
namespace slabd::cli {
namespace {

constexpr double kStep_mm = 5.0;     ///< distance of the points of a feature
constexpr double kRayStep_mm = 4.0;  ///< step along a ray
constexpr double kClear_mm = 0.5;    ///< a ray this far below a surface is occluded
constexpr double kRimShare = 0.9;    ///< share of a rim that must be seen, because a circle is fitted to it
constexpr double kTopShare = 0.25;   ///< share of the strip around the block: enough spread for a datum plane
constexpr double kTopStrip_mm = 20.0;

struct Spot {
  Vec3 p;  ///< block frame
  Vec3 n;
};

class BlockShape {
 public:
  explicit BlockShape(const Recipe& recipe) : recipe_(recipe), b_(recipe.block) {
    cant_ = std::atan(1.0 / b_.cant_ratio.value);
    lean_ = b_.jaw_angle_rad.value - kPi / 2.0;
  }

  /// The point with coordinate `s` along the bearing plane and `h` above it, at `x`.
  [[nodiscard]] Vec3 at(double x, double s, double h) const {
    return {x, s * std::cos(cant_) - h * std::sin(cant_), s * std::sin(cant_) + h * std::cos(cant_)};
  }

  /// z = max(slab top, min(end faces, side faces, shoulder, max(bearing plane, jaw face))).
  [[nodiscard]] double height(double x, double y) const {
    const double bearing = y * std::tan(cant_);
    const double jaw = std::max(jaw_height(y, +1.0), jaw_height(y, -1.0));
    const double shoulder = y >= 0.0 ? b_.shoulder_outer_z_mm.value : b_.shoulder_inner_z_mm.value;
    const double slope = 1.0 / std::tan(b_.draft_rad.value);
    const double ends = (b_.end_half_length_mm.value - std::abs(x)) * slope;
    const double sides = (b_.side_half_width_mm.value - std::abs(y)) * slope;
    return std::max(b_.slab_top_z_mm.value, std::min({ends, sides, shoulder, std::max(bearing, jaw)}));
  }

  [[nodiscard]] std::vector<Spot> spots(Feature feature) const {
    switch (feature) {
      case Feature::seat: return seat();
      case Feature::jaw_inner: return jaw(-1.0);
      case Feature::jaw_outer: return jaw(+1.0);
      case Feature::casing_inner: return rim(-1.0);
      case Feature::casing_outer: return rim(+1.0);
      case Feature::slab_top: return top();
    }
    return {};
  }

 private:
  /// Height of the plane of the jaw face on that side over y; it falls towards the seat.
  [[nodiscard]] double jaw_height(double y, double side) const {
    const Vec3 foot = at(0.0, side * b_.jaw_half_distance_mm.value, b_.jaw_reference_height_mm.value);
    const Vec3 n = jaw_normal(side);
    return foot.z() - n.y() * (y - foot.y()) / n.z();
  }
  [[nodiscard]] Vec3 jaw_normal(double side) const {
    const double along = -side * std::cos(lean_);
    const double up = std::sin(lean_);
    return {0.0, along * std::cos(cant_) - up * std::sin(cant_), along * std::sin(cant_) + up * std::cos(cant_)};
  }
  [[nodiscard]] Vec3 seat_normal() const { return {0.0, -std::sin(cant_), std::cos(cant_)}; }

  [[nodiscard]] std::vector<Spot> seat() const {
    std::vector<Spot> spots;
    const double half_x = recipe_.evaluation.crop_half_x_mm;
    const double half_s = recipe_.evaluation.crop_half_s_mm;
    for (double x = -half_x; x <= half_x + 1e-9; x += kStep_mm)
      for (double s = -half_s; s <= half_s + 1e-9; s += kStep_mm) spots.push_back({at(x, s, 0.0), seat_normal()});
    return spots;
  }
  [[nodiscard]] std::vector<Spot> jaw(double side) const {
    std::vector<Spot> spots;
    const double margin = recipe_.evaluation.edge_margin_mm;
    const double top_z = side > 0.0 ? b_.shoulder_outer_z_mm.value : b_.shoulder_inner_z_mm.value;
    const double half_x = b_.end_half_length_mm.value - top_z * std::tan(b_.draft_rad.value) - margin;
    for (double h = margin; h < 200.0; h += 2.0) {
      const double s = b_.jaw_half_distance_mm.value + (h - b_.jaw_reference_height_mm.value) * std::tan(lean_);
      const Vec3 p = at(0.0, side * s, h);
      if (p.z() > top_z - margin) break;
      for (double x = -half_x; x <= half_x + 1e-9; x += kStep_mm)
        spots.push_back({at(x, side * s, h), jaw_normal(side)});
    }
    return spots;
  }
  [[nodiscard]] std::vector<Spot> rim(double side) const {
    std::vector<Spot> spots;
    for (const double radius : {0.5 * b_.casing_bore_diameter_mm.value, 0.5 * b_.casing_rim_diameter_mm.value})
      for (int i = 0; i < 72; ++i) {
        const double angle = 2.0 * kPi * i / 72.0;
        spots.push_back({at(radius * std::cos(angle), side * b_.casing_half_spacing_mm.value + radius * std::sin(angle),
                            b_.casing_rim_height_mm.value),
                         seat_normal()});
      }
    return spots;
  }
  [[nodiscard]] std::vector<Spot> top() const {
    std::vector<Spot> spots;
    const double z = b_.slab_top_z_mm.value;
    const double grow = -z * std::tan(b_.draft_rad.value) + 1.0;
    const double half_x = b_.end_half_length_mm.value + grow;
    const double half_y = b_.side_half_width_mm.value + grow;
    for (double y = -half_y - kTopStrip_mm; y <= half_y + kTopStrip_mm; y += kStep_mm)
      for (double x = -half_x - kTopStrip_mm; x <= half_x + kTopStrip_mm; x += kStep_mm)
        if (std::abs(x) > half_x || std::abs(y) > half_y) spots.push_back({{x, y, z}, Vec3::UnitZ()});
    return spots;
  }

  const Recipe& recipe_;
  const BlockGeometry& b_;
  double cant_ = 0.0;
  double lean_ = 0.0;
};

/// Follows the ray over the surface until it is above all faces.
bool is_hidden(const BlockShape& shape, const Vec3& p, const Vec3& eye) {
  const Vec3 way = (eye - p).normalized();
  if (way.z() <= 0.0) return true;
  constexpr double kAboveAll_mm = 120.0;
  for (double t = kRayStep_mm; t < kAboveAll_mm / way.z(); t += kRayStep_mm) {
    const Vec3 q = p + t * way;
    if (q.z() < shape.height(q.x(), q.y()) - kClear_mm) return true;
  }
  return false;
}

/// Distance of a point in the scanner's frame from the border of the view, in mm at its depth.
double margin_of(const ScannerView& view, const Vec3& p) {
  const double scale = p.z() / view.distance_mm;
  return std::min({0.5 * view.x_mm * scale - std::abs(p.x()), 0.5 * view.y_mm * scale - std::abs(p.y()),
                   p.z() - view.near_mm, view.far_mm - p.z()});
}

double needed(Feature feature) {
  switch (feature) {
    case Feature::seat:
    case Feature::jaw_inner:
    case Feature::jaw_outer: return 1.0;
    case Feature::casing_inner:
    case Feature::casing_outer: return kRimShare;
    case Feature::slab_top: return kTopShare;
  }
  return 1.0;
}

}  // namespace

std::string_view name(Feature feature) {
  static constexpr std::array<std::string_view, kFeatures> kNames = {"seat",         "jaw_inner",    "jaw_outer",
                                                                     "casing_inner", "casing_outer", "slab_top"};
  return kNames.at(static_cast<std::size_t>(feature));
}

bool StationView::ok(double look_mm) const {
  return off_axis_mm <= look_mm && distance_mm > 0.0 &&
         std::all_of(feature.begin(), feature.end(), [](const FeatureView& f) { return f.ok(); });
}

Pose planned_flange(const Recipe& recipe, const Pose& T_base_slab, const Pose& T_flange_scanner,
                    const Pose& T_block_scanner, int station) {
  return T_base_slab * T_slab_block(recipe, station) * T_block_scanner * T_flange_scanner.inverse();
}

StationView look_at(const Recipe& recipe, const ScannerView& view, const Pose& T_base_slab,
                    const Pose& T_flange_scanner, const Pose& T_base_flange, int station) {
  const Pose T_block_scanner =
      (T_base_slab * T_slab_block(recipe, station)).inverse() * T_base_flange * T_flange_scanner;
  const Pose T_scanner_block = T_block_scanner.inverse();
  const BlockShape shape(recipe);
  StationView out;
  const Vec3& centre = T_scanner_block.translation_mm;
  out.off_axis_mm = std::hypot(centre.x(), centre.y());
  out.distance_mm = centre.z();
  for (std::size_t i = 0; i < kFeatures; ++i) {
    FeatureView& seen = out.feature[i];
    seen.needed = needed(static_cast<Feature>(i));
    seen.margin_mm = std::numeric_limits<double>::infinity();
    const std::vector<Spot> spots = shape.spots(static_cast<Feature>(i));
    std::size_t good = 0;
    for (const Spot& spot : spots) {
      const double margin = margin_of(view, T_scanner_block * spot.p);
      const double incidence = angle_between_rad(spot.n, Vec3(T_block_scanner.translation_mm - spot.p));
      seen.margin_mm = std::min(seen.margin_mm, margin);
      seen.incidence_max_rad = std::max(seen.incidence_max_rad, incidence);
      if (margin >= 0.0 && incidence <= view.incidence_max_rad &&
          !is_hidden(shape, spot.p, T_block_scanner.translation_mm))
        ++good;
    }
    seen.seen = spots.empty() ? 0.0 : static_cast<double>(good) / static_cast<double>(spots.size());
  }
  return out;
}

}  // namespace slabd::cli
