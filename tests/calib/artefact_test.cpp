// SPDX-License-Identifier: Apache-2.0
#include "calib/ball/artefact.h"

#include <gtest/gtest.h>

#include "ball_scan.h"

namespace slabd::calib {
namespace {

constexpr const char* kText = R"(# three balls on a plate
id = three-ball-01
date = 2026-03-14
issuer = "Lab # 7"
ball_radius_mm = 19.05   # as coated
ball_radius_U_mm = 0.004
U_mm = 0.006
coverage_factor = 2
ball = 0 0 0
ball = 200.012, 0.004, 0
ball = 60.003 170.021 -12.5
)";

std::string without(const std::string& line_start) {
  std::string text = kText;
  const std::size_t at = text.find(line_start);
  text.erase(at, text.find('\n', at) + 1 - at);
  return text;
}
std::string with(const std::string& from, const std::string& to) {
  std::string text = kText;
  text.replace(text.find(from), from.size(), to);
  return text;
}

ArtefactCertificate certificate() {
  const Result<ArtefactCertificate> parsed = parse_certificate(kText, "a.cert");
  EXPECT_TRUE(parsed.ok());
  return parsed.value();
}

Pose some_pose(Prng& random) {
  const auto within = [&](double a) { return a * (2.0 * random.uniform() - 1.0); };
  Pose pose;
  pose.rotation = rotation_from_kuka_abc(within(3.0), within(0.6), kPi + within(0.6));
  pose.translation_mm = Vec3(within(50.0), within(50.0), 600.0 + within(50.0));
  return pose;
}

/// Accepted balls of the certificate at a pose, each with `noise_mm` per axis, in reverse order.
std::vector<BallReport> seen_from(const Pose& T_scanner_target, const ArtefactCertificate& c, double noise_mm,
                                  Prng& random) {
  std::vector<BallReport> balls;
  for (auto p = c.balls_mm.rbegin(); p != c.balls_mm.rend(); ++p) {
    BallReport ball;
    ball.refusal = BallRefusal::none;
    ball.centre_mm = T_scanner_target * *p;
    for (int axis = 0; axis < 3; ++axis) ball.centre_mm[axis] += noise_mm * random.normal();
    ball.cov_white_mm2 = std::max(noise_mm * noise_mm, 1e-12) * Mat3::Identity();
    ball.cov_correlated_mm2 = Mat3::Zero();
    balls.push_back(ball);
  }
  return balls;
}

TEST(Certificate, reads_its_text_and_writes_it_back) {
  const ArtefactCertificate c = certificate();
  EXPECT_EQ(c.id.view(), "three-ball-01");
  EXPECT_EQ(c.issuer.view(), "Lab # 7");
  EXPECT_EQ(c.ball_radius_mm, 19.05);
  EXPECT_EQ(c.ball_radius_sigma_mm, 0.002);
  EXPECT_EQ(c.sigma_mm, 0.003);
  EXPECT_EQ(c.temperature_c, 20.0);
  ASSERT_EQ(c.balls_mm.size(), 3U);
  EXPECT_EQ(c.balls_mm[1], Vec3(200.012, 0.004, 0.0));
  const Result<ArtefactCertificate> again = parse_certificate(certificate_text(c), "again");
  ASSERT_TRUE(again.ok()) << again.error().text.view();
  EXPECT_EQ(certificate_text(again.value()), certificate_text(c));
  EXPECT_EQ(again.value().sigma_mm, c.sigma_mm);
}

TEST(Certificate, refuses_what_is_not_right_with_file_and_line) {
  const auto expect_error = [](const std::string& text, const std::string& words) {
    const Result<ArtefactCertificate> parsed = parse_certificate(text, "a.cert");
    ASSERT_FALSE(parsed.ok()) << text;
    EXPECT_NE(std::string(parsed.error().text.view()).find(words), std::string::npos)
        << parsed.error().text.view() << "\nexpected: " << words;
  };
  expect_error("", "a.cert: the key id is missing");
  expect_error(without("U_mm"), "U_mm is missing");
  expect_error(without("coverage"), "coverage_factor is missing");
  expect_error(with("ball_radius_mm", "ball_radius"), "a.cert:5: unknown key 'ball_radius'");
  expect_error(with("19.05 ", "19,05 "), "a.cert:5: ball_radius_mm must be a number");
  expect_error(with("19.05 ", "nan "), "a.cert:5:");
  expect_error(with("19.05 ", "1e99 "), "a.cert:5:");
  expect_error(with("U_mm = 0.006", "U_mm = -0.006"), "a.cert:7:");
  expect_error(with("2026-03-14", "14.3.2026"), "a.cert:3: date");
  expect_error(with("2026-03-14", "2026-13-14"), "a.cert:3: date");
  expect_error(std::string(kText) + "id = b\n", "a.cert:12: id is given twice");
  expect_error(std::string(kText) + "ball = 1 2\n", "a.cert:12: ball must be three coordinates");
  expect_error(std::string(kText) + "ball = 1 2 3 4\n", "a.cert:12: ball must be three coordinates");
  expect_error(with("Lab # 7", "Lab \x01"), "a.cert:4: issuer holds control characters");
  expect_error(std::string(kText) + "nonsense\n", "a.cert:12: 'key = value' expected");
  expect_error(std::string(kText) + "ball = 5 5 5\n", "apart, less than their diameter");
  expect_error(without("ball = 60"), "2 balls");
  expect_error(with("60.003 170.021 -12.5", "80 3 0"), "lie on a line");
  expect_error(with("60.003 170.021 -12.5", "100.006 170.021 0"), "cannot be distinguished");
  // A certificate truncated before its third ball is invalid.
  const std::string whole = kText;
  for (std::size_t length = 0; length <= whole.rfind("ball ="); ++length)
    EXPECT_FALSE(parse_certificate(whole.substr(0, length), "a.cert").ok()) << length;
}

TEST(Certificate, survives_any_bytes) {
  Prng random(3);
  int read = 0;
  for (int k = 0; k < 5000; ++k) {
    std::string text = kText;
    for (std::uint64_t n = 1 + random.below(4); n > 0; --n)
      text[random.below(text.size())] = static_cast<char>(random.below(256));
    const Result<ArtefactCertificate> parsed = parse_certificate(text, "a.cert");
    if (!parsed) {
      EXPECT_EQ(parsed.error().text.view().substr(0, 7), "a.cert:");
      continue;
    }
    ++read;
    EXPECT_GE(parsed.value().balls_mm.size(), kArtefactBallsMin);
    EXPECT_TRUE(std::isfinite(parsed.value().sigma_mm) && std::isfinite(parsed.value().ball_radius_mm));
  }
  EXPECT_GT(read, 100);  // a comment, a digit
}

TEST(Artefact, pose_is_found_whatever_the_order_of_the_balls) {
  const ArtefactCertificate c = certificate();
  Prng random(4);
  for (int k = 0; k < 20; ++k) {
    const Pose truth = some_pose(random);
    const ArtefactReport report = locate_artefact(seen_from(truth, c, 0.0, random), c, {});
    ASSERT_TRUE(report.ok()) << report.words.reason.view();
    EXPECT_LT((report.target.T_scanner_target.translation_mm - truth.translation_mm).norm(), 1e-9);
    EXPECT_LT(angle_between_rad(report.target.T_scanner_target.rotation, truth.rotation), 1e-11);
    EXPECT_EQ(report.assigned, (std::vector<int>{2, 1, 0}));
    EXPECT_LT(report.residual_max_mm, 1e-9);
  }
}

TEST(Artefact, covariance_is_the_scatter_of_the_pose) {
  ArtefactCertificate c = certificate();
  c.sigma_mm = 0.0;
  Prng random(7);
  const Pose truth = some_pose(random);
  Mat6 scatter = Mat6::Zero();
  Mat6 promised = Mat6::Zero();
  constexpr int kDraws = 4000;
  double scale_square = 0.0;
  double scale_promised = 0.0;
  for (int k = 0; k < kDraws; ++k) {
    const ArtefactReport report = locate_artefact(seen_from(truth, c, 0.01, random), c, {});
    ASSERT_TRUE(report.ok());
    const Pose motion = report.target.T_scanner_target.inverse() * truth;
    Eigen::Matrix<double, 6, 1> xi;
    xi << motion.translation_mm, 2.0 * motion.rotation.vec();
    scatter += xi * xi.transpose() / kDraws;
    promised = report.target.covariance;
    scale_square += report.scale_ppm * report.scale_ppm / kDraws;
    scale_promised = report.scale_sigma_ppm;
  }
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(std::sqrt(scatter(i, i) / promised(i, i)), 1.0, 0.05) << i;
  EXPECT_NEAR(scatter(1, 5) / std::sqrt(scatter(1, 1) * scatter(5, 5)),
              promised(1, 5) / std::sqrt(promised(1, 1) * promised(5, 5)), 0.05);
  EXPECT_NEAR(std::sqrt(scale_square) / scale_promised, 1.0, 0.05);
  TargetPose target;
  target.T_scanner_target = truth;
  target.covariance = promised;
  // The centroid of the balls is the most accurate point; far away the rotation dominates.
  EXPECT_LT(target.sigma_mm(Vec3(86.0, 57.0, -4.0)), 0.0062);
  EXPECT_GT(target.sigma_mm(Vec3(1000.0, 0.0, 0.0)), 0.03);
}

TEST(Artefact, refuses_with_the_reason) {
  const ArtefactCertificate c = certificate();
  Prng random(9);
  const Pose pose = some_pose(random);
  EXPECT_FALSE(ArtefactReport{}.ok());
  const auto expect_refused = [](const ArtefactReport& report, ArtefactRefusal why) {
    EXPECT_EQ(name(report.refusal), name(why)) << report.words.reason.view();
    EXPECT_FALSE(report.words.reason.empty());
    EXPECT_FALSE(report.words.cure.empty());
  };
  std::vector<BallReport> balls = seen_from(pose, c, 0.0, random);
  expect_refused(locate_artefact({}, c, {}), ArtefactRefusal::balls);
  expect_refused(locate_artefact({balls.data(), 2}, c, {}), ArtefactRefusal::balls);
  balls[1].refusal = BallRefusal::noisy;
  expect_refused(locate_artefact(balls, c, {}), ArtefactRefusal::balls);

  balls = seen_from(pose, c, 0.0, random);
  balls[0].centre_mm += Vec3(1.0, 0.0, 0.0);
  expect_refused(locate_artefact(balls, c, {}), ArtefactRefusal::no_match);

  // A loose ball: distances are still within their limit, but the residual is not.
  balls = seen_from(pose, c, 0.001, random);
  const Vec3 towards = (balls[1].centre_mm - balls[2].centre_mm).normalized();
  balls[1].centre_mm += 0.2 * towards;
  expect_refused(locate_artefact(balls, c, {}), ArtefactRefusal::residual);

  // All lengths are 700 ppm too long.
  balls = seen_from(pose, c, 0.0, random);
  for (BallReport& ball : balls) ball.centre_mm *= 1.0007;
  const ArtefactReport stretched = locate_artefact(balls, c, {});
  expect_refused(stretched, ArtefactRefusal::residual);
  EXPECT_NEAR(stretched.scale_ppm, 700.0, 5.0);
  EXPECT_NE(stretched.words.cure.view().find("scale"), std::string_view::npos);

  ArtefactCertificate regular = c;
  regular.balls_mm[2] = Vec3(100.006, 170.0, 0.0);
  expect_refused(locate_artefact(seen_from(pose, regular, 0.0, random), regular, {}), ArtefactRefusal::ambiguous);
}

TEST(Artefact, is_measured_from_a_scan_and_its_mirror_image_is_not_taken) {
  // Four balls that are not in a plane: distances alone would also fit the mirror image.
  ArtefactCertificate c = certificate();
  c.ball_radius_mm = 12.7;
  c.balls_mm = {Vec3(0.0, 0.0, 0.0), Vec3(90.0, 0.0, 0.0), Vec3(30.0, 75.0, 0.0), Vec3(55.0, 40.0, 45.0)};
  const Pose T_scanner_target{rotation_from_kuka_abc(0.4, 0.2, kPi - 0.3), Vec3(-35.0, 25.0, 520.0)};
  const auto scan_of = [&](bool mirrored) {
    BallScene scene;
    scene.half_width_mm = 95.0;
    scene.pitch_mm = 0.28;
    scene.flyer_share = 0.3;
    for (Vec3 p : c.balls_mm) {
      if (mirrored) p.z() = -p.z();
      scene.balls.push_back({T_scanner_target * p, c.ball_radius_mm});
    }
    scene.planes = {{Vec3::UnitZ(), 640.0}};
    return draw(scene);
  };
  ArtefactSettings settings;
  settings.ball.points_min = 1000;
  const Result<ArtefactReport> report = find_artefact(scan_of(false), c, settings);
  ASSERT_TRUE(report.ok());
  ASSERT_TRUE(report.value().ok()) << report.value().words.reason.view();
  const TargetPose& target = report.value().target;
  EXPECT_LT((target.T_scanner_target.translation_mm - T_scanner_target.translation_mm).norm(), 0.01);
  EXPECT_LT(deg_from_rad(angle_between_rad(target.T_scanner_target.rotation, T_scanner_target.rotation)), 0.005);
  EXPECT_EQ(report.value().view.balls.size(), 4U);
  const Result<ArtefactReport> mirrored = find_artefact(scan_of(true), c, settings);
  ASSERT_TRUE(mirrored.ok());
  EXPECT_EQ(mirrored.value().refusal, ArtefactRefusal::residual) << mirrored.value().words.reason.view();
  // Three of the four alone are not sufficient.
  ArtefactCertificate five = c;
  five.balls_mm.emplace_back(-60.0, -40.0, 0.0);
  const Result<ArtefactReport> incomplete = find_artefact(scan_of(false), five, settings);
  ASSERT_TRUE(incomplete.ok());
  EXPECT_EQ(incomplete.value().refusal, ArtefactRefusal::balls);
  EXPECT_FALSE(incomplete.value().words.cure.empty());
}

}  // namespace
}  // namespace slabd::calib
