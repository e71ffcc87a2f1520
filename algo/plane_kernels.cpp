// SPDX-License-Identifier: Apache-2.0
//
// A plane fit compares a hundred hypotheses on four thousand points, several times over; and it asks for the median of
// four thousand distances again and again. The first is arithmetic without branches: sixteen points at a time. The
// second needs no sorting: how many values lie below a number is such a loop too, and halving the range of numbers (by
// their bit patterns, which are ordered as the numbers are) corners the value wanted in some twenty of them.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/plane_kernels.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/plane_kernels.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

struct PlaneLanes {
  D16 nx, ny, nz, d;
};
HWY_INLINE PlaneLanes spread_out(const FlatPlane& plane) {
  return {d16(plane.n.x()), d16(plane.n.y()), d16(plane.n.z()), d16(plane.d)};
}
/// In the order of FlatPlane::distance.
HWY_INLINE D16 distance(const PlaneLanes& plane, const D16& x, const D16& y, const D16& z) {
  return plane.nx * x + plane.ny * y + plane.nz * z - plane.d;
}
HWY_INLINE D16 distance(const PlaneLanes& plane, const PlaneSample& sample, std::size_t i) {
  return distance(plane, load(&sample.x[i]), load(&sample.y[i]), load(&sample.z[i]));
}

double truncated_squares_lanes(const PlaneSample& sample, const FlatPlane& plane, double threshold, double stop_at) {
  constexpr std::size_t kLook = 512;
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold * threshold);
  const auto cut = [&](std::size_t i) {
    const D16 r = distance(lanes, sample, i);
    const D16 r2 = r * r;
    return select(r2 < limit, r2, limit);
  };
  D16 sum = d16(0.0);
  const std::size_t whole = sample.count / kLanes * kLanes;
  std::size_t i = 0;
  while (i < whole) {
    for (const std::size_t end = std::min(i + kLook, whole); i < end; i += kLanes) sum = sum + cut(i);
    if (i < whole && sum_of_lanes(sum) >= stop_at) return sum_of_lanes(sum);
  }
  double total = sum_of_lanes(sum);
  if (whole < sample.count) {
    alignas(64) std::array<double, kLanes> rest;
    store(cut(whole), rest.data());
    for (std::size_t k = 0; k < sample.count - whole; ++k) total += rest[k];
  }
  return total;
}

std::size_t count_within_lanes(const PlaneSample& sample, const FlatPlane& plane, double threshold) {
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold);
  const D16 one = d16(1.0);
  D16 sum = d16(0.0);
  for (std::size_t i = 0; i < sample.count; i += kLanes)
    sum = sum + keep(abs(distance(lanes, sample, i)) <= limit, one);
  return static_cast<std::size_t>(sum_of_lanes(sum));
}

std::size_t count_closer_lanes(const PlaneSample& sample, const FlatPlane& plane, double threshold) {
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold);
  const D16 one = d16(1.0);
  D16 sum = d16(0.0);
  for (std::size_t i = 0; i < sample.count; i += kLanes) sum = sum + keep(abs(distance(lanes, sample, i)) < limit, one);
  return static_cast<std::size_t>(sum_of_lanes(sum));
}

/// `out` has room for whole sixteens.
void distances_lanes(const PlaneSample& sample, const FlatPlane& plane, double* out) {
  const PlaneLanes lanes = spread_out(plane);
  for (std::size_t i = 0; i < sample.count; i += kLanes) store(distance(lanes, sample, i), out + i);
}

SampleSums sums_within_lanes(const PlaneSample& sample, const FlatPlane& plane, double threshold, const Vec3& shift) {
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold);
  const D16 sx = d16(shift.x());
  const D16 sy = d16(shift.y());
  const D16 sz = d16(shift.z());
  const D16 one = d16(1.0);
  const D16 zero = d16(0.0);
  D16 n = zero, x1 = zero, y1 = zero, z1 = zero, xx = zero, xy = zero, xz = zero, yy = zero, yz = zero, zz = zero;
  for (std::size_t i = 0; i < sample.count; i += kLanes) {
    const D16 px = load(&sample.x[i]);
    const D16 py = load(&sample.y[i]);
    const D16 pz = load(&sample.z[i]);
    const auto in = abs(distance(lanes, px, py, pz)) <= limit;
    const D16 x = keep(in, px - sx);
    const D16 y = keep(in, py - sy);
    const D16 z = keep(in, pz - sz);
    n = n + keep(in, one);
    x1 = x1 + x;
    y1 = y1 + y;
    z1 = z1 + z;
    xx = xx + x * x;
    xy = xy + x * y;
    xz = xz + x * z;
    yy = yy + y * y;
    yz = yz + y * z;
    zz = zz + z * z;
  }
  return {{sum_of_lanes(x1), sum_of_lanes(y1), sum_of_lanes(z1), sum_of_lanes(xx), sum_of_lanes(xy), sum_of_lanes(xz),
           sum_of_lanes(yy), sum_of_lanes(yz), sum_of_lanes(zz)},
          static_cast<std::size_t>(sum_of_lanes(n))};
}

