// SPDX-License-Identifier: Apache-2.0
//
// The monitor ball on scans: taken into use once, checked later, from the same pose of the robot.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

constexpr const char* kFlange = "1782.264 386.092 1082.505 0.235383091 0.971758165 0.008534254 0.014422816";

class MonitorBallTest : public Slabctl {
 protected:
  MonitorBallTest() {
    static_cast<void>(write("slabd.toml",
                            "[scanner]\ndrop_dir = \"drop\"\n[storage]\ndb = \"slabd.db\"\nspool_dir = \"spool\"\n"
                            "[recipes]\ndir = \"" +
                                places::source_dir() +
                                "/recipes\"\n"
                                "[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n"
                                "[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n"
                                "station_sigma_mm = 0.02\nstation_sigma_deg = 0.001\n"
                                "[control]\nsocket = \"control.sock\"\n"));
    static_cast<void>(write("flange.txt", std::string(kFlange) + "\n"));
  }
  /// Draws a scan from kFlange with the ball raised by `up_mm`.
  std::string scan(const std::string& name, double up_mm, const std::string& more = "", int seed = 3) {
    const Ended drawn = run("simulate calibration --kind ball --poses " + file("flange.txt") + " --out " + file(name) +
                            " --T-flange-scanner '0 80 150 1 0 0 0' --robot-sigma-mm 0 --seed " + std::to_string(seed) +
                            " --T-base-target '1800 0 " + std::to_string(500.0 + up_mm) + " 1 0 0 0' " + more);
    EXPECT_EQ(drawn.status, 0) << drawn.err;
    return file(name) + "/view_01.ply";
  }
  Ended calibrate(const std::string& what) { return run("calibrate " + what + " --config " + file("slabd.toml")); }
  Ended check(const std::string& scan_path, const std::string& more = "") {
    return calibrate("check " + scan_path + " --ball --flange '" + kFlange + "' " + more);
  }
  void take_into_use() {
    const Ended taken = calibrate("reference --ball " + scan("first", 0.0) + " --flange '" + kFlange +
                                  "' --radius 25.4 --apply --reason mounted");
    ASSERT_EQ(taken.status, 0) << taken.err;
    expect_mentions(taken.out, "may be found 0.100 mm from there");
  }
};

TEST_F(MonitorBallTest, within_its_limit_passes_a_drift_is_flagged_and_more_fails_in_words) {
  take_into_use();
  const Ended good = check(scan("good", 0.01, "", 4), "--json");
  EXPECT_EQ(good.status, 0) << good.err;
  EXPECT_TRUE(good.err.empty()) << good.err;
  const json told = json::parse(good.out);
  EXPECT_TRUE(told["passed"].get<bool>());
  EXPECT_NEAR(told["off_mm"][2].get<double>(), 0.01, 0.004);
  EXPECT_NEAR(told["off_mm"][0].get<double>(), 0.0, 0.004);

  const Ended near = check(scan("near", 0.09, "", 5));
  EXPECT_EQ(near.status, 0) << near.err;
  expect_mentions(near.err, "nearly the allowed 0.100 mm");

  const Ended drifted = check(scan("drifted", 0.11, "", 6));
  EXPECT_EQ(drifted.status, 6);
  expect_mentions(drifted.out, "FAILED");
  expect_mentions(drifted.err, "allowed are 0.100 mm");
  expect_mentions(drifted.err, "fault 503");
  expect_mentions(drifted.err, "check again from the same pose");
  // The scan that defines the ball's position would always pass.
  const Ended itself = check(file("first") + "/view_01.ply");
  EXPECT_EQ(itself.status, 6) << itself.out;
  expect_mentions(itself.err, "has its place from this scan; a check needs a scan of its own");

  const Ended trend = calibrate("check");
  EXPECT_EQ(trend.status, 0) << trend.err;
  EXPECT_LT(trend.out.find("passed"), trend.out.find("FAILED")) << "oldest first, so that a drift reads downwards\n"
                                                                << trend.out;
  expect_mentions(trend.out, "mm off (");
  const json rows = json::parse(calibrate("check --json").out);
  ASSERT_EQ(rows["checks"].size(), 3U);
  EXPECT_TRUE(rows["monitor_ball"]["failed"].get<bool>());
}

TEST_F(MonitorBallTest, a_ball_that_cannot_be_judged_is_refused_and_no_check) {
  take_into_use();
  const Ended hidden = check(scan("hidden", 0.0, "--hidden 0.6"));
  EXPECT_EQ(hidden.status, 6);
  expect_mentions(hidden.err, "refused (azimuth)");
  expect_mentions(hidden.err, "what to do: ");
  const Ended wrong = check(scan("wrong", 0.0, "--ball-radius-mm 25.2"));
  EXPECT_EQ(wrong.status, 6);
  expect_mentions(wrong.err, "refused (radius)");
  const json rows = json::parse(calibrate("check --json").out);
  EXPECT_TRUE(rows["checks"].empty()) << "nothing was found out about the ball's place";
  EXPECT_FALSE(rows["monitor_ball"]["failed"].get<bool>());
}

