// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/base.h"
#include "cli/simulate/calibration_scene.h"
#include "hal/hal.h"

/// Robot and scanner before a calibration target, as peers of a running daemon: the robot drives from view to view and
/// publishes where it says it stands, the scanner answers the daemon's requests with what it sees from where the robot
/// really stands.
namespace slabd::simulate {

struct CalibrationLiveOrder {
  CalibrationTraits scene;
  CalibrationScanTraits scan;
  std::string config;   ///< the daemon's
  std::string recipe;   ///< for the reference block
  std::string out_dir;  ///< empty, or where certificate.txt, flange.txt (the views) and truth.json are written
  int views = 24;
  int shots = 3;            ///< scans at every view; then the robot goes on
  std::string poses_file;   ///< not empty: the views, one T_base_flange a line in the neutral form
  std::string follow_file;  ///< not empty: the robot goes to the last line of this file whenever it changes
  double move_s = 0.5;
  double rate_hz = 125.0;
  bool keep_flange = false;  ///< T_flange_scanner was given; else it is the configuration's
  bool keep_target = false;  ///< T_base_target was given; else it stands over the middle of the configured slab
};

/// Runs until it is interrupted (Ctrl-C); returns the exit status. Says on stderr which view the robot stands at.
[[nodiscard]] int run_calibration_live(CalibrationLiveOrder order);

}  // namespace slabd::simulate
