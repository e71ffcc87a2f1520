// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/base.h"
#include "config/config.h"
#include "emulator/line_run.h"

/// Robots and scanners of the emulated line, from the configuration and the calibrations in force.
namespace slabd::cli::simulate {

/// Distance of the second robot's base from its tied place: a random motion of this size.
struct TieError {
  double mm = 0.0;
  double deg = 0.0;
};

/// The cell as the daemon assumes it: each scanner is where its calibration in force has it, and each further robot is
/// where the tie in force has it, apart from `error`. Stops the command if a calibration or the tie is missing.
[[nodiscard]] emulator::Cell cell_in_force(const config::Config& config, const TieError& error, std::uint64_t seed);

/// Pose of the scanner of each arm on its flange: its calibration in force, otherwise the commissioning value. Stops
/// the command if a scanner has neither.
[[nodiscard]] std::vector<Pose> scanners_in_force(const config::Config& config);

/// Parses "ID@STATION" of --fail-scanner. Code::config if no scanner has this id, or the slab has no such station.
[[nodiscard]] Result<emulator::ScannerFailure> parse_failure(const std::string& text, const LineArms& arms,
                                                             int stations);

/// The peers of every arm.
struct Arms {
  std::vector<std::unique_ptr<emulator::RobotPeer>> robots;
  std::vector<std::unique_ptr<emulator::ScannerPeer>> scanners;
  std::vector<emulator::ArmPeers> peers;  ///< as in LineArms::list

  void add(std::unique_ptr<emulator::RobotPeer> robot, std::unique_ptr<emulator::ScannerPeer> scanner) {
    peers.push_back({robot.get(), scanner.get()});
    robots.push_back(std::move(robot));
    scanners.push_back(std::move(scanner));
  }
};

}  // namespace slabd::cli::simulate
