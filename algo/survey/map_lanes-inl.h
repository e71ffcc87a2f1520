// SPDX-License-Identifier: Apache-2.0
//
// The map of deviations as a pass fills it (algo/survey/survey_pass.h, MapSums). Not a header of the room: kernels
// include it after algo/lanes-inl.h.
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
#include "algo/survey/survey_pass.h"
#include "base/limits.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

class MapLanes {
 public:
  explicit MapLanes(const MapSums& sums) : sums_(sums) { begin(); }
  /// Sixteen points in the block's frame and their distances; NaN: nothing to draw there.
  HWY_INLINE void take(const F16& x, const F16& y, const F16& r) {
    static constexpr std::array<float, kLanes> kNumber = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    const std::size_t round = taken_ / kLanes;
    const M16 turn = lane_numbers() == f16(kNumber[(taken_ + first_[round]) % kLanes]);
    x_[round] = select(turn, x, x_[round]);
    y_[round] = select(turn, y, y_[round]);
    r_[round] = select(turn, r, r_[round]);
    if (++taken_ == kRounds * kLanes) put();
  }
  /// What was taken goes to the map; also at the end, when not every lane has had its turn: those hold no number.
  HWY_NOINLINE void put() {
    if (!sums_.count.empty())
      for (std::size_t round = 0; round < kRounds; ++round) put(x_[round], y_[round], r_[round]);
    begin();
  }

 private:
  static constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  /// Gathered before the map is looked at: its cells and what the caller works with do not fit the registers together.
  static constexpr std::size_t kRounds = 16;

  HWY_INLINE void begin() {
    taken_ = 0;
    for (std::size_t round = 0; round < kRounds; ++round) {
      x_[round] = y_[round] = f16(0.0F);
      r_[round] = f16(kNone);
      first_[round] = turn_ >> 28U;
      turn_ += 0x9E3779B9U;  // steps of the golden ratio: never the same order for long
    }
  }
  HWY_INLINE void put(const F16& x, const F16& y, const F16& r) const {
    const M16 there = r == r;
    constexpr std::size_t kCell = limits::kDeviationMapCell_mm;
    constexpr float kCells = 1.0F / static_cast<float>(kCell);
    constexpr auto kColumns = static_cast<float>(limits::kFaceTableX / kCell);
    constexpr float kHalfX = 0.5F * static_cast<float>(limits::kFaceTableX);
    constexpr float kHalfY = 0.5F * static_cast<float>(limits::kFaceTableY);
    constexpr auto kRows = static_cast<float>(limits::kFaceTableY / kCell);
    // A missing point goes to the first cell, with nothing. The last place below an edge is the edge once half the
    // field is added.
    const F16 row = min(floor((keep(there, y) + f16(kHalfY)) * f16(kCells)), f16(kRows - 1.0F));
    const F16 column = min(floor((keep(there, x) + f16(kHalfX)) * f16(kCells)), f16(kColumns - 1.0F));
    const F16 cell = row * f16(kColumns) + column;
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

  const MapSums& sums_;
  std::array<F16, kRounds> x_, y_, r_;
  std::array<std::uint32_t, kRounds> first_;  ///< lane of each round's first point
  std::uint32_t turn_ = 0;
  std::size_t taken_ = 0;
};

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#endif
