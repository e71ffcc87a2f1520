// SPDX-License-Identifier: Apache-2.0
#include "report/findings.h"

#include <fmt/core.h>

#include <algorithm>
#include <map>

#include "report/figures.h"
#include "report/slab_view.h"

namespace slabd::report {
namespace {

using storage::SlabBlock;
using storage::SlabRecord;

class Collector {
 public:
  Collector(const SlabRecord& record, Language language) : record_(record), language_(language) {}

  std::vector<Finding> collect() {
    for (int station = 1; station <= record_.summary.header.stations; ++station) add_block(station);
    for (const Item& item : record_.slab.items)
      if (!said_by_block(item)) add_item(item, 0);
    add_unmeasured_items();
    std::stable_sort(list_.begin(), list_.end(), [](const Finding& a, const Finding& b) {
      const auto rank = [](Verdict v) { return v == Verdict::fail ? 0 : v == Verdict::indeterminate ? 2 : 1; };
      return rank(a.verdict) < rank(b.verdict);
    });
    list_.insert(list_.begin(), damage_.begin(), damage_.end());
    if (is_aborted(record_))
      list_.insert(list_.begin(),
                   Finding{Verdict::aborted, {}, {}, reason_sentence(record_.summary.reason, language_)});
    return std::move(list_);
  }

 private:
  /// True if the item's block already reports it.
  [[nodiscard]] bool said_by_block(const Item& item) const {
    const BlockResult* block = item.station_to == 0 && item.station != 0 ? measured(record_, item.station) : nullptr;
    return block != nullptr && find_item(block->items.begin(), block->items.end(), item.id) != nullptr;
  }

  void add_block(int station) {
    const BlockResult* block = measured(record_, station);
    if (block == nullptr) {
      add_unmeasured_block(station);
      return;
    }
    if (block->reason != 0 && block->reason < kReasonItemBase) {
      add_alike(block->verdict, station, reason_sentence(block->reason, language_));
      return;
    }
    for (const Item& item : block->items) add_item(final_item(record_, station, item), station);
    for (const SurfaceFinding& finding : damage_of(record_, station))
      damage_.push_back({Verdict::indeterminate, {station}, {}, finding_sentence(finding, language_)});
  }

  void add_unmeasured_block(int station) {
    const auto [verdict, reason] = shown(record_, station);
    if (is_open(record_) && verdict == Verdict::none) return;
    const Verdict as = verdict == Verdict::none ? Verdict::not_measured : verdict;
    const SlabBlock* block = latest(record_, station);
    const bool acquired = block != nullptr && block->phase == StationPhase::acquired;
    add_alike(as, station,
              reason != 0 ? reason_sentence(reason, language_)
              : !acquired ? pick(language_, "not scanned", "未扫描")
                          : std::string(word(is_aborted(record_) ? Word::not_measured_aborted : Word::not_measured_yet,
                                             language_)));
  }

  /// The same objection to several blocks is one entry.
  void add_alike(Verdict verdict, int station, const std::string& what) {
    const auto alike = std::find_if(list_.begin(), list_.end(), [&](const Finding& finding) {
      return finding.verdict == verdict && finding.what == what && !finding.stations.empty() && !finding.item;
    });
    if (alike != list_.end())
      alike->stations.push_back(station);
    else
      list_.push_back({verdict, {station}, {}, what});
  }

  void add_item(const Item& item, int station) {
    if (item.verdict == Verdict::pass || item.verdict == Verdict::none) return;
    if (item.verdict == Verdict::not_measured && !item.required) return;
    if (!has_value(item.value)) {
      if (station != 0)
        add_alike(item.verdict, station,
                  fmt::format("{}: {}", item_word(item.id, language_), verdict_word(item.verdict, language_)));
      else
        unmeasured_.push_back(item);
      return;
    }
    std::string what = item_word(item.id, language_);
    if (station == 0 && item.station_to != 0)
      what += fmt::format(" {}-{}", item.station, item.station_to);
    else if (station == 0 && item.station != 0)
      what += fmt::format(" {}", item.station);
    what += fmt::format(": {} {}, {} {}, U {}", value_figure(item), name(info(item.id).unit),
                        word(Word::limits, language_), limits_figure(item), U_figure(item));
    // The item's value and limit are those of the diameter alone.
    if (item.id == ItemId::surface_pores && station != 0 && measured(record_, station) != nullptr)
      what += fmt::format(" ({})", pore_sentence(measured(record_, station)->pores, language_));
    std::vector<int> stations;
    if (station != 0) stations.push_back(station);
    list_.push_back({item.verdict, stations, item, what});
  }

  /// One sentence for the items of the slab that have no value, because blocks are missing.
  void add_unmeasured_items() {
    if (unmeasured_.empty()) return;
    std::map<ItemId, int> counts;
    for (const Item& item : unmeasured_) ++counts[item.id];
    std::string names;
    for (const auto& [id, count] : counts)
      names += fmt::format("{}{}{}", names.empty() ? "" : pick(language_, ", ", "，"), item_word(id, language_),
                           count > 1 ? fmt::format(" ({})", count) : "");
    list_.push_back(
        {Verdict::not_measured,
         {},
         {},
         fmt::format(fmt::runtime(pick(language_, "items of the slab not measured: {}", "整板项目未测量：{}")),
                     names)});
  }

  const SlabRecord& record_;
  Language language_;
  std::vector<Finding> list_;
  std::vector<Finding> damage_;
  std::vector<Item> unmeasured_;
};

}  // namespace

std::vector<Finding> findings_of(const SlabRecord& record, Language language) {
  return Collector(record, language).collect();
}

std::string ranges_text(const std::vector<int>& numbers) {
  std::string text;
  for (std::size_t i = 0; i < numbers.size();) {
    std::size_t end = i;
    while (end + 1 < numbers.size() && numbers[end + 1] == numbers[end] + 1) ++end;
    if (end == i + 1) end = i;  // "3, 4" rather than "3-4"
    text += fmt::format("{}{}", text.empty() ? "" : ", ", numbers[i]);
    if (end > i) text += fmt::format("-{}", numbers[end]);
    i = end + 1;
  }
  return text;
}

std::string sentence_of(const Finding& finding, Language language) {
  if (finding.stations.empty()) return finding.what;
  const std::string place = finding.stations.size() == 1
                                ? fmt::format(fmt::runtime(word(Word::block, language)), finding.stations.front())
                                : fmt::format("{} {}", word(Word::blocks, language), ranges_text(finding.stations));
  return fmt::format("{}{}{}", place, finding.item ? ", " : ": ", finding.what);
}

bool is_objected(const std::vector<Finding>& findings, int station) {
  return std::any_of(findings.begin(), findings.end(), [&](const Finding& finding) {
    return std::find(finding.stations.begin(), finding.stations.end(), station) != finding.stations.end() ||
           (finding.item && (finding.item->station == station || finding.item->station_to == station));
  });
}

}  // namespace slabd::report
