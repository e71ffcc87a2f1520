// SPDX-License-Identifier: Apache-2.0
#include "report/json.h"

#include <fmt/core.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <ctime>

#include "base/plain_text.h"
#include "base/record_fields.h"
#include "report/budget_text.h"
#include "report/figures.h"

namespace slabd::report {
namespace {

/// Escapes control characters (base/plain_text.h), so that JSON printed to a terminal cannot control it.
std::string quoted(std::string_view text) {
  std::string out = "\"";
  while (!text.empty()) {
    const CodePoint point = code_point_at(text);
    const auto value = static_cast<std::uint32_t>(point.value);
    if (!point.is_utf8) {
      out += "\\ufffd";  // file names may contain any bytes
    } else if (value == '"' || value == '\\') {
      out += '\\';
      out += static_cast<char>(value);
    } else if (!is_control(point.value)) {
      out += text.substr(0, point.bytes);
    } else if (value < 0x1'0000) {
      out += fmt::format("\\u{:04x}", value);
    } else {
      out += fmt::format("\\u{:04x}\\u{:04x}", 0xD7C0 + (value >> 10U), 0xDC00 + (value & 0x3FFU));
    }
    text.remove_prefix(point.bytes);
  }
  return out + "\"";
}

/// nullopt if the feature is ok.
template <typename Feature>
auto doubt_of(const Feature& feature) {
  return only_if(!feature.ok, feature.doubt);
}

/// Writes the effect of white noise on a plane as two sigmas: of the height at the centroid and of the normal.
/// `in_seat`: writes only doubt and precision, because the seat object has the other figures itself.
void write_plane_fields(Json& json, PlaneFit plane, bool in_seat) {
  if (plane.normal.isZero()) plane.normal = plane.centroid = Vec3::Constant(kNoValue);  // not measured
  bool is_wanted = !in_seat;
  write_fields(json, plane, [&](std::string_view field) {
    if (field == "doubt") json.field(field, doubt_of(plane));
    if (field == "cov_normal") json.field("sigma_normal", plane.cov_normal.diagonal().cwiseSqrt());
    is_wanted = is_wanted || field == "centroid_mm";
    return is_wanted && field != "doubt" && field != "iterations";
  });
}

void write_plane(Json& json, std::string_view name, const PlaneFit& plane) {
  json.key(name).begin_object();
  write_plane_fields(json, plane, false);
  json.end_object();
}

void write_casing(Json& json, std::string_view name, CasingFeature casing) {
  if (!has_value(casing.radius_mm)) casing.centre = Vec3::Constant(kNoValue);
  json.key(name).begin_object();
  write_fields(json, casing, [&](std::string_view field) {
    if (field == "doubt") json.field(field, doubt_of(casing));
    return field != "doubt";
  });
  json.end_object();
}

void write_seat(Json& json, SeatFeature seat, double cell_mm) {
  if (seat.normal_datum.isZero()) seat.normal_datum = Vec3::Constant(kNoValue);
  json.key("seat").begin_object();
  write_fields(json, seat, [&](std::string_view field) {
    if (field == "grid_points") json.field("points", seat.plane.points);
    if (field == "std_cells_mm")
      json.field("inlier_fraction", seat.plane.inlier_fraction).field("std_mm", seat.plane.std_mm);
    if (field == "flatness_noise_mm") json.field("flatness_operator", flatness_operator(cell_mm, seat));
    return true;
  });
  // null: the channel was not computed; cells 0: it was computed, and no defect was found.
  json.field("defect", only_if(has_value(seat.defect.limit_mm), seat.defect));
  write_plane_fields(json, seat.plane, true);
  write_plane(json, "full_plane", seat.full_plane);
  json.end_object();
}

void write_registration(Json& json, const RegistrationReport& registration) {
  json.key("registration").begin_object();
  write_fields(json, registration, [&](std::string_view field) {
    const bool is_pose = field == "T_scanner_block";
    if (is_pose) json.field(field, registration.T_scanner_block.matrix());
    return !is_pose;
  });
  json.field("deviation", registration.deviation).end_object();
}

/// null if no budget was computed; U is then the recipe's, or that of the known parts if it is larger.
void write_budget(Json& json, const Item& item) {
  json.key("budget");
  if (!has_budget(item)) {
    json.null();
    return;
  }
  json.begin_object();
  for (std::size_t part = 0; part < kBudgetParts; ++part)
    json.field(name(static_cast<BudgetPart>(part)), item.budget[part]);
  json.end_object();
}

}  // namespace

void Json::indent() {
  text_ += '\n';
  text_.append(2 * levels_.size(), ' ');
}

void Json::separate() {
  if (after_key_) {
    after_key_ = false;
    return;
  }
  if (levels_.empty()) return;
  if (!levels_.back().empty) text_ += ',';
  levels_.back().empty = false;
  indent();
}

Json& Json::raw(std::string_view token) {
  separate();
  text_ += token;
  return *this;
}

Json& Json::open(char bracket) {
  separate();
  text_ += bracket;
  levels_.push_back({bracket});
  return *this;
}

Json& Json::close() {
  assert(!levels_.empty() && !after_key_);
  const Level level = levels_.back();
  levels_.pop_back();
  if (!level.empty) indent();
  text_ += level.bracket == '{' ? '}' : ']';
  return *this;
}

std::string Json::text() const {
  Json whole = *this;
  while (!whole.levels_.empty()) whole.close();
  return whole.text_ + "\n";
}

Json& Json::key(std::string_view name) {
  raw(quoted(name));
  text_ += ": ";
  after_key_ = true;
  return *this;
}

Json& Json::value(std::string_view text) {
  return raw(quoted(text));
}

Json& Json::row(std::span<const double> numbers, std::string_view begin, std::string_view end) {
  std::string list(begin);
  for (const double& number : numbers) {
    if (&number != numbers.data()) list += ", ";
    list += std::isfinite(number) ? fmt::format("{}", number) : "null";
  }
  return raw(list.append(end));
}

void write_item(Json& json, const Item& item, bool of_slab) {
  const ItemInfo& facts = info(item.id);
  json.begin_object().field("id", facts.name).field("unit", facts.unit).field("nominal", item.nominal);
  json.field("value", item.value).field("measured", item.measured).field("deviation", item.deviation());
  json.field("lower", item.lower);
  json.field("upper", item.upper).field("U", item.U).field("verdict", item.verdict).field("required", item.required);
  json.field("conformance_probability", conformance_probability(item));
  write_budget(json, item);
  if (const std::string_view companion = info(item.id).companion; !companion.empty())
    json.field(companion, item.companion);
  if (of_slab && item.station != 0) {
    json.key("stations").begin_array().value(item.station);
    if (item.station_to != 0) json.value(item.station_to);
    json.end_array();
  }
  json.end_object();
}

void write_block(Json& json, const BlockResult& block, double cell_mm) {
  json.field("verdict", block.verdict).field("reason", block.reason).field("scan", block.scan);
  write_registration(json, block.registration);
  json.key("features").begin_object();
  write_seat(json, block.seat, cell_mm);
  write_plane(json, "jaw_inner", block.jaw_inner);
  write_plane(json, "jaw_outer", block.jaw_outer);
  write_plane(json, "slab_top", block.slab_top);
  write_casing(json, "casing_inner", block.casing_inner);
  write_casing(json, "casing_outer", block.casing_outer);
  json.list("edges", block.edges, [&](const EdgeFeature& edge) {
    json.field("between", std::array{edge.face, edge.face_to});
    write_fields(json, edge, [](std::string_view field) { return field != "face" && field != "face_to"; });
  });
  json.end_object();

  json.key("items").begin_array();
  for (const Item& item : block.items)
    if (info(item.id).scope == ItemScope::block) write_item(json, item);
  json.end_array();
  json.field("pores", block.pores).field("findings", block.findings);
  json.key("timing_ms").begin_object();
  json.field("read", block.times.read_ms).field("denoise", block.times.denoise_ms);
  json.field("register", block.times.register_ms).field("extract", block.times.extract_ms);
  json.field("total", block.times.total_ms).end_object();
}

std::string iso_time(std::int64_t utime_us) {
  if (utime_us == 0) return "";
  const auto seconds = static_cast<std::time_t>(utime_us / 1'000'000);
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", parts.tm_year + 1900, parts.tm_mon + 1, parts.tm_mday,
                     parts.tm_hour, parts.tm_min, parts.tm_sec);
}

void write_emulation(Json& json, std::uint8_t bits) {
  json.field("emulated", bits != 0);
  json.key("emulation").begin_array();
  for (std::size_t i = 0; i < kEmulationNames.size(); ++i)
    if ((bits & (1U << i)) != 0) json.value(kEmulationNames[i]);
  json.end_array();
}

void write_crc32c(Json& json, std::string_view name, const std::optional<std::uint32_t>& crc32c) {
  json.field(name, crc32c ? std::optional(fmt::format("{:08x}", *crc32c)) : std::nullopt);
}

void write_time(Json& json, std::string_view name, std::int64_t utime_us) {
  json.field(name, only_if(utime_us != 0, iso_time(utime_us)));
}

}  // namespace slabd::report
