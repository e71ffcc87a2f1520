// SPDX-License-Identifier: Apache-2.0
//
// Height of a cell whose points disagree; algo/features/flatness.cpp has the reasons. Sums are enough for nearly all
// cells. Only if they allow for a stray are single heights fetched, by a second pass over the few groups of points in
// such cells. If strays were found, a third pass sums the kept points. The memory of the second half's sums is reused
// for the rest: nothing is allocated.
#include "algo/features/seat_cells.h"

#include <array>
#include <cmath>

#include "algo/median.h"

namespace slabd::algo {
namespace {

/// Maximum number of points of a cell for its median; a cell of a dense scan contains about 80.
constexpr std::size_t kCellSampleMax = 512;
/// A stray is this many robust deviations from its cell's median, and at least kStrayMin_mm.
constexpr double kStraySigmas = 5.0;
/// Scatter of a cell up to this factor above that of most cells counts as noise.
constexpr double kNoisierCell = 3.0;
/// A drop as wide as a pit is at most this high; anything higher is something else.
constexpr double kDropHigh_mm = 1.5;
/// Water returns one point in ten to one in three; a half-covered cell returns more.
constexpr double kDropShareMax = 0.4;
/// Fewer connected sparse cells are chance.
constexpr std::size_t kDropCellsMin = 4;
/// Minimum share of the usual points in the seat around a drop, and the width of that ring in cells.
constexpr double kDropAroundMin = 0.7;
constexpr std::size_t kDropRing = 2;
/// Number of cells sampled for the scatter.
constexpr std::size_t kScatterSample = 512;

/// Calls f(piece, first group) for the groups [from, to) of all runs, in pieces as long as possible.
template <typename F>
void for_groups(std::span<const SeatPoints> runs, std::size_t from, std::size_t to, const F& f) {
  std::size_t first = 0;  // of the current run
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const SeatPoints& run = runs[r];
    if (r + 1 < runs.size()) runs[r + 1].ask_for();
    const std::size_t groups = (run.size() + kCellGroup - 1) / kCellGroup;
    const std::size_t begin = std::max(first, from);
    const std::size_t end = std::min(first + groups, to);
    if (begin < end) {
      const std::size_t at = (begin - first) * kCellGroup;
      const std::size_t count = std::min((end - first) * kCellGroup, run.size()) - at;
      f(SeatPoints{run.x.subspan(at, count), run.s.subspan(at, count), run.h.subspan(at, count)}, begin);
    }
    first += groups;
  }
}

/// True if a point of this cell may be further than kStrayMin_mm from the cell's median. Mean and median differ by at
/// most one standard deviation for any points. So the median is not needed for nearly all cells.
bool may_have_strays(const CellSum& sum) {
  const CellPoints cell(sum);
  const double std = std::sqrt(cell.squares / static_cast<double>(sum.points));
  return static_cast<double>(sum.high()) - (cell.height - std) > kStrayMin_mm ||
         (cell.height + std) - static_cast<double>(sum.low()) > kStrayMin_mm;
}

/// Median and robust deviation of up to kCellSampleMax heights, sampled evenly.
struct CellCentre {
  double median;
  double sigma;
};
CellCentre centre_of(std::span<const float> heights) {
  std::array<double, kCellSampleMax> h{};
  const std::size_t m = std::min(heights.size(), h.size());
  for (std::size_t i = 0; i < m; ++i) h[i] = static_cast<double>(heights[i * heights.size() / m]);
  const double median = median_of(std::span(h).first(m));
  for (std::size_t i = 0; i < m; ++i) h[i] = std::abs(h[i] - median);
  return {median, 1.4826 * median_of(std::span(h).first(m))};
}

/// Number of strays of one side, in a cell of `points`, that is not chance. Noise with long tails has one in a hundred,
/// and connected cells with one each would be all over the seat.
double many_strays(std::uint32_t points) {
  return std::fmax(2.0, 0.05 * static_cast<double>(points));
}

}  // namespace

SeatCells::SeatCells(std::span<const SeatPoints> runs, const CellLayout& layout, const FlatnessWorkspace& work)
    : runs_(runs),
      layout_(layout),
      work_(work),
      sums_(work.sums.first(static_cast<std::size_t>(layout.columns) * static_cast<std::size_t>(layout.rows))),
      rest_(work.sums.subspan(sums_.size(), sums_.size())) {}

void SeatCells::sum_up(Team& team) {
  std::size_t groups = 0;
  for (const SeatPoints& run : runs_) groups += (run.size() + kCellGroup - 1) / kCellGroup;
  const std::span<CellSum> second = rest_;  // no damage is known yet
  team.run(2, [&](std::size_t half) {
    const std::span<CellSum> sums = half == 0 ? sums_ : second;
    std::fill(sums.begin(), sums.end(), CellSum{});
    for_groups(runs_, half == 0 ? 0 : groups / 2, half == 0 ? groups / 2 : groups,
               [&](const SeatPoints& piece, std::size_t first) {
                 add_to_cells(piece, layout_, sums, work_.ranges.subspan(first));
               });
  });
  for (std::size_t c = 0; c < sums_.size(); ++c) sums_[c].add(second[c]);
}

