// SPDX-License-Identifier: Apache-2.0
//
// The state of the links comes from the daemon; if it does not run, the links are checked from here. PLC registers are
// only read. Poses can be received in parallel with the daemon, because multicast reaches all receivers.
#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/core.h>
#include <modbus.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "base/os.h"
#include "calib/calib.h"
#include "cli/client/arms.h"
#include "cli/client/control.h"
#include "cli/client/live_capture.h"
#include "cli/client/record_options.h"
#include "cli/doctor/doctor.h"
#include "cli/plc/plc.h"
#include "cli/pose_counts.h"
#include "cli/terminal/say.h"
#include "cli/watch/screen.h"
#include "emulator/robot_peer.h"
#include "hal/plc/plc_map.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// At a lower rate poses do not fill the settled window; the robot's cycle is 4 or 12 ms.
constexpr double kPoseRateMin_hz = 50.0;
constexpr double kClockSkew_s = 1.0;
constexpr std::int64_t kExpiresSoon_us = 30LL * 86'400 * 1'000'000;

struct ModbusFree {
  void operator()(modbus_t* context) const {
    modbus_close(context);
    modbus_free(context);
  }
};

const json& at(const json& document, std::initializer_list<const char*> path) {
  static const json kNothing;
  const json* here = &document;
  for (const char* key : path) {
    if (!here->is_object() || !here->contains(key)) return kNothing;
    here = &(*here)[key];
  }
  return *here;
}
std::string text(const json& value) {
  if (value.is_string()) return value.get<std::string>();
  return value.is_null() ? "-" : value.dump();
}
/// The daemon's status; null if it does not run.
json status_of(const std::string& answer) {
  return answer.empty() ? json(nullptr) : json::parse(answer, nullptr, false);
}
bool yes(const json& value) {
  return value.is_boolean() && value.get<bool>();
}

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

// ---- robot ---------------------------------------------------------------------------------------------------------

/// Poses received while listening.
struct ReceivedPoses {
  std::size_t poses = 0;
  std::int64_t first_ns = 0;
  std::int64_t last_ns = 0;
  std::int64_t age_ns = 0;  ///< age of the newest pose at the end
  double skew_s = 0.0;
  Vec3 low = Vec3::Constant(1e9);
  Vec3 high = Vec3::Constant(-1e9);
  PoseSample newest;
  void add(const PoseSample& sample, std::int64_t now_utime_us) {
    if (poses == 0) first_ns = sample.arrival_ns;
    ++poses;
    last_ns = sample.arrival_ns;
    skew_s = static_cast<double>(now_utime_us - sample.utime_us) / 1e6;
    low = low.cwiseMin(sample.T_base_flange.translation_mm);
    high = high.cwiseMax(sample.T_base_flange.translation_mm);
    newest = sample;
  }
};

ReceivedPoses listen(hal::PosePort& port, double seconds) {
  const std::unique_ptr<hal::Clock> clock = hal::make_system_clock();
  const std::int64_t end = clock->mono_ns() + static_cast<std::int64_t>(seconds * 1e9);
  ReceivedPoses heard;
  for (;;) {
    const std::int64_t now = clock->mono_ns();
    PoseSample sample;
    while (port.next(now, sample)) {
      sample.arrival_ns = now;
      heard.add(sample, clock->utime_us());
    }
    heard.age_ns = now - heard.last_ns;
    if (now >= end) return heard;
    if (port.fd() < 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      continue;
    }
    pollfd waiting{port.fd(), POLLIN, 0};
    (void)::poll(&waiting, 1, 50);
  }
}

/// Local programs that send from the ports in a refusal.
std::string programs_in(std::string_view why) {
  std::string text;
  for (std::size_t at = why.find(':'); at != std::string_view::npos; at = why.find(':', at + 1)) {
    unsigned port = 0;
    const char* end = why.data() + why.size();
    const auto [stop, fault] = std::from_chars(why.data() + at + 1, end, port);
    if (fault != std::errc{} || at == 0 || std::isdigit(static_cast<unsigned char>(why[at - 1])) == 0) continue;
    if (const std::string program = udp_program(port); !program.empty())
      text += say("{}port {} is {}", text.empty() ? "" : ", ", port, program);
  }
  return text;
}

