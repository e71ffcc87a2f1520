// SPDX-License-Identifier: Apache-2.0
//
// Denoising of a scan that was exported without its grid. Its rays are still evenly spaced (algo/denoise/lattice.h), so
// the grid can be recovered, and a scan with a grid is denoised ten times faster (algo/denoise/denoise_grid.cpp).
//
//  1. The height of every point is stored in a table of columns and rows. If two points meet in a cell, the lower one
//     stays. In the order in which scanners export, sixteen consecutive points are a run in one row, nearly always in
//     adjacent cells: one comparison tests this, one store spreads them, and a note of four bytes stores their
//     position.
//  2. The table is denoised like an organised scan.
//  3. Step 3 reads the notes, not the points: a run without noise is kept without reading its points. For the other
//     runs the cells of the points are computed again. A noise point is removed. A point that met a lower one in its
//     cell is kept if it is on one of the planes there. A point outside the table is noise.
//
// If many points meet or are outside, or most have no plane, the scan has no lattice, and the function returns false.
//
// A cloud whose order has no meaning contains no runs. It is first sorted into the lattice's order
// (algo/denoise/lattice.h). Then it is an organised scan, followed by the few points that share a cell with a lower
// one.
//
// Invariants: the lower of two points does not depend on which comes first, so the order of the points does not matter.
// The scan is cut into fixed blocks, and each row of the table belongs to one of them: the last one that begins in it
// or above. A block writes its own rows only. Points in other rows (the rest of a row of the next block) are deferred
// and spread by one thread at the end. Step 3 reads the table and changes its block's points only.
#include "algo/denoise/denoise.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <new>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/denoise/denoise_lattice.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/denoise/lattice_cells-inl.h"
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/denoise/denoise_grid.h"
#include "algo/denoise/lattice.h"

#ifndef SLABD_ALGO_DENOISE_LATTICE_ONCE
#define SLABD_ALGO_DENOISE_LATTICE_ONCE
namespace slabd::algo {
namespace {

/// Note about sixteen points: a kind, and for a run its first cell and its span. The span is the number of further
/// columns; it is 15 if and only if the points are in adjacent cells from left to right.
enum class Note : std::uint32_t {
  nothing,  ///< all points are missing
  run,      ///< all in one row, within a span of columns from the first, none met another
  singly,   ///< any other case
  put_off,  ///< not yet spread: some points are outside the block's own rows
};
constexpr std::uint32_t kCellBits = std::bit_width(limits::kScanPointsMax);
constexpr std::uint32_t kSpanBits = 5;
constexpr std::uint32_t kSpanMax = (1U << kSpanBits) - 1U;
static_assert(kCellBits + kSpanBits + 2 <= 32, "a note is one word");
constexpr std::uint32_t note(Note kind, std::uint32_t cell = 0, std::uint32_t span = 0) {
  return static_cast<std::uint32_t>(kind) << (kCellBits + kSpanBits) | span << kCellBits | cell;
}
constexpr Note kind_of(std::uint32_t note) {
  return static_cast<Note>(note >> (kCellBits + kSpanBits));
}
constexpr std::uint32_t span_of(std::uint32_t note) {
  return (note >> kCellBits) & kSpanMax;
}
constexpr std::uint32_t cell_of(std::uint32_t note) {
  return note & ((1U << kCellBits) - 1U);
}

/// Points of a block: about thirty rows of a table, which fit into the cache.
constexpr std::size_t kBlock = 1U << 16U;
constexpr std::size_t kBlocksMax = (limits::kScanPointsMax + kBlock - 1) / kBlock;
constexpr std::size_t kNotesMax = (limits::kScanPointsMax + 15) / 16;
constexpr std::size_t kRowsMax = limits::kScanPointsMax / GridLayout::kColumnsMin;
constexpr std::uint16_t kAnyBlock = 0xFFFF;

/// Counts of one block.
struct Spread {
  std::uint64_t finite = 0;
  std::uint64_t met = 0;      ///< points that met another one in their cell
  std::uint64_t outside = 0;  ///< outside the table
  void operator+=(const Spread& o) { finite += o.finite, met += o.met, outside += o.outside; }
};

/// The scan and its table.
struct Spreading {
  Lattice lattice;
  float* xyz = nullptr;
  std::size_t points = 0;
  float* table = nullptr;          ///< heights, row by row; NaN in empty cells
  std::uint8_t* met = nullptr;     ///< one bit for each cell, row by row: set if points met there
  std::uint32_t* notes = nullptr;  ///< one for each sixteen points
  std::uint16_t* owner = nullptr;  ///< the block of each row
  [[nodiscard]] std::size_t end_of(std::size_t block) const { return std::min(points, (block + 1) * kBlock); }
};

/// Bytes for one bit per cell, with padding to read eight bytes from any of them.
constexpr std::size_t met_bytes(std::size_t cells) {
  return cells / 8 + 8;
}

}  // namespace
}  // namespace slabd::algo
#endif

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Cells of sixteen points, to be processed one by one.
struct Singly {
  alignas(64) std::array<float, kLanes> column, row, z;
  std::uint32_t finite, inside;

