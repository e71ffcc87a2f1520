// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

/// Robots and scanners in a parsed slabd.status/1.
namespace slabd::cli {

/// A robot with its scanner. Parts that the daemon does not state are null.
template <typename Json>
struct ArmStatus {
  std::string robot;  ///< its id; empty on a line with one robot, as that of the scanner
  std::string scanner;
  Json pose;
  Json scanner_link;
  Json calibration;  ///< as the object of the same name of a line with one robot
  Json temperature_c;
};

/// The value of a key; null without one.
template <typename Json>
[[nodiscard]] Json part_of(const Json& object, const char* key) {
  return object.is_object() ? object.value(key, Json()) : Json();
}

/// The arms of the line, arm 0 first; at least one.
template <typename Json>
[[nodiscard]] std::vector<ArmStatus<Json>> arms_in(const Json& status) {
  const auto id = [](const Json& arm, const char* key) {
    const Json value = part_of(arm, key);
    return value.is_string() ? value.template get<std::string>() : std::string("?");
  };
  std::vector<ArmStatus<Json>> arms;
  if (const Json list = part_of(status, "arms"); list.is_array() && list.size() > 1)
    for (const Json& arm : list)
      arms.push_back({id(arm, "robot"), id(arm, "scanner"), part_of(arm, "pose"), part_of(arm, "scanner_link"),
                      part_of(arm, "calibration"), part_of(arm, "temperature_c")});
  const Json links = part_of(status, "links");
  if (arms.empty())
    arms.push_back({"", "", part_of(links, "pose"), part_of(links, "scanner"), part_of(status, "calibration"),
                    part_of(status, "scanner_temperature_c")});
  return arms;
}

/// `name`, followed by the id if there is one: "robot", "robot 2".
[[nodiscard]] inline std::string with_id(std::string name, const std::string& id) {
  return id.empty() ? std::move(name) : std::move(name) + " " + id;
}

}  // namespace slabd::cli
