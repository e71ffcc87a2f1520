// SPDX-License-Identifier: Apache-2.0
//
// Rows, places and observations from the stored values; the JSON document.
#include "cli/mould/ledger.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <span>
#include <tuple>

namespace slabd::cli::mould {
namespace {

constexpr double kDay_us = 86'400e6;
constexpr std::size_t kLeftOut = SIZE_MAX;

/// Epoch of a slab: one more than the resets of its mould until it was cast.
int epoch_of(const storage::MouldSlab& slab, const std::vector<storage::MouldReset>& resets) {
  return 1 + static_cast<int>(std::count_if(resets.begin(), resets.end(), [&](const storage::MouldReset& reset) {
           return reset.mould == slab.mould && reset.from_utime_us <= slab.cast_utime_us;
         }));
}

/// Rows by mould, type and epoch, and the row of each slab. An epoch without slabs has a row as well, so that a reset
/// is visible at once.
std::vector<std::size_t> add_rows(const storage::MouldRecords& records, Ledger& ledger) {
  using Key = std::tuple<std::uint16_t, std::uint16_t, int>;
  std::map<Key, Row> rows;
  std::vector<Key> key_of;
  std::map<std::uint16_t, int> last;
  for (const storage::MouldReset& reset : records.resets) ++last[reset.mould];
  for (const storage::MouldSlab& slab : records.slabs) {
    const int epoch = epoch_of(slab, records.resets);
    key_of.emplace_back(slab.mould, slab.slab_type, epoch);
    Row& row = rows[key_of.back()];
    row.mould = slab.mould;
    row.slab_type = slab.slab_type;
    row.epoch = epoch;
    ++row.slabs;
    row.first_utime_us = row.slabs == 1 ? slab.cast_utime_us : std::min(row.first_utime_us, slab.cast_utime_us);
    row.last_utime_us = std::max(row.last_utime_us, slab.cast_utime_us);
  }
  for (const auto& [mould, resets] : last) {
    const bool any = std::any_of(rows.begin(), rows.end(), [&](const auto& row) {
      return row.second.mould == mould && row.second.epoch == resets + 1;
    });
    if (any) continue;
    Row& row = rows[{mould, 0, resets + 1}];
    row.mould = mould;
    row.epoch = resets + 1;
  }
  std::map<Key, std::size_t> index;
  for (auto& [key, row] : rows) {
    row.current = row.epoch == last[row.mould] + 1;
    index[key] = ledger.rows.size();
    ledger.rows.push_back(row);
  }
  std::vector<std::size_t> row_of;
  row_of.reserve(key_of.size());
  for (const Key& key : key_of) row_of.push_back(index.at(key));
  return row_of;
}

/// Observations of one item of one slab type while they are collected.
class Collected {
 public:
  void add(const storage::MouldValue& value, std::size_t row, std::uint16_t mould, double day) {
    if (row >= row_at_.size()) row_at_.resize(row + 1, -1);
    if (row_at_[row] < 0) {
      row_at_[row] = static_cast<int>(effects.rows.size());
      effects.rows.push_back(row);
      observations.mould.push_back(mould);
    }
    int& place = place_at_.at(value.station).at(value.station_to);
    if (place < 0) {
      place = static_cast<int>(effects.places.size());
      effects.places.push_back({value.station, value.station_to, kNoValue, kNoValue});
    }
    Place& at = effects.places[static_cast<std::size_t>(place)];
    if (!std::isnan(value.lower)) at.lower = static_cast<double>(value.lower);
    if (!std::isnan(value.upper)) at.upper = static_cast<double>(value.upper);
    observations.values.push_back({static_cast<std::uint32_t>(row_at_[row]), static_cast<std::uint32_t>(place),
                                   static_cast<double>(value.deviation), day});
  }

  /// Sorts the places by station.
  void sort_places() {
    std::vector<std::uint32_t> now(effects.places.size());
    std::vector<Place> sorted;
    for (const auto& of_station : place_at_)
      for (const int place : of_station) {
        if (place < 0) continue;
        now[static_cast<std::size_t>(place)] = static_cast<std::uint32_t>(sorted.size());
        sorted.push_back(effects.places[static_cast<std::size_t>(place)]);
      }
    effects.places = std::move(sorted);
    for (Observation& observation : observations.values) observation.place = now[observation.place];
  }

  ItemEffects effects;
  Observations observations;

 private:
  using OfStation = std::array<int, limits::kStationsMax + 1>;
  static constexpr std::array<OfStation, limits::kStationsMax + 1> no_places() {
    std::array<OfStation, limits::kStationsMax + 1> none{};
    for (OfStation& of_station : none) of_station.fill(-1);
    return none;
  }

