// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/fiber.h"

#include <cxxabi.h>

#include <cassert>
#include <cstring>
#include <vector>

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/common_interface_defs.h>
#elif defined(__SANITIZE_THREAD__)
#include <sanitizer/tsan_interface.h>
#endif

namespace slabd::sim {
namespace {

/// SQLite and a result with its maps need some tens of kilobytes; memory is used only where it is touched.
constexpr std::size_t kStackBytes = 1'024 * 1'024;

thread_local Fiber* t_running = nullptr;

/// Stacks of ended fibers: a life has thousands of fibers, at most four at a time.
std::vector<std::unique_ptr<std::byte[]>>& spare_stacks() {
  thread_local std::vector<std::unique_ptr<std::byte[]>> stacks;
  return stacks;
}

}  // namespace

Fiber::Fiber(std::function<void()> body) : body_(std::move(body)) {
  auto& spare = spare_stacks();
  if (spare.empty()) {
    stack_.reset(new std::byte[kStackBytes]);
  } else {
    stack_ = std::move(spare.back());
    spare.pop_back();
  }
  getcontext(&own_);
  own_.uc_stack.ss_sp = stack_.get();
  own_.uc_stack.ss_size = kStackBytes;
  own_.uc_link = nullptr;
  makecontext(&own_, &Fiber::enter, 0);
#if defined(__SANITIZE_THREAD__)
  sanitizers_own_ = __tsan_create_fiber(0);
#endif
}

Fiber::~Fiber() {
  assert(finished_);
#if defined(__SANITIZE_THREAD__)
  __tsan_destroy_fiber(sanitizers_own_);
#endif
  spare_stacks().push_back(std::move(stack_));
}

void Fiber::switch_exceptions() {
  void* globals = abi::__cxa_get_globals();
  std::array<std::byte, 16> now;
  std::memcpy(now.data(), globals, now.size());
  std::memcpy(globals, exceptions_.data(), now.size());
  exceptions_ = now;
}

void Fiber::enter() {
  Fiber* self = t_running;
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_finish_switch_fiber(nullptr, &self->caller_bottom_, &self->caller_size_);
#endif
  self->body_();
  self->finished_ = true;
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_start_switch_fiber(nullptr, self->caller_bottom_, self->caller_size_);
#endif
  self->switch_out();
}

#if defined(__SANITIZE_ADDRESS__)
// The sanitizer mistakes a jump for a return, so jumps are not used with it.
void Fiber::switch_in() {
  swapcontext(&caller_, &own_);
}
void Fiber::switch_out() {
  swapcontext(&own_, &caller_);
}
#elif defined(__SANITIZE_THREAD__)
void Fiber::switch_in() {
  sanitizers_caller_ = __tsan_get_current_fiber();
  __tsan_switch_to_fiber(sanitizers_own_, 0);
  swapcontext(&caller_, &own_);
}
void Fiber::switch_out() {
  __tsan_switch_to_fiber(sanitizers_caller_, 0);
  swapcontext(&own_, &caller_);
}
#else
void Fiber::switch_in() {
  if (_setjmp(caller_jump_) != 0) return;
  if (entered_) _longjmp(own_jump_, 1);
  entered_ = true;
  swapcontext(&caller_, &own_);
}
void Fiber::switch_out() {
  if (_setjmp(own_jump_) == 0) _longjmp(caller_jump_, 1);
}
#endif

void Fiber::resume() {
  assert(t_running == nullptr && !finished_);
  t_running = this;
  switch_exceptions();
#if defined(__SANITIZE_ADDRESS__)
  void* fake = nullptr;
  __sanitizer_start_switch_fiber(&fake, stack_.get(), kStackBytes);
#endif
  switch_in();
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_finish_switch_fiber(fake, nullptr, nullptr);
#endif
  switch_exceptions();
  t_running = nullptr;
}

void Fiber::yield() {
  Fiber* self = t_running;
  assert(self != nullptr);
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_start_switch_fiber(&self->fake_stack_, self->caller_bottom_, self->caller_size_);
#endif
  self->switch_out();
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_finish_switch_fiber(self->fake_stack_, &self->caller_bottom_, &self->caller_size_);
#endif
}

bool Fiber::inside() {
  return t_running != nullptr;
}

}  // namespace slabd::sim
