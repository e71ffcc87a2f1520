// SPDX-License-Identifier: Apache-2.0
//
// Flatness, noise of cells, casings and circle: the fast methods must agree with the plain ones, on complete and on
// difficult input, and give the same bits with every instruction set and with one or two threads. Floats in the seat's
// frame allow a difference of 1e-6 mm between fast and plain.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cstring>
#include <functional>
#include <numeric>
#include <string>
#include <vector>

#include "algo/algo.h"
#include "algo/features/casing_fits.h"
#include "algo/median.h"
#include "plain_features.h"
#include "seat.h"

namespace slabd::algo {
namespace {

using slabd::testing::Seat;

constexpr InstructionSet kSets[] = {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2,
                                    InstructionSet::avx512, InstructionSet::best};

/// A seat plane slightly off the nominal one.
PlaneFit tilted(double std_mm) {
  PlaneFit plane;
  plane.ok = true;
  plane.normal = Vec3(0.004, -0.007, 1.0).normalized();
  plane.offset_mm = 0.13;
  plane.std_mm = std_mm;
  return plane;
}

Flatness plain_flatness(const Seat& seat, const PlaneFit& plane) {
  std::vector<std::uint32_t> index(seat.xyz.size() / 3);
  std::iota(index.begin(), index.end(), 0U);
  std::vector<std::uint32_t> start(limits::kFlatnessCellsMax + 1);
  std::vector<std::uint32_t> next(limits::kFlatnessCellsMax);
  std::vector<Vec3> mean(limits::kFlatnessCellsMax);
  return plain::measure_flatness(seat.xyz.data(), index, FastTransform(Pose::identity()), Vec3::UnitY(), plane,
                                 seat.region, {start, next, mean});
}

void expect_near(double a, double b, double tolerance, const char* what) {
  if (std::isnan(a) && std::isnan(b)) return;
  EXPECT_NEAR(a, b, tolerance * std::max(1.0, std::abs(b))) << what;
}

void expect_same(const Flatness& fast, const Flatness& plain) {
  constexpr double kFloat = 2e-6;
  EXPECT_EQ(fast.ok, plain.ok);
  EXPECT_EQ(fast.cells, plain.cells);
  EXPECT_EQ(fast.cells_missing, plain.cells_missing);
  EXPECT_EQ(fast.hole_mm2, plain.hole_mm2);
  EXPECT_EQ(fast.defect.cells, plain.defect.cells);
  expect_near(fast.lsq_mm, plain.lsq_mm, kFloat, "lsq");
  expect_near(fast.min_zone_mm, plain.min_zone_mm, kFloat, "minimum zone");
  expect_near(fast.std_cells_mm, plain.std_cells_mm, kFloat, "std");
  expect_near(fast.raw_low_mm, plain.raw_low_mm, kFloat, "low");
  expect_near(fast.raw_high_mm, plain.raw_high_mm, kFloat, "high");
  expect_near(fast.noise_mm, plain.noise_mm, 1e-5, "noise");
  expect_near(fast.noise_factor, plain.noise_factor, 1e-3 * plain.noise_factor, "factor");
  expect_near(fast.defect.limit_mm, plain.defect.limit_mm, kFloat, "limit");
  expect_near(fast.defect.height_mm, plain.defect.height_mm, kFloat, "defect");
  expect_near(fast.defect.x_mm, plain.defect.x_mm, 1e-9, "x");
  expect_near(fast.defect.s_mm, plain.defect.s_mm, 1e-9, "s");
  expect_near(fast.seat_share, plain.seat_share, 1e-9, "share of the seat");
  for (int k = 0; k < 3; ++k) expect_near(fast.by_area.normal[k], plain.by_area.normal[k], 1e-8, "normal by area");
  expect_near(fast.by_area.height_mm, plain.by_area.height_mm, kFloat, "height by area");
}

/// Keeps the points for which keep() is true.
template <typename Keep>
void thin(Seat& seat, const Keep& keep) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < seat.xyz.size(); i += 3) {
    if (!keep(seat.xyz[i], seat.xyz[i + 1])) continue;
    std::copy_n(seat.xyz.begin() + static_cast<std::ptrdiff_t>(i), 3,
                seat.xyz.begin() + static_cast<std::ptrdiff_t>(kept));
    kept += 3;
  }
  seat.xyz.resize(kept);
}

