// SPDX-License-Identifier: Apache-2.0
#include "scene.h"

#include <algorithm>
#include <cmath>

namespace slabd::scene {
namespace {

struct HalfSpace {
  Vec3 n;
  double d;
  /// Distance at which a ray coming from outside enters.
  [[nodiscard]] double entry(const Vec3& from, const Vec3& along) const { return (d - n.dot(from)) / n.dot(along); }
};

bool is_within(double radius, double x, double y) {
  return x * x + y * y < radius * radius;
}

HalfSpace half_space(const Vec3& normal, const Vec3& p) {
  const Vec3 n = normal.normalized();
  return {n, n.dot(p)};
}

struct Solid {
  explicit Solid(const Block& b) : block(b) {
    const double cant = std::atan(1.0 / b.cant_ratio);
    t = Vec3(0.0, std::cos(cant), std::sin(cant));
    n = Vec3(0.0, -std::sin(cant), std::cos(cant));
    seat = half_space(n, Vec3::Zero());
    rim_inner = half_space(n, b.rim_inner_mm * n);
    rim_outer = half_space(n, b.rim_outer_mm * n);
    const auto jaw = [&](double side, double angle_deg) {
      const double a = rad_from_deg(angle_deg);
      // Upward along the face, and the normal towards the seat.
      const Vec3 up = -std::cos(a) * side * t + std::sin(a) * n;
      const Vec3 normal = side > 0.0 ? Vec3(up.cross(Vec3::UnitX())) : Vec3(Vec3::UnitX().cross(up));
      const Vec3 foot = side * 0.5 * b.jaw_distance_mm * t + 10.0 * n;
      return half_space(normal.dot(n) > 0.0 ? normal : Vec3(-normal), foot);
    };
    jaw_inner = jaw(-1.0, b.jaw_angle_inner_deg);
    jaw_outer = jaw(1.0, b.jaw_angle_outer_deg);
    const double draft = std::tan(rad_from_deg(10.0));
    outer_faces[0] = half_space(Vec3(1.0, 0.0, draft), Vec3(b.end_half_mm, 0.0, 0.0));
    outer_faces[1] = half_space(Vec3(-1.0, 0.0, draft), Vec3(-b.end_half_mm, 0.0, 0.0));
    outer_faces[2] = half_space(Vec3(0.0, 1.0, draft), Vec3(0.0, 240.0, 0.0));
    outer_faces[3] = half_space(Vec3(0.0, -1.0, draft), Vec3(0.0, -240.0, 0.0));
    top = half_space(Vec3::UnitZ(), Vec3(0.0, 0.0, -30.0));
    shoulder_outer = half_space(Vec3::UnitZ(), Vec3(0.0, 0.0, 29.75));
    shoulder_inner = half_space(Vec3::UnitZ(), Vec3(0.0, 0.0, 20.25));
  }

  /// Distance along the ray to the first surface, and the face's normal there; false without a return.
  [[nodiscard]] bool hit(const Vec3& from, const Vec3& along, double& distance, Vec3& normal) const {
    const double to_top = top.entry(from, along);
    double to_block = 1e9;
    double out_of_block = 1e9;
    bool on_seat = false;
    normal = top.n;
    Vec3 block_normal = n;
    if (block.present) {
      const double to_seat = seat.entry(from, along);
      // A slanting ray that reaches a jaw from behind never enters through it.
      const auto entry = [&](const HalfSpace& h) { return h.n.dot(along) < 0.0 ? h.entry(from, along) : 1e9; };
      const double to_jaw = std::min(entry(jaw_inner), entry(jaw_outer));
      to_block = std::min(to_seat, to_jaw);
      on_seat = to_seat < to_jaw;
      if (!on_seat) block_normal = entry(jaw_inner) < entry(jaw_outer) ? jaw_inner.n : jaw_outer.n;
      const bool outer = (from + to_seat * along).y() > 0.0;
      const auto cut = [&](const HalfSpace& h) {
        const double e = h.entry(from, along);
        if (h.n.dot(along) > 0.0) {
          // A slanting ray leaves the block through a face that it reaches from behind.
          out_of_block = std::min(out_of_block, e);
        } else if (e > to_block) {
          to_block = e;
          on_seat = false;
          block_normal = h.n;
        }
      };
      cut(outer ? shoulder_outer : shoulder_inner);
      for (const HalfSpace& h : outer_faces) cut(h);
    }
    if (to_top < to_block || out_of_block < to_block) {
      distance = to_top;
      return block.slab_top_seen;
    }
    distance = to_block;
    normal = block_normal;
    return !on_seat || shape_seat(from, along, distance);
  }

