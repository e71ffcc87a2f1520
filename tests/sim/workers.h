// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>

#include "base/limits.h"
#include "daemon/workers.h"
#include "tests/sim/allocation.h"
#include "tests/sim/line.h"
#include "tests/sim/process.h"

/// slabd's workers as fibers of a simulated process, and a substitute for measuring that takes time and then returns
/// the content of the points.
namespace slabd::sim {

template <typename Job, typename Done, std::size_t Capacity>
class FiberQueue final : public daemon::JobQueue<Job, Done> {
 public:
  FiberQueue(Process& process, std::function<Done(const Job&)> work, std::function<void()> idle)
      : process_(process), work_(std::move(work)), idle_(std::move(idle)), loop_(*process.current()) {
    const heap::Aside aside;
    thread_ = &process_.start([this] { run(); });
  }
  FiberQueue(const FiberQueue&) = delete;
  FiberQueue& operator=(const FiberQueue&) = delete;
  ~FiberQueue() override {
    stop_ = true;
    while (!thread_->fiber->finished()) {
      process_.wake(*thread_);
      process_.sleep_for(kMs);
    }
  }

  [[nodiscard]] int fd() const override { return -1; }
  [[nodiscard]] bool push(const Job& job) override {
    const heap::Aside aside;
    if (jobs_.size() == Capacity) return false;
    jobs_.push_back(job);
    process_.wake(*thread_);
    return true;
  }
  bool post(const Done& done) override {
    const heap::Aside aside;
    if (dones_.size() + 1 >= Capacity) return false;
    dones_.push_back(done);
    process_.wake(loop_);
    return true;
  }
  [[nodiscard]] bool next(Done& done) override {
    const heap::Aside aside;
    if (dones_.empty()) return false;
    done = dones_.front();
    dones_.pop_front();
    return true;
  }
  [[nodiscard]] std::uint64_t turns() const override { return turns_; }
  void drain() override {
    while (!process_.dead() && (!jobs_.empty() || running_)) process_.sleep_for(kMs);
  }

 private:
  void run() {
    while (!stop_ && !process_.dead()) {
      ++turns_;
      if (jobs_.empty() || dones_.size() >= Capacity) {
        idle_();
        if (jobs_.empty() && !stop_) process_.sleep_for(100 * kMs);
        continue;
      }
      job_ = jobs_.front();
      jobs_.pop_front();
      running_ = true;
      done_ = work_(job_);
      running_ = false;
      if (process_.dead()) break;
      const heap::Aside aside;
      dones_.push_back(done_);
      process_.wake(loop_);
    }
  }

  Process& process_;
  std::function<Done(const Job&)> work_;
  std::function<void()> idle_;
  Process::Thread& loop_;
  Process::Thread* thread_ = nullptr;
  std::deque<Job> jobs_;
  std::deque<Done> dones_;
  Job job_{};  // members, as in Worker: a queue requests no memory after the start
  Done done_{};
  bool running_ = false;
  bool stop_ = false;
  std::uint64_t turns_ = 0;
};

class FiberWorkers final : public daemon::Workers {
 public:
  FiberWorkers(Process& process, Line& line, std::span<const Recipe> recipes)
      : process_(process), line_(line), recipes_(recipes), chance_(line.world.chance(9)) {}

  [[nodiscard]] std::unique_ptr<daemon::StoreQueue> storage(
      std::function<daemon::StoreAnswer(const daemon::StoreTask&)> work, std::function<void()> idle) override {
    return std::make_unique<FiberQueue<daemon::StoreTask, daemon::StoreAnswer, limits::kWorkerQueue>>(
        process_, std::move(work), std::move(idle));
  }
  [[nodiscard]] std::unique_ptr<daemon::ScanQueue> scanner(
      std::size_t /*arm*/, std::function<daemon::ScanDone(const daemon::AcquireScan&)> work,
      std::function<void()> idle) override {
    return std::make_unique<FiberQueue<daemon::AcquireScan, daemon::ScanDone, 4>>(process_, std::move(work),
                                                                                  std::move(idle));
  }
  [[nodiscard]] std::unique_ptr<daemon::MeasureQueue> measuring() override {
    return std::make_unique<FiberQueue<daemon::MeasureBlock, daemon::BlockMeasured, 4>>(
        process_, [this](const daemon::MeasureBlock& job) { return measure(job); }, [] {});
  }
  [[nodiscard]] std::span<float> slot(std::size_t index) override { return slots_[index]; }
  [[nodiscard]] std::optional<std::uint32_t> points_crc32c(const AcquiredScan&, std::size_t) override {
    return std::nullopt;
  }

 private:
  daemon::BlockMeasured measure(const daemon::MeasureBlock& job);

  Process& process_;
  Line& line_;
  std::span<const Recipe> recipes_;
  Prng chance_;
  std::array<std::array<float, kTruthFloats>, limits::kScanSlotsMax> slots_{};
};

}  // namespace slabd::sim