/// Seats of every kind, each with noise; the positions are jittered so that no point is on a cell's border.
std::vector<std::pair<std::string, Seat>> seats() {
  std::vector<std::pair<std::string, Seat>> all;
  Prng prng(17);
  const auto noise = [&] { return 0.03 * prng.normal(); };
  const auto add = [&](const char* name, double pitch, const std::function<double(double, double)>& height) {
    Seat seat([&](double x, double y) { return height(x, y) + 0.004 * x - 0.007 * y + 0.13; }, pitch);
    for (std::size_t i = 0; i < seat.xyz.size(); i += 3) {
      seat.xyz[i] += static_cast<float>(0.1 * (prng.uniform() - 0.5));
      seat.xyz[i + 1] += static_cast<float>(0.1 * (prng.uniform() - 0.5));
    }
    all.emplace_back(name, std::move(seat));
  };
  add("level", 0.25, [&](double, double) { return noise(); });
  add("without noise", 0.25, [](double, double) { return 0.0; });
  add("with strays", 0.25,
      [&](double, double) { return noise() + (prng.uniform() < 0.02 ? 3.0 * prng.normal() : 0.0); });
  add("all strays", 0.3, [&](double, double) { return 40.0 * prng.uniform(); });
  add("with steps through its cells", 0.25,
      [&](double x, double y) { return noise() + (std::fmod(x + y + 200.0, 2.0) < 1.0 ? 0.4 : 0.0); });
  add("half of it sunk", 0.25, [&](double x, double) { return noise() + (x > 7.3 ? -5.0 : 0.0); });
  add("with a chip and a burr", 0.25, [&](double x, double y) {
    return noise() + (std::hypot(x - 10.0, y + 20.0) < 3.0 ? -0.6 : 0.0) +
           (std::hypot(x + 30.0, y - 9.0) < 2.0 ? 0.3 : 0.0);
  });
  add("coarse", 0.42, [&](double, double) { return noise(); });
  thin(all.back().second, [&](float, float) { return prng.uniform() > 0.05; });
  add("sparse in places", 0.25,
      [&](double x, double y) { return noise() + (std::hypot(x, y) < 9.0 && prng.uniform() < 0.5 ? 2.0 : 0.0); });
  thin(all.back().second, [&](float x, float y) { return std::hypot(x, y) > 15.0F || prng.uniform() < 0.25; });
  add("with a hole", 0.25, [&](double, double) { return noise(); });
  thin(all.back().second, [&](float x, float y) { return x < 3.0F || x > 14.0F || y < 3.0F || y > 14.0F; });
  add("too sparse", 0.6, [&](double, double) { return noise(); });
  add("turned", 0.25, [&](double, double) { return noise(); });
  for (std::size_t i = 0; i < all.back().second.xyz.size(); i += 3) {
    float& x = all.back().second.xyz[i];
    float& y = all.back().second.xyz[i + 1];
    const float old = x;
    x = 0.6F * x - 0.8F * y;
    y = 0.8F * old + 0.6F * y;
  }
  add("one point", 0.25, [&](double, double) { return noise(); });
  all.back().second.xyz.resize(3);
  add("fifteen points", 0.25, [&](double, double) { return noise(); });
  all.back().second.xyz.resize(45);
  add("sixty-five points", 0.25, [&](double, double) { return noise(); });
  all.back().second.xyz.resize(195);
  add("in no order", 0.25, [&](double, double) { return noise(); });
  std::vector<float>& xyz = all.back().second.xyz;
  for (std::size_t i = xyz.size() / 3 - 1; i > 0; --i) {
    const auto j = static_cast<std::size_t>(prng.uniform() * static_cast<double>(i + 1));
    std::swap_ranges(xyz.begin() + static_cast<std::ptrdiff_t>(3 * i),
                     xyz.begin() + static_cast<std::ptrdiff_t>(3 * i + 3),
                     xyz.begin() + static_cast<std::ptrdiff_t>(3 * j));
  }
  return all;
}

