// SPDX-License-Identifier: Apache-2.0
//
// Compares the solver with known truth and with an optimum computed by other means.
#include "calib/hand_eye.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "calib/adjustment.h"
#include "calib/mathematics.h"
#include "tests/calib/hand_eye_scene.h"

namespace slabd::calib {
namespace {

using scene::make;
using scene::Plan;
using scene::Set;

HandEye solved(ArtefactKind kind, const Set& set, const Plan& plan) {
  const Result<HandEye> result = solve(kind, set.views, plan.noise());
  EXPECT_TRUE(result.ok()) << result.error().text.view();
  return result.value();
}

std::string told(const HandEye& result) {
  std::string text;
  for (const Reason& reason : result.reasons)
    text += std::string(name(reason.code)) + ": " + reason.text + " / " + reason.cure + "\n";
  return text;
}

/// Ratio of the rms error in the field of view to that of the optimum, over `seeds` sets.
double ratio_to_reference(ArtefactKind kind, const Plan& plan, int seeds) {
  double ours = 0.0;
  double best = 0.0;
  for (int seed = 0; seed < seeds; ++seed) {
    const Set set = make(kind, plan, static_cast<std::uint64_t>(seed) + 1);
    const Pose X = solved(kind, set, plan).T_flange_scanner;
    ours += std::pow(scene::point_error_mm(X, set.T_flange_scanner), 2);
    best += std::pow(scene::point_error_mm(scene::reference(kind, set, plan.noise()), set.T_flange_scanner), 2);
  }
  return std::sqrt(ours / best);
}

Plan plan_of(std::size_t views, double robot_mm = 0.06, double tilt_deg = 35.0) {
  Plan plan;
  plan.views = views;
  plan.robot_mm = robot_mm;
  plan.tilt_deg = tilt_deg;
  return plan;
}

constexpr std::array kKinds = {ArtefactKind::ball, ArtefactKind::pose};

TEST(HandEye, clean_sets_are_solved_as_well_as_they_can_be) {
  for (const ArtefactKind kind : kKinds) {
    for (const double robot_mm : {0.0, 0.06, 0.7})
      EXPECT_LE(ratio_to_reference(kind, plan_of(15, robot_mm), 6), 1.005) << name(kind) << " " << robot_mm;
    EXPECT_LE(ratio_to_reference(kind, plan_of(8, 0.06, 15.0), 10), 1.01) << name(kind);
  }
}

TEST(HandEye, one_view_in_ten_displaced_does_not_reduce_accuracy) {
  for (const ArtefactKind kind : kKinds) {
    Plan plan = plan_of(20);
    plan.outlier_share = 0.1;
    EXPECT_LE(ratio_to_reference(kind, plan, 10), 1.01) << name(kind);
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const Set set = make(kind, plan, seed);
      EXPECT_EQ(solved(kind, set, plan).rejected, set.outliers) << name(kind) << " seed " << seed;
    }
  }
}

TEST(HandEye, gross_outliers_do_not_capture_the_start) {
  for (const ArtefactKind kind : kKinds) {
    Plan plan = plan_of(16);
    plan.outlier_share = 0.25;
    plan.outlier_min_mm = 300.0;
    plan.outlier_max_mm = 900.0;
    const Set set = make(kind, plan, 3);
    const HandEye result = solved(kind, set, plan);
    EXPECT_EQ(result.rejected, set.outliers) << name(kind);
    EXPECT_TRUE(result.ok) << told(result);
    EXPECT_LT(scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner), 0.3);
  }
}

TEST(HandEye, covariance_and_predicted_error_are_true) {
  constexpr int kSeeds = 60;
  for (const ArtefactKind kind : kKinds) {
    const Plan plan = plan_of(15);
    double chi2 = 0.0;
    double errors = 0.0;
    double predicted = 0.0;
    for (int seed = 0; seed < kSeeds; ++seed) {
      const Set set = make(kind, plan, static_cast<std::uint64_t>(seed) + 500);
      const HandEye result = solved(kind, set, plan);
      ASSERT_TRUE(result.ok) << told(result);
      Eigen::Matrix<double, 6, 1> e;
      e.head<3>() = Eigen::Vector3d(set.T_flange_scanner.translation_mm - result.T_flange_scanner.translation_mm);
      e.tail<3>() =
          Eigen::Vector3d(log_rotation(result.T_flange_scanner.rotation.conjugate() * set.T_flange_scanner.rotation));
      const Eigen::Matrix<double, 6, 6> C = result.covariance;
      chi2 += e.dot(Eigen::Matrix<double, 6, 1>(C.ldlt().solve(e))) / kSeeds;
      errors += std::pow(scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner), 2) / kSeeds;
      predicted += std::pow(result.predicted_point_sigma_mm, 2) / kSeeds;
    }
    // Expected are six with a standard deviation of the mean of 0.45; max(1, s0) reduces it.
    EXPECT_GT(chi2, 4.2) << name(kind);
    EXPECT_LT(chi2, 7.4) << name(kind);
    EXPECT_NEAR(std::sqrt(predicted / errors), 1.06, 0.17) << name(kind);
  }
}

