// SPDX-License-Identifier: Apache-2.0
//
// A KUKA controller sends RSI to the bridge, the bridge publishes on LCM, and the daemon measures a slab.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <net/if.h>
#include <net/route.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "processes.h"
#include "tests/places/places.h"
#include "tests/places/ports.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

using nlohmann::json;

class KukaLineTest : public testing::Test {
 protected:
  KukaLineTest() : rsi_("127.0.0.1:" + std::to_string(places::own_port())) {}

  [[nodiscard]] std::string lcm_url() const {
    std::smatch match;
    const std::string text = read_file(box_.config);
    return std::regex_search(text, match, std::regex("lcm_url = \"([^\"]+)\"")) ? match[1].str() : "";
  }
  [[nodiscard]] std::unique_ptr<Process> start_bridge(std::vector<std::string> more = {}) const {
    std::vector<std::string> command = {places::kuka_bridge(), "--listen", rsi_, "--lcm-url", lcm_url()};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<Process>(command, box_.dir / "bridge.out", box_.dir / "bridge.err");
  }
  /// Sends packets without <Base>, <Tool> and <Stopped>, for ten minutes or until it is destroyed.
  [[nodiscard]] std::unique_ptr<Process> standing_robot() const {
    const std::string script =
        "for ((i = 1; i <= 60000; ++i)); do printf '<Rob><RIst X=\"1800\" Y=\"-12.5\" Z=\"900\" A=\"30\" B=\"-20\" "
        "C=\"110\"/>"
        "<IPOC>%d</IPOC></Rob>' $((i*4)) >/dev/udp/" +
        std::regex_replace(rsi_, std::regex(":"), "/") + "; sleep 0.01; done";
    return std::make_unique<Process>(std::vector<std::string>{"/bin/bash", "-c", script}, box_.dir / "robot.out",
                                     box_.dir / "robot.err");
  }
  [[nodiscard]] json status() const {
    const Box::Answer answer = box_.slabctl({"status", "--config", box_.config.native(), "--json"});
    return answer.exit_status == 0 ? json::parse(answer.out, nullptr, false) : json(nullptr);
  }
  /// True if the bridge has written this.
  [[nodiscard]] bool bridge_says(const std::string& text) const {
    return read_file(box_.dir / "bridge.err").find(text) != std::string::npos;
  }

  Box box_;
  std::string rsi_;
};

TEST_F(KukaLineTest, a_kr_c2_without_rist_is_named_in_status_and_by_the_doctor) {
  box_.start();
  ASSERT_TRUE(box_.ready());
  const std::unique_ptr<Process> bridge = start_bridge();
  const std::string script =
      "for ((i = 1; i <= 30000; ++i)); do printf '<Rob TYPE=\"KUKA\"><RSol X=\"1\"/><ST_Source>17.2</ST_Source>"
      "<IPOC>%d</IPOC></Rob>' $((i*12)) >/dev/udp/" +
      std::regex_replace(rsi_, std::regex(":"), "/") + "; sleep 0.02; done";
  const Process robot({"/bin/bash", "-c", script}, box_.dir / "robot.out", box_.dir / "robot.err");
  const auto is_named = [](const std::string& text) {
    return text.find("the bridge reports: RSI packet: no element <RIst>, in the form of a KR C2") != std::string::npos;
  };
  std::string pose;
  for (int i = 0; i < 500 && !is_named(pose); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    const json now = status();
    if (now.is_object()) pose = now["links"]["pose"]["refusal"].get<std::string>();
  }
  EXPECT_TRUE(is_named(pose)) << pose;
  // The bridge says it once a second, so that one pause of it is enough for a doctor of two seconds not to hear it.
  Box::Answer doctor;
  for (int i = 0; i < 10 && !is_named(doctor.out); ++i)
    doctor = box_.slabctl({"doctor", "--config", box_.config.native(), "--json", "--listen-s", "2"});
  EXPECT_TRUE(is_named(doctor.out)) << doctor.out;
}

