// SPDX-License-Identifier: Apache-2.0
//
// Views for a calibration from a real daemon: `slabctl simulate calibration --live` emulates robot and scanner in front
// of a ball, and a session takes views as slabctl does.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <thread>

#include "cli/client/live_capture.h"
#include "hal/hal.h"
#include "processes.h"
#include "tests/places/places.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

using cli::LiveCapture;
using cli::LiveShot;
using nlohmann::json;

class CaptureLineTest : public testing::Test {
 protected:
  json status() {
    const Box::Answer answer = box_.slabctl({"status", "--config", box_.config.native(), "--json"});
    if (answer.exit_status != 0) return nullptr;
    return json::parse(answer.out, nullptr, false);
  }
  void start() {
    box_.start();
    ASSERT_TRUE(box_.ready()) << box_.log();
    for (int i = 0; i < 3'000; ++i) {
      const json now = status();
      if (now.is_object() && now["state"] != "recover") return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    FAIL() << "slabd does not answer: " << box_.log();
  }
  std::unique_ptr<Process> emulate() const {
    return std::make_unique<Process>(
        std::vector<std::string>{places::slabctl(), "simulate", "calibration", "--live", "--kind", "ball", "--views",
                                 "12", "--shots", "1", "--move-s", "0.2", "--config", box_.config.native(), "--out",
                                 (box_.dir / "truth").native()},
        box_.dir / "cell.out", box_.dir / "cell.err");
  }
  Result<LiveCapture> begin(const std::string& session = "spring") const {
    return LiveCapture::begin((box_.dir / "control.sock").native(), {session, "anna", 60, false});
  }
  /// Takes a view, again if the robot moved or its poses paused: on a computer with other work a pause of 0.25 s breaks
  /// a view, and the emulated robot goes on 0.6 s after its scan although slabd may not have seen the end yet. `shots`
  /// counts the views that were begun.
  static Result<LiveShot> shoot(LiveCapture& line, std::uint32_t& shots,
                                const std::function<void(std::string_view)>& said = {}) {
    constexpr int kTries = 8;
    for (int i = 1;; ++i) {
      ++shots;
      Result<LiveShot> shot = line.shoot(said);
      if (shot.ok() || i == kTries) return shot;
      const Code code = shot.error().code;
      if (code != Code::pose_stale && code != Code::moved_during_scan && code != Code::not_settled) return shot;
    }
  }
  /// Runs `slabctl calibrate capture` for one view until `done`, at most eight times, for the same reason.
  template <typename Done>
  Box::Answer capture_until(const Done& done) const {
    Box::Answer answer;
    for (int i = 0; i < 8; ++i) {
      answer = calibrate({"capture", "--live", "--shots", "1"});
      if (done(answer)) break;
    }
    return answer;
  }
  /// Runs `slabctl calibrate` with its own session "spring".
  Box::Answer calibrate(std::vector<std::string> words) const {
    ::setenv("XDG_STATE_HOME", (box_.dir / "state").c_str(), 1);
    words.insert(words.begin(), "calibrate");
    words.insert(words.end(), {"--config", box_.config.native()});
    return box_.slabctl(words);
  }
  void new_session() const {
    const Box::Answer begun = calibrate({"new", "spring", "--radius", "25.4"});
    ASSERT_EQ(begun.exit_status, 0) << begun.err;
  }
  /// Waits until the emulator has started.
  void wait_for_poses() {
    for (int i = 0; i < 3'000; ++i) {
      const json now = status();
      if (now.is_object() && now["links"]["pose"]["ok"].get<bool>()) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    FAIL() << "no poses: " << read_file(box_.dir / "cell.err");
  }

  /// Number of the planned view that the emulated robot stands at or moves to, from 1.
  [[nodiscard]] std::size_t robots_view() const {
    const std::string text = read_file(box_.dir / "cell.err");
    std::size_t count = 0;
    for (std::size_t at = 0; (at = text.find(": the robot arrives", at)) != std::string::npos; ++at) ++count;
    return count;
  }

  /// Waits for the deletion by the storage thread, which happens when it is idle.
  static bool is_gone(std::string_view path) {
    for (int i = 0; i < 3'000 && fs::exists(path); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return !fs::exists(path);
  }

  Box box_;
};

TEST_F(CaptureLineTest, views_are_taken_one_after_the_other_and_given_to_the_session) {
  start();
  const auto cell = emulate();
  wait_for_poses();
  Result<LiveCapture> capture = begin();
  ASSERT_TRUE(capture.ok()) << capture.error().text.view();
  EXPECT_TRUE(capture.value().warnings().empty()) << capture.value().warnings().front();
  EXPECT_EQ(status()["state"], "maintenance");
  EXPECT_EQ(status()["maintenance"]["operator"], "anna");
  const Result<LiveCapture> other = begin("autumn");
  ASSERT_FALSE(other.ok());
  EXPECT_EQ(other.error().code, Code::busy);

  const json truth = json::parse(read_file(box_.dir / "truth" / "truth.json"));
  std::vector<std::string> said;
  std::uint32_t shots = 0;
  for (int i = 0; i < 3; ++i) {
    const std::size_t begun_at = robots_view();
    const Result<LiveShot> shot =
        shoot(capture.value(), shots, [&](std::string_view text) { said.emplace_back(text); });
    ASSERT_TRUE(shot.ok()) << shot.error().text.view();
    const std::size_t taken_at = robots_view();
    const LiveShot& view = shot.value();
    EXPECT_EQ(view.number, shots) << "those that were refused count";
    EXPECT_GE(view.window_s, 1.0);
    EXPECT_LT(view.spread_mm, 0.01);
    EXPECT_EQ(view.pose_samples, static_cast<std::uint32_t>(view.last_seq - view.first_seq + 1));
    EXPECT_GE(view.last_utime_us, view.scan_utime_us - 50'000) << "poses of after the scan";
    EXPECT_GE(view.requested_utime_us - view.first_utime_us, 950'000) << "a second of them before it";
    // A refused view may have been scanned, and the robot has then gone on.
    double off_mm = std::numeric_limits<double>::infinity();
    std::size_t planned_at = 0;
    for (std::size_t k = 0; k < truth["views"].size(); ++k) {
      const auto planned = truth["views"][k]["T_base_flange_reported"].get<std::vector<double>>();
      const Vec3 off = view.T_base_flange.translation_mm - Vec3(planned[0], planned[1], planned[2]);
      if (off.norm() >= off_mm) continue;
      off_mm = off.norm();
      planned_at = k;
    }
    EXPECT_LT(off_mm, 0.001) << "the mean of the view that the robot stood at";
    EXPECT_GE(planned_at + 1, begun_at) << "not of a view before it";
    EXPECT_LE(planned_at + 1, taken_at);
    std::vector<float> xyz(3 * 600'000);
    const auto read = hal::read_scan(view.scan_path.c_str(), hal::LengthUnit::mm, std::span(xyz));
    ASSERT_TRUE(read.ok()) << read.error().text.view();
    EXPECT_EQ(read.value().finite, view.points);
    ASSERT_TRUE(capture.value().release(view.scan_path).ok());
    EXPECT_TRUE(is_gone(view.scan_path));
    ASSERT_TRUE(places::wait_until([&] { return robots_view() > planned_at + 1; })) << "the robot does not go on";
  }
  EXPECT_FALSE(said.empty());
  ASSERT_TRUE(capture.value().end().ok());
  EXPECT_EQ(status()["state"], "idle");
  const Result<LiveShot> late = capture.value().shoot({});
  ASSERT_FALSE(late.ok());
  EXPECT_EQ(late.error().code, Code::wrong_slab);
}

TEST_F(CaptureLineTest, ending_a_session_that_was_never_begun_begins_none) {
  start();
  new_session();
  const auto end = [&] { return calibrate({"capture", "--live", "--end"}); };
  Box::Answer answer = end();
  EXPECT_EQ(answer.exit_status, 0) << answer.err;
  EXPECT_NE(answer.out.find("it does not hold the line any more"), std::string::npos) << answer.out;
  EXPECT_EQ(box_.log().find("maintenance"), std::string::npos) << box_.log();
  {
    const Result<LiveCapture> other = begin("autumn");
    ASSERT_TRUE(other.ok()) << other.error().text.view();
    answer = end();
    EXPECT_EQ(answer.exit_status, 0) << answer.err;
    EXPECT_NE(answer.out.find("\"autumn\" of anna does"), std::string::npos) << answer.out;
    EXPECT_EQ(status()["maintenance"]["session"], "autumn");
  }
  ASSERT_TRUE(LiveCapture::end((box_.dir / "control.sock").native(), "autumn").ok());
  ASSERT_TRUE(begin("spring").ok());
  answer = end();
  EXPECT_EQ(answer.exit_status, 0) << answer.err;
  EXPECT_EQ(status()["state"], "idle");
  box_.kill_hard();
  answer = end();
  EXPECT_EQ(answer.exit_status, 4) << answer.err;
}

TEST_F(CaptureLineTest, a_line_that_another_session_has_is_taken_over_when_asked_for) {
  start();
  new_session();
  ASSERT_TRUE(begin("autumn").ok());
  const Box::Answer refused = calibrate({"capture", "--live"});
  EXPECT_EQ(refused.exit_status, 4) << refused.err;
  EXPECT_NE(refused.err.find("--take-over"), std::string::npos) << refused.err;
  EXPECT_EQ(status()["maintenance"]["session"], "autumn");
  static_cast<void>(calibrate({"capture", "--live", "--take-over", "--shots", "1"}));  // views fail without the robot
  EXPECT_EQ(status()["maintenance"]["session"], "spring");
}

TEST_F(CaptureLineTest, a_view_that_the_session_could_not_copy_stays_with_the_daemon) {
  start();
  new_session();
  const auto cell = emulate();
  wait_for_poses();
  // Like a disk without space: a folder cannot be made inside a file.
  fs::remove_all(box_.dir / "calibration" / "spring" / "views");
  std::ofstream(box_.dir / "calibration" / "spring" / "views") << "full";
  const Box::Answer answer =
      capture_until([](const Box::Answer& seen) { return seen.err.find("kept for a week: ") != std::string::npos; });
  EXPECT_EQ(answer.exit_status, 4) << answer.out << answer.err;
  const std::size_t at = answer.err.find("kept for a week: ");
  ASSERT_NE(at, std::string::npos) << answer.err;
  const std::string scan = answer.err.substr(at + 17, answer.err.find(',', at) - at - 17);
  EXPECT_TRUE(fs::exists(scan)) << scan;
  // Scans of a session that has its copy are deleted.
  fs::remove(box_.dir / "calibration" / "spring" / "views");
  fs::create_directory(box_.dir / "calibration" / "spring" / "views");
  const Box::Answer copied = capture_until([](const Box::Answer& seen) { return seen.exit_status == 0; });
  EXPECT_EQ(copied.exit_status, 0) << copied.out << copied.err;
  std::size_t left = 0;
  for (int i = 0; i < 3'000; ++i) {
    left = static_cast<std::size_t>(
        std::distance(fs::directory_iterator(fs::path(scan).parent_path()), fs::directory_iterator()));
    if (left == 1) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_EQ(left, 1U) << "the one that was kept";
}

TEST_F(CaptureLineTest, a_cold_scanner_is_watched_until_it_no_longer_drifts) {
  // Quick instead of realistic: in twelve seconds no slope is certain to less than some hundred um an hour.
  std::ofstream(box_.config, std::ios::app)
      << "\n[scanner.warm_up]\nviews = 6\nwindow_min = 0.1\nevery_s = 1\ncentre_um_per_h = 5000\n"
         "radius_um_per_h = 5000\ngive_up_min = 3\n";
  start();
  const Process cell({places::slabctl(), "simulate", "calibration", "--live", "--kind", "ball", "--views", "1",
                      "--shots", "1", "--warm-up-s", "10", "--warm-up-K", "40", "--config", box_.config.native()},
                     box_.dir / "cell.out", box_.dir / "cell.err");
  wait_for_poses();
  const Box::Answer warm =
      box_.slabctl({"scanner", "warm-up", "--live", "--radius", "25.4", "--json", "--config", box_.config.native()});
  ASSERT_EQ(warm.exit_status, 0) << warm.err;
  const json document = json::parse(warm.out);
  EXPECT_EQ(document["state"], "stable");
  const json& views = document["views"];
  ASSERT_GE(views.size(), 6U);
  EXPECT_LT(views.front()["temperature_c"].get<double>(), views.back()["temperature_c"].get<double>());
  EXPECT_GT(views.front()["radius_mm"].get<double>(), views.back()["radius_mm"].get<double>())
      << "a cold frame takes the ball for larger than it is";
  EXPECT_TRUE(document["check"].is_null()) << "no monitor ball is in force";
  EXPECT_NE(warm.err.find("still drifting"), std::string::npos) << warm.err;
  const json now = status();
  EXPECT_EQ(now["state"], "idle") << "the line is free again";
  EXPECT_TRUE(now["scanner_temperature_c"].is_number());
}

TEST_F(CaptureLineTest, a_daemon_that_was_killed_starts_idle_and_a_missing_robot_is_named) {
  start();
  {
    const auto cell = emulate();
    wait_for_poses();
    Result<LiveCapture> capture = begin();
    ASSERT_TRUE(capture.ok()) << capture.error().text.view();
    std::uint32_t shots = 0;
    const Result<LiveShot> shot = shoot(capture.value(), shots);
    ASSERT_TRUE(shot.ok()) << shot.error().text.view();
    box_.kill_hard();
    EXPECT_EQ(capture.value().keep().error().code, Code::scanner_offline);
    start();
    EXPECT_EQ(status()["state"], "idle");
    EXPECT_TRUE(fs::exists(shot.value().scan_path)) << "until the session has it";
    EXPECT_EQ(capture.value().keep().error().code, Code::wrong_slab);
    ASSERT_TRUE(capture.value().release(shot.value().scan_path).ok());
    EXPECT_TRUE(is_gone(shot.value().scan_path));
  }
  Result<LiveCapture> capture = begin();
  ASSERT_TRUE(capture.ok()) << capture.error().text.view();
  const Result<LiveShot> shot = capture.value().shoot({});
  ASSERT_FALSE(shot.ok());
  EXPECT_TRUE(shot.error().code == Code::no_pose || shot.error().code == Code::pose_stale) << shot.error().text.view();
}

}  // namespace
}  // namespace slabd::line
