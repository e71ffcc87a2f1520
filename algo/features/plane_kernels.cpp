// SPDX-License-Identifier: Apache-2.0
//
// A plane fit compares a hundred hypotheses on a thousand points, several times: arithmetic without branches, sixteen
// points at a time. After every kLook points, a hypothesis that can no longer win is dropped.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/features/plane_kernels.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/features/plane_kernels.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

struct PlaneLanes {
  D16 nx, ny, nz, d;
};
HWY_INLINE PlaneLanes spread_out(const FlatPlane& plane) {
  return {d16(plane.n.x()), d16(plane.n.y()), d16(plane.n.z()), d16(plane.d)};
}
/// Distance, with the same order of operations as FlatPlane::distance.
HWY_INLINE D16 distance(const PlaneLanes& plane, const D16& x, const D16& y, const D16& z) {
  return plane.nx * x + plane.ny * y + plane.nz * z - plane.d;
}
HWY_INLINE D16 distance(const PlaneLanes& plane, const SamplePoints& points, std::size_t i) {
  return distance(plane, load(points.x + i), load(points.y + i), load(points.z + i));
}

constexpr std::size_t kLook = 256;

double truncated_squares_lanes(const SamplePoints& points, const FlatPlane& plane, double threshold, double stop_at) {
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold * threshold);
  const auto cut = [&](std::size_t i) {
    const D16 r = distance(lanes, points, i);
    const D16 r2 = r * r;
    return select(r2 < limit, r2, limit);
  };
  D16 sum = d16(0.0);
  const std::size_t whole = points.count / kLanes * kLanes;
  std::size_t i = 0;
  while (i < whole) {
    for (const std::size_t end = std::min(i + kLook, whole); i < end; i += kLanes) sum = sum + cut(i);
    if (i < whole && sum_of_lanes(sum) >= stop_at) return sum_of_lanes(sum);
  }
  double total = sum_of_lanes(sum);
  if (whole < points.count) {
    alignas(64) std::array<double, kLanes> rest;
    store(cut(whole), rest.data());
    for (std::size_t k = 0; k < points.count - whole; ++k) total += rest[k];
  }
  return total;
}

ScaledSums scaled_squares_lanes(const SamplePoints& points, const FlatPlane& plane, double threshold,
                                const ScaledSums& stop_at) {
  const PlaneLanes lanes = spread_out(plane);
  D16 limit[kScales];
  D16 sum[kScales];
  for (std::size_t k = 0; k < kScales; ++k) {
    const double t = threshold / static_cast<double>(1U << k);
    limit[k] = d16(t * t);
    sum[k] = d16(0.0);
  }
  const auto square_at = [&](std::size_t i) {
    const D16 r = distance(lanes, points, i);
    return r * r;
  };
  const auto totals = [&] {
    ScaledSums total;
    for (std::size_t k = 0; k < kScales; ++k) total[k] = sum_of_lanes(sum[k]);
    return total;
  };
  const std::size_t whole = points.count / kLanes * kLanes;
  std::size_t i = 0;
  while (i < whole) {
    for (const std::size_t end = std::min(i + kLook, whole); i < end; i += kLanes) {
      const D16 r2 = square_at(i);
      for (std::size_t k = 0; k < kScales; ++k) sum[k] = sum[k] + select(r2 < limit[k], r2, limit[k]);
    }
    if (i == whole) break;
    const ScaledSums so_far = totals();
    bool lost = true;
    for (std::size_t k = 0; k < kScales; ++k) lost = lost && so_far[k] >= stop_at[k];
    if (lost) return so_far;
  }
  ScaledSums total = totals();
  if (whole < points.count) {
    alignas(64) std::array<double, kLanes> rest;
    const D16 r2 = square_at(whole);
    for (std::size_t k = 0; k < kScales; ++k) {
      store(select(r2 < limit[k], r2, limit[k]), rest.data());
      for (std::size_t j = 0; j < points.count - whole; ++j) total[k] += rest[j];
    }
  }
  return total;
}

std::size_t count_within_lanes(const SamplePoints& points, const FlatPlane& plane, double threshold) {
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold);
  const D16 one = d16(1.0);
  D16 sum = d16(0.0);
  for (std::size_t i = 0; i < points.count; i += kLanes)
    sum = sum + keep(abs(distance(lanes, points, i)) <= limit, one);
  return static_cast<std::size_t>(sum_of_lanes(sum));
}

