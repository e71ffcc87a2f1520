// SPDX-License-Identifier: Apache-2.0
#include "algo/denoise/denoise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "algo/block_model.h"
#include "algo/denoise/denoise_grid.h"
#include "algo/denoise/point_grid.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

struct Denoiser {
  std::vector<std::uint32_t> order;
  std::vector<std::uint8_t> keep;
  std::vector<std::uint32_t> cells = std::vector<std::uint32_t>(limits::kDenoiseCellsMax + 1);
  std::vector<TilePlane> surface = std::vector<TilePlane>(limits::kDenoiseCellsMax);
  Team team{1};
  ScanCounts counts;

  /// Returns the number of kept points.
  std::size_t run(std::vector<float>& xyz, std::size_t width = 0, std::size_t height = 0) {
    order.resize(limits::kScanPointsMax);
    keep.resize(limits::kScanPointsMax);
    Cloud cloud{xyz, xyz.size() / 3, width, height};
    EXPECT_TRUE(remove_isolated(cloud, {order, keep, cells, surface}, team, counts));
    EXPECT_EQ(cloud.points, xyz.size() / 3);
    return counts.points_kept;
  }
};

/// Flags of the remaining points, which must be unchanged and in their places.
std::vector<bool> survivors(const std::vector<float>& before, const std::vector<float>& after) {
  std::vector<bool> there(before.size() / 3);
  for (std::size_t i = 0; i < there.size(); ++i) {
    there[i] = std::memcmp(&after[3 * i], &before[3 * i], 3 * sizeof(float)) == 0 && !std::isnan(after[3 * i]);
    EXPECT_TRUE(there[i] || (std::isnan(after[3 * i]) && std::isnan(after[3 * i + 1]) && std::isnan(after[3 * i + 2])));
  }
  return there;
}

TEST(PointGrid, holds_every_point_once_and_returns_the_pitch) {
  Prng prng(4);
  for (const double pitch : {0.15, 0.4, 0.8}) {
    std::vector<float> xyz;
    for (double y = 0.0; y < 60.0; y += pitch)
      for (double x = 0.0; x < 80.0; x += pitch)
        if (prng.uniform() > 0.02)
          xyz.insert(xyz.end(), {static_cast<float>(x), static_cast<float>(y), static_cast<float>(prng.uniform())});
    for (int i = 0; i < 40; ++i) xyz.insert(xyz.end(), {-1e5F, 3e7F, 0.0F});
    const std::size_t points = xyz.size() / 3;
    std::vector<std::uint32_t> order(points);
    std::vector<std::uint32_t> start(limits::kDenoiseCellsMax + 1);
    PointGrid grid(order, start);
    grid.build(xyz.data(), points, 3.0F);
    EXPECT_NEAR(static_cast<double>(grid.pitch_mm()), pitch, 0.05 * pitch);
    std::vector<int> seen(points);
    for (int r = 0; r < grid.rows(); ++r)
      for (int c = 0; c < grid.columns(); ++c)
        for (const std::uint32_t i : grid.in_cell(grid.cell(c, r))) {
          ++seen[i];
          EXPECT_EQ(grid.column(xyz[3 * i]), c);
          EXPECT_EQ(grid.row(xyz[3 * i + 1]), r);
        }
    EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), static_cast<std::ptrdiff_t>(points));
  }
}

TEST(Denoise, accepts_absurd_coordinates_and_an_empty_cloud) {
  const float huge = std::numeric_limits<float>::max();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> xyz = {
      huge, -huge, huge, -huge, huge, 0.0F, nan, 0.0F, 0.0F, std::numeric_limits<float>::infinity(), 0.0F, 0.0F};
  Denoiser denoiser;
  EXPECT_EQ(denoiser.run(xyz), 0U);
  EXPECT_EQ(denoiser.counts.points_read, 4U);
  EXPECT_EQ(denoiser.counts.points_finite, 2U);
  std::vector<float> empty;
  EXPECT_EQ(denoiser.run(empty), 0U);
}

TEST(Denoise, is_bounded_when_everything_shouts_from_one_cell) {
  // 40 000 points above one spot, each at least a millimetre from the next: every lookup would visit all of them.
  std::vector<float> xyz;
  for (int i = 0; i < 40000; ++i) xyz.insert(xyz.end(), {0.0F, 0.0F, 2.0F * static_cast<float>(i)});
  Denoiser denoiser;
  EXPECT_EQ(denoiser.run(xyz), 0U);
}

