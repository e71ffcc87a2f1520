// SPDX-License-Identifier: Apache-2.0
#include "config/recipe_parts.h"

#include <fmt/format.h>

#include <cmath>

namespace slabd::config {
namespace {

/// Allowed difference of two values that state the same number: a rounded last digit.
constexpr double kAgreement = 0.01;

void check_slab(TableReader slab, const SlabGeometry& g) {
  const double last_mm = g.first_pair_from_end_mm.value + g.pitch_mm.value * (g.pairs - 1);
  if (last_mm >= g.length_mm.value)
    slab.problem("pairs", fmt::format("the last of {} pairs is {:.1f} mm from the end, beyond length_mm {:.1f}",
                                      g.pairs, last_mm, g.length_mm.value));
  if (g.seat_centre_distance_mm.value >= g.width_mm.value)
    slab.problem("seat_centre_distance_mm", fmt::format("found {:.1f}, allowed is less than width_mm {:.1f}",
                                                        g.seat_centre_distance_mm.value, g.width_mm.value));
}

/// The height between block origin and slab top is in both tables, and the values must agree.
void check_slab_top(TableReader slab, const Recipe& recipe) {
  const double origin_mm = recipe.slab.block_origin_z_mm.value;
  const double top_mm = recipe.block.slab_top_z_mm.value;
  if (std::abs(origin_mm + top_mm) > kAgreement)
    slab.problem("block_origin_z_mm", fmt::format("found {:.2f}, but [block] slab_top_z_mm {:.2f} has the block's "
                                                  "origin {:.2f} above the slab top; allowed is a difference of {}",
                                                  origin_mm, top_mm, -top_mm, kAgreement));
}

void check_block(TableReader block, const BlockGeometry& b) {
  if (b.casing_rim_diameter_mm.value <= b.casing_bore_diameter_mm.value)
    block.problem("casing_rim_diameter_mm",
                  fmt::format("found {}, allowed is more than casing_bore_diameter_mm {}",
                              b.casing_rim_diameter_mm.value, b.casing_bore_diameter_mm.value));
  const double casing_end_mm = b.casing_half_spacing_mm.value + 0.5 * b.casing_rim_diameter_mm.value;
  if (casing_end_mm >= b.jaw_half_distance_mm.value)
    block.problem("casing_half_spacing_mm",
                  fmt::format("the casing's rim ends at {:.2f} mm, allowed is less than jaw_half_distance_mm {:.2f}",
                              casing_end_mm, b.jaw_half_distance_mm.value));
  if (b.jaw_half_distance_mm.value >= b.side_half_width_mm.value)
    block.problem("jaw_half_distance_mm", fmt::format("found {}, allowed is less than side_half_width_mm {}",
                                                      b.jaw_half_distance_mm.value, b.side_half_width_mm.value));
  for (const auto& [key, shoulder] : {std::pair("shoulder_inner_z_mm", b.shoulder_inner_z_mm),
                                      std::pair("shoulder_outer_z_mm", b.shoulder_outer_z_mm)})
    if (shoulder.value <= b.jaw_reference_height_mm.value)
      block.problem(key, fmt::format("found {}, allowed is more than jaw_reference_height_mm {}", shoulder.value,
                                     b.jaw_reference_height_mm.value));
}

/// The search for pores and damage covers 220 x 490 mm (algo/survey/surface_raster.h). The end faces are inclined: at
/// its lower side the seat is up to 2 mm longer than end_half_length_mm.
void check_searched(TableReader block, const Recipe& recipe) {
  if (!recipe.tolerance(ItemId::surface_pores).given && !recipe.tolerance(ItemId::block_damage).given) return;
  const auto within = [&](const char* key, double value_mm, double most_mm) {
    if (value_mm > most_mm)
      block.problem(key, fmt::format("found {}, allowed is at most {} with the items surface_pores and block_damage",
                                     value_mm, most_mm));
  };
  within("end_half_length_mm", recipe.block.end_half_length_mm.value, 108.0);
  within("side_half_width_mm", recipe.block.side_half_width_mm.value, 245.0);
}

void check_evaluation(TableReader table, const EvaluationSettings& e, const BlockGeometry& b) {
  // The end faces are inclined inwards above z = 0, and the bearing plane is below the shoulders.
  const double x_max = b.end_half_length_mm.value;
  if (e.crop_half_x_mm + e.edge_margin_mm >= x_max)
    table.problem("crop_half_x_mm",
                  fmt::format("found {} with edge_margin_mm {}, allowed is a crop inside end_half_length_mm {}",
                              e.crop_half_x_mm, e.edge_margin_mm, x_max));
  // The jaw face meets the bearing plane further inward than at the reference height.
  const double lean_mm = b.jaw_reference_height_mm.value * std::tan(b.jaw_angle_rad.value - 0.5 * kPi);
  const double s_max = b.jaw_half_distance_mm.value - lean_mm;
  if (e.crop_half_s_mm + e.edge_margin_mm >= s_max)
    table.problem("crop_half_s_mm",
                  fmt::format("found {} with edge_margin_mm {}, allowed is a crop inside the jaws' feet at {:.2f}",
                              e.crop_half_s_mm, e.edge_margin_mm, s_max));
  const double cells = std::ceil(2.0 * e.crop_half_x_mm / e.cell_mm) * std::ceil(2.0 * e.crop_half_s_mm / e.cell_mm);
  if (cells > static_cast<double>(limits::kFlatnessCellsMax))
    table.problem("cell_mm", fmt::format("found {}: the crop has {:.0f} such cells, allowed are {}", e.cell_mm, cells,
                                         limits::kFlatnessCellsMax));
  // With fewer, the noise of a cell cannot be separated from form, nor U be computed.
  constexpr double kCellsMin = 400.0;
  if (cells < kCellsMin)
    table.problem("cell_mm", fmt::format("found {}: the crop has {:.0f} such cells, needed are {:.0f}", e.cell_mm,
                                         cells, kCellsMin));
}

/// Distance of the outer jaws at reference height, section through a pair, across the track.
double large_jaw_distance_mm(const Recipe& r) {
  const double cant_rad = std::atan(1.0 / r.block.cant_ratio.value);
  const double outer_y_mm = r.block.jaw_half_distance_mm.value * std::cos(cant_rad) -
                            r.block.jaw_reference_height_mm.value * std::sin(cant_rad);
  return r.slab.seat_centre_distance_mm.value + 2.0 * outer_y_mm;
}

double nominal_from_geometry(const Recipe& r, ItemId id) {
  switch (id) {
    case ItemId::seat_slope: return deg_from_rad(std::atan(1.0 / r.block.cant_ratio.value));
    case ItemId::jaw_angle_inner:
    case ItemId::jaw_angle_outer: return deg_from_rad(r.block.jaw_angle_rad.value);
    case ItemId::jaw_distance: return 2.0 * r.block.jaw_half_distance_mm.value;
    case ItemId::casing_spacing: return 2.0 * r.block.casing_half_spacing_mm.value;
    case ItemId::casing_protrusion_inner:
    case ItemId::casing_protrusion_outer: return r.block.casing_rim_height_mm.value;
    case ItemId::seat_spacing: return r.slab.pitch_mm.value;
    case ItemId::large_jaw_distance: return large_jaw_distance_mm(r);
    case ItemId::slab_length: return r.slab.length_mm.value;
    case ItemId::slab_width: return r.slab.width_mm.value;
    case ItemId::slab_thickness: return r.slab.thickness_mm.value;
    default: return info(id).nominal_is_zero ? 0.0 : kNoValue;
  }
}

/// A data sheet's number in another unit would make U too small.
void check_uncertainty(TableReader table, const UncertaintySettings& u) {
  const auto doubt_below = [&](const char* key, double value, double least, const char* question) {
    if (value > 0.0 && value < least)
      table.doubt(key, fmt::format("found {:.6g}, {}; usual are 0 and {} and more", value, question, least));
  };
  doubt_below("scanner_form_mm", u.scanner_form_mm.value, 0.001, "metres? the unit is mm");
  doubt_below("reference_mm", u.reference_mm.value, 0.0001, "metres? the unit is mm");
  doubt_below("scanner_length_ppm", u.scanner_length_ppm.value, 0.1, "a ratio? the unit is 1e-6");
}

std::string limits_text(const Tolerance& t) {
  if (!has_value(t.lower)) return fmt::format("at most {:.4f}", t.upper);
  if (!has_value(t.upper)) return fmt::format("at least {:.4f}", t.lower);
  return fmt::format("{:.4f}..{:.4f}", t.lower, t.upper);
}

void check_item(TableReader item, const Recipe& recipe, ItemId id) {
  const Tolerance& t = recipe.tolerance(id);
  // Without U every verdict would be indeterminate, so the recipe is rejected.
  const bool never_computed = info(id).U_from_recipe;
  if (t.required && (has_value(t.lower) || has_value(t.upper)) && !has_value(t.U) && !info(id).of_gauges &&
      (never_computed || !recipe.uncertainty.given))
    item.problem("U", never_computed
                          ? "missing; expected the expanded uncertainty (k = 2) of its value: none is computed"
                          : "missing; expected the expanded uncertainty (k = 2) of its value, or a table "
                            "[uncertainty]: without both, no item can pass, not even with guard 0");
  if (!has_value(t.nominal.value)) return;
  const double expected = nominal_from_geometry(recipe, id);
  if (has_value(expected) && std::abs(t.nominal.value - expected) > kAgreement)
    item.problem("nominal", fmt::format("found {:.4f}, but the geometry of this recipe gives {:.4f} {}; allowed is a "
                                        "difference of {}",
                                        t.nominal.value, expected, name(info(id).unit), kAgreement));
  // Beyond what any block or slab is off: such a limit decides nothing.
  const bool is_angle = info(id).unit == ItemUnit::deg;
  const double far = is_angle ? 10.0 : 50.0;
  for (const auto& [key, limit] : {std::pair{"lower", t.lower}, std::pair{"upper", t.upper}}) {
    if (!(std::abs(limit - t.nominal.value) > far)) continue;
    item.doubt(item.has(key) ? key : "tolerance",
               fmt::format("found a limit {:.6g} {} from the nominal, {}? the unit is {}, usual are at most {}",
                           std::abs(limit - t.nominal.value), name(info(id).unit),
                           is_angle ? "minutes of arc" : "micrometres", name(info(id).unit), far));
    break;
  }
  if ((has_value(t.lower) && t.nominal.value < t.lower) || (has_value(t.upper) && t.nominal.value > t.upper))
    item.problem("nominal", fmt::format("found {:.4f}, allowed is a nominal inside its own limits: {}", t.nominal.value,
                                        limits_text(t)));
  // If the guard band is at least half the tolerance zone, no value can pass.
  if (has_value(t.U) && has_value(t.lower) && has_value(t.upper) && 2.0 * recipe.guard * t.U >= t.upper - t.lower)
    item.problem("U", fmt::format("found {}: with guard {} no value can pass between {:.4f} and {:.4f}", t.U,
                                  recipe.guard, t.lower, t.upper));
}

}  // namespace

void check_relations(TableReader& root, const Recipe& recipe) {
  check_slab(root.table("slab"), recipe.slab);
  check_slab_top(root.table("slab"), recipe);
  check_block(root.table("block"), recipe.block);
  check_searched(root.table("block"), recipe);
  check_evaluation(root.table("evaluation"), recipe.evaluation, recipe.block);
  if (recipe.uncertainty.given) check_uncertainty(root.table("uncertainty"), recipe.uncertainty);
  TableReader items = root.table("items");
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const ItemId id = static_cast<ItemId>(i);
    check_item(items.table(info(id).name), recipe, id);
  }
}

}  // namespace slabd::config
