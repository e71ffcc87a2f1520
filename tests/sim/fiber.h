// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <setjmp.h>
#include <ucontext.h>

#include <array>
#include <cstddef>
#include <functional>
#include <memory>

/// Threads that run in turn on one thread, so that the simulation alone decides their order. A fiber runs until it
/// yields; then its resumer continues.
namespace slabd::sim {

class Fiber {
 public:
  explicit Fiber(std::function<void()> body);
  Fiber(const Fiber&) = delete;
  Fiber& operator=(const Fiber&) = delete;
  /// The fiber must have finished; otherwise objects on its stack would leak.
  ~Fiber();

  /// Runs the fiber until it yields or ends. Not from inside a fiber.
  void resume();
  /// Returns to the resumer; from inside the running fiber only.
  static void yield();
  [[nodiscard]] static bool inside();
  [[nodiscard]] bool finished() const { return finished_; }

 private:
  using Stack = std::unique_ptr<std::byte[]>;
  static void enter();
  void switch_in();
  void switch_out();
  void switch_exceptions();

  std::function<void()> body_;
  Stack stack_;
  ucontext_t own_{};
  ucontext_t caller_{};
  // After the first time: avoids swapcontext's two system calls for a signal mask that never changes.
  jmp_buf own_jump_{};
  jmp_buf caller_jump_{};
  bool entered_ = false;
  /// The C++ runtime's data about exceptions being handled belong to a stack, not to a thread.
  std::array<std::byte, 16> exceptions_{};
  bool finished_ = false;
#if defined(__SANITIZE_ADDRESS__)
  void* fake_stack_ = nullptr;
  const void* caller_bottom_ = nullptr;
  std::size_t caller_size_ = 0;
#elif defined(__SANITIZE_THREAD__)
  void* sanitizers_own_ = nullptr;
  void* sanitizers_caller_ = nullptr;
#endif
};

}  // namespace slabd::sim
