// SPDX-License-Identifier: Apache-2.0
#include "base/plc.h"

#include <cassert>

namespace slabd {
namespace {

double deviation_of(const BlockResult& block, ItemId id) {
  const Item* item = find_item(block.items.begin(), block.items.end(), id);
  return item == nullptr ? kNoValue : item->deviation();
}

struct Worst {
  double deviation = kNoValue;
  double station = kNoValue;
};

/// Returns the item with the largest absolute deviation; the first of equals.
Worst worst_of(const SlabResult& slab, ItemId id) {
  Worst worst;
  for (const Item& item : slab.items) {
    if (item.id != id || !has_value(item.value)) continue;
    if (!has_value(worst.deviation) || std::abs(item.deviation()) > std::abs(worst.deviation))
      worst = {item.deviation(), static_cast<double>(item.station)};
  }
  return worst;
}

bool has_limits(const Item& item) {
  return has_value(item.lower) || has_value(item.upper);
}

double slab_deviation(const SlabResult& slab, ItemId id) {
  const Item* item = find_item(slab.items.begin(), slab.items.end(), id);
  return item == nullptr ? kNoValue : item->deviation();
}

}  // namespace

PlcResult station_record(const BlockResult& block) {
  PlcResult record;
  record.kind = 1;
  record.station = block.station;
  record.verdict = block.verdict;
  record.reason = block.reason;
  record.fail_mask = fail_mask(block.items.begin(), block.items.end());
  record.open_mask = open_mask(block.items.begin(), block.items.end());
  record.flatness_mm = block.seat.flatness_mm;
  record.std_mm = block.seat.plane.std_mm;
  record.points = static_cast<std::uint32_t>(block.scan.points_kept);
  constexpr std::array kOrder = {ItemId::seat_slope,
                                 ItemId::jaw_angle_inner,
                                 ItemId::jaw_angle_outer,
                                 ItemId::jaw_distance,
                                 ItemId::casing_spacing,
                                 ItemId::casing_protrusion_inner,
                                 ItemId::casing_protrusion_outer,
                                 ItemId::casing_skew_inner,
                                 ItemId::casing_skew_outer};
  for (std::size_t i = 0; i < kOrder.size(); ++i) record.deviation[i] = deviation_of(block, kOrder[i]);
  return record;
}

PlcResult station_record(const BlockResult& block, const SlabResult& slab) {
  PlcResult record = station_record(block);
  const std::size_t index = block.station - 1U;
  assert(index < slab.station_verdict.size());
  record.verdict = slab.station_verdict[index];
  record.reason = slab.station_reason[index];
  struct Place {
    ItemId id;
    std::size_t deviation;  ///< index from IR 42
  };
  for (const Place& place :
       {Place{ItemId::seat_slope, 0}, Place{ItemId::seat_lateral, 9}, Place{ItemId::seat_vertical, 10}}) {
    const Item* item = find_item(slab.items.begin(), slab.items.end(), place.id, block.station);
    if (item == nullptr) continue;
    // There are two slopes: the one in the slab frame replaces the one against the local slab top, unless only the
    // latter is judged.
    const Item* local = find_item(block.items.begin(), block.items.end(), place.id);
    if (local != nullptr && has_limits(*local) && !has_limits(*item)) continue;
    record.deviation[place.deviation] = item->deviation();
    const std::uint16_t failed = fail_mask(item, item + 1);
    const std::uint16_t open = open_mask(item, item + 1);
    if (local != nullptr) {
      record.fail_mask = static_cast<std::uint16_t>(record.fail_mask & ~fail_mask(local, local + 1));
      record.open_mask = static_cast<std::uint16_t>(record.open_mask & ~open_mask(local, local + 1));
    }
    record.fail_mask = static_cast<std::uint16_t>(record.fail_mask | failed);
    record.open_mask = static_cast<std::uint16_t>(record.open_mask | open);
  }
  return record;
}

PlcResult slab_record(const SlabResult& slab, int stations) {
  PlcResult record;
  record.kind = 2;
  record.verdict = slab.verdict;
  record.reason = slab.reason;
  record.fail_mask = slab.fail_mask;
  record.open_mask = slab.open_mask;
  const Worst spacing = worst_of(slab, ItemId::seat_spacing);
  const Worst large_jaw = worst_of(slab, ItemId::large_jaw_distance);
  const Worst slope = worst_of(slab, ItemId::seat_slope);
  const Worst lateral = worst_of(slab, ItemId::seat_lateral);
  const Worst vertical = worst_of(slab, ItemId::seat_vertical);
  int failed = 0;
  for (int s = 0; s < stations; ++s)
    failed += slab.station_verdict[static_cast<std::size_t>(s)] == Verdict::fail ? 1 : 0;
  record.deviation = {slab_deviation(slab, ItemId::corner_level),
                      slab_deviation(slab, ItemId::warp_left),
                      slab_deviation(slab, ItemId::warp_right),
                      spacing.deviation,
                      spacing.station,
                      large_jaw.deviation,
                      large_jaw.station,
                      slope.deviation,
                      slope.station,
                      lateral.deviation,
                      lateral.station,
                      vertical.deviation,
                      vertical.station,
                      static_cast<double>(failed)};
  return record;
}

}  // namespace slabd
