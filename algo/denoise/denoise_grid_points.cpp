// SPDX-License-Identifier: Apache-2.0
//
// Denoising of an organised scan, step 2 (step 1 is in algo/denoise/denoise_grid.cpp): finds the points off their
// tile's planes that still have a surface through them.
//
// In a calm tile only the few points off its plane are tested, else every point. One of the planes of the nine tiles
// around must go through the point, and enough of the 7 x 7 points around must be on that plane too
// (algo/denoise/denoise_grid.h). At edges and corners and on the rims of small objects few are: there a point stays if
// a neighbour is inside the plane's surface. A point without a plane is noise if it is alone. With enough unexplained
// neighbours, as on a small object, it stays if a surface goes through it that is level, or has the slope of the tile
// or of its four neighbours.
//
// Nearly all tiles are calm and surrounded by tiles with the same plane. There a point off the plane is not tested
// against other planes, only for its neighbours.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/denoise/denoise_grid_points.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/denoise/denoise_grid.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

constexpr int kColumns = GridLayout::kTileColumns;
constexpr int kRows = GridLayout::kTileRows;

/// A plane dominates its tile if at most one of this number of points is off it.
constexpr int kReignShare = 4;
/// Planes count as one within this many gates at the corners of a tile, but never below kAlikeLevel_mm.
constexpr float kAlike = 0.25F;
/// A point with fewer unexplained points around it is alone.
constexpr int kCompany = 4;
/// Steepest slope accepted from four neighbours, mm per point.
constexpr float kOwnSlopeMax = 1.0F;
/// A surface continues to an adjacent point that is off by at most this part of the gate, which allows for the noise of
/// both. With a whole gate an outlier would be supported by a stray point.
constexpr float kGoesOn = 0.6F;
/// Planes with a wider gate are steep and do not continue: a point this far off may be an outlier.
constexpr float kGoesOnGate_mm = 0.75F;
constexpr std::size_t kCandidates = 18;

HWY_INLINE F16 lanes_from_middle() {
  return lane_numbers() - f16(kTileMidColumn);
}
class PointJudge {
 public:
  PointJudge(const GridLayout& grid, GridWork& work) : grid_(grid), work_(work) {}

  void judge_row(int tr) {
    for (int tc = 0; tc < grid_.tile_columns; ++tc) judge_tile(tc, tr);
  }

 private:
  [[nodiscard]] float height(int column, int row) const {
    const std::size_t i = static_cast<std::size_t>(row) * grid_.columns + static_cast<std::size_t>(column);
    return work_.z != nullptr ? work_.z[i] : work_.xyz[3 * i + 2];
  }

  /// The tile and four points around it, so that its neighbours have whole windows; 8 more columns on each side,
  /// because lanes come by sixteen.
  static constexpr int kReach = window::kReach + 1;
  static constexpr int kRegionRows = kRows + 2 * kReach;
  static constexpr int kMargin = 8;
  struct Region {
    alignas(64) std::array<std::array<float, 2 * kColumns>, kRegionRows> z;
    std::array<std::uint32_t, kRegionRows> finite;
  };
  using RegionBits = std::array<std::uint32_t, kRegionRows>;

  /// Heights from `column` on, which may be left of the grid; NaN where a point is missing or the grid has ended.
  [[nodiscard]] HWY_INLINE F16 sixteen(int column, int row) const {
    if (column >= 0 && column + kColumns <= static_cast<int>(grid_.columns)) {
      const std::size_t i = static_cast<std::size_t>(row) * grid_.columns + static_cast<std::size_t>(column);
      return work_.z != nullptr ? load(work_.z + i) : load_points(work_.xyz + 3 * i).z;
    }
    alignas(64) std::array<float, kColumns> room;
    for (int k = 0; k < kColumns; ++k) {
      const bool inside = column + k >= 0 && column + k < static_cast<int>(grid_.columns);
      room[static_cast<std::size_t>(k)] = inside ? height(column + k, row) : kNoPlane;
    }
    return load(room.data());
  }
  void fill(Region& region, int tc, int tr) const {
    const int column = kColumns * tc - kMargin;
    const F16 largest = f16(std::numeric_limits<float>::max());
    for (int r = 0; r < kRegionRows; ++r) {
      const int row = kRows * tr + r - kReach;
      const bool inside = row >= 0 && row < static_cast<int>(grid_.rows);
      const F16 left = inside ? sixteen(column, row) : f16(kNoPlane);
      const F16 right = inside ? sixteen(column + kColumns, row) : f16(kNoPlane);
      const auto k = static_cast<std::size_t>(r);
      store(left, region.z[k].data());
      store(right, region.z[k].data() + kColumns);
      region.finite[k] = bits(abs(left) <= largest) | (bits(abs(right) <= largest) << static_cast<unsigned>(kColumns));
    }
  }

