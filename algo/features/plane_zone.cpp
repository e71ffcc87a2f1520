// SPDX-License-Identifier: Apache-2.0
//
// A plane fit reads all points again and again, but between refits only points near the threshold change sides. Once a
// sample has located the plane to a fraction of the noise, the other points can be summed in one pass. The fixed point
// found on the rest is that of all points: a plane outside the limits of the zone is detected, and the pass is repeated
// around it.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/features/plane_zone.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include <algorithm>

#include "algo/features/plane_zone.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Number of sixteens between two transfers of the float sums to double.
constexpr int kFlush = 16;

/// TiltedSums, lane by lane.
struct ZoneSums {
  F16 count = f16(0.0F);
  std::array<F16, 9> now;
  std::array<D16, 9> total;
  ZoneSums() {
    now.fill(f16(0.0F));
    total.fill(d16(0.0));
  }
  HWY_INLINE void add(const M16& in, const F16& all_u, const F16& all_v, const F16& all_r) {
    const F16 u = keep(in, all_u);
    const F16 v = keep(in, all_v);
    const F16 r = keep(in, all_r);
    count = count + keep(in, f16(1.0F));
    const std::array<F16, 9> terms = {u, v, r, u * u, u * v, u * r, v * v, v * r, r * r};
    for (std::size_t k = 0; k < terms.size(); ++k) now[k] = now[k] + terms[k];
  }
  HWY_INLINE void flush() {
    for (std::size_t k = 0; k < now.size(); ++k) {
      total[k] = total[k] + to_double(now[k]);
      now[k] = f16(0.0F);
    }
  }
  [[nodiscard]] TiltedSums close() {
    flush();
    TiltedSums sums;
    sums.count = sum_of_lanes(count);
    for (std::size_t k = 0; k < total.size(); ++k) sums.sums[k] = sum_of_lanes(total[k]);
    return sums;
  }
};

/// The last sixteen of a run; missing ones repeat the last point.
struct LastSixteen {
  alignas(64) std::array<float, kLanes> u, v, h;
  LastSixteen(const SeatPoints& run, std::size_t first) {
    for (std::size_t k = 0; k < kLanes; ++k) {
      const std::size_t from = std::min(first + k, run.size() - 1);
      u[k] = run.x[from];
      v[k] = run.s[from];
      h[k] = run.h[from];
    }
  }
};

/// Sorts the points into the zone. False if `edge` is full.
bool SortZone(std::span<const SeatPoints> runs, const Tilt& tilt, float inner_mm, float outer_mm, TiltedSums& inner,
              ZonedPoints::Edge& edge, ZonedPoints::Box& box) {
  const F16 a0 = f16(tilt.a0);
  const F16 a1 = f16(tilt.a1);
  const F16 a2 = f16(tilt.a2);
  ZoneSums sums;
  F16 u_low = f16(std::numeric_limits<float>::max());
  F16 v_low = u_low;
  F16 u_high = f16(std::numeric_limits<float>::lowest());
  F16 v_high = u_high;
  bool fits = true;
  const auto take = [&](const M16& there, const F16& u, const F16& v, const F16& h) {
    const F16 r = h - a0 - a1 * u - a2 * v;
    const F16 off = abs(r);
    const M16 in = there & (off <= f16(inner_mm));
    sums.add(in, u, v, r);
    u_low = min(u_low, u);
    u_high = max(u_high, u);
    v_low = min(v_low, v);
    v_high = max(v_high, v);
    const M16 near = and_not(in, there & (off <= f16(outer_mm)));
    if (bits(near) == 0) return;
    fits = fits && edge.count + kLanes <= ZonedPoints::kEdgeMax;
    if (!fits) return;
    store_set(near, u, &edge.u[edge.count]);
    store_set(near, v, &edge.v[edge.count]);
    edge.count += store_set(near, r, &edge.r[edge.count]);
  };
  edge.count = 0;
  int since_flush = 0;
  for (std::size_t k = 0; k < runs.size(); ++k) {
    const SeatPoints& run = runs[k];
    if (k + 1 < runs.size()) runs[k + 1].ask_for();
    for (std::size_t i = 0; i < run.size() && fits; i += kLanes) {
      if (i + kLanes <= run.size()) {
        const F16 u = load(&run.x[i]);
        take(u == u, u, load(&run.s[i]), load(&run.h[i]));
      } else {
        const LastSixteen last(run, i);
        take(lanes_of((1U << (run.size() - i)) - 1U), load(last.u.data()), load(last.v.data()), load(last.h.data()));
      }
      if (++since_flush == kFlush) {
        sums.flush();
        since_flush = 0;
      }
    }
  }
  inner = sums.close();
  alignas(64) std::array<std::array<float, kLanes>, 4> ends;
  store(u_low, ends[0].data());
  store(u_high, ends[1].data());
  store(v_low, ends[2].data());
  store(v_high, ends[3].data());
  box = {*std::min_element(ends[0].begin(), ends[0].end()), *std::max_element(ends[1].begin(), ends[1].end()),
         *std::min_element(ends[2].begin(), ends[2].end()), *std::max_element(ends[3].begin(), ends[3].end())};
  return fits;
}

