// SPDX-License-Identifier: Apache-2.0
//
// Poses with another meaning than stated are rejected, and the message contains the actual meaning.
#include "calib/conventions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "calib/hand_eye.h"
#include "tests/calib/hand_eye_scene.h"

namespace slabd::calib {
namespace {

using Change = std::function<void(View&)>;

Quat turn(int axis, double angle_rad) {
  return Quat(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::Unit(axis)));
}

struct Mistake {
  const char* what;
  bool poses_only;
  Refusal code;
  std::string named;
  Change make;
};

void transpose(Quat& q) {
  q = q.conjugate();
}

void scale_angles(View& view, double factor) {
  const KukaAbc abc = kuka_abc_from_rotation(view.T_base_flange.rotation);
  const std::array<double, 3> read = {abc.a_rad * factor, abc.b_rad * factor, abc.c_rad * factor};
  view.T_base_flange.rotation = rotation_from_kuka_abc(read[0], read[1], read[2]);
  view.reported_abc_rad = read;
}

const std::vector<Mistake>& mistakes() {
  static const std::vector<Mistake> all = {
      {"flange transposed", false, Refusal::convention, "flange rotations are transposed",
       [](View& v) { transpose(v.T_base_flange.rotation); }},
      {"flange inverted", false, Refusal::convention, "flange poses are inverted",
       [](View& v) { v.T_base_flange = v.T_base_flange.inverse(); }},
      {"target inverted", true, Refusal::convention, "target poses are inverted",
       [](View& v) { v.T_scanner_target = v.T_scanner_target.inverse(); }},
      {"target transposed", true, Refusal::convention, "target rotations are transposed",
       [](View& v) { transpose(v.T_scanner_target.rotation); }},
      {"both inverted", true, Refusal::convention, "both tables look inverted",
       [](View& v) {
         v.T_base_flange = v.T_base_flange.inverse();
         v.T_scanner_target = v.T_scanner_target.inverse();
       }},
      {"transposed and inverted", true, Refusal::convention, "transposed and the target poses inverted",
       [](View& v) {
         transpose(v.T_base_flange.rotation);
         v.T_scanner_target = v.T_scanner_target.inverse();
       }},
      {"KUKA's angles as X-Y-Z", false, Refusal::convention, "X-Y-Z of (A, B, C)",
       [](View& v) {
         const KukaAbc abc = kuka_abc_from_rotation(v.T_base_flange.rotation);
         v.T_base_flange.rotation = turn(0, abc.a_rad) * turn(1, abc.b_rad) * turn(2, abc.c_rad);
       }},
      {"X-Y-Z angles as KUKA's", false, Refusal::convention, "reported are X-Y-Z of (A, B, C)",
       [](View& v) {
         const Mat3 R = v.T_base_flange.rotation.toRotationMatrix();
         const double b = std::asin(R(0, 2));
         v.reported_abc_rad = {std::atan2(-R(1, 2), R(2, 2)), b, std::atan2(-R(0, 1), R(0, 0))};
         const std::array<double, 3>& abc = *v.reported_abc_rad;
         v.T_base_flange.rotation = rotation_from_kuka_abc(abc[0], abc[1], abc[2]);
       }},
      {"rotation vector as KUKA's angles", false, Refusal::convention, "are a rotation vector",
       [](View& v) {
         const Eigen::AngleAxisd turned{Eigen::Quaterniond(v.T_base_flange.rotation)};
         const Eigen::Vector3d r = turned.angle() * turned.axis();
         v.T_base_flange.rotation = rotation_from_kuka_abc(r[0], r[1], r[2]);
       }},
      {"x y z w", false, Refusal::convention, "flange quaternions are written x y z w",
       [](View& v) {
         const Quat q = v.T_base_flange.rotation;
         v.T_base_flange.rotation = Quat(q.x(), q.y(), q.z(), q.w());
       }},
      {"target x y z w", true, Refusal::convention, "target quaternions are written x y z w",
       [](View& v) {
         const Quat q = v.T_scanner_target.rotation;
         v.T_scanner_target.rotation = Quat(q.x(), q.y(), q.z(), q.w());
       }},
      {"radians as degrees", false, Refusal::convention, "radians that were read as degrees",
       [](View& v) { scale_angles(v, kPi / 180.0); }},
      {"degrees as radians", false, Refusal::convention, "degrees that were read as radians",
       [](View& v) { scale_angles(v, 180.0 / kPi); }},
      {"flange in metres", false, Refusal::units, "flange positions are in metres",
       [](View& v) { v.T_base_flange.translation_mm /= kMmPerM; }},
      {"target in metres", false, Refusal::units, "target positions are in metres",
       [](View& v) {
         v.T_scanner_target.translation_mm /= kMmPerM;
         for (BallObservation& seen : v.balls) seen.centre_mm /= kMmPerM;
       }},
      {"both in metres", false, Refusal::units, "metres read as millimetres",
       [](View& v) {
         v.T_base_flange.translation_mm /= kMmPerM;
         v.T_scanner_target.translation_mm /= kMmPerM;
         for (BallObservation& seen : v.balls) seen.centre_mm /= kMmPerM;
       }},
  };
  return all;
}

TEST(Conventions, every_mistake_is_refused_by_its_name) {
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose})
    for (const double robot_mm : {0.06, 0.7})
      for (const Mistake& mistake : mistakes()) {
        if (mistake.poses_only && kind == ArtefactKind::ball) continue;
        scene::Plan plan;
        plan.views = 12;
        plan.robot_mm = robot_mm;
        plan.outlier_share = 0.1;
        scene::Set set = scene::make(kind, plan, 42);
        for (View& view : set.views) mistake.make(view);
        const HandEye result = solve(kind, set.views, plan.noise()).value();
        const std::string what = std::string(name(kind)) + ", " + mistake.what;
        EXPECT_FALSE(result.ok) << what;
        ASSERT_EQ(result.reasons.size(), 1U) << what << ": " << result.reasons[0].text;
        EXPECT_EQ(result.reasons[0].code, mistake.code) << what << ": " << result.reasons[0].text;
        EXPECT_NE(result.reasons[0].text.find(mistake.named), std::string::npos)
            << what << ": " << result.reasons[0].text;
        EXPECT_FALSE(result.reasons[0].cure.empty());
      }
}

