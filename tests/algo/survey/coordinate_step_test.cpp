// SPDX-License-Identifier: Apache-2.0
//
// Coordinates rounded before they reached slabd: detected, part of U, or refused.
#include "algo/survey/coordinate_step.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/algo/block_inspection.h"

namespace slabd::algo {
namespace {

/// Rounds to multiples of `step`; the value passes through a float of `unit_mm`, as in a file in another unit.
scene::Cloud rounded(scene::Cloud cloud, double step_mm, double unit_mm = 1.0) {
  for (float& v : cloud.xyz) {
    const double multiple = std::nearbyint(static_cast<double>(v) / step_mm) * step_mm;
    v = static_cast<float>(static_cast<float>(multiple / unit_mm) * static_cast<float>(unit_mm));
  }
  return cloud;
}

Vec3 step_of(scene::Cloud cloud) {
  std::vector<std::uint32_t> scratch(kStepScratch);
  return find_coordinate_step(cloud.view(), scratch);
}

scene::Scan seen(double focus_mm, double pitch_mm = 0.41) {
  scene::Scan scan;
  scan.focus_mm = focus_mm;
  scan.pitch_mm = pitch_mm;
  scan.organised = true;
  scan.displacement = scene::displaced(1.2, -0.8, 0.5, 0.15, -0.2, 0.1);
  return scan;
}

TEST(CoordinateStep, is_zero_for_a_scan_with_all_its_digits) {
  for (const double focus_mm : {0.0, 600.0}) {
    const scene::Cloud cloud = scene::take({}, seen(focus_mm));
    EXPECT_EQ(step_of(cloud), Vec3::Zero()) << focus_mm;
    EXPECT_EQ(step_of(rounded(cloud, 0.001)), Vec3::Zero()) << "three decimals of mm";
    EXPECT_EQ(step_of(rounded(cloud, 0.001, 1000.0)), Vec3::Zero()) << "six decimals of m";
  }
}

TEST(CoordinateStep, is_zero_for_the_raster_of_parallel_rays) {
  for (const double pitch_mm : {0.25, 0.41, 0.5})
    EXPECT_EQ(step_of(scene::take({}, seen(0.0, pitch_mm))), Vec3::Zero());
  scene::Scan scan = seen(0.0, 0.5);
  scan.organised = false;
  for (const double missing : {0.2, 0.5, 0.6}) {
    scan.missing_share = missing;
    EXPECT_EQ(step_of(scene::take({}, scan)), Vec3::Zero()) << missing;
  }
}

/// An even raster whose heights are those of the nearest points of another one.
scene::Cloud resampled(const scene::Cloud& from, double from_pitch_mm, double pitch_mm) {
  const auto per_axis = [&](std::size_t count) {
    return static_cast<std::size_t>(static_cast<double>(count - 1) * from_pitch_mm / pitch_mm);
  };
  scene::Cloud to = from;
  to.width = per_axis(from.width);
  to.height = per_axis(from.height);
  to.xyz.assign(3 * to.width * to.height, 0.0F);
  const auto nearest = [&](std::size_t k) {
    return static_cast<std::size_t>(std::nearbyint(static_cast<double>(k) * pitch_mm / from_pitch_mm));
  };
  const auto place = [&](std::size_t index, int axis) {
    return static_cast<double>(from.xyz[3 * index + static_cast<std::size_t>(axis)]);
  };
  for (std::size_t row = 0; row < to.height; ++row)
    for (std::size_t column = 0; column < to.width; ++column) {
      const std::size_t source = nearest(row) * from.width + nearest(column);
      float* p = &to.xyz[3 * (row * to.width + column)];
      const auto shifted = [&](int axis, std::size_t along_columns, std::size_t along_rows) {
        const double origin = place(0, axis);
        const double by_column = (place(1, axis) - origin) / from_pitch_mm * pitch_mm;
        const double by_row = (place(from.width, axis) - origin) / from_pitch_mm * pitch_mm;
        return static_cast<float>(origin + by_column * static_cast<double>(along_columns) +
                                  by_row * static_cast<double>(along_rows));
      };
      p[0] = shifted(0, column, row);
      p[1] = shifted(1, column, row);
      p[2] = from.xyz[3 * source + 2];
    }
  return to;
}

TEST(CoordinateStep, is_the_distance_of_the_nearest_points_that_filled_a_raster) {
  scene::Scan scan = seen(0.0, 0.4);
  scan.missing_share = 0.0;
  const scene::Cloud points = scene::take({}, scan);
  for (const double pitch_mm : {0.2, 0.25, 0.35}) {
    const Vec3 step = step_of(resampled(points, 0.4, pitch_mm));
    SCOPED_TRACE(pitch_mm);
    EXPECT_NEAR(step.x(), 0.4, 0.05);
    EXPECT_NEAR(step.y(), 0.4, 0.05);
    EXPECT_EQ(step.z(), 0.0);
  }
}

TEST(CoordinateStep, is_zero_for_heights_that_a_median_repeats) {
  const scene::Cloud from = scene::take({}, seen(0.0, 0.4));
  scene::Cloud median = from;
  const auto z = [&](std::size_t row, std::size_t column) { return from.xyz[3 * (row * from.width + column) + 2]; };
  for (std::size_t row = 1; row + 1 < from.height; ++row)
    for (std::size_t column = 1; column + 1 < from.width; ++column) {
      std::array<float, 9> near{};
      std::size_t n = 0;
      for (std::size_t i = row - 1; i <= row + 1; ++i)
        for (std::size_t j = column - 1; j <= column + 1; ++j)
          if (std::isfinite(z(i, j))) near[n++] = z(i, j);
      std::sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(n));
      if (std::isfinite(z(row, column))) median.xyz[3 * (row * from.width + column) + 2] = near[n / 2];
    }
  EXPECT_EQ(step_of(median), Vec3::Zero());
}

TEST(CoordinateStep, is_zero_for_the_feed_of_a_line_profiler) {
  for (const std::size_t axis : {0U, 1U}) {
    // The rays of each profile are parallel to one plane; within it they start at one point.
    scene::Cloud cloud = scene::take({}, seen(600.0));
    const scene::Cloud parallel = scene::take({}, seen(0.0, 0.25));
    for (const double offset_mm : {0.0, 0.1}) {
      scene::Cloud profiles = parallel;
      for (std::size_t i = 0; i < profiles.xyz.size(); i += 3) {
        profiles.xyz[i + axis] += static_cast<float>(offset_mm);
        profiles.xyz[i + 1 - axis] += 1e-4F * profiles.xyz[i + 2] * profiles.xyz[i + 1 - axis];
      }
      EXPECT_EQ(step_of(profiles), Vec3::Zero()) << axis << " " << offset_mm;
    }
    for (std::size_t i = axis; i < cloud.xyz.size(); i += 3) cloud.xyz[i] = std::nearbyint(cloud.xyz[i] / 0.2F) * 0.2F;
    EXPECT_NEAR(step_of(cloud)[static_cast<Eigen::Index>(axis)], 0.2, 1e-3) << "an axis that was rounded";
  }
}

TEST(CoordinateStep, is_found_whatever_the_unit_and_the_view) {
  for (const double focus_mm : {0.0, 600.0}) {
    // Not a multiple of a step: a raster of 0.41 mm is not changed by rounding to 0.005 mm.
    const scene::Cloud cloud = scene::take({}, seen(focus_mm, 0.4137));
    for (const double step_mm : {0.005, 0.01, 0.0254, 0.05, 0.1, 0.2, 0.25, 0.5, 1.0})
      for (const double unit_mm : {1.0, 25.4, 1000.0})
        EXPECT_LT((step_of(rounded(cloud, step_mm, unit_mm)) - Vec3::Constant(step_mm)).norm(), 0.01 * step_mm)
            << step_mm << " " << unit_mm << " " << focus_mm;
  }
}

TEST(CoordinateStep, is_found_where_no_writer_would_expect_it) {
  // Integers with a scale and an origin, as in a packed format.
  scene::Cloud cloud = scene::take({}, seen(600.0));
  for (float& v : cloud.xyz)
    v = static_cast<float>(std::nearbyint((static_cast<double>(v) - 0.0123) / 0.0737) * 0.0737 + 0.0123);
  EXPECT_LT((step_of(cloud) - Vec3::Constant(0.0737)).norm(), 0.001);
}

TEST(CoordinateStep, is_reported_axis_by_axis) {
  scene::Cloud cloud = scene::take({}, seen(600.0));
  for (std::size_t i = 2; i < cloud.xyz.size(); i += 3) cloud.xyz[i] = std::nearbyint(cloud.xyz[i] / 0.125F) * 0.125F;
  EXPECT_EQ(step_of(cloud), Vec3(0.0, 0.0, 0.125));
}

TEST(CoordinateStep, is_found_though_a_few_points_come_from_elsewhere) {
  scene::Cloud cloud = rounded(scene::take({}, seen(600.0)), 0.1);
  for (std::size_t i = 0; i < cloud.xyz.size(); i += 60) cloud.xyz[i] += 0.0371F;
  EXPECT_NEAR(step_of(cloud).x(), 0.1, 1e-9);
}

TEST(Rounding, coarser_than_can_be_measured_with_is_refused_by_name_of_axis_and_step) {
  for (const double step_mm : {0.2, 0.5}) {
    scene::Cloud cloud = rounded(scene::take({}, seen(600.0)), step_mm);
    BlockInspector inspector;
    inspector.use(scene::p5600());
    inspector.begin(4, Pose::identity(), nominal_T_block_scanner());
    algo::Cloud view = cloud.view();
    const Status status = inspector.denoise(view);
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().code, Code::frame_incomplete);
    const std::string_view text = status.error().text.view();
    EXPECT_NE(text.find("along x"), std::string_view::npos) << text;
    EXPECT_NE(text.find(step_mm == 0.2 ? "0.2 mm" : "0.5 mm"), std::string_view::npos) << text;
    EXPECT_NE(text.find("more decimals"), std::string_view::npos) << text;
    inspector.judge(status.error().code);
    EXPECT_EQ(inspector.result().verdict, Verdict::not_measured);
    EXPECT_EQ(inspector.result().reason, 303);
    EXPECT_EQ(inspector.result().scan.step_mm.x(), step_mm);
  }
}

