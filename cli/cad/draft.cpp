// SPDX-License-Identifier: Apache-2.0
#include "cli/cad/draft.h"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>

#include "base/items.h"
#include "cli/exit.h"

namespace slabd::cli {
namespace {

struct DraftKey {
  const char* table;
  const char* key;
};

/// Keys in the order of recipes/p5600.toml.
constexpr std::array<DraftKey, 22> kNumbers = {{
    {"slab", "length_mm"},
    {"slab", "width_mm"},
    {"slab", "thickness_mm"},
    {"slab", "pairs"},
    {"slab", "pitch_mm"},
    {"slab", "first_pair_from_end_mm"},
    {"slab", "seat_centre_distance_mm"},
    {"slab", "block_origin_z_mm"},
    {"block", "cant_ratio"},
    {"block", "jaw_half_distance_mm"},
    {"block", "jaw_reference_height_mm"},
    {"block", "jaw_angle_deg"},
    {"block", "shoulder_outer_z_mm"},
    {"block", "shoulder_inner_z_mm"},
    {"block", "end_half_length_mm"},
    {"block", "side_half_width_mm"},
    {"block", "draft_deg"},
    {"block", "slab_top_z_mm"},
    {"block", "casing_half_spacing_mm"},
    {"block", "casing_bore_diameter_mm"},
    {"block", "casing_rim_diameter_mm"},
    {"block", "casing_rim_height_mm"},
}};

constexpr std::array<const char*, 3> kEdges = {"fillet_seat_mm", "fillet_shoulder_mm", "chamfer_mm"};

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

struct ItemNominal {
  const char* item;
  std::optional<double> nominal;
};

}  // namespace

std::string draft_text(const std::vector<std::string>& head, const std::string& name, const DraftLookup& number,
                       const DraftReason& reason) {
  std::string text;
  for (const std::string& line : head) text += line.empty() ? "#\n" : fmt::format("# {}\n", line);
  text += fmt::format(
      "\nschema = \"slabd.recipe/1\"\nname = {}\n"
      "# slab_type = ?              # the number that the PLC writes into SLAB_TYPE\n"
      "slope_datum = \"slab_frame\"\nremove_warp = true\ndesign = \"none\"\nguard = 1.0\n",
      quoted(name));
  std::string table;
  for (const DraftKey& key : kNumbers) {
    if (table != key.table) {
      table = key.table;
      text += fmt::format("\n[{}]\n", table);
    }
    const std::string full = fmt::format("{}.{}", key.table, key.key);
    const bool is_count = full == "slab.pairs";
    if (const std::optional<DraftNumber> found = number(full)) {
      if (is_count)
        text += fmt::format("{} = {:.0f}  # {}\n", key.key, found->value, found->source);
      else
        text += fmt::format("{} = {{ value = {:.12g}, confirmed = false, source = {} }}\n", key.key, found->value,
                            quoted(found->source));
    } else if (is_count) {
      text += fmt::format("# {} = ?  # not found: {}\n", key.key, reason(full));
    } else {
      text += fmt::format("# {} = {{ value = ?, confirmed = false }}  # not found: {}\n", key.key, reason(full));
    }
  }

  text +=
      "\n# Method of measuring: take this table from the recipe of a similar slab (recipes/p5600.toml) and check it.\n"
      "[evaluation]\n";
  if (const std::optional<DraftNumber> margin = number("evaluation.edge_margin_mm"))
    text += fmt::format("edge_margin_mm = {:.12g}  # {}\n", margin->value, margin->source);
  bool any_edge = false;
  for (const char* key : kEdges)
    if (const std::optional<DraftNumber> found = number(fmt::format("edges.{}", key))) {
      if (!any_edge) text += "\n[edges]\n";
      any_edge = true;
      text += fmt::format("{} = {:.12g}  # {}\n", key, found->value, found->source);
    }

  const auto twice = [&](const char* key) {
    const std::optional<DraftNumber> half = number(key);
    return half ? std::optional(2.0 * half->value) : std::nullopt;
  };
  const auto plain_value = [&](const char* key) {
    const std::optional<DraftNumber> found = number(key);
    return found ? std::optional(found->value) : std::nullopt;
  };
  const std::optional<double> ratio = plain_value("block.cant_ratio");
  const std::optional<double> half = plain_value("block.jaw_half_distance_mm");
  const std::optional<double> reference = plain_value("block.jaw_reference_height_mm");
  const std::optional<double> across = plain_value("slab.seat_centre_distance_mm");
  std::optional<double> large_jaws;
  if (ratio && half && reference && across) {
    const double cant = std::atan(1.0 / *ratio);
    large_jaws = *across + 2.0 * (*half * std::cos(cant) - *reference * std::sin(cant));
  }
  std::optional<double> slope_deg;
  if (ratio) slope_deg = std::atan(1.0 / *ratio) * 180.0 / 3.14159265358979323846;
  const std::array<ItemNominal, 18> items = {{
      {"seat_slope", slope_deg},
      {"seat_flatness", 0.0},
      {"jaw_angle_inner", plain_value("block.jaw_angle_deg")},
      {"jaw_angle_outer", plain_value("block.jaw_angle_deg")},
      {"jaw_distance", twice("block.jaw_half_distance_mm")},
      {"casing_spacing", twice("block.casing_half_spacing_mm")},
      {"casing_protrusion_inner", plain_value("block.casing_rim_height_mm")},
      {"casing_protrusion_outer", plain_value("block.casing_rim_height_mm")},
      {"casing_skew_inner", 0.0},
      {"casing_skew_outer", 0.0},
      {"seat_lateral", 0.0},
      {"seat_vertical", 0.0},
      {"seat_spacing", plain_value("slab.pitch_mm")},
      {"large_jaw_distance", large_jaws},
      {"corner_level", 0.0},
      {"warp_left", 0.0},
      {"warp_right", 0.0},
      {"seat_std", std::nullopt},
  }};
  text +=
      "\n# Items. The nominals follow from the numbers above; the limits are in no CAD model. Add to each item that\n"
      "# is judged `tolerance`, or `lower` and `upper`, `U`, and required = true.\n";
  for (const ItemNominal& item : items) {
    text += fmt::format("\n[items.{}]\n", item.item);
    if (item.nominal && std::string_view(item.item) != "seat_std")
      text += fmt::format("nominal = {:.12g}\n", *item.nominal);
    text += "required = false\nconfirmed = false\n";
  }
  return text;
}

void check_draft_path(const std::string& out, const std::vector<std::string>& inputs) {
  namespace fs = std::filesystem;
  if (fs::path(out).extension() != ".toml") stop(kUsage, fmt::format("--out {}: the name must end in .toml", out));
  std::error_code none;
  for (const std::string& input : inputs)
    if (fs::equivalent(out, input, none)) stop(kUsage, fmt::format("--out {} is the file that is read", out));
  if (!fs::exists(out, none)) return;
  std::ifstream file(out);
  for (std::string line; std::getline(file, line);) {
    std::erase(line, ' ');
    if (const std::size_t at = line.find("confirmed=true"); at != std::string::npos && line.find('#') > at)
      stop(kBadInput,
           fmt::format("{} has confirmed numbers, which a new draft would set back: choose another name", out));
  }
}

std::string first_bytes(const std::string& text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  std::size_t end = bytes;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;
  return text.substr(0, end);
}

}  // namespace slabd::cli
