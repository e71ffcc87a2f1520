// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace slabd::algo {

/// Divides a face into a few places of equal area, to ask each how much of it was seen. Coordinates as in the face's
/// SeatFrame: u along the rail, v across it. What lies outside belongs to the place beside it.
struct FaceRaster {
  static constexpr std::size_t kColumns = 8;
  static constexpr std::size_t kRows = 4;
  static constexpr std::size_t kPlaces = kColumns * kRows;

  float u_low_mm = 0.0F;
  float v_low_mm = 0.0F;
  float columns_per_mm = 0.0F;
  float rows_per_mm = 0.0F;

  static constexpr FaceRaster between(double u_low_mm, double u_high_mm, double v_low_mm, double v_high_mm) {
    return {static_cast<float>(u_low_mm), static_cast<float>(v_low_mm),
            static_cast<float>(static_cast<double>(kColumns) / (u_high_mm - u_low_mm)),
            static_cast<float>(static_cast<double>(kRows) / (v_high_mm - v_low_mm))};
  }
  [[nodiscard]] std::size_t place_of(float u, float v) const {
    constexpr auto kLastColumn = static_cast<float>(kColumns - 1);
    constexpr auto kLastRow = static_cast<float>(kRows - 1);
    const auto column = static_cast<std::size_t>(std::clamp((u - u_low_mm) * columns_per_mm, 0.0F, kLastColumn));
    const auto row = static_cast<std::size_t>(std::clamp((v - v_low_mm) * rows_per_mm, 0.0F, kLastRow));
    return kColumns * row + column;
  }
};
/// Points by place.
using PlaceCounts = std::array<std::uint32_t, FaceRaster::kPlaces>;

}  // namespace slabd::algo