  /// Marks the points of the region that are on the plane.
  static void on_plane(const Region& region, const TilePlane& plane, RegionBits& on) {
    const F16 gate = f16(gate_of(plane));
    const F16 left = f16(plane.per_column) * (lanes_from_middle() - f16(kMargin));
    const F16 right = f16(plane.per_column) * (lanes_from_middle() + f16(kColumns - kMargin));
    for (int r = 0; r < kRegionRows; ++r) {
      const auto k = static_cast<std::size_t>(r);
      const F16 at = f16(plane.z + plane.per_row * (static_cast<float>(r - kReach) - kTileMidRow));
      on[k] = bits(abs(load(region.z[k].data()) - (at + left)) <= gate) |
              (bits(abs(load(region.z[k].data() + kColumns) - (at + right)) <= gate) << kColumns);
    }
  }
  /// True if any of the tile's open points is on the plane.
  [[nodiscard]] static bool any_on_plane(const Region& region, const TilePlane& plane, const TileBits& open) {
    const F16 gate = f16(gate_of(plane));
    const F16 along = f16(plane.per_column) * lanes_from_middle();
    for (int r = 0; r < kRows; ++r) {
      if (open.row(r) == 0) continue;
      const F16 at = f16(plane.z + plane.per_row * (static_cast<float>(r) - kTileMidRow));
      const float* z = region.z[static_cast<std::size_t>(r + kReach)].data() + kMargin;
      if ((bits(abs(load(z) - (at + along)) <= gate) & open.row(r)) != 0) return true;
    }
    return false;
  }
  /// The window around a point that is in the tile or adjacent to one in it.
  [[nodiscard]] static HWY_INLINE std::uint64_t window_of(const RegionBits& rows, int column, int row) {
    std::uint64_t bits = 0;
    for (int k = 0; k < window::kSide; ++k)
      bits |= std::uint64_t{(rows[static_cast<std::size_t>(row + kReach - window::kReach + k)] >>
                             (column + kMargin - window::kReach)) &
                            0x7FU}
              << (7 * k);
    return bits;
  }

  /// Collects the planes of the nine tiles around, relative to this one; its own come first.
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
          const float off = apart_mm(plane, planes[k]);
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

  /// Distance of a point of the tile from a plane, mm.
  [[nodiscard]] float off_mm(int tc, int tr, int column, int row, const TilePlane& plane) const {
    const float at = plane.z + plane.per_column * (static_cast<float>(column) - kTileMidColumn) +
                     plane.per_row * (static_cast<float>(row) - kTileMidRow);
    return std::abs(height(kColumns * tc + column, kRows * tr + row) - at);
  }
  /// True if any of a calm tile's open points may be near a plane other than its own. A cheap test that avoids an
  /// expensive one; false positives are possible.
  [[nodiscard]] bool near_other_plane(int tc, int tr, const TileBits& open) const {
    const TilePlane& own = work_.planes(tc, tr)[0];
    if (work_.marks.same_plane_around(tc, tr) && (work_.marks.of(tc, tr) & TileMarks::kClearOff) != 0) return false;
    for (int r = std::max(0, tr - 1); r <= std::min(grid_.tile_rows - 1, tr + 1); ++r) {
      for (int c = std::max(0, tc - 1); c <= std::min(grid_.tile_columns - 1, tc + 1); ++c) {
        for (int i = 0; i < 2; ++i) {
          // A plane through absurd heights becomes NaN when it is moved; the tile's other plane is still tested.
          if (std::isnan(work_.planes(c, r)[i].z)) break;
          const TilePlane plane = moved(work_.planes(c, r)[i], tc - c, tr - r);
          if (apart_mm(plane, own) <= kAlikeLevel_mm) continue;
          const float gate = 1.05F * gate_of(plane);
          bool near = false;
          open.for_each([&](int column, int row) { near = near || off_mm(tc, tr, column, row, plane) <= gate; });
          if (near) return true;
        }
      }
    }
    return false;
  }

