// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "algo/denoise/denoise.h"

namespace slabd::algo {

// Tests whether a surface goes through a point of a grid, in the window of 7 x 7 points around it, one bit each: bit 7
// * row + column, the point itself in the middle (bit 24). Near points have more weight; the weights are integers, so
// the result is exact.

namespace window {

inline constexpr int kReach = 3;  ///< rows and columns each way
inline constexpr int kSide = 2 * kReach + 1;

/// The points within sqrt(`distance2`) of the middle, without the middle.
constexpr std::uint64_t disc(int distance2) {
  std::uint64_t bits = 0;
  for (int r = -kReach; r <= kReach; ++r)
    for (int c = -kReach; c <= kReach; ++c)
      if (r * r + c * c > 0 && r * r + c * c <= distance2)
        bits |= std::uint64_t{1} << static_cast<unsigned>(kSide * (r + kReach) + c + kReach);
  return bits;
}
inline constexpr std::uint64_t kNear = disc(2);
inline constexpr std::uint64_t kMiddle = disc(5);
inline constexpr std::uint64_t kFar = disc(10);
inline constexpr std::uint64_t kAround = ((std::uint64_t{1} << 49U) - 1U) & ~(std::uint64_t{1} << 24U);

/// Weight 11 for the 8 nearest points, 6 for the next 12, 1 for 16 more: 176 in all. Close to (1 - d^2 / 3.5^2)^2.
[[gnu::always_inline]] inline int weight(std::uint64_t bits) {
  return 5 * (std::popcount(bits & kNear) + std::popcount(bits & kMiddle)) + std::popcount(bits & kFar);
}

/// Minimum weight on a surface with the point. It is more than that of four nearest points, so that a clump of five is
/// noise.
inline constexpr int kWeightMin = 48;
/// Share of the weight present that must be on the surface, in per cent. Of a full surface's weight an edge has 60, a
/// corner 36, a point one step beyond an edge 40, the second row 87. Where one plane dominates its tile, among clutter
/// but far from edges, a smaller share is enough.
inline constexpr int kShareReigning = 46;
inline constexpr int kShareMin = 55;
/// A point with this share is inside the surface: no edge has that much. The surface continues from it to its
/// neighbours, so that edges and corners among clutter stay, and small objects keep their rims. A point one step beyond
/// an edge has only edge points as neighbours.
inline constexpr int kShareAmidst = 65;

/// `on`: points on a surface through the middle; `present`: all measured points; `share`: in per cent.
[[gnu::always_inline]] inline bool holds_middle(std::uint64_t on, std::uint64_t present, int share) {
  const int held = weight(on);
  return held >= kWeightMin && 100 * held >= share * weight(present);
}

}  // namespace window

inline constexpr float kNoPlane = std::numeric_limits<float>::quiet_NaN();

/// Gate of a plane: the height must be within noise plus a third of the plane's rise per point. Across a steep plane
/// that is a third of a row, so that a steep plane never holds two rows of a level surface. On a level plane, noise
/// with heavy tails belongs to the surface, an outlier of a millimetre does not.
inline float grid_gate_mm(float per_column, float per_row) {
  constexpr float kLevel_mm = 0.6F;
  constexpr float kNoise_mm = 0.45F;
  constexpr float kRise = 0.35F;
  return std::max(kLevel_mm, kNoise_mm + kRise * std::sqrt(per_column * per_column + per_row * per_row));
}

inline float gate_of(const TilePlane& p) {
  return grid_gate_mm(p.per_column, p.per_row);
}

/// Division of an organised scan into tiles and bands.
struct GridLayout {
  static constexpr int kTileColumns = 16;
  static constexpr int kTileRows = 8;
  /// Bands are the units that threads share.
  static constexpr int kBandTileRows = 32;
  /// A narrower grid does not pay, and its masks would be larger than the scan.
  static constexpr std::size_t kColumnsMin = 64;
  static constexpr std::size_t kRowsMin = 64;

