// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "base/noise_print.h"

namespace slabd::daemon {

/// The noise of the last exposures that were measured, of all slabs. The check belongs to the daemon's line only:
/// replays, inspections and studies measure the same exposure as often as they like.
class KnownExposures {
 public:
  /// The kept exposure with the largest correlation, if that is kSameExposure or more; null otherwise. The scan's own
  /// print (same slab, station and attempt) is not compared: a scan may be measured again after a restart.
  [[nodiscard]] const KeptNoise* same_as(const KeptNoise& exposure, double& correlation) const {
    const KeptNoise* found = nullptr;
    for (std::size_t i = 0; i < count_; ++i) {
      const KeptNoise& kept = kept_[i];
      if (is_same_scan(kept, exposure)) continue;
      const double now = noise_correlation(kept.print, exposure.print);
      if (!(now >= kSameExposure) || (found != nullptr && now <= correlation)) continue;
      found = &kept;
      correlation = now;
    }
    return found;
  }
  /// In place of the scan's own print, or else of the oldest one.
  void add(const KeptNoise& exposure) {
    for (std::size_t i = 0; i < count_; ++i) {
      if (!is_same_scan(kept_[i], exposure)) continue;
      kept_[i] = exposure;
      return;
    }
    kept_[next_] = exposure;
    next_ = (next_ + 1) % kept_.size();
    if (count_ < kept_.size()) ++count_;
  }

 private:
  static bool is_same_scan(const KeptNoise& a, const KeptNoise& b) {
    return a.slab_key == b.slab_key && a.station == b.station && a.attempt == b.attempt;
  }

  std::array<KeptNoise, limits::kNoisePrintsKept> kept_{};
  std::size_t count_ = 0;
  std::size_t next_ = 0;
};

}  // namespace slabd::daemon
