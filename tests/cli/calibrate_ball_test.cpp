// SPDX-License-Identifier: Apache-2.0
//
// simulate calibration, calibrate ball and calibrate artefact, from scan files to the table that solve reads.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "slabctl_process.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

class CalibrateBall : public Slabctl {
 protected:
  /// A set of scans in folder `name`; half a million points each.
  void simulate(const std::string& name, const std::string& options) const {
    const Ended ended = run("simulate calibration --out " + file(name) + " " + options);
    ASSERT_EQ(ended.status, 0) << ended.err;
  }
  [[nodiscard]] json truth_of(const std::string& name) const {
    return json::parse(content(file(name + "/truth.json")), nullptr, false);
  }
};

double distance(const json& a, const json& b) {
  double squares = 0.0;
  for (std::size_t i = 0; i < 3; ++i) squares += std::pow(a[i].get<double>() - b[i].get<double>(), 2);
  return std::sqrt(squares);
}

TEST_F(CalibrateBall, finds_every_ball_of_a_simulated_set_and_solves_with_it) {
  simulate("set", "--views 8 --seed 4 --robot-sigma-mm 0.01");
  const json truth = truth_of("set");
  ASSERT_EQ(truth["schema"], "slabd.calibration_truth/1");
  const Ended found =
      run("calibrate ball " + file("set/view_*.ply") + " --radius 25.4 --json --target " + file("set/target.txt"));
  ASSERT_EQ(found.status, 0) << found.err << found.out;
  const json report = json::parse(found.out, nullptr, false);
  ASSERT_EQ(report["schema"], "slabd.balls/1");
  ASSERT_EQ(report["views"].size(), 8U);
  for (std::size_t i = 0; i < 8; ++i) {
    const json& ball = report["views"][i]["balls"][0];
    EXPECT_LT(distance(ball["centre_mm"], truth["views"][i]["balls_mm"][0]), 0.005);
    EXPECT_EQ(ball["status"], "ok");
    EXPECT_GE(ball["points_used"].get<int>(), 3000);
    EXPECT_NEAR(ball["radius_free_mm"].get<double>(), 25.4, 0.02);
  }
  const Ended solved = run("calibrate solve --kind ball --flange " + file("set/flange.txt") + " --target " +
                           file("set/target.txt") + " --robot-sigma-mm 0.01 --robot-sigma-deg 0.0004 --json");
  ASSERT_EQ(solved.status, 0) << solved.err << solved.out;
  EXPECT_LT(distance(json::parse(solved.out)["T_flange_scanner"], truth["T_flange_scanner"]), 0.3);
}

TEST_F(CalibrateBall, the_number_in_a_scans_name_is_the_views) {
  simulate("set", "--views 2 --seed 5");
  // Order as sorted by the shell, with views missing.
  fs::rename(file("set/view_02.ply"), file("set/view_10.ply"));
  fs::rename(file("set/view_01.ply"), file("set/view_3.ply"));
  const std::string sorted = file("set/view_10.ply") + " " + file("set/view_3.ply");
  const Ended found = run("calibrate ball " + sorted + " --radius 25.4 --target " + file("t"));
  ASSERT_EQ(found.status, 0) << found.err;
  expect_mentions(found.err, "numbered by the names of the scans, not by their order");
  expect_mentions(content(file("t")), "\n10 1 ");
  expect_mentions(content(file("t")), "\n3 1 ");
  fs::rename(file("set/view_3.ply"), file("set/left.ply"));
  const Ended places = run("calibrate ball " + file("set/view_10.ply") + " " + file("set/left.ply") +
                           " --radius 25.4 --target " + file("t"));
  ASSERT_EQ(places.status, 0) << places.err;
  EXPECT_EQ(places.err.find("numbered"), std::string::npos) << places.err;
  expect_mentions(content(file("t")), "\n2 1 ");
}

TEST_F(CalibrateBall, refuses_with_reason_cure_and_status_6) {
  simulate("set", "--views 2 --seed 5");
  const std::string first = file("set/view_01.ply");
  const Ended wrong = run("calibrate ball " + first + " --radius 24.4");
  EXPECT_EQ(wrong.status, 6);
  expect_mentions(wrong.out, "refused: a sphere of radius 25.");
  expect_mentions(wrong.out, "cure:");
  const Ended diameter = run("calibrate ball " + first + " --radius 50.8");
  EXPECT_EQ(diameter.status, 6);
  expect_mentions(diameter.out, "not the diameter");
  simulate("hidden", "--views 1 --seed 5 --hidden 0.5");
  const Ended hidden =
      run("calibrate ball " + first + " " + file("hidden/view_01.ply") + " --radius 25.4 --json --target " + file("t"));
  EXPECT_EQ(hidden.status, 6);
  const json report = json::parse(hidden.out, nullptr, false);
  EXPECT_EQ(report["accepted"], 1);
  EXPECT_EQ(report["views"][1]["refusal"], "azimuth");
  EXPECT_FALSE(report["views"][1]["cure"].get<std::string>().empty());
  // The rejected view is missing in the table and the others keep their numbers.
  expect_mentions(content(file("t")), "labels=view,ball");
  expect_mentions(content(file("t")), "\n1 1 ");
  EXPECT_EQ(content(file("t")).find("\n2 "), std::string::npos);
}