  GridLayout(std::size_t width, std::size_t height)
      : columns(width),
        rows(height),
        tile_columns(static_cast<int>((width + kTileColumns - 1) / kTileColumns)),
        tile_rows(static_cast<int>((height + kTileRows - 1) / kTileRows)) {}

  std::size_t columns, rows;
  int tile_columns, tile_rows;

  [[nodiscard]] std::size_t tiles() const {
    return static_cast<std::size_t>(tile_columns) * static_cast<std::size_t>(tile_rows);
  }
  [[nodiscard]] std::size_t bands() const {
    return (static_cast<std::size_t>(tile_rows) + kBandTileRows - 1) / kBandTileRows;
  }
  [[nodiscard]] int first_tile_row(std::size_t band) const {
    return std::min(static_cast<int>(band) * kBandTileRows, tile_rows);
  }
  /// Bytes of a mask row, with one extra tile on the left and the right so that windows may extend over the edge.
  [[nodiscard]] std::size_t mask_stride() const { return 2 * (static_cast<std::size_t>(tile_columns) + 3); }
  [[nodiscard]] std::size_t mask_bytes() const {
    return mask_stride() * static_cast<std::size_t>(kTileRows * tile_rows + 2 * window::kReach);
  }
  [[nodiscard]] std::size_t marks_bytes() const {
    return (static_cast<std::size_t>(tile_columns) + 1) * (static_cast<std::size_t>(tile_rows) + 2);
  }
  /// Bytes of `DenoiseWorkspace::keep` for GridWork, from the first byte on.
  [[nodiscard]] std::size_t work_bytes() const { return 2 * mask_bytes() + marks_bytes(); }
  [[nodiscard]] bool fits(const DenoiseWorkspace& memory) const {
    return 2 * tiles() <= memory.surface.size() && work_bytes() <= memory.keep.size();
  }
};

/// Middle of a tile, the origin of its planes, and a plane re-expressed for a tile N tiles further.
inline constexpr float kTileMidColumn = 0.5F * static_cast<float>(GridLayout::kTileColumns - 1);
inline constexpr float kTileMidRow = 0.5F * static_cast<float>(GridLayout::kTileRows - 1);
[[gnu::always_inline]] inline TilePlane moved(const TilePlane& p, int columns, int rows) {
  return {p.z + static_cast<float>(GridLayout::kTileColumns * columns) * p.per_column +
              static_cast<float>(GridLayout::kTileRows * rows) * p.per_row,
          p.per_column, p.per_row};
}
/// Largest distance of two planes at the corners of a tile.
[[gnu::always_inline]] inline float apart_mm(const TilePlane& a, const TilePlane& b) {
  return std::abs(a.z - b.z) + 8.0F * std::abs(a.per_column - b.per_column) + 4.0F * std::abs(a.per_row - b.per_row);
}
/// Planes closer than this count as one; for adjacent tiles, closer than kStep_mm counts as the same (TileMarks).
inline constexpr float kAlikeLevel_mm = 0.15F;
inline constexpr float kStep_mm = 0.2F;
/// Points further off a plane than this are on none of the similar planes around. Those are two steps apart, each
/// relative to its own tile, and their gates differ by at most a tenth.
inline float clear_off_mm(const TilePlane& p) {
  return 1.1F * gate_of(p) + 4.0F * kStep_mm;
}
/// A tile is calm if at most this number of its points is off its plane.
inline constexpr int kCalmOff = 10;

/// One bit for each point of a tile, four rows in a word. Always inlined, so that bit counting compiles to one
/// instruction in the caller's instruction set and not in that of this header's first inclusion.
struct TileBits {
  std::array<std::uint64_t, 2> four_rows{};

