// SPDX-License-Identifier: Apache-2.0
//
// Route of packets to the PLC and to the robot's group. Connecting a datagram socket makes the kernel look up the
// route without sending anything.
#include <arpa/inet.h>
#include <fmt/core.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <optional>

#include "base/os.h"
#include "cli/client/arms.h"
#include "cli/doctor/doctor.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

struct RouteSeen {
  int fault = 0;              ///< errno; 0 if a route exists
  std::uint32_t address = 0;  ///< local address
  std::string interface;
  bool running = false;  ///< cable connected, remote end active
  /// False for a route over an interface without its own address.
  [[nodiscard]] bool interface_known() const { return !interface.empty(); }
};

std::string dotted(std::uint32_t address) {
  const in_addr raw{htonl(address)};
  std::string text(INET_ADDRSTRLEN, '\0');
  return ::inet_ntop(AF_INET, &raw, text.data(), INET_ADDRSTRLEN) == nullptr ? "?" : std::string(text.c_str());
}

/// Calls `use(name, flags, IPv4 address or nullopt)` for every address of every interface.
template <typename Use>
void for_each_interface(Use use) {
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) != 0) return;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> owner(list, ::freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next) {
    std::optional<std::uint32_t> address;
    if (entry->ifa_addr != nullptr && entry->ifa_addr->sa_family == AF_INET) {
      sockaddr_in own{};
      std::memcpy(&own, entry->ifa_addr, sizeof own);
      address = ntohl(own.sin_addr.s_addr);
    }
    use(std::string_view(entry->ifa_name), entry->ifa_flags, address);
  }
}

void name_interface(RouteSeen& route) {
  for_each_interface([&](std::string_view name, unsigned flags, std::optional<std::uint32_t> address) {
    if (!address || *address != route.address) return;
    route.interface = name;
    route.running = (flags & IFF_RUNNING) != 0;
  });
}

RouteSeen route_to(std::uint32_t address) {
  RouteSeen route;
  const Fd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!socket.is_open()) return {errno, 0, {}, false};
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(9);
  peer.sin_addr.s_addr = htonl(address);
  sockaddr_in own{};
  socklen_t bytes = sizeof own;
  if (::connect(socket.get(), static_cast<const sockaddr*>(static_cast<const void*>(&peer)), sizeof peer) != 0 ||
      ::getsockname(socket.get(), static_cast<sockaddr*>(static_cast<void*>(&own)), &bytes) != 0)
    route.fault = errno;
  route.address = ntohl(own.sin_addr.s_addr);
  if (route.fault == 0) name_interface(route);
  return route;
}

std::optional<std::uint32_t> address_in(std::string_view text) {
  in_addr raw{};
  if (::inet_pton(AF_INET, std::string(text).c_str(), &raw) != 1) return std::nullopt;
  return ntohl(raw.s_addr);
}

/// `far`: the remote end, "the PLC 192.168.0.10".
bool examine_route(std::string_view check, const std::string& far, const RouteSeen& route, Examination& report) {
  if (route.fault != 0) {
    report.failed(check, say("no way to {}: {}", far, quote(std::strerror(route.fault))),
                  say("ip route; give this computer an address in that network (ip address add), or a route to it"));
    return false;
  }
  if (!route.interface_known()) {
    report.ok(check, say("{} by an interface that has no address of its own", far));
    return true;
  }
  const std::string way = say("{} by {} ({})", far, route.interface, dotted(route.address));
  if (!route.running) {
    report.failed(check, say("{}, which has no carrier", way), say("is the cable in, and the other end switched on?"));
    return false;
  }
  report.ok(check, way);
  return true;
}

void examine_plc_route(const config::Config& config, Examination& report) {
  if (config.plc.role == hal::PlcRole::rtu) return;  // a serial line has no route
  if (config.plc.role == hal::PlcRole::client) {
    const auto plc = address_in(config.plc.host.view());
    if (!plc) return;  // the configuration allows only addresses
    examine_route("plc route", say("the PLC {}", dotted(*plc)), route_to(*plc), report);
    return;
  }
  const auto listen = address_in(config.plc.host.view());
  for (const hal::PlcSettings::Network& network : config.plc.allow) {
    const bool one = network.mask == ~0U;
    // A large private range, or any address, does not identify the PLC's network.
    if (network.mask < 0xFFFF0000U) continue;
    const std::uint32_t somebody = one ? network.address : network.address + 1;
    const RouteSeen route = route_to(somebody);
    const std::string far =
        one ? dotted(somebody) : fmt::format("{}/{}", dotted(network.address), dotted(network.mask));
    if (!examine_route("plc route", far, route, report)) continue;
    if (listen && *listen != 0 && *listen != route.address)
      report.warning("plc route",
                     say("{} comes in at {}, and [plc] listen is {}", far, dotted(route.address), dotted(*listen)),
                     say("listen at the address in the PLC's network, or at 0.0.0.0"));
  }
}

void examine_robot_route(const config::ArmSettings& arm, Examination& report) {
  const std::string_view url = arm.robot.url.view();
  const std::size_t begin = url.find("//");
  if (begin == std::string_view::npos) return;
  const auto group = address_in(url.substr(begin + 2, url.find(':', begin) - begin - 2));
  if (!group) return;
  const std::string_view wanted = arm.robot.interface.view();
  const RouteSeen route = route_to(*group);
  // A named interface is used whatever the route is; without a name the route selects it.
  if (wanted.empty()) {
    examine_route("robot route", say("group {}", dotted(*group)), route, report);
    return;
  }
  bool there = false;
  bool running = false;
  for_each_interface([&](std::string_view name, unsigned flags, std::optional<std::uint32_t> address) {
    if (name != wanted && (!address || address != address_in(wanted))) return;
    there = true;
    running = (flags & IFF_RUNNING) != 0;
  });
  if (!there) {
    report.failed("robot route", say("[robot] interface = {}: this computer has none", wanted),
                  say("ip address lists what there is"));
  } else if (!running) {
    report.failed("robot route", say("[robot] interface = {} has no carrier", wanted),
                  say("is the cable in, and the other end switched on?"));
  } else {
    report.ok("robot route",
              say("group {} is joined on {}, as [robot] interface says; what this computer sends "
                          "to it goes by {}",
                          dotted(*group), wanted, route.fault != 0             ? say("no interface")
                          : route.interface_known() ? route.interface
                                                    : say("one without an address")));
  }
}

}  // namespace

void examine_routes(const config::Config& config, Examination& report) {
  examine_plc_route(config, report);
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    if (config.arms.several()) report.set_subject(with_id(say("robot"), std::string(config.arm(arm).by.robot.view())));
    examine_robot_route(config.arm(arm), report);
  }
  report.set_subject({});
}

}  // namespace slabd::cli