TEST_F(CalibrateBall, a_table_that_is_there_is_replaced_whole_or_stays) {
  simulate("set", "--views 1 --seed 5");
  simulate("frame", "--kind artefact --views 1 --seed 5");
  const std::string ball = "calibrate ball " + file("set/view_01.ply") + " --radius 25.4";
  const std::string artefact =
      "calibrate artefact " + file("frame/view_01.ply") + " --certificate " + file("frame/certificate.txt");
  for (const std::string& command : {ball, artefact}) {
    const std::string target = write("target.txt", "what was there");
    // A hard link to the same file: writing in place would change its content as well.
    fs::remove(file("old.txt"));
    fs::create_hard_link(target, file("old.txt"));
    const Ended found = run(command + " --target " + target);
    ASSERT_EQ(found.status, 0) << found.err << found.out;
    EXPECT_EQ(content(file("old.txt")), "what was there") << command;
    EXPECT_NE(content(target), "what was there") << command;
    const Ended nowhere = run(command + " --target " + file("none/target.txt"));
    EXPECT_EQ(nowhere.status, 4) << command;
    expect_mentions(nowhere.err, "none/target.txt cannot be written: No such file or directory");
  }
}

TEST_F(CalibrateBall, averages_shots_that_agree_and_refuses_those_that_do_not) {
  simulate("set", "--views 2 --shots 3 --seed 6 --robot-sigma-mm 0.05");
  const Ended same = run("calibrate ball " + file("set/view_01_*.ply") + " --radius 25.4 --shots");
  EXPECT_EQ(same.status, 0) << same.out << same.err;
  expect_mentions(same.out, "3 shots scatter by 0.00");
  const Ended other = run("calibrate ball " + file("set/view_01_1.ply") + " " + file("set/view_02_1.ply") +
                          " --radius 25.4 --shots --json");
  EXPECT_EQ(other.status, 6);
  EXPECT_EQ(json::parse(other.out)["shots"]["refusal"], "repeat");
}

TEST_F(CalibrateBall, finds_an_artefact_by_its_certificate) {
  simulate("set", "--kind artefact --views 2 --seed 7");
  const std::string scans = file("set/view_*.ply");
  const Ended found = run("calibrate artefact " + scans + " --certificate " + file("set/certificate.txt") +
                          " --json --target " + file("target.txt"));
  ASSERT_EQ(found.status, 0) << found.err << found.out;
  const json report = json::parse(found.out, nullptr, false);
  const json truth = truth_of("set");
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_LT(distance(report["views"][i]["T_scanner_target"], truth["views"][i]["T_scanner_target"]), 0.006);
    EXPECT_EQ(report["views"][i]["view"]["balls"].size(), 3U);
  }
  const Ended told = run("calibrate artefact " + scans + " --certificate " + file("set/certificate.txt"));
  expect_mentions(told.out, "2 of 2 scans accepted");
  expect_mentions(told.out, "simulated-artefact");

  std::string other = content(file("set/certificate.txt"));
  other.replace(other.rfind("ball = ") + 7, 1, "2");  // another place for the third ball
  const Ended mismatch = run("calibrate artefact " + scans + " --certificate " + write("other.txt", other));
  EXPECT_EQ(mismatch.status, 6) << mismatch.out;
  expect_mentions(mismatch.out, "by the certificate");
  const Ended broken = run("calibrate artefact " + scans + " --certificate " + write("bad.txt", "id = x\nbaal = 1\n"));
  EXPECT_EQ(broken.status, 3);
  expect_mentions(broken.err, "bad.txt:2: unknown key 'baal'");
}

TEST_F(CalibrateBall, names_wrong_usage_and_bad_files) {
  EXPECT_EQ(run("calibrate ball " + file("absent.ply") + " --radius 25.4").status, 3);
  EXPECT_EQ(run("calibrate ball " + write("empty.ply", "") + " --radius 25.4").status, 3);
  EXPECT_EQ(run("calibrate ball x.ply").status, 2);
  EXPECT_EQ(run("calibrate ball x.ply --radius 0").status, 2);
  EXPECT_EQ(run("calibrate artefact x.ply --certificate " + file("absent")).status, 3);
  const Ended block = run("simulate calibration --kind block --out " + file("b"));
  EXPECT_EQ(block.status, 2);
  expect_mentions(block.err, "--recipe");
  // Existing files are not overwritten.
  simulate("set", "--views 1");
  const Ended again = run("simulate calibration --views 1 --out " + file("set"));
  EXPECT_EQ(again.status, 2);
  expect_mentions(again.err, "not empty");
}

TEST_F(CalibrateBall, simulates_a_reference_block_that_can_be_inspected) {
  simulate("set", "--kind block --recipe " + kRecipe + " --views 1 --seed 2 --robot-sigma-mm 0");
  const Ended inspected = run("inspect " + file("set/view_01.ply") + " --recipe " + kRecipe + " --block 3 --json");
  const json report = json::parse(inspected.out, nullptr, false);
  ASSERT_FALSE(report.is_discarded()) << inspected.err;
  EXPECT_EQ(report["registration"]["status"], "converged") << inspected.err;
}

}  // namespace
}  // namespace slabd::cli