TEST(FastFlatness, agrees_with_the_plain_one_on_seats_of_every_kind) {
  for (auto& [name, seat] : seats()) {
    SCOPED_TRACE(name);
    const PlaneFit plane = tilted(0.03);
    expect_same(seat.measure(plane), plain_flatness(seat, plane));
  }
}

/// Every bit of the result.
std::string bits_of(const Flatness& f) {
  const std::array<double, 18> all = {f.seat_share,
                                      f.by_area.normal.x(),
                                      f.by_area.normal.y(),
                                      f.by_area.normal.z(),
                                      f.by_area.height_mm,
                                      f.hole_mm2,
                                      f.lsq_mm,
                                      f.min_zone_mm,
                                      f.std_cells_mm,
                                      f.raw_low_mm,
                                      f.raw_high_mm,
                                      f.noise_mm,
                                      f.noise_factor,
                                      f.defect.limit_mm,
                                      f.defect.height_mm,
                                      f.defect.x_mm,
                                      f.defect.s_mm,
                                      f.defect.area_mm2};
  std::string bytes(sizeof all, ' ');
  std::memcpy(bytes.data(), all.data(), sizeof all);
  return bytes + std::to_string(f.cells) + ' ' + std::to_string(f.cells_missing) + ' ' + std::to_string(f.defect.cells);
}

TEST(FastFlatness, has_the_same_bits_on_every_instruction_set_and_on_two_threads) {
  for (auto& [name, seat] : seats()) {
    SCOPED_TRACE(name);
    const std::string expected = bits_of(seat.measure(tilted(0.03)));
    for (const InstructionSet set : kSets) {
      if (!limit_instruction_set(set)) continue;
      for (seat.threads = 1; seat.threads <= 2; ++seat.threads)
        EXPECT_EQ(bits_of(seat.measure(tilted(0.03))), expected) << static_cast<int>(set) << ' ' << seat.threads;
    }
    (void)limit_instruction_set(InstructionSet::best);
  }
}

TEST(FastFlatness, takes_its_points_in_any_number_of_runs) {
  for (auto& [name, seat] : seats()) {
    SCOPED_TRACE(name);
    const Flatness one = seat.measure(tilted(0.03));
    for (const std::size_t runs : {2U, 7U, 1000U}) {
      seat.runs = runs;
      expect_same(seat.measure(tilted(0.03)), one);
    }
  }
}

TEST(FastFlatness, is_not_measured_beyond_capacity_or_of_a_seat_on_end) {
  Seat seat([](double, double) { return 0.0; });
  seat.runs = limits::kSeatRunsMax + 1;
  EXPECT_FALSE(seat.measure(tilted(0.03)).ok);
  seat.runs = limits::kSeatRunsMax;
  EXPECT_TRUE(seat.measure(tilted(0.03)).ok);
  PlaneFit on_end = tilted(0.03);
  on_end.normal = Vec3(1.0, 0.0, 0.1).normalized();
  EXPECT_FALSE(seat.measure(on_end).ok);
  const std::size_t count = limits::kSeatPointsMax + 1;
  while (seat.xyz.size() < 3 * count) seat.xyz.insert(seat.xyz.end(), {1.0F, 2.0F, 0.0F});
  EXPECT_FALSE(seat.measure(tilted(0.03)).ok);
  seat.xyz.resize(3 * (count - 1));
  EXPECT_TRUE(seat.measure(tilted(0.03)).ok);
}

TEST(FastCellNoise, agrees_with_the_plain_one_to_rounding) {
  Prng prng(5);
  for (int kind = 0; kind < 8; ++kind) {
    SCOPED_TRACE(kind);
    FlatnessRegion region{51.0, 75.0, 1.5, 12};
    if (kind == 3) region = {20.0, 280.0, 1.7, 12};
    if (kind == 4) region = {190.0, 20.5, 1.4, 12};
    const CellGrid grid(region);
    std::vector<double> heights;
    std::vector<std::uint32_t> cells;
    for (std::uint32_t c = 0; c < grid.cells(); ++c) {
      if (kind == 1 && prng.uniform() < 0.3) continue;
      const double x = grid.x_of(c) / region.half_x_mm;
      double h = 0.004 * prng.normal() + 0.1 * x * x;
      if (kind == 2 && prng.uniform() < 0.01) h += 1.0;
      heights.push_back(kind == 5 ? 0.0 : h);
      cells.push_back(c);
    }
    const CellNoise fast = noise_of_cells(grid, heights, cells, 9e-4, 40.0);
    const CellNoise plain = plain::noise_of_cells(grid, heights, cells, 9e-4, 40.0);
    ASSERT_EQ(fast.ok, plain.ok);
    if (!plain.ok) continue;
    EXPECT_NEAR(fast.factor, plain.factor, 1e-9 * plain.factor);
    EXPECT_NEAR(fast.cell_sigma_mm, plain.cell_sigma_mm, 1e-12);
    EXPECT_NEAR(fast.point_sigma_mm, plain.point_sigma_mm, 1e-12);
  }
}

