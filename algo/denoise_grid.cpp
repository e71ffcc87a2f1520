// SPDX-License-Identifier: Apache-2.0
//
// Denoising of an organised scan: neighbours are known, so a surface is a plane over columns and rows, and one
// comparison of z tells whether a point lies on it. The grid is taken in tiles of 16 columns and 8 rows.
//
//  1. Every tile gets the plane that most of its points lie on. Most tiles continue the plane of the tile beside them,
//     so nothing is fitted: sixteen points at a time are compared with it. Where it drifts it is fitted anew by least
//     squares, where nothing continues a few planes through three points are tried. Of a tile with an edge the points
//     left over may give a second plane.
//  2. A tile whose plane holds all but a few points is calm: those are kept. Every other point is asked for itself,
//     with the planes of the nine tiles around: does one go through it, and do enough of the 7 x 7 points around lie on
//     it too (algo/surface_window.h)? What no plane explains is noise if it is alone; in company, as on a small object,
//     it is asked whether a surface with one of the slopes seen around, or that of its four neighbours, goes through
//     it.
//  3. Noise becomes NaN.
//
// Invariants: step 1 writes planes and masks of its own band of tile rows only, step 2 reads those around and the
// points, step 3 alone changes points; so the bands may be shared among threads. Planes do not continue across bands.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include <hwy/cache_control.h>
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/denoise_grid.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/denoise.h"
#include "algo/denoise_grid.h"
#include "algo/surface_window.h"
#include "base/prng.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

constexpr int kColumns = GridLayout::kTileColumns;
constexpr int kRows = GridLayout::kTileRows;
static_assert(kColumns == static_cast<int>(kLanes));

/// The plane's share of a tile's points that needs no look at another one; the share from which fitting it to its
/// points is worth while; and from which it is a plane at all.
constexpr float kShareSure = 0.85F;
constexpr float kShareWorth = 0.4F;
constexpr float kShareMost = 0.5F;
constexpr float kShareMin = 0.35F;
/// A plane has not drifted while so many of its points lie within a third of the gate.
constexpr float kTight = 1.0F / 3.0F;
constexpr float kTightShare = 0.85F;
constexpr int kRefits = 3;
/// Fewest points that make a plane, and that a second one is looked for in. One that no tile beside offers must hold
/// more of those: a clump and the rows of a surface beside it fit a plane too.
constexpr int kPlanePoints = 12;
constexpr int kSecondPoints = 16;
constexpr int kDrawnSecond = 24;
constexpr float kDrawnSecondShare = 0.65F;
/// A tile is calm with at most so many points off its plane.
constexpr int kCalmOff = 10;
/// A plane reigns in its tile if at most one point in so many is off it.
constexpr int kReignShare = 4;
/// Planes through three points that are tried, on at most so many points.
constexpr int kDraws = 24;
constexpr int kSample = 48;
/// Planes as one, in gates at the corners of a tile.
constexpr float kAlike = 0.25F;
constexpr float kAlikeLevel_mm = 0.15F;  // the least a gate can make of it
/// A point that fewer unexplained ones surround is alone.
constexpr int kCompany = 4;
/// Steepest slope that four neighbours are believed, mm per point.
constexpr float kOwnSlopeMax = 1.0F;
constexpr std::size_t kCandidates = 18;
/// Floats that are fetched ahead: four tiles.
constexpr int kAhead = 4 * 3 * kColumns;

constexpr float kMidColumn = 0.5F * static_cast<float>(kColumns - 1);
constexpr float kMidRow = 0.5F * static_cast<float>(kRows - 1);

HWY_INLINE F16 lanes_from_middle() {
  return lane_numbers() - f16(kMidColumn);
}
HWY_INLINE float gate_of(const TilePlane& p) {
  return grid_gate_mm(p.per_column, p.per_row);
}
/// The same plane, told from a tile so many tiles further.
HWY_INLINE TilePlane moved(const TilePlane& p, int columns, int rows) {
  return {p.z + static_cast<float>(kColumns * columns) * p.per_column + static_cast<float>(kRows * rows) * p.per_row,
          p.per_column, p.per_row};
}

