// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "base/prng.h"
#include "cli/stations/krl.h"
#include "cli/stations/station_plan.h"
#include "tests/config/reference_recipe.h"

namespace slabd::cli {
namespace {

const Recipe& recipe() {
  static const Recipe kRecipe = reference_recipe();
  return kRecipe;
}

const Pose kSlab{rotation_from_kuka_abc(0.2, 0.01, -0.02), Vec3(1800.0, 150.0, 300.0)};
const Pose kHandEye{rotation_from_kuka_abc(0.4, -0.1, 0.05), Vec3(12.0, 80.0, 150.0)};

std::vector<Pose> plan() {
  std::vector<Pose> poses;
  for (int k = 1; k <= recipe().stations(); ++k)
    poses.push_back(planned_flange(recipe(), kSlab, kHandEye, nominal_T_block_scanner(), k));
  return poses;
}

Stops stops_of(const std::vector<Pose>& poses) {
  Stops stops;
  for (const Pose& pose : poses) stops[static_cast<int>(stops.size()) + 1] = pose;
  return stops;
}

TEST(KrlPoints, a_written_pose_is_read_back_as_the_same_pose) {
  Prng prng(7);
  std::vector<Pose> poses = plan();
  for (Pose& pose : poses)
    pose.rotation =
        rotation_from_kuka_abc(6.2 * prng.uniform() - 3.1, 3.1 * prng.uniform() - 1.55, 6.2 * prng.uniform() - 3.1);
  poses[3].rotation = rotation_from_kuka_abc(1.0, kPi / 2.0, 0.3);  // B at 90 degrees
  const Result<std::vector<Pose>> back = parse_krl_points(krl_data_list("PTS", 2, stops_of(poses)), "PTS.dat");
  ASSERT_TRUE(back.ok()) << back.error().text.view();
  ASSERT_EQ(back.value().size(), poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    EXPECT_LT((back.value()[k].translation_mm - poses[k].translation_mm).norm(), 1e-4) << k;
    EXPECT_LT(angle_between_rad(back.value()[k].rotation, poses[k].rotation), rad_from_deg(2e-6)) << k;
  }
}

TEST(KrlPoints, the_files_of_several_sets_can_be_on_one_controller) {
  const Stops poses = stops_of(plan());
  for (int set = 1; set <= 4; ++set) {
    const std::string name = "SLABPTS" + std::to_string(set);
    const std::string array = "STATION" + std::to_string(set);
    const std::string list = krl_data_list(name, set, poses);
    EXPECT_NE(list.find("DECL GLOBAL FRAME " + array + "[18]\n"), std::string::npos) << list;
    EXPECT_NE(list.find("\n" + array + "[18]={X "), std::string::npos) << list;
    EXPECT_EQ(list.find("STATION["), std::string::npos) << "a global name of all sets";
    const std::string program = krl_program(name, set, poses, recipe().stations());
    EXPECT_NE(program.find("DEF " + name + "( )\n"), std::string::npos) << program;
    EXPECT_NE(program.find("PTP " + array + "[k]\n"), std::string::npos) << program;
    EXPECT_NE(program.find("IF (k == 0) OR (k == 18) THEN\n      EXIT\n"), std::string::npos)
        << "a call that never returns: " << program;
  }
}

TEST(KrlPoints, a_robot_that_shares_the_slab_halts_at_the_stations_of_the_other_one) {
  const Stops all = stops_of(plan());
  const auto part = [&](const std::vector<int>& stations) {
    Stops stops;
    for (const int station : stations) stops[station] = all.at(station);
    return stops;
  };
  struct Case {
    std::vector<int> stations;
    const char* halt;
  };
  for (const Case& c :
       {Case{{10, 11, 12, 13, 14, 15, 16, 17, 18}, "((k >= 1) AND (k <= 9)) OR (k > 18)"}, Case{{1, 2, 3}, "k > 3"},
        Case{{2, 4, 5, 9}, "(k == 1) OR (k == 3) OR ((k >= 6) AND (k <= 8)) OR (k > 9)"}}) {
    const Stops stops = part(c.stations);
    const std::string program = krl_program("PTS", 1, stops, recipe().stations());
    EXPECT_NE(program.find("    IF " + std::string(c.halt) + " THEN\n      HALT\n"), std::string::npos) << program;
    EXPECT_NE(program.find("    IF k == 0 THEN\n      EXIT\n"), std::string::npos)
        << "the other robot may have the last station: " << program;
    const std::string list = krl_data_list("PTS", 1, stops);
    EXPECT_NE(list.find("STATION1[" + std::to_string(c.stations.back()) + "]\n"), std::string::npos) << list;
    const Result<Stops> back = parse_krl_stops(list, "PTS.dat");
    ASSERT_TRUE(back.ok()) << back.error().text.view();
    std::vector<int> stations;
    for (const auto& [station, pose] : back.value()) stations.push_back(station);
    EXPECT_EQ(stations, c.stations);
  }
}

TEST(KrlPoints, points_as_the_controller_writes_them_are_read) {
  const char* text =
      "&ACCESS RVO1\r\nDEFDAT PTS PUBLIC\r\nDECL GLOBAL E6POS STATION[2]\r\n"
      "station[2]={x 1.5,y -2.0,z +3.0,a 90.0,b 0.0,c -180.0,s 2,t 35,e1 0.0}\r\n"
      ";STATION[9]={X 0}\r\nSTATION[1] = {X 1800.0, Y 0.0, Z 9.0E2, A 0.0, B 0.0, C 0.0}  ; first\r\nENDDAT\r\n";
  const Result<std::vector<Pose>> points = parse_krl_points(text, "PTS.dat");
  ASSERT_TRUE(points.ok()) << points.error().text.view();
  ASSERT_EQ(points.value().size(), 2U);
  EXPECT_EQ(points.value()[0].translation_mm, Vec3(1800.0, 0.0, 900.0));
  EXPECT_LT(angle_between_rad(points.value()[1].rotation, rotation_from_kuka_abc(kPi / 2, 0.0, -kPi)), 1e-12);
}

TEST(KrlPoints, errors_are_named_with_their_line) {
  const struct {
    const char* text;
    const char* told;
  } cases[] = {
      {"STATION[1]={X 1,Y 2,Z 3,A 4,B 5}", "f:1: C is missing"},
      {"\nSTATION[1]={X 1,Y 2,Z 3,A 4,B 5,C nan}", "f:2: C is missing or is not a number"},
      {"STATION[1]={X 1e6,Y 2,Z 3,A 4,B 5,C 6}", "f:1: X is 1000000, allowed"},
      {"STATION[1]={X 1,Y 2,Z 3,A 4,B 5,C 6", "closing brace"},
      {"STATION[19]={X 1,Y 2,Z 3,A 4,B 5,C 6}", "station 19, allowed 1..18"},
      {"STATION[2]={X 1,Y 2,Z 3,A 4,B 5,C 6}", "station 1 is missing"},
      {"STATION[1]={X 1,Y 2,Z 3,A 4,B 5,C 6}\nSTATION[1]={X 1,Y 2,Z 3,A 4,B 5,C 6}", "f:2: station 1 is there twice"},
      {"", "no line like"},
  };
  for (const auto& c : cases) {
    const Result<std::vector<Pose>> points = parse_krl_points(c.text, "f");
    ASSERT_FALSE(points.ok()) << c.text;
    EXPECT_NE(points.error().text.view().find(c.told), std::string_view::npos) << points.error().text.view();
  }
}

TEST(StationPlan, everything_the_recipe_measures_is_seen_from_the_planned_poses) {
  const std::vector<Pose> poses = plan();
  for (int k = 1; k <= recipe().stations(); ++k) {
    const StationView view =
        look_at(recipe(), ScannerView{}, kSlab, kHandEye, poses[static_cast<std::size_t>(k - 1)], k);
    EXPECT_TRUE(view.ok(10.0)) << k;
    EXPECT_LT(view.off_axis_mm, 1e-6);
    EXPECT_NEAR(view.distance_mm, 600.0, 1e-6);
    // A view straight down on a face that leans 20 degrees, 190 mm off the axis: about 70 - atan(190 / 600).
    const FeatureView& jaw = view.feature[static_cast<std::size_t>(Feature::jaw_outer)];
    EXPECT_NEAR(deg_from_rad(jaw.incidence_max_rad), 51.6, 4.0);
    EXPECT_EQ(jaw.seen, 1.0);
  }
}

TEST(StationPlan, features_that_cannot_be_seen_are_reported_one_by_one) {
  const auto seen = [](const Pose& T_block_scanner, const ScannerView& view, Feature feature) {
    return look_at(recipe(), view, kSlab, kHandEye, planned_flange(recipe(), kSlab, kHandEye, T_block_scanner, 4), 4)
        .feature[static_cast<std::size_t>(feature)];
  };
  Pose aside = nominal_T_block_scanner();
  aside.translation_mm.y() += 120.0;  // outward: the outer jaw face turns away, the inner one leaves the view
  EXPECT_FALSE(seen(aside, {}, Feature::jaw_inner).ok());
  EXPECT_LT(seen(aside, {}, Feature::jaw_inner).margin_mm, 0.0);
  EXPECT_GT(seen(aside, {}, Feature::jaw_outer).incidence_max_rad,
            seen(nominal_T_block_scanner(), {}, Feature::jaw_outer).incidence_max_rad + 0.1);
  ScannerView narrow;
  narrow.x_mm = 90.0;
  EXPECT_FALSE(seen(nominal_T_block_scanner(), narrow, Feature::seat).ok()) << "the crop is 102 mm wide";
  ScannerView flat;
  flat.incidence_max_rad = rad_from_deg(40.0);
  EXPECT_FALSE(seen(nominal_T_block_scanner(), flat, Feature::jaw_outer).ok());
  EXPECT_TRUE(seen(nominal_T_block_scanner(), flat, Feature::seat).ok());
  // From far outside the outer shoulder occludes the foot of its jaw face.
  Pose low = nominal_T_block_scanner();
  low.translation_mm = Vec3(0.0, 700.0, 250.0);
  low.rotation = rotation_from_kuka_abc(0.0, 0.0, kPi + std::atan2(-700.0, 250.0));
  EXPECT_LT(seen(low, {.near_mm = 10.0, .far_mm = 5'000.0, .incidence_max_rad = 1.57}, Feature::jaw_outer).seen, 0.5);
  Pose away = nominal_T_block_scanner();
  away.rotation = Quat::Identity();
  EXPECT_FALSE(look_at(recipe(), {}, kSlab, kHandEye, planned_flange(recipe(), kSlab, kHandEye, away, 4), 4).ok(1e9));
}

}  // namespace
}  // namespace slabd::cli
