// SPDX-License-Identifier: Apache-2.0
//
// Denoising of a scan that was exported without its grid. The scanner's rays are evenly spaced all the same: over x and
// y if they are parallel, over x / z and y / z if they come from one point. So the grid can be had back, and a scan
// that has its grid is denoised ten times faster (algo/denoise_grid.cpp).
//
//  1. A sample of some thousand points, sorted along each axis, shows the columns and rows as steps. Their pitch and
//     phase come from a line through the steps; of the two kinds of rays the one with the smaller misfit is believed.
//  2. The height of every point goes into a table of columns and rows. Where two points meet in a cell the lower one
//     stays.
//  3. The table is denoised as an organised scan is.
//  4. Every point is asked for its cell again and taken out if that is noise. One that met a lower one in its cell is
//     kept if it lies on one of the planes there; one outside of the table is noise.
//
// Where the steps are none, where many points meet or lie outside, or most have no plane, there is no lattice, and the
// cloud is left to others.
//
// Invariants: the sample is chosen by what the points are, not by where they stand, and the lower of two points is the
// same whoever comes first, so the order of the points does not matter. The table is filled by one thread; step 4 reads
// the table and changes its own points only.
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <new>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/denoise_lattice.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/denoise_grid.h"
#include "algo/denoise_lattice.h"

#ifndef SLABD_ALGO_DENOISE_LATTICE_ONCE
#define SLABD_ALGO_DENOISE_LATTICE_ONCE
namespace slabd::algo {
namespace {

/// Column of a point: floor((x or x / z - x0) * per_x); rows alike.
struct Lattice {
  bool central = false;  ///< rays through the origin
  float x0 = 0.0F, y0 = 0.0F;
  float per_x = 1.0F, per_y = 1.0F;
  float columns = 0.0F, rows = 0.0F;
};

struct Spread {
  std::uint64_t finite = 0;
  std::uint64_t met = 0;      ///< points that met another one in their cell
  std::uint64_t outside = 0;  ///< of the table
};

/// Points of the sample: about half as many as there is room for.
constexpr std::size_t kSampleMax = 1U << 14U;
constexpr std::size_t kSampleMin = 2'048;
/// Points of step 4 that a thread takes at a time.
constexpr std::size_t kPiece = 1U << 16U;

}  // namespace
}  // namespace slabd::algo
#endif

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

HWY_INLINE Points16 sixteen_points(const float* xyz, std::size_t points, std::size_t i) {
  return points - i >= kLanes ? load_points(xyz + 3 * i) : load_points(xyz + 3 * i, points - i);
}
HWY_INLINE M16 finite_points(const Points16& p) {
  return ((p.x - p.x) + (p.y - p.y) + (p.z - p.z)) == f16(0.0F);
}

/// Where sixteen points belong. Cells of a table are numbers that a float holds exactly.
struct Cells {
  alignas(64) std::array<float, kLanes> column, row, cell, z;
  std::uint32_t finite, inside;
  bool in_line;  ///< all inside, in cells beside each other
  bool in_row;   ///< all inside, from left to right in one row, at most half of it missing
};
static_assert(limits::kScanPointsMax < (1U << 24U));
constexpr float kRowReach = 31.0F;

HWY_INLINE void find_cells(const Lattice& lattice, const Points16& p, Cells& out) {
  const M16 finite = finite_points(p);
  const F16 x = lattice.central ? p.x / p.z : p.x;
  const F16 y = lattice.central ? p.y / p.z : p.y;
  const F16 column = floor((x - f16(lattice.x0)) * f16(lattice.per_x));
  const F16 row = floor((y - f16(lattice.y0)) * f16(lattice.per_y));
  const F16 none = f16(0.0F);
  const M16 inside =
      finite & (column >= none) & (column < f16(lattice.columns)) & (row >= none) & (row < f16(lattice.rows));
  const F16 cell = row * f16(lattice.columns) + column;
  out.finite = bits(finite);
  out.inside = bits(inside);
  store(p.z, out.z.data());
  store(cell, out.cell.data());
  store(column, out.column.data());
  store(row, out.row.data());
  const M16 rising = (row == f16(out.row[0])) & (column >= f16(out.column[0]) + lane_numbers()) &
                     (column <= f16(out.column[0] + kRowReach)) & (column <= f16(out.column[kLanes - 1]));
  out.in_row = out.inside == 0xFFFFU && bits(rising) == 0xFFFFU;
  out.in_line = out.inside == 0xFFFFU && bits(cell == f16(out.cell[0]) + lane_numbers()) == 0xFFFFU;
}

}  // namespace