/// Heights of sixteen points; NaN where one is not finite. `odd`: those that are neither finite nor NaN throughout.
HWY_INLINE F16 heights(const Points16& p, std::uint32_t& finite, std::uint32_t& odd) {
  const M16 good = ((p.x - p.x) + (p.y - p.y) + (p.z - p.z)) == f16(0.0F);
  const M16 some = (p.x == p.x) | (p.y == p.y) | (p.z == p.z);
  finite = bits(good);
  odd = bits(and_not(good, some));
  return select(good, p.z, f16(std::numeric_limits<float>::quiet_NaN()));
}
using RowBits = std::array<std::uint32_t, kRows>;
HWY_INLINE int count(const RowBits& rows) {
  int n = 0;
  for (int r = 0; r < kRows; r += 2)
    n += std::popcount(rows[static_cast<std::size_t>(r)] | (rows[static_cast<std::size_t>(r) + 1] << 16U));
  return n;
}

/// One tile: its heights, and which points are to be explained.
struct Tile {
  alignas(64) std::array<std::array<float, kColumns>, kRows> z;
  RowBits wanted;
  int points = 0;
};

/// How a plane does on a tile.
struct Held {
  TilePlane plane{kNoPlane, 0.0F, 0.0F};
  RowBits rows{};
  int points = 0;
  int tight = 0;
  [[nodiscard]] bool share(const Tile& tile, float least) const {
    return static_cast<float>(points) >= least * static_cast<float>(tile.points);
  }
  [[nodiscard]] bool drifted() const { return static_cast<float>(tight) < kTightShare * static_cast<float>(points); }
};

HWY_INLINE void hold(const Tile& tile, const TilePlane& plane, Held& out) {
  const float gate_mm = gate_of(plane);
  const F16 gate = f16(gate_mm);
  const F16 tight_gate = f16(kTight * gate_mm);
  const F16 along = f16(plane.per_column) * lanes_from_middle();
  out.plane = plane;
  RowBits tight;
  for (std::size_t r = 0; r < kRows; ++r) {
    const float at = plane.z + plane.per_row * (static_cast<float>(r) - kMidRow);
    const F16 off = abs(load(tile.z[r].data()) - (f16(at) + along));
    out.rows[r] = bits(off <= gate) & tile.wanted[r];
    tight[r] = bits(off <= tight_gate) & tile.wanted[r];
  }
  out.points = count(out.rows);
  out.tight = count(tight);
}

/// Least squares over the points that the plane holds. Returns false when they do not fix a plane.
bool refit(const Tile& tile, const Held& held, TilePlane& plane) {
  const F16 u = lanes_from_middle();
  const F16 none = f16(0.0F);
  const F16 gate = f16(gate_of(held.plane));
  const F16 along = f16(held.plane.per_column) * u;
  alignas(64) std::array<float, kColumns> lane_wanted;
  F16 n = none, n_v = none, n_vv = none, r = none, r_v = none;
  for (std::size_t row = 0; row < kRows; ++row) {
    if (tile.wanted[row] == 0) continue;
    for (std::size_t c = 0; c < kColumns; ++c) lane_wanted[c] = ((tile.wanted[row] >> c) & 1U) != 0U ? 1.0F : 0.0F;
    const float v_row = static_cast<float>(row) - kMidRow;
    const F16 v = f16(v_row);
    const F16 off = load(tile.z[row].data()) - (f16(held.plane.z + held.plane.per_row * v_row) + along);
    const M16 in = (abs(off) <= gate) & (load(lane_wanted.data()) > none);
    const F16 one = keep(in, f16(1.0F));
    const F16 residual = keep(in, off);
    n = n + one;
    n_v = n_v + one * v;
    n_vv = n_vv + one * (v * v);
    r = r + residual;
    r_v = r_v + residual * v;
  }
  const double count = sum_of_lanes(n);
  if (count < 3.0) return false;
  double su = sum_of_lanes(n * u), sv = sum_of_lanes(n_v), sr = sum_of_lanes(r);
  double uu = sum_of_lanes(n * (u * u)), uv = sum_of_lanes(n_v * u), vv = sum_of_lanes(n_vv);
  double ru = sum_of_lanes(r * u), rv = sum_of_lanes(r_v);
  su /= count, sv /= count, sr /= count;
  uu -= count * su * su, uv -= count * su * sv, vv -= count * sv * sv;
  ru -= count * su * sr, rv -= count * sv * sr;
  const double det = uu * vv - uv * uv;
  // Points of one column or row say nothing about the slope across it.
  if (!(det > 0.05 * count * count)) return false;
  const double a = (ru * vv - rv * uv) / det;
  const double b = (rv * uu - ru * uv) / det;
  plane = {held.plane.z + static_cast<float>(sr - a * su - b * sv), held.plane.per_column + static_cast<float>(a),
           held.plane.per_row + static_cast<float>(b)};
  return true;
}

