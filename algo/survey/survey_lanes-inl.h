// SPDX-License-Identifier: Apache-2.0
//
// The map of deviations and the surface raster as a pass fills them (algo/survey/survey_pass.h, MapSums;
// algo/survey/surface_raster.h). Not a header of the room: kernels include it after algo/lanes-inl.h.
#if defined(SLABD_ALGO_SURVEY_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLABD_ALGO_SURVEY_LANES_INL_H_
#undef SLABD_ALGO_SURVEY_LANES_INL_H_
#else
#define SLABD_ALGO_SURVEY_LANES_INL_H_
#endif

#include <array>
#include <cstdint>
#include <limits>

#include "algo/lanes-inl.h"
#include "algo/survey/surface_raster.h"
#include "algo/survey/survey_pass.h"
#include "base/limits.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

// ---- the map of deviations ------------------------------------------------------------------------------------------

// One point of each sixteen goes to the map, another lane each time, and beginning with another one in each round of
// sixteen: lanes in one order would come back to the same columns wherever a row is a multiple of 256 points long.
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

// ---- the surface raster ---------------------------------------------------------------------------------------------

// A few points in each cell are enough. Of an organised scan every second or fourth point is taken, each row shifted
// against the one before: all columns count alike, because a column that does not looks like a crack without points.
// Without a grid the points are as good as drawn, which scatters more, so twice as many are taken.
class SurfaceLanes {
 public:
  explicit SurfaceLanes(const SurfaceSums& sums)
      : cells_(sums.cells.data()),
        used_(!sums.cells.empty()),
        turns_(static_cast<std::uint32_t>(kLanes / sums.lanes)),
        width_(sums.width),
        first_(sums.first),
        per_width_(sums.width == 0 ? 0.0 : 1.0 / static_cast<double>(sums.width)) {}
  /// The `number`-th sixteen points in the block's frame and their distances; NaN: nothing was seen there.
  HWY_INLINE void take(std::size_t number, const F16& x, const F16& y, const F16& r) {
    if (!used_) return;
    M16 in = (abs(x) < f16(kHalfX)) & (abs(y) < f16(kHalfY)) & (r == r);
    if (!any(in)) return;
    if (turns_ > 1) in = in & lanes_of(lanes(number));
    const std::size_t taken = store_set(in, x, x_.data() + count_);
    store_set(in, y, y_.data() + count_);
    store_set(in, r, r_.data() + count_);
    count_ += taken;
    if (count_ >= kLanes) put_first();
  }
  HWY_NOINLINE void flush() {
    if (!used_ || count_ == 0) return;
    for (std::size_t i = count_; i < kLanes; ++i) r_[i] = std::numeric_limits<float>::quiet_NaN();
    put(load(x_.data()), load(y_.data()), load(r_.data()));
    count_ = 0;
  }

 private:
  static constexpr auto kHalfX = static_cast<float>(kSurfaceHalfX_mm);
  static constexpr auto kHalfY = static_cast<float>(kSurfaceHalfY_mm);
  using Four = std::array<std::int32_t, 4>;
  using Waiting = std::array<float, 3 * kLanes>;

  static HWY_INLINE void put_together(const Pack<std::int32_t, 1>& units, const Pack<std::int32_t, 1>& one, Four* to) {
    const Tag<std::int32_t> tag;
    hn::StoreInterleaved4(units.v, hn::Mul(units.v, units.v), one.v, hn::Zero(tag), tag, to->data());
  }
  template <std::size_t K>
  static HWY_INLINE void put_together(const Pack<std::int32_t, K>& units, const Pack<std::int32_t, K>& one, Four* to) {
    put_together(units.lo, one.lo, to);
    put_together(units.hi, one.hi, to + kLanes / kRegisters<std::int32_t> * K / 2);
  }
  /// Which of sixteen points are taken.
  [[nodiscard]] HWY_INLINE std::uint32_t lanes(std::size_t number) {
    const std::uint32_t every = turns_ == 4 ? 0x1111U : 0x5555U;
    if (width_ == 0) {
      step_ += 0x9E3779B9U;  // steps of the golden ratio
      return every << (step_ >> 30U & (turns_ - 1U)) & 0xffffU;
    }
    const std::size_t point = first_ + kLanes * number;
    // Within a row the lanes stay the same, because sixteen is a multiple of the turns.
    if (point < row_end_) return of_row_;
    const auto row = static_cast<std::size_t>(static_cast<double>(point) * per_width_);
    const auto column = static_cast<std::uint32_t>(point - row * width_);
    // Rows take turns: 0, 2, 1, 3.
    const auto shift = static_cast<std::uint32_t>(turns_ == 4 ? 0b11011000U >> (2 * (row & 3U)) & 3U : row & 1U);
    row_end_ = point - column + width_;
    of_row_ = every << ((0U - column - shift) & (turns_ - 1U)) & 0xffffU;
    return of_row_;
  }
  HWY_NOINLINE void put_first() {
    put(load(x_.data()), load(y_.data()), load(r_.data()));
    count_ -= kLanes;
    for (Waiting* list : {&x_, &y_, &r_}) store(load(list->data() + kLanes), list->data());
  }
  HWY_NOINLINE void put(const F16& x, const F16& y, const F16& r) const {
    const M16 there = (r == r) & (abs(x) < f16(kHalfX)) & (abs(y) < f16(kHalfY));
    constexpr auto kCells = static_cast<float>(1.0 / kSurfaceCell_mm);
    constexpr auto kColumns = static_cast<float>(kSurfaceColumns);
    constexpr auto kRows = static_cast<float>(kSurfaceRows);
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
    // Neighbours lie in the same cell and would wait for each other's sum: so not in their order, which does not
    // matter.
    for (std::size_t k = 0; k < kLanes; ++k) {
      const std::size_t i = 5 * k % kLanes;
      auto* cell = reinterpret_cast<std::int32_t*>(cells_ + at[i]);
      const hn::CappedTag<std::int32_t, 4> four;
      for (std::size_t part = 0; part < 4; part += hn::MaxLanes(four))
        hn::Store(hn::Add(hn::Load(four, cell + part), hn::Load(four, points[i].data() + part)), four, cell + part);
    }
  }

  SurfaceCell* cells_;
  bool used_;
  std::uint32_t turns_;
  std::size_t width_;
  std::size_t first_;
  double per_width_;
  std::size_t row_end_ = 0;  ///< `of_row_` holds for points before this one
  std::uint32_t of_row_ = 0;
  std::uint32_t step_ = 0;
  std::size_t count_ = 0;  ///< points that wait to be put to the raster
  alignas(64) Waiting x_{}, y_{}, r_{};
};

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#endif
