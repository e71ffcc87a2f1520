// SPDX-License-Identifier: Apache-2.0
#include "calib/stations.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/prng.h"

namespace slabd::calib {
namespace {

constexpr double kRepeat_mm = 0.017;

Pose small_motion(Prng& random, double mm, double rad) {
  Pose pose;
  pose.translation_mm = mm * Vec3(random.normal(), random.normal(), random.normal());
  pose.rotation = rotation_from_kuka_abc(rad * random.normal(), rad * random.normal(), rad * random.normal());
  return pose;
}

/// A slab of `stations` seats in two rows, a robot with a different error at each, and rounds of visits.
struct Scene {
  explicit Scene(std::uint64_t seed = 1) : random(seed) {
    X.translation_mm = Vec3(0.0, 80.0, 150.0);
    X.rotation = rotation_from_kuka_abc(0.3, -0.2, 0.1);
    T_base_slab.translation_mm = Vec3(1800.0, 20.0, 300.0);
    T_base_slab.rotation = rotation_from_kuka_abc(0.01, 0.002, -0.001);
    certificate.id = "test";
    certificate.date = "2026-01-02";
    certificate.slab_type = 5600;
    certificate.sigma_mm = 0.005;
    for (int k = 1; k <= 6; ++k) {
      const double row = k <= 3 ? 1.0 : -1.0;
      const Vec3 p(600.0 * (k <= 3 ? k : 7 - k) + random.normal(), row * 758.0 + random.normal(), 30.0);
      certificate.stations.push_back(master_seat(k, p, Vec3(0.0, -0.025 * row, 1.0), Vec3(0.0, row, 0.025)));
      errors.push_back(small_motion(random, 0.7, 4e-4));
    }
    for (int round = 1; round <= 5; ++round) add_round(round);
  }

  Pose flange(int k) const {
    const Vec3 above =
        T_base_slab * Vec3(certificate.stations[static_cast<std::size_t>(k - 1)].points_mm[0] + Vec3(0.0, 0.0, 600.0));
    Pose T_base_scanner;
    T_base_scanner.translation_mm = above;
    T_base_scanner.rotation = rotation_from_kuka_abc(0.0, 0.0, kPi);
    return T_base_scanner * X.inverse();
  }

  void add_round(int round) {
    for (int k = 1; k <= 6; ++k) {
      const MasterStation& s = certificate.stations[static_cast<std::size_t>(k - 1)];
      StationVisit visit{k, "round " + std::to_string(round), flange(k), {}};
      // True pose of the scanner: robot error and repeatability about the seat.
      const Vec3 seat = T_base_slab * s.points_mm[0];
      Pose about;
      about.translation_mm = seat;
      const Pose real = about * errors[static_cast<std::size_t>(k - 1)] * small_motion(random, kRepeat_mm, 1e-5) *
                        about.inverse() * visit.T_base_flange * X;
      for (const Vec3& p : s.points_mm) visit.points_mm.push_back(real.inverse() * (T_base_slab * p));
      visits.push_back(visit);
    }
  }

  StationsSolution solve(const StationSettings& settings = {}) {
    const auto solved = solve_stations(certificate, visits, HandEyeNumbers{X}, settings);
    EXPECT_TRUE(solved.ok()) << solved.error().text.view();
    return solved.ok() ? solved.value() : StationsSolution{};
  }

