// SPDX-License-Identifier: Apache-2.0
//
// Pores and damage as items: features of good concrete pass, and damage that a person would reject does not, anywhere.
#include "algo/survey/surface_damage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>

#include "tests/algo/block_inspection.h"
#include "tests/algo/each_set.h"

namespace slabd::algo {
namespace {

Recipe with_surface_items() {
  Recipe recipe = scene::p5600();
  const auto set = [&](ItemId id, double upper, double U) {
    Tolerance& t = recipe.tolerances[static_cast<std::size_t>(id)];
    t.given = true;
    t.required = true;
    t.nominal = {0.0, true};
    t.upper = upper;
    t.U = U;
    t.confirmed = true;
  };
  set(ItemId::surface_pores, 10.0, 1.0);
  set(ItemId::block_damage, 6.0, 2.5);
  return recipe;
}

scene::Scan seen(double focus_mm = 0.0, std::uint64_t seed = 1) {
  scene::Scan scan;
  scan.focus_mm = focus_mm;
  scan.pitch_mm = 0.35;
  scan.organised = true;
  scan.seed = seed;
  scan.displacement = scene::displaced(1.2, -0.8, 0.5, 0.15, -0.2, 0.1);
  return scan;
}

constexpr double kNotSeen = -1e9;
/// Lowers the scan to `floor(x, y)` (block frame) where it is above that; kNotSeen: removes the point.
scene::Cloud lowered(scene::Cloud cloud, const std::function<double(const Vec3&)>& floor) {
  const Pose T_scanner_block = cloud.T_block_scanner.inverse();
  for (std::size_t i = 0; i < cloud.xyz.size(); i += 3) {
    if (std::isnan(cloud.xyz[i])) continue;
    Vec3 p = cloud.T_block_scanner * Vec3(cloud.xyz[i], cloud.xyz[i + 1], cloud.xyz[i + 2]);
    const double z = floor(p);
    if (!(z < p.z())) continue;
    p.z() = z;
    const Vec3 q = T_scanner_block * p;
    for (std::size_t k = 0; k < 3; ++k)
      cloud.xyz[i + k] = z == kNotSeen ? std::nanf("") : static_cast<float>(q[static_cast<Eigen::Index>(k)]);
  }
  return cloud;
}

constexpr double kNowhere = 1e9;
constexpr double kCant = 1.0 / 40.0;
constexpr double kEndFall = 0.17633;  ///< tan 10 deg
/// A chamfer along both ends of the seat, worn along its length like the emulator's.
double chamfered(const Vec3& p) {
  if (std::abs(p.y()) > 182.0 || p.z() < -20.0) return kNowhere;
  const double z = kCant * p.y();
  const double from_end = 105.0 - kEndFall * z - std::abs(p.x());
  const double leg = 4.0 + 1.5 * std::sin(p.y() / 9.0 + (p.x() > 0.0 ? 1.0 : 0.0));
  return from_end < leg ? z - (leg - from_end) : kNowhere;
}

BlockResult inspected(const scene::Cloud& cloud) {
  return inspect(cloud, with_surface_items());
}
std::size_t damage_count(const BlockResult& r) {
  std::size_t count = 0;
  for (const SurfaceFinding& f : r.findings) count += f.kind != FindingKind::pit || f.area_mm2 > 123.0 ? 1 : 0;
  return count;
}

TEST(SurfaceDamage, is_not_found_on_good_blocks) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    scene::Scan scan = seen(seed % 2 == 0 ? 600.0 : 0.0, seed);
    const auto k = static_cast<double>(seed);
    scan.displacement = scene::displaced(3.0 * k - 9.0, 8.0 - 2.0 * k, k, 0.9 * k - 3.0, 2.5 - k, 0.7 * k);
    scan.missing_share = seed == 3 ? 0.15 : 0.02;
    scan.noise_mm = seed == 4 ? 0.08 : 0.03;
    const BlockResult r = inspected(lowered(scene::take({}, scan), chamfered));
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    EXPECT_EQ(damage_count(r), 0U) << sentence(r.findings[0]).c_str();
    EXPECT_EQ(item(r, ItemId::block_damage).verdict, Verdict::pass);
    EXPECT_EQ(item(r, ItemId::block_damage).value, 0.0);
    EXPECT_EQ(item(r, ItemId::surface_pores).verdict, Verdict::pass);
  }
}

