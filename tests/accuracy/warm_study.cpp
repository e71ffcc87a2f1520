// SPDX-License-Identifier: Apache-2.0
//
// Warm and cold slabs. A slab of -10 to 60 deg C is drawn as it is then: positions and blocks are longer or shorter by
// its expansion. It is measured with the recipe's [thermal], once with its temperature as a thermometer gives it and
// once without. Every length must be that at 20 deg C within U. Robot repeatability as in the study of slabs; hand-eye
// calibration and scanner are exact, so that nothing hides the expansion.
#include <fmt/core.h>

#include <map>
#include <utility>

#include "emulator/block_drawing.h"
#include "tests/accuracy/block_scan.h"
#include "tests/accuracy/slab_truth.h"
#include "tests/accuracy/studies.h"

namespace slabd::accuracy {
namespace {

constexpr double kRobot_mm = 0.017;
constexpr double kCoverageMin = 0.935;
constexpr double kLow_c = -10.0;
constexpr double kHigh_c = 60.0;

emulator::Cell cell() {
  emulator::Cell cell;
  cell.T_base_slab.translation_mm = Vec3(1800.0, 0.0, 300.0);
  cell.T_flange_scanner.translation_mm = Vec3(0.0, 80.0, 150.0);
  return cell;
}

/// Concrete of 1e-5 per K, known to a tenth; a thermometer known to 2 K; without one any temperature of the study.
ThermalSettings thermal() {
  ThermalSettings settings;
  settings.given = true;
  settings.reference_c.value = 20.0;
  settings.cte_per_K.value = 1.0e-5;
  settings.u_cte_per_K.value = 1.0e-6;
  settings.u_temperature_K.value = 2.0;
  settings.unknown_low_c.value = kLow_c;
  settings.unknown_high_c.value = kHigh_c;
  return settings;
}

struct Tally {
  int values = 0;
  int covered = 0;
  double sum_U = 0.0;
  double sum_squares = 0.0;
  void add(double error, double U) {
    ++values;
    covered += std::abs(error) <= U ? 1 : 0;
    sum_U += U;
    sum_squares += error * error;
  }
};

/// One slab in two states: as it lies in the cell, and as it would be at 20 deg C.
struct WarmSlab {
  emulator::SlabTruth now;
  emulator::SlabTruth at_reference;
  double told_c = kNoValue;  ///< temperature that the PLC sends
};

std::optional<WarmSlab> warm_slab(const Recipe& recipe, std::uint64_t seed) {
  Prng random(emulator::derived_seed(seed, 43, 0));
  const double real_c = kLow_c + (kHigh_c - kLow_c) * random.uniform();
  const ThermalSettings& t = recipe.thermal;
  const double cte = t.cte_per_K.value + t.u_cte_per_K.value * random.normal();
  emulator::SlabVariation variation;
  variation.seed = seed;
  variation.robot_mm = 0.0;
  variation.robot_sigma_mm = kRobot_mm;
  const auto cold = emulator::cast_slab(recipe, cell(), variation, {});
  variation.expansion = cte * (real_c - t.reference_c.value);
  const auto warm = emulator::cast_slab(recipe, cell(), variation, {});
  if (!cold || !warm) return std::nullopt;
  return WarmSlab{warm.value(), cold.value(), real_c + t.u_temperature_K.value * random.normal()};
}

class WarmBench {
 public:
  explicit WarmBench(const Recipe& recipe) : recipe_(recipe), xyz_(3 * limits::kScanPointsMax) {
    inspector_.use(recipe_);
    sigma_.position_mm = 0.0;
    sigma_.rotation_rad = 0.0;
    sigma_.robot_position_mm = kRobot_mm;
    traits_.columns /= 2;
    traits_.rows /= 2;
  }

