// SPDX-License-Identifier: Apache-2.0
#include "calib/observations.h"

#include <gtest/gtest.h>

#include <cmath>

namespace slabd::calib {
namespace {

std::string fault(std::string_view text, TableRole role = TableRole::flange) {
  const Result<PoseTable> table = parse_poses(text, "poses.txt", role);
  return table ? "" : std::string(table.error().text.view());
}

void expect_fault(std::string_view text, const std::string& words, TableRole role = TableRole::flange) {
  EXPECT_NE(fault(text, role).find(words), std::string::npos) << "'" << fault(text, role) << "' lacks " << words;
}

TEST(Observations, neutral_form_is_read_with_comments_blank_lines_and_any_line_end) {
  const Result<PoseTable> table = parse_poses(
      "# flange\r\n\r\n1 2 3 1 0 0 0\r\n\t-4.5e1  5 6 0 0 1 0 # turned\n7 8 9 0.6 0 0 -0.8", "f", TableRole::flange);
  ASSERT_TRUE(table.ok()) << table.error().text.view();
  ASSERT_EQ(table.value().poses.size(), 3U);
  EXPECT_EQ(table.value().lines, (std::vector<std::size_t>{3, 4, 5}));
  EXPECT_EQ(table.value().poses[1].translation_mm, Vec3(-45, 5, 6));
  EXPECT_EQ(table.value().poses[2].rotation.z(), -0.8);
  EXPECT_FALSE(table.value().format.declared);
}

TEST(Observations, every_fault_names_file_and_line) {
  expect_fault("1 2 3 1 0 0\n", "poses.txt:1: 6 numbers");
  expect_fault("# a\n1 2 3 1 0 0 0 9\n", "poses.txt:2: '9' after 7 numbers");
  expect_fault("1 2 3 1 0 0 0\n1 2 x 1 0 0 0\n", "poses.txt:2: number 3 is 'x'");
  expect_fault("1 2 3 1 0 0 0\n1 2 nan 1 0 0 0\n", "poses.txt:2: number 3 is 'nan'");
  expect_fault("inf 2 3 1 0 0 0\n", "poses.txt:1: number 1 is 'inf'");
  expect_fault("1,2,3,1,0,0,0\n", "poses.txt:1: number 1");
  expect_fault("1,5 2 3 1 0 0 0\n", "decimal points");
  expect_fault("1 2 3 1 0.1 0 0\n", "poses.txt:1: the quaternion (numbers 4 to 7) has length 1.004988");
  expect_fault("1 2 3 0 0 0 0\n", "length 0.000000");
  expect_fault("1500000 2 3 1 0 0 0\n", "poses.txt:1: a position of 1500 m");
  expect_fault("", "no pose in it");
  expect_fault("# only words\n", "no pose in it");
  expect_fault(std::string("1 2 3 1 0 0 0\n\0", 15), "poses.txt:2");
}

TEST(Observations, header_declares_and_is_never_guessed_around) {
  expect_fault("# format: rotation=kuka_abc unit=mm\n1 2 3 4 5 6\n", "needs unit=mm|m and angle=deg|rad");
  expect_fault("# format: rotation=euler\n", "rotation= is one of quaternion_wxyz");
  expect_fault("# format: unit=inch\n", "unit= is one of mm, m");
  expect_fault("# format: units=mm\n", "'units' is not a key");
  expect_fault("# format: angle=deg\n1 2 3 1 0 0 0\n", "angle= is only valid with rotation=kuka_abc");
  expect_fault("# format: unit=mm\n# format: unit=m\n", "poses.txt:2: a second format line");
  expect_fault("1 2 3 1 0 0 0\n# format: unit=m\n", "poses.txt:2: the format line must be before");
  expect_fault("# format: frames=T_scanner_target\n", "T_base_flange, T_flange_base");
  expect_fault("# format: labels=view,ball\n", "target table");
  expect_fault("# format: rotation=none\n1 2 3\n", "rotation=none is for ball centres");
  expect_fault("# format: rotation=none frames=T_target_scanner\n1 2 3\n", "cannot be inverted", TableRole::target);
}

TEST(Observations, units_orders_and_directions_are_converted) {
  const Pose pose{rotation_from_kuka_abc(0.4, -0.7, 1.1), Vec3(120, -30, 900)};
  for (const RotationForm form : {RotationForm::quaternion_wxyz, RotationForm::quaternion_xyzw, RotationForm::kuka_abc})
    for (const bool metres : {false, true})
      for (const bool inverse : {false, true})
        for (const bool radians : {false, true}) {
          if (radians && form != RotationForm::kuka_abc) continue;
          PoseFormat format;
          format.rotation = form;
          format.metres = metres;
          format.inverse = inverse;
          format.radians = radians;
          const std::vector<Pose> poses = {pose, pose.inverse()};
          const std::string text = write_poses(poses, format, TableRole::flange);
          const Result<PoseTable> back = parse_poses(text, "f", TableRole::flange);
          ASSERT_TRUE(back.ok()) << text << back.error().text.view();
          for (std::size_t i = 0; i < 2; ++i) {
            EXPECT_LT((back.value().poses[i].translation_mm - poses[i].translation_mm).norm(), 1e-9) << text;
            EXPECT_LT(angle_between_rad(back.value().poses[i].rotation, poses[i].rotation), 1e-12) << text;
          }
        }
}

TEST(Observations, neutral_form_restores_the_same_bits) {
  Prng random(4);
  std::vector<Pose> poses;
  for (int i = 0; i < 50; ++i) {
    std::array<double, 7> v{};
    for (double& x : v) x = 100.0 * random.normal();
    poses.push_back(Pose::from_array(v));
  }
  const Result<PoseTable> back = parse_poses(write_poses(poses, {}, TableRole::target), "t", TableRole::target);
  ASSERT_TRUE(back.ok());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::array<double, 7> was = poses[i].to_array();
    EXPECT_EQ(back.value().written[i], was);
  }
}

TEST(Observations, counts_of_both_tables_must_agree) {
  const PoseTable two = parse_poses("1 2 3 1 0 0 0\n4 5 6 1 0 0 0\n", "f", TableRole::flange).value();
  const PoseTable one = parse_poses("1 2 3 1 0 0 0\n", "t", TableRole::target).value();
  const auto views = views_from(ArtefactKind::pose, two, "flange.txt", one, "target.txt");
  ASSERT_FALSE(views.ok());
  EXPECT_NE(views.error().text.view().find("flange.txt has 2 poses, target.txt has 1"), std::string_view::npos);
  EXPECT_TRUE(views_from(ArtefactKind::pose, two, "f", two, "t").ok());
}

TEST(Observations, several_balls_are_identified_by_their_labels) {
  const PoseTable flange = parse_poses("1 2 3 1 0 0 0\n4 5 6 1 0 0 0\n", "f", TableRole::flange).value();
  const std::string header = "# format: rotation=none labels=view,ball\n";
  const auto read = [&](const std::string& lines) {
    const Result<PoseTable> target = parse_poses(header + lines, "t.txt", TableRole::target);
    if (!target) return Result<std::vector<View>>(target.error());
    return views_from(ArtefactKind::ball, flange, "f.txt", target.value(), "t.txt");
  };
  const auto views = read("2 1 0 0 500\n1 2 10 0 500\n1 1 0 10 500\n");
  ASSERT_TRUE(views.ok()) << views.error().text.view();
  EXPECT_EQ(views.value()[0].balls.size(), 2U);
  EXPECT_EQ(views.value()[0].balls[0].ball, 1U);
  EXPECT_EQ(views.value()[1].balls[0].centre_mm, Vec3(0, 0, 500));
  const auto says = [&](const std::string& lines, std::string_view words) {
    const auto result = read(lines);
    ASSERT_FALSE(result.ok()) << lines;
    EXPECT_NE(result.error().text.view().find(words), std::string_view::npos) << result.error().text.view();
  };
  says("1 1 0 0 500\n3 1 0 0 500\n", "t.txt:3: view 3, but f.txt has 2 poses");
  says("1 1 0 0 500\n1 1 0 0 500\n2 1 0 0 1\n", "t.txt:3: ball 1 for the second time in view 1");
  const auto gap = read("2 1 0 0 500\n");
  ASSERT_TRUE(gap.ok()) << gap.error().text.view();
  ASSERT_EQ(gap.value().size(), 1U);  // the first pose has no sighting; the second keeps its number
  EXPECT_EQ(gap.value()[0].number, 2U);
  EXPECT_EQ(gap.value()[0].T_base_flange.translation_mm, Vec3(4, 5, 6));
  says("1 1 0 0 500\n2 3 0 0 500\n", "ball 2 is never seen");
  says("0 1 0 0 500\n", "the view is '0'");
  says("1 99 0 0 500\n", "the ball is '99'");
}

TEST(Observations, ball_centres_are_not_poses) {
  const PoseTable flange = parse_poses("1 2 3 1 0 0 0\n", "f", TableRole::flange).value();
  const PoseTable balls = parse_poses("# format: rotation=none\n1 2 3\n", "t", TableRole::target).value();
  EXPECT_TRUE(views_from(ArtefactKind::ball, flange, "f", balls, "t").ok());
  EXPECT_FALSE(views_from(ArtefactKind::pose, flange, "f", balls, "t").ok());
}

TEST(Observations, kuka_angles_come_back_everywhere_also_at_the_pole_and_the_seam) {
  const auto back = [](double a, double b, double c) {
    const Quat q = rotation_from_kuka_abc(rad_from_deg(a), rad_from_deg(b), rad_from_deg(c));
    const KukaAbc abc = kuka_abc_from_rotation(q);
    EXPECT_LE(std::abs(abc.b_rad), kPi / 2 + 1e-12);
    return angle_between_rad(q, rotation_from_kuka_abc(abc.a_rad, abc.b_rad, abc.c_rad));
  };
  Prng random(9);
  for (int i = 0; i < 2000; ++i) {
    const double a = 360.0 * random.uniform() - 180.0;
    const double c = 360.0 * random.uniform() - 180.0;
    for (const double b : {180.0 * random.uniform() - 90.0, 90.0, -90.0, 90.0 - 1e-7, -90.0 + 1e-5, 90.0 - 1e-3})
      EXPECT_LT(back(a, b, c), 1e-14) << a << " " << b << " " << c;
  }
  for (const double a : {180.0, -180.0, 179.9999999, -179.9999999})
    for (const double c : {180.0, -180.0, 179.9999999, 0.0}) EXPECT_LT(back(a, 10.0, c), 1e-14);
  const KukaAbc abc = kuka_abc_from_rotation(rotation_from_kuka_abc(0.1, 0.2, 0.3));
  EXPECT_NEAR(abc.a_rad, 0.1, 1e-15);
  EXPECT_NEAR(abc.b_rad, 0.2, 1e-15);
  EXPECT_NEAR(abc.c_rad, 0.3, 1e-15);
}

TEST(Observations, wrapped_angles_are_the_same_rotation) {
  const std::string header = "# format: rotation=kuka_abc unit=mm angle=deg\n";
  const PoseTable table =
      parse_poses(header + "0 0 0 180 0 -180\n0 0 0 -180 0 180\n0 0 0 540 360 -180\n", "f", TableRole::flange).value();
  for (std::size_t i = 1; i < 3; ++i)
    EXPECT_LT(angle_between_rad(table.poses[0].rotation, table.poses[i].rotation), 1e-12);
}

TEST(Observations, a_whole_log_is_refused) {
  std::string text;
  for (std::size_t i = 0; i <= kViewsMax; ++i) text += "1 2 3 1 0 0 0\n";
  expect_fault(text, "poses.txt:401: more than 400 views");
}

}  // namespace
}  // namespace slabd::calib