void SeatCells::fetch_heights(const CellGrid& grid) {
  const std::uint32_t points_min = grid.region.cell_points_min;
  const auto wanted = [&](std::size_t c) {
    return sums_[c].points >= std::max(points_min, 1U) ? may_have_strays(sums_[c])
                                                       : sums_[c].points >= few_of(points_min) && grid.expected(c);
  };
  std::uint32_t total = 0;
  for (std::size_t c = 0; c < sums_.size(); ++c) {
    if (!wanted(c)) continue;
    sums_[c].heights_at = total;
    total += sums_[c].points;
  }
  for_points_of([](const CellSum& sum) { return sum.heights_at != CellSum::kNowhere; },
                [&](CellSum& sum, float, float, float h) { work_.heights[sum.heights_at + sum.heights++] = h; });
}

void SeatCells::remove_strays(const CellGrid& grid, std::span<std::uint32_t> mark) {
  const std::uint32_t points_min = grid.region.cell_points_min;
  fetch_heights(grid);
  double points = 0.0;
  double full = 0.0;
  const double usual_sigma = scatter_in_full_cells(points_min);
  for (CellSum& sum : sums_) {
    sum.keep_low = 1.0F;
    sum.keep_high = 0.0F;
    if (sum.points >= points_min) {
      points += static_cast<double>(sum.points);
      full += 1.0;
    }
    if (sum.heights_at == CellSum::kNowhere) continue;
    const std::span<const float> all = heights(sum);
    const CellCentre centre = centre_of(all);
    // A cell that is half damage has the scatter of the damage, and a cell of five points cannot identify a stray among
    // them. Therefore both limits use the usual scatter.
    const double sigma = std::fmin(centre.sigma, (sum.points < points_min ? 1.0 : kNoisierCell) * usual_sigma);
    const double reach = std::max(kStraySigmas * sigma, kStrayMin_mm);
    const auto stray = [&](float h) { return std::abs(static_cast<double>(h) - centre.median) > reach; };
    if (std::none_of(all.begin(), all.end(), stray)) continue;
    sum.keep_low = static_cast<float>(centre.median - reach);
    sum.keep_high = static_cast<float>(centre.median + reach);
  }
  const double usual_points = points / std::fmax(full, 1.0);
  const double half_a_cell = 0.5 * usual_points;
  find_drops(usual_points, grid, mark);
  find_damage(kHigh, half_a_cell, grid, mark, high_);
  find_damage(kLow, half_a_cell, grid, mark, low_);
  for (CellSum& sum : sums_) {
    if (sum.keep_low > sum.keep_high) continue;
    divide(sum);
    sum.sums.fill(0.0);
    sum.points = 0;
    rest_of(sum).sums.fill(0.0);
    rest_of(sum).points = 0;
  }
  for_points_of([](const CellSum& sum) { return sum.keep_low <= sum.keep_high; },
                [&](CellSum& sum, float x, float s, float h) {
                  CellSum& rest = rest_of(sum);
                  if (h >= sum.keep_low && h <= sum.keep_high)
                    sum.add(x, s, h);
                  else if (h >= rest.keep_low && h <= rest.keep_high)
                    rest.add(x, s, h);
                });
}

CellSum& SeatCells::rest_of(const CellSum& sum) const {
  return rest_[static_cast<std::size_t>(&sum - sums_.data())];
}

double SeatCells::scatter_in_full_cells(std::uint32_t points_min) const {
  std::array<double, kScatterSample> sigma;
  std::size_t full = 0;
  const std::size_t step = sums_.size() / kScatterSample + 1;
  for (std::size_t c = 0; c < sums_.size(); c += step)
    if (const CellSum& sum = sums_[c]; sum.points >= std::max(points_min, 2U))
      sigma[full++] = std::sqrt(CellPoints(sum).squares / static_cast<double>(sum.points - 1));
  return full > 0 ? median_of(std::span(sigma).first(full)) : kNoValue;
}

SeatCells::StrayGroups SeatCells::strays_in(const CellSum& sum, CellMark side) const {
  // Strays closer to the seat than the rest of their cell are the seat next to damage, not damage.
  const float mirrored = -0.5F * (sum.keep_low + sum.keep_high);
  const float high = std::max(sum.keep_high, mirrored);
  const float low = std::min(sum.keep_low, mirrored);
  StrayGroups strays;
  for (const float h : heights(sum)) {
    if (side == kHigh ? !(h > high) : !(h < low)) continue;
    ++strays.points;
    strays.sum += static_cast<double>(h);
  }
  return strays;
}