TEST(HandEye, several_balls_are_one_solve_and_share_the_robots_error) {
  Plan plan = plan_of(12);
  plan.balls = 3;
  EXPECT_LE(ratio_to_reference(ArtefactKind::ball, plan, 6), 1.005);
  const Set set = make(ArtefactKind::ball, plan, 5);
  const HandEye result = solved(ArtefactKind::ball, set, plan);
  ASSERT_EQ(result.targets.size(), 3U);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_LT((result.targets[k].translation_mm - set.targets[k].translation_mm).norm(), 0.3);
  EXPECT_NEAR(result.s0, 1.0, 0.4);
}

TEST(HandEye, each_degenerate_set_is_refused_with_its_own_reason) {
  struct Case {
    const char* what;
    ArtefactKind kind;
    Plan plan;
    Refusal code;
    bool determined;
  };
  std::vector<Case> cases;
  const auto add = [&](const char* what, ArtefactKind kind, Refusal code, bool determined, auto change) {
    Plan plan = plan_of(15);
    change(plan);
    cases.push_back({what, kind, plan, code, determined});
  };
  for (const ArtefactKind kind : kKinds) {
    add("one orientation", kind, Refusal::one_orientation, false, [](Plan& p) { p.one_orientation = true; });
    add("one axis", kind, Refusal::one_rotation_axis, false, [](Plan& p) { p.one_axis = true; });
    add("3 deg", kind, Refusal::rotation_too_small, true, [](Plan& p) { p.tilt_deg = p.roll_deg = 3.0; });
    add("5 views", kind, Refusal::too_few_views, true, [](Plan& p) { p.views = 5; });
    add("30 % outliers", kind, Refusal::too_many_rejected, true, [](Plan& p) {
      p.views = 20;
      p.outlier_share = 0.3;
    });
  }
  add("one place", ArtefactKind::ball, Refusal::ball_in_one_place, false,
      [](Plan& p) { p.fov_mm = p.depth_half_mm = 0.0; });
  add("nearly one place", ArtefactKind::ball, Refusal::ball_in_one_place, true, [](Plan& p) {
    p.fov_mm = 15.0;
    p.depth_half_mm = 10.0;
  });
  add("optical axis", ArtefactKind::ball, Refusal::ball_on_a_line, false, [](Plan& p) { p.fov_mm = 0.0; });
  for (const Case& c : cases)
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      const HandEye result = solved(c.kind, make(c.kind, c.plan, seed), c.plan);
      const std::string what = std::string(name(c.kind)) + " " + c.what + ": " + told(result);
      EXPECT_FALSE(result.ok) << what;
      ASSERT_FALSE(result.reasons.empty()) << what;
      EXPECT_EQ(result.reasons[0].code, c.code) << what;
      EXPECT_FALSE(result.reasons[0].cure.empty()) << what;
      EXPECT_EQ(result.determined, c.determined) << what << result.condition;
      EXPECT_EQ(std::isnan(result.predicted_point_sigma_mm), !c.determined) << what;
      EXPECT_EQ(result.T_flange_scanner.all_finite(), c.determined) << what;
      EXPECT_TRUE(std::isfinite(result.residual_mm.rms)) << what;
      EXPECT_TRUE(std::isfinite(result.condition)) << what;
    }
}

TEST(HandEye, a_pose_artefact_in_one_place_is_enough_but_its_origin_as_a_ball_is_not) {
  Plan plan = plan_of(20, 0.7);
  plan.fov_mm = 5.0;
  plan.depth_half_mm = 5.0;
  const Set set = make(ArtefactKind::pose, plan, 8);
  EXPECT_TRUE(solved(ArtefactKind::pose, set, plan).ok);
  Set balls = set;
  for (View& view : balls.views) view.balls.push_back({0, view.T_scanner_target.translation_mm, std::nullopt});
  const HandEye result = solved(ArtefactKind::ball, balls, plan);
  EXPECT_FALSE(result.ok);
  EXPECT_EQ(result.reasons[0].code, Refusal::ball_in_one_place) << told(result);
}

TEST(HandEye, fewer_than_three_views_are_refused_without_a_crash) {
  for (const ArtefactKind kind : kKinds)
    for (const std::size_t views : {1U, 2U, 3U, 4U}) {
      const Plan plan = plan_of(views);
      const HandEye result = solved(kind, make(kind, plan, 2), plan);
      EXPECT_FALSE(result.ok);
      EXPECT_EQ(result.reasons[0].code, Refusal::too_few_views) << told(result);
    }
}

