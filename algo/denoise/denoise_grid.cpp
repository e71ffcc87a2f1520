// SPDX-License-Identifier: Apache-2.0
//
// Denoising of an organised scan: neighbours are known, so a surface is a plane over columns and rows, and one
// comparison of z decides whether a point is on it. The grid is divided into tiles of 16 columns and 8 rows.
//
//  1. Every tile gets the plane that holds most of its points. Most tiles continue the plane of the adjacent tile, so
//     nothing is fitted: sixteen points at a time are compared with it while they are loaded. Where it drifts it is
//     refitted by least squares; where no plane continues, a few planes through three points are tried. In a tile with
//     an edge the remaining points may give a second plane.
//  2. A tile whose plane holds all but a few points is calm: those on the plane are kept. Every other point is tested
//     separately, with the planes of the nine tiles around (algo/denoise/denoise_grid_points.cpp).
//  3. Noise that is not connected over a length (algo/denoise/denoise.cpp) becomes NaN (algo/denoise/denoise.cpp).
//
// Invariants: step 1 writes planes and masks of its own band of tile rows only; step 2 reads the adjacent ones and the
// points; only step 3 changes points (except those that lack a coordinate). So threads may share the bands. Planes do
// not continue across bands.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include <hwy/cache_control.h>
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/denoise/denoise_grid.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/denoise/denoise.h"
#include "algo/denoise/denoise_grid.h"
#include "base/prng.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

constexpr int kColumns = GridLayout::kTileColumns;
constexpr int kRows = GridLayout::kTileRows;
static_assert(kColumns == static_cast<int>(kLanes));

/// The plane's share of a tile's points: enough without trying another plane; enough for a refit to pay; half, for the
/// count of points with a plane; and the minimum for a plane.
constexpr float kShareSure = 0.85F;
constexpr float kShareWorth = 0.4F;
constexpr float kShareMost = 0.5F;
constexpr float kShareMin = 0.35F;
/// A plane has not drifted if this share of its points is within a third of the gate.
constexpr float kTight = 1.0F / 3.0F;
constexpr float kTightShare = 0.85F;
constexpr int kRefits = 3;
/// Minimum number of points for a plane, and for the search for a second one. A second plane that no adjacent tile
/// offers must hold more: a clump and the rows of a surface next to it fit a plane too.
constexpr int kPlanePoints = 12;
constexpr int kSecondPoints = 16;
constexpr int kDrawnSecond = 24;
constexpr float kDrawnSecondShare = 0.65F;
/// Number of planes through three points that are tried, and of points they are tested on.
constexpr int kDraws = 24;
constexpr int kSample = 48;
/// Prefetch distance in points: four tiles. The next row of tiles is also prefetched into the second-level cache, in
/// memory order, with each tile its own number of points.
constexpr std::size_t kAhead = 4 * kLanes;
constexpr std::size_t kTilePoints = kLanes * static_cast<std::size_t>(kRows);

HWY_INLINE F16 lanes_from_middle() {
  return lane_numbers() - f16(kTileMidColumn);
}

/// One tile: its heights, NaN if a point is missing, and the points without a plane so far.
struct Tile {
  alignas(64) std::array<std::array<float, kColumns>, kRows> z;
  TileBits wanted;
  int points = 0;
};

/// Result of comparing a plane with a tile.
struct Held {
  TilePlane plane{kNoPlane, 0.0F, 0.0F};
  TileBits on;
  int points = 0;
  int tight = 0;
  bool drifted = false;
  bool clear = false;  ///< all other points are far off
  [[nodiscard]] bool share(const Tile& tile, float least) const {
    return static_cast<float>(points) >= least * static_cast<float>(tile.points);
  }
  [[nodiscard]] bool sure(const Tile& tile) const { return share(tile, kShareSure) && !drifted; }
};

/// Removes the points on the plane from the wanted ones.
HWY_INLINE void take(Tile& tile, const Held& held) {
  tile.wanted = and_not(held.on, tile.wanted);
  tile.points -= held.points;
}

