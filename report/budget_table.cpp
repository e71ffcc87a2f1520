// SPDX-License-Identifier: Apache-2.0
//
// The largest U of each characteristic, with its parts; block items name their block. The full budget of about 260
// lines is in `slabctl show --json`, because it is too long for paper.
#include <fmt/core.h>

#include <array>

#include "report/budget_text.h"
#include "report/content.h"
#include "report/figures.h"
#include "report/slab_view.h"

namespace slabd::report {
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

/// True if the slab item's block has an item of its own of the same kind.
bool is_of_block(const storage::SlabRecord& record, const Item& of_slab) {
  const storage::SlabBlock* block = of_slab.station_to == 0 ? latest(record, of_slab.station) : nullptr;
  return block != nullptr && block->phase == StationPhase::measured &&
         find_item(block->block.items.begin(), block->block.items.end(), of_slab.id) != nullptr;
}

}  // namespace

std::optional<Table> budget_table(const storage::SlabRecord& record, Language language) {
  Largest largest;
  // As in the other reports, of a block's and a slab's item the judged one is used. An item for information is used
  // only if it is the only one.
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
  for (const Word part :
       {Word::budget_fit, Word::budget_noise, Word::budget_scanner, Word::budget_registration, Word::budget_calibration,
        Word::budget_robot, Word::budget_reference, Word::budget_thermal, Word::budget_gauge})
    table.columns.push_back(say(part));
  const bool tied = !record.summary.header.tie_id.empty();
  if (tied) table.columns.push_back(say(Word::budget_tie));
  for (std::size_t i = 0; i < kItemCount; ++i) {
    if (largest.item[i] == nullptr) continue;
    const Item& item = *largest.item[i];
    table.add(item_word(item.id, language), place(item, largest.station[i]), name(info(item.id).unit), U_figure(item));
    for (const std::string& part : budget_figures(item, tied)) table.rows.back().emplace_back(part);
  }
  if (table.rows.empty()) return std::nullopt;
  return table;
}

}  // namespace slabd::report
