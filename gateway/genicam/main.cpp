// SPDX-License-Identifier: Apache-2.0
//
// slabd-genicam: takes the scans of a GigE Vision camera and hands them to slabd over the scan stream. A program of its
// own, because Aravis has threads and a heap of its own and can crash on what a camera sends. slabd never waits for it
// longer than for any scanner.
#include <fmt/core.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <thread>
#include <vector>

#include "base/os.h"
#include "base/rate_limit.h"
#include "gateway/genicam/camera.h"
#include "gateway/genicam/link.h"
#include "hal/hal.h"

namespace slabd::gateway::genicam {
namespace {

constexpr int kExitUsage = 2;
constexpr int kExitBadInput = 3;
constexpr int kExitUnreachable = 4;
/// Interval between two tries to reach camera or slabd. A camera that another run controlled is free after its
/// heartbeat timeout, 3 s by default.
constexpr std::int64_t kRetry_ns = kNsPerS;
/// A repeated reason is logged at most once in this time.
constexpr std::int64_t kRepeat_ns = 60 * kNsPerS;
/// Interval in which the program looks at its stop flag.
constexpr int kWait_ms = 200;
/// Time that is left for sending a scan to slabd: 72 MB at 1 Gbit/s take 0.6 s.
constexpr std::int64_t kSend_ns = kNsPerS;

std::atomic<bool> g_stop{false};
void on_signal(int) {
  g_stop = true;
}

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

template <typename... Args>
void say(const char* format, const Args&... args) {
  const std::string line = "slabd-genicam: " + fmt::format(fmt::runtime(format), args...) + "\n";
  // A blocked journal must not delay a scan: a line may be lost.
  if (::send(STDERR_FILENO, line.data(), line.size(), MSG_DONTWAIT | MSG_NOSIGNAL) < 0 && errno == ENOTSOCK)
    fmt::print(stderr, "{}", line);
}

/// Logs a lasting state once, and again after kRepeat_ns.
class Trouble {
 public:
  void report(const Error& why) {
    const std::int64_t now = now_ns();
    if (why.text.view() == last_ && now - at_ns_ < kRepeat_ns) return;
    last_ = why.text.view();
    at_ns_ = now;
    say("{} ({})", why.text.view(), static_cast<int>(why.code));
  }
  void clear() { last_.clear(); }

 private:
  std::string last_;
  std::int64_t at_ns_ = 0;
};

struct Interface {
  std::string name;
  int mtu = 0;  ///< 0: unknown
};

Interface interface_of(const std::string& address) {
  in_addr wanted{};
  Interface found;
  ifaddrs* list = nullptr;
  if (::inet_pton(AF_INET, address.c_str(), &wanted) != 1 || ::getifaddrs(&list) != 0) return found;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> owner(list, ::freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_in own{};
    std::memcpy(&own, entry->ifa_addr, sizeof own);
    if (own.sin_addr.s_addr == wanted.s_addr) found.name = entry->ifa_name;
  }
  const Fd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq request{};
  found.name.copy(request.ifr_name, sizeof request.ifr_name - 1);
  if (!found.name.empty() && socket.is_open() && ::ioctl(socket.get(), SIOCGIFMTU, &request) == 0)
    found.mtu = request.ifr_mtu;
  return found;
}

/// net.core.rmem_max; 0: unknown.
std::int64_t receive_bytes_max() {
  std::ifstream file("/proc/sys/net/core/rmem_max");
  std::int64_t bytes = 0;
  file >> bytes;
  return bytes;
}

/// Reports a packet size and socket buffers that lose packets, with the cure.
void report_network(const config::GenicamSettings& settings, const LinkFacts& link) {
  const Interface local = interface_of(link.interface_address);
  if (local.mtu != 0 && settings.packet_bytes > local.mtu)
    say("warning: [genicam] packet_size = {} is above the MTU {} of {}: every frame loses packets; ip link set {} mtu "
        "9000, or packet_size = {}",
        settings.packet_bytes, local.mtu, local.name, local.name, local.mtu / 4 * 4);
  if (const std::int64_t bytes = receive_bytes_max(); bytes < config::kGenicamSocketBytes)
    say("warning: net.core.rmem_max is {}, {} are needed: packets get lost while this computer is busy; sysctl -w "
        "net.core.rmem_max={} (the package has /usr/lib/sysctl.d/60-slabd-genicam.conf)",
        bytes, config::kGenicamSocketBytes, config::kGenicamSocketBytes);
}

/// The camera in front of the line is the accepted one.
Status check_accepted(const config::GenicamSettings& settings, const Identity& identity) {
  if (settings.accepted.empty() || settings.accepted == identity.text) return success();
  return error(
      Code::config,
      "the camera is \"%s\", accepted is \"%s\" ([genicam] accepted): verify this one (slabctl scanner verify), "
      "or restore the accepted camera, firmware and settings",
      identity.text.c_str(), settings.accepted.c_str());
}

class Gateway {
 public:
  explicit Gateway(const config::GenicamSettings& settings)
      : settings_(settings),
        link_(std::string(settings.slabd_host.view()), settings.slabd_port),
        xyz_(3 * limits::kScanPointsMax) {}