/// Counts of rejected poses, with the last reason; empty if none was rejected.
std::string refused(const hal::PosePort& port) {
  std::string text = pose_faults_text(port.counters());
  const std::string_view why = port.refusal(hal::make_system_clock()->mono_ns());
  if (!why.empty()) text += say("{}last refused: {}", text.empty() ? "" : translated("; "), quote(why));
  if (const std::string programs = programs_in(why); !programs.empty()) text += fmt::format(" ({})", programs);
  return text;
}

void examine_poses(const config::ArmSettings& arm, const ReceivedPoses& heard, const hal::PosePort& port,
                   Examination& report) {
  const double span_s = static_cast<double>(heard.last_ns - heard.first_ns) / 1e9;
  const double rate_hz = span_s > 0.0 ? static_cast<double>(heard.poses - 1) / span_s : 0.0;
  const hal::PoseLinkCounters& counters = port.counters();
  const std::uint64_t not_believed = counters.other_type + counters.wrong_sender + counters.second_publisher +
                                     counters.malformed + counters.repeated + counters.time_back + counters.time_unit +
                                     counters.jumps;
  const std::string faults = refused(port);
  const std::string saw = say("{:.0f} poses/s, {}", rate_hz, faults.empty() ? say("no gaps") : faults);
  if (heard.age_ns > arm.pose.stale_ns)
    report.failed("robot poses",
                  say("the newest is {:.1f} s old; before: {}", static_cast<double>(heard.age_ns) / 1e9, saw),
                  say("does the robot's bridge still run, and is its network up?"));
  else if (rate_hz < kPoseRateMin_hz)
    report.failed("robot poses", saw, say("the robot must be sent every 4 to 12 ms"));
  else if (counters.gaps > heard.poses / 100 || not_believed > heard.poses / 100)
    report.warning("robot poses", saw, say("docs/ROBOT.md explains each of them and its cure"));
  else
    report.ok("robot poses", saw);

  const PoseSample& pose = heard.newest;
  if (arm.robot.type == hal::PoseType::flange_pose && !pose.measured)
    report.warning("robot poses", say("they are commanded, not measured (flags, bit 0)"),
                   say("commanded poses differ from the real ones: send the measured ones, docs/ROBOT.md"));
  if (pose.base_id != arm.pose.base_id || pose.tool_id != arm.pose.tool_id)
    report.failed("robot frame",
                  say("base {} and tool {} are active, expected {} and {}", pose.base_id, pose.tool_id,
                      arm.pose.base_id, arm.pose.tool_id),
                  say("$BASE = $NULLFRAME and $TOOL = $NULLFRAME in the robot's program, or correct [robot]"));
  else
    report.ok("robot frame", say("base {}, tool {}: the flange in the robot's base", pose.base_id, pose.tool_id));
  const Vec3 spread = heard.high - heard.low;
  const Vec3& p = pose.T_base_flange.translation_mm;
  const KukaAbc abc = kuka_abc_from_rotation(pose.T_base_flange.rotation);
  report.ok("robot position",
            say("X {:.3f} Y {:.3f} Z {:.3f} mm, A {:.3f} B {:.3f} C {:.3f} deg, moved {:.3f} mm meanwhile; "
                "compare with the pendant",
                p.x(), p.y(), p.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad),
                spread.maxCoeff()));
  if (pose.estop) report.note("robot position", say("the robot reports emergency stop"));
  if (pose.emulated)
    report.warning("robot poses", say("they declare themselves emulated (flags, bit 4): they are not from a robot"),
                   say("end the emulator (slabctl simulate) and start the robot's bridge"));
  if (std::abs(heard.skew_s) > kClockSkew_s)
    report.note("robot clock", say("the sender's clock is {:.1f} s off this computer's", heard.skew_s),
                say("only records show it; NTP on both sides mends it"));
}

