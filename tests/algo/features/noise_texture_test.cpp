// SPDX-License-Identifier: Apache-2.0
//
// Scans embellished by scanner programs: gaps filled, neighbours averaged, values rounded and corrected afterwards.
#include "algo/features/noise_texture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "base/prng.h"
#include "tests/algo/block_inspection.h"

namespace slabd::algo {
namespace {

/// A seat of 100 x 150 mm, sampled row by row.
struct Seat {
  static constexpr double kPitch = 0.2;
  static constexpr int kColumns = 512;  // the worst case for a sample of every second, fourth ... stretch
  static constexpr int kRows = 750;
  std::vector<float> x, s, h;

  explicit Seat(double noise_mm, std::uint64_t seed = 1) {
    Prng prng(seed);
    for (int row = 0; row < kRows; ++row)
      for (int column = 0; column < kColumns; ++column) {
        x.push_back(static_cast<float>(kPitch * (column - kColumns / 2)));
        s.push_back(static_cast<float>(kPitch * (row - kRows / 2)));
        // A bow, a wave of centimetres and noise.
        const double form = 0.05 * std::cos(double{x.back()} / 40.0) + 0.03 * std::sin(double{s.back()} / 12.0);
        h.push_back(static_cast<float>(form + noise_mm * prng.normal()));
      }
  }
  float& at(int row, int column) { return h[static_cast<std::size_t>(row * kColumns + column)]; }

  /// Mean over `reach` neighbours on each side, in both directions.
  void smooth(int reach) {
    for (const bool along : {true, false}) {
      const std::vector<float> before = h;
      for (int row = reach; row < kRows - reach; ++row)
        for (int column = reach; column < kColumns - reach; ++column) {
          float sum = 0.0F;
          for (int k = -reach; k <= reach; ++k)
            sum += before[static_cast<std::size_t>((along ? row : row + k) * kColumns + (along ? column + k : column))];
          at(row, column) = sum / static_cast<float>(2 * reach + 1);
        }
    }
  }
  void each(const std::function<float(float)>& change) {
    for (float& value : h) value = change(value);
  }

