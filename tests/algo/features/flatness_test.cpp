// SPDX-License-Identifier: Apache-2.0
#include "algo/features/flatness.h"

#include <gtest/gtest.h>

#include <array>
#include <functional>
#include <vector>

#include "algo/algo.h"
#include "seat.h"
#include "surfaces.h"

namespace slabd::algo {
namespace {

using slabd::testing::peak_to_valley;
using slabd::testing::rms;
using slabd::testing::Seat;
using slabd::testing::surface;

TEST(MinimumZone, equals_the_width_of_regular_solids) {
  const double h = std::sqrt(0.5);
  const std::vector<Vec3> tetrahedron = {
      {0.5, 0.0, -0.5 * h}, {-0.5, 0.0, -0.5 * h}, {0.0, 0.5, 0.5 * h}, {0.0, -0.5, 0.5 * h}};
  EXPECT_NEAR(minimum_zone_mm(tetrahedron), 0.707106781187, 1e-12);
  const std::vector<Vec3> octahedron = {{h, 0, 0}, {-h, 0, 0}, {0, h, 0}, {0, -h, 0}, {0, 0, h}, {0, 0, -h}};
  EXPECT_NEAR(minimum_zone_mm(octahedron), 0.816496580928, 1e-12);
  std::vector<Vec3> cube;
  for (int i = 0; i < 8; ++i) cube.push_back(Vec3(i & 1, (i >> 1) & 1, (i >> 2) & 1));
  EXPECT_NEAR(minimum_zone_mm(cube), 1.0, 1e-12);
}

TEST(MinimumZone, matches_hand_computation_for_small_sets) {
  const std::vector<Vec3> saddle = {{50, 50, 0.03}, {-50, 50, -0.03}, {-50, -50, 0.03}, {50, -50, -0.03}};
  EXPECT_NEAR(minimum_zone_mm(saddle), 0.06, 1e-12);
  std::vector<Vec3> ramp;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 2; ++j) ramp.push_back(Vec3(50.0 * i, 50.0 * j, i == 3 ? 0.06 : 0.0));
  EXPECT_NEAR(minimum_zone_mm(ramp), 0.039999996800, 1e-12);
  const PlaneFit plane = fit_plane_lsq(ramp, Vec3::UnitZ());
  EXPECT_NEAR(peak_to_valley(ramp, plane), 0.041999995723, 1e-12);
  EXPECT_NEAR(rms(plane), 0.016431675660, 1e-12);
  const std::vector<Vec3> five = {
      {11.5, 7, 1.1}, {18.5, 6.9, 1.03}, {4.5, 13, 1.02}, {25.5, 30, 1.03}, {11.5, 37.5, 1.02}};
  EXPECT_NEAR(minimum_zone_mm(five), 0.067262058, 1e-9);
  EXPECT_NEAR(peak_to_valley(five, fit_plane_lsq(five, Vec3::UnitZ())), 0.072097300, 1e-9);
}

TEST(MinimumZone, matches_the_convex_hull_for_surfaces) {
  EXPECT_NEAR(minimum_zone_mm(surface(1, 21, 31, 0.02, 0.05)), 0.093608165639, 2e-12);
  EXPECT_NEAR(minimum_zone_mm(surface(1, 21, 31, 0.02, 0.05, Vec3(3700.0, 2500.0, 1200.0))), 0.093608165639, 2e-11);
  EXPECT_NEAR(minimum_zone_mm(surface(7, 5, 5, 0.1, 0.0)), 0.199157926005, 2e-12);
  EXPECT_NEAR(minimum_zone_mm(surface(9, 67, 102, 0.05, 0.0)), 0.140133609010, 2e-12);
  EXPECT_NEAR(minimum_zone_mm(surface(11, 67, 102, 0.01, 0.05)), 0.076487871444, 2e-12);
  EXPECT_NEAR(minimum_zone_mm(surface(13, 250, 400, 0.03, 0.02)), 0.105033665850, 2e-12);
}

TEST(MinimumZone, is_NaN_without_a_plane) {
  EXPECT_TRUE(std::isnan(minimum_zone_mm({})));
  const std::vector<Vec3> same(10, Vec3(1.0, 2.0, 3.0));
  EXPECT_TRUE(std::isnan(minimum_zone_mm(same)));
}

TEST(Flatness, equals_the_noise_of_cell_means_for_a_noisy_seat) {
  Prng prng(4);
  const Flatness f = Seat([&](double, double) { return 0.029 * prng.normal(); }).measure();
  ASSERT_TRUE(f.ok);
  EXPECT_EQ(f.cells, 6800U);
  EXPECT_NEAR(f.std_cells_mm, 0.029 / 6.0, 3e-4) << "36 points a cell";
  EXPECT_NEAR(f.lsq_mm, 7.5 * 0.029 / 6.0, 0.012);
  EXPECT_LE(f.min_zone_mm, f.lsq_mm);
  EXPECT_GT(f.raw_high_mm - f.raw_low_mm, 0.2) << "single points show far more";
}

TEST(Flatness, includes_a_chip_of_four_millimetres) {
  const auto chip = [](double x, double y) { return std::hypot(x - 10.0, y + 20.0) < 2.0 ? -0.8 : 0.0; };
  const Flatness f = Seat(chip).measure();
  ASSERT_TRUE(f.ok);
  EXPECT_NEAR(f.lsq_mm, 0.8, 0.01);
  EXPECT_NEAR(f.raw_low_mm, -0.8, 1e-6);
}

TEST(Flatness, is_not_moved_by_a_stray_point_in_a_cell) {
  Seat seat([](double, double) { return 0.0; });
  seat.xyz[3 * 1000 + 2] = 0.9F;
  seat.xyz[3 * 90000 + 2] = -0.7F;
  const Flatness f = seat.measure();
  ASSERT_TRUE(f.ok);
  EXPECT_NEAR(f.lsq_mm, 0.0, 1e-6);
  EXPECT_NEAR(f.raw_high_mm, 0.9, 1e-6);
  EXPECT_NEAR(f.raw_low_mm, -0.7, 1e-6);
}

TEST(Flatness, does_not_call_a_slope_unflat) {
  const Flatness f = Seat([](double x, double y) { return 0.003 * x - 0.002 * y; }).measure();
  ASSERT_TRUE(f.ok);
  EXPECT_NEAR(f.lsq_mm, 0.0, 1e-5);
}

TEST(Flatness, counts_only_cells_with_enough_points) {
  EXPECT_FALSE(Seat([](double, double) { return 0.0; }, 0.5).measure().ok) << "nine points a cell";
  Seat half([](double, double) { return 0.0; });
  half.xyz.resize(half.xyz.size() / 3 / 2 * 3 + 3 * 5000);
  const Flatness f = half.measure();
  EXPECT_LT(f.cells, 4000U);
  EXPECT_FALSE(f.ok) << "the other half was not seen";
  EXPECT_TRUE(std::isnan(f.lsq_mm));
}

/// A level seat without the points for which `gone(x, y)` is true.
template <typename Gone>
Seat without(const Gone& gone, double pitch = 0.25) {
  Seat seat([](double, double) { return 0.0; }, pitch);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < seat.xyz.size(); i += 3) {
    if (gone(static_cast<double>(seat.xyz[i]), static_cast<double>(seat.xyz[i + 1]))) continue;
    std::copy_n(seat.xyz.begin() + static_cast<std::ptrdiff_t>(i), 3,
                seat.xyz.begin() + static_cast<std::ptrdiff_t>(kept));
    kept += 3;
  }
  seat.xyz.resize(kept);
  return seat;
}

