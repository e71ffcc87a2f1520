// SPDX-License-Identifier: Apache-2.0
#include "cli/slab_view.h"

#include <charconv>

namespace slabd::cli {

using storage::SlabBlock;
using storage::SlabRecord;

Result<std::optional<SlabRecord>> find_slab(storage::Reader& reader, const std::string& wanted) {
  std::int64_t key = 0;
  const auto [stop, fault] = std::from_chars(wanted.data(), wanted.data() + wanted.size(), key);
  if (fault == std::errc{} && stop == wanted.data() + wanted.size()) {
    auto by_key = reader.slab(key);
    if (!by_key || by_key.value().has_value()) return by_key;
  }
  const auto by_id = reader.find(wanted);
  if (!by_id) return by_id.error();
  if (!by_id.value()) return std::optional<SlabRecord>{};
  return reader.slab(*by_id.value());
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

Shown shown(const SlabRecord& record, int station) {
  const auto i = static_cast<std::size_t>(station - 1);
  if (!is_open(record) && record.slab.station_verdict[i] != Verdict::none)
    return {record.slab.station_verdict[i], record.slab.station_reason[i]};
  const SlabBlock* block = latest(record, station);
  if (block == nullptr) return {};
  if (block->phase == StationPhase::failed) return {Verdict::not_measured, block->code};
  if (block->phase != StationPhase::measured) return {};
  return {block->block.verdict, block->block.reason};
}

const Item& final_item(const SlabRecord& record, int station, const Item& own) {
  for (const Item& item : record.slab.items)
    if (item.id == own.id && item.station == station && item.station_to == 0) return item;
  return own;
}

}  // namespace slabd::cli
