// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "hal/hal.h"

/// Scripted mocks of the ports, for tests of the cycle and for replay: they open no sockets and do not sleep. Unlike
/// the real ports they may allocate.
namespace slabd::hal {

/// Clock whose time changes only when a test moves it.
class ManualClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t mono_ns() const override { return mono_ns_; }
  [[nodiscard]] std::int64_t utime_us() const override { return utime_us_; }
  /// Moves both clocks forward. Thread-safe.
  void advance(std::int64_t ns) {
    mono_ns_ += ns;
    utime_us_ += ns / kNsPerUs;
  }
  /// Sets only the wall clock, as a time server or an operator would.
  void set_utime_us(std::int64_t utime_us) { utime_us_ = utime_us; }

 private:
  std::atomic<std::int64_t> mono_ns_ = kNsPerS;
  std::atomic<std::int64_t> utime_us_ = 1'700'000'000'000'000;
};

class MockNotify final : public ServiceNotify {
 public:
  void ready() override { ++ready_count; }
  void watchdog() override { ++watchdog_count; }
  void status(std::string_view line) override { last_status = line; }
  void stopping() override { ++stopping_count; }

  int ready_count = 0;
  int watchdog_count = 0;
  int stopping_count = 0;
  std::string last_status;
};

/// Returns the written inputs one after the other and stores every published image.
class MockPlc final : public PlcPort {
 public:
  void write(const PlcInputs& inputs) { writes.push_back(inputs); }

  [[nodiscard]] std::size_t poll_fds(std::span<pollfd> fds) override;
  [[nodiscard]] bool next(std::int64_t mono_ns, PlcInputs& inputs) override;
  void publish(const PlcOutputs& outputs) override { published.push_back(outputs); }
  [[nodiscard]] std::size_t clients() const override { return client_count; }
  [[nodiscard]] const PlcLinkCounters& counters() const override { return link_counters; }
  [[nodiscard]] std::string_view trouble() const override { return link_trouble; }
  [[nodiscard]] bool next_note(std::int64_t mono_ns, PlcNoteText& text) override;
  [[nodiscard]] std::span<const std::uint16_t> holding() const override { return registers; }

  PlcLinkCounters link_counters;
  std::string link_trouble;
  std::deque<std::string> notes;
  std::vector<std::uint16_t> registers;
  std::deque<PlcInputs> writes;
  std::vector<PlcOutputs> published;
  std::size_t client_count = 1;
};

/// Returns the queued samples, each not before its `arrival_ns`.
class MockPose final : public PosePort {
 public:
  void push(const PoseSample& sample) { samples.push_back(sample); }

  [[nodiscard]] int fd() const override { return -1; }
  [[nodiscard]] bool next(std::int64_t mono_ns, PoseSample& sample) override;
  [[nodiscard]] const PoseLinkCounters& counters() const override { return link_counters; }
  [[nodiscard]] std::string_view trouble() const override { return link_trouble; }

  std::deque<PoseSample> samples;
  PoseLinkCounters link_counters;
  std::string link_trouble;  ///< if not empty, the link is down and no samples arrive
};

/// Answers each request with the next step of its script, or with trigger_timeout if none is left. acquire() returns at
/// once, unless the step is `hang`: then it waits for `cancel`. Write the script before acquire() runs on another
/// thread; read `requests` after it has returned.
class MockScanner final : public ScannerPort {
 public:
  explicit MockScanner(const Clock& clock) : clock_(clock) {}

  /// Answers with a scan from memory (mm, 3 floats per point); `width * height` is 0 or the point count.
  void answer_with(std::vector<float> xyz, std::size_t width = 0, std::size_t height = 0);
  /// Answers with a scan from a file, read by `read_scan`.
  void answer_with_file(std::string path, LengthUnit unit = LengthUnit::mm);
  void fail_with(Code code);
  void hang_until_cancelled();

  /// Implements the port; the scan is written to `<spool_path>.ply` if that path is not empty.
  [[nodiscard]] Result<AcquiredScan> acquire(const ScanRequest& request, std::span<float> xyz,
                                             const std::atomic<bool>& cancel, const ScanDecoded& decoded) override;
  void idle() override { ++idle_count; }
  [[nodiscard]] bool online() const override { return is_online; }
  [[nodiscard]] std::uint64_t stray_files() const override { return stray_count; }
  [[nodiscard]] bool hangs() const override { return is_hung; }

  std::vector<ScanRequest> requests;
  std::atomic<int> idle_count = 0;
  std::atomic<bool> is_online = true;
  std::atomic<bool> is_hung = false;
  std::atomic<std::uint64_t> stray_count = 0;

 private:
  using Step = std::function<Result<ScanShape>(std::span<float> xyz, const std::atomic<bool>& cancel)>;

  const Clock& clock_;
  std::deque<Step> script_;
};

}  // namespace slabd::hal
