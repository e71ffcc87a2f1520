// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "algo/algo.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

/// Denoises and registers `cloud` from a start that is `off` the nominal view.
struct Registered {
  Registered(scene::Cloud cloud, const Pose& off, const Recipe& recipe = scene::p5600(), int threads = 1)
      : inspector(threads) {
    inspector.use(recipe);
    inspector.begin(1, Pose::identity(), off * nominal_T_block_scanner());
    Cloud view = cloud.view();
    const Status cleaned = inspector.denoise(view);
    if (!cleaned) {
      code = cleaned.error().code;
      return;
    }
    const Status status = inspector.register_to_model(view);
    if (!status) code = status.error().code;
    const Pose error = cloud.T_block_scanner * report().T_scanner_block;
    error_mm = error.translation_mm.norm();
    error_deg = deg_from_rad(angle_between_rad(error.rotation, Quat::Identity()));
  }
  [[nodiscard]] const RegistrationReport& report() const { return inspector.result().registration; }

  BlockInspector inspector;
  Code code = Code::ok;
  double error_mm = 0.0;
  double error_deg = 0.0;
};

scene::Cloud plain_scan(const scene::Block& block = {}) {
  return scene::take(block, {});
}

TEST(Registration, finds_the_pose_to_a_micrometre) {
  scene::Scan scan;
  scan.displacement = scene::displaced(1.5, -2.0, 0.7, 0.2, -0.3, 0.25);
  const Registered r(scene::take({}, scan), Pose::identity());
  ASSERT_EQ(r.report().status, RegistrationStatus::converged) << r.report().note.c_str();
  EXPECT_LT(r.error_mm, 0.002);
  EXPECT_LT(r.error_deg, 0.0005);
  EXPECT_GT(r.report().share_associated, 0.99);
  EXPECT_LT(r.report().condition, 200.0);
}

TEST(Registration, reports_deviations_of_all_points_near_the_model) {
  // For an accepted pose they are computed together with the measurement.
  scene::Cloud cloud = plain_scan();
  Registered r(cloud, Pose::identity());
  algo::Cloud view = cloud.view();
  ASSERT_TRUE(r.inspector.denoise(view));
  ASSERT_TRUE(r.inspector.extract(view));
  const DeviationStats& d = r.report().deviation;
  EXPECT_GT(static_cast<double>(d.count), 0.999 * static_cast<double>(r.inspector.result().scan.points_kept));
  EXPECT_NEAR(d.mean_mm, 0.0, 0.001);
  EXPECT_NEAR(d.std_mm, 0.029, 0.002) << "0.03 mm along the ray, less on steep faces";
  EXPECT_NEAR(d.within_sigma[0], 0.683, 0.02);
  EXPECT_NEAR(d.within_sigma[1], 0.954, 0.01);
  EXPECT_NEAR(d.within_sigma[5], 1.0, 0.002);
  for (std::size_t k = 1; k < 6; ++k) EXPECT_GE(d.within_sigma[k], d.within_sigma[k - 1]);
}

TEST(Registration, converges_from_twenty_millimetres_and_three_degrees_in_every_direction) {
  const scene::Cloud cloud = plain_scan();
  Prng prng(7);
  for (int i = 0; i < 12; ++i) {
    Vec3 shift(prng.normal(), prng.normal(), prng.normal());
    Vec3 turn(prng.normal(), prng.normal(), prng.normal());
    shift *= 20.0 / shift.norm();
    turn *= 3.0 / turn.norm();
    const Registered r(cloud, scene::displaced(shift.x(), shift.y(), shift.z(), turn.x(), turn.y(), turn.z()));
    ASSERT_EQ(r.report().status, RegistrationStatus::converged)
        << shift.transpose() << " mm, " << turn.transpose() << " deg: " << r.report().note.c_str();
    EXPECT_LT(r.error_mm, 0.01);
  }
}

TEST(Registration, is_right_or_reports_failure_from_any_distance) {
  const scene::Cloud cloud = plain_scan();
  Prng prng(8);
  int converged = 0;
  for (int i = 0; i < 12; ++i) {
    Vec3 shift(prng.normal(), prng.normal(), prng.normal());
    Vec3 turn(prng.normal(), prng.normal(), prng.normal());
    shift *= (30.0 + 6.0 * i) / shift.norm();
    turn *= 5.0 / turn.norm();
    const Registered r(cloud, scene::displaced(shift.x(), shift.y(), shift.z(), turn.x(), turn.y(), turn.z()));
    if (r.report().status != RegistrationStatus::converged) {
      EXPECT_EQ(r.code, Code::block_not_found);
      EXPECT_FALSE(r.report().note.empty());
      continue;
    }
    ++converged;
    EXPECT_LT(r.error_mm, 0.01) << shift.transpose();
    EXPECT_LE(shift.norm(), 60.5) << "beyond the window";
  }
  EXPECT_GE(converged, 1);
}

