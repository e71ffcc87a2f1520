// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <span>

/// Conversion of coordinates, common to all scan readers, so that one cloud has the same bits from every format.
namespace slabd::hal {

/// Converts a coordinate of the file to mm: in double, rounded once.
template <typename Real>
[[nodiscard]] Real coordinate_mm(double value, double mm_per_unit) {
  return static_cast<Real>(value * mm_per_unit);
}

/// Counts found while settling.
struct Settled {
  std::size_t finite = 0;  ///< points that are not missing
  std::size_t zeros = 0;   ///< missing points that were exactly (0, 0, 0)
  Settled& operator+=(const Settled& other) {
    finite += other.finite;
    zeros += other.zeros;
    return *this;
  }
  bool operator==(const Settled&) const = default;
};

/// Sets missing points (3 numbers each) to NaN in all three coordinates: points that are not finite, and points at
/// exactly (0, 0, 0). That is the centre of the scanner, where no point can be measured. Scanner software writes it for
/// a missing point, and unwritten parts of a disk are read as it.
template <typename Real>
Settled settle_points(std::span<Real> xyz) {
  Settled settled;
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) {
    Real* p = &xyz[i];
    // inf - inf and NaN - NaN are NaN, finite - finite is 0: one test for three coordinates.
    const Real zero = (p[0] - p[0]) + (p[1] - p[1]) + (p[2] - p[2]);
    const bool nothing = p[0] == Real{0} && p[1] == Real{0} && p[2] == Real{0};
    if (zero == Real{0} && !nothing) {
      ++settled.finite;
    } else {
      p[0] = p[1] = p[2] = std::numeric_limits<Real>::quiet_NaN();
      if (nothing) ++settled.zeros;
    }
  }
  return settled;
}

/// The same bits and counts, sixteen points at a time; 0.2 ms for a million points in memory.
[[nodiscard]] Settled settle_points(float* xyz, std::size_t points);
[[nodiscard]] Settled settle_points(double* xyz, std::size_t points);

/// The same while copying from `from` (bytes of a file, any alignment) to `to`, past the caches if the alignment of
/// `to` allows. A scan is larger than the caches, and a store that first fetches the line it overwrites costs half as
/// much again.
[[nodiscard]] Settled move_and_settle_points(const char* from, std::size_t points, float* to);

/// Copies `count` numbers and gives every NaN the bits 0x7FC00000.
void copy_with_one_nan(const float* from, std::size_t count, float* to);

}  // namespace slabd::hal
