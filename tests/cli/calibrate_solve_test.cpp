// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate solve as a process: input files, figures, reasons for rejection and exit status.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <tuple>

#include "calib/calib.h"
#include "tests/calib/hand_eye_scene.h"
#include "tests/cli/chinese.h"
#include "tests/cli/slabctl_process.h"

namespace slabd::cli {
namespace {

using calib::ArtefactKind;
using calib::PoseFormat;
using calib::RotationForm;
using calib::TableRole;
using calib::scene::make;
using calib::scene::Plan;
using calib::scene::Set;
using nlohmann::json;

class CalibrateSolve : public Slabctl {
 protected:
  void write_tables(ArtefactKind kind, const Set& set, const PoseFormat& flange = {}) const {
    std::vector<Pose> A, B;
    for (const calib::View& view : set.views) {
      A.push_back(view.T_base_flange);
      B.push_back(kind == ArtefactKind::pose ? view.T_scanner_target : Pose{Quat::Identity(), view.balls[0].centre_mm});
    }
    std::ignore = write("flange.txt", write_poses(A, flange, TableRole::flange));
    std::ignore = write("target.txt", write_poses(B, {}, TableRole::target));
  }
  [[nodiscard]] Ended solve(ArtefactKind kind, const std::string& more = "") const {
    return run("calibrate solve --kind " + std::string(name(kind)) + " --flange " + file("flange.txt") + " --target " +
               file("target.txt") + " " + more);
  }
};

TEST_F(CalibrateSolve, gives_x_every_figure_and_status_0) {
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose}) {
    const Set set = make(kind, {}, 1);
    write_tables(kind, set);
    const Ended ended = solve(kind, "--json");
    ASSERT_EQ(ended.status, 0) << ended.err << ended.out;
    const json out = json::parse(ended.out);
    EXPECT_EQ(out["schema"], "slabd.hand_eye/1");
    EXPECT_EQ(out["status"], "ok");
    EXPECT_TRUE(out["reasons"].empty());
    std::array<double, 7> X{};
    for (std::size_t k = 0; k < 7; ++k) X[k] = out["T_flange_scanner"][k];
    EXPECT_LT(calib::scene::point_error_mm(Pose::from_array(X), set.T_flange_scanner), 0.3);
    EXPECT_EQ(out["target"].size(), kind == ArtefactKind::ball ? 3U : 7U);
    for (const char* key : {"residual_mm", "leave_one_out_mm"})
      for (const char* part : {"median", "rms", "max"}) EXPECT_GT(out[key][part].get<double>(), 0.0) << key << part;
    EXPECT_EQ(out["residual_deg"]["rms"].is_null(), kind == ArtefactKind::ball);
    for (const char* key : {"s0", "condition", "rotation_spread_deg", "predicted_point_sigma_mm"})
      EXPECT_GT(out[key].get<double>(), 0.0) << key;
    EXPECT_TRUE(out["rejected"].empty());
    EXPECT_EQ(out["covariance"].size(), 6U);

    const Ended text = solve(kind);
    EXPECT_EQ(text.status, 0);
    expect_mentions(text.out, "maps scanner coordinates to flange coordinates");
    for (const char* words : {"4 x 4", "x y z qw qx qy qz", "KUKA", "leave-one-out", "predicted point error", "k = 2",
                              "worst view", "accepted"})
      expect_mentions(text.out, words);
    EXPECT_EQ(text.err, "");
  }
}

TEST_F(CalibrateSolve, same_files_same_bytes) {
  write_tables(ArtefactKind::pose, make(ArtefactKind::pose, {}, 2));
  EXPECT_EQ(solve(ArtefactKind::pose, "--json").out, solve(ArtefactKind::pose, "--json").out);
}

TEST_F(CalibrateSolve, kuka_angles_and_other_declared_forms_give_the_same_x) {
  const Set set = make(ArtefactKind::ball, {}, 3);
  write_tables(ArtefactKind::ball, set);
  const json neutral = json::parse(solve(ArtefactKind::ball, "--json").out);
  PoseFormat kuka;
  kuka.rotation = RotationForm::kuka_abc;
  PoseFormat inverse_metres;
  inverse_metres.rotation = RotationForm::quaternion_xyzw;
  inverse_metres.metres = inverse_metres.inverse = true;
  for (const PoseFormat& format : {kuka, inverse_metres}) {
    write_tables(ArtefactKind::ball, set, format);
    const Ended ended = solve(ArtefactKind::ball, "--json");
    ASSERT_EQ(ended.status, 0) << ended.err;
    const json other = json::parse(ended.out);
    for (std::size_t k = 0; k < 7; ++k)
      EXPECT_NEAR(other["T_flange_scanner"][k].get<double>(), neutral["T_flange_scanner"][k].get<double>(), 1e-6);
  }
}

