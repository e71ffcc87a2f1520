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
#include "calib/tie.h"
#include "calib/warm_up.h"

/// Pose of the scanner on the flange and its uncertainty. It is computed from views of an artefact (hand_eye.h),
/// corrected per station (stations.h), and monitored by artefacts (reference.h). Until a calibration is applied, the
/// commissioning values of the configuration are used.
namespace slabd::calib {

struct Calibration {
  Pose T_flange_scanner;
  double station_sigma_mm = kNoValue;  ///< per axis, k = 1; NaN if unknown
  double station_sigma_rad = kNoValue;
  bool commissioning = true;  ///< from the configuration, not from an applied calibration
  FixedString<64> id;         ///< identifies these numbers in every record
};

/// Creates a calibration from x y z (mm) qw qx qy qz and the station sigmas. calibration_missing: a number is not
/// finite, or the quaternion is not of unit length within 1e-3. Also if the arm is longer than 2 m, or a sigma is not
/// positive.
[[nodiscard]] Result<Calibration> commissioning(const std::array<double, 7>& T_flange_scanner, double station_sigma_mm,
                                                double station_sigma_deg);

/// Splicing, paper 2.3.2 with lambda = 1: pose of the scanner in the robot's base frame.
[[nodiscard]] inline Pose splice(const Calibration& calibration, const Pose& T_base_flange) {
  return T_base_flange * calibration.T_flange_scanner;
}

}  // namespace slabd::calib
