// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cassert>
#include <cstdint>
#include <string_view>
#include <utility>
#include <variant>

#include "base/fixed.h"
#include "base/limits.h"

namespace slabd {

/// Error codes as the PLC reads them (docs/PLC.md, codes). 600 + item number is the REASON of a verdict decided by
/// a failing item.
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
  no_design = 112,
  unknown_mould = 113,
  no_gauge = 114,
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
  // the computer
  store_full = 501,
  journal_write = 502,
  calibration_missing = 503,
  config = 504,
  internal = 505,
};

/// From here on a REASON names the item that decided (ItemInfo::reason).
inline constexpr std::uint16_t kReasonItemBase = 600;

/// One sentence that describes the error. Never empty.
[[nodiscard]] std::string_view describe(Code code);
/// One sentence with the remedy. Never empty.
[[nodiscard]] std::string_view cure(Code code);

/// Error: the code for the PLC and the exit status, and one sentence for people. The sentence names the place
/// (file:line, byte, key or register) and the allowed range.
struct Error {
  Code code = Code::internal;
  FixedString<limits::kErrorTextBytes> text;
};

/// A value or an Error. Check before use; a failed call leaves outputs unchanged.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}  // NOLINT(google-explicit-constructor)
  Result(const Error& error) : state_(error) {}  // NOLINT(google-explicit-constructor)

  [[nodiscard]] bool ok() const { return std::holds_alternative<T>(state_); }
  explicit operator bool() const { return ok(); }
  [[nodiscard]] T& value() {
    assert(ok());
    return *std::get_if<T>(&state_);
  }
  [[nodiscard]] const T& value() const {
    assert(ok());
    return *std::get_if<T>(&state_);
  }
  [[nodiscard]] const Error& error() const {
    assert(!ok());
    return *std::get_if<Error>(&state_);
  }

 private:
  std::variant<T, Error> state_;
};

struct Nothing {};
using Status = Result<Nothing>;
[[nodiscard]] inline Status success() {
  return Nothing{};
}

/// Creates an Error with a printf-formatted sentence.
[[nodiscard, gnu::format(printf, 2, 3)]] Error error(Code code, const char* format, ...);

}  // namespace slabd