TEST_F(CalibrateSolve, refused_is_status_6_with_figures_reason_and_cure) {
  Plan plan;
  plan.tilt_deg = plan.roll_deg = 3.0;
  write_tables(ArtefactKind::ball, make(ArtefactKind::ball, plan, 1));
  const Ended ended = solve(ArtefactKind::ball, "--json");
  EXPECT_EQ(ended.status, 6);
  const json out = json::parse(ended.out);
  EXPECT_EQ(out["status"], "refused");
  EXPECT_EQ(out["reasons"][0]["code"], "rotation_too_small");
  EXPECT_FALSE(out["reasons"][0]["cure"].get<std::string>().empty());
  EXPECT_TRUE(out["predicted_point_sigma_mm"].is_number());
  EXPECT_TRUE(out["T_flange_scanner"].is_array());
  const Ended text = solve(ArtefactKind::ball);
  EXPECT_EQ(text.status, 6);
  expect_mentions(text.out, "REFUSED");
  expect_mentions(text.out, "cure: use larger tilts");
  const Ended chinese = solve(ArtefactKind::ball, "--language zh");
  expect_chinese(chinese.out);
  expect_mentions(chinese.out, "处理：加大倾斜，向六个以上方向倾斜 20°～35°");

  plan = {};
  plan.fov_mm = plan.depth_half_mm = 0.0;
  write_tables(ArtefactKind::ball, make(ArtefactKind::ball, plan, 1));
  const Ended lost = solve(ArtefactKind::ball, "--json");
  EXPECT_EQ(lost.status, 6);
  const json nothing = json::parse(lost.out);
  EXPECT_EQ(nothing["reasons"][0]["code"], "ball_in_one_place");
  EXPECT_TRUE(nothing["T_flange_scanner"].is_null());
  EXPECT_TRUE(nothing["predicted_point_sigma_mm"].is_null());
  EXPECT_TRUE(nothing["residual_mm"]["rms"].is_number());
  EXPECT_TRUE(nothing["condition"].is_number());
  expect_mentions(solve(ArtefactKind::ball).out, "not determined");
}

TEST_F(CalibrateSolve, causes_are_named_with_a_cure_that_fits_the_files) {
  const auto reason = [&](ArtefactKind kind) {
    const Ended ended = solve(kind, "--json");
    EXPECT_EQ(ended.status, 6) << ended.err;
    return json::parse(ended.out)["reasons"][0];
  };
  const auto words = [](const json& value) { return value.get<std::string>(); };
  const Set set = make(ArtefactKind::ball, {}, 6);

  Set mirrored = set;
  for (calib::View& view : mirrored.views) view.balls[0].centre_mm.x() *= -1.0;
  write_tables(ArtefactKind::ball, mirrored);
  EXPECT_EQ(reason(ArtefactKind::ball)["code"], "handedness");
  expect_mentions(words(reason(ArtefactKind::ball)["text"]), "the scanner's x axis is mirrored");

  Set constant = set;
  for (calib::View& view : constant.views) view.balls[0].centre_mm = Vec3(10.0, 20.0, 600.0);
  write_tables(ArtefactKind::ball, constant);
  EXPECT_EQ(reason(ArtefactKind::ball)["code"], "same_target");
  expect_mentions(words(reason(ArtefactKind::ball)["text"]), "the target is the same in 15 views");

  Set longer = set;
  for (calib::View& view : longer.views) view.balls[0].centre_mm *= 1.015;
  write_tables(ArtefactKind::ball, longer);
  const json scale = json::parse(solve(ArtefactKind::ball, "--json").out);
  EXPECT_EQ(scale["status"], "refused");
  EXPECT_NEAR(scale["lambda"].get<double>(), 1.0 / 1.015, 0.002);
  EXPECT_GT(scale["lambda_sigma"].get<double>(), 0.0);
  EXPECT_TRUE(std::any_of(scale["reasons"].begin(), scale["reasons"].end(), [](const json& r) {
    return r["code"] == "scale";
  })) << scale["reasons"];

  // The file declares T_flange_base, but contains T_base_flange.
  PoseFormat inverse;
  inverse.inverse = inverse.declared = true;
  Set wrong = set;
  for (calib::View& view : wrong.views) view.T_base_flange = view.T_base_flange.inverse();
  write_tables(ArtefactKind::ball, wrong, inverse);
  EXPECT_EQ(reason(ArtefactKind::ball)["code"], "convention");
  EXPECT_EQ(reason(ArtefactKind::ball)["cure"], "declare its content: # format: frames=T_base_flange");
}