/// Evaluates a plane over a tile, row by row.
class Laid {
 public:
  explicit HWY_INLINE Laid(const TilePlane& plane)
      : z_(plane.z),
        per_row_(plane.per_row),
        along_(f16(plane.per_column) * lanes_from_middle()),
        gate_(f16(gate_of(plane))),
        tight_(f16(kTight * gate_of(plane))),
        clear_(f16(clear_off_mm(plane))) {}
  [[nodiscard]] HWY_INLINE F16 off(const F16& z, int row) const {
    return z - (f16(z_ + per_row_ * (static_cast<float>(row) - kTileMidRow)) + along_);
  }
  [[nodiscard]] HWY_INLINE M16 on(const F16& off) const { return abs(off) <= gate_; }
  [[nodiscard]] HWY_INLINE M16 tight(const F16& off) const { return abs(off) <= tight_; }
  [[nodiscard]] HWY_INLINE M16 close_by(const F16& off) const { return abs(off) <= clear_; }

 private:
  float z_, per_row_;
  F16 along_, gate_, tight_, clear_;
};

HWY_INLINE void hold(const Tile& tile, const TilePlane& plane, Held& out) {
  const Laid laid(plane);
  TileBits tight;
  out.plane = plane;
  out.on = {};
  for (int r = 0; r < kRows; ++r) {
    const F16 off = laid.off(load(tile.z[static_cast<std::size_t>(r)].data()), r);
    out.on.add(r, bits(laid.on(off)));
    tight.add(r, bits(laid.tight(off)));
  }
  out.on = out.on & tile.wanted;
  out.points = out.on.count();
  out.tight = (tight & tile.wanted).count();
  out.drifted = static_cast<float>(out.tight) < kTightShare * static_cast<float>(out.points);
}