Recipe with_budget() {
  Recipe recipe = scene::p5600();
  recipe.uncertainty = {true, {0.05, true}, {150.0, true}, {50.0, true}, {0.005, true}, {rad_from_deg(0.001), true}};
  return recipe;
}

TEST(Rounding, is_covered_by_the_uncertainty_with_a_budget_and_without) {
  struct Truth {
    ItemId id;
    double value;
  };
  const std::array truths = {Truth{ItemId::seat_slope, deg_from_rad(std::atan(1.0 / 40.0))},
                             Truth{ItemId::jaw_angle_inner, 111.3},
                             Truth{ItemId::jaw_angle_outer, 110.0},
                             Truth{ItemId::jaw_distance, 380.0},
                             Truth{ItemId::casing_spacing, 233.0},
                             Truth{ItemId::casing_protrusion_inner, -0.25},
                             Truth{ItemId::casing_protrusion_outer, -0.25}};
  scene::Block block;
  block.jaw_angle_inner_deg = 111.3;  // limit 111
  for (const double focus_mm : {0.0, 600.0}) {
    const scene::Cloud cloud = scene::take(block, seen(focus_mm));
    for (const double step_mm : {0.05, 0.1}) {
      for (const Recipe& recipe : {with_budget(), scene::p5600()}) {
        const BlockResult r = inspect(rounded(cloud, step_mm), recipe);
        EXPECT_NE(r.verdict, Verdict::pass);
        EXPECT_NEAR(r.scan.step_mm.z(), step_mm, 1e-9);
        for (const Truth& truth : truths) {
          const Item& i = item(r, truth.id);
          if (!has_value(i.value)) continue;
          EXPECT_LE(std::abs(i.value - truth.value), i.U) << info(i.id).name << " " << step_mm << " " << focus_mm;
        }
        EXPECT_NE(item(r, ItemId::jaw_angle_inner).verdict, Verdict::pass);
      }
    }
  }
}

TEST(Rounding, to_two_decimals_leaves_the_uncertainty_as_it_is) {
  const scene::Cloud cloud = scene::take({}, seen(600.0));
  const BlockResult fine = inspect(cloud, with_budget());
  const BlockResult coarse = inspect(rounded(cloud, 0.01), with_budget());
  EXPECT_EQ(fine.scan.step_mm, Vec3::Zero());
  EXPECT_EQ(coarse.verdict, Verdict::pass);
  for (std::size_t i = 0; i < fine.items.size(); ++i) {
    if (!has_value(fine.items[i].U) || fine.items[i].id == ItemId::seat_std) continue;
    EXPECT_LE(coarse.items[i].U, 1.25 * fine.items[i].U) << info(fine.items[i].id).name;
    EXPECT_GE(coarse.items[i].U, 0.9 * fine.items[i].U) << info(fine.items[i].id).name;
  }
}

}  // namespace
}  // namespace slabd::algo