TEST(Flatness, is_not_measured_over_a_hole) {
  const auto square = [](double side) {
    return without([side](double x, double y) { return x > 0.0 && x < side && y > 0.0 && y < side; }).measure();
  };
  const Flatness small = square(9.0);
  EXPECT_TRUE(small.ok);
  EXPECT_EQ(small.cells_missing, 36U);
  EXPECT_NEAR(small.hole_mm2, 81.0, 1e-9);
  const Flatness large = square(12.0);
  EXPECT_FALSE(large.ok);
  EXPECT_NEAR(large.hole_mm2, 144.0, 1e-9);
  EXPECT_TRUE(std::isnan(large.min_zone_mm));
  // A slanted cable across the seat, one cell wide: its cells touch at least at corners.
  EXPECT_FALSE(without([](double x, double y) { return std::abs(x - y) < 2.0; }).measure().ok);
}

TEST(Flatness, is_not_measured_when_many_small_holes_add_up) {
  const auto dotted = [](double period) {
    return without([period](double x, double y) {
             return std::fmod(x + 51.0, period) < 3.0 && std::fmod(y + 75.0, period) < 3.0;
           })
        .measure();
  };
  EXPECT_TRUE(dotted(15.0).ok) << "4 %";
  const Flatness f = dotted(12.0);
  EXPECT_FALSE(f.ok) << "6 %";
  EXPECT_NEAR(f.hole_mm2, 9.0, 1e-9);
}

