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

/// What stands around the station in a random line: each part does its work turn by turn, and what goes wrong with it
/// is drawn from the seed.
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

/// In force, and for ever unless somebody says until when.
[[nodiscard]] LineCalibration calibration_named(const CalibrationId& id);

/// What a scan really shows, for whatever it is taken.
struct Exposure {
  std::uint64_t fingerprint = 0;
  std::int64_t slab_key = 0;  ///< 0: no slab's block
  int station = 0;
  [[nodiscard]] bool is_of(std::int64_t slab, int block) const { return slab_key == slab && station == block; }
  [[nodiscard]] std::string text() const;
};

/// The scanner and its worker. Each request makes an exposure, and one that failed may still come: a program that is
/// frozen gives what it holds, unseen or not, under every new name.
class TruthScanner {
 public:
  explicit TruthScanner(Chance& chance) : chance_(chance) {}

  bool is_frozen = false;
  bool worker_hangs = false;  ///< in a share, in a call that nobody can end
  bool all_is_well = false;

  /// `before_the_lens` is exposed unless the program is frozen. `delivered`: what it handed out before, to hand out
  /// again.
  void ask(const AcquireScan& action, const Exposure& before_the_lens, const std::vector<std::uint64_t>& delivered);
  void cancel() { request_->is_cancelled = true; }
  void process_ends() { request_.reset(); }
  /// At most one answer.
  std::optional<ScanDone> turn(std::int64_t now_ns);

  [[nodiscard]] bool is_asked() const { return request_.has_value(); }
  /// The points of a scan that is thrown away are there, and are on their way to the disk.
  [[nodiscard]] bool throws_away() const {
    return is_asked() && request_->is_decoded && request_->action.request.session == 0;
  }
  [[nodiscard]] bool writes_into(std::uint8_t slot) const {
    return is_asked() && !request_->is_decoded && request_->action.slot == slot;
  }
  /// What a program that is frozen would give.
  [[nodiscard]] const Exposure& holds() const { return held_; }
  [[nodiscard]] Exposure truth_of(std::uint64_t fingerprint) const;
  /// What lies in a buffer, and in a file.
  [[nodiscard]] Exposure in_slot(std::uint8_t slot) const { return slots_.at(slot); }
  [[nodiscard]] Exposure in_file(const PathText& path) const;
  void drop_file(const PathText& path) { files_.erase(std::string(path.view())); }

 private:
  enum class End : std::uint8_t { timeout, torn, no_room, good };
  struct Request {
    AcquireScan action;
    Exposure gives;
    End end = End::good;
    int turns_left = 0;
    bool is_decoded = false;
    bool is_cancelled = false;
  };
  [[nodiscard]] ScanDone last_word(Code code);

  Chance& chance_;
  std::optional<Request> request_;
  ScanDone first_word_;  ///< of the request in hand
  Exposure held_;
  std::map<std::uint64_t, Exposure> exposures_;
  std::array<Exposure, limits::kScanSlots> slots_{};
  std::map<std::string, Exposure> files_;
};

/// The storage worker's queue and the disk behind it.
class TruthDisk {
 public:
  TruthDisk(Chance& chance, MemoryStore& store) : chance_(chance), store_(store) {}

  bool fails = false;  ///< every commit, though some are done all the same
  bool is_slow = false;
  bool all_is_well = false;
  /// A commit that a later start depends on has just failed: the most telling moment to die.
  bool is_telling_moment = false;

  void push(const StoreJob& job) { queue_.push_back(job); }
  [[nodiscard]] std::size_t waiting() const { return queue_.size(); }
  /// The jobs that became due, answered.
  std::vector<StoreDone> turn();
  /// What was under way may be done; the rest is lost.
  void process_ends();

 private:
  StoreDone carry_out(const StoreJob& job);

  Chance& chance_;
  MemoryStore& store_;
  std::deque<StoreJob> queue_;
  int turns_left_ = 0;
};

/// The measuring's worker: every block is good, and some scans are refused.
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
