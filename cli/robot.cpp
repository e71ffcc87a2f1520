// SPDX-License-Identifier: Apache-2.0
//
// slabctl robot monitor: shows the robot's messages as slabd receives them, with the same reader and the same gate. It
// works in parallel with a running daemon, because multicast reaches both.
#include <fmt/core.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <memory>
#include <thread>

#include "calib/calib.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/pose_counts.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "daemon/station/pose_gate.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string config;
  std::string robot;  ///< id; empty: the only one
  double seconds = 0.0;
  bool once = false;
  bool as_json = false;
};

constexpr std::int64_t kShow_ns = 500'000'000;
/// Long enough for the gate's window, its dwell and a slow sender.
constexpr std::int64_t kOnce_ns = 3 * kNsPerS;

std::atomic<bool> g_stop{false};
void on_signal(int) {
  g_stop = true;
}

/// Counts since the previous display.
struct Traffic {
  std::int64_t since_ns = 0;
  std::uint64_t poses = 0;
  std::uint64_t gaps = 0;  ///< count of the link at that time
  void begin(std::int64_t now_ns, std::uint64_t gaps_then) { *this = {now_ns, 0, gaps_then}; }
  [[nodiscard]] double rate_hz(std::int64_t now_ns) const {
    return now_ns > since_ns ? 1e9 * static_cast<double>(poses) / static_cast<double>(now_ns - since_ns) : 0.0;
  }
};

/// Data displayed at one time.
struct View {
  double rate_hz = 0.0;
  std::uint64_t gaps = 0;
  double age_ms = kNoValue;
  bool heard = false;
  PoseSample newest;
  Code settled = Code::no_pose;
  daemon::PoseMean mean;
  std::string trouble;
  std::string refusal;
  hal::PoseLinkCounters counters;
  bool lacks_stopped = false;
  /// True if the robot does not report "stopped". slabd may have received it earlier than this monitor, and then waits
  /// for it.
  [[nodiscard]] bool stopped_missing(const config::ArmSettings& config) const {
    return !newest.stopped && config.robot.type == hal::PoseType::flange_pose;
  }
};

class Monitor {
 public:
  Monitor(const config::ArmSettings& config, hal::PosePort& port) : config_(config), port_(port), gate_(config.pose) {
    traffic_.begin(clock_->mono_ns(), 0);
  }

  /// Receives poses until `end_ns`.
  void listen(std::int64_t end_ns) {
    for (std::int64_t now = clock_->mono_ns(); now < end_ns && !g_stop; now = clock_->mono_ns()) {
      PoseSample sample;
      while (port_.next(now, sample)) take(sample, now);
      if (port_.fd() < 0) {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        continue;
      }
      pollfd waiting{port_.fd(), POLLIN, 0};
      (void)::poll(&waiting, 1, 20);
    }
  }
  View look() {
    const std::int64_t now = clock_->mono_ns();
    View view;
    view.rate_hz = traffic_.rate_hz(now);
    view.gaps = port_.counters().gaps - traffic_.gaps;
    view.heard = heard_;
    view.newest = newest_;
    if (heard_) view.age_ms = ms_from_ns(now - newest_.arrival_ns);
    view.settled = gate_.settled(now, view.mean);
    view.lacks_stopped = gate_.lacks_stopped();
    view.trouble = std::string(port_.trouble());
    view.refusal = std::string(port_.refusal(now));
    view.counters = port_.counters();
    traffic_.begin(now, view.counters.gaps);
    return view;
  }
  [[nodiscard]] std::int64_t now_ns() const { return clock_->mono_ns(); }

 private:
  void take(PoseSample sample, std::int64_t now_ns) {
    sample.arrival_ns = now_ns;
    ++traffic_.poses;
    gate_.add(sample);
    newest_ = sample;
    heard_ = true;
  }

  const config::ArmSettings& config_;
  hal::PosePort& port_;
  std::unique_ptr<hal::Clock> clock_ = hal::make_system_clock();
  daemon::PoseGate gate_;
  Traffic traffic_;
  PoseSample newest_;
  bool heard_ = false;
};

