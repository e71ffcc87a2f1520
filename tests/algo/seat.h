// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <numeric>
#include <vector>

#include "algo/flatness.h"

namespace slabd::testing {

/// A level seat as float points, and the flatness of it.
struct Seat {
  std::vector<float> xyz;
  std::vector<std::uint32_t> index;
  std::vector<std::uint32_t> start = std::vector<std::uint32_t>(limits::kFlatnessCellsMax + 1);
  std::vector<std::uint32_t> next = std::vector<std::uint32_t>(limits::kFlatnessCellsMax);
  std::vector<Vec3> mean = std::vector<Vec3>(limits::kFlatnessCellsMax);
  algo::FlatnessRegion region{51.0, 75.0, 1.5, 12, Vec3::UnitY()};

  template <typename Height>
  explicit Seat(const Height& height, double pitch = 0.25) {
    for (double y = -75.0 + 0.5 * pitch; y < 75.0; y += pitch)
      for (double x = -51.0 + 0.5 * pitch; x < 51.0; x += pitch)
        xyz.insert(xyz.end(), {static_cast<float>(x), static_cast<float>(y), static_cast<float>(height(x, y))});
  }
  [[nodiscard]] std::vector<Vec3> points() const {
    std::vector<Vec3> all;
    for (std::size_t i = 0; i < xyz.size(); i += 3)
      all.push_back(
          Vec3(static_cast<double>(xyz[i]), static_cast<double>(xyz[i + 1]), static_cast<double>(xyz[i + 2])));
    return all;
  }
  /// Against the nominal plane, as if it had been fitted; `std_mm` is what the fit would say of the points.
  algo::Flatness measure(double std_mm = kNoValue) {
    PlaneFit level;
    level.ok = true;
    level.normal = Vec3::UnitZ();
    level.offset_mm = 0.0;
    level.std_mm = std_mm;
    return measure(level);
  }
  algo::Flatness measure(const PlaneFit& plane) {
    index.resize(xyz.size() / 3);
    std::iota(index.begin(), index.end(), 0U);
    return algo::measure_flatness(xyz.data(), index, algo::FastTransform(Pose::identity()), plane, region,
                                  {start, next, mean});
  }
};

}  // namespace slabd::testing