  [[gnu::always_inline]] [[nodiscard]] std::uint32_t row(int r) const {
    return static_cast<std::uint32_t>(four_rows[static_cast<std::size_t>(r / 4)] >> (16 * (r % 4))) & 0xFFFFU;
  }
  [[gnu::always_inline]] void add(int r, std::uint32_t bits) {
    four_rows[static_cast<std::size_t>(r / 4)] |= std::uint64_t{bits} << (16 * (r % 4));
  }
  [[gnu::always_inline]] void set(int r, std::uint32_t bits) {
    four_rows[static_cast<std::size_t>(r / 4)] &= ~(std::uint64_t{0xFFFF} << (16 * (r % 4)));
    add(r, bits);
  }
  [[gnu::always_inline]] [[nodiscard]] int count() const {
    return std::popcount(four_rows[0]) + std::popcount(four_rows[1]);
  }
  [[nodiscard]] bool none() const { return (four_rows[0] | four_rows[1]) == 0; }
  /// Calls f(column, row) for every set bit, row by row.
  template <typename F>
  [[gnu::always_inline]] void for_each(F&& f) const {
    for (int half = 0; half < 2; ++half) {
      for (std::uint64_t left = four_rows[static_cast<std::size_t>(half)]; left != 0; left &= left - 1) {
        const int bit = std::countr_zero(left);
        f(bit % 16, 4 * half + bit / 16);
      }
    }
  }
};
[[gnu::always_inline]] inline TileBits operator&(const TileBits& a, const TileBits& b) {
  return {{a.four_rows[0] & b.four_rows[0], a.four_rows[1] & b.four_rows[1]}};
}
/// The bits of `b` that are not in `a`.
[[gnu::always_inline]] inline TileBits and_not(const TileBits& a, const TileBits& b) {
  return {{~a.four_rows[0] & b.four_rows[0], ~a.four_rows[1] & b.four_rows[1]}};
}

/// A mask of one bit per point, stored by tiles.
class GridMask {
 public:
  GridMask(const GridLayout& grid, std::uint8_t* memory) : memory_(memory), stride_(grid.mask_stride()) {
    std::fill_n(memory_, grid.mask_bytes(), std::uint8_t{0});
  }
  /// Bits of sixteen points from `column` on, all in one row.
  [[nodiscard]] std::uint32_t sixteen(int column, int row) const {
    std::uint32_t word = 0;
    std::memcpy(&word, at(row) + 2 + column / 8, sizeof word);
    return (word >> (static_cast<unsigned>(column) % 8)) & 0xFFFFU;
  }
  /// True if any of `points` (at most 32) bits in one row is set.
  [[nodiscard]] bool any(int column, int points, int row) const {
    std::uint64_t word = 0;
    std::memcpy(&word, at(row) + 2 + column / 8, sizeof word);
    return ((word >> (static_cast<unsigned>(column) % 8)) &
            ((std::uint64_t{1} << static_cast<unsigned>(points)) - 1)) != 0;
  }
  [[gnu::always_inline]] void set(int tile_column, int row, std::uint32_t bits) {
    const auto half = static_cast<std::uint16_t>(bits);
    std::memcpy(at(row) + 2 + 2 * tile_column, &half, sizeof half);
  }
  [[gnu::always_inline]] void set(int tile_column, int tile_row, const TileBits& bits) {
    for (int r = 0; r < GridLayout::kTileRows; ++r) set(tile_column, GridLayout::kTileRows * tile_row + r, bits.row(r));
  }
  [[gnu::always_inline]] [[nodiscard]] TileBits of_tile(int tile_column, int tile_row) const {
    TileBits bits;
    for (int r = 0; r < GridLayout::kTileRows; ++r)
      bits.add(r, tile(tile_column, GridLayout::kTileRows * tile_row + r));
    return bits;
  }
  [[nodiscard]] std::uint32_t tile(int tile_column, int row) const {
    std::uint16_t half = 0;
    std::memcpy(&half, at(row) + 2 + 2 * tile_column, sizeof half);
    return half;
  }
  /// Bits of 64 points from `column`, a multiple of 64, but not beyond the row's last tile.
  [[nodiscard]] std::uint64_t sixtyfour(std::size_t column, std::size_t row) const {
    std::uint64_t word = 0;
    const std::size_t first = 2 + column / 8;
    std::memcpy(&word, at(static_cast<int>(row)) + first, std::min(sizeof word, stride_ - 4 - first));
    return word;
  }
  /// Bits of 64 points from column - 8 on, `column` a multiple of eight. The kInner bits from `column` on and one more
  /// on each side belong to the row, even beyond its end; the remaining ones may not.
  static constexpr int kInner = 48;
  [[nodiscard]] std::uint64_t wide(int column, int row) const {
    std::uint64_t word = 0;
    std::memcpy(&word, at(row) + 1 + column / 8, sizeof word);
    return word;
  }
  /// Bit of one point, which may be one step outside the grid.
  [[nodiscard]] bool bit(int column, int row) const {
    const auto bit = static_cast<unsigned>(column + 16);
    return ((static_cast<unsigned>(at(row)[bit / 8]) >> (bit % 8)) & 1U) != 0;
  }
  void set_bit(int column, int row) {
    const auto bit = static_cast<unsigned>(column + 16);
    at(row)[bit / 8] = static_cast<std::uint8_t>(at(row)[bit / 8] | (1U << (bit % 8)));
  }
  void clear(int column, int row) {
    const auto bit = static_cast<unsigned>(column + 16);
    at(row)[bit / 8] = static_cast<std::uint8_t>(at(row)[bit / 8] & ~(1U << (bit % 8)));
  }
  /// Copies rows [first, last) of another mask of the same grid.
  void copy(const GridMask& from, int first, int last) {
    if (first < last) std::copy(from.at(first), from.at(last), at(first));
  }
  /// Number of set bits in a tile and within a window's reach of it.
  [[gnu::always_inline]] [[nodiscard]] int count_about(int tile_column, int tile_row) const {
    constexpr unsigned kFirst = 16 - window::kReach;
    constexpr std::uint32_t kWide = ((1U << (GridLayout::kTileColumns + 2 * window::kReach)) - 1U) << (kFirst % 8);
    const std::uint8_t* from = at(GridLayout::kTileRows * tile_row - window::kReach) + 2 * tile_column + kFirst / 8;
    int count = 0;
    for (int r = 0; r < GridLayout::kTileRows + 2 * window::kReach; ++r, from += stride_) {
      std::uint32_t word = 0;
      std::memcpy(&word, from, sizeof word);
      count += std::popcount(word & kWide);
    }
    return count;
  }
  /// Bits of the 7 x 7 points around a point.
  [[nodiscard]] std::uint64_t around(int column, int row) const {
    std::uint64_t bits = 0;
    const auto bit = static_cast<unsigned>(column + 16 - window::kReach);
    for (int k = 0; k < window::kSide; ++k) {
      std::uint32_t word = 0;
      std::memcpy(&word, at(row + k - window::kReach) + bit / 8, sizeof word);
      bits |= std::uint64_t{(word >> (bit % 8)) & 0x7FU} << (7 * k);
    }
    return bits;
  }