/// A plane tilted by `tilt_deg`, as long as an end face, scanned from above at `pitch`.
std::vector<float> tilted(double tilt_deg, double pitch, std::uint64_t seed) {
  Prng prng(seed);
  std::vector<float> xyz;
  for (double y = 0.0; y < 240.0; y += pitch) {
    for (double x = 0.0; x < 10.0; x += pitch) {
      const double z = x * std::tan(rad_from_deg(tilt_deg)) + 0.03 * prng.normal();
      if (prng.uniform() > 0.02)
        xyz.insert(xyz.end(), {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
    }
  }
  return xyz;
}

/// Clouds in which every point would be tested separately. Limited by counted work, the same on every computer.
TEST(Denoise, cancels_for_clouds_in_which_hardly_any_point_is_on_a_surface) {
  constexpr std::size_t kPoints = 5'900'000;
  Prng prng(3);
  const auto in = [&prng](double low, double high) { return static_cast<float>(low + (high - low) * prng.uniform()); };
  const auto points = [&](const auto& point) {
    std::vector<float> xyz;
    xyz.reserve(3 * kPoints);
    for (std::size_t i = 0; i < kPoints; ++i)
      for (const float c : std::array<float, 3>(point(i))) xyz.push_back(c);
    return xyz;
  };
  using P = std::array<float, 3>;
  Denoiser denoiser;
  denoiser.order.resize(limits::kScanPointsMax);
  denoiser.keep.resize(limits::kScanPointsMax);
  const auto expect_given_up = [&](const char* name, const std::vector<float>& cloud) {
    std::vector<float> xyz = cloud;
    Cloud view{xyz, kPoints, 0, 0};
    EXPECT_FALSE(remove_isolated(view, {denoiser.order, denoiser.keep, denoiser.cells, denoiser.surface}, denoiser.team,
                                 denoiser.counts))
        << name;
    EXPECT_EQ(std::memcmp(xyz.data(), cloud.data(), xyz.size() * sizeof(float)), 0) << name;
  };
  expect_given_up("fog", points([&](std::size_t) { return P{in(-150, 150), in(-200, 200), in(500, 700)}; }));
  expect_given_up("fog in a small box", points([&](std::size_t) { return P{in(-10, 10), in(-10, 10), in(590, 610)}; }));
  expect_given_up("all points equal", points([](std::size_t) { return P{1.0F, 2.0F, 600.0F}; }));
  expect_given_up("a line", points([&](std::size_t) { return P{in(-200, 200), 0.0F, 600.0F}; }));
  expect_given_up("two clumps", points([&](std::size_t i) {
                    return P{(i % 2 == 0 ? -1e5F : 1e5F) + in(-1, 1), in(-1, 1), in(599, 601)};
                  }));
  expect_given_up("huge extents", points([&](std::size_t) { return P{in(-1e6, 1e6), in(-1e6, 1e6), in(0, 1e6)}; }));
}

TEST(Denoise, ends_soon_when_its_caller_cancels) {
  std::vector<float> xyz;
  Prng prng(5);
  for (int i = 0; i < 60'000; ++i)
    for (int c = 0; c < 3; ++c) xyz.push_back(static_cast<float>(100.0 * prng.uniform()));
  Denoiser denoiser;
  denoiser.order.resize(limits::kScanPointsMax);
  denoiser.keep.resize(limits::kScanPointsMax);
  std::atomic<bool> give_up{true};
  Cloud view{xyz, xyz.size() / 3, 0, 0};
  EXPECT_FALSE(remove_isolated(view, {denoiser.order, denoiser.keep, denoiser.cells, denoiser.surface, &give_up},
                               denoiser.team, denoiser.counts));
  give_up = false;
  EXPECT_TRUE(remove_isolated(view, {denoiser.order, denoiser.keep, denoiser.cells, denoiser.surface, &give_up},
                              denoiser.team, denoiser.counts));
}

TEST(Denoise, loses_almost_no_surface_point_at_any_pitch_and_slope) {
  for (const double pitch : {0.17, 0.255, 0.42, 0.8}) {
    for (const double tilt : {0.0, 45.0, 70.0, 80.0}) {
      std::vector<float> xyz = tilted(tilt, pitch, 11);
      const std::size_t before = xyz.size() / 3;
      const std::size_t kept = Denoiser().run(xyz);
      EXPECT_GT(static_cast<double>(kept), 0.998 * static_cast<double>(before)) << pitch << " mm, " << tilt << " deg";
    }
  }
}

/// True if the model's surface comes within a millimetre of `p` (block frame), by brute force.
bool within_a_millimetre(const BlockModel& model, const Vec3& p) {
  for (double dx = -1.0; dx <= 1.0; dx += 0.1) {
    for (double dy = -1.0; dy <= 1.0; dy += 0.1) {
      Face face = Face::seat;
      double z = 0.0;
      if (model.visible(p.x() + dx, p.y() + dy, face, z) && dx * dx + dy * dy + (p.z() - z) * (p.z() - z) < 1.0)
        return true;
    }
  }
  return false;
}

/// Shares of a scan, in per cent.
struct Quality {
  double outliers_left = 0.0;
  double level_lost = 0.0;  ///< faces at less than 60 degrees to the ray
  double steep_lost = 0.0;  ///< up to 83; steeper faces are not visible to a scanner
};

Quality quality(scene::Scan scan) {
  scan.incidence = true;
  BlockModel model;
  model.build(scene::p5600().block);
  const scene::Cloud cloud = scene::take({}, scan);
  std::vector<float> xyz = cloud.xyz;
  const std::size_t kept = Denoiser().run(xyz, cloud.width, cloud.height);
  const std::vector<bool> there = survivors(cloud.xyz, xyz);
  EXPECT_EQ(static_cast<std::size_t>(std::count(there.begin(), there.end(), true)), kept);
  std::array<double, 3> all{};
  std::array<double, 3> left{};
  for (std::size_t i = 0; i < there.size(); ++i) {
    const float* f = &cloud.xyz[3 * i];
    if (std::isnan(f[0])) continue;
    std::size_t kind = cloud.incidence_deg[i] < 60.0F ? 1 : 2;
    if (cloud.outlier[i]) {
      const Vec3 p(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
      if (within_a_millimetre(model, cloud.T_block_scanner * p)) continue;
      kind = 0;
    } else if (cloud.incidence_deg[i] > 83.0F) {
      continue;
    }
    all[kind] += 1.0;
    left[kind] += there[i] ? 1.0 : 0.0;
  }
  const auto percent = [](double part, double whole) { return whole > 0.0 ? 100.0 * part / whole : 0.0; };
  return {percent(left[0], all[0]), percent(all[1] - left[1], all[1]), percent(all[2] - left[2], all[2])};
}

TEST(Denoise, removes_outliers_and_keeps_the_surface_whatever_the_pitch_and_the_view) {
  struct Case {
    double pitch, ratio, focus, far, share;
    int clump;
    bool organised;
  };
  for (const Case& c : {Case{0.3, 1.0, 0.0, 60.0, 0.005, 1, true}, Case{0.3, 1.0, 0.0, 5.0, 0.01, 1, false},
                        Case{0.35, 1.0, 600.0, 5.0, 0.01, 5, false}, Case{0.3, 2.0, 0.0, 5.0, 0.01, 1, false},
                        Case{0.35, 1.0, 600.0, 5.0, 0.01, 5, true}, Case{0.3, 1.0, 600.0, 5.0, 0.01, 1, true},
                        Case{0.6, 1.0, 600.0, 60.0, 0.02, 1, true}}) {
    scene::Scan scan;
    scan.pitch_mm = c.pitch;
    scan.pitch_ratio = c.ratio;
    scan.focus_mm = c.focus;
    scan.outlier_far_mm = c.far;
    scan.outlier_share = c.share;
    scan.outlier_clump = c.clump;
    scan.organised = c.organised;
    scan.tail_share = 0.05;
    scan.displacement = scene::displaced(3.0, -5.0, 0.0, c.focus > 0.0 ? 5.0 : 0.0, 0.0, 1.0);
    const Quality q = quality(scan);
    EXPECT_LE(q.outliers_left, 0.1) << c.pitch << " mm, focus " << c.focus << ", far " << c.far;
    EXPECT_LE(q.level_lost, 0.02) << c.pitch << " mm, focus " << c.focus << ", far " << c.far;
    EXPECT_LE(q.steep_lost, 0.3) << c.pitch << " mm, focus " << c.focus << ", far " << c.far;
  }
}

using Points = std::vector<std::array<float, 3>>;

Points shuffled(Points points, std::uint64_t seed) {
  Prng prng(seed);
  for (std::size_t i = points.size(); i > 1; --i) std::swap(points[i - 1], points[prng.below(i)]);
  return points;
}

/// Kept points, in a defined order.
Points kept_of(const Points& points) {
  std::vector<float> xyz;
  for (const std::array<float, 3>& p : points) xyz.insert(xyz.end(), p.begin(), p.end());
  const std::size_t kept = Denoiser().run(xyz);
  Points left;
  for (std::size_t i = 0; i < xyz.size() / 3; ++i)
    if (!std::isnan(xyz[3 * i])) left.push_back({xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]});
  EXPECT_EQ(left.size(), kept);
  std::sort(left.begin(), left.end());
  return left;
}

TEST(Denoise, keeps_the_same_points_in_whatever_order_they_come) {
  scene::Scan scan;
  scan.pitch_mm = 0.7;
  scan.outlier_share = 0.05;
  scan.outlier_far_mm = 5.0;
  const scene::Cloud cloud = scene::take({}, scan);
  Points points;
  for (std::size_t i = 0; i + 2 < cloud.xyz.size(); i += 3)
    points.push_back({cloud.xyz[i], cloud.xyz[i + 1], cloud.xyz[i + 2]});
  EXPECT_TRUE(kept_of(points) == kept_of(shuffled(points, 3)));
}

TEST(Denoise, keeps_the_same_points_in_whatever_order_they_come_where_the_scanner_lingered) {
  // A step and a slope meet. In a patch the density is ten and forty times higher, and a clump of noise is too large to
  // be followed at once.
  for (const int times : {10, 40}) {
    Prng prng(7);
    Points points;
    const auto surface = [](double x, double y) {
      return (x > 50.0 ? 30.0 : 0.0) + (y > 50.0 ? 2.0 * (y - 50.0) : 0.0);
    };
    const auto put = [&](double x, double y, double z) {
      points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
    };
    const auto lay = [&](int count, double x0, double size_mm, double off_mm) {
      for (int i = 0; i < count; ++i) {
        const double x = x0 + size_mm * prng.uniform();
        const double y = x0 + size_mm * prng.uniform();
        put(x, y, surface(x, y) + 0.03 * prng.normal() + off_mm * (prng.uniform() - 0.5));
      }
    };
    lay(40'000, 0.0, 100.0, 0.0);
    lay(4 * times * 100, 45.0, 10.0, 0.0);
    lay(2'000, 0.0, 100.0, 6.0);
    lay(3'000, 20.0, 4.0, 40.0);
    const Points kept = kept_of(points);
    EXPECT_LT(kept.size(), points.size() - 1'000);
    EXPECT_TRUE(kept == kept_of(shuffled(points, 3))) << times;
    std::sort(points.begin(), points.end());
    EXPECT_TRUE(kept == kept_of(points)) << times;
  }
}

TEST(Denoise, gives_a_scan_its_grid_back_only_if_its_rays_are_evenly_spaced) {
  for (const double focus : {0.0, 600.0}) {
    scene::Scan scan;
    scan.pitch_mm = 0.5;
    scan.focus_mm = focus;
    scan.outlier_share = 0.005;
    scan.displacement = scene::displaced(2.0, -3.0, 0.0, 2.0, -1.0, 2.0);
    const scene::Cloud cloud = scene::take({}, scan);
    scan.organised = true;
    const scene::Cloud organised = scene::take({}, scan);
    Denoiser denoiser;
    denoiser.order.resize(limits::kScanPointsMax);
    denoiser.keep.resize(limits::kScanPointsMax);
    const DenoiseWorkspace work{denoiser.order, denoiser.keep, denoiser.cells, denoiser.surface};

    std::vector<float> xyz = cloud.xyz;
    Cloud view{xyz, xyz.size() / 3, 0, 0};
    ASSERT_TRUE(denoise_lattice(view, work, denoiser.team, denoiser.counts)) << focus;
    const std::vector<bool> there = survivors(cloud.xyz, xyz);
    EXPECT_EQ(static_cast<std::uint64_t>(std::count(there.begin(), there.end(), true)), denoiser.counts.points_kept);
    EXPECT_EQ(denoiser.counts.points_finite, there.size());

    // Two threads and every instruction set keep the same points. The scan's own grid, whose tiles are elsewhere, keeps
    // almost the same.
    Team team{2};
    for (const InstructionSet set :
         {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2, InstructionSet::best}) {
      if (!limit_instruction_set(set)) continue;
      std::vector<float> by_two = cloud.xyz;
      Cloud two{by_two, by_two.size() / 3, 0, 0};
      EXPECT_TRUE(denoise_lattice(two, work, team, denoiser.counts));
      EXPECT_EQ(std::memcmp(by_two.data(), xyz.data(), xyz.size() * sizeof(float)), 0);
    }
    ASSERT_TRUE(limit_instruction_set(InstructionSet::best));
    std::vector<float> gridded = organised.xyz;
    denoiser.run(gridded, organised.width, organised.height);
    std::size_t other = 0;
    std::size_t k = 0;
    for (std::size_t i = 0; i < organised.xyz.size() / 3; ++i) {
      if (std::isnan(organised.xyz[3 * i])) continue;
      other += std::isnan(gridded[3 * i]) == there[k++] ? 1U : 0U;
    }
    ASSERT_EQ(k, there.size());
    EXPECT_LE(static_cast<double>(other), 1e-4 * static_cast<double>(k)) << focus;

    // Points that meet another in their cell are judged too: the same scan twice, the second one slightly higher.
    std::vector<float> twice = cloud.xyz;
    for (std::size_t i = 0; i < 300; ++i)
      twice.insert(twice.end(), {cloud.xyz[9 * i], cloud.xyz[9 * i + 1], cloud.xyz[9 * i + 2] + 30.0F});
    std::vector<float> judged = twice;
    Cloud doubled{judged, judged.size() / 3, 0, 0};
    if (focus == 0.0) {
      ASSERT_TRUE(denoise_lattice(doubled, work, denoiser.team, denoiser.counts));
      for (std::size_t i = cloud.xyz.size() / 3; i < judged.size() / 3; ++i) EXPECT_TRUE(std::isnan(judged[3 * i]));
    }

    // Random rays have no columns; the scan stays unchanged.
    Prng prng(8);
    std::vector<float> anywhere = cloud.xyz;
    for (std::size_t i = 0; i < anywhere.size(); i += 3) {
      anywhere[i] += static_cast<float>(prng.uniform() - 0.5);
      anywhere[i + 1] += static_cast<float>(prng.uniform() - 0.5);
    }
    std::vector<float> left = anywhere;
    Cloud none{left, left.size() / 3, 0, 0};
    EXPECT_FALSE(denoise_lattice(none, work, denoiser.team, denoiser.counts));
    EXPECT_EQ(std::memcmp(left.data(), anywhere.data(), left.size() * sizeof(float)), 0);
  }
}

/// Share lost, in per cent, of discs `up_mm` above the seat every 12 mm, scanned at 0.255 mm with noise, outliers and
/// missing points.
double discs_lost(double diameter_mm, double up_mm) {
  scene::Scan scan;
  scan.pitch_mm = 0.255;
  scan.field_y_mm = 180.0;
  scan.organised = true;
  scan.tail_share = 0.05;
  scan.displacement = scene::displaced(2.0, -3.0, 0.0, 0.5, 0.3, 0.5);
  scene::Cloud cloud = scene::take({}, scan);
  std::vector<std::size_t> disc;
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    float* f = &cloud.xyz[3 * i];
    if (std::isnan(f[0]) || cloud.outlier[i]) continue;
    const Vec3 p =
        cloud.T_block_scanner * Vec3(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
    if (std::abs(p.x()) > 48.0 || std::abs(p.y()) > 70.0) continue;
    if (2.0 * std::hypot(std::remainder(p.x(), 12.0), std::remainder(p.y(), 12.0)) > diameter_mm) continue;
    f[2] -= static_cast<float>(up_mm);
    disc.push_back(i);
  }
  std::vector<float> xyz = cloud.xyz;
  Denoiser().run(xyz, cloud.width, cloud.height);
  const auto lost = std::count_if(disc.begin(), disc.end(), [&](std::size_t i) { return std::isnan(xyz[3 * i]); });
  return 100.0 * static_cast<double>(lost) / static_cast<double>(disc.size());
}

TEST(Denoise, keeps_a_chip_and_a_bump_of_two_millimetres) {
  // Removed points of a defect would hide it.
  for (const double up : {-2.0, -1.0, 1.0, 3.0}) {
    EXPECT_LE(discs_lost(2.0, up), 3.0) << up << " mm";
    EXPECT_LE(discs_lost(3.0, up), 1.0) << up << " mm";
  }
}

/// Remaining shares of a scan, in per cent: of outliers, and of strips on the seat every 9 mm.
struct Left {
  double outliers = 0.0;
  double strips = 0.0;
};

/// Merges `views` scans from one position.
scene::Cloud take_all(const scene::Block& block, scene::Scan scan, int views) {
  scene::Cloud all = scene::take(block, scan);
  while (--views > 0) {
    ++scan.seed;
    const scene::Cloud one = scene::take(block, scan);
    all.xyz.insert(all.xyz.end(), one.xyz.begin(), one.xyz.end());
    all.outlier.insert(all.outlier.end(), one.outlier.begin(), one.outlier.end());
    all.width = all.height = 0;
  }
  return all;
}

/// Slanted strips `wide_mm` across and `half_mm` long to either side, `up_mm(x, s)` above the seat.
template <typename Up>
Left left_of(const scene::Scan& scan, double wide_mm, const Up& up_mm, double jitter_mm, int views, double half_mm) {
  scene::Block block;
  const auto on_strip = [&](double x, double s) {
    return std::abs(std::remainder(x - 0.3 * s, 9.0)) < 0.5 * wide_mm &&
           std::abs(std::remainder(s, 2.4 * half_mm)) < half_mm;
  };
  if (wide_mm > 0.0) block.relief_mm = [&](double x, double s) { return on_strip(x, s) ? up_mm(x, s) : 0.0; };
  scene::Cloud cloud = take_all(block, scan, views);
  Prng prng(17);
  std::vector<std::size_t> strip;
  std::vector<std::size_t> outliers;
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    float* f = &cloud.xyz[3 * i];
    if (std::isnan(f[0])) continue;
    const Vec3 p =
        cloud.T_block_scanner * Vec3(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
    const double s = p.y() * std::cos(std::atan(0.025)) + p.z() * std::sin(std::atan(0.025));
    if (cloud.outlier[i])
      outliers.push_back(i);
    else if (std::abs(p.x()) < 48.0 && std::abs(s) < 70.0 && on_strip(p.x(), s))
      strip.push_back(i);
    f[0] += static_cast<float>(jitter_mm * (prng.uniform() - 0.5));
    f[1] += static_cast<float>(jitter_mm * (prng.uniform() - 0.5));
  }
  std::vector<float> xyz = cloud.xyz;
  Denoiser().run(xyz, cloud.width, cloud.height);
  const auto share = [&](const std::vector<std::size_t>& points) {
    const auto left =
        std::count_if(points.begin(), points.end(), [&](std::size_t i) { return !std::isnan(xyz[3 * i]); });
    return points.empty() ? 0.0 : 100.0 * static_cast<double>(left) / static_cast<double>(points.size());
  };
  return {share(outliers), share(strip)};
}

Left left_of(const scene::Scan& scan, double wide_mm, double up_mm, double jitter_mm = 0.0, int views = 1) {
  return left_of(
      scan, wide_mm, [&](double, double) { return up_mm; }, jitter_mm, views, 15.0);
}

TEST(Denoise, keeps_connected_points_however_narrow) {
  // One line of the scan wide, in places two, or two, in places three; also without a grid and without a lattice.
  struct View {
    double pitch;
    bool organised;
    double jitter;  ///< pitches
  };
  for (const View& view :
       {View{0.2, true, 0.0}, View{0.41, true, 0.0}, View{0.35, false, 0.0}, View{0.35, false, 0.5}}) {
    for (const double lines : {1.1, 1.6, 2.2}) {
      for (const double up : {-3.0, 2.0, 15.0}) {
        scene::Scan scan;
        scan.field_x_mm = 120.0;
        scan.field_y_mm = 180.0;
        scan.pitch_mm = view.pitch;
        scan.organised = view.organised;
        scan.tail_share = 0.02;
        // A part of a single line cut off by a missing point may be too short.
        EXPECT_GE(left_of(scan, lines * view.pitch, up, view.jitter * view.pitch).strips, lines < 1.5 ? 75.0 : 96.0)
            << view.pitch << " mm, " << lines << " lines, " << up << " mm up, jitter " << view.jitter << ", organised "
            << view.organised;
      }
    }
  }
}

TEST(Denoise, keeps_connected_points_over_a_length_however_steep_or_ragged) {
  // A leaning wire, half as steep as a fin's back, and a torn edge with another height every quarter of a millimetre:
  // no two neighbours are at the same height.
  const auto leaning = [](double, double s) { return 1.0 + 1.6 * std::abs(std::remainder(s, 72.0)); };
  const auto ragged = [](double x, double s) {
    const double t = 43758.5453 * std::sin(12.9898 * std::floor(4.0 * s) + 78.233 * std::floor(4.0 * x));
    return 2.0 + 3.0 * (t - std::floor(t));
  };
  for (const auto& [organised, jitter] : {std::pair{true, 0.0}, {false, 0.0}, {false, 0.5}}) {
    for (const double lines : {1.1, 1.6}) {
      SCOPED_TRACE(testing::Message() << lines << " lines, organised " << organised << ", jitter " << jitter);
      scene::Scan scan;
      scan.field_x_mm = 120.0;
      scan.field_y_mm = 180.0;
      scan.pitch_mm = 0.3;
      scan.organised = organised;
      // A part of a single line cut off by a missing point may be too short.
      const double least = lines < 1.5 ? 75.0 : 90.0;
      EXPECT_GE(left_of(scan, lines * scan.pitch_mm, leaning, jitter * scan.pitch_mm, 1, 30.0).strips, least);
      EXPECT_GE(left_of(scan, lines * scan.pitch_mm, ragged, jitter * scan.pitch_mm, 1, 30.0).strips, least);
    }
  }
}

TEST(Denoise, keeps_connected_points_of_any_number_of_views) {
  // Views from one position have the same rays, each with a point of every view. A line of the scan has gaps as wide as
  // in a single view, although there are several times as many points.
  for (const double focus : {0.0, 600.0}) {
    for (const int views : {2, 4, 6}) {
      scene::Scan scan;
      scan.field_x_mm = 120.0;
      scan.field_y_mm = 180.0;
      scan.pitch_mm = 0.35;
      scan.pitch_ratio = 1.2;
      scan.focus_mm = focus;
      const Left left = left_of(scan, 1.1 * scan.pitch_mm, 3.0, 0.0, views);
      EXPECT_GE(left.strips, 96.0) << views << " views, focus " << focus;
      EXPECT_LE(left.outliers, 0.4) << views << " views, focus " << focus;
    }
  }
}

TEST(Denoise, removes_outliers_however_many_touch) {
  // Single ones and clumps in a row of the grid; the nearer they are, the more are at one height by chance. About half
  // of the remaining ones are on a surface: nearly as many remained when connected noise was not kept.
  struct Case {
    double share, far;
    int clump;
    bool organised;
    double jitter;  ///< pitches
    double left;
  };
  for (const Case& c :
       {Case{0.01, 60.0, 1, true, 0.0, 0.03}, Case{0.03, 5.0, 1, true, 0.0, 0.03}, Case{0.1, 5.0, 1, true, 0.0, 0.03},
        Case{0.003, 5.0, 6, true, 0.0, 0.2}, Case{0.03, 5.0, 6, true, 0.0, 0.5}, Case{0.03, 60.0, 6, true, 0.0, 0.03},
        Case{0.03, 5.0, 6, false, 0.0, 0.5}, Case{0.1, 5.0, 1, false, 0.5, 0.03}, Case{0.03, 5.0, 6, false, 0.5, 0.5},
        Case{0.1, 60.0, 6, true, 0.0, 0.2}, Case{0.03, 60.0, 6, false, 0.5, 0.2}}) {
    scene::Scan scan;
    scan.field_x_mm = 160.0;
    scan.field_y_mm = 300.0;
    scan.pitch_mm = 0.3;
    scan.organised = c.organised;
    scan.outlier_share = c.share;
    scan.outlier_far_mm = c.far;
    scan.outlier_clump = c.clump;
    EXPECT_LE(left_of(scan, 0.0, 0.0, c.jitter * scan.pitch_mm).outliers, c.left)
        << c.share << " up to " << c.far << " mm, clumps of " << c.clump << ", jitter " << c.jitter << ", organised "
        << c.organised;
  }
}

/// Remaining points of a cloud, bit by bit, and its final shape.
struct Outcome {
  std::vector<float> xyz;
  std::size_t points = 0, width = 0, height = 0;
  std::uint64_t points_kept = 0;
};

Outcome outcome_of(std::vector<float> xyz, std::size_t width, std::size_t height, int threads = 1) {
  Denoiser denoiser;
  denoiser.order.resize(limits::kScanPointsMax);
  denoiser.keep.resize(limits::kScanPointsMax);
  Team team{threads};
  const std::size_t points = xyz.size() / 3;
  xyz.resize(xyz.size() + xyz.size() / 2, 0.0F);  // capacity for the recovered grid
  Cloud cloud{xyz, points, width, height};
  EXPECT_TRUE(
      remove_isolated(cloud, {denoiser.order, denoiser.keep, denoiser.cells, denoiser.surface}, team, denoiser.counts));
  xyz.resize(3 * cloud.points);
  return {std::move(xyz), cloud.points, cloud.width, cloud.height, denoiser.counts.points_kept};
}

void expect_same(const Outcome& a, const Outcome& b, const char* what) {
  ASSERT_EQ(a.points, b.points) << what;
  EXPECT_EQ(a.width, b.width) << what;
  EXPECT_EQ(a.height, b.height) << what;
  EXPECT_EQ(a.points_kept, b.points_kept) << what;
  EXPECT_EQ(std::memcmp(a.xyz.data(), b.xyz.data(), a.xyz.size() * sizeof(float)), 0) << what;
}

TEST(Denoise, rejects_a_wrong_shape_from_the_header) {
  // A fin one column wide on the seat. With wrong neighbours from the header, the fin was isolated in its rows and was
  // removed as noise, while all planes of the level seat were accepted.
  for (const double focus : {0.0, 600.0}) {
    scene::Scan scan;
    scan.field_x_mm = 160.0;
    scan.field_y_mm = 180.0;
    scan.pitch_mm = 0.4;
    scan.focus_mm = focus;
    scan.organised = true;
    const scene::Cloud cloud = scene::take({}, scan);
    const std::size_t w = cloud.width;
    const std::size_t h = w - 2;  // nearly square: if exchanged, rows are shifted by two points each
    ASSERT_GT(cloud.height, h);
    const std::size_t first_row = (cloud.height - h) / 2;
    std::vector<float> good(cloud.xyz.begin() + static_cast<std::ptrdiff_t>(3 * first_row * w),
                            cloud.xyz.begin() + static_cast<std::ptrdiff_t>(3 * (first_row + h) * w));
    std::size_t fin = 0;
    for (std::size_t r = h / 2 - 40; r < h / 2 + 40; ++r) {
      float& z = good[3 * (r * w + w / 2) + 2];
      z -= 3.0F;
      fin += std::isnan(z) ? 0U : 1U;
    }
    const auto at = [&](std::size_t i) { return &good[3 * i]; };
    // The points in another order, with the same shape.
    const auto reordered = [&](auto&& from) {
      std::vector<float> xyz;
      for (std::size_t i = 0; i < w * h; ++i) xyz.insert(xyz.end(), at(from(i)), at(from(i)) + 3);
      return xyz;
    };
    std::vector<std::size_t> rows(h);
    for (std::size_t r = 0; r < h; ++r) rows[r] = r;
    Prng prng(5);
    for (std::size_t r = h; r > 1; --r) std::swap(rows[r - 1], rows[prng.below(r)]);
    std::vector<std::size_t> turn(h);
    for (std::size_t& t : turn) t = prng.below(w);
    struct Lie {
      const char* what;
      std::vector<float> xyz;
      std::size_t width, height;
    };
    const std::vector<Lie> lies = {
        {"width and height exchanged", good, h, w},
        {"half as wide, twice as high", good, w / 2, 2 * h},
        {"column by column", reordered([&](std::size_t i) { return i % h * w + i / h; }), w, h},
        {"every second row backwards",
         reordered([&](std::size_t i) { return i / w % 2 == 0 ? i : i / w * w + (w - 1 - i % w); }), w, h},
        {"each row begins elsewhere", reordered([&](std::size_t i) { return i / w * w + (i + turn[i / w]) % w; }), w,
         h},
        {"rows in any order", reordered([&](std::size_t i) { return rows[i / w] * w + i % w; }), w, h}};
    for (const Lie& lie : lies) {
      const Outcome list = outcome_of(lie.xyz, 0, 0);
      expect_same(outcome_of(lie.xyz, lie.width, lie.height), list, lie.what);
      expect_same(outcome_of(lie.xyz, lie.width, lie.height, 2), list, lie.what);
      std::size_t left = 0;
      for (std::size_t r = h / 2 - 40; r < h / 2 + 40; ++r) {
        const float* p = at(r * w + w / 2);
        for (std::size_t i = 0; i < list.points; ++i)
          left += std::memcmp(&list.xyz[3 * i], p, 3 * sizeof(float)) == 0 && !std::isnan(p[2]) ? 1U : 0U;
      }
      EXPECT_GE(static_cast<double>(left), 0.9 * static_cast<double>(fin)) << lie.what << ", focus " << focus;
    }
  }
}

TEST(Denoise, accepts_the_shape_of_every_good_scan) {
  struct View {
    double pitch, ratio, focus, missing, field_x, tilt_deg, roll_deg;
  };
  for (const View& view : {View{0.3, 1.0, 0.0, 0.02, 160.0, 0.0, 0.0}, View{0.3, 1.2, 600.0, 0.02, 160.0, 15.0, 45.0},
                           View{0.3, 1.0, 300.0, 0.02, 160.0, 30.0, 0.0}, View{0.3, 1.0, 600.0, 0.6, 160.0, 3.0, 10.0},
                           View{0.3, 1.0, 600.0, 0.02, 20.0, 3.0, 0.0}, View{0.1, 10.0, 0.0, 0.02, 60.0, 0.0, 3.0},
                           View{0.8, 1.0, 600.0, 0.02, 200.0, 5.0, 0.0}}) {
    scene::Scan scan;
    scan.pitch_mm = view.pitch;
    scan.pitch_ratio = view.ratio;
    scan.focus_mm = view.focus;
    scan.missing_share = view.missing;
    scan.field_x_mm = view.field_x;
    scan.field_y_mm = 180.0;
    scan.organised = true;
    scan.outlier_share = 0.02;
    scan.displacement = scene::displaced(2.0, -3.0, 0.0, view.tilt_deg, -0.5 * view.tilt_deg, view.roll_deg);
    scene::Cloud cloud = scene::take({}, scan);
    Denoiser denoiser;
    denoiser.keep.resize(limits::kScanPointsMax);
    algo::Cloud organised = cloud.view();
    organised.width = cloud.width;
    organised.height = cloud.height;
    const std::string what = std::to_string(view.pitch) + " mm, focus " + std::to_string(view.focus) + ", missing " +
                             std::to_string(view.missing) + ", tilt " + std::to_string(view.tilt_deg);
    EXPECT_TRUE(denoise_grid(organised, {denoiser.order, denoiser.keep, denoiser.cells, denoiser.surface},
                             denoiser.team, denoiser.counts))
        << what;
    EXPECT_EQ(organised.width, cloud.width) << what;
  }
}

/// A level sheet of 60 x 60 mm with `extra` points on top.
std::vector<float> sheet_with(const std::vector<std::array<float, 3>>& extra, float pitch) {
  std::vector<float> xyz;
  for (float y = 0.0F; y < 60.0F; y += pitch)
    for (float x = 0.0F; x < 60.0F; x += pitch) xyz.insert(xyz.end(), {x, y, 0.0F});
  for (const auto& p : extra) xyz.insert(xyz.end(), p.begin(), p.end());
  return xyz;
}

TEST(Denoise, removes_a_clump_of_five_and_keeps_an_object) {
  for (const float pitch : {0.2F, 0.4F, 0.8F}) {
    std::vector<std::array<float, 3>> clump;
    for (const auto& [x, y] : {std::array{0.0F, 0.0F}, std::array{1.0F, 0.0F}, std::array{-1.0F, 0.0F},
                               std::array{0.0F, 1.0F}, std::array{0.0F, -1.0F}})
      clump.push_back({30.0F + pitch * x, 30.0F + pitch * y, 2.0F});
    std::vector<float> xyz = sheet_with(clump, pitch);
    const std::size_t sheet = xyz.size() / 3 - clump.size();
    EXPECT_EQ(Denoiser().run(xyz), sheet) << pitch;

    // A rod about twelve pitches across, like a glove or a cable.
    std::vector<float> with_rod;
    std::size_t rod = 0;
    for (float y = 0.0F; y < 60.0F; y += pitch) {
      for (float x = 0.0F; x < 60.0F; x += pitch) {
        const bool on_rod = std::abs(x - 30.0F) < 6.0F * pitch;
        rod += on_rod ? 1U : 0U;
        with_rod.insert(with_rod.end(), {x, y, on_rod ? 20.0F : 0.0F});
      }
    }
    const std::size_t before = with_rod.size() / 3;
    EXPECT_GE(Denoiser().run(with_rod) + rod / 100, before) << pitch;
  }
}

}  // namespace
}  // namespace slabd::algo
