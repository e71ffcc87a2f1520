// SPDX-License-Identifier: Apache-2.0
#include "emulator/slab_scene.h"

#include "base/dither.h"

namespace slabd::emulator {
namespace {

// Scatter of a good casting: about a quarter of the tolerances, so that a slab without planted defects passes with
// guard bands although its blocks differ.
constexpr double kScatterSlope_deg = 0.008;
constexpr double kScatterJawAngle_deg = 0.1;
constexpr double kScatterJawDistance_mm = 0.08;
constexpr double kScatterCasingSpacing_mm = 0.08;
constexpr double kScatterProtrusion_mm = 0.04;
constexpr double kScatterPlace_mm = 0.05;

/// Distance of a robot beside the slab from its last stop, outwards; much more than the daemon's look test allows.
constexpr double kAside_mm = 1200.0;

/// The robot's error repeats from slab to slab and differs little between neighbours: one wave over the cell per axis.
constexpr double kRobotWave_mm = 4000.0;
/// A flange with a position error e is rotated by about e over the arm's last metre.
constexpr double kRobotLever_mm = 1000.0;

double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}

BlockTruth cast_block(const Recipe& recipe, Prng& random, double casting) {
  BlockTruth block = nominal_truth(recipe);
  block.slope_rad += rad_from_deg(within(random, casting * kScatterSlope_deg));
  block.jaw_angle_inner_rad += rad_from_deg(within(random, casting * kScatterJawAngle_deg));
  block.jaw_angle_outer_rad += rad_from_deg(within(random, casting * kScatterJawAngle_deg));
  block.jaw_distance_mm += within(random, casting * kScatterJawDistance_mm);
  block.casing_spacing_mm += within(random, casting * kScatterCasingSpacing_mm);
  block.protrusion_inner_mm += within(random, casting * kScatterProtrusion_mm);
  block.protrusion_outer_mm += within(random, casting * kScatterProtrusion_mm);
  return block;
}

Pose place_slab(const Pose& nominal, const SlabVariation& v) {
  Prng random(derived_seed(v.seed, 1, v.same_slab ? 0 : v.slab_no));
  Pose shift;
  shift.translation_mm =
      Vec3(within(random, v.placement_mm), within(random, v.placement_mm), within(random, 0.5 * v.placement_mm));
  const double turn = rad_from_deg(v.placement_deg);
  shift.rotation = rotation_from_kuka_abc(within(random, turn), within(random, turn / 3.0), within(random, turn / 3.0));
  return nominal * shift;
}

/// Real flange pose for a reported one; a smooth function of the position, the same for every slab.
Pose robot_error(const Pose& T_base_flange, const SlabVariation& v) {
  if (v.robot_length_mm > 0.0) {
    RobotErrorTraits traits;
    traits.seed = derived_seed(v.seed, 3, 0);
    traits.smooth_mm = v.robot_mm;
    traits.smooth_length_mm = v.robot_length_mm;
    return RobotError(traits).real_mean(T_base_flange);
  }
  Prng random(derived_seed(v.seed, 2, 0));
  Pose off;
  Vec3 turn;
  for (int axis = 0; axis < 3; ++axis) {
    const double phase_x = 2.0 * kPi * random.uniform();
    const double phase_y = 2.0 * kPi * random.uniform();
    const Vec3& p = T_base_flange.translation_mm;
    const double wave =
        std::sin(2.0 * kPi * p.x() / kRobotWave_mm + phase_x) * std::cos(2.0 * kPi * p.y() / kRobotWave_mm + phase_y);
    off.translation_mm[axis] = v.robot_mm * wave;
    turn[axis] = v.robot_mm / kRobotLever_mm * std::sin(2.0 * kPi * p.x() / kRobotWave_mm + phase_y);
  }
  off.rotation = rotation_from_kuka_abc(turn.z(), turn.y(), turn.x());
  Pose real;
  real.translation_mm = T_base_flange.translation_mm + off.translation_mm;
  real.rotation = (off.rotation * T_base_flange.rotation).normalized();
  return real;
}

/// Adds the robot's repeatability error to a pose.
Pose robot_repeats(const Pose& T_base_flange, const SlabVariation& v, int station) {
  if (v.robot_sigma_mm == 0.0 && v.robot_sigma_deg == 0.0) return T_base_flange;
  Prng random(derived_seed(v.seed, 3000U + static_cast<std::uint64_t>(station), v.slab_no));
  Pose real = T_base_flange;
  Vec3 turn;
  for (int axis = 0; axis < 3; ++axis) real.translation_mm[axis] += v.robot_sigma_mm * random.normal();
  for (int axis = 0; axis < 3; ++axis) turn[axis] = rad_from_deg(v.robot_sigma_deg) * random.normal();
  real.rotation = (rotation_from_kuka_abc(turn.z(), turn.y(), turn.x()) * real.rotation).normalized();
  return real;
}

/// Vertical displacement of a block by a defect of the whole slab. `along` is the block's position along the slab,
/// -1..1.
double lifted_mm(const Defect& defect, bool left_row, double along) {
  const double bent = defect.value * (1.0 - along * along);
  if (defect.kind == DefectKind::warp_left) return left_row ? bent : 0.0;
  if (defect.kind == DefectKind::warp_right) return left_row ? 0.0 : bent;
  if (defect.kind == DefectKind::corner_level) return 0.25 * defect.value * (left_row ? -along : along);
  return 0.0;
}

/// The stops of the robots after the first. Each has an error of its own, so its stream has another seed.
void plan_further(const Cell& cell, const SlabVariation& variation, const Pose& T_block_scanner, const Recipe& recipe,
                  int k, double reported_above_mm, StationTruth& station) {
  for (std::size_t i = 0; i < cell.further.size() && i < station.further.size(); ++i) {
    const FurtherArm& arm = cell.further[i];
    SlabVariation own = variation;
    own.seed = derived_seed(variation.seed, 4, i + 1);
    const Pose T_robot_base = arm.T_base_robot.inverse();
    const Pose planned =
        T_robot_base * cell.T_base_slab * T_slab_block(recipe, k) * T_block_scanner * arm.T_flange_scanner.inverse();
    Stop& stop = station.further[i];
    stop.T_base_flange_reported = planned;
    stop.T_base_flange_reported.translation_mm +=
        T_robot_base.rotation * (cell.T_base_slab.rotation * Vec3(0.0, 0.0, reported_above_mm));
    stop.T_base_flange_real = robot_repeats(robot_error(planned, own), own, k);
  }
}

/// A place beside the first stop of each robot's usual side; `outwards`: +1 for the row Y > 0.
Pose beside(const Pose& T_base_flange, const Quat& base_from_slab, double outwards) {
  Pose aside = T_base_flange;
  aside.translation_mm += base_from_slab * Vec3(0.0, outwards * kAside_mm, 0.0);
  return aside;
}

void plant(const Defect& defect, StationTruth& station, double& reported_above_mm) {
  BlockTruth& block = station.block;
  switch (defect.kind) {
    case DefectKind::slope: block.slope_rad = std::atan(1.0 / defect.value); break;
    case DefectKind::jaw_angle_inner: block.jaw_angle_inner_rad += rad_from_deg(defect.value); break;
    case DefectKind::jaw_angle_outer: block.jaw_angle_outer_rad += rad_from_deg(defect.value); break;
    case DefectKind::jaw_distance: block.jaw_distance_mm += defect.value; break;
    case DefectKind::protrusion_inner: block.protrusion_inner_mm += defect.value; break;
    case DefectKind::protrusion_outer: block.protrusion_outer_mm += defect.value; break;
    case DefectKind::casing_spacing: block.casing_spacing_mm += defect.value; break;
    case DefectKind::bump: block.bump_mm += defect.value; break;
    case DefectKind::chip: block.chip_mm += defect.value; break;
    case DefectKind::burr: block.burr_mm += defect.value; break;
    case DefectKind::sunk_seat: block.sunk_mm += defect.value; break;
    case DefectKind::broken_corner: block.corner_mm += defect.value; break;
    case DefectKind::glove: block.glove_s_mm = defect.value; break;
    case DefectKind::cable: block.cable_x_mm = defect.value; break;
    case DefectKind::large_jaw: block.jaw_shift_mm += defect.value; break;
    case DefectKind::missing: block.present = false; break;
    case DefectKind::outliers: station.outlier_share = defect.value; break;
    case DefectKind::noise: station.noise_mm = defect.value; break;
    case DefectKind::robot: reported_above_mm += defect.value; break;
    case DefectKind::along: station.offset_slab_mm.x() += defect.value; break;
    case DefectKind::lateral: station.offset_slab_mm.y() += defect.value; break;
    case DefectKind::vertical: station.offset_slab_mm.z() += defect.value; break;
    case DefectKind::corner_level:
    case DefectKind::warp_left:
    case DefectKind::warp_right: break;  // defects of the whole slab
  }
}

}  // namespace

