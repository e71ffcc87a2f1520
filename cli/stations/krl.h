// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"

/// Writes poses as a KRL data list and reads them. KRL: X, Y, Z in mm, A, B, C in degrees, R = Rz(A) Ry(B) Rx(C).
namespace slabd::cli {

/// Stops of one robot, T_base_flange by station. On a line with two robots, each has those of its own stations.
using Stops = std::map<int, Pose>;

/// A data list "<name>.dat": `DECL GLOBAL FRAME STATION1[n]` with the last station as n, one line a pose. The array has
/// the number of the set, because a global name may exist only once on a controller. Positions have 4 decimals, angles
/// 6: reading it back is exact to 0.1 um and 0.00001 deg.
[[nodiscard]] std::string krl_data_list(std::string_view name, int set, const Stops& stops);
/// A subprogram "<name>.src" that moves to STATION1[k] with $BASE and $TOOL at $NULLFRAME. It halts if the PLC names a
/// station without a stop. It returns after station 0, and, if the robot has all stations of the slab, after the last
/// one; a robot that shares the slab does not know which of its stations is the last.
[[nodiscard]] std::string krl_program(std::string_view name, int set, const Stops& stops, int stations_of_slab);

/// Reads every `STATION[k]={...}` (any array name) with X, Y, Z, A, B, C in any order; S, T and external axes are
/// ignored. Code::config: a number is missing, invalid or out of range, or a station is duplicate; the text names
/// `origin` and line.
[[nodiscard]] Result<Stops> parse_krl_stops(std::string_view text, std::string_view origin);

/// The same; Code::config also if a station before the last one is missing.
[[nodiscard]] Result<std::vector<Pose>> parse_krl_points(std::string_view text, std::string_view origin);

/// The same from a file.
[[nodiscard]] Result<std::vector<Pose>> read_krl_points(const std::string& path);

}  // namespace slabd::cli
