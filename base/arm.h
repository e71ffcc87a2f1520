// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "base/fixed.h"
#include "base/limits.h"

/// The robots and scanners of a line. An arm is a robot together with the scanner on its flange. Arm 0 is the first one
/// of the configuration; the base of its robot is the base frame of the line.
namespace slabd {

/// Id of a robot or a scanner: 1 to 16 letters, digits, '-' or '_'. The only ones of a line are both "1".
using PartId = FixedString<16>;

struct Arm {
  PartId robot{"1"};
  PartId scanner{"1"};
  friend bool operator==(const Arm&, const Arm&) = default;
};

/// Indices into LineArms::list, the usual arm of a station first.
using ArmChoice = FixedVector<std::uint8_t, limits::kArmsMax>;

/// All arms, and the arms that may scan each station. Default: one arm, which scans every station.
struct LineArms {
  FixedVector<Arm, limits::kArmsMax> list;
  std::array<ArmChoice, limits::kStationsMax> of_station{};  ///< [station - 1]

  LineArms() {
    (void)list.push(Arm{});
    for (ArmChoice& choice : of_station) (void)choice.push(0);
  }
  [[nodiscard]] bool several() const { return list.size() > 1; }
};

}  // namespace slabd