  HWY_INLINE Singly(const Lattice& lattice, const Points16& p, const Places16& at)
      : finite(bits(finite_points(p))), inside(finite & bits(HWY_NAMESPACE::inside(lattice, at))) {
    store(at.column, column.data());
    store(at.row, row.data());
    store(p.z, z.data());
  }
  [[nodiscard]] std::uint32_t column_of(std::size_t k) const { return static_cast<std::uint32_t>(column[k]); }
  [[nodiscard]] std::uint32_t row_of(std::size_t k) const { return static_cast<std::uint32_t>(row[k]); }
};

/// Step 1 for one block, or for kAnyBlock in every row.
class Spreader {
 public:
  Spreader(const Spreading& work, std::uint16_t block)
      : work_(work), block_(block), columns_(static_cast<std::uint32_t>(work.lattice.columns)) {}

  /// Spreads point i and the next fifteen.
  HWY_INLINE void spread(const Lattice& lattice, std::size_t i, std::size_t end, Spread& out) {
    constexpr std::size_t kAhead = 1'536;  // floats
    fetch_points(work_.xyz + 3 * i + kAhead);
    work_.notes[i / kLanes] = spread(lattice, sixteen_points(work_.xyz, end, i), out);
  }

 private:
  [[nodiscard]] HWY_INLINE bool owns(std::uint32_t row) const {
    return block_ == kAnyBlock || work_.owner[row] == block_;
  }

  HWY_INLINE std::uint32_t spread(const Lattice& lattice, const Points16& p, Spread& out) {
    const Places16 at = places(lattice, p);
    const float first = first_lane(at.column);
    const float row = first_lane(at.row);
    const M16 in_row = (at.row == f16(row)) & ((p.z - p.z) == f16(0.0F));
    const F16 along = at.column - f16(first);
    if (all(in_row & (along >= f16(0.0F)) & (along <= f16(kSpanMax))) && first >= 0.0F &&
        first + kSpanMax < lattice.columns && row >= 0.0F && row < lattice.rows) {
      const auto r = static_cast<std::uint32_t>(row);
      if (!owns(r)) return note(Note::put_off);
      const std::uint32_t cell = r * columns_ + static_cast<std::uint32_t>(first);
      float* to = work_.table + cell;
      const std::uint32_t span = all(along == lane_numbers()) ? spread_side_by_side(p, to) : spread_run(p, along, to);
      if (span != 0) {
        out.finite += kLanes;
        return note(Note::run, cell, span);
      }
    }
    return spread_singly(p, {work_.lattice, p, at}, out);
  }

  /// Stores sixteen points in adjacent cells. Returns their span, or 0 and stores nothing if a cell is occupied.
  static HWY_INLINE std::uint32_t spread_side_by_side(const Points16& p, float* to) {
    const F16 there = load(to);
    if (any(there == there)) return 0;
    store(p.z, to);
    return kLanes - 1;
  }
  /// Stores sixteen points, each at its own column offset `along`, in any order. Returns their span or slightly more,
  /// or 0 and stores nothing if a cell is occupied or two of them meet.
  static HWY_INLINE std::uint32_t spread_run(const Points16& p, const F16& along, float* to) {
    static_assert(kSpanMax == 2 * kLanes - 1);
    const F16 low = load(to);
    const F16 high = load(to + kLanes);
    if (any((low == low) | (high == high))) return 0;
    alignas(64) std::array<std::int32_t, kLanes> column;
    alignas(64) std::array<float, kLanes> z;
    store(to_int(along), column.data());
    store(p.z, z.data());
    for (std::size_t k = 0; k < kLanes; ++k) to[column[k]] = z[k];
    const F16 low_now = load(to);
    const F16 high_now = load(to + kLanes);
    const std::uint32_t there = bits(low_now == low_now) | bits(high_now == high_now) << kLanes;
    if (std::popcount(there) == kLanes)
      return std::max(static_cast<std::uint32_t>(kLanes), static_cast<std::uint32_t>(std::bit_width(there)) - 1);
    store(f16(kNoPlane), to);
    store(f16(kNoPlane), to + kLanes);
    return 0;
  }

