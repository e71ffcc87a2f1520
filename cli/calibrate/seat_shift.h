// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/base.h"
#include "cli/exit.h"
#include "config/config.h"

/// What a change of T_flange_scanner does at the slab: by how much every seat would be found elsewhere.
namespace slabd::cli {

/// A seat that moves by more wants somebody's word ...
inline constexpr double kConfirmAboveMm = 0.2;
/// ... and a scanner that turns by more: turned about what it sees it moves no seat, and every slope. A tenth of a
/// slope's tolerance, half of its U.
inline constexpr double kConfirmAboveDeg = 0.01;

/// Does a change go into force without a word? One of unknown size (NaN) does not.
[[nodiscard]] inline bool is_small_change(double shift_mm, double turn_deg) {
  return shift_mm <= kConfirmAboveMm && turn_deg <= kConfirmAboveDeg;
}

struct StationShift {
  int station = 0;
  bool taught = false;  ///< by the pose it was mastered at; else by the nominal one
  Vec3 shift_mm;        ///< of the seat's centre, slab axes
};
struct SeatShifts {
  std::vector<StationShift> stations;
  std::string slab;  ///< which recipe the stations are of, in words
  double shift_max_mm = kNoValue;
};

/// Where the seats go when one T_flange_scanner takes the place of another: the robot stands as it was taught, or as it
/// nominally would be, and sees the same. `slab_type` 0: of the first recipe. nullopt if found; else why not.
[[nodiscard]] std::optional<Stop> find_seat_shifts(const daemon::Config& config, std::uint16_t slab_type,
                                                   const Pose& before, const Pose& after, SeatShifts& out);

}  // namespace slabd::cli
