// SPDX-License-Identifier: Apache-2.0
//
// Differences between a cast surface and an ideal one: bridged pits, rims under a crust, jaws that begin with a fillet.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "algo/features/casing_fits.h"
#include "algo/features/jaw.h"
#include "algo/features/seat_cells.h"
#include "algo/features/seat_noise.h"
#include "base/prng.h"

namespace slabd::algo {
namespace {

// ---- the surface that a straightedge feels ------------------------------------------------------------------------

/// The closed heights of a surface over the evaluation region, and their extremes.
struct Closed {
  double low = 0.0;
  double high = 0.0;
  std::size_t pits = 0;
};
Closed closed(const std::function<double(double x, double s)>& surface, double width_mm = 10.0) {
  const FlatnessRegion region{51.0, 75.0, 1.5, 12};
  const CellGrid grid(region);
  std::vector<std::uint32_t> cell;
  std::vector<double> height;
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    // A cell's mean, of 5 x 5 positions in it.
    double mean = 0.0;
    for (int k = 0; k < 25; ++k)
      mean += surface(grid.x_of(c) + 0.3 * (k % 5 - 2), grid.s_of(c) + 0.3 * (k / 5 - 2)) / 25.0;
    cell.push_back(static_cast<std::uint32_t>(c));
    height.push_back(mean);
  }
  std::vector<std::uint32_t> mark(grid.cells());
  std::vector<std::uint32_t> stack(grid.cells() + 1);
  std::vector<double> out(cell.size());
  const Closing closing = close_pits(grid, cell, height, {width_mm, 0.05}, mark, stack, out);
  const auto [low, high] = std::minmax_element(out.begin(), out.end());
  for (std::size_t k = 0; k < out.size(); ++k) EXPECT_GE(out[k], height[k]) << "a closing lowers nothing";
  return {*low, *high, closing.pits};
}

std::function<double(double, double)> pit(double diameter_mm, double depth_mm, double x0 = 3.0, double s0 = -8.0) {
  return [=](double x, double s) { return std::hypot(x - x0, s - s0) < 0.5 * diameter_mm ? -depth_mm : 0.0; };
}

TEST(Closing, bridges_only_pores) {
  for (const double diameter_mm : {1.5, 3.0, 5.0, 8.0}) {
    SCOPED_TRACE(diameter_mm);
    const Closed pore = closed(pit(diameter_mm, 2.0));
    EXPECT_EQ(pore.pits, 1U);
    EXPECT_NEAR(pore.low, 0.0, 1e-6);
  }
  EXPECT_NEAR(closed(pit(16.0, 1.2)).low, -1.2, 1e-9) << "wider than what bridges";
  EXPECT_NEAR(closed(pit(8.0, 1.2), 5.0).low, -1.2, 1e-9) << "wider than a recipe allows";
  const Closed crack = closed([](double x, double s) { return std::abs(x + 0.3 * s) < 0.9 ? -1.0 : 0.0; });
  EXPECT_LT(crack.low, -0.7);
  const Closed bump = closed([](double x, double s) { return std::hypot(x, s) < 2.0 ? 0.8 : 0.0; });
  EXPECT_NEAR(bump.high, 0.8, 1e-9);
}

TEST(Closing, bridges_the_widest_pores_at_any_position_in_the_cells) {
  for (const double turn_rad : {0.0, 0.4, 0.8, 1.2})
    for (double x0 = 0.0; x0 < 1.5; x0 += 0.3)
      for (double s0 = 0.0; s0 < 1.5; s0 += 0.3) {
        SCOPED_TRACE(testing::Message() << turn_rad << " rad at " << x0 << ", " << s0);
        const auto pore = [&](double x, double s) {
          const double u = (x - x0) * std::cos(turn_rad) + (s - s0) * std::sin(turn_rad);
          const double v = (s - s0) * std::cos(turn_rad) - (x - x0) * std::sin(turn_rad);
          return std::hypot(u / 4.3, v / 3.7) < 1.0 ? -3.0 : 0.0;
        };
        EXPECT_NEAR(closed(pore).low, 0.0, 1e-6);
      }
}

TEST(Closing, leaves_a_hollow_its_depth) {
  // Three times as wide as bridged pits: the closing alone would remove a tenth of its depth.
  const auto bowl = [](double x, double s) {
    const double r = std::hypot(x, s);
    return r < 15.0 ? -0.6 * (1.0 + std::cos(kPi * r / 15.0)) : 0.0;
  };
  const Closed hollow = closed(bowl);
  EXPECT_EQ(hollow.pits, 0U);
  EXPECT_LT(hollow.low, -1.18);
  // A pore in a gentle hollow is bridged at the height of its surroundings.
  const auto gentle = [](double x, double s) { return -0.3 * std::exp(-(x * x + s * s) / 1800.0); };
  const Closed both = closed([&](double x, double s) { return gentle(x, s) + pit(4.0, 1.5, 2.0, 1.0)(x, s); });
  EXPECT_EQ(both.pits, 1U);
  EXPECT_NEAR(both.low, -0.3, 0.01);
}

TEST(Closing, bridges_a_pore_that_the_border_cuts) {
  EXPECT_NEAR(closed(pit(5.0, 2.0, 50.0, 10.0)).low, 0.0, 0.02);
}

// ---- the height of a rim
// ---------------------------------------------------------------------------------------------

/// Points of a rim, `over(angle, radius)` above the plane at -0.25 mm.
std::vector<RimPoint> rim(
    const std::function<double(double angle, double radius)>& over, double noise_mm,
    const std::function<bool(double angle)>& seen = [](double) { return true; }) {
  Prng prng(5);
  std::vector<RimPoint> points;
  for (double x = -20.25; x < 20.25; x += 0.3)
    for (double y = -20.25; y < 20.25; y += 0.3) {
      const double r = std::hypot(x, y);
      const double angle = std::atan2(y, x);
      if (r < 16.75 || r >= 20.25 || !seen(angle)) continue;
      points.push_back({static_cast<float>(x), static_cast<float>(y),
                        static_cast<float>(-0.25 + over(angle, r) + noise_mm * prng.normal())});
    }
  return points;
}

TEST(RimHeight, is_that_of_the_plane_at_the_axis) {
  const RimHeight level = rim_height(rim([](double, double) { return 0.0; }, 0.03));
  ASSERT_TRUE(level.ok);
  EXPECT_NEAR(level.height_mm, -0.25, 3.0 * level.sigma_mm);
  EXPECT_LT(level.sigma_mm, 0.002);
  EXPECT_EQ(level.share_on, 1.0);
  // Tilted, and seen from one side only: the mean of the seen part differs from the height at the axis.
  const auto tilted = [](double angle, double r) { return 0.15 / 22.0 * r * std::cos(angle); };
  const RimHeight half = rim_height(rim(tilted, 0.02, [](double angle) { return std::abs(angle) < 1.9; }));
  ASSERT_TRUE(half.ok);
  EXPECT_NEAR(half.height_mm, -0.25, 3.0 * half.sigma_mm);
  EXPECT_NEAR(half.tilt, 0.15 / 22.0, 1e-3);
}

TEST(RimHeight, does_not_count_objects_on_the_rim) {
  for (const double crust_mm : {0.1, 0.2, 0.35}) {
    SCOPED_TRACE(crust_mm);
    const auto slurry = [&](double angle, double) { return std::abs(angle - 0.4) < 0.9 ? crust_mm : 0.0; };
    const RimHeight r = rim_height(rim(slurry, 0.02));
    ASSERT_TRUE(r.ok);
    EXPECT_NEAR(r.height_mm, -0.25, 2.0 * r.sigma_mm);
    EXPECT_LT(r.sigma_mm, 0.03);
    EXPECT_LT(r.share_on, 0.8);
    EXPECT_EQ(r.crust_mm > 0.0, crust_mm > 0.31) << "only what stands over the seat is a crust";
  }
  const RimHeight half = rim_height(rim([](double angle, double) { return std::abs(angle) < 1.6 ? 0.2 : 0.0; }, 0.02));
  EXPECT_LT(half.share_on, 0.6) << "which half is the rim cannot be told";
  const RimHeight broken =
      rim_height(rim([](double angle, double) { return std::abs(angle) < 0.5 ? -0.4 : 0.0; }, 0.02));
  EXPECT_GT(broken.share_below, 0.1);
  const RimHeight proud =
      rim_height(rim([](double angle, double) { return std::abs(angle) < 0.8 ? 0.40 : 0.0; }, 0.02));
  EXPECT_NEAR(proud.crust_mm, 0.15, 0.02);
}

/// Mortar higher than the seat on a quarter of the rim, rough in patches of 3 mm: the rail pad rests on it.
TEST(RimHeight, includes_rough_mortar_above_the_seat) {
  for (const double over_seat_mm : {0.12, 0.15, 0.2, 0.3})
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      SCOPED_TRACE(std::to_string(over_seat_mm) + " seed " + std::to_string(seed));
      Prng prng(seed);
      std::array<double, 16 * 16> rough{};
      for (double& r : rough) r = 0.15 * prng.normal();
      const double from = 2.0 * kPi * prng.uniform();
      const auto mortar = [&](double angle, double radius) {
        if (std::abs(std::remainder(angle - from, 2.0 * kPi)) > 0.25 * kPi) return 0.0;
        const auto at = [](double place) { return static_cast<std::size_t>((place + 24.0) / 3.0); };
        return 0.25 + over_seat_mm + rough[16 * at(radius * std::sin(angle)) + at(radius * std::cos(angle))];
      };
      EXPECT_GT(rim_height(rim(mortar, 0.026)).crust_mm, 0.05);
    }
  EXPECT_EQ(rim_height(rim([](double, double) { return 0.24; }, 0.06)).crust_mm, 0.0) << "a rim as high as the seat";
  const auto grain = [](double angle, double) { return std::abs(angle - 1.0) < 0.12 ? 0.6 : 0.0; };
  EXPECT_EQ(rim_height(rim(grain, 0.026)).crust_mm, 0.0) << "a grain of 4 mm";
}

