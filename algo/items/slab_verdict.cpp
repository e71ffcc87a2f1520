// SPDX-License-Identifier: Apache-2.0
//
// Assignment of verdicts. A station's verdict covers its own items and the slab items that it spoils; the slab's
// verdict covers everything. Nothing passes by default: a station without a block, a block without items and a slab
// without stations are not measured.
#include <algorithm>
#include <array>
#include <cmath>

#include "algo/items/slab_seats.h"
#include "base/rules.h"

namespace slabd::algo {
namespace {

/// A station's own items and its slab items: slope, lateral, vertical, two spacings, one large jaw.
constexpr std::size_t kStationItemsMax = kBlockItemsMax + 6;

using StationItems = FixedVector<Item, kStationItemsMax>;

/// Deviation of a seat from its own position, as far as it affects an item between it and `other`.
double out_of_place_mm(const Seat& seat, const Seat& other, const Item& item) {
  if (item.id != ItemId::large_jaw_distance) {
    // The seats are at the slab's temperature. Of a spacing, measured / value is the expansion since the reference.
    const double expanded = has_value(item.measured) ? item.measured / item.value : 1.0;
    return std::abs(seat.p.x() - expanded * seat.nominal.x());
  }
  // Half of the nominal on both sides of the middle; in a curve slab that is not the slab's axis.
  const double middle_y = 0.5 * (seat.nominal.y() + other.nominal.y());
  return std::abs(std::abs(seat.jaw_outer.y() - middle_y) - 0.5 * item.nominal);
}

/// True if this slab item counts for this station. An item between two stations counts for the one that spoils it: the
/// one not measured, or the one further from its position. The neighbour is not affected.
bool counts_for(const Seats& seats, const Item& item, int station) {
  if (item.station != station && item.station_to != station) return false;
  if (item.station_to == 0 || item.verdict == Verdict::pass) return true;
  const Seat& own = seats[station];
  const Seat& other = seats[item.station + item.station_to - station];
  const bool jaw = item.id == ItemId::large_jaw_distance;
  const bool own_ok = jaw ? own.jaw_ok : own.ok;
  const bool other_ok = jaw ? other.jaw_ok : other.ok;
  if (own_ok != other_ok) return !own_ok;
  if (!own_ok) return true;
  return out_of_place_mm(own, other, item) >= out_of_place_mm(other, own, item);
}

/// All items that decide one station: its block items and the slab items that count for it. Of the two slopes it is the
/// one that the recipe chooses.
StationItems items_of_station(const Recipe& recipe, const BlockResult* block, const Seats& seats,
                              const SlabResult& slab, int station) {
  StationItems items;
  const bool local = recipe.slope_datum == SlopeDatum::local_slab_top;
  if (block != nullptr) {
    for (const Item& item : block->items)
      if (item.id != ItemId::seat_slope || local) (void)items.push(item);
  }
  for (const Item& item : slab.items)
    if (counts_for(seats, item, station) && (item.id != ItemId::seat_slope || !local)) (void)items.push(item);
  return items;
}

/// The code that explains a block without a result; ok if its items explain it.
Code cause_of(const BlockResult* block) {
  if (block == nullptr) return Code::block_not_found;
  if (block->items.empty() && block->reason == 0) return Code::fit_failed;
  const bool by_item = block->reason == 0 || block->reason >= kReasonItemBase;
  if (block->verdict == Verdict::aborted && by_item) return Code::interrupted;
  if (!by_item && (block->verdict == Verdict::not_measured || block->verdict == Verdict::aborted))
    return static_cast<Code>(block->reason);
  // Only passes but another verdict: the deciding item is missing.
  const bool lost = block->verdict != Verdict::pass &&
                    with_findings(combine(block->items.begin(), block->items.end()), *block) == Verdict::pass;
  return lost ? Code::internal : Code::ok;
}

/// The slab's verdict from verdicts already found: fail, then not measured, then indeterminate, then pass.
Verdict worse(Verdict a, Verdict b) {
  constexpr auto rank = [](Verdict v) {
    switch (v) {
      case Verdict::fail: return 4;
      case Verdict::none:
      case Verdict::aborted:
      case Verdict::not_measured: return 3;
      case Verdict::indeterminate: return 2;
      case Verdict::pass: return 1;
    }
    return 3;
  };
  return rank(a) >= rank(b) ? a : b;
}

/// Keeps the reason of higher priority: codes before items, the lowest item among items.
std::uint16_t earlier(std::uint16_t a, std::uint16_t b) {
  if (a == 0) return b;
  if (b == 0) return a;
  return std::min(a, b);
}

/// no_gauge if an item that is not measured, and must be, waits for a gauge; codes are below item numbers.
Code gauge_cause(const Item* begin, const Item* end) {
  const bool missing = std::any_of(begin, end, [](const Item& item) {
    return info(item.id).of_gauges && item.required && item.verdict == Verdict::not_measured;
  });
  return missing ? Code::no_gauge : Code::ok;
}

}  // namespace

void reach_verdicts(const Recipe& recipe, std::span<const BlockResult> blocks, const Seats& seats, SlabResult& out) {
  std::array<StationItems, limits::kStationsMax> of_station;
  // The slab's verdict covers all items, including those that count for a station.
  FixedVector<Item, kSlabItemsMax> of_slab;
  for (const Item& item : out.items)
    if (item.station == 0 || item.station_to != 0) (void)of_slab.push(item);

  // Slab-wide items without limits in the recipe do not affect the verdict; required ones that are missing do.
  const bool slab_wide_counts = std::any_of(of_slab.begin(), of_slab.end(), [](const Item& item) {
    return item.required || (item.verdict != Verdict::none && item.verdict != Verdict::not_measured);
  });
  const Verdict slab_wide = combine(of_slab.begin(), of_slab.end());
  out.fail_mask = fail_mask(of_slab.begin(), of_slab.end());
  out.open_mask = open_mask(of_slab.begin(), of_slab.end());
  // Without any station nothing can pass.
  out.verdict = slab_wide_counts ? slab_wide : (recipe.stations() == 0 ? Verdict::not_measured : Verdict::pass);
  for (int station = 1; station <= recipe.stations(); ++station) {
    const auto k = static_cast<std::size_t>(station - 1);
    const BlockResult* block = block_of(blocks, station);
    const Code cause = cause_of(block);
    StationItems& items = of_station[k];
    items = items_of_station(recipe, block, seats, out, station);
    out.fail_mask |= fail_mask(items.begin(), items.end());
    out.open_mask |= open_mask(items.begin(), items.end());
    Verdict verdict = combine(items.begin(), items.end());
    if (cause != Code::ok && verdict != Verdict::fail) verdict = Verdict::not_measured;
    if (block != nullptr) verdict = with_findings(verdict, *block);
    out.station_verdict[k] = verdict;
    out.station_reason[k] = block != nullptr ? reason_with_findings(verdict, items.begin(), items.end(), cause, *block)
                                             : reason_for(verdict, items.begin(), items.end(), cause);
    if (holds(Rule::all_stations_pass)) out.verdict = worse(out.verdict, verdict);
  }

  // The slab's reason: the lowest of all reasons with the slab's verdict. Codes are below item numbers.
  if (out.verdict == Verdict::pass) return;
  if (slab_wide_counts && slab_wide == out.verdict)
    out.reason =
        reason_for(out.verdict, of_slab.begin(), of_slab.end(),
                   out.verdict == Verdict::not_measured ? gauge_cause(of_slab.begin(), of_slab.end()) : Code::ok);
  for (int station = 1; station <= recipe.stations(); ++station) {
    const auto k = static_cast<std::size_t>(station - 1);
    if (out.station_verdict[k] == out.verdict) out.reason = earlier(out.reason, out.station_reason[k]);
  }
}

}  // namespace slabd::algo
