// SPDX-License-Identifier: Apache-2.0
#include <time.h>

#include "hal/hal.h"

namespace slabd::hal {
namespace {

std::int64_t now_ns(clockid_t which) {
  timespec now{};
  clock_gettime(which, &now);  // cannot fail for these two clocks
  return now.tv_sec * kNsPerS + now.tv_nsec;
}

class SystemClock final : public Clock {
 public:
  std::int64_t mono_ns() const override { return now_ns(CLOCK_MONOTONIC); }
  std::int64_t utime_us() const override { return now_ns(CLOCK_REALTIME) / kNsPerUs; }
};

}  // namespace

std::unique_ptr<Clock> make_system_clock() {
  return std::make_unique<SystemClock>();
}

}  // namespace slabd::hal
