// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "base/base.h"

/// Error of a real robot's reported pose. One part repeats and changes smoothly with the position (geometry of the
/// arm, "absolute accuracy"); the other is new at every visit (repeatability). A white error alone would average out
/// over views, a smooth one does not: calibrations must be tested with both.
namespace slabd::emulator {

struct RobotErrorTraits {
  std::uint64_t seed = 1;
  double smooth_mm = 0.0;           ///< standard deviation per axis over the working volume, 0.7 for a large robot
  double smooth_length_mm = 500.0;  ///< distance of two positions whose errors have the correlation exp(-1/2)
  double smooth_rad = -1.0;         ///< rotation per axis; negative: smooth_mm over an arm of 1.5 m
  double repeat_mm = 0.0;           ///< standard deviation per axis; ISO 9283 RP of 0.06 mm is 0.017
  double repeat_rad = -1.0;         ///< negative: repeat_mm over an arm of 1.5 m
};

class RobotError {
 public:
  explicit RobotError(const RobotErrorTraits& traits = {});

  /// Real pose of the flange when the controller reports `T_base_flange`, on its `visit`-th visit. The same seed, pose
  /// and visit always give the same result.
  [[nodiscard]] Pose real(const Pose& T_base_flange, std::uint64_t visit) const;

  /// Real pose without the repeatability error.
  [[nodiscard]] Pose real_mean(const Pose& T_base_flange) const;

  [[nodiscard]] const RobotErrorTraits& traits() const { return traits_; }

 private:
  /// A sum of waves with normally distributed wave vectors is a Gaussian field with a Gaussian correlation.
  struct Wave {
    Vec3 per_mm;
    double phase;
  };
  [[nodiscard]] double field(std::size_t component, const Vec3& p_mm) const;

  RobotErrorTraits traits_;
  std::vector<Wave> waves_;  ///< kWaves for each of the six components
};

}  // namespace slabd::emulator
