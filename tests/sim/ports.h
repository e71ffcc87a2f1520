// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>
#include <string>

#include "hal/plc/modbus_codec.h"
#include "tests/sim/allocation.h"
#include "tests/sim/line.h"
#include "tests/sim/process.h"

/// slabd's ports, connected to the simulated line. A port belongs to one process; its peer outlives the process.
namespace slabd::sim {

// ---- robot poses ---------------------------------------------------------------------------------------------------

/// Datagrams of the robot bridge, decoded by slabd's own reader.
class PoseStream {
 public:
  PoseStream(const Line& line, std::size_t arm)
      : world_(line.world),
        robot_(line.robots[arm]),
        T_robot_base_(line.T_base_robot[arm].inverse()),
        is_first_(arm == 0),
        chance_(world_.chance(is_first_ ? 4 : 14)) {}
  /// Datagrams sent before this moment are not delivered any more.
  void begin() { sent_ns_ = world_.now_ns; }
  [[nodiscard]] bool next(PoseSample& sample, hal::PoseLinkCounters& counters);

 private:
  struct Datagram {
    std::array<std::byte, 160> bytes{};
    std::size_t size = 0;
    [[nodiscard]] std::span<const std::byte> span() const { return {bytes.data(), size}; }
  };
  void send();
  World& world_;
  const Robot& robot_;
  Pose T_robot_base_;
  bool is_first_;  ///< its base frame is that of the line
  Prng chance_;
  std::int64_t period_ns_ = 20 * kMs;
  std::int64_t sent_ns_ = 0;
  std::int32_t seq_ = 0;
  std::deque<Datagram> waiting_;
  Datagram held_back_;
  Datagram last_;
};

class SimPose final : public hal::PosePort {
 public:
  explicit SimPose(PoseStream& stream) : stream_(stream) { stream_.begin(); }
  [[nodiscard]] int fd() const override { return -1; }
  [[nodiscard]] bool next(std::int64_t mono_ns, PoseSample& sample) override {
    sample.arrival_ns = mono_ns;
    return stream_.next(sample, counters_);
  }
  [[nodiscard]] const hal::PoseLinkCounters& counters() const override { return counters_; }
  [[nodiscard]] std::string_view trouble() const override { return {}; }

 private:
  PoseStream& stream_;
  hal::PoseLinkCounters counters_;
};

// ---- scanner -------------------------------------------------------------------------------------------------------

class SimScanner final : public hal::ScannerPort {
 public:
  SimScanner(Line& line, Process& process, std::size_t arm);
  [[nodiscard]] Result<AcquiredScan> acquire(const ScanRequest& request, std::span<float> xyz,
                                             const std::atomic<bool>& cancel, const hal::ScanDecoded& decoded) override;
  void idle() override {}
  [[nodiscard]] bool online() const override { return true; }
  [[nodiscard]] std::uint64_t stray_files() const override { return stray_; }

 private:
  /// False if cancelled, or if the process is dead.
  bool wait(std::int64_t time_ns, const std::atomic<bool>& cancel);
  Line& line_;
  Process& process_;
  std::size_t arm_;
  Prng chance_;
  std::uint64_t stray_ = 0;
};

// ---- control socket ------------------------------------------------------------------------------------------------

/// The clients of the control socket: none, a flood, or an operator who takes views for a calibration.
class ControlRoom {
 public:
  ControlRoom(World& world, bool several_scanners)
      : world_(world), chance_(world.chance(6)), several_scanners_(several_scanners) {}
  [[nodiscard]] bool next(std::string& line);
  std::uint64_t answers = 0;

 private:
  World& world_;
  Prng chance_;
  bool several_scanners_;
  std::int64_t next_ns_ = 0;
  bool in_session_ = false;
};

class SimControl final : public hal::ControlPort {
 public:
  SimControl(World& world, ControlRoom& room) : world_(world), room_(room) {}
  [[nodiscard]] std::size_t poll_fds(std::span<pollfd>) override { return 0; }
  [[nodiscard]] bool next(std::int64_t, std::string_view& line) override {
    if (!room_.next(line_)) return false;
    answering_.emplace();
    line = line_;
    return true;
  }
  void reply(std::string_view json) override {
    answering_.reset();
    ++room_.answers;
    world_.trace.number(json.size());
    if (json.empty()) world_.violated("a control request was answered with nothing");
  }
  [[nodiscard]] std::uint32_t peer_uid() const override { return 1000; }

 private:
  World& world_;
  ControlRoom& room_;
  std::string line_;
  /// While an answer is made, memory is not refused: destructors of the JSON library ask for some, and a refusal there
  /// ends the process.
  std::optional<heap::Aside> answering_;
};

// ---- service manager -----------------------------------------------------------------------------------------------

class SimNotify final : public hal::ServiceNotify {
 public:
  explicit SimNotify(World& world) : world_(world) {}
  void ready() override {
    is_ready = true;
    fed_ns = world_.now_ns;
  }
  void watchdog() override { fed_ns = world_.now_ns; }
  void status(std::string_view line) override { world_.trace.bytes(line.data(), line.size()); }
  void stopping() override { is_stopping = true; }
  void begin() {
    is_ready = is_stopping = false;
    fed_ns = 0;
  }
  bool is_ready = false;
  bool is_stopping = false;
  std::int64_t fed_ns = 0;

 private:
  World& world_;
};

}  // namespace slabd::sim