std::size_t count_closer_lanes(const SamplePoints& points, const FlatPlane& plane, double threshold) {
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold);
  const D16 one = d16(1.0);
  D16 sum = d16(0.0);
  for (std::size_t i = 0; i < points.count; i += kLanes) sum = sum + keep(abs(distance(lanes, points, i)) < limit, one);
  return static_cast<std::size_t>(sum_of_lanes(sum));
}

void distances_lanes(const SamplePoints& points, const FlatPlane& plane, double* out) {
  const PlaneLanes lanes = spread_out(plane);
  for (std::size_t i = 0; i < points.count; i += kLanes) store(distance(lanes, points, i), out + i);
}

void count_heights_lanes(const SamplePoints& points, const FlatPlane& plane, double width,
                         std::span<std::uint32_t> bins) {
  const PlaneLanes lanes = spread_out(plane);
  // Neighbours often share a bin, and each count would wait for the previous one. So there are four counters per bin,
  // and one bin for all heights outside.
  std::array<std::array<std::uint32_t, kHeightBinsMax + 1>, 4> counts{};
  const D16 per_mm = d16(1.0 / width);
  const D16 half = d16(static_cast<double>(bins.size() / 2));
  const D16 all = d16(static_cast<double>(bins.size()));
  alignas(64) std::array<std::int32_t, kLanes> bin;
  for (std::size_t i = 0; i < points.count; i += kLanes) {
    const D16 at = floor(distance(lanes, points, i) * per_mm) + half;
    store(to_int(to_float(select((at >= d16(0.0)) & (at < all), at, all))), bin.data());
    for (std::size_t k = 0; k < kLanes; ++k) ++counts[k % 4][static_cast<std::size_t>(bin[k])];
  }
  for (std::size_t b = 0; b < bins.size(); ++b) bins[b] = counts[0][b] + counts[1][b] + counts[2][b] + counts[3][b];
}

SampleSums sums_within_lanes(const SamplePoints& points, const FlatPlane& plane, double threshold, const Vec3& shift) {
  const PlaneLanes lanes = spread_out(plane);
  const D16 limit = d16(threshold);
  const D16 sx = d16(shift.x());
  const D16 sy = d16(shift.y());
  const D16 sz = d16(shift.z());
  const D16 one = d16(1.0);
  const D16 zero = d16(0.0);
  D16 n = zero, x1 = zero, y1 = zero, z1 = zero, xx = zero, xy = zero, xz = zero, yy = zero, yz = zero, zz = zero;
  for (std::size_t i = 0; i < points.count; i += kLanes) {
    const D16 px = load(points.x + i);
    const D16 py = load(points.y + i);
    const D16 pz = load(points.z + i);
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

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#include <cassert>

namespace slabd::algo {
HWY_EXPORT(truncated_squares_lanes);
HWY_EXPORT(scaled_squares_lanes);
HWY_EXPORT(count_within_lanes);
HWY_EXPORT(count_closer_lanes);
HWY_EXPORT(distances_lanes);
HWY_EXPORT(count_heights_lanes);
HWY_EXPORT(sums_within_lanes);

double truncated_squares(const SamplePoints& points, const FlatPlane& plane, double threshold, double stop_at) {
  return HWY_DYNAMIC_DISPATCH(truncated_squares_lanes)(points, plane, threshold, stop_at);
}
ScaledSums truncated_squares(const SamplePoints& points, const FlatPlane& plane, double threshold,
                             const ScaledSums& stop_at) {
  return HWY_DYNAMIC_DISPATCH(scaled_squares_lanes)(points, plane, threshold, stop_at);
}
std::size_t count_within(const SamplePoints& points, const FlatPlane& plane, double threshold) {
  return HWY_DYNAMIC_DISPATCH(count_within_lanes)(points, plane, threshold);
}
std::size_t count_closer(const SamplePoints& points, const FlatPlane& plane, double threshold) {
  return HWY_DYNAMIC_DISPATCH(count_closer_lanes)(points, plane, threshold);
}
void distances_of(const SamplePoints& points, const FlatPlane& plane, std::span<double> out) {
  HWY_DYNAMIC_DISPATCH(distances_lanes)(points, plane, out.data());
}
void count_heights(const SamplePoints& points, const FlatPlane& plane, double width, std::span<std::uint32_t> bins) {
  assert(bins.size() <= kHeightBinsMax);
  HWY_DYNAMIC_DISPATCH(count_heights_lanes)(points, plane, width, bins);
}
SampleSums sums_within(const SamplePoints& points, const FlatPlane& plane, double threshold, const Vec3& shift) {
  return HWY_DYNAMIC_DISPATCH(sums_within_lanes)(points, plane, threshold, shift);
}

}  // namespace slabd::algo

#endif
