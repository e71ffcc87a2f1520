// SPDX-License-Identifier: Apache-2.0
#include "report/slab_view.h"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <utility>

#include "report/figures.h"

namespace slabd::report {

using storage::SlabBlock;
using storage::SlabRecord;

namespace {

constexpr std::string_view kKeyPrefix = "key:";
constexpr std::string_view kIdPrefix = "id:";
constexpr std::string_view kNoPrefix = "no:";

/// Without blanks and NULs around it, which a SLAB_ID copied from a PLC has and a stored one does not.
std::string without_padding(const std::string& text) {
  constexpr std::string_view kPadding(" \t\r\n\0", 5);
  const std::size_t begin = text.find_first_not_of(kPadding);
  if (begin == std::string::npos) return {};
  return text.substr(begin, text.find_last_not_of(kPadding) - begin + 1);
}

}  // namespace

SlabName slab_name(const std::string& given) {
  const std::string wanted = without_padding(given);
  const bool says_key = wanted.rfind(kKeyPrefix, 0) == 0;
  const bool says_id = wanted.rfind(kIdPrefix, 0) == 0;
  const bool says_no = wanted.rfind(kNoPrefix, 0) == 0;
  SlabName name;
  const std::string rest = without_padding(wanted.substr(says_key             ? kKeyPrefix.size()
                                                         : says_id || says_no ? kIdPrefix.size()
                                                                              : 0));
  std::uint32_t no = 0;
  const auto [no_stop, no_fault] = std::from_chars(rest.data(), rest.data() + rest.size(), no);
  if (!says_key && !says_id && no_fault == std::errc{} && no_stop == rest.data() + rest.size()) name.no = no;
  if (says_no) return name;
  std::int64_t key = 0;
  const auto [stop, fault] = std::from_chars(rest.data(), rest.data() + rest.size(), key);
  // An id such as 0004 is usual for slabs; keys have no leading zeros.
  const bool id_for_sure = says_id || (!says_key && rest.starts_with('0'));
  if (!id_for_sure && fault == std::errc{} && stop == rest.data() + rest.size()) name.key = key;
  if (!says_key) name.id = rest;
  return name;
}

Error two_slabs(const SlabName& name, const SlabRecord& of_key) {
  return error(Code::config, "\"%s\" is the key of slab \"%s\", and the SLAB_ID of another one: say key:%s or id:%s",
               name.id.c_str(), of_key.summary.header.slab_id.c_str(), name.id.c_str(), name.id.c_str());
}

Result<std::optional<SlabRecord>> find_slab(storage::Reader& reader, const std::string& wanted) {
  const SlabName name = slab_name(wanted);
  std::optional<SlabRecord> of_key;
  if (name.key) {
    auto found = reader.slab(*name.key);
    if (!found) return found;
    of_key = std::move(found.value());
  }
  if (!name.id.empty()) {
    const auto of_id = reader.find_id(name.id);
    if (!of_id) return of_id.error();
    if (!of_id.value().empty() && !of_key) return reader.slab(of_id.value().front());
    if (!of_id.value().empty() && of_id.value().front() != of_key->summary.header.key) return two_slabs(name, *of_key);
  }
  if (of_key || !name.no) return of_key;
  const auto of_no = reader.find_no(*name.no);
  if (!of_no) return of_no.error();
  return of_no.value().empty() ? of_key : reader.slab(of_no.value().front());
}

const SlabBlock* latest(const SlabRecord& record, int station) {
  const SlabBlock* found = nullptr;
  for (const SlabBlock& block : record.blocks)
    if (block.attempt.station == station) found = &block;
  return found;
}

bool is_open(const SlabRecord& record) {
  return record.summary.ended_utime_us == 0;
}

bool is_aborted(const SlabRecord& record) {
  return record.summary.verdict == Verdict::aborted;
}

bool is_at_reference(const SlabRecord& record) {
  const auto has = [](const Item& item) { return has_value(item.measured); };
  return std::any_of(record.slab.items.begin(), record.slab.items.end(), has) ||
         std::any_of(record.blocks.begin(), record.blocks.end(), [&](const SlabBlock& block) {
           return std::any_of(block.block.items.begin(), block.block.items.end(), has);
         });
}

std::string disposition_word(Disposition disposition, Language language) {
  switch (disposition) {
    case Disposition::none: break;
    case Disposition::hold: return pick(language, "hold", "暂扣");
    case Disposition::release_by_concession: return pick(language, "release by concession", "让步放行");
    case Disposition::rework: return pick(language, "rework", "返工");
    case Disposition::scrap: return pick(language, "scrap", "报废");
    case Disposition::re_inspect: return pick(language, "inspect again", "复检");
  }
  return {};
}

std::string disposition_sentence(const storage::DispositionRecord& record, Language language) {
  std::string text =
      fmt::format("{}: {}, {}: {} ({} {}", record.n, disposition_word(record.decision, language),
                  local_time(record.utime_us), record.reason, pick(language, "decided by", "批准人"), record.authority);
  if (!record.second.empty()) text += fmt::format(", {} {}", pick(language, "second person", "第二人"), record.second);
  return text + fmt::format("; {} {})", pick(language, "entered by", "录入人"), record.who);
}

Shown shown(const SlabRecord& record, int station) {
  const auto i = static_cast<std::size_t>(station - 1);
  if (!is_open(record) && record.slab.station_verdict[i] != Verdict::none)
    return {record.slab.station_verdict[i], record.slab.station_reason[i]};
  const SlabBlock* block = latest(record, station);
  if (block == nullptr) return {};
  if (block->phase == StationPhase::failed) return {Verdict::not_measured, block->code};
  if (block->phase != StationPhase::measured) return {};
  // A block's pass is not final before SLAB_END, and an aborted slab is no longer judged.
  if (is_aborted(record) && block->block.verdict == Verdict::pass) return {};
  return {block->block.verdict, block->block.reason};
}

bool is_small_pore(const BlockResult& block, const SurfaceFinding& finding) {
  const Item* pores = find_item(block.items.begin(), block.items.end(), ItemId::surface_pores);
  if (finding.kind != FindingKind::pit || pores == nullptr) return false;
  const double diameter_mm = std::sqrt(4.0 / kPi * finding.area_mm2);
  return !(diameter_mm > pores->upper) && !(finding.depth_mm > block.pores.limits.depth_max_mm);
}

std::vector<SurfaceFinding> damage_of(const storage::SlabRecord& record, int station) {
  std::vector<SurfaceFinding> damage;
  const storage::SlabBlock* block = latest(record, station);
  if (block == nullptr || block->phase != StationPhase::measured) return damage;
  for (const SurfaceFinding& finding : block->block.findings)
    if (!is_small_pore(block->block, finding)) damage.push_back(finding);
  return damage;
}

bool supersedes(const Item& of_slab) {
  return has_value(of_slab.lower) || has_value(of_slab.upper);
}

std::string_view slope_datum(const SlabRecord& record) {
  const auto judges = [](const Item& item) { return item.id == ItemId::seat_slope && supersedes(item); };
  const auto& of_slab = record.slab.items;
  if (of_slab.empty()) return "";
  if (std::any_of(of_slab.begin(), of_slab.end(), judges)) return "slab_frame";
  for (const SlabBlock& block : record.blocks)
    if (std::any_of(block.block.items.begin(), block.block.items.end(), judges)) return "local_slab_top";
  return "";
}

const Item& final_item(const SlabRecord& record, int station, const Item& own) {
  for (const Item& item : record.slab.items)
    if (item.id == own.id && item.station == station && item.station_to == 0 && supersedes(item)) return item;
  return own;
}

const BlockResult* measured(const storage::SlabRecord& record, int station) {
  const storage::SlabBlock* block = latest(record, station);
  return block != nullptr && block->phase == StationPhase::measured ? &block->block : nullptr;
}

std::vector<Item> items_in_force(std::span<const BlockResult* const> blocks, const SlabResult& slab) {
  std::vector<Item> items(slab.items.begin(), slab.items.end());
  for (const BlockResult* block : blocks) {
    if (block == nullptr) continue;
    for (Item item : block->items) {
      item.station = block->station;
      const auto same = std::find_if(items.begin(), items.end(), [&](const Item& of_slab) {
        return of_slab.id == item.id && of_slab.station == item.station && of_slab.station_to == 0;
      });
      if (same == items.end()) {
        items.push_back(item);
      } else if (!supersedes(*same)) {
        *same = item;
      }
    }
  }
  return items;
}

std::vector<Item> items_in_force(const storage::SlabRecord& record) {
  std::vector<const BlockResult*> blocks;
  for (int station = 1; station <= record.summary.header.stations; ++station)
    blocks.push_back(measured(record, station));
  return items_in_force(blocks, record.slab);
}

}  // namespace slabd::report
