// SPDX-License-Identifier: Apache-2.0
#include "cli/simulate/simulate_arms.h"

#include <fmt/core.h>

#include <charconv>

#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"

namespace slabd::cli::simulate {
namespace {

/// Pose of the scanner of an arm on its flange: the calibration in force, otherwise the commissioning value.
Pose scanner_in_force(const config::Config& config, const CellCalibration& cell, std::size_t arm) {
  const LineCalibration& in_force = cell.arm[arm];
  if (in_force.source == LineCalibration::Source::applied) return in_force.hand_eye.T_flange_scanner;
  const calib::Calibration& commissioning = config.arm(arm).calibration;
  if (commissioning.id.empty())
    stop(kBadInput,
         arm == 0 ? fmt::format("{}: neither a calibration is in force nor is there a [calibration] T_flange_scanner; "
                                "the emulated scanner has no place on the flange",
                                config.path)
                  : fmt::format("{}: neither a calibration of scanner {} is in force nor is there a [[scanner]] "
                                "T_flange_scanner; the emulated scanner has no place on the flange",
                                config.path, config.arms.list[arm].scanner.view()));
  return commissioning.T_flange_scanner;
}

/// The calibrations that the daemon would use now; none in a new installation.
std::unique_ptr<CellCalibration> cell_calibration(const config::Config& config) {
  const std::unique_ptr<storage::Reader> reader = open_records(config);
  if (reader == nullptr) return std::make_unique<CellCalibration>();
  return need(reader->cell_calibration(config.arms));
}

}  // namespace

emulator::Cell cell_in_force(const config::Config& config, const TieError& error, std::uint64_t seed) {
  const std::unique_ptr<CellCalibration> in_force = cell_calibration(config);
  emulator::Cell cell{config.T_base_slab, scanner_in_force(config, *in_force, 0)};
  for (std::size_t arm = 1; arm < config.arms.list.size(); ++arm) {
    const TieNumbers& tie = in_force->tie.numbers;
    if (in_force->tie.id.empty() || tie.robot != config.arms.list[arm].robot)
      stop(kBadInput, fmt::format("{}: robot {} is not tied to the first one, so the emulated robot has no place; "
                                  "slabctl calibrate tie",
                                  config.path, config.arms.list[arm].robot.view()));
    cell.further.push_back({tie.T_base_robot,
                            emulator::moved_base(tie.T_base_robot, tie.centre_mm, error.mm, error.deg, seed),
                            scanner_in_force(config, *in_force, arm)});
  }
  return cell;
}

std::vector<Pose> scanners_in_force(const config::Config& config) {
  const std::unique_ptr<CellCalibration> in_force = cell_calibration(config);
  std::vector<Pose> scanners;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm)
    scanners.push_back(scanner_in_force(config, *in_force, arm));
  return scanners;
}

Result<emulator::ScannerFailure> parse_failure(const std::string& text, const LineArms& arms, int stations) {
  emulator::ScannerFailure failure;
  if (text.empty()) return failure;
  const std::size_t at = text.rfind('@');
  const std::string id = text.substr(0, at);
  while (failure.arm < arms.list.size() && arms.list[failure.arm].scanner.view() != id) ++failure.arm;
  if (at != std::string::npos) {
    const char* const end = text.data() + text.size();
    const auto [rest, fault] = std::from_chars(text.data() + at + 1, end, failure.station);
    if (fault != std::errc{} || rest != end) failure.station = 0;
  }
  if (failure.arm < arms.list.size() && failure.station >= 1 && failure.station <= stations) return failure;
  std::string ids;
  for (const Arm& arm : arms.list) ids += fmt::format("{}{}", ids.empty() ? "" : ", ", arm.scanner.view());
  return slabd::error(Code::config, "--fail-scanner %s: ID@STATION, with the id of a scanner (%s) and a station 1..%d",
                      text.c_str(), ids.c_str(), stations);
}

}  // namespace slabd::cli::simulate