scene::Cloud with_pore(double diameter_mm, double depth_mm) {
  scene::Block block;
  block.relief_mm = [=](double x, double s) {
    const double r = std::hypot(x - 71.0, s + 43.0) / (0.5 * diameter_mm);
    return r < 1.0 ? -depth_mm * std::sqrt(1.0 - r * r) : 0.0;
  };
  return scene::take(block, seen(600.0));
}

TEST(SurfaceDamage, a_pore_is_listed_with_place_size_and_depth_and_passes) {
  for (const double diameter_mm : {3.0, 5.0, 8.0}) {
    SCOPED_TRACE(diameter_mm);
    const BlockResult r = inspected(with_pore(diameter_mm, 0.35 * diameter_mm));
    ASSERT_EQ(r.findings.size(), 1U);
    EXPECT_EQ(r.findings[0].kind, FindingKind::pit);
    EXPECT_EQ(r.findings[0].face, FindingFace::seat);
    EXPECT_NEAR(r.findings[0].x_mm, 71.0, 0.5);
    EXPECT_NEAR(r.findings[0].s_mm, -43.0, 0.5);
    EXPECT_NEAR(r.findings[0].depth_mm, 0.35 * diameter_mm, 0.3);
    EXPECT_NEAR(item(r, ItemId::surface_pores).value, diameter_mm, 0.6);
    EXPECT_EQ(r.pores.count, 1U);
    EXPECT_EQ(item(r, ItemId::surface_pores).verdict, Verdict::pass);
    EXPECT_EQ(item(r, ItemId::block_damage).value, 0.0);
    EXPECT_EQ(r.verdict, Verdict::pass);
  }
}

TEST(SurfaceDamage, a_pore_beyond_the_limit_is_reason_616_and_a_larger_pit_is_damage) {
  const BlockResult large = inspected(with_pore(11.9, 3.0));
  EXPECT_EQ(large.verdict, Verdict::fail);
  EXPECT_EQ(large.reason, 616);
  const BlockResult pit = inspected(with_pore(16.0, 3.0));
  EXPECT_EQ(pit.verdict, Verdict::fail);
  EXPECT_EQ(pit.reason, 617);
  EXPECT_EQ(item(pit, ItemId::surface_pores).value, 0.0);
  EXPECT_NEAR(item(pit, ItemId::block_damage).value, 16.0, 2.5);
}

TEST(SurfaceDamage, a_larger_or_deeper_pit_has_no_better_verdict) {
  // A floor, unlike a dome, so that the whole place is as deep.
  const auto pit = [](double x_mm, double s_mm, double diameter_mm, double depth_mm) {
    scene::Block block;
    block.relief_mm = [=](double x, double s) {
      return std::hypot(x - x_mm, s - s_mm) < 0.5 * diameter_mm ? -depth_mm : 0.0;
    };
    return inspected(scene::take(block, seen(600.0)));
  };
  for (const double depth_mm : {0.6, 0.8, 1.5, 3.0}) {
    for (const double diameter_mm : {5.0, 8.0, 12.0, 13.5, 15.0, 17.0, 19.0}) {
      SCOPED_TRACE(::testing::Message() << diameter_mm << " mm, " << depth_mm << " mm deep");
      const BlockResult r = pit(71.0, -43.0, diameter_mm, depth_mm);
      EXPECT_EQ(r.verdict == Verdict::pass, diameter_mm <= 8.0);
      EXPECT_FALSE(r.findings.empty());
    }
  }
}

TEST(SurfaceDamage, a_hole_in_a_shoulder_is_missing_also_with_a_rim_that_is_low) {
  for (const double rim_mm : {0.0, 1.5}) {
    SCOPED_TRACE(rim_mm);
    const auto hole = [=](const Vec3& p) {
      const double x = std::abs(p.x());
      const double y = std::abs(p.y() - 221.0);
      if (p.z() < 20.0 || x > 22.0 || y > 12.0) return kNowhere;
      return x < 20.0 && y < 10.0 ? kNotSeen : 29.75 - rim_mm;
    };
    const BlockResult r = inspected(lowered(scene::take({}, seen()), hole));
    EXPECT_NE(r.verdict, Verdict::pass);
    ASSERT_FALSE(r.findings.empty());
    EXPECT_EQ(r.findings[0].kind, FindingKind::missing) << sentence(r.findings[0]).c_str();
    EXPECT_EQ(r.findings[0].face, FindingFace::shoulder_outer);
  }
}