  void run() {
    while (!g_stop) {
      keep_camera();
      if (!keep_slabd()) continue;
      std::string note;
      const std::optional<Request> request = link_.next_request(kWait_ms, note);
      if (!note.empty()) say("slabd rejected the scan of request {}: {}", last_, note);
      if (request) serve(*request);
      if (!link_.connected()) say("the connection to slabd has ended; connecting again");
    }
  }

 private:
  void keep_camera() {
    if (camera_ != nullptr && camera_->lost()) {
      say("control of the camera was lost; connecting again");
      camera_.reset();
      next_camera_ns_ = now_ns() + kRetry_ns;
    }
    if (camera_ != nullptr || now_ns() < next_camera_ns_) return;
    Result<std::unique_ptr<Camera>> opened = Camera::open(settings_, memory_);
    next_camera_ns_ = now_ns() + kRetry_ns;
    if (!opened) {
      camera_error_ = opened.error();
      camera_trouble_.report(opened.error());
      return;
    }
    camera_ = std::move(opened.value());
    camera_trouble_.clear();
    const Identity& identity = camera_->identity();
    say("camera {} {} at {} over {}, {} x {} points of {}, packets of {} bytes", identity.vendor, identity.text,
        camera_->link().camera_address, camera_->link().interface_address, camera_->layout().width,
        camera_->layout().height, info(camera_->layout().format).name, camera_->link().packet_bytes);
    for (const std::string& text : camera_->notes()) say("note: {}", text);
    report_network(settings_, camera_->link());
    if (settings_.accepted.empty())
      say("warning: any camera is used; after slabctl scanner verify --scanner \"{}\" set [genicam] accepted = \"{}\"",
          identity.text, identity.text);
  }

  bool keep_slabd() {
    if (link_.connected()) return true;
    if (const Status status = link_.connect(); !status) {
      slabd_trouble_.report(status.error());
      for (std::int64_t waited = 0; waited < kRetry_ns && !g_stop; waited += kWait_ms * kNsPerMs)
        std::this_thread::sleep_for(std::chrono::milliseconds(kWait_ms));
      return false;
    }
    slabd_trouble_.clear();
    say("connected to slabd at {}:{}", settings_.slabd_host.view(), settings_.slabd_port);
    return true;
  }

  void serve(const Request& request) {
    const std::int64_t until_ns = now_ns() + request.timeout_ns;
    std::uint32_t first = request.have_points;
    if (request.name() != last_) {
      last_ = request.name();
      first = 0;
      const Result<Shot> shot = take(until_ns - kSend_ns);
      has_scan_ = shot.ok();
      if (!shot) {
        // Nothing of a broken frame is sent. slabd ends the request, and the PLC repeats the SCAN.
        say("request {}, station {}: no scan: {} ({})", last_, request.station, shot.error().text.view(),
            static_cast<int>(shot.error().code));
        static_cast<void>(link_.refuse(request, shot.error(), until_ns));
        return;
      }
      shot_ = shot.value();
      scanner_ = camera_->identity().text;
      if (shot_.packets_requested != 0 || shot_.frames_discarded != 0)
        say("request {}: {} packets were requested again, {} frames of earlier exposures discarded", last_,
            shot_.packets_requested, shot_.frames_discarded);
    } else if (!has_scan_) {
      // This request's exposure failed; slabd has not received the reason.
      static_cast<void>(link_.refuse(request, error(Code::frame_incomplete, "the exposure failed"), until_ns));
      return;
    }
    const std::size_t points = std::size_t{shot_.width} * shot_.height;
    if (const Status sent = link_.send(request, shot_, std::span<const float>(xyz_).first(3 * points), first, scanner_,
                                       settings_.emulated, until_ns);
        !sent)
      say("request {}: {}", last_, sent.error().text.view());
  }

  Result<Shot> take(std::int64_t until_ns) {
    while (camera_ == nullptr || camera_->lost()) {
      if (g_stop) return error(Code::interrupted, "the program ends");
      if (now_ns() >= until_ns) return camera_error_;
      keep_camera();
      if (camera_ == nullptr) std::this_thread::sleep_for(std::chrono::milliseconds(kWait_ms));
    }
    if (Status status = check_accepted(settings_, camera_->identity()); !status) return status.error();
    return camera_->take(until_ns - now_ns(), xyz_, [] { return g_stop.load(); });
  }