/// Finite points whose coordinates end in bits that about one in so many (mask + 1, a power of two) has. Returns their
/// number, and their first kSampleMax.
std::size_t take_sample(const float* xyz, std::size_t points, std::int32_t mask, float* x, float* y, float* z) {
  // Round coordinates end in zeros: the bits wanted are others.
  const I16 wanted = i16(0x2AAAAAAA & mask);
  std::size_t n = 0;
  for (std::size_t i = 0; i < points; i += kLanes) {
    const Points16 p = sixteen_points(xyz, points, i);
    const I16 last = bit_and(bit_xor(pattern(p.x), bit_xor(pattern(p.y), pattern(p.z))), i16(mask));
    std::uint32_t chosen = bits(is_zero(bit_xor(last, wanted)));
    if (chosen == 0) continue;
    chosen &= bits(finite_points(p));
    for (; chosen != 0; chosen &= chosen - 1, ++n) {
      if (n >= kSampleMax) continue;
      const float* q = xyz + 3 * (i + static_cast<std::size_t>(std::countr_zero(chosen)));
      x[n] = q[0], y[n] = q[1], z[n] = q[2];
    }
  }
  return n;
}

/// Step 2.
void spread_heights(const Lattice& lattice, const float* xyz, std::size_t points, float* table, Spread& spread) {
  const F16 nothing = f16(kNoPlane);
  const auto cells = static_cast<std::size_t>(lattice.columns) * static_cast<std::size_t>(lattice.rows);
  for (std::size_t c = 0; c < cells; c += kLanes) store(nothing, table + c);
  Cells at;
  for (std::size_t i = 0; i < points; i += kLanes) {
    const Points16 p = sixteen_points(xyz, points, i);
    find_cells(lattice, p, at);
    spread.finite += static_cast<std::uint64_t>(std::popcount(at.finite));
    if (at.in_line) {
      float* to = table + static_cast<std::size_t>(at.cell[0]);
      const F16 there = load(to);
      if (bits(there == there) == 0) {
        store(p.z, to);
        continue;
      }
    }
    spread.outside += static_cast<std::uint64_t>(std::popcount(at.finite & ~at.inside));
    for (std::uint32_t left = at.inside; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      float& there = table[static_cast<std::size_t>(at.cell[k])];
      if (!std::isnan(there)) ++spread.met;
      if (!(there <= at.z[k])) there = at.z[k];
    }
  }
}

