// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "cli/mould/model.h"
#include "report/content.h"
#include "report/json.h"
#include "report/table.h"
#include "storage/storage.h"

/// Ledger of the moulds in a database: the effects of every item, for each mould in each of its epochs. It never
/// affects a verdict.
namespace slabd::cli::mould {

/// One mould in one epoch, with its slabs of one type.
struct Row {
  std::uint16_t mould = 0;
  std::uint16_t slab_type = 0;  ///< 0: no slabs
  int epoch = 1;                ///< 1 until the first reset
  bool current = true;          ///< no later reset
  std::size_t slabs = 0;
  std::int64_t first_utime_us = 0;  ///< time of casting; 0 without slabs
  std::int64_t last_utime_us = 0;
};

struct Place {
  int station = 0;  ///< 0: the slab
  int station_to = 0;
  double lower = kNoValue;  ///< limits of the newest slab, as deviations from the nominal
  double upper = kNoValue;
};

/// Effects of one item on slabs of one type.
struct ItemEffects {
  ItemId item = ItemId::seat_slope;
  std::uint16_t slab_type = 0;
  std::vector<std::size_t> rows;  ///< rows of the ledger, in the order of the model's
  std::vector<Place> places;
  Model model;
};

struct Ledger {
  std::vector<Row> rows;  ///< by mould, type and epoch
  std::vector<ItemEffects> items;
  std::vector<storage::MouldReset> resets;
  std::int64_t unknown = 0;         ///< slabs of an unknown mould
  std::uint8_t emulated = 0;        ///< emulation bits of the slabs, which are all emulated or all real
  std::size_t other_emulation = 0;  ///< slabs left out, because they are emulated and the newest is real, or vice versa
};

/// True if the item is a dimension that the mould gives to the slab.
[[nodiscard]] bool is_of_mould(ItemId item);

[[nodiscard]] Ledger ledger_of(const storage::MouldRecords& records);

/// One effect of a row of the ledger.
struct Found {
  const ItemEffects* item = nullptr;
  std::size_t place = 0;
  const MouldEffect* effect = nullptr;

  [[nodiscard]] const Place& at() const { return item->places[place]; }
  [[nodiscard]] SlabsLeft left() const { return slabs_left(*effect, at().lower, at().upper); }
};
/// Effects of a row that were estimated, by item and place.
[[nodiscard]] std::vector<Found> effects_of(const Ledger& ledger, std::size_t row);

/// The document slabd.moulds/1. `mould`: only this one; 0: all.
[[nodiscard]] std::string as_json(const Ledger& ledger, std::uint16_t mould);

/// One line for each mould and epoch.
[[nodiscard]] report::Table moulds_table(const Ledger& ledger, report::Language language);
/// Effects of a row; `all`: also those without a signal.
[[nodiscard]] report::Table effects_table(const Ledger& ledger, std::size_t row, bool all, report::Language language);
/// Effects of the line with a signal.
[[nodiscard]] report::Table line_table(const Ledger& ledger, report::Language language);
/// Remarks that belong to every output: slabs without a mould, too few moulds, emulated slabs.
[[nodiscard]] std::vector<std::string> remarks_of(const Ledger& ledger, report::Language language);

/// The sheet for the fitter of a mould: what to shim at each seat.
[[nodiscard]] report::Table seats_table(const Ledger& ledger, std::size_t row, report::Language language);
[[nodiscard]] report::Report sheet_of(const Ledger& ledger, std::size_t row, report::Language language);

}  // namespace slabd::cli::mould