/// Least squares over the points on the plane. Returns false if they do not determine a plane.
bool refit(const Tile& tile, const Held& held, TilePlane& plane) {
  const F16 u = lanes_from_middle();
  const F16 none = f16(0.0F);
  const Laid laid(held.plane);
  F16 n = none, n_v = none, n_vv = none, r = none, r_v = none;
  for (int row = 0; row < kRows; ++row) {
    const F16 v = f16(static_cast<float>(row) - kTileMidRow);
    const F16 off = laid.off(load(tile.z[static_cast<std::size_t>(row)].data()), row);
    const M16 in = lanes_of(held.on.row(row));
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
  // Points of one column or row do not determine the slope across it.
  if (!(det > 0.05 * count * count)) return false;
  const double a = (ru * vv - rv * uv) / det;
  const double b = (rv * uu - ru * uv) / det;
  plane = {held.plane.z + static_cast<float>(sr - a * su - b * sv), held.plane.per_column + static_cast<float>(a),
           held.plane.per_row + static_cast<float>(b)};
  return true;
}

/// Refits the plane to its points until it holds no more of them.
void settle(const Tile& tile, Held& held) {
  for (int i = 0; i < kRefits; ++i) {
    TilePlane plane;
    if (!refit(tile, held, plane)) return;
    Held next;
    hold(tile, plane, next);
    if (next.points < held.points || (next.points == held.points && next.tight <= held.tight)) return;
    const bool still = next.points == held.points && !next.drifted;
    held = next;
    if (still) return;
  }
}

/// Finds the best of a few planes through three points of the tile.
void draw_plane(const Tile& tile, Held& best) {
  alignas(64) std::array<float, kSample> u, v, z;
  const int step = 1 + (tile.points - 1) / kSample;
  std::size_t n = 0;
  int k = 0;
  for (int row = 0; row < kRows; ++row) {
    for (std::uint32_t left = tile.wanted.row(row); left != 0; left &= left - 1) {
      if (k++ % step != 0) continue;
      const auto c = static_cast<std::size_t>(std::countr_zero(left));
      u[n] = static_cast<float>(c) - kTileMidColumn;
      v[n] = static_cast<float>(row) - kTileMidRow;
      z[n++] = tile.z[static_cast<std::size_t>(row)][c];
    }
  }
  const std::size_t points = n;
  for (; n < kSample; ++n) u[n] = v[n] = 0.0F, z[n] = kNoPlane;
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

/// Finds the plane of the wanted points: an offered one if it holds most of them, else a new one. `best` stays
/// empty without a plane.
void find_plane(const Tile& tile, const std::array<TilePlane, 4>& offered, bool first, Held& best) {
  best = Held{};
  for (const TilePlane& plane : offered) {
    if (std::isnan(plane.z)) continue;
    Held held;
    hold(tile, plane, held);
    if (held.points > best.points) best = held;
    if (best.sure(tile)) return;
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

class PlaneFinder {
 public:
  PlaneFinder(const GridLayout& grid, GridWork& work) : grid_(grid), work_(work) {}

  /// Step 1 for one band, and step 2 for its inner tile rows while their points are in the cache.
  void find(std::size_t band) {
    GridCounts counts;
    const int first = grid_.first_tile_row(band);
    const int last = grid_.first_tile_row(band + 1);
    for (int tr = first; tr < last; ++tr) {
      for (int tc = 0; tc < grid_.tile_columns; ++tc) see(tc, tr, tr > first, counts);
      if (tr - first >= 2) judge_tile_row(grid_, work_, tr - 1);
    }
    work_.add(counts);
  }

 private:
  [[nodiscard]] std::size_t at(int column, int row) const {
    return static_cast<std::size_t>(row) * grid_.columns + static_cast<std::size_t>(column);
  }

  /// Heights of sixteen points, NaN beyond the `count` inside the grid.
  template <bool kPoints>
  [[nodiscard]] static HWY_INLINE F16 heights(const float* from, std::size_t count) {
    if constexpr (kPoints) {
      return (count < kLanes ? load_points(from, count) : load_points(from)).z;
    } else {
      if (count == kLanes) return load(from);
      alignas(64) std::array<float, kLanes> room;
      room.fill(kNoPlane);
      std::copy_n(from, count, room.data());
      return load(room.data());
    }
  }

  /// Loads a tile (`rows` rows and `count` columns inside the grid) and compares it with `held.plane` on the way.
  template <bool kPoints>
  HWY_INLINE void look(int tc, int tr, int rows, std::size_t count, Tile& tile, Held& held) const {
    constexpr std::size_t kNumbers = kPoints ? 3 : 1;
    const std::size_t stride = kNumbers * grid_.columns;
    const float* grid = kPoints ? work_.xyz : work_.z;
    const float* from = grid + kNumbers * at(kColumns * tc, kRows * tr);
    const float* below = grid + kNumbers * (at(0, kRows * (tr + 1)) + kTilePoints * static_cast<std::size_t>(tc));
    const F16 largest = f16(std::numeric_limits<float>::max());
    const Laid laid(held.plane);
    M16 unclear = largest < largest;
    std::uint32_t on = 0;
    std::uint32_t tight = 0;
#pragma GCC unroll 8
    for (int r = 0; r < rows; ++r, from += stride) {
      // Tiles jump from row to row, which the hardware prefetcher does not predict.
      for (std::size_t line = 0; line < kNumbers; ++line, below += kLanes) {
        hwy::Prefetch(from + kNumbers * kAhead + kLanes * line);
        __builtin_prefetch(below, 0, 2);
      }
      const F16 z = heights<kPoints>(from, count);
      const F16 off = laid.off(z, r);
      store(z, tile.z[static_cast<std::size_t>(r)].data());
      tile.wanted.add(r, bits(abs(z) <= largest));
      const M16 held_here = laid.on(off);
      held.on.add(r, bits(held_here));
      unclear = unclear | and_not(held_here, laid.close_by(off));
      // Drift of a plane shows in the tile's first and last row.
      if (r != 0 && r != kRows - 1) continue;
      on += static_cast<std::uint32_t>(std::popcount(held.on.row(r)));
      tight += static_cast<std::uint32_t>(std::popcount(bits(laid.tight(off))));
    }
    for (int r = rows; r < kRows; ++r) store(f16(kNoPlane), tile.z[static_cast<std::size_t>(r)].data());
    tile.points = tile.wanted.count();
    held.points = held.on.count();
    held.clear = !any(unclear);
    held.drifted = static_cast<float>(tight) < kTightShare * static_cast<float>(on);
  }
  HWY_INLINE void look(int tc, int tr, Tile& tile, Held& held) const {
    const int rows = std::min(kRows, static_cast<int>(grid_.rows) - kRows * tr);
    const std::size_t count = std::min(kLanes, grid_.columns - kLanes * static_cast<std::size_t>(tc));
    const bool whole = rows == kRows && count == kLanes;
    if (whole && work_.z == nullptr) return look<true>(tc, tr, kRows, kLanes, tile, held);
    if (whole) return look<false>(tc, tr, kRows, kLanes, tile, held);
    if (work_.z == nullptr) return look<true>(tc, tr, rows, count, tile, held);
    look<false>(tc, tr, rows, count, tile, held);
  }

  /// Processes one tile: tests whether the plane to the left continues.
  HWY_INLINE void see(int tc, int tr, bool above, GridCounts& counts) {
    const TilePlane* left = tc > 0 ? work_.planes(tc - 1, tr) : kNone.data();
    const TilePlane* up = above ? work_.planes(tc, tr - 1) : kNone.data();
    TilePlane* own = work_.planes(tc, tr);
    Tile tile;
    Held held;
    held.plane = moved(left[0], 1, 0);
    look(tc, tr, tile, held);
    counts.finite += static_cast<std::uint64_t>(tile.points);
    int marks = 0;
    if (tile.points >= kPlanePoints && held.sure(tile) && tile.points - held.points <= kCalmOff) {
      counts.with_plane += static_cast<std::uint64_t>(tile.points);
      own[0] = held.plane;
      own[1] = kNone[1];
      take(tile, held);
      if (std::isnan(left[1].z)) marks = TileMarks::kLikeLeft;
      if (held.clear) marks |= TileMarks::kClearOff;
    } else {
      counts.with_plane += find_tile_planes(tile, held, left, up, own);
      if (tc == 0 || alike(moved(left[0], 1, 0), left[1], own)) marks = TileMarks::kLikeLeft;
    }
    if (tr == 0 || alike(moved(up[0], 0, 1), up[1], own)) marks |= TileMarks::kLikeUp;
    if (!tile.wanted.none())
      work_.off.set(tc, tr, tile.wanted);
    else if (!std::isnan(own[0].z) && std::isnan(own[1].z) && !work_.too_steep(own[0]))
      marks |= TileMarks::kQuiet;
    work_.marks.of(tc, tr) = static_cast<std::uint8_t>(marks);
  }

  /// Otherwise tries planes of adjacent tiles, or new ones. Returns the number of points if one plane holds half of
  /// them.
  HWY_NOINLINE static std::uint64_t find_tile_planes(Tile& tile, Held& held, const TilePlane* left, const TilePlane* up,
                                                     TilePlane* own) {
    own[0] = own[1] = kNone[0];
    const int points = tile.points;
    if (points < kPlanePoints) return 0;
    const std::array offers{moved(left[0], 1, 0), moved(up[0], 0, 1), moved(up[1], 0, 1), moved(left[1], 1, 0)};
    bool most = false;
    for (int i = 0; i < 2; ++i) {
      find_plane(tile, offers, i == 0, held);
      if (held.points == 0) break;
      own[i] = held.plane;
      take(tile, held);
      if (i == 0) most = 2 * held.points >= points;
      if (tile.points <= kCalmOff || tile.points < kSecondPoints) break;
    }
    return most ? static_cast<std::uint64_t>(points) : 0;
  }

  /// True if the tile and an adjacent one have one plane each, and these are the same.
  [[nodiscard]] static bool alike(const TilePlane& first, const TilePlane& second, const TilePlane* own) {
    return std::isnan(second.z) && std::isnan(own[1].z) && apart_mm(first, own[0]) <= kStep_mm;
  }

  static constexpr std::array<TilePlane, 2> kNone{{{kNoPlane, 0.0F, 0.0F}, {kNoPlane, 0.0F, 0.0F}}};
  const GridLayout grid_;
  GridWork& work_;
};

}  // namespace

void find_planes(const GridLayout& grid, GridWork& work, std::size_t band) {
  PlaneFinder(grid, work).find(band);
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(find_planes);

void find_grid_planes(const GridLayout& grid, GridWork& work, std::size_t band) {
  HWY_DYNAMIC_DISPATCH(find_planes)(grid, work, band);
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