TEST(FastCellNoise, a_steep_spectrum_has_a_known_factor_larger_than_that_of_white_noise) {
  const FlatnessRegion region{51.0, 75.0, 1.5, 12};
  const CellGrid grid(region);
  const double across_mm = grid.region.cell_mm * static_cast<double>(grid.columns);
  const double along_mm = grid.region.cell_mm * static_cast<double>(grid.rows);
  // Amplitudes in waves per mm: 0 is white.
  for (const double power : {0.0, 1.0, 1.5, 2.0, 3.0}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      SCOPED_TRACE(::testing::Message() << "power " << power << ", seed " << seed);
      Prng prng(seed);
      Eigen::MatrixXd amplitude = Eigen::MatrixXd::Zero(46, 31);
      for (Eigen::Index q = 0; q < amplitude.rows(); ++q)
        for (Eigen::Index p = 0; p < amplitude.cols(); ++p)
          if (const double k = 0.5 * std::hypot(double(p) / across_mm, double(q) / along_mm); k > 1.0 / 45.0)
            amplitude(q, p) = 2e-4 * std::pow(20.0 * k, -power) * prng.normal();
      const auto waves = [](Eigen::Index count, std::size_t places) {
        Eigen::MatrixXd all(static_cast<Eigen::Index>(places), count);
        for (Eigen::Index i = 0; i < all.rows(); ++i)
          for (Eigen::Index k = 0; k < count; ++k)
            all(i, k) = std::cos(kPi * double(k) * (double(i) + 0.5) / double(places));
        return all;
      };
      const Eigen::MatrixXd field =
          waves(amplitude.rows(), grid.rows) * amplitude * waves(amplitude.cols(), grid.columns).transpose();
      std::vector<double> heights(grid.cells());
      std::vector<std::uint32_t> cells(grid.cells());
      for (std::uint32_t c = 0; c < grid.cells(); ++c) {
        cells[c] = c;
        heights[c] = field(static_cast<Eigen::Index>(c / grid.columns), static_cast<Eigen::Index>(c % grid.columns)) +
                     0.0005 * prng.normal();
      }
      const CellNoise noise = noise_of_cells(grid, heights, cells, 9e-4, 40.0);
      ASSERT_TRUE(noise.ok);
      EXPECT_GT(noise.cell_sigma_mm, 0.0005);
      EXPECT_LT(noise.factor, 1e3);
      // Texture with more energy in long waves is never taken for white noise.
      const double white =
          40.0 * noise.cell_sigma_mm * noise.cell_sigma_mm / (noise.point_sigma_mm * noise.point_sigma_mm);
      if (power >= 1.0) {
        EXPECT_GT(noise.factor, std::fmax(1.0, white));
      }
    }
  }
}

/// A rim sampled by a rotated grid of points, possibly partly hidden, with strays; in a seat's frame.
struct Rim {
  std::vector<float> x, s, h;
  std::vector<float> xyz;
  std::vector<std::uint32_t> index;