  std::vector<int> row_at_;                                                 ///< [row of the ledger]; -1: not seen
  std::array<OfStation, limits::kStationsMax + 1> place_at_ = no_places();  ///< [station][station_to]
};

using ItemsOfType = std::array<Collected, kItemCount>;

/// Slabs in the order of casting, which differs from that of the keys if a slab was inspected late.
std::vector<std::size_t> by_casting(const storage::MouldRecords& records) {
  std::vector<std::size_t> order(records.slabs.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return records.slabs[a].cast_utime_us < records.slabs[b].cast_utime_us;
  });
  return order;
}

std::span<const storage::MouldValue> values_of(const storage::MouldRecords& records, std::size_t slab) {
  const auto before = [](const storage::MouldValue& value, std::size_t key) { return value.slab < key; };
  const auto begin = std::lower_bound(records.values.begin(), records.values.end(), slab, before);
  return {begin, std::lower_bound(begin, records.values.end(), slab + 1, before)};
}

void write_effect(report::Json& json, const ItemEffects& item, const Place& place, const Effect& effect) {
  json.field("item", info(item.item).name).field("unit", slabd::name(info(item.item).unit));
  json.field("station", report::only_if(place.station != 0, place.station));
  json.field("station_to", report::only_if(place.station_to != 0, place.station_to));
  json.field("n", effect.n).field("bias", effect.bias).field("u", effect.u).field("U", effect.U);
  json.field("signal", name(effect.signal));
}

void write_row(report::Json& json, const Ledger& ledger, std::size_t index) {
  const Row& row = ledger.rows[index];
  json.field("mould", row.mould).field("epoch", row.epoch).field("current", row.current);
  json.field("slab_type", report::only_if(row.slab_type != 0, row.slab_type)).field("slabs", row.slabs);
  json.field("first_utime", report::only_if(row.slabs != 0, row.first_utime_us));
  json.field("last_utime", report::only_if(row.slabs != 0, row.last_utime_us));
  json.list("effects", effects_of(ledger, index), [&](const Found& found) {
    const MouldEffect& effect = *found.effect;
    write_effect(json, *found.item, found.at(), effect);
    json.field("separable", found.item->model.separates(found.place));
    json.field("ewma", effect.ewma).field("ewma_u", effect.ewma_u);
    json.field("drift_per_100", effect.drift_per_100).field("drift_per_100_u", effect.drift_per_100_u);
    json.field("drifts", effect.drifts);
    const SlabsLeft left = found.left();
    json.field("slabs_to_limit", left.slabs).field("slabs_to_limit_u", left.u);
  });
}

}  // namespace

bool is_of_mould(ItemId item) {
  return item != ItemId::seat_std && item != ItemId::surface_pores && item != ItemId::block_damage;
}

Ledger ledger_of(const storage::MouldRecords& records) {
  Ledger ledger;
  ledger.resets = records.resets;
  ledger.unknown = records.unknown;
  const bool emulated = !records.slabs.empty() && records.slabs.back().emulated != 0;
  storage::MouldRecords chosen;
  chosen.resets = records.resets;
  std::vector<std::size_t> index(records.slabs.size(), kLeftOut);
  for (std::size_t i = 0; i < records.slabs.size(); ++i) {
    const storage::MouldSlab& slab = records.slabs[i];
    if ((slab.emulated != 0) != emulated) {
      ++ledger.other_emulation;
      continue;
    }
    ledger.emulated = static_cast<std::uint8_t>(ledger.emulated | slab.emulated);
    index[i] = chosen.slabs.size();
    chosen.slabs.push_back(slab);
  }
  const std::vector<std::size_t> row_of = add_rows(chosen, ledger);
  std::map<std::uint16_t, std::unique_ptr<ItemsOfType>> types;
  for (const std::size_t i : by_casting(records)) {
    if (index[i] == kLeftOut) continue;
    const storage::MouldSlab& slab = records.slabs[i];
    const double day = static_cast<double>(slab.cast_utime_us - chosen.slabs.front().cast_utime_us) / kDay_us;
    std::unique_ptr<ItemsOfType>& items = types[slab.slab_type];
    if (!items) items = std::make_unique<ItemsOfType>();
    for (const storage::MouldValue& value : values_of(records, i))
      if (is_of_mould(value.item))
        (*items)[static_cast<std::size_t>(value.item)].add(value, row_of[index[i]], slab.mould, day);
  }
  for (auto& [type, items] : types)
    for (std::size_t i = 0; i < kItemCount; ++i) {
      Collected& item = (*items)[i];
      if (item.effects.rows.empty()) continue;
      item.sort_places();
      item.effects.slab_type = type;
      item.effects.item = static_cast<ItemId>(i);
      item.observations.places = item.effects.places.size();
      item.effects.model = fit(item.observations);
      ledger.items.push_back(std::move(item.effects));
      item = {};
    }
  return ledger;
}

std::vector<Found> effects_of(const Ledger& ledger, std::size_t row) {
  std::vector<Found> list;
  for (const ItemEffects& item : ledger.items) {
    const auto at = std::find(item.rows.begin(), item.rows.end(), row);
    if (at == item.rows.end()) continue;
    const auto own = static_cast<std::size_t>(at - item.rows.begin());
    for (std::size_t place = 0; place < item.places.size(); ++place)
      if (const MouldEffect& effect = item.model.at(own, place); effect.n > 0) list.push_back({&item, place, &effect});
  }
  return list;
}

std::string as_json(const Ledger& ledger, std::uint16_t mould) {
  report::Json json("slabd.moulds/1");
  json.field("unknown_mould_slabs", ledger.unknown);
  report::write_emulation(json, ledger.emulated);
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < ledger.rows.size(); ++i)
    if (mould == 0 || ledger.rows[i].mould == mould) rows.push_back(i);
  json.list("moulds", rows, [&](std::size_t row) { write_row(json, ledger, row); });
  std::vector<std::pair<const ItemEffects*, std::size_t>> line;
  for (const ItemEffects& item : ledger.items)
    for (std::size_t place = 0; place < item.model.line.size(); ++place) line.emplace_back(&item, place);
  json.list("line_effects", line, [&](const auto& at) {
    const auto& [item, place] = at;
    json.field("slab_type", item->slab_type);
    write_effect(json, *item, item->places[place], item->model.line[place]);
    json.field("moulds", item->model.moulds[place]);
  });
  json.list("resets", ledger.resets, [&](const storage::MouldReset& reset) {
    json.field("mould", reset.mould).field("from_utime", reset.from_utime_us).field("who", reset.note.who);
    json.field("why", reset.note.why).field("utime", reset.note.utime_us);
  });
  return json.text();
}

}  // namespace slabd::cli::mould
