// SPDX-License-Identifier: Apache-2.0
//
// The loops of the plane fits against plain ones, on full samples and on difficult ones, with the same bits for every
// instruction set.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "algo/algo.h"
#include "algo/features/plane_fit.h"
#include "algo/features/plane_kernels.h"
#include "algo/features/plane_steps.h"
#include "algo/features/plane_zone.h"

namespace slabd::algo {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr InstructionSet kSets[] = {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2,
                                    InstructionSet::avx512, InstructionSet::best};

const FlatPlane kPlane = {Vec3(0.01, -0.02, 1.0).normalized(), 12.5};

/// Points about kPlane, far and near; `nasty`: some are not finite or absurdly far.
std::unique_ptr<PlaneSample> sample_of(std::size_t count, bool nasty) {
  auto sample = std::make_unique<PlaneSample>();
  // Memory after the points must not matter.
  sample->x.fill(1.0);
  sample->y.fill(1.0);
  sample->z.fill(12.5);
  Prng prng(count + (nasty ? 7 : 0));
  for (std::size_t i = 0; i < count; ++i) {
    Vec3 p(100.0 * prng.uniform() - 50.0, 150.0 * prng.uniform() - 75.0, 0.0);
    const double off = prng.uniform() < 0.2 ? 10.0 * prng.normal() : 0.03 * prng.normal();
    p.z() = (kPlane.d + off - kPlane.n.x() * p.x() - kPlane.n.y() * p.y()) / kPlane.n.z();
    const std::size_t kind = nasty ? i % 7 : 6;
    if (kind == 0) p.x() = std::numeric_limits<double>::quiet_NaN();
    if (kind == 1) p.z() = kInf;
    if (kind == 2) p.y() = -kInf;
    if (kind == 3) p *= 1e160;
    sample->add(p);
  }
  sample->close();
  return sample;
}

/// No points, fewer than sixteen, odd numbers, a full sample.
const std::vector<std::size_t> kCounts = {0, 1, 15, 16, 17, 255, 256, 257, 1000, 1024, limits::kPlaneSampleMax};

template <typename Check>
void for_each_sample(const Check& check) {
  for (const std::size_t count : kCounts) {
    for (const bool nasty : {false, true}) {
      SCOPED_TRACE(std::to_string(count) + (nasty ? " nasty" : ""));
      check(*sample_of(count, nasty));
    }
  }
}

double plain_truncated(const SamplePoints& points, double threshold) {
  double sum = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double r = kPlane.distance(points[i]);
    sum += r * r < threshold * threshold ? r * r : threshold * threshold;
  }
  return sum;
}

TEST(PlaneKernels, truncated_squares_are_those_of_a_plain_loop) {
  for_each_sample([](const PlaneSample& sample) {
    const double threshold = 0.09;
    ScaledSums never;
    never.fill(kInf);
    const ScaledSums scaled = truncated_squares(sample.all(), kPlane, threshold, never);
    for (std::size_t k = 0; k < kScales; ++k) {
      const double t = threshold / static_cast<double>(1U << k);
      const double plain = plain_truncated(sample.all(), t);
      EXPECT_NEAR(truncated_squares(sample.all(), kPlane, t, kInf), plain, 1e-12 * plain);
      EXPECT_NEAR(scaled[k], plain, 1e-12 * plain);
    }
    const double of_scouts = plain_truncated(sample.preview(), threshold);
    EXPECT_NEAR(truncated_squares(sample.preview(), kPlane, threshold, kInf), of_scouts, 1e-12 * of_scouts);
  });
}

TEST(PlaneKernels, truncated_squares_that_stop_early_have_lost) {
  const auto sample = sample_of(limits::kPlaneSampleMax, false);
  for (const double share : {0.01, 0.5, 0.999, 1.001}) {
    const double whole = plain_truncated(sample->all(), 0.09);
    const double sum = truncated_squares(sample->all(), kPlane, 0.09, share * whole);
    EXPECT_EQ(share < 1.0, sum >= share * whole);
    // One scale that can still win keeps all of them running.
    ScaledSums stop;
    for (std::size_t k = 0; k < kScales; ++k)
      stop[k] = (k == 1 ? share : 0.01) * plain_truncated(sample->all(), 0.09 / static_cast<double>(1U << k));
    const ScaledSums sums = truncated_squares(sample->all(), kPlane, 0.09, stop);
    EXPECT_EQ(share < 1.0, sums[1] >= stop[1]);
  }
}

