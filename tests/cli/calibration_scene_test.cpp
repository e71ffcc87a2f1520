// SPDX-License-Identifier: Apache-2.0
#include "cli/simulate/calibration_scene.h"

#include <gtest/gtest.h>

#include <unistd.h>

#include <Eigen/Eigenvalues>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "calib/calib.h"
#include "cli/exit.h"
#include "cli/simulate/mastered_slab.h"
#include "tests/config/reference_recipe.h"
#include "tests/places/places.h"

namespace slabd::cli::simulate {
namespace {

CalibrationScene scene_of(TargetKind kind, std::uint64_t seed = 1) {
  CalibrationTraits traits;
  traits.kind = kind;
  traits.seed = seed;
  traits.robot.seed = seed;
  static const Recipe recipe = cli::reference_recipe();
  Result<CalibrationScene> scene = CalibrationScene::make(traits, &recipe);
  EXPECT_TRUE(scene.ok());
  return scene.value();
}

TEST(CalibrationScene, points_of_the_ball_lie_where_the_truth_says_and_scatter_as_asked) {
  const CalibrationScene scene = scene_of(TargetKind::ball);
  CalibrationScanTraits scan;
  scan.noise_mm = 0.04;
  scan.flyer_share = 0.0;
  scan.outlier_share = 0.0;
  std::vector<float> xyz;
  std::uint64_t visit = 0;
  for (const Pose& flange : scene.plan_views(5)) {
    ASSERT_TRUE(scene.draw(flange, visit, scan, xyz).ok());
    const Vec3 centre = scene.T_scanner_target(flange, visit).translation_mm;
    ++visit;
    double squares = 0.0;
    int count = 0;
    for (std::size_t i = 0; i < xyz.size(); i += 3) {
      const Vec3 p(xyz[i], xyz[i + 1], xyz[i + 2]);
      // Only points within 25 degrees of the ray through the centre, where noise along the ray is noise along the
      // radius.
      if (!((p - centre).norm() < 26.0) || (p - centre).normalized().dot(-centre.normalized()) < 0.9) continue;
      const double off = (p - centre).norm() - scene.traits().ball_radius_mm;
      squares += off * off;
      ++count;
    }
    EXPECT_GT(count, 900);
    EXPECT_NEAR(std::sqrt(squares / count), 0.04 * 0.95, 0.003);
  }
}

TEST(CalibrationScene, every_planned_view_of_ball_and_artefact_is_one_that_is_accepted) {
  std::vector<float> xyz;
  const CalibrationScene ball = scene_of(TargetKind::ball, 3);
  calib::BallSettings settings;
  settings.radius_mm = ball.traits().ball_radius_mm;
  std::uint64_t visit = 0;
  for (const Pose& flange : ball.plan_views(10)) {
    ASSERT_TRUE(ball.draw(flange, visit, {}, xyz).ok());
    const Result<calib::BallView> view = calib::find_balls(xyz, settings);
    ASSERT_TRUE(view.ok() && view.value().ok()) << visit << ": " << view.value().words.reason.view();
    EXPECT_LT((view.value().balls[0].centre_mm - ball.T_scanner_target(flange, visit).translation_mm).norm(), 0.005);
    ++visit;
  }
  const CalibrationScene artefact = scene_of(TargetKind::artefact, 3);
  for (const Pose& flange : artefact.plan_views(10)) {
    ASSERT_TRUE(artefact.draw(flange, visit, {}, xyz).ok());
    const Result<calib::ArtefactReport> report = calib::find_artefact(xyz, artefact.certificate(), {});
    ASSERT_TRUE(report.ok() && report.value().ok()) << visit << ": " << report.value().words.reason.view();
    const Pose off = report.value().target.T_scanner_target.inverse() * artefact.T_scanner_target(flange, visit);
    EXPECT_LT(off.translation_mm.norm(), 0.006);
    EXPECT_LT(deg_from_rad(angle_between_rad(off.rotation, Quat::Identity())), 0.004);
    ++visit;
  }
}

TEST(CalibrationScene, a_hidden_half_is_refused_for_what_it_is) {
  const CalibrationScene scene = scene_of(TargetKind::ball);
  CalibrationScanTraits scan;
  scan.hidden_share = 0.5;
  std::vector<float> xyz;
  ASSERT_TRUE(scene.draw(scene.plan_views(1)[0], 0, scan, xyz).ok());
  calib::BallSettings settings;
  settings.radius_mm = scene.traits().ball_radius_mm;
  const Result<calib::BallView> view = calib::find_balls(xyz, settings);
  ASSERT_TRUE(view.ok());
  EXPECT_EQ(calib::name(view.value().refusal), calib::name(calib::BallRefusal::azimuth));
}

TEST(CalibrationScene, is_the_same_again_and_another_shot_is_not) {
  const CalibrationScene scene = scene_of(TargetKind::ball);
  const Pose flange = scene.plan_views(3)[2];
  CalibrationScanTraits scan;
  scan.columns = 160;
  scan.rows = 192;
  scan.correlated_mm = 0.02;
  std::vector<float> a;
  std::vector<float> b;
  std::vector<float> shot;
  ASSERT_TRUE(scene.draw(flange, 2, scan, a).ok());
  ASSERT_TRUE(scene.draw(flange, 2, scan, b).ok());
  ASSERT_TRUE(scene.draw(flange, 2, scan, shot, 1).ok());
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0);
  EXPECT_NE(std::memcmp(a.data(), shot.data(), a.size() * sizeof(float)), 0);
}

TEST(CalibrationScene, planned_views_tilt_and_turn_enough_to_calibrate_with) {
  const CalibrationScene scene = scene_of(TargetKind::ball);
  const std::vector<Pose> flange = scene.plan_views(20);
  Mat3 spread = Mat3::Zero();
  for (std::size_t i = 0; i < flange.size(); ++i)
    for (std::size_t j = i + 1; j < flange.size(); ++j) {
      const Eigen::AngleAxisd turn(Eigen::Quaterniond(flange[i].rotation.conjugate() * flange[j].rotation));
      const Vec3 log = turn.angle() * turn.axis();
      spread += log * log.transpose() / (20.0 * 19.0 / 2.0);
    }
  const double smallest = std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvalues()[0]);
  EXPECT_GT(deg_from_rad(smallest), 15.0);
}

