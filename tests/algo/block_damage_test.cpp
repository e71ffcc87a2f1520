// SPDX-License-Identifier: Apache-2.0
//
// Blocks with objects on them, broken or covered parts: they fail, or the hidden items are not measured.
#include <gtest/gtest.h>

#include <cmath>

#include "base/prng.h"
#include "block_inspection.h"

namespace slabd::algo {
namespace {

TEST(Block, fails_the_flatness_only_when_there_is_a_bump) {
  scene::Block block;
  block.bump_mm = 1.5;
  const BlockResult r = inspect(block);
  expect_only_failure(r, ItemId::seat_flatness);
  EXPECT_NEAR(item(r, ItemId::seat_flatness).value, 1.5, 0.1);
  EXPECT_NEAR(item(r, ItemId::seat_slope).value, deg_from_rad(std::atan(1.0 / 40.0)), 0.001)
      << "the plane is not spoilt";
}

/// A good block, drawn once for all tests that change it.
const scene::Cloud& good_scan() {
  static const scene::Cloud cloud = scene::take({}, {});
  return cloud;
}

/// Raises (or lowers) a square part of the seat around (20, -30), as seen by a scanner looking straight down.
scene::Cloud with_plateau(double side, double height) {
  scene::Cloud cloud = good_scan();
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    float* p = cloud.xyz.data() + 3 * i;
    if (std::abs(static_cast<double>(p[0]) - 20.0) < 0.5 * side &&
        std::abs(static_cast<double>(p[1]) - 30.0) < 0.5 * side)
      p[2] -= static_cast<float>(height);
  }
  return cloud;
}

TEST(Block, fails_the_flatness_only_whatever_the_height_of_a_step) {
  for (const double height : {2.0, 5.0, -5.0, 12.0, 24.0, -24.0, 40.0}) {
    SCOPED_TRACE(height);
    const BlockResult r = inspect(with_plateau(40.0, height));
    expect_only_failure(r, ItemId::seat_flatness);
    EXPECT_NEAR(item(r, ItemId::seat_flatness).value, std::abs(height), 0.15 + 0.25 * std::abs(height))
        << "the step tilts the plane of the cell means";
    EXPECT_NEAR(std::max(r.seat.raw_high_mm, -r.seat.raw_low_mm), std::abs(height), 0.2);
  }
}

TEST(Block, measures_a_seat_that_sinks_smoothly_towards_an_edge) {
  const double slope_deg = item(inspect(scene::Block{}), ItemId::seat_slope).value;
  for (const double noise_mm : {0.013, 0.02})
    for (const double drop_mm : {0.1, 0.15, 0.25}) {
      SCOPED_TRACE(testing::Message() << drop_mm << " mm, noise " << noise_mm);
      scene::Block block;
      block.relief_mm = [&](double x, double) {
        return -drop_mm * std::pow(std::clamp((x - 21.0) / 30.0, 0.0, 1.0), 2);
      };
      scene::Scan scan;
      scan.noise_mm = noise_mm;
      const BlockResult r = inspect(scene::take(block, scan));
      EXPECT_TRUE(r.seat.plane.ok) << reason_of(r.seat.plane.doubt);
      EXPECT_EQ(r.verdict, Verdict::pass) << r.reason;
      EXPECT_NEAR(item(r, ItemId::seat_slope).value, slope_deg, item(r, ItemId::seat_slope).U);
      EXPECT_NEAR(item(r, ItemId::seat_flatness).value, drop_mm, 0.1);
    }
}

TEST(Block, does_not_judge_the_seat_by_a_part_of_it) {
  // More than half of the evaluation region is off the plane of the rest, further than any face's gate.
  for (const double height : {5.0, -5.0}) {
    SCOPED_TRACE(height);
    const BlockResult r = inspect(with_plateau(100.0, height));
    EXPECT_EQ(r.verdict, Verdict::not_measured);
    EXPECT_FALSE(r.seat.plane.ok);
    EXPECT_FALSE(has_value(item(r, ItemId::seat_slope).value));
  }
}

TEST(Block, fails_the_flatness_for_a_bolt_on_the_seat) {
  expect_only_failure(inspect(with_plateau(8.0, 30.0)), ItemId::seat_flatness);
}

TEST(Block, fails_the_flatness_only_for_damage_however_narrow) {
  // One or two lines of the scan wide; the shapes of
  // Denoise.keeps_connected_points_over_a_length_however_steep_or_ragged and taller ones.
  struct Case {
    const char* what;
    double size_mm;
    std::function<double(double, double)> relief_mm;
  };
  const auto across = [](double off_mm, double half_mm, double height_mm) {
    return std::abs(off_mm) < half_mm ? height_mm : 0.0;
  };
  const std::array<Case, 7> cases = {{
      {"a ridge", 2.5, [&](double x, double) { return across(x - 10.5, 0.6, 2.5); }},
      {"a groove", 2.5, [&](double, double s) { return across(s + 12.0, 0.5, -2.5); }},
      {"a slanting crack", 2.5, [&](double x, double s) { return across(x - 0.4 * s, 0.3, -2.5); }},
      {"a comb of fins", 2.0, [&](double x, double) { return across(std::remainder(x - 0.6, 3.0), 0.235, 2.0); }},
      {"a fin", 3.0, [&](double x, double s) { return std::abs(x) < 50.0 ? across(s - 3.0, 0.4, 3.0) : 0.0; }},
      {"a tall fin", 20.0, [&](double x, double s) { return std::abs(x) < 50.0 ? across(s - 3.0, 0.4, 20.0) : 0.0; }},
      {"a short crack", 3.0,
       [&](double x, double s) { return std::abs(s) < 10.0 ? across(x - 30.0, 0.25, -3.0) : 0.0; }},
  }};
  struct View {
    double pitch_mm, focus_mm;
    bool organised;
  };
  // The first two views measure every case, the others every third.
  const std::array<View, 5> views = {
      {{0.35, 0.0, true}, {0.41, 0.0, true}, {0.2, 0.0, true}, {0.35, 600.0, true}, {0.35, 0.0, false}}};
  for (std::size_t v = 0; v < views.size(); ++v) {
    for (std::size_t k = v < 2 ? 0 : v % 3; k < cases.size(); k += v < 2 ? 1 : 3) {
      const View& view = views[v];
      const Case& c = cases[k];
      SCOPED_TRACE(testing::Message() << c.what << " at " << view.pitch_mm << " mm, focus " << view.focus_mm
                                      << (view.organised ? "" : ", no grid"));
      scene::Block block;
      block.relief_mm = c.relief_mm;
      scene::Scan scan;
      scan.pitch_mm = view.pitch_mm;
      scan.focus_mm = view.focus_mm;
      scan.organised = view.organised;
      scan.displacement = scene::displaced(0.4, -0.6, 0.3, 0.1, -0.15, 0.2);
      const BlockResult r = inspect(scene::take(block, scan));
      expect_only_failure(r, ItemId::seat_flatness);
      EXPECT_NEAR(item(r, ItemId::seat_flatness).value, c.size_mm, 0.15 + 0.03 * c.size_mm);
    }
  }
}

TEST(Block, fails_the_flatness_for_damage_that_is_narrow_and_steep_or_ragged) {
  // No two neighbours of a line of the scan are at the same height.
  struct Case {
    const char* what;
    double pitch_mm, size_mm;
    std::function<double(double, double)> relief_mm;
  };
  const auto ragged = [](double from_mm, double to_mm, double half_mm) {
    return [=](double x, double s) {
      const double t = 43758.5453 * std::sin(12.9898 * std::floor(4.0 * x) + 4.1);
      const bool on = std::abs(s - 3.0) < half_mm && std::abs(x) < 45.0;
      return on ? from_mm + (to_mm - from_mm) * (t - std::floor(t)) : 0.0;
    };
  };
  const std::array<Case, 4> cases = {{
      {"a wire that leans", 0.4, 30.0,
       [](double x, double s) { return std::abs(s - 3.0) < 0.5 && x > 0.0 && x < 24.0 ? 1.25 * x : 0.0; }},
      {"a torn crack", 0.25, 4.0, ragged(-4.0, -2.0, 0.15)},
      {"a torn edge", 0.25, 6.5, ragged(5.4, 6.6, 0.225)},
      {"a steep fin", 0.25, 20.0,
       [](double x, double s) { return std::abs(s - 3.0) < 0.24 ? std::max(0.0, 20.0 - 1.6 * std::abs(x)) : 0.0; }},
  }};
  for (const bool organised : {true, false}) {
    for (const Case& c : cases) {
      SCOPED_TRACE(testing::Message() << c.what << (organised ? "" : ", no grid"));
      scene::Block block;
      block.relief_mm = c.relief_mm;
      scene::Scan scan;
      scan.pitch_mm = c.pitch_mm;
      scan.organised = organised;
      scan.displacement = scene::displaced(0.4, -0.6, 0.3, 0.1, -0.15, 0.2);
      const BlockResult r = inspect(scene::take(block, scan));
      expect_only_failure(r, ItemId::seat_flatness);
      EXPECT_NEAR(item(r, ItemId::seat_flatness).value, c.size_mm, 0.25 * c.size_mm);
    }
  }
}

TEST(Block, fails_the_flatness_for_a_tall_fin_of_two_coarse_rows) {
  // Rows 0.8 mm apart: most points of the fin's cells are on the fin.
  for (const double height_mm : {3.0, 10.0}) {
    for (const double at_mm : {3.0, 3.4, 3.8}) {
      scene::Block block;
      block.relief_mm = [&](double x, double s) {
        return std::abs(s - at_mm) < 0.8 && std::abs(x) < 50.0 ? height_mm : 0.0;
      };
      scene::Scan scan;
      scan.pitch_mm = 0.16;
      scan.pitch_ratio = 5.0;
      scan.organised = true;
      const BlockResult r = inspect(scene::take(block, scan));
      EXPECT_EQ(r.verdict, Verdict::fail) << height_mm << " mm high at " << at_mm;
      EXPECT_GT(item(r, ItemId::seat_flatness).value, 0.9 * height_mm) << at_mm;
    }
  }
}

/// Moves points up by `rise(x, y, z)`, in the block's nominal frame.
template <typename Rise>
scene::Cloud raised(scene::Cloud cloud, const Rise& rise) {
  const Pose T_scanner_block = cloud.T_block_scanner.inverse();
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    float* p = cloud.xyz.data() + 3 * i;
    const Vec3 block = cloud.T_block_scanner * Vec3(p[0], p[1], p[2]);
    const double up_mm = rise(block.x(), block.y(), block.z());
    if (up_mm == 0.0) continue;
    const Vec3 moved = T_scanner_block * (block + Vec3(0.0, 0.0, up_mm));
    for (int k = 0; k < 3; ++k) p[k] = static_cast<float>(moved[k]);
  }
  return cloud;
}

