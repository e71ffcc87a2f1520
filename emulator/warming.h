// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "base/base.h"

/// A scanner that warms up after it was switched on: its temperature rises exponentially, and its frame grows and bends
/// with it. The warm scanner is true.
namespace slabd::emulator {

struct Warming {
  double time_constant_s = 0.0;  ///< 0: off; the scanner is warm and states no temperature
  double rise_K = 12.0;          ///< from the start to the end
  double start_c = 22.0;
  double per_K = 25e-6;           ///< relative error of every length, of an aluminium frame
  double shift_mm_per_K = 0.005;  ///< of the frame along its Z, because the cameras tilt
  [[nodiscard]] bool is_on() const { return time_constant_s > 0.0; }
};

/// Temperature after this time; NaN if the effect is off.
[[nodiscard]] double temperature_c(const Warming& warming, double time_s);
/// Moves points (mm, scanner frame) to where the scanner sees them at this time. Does nothing if the effect is off.
void warm(const Warming& warming, double time_s, std::span<float> xyz);

}  // namespace slabd::emulator
