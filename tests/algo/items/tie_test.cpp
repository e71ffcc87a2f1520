// SPDX-License-Identifier: Apache-2.0
//
// The tie of two robots in the budget of a slab's items: compared with differences of the real item functions, and
// absent where one robot scanned everything.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "item_simulation.h"

namespace slabd {
namespace {

using simulation::Coverage;
using simulation::Line;
using simulation::Measured;
using simulation::SecondRobot;
using Scans = std::array<bool, limits::kStationsMax>;

constexpr algo::StationSigma kSigma = {0.02, 2e-5, 0.017, 1e-5};

Scans scans_of(const std::function<bool(int)>& second) {
  Scans scans{};
  for (int station = 1; station <= static_cast<int>(limits::kStationsMax); ++station)
    scans[static_cast<std::size_t>(station - 1)] = second(station);
  return scans;
}
/// One robot for each row: every pair is across the tie.
Scans row_of_its_own() {
  return scans_of([](int station) { return station > 9; });
}
/// One robot for each half of the slab's length.
Scans half_of_its_own() {
  return scans_of([](int station) { return station >= 6 && station <= 13; });
}

/// The middle of the targets is not that of the slab.
Vec3 centre_mm() {
  return Line::T_base_slab() * Vec3(200.0, 150.0, 80.0);
}

Line line_with(const Scans& scans, double tie_mm, double tie_rad) {
  return {simulation::recipe_with_uncertainty(), kSigma,
          SecondRobot{scans, simulation::independent_tie(tie_mm, tie_rad, centre_mm())}};
}

/// Blocks measured without an error of the tie.
std::vector<BlockResult> blocks_of(const Line& line, std::uint64_t seed) {
  Prng prng(seed);
  simulation::Errors errors;
  errors.tie = 0.0;
  return line.measure(simulation::nominal(line.recipe()), errors, prng).blocks;
}

double tie_part(const Item& item) {
  return item.budget[static_cast<std::size_t>(BudgetPart::tie)];
}

Pose small_motion(int axis, double size) {
  Pose motion;
  if (axis < 3) {
    motion.translation_mm[axis] = size;
    return motion;
  }
  Eigen::Vector3d about = Eigen::Vector3d::Zero();
  about[axis - 3] = 1.0;
  motion.rotation = Quat(Eigen::AngleAxisd(size, about));
  motion.translation_mm = centre_mm() - motion.rotation * centre_mm();
  return motion;
}

TEST(Tie, part_equals_differences_of_the_real_items_by_every_motion_of_the_second_base) {
  constexpr double kTie_mm = 0.05;
  constexpr double kTie_rad = 2e-5;
  for (const Scans& scans : {row_of_its_own(), half_of_its_own()}) {
    const Line line = line_with(scans, kTie_mm, kTie_rad);
    const std::vector<BlockResult> blocks = blocks_of(line, 3);
    SlabResult slab;
    line.inspect(blocks, slab);
    ASSERT_TRUE(slab.fit.ok);
    std::vector<double> variance(slab.items.size(), 0.0);
    for (int axis = 0; axis < 6; ++axis) {
      const double sigma = axis < 3 ? kTie_mm : kTie_rad;
      const double step = 0.02 * sigma;
      std::array<SlabResult, 2> moved;
      for (const std::size_t side : {0U, 1U}) {
        std::vector<BlockResult> displaced = blocks;
        line.displace(small_motion(axis, side == 0 ? step : -step), displaced);
        line.inspect(displaced, moved[side]);
      }
      for (std::size_t i = 0; i < slab.items.size(); ++i)
        variance[i] += std::pow(sigma * (moved[0].items[i].value - moved[1].items[i].value) / (2.0 * step), 2);
    }
    for (std::size_t i = 0; i < slab.items.size(); ++i) {
      const Item& item = slab.items[i];
      if (!has_value(item.value) || info(item.id).of_gauges) continue;
      // The response of the frame is that for fixed scales of the robust fit.
      const double floor = 0.03 * (info(item.id).unit == ItemUnit::deg ? deg_from_rad(kTie_rad) : kTie_mm);
      EXPECT_NEAR(tie_part(item), std::sqrt(variance[i]), 0.1 * std::sqrt(variance[i]) + floor)
          << info(item.id).name << " " << int{item.station};
    }
  }
}

TEST(Tie, distance_across_the_track_contains_the_tie_in_full) {
  const Line line = line_with(row_of_its_own(), 0.1, 1e-9);
  SlabResult slab;
  line.inspect(blocks_of(line, 4), slab);
  for (const Item& item : slab.items) {
    if (item.id == ItemId::large_jaw_distance) {
      EXPECT_NEAR(tie_part(item), 0.1, 0.002);
    }
    // Two neighbours of one row were seen by one robot; only the frame's small turn remains.
    if (item.id == ItemId::seat_spacing) {
      EXPECT_LT(tie_part(item), 0.005);
    }
  }
}

TEST(Tie, a_scanner_that_has_become_warm_displaces_the_half_of_its_robot) {
  constexpr double kDrift = 200e-6;  // 8 K of aluminium
  const Line line = line_with(half_of_its_own(), 1e-6, 1e-9);
  const std::vector<BlockResult> blocks = blocks_of(line, 9);
  const TieNumbers tie = simulation::independent_tie(1e-6, 1e-9, centre_mm());
  const std::array<ScannerNumbers, limits::kArmsMax> verified{};
  const auto inspected = [&](const std::vector<BlockResult>& seen, double drift) {
    std::array<algo::StationSigma, limits::kStationsMax> sigmas;
    for (std::size_t i = 0; i < sigmas.size(); ++i) {
      sigmas[i] = kSigma;
      sigmas[i].arm = half_of_its_own()[i] ? 1 : 0;
      sigmas[i].scanner_drift = sigmas[i].arm == 1 ? drift : 0.0;
    }
    SlabResult slab;
    algo::inspect_slab(line.recipe(), seen, sigmas, Line::T_base_slab(), slab, algo::SlabArms{verified, &tie}, {});
    return slab;
  };
  std::vector<BlockResult> displaced = blocks;
  line.displace(small_motion(2, 600.0 * kDrift), displaced);
  const SlabResult cold = inspected(blocks, 0.0);
  const SlabResult warm = inspected(blocks, kDrift);
  const SlabResult moved = inspected(displaced, 0.0);
  int compared = 0;
  for (std::size_t i = 0; i < cold.items.size(); ++i) {
    const ItemId id = cold.items[i].id;
    if (id != ItemId::seat_vertical && id != ItemId::corner_level) continue;
    const auto part = [&](const SlabResult& slab) {
      return slab.items[i].budget[static_cast<std::size_t>(BudgetPart::scanner)];
    };
    const double added = std::sqrt(std::max(0.0, std::pow(part(warm), 2) - std::pow(part(cold), 2)));
    const double off = std::abs(moved.items[i].value - cold.items[i].value) / std::sqrt(3.0);
    EXPECT_NEAR(added, off, 0.1 * off + 0.004) << info(id).name << " " << int{cold.items[i].station};
    EXPECT_GE(warm.items[i].U, cold.items[i].U);
    compared += off > 0.01 ? 1 : 0;
  }
  EXPECT_GE(compared, 4);
}

TEST(Tie, one_robot_needs_none) {
  for (const bool second : {false, true}) {
    const Line two = line_with(scans_of([&](int) { return second; }), 1.0, 1e-3);
    const Line one(simulation::recipe_with_uncertainty(), kSigma);
    const std::vector<BlockResult> blocks = blocks_of(two, 5);
    SlabResult with;
    SlabResult without;
    two.inspect(blocks, with);
    one.inspect(blocks, without);
    ASSERT_EQ(with.items.size(), without.items.size());
    for (std::size_t i = 0; i < with.items.size(); ++i) {
      EXPECT_EQ(tie_part(with.items[i]), 0.0);
      if (has_value(with.items[i].value)) {
        EXPECT_EQ(with.items[i].U, without.items[i].U);
      }
      EXPECT_EQ(with.items[i].verdict, without.items[i].verdict);
    }
    EXPECT_EQ(with.verdict, without.verdict);
  }
}

TEST(Tie, items_across_a_tie_of_unknown_covariance_are_indeterminate) {
  const Line line = line_with(row_of_its_own(), 0.05, 2e-5);
  const std::vector<BlockResult> blocks = blocks_of(line, 6);
  std::array<algo::StationSigma, limits::kStationsMax> sigmas;
  sigmas.fill(kSigma);
  for (std::size_t i = 9; i < sigmas.size(); ++i) sigmas[i].arm = 1;
  const std::array<ScannerNumbers, limits::kArmsMax> verified{};
  TieNumbers unknown = simulation::independent_tie(0.05, 2e-5, centre_mm());
  unknown.covariance.setConstant(kNoValue);
  for (const TieNumbers* tie : {static_cast<const TieNumbers*>(nullptr), static_cast<const TieNumbers*>(&unknown)}) {
    for (const bool budgets : {true, false}) {
      Recipe recipe = line.recipe();
      recipe.uncertainty.given = budgets;
      SlabResult slab;
      algo::inspect_slab(recipe, blocks, sigmas, Line::T_base_slab(), slab, algo::SlabArms{verified, tie}, {});
      ASSERT_TRUE(slab.fit.ok);
      for (const Item& item : slab.items) {
        if (item.id != ItemId::large_jaw_distance) continue;
        EXPECT_TRUE(std::isnan(item.U));
        EXPECT_EQ(item.verdict, Verdict::indeterminate);
        EXPECT_EQ(item.budget, (std::array<double, kBudgetParts>{}));
      }
      EXPECT_NE(slab.verdict, Verdict::pass);
    }
  }
}

TEST(Tie, U_contains_it_with_and_without_a_budget) {
  for (const bool budgets : {true, false}) {
    Recipe recipe = simulation::recipe_with_uncertainty();
    recipe.uncertainty.given = budgets;
    const SecondRobot none{row_of_its_own(), simulation::independent_tie(1e-6, 1e-9, centre_mm())};
    const SecondRobot loose{row_of_its_own(), simulation::independent_tie(0.2, 1e-9, centre_mm())};
    const std::vector<BlockResult> blocks = blocks_of(line_with(row_of_its_own(), 0.2, 1e-9), 7);
    SlabResult small;
    SlabResult large;
    Line(recipe, kSigma, none).inspect(blocks, small);
    Line(recipe, kSigma, loose).inspect(blocks, large);
    const Item* a = find_item(small.items.begin(), small.items.end(), ItemId::large_jaw_distance);
    const Item* b = find_item(large.items.begin(), large.items.end(), ItemId::large_jaw_distance);
    ASSERT_TRUE(a != nullptr && b != nullptr);
    EXPECT_NEAR(b->U, std::hypot(a->U, 0.4), 0.01) << budgets;
  }
}

TEST(Tie, each_station_has_the_figures_of_its_own_scanner) {
  const Line line = line_with(row_of_its_own(), 0.01, 1e-6);
  const std::vector<BlockResult> blocks = blocks_of(line, 8);
  std::array<algo::StationSigma, limits::kStationsMax> sigmas;
  sigmas.fill(kSigma);
  for (std::size_t i = 9; i < sigmas.size(); ++i) sigmas[i].arm = 1;
  std::array<ScannerNumbers, limits::kArmsMax> verified{};
  const TieNumbers tie = simulation::independent_tie(0.01, 1e-6, centre_mm());
  const auto scanner_part = [&](int station) {
    SlabResult slab;
    algo::inspect_slab(line.recipe(), blocks, sigmas, Line::T_base_slab(), slab, algo::SlabArms{verified, &tie}, {});
    for (const Item& item : slab.items)
      if (item.id == ItemId::seat_lateral && item.station == station)
        return item.budget[static_cast<std::size_t>(BudgetPart::scanner)];
    return kNoValue;
  };
  const double first = scanner_part(5);
  const double second = scanner_part(14);
  verified[1].form_half_mm = 0.5;
  verified[1].form_length_mm = 150.0;
  EXPECT_GT(scanner_part(14), 5.0 * second);
  EXPECT_LT(scanner_part(5), 4.0 * first) << "only by the frame";
}

void expect_covered(const Scans& scans) {
  // 0.3 mm in space and 0.003 degrees: an order of magnitude beyond a careful tie.
  const Line line = line_with(scans, 0.3 / std::sqrt(3.0), rad_from_deg(0.003));
  for (const Coverage& c : simulation::coverage(line, simulation::Errors{}, 200, 1, 0)) {
    const double n = static_cast<double>(c.count);
    EXPECT_GE(c.share(), 0.935 - 4.0 * std::sqrt(0.935 * 0.065 / n)) << info(c.id).name << " of " << c.count;
  }
}

TEST(Coverage, holds_for_every_item_with_a_robot_for_each_row) {
  expect_covered(row_of_its_own());
}

TEST(Coverage, holds_for_every_item_with_a_robot_for_each_half) {
  expect_covered(half_of_its_own());
}

}  // namespace
}  // namespace slabd
