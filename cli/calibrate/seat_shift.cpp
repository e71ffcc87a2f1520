// SPDX-License-Identifier: Apache-2.0
#include "cli/calibrate/seat_shift.h"

#include <fmt/core.h>
#include <algorithm>
#include <memory>

#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"

namespace slabd::cli {

std::optional<Stop> find_seat_shifts(const daemon::Config& config, std::uint16_t slab_type, const Pose& before,
                                     const Pose& after, SeatShifts& out) {
  std::vector<Recipe> recipes;
  std::vector<daemon::Problem> problems;
  daemon::load_recipes(config.recipes_dir, recipes, problems);
  const auto recipe = std::find_if(recipes.begin(), recipes.end(),
                                   [&](const Recipe& r) { return slab_type == 0 || r.slab_type == slab_type; });
  if (recipe == recipes.end())
    return Stop{kBadInput,
                fmt::format("no recipe{} in {}: what changes at the slab cannot be told",
                            slab_type == 0 ? "" : fmt::format(" of slab type {}", slab_type), config.recipes_dir)};
  const auto reader = records_if_readable(config);
  if (!reader.ok()) return Stop{kNotReachable, std::string(reader.error().text.view())};
  std::unique_ptr<LineCalibration> line;
  if (reader.value() != nullptr) {
    auto read = reader.value()->line_calibration();
    if (!read.ok()) return Stop{exit_for(read.error().code), std::string(read.error().text.view())};
    line = std::move(read.value());
  }
  const StationsInForce* table = line == nullptr ? nullptr : line->table_for(recipe->slab_type);
  out.slab = fmt::format("slab type {}", recipe->slab_type);
  out.shift_max_mm = 0.0;
  for (int station = 1; station <= recipe->stations(); ++station) {
    const Pose T_base_block = config.T_base_slab * T_slab_block(*recipe, station);
    StationShift s;
    s.station = station;
    Pose T_base_flange = T_base_block * nominal_T_block_scanner() * before.inverse();
    if (table != nullptr) {
      const StationCorrection& mastered = table->table.station[static_cast<std::size_t>(station - 1)];
      s.taught = mastered.visits > 0;
      if (s.taught) T_base_flange = mastered.T_base_flange;
    }
    const Vec3 seen = (T_base_flange * before).inverse() * T_base_block.translation_mm;
    s.shift_mm =
        config.T_base_slab.rotation.conjugate() * Vec3(T_base_flange * (after * seen) - T_base_block.translation_mm);
    out.shift_max_mm = std::max(out.shift_max_mm, s.shift_mm.norm());
    out.stations.push_back(s);
  }
  return std::nullopt;
}

}  // namespace slabd::cli
