// SPDX-License-Identifier: Apache-2.0
#include "cad/order.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/limits.h"

namespace slabd::cad {
namespace {

using nlohmann::json;

double number(const json& object, const char* key) {
  const double value = object.at(key).get<double>();
  if (!std::isfinite(value) || std::abs(value) > 1e6) throw std::range_error(key);
  return value;
}

BlockGeometry geometry_of(const json& object) {
  BlockGeometry g;
  g.cant_ratio.value = number(object, "cant_ratio");
  g.jaw_half_distance_mm.value = number(object, "jaw_half_distance_mm");
  g.jaw_reference_height_mm.value = number(object, "jaw_reference_height_mm");
  g.jaw_angle_rad.value = number(object, "jaw_angle_rad");
  g.shoulder_outer_z_mm.value = number(object, "shoulder_outer_z_mm");
  g.shoulder_inner_z_mm.value = number(object, "shoulder_inner_z_mm");
  g.end_half_length_mm.value = number(object, "end_half_length_mm");
  g.side_half_width_mm.value = number(object, "side_half_width_mm");
  g.draft_rad.value = number(object, "draft_rad");
  g.slab_top_z_mm.value = number(object, "slab_top_z_mm");
  g.casing_half_spacing_mm.value = number(object, "casing_half_spacing_mm");
  g.casing_bore_diameter_mm.value = number(object, "casing_bore_diameter_mm");
  g.casing_rim_diameter_mm.value = number(object, "casing_rim_diameter_mm");
  g.casing_rim_height_mm.value = number(object, "casing_rim_height_mm");
  return g;
}

OrderedBlock block_of(const json& object) {
  OrderedBlock block;
  block.suffix = object.at("suffix").get<std::string>();
  block.geometry = geometry_of(object.at("geometry"));
  const auto numbers = object.at("T").get<std::vector<double>>();
  if (numbers.size() != 7) throw std::range_error("T");
  for (const double value : numbers)
    if (!std::isfinite(value)) throw std::range_error("T");
  block.pose.translation_mm = Vec3(numbers[0], numbers[1], numbers[2]);
  block.pose.rotation = Quat(numbers[3], numbers[4], numbers[5], numbers[6]).normalized();
  return block;
}

OrderedPmi pmi_of(const json& object) {
  OrderedPmi pmi;
  const auto kind = object.at("kind").get<std::string>();
  pmi.kind = kind == "flatness"   ? OrderedPmi::Kind::flatness
             : kind == "distance" ? OrderedPmi::Kind::distance
             : kind == "angle"    ? OrderedPmi::Kind::angle
                                  : throw std::range_error("kind");
  pmi.name = object.at("name").get<std::string>();
  pmi.faces = object.at("faces").get<std::vector<std::string>>();
  if (pmi.faces.size() != (pmi.kind == OrderedPmi::Kind::flatness ? 1U : 2U)) throw std::range_error("faces");
  pmi.nominal = number(object, "nominal");
  pmi.lower = number(object, "lower");
  pmi.upper = number(object, "upper");
  return pmi;
}

}  // namespace

Result<ModelOrder> parse_order(const std::string& text) {
  ModelOrder order;
  try {
    const json document = json::parse(text);
    if (document.at("schema") != "slabd.cad_model/1") throw std::range_error("schema");
    order.name = document.at("name").get<std::string>();
    order.description = document.at("description").get<std::string>();
    for (const json& block : document.at("blocks")) order.blocks.push_back(block_of(block));
    if (const json& slab = document.at("slab"); !slab.is_null()) {
      order.has_slab = true;
      order.length_mm = number(slab, "length_mm");
      order.width_mm = number(slab, "width_mm");
      order.thickness_mm = number(slab, "thickness_mm");
    }
    for (const json& pmi : document.at("pmi")) order.pmi.push_back(pmi_of(pmi));
  } catch (const std::exception& fault) {
    return error(Code::config, "the order is not a slabd.cad_model/1: %s", fault.what());
  }
  if (order.blocks.empty() || order.blocks.size() > limits::kStationsMax)
    return error(Code::config, "the order has %zu blocks, allowed are 1 to %zu", order.blocks.size(),
                 static_cast<std::size_t>(limits::kStationsMax));
  return order;
}

}  // namespace slabd::cad