  /// Measures the slab as the daemon and compares every length with the slab at 20 deg C.
  void measure(const WarmSlab& slab, double temperature_c, std::map<ItemId, Tally>& tallies) {
    const emulator::Cell place = cell();
    const SlabFacts facts{temperature_c, {}, {}};
    const SlabTruthItems truth(recipe_, slab.at_reference, {});
    for (int k = 1; k <= slab.now.stations; ++k) {
      const emulator::StationTruth& station = slab.now.at(k);
      const Pose T_scanner_block = emulator::T_scanner_block(slab.now, place, k);
      const auto surface = emulator::BlockSurface::make(recipe_, station.block, T_scanner_block, traits_.projection);
      if (!surface) continue;
      const std::uint64_t seed = emulator::derived_seed(slab.now.scan_seed, static_cast<std::uint64_t>(k), 1);
      const emulator::DrawnScan drawn = emulator::draw_scan(surface.value(), traits_, seed, xyz_);
      emulator::expand(slab.now.expansion, T_scanner_block.translation_mm, xyz_);
      algo::Cloud cloud{xyz_, xyz_.size() / 3, drawn.width, drawn.height};
      inspector_.begin(k, place.T_base_slab * T_slab_block(recipe_, k),
                       station.T_base_flange_reported * place.T_flange_scanner, {}, facts);
      Status status = inspector_.denoise(cloud);
      if (status) status = inspector_.register_to_model(cloud);
      if (status) status = inspector_.extract(cloud);
      inspector_.judge(status ? Code::ok : status.error().code);
      blocks_[static_cast<std::size_t>(k - 1)] = inspector_.result();
      for (const Item& item : inspector_.result().items)
        add(item, emulator::true_value(recipe_, slab.at_reference.at(k), item.id), tallies);
    }
    const std::vector<algo::StationSigma> sigmas(slab.now.stations, sigma_);
    algo::inspect_slab(recipe_, std::span(blocks_).first(slab.now.stations), sigmas, place.T_base_slab, result_, {},
                       facts);
    for (const Item& item : result_.items) add(item, truth.value(item.id, item.station), tallies);
  }

 private:
  static void add(const Item& item, double truth, std::map<ItemId, Tally>& tallies) {
    const bool is_length = info(item.id).unit == ItemUnit::mm && item.id != ItemId::seat_flatness;
    if (is_length && has_value(truth) && has_value(item.value)) tallies[item.id].add(item.value - truth, item.U);
  }

  Recipe recipe_;
  algo::BlockInspector inspector_;
  emulator::ScannerTraits traits_;
  std::vector<float> xyz_;
  algo::StationSigma sigma_;
  std::array<BlockResult, limits::kStationsMax> blocks_{};
  SlabResult result_;
};

}  // namespace

bool warm_study(const StudyOptions& options, Table& table) {
  std::optional<Recipe> recipe = reference_recipe();
  if (!recipe) return false;
  expect_perfect_scanner(*recipe);
  recipe->thermal = thermal();
  WarmBench bench(*recipe);
  std::map<ItemId, Tally> known;
  std::map<ItemId, Tally> unknown;
  const int slabs = options.cases(40, 4);
  for (int i = 0; i < slabs; ++i) {
    const auto slab = warm_slab(*recipe, options.first + static_cast<std::uint64_t>(i));
    if (!slab) return false;
    bench.measure(*slab, slab->told_c, known);
    bench.measure(*slab, kNoValue, unknown);
  }
  for (const auto& [name, tallies] : {std::pair{"known", &known}, std::pair{"unknown", &unknown}}) {
    int values = 0;
    int covered = 0;
    for (const auto& [id, tally] : *tallies) {
      values += tally.values;
      covered += tally.covered;
      const std::string what = fmt::format("temperature {}: {}", name, info(id).name);
      table.tell(what + ", rms error", std::sqrt(tally.sum_squares / tally.values), "mm");
      table.tell(what + ", mean U", tally.sum_U / tally.values, "mm");
      const double share = static_cast<double>(tally.covered) / tally.values;
      // The lengths of a slab have the error of its temperature in common, so a few slabs are few values.
      if (slabs >= 100)
        table.at_least(what + ", U covers", share, kCoverageMin, "");
      else
        table.tell(what + ", U covers", share, "");
    }
    table.at_least(fmt::format("temperature {}: all lengths, U covers", name), static_cast<double>(covered) / values,
                   kCoverageMin, "");
  }
  return true;
}

}  // namespace slabd::accuracy