TEST_F(KukaLineTest, a_slab_is_finished_although_packets_get_lost_come_late_and_garbled) {
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  const auto bridge = start_bridge();
  const auto line = box_.simulate(
      {"--slab-no", "1", "--rsi", rsi_, "--rsi-faults", "0.002", "--robot-rate-hz", "250", "--scans-per-block", "3"});
  EXPECT_EQ(line->wait(), 0) << read_file(box_.dir / "simulate.out") << read_file(box_.dir / "simulate.err")
                             << read_file(box_.dir / "bridge.err");
  const std::string said = read_file(box_.dir / "bridge.err");
  EXPECT_NE(said.find("packets arrive from 127.0.0.1"), std::string::npos) << said;
  EXPECT_NE(said.find("RSI packet: "), std::string::npos) << "garbled ones are reported: " << said;
  EXPECT_EQ(status()["links"]["pose"]["malformed"], 0) << "and never reach the daemon";
  bridge->signal(SIGTERM);
  EXPECT_EQ(bridge->wait(), 0);
}

TEST_F(KukaLineTest, a_robot_in_the_wrong_base_is_refused) {
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  const auto bridge = start_bridge({"--base", "4"});
  // Packets without <Base>: the operator's statement is used.
  const auto robot = standing_robot();
  json seen;
  for (int i = 0; i < 1'000; ++i) {
    seen = status();
    if (seen.is_object() && seen["links"]["pose"]["code"] == 206) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
  }
  EXPECT_EQ(seen["links"]["pose"]["code"], 206) << seen;
}

TEST_F(KukaLineTest, the_monitor_shows_the_pendants_numbers_and_that_the_robot_is_at_rest) {
  const auto bridge = start_bridge();
  const auto robot = standing_robot();
  ASSERT_TRUE(places::wait_until([&] { return bridge_says("packets arrive from"); }, std::chrono::minutes(1)));
  // The monitor listens for 3 s from its start, which may be too short on a computer with other work.
  Box::Answer answer;
  json seen;
  for (int i = 0; i < 20 && !(seen.is_object() && seen["settled"] == true); ++i) {
    answer = box_.slabctl({"robot", "monitor", "--once", "--json", "--config", box_.config.native()});
    seen = json::parse(answer.out, nullptr, false);
  }
  EXPECT_EQ(answer.exit_status, 0) << answer.err;
  ASSERT_TRUE(seen.is_object()) << answer.out;
  EXPECT_EQ(seen["settled"], true) << seen;
  EXPECT_EQ(seen["gaps"], 0);
  EXPECT_NEAR(seen["T_base_flange"][0].get<double>(), 1800.0, 1e-9);
  EXPECT_NEAR(seen["kuka_abc_deg"][0].get<double>(), 30.0, 1e-9);
  EXPECT_NEAR(seen["kuka_abc_deg"][1].get<double>(), -20.0, 1e-9);
  EXPECT_NEAR(seen["kuka_abc_deg"][2].get<double>(), 110.0, 1e-9);
}

TEST_F(KukaLineTest, the_monitor_reports_missing_poses) {
  const Box::Answer answer = box_.slabctl({"robot", "monitor", "--seconds", "0.6", "--config", box_.config.native()});
  EXPECT_EQ(answer.exit_status, 4);
  EXPECT_NE(answer.out.find("no poses on channel FLANGE_POSE"), std::string::npos) << answer.out;
}

