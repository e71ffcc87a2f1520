// SPDX-License-Identifier: Apache-2.0
//
// The surface raster as a pass fills it (algo/survey/surface_raster.h). Not a header of the room: kernels include it
// after algo/lanes-inl.h.
//
// Of each sixteen points as many lanes are taken as the scan's size allows, and put to the raster once they make
// sixteen. Which lanes changes at every turn and has no period: with a fixed choice the columns of an organised scan
// would be thinned to stripes, and a stripe looks like a crack without points.
#if defined(SLABD_ALGO_SURFACE_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLABD_ALGO_SURFACE_LANES_INL_H_
#undef SLABD_ALGO_SURFACE_LANES_INL_H_
#else
#define SLABD_ALGO_SURFACE_LANES_INL_H_
#endif

#include <array>
#include <cstdint>
#include <limits>

#include "algo/lanes-inl.h"
#include "algo/survey/surface_raster.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

class SurfaceLanes {
 public:
  explicit SurfaceLanes(const SurfaceSums& sums)
      : cells_(sums.cells.data()), used_(!sums.cells.empty()), turns_(kLanes / sums.lanes) {
    begin();
  }
  /// Sixteen points in the block's frame and their distances; NaN: nothing was seen there.
  HWY_INLINE void take(const F16& x, const F16& y, const F16& r) {
    if (!used_) return;
    const M16 inside = (abs(x) < f16(kHalfX)) & (abs(y) < f16(kHalfY));
    if (!any(inside)) return;
    if (turns_ == 1) return put(x, y, r);
    const M16 turn = test_bits(i16(static_cast<std::int32_t>(lanes_)), lane_bits());
    x_ = select(turn, x, x_);
    y_ = select(turn, y, y_);
    r_ = select(turn, r, r_);
    // The lanes beside these, next time.
    lanes_ = ((lanes_ << 1U) | (lanes_ >> (kLanes - 1U))) & 0xffffU;
    if (++taken_ == turns_) flush();
  }
  /// The rest, when not every lane has had its turn: those hold no number.
  HWY_NOINLINE void flush() {
    if (used_ && taken_ != 0) put(x_, y_, r_);
    begin();
  }

 private:
  static constexpr auto kHalfX = static_cast<float>(kSurfaceHalfX_mm);
  static constexpr auto kHalfY = static_cast<float>(kSurfaceHalfY_mm);

  using Four = std::array<std::int32_t, 4>;

  static HWY_INLINE void put_together(const Pack<std::int32_t, 1>& units, const Pack<std::int32_t, 1>& one, Four* to) {
    const Tag<std::int32_t> tag;
    hn::StoreInterleaved4(units.v, hn::Mul(units.v, units.v), one.v, hn::Zero(tag), tag, to->data());
  }
  template <std::size_t K>
  static HWY_INLINE void put_together(const Pack<std::int32_t, K>& units, const Pack<std::int32_t, K>& one, Four* to) {
    put_together(units.lo, one.lo, to);
    put_together(units.hi, one.hi, to + kLanes / kRegisters<std::int32_t> * K / 2);
  }
  static HWY_INLINE I16 lane_bits() {
    static constexpr std::array<std::int32_t, kLanes> kBits = {1,   2,   4,    8,    16,   32,   64,    128,
                                                               256, 512, 1024, 2048, 4096, 8192, 16384, 32768};
    return load(kBits.data());
  }
  HWY_INLINE void begin() {
    taken_ = 0;
    x_ = y_ = f16(0.0F);
    r_ = f16(std::numeric_limits<float>::quiet_NaN());
    // Every second or every fourth lane, beginning anywhere: steps of the golden ratio.
    const std::uint32_t every = turns_ == 4 ? 0x1111U : 0x5555U;
    lanes_ = every << ((step_ >> 30U) & (static_cast<std::uint32_t>(turns_) - 1U)) & 0xffffU;
    step_ += 0x9E3779B9U;
  }
  HWY_NOINLINE void put(const F16& x, const F16& y, const F16& r) const {
    const M16 there = (r == r) & (abs(x) < f16(kHalfX)) & (abs(y) < f16(kHalfY));
    constexpr auto kCells = static_cast<float>(1.0 / kSurfaceCell_mm);
    constexpr auto kColumns = static_cast<float>(limits::kSurfaceColumns);
    constexpr auto kRows = static_cast<float>(limits::kSurfaceRows);
    constexpr auto kReach = static_cast<float>(kSurfaceReach_mm);
    constexpr auto kUnits = static_cast<float>(1.0 / kSurfaceUnit_mm);
    // The last place below an edge is the edge once half the field is added.
    const F16 row = min(floor((keep(there, y) + f16(kHalfY)) * f16(kCells)), f16(kRows - 1.0F));
    const F16 column = min(floor((keep(there, x) + f16(kHalfX)) * f16(kCells)), f16(kColumns - 1.0F));
    const F16 size = min(max(keep(there, r), f16(-kReach)), f16(kReach));
    alignas(64) std::array<std::int32_t, kLanes> at;
    store(to_int(row * f16(kColumns) + column), at.data());
    // Sum, square and count of each point side by side, so that a cell takes them in one addition.
    alignas(64) std::array<Four, kLanes> points;
    put_together(to_int(size * f16(kUnits)), to_int(keep(there, f16(1.0F))), points.data());
    for (std::size_t i = 0; i < kLanes; ++i) {
      auto* cell = reinterpret_cast<std::int32_t*>(cells_ + at[i]);
      const hn::CappedTag<std::int32_t, 4> four;
      for (std::size_t k = 0; k < 4; k += hn::MaxLanes(four))
        hn::Store(hn::Add(hn::Load(four, cell + k), hn::Load(four, points[i].data() + k)), four, cell + k);
    }
  }

  SurfaceCell* cells_;
  bool used_;
  std::size_t turns_;
  std::size_t taken_ = 0;
  std::uint32_t lanes_ = 0;
  std::uint32_t step_ = 0;
  F16 x_, y_, r_;
};

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#endif