 private:
  [[nodiscard]] std::uint8_t* at(int row) const {
    return memory_ + static_cast<std::size_t>(row + window::kReach) * stride_;
  }
  std::uint8_t* memory_;
  std::size_t stride_;
};

/// Summary of each tile, one byte. Outside the grid, and until a tile was processed, its marks are those of a
/// continuing plane.
class TileMarks {
 public:
  static constexpr std::uint8_t kQuiet = 1;     ///< one plane holds all of its points
  static constexpr std::uint8_t kLikeLeft = 2;  ///< it and the tile to the left have one plane each, the same
  static constexpr std::uint8_t kLikeUp = 4;    ///< the same for it and the tile above
  /// The points off the tile's plane are so far off that they are on no similar plane around.
  static constexpr std::uint8_t kClearOff = 8;
  /// After the judgement, in a row's first tile, instead of all other marks: a group of noise may start here.
  static constexpr std::uint8_t kStarts = 16;

  TileMarks(const GridLayout& grid, std::uint8_t* memory)
      : memory_(memory), stride_(static_cast<std::size_t>(grid.tile_columns) + 1) {
    std::fill_n(memory_, grid.marks_bytes(), std::uint8_t{kLikeLeft | kLikeUp});
  }
  [[nodiscard]] std::uint8_t& of(int tile_column, int tile_row) const {
    return memory_[static_cast<std::size_t>(tile_row + 1) * stride_ + static_cast<std::size_t>(tile_column)];
  }
  /// True if the tile and the eight around it have one and the same plane.
  [[nodiscard]] bool same_plane_around(int tile_column, int tile_row) const {
    const std::uint8_t* here = &of(tile_column, tile_row);
    const std::uint8_t* up = here - stride_;
    const std::uint8_t* down = here + stride_;
    const int left = up[0] & up[1] & here[0] & here[1] & down[0] & down[1] & kLikeLeft;
    return left != 0 && (here[0] & down[0] & kLikeUp) != 0;
  }

