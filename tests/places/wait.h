// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <thread>

/// Waits of tests. Each ends, so that a test whose condition never comes fails with a sentence instead of hanging.
namespace slabd::places {

/// Polls until `done()`; false if it is still false after `most`. A thread that the test then leaves must end too: by a
/// flag, by a std::jthread, or by a wait of its own.
template <typename Done>
[[nodiscard]] bool wait_until(const Done& done, std::chrono::seconds most = std::chrono::seconds(30)) {
  const auto end = std::chrono::steady_clock::now() + most;
  for (;;) {
    // Read before `done()`, so that a process that was paused still looks once.
    const bool last = std::chrono::steady_clock::now() >= end;
    if (done()) return true;
    if (last) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

}  // namespace slabd::places