TEST(Registration, keeps_its_pose_on_a_block_with_long_ends_and_wide_jaws) {
  scene::Block block;
  block.end_half_mm = 106.0;
  block.jaw_distance_mm = 381.0;
  const Registered r(plain_scan(block), Pose::identity());
  ASSERT_EQ(r.report().status, RegistrationStatus::converged) << r.report().note.c_str();
  // Both ends are a millimetre too long; their numbers of sampled points determine the middle: 0.07 to 0.19 mm.
  EXPECT_LT(r.error_mm, 0.25);
}

void expect_not_found(const scene::Cloud& cloud, const Pose& off = Pose::identity()) {
  const Registered r(cloud, off);
  EXPECT_EQ(r.code, Code::block_not_found) << name(r.report().status);
  EXPECT_NE(r.report().status, RegistrationStatus::converged);
  EXPECT_FALSE(r.report().note.empty());
}

TEST(Registration, does_not_find_a_block_on_a_bare_slab) {
  scene::Block bare;
  bare.present = false;
  expect_not_found(plain_scan(bare));
  const Registered r(plain_scan(bare), Pose::identity());
  EXPECT_EQ(r.report().status, RegistrationStatus::degenerate);
  EXPECT_NE(r.report().note.view().find("(x)"), std::string_view::npos) << r.report().note.c_str();
}

TEST(Registration, does_not_find_a_block_on_a_bare_slab_at_the_height_of_the_seat) {
  scene::Block bare;
  bare.present = false;
  expect_not_found(plain_scan(bare), scene::displaced(0.0, 0.0, -30.0, 0.0, 0.0, 0.0));
  expect_not_found(plain_scan(bare), scene::displaced(0.0, 0.0, -30.0, -1.4, 0.0, 0.0));
}

TEST(Registration, does_not_take_a_neighbour_half_in_view_for_the_block) {
  scene::Scan scan;
  scan.displacement = scene::displaced(140.0, 0.0, 0.0, 0.0, 0.0, 0.0);
  expect_not_found(scene::take({}, scan));
}

TEST(Registration, does_not_take_a_block_the_wrong_way_round_for_the_block) {
  scene::Scan scan;
  scan.displacement = scene::displaced(0.0, 0.0, 0.0, 0.0, 0.0, 180.0);
  expect_not_found(scene::take({}, scan));
}

TEST(Registration, does_not_find_a_block_in_a_box_of_noise) {
  scene::Cloud cloud;
  cloud.T_block_scanner = nominal_T_block_scanner();
  Prng prng(5);
  // Scale of 3 mm, so that denoising keeps them.
  for (int i = 0; i < 6000; ++i) {
    const double x = 350.0 * (prng.uniform() - 0.5);
    const double y = 500.0 * (prng.uniform() - 0.5);
    const double z = 560.0 + 80.0 * prng.uniform();
    for (int k = 0; k < 64; ++k)
      cloud.xyz.insert(cloud.xyz.end(), {static_cast<float>(x + 0.4 * (k % 8)), static_cast<float>(y + 0.4 * (k / 8)),
                                         static_cast<float>(z)});
  }
  expect_not_found(cloud);
}

/// Removes points from the scan by their position in the block's frame; the scan then has no grid.
template <typename Unseen>
void take_out(scene::Cloud& cloud, const Unseen& unseen) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    const float* f = cloud.xyz.data() + 3 * i;
    const Vec3 p =
        cloud.T_block_scanner * Vec3(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
    if (!unseen(p)) std::copy_n(f, 3, cloud.xyz.data() + 3 * kept++);
  }
  cloud.xyz.resize(3 * kept);
  cloud.width = cloud.height = 0;
}
/// Removes the surroundings of both casings.
void without_casings(scene::Cloud& cloud) {
  take_out(cloud, [](const Vec3& p) { return std::hypot(p.x(), std::abs(p.y()) - 116.5) < 35.0; });
}
/// Removes the end faces, drafted by 10 degrees.
void without_ends(scene::Cloud& cloud) {
  take_out(cloud, [](const Vec3& p) {
    return std::abs(std::abs(p.x()) - 105.0 + p.z() * std::tan(rad_from_deg(10.0))) < 0.5 && p.z() > -29.0;
  });
}

