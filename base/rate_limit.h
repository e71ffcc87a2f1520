// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

namespace slabd {

/// Limits how often a line is logged: at once the first time, then at most once in `period_ns`. With `burst` above 1,
/// the lines of unused periods are saved, and at most `burst` of them may follow each other at once.
class RateLimit {
 public:
  constexpr explicit RateLimit(std::int64_t period_ns, std::int64_t burst = 1)
      : period_ns_(period_ns), saved_ns_((burst - 1) * period_ns) {}

  /// True if a line may be logged now; it then counts as logged. `now_ns` does not run backwards.
  [[nodiscard]] constexpr bool permits(std::int64_t now_ns) {
    next_ns_ = std::max(next_ns_, now_ns - saved_ns_);
    if (next_ns_ > now_ns) return false;
    next_ns_ += period_ns_;
    return true;
  }

 private:
  std::int64_t period_ns_;
  std::int64_t saved_ns_;
  std::int64_t next_ns_ = std::numeric_limits<std::int64_t>::min();  ///< time of the next line
};

}  // namespace slabd