/// True if the configuration is invalid: slabd has then no state of database and scanner, because it uses neither.
bool in_config_fault(const json& status) {
  const json& fault = at(status, {"fault", "code"});
  return fault.is_number() && fault.get<int>() == static_cast<int>(Code::config);
}
/// True if slabd still opens and checks its database: it has no state of it yet.
bool is_opening(const json& status) {
  return text(at(status, {"state"})) == "recover";
}

/// Cure of a daemon warning, by its bit of WARN (docs/PLC.md).
constexpr std::array kWarningCures = {
    marked("compare the recipe with the drawing, then confirmed = true; slabctl recipe show FILE lists what is not"),
    marked("slabctl calibrate new; docs/CALIBRATION.md"),
    marked("look into stray/ of the drop folder: does the scanner's software answer under other names, or twice? "
           "docs/DELIVERY.md"),
    marked("the PLC must copy RES_SEQ (IR 30) to RES_ACK (HR 2) once it has stored the record"),
    marked("set the clock (NTP); if it is right now, docs/OPERATING.md, \"The clock was wrong\""),
    marked("slabctl config check names file, line and key"),
    marked("free space on the disk of the scans or of the database (journalctl -u slabd shows which)"),
    marked("journalctl -u slabd shows why; does another slabd run?"),
    marked("slabctl calibrate check; docs/CALIBRATION.md, \"The daily check\""),
    marked("slabctl calibrate stations; docs/MASTERING.md"),
    marked("slabctl scanner verify; docs/SCANNER.md, \"Is it good enough?\""),
    marked("slabctl calibrate new, and apply it; docs/CALIBRATION.md"),
    marked("slabctl recipe diff shows the difference; slabctl recipe reload between two slabs"),
    marked(
        "expected on a test line; on a real one [line] simulation = false, real poses (flags, bits 0 and 4) and a real "
        "scanner; "
        "docs/PLC.md, STATUS bit 11"),
    marked("slabctl stations --krl FILE plans stops that differ; docs/ROBOT.md, \"The stations\""),
};

/// The status contains the warnings as text, in the order of their bits.
void examine_warnings(const json& status, Examination& report) {
  const json& bits = at(status, {"warn_bits"});
  unsigned rest = bits.is_number_unsigned() ? bits.get<unsigned>() : 0U;
  for (const std::string& warning : watch::warnings_at(status, language_in_use())) {
    const auto bit = static_cast<std::size_t>(std::countr_zero(rest));
    rest &= rest - 1U;
    report.warning("daemon", warning,
                   bit < kWarningCures.size() ? std::string(translated(kWarningCures[bit])) : "docs/PLC.md, WARN");
  }
}

}  // namespace