TEST(PlaneKernels, counts_are_those_of_a_plain_loop) {
  for_each_sample([](const PlaneSample& sample) {
    const SamplePoints points = sample.all();
    // Also with the exact distance of a point.
    std::vector<double> thresholds = {0.0, 0.05, 1e3, kInf};
    for (std::size_t i = 5; i < points.size(); i += 97) thresholds.push_back(std::abs(kPlane.distance(points[i])));
    for (const double threshold : thresholds) {
      if (std::isnan(threshold)) continue;
      std::size_t within = 0;
      std::size_t closer = 0;
      for (std::size_t i = 0; i < points.size(); ++i) {
        within += std::abs(kPlane.distance(points[i])) <= threshold ? 1U : 0U;
        closer += std::abs(kPlane.distance(points[i])) < threshold ? 1U : 0U;
      }
      EXPECT_EQ(count_within(points, kPlane, threshold), within) << threshold;
      EXPECT_EQ(count_closer(points, kPlane, threshold), closer) << threshold;
    }
  });
}

TEST(PlaneKernels, distances_are_those_of_the_plane_and_residuals_are_never_NaN) {
  for_each_sample([](const PlaneSample& sample) {
    const SamplePoints points = sample.all();
    auto fast = std::make_unique<Residuals>();
    distances_of(points, kPlane, *fast);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double plain = kPlane.distance(points[i]);
      EXPECT_TRUE((*fast)[i] == plain || (std::isnan((*fast)[i]) && std::isnan(plain))) << i;
    }
    residuals_of(points, kPlane, *fast);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double plain = std::abs(kPlane.distance(points[i]));
      EXPECT_EQ((*fast)[i], std::isfinite(plain) ? plain : kInf) << i;
    }
  });
}

TEST(PlaneKernels, heights_are_counted_in_their_bins) {
  for_each_sample([](const PlaneSample& sample) {
    const SamplePoints points = sample.all();
    const double width = 0.03;
    for (const std::size_t size : {std::size_t{12}, kHeightBinsMax}) {
      std::vector<std::uint32_t> plain(size);
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double at = std::floor(kPlane.distance(points[i]) * (1.0 / width)) + 0.5 * static_cast<double>(size);
        if (at >= 0.0 && at < static_cast<double>(size)) ++plain[static_cast<std::size_t>(at)];
      }
      std::vector<std::uint32_t> fast(size, 77U);
      count_heights(points, kPlane, width, fast);
      EXPECT_EQ(fast, plain);
    }
  });
}

TEST(PlaneKernels, sums_of_the_inliers_are_those_of_a_plain_loop) {
  for_each_sample([](const PlaneSample& sample) {
    const SamplePoints points = sample.all();
    const Vec3 shift(1.0, 2.0, 12.0);
    SampleSums plain;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!(std::abs(kPlane.distance(points[i])) <= 0.09)) continue;
      const Vec3 p = points[i] - shift;
      ++plain.count;
      const double terms[] = {p.x(),         p.y(),         p.z(),         p.x() * p.x(), p.x() * p.y(),
                              p.x() * p.z(), p.y() * p.y(), p.y() * p.z(), p.z() * p.z()};
      for (std::size_t k = 0; k < plain.sums.size(); ++k) plain.sums[k] += terms[k];
    }
    const SampleSums fast = sums_within(points, kPlane, 0.09, shift);
    EXPECT_EQ(fast.count, plain.count);
    for (std::size_t k = 0; k < plain.sums.size(); ++k)
      EXPECT_NEAR(fast.sums[k], plain.sums[k], 1e-9 * std::max(1.0, static_cast<double>(plain.count))) << k;
  });
}

TEST(PlaneKernels, have_the_same_bits_on_every_instruction_set) {
  const auto everything = [](const PlaneSample& sample) {
    std::vector<double> all;
    const SamplePoints points = sample.all();
    all.push_back(truncated_squares(points, kPlane, 0.09, kInf));
    ScaledSums never;
    never.fill(kInf);
    for (const double v : truncated_squares(points, kPlane, 0.09, never)) all.push_back(v);
    all.push_back(static_cast<double>(count_within(points, kPlane, 0.05)));
    all.push_back(static_cast<double>(count_closer(points, kPlane, 0.05)));
    for (const double v : sums_within(points, kPlane, 0.09, Vec3(1.0, 2.0, 12.0)).sums) all.push_back(v);
    std::vector<std::uint32_t> bins(kHeightBinsMax);
    count_heights(points, kPlane, 0.03, bins);
    all.insert(all.end(), bins.begin(), bins.end());
    return all;
  };
  for_each_sample([&](const PlaneSample& sample) {
    std::vector<double> first;
    for (const InstructionSet set : kSets) {
      if (!limit_instruction_set(set)) continue;
      const std::vector<double> bits = everything(sample);
      if (first.empty()) first = bits;
      EXPECT_EQ(std::memcmp(bits.data(), first.data(), first.size() * sizeof(double)), 0) << static_cast<int>(set);
    }
  });
  (void)limit_instruction_set(InstructionSet::best);
}