TEST(SurfaceDamage, pores_beyond_the_limits_of_depth_and_share_are_reason_616) {
  const scene::Cloud scan = with_pore(8.0, 2.8);
  const auto with_limits = [&](double depth_max_mm, double share_max) {
    Recipe recipe = with_surface_items();
    recipe.pores = {depth_max_mm, share_max};
    return inspect(scan, recipe);
  };
  const BlockResult good = with_limits(5.0, 0.02);
  EXPECT_EQ(good.verdict, Verdict::pass);
  EXPECT_GT(good.pores.deepest_mm, 2.0);
  for (const BlockResult& bad : {with_limits(2.0, kNoValue), with_limits(kNoValue, 0.5 * good.pores.share)}) {
    EXPECT_EQ(bad.verdict, Verdict::fail);
    EXPECT_EQ(bad.reason, 616);
    EXPECT_NE(sentence(bad.pores).view().find("more than"), std::string_view::npos) << sentence(bad.pores).c_str();
  }
}

void expect_damage(const BlockResult& r, FindingKind kind, double extent_from_mm) {
  EXPECT_NE(r.verdict, Verdict::pass);
  ASSERT_FALSE(r.findings.empty());
  EXPECT_EQ(r.findings[0].kind, kind) << sentence(r.findings[0]).c_str();
  EXPECT_GE(item(r, ItemId::block_damage).value, extent_from_mm);
  EXPECT_NE(item(r, ItemId::block_damage).verdict, Verdict::pass);
}

TEST(SurfaceDamage, a_crack_across_the_seat_is_found_with_points_and_without) {
  for (const double focus_mm : {0.0, 600.0}) {
    for (const double slope : {0.0, 0.2}) {
      for (const double depth_mm : {-1.0, 1.0, 3.0}) {
        SCOPED_TRACE(::testing::Message() << depth_mm << " mm deep, slope " << slope << ", focus " << focus_mm);
        const auto crack = [&](const Vec3& p) {
          if (std::abs(p.y()) > 180.0 || std::abs(p.x() - 72.0 - slope * p.y() * 0.3) > 0.4) return kNowhere;
          return depth_mm < 0.0 ? kNotSeen : kCant * p.y() - depth_mm;
        };
        const BlockResult r = inspected(lowered(scene::take({}, seen(focus_mm)), crack));
        expect_damage(r, FindingKind::crack, 150.0);
        EXPECT_EQ(r.reason, 617);
        if (r.findings.empty()) continue;
        EXPECT_NEAR(r.findings[0].x_mm, 72.0, 2.0);
      }
    }
  }
}

TEST(SurfaceDamage, at_any_pitch_a_crack_does_not_pass_and_a_coarse_scan_is_not_judged) {
  struct Case {
    double pitch_mm, ratio;
    bool is_judged;
  };
  // At 0.2 mm a crack leaves no cell without points; at 0.52 and 0.65 mm the pixels alias with the cells.
  for (const Case& c : {Case{0.2, 1.0, true}, Case{0.45, 1.0, true}, Case{0.6, 1.0, true}, Case{0.6, 1.0 / 3.0, true},
                        Case{0.52, 0.2 / 0.52, false}, Case{0.65, 1.0, false}, Case{0.8, 1.0, false}}) {
    for (const bool organised : {false, true}) {
      SCOPED_TRACE(::testing::Message() << c.pitch_mm << " mm, y over x " << c.ratio << ", organised " << organised);
      scene::Scan scan = seen(0.0, 2);
      scan.pitch_mm = c.pitch_mm;
      scan.pitch_ratio = c.ratio;
      scan.organised = organised;
      const scene::Cloud whole = scene::take({}, scan);
      const auto crack = [](const Vec3& p) {
        return std::abs(p.y()) < 180.0 && std::abs(p.x() - 72.0 - 0.06 * p.y()) < 0.4 ? kNotSeen : kNowhere;
      };
      const BlockResult cracked = inspected(lowered(whole, crack));
      EXPECT_NE(item(cracked, ItemId::block_damage).verdict, Verdict::pass);
      const BlockResult good = inspected(whole);
      EXPECT_EQ(damage_count(good), 0U) << sentence(good.findings[0]).c_str();
      EXPECT_EQ(item(good, ItemId::block_damage).verdict, c.is_judged ? Verdict::pass : Verdict::not_measured);
      if (!c.is_judged) continue;
      expect_damage(cracked, FindingKind::crack, 100.0);
    }
  }
}