/// Fits the plane to its points until it holds no more of them.
void settle(const Tile& tile, Held& held) {
  for (int i = 0; i < kRefits; ++i) {
    TilePlane plane;
    if (!refit(tile, held, plane)) return;
    Held next;
    hold(tile, plane, next);
    if (next.points < held.points || (next.points == held.points && next.tight <= held.tight)) return;
    const bool still = next.points == held.points && !next.drifted();
    held = next;
    if (still) return;
  }
}

/// The best of a few planes through three points of the tile.
void draw_plane(const Tile& tile, Held& best) {
  alignas(64) std::array<float, kSample> u, v, z;
  const int step = 1 + (tile.points - 1) / kSample;
  std::size_t n = 0;
  int k = 0;
  for (std::size_t row = 0; row < kRows; ++row) {
    for (std::uint32_t left = tile.wanted[row]; left != 0; left &= left - 1) {
      if (k++ % step != 0) continue;
      const auto c = static_cast<std::size_t>(std::countr_zero(left));
      u[n] = static_cast<float>(c) - kMidColumn;
      v[n] = static_cast<float>(row) - kMidRow;
      z[n++] = tile.z[row][c];
    }
  }
  const std::size_t points = n;
  for (; n < kSample; ++n) u[n] = v[n] = 0.0F, z[n] = std::numeric_limits<float>::quiet_NaN();
  Prng prng(points);
  TilePlane plane{kNoPlane, 0.0F, 0.0F};
  int most = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const std::size_t a = prng.below(points), b = prng.below(points), c = prng.below(points);
    const float bu = u[b] - u[a], bv = v[b] - v[a], bz = z[b] - z[a];
    const float cu = u[c] - u[a], cv = v[c] - v[a], cz = z[c] - z[a];
    const float area = bu * cv - bv * cu;
    if (std::abs(area) < 4.0F) continue;
    TilePlane drawn{0.0F, (bz * cv - bv * cz) / area, (bu * cz - bz * cu) / area};
    drawn.z = z[a] - drawn.per_column * u[a] - drawn.per_row * v[a];
    const F16 gate = f16(gate_of(drawn));
    int held = 0;
    for (std::size_t i = 0; i < kSample; i += kLanes) {
      const F16 off =
          load(&z[i]) - (f16(drawn.z) + f16(drawn.per_column) * load(&u[i]) + f16(drawn.per_row) * load(&v[i]));
      held += std::popcount(bits(abs(off) <= gate));
    }
    if (held <= most) continue;
    most = held;
    plane = drawn;
  }
  if (most == 0) return;
  hold(tile, plane, best);
  settle(tile, best);
}

/// The plane of the wanted points: one of those offered if it holds most of them, else a new one.
void find_plane(const Tile& tile, const TilePlane* offered, int offers, bool first, Held& best) {
  best = Held{};
  for (int i = 0; i < offers; ++i) {
    if (std::isnan(offered[i].z)) continue;
    Held held;
    hold(tile, offered[i], held);
    if (held.points > best.points) best = held;
    if (best.share(tile, kShareSure) && !best.drifted()) return;
  }
  if (best.points > 0 && best.share(tile, kShareWorth)) {
    settle(tile, best);
    if (best.points >= kPlanePoints && best.share(tile, kShareMost)) return;
  }
  Held drawn;
  draw_plane(tile, drawn);
  const bool sound = first || (drawn.points >= kDrawnSecond && drawn.share(tile, kDrawnSecondShare));
  if (sound && drawn.points > best.points) best = drawn;
  if (best.points < kPlanePoints || !best.share(tile, kShareMin)) best = Held{};
}

class Denoiser {
 public:
  Denoiser(const GridLayout& grid, GridWork& work) : grid_(grid), work_(work) {}