TEST_F(KukaLineTest, while_two_controllers_send_none_is_published_and_both_are_named) {
  const auto bridge = start_bridge();
  const std::size_t colon = rsi_.find(':');
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(rsi_.substr(colon + 1))));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::array<int, 2> robots{};
  for (std::uint32_t i = 0; i < robots.size(); ++i) {
    robots[i] = socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in own{};
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK + i);
    ASSERT_EQ(bind(robots[i], static_cast<sockaddr*>(static_cast<void*>(&own)), sizeof own), 0);
  }
  int ipoc_ms = 0;
  const auto send = [&](int robot, const char* x) {
    const std::string packet = std::string("<Rob><RIst X=\"") + x +
                               "\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/><IPOC>" + std::to_string(ipoc_ms += 4) +
                               "</IPOC></Rob>";
    sendto(robot, packet.data(), packet.size(), 0, static_cast<sockaddr*>(static_cast<void*>(&to)), sizeof to);
    std::this_thread::sleep_for(std::chrono::milliseconds(4));
  };
  const auto send_until = [&](int robot, const char* x, const std::string& said) {
    const auto is_said = [&] {
      send(robot, x);
      return bridge_says(said);
    };
    return places::wait_until(is_said, std::chrono::minutes(1));
  };
  ASSERT_TRUE(send_until(robots[0], "1000", "packets arrive from 127.0.0.1:")) << read_file(box_.dir / "bridge.err");
  // A controller that is silent for a second has left, and the other one is then the robot. On a computer with other
  // work this test may pause for so long: that round shows nothing, and is repeated.
  constexpr double kPauseMax_s = 0.8;
  const auto send_in_turn = [&](std::size_t packets) {
    double longest_s = 0.0;
    auto last = std::chrono::steady_clock::now();
    for (std::size_t i = 0; i < packets; ++i) {
      send(robots[i % 2], i % 2 == 0 ? "1000" : "1620");
      const auto now = std::chrono::steady_clock::now();
      longest_s = std::max(longest_s, std::chrono::duration<double>(now - last).count());
      last = now;
    }
    return longest_s;
  };
  double longest_s = kPauseMax_s;
  fs::path shown;
  for (int round = 0; round < 20 && longest_s >= kPauseMax_s; ++round) {
    send_in_turn(20);  // a round may follow on a pause
    shown = box_.dir / ("monitor-" + std::to_string(round) + ".out");
    const Process monitor(
        {places::slabctl(), "robot", "monitor", "--seconds", "2", "--json", "--config", box_.config.native()}, shown,
        box_.dir / "monitor.err");
    longest_s = send_in_turn(600);
  }
  ASSERT_LT(longest_s, kPauseMax_s) << "twenty rounds with a pause";
  EXPECT_EQ(read_file(shown).find("[1620"), std::string::npos) << "not the second one's";
  EXPECT_TRUE(places::wait_until([&] { return bridge_says("packets of 127.0.0.2:"); }))
      << read_file(box_.dir / "bridge.err");
  EXPECT_TRUE(bridge_says("127.0.0.1 sends as well")) << read_file(box_.dir / "bridge.err");
  EXPECT_TRUE(send_until(robots[1], "1620", "packets arrive from 127.0.0.2:")) << "the first one has fallen silent";
  for (const int robot : robots) close(robot);
}

