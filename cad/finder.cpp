// SPDX-License-Identifier: Apache-2.0
#include "cad/finder.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "cad/slab_finder.h"
#include "cad/unexplained.h"

namespace slabd::cad {
namespace {

struct KeyNote {
  const char* key;
  const char* note;
};

/// Keys of the recipe's table [block], in its order; the reference height is chosen and not found.
constexpr std::array<KeyNote, 13> kBlockKeys = {{
    {"cant_ratio", "slope of the seat against the slab's top"},
    {"jaw_half_distance_mm", "half the distance of the jaws at the reference height"},
    {"jaw_angle_deg", "angle between seat and jaw"},
    {"shoulder_outer_z_mm", "height of the outer shoulder above the seat's middle"},
    {"shoulder_inner_z_mm", "height of the inner shoulder above the seat's middle"},
    {"end_half_length_mm", "half the distance of the end faces at the seat's middle"},
    {"side_half_width_mm", "half the distance of the side faces at the seat's middle"},
    {"draft_deg", "inclination of end and side faces"},
    {"slab_top_z_mm", "height of the slab's top below the seat's middle"},
    {"casing_half_spacing_mm", "half the distance of the casings' axes on the seat"},
    {"casing_bore_diameter_mm", "diameter of the bores"},
    {"casing_rim_diameter_mm", "outer diameter of the flat rings around the bores"},
    {"casing_rim_height_mm", "height of the rings above the seat"},
}};
constexpr std::array<KeyNote, 3> kEdgeKeys = {{
    {"edges.fillet_seat_mm", "radius between seat and jaws"},
    {"edges.fillet_shoulder_mm", "radius between jaws and shoulders"},
    {"edges.chamfer_mm", "chamfer at ends and sides, as 45 degrees"},
}};

/// "blocks 3, 4 and 7", or empty for a single block.
std::string blocks_text(const std::vector<std::size_t>& numbers) {
  std::string text = numbers.size() == 1 ? "block" : "blocks";
  for (std::size_t i = 0; i < numbers.size(); ++i)
    text += fmt::format("{}{}", i == 0 ? " " : i + 1 == numbers.size() ? " and " : ", ", numbers[i]);
  return text;
}

/// Joins one key over all blocks. Blocks that contradict leave it missing.
void join(const std::vector<FoundBlock>& blocks, const KeyNote& key, const std::string& full_key, Findings& findings) {
  std::vector<double> values;
  std::vector<int> faces;
  std::vector<std::size_t> without;
  std::string why;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    if (const auto found = blocks[i].values.find(key.key); found != blocks[i].values.end()) {
      values.push_back(found->second.value);
      if (values.size() == 1) faces = found->second.faces;
    } else {
      without.push_back(i + 1);
      if (const auto lack = blocks[i].missing.find(key.key); lack != blocks[i].missing.end() && why.empty())
        why = lack->second;
    }
  }
  const std::string of = blocks.size() > 1 && !without.empty() ? " (" + blocks_text(without) + ")" : "";
  if (values.empty()) {
    if (!why.empty()) findings.not_found.push_back({full_key, why + of});
    return;
  }
  if (!without.empty() && !why.empty())
    findings.remarks.push_back(fmt::format("{}: {}{}; the other blocks agree", full_key, why, of));
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  // cant_ratio is a large number of no unit: 1:40 and 1:40.01 differ by 6 um over 1 m.
  const double same = std::string_view(key.key) == "cant_ratio" ? 1e-5 * *high : 1e-3;
  if (*high - *low > same)
    findings.not_found.push_back(
        {full_key, fmt::format("the blocks have {:.6g} to {:.6g}; such a slab needs a design sheet", *low, *high)});
  else
    findings.found.push_back({full_key, values.front(), faces, key.note});
}

/// Fits of planes must leave fillets and chamfers out.
void propose_margin(const std::vector<FoundBlock>& blocks, Findings& findings) {
  double largest = 0.0;
  for (const FoundBlock& block : blocks)
    for (const double radius : block.radii_mm) largest = std::max(largest, radius);
  if (largest == 0.0) return;
  findings.found.push_back({"evaluation.edge_margin_mm",
                            std::min(std::ceil(largest) + 1.0, 20.0),
                            {},
                            fmt::format("1 mm more than the largest fillet or chamfer, {:.2f} mm", largest)});
}

}  // namespace

Findings find_slab(const FaceList& model, double reference_mm) {
  Findings findings;
  std::vector<FoundBlock> blocks = find_blocks(model, reference_mm);
  findings.blocks = static_cast<int>(blocks.size());
  if (model.unit.empty())
    findings.remarks.push_back("the file does not name its unit of length: millimetres are assumed");
  if (!model.has_sides)
    findings.remarks.push_back("the faces do not close to a solid; their free sides are derived from the block's form");
  if (blocks.empty()) {
    findings.not_found.push_back(
        {"block", "no plane inclined by 1:10 to 1:1000 lies between two jaws that face each other"});
    return findings;
  }
  if (blocks.size() > 1) {
    find_slab_values(model, blocks, findings);
  } else {
    findings.not_found.push_back({"slab", "the file has one block and no slab"});
    if (blocks.front().top_is_foot)
      findings.remarks.push_back(fmt::format(
          "block.slab_top_z_mm is that of face {}, on which the block rests: compare it with the slab's top",
          blocks.front().top_face));
  }
  for (const KeyNote& key : kBlockKeys) join(blocks, key, std::string("block.") + key.key, findings);
  for (const KeyNote& key : kEdgeKeys) join(blocks, key, key.key, findings);
  propose_margin(blocks, findings);
  remark_unexplained(model, blocks, reference_mm, findings);
  for (std::size_t i = 0; i < blocks.size(); ++i)
    for (const NamedFace& named : blocks[i].names)
      findings.names.push_back({blocks.size() == 1 ? named.name : fmt::format("{}_{}", named.name, i + 1), named.face});
  std::set<int> tops;
  for (const FoundBlock& block : blocks)
    if (block.top_face != 0 && tops.insert(block.top_face).second)
      findings.names.push_back({"slab_top", block.top_face});
  return findings;
}

std::string findings_json(const FaceList& model, const Findings& findings, bool confined) {
  using nlohmann::ordered_json;
  ordered_json json;
  json["schema"] = "slabd.cad_findings/1";
  json["unit"] = model.unit;
  json["solids"] = model.solids;
  json["faces"] = model.faces.size();
  json["confined"] = confined;
  json["blocks"] = findings.blocks;
  json["found"] = ordered_json::array();
  for (const FoundValue& value : findings.found)
    json["found"].push_back({{"key", value.key}, {"value", value.value}, {"faces", value.faces}, {"note", value.note}});
  json["not_found"] = ordered_json::array();
  for (const MissingValue& value : findings.not_found)
    json["not_found"].push_back({{"key", value.key}, {"why", value.why}});
  json["remarks"] = findings.remarks;
  json["names"] = ordered_json::array();
  for (const NamedFace& named : findings.names) json["names"].push_back({{"name", named.name}, {"face", named.face}});
  json["picture"] = ordered_json::array();
  for (const ModelFace& face : model.faces) {
    ordered_json numbers = ordered_json::array();
    for (const std::array<Vec3, 3>& triangle : face.triangles)
      for (const Vec3& p : triangle)
        for (const double x : {p.x(), p.y(), p.z()}) numbers.push_back(std::round(100.0 * x) / 100.0);
    json["picture"].push_back({{"face", face.number}, {"triangles", std::move(numbers)}});
  }
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

}  // namespace slabd::cad
