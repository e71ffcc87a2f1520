// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <lcm/lcm.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <bot_core/rigid_transform_t.hpp>
#include <cstring>
#include <memory>
#include <slabd/flange_pose_t.hpp>
#include <string>

#include "base/os.h"
#include "hal/hal.h"
#include "tests/places/ports.h"

namespace slabd::hal {
namespace {

constexpr const char* kGroup = "239.255.76.67";
constexpr const char* kNoRoute = "no multicast route; on an isolated computer: ip route add 239.255.76.67/32 dev lo";

LcmSettings settings_for(std::uint16_t port, const char* interface) {
  LcmSettings settings;
  settings.url.printf("udpm://%s:%u?ttl=0", kGroup, unsigned{port});
  settings.interface = interface;
  return settings;
}

std::unique_ptr<PosePort> open_port(const LcmSettings& settings) {
  auto made = make_lcm_pose_port(settings);
  EXPECT_TRUE(made.ok()) << made.error().text.c_str();
  return std::move(made.value());
}

struct LcmCloser {
  void operator()(lcm_t* lcm) const { lcm_destroy(lcm); }
};
using Publisher = std::unique_ptr<lcm_t, LcmCloser>;

flange_pose_t pose(std::int32_t seq) {
  flange_pose_t m{};
  m.seq = seq;
  m.utime = 1'700'000'000'000'000 + 4'000 * seq;
  m.flags = 1;
  m.trans[0] = 0.001 * seq;
  m.quat[0] = 1.0;
  return m;
}

void publish(lcm_t* lcm, const flange_pose_t& m, const char* channel = "FLANGE_POSE") {
  std::string bytes(static_cast<std::size_t>(m.getEncodedSize()), '\0');
  m.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  ASSERT_EQ(lcm_publish(lcm, channel, bytes.data(), static_cast<unsigned>(bytes.size())), 0);
}

bool wait_and_take(PosePort& port, std::int64_t mono_ns, PoseSample& sample) {
  pollfd p{port.fd(), POLLIN, 0};
  return poll(&p, 1, 60'000) == 1 && port.next(mono_ns, sample);
}

TEST(LcmPosePort, poses_of_a_liblcm_publisher_on_this_computer_arrive) {
  const std::uint16_t port_number = places::own_port();
  const LcmSettings settings = settings_for(port_number, "lo");
  const Publisher publisher(lcm_create(settings.url.c_str()));
  ASSERT_TRUE(publisher) << kNoRoute;
  const auto port = open_port(settings);
  EXPECT_EQ(port->fd(), -1) << "opened by next()";
  EXPECT_FALSE(port->trouble().empty());
  PoseSample sample;
  EXPECT_FALSE(port->next(kNsPerS, sample));
  ASSERT_TRUE(port->trouble().empty()) << port->trouble();
  for (std::int32_t seq = 1; seq <= 50; ++seq) publish(publisher.get(), pose(seq));
  for (std::int32_t seq = 1; seq <= 50; ++seq) {
    ASSERT_TRUE(wait_and_take(*port, 1000 + seq, sample)) << seq;
    EXPECT_EQ(sample.seq, seq) << "in order, none lost";
    EXPECT_EQ(sample.arrival_ns, 1000 + seq);
    EXPECT_NEAR(sample.T_base_flange.translation_mm.x(), seq, 1e-9);
  }
  EXPECT_FALSE(port->next(2000, sample));
  EXPECT_EQ(port->counters().accepted, 50U);
}

TEST(LcmPosePort, other_channels_are_counted_and_ignored) {
  const LcmSettings settings = settings_for(places::own_port(), "lo");
  const Publisher publisher(lcm_create(settings.url.c_str()));
  ASSERT_TRUE(publisher) << kNoRoute;
  const auto port = open_port(settings);
  PoseSample sample;
  EXPECT_FALSE(port->next(1, sample));
  publish(publisher.get(), pose(1), "OTHER");
  flange_pose_t broken = pose(2);
  broken.quat[0] = 7.0;
  publish(publisher.get(), broken);
  publish(publisher.get(), pose(3));
  ASSERT_TRUE(wait_and_take(*port, 2, sample));
  EXPECT_EQ(sample.seq, 3);
  EXPECT_EQ(port->counters().foreign, 1U);
  EXPECT_EQ(port->counters().malformed, 1U);
}

TEST(LcmPosePort, several_listeners_share_the_group) {
  const LcmSettings settings = settings_for(places::own_port(), "lo");
  const Publisher publisher(lcm_create(settings.url.c_str()));
  ASSERT_TRUE(publisher) << kNoRoute;
  const auto one = open_port(settings);
  const auto two = open_port(settings);
  PoseSample sample;
  EXPECT_FALSE(one->next(1, sample));
  EXPECT_FALSE(two->next(1, sample));
  publish(publisher.get(), pose(8));
  EXPECT_TRUE(wait_and_take(*one, 2, sample));
  EXPECT_TRUE(wait_and_take(*two, 2, sample));
}

TEST(LcmPosePort, unicast_to_the_port_is_ignored) {
  const std::uint16_t port_number = places::own_port();
  const auto port = open_port(settings_for(port_number, "lo"));
  PoseSample sample;
  EXPECT_FALSE(port->next(1, sample));
  ASSERT_TRUE(port->trouble().empty()) << port->trouble();
  std::string datagram = "LC02" + std::string(4, '\0') + "FLANGE_POSE" + '\0';
  const flange_pose_t m = pose(1);
  std::string payload(static_cast<std::size_t>(m.getEncodedSize()), '\0');
  m.encode(payload.data(), 0, static_cast<int>(payload.size()));
  datagram += payload;
  const Fd fd(socket(AF_INET, SOCK_DGRAM, 0));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port_number);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  static_cast<void>(
      sendto(fd.get(), datagram.data(), datagram.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to));
  pollfd p{port->fd(), POLLIN, 0};
  EXPECT_EQ(poll(&p, 1, 100), 0);
  EXPECT_FALSE(port->next(2, sample));
  EXPECT_EQ(port->counters().accepted, 0U);
}

TEST(LcmPosePort, interface_may_be_named_by_its_address) {
  const LcmSettings settings = settings_for(places::own_port(), "127.0.0.1");
  const Publisher publisher(lcm_create(settings.url.c_str()));
  ASSERT_TRUE(publisher) << kNoRoute;
  const auto port = open_port(settings);
  PoseSample sample;
  EXPECT_FALSE(port->next(1, sample));
  EXPECT_TRUE(port->trouble().empty()) << port->trouble();
  publish(publisher.get(), pose(4));
  EXPECT_TRUE(wait_and_take(*port, 2, sample));
}

TEST(LcmPosePort, a_missing_interface_is_reported_with_a_cure_and_the_port_retries) {
  const auto port = open_port(settings_for(places::own_port(), "slabd-none0"));
  PoseSample sample;
  EXPECT_FALSE(port->next(kNsPerS, sample));
  EXPECT_EQ(port->fd(), -1);
  EXPECT_NE(port->trouble().find("slabd-none0"), std::string_view::npos);
  EXPECT_NE(port->trouble().find("no such interface"), std::string_view::npos);
  EXPECT_NE(port->trouble().find("cure"), std::string_view::npos);
  EXPECT_FALSE(port->next(3 * kNsPerS, sample));
  EXPECT_FALSE(port->trouble().empty());
}

TEST(LcmPosePort, an_address_that_is_not_assigned_to_an_interface_is_trouble) {
  const auto port = open_port(settings_for(places::own_port(), "203.0.113.77"));
  PoseSample sample;
  EXPECT_FALSE(port->next(kNsPerS, sample));
  EXPECT_NE(port->trouble().find("no interface has this address"), std::string_view::npos);
}

TEST(LcmPosePort, only_the_configured_sender_is_used) {
  LcmSettings settings = settings_for(places::own_port(), "lo");
  ASSERT_TRUE(settings.senders.push(parse_network("203.0.113.7").value()));
  const Publisher publisher(lcm_create(settings.url.c_str()));
  ASSERT_TRUE(publisher) << kNoRoute;
  const auto port = open_port(settings);
  PoseSample sample;
  EXPECT_FALSE(port->next(1, sample));
  publish(publisher.get(), pose(1));
  EXPECT_FALSE(wait_and_take(*port, 2, sample));
  EXPECT_EQ(port->counters().wrong_sender, 1U);
  EXPECT_EQ(port->counters().accepted, 0U);
  EXPECT_NE(port->refusal(2).find("[pose] senders"), std::string_view::npos) << port->refusal(2);
  PoseNoteText note;
  EXPECT_TRUE(port->next_note(2, note));
  EXPECT_NE(note.view().find("1 datagrams from senders that may not publish"), std::string_view::npos) << note.view();
}

TEST(LcmPosePort, two_publishers_are_named_and_neither_is_used_until_one_is_silent) {
  const LcmSettings settings = settings_for(places::own_port(), "lo");
  const Publisher one(lcm_create(settings.url.c_str()));
  const Publisher two(lcm_create(settings.url.c_str()));
  ASSERT_TRUE(one && two) << kNoRoute;
  const auto port = open_port(settings);
  PoseSample sample;
  EXPECT_FALSE(port->next(1, sample));
  publish(one.get(), pose(1));
  EXPECT_TRUE(wait_and_take(*port, 2, sample));
  publish(two.get(), pose(100));
  EXPECT_FALSE(wait_and_take(*port, 3, sample));
  publish(one.get(), pose(2));
  EXPECT_FALSE(wait_and_take(*port, 4, sample));
  EXPECT_EQ(port->counters().second_publisher, 2U);
  EXPECT_NE(port->refusal(4).find("two programs publish"), std::string_view::npos) << port->refusal(4);
  publish(two.get(), pose(101));
  EXPECT_TRUE(wait_and_take(*port, 2 * kNsPerS, sample)) << "the other one has ended";
  EXPECT_EQ(sample.seq, 101);
}

TEST(LcmPosePort, a_rigid_transform_is_a_pose_if_configured) {
  LcmSettings settings = settings_for(places::own_port(), "lo");
  settings.type = PoseType::rigid_transform;
  const Publisher publisher(lcm_create(settings.url.c_str()));
  ASSERT_TRUE(publisher) << kNoRoute;
  const auto port = open_port(settings);
  PoseSample sample;
  EXPECT_FALSE(port->next(1, sample));
  bot_core::rigid_transform_t m{};
  m.utime = 77;
  m.trans[1] = -1.25;
  m.quat[0] = 0.5;
  m.quat[1] = m.quat[2] = 0.5;
  m.quat[3] = -0.5;
  std::string bytes(static_cast<std::size_t>(m.getEncodedSize()), '\0');
  m.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  publish(publisher.get(), pose(1));  // the other type is foreign now
  ASSERT_EQ(lcm_publish(publisher.get(), "FLANGE_POSE", bytes.data(), static_cast<unsigned>(bytes.size())), 0);
  ASSERT_TRUE(wait_and_take(*port, 2, sample));
  EXPECT_EQ(sample.utime_us, 77);
  EXPECT_EQ(sample.seq, 0);
  EXPECT_NEAR(sample.T_base_flange.translation_mm.y(), -1250.0, 1e-9);
  EXPECT_NEAR(sample.T_base_flange.rotation.z(), -0.5, 1e-12);
  EXPECT_EQ(port->counters().foreign, 1U);
  EXPECT_EQ(port->counters().other_type, 1U);
  const std::string_view refusal = port->refusal(2);
  EXPECT_NE(refusal.find("of type slabd.flange_pose_t ([pose] type is bot_core.rigid_transform_t) on FLANGE_POSE"),
            std::string_view::npos)
      << refusal;
  EXPECT_NE(refusal.find(" from "), std::string_view::npos) << refusal;
  PoseNoteText note;
  EXPECT_TRUE(port->next_note(2, note));
  EXPECT_NE(note.view().find("1 messages of another type"), std::string_view::npos) << note.view();
}

/// Runs `body` in a separate network namespace, where `lo` is down and without routes. Returns its exit status; 0
/// is good.
template <typename Body>
int in_own_network(Body body) {
  const pid_t child = fork();
  if (child == 0) {
    if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) _exit(99);
    _exit(body());
  }
  int status = -1;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

bool set_up(const char* name, bool up) {
  const Fd fd(socket(AF_INET, SOCK_DGRAM, 0));
  ifreq request{};
  std::strncpy(request.ifr_name, name, sizeof request.ifr_name - 1);
  if (ioctl(fd.get(), SIOCGIFFLAGS, &request) != 0) return false;
  request.ifr_flags = static_cast<short>(up ? request.ifr_flags | IFF_UP : request.ifr_flags & ~IFF_UP);
  return ioctl(fd.get(), SIOCSIFFLAGS, &request) == 0;
}

TEST(LcmPosePort, listens_again_on_an_interface_that_was_down) {
  EXPECT_EQ(in_own_network([] {
              const auto port = open_port(settings_for(7667, "lo"));
              PoseSample sample;
              if (port->next(kNsPerS, sample) || port->fd() >= 0) return 1;
              if (port->trouble().find("the interface is down") == std::string_view::npos) return 2;
              if (!set_up("lo", true) || port->next(2 * kNsPerS, sample) || port->fd() < 0) return 3;
              if (!port->trouble().empty()) return 4;
              if (!set_up("lo", false) || port->next(3 * kNsPerS, sample) || port->fd() >= 0) return 5;
              if (!set_up("lo", true) || port->next(4 * kNsPerS, sample) || port->fd() < 0) return 6;
              return 0;
            }),
            0);
}

/// A network adapter that can be unplugged and plugged in again, with the route to all groups. Each time the kernel
/// sees another interface, as with a USB adapter.
class Adapter {
 public:
  explicit Adapter(std::string_view name = "robot") { name.copy(name_.data(), name_.size() - 1); }
  /// False if this computer has no such device, or access is denied.
  bool plug() {
    tap_ = Fd(open("/dev/net/tun", O_RDWR | O_CLOEXEC));
    ifreq request = named();
    request.ifr_flags = IFF_TAP | IFF_NO_PI;
    if (!tap_.is_open() || ioctl(tap_.get(), TUNSETIFF, &request) != 0) return false;
    const Fd fd(socket(AF_INET, SOCK_DGRAM, 0));
    rtentry route{};
    route.rt_dev = name_.data();
    route.rt_flags = RTF_UP;
    write_address(route.rt_dst, "239.0.0.0");
    write_address(route.rt_genmask, "255.0.0.0");
    ifreq address = named();
    write_address(address.ifr_addr, "10.9.0.1");
    return ioctl(fd.get(), SIOCSIFADDR, &address) == 0 && set_up(name_.data(), true) &&
           ioctl(fd.get(), SIOCADDRT, &route) == 0;
  }
  void pull() { tap_.reset(); }
  /// Removes the address; the interface stays plugged in and up. Its routes are removed too.
  bool give_address_away() const {
    const Fd fd(socket(AF_INET, SOCK_DGRAM, 0));
    ifreq none = named();
    write_address(none.ifr_addr, "0.0.0.0");
    return ioctl(fd.get(), SIOCSIFADDR, &none) == 0;
  }