  HWY_INLINE void judge_tile(int tc, int tr) {
    if ((work_.marks.of(tc, tr) & TileMarks::kQuiet) != 0) return;
    const TileBits open = work_.off.of_tile(tc, tr);
    const TilePlane* own = work_.planes(tc, tr);
    const bool calm =
        !std::isnan(own[0].z) && std::isnan(own[1].z) && open.count() <= kCalmOff && !work_.too_steep(own[0]);
    if (!calm || near_other_plane(tc, tr, open)) return judge_by_planes(tc, tr, calm, open);
    // Nearly always there are too few open points around the tile for any of them to have company.
    if (work_.off.count_about(tc, tr) <= kCompany) return work_.noise.set(tc, tr, open);
    judge_in_company(tc, tr, nullptr, open);
  }
  [[nodiscard]] HWY_INLINE bool in_company(int tc, int tr, int column, int row) const {
    return std::popcount(work_.off.around(kColumns * tc + column, kRows * tr + row) & window::kAround) >= kCompany;
  }

  /// Judges points against the planes of the nine tiles first.
  HWY_NOINLINE void judge_by_planes(int tc, int tr, bool calm, TileBits open) {
    const TilePlane* own = work_.planes(tc, tr);
    const int off = open.count();
    Region region;
    fill(region, tc, tr);
    if (!calm)
      for (int r = 0; r < kRows; ++r)
        open.set(r, (region.finite[static_cast<std::size_t>(r + kReach)] >> kMargin) & 0xFFFFU);
    // No plane dominates if the tile has none of its own: the first plane gathered is then another tile's.
    const bool reigns =
        !std::isnan(own[0].z) && std::isnan(own[1].z) && !work_.too_steep(own[0]) && kReignShare * off <= open.count();
    std::array<TilePlane, kCandidates> planes;
    const std::size_t n = gather_planes(tc, tr, planes);
    for (std::size_t i = calm ? 1 : 0; i < n; ++i)
      explain(region, planes[i], reigns && i == 0 ? window::kShareReigning : window::kShareMin, open);
    judge_in_company(tc, tr, &region, open);
  }

  /// Judges points without a plane: noise if alone, or if no surface goes through. `region` may be null.
  HWY_NOINLINE void judge_in_company(int tc, int tr, const Region* region, const TileBits& open) {
    Region own_region;
    TileBits noise;
    open.for_each([&](int c, int r) {
      if (in_company(tc, tr, c, r)) {
        if (region == nullptr) {
          fill(own_region, tc, tr);
          region = &own_region;
        }
        if (through(*region, c, r, work_.planes(tc, tr)[0])) return;
      }
      noise.add(r, 1U << static_cast<unsigned>(c));
    });
    work_.noise.set(tc, tr, noise);
  }

  /// True if an adjacent point is inside the surface.
  [[nodiscard]] static bool beside_surface(const RegionBits& on, const RegionBits& finite, int column, int row) {
    for (int r = row - 1; r <= row + 1; ++r)
      for (int c = column - 1; c <= column + 1; ++c)
        if (((on[static_cast<std::size_t>(r + kReach)] >> (c + kMargin)) & 1U) != 0 &&
            window::holds_middle(window_of(on, c, r), window_of(finite, c, r), window::kShareAmidst))
          return true;
    return false;
  }