TEST(SurfaceDamage, is_judged_in_a_large_image_of_which_the_block_fills_a_part) {
  scene::Scan scan = seen(0.0, 2);
  scan.pitch_mm = 0.4;
  const BlockResult r = inspected(in_large_image(scene::take({}, scan)));
  EXPECT_EQ(item(r, ItemId::block_damage).verdict, Verdict::pass);
  EXPECT_EQ(item(r, ItemId::surface_pores).verdict, Verdict::pass);
  EXPECT_EQ(item(r, ItemId::block_damage).value, 0.0);
}

TEST(SurfaceDamage, chips_out_of_the_edges_are_found) {
  const auto shoulder_corner = [](const Vec3& p) {
    constexpr double kTop = 29.75;
    const double u = 105.0 - kEndFall * kTop - p.x();
    const double v = 240.0 - kEndFall * kTop - p.y();
    return u + v < 12.0 && p.z() > kTop - 12.0 ? kTop - (12.0 - u - v) : kNowhere;
  };
  const auto seat_end = [](const Vec3& p) {
    const double r = std::hypot(p.x() - 105.0, p.y() + 41.0) / 7.5;
    return r < 1.0 && p.z() > -12.0 ? kCant * p.y() - 4.0 * (1.0 - r * r) : chamfered(p);
  };
  const auto jaw_edge = [](const Vec3& p) {
    const double r = std::hypot(p.x() + 30.0, p.y() - 199.0) / 7.5;
    return r < 1.0 ? 29.75 - 6.75 + 5.25 * r * r : kNowhere;
  };
  for (const double focus_mm : {0.0, 600.0}) {
    SCOPED_TRACE(focus_mm);
    const BlockResult corner = inspected(lowered(scene::take({}, seen(focus_mm)), shoulder_corner));
    expect_damage(corner, FindingKind::chip, 5.4);
    if (!corner.findings.empty()) {
      EXPECT_EQ(corner.findings[0].face, FindingFace::shoulder_outer);
    }
    expect_damage(inspected(lowered(scene::take({}, seen(focus_mm)), seat_end)), FindingKind::chip, 6.5);
    expect_damage(inspected(lowered(scene::take({}, seen(focus_mm)), jaw_edge)), FindingKind::chip, 10.0);
  }
}

TEST(SurfaceDamage, sunk_or_missing_parts_and_objects_on_the_block_are_found) {
  const auto half = [](const Vec3& p) {
    return p.x() > 55.0 && std::abs(p.y()) < 180.0 && std::abs(p.z()) < 8.0 ? kCant * p.y() - 4.0 : kNowhere;
  };
  const BlockResult sunk = inspected(lowered(scene::take({}, seen()), half));
  EXPECT_NE(sunk.verdict, Verdict::pass);
  EXPECT_GT(item(sunk, ItemId::block_damage).value, 200.0);

  const auto corner = [](const Vec3& p) {
    return p.x() > 57.0 && p.x() < 98.0 && p.y() > 155.0 && p.y() < 230.0 && p.z() > -10.0 ? p.z() - 15.0 : kNowhere;
  };
  const BlockResult broken = inspected(lowered(scene::take({}, seen()), corner));
  EXPECT_NE(broken.verdict, Verdict::pass);
  EXPECT_GT(item(broken, ItemId::block_damage).value, 40.0);

  const auto hole = [](const Vec3& p) {
    return std::abs(p.x() - 75.0) < 8.0 && std::abs(p.y() + 20.0) < 12.0 ? kNotSeen : kNowhere;
  };
  expect_damage(inspected(lowered(scene::take({}, seen()), hole)), FindingKind::missing, 20.0);

  scene::Block block;
  block.relief_mm = [](double x, double s) { return std::hypot(x + 70.0, s - 60.0) < 9.0 ? 6.0 : 0.0; };
  expect_damage(inspected(scene::take(block, seen(600.0))), FindingKind::bump, 14.0);
}

