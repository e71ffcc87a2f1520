// SPDX-License-Identifier: Apache-2.0
#include "cli/client/arms.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// The value of a key; null without one.
json part_of(const json& object, const char* key) {
  return object.is_object() ? object.value(key, json()) : json();
}

std::string id_of(const json& arm, const char* key) {
  const json id = part_of(arm, key);
  return id.is_string() ? id.get<std::string>() : "?";
}

/// An arm after the first states its acceptance apart from its calibration.
json calibration_of(const json& arm) {
  json calibration = part_of(arm, "calibration");
  if (calibration.is_object() && !calibration.contains("scanner")) calibration["scanner"] = part_of(arm, "acceptance");
  return calibration;
}

}  // namespace

std::vector<ArmStatus> arms_in(const json& status) {
  std::vector<ArmStatus> arms;
  if (const json list = part_of(status, "arms"); list.is_array() && list.size() > 1)
    for (const json& arm : list)
      arms.push_back({id_of(arm, "robot"), id_of(arm, "scanner"), part_of(arm, "pose"), part_of(arm, "scanner_link"),
                      calibration_of(arm), part_of(arm, "temperature_c")});
  const json links = part_of(status, "links");
  if (arms.empty())
    arms.push_back({"", "", part_of(links, "pose"), part_of(links, "scanner"), part_of(status, "calibration"),
                    part_of(status, "scanner_temperature_c")});
  return arms;
}

std::string with_id(const std::string& name, const std::string& id) {
  return id.empty() ? name : name + " " + id;
}

}  // namespace slabd::cli