std::string examine_daemon(const config::Config& config, Examination& report) {
  const Result<std::string> answer = ask_daemon(config.control_socket, "{\"verb\":\"status\"}\n");
  if (!answer) {
    report.failed("daemon", std::string(answer.error().text.view()), "systemctl start slabd; journalctl -u slabd");
    return {};
  }
  const json status = json::parse(answer.value(), nullptr, false);
  if (!status.is_object() || text(at(status, {"schema"})) != "slabd.status/1") {
    report.failed("daemon", say("it answers in a form this slabctl does not know"),
                  say("install slabd and slabctl of one version"));
    return {};
  }
  const std::string saw = say("{}, state {}", text(at(status, {"software"})),
                              report::state_word(text(at(status, {"state"})), language_in_use()));
  const json& fault = at(status, {"fault", "code"});
  if (fault.is_number() && fault.get<int>() != 0)
    report.failed("daemon",
                  say("{}, fault {}: {}", saw, fault.get<int>(),
                      code_text(static_cast<Code>(fault.get<int>()), text(at(status, {"fault", "text"})))),
                  code_cure(static_cast<Code>(fault.get<int>()), text(at(status, {"fault", "cure"}))));
  else if (is_opening(status))
    report.warning("daemon", say("{}: it still opens its database", saw),
                   say("run slabctl doctor again when slabctl status shows idle"));
  else
    report.ok("daemon", saw);
  std::error_code not_there;
  if (!std::filesystem::equivalent(text(at(status, {"config"})), config.path, not_there))
    report.warning("daemon", say("it runs with {}", text(at(status, {"config"}))),
                   say("look at that one with --config, or restart the daemon"));
  examine_warnings(status, report);
  if (!yes(at(status, {"links", "store", "ok"})) && !in_config_fault(status) && !is_opening(status))
    report.failed("database",
                  say("the daemon cannot write it: {}", quote(text(at(status, {"links", "store", "text"})))),
                  say("journalctl -u slabd names the reason"));
  if (const json& plant = at(status, {"plant"}); plant.is_object()) {
    const std::string waits = say("{} results wait for the plant's database, the oldest for {:.0f} s{}",
                                  plant.value("unsent", std::int64_t{0}), plant.value("unsent_s", 0.0), "");
    if (yes(at(plant, {"late"})))
      report.warning("plant", waits, say("journalctl -u slabd-plant names the reason; docs/PLANT.md"));
    else
      report.ok("plant", waits);
  }
  return answer.value();
}

void examine_plc(const config::Config& config, bool daemon_runs, Examination& report) {
  if (config.plc.role != hal::PlcRole::server)
    return daemon_runs ? examine_through_daemon(config, report) : examine_far_end(config, report);
  examine_reachability(config, report);
  if (daemon_runs)
    examine_registers(config, report);
  else
    examine_free_port(config, report);
}

/// Receives poses of one robot for `seconds`.
static void examine_robot(const config::ArmSettings& arm, double seconds, Examination& report) {
  const Result<std::unique_ptr<hal::PosePort>> port = hal::make_lcm_pose_port(arm.robot);
  if (!port) {
    report.failed("robot link", quote(port.error().text.view()), say("correct [robot]"));
    return;
  }
  const ReceivedPoses heard = listen(*port.value(), seconds);
  const std::string trouble(port.value()->trouble());
  const hal::PoseLinkCounters& counters = port.value()->counters();
  const std::string faults = refused(*port.value());
  if (!trouble.empty()) {
    report.failed(
        "robot link", quote(trouble),
        fmt::format("ip address; ip route get {}; [robot] interface", emulator::multicast_group(arm.robot.url.view())));
  } else if (heard.poses == 0) {
    report.failed(
        "robot poses",
        say("none of channel {} on {} in {:.1f} s{}; {} foreign datagrams{}", arm.robot.channel.view(),
            arm.robot.url.view(), seconds, faults.empty() ? "" : say(" that could be believed"), counters.foreign,
            faults.empty() ? "" : say("; {}", faults)),
        faults.empty()
            ? say("is the robot's bridge running, on this channel and group, and is its network [robot] interface?")
        : counters.other_type != 0 ? say("set [pose] type in slabd.toml to the type that the bridge sends, or the "
                                         "bridge to slabd's; docs/ROBOT.md")
        : faults.find("the bridge says") != std::string::npos
            ? say("the bridge has no poses to send, for the reason that it gives; docs/ROBOT.md, \"KUKA over RSI\"")
            : say("docs/ROBOT.md explains each of them and its cure"));
  } else {
    report.ok("robot link", say("{} on {}", arm.robot.channel.view(), arm.robot.url.view()));
    examine_poses(arm, heard, *port.value(), report);
  }
}

/// Names the robot or the scanner of this arm in the findings, on a line with several.
static void name_part(const config::Config& config, const std::string& part, const PartId& id, Examination& report) {
  report.set_subject(config.arms.several() ? with_id(part, std::string(id.view())) : std::string());
}