TEST(Flatness, counts_sparse_cells_as_seen_with_their_heights) {
  // In a square of 20 mm only every third point exists: 12 of 36 per cell, except for the pattern's chance.
  const auto thinned = [](double x, double y) {
    return std::abs(x) < 10.0 && std::abs(y) < 10.0 && static_cast<int>(std::floor(4.0 * (x + y))) % 4 != 0;
  };
  Seat seat = without(thinned);
  const Flatness flat = seat.measure();
  EXPECT_TRUE(flat.ok);
  EXPECT_EQ(flat.cells_missing, 0U);
  EXPECT_LT(flat.cells, 6700U) << "sparse cells are not full";
  for (std::size_t i = 0; i < seat.xyz.size(); i += 3)
    if (std::abs(seat.xyz[i]) < 10.0F && std::abs(seat.xyz[i + 1]) < 10.0F) seat.xyz[i + 2] = 5.0F;
  const Flatness raised = seat.measure();
  EXPECT_TRUE(raised.ok);
  EXPECT_GT(raised.lsq_mm, 4.5) << "something stands there: that little of it was seen makes the seat no flatter";
  EXPECT_GT(raised.defect.area_mm2, 100.0);
}

TEST(Flatness, equals_that_of_the_whole_bow_if_one_side_is_sparse) {
  // Half of the seat, or a spot of it, is dark: every fifth of 36 points per cell remains. It sinks only a little.
  const auto bow = [](double x, double) { return -0.4 * (x / 51.0) * (x / 51.0); };
  const auto dent = [](double x, double y) { return -0.12 * std::exp(-(x * x + y * y) / 128.0); };
  const auto left = [](double x, double) { return x < 0.0; };
  const auto spot = [](double x, double y) { return std::hypot(x, y) < 12.0; };
  struct Case {
    std::function<double(double, double)> height;
    std::function<bool(double, double)> dark;
    double size_mm;
  };
  for (const Case& c : {Case{bow, left, 0.4}, Case{dent, spot, 0.12}}) {
    Prng prng(13);
    Seat seat([&](double x, double y) { return c.height(x, y) + 0.005 * prng.normal(); });
    std::vector<float> seen;
    for (std::size_t i = 0; i < seat.xyz.size(); i += 3) {
      const bool dark = c.dark(static_cast<double>(seat.xyz[i]), static_cast<double>(seat.xyz[i + 1]));
      if (!dark || i / 3 % 5 == 0) seen.insert(seen.end(), &seat.xyz[i], &seat.xyz[i] + 3);
    }
    seat.xyz = seen;
    const Flatness flat = seat.measure();
    ASSERT_TRUE(flat.ok);
    EXPECT_GT(flat.lsq_mm, 0.98 * c.size_mm);
    EXPECT_LT(flat.lsq_mm, c.size_mm + 0.02);
  }
}

TEST(Flatness, damage_that_returns_few_points_counts) {
  // Bumps of six by six cells, 2 mm high, each smaller than a refused hole, with one point in six remaining.
  Prng prng(11);
  const auto bump = [](double x, double y) {
    const auto near = [](double v) { return std::abs(std::remainder(v, 40.0)) < 4.5; };
    return near(x) && near(y) && std::abs(x) < 50.0 && std::abs(y) < 50.0;
  };
  Seat seat([&](double x, double y) { return bump(x, y) ? 2.0 : 0.0; });
  std::vector<float> seen;
  for (std::size_t i = 0; i < seat.xyz.size(); i += 3)
    if (seat.xyz[i + 2] < 1.0F || prng.uniform() < 1.0 / 6.0)
      seen.insert(seen.end(), {seat.xyz[i], seat.xyz[i + 1], seat.xyz[i + 2]});
  seat.xyz = seen;
  const Flatness flat = seat.measure();
  EXPECT_TRUE(flat.ok);
  EXPECT_GT(flat.lsq_mm, 1.8);
  EXPECT_GT(flat.defect.area_mm2, 20.0);
}

