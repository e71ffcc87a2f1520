// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "base/units.h"

namespace slabd {

/// Generator splitmix64 (Steele, Lea, Flood 2014): 64 bits of state, equidistributed, the same on every machine. The
/// caller seeds it and passes it in; a global generator does not exist.
class Prng {
 public:
  explicit constexpr Prng(std::uint64_t seed) : state_(seed) {}

  constexpr std::uint64_t next() {
    state_ += 0x9E3779B97F4A7C15U;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }
  /// Uniform in [0, 1), 53 bits.
  constexpr double uniform() { return static_cast<double>(next() >> 11U) * 0x1.0p-53; }
  /// Uniform index in [0, count); count > 0. Its bias of at most count / 2^64 is negligible.
  constexpr std::uint64_t below(std::uint64_t count) { return next() % count; }
  /// Standard normal by Box-Muller, one value per call. The second value is discarded, so no state is hidden.
  double normal() {
    const double u = 1.0 - uniform();
    const double v = uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * kPi * v);
  }

 private:
  std::uint64_t state_;
};

}  // namespace slabd