TEST(HandEye, stated_noise_that_is_wrong_is_refused_but_x_stays_right) {
  const Plan plan = plan_of(20, 0.7);
  for (const ArtefactKind kind : kKinds) {
    const Set set = make(kind, plan, 11);
    const HandEye coarse = solve(kind, set.views, StatedNoise{}).value();
    ASSERT_EQ(coarse.reasons.size(), 2U) << told(coarse);
    EXPECT_EQ(coarse.reasons[0].code, Refusal::noise_above_stated);
    EXPECT_NE(coarse.reasons[0].cure.find("state it (about 0."), std::string::npos) << told(coarse);
    EXPECT_EQ(coarse.reasons[1].code, Refusal::predicted_error);
    const HandEye right = solved(kind, set, plan);
    EXPECT_TRUE(right.ok) << told(right);
    EXPECT_LT(scene::point_error_mm(coarse.T_flange_scanner, right.T_flange_scanner),
              0.3 * right.predicted_point_sigma_mm);

    StatedNoise ten;
    ten.robot_mm = 10.0;
    ten.robot_rad = robot_rad_for(10.0);
    const HandEye fine = solve(kind, set.views, ten).value();
    EXPECT_TRUE(std::any_of(fine.reasons.begin(), fine.reasons.end(), [](const auto& reason) {
      return reason.code == Refusal::noise_below_stated;
    })) << told(fine);
  }
}

TEST(HandEye, accuracy_stated_as_noise_is_a_remark_and_not_a_refusal) {
  // Neighbouring poses share most of a smooth error, so the scatter is only a part of the stated accuracy.
  Plan plan = plan_of(15);
  plan.robot_mm = 0.06;
  plan.smooth_mm = 0.7;
  int said = 0;
  for (const ArtefactKind kind : kKinds)
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      const HandEye result = solved(kind, make(kind, plan, seed), plan);
      EXPECT_TRUE(result.ok) << seed << told(result);
      const bool low = std::max(result.s0_position, has_value(result.s0_rotation) ? result.s0_rotation : 0.0) < kS0Said;
      const bool warned = std::any_of(result.warnings.begin(), result.warnings.end(), [](const std::string& w) {
        return w.find("of what the stated noise explains") != std::string::npos;
      });
      EXPECT_EQ(warned, low) << seed;
      said += warned ? 1 : 0;
      EXPECT_GE(result.predicted_point_sigma_mm, 0.3) << "and the prediction stays that of the stated noise";
    }
  EXPECT_GT(said, 0);
}

TEST(HandEye, tilts_to_all_sides_without_a_roll_are_enough_and_a_roll_is_advised) {
  Plan plan = plan_of(15);
  plan.roll_deg = 0.0;
  for (const ArtefactKind kind : kKinds)
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const Set set = make(kind, plan, seed);
      const HandEye result = solved(kind, set, plan);
      EXPECT_TRUE(result.ok) << seed << told(result);
      EXPECT_LT(result.rotation_spread_deg, kRotationSpreadAdvised_deg);
      EXPECT_TRUE(std::any_of(result.warnings.begin(), result.warnings.end(),
                              [](const std::string& w) { return w.find("roll of +-45") != std::string::npos; }));
      EXPECT_LT(scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner),
                3.5 * result.predicted_point_sigma_mm);
    }
}

TEST(HandEye, positions_and_rotations_are_weighed_by_what_they_are) {
  // Rotations are ten times as noisy as stated. Weighted as stated they degrade X, weighted by their actual noise they
  // do not.
  Plan plan = plan_of(25, 0.1);
  plan.robot_deg = 0.1;
  StatedNoise wrong = plan.noise();
  wrong.robot_rad = rad_from_deg(0.01);
  double ours = 0.0;
  double best = 0.0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const Set set = make(ArtefactKind::pose, plan, seed);
    const HandEye result = solve(ArtefactKind::pose, set.views, wrong).value();
    EXPECT_TRUE(result.reweighted);
    EXPECT_GT(result.s0_rotation / result.s0_position, 4.0);
    ours += std::pow(scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner), 2);
    best += std::pow(
        scene::point_error_mm(scene::reference(ArtefactKind::pose, set, plan.noise()), set.T_flange_scanner), 2);
  }
  EXPECT_LE(std::sqrt(ours / best), 1.03);
}

TEST(HandEye, independent_robot_errors_are_weighted_with_their_lever) {
  // Independent turns of the flange move the target too, and weights that include this are the best.
  const Plan plan = plan_of(20, 0.7);
  double ours = 0.0;
  double best = 0.0;
  int with = 0;
  constexpr int kSets = 25;
  for (std::uint64_t seed = 1; seed <= kSets; ++seed) {
    const Set set = make(ArtefactKind::pose, plan, seed);
    const HandEye result = solved(ArtefactKind::pose, set, plan);
    with += result.robot_lever ? 1 : 0;
    ours += std::pow(scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner), 2);
    best += std::pow(
        scene::point_error_mm(scene::reference(ArtefactKind::pose, set, plan.noise()), set.T_flange_scanner), 2);
  }
  EXPECT_GE(with, kSets - 2);
  EXPECT_LE(std::sqrt(ours / best), 1.03);
}