TEST(Flatness, a_drop_of_water_is_not_seen_and_as_much_mortar_counts) {
  // A dome, 8 mm wide and 1.2 mm high; water returns one point in seven.
  const auto dome = [](double x, double y) {
    const double r2 = (x * x + y * y) / 16.0;
    return r2 < 1.0 ? 1.2 * std::sqrt(1.0 - r2) : 0.0;
  };
  for (const bool water : {true, false}) {
    Prng prng(12);
    Seat seat([&](double x, double y) { return dome(x - 10.0, y - 20.0) + dome(x + 30.0, y) + 0.013 * prng.normal(); });
    std::vector<float> seen;
    for (std::size_t i = 0; i < seat.xyz.size(); i += 3) {
      const auto x = static_cast<double>(seat.xyz[i]);
      const auto y = static_cast<double>(seat.xyz[i + 1]);
      const bool on_dome = std::hypot(x - 10.0, y - 20.0) < 4.0 || std::hypot(x + 30.0, y) < 4.0;
      if (!water || !on_dome || prng.uniform() < 1.0 / 7.0)
        seen.insert(seen.end(), {seat.xyz[i], seat.xyz[i + 1], seat.xyz[i + 2]});
    }
    seat.xyz = seen;
    const Flatness flat = seat.measure(0.013);
    ASSERT_TRUE(flat.ok);
    if (water) {
      EXPECT_LT(flat.closed_mm, 0.12);
      EXPECT_GT(flat.cells_missing, 20U) << "where the concrete lies under water is not known";
    } else {
      EXPECT_GT(flat.closed_mm, 1.0);
      EXPECT_EQ(flat.cells_missing, 0U);
    }
  }
}

TEST(Flatness, a_pore_in_grainy_concrete_is_bridged) {
  // Grain of 0.02 mm rms, correlated over 2 mm: its valleys join the pore, which must still not count as a wide hollow.
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    Prng prng(seed);
    constexpr std::size_t kNodes = 200;
    std::vector<double> grain(kNodes * kNodes);
    for (double& g : grain) g = 0.03 * prng.normal();
    const auto at = [&](double x, double y) {
      const double u = std::clamp((x + 150.0) / 1.5, 0.0, 198.0);
      const double v = std::clamp((y + 150.0) / 1.5, 0.0, 198.0);
      const auto i = static_cast<std::size_t>(u);
      const auto k = static_cast<std::size_t>(v);
      const double a = u - static_cast<double>(i);
      const double b = v - static_cast<double>(k);
      const double* g = &grain[k * kNodes + i];
      return (1.0 - b) * ((1.0 - a) * g[0] + a * g[1]) + b * ((1.0 - a) * g[kNodes] + a * g[kNodes + 1]);
    };
    const auto measured = [&](double pore_mm) {
      return Seat([&](double x, double y) {
               const double r = std::hypot(x - 12.0, y + 8.0) / 2.5;
               return at(x, y) - (r < 1.0 ? pore_mm * (1.0 - r * r) : 0.0) + 0.013 * prng.normal();
             })
          .measure(0.025);
    };
    const Flatness flat = measured(0.0);
    const Flatness pore = measured(1.5);
    ASSERT_TRUE(flat.ok && pore.ok);
    EXPECT_GT(pore.lsq_mm, 1.0);
    EXPECT_LT(pore.closed_mm, flat.closed_mm + 0.1);
  }
}

