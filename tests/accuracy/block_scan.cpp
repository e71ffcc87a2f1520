// SPDX-License-Identifier: Apache-2.0
#include "tests/accuracy/block_scan.h"

#include <fmt/core.h>

#include <cassert>
#include <cmath>

#include "config/config.h"
#include "tests/places/places.h"

namespace slabd::accuracy {

std::optional<Recipe> reference_recipe() {
  Recipe recipe;
  std::vector<config::Problem> problems;
  config::load_recipe(places::source_dir() + "/recipes/p5600.toml", recipe, problems);
  for (const config::Problem& problem : problems) fmt::print(stderr, "slabd_accuracy: {}\n", problem.text);
  if (!problems.empty()) return std::nullopt;
  return recipe;
}

void expect_perfect_scanner(Recipe& recipe) {
  const Nominal none{0.0, true};
  const Nominal any_length{1.0, true};
  recipe.uncertainty = {true, none, any_length, none, none, none};
}

Sight varied_sight(const Recipe& recipe, std::uint64_t seed, double off_mm, double off_deg) {
  constexpr double kRoughCasting = 6.0;
  emulator::SlabVariation variation;
  variation.seed = seed;
  variation.casting = kRoughCasting;
  const auto slab = emulator::cast_slab(recipe, emulator::Cell{}, variation, {});
  assert(slab);
  Sight sight;
  sight.station = slab.value().at(1);
  // The study measures a single block, so its position on the slab is nominal.
  sight.station.offset_slab_mm = Vec3::Zero();
  sight.station.block.slab_top_shift_mm = 0.0;

  Prng random(emulator::derived_seed(seed, 7, 0));
  const auto within = [&](double amplitude) { return amplitude * (2.0 * random.uniform() - 1.0); };
  Pose off;
  off.translation_mm = Vec3(within(off_mm), within(off_mm), within(off_mm));
  const double turn = rad_from_deg(off_deg);
  off.rotation = rotation_from_kuka_abc(within(turn), within(turn), within(turn));
  sight.T_scanner_block = (nominal_T_block_scanner() * off).inverse();
  return sight;
}

BlockBench::BlockBench(const Recipe& recipe) : recipe_(recipe), xyz_(3 * limits::kScanPointsMax) {
  inspector_.use(recipe_);
}

namespace {

/// Heights of a stationary Gaussian relief with the correlation exp(-(r / length)^2) and standard deviation 1.
class Relief {
 public:
  explicit Relief(const RoughConcrete& concrete) : heights_(kColumns * kRows) {
    Prng random(emulator::derived_seed(concrete.seed, 31, 0));
    // A sum of waves; the spectrum of that correlation is Gaussian with standard deviation sqrt(2) / length.
    for (int wave = 0; wave < kWaves; ++wave) {
      const double kx = std::sqrt(2.0) / concrete.length_mm * random.normal();
      const double ky = std::sqrt(2.0) / concrete.length_mm * random.normal();
      const double phase = 2.0 * kPi * random.uniform();
      for (int row = 0; row < kRows; ++row)
        for (int column = 0; column < kColumns; ++column)
          heights_[index(column, row)] += std::sqrt(2.0 / kWaves) * std::cos(kx * (column - kColumns / 2) * kStep_mm +
                                                                             ky * (row - kRows / 2) * kStep_mm + phase);
    }
  }
  [[nodiscard]] double at(double x_mm, double y_mm) const {
    const double column = x_mm / kStep_mm + kColumns / 2;
    const double row = y_mm / kStep_mm + kRows / 2;
    const int c = static_cast<int>(std::floor(column));
    const int r = static_cast<int>(std::floor(row));
    if (c < 0 || r < 0 || c + 1 >= kColumns || r + 1 >= kRows) return 0.0;
    const double u = column - c;
    const double v = row - r;
    return (1.0 - v) * ((1.0 - u) * heights_[index(c, r)] + u * heights_[index(c + 1, r)]) +
           v * ((1.0 - u) * heights_[index(c, r + 1)] + u * heights_[index(c + 1, r + 1)]);
  }

 private:
  static constexpr double kStep_mm = 2.0;
  static constexpr int kColumns = 400;  // 800 mm: larger than the field of view
  static constexpr int kRows = 400;
  static constexpr int kWaves = 200;
  static std::size_t index(int column, int row) {
    return static_cast<std::size_t>(row) * kColumns + static_cast<std::size_t>(column);
  }
  std::vector<double> heights_;
};

/// The area between the jaws and near the bearing plane, which is formed by steel.
constexpr double kSeatHalf_mm = 185.0;
constexpr double kSeatNear_mm = 3.0;

}  // namespace

void BlockBench::roughen(const Sight& sight) {
  const Relief relief(concrete);
  const Pose T_block_scanner = sight.T_scanner_block.inverse();
  const double rise = std::tan(sight.station.block.slope_rad);
  for (std::size_t i = 0; i + 2 < xyz_.size(); i += 3) {
    if (!std::isfinite(xyz_[i])) continue;
    const Vec3 p = T_block_scanner * Vec3(xyz_[i], xyz_[i + 1], xyz_[i + 2]);
    const bool on_seat = std::abs(p.y()) < kSeatHalf_mm && std::abs(p.z() - rise * p.y()) < kSeatNear_mm &&
                         std::abs(p.x()) < recipe_.block.end_half_length_mm.value;
    if (!on_seat) xyz_[i + 2] += static_cast<float>(concrete.std_mm * relief.at(p.x(), p.y()));
  }
}

bool BlockBench::measure(const Sight& sight, const emulator::ScannerTraits& traits, std::uint64_t seed,
                         const Pose& T_block_scanner_start) {
  inspector_.begin(1, Pose::identity(), T_block_scanner_start);
  const auto surface =
      emulator::BlockSurface::make(recipe_, sight.station.block, sight.T_scanner_block, traits.projection);
  if (!surface) {
    trouble_ = surface.error().text.c_str();
    return false;
  }
  const emulator::DrawnScan drawn = emulator::draw_scan(surface.value(), traits, seed, xyz_);
  if (field_error_mm != 0.0)
    for (std::size_t i = 0; i + 2 < xyz_.size(); i += 3) {
      const double share = 2.0 * double{xyz_[i + 1]} / traits.field_y_mm;
      xyz_[i + 2] += static_cast<float>(field_error_mm * share * share * share);
    }
  if (concrete.std_mm != 0.0) roughen(sight);
  algo::Cloud cloud{xyz_, xyz_.size() / 3, drawn.width, drawn.height};
  Status status = inspector_.denoise(cloud);
  if (status) status = inspector_.register_to_model(cloud);
  if (status) status = inspector_.extract(cloud);
  inspector_.judge(status ? Code::ok : status.error().code);
  trouble_ = status ? "" : status.error().text.c_str();
  return static_cast<bool>(status);
}

const Item& BlockBench::item(ItemId id) const {
  const Item* found = find_item(result().items.begin(), result().items.end(), id);
  assert(found != nullptr && "no such block item");
  return *found;
}

}  // namespace slabd::accuracy
