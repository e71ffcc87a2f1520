// SPDX-License-Identifier: Apache-2.0
#include "report/json.h"

#include <fmt/core.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <ctime>

#include "base/plain_text.h"
#include "report/budget_text.h"
#include "report/figures.h"

namespace slabd::cli {
namespace {

/// Control characters (base/plain_text.h) are escaped, so that JSON in a terminal does nothing else than show.
std::string quoted(std::string_view text) {
  std::string out = "\"";
  while (!text.empty()) {
    const CodePoint point = code_point_at(text);
    const auto value = static_cast<std::uint32_t>(point.value);
    if (!point.is_utf8) {
      out += "\\ufffd";  // file names may hold any bytes
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

/// `known` false: nobody measured it, and what `v` holds are no numbers.
void write_vector(Json& json, std::string_view name, const Vec3& v, bool known = true) {
  const std::array<double, 3> numbers = {known ? v.x() : kNoValue, known ? v.y() : kNoValue, known ? v.z() : kNoValue};
  json.field(name, std::span<const double>(numbers));
}

template <typename Matrix>
void write_rows(Json& json, std::string_view name, const Matrix& m) {
  json.key(name).begin_array();
  for (int row = 0; row < m.rows(); ++row) {
    std::array<double, Matrix::ColsAtCompileTime> numbers;
    for (int column = 0; column < m.cols(); ++column) numbers[static_cast<std::size_t>(column)] = m(row, column);
    json.row(numbers);
  }
  json.end_array();
}

/// What white noise does to a fitted plane: its height at the centroid, and its direction.
void write_plane_precision(Json& json, const PlaneFit& plane) {
  write_vector(json, "centroid_mm", plane.centroid, !plane.normal.isZero());
  json.field("sigma_offset_mm", plane.sigma_offset_mm);
  write_vector(json, "sigma_normal", plane.cov_normal.diagonal().cwiseSqrt());
  write_rows(json, "cov_normal", plane.cov_normal);
}

/// null: it is ok.
template <typename Feature>
void write_doubt(Json& json, const Feature& feature) {
  json.key("doubt");
  if (feature.ok)
    json.null();
  else
    json.value(name(feature.doubt));
}

void write_plane(Json& json, std::string_view name, const PlaneFit& plane) {
  json.key(name).begin_object();
  json.field("ok", plane.ok);
  write_doubt(json, plane);
  write_vector(json, "normal", plane.normal, !plane.normal.isZero());
  json.field("offset_mm", plane.offset_mm);
  json.field("points", plane.points).field("inliers", plane.inliers).field("inlier_fraction", plane.inlier_fraction);
  json.field("std_mm", plane.std_mm);
  write_plane_precision(json, plane);
  json.end_object();
}

void write_casing(Json& json, std::string_view name, const CasingFeature& casing) {
  json.key(name).begin_object();
  json.field("ok", casing.ok);
  write_doubt(json, casing);
  write_vector(json, "centre_mm", casing.centre, has_value(casing.radius_mm));
  json.field("radius_mm", casing.radius_mm).field("height_mm", casing.height_mm);
  json.field("edge_points", casing.edge_points).field("rim_points", casing.rim_points);
  json.field("inlier_fraction", casing.inlier_fraction).field("edge_rms_mm", casing.edge_rms_mm);
  json.field("rim_std_mm", casing.rim_std_mm).field("sigma_height_mm", casing.sigma_height_mm);
  write_rows(json, "cov_circle", casing.cov_circle);
  json.end_object();
}

void write_edges(Json& json, const BlockResult& block) {
  json.key("edges").begin_array();
  for (const EdgeFeature& edge : block.edges) {
    json.begin_object().key("between").begin_array().value(name(edge.face)).value(name(edge.face_to)).end_array();
    json.field("radius_mm", edge.radius_mm).field("chamfer_mm", edge.chamfer_mm);
    json.field("nominal_mm", edge.nominal_mm).field("n", edge.n).end_object();
  }
  json.end_array();
}

/// null: the channel was not computed; cells 0: it was, and there is no defect.
void write_defect(Json& json, const SurfaceDefect& defect) {
  json.key("defect");
  if (!has_value(defect.limit_mm)) {
    json.null();
    return;
  }
  json.begin_object().field("limit_mm", defect.limit_mm).field("cells", defect.cells);
  json.field("area_mm2", defect.area_mm2).field("height_mm", defect.height_mm);
  json.field("x_mm", defect.x_mm).field("s_mm", defect.s_mm).end_object();
}

void write_seat(Json& json, const SeatFeature& seat, double cell_mm) {
  json.key("seat").begin_object();
  write_vector(json, "normal", seat.normal_datum, !seat.normal_datum.isZero());
  json.field("points", seat.plane.points).field("grid_points", seat.grid_points);
  json.field("inlier_fraction", seat.plane.inlier_fraction).field("std_mm", seat.plane.std_mm);
  json.field("std_cells_mm", seat.std_cells_mm).field("flatness_mm", seat.flatness_mm);
  json.field("flatness_closed_mm", seat.flatness_closed_mm).field("flatness_raw_mm", seat.flatness_raw_mm);
  json.field("flatness_trimmed_mm", seat.flatness_trimmed_mm);
  json.field("flatness_min_zone_mm", seat.flatness_min_zone_mm).field("raw_low_mm", seat.raw_low_mm);
  json.field("raw_high_mm", seat.raw_high_mm);
  json.field("flatness_operator", std::string_view(flatness_operator(cell_mm)));
  json.field("flatness_noise_mm", seat.flatness_noise_mm).field("noise_factor", seat.noise_factor);
  write_defect(json, seat.defect);
  write_doubt(json, seat.plane);
  write_plane_precision(json, seat.plane);
  write_plane(json, "full_plane", seat.full_plane);
  json.end_object();
}

void write_registration(Json& json, const RegistrationReport& registration) {
  json.key("registration").begin_object();
  json.field("status", name(registration.status)).field("iterations", registration.iterations);
  json.field("share_associated", registration.share_associated).field("condition", registration.condition);
  json.field("note", registration.note.view());
  write_matrix(json, "T_scanner_block", registration.T_scanner_block);
  json.field("noise_mm", registration.noise_mm);
  write_rows(json, "covariance", registration.covariance);
  json.key("deviation").begin_object();
  json.field("count", registration.deviation.count).field("mean_mm", registration.deviation.mean_mm);
  json.field("std_mm", registration.deviation.std_mm);
  json.field("within_sigma", std::span<const double>(registration.deviation.within_sigma)).end_object();
  json.end_object();
}

/// null: no budget was computed and U is the recipe's.
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
  levels_.push_back({});
  return *this;
}

Json& Json::close(char bracket) {
  assert(!levels_.empty() && !after_key_);
  const bool empty = levels_.back().empty;
  levels_.pop_back();
  if (!empty) indent();
  text_ += bracket;
  return *this;
}

Json& Json::key(std::string_view name) {
  raw(quoted(name));
  text_ += ": ";
  after_key_ = true;
  return *this;
}

Json& Json::value(double number) {
  return std::isfinite(number) ? raw(fmt::format("{}", number)) : null();
}

Json& Json::value(std::string_view text) {
  return raw(quoted(text));
}

Json& Json::row(std::span<const double> numbers) {
  std::string list;
  for (const double number : numbers) {
    list += list.empty() ? "[" : ", ";
    list += std::isfinite(number) ? fmt::format("{}", number) : "null";
  }
  return raw(list.empty() ? "[]" : list + "]");
}

void write_item(Json& json, const Item& item, bool of_slab) {
  const ItemInfo& facts = info(item.id);
  json.begin_object();
  json.field("id", facts.name)
      .field("unit", name(facts.unit))
      .field("nominal", item.nominal)
      .field("value", item.value);
  json.field("deviation", item.deviation()).field("lower", item.lower).field("upper", item.upper).field("U", item.U);
  json.field("verdict", name(item.verdict)).field("required", item.required);
  json.field("conformance_probability", conformance_probability(item));
  write_budget(json, item);
  if (const std::string_view beside = beside_name(item.id); !beside.empty()) json.field(beside, item.beside);
  if (of_slab && item.station != 0) {
    const std::array<double, 2> stations = {static_cast<double>(item.station), static_cast<double>(item.station_to)};
    json.field("stations", std::span<const double>(stations.data(), item.station_to == 0 ? 1U : 2U));
  }
  json.end_object();
}

void write_block(Json& json, const BlockResult& block, double cell_mm) {
  json.field("verdict", name(block.verdict)).field("reason", block.reason);

  json.key("scan").begin_object();
  json.field("points_read", block.scan.points_read).field("points_finite", block.scan.points_finite);
  json.field("isolated_removed", block.scan.isolated_removed).field("points_kept", block.scan.points_kept);
  write_vector(json, "step_mm", block.scan.step_mm, true);
  json.end_object();

  write_registration(json, block.registration);
  json.key("features").begin_object();
  write_seat(json, block.seat, cell_mm);
  write_plane(json, "jaw_inner", block.jaw_inner);
  write_plane(json, "jaw_outer", block.jaw_outer);
  write_plane(json, "slab_top", block.slab_top);
  write_casing(json, "casing_inner", block.casing_inner);
  write_casing(json, "casing_outer", block.casing_outer);
  write_edges(json, block);
  json.end_object();

  json.key("items").begin_array();
  for (const Item& item : block.items)
    if (info(item.id).scope == ItemScope::block) write_item(json, item);
  json.end_array();

  json.key("pores").begin_object();
  json.field("count", block.pores.count).field("largest_mm", block.pores.largest_mm);
  json.field("deepest_mm", block.pores.deepest_mm).field("share", block.pores.share);
  json.field("depth_max_mm", block.pores.limits.depth_max_mm).field("share_max", block.pores.limits.share_max);
  json.end_object();

  json.key("findings").begin_array();
  for (const SurfaceFinding& f : block.findings) {
    json.begin_object().field("kind", name(f.kind)).field("face", name(f.face));
    json.field("x_mm", f.x_mm).field("s_mm", f.s_mm).field("z_mm", f.z_mm);
    json.field("length_mm", f.length_mm).field("width_mm", f.width_mm).field("depth_mm", f.depth_mm);
    json.field("area_mm2", f.area_mm2).field("volume_mm3", f.volume_mm3).end_object();
  }
  json.end_array();

  json.key("timing_ms").begin_object();
  json.field("read", block.times.read_ms).field("denoise", block.times.denoise_ms);
  json.field("register", block.times.register_ms).field("extract", block.times.extract_ms);
  json.field("total", block.times.total_ms).end_object();
}

void write_pose(Json& json, std::string_view name, const Pose& pose) {
  const std::array<double, 7> numbers = pose.to_array();
  json.field(name, std::span<const double>(numbers));
}

void write_matrix(Json& json, std::string_view name, const Pose& pose) {
  const Mat4 m = pose.matrix();
  json.key(name).begin_array();
  for (int row = 0; row < 4; ++row) {
    json.begin_array();
    for (int column = 0; column < 4; ++column) json.value(m(row, column));
    json.end_array();
  }
  json.end_array();
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
  if (crc32c) {
    json.field(name, std::string_view(fmt::format("{:08x}", *crc32c)));
  } else {
    json.key(name).null();
  }
}

void write_time(Json& json, std::string_view name, std::int64_t utime_us) {
  json.key(name);
  if (utime_us == 0) {
    json.null();
  } else {
    json.value(iso_time(utime_us));
  }
}

}  // namespace slabd::cli
