// SPDX-License-Identifier: Apache-2.0
//
// slabctl plc monitor: shows the live registers in words. If the daemon is a Modbus server, the monitor reads them
// over the network like a PLC or a display; it never writes, so it never takes over the command block. With the other
// two roles the link belongs to the PLC, and the registers come from the daemon's control socket.
#include <arpa/inet.h>
#include <fmt/format.h>
#include <modbus.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "cli/client/control.h"
#include "cli/exit.h"
#include "cli/plc/plc.h"
#include "cli/terminal/arguments.h"
#include "hal/plc/plc_map.h"

namespace slabd::cli {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::json;

struct Options {
  std::string config;
  std::string socket;
  std::string connect;
  bool once = false;
  bool as_json = false;
  int interval_ms = 500;
};

using Registers = PlcRegisters;

/// Sampling period of the heartbeats, independent of the display rate.
constexpr auto kLook = std::chrono::milliseconds(50);

// ---- two sources of the registers --------------------------------------------------------------------------------

class WireSource {
 public:
  WireSource(const hal::PlcSettings& plc, std::string host) : plc_(plc), host_(std::move(host)) {}

  Result<Registers> read() {
    Registers registers;
    registers.order = plc_.word_order;
    registers.from = fmt::format("Modbus/TCP {}:{}, unit {}", host_, plc_.port, plc_.unit_id);
    if (context_ == nullptr && !open()) return fail(registers, "connecting");
    constexpr int kInput = hal::kInputRegisters;
    constexpr int kHolding = hal::kHoldingRegisters;
    if (modbus_read_input_registers(context_.get(), 0, kInput, registers.input.data()) != kInput ||
        modbus_read_registers(context_.get(), 0, kHolding, registers.holding.data()) != kHolding)
      return fail(registers, "reading");
    return registers;
  }

 private:
  struct Closed {
    void operator()(modbus_t* context) const {
      modbus_close(context);
      modbus_free(context);
    }
  };
  bool open() {
    context_.reset(modbus_new_tcp(host_.c_str(), plc_.port));
    if (context_ == nullptr) return false;
    modbus_set_slave(context_.get(), plc_.unit_id);
    modbus_set_response_timeout(context_.get(), 1, 0);
    return modbus_connect(context_.get()) == 0;
  }
  Error fail(const Registers& registers, const char* doing) {
    const int reason = errno;
    context_.reset();
    return error(Code::scanner_offline, "%s: %s: %s; does slabd run, and is this computer in [plc] allow?",
                 registers.from.c_str(), doing, modbus_strerror(reason));
  }

  hal::PlcSettings plc_;
  std::string host_;
  std::unique_ptr<modbus_t, Closed> context_;
};

template <std::size_t Count>
bool take_words(const json& document, const char* key, std::array<std::uint16_t, Count>& words) {
  if (!document.contains(key) || !document[key].is_array() || document[key].size() != Count) return false;
  for (std::size_t i = 0; i < Count; ++i) {
    const json& word = document[key][i];
    if (!word.is_number_unsigned() || word.get<std::uint64_t>() > 0xFFFF) return false;
    words[i] = word.get<std::uint16_t>();
  }
  return true;
}

// ---- output ------------------------------------------------------------------------------------------------------

/// Time since a number last changed, as seen by this monitor.
class Pulse {
 public:
  void see(std::uint16_t value) {
    const auto now = Clock::now();
    if (seen_ && value != value_) changed_ = now;
    if (!seen_) first_ = now;
    seen_ = true;
    ++looks_;
    value_ = value;
  }
  [[nodiscard]] std::string text() const {
    const auto since = [](Clock::time_point then) {
      return std::chrono::duration<double>(Clock::now() - then).count();
    };
    if (changed_) return fmt::format("moved {:.1f} s ago", since(*changed_));
    if (looks_ < 2) return "seen once: whether it moves is not known";
    return fmt::format("not moved for {:.1f} s", since(first_));
  }
  [[nodiscard]] std::optional<double> age_s() const {
    if (!changed_) return std::nullopt;
    return std::chrono::duration<double>(Clock::now() - *changed_).count();
  }

