// SPDX-License-Identifier: Apache-2.0
#include "calib/ball/ball.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "ball_scan.h"

namespace slabd::calib {
namespace {

constexpr double kRadius = 19.05;

BallSettings settings(double radius_mm = kRadius) {
  BallSettings s;
  s.radius_mm = radius_mm;
  return s;
}

/// A ball on its post above a table, slightly off centre, different for every seed.
BallScene scene_of(std::uint64_t seed) {
  BallScene scene;
  scene.seed = seed;
  Prng random(77 * seed);
  const Vec3 c(10.0 * random.uniform() - 5.0, 10.0 * random.uniform() - 5.0, 500.0 + 20.0 * random.uniform());
  scene.balls = {{c, kRadius}};
  scene.posts = {{c + Vec3(0.0, 0.0, 15.0), c + Vec3(10.0, 5.0, 90.0), 6.0}};
  scene.planes = {{Vec3::UnitZ(), 590.0}};
  scene.half_width_mm = 40.0;
  scene.pitch_mm = 0.255;
  scene.flyer_share = 0.3;
  scene.missing_share = 0.01;
  return scene;
}

BallView view_of(const BallScene& scene, const BallSettings& s = settings()) {
  const Result<BallView> view = find_balls(draw(scene), s);
  EXPECT_TRUE(view.ok());
  return view ? view.value() : BallView{};
}

/// Report of the only ball, which must be accepted.
BallReport ball_of(const BallScene& scene, const BallSettings& s = settings()) {
  const BallView view = view_of(scene, s);
  EXPECT_TRUE(view.ok()) << view.words.reason.view();
  return view.balls.empty() ? BallReport{} : view.balls[0];
}

void expect_refused(const BallView& view, BallRefusal why) {
  EXPECT_EQ(name(view.refusal), name(why)) << view.words.reason.view();
  EXPECT_FALSE(view.ok());
  EXPECT_FALSE(view.words.reason.empty());
  EXPECT_FALSE(view.words.cure.empty());
}

/// Errors over many seeds across and along the view (um), and the values predicted by the covariances.
struct Spread {
  Vec3 bias_um = Vec3::Zero();
  Vec3 sd_um = Vec3::Zero();
  Vec3 promised_um = Vec3::Zero();
};
template <typename Change>
Spread spread_over(int seeds, const Change& change, const BallSettings& s = settings()) {
  Spread spread;
  Vec3 squares = Vec3::Zero();
  for (int seed = 1; seed <= seeds; ++seed) {
    BallScene scene = scene_of(static_cast<std::uint64_t>(seed));
    change(scene);
    const BallReport ball = ball_of(scene, s);
    const Vec3 axis = scene.balls[0].centre_mm.normalized();
    Mat3 axes;
    axes.row(2) = axis;
    axes.row(0) = Vec3::UnitY().cross(axis).normalized();
    axes.row(1) = axis.cross(Vec3(axes.row(0)));
    const Vec3 e = 1e3 * (axes * (ball.centre_mm - scene.balls[0].centre_mm));
    spread.bias_um += e / seeds;
    squares += e.cwiseProduct(e) / seeds;
    const Mat3 covariance = axes * ball.cov_mm2() * axes.transpose();
    spread.promised_um += 1e6 * covariance.diagonal() / seeds;
  }
  spread.sd_um = (squares - spread.bias_um.cwiseProduct(spread.bias_um)).cwiseMax(0.0).cwiseSqrt();
  spread.promised_um = spread.promised_um.cwiseSqrt().eval();
  return spread;
}

TEST(Ball, centre_reaches_the_floor_of_a_fixed_radius_fit) {
  const Spread s = spread_over(30, [](BallScene&) {});
  // A cap of 60 degrees at this pitch and 0.05 mm of noise: 0.5 um along the view, 0.7 to 1.0 across.
  EXPECT_LT(s.sd_um[2], 0.65);
  EXPECT_LT(s.sd_um.head<2>().maxCoeff(), 1.0);
  EXPECT_LT(s.bias_um.cwiseAbs().maxCoeff(), 0.5);
  EXPECT_LT((s.promised_um - s.sd_um).cwiseAbs().maxCoeff(), 0.35) << s.promised_um << "\n" << s.sd_um;
}

TEST(Ball, covariance_includes_the_common_error_of_neighbouring_points) {
  const Spread s = spread_over(
      40, [](BallScene& scene) { scene.correlation_mm = 2.0; },
      [] {
        BallSettings wide = settings();
        wide.radius_off_mm = 0.2;  // the free radius scatters by 0.03 mm
        return wide;
      }());
  EXPECT_LT(s.sd_um[2], 9.0);
  EXPECT_LT(s.sd_um.head<2>().maxCoeff(), 16.0);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_GT(s.promised_um[axis], 0.8 * s.sd_um[axis]) << axis;
    EXPECT_LT(s.promised_um[axis], 1.6 * s.sd_um[axis]) << axis;
  }
}

TEST(Ball, estimates_the_correlation_length_of_the_noise) {
  BallScene scene = scene_of(3);
  const BallReport white = ball_of(scene);
  EXPECT_EQ(white.correlated_mm, 0.0);
  EXPECT_LT(white.cov_correlated_mm2.norm(), 1e-12);
  scene.correlation_mm = 2.0;
  const BallReport common = ball_of(scene);
  EXPECT_NEAR(common.correlated_mm, 0.04, 0.006);
  EXPECT_NEAR(common.correlation_length_mm, 2.0, 0.6);
  BallSettings stated = settings();
  stated.noise_correlation_mm = 2.0;
  scene.correlation_mm = 0.0;
  const BallReport careful = ball_of(scene, stated);
  EXPECT_GT(std::sqrt(careful.cov_mm2().trace()), 10.0 * std::sqrt(white.cov_mm2().trace()));
}

TEST(Ball, rays_may_be_parallel) {
  BallScene scene = scene_of(4);
  scene.parallel = true;
  BallSettings s = settings();
  s.viewpoint_mm = Vec3(0.0, 0.0, -1e9);
  EXPECT_LT((ball_of(scene, s).centre_mm - scene.balls[0].centre_mm).norm(), 0.004);
}

TEST(Ball, is_found_among_posts_walls_tables_and_other_balls) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    BallScene scene = scene_of(seed);
    scene.half_width_mm = 140.0;
    scene.pitch_mm = 0.4;
    const Vec3 c = scene.balls[0].centre_mm;
    scene.balls.push_back({c + Vec3(70.0, 10.0, 40.0), 12.7});
    scene.balls.push_back({c + Vec3(-70.0, 30.0, 50.0), 25.4});
    // A post of the same radius
    scene.posts.push_back({c + Vec3(60.0, -60.0, 20.0), c + Vec3(60.0, 40.0, 21.0), kRadius});
    scene.planes.push_back({Vec3(1.0, 0.0, 0.05).normalized(), 120.0});
    scene.planes.push_back({Vec3(0.0, 1.0, 0.02).normalized(), 90.0});
    const BallReport ball = ball_of(scene);
    EXPECT_LT((ball.centre_mm - c).norm(), 0.006) << seed;
  }
}

