// SPDX-License-Identifier: Apache-2.0
//
// Poses are received in parallel with the daemon, because multicast reaches all receivers.
#include <fmt/core.h>
#include <poll.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <memory>
#include <thread>

#include "calib/calib.h"
#include "cli/doctor/doctor.h"
#include "cli/pose_counts.h"
#include "cli/terminal/say.h"
#include "emulator/robot_peer.h"
#include "hal/hal.h"

namespace slabd::cli {
namespace {

/// At a lower rate poses do not fill the settled window; the robot's cycle is 4 or 12 ms.
constexpr double kPoseRateMin_hz = 50.0;
constexpr double kClockSkew_s = 1.0;

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

/// Receives poses of one robot for `seconds`.
void examine_robot(const config::ArmSettings& arm, double seconds, Examination& report) {
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

}  // namespace

void examine_robots(const config::Config& config, double seconds, Examination& report) {
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    name_part(config, say("robot"), config.arm(arm).by.robot, report);
    examine_robot(config.arm(arm), seconds, report);
  }
  report.set_subject({});
}

}  // namespace slabd::cli
