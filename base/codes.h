// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

namespace slabd {

/// Refusals, failures and faults as the PLC sees them (register map 1.0, codes). 600 + item number is used as the
/// REASON of a verdict that a failing item decides.
enum class Code : std::uint16_t {
  ok = 0,
  // the PLC's command
  unknown_command = 101,
  stale_session = 102,
  busy = 103,
  wrong_slab = 104,
  station_range = 105,
  unknown_type = 106,
  not_enabled = 107,
  bad_id_text = 108,
  bad_crc = 109,
  interrupted = 110,
  bad_sequence = 111,
  attempts_used_up = 115,
  // the robot
  no_pose = 201,
  pose_stale = 202,
  not_settled = 203,
  outside_window = 204,
  moved_during_scan = 205,
  wrong_frame = 206,
  // the scanner
  scanner_offline = 301,
  trigger_timeout = 302,
  frame_incomplete = 303,
  exposure = 304,
  // the measurement
  too_few_points = 401,
  block_not_found = 402,
  fit_failed = 403,
  ambiguous = 404,
  deadline = 405,
  // the box
  store_full = 501,
  journal_write = 502,
  calibration_missing = 503,
  config = 504,
  internal = 505,
  // what was found on a block: reasons of items without a bit in the fail mask
  surface_pores = 616,
  block_damage = 617,
};

inline constexpr std::uint16_t kReasonItemBase = 600;

/// One sentence: what it is. Never empty.
[[nodiscard]] std::string_view describe(Code code);
/// One sentence: what to do about it. Never empty.
[[nodiscard]] std::string_view cure(Code code);

}  // namespace slabd
