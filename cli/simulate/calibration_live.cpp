// SPDX-License-Identifier: Apache-2.0
//
// One thread drives: it polls for requests, draws the scans, and moves the robot on. It does so shortly after the last
// scan of a view, when the daemon has detected that the robot did not move. The robot publishes in its own thread. A
// client can request views one after the other: a request during a motion waits until the robot has stopped.
#include "cli/simulate/calibration_live.h"

#include <fmt/core.h>

#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "calib/calib.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/simulate/simulate_calibration.h"
#include "emulator/robot_peer.h"
#include "emulator/scan_outlet.h"
#include "emulator/slab_scene.h"

namespace slabd::cli::simulate {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kLookEvery = 5ms;
constexpr auto kFollowEvery = 200ms;
/// Time at rest after a scan. The daemon needs poses from after the scan. It is shorter than the second at rest before
/// a view, so that two views cannot be taken from one pose.
constexpr auto kStandsOn = 600ms;
/// Encoder tremor of a robot held for a calibration; in production it is larger (RobotTraits).
constexpr double kTremor_mm = 0.0008;
/// Height of the target above the slab's centre.
constexpr double kTargetAboveSlab_mm = 200.0;

std::atomic<bool> g_stop{false};
void on_signal(int) {
  g_stop = true;
}

class LiveCell {
 public:
  LiveCell(const CalibrationLiveOrder& order, const CalibrationScene& scene, emulator::ScanOutlet& outlet,
           emulator::RobotPeer& robot, std::vector<Pose> views)
      : order_(order),
        scene_(scene),
        outlet_(outlet),
        robot_(robot),
        views_(std::move(views)),
        standing_at_(views_.front().to_array()) {}

  void run() {
    say_view();
    while (!g_stop) {
      std::string bad;
      if (const std::string name = outlet_.pending(bad); !name.empty()) answer(name);
      if (!bad.empty()) cli::complain(fmt::format("scanner: {}", bad));
      if (goes_on_ && Clock::now() >= goes_on_at_) go_on();
      if (!order_.follow_file.empty()) follow();
      std::this_thread::sleep_for(kLookEvery);
    }
  }

 private:
  void say_view() const {
    if (order_.follow_file.empty())
      fmt::print(stderr, "view {}/{}: the robot arrives in {:.1f} s\n", view_, views_.size(), order_.move_s);
    else
      fmt::print(stderr, "view {}: the robot arrives in {:.1f} s\n", view_, order_.move_s);
  }

  void answer(const std::string& name) {
    const Result<emulator::DrawnScan> drawn =
        scene_.draw(robot_.pose(), view_, order_.scan, xyz_, static_cast<std::uint64_t>(shots_));
    if (!drawn) {
      cli::complain(fmt::format("scanner: {}", drawn.error().text.view()));
      outlet_.give_up(name);
      return;
    }
    const double time_s = std::chrono::duration<double>(Clock::now() - begin_).count();
    emulator::warm(order_.warming, time_s, xyz_);
    Status given =
        outlet_.put(xyz_, drawn.value().width, drawn.value().height, emulator::temperature_c(order_.warming, time_s));
    if (given) given = outlet_.deliver(name);
    if (!given) {
      cli::complain(fmt::format("scanner: {}", given.error().text.view()));
      outlet_.give_up(name);
      return;
    }
    if (++shots_ < order_.shots || !order_.follow_file.empty()) return;
    goes_on_ = true;
    goes_on_at_ = Clock::now() + kStandsOn;
  }

  void go_on() {
    goes_on_ = false;
    if (view_ >= views_.size()) {
      // The number of the shot goes on, so that no scan has the noise of an earlier one.
      if (!all_said_) fmt::print(stderr, "all {} views were scanned; the robot stays at the last one\n", views_.size());
      all_said_ = true;
      return;
    }
    shots_ = 0;
    robot_.move_to(views_[view_]);
    ++view_;
    say_view();
  }

  /// Reads the file of poses. It may be half-written; what cannot be parsed is read again later.
  void follow() {
    if (Clock::now() < look_again_at_) return;
    look_again_at_ = Clock::now() + kFollowEvery;
    const std::optional<std::string> text = text_of(order_.follow_file);
    if (!text || *text == followed_) return;
    followed_ = *text;
    const Result<calib::PoseTable> table = calib::parse_poses(*text, order_.follow_file, calib::TableRole::flange);
    if (!table) return;
    const Pose& next = table.value().poses.back();
    if (next.to_array() == standing_at_) return;
    standing_at_ = next.to_array();
    shots_ = 0;
    ++view_;
    robot_.move_to(next);
    say_view();
  }

  const CalibrationLiveOrder& order_;
  const CalibrationScene& scene_;
  emulator::ScanOutlet& outlet_;
  emulator::RobotPeer& robot_;
  std::vector<Pose> views_;
  std::array<double, 7> standing_at_;
  std::size_t view_ = 1;  ///< number of the robot's visit; the repeatability error is new at each
  int shots_ = 0;
  bool goes_on_ = false;
  bool all_said_ = false;
  Clock::time_point begin_ = Clock::now();
  Clock::time_point goes_on_at_;
  Clock::time_point look_again_at_;
  std::string followed_;
  std::vector<float> xyz_;
};

void catch_signals() {
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

}  // namespace

int run_calibration_live(CalibrationLiveOrder order) {
  const config::Config config = cli::config_from(order.config);
  const config::ArmSettings& arm = config.arm(order.scanner.arm(config));
  if (!order.keep_flange && !arm.calibration.id.empty())
    order.scene.T_flange_scanner = arm.calibration.T_flange_scanner;
  if (!order.keep_target)
    order.scene.T_base_target = config.T_base_slab * Pose{Quat::Identity(), Vec3(0.0, 0.0, kTargetAboveSlab_mm)};
  std::optional<Recipe> recipe;
  if (order.scene.kind == TargetKind::block) {
    recipe = cli::recipe_from(order.recipe);
  }
  const CalibrationScene scene = cli::need(CalibrationScene::make(order.scene, recipe ? &*recipe : nullptr));

  std::vector<Pose> views = scene.plan_views(order.views);
  if (!order.poses_file.empty()) {
    views = cli::need(poses_in(order.poses_file));
  } else if (!order.follow_file.empty()) {
    // The file may not contain a pose yet: the first view is then the plan's.
    const Result<std::vector<Pose>> poses = poses_in(order.follow_file);
    views = {poses.ok() ? poses.value().back() : views.front()};
  }
  if (!order.out_dir.empty()) write_calibration_truth(scene, order.scan, views, order.shots, order.out_dir);

  const auto outlet = cli::need(emulator::open_outlet(arm, hal::ScanFormat::ply));
  emulator::RobotTraits traits;
  traits.lcm_url = arm.robot.url.view();
  traits.channel = arm.robot.channel.view();
  traits.rate_hz = order.rate_hz;
  traits.move_s = order.move_s;
  traits.tremor_mm = kTremor_mm;
  traits.base_id = arm.pose.base_id;
  traits.tool_id = arm.pose.tool_id;
  traits.seed = emulator::derived_seed(order.scene.seed, 23, 0);
  const auto robot = cli::need(emulator::RobotPeer::start(traits, views.front()));
  catch_signals();
  LiveCell(order, scene, *outlet, *robot, std::move(views)).run();
  return cli::kDone;
}

}  // namespace slabd::cli::simulate