std::uint64_t derived_seed(std::uint64_t seed, std::uint64_t a, std::uint64_t b) {
  Prng mixer(seed ^ (a * 0xD6E8FEB86659FD93U) ^ (b * 0xA0761D6478BD642FU));
  mixer.next();
  return mixer.next();
}

Result<SlabTruth> cast_slab(const Recipe& recipe, const Cell& cell, const SlabVariation& variation,
                            std::span<const Defect> defects) {
  for (const Defect& defect : defects) {
    if (defect.station > recipe.stations())
      return error(Code::config, "--defect: block %d, but %s has blocks 1..%d", defect.station, recipe.name.c_str(),
                   int{recipe.stations()});
  }
  SlabTruth slab;
  slab.T_base_slab = place_slab(cell.T_base_slab, variation);
  slab.scan_seed = derived_seed(variation.seed, 2000, variation.slab_no);
  slab.cast_seed = derived_seed(variation.seed, 2001, variation.same_slab ? 0 : variation.slab_no);
  slab.stations = recipe.stations();
  slab.expansion = variation.expansion;
  for (int k = 1; k <= slab.stations; ++k) {
    StationTruth& station = slab.station[static_cast<std::size_t>(k - 1)];
    Prng random(derived_seed(variation.seed, 1000U + static_cast<std::uint64_t>(k),
                             variation.same_slab ? 0 : variation.slab_no));
    station.block = cast_block(recipe, random, variation.casting);
    for (int axis = 0; axis < 3; ++axis)
      station.offset_slab_mm[axis] = within(random, variation.casting * kScatterPlace_mm);
    double reported_above_mm = 0.0;
    double slab_lift_mm = 0.0;
    const double along =
        T_slab_block(recipe, k).translation_mm.x() / T_slab_block(recipe, recipe.slab.pairs).translation_mm.x();
    for (const Defect& defect : defects) {
      if (defect.station == k) plant(defect, station, reported_above_mm);
      if (defect.station == 0) slab_lift_mm += lifted_mm(defect, k <= recipe.slab.pairs, along);
    }
    const SlabGeometry& drawn = recipe.slab;
    const bool left = k <= drawn.pairs;
    const int column = left ? k - 1 : 2 * drawn.pairs - k;
    const double beyond_first = drawn.first_pair_from_end_mm.value;
    const double beyond_last = drawn.length_mm.value - beyond_first - drawn.pitch_mm.value * (drawn.pairs - 1);
    if (column == 0) (left ? station.block.top_end_minus_mm : station.block.top_end_plus_mm) = beyond_first;
    if (column == drawn.pairs - 1)
      (left ? station.block.top_end_plus_mm : station.block.top_end_minus_mm) = beyond_last;

    // The slab's top does not move with a block that is too high, but bends and twists with the slab.
    const SeatDesign& designed = variation.design.at(k);
    station.block.slab_top_shift_mm = -station.offset_slab_mm.z() - designed.offset_mm.z();
    station.block.slope_rad += designed.slope_rad;
    station.offset_slab_mm.z() += slab_lift_mm;

    station.T_slab_block = T_slab_block(recipe, variation.design, k);
    station.T_slab_block.translation_mm += station.offset_slab_mm;

    // The robot was taught on a nominal slab in the nominal position; its poses do not depend on this slab.
    const Pose T_block_scanner = dithered(nominal_T_block_scanner(), k, {variation.dither_mm, variation.dither_deg});
    const Pose taught = cell.taught.empty() ? cell.T_base_slab * T_slab_block(recipe, k) * T_block_scanner *
                                                  cell.T_flange_scanner.inverse()
                                            : cell.taught[static_cast<std::size_t>(k - 1)];
    station.T_base_flange_reported = taught;
    station.T_base_flange_reported.translation_mm += cell.T_base_slab.rotation * Vec3(0.0, 0.0, reported_above_mm);
    station.T_base_flange_real = robot_repeats(robot_error(taught, variation), variation, k);
    plan_further(cell, variation, T_block_scanner, recipe, k, reported_above_mm, station);
  }
  slab.aside[0] = beside(slab.at(1).T_base_flange_reported, cell.T_base_slab.rotation, 1.0);
  for (std::size_t i = 0; i < cell.further.size() && i + 1 < slab.aside.size(); ++i)
    slab.aside[i + 1] = beside(slab.at(slab.stations).stop(i + 1).T_base_flange_reported,
                               cell.further[i].T_base_robot.rotation.conjugate() * cell.T_base_slab.rotation, -1.0);
  return slab;
}

