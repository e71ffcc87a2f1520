// SPDX-License-Identifier: Apache-2.0
//
// The pass of algo/features/cell_sums against a plain one, cell by cell, with every instruction set.
#include "algo/features/cell_sums.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "plain_kernels.h"
#include "point_arrays.h"
#include "tests/algo/each_set.h"

namespace slabd::algo {
namespace {

using slabd::testing::kHuge;
using slabd::testing::kInf;
using slabd::testing::kNaN;
using slabd::testing::kTiny;
using slabd::testing::on_each_set;
using Points = slabd::testing::PointArrays;

/// Around sixteen, around a group of 64 and around the pairs of groups that are added together.
const std::vector<std::size_t> kCounts = {0,   1,   2,   15,  16,  17,  33,  48,  63,  64,  65,   79,    80,
                                          127, 128, 129, 191, 192, 193, 255, 256, 257, 320, 1000, 10'007};

/// Cells of two millimetres and points in quarters: on borders of cells, outside the table, and all results are exact.
const CellLayout kQuarters = {12.0F, 9.0F, 0.5F, 12, 9, 0.25F, -0.5F, 1.0F, 0.125F};
Points in_quarters(std::size_t count) {
  Points points;
  Prng prng(21);
  const auto quarters = [&](std::uint64_t most) {
    return 0.25F * (static_cast<float>(prng.below(2 * most + 1)) - static_cast<float>(most));
  };
  for (std::size_t i = 0; i < count; ++i) points.add(quarters(56), quarters(44), quarters(12));
  return points;
}

/// A seat row by row, as in a scan, with positions that are absurd, on borders or nearly zero.
const CellLayout kSeat = {51.0F, 75.0F, 1.0F / 1.5F, 68, 100, 0.004F, -0.007F, 1.0F, -0.13F};
Points rough(std::size_t count) {
  Points points;
  Prng prng(22);
  for (std::size_t i = 0; i < count; ++i) {
    const float x = 0.25F * static_cast<float>(i % 412) - 51.5F;
    const float s = 0.7F * static_cast<float>(i / 412) + static_cast<float>(0.1 * prng.uniform()) - 8.0F;
    const auto h = static_cast<float>(prng.uniform() < 0.1 ? 10.0 * prng.normal() : 0.03 * prng.normal());
    switch (prng.below(30)) {
      case 0: points.add(prng.below(2) == 0 ? kHuge : -kHuge, s, h); break;
      case 1: points.add(x, prng.below(2) == 0 ? kHuge : -kHuge, h); break;
      case 2: points.add(-51.0F, 75.0F, -0.0F); break;
      case 3: points.add(51.0F, -75.0F, 0.0F); break;
      case 4: points.add(-0.0F, kTiny, -kTiny); break;
      case 5: points.add(std::nextafter(-51.0F, -kHuge), std::nextafter(75.0F, kHuge), h); break;
      case 6: points.add(x, s, prng.below(2) == 0 ? 1e20F : -1e20F); break;
      default: points.add(x, s, h);
    }
  }
  return points;
}

/// Result of a pass over `points` with non-empty cells, and values that it must not change.
struct Passed {
  std::vector<CellSum> cells;
  std::vector<CellRange> ranges;

  Passed(const SeatPoints& points, const CellLayout& layout) {
    const auto table = static_cast<std::size_t>(layout.columns * layout.rows);
    const std::size_t groups = (points.size() + kCellGroup - 1) / kCellGroup;
    CellSum beside;
    beside.add(1.0F, 2.0F, 3.0F);
    cells.assign(table + 1, beside);
    std::fill(cells.begin(), cells.begin() + static_cast<std::ptrdiff_t>(table), CellSum{});
    ranges.assign(groups + 1, CellRange{7, 3});
    add_to_cells(points, layout, std::span(cells).first(table), std::span(ranges).first(groups));
    EXPECT_EQ(cells.back().sums, beside.sums) << "beyond the table";
    EXPECT_EQ(ranges.back().first, 7) << "beyond the groups";
    EXPECT_EQ(ranges.back().last, 3);
    cells.pop_back();
    ranges.pop_back();
  }
};

bool same_bits(const std::vector<CellSum>& a, const std::vector<CellSum>& b) {
  for (std::size_t c = 0; c < a.size(); ++c)
    if (std::memcmp(&a[c].sums, &b[c].sums, sizeof a[c].sums) != 0 ||
        std::memcmp(&a[c].ends, &b[c].ends, sizeof a[c].ends) != 0)
      return false;
  return true;
}

/// `exact`: all sums are exact. Otherwise the order of additions changes the rounding.
void expect_the_plain_cells(const SeatPoints& points, const CellLayout& layout, bool exact) {
  std::vector<plain::PlainCell> plain(static_cast<std::size_t>(layout.columns * layout.rows));
  std::vector<CellRange> ranges((points.size() + kCellGroup - 1) / kCellGroup);
  plain::add_to_cells(points, layout, plain, ranges);
  const Passed first(points, layout);
  on_each_set([&] {
    const Passed fast(points, layout);
    EXPECT_TRUE(same_bits(fast.cells, first.cells));
    for (std::size_t c = 0; c < plain.size(); ++c) {
      ASSERT_EQ(fast.cells[c].points, plain[c].points) << c;
      ASSERT_EQ(fast.cells[c].low(), plain[c].low) << c;
      ASSERT_EQ(fast.cells[c].high(), plain[c].high) << c;
      ASSERT_EQ(fast.cells[c].heights_at, CellSum::kNowhere) << c;
      for (std::size_t k = 0; k < plain[c].sums.size(); ++k) {
        const double off = exact ? 0.0 : 0x1p-52 * plain[c].points * plain[c].sizes[k];
        const bool same = fast.cells[c].sums[k] == plain[c].sums[k];  // also both infinite
        ASSERT_TRUE(same || std::abs(fast.cells[c].sums[k] - plain[c].sums[k]) <= off) << c << ' ' << k;
      }
    }
    for (std::size_t g = 0; g < ranges.size(); ++g) {
      ASSERT_EQ(fast.ranges[g].first, ranges[g].first) << g;
      ASSERT_EQ(fast.ranges[g].last, ranges[g].last) << g;
    }
  });
}

TEST(CellSums, equal_those_of_a_plain_loop_for_exact_numbers) {
  const Points points = in_quarters(kCounts.back() + 3);
  for (const std::size_t count : kCounts) {
    for (const std::size_t first : {std::size_t{0}, std::size_t{3}}) {
      SCOPED_TRACE(std::to_string(count) + " from " + std::to_string(first));
      expect_the_plain_cells(points.part(first, count), kQuarters, true);
    }
  }
}

TEST(CellSums, are_those_of_a_plain_loop_up_to_the_order_of_additions) {
  const Points points = rough(kCounts.back() + 3);
  for (const std::size_t count : kCounts) {
    for (const std::size_t first : {std::size_t{0}, std::size_t{3}}) {
      SCOPED_TRACE(std::to_string(count) + " from " + std::to_string(first));
      expect_the_plain_cells(points.part(first, count), kSeat, false);
    }
  }
}

TEST(CellSums, take_a_table_of_one_cell_one_row_or_one_column) {
  const Points points = in_quarters(300);
  for (const auto& [columns, rows] : {std::pair(1, 1), std::pair(1, 9), std::pair(12, 1)}) {
    CellLayout layout = kQuarters;
    layout.columns = columns;
    layout.rows = rows;
    SCOPED_TRACE(std::to_string(columns) + " x " + std::to_string(rows));
    expect_the_plain_cells(points.part(0, 300), layout, true);
  }
}

TEST(CellSums, count_each_point_once_at_any_position) {
  for (const std::size_t count : {1U, 15U, 17U, 63U, 64U, 65U, 129U, 191U, 193U}) {
    for (std::size_t at = 0; at < count; ++at) {
      SCOPED_TRACE(std::to_string(at) + " of " + std::to_string(count));
      Points points;
      for (std::size_t i = 0; i < count; ++i) points.add(i == at ? 11.0F : -5.0F, i == at ? 8.0F : -5.0F, 1.0F);
      points.add(11.0F, 8.0F, 9.0F);  // after the end
      on_each_set([&] {
        const Passed fast(points.part(0, count), kQuarters);
        EXPECT_EQ(fast.cells.back().points, 1U);
        EXPECT_EQ(fast.cells.back().sums, (std::array<double, 4>{11.0, 8.0, -0.125, 0.015625}));
        for (std::size_t g = 0; g < fast.ranges.size(); ++g) {
          const bool alone = at / kCellGroup == g && count - g * kCellGroup == 1;
          EXPECT_EQ(fast.ranges[g].first, alone ? 107 : 2 * 12 + 3) << g;
          EXPECT_EQ(fast.ranges[g].last, at / kCellGroup == g ? 107 : 2 * 12 + 3) << g;
        }
      });
    }
  }
}

TEST(CellSums, place_a_group_of_any_size_as_a_plain_loop_does) {
  const std::array<Points, 2> kinds = {in_quarters(200), rough(200)};
  for (std::size_t kind = 0; kind < kinds.size(); ++kind) {
    const CellLayout& layout = kind == 0 ? kQuarters : kSeat;
    for (std::size_t count = 0; count <= kCellGroup; ++count) {
      SCOPED_TRACE(std::to_string(count) + (kind == 0 ? " in quarters" : " rough"));
      const SeatPoints points = count == 0 ? SeatPoints{} : kinds[kind].part(count, count);
      on_each_set([&] {
        std::array<std::int32_t, kCellGroup> cells;
        std::array<float, kCellGroup> heights;
        place_in_cells(points, layout, cells, heights);
        for (std::size_t i = 0; i < count; ++i) {
          EXPECT_EQ(cells[i], plain::cell_of(layout, points.x[i], points.s[i])) << i;
          const float height = plain::height_in_cell(layout, points.x[i], points.s[i], points.h[i]);
          EXPECT_EQ(std::memcmp(&heights[i], &height, sizeof height), 0) << i;
        }
      });
    }
  }
}

/// Runs contain only finite values. Other values would corrupt their cell but no other memory.
TEST(CellSums, keep_values_that_are_not_numbers_within_the_table) {
  for (const float odd : {kNaN, -kNaN, kInf, -kInf}) {
    for (const std::size_t count : {1U, 64U, 100U, 200U}) {
      for (int kind = 0; kind < 4; ++kind) {
        Points points = in_quarters(count);
        for (std::size_t i = kind == 3 ? 0 : 5; i < count; i += 3) {
          if (kind != 1) points.x[i] = odd;
          if (kind != 0) points.s[i] = odd;
          if (kind == 2) points.h[i] = odd;
        }
        on_each_set([&] {
          const Passed fast(points.part(0, count), kQuarters);
          std::size_t in_cells = 0;
          for (const CellSum& cell : fast.cells) in_cells += cell.points;
          EXPECT_EQ(in_cells, count);
          for (const CellRange& range : fast.ranges) EXPECT_LT(range.last, fast.cells.size());
        });
      }
    }
  }
}

}  // namespace
}  // namespace slabd::algo
