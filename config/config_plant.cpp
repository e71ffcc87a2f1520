// SPDX-License-Identifier: Apache-2.0
//
// [plant] -> PlantSettings, for slabd-plant. The daemon only needs to know whether there is a plant's database. As with
// [web], a fault in this table does not stop the inspection.
#include <fmt/format.h>

#include <algorithm>

#include "config/config_parts.h"

namespace slabd::config {
namespace {

constexpr std::size_t kDsnBytesMax = 1'000;
constexpr std::size_t kLineBytesMax = 32;

/// A line's name appears in tables, file names and labels of metrics.
bool is_line_name(std::string_view name) {
  return std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
           c == '.';
  });
}

}  // namespace

void read_plant(TableReader plant, const std::string& folder, PlantSettings& out) {
  const auto read_given_path = [&](std::string_view key, std::string& path) {
    if (plant.has(key)) read_path(plant, key, folder, path);
  };
  plant.optional_text("dsn", out.dsn, kDsnBytesMax);
  plant.optional_text("line", out.line, kLineBytesMax);
  if (!is_line_name(out.line))
    plant.problem("line", fmt::format("found \"{}\", allowed are letters, digits, '-', '_' and '.'", out.line));
  if (out.dsn.empty() != out.line.empty())
    plant.problem(out.dsn.empty() ? "line" : "dsn",
                  fmt::format("found without {}; allowed are both or neither", out.dsn.empty() ? "dsn" : "line"));
  if (out.dsn.find("password") != std::string::npos)
    plant.doubt("dsn", "holds a password, which every reader of this file sees; use passfile=FILE in it instead");
  double alarm_h = out.alarm_h;
  plant.optional_number("alarm_h", alarm_h, {0.1, 8'760.0});
  out.alarm_h = alarm_h;
  std::int64_t batch = out.batch;
  plant.optional_integer("batch", batch, 1, 1'000);
  out.batch = static_cast<int>(batch);
  read_given_path("metrics_file", out.metrics_file);
  plant.finish();
}

}  // namespace slabd::config
