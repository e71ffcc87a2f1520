// SPDX-License-Identifier: Apache-2.0
//
// Full-size scans (4.9 million points, white noise 0.03 mm, 0.5 % outliers, 2 % missing) of blocks whose dimensions
// and place differ from scan to scan. For each item: rms and worst error against the planted truth, and in how many
// scans its U covered the error. The scanner is perfect but for its noise, and the recipe's budget says so, so U is
// what the noise alone explains: the sharpest test that a stated U can be put to.
#include <fmt/core.h>

#include <array>
#include <cmath>

#include "tests/accuracy/block_scan.h"
#include "tests/accuracy/studies.h"

namespace slabd::accuracy {
namespace {

struct Goal {
  ItemId id;
  double rms;
};
constexpr std::array kGoals = {
    Goal{ItemId::seat_slope, 0.0002},
    Goal{ItemId::jaw_angle_inner, 0.002},
    Goal{ItemId::jaw_angle_outer, 0.002},
    Goal{ItemId::jaw_distance, 0.001},
    Goal{ItemId::casing_spacing, 0.02},
    Goal{ItemId::casing_protrusion_inner, 0.0015},
    Goal{ItemId::casing_protrusion_outer, 0.0015},
};
constexpr double kFlatSeatMax = 0.045;
constexpr double kCoverageMin = 0.935;

struct Tally {
  std::vector<double> error;
  std::vector<double> U;
  int covered = 0;
};

}  // namespace

bool block_study(const StudyOptions& options, Table& table) {
  std::optional<Recipe> recipe = reference_recipe();
  if (!recipe) return false;
  expect_perfect_scanner(*recipe);
  BlockBench bench(*recipe);
  std::array<Tally, kGoals.size()> tallies;
  std::vector<double> flatness;
  int measured = 0;
  int flatness_covered = 0;
  const int scans = options.cases(100, 8);
  for (int i = 0; i < scans; ++i) {
    const std::uint64_t seed = options.first + static_cast<std::uint64_t>(i);
    const Sight sight = varied_sight(*recipe, seed);
    if (!bench.measure(sight, {}, simulate::derived_seed(seed, 8, 0))) {
      fmt::print(stderr, "block, seed {}: {}\n", seed, bench.trouble());
      continue;
    }
    ++measured;
    for (std::size_t k = 0; k < kGoals.size(); ++k) {
      const Item& item = bench.item(kGoals[k].id);
      const double error = item.value - simulate::true_value(*recipe, sight.station, item.id);
      tallies[k].error.push_back(error);
      tallies[k].U.push_back(item.U);
      tallies[k].covered += std::abs(error) <= item.U ? 1 : 0;
    }
    const Item& flat = bench.item(ItemId::seat_flatness);
    flatness.push_back(flat.value);
    flatness_covered += flat.value - flat.U <= 0.0 ? 1 : 0;
  }
  const auto share = [&](int count) { return static_cast<double>(count) / static_cast<double>(scans); };
  table.at_least("scans measured", share(measured), 1.0, "");
  for (std::size_t k = 0; k < kGoals.size(); ++k) {
    const std::string name(info(kGoals[k].id).name);
    const std::string unit(slabd::name(info(kGoals[k].id).unit));
    std::vector<double> size;
    for (const double e : tallies[k].error) size.push_back(std::abs(e));
    table.at_most(name + ", rms error", rms(tallies[k].error), kGoals[k].rms, unit);
    table.tell(name + ", mean error", mean(tallies[k].error), unit);
    table.tell(name + ", worst error", largest(size), unit);
    table.tell(name + ", U", mean(tallies[k].U), unit);
    table.at_least(name + ", U covers", share(tallies[k].covered), kCoverageMin, "");
    table.tell(name + ", U over what 95 % needs", mean(tallies[k].U) / quantile(size, 0.95), "");
  }
  table.at_most("flatness of a flat seat, largest", largest(flatness), kFlatSeatMax, "mm");
  table.tell("flatness of a flat seat, mean", mean(flatness), "mm");
  table.at_least("flatness of a flat seat, value - U <= 0", share(flatness_covered), kCoverageMin, "");
  return true;
}

}  // namespace slabd::accuracy
