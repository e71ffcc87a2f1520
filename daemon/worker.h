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

/// Jobs that are carried out in order, and their answers. Worker runs them on its own thread; a simulation on its own
/// clock.
template <typename Job, typename Done>
class JobQueue {
 public:
  virtual ~JobQueue() = default;
  /// Readable if an answer is available; -1: no descriptor.
  [[nodiscard]] virtual int fd() const = 0;
  /// False if the queue is full.
  [[nodiscard]] virtual bool push(const Job& job) = 0;
  /// Called while a job is carried out: an additional answer before the job's own. False if the queue is full.
  virtual bool post(const Done& done) = 0;
  /// Returns the oldest answer; false if there is none.
  [[nodiscard]] virtual bool next(Done& done) = 0;
  /// Counter that advances unless a job is stuck.
  [[nodiscard]] virtual std::uint64_t turns() const = 0;
  /// Waits until no job is queued or running (tests, shutdown).
  virtual void drain() = 0;
};

/// One thread that carries out jobs in order, so that the loop never waits for a disk, a scanner or a fit. Queues are
/// fixed; a full queue is reported by the return value. `fd()` becomes readable if an answer is available.
template <typename Job, typename Done, std::size_t Capacity>
class Worker final : public JobQueue<Job, Done> {
 public:
  /// `work` runs on the thread for every job; `idle` runs there about ten times a second while there is none. `name`:
  /// of the thread for ps and gdb, at most 15 characters.
  Worker(const char* name, std::function<Done(const Job&)> work, std::function<void()> idle)
      : name_(name),
        work_(std::move(work)),
        idle_(std::move(idle)),
        event_fd_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
        thread_([this] { run(); }) {}
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;
  /// Waits for the current job; queued jobs are dropped (their effects were not promised).
  ~Worker() override {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_one();
    thread_.join();
    ::close(event_fd_);
  }

  [[nodiscard]] int fd() const override { return event_fd_; }

  [[nodiscard]] bool push(const Job& job) override {
    {
      const std::lock_guard lock(mutex_);
      if (!jobs_.push(job)) return false;
    }
    wake_.notify_one();
    return true;
  }

  bool post(const Done& done) override {
    const std::lock_guard lock(mutex_);
    return give(done);
  }

  [[nodiscard]] bool next(Done& done) override {
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

  [[nodiscard]] std::uint64_t turns() const override { return turns_.load(std::memory_order_relaxed); }
  void drain() override {
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

  /// Requires the lock. The last place is reserved for the result of the current job.
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
  std::thread thread_;  // last: starts after all other members exist
};

}  // namespace slabd::daemon