std::size_t count_at_most_lanes(const double* values, std::size_t size, double limit) {
  const D16 most = d16(limit);
  const D16 one = d16(1.0);
  D16 sum = d16(0.0);
  std::size_t i = 0;
  for (; i + kLanes <= size; i += kLanes) sum = sum + keep(load(values + i) <= most, one);
  auto count = static_cast<std::size_t>(sum_of_lanes(sum));
  for (; i < size; ++i) count += values[i] <= limit ? 1U : 0U;
  return count;
}

/// Copies the values in (above, most], at most `room` of them.
std::size_t values_between_lanes(const double* values, std::size_t size, double above, double most, double* out,
                                 std::size_t room) {
  const D16 lo = d16(above);
  const D16 hi = d16(most);
  std::size_t count = 0;
  std::size_t i = 0;
  for (; i + kLanes <= size; i += kLanes) {
    const D16 v = load(values + i);
    for (std::uint32_t in = bits((v > lo) & (v <= hi)); in != 0 && count < room; in &= in - 1)
      out[count++] = values[i + static_cast<std::size_t>(__builtin_ctz(in))];
  }
  for (; i < size; ++i)
    if (values[i] > above && values[i] <= most && count < room) out[count++] = values[i];
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#include <algorithm>
#include <bit>

namespace slabd::algo {
HWY_EXPORT(truncated_squares_lanes);
HWY_EXPORT(count_within_lanes);
HWY_EXPORT(count_closer_lanes);
HWY_EXPORT(distances_lanes);
HWY_EXPORT(sums_within_lanes);
HWY_EXPORT(count_at_most_lanes);
HWY_EXPORT(values_between_lanes);

double truncated_squares(const PlaneSample& sample, const FlatPlane& plane, double threshold, double stop_at) {
  return HWY_DYNAMIC_DISPATCH(truncated_squares_lanes)(sample, plane, threshold, stop_at);
}
std::size_t count_within(const PlaneSample& sample, const FlatPlane& plane, double threshold) {
  return HWY_DYNAMIC_DISPATCH(count_within_lanes)(sample, plane, threshold);
}
std::size_t count_closer(const PlaneSample& sample, const FlatPlane& plane, double threshold) {
  return HWY_DYNAMIC_DISPATCH(count_closer_lanes)(sample, plane, threshold);
}
void distances_of(const PlaneSample& sample, const FlatPlane& plane, std::span<double> out) {
  HWY_DYNAMIC_DISPATCH(distances_lanes)(sample, plane, out.data());
}
SampleSums sums_within(const PlaneSample& sample, const FlatPlane& plane, double threshold, const Vec3& shift) {
  return HWY_DYNAMIC_DISPATCH(sums_within_lanes)(sample, plane, threshold, shift);
}
std::size_t count_at_most(std::span<const double> values, double limit) {
  return HWY_DYNAMIC_DISPATCH(count_at_most_lanes)(values.data(), values.size(), limit);
}

double kth_smallest(std::span<const double> values, std::size_t k) {
  // At most k values lie at or below `low`, more than k at or below `high`.
  std::size_t below = count_at_most(values, 0.0);
  if (below > k) return 0.0;
  std::uint64_t low = 0;
  auto high = std::bit_cast<std::uint64_t>(std::numeric_limits<double>::infinity());
  std::size_t inside = values.size() - below;
  std::array<double, 64> few;
  while (inside > few.size() && high - low > 1) {
    const std::uint64_t middle = low + (high - low) / 2;
    const std::size_t count = count_at_most(values, std::bit_cast<double>(middle));
    if (count > k) {
      high = middle;
      inside = count - below;
    } else {
      low = middle;
      inside -= count - below;
      below = count;
    }
  }
  if (high - low <= 1) return std::bit_cast<double>(high);
  const std::size_t found = HWY_DYNAMIC_DISPATCH(values_between_lanes)(
      values.data(), values.size(), std::bit_cast<double>(low), std::bit_cast<double>(high), few.data(), few.size());
  const auto at = few.begin() + static_cast<std::ptrdiff_t>(k - below);
  std::nth_element(few.begin(), at, few.begin() + static_cast<std::ptrdiff_t>(found));
  return *at;
}

}  // namespace slabd::algo

#endif