  /// Applies casings, wave, bump and relief.
  [[nodiscard]] bool shape_seat(const Vec3& from, const Vec3& along, double& distance) const {
    const Vec3 p = from + distance * along;
    const double s = t.dot(p);
    if (is_within(22.0, p.x(), std::abs(s) - 0.5 * block.casing_spacing_mm)) {
      const HalfSpace& rim = s > 0.0 ? rim_outer : rim_inner;
      distance = rim.entry(from, along);
      const Vec3 q = from + distance * along;
      return !is_within(15.0, q.x(), std::abs(t.dot(q)) - 0.5 * block.casing_spacing_mm);
    }
    double height = block.wave_mm == 0.0 ? 0.0 : block.wave_mm * std::cos(2.0 * kPi * s / 75.0);
    if (is_within(block.bump_radius_mm, p.x() - block.bump_x_mm, s - block.bump_s_mm)) height += block.bump_mm;
    if (block.relief_mm) height += block.relief_mm(p.x(), s);
    distance += height / n.dot(along);
    return true;
  }

  const Block& block;
  Vec3 t;
  Vec3 n;
  HalfSpace seat{}, rim_inner{}, rim_outer{}, jaw_inner{}, jaw_outer{}, top{}, shoulder_outer{}, shoulder_inner{};
  HalfSpace outer_faces[4]{};
};

}  // namespace

Pose displaced(double x, double y, double z, double rx_deg, double ry_deg, double rz_deg) {
  Pose pose;
  pose.translation_mm = Vec3(x, y, z);
  const Vec3 turn(rad_from_deg(rx_deg), rad_from_deg(ry_deg), rad_from_deg(rz_deg));
  const double angle = turn.norm();
  if (angle > 0.0) pose.rotation = Quat(Eigen::AngleAxisd(angle, Eigen::Vector3d(turn / angle)));
  return pose;
}

Cloud take(const Block& block, const Scan& scan) {
  Cloud cloud;
  // The displaced block as seen by the nominal scanner.
  cloud.T_block_scanner = scan.displacement.inverse() * nominal_T_block_scanner();
  const Solid solid(block);
  const auto columns = static_cast<std::size_t>(scan.field_x_mm / scan.pitch_mm);
  const auto rows = static_cast<std::size_t>(scan.field_y_mm / (scan.pitch_mm * scan.pitch_ratio));
  if (scan.organised) {
    cloud.width = columns;
    cloud.height = rows;
  }
  cloud.xyz.reserve(3 * columns * rows);
  const bool perspective = scan.focus_mm > 0.0;
  const Vec3 parallel = cloud.T_block_scanner.rotation * Vec3(Vec3::UnitZ());
  Prng prng(scan.seed);
  double clump_off = 0.0;
  int clump_left = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      const double x = (static_cast<double>(column) + 0.5) * scan.pitch_mm - 0.5 * scan.field_x_mm;
      const double y = (static_cast<double>(row) + 0.5) * scan.pitch_mm * scan.pitch_ratio - 0.5 * scan.field_y_mm;
      const Vec3 from = perspective ? Vec3(Vec3::Zero()) : Vec3(x, y, 0.0);
      const Vec3 along = perspective ? Vec3(Vec3(x, y, scan.focus_mm).normalized()) : Vec3(Vec3::UnitZ());
      double distance = 0.0;
      Vec3 normal = Vec3::UnitZ();
      const Vec3 along_in_block = perspective ? Vec3(cloud.T_block_scanner.rotation * along) : parallel;
      bool seen = solid.hit(cloud.T_block_scanner * from, along_in_block, distance, normal);
      seen = prng.uniform() >= scan.missing_share && seen;
      if (seen) {
        double noise = scan.noise_mm * prng.normal();
        if (scan.tail_share > 0.0 && prng.uniform() < scan.tail_share) noise *= 5.0;
        distance += noise;
        bool outlier = prng.uniform() < scan.outlier_share;
        if (clump_left > 0) {
          outlier = true;
          --clump_left;
        } else if (outlier) {
          clump_off = scan.outlier_near_mm + (scan.outlier_far_mm - scan.outlier_near_mm) * prng.uniform();
          if (prng.uniform() >= 0.5) clump_off = -clump_off;
          if (scan.outlier_clump > 1)
            clump_left = 1 + static_cast<int>(prng.below(static_cast<std::uint64_t>(scan.outlier_clump - 1)));
        }
        if (outlier) distance += clump_off;
        const Vec3 p = from + distance * along;
        cloud.outlier.push_back(outlier);
        if (scan.incidence)
          cloud.incidence_deg.push_back(static_cast<float>(deg_from_rad(angle_between_rad(-along_in_block, normal))));
        cloud.xyz.insert(cloud.xyz.end(),
                         {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())});
      } else if (scan.organised) {
        const float nan = std::numeric_limits<float>::quiet_NaN();
        cloud.xyz.insert(cloud.xyz.end(), {nan, nan, nan});
        cloud.outlier.push_back(false);
        if (scan.incidence) cloud.incidence_deg.push_back(nan);
      }
    }
  }
  return cloud;
}