TEST(HandEye, rotations_without_information_are_detected) {
  // The stated noise belongs to the sighting, not to the robot: turns of the same size, but without the lever. Many
  // views show this in the sizes of the residuals, few views only in the leave-one-out error.
  for (const std::size_t views : {std::size_t{8}, std::size_t{20}}) {
    Plan plan = plan_of(views, 0.05);
    plan.robot_deg = 0.0;
    plan.target_mm = 0.7;
    plan.target_deg = 0.08;
    StatedNoise wrong;
    wrong.robot_mm = 0.7;
    wrong.robot_rad = rad_from_deg(0.08);
    wrong.target_mm = 0.05;
    wrong.target_rad = rad_from_deg(0.001);
    double ours = 0.0;
    double stubborn = 0.0;
    double best = 0.0;
    int without = 0;
    int reweighed = 0;
    constexpr int kSets = 40;
    const auto error2 = [&](const Set& set, const Pose& X) {
      return std::pow(scene::point_error_mm(X, set.T_flange_scanner), 2);
    };
    for (std::uint64_t seed = 1; seed <= kSets; ++seed) {
      const Set set = make(ArtefactKind::pose, plan, seed);
      const HandEye result = solve(ArtefactKind::pose, set.views, wrong).value();
      without += result.robot_lever ? 0 : 1;
      reweighed += result.reweighted ? 1 : 0;
      ours += error2(set, result.T_flange_scanner);
      stubborn += error2(set, scene::reference(ArtefactKind::pose, set, wrong));
      best += error2(set, scene::reference(ArtefactKind::pose, set, plan.noise()));
    }
    EXPECT_GT(std::sqrt(stubborn / best), 1.3);
    if (views == 8) {
      EXPECT_GT(without, 5);
      EXPECT_LE(std::sqrt(ours / best), 1.1);
    } else {
      EXPECT_EQ(reweighed, kSets);
      EXPECT_LE(std::sqrt(ours / best), 1.02);
    }
  }
}

TEST(HandEye, a_few_poses_seen_again_and_again_count_as_a_few_poses) {
  // They agree to the scanner's noise, but the result may be anywhere.
  const Plan plan = plan_of(5, 0.017);
  for (const ArtefactKind kind : kKinds)
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      Set set = make(kind, plan, seed);
      const std::vector<View> once = set.views;
      for (int again = 1; again <= 3; ++again)
        for (View view : once) {
          const Vec3 noise(0.003 * again, -0.002 * again, 0.004);
          view.T_scanner_target.translation_mm += noise;
          for (BallObservation& ball : view.balls) ball.centre_mm += noise;
          set.views.push_back(view);
        }
      const HandEye result = solved(kind, set, plan);
      EXPECT_FALSE(result.ok) << seed;
      EXPECT_TRUE(std::any_of(result.reasons.begin(), result.reasons.end(),
                              [](const Reason& r) {
                                return r.code == Refusal::too_few_views &&
                                       r.text.find("from 5 poses") != std::string::npos;
                              }))
          << seed << told(result);
    }
}

/// `times` views from every pose of a set. The robot has the same error `shared_mm` at a pose every time and in
/// addition an independent one of `anew_mm`. The target's noise is always independent.
Set repeated(ArtefactKind kind, const Plan& plan, double shared_mm, double anew_mm, std::size_t times,
             std::uint64_t seed) {
  Plan once = plan;
  once.robot_mm = shared_mm;
  once.target_mm = 0.0;
  once.target_deg = 0.0;
  Set set = make(kind, once, seed);
  const std::vector<View> places = set.views;
  set.views.clear();
  Prng random(seed * 104729 + 7);
  const auto vector = [&](double sigma) {
    const double x = random.normal(), y = random.normal(), z = random.normal();
    return Vec3(sigma * x, sigma * y, sigma * z);
  };
  const auto motion = [&](double mm, double rad) {
    const Vec3 shift = vector(mm);
    return Pose{exp_rotation(vector(rad)), shift};
  };
  for (std::size_t k = 0; k < times; ++k)
    for (View view : places) {
      view.T_base_flange = view.T_base_flange * motion(anew_mm, robot_rad_for(anew_mm));
      view.T_scanner_target = view.T_scanner_target * motion(plan.target_mm, rad_from_deg(plan.target_deg));
      for (BallObservation& ball : view.balls) ball.centre_mm += vector(plan.target_mm);
      set.views.push_back(view);
    }
  return set;
}