  /// Step 1 for one band, and step 2 for its tile rows but the first and the last: while their points are in the cache.
  void find_planes(std::size_t band) {
    GridCounts counts;
    const int first = first_tile_row(band);
    const int last = first_tile_row(band + 1);
    for (int tr = first; tr < last; ++tr) {
      for (int tc = 0; tc < grid_.tile_columns; ++tc) see(tc, tr, tr > first, counts);
      if (tr - first >= 2) judge_row(tr - 1);
    }
    work_.add(counts);
  }

  /// Step 2 for the band's first and last tile row, when the bands beside it have their planes.
  void judge(std::size_t band) {
    const int first = first_tile_row(band);
    const int last = first_tile_row(band + 1) - 1;
    judge_row(first);
    if (last != first) judge_row(last);
  }

 private:
  [[nodiscard]] int first_tile_row(std::size_t band) const {
    return std::min(static_cast<int>(band) * GridLayout::kBandTileRows, grid_.tile_rows);
  }
  void judge_row(int tr) {
    for (int tc = 0; tc < grid_.tile_columns; ++tc) judge_tile(tc, tr);
  }
  [[nodiscard]] std::size_t at(int column, int row) const {
    return static_cast<std::size_t>(row) * grid_.columns + static_cast<std::size_t>(column);
  }
  [[nodiscard]] float* point(int column, int row) const { return work_.xyz + 3 * at(column, row); }
  /// Heights from a column on, be it left of the grid; NaN where a point is missing or the grid has ended.
  [[nodiscard]] HWY_INLINE F16 sixteen(int column, int row, std::uint32_t& finite, std::uint32_t& odd) const {
    const int from = std::max(0, -column);
    const int count = std::max(0, std::min(kColumns, static_cast<int>(grid_.columns) - column) - from);
    alignas(64) std::array<float, 3 * kColumns> room;
    if (count < kColumns) room.fill(kNoPlane);
    if (work_.z != nullptr) {
      if (count < kColumns) std::copy_n(work_.z + at(column + from, row), count, room.data() + from);
      const F16 z = load(count < kColumns ? room.data() : work_.z + at(column, row));
      finite = bits(z == z);
      return z;
    }
    if (count < kColumns) std::copy_n(point(column + from, row), 3 * count, room.data() + 3 * from);
    return heights(load_points(count < kColumns ? room.data() : point(column, row)), finite, odd);
  }

  void see(int tc, int tr, bool above, GridCounts& counts) {
    Tile tile;
    const int rows = std::min(kRows, static_cast<int>(grid_.rows) - kRows * tr);
    for (int r = 0; r < kRows; ++r) {
      const auto k = static_cast<std::size_t>(r);
      if (r >= rows) {
        tile.wanted[k] = 0;
        store(f16(std::numeric_limits<float>::quiet_NaN()), tile.z[k].data());
        continue;
      }
      // Tiles jump from row to row, which no machine foresees.
      const int column = kColumns * tc;
      const int row = kRows * tr + r;
      const float* from = work_.z != nullptr ? work_.z + at(column, row) : point(column, row);
      for (int line = 0; line < 3; ++line) hwy::Prefetch(from + kAhead + 16 * line);
      std::uint32_t odd = 0;
      store(sixteen(column, row, tile.wanted[k], odd), tile.z[k].data());
      // A point that lacks one coordinate is missing altogether.
      for (; odd != 0; odd &= odd - 1) std::fill_n(point(column + std::countr_zero(odd), row), 3, kNoPlane);
    }
    tile.points = count(tile.wanted);
    counts.finite += static_cast<std::uint64_t>(tile.points);

    TilePlane* own = work_.planes(tc, tr);
    own[0] = own[1] = {kNoPlane, 0.0F, 0.0F};
    if (tile.points > 0) {
      std::array<TilePlane, 4> offers;
      int n = 0;
      if (tc > 0) offers[static_cast<std::size_t>(n++)] = moved(work_.planes(tc - 1, tr)[0], 1, 0);
      if (above) offers[static_cast<std::size_t>(n++)] = moved(work_.planes(tc, tr - 1)[0], 0, 1);
      if (above) offers[static_cast<std::size_t>(n++)] = moved(work_.planes(tc, tr - 1)[1], 0, 1);
      if (tc > 0) offers[static_cast<std::size_t>(n++)] = moved(work_.planes(tc - 1, tr)[1], 1, 0);
      const int points = tile.points;
      for (int i = 0; i < 2 && tile.points >= (i == 0 ? kPlanePoints : kSecondPoints); ++i) {
        Held held;
        find_plane(tile, offers.data(), n, i == 0, held);
        if (std::isnan(held.plane.z)) break;
        own[i] = held.plane;
        if (i == 0 && 2 * held.points >= points) counts.with_plane += static_cast<std::uint64_t>(points);
        for (std::size_t r = 0; r < kRows; ++r) tile.wanted[r] &= ~held.rows[r];
        tile.points -= held.points;
        if (i == 0 && tile.points <= kCalmOff) break;
      }
    }
    for (int r = 0; r < kRows; ++r) work_.off.set(tc, kRows * tr + r, tile.wanted[static_cast<std::size_t>(r)]);
    for (int r = 0; r < kRows; ++r) work_.noise.set(tc, kRows * tr + r, 0);
  }