std::string why(const config::ArmSettings& config, const View& view) {
  if (!view.trouble.empty()) return view.trouble;
  if (!view.heard)
    return fmt::format("no poses on channel {} of {} ({}); {} foreign datagrams{}{}", config.robot.channel.view(),
                       config.robot.url.view(), hal::kPoseTypes.at(static_cast<std::size_t>(config.robot.type)),
                       view.counters.foreign, view.refusal.empty() ? "" : "; refused: ", view.refusal);
  if (view.settled == Code::ok)
    return view.stopped_missing(config)
               ? "settled: a scan could begin, unless slabd has received \"stopped\" of this robot "
                 "before (flags, bit 1): it is not said now"
               : "settled: a scan could begin";
  std::string more;
  if (view.settled == Code::wrong_frame)
    more = fmt::format(": base {} and tool {} are active, expected {} and {}", view.newest.base_id, view.newest.tool_id,
                       config.pose.base_id, config.pose.tool_id);
  if (view.settled == Code::not_settled && view.lacks_stopped)
    more = ": it does not say \"stopped\" (flags, bit 1), as it did before";
  return fmt::format("{} {}{}; {}", static_cast<int>(view.settled), describe(view.settled), more, cure(view.settled));
}

std::string flags(const PoseSample& pose, hal::PoseType type) {
  if (type == hal::PoseType::rigid_transform) return "measured or commanded, standstill: not said";
  std::string text =
      pose.measured ? "measured" : "commanded: not where the robot is, send measured poses (flags, bit 0)";
  if (pose.stopped) text += ", stopped";
  if (pose.running) text += ", program running";
  if (pose.estop) text += ", EMERGENCY STOP";
  if (pose.emulated) text += ", EMULATED";
  return text;
}

std::string refused_text(const View& view) {
  std::string text = pose_faults_text(view.counters);
  text += fmt::format("{}{} accepted", text.empty() ? "" : ", ", view.counters.accepted);
  if (!view.refusal.empty()) text += "; now refused: " + view.refusal;
  return text;
}

std::vector<std::string> lines_of(const config::ArmSettings& config, const View& view) {
  std::vector<std::string> lines;
  lines.push_back(fmt::format("robot      {}", why(config, view)));
  if (!view.heard) return lines;
  const Pose& pose = view.newest.T_base_flange;
  const Vec3& p = pose.translation_mm;
  const KukaAbc abc = kuka_abc_from_rotation(pose.rotation);
  lines.push_back(fmt::format("link       {:.0f} poses/s, newest {:.0f} ms old, {} gaps, number {}", view.rate_hz,
                              view.age_ms, view.gaps, view.newest.seq));
  lines.push_back(fmt::format("since      {}", refused_text(view)));
  lines.push_back(fmt::format("flange     X {:.3f}  Y {:.3f}  Z {:.3f} mm   A {:.4f}  B {:.4f}  C {:.4f} deg", p.x(),
                              p.y(), p.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad)));
  const Quat& q = pose.rotation;
  lines.push_back(fmt::format("quaternion w {:.7f}  x {:.7f}  y {:.7f}  z {:.7f}", q.w(), q.x(), q.y(), q.z()));
  lines.push_back(fmt::format("frame      base {}, tool {}, {}", view.newest.base_id, view.newest.tool_id,
                              flags(view.newest, config.robot.type)));
  if (view.mean.samples != 0)
    lines.push_back(fmt::format("spread     {:.4f} mm, {:.5f} deg over {} poses (allowed {:.3f} mm, {:.4f} deg)",
                                view.mean.spread_mm, deg_from_rad(view.mean.spread_rad), view.mean.samples,
                                config.pose.settled_mm, deg_from_rad(config.pose.settled_rad)));
  return lines;
}

std::string json_of(const config::ArmSettings& config, const View& view) {
  report::Json json("slabd.robot/1");
  json.field("robot", config.by.robot.view());
  json.field("settled", view.settled == Code::ok).field("code", static_cast<int>(view.settled));
  json.field("text", why(config, view)).field("rate_hz", view.rate_hz).field("age_ms", view.age_ms);
  json.field("gaps", view.gaps).field("foreign", view.counters.foreign).field("refusal", view.refusal);
  for (const NamedCount& c : pose_faults(view.counters)) json.field(c.name, c.count);
  json.field("accepted", view.counters.accepted);
  if (view.heard) {
    json.field("seq", view.newest.seq).field("base_id", view.newest.base_id).field("tool_id", view.newest.tool_id);
    json.field("measured", view.newest.measured).field("stopped", view.newest.stopped);
    json.field("running", view.newest.running).field("estop", view.newest.estop);
    json.field("emulated", view.newest.emulated).field("T_base_flange", view.newest.T_base_flange);
    const KukaAbc abc = kuka_abc_from_rotation(view.newest.T_base_flange.rotation);
    const std::array<double, 3> abc_deg = {deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad)};
    json.field("kuka_abc_deg", abc_deg).field("spread_mm", view.mean.samples != 0 ? view.mean.spread_mm : kNoValue);
    json.field("spread_deg", view.mean.samples != 0 ? deg_from_rad(view.mean.spread_rad) : kNoValue);
  }
  return json.text();
}