 private:
  std::uint8_t* memory_;
  std::size_t stride_;
};

/// Counts of one band.
struct GridCounts {
  std::uint64_t finite = 0;
  std::uint64_t with_plane = 0;  ///< points of tiles in which one plane holds half of them
};

/// The scan and the intermediate results, shared by all bands.
struct GridWork {
  /// The grid is the scan itself or, if `points` is null, a table of heights, NaN in empty cells.
  GridWork(const GridLayout& grid, float* points, const float* heights, const DenoiseWorkspace& memory)
      : xyz(points),
        z(heights),
        surface(memory.surface.data()),
        tile_columns(static_cast<std::size_t>(grid.tile_columns)),
        off(grid, memory.keep.data()),
        noise(grid, memory.keep.data() + grid.mask_bytes()),
        marks(grid, memory.keep.data() + 2 * grid.mask_bytes()) {}

  /// The two planes of a tile.
  [[nodiscard]] TilePlane* planes(int tile_column, int tile_row) const {
    return surface + 2 * (static_cast<std::size_t>(tile_row) * tile_columns + static_cast<std::size_t>(tile_column));
  }
  void add(const GridCounts& counts) {
    finite += counts.finite;
    with_plane += counts.with_plane;
  }

  /// Measures the distances of neighbours in XY, along rows and along columns: medians of a thousand.
  void measure_pitch(const GridLayout& grid) {
    per_column_mm = median_step(grid, false);
    per_row_mm = median_step(grid, true);
  }
  /// True if the points next to and below a point are its neighbours. The pitch must be measured. Planes cannot show
  /// it: on a level seat points of unrelated columns share a plane. With a wrong width each row is shifted. One point
  /// is accepted, and any shift if rows are far apart: then points connected along a column still touch.
  [[nodiscard]] bool neighbours_are_near(const GridLayout& grid) const {
    constexpr float kShearMax = 1.5F;    // in steps of the shorter side
    constexpr float kUnevenMax = 64.0F;  // lines of a moving robot may be far apart, up to this ratio
    const float uneven = std::max(per_column_mm, per_row_mm) / std::min(per_column_mm, per_row_mm);
    return uneven <= kUnevenMax && median_shear(grid) <= kShearMax;
  }
  /// True if steeper than 85 degrees: this is not a visible face but two surfaces at different depths.
  [[nodiscard]] bool too_steep(const TilePlane& plane) const {
    constexpr float kSlopeMax = 11.5F;
    const float along = plane.per_column * per_row_mm;
    const float across = plane.per_row * per_column_mm;
    const float most = kSlopeMax * per_column_mm * per_row_mm;
    return along * along + across * across > most * most;
  }

  float* xyz;
  const float* z;
  float per_column_mm = 1.0F;
  float per_row_mm = 1.0F;
  TilePlane* surface;
  std::size_t tile_columns;
  GridMask off;    ///< finite, and on none of its tile's planes; overwritten by keep_noise_groups
  GridMask noise;  ///< to be removed
  TileMarks marks;
  std::atomic<std::uint64_t> finite{0};
  std::atomic<std::uint64_t> with_plane{0};

