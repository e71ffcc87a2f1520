// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "base/result.h"

/// Exit status of slabctl. Scripts and maintenance depend on these numbers; their meaning never changes.
namespace slabd::cli {

enum Exit : int {
  kDone = 0,          ///< done; for an inspection: passed
  kNotPass = 1,       ///< inspected, verdict not pass
  kUsage = 2,         ///< wrong options
  kBadInput = 3,      ///< invalid content of a file; the text names file:line or byte
  kNotReachable = 4,  ///< daemon, device or database not reachable
  kInternal = 5,
  kRefused = 6,  ///< rejected because of quality (calibration)
};

/// Prints one sentence to stderr. stdout contains only JSON and results.
void complain(std::string_view sentence);

/// Exit status of an Error: files and their content are bad input, links and disks are not reachable.
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

/// End of a command that cannot continue. stop() throws it; only run() catches it, prints the sentence and returns the
/// status. It never leaves cli: a callback for another room returns a value instead.
struct Stop {
  Exit status;
  std::string sentence;  ///< empty if the reason has been printed to stderr
};
[[noreturn]] void stop(Exit status, std::string_view sentence = {});
/// Stops with the text of `why` and the status of exit_for().
[[noreturn]] void stop(const Error& why);
/// Stops with the text of `why` and another status.
[[noreturn]] void stop(Exit status, const Error& why);

/// The value of `result`; calls stop() with the Error if there is none.
template <typename T>
T need(Result<T> result) {
  if (!result) stop(result.error());
  return std::move(result.value());
}
/// The same with a status from the caller.
template <typename T>
T need(Result<T> result, Exit otherwise) {
  if (!result) stop(otherwise, result.error());
  return std::move(result.value());
}

}  // namespace slabd::cli