  Rim(std::uint64_t seed, double pitch, double hidden_from_x, double stray_share) {
    Prng prng(seed);
    const Vec3 centre(0.8 * prng.uniform() - 0.4, 116.5 + 0.8 * prng.uniform() - 0.4, 0.0);
    const double turn = 2.0 * kPi * prng.uniform();
    const int reach = static_cast<int>(24.0 / pitch);
    for (int i = -reach; i <= reach; ++i) {
      for (int j = -reach; j <= reach; ++j) {
        const double px = pitch * (std::cos(turn) * i - std::sin(turn) * j);
        const double py = 116.5 + pitch * (std::sin(turn) * i + std::cos(turn) * j);
        const double radius = std::hypot(px - centre.x(), py - centre.y());
        const bool stray = prng.uniform() < stray_share;
        if ((radius < 15.0 && !stray) || radius > 23.0 || px > hidden_from_x || prng.uniform() < 0.02) continue;
        const double z = (radius < 22.0 ? -0.25 : 0.0) + 0.03 * prng.normal() + (stray ? 2.0 * prng.normal() : 0.0);
        index.push_back(static_cast<std::uint32_t>(index.size()));
        xyz.insert(xyz.end(), {static_cast<float>(px), static_cast<float>(py), static_cast<float>(z)});
        x.push_back(static_cast<float>(px));
        s.push_back(static_cast<float>(py));
        h.push_back(static_cast<float>(z));
      }
    }
  }
  [[nodiscard]] CloudPoints cloud() const { return {xyz.data(), index, FastTransform(Pose::identity())}; }
  [[nodiscard]] std::vector<SeatPoints> runs(std::size_t count) const {
    std::vector<SeatPoints> all;
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t from = k * x.size() / count;
      const std::size_t length = (k + 1) * x.size() / count - from;
      all.push_back(
          {std::span(x).subspan(from, length), std::span(s).subspan(from, length), std::span(h).subspan(from, length)});
    }
    return all;
  }
};

void expect_same(const CasingFeature& fast, const CasingFeature& plain) {
  ASSERT_EQ(fast.ok, plain.ok);
  EXPECT_EQ(fast.edge_points, plain.edge_points);
  if (!plain.ok) return;
  EXPECT_LT((fast.centre - plain.centre).norm(), 1e-5);
  EXPECT_NEAR(fast.radius_mm, plain.radius_mm, 1e-5);
  EXPECT_NEAR(fast.edge_rms_mm, plain.edge_rms_mm, 1e-5);
  EXPECT_NEAR(fast.inlier_fraction, plain.inlier_fraction, 1e-4);
  // One point more or less at the limit of the reach.
  EXPECT_NEAR(fast.height_mm, plain.height_mm, 2e-5);
  EXPECT_NEAR(fast.rim_std_mm, plain.rim_std_mm, 2e-5);
  EXPECT_NEAR(fast.rim_points, plain.rim_points, 3);
  EXPECT_LT((fast.cov_circle - plain.cov_circle).norm(), 2e-3 * plain.cov_circle.norm());
}

TEST(FastCasing, agrees_with_the_plain_one) {
  const PlaneFit seat = tilted(0.03);
  const Vec3 nominal(0.0, 116.5, (seat.offset_mm - seat.normal.y() * 116.5) / seat.normal.z());
  const CasingTask task{nominal, 15.0, 22.0, -0.25, 2.0, seat};
  int measured = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    for (const double hidden_from : {100.0, 7.0, 1.0, -5.0}) {
      SCOPED_TRACE(std::to_string(seed) + ' ' + std::to_string(hidden_from));
      Rim rim(seed, seed % 2 == 0 ? 0.25 : 0.4, hidden_from, seed % 3 == 0 ? 0.001 : 0.0);
      // The seat is tilted relative to the frame: move the rim onto it.
      for (std::size_t i = 0; i < rim.h.size(); ++i) {
        rim.h[i] += static_cast<float>((seat.offset_mm - seat.normal.x() * static_cast<double>(rim.x[i]) -
                                        seat.normal.y() * static_cast<double>(rim.s[i])) /
                                       seat.normal.z());
        // Every fourth has a lip at the bore, with about the tolerated share.
        const double beside = std::hypot(static_cast<double>(rim.x[i]), static_cast<double>(rim.s[i]) - 116.5);
        if (seed % 4 == 0 && beside < 15.0 + 0.02 * static_cast<double>(seed)) rim.h[i] += 1.0F;
        rim.xyz[3 * i + 2] = rim.h[i];
      }
      const CasingFeature plain = plain::measure_casing(rim.cloud(), task);
      expect_same(measure_casing(rim.runs(1), SeatFrame{}, task), plain);
      expect_same(measure_casing(rim.runs(9), SeatFrame{}, task), plain);
      expect_same(measure_casing(rim.cloud(), task), plain);
      measured += plain.ok ? 1 : 0;
    }
  }
  EXPECT_GT(measured, 80);
}

