// SPDX-License-Identifier: Apache-2.0
#include "daemon/design_watch.h"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "daemon/folder_sign.h"

namespace slabd::daemon {

struct DesignWatch::State {
  std::string dir;
  int period_ms = 0;
  mutable std::mutex mutex;
  std::condition_variable wake;
  bool stop = false;
  std::shared_ptr<const config::DesignSet> newest;
};

DesignWatch::DesignWatch(const std::string& dir, std::shared_ptr<const config::DesignSet> at_start, int period_ms)
    : state_(std::make_shared<State>()) {
  state_->dir = dir;
  state_->period_ms = period_ms;
  state_->newest = std::move(at_start);
  // Detached, with its own state, because a look at a share that hangs may return at any time.
  std::thread([state = state_] {
    std::string seen;  // empty: the folder may have changed since the start, so it is read once more
    std::unique_lock lock(state->mutex);
    while (!state->stop) {
      lock.unlock();
      std::shared_ptr<const config::DesignSet> read;
      std::string sign = folder_sign(state->dir);
      if (sign != seen) {
        try {
          read = std::make_shared<const config::DesignSet>(config::load_designs(state->dir));
        } catch (const std::exception& e) {
          // A file may be too large for the memory.
          read = std::make_shared<const config::DesignSet>(config::DesignSet{{}, {{state->dir + ": " + e.what()}}});
        }
        // A file that was changed while it was read is read again.
        if (folder_sign(state->dir) == sign) seen = std::move(sign);
      }
      lock.lock();
      if (read != nullptr && !config::same(*read, *state->newest)) state->newest = std::move(read);
      if (state->stop) break;
      state->wake.wait_for(lock, std::chrono::milliseconds(state->period_ms));
    }
  }).detach();
}

DesignWatch::~DesignWatch() {
  const std::lock_guard lock(state_->mutex);
  state_->stop = true;
  state_->wake.notify_all();
}

std::shared_ptr<const config::DesignSet> DesignWatch::newer_than(
    const std::shared_ptr<const config::DesignSet>& known) const {
  const std::lock_guard lock(state_->mutex);
  return state_->newest == known ? nullptr : state_->newest;
}

}  // namespace slabd::daemon