  /// The tile and three points around it; 8 more columns on each side, because lanes come by sixteen.
  static constexpr int kReach = window::kReach;
  static constexpr int kRegionRows = kRows + 2 * kReach;
  static constexpr int kMargin = 8;
  struct Region {
    alignas(64) std::array<std::array<float, 2 * kColumns>, kRegionRows> z;
    std::array<std::uint32_t, kRegionRows> finite;
  };
  using RegionBits = std::array<std::uint32_t, kRegionRows>;

  void fill(Region& region, int tc, int tr) const {
    for (int r = 0; r < kRegionRows; ++r) {
      const int row = kRows * tr + r - kReach;
      const auto k = static_cast<std::size_t>(r);
      region.finite[k] = 0;
      for (int half = 0; half < 2; ++half) {
        float* to = region.z[k].data() + kColumns * half;
        const int column = kColumns * tc - kMargin + kColumns * half;
        if (row < 0 || row >= static_cast<int>(grid_.rows)) {
          store(f16(kNoPlane), to);
          continue;
        }
        std::uint32_t finite = 0, odd = 0;
        store(sixteen(column, row, finite, odd), to);
        region.finite[k] |= finite << static_cast<unsigned>(kColumns * half);
      }
    }
  }

  /// Which points of the region lie on the plane.
  static void on_plane(const Region& region, const TilePlane& plane, RegionBits& on) {
    const F16 gate = f16(gate_of(plane));
    const F16 left = f16(plane.per_column) * (lanes_from_middle() - f16(kMargin));
    const F16 right = f16(plane.per_column) * (lanes_from_middle() + f16(kColumns - kMargin));
    for (int r = 0; r < kRegionRows; ++r) {
      const auto k = static_cast<std::size_t>(r);
      const F16 at = f16(plane.z + plane.per_row * (static_cast<float>(r - kReach) - kMidRow));
      on[k] = bits(abs(load(region.z[k].data()) - (at + left)) <= gate) |
              (bits(abs(load(region.z[k].data() + kColumns) - (at + right)) <= gate) << kColumns);
    }
  }
  /// Does any of the tile's open points?
  [[nodiscard]] static bool any_on_plane(const Region& region, const TilePlane& plane, const RowBits& open) {
    const F16 gate = f16(gate_of(plane));
    const F16 along = f16(plane.per_column) * lanes_from_middle();
    for (std::size_t r = 0; r < kRows; ++r) {
      if (open[r] == 0) continue;
      const F16 at = f16(plane.z + plane.per_row * (static_cast<float>(r) - kMidRow));
      const float* z = region.z[r + kReach].data() + kMargin;
      if ((bits(abs(load(z) - (at + along)) <= gate) & open[r]) != 0) return true;
    }
    return false;
  }
  /// The window around a point of the tile.
  [[nodiscard]] static HWY_INLINE std::uint64_t window_of(const RegionBits& rows, int column, int row) {
    std::uint64_t bits = 0;
    for (int k = 0; k < window::kSide; ++k)
      bits |= std::uint64_t{(rows[static_cast<std::size_t>(row + k)] >> (column + kMargin - kReach)) & 0x7FU}
              << (7 * k);
    return bits;
  }