TEST_F(CalibrateSolve, outliers_are_listed_by_view_from_1) {
  Plan plan;
  plan.views = 20;
  plan.outlier_share = 0.1;
  const Set set = make(ArtefactKind::ball, plan, 4);
  write_tables(ArtefactKind::ball, set);
  const json out = json::parse(solve(ArtefactKind::ball, "--json").out);
  ASSERT_EQ(out["rejected"].size(), 2U);
  for (std::size_t k = 0; k < 2; ++k) EXPECT_EQ(out["rejected"][k].get<std::size_t>(), set.outliers[k] + 1);
}

TEST_F(CalibrateSolve, coarse_robot_is_accepted_when_its_noise_is_stated) {
  Plan plan;
  plan.views = 20;
  plan.robot_mm = 0.7;
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose}) {
    write_tables(kind, make(kind, plan, 6));
    const Ended refused = solve(kind);
    EXPECT_EQ(refused.status, 6);
    expect_mentions(refused.out, "noise_above_stated");
    EXPECT_EQ(solve(kind, "--robot-sigma-mm 0.7").status, 0) << solve(kind, "--robot-sigma-mm 0.7").out;
    const Ended limited = solve(kind, "--robot-sigma-mm 0.7 --limit-mm 0.1");
    EXPECT_EQ(limited.status, 6);
    expect_mentions(limited.out, "predicted_error");
  }
}

TEST_F(CalibrateSolve, bad_files_are_status_3_with_file_and_line) {
  write_tables(ArtefactKind::ball, make(ArtefactKind::ball, {}, 1));
  const std::string good = content(file("target.txt"));
  std::ignore = write("target.txt", good + "1 2 3 0.5 0 0 0\n");
  Ended ended = solve(ArtefactKind::ball);
  EXPECT_EQ(ended.status, 3);
  expect_mentions(ended.err, "target.txt:16: the quaternion");
  EXPECT_EQ(ended.out, "");
  std::ignore = write("target.txt", good + "1 2 3 1 0 0 0\n");
  ended = solve(ArtefactKind::ball);
  EXPECT_EQ(ended.status, 3);
  expect_mentions(ended.err, "flange.txt has 15 poses");
  fs::remove(file("flange.txt"));
  ended = solve(ArtefactKind::ball);
  EXPECT_EQ(ended.status, 3);
  expect_mentions(ended.err, "flange.txt: No such file");
}

TEST_F(CalibrateSolve, wrong_use_is_status_2) {
  EXPECT_EQ(run("calibrate").status, 2);
  EXPECT_EQ(run("calibrate solve --kind cube --flange a --target b").status, 2);
  EXPECT_EQ(run("calibrate solve --kind ball --flange a --target b --robot-sigma-mm nan").status, 2);
  EXPECT_EQ(run("calibrate solve --kind ball --flange a --target b --robot-sigma-mm -1").status, 2);
  EXPECT_EQ(run("calibrate solve --kind ball --flange a --target b --fov 1 2 3").status, 2);
  for (const char* fov : {"0 0 0 0", "100 100 580 420"})
    expect_mentions(run(std::string("calibrate solve --kind ball --flange a --target b --fov ") + fov).err,
                    "nearest must be less than furthest");
  for (const char* bar : {"1e30 2 500 0.01", "0 1 500 0.01", "1 17 500 0.01", "1.5 2 500 0.01", "2 2 500 0.01",
                          "1 2 0 0.01", "nan 2 500 0.01"}) {
    const Ended refused = run(std::string("calibrate solve --kind ball --flange a --target b --ball-bar ") + bar);
    EXPECT_EQ(refused.status, 2) << bar << refused.out << refused.err;
    if (bar[0] != 'n') expect_mentions(refused.err, "whole numbers within 1 .. 16");
  }
}

}  // namespace
}  // namespace slabd::cli