TEST(HandEye, repeats_of_a_pose_are_weighted_by_their_independent_part) {
  struct Case {
    double shared_mm, anew_mm;
    double share;  ///< share of the variance of positions
  };
  constexpr std::array kCases = {
      Case{0.06, 0.0, 0.97},  // the robot stands still while scans are taken
      Case{0.0, 0.06, 0.0},   // the robot leaves and has an independent error every time
      Case{0.042, 0.042, 0.49},
  };
  constexpr int kSeeds = 24;
  constexpr std::size_t kTimes = 6;
  const Plan plan = plan_of(8);
  for (const ArtefactKind kind : kKinds)
    for (const Case& c : kCases) {
      double errors = 0.0;
      double predicted = 0.0;
      double share = 0.0;
      for (int seed = 0; seed < kSeeds; ++seed) {
        const Set set = repeated(kind, plan, c.shared_mm, c.anew_mm, kTimes, static_cast<std::uint64_t>(seed) + 900);
        const HandEye result = solved(kind, set, plan);
        errors += std::pow(scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner), 2) / kSeeds;
        predicted += std::pow(result.predicted_point_sigma_mm, 2) / kSeeds;
        share += result.repeat_share / kSeeds;
        EXPECT_TRUE(std::any_of(result.warnings.begin(), result.warnings.end(), [](const std::string& warning) {
          return warning.find("48 views from 8 poses") != std::string::npos;
        })) << seed;
      }
      // Treated as independent they are 2.1 to 2.6, 1 and 1.6 to 1.8. max(1, s0) reduces it; 24 sets determine it to a
      // tenth.
      EXPECT_NEAR(std::sqrt(errors / predicted), 0.95, 0.2) << name(kind) << " " << c.shared_mm;
      EXPECT_NEAR(share, c.share, 0.12) << name(kind) << " " << c.shared_mm;
    }
}

TEST(HandEye, copies_of_views_count_as_one) {
  for (const ArtefactKind kind : kKinds) {
    const Plan plan = plan_of(12);
    const Set set = make(kind, plan, 21);
    const HandEye once = solved(kind, set, plan);
    EXPECT_TRUE(std::isnan(once.repeat_share));
    Set copied = set;
    for (int again = 0; again < 4; ++again) copied.views.insert(copied.views.end(), set.views.begin(), set.views.end());
    const HandEye result = solved(kind, copied, plan);
    EXPECT_NEAR(result.repeat_share, 1.0, 1e-6);
    EXPECT_NEAR(result.s0, once.s0, 1e-3);
    EXPECT_NEAR(result.predicted_point_sigma_mm, once.predicted_point_sigma_mm, 1e-4);
  }
}

TEST(HandEye, balls_seen_once_are_ignored_and_the_others_must_be_redundant) {
  // Two balls seen twice determine X without redundancy: the first view has an error of 27 mm, and everything fits.
  constexpr std::array<std::size_t, 8> kSeen = {0, 0, 1, 1, 2, 3, 4, 5};
  Plan plan = plan_of(kSeen.size());
  plan.balls = 6;
  int determined = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Set set = make(ArtefactKind::ball, plan, seed);
    for (std::size_t i = 0; i < set.views.size(); ++i) set.views[i].balls = {set.views[i].balls.at(kSeen[i])};
    set.views[0].balls[0].centre_mm += Vec3(15.0, -15.0, 17.0);
    const HandEye result = solved(ArtefactKind::ball, set, plan);
    EXPECT_FALSE(result.ok) << seed << ", off by "
                            << scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner);
    determined += result.determined ? 1 : 0;
    EXPECT_TRUE(!result.determined || std::any_of(result.reasons.begin(), result.reasons.end(),
                                                  [](const Reason& r) {
                                                    return r.text.find("no equation is redundant") != std::string::npos;
                                                  }))
        << seed << told(result);
  }
  EXPECT_GT(determined, 10) << "or nothing was asked";
}

TEST(HandEye, one_view_that_decides_is_named) {
  // The smallest allowed sets: by chance one of a hundred depends on a single view.
  const Plan plan = plan_of(6);
  int refused = 0;
  for (std::uint64_t seed = 1000; seed < 1100; ++seed) {
    const Set set = make(ArtefactKind::ball, plan, seed);
    const HandEye result = solved(ArtefactKind::ball, set, plan);
    const Spread& loo = result.leave_one_out_mm;
    const auto reason = std::find_if(result.reasons.begin(), result.reasons.end(),
                                     [](const Reason& r) { return r.code == Refusal::leave_one_out; });
    EXPECT_EQ(loo.max > kLeaveOneOutRatioMax * loo.median, reason != result.reasons.end()) << told(result);
    if (reason == result.reasons.end()) continue;
    ++refused;
    std::size_t worst = 0;
    for (std::size_t i = 0; i < result.views.size(); ++i)
      if (result.views[i].leave_one_out_mm == loo.max) worst = i;
    EXPECT_NE(reason->text.find("view " + std::to_string(worst + 1) + " is missed by"), std::string::npos);
  }
  EXPECT_GT(refused, 0);
}