// ---- where a jaw is flat
// -----------------------------------------------------------------------------------------------

/// Points of a face 26 mm high and 200 mm long, without margins of 2 mm; `over(from_foot)` above its plane.
struct JawPoints {
  std::vector<float> x, s, h;
  SeatPoints run;
  ListedPoints list;
  FaceEdges edges{-13.0, 13.0};

  JawPoints(const std::function<double(double)>& over, double noise_mm, double lean = 0.0) {
    Prng prng(3);
    for (double along = -100.0; along < 100.0; along += 0.4)
      for (double up = 2.0; up < 24.0; up += 0.7) {
        x.push_back(static_cast<float>(along));
        s.push_back(static_cast<float>(up - 13.0));
        h.push_back(static_cast<float>(over(up) + lean * up + noise_mm * prng.normal()));
      }
    run = {x, s, h};
    list.runs = std::span(&run, 1);
    list.count = x.size();
  }
  /// Slope of the points of a strip.
  [[nodiscard]] double lean_between(double from_mm, double to_mm) const {
    double n = 0.0, sum_u = 0.0, sum_h = 0.0, sum_uu = 0.0, sum_uh = 0.0;
    for (std::size_t i = 0; i < s.size(); ++i) {
      const double u = static_cast<double>(s[i]);
      const double height = static_cast<double>(h[i]);
      if (u + 13.0 < from_mm || u + 13.0 > to_mm) continue;
      n += 1.0;
      sum_u += u;
      sum_h += height;
      sum_uu += u * u;
      sum_uh += u * height;
    }
    return (n * sum_uh - sum_u * sum_h) / (n * sum_uu - sum_u * sum_u);
  }
  [[nodiscard]] FlatStrip strip(double ripple_mm = 0.0) const {
    return find_flat_strip(profile_of(list, {Vec3::UnitZ(), 0.0}, edges), edges, 2.0, ripple_mm);
  }
};
/// Height of a fillet of this radius in a corner of 110 degrees.
double fillet_mm(double radius_mm, double from_foot_mm) {
  const double into = radius_mm / std::tan(rad_from_deg(55.0)) - from_foot_mm;
  return into > 0.0 ? radius_mm - std::sqrt(radius_mm * radius_mm - into * into) : 0.0;
}

