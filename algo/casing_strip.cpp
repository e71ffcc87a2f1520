// SPDX-License-Identifier: Apache-2.0
//
// Nearly all points of a scan lie in neither strip, and sixteen of them at a time say so by their height and place
// along the seat. Only the others are looked at one by one.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/casing_strip.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include <algorithm>

#include "algo/casing_strip.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

/// One coordinate of the seat's frame.
struct SeatAxis {
  F16 x, y, z, t;
  SeatAxis(const CasingStrips& strips, int row)
      : x(f16(static_cast<float>(strips.R_seat_scanner(row, 0)))),
        y(f16(static_cast<float>(strips.R_seat_scanner(row, 1)))),
        z(f16(static_cast<float>(strips.R_seat_scanner(row, 2)))),
        t(f16(static_cast<float>(strips.t_seat_scanner[row]))) {}
  [[nodiscard]] HWY_INLINE F16 of(const Points16& p) const { return x * p.x + y * p.y + (z * p.z + t); }
};

std::size_t count_strips_kernel(const Cloud& cloud, const CasingStrips& strips, std::span<std::uint32_t> index,
                                std::span<std::uint32_t> cells) {
  constexpr auto kHalfRows = static_cast<float>(CasingStrips::kHalfRows);
  constexpr auto kHalfColumns = static_cast<float>(CasingStrips::kHalfColumns);
  const SeatAxis along_rail(strips, 0);
  const SeatAxis along_seat(strips, 1);
  const SeatAxis up(strips, 2);
  const auto s0 = static_cast<float>(strips.half_spacing_mm);
  const F16 height = f16(static_cast<float>(CasingStrips::kHeight_mm));
  std::size_t counted = 0;
  for (std::size_t i = 0; i < cloud.points; i += kLanes) {
    const std::size_t left = cloud.points - i;
    const float* xyz = &cloud.xyz[3 * i];
    const Points16 p = left >= kLanes ? load_points(xyz) : load_points(xyz, left);
    const F16 h = up.of(p);
    const F16 s = along_seat.of(p);
    const F16 row = abs(s) - f16(s0);
    M16 in = (abs(h) <= height) & (abs(row) < f16(kHalfRows));
    if (bits(in) == 0) continue;
    const F16 x = along_rail.of(p);
    in = in & (abs(x) < f16(kHalfColumns));
    std::uint32_t which = bits(in);
    if (which == 0) continue;
    // Rows climb outward along the seat on either side; kept in bounds, whatever the rounding at the rim.
    const M16 inner = s < f16(0.0F);
    const F16 from_centre = select(inner, s + f16(s0), s - f16(s0));
    const F16 limit_r = f16(2.0F * kHalfRows - 1.0F);
    const F16 limit_c = f16(2.0F * kHalfColumns - 1.0F);
    const F16 r = min(max(floor(keep(in, from_centre)) + f16(kHalfRows), f16(0.0F)), limit_r);
    const F16 c = min(max(floor(keep(in, x)) + f16(kHalfColumns), f16(0.0F)), limit_c);
    const F16 cell = r * f16(static_cast<float>(CasingStrips::kColumns)) + c +
                     keep(s >= f16(0.0F), f16(static_cast<float>(CasingStrips::kCells)));
    alignas(64) std::int32_t at[kLanes];
    store(to_int(keep(in, cell)), at);
    for (; which != 0; which &= which - 1) {
      const auto k = static_cast<std::size_t>(__builtin_ctz(which));
      ++cells[static_cast<std::size_t>(at[k])];
      index[counted++] = static_cast<std::uint32_t>(i + k);
    }
  }
  return counted;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(count_strips_kernel);

std::size_t count_strips(const Cloud& cloud, const CasingStrips& strips, std::span<std::uint32_t> index,
                         std::span<std::uint32_t> cells) {
  std::fill(cells.begin(), cells.end(), 0U);
  return HWY_DYNAMIC_DISPATCH(count_strips_kernel)(cloud, strips, index, cells);
}

}  // namespace slabd::algo
#endif
