// SPDX-License-Identifier: Apache-2.0
//
// One ordered pass: the newest slabs by their key, and for each slab its valid attempts and its items in the order of
// the primary key, or of the index of names if only one item is wanted. The limit bounds the cost, not the size of the
// database.
#include "storage/values.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "base/limits.h"
#include "storage/rows.h"

namespace slabd::storage {
namespace {

constexpr std::int64_t kForEver = 9'000'000'000'000'000'000;
constexpr std::size_t kNotWanted = SIZE_MAX;

struct Slab {
  ItemValue value;  ///< what the values of the slab have in common
  int stations = 0;
};

/// A value before it is known whether another one replaces it.
struct Candidate {
  std::size_t list = 0;
  int rank = 0;  ///< 0: judged by SLAB_END, 1: of the block, 2: of the slab, for information
  ItemValue value;
};

std::vector<Slab> newest_slabs(Connection& db, const ItemFilter& filter) {
  std::string sql =
      "SELECT slab_key, slab_id, began_utime_us, slab_type, stations, emulated FROM slab CROSS JOIN slab_result USING "
      "(slab_key) WHERE slab_result.verdict <> 'aborted'";
  if (filter.since_utime_us || filter.until_utime_us)
    sql += " AND slab.slab_key IN (SELECT slab_key FROM slab WHERE began_utime_us >= ?2 AND began_utime_us < ?3)";
  if (filter.slab_type != 0) sql += " AND slab_type = ?4";
  if (filter.mould != 0) sql += " AND mould = ?5";
  Statement rows(db, sql + " ORDER BY slab_key DESC LIMIT ?1");
  rows.bind(1, static_cast<std::int64_t>(std::min<std::size_t>(filter.slabs, 1'000'000'000)));
  if (filter.since_utime_us || filter.until_utime_us)
    rows.bind(2, filter.since_utime_us.value_or(-kForEver)).bind(3, filter.until_utime_us.value_or(kForEver));
  if (filter.slab_type != 0) rows.bind(4, std::int64_t{filter.slab_type});
  if (filter.mould != 0) rows.bind(5, std::int64_t{filter.mould});
  std::vector<Slab> slabs;
  while (rows.step()) {
    Slab& slab = slabs.emplace_back();
    slab.value.slab_key = rows.integer(0);
    slab.value.slab_id.assign(rows.text(1));
    slab.value.began_utime_us = rows.integer(2);
    slab.value.slab_type = static_cast<std::uint16_t>(rows.integer(3));
    slab.stations = static_cast<int>(rows.integer(4));
    slab.value.emulated = static_cast<std::uint8_t>(rows.integer(5));
  }
  std::reverse(slabs.begin(), slabs.end());
  return slabs;
}

class Pass {
 public:
  Pass(Connection& db, const ItemFilter& filter, std::span<const ItemId> items)
      : items_(items),
        block_(filter.block),
        is_one_(items.size() == 1),
        lists_(items.size()),
        attempts_(db, "SELECT station, max(attempt) FROM attempt WHERE slab_key = ?1 GROUP BY station"),
        rows_(db, std::string("SELECT station, attempt, id, from_station, to_station, verdict, required, value, "
                              "nominal, lower, upper, U FROM item WHERE slab_key = ?1") +
                      (is_one_ ? " AND id = ?2" : "")),
        any_item_(db, "SELECT 1 FROM item WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3 LIMIT 1") {
    list_of_.fill(kNotWanted);
    for (std::size_t i = 0; i < items.size(); ++i) list_of_.at(static_cast<std::size_t>(items[i])) = i;
    if (is_one_) rows_.bind(2, word(items.front()));
  }

  void add(const Slab& slab) {
    valid_.fill(0);
    has_items_.fill(false);
    attempts_.bind(1, slab.value.slab_key);
    while (attempts_.step())
      valid_.at(static_cast<std::size_t>(attempts_.integer(0))) = static_cast<int>(attempts_.integer(1));
    read_candidates(slab);
    std::stable_sort(candidates_.begin(), candidates_.end(),
                     [](const Candidate& a, const Candidate& b) { return order(a) < order(b); });
    std::size_t at = 0;
    for (std::size_t list = 0; list < items_.size(); ++list) {
      std::vector<ItemValue>& values = lists_[list];
      const std::size_t first = values.size();
      for (; at < candidates_.size() && candidates_[at].list == list; ++at)
        if (values.size() == first || !is_same_place(values.back(), candidates_[at].value))
          values.push_back(candidates_[at].value);
      if (info(items_[list]).scope == ItemScope::block) add_unseen(slab, items_[list], values, first);
    }
  }

  [[nodiscard]] std::vector<std::vector<ItemValue>>& lists() { return lists_; }

 private:
  [[nodiscard]] static std::tuple<std::size_t, std::uint8_t, std::uint8_t, int> order(const Candidate& row) {
    return {row.list, row.value.item.station, row.value.item.station_to, row.rank};
  }
  [[nodiscard]] static bool is_same_place(const ItemValue& a, const ItemValue& b) {
    return a.item.station == b.item.station && a.item.station_to == b.item.station_to;
  }

  /// Reads the items of the valid attempts and of the slab.
  void read_candidates(const Slab& slab) {
    candidates_.clear();
    rows_.bind(1, slab.value.slab_key);
    while (rows_.step()) {
      const std::int64_t station = rows_.integer(0);
      if (station < 0 || station > std::int64_t{limits::kStationsMax}) rows_.refuse(0, "is not a station");
      if (station != 0 && rows_.integer(1) != valid_.at(static_cast<std::size_t>(station))) continue;
      has_items_.at(static_cast<std::size_t>(station)) = true;
      const std::optional<ItemId> id = item_from_name(rows_.stored_text(2));
      if (!id) rows_.refuse(2, "holds an unknown value");
      const std::size_t list = list_of_.at(static_cast<std::size_t>(*id));
      const std::int64_t place = station != 0 ? station : rows_.integer(3);
      if (list == kNotWanted || (block_ != 0 && place != block_)) continue;
      Candidate& row = candidates_.emplace_back(Candidate{list, 0, slab.value});
      Item& item = row.value.item;
      item.id = *id;
      item.station = static_cast<std::uint8_t>(place);
      item.station_to = static_cast<std::uint8_t>(rows_.integer(4));
      if (!from_word(rows_.text(5), item.verdict)) rows_.refuse(5, "holds an unknown value");
      item.required = rows_.integer(6) == 1;
      item.value = rows_.real(7);
      item.nominal = rows_.real(8);
      item.lower = rows_.real(9);
      item.upper = rows_.real(10);
      item.U = rows_.real(11);
      const bool is_judged = has_value(item.lower) || has_value(item.upper);
      row.rank = station != 0 ? 1 : is_judged ? 0 : 2;
    }
  }

  /// Adds a not_measured value for every station whose valid attempt has no items.
  void add_unseen(const Slab& slab, ItemId id, std::vector<ItemValue>& values, std::size_t first) {
    const std::size_t seen = values.size();
    std::size_t at = first;
    for (int station = 1; station <= slab.stations; ++station) {
      while (at < seen && values[at].item.station < station) ++at;
      const bool is_seen = at < seen && values[at].item.station == station;
      if (is_seen || (block_ != 0 && block_ != station) || has_any_item(slab.value.slab_key, station)) continue;
      ItemValue& value = values.emplace_back(slab.value);
      value.item.id = id;
      value.item.station = static_cast<std::uint8_t>(station);
      value.item.verdict = Verdict::not_measured;
    }
    if (values.size() == seen) return;
    std::stable_sort(values.begin() + static_cast<std::ptrdiff_t>(first), values.end(),
                     [](const ItemValue& a, const ItemValue& b) { return a.item.station < b.item.station; });
  }

  [[nodiscard]] bool has_any_item(std::int64_t slab_key, int station) {
    const auto k = static_cast<std::size_t>(station);
    if (has_items_.at(k)) return true;
    if (!is_one_ || valid_.at(k) == 0) return false;
    any_item_.bind(1, slab_key).bind(2, std::int64_t{station}).bind(3, std::int64_t{valid_.at(k)});
    has_items_.at(k) = any_item_.step();
    any_item_.reset();
    return has_items_.at(k);
  }

  std::span<const ItemId> items_;
  int block_;
  bool is_one_;
  std::vector<std::vector<ItemValue>> lists_;
  Statement attempts_;
  Statement rows_;
  Statement any_item_;
  std::array<std::size_t, kItemCount> list_of_{};
  std::array<int, limits::kStationsMax + 1> valid_{};  ///< by station: number of the valid attempt, 0: none
  std::array<bool, limits::kStationsMax + 1> has_items_{};
  std::vector<Candidate> candidates_;
};

}  // namespace

std::vector<std::vector<ItemValue>> read_values(Connection& db, const ItemFilter& filter,
                                                std::span<const ItemId> items) {
  const std::vector<Slab> slabs = newest_slabs(db, filter);
  Pass pass(db, filter, items);
  for (const Slab& slab : slabs) pass.add(slab);
  return std::move(pass.lists());
}

}  // namespace slabd::storage
