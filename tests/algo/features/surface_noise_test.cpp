// SPDX-License-Identifier: Apache-2.0
//
// Additional results of flatness: its noise, the correlation of neighbouring points' errors, and small defects.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "algo/algo.h"
#include "algo/features/seat_noise.h"
#include "seat.h"

namespace slabd::algo {
namespace {

using slabd::testing::Seat;

TEST(ExpectedRange, is_within_one_per_cent_of_the_exact_figures) {
  EXPECT_NEAR(expected_range(10), 3.077505, 0.01 * 3.08);
  EXPECT_NEAR(expected_range(100), 5.0152, 0.01 * 5.02);
  EXPECT_NEAR(expected_range(1000), 6.4829, 0.01 * 6.48);
  EXPECT_NEAR(expected_range(6818), 7.5127, 0.01 * 7.51);
  EXPECT_EQ(expected_range(1), 0.0);
}

constexpr double kNoise_mm = 0.03;
constexpr double kPitch_mm = 0.5;
constexpr int kColumns = 204;  ///< 102 x 150 mm at kPitch_mm
constexpr int kRows = 300;

/// Noise of standard deviation kNoise_mm on the seat's points, row by row.
using Field = std::vector<double>;

Field white(Prng& prng) {
  Field f(kColumns * kRows);
  for (double& v : f) v = kNoise_mm * prng.normal();
  return f;
}

std::size_t at(int row, int column, int width) {
  return static_cast<std::size_t>(row * width + column);
}

/// Autocorrelation exp(-h^2 / (2 L^2)): white noise through a Gaussian window.
Field gaussian(Prng& prng, double L) {
  const int reach = static_cast<int>(std::ceil(4.0 * L / kPitch_mm));
  std::vector<double> window;
  double squares = 0.0;
  for (int i = -reach; i <= reach; ++i) {
    window.push_back(std::exp(-i * i * kPitch_mm * kPitch_mm / (L * L)));
    squares += window.back() * window.back();
  }
  const int wide = kColumns + 2 * reach;
  const int high = kRows + 2 * reach;
  Field source(static_cast<std::size_t>(wide * high));
  for (double& v : source) v = prng.normal();
  Field smooth(static_cast<std::size_t>(kColumns * high), 0.0);
  for (int r = 0; r < high; ++r)
    for (int c = 0; c < kColumns; ++c)
      for (int k = 0; k <= 2 * reach; ++k)
        smooth[at(r, c, kColumns)] += window[static_cast<std::size_t>(k)] * source[at(r, c + k, wide)];
  Field f(kColumns * kRows, 0.0);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kColumns; ++c)
      for (int k = 0; k <= 2 * reach; ++k)
        f[at(r, c, kColumns)] +=
            kNoise_mm / squares * window[static_cast<std::size_t>(k)] * smooth[at(r + k, c, kColumns)];
  return f;
}

/// Autocorrelation exp(-(|dx| + |dy|) / L): a first-order recursion along either axis.
Field exponential(Prng& prng, double L) {
  const double stay = std::exp(-kPitch_mm / L);
  const double fresh = std::sqrt(1.0 - stay * stay);
  Field f(kColumns * kRows);
  for (double& v : f) v = prng.normal();
  for (int r = 0; r < kRows; ++r)
    for (int c = 1; c < kColumns; ++c)
      f[at(r, c, kColumns)] = stay * f[at(r, c - 1, kColumns)] + fresh * f[at(r, c, kColumns)];
  for (int r = 1; r < kRows; ++r)
    for (int c = 0; c < kColumns; ++c)
      f[at(r, c, kColumns)] = stay * f[at(r - 1, c, kColumns)] + fresh * f[at(r, c, kColumns)];
  for (double& v : f) v *= kNoise_mm;
  return f;
}

Seat seat_of(const Field& field) {
  std::size_t i = 0;
  Seat seat([&](double, double) { return field[i++]; }, kPitch_mm);
  seat.region.cell_points_min = 6;
  return seat;
}

/// Over many seeds: the noise factor, and the true error of height and tilt in units of covariance times factor.
struct Honesty {
  double factor = 0.0;
  double normalised = 0.0;
};
template <typename Noise>
Honesty honesty(int seeds, const Noise& noise) {
  Honesty sum;
  for (int seed = 1; seed <= seeds; ++seed) {
    Prng prng(static_cast<std::uint64_t>(seed));
    Seat seat = seat_of(noise(prng));
    const PlaneFit plane = fit_plane_lsq(seat.points(), Vec3::UnitZ());
    const Flatness f = seat.measure(plane);
    EXPECT_TRUE(f.ok);
    EXPECT_GE(f.noise_factor, 1.0);
    sum.factor += f.noise_factor / seeds;
    const double height = plane.centroid.z() * plane.centroid.z() / (plane.sigma_offset_mm * plane.sigma_offset_mm);
    const double tilt_x = plane.normal.x() * plane.normal.x() / plane.cov_normal(0, 0);
    const double tilt_y = plane.normal.y() * plane.normal.y() / plane.cov_normal(1, 1);
    sum.normalised += (height + tilt_x + tilt_y) / f.noise_factor / (3.0 * seeds);
  }
  return sum;
}

TEST(NoiseFactor, is_one_for_white_noise) {
  const Honesty h = honesty(60, [](Prng& prng) { return white(prng); });
  EXPECT_NEAR(h.factor, 1.06, 0.06) << "13 % scatter, never below 1";
  EXPECT_NEAR(h.normalised, 1.0, 0.3);
}

// Sixty seeds determine a ratio of variances of three components to about 11 %.
TEST(NoiseFactor, makes_the_covariance_true_when_neighbours_share_their_errors) {
  for (const double L : {0.3, 1.0, 2.0}) {
    const Honesty g = honesty(60, [L](Prng& prng) { return gaussian(prng, L); });
    EXPECT_NEAR(g.normalised, 1.0, 0.28) << "Gaussian " << L;
    const Honesty e = honesty(60, [L](Prng& prng) { return exponential(prng, L); });
    EXPECT_NEAR(e.normalised, 1.0, 0.28) << "exponential " << L;
    EXPECT_GT(std::min(g.factor, e.factor), L < 0.5 ? 1.5 : 10.0) << L;
  }
}

TEST(NoiseFactor, does_not_take_form_for_noise) {
  const auto form = [](double x, double s) {
    return 0.1 * (x / 51.0) * (x / 51.0) + 0.05 * (x / 51.0) * (s / 75.0) + 0.02 * std::sin(2.0 * kPi * s / 75.0);
  };
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Prng flat_noise(seed);
    Prng bent_noise(seed);
    const Flatness flat = Seat([&](double, double) { return 0.03 * flat_noise.normal(); }).measure(0.03);
    const Flatness bent =
        Seat([&](double x, double s) { return form(x, s) + 0.03 * bent_noise.normal(); }).measure(0.03);
    EXPECT_NEAR(bent.noise_factor, flat.noise_factor, 0.05);
    EXPECT_NEAR(bent.noise_mm, flat.noise_mm, 0.002);
    EXPECT_NEAR(flat.noise_mm, flat.lsq_mm, 0.015) << "a flat seat reads its noise";
    EXPECT_GT(bent.lsq_mm, 2.0 * bent.noise_mm);
  }
}

