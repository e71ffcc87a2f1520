// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "base/base.h"
#include "calib/ball/artefact.h"
#include "calib/ball/ball.h"
#include "calib/conventions.h"
#include "calib/coverage.h"
#include "calib/hand_eye.h"
#include "calib/observations.h"
#include "calib/reference.h"
#include "calib/session.h"
#include "calib/stations.h"

/// Where the scanner sits on the flange, and how well that is known: found from views of an artefact (hand_eye.h),
/// corrected station by station (stations.h), watched over by artefacts (reference.h). Until a calibration is applied,
/// the commissioning values of the configuration count.
namespace slabd::calib {

struct Calibration {
  Pose T_flange_scanner;
  double station_sigma_mm = kNoValue;  ///< per axis, k = 1; NaN = unknown
  double station_sigma_rad = kNoValue;
  bool commissioning = true;  ///< from the configuration, not from an applied calibration
  FixedString<64> id;         ///< identifies these very numbers in every record
};

/// Takes x y z (mm) qw qx qy qz and the station sigmas as written. calibration_missing when a number is not finite,
/// the quaternion is not of unit length within 1e-3, the arm is longer than 2 m, or a sigma is not positive.
[[nodiscard]] Result<Calibration> commissioning(const std::array<double, 7>& T_flange_scanner, double station_sigma_mm,
                                                double station_sigma_deg);

/// Splicing, paper 2.3.2 with lambda = 1: where the scanner stood in the robot's base frame.
[[nodiscard]] inline Pose splice(const Calibration& calibration, const Pose& T_base_flange) {
  return T_base_flange * calibration.T_flange_scanner;
}

}  // namespace slabd::calib
