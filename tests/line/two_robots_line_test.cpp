// SPDX-License-Identifier: Apache-2.0
//
// A line with two robots: the real daemon and the emulated line as processes. Robot 1 scans the row Y > 0, robot 2 the
// other row. Scanner 1 delivers files, scanner 2 a stream. Station 10 to 14 may be scanned by both arms: without
// scanner 2 the row then has five seats, which seat_vertical needs.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/base.h"
#include "base/limits.h"
#include "database.h"
#include "processes.h"
#include "storage/storage.h"
#include "tests/places/places.h"
#include "tests/places/ports.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

using Json = nlohmann::json;

struct TwoRobots : testing::Test {
  Box box;
  std::uint16_t stream_port = places::own_port();

  void TearDown() override {
    if (HasFailure()) std::fprintf(stderr, "---- slabd ----\n%s", box.log().c_str());
  }

  /// `commissioning`: the poses of both scanners on their flanges are in the configuration. `scan_s`: the time after
  /// which scanner 2 counts as not answering.
  void write_config(bool commissioning = false, int scan_s = 10) const {
    const std::string lcm = "lcm_url = \"udpm://239.255.77." + std::to_string(box.lcm_port % 250 + 2) + ":" +
                            std::to_string(box.lcm_port) + "?ttl=0\"\ninterface = \"lo\"\n" + kPatientRobot;
    const std::string accuracy = "absolute_sigma_mm = 0.02\nabsolute_sigma_deg = 0.001\n";
    std::ofstream(box.config) << "[plc]\nlisten = \"127.0.0.1:" << box.port << "\"\n"
                              << "[[robot]]\nid = \"1\"\n"
                              << lcm << accuracy << "[[robot]]\nid = \"2\"\nchannel = \"FLANGE_POSE_2\"\n"
                              << lcm << accuracy << "[[scanner]]\nid = \"1\"\ndrop_dir = \""
                              << (box.dir / "drop").native() << "\"\n"
                              << "[[scanner]]\nid = \"2\"\nbackend = \"tcp\"\nlisten = \"127.0.0.1:" << stream_port
                              << "\"\ntimeout_s = " << scan_s << "\n"
                              << (commissioning ? "T_flange_scanner = [0.0, 70.0, 160.0, 1.0, 0.0, 0.0, 0.0]\n" : "")
                              << "[[station]]\nnumbers = \"1..9\"\nrobot = \"1\"\nscanner = \"1\"\n"
                              << "[[station]]\nnumbers = \"10..14\"\nrobot = \"2\"\nscanner = \"2\"\nor = \"1\"\n"
                              << "[[station]]\nnumbers = \"15..18\"\nrobot = \"2\"\nscanner = \"2\"\n"
                              << "[storage]\ndb = \"" << (box.dir / "slabd.db").native() << "\"\nspool_dir = \""
                              << (box.dir / "spool").native() << "\"\n"
                              << "[recipes]\ndir = \"" << places::source_dir() << "/recipes\"\n"
                              << "[cell]\nT_base_slab = [1800.0, 0.0, 300.0, 1.0, 0.0, 0.0, 0.0]\n"
                              << (commissioning ? "[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n" : "")
                              << "[control]\nsocket = \"" << (box.dir / "control.sock").native() << "\"\n";
  }

