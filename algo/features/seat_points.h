// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "base/base.h"

/// Points over the bearing plane, small enough to be read several times from the cache. Coordinates are along
/// the seat, as all readers need them: near the plane floats then resolve 1e-6 mm, unlike in the scanner's
/// frame.
namespace slabd::algo {

/// Right-handed frame of the nominal bearing plane. The conversions in both directions are exact in double.
struct SeatFrame {
  Vec3 origin = Vec3::Zero();       ///< on the plane, block frame
  Vec3 along_rail = Vec3::UnitX();  ///< unit: x
  Vec3 along_seat = Vec3::UnitY();  ///< unit: s, rising outward
  Vec3 up = Vec3::UnitZ();          ///< unit normal: h

  static SeatFrame of(const BlockModel& model) {
    const Plane& seat = model.plane(Face::seat);
    return {seat.d * seat.n, Vec3::UnitX(), model.along_seat(), seat.n};
  }
  [[nodiscard]] Vec3 in_block(double x, double s, double h) const {
    return origin + x * along_rail + s * along_seat + h * up;
  }
  /// x, s, h of a point of the block frame.
  [[nodiscard]] Vec3 in_seat(const Vec3& p) const {
    const Vec3 q = p - origin;
    return {along_rail.dot(q), along_seat.dot(q), up.dot(q)};
  }
};

/// A run of points: coordinates in a SeatFrame, mm, three arrays of equal length. All values are finite; the writer
/// omits other points. Points are in the order of the scan, so neighbours stay together; results are valid for any
/// order, except that their last bits depend on it. Several runs of one region are passed as a span of runs in the
/// order of the scan, independent of the thread that wrote them.
struct SeatPoints {
  std::span<const float> x;  ///< along the rail
  std::span<const float> s;  ///< along the seat
  std::span<const float> h;  ///< above the nominal bearing plane

  [[nodiscard]] std::size_t size() const { return h.size(); }
  /// Prefetches the start of the run. Hardware prefetchers do not cross page boundaries, and a run is seldom longer
  /// than a page.
  void ask_for() const {
    constexpr std::size_t kLine = 64 / sizeof(float);
    for (std::size_t i = 0; i < std::min(size(), 8 * kLine); i += kLine) {
      __builtin_prefetch(&x[i]);
      __builtin_prefetch(&s[i]);
      __builtin_prefetch(&h[i]);
    }
  }
};

/// Division of a face into a few places of equal area, to measure how much of each was seen. Coordinates as in the
/// face's SeatFrame: u along the rail, v across it. Points outside belong to the nearest place.
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
/// Number of points by place.
using PlaceCounts = std::array<std::uint32_t, FaceRaster::kPlaces>;

}  // namespace slabd::algo