TEST(Conventions, a_line_that_is_missing_in_one_table_is_found) {
  scene::Plan plan;
  scene::Set set = scene::make(ArtefactKind::ball, plan, 7);
  for (std::size_t i = 0; i + 1 < set.views.size(); ++i) set.views[i].balls = set.views[i + 1].balls;
  set.views.pop_back();
  const HandEye result = solve(ArtefactKind::ball, set.views, plan.noise()).value();
  ASSERT_FALSE(result.reasons.empty());
  EXPECT_EQ(result.reasons[0].code, Refusal::pairing);
  EXPECT_NE(result.reasons[0].text.find("one line below"), std::string::npos) << result.reasons[0].text;
}

TEST(Conventions, right_poses_raise_no_doubt) {
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      scene::Plan plan;
      plan.outlier_share = 0.2;
      const scene::Set set = scene::make(kind, plan, seed);
      const ConventionReport report = test_conventions(kind, set.views, plan.noise());
      EXPECT_TRUE(report.stated_fits);
      EXPECT_EQ(report.fits, 0U);
    }
}

TEST(Conventions, noise_above_the_stated_noise_is_not_a_misread_convention) {
  scene::Plan plan;
  plan.robot_mm = 2.0;
  const scene::Set set = scene::make(ArtefactKind::pose, plan, 5);
  const ConventionReport report = test_conventions(ArtefactKind::pose, set.views, StatedNoise{});
  EXPECT_FALSE(report.stated_fits);
  EXPECT_EQ(report.fits, 0U);
}

TEST(Conventions, invariants_of_motions_show_where_a_mistake_is) {
  // As on a real robot: the angles agree for transposed rotations, angles and pitch agree for an inverted target. Units
  // appear in the pitch, Euler orders in the angle.
  scene::Plan plan;
  plan.views = 20;
  const scene::Set set = scene::make(ArtefactKind::pose, plan, 9);
  const auto stated = [&](const Change& change) {
    std::vector<View> views = set.views;
    for (View& view : views) change(view);
    return test_conventions(ArtefactKind::pose, views, plan.noise()).tried[0];
  };
  const Hypothesis right = stated([](View&) {});
  EXPECT_LT(right.angle_mismatch_deg, 0.02);
  EXPECT_LT(right.pitch_mismatch_mm, 0.5);
  const Hypothesis transposed = stated(mistakes()[0].make);
  EXPECT_LT(transposed.angle_mismatch_deg, 45.0);
  EXPECT_GT(transposed.pitch_mismatch_mm, 50.0);
  const Hypothesis metres = stated([](View& v) { v.T_base_flange.translation_mm /= kMmPerM; });
  EXPECT_LT(metres.angle_mismatch_deg, 0.02);
  EXPECT_GT(metres.pitch_mismatch_mm, 10.0);
}

