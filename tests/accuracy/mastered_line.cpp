// SPDX-License-Identifier: Apache-2.0
#include "tests/accuracy/mastered_line.h"
#include "cli/simulate/mastered_slab.h"

#include <Eigen/Geometry>
#include <cmath>

namespace slabd::accuracy {
namespace {

constexpr double kArm_mm = 1500.0;

/// rms distance that remains in space after the best rigid motion.
double left_after_fit_mm(const std::vector<Vec3>& seen, const std::vector<Vec3>& true_places) {
  Eigen::Matrix3Xd a(3, static_cast<Eigen::Index>(seen.size()));
  Eigen::Matrix3Xd b = a;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    a.col(static_cast<Eigen::Index>(i)) = seen[i];
    b.col(static_cast<Eigen::Index>(i)) = true_places[i];
  }
  const Eigen::Matrix4d T = Eigen::umeyama(a, b, false);
  const Eigen::Matrix3Xd left = (T.topLeftCorner<3, 3>() * a).colwise() + T.topRightCorner<3, 1>().eval() - b;
  return std::sqrt(left.squaredNorm() / static_cast<double>(seen.size()));
}

}  // namespace

BlockResult features_of(const Recipe& recipe, const emulator::SlabTruth& slab, int k, const Pose& T_base_scanner,
                        Prng& random) {
  const emulator::BlockTruth& truth = slab.at(k).block;
  const double c = std::cos(truth.slope_rad);
  const double s = std::sin(truth.slope_rad);
  const double half = 0.5 * truth.casing_spacing_mm;
  const auto off = [&](double sigma) { return sigma * random.normal(); };
  BlockResult block;
  block.station = static_cast<std::uint8_t>(k);
  block.verdict = Verdict::pass;
  block.registration.status = RegistrationStatus::converged;
  block.registration.T_scanner_block = emulator::T_scanner_block(slab, MasteredLine::cell(), k);
  block.seat.plane.ok = true;
  block.seat.plane.normal = Vec3(off(1e-6), -s + off(1e-6), c).normalized();
  block.seat.noise_factor = 1.0;
  for (const auto& [casing, along] : {std::pair{&block.casing_inner, -half}, std::pair{&block.casing_outer, half}}) {
    casing->ok = true;
    casing->centre = Vec3(off(0.0025), along * c, along * s) + Vec3(0.0, c, s) * off(0.0025);
  }
  const double jaw = truth.jaw_shift_mm + 0.5 * truth.jaw_distance_mm;
  const double height = recipe.block.jaw_reference_height_mm.value;

  SeatObservation& o = block.observation;
  const Pose T_base_block = T_base_scanner * block.registration.T_scanner_block;
  o.ok = o.jaw_ok = o.top_ok = true;
  o.p_base = T_base_block * Vec3(0.5 * (block.casing_inner.centre + block.casing_outer.centre));
  o.n_base = T_base_block.rotation * block.seat.plane.normal;
  o.jaw_outer_base = T_base_block * Vec3(0.0, jaw * c - height * s, jaw * s + height * c);
  o.top_n_base = T_base_block.rotation * Vec3::UnitZ();
  o.sigma_p_mm = Vec3(0.0018, 0.0018, 1e-4);
  o.sigma_jaw_mm = Vec3(0.0018, 1e-4, 1e-4);
  o.sigma_n_rad = Vec3(1e-6, 1e-6, 1e-7);
  o.sigma_top_n_rad = o.sigma_n_rad;
  return block;
}

MasteredLine::MasteredLine(const Recipe& recipe, const LineTraits& traits, Measure measure)
    : recipe_(recipe), traits_(traits), measure_(std::move(measure)) {
  calibration_.source = LineCalibration::Source::applied;
  calibration_.id = "he-of-this-line";
  calibration_.hand_eye.T_flange_scanner = cell().T_flange_scanner * traits.X_error;
  calibration_.hand_eye.sigma_mm = 0.02;
  calibration_.hand_eye.sigma_rad = rad_from_deg(0.002);
}