TEST(Flatness, connected_points_are_not_strays_however_narrow) {
  struct Case {
    const char* what;
    std::function<double(double, double)> height;
    double size_mm;
  };
  const std::array<Case, 4> cases = {{
      {"a ridge astride the cells' border", [](double x, double) { return std::abs(x - 10.5) < 0.6 ? 2.5 : 0.0; }, 2.5},
      {"a groove", [](double, double y) { return std::abs(y + 12.0) < 0.5 ? -2.5 : 0.0; }, 2.5},
      {"a slanting crack", [](double x, double y) { return std::abs(x - 0.4 * y) < 0.3 ? -2.5 : 0.0; }, 2.5},
      {"a comb of fins", [](double x, double) { return std::abs(std::remainder(x - 0.6, 3.0)) < 0.235 ? 2.0 : 0.0; },
       2.0},
  }};
  for (const Case& c : cases) {
    Seat seat(c.height);
    const Flatness flat = seat.measure();
    ASSERT_TRUE(flat.ok) << c.what;
    EXPECT_NEAR(flat.lsq_mm, c.size_mm, 0.1) << c.what;
  }
}

TEST(Flatness, a_crack_that_has_raised_its_lips_is_as_deep_as_it_is) {
  // Half a millimetre wide; its lips alone are within the tolerance of a seat.
  for (const double depth_mm : {4.0, 0.8}) {
    for (const double at_mm : {10.1, 10.5, 11.0, 11.3}) {
      Prng prng(17);
      Seat seat([&](double x, double y) {
        const double d = std::abs(x - at_mm);
        if (std::abs(y) > 20.0 || d > 0.6) return 0.01 * prng.normal();
        return (d < 0.25 ? -depth_mm : 0.4) + 0.01 * prng.normal();
      });
      const Flatness flat = seat.measure();
      ASSERT_TRUE(flat.ok) << at_mm;
      EXPECT_GT(flat.lsq_mm, depth_mm + 0.1) << at_mm;
      EXPECT_LT(flat.lsq_mm, depth_mm + 0.45) << at_mm;
    }
  }
}

TEST(Flatness, damage_in_every_cell_of_a_coarse_scan_does_not_give_a_flat_seat) {
  // Twelve points per cell in rows of three lines, one of them a ridge: eight points next to it remain.
  Seat seat([](double, double) { return 0.0; });
  seat.xyz.clear();
  for (float y = -74.8125F; y < 75.0F; y += 0.375F)
    for (float x = -50.75F; x < 51.0F; x += 0.5F)
      seat.xyz.insert(seat.xyz.end(), {x, y, std::abs(std::remainder(x + 50.25F, 1.5F)) < 0.1F ? 2.0F : 0.0F});
  const Flatness flat = seat.measure();
  ASSERT_TRUE(flat.ok);
  EXPECT_NEAR(flat.lsq_mm, 2.0, 0.1);
}

TEST(Flatness, noise_includes_that_of_cells_with_few_points) {
  // One half has five points per cell, one in a hundred of them half a millimetre off.
  Prng prng(18);
  Seat seat([&](double, double) { return prng.uniform() < 0.01 ? 0.5 : 0.05 * prng.normal(); }, 0.22);
  std::vector<float> seen;
  for (std::size_t i = 0; i < seat.xyz.size(); i += 3)
    if (seat.xyz[i] < 0.0F || prng.uniform() < 0.16) seen.insert(seen.end(), &seat.xyz[i], &seat.xyz[i] + 3);
  seat.xyz = seen;
  const Flatness flat = seat.measure(0.05);
  ASSERT_TRUE(flat.ok);
  EXPECT_NEAR(flat.lsq_mm, flat.noise_mm, 0.25 * flat.noise_mm);
}

TEST(Flatness, damage_in_every_cell_does_not_give_a_flat_seat) {
  Prng prng(16);
  for (const double up_mm : {2.0, -2.0}) {
    Seat seat([&](double x, double) {
      return (std::abs(std::remainder(x - 0.125, 1.25)) < 0.1 ? up_mm : 0.0) + 0.01 * prng.normal();
    });
    const Flatness flat = seat.measure();
    ASSERT_TRUE(flat.ok);
    EXPECT_NEAR(flat.lsq_mm, 2.0, 0.1);
  }
}