void examine_robots(const config::Config& config, double seconds, Examination& report) {
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    name_part(config, say("robot"), config.arm(arm).by.robot, report);
    examine_robot(config.arm(arm), seconds, report);
  }
  report.set_subject({});
}

/// State of an arm in the daemon's status. nullopt, with a finding: the daemon has fewer arms.
static std::optional<ArmStatus<json>> arm_in(const json& status, std::size_t arm, std::string_view check,
                                             Examination& report) {
  std::vector<ArmStatus<json>> arms = arms_in(status);
  if (arm < arms.size()) return std::move(arms[arm]);
  report.failed(check, say("the daemon has no such scanner: it runs with another configuration"),
                say("systemctl restart slabd between two slabs"));
  return std::nullopt;
}

/// Checks the scanner of one arm.
static void examine_scanner(const config::Config& config, std::size_t arm, const json& status, bool scan,
                            Examination& report) {
  const config::ArmSettings& settings = config.arm(arm);
  const std::string drop(settings.scanner.drop_dir.view());
  const bool stream = settings.scanner_backend == hal::ScannerBackend::tcp;
  const std::string endpoint = fmt::format("{}:{}", settings.stream.host.view(), settings.stream.port);
  if (in_config_fault(status)) {
    report.unknown("scanner link", say("in fault 504 the daemon does not look for a scanner"));
  } else if (!status.is_null()) {
    const std::optional<ArmStatus<json>> state = arm_in(status, arm, "scanner link", report);
    if (!state) return;
    const json& link = state->scanner_link;
    const std::string why = text(at(link, {"text"}));
    if (yes(at(link, {"online"})))
      report.ok("scanner link", stream ? say("the scanner's gateway is connected to {}", endpoint)
                                       : say("{}/request and /inbox are there for the daemon", drop));
    else if (stream && why.find("cannot listen") != std::string::npos)
      report.failed("scanner link", quote(why),
                    say("ip address lists this computer's addresses; correct [scanner] listen"));
    else if (stream)
      report.failed("scanner link", say("no gateway is connected to {}", endpoint),
                    say("start the gateway; its address must be in [scanner] allow (docs/DELIVERY.md)"));
    else
      report.failed("scanner link", say("the daemon cannot use {}", drop),
                    say("mount the share, and make it writable for slabd"));
    const json& strays = at(link, {"strays"});
    if (strays.is_number() && strays.get<int>() != 0)
      report.warning("scanner link",
                     stream ? say("{} scans or connections were refused", strays.get<int>())
                            : say("{} files answered no request and lie in stray/", strays.get<int>()),
                     stream ? say("slabctl status shows what was wrong last; docs/DELIVERY.md")
                            : say("the scanner's software must name its file after the request"));
  }
  if (!scan) return report.note("scan", say("not tried"), say("slabctl doctor --scan has one taken"));
  if (status.is_null()) return report.unknown("scan", say("the daemon does not run"));
  Result<LiveCapture> capture = LiveCapture::begin(
      config.control_socket,
      {"doctor", "doctor", 60, false, config.arms.several() ? std::string(settings.by.scanner.view()) : ""});
  if (!capture) return report.failed("scan", quote(capture.error().text.view()), say("then try again"));
  const Result<LiveShot> shot = capture.value().shoot([](std::string_view) {});
  if (shot) {
    report.ok("scan", say("{} points {:.1f} s after the request; flange within {:.3f} mm", shot.value().points,
                          static_cast<double>(shot.value().scan_utime_us - shot.value().requested_utime_us) / 1e6,
                          shot.value().spread_mm));
    (void)capture.value().release(shot.value().scan_path);
  } else {
    report.failed("scan", quote(shot.error().text.view()),
                  std::string(report::cure_words(shot.error().code, language_in_use())));
  }
  (void)capture.value().end();
}