  Prng random;
  Pose X;
  Pose T_base_slab;
  MasterCertificate certificate;
  std::vector<Pose> errors;
  std::vector<StationVisit> visits;
};

bool refused_for(const StationsSolution& s, StationRefusal code, int station = 0) {
  for (const StationReason& reason : s.reasons)
    if (reason.code == code && reason.station == station) {
      EXPECT_FALSE(reason.text.empty());
      EXPECT_FALSE(reason.cure.empty());
      return true;
    }
  return false;
}

TEST(Stations, take_up_the_robots_error_and_leave_its_repeatability) {
  Scene scene;
  const StationsSolution s = scene.solve();
  ASSERT_TRUE(s.ok) << s.reasons.front().text;
  EXPECT_GT(s.before_rms_mm, 0.4);
  EXPECT_LT(s.after_rms_mm, 0.04);
  EXPECT_NEAR(s.pooled_sigma_mm, kRepeat_mm, 0.005);
  EXPECT_EQ(s.degrees_of_freedom, 6 * 3 * 4);
  // A new visit, spliced with the correction, is compared with the certificate at the slab's estimated place.
  scene.visits.clear();
  double squares = 0.0;
  int count = 0;
  for (int round = 10; round < 40; ++round) scene.add_round(round);
  for (const StationVisit& visit : scene.visits) {
    const StationCorrection& c = s.table.station[static_cast<std::size_t>(visit.station - 1)];
    const Vec3 p = c.T_base_reported * (visit.T_base_flange * (scene.X * visit.points_mm[0]));
    const MasterStation& certified = scene.certificate.stations[static_cast<std::size_t>(visit.station - 1)];
    squares += (p - s.T_base_certificate * certified.points_mm[0]).squaredNorm();
    count += 3;
  }
  EXPECT_NEAR(std::sqrt(squares / count), kRepeat_mm * std::sqrt(1.0 + 1.0 / 5.0), 0.004);
}

TEST(Stations, with_a_robot_for_each_row_are_placed_together) {
  Scene scene;
  // The second robot has the second row; its base is elsewhere.
  Pose T_base_robot;
  T_base_robot.translation_mm = Vec3(100.0, 3'000.0, -20.0);
  T_base_robot.rotation = rotation_from_kuka_abc(kPi - 0.01, 0.002, 0.001);
  const std::vector<StationVisit> all = scene.visits;
  std::vector<Pose> T_base_scanner;
  for (const StationVisit& visit : all) T_base_scanner.push_back(visit.T_base_flange * scene.X);
  const std::optional<Pose> placed = placement_of(scene.certificate, all, T_base_scanner);
  ASSERT_TRUE(placed.has_value());
  EXPECT_EQ(placement_of(scene.certificate, std::span(all).first(2), std::span(T_base_scanner).first(2)), std::nullopt);

  const auto certified_of = [&](bool second) {
    MasterCertificate certificate = scene.certificate;
    std::erase_if(certificate.stations, [&](const MasterStation& s) { return (s.station > 3) != second; });
    return certificate;
  };
  const auto row_of = [&](bool second) {
    std::vector<StationVisit> visits;
    for (StationVisit visit : all) {
      if ((visit.station > 3) != second) continue;
      if (second) visit.T_base_flange = T_base_robot.inverse() * visit.T_base_flange;
      visits.push_back(visit);
    }
    return visits;
  };
  for (const bool second : {false, true}) {
    const std::vector<StationVisit> visits = row_of(second);
    const MasterCertificate certificate = certified_of(second);
    const auto alone = solve_stations(certificate, visits, HandEyeNumbers{scene.X}, {});
    ASSERT_TRUE(alone.ok());
    EXPECT_TRUE(refused_for(alone.value(), StationRefusal::placement)) << "one row is a line";
    StationSettings settings;
    settings.T_base_certificate = second ? T_base_robot.inverse() * *placed : *placed;
    const auto solved = solve_stations(certificate, visits, HandEyeNumbers{scene.X}, settings);
    ASSERT_TRUE(solved.ok());
    ASSERT_TRUE(solved.value().ok) << solved.value().reasons.front().text;
    EXPECT_LT(solved.value().after_rms_mm, 0.04);
    // Both rows come to the one place of the slab, in the base of the first robot.
    for (const StationVisit& visit : visits) {
      const StationCorrection& c = solved.value().table.station[static_cast<std::size_t>(visit.station - 1)];
      const Vec3 own = c.T_base_reported * (visit.T_base_flange * (scene.X * visit.points_mm[0]));
      const Vec3 p = second ? T_base_robot * own : own;
      const Vec3& certified = scene.certificate.stations[static_cast<std::size_t>(visit.station - 1)].points_mm[0];
      EXPECT_LT((p - *placed * certified).norm(), 0.15);
    }
  }
}

TEST(Stations, sigma_is_what_the_visits_scatter_and_a_little_more_for_having_been_estimated) {
  double ratio = 0.0;
  constexpr int kSets = 40;
  for (int seed = 1; seed <= kSets; ++seed) {
    Scene scene(static_cast<std::uint64_t>(seed));
    for (const StationSolution& one : scene.solve().stations)
      ratio += one.numbers.sigma_mm / kRepeat_mm / (6.0 * kSets);
  }
  EXPECT_GT(ratio, 0.99);
  EXPECT_LT(ratio, 1.10);
}

TEST(Stations, uncertainty_of_the_certificate_is_included) {
  Scene scene;
  const double without = scene.solve().stations[0].numbers.sigma_mm;
  const double without_rad = scene.solve().stations[0].numbers.sigma_rad;
  scene.certificate.sigma_mm = 1.0;
  const StationCorrection c = scene.solve().stations[0].numbers;
  // One visit and the mean of five must together contain the certificate's millimetre once.
  const double with2 = c.sigma_mm * c.sigma_mm * (1.0 + 1.0 / 5.0);
  EXPECT_NEAR(std::sqrt(with2 - without * without * (1.0 + 1.0 / 5.0)), 1.0, 1e-3);
  const double with2_rad = c.sigma_rad * c.sigma_rad * (1.0 + 1.0 / 5.0);
  EXPECT_NEAR(std::sqrt(with2_rad - without_rad * without_rad * (1.0 + 1.0 / 5.0)), 1.0 / kSeatLever_mm, 1e-5);
}

TEST(Stations, certified_error_of_balls_turns_a_station_according_to_their_arrangement) {
  // One set in a triangle, one almost on a line, 300 mm long and 50 mm wide; both have nearly the same rms distance.
  const std::vector<std::vector<Vec3>> kBalls = {
      {Vec3(-124.0, 0.0, 0.0), Vec3(62.0, 107.0, 0.0), Vec3(62.0, -107.0, 0.0)},
      {Vec3(-150.0, 0.0, 0.0), Vec3(150.0, 0.0, 0.0), Vec3(0.0, 50.0, 0.0)}};
  constexpr double kCertified_mm = 0.05;
  constexpr int kSets = 400;
  for (const std::vector<Vec3>& balls : kBalls) {
    Prng random(17);
    double turned = 0.0;  // rad^2, per axis
    double stated = 0.0;
    for (int set = 0; set < kSets; ++set) {
      // Robot and slab have no error, so that only the certificate's errors rotate the corrections.
      MasterCertificate certificate;
      certificate.frame = MasterCertificate::Frame::base;
      certificate.id = "balls";
      certificate.date = "2026-01-02";
      certificate.sigma_mm = kCertified_mm;
      MasterStation certified{1, false, {}};
      const auto noise = [&](double sigma) -> Vec3 {
        return sigma * Vec3(random.normal(), random.normal(), random.normal());
      };
      for (const Vec3& ball : balls) certified.points_mm.push_back(ball + noise(kCertified_mm));
      certificate.stations.push_back(certified);
      std::vector<StationVisit> visits;
      for (int round = 1; round <= 5; ++round) {
        StationVisit visit{1, "round " + std::to_string(round), {}, {}};
        for (const Vec3& ball : balls) visit.points_mm.push_back(ball + noise(1e-4));
        visits.push_back(visit);
      }
      const auto solved = solve_stations(certificate, visits, HandEyeNumbers{}, {});
      ASSERT_TRUE(solved.ok()) << solved.error().text.view();
      const StationSolution& one = solved.value().stations.at(0);
      turned += one.turn_rad * one.turn_rad / (3.0 * kSets);
      stated += one.numbers.sigma_rad * one.numbers.sigma_rad * (1.0 + 1.0 / 5.0) / kSets;
    }
    EXPECT_NEAR(std::sqrt(turned / stated), 1.0, 0.08) << balls.back().transpose();
  }
}

TEST(Stations, a_seat_certified_the_other_way_round_is_refused) {
  Scene scene;
  for (MasterStation& s : scene.certificate.stations) s.points_mm[2] = 2.0 * s.points_mm[0] - s.points_mm[2];
  const StationsSolution s = scene.solve();
  EXPECT_FALSE(s.ok);
  EXPECT_TRUE(refused_for(s, StationRefusal::turn, 1));
}

TEST(Stations, a_slope_that_the_block_itself_contradicts_is_refused) {
  Scene scene;
  const double cant = std::atan(0.025);
  for (StationVisit& visit : scene.visits) visit.local_slope_rad = cant + rad_from_deg(0.01);
  EXPECT_TRUE(scene.solve().ok);
  // Certified 0.12 degrees too flat: the correction would absorb it, and every seat there would read as certified.
  MasterStation& wrong = scene.certificate.stations[3];
  const double flat = cant - rad_from_deg(0.12);
  wrong = master_seat(4, wrong.points_mm[0], Vec3(0.0, std::sin(flat), std::cos(flat)),
                      Vec3(0.0, -std::cos(flat), std::sin(flat)));
  const StationsSolution s = scene.solve();
  EXPECT_FALSE(s.ok);
  EXPECT_TRUE(refused_for(s, StationRefusal::slope, 4));
  for (const int good : {1, 2, 3, 5, 6}) EXPECT_FALSE(refused_for(s, StationRefusal::slope, good)) << good;
}

TEST(Stations, an_error_of_the_hand_eye_is_taken_up_too) {
  Scene scene;
  const Pose used = scene.X * small_motion(scene.random, 0.3, 3e-4);
  const auto solved = solve_stations(scene.certificate, scene.visits, HandEyeNumbers{used}, {});
  ASSERT_TRUE(solved.ok());
  ASSERT_TRUE(solved.value().ok) << solved.value().reasons.front().text;
  EXPECT_LT(solved.value().after_rms_mm, 0.04);
}

TEST(Stations, same_visits_with_another_hand_eye_give_other_corrections_from_their_text_alone) {
  Scene scene;
  const auto back = parse_visits(visits_text(scene.visits), "visits");
  ASSERT_TRUE(back.ok()) << back.error().text.view();
  ASSERT_EQ(back.value().size(), scene.visits.size());
  const StationsSolution a = scene.solve();
  scene.visits = back.value();
  const StationsSolution b = scene.solve();
  for (std::size_t i = 0; i < 6; ++i)
    EXPECT_EQ(a.table.station[i].T_base_reported.to_array(), b.table.station[i].T_base_reported.to_array())
        << "bit for bit";
}

TEST(Stations, fewer_than_five_visits_are_refused) {
  Scene scene;
  scene.visits.erase(scene.visits.begin() + 2);  // station 3, round 1
  const StationsSolution s = scene.solve();
  EXPECT_FALSE(s.ok);
  EXPECT_TRUE(refused_for(s, StationRefusal::too_few_visits, 3));
  EXPECT_EQ(s.table.station[0].visits, 0) << "nothing of a refused set can be used";
}

TEST(Stations, one_visit_that_differs_from_the_others_is_refused_by_its_name) {
  Scene scene;
  for (StationVisit& visit : scene.visits)
    if (visit.station == 4 && visit.round == "round 2")
      for (Vec3& p : visit.points_mm) p.x() += 0.4;
  const StationsSolution s = scene.solve();
  ASSERT_TRUE(refused_for(s, StationRefusal::spread, 4));
  EXPECT_NE(s.reasons.front().text.find("round 2"), std::string::npos) << s.reasons.front().text;
}

TEST(Stations, a_slab_that_was_pushed_between_rounds_is_recognised) {
  Scene scene;
  for (StationVisit& visit : scene.visits)
    if (visit.round == "round 5") {
      // The slab moves by 0.3 mm along base X, so the scanner's points move by the same amount in its own axes.
      const Quat back = (visit.T_base_flange * scene.X).rotation.conjugate();
      for (Vec3& p : visit.points_mm) p += back * Vec3(0.3, 0.0, 0.0);
    }
  const StationsSolution s = scene.solve();
  ASSERT_TRUE(refused_for(s, StationRefusal::slab_moved));
  EXPECT_EQ(s.reasons.size(), 1U) << "one cause, one reason";
  EXPECT_NE(s.reasons.front().text.find("round 5"), std::string::npos);
}

TEST(Stations, one_visit_given_five_times_does_not_show_the_repeatability) {
  Scene scene;
  std::vector<StationVisit> copies;
  for (const StationVisit& visit : scene.visits)
    if (visit.round == "round 1") copies.insert(copies.end(), 5, visit);
  scene.visits = copies;
  EXPECT_TRUE(refused_for(scene.solve(), StationRefusal::copies));
}

TEST(Stations, a_repeated_round_is_not_a_further_round) {
  Scene scene;
  const std::vector<StationVisit> rounds = scene.visits;
  for (const StationVisit& visit : rounds)
    if (visit.round == "round 2") scene.visits.push_back(visit);
  const StationsSolution twice = scene.solve();
  EXPECT_TRUE(refused_for(twice, StationRefusal::copies));
  EXPECT_EQ(twice.reasons.size(), 1U);
  for (StationVisit& visit : scene.visits)
    if (&visit - scene.visits.data() >= static_cast<std::ptrdiff_t>(rounds.size())) visit.round = "round 9";
  const StationsSolution renamed = scene.solve();
  ASSERT_TRUE(refused_for(renamed, StationRefusal::copies));
  EXPECT_NE(renamed.reasons[0].text.find("round 2 and round 9"), std::string::npos) << renamed.reasons[0].text;
}

TEST(Stations, visits_are_refused_once_the_scanner_has_moved_on_the_flange) {
  Scene scene;
  const HandEyeNumbers then{scene.X, 0.03, 3e-5};
  for (StationVisit& visit : scene.visits) {
    visit.hand_eye_id = "he-000000000001";
    visit.hand_eye = then;
  }
  // A new estimate with the scanner unmoved: the difference cannot be distinguished from a move, so it is included.
  HandEyeNumbers now = then;
  now.T_flange_scanner.translation_mm.y() += 0.09;
  const auto anew = solve_stations(scene.certificate, scene.visits, now, {});
  ASSERT_TRUE(anew.ok() && anew.value().ok) << anew.value().reasons.front().text;
  EXPECT_NEAR(anew.value().mount_mm, 0.09, 1e-9);
  const double before = scene.solve().stations[0].numbers.sigma_mm;
  const double share = 1.0 / (1.0 + 1.0 / 5.0);
  EXPECT_NEAR(anew.value().stations[0].numbers.sigma_mm, std::hypot(before, std::sqrt(share / 3.0) * 0.09), 1e-4);
  // Moved: no other figure of the solution reveals it.
  now.T_flange_scanner.translation_mm.y() += 0.31;
  const auto moved = solve_stations(scene.certificate, scene.visits, now, {});
  ASSERT_TRUE(moved.ok());
  EXPECT_EQ(moved.value().reasons.size(), 1U);
  EXPECT_TRUE(refused_for(moved.value(), StationRefusal::scanner_moved));
  // Rotated about its own axis: the place of the seat does not change.
  now = then;
  const Vec3 seat = scene.visits[0].points_mm[0];
  Pose about;
  about.translation_mm = seat;
  Pose turn;
  turn.rotation = Quat(Eigen::AngleAxisd(3e-4, Eigen::Vector3d::UnitZ()));
  now.T_flange_scanner = then.T_flange_scanner * about * turn * about.inverse();
  EXPECT_TRUE(
      refused_for(solve_stations(scene.certificate, scene.visits, now, {}).value(), StationRefusal::scanner_moved));
}

TEST(Stations, visits_record_the_hand_eye_calibration_they_were_taken_with) {
  Scene scene;
  for (StationVisit& visit : scene.visits)
    if (visit.round != "round 3") visit.hand_eye_id = visit.round == "round 1" ? "he-1" : "he-2";
  const auto back = parse_visits(visits_text(scene.visits), "visits");
  ASSERT_TRUE(back.ok()) << back.error().text.view();
  ASSERT_EQ(back.value().size(), scene.visits.size());
  for (std::size_t i = 0; i < scene.visits.size(); ++i)
    EXPECT_EQ(back.value()[i].hand_eye_id, scene.visits[i].hand_eye_id);
  const std::string text = visits_text(std::span(scene.visits).first(1));
  const auto told = [&](const std::string& line) {
    const auto parsed = parse_visits(text + line, "v");
    EXPECT_FALSE(parsed.ok());
    return parsed.ok() ? std::string() : std::string(parsed.error().text.view());
  };
  EXPECT_NE(told("taken_with = \"round 1\" he-2\n").find("v:5: taken_with"), std::string::npos);
  EXPECT_NE(told("taken_with = \"Round 1\" he-2\n").find("names a round that has no visit"), std::string::npos);
  EXPECT_NE(told("taken_with = he-2\n").find("must be: round, id"), std::string::npos);
}

TEST(Stations, robot_must_report_the_same_pose_every_time) {
  Scene scene;
  scene.visits[1].T_base_flange.translation_mm.x() += 3.0;
  EXPECT_TRUE(refused_for(scene.solve(), StationRefusal::outside_gate, 2));
  Scene turned;
  turned.visits[1].T_base_flange.rotation =
      (rotation_from_kuka_abc(rad_from_deg(0.1), 0.0, 0.0) * turned.visits[1].T_base_flange.rotation).normalized();
  EXPECT_TRUE(refused_for(turned.solve(), StationRefusal::outside_gate, 2));
}

TEST(Stations, a_seat_certified_in_the_wrong_place_does_not_become_a_correction) {
  Scene scene;
  for (Vec3& p : scene.certificate.stations[2].points_mm) p.y() += 12.0;
  EXPECT_TRUE(refused_for(scene.solve(), StationRefusal::shift, 3));
}

TEST(Stations, directions_that_are_not_the_seats_are_refused_by_their_shape) {
  Scene scene;
  MasterStation& s = scene.certificate.stations[0];
  s.points_mm[2] = s.points_mm[0] + Vec3(0.0, 0.02, 0.99) * kSeatLever_mm;  // along the normal
  EXPECT_TRUE(refused_for(scene.solve(), StationRefusal::shape, 1));
}

TEST(Stations, one_row_does_not_determine_the_place_of_the_slab_unless_the_certificate_does) {
  Scene scene;
  scene.certificate.stations.resize(3);
  std::erase_if(scene.visits, [](const StationVisit& visit) { return visit.station > 3; });
  EXPECT_TRUE(refused_for(scene.solve(), StationRefusal::placement));
  for (MasterStation& s : scene.certificate.stations)
    for (Vec3& p : s.points_mm) p = scene.T_base_slab * p;
  scene.certificate.frame = MasterCertificate::Frame::base;
  const StationsSolution s = scene.solve();
  ASSERT_TRUE(s.ok) << s.reasons.front().text;
  EXPECT_LT(s.after_rms_mm, 0.04);
}

TEST(Stations, visits_to_stations_that_are_not_certified_are_refused) {
  Scene scene;
  scene.visits.front().station = 9;
  const StationsSolution s = scene.solve();
  EXPECT_TRUE(refused_for(s, StationRefusal::unknown_station, 9));
}

TEST(Stations, balls_do_as_well_as_seats) {
  Scene scene;
  for (MasterStation& s : scene.certificate.stations) {
    const Vec3 p = s.points_mm[0];
    s.is_seat = false;
    s.points_mm = {p, p + Vec3(200.0, 0.0, 5.0), p + Vec3(60.0, 180.0, -5.0)};
  }
  scene.visits.clear();
  for (int round = 1; round <= 5; ++round) scene.add_round(round);
  const StationsSolution s = scene.solve();
  ASSERT_TRUE(s.ok) << s.reasons.front().text;
  EXPECT_LT(s.after_rms_mm, 0.04);
}

TEST(Stations, an_invalid_set_of_visits_is_an_error) {
  Scene scene;
  EXPECT_FALSE(solve_stations(scene.certificate, {}, HandEyeNumbers{scene.X}, {}).ok());
  scene.visits[0].points_mm[1].x() = kNoValue;
  EXPECT_FALSE(solve_stations(scene.certificate, scene.visits, HandEyeNumbers{scene.X}, {}).ok());
}

// ---- written forms -----------------------------------------------------------------------------------------------

constexpr const char* kCertificate = R"(# of the slab in the corner
id = master-slab-01
date = 2026-03-14
issuer = "DKD-K 00000"
slab_type = 5600
frame = slab
U_mm = 0.010
seat = 1  -2520.012 758.004 30.011  0 -0.024992 0.999688  0 0.999688 0.024992
seat = 18 -2520.0 -758.0 30.0  0 0.024992 0.999688  0 -0.999688 0.024992   # across
ball = 2 1 2 3
ball = 2 201 2 3
ball = 2 1 202 3
)";

std::string refusal(const std::string& text) {
  const auto c = parse_master_certificate(text, "cert.txt");
  EXPECT_FALSE(c.ok());
  return c.ok() ? "" : std::string(c.error().text.view());
}
std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(MasterCertificateText, is_read_and_written_back) {
  const auto c = parse_master_certificate(kCertificate, "cert.txt");
  ASSERT_TRUE(c.ok()) << c.error().text.view();
  EXPECT_EQ(c.value().id, "master-slab-01");
  EXPECT_EQ(c.value().issuer, "DKD-K 00000");
  EXPECT_EQ(c.value().slab_type, 5600);
  EXPECT_DOUBLE_EQ(c.value().sigma_mm, 0.005);
  ASSERT_EQ(c.value().stations.size(), 3U);
  EXPECT_EQ(c.value().stations[0].station, 1);
  EXPECT_EQ(c.value().stations[1].points_mm.size(), 3U);
  EXPECT_FALSE(c.value().stations[1].is_seat);
  EXPECT_EQ(c.value().stations[2].points_mm[0], Vec3(-2520.0, -758.0, 30.0));
  const auto again = parse_master_certificate(master_certificate_text(c.value()), "again");
  ASSERT_TRUE(again.ok()) << again.error().text.view();
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      EXPECT_LT((again.value().stations[i].points_mm[j] - c.value().stations[i].points_mm[j]).norm(), 1e-12);
}

TEST(MasterCertificateText, faults_are_named_with_their_line) {
  const std::string good = kCertificate;
  EXPECT_EQ(refusal(with(good, "slab_type = 5600\n", "")), "cert.txt: the key slab_type is missing");
  EXPECT_NE(refusal(with(good, "date = 2026-03-14", "date = 14.3.2026")).find("cert.txt:3: date"), std::string::npos);
  EXPECT_NE(refusal(with(good, "U_mm = 0.010", "U_mm = small")).find("cert.txt:7: U_mm must be a number"),
            std::string::npos);
  EXPECT_NE(refusal(with(good, "frame = slab", "frame = world")).find("allowed are slab and base"), std::string::npos);
  EXPECT_NE(refusal(good + "colour = red\n").find("cert.txt:13: colour is not a key"), std::string::npos);
  EXPECT_NE(refusal(good + "id = twice\n").find("cert.txt:13: id is given twice"), std::string::npos);
  EXPECT_NE(refusal(good + "seat = 1 0 0 0 0 0 1 0 1 0\n").find("second entry"), std::string::npos);
  EXPECT_NE(refusal(good + "seat = 19 0 0 0 0 0 1 0 1 0\n").find("1..18"), std::string::npos);
  EXPECT_NE(refusal(good + "seat = 5 0 0 0 0 0 2 0 1 0\n").find("length 1"), std::string::npos);
  EXPECT_NE(refusal(good + "seat = 5 0 0 0 0 0 1 0 0.6 0.8\n").find("right angles"), std::string::npos);
  EXPECT_NE(refusal(good + "seat = 5 0 0 0 0 0 1\n").find("must be: station"), std::string::npos);
  EXPECT_NE(refusal(with(good, "ball = 2 1 202 3\n", "")).find("station 2 has 2 balls"), std::string::npos);
  EXPECT_NE(refusal(with(good, "ball = 2 1 202 3", "ball = 2 401 2 3")).find("near to each other or to a line"),
            std::string::npos);
  // A long triangle with a height of 20 mm has enough area, but not enough height.
  EXPECT_NE(refusal(with(good, "ball = 2 1 202 3", "ball = 2 1 22 3")).find("near to each other or to a line"),
            std::string::npos);
  EXPECT_NE(refusal("nonsense\n").find("cert.txt:1: 'key = value' expected"), std::string::npos);
  EXPECT_NE(refusal("id = \"open\nx = 1\n").find("cert.txt:1: a quote is not closed"), std::string::npos);
}

TEST(VisitsText, faults_are_named_with_their_line) {
  const auto fault = [](const char* text) {
    const auto visits = parse_visits(text, "v.txt");
    return visits.ok() ? std::string("read") : std::string(visits.error().text.view());
  };
  EXPECT_NE(fault("").find("no visits"), std::string::npos);
  EXPECT_NE(fault("visit = 3 r 1 2 3 1 0 0 0 1 2 3 4 5 6\n").find("v.txt:1: visit must be"), std::string::npos);
  EXPECT_NE(fault("visit = 3 r 1 2 3 2 0 0 0 1 2 3 4 5 6 7 8 9\n").find("quaternion"), std::string::npos);
  EXPECT_NE(fault("visit = 3 r 1 2 3 1 0 0 0 1 2 3 4 5 6 7 8 x\n").find("holds \"x\""), std::string::npos);
  EXPECT_EQ(fault("visit = 3 r 1 2 3 1 0 0 0 1 2 3 4 5 6 7 8 9\n"), "read");
}

TEST(SeatVisit, is_what_the_inspection_saw_in_the_scanner_frame) {
  BlockResult block;
  EXPECT_FALSE(seat_visit(block, Pose::identity(), "r").has_value()) << "nothing was measured";
  block.station = 7;
  block.registration.status = RegistrationStatus::converged;
  block.registration.T_scanner_block.translation_mm = Vec3(1.0, 2.0, 600.0);
  block.registration.T_scanner_block.rotation = rotation_from_kuka_abc(0.0, 0.0, kPi);
  block.seat.plane.ok = true;
  block.seat.plane.normal = Vec3(0.0, -0.025, 1.0).normalized();
  block.casing_inner.ok = block.casing_outer.ok = true;
  block.casing_inner.centre = Vec3(0.0, -116.0, -2.9);
  block.casing_outer.centre = Vec3(0.0, 117.0, 2.925);
  const auto visit = seat_visit(block, Pose::identity(), "slab 12");
  ASSERT_TRUE(visit.has_value());
  EXPECT_EQ(visit->station, 7);
  const Vec3 middle = block.registration.T_scanner_block * Vec3(0.0, 0.5, 0.0125);
  EXPECT_LT((visit->points_mm[0] - middle).norm(), 1e-12);
  EXPECT_NEAR((visit->points_mm[1] - visit->points_mm[0]).norm(), kSeatLever_mm, 1e-9);
  block.casing_outer.ok = false;
  EXPECT_FALSE(seat_visit(block, Pose::identity(), "r").has_value());
}

}  // namespace
}  // namespace slabd::calib
