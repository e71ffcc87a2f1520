// SPDX-License-Identifier: Apache-2.0
//
// Problem: before a limit is changed, find the number of stored slabs with another verdict, and the items that cause
// it. Each item counts once per slab and place. A slope is judged by the block (own slab top) and by the slab (its
// frame); the slab's judgement counts if there is one.
#include "cli/replay/what_if.h"

#include <fmt/core.h>

#include <algorithm>

#include "report/figures.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

const Item* same_place(const std::vector<Item>& items, const Item& wanted) {
  for (const Item& item : items)
    if (item.id == wanted.id && item.station == wanted.station && item.station_to == wanted.station_to) return &item;
  return nullptr;
}

std::string place_words(const Item& item) {
  if (item.station == 0) return "";
  return item.station_to == 0 ? fmt::format(" {}", item.station) : fmt::format(" {}-{}", item.station, item.station_to);
}

double share(const VerdictTally& tally) {
  return tally.count == 0 ? kNoValue : static_cast<double>(tally.changed()) / tally.count;
}

std::string percent(const VerdictTally& tally) {
  return tally.count == 0 ? "-" : fmt::format("{:.1f} %", 100.0 * share(tally));
}

std::string change_words(const VerdictTally& tally) {
  std::string words;
  for (const auto& [pair, count] : tally.changes)
    words += fmt::format("{}{} -> {}: {}", words.empty() ? "" : ", ", name(pair.first), name(pair.second), count);
  return words;
}

void write_tally(report::Json& json, const VerdictTally& tally) {
  json.field("count", tally.count).field("changed", tally.changed()).field("share_changed", share(tally));
  json.key("changes").begin_array();
  for (const auto& [pair, count] : tally.changes)
    json.begin_object().field("stored", pair.first).field("now", pair.second).field("count", count).end_object();
  json.end_array();
}

void write_items(report::Json& json, const std::array<VerdictTally, kItemCount>& items) {
  json.key("items").begin_array();
  for (std::size_t i = 0; i < kItemCount; ++i) {
    if (items[i].count == 0) continue;
    json.begin_object().field("id", info(static_cast<ItemId>(i)).name);
    write_tally(json, items[i]);
    json.end_object();
  }
  json.end_array();
}

/// Fields of a slab whose verdict, or that of an item, changed.
void write_changed(report::Json& json, const WhatIfSlab& slab) {
  json.field("key", slab.key).field("slab_id", slab.slab_id).field("stored", slab.stored).field("now", slab.now);
  json.list("items", slab.changed, [&](const WhatIfSlab::ChangedItem& changed) {
    const auto& [then, now] = changed;
    json.field("id", info(then.id).name).field("station", then.station).field("station_to", then.station_to);
    for (const auto& [key, item] : {std::pair{"stored", &then}, std::pair{"now", &now}}) {
      json.key(key).begin_object().field("value", item->value).field("U", item->U).field("lower", item->lower);
      json.field("upper", item->upper).field("verdict", item->verdict).end_object();
    }
  });
}

/// The item with -0 replaced by 0, as SQLite stores it. JSON readers do not keep the sign of a zero, and a slab that
/// was read from a shard's file must print the same.
Item without_negative_zero(Item item) {
  for (double* figure : {&item.value, &item.U, &item.lower, &item.upper}) *figure += 0.0;
  return item;
}

}  // namespace

void VerdictTally::add(Verdict stored, Verdict now) {
  ++count;
  if (stored != now) ++changes[{stored, now}];
}

void VerdictTally::add(const VerdictTally& other) {
  count += other.count;
  for (const auto& [pair, count_of_pair] : other.changes) changes[pair] += count_of_pair;
}

int VerdictTally::changed() const {
  int sum = 0;
  for (const auto& [pair, count_of_pair] : changes) sum += count_of_pair;
  return sum;
}

