// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/robot/lcm_wire.h"
#include "hal/robot/pose_screen.h"

// Problem: only the robot's bridge may supply poses, over an interface that may not exist yet. Idea: one socket bound
// to the group's own address, joined on the named interface only. (liblcm binds every address, so that any datagram to
// the port is a pose.) next() opens and checks the socket.
//
// A special case is the loop-back interface, "poses of this computer". A sender with ttl=0 loops back on the interface
// of its own route, often not `lo`. So the group is joined there too, and only datagrams from this computer's addresses
// are accepted. The kernel drops such source addresses if they arrive from outside (martians).
//
// Invariant: trouble() is empty if and only if the socket is open.
namespace slabd::hal {
namespace {

constexpr std::int64_t kRetry_ns = kNsPerS;
constexpr std::size_t kOwnAddressesMax = 32;

/// The interface that the setting refers to at this moment.
struct Interface {
  int index = 0;  ///< 0 = the kernel's choice
  bool loopback = false;
};

class LcmPosePort final : public PosePort {
 public:
  LcmPosePort(const LcmSettings& settings, const LcmUrl& url) : settings_(settings), url_(url) {
    trouble_.assign("robot pose: not opened yet");
  }

  int fd() const override { return socket_.get(); }
  const PoseLinkCounters& counters() const override { return counters_; }
  std::string_view trouble() const override { return trouble_.view(); }
  std::string_view refusal(std::int64_t mono_ns) const override { return screen_.refusal(mono_ns); }
  bool next_note(std::int64_t mono_ns, PoseNoteText& text) override {
    return screen_.next_note(mono_ns, counters_, text);
  }

  bool next(std::int64_t mono_ns, PoseSample& sample) override {
    if (!checked_ || mono_ns - checked_ns_ >= kRetry_ns) {
      checked_ = true;
      checked_ns_ = mono_ns;
      check_link(std::exchange(silent_, true));
    }
    if (!socket_.is_open()) return false;
    // Bounded, so that a flood of foreign datagrams cannot block the caller.
    for (std::size_t i = 0; i < limits::kPosesPerTurn; ++i) {
      bool waiting = false;
      if (receive(mono_ns, sample, waiting)) return true;
      if (!waiting) return false;
    }
    return false;
  }

 private:
  // ---- receiving

  /// Receives one datagram. `waiting` is false if there was none.
  bool receive(std::int64_t mono_ns, PoseSample& sample, bool& waiting) {
    std::array<std::byte, limits::kLcmDatagramMax> datagram;
    sockaddr_in from{};
    socklen_t from_bytes = sizeof from;
    const ssize_t n = recvfrom(socket_.get(), datagram.data(), datagram.size(), MSG_DONTWAIT,
                               reinterpret_cast<sockaddr*>(&from), &from_bytes);
    waiting = n >= 0 || errno == EINTR;
    if (n >= 0) silent_ = false;
    if (n < 0) {
      if (!waiting && errno != EAGAIN && errno != EWOULDBLOCK) lose("receiving", errno, "");
      return false;
    }
    const PosePublisher publisher{ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)};
    // Other programs' messages on the group are not logged; a pose from an unknown sender is.
    const PoseLinkCounters before = counters_;
    PoseSample decoded;
    const bool good = decode_pose_datagram(std::span(datagram).first(static_cast<std::size_t>(n)),
                                           settings_.channel.view(), decoded, counters_, settings_.type);
    if (!good && counters_.malformed == before.malformed) {
      name_other_type(std::span(datagram).first(static_cast<std::size_t>(n)), publisher, mono_ns);
      return false;
    }
    if (const char* why = why_not(publisher.address); why != nullptr) {
      counters_ = before;
      ++counters_.wrong_sender;
      screen_.note_sender(publisher, mono_ns, why);
      return false;
    }
    if (!good) {
      screen_.note_sender(publisher, mono_ns,
                          "a pose that cannot be one (not finite, no unit quaternion, out of reach)");
      return false;
    }
    if (!screen_.admit(publisher, mono_ns, decoded, counters_)) {
      --counters_.accepted;
      return false;
    }
    sample = decoded;
    sample.arrival_ns = mono_ns;
    return true;
  }

  /// Records a foreign datagram on the configured channel: usually from a bridge that sends another type than the
  /// configured one. Also records a bridge's message about why it has no poses.
  void name_other_type(std::span<const std::byte> datagram, const PosePublisher& publisher, std::int64_t mono_ns) {
    const OtherTypeText word = bridge_word_on(datagram, settings_.channel.view());
    if (!word.empty() && is_trusted(publisher.address) && may_publish(publisher.address))
      screen_.note_sender(publisher, mono_ns, word.c_str());
    const OtherTypeText what = other_type_on(datagram, settings_.channel.view(), settings_.type);
    if (what.empty()) return;
    ++counters_.other_type;
    screen_.note_sender(publisher, mono_ns, what.c_str());
  }