 private:
  bool seen_ = false;
  int looks_ = 0;
  std::uint16_t value_ = 0;
  Clock::time_point first_;
  std::optional<Clock::time_point> changed_;
};

struct Pulses {
  Pulse plc;
  Pulse slabd;
  void see(const Registers& registers) {
    plc.see(registers.holding[0]);
    slabd.see(registers.input[4]);
  }
};

std::string address_text(const hal::RegisterRow& row) {
  const char* memory = row.memory == hal::RegisterRow::Memory::holding ? "HR" : "IR";
  return row.bit < 0 ? fmt::format("{} {}", memory, row.address)
                     : fmt::format("{} {}.{}", memory, row.address, row.bit);
}

std::string page(const Registers& registers, const Pulses& pulses) {
  std::string text =
      fmt::format("{}\nHEARTBEAT {}, PLC_HEARTBEAT {}\n", registers.from, pulses.slabd.text(), pulses.plc.text());
  if (!registers.trouble.empty()) text += fmt::format("TROUBLE   {}\n", registers.trouble);
  const auto checked = hal::decode_outputs(registers.input, registers.order);
  if (!checked) text += fmt::format("WARNING   {}\n", checked.error().text.view());
  const bool record = hal::record_intact(registers.input);
  std::string bits;
  int bits_at = -1;
  const auto flush = [&] {
    if (bits_at >= 0) text += fmt::format("{:<8} {}\n", bits_at, bits.empty() ? " -" : bits);
    bits.clear();
    bits_at = -1;
  };
  const hal::RegisterSink sink = [&](const hal::RegisterRow& row, std::string_view value) {
    if (row.bit >= 0) {
      if (bits_at < 0) text += row.memory == hal::RegisterRow::Memory::holding ? "HR " : "IR ";
      bits_at = row.address;
      if (value == "1") bits += fmt::format(" {}", row.name);
      return;
    }
    flush();
    const bool of_record = row.memory == hal::RegisterRow::Memory::input && row.address >= 30 && row.address < 64;
    const bool of_gauges = row.memory == hal::RegisterRow::Memory::holding && row.address >= hal::kGaugeFirst;
    const bool gauges = registers.holding[hal::kGaugeSeqAddress] != 0;
    const bool blank_row =
        of_gauges ? !gauges || (row.series != 0 && value == "-") : row.series != 0 && registers.input[row.address] == 0;
    if (row.type.empty() || (of_record && !record) || blank_row) return;
    text += fmt::format("{:<11} {:<26} {}\n", address_text(row), row.name, value);
  };
  text += "\nthe PLC has written\n";
  hal::list_inputs(registers.holding, registers.order, sink);
  flush();
  text += "\nslabd shows\n";
  hal::list_outputs(registers.input, registers.order, sink);
  flush();
  return text;
}

json as_json(const Registers& registers, const Pulses& pulses) {
  json list = json::array();
  const hal::RegisterSink sink = [&](const hal::RegisterRow& row, std::string_view value) {
    if (row.type.empty()) return;
    const bool holding = row.memory == hal::RegisterRow::Memory::holding;
    const std::uint16_t raw = holding ? registers.holding[row.address] : registers.input[row.address];
    list.push_back({{"address", address_text(row)},
                    {"name", row.name},
                    {"type", row.type},
                    {"unit", row.unit},
                    {"raw", raw},
                    {"value", value}});
  };
  hal::list_inputs(registers.holding, registers.order, sink);
  hal::list_outputs(registers.input, registers.order, sink);
  const auto checked = hal::decode_outputs(registers.input, registers.order);
  const auto age = [](const Pulse& pulse) { return pulse.age_s() ? json(*pulse.age_s()) : json(nullptr); };
  return {{"schema", "slabd.plc_monitor/1"},
          {"from", registers.from},
          {"trouble", registers.trouble},
          {"map_ok", checked.ok()},
          {"map_error", checked.ok() ? "" : checked.error().text.c_str()},
          {"record_intact", hal::record_intact(registers.input)},
          {"heartbeat_age_s", age(pulses.slabd)},
          {"plc_heartbeat_age_s", age(pulses.plc)},
          {"registers", list}};
}

volatile std::sig_atomic_t g_stop = 0;
void on_interrupt(int) {
  g_stop = 1;
}

void show(const Options& options, const Result<Registers>& registers, Pulses& pulses, bool in_place) {
  if (in_place) fmt::print("\x1b[H\x1b[J");  // home, clear
  if (!registers) {
    complain(fmt::format("{}", registers.error().text.view()));
    return;
  }
  pulses.see(registers.value());
  if (options.as_json) {
    fmt::print("{}\n", as_json(registers.value(), pulses)
                           .dump(in_place || !options.once ? -1 : 2, ' ', false, json::error_handler_t::replace));
  } else {
    fmt::print("{}", page(registers.value(), pulses));
  }
  std::fflush(stdout);
}

bool take_address(std::string_view text, hal::PlcSettings& plc) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) return false;
  const std::string host(text.substr(0, colon));
  in_addr address{};
  unsigned port = 0;
  const char* end = text.data() + text.size();
  const auto read = std::from_chars(text.data() + colon + 1, end, port);
  if (read.ec != std::errc() || read.ptr != end || port < 1 || port > 65'535) return false;
  if (::inet_pton(AF_INET, host.c_str(), &address) != 1) return false;
  plc.host = std::string_view(host);
  plc.port = static_cast<std::uint16_t>(port);
  return true;
}

