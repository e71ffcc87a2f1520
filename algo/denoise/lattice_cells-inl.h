// SPDX-License-Identifier: Apache-2.0
//
// Columns and rows of sixteen points on a lattice (algo/denoise/lattice.h). Not a public header of the room: kernels
// include it after algo/lanes-inl.h.
#if defined(SLABD_ALGO_LATTICE_CELLS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLABD_ALGO_LATTICE_CELLS_INL_H_
#undef SLABD_ALGO_LATTICE_CELLS_INL_H_
#else
#define SLABD_ALGO_LATTICE_CELLS_INL_H_
#endif

#include "algo/denoise/lattice.h"
#include "algo/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

template <typename T>
HWY_INLINE bool all(const MaskPack<T, 1>& mask) {
  return hn::AllTrue(Tag<T>(), mask.m);
}
template <typename T, std::size_t K>
HWY_INLINE bool all(const MaskPack<T, K>& mask) {
  return all(mask.lo) && all(mask.hi);
}
HWY_INLINE float first_lane(const Pack<float, 1>& a) {
  return hn::GetLane(a.v);
}
template <std::size_t K>
HWY_INLINE float first_lane(const Pack<float, K>& a) {
  return first_lane(a.lo);
}

/// Loads point i and the next fifteen; NaN beyond `points`.
HWY_INLINE Points16 sixteen_points(const float* xyz, std::size_t points, std::size_t i) {
  return points - i >= kLanes ? load_points(xyz + 3 * i) : load_points(xyz + 3 * i, points - i);
}
HWY_INLINE M16 finite_points(const Points16& p) {
  return ((p.x - p.x) + (p.y - p.y) + (p.z - p.z)) == f16(0.0F);
}

/// Integers, or not finite; inside or outside the table.
struct Places16 {
  F16 column, row;
};
HWY_INLINE Places16 places(const Lattice& lattice, const Points16& p) {
  const F16 x = lattice.central ? p.x / p.z : p.x;
  const F16 y = lattice.central ? p.y / p.z : p.y;
  return {floor((x - f16(lattice.x0)) * f16(lattice.per_x)), floor((y - f16(lattice.y0)) * f16(lattice.per_y))};
}
HWY_INLINE M16 inside(const Lattice& lattice, const Places16& at) {
  const F16 none = f16(0.0F);
  return (at.column >= none) & (at.column < f16(lattice.columns)) & (at.row >= none) & (at.row < f16(lattice.rows));
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#endif
