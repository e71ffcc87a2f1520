// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>

#include "hal/hal.h"

namespace slabd::cli {

/// A counter of the pose link with its name in JSON and in docs/ROBOT.md.
struct NamedCount {
  const char* name;
  std::uint64_t count;
};

/// Counters of rejected and of missing poses.
[[nodiscard]] inline std::array<NamedCount, 13> pose_faults(const hal::PoseLinkCounters& c) {
  return {{{"other_type", c.other_type},
           {"wrong_sender", c.wrong_sender},
           {"second_publisher", c.second_publisher},
           {"malformed", c.malformed},
           {"not_finite", c.not_finite},
           {"not_unit", c.not_unit},
           {"out_of_reach", c.out_of_reach},
           {"repeated", c.repeated},
           {"time_back", c.time_back},
           {"time_unit", c.time_unit},
           {"jumps", c.jumps},
           {"gaps_total", c.gaps},
           {"lost", c.lost}}};
}

/// "3 lost, 1 jumps"; empty if all counters are zero.
[[nodiscard]] inline std::string pose_faults_text(const hal::PoseLinkCounters& counters) {
  std::string text;
  for (const NamedCount& c : pose_faults(counters))
    if (c.count != 0) text += (text.empty() ? "" : ", ") + std::to_string(c.count) + " " + c.name;
  return text;
}

}  // namespace slabd::cli