TEST(Block, does_not_judge_a_jaw_by_a_part_of_it) {
  // Mortar on a quarter of both jaws, or a quarter broken off: 5 mm off along the normal, beyond any face's gate, in
  // the section in which the distance is defined.
  for (const double up_mm : {15.0, -15.0}) {
    SCOPED_TRACE(up_mm);
    const BlockResult r = inspect(raised(good_scan(), [&](double x, double y, double z) {
      return std::abs(x) < 27.0 && std::abs(y) > 180.0 && z < 28.0 && on_block(z) ? up_mm : 0.0;
    }));
    EXPECT_FALSE(r.jaw_inner.ok);
    EXPECT_FALSE(r.jaw_outer.ok);
    EXPECT_LT(r.jaw_outer.inlier_fraction, 0.8);
    EXPECT_EQ(item(r, ItemId::jaw_distance).verdict, Verdict::not_measured);
    EXPECT_EQ(r.verdict, Verdict::not_measured);
  }
}

TEST(Block, does_not_judge_a_rim_by_a_part_of_it) {
  for (const double up_mm : {5.0, -5.0, 20.0}) {
    SCOPED_TRACE(up_mm);
    const BlockResult r = inspect(raised(good_scan(), [&](double x, double y, double) {
      return y > 95.0 && y < 140.0 && std::abs(x) < 25.0 && x > std::abs(y - 116.5) ? up_mm : 0.0;
    }));
    EXPECT_FALSE(r.casing_outer.ok);
    EXPECT_TRUE(r.casing_inner.ok);
    EXPECT_EQ(item(r, ItemId::casing_protrusion_outer).verdict, Verdict::not_measured);
    EXPECT_NE(r.verdict, Verdict::pass);
  }
}