  HWY_NOINLINE std::uint32_t spread_singly(const Points16& p, const Singly& at, Spread& out) {
    if (at.finite == 0 && !any((p.x == p.x) | (p.y == p.y) | (p.z == p.z))) return note(Note::nothing);
    if (block_ != kAnyBlock) {
      for (std::uint32_t left = at.inside; left != 0; left &= left - 1)
        if (!owns(at.row_of(static_cast<std::size_t>(std::countr_zero(left))))) return note(Note::put_off);
    }
    for (std::uint32_t left = at.inside; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      const std::uint32_t cell = at.row_of(k) * columns_ + at.column_of(k);
      float& there = work_.table[cell];
      if (std::isnan(there)) {
        there = at.z[k];
      } else {
        ++out.met;
        work_.met[cell / 8] = static_cast<std::uint8_t>(work_.met[cell / 8] | 1U << cell % 8);
        there = std::min(there, at.z[k]);
      }
    }
    out.finite += static_cast<std::uint64_t>(std::popcount(at.finite));
    out.outside += static_cast<std::uint64_t>(std::popcount(at.finite & ~at.inside));
    return note(Note::singly);
  }

  const Spreading work_;
  const std::uint16_t block_;
  const std::uint32_t columns_;
};

/// Step 3 for one block.
class TakeOut {
 public:
  TakeOut(const Spreading& work, const GridWork& grid, bool any_met)
      : work_(work),
        grid_(grid),
        any_met_(any_met),
        columns_(static_cast<std::uint32_t>(work.lattice.columns)),
        per_columns_(1.0 / static_cast<double>(columns_)) {}

