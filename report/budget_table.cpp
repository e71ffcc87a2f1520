// SPDX-License-Identifier: Apache-2.0
//
// Where U comes from: of every characteristic the one with the largest U, block items by their block. All of them, 260
// lines, stand in `slabctl show --json` and nobody reads them on paper.
#include <fmt/core.h>

#include <array>

#include "report/budget_text.h"
#include "report/content.h"
#include "report/figures.h"
#include "report/slab_view.h"

namespace slabd::cli::report {
namespace {

struct Largest {
  std::array<const Item*, kItemCount> item{};
  std::array<int, kItemCount> station{};

  void take(const Item& candidate, int of_station) {
    if (!has_budget(candidate) || !has_value(candidate.value)) return;
    const auto i = static_cast<std::size_t>(candidate.id);
    if (item[i] != nullptr && !(candidate.U > item[i]->U)) return;
    item[i] = &candidate;
    station[i] = of_station;
  }
};

std::string place(const Item& item, int station) {
  if (item.station_to != 0) return fmt::format("{}-{}", item.station, item.station_to);
  return station == 0 ? "-" : std::to_string(station);
}

/// Has this block an item of its own for the slab's?
bool is_of_block(const storage::SlabRecord& record, const Item& of_slab) {
  const storage::SlabBlock* block = of_slab.station_to == 0 ? latest(record, of_slab.station) : nullptr;
  return block != nullptr && block->phase == StationPhase::measured &&
         find_item(block->block.items.begin(), block->block.items.end(), of_slab.id) != nullptr;
}

}  // namespace

std::optional<Table> budget_table(const storage::SlabRecord& record, Language language) {
  Largest largest;
  // As everywhere: of a block and the slab the item that was judged; one for information where there is no other.
  for (const Item& item : record.slab.items)
    if (supersedes(item) || !is_of_block(record, item)) largest.take(item, item.station);
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const storage::SlabBlock* block = latest(record, station);
    if (block == nullptr || block->phase != StationPhase::measured) continue;
    for (const Item& item : block->block.items)
      if (&final_item(record, station, item) == &item) largest.take(item, station);
  }
  const auto say = [&](Word which) { return std::string(word(which, language)); };
  Table table;
  table.title = say(Word::budget);
  table.columns = {say(Word::characteristic) + "<", say(Word::block_column) + "<", say(Word::unit) + "<", "U, k = 2"};
  for (const Word part : {Word::budget_fit, Word::budget_noise, Word::budget_scanner, Word::budget_registration,
                          Word::budget_calibration, Word::budget_robot, Word::budget_reference})
    table.columns.push_back(say(part));
  for (std::size_t i = 0; i < kItemCount; ++i) {
    if (largest.item[i] == nullptr) continue;
    const Item& item = *largest.item[i];
    table.add(item_word(item.id, language), place(item, largest.station[i]), name(info(item.id).unit), U_figure(item));
    for (const std::string& part : budget_figures(item)) table.rows.back().emplace_back(part);
  }
  if (table.rows.empty()) return std::nullopt;
  return table;
}

}  // namespace slabd::cli::report