void SeatCells::find_drops(double usual_points, const CellGrid& grid, std::span<std::uint32_t> mark) {
  wet_.reset();
  beside_wet_.reset();
  const auto share = [&](std::size_t c) { return static_cast<double>(sums_[c].points) / usual_points; };
  const auto stands_out = [&](std::size_t c) {
    if (sums_[c].points == 0) return false;
    const double height = CellPoints(sums_[c]).height;
    return height > kStrayMin_mm && height < kDropHigh_mm;
  };
  for (std::size_t c = 0; c < sums_.size(); ++c) {
    const bool sparse = share(c) < kDropShareMax && (sums_[c].points == 0 || stands_out(c));
    mark[c] = sparse && grid.expected(c) ? kHigh : kPlain;
  }
  for_each_group(grid, kHigh, mark, work_.stack, [&](std::span<const std::uint32_t> group) {
    if (group.size() < kDropCellsMin || std::none_of(group.begin(), group.end(), stands_out)) return;
    std::size_t left = grid.columns, right = 0, bottom = grid.rows, top = 0;
    for (const std::uint32_t c : group) {
      left = std::min(left, c % grid.columns);
      right = std::max(right, c % grid.columns);
      bottom = std::min(bottom, c / grid.columns);
      top = std::max(top, c / grid.columns);
    }
    if (static_cast<double>(std::max(right - left, top - bottom) + 1) * grid.region.cell_mm > grid.region.closing_mm)
      return;
    const auto for_around = [&](std::size_t reach, const auto& use) {
      for (std::size_t r = bottom - std::min(bottom, reach); r <= std::min(top + reach, grid.rows - 1); ++r)
        for (std::size_t k = left - std::min(left, reach); k <= std::min(right + reach, grid.columns - 1); ++k)
          use(r * grid.columns + k);
    };
    CellSet drop;
    for (const std::uint32_t c : group) drop[c] = true;
    double around = 0.0;
    double cells = 0.0;
    for_around(kDropRing, [&](std::size_t c) {
      if (drop[c] || !grid.expected(c)) return;
      around += share(c);
      cells += 1.0;
    });
    if (!(around >= kDropAroundMin * cells)) return;
    wet_ |= drop;
    for_around(1, [&](std::size_t c) { beside_wet_[c] = true; });
  });
}

void SeatCells::find_damage(CellMark side, double points_min, const CellGrid& grid, std::span<std::uint32_t> mark,
                            CellSet& damage) {
  for (std::size_t c = 0; c < sums_.size(); ++c) {
    const CellSum& sum = sums_[c];
    const bool may_be_water = side == kHigh && (wet_[c] || beside_wet_[c]);
    const bool many = !may_be_water && sum.keep_low <= sum.keep_high &&
                      static_cast<double>(strays_in(sum, side).points) >= many_strays(sum.points);
    mark[c] = many ? side : kPlain;
  }
  for_each_group(grid, side, mark, work_.stack, [&](std::span<const std::uint32_t> group) {
    std::size_t strays = 0;
    for (const std::uint32_t c : group) strays += strays_in(sums_[c], side).points;
    if (static_cast<double>(strays) < points_min) return;
    for (const std::uint32_t c : group) damage[c] = true;
  });
}

void SeatCells::divide(CellSum& sum) {
  CellSum& rest = rest_of(sum);
  const auto c = static_cast<std::size_t>(&sum - sums_.data());
  const std::array<float, 2> middle = {sum.keep_low, sum.keep_high};
  const std::array<float, 2> high = {std::nextafter(sum.keep_high, kAny), kAny};
  const std::array<float, 2> low = {-kAny, std::nextafter(sum.keep_low, -kAny)};
  const bool both = high_[c] && low_[c];
  const bool is_high = high_[c] && (!low_[c] || strays_in(sum, kHigh).height_mm() >= -strays_in(sum, kLow).height_mm());
  const std::array<float, 2>& kept = is_high ? high : low_[c] ? low : middle;
  const std::array<float, 2>& left = !both ? middle : is_high ? low : high;
  sum.keep_low = kept[0];
  sum.keep_high = kept[1];
  rest.keep_low = left[0];
  rest.keep_high = left[1];
}

template <typename Chosen, typename F>
void SeatCells::for_points_of(const Chosen& chosen, const F& f) {
  const std::span<std::uint32_t> before = work_.stack;  // number of chosen cells before each cell
  before[0] = 0;
  for (std::size_t c = 0; c < sums_.size(); ++c) before[c + 1] = before[c] + (chosen(sums_[c]) ? 1U : 0U);
  if (before[sums_.size()] == 0) return;
  for_groups(runs_, 0, std::numeric_limits<std::size_t>::max(), [&](const SeatPoints& piece, std::size_t group) {
    for (std::size_t at = 0; at < piece.size(); at += kCellGroup, ++group) {
      const CellRange range = work_.ranges[group];
      if (before[std::size_t{range.last} + 1] == before[range.first]) continue;
      const std::size_t count = std::min(kCellGroup, piece.size() - at);
      std::array<std::int32_t, kCellGroup> cell;
      std::array<float, kCellGroup> height;
      place_in_cells({piece.x.subspan(at, count), piece.s.subspan(at, count), piece.h.subspan(at, count)}, layout_,
                     cell, height);
      for (std::size_t i = 0; i < count; ++i) {
        const auto c = static_cast<std::size_t>(cell[i]);
        if (before[c + 1] != before[c]) f(sums_[c], piece.x[at + i], piece.s[at + i], height[i]);
      }
    }
  });
}

}  // namespace slabd::algo