TiltedSums SumsWithin(const SeatPoints& run, const Tilt& tilt, float within_mm) {
  const F16 a0 = f16(tilt.a0);
  const F16 a1 = f16(tilt.a1);
  const F16 a2 = f16(tilt.a2);
  ZoneSums sums;
  int since_flush = 0;
  const auto take = [&](const M16& there, const F16& u, const F16& v, const F16& h) {
    sums.add(there & (abs(h - a0 - a1 * u - a2 * v) <= f16(within_mm)), u, v, h);
  };
  for (std::size_t i = 0; i < run.size(); i += kLanes) {
    if (i + kLanes <= run.size()) {
      const F16 u = load(&run.x[i]);
      take(u == u, u, load(&run.s[i]), load(&run.h[i]));
    } else {
      const LastSixteen last(run, i);
      take(lanes_of((1U << (run.size() - i)) - 1U), load(last.u.data()), load(last.v.data()), load(last.h.data()));
    }
    if (++since_flush == kFlush) {
      sums.flush();
      since_flush = 0;
    }
  }
  return sums.close();
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#include <cmath>

namespace slabd::algo {
HWY_EXPORT(SortZone);
HWY_EXPORT(SumsWithin);
namespace {

/// Half width of the zone in which points are kept, relative to the threshold: a quarter of the noise.
constexpr double kEdgeShare = 1.0 / 12.0;
/// Margin of the zone for rounding.
constexpr double kRounding_mm = 1e-5;
/// Floats are too coarse for a finer threshold.
constexpr double kThresholdMin_mm = 1e-3;

}  // namespace

TiltedSums tilted_sums(std::span<const SeatPoints> runs, const Tilt& tilt, float within_mm) {
  TiltedSums sums;
  for (const SeatPoints& run : runs) sums += HWY_DYNAMIC_DISPATCH(SumsWithin)(run, tilt, within_mm);
  return sums;
}

bool ZonedPoints::sort(const ListedPoints& points, const FlatPlane& plane, double threshold) {
  const LocalPlane local(points.frame, plane);
  frame_ = points.frame;
  tilt_ = local.tilt();
  count_ = points.size();
  slack_mm_ = kEdgeShare * threshold - kRounding_mm;
  asked_beyond_ = false;
  const double limit = threshold * local.stretch;
  return threshold >= kThresholdMin_mm &&
         HWY_DYNAMIC_DISPATCH(SortZone)(points.runs, tilt_, static_cast<float>((1.0 - kEdgeShare) * limit),
                                        static_cast<float>((1.0 + kEdgeShare) * limit), inner_, edge_, box_);
}

void ZonedPoints::add_within(const FlatPlane& plane, double threshold, PointMoments& moments) const {
  const LocalPlane local(frame_, plane);
  const double d0 = local.a0 - static_cast<double>(tilt_.a0);
  const double d1 = local.a1 - static_cast<double>(tilt_.a1);
  const double d2 = local.a2 - static_cast<double>(tilt_.a2);
  for (const float u : {box_.u_low, box_.u_high})
    for (const float v : {box_.v_low, box_.v_high})
      // Also true for NaN.
      if (!(std::abs(d0 + d1 * static_cast<double>(u) + d2 * static_cast<double>(v)) <= slack_mm_))
        asked_beyond_ = true;
  const SeatPoints edge = {std::span(edge_.u).first(edge_.count), std::span(edge_.v).first(edge_.count),
                           std::span(edge_.r).first(edge_.count)};
  TiltedSums sums = inner_;
  sums += tilted_sums({&edge, 1}, {static_cast<float>(d0), static_cast<float>(d1), static_cast<float>(d2)},
                      static_cast<float>(threshold * local.stretch));
  add_tilted(frame_, tilt_, sums, moments);
}

}  // namespace slabd::algo

#endif
