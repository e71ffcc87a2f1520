// SPDX-License-Identifier: Apache-2.0
//
// The network of a GigE Vision camera, and the binding of the scanner's acceptance to it. The camera itself belongs to
// slabd-genicam, which controls it; `slabd-genicam --check` looks at it.
#include <arpa/inet.h>
#include <fmt/core.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <memory>
#include <string>

#include "base/os.h"
#include "cli/doctor/doctor.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

struct Way {
  std::string interface;  ///< empty if it is unknown
  int mtu = 0;
};

/// Interface of the route to an IPv4 address, and its MTU. The kernel looks the route up without sending anything.
Way way_to(const std::string& camera) {
  Way way;
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(3956);
  const Fd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in own{};
  socklen_t bytes = sizeof own;
  if (!socket.is_open() || ::inet_pton(AF_INET, camera.c_str(), &peer.sin_addr) != 1 ||
      ::connect(socket.get(), static_cast<const sockaddr*>(static_cast<const void*>(&peer)), sizeof peer) != 0 ||
      ::getsockname(socket.get(), static_cast<sockaddr*>(static_cast<void*>(&own)), &bytes) != 0)
    return way;
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) != 0) return way;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> owner(list, ::freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_in address{};
    std::memcpy(&address, entry->ifa_addr, sizeof address);
    if (address.sin_addr.s_addr == own.sin_addr.s_addr) way.interface = entry->ifa_name;
  }
  ifreq request{};
  way.interface.copy(request.ifr_name, sizeof request.ifr_name - 1);
  if (!way.interface.empty() && ::ioctl(socket.get(), SIOCGIFMTU, &request) == 0) way.mtu = request.ifr_mtu;
  return way;
}

void examine_packets(const config::GenicamSettings& camera, Examination& report) {
  const Way way = way_to(camera.camera);
  if (way.mtu == 0) {
    report.unknown("camera packets", say("the interface to \"{}\" is unknown", camera.camera),
                   say("[genicam] camera = its address"));
  } else if (camera.packet_bytes > way.mtu) {
    report.failed("camera packets",
                  say("packet_size = {}, the MTU of {} is {}", camera.packet_bytes, way.interface, way.mtu),
                  say("ip link set {} mtu 9000, with jumbo frames in every switch, or [genicam] packet_size = {}",
                      way.interface, way.mtu / 4 * 4));
  } else {
    report.ok("camera packets",
              say("packet_size = {}, the MTU of {} is {}", camera.packet_bytes, way.interface, way.mtu));
  }
}

void examine_socket_buffer(Examination& report) {
  std::ifstream file("/proc/sys/net/core/rmem_max");
  std::int64_t bytes = 0;
  file >> bytes;
  const std::string saw = say("net.core.rmem_max is {}, needed is {}", bytes, config::kGenicamSocketBytes);
  if (bytes >= config::kGenicamSocketBytes)
    report.ok("camera buffers", saw);
  else
    report.warning("camera buffers", saw,
                   fmt::format("sysctl -w net.core.rmem_max={}; /usr/lib/sysctl.d/60-slabd-genicam.conf",
                               config::kGenicamSocketBytes));
}

void examine_accepted(const config::Config& config, Examination& report) {
  const std::string& accepted = config.genicam.accepted;
  if (accepted.empty())
    return report.warning("camera", say("scans of any camera are used"),
                          say("slabd-genicam --check prints the identity for [genicam] accepted"));
  const auto reader = storage::open_reader(config.storage.db_path);
  if (!reader) return report.unknown("camera", quote(reader.error().text.view()));
  // The scanner that the camera is.
  std::size_t arm = 0;
  for (std::size_t i = 0; i < config.arms.list.size(); ++i)
    if (config.arm(i).scanner_backend == hal::ScannerBackend::tcp && config.arm(i).stream.scanner != 0) arm = i;
  const PartId& scanner = config.arms.list[arm].scanner;
  const auto line = reader.value()->line_calibration(scanner.view());
  if (!line || line.value()->scanner.id.empty()) return;  // reported as missing acceptance
  const std::string_view verified = line.value()->scanner.numbers.scanner.view();
  if (verified == accepted)
    report.ok("camera", say("accepted is {}, which was verified", accepted));
  else
    report.warning("camera", say("accepted is {}, verified was {}", accepted, verified),
                   say("slabctl scanner verify --scanner \"{}\"{}", accepted,
                       config.arms.several() ? fmt::format(" --scanner-id {}", scanner.view()) : ""));
}

}  // namespace

void examine_camera(const config::Config& config, Examination& report) {
  if (config.genicam.camera.empty()) return;
  bool has_stream = false;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm)
    has_stream |= config.arm(arm).scanner_backend == hal::ScannerBackend::tcp;
  if (!has_stream)
    report.failed("camera", say("[genicam] has a camera, but [scanner] backend is \"drop\""),
                  "[scanner] backend = \"tcp\"; docs/GENICAM.md");
  examine_packets(config.genicam, report);
  examine_socket_buffer(report);
  examine_accepted(config, report);
}

}  // namespace slabd::cli