Pose T_scanner_block(const SlabTruth& slab, const Cell& cell, int station, std::size_t arm) {
  const StationTruth& truth = slab.at(station);
  const Pose T_base_scanner = arm == 0 ? truth.T_base_flange_real * cell.T_flange_scanner
                                       : cell.further[arm - 1].T_base_robot_real *
                                             truth.further[arm - 1].T_base_flange_real *
                                             cell.further[arm - 1].T_flange_scanner;
  Pose T_slab_block = truth.T_slab_block;
  T_slab_block.translation_mm *= 1.0 + slab.expansion;
  return T_base_scanner.inverse() * slab.T_base_slab * T_slab_block;
}

Pose moved_base(const Pose& T_base_robot, const Vec3& centre_mm, double mm, double deg, std::uint64_t seed) {
  Prng random(derived_seed(seed, 5, 0));
  const auto direction = [&] {
    Vec3 v;
    for (int axis = 0; axis < 3; ++axis) v[axis] = random.normal();
    return Vec3(v.normalized());
  };
  const Vec3 shift = mm * direction();
  const Quat turn(Eigen::AngleAxisd(rad_from_deg(deg), direction()));
  return {(turn * T_base_robot.rotation).normalized(),
          centre_mm + turn * Vec3(T_base_robot.translation_mm - centre_mm) + shift};
}

