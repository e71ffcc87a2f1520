// SPDX-License-Identifier: Apache-2.0
//
// Damage outside all items: the block must not pass, and the finding gives its position and size.
#include "algo/survey/surface_findings.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "tests/algo/block_inspection.h"

namespace slabd::algo {
namespace {

scene::Scan seen(double focus_mm, std::uint64_t seed = 1) {
  scene::Scan scan;
  scan.focus_mm = focus_mm;
  scan.pitch_mm = 0.41;
  scan.organised = true;
  scan.seed = seed;
  scan.displacement = scene::displaced(1.2, -0.8, 0.5, 0.15, -0.2, 0.1);
  return scan;
}

/// Lowers the points in `place` (block frame, x and y) by `depth_mm`; NaN removes them.
scene::Cloud with_hole(scene::Cloud cloud, const std::function<bool(const Vec3&)>& place, double depth_mm) {
  const Pose T_scanner_block = cloud.T_block_scanner.inverse();
  for (std::size_t i = 0; i < cloud.xyz.size(); i += 3) {
    Vec3 p = cloud.T_block_scanner * Vec3(cloud.xyz[i], cloud.xyz[i + 1], cloud.xyz[i + 2]);
    if (!place(p)) continue;
    p.z() = std::max(p.z() - depth_mm, -30.0);
    const Vec3 q = T_scanner_block * p;
    for (std::size_t k = 0; k < 3; ++k) cloud.xyz[i + k] = static_cast<float>(q[static_cast<Eigen::Index>(k)]);
  }
  return cloud;
}

/// Expects a block whose items are good and which does not pass because of its findings.
void expect_doubt(const BlockResult& r) {
  EXPECT_EQ(r.verdict, Verdict::indeterminate);
  EXPECT_EQ(r.reason, 617);
  ASSERT_FALSE(r.findings.empty());
  for (const Item& i : r.items) EXPECT_TRUE(!i.required || i.verdict == Verdict::pass) << info(i.id).name;
}

TEST(Findings, half_a_seat_sunk_next_to_the_evaluation_region_is_one) {
  for (const double focus_mm : {0.0, 600.0}) {
    for (const double depth_mm : {1.5, 4.0, 10.0}) {
      SCOPED_TRACE(testing::Message() << depth_mm << " mm, focus " << focus_mm);
      scene::Block block;
      block.relief_mm = [&](double x, double) { return x > 55.0 ? -depth_mm : 0.0; };
      const BlockResult r = inspect(scene::take(block, seen(focus_mm)));
      expect_doubt(r);
      if (r.findings.empty()) continue;
      const SurfaceFinding& f = r.findings[0];
      EXPECT_EQ(f.face, FindingFace::seat);
      EXPECT_EQ(f.kind, FindingKind::chip) << "open towards the end of the block";
      EXPECT_NEAR(f.x_mm, 0.5 * (55.0 + 97.0), 3.0);
      EXPECT_NEAR(f.s_mm, 0.0, 15.0);
      EXPECT_NEAR(f.length_mm, 42.0, 6.0);
      EXPECT_NEAR(f.width_mm, 358.0, 8.0);
      EXPECT_NEAR(f.depth_mm, depth_mm, 0.3 + 0.05 * depth_mm);
      EXPECT_NEAR(f.volume_mm3, f.area_mm2 * depth_mm, 0.1 * f.area_mm2 * depth_mm);
    }
  }
}

TEST(Findings, a_corner_broken_out_is_one) {
  // 41 mm along the rail, from s 155 over seat, jaw and shoulder; the end face stays, so that the block is found.
  for (const double focus_mm : {0.0, 600.0}) {
    for (const double side : {-1.0, 1.0}) {
      SCOPED_TRACE(testing::Message() << "side " << side << ", focus " << focus_mm);
      const auto corner = [&](const Vec3& p) {
        return p.x() > 57.0 && p.x() < 98.0 && side * p.y() > 155.0 && side * p.y() < 230.0;
      };
      const BlockResult r = inspect(with_hole(scene::take({}, seen(focus_mm)), corner, 15.0));
      EXPECT_NE(r.verdict, Verdict::pass);
      const FindingFace jaw = side > 0.0 ? FindingFace::jaw_outer : FindingFace::jaw_inner;
      bool on_seat = false;
      bool on_jaw = false;
      for (const SurfaceFinding& f : r.findings) {
        EXPECT_NEAR(f.x_mm, 77.0, 4.0);
        EXPECT_GT(side * f.s_mm, 155.0);
        on_seat = on_seat || f.face == FindingFace::seat;
        on_jaw = on_jaw || f.face == jaw;
        EXPECT_NEAR(f.length_mm, 38.0, 6.0);
        if (f.face == FindingFace::seat) {
          EXPECT_NEAR(f.depth_mm, 15.0, 1.0);
          EXPECT_NEAR(f.s_mm, side * 167.0, 2.0);
        }
      }
      EXPECT_TRUE(on_seat);
      EXPECT_TRUE(on_jaw);
    }
  }
}

TEST(Findings, a_hole_next_to_a_jaw_is_one_though_every_item_passes) {
  for (const double focus_mm : {0.0, 600.0}) {
    scene::Block block;
    block.relief_mm = [](double x, double s) { return x > 57.0 && s > 155.0 && s < 183.0 ? -15.0 : 0.0; };
    const BlockResult r = inspect(scene::take(block, seen(focus_mm)));
    expect_doubt(r);
    ASSERT_EQ(r.findings.size(), 1U);
    EXPECT_NEAR(r.findings[0].s_mm, 167.0, 2.0);
    EXPECT_NEAR(r.findings[0].depth_mm, 15.0, 1.0);
  }
}

TEST(Findings, an_end_broken_off_or_a_groove_at_the_foot_11_mm_wide_is_one) {
  const auto end = [](const Vec3& p) { return p.x() > 94.0 && std::abs(p.y()) < 185.0 && p.z() > -12.0; };
  const auto groove = [](const Vec3& p) { return p.y() > 176.0 && p.y() < 187.0 && std::abs(p.x()) < 104.0; };
  for (const double focus_mm : {0.0, 600.0}) {
    SCOPED_TRACE(focus_mm);
    expect_doubt(inspect(with_hole(scene::take({}, seen(focus_mm)), end, 10.0)));
    expect_doubt(inspect(with_hole(scene::take({}, seen(focus_mm)), groove, 3.0)));
  }
}

TEST(Findings, surface_without_points_amid_the_scan_is_one) {
  const float nan = std::nanf("");
  scene::Cloud cloud = scene::take({}, seen(0.0));
  for (std::size_t i = 0; i < cloud.xyz.size(); i += 3) {
    const Vec3 p = cloud.T_block_scanner * Vec3(cloud.xyz[i], cloud.xyz[i + 1], cloud.xyz[i + 2]);
    if (std::abs(p.x() - 75.0) < 8.0 && std::abs(p.y() + 20.0) < 12.0) cloud.xyz[i] = nan;
  }
  // Also where the block fills a part of a large image, so that few of all points are on it.
  for (const bool large : {false, true}) {
    SCOPED_TRACE(large);
    const BlockResult r = inspect(large ? in_large_image(cloud) : cloud);
    expect_doubt(r);
    ASSERT_EQ(r.findings.size(), 1U);
    EXPECT_EQ(r.findings[0].kind, FindingKind::missing);
    EXPECT_FALSE(has_value(r.findings[0].depth_mm));
    EXPECT_NEAR(r.findings[0].x_mm, 75.0, 1.5);
    EXPECT_NEAR(r.findings[0].s_mm, -20.0, 1.5);
    EXPECT_NEAR(r.findings[0].area_mm2, 16.0 * 24.0, 110.0);
  }
}

TEST(Findings, an_object_on_the_seat_is_one) {
  scene::Block block;
  block.relief_mm = [](double x, double s) { return std::hypot(x + 70.0, s - 60.0) < 9.0 ? 6.0 : 0.0; };
  const BlockResult r = inspect(scene::take(block, seen(600.0)));
  expect_doubt(r);
  ASSERT_EQ(r.findings.size(), 1U);
  EXPECT_EQ(r.findings[0].kind, FindingKind::bump);
  EXPECT_NEAR(r.findings[0].x_mm, -70.0, 2.0);
  EXPECT_NEAR(r.findings[0].s_mm, 60.0, 2.0);
  EXPECT_NEAR(r.findings[0].depth_mm, 6.0, 0.5);
}

TEST(Findings, smaller_than_a_hundred_square_millimetres_or_shallower_than_one_are_none) {
  scene::Block block;
  block.relief_mm = [](double x, double s) {
    if (std::abs(x - 75.0) < 3.5 && std::abs(s) < 3.5) return -8.0;  // a pore of 49 mm2
    return x < -60.0 ? -0.6 : 0.0;
  };
  const BlockResult r = inspect(scene::take(block, seen(600.0)));
  EXPECT_TRUE(r.findings.empty()) << sentence(r.findings[0]).c_str();
  EXPECT_EQ(r.verdict, Verdict::pass);
}

TEST(Findings, are_empty_for_good_blocks) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    scene::Scan scan = seen(seed % 2 == 0 ? 600.0 : 0.0, seed);
    const auto k = static_cast<double>(seed);
    scan.displacement = scene::displaced(3.0 * k - 9.0, 8.0 - 2.0 * k, k, 0.9 * k - 3.0, 2.5 - k, 0.7 * k);
    scan.missing_share = seed == 3 ? 0.1 : 0.02;
    scan.noise_mm = seed == 4 ? 0.1 : 0.03;
    const BlockResult r = inspect(scene::take({}, scan));
    EXPECT_TRUE(r.findings.empty()) << seed << ": " << sentence(r.findings[0]).c_str();
  }
}

TEST(Findings, end_where_the_field_of_view_ends) {
  // The last 25 mm of the block are outside the field of view: not seen, but not missing.
  scene::Cloud cloud = scene::take({}, seen(0.0));
  for (std::size_t i = 0; i < cloud.xyz.size(); i += 3)
    if (cloud.xyz[i] > 80.0F) cloud.xyz[i] = std::nanf("");
  const BlockResult r = inspect(cloud);
  EXPECT_TRUE(r.findings.empty()) << sentence(r.findings[0]).c_str();
}

}  // namespace
}  // namespace slabd::algo
