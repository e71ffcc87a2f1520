// SPDX-License-Identifier: Apache-2.0
//
// The paper repeats the scan of one block ten times and finds standard deviations within 0.010 mm and flatness within
// 0.030 mm of each other (its Figs. 11 and 12). This study does the same with full-size scans, in several series of
// ten, each of another block; the robot returns to within its repeatability.
#include <fmt/core.h>

#include "tests/accuracy/block_scan.h"
#include "tests/accuracy/studies.h"

namespace slabd::accuracy {
namespace {

constexpr int kRepeats = 10;
constexpr double kRobot_mm = 0.017;
constexpr double kRobot_deg = 0.002;

Pose come_back(const Pose& T_scanner_block, Prng& random) {
  Pose off;
  for (int axis = 0; axis < 3; ++axis) off.translation_mm[axis] = kRobot_mm * random.normal();
  const auto turn = [&] { return rad_from_deg(kRobot_deg) * random.normal(); };
  const double a = turn();
  const double b = turn();
  off.rotation = rotation_from_kuka_abc(a, b, turn());
  return off * T_scanner_block;
}

}  // namespace

bool repeat_study(const StudyOptions& options, Table& table) {
  const std::optional<Recipe> recipe = reference_recipe();
  if (!recipe) return false;
  BlockBench bench(*recipe);
  std::vector<double> std_spread;
  std::vector<double> flatness_spread;
  std::vector<double> min_zone_spread;
  std::vector<double> slope_spread;
  std::vector<double> all_flatness;
  int failed = 0;
  const int series_count = options.cases(20, 3);
  for (int series = 0; series < series_count; ++series) {
    const std::uint64_t seed = options.first + static_cast<std::uint64_t>(series);
    const Sight block = varied_sight(*recipe, seed);
    Prng random(emulator::derived_seed(seed, 9, 0));
    std::vector<double> stds;
    std::vector<double> flatness;
    std::vector<double> min_zone;
    std::vector<double> slope;
    for (int repeat = 0; repeat < kRepeats; ++repeat) {
      const Sight sight{block.station, come_back(block.T_scanner_block, random)};
      if (!bench.measure(sight, {}, random.next())) {
        fmt::print(stderr, "repeat, seed {}, scan {}: {}\n", seed, repeat, bench.trouble());
        ++failed;
        continue;
      }
      stds.push_back(bench.result().seat.plane.std_mm);
      flatness.push_back(bench.item(ItemId::seat_flatness).value);
      min_zone.push_back(bench.result().seat.flatness_min_zone_mm);
      slope.push_back(bench.item(ItemId::seat_slope).value);
    }
    std_spread.push_back(spread(stds));
    flatness_spread.push_back(spread(flatness));
    min_zone_spread.push_back(spread(min_zone));
    slope_spread.push_back(spread(slope));
    all_flatness.insert(all_flatness.end(), flatness.begin(), flatness.end());
  }
  table.at_most("scans that failed", failed, 0, "");
  table.at_most("std of the seat, spread of ten, worst series", largest(std_spread), 0.002, "mm");
  table.at_most("flatness, spread of ten, worst series", largest(flatness_spread), 0.012, "mm");
  table.tell("flatness, spread of ten, mean series", mean(flatness_spread), "mm");
  table.tell("minimum-zone flatness, spread of ten, worst series", largest(min_zone_spread), "mm");
  table.tell("flatness, mean value (the seats are flat)", mean(all_flatness), "mm");
  table.tell("slope, spread of ten, worst series", largest(slope_spread), "deg");
  return true;
}

}  // namespace slabd::accuracy