  /// Stores and applies the hand-eye calibration of each scanner, and the tie: robot 2 faces robot 1. `devices`: also
  /// an acceptance of each scanner, with this name and noise.
  void keep_calibrations(const std::vector<std::pair<std::string, double>>& devices = {}) {
    storage::StoreSettings settings;
    settings.db_path = box.dir / "slabd.db";
    settings.spool_dir = box.dir / "spool";
    settings.arms.list.clear();
    ASSERT_TRUE(settings.arms.list.push(Arm{}));
    ASSERT_TRUE(settings.arms.list.push(Arm{PartId("2"), PartId("2")}));
    auto store = storage::open_store(settings);
    ASSERT_TRUE(store.ok()) << store.error().text.view();
    const auto apply = [&](const storage::CalibrationRecord& record) {
      const Result<std::string> id = store.value()->change(storage::KeepCalibration{record});
      EXPECT_TRUE(id.ok()) << id.error().text.view();
      if (!id.ok()) return std::string();
      const auto done = store.value()->change(storage::ApplyCalibration{id.value(), {"anna", "two robots", 1}});
      EXPECT_TRUE(done.ok()) << done.error().text.view();
      return id.value();
    };
    const auto hand_eye = [&](const char* scanner, const Vec3& place_mm) {
      storage::CalibrationRecord record;
      record.numbers = HandEyeNumbers{Pose{Quat::Identity(), place_mm}, 0.02, rad_from_deg(0.001)};
      record.figures = "{}";
      record.observations = "# none\n";
      record.operator_name = "anna";
      record.software = "test";
      record.created_utime_us = 1;
      record.scanner = scanner;
      return record;
    };
    const std::string first = apply(hand_eye("1", Vec3(0.0, 80.0, 150.0)));
    const std::string second = apply(hand_eye("2", Vec3(0.0, 70.0, 160.0)));
    TieNumbers tie;
    tie.robot = "2";
    tie.T_base_robot = {rotation_from_kuka_abc(kPi, 0.0, 0.0), Vec3(3600.0, 40.0, 5.0)};
    tie.centre_mm = Vec3(1800.0, 0.0, 300.0);
    tie.covariance = Mat6::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      tie.covariance(axis, axis) = 0.02 * 0.02;
      tie.covariance(axis + 3, axis + 3) = 1e-5 * 1e-5;
    }
    tie.targets = 6;
    tie.rms_mm = 0.02;
    storage::CalibrationRecord record = hand_eye("1", Vec3::Zero());
    record.numbers = tie;
    record.parent_id = tie_parent(CalibrationId(first), CalibrationId(second)).view();
    apply(record);
    for (std::size_t arm = 0; arm < devices.size(); ++arm) {
      ScannerNumbers numbers;
      numbers.scanner = std::string_view(devices[arm].first);
      numbers.PF_mm = 0.06 + devices[arm].second;
      numbers.PS_mm = 0.01;
      numbers.RF_mm = 0.1;
      numbers.form_half_mm = 0.02;
      numbers.form_length_mm = 110.0;
      numbers.noise_sigma_mm = devices[arm].second;
      numbers.plates = kPlatePlacesMin;
      numbers.balls = kBallPlacesMin;
      numbers.within_limits = true;
      record = hand_eye(arm == 0 ? "1" : "2", Vec3::Zero());
      record.numbers = numbers;
      apply(record);
    }
  }

  void start() {
    box.start();
    ASSERT_TRUE(box.ready()) << box.log();
    const auto is_open = [this] {
      const Box::Answer answer = box.slabctl({"status", "--config", box.config.native(), "--json"});
      return !box.running() ||
             (answer.exit_status == 0 && Json::parse(answer.out, nullptr, false)["state"] != "recover");
    };
    ASSERT_TRUE(wait_until(is_open)) << box.log();
  }
  Box::Answer simulate(std::vector<std::string> args) {
    std::vector<std::string> all = {"simulate", "--config", box.config.native(), "--points", "quarter", "--json"};
    all.insert(all.end(), args.begin(), args.end());
    return box.slabctl(all);
  }
  Json status() const {
    const Box::Answer answer = box.slabctl({"status", "--config", box.config.native(), "--json"});
    EXPECT_EQ(answer.exit_status, 0) << answer.err;
    return Json::parse(answer.out, nullptr, false);
  }
  [[nodiscard]] std::int64_t count(const std::string& from_where) const {
    return query(box.dir / "slabd.db", "SELECT count(*) FROM " + from_where);
  }
  /// Stops the emulator once `blocks` blocks are measured and none is being measured.
  [[nodiscard]] bool stands_still(const Process& line, std::int64_t blocks) const {
    if (count("block") < blocks) return false;
    line.signal(SIGSTOP);
    if (places::wait_until([&] { return count("attempt WHERE phase = 'acquired'") == 0; }, std::chrono::seconds(5)))
      return true;
    line.signal(SIGCONT);
    return false;
  }
  [[nodiscard]] static bool wait_until(const std::function<bool()>& done) {
    return places::wait_until(done, std::chrono::minutes(5));
  }
};

struct TwoRobotsTest : TwoRobots {
  void SetUp() override {
    write_config();
    keep_calibrations();
    start();
  }
};