/// Mirrors a cloud: balls as they appear in it, and the pose of an artefact as found by a rigid fit. That pose is the
/// one of the artefact's mirror image (F: a reflection of the artefact in its own plane).
void mirror(View& view, int axis) {
  Mat3 M = Mat3::Identity();
  M(axis, axis) = -1.0;
  Mat3 F = Mat3::Identity();
  F(2, 2) = -1.0;
  view.T_scanner_target.translation_mm = M * view.T_scanner_target.translation_mm;
  view.T_scanner_target.rotation = Quat(Mat3(M * view.T_scanner_target.rotation.toRotationMatrix() * F));
  for (BallObservation& seen : view.balls) seen.centre_mm = M * seen.centre_mm;
}

TEST(Conventions, a_mirrored_cloud_is_named_with_its_axis) {
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose})
    for (const int axis : {0, 1, 2})
      for (const double robot_mm : {0.06, 0.7}) {
        scene::Plan plan;
        plan.robot_mm = robot_mm;
        plan.outlier_share = 0.1;
        scene::Set set = scene::make(kind, plan, 11);
        for (View& view : set.views) mirror(view, axis);
        const HandEye result = solve(kind, set.views, plan.noise()).value();
        const std::string what = std::string(name(kind)) + ", axis " + std::to_string(axis);
        EXPECT_FALSE(result.ok) << what;
        ASSERT_EQ(result.reasons.size(), 1U) << what << ": " << result.reasons[0].text;
        EXPECT_EQ(result.reasons[0].code, Refusal::handedness) << what << ": " << result.reasons[0].text;
        // x and y differ by a half turn about z; a mirrored z places the artefact behind the scanner.
        EXPECT_NE(result.reasons[0].text.find(axis == 2 ? "z axis is mirrored" : "x axis is mirrored"),
                  std::string::npos)
            << what << ": " << result.reasons[0].text;
      }
}

TEST(Conventions, balls_in_one_plane_of_the_view_do_not_prove_the_handedness) {
  for (const bool mirrored : {false, true}) {
    scene::Plan plan;
    scene::Set set = scene::make(ArtefactKind::ball, plan, 5);
    // All views have the ball at a distance of 600 mm.
    for (View& view : set.views) {
      const double off_mm = 600.0 - view.balls[0].centre_mm.z();
      const Quat R = view.T_base_flange.rotation * set.T_flange_scanner.rotation;
      view.T_base_flange.translation_mm -= R * Vec3(0.0, 0.0, off_mm);
      view.balls[0].centre_mm.z() = 600.0;
      if (mirrored) mirror(view, 2);
    }
    const HandEye result = solve(ArtefactKind::ball, set.views, plan.noise()).value();
    EXPECT_FALSE(result.ok);
    const auto unproven = [](const Reason& reason) { return reason.code == Refusal::handedness; };
    EXPECT_TRUE(std::any_of(result.reasons.begin(), result.reasons.end(), unproven)) << mirrored;
  }
}

TEST(Conventions, targets_that_are_the_same_in_all_or_many_views_are_called_that) {
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose})
    for (const std::size_t same : {std::size_t{3}, std::size_t{7}, std::size_t{15}}) {
      scene::Plan plan;
      scene::Set set = scene::make(kind, plan, 3);
      for (std::size_t i = 1; i < same; ++i) {
        set.views[i].balls = set.views[0].balls;
        set.views[i].T_scanner_target = set.views[0].T_scanner_target;
      }
      const HandEye result = solve(kind, set.views, plan.noise()).value();
      EXPECT_FALSE(result.ok);
      ASSERT_FALSE(result.reasons.empty());
      EXPECT_EQ(result.reasons[0].code, Refusal::same_target) << result.reasons[0].text;
      EXPECT_NE(result.reasons[0].text.find("the same in " + std::to_string(same) + " views (1, 2, 3"),
                std::string::npos)
          << result.reasons[0].text;
    }
}

