// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace slabd {

/// The newest time of day that records vouch for (us since 1970). Calibrations expire by it where the clock is behind,
/// so it may not follow every clock: one that was ahead by a year for a minute would let them all expire for good. A
/// time more than a day ahead counts only when another one an hour later follows and none comes from before the jump;
/// the first of all counts at once.
class NewestTime {
 public:
  NewestTime() = default;
  explicit NewestTime(std::int64_t utime_us) : newest_(utime_us) {}

  void note(std::int64_t utime_us) {
    if (newest_ == 0 || utime_us <= newest_ + kStep_us) {
      if (utime_us > newest_) newest_ = utime_us;
      jumped_ = 0;
    } else if (jumped_ == 0 || utime_us < jumped_) {
      jumped_ = utime_us;
    } else if (utime_us - jumped_ >= kHolds_us) {
      newest_ = utime_us;
      jumped_ = 0;
    }
  }
  [[nodiscard]] std::int64_t utime_us() const { return newest_; }

 private:
  static constexpr std::int64_t kHolds_us = 3'600'000'000;
  static constexpr std::int64_t kStep_us = 24 * kHolds_us;
  std::int64_t newest_ = 0;
  std::int64_t jumped_ = 0;  ///< first of the times far ahead, 0: none
};

}  // namespace slabd
