// SPDX-License-Identifier: Apache-2.0
//
// Nearly all points of a scan are far from any casing. Height and position along the seat reject sixteen of them at a
// time. The others are stored contiguously, so that fits read them from the cache.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/register/casing_strip.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/register/casing_ties.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

/// One coordinate of the seat's frame.
struct SeatAxis {
  F16 x, y, z, t;
  HWY_INLINE SeatAxis(const Mat3& R, const Vec3& offset, int row)
      : x(f16(static_cast<float>(R(row, 0)))),
        y(f16(static_cast<float>(R(row, 1)))),
        z(f16(static_cast<float>(R(row, 2)))),
        t(f16(static_cast<float>(offset[row]))) {}
  [[nodiscard]] HWY_INLINE F16 of(F16 px, F16 py, F16 pz) const { return x * px + y * py + (z * pz + t); }
};

std::size_t places_in_box_kernel(const IcpSample& sample, const CasingStrips& strips, const StripBox& box,
                                 const StripPlaces& to) {
  const Mat3& R = strips.R_seat_scanner;
  const Vec3 t = R * sample.shift + strips.t_seat_scanner;
  const SeatAxis along_rail(R, t, 0);
  const SeatAxis along_seat(R, t, 1);
  const SeatAxis up(R, t, 2);
  const F16 centre = f16(static_cast<float>(box.outer ? strips.half_spacing_mm : -strips.half_spacing_mm));
  const F16 half_x = f16(static_cast<float>(box.half_x_mm));
  const F16 half_s = f16(static_cast<float>(box.half_s_mm));
  const F16 height = f16(static_cast<float>(CasingStrips::kHeight_mm));
  std::size_t count = 0;
  for (std::size_t i = 0; i < sample.size(); i += kLanes) {
    const F16 px = load(&sample.x[i]);
    const F16 py = load(&sample.y[i]);
    const F16 pz = load(&sample.z[i]);
    const F16 s = along_seat.of(px, py, pz) - centre;
    const F16 x = along_rail.of(px, py, pz);
    // False for NaN.
    const M16 in = (abs(s) <= half_s) & (abs(x) <= half_x) & (abs(up.of(px, py, pz)) <= height);
    if (bits(in) == 0) continue;
    (void)store_set(in, x, &to.x[count]);
    (void)store_set(in, s, &to.s[count]);
    count += store_set(in, lane_numbers() + f16(static_cast<float>(i)), &to.number[count]);
  }
  return count;
}

/// One coordinate with the accuracy of the scan.
HWY_INLINE F16 exact(const Mat3& R, const Vec3& t, int row, D16 x, D16 y, D16 z) {
  return to_float(d16(R(row, 0)) * x + d16(R(row, 1)) * y + (d16(R(row, 2)) * z + d16(t[row])));
}

SeatPoints points_around_casings_kernel(const Cloud& cloud, const CloudPart& part, const CasingStrips& strips,
                                        double reach_mm, const RunRoom& to) {
  const Mat3& R = strips.R_seat_scanner;
  const Vec3& t = strips.t_seat_scanner;
  const SeatAxis along_rail(R, t, 0);
  const SeatAxis along_seat(R, t, 1);
  const SeatAxis up(R, t, 2);
  const F16 s0 = f16(static_cast<float>(strips.half_spacing_mm));
  const F16 reach = f16(static_cast<float>(reach_mm));
  const F16 height = f16(static_cast<float>(CasingStrips::kHeight_mm));
  std::size_t count = 0;
  for (std::size_t row = 0; row < part.rows; ++row) {
    const float* xyz = &cloud.xyz[3 * (part.first + row * part.stride)];
    for (std::size_t i = 0; i < part.columns; i += kLanes, xyz += 3 * kLanes) {
      const std::size_t left = part.columns - i;
      const Points16 p = left >= kLanes ? load_points(xyz) : load_points(xyz, left);
      const F16 off = abs(along_seat.of(p.x, p.y, p.z)) - s0;
      // False for NaN.
      const M16 in =
          (abs(off) <= reach) & (abs(up.of(p.x, p.y, p.z)) <= height) & (abs(along_rail.of(p.x, p.y, p.z)) <= reach);
      if (bits(in) == 0) continue;
      if (count + 2 * kLanes > to.h.size()) return {to.x.first(count), to.s.first(count), to.h.first(count)};
      const D16 x = to_double(p.x);
      const D16 y = to_double(p.y);
      const D16 z = to_double(p.z);
      (void)store_set(in, exact(R, t, 0, x, y, z), &to.x[count]);
      (void)store_set(in, exact(R, t, 1, x, y, z), &to.s[count]);
      count += store_set(in, exact(R, t, 2, x, y, z), &to.h[count]);
    }
  }
  return {to.x.first(count), to.s.first(count), to.h.first(count)};
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(places_in_box_kernel);
HWY_EXPORT(points_around_casings_kernel);

std::size_t places_in_box(const IcpSample& sample, const CasingStrips& strips, const StripBox& box,
                          const StripPlaces& to) {
  return HWY_DYNAMIC_DISPATCH(places_in_box_kernel)(sample, strips, box, to);
}
SeatPoints points_around_casings(const Cloud& cloud, const CloudPart& part, const CasingStrips& strips, double reach_mm,
                                 const RunRoom& to) {
  return HWY_DYNAMIC_DISPATCH(points_around_casings_kernel)(cloud, part, strips, reach_mm, to);
}

}  // namespace slabd::algo
#endif
