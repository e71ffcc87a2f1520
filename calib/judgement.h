// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "calib/hand_eye.h"

/// Which figures forbid the use of a hand-eye calibration, and what to tell people. Internal to the room.
namespace slabd::calib {

/// What the figures alone do not show.
struct Circumstances {
  ArtefactKind kind{};
  std::span<const View> views;
  StatedNoise noise;
  bool converged = false;
  std::size_t places = 0;  ///< different flange poses among the views kept
  std::string weakest;     ///< the direction that is determined worst, in words
  double median_flange_mm = kNoValue;
  double median_target_mm = kNoValue;
  DeclaredFormats declared;
  SameTarget same_target;
  double scale_off_max = kScaleOffMax;
};

/// Whether the figures so far give reason to doubt that the poses mean what was stated.
[[nodiscard]] bool needs_convention_test(const HandEye& result);

/// Fills `reasons`, `warnings` and `ok` from the figures of `result`.
void judge(const Circumstances& circumstances, HandEye& result);

}  // namespace slabd::calib
