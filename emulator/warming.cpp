// SPDX-License-Identifier: Apache-2.0
#include "emulator/warming.h"

#include <cmath>

namespace slabd::emulator {
namespace {

/// Temperature that is still missing, K.
double missing_K(const Warming& warming, double time_s) {
  return warming.rise_K * std::exp(-time_s / warming.time_constant_s);
}

}  // namespace

double temperature_c(const Warming& warming, double time_s) {
  if (!warming.is_on()) return kNoValue;
  return warming.start_c + warming.rise_K - missing_K(warming, time_s);
}

void warm(const Warming& warming, double time_s, std::span<float> xyz) {
  if (!warming.is_on()) return;
  const double cold_K = missing_K(warming, time_s);
  // A cold frame is short, so it takes lengths for longer than they are.
  const double scale = 1.0 + warming.per_K * cold_K;
  const double shift_mm = warming.shift_mm_per_K * cold_K;
  for (std::size_t i = 0; i < xyz.size(); ++i)
    xyz[i] = static_cast<float>(scale * static_cast<double>(xyz[i]) + (i % 3 == 2 ? shift_mm : 0.0));
}

}  // namespace slabd::emulator