TEST(Block, does_not_overlook_a_lip_of_a_rim) {
  // A millimetre of flash, on which the rail pad would rest: at the bore, or around the rim. In between the rim is
  // good.
  const double cant_rad = std::atan(1.0 / 40.0);
  for (const bool at_bore : {true, false}) {
    SCOPED_TRACE(at_bore);
    const BlockResult r = inspect(raised(good_scan(), [&](double x, double y, double z) {
      const double radius = std::hypot(x, y / std::cos(cant_rad) - 116.5);
      const bool lip = at_bore ? radius < 16.7 : radius > 20.3 && radius < 22.0;
      return lip && on_block(z) ? 1.0 : 0.0;
    }));
    EXPECT_FALSE(r.casing_outer.ok);
    EXPECT_TRUE(r.casing_inner.ok);
    EXPECT_EQ(item(r, ItemId::casing_protrusion_outer).verdict, Verdict::not_measured);
    EXPECT_NE(r.verdict, Verdict::pass);
  }
}

/// Keeps only `share` of the points in dark areas.
template <typename Dark>
scene::Cloud darkened(scene::Cloud cloud, double share, const Dark& dark) {
  Prng prng(9);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    const float* p = cloud.xyz.data() + 3 * i;
    const Vec3 block = cloud.T_block_scanner * Vec3(p[0], p[1], p[2]);
    if (dark(block.x(), block.y(), block.z()) && prng.uniform() > share) continue;
    for (std::size_t k = 0; k < 3; ++k) cloud.xyz[3 * kept + k] = p[k];
    ++kept;
  }
  cloud.xyz.resize(3 * kept);
  return cloud;
}
/// Fine enough that a fifth of the points still fills the cells.
scene::Scan fine(double focus_mm = 0.0) {
  scene::Scan scan;
  scan.pitch_mm = 0.2;
  scan.focus_mm = focus_mm;
  return scan;
}
/// A good block in a fine scan straight from above, drawn once.
const scene::Cloud& good_fine_scan() {
  static const scene::Cloud cloud = scene::take({}, fine());
  return cloud;
}
bool inner_seat(double, double y, double z) {
  return y < 0.0 && y > -180.0 && on_block(z);
}
double slope_error_deg(const BlockResult& r) {
  return item(r, ItemId::seat_slope).value - deg_from_rad(std::atan(1.0 / 40.0));
}

