// SPDX-License-Identifier: Apache-2.0
#include "calib/tie.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "base/prng.h"
#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

/// Two robots on the two sides of a slab measure balls around it. The geometry is independent of the solver's code.
struct Cell {
  std::vector<Vec3> balls_mm = {{-2600, 900, 100}, {-2600, 2100, 250}, {-900, 800, 300}, {-900, 2200, 100},
                                {900, 850, 150},   {900, 2150, 300},   {2600, 950, 250}, {2600, 2050, 100}};
  std::size_t views = 6;  ///< of each ball by each robot
  double tilt_rad = rad_from_deg(25.0);
  double noise = 1.0;  ///< factor of the true noise over the stated one
  StatedNoise stated;
  HandEyeNumbers hand_eye;          ///< sigmas: of the true error of each hand-eye calibration
  bool robot_stands_still = false;  ///< all views of a ball from one pose, with one error of the robot
  double shared = 0.0;              ///< part of the variance of the robot's position that all poses at a ball share
};

Pose pose(const Vec3& translation_mm, const Vec3& turn_rad) {
  Pose out;
  out.translation_mm = translation_mm;
  out.rotation = exp_rotation(turn_rad);
  return out;
}

const Pose kTruth = pose({120.0, 3'050.0, -15.0}, Vec3(0.002, -0.001, kPi - 0.01));

Vec3 normal3(Prng& prng) {
  const double x = prng.normal();
  const double y = prng.normal();
  const double z = prng.normal();
  return {x, y, z};
}

TieArm arm_of(const Cell& cell, const Pose& T_line_robot, Prng& prng) {
  const Pose T_flange_scanner = pose({60.0, -20.0, 180.0}, {0.01, 0.02, 0.7});
  TieArm arm;
  arm.noise = cell.stated;
  arm.hand_eye = cell.hand_eye;
  const double shift_mm = has_value(cell.hand_eye.sigma_mm) ? cell.hand_eye.sigma_mm : 0.0;
  const double turn_rad = has_value(cell.hand_eye.sigma_rad) ? cell.hand_eye.sigma_rad : 0.0;
  // The error of the scanner's place is that of a point in the middle of its view.
  const Vec3 middle_mm(0.0, 0.0, 500.0);
  const Quat turn = exp_rotation(turn_rad * normal3(prng));
  Pose wrong = T_flange_scanner;
  wrong.rotation = T_flange_scanner.rotation * turn;
  wrong.translation_mm = T_flange_scanner * middle_mm - wrong.rotation * middle_mm + shift_mm * normal3(prng);
  arm.hand_eye.T_flange_scanner = wrong;
  for (std::size_t ball = 0; ball < cell.balls_mm.size(); ++ball) {
    const Vec3 p = T_line_robot.inverse() * cell.balls_mm[ball];
    Pose T_base_flange;
    Pose reported;
    const Vec3 at_ball_mm =
        cell.shared > 0.0 ? Vec3(std::sqrt(cell.shared) * cell.stated.robot_mm * normal3(prng)) : Vec3(Vec3::Zero());
    for (std::size_t view = 0; view < cell.views; ++view) {
      if (view == 0 || !cell.robot_stands_still) {
        const double tilt = cell.tilt_rad * prng.uniform();
        const double towards = 2.0 * kPi * prng.uniform();
        const Quat look = exp_rotation(Vec3(tilt * std::cos(towards), tilt * std::sin(towards), 0.0)) *
                          exp_rotation(Vec3(kPi, 0.0, 0.0));
        Pose T_base_scanner;
        T_base_scanner.rotation = look;
        T_base_scanner.translation_mm = p - look * Vec3(30.0 * normal3(prng) + middle_mm);
        T_base_flange = T_base_scanner * T_flange_scanner.inverse();
        const Quat robot_turn = exp_rotation(cell.noise * cell.stated.robot_rad * normal3(prng));
        reported.rotation = robot_turn * T_base_flange.rotation;
        reported.translation_mm = T_base_flange.translation_mm + at_ball_mm +
                                  std::sqrt(1.0 - cell.shared) * cell.noise * cell.stated.robot_mm * normal3(prng);
      }
      const Vec3 centre = (T_base_flange * T_flange_scanner).inverse() * p;
      arm.sightings.push_back({ball, reported, centre + cell.noise * cell.stated.target_mm * normal3(prng)});
    }
  }
  return arm;
}

struct Arms {
  TieArm first;
  TieArm second;
};
Arms arms_of(const Cell& cell, std::uint64_t seed) {
  Prng prng(seed);
  Arms arms;
  arms.first = arm_of(cell, Pose::identity(), prng);
  arms.second = arm_of(cell, kTruth, prng);
  return arms;
}
Tie solved(const Arms& arms) {
  const Result<Tie> tie = solve_tie(arms.first, arms.second);
  EXPECT_TRUE(tie.ok());
  return tie.ok() ? tie.value() : Tie{};
}
Tie solved(const Cell& cell, std::uint64_t seed) {
  return solved(arms_of(cell, seed));
}

/// Small motion from the stated base of the second robot to the true one, about the tie's centre.
Vec6 error_of(const TieNumbers& tie) {
  const Pose off = kTruth * tie.T_base_robot.inverse();
  Vec6 motion;
  motion.head<3>() = off * tie.centre_mm - tie.centre_mm;
  motion.tail<3>() = log_rotation(off.rotation);
  return motion;
}

/// Share of seeds whose true motion is within the 95 % ellipsoid of the covariance.
double coverage(const Cell& cell, std::uint64_t seeds) {
  constexpr double kChiSquare95 = 12.5916;  // six degrees of freedom
  std::uint64_t inside = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const TieNumbers tie = solved(cell, seed).numbers;
    const Vec6 motion = error_of(tie);
    const Eigen::MatrixXd solution =
        solve_symmetric(Eigen::MatrixXd(tie.covariance), Eigen::MatrixXd(Eigen::VectorXd(motion)));
    inside += motion.dot(Vec6(solution.col(0))) <= kChiSquare95 ? 1U : 0U;
  }
  return static_cast<double>(inside) / static_cast<double>(seeds);
}

bool refused_for(const Tie& tie, TieRefusal code) {
  for (const TieReason& reason : tie.reasons)
    if (reason.code == code) return true;
  return false;
}

TEST(Tie, finds_the_base_of_the_second_robot) {
  const Tie tie = solved(Cell{}, 1);
  EXPECT_TRUE(tie.ok) << (tie.reasons.empty() ? "" : tie.reasons[0].text);
  ASSERT_TRUE(tie.determined);
  EXPECT_LT(error_of(tie.numbers).head<3>().norm(), 0.1);
  EXPECT_LT(error_of(tie.numbers).tail<3>().norm(), 1e-4);
  EXPECT_EQ(tie.numbers.targets, 8);
  EXPECT_EQ(tie.targets.size(), 8U);
  EXPECT_TRUE(tie.seen_by_one.empty());
  EXPECT_EQ(tie.degrees_of_freedom, 3 * 96 - 3 * 8 - 6);
  EXPECT_NEAR(tie.s0, 1.0, 0.3);
  EXPECT_GT(tie.leave_one_out_mm.rms, tie.residual_mm.rms);
  EXPECT_NEAR(tie.numbers.rms_mm, tie.residual_mm.rms, 1e-12);
  EXPECT_LT(tie.condition, kTieConditionMax);
  EXPECT_GT(tie.spread_axes_mm[0], tie.spread_axes_mm[1]);
}

TEST(Tie, the_same_sightings_give_the_same_bits) {
  const Tie a = solved(Cell{}, 2);
  const Tie b = solved(Cell{}, 2);
  EXPECT_EQ(a.numbers.T_base_robot.to_array(), b.numbers.T_base_robot.to_array());
  EXPECT_TRUE(a.numbers.covariance == b.numbers.covariance);
}

TEST(Tie, the_true_motion_is_within_the_covariance) {
  const double share = coverage(Cell{}, 2'000);
  EXPECT_GE(share, 0.935);
  EXPECT_LE(share, 0.97);
}

TEST(Tie, errors_of_both_hand_eye_calibrations_are_covered) {
  Cell cell;
  cell.hand_eye.sigma_mm = 0.08;
  cell.hand_eye.sigma_rad = 1e-4;
  EXPECT_GE(coverage(cell, 1'000), 0.935);
  // More views do not reduce the part of the two hand-eye calibrations.
  cell.views = 96 / cell.balls_mm.size();
  const Mat6 covariance = solved(cell, 1).numbers.covariance;
  for (int axis = 0; axis < 3; ++axis) EXPECT_GE(std::sqrt(covariance(axis, axis)), std::sqrt(2.0) * 0.08);
}

TEST(Tie, views_from_one_place_repeat_the_robots_error) {
  Cell still;
  still.robot_stands_still = true;
  Cell once = still;
  once.views = 1;
  const double many = tie_sigma_mm(solved(still, 3).numbers, Vec3::Zero());
  const double one = tie_sigma_mm(solved(once, 3).numbers, Vec3::Zero());
  EXPECT_GT(many, 0.8 * one);
  EXPECT_GE(coverage(still, 1'500), 0.935);
  // Repeats neither make a ball look moved, nor hide a robot that is worse than stated.
  for (const std::size_t views : {2U, 4U, 8U}) {
    still.views = views;
    int refused = 0;
    for (std::uint64_t seed = 1; seed <= 200; ++seed) refused += solved(still, seed).ok ? 0 : 1;
    EXPECT_LE(refused, 2) << views << " views";
  }
  still.views = 6;
  still.noise = 2.0;
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) sum += solved(still, seed).s0 / 200.0;
  EXPECT_NEAR(sum, 2.0, 0.3);
}

// A robot's error is smooth over the cell, so that the views of one ball do not average it out.
TEST(Tie, an_error_that_neighbouring_poses_share_is_in_the_covariance_and_moves_no_ball) {
  Cell cell;
  cell.stated.robot_mm = 0.7;
  cell.shared = 0.8;
  for (const std::size_t views : {3U, 6U, 10U}) {
    cell.views = views;
    int refused = 0;
    for (std::uint64_t seed = 1; seed <= 200; ++seed) refused += solved(cell, seed).ok ? 0 : 1;
    EXPECT_LE(refused, 20) << views << " views";
    EXPECT_GE(coverage(cell, 500), 0.8) << views << " views";
  }
}

TEST(Tie, a_ball_that_was_moved_is_named) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Cell cell;
    cell.views = 3;
    Arms arms = arms_of(cell, seed);
    const std::size_t ball = seed % cell.balls_mm.size();
    Prng prng(seed + 1'000);
    const Vec3 moved_mm = 0.8 * normal3(prng).normalized();
    for (TieSighting& sighting : arms.second.sightings) {
      if (sighting.target != ball) continue;
      const Pose T = sighting.T_base_flange * arms.second.hand_eye.T_flange_scanner;
      sighting.centre_mm = T.inverse() * Vec3(T * sighting.centre_mm + moved_mm);
    }
    const Tie tie = solved(arms);
    EXPECT_FALSE(tie.ok);
    ASSERT_TRUE(refused_for(tie, TieRefusal::target_moved)) << "seed " << seed;
    EXPECT_NE(tie.reasons[0].text.find("ball " + std::to_string(ball + 1) + " "), std::string::npos)
        << "seed " << seed << ": " << tie.reasons[0].text;
    EXPECT_TRUE(has_value(tie.residual_mm.max));
    EXPECT_TRUE(tie.numbers.T_base_robot.all_finite());
  }
}

TEST(Tie, two_balls_that_were_moved_do_not_hide_each_other) {
  int accepted = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    Cell cell;
    Arms arms = arms_of(cell, seed);
    Prng prng(seed + 1'000);
    const std::array<Vec3, 2> moved_mm = {0.8 * normal3(prng).normalized(), 0.8 * normal3(prng).normalized()};
    for (TieSighting& sighting : arms.second.sightings) {
      if (sighting.target > 1) continue;
      const Pose T = sighting.T_base_flange * arms.second.hand_eye.T_flange_scanner;
      sighting.centre_mm = T.inverse() * Vec3(T * sighting.centre_mm + moved_mm.at(sighting.target));
    }
    accepted += solved(arms).ok ? 1 : 0;
  }
  EXPECT_LE(accepted, 15);
}

TEST(Tie, honest_sets_are_accepted) {
  int refused = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Cell cell;
    cell.views = 2;
    refused += solved(cell, seed).ok ? 0 : 1;
  }
  EXPECT_LE(refused, 1);
}

TEST(Tie, targets_on_a_line_are_refused) {
  Cell cell;
  cell.balls_mm = {{-2600, 1500, 200}, {-1200, 1500, 200}, {0, 1500, 200}, {1300, 1500, 200}, {2600, 1500, 200}};
  const Tie line = solved(cell, 1);
  EXPECT_FALSE(line.ok);
  EXPECT_TRUE(refused_for(line, TieRefusal::targets_on_a_line));
  for (std::size_t i = 0; i < cell.balls_mm.size(); ++i) cell.balls_mm[i].y() += i % 2 == 0 ? 40.0 : -40.0;
  const Tie nearly = solved(cell, 1);
  EXPECT_FALSE(nearly.ok);
  EXPECT_TRUE(refused_for(nearly, TieRefusal::targets_on_a_line)) << nearly.condition;
  EXPECT_TRUE(has_value(nearly.condition));
  EXPECT_TRUE(has_value(nearly.residual_mm.rms));
}

TEST(Tie, too_few_targets_are_refused_with_the_figures_there_are) {
  Cell cell;
  const std::vector<Vec3> all = cell.balls_mm;
  for (const std::size_t count : {std::size_t{1}, std::size_t{2}, std::size_t{3}}) {
    cell.balls_mm.assign(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(count));
    const Tie tie = solved(cell, 1);
    EXPECT_FALSE(tie.ok);
    EXPECT_TRUE(refused_for(tie, TieRefusal::too_few_targets));
    EXPECT_EQ(tie.numbers.targets, count);
    EXPECT_EQ(tie.determined, count == 3);
    EXPECT_EQ(has_value(tie.s0), count == 3);
  }
  // A ball of one robot only does not count.
  cell.balls_mm.assign(all.begin(), all.begin() + 4);
  Arms arms = arms_of(cell, 1);
  std::erase_if(arms.second.sightings, [](const TieSighting& sighting) { return sighting.target == 2; });
  const Tie tie = solved(arms);
  EXPECT_EQ(tie.seen_by_one, std::vector<std::size_t>{2});
  EXPECT_TRUE(refused_for(tie, TieRefusal::too_few_targets));
}

TEST(Tie, residuals_far_above_the_stated_noise_are_refused) {
  Cell cell;
  cell.noise = 5.0;
  const Tie tie = solved(cell, 1);
  EXPECT_FALSE(tie.ok);
  EXPECT_TRUE(refused_for(tie, TieRefusal::noise_above_stated));
  EXPECT_NEAR(tie.s0, 5.0, 1.0);
  // A noise twice the stated one is covered by the factor s0.
  cell.noise = 2.0;
  EXPECT_GE(coverage(cell, 1'500), 0.935);
}

TEST(Tie, uncertainty_grows_away_from_the_targets) {
  Cell cell;
  for (Vec3& ball : cell.balls_mm) ball.x() *= 0.1;
  const TieNumbers tie = solved(cell, 1).numbers;
  EXPECT_GT(tie_sigma_mm(tie, tie.centre_mm + Vec3(2'500.0, 0.0, 0.0)), 2.0 * tie_sigma_mm(tie, tie.centre_mm));
  EXPECT_NEAR(tie_sigma_mm(tie, tie.centre_mm), std::sqrt(tie.covariance.topLeftCorner<3, 3>().trace()), 1e-12);
}

TEST(Tie, invalid_input_is_an_error) {
  const Arms good = arms_of(Cell{}, 1);
  Arms arms = good;
  arms.second.sightings.clear();
  EXPECT_FALSE(solve_tie(arms.first, arms.second).ok());
  arms = good;
  arms.first.sightings[0].centre_mm.x() = kNoValue;
  EXPECT_FALSE(solve_tie(arms.first, arms.second).ok());
  arms = good;
  arms.first.noise.robot_mm = -1.0;
  EXPECT_FALSE(solve_tie(arms.first, arms.second).ok());
  arms = good;
  arms.first.noise.robot_mm = arms.first.noise.target_mm = 0.0;
  EXPECT_FALSE(solve_tie(arms.first, arms.second).ok());
  arms = good;
  arms.first.sightings[0].target = kBallsMax;
  EXPECT_FALSE(solve_tie(arms.first, arms.second).ok());
}

std::vector<View> views_of(std::initializer_list<std::size_t> balls) {
  std::vector<View> views;
  for (const std::size_t ball : balls) {
    View view;
    view.balls.push_back({ball, Vec3(0.0, 0.0, 500.0), {}});
    views.push_back(view);
  }
  return views;
}

std::vector<std::size_t> targets_of(const Result<std::vector<TieSighting>>& sightings) {
  std::vector<std::size_t> targets;
  if (sightings.ok())
    for (const TieSighting& sighting : sightings.value()) targets.push_back(sighting.target);
  return targets;
}

TEST(Tie, balls_are_distinguished_by_name_by_label_or_by_order) {
  using Numbers = std::vector<std::size_t>;
  std::vector<std::string> known;
  EXPECT_EQ(targets_of(tie_sightings(views_of({0, 0, 0}), false, {}, known)), (Numbers{0, 1, 2}));
  EXPECT_EQ(targets_of(tie_sightings(views_of({2, 0}), true, {}, known)), (Numbers{2, 0}));
  EXPECT_EQ(known, (std::vector<std::string>{"1", "2", "3"}));
  known.clear();
  const std::vector<std::string> first = {"north", "south", "north"};
  const std::vector<std::string> second = {"south", "west", "north"};
  EXPECT_EQ(targets_of(tie_sightings(views_of({0, 0, 0}), false, first, known)), (Numbers{0, 1, 0}));
  EXPECT_EQ(targets_of(tie_sightings(views_of({0, 0, 0}), false, second, known)), (Numbers{1, 2, 0}));
  EXPECT_FALSE(tie_sightings(views_of({0, 0}), false, first, known).ok());
  EXPECT_FALSE(tie_sightings(views_of({0, 0, 0}), true, first, known).ok());
}

TEST(Tie, names_of_targets_are_one_a_line) {
  EXPECT_EQ(parse_target_names("# balls\nnorth\n  south east \r\n\nwest # the new one\nup"),
            (std::vector<std::string>{"north", "south east", "west", "up"}));
  EXPECT_TRUE(parse_target_names("").empty());
}

TEST(Tie, every_refusal_has_a_word) {
  EXPECT_EQ(name(TieRefusal::too_few_targets), "too_few_targets");
  EXPECT_EQ(name(TieRefusal::not_converged), "not_converged");
}

}  // namespace
}  // namespace slabd::calib