TEST(Flatness, damage_does_not_count_as_noise) {
  // Ridges in every third or fourth row of cells, narrower than a cell or wider: the cells between have the usual
  // noise.
  Prng prng(15);
  const double quiet_mm = Seat([&](double, double) { return 0.03 * prng.normal(); }).measure().noise_mm;
  for (const double wide_mm : {0.5, 3.2}) {
    const double every_mm = wide_mm < 1.0 ? 4.7 : 11.3;
    Seat seat([&](double x, double) {
      return (std::abs(std::remainder(x, every_mm)) < 0.5 * wide_mm ? 2.0 : 0.0) + 0.03 * prng.normal();
    });
    const Flatness flat = seat.measure();
    ASSERT_TRUE(flat.ok);
    EXPECT_NEAR(flat.lsq_mm, 2.0, 0.1) << wide_mm;
    EXPECT_LT(flat.noise_mm, 1.5 * quiet_mm) << wide_mm;
    EXPECT_LT(flat.noise_factor, 3.0) << wide_mm;
  }
}

TEST(Flatness, the_seat_next_to_damage_is_not_excluded) {
  // In a row of cells two thirds are damage: connected points on the other side of it are the seat.
  for (const double height : {10.0, 3.0, -3.0}) {
    Seat seat([&](double x, double y) { return y > 0.0 && y < 1.0 && std::abs(x) < 40.0 ? height : 0.0; });
    const Flatness flat = seat.measure();
    ASSERT_TRUE(flat.ok) << height;
    EXPECT_NEAR(flat.lsq_mm, std::abs(height), 0.03 * std::abs(height)) << height;
  }
}

TEST(Flatness, isolated_strays_are_still_removed) {
  // One point in a thousand is 1 mm up or down: some touch, but hardly ever half a cell's worth.
  Prng prng(12);
  Seat seat([&](double, double) {
    const double u = prng.uniform();
    return u < 0.0005 ? 1.0 : u < 0.001 ? -1.0 : 0.0;
  });
  const Flatness flat = seat.measure();
  ASSERT_TRUE(flat.ok);
  EXPECT_LT(flat.lsq_mm, 0.06);
  EXPECT_GT(flat.raw_high_mm, 0.9);
}

/// A burr or a grain of dust counts, and so does the uncertainty whether it will stay. A hump and damage count fully.
TEST(Flatness, narrow_low_bumps_are_reported_separately) {
  const auto bump = [](double x, double y, double wide, double high) {
    const double r = std::hypot(x - 11.0, y + 20.0) / (0.5 * wide);
    return r < 1.0 ? 0.5 * high * (1.0 + std::cos(kPi * r)) : 0.0;
  };
  Prng prng(7);
  const auto seat = [&](double wide, double high) {
    return Seat([&](double x, double y) { return bump(x, y, wide, high) + 0.013 * prng.normal(); }).measure(0.013);
  };
  EXPECT_EQ(seat(4.0, 0.0).bumps_mm, 0.0);
  const Flatness burr = seat(4.0, 0.3);
  EXPECT_GT(burr.closed_mm, 0.2);
  EXPECT_NEAR(burr.closed_mm - burr.bumps_mm, seat(4.0, 0.0).closed_mm, 0.03);
  EXPECT_LT(seat(30.0, 0.3).bumps_mm, 0.03) << "a hump that a rail pad lies on";
  EXPECT_EQ(seat(5.0, 0.9).bumps_mm, 0.0) << "damage";
}

TEST(Flatness, expects_no_points_at_casings) {
  const auto casing = [](double x, double y) { return std::hypot(x, std::abs(y) - 60.0) < 24.0; };
  Seat seat = without(casing);
  EXPECT_FALSE(seat.measure().ok);
  seat.region.casing_s_mm = 60.0;
  seat.region.casing_clear_mm = 24.0;
  EXPECT_TRUE(seat.measure().ok);
}

TEST(Flatness, is_measured_from_a_coarse_scan) {
  // 14 points per cell on average, nine in some.
  Prng prng(8);
  Seat seat = without([&](double, double) { return prng.uniform() < 0.02; }, 0.4);
  const Flatness f = seat.measure();
  EXPECT_TRUE(f.ok);
  EXPECT_LT(f.cells, 6750U);
  EXPECT_EQ(f.cells_missing, 0U);
}

TEST(Flatness, refuses_a_region_with_too_many_cells) {
  Seat seat([](double, double) { return 0.0; });
  seat.region.cell_mm = 0.5;
  EXPECT_FALSE(seat.measure().ok);
}

}  // namespace
}  // namespace slabd::algo