  const config::GenicamSettings& settings_;
  const FrameMemory memory_;
  Link link_;
  std::vector<float> xyz_;  ///< points of the last scan, kept for a connection that is cut
  std::unique_ptr<Camera> camera_;
  Error camera_error_ = error(Code::scanner_offline, "the camera was not reached yet");
  Trouble camera_trouble_;
  Trouble slabd_trouble_;
  std::int64_t next_camera_ns_ = 0;
  std::string last_;       ///< request of `shot_`
  bool has_scan_ = false;  ///< `shot_` and `xyz_` answer `last_`
  Shot shot_;
  std::string scanner_;  ///< identity of the camera of `shot_`
};

/// Connects, prints what the camera states, and takes one exposure. Nothing is sent to slabd.
int examine(const config::GenicamSettings& settings, const std::string& out) {
  const FrameMemory memory;
  const auto camera = Camera::open(settings, memory);
  if (!camera) {
    say("{}", camera.error().text.view());
    return camera.error().code == Code::config ? kExitBadInput : kExitUnreachable;
  }
  const Camera& c = *camera.value();
  const Identity& identity = c.identity();
  fmt::print("camera     {} {} {}, firmware {}\n", identity.vendor, identity.model, identity.serial, identity.firmware);
  fmt::print("identity   {}\n", identity.text);
  fmt::print("points     {} x {} of {}, {} bytes a frame\n", c.layout().width, c.layout().height,
             info(c.layout().format).name, c.link().payload_bytes);
  for (std::size_t i = 0; i < 3; ++i) {
    const Axis& axis = c.layout().axes[i];
    fmt::print("coordinate {}: scale {:g}, offset {:g} mm, missing: {}\n", "ABC"[i], axis.scale, axis.offset_mm,
               axis.has_invalid ? fmt::format("{:g}", axis.invalid) : "NaN");
  }
  fmt::print("network    {} over {}, packets of {} bytes, lost ones are sent again: {}, clock: {}\n",
             c.link().camera_address, c.link().interface_address, c.link().packet_bytes,
             c.link().resends ? "yes" : "no", c.link().has_clock ? "yes" : "no");
  std::fflush(stdout);
  for (const std::string& text : c.notes()) say("note: {}", text);
  report_network(settings, c.link());
  std::vector<float> xyz(3 * c.layout().points());
  const std::int64_t began_ns = now_ns();
  const Result<Shot> shot =
      camera.value()->take(static_cast<std::int64_t>(settings.timeout_s * 1e9), xyz, [] { return g_stop.load(); });
  if (!shot) {
    say("{}", shot.error().text.view());
    return kExitUnreachable;
  }
  fmt::print("exposure   {} of {} points in {:.2f} s, {} packets requested again\n", shot.value().finite,
             c.layout().points(), static_cast<double>(now_ns() - began_ns) / 1e9, shot.value().packets_requested);
  if (!out.empty())
    if (const Status written = hal::write_ply(out.c_str(), xyz, shot.value().width, shot.value().height); !written) {
      say("{}", written.error().text.view());
      return kExitBadInput;
    }
  if (const Status status = check_accepted(settings, identity); !status) {
    say("{}", status.error().text.view());
    return kExitBadInput;
  }
  return 0;
}

int list() {
  const std::vector<std::string> found = cameras_found();
  for (const std::string& id : found) fmt::print("{}\n", id);
  if (!found.empty()) return 0;
  say("no camera answered a broadcast in the networks of this computer; with its address in [genicam] camera, "
      "slabd-genicam --check reaches one behind a router");
  return kExitUnreachable;
}

}  // namespace
}  // namespace slabd::gateway::genicam

// The only exception that escapes is lack of memory at the start: it ends the process, and the service manager
// restarts it.
int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape)
  using namespace slabd::gateway::genicam;
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  std::string path = "/etc/slabd/slabd.toml";
  std::string out;
  bool check = false;
  bool cameras = false;
  CLI::App app("Takes the scans of a GigE Vision 3-D camera for slabd");
  app.footer(
      "\nSettings: [genicam] of the configuration, docs/GENICAM.md.\nExit status: 0, 2 usage, 3 a setting or a "
      "feature of the camera does not fit, 4 not reachable");
  app.add_option("--config", path, "Configuration; only [genicam] and [scanner] listen are read")
      ->capture_default_str();
  app.add_flag("--check", check, "Print what the camera states, take one exposure, and end");
  app.add_option("--out", out, "With --check: write the exposure to this PLY file");
  app.add_flag("--list", cameras, "Print the cameras that answer, and end; exit status 4: none");
  app.set_version_flag("--version", "slabd " SLABD_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& fault) {
    const int status = app.exit(fault);
    return status == 0 ? 0 : kExitUsage;
  }
  if (cameras) return list();
  slabd::config::GenicamSettings settings;
  std::vector<slabd::config::Problem> problems;
  slabd::config::load_genicam(path, settings, problems);
  for (const slabd::config::Problem& problem : problems) say("{}", problem.text);
  if (!problems.empty()) return kExitBadInput;
  if (check) return examine(settings, out);
  Gateway gateway(settings);
  gateway.run();
  return 0;
}
