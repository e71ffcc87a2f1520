// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <vector>

#include "base/base.h"

namespace slabd::testing {

/// A wavy, noisy 100 x 153 mm plane rising 1:40, reproducible by hand: splitmix64, three uniforms a point.
inline std::vector<Vec3> surface(std::uint64_t seed, int nx, int ny, double noise, double form,
                                 const Vec3& shift = Vec3::Zero()) {
  Prng prng(seed);
  const double a = 100.0;
  const double b = 153.0;
  const double cant = std::atan(1.0 / 40.0);
  std::vector<Vec3> points;
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < ny; ++j) {
      const double x = -a / 2.0 + a * i / (nx - 1);
      const double y = -b / 2.0 + b * j / (ny - 1);
      const double u = prng.uniform();
      const double v = prng.uniform();
      const double w = prng.uniform();
      const double z = form * (2.0 * x / a) * (2.0 * x / a) + noise * (u + v + w - 1.5);
      points.push_back(Vec3(x, y * std::cos(cant) - z * std::sin(cant), y * std::sin(cant) + z * std::cos(cant)) +
                       shift);
    }
  }
  return points;
}

/// Peak to valley relative to a plane.
inline double peak_to_valley(const std::vector<Vec3>& points, const PlaneFit& plane) {
  double low = 1e300;
  double high = -1e300;
  for (const Vec3& p : points) {
    low = std::min(low, plane.normal.dot(p));
    high = std::max(high, plane.normal.dot(p));
  }
  return high - low;
}

/// Root mean square distance (n, not n - 3).
inline double rms(const PlaneFit& plane) {
  return plane.std_mm * std::sqrt(static_cast<double>(plane.inliers - 3) / static_cast<double>(plane.inliers));
}

}  // namespace slabd::testing
