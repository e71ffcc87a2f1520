// SPDX-License-Identifier: Apache-2.0
//
// The link to the PLC comes from the daemon; if it does not run, it is checked from here. Registers are only read.
#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/core.h>
#include <modbus.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <thread>

#include "base/os.h"
#include "cli/doctor/doctor.h"
#include "cli/plc/plc.h"
#include "cli/terminal/say.h"
#include "hal/plc/plc_map.h"

namespace slabd::cli {
namespace {

struct ModbusFree {
  void operator()(modbus_t* context) const {
    modbus_close(context);
    modbus_free(context);
  }
};

/// Address of the server from this computer.
std::string reach(const config::Config& config) {
  const std::string host(config.plc.host.view());
  return host == "0.0.0.0" || host.empty() ? "127.0.0.1" : host;
}

/// True if the service has the right to bind privileged ports; the delivered unit does not have it.
bool service_may_bind_any_port() {
  namespace fs = std::filesystem;
  for (const char* folder : {"/etc/systemd/system/slabd.service.d", "/run/systemd/system/slabd.service.d"}) {
    std::error_code none;
    for (fs::directory_iterator entry(folder, none), end; !none && entry != end; entry.increment(none)) {
      std::ifstream file(entry->path());
      for (std::string line; std::getline(file, line);)
        if (line.rfind("AmbientCapabilities=", 0) == 0 && line.find("CAP_NET_BIND_SERVICE") != std::string::npos)
          return true;
    }
  }
  return false;
}

/// False, with a finding, if the daemon may not open the port; the rights of the current user do not matter.
bool examine_privileged_port(const config::Config& config, const std::string& where, Examination& report) {
  unsigned first_free = 1024;
  std::ifstream("/proc/sys/net/ipv4/ip_unprivileged_port_start") >> first_free;
  if (config.plc.port >= first_free || daemon_user().uid == 0 || service_may_bind_any_port()) return true;
  report.failed("plc port", say("{} may only be opened by root, and the service has no such right", where),
                say("a port from {} on in [plc] listen; or systemctl edit slabd: [Service] "
                    "AmbientCapabilities=CAP_NET_BIND_SERVICE and CapabilityBoundingSet=CAP_NET_BIND_SERVICE",
                    first_free));
  return false;
}

/// Checks that the port is free before the daemon starts.
void examine_free_port(const config::Config& config, Examination& report) {
  const std::string where = fmt::format("{}:{}", config.plc.host.view(), config.plc.port);
  if (!examine_privileged_port(config, where, report)) return;
  const Fd socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!socket.is_open()) return report.unknown("plc port", quote(std::strerror(errno)));
  const int one = 1;
  (void)::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(config.plc.port);
  const std::string host(config.plc.host.view());
  const bool numeric = ::inet_pton(AF_INET, host.c_str(), &address.sin_addr) == 1;
  const int fault =
      !numeric ? EINVAL
      : ::bind(socket.get(), static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address) == 0
          ? 0
          : errno;
  if (fault == 0)
    report.ok("plc port", say("{} is free for the daemon", where));
  else if (fault == EADDRINUSE)
    report.failed("plc port", say("{} is in use by another program", where),
                  say("ss -ltnp 'sport = :{}' names it; end it or change [plc] listen", config.plc.port));
  else if (fault == EADDRNOTAVAIL)
    report.failed("plc port", say("{} is not an address of this computer", host),
                  say("ip address lists them; correct [plc] listen, or 0.0.0.0 for all"));
  else if (fault == EACCES)
    report.unknown("plc port", say("{} may only be opened by root", where), say("run slabctl doctor as root"));
  else
    report.failed("plc port", say("{}: {}", where, quote(std::strerror(fault))), say("correct [plc] listen"));
}

void examine_reachability(const config::Config& config, Examination& report) {
  const std::string host(config.plc.host.view());
  const bool all_here = !config.plc.allow.empty() &&
                        std::all_of(config.plc.allow.begin(), config.plc.allow.end(), [](const auto& network) {
                          return network.address >> 24U == IN_LOOPBACKNET && network.mask >> 24U == 0xFFU;
                        });
  if (host.rfind("127.", 0) == 0 || all_here)
    report.note("plc network",
                say("{}: only a PLC on this computer can connect",
                    all_here ? say("[plc] allow names this computer only") : "[plc] listen = " + host),
                say("for a PLC elsewhere: this computer's address in its network, and the PLC's in [plc] allow"));
  else if (config.plc.allow.empty())
    report.failed("plc network", say("[plc] allow is empty: only this computer may connect"),
                  say("allow = [\"192.168.1.10/32\"], the PLC's address"));
  else
    report.ok("plc network", say("{} {} may connect", config.plc.allow.size(),
                                 config.plc.allow.size() == 1 ? say("network") : say("networks")));
}

bool read_holding(modbus_t* client, hal::HoldingImage& holding) {
  return modbus_read_registers(client, 0, static_cast<int>(holding.size()), holding.data()) ==
         static_cast<int>(holding.size());
}

bool read_image(modbus_t* client, hal::InputImage& input, hal::HoldingImage& holding) {
  return modbus_read_input_registers(client, 0, static_cast<int>(input.size()), input.data()) ==
             static_cast<int>(input.size()) &&
         read_holding(client, holding);
}

/// Reads the PLC's half until its heartbeat has changed, for at most 1.2 s. It polls fast, because the heartbeat may
/// be a bit that changes every 500 ms, and an even number of changes would be missed. False: `read` failed.
bool watch_heartbeat(const std::function<bool(hal::HoldingImage&)>& read, hal::HoldingImage& first,
                     hal::HoldingImage& later) {
  using Clock = std::chrono::steady_clock;
  if (!read(first)) return false;
  later = first;
  for (const auto end = Clock::now() + std::chrono::milliseconds(1'200); later[0] == first[0] && Clock::now() < end;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (!read(later)) return false;
  }
  return true;
}

/// Checks the PLC's registers as read by watch_heartbeat.
void examine_plc_half(const config::Config& config, const hal::HoldingImage& first, const hal::HoldingImage& later,
                      Examination& report) {
  const PlcInputs plc = hal::decode_inputs(later, config.plc.word_order);
  if (first[0] == later[0])
    report.failed("plc heartbeat", say("HR 0 has been {} for 1.2 s", later[0]),
                  say("the PLC must change HR 0 every 500 ms: is it in RUN, connected, and writing?"));
  else
    report.ok("plc heartbeat", say("HR 0 went from {} to {}", first[0], later[0]));
  if (!plc.enable)
    report.note("plc enable", say("ENABLE (HR 1, bit 0) is off: commands are refused"),
                say("switch the PLC to automatic"));
  // A slab number with swapped words is a multiple of 65536.
  if (plc.slab_no != 0 && (plc.slab_no & 0xFFFFU) == 0)
    report.warning("word order", say("SLAB_NO reads {}, as if its words were swapped", plc.slab_no),
                   say("compare WORD_PROBE (IR 2-3) in the PLC with 0x12345678; set [plc] word_order"));
}

/// The link belongs to the PLC (client, serial line): the daemon reports its registers.
void examine_through_daemon(const config::Config& config, Examination& report) {
  hal::HoldingImage first{};
  hal::HoldingImage later{};
  std::string unanswered;
  std::string trouble;
  const auto read = [&](hal::HoldingImage& holding) {
    const Result<PlcRegisters> seen = plc_registers(config.control_socket);
    if (!seen)
      unanswered = std::string(seen.error().text.view());
    else
      trouble = seen.value().trouble;
    if (!seen || !trouble.empty()) return false;
    holding = seen.value().holding;
    return true;
  };
  if (!watch_heartbeat(read, first, later))
    return trouble.empty() ? report.unknown("plc registers", unanswered)
                           : report.failed("plc link", quote(trouble), say("docs/PLC.md, who moves the bytes"));
  report.ok("plc link", say("the daemon has a connection"));
  examine_plc_half(config, first, later, report);
}

void examine_registers(const config::Config& config, Examination& report) {
  const std::string where = fmt::format("{}:{}", reach(config), config.plc.port);
  const std::unique_ptr<modbus_t, ModbusFree> client(modbus_new_tcp(reach(config).c_str(), config.plc.port));
  if (client == nullptr) return report.unknown("plc registers", quote(modbus_strerror(errno)));
  modbus_set_slave(client.get(), config.plc.unit_id);
  modbus_set_response_timeout(client.get(), 1, 0);
  hal::InputImage input{};
  hal::HoldingImage first{};
  hal::HoldingImage later{};
  if (modbus_connect(client.get()) != 0 || !read_image(client.get(), input, first)) {
    if (plc_registers(config.control_socket)) {
      report.note("plc registers", say("{} does not let this computer read; the daemon's own figures are used", where),
                  say("right as it is, when [plc] allow names the PLC alone"));
      return examine_through_daemon(config, report);
    }
    return report.failed("plc registers", say("{}: {}", where, quote(modbus_strerror(errno))),
                         say("is this computer in [plc] allow, and are not all connections taken?"));
  }
  const Result<PlcOutputs> outputs = hal::decode_outputs(input, config.plc.word_order);
  if (!outputs) return report.failed("plc registers", quote(outputs.error().text.view()), say("is this slabd's port?"));
  const bool abcd = config.plc.word_order == hal::WordOrder::abcd;
  report.ok("plc registers", say("map 1.1 on {}; WORD_PROBE is {:04X} {:04X} ({})", where, input[2], input[3],
                                 abcd ? say("abcd, high word first") : say("cdab, low word first")));
  if (!watch_heartbeat([&](hal::HoldingImage& holding) { return read_holding(client.get(), holding); }, first, later))
    return report.failed("plc registers", say("{}: {}", where, quote(modbus_strerror(errno))),
                         say("look at the daemon's log"));
  examine_plc_half(config, first, later, report);
}

/// Opens the device as the daemon does, which distinguishes a serial line from other files; its mode shows whether
/// slabd may open it.
void examine_serial_line(const char* device, Examination& report) {
  constexpr const char* kCheck = "plc line";
  const Fd port(::open(device, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  const int fault = port.is_open() ? 0 : errno;
  termios line{};
  const bool serial = port.is_open() && ::tcgetattr(port.get(), &line) == 0;
  constexpr unsigned kReadAndWrite = 6;
  const DaemonUser account = daemon_user();
  struct stat file {};
  if (::stat(device, &file) == 0 && !S_ISDIR(file.st_mode) && !may(account, file, kReadAndWrite))
    report.failed(kCheck, say("{} may not be opened by {}", device, account.name),
                  say("usermod -aG dialout {}, or the group that ls -l {} names", account.name, device));
  else if (fault == EACCES)
    report.unknown(kCheck, say("{}: {}", device, quote(std::strerror(fault))),
                   say("run slabctl doctor as root or as the daemon's user"));
  else if (fault != 0)
    report.failed(kCheck, say("{}: {}", device, quote(std::strerror(fault))),
                  say("is the adapter plugged in, and does no other program hold it?"));
  else if (!serial)
    report.failed(kCheck, say("{} is not a serial line", device), say("correct [plc] device, such as /dev/ttyUSB0"));
  else
    report.ok(kCheck, say("{} is a serial line and can be opened by {}", device, account.name));
}

/// Checks the PLC's side without the daemon: the server, or the serial line.
void examine_far_end(const config::Config& config, Examination& report) {
  if (config.plc.role == hal::PlcRole::rtu) {
    return examine_serial_line(config.plc.device.c_str(), report);
  }
  const std::string where = fmt::format("{}:{}", config.plc.host.view(), config.plc.port);
  const std::unique_ptr<modbus_t, ModbusFree> client(modbus_new_tcp(config.plc.host.c_str(), config.plc.port));
  if (client == nullptr) return report.unknown("plc", quote(modbus_strerror(errno)));
  modbus_set_response_timeout(client.get(), 1, 0);
  if (modbus_connect(client.get()) == 0)
    report.ok("plc", say("{} takes a connection", where));
  else
    report.failed("plc", say("{}: {}", where, quote(modbus_strerror(errno))),
                  say("is the PLC's Modbus server on, and is [plc] connect right?"));
}

}  // namespace

void examine_plc(const config::Config& config, bool daemon_runs, Examination& report) {
  if (config.plc.role != hal::PlcRole::server)
    return daemon_runs ? examine_through_daemon(config, report) : examine_far_end(config, report);
  examine_reachability(config, report);
  if (daemon_runs)
    examine_registers(config, report);
  else
    examine_free_port(config, report);
}

}  // namespace slabd::cli
