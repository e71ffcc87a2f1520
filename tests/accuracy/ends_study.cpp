// SPDX-License-Identifier: Apache-2.0
//
// P4856 and P4925: slabs of good castings, drawn with their ends, begun under their own type and under the other one.
// A slab must never be rejected under its own type. Under the other type it must be rejected if the field of view
// reaches an end.
#include <fmt/core.h>

#include "algo/algo.h"
#include "config/config.h"
#include "daemon/slab_ends.h"
#include "tests/accuracy/block_scan.h"
#include "tests/accuracy/studies.h"
#include "tests/places/places.h"

namespace slabd::accuracy {
namespace {

struct Field {
  double x_mm;
  emulator::Projection projection;
  bool reaches;
};
constexpr std::array kFields = {
    Field{350.0, emulator::Projection::parallel, false},
    Field{600.0, emulator::Projection::perspective, true},
    Field{700.0, emulator::Projection::parallel, true},
};
/// The outermost blocks and two inner ones of each row; the others are equal to the inner ones.
constexpr std::array kStations = {1, 2, 3, 8, 9, 10, 11, 16};

std::optional<Recipe> recipe_named(const char* name) {
  Recipe recipe;
  std::vector<config::Problem> problems;
  config::load_recipe(places::source_dir() + "/recipes/" + name, recipe, problems);
  if (!problems.empty()) return std::nullopt;
  return recipe;
}

struct Count {
  int slabs = 0;
  int refused = 0;
  int wrong_name = 0;
};

}  // namespace

bool ends_study(const StudyOptions& options, Table& table) {
  std::vector<Recipe> recipes;
  for (const char* name : {"p4856.toml", "p4925.toml"}) {
    const std::optional<Recipe> recipe = recipe_named(name);
    if (!recipe) return false;
    recipes.push_back(*recipe);
  }
  emulator::Cell cell;
  cell.T_base_slab.translation_mm = Vec3(1800.0, 0.0, 300.0);
  algo::BlockInspector inspector(1);
  inspector.use(recipes[0]);  // both recipes have the same blocks
  std::vector<float> xyz;
  const int slabs = options.cases(30, 3);
  for (const Field& field : kFields) {
    Count own;
    Count other;
    int lost = 0;
    for (int i = 0; i < slabs; ++i)
      for (std::size_t truth = 0; truth < recipes.size(); ++truth) {
        emulator::SlabVariation variation;
        variation.seed = options.first + static_cast<std::uint64_t>(i);
        variation.dither_mm = 4.0;
        variation.dither_deg = 1.0;
        const auto slab = emulator::cast_slab(recipes[truth], cell, variation, {});
        if (!slab) return false;
        std::array<daemon::SlabEnds, 2> ends;
        std::array<const Recipe*, 2> found{};
        for (std::size_t begun = 0; begun < recipes.size(); ++begun) ends[begun].use(recipes, recipes[begun]);
        for (const int k : kStations) {
          emulator::ScannerTraits scanner;
          scanner.columns = 700;
          scanner.rows = 700;
          scanner.field_x_mm = field.x_mm;
          scanner.projection = field.projection;
          const Pose T = emulator::T_scanner_block(slab.value(), cell, k);
          const auto surface =
              emulator::BlockSurface::make(recipes[truth], slab.value().at(k).block, T, scanner.projection);
          if (!surface) return false;
          const emulator::DrawnScan drawn = emulator::draw_scan(
              surface.value(), scanner,
              emulator::derived_seed(variation.seed, 40 + static_cast<std::uint64_t>(k), truth), xyz);
          algo::Cloud cloud{xyz, xyz.size() / 3, drawn.width, drawn.height};
          const emulator::StationTruth& station = slab.value().at(k);
          inspector.begin(k, cell.T_base_slab * T_slab_block(recipes[truth], k), station.T_base_flange_reported);
          if (!inspector.denoise(cloud) || !inspector.register_to_model(cloud)) {
            ++lost;
            continue;
          }
          const daemon::TopView view =
              daemon::look_at_top(cloud.xyz.first(3 * cloud.points),
                                  inspector.result().registration.T_scanner_block.inverse(), recipes[truth].block);
          for (std::size_t begun = 0; begun < recipes.size(); ++begun) {
            const daemon::SlabEnds::Finding finding = ends[begun].note(i + 1, k, view);
            if (finding.other != nullptr) found[begun] = finding.other;
          }
        }
        for (std::size_t begun = 0; begun < recipes.size(); ++begun) {
          Count& count = begun == truth ? own : other;
          ++count.slabs;
          if (found[begun] == nullptr) continue;
          ++count.refused;
          if (found[begun]->slab_type != recipes[truth].slab_type) ++count.wrong_name;
        }
      }
    const std::string what = fmt::format("field {:.0f} mm{}", field.x_mm,
                                         field.projection == emulator::Projection::perspective ? ", perspective" : "");
    table.at_most(what + fmt::format(": own type refused, of {} slabs", own.slabs), own.refused, 0, "");
    const std::string begun_wrongly = what + fmt::format(": other type refused, of {} slabs", other.slabs);
    if (field.reaches)
      table.at_least(begun_wrongly, other.refused, other.slabs, "");
    else
      table.tell(begun_wrongly, other.refused, "");
    table.at_most(what + ": named wrongly", other.wrong_name, 0, "");
    table.at_most(what + ": blocks not found", lost, 0, "");
  }
  return true;
}

}  // namespace slabd::accuracy