 private:
  /// Median of f(point, next in the row, next in the column) at a thousand grid positions, without NaN.
  template <typename F>
  [[nodiscard]] float median_of(const GridLayout& grid, float if_none, F&& f) const {
    constexpr std::size_t kSide = 32;
    std::array<float, kSide * kSide> values{};
    std::size_t n = 0;
    for (std::size_t r = 0; r < kSide; ++r) {
      for (std::size_t c = 0; c < kSide; ++c) {
        const float* p = xyz + 3 * (r * (grid.rows - 1) / kSide * grid.columns + c * (grid.columns - 1) / kSide);
        const float value = f(p, p + 3, p + 3 * grid.columns);
        if (std::isfinite(value)) values[n++] = value;
      }
    }
    if (n == 0) return if_none;
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n / 2),
                     values.begin() + static_cast<std::ptrdiff_t>(n));
    return values[n / 2];
  }
  [[nodiscard]] float median_step(const GridLayout& grid, bool to_row_below) const {
    return median_of(grid, 1.0F, [&](const float* p, const float* beside, const float* below) {
      const float* q = to_row_below ? below : beside;
      const float mm = std::hypot(q[0] - p[0], q[1] - p[1]);
      return mm > 0.0F ? mm : kNoPlane;
    });
  }
  /// Component of the longer step along the shorter one, in shorter steps.
  [[nodiscard]] float median_shear(const GridLayout& grid) const {
    return median_of(grid, kNoPlane, [](const float* p, const float* beside, const float* below) {
      const float ax = beside[0] - p[0], ay = beside[1] - p[1];
      const float bx = below[0] - p[0], by = below[1] - p[1];
      return std::abs(ax * bx + ay * by) / std::min(ax * ax + ay * ay, bx * bx + by * by);
    });
  }
};

/// Computes the planes of one band's tiles and judges all its tile rows but the first and the last.
void find_grid_planes(const GridLayout& grid, GridWork& work, std::size_t band);
/// Judges one tile row. The planes of the rows above and below, if they exist, must be computed.
void judge_tile_row(const GridLayout& grid, GridWork& work, int tile_row);

/// Runs steps 1 and 2 for all bands. False if most points have no plane in their tile: then neighbours in the grid are
/// not neighbours in space.
[[nodiscard]] bool judge_grid(const GridLayout& grid, GridWork& work, Team& team);

/// True if a point that is not in the grid is on one of the planes of the tile at its column and row.
[[nodiscard]] inline bool lies_on_planes(const GridWork& work, std::uint32_t column, std::uint32_t row, float z) {
  const int c = static_cast<int>(column);
  const int r = static_cast<int>(row);
  const TilePlane* planes = work.planes(c / GridLayout::kTileColumns, r / GridLayout::kTileRows);
  const float u = static_cast<float>(c % GridLayout::kTileColumns) - kTileMidColumn;
  const float v = static_cast<float>(r % GridLayout::kTileRows) - kTileMidRow;
  return std::any_of(planes, planes + 2, [&](const TilePlane& plane) {
    return std::abs(z - (plane.z + plane.per_column * u + plane.per_row * v)) <= gate_of(plane);
  });
}

/// Runs between steps 2 and 3: removes connected groups from `noise` (algo/denoise/denoise.h). Overwrites `off` and the
/// marks.
void keep_noise_groups(const GridLayout& grid, GridWork& work, Team& team);

/// Step 3, if the grid is the scan itself: sets noise to NaN. Returns the number of these points.
std::uint64_t take_out_noise(const GridLayout& grid, GridWork& work, Team& team);

/// Returns false if `cloud` is not organised or its grid is wrong; then it changed only points that lacked a
/// coordinate. In the second case it also removes width and height.
[[nodiscard]] bool denoise_grid(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts);

}  // namespace slabd::algo
