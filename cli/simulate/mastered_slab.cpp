// SPDX-License-Identifier: Apache-2.0
//
// Seat points as from scans, without drawing ninety of them. The error of registration and plane fit with five million
// points is known (a few micrometres); the rest of a visit is the real pose of the robot.
#include "cli/simulate/mastered_slab.h"

#include <fmt/core.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "cli/command.h"
#include "cli/exit.h"
#include "emulator/slab_scene.h"
#include "report/json.h"

namespace slabd::cli::simulate {
namespace {

namespace fs = std::filesystem;

/// Standard deviation of a seat's reference point in one scan.
constexpr double kPointSigma_mm = 0.003;
/// Distance of the second and third point of a visit from the first (calib::seat_visit).
constexpr double kSeatArm_mm = 100.0;
constexpr std::uint64_t kVisitStream = 24;

calib::StationVisit visit_of(const emulator::SlabTruth& slab, const emulator::Cell& cell, int station, int round,
                             std::uint64_t seed) {
  const emulator::StationTruth& truth = slab.at(station);
  const double c = std::cos(truth.block.slope_rad);
  const double s = std::sin(truth.block.slope_rad);
  const Pose T_seen = emulator::T_scanner_block(slab, cell, station);
  Prng random(emulator::derived_seed(seed, kVisitStream + static_cast<std::uint64_t>(round) * 100U,
                                     static_cast<std::uint64_t>(station)));
  Vec3 off;
  for (int axis = 0; axis < 3; ++axis) off[axis] = kPointSigma_mm * random.normal();
  calib::StationVisit visit;
  visit.station = station;
  visit.round = fmt::format("round {}", round);
  visit.T_base_flange = truth.T_base_flange_reported;
  for (const Vec3& p : {Vec3(0.0, 0.0, 0.0), Vec3(0.0, -s, c), Vec3(0.0, c, s)})
    visit.points_mm.push_back(T_seen * Vec3(kSeatArm_mm * p) + off);
  return visit;
}

}  // namespace

calib::MasterCertificate master_certificate(const Recipe& recipe, const emulator::SlabTruth& slab, double sigma_mm) {
  calib::MasterCertificate certificate;
  certificate.id = "simulated-master";
  certificate.date = "2026-01-01";
  certificate.issuer = "slabctl simulate";
  certificate.slab_type = recipe.slab_type;
  certificate.sigma_mm = sigma_mm;
  for (int k = 1; k <= slab.stations; ++k) {
    const emulator::StationTruth& station = slab.at(k);
    if (!station.block.present) continue;
    const double c = std::cos(station.block.slope_rad);
    const double s = std::sin(station.block.slope_rad);
    const Quat& turn = station.T_slab_block.rotation;
    certificate.stations.push_back(
        calib::master_seat(k, station.T_slab_block.translation_mm, turn * Vec3(0.0, -s, c), turn * Vec3(0.0, c, s)));
  }
  return certificate;
}

int write_mastered_slab(const CalibrationOrder& order) {
  const Recipe recipe = cli::recipe_from(order.recipe);
  std::error_code fault;
  const fs::path dir = order.out_dir;
  fs::create_directories(dir, fault);
  if (fault || !fs::is_empty(dir, fault))
    cli::stop(cli::kUsage, fmt::format("--out {}: cannot be made, or is not empty; name a new folder", order.out_dir));
  const emulator::RobotErrorTraits robot = emulator::RobotError(order.scene.robot).traits();
  const emulator::Cell cell{order.scene.T_base_target, order.scene.T_flange_scanner};
  emulator::SlabVariation variation;
  variation.seed = order.scene.seed;
  variation.same_slab = true;
  variation.robot_mm = robot.smooth_mm;
  variation.robot_length_mm = robot.smooth_length_mm;
  variation.robot_sigma_mm = robot.repeat_mm;
  variation.robot_sigma_deg = deg_from_rad(robot.repeat_rad);

  std::vector<calib::StationVisit> visits;
  report::Json json("slabd.calibration_truth/1");
  json.field("kind", "slab").field("seed", variation.seed).field("T_flange_scanner", cell.T_flange_scanner);
  json.key("views").begin_array();
  for (int round = 1; round <= order.views; ++round) {
    variation.slab_no = static_cast<std::uint32_t>(round);
    const emulator::SlabTruth slab = cli::need(emulator::cast_slab(recipe, cell, variation, {}), cli::kUsage);
    if (round == 1)
      write_text(dir / "certificate.txt", calib::master_certificate_text(master_certificate(recipe, slab)));
    for (int k = 1; k <= slab.stations; ++k) {
      visits.push_back(visit_of(slab, cell, k, round, variation.seed));
      json.begin_object().field("station", k).field("round", round);
      json.field("T_base_flange_reported", slab.at(k).T_base_flange_reported);
      json.field("T_base_flange_real", slab.at(k).T_base_flange_real).end_object();
    }
  }
  write_text(dir / "visits.txt", calib::visits_text(visits));
  write_text(dir / "truth.json", json.text());
  fmt::print("{}: {} rounds over {} stations in visits.txt, certificate.txt, truth.json\n", order.out_dir, order.views,
             recipe.stations());
  return cli::kDone;
}

}  // namespace slabd::cli::simulate
