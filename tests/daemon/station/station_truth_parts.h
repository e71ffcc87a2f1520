// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/prng.h"
#include "daemon/station/station.h"
#include "tests/daemon/station/memory_store.h"

/// The parts around the station in a random line: each works turn by turn, with faults drawn from the seed.
namespace slabd::daemon {

class Chance {
 public:
  explicit Chance(std::uint64_t seed) : prng_(seed) {}
  bool happens(double probability) { return prng_.uniform() < probability; }
  int between(int least, int most) {
    return least + static_cast<int>(prng_.below(static_cast<std::uint64_t>(most - least) + 1));
  }

 private:
  Prng prng_;
};

/// A calibration in force, without expiry.
[[nodiscard]] LineCalibration calibration_named(const CalibrationId& id);

/// True content of a scan, independent of its assignment.
struct ExposureTruth {
  std::uint64_t fingerprint = 0;
  std::int64_t slab_key = 0;  ///< 0: no slab's block
  int station = 0;
  [[nodiscard]] bool is_of(std::int64_t slab, int block) const { return slab_key == slab && station == block; }
  [[nodiscard]] std::string text() const;
};

/// The scanner and its worker. Each request makes an exposure, and that of a failed request may still come. A frozen
/// program returns the exposure it holds, seen or not, under every new name.
class TruthScanner {
 public:
  explicit TruthScanner(Chance& chance) : chance_(chance) {}

  bool is_frozen = false;
  bool worker_hangs = false;  ///< in a share, in a call that cannot be interrupted
  bool all_is_well = false;

  /// `before_the_lens` is exposed unless the program is frozen. `delivered`: earlier scans, which it may return again.
  void ask(const AcquireScan& action, const ExposureTruth& before_the_lens,
           const std::vector<std::uint64_t>& delivered);
  void cancel() { request_->is_cancelled = true; }
  void process_ends() { request_.reset(); }
  /// Returns at most one answer.
  std::optional<ScanDone> turn(std::int64_t now_ns);

  [[nodiscard]] bool is_asked() const { return request_.has_value(); }
  /// True if the points of a discarded scan are decoded and being written to the disk.
  [[nodiscard]] bool throws_away() const {
    return is_asked() && request_->is_decoded && request_->action.request.session == 0;
  }
  [[nodiscard]] bool writes_into(std::uint8_t slot) const {
    return is_asked() && !request_->is_decoded && request_->action.slot == slot;
  }
  /// The exposure that a frozen program would return.
  [[nodiscard]] const ExposureTruth& holds() const { return held_; }
  [[nodiscard]] ExposureTruth truth_of(std::uint64_t fingerprint) const;
  /// Exposure in a buffer, and in a file.
  [[nodiscard]] ExposureTruth in_slot(std::uint8_t slot) const { return slots_.at(slot); }
  [[nodiscard]] ExposureTruth in_file(const PathText& path) const;
  void drop_file(const PathText& path) { files_.erase(std::string(path.view())); }

 private:
  enum class End : std::uint8_t { timeout, torn, no_room, good };
  struct Request {
    AcquireScan action;
    ExposureTruth gives;
    End end = End::good;
    int turns_left = 0;
    bool is_decoded = false;
    bool is_cancelled = false;
  };
  [[nodiscard]] ScanDone last_word(Code code);

  Chance& chance_;
  std::optional<Request> request_;
  ScanDone first_word_;  ///< of the present request
  ExposureTruth held_;
  std::map<std::uint64_t, ExposureTruth> exposures_;
  std::array<ExposureTruth, limits::kScanSlots> slots_{};
  std::map<std::string, ExposureTruth> files_;
};

/// The storage worker's queue and the disk behind it.
class TruthDisk {
 public:
  TruthDisk(Chance& chance, MemoryStore& store) : chance_(chance), store_(store) {}

  bool fails = false;  ///< every commit fails, although some are done
  bool is_slow = false;
  bool all_is_well = false;
  /// A commit that a later start depends on has just failed: the most useful moment for a death.
  bool is_telling_moment = false;

  void push(const StoreJob& job) { queue_.push_back(job); }
  [[nodiscard]] std::size_t waiting() const { return queue_.size(); }
  /// Carries out and answers the jobs that are due.
  std::vector<StoreDone> turn();
  /// The current job may be done; the others are lost.
  void process_ends();

 private:
  StoreDone carry_out(const StoreJob& job);

  Chance& chance_;
  MemoryStore& store_;
  std::deque<StoreJob> queue_;
  int turns_left_ = 0;
};

/// The measuring worker: every block is good, and some scans are refused.
class TruthMeasuring {
 public:
  explicit TruthMeasuring(Chance& chance) : chance_(chance) {}
  void push(const MeasureBlock& job) { queue_.push_back({job, chance_.between(1, 40)}); }
  void process_ends() { queue_.clear(); }
  std::optional<BlockMeasured> turn();
  bool all_is_well = false;
  [[nodiscard]] bool uses(std::uint8_t slot) const;

 private:
  struct Work {
    MeasureBlock job;
    int turns_left = 0;
  };
  Chance& chance_;
  std::deque<Work> queue_;
};

}  // namespace slabd::daemon