TEST(HandEye, leave_one_out_equals_a_solve_without_the_view) {
  for (const ArtefactKind kind : kKinds) {
    const Plan plan = plan_of(10);
    const Set set = make(kind, plan, 4);
    const HandEye all = solved(kind, set, plan);
    ASSERT_TRUE(all.rejected.empty());
    for (const std::size_t out : {0U, 3U, 9U}) {
      std::vector<View> others = set.views;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(out));
      const HandEye without = solve(kind, others, plan.noise()).value();
      const std::vector<ViewFit> fit =
          residuals_of(kind, std::span(&set.views[out], 1), without.T_flange_scanner, without.targets, plan.noise());
      EXPECT_NEAR(all.views[out].leave_one_out_mm, fit[0].residual_mm, 1e-3 * fit[0].residual_mm);
    }
  }
}

TEST(HandEye, same_views_same_bits) {
  Plan plan = plan_of(15);
  plan.outlier_share = 0.1;
  for (const ArtefactKind kind : kKinds) {
    const Set set = make(kind, plan, 6);
    const HandEye a = solved(kind, set, plan);
    const HandEye b = solved(kind, set, plan);
    EXPECT_EQ(a.T_flange_scanner.to_array(), b.T_flange_scanner.to_array());
    EXPECT_EQ(a.covariance, b.covariance);
    EXPECT_EQ(a.leave_one_out_mm.rms, b.leave_one_out_mm.rms);
    EXPECT_EQ(a.predicted_point_sigma_mm, b.predicted_point_sigma_mm);
  }
}

TEST(HandEye, prediction_of_planned_views_is_what_a_solve_then_finds) {
  for (const ArtefactKind kind : kKinds) {
    const Plan plan = plan_of(15);
    const Set set = make(kind, plan, 12);
    const HandEye result = solved(kind, set, plan);
    const Prediction prediction = predict(kind, set.views, set.T_flange_scanner, set.targets, plan.noise());
    EXPECT_NEAR(prediction.point_sigma_mm * std::max(1.0, result.s0), result.predicted_point_sigma_mm,
                0.02 * result.predicted_point_sigma_mm);
    EXPECT_NEAR(prediction.condition, result.condition, 0.02 * result.condition);
    const Prediction fewer =
        predict(kind, std::span(set.views).first(8), set.T_flange_scanner, set.targets, plan.noise());
    EXPECT_GT(fewer.point_sigma_mm, prediction.point_sigma_mm);
    EXPECT_LT(fewer.smallest_singular_value, prediction.smallest_singular_value);
    const Prediction one =
        predict(kind, std::span(set.views).first(1), set.T_flange_scanner, set.targets, plan.noise());
    EXPECT_TRUE(std::isnan(one.point_sigma_mm));
  }
}

TEST(HandEye, own_covariances_of_sightings_are_used) {
  for (const ArtefactKind kind : kKinds) {
    const Plan plan = plan_of(12, 0.0);
    Set set = make(kind, plan, 14);
    for (std::size_t i = 0; i < set.views.size(); i += 2) {
      // Half of the views are a hundred times worse, and their covariances state it.
      const double bad_mm = 1.0;
      if (kind == ArtefactKind::ball) {
        set.views[i].balls[0].centre_mm += Vec3(0.8, -0.5, 0.9);
        set.views[i].balls[0].cov_mm2 = Mat3(bad_mm * bad_mm * Mat3::Identity());
      } else {
        set.views[i].T_scanner_target.translation_mm += Vec3(0.8, -0.5, 0.9);
        Mat6 own = bad_mm * bad_mm * Mat6::Identity();
        own.bottomRightCorner<3, 3>() *= 1e-6;
        set.views[i].target_covariance = own;
      }
    }
    const HandEye result = solved(kind, set, plan);
    EXPECT_TRUE(result.rejected.empty());
    EXPECT_LT(scene::point_error_mm(result.T_flange_scanner, set.T_flange_scanner), 0.1) << name(kind);
  }
}

