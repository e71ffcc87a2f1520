// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace slabd::cli {

/// A robot with its scanner in slabd.status/1. Parts that the daemon does not state are null.
struct ArmStatus {
  std::string robot;  ///< its id; empty on a line with one robot, as that of the scanner
  std::string scanner;
  nlohmann::json pose;
  nlohmann::json scanner_link;
  nlohmann::json calibration;  ///< as the object of the same name of a line with one robot
  nlohmann::json temperature_c;
};

/// The arms of the line, arm 0 first; at least one.
[[nodiscard]] std::vector<ArmStatus> arms_in(const nlohmann::json& status);

/// `name`, followed by the id if there is one: "robot", "robot 2".
[[nodiscard]] std::string with_id(const std::string& name, const std::string& id);

}  // namespace slabd::cli