TEST(CalibrationScene, the_block_is_drawn_in_its_place) {
  const CalibrationScene scene = scene_of(TargetKind::block);
  std::vector<float> xyz;
  const Pose flange = scene.plan_views(2)[1];
  CalibrationScanTraits scan;
  scan.flyer_share = 0.0;
  scan.outlier_share = 0.0;
  ASSERT_TRUE(scene.draw(flange, 1, scan, xyz).ok());
  const Pose T_block_scanner = scene.T_scanner_target(flange, 1).inverse();
  int on_seat = 0;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    const Vec3 p = T_block_scanner * Vec3(xyz[i], xyz[i + 1], xyz[i + 2]);
    if (!(std::abs(p.x()) < 40.0 && std::abs(p.y()) < 60.0)) continue;
    EXPECT_NEAR(p.z(), p.y() / 40.0, 0.25);
    ++on_seat;
  }
  EXPECT_GT(on_seat, 20'000);
  CalibrationTraits traits;
  traits.kind = TargetKind::block;
  EXPECT_FALSE(CalibrationScene::make(traits, nullptr).ok());
  traits.kind = TargetKind::ball;
  traits.ball_radius_mm = 3.0;
  EXPECT_FALSE(CalibrationScene::make(traits).ok());
}

TEST(MasteredSlab, rounds_of_visits_become_corrections_that_take_the_robots_error_away) {
  namespace fs = std::filesystem;
  const fs::path dir = fs::temp_directory_path() / ("slabd-master-" + std::to_string(::getpid()));
  fs::remove_all(dir);
  CalibrationOrder order;
  order.out_dir = dir.native();
  order.recipe = places::source_dir() + "/recipes/p5600.toml";
  order.views = 5;
  order.scene.robot.smooth_mm = 0.7;
  ASSERT_EQ(write_mastered_slab(order), 0);
  try {
    FAIL() << "nothing is overwritten, and yet " << write_mastered_slab(order);
  } catch (const cli::Stop& end) {
    EXPECT_EQ(end.status, cli::kUsage);
  }
  const auto text = [&](const char* name) {
    std::ifstream file(dir / name);
    std::ostringstream all;
    all << file.rdbuf();
    return all.str();
  };
  const auto certificate = calib::parse_master_certificate(text("certificate.txt"), "certificate.txt");
  const auto visits = calib::parse_visits(text("visits.txt"), "visits.txt");
  fs::remove_all(dir);
  ASSERT_TRUE(certificate.ok()) << certificate.error().text.view();
  ASSERT_TRUE(visits.ok()) << visits.error().text.view();
  EXPECT_EQ(visits.value().size(), 90U);
  const auto solved = calib::solve_stations(certificate.value(), visits.value(),
                                            HandEyeNumbers{order.scene.T_flange_scanner}, calib::StationSettings{});
  ASSERT_TRUE(solved.ok()) << solved.error().text.view();
  ASSERT_TRUE(solved.value().ok) << solved.value().reasons.front().text;
  EXPECT_GT(solved.value().before_rms_mm, 0.4);
  EXPECT_LT(solved.value().after_rms_mm, 0.04);
  EXPECT_NEAR(solved.value().pooled_sigma_mm, 0.017, 0.004) << "repeatability, and little else";
}

}  // namespace
}  // namespace slabd::cli::simulate