TEST(FlatStrip, is_the_whole_face_of_a_sharp_one) {
  for (const double noise_mm : {0.005, 0.03, 0.06}) {
    const FlatStrip strip = JawPoints([](double) { return 0.0; }, noise_mm, 0.01).strip();
    EXPECT_FALSE(strip.narrowed) << noise_mm;
    EXPECT_EQ(strip.from_mm, 2.0);
    EXPECT_EQ(strip.to_mm, 24.0);
    EXPECT_LT(strip.form_tilt_rad, 5e-4);
  }
}

TEST(FlatStrip, leaves_out_fillets_of_every_radius) {
  for (const double radius_mm : {4.0, 6.0, 8.0, 10.0}) {
    SCOPED_TRACE(radius_mm);
    const FlatStrip strip = JawPoints([&](double u) { return fillet_mm(radius_mm, u); }, 0.02, -0.01).strip();
    EXPECT_TRUE(strip.narrowed);
    EXPECT_LT(fillet_mm(radius_mm, strip.from_mm), 0.012) << "from " << strip.from_mm;
    EXPECT_LT(strip.from_mm, 0.71 * radius_mm + 2.0) << "no more than is bent";
    EXPECT_EQ(strip.to_mm, 24.0);
  }
}

TEST(FlatStrip, leaves_out_what_light_adds_in_the_corner) {
  for (const double at_corner_mm : {0.1, 0.2, 0.3}) {
    SCOPED_TRACE(at_corner_mm);
    const auto light = [&](double u) { return at_corner_mm * std::exp(-0.5 * u); };
    const FlatStrip strip = JawPoints(light, 0.02).strip();
    EXPECT_TRUE(strip.narrowed);
    EXPECT_LT(light(strip.from_mm), 0.012) << "from " << strip.from_mm;
  }
}

