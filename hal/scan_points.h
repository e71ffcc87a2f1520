// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <span>

/// What every scan reader does with a coordinate, so that one cloud has the same bits from every format.
namespace slabd::hal {

/// A coordinate of the file as mm: converted in double, rounded once.
template <typename Real>
[[nodiscard]] Real coordinate_mm(double value, double mm_per_unit) {
  return static_cast<Real>(value * mm_per_unit);
}

/// Points (3 numbers each) that are not finite in x, y and z become NaN in all three. Returns how many are finite.
template <typename Real>
std::size_t settle_points(std::span<Real> xyz) {
  std::size_t finite = 0;
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) {
    Real* p = &xyz[i];
    // inf - inf and NaN - NaN are NaN, finite - finite is 0: one test for three coordinates.
    const Real zero = (p[0] - p[0]) + (p[1] - p[1]) + (p[2] - p[2]);
    if (zero == Real{0}) {
      ++finite;
    } else {
      p[0] = p[1] = p[2] = std::numeric_limits<Real>::quiet_NaN();
    }
  }
  return finite;
}

}  // namespace slabd::hal