TEST_F(KukaLineTest, packets_of_a_stranger_are_dropped) {
  const auto bridge = start_bridge({"--from", "127.0.0.9"});
  const auto robot = standing_robot();
  ASSERT_TRUE(places::wait_until([&] { return bridge_says("are dropped"); }, std::chrono::minutes(1)))
      << read_file(box_.dir / "bridge.err");
  std::this_thread::sleep_for(std::chrono::milliseconds(1'500));
  EXPECT_FALSE(bridge_says("packets arrive from"));
  EXPECT_TRUE(bridge->running());
}

/// Adds or deletes the route of all groups over `lo`: SIOCADDRT or SIOCDELRT.
bool change_route(int socket, unsigned long change) {
  std::array<char, 3> lo{"lo"};
  rtentry route{};
  route.rt_dev = lo.data();
  route.rt_flags = RTF_UP;
  const auto write = [](sockaddr& to, const char* text) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    inet_pton(AF_INET, text, &address.sin_addr);
    std::memcpy(&to, &address, sizeof address);
  };
  write(route.rt_dst, "239.0.0.0");
  write(route.rt_genmask, "255.0.0.0");
  return ioctl(socket, change, &route) == 0;
}

/// Sends packets until the bridge has reported the loss, in a separate network. Returns an exit status; 0 is good.
int lose_the_route(const std::string& rsi, const fs::path& dir) {
  if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return 99;
  const int robot = socket(AF_INET, SOCK_DGRAM, 0);
  ifreq lo{};
  std::strncpy(lo.ifr_name, "lo", sizeof lo.ifr_name - 1);
  lo.ifr_flags = IFF_UP | IFF_LOOPBACK | IFF_RUNNING;
  if (ioctl(robot, SIOCSIFFLAGS, &lo) != 0 || !change_route(robot, SIOCADDRT)) return 98;
  sockaddr_in to{};
  to.sin_family = AF_INET;
  const std::size_t colon = rsi.find(':');
  inet_pton(AF_INET, rsi.substr(0, colon).c_str(), &to.sin_addr);
  to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(rsi.substr(colon + 1))));
  int ipoc_ms = 0;
  Process bridge({places::kuka_bridge(), "--listen", rsi, "--lcm-url", "udpm://239.255.76.67:7667?ttl=0"}, dir / "out",
                 dir / "err");
  const auto says = [&](const char* text) {
    for (int i = 0; i < 6'000; ++i) {
      const std::string packet = "<Rob><RIst X=\"1\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/><IPOC>" +
                                 std::to_string(ipoc_ms += 12) + "</IPOC></Rob>";
      sendto(robot, packet.data(), packet.size(), 0, static_cast<sockaddr*>(static_cast<void*>(&to)), sizeof to);
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      if (read_file(dir / "err").find(text) != std::string::npos) return true;
    }
    return false;
  };
  if (!says("packets arrive from")) return 1;
  if (read_file(dir / "err").find("cannot be published") != std::string::npos) return 2;
  if (!change_route(robot, SIOCDELRT) || !says("poses cannot be published: Network is unreachable")) return 3;
  if (!change_route(robot, SIOCADDRT) || !says("poses are published again")) return 4;
  return bridge.running() ? 0 : 5;
}

TEST_F(KukaLineTest, poses_that_do_not_leave_the_computer_are_reported) {
  const pid_t child = fork();
  if (child == 0) _exit(lose_the_route(rsi_, box_.dir));
  int status = -1;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0) << read_file(box_.dir / "err");
}

TEST_F(KukaLineTest, a_mistake_on_the_command_line_is_named) {
  const struct {
    std::vector<std::string> arguments;
    int status;
    const char* told;
  } cases[] = {{{"--listen", "here"}, 3, "ADDRESS:PORT"},
               {{"--listen", "127.0.0.1:49152x"}, 3, "ADDRESS:PORT"},
               {{"--lcm-url", "udp://239.255.76.67:7667?ttl=0"}, 3, "udpm://GROUP:PORT"},
               {{"--lcm-url", "memq://"}, 3, "udpm://GROUP:PORT"},
               {{"--lcm-url", "udpm://10.0.0.1:7667?ttl=0"}, 3, "224.0.0.0"},
               {{"--lcm-url", "udpm://239.255.76.67:7667?tll=1"}, 3, "ttl=N"},
               {{"--from", "kuka"}, 3, "IPv4"},
               {{"--listen", "192.0.2.1:49152"}, 4, "192.0.2.1"},
               {{"--cycle-ms", "5"}, 2, "cycle-ms"}};
  for (const auto& c : cases) {
    std::vector<std::string> command = {places::kuka_bridge()};
    command.insert(command.end(), c.arguments.begin(), c.arguments.end());
    Process bridge(command, box_.dir / "out", box_.dir / "err");
    EXPECT_EQ(bridge.wait(), c.status);
    EXPECT_NE((read_file(box_.dir / "err") + read_file(box_.dir / "out")).find(c.told), std::string::npos)
        << read_file(box_.dir / "err");
  }
}

}  // namespace
}  // namespace slabd::line
