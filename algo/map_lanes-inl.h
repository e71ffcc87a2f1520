// SPDX-License-Identifier: Apache-2.0
//
// The map of deviations as a pass fills it (algo/survey_pass.h, MapSums). Not a header of the room: kernels include it
// after algo/lanes-inl.h.
//
// One point of each sixteen goes to the map, another lane each time, and beginning with another one in each round of
// sixteen: lanes in one order would come back to the same columns wherever a row is a multiple of 256 points long.
#if defined(SLABD_ALGO_MAP_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLABD_ALGO_MAP_LANES_INL_H_
#undef SLABD_ALGO_MAP_LANES_INL_H_
#else
#define SLABD_ALGO_MAP_LANES_INL_H_
#endif

#include <array>
#include <cstdint>
#include <limits>

#include "algo/lanes-inl.h"
#include "algo/survey_pass.h"
#include "base/limits.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

class MapLanes {
 public:
  explicit MapLanes(const MapSums& sums) : sums_(sums), x_(f16(0.0F)), y_(f16(0.0F)), r_(f16(kNone)) {}
  /// Sixteen points in the block's frame and their distances; NaN: nothing to draw there.
  HWY_INLINE void take(const F16& x, const F16& y, const F16& r) {
    static constexpr std::array<float, kLanes> kNumber = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    const M16 turn = lane_numbers() == f16(kNumber[(taken_ + first_) % kLanes]);
    x_ = select(turn, x, x_);
    y_ = select(turn, y, y_);
    r_ = select(turn, r, r_);
    if (++taken_ == kLanes) put();
  }
  /// What was taken goes to the map; also at the end, when not every lane has had its turn: those hold no number.
  HWY_NOINLINE void put() {
    const M16 there = r_ == r_;
    const F16 r = r_;
    r_ = f16(kNone);
    taken_ = 0;
    round_ += 0x9E3779B9U;  // steps of the golden ratio: never the same order for long
    first_ = round_ >> 28U;
    if (sums_.count.empty()) return;
    constexpr std::size_t kCell = limits::kDeviationMapCell_mm;
    constexpr float kCells = 1.0F / static_cast<float>(kCell);
    constexpr auto kColumns = static_cast<float>(limits::kFaceTableX / kCell);
    constexpr float kHalfX = 0.5F * static_cast<float>(limits::kFaceTableX);
    constexpr float kHalfY = 0.5F * static_cast<float>(limits::kFaceTableY);
    // A missing point goes to the first cell, with nothing.
    const F16 cell = floor((keep(there, y_) + f16(kHalfY)) * f16(kCells)) * f16(kColumns) +
                     floor((keep(there, x_) + f16(kHalfX)) * f16(kCells));
    alignas(64) std::array<std::int32_t, kLanes> at;
    alignas(64) std::array<std::int32_t, kLanes> r_nm;
    store(to_int(keep(there, cell)), at.data());
    store(to_int(keep(there, r) * f16(1e6F)), r_nm.data());
    const std::uint32_t lanes = bits(there);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const auto map_cell = static_cast<std::size_t>(at[i]);
      sums_.sum_nm[map_cell] += r_nm[i];
      sums_.count[map_cell] += lanes >> i & 1U;
    }
  }

 private:
  static constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  const MapSums& sums_;
  F16 x_, y_, r_;
  std::uint32_t taken_ = 0;
  std::uint32_t first_ = 0;  ///< lane of the round's first point
  std::uint32_t round_ = 0;
};

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#endif
