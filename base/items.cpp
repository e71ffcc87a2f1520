// SPDX-License-Identifier: Apache-2.0
#include "base/items.h"

namespace slabd {
namespace {

constexpr std::array<ItemInfo, kItemCount> kItems = {{
    {.id = ItemId::seat_slope,
     .name = "seat_slope",
     .scope = ItemScope::block,
     .unit = ItemUnit::deg,
     .plc_bit = 0,
     .reason = 600,
     .companion = "ratio_n"},
    {.id = ItemId::seat_flatness,
     .name = "seat_flatness",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = 1,
     .reason = 601,
     .companion = "min_zone_mm",
     .is_size = true,
     .nominal_is_zero = true},
    {.id = ItemId::jaw_angle_inner,
     .name = "jaw_angle_inner",
     .scope = ItemScope::block,
     .unit = ItemUnit::deg,
     .plc_bit = 2,
     .reason = 602},
    {.id = ItemId::jaw_angle_outer,
     .name = "jaw_angle_outer",
     .scope = ItemScope::block,
     .unit = ItemUnit::deg,
     .plc_bit = 3,
     .reason = 603},
    {.id = ItemId::jaw_distance,
     .name = "jaw_distance",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = 4,
     .reason = 604},
    {.id = ItemId::casing_spacing,
     .name = "casing_spacing",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = 5,
     .reason = 605},
    {.id = ItemId::casing_protrusion_inner,
     .name = "casing_protrusion_inner",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = 6,
     .reason = 606},
    {.id = ItemId::casing_protrusion_outer,
     .name = "casing_protrusion_outer",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = 7,
     .reason = 607},
    {.id = ItemId::casing_skew_inner,
     .name = "casing_skew_inner",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = 8,
     .reason = 608,
     .is_size = true,
     .nominal_is_zero = true},
    {.id = ItemId::casing_skew_outer,
     .name = "casing_skew_outer",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = 9,
     .reason = 609,
     .is_size = true,
     .nominal_is_zero = true},
    {.id = ItemId::seat_lateral,
     .name = "seat_lateral",
     .scope = ItemScope::seat_in_slab,
     .unit = ItemUnit::mm,
     .plc_bit = 10,
     .reason = 610,
     .nominal_is_zero = true},
    {.id = ItemId::seat_vertical,
     .name = "seat_vertical",
     .scope = ItemScope::seat_in_slab,
     .unit = ItemUnit::mm,
     .plc_bit = 11,
     .reason = 611,
     .companion = "unremoved_mm",
     .nominal_is_zero = true},
    {.id = ItemId::seat_spacing,
     .name = "seat_spacing",
     .scope = ItemScope::seat_neighbours,
     .unit = ItemUnit::mm,
     .plc_bit = 12,
     .reason = 612},
    {.id = ItemId::large_jaw_distance,
     .name = "large_jaw_distance",
     .scope = ItemScope::seat_pair,
     .unit = ItemUnit::mm,
     .plc_bit = 13,
     .reason = 613},
    {.id = ItemId::corner_level,
     .name = "corner_level",
     .scope = ItemScope::slab,
     .unit = ItemUnit::mm,
     .plc_bit = 14,
     .reason = 614,
     .companion = "quarter_mm",
     .nominal_is_zero = true},
    {.id = ItemId::warp_left,
     .name = "warp_left",
     .scope = ItemScope::slab,
     .unit = ItemUnit::mm,
     .plc_bit = 15,
     .reason = 615,
     .nominal_is_zero = true},
    {.id = ItemId::warp_right,
     .name = "warp_right",
     .scope = ItemScope::slab,
     .unit = ItemUnit::mm,
     .plc_bit = 15,
     .reason = 615,
     .nominal_is_zero = true},
    {.id = ItemId::seat_std,
     .name = "seat_std",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = -1,
     .reason = -1,
     .companion = "cells_mm"},
    {.id = ItemId::surface_pores,
     .name = "surface_pores",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = -1,
     .reason = 616,
     .companion = "deepest_mm",
     .is_size = true,
     .nominal_is_zero = true,
     .U_from_recipe = true,
     .optional = true,
     .meaning = "a pore is larger or deeper, or pores cover more, than the recipe allows",
     .cure = "`slabctl show` names place, size and depth; look at the block"},
    {.id = ItemId::block_damage,
     .name = "block_damage",
     .scope = ItemScope::block,
     .unit = ItemUnit::mm,
     .plc_bit = -1,
     .reason = 617,
     .companion = "depth_mm",
     .is_size = true,
     .nominal_is_zero = true,
     .U_from_recipe = true,
     .optional = true,
     .meaning = "surface of the block is displaced, broken out, cracked or missing",
     .cure = "`slabctl show` names place, size and depth; look at the block: damage, dirt or an object on it"},
    {.id = ItemId::slab_length,
     .name = "slab_length",
     .scope = ItemScope::slab,
     .unit = ItemUnit::mm,
     .plc_bit = -1,
     .reason = 620,
     .of_gauges = true,
     .optional = true,
     .meaning = "the slab's length is outside its limits",
     .cure = "`slabctl show` lists the gauges and their values; measure the slab by hand"},
    {.id = ItemId::slab_width,
     .name = "slab_width",
     .scope = ItemScope::slab,
     .unit = ItemUnit::mm,
     .plc_bit = -1,
     .reason = 621,
     .of_gauges = true,
     .optional = true,
     .meaning = "the slab's width is outside its limits",
     .cure = "`slabctl show` lists the gauges and their values; measure the slab by hand"},
    {.id = ItemId::slab_thickness,
     .name = "slab_thickness",
     .scope = ItemScope::slab,
     .unit = ItemUnit::mm,
     .plc_bit = -1,
     .reason = 622,
     .of_gauges = true,
     .optional = true,
     .meaning = "the slab's thickness is outside its limits",
     .cure = "`slabctl show` lists the gauges and their values; measure the slab by hand"},
    {.id = ItemId::bottom_flatness,
     .name = "bottom_flatness",
     .scope = ItemScope::slab,
     .unit = ItemUnit::mm,
     .plc_bit = -1,
     .reason = 623,
     .is_size = true,
     .nominal_is_zero = true,
     .of_gauges = true,
     .optional = true,
     .meaning = "the slab's bottom is not flat",
     .cure = "`slabctl show` lists the gauges and their values; measure the slab by hand"},
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
    case BudgetPart::thermal: return "thermal";
    case BudgetPart::gauge: return "gauge";
    case BudgetPart::tie: return "tie";
  }
  return "";
}

const ItemInfo& info(ItemId id) {
  return kItems.at(static_cast<std::size_t>(id));
}

std::string_view name(Disposition disposition) {
  switch (disposition) {
    case Disposition::none: return "none";
    case Disposition::hold: return "hold";
    case Disposition::release_by_concession: return "release_by_concession";
    case Disposition::rework: return "rework";
    case Disposition::scrap: return "scrap";
    case Disposition::re_inspect: return "re_inspect";
  }
  return {};
}

std::optional<Disposition> disposition_named(std::string_view word) {
  for (std::uint8_t i = 0; i <= static_cast<std::uint8_t>(Disposition::re_inspect); ++i)
    if (name(static_cast<Disposition>(i)) == word) return static_cast<Disposition>(i);
  return std::nullopt;
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
