// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "base/base.h"

/// The loops of the plane fits over their sample, sixteen points at a time. All in double; the same bits with every
/// instruction set.
namespace slabd::algo {

/// Plane n.p = d, n of unit length.
struct FlatPlane {
  Vec3 n = Vec3::Zero();
  double d = 0.0;
  [[nodiscard]] double distance(const Vec3& p) const { return n.x() * p.x() + n.y() * p.y() + n.z() * p.z() - d; }
  [[nodiscard]] bool same_bits(const FlatPlane& other) const { return n == other.n && d == other.d; }
};

/// Points of a sample, one array per coordinate. If the number is not a multiple of sixteen, NaN follow up to the next
/// multiple.
struct SamplePoints {
  const double* x;
  const double* y;
  const double* z;
  std::size_t count;

  [[nodiscard]] std::size_t size() const { return count; }
  [[nodiscard]] Vec3 operator[](std::size_t i) const { return {x[i], y[i], z[i]}; }
};

/// Sample that represents the whole set while hypotheses are compared. It is ordered so that its first quarter
/// represents the whole set too.
struct PlaneSample {
  static constexpr std::size_t kLanes = 16;
  /// Enough points to distinguish a good hypothesis from a bad one.
  static constexpr std::size_t kPreview = limits::kPlaneSampleMax / 4;
  static_assert(limits::kPlaneSampleMax % kLanes == 0 && kPreview % kLanes == 0);
  alignas(64) std::array<double, limits::kPlaneSampleMax> x;
  alignas(64) std::array<double, limits::kPlaneSampleMax> y;
  alignas(64) std::array<double, limits::kPlaneSampleMax> z;
  std::size_t count = 0;

  [[nodiscard]] std::size_t size() const { return count; }
  [[nodiscard]] SamplePoints all() const { return {x.data(), y.data(), z.data(), count}; }
  [[nodiscard]] SamplePoints preview() const { return {x.data(), y.data(), z.data(), std::min(count, kPreview)}; }
  void add(const Vec3& p) {
    x[count] = p.x();
    y[count] = p.y();
    z[count] = p.z();
    ++count;
  }
  /// Completes the sample: fills the last sixteen with NaN. Call once after the last `add`.
  void close() {
    for (std::size_t i = count; i % kLanes != 0; ++i) x[i] = y[i] = z[i] = std::numeric_limits<double>::quiet_NaN();
  }
};
using Residuals = std::array<double, limits::kPlaneSampleMax>;

/// Sum of min(r^2, threshold^2) over the points; a point that is not finite counts as far away. If the sum exceeds
/// `stop_at`, it may be returned incomplete, but not below `stop_at`.
[[nodiscard]] double truncated_squares(const SamplePoints& points, const FlatPlane& plane, double threshold,
                                       double stop_at);
/// The same for kScales thresholds, each half of the one before. Incomplete only if all of the sums exceed their
/// `stop_at`.
inline constexpr std::size_t kScales = 4;
using ScaledSums = std::array<double, kScales>;
[[nodiscard]] ScaledSums truncated_squares(const SamplePoints& points, const FlatPlane& plane, double threshold,
                                           const ScaledSums& stop_at);
/// Number of points at most `threshold` from `plane`.
[[nodiscard]] std::size_t count_within(const SamplePoints& points, const FlatPlane& plane, double threshold);
/// Number of points closer than `threshold`.
[[nodiscard]] std::size_t count_closer(const SamplePoints& points, const FlatPlane& plane, double threshold);
/// Signed distances, one per point (`out` holds whole sixteens); NaN for points that are not finite.
void distances_of(const SamplePoints& points, const FlatPlane& plane, std::span<double> out);
/// Histogram of the heights above `plane`: bin k contains heights from (k - bins.size() / 2) * width on. Heights
/// outside the bins are not counted.
void count_heights(const SamplePoints& points, const FlatPlane& plane, double width, std::span<std::uint32_t> bins);
inline constexpr std::size_t kHeightBinsMax = 96;
/// Sums of x y z, xx xy xz, yy yz, zz about `shift` of the points at most `threshold` from `plane`.
struct SampleSums {
  std::array<double, 9> sums{};
  std::size_t count = 0;
};
[[nodiscard]] SampleSums sums_within(const SamplePoints& points, const FlatPlane& plane, double threshold,
                                     const Vec3& shift);

}  // namespace slabd::algo