TEST(HandEye, an_invalid_set_of_views_is_an_error) {
  const Plan plan = plan_of(8);
  Set set = make(ArtefactKind::ball, plan, 1);
  EXPECT_FALSE(solve(ArtefactKind::ball, {}, {}).ok());
  StatedNoise none;
  none.robot_mm = none.target_mm = 0.0;
  EXPECT_FALSE(solve(ArtefactKind::ball, set.views, none).ok());
  // Their squares underflow.
  for (const double tiny : {1e-155, 1e-158, 1e-160, 1e-162}) {
    none.robot_mm = none.target_mm = tiny;
    none.robot_rad = 0.0;
    EXPECT_FALSE(solve(ArtefactKind::ball, set.views, none).ok()) << tiny;
  }
  none = {};
  none.robot_rad = -1.0;
  EXPECT_FALSE(solve(ArtefactKind::ball, set.views, none).ok());
  set.views[2].balls[0].ball = 2;
  EXPECT_FALSE(solve(ArtefactKind::ball, set.views, {}).ok());
  set.views[2].balls.clear();
  EXPECT_FALSE(solve(ArtefactKind::ball, set.views, {}).ok());
  set = make(ArtefactKind::ball, plan, 1);
  set.views[1].balls.push_back(set.views[1].balls[0]);
  const auto twice = solve(ArtefactKind::ball, set.views, {});
  ASSERT_FALSE(twice.ok());
  EXPECT_NE(twice.error().text.view().find("view 2 has ball 1 twice"), std::string_view::npos);
  set = make(ArtefactKind::ball, plan, 1);
  set.views[1].balls[0].centre_mm.x() = kNoValue;
  EXPECT_FALSE(solve(ArtefactKind::ball, set.views, {}).ok());
}

TEST(HandEye, held_out_views_and_targets_follow_from_x) {
  for (const ArtefactKind kind : kKinds) {
    const Plan plan = plan_of(15);
    const Set set = make(kind, plan, 17);
    const std::vector<Pose> targets = best_targets(kind, set.views, set.T_flange_scanner);
    EXPECT_LT((targets[0].translation_mm - set.targets[0].translation_mm).norm(), 0.2);
    EXPECT_LT(angle_between_rad(targets[0].rotation, set.targets[0].rotation), rad_from_deg(0.01));
    for (const ViewFit& fit : residuals_of(kind, set.views, set.T_flange_scanner, targets, plan.noise())) {
      EXPECT_LT(fit.residual_mm, 0.4);
      EXPECT_LT(fit.sigmas, 4.5);
    }
  }
}

TEST(HandEye, a_shift_that_all_views_share_moves_x_as_predicted) {
  for (const ArtefactKind kind : kKinds) {
    const Plan plan = plan_of(15);
    const Set set = make(kind, plan, 31);
    const HandEye before = solved(kind, set, plan);
    // Shifts as caused by a radius that is certified 0.01 mm too large.
    Set moved = set;
    std::vector<Vec3> shifts;
    for (View& view : moved.views) {
      Vec3& seen = kind == ArtefactKind::ball ? view.balls[0].centre_mm : view.T_scanner_target.translation_mm;
      shifts.push_back(-0.012 * seen.normalized());
      seen -= shifts.back();
    }
    const HandEye after = solved(kind, moved, plan);
    const Vec6 told = motion_from_shifts(kind, moved.views, after, plan.noise(), shifts);
    const Pose& X = after.T_flange_scanner;
    const Pose back{X.rotation * exp_rotation(told.tail<3>()), X.translation_mm + Vec3(told.head<3>())};
    EXPECT_LT(scene::point_error_mm(back, before.T_flange_scanner), 2e-4) << name(kind);
    EXPECT_GT(scene::point_error_mm(X, before.T_flange_scanner), 0.011) << name(kind);
  }
}

TEST(HandEye, scale_is_diagnosed_against_a_certified_length) {
  Plan plan = plan_of(10);
  plan.balls = 2;
  Set set = make(ArtefactKind::ball, plan, 2);
  const ScaleDiagnosis good = diagnose_scale(set.views, 0, 1, 150.0, 0.002, 0.01);
  EXPECT_EQ(good.views, 10U);
  EXPECT_NEAR(good.sigma_ppm, std::hypot(0.01 * std::sqrt(2.0 / 10.0), 0.002) / 150.0 * 1e6, 1e-6);
  EXPECT_LT(std::abs(good.ppm), 4.0 * good.sigma_ppm);
  EXPECT_FALSE(good.suspicious);
  for (View& view : set.views)
    for (BallObservation& seen : view.balls) seen.centre_mm *= 1.0005;
  const ScaleDiagnosis bad = diagnose_scale(set.views, 0, 1, 150.0, 0.002, 0.01);
  EXPECT_NEAR(bad.ppm - good.ppm, 500.0, 1.0);
  EXPECT_TRUE(bad.suspicious);
  EXPECT_EQ(diagnose_scale(set.views, 0, 7, 150.0, 0.002, 0.01).views, 0U);
}