 private:
  ifreq named() const {
    ifreq request{};
    std::memcpy(request.ifr_name, name_.data(), name_.size());
    return request;
  }
  static void write_address(sockaddr& to, const char* text) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    inet_pton(AF_INET, text, &address.sin_addr);
    std::memcpy(&to, &address, sizeof address);
  }

  std::array<char, 8> name_{};
  Fd tap_;
};

TEST(LcmPosePort, listens_again_on_an_adapter_that_was_unplugged) {
  // By the kernel's choice, by name and by address.
  for (const char* interface : {"", "robot", "10.9.0.1"}) {
    const auto body = [&] {
      Adapter adapter;
      if (!adapter.plug()) return geteuid() == 0 && access("/dev/net/tun", F_OK) == 0 ? 1 : 0;
      const LcmSettings settings = settings_for(7667, interface);
      const auto port = open_port(settings);
      PoseSample sample;
      std::int64_t now_ns = kNsPerS;
      const auto hears = [&](std::int32_t seq) {
        now_ns += 2 * kNsPerS;
        if (port->next(now_ns, sample) || port->fd() < 0) return false;
        const Publisher publisher(lcm_create(settings.url.c_str()));
        if (!publisher) return false;
        publish(publisher.get(), pose(seq));
        return wait_and_take(*port, now_ns + 1, sample) && sample.seq == seq;
      };
      if (!hears(1)) return 2;
      for (std::int32_t again = 2; again < 5; ++again) {
        adapter.pull();
        now_ns += 2 * kNsPerS;
        if (port->next(now_ns, sample)) return 3;
        // A missing name or address is reported; the kernel's choice may return at any time.
        if (*interface != '\0' && port->trouble().empty()) return 4;
        if (!adapter.plug()) return 5;
        if (!hears(again)) return 6;
      }
      return 0;
    };
    EXPECT_EQ(in_own_network(body), 0) << "interface \"" << interface << "\"";
  }
}

TEST(LcmPosePort, an_address_that_moves_to_another_card_is_followed) {
  EXPECT_EQ(in_own_network([] {
              Adapter first("one");
              Adapter second("two");
              if (!first.plug()) return geteuid() == 0 && access("/dev/net/tun", F_OK) == 0 ? 1 : 0;
              const LcmSettings settings = settings_for(7667, "10.9.0.1");
              const auto port = open_port(settings);
              PoseSample sample;
              if (port->next(kNsPerS, sample) || port->fd() < 0) return 2;
              const auto hears = [&](std::int32_t seq, std::int64_t now_ns) {
                const Publisher publisher(lcm_create(settings.url.c_str()));
                if (!publisher) return false;
                publish(publisher.get(), pose(seq));
                return wait_and_take(*port, now_ns, sample) && sample.seq == seq;
              };
              if (!hears(1, kNsPerS + 1)) return 3;
              if (!first.give_address_away() || !second.plug()) return 4;
              // One datagram came in the first second, none in the next.
              if (port->next(2 * kNsPerS, sample) || port->next(3 * kNsPerS, sample)) return 5;
              if (!hears(2, 3 * kNsPerS + 1)) return 6;
              if (!second.give_address_away()) return 7;
              if (port->next(4 * kNsPerS, sample) || port->next(5 * kNsPerS, sample)) return 8;
              return port->fd() < 0 && !port->trouble().empty() ? 0 : 9;
            }),
            0);
}

TEST(LcmPosePort, without_a_route_the_cure_is_named) {
  EXPECT_EQ(in_own_network([] {
              if (!set_up("lo", true)) return 1;
              const auto port = open_port(settings_for(7667, ""));  // the kernel's route, which does not exist
              PoseSample sample;
              if (port->next(kNsPerS, sample) || port->fd() >= 0) return 2;
              return port->trouble().find("ip route add 239.255.76.67/32 dev lo") == std::string_view::npos ? 3 : 0;
            }),
            0);
}

TEST(LcmPosePort, settings_that_cannot_work_are_refused) {
  LcmSettings settings;
  settings.url = "udpm://1.2.3.4:7667?ttl=0";
  EXPECT_FALSE(make_lcm_pose_port(settings).ok());
  settings = {};
  settings.channel = "";
  EXPECT_FALSE(make_lcm_pose_port(settings).ok());
  settings = {};
  settings.interface = "../eth0";
  EXPECT_FALSE(make_lcm_pose_port(settings).ok());
  settings.interface = "a-name-of-sixteen";
  EXPECT_FALSE(make_lcm_pose_port(settings).ok());
}

}  // namespace
}  // namespace slabd::hal