  /// Reason why an address may not publish; nullptr if it may.
  const char* why_not(std::uint32_t source) {
    if (!is_trusted(source)) {
      stranger_seen_ = true;
      return "interface belongs to this computer, and the pose arrives";
    }
    return may_publish(source) ? nullptr : "a pose that is not of [pose] senders, but";
  }

  bool may_publish(std::uint32_t source) const {
    return settings_.senders.empty() ||
           std::any_of(settings_.senders.begin(), settings_.senders.end(),
                       [source](const PlcSettings::Network& n) { return (source & n.mask) == n.address; });
  }

  bool is_trusted(std::uint32_t source) const {
    if (!own_host_only_ || source >> 24U == IN_LOOPBACKNET) return true;
    // A sender whose route to the group is `dev lo` has no source address and sends from 0.0.0.0. From outside the
    // kernel accepts that source only for groups 224.0.0.x.
    constexpr std::uint32_t kLinkLocalGroups = 0xE00000;
    if (source == INADDR_ANY) return url_.group >> 8U != kLinkLocalGroups;
    return std::find(own_addresses_.begin(), own_addresses_.end(), source) != own_addresses_.end();
  }

  // ---- the link

  /// Once a second: opens a missing link; detects an interface that went down or was replaced. `silent`: no datagram
  /// has arrived since the last check.
  void check_link(bool silent) {
    const std::optional<Interface> interface = find_interface(silent);
    if (!interface) return;
    if (socket_.is_open() && interface->index != joined_index_) lose("the interface was replaced", 0, "");
    if (!socket_.is_open()) open_link(*interface);
    // The kernel may have selected another interface meanwhile: an adapter was plugged in again, or a route changed.
    // Joining twice has no effect.
    if (socket_.is_open() && settings_.interface.empty()) join_again();
    if (socket_.is_open() && own_host_only_) {
      // Routes and addresses may appear after this process starts; an unknown sender may be a new address of this
      // computer.
      join_again();
      if (!socket_.is_open()) return;
      if (stranger_seen_) read_own_addresses();
      stranger_seen_ = false;
    }
  }

  /// Looks up the interface. If it does not exist or is down, the link is closed.
  std::optional<Interface> find_interface(bool silent) {
    if (settings_.interface.empty()) return Interface{};
    in_addr address{};
    const bool by_address = inet_pton(AF_INET, settings_.interface.c_str(), &address) == 1;
    if (!by_address) name_.assign(settings_.interface.view());
    // While datagrams arrive, the interface name found for an address is kept. Otherwise the address may have moved to
    // another card, which now receives the poses.
    if (by_address && silent && socket_.is_open() && has_lost(address)) lose("the interface lost its address", 0, "");
    if (by_address && !socket_.is_open() && !find_name(address)) {
      lose("no interface has this address", 0, "set [robot] interface to one that `ip address` lists");
      return std::nullopt;
    }
    const unsigned index = if_nametoindex(name_.c_str());
    if (index == 0) {
      lose("no such interface", 0, "set [robot] interface to one that `ip link` lists");
      return std::nullopt;
    }
    const int probe = socket_.is_open() ? socket_.get() : socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const Fd owned(socket_.is_open() ? -1 : probe);
    ifreq request{};
    std::memcpy(request.ifr_name, name_.c_str(), std::min(name_.size(), sizeof request.ifr_name - 1));
    if (ioctl(probe, SIOCGIFFLAGS, &request) != 0 || (request.ifr_flags & IFF_UP) == 0) {
      FixedString<96> cure;
      cure.printf("`ip link set %s up`, or plug it in", name_.c_str());
      lose("the interface is down", 0, cure.c_str());
      return std::nullopt;
    }
    return Interface{static_cast<int>(index), (request.ifr_flags & IFF_LOOPBACK) != 0};
  }

  /// True if the open link's interface no longer has the address. False if the computer has more addresses than fit
  /// here, because it cannot be decided.
  bool has_lost(in_addr address) const {
    std::array<ifreq, 64> entries{};
    ifconf list{};
    list.ifc_len = static_cast<int>(sizeof entries);
    list.ifc_req = entries.data();
    if (ioctl(socket_.get(), SIOCGIFCONF, &list) != 0 || list.ifc_len >= static_cast<int>(sizeof entries)) return false;
    const auto count = static_cast<std::size_t>(list.ifc_len) / sizeof(ifreq);
    return std::none_of(entries.begin(), entries.begin() + static_cast<std::ptrdiff_t>(count), [&](const ifreq& entry) {
      sockaddr_in own{};
      std::memcpy(&own, &entry.ifr_addr, sizeof own);
      return own.sin_addr.s_addr == address.s_addr && name_.view() == entry.ifr_name;
    });
  }

  bool find_name(in_addr address) {
    name_.clear();
    for_each_own_address([&](const char* interface, std::uint32_t own) {
      if (own == ntohl(address.s_addr)) name_.assign(interface);
    });
    return !name_.empty();
  }