TEST(FastCasing, has_the_same_bits_on_every_instruction_set) {
  const PlaneFit seat = tilted(0.03);
  const CasingTask task{Vec3(0.0, 116.5, 0.9), 15.0, 22.0, -0.25, 2.0, seat};
  Rim rim(3, 0.3, 100.0, 0.01);
  for (float& h : rim.h) h += 0.9F;
  const auto bits = [&] {
    const CasingFeature c = measure_casing(rim.runs(3), SeatFrame{}, task);
    std::string bytes(sizeof(double) * 7, ' ');
    const std::array<double, 7> all = {c.centre.x(), c.centre.y(),  c.radius_mm,       c.height_mm,
                                       c.rim_std_mm, c.edge_rms_mm, c.cov_circle(1, 2)};
    std::memcpy(bytes.data(), all.data(), sizeof all);
    return bytes + std::to_string(c.rim_points) + (c.ok ? " ok" : " no");
  };
  const std::string expected = bits();
  EXPECT_TRUE(expected.ends_with(" ok"));
  for (const InstructionSet set : kSets) {
    if (!limit_instruction_set(set)) continue;
    EXPECT_EQ(bits(), expected) << static_cast<int>(set);
  }
  (void)limit_instruction_set(InstructionSet::best);
}

TEST(FastCasing, is_not_measured_from_no_points_or_a_few_points) {
  const PlaneFit seat = tilted(0.03);
  const CasingTask task{Vec3(0.0, 116.5, 0.9), 15.0, 22.0, -0.25, 2.0, seat};
  EXPECT_FALSE(measure_casing(std::span<const SeatPoints>{}, SeatFrame{}, task).ok);
  const std::vector<float> few = {1.0F, 2.0F, 3.0F};
  const SeatPoints points{few, few, few};
  EXPECT_FALSE(measure_casing(std::span(&points, 1), SeatFrame{}, task).ok);
}

/// Upper median.
double median_of_array(const Eigen::ArrayXd& values) {
  std::vector<double> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  return sorted[sorted.size() / 2];
}

/// The robust circle from (0, 0) with all of its 60 steps: weighted least squares by QR, the quality figures by their
/// definitions.
Circle circle_by_qr(const std::vector<Vec2>& points, const CircleWeights& weights) {
  const auto n = static_cast<Eigen::Index>(points.size());
  Circle circle;
  double cut = 0.0;
  for (int i = 0; i <= 60; ++i) {
    Eigen::MatrixXd J(n, 3);  // of the distances by centre and radius
    Eigen::ArrayXd r(n);
    for (Eigen::Index k = 0; k < n; ++k) {
      const Vec2 out = points[static_cast<std::size_t>(k)] - circle.centre;
      r[k] = out.norm();
      J.row(k) << -out.x() / r[k], -out.y() / r[k], -1.0;
    }
    if (i == 0) circle.radius = median_of_array(r);
    const Eigen::ArrayXd off = r - circle.radius;
    // The scale is that of the 20th step from there on.
    if (i < 20) cut = 4.685 * std::max(1.4826 * median_of_array(off.abs()), weights.scale_min);
    const Eigen::ArrayXd agreement = (off.abs() < cut).select((1.0 - (off / cut).square()).square(), 0.0);
    const Eigen::ArrayXd w = agreement * (off > 0.0).select(weights.outside_weight, Eigen::ArrayXd::Ones(n));
    if (i < 60) {
      const Eigen::VectorXd step =
          (w.sqrt().matrix().asDiagonal() * J).colPivHouseholderQr().solve(-(w.sqrt() * off).matrix());
      circle.centre += Vec2(step[0], step[1]);
      circle.radius += step[2];
      continue;
    }
    const double agreeing = agreement.sum();
    circle.scatter = std::sqrt((agreement * off.square()).sum() / agreeing);
    const Eigen::Vector2d mean = J.leftCols<2>().transpose() * (agreement / agreeing).matrix();
    const Eigen::MatrixXd around = J.leftCols<2>().rowwise() - mean.transpose();
    const Eigen::Matrix2d variance = around.transpose() * (agreement / agreeing).matrix().asDiagonal() * around;
    circle.spread = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(variance).eigenvalues()[0];
    const Eigen::MatrixXd influence =
        (J.transpose() * w.matrix().asDiagonal() * J).inverse() * J.transpose() * (w * off).matrix().asDiagonal();
    circle.covariance = influence * influence.transpose() * (agreeing / (agreeing - 3.0));
  }
  return circle;
}

