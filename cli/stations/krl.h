// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"

/// Writes poses as a KRL data list and reads them. KRL: X, Y, Z in mm, A, B, C in degrees, R = Rz(A) Ry(B) Rx(C).
namespace slabd::cli {

/// A data list "<name>.dat": `DECL GLOBAL FRAME STATION1[n]`, one line a pose. The array has the number of the set,
/// because a global name may exist only once on a controller. Positions have 4 decimals, angles 6: reading it back is
/// exact to 0.1 um and 0.00001 deg.
[[nodiscard]] std::string krl_data_list(std::string_view name, int set, const std::vector<Pose>& T_base_flange);
/// A subprogram "<name>.src" that moves to STATION1[k] with $BASE and $TOOL at $NULLFRAME, and returns after the last
/// station.
[[nodiscard]] std::string krl_program(std::string_view name, int set, std::size_t stations);

/// Reads every `STATION[k]={...}` (any array name) with X, Y, Z, A, B, C in any order; S, T and external axes are
/// ignored. Code::config: a number is missing, invalid or out of range, or a station is duplicate or missing; the text
/// names `origin` and line.
[[nodiscard]] Result<std::vector<Pose>> parse_krl_points(std::string_view text, std::string_view origin);

/// The same from a file.
[[nodiscard]] Result<std::vector<Pose>> read_krl_points(const std::string& path);

}  // namespace slabd::cli