  void open_link(const Interface& interface) {
    Fd fd(socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    if (!fd.is_open()) return lose("no socket", errno, "");
    set_int(fd.get(), SOL_SOCKET, SO_REUSEADDR, 1);  // other listeners (loggers, displays) may run on this computer
    set_int(fd.get(), SOL_SOCKET, SO_REUSEPORT, 1);
    set_int(fd.get(), SOL_SOCKET, SO_RCVBUF, static_cast<int>(url_.recv_buf_bytes));
    set_int(fd.get(), IPPROTO_IP, IP_MULTICAST_ALL, 0);  // only groups that this socket joined, not those of other
                                                         // sockets
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(url_.port);
    address.sin_addr.s_addr = htonl(url_.group);
    if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      return lose("binding the group's address", errno, "another program may hold the port without sharing it");

    socket_ = std::move(fd);
    joined_index_ = interface.index;
    own_host_only_ = interface.loopback;
    if (own_host_only_) read_own_addresses();
    if (const int failed = join(interface.index); failed != 0) {
      FixedString<160> cure;
      cure.printf(
          "`ip route add %s/32 dev lo` for poses of this computer, or name the interface towards the robot in "
          "[robot] interface",
          group_text().c_str());
      return lose("joining the multicast group", failed, cure.c_str());
    }
    trouble_.clear();
  }

  /// Joins again on the kernel's choice of interface. The socket keeps the memberships of interfaces that are gone, up
  /// to a limit; then the socket is reopened, which releases them.
  void join_again() {
    if (join(0) == ENOBUFS) lose("the interface was replaced very often", 0, "");
  }

  /// Joins the group on an interface (0: the one of the kernel's route to the group). Returns errno, or 0 if joined now
  /// or before.
  int join(int index) {
    ip_mreqn request{};
    request.imr_multiaddr.s_addr = htonl(url_.group);
    request.imr_ifindex = index;
    if (setsockopt(socket_.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request) == 0) return 0;
    return errno == EADDRINUSE ? 0 : errno;
  }

  /// Calls `use(interface name, address)` for each IPv4 address of this computer. The only heap use in this file;
  /// getifaddrs() allocates it, and it is released at once.
  template <typename Use>
  static void for_each_own_address(Use use) {
    ifaddrs* list = nullptr;
    if (getifaddrs(&list) != 0) return;
    for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next) {
      if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
      sockaddr_in address{};
      std::memcpy(&address, entry->ifa_addr, sizeof address);
      use(entry->ifa_name, ntohl(address.sin_addr.s_addr));
    }
    freeifaddrs(list);
  }

  void read_own_addresses() {
    own_addresses_.clear();
    for_each_own_address([this](const char*, std::uint32_t own) { static_cast<void>(own_addresses_.push(own)); });
  }

  static void set_int(int fd, int level, int option, int value) { setsockopt(fd, level, option, &value, sizeof value); }

  FixedString<INET_ADDRSTRLEN> group_text() const {
    FixedString<INET_ADDRSTRLEN> text;
    text.printf("%u.%u.%u.%u", url_.group >> 24U, (url_.group >> 16U) & 255U, (url_.group >> 8U) & 255U,
                url_.group & 255U);
    return text;
  }

  /// Closes the link and stores the reason.
  void lose(const char* what, int error_number, const char* cure) {
    socket_.reset();
    const char* interface = settings_.interface.empty() ? "the default one" : settings_.interface.c_str();
    trouble_.printf("robot pose %s:%u on interface %s: %s%s%s%s%s", group_text().c_str(), unsigned{url_.port},
                    interface, what, error_number == 0 ? "" : ": ", error_number == 0 ? "" : errno_text(error_number),
                    *cure == '\0' ? "" : "; cure: ", cure);
  }

  LcmSettings settings_;
  LcmUrl url_;
  Fd socket_;
  int joined_index_ = 0;
  bool own_host_only_ = false;
  bool stranger_seen_ = false;     ///< a datagram from an unknown address has arrived since the last check
  FixedString<IF_NAMESIZE> name_;  ///< of the interface that has the setting's address
  FixedVector<std::uint32_t, kOwnAddressesMax> own_addresses_;
  PoseLinkCounters counters_;
  PoseScreen screen_;
  FixedString<limits::kErrorTextBytes> trouble_;
  bool checked_ = false;
  bool silent_ = true;  ///< no datagram since the last check
  std::int64_t checked_ns_ = 0;
};

}  // namespace

Result<std::unique_ptr<PosePort>> make_lcm_pose_port(const LcmSettings& settings) {
  const Result<LcmUrl> url = parse_lcm_url(settings.url.view());
  if (!url) return url.error();
  for (const Status& status :
       {check_lcm_channel(settings.channel.view()), check_lcm_interface(settings.interface.view())})
    if (!status.ok()) return status.error();
  return std::unique_ptr<PosePort>(std::make_unique<LcmPosePort>(settings, url.value()));
}

}  // namespace slabd::hal