  /// Planes of the nine tiles around, told from this one; its own come first.
  std::size_t gather_planes(int tc, int tr, std::array<TilePlane, kCandidates>& planes) const {
    std::size_t n = 0;
    const auto add = [&](int dc, int dr) {
      const int c = tc + dc;
      const int r = tr + dr;
      if (c < 0 || r < 0 || c >= grid_.tile_columns || r >= grid_.tile_rows) return;
      for (int i = 0; i < 2; ++i) {
        if (std::isnan(work_.planes(c, r)[i].z)) return;
        if (work_.too_steep(work_.planes(c, r)[i])) continue;
        const TilePlane plane = moved(work_.planes(c, r)[i], -dc, -dr);
        bool known = false;
        for (std::size_t k = 0; k < n && !known; ++k) {
          const float off = std::abs(plane.z - planes[k].z) + 8.0F * std::abs(plane.per_column - planes[k].per_column) +
                            4.0F * std::abs(plane.per_row - planes[k].per_row);
          known = off <= kAlikeLevel_mm || off <= kAlike * gate_of(plane);
        }
        if (!known) planes[n++] = plane;
      }
    };
    add(0, 0);
    for (int dr = -1; dr <= 1; ++dr)
      for (int dc = -1; dc <= 1; ++dc)
        if (dr != 0 || dc != 0) add(dc, dr);
    return n;
  }

  void judge_tile(int tc, int tr) {
    RowBits open;
    for (int r = 0; r < kRows; ++r) open[static_cast<std::size_t>(r)] = work_.off.tile(tc, kRows * tr + r);
    const int off = count(open);
    const TilePlane* own = work_.planes(tc, tr);
    const bool calm = !std::isnan(own[0].z) && std::isnan(own[1].z) && off <= kCalmOff && !work_.too_steep(own[0]);
    if (calm && off == 0) return;

    std::array<TilePlane, kCandidates> planes;
    const std::size_t n = gather_planes(tc, tr, planes);
    Region region;
    bool filled = false;
    if (!calm || near_other_plane(tc, tr, open, planes.data(), n)) {
      fill(region, tc, tr);
      filled = true;
      if (!calm)
        for (std::size_t r = 0; r < kRows; ++r) open[r] = (region.finite[r + kReach] >> kMargin) & 0xFFFFU;
      const bool reigns = !std::isnan(own[0].z) && std::isnan(own[1].z) && kReignShare * off <= count(open);
      for (std::size_t i = calm ? 1 : 0; i < n; ++i) explain(region, planes[i], reigns && i == 0 && !calm, open);
    }
    for (int r = 0; r < kRows; ++r) {
      std::uint32_t noise = 0;
      for (std::uint32_t left = open[static_cast<std::size_t>(r)]; left != 0; left &= left - 1) {
        const int c = std::countr_zero(left);
        bool keep = false;
        if (std::popcount(work_.off.around(kColumns * tc + c, kRows * tr + r) & window::kAround) >= kCompany) {
          if (!filled) fill(region, tc, tr);
          filled = true;
          keep = through(region, c, r, own[0]);
        }
        if (!keep) noise |= left & -left;
      }
      if (noise != 0) work_.noise.set(tc, kRows * tr + r, noise);
    }
  }

  /// Does any of the points come near a plane other than the tile's own? A quick look that spares a thorough one.
  [[nodiscard]] bool near_other_plane(int tc, int tr, const RowBits& open, const TilePlane* planes,
                                      std::size_t n) const {
    constexpr float kSlack = 1.05F;
    if (n < 2) return false;
    for (int r = 0; r < kRows; ++r) {
      for (std::uint32_t left = open[static_cast<std::size_t>(r)]; left != 0; left &= left - 1) {
        const int c = std::countr_zero(left);
        const std::size_t i_point = at(kColumns * tc + c, kRows * tr + r);
        const float z = work_.z != nullptr ? work_.z[i_point] : work_.xyz[3 * i_point + 2];
        for (std::size_t i = 1; i < n; ++i) {
          const float at = planes[i].z + planes[i].per_column * (static_cast<float>(c) - kMidColumn) +
                           planes[i].per_row * (static_cast<float>(r) - kMidRow);
          if (std::abs(z - at) <= kSlack * gate_of(planes[i])) return true;
        }
      }
    }
    return false;
  }