TEST(Ball, order_and_grid_of_the_points_do_not_matter) {
  const BallScene scene = scene_of(5);
  std::vector<float> xyz = draw(scene);
  const Result<BallView> grid = find_balls(xyz, settings());
  const Result<BallView> again = find_balls(xyz, settings());
  ASSERT_TRUE(grid.ok() && again.ok());
  EXPECT_EQ(grid.value().balls[0].centre_mm, again.value().balls[0].centre_mm);
  EXPECT_EQ(grid.value().balls[0].cov_mm2(), again.value().balls[0].cov_mm2());
  std::vector<std::array<float, 3>> points;
  for (std::size_t i = 0; i < xyz.size(); i += 3)
    if (!std::isnan(xyz[i])) points.push_back({xyz[i], xyz[i + 1], xyz[i + 2]});
  Prng random(1);
  for (std::size_t i = points.size(); i > 1; --i) std::swap(points[i - 1], points[random.below(i)]);
  const Result<BallView> shuffled = find_balls({points[0].data(), 3 * points.size()}, settings());
  ASSERT_TRUE(shuffled.ok() && shuffled.value().ok());
  EXPECT_LT((shuffled.value().balls[0].centre_mm - grid.value().balls[0].centre_mm).norm(), 1e-6);
}

TEST(Ball, a_wrong_radius_moves_the_centre_by_the_reported_amount) {
  BallScene scene = scene_of(6);
  const BallReport right = ball_of(scene);
  const BallReport wrong = ball_of(scene, settings(kRadius + 0.02));
  const Vec3 promised = 0.02 * right.shift_per_radius;
  EXPECT_LT((wrong.centre_mm - right.centre_mm - promised).norm(), 0.001);
  EXPECT_GT(promised.norm(), 0.02);
  EXPECT_NEAR(right.radius_free_mm, kRadius, 0.01);
}