  [[nodiscard]] NoiseTexture texture() const {
    std::vector<TextureCell> cells(kTextureCells);
    // Pieces that are not whole rows, like those of the survey's threads.
    std::vector<SeatPoints> runs;
    for (std::size_t from = 0; from < h.size(); from += 7'001) {
      const std::size_t size = std::min<std::size_t>(7'001, h.size() - from);
      runs.push_back(
          {std::span(x).subspan(from, size), std::span(s).subspan(from, size), std::span(h).subspan(from, size)});
    }
    return look_at_texture({runs, Vec3::UnitZ(), 0.0}, cells);
  }
};

TEST(NoiseTexture, is_white_for_an_unprocessed_scan) {
  for (const double noise_mm : {0.006, 0.03, 0.05}) {
    const NoiseTexture t = Seat(noise_mm).texture();
    EXPECT_GT(t.looked_at, 50'000U);
    EXPECT_NEAR(t.sigma_mm, noise_mm, 0.02 * noise_mm);
    EXPECT_NEAR(t.lag_ratio, 3.0, 0.1);
    EXPECT_NEAR(t.rest_ratio, 0.344, 0.02);
    EXPECT_EQ(t.filled.cells, 0U);
  }
}

TEST(NoiseTexture, is_missing_where_a_gap_was_filled) {
  for (const int size_mm : {12, 16, 24, 40, 60})
    for (const double left_mm : {0.0, 0.0005, 0.003}) {  // a spline; and one through noisy borders
      Seat seat(0.03);
      Prng prng(7);
      const int n = static_cast<int>(size_mm / Seat::kPitch);
      for (int row = 0; row < n; ++row)
        for (int column = 0; column < n; ++column)
          seat.at(500 - n / 2 + row, 150 - n / 2 + column) = static_cast<float>(0.04 + left_mm * prng.normal());
      const NoiseTexture t = seat.texture();
      ASSERT_GT(t.filled.cells, 0U) << size_mm;
      EXPECT_NEAR(t.filled.x_mm, Seat::kPitch * (150 - Seat::kColumns / 2), 2.5) << size_mm;
      EXPECT_NEAR(t.filled.s_mm, Seat::kPitch * (500 - 375), 2.5) << size_mm;
      EXPECT_NEAR(t.filled.width_mm, size_mm, 8.0) << size_mm;
      EXPECT_LE(t.filled.area_mm2, size_mm * size_mm);
    }
}

TEST(NoiseTexture, detects_a_smoothed_scan) {
  Seat mean_of_three(0.03);
  mean_of_three.smooth(1);
  EXPECT_NEAR(mean_of_three.texture().lag_ratio, 2.0, 0.1);
  EXPECT_EQ(mean_of_three.texture().filled.cells, 0U);
  Seat mean_of_five(0.03);
  mean_of_five.smooth(2);
  EXPECT_LT(mean_of_five.texture().lag_ratio, 2.1);
}

TEST(NoiseTexture, detects_heights_in_steps_although_they_were_corrected) {
  const auto rounded = [](double step) {
    return [step](float v) { return static_cast<float>(std::nearbyint(static_cast<double>(v) / step) * step); };
  };
  Seat seat(0.03);
  seat.each(rounded(0.2));
  for (std::size_t i = 0; i < seat.h.size(); ++i) seat.h[i] += 0.02F * std::sin(seat.x[i] / 30.0F);
  EXPECT_LT(seat.texture().rest_ratio, 0.12) << "a smooth correction";
  Prng prng(9);
  seat.each([&](float v) { return v + static_cast<float>(0.005 * prng.normal()); });
  EXPECT_LT(seat.texture().rest_ratio, 0.12) << "and jitter";
  EXPECT_NEAR(seat.texture().step_mm, 0.2, 0.05);
  Seat fine(0.03);
  fine.each(rounded(0.01));
  EXPECT_GT(fine.texture().rest_ratio, 0.28) << "two decimals are none";
}

TEST(NoiseTexture, is_not_known_where_points_have_no_neighbours_or_no_noise) {
  Seat seat(0.03);
  // Reordered: consecutive points are far apart.
  std::vector<float> x, s, h;
  for (std::size_t i = 0; i < seat.h.size(); ++i) {
    const std::size_t j = i * 104'729 % seat.h.size();
    x.push_back(seat.x[j]);
    s.push_back(seat.s[j]);
    h.push_back(seat.h[j]);
  }
  seat.x = x;
  seat.s = s;
  seat.h = h;
  EXPECT_FALSE(has_value(seat.texture().sigma_mm));
  const NoiseTexture ideal = Seat(0.0).texture();
  EXPECT_EQ(ideal.filled.cells, 0U) << "nothing is missing in a scan without noise";
}

// ---- whole blocks ----

scene::Scan as_scanned(double noise_mm = 0.03) {
  scene::Scan scan;
  scan.pitch_mm = 0.3;
  scan.focus_mm = 600.0;
  scan.organised = true;
  scan.missing_share = 0.0;
  scan.outlier_share = 0.0;
  scan.noise_mm = noise_mm;
  scan.displacement = scene::displaced(1.2, -0.8, 0.5, 0.15, -0.2, 0.1);
  return scan;
}

constexpr double kNoise_mm = 0.03;
/// Computation of the points of a gap: without noise, or from the points before and behind the gap along each row or
/// each column of the grid, whose noise the points then have.
enum class Fill { smooth, along_rows, along_columns };

/// A scan with a filled box (block frame).
scene::Cloud filled(const Vec3& low, const Vec3& high, Fill fill = Fill::smooth) {
  scene::Cloud cloud = scene::take({}, as_scanned(kNoise_mm));
  const scene::Cloud smooth = scene::take({}, as_scanned(0.0));
  std::vector<float> before(fill == Fill::along_rows ? cloud.height : cloud.width,
                            0.0F);  // noise of each row or column
  Prng prng(12);
  for (float& noise : before) noise = static_cast<float>(kNoise_mm * prng.normal());
  for (std::size_t i = 0; i < cloud.xyz.size(); i += 3) {
    const Vec3 p =
        smooth.T_block_scanner * Vec3(double{smooth.xyz[i]}, double{smooth.xyz[i + 1]}, double{smooth.xyz[i + 2]});
    if ((p.array() < low.array()).any() || (p.array() > high.array()).any()) continue;
    for (std::size_t k = 0; k < 3; ++k) cloud.xyz[i + k] = smooth.xyz[i + k];
    const std::size_t point = i / 3;
    if (fill == Fill::along_rows) cloud.xyz[i + 2] += before[point / cloud.width];
    if (fill == Fill::along_columns) cloud.xyz[i + 2] += before[point % cloud.width];
  }
  return cloud;
}

TEST(FilledScan, no_block_passes_on_a_surface_that_was_computed) {
  const BlockResult good = inspect(scene::take({}, as_scanned()));
  EXPECT_EQ(good.verdict, Verdict::pass);
  EXPECT_NEAR(good.scan.lag_ratio, 3.0, 0.2);
  for (const double half_mm : {8.0, 12.0, 30.0}) {
    const BlockResult r =
        inspect(filled({20.0 - half_mm, -30.0 - half_mm, -60.0}, {20.0 + half_mm, -30.0 + half_mm, 60.0}));
    EXPECT_EQ(r.verdict, Verdict::not_measured) << half_mm;
    EXPECT_EQ(r.seat.plane.doubt, PlaneDoubt::filled) << half_mm;
  }
}

TEST(FilledScan, is_found_anywhere_on_the_seat_and_filled_in_either_direction) {
  struct Case {
    double x_mm, y_mm, half_x_mm, half_y_mm;
  };
  // In the evaluation region, beside it, at the seat's corner, around a casing, and over most of the region.
  for (const Case& c : {Case{20.0, -30.0, 12.0, 12.0}, Case{80.0, 0.0, 12.0, 12.0}, Case{-85.0, 160.0, 12.0, 12.0},
                        Case{0.0, 116.5, 40.0, 30.0}, Case{0.0, 0.0, 45.0, 70.0}, Case{0.0, 0.0, 51.0, 75.0}})
    for (const Fill fill : {Fill::smooth, Fill::along_rows, Fill::along_columns}) {
      const BlockResult r = inspect(filled({c.x_mm - c.half_x_mm, c.y_mm - c.half_y_mm, -8.0},
                                           {c.x_mm + c.half_x_mm, c.y_mm + c.half_y_mm, 8.0}, fill));
      EXPECT_EQ(r.verdict, Verdict::not_measured) << c.x_mm << " " << c.y_mm << " " << static_cast<int>(fill);
      EXPECT_EQ(r.seat.plane.doubt, PlaneDoubt::filled) << c.x_mm << " " << c.y_mm << " " << static_cast<int>(fill);
    }
}

scene::Cloud rounded(scene::Cloud cloud, float step_mm) {
  for (float& v : cloud.xyz) v = std::nearbyint(v / step_mm) * step_mm;
  return cloud;
}

TEST(FilledScan, is_detected_in_a_scan_of_few_decimals_without_false_alarms) {
  for (const float step_mm : {0.002F, 0.005F, 0.01F, 0.02F}) {
    const BlockResult r = inspect(rounded(filled({8.0, -42.0, -60.0}, {32.0, -18.0, 60.0}), step_mm));
    EXPECT_EQ(r.verdict, Verdict::not_measured) << step_mm;
    EXPECT_EQ(r.seat.plane.doubt, PlaneDoubt::filled) << step_mm;
  }
  const scene::Cloud good = scene::take({}, as_scanned());
  for (const float step_mm : {0.01F, 0.02F, 0.05F, 0.1F}) {
    const BlockResult r = inspect(rounded(good, step_mm));
    EXPECT_EQ(r.seat.plane.doubt, PlaneDoubt::none) << step_mm;
    EXPECT_NE(r.jaw_inner.doubt, PlaneDoubt::filled) << step_mm;
    EXPECT_NE(r.jaw_outer.doubt, PlaneDoubt::filled) << step_mm;
    EXPECT_NE(r.casing_inner.doubt, CasingDoubt::filled) << step_mm;
  }
}

TEST(FormOfAScan, beyond_what_the_scanner_is_stated_to_have_enters_U_of_the_protrusions) {
  const auto U_of = [](double amplitude_mm) {
    scene::Block block;
    block.relief_mm = [=](double, double s) { return amplitude_mm * std::sin(2.0 * kPi * s / 122.0); };
    return item(inspect(scene::take(block, as_scanned())), ItemId::casing_protrusion_inner).U;
  };
  const double usual = U_of(0.0);
  EXPECT_EQ(U_of(0.05), usual);
  EXPECT_GT(U_of(0.15), 0.15);
  EXPECT_GT(U_of(0.2), 0.2);
}

TEST(FilledScan, costs_a_jaw_its_items_alone) {
  const BlockResult good = inspect(scene::take({}, as_scanned()));
  const Vec3 at = good.jaw_inner.centroid;
  const BlockResult r = inspect(filled(at - Vec3(20.0, 3.5, 60.0), at + Vec3(20.0, 3.5, 60.0)));
  EXPECT_EQ(r.jaw_inner.doubt, PlaneDoubt::filled);
  EXPECT_EQ(item(r, ItemId::jaw_angle_inner).verdict, Verdict::not_measured);
  EXPECT_NE(r.verdict, Verdict::pass);
}

TEST(SteppedScan, is_refused_though_the_steps_were_smoothed_over) {
  scene::Cloud cloud = scene::take({}, as_scanned());
  Prng prng(4);
  for (std::size_t i = 0; i < cloud.xyz.size(); ++i)
    cloud.xyz[i] = std::nearbyint(cloud.xyz[i] / 0.2F) * 0.2F + static_cast<float>(0.005 * prng.normal());
  const BlockResult r = inspect(cloud);
  EXPECT_EQ(r.verdict, Verdict::not_measured);
}

}  // namespace
}  // namespace slabd::algo
