// SPDX-License-Identifier: Apache-2.0
#include "config/recipe_keys.h"

#include <fmt/core.h>

namespace slabd::daemon {
namespace {

constexpr const char* kUncertaintyNames[] = {"uncertainty.scanner_form_mm", "uncertainty.scanner_form_length_mm",
                                             "uncertainty.scanner_length_ppm", "uncertainty.reference_mm",
                                             "uncertainty.reference_deg"};

std::string number(double value) {
  return has_value(value) ? fmt::format("{}", value) : "-";
}

class Keys {
 public:
  void add(std::string key, double value, KeyEffect effect) {
    list_.push_back({std::move(key), number(value), effect});
  }
  void add(std::string key, bool value, KeyEffect effect) {
    list_.push_back({std::move(key), value ? "true" : "false", effect});
  }
  void add(std::string key, std::string_view value, KeyEffect effect) {
    list_.push_back({std::move(key), std::string(value), effect});
  }
  /// A nominal: its value, and whether somebody confirmed it.
  void add(const NamedNominal& n, KeyEffect effect) {
    add(n.name, shown(n), effect);
    add(std::string(n.name) + ".confirmed", n.nominal.confirmed, KeyEffect::none);
  }
  [[nodiscard]] std::vector<RecipeKey> take() { return std::move(list_); }

