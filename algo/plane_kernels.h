// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "base/base.h"

/// The loops of the plane fits over their sample, sixteen points at a time. All in double; the same bits on every
/// instruction set.
namespace slabd::algo {

/// n.p = d, n of unit length.
struct FlatPlane {
  Vec3 n = Vec3::Zero();
  double d = 0.0;
  [[nodiscard]] double distance(const Vec3& p) const { return n.x() * p.x() + n.y() * p.y() + n.z() * p.z() - d; }
  [[nodiscard]] bool same_bits(const FlatPlane& other) const { return n == other.n && d == other.d; }
};

/// Points that stand for the whole set while hypotheses are compared; an array for each coordinate.
struct PlaneSample {
  static constexpr std::size_t kLanes = 16;
  static_assert(limits::kPlaneSampleMax % kLanes == 0);
  alignas(64) std::array<double, limits::kPlaneSampleMax> x;
  alignas(64) std::array<double, limits::kPlaneSampleMax> y;
  alignas(64) std::array<double, limits::kPlaneSampleMax> z;
  std::size_t count = 0;

  [[nodiscard]] std::size_t size() const { return count; }
  [[nodiscard]] Vec3 operator[](std::size_t i) const { return {x[i], y[i], z[i]}; }
  void add(const Vec3& p) {
    x[count] = p.x();
    y[count] = p.y();
    z[count] = p.z();
    ++count;
  }
  /// Call once after the last `add`: what is left of the last sixteen becomes NaN.
  void close() {
    for (std::size_t i = count; i % kLanes != 0; ++i) x[i] = y[i] = z[i] = std::numeric_limits<double>::quiet_NaN();
  }
};
using Residuals = std::array<double, limits::kPlaneSampleMax>;

/// Sum of min(r^2, threshold^2) over the sample; a point that is not finite counts as far away. Once the sum can no
/// longer stay below `stop_at` it may be returned unfinished, but not below `stop_at`.
[[nodiscard]] double truncated_squares(const PlaneSample& sample, const FlatPlane& plane, double threshold,
                                       double stop_at);
/// Points at most `threshold` from `plane`.
[[nodiscard]] std::size_t count_within(const PlaneSample& sample, const FlatPlane& plane, double threshold);
/// Points closer than `threshold`.
[[nodiscard]] std::size_t count_closer(const PlaneSample& sample, const FlatPlane& plane, double threshold);
/// Signed distances, one for each point; NaN for points that are not finite.
void distances_of(const PlaneSample& sample, const FlatPlane& plane, std::span<double> out);
/// Sums of x y z, xx xy xz, yy yz, zz about `shift` of the points at most `threshold` from `plane`.
struct SampleSums {
  std::array<double, 9> sums{};
  std::size_t count = 0;
};
[[nodiscard]] SampleSums sums_within(const PlaneSample& sample, const FlatPlane& plane, double threshold,
                                     const Vec3& shift);

/// The value that k others do not exceed: values[k] if they were sorted. Not negative, not NaN (infinities allowed),
/// k < values.size(). Exact; about 5 us for 4096 values.
[[nodiscard]] double kth_smallest(std::span<const double> values, std::size_t k);
/// Values that are at most `limit`.
[[nodiscard]] std::size_t count_at_most(std::span<const double> values, double limit);

}  // namespace slabd::algo