  std::uint64_t take_out(std::size_t first, std::size_t end) const {
    // Points to be examined are listed first and prefetched meanwhile, because they are no longer in the cache.
    std::array<std::uint32_t, kBlock / kLanes> listed;
    std::size_t n = 0;
    for (std::size_t i = first; i < end; i += kLanes) {
      const float* points = work_.xyz + 3 * i;
      listed[n] = static_cast<std::uint32_t>(i);
      if (!to_be_looked_at(work_.notes[i / kLanes])) continue;
      ++n;
      fetch_points(points);
    }
    std::uint64_t taken = 0;
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t i = listed[k];
      const std::uint32_t what = work_.notes[i / kLanes];
      const Place at = place_of(what);
      if (kind_of(what) != Note::run || met_in(cell_of(what), span_of(what)))
        taken += singly(i, end);
      else if (span_of(what) == kLanes - 1)
        taken += remove(i, grid_.noise.sixteen(at.column, at.row));
      else
        taken += of_run(i, at);
    }
    return taken;
  }

 private:
  struct Place {
    int column, row;
  };
  [[nodiscard]] HWY_INLINE Place place_of(std::uint32_t what) const {
    // Adds half a cell, so that rounding cannot change the row.
    const auto row = static_cast<std::uint32_t>((cell_of(what) + 0.5) * per_columns_);
    return {static_cast<int>(cell_of(what) - row * columns_), static_cast<int>(row)};
  }
  /// True if points met in the cell or in one of the next `behind` cells.
  [[nodiscard]] HWY_INLINE bool met_in(std::uint32_t cell, std::uint32_t behind) const {
    if (!any_met_) return false;
    std::uint64_t bits = 0;
    std::memcpy(&bits, work_.met + cell / 8, sizeof bits);
    return (bits >> cell % 8 & ((std::uint64_t{2} << behind) - 1)) != 0;
  }
  [[nodiscard]] HWY_INLINE bool to_be_looked_at(std::uint32_t what) const {
    if (kind_of(what) != Note::run) return kind_of(what) == Note::singly;
    const Place at = place_of(what);
    return grid_.noise.any(at.column, static_cast<int>(span_of(what)) + 1, at.row) ||
           met_in(cell_of(what), span_of(what));
  }
  std::uint64_t remove(std::size_t i, std::uint32_t lanes) const {
    for (std::uint32_t left = lanes; left != 0; left &= left - 1)
      std::fill_n(work_.xyz + 3 * (i + static_cast<std::size_t>(std::countr_zero(left))), 3, kNoPlane);
    return static_cast<std::uint64_t>(std::popcount(lanes));
  }

  /// Removes the noise of sixteen points with gaps, each alone in its cell.
  std::uint64_t of_run(std::size_t i, const Place& first) const {
    static_assert(kSpanMax == 2 * kLanes - 1);
    const std::uint32_t noise = grid_.noise.sixteen(first.column, first.row) |
                                grid_.noise.sixteen(first.column + static_cast<int>(kLanes), first.row) << kLanes;
    const Places16 at = places(work_.lattice, load_points(work_.xyz + 3 * i));
    const I16 along = to_int(at.column - f16(static_cast<float>(first.column)));
    return remove(i, bits(test_bits(shift_right(i16(static_cast<std::int32_t>(noise)), along), i16(1))));
  }

  std::uint64_t singly(std::size_t i, std::size_t end) const {
    const Points16 p = sixteen_points(work_.xyz, end, i);
    const Singly at(work_.lattice, p, places(work_.lattice, p));
    std::uint32_t noise = at.finite & ~at.inside;
    for (std::uint32_t left = at.inside; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      const std::uint32_t column = at.column_of(k);
      const std::uint32_t row = at.row_of(k);
      const std::uint32_t cell = row * columns_ + column;
      // The table is not in the cache either.
      const bool owner = !met_in(cell, 0) || work_.table[cell] == at.z[k];
      const bool bad = owner ? grid_.noise.any(static_cast<int>(column), 1, static_cast<int>(row))
                             : !lies_on_planes(grid_, column, row, at.z[k]);
      if (bad) noise |= left & -left;
    }
    // A point that lacks one coordinate counts as missing.
    remove(i, bits((p.x == p.x) | (p.y == p.y) | (p.z == p.z)) & ~at.finite);
    return remove(i, noise);
  }

  const Spreading& work_;
  const GridWork& grid_;
  const bool any_met_;
  const std::uint32_t columns_;
  const double per_columns_;
};

}  // namespace

/// Row of the first point of a block that is inside the table; the number of the last row if no point is inside.
std::uint32_t first_row(const Spreading& work, std::size_t block) {
  for (std::size_t i = block * kBlock; i < work.end_of(block); i += kLanes) {
    const Points16 p = sixteen_points(work.xyz, work.end_of(block), i);
    const Singly at(work.lattice, p, places(work.lattice, p));
    if (at.inside != 0) return at.row_of(static_cast<std::size_t>(std::countr_zero(at.inside)));
  }
  return static_cast<std::uint32_t>(work.lattice.rows) - 1;
}

void spread_block(const Spreading& work, std::size_t block, Spread& out) {
  const auto columns = static_cast<std::size_t>(work.lattice.columns);
  const auto rows = static_cast<std::size_t>(work.lattice.rows);
  // Whole tiles: the length of a row is a multiple of sixteen.
  for (std::size_t r = 0; r < rows; ++r) {
    if (work.owner[r] != block) continue;
    float* row = work.table + r * columns;
    for (std::size_t c = 0; c < columns; c += kLanes) store(f16(kNoPlane), row + c);
  }
  Spreader spreader(work, static_cast<std::uint16_t>(block));
  // A copy, so that the compiler can assume that no store changes it.
  const Lattice lattice = work.lattice;
  out = Spread{};
  for (std::size_t i = block * kBlock; i < work.end_of(block); i += kLanes)
    spreader.spread(lattice, i, work.end_of(block), out);
}

/// Spreads the points that the blocks deferred.
void spread_rest(const Spreading& work, Spread& out) {
  Spreader spreader(work, kAnyBlock);
  for (std::size_t i = 0; i < work.points; i += kLanes)
    if (kind_of(work.notes[i / kLanes]) == Note::put_off) spreader.spread(work.lattice, i, work.points, out);
}