  /// Removes the points explained by the plane from `open`.
  static void explain(const Region& region, const TilePlane& plane, int share, TileBits& open) {
    if (!any_on_plane(region, plane, open)) return;
    RegionBits on;
    on_plane(region, plane, on);
    // Most results need no counting and are found for a row at once (weights: algo/denoise/denoise_grid.h). One case:
    // none of the twenty nearest points is off the plane, and five of the nearest are on it: 55 against at most 16. The
    // other: all eight nearest and two more are on it: 100 of 176.
    RegionBits off;
    for (std::size_t k = 0; k < kRegionRows; ++k) off[k] = region.finite[k] & ~on[k];
    const auto beside = [](std::uint32_t bits) { return (bits << 1U) | (bits >> 1U); };
    for (std::size_t r = 0; r < kRows; ++r) {
      const std::size_t k = r + kReach;
      const std::uint32_t cross = on[k] & (on[k] << 1U) & (on[k] >> 1U) & on[k - 1] & on[k + 1];
      const std::uint32_t corners = beside(on[k - 1] | on[k + 1]);
      const std::uint32_t near = off[k - 2] | off[k - 1] | off[k] | off[k + 1] | off[k + 2];
      const std::uint32_t wide = off[k - 1] | off[k] | off[k + 1];
      const std::uint32_t clear = ~(near | beside(near) | (wide << 2U) | (wide >> 2U));
      const std::uint32_t all_corners = (on[k - 1] << 1U) & (on[k - 1] >> 1U) & (on[k + 1] << 1U) & (on[k + 1] >> 1U);
      const std::uint32_t two_more = ((on[k] << 2U) | (on[k] >> 2U)) & (on[k - 2] | on[k + 2]);
      const std::uint32_t known = cross & ((corners & clear) | (all_corners & two_more));
      const int row = static_cast<int>(r);
      open.set(row, open.row(row) & ~(known >> kMargin));
    }
    const bool goes_on = gate_of(plane) <= kGoesOnGate_mm;
    for (int r = 0; r < kRows; ++r) {
      std::uint32_t row = open.row(r);
      for (std::uint32_t left = row & (on[static_cast<std::size_t>(r + kReach)] >> kMargin); left != 0;
           left &= left - 1) {
        const int c = std::countr_zero(left);
        if (window::holds_middle(window_of(on, c, r), window_of(region.finite, c, r), share) ||
            (goes_on && beside_surface(on, region.finite, c, r)))
          row &= ~(left & -left);
      }
      open.set(r, row);
    }
  }

  /// True if a surface goes through the point, or continues to it from a neighbour: level, or as steep as the tile's
  /// plane. Also if the point is inside a surface as steep as its four neighbours rise; two clumps may imitate a little
  /// of such a surface. Slopes of steep faces further away are not used: their wide gate would connect a clump to the
  /// surface below it.
  static bool through(const Region& region, int column, int row, const TilePlane& own) {
    const auto z = [&](int c, int r) {
      return region.z[static_cast<std::size_t>(row + kReach + r)][static_cast<std::size_t>(column + kMargin + c)];
    };
    // True if the surface through the point offset by (c, r), rising a per column and b per row, holds this share
    // around it.
    const auto holds = [&](float a, float b, int c, int r, int share) {
      const F16 gate = f16(grid_gate_mm(a, b));
      const F16 along = f16(a) * (lane_numbers() - f16(window::kReach)) + f16(z(c, r));
      std::uint64_t on = 0;
      for (int k = 0; k < window::kSide; ++k) {
        const int up = k - window::kReach;
        const float* from =
            region.z[static_cast<std::size_t>(row + r + kReach + up)].data() + column + c + kMargin - window::kReach;
        const F16 at = along + f16(b * static_cast<float>(up));
        on |= std::uint64_t{bits(abs(load(from) - at) <= gate) & 0x7FU} << (7 * k);
      }
      return window::holds_middle(on, window_of(region.finite, column + c, row + r), share);
    };
    const auto goes_on = [&](float a, float b) {
      for (int r = -1; r <= 1; ++r) {
        for (int c = -1; c <= 1; ++c) {
          const float step = z(c, r) - z(0, 0) - (a * static_cast<float>(c) + b * static_cast<float>(r));
          if (std::abs(step) <= kGoesOn * grid_gate_mm(a, b) && holds(a, b, c, r, window::kShareAmidst)) return true;
        }
      }
      return false;
    };
    if (holds(0.0F, 0.0F, 0, 0, window::kShareMin) || goes_on(0.0F, 0.0F)) return true;
    const float a_own = own.per_column;
    const float b_own = own.per_row;
    if (holds(a_own, b_own, 0, 0, window::kShareMin) || goes_on(a_own, b_own)) return true;
    const float a = 0.5F * (z(1, 0) - z(-1, 0));
    const float b = 0.5F * (z(0, 1) - z(0, -1));
    return a * a + b * b <= kOwnSlopeMax * kOwnSlopeMax && holds(a, b, 0, 0, window::kShareAmidst);
  }

  const GridLayout grid_;
  GridWork& work_;
};

}  // namespace

void judge_row(const GridLayout& grid, GridWork& work, int tile_row) {
  PointJudge(grid, work).judge_row(tile_row);
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(judge_row);

void judge_tile_row(const GridLayout& grid, GridWork& work, int tile_row) {
  HWY_DYNAMIC_DISPATCH(judge_row)(grid, work, tile_row);
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
