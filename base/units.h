// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <numbers>

/// Internal lengths are mm, angles rad and times ns (monotonic) or us (wall clock). These are the only conversions;
/// they are used at the boundaries: `hal`, file readers, reports.
namespace slabd {

inline constexpr double kPi = std::numbers::pi;
inline constexpr double kMmPerM = 1000.0;

[[nodiscard]] constexpr double deg_from_rad(double angle_rad) {
  return angle_rad * (180.0 / kPi);
}
[[nodiscard]] constexpr double rad_from_deg(double angle_deg) {
  return angle_deg * (kPi / 180.0);
}
[[nodiscard]] constexpr double mm_from_m(double length_m) {
  return length_m * kMmPerM;
}
[[nodiscard]] constexpr double m_from_mm(double length_mm) {
  return length_mm / kMmPerM;
}

inline constexpr std::int64_t kNsPerMs = 1'000'000;
inline constexpr std::int64_t kNsPerUs = 1'000;
inline constexpr std::int64_t kNsPerS = 1'000'000'000;
[[nodiscard]] constexpr std::int64_t ns_from_ms(std::int64_t time_ms) {
  return time_ms * kNsPerMs;
}
[[nodiscard]] constexpr double ms_from_ns(std::int64_t time_ns) {
  return static_cast<double>(time_ns) / 1e6;
}

}  // namespace slabd
