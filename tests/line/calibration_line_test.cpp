// SPDX-License-Identifier: Apache-2.0
//
// Calibrations through the real programs: slabctl changes them while the daemon runs, while it is stopped, and after it
// was killed. The daemon applies and logs them, and refuses slabs if required.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "processes.h"
#include "tests/places/places.h"

namespace slabd::line {
namespace {

using nlohmann::json;

constexpr const char* kReference =
    "id = ref-block-01\ndate = 2026-03-14\nslope_deg = 1.4321\nslope_U_deg = 0.002\n"
    "jaw_distance_mm = 380.0\njaw_distance_U_mm = 0.006\n";

struct CalibrationLineTest : testing::Test {
  Box box;

  json status() {
    const Box::Answer answer = box.slabctl({"status", "--config", box.config.native(), "--json"});
    EXPECT_EQ(answer.exit_status, 0) << answer.err;
    const json j = json::parse(answer.out, nullptr, false);
    EXPECT_TRUE(j.is_object()) << answer.out;
    return j;
  }
  Box::Answer calibrate(std::vector<std::string> args) {
    args.insert(args.begin(), "calibrate");
    args.insert(args.end(), {"--config", box.config.native()});
    return box.slabctl(args);
  }
  void start() {
    box.start();
    ASSERT_TRUE(box.ready()) << read_file(box.dir / "slabd.err");
    // The PLC's port is opened before the control socket, and the calibration is read after both.
    for (int i = 0; i < 3'000; ++i) {
      const Box::Answer answer = box.slabctl({"status", "--config", box.config.native(), "--json"});
      if (answer.exit_status == 0 && json::parse(answer.out)["state"] != "recover") return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    FAIL() << "slabd does not answer: " << read_file(box.dir / "slabd.err");
  }
  Box::Answer adopt(const char* sigma_mm) {
    return calibrate({"adopt", "--sigma-mm", sigma_mm, "--sigma-deg", "0.003", "--operator", "anna", "--apply",
                      "--reason", "tracker protocol 17"});
  }
  std::string id_in_force() { return status()["calibration"]["id"].get<std::string>(); }
};

TEST_F(CalibrationLineTest, is_applied_through_the_running_daemon_and_kept_when_it_is_killed) {
  start();
  EXPECT_EQ(status()["calibration"]["source"], "commissioning");
  const Box::Answer first = adopt("0.05");
  ASSERT_EQ(first.exit_status, 0) << first.err;
  EXPECT_NE(first.out.find("is in force"), std::string::npos) << first.out;
  const std::string id = id_in_force();
  EXPECT_EQ(id.substr(0, 3), "he-");
  EXPECT_EQ(status()["calibration"]["source"], "applied");
  ASSERT_EQ(adopt("0.06").exit_status, 0);
  EXPECT_NE(id_in_force(), id);
  box.kill_hard();
  start();
  EXPECT_EQ(status()["calibration"]["source"], "applied");
  EXPECT_NE(id_in_force(), id);
  const Box::Answer back = calibrate({"rollback", "--reason", "worse"});
  ASSERT_EQ(back.exit_status, 0) << back.err;
  EXPECT_EQ(id_in_force(), id);
  const Box::Answer further = calibrate({"rollback", "--reason", "worse"});
  EXPECT_EQ(further.exit_status, 6);
  EXPECT_NE(further.err.find("nothing to go back to"), std::string::npos) << further.err;

  const json history = json::parse(calibrate({"history", "--json"}).out);
  ASSERT_EQ(history["applied"].size(), 3U);
  EXPECT_EQ(history["applied"][0]["action"], "rollback");
  EXPECT_EQ(history["applied"][2]["why"], "tracker protocol 17");
  EXPECT_EQ(history["applied"][2]["who"].get<std::string>().substr(0, 4), "anna");
}

TEST_F(CalibrationLineTest, is_applied_without_the_daemon_and_found_at_its_start) {
  ASSERT_EQ(adopt("0.05").exit_status, 0);
  start();
  EXPECT_EQ(status()["calibration"]["source"], "applied");
  EXPECT_EQ(status()["fault"]["code"], 0);
}

TEST_F(CalibrationLineTest, the_emulated_scanner_is_where_the_calibration_in_force_places_it) {
  ASSERT_EQ(adopt("0.05").exit_status, 0);
  // From now on the configuration's commissioning value is not used, by slabd or by the emulator. With it, no scan
  // would show the commanded block (204).
  std::string text = read_file(box.config);
  const std::size_t at = text.find("T_flange_scanner");
  text.replace(at, text.find('\n', at) - at, "T_flange_scanner = [40.0, -25.0, 180.0, 0.9961947, 0.0, 0.0871557, 0.0]");
  std::ofstream(box.config) << text;
  start();
  // Without an accuracy of the robot U is unknown, and the verdict indeterminate.
  EXPECT_EQ(box.simulate({"--slab-no", "1"})->wait(), 1);
  const json slabs = json::parse(box.slabctl({"history", "--json", "--config", box.config.native()}).out);
  EXPECT_EQ(slabs["slabs"][0]["verdict"], "indeterminate") << slabs;
  EXPECT_EQ(slabs["slabs"][0]["stations_measured"], 18) << read_file(box.dir / "simulate.out");
}

TEST_F(CalibrationLineTest, an_expired_or_missing_calibration_is_fault_503_with_its_cure) {
  // Removes the commissioning values from the configuration, so that the daemon has no calibration.
  std::string text = read_file(box.config);
  const std::size_t at = text.find("T_flange_scanner");
  text.erase(at, text.find('\n', at) + 1 - at);
  std::ofstream(box.config) << text;
  start();
  const json missing = status();
  EXPECT_EQ(missing["fault"]["code"], 503);
  EXPECT_EQ(missing["state"], "fault");
  EXPECT_NE(missing["fault"]["text"].get<std::string>().find("slabctl calibrate"), std::string::npos);
  EXPECT_EQ(adopt("0.05").exit_status, 3) << "there is nothing to adopt";
}

TEST_F(CalibrationLineTest, a_check_that_fails_stops_the_line_until_one_passes) {
  start();
  ASSERT_EQ(adopt("0.05").exit_status, 0);
  const std::string certificate = (box.dir / "ref.txt").native();
  std::ofstream(certificate) << kReference;
  const Box::Answer taken =
      calibrate({"reference", "--certificate", certificate, "--apply", "--reason", "new reference block"});
  ASSERT_EQ(taken.exit_status, 0) << taken.err;
  json watch = status()["calibration"]["reference_block"];
  EXPECT_EQ(watch["id"].get<std::string>().substr(0, 3), "rb-");
  EXPECT_TRUE(watch["passed"].is_null()) << "not checked yet";
  EXPECT_FALSE(watch["overdue"]);

  const std::string recipe = places::source_dir() + "/recipes/p5600.toml";
  const auto scan = [&](const char* name, const char* defect) {
    const std::string path = (box.dir / name).native();
    std::vector<std::string> args = {"simulate", "scan",    "--recipe",  recipe, "--block", "1",
                                     "--points", "quarter", "--casting", "0",    "--out",   path};
    if (*defect != '\0') args.insert(args.end(), {"--defect", defect});
    const Box::Answer drawn = box.slabctl(args);
    EXPECT_EQ(drawn.exit_status, 0) << drawn.err;
    return path;
  };
  const Box::Answer bad = calibrate({"check", scan("bad.ply", "jaw-distance=1:0.9"), "--recipe", recipe, "--json"});
  EXPECT_EQ(bad.exit_status, 6) << bad.err;
  EXPECT_FALSE(json::parse(bad.out)["passed"].get<bool>());
  EXPECT_EQ(status()["fault"]["code"], 503);
  EXPECT_NE(status()["fault"]["text"].get<std::string>().find("jaw distance is"), std::string::npos);
  // A recipe with wider tolerances is not a recipe of this line.
  std::string generous = read_file(recipe);
  const std::size_t jaw = generous.find("[items.jaw_distance]");
  const std::size_t u = generous.find("U = ", jaw);
  generous.replace(u, generous.find('\n', u) - u, "U = 0.45");
  std::ofstream(box.dir / "generous.toml") << generous;
  const Box::Answer other =
      calibrate({"check", scan("bad2.ply", "jaw-distance=1:0.9"), "--recipe", (box.dir / "generous.toml").native()});
  EXPECT_EQ(other.exit_status, 6);
  EXPECT_NE(other.err.find("check with a recipe of the line"), std::string::npos) << other.err;
  EXPECT_EQ(status()["fault"]["code"], 503);
  const Box::Answer good = calibrate({"check", scan("good.ply", ""), "--recipe", recipe});
  EXPECT_EQ(good.exit_status, 0) << good.err;
  EXPECT_EQ(status()["fault"]["code"], 0);
  const json trend = json::parse(calibrate({"check", "--json"}).out);
  ASSERT_EQ(trend["checks"].size(), 2U);
  EXPECT_TRUE(trend["checks"][0]["passed"].get<bool>());
}

TEST_F(CalibrationLineTest, a_check_by_a_stations_scan_needs_one_made_with_what_is_in_force_and_since_the_last_check) {
  start();
  const std::string certificate = (box.dir / "ref.txt").native();
  std::ofstream(certificate) << kReference;
  ASSERT_EQ(calibrate({"reference", "--certificate", certificate, "--apply", "--reason", "new"}).exit_status, 0);
  const Box::Answer run = box.slabctl({"simulate", "--config", box.config.native(), "--points", "quarter"});
  ASSERT_EQ(run.exit_status, 0) << run.err;
  const auto check = [&](const char* station) { return calibrate({"check", "--slab", "1", "--station", station}); };
  const Box::Answer first = check("1");
  EXPECT_EQ(first.err.find("scan the reference block again"), std::string::npos) << first.err;
  ASSERT_EQ(json::parse(calibrate({"check", "--json"}).out)["checks"].size(), 1U) << first.err << first.out;
  const Box::Answer second = check("2");
  EXPECT_EQ(second.exit_status, 6);
  EXPECT_NE(second.err.find("before the last check"), std::string::npos) << second.err;
  ASSERT_EQ(adopt("0.05").exit_status, 0);
  const Box::Answer third = check("3");
  EXPECT_EQ(third.exit_status, 6);
  EXPECT_NE(third.err.find("was measured with calibration"), std::string::npos) << third.err;
  EXPECT_EQ(json::parse(calibrate({"check", "--json"}).out)["checks"].size(), 1U);
}

TEST_F(CalibrationLineTest, station_corrections_need_a_hand_eye_calibration_in_force) {
  const std::string certificate = (box.dir / "master.txt").native();
  std::ofstream(certificate) << "id = m\ndate = 2026-01-01\nslab_type = 5600\nframe = base\nU_mm = 0.01\n"
                                "seat = 1 0 0 0 0 0 1 0 1 0\n";
  const std::string visits = (box.dir / "visits.txt").native();
  std::ofstream out(visits);
  for (int round = 1; round <= 5; ++round)
    // The flange looks down from 600 mm; the seat is at the origin, 0.3 mm off as measured by the robot.
    out << "visit = 1 \"round " << round << "\" 0 0 600 0 1 0 0  0.3 -80 " << 450.0 + 0.01 * round << "  0.3 -80 "
        << 350.0 + 0.01 * round << "  0.3 -180 " << 450.0 + 0.012 * round << "\n";
  out.close();
  const std::vector<std::string> solve = {"stations", "--certificate", certificate, "--visits",
                                          visits,     "--apply",       "--json"};
  const Box::Answer without = calibrate(solve);
  EXPECT_EQ(without.exit_status, 6);
  EXPECT_NE(without.err.find("no hand-eye calibration is in force"), std::string::npos) << without.err;
  ASSERT_EQ(adopt("0.05").exit_status, 0);
  const Box::Answer with = calibrate(solve);
  ASSERT_EQ(with.exit_status, 0) << with.err << with.out;
  const json solution = json::parse(with.out);
  EXPECT_EQ(solution["status"], "ok");
  EXPECT_TRUE(solution["applied"].get<bool>());
  EXPECT_EQ(solution["stations"][0]["visits"], 5);
  start();
  EXPECT_EQ(status()["calibration"]["stations"][0]["state"], "used");
  ASSERT_EQ(adopt("0.07").exit_status, 0);  // a new hand-eye
  EXPECT_EQ(status()["calibration"]["stations"][0]["state"], "stale");
  const Box::Answer again = calibrate({"stations", "--again", "--apply"});
  EXPECT_EQ(again.exit_status, 0) << again.err;
  EXPECT_EQ(status()["calibration"]["stations"][0]["state"], "used");
}

}  // namespace
}  // namespace slabd::line