void examine_scanners(const config::Config& config, const std::string& status_text, bool scan, Examination& report) {
  const json status = status_of(status_text);
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    name_part(config, say("scanner"), config.arm(arm).by.scanner, report);
    examine_scanner(config, arm, status, scan, report);
  }
  report.set_subject({});
}

static void examine_acceptance(std::string_view id, std::string_view standing, Examination& report) {
  const std::string cure = "slabctl scanner verify; docs/SCANNER.md";
  if (standing == "verified")
    report.ok("acceptance", say("{} of the scanner", id));
  else if (id.empty())
    report.warning("acceptance", say("the scanner was not verified: U rests on the recipe's specification"), cure);
  else
    report.warning("acceptance",
                   standing == "expired" ? say("{} of the scanner has expired", id)
                   : standing == "other_temperature"
                       ? say("the scanner's temperature is too far from that of {}", id)
                       : say("after {} the scanner was verified and out of its limits", id),
                   cure);
}

/// Examines a line with a measured hand-eye and without corrections.
static void examine_uncorrected(const config::ArmSettings& arm, Examination& report) {
  if (has_value(arm.splice.absolute_mm) && has_value(arm.splice.absolute_rad)) return;
  report.failed(
      "stations", say("no station is corrected, and the robot's accuracy is not stated: no seat can pass"),
      say("set [robot] absolute_sigma_mm and absolute_sigma_deg, or master the stations (docs/MASTERING.md)"));
}

/// Calibrations of one arm as stored, without the daemon.
static void examine_stored(const config::ArmSettings& settings, const LineCalibration& calibration,
                           Examination& report) {
  if (calibration.source == LineCalibration::Source::applied)
    report.ok("calibration", say("{} was applied last", calibration.id.view()));
  else if (!calibration.trouble.empty())
    report.failed("calibration", quote(calibration.trouble.view()), "slabctl calibrate new; docs/CALIBRATION.md");
  else
    report.warning("calibration", say("none has been applied"), "docs/CALIBRATION.md");
  examine_acceptance(calibration.scanner.id.view(),
                     name(acceptance_state(calibration.scanner, hal::make_system_clock()->utime_us())), report);
  if (calibration.source == LineCalibration::Source::applied && calibration.tables.empty())
    examine_uncorrected(settings, report);
}