/// An address that can be connected to, for one that is listened on.
std::string reachable_host(const hal::PlcSettings& plc) {
  return plc.host.view() == "0.0.0.0" ? "127.0.0.1" : std::string(plc.host.view());
}

int monitor(Options options) {
  config::Config config;
  // A remote slabd without a local configuration: unit 1, high word first.
  const bool foreign = !options.connect.empty() && !std::filesystem::exists(options.config);
  // slabd also runs with an invalid configuration, in fault 504, and takes registers and socket from it.
  const bool usable = foreign || config_from(options.config, config);
  if (!options.connect.empty()) {
    if (!take_address(options.connect, config.plc))
      stop(kUsage, fmt::format("--connect: found '{}', allowed is ADDRESS:PORT, an IPv4 address and a port from 1 to "
                               "65535, such as 192.168.0.2:1502",
                               options.connect));
    config.plc.role = hal::PlcRole::server;
  }
  const bool over_wire = config.plc.role == hal::PlcRole::server && options.socket.empty();
  const std::string socket = options.socket.empty() ? config.control_socket : options.socket;
  WireSource wire(config.plc, reachable_host(config.plc));
  Pulses pulses;
  const bool terminal = isatty(STDOUT_FILENO) != 0;
  if (!terminal && !options.as_json) options.once = true;
  std::signal(SIGINT, on_interrupt);
  const auto read = [&] {
    Result<Registers> registers = over_wire ? wire.read() : plc_registers(socket);
    // This computer need not be in [plc] allow to read from its own daemon.
    if (!registers && over_wire && options.connect.empty())
      if (Result<Registers> told = plc_registers(socket); told) registers = std::move(told);
    return registers;
  };
  for (;;) {
    Result<Registers> registers = read();
    show(options, registers, pulses, terminal && !options.once && !options.as_json);
    if (options.once || g_stop != 0) return !usable ? kBadInput : registers ? kDone : kNotReachable;
    // A heartbeat may be a bit, which can change twice between two displays.
    const auto next = Clock::now() + std::chrono::milliseconds(options.interval_ms);
    while (g_stop == 0 && Clock::now() < next) {
      std::this_thread::sleep_for(std::min<Clock::duration>(kLook, next - Clock::now()));
      if (!registers || Clock::now() >= next) continue;
      registers = read();
      if (registers) pulses.see(registers.value());
    }
  }
}

}  // namespace

Result<PlcRegisters> plc_registers(const std::string& control_socket) {
  const Result<std::string> answer = ask_daemon(control_socket, "{\"verb\":\"plc_image\"}\n");
  if (!answer) return answer.error();
  const json image = json::parse(answer.value(), nullptr, false);
  Registers registers;
  if (!image.is_object() || image.value("schema", "") != "slabd.plc_image/1" ||
      !take_words(image, "input", registers.input) || !take_words(image, "holding", registers.holding))
    return error(Code::scanner_offline,
                 "%s does not answer with slabd.plc_image/1; are slabd and slabctl of one version?",
                 control_socket.c_str());
  registers.order = image.value("word_order", "abcd") == "cdab" ? hal::WordOrder::cdab : hal::WordOrder::abcd;
  registers.from = fmt::format("{} role, through {}", image.value("role", "?"), control_socket);
  registers.trouble = image.value("trouble", "");
  return registers;
}

Result<PlcRegisters> plc_registers(const config::Config& config) {
  Result<PlcRegisters> told = plc_registers(config.control_socket);
  if (told || config.plc.role != hal::PlcRole::server) return told;
  return WireSource(config.plc, reachable_host(config.plc)).read();
}

void add_plc_monitor(args::Command& plc) {
  auto options = std::make_shared<Options>();
  args::Command command = plc.add_subcommand("monitor", "Every register live, in words; reads only, owns nothing");
  command->footer(
      "\nExit status 4 when slabd does not answer, 3 when the configuration is not usable (slabd runs with it, in "
      "fault\n"
      "504, and is read all the same).\nExample: slabctl plc monitor --once");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  args::Option connect = command->add_option(
      "--connect", options->connect, "ADDRESS:PORT of another slabd than the configured; needs no configuration here");
  command->add_option("--socket", options->socket, "Ask this control socket instead of Modbus")->excludes(connect);
  command->add_flag("--once", options->once, "Print once and end (always so when not on a terminal)");
  command->add_flag("--json", options->as_json, "slabd.plc_monitor/1; without --once one object a line");
  command->add_option("--interval-ms", options->interval_ms, "Between two looks")
      ->check(args::range(100, 60'000))
      ->capture_default_str();
  command->runs([options] { return monitor(*options); });
}

}  // namespace slabd::cli
