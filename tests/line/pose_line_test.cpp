// SPDX-License-Identifier: Apache-2.0
//
// A real daemon receives realistic poses: hundreds of thousands of crafted datagrams, two publishers, a recorded log, a
// type of other publishers.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <lcm/eventlog.h>
#include <lcm/lcm.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <bot_core/rigid_transform_t.hpp>
#include <chrono>
#include <cmath>
#include <csignal>
#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <regex>
#include <slabd/flange_pose_t.hpp>
#include <stop_token>
#include <thread>

#include "base/prng.h"
#include "processes.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

using Json = nlohmann::json;
using namespace std::chrono_literals;

constexpr const char* kChannel = "FLANGE_POSE";
constexpr std::int64_t kPeriod_us = 4'000;

flange_pose_t pose(std::int32_t seq) {
  flange_pose_t m{};
  m.utime = 1'700'000'000'000'000 + kPeriod_us * seq;
  m.robot_time_us = -1;
  m.seq = seq;
  m.flags = 1;
  m.trans[0] = 1.8;
  m.trans[2] = 0.9;
  m.quat[0] = 1.0;
  return m;
}

template <typename Message>
std::string encoded(const Message& m) {
  std::string bytes(static_cast<std::size_t>(m.getEncodedSize()), '\0');
  m.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

std::string datagram(const std::string& payload, const std::string& channel = kChannel) {
  return std::string("LC02") + std::string("\0\0\0\1", 4) + channel + '\0' + payload;
}

/// A fragment of LCM's long message, which slabd never accepts: the kind that writes outside of liblcm 1.3.1's buffers.
std::string fragment(std::uint32_t total, std::uint32_t offset, std::uint16_t number, std::uint16_t of,
                     const std::string& body) {
  std::string bytes = "LC03";
  const auto put = [&bytes](std::uint32_t value, int size) {
    for (int i = size - 1; i >= 0; --i) bytes += static_cast<char>(value >> (8 * i));
  };
  put(9, 4);
  put(total, 4);
  put(offset, 4);
  put(number, 2);
  put(of, 2);
  return bytes + (number == 0 ? std::string(kChannel) + '\0' : "") + body;
}

class Sender {
 public:
  explicit Sender(const std::string& url) : fd_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    std::smatch match;
    EXPECT_TRUE(std::regex_search(url, match, std::regex("udpm://([0-9.]+):([0-9]+)")));
    to_.sin_family = AF_INET;
    to_.sin_port = htons(static_cast<std::uint16_t>(std::stoi(match[2])));
    inet_pton(AF_INET, match[1].str().c_str(), &to_.sin_addr);
    const unsigned char ttl = 0;
    ::setsockopt(fd_, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
  }
  ~Sender() { ::close(fd_); }
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;
  bool send(const std::string& bytes) const {
    return ::sendto(fd_, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to_), sizeof to_) ==
           static_cast<ssize_t>(bytes.size());
  }

 private:
  int fd_;
  sockaddr_in to_{};
};