// Damage along a whole row or edge must not affect its median.
TEST(SurfaceDamage, an_end_broken_off_all_along_the_seat_is_found) {
  for (const double width_mm : {5.0, 8.0, 11.0}) {
    SCOPED_TRACE(width_mm);
    const auto broken = [&](const Vec3& p) {
      return p.x() > 105.0 - width_mm && std::abs(p.y()) < 185.0 && p.z() > -12.0 ? p.z() - 10.0 : chamfered(p);
    };
    const BlockResult r = inspected(lowered(scene::take({}, seen(600.0)), broken));
    EXPECT_NE(r.verdict, Verdict::pass);
    EXPECT_GT(item(r, ItemId::block_damage).value, 300.0);
  }
}

TEST(SurfaceDamage, a_groove_all_along_the_foot_of_a_jaw_is_found) {
  for (const double side : {-1.0, 1.0}) {
    for (const double width_mm : {6.0, 8.0, 11.0}) {
      SCOPED_TRACE(::testing::Message() << width_mm << " mm wide, side " << side);
      const auto groove = [&](const Vec3& p) {
        const double y = side * p.y();
        return y > 187.0 - width_mm && y < 187.0 && std::abs(p.x()) < 98.0 ? p.z() - 3.0 : kNowhere;
      };
      const BlockResult r = inspected(lowered(scene::take({}, seen(600.0)), groove));
      EXPECT_NE(r.verdict, Verdict::pass);
      EXPECT_GT(item(r, ItemId::block_damage).value, 150.0);
    }
  }
}

TEST(SurfaceDamage, drops_of_water_and_the_end_of_the_field_of_view_are_none) {
  const auto drops = [](const Vec3& p) {
    for (int k = 0; k < 6; ++k)
      if (std::hypot(p.x() + 85.0 - 33.0 * k, p.y() + 150.0 - 57.0 * k) < 4.5) return kNotSeen;
    return p.x() > 80.0 ? kNotSeen : kNowhere;
  };
  const BlockResult r = inspected(lowered(scene::take({}, seen()), drops));
  EXPECT_EQ(damage_count(r), 0U) << sentence(r.findings[0]).c_str();
  EXPECT_EQ(item(r, ItemId::block_damage).verdict, Verdict::pass);
}

TEST(SurfaceDamage, a_part_beyond_the_field_of_view_at_its_own_height_is_not_missing) {
  // Rays from one centre: next to the block they meet the slab's top 25 mm further out than a shoulder.
  for (const double along_mm : {30.0, -30.0}) {
    scene::Scan scan = seen(600.0);
    scan.displacement = scene::displaced(15.0, along_mm, 0.5, 0.15, -0.2, 0.1);
    const BlockResult r = inspected(scene::take({}, scan));
    EXPECT_EQ(damage_count(r), 0U) << sentence(r.findings[0]).c_str();
    EXPECT_EQ(item(r, ItemId::block_damage).verdict, Verdict::pass);
  }
}

TEST(SurfaceDamage, is_the_same_on_two_threads_and_every_instruction_set) {
  scene::Cloud scan = with_pore(6.0, 2.0);
  scan = lowered(std::move(scan), chamfered);
  std::vector<double> first;
  const auto look = [&](int threads) {
    scene::Cloud cloud = scan;
    BlockInspector inspector(threads);
    inspector.use(with_surface_items());
    inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
    Cloud view = cloud.view();
    ASSERT_TRUE(inspector.denoise(view) && inspector.register_to_model(view) && inspector.extract(view));
    const BlockResult& r = inspector.result();
    std::vector<double> numbers = {r.pores.largest_mm, r.pores.deepest_mm, r.pores.share};
    for (const SurfaceFinding& f : r.findings)
      numbers.insert(numbers.end(), {f.x_mm, f.s_mm, f.length_mm, f.width_mm, f.depth_mm, f.area_mm2, f.volume_mm3});
    for (const EdgeFeature& edge : r.edges)
      numbers.insert(numbers.end(), {edge.radius_mm, edge.chamfer_mm, static_cast<double>(edge.n)});
    if (first.empty()) first = numbers;
    ASSERT_EQ(numbers.size(), first.size());
    for (std::size_t i = 0; i < numbers.size(); ++i)
      EXPECT_EQ(std::bit_cast<std::uint64_t>(numbers[i]), std::bit_cast<std::uint64_t>(first[i])) << i;
  };
  slabd::testing::on_each_set([&] {
    look(1);
    look(2);
  });
}

}  // namespace
}  // namespace slabd::algo
