// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pthread.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <atomic>
#include <cassert>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>

#include "base/fixed.h"

namespace slabd::daemon {

/// One thread that carries out jobs in order, so that the loop never waits for a disk, a scanner or a fit. Queues are
/// fixed; a full one is a return value. `fd()` becomes readable when an answer waits.
template <typename Job, typename Done, std::size_t Capacity>
class Worker {
 public:
  /// `work` runs on the thread for every job; `idle` runs there about ten times a second while there is none. `name`:
  /// of the thread, as ps and gdb show it, at most 15 characters.
  Worker(const char* name, std::function<Done(const Job&)> work, std::function<void()> idle)
      : name_(name),
        work_(std::move(work)),
        idle_(std::move(idle)),
        event_fd_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
        thread_([this] { run(); }) {}
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;
  /// Waits for the job in hand; jobs still queued are dropped (their effects were never promised).
  ~Worker() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_one();
    thread_.join();
    ::close(event_fd_);
  }

  [[nodiscard]] int fd() const { return event_fd_; }

  [[nodiscard]] bool push(const Job& job) {
    {
      const std::lock_guard lock(mutex_);
      if (!jobs_.push(job)) return false;
    }
    wake_.notify_one();
    return true;
  }

  /// Called by `work` on its thread: an answer ahead of the one that `work` returns. False when there is no room.
  bool post(const Done& done) {
    const std::lock_guard lock(mutex_);
    return give(done);
  }

  /// Oldest answer; false when none waits.
  [[nodiscard]] bool next(Done& done) {
    const std::lock_guard lock(mutex_);
    if (dones_.empty()) {
      std::uint64_t count = 0;
      while (::read(event_fd_, &count, sizeof count) > 0) {
      }
      return false;
    }
    done = dones_.front();
    dones_.pop();
    return true;
  }

  /// Turns of the thread; stands still only while it is stuck in a job.
  [[nodiscard]] std::uint64_t turns() const { return turns_.load(std::memory_order_relaxed); }
  /// Waits until no job is queued or running (tests, shutdown).
  void drain() {
    std::unique_lock lock(mutex_);
    settled_.wait(lock, [this] { return jobs_.empty() && !running_; });
  }

 private:
  void run() {
    pthread_setname_np(pthread_self(), name_);
    std::unique_lock lock(mutex_);
    while (!stop_) {
      turns_.fetch_add(1, std::memory_order_relaxed);
      if (jobs_.empty() || dones_.full()) {
        lock.unlock();
        idle_();
        lock.lock();
        if (jobs_.empty() && !stop_) wake_.wait_for(lock, std::chrono::milliseconds(100));
        continue;
      }
      const Job& job = job_ = jobs_.front();
      jobs_.pop();
      running_ = true;
      lock.unlock();
      done_ = work_(job);
      lock.lock();
      running_ = false;
      const bool given = give(done_);
      assert(given);  // room was checked before the job was taken, only this thread adds, and post() leaves one place
      (void)given;
      settled_.notify_all();
    }
  }

  /// Under the lock. The last place is kept for what a job in hand returns.
  bool give(const Done& done) {
    if (running_ && dones_.size() + 1 >= Capacity) return false;
    if (!dones_.push(done)) return false;
    const std::uint64_t one = 1;
    const auto written = ::write(event_fd_, &one, sizeof one);
    (void)written;
    return true;
  }

  const char* name_;
  std::function<Done(const Job&)> work_;
  std::function<void()> idle_;
  int event_fd_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::condition_variable settled_;
  FixedQueue<Job, Capacity> jobs_;
  FixedQueue<Done, Capacity> dones_;
  Job job_{};
  Done done_{};
  bool running_ = false;
  bool stop_ = false;
  std::atomic<std::uint64_t> turns_{0};
  std::thread thread_;  // last: starts when everything else is there
};

}  // namespace slabd::daemon
