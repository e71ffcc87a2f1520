// SPDX-License-Identifier: Apache-2.0
#include "base/items.h"

namespace slabd {
namespace {

constexpr std::array<ItemInfo, kItemCount> kItems = {{
    {ItemId::seat_slope, "seat_slope", ItemScope::block, ItemUnit::deg, 0, 600},
    {ItemId::seat_flatness, "seat_flatness", ItemScope::block, ItemUnit::mm, 1, 601},
    {ItemId::jaw_angle_inner, "jaw_angle_inner", ItemScope::block, ItemUnit::deg, 2, 602},
    {ItemId::jaw_angle_outer, "jaw_angle_outer", ItemScope::block, ItemUnit::deg, 3, 603},
    {ItemId::jaw_distance, "jaw_distance", ItemScope::block, ItemUnit::mm, 4, 604},
    {ItemId::casing_spacing, "casing_spacing", ItemScope::block, ItemUnit::mm, 5, 605},
    {ItemId::casing_protrusion_inner, "casing_protrusion_inner", ItemScope::block, ItemUnit::mm, 6, 606},
    {ItemId::casing_protrusion_outer, "casing_protrusion_outer", ItemScope::block, ItemUnit::mm, 7, 607},
    {ItemId::casing_skew_inner, "casing_skew_inner", ItemScope::block, ItemUnit::mm, 8, 608},
    {ItemId::casing_skew_outer, "casing_skew_outer", ItemScope::block, ItemUnit::mm, 9, 609},
    {ItemId::seat_lateral, "seat_lateral", ItemScope::seat_in_slab, ItemUnit::mm, 10, 610},
    {ItemId::seat_vertical, "seat_vertical", ItemScope::seat_in_slab, ItemUnit::mm, 11, 611},
    {ItemId::seat_spacing, "seat_spacing", ItemScope::seat_neighbours, ItemUnit::mm, 12, 612},
    {ItemId::large_jaw_distance, "large_jaw_distance", ItemScope::seat_pair, ItemUnit::mm, 13, 613},
    {ItemId::corner_level, "corner_level", ItemScope::slab, ItemUnit::mm, 14, 614},
    {ItemId::warp_left, "warp_left", ItemScope::slab, ItemUnit::mm, 15, 615},
    {ItemId::warp_right, "warp_right", ItemScope::slab, ItemUnit::mm, 15, 615},
    {ItemId::seat_std, "seat_std", ItemScope::block, ItemUnit::mm, -1, -1},
    {ItemId::surface_pores, "surface_pores", ItemScope::block, ItemUnit::mm, -1, 616, true},
    {ItemId::block_damage, "block_damage", ItemScope::block, ItemUnit::mm, -1, 617, true},
}};

}  // namespace

std::string_view name(Verdict verdict) {
  switch (verdict) {
    case Verdict::none: return "none";
    case Verdict::pass: return "pass";
    case Verdict::fail: return "fail";
    case Verdict::not_measured: return "not_measured";
    case Verdict::aborted: return "aborted";
    case Verdict::indeterminate: return "indeterminate";
  }
  return "none";
}

std::string_view name(BudgetPart part) {
  switch (part) {
    case BudgetPart::fit: return "fit";
    case BudgetPart::noise: return "noise";
    case BudgetPart::scanner: return "scanner";
    case BudgetPart::registration: return "registration";
    case BudgetPart::calibration: return "calibration";
    case BudgetPart::robot: return "robot";
    case BudgetPart::reference: return "reference";
  }
  return "";
}

const ItemInfo& info(ItemId id) {
  return kItems.at(static_cast<std::size_t>(id));
}

std::string_view name(ItemUnit unit) {
  return unit == ItemUnit::mm ? "mm" : "deg";
}

std::optional<ItemId> item_from_name(std::string_view item_name) {
  for (const ItemInfo& item : kItems)
    if (item.name == item_name) return item.id;
  return std::nullopt;
}

std::optional<ItemId> item_from_reason(int reason) {
  for (const ItemInfo& item : kItems)
    if (item.reason >= 0 && item.reason == reason) return item.id;
  return std::nullopt;
}

std::string_view beside_name(ItemId id) {
  switch (id) {
    case ItemId::seat_slope: return "ratio_n";
    case ItemId::seat_flatness: return "min_zone_mm";
    case ItemId::seat_std: return "cells_mm";
    case ItemId::seat_vertical: return "unremoved_mm";
    case ItemId::corner_level: return "quarter_mm";
    case ItemId::surface_pores: return "deepest_mm";
    case ItemId::block_damage: return "depth_mm";
    default: return "";
  }
}

Verdict judge(const Item& item, double guard) {
  if (!std::isfinite(item.value)) return Verdict::not_measured;
  const bool has_lower = has_value(item.lower);
  const bool has_upper = has_value(item.upper);
  if (!has_lower && !has_upper) return Verdict::none;
  // With guard 0 the band is zero, but U is still required to judge the value.
  if (!(std::isfinite(item.U) && item.U > 0.0)) return Verdict::indeterminate;
  const double band = guard > 0.0 ? guard * item.U : 0.0;
  if ((has_lower && item.value < item.lower - band) || (has_upper && item.value > item.upper + band))
    return Verdict::fail;
  if ((has_lower && item.value < item.lower + band) || (has_upper && item.value > item.upper - band))
    return Verdict::indeterminate;
  return Verdict::pass;
}

double conformance_probability(const Item& item) {
  const bool has_lower = has_value(item.lower);
  const bool has_upper = has_value(item.upper);
  if (!std::isfinite(item.value) || (!has_lower && !has_upper) || !(item.U > 0.0) || !std::isfinite(item.U))
    return kNoValue;
  // Phi by erfc, which is accurate in both tails.
  const double scale = 1.0 / (0.5 * item.U * std::sqrt(2.0));
  const double above_upper = has_upper ? 0.5 * std::erfc((item.upper - item.value) * scale) : 0.0;
  const double below_lower = has_lower ? 0.5 * std::erfc((item.value - item.lower) * scale) : 0.0;
  return std::fmax(1.0 - above_upper - below_lower, 0.0);
}

Verdict combine(const Item* begin, const Item* end) {
  bool any_measured = false;
  bool missing = false;
  bool open = false;
  for (const Item* item = begin; item != end; ++item) {
    switch (item->verdict) {
      case Verdict::fail: return Verdict::fail;
      case Verdict::indeterminate: open = true; break;
      case Verdict::pass: any_measured = true; break;
      case Verdict::none:
        // Information; but if the recipe requires the item, a missing verdict makes the result not_measured.
      case Verdict::not_measured:
      case Verdict::aborted: missing = missing || item->required; break;
    }
  }
  if (missing) return Verdict::not_measured;
  if (open) return Verdict::indeterminate;
  return any_measured ? Verdict::pass : Verdict::not_measured;
}

}  // namespace slabd
