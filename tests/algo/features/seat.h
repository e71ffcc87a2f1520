// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "algo/features/flatness.h"

namespace slabd::testing {

/// Memory of measure_flatness, filled with remains of another block.
struct FlatnessMemory {
  std::vector<algo::CellSum> sums =
      std::vector<algo::CellSum>(2 * limits::kFlatnessCellsMax, algo::CellSum{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11});
  std::vector<algo::CellRange> ranges = std::vector<algo::CellRange>(limits::kCellGroupsMax, algo::CellRange{7, 3});
  std::vector<float> heights = std::vector<float>(limits::kSeatPointsMax, 99.0F);
  std::vector<std::uint32_t> mark = std::vector<std::uint32_t>(limits::kFlatnessCellsMax, 3);
  std::vector<std::uint32_t> stack = std::vector<std::uint32_t>(limits::kFlatnessCellsMax + 1, 5);
  std::vector<Vec3> mean = std::vector<Vec3>(limits::kFlatnessCellsMax, Vec3::Ones());
  algo::FlatnessWorkspace work{sums, ranges, heights, mark, stack, mean};
};

/// A level seat as float points, and its flatness.
struct Seat {
  std::vector<float> xyz;
  algo::FlatnessRegion region{51.0, 75.0, 1.5, 12};
  /// Number of runs into which the points are divided.
  std::size_t runs = 1;
  int threads = 1;

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
  /// Measures relative to the nominal plane, as if it had been fitted; `std_mm`: the fit's standard deviation.
  algo::Flatness measure(double std_mm = kNoValue) {
    PlaneFit level;
    level.ok = true;
    level.normal = Vec3::UnitZ();
    level.offset_mm = 0.0;
    level.std_mm = std_mm;
    return measure(level);
  }
  algo::Flatness measure(const PlaneFit& plane) {
    const std::size_t count = xyz.size() / 3;
    std::vector<float> x(count), s(count), h(count);
    for (std::size_t i = 0; i < count; ++i) {
      x[i] = xyz[3 * i];
      s[i] = xyz[3 * i + 1];
      h[i] = xyz[3 * i + 2];
    }
    std::vector<algo::SeatPoints> all;
    for (std::size_t k = 0; k < runs; ++k) {
      const std::size_t from = k * count / runs;
      const std::size_t length = (k + 1) * count / runs - from;
      all.push_back(
          {std::span(x).subspan(from, length), std::span(s).subspan(from, length), std::span(h).subspan(from, length)});
    }
    Team team(threads);
    FlatnessMemory memory;
    return algo::measure_flatness(all, algo::SeatFrame{}, plane, region, memory.work, team);
  }
};

}  // namespace slabd::testing