Recipe p5600() {
  Recipe r;
  r.name = "P5600";
  r.slab_type = 1;
  const auto nominal = [](double value) { return Nominal{value, true}; };
  r.block = {.cant_ratio = nominal(40.0),
             .jaw_half_distance_mm = nominal(190.0),
             .jaw_reference_height_mm = nominal(10.0),
             .jaw_angle_rad = nominal(rad_from_deg(110.0)),
             .shoulder_outer_z_mm = nominal(29.75),
             .shoulder_inner_z_mm = nominal(20.25),
             .end_half_length_mm = nominal(105.0),
             .side_half_width_mm = nominal(240.0),
             .draft_rad = nominal(rad_from_deg(10.0)),
             .slab_top_z_mm = nominal(-30.0),
             .casing_half_spacing_mm = nominal(116.5),
             .casing_bore_diameter_mm = nominal(30.0),
             .casing_rim_diameter_mm = nominal(44.0),
             .casing_rim_height_mm = nominal(-0.25)};
  r.slab = {.length_mm = nominal(5600.0),
            .width_mm = nominal(2500.0),
            .thickness_mm = nominal(200.0),
            .pairs = 9,
            .pitch_mm = nominal(630.0),
            .first_pair_from_end_mm = nominal(280.0),
            .seat_centre_distance_mm = nominal(1516.0),
            .block_origin_z_mm = nominal(30.0)};
  r.evaluation = {.crop_half_x_mm = 51.0,
                  .crop_half_s_mm = 75.0,
                  .cell_mm = 1.5,
                  .cell_points_min = 12,
                  .cells_missing_max = 0.05,
                  .edge_margin_mm = 2.0,
                  .inlier_share_min = 0.8,
                  .registration_gate_mm = 3.0,
                  .registration_share_min = 0.7,
                  .window_mm = 60.0,
                  .window_rad = rad_from_deg(10.0)};
  r.slope_datum = SlopeDatum::slab_frame;
  r.remove_warp = true;
  r.guard = 1.0;
  const auto set = [&](ItemId id, double value, double lower, double upper, double U, bool required = true) {
    Tolerance& t = r.tolerances[static_cast<std::size_t>(id)];
    t.nominal = nominal(value);
    t.lower = lower;
    t.upper = upper;
    t.U = U;
    t.required = required;
    t.confirmed = true;
  };
  const auto slope = [](double ratio) { return deg_from_rad(std::atan(1.0 / ratio)); };
  set(ItemId::seat_slope, slope(40.0), slope(43.0), slope(37.0), 0.03);
  set(ItemId::seat_flatness, 0.0, kNoValue, 1.0, 0.05);
  set(ItemId::jaw_angle_inner, 110.0, 109.0, 111.0, 0.05);
  set(ItemId::jaw_angle_outer, 110.0, 109.0, 111.0, 0.05);
  set(ItemId::jaw_distance, 380.0, 379.5, 380.5, 0.15);
  set(ItemId::casing_spacing, 233.0, 232.5, 233.5, 0.15);
  set(ItemId::casing_protrusion_inner, -0.25, -0.5, 0.0, 0.05);
  set(ItemId::casing_protrusion_outer, -0.25, -0.5, 0.0, 0.05);
  set(ItemId::casing_skew_inner, 0.0, kNoValue, 2.0, 0.15, false);
  set(ItemId::casing_skew_outer, 0.0, kNoValue, 2.0, 0.15, false);
  set(ItemId::seat_lateral, 0.0, -0.5, 0.5, 0.15);
  set(ItemId::seat_vertical, 0.0, -0.5, 0.5, 0.15);
  set(ItemId::seat_spacing, 630.0, 629.0, 631.0, 0.15);
  set(ItemId::large_jaw_distance, 1895.38, 1894.38, 1896.38, 0.15);
  set(ItemId::corner_level, 0.0, -1.0, 1.0, 0.15);
  set(ItemId::warp_left, 0.0, -3.0, 3.0, 0.15);
  set(ItemId::warp_right, 0.0, -3.0, 3.0, 0.15);
  r.tolerances[static_cast<std::size_t>(ItemId::seat_std)].nominal = nominal(0.0);
  return r;
}

}  // namespace slabd::scene