std::uint64_t take_out_of_block(const Spreading& work, const GridWork& grid, bool any_met, std::size_t block) {
  return TakeOut(work, grid, any_met).take_out(block * kBlock, work.end_of(block));
}

/// Compacts the points that share a cell of the grid and are not noise. A point as low as the cell's own is judged with
/// it, a higher one by the planes there. Returns their number.
std::size_t keep_left_over(const Lattice& lattice, const GridWork& grid, float* xyz, std::size_t points) {
  const auto columns = static_cast<std::size_t>(lattice.columns);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points; i += kLanes) {
    const Points16 p = sixteen_points(xyz, points, i);
    const Singly at(lattice, p, places(lattice, p));
    for (std::uint32_t left = at.inside; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      const std::uint32_t column = at.column_of(k);
      const std::uint32_t row = at.row_of(k);
      const bool as_low = grid.xyz[3 * (row * columns + column) + 2] == at.z[k];
      const bool good = as_low ? !grid.noise.any(static_cast<int>(column), 1, static_cast<int>(row))
                               : lies_on_planes(grid, column, row, at.z[k]);
      if (good) std::copy_n(xyz + 3 * (i + k), 3, xyz + 3 * kept++);
    }
  }
  return kept;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(first_row);
HWY_EXPORT(spread_block);
HWY_EXPORT(spread_rest);
HWY_EXPORT(take_out_of_block);
HWY_EXPORT(keep_left_over);

namespace {

/// Assigns rows to blocks: each block gets the rows from its start to that of the next block, upwards or downwards. The
/// outer blocks get the rows beyond.
void share_rows(const Spreading& work, std::size_t blocks) {
  const auto rows = static_cast<std::size_t>(work.lattice.rows);
  std::array<std::uint32_t, kBlocksMax> first{};
  for (std::size_t b = 0; b < blocks; ++b) first[b] = HWY_DYNAMIC_DISPATCH(first_row)(work, b);
  std::fill_n(work.owner, rows, std::uint16_t{0});
  for (std::size_t b = 0; b + 1 < blocks; ++b) {
    const bool down = first[b] <= first[b + 1];
    const std::size_t from = down ? first[b] : first[b + 1] + 1;
    const std::size_t to = down ? first[b + 1] : first[b] + 1;
    std::fill(work.owner + from, work.owner + to, static_cast<std::uint16_t>(b));
  }
  const std::size_t last = first[blocks - 1];
  const bool down = first[0] <= last;
  std::fill(work.owner + (down ? last : 0), work.owner + (down ? rows : last + 1),
            static_cast<std::uint16_t>(blocks - 1));
}

OrderMemory order_memory(const DenoiseWorkspace& memory) {
  const auto floats = [](void* at, std::size_t bytes) {
    return std::span<float>(::new (at) float[bytes / sizeof(float)], bytes / sizeof(float));
  };
  return {{floats(memory.order.data(), memory.order.size_bytes()),
           floats(memory.surface.data(), memory.surface.size_bytes()),
           floats(memory.keep.data(), memory.keep.size_bytes())},
          memory.cell_start};
}

/// Limits the cloud to the size of the workspace.
bool bring_into_order(Cloud& cloud, const Lattice& lattice, const DenoiseWorkspace& memory, Team& team,
                      Ordered& found) {
  const std::size_t room = std::min({cloud.xyz.size() / 3, memory.order.size(), memory.keep.size()});
  Cloud reached{cloud.xyz.first(3 * room), cloud.points, cloud.width, cloud.height};
  if (room < cloud.points) return false;
  const bool ordered = order_points(reached, lattice, order_memory(memory), team, found);
  // Also after a failure: points sorted by height instead have no grid.
  cloud.points = reached.points;
  cloud.width = reached.width;
  cloud.height = reached.height;
  return ordered;
}

/// Denoises a cloud sorted into its lattice's order: an organised scan with a few points left over.
bool denoise_ordered(Cloud& cloud, const Lattice& lattice, const Ordered& found, const DenoiseWorkspace& memory,
                     Team& team, ScanCounts& counts) {
  const GridLayout grid(static_cast<std::size_t>(lattice.columns), static_cast<std::size_t>(lattice.rows));
  if (kMetShare * found.met > found.finite || !grid.fits(memory)) return false;
  GridWork judged(grid, cloud.xyz.data(), nullptr, memory);
  judged.per_column_mm = lattice.away_mm / lattice.per_x;
  judged.per_row_mm = lattice.away_mm / lattice.per_y;
  if (!judge_grid(grid, judged, team)) return false;
  keep_noise_groups(grid, judged, team);
  const std::size_t cells = grid.columns * grid.rows;
  const std::size_t left_over = cloud.points - cells;
  const std::size_t kept =
      HWY_DYNAMIC_DISPATCH(keep_left_over)(lattice, judged, cloud.xyz.data() + 3 * cells, left_over);
  const std::uint64_t taken = take_out_noise(grid, judged, team);
  cloud.points = cells + kept;
  cloud.width = kept == 0 ? grid.columns : 0;
  cloud.height = kept == 0 ? grid.rows : 0;
  counts.points_finite = found.finite;
  counts.isolated_removed = taken + left_over - kept;
  counts.points_kept = counts.points_finite - counts.isolated_removed;
  return true;
}

}  // namespace

