// SPDX-License-Identifier: Apache-2.0
//
// Cell numbers and heights are computed for sixteen points at once. The sums are updated point by point, because
// neighbours are in the same cell. The terms of a point are prepared in the layout of the cell: four terms for one
// addition of four numbers, and its height with both signs for one minimum of two. Each addition to a cell would wait
// for the previous one, so eight points sixteen apart, mostly in different cells, are added in turn.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/features/cell_sums.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include <algorithm>
#include <array>

#include "algo/features/cell_sums.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Cell numbers and terms of a group of points.
struct Group {
  alignas(64) std::array<std::int32_t, kCellGroup> cell;
  alignas(64) std::array<std::array<float, 4>, kCellGroup> terms;  ///< x, s, height, its square
  alignas(64) std::array<std::array<float, 2>, kCellGroup> ends;   ///< height, -height

  HWY_INLINE void add_to(std::span<CellSum> cells, std::size_t k) const {
    CellSum& sum = cells[static_cast<std::size_t>(cell[k])];
    const hn::CappedTag<double, 4> four;
    const hn::Rebind<float, decltype(four)> floats;
    for (std::size_t i = 0; i < 4; i += hn::Lanes(four))
      hn::StoreU(hn::Add(hn::LoadU(four, &sum.sums[i]), hn::PromoteTo(four, hn::LoadU(floats, &terms[k][i]))), four,
                 &sum.sums[i]);
    const hn::CappedTag<float, 2> two;
    for (std::size_t i = 0; i < 2; i += hn::Lanes(two))
      hn::StoreU(hn::Min(hn::LoadU(two, &sum.ends[i]), hn::LoadU(two, &ends[k][i])), two, &sum.ends[i]);
    ++sum.points;
  }
};

class CellOf {
 public:
  explicit CellOf(const CellLayout& l)
      : half_x_(f16(l.half_x_mm)),
        half_s_(f16(l.half_s_mm)),
        cells_per_mm_(f16(l.cells_per_mm)),
        column_max_(f16(static_cast<float>(l.columns - 1))),
        row_max_(f16(static_cast<float>(l.rows - 1))),
        columns_(i16(l.columns)),
        by_x_(f16(l.by_x)),
        by_s_(f16(l.by_s)),
        by_h_(f16(l.by_h)),
        offset_(f16(l.offset_mm)) {}

  /// Computes the group of kCellGroup points.
  HWY_INLINE CellRange place(const float* x, const float* s, const float* h, Group& group) const {
    I16 least = i16(std::numeric_limits<std::int32_t>::max());
    I16 most = i16(0);
    for (std::size_t i = 0; i < kCellGroup; i += kLanes) {
      const F16 px = load(x + i);
      const F16 ps = load(s + i);
      const F16 column = min(max((px + half_x_) * cells_per_mm_, f16(0.0F)), column_max_);
      const F16 row = min(max((ps + half_s_) * cells_per_mm_, f16(0.0F)), row_max_);
      const I16 cell = to_int(row) * columns_ + to_int(column);
      store(cell, group.cell.data() + i);
      const F16 height = by_x_ * px + by_s_ * ps + by_h_ * load(h + i) + offset_;
      store_interleaved(px, ps, height, height * height, group.terms[i].data());
      store_interleaved(height, f16(0.0F) - height, group.ends[i].data());
      least = min(least, cell);
      most = max(most, cell);
    }
    alignas(64) std::array<std::int32_t, kLanes> low;
    alignas(64) std::array<std::int32_t, kLanes> high;
    store(least, low.data());
    store(most, high.data());
    for (std::size_t half = kLanes / 2; half > 0; half /= 2) {
      for (std::size_t i = 0; i < half; ++i) {
        low[i] = std::min(low[i], low[i + half]);
        high[i] = std::max(high[i], high[i + half]);
      }
    }
    return {static_cast<std::uint16_t>(low[0]), static_cast<std::uint16_t>(high[0])};
  }

 private:
  F16 half_x_, half_s_, cells_per_mm_, column_max_, row_max_;
  I16 columns_;
  F16 by_x_, by_s_, by_h_, offset_;
};

/// The same for fewer than kCellGroup points: they are repeated until the group is full.
CellRange place_few(const SeatPoints& points, const CellOf& placing, Group& group) {
  if (points.size() == kCellGroup) return placing.place(points.x.data(), points.s.data(), points.h.data(), group);
  std::array<float, kCellGroup> x;
  std::array<float, kCellGroup> s;
  std::array<float, kCellGroup> h;
  for (std::size_t k = 0, from = 0; k < kCellGroup; ++k, from = from + 1 == points.size() ? 0 : from + 1) {
    x[k] = points.x[from];
    s[k] = points.s[from];
    h[k] = points.h[from];
  }
  return placing.place(x.data(), s.data(), h.data(), group);
}

void AddToCells(const SeatPoints& points, const CellLayout& layout, std::span<CellSum> cells,
                std::span<CellRange> ranges) {
  constexpr std::size_t kQuarter = kCellGroup / 4;
  const CellOf placing(layout);
  std::array<Group, 2> pair;
  std::size_t i = 0;
  std::size_t g = 0;
  while (i + kCellGroup <= points.size()) {
    const std::size_t groups = i + pair.size() * kCellGroup <= points.size() ? pair.size() : 1;
    for (std::size_t p = 0; p < groups; ++p, ++g, i += kCellGroup)
      ranges[g] = placing.place(&points.x[i], &points.s[i], &points.h[i], pair[p]);
    for (std::size_t k = 0; k < kQuarter; ++k)
      for (std::size_t p = 0; p < groups; ++p)
        for (std::size_t first = 0; first < kCellGroup; first += kQuarter) pair[p].add_to(cells, first + k);
  }
  if (i == points.size()) return;
  const std::size_t left = points.size() - i;
  Group& group = pair[0];
  ranges[g] = place_few({points.x.subspan(i), points.s.subspan(i), points.h.subspan(i)}, placing, group);
  for (std::size_t k = 0; k < left; ++k) group.add_to(cells, k);
}

void PlaceInCells(const SeatPoints& points, const CellLayout& layout, std::span<std::int32_t> cells,
                  std::span<float> heights) {
  Group group;
  place_few(points, CellOf(layout), group);
  std::copy_n(group.cell.begin(), points.size(), cells.begin());
  for (std::size_t k = 0; k < points.size(); ++k) heights[k] = group.terms[k][2];
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(AddToCells);
HWY_EXPORT(PlaceInCells);

void add_to_cells(const SeatPoints& points, const CellLayout& layout, std::span<CellSum> cells,
                  std::span<CellRange> ranges) {
  HWY_DYNAMIC_DISPATCH(AddToCells)(points, layout, cells, ranges);
}

void place_in_cells(const SeatPoints& points, const CellLayout& layout, std::span<std::int32_t> cells,
                    std::span<float> heights) {
  if (points.size() == 0) return;
  HWY_DYNAMIC_DISPATCH(PlaceInCells)(points, layout, cells, heights);
}

}  // namespace slabd::algo
#endif
