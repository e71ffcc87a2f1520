// SPDX-License-Identifier: Apache-2.0
//
// Sixteen places make sixteen cell numbers and heights at once; adding to the cells goes point by point, since
// neighbours fall into the same cell. That would make each sum wait for the one before. So four points sixteen apart,
// which fall into different cells mostly, are added in turn.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/cell_sums.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include <algorithm>
#include <array>

#include "algo/cell_sums.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Cell numbers and heights of a group.
struct Group {
  alignas(64) std::array<std::int32_t, kCellGroup> cell;
  alignas(64) std::array<float, kCellGroup> height;
};

class Placing {
 public:
  explicit Placing(const CellLayout& l)
      : half_x_(f16(l.half_x_mm)),
        half_s_(f16(l.half_s_mm)),
        cell_(f16(l.cell_mm)),
        column_max_(f16(static_cast<float>(l.columns - 1))),
        row_max_(f16(static_cast<float>(l.rows - 1))),
        columns_(i16(l.columns)),
        by_x_(f16(l.by_x)),
        by_s_(f16(l.by_s)),
        by_h_(f16(l.by_h)),
        offset_(f16(l.offset_mm)) {}

  /// kCellGroup points.
  HWY_INLINE CellRange place(const float* x, const float* s, const float* h, Group& group) const {
    I16 least = i16(std::numeric_limits<std::int32_t>::max());
    I16 most = i16(0);
    for (std::size_t i = 0; i < kCellGroup; i += kLanes) {
      const F16 px = load(x + i);
      const F16 ps = load(s + i);
      const F16 column = min(max((px + half_x_) / cell_, f16(0.0F)), column_max_);
      const F16 row = min(max((ps + half_s_) / cell_, f16(0.0F)), row_max_);
      const I16 cell = to_int(row) * columns_ + to_int(column);
      store(cell, group.cell.data() + i);
      store(by_x_ * px + by_s_ * ps + by_h_ * load(h + i) + offset_, group.height.data() + i);
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
  F16 half_x_, half_s_, cell_, column_max_, row_max_;
  I16 columns_;
  F16 by_x_, by_s_, by_h_, offset_;
};

/// Fewer than kCellGroup points: they stand once more behind themselves.
CellRange place_few(const SeatPoints& points, const Placing& placing, Group& group) {
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
  const Placing placing(layout);
  Group group;
  std::size_t i = 0;
  std::size_t g = 0;
  for (; i + kCellGroup <= points.size(); i += kCellGroup, ++g) {
    const float* x = &points.x[i];
    const float* s = &points.s[i];
    ranges[g] = placing.place(x, s, &points.h[i], group);
    const auto add = [&](std::size_t k) {
      cells[static_cast<std::size_t>(group.cell[k])].add(x[k], s[k], group.height[k]);
    };
    for (std::size_t k = 0; k < kCellGroup / 4; ++k) {
      add(k);
      add(k + kCellGroup / 4);
      add(k + kCellGroup / 2);
      add(k + kCellGroup / 4 * 3);
    }
  }
  if (i == points.size()) return;
  const std::size_t left = points.size() - i;
  ranges[g] = place_few({points.x.subspan(i), points.s.subspan(i), points.h.subspan(i)}, placing, group);
  for (std::size_t k = 0; k < left; ++k)
    cells[static_cast<std::size_t>(group.cell[k])].add(points.x[i + k], points.s[i + k], group.height[k]);
}

void PlaceInCells(const SeatPoints& points, const CellLayout& layout, std::span<std::int32_t> cells,
                  std::span<float> heights) {
  Group group;
  place_few(points, Placing(layout), group);
  std::copy_n(group.cell.begin(), points.size(), cells.begin());
  std::copy_n(group.height.begin(), points.size(), heights.begin());
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
  HWY_DYNAMIC_DISPATCH(PlaceInCells)(points, layout, cells, heights);
}

}  // namespace slabd::algo
#endif