TEST(Block, does_not_judge_the_seat_by_its_denser_half) {
  // The inner half sinks and returns only a fifth of its points. Five of six points are on the other half's plane.
  scene::Block block;
  for (const double depth_mm : {0.5, 0.8, 5.0}) {
    block.relief_mm = [&](double, double s) {
      return depth_mm > 1.0 ? (s < 0.0 ? -depth_mm : 0.0) : std::min(depth_mm * s / 75.0, 0.0);
    };
    for (const double focus_mm : {0.0, 900.0}) {
      const scene::Cloud drawn = scene::take(block, fine(focus_mm));
      for (const double share : {0.18, 0.22}) {
        SCOPED_TRACE(testing::Message() << depth_mm << " mm, " << share << " of the points, focus " << focus_mm);
        const BlockResult r = inspect(darkened(drawn, share, inner_seat));
        EXPECT_FALSE(r.seat.plane.ok);
        EXPECT_EQ(r.verdict, Verdict::not_measured);
        EXPECT_FALSE(has_value(item(r, ItemId::seat_slope).value));
      }
    }
  }
}

TEST(Block, measures_a_flat_seat_however_unevenly_it_returns) {
  for (const double share : {0.2, 0.3, 0.5}) {
    SCOPED_TRACE(share);
    const BlockResult r = inspect(darkened(good_fine_scan(), share, inner_seat));
    EXPECT_EQ(r.verdict, Verdict::pass);
    EXPECT_LT(std::abs(slope_error_deg(r)), 0.001);
    EXPECT_LT(r.seat.by_area.normal.norm(), 2e-5) << "without form the density has no weight";
  }
}

