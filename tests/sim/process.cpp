// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/process.h"

#include <algorithm>

namespace slabd::sim {

Process::Thread& Process::start(std::function<void()> body) {
  auto thread = std::make_unique<Thread>();
  thread->fiber = std::make_unique<Fiber>(std::move(body));
  thread->wake_ns = world_.now_ns;
  threads_.push_back(std::move(thread));
  return *threads_.back();
}

std::int64_t Process::next_ns() const {
  std::int64_t next = kNever;
  for (const auto& thread : threads_)
    if (!thread->fiber->finished()) next = std::min(next, thread->wake_ns);
  return next == kNever ? next : std::max(next, held_until_ns_);
}

void Process::run_due() {
  if (world_.now_ns < held_until_ns_) return;
  // By index, because a thread may start others.
  for (std::size_t i = 0; i < threads_.size() && !dead_; ++i) {
    Thread& thread = *threads_[i];
    if (thread.fiber->finished() || thread.wake_ns > world_.now_ns) continue;
    current_ = &thread;
    thread.fiber->resume();
    current_ = nullptr;
  }
}

void Process::sleep_until(std::int64_t when_ns) {
  // Simultaneous events are still executed in turn.
  if (dead_) {
    Fiber::yield();
    return;
  }
  current_->wake_ns = when_ns;
  Fiber::yield();
}

bool Process::ended() const {
  return std::all_of(threads_.begin(), threads_.end(), [](const auto& thread) { return thread->fiber->finished(); });
}

void Process::bury() {
  dead_ = true;
  while (!ended())
    for (std::size_t i = 0; i < threads_.size(); ++i) {
      if (threads_[i]->fiber->finished()) continue;
      current_ = threads_[i].get();
      current_->fiber->resume();
      current_ = nullptr;
    }
  threads_.clear();
}

}  // namespace slabd::sim