TEST(Registration, takes_the_place_along_the_rail_from_the_casings_when_no_end_is_in_view) {
  scene::Scan scan;
  scan.field_x_mm = 170.0;
  scan.displacement = scene::displaced(18.0, -7.0, 2.0, 0.5, -1.0, 1.5);
  const Registered r(scene::take({}, scan), Pose::identity());
  ASSERT_EQ(r.report().status, RegistrationStatus::converged) << r.report().note.c_str();
  EXPECT_LT(r.error_mm, 0.1);
  EXPECT_LT(r.error_deg, 0.02);
  const Registered with_ends(plain_scan(), Pose::identity());
  ASSERT_EQ(with_ends.report().status, RegistrationStatus::converged);
  EXPECT_GT(r.report().covariance(0, 0), 10.0 * with_ends.report().covariance(0, 0))
      << "casings say it less sharply than ends";
}

TEST(Registration, has_the_same_bits_on_two_threads_where_casings_or_a_search_are_needed) {
  scene::Scan narrow;
  narrow.field_x_mm = 170.0;
  const Pose along = scene::displaced(20.0, 0.0, 0.0, 0.0, 0.0, 0.0);
  const Pose far = scene::displaced(25.0, -30.0, 20.0, 3.0, -2.0, 4.0);
  for (const scene::Scan& scan : {scene::Scan{}, narrow}) {
    for (const Pose& off : {along, far}) {
      const Registered one(scene::take({}, scan), off, scene::p5600(), 1);
      const Registered two(scene::take({}, scan), off, scene::p5600(), 2);
      ASSERT_EQ(one.report().status, RegistrationStatus::converged) << one.report().note.c_str();
      ASSERT_EQ(two.report().status, RegistrationStatus::converged) << two.report().note.c_str();
      EXPECT_LT(one.error_mm, 0.1);
      EXPECT_EQ(one.report().iterations, two.report().iterations);
      EXPECT_EQ(one.report().T_scanner_block.translation_mm, two.report().T_scanner_block.translation_mm);
      EXPECT_EQ(one.report().T_scanner_block.rotation.coeffs(), two.report().T_scanner_block.rotation.coeffs());
      EXPECT_EQ(one.report().covariance, two.report().covariance);
    }
  }
}

TEST(Registration, uses_the_robots_pose_along_the_rail_where_the_scan_does_not_determine_it) {
  // Neither end face in view, and no casing: the scan does not determine the position along the rail.
  scene::Scan scan;
  scan.field_x_mm = 170.0;
  scene::Cloud cloud = scene::take({}, scan);
  without_casings(cloud);
  const Registered r(std::move(cloud), scene::displaced(3.0, 2.0, 1.0, 0.1, 0.2, 0.1));
  EXPECT_EQ(r.report().status, RegistrationStatus::converged) << r.report().note.view();
  EXPECT_EQ(r.report().note.view(), "along the rail from the robot, +-10 mm: no bore is seen");
  EXPECT_NEAR(std::sqrt(r.report().covariance(0, 0)), 5.0, 0.1);
  EXPECT_LT(std::sqrt(r.report().covariance(1, 1)), 0.05) << "nothing else is in doubt";
}

TEST(Registration, takes_the_blocks_ends_along_the_rail_where_no_bore_is_seen) {
  // Capped casings, and end faces so steep that they return no points.
  for (const double along_mm : {0.0, 8.0}) {
    SCOPED_TRACE(along_mm);
    scene::Cloud cloud = scene::take({}, {});
    without_casings(cloud);
    without_ends(cloud);
    const Registered r(std::move(cloud), scene::displaced(along_mm, 1.0, 0.0, 0.0, 0.0, 0.1));
    EXPECT_EQ(r.report().status, RegistrationStatus::converged) << r.report().note.view();
    EXPECT_EQ(r.report().note.view(), "along the rail from the ends, +-1 mm: no bore is seen");
    EXPECT_NEAR(std::sqrt(r.report().covariance(0, 0)), 0.5, 0.02);
    EXPECT_LT(r.error_mm, 1.0) << "two standard deviations";
  }
}

TEST(Registration, rejects_a_pose_beyond_its_window) {
  Recipe recipe = scene::p5600();
  recipe.evaluation.window_mm = 5.0;
  const Registered r(plain_scan(), scene::displaced(8.0, 0.0, 0.0, 0.0, 0.0, 0.0), recipe);
  EXPECT_EQ(r.report().status, RegistrationStatus::rejected);
  EXPECT_NE(r.report().note.view().find("moved 8.0 mm"), std::string_view::npos) << r.report().note.c_str();
}

TEST(Registration, refuses_a_start_that_is_not_a_pose) {
  scene::Cloud cloud = plain_scan();
  BlockInspector inspector;
  inspector.use(scene::p5600());
  Pose broken = nominal_T_block_scanner();
  broken.translation_mm.x() = kNoValue;
  inspector.begin(1, Pose::identity(), broken);
  Cloud view = cloud.view();
  ASSERT_TRUE(inspector.denoise(view).ok());
  const Status status = inspector.register_to_model(view);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::no_pose);
}

}  // namespace
}  // namespace slabd::algo