/// Calibrations of one arm as the daemon states them.
static void examine_in_force(const config::ArmSettings& settings, const json& calibration, Examination& report) {
  const std::string source = text(at(calibration, {"source"}));
  const std::string id = text(at(calibration, {"id"}));
  const std::int64_t now = hal::make_system_clock()->utime_us();
  const json& expires = at(calibration, {"expires_utime_us"});
  const std::int64_t expires_us = expires.is_number() ? expires.get<std::int64_t>() : 0;
  if (source == "missing")
    report.failed("calibration", say("there is none"), "slabctl calibrate new; docs/CALIBRATION.md");
  else if (expires_us != 0 && expires_us < now)
    report.failed("calibration", say("{} has expired", id), "slabctl calibrate new; docs/CALIBRATION.md");
  else if (source == "commissioning")
    report.warning("calibration", say("commissioning values: the position of the scanner was not measured"),
                   "slabctl calibrate new; docs/CALIBRATION.md");
  else if (expires_us != 0 && expires_us - now < kExpiresSoon_us)
    report.warning("calibration", say("{} expires in {} days", id, (expires_us - now) / 86'400'000'000),
                   say("plan a new one"));
  else
    report.ok("calibration", id);
  const json& stations = at(calibration, {"stations"});
  if (source == "applied" && (!stations.is_array() || stations.empty())) examine_uncorrected(settings, report);
  const json& scanner = at(calibration, {"scanner"});
  examine_acceptance(scanner.is_object() ? text(at(scanner, {"id"})) : "", text(at(scanner, {"state"})), report);
  for (const json& table : at(calibration, {"stations"}))
    if (text(at(table, {"state"})) != "used")
      report.warning(
          "corrections", say("{} is {}", text(at(table, {"id"})), translated(text(at(table, {"state"})))),
          say("slabctl calibrate stations --again --apply; if the scanner was moved, master the stations again"));
  for (const char* watch : {"reference_block", "monitor_ball"}) {
    const json& check = at(calibration, {watch});
    if (!check.is_object()) continue;
    const json& passed = at(check, {"passed"});
    if (passed.is_boolean() && !passed.get<bool>())
      report.failed("daily check", say("{}: {}", text(at(check, {"id"})), quote(text(at(check, {"note"})))),
                    say("find the cause, then slabctl calibrate check"));
    else if (yes(at(check, {"overdue"})))
      report.warning("daily check", say("{} is overdue", text(at(check, {"id"}))), "slabctl calibrate check");
    else
      report.ok("daily check", text(at(check, {"id"})));
  }
}

/// The tie of two robots as stored.
static void examine_stored_tie(const config::Config& config, const CellCalibration& calibration, Examination& report) {
  const std::int64_t now = hal::make_system_clock()->utime_us();
  const TieFault fault = fault_of_tie(calibration, config.arm(1).by.robot, now);
  if (fault == TieFault::none)
    report.ok("tie", std::string(calibration.tie.id.view()));
  else
    report.failed("tie", quote(describe(fault, calibration).view()), "slabctl calibrate tie; docs/TWO_ROBOTS.md");
}

/// The tie of two robots as the daemon states it.
static void examine_tie(const json& status, Examination& report) {
  const json& tie = at(status, {"tie"});
  const std::string cure = "slabctl calibrate tie; docs/TWO_ROBOTS.md";
  if (!tie.is_object())
    return report.failed("tie", say("there is none: scans of the second robot cannot be used"), cure);
  const std::string id = text(at(tie, {"id"}));
  const json& expires = at(tie, {"expires_utime_us"});
  const std::int64_t left_us =
      expires.is_number() ? expires.get<std::int64_t>() - hal::make_system_clock()->utime_us() : 0;
  const bool expires_soon = expires.is_number() && expires.get<std::int64_t>() != 0 && left_us < kExpiresSoon_us;
  if (const std::string trouble = text(at(tie, {"trouble"})); !trouble.empty() && trouble != "-")
    report.failed("tie", say("{}: {}", id, quote(trouble)), cure);
  else if (expires_soon)
    report.warning("tie", say("{} expires in {} days", id, left_us / 86'400'000'000), say("plan a new one"));
  else
    report.ok("tie", id);
}

void examine_calibrations(const config::Config& config, const std::string& status_text, Examination& report) {
  const json status = status_of(status_text);
  const bool by_daemon = !(status.is_null() || in_config_fault(status) || is_opening(status));
  std::unique_ptr<CellCalibration> stored;
  if (!by_daemon) {
    const auto reader = storage::open_reader(config.storage.db_path);
    if (!reader) return report.unknown("calibration", quote(reader.error().text.view()));
    auto read = reader.value()->cell_calibration(config.arms);
    if (!read) return report.unknown("calibration", quote(read.error().text.view()));
    stored = std::move(read.value());
  }
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    name_part(config, say("scanner"), config.arm(arm).by.scanner, report);
    if (stored != nullptr)
      examine_stored(config.arm(arm), stored->arm[arm], report);
    else if (const std::optional<ArmStatus<json>> state = arm_in(status, arm, "calibration", report))
      examine_in_force(config.arm(arm), state->calibration, report);
  }
  report.set_subject({});
  if (!config.arms.several()) return;
  if (const std::string why = one_acceptance_for_two(config); !why.empty())
    report.failed("acceptance", why, say("docs/SCANNER.md, \"Is it good enough?\""));
  if (stored != nullptr)
    examine_stored_tie(config, *stored, report);
  else
    examine_tie(status, report);
}

}  // namespace slabd::cli
