// SPDX-License-Identifier: Apache-2.0
#include "cli/cad/model_order.h"

#include <fmt/core.h>

#include <vector>

#include "base/units.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

void write_geometry(report::Json& json, const BlockGeometry& g) {
  json.key("geometry").begin_object();
  json.field("cant_ratio", g.cant_ratio.value).field("jaw_half_distance_mm", g.jaw_half_distance_mm.value);
  json.field("jaw_reference_height_mm", g.jaw_reference_height_mm.value).field("jaw_angle_rad", g.jaw_angle_rad.value);
  json.field("shoulder_outer_z_mm", g.shoulder_outer_z_mm.value);
  json.field("shoulder_inner_z_mm", g.shoulder_inner_z_mm.value);
  json.field("end_half_length_mm", g.end_half_length_mm.value);
  json.field("side_half_width_mm", g.side_half_width_mm.value).field("draft_rad", g.draft_rad.value);
  json.field("slab_top_z_mm", g.slab_top_z_mm.value);
  json.field("casing_half_spacing_mm", g.casing_half_spacing_mm.value);
  json.field("casing_bore_diameter_mm", g.casing_bore_diameter_mm.value);
  json.field("casing_rim_diameter_mm", g.casing_rim_diameter_mm.value);
  json.field("casing_rim_height_mm", g.casing_rim_height_mm.value).end_object();
}

struct OrderedItem {
  ItemId id;
  const char* kind;
  const char* face;
  const char* face_to;
};

constexpr std::array<OrderedItem, 6> kItems = {{
    {ItemId::seat_slope, "angle", "slab_top", "seat"},
    {ItemId::seat_flatness, "flatness", "seat", ""},
    {ItemId::jaw_angle_inner, "angle", "seat", "jaw_inner"},
    {ItemId::jaw_angle_outer, "angle", "seat", "jaw_outer"},
    {ItemId::jaw_distance, "distance", "jaw_inner", "jaw_outer"},
    {ItemId::casing_spacing, "distance", "casing_inner", "casing_outer"},
}};

void write_item(report::Json& json, const Item& item, const char* kind, const std::string& name,
                const std::vector<std::string>& faces) {
  const bool is_flatness = faces.size() == 1;
  if (!has_value(item.upper) || !has_value(item.nominal) || (!is_flatness && !has_value(item.lower))) return;
  json.begin_object().field("kind", kind).field("name", name).field("faces", faces).field("nominal", item.nominal);
  json.field("lower", is_flatness ? 0.0 : item.lower).field("upper", item.upper).end_object();
}

void write_block_items(report::Json& json, const Recipe& recipe, const SlabDesign& design, int station,
                       const std::string& suffix) {
  for (const OrderedItem& ordered : kItems) {
    const Item item = designed_item(recipe, design, ordered.id, station);
    std::vector<std::string> faces;
    for (const std::string face : {ordered.face, ordered.face_to})
      if (!face.empty()) faces.push_back(face == "slab_top" ? face : face + suffix);
    write_item(json, item, ordered.kind, std::string(info(ordered.id).name) + suffix, faces);
  }
}

/// The block as it is drawn on the slab: it stands on the slab's top, so that the height of its origin counts, from
/// which [block] slab_top_z_mm may differ by a rounded digit.
BlockGeometry drawn(const Recipe& recipe, const SlabDesign& design, int station) {
  BlockGeometry geometry =
      design.given && station > 0 ? designed_block(recipe.block, design.at(station)) : recipe.block;
  if (station > 0) geometry.slab_top_z_mm.value = -T_slab_block(recipe, design, station).translation_mm.z();
  return geometry;
}

}  // namespace

std::string model_order(const Recipe& recipe, const SlabDesign& design, const ModelChoice& choice,
                        const std::string& name) {
  report::Json json("slabd.cad_model/1");
  json.field("name", name);
  json.field("description", fmt::format("slabd recipe {} sha256 {}", recipe.name.view(), recipe.sha256.view()));
  json.key("blocks").begin_array();
  const auto suffix = [](int station) { return "_" + std::to_string(station); };
  const auto write = [&](int station, const std::string& ending, const Pose& pose) {
    json.begin_object().field("suffix", ending).field("T", pose);
    write_geometry(json, drawn(recipe, design, station));
    json.end_object();
  };
  if (choice.block) {
    write(choice.station, "", Pose::identity());
  } else {
    for (int station = 1; station <= recipe.stations(); ++station)
      write(station, suffix(station), T_slab_block(recipe, design, station));
  }
  json.end_array().key("slab");
  if (choice.block) {
    json.null();
  } else {
    json.begin_object().field("length_mm", recipe.slab.length_mm.value).field("width_mm", recipe.slab.width_mm.value);
    json.field("thickness_mm", recipe.slab.thickness_mm.value).end_object();
  }
  json.key("pmi").begin_array();
  if (choice.pmi && choice.block) write_block_items(json, recipe, design, choice.station, "");
  if (choice.pmi && !choice.block) {
    for (int station = 1; station <= recipe.stations(); ++station)
      write_block_items(json, recipe, design, station, suffix(station));
    for (int station = 1; station < recipe.stations(); ++station) {
      if (station == recipe.slab.pairs) continue;  // its next one is in the other row
      const Item item = designed_item(recipe, design, ItemId::seat_spacing, station, station + 1);
      write_item(json, item, "distance", "seat_spacing" + suffix(station),
                 {"casing_outer" + suffix(station), "casing_outer" + suffix(station + 1)});
    }
  }
  json.end_array();
  return json.text();
}

}  // namespace slabd::cli