/// Prints over the previous display on a terminal, otherwise below it.
void show(const std::vector<std::string>& lines, std::size_t& shown) {
  const bool terminal = ::isatty(STDOUT_FILENO) == 1;
  if (terminal && shown != 0) fmt::print("\x1b[{}A", shown);
  for (const std::string& line : lines) fmt::print("{}{}\n", line, terminal ? "\x1b[K" : "");
  if (terminal && lines.size() < shown) {
    for (std::size_t i = lines.size(); i < shown; ++i) fmt::print("\x1b[K\n");
  } else {
    shown = lines.size();
  }
  if (!terminal) fmt::print("\n");
  std::fflush(stdout);
}

/// The arm with this robot. Stops if no robot has the id, or if it must be named.
const config::ArmSettings& arm_named(const config::Config& config, const std::string& robot) {
  std::string ids;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    const std::string id(config.arms.list[arm].robot.view());
    if (id == robot || (robot.empty() && !config.arms.several())) return config.arm(arm);
    ids += (ids.empty() ? "" : ", ") + id;
  }
  stop(kUsage, robot.empty() ? fmt::format("--robot: the line has several; name one of {}", ids)
                             : fmt::format("--robot {}: the line has {}", robot, ids));
}

int monitor(const Options& options) {
  const config::Config line = config_from(options.config);
  const config::ArmSettings& config = arm_named(line, options.robot);
  const std::unique_ptr<hal::PosePort> port = need(hal::make_lcm_pose_port(config.robot), kBadInput);
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  Monitor monitor(config, *port);
  const std::int64_t start = monitor.now_ns();
  View view;
  if (options.once) {
    do {
      monitor.listen(monitor.now_ns() + kShow_ns);
      view = monitor.look();
    } while (!g_stop && view.settled != Code::ok && monitor.now_ns() - start < kOnce_ns);
    if (options.as_json) {
      fmt::print("{}", json_of(config, view));
    } else {
      std::size_t shown = 0;
      show(lines_of(config, view), shown);
    }
    return view.heard ? kDone : kNotReachable;
  }
  const auto end = static_cast<std::int64_t>(options.seconds * 1e9);
  for (std::size_t shown = 0; !g_stop && (end == 0 || monitor.now_ns() - start < end);) {
    monitor.listen(monitor.now_ns() + kShow_ns);
    view = monitor.look();
    if (options.as_json)
      fmt::print("{}", json_of(config, view));
    else
      show(lines_of(config, view), shown);
    std::fflush(stdout);
  }
  return view.heard ? kDone : kNotReachable;
}

}  // namespace

void add_robot(args::Command& app) {
  args::Command robot = app.add_subcommand("robot", "Poses that the robot sends");
  robot->require_subcommand(1);
  auto options = std::make_shared<Options>();
  args::Command command = robot->add_subcommand(
      "monitor", "Poses of the flange as slabd receives them: rate, age, spread, settled or why not");
  command->footer(
      "\nCompare X, Y, Z, A, B, C with the pendant ($POS_ACT_MES with $BASE and $TOOL at $NULLFRAME): they must be "
      "equal.\n"
      "Runs beside the daemon. Until Ctrl-C; --once until the robot has settled, for 3 s at most.\n"
      "Exit status: 0 poses came, 3 bad configuration, 4 none came.\nExample: slabctl robot monitor --once");
  command->add_option("--config", options->config, "Configuration with [robot]")->default_val(default_config());
  command->add_option("--robot", options->robot, "Id of the robot, on a line with several");
  command->add_option("--seconds", options->seconds, "Stop after this time")->check(within(0.5, 1e6));
  command->add_flag("--once", options->once, "One picture");
  command->add_flag("--json", options->as_json, "Print slabd.robot/1");
  command->runs([options] { return monitor(*options); });
}

}  // namespace slabd::cli
