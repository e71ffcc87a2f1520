// SPDX-License-Identifier: Apache-2.0
#include "daemon/opening.h"

#include <poll.h>

#include <array>
#include <thread>
#include <utility>

namespace slabd::daemon {
namespace {

constexpr int kTurn_ms = 10;
constexpr std::int64_t kWatchdogPeriod_ns = 3 * kNsPerS;

/// Result of the thread; shared, because the thread may outlive the caller.
struct Opened {
  std::unique_ptr<Result<std::unique_ptr<storage::Store>>> result;
  std::atomic<bool> done{false};
};

void wait(const Ports& ports) {
  std::array<pollfd, hal::kPlcPollFds + hal::kControlPollFds> fds{};
  std::size_t count = ports.plc.poll_fds(std::span(fds).first(hal::kPlcPollFds));
  if (ports.control != nullptr) count += ports.control->poll_fds(std::span(fds).subspan(count, hal::kControlPollFds));
  ::poll(fds.data(), count, kTurn_ms);
}

/// Answers requests of displays and alarms while a database of gigabytes is read for a minute.
std::string answer(std::string_view line, const Ports& ports, const Station& station, const LoopFigures& figures) {
  if (line.find("\"status\"") != std::string_view::npos) return status_json(station, ports, figures);
  if (line.find("\"metrics\"") != std::string_view::npos) return metrics_json(station, ports, figures);
  return R"({"schema":"slabd.error/1","error":"the database is being opened; ask again"})";
}

void serve_control(const Ports& ports, const Station& station, const LoopFigures& figures) {
  std::string_view line;
  for (std::size_t i = 0; i < limits::kControlClientsMax && ports.control->next(ports.clock.mono_ns(), line); ++i)
    ports.control->reply(answer(line, ports, station, figures));
}

}  // namespace

std::unique_ptr<Result<std::unique_ptr<storage::Store>>> open_beside_the_line(const OpenStore& open, const Ports& ports,
                                                                              const StationSettings& settings,
                                                                              const LoopFigures& figures,
                                                                              const std::atomic<bool>& stop) {
  const auto opened = std::make_shared<Opened>();
  std::thread([opened, open] {
    opened->result = std::make_unique<Result<std::unique_ptr<storage::Store>>>(open());
    opened->done = true;
  }).detach();

  // A station before its recovery refuses all commands and reports that.
  const auto station = std::make_unique<Station>(settings);
  const auto actions = std::make_unique<Actions>();
  ports.notify.ready();
  bool pressed = false;
  std::int64_t fed_ns = ports.clock.mono_ns() - kWatchdogPeriod_ns;
  while (!opened->done) {
    if (stop) return nullptr;
    wait(ports);
    const std::int64_t now_ns = ports.clock.mono_ns();
    step(*station, Tick{now_ns, ports.clock.utime_us()}, *actions);
    PlcInputs inputs;
    for (std::size_t i = 0; i < limits::kModbusFramesPerTurn && ports.plc.next(now_ns, inputs); ++i) {
      if (ports.fault_reset_held != nullptr) {
        const bool held = std::exchange(*ports.fault_reset_held, inputs.fault_reset);
        pressed = pressed || (inputs.fault_reset && !held);
      }
      step(*station, inputs, *actions);
    }
    ports.plc.publish(plc_view(*station));
    if (ports.control != nullptr) serve_control(ports, *station, figures);
    if (now_ns - fed_ns < kWatchdogPeriod_ns) continue;
    fed_ns = now_ns;
    ports.notify.watchdog();
    ports.notify.status("the database is being opened and checked");
  }
  // A reset that was pressed meanwhile and is still held triggers one more try.
  if (pressed) *ports.fault_reset_held = false;
  return std::move(opened->result);
}

}  // namespace slabd::daemon
