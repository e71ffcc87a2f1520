// SPDX-License-Identifier: Apache-2.0
//
// Full-size scans (4.9 million points, noise 0.03 mm, 0.5 % outliers, 2 % missing) of blocks whose dimensions and
// position differ from scan to scan. For each item: rms and worst error relative to the planted truth, and the number
// of scans in which U covers the error. The scanner has no error but noise, and neither has the recipe's budget. U
// thus contains only the noise, which is the strictest test of U.
//
// Three scanners. `block`: white noise and parallel rays; the errors have goals. `perspective`: white noise and the
// perspective of a real scanner. `correlated`: noise correlated over 1 mm; fewer independent points give larger
// errors, which U must include.
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

enum class Judge { errors_and_coverage, coverage };

struct Run {
  std::string prefix;  ///< prefix of every row
  emulator::ScannerTraits scanner;
  Judge judge = Judge::errors_and_coverage;
  int scans = 0;
};

void tell_item(const Run& run, const Goal& goal, const Tally& tally, Table& table) {
  const std::string what = run.prefix + std::string(info(goal.id).name);
  const std::string unit(slabd::name(info(goal.id).unit));
  std::vector<double> size;
  for (const double e : tally.error) size.push_back(std::abs(e));
  if (run.judge == Judge::errors_and_coverage)
    table.at_most(what + ", rms error", rms(tally.error), goal.rms, unit);
  else
    table.tell(what + ", rms error", rms(tally.error), unit);
  table.tell(what + ", mean error", mean(tally.error), unit);
  table.tell(what + ", worst error", largest(size), unit);
  table.tell(what + ", mean U", mean(tally.U), unit);
  table.at_least(what + ", U covers", static_cast<double>(tally.covered) / run.scans, kCoverageMin, "");
  table.tell(what + ", U over what 95 % needs", mean(tally.U) / quantile(size, 0.95), "");
}

bool measure_items(const StudyOptions& options, const Run& run, Table& table) {
  std::optional<Recipe> recipe = reference_recipe();
  if (!recipe) return false;
  expect_perfect_scanner(*recipe);
  BlockBench bench(*recipe);
  std::array<Tally, kGoals.size()> tallies;
  Tally flatness;
  int measured = 0;
  for (int i = 0; i < run.scans; ++i) {
    const std::uint64_t seed = options.first + static_cast<std::uint64_t>(i);
    const Sight sight = varied_sight(*recipe, seed);
    if (!bench.measure(sight, run.scanner, emulator::derived_seed(seed, 8, 0))) {
      fmt::print(stderr, "seed {}: {}\n", seed, bench.trouble());
      continue;
    }
    ++measured;
    for (std::size_t k = 0; k < kGoals.size(); ++k) {
      const Item& item = bench.item(kGoals[k].id);
      const double error = item.value - emulator::true_value(*recipe, sight.station, item.id);
      tallies[k].error.push_back(error);
      tallies[k].U.push_back(item.U);
      tallies[k].covered += std::abs(error) <= item.U ? 1 : 0;
    }
    // Every seat is flat, and its value is only noise: value - U must not exceed zero.
    const Item& flat = bench.item(ItemId::seat_flatness);
    flatness.error.push_back(flat.value);
    flatness.U.push_back(flat.U);
    flatness.covered += flat.value - flat.U <= 0.0 ? 1 : 0;
  }
  table.at_least(run.prefix + "scans measured", static_cast<double>(measured) / run.scans, 1.0, "");
  for (std::size_t k = 0; k < kGoals.size(); ++k) tell_item(run, kGoals[k], tallies[k], table);
  const std::string flat = run.prefix + "flatness of a flat seat";
  if (run.judge == Judge::errors_and_coverage)
    table.at_most(flat + ", largest", largest(flatness.error), kFlatSeatMax, "mm");
  else
    table.tell(flat + ", largest", largest(flatness.error), "mm");
  table.tell(flat + ", mean", mean(flatness.error), "mm");
  table.tell(flat + ", mean U", mean(flatness.U), "mm");
  table.at_least(flat + ", value - U <= 0", static_cast<double>(flatness.covered) / run.scans, kCoverageMin, "");
  return true;
}

}  // namespace

bool block_study(const StudyOptions& options, Table& table) {
  return measure_items(options, {"", {}, Judge::errors_and_coverage, options.cases(200, 10)}, table);
}

bool perspective_study(const StudyOptions& options, Table& table) {
  emulator::ScannerTraits scanner;
  scanner.projection = emulator::Projection::perspective;
  return measure_items(options, {"", scanner, Judge::errors_and_coverage, options.cases(200, 10)}, table);
}

bool correlated_study(const StudyOptions& options, Table& table) {
  emulator::ScannerTraits scanner;
  scanner.noise_correlation_mm = 1.0;
  scanner.noise_shape = emulator::NoiseShape::gaussian;
  const int scans = options.cases(200, 10);
  if (!measure_items(options, {"gaussian: ", scanner, Judge::coverage, scans}, table)) return false;
  scanner.noise_shape = emulator::NoiseShape::exponential;
  return measure_items(options, {"exponential: ", scanner, Judge::coverage, scans}, table);
}

}  // namespace slabd::accuracy
