// SPDX-License-Identifier: Apache-2.0
//
// Poses that mean something else than they say are refused, and the name of what they mean is given.
#include "calib/conventions.h"

#include <gtest/gtest.h>

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
         for (BallSighting& seen : v.balls) seen.centre_mm /= kMmPerM;
       }},
      {"both in metres", false, Refusal::units, "metres read as millimetres",
       [](View& v) {
         v.T_base_flange.translation_mm /= kMmPerM;
         v.T_scanner_target.translation_mm /= kMmPerM;
         for (BallSighting& seen : v.balls) seen.centre_mm /= kMmPerM;
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
  EXPECT_NE(result.reasons[0].text.find("one line below"), std::string::npos) << result.reasons[0].text;
}

TEST(Conventions, right_poses_are_not_doubted) {
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

TEST(Conventions, noise_beyond_what_is_stated_is_no_misreading) {
  scene::Plan plan;
  plan.robot_mm = 2.0;
  const scene::Set set = scene::make(ArtefactKind::pose, plan, 5);
  const ConventionReport report = test_conventions(ArtefactKind::pose, set.views, StatedNoise{});
  EXPECT_FALSE(report.stated_fits);
  EXPECT_EQ(report.fits, 0U);
}

TEST(Conventions, invariants_of_motions_show_where_a_mistake_is) {
  // As on a real robot: the angles agree although rotations are transposed, angles and pitch although the target is
  // inverted; units show in the pitch, Euler orders in the angle.
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

}  // namespace
}  // namespace slabd::calib