TEST(Block, measures_a_bowed_seat_that_returns_evenly) {
  scene::Block block;
  for (const double bow_mm : {0.8, -0.8}) {
    SCOPED_TRACE(bow_mm);
    block.relief_mm = [&](double x, double s) {
      return bow_mm * std::max(0.0, 1.0 - std::hypot(x / 80.0, s / 100.0) * std::hypot(x / 80.0, s / 100.0));
    };
    const BlockResult r = inspect(scene::take(block, fine()));
    EXPECT_TRUE(r.seat.plane.ok);
    EXPECT_TRUE(has_value(item(r, ItemId::seat_flatness).value));
    EXPECT_LT(std::abs(slope_error_deg(r)), 0.003);
    EXPECT_LT(item(r, ItemId::seat_slope).U, 0.035) << "the form alone widens nothing";
  }
}

TEST(Block, states_by_how_much_a_bowed_seat_tilts_towards_its_denser_half) {
  scene::Block block;
  block.relief_mm = [](double x, double s) {
    return 0.75 * std::max(0.0, 1.0 - std::hypot(x / 80.0, s / 100.0) * std::hypot(x / 80.0, s / 100.0));
  };
  const scene::Cloud bowed = scene::take(block, fine());
  double largest = 0.0;
  for (const double share : {0.25, 0.33, 0.5}) {
    SCOPED_TRACE(share);
    const BlockResult r = inspect(darkened(bowed, share, inner_seat));
    if (!r.seat.plane.ok) continue;
    const double error_deg = std::abs(slope_error_deg(r));
    EXPECT_LE(error_deg, item(r, ItemId::seat_slope).U);
    EXPECT_NEAR(deg_from_rad(r.seat.by_area.normal.norm()), error_deg, 0.25 * error_deg + 0.002);
    largest = std::max(largest, error_deg);
  }
  EXPECT_GT(largest, 0.03) << "as much as U without it";
}

TEST(Block, does_not_judge_a_jaw_by_its_denser_part) {
  const auto outer_jaw = [](double y, double z) { return y > 186.0 && y < 200.0 && z > 5.5 && z < 29.0; };
  struct Case {
    const char* what;
    std::function<double(double x, double z)> inward_mm;
  };
  const std::array<Case, 3> cases = {
      {{"a layer on one half", [](double x, double) { return x > 0.0 ? 1.0 : 0.0; }},
       {"beyond the gate", [](double x, double) { return x > 0.0 ? 5.0 : 0.0; }},
       {"the upper half leans", [](double, double z) { return z > 17.0 ? 0.06 * (17.0 - z) : 0.0; }}}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.what);
    scene::Cloud cloud = good_fine_scan();
    const auto off = [&](double x, double y, double z) { return outer_jaw(y, z) ? c.inward_mm(x, z) : 0.0; };
    cloud = darkened(std::move(cloud), 0.2, [&](double x, double y, double z) { return off(x, y, z) != 0.0; });
    const Pose T_scanner_block = cloud.T_block_scanner.inverse();
    for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
      float* p = cloud.xyz.data() + 3 * i;
      const Vec3 block = cloud.T_block_scanner * Vec3(p[0], p[1], p[2]);
      const Vec3 moved = T_scanner_block * (block - Vec3(0.0, off(block.x(), block.y(), block.z()), 0.0));
      for (int k = 0; k < 3; ++k) p[k] = static_cast<float>(moved[k]);
    }
    const BlockResult r = inspect(std::move(cloud));
    EXPECT_FALSE(r.jaw_outer.ok);
    EXPECT_TRUE(r.jaw_inner.ok);
    EXPECT_EQ(item(r, ItemId::jaw_angle_outer).verdict, Verdict::not_measured);
    EXPECT_EQ(r.verdict, Verdict::not_measured);
  }
  const BlockResult good = inspect(
      darkened(good_fine_scan(), 0.2, [&](double x, double y, double z) { return x > 0.0 && outer_jaw(y, z); }));
  EXPECT_EQ(good.verdict, Verdict::pass) << "a half that is only dark";
}

