// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/fields.h"
#include "base/recipe.h"
#include "config/toml_reader.h"

/// Internal parts shared by the recipe's reader and its list of keys.
namespace slabd::config {

/// Visits all values of a recipe except its head and its items, in the order of the file: key, member, range. `v.table`
/// begins a table, and `nominal` is a number with its confirmation, `degrees` such an angle, `range` two numbers with
/// one. `number` is a required plain number, `optional` a number with a default, `whole` an integer, `angle` a plain
/// angle. `word` is a choice in the order of its enumeration. Used for reading (config/recipe.cpp) and for the list of
/// keys (config/recipe_keys.cpp).
template <typename V, RecordOf<Recipe> R>
void walk_tables(V& v, R& r) {
  v.table("slab");
  // A slab frame needs 12 seats (algo/items/slab_items.cpp); with fewer than 6 pairs a slab could not be judged.
  v.whole("pairs", r.slab.pairs, 6, static_cast<std::int64_t>(limits::kPairsMax));
  v.nominal("length_mm", r.slab.length_mm, {1'000.0, 20'000.0});
  v.nominal("width_mm", r.slab.width_mm, {1'500.0, 5'000.0});
  v.nominal("thickness_mm", r.slab.thickness_mm, {50.0, 1'000.0});
  v.nominal("pitch_mm", r.slab.pitch_mm, {400.0, 1'000.0});
  v.nominal("first_pair_from_end_mm", r.slab.first_pair_from_end_mm, {50.0, 1'000.0});
  v.nominal("seat_centre_distance_mm", r.slab.seat_centre_distance_mm, {500.0, 3'000.0});
  v.nominal("block_origin_z_mm", r.slab.block_origin_z_mm, {0.0, 200.0});

  v.table("block");
  v.nominal("cant_ratio", r.block.cant_ratio, {10.0, 1'000.0});
  v.nominal("jaw_half_distance_mm", r.block.jaw_half_distance_mm, {100.0, 280.0});
  v.nominal("jaw_reference_height_mm", r.block.jaw_reference_height_mm, {1.0, 30.0});
  v.degrees("jaw_angle_deg", r.block.jaw_angle_rad, {91.0, 150.0});
  v.nominal("shoulder_outer_z_mm", r.block.shoulder_outer_z_mm, {5.0, 100.0});
  v.nominal("shoulder_inner_z_mm", r.block.shoulder_inner_z_mm, {5.0, 100.0});
  v.nominal("end_half_length_mm", r.block.end_half_length_mm, {60.0, 190.0});
  v.nominal("side_half_width_mm", r.block.side_half_width_mm, {120.0, 290.0});
  v.degrees("draft_deg", r.block.draft_rad, {0.0, 45.0});
  v.nominal("slab_top_z_mm", r.block.slab_top_z_mm, {-200.0, -5.0});
  v.nominal("casing_half_spacing_mm", r.block.casing_half_spacing_mm, {50.0, 250.0});
  v.nominal("casing_bore_diameter_mm", r.block.casing_bore_diameter_mm, {10.0, 80.0});
  v.nominal("casing_rim_diameter_mm", r.block.casing_rim_diameter_mm, {12.0, 100.0});
  v.nominal("casing_rim_height_mm", r.block.casing_rim_height_mm, {-10.0, 10.0});

  v.table("evaluation");
  auto& e = r.evaluation;
  v.number("crop_half_x_mm", e.crop_half_x_mm, {20.0, 190.0});
  v.number("crop_half_s_mm", e.crop_half_s_mm, {20.0, 280.0});
  // A larger cell could hide a chip: a chip of half a cell's area does not shift the cell's mean by its own depth.
  v.number("cell_mm", e.cell_mm, {0.5, 3.0});
  v.whole("cell_points_min", e.cell_points_min, 1, 10'000);
  v.optional("cells_missing_max", e.cells_missing_max, {0.0, 0.5});
  v.number("edge_margin_mm", e.edge_margin_mm, {0.0, 20.0});
  v.number("inlier_share_min", e.inlier_share_min, {0.5, 1.0});
  v.number("registration_gate_mm", e.registration_gate_mm, {0.1, 20.0});
  v.number("registration_share_min", e.registration_share_min, {0.1, 1.0});
  v.word("flatness", e.flatness, {"closed", "raw"});
  // Above 20 mm a depression that lifts a rail pad would be bridged as a pit.
  v.optional("closing_mm", e.closing_mm, {3.0, 20.0});
  v.word("casing", e.casing, {"open", "capped"});
  v.optional("defect_sigmas", e.defect_sigmas, {3.0, 20.0});
  v.number("window_mm", e.window_mm, {1.0, 200.0});
  v.angle("window_deg", e.window_rad, {0.1, 30.0});

  // Only displayed, therefore without `confirmed`.
  v.table("edges");
  v.optional("fillet_seat_mm", r.edges.fillet_seat_mm, {2.0, 12.0});
  v.optional("fillet_shoulder_mm", r.edges.fillet_shoulder_mm, {2.0, 12.0});
  v.optional("chamfer_mm", r.edges.chamfer_mm, {2.0, 12.0});

  // Assumptions about the measuring system. Without this table no budget is computed and items keep their own U.
  v.table("uncertainty", r.uncertainty.given);
  v.nominal("scanner_form_mm", r.uncertainty.scanner_form_mm, {0.0, 1.0});
  v.nominal("scanner_form_length_mm", r.uncertainty.scanner_form_length_mm, {10.0, 2'000.0});
  v.nominal("scanner_length_ppm", r.uncertainty.scanner_length_ppm, {0.0, 10'000.0});
  v.nominal("reference_mm", r.uncertainty.reference_mm, {0.0, 1.0});
  v.degrees("reference_deg", r.uncertainty.reference_rad, {0.0, 1.0});

  // Without this table lengths are stated at the slab's own temperature.
  v.table("thermal", r.thermal.given);
  v.nominal("reference_c", r.thermal.reference_c, {0.0, 40.0});
  v.nominal("cte_per_K", r.thermal.cte_per_K, {5e-6, 2e-5});
  v.nominal("u_cte_per_K", r.thermal.u_cte_per_K, {0.0, 5e-6});
  v.nominal("u_temperature_K", r.thermal.u_temperature_K, {0.0, 20.0});
  v.range("unknown_range_c", r.thermal.unknown_low_c, r.thermal.unknown_high_c, {-40.0, 90.0});
}

/// Checks relations between numbers that are each in range. The evaluation region must be on the bearing plane and the
/// pairs on the slab. The measuring workspace's tables must be large enough. Limits must enclose nominals, and an
/// item's nominal must agree with the geometry. Reports through `root`, the recipe's top table.
void check_relations(TableReader& root, const Recipe& recipe);

}  // namespace slabd::config