TEST(NoiseFactor, is_not_moved_by_a_bump) {
  Prng prng(3);
  const Flatness f = Seat([&](double x, double s) {
                       return (std::hypot(x - 20.0, s + 30.0) < 3.0 ? 0.3 : 0.0) + 0.03 * prng.normal();
                     }).measure(0.03);
  EXPECT_LT(f.noise_factor, 1.4);
  EXPECT_NEAR(f.noise_mm, 0.0375, 0.003);
}

TEST(NoiseFactor, is_not_stated_for_a_small_region) {
  Prng prng(3);
  Seat seat([&](double, double) { return 0.03 * prng.normal(); });
  seat.region.half_x_mm = 15.0;
  EXPECT_TRUE(std::isnan(seat.measure(0.03).noise_factor));
}

/// A seat with one object on it, plus white noise.
template <typename Thing>
SurfaceDefect defect_of(std::uint64_t seed, const Thing& thing) {
  Prng prng(seed);
  return Seat([&](double x, double s) { return thing(x, s) + kNoise_mm * prng.normal(); }).measure(kNoise_mm).defect;
}

TEST(DefectChannel, shows_a_chip_and_a_burr_of_a_few_square_millimetres) {
  for (const double height : {-0.1, 0.1, -0.5, 0.5}) {
    SCOPED_TRACE(height);
    const SurfaceDefect d = defect_of(
        5, [&](double x, double s) { return std::abs(x - 20.25) < 1.5 && std::abs(s + 30.0) < 1.5 ? height : 0.0; });
    EXPECT_GE(d.cells, 2U);
    EXPECT_NEAR(d.area_mm2, 9.0, 7.0);
    EXPECT_NEAR(d.height_mm, height, 0.1 * std::abs(height) + 0.015);
    EXPECT_NEAR(d.x_mm, 20.25, 1.0);
    EXPECT_NEAR(d.s_mm, -30.0, 1.0);
    EXPECT_NEAR(d.limit_mm, 5.0 * kNoise_mm / 6.0, 0.004);
  }
}

TEST(DefectChannel, names_the_larger_of_two_and_keeps_the_sides_apart) {
  const SurfaceDefect d = defect_of(6, [](double x, double s) {
    if (std::hypot(x - 20.0, s + 30.0) < 2.0) return 0.8;
    if (std::hypot(x + 30.0, s - 10.0) < 4.0) return -0.2;
    return std::hypot(x + 30.0, s - 17.0) < 3.0 ? 0.2 : 0.0;
  });
  EXPECT_NEAR(d.height_mm, -0.2, 0.02);
  EXPECT_NEAR(d.area_mm2, kPi * 16.0, 15.0);
  EXPECT_NEAR(d.x_mm, -30.0, 0.8);
  EXPECT_NEAR(d.s_mm, 10.0, 0.8);
}

TEST(DefectChannel, is_quiet_on_noise_and_on_a_gentle_bow) {
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 16; ++seed) {
    alarms += defect_of(seed, [](double, double) { return 0.0; }).cells > 0 ? 1 : 0;
    alarms += defect_of(seed, [](double x, double) { return 0.1 * (x * x / 2601.0 - 1.0 / 3.0); }).cells > 0 ? 1 : 0;
  }
  EXPECT_LE(alarms, 1) << "6800 cells pass five standard deviations in 0.4 % of scans";
}

TEST(DefectChannel, is_quiet_on_a_coarse_scan_with_cells_of_unequal_noise) {
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Prng prng(seed);
    Seat seat([&](double, double) { return kNoise_mm * prng.normal(); }, 0.4);
    seat.region.cell_points_min = 6;
    alarms += seat.measure(kNoise_mm).defect.cells > 0 ? 1 : 0;
  }
  EXPECT_LE(alarms, 1);
}

TEST(DefectChannel, is_empty_for_a_perfect_seat) {
  const SurfaceDefect d = Seat([](double, double) { return 0.0; }).measure(0.0).defect;
  EXPECT_EQ(d.cells, 0U);
  EXPECT_GT(d.limit_mm, 0.0);
}

}  // namespace
}  // namespace slabd::algo
