// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/features/seat_points.h"
#include "base/limits.h"

/// The passes over the points around a casing.
namespace slabd::algo {

/// Transform from the seat's frame to a casing's: (x, y) in the fitted seat about an origin near the casing's centre,
/// and height above the fitted seat. The origin is subtracted before any product, so floats keep 1e-6 mm.
struct CasingAxes {
  float x_mm = 0.0F;  ///< the origin, in the seat's frame
  float s_mm = 0.0F;
  std::array<float, 3> across{};  ///< factors of (x - x_mm, s - s_mm, h) for x ...
  std::array<float, 3> along{};   ///< ... for y ...
  std::array<float, 3> up{};      ///< ... and for the height,
  float up_mm = 0.0F;             ///< to which this is added
};

/// Selection of a pass: points between two radii about a centre and between two heights.
struct CasingRing {
  float centre_x_mm = 0.0F;  ///< in the casing's frame
  float centre_y_mm = 0.0F;
  float inner_mm = 0.0F;  ///< >= this radius
  float outer_mm = 0.0F;  ///< < this radius
  float low_mm = 0.0F;    ///< >= this height
  float high_mm = 0.0F;   ///< <= this height
};

/// The innermost point of each sector so far.
struct Innermost {
  std::array<float, limits::kRimSectors> radius2;  ///< mm^2; the ring's outer radius if the sector is empty
  std::array<float, limits::kRimSectors> x;        ///< in the casing's frame
  std::array<float, limits::kRimSectors> y;

  /// Starts with all sectors empty.
  explicit Innermost(const CasingRing& ring) { radius2.fill(ring.outer_mm * ring.outer_mm); }
  [[nodiscard]] bool seen(std::size_t sector, const CasingRing& ring) const {
    return radius2[sector] < ring.outer_mm * ring.outer_mm;
  }
};

/// Updates `innermost` with the points of `points` in `ring`; sectors are relative to the ring's centre. Of two equally
/// distant points the first one stays.
void find_innermost(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring, Innermost& innermost);

/// Writes the heights above the fitted seat of the points in `ring`, in their order, to the front of `heights` (at
/// least as many as points). Returns their number.
std::size_t heights_in_ring(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring,
                            std::span<float> heights);

}  // namespace slabd::algo