TEST(Conventions, one_answer_given_twice_is_a_warning_and_its_view_is_left_out) {
  scene::Plan plan;
  scene::Set set = scene::make(ArtefactKind::pose, plan, 3);
  set.views[5].T_scanner_target = set.views[4].T_scanner_target;
  const HandEye result = solve(ArtefactKind::pose, set.views, plan.noise()).value();
  EXPECT_TRUE(result.ok);
  EXPECT_EQ(result.rejected, std::vector<std::size_t>{5});
  const auto says = [](const std::string& w) { return w.find("the same in 2 views (5, 6)") != std::string::npos; };
  EXPECT_TRUE(std::any_of(result.warnings.begin(), result.warnings.end(), says));
}

TEST(Conventions, a_cure_never_proposes_what_the_table_declares) {
  // The file declares T_target_scanner but contains T_scanner_target, so the poses read are the inverse of the intended
  // ones.
  scene::Plan plan;
  scene::Set set = scene::make(ArtefactKind::pose, plan, 21);
  for (View& view : set.views) view.T_scanner_target = view.T_scanner_target.inverse();
  SolveSettings settings;
  settings.declared.flange = PoseFormat{};
  settings.declared.target = PoseFormat{.inverse = true, .declared = true};
  const HandEye result = solve(ArtefactKind::pose, set.views, plan.noise(), settings).value();
  ASSERT_EQ(result.reasons.size(), 1U);
  EXPECT_NE(result.reasons[0].text.find("holds T_scanner_target and declares T_target_scanner"), std::string::npos)
      << result.reasons[0].text;
  EXPECT_EQ(result.reasons[0].cure, "declare its content: # format: frames=T_scanner_target");

  // Declared in metres, written in millimetres.
  set = scene::make(ArtefactKind::ball, plan, 22);
  for (View& view : set.views) view.T_base_flange.translation_mm *= kMmPerM;
  settings.declared.flange = PoseFormat{.metres = true, .declared = true};
  const HandEye scaled = solve(ArtefactKind::ball, set.views, plan.noise(), settings).value();
  ASSERT_FALSE(scaled.reasons.empty());
  EXPECT_EQ(scaled.reasons[0].code, Refusal::units);
  EXPECT_EQ(scaled.reasons[0].cure, "declare what it holds: # format: unit=mm") << scaled.reasons[0].text;
}

TEST(Conventions, rows_that_slide_after_a_failed_picture_are_named_by_their_line) {
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose})
    for (const bool flange_too_many : {true, false})
      for (const std::size_t line : {std::size_t{3}, std::size_t{9}, std::size_t{15}}) {
        scene::Plan plan;
        plan.views = 20;
        const scene::Set set = scene::make(kind, plan, 17);
        // `line` has lost its target, or its flange pose; the last line of the other table is removed.
        std::vector<View> views(set.views.begin(), set.views.end() - 1);
        for (std::size_t i = line - 1; i < views.size(); ++i) {
          if (flange_too_many) {
            views[i].balls = set.views[i + 1].balls;
            views[i].T_scanner_target = set.views[i + 1].T_scanner_target;
          } else {
            views[i].T_base_flange = set.views[i + 1].T_base_flange;
          }
        }
        const HandEye result = solve(kind, views, plan.noise()).value();
        const std::string what = std::string(name(kind)) + ", line " + std::to_string(line);
        EXPECT_FALSE(result.ok) << what;
        ASSERT_FALSE(result.reasons.empty()) << what;
        EXPECT_EQ(result.reasons[0].code, Refusal::pairing) << what << ": " << result.reasons[0].text;
        const std::string row = std::to_string(line);
        const std::string said = "from line " + row + " on every target belongs to the flange pose one line " +
                                 (flange_too_many ? "below" : "above");
        EXPECT_NE(result.reasons[0].text.find(said), std::string::npos) << what << ": " << result.reasons[0].text;
      }
}

TEST(Conventions, a_reading_is_proposed_only_if_it_fits_to_the_stated_noise) {
  // Targets of another set: no reading is right, and none is proposed, including the best one.
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose})
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
      scene::Plan plan;
      scene::Set set = scene::make(kind, plan, seed);
      const scene::Set other = scene::make(kind, plan, seed + 100);
      for (std::size_t i = 0; i < set.views.size(); ++i) {
        set.views[i].balls = other.views[i].balls;
        set.views[i].T_scanner_target = other.views[i].T_scanner_target;
      }
      const HandEye result = solve(kind, set.views, plan.noise()).value();
      EXPECT_FALSE(result.ok);
      EXPECT_EQ(result.conventions.fits, 0U) << result.conventions.tried[result.conventions.fits].name;
    }
}

}  // namespace
}  // namespace slabd::calib
