// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <variant>

#include "base/noise_print.h"
#include "daemon/station/station.h"
#include "daemon/worker.h"
#include "hal/hal.h"

/// The workers for all tasks that the loop must not wait for. A running daemon has three threads, an inspector and the
/// memory of the scans; a simulation has its own workers, which use its clock.
namespace slabd::daemon {

/// The noise of the last exposures that were measured, of all slabs. The check belongs to the daemon's line only:
/// replays, inspections and studies measure the same exposure as often as they like.
class KnownExposures {
 public:
  /// The kept exposure with the largest correlation, if that is kSameExposure or more; null otherwise. The scan's own
  /// print (same slab, station and attempt) is not compared: a scan may be measured again after a restart.
  [[nodiscard]] const KeptNoise* same_as(const KeptNoise& exposure, double& correlation) const {
    const KeptNoise* found = nullptr;
    for (std::size_t i = 0; i < count_; ++i) {
      const KeptNoise& kept = kept_[i];
      if (is_same_scan(kept, exposure)) continue;
      const double now = noise_correlation(kept.print, exposure.print);
      if (!(now >= kSameExposure) || (found != nullptr && now <= correlation)) continue;
      found = &kept;
      correlation = now;
    }
    return found;
  }
  /// Replaces the scan's own print, or else the oldest one.
  void add(const KeptNoise& exposure) {
    for (std::size_t i = 0; i < count_; ++i) {
      if (!is_same_scan(kept_[i], exposure)) continue;
      kept_[i] = exposure;
      return;
    }
    kept_[next_] = exposure;
    next_ = (next_ + 1) % kept_.size();
    if (count_ < kept_.size()) ++count_;
  }

 private:
  static bool is_same_scan(const KeptNoise& a, const KeptNoise& b) {
    return a.slab_key == b.slab_key && a.station == b.station && a.attempt == b.attempt;
  }

  std::array<KeptNoise, limits::kNoisePrintsKept> kept_{};
  std::size_t count_ = 0;
  std::size_t next_ = 0;
};

/// The filters of the scanner's program, as the noise of neighbours shows them (ScanCounts::lag_ratio). All scans of a
/// line pass the same filters, so one scan that is smoothed unlike the others was processed differently: perhaps it is
/// an earlier exposure that a filter made unrecognisable. Knows the scans since the daemon started, so a changed filter
/// needs a restart.
class FilterWatch {
 public:
  /// The usual ratio of the scans before if this scan is smoothed and they were not, or much less; else NaN. Adds a
  /// scan that is like the others.
  [[nodiscard]] double unlike(double lag_ratio) {
    constexpr double kMuchLess = 0.8;  // independent noise has 3, the mean of any number of neighbours 2
    if (!has_value(lag_ratio)) return kNoValue;
    if (count_ >= kScansMin && lag_ratio < kSmoothedLagRatio && lag_ratio < kMuchLess * usual()) return usual();
    ratios_[next_] = lag_ratio;
    next_ = (next_ + 1) % ratios_.size();
    count_ = std::min(count_ + 1, ratios_.size());
    return kNoValue;
  }

 private:
  static constexpr std::size_t kScansMin = 3;

  [[nodiscard]] double usual() const {
    std::array<double, limits::kStationsMax> sorted = ratios_;
    std::sort(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(count_));
    return sorted[count_ / 2];
  }

  std::array<double, limits::kStationsMax> ratios_{};
  std::size_t count_ = 0;
  std::size_t next_ = 0;
};

/// Opens the store and reads its state.
struct OpenStore {};
/// Carries out the change by the CalibrationChanger.
struct ChangeCalibration {};
using StoreTask = std::variant<OpenStore, ChangeCalibration, StoreJob>;
/// The loop has the results of the first two.
using StoreAnswer = std::variant<OpenStore, ChangeCalibration, StoreDone>;
using StoreQueue = JobQueue<StoreTask, StoreAnswer>;
using ScanQueue = JobQueue<AcquireScan, ScanDone>;
using MeasureQueue = JobQueue<MeasureBlock, BlockMeasured>;

class Workers {
 public:
  virtual ~Workers() = default;
  // Storage and measuring are called once, and the queues are destroyed before the workers. `idle` is called about ten
  // times a second while the queue is empty.
  [[nodiscard]] virtual std::unique_ptr<StoreQueue> storage(std::function<StoreAnswer(const StoreTask&)> work,
                                                            std::function<void()> idle) = 0;
  /// Called once for each arm, in their order: every scanner has a worker of its own, so that one that hangs stops only
  /// its own arm.
  [[nodiscard]] virtual std::unique_ptr<ScanQueue> scanner(std::size_t arm,
                                                           std::function<ScanDone(const AcquireScan&)> work,
                                                           std::function<void()> idle) = 0;
  /// The exposures that were measured before this process began, oldest first. Before the first block is measured.
  virtual void remember(std::span<const KeptNoise> exposures) { static_cast<void>(exposures); }
  /// Measures the scans in the buffers. Every block is answered, also after an error.
  [[nodiscard]] virtual std::unique_ptr<MeasureQueue> measuring() = 0;
  /// Buffer for the points of a scan; `index` below limits::scan_slots() of the line's arms.
  [[nodiscard]] virtual std::span<float> slot(std::size_t index) = 0;
  /// CRC-32C of the points of a durable scan in records, from its file, because measuring may have changed its buffer
  /// by then. nullopt if the file cannot be read or contains other points. Called by the scanner's thread.
  [[nodiscard]] virtual std::optional<std::uint32_t> points_crc32c(const AcquiredScan& scan, std::size_t arm) = 0;
  /// Other recipes from the next block on. Called while no block is measured; `recipes` must outlive their use.
  virtual void use_recipes(std::span<const Recipe> /*recipes*/) {}
  /// The current block takes too long: it must be answered soon.
  virtual void give_up_measuring() {}
};

/// Form of the scan files of each arm.
using ScanForms = FixedVector<hal::ScanForm, limits::kArmsMax>;

/// Threads, and all memory of the inspection path, resident from the start. `recipes` and `clock` must outlive it.
/// `scan_forms`: one for each arm. `simulation`: the line is emulated, and an exposure that comes again is reported,
/// not refused.
[[nodiscard]] std::unique_ptr<Workers> make_workers(std::span<const Recipe> recipes, const ScanForms& scan_forms,
                                                    const hal::Clock& clock, int measure_threads,
                                                    bool simulation = false);
/// The same for a line with one arm.
[[nodiscard]] inline std::unique_ptr<Workers> make_workers(std::span<const Recipe> recipes,
                                                           const hal::ScanForm& scan_form, const hal::Clock& clock,
                                                           int measure_threads, bool simulation = false) {
  ScanForms scan_forms;
  (void)scan_forms.push(scan_form);
  return make_workers(recipes, scan_forms, clock, measure_threads, simulation);
}

/// One line to the service manager's journal, or to a terminal.
void say_line(const LogLine& line);

}  // namespace slabd::daemon