TEST(PlaneSampling, the_first_quarter_represents_the_whole_set) {
  for (const std::size_t n : {std::size_t{1500}, std::size_t{4096}, std::size_t{4097}, std::size_t{100'000}}) {
    // Every fourth point of the set is missing; x is the position of a point in the set.
    std::vector<Vec3> points;
    for (std::size_t i = 0; i < n; ++i)
      points.push_back(Vec3(static_cast<double>(i) / static_cast<double>(n), i % 4 == 0 ? kInf : 0.0, 0.0));
    Prng prng(n);
    auto sample = std::make_unique<PlaneSample>();
    draw_sample(std::span<const Vec3>(points), prng, *sample);
    ASSERT_EQ(sample->size(), std::min(n, limits::kPlaneSampleMax));
    const SamplePoints preview = sample->preview();
    ASSERT_EQ(preview.size(), std::min(n, PlaneSample::kPreview));
    std::vector<std::size_t> decile(10);
    std::size_t lost = 0;
    for (std::size_t i = 0; i < preview.size(); ++i) {
      ++decile[static_cast<std::size_t>(10.0 * preview[i].x())];
      lost += preview[i].allFinite() ? 0U : 1U;
    }
    for (const std::size_t count : decile) EXPECT_NEAR(static_cast<double>(count), 102.4, 40.0) << n;
    EXPECT_NEAR(static_cast<double>(lost), 256.0, 60.0) << n;
    // All points of a set that fits, each once.
    std::vector<double> places(sample->x.begin(), sample->x.begin() + static_cast<std::ptrdiff_t>(sample->size()));
    std::sort(places.begin(), places.end());
    EXPECT_EQ(std::adjacent_find(places.begin(), places.end()), places.end());
  }
}

// ---- points near where the threshold cuts --------------------------------------------------------------------------

/// A face of `count` points in runs of odd lengths, about `plane`, a fifth of them strays; `edge`: all of the points
/// are near the threshold.
struct ListedFace {
  std::vector<float> x, s, h;
  std::vector<SeatPoints> runs;
  ListedPoints points;

  ListedFace(std::size_t count, const FlatPlane& plane, double sigma_mm, double edge_mm = 0.0) {
    points.frame.origin = Vec3(3.0, -40.0, 1.0);
    const LocalPlane local(points.frame, plane);
    Prng prng(count);
    for (std::size_t i = 0; i < count; ++i) {
      const double u = 100.0 * prng.uniform() - 50.0;
      const double v = 30.0 * prng.uniform() + 5.0;
      double off = prng.uniform() < 0.2 ? 20.0 * (prng.uniform() - 0.5) : sigma_mm * prng.normal();
      if (edge_mm > 0.0) off = (prng.uniform() < 0.5 ? -1.0 : 1.0) * edge_mm * (0.98 + 0.04 * prng.uniform());
      x.push_back(static_cast<float>(u));
      s.push_back(static_cast<float>(v));
      h.push_back(static_cast<float>(local.a0 + local.a1 * u + local.a2 * v + off * local.stretch));
    }
    for (std::size_t at = 0; at < count;) {
      const std::size_t n = std::min<std::size_t>(count - at, 1 + prng.below(1000));
      runs.push_back({std::span(x).subspan(at, n), std::span(s).subspan(at, n), std::span(h).subspan(at, n)});
      if (prng.uniform() < 0.1) runs.push_back({});
      at += n;
    }
    points.runs = runs;
    points.count = count;
  }
  [[nodiscard]] std::vector<Vec3> all() const {
    std::vector<Vec3> out;
    for (std::size_t i = 0; i < points.size(); ++i) out.push_back(points[i]);
    return out;
  }
};

TEST(PlaneSampling, draws_the_same_points_from_lists_as_from_an_array) {
  static_assert(
      std::is_same_v<decltype(ask_for_point(std::declval<const ListedPoints&>(), std::size_t{})), ListedPoints::Place>,
      "lists are prefetched");
  for (const std::size_t n : {3U, 31U, 32U, 33U, 1500U, 4095U, 4096U, 4097U, 100'000U}) {
    SCOPED_TRACE(n);
    const ListedFace face(n, {Vec3::UnitZ(), 2.0}, 0.03);
    const std::vector<Vec3> points = face.all();
    Prng of_lists(n);
    Prng of_array(n);
    auto listed = std::make_unique<PlaneSample>();
    auto plain = std::make_unique<PlaneSample>();
    draw_sample(face.points, of_lists, *listed);
    draw_sample(std::span<const Vec3>(points), of_array, *plain);
    ASSERT_EQ(listed->size(), std::min(n, limits::kPlaneSampleMax));
    ASSERT_EQ(plain->size(), listed->size());
    std::size_t different = 0;
    for (std::size_t i = 0; i < plain->size(); ++i) different += listed->all()[i] == plain->all()[i] ? 0U : 1U;
    EXPECT_EQ(different, 0U);
    EXPECT_EQ(of_lists.next(), of_array.next());
  }
}

TEST(ZonedPoints, hold_what_is_within_the_threshold_of_any_plane_close_by) {
  const FlatPlane plane = {Vec3(0.004, -0.3, 1.0).normalized(), 2.0};
  for (const std::size_t count : {3U, 15U, 16U, 1000U, 100'000U}) {
    SCOPED_TRACE(count);
    const ListedFace face(count, plane, 0.03);
    auto zoned = std::make_unique<ZonedPoints>();
    ASSERT_TRUE(zoned->sort(face.points, plane, 0.09));
    EXPECT_EQ(zoned->size(), count);
    for (const double move : {0.0, 0.003, -0.005}) {
      const FlatPlane moved = {(plane.n + Vec3(0.1 * move / 50.0, 0.2 * move / 35.0, 0.0)).normalized(),
                               plane.d + move};
      PointMoments fast(face.points.frame.origin);
      zoned->add_within(moved, 0.09, fast);
      EXPECT_FALSE(zoned->asked_beyond());
      PointMoments plain(face.points.frame.origin);
      std::size_t on_the_edge = 0;
      for (const Vec3& p : face.all()) {
        const double off = std::abs(moved.distance(p));
        if (off <= 0.09) plain.add(p);
        on_the_edge += std::abs(off - 0.09) < 2e-6 ? 1U : 0U;
      }
      plain.close_block();
      EXPECT_NEAR(static_cast<double>(fast.count()), static_cast<double>(plain.count()),
                  static_cast<double>(on_the_edge));
      if (plain.count() < 4 || fast.count() != plain.count()) continue;
      EXPECT_LT((fast.mean() - plain.mean()).norm(), 1e-5);
      EXPECT_LT((fast.scatter() - plain.scatter()).norm(), 1e-6 * plain.scatter().norm());
    }
    const FlatPlane off = {plane.n, plane.d + 0.01};
    PointMoments unused(face.points.frame.origin);
    zoned->add_within(off, 0.09, unused);
    EXPECT_TRUE(zoned->asked_beyond());
  }
}

TEST(ZonedPoints, refuse_a_threshold_too_fine_and_an_edge_too_full) {
  const FlatPlane plane = {Vec3::UnitZ(), 0.5};
  auto zoned = std::make_unique<ZonedPoints>();
  EXPECT_FALSE(zoned->sort(ListedFace(1000, plane, 0.0).points, plane, 1e-9));
  EXPECT_FALSE(zoned->sort(ListedFace(20'000, plane, 0.03, 0.09).points, plane, 0.09));
}

TEST(ZonedPoints, lead_to_the_fixed_point_of_all_points) {
  const FlatPlane plane = {Vec3(0.004, -0.3, 1.0).normalized(), 2.0};
  // The last one is all edge: its fit reads all points each time.
  for (const double edge : {0.0, 0.05}) {
    for (const std::size_t count : {40U, 3000U, 60'000U}) {
      SCOPED_TRACE(std::to_string(count) + " " + std::to_string(edge));
      const ListedFace face(count, plane, 0.03, edge);
      const std::vector<Vec3> points = face.all();
      const PlaneSettings settings{.inlier_share_min = 0.5, .seed = count};
      const PlaneFit fast = fit_plane_over(face.points, Vec3::UnitZ(), settings);
      const PlaneFit plain = fit_plane(points, Vec3::UnitZ(), settings);
      EXPECT_EQ(fast.ok, plain.ok);
      EXPECT_NEAR(static_cast<double>(fast.inliers), static_cast<double>(plain.inliers),
                  1e-4 * static_cast<double>(count));
      EXPECT_LT(angle_between_rad(fast.normal, plain.normal), 1e-6);
      EXPECT_NEAR(fast.offset_mm, plain.offset_mm, 1e-5);
      EXPECT_NEAR(fast.std_mm, plain.std_mm, 1e-5);
      EXPECT_NEAR(fast.sigma_offset_mm, plain.sigma_offset_mm, 1e-6);
    }
  }
}

}  // namespace
}  // namespace slabd::algo