TEST(FastCircle, rests_where_all_of_its_steps_lead) {
  Prng prng(9);
  int fitted = 0;
  for (int seed = 0; seed < 200; ++seed) {
    std::vector<Vec2> points;
    const int count = 6 + static_cast<int>(prng.uniform() * 60.0);
    const double span = prng.uniform() < 0.3 ? 2.5 : 2.0 * kPi;
    for (int i = 0; i < count; ++i) {
      const double t = span * prng.uniform();
      const double r = 15.0 + 0.02 * prng.normal() + (prng.uniform() < 0.1 ? 1.5 * prng.uniform() : 0.0);
      points.push_back(Vec2(r * std::cos(t) + 0.3, r * std::sin(t) - 0.2));
    }
    const CircleWeights weights{.scale_min = seed % 2 == 0 ? 0.02 : 0.0, .outside_weight = seed % 3 == 0 ? 1.0 : 0.1};
    const Circle fast = fit_circle_robust(points, Vec2::Zero(), weights);
    const Circle plain = circle_by_qr(points, weights);
    fitted += fast.ok ? 1 : 0;
    if (!fast.ok) continue;
    EXPECT_LT((fast.centre - plain.centre).norm(), 1e-7) << seed;
    EXPECT_NEAR(fast.radius, plain.radius, 1e-7) << seed;
    EXPECT_NEAR(fast.scatter, plain.scatter, 1e-7) << seed;
    EXPECT_NEAR(fast.spread, plain.spread, 1e-7) << seed;
    EXPECT_LT((fast.covariance - plain.covariance).norm(), 1e-5 * plain.covariance.norm()) << seed;
  }
  EXPECT_GE(fitted, 190);
}

TEST(ValueAtRank, is_what_sorting_finds) {
  Prng prng(2);
  for (const std::size_t n : {1U, 2U, 7U, 64U, 65U, 80U, 1023U, 1025U, 4096U, 8500U}) {
    for (int kind = 0; kind < 8; ++kind) {
      SCOPED_TRACE(std::to_string(n) + ' ' + std::to_string(kind));
      std::vector<double> values(n);
      for (std::size_t i = 0; i < n; ++i) {
        const double u = prng.uniform();
        const auto at = static_cast<double>(i);
        // Random, all equal, rising, few different values, sampled positions different from the rest, infinite at the
        // end, of any size and sign, zeros of both signs.
        values[i] = kind == 0   ? u
                    : kind == 1 ? 4.0
                    : kind == 2 ? at
                    : kind == 3 ? std::floor(3.0 * u)
                    : kind == 4 ? (i % (n / 32 + 1) < 2 ? 1e9 + u : u)
                    : kind == 5 ? (i + 1 == n ? std::numeric_limits<double>::infinity() : -u)
                    : kind == 6 ? (u < 0.5 ? -1.0 : 1.0) * std::exp(500.0 * std::cos(at))
                                : (u < 0.7   ? -0.0
                                   : u < 0.8 ? 0.0
                                             : -std::numeric_limits<double>::infinity());
      }
      std::vector<double> sorted = values;
      std::sort(sorted.begin(), sorted.end());
      for (const std::size_t rank : {std::size_t{0}, n / 4, n / 2, n - 1}) {
        EXPECT_EQ(value_at_rank(values, rank), sorted[rank]) << rank;
        EXPECT_EQ(
            count_at_most(values, sorted[rank]),
            static_cast<std::size_t>(std::upper_bound(sorted.begin(), sorted.end(), sorted[rank]) - sorted.begin()));
      }
    }
  }
}

}  // namespace
}  // namespace slabd::algo