/// Step 4 for points first to last. Returns how many it took out.
std::uint64_t take_out_noise(const Lattice& lattice, const GridWork& work, float* xyz, std::size_t first,
                             std::size_t last) {
  constexpr int kTile = GridLayout::kTileColumns;
  const auto on_plane = [&](const Cells& at, std::size_t k) {
    const int column = static_cast<int>(at.column[k]);
    const int row = static_cast<int>(at.row[k]);
    const TilePlane* planes = work.planes(column / GridLayout::kTileColumns, row / GridLayout::kTileRows);
    const float u = static_cast<float>(column % GridLayout::kTileColumns) - 0.5F * (GridLayout::kTileColumns - 1);
    const float v = static_cast<float>(row % GridLayout::kTileRows) - 0.5F * (GridLayout::kTileRows - 1);
    for (int i = 0; i < 2; ++i) {
      const TilePlane& p = planes[i];
      if (std::abs(at.z[k] - (p.z + p.per_column * u + p.per_row * v)) <= grid_gate_mm(p.per_column, p.per_row))
        return true;
    }
    return false;
  };
  const auto lane_by_lane = [&](const Cells& at) {
    std::uint32_t noise = at.finite & ~at.inside;
    for (std::uint32_t left = at.inside; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      const int column = static_cast<int>(at.column[k]);
      const std::uint32_t row_bits = work.noise.tile(column / kTile, static_cast<int>(at.row[k]));
      const bool owner = work.z[static_cast<std::size_t>(at.cell[k])] == at.z[k];
      const bool bad = owner ? ((row_bits >> static_cast<unsigned>(column % kTile)) & 1U) != 0U : !on_plane(at, k);
      if (bad) noise |= left & -left;
    }
    return noise;
  };
  constexpr float kSixteen = 15.0F;
  std::uint64_t taken = 0;
  Cells at;
  for (std::size_t i = first; i < last; i += kLanes) {
    const Points16 p = sixteen_points(xyz, last, i);
    find_cells(lattice, p, at);
    std::uint32_t noise = 0;
    // Nearly always the sixteen lie in one row, few of its points are missing, and each owns its cell.
    const float span = at.column[kLanes - 1] - at.column[0];
    if (at.in_line && span == kSixteen) {
      const M16 owners = load(work.z + static_cast<std::size_t>(at.cell[0])) == p.z;
      if (bits(owners) != 0xFFFFU) {
        noise = lane_by_lane(at);
      } else {
        noise = work.noise.sixteen(static_cast<int>(at.column[0]), static_cast<int>(at.row[0]));
      }
    } else if (at.in_row &&
               !work.noise.any(static_cast<int>(at.column[0]), static_cast<int>(span) + 1,
                               static_cast<int>(at.row[0])) &&
               bits(gather(work.z, to_int(load(at.cell.data()))) == p.z) == 0xFFFFU) {
      continue;
    } else {
      noise = lane_by_lane(at);
    }
    taken += static_cast<std::uint64_t>(std::popcount(noise));
    // A point that lacks one coordinate is missing altogether.
    noise |= bits((p.x == p.x) | (p.y == p.y) | (p.z == p.z)) & ~at.finite;
    for (; noise != 0; noise &= noise - 1)
      std::fill_n(xyz + 3 * (i + static_cast<std::size_t>(std::countr_zero(noise))), 3, kNoPlane);
  }
  return taken;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(take_sample);
HWY_EXPORT(spread_heights);
HWY_EXPORT(take_out_noise);

namespace {

/// More points than one in so many outside of the table, or in cells with others: there is no lattice.
constexpr std::uint64_t kOutsideShare = 2'000;
constexpr std::uint64_t kMetShare = 100;
/// Mean distance of points from the middle of their column or row, in pitches; 0.25 if they know of none. With less
/// than the second one no other kind of rays is tried.
constexpr double kMisfitMax = 0.1;
constexpr double kMisfitSure = 0.01;
/// Samples at either end that may be strays; and columns or rows beyond the others: a fiftieth and some.
constexpr std::size_t kStrays = 4;
constexpr double kMarginShare = 0.02;
constexpr double kMargin = 8.0;

/// Evenly spaced columns, or rows: number k at origin + k * pitch.
struct Steps {
  double origin = 0.0;
  double pitch = 0.0;
  double misfit = 1.0;  ///< in pitches
  double first = 0.0;   ///< number of the first one
  double count = 0.0;
};

/// `value`: n coordinates, sorted; `room`: n as well.
bool find_steps(const float* value, std::size_t n, float* room, Steps& steps) {
  const std::size_t from = n / 256;
  const std::size_t to = n - n / 256;
  // From value to value it is nearly nothing, or a pitch, rarely several.
  const std::size_t differences = to - from - 1;
  for (std::size_t i = 0; i < differences; ++i) room[i] = value[from + i + 1] - value[from + i];
  constexpr std::size_t kLargest = 32;
  float* end = room + differences;
  std::nth_element(room, end - kLargest, end);
  const float large = *(end - kLargest);
  const auto median_above = [&](float least) {
    float* first = std::partition(room, end, [&](float d) { return d <= least; });
    if (first == end) return 0.0F;
    std::nth_element(first, first + (end - first) / 2, end);
    return first[(end - first) / 2];
  };
  double pitch = static_cast<double>(median_above(large / 6.0F));
  pitch = static_cast<double>(median_above(static_cast<float>(0.5 * pitch)));
  if (!(pitch > 1e-6 * std::abs(static_cast<double>(value[to - 1]))) || !std::isfinite(pitch)) return false;

  // Steps are counted from each value to the next, with a phase that follows them slowly; then a line goes through
  // all of them, and through those that it tells.
  double origin = static_cast<double>(value[from]);
  for (int pass = 0; pass < 4; ++pass) {
    constexpr double kFollow = 0.1;
    const bool follow = pass < 2;
    double phase = origin;
    if (follow) phase = static_cast<double>(value[from]);
    double k = 0.0, count = 0.0, sum_k = 0.0, sum_v = 0.0, sum_kk = 0.0, sum_kv = 0.0;
    for (std::size_t i = from; i < to; ++i) {
      const double v = static_cast<double>(value[i]) - static_cast<double>(value[from]);
      double number = 0.0;
      if (follow) {
        const double step = std::floor((static_cast<double>(value[i]) - phase) / pitch + 0.5);
        k += step;
        phase += step * pitch;
        phase += kFollow * (static_cast<double>(value[i]) - phase);
        number = k;
      } else {
        number = std::floor((static_cast<double>(value[i]) - origin) / pitch + 0.5);
      }
      count += 1.0;
      sum_k += number;
      sum_v += v;
      sum_kk += number * number;
      sum_kv += number * v;
    }
    const double det = sum_kk - sum_k * sum_k / count;
    if (!(det > 0.0)) return false;
    pitch = (sum_kv - sum_k * sum_v / count) / det;
    origin = static_cast<double>(value[from]) + (sum_v - pitch * sum_k) / count;
    if (!(pitch > 0.0)) return false;
  }
  const auto number = [&](std::size_t i) { return std::floor((static_cast<double>(value[i]) - origin) / pitch + 0.5); };
  double off = 0.0;
  for (std::size_t i = from; i < to; ++i)
    off += std::abs(static_cast<double>(value[i]) - origin - pitch * number(i)) / pitch;
  steps.origin = origin;
  steps.pitch = pitch;
  steps.misfit = off / static_cast<double>(to - from);
  const double last = number(n - 1 - kStrays);
  steps.first = number(kStrays);
  steps.count = last - steps.first + 1.0;
  const double margin = std::floor(kMarginShare * steps.count) + kMargin;
  steps.first -= margin;
  steps.count += 2.0 * margin;
  return true;
}

/// Whole tiles, so that no row of a table ends amidst one.
bool whole_tiles(const Steps& x, const Steps& y, std::size_t capacity, Lattice& lattice) {
  const auto whole = [](double count, double tile) { return tile * std::ceil(count / tile); };
  const double columns = whole(x.count, GridLayout::kTileColumns);
  const double rows = whole(y.count, GridLayout::kTileRows);
  if (columns < static_cast<double>(GridLayout::kColumnsMin) || rows < static_cast<double>(GridLayout::kRowsMin))
    return false;
  if (!(columns * rows <= static_cast<double>(std::min(capacity, limits::kScanPointsMax)))) return false;
  lattice.columns = static_cast<float>(columns);
  lattice.rows = static_cast<float>(rows);
  lattice.x0 = static_cast<float>(x.origin + (x.first - 0.5) * x.pitch);
  lattice.y0 = static_cast<float>(y.origin + (y.first - 0.5) * y.pitch);
  lattice.per_x = static_cast<float>(1.0 / x.pitch);
  lattice.per_y = static_cast<float>(1.0 / y.pitch);
  return true;
}

}  // namespace

bool denoise_lattice(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts) {
  // The sample lies in memory that nothing else needs by now, and so does the table.
  if (memory.cell_start.size() < 5 * kSampleMax || cloud.points < kSampleMin) return false;
  float* sample = ::new (memory.cell_start.data()) float[5 * kSampleMax];
  float* x = sample;
  float* y = x + kSampleMax;
  float* z = y + kSampleMax;
  float* value = z + kSampleMax;
  float* differences = value + kSampleMax;
  std::size_t share = 1;
  while (cloud.points / share > kSampleMax / 2) share *= 2;
  const std::size_t n =
      HWY_DYNAMIC_DISPATCH(take_sample)(cloud.xyz.data(), cloud.points, static_cast<std::int32_t>(share - 1), x, y, z);
  if (n < kSampleMin || n > kSampleMax) return false;

  Steps parallel_x, parallel_y, central_x, central_y;
  Lattice lattice;
  const auto steps_of = [&](const float* from, bool central, Steps& steps) -> bool {
    for (std::size_t i = 0; i < n; ++i) value[i] = central ? from[i] / z[i] : from[i];
    if (!std::all_of(value, value + n, [](float v) { return std::isfinite(v); })) return false;
    std::sort(value, value + n);
    return find_steps(value, n, differences, steps);
  };
  const auto fits = [](const Steps& steps, double limit) { return steps.misfit <= limit; };
  if (steps_of(x, false, parallel_x) && fits(parallel_x, kMisfitMax)) steps_of(y, false, parallel_y);
  if (!fits(parallel_y, kMisfitSure) && steps_of(x, true, central_x) && fits(central_x, kMisfitMax))
    steps_of(y, true, central_y);
  const double parallel_misfit = std::max(parallel_x.misfit, parallel_y.misfit);
  const double central_misfit = std::max(central_x.misfit, central_y.misfit);
  if (!(std::min(parallel_misfit, central_misfit) <= kMisfitMax)) return false;
  lattice.central = central_misfit < parallel_misfit;
  const Steps& along = lattice.central ? central_x : parallel_x;
  const Steps& across = lattice.central ? central_y : parallel_y;
  if (!whole_tiles(along, across, memory.order.size(), lattice)) return false;

  const GridLayout grid(static_cast<std::size_t>(lattice.columns), static_cast<std::size_t>(lattice.rows));
  if (2 * grid.tiles() > memory.surface.size() || 2 * grid.mask_bytes() > memory.keep.size()) return false;
  float* table = ::new (memory.order.data()) float[grid.columns * grid.rows];
  Spread spread;
  HWY_DYNAMIC_DISPATCH(spread_heights)(lattice, cloud.xyz.data(), cloud.points, table, spread);
  if (kOutsideShare * spread.outside > spread.finite || kMetShare * spread.met > spread.finite) return false;

  GridWork work(grid, nullptr, table, memory);
  std::nth_element(z, z + n / 2, z + n);
  const float away = lattice.central ? std::abs(z[n / 2]) : 1.0F;
  work.per_column_mm = away / lattice.per_x;
  work.per_row_mm = away / lattice.per_y;
  if (!judge_grid(grid, work, team)) return false;
  std::atomic<std::uint64_t> taken{0};
  team.run((cloud.points + kPiece - 1) / kPiece, [&](std::size_t piece) {
    taken += HWY_DYNAMIC_DISPATCH(take_out_noise)(lattice, work, cloud.xyz.data(), piece * kPiece,
                                                  std::min(cloud.points, (piece + 1) * kPiece));
  });
  counts.points_finite = spread.finite;
  counts.isolated_removed = taken;
  counts.points_kept = spread.finite - counts.isolated_removed;
  return true;
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