double true_value(const Recipe& recipe, const StationTruth& station, ItemId id) {
  const BlockTruth& block = station.block;
  if (id == ItemId::seat_lateral) return station.offset_slab_mm.y();
  if (id == ItemId::seat_vertical) return station.offset_slab_mm.z();
  if (!block.present) return kNoValue;
  switch (id) {
    case ItemId::seat_slope: return deg_from_rad(block.slope_rad);
    case ItemId::seat_flatness:
      return has_value(station.flatness_mm) ? station.flatness_mm : true_flatness_mm(recipe, block);
    case ItemId::jaw_angle_inner: return deg_from_rad(block.jaw_angle_inner_rad);
    case ItemId::jaw_angle_outer: return deg_from_rad(block.jaw_angle_outer_rad);
    case ItemId::jaw_distance: return block.jaw_distance_mm;
    case ItemId::casing_spacing: return block.casing_spacing_mm;
    case ItemId::casing_protrusion_inner: return block.protrusion_inner_mm;
    case ItemId::casing_protrusion_outer: return block.protrusion_outer_mm;
    default: return kNoValue;
  }
}

double true_slab_value(const Recipe& recipe, const SlabTruth& slab, ItemId id, int station) {
  const int pairs = recipe.slab.pairs;
  // A missing block has no position.
  const auto seat = [&](int k) -> Vec3 {
    return slab.at(k).block.present ? slab.at(k).T_slab_block.translation_mm : Vec3::Constant(kNoValue);
  };
  const auto outer_jaw = [&](int k) -> Vec3 {
    const BlockTruth& block = slab.at(k).block;
    if (!block.present) return Vec3::Constant(kNoValue);
    const double s = block.jaw_shift_mm + 0.5 * block.jaw_distance_mm;
    const double h = recipe.block.jaw_reference_height_mm.value;
    const double c = std::cos(block.slope_rad);
    const double n = std::sin(block.slope_rad);
    return slab.at(k).T_slab_block * Vec3(0.0, s * c - h * n, s * n + h * c);
  };
  const auto warp = [&](int first, int last) {
    const Vec3 a = seat(first);
    const Vec3 b = seat(last);
    const auto above_chord = [&](int k) {
      return seat(k).z() - (a.z() + (seat(k).x() - a.x()) / (b.x() - a.x()) * (b.z() - a.z()));
    };
    return 0.5 * (above_chord((first + last) / 2) + above_chord((first + last + 1) / 2));
  };
  switch (id) {
    case ItemId::seat_spacing: return std::abs(seat(station + 1).x() - seat(station).x());
    case ItemId::large_jaw_distance: return (outer_jaw(station) - outer_jaw(opposite_station(recipe, station))).norm();
    case ItemId::corner_level: return seat(1).z() - seat(pairs).z() + seat(pairs + 1).z() - seat(2 * pairs).z();
    case ItemId::warp_left: return warp(1, pairs);
    case ItemId::warp_right: return warp(pairs + 1, 2 * pairs);
    default: return kNoValue;
  }
}

}  // namespace slabd::emulator
