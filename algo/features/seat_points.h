// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "base/base.h"

/// Points over the bearing plane, small enough to be read several times from the cache. What is asked of them is
/// asked along the seat, so they are kept along the seat: near the plane floats then hold them to 1e-6 mm, which they
/// do not in the scanner's frame.
namespace slabd::algo {

/// Right-handed frame of the nominal bearing plane. Exact in double, and so is the way back to the block's frame.
struct SeatFrame {
  Vec3 origin = Vec3::Zero();       ///< on the plane, block frame
  Vec3 along_rail = Vec3::UnitX();  ///< unit: x
  Vec3 along_seat = Vec3::UnitY();  ///< unit: s, climbing outward
  Vec3 up = Vec3::UnitZ();          ///< unit normal: h

  static SeatFrame of(const BlockModel& model) {
    const Plane& seat = model.plane(Face::seat);
    return {seat.d * seat.n, Vec3::UnitX(), model.along_seat(), seat.n};
  }
  [[nodiscard]] Vec3 in_block(double x, double s, double h) const {
    return origin + x * along_rail + s * along_seat + h * up;
  }
  /// x, s, h of a point of the block's frame.
  [[nodiscard]] Vec3 in_seat(const Vec3& p) const {
    const Vec3 q = p - origin;
    return {along_rail.dot(q), along_seat.dot(q), up.dot(q)};
  }
};

/// A run of points: coordinates in a SeatFrame, mm, three arrays of equal length. Whoever writes it leaves out what is
/// not finite: every value here is a number. Points stand in the order of the scan, which keeps neighbours together;
/// the answers of what reads them hold for any order, but the last bits follow it. Where several runs make up one
/// region they are passed as a span of runs in the order of the scan, whichever thread wrote them.
struct SeatPoints {
  std::span<const float> x;  ///< along the rail
  std::span<const float> s;  ///< along the seat
  std::span<const float> h;  ///< above the nominal bearing plane

  [[nodiscard]] std::size_t size() const { return h.size(); }
  /// Asks for the beginning to be brought into the cache. Processors fetch ahead by themselves, but not from one page
  /// to the next, and a run is seldom longer than that.
  void ask_for() const {
    constexpr std::size_t kLine = 64 / sizeof(float);
    for (std::size_t i = 0; i < std::min(size(), 8 * kLine); i += kLine) {
      __builtin_prefetch(&x[i]);
      __builtin_prefetch(&s[i]);
      __builtin_prefetch(&h[i]);
    }
  }
};

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