bool denoise_lattice(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts) {
  // The memory holds first the sample, then the notes and the owners of the rows.
  constexpr std::size_t kOwnerWords = (kRowsMax + 1) / 2;
  static_assert(std::max(kLatticeFloats, kNotesMax + kOwnerWords) <= limits::kDenoiseCellsMax);
  const std::span<std::uint32_t> scratch = memory.cell_start;
  if (scratch.size() < limits::kDenoiseCellsMax) return false;
  Spreading work;
  work.xyz = cloud.xyz.data();
  work.points = cloud.points;
  float* sample = ::new (scratch.data()) float[kLatticeFloats];
  if (!find_lattice(cloud, {sample, kLatticeFloats}, team, work.lattice)) return false;
  // Without memory for sorting, denoising takes longer and has the same result.
  Ordered ordered;
  if (!is_in_order(cloud, work.lattice) && bring_into_order(cloud, work.lattice, memory, team, ordered))
    return denoise_ordered(cloud, work.lattice, ordered, memory, team, counts);

  const GridLayout grid(static_cast<std::size_t>(work.lattice.columns), static_cast<std::size_t>(work.lattice.rows));
  const std::size_t cells = grid.columns * grid.rows;
  if (cells > memory.order.size() || met_bytes(cells) > memory.keep.size()) return false;
  DenoiseWorkspace left = memory;
  left.keep = memory.keep.first(memory.keep.size() - met_bytes(cells));
  if (!grid.fits(left)) return false;
  work.met = left.keep.data() + left.keep.size();
  std::fill_n(work.met, met_bytes(cells), std::uint8_t{0});
  work.table = ::new (memory.order.data()) float[cells];
  work.notes = ::new (scratch.data()) std::uint32_t[kNotesMax];
  work.owner = ::new (scratch.data() + kNotesMax) std::uint16_t[kRowsMax];
  const std::size_t blocks = (cloud.points + kBlock - 1) / kBlock;
  share_rows(work, blocks);
  std::array<Spread, kBlocksMax> found;
  team.run(blocks, [&](std::size_t block) { HWY_DYNAMIC_DISPATCH(spread_block)(work, block, found[block]); });
  Spread spread;
  for (std::size_t block = 0; block < blocks; ++block) spread += found[block];
  HWY_DYNAMIC_DISPATCH(spread_rest)(work, spread);
  if (kOutsideShare * spread.outside > spread.finite || kMetShare * spread.met > spread.finite) return false;

  GridWork judged(grid, nullptr, work.table, left);
  judged.per_column_mm = work.lattice.away_mm / work.lattice.per_x;
  judged.per_row_mm = work.lattice.away_mm / work.lattice.per_y;
  if (!judge_grid(grid, judged, team)) return false;
  keep_noise_groups(grid, judged, team);
  std::atomic<std::uint64_t> taken{0};
  team.run(blocks, [&](std::size_t block) {
    taken += HWY_DYNAMIC_DISPATCH(take_out_of_block)(work, judged, spread.met > 0, block);
  });
  counts.points_finite = spread.finite;
  counts.isolated_removed = taken;
  counts.points_kept = spread.finite - counts.isolated_removed;
  return true;
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