/// A jaw whose lower half has another slope: if either half is measured, U extends to the other one.
TEST(FlatStrip, takes_each_piece_of_a_bent_jaw_for_its_angle) {
  for (const double bend_deg : {0.5, 0.7, 1.0, -0.7})
    for (const double at_mm : {11.0, 13.0, 15.0}) {
      SCOPED_TRACE(std::to_string(bend_deg) + " at " + std::to_string(at_mm));
      const double bend = rad_from_deg(bend_deg);
      const auto bent = [&](double u) { return fillet_mm(4.0, u) + (u < at_mm ? bend * (at_mm - u) : 0.0); };
      const JawPoints jaw(bent, 0.02);
      const FlatStrip strip = jaw.strip();
      const double lean = jaw.lean_between(strip.from_mm, strip.to_mm);
      const double U = 2.0 * strip.form_tilt_rad + 5e-4;  // the scanner's part
      EXPECT_LT(std::max(std::abs(lean), std::abs(lean + bend)), U) << "lean " << deg_from_rad(lean);
      EXPECT_LT(U, 2.0 * std::abs(bend)) << "no more than is bent, by much";
    }
  for (const double radius_mm : {0.1, 4.0, 8.0, 12.0})
    for (const double light_mm : {0.0, 0.1, 0.3}) {
      const auto good = [&](double u) { return fillet_mm(radius_mm, u) + light_mm * std::exp(-0.5 * u); };
      EXPECT_EQ(JawPoints(good, 0.02).strip().bend_rad, 0.0) << radius_mm << ", light " << light_mm;
    }
}

TEST(FlatStrip, states_the_uncertainty_of_the_tilt_of_a_wavy_face) {
  const FlatStrip wavy = JawPoints([](double u) { return 0.004 * std::sin(u); }, 0.005).strip();
  EXPECT_GT(wavy.form_tilt_rad, 1e-4);
  EXPECT_LT(wavy.form_tilt_rad, 1e-3);
}

/// For any phase and period the strip is long, and twice the standard uncertainty extends to the truth.
TEST(FlatStrip, is_long_for_a_scanner_that_ripples_and_its_form_tilt_covers_the_error) {
  constexpr double kRipple_mm = 0.007;
  for (const double period_mm : {6.0, 9.0, 13.0, 17.0})
    for (const double phase : {0.0, 1.5, 3.0, 4.5}) {
      SCOPED_TRACE(std::to_string(period_mm) + ", phase " + std::to_string(phase));
      const auto good = [&](double u) {
        return fillet_mm(4.0, u) + kRipple_mm * std::sin(2.0 * kPi * u / period_mm + phase);
      };
      const JawPoints jaw(good, 0.02);
      const FlatStrip strip = jaw.strip(kRipple_mm);
      EXPECT_GT(strip.to_mm - strip.from_mm, 15.0);
      const double lean = jaw.lean_between(strip.from_mm, strip.to_mm);
      EXPECT_LT(std::abs(lean), 2.0 * strip.form_tilt_rad);
      EXPECT_LT(2.0 * strip.form_tilt_rad, 0.0026) << "0.15 degrees";
    }
}

TEST(Ripple, is_found_on_the_seat_for_every_position_of_the_scanner) {
  for (const double amplitude_mm : {0.0, 0.01, 0.02})
    for (const double askew_rad : {0.0, 0.02})
      for (const double period_mm : {2.5, 4.0, 6.0}) {
        SCOPED_TRACE(std::to_string(amplitude_mm) + ", period " + std::to_string(period_mm));
        Prng prng(3);
        std::vector<float> x, s, h;
        for (double a = -51.0; a < 51.0; a += 0.4)
          for (double b = -75.0; b < 75.0; b += 0.4) {
            const double wave = 0.015 * std::sin(2.0 * kPi * b / 60.0) + 0.002 * b;
            const double pore = std::hypot(a - 10.0, b + 20.0) < 3.0 ? -1.5 : 0.0;
            x.push_back(static_cast<float>(a));
            s.push_back(static_cast<float>(b));
            h.push_back(static_cast<float>(wave + pore + 0.015 * prng.normal() +
                                           amplitude_mm * std::sin(2.0 * kPi * (b + askew_rad * a) / period_mm)));
          }
        const SeatPoints run{x, s, h};
        ListedPoints seat;
        seat.runs = std::span(&run, 1);
        seat.count = run.size();
        EXPECT_NEAR(ripple_amplitude_mm(seat), amplitude_mm, 0.15 * amplitude_mm + 0.002);
      }
}

}  // namespace
}  // namespace slabd::algo