 private:
  std::vector<RecipeKey> list_;
};

void add_evaluation(Keys& keys, const EvaluationSettings& e) {
  const auto measured = [&](const char* key, double value) {
    keys.add(std::string("evaluation.") + key, value, KeyEffect::measured);
  };
  measured("crop_half_x_mm", e.crop_half_x_mm);
  measured("crop_half_s_mm", e.crop_half_s_mm);
  measured("cell_mm", e.cell_mm);
  measured("cell_points_min", e.cell_points_min);
  measured("cells_missing_max", e.cells_missing_max);
  measured("edge_margin_mm", e.edge_margin_mm);
  measured("inlier_share_min", e.inlier_share_min);
  measured("registration_gate_mm", e.registration_gate_mm);
  measured("registration_share_min", e.registration_share_min);
  keys.add("evaluation.flatness", std::string_view(e.flatness == FlatnessKind::closed ? "closed" : "raw"),
           KeyEffect::measured);
  measured("closing_mm", e.closing_mm);
  keys.add("evaluation.casing", std::string_view(e.casing == CasingKind::open ? "open" : "capped"),
           KeyEffect::measured);
  measured("defect_sigmas", e.defect_sigmas);
  measured("window_mm", e.window_mm);
  measured("window_deg", deg_from_rad(e.window_rad));
}

/// Of these U also says how well the tilt of the seat, the slab top or a jaw must be known for its plane to count
/// (algo/inspector.cpp), with a budget too.
bool asks_of_planes(ItemId id) {
  return id == ItemId::seat_slope || id == ItemId::jaw_angle_inner || id == ItemId::jaw_angle_outer;
}

void add_item(Keys& keys, const Recipe& recipe, ItemId id) {
  const Tolerance& t = recipe.tolerance(id);
  const std::string item = "items." + std::string(info(id).name);
  keys.add(item + ".nominal", t.nominal.value, KeyEffect::verdict);
  keys.add(item + ".lower", t.lower, KeyEffect::verdict);
  keys.add(item + ".upper", t.upper, KeyEffect::verdict);
  keys.add(item + ".U", t.U, asks_of_planes(id) ? KeyEffect::measured : KeyEffect::verdict);
  keys.add(item + ".required", t.required, KeyEffect::verdict);
  keys.add(item + ".confirmed", t.confirmed, KeyEffect::none);
  keys.add(item + ".nominal.confirmed", t.nominal.confirmed, KeyEffect::none);
}

}  // namespace

std::vector<NamedNominal> geometry_of(const Recipe& recipe) {
  const BlockGeometry& b = recipe.block;
  const SlabGeometry& s = recipe.slab;
  return {{"slab.length_mm", s.length_mm},
          {"slab.width_mm", s.width_mm},
          {"slab.thickness_mm", s.thickness_mm},
          {"slab.pitch_mm", s.pitch_mm},
          {"slab.first_pair_from_end_mm", s.first_pair_from_end_mm},
          {"slab.seat_centre_distance_mm", s.seat_centre_distance_mm},
          {"slab.block_origin_z_mm", s.block_origin_z_mm},
          {"block.cant_ratio", b.cant_ratio},
          {"block.jaw_half_distance_mm", b.jaw_half_distance_mm},
          {"block.jaw_reference_height_mm", b.jaw_reference_height_mm},
          {"block.jaw_angle_deg", b.jaw_angle_rad, true},
          {"block.shoulder_outer_z_mm", b.shoulder_outer_z_mm},
          {"block.shoulder_inner_z_mm", b.shoulder_inner_z_mm},
          {"block.end_half_length_mm", b.end_half_length_mm},
          {"block.side_half_width_mm", b.side_half_width_mm},
          {"block.draft_deg", b.draft_rad, true},
          {"block.slab_top_z_mm", b.slab_top_z_mm},
          {"block.casing_half_spacing_mm", b.casing_half_spacing_mm},
          {"block.casing_bore_diameter_mm", b.casing_bore_diameter_mm},
          {"block.casing_rim_diameter_mm", b.casing_rim_diameter_mm},
          {"block.casing_rim_height_mm", b.casing_rim_height_mm}};
}

std::vector<NamedNominal> uncertainty_of(const Recipe& recipe) {
  const UncertaintySettings& u = recipe.uncertainty;
  if (!u.given) return {};
  return {{kUncertaintyNames[0], u.scanner_form_mm},
          {kUncertaintyNames[1], u.scanner_form_length_mm},
          {kUncertaintyNames[2], u.scanner_length_ppm},
          {kUncertaintyNames[3], u.reference_mm},
          {kUncertaintyNames[4], u.reference_rad, true}};
}

double shown(const NamedNominal& n) {
  return n.is_angle ? deg_from_rad(n.nominal.value) : n.nominal.value;
}

std::string_view name(KeyEffect effect) {
  switch (effect) {
    case KeyEffect::none: break;
    case KeyEffect::verdict: return "verdict";
    case KeyEffect::slab: return "slab";
    case KeyEffect::measured: return "measured";
  }
  return "none";
}

std::vector<RecipeKey> keys_of(const Recipe& recipe) {
  Keys keys;
  keys.add("name", recipe.name.view(), KeyEffect::none);
  keys.add("slab_type", static_cast<double>(recipe.slab_type), KeyEffect::slab);
  keys.add("slope_datum",
           std::string_view(recipe.slope_datum == SlopeDatum::slab_frame ? "slab_frame" : "local_slab_top"),
           KeyEffect::slab);
  keys.add("remove_warp", recipe.remove_warp, KeyEffect::slab);
  keys.add("guard", recipe.guard, KeyEffect::verdict);
  keys.add("slab.pairs", static_cast<double>(recipe.slab.pairs), KeyEffect::slab);
  for (const NamedNominal& n : geometry_of(recipe))
    keys.add(n, std::string_view(n.name).starts_with("slab.") ? KeyEffect::slab : KeyEffect::measured);
  add_evaluation(keys, recipe.evaluation);
  keys.add("edges.fillet_seat_mm", recipe.edges.fillet_seat_mm, KeyEffect::none);
  keys.add("edges.fillet_shoulder_mm", recipe.edges.fillet_shoulder_mm, KeyEffect::none);
  keys.add("edges.chamfer_mm", recipe.edges.chamfer_mm, KeyEffect::none);
  keys.add("uncertainty", recipe.uncertainty.given ? std::string_view("given") : "-", KeyEffect::measured);
  const std::vector<NamedNominal> given = uncertainty_of(recipe);
  for (std::size_t i = 0; i < std::size(kUncertaintyNames); ++i)
    keys.add(given.empty() ? NamedNominal{kUncertaintyNames[i], {}} : given[i], KeyEffect::measured);
  for (std::size_t i = 0; i < kItemCount; ++i) add_item(keys, recipe, static_cast<ItemId>(i));
  keys.add("items.surface_pores.depth_max_mm", recipe.pores.depth_max_mm, KeyEffect::verdict);
  keys.add("items.surface_pores.share_max", recipe.pores.share_max, KeyEffect::verdict);
  return keys.take();
}

}  // namespace slabd::daemon