TEST(Ball, a_radius_that_is_off_by_less_than_its_gate_shows_over_many_views) {
  std::vector<BallReport> right;
  std::vector<BallReport> wrong;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const BallScene scene = scene_of(seed);
    right.push_back(ball_of(scene));
    wrong.push_back(ball_of(scene, settings(kRadius + 0.03)));  // accepted individually
  }
  const RadiusCheck quiet = check_radius(right, settings());
  EXPECT_FALSE(quiet.suspicious);
  EXPECT_NEAR(quiet.mean_mm, kRadius, 0.004);
  const RadiusCheck loud = check_radius(wrong, settings(kRadius + 0.03));
  EXPECT_TRUE(loud.suspicious);
  EXPECT_NEAR(loud.shift_mm, 0.03 * wrong[0].shift_per_radius.norm(), 0.005);
  EXPECT_NE(loud.words.reason.view().find("too far from"), std::string_view::npos) << loud.words.reason.view();
  EXPECT_FALSE(loud.covered);
  // An uncertain radius in the certificate does not suppress the warning.
  BallSettings unsure = settings(kRadius + 0.03);
  unsure.radius_sigma_mm = 0.025;
  const RadiusCheck covered = check_radius(wrong, unsure);
  EXPECT_TRUE(covered.suspicious);
  EXPECT_TRUE(covered.covered);
  EXPECT_NE(covered.words.reason.view().find("no residual will show that; the certificate's own uncertainty "
                                             "(0.0500 mm, k = 2) covers it"),
            std::string_view::npos)
      << covered.words.reason.view();
  EXPECT_FALSE(check_radius({wrong.data(), 4}, settings(kRadius + 0.03)).suspicious);
  EXPECT_FALSE(has_value(check_radius({}, settings()).mean_mm));
}

// ---- refusals ----------------------------------------------------------------------------------------------------

TEST(BallRefusals, zeroed_reports_are_not_ok) {
  EXPECT_FALSE(BallReport{}.ok());
  EXPECT_FALSE(BallView{}.ok());
  EXPECT_FALSE(BallShots{}.ok());
}

TEST(BallRefusals, an_empty_scan_holds_no_ball) {
  expect_refused(find_balls({}, settings()).value(), BallRefusal::no_points);
  const std::vector<float> missing(3000, std::numeric_limits<float>::quiet_NaN());
  expect_refused(find_balls(missing, settings()).value(), BallRefusal::no_points);
}