WhatIfSlab judged_slab(const storage::SlabRecord& stored, std::span<const StationRecord> stations,
                       const SlabResult& now) {
  std::vector<const BlockResult*> blocks_now;
  for (std::size_t i = 0; i < stations.size(); ++i)
    blocks_now.push_back(report::measured(stored, static_cast<int>(i + 1)) != nullptr ? &stations[i].block : nullptr);
  const std::vector<Item> items_then = report::items_in_force(stored);
  const std::vector<Item> items_now = report::items_in_force(blocks_now, now);

  WhatIfSlab slab;
  slab.key = stored.summary.header.key;
  slab.slab_id = stored.summary.header.slab_id.view();
  slab.stored = stored.summary.verdict;
  slab.now = now.verdict;
  for (const Item& then : items_then) {
    const Item* item = same_place(items_now, then);
    if (item == nullptr) continue;
    slab.items[static_cast<std::size_t>(then.id)].add(then.verdict, item->verdict);
    if (then.verdict != item->verdict)
      slab.changed.push_back({without_negative_zero(then), without_negative_zero(*item)});
  }
  return slab;
}

WhatIfSlab left_out_slab(const SlabHeader& slab, std::string why) {
  WhatIfSlab out;
  out.key = slab.key;
  out.slab_id = slab.slab_id.view();
  out.left_out = std::move(why);
  return out;
}

void write_slab(report::Json& json, const WhatIfSlab& slab) {
  json.begin_object().field("left_out", slab.left_out).key("slab").begin_object();
  write_changed(json, slab);
  json.end_object();
  write_items(json, slab.items);
  json.end_object();
}

void WhatIf::add(WhatIfSlab slab) {
  if (!slab.left_out.empty()) {
    left_out_.push_back(std::move(slab));
    return;
  }
  slabs_.add(slab.stored, slab.now);
  for (std::size_t i = 0; i < kItemCount; ++i) items_[i].add(slab.items[i]);
  slab.items = {};
  if (slab.stored != slab.now || !slab.changed.empty()) changed_.push_back(std::move(slab));
}

std::string WhatIf::text(report::Style style) const {
  report::Table items{"item", "values", "changed", "share", "changes<"};
  const auto add = [&](std::string_view what, const VerdictTally& tally) {
    items.add(what, tally.count, tally.changed(), percent(tally), change_words(tally));
  };
  for (std::size_t i = 0; i < kItemCount; ++i)
    if (items_[i].count > 0) add(info(static_cast<ItemId>(i)).name, items_[i]);
  add("slab verdict", slabs_);
  std::string text = report::text_of(items);
  if (!changed_.empty()) {
    report::Table changed{"key", "id<", "stored<", "now<", "items whose verdict changes<"};
    for (const WhatIfSlab& slab : changed_) {
      std::string which;
      constexpr std::size_t kNamed = 4;
      for (std::size_t i = 0; i < std::min(slab.changed.size(), kNamed); ++i) {
        const auto& [then, now] = slab.changed[i];
        which += fmt::format("{}{}{} {} -> {}", which.empty() ? "" : ", ", info(then.id).name, place_words(then),
                             name(then.verdict), name(now.verdict));
      }
      if (slab.changed.size() > kNamed) which += fmt::format(" and {} more", slab.changed.size() - kNamed);
      changed.add(slab.key, slab.slab_id, slab.stored, slab.now, which);
    }
    text += "\n" + report::text_of(changed, style);
  }
  for (const WhatIfSlab& slab : left_out_)
    text += fmt::format("left out: slab {} \"{}\": {}\n", slab.key, slab.slab_id, slab.left_out);
  return text;
}

void WhatIf::write(report::Json& json) const {
  json.key("slabs").begin_object();
  write_tally(json, slabs_);
  json.end_object();
  write_items(json, items_);
  json.list("changed", changed_, [&](const WhatIfSlab& slab) { write_changed(json, slab); });
  json.list("left_out", left_out_, [&](const WhatIfSlab& slab) {
    json.field("key", slab.key).field("slab_id", slab.slab_id).field("why", slab.left_out);
  });
}

}  // namespace slabd::cli
