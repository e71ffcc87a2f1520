// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate tie as a process: tables of two robots, figures, refusals, and the record that it stores.
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/prng.h"
#include "calib/calib.h"
#include "cli/client/calibration_change.h"
#include "cli/command.h"
#include "tests/cli/chinese.h"
#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

Pose moved(double x, double y, double z, double turn_deg) {
  Pose pose;
  pose.translation_mm = Vec3(x, y, z);
  pose.rotation = Quat(Eigen::AngleAxisd(rad_from_deg(turn_deg), Eigen::Vector3d::UnitZ()));
  return pose;
}

class CalibrateTie : public Slabctl {
 protected:
  /// Writes the tables of both robots: seven balls, each seen twice from above. `off_mm`: ball 3 for the second robot.
  void write_tables(double off_mm = 0.0, bool on_a_line = false) const {
    Prng prng(7);
    for (std::size_t robot = 0; robot < 2; ++robot) {
      std::vector<Pose> flange;
      std::vector<Pose> target;
      std::string names;
      for (int ball = 0; ball < 7; ++ball) {
        Vec3 p(-2'400.0 + 800.0 * ball, on_a_line ? 1'500.0 : (ball % 2 == 0 ? 900.0 : 2'100.0), 100.0 + 30.0 * ball);
        if (on_a_line) p.z() = 100.0;
        if (robot == 1 && ball == 2) p.x() += off_mm;
        const Vec3 own = robot == 0 ? p : truth_.inverse() * p;
        for (int view = 0; view < 2; ++view) {
          Pose T_base_flange;
          T_base_flange.rotation = Quat(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX())) *
                                   Quat(Eigen::AngleAxisd(0.3 * (prng.uniform() - 0.5), Eigen::Vector3d::UnitY()));
          T_base_flange.translation_mm = own + Vec3(60.0 * view, -50.0, 700.0);
          const Vec3 centre = (T_base_flange * hand_eye_).inverse() * own;
          const auto noise = [&] { return 0.03 * prng.normal(); };
          flange.push_back(T_base_flange);
          target.push_back({Quat::Identity(), centre + Vec3(noise(), noise(), noise())});
          names += "BALL-" + std::string(1, static_cast<char>('A' + ball)) + "\n";
        }
      }
      const std::string n = std::to_string(robot + 1);
      static_cast<void>(write("flange" + n + ".txt", calib::write_poses(flange, {}, calib::TableRole::flange)));
      static_cast<void>(write("target" + n + ".txt", calib::write_poses(target, {}, calib::TableRole::target)));
      static_cast<void>(write("names" + n + ".txt", names));
    }
  }
  [[nodiscard]] std::string tables() const {
    std::string text;
    for (const char* n : {"1", "2"})
      for (const char* table : {"flange", "target", "names"})
        text += std::string(" --") + table + n + " " + file(std::string(table) + n + ".txt");
    return text;
  }
  [[nodiscard]] Ended tie_given(const std::string& more = "") const {
    const std::string pose = " \"0 80 150 1 0 0 0\"";
    return run("calibrate tie" + tables() + " --config " + file("none.toml") + " --hand-eye1" + pose + " --hand-eye2" +
               pose + " " + more);
  }
  /// A line of two robots with commissioning values; the second has the rows of stations 10 to 18.
  void configure() const {
    static_cast<void>(write(
        "slabd.toml",
        "[[robot]]\nid = \"1\"\nchannel = \"POSE_1\"\n[[robot]]\nid = \"2\"\nchannel = \"POSE_2\"\n"
        "[[scanner]]\nid = \"left\"\ndrop_dir = \"drop1\"\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n"
        "[[scanner]]\nid = \"right\"\ndrop_dir = \"drop2\"\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n"
        "[[station]]\nnumbers = \"1..9\"\nrobot = \"1\"\nscanner = \"left\"\n"
        "[[station]]\nnumbers = \"10..18\"\nrobot = \"2\"\nscanner = \"right\"\n"
        "[storage]\ndb = \"slabd.db\"\nspool_dir = \"spool\"\n[recipes]\ndir = \"" +
            places::source_dir() +
            "/recipes\"\n[cell]\nT_base_slab = [0, 1500, 0, 1, 0, 0, 0]\n[control]\nsocket = \"control.sock\"\n"));
  }
  [[nodiscard]] Ended on_line(const std::string& what) const { return run(what + " --config " + file("slabd.toml")); }

  Pose hand_eye_ = moved(0.0, 80.0, 150.0, 0.0);
  Pose truth_ = moved(150.0, 3'020.0, -12.0, 179.5);
};

TEST_F(CalibrateTie, gives_the_base_of_the_second_robot_every_figure_and_status_0) {
  write_tables();
  const Ended ended = tie_given("--json");
  ASSERT_EQ(ended.status, 0) << ended.err << ended.out;
  const json out = json::parse(ended.out);
  EXPECT_EQ(out["schema"], "slabd.tie/1");
  EXPECT_EQ(out["status"], "ok");
  EXPECT_TRUE(out["id"].is_null());
  EXPECT_TRUE(out["reasons"].empty());
  std::array<double, 7> T{};
  for (std::size_t k = 0; k < 7; ++k) T[k] = out["T_base_robot"][k];
  EXPECT_LT((Pose::from_array(T) * Vec3(0, 1'500, 0) - truth_ * Vec3(0, 1'500, 0)).norm(), 0.1);
  ASSERT_EQ(out["targets"].size(), 7U);
  EXPECT_EQ(out["targets"][2]["name"], "BALL-C");
  EXPECT_EQ(out["targets"][2]["views"], json::array({2, 2}));
  EXPECT_EQ(out["covariance"].size(), 6U);
  EXPECT_EQ(out["centre_mm"].size(), 3U);
  for (const char* key : {"residual_mm", "leave_one_out_mm"})
    for (const char* part : {"median", "rms", "max"}) EXPECT_GT(out[key][part].get<double>(), 0.0) << key << part;
  EXPECT_GT(out["s0"].get<double>(), 0.0);
  EXPECT_GT(out["condition"].get<double>(), 1.0);
  EXPECT_TRUE(out["far_end_sigma_mm"].is_null()) << "without a configuration the slab is not known";
  EXPECT_EQ(tie_given("--json").out, ended.out) << "the same files give the same bytes";

  const Ended text = tie_given();
  EXPECT_EQ(text.status, 0);
  for (const char* words : {"BALL-C", "T_base_robot", "4 x 4", "leave-one-out", "sigma of the base"})
    expect_mentions(text.out, words);
  expect_chinese(tie_given("--language zh").out);
}

TEST_F(CalibrateTie, a_ball_that_was_moved_is_named_with_status_6) {
  write_tables(1.5);
  const Ended ended = tie_given("--json");
  EXPECT_EQ(ended.status, 6);
  const json out = json::parse(ended.out);
  EXPECT_EQ(out["status"], "refused");
  EXPECT_EQ(out["reasons"][0]["code"], "target_moved");
  expect_mentions(out["reasons"][0]["text"].get<std::string>(), "BALL-C");
  EXPECT_TRUE(out["T_base_robot"].is_array());
  expect_mentions(tie_given().err, "what to do: see whether that ball moved");
}

TEST_F(CalibrateTie, balls_on_a_line_are_refused) {
  write_tables(0.0, true);
  const Ended ended = tie_given("--json");
  EXPECT_EQ(ended.status, 6);
  const json out = json::parse(ended.out);
  EXPECT_EQ(out["reasons"][0]["code"], "targets_on_a_line");
}

TEST_F(CalibrateTie, options_that_do_not_fit_together_are_wrong_use) {
  write_tables();
  const std::string pose = " \"0 80 150 1 0 0 0\"";
  EXPECT_EQ(run("calibrate tie" + tables() + " --hand-eye1" + pose).status, 2);
  EXPECT_EQ(tie_given("--store").status, 2);
  EXPECT_EQ(tie_given("--apply --reason new").status, 2) << "only a stored tie is put in force";
  EXPECT_EQ(run("calibrate tie --flange1 " + file("flange1.txt")).status, 2);
  static_cast<void>(write("names1.txt", "only one\n"));
  const Ended short_names = tie_given();
  EXPECT_EQ(short_names.status, 3);
  expect_mentions(short_names.err, "names1.txt");
}

TEST_F(CalibrateTie, is_stored_put_in_force_and_rolled_back) {
  write_tables();
  configure();
  const Ended kept = on_line("calibrate tie --json --store --operator anna" + tables());
  ASSERT_EQ(kept.status, 0) << kept.err;
  const json out = json::parse(kept.out);
  const std::string id = out["id"];
  EXPECT_EQ(id.substr(0, 3), "ti-");
  EXPECT_FALSE(out["applied"].get<bool>());
  EXPECT_EQ(out["robots"], json::array({"1", "2"}));
  EXPECT_EQ(out["hand_eye_ids"][0].get<std::string>().substr(0, 14), "commissioning-");
  EXPECT_GT(out["far_end_sigma_mm"].get<double>(), 0.0);
  const Ended applied = on_line("calibrate apply " + id + " --reason first");
  EXPECT_EQ(applied.status, 0) << applied.err;
  const json history = json::parse(on_line("calibrate history --json").out);
  EXPECT_EQ(history["applied"][0]["kind"], "tie");
  EXPECT_EQ(history["applied"][0]["id"], id);
  EXPECT_EQ(history["records"][0]["parent"].get<std::string>(),
            out["hand_eye_ids"][0].get<std::string>() + "+" + out["hand_eye_ids"][1].get<std::string>());

  write_tables(0.05);
  const json second =
      json::parse(on_line("calibrate tie --json --store --apply --reason better --operator anna" + tables()).out);
  EXPECT_TRUE(second["applied"].get<bool>());
  EXPECT_NE(second["id"], id);
  const Ended back = on_line("calibrate rollback --kind tie --reason worse --json");
  ASSERT_EQ(back.status, 0) << back.err;
  EXPECT_EQ(json::parse(back.out)["id"], id);
}

TEST_F(CalibrateTie, a_line_with_two_scanners_needs_the_name_of_one) {
  configure();
  const Ended unnamed = on_line("calibrate adopt --sigma-mm 0.05 --sigma-deg 0.003 --apply");
  EXPECT_EQ(unnamed.status, 2);
  expect_mentions(unnamed.err, "left, right");
  const Ended unknown = on_line("calibrate adopt --scanner middle --sigma-mm 0.05 --sigma-deg 0.003 --apply");
  EXPECT_EQ(unknown.status, 2);
  expect_mentions(unknown.err, "left, right");
  ASSERT_EQ(on_line("calibrate adopt --scanner right --sigma-mm 0.05 --sigma-deg 0.003 --apply").status, 0);
  const json history = json::parse(on_line("calibrate history --json").out);
  ASSERT_EQ(history["applied"].size(), 1U);
  EXPECT_EQ(history["applied"][0]["scanner"], "right");
  // The tie of before belongs to the commissioning values of both.
  write_tables();
  const json tie = json::parse(on_line("calibrate tie --json --store --operator anna" + tables()).out);
  EXPECT_EQ(tie["hand_eye_ids"][1].get<std::string>().substr(0, 3), "he-");
}

TEST_F(CalibrateTie, the_mastered_slab_is_placed_by_the_stations_of_both_robots_only) {
  configure();
  ASSERT_EQ(on_line("calibrate adopt --scanner right --sigma-mm 0.05 --sigma-deg 0.003 --apply").status, 0);
  const std::string master =
      write("master.txt",
            "id = m\ndate = 2026-01-01\nslab_type = 5600\nframe = slab\nU_mm = 0.01\ntemperature_c = 21\n"
            "seat = 1 0 0 0 0 0 1 0 1 0\nseat = 2 1000 0 0 0 0 1 0 1 0\nseat = 3 1000 900 0 0 0 1 0 1 0\n");
  const std::string visits =
      write("visits.txt", "visit = 1 \"round 1\" 0 0 600 0 1 0 0  0 -80 450  0 -80 350  0 -180 450\n");
  const Ended refused =
      on_line("calibrate stations --scanner right --certificate " + master + " --visits " + visits + " --apply");
  EXPECT_EQ(refused.status, 6) << refused.err;
  expect_mentions(refused.err, "give the same slabs, scanned by both, again for each scanner");
}

TEST_F(CalibrateTie, the_trend_of_a_scanner_consists_of_its_own_checks) {
  configure();
  config::Config config;
  ASSERT_TRUE(config_from(file("slabd.toml"), config));
  std::map<std::string, std::string> ids;
  for (const char* scanner : {"left", "right"}) {
    storage::CalibrationRecord ball;
    ball.numbers = MonitorBall{Vec3(1'000.0, 200.0, 300.0), 19.05, 0.1};
    ball.scanner = scanner;
    ball.operator_name = "anna";
    ball.created_utime_us = wall_clock_us();
    ball.observations = scanner;
    const auto kept = change_calibration(config, storage::KeepCalibration{ball});
    ASSERT_TRUE(kept.ok()) << kept.error().text.view();
    ids[scanner] = kept.value().id;
    CalibrationCheck check;
    check.kind = CalibrationKind::monitor_ball;
    check.reference_id.assign(kept.value().id);
    check.passed = true;
    check.off_mm = Vec3::Zero();
    check.utime_us = wall_clock_us();
    check.who = "anna";
    check.source = scanner;
    const auto checked = change_calibration(config, storage::KeepCheck{check});
    ASSERT_TRUE(checked.ok()) << checked.error().text.view();
  }
  for (const auto& [scanner, id] : ids) {
    const Ended ended = on_line("calibrate check --scanner " + scanner + " --json");
    ASSERT_EQ(ended.status, 0) << ended.err;
    const json checks = json::parse(ended.out)["checks"];
    ASSERT_EQ(checks.size(), 1U) << ended.out;
    EXPECT_EQ(checks[0]["reference_id"], id);
  }
}

TEST_F(CalibrateTie, a_line_with_one_robot_has_nothing_to_tie) {
  write_tables();
  static_cast<void>(write("slabd.toml",
                          "[scanner]\ndrop_dir = \"drop\"\n[storage]\ndb = \"slabd.db\"\nspool_dir = "
                          "\"spool\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n"
                          "[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n"));
  const Ended ended = on_line("calibrate tie" + tables());
  EXPECT_EQ(ended.status, 3);
  expect_mentions(ended.err, "one robot");
}

}  // namespace
}  // namespace slabd::cli
