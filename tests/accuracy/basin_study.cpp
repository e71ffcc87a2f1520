// SPDX-License-Identifier: Apache-2.0
//
// Registration from random starts, every axis uniform within +- the band, on one scan of a quarter of the points (the
// registration samples at most 65 536 of them anyway). A result is right if it converged within 0.05 mm and 0.01 deg
// of the truth. A converged wrong pose is the worst result and must not occur, however far the start. The station
// window of the recipe, which would reject far poses, is opened to test the algorithm alone.
#include <fmt/core.h>

#include "tests/accuracy/block_scan.h"
#include "tests/accuracy/studies.h"

namespace slabd::accuracy {
namespace {

constexpr double kRight_mm = 0.05;
constexpr double kRight_deg = 0.01;

struct Band {
  double mm;
  double deg;
  bool goal;  ///< every start must give the right pose
  emulator::Projection projection;
};
constexpr std::array kBands = {
    Band{10.0, 2.0, true, emulator::Projection::parallel},    Band{30.0, 5.0, true, emulator::Projection::parallel},
    Band{30.0, 5.0, true, emulator::Projection::perspective}, Band{40.0, 7.0, false, emulator::Projection::parallel},
    Band{60.0, 10.0, false, emulator::Projection::parallel},
};

struct Count {
  int right = 0;
  int wrong = 0;  ///< converged to a wrong pose
};

Pose random_start(const Pose& truth, const Band& band, Prng& random) {
  const auto within = [&](double amplitude) { return amplitude * (2.0 * random.uniform() - 1.0); };
  Pose off;
  for (int axis = 0; axis < 3; ++axis) off.translation_mm[axis] = within(band.mm);
  const double turn = rad_from_deg(band.deg);
  const double a = within(turn);
  const double b = within(turn);
  off.rotation = rotation_from_kuka_abc(a, b, within(turn));
  return off * truth;
}

}  // namespace

bool basin_study(const StudyOptions& options, Table& table) {
  std::optional<Recipe> recipe = reference_recipe();
  if (!recipe) return false;
  recipe->evaluation.window_mm = 1000.0;
  recipe->evaluation.window_rad = 1.0;
  algo::BlockInspector inspector;
  inspector.use(*recipe);
  std::vector<float> xyz;
  for (std::size_t b = 0; b < kBands.size(); ++b) {
    const Band& band = kBands[b];
    const Sight sight = varied_sight(*recipe, options.first);
    emulator::ScannerTraits scanner;
    scanner.columns /= 2;
    scanner.rows /= 2;
    scanner.projection = band.projection;
    const auto surface =
        emulator::BlockSurface::make(*recipe, sight.station.block, sight.T_scanner_block, scanner.projection);
    if (!surface) return false;
    const emulator::DrawnScan drawn =
        emulator::draw_scan(surface.value(), scanner, emulator::derived_seed(options.first, 10, b), xyz);
    algo::Cloud cloud{xyz, xyz.size() / 3, drawn.width, drawn.height};
    inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
    if (!inspector.denoise(cloud)) return false;

    const Pose T_block_scanner = sight.T_scanner_block.inverse();
    const int starts = options.cases(band.goal ? 1000 : 300, 20);
    Prng random(emulator::derived_seed(options.first, 11, b));
    Count count;
    for (int i = 0; i < starts; ++i) {
      inspector.begin(1, Pose::identity(), random_start(T_block_scanner, band, random));
      if (!inspector.register_to_model(cloud)) continue;
      const Pose off = inspector.result().registration.T_scanner_block * T_block_scanner;
      const bool right = off.translation_mm.norm() < kRight_mm &&
                         deg_from_rad(angle_between_rad(off.rotation, Quat::Identity())) < kRight_deg;
      ++(right ? count.right : count.wrong);
    }
    const std::string what = fmt::format("+-{:.0f} mm, +-{:.0f} deg{}", band.mm, band.deg,
                                         band.projection == emulator::Projection::perspective ? ", perspective" : "");
    const double share = static_cast<double>(count.right) / starts;
    if (band.goal)
      table.at_least(what + fmt::format(": right, of {}", starts), share, 1.0, "");
    else
      table.tell(what + fmt::format(": right, of {}", starts), share, "");
    table.at_most(what + ": converged and wrong", count.wrong, 0, "");
  }
  return true;
}

}  // namespace slabd::accuracy