TEST_F(MonitorBallTest, another_pose_of_the_robot_is_named) {
  take_into_use();
  const Ended moved = calibrate("check " + scan("good", 0.0, "", 8) + " --ball --flange '1500 200 900 0 1 0 0'");
  EXPECT_EQ(moved.status, 6);
  expect_mentions(moved.err, "look from the same pose");
  expect_mentions(moved.err, "no drift; wrong pose given");
  EXPECT_EQ(calibrate("check " + scan("more", 0.0) + " --ball").status, 2);
  EXPECT_EQ(calibrate("check --ball").status, 2);
  EXPECT_EQ(calibrate("check --live").status, 2);
  const Ended nobody = calibrate("check --ball --live");
  EXPECT_EQ(nobody.status, 4);
  expect_mentions(nobody.err, "is it running");
}

TEST_F(MonitorBallTest, a_radius_that_is_not_the_balls_own_is_refused) {
  take_into_use();
  const std::string drifted = scan("drifted", 0.11, "", 6);
  EXPECT_EQ(check(drifted).status, 6);
  // Another radius moves the ball along the view and could hide its displacement.
  const Ended other = check(scan("again", 0.11, "", 7), "--radius 25.45");
  EXPECT_EQ(other.status, 3) << other.out;
  expect_mentions(other.err, "--radius 25.45");
  expect_mentions(other.err, "was taken into use with 25.4 mm");
  json rows = json::parse(calibrate("check --json").out);
  EXPECT_EQ(rows["checks"].size(), 1U);
  EXPECT_TRUE(rows["monitor_ball"]["failed"].get<bool>());
  EXPECT_EQ(check(scan("good", 0.0, "", 8), "--radius 25.4").status, 0);
}

TEST_F(MonitorBallTest, a_failed_check_is_not_cleared_from_another_pose) {
  take_into_use();
  const std::string there = "1802.264 386.092 1082.505 0.235383091 0.971758165 0.008534254 0.014422816";
  const auto from_there = [&](const std::string& name, int seed) {
    static_cast<void>(write("there.txt", there + "\n"));
    const Ended drawn = run("simulate calibration --kind ball --poses " + file("there.txt") + " --out " + file(name) +
                            " --T-flange-scanner '0 80 150 1 0 0 0' --robot-sigma-mm 0 --seed " + std::to_string(seed) +
                            " --T-base-target '1800 0 500 1 0 0 0'");
    EXPECT_EQ(drawn.status, 0) << drawn.err;
    return calibrate("check " + file(name) + "/view_01.ply --ball --flange '" + there + "' --json");
  };
  const Ended before = from_there("before", 4);
  ASSERT_EQ(before.status, 0) << before.err;
  expect_mentions(before.err, "look from the same pose");
  EXPECT_EQ(json::parse(before.out)["note"], "seen from another pose");
  ASSERT_EQ(check(scan("drifted", 0.11, "", 6)).status, 6);
  const Ended after = from_there("after", 5);
  EXPECT_EQ(after.status, 6) << after.out;
  expect_mentions(after.err, "the last check failed, and this one does not clear it");
  EXPECT_TRUE(json::parse(calibrate("check --json").out)["monitor_ball"]["failed"].get<bool>());
}

TEST_F(MonitorBallTest, a_station_of_a_slab_is_not_a_scan) {
  EXPECT_EQ(calibrate("check " + file("x.ply") + " --recipe " + kRecipe + " --slab 5 --station 3").status, 2);
  const Ended nowhere = calibrate("check --slab 5");
  EXPECT_EQ(nowhere.status, 2);
  expect_mentions(nowhere.err, "--slab needs --station");
}

TEST_F(MonitorBallTest, a_scanner_is_warm_when_the_ball_no_longer_drifts) {
  const auto warm_up = [this](const std::string& name, double up_mm_each, const std::string& more) {
    std::string scans;
    for (int i = 0; i < 7; ++i) scans += scan(name + std::to_string(i), up_mm_each * i, "", 20 + i) + " ";
    return run("scanner warm-up " + scans + "--flange '" + kFlange + "' --radius 25.4 --config " + file("slabd.toml") +
               " --times 0,600,1200,1800,2400,3000,3600 " + more);
  };
  const Ended still = warm_up("still", 0.0, "--json");
  ASSERT_EQ(still.status, 0) << still.err;
  const json document = json::parse(still.out);
  EXPECT_EQ(document["schema"], "slabd.scanner_warm_up/1");
  EXPECT_EQ(document["state"], "stable");
  EXPECT_EQ(document["views"].size(), 7U);
  EXPECT_TRUE(document["check"].is_null()) << "a check needs the line";
  expect_mentions(still.err, "needs 6 views at least");

  const Ended drifting = warm_up("drifting", 0.02, "");
  EXPECT_EQ(drifting.status, 6);
  expect_mentions(drifting.out, "still drifting");
  expect_mentions(drifting.err, "not stable: still drifting");
}

TEST_F(MonitorBallTest, times_of_a_warm_up_must_ascend_and_be_as_many_as_scans) {
  const std::string one = scan("one", 0.0);
  for (const char* times : {"", "0,1", "x", "nan"}) {
    const Ended ended = run("scanner warm-up " + one + " --flange '" + kFlange + "' --radius 25.4 --config " +
                            file("slabd.toml") + " --times '" + times + "'");
    EXPECT_EQ(ended.status, 2) << times;
    expect_mentions(ended.err, "allowed are 1 ascending numbers of seconds");
  }
}

}  // namespace
}  // namespace slabd::cli
