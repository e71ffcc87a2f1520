// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/base.h"
#include "cli/client/scanner_choice.h"
#include "cli/simulate/calibration_scene.h"
#include "emulator/warming.h"
#include "hal/hal.h"

/// Robot and scanner with a calibration target, as peers of a running daemon. The robot moves from view to view and
/// publishes its reported pose; the scanner answers the daemon's requests with scans from the real pose.
namespace slabd::cli::simulate {

struct CalibrationLiveOrder {
  CalibrationTraits scene;
  CalibrationScanTraits scan;
  std::string config;     ///< the daemon's configuration
  ScannerChoice scanner;  ///< robot and scanner of this arm; poses are in the base of its own robot
  std::string recipe;     ///< for the reference block
  std::string out_dir;    ///< folder for certificate.txt, flange.txt (the views) and truth.json; may be empty
  int views = 24;
  int shots = 3;            ///< scans per view before the robot moves on
  std::string poses_file;   ///< if given: the views, one T_base_flange a line in slabd's own form
  std::string follow_file;  ///< if given: the robot moves to the last line of this file whenever it changes
  double move_s = 0.5;
  double rate_hz = 125.0;
  emulator::Warming warming;  ///< of the scanner, from the start of the run
  bool keep_flange = false;   ///< T_flange_scanner was given; otherwise it is the configuration's
  bool keep_target = false;   ///< T_base_target was given; otherwise it is over the centre of the configured slab
};

/// Runs until it is interrupted (Ctrl-C); returns the exit status. Prints the current view to stderr.
[[nodiscard]] int run_calibration_live(CalibrationLiveOrder order);

}  // namespace slabd::cli::simulate