emulator::Cell MasteredLine::cell() {
  emulator::Cell cell;
  cell.T_base_slab.translation_mm = Vec3(1800.0, 0.0, 300.0);
  cell.T_flange_scanner.translation_mm = Vec3(0.0, 80.0, 150.0);
  return cell;
}

emulator::SlabVariation MasteredLine::variation(std::uint32_t number, bool same_slab) const {
  emulator::SlabVariation v;
  v.seed = traits_.seed;
  v.slab_no = number;
  v.same_slab = same_slab;
  v.robot_mm = traits_.absolute_mm;
  v.robot_length_mm = 500.0;
  v.robot_sigma_mm = traits_.repeat_mm;
  v.robot_sigma_deg = deg_from_rad(traits_.repeat_mm / kArm_mm);
  return v;
}

emulator::SlabTruth MasteredLine::cast(std::uint32_t number, bool same_slab) const {
  const auto slab = emulator::cast_slab(recipe_, cell(), variation(number, same_slab), {});
  return slab.ok() ? slab.value() : emulator::SlabTruth{};
}

bool MasteredLine::master(std::string& why) {
  std::vector<calib::StationVisit> visits;
  calib::MasterCertificate certificate;
  for (int round = 1; round <= traits_.visits; ++round) {
    const emulator::SlabTruth slab = cast(static_cast<std::uint32_t>(round), true);
    if (round == 1) certificate = cli::simulate::master_certificate(recipe_, slab);
    for (int k = 1; k <= slab.stations; ++k) {
      const Pose A = slab.at(k).T_base_flange_reported;
      const BlockResult block = measure_(slab, k, A * calibration_.hand_eye.T_flange_scanner);
      if (const auto visit = calib::seat_visit(block, A, "round " + std::to_string(round))) visits.push_back(*visit);
    }
  }
  calib::StationSettings settings;
  settings.visits_min = static_cast<std::size_t>(traits_.visits);
  const auto solved = calib::solve_stations(certificate, visits, calibration_.hand_eye, settings);
  if (!solved.ok()) {
    why = solved.error().text.view();
    return false;
  }
  solution_ = solved.value();
  if (!solution_.ok) {
    why = solution_.reasons.front().text;
    return false;
  }
  StationsInForce table;
  table.hand_eye_id = calibration_.id;
  table.table = solution_.table;
  return calibration_.tables.push(table);
}

JudgedSlab MasteredLine::judge(std::uint32_t number, bool corrected, emulator::SlabTruth& truth) {
  truth = cast(number, false);
  SpliceSettings settings;
  settings.absolute_mm = traits_.absolute_mm;
  settings.absolute_rad = traits_.absolute_mm / kArm_mm;
  LineCalibration used = calibration_;
  if (!corrected) used.tables.clear();
  JudgedSlab judged;
  std::vector<BlockResult> blocks;
  std::vector<algo::StationSigma> sigmas;
  std::vector<Vec3> seen;
  std::vector<Vec3> places;
  const Pose T_base_slab = cell().T_base_slab;
  for (int k = 1; k <= truth.stations; ++k) {
    const Pose A = truth.at(k).T_base_flange_reported;
    const double lever_mm = (A.translation_mm - (T_base_slab * T_slab_block(recipe_, k)).translation_mm).norm();
    const Splice splice = splice_for(used, settings, recipe_.slab_type, k, A, lever_mm, 0);
    Pose T_base_scanner = A * used.hand_eye.T_flange_scanner;
    if (splice.source == SpliceSource::corrected) T_base_scanner = splice.T_base_reported * T_base_scanner;
    blocks.push_back(measure_(truth, k, T_base_scanner));
    sigmas.push_back({splice.calibration_mm, splice.calibration_rad, splice.robot_mm, splice.robot_rad});
    judged.splices.push_back(splice);
    if (!blocks.back().observation.ok) continue;
    seen.push_back(blocks.back().observation.p_base);
    places.push_back(truth.at(k).T_slab_block.translation_mm);
  }
  algo::inspect_slab(recipe_, blocks, sigmas, T_base_slab, judged.result);
  judged.seats_rms_mm = left_after_fit_mm(seen, places);
  return judged;
}

}  // namespace slabd::accuracy