TEST(BallRefusals, a_plane_a_cylinder_a_cloud_and_faulty_points_hold_no_ball) {
  BallScene scene = scene_of(1);
  scene.balls.clear();
  expect_refused(view_of(scene), BallRefusal::not_found);  // post and table
  scene.posts = {{Vec3(-60.0, 0.0, 520.0), Vec3(60.0, 5.0, 520.0), kRadius}};
  expect_refused(view_of(scene), BallRefusal::not_found);
  Prng random(9);
  std::vector<float> cloud(90'000);
  for (float& v : cloud) v = static_cast<float>(100.0 * random.uniform() + 400.0);
  expect_refused(find_balls(cloud, settings()).value(), BallRefusal::not_found);
  for (std::size_t i = 0; i < cloud.size(); ++i) cloud[i] = i % 2 == 0 ? std::numeric_limits<float>::infinity() : 3e38F;
  EXPECT_FALSE(find_balls(cloud, settings()).value().ok());
  std::fill(cloud.begin(), cloud.end(), 1e30F);
  expect_refused(find_balls(cloud, settings()).value(), BallRefusal::not_found);
  std::fill(cloud.begin(), cloud.end(), 500.0F);
  expect_refused(find_balls(cloud, settings()).value(), BallRefusal::not_found);
}

TEST(BallRefusals, radius_wrong_by_a_millimetre_is_named_with_the_radius_that_is_there) {
  for (const double off : {-1.0, 1.0}) {
    const BallView view = view_of(scene_of(2), settings(kRadius + off));
    expect_refused(view, BallRefusal::radius);
    ASSERT_FALSE(view.balls.empty());
    EXPECT_NEAR(view.balls[0].radius_free_mm, kRadius, 0.02);
    EXPECT_LT(view.balls[0].radius_free_sigma_mm, 0.01);
  }
  expect_refused(view_of(scene_of(2), settings(kRadius + 0.08)), BallRefusal::radius);
}

TEST(BallRefusals, a_diameter_given_for_a_radius_is_named) {
  const BallView view = view_of(scene_of(2), settings(2.0 * kRadius));
  expect_refused(view, BallRefusal::not_found);
  EXPECT_NE(view.words.reason.view().find("19.0"), std::string_view::npos) << view.words.reason.view();
  EXPECT_NE(view.words.cure.view().find("not the diameter"), std::string_view::npos);
}

TEST(BallRefusals, a_scan_in_metres_is_named) {
  std::vector<float> xyz = draw(scene_of(2));
  for (float& v : xyz) v *= 1e-3F;
  const Result<BallView> view = find_balls(xyz, settings());
  ASSERT_TRUE(view.ok());
  expect_refused(view.value(), BallRefusal::not_found);
  EXPECT_NE(view.value().words.cure.view().find("unit"), std::string_view::npos);
}

TEST(BallRefusals, two_equal_balls_are_too_many_unless_two_are_expected) {
  BallScene scene = scene_of(3);
  scene.half_width_mm = 80.0;
  scene.balls.push_back({scene.balls[0].centre_mm + Vec3(45.0, -20.0, 5.0), kRadius});
  expect_refused(view_of(scene), BallRefusal::too_many);
  BallSettings two = settings();
  two.count = 2;
  const BallView view = view_of(scene, two);
  ASSERT_TRUE(view.ok()) << view.words.reason.view();
  EXPECT_EQ(view.balls.size(), 2U);
  two.count = 3;
  expect_refused(view_of(scene, two), BallRefusal::too_few);
}

TEST(BallRefusals, half_a_cap_hidden_names_the_side) {
  BallScene scene = scene_of(4);
  scene.hidden_beyond_x_mm = scene.balls[0].centre_mm.x();
  const BallView view = view_of(scene);
  expect_refused(view, BallRefusal::azimuth);
  EXPECT_NE(view.words.reason.view().find("+X"), std::string_view::npos) << view.words.reason.view();
}

TEST(BallRefusals, a_small_cap_is_refused) {
  BallSettings s = settings();
  s.incidence_max_rad = rad_from_deg(45.0);
  expect_refused(view_of(scene_of(5), s), BallRefusal::small_cap);
}

TEST(BallRefusals, too_few_points_are_refused) {
  BallScene scene = scene_of(6);
  scene.pitch_mm = 0.6;
  expect_refused(view_of(scene), BallRefusal::few_points);
}

TEST(BallRefusals, more_scatter_than_the_scanner_has_is_refused) {
  BallScene scene = scene_of(7);
  scene.noise_mm = 0.12;
  expect_refused(view_of(scene), BallRefusal::noisy);
}

TEST(BallRefusals, dirt_all_over_the_ball_is_refused) {
  std::vector<float> xyz = draw(scene_of(8));
  for (std::size_t i = 2; i < xyz.size(); i += 15) xyz[i] -= 0.35F;  // every fifth point protrudes
  expect_refused(find_balls(xyz, settings()).value(), BallRefusal::spoiled);
}

TEST(Ball, a_thing_stuck_to_it_does_not_move_the_centre) {
  BallScene scene = scene_of(8);
  scene.balls.push_back({scene.balls[0].centre_mm - Vec3(-9.0, 0.0, 8.0), 9.5});
  EXPECT_LT((ball_of(scene).centre_mm - scene.balls[0].centre_mm).norm(), 0.004);
}

TEST(BallRefusals, settings_out_of_range_are_errors) {
  const std::vector<float> one(3, 1.0F);
  for (const double radius : {0.0, -5.0, 1e4, kNoValue}) EXPECT_FALSE(find_balls(one, settings(radius)).ok());
  BallSettings s = settings();
  s.count = 0;
  EXPECT_FALSE(find_balls(one, s).ok());
  s = settings();
  s.noise_mm = kNoValue;
  EXPECT_FALSE(find_balls(one, s).ok());
  EXPECT_FALSE(find_balls(std::vector<float>(4, 1.0F), settings()).ok());
}

// ---- shots -------------------------------------------------------------------------------------------------------

TEST(BallShots, are_averaged_when_they_agree) {
  std::vector<BallReport> shots;
  const BallScene first = scene_of(1);
  for (std::uint64_t k = 0; k < 3; ++k) {
    BallScene scene = first;
    scene.seed = 100 + k;
    shots.push_back(ball_of(scene));
  }
  const BallShots mean = average_shots(shots, settings());
  ASSERT_TRUE(mean.ok()) << mean.words.reason.view();
  EXPECT_LT((mean.centre_mm - first.balls[0].centre_mm).norm(), 0.002);
  EXPECT_LT(mean.repeat_mm, 0.002);
  EXPECT_NEAR(mean.cov_mm2.trace(), shots[0].cov_mm2().trace() / 3.0, 0.05 * shots[0].cov_mm2().trace());
  const BallShots single = average_shots({shots.data(), 1}, settings());
  EXPECT_TRUE(single.ok());
  EXPECT_FALSE(has_value(single.repeat_mm));
}

TEST(BallShots, that_moved_are_refused_and_the_worst_is_named) {
  std::vector<BallReport> shots(3);
  for (BallReport& shot : shots) {
    shot.refusal = BallRefusal::none;
    shot.centre_mm = Vec3(1.0, 2.0, 500.0);
    shot.cov_white_mm2 = 1e-6 * Mat3::Identity();
    shot.cov_correlated_mm2 = Mat3::Zero();
  }
  EXPECT_TRUE(average_shots(shots, settings()).ok());
  shots[1].centre_mm.x() += 0.04;
  const BallShots moved = average_shots(shots, settings());
  EXPECT_EQ(moved.refusal, BallRefusal::repeat);
  EXPECT_EQ(moved.worst_shot, 2);
  EXPECT_FALSE(moved.words.cure.empty());
  shots[2].refusal = BallRefusal::noisy;
  shots[2].words.reason = "noisy";
  const BallShots refused = average_shots(shots, settings());
  EXPECT_EQ(refused.refusal, BallRefusal::noisy);
  EXPECT_NE(refused.words.reason.view().find("shot 3"), std::string_view::npos);
  EXPECT_FALSE(average_shots({}, settings()).ok());
}

}  // namespace
}  // namespace slabd::calib