/// A datagram that is not a pose, or a wrong pose.
std::string crafted(Prng& prng, std::int32_t seq) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  flange_pose_t m = pose(seq);
  const auto index = [&prng](std::uint64_t below) { return static_cast<std::size_t>(prng.next() % below); };
  switch (index(18)) {
    case 0: m.trans[index(3)] = kNan; return datagram(encoded(m));
    case 1: m.quat[index(4)] = std::numeric_limits<double>::infinity(); return datagram(encoded(m));
    case 2: m.quat[0] = 1.01; return datagram(encoded(m));
    case 3: m.quat[0] = 0.0; return datagram(encoded(m));
    case 4: m.trans[1] = 1e300; return datagram(encoded(m));
    case 5: m.trans[1] = 10.5; return datagram(encoded(m));
    case 6: m.utime -= 8'000'000; return datagram(encoded(m));  // from the past
    case 7:
      m.utime -= kPeriod_us;
      m.seq -= 1;
      return datagram(encoded(m));  // the last pose repeated
    case 8: return datagram(encoded(m), "OTHER");
    case 9: return datagram(encoded(m)).substr(0, index(111));                  // cut
    case 10: return datagram(encoded(m)) + std::string(1 + index(1'000), 'x');  // too long
    case 11: return datagram(std::string(92, static_cast<char>(prng.next())));  // fingerprint
    case 12: return fragment(0xFFFF'FFFF, 0, 0, 2, std::string(64, 'a'));
    case 13: return fragment(200, 0xFFFF'FFF0, 1, 2, std::string(64, 'b'));
    case 14: return fragment(200, 150, 1, 2, std::string(120, 'c'));
    case 15:
      return std::string("LC02") + std::string(4, '\0') + std::string(1'200, 'n');  // a channel without a terminator
    case 16: return datagram(encoded(m), std::string(64, 'c'));
    default: {
      std::string noise(index(1'400), '\0');
      for (char& c : noise) c = static_cast<char>(prng.next());
      return noise;
    }
  }
}

class PoseLineTest : public testing::Test {
 protected:
  void TearDown() override {
    if (HasFailure()) std::fprintf(stderr, "---- slabd ----\n%s", box_.log().c_str());
  }
  [[nodiscard]] std::string url() const {
    std::smatch match;
    const std::string text = read_file(box_.config);
    return std::regex_search(text, match, std::regex("lcm_url = \"([^\"]+)\"")) ? match[1].str() : "";
  }
  [[nodiscard]] Json status() const {
    const Box::Answer answer = box_.slabctl({"status", "--config", box_.config.native(), "--json"});
    EXPECT_EQ(answer.exit_status, 0) << answer.err;
    return Json::parse(answer.out, nullptr, false);
  }
  [[nodiscard]] Json link() const { return status()["links"]["pose"]; }
  /// Polls until `done`; false if that takes longer than a line does on a loaded computer.
  [[nodiscard]] static bool wait_until(const std::function<bool()>& done) { return places::wait_until(done, 5min); }
  void start() {
    box_.start();
    ASSERT_TRUE(box_.ready()) << box_.log();
    // A loaded computer needs time until the first turn.
    const auto answers = [this] {
      return box_.slabctl({"status", "--config", box_.config.native()}).exit_status == 0 || !box_.running();
    };
    ASSERT_TRUE(wait_until(answers)) << "status gets no answer\n" << box_.log();
    EXPECT_EQ(link()["code"], 201) << "it listens, and hears nothing";
  }

  Box box_;
};

TEST_F(PoseLineTest, two_hundred_thousand_crafted_datagrams_change_neither_pose_nor_memory) {
  start();
  const Sender robot(url());
  Prng prng(20'261'121);
  constexpr int kBursts = 1'000;
  constexpr int kCraftedPerBurst = 200;
  std::int32_t seq = 0;
  const auto burst = [&](int crafted_ones) {
    // Sent between valid poses, from the same address and port, so that they differ only in their content.
    for (int i = 0; i < crafted_ones; ++i) static_cast<void>(robot.send(crafted(prng, seq + 1)));
    ASSERT_TRUE(robot.send(datagram(encoded(pose(++seq)))));
    // The kernel's receive buffer is finite.
    ASSERT_TRUE(wait_until([&] { return !box_.running() || udp_backlog(box_.lcm_port).value_or(0) == 0; }))
        << "slabd does not read its datagrams";
  };
  burst(0);  // the first publisher is accepted
  for (int i = 0; i < 20 && !HasFatalFailure(); ++i) burst(kCraftedPerBurst);
  const std::int64_t before_kb = anonymous_kb(box_.pid());
  ASSERT_GT(before_kb, 0);
  for (int i = 20; i < kBursts && !HasFatalFailure(); ++i) burst(kCraftedPerBurst);
  ASSERT_FALSE(HasFatalFailure());
  // A valid pose lost in a full buffer is a gap, never a wrong pose.
  ASSERT_TRUE(wait_until([&] { return link()["code"] != 0; })) << "poses seem to arrive still: " << link();
  const Json after = status();
  const Json& pose_link = after["links"]["pose"];
  EXPECT_TRUE(box_.running());
  // After a second without a pose slabd forgets the last one, and accepts a repeated or an old one as the first.
  constexpr int kPausesMax = 20;
  EXPECT_LE(pose_link["accepted"].get<int>(), seq + kPausesMax) << "only true ones";
  EXPECT_GE(pose_link["accepted"].get<int>(), seq / 4);
  EXPECT_EQ(pose_link["jumps"], 0);
  for (const char* counter :
       {"foreign", "malformed", "not_finite", "not_unit", "out_of_reach", "repeated", "time_back"})
    EXPECT_GT(pose_link[counter].get<int>(), 1'000) << counter;
  EXPECT_LE(anonymous_kb(box_.pid()), before_kb + 512);
  // Poses have stopped, which is reported.
  EXPECT_EQ(pose_link["code"], 202) << pose_link;
  EXPECT_GE(pose_link["stale"].get<int>(), 1);
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(PoseLineTest, two_publishers_are_reported_and_the_slab_is_finished_when_one_is_stopped) {
  start();
  // Another program that publishes another position of the arm, for the first seconds of the slab.
  std::jthread second([&](const std::stop_token& stop) {
    lcm_t* lcm = lcm_create(url().c_str());
    for (std::int32_t seq = 1; !stop.stop_requested(); ++seq) {
      flange_pose_t m = pose(seq);
      m.trans[0] = 0.3;
      const std::string bytes = encoded(m);
      lcm_publish(lcm, kChannel, bytes.data(), static_cast<unsigned>(bytes.size()));
      std::this_thread::sleep_for(8ms);
    }
    lcm_destroy(lcm);
  });
  ASSERT_TRUE(wait_until([&] { return link()["accepted"].get<int>() > 10; })) << link();
  const auto line = box_.simulate({"--slab-no", "1"});
  Json seen;
  const auto is_second_counted = [&] {
    seen = link();
    return seen["second_publisher"].get<int>() > 400 || !line->running();
  };
  ASSERT_TRUE(wait_until(is_second_counted)) << seen;
  EXPECT_NE(seen["refusal"].get<std::string>().find("two programs publish"), std::string::npos) << seen;
  EXPECT_NE(seen["code"], 0) << "neither is used";
  second.request_stop();
  second.join();
  EXPECT_EQ(line->wait(), 0) << read_file(box_.dir / "simulate.err");
  EXPECT_TRUE(box_.logs("while two programs publish")) << box_.log();
}

TEST_F(PoseLineTest, pose_flags_of_the_robot_are_shown_by_log_status_and_monitor) {
  start();
  std::atomic<std::int32_t> flags{0};
  const std::jthread robot([&](const std::stop_token& stop) {
    const Sender sender(url());
    for (std::int32_t seq = 1; !stop.stop_requested(); ++seq) {
      flange_pose_t m = pose(seq);
      m.flags = flags;
      static_cast<void>(sender.send(datagram(encoded(m))));
      std::this_thread::sleep_for(8ms);
    }
  });
  const auto noted = [&](const char* text) {
    return link()["note"].get<std::string>().find(text) != std::string::npos;
  };
  const auto monitor = [&] {
    return box_.slabctl({"robot", "monitor", "--once", "--config", box_.config.native()}).out;
  };
  ASSERT_TRUE(wait_until([&] { return noted("not measured"); })) << link();
  EXPECT_TRUE(box_.logs("its poses as commanded")) << box_.log();
  flags = 3;  // measured, stopped
  ASSERT_TRUE(wait_until([&] { return link()["note"] == ""; })) << link();
  // The monitor listens for 3 s from its start, which may be too short on a computer with other work.
  std::string shown;
  const auto shows = [&](const char* text) {
    shown = monitor();
    return shown.find(text) != std::string::npos;
  };
  EXPECT_TRUE(wait_until([&] { return shows("settled: a scan could begin\n"); })) << shown;
  flags = 1;
  ASSERT_TRUE(wait_until([&] { return noted("does not say \"stopped\""); })) << link();
  EXPECT_TRUE(wait_until([&] { return shows("unless slabd has received \"stopped\""); })) << shown;
  const auto status_shows = [&](const char* text) {
    shown = box_.slabctl({"status", "--config", box_.config.native()}).out;
    return shown.find(text) != std::string::npos;
  };
  EXPECT_TRUE(wait_until([&] { return status_shows("poses arrive; the robot does not say"); })) << shown;
}

TEST_F(PoseLineTest, a_log_played_by_lcm_logplayer_arrives_pose_by_pose) {
  constexpr int kPoses = 250;
  const std::string log = box_.dir / "poses.lcmlog";
  lcm_eventlog_t* file = lcm_eventlog_create(log.c_str(), "w");
  ASSERT_NE(file, nullptr);
  for (int i = 1; i <= kPoses; ++i) {
    std::string bytes = encoded(pose(i));
    lcm_eventlog_event_t event{};
    event.eventnum = i;
    event.timestamp = pose(i).utime;
    std::string channel = i % 5 == 0 ? "CAMERA" : kChannel;  // a log contains more than poses
    event.channellen = static_cast<int>(channel.size());
    event.datalen = static_cast<int>(bytes.size());
    event.channel = channel.data();
    event.data = bytes.data();
    ASSERT_EQ(lcm_eventlog_write_event(file, &event), 0);
  }
  lcm_eventlog_destroy(file);
  start();
  Process player({"/usr/bin/lcm-logplayer", "--lcm-url", url(), log}, box_.dir / "player.out", box_.dir / "player.err");
  EXPECT_EQ(player.wait(), 0) << read_file(box_.dir / "player.err");
  ASSERT_TRUE(wait_until([&] { return link()["accepted"].get<int>() >= kPoses - kPoses / 5; })) << link();
  ASSERT_TRUE(wait_until([&] { return link()["code"] == 202; })) << link();
  const Json seen = link();
  EXPECT_EQ(seen["accepted"], kPoses - kPoses / 5) << seen;
  EXPECT_EQ(seen["foreign"], kPoses / 5);
  // Over a second without poses slabd does not count, so a pause of the player or of slabd may hide a gap.
  constexpr int kPausesMax = 2;
  EXPECT_LE(seen["gaps"].get<int>(), kPoses / 5 - 1) << "those on the other channel are missing in the numbers";
  EXPECT_GE(seen["gaps"].get<int>(), kPoses / 5 - 1 - kPausesMax);
  EXPECT_EQ(seen["malformed"], 0);
}

TEST_F(PoseLineTest, a_rigid_transform_settles_and_a_stranger_is_refused_by_name) {
  std::ofstream(box_.config, std::ios::app) << "[pose]\ntype = \"bot_core.rigid_transform_t\"\n";
  std::atomic<bool> stop{false};
  std::thread robot([&] {
    lcm_t* lcm = lcm_create(url().c_str());
    bot_core::rigid_transform_t m{};
    m.trans[2] = 1.25;
    m.quat[0] = 1.0;
    for (m.utime = 1; !stop; m.utime += 8'000) {
      const std::string bytes = encoded(m);
      lcm_publish(lcm, kChannel, bytes.data(), static_cast<unsigned>(bytes.size()));
      std::this_thread::sleep_for(8ms);
    }
    lcm_destroy(lcm);
  });
  // The monitor listens for 3 s from its start, which may be too short on a computer with other work.
  Box::Answer good;
  const auto is_settled = [&] {
    good = box_.slabctl({"robot", "monitor", "--once", "--json", "--config", box_.config.native()});
    const Json seen = Json::parse(good.out, nullptr, false);
    return seen.is_object() && seen["settled"] == true;
  };
  EXPECT_TRUE(wait_until(is_settled)) << good.out << good.err;
  std::ofstream(box_.config, std::ios::app) << "senders = [\"203.0.113.0/24\"]\n";
  Box::Answer strange;
  const auto is_named = [&] {
    strange = box_.slabctl({"robot", "monitor", "--once", "--config", box_.config.native()});
    return strange.out.find("[pose] senders") != std::string::npos;
  };
  EXPECT_TRUE(wait_until(is_named)) << strange.out;
  stop = true;
  robot.join();
  EXPECT_EQ(good.exit_status, 0) << good.err;
  EXPECT_EQ(strange.exit_status, 4) << strange.out;
}

}  // namespace
}  // namespace slabd::line