TEST_F(TwoRobotsTest, each_robot_scans_its_row_and_the_slab_passes) {
  const Json before = status();
  ASSERT_EQ(before["arms"].size(), 2U);
  EXPECT_EQ(before["arms"][1]["robot"], "2");
  EXPECT_EQ(before["arms"][1]["calibration"]["source"], "applied");
  EXPECT_EQ(before["tie"]["trouble"], "");
  EXPECT_EQ(before["memory"]["inspection_bytes"].get<std::size_t>(), limits::inspection_bytes(2));
  if (!kSanitized) {
    EXPECT_GE(1024 * before["memory"]["rss_kb"].get<std::size_t>(), limits::inspection_bytes(2));
  }

  const Box::Answer answer = simulate({"--slab-no", "1", "--slab-id", "TWO-1"});
  ASSERT_EQ(answer.exit_status, 0) << answer.out << answer.err;
  EXPECT_EQ(count("attempt WHERE phase = 'measured' AND robot = '1' AND scanner = '1' AND station <= 9"), 9);
  EXPECT_EQ(count("attempt WHERE phase = 'measured' AND robot = '2' AND scanner = '2' AND station >= 10"), 9);
  EXPECT_EQ(count("attempt WHERE phase = 'measured'"), 18);
  // On a computer with other work the poses of a robot or a scanner may pause: the attempt is then made again.
  EXPECT_EQ(count("attempt WHERE code NOT IN (0, 202, 203, 302)"), 0);
  EXPECT_LE(count("attempt WHERE phase <> 'measured'"), 4);
  EXPECT_EQ(count("slab WHERE tie_id <> ''"), 1);
  EXPECT_EQ(count("slab_arm WHERE robot = '2' AND scanner = '2'"), 1);
  EXPECT_GT(count("item WHERE id = 'large_jaw_distance' AND budget_tie > 0"), 0) << "items across the tie";
  EXPECT_EQ(count("item WHERE id = 'jaw_distance' AND budget_tie > 0"), 0) << "items of one block are not";
  const Json run = Json::parse(answer.out)["slabs"][0];
  EXPECT_EQ(run["stations"][0]["robot"], "1");
  EXPECT_EQ(run["stations"][17]["robot"], "2");
  if (!kSanitized) {
    EXPECT_LE(1024 * status()["memory"]["peak_kb"].get<std::size_t>(),
              limits::inspection_bytes(2) + limits::kProcessBytes);
  }
  const fs::path report = box.dir / "two.html";
  const Box::Answer printed =
      box.slabctl({"report", "TWO-1", "--full", "--out", report.native(), "--config", box.config.native()});
  EXPECT_EQ(printed.exit_status, 0) << printed.err;
  const std::string html = read_file(report);
  for (const char* words : {"robot 1, scanner 1", "robot 2, scanner 2"})
    EXPECT_NE(html.find(words), std::string::npos) << words;
  std::size_t operators = 0;
  for (std::size_t at = html.find(", anna"); at != std::string::npos; at = html.find(", anna", at + 1)) ++operators;
  EXPECT_GE(operators, 3U) << "both hand-eye calibrations and the tie have date and operator";
  const Box::Answer shown = box.slabctl({"show", "TWO-1", "--config", box.config.native(), "--json"});
  EXPECT_EQ(shown.exit_status, 0) << shown.err;
  EXPECT_EQ(box.slabctl({"db", "check", "--config", box.config.native()}).exit_status, 0) << "its seal holds";
  EXPECT_EQ(box.stop(), 0);
}

TEST_F(TwoRobotsTest, a_robot_that_was_moved_since_the_tie_makes_no_slab_pass) {
  const Box::Answer answer = simulate({"--slab-no", "2", "--tie-error-mm", "6"});
  EXPECT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  EXPECT_EQ(count("slab_result WHERE verdict = 'pass'"), 0);
}

TEST_F(TwoRobotsTest, a_planted_defect_of_the_second_row_fails_its_block) {
  const Box::Answer answer = simulate({"--slab-no", "3", "--defect", "slope=14:1/35"});
  EXPECT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  EXPECT_EQ(count("station_result WHERE verdict = 'fail' AND station = 14"), 1);
  EXPECT_EQ(count("station_result WHERE verdict = 'fail'"), 1);
}