  /// Takes those points out of `open` that the plane explains.
  static void explain(const Region& region, const TilePlane& plane, bool reigning, RowBits& open) {
    if (!any_on_plane(region, plane, open)) return;
    RegionBits on;
    on_plane(region, plane, on);
    // Where nothing around lies off the plane and the nearest points on it, the answer is known: no counting.
    RegionBits off;
    for (std::size_t k = 0; k < kRegionRows; ++k) {
      const std::uint32_t o = region.finite[k] & ~on[k];
      off[k] = o | (o << 1U) | (o << 2U) | (o << 3U) | (o >> 1U) | (o >> 2U) | (o >> 3U);
    }
    for (std::size_t r = 0; r < kRows; ++r) {
      std::uint32_t around = 0;
      for (std::size_t k = 0; k < static_cast<std::size_t>(window::kSide); ++k) around |= off[r + k];
      const std::uint32_t here = on[r + kReach];
      const std::uint32_t above = on[r + kReach - 1];
      const std::uint32_t below = on[r + kReach + 1];
      const std::uint32_t cross = here & (here << 1U) & (here >> 1U) & above & below;
      const std::uint32_t corner = (above << 1U) | (above >> 1U) | (below << 1U) | (below >> 1U);
      open[r] &= ~((cross & corner & ~around) >> kMargin);
    }
    for (int r = 0; r < kRows; ++r) {
      std::uint32_t& row = open[static_cast<std::size_t>(r)];
      for (std::uint32_t left = row & (on[static_cast<std::size_t>(r + kReach)] >> kMargin); left != 0;
           left &= left - 1) {
        const int c = std::countr_zero(left);
        if (window::holds_middle(window_of(on, c, r), window_of(region.finite, c, r), reigning)) row &= ~(left & -left);
      }
    }
  }

  /// Does a surface go through the point: level, as steep as the tile's plane, or as its four neighbours rise? Steep
  /// faces further off must not lend their slope: with their wide gate they would tie a clump to the surface below it.
  static bool through(const Region& region, int column, int row, const TilePlane& own) {
    const std::uint64_t finite = window_of(region.finite, column, row);
    const auto z = [&](int dc, int dr) {
      return region.z[static_cast<std::size_t>(row + kReach + dr)][static_cast<std::size_t>(column + kMargin + dc)];
    };
    const float here = z(0, 0);
    const auto goes = [&](float a, float b) {
      const F16 gate = f16(grid_gate_mm(a, b));
      const F16 along = f16(a) * (lane_numbers() - f16(kReach)) + f16(here);
      std::uint64_t on = 0;
      for (int k = 0; k < window::kSide; ++k) {
        const float* from = region.z[static_cast<std::size_t>(row + k)].data() + column + kMargin - kReach;
        const F16 at = along + f16(b * static_cast<float>(k - kReach));
        on |= std::uint64_t{bits(abs(load(from) - at) <= gate) & 0x7FU} << (7 * k);
      }
      return window::holds_middle(on, finite, false);
    };
    if (goes(0.0F, 0.0F)) return true;
    if (goes(own.per_column, own.per_row)) return true;
    const float a = 0.5F * (z(1, 0) - z(-1, 0));
    const float b = 0.5F * (z(0, 1) - z(0, -1));
    return a * a + b * b <= kOwnSlopeMax * kOwnSlopeMax && goes(a, b);
  }

  const GridLayout grid_;
  GridWork& work_;
};

}  // namespace

void find_planes(const GridLayout& grid, GridWork& work, std::size_t band) {
  Denoiser(grid, work).find_planes(band);
}
void judge_points(const GridLayout& grid, GridWork& work, std::size_t band) {
  Denoiser(grid, work).judge(band);
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(find_planes);
HWY_EXPORT(judge_points);

void find_grid_planes(const GridLayout& grid, GridWork& work, std::size_t band) {
  HWY_DYNAMIC_DISPATCH(find_planes)(grid, work, band);
}
void judge_grid_points(const GridLayout& grid, GridWork& work, std::size_t band) {
  HWY_DYNAMIC_DISPATCH(judge_points)(grid, work, band);
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
