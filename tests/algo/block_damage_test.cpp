// SPDX-License-Identifier: Apache-2.0
//
// What stands on a block, has broken out of it or covers a part of it: it fails, or what it hides is not measured.
#include <gtest/gtest.h>

#include <cmath>

#include "block_inspection.h"

namespace slabd::algo {
namespace {

TEST(Block, FailsTheFlatnessOnlyWhenThereIsABump) {
  scene::Block block;
  block.bump_mm = 1.5;
  const BlockResult r = inspect(block);
  expect_only_failure(r, ItemId::seat_flatness);
  EXPECT_NEAR(item(r, ItemId::seat_flatness).value, 1.5, 0.1);
  EXPECT_NEAR(item(r, ItemId::seat_slope).value, deg_from_rad(std::atan(1.0 / 40.0)), 0.001)
      << "the plane is not spoilt";
}

/// Lifts (or sinks) a square part of the seat round (20, -30) as a scanner looking straight down would see it.
scene::Cloud with_plateau(double side, double height, const scene::Scan& scan = {}) {
  scene::Cloud cloud = scene::take({}, scan);
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    float* p = cloud.xyz.data() + 3 * i;
    if (std::abs(static_cast<double>(p[0]) - 20.0) < 0.5 * side &&
        std::abs(static_cast<double>(p[1]) - 30.0) < 0.5 * side)
      p[2] -= static_cast<float>(height);
  }
  return cloud;
}

TEST(Block, FailsTheFlatnessOnlyWhateverTheHeightOfAStep) {
  for (const double height : {2.0, 5.0, -5.0, 12.0, 24.0, -24.0, 40.0}) {
    SCOPED_TRACE(height);
    const BlockResult r = inspect(with_plateau(40.0, height));
    expect_only_failure(r, ItemId::seat_flatness);
    EXPECT_NEAR(item(r, ItemId::seat_flatness).value, std::abs(height), 0.15 + 0.25 * std::abs(height))
        << "the step tilts the plane of the cell means";
    EXPECT_NEAR(std::max(r.seat.raw_high_mm, -r.seat.raw_low_mm), std::abs(height), 0.2);
  }
}

TEST(Block, DoesNotLetAPartOfTheSeatSpeakForTheWhole) {
  // More than half of the evaluation region lies off the plane of the rest, further than any face's gate.
  for (const double height : {5.0, -5.0}) {
    SCOPED_TRACE(height);
    const BlockResult r = inspect(with_plateau(100.0, height));
    EXPECT_EQ(r.verdict, Verdict::not_measured);
    EXPECT_FALSE(r.seat.plane.ok);
    EXPECT_FALSE(has_value(item(r, ItemId::seat_slope).value));
  }
}

TEST(Block, FailsTheFlatnessForABoltOnTheSeat) {
  expect_only_failure(inspect(with_plateau(8.0, 30.0)), ItemId::seat_flatness);
}

TEST(Block, FailsTheFlatnessOnlyForDamageHoweverNarrow) {
  // One or two lines of the scan wide; the shapes of WhatHangsTogetherIsNoStrayHoweverNarrow and taller ones.
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
  // The first two views see every case, the others every third.
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

TEST(Block, FailsTheFlatnessForATallFinOfTwoCoarseRows) {
  // Rows 0.8 mm apart: the fin holds most points of its cells.
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

/// Moves points up by what `rise(x, y, z)` says, in the block's nominal frame.
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

TEST(Block, DoesNotLetAPartOfAJawSpeakForTheWhole) {
  // Mortar on a quarter of both jaws, or broken out of it: 5 mm off along the normal, beyond any face's gate, at the
  // very section that the distance is told of.
  for (const double up_mm : {15.0, -15.0}) {
    SCOPED_TRACE(up_mm);
    const BlockResult r = inspect(raised(scene::take({}, {}), [&](double x, double y, double z) {
      return std::abs(x) < 27.0 && std::abs(y) > 180.0 && z < 28.0 && on_block(z) ? up_mm : 0.0;
    }));
    EXPECT_FALSE(r.jaw_inner.ok);
    EXPECT_FALSE(r.jaw_outer.ok);
    EXPECT_LT(r.jaw_outer.inlier_fraction, 0.8);
    EXPECT_EQ(item(r, ItemId::jaw_distance).verdict, Verdict::not_measured);
    EXPECT_EQ(r.verdict, Verdict::not_measured);
  }
}

TEST(Block, DoesNotLetAPartOfARimSpeakForTheWhole) {
  for (const double up_mm : {5.0, -5.0, 20.0}) {
    SCOPED_TRACE(up_mm);
    const BlockResult r = inspect(raised(scene::take({}, {}), [&](double x, double y, double) {
      return y > 95.0 && y < 140.0 && std::abs(x) < 25.0 && x > std::abs(y - 116.5) ? up_mm : 0.0;
    }));
    EXPECT_FALSE(r.casing_outer.ok);
    EXPECT_TRUE(r.casing_inner.ok);
    EXPECT_EQ(item(r, ItemId::casing_protrusion_outer).verdict, Verdict::not_measured);
    EXPECT_NE(r.verdict, Verdict::pass);
  }
}

TEST(Block, DoesNotOverlookALipOfARim) {
  // A millimetre of flash, on which the rail pad would lie: at the bore, or round the rim. In between the rim is good.
  const double cant_rad = std::atan(1.0 / 40.0);
  for (const bool at_bore : {true, false}) {
    SCOPED_TRACE(at_bore);
    const BlockResult r = inspect(raised(scene::take({}, {}), [&](double x, double y, double z) {
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

}  // namespace
}  // namespace slabd::algo
