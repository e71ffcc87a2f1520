// SPDX-License-Identifier: Apache-2.0
//
// A block of a scan takes milliseconds and its stages a fraction of one each; a condition variable would cost as much
// as some of the stages. So the helper looks at a counter, for a while without sleeping, and the caller likewise.
#include "base/team.h"

#include <pthread.h>

#include <array>
#include <cstddef>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace slabd {
namespace {

/// A tenth to a third of a millisecond of looking, as long as the machine's pause takes, before the thread lies down:
/// longer than what one thread does alone between two runs of a stage.
constexpr int kLooks = 8000;

void pause_briefly() {
#if defined(__x86_64__)
  _mm_pause();
#endif
}

/// What kernels keep on the stack, with room: written once, so that the first scan does not wait for these pages.
constexpr std::size_t kStackTouched = 128 * 1024;
void touch_stack() {
  std::array<volatile std::byte, kStackTouched> stack;
  for (std::size_t at = 0; at < stack.size(); at += 4'096) stack[at] = std::byte{0};
}

/// Returns once `counter` is no longer `old`.
void wait_for_change(const std::atomic<std::uint32_t>& counter, std::uint32_t old) {
  for (int i = 0; i < kLooks; ++i) {
    if (counter.load(std::memory_order_acquire) != old) return;
    pause_briefly();
  }
  counter.wait(old, std::memory_order_acquire);
}

}  // namespace

Team::Team(int threads) {
  if (threads >= 2) helper_ = std::thread([this] { help(); });
}

Team::~Team() {
  if (!helper_.joinable()) return;
  stop_.store(true, std::memory_order_relaxed);
  job_.fetch_add(1, std::memory_order_release);
  job_.notify_one();
  helper_.join();
}

void Team::take_blocks() {
  for (std::size_t block = next_.fetch_add(1, std::memory_order_relaxed); block < blocks_;
       block = next_.fetch_add(1, std::memory_order_relaxed))
    call_(context_, block);
}

void Team::run_erased(std::size_t blocks, Call call, void* context) {
  if (!helper_.joinable() || blocks < 2) {
    for (std::size_t block = 0; block < blocks; ++block) call(context, block);
    return;
  }
  call_ = call;
  context_ = context;
  blocks_ = blocks;
  next_.store(0, std::memory_order_relaxed);
  const std::uint32_t before = done_.load(std::memory_order_relaxed);
  job_.fetch_add(1, std::memory_order_release);
  job_.notify_one();
  take_blocks();
  wait_for_change(done_, before);
}

void Team::help() {
  pthread_setname_np(pthread_self(), "slabd-helper");  // as ps and gdb show it
  touch_stack();
  std::uint32_t seen = 0;
  for (;;) {
    wait_for_change(job_, seen);
    seen = job_.load(std::memory_order_acquire);
    if (stop_.load(std::memory_order_relaxed)) return;
    take_blocks();
    done_.fetch_add(1, std::memory_order_release);
    done_.notify_one();
  }
}

}  // namespace slabd
