// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "base/result.h"

/// How slabctl ends. Scripts and the line's maintenance build on these numbers; they never change meaning.
namespace slabd::cli {

enum Exit : int {
  kDone = 0,          ///< done; where something was inspected: passed
  kNotPass = 1,       ///< inspected, and not pass
  kUsage = 2,         ///< wrong options
  kBadInput = 3,      ///< a file's content; the text names file:line or byte
  kNotReachable = 4,  ///< daemon, device or database not reachable
  kInternal = 5,
  kRefused = 6,  ///< refused on quality (calibration)
};

/// One sentence on stderr, for people. JSON and results alone go to stdout.
void complain(std::string_view sentence);

/// The exit status of a room's Error: files and their content are bad input, links and disks are not reachable.
[[nodiscard]] constexpr Exit exit_for(Code code) {
  switch (code) {
    case Code::scanner_offline:
    case Code::store_full:
    case Code::journal_write:
    case Code::no_pose: return kNotReachable;
    case Code::internal: return kInternal;
    default: return kBadInput;
  }
}

/// The end of a command that cannot go on. stop() throws it; run() alone catches it, prints the sentence and returns
/// the status. It never leaves cli: a callback for another room returns a value instead.
struct Stop {
  Exit status;
  std::string sentence;  ///< empty if stderr has the reason already
};
[[noreturn]] void stop(Exit status, std::string_view sentence = {});
/// The sentence of `why`, and the status of exit_for().
[[noreturn]] void stop(const Error& why);

/// The value of `result`; without one, stop() with the Error.
template <typename T>
T need(Result<T> result) {
  if (!result) stop(result.error());
  return std::move(result.value());
}
/// The same with a status of the caller's.
template <typename T>
T need(Result<T> result, Exit otherwise) {
  if (!result) stop(otherwise, result.error().text.view());
  return std::move(result.value());
}

}  // namespace slabd::cli
