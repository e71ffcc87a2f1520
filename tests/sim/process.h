// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "tests/sim/fiber.h"
#include "tests/sim/world.h"

/// One process of slabd, with fibers for its threads. It sleeps on the world's time, can be suspended, and can die at
/// any moment. A dead process is run to its end without effect, so that its stacks release their objects. Its sleeps
/// return at once, and disk and wire ignore it.
namespace slabd::sim {

class Process {
 public:
  explicit Process(World& world) : world_(world) {}
  ~Process() { bury(); }

  struct Thread {
    std::unique_ptr<Fiber> fiber;
    std::int64_t wake_ns = 0;
  };
  Thread& start(std::function<void()> body);

  /// Time of the next action.
  [[nodiscard]] std::int64_t next_ns() const;
  /// Runs every thread that is due.
  void run_due();

  // From inside a thread.
  void sleep_until(std::int64_t when_ns);
  void sleep_for(std::int64_t time_ns) { sleep_until(world_.now_ns + time_ns); }
  /// Wakes a thread, which then runs now instead of later.
  void wake(Thread& thread) {
    if (thread.wake_ns > world_.now_ns) thread.wake_ns = world_.now_ns;
  }
  [[nodiscard]] Thread* current() const { return current_; }

  /// From now on the process has no effect.
  void die() { dead_ = true; }
  [[nodiscard]] bool dead() const { return dead_; }
  /// Suspends all threads until then.
  void hold(std::int64_t until_ns) { held_until_ns_ = until_ns; }
  [[nodiscard]] bool ended() const;
  /// Runs a dead process to its end.
  void bury();

 private:
  World& world_;
  std::vector<std::unique_ptr<Thread>> threads_;
  Thread* current_ = nullptr;
  std::int64_t held_until_ns_ = 0;
  bool dead_ = false;
};

}  // namespace slabd::sim