TEST_F(TwoRobots, without_the_second_scanner_its_blocks_are_scanned_by_the_first_robot_or_not_measured) {
  write_config(false, 5);
  keep_calibrations();
  start();
  const Box::Answer answer =
      simulate({"--slab-no", "4", "--fail-scanner", "2@12", "--scans-per-block", "2", "--move-s", "0.1"});
  ASSERT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  EXPECT_EQ(count("slab_result WHERE verdict = 'pass'"), 0);
  EXPECT_EQ(count("slab_result WHERE verdict = 'not_measured'"), 1);
  const Json run = Json::parse(answer.out)["slabs"][0];
  for (int k = 1; k <= 18; ++k) {
    const Json& station = run["stations"][static_cast<std::size_t>(k - 1)];
    EXPECT_EQ(station["verdict"], k <= 14 ? "pass" : "not_measured") << k;
    EXPECT_EQ(station["robot"], k == 10 || k == 11 || k >= 15 ? "2" : "1") << k;
    if (k >= 15) {
      EXPECT_NE(station["trouble"].get<std::string>().find("301"), std::string::npos) << station["trouble"];
    }
  }
  EXPECT_EQ(count("attempt WHERE station IN (12, 13, 14) AND robot = '1' AND phase = 'measured'"), 3);
  EXPECT_EQ(count("block WHERE station >= 15"), 0);
  const Json after = status();
  EXPECT_EQ(after["arms"][0]["scanner_link"]["online"], true);
  EXPECT_EQ(after["arms"][1]["scanner_link"]["online"], false);
  EXPECT_EQ(after["links"]["scanner"]["online"], true) << "the fields of old are those of the first arm";
}

TEST_F(TwoRobotsTest, a_restart_in_mid_slab_keeps_the_scans_of_both_robots) {
  {
    const auto line = box.simulate({"--slab-no", "5", "--slab-id", "KILLED"});
    ASSERT_TRUE(wait_until([&] { return !line->running() || stands_still(*line, 12); }))
        << "twelve blocks were not measured\n"
        << read_file(box.dir / "simulate.err");
    ASSERT_TRUE(line->running()) << read_file(box.dir / "simulate.err");
    box.kill_hard();
    line->signal(SIGCONT);
    line->signal(SIGINT);
    line->wait();
  }
  EXPECT_GE(count("block"), 12);
  EXPECT_EQ(count("slab_result"), 0);
  start();
  const Box::Answer answer = simulate({"--slab-no", "5", "--slab-id", "KILLED"});
  EXPECT_EQ(answer.exit_status, 0) << answer.out << answer.err;
  EXPECT_EQ(count("slab_result WHERE verdict = 'pass'"), 1);
  EXPECT_EQ(count("attempt WHERE phase = 'measured'"), 18) << "acquired scans are not repeated";
  EXPECT_EQ(count("attempt WHERE robot = '1' AND station >= 10"), 0);
  EXPECT_EQ(count("attempt WHERE robot = '2' AND station <= 9"), 0);
}

TEST_F(TwoRobotsTest, stops_are_planned_for_the_stations_of_one_robot) {
  const auto points = [&](const char* scanner) {
    const fs::path module = box.dir / ("PTS" + std::string(scanner));
    const Box::Answer plan = box.slabctl(
        {"stations", "--scanner", scanner, "--krl", module.native(), "--config", box.config.native(), "--json"});
    EXPECT_TRUE(plan.exit_status == 0 || plan.exit_status == 1) << plan.err;
    std::vector<int> stations;
    const Json document = Json::parse(plan.out);
    for (const Json& station : document["stations"]) stations.push_back(station["station"]);
    const std::string list = read_file(module.native() + ".dat");
    for (int k = 1; k <= 18; ++k)
      EXPECT_EQ(list.find("\nSTATION1[" + std::to_string(k) + "]={") != std::string::npos,
                std::find(stations.begin(), stations.end(), k) != stations.end())
          << k;
    return stations;
  };
  EXPECT_EQ(points("1"), (std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14})) << "10 to 14 by `or`";
  EXPECT_EQ(points("2"), (std::vector<int>{10, 11, 12, 13, 14, 15, 16, 17, 18}));
  const Box::Answer taught = box.slabctl(
      {"stations", "--scanner", "2", "--taught", (box.dir / "PTS1.dat").native(), "--config", box.config.native()});
  EXPECT_EQ(taught.exit_status, 3);
  EXPECT_NE(taught.err.find("PTS1.dat: station 15 is missing"), std::string::npos) << taught.err;
}

TEST_F(TwoRobots, one_acceptance_for_two_scanners_is_named) {
  for (const auto& [devices, is_one] :
       {std::pair{std::vector<std::pair<std::string, double>>{{"SN-1", 0.021}, {"SN-2", 0.022}}, false},
        {{{"SN-1", 0.021}, {"SN-1", 0.022}}, true},
        {{{"SN-1", 0.021}, {"SN-2", 0.021}}, true}}) {
    write_config();
    keep_calibrations(devices);
    const Box::Answer doctor =
        box.slabctl({"doctor", "--no-write", "--json", "--listen-s", "0.5", "--config", box.config.native()});
    EXPECT_EQ(doctor.out.find("are acceptances of one device") != std::string::npos, is_one) << doctor.out;
    const Box::Answer history = box.slabctl({"scanner", "history", "--json", "--config", box.config.native()});
    EXPECT_NE(history.out.find("\"scanner_id\": \"2\""), std::string::npos) << history.out;
  }
}