TEST(HandEye, a_scale_of_the_scanner_is_fitted_named_beyond_three_sigmas_and_refused_when_it_is_large) {
  struct Case {
    double scale;  ///< scale of the scanner's values
    bool is_said, is_refused;
  };
  constexpr std::array kCases = {Case{1.0, false, false}, Case{1.001, true, false}, Case{0.999, true, false},
                                 Case{1.015, true, true}, Case{0.985, true, true}};
  for (const ArtefactKind kind : kKinds)
    for (const Case& c : kCases) {
      Plan plan = plan_of(20);
      plan.robot_mm = 0.017;
      Set set = make(kind, plan, 4);
      for (View& view : set.views) {
        view.T_scanner_target.translation_mm *= c.scale;
        for (BallObservation& seen : view.balls) seen.centre_mm *= c.scale;
      }
      const HandEye result = solve(kind, set.views, plan.noise()).value();
      EXPECT_NEAR(result.scale, 1.0 / c.scale, 4.0 * result.scale_sigma) << name(kind) << " " << c.scale;
      EXPECT_LT(result.scale_sigma, 3e-4);
      EXPECT_EQ(result.ok, !c.is_refused) << name(kind) << " " << c.scale << told(result);
      const char* words =
          c.scale > 1.0 ? "too long against the robot's: lambda" : "too short against the robot's: lambda";
      const auto warned = [&](const std::string& text) { return text.find(words) != std::string::npos; };
      const auto refused = [&](const Reason& r) { return r.code == Refusal::scale && warned(r.text); };
      EXPECT_EQ(std::any_of(result.warnings.begin(), result.warnings.end(), warned), c.is_said && !c.is_refused);
      EXPECT_EQ(std::any_of(result.reasons.begin(), result.reasons.end(), refused), c.is_refused) << told(result);
    }
}

TEST(HandEye, a_robot_with_smooth_errors_is_distinguished_from_a_scale) {
  // 20 views determine lambda to 0.1 to 0.3 % with a robot of 0.7 mm.
  for (const ArtefactKind kind : kKinds)
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      Plan plan = plan_of(20);
      plan.robot_mm = 0.017;
      plan.smooth_mm = 0.7;
      const HandEye result = solve(kind, make(kind, plan, seed).views, plan.noise()).value();
      const auto is_scale = [](const Reason& r) { return r.code == Refusal::scale; };
      EXPECT_FALSE(std::any_of(result.reasons.begin(), result.reasons.end(), is_scale)) << seed << told(result);
    }
}

TEST(HandEye, rotation_spread_is_that_of_the_cone) {
  // A cone of 35 deg with roll has a smallest principal value of about 25 deg.
  const Set set = make(ArtefactKind::ball, plan_of(400), 1);
  EXPECT_NEAR(rotation_spread_axes_deg(set.views)[2], 24.5, 2.0);
  EXPECT_NEAR(ball_spread_axes_mm(set.views)[0], 200.0 / std::sqrt(12.0), 4.0);
}

TEST(Adjustment, derivatives_are_those_of_differences) {
  for (const ArtefactKind kind : kKinds) {
    Plan plan = plan_of(2);
    plan.balls = 2;
    const Set set = make(kind, plan, 3);
    const Equations equations(kind, set.views);
    State state{set.T_flange_scanner, set.targets};
    // Far from the solution, so that the rotation residual is not small.
    state.X.rotation = state.X.rotation * exp_rotation(Vec3(0.2, -0.1, 0.3));
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    equations.residual(1, state, r, &J);
    for (int k = 0; k < equations.parameters(); ++k) {
      const double h = 1e-5;
      const auto moved = [&](double by) {
        State other = state;
        const bool of_x = k < 6;
        const int at = of_x ? k : (k - 6) % equations.target_parameters();
        Pose& pose = of_x ? other.X : other.targets[static_cast<std::size_t>((k - 6) / equations.target_parameters())];
        if (at < 3)
          pose.translation_mm[at] += by;
        else
          pose.rotation = pose.rotation * exp_rotation(by * Vec3::Unit(at - 3));
        Eigen::VectorXd out;
        equations.residual(1, other, out, nullptr);
        return out;
      };
      const Eigen::VectorXd numeric = (moved(h) - moved(-h)) / (2.0 * h);
      EXPECT_LT((numeric - J.col(k)).norm(), 1e-6 * (1.0 + numeric.norm())) << name(kind) << " parameter " << k;
    }
  }
}

TEST(ChiSquare, sigmas_are_those_of_the_tables) {
  EXPECT_NEAR(normal_sigmas(9.0, 1), 3.0, 1e-9);
  EXPECT_NEAR(normal_sigmas(5.991, 2), 1.960, 1e-3);  // 95 %
  EXPECT_NEAR(normal_sigmas(7.815, 3), 1.960, 1e-3);
  EXPECT_NEAR(normal_sigmas(12.592, 6), 1.960, 1e-3);
  EXPECT_NEAR(normal_sigmas(22.458, 6), 3.291, 1e-3);  // 99.9 %
  EXPECT_NEAR(normal_sigmas(1e6, 3), 1000.0, 0.1);
  EXPECT_EQ(normal_sigmas(0.0, 3), 0.0);
  EXPECT_NEAR(chi_square_median(3), 2.366, 0.03);
  EXPECT_NEAR(chi_square_median(6), 5.348, 0.03);
}

}  // namespace
}  // namespace slabd::calib
