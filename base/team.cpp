// SPDX-License-Identifier: Apache-2.0
//
// A block of a scan takes milliseconds and some stages only a fraction of one, as much as a condition variable would
// cost. Therefore helper and caller both spin on a counter for a while before they sleep.
#include "base/team.h"

#include <pthread.h>

#include <array>
#include <cstddef>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace slabd {
namespace {

/// Number of spins before a thread sleeps: 0.1 to 0.3 ms, depending on the machine's pause instruction. This is longer
/// than the caller's own work between two runs of a stage.
constexpr int kLooks = 8000;

void pause_briefly() {
#if defined(__x86_64__)
  _mm_pause();
#endif
}

/// Stack used by the kernels, with reserve; written once, so that the first scan does not wait for page faults.
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
  pthread_setname_np(pthread_self(), "slabd-helper");  // name shown by ps and gdb
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