TEST_F(TwoRobotsTest, doctor_and_status_name_each_robot_and_scanner) {
  const Box::Answer doctor =
      box.slabctl({"doctor", "--no-write", "--json", "--listen-s", "0.5", "--config", box.config.native()});
  const Json findings = Json::parse(doctor.out)["findings"];
  const auto has = [&](const std::string& check, const std::string& words) {
    return std::any_of(findings.begin(), findings.end(), [&](const Json& finding) {
      return finding["check"] == check && finding["saw"].get<std::string>().find(words) != std::string::npos;
    });
  };
  EXPECT_TRUE(has("robot poses", "robot 1: none of channel FLANGE_POSE on")) << doctor.out;
  EXPECT_TRUE(has("robot poses", "robot 2: none of channel FLANGE_POSE_2 on")) << doctor.out;
  EXPECT_TRUE(has("scanner link", "scanner 1: ")) << doctor.out;
  EXPECT_TRUE(has("scanner link", "scanner 2: no gateway is connected to 127.0.0.1:")) << doctor.out;
  EXPECT_TRUE(has("calibration", "scanner 2: he-")) << doctor.out;
  EXPECT_TRUE(has("tie", "ti-")) << doctor.out;
  const Box::Answer text = box.slabctl({"status", "--config", box.config.native()});
  for (const char* words : {"robot 1", "robot 2", "scanner 1", "scanner 2", "tie ", "of robot 2"})
    EXPECT_NE(text.out.find(words), std::string::npos) << words << "\n" << text.out;
}

TEST_F(TwoRobots, are_calibrated_and_tied_by_commands) {
  write_config(true);
  start();
  EXPECT_EQ(status()["tie"], nullptr);
  const auto slabctl = [&](std::vector<std::string> args) {
    args.insert(args.end(), {"--config", box.config.native()});
    const Box::Answer answer = box.slabctl(args);
    EXPECT_EQ(answer.exit_status, 0) << args[0] << " " << args[1] << "\n" << answer.out << answer.err;
    return answer;
  };
  for (const char* scanner : {"1", "2"})
    slabctl({"calibrate", "adopt", "--scanner", scanner, "--sigma-mm", "0.02", "--sigma-deg", "0.001", "--operator",
             "anna", "--apply", "--reason", "tracker"});
  const fs::path set = box.dir / "tie";
  const auto table = [&](const char* name) { return (set / name).native(); };
  slabctl({"simulate", "tie", "--out", set.native(), "--views", "8"});
  slabctl({"calibrate",        "tie",
           "--flange1",        table("flange1.txt"),
           "--target1",        table("target1.txt"),
           "--names1",         table("names1.txt"),
           "--flange2",        table("flange2.txt"),
           "--target2",        table("target2.txt"),
           "--names2",         table("names2.txt"),
           "--robot-sigma-mm", "0.03",
           "--operator",       "anna",
           "--store",          "--apply",
           "--reason",         "emulated line"});
  const Json now = status();
  ASSERT_TRUE(now["tie"].is_object()) << now;
  EXPECT_EQ(now["tie"]["robot"], "2");
  EXPECT_EQ(now["tie"]["trouble"], "");
  const Box::Answer slab = simulate({"--slab-no", "1", "--tie-error-mm", "0.03", "--move-s", "0.1"});
  EXPECT_EQ(slab.exit_status, 0) << slab.out << slab.err;

  // Another hand-eye calibration makes the tie stale.
  slabctl({"calibrate", "adopt", "--scanner", "2", "--sigma-mm", "0.03", "--sigma-deg", "0.001", "--operator", "anna",
           "--apply", "--reason", "tracker again"});
  ASSERT_TRUE(wait_until([this] { return status()["tie"]["trouble"] != ""; }));
  const Box::Answer refused = simulate({"--slab-no", "2", "--scans-per-block", "1", "--move-s", "0.1"});
  EXPECT_EQ(refused.exit_status, 1) << refused.out << refused.err;
  EXPECT_EQ(count("attempt WHERE robot = '2' AND slab_key = 2 AND phase = 'measured'"), 0);
}

}  // namespace
}  // namespace slabd::line