TEST(Block, does_not_judge_the_slab_top_by_its_denser_half) {
  const auto half = [](double, double y, double z) { return y < 0.0 && !on_block(z); };
  const BlockResult r = inspect(raised(darkened(good_fine_scan(), 0.2, half),
                                       [&](double x, double y, double z) { return half(x, y, z) ? 0.004 * y : 0.0; }));
  EXPECT_FALSE(r.slab_top.ok);
  EXPECT_EQ(r.verdict, Verdict::not_measured);
  EXPECT_EQ(inspect(darkened(good_fine_scan(), 0.2, half)).verdict, Verdict::pass) << "a half that is only dark";
}

TEST(Block, does_not_judge_a_rim_by_its_denser_half) {
  const auto half = [](double x, double y, double z) {
    return x > 0.0 && std::hypot(x, y - 116.5) < 22.3 && on_block(z);
  };
  const scene::Cloud dark = darkened(good_fine_scan(), 0.2, half);
  EXPECT_EQ(inspect(dark).verdict, Verdict::pass) << "a half that is only dark";
  const BlockResult r = inspect(raised(dark, [&](double x, double y, double z) { return half(x, y, z) ? 1.0 : 0.0; }));
  EXPECT_FALSE(r.casing_outer.ok);
  EXPECT_TRUE(r.casing_inner.ok);
  EXPECT_EQ(r.verdict, Verdict::not_measured);
  // A lip at its edge, only on the dark half.
  const BlockResult lip = inspect(raised(dark, [&](double x, double y, double z) {
    return half(x, y, z) && std::hypot(x, y - 116.5) > 20.3 ? 1.0 : 0.0;
  }));
  EXPECT_FALSE(lip.casing_outer.ok);
  EXPECT_EQ(lip.verdict, Verdict::not_measured);
}

TEST(Block, does_not_judge_a_tilted_rim_by_its_denser_half) {
  const double cant_rad = std::atan(1.0 / 40.0);
  const auto on_rim = [&](double x, double y, double z) {
    return std::hypot(x, y / std::cos(cant_rad) - 116.5) < 22.0 && on_block(z);
  };
  // Lower by `low_mm` at its middle and sloping down to the dark side.
  const auto rim = [&](double low_mm, double fall_mm, double share) {
    const scene::Cloud dark =
        darkened(good_fine_scan(), share, [&](double x, double y, double z) { return x > 0.0 && on_rim(x, y, z); });
    return inspect(raised(
        dark, [&](double x, double y, double z) { return on_rim(x, y, z) ? -low_mm - fall_mm * x / 22.0 : 0.0; }));
  };
  for (const double share : {1.0, 0.2}) {
    const BlockResult r = rim(0.3, 0.3, share);
    EXPECT_FALSE(r.casing_outer.ok) << "too tilted, share " << share;
    EXPECT_TRUE(r.casing_inner.ok) << share;
    EXPECT_NE(r.verdict, Verdict::pass) << share;
  }
  // With the maximum allowed tilt, the height is valid for the whole rim.
  for (const double share : {1.0, 0.2}) {
    const BlockResult r = rim(0.1, 0.2, share);
    EXPECT_NEAR(item(r, ItemId::casing_protrusion_outer).value, -0.35, 0.01) << share;
    EXPECT_NEAR(item(r, ItemId::casing_protrusion_inner).value, -0.25, 0.002) << share;
  }
}

}  // namespace
}  // namespace slabd::algo
