// SPDX-License-Identifier: Apache-2.0
//
// A cloud in an order of no meaning (merged views, a program that sorts by something else) costs every pass a cache
// miss a point. To give each point its place in the grid of its rays first costs less than one such pass, and leaves an
// organised scan. The cloud fills its buffer, and free memory holds just over half of it; so:
//
//  1. The grid's rows are cut into bands that fit the second-level cache, and each block of the scan counts how many
//     points it has for each band: now every block knows where in each band its points go.
//  2. The points of the upper bands, as many as there is room for, go into the free memory, band by band; the others
//     close ranks at the front of the cloud, which leaves its rear free.
//  3. The others go from there to the rear, each to the end of its band's part of the grid.
//  4. Band by band, each point goes to its cell in a small table that stays in the cache, and the whole table to its
//     place in the cloud.
//
// Memory is what this takes, so nothing is read in order to be overwritten: points that go to one band are gathered
// until they fill whole cache lines, and those, like the tables of step 4, are written past the caches.
//
// Invariants: where a block writes is counted beforehand, so blocks share nothing but cache lines, of which each writes
// its own bytes. In step 2 a block closes ranks over blocks before it and waits until those have been read; blocks are
// begun in their order, so the first unfinished one never waits. In a cell the lowest point stays, whoever comes first;
// what is left over is sorted. Where there is more of that than memory, it goes into free cells of its band: no point
// is ever lost, and no order shows.
#include "algo/lattice_order.h"

#include <hwy/cache_control.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <new>
#include <tuple>
#include <type_traits>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/lattice_order.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
#include "algo/lattice_cells-inl.h"
// clang-format on

#ifndef SLABD_ALGO_LATTICE_ORDER_ONCE
#define SLABD_ALGO_LATTICE_ORDER_ONCE
namespace slabd::algo {
namespace {

constexpr std::size_t kBlock = 1U << 18U;
constexpr std::size_t kBlocksMax = (limits::kScanPointsMax + kBlock - 1) / kBlock;
/// Bands of rows. Half of them are dealt at a time, and what their heaps take just fills a first-level cache of 48 kB.
constexpr std::size_t kBandsMax = 253;
/// Cells of a band: their points are less than half a megabyte, unless a single row has more.
constexpr std::size_t kBandCells = 1U << 15U;
constexpr float kNoPoint = std::numeric_limits<float>::quiet_NaN();

struct Bands {
  explicit Bands(const Lattice& of)
      : lattice(of), columns(static_cast<std::size_t>(of.columns)), rows(static_cast<std::size_t>(of.rows)) {
    band_rows = std::max({std::size_t{1}, kBandCells / columns, (rows + kBandsMax - 1) / kBandsMax});
    count = (rows + band_rows - 1) / band_rows;
  }
  Lattice lattice;
  std::size_t columns, rows;
  std::size_t band_rows = 1;
  std::size_t count = 0;
  /// Numbers beyond the bands: of points outside of the table, and of missing ones.
  [[nodiscard]] std::size_t outside() const { return count; }
  [[nodiscard]] std::size_t missing() const { return count + 1; }
  [[nodiscard]] std::size_t kinds() const { return count + 2; }
  /// First cell of a band; of the one behind the last the number of all cells.
  [[nodiscard]] std::size_t first_cell(std::size_t band) const { return columns * std::min(rows, band * band_rows); }
  [[nodiscard]] std::size_t cells() const { return columns * band_rows; }
};
constexpr std::size_t kKindsMax = kBandsMax + 2;

/// Points of a heap: thirty-two are six cache lines. There is a heap every kHeapStride bytes; what lies between them is
/// written over, for points are moved sixteen bytes at a time.
constexpr std::size_t kPointBytes = 3 * sizeof(float);
constexpr std::size_t kMoveBytes = 4 * sizeof(float);
constexpr std::size_t kHeapPoints = 32;
constexpr std::size_t kHeapBytes = kHeapPoints * kPointBytes;
constexpr std::size_t kHeapStride = 512;
static_assert(kHeapBytes - kPointBytes + kMoveBytes <= kHeapStride);
/// Whether a heap is full is foreseen by nobody, and after a wrong guess everything begins anew: where so many points
/// go is told before the first of them is moved.
constexpr std::size_t kAtOnce = 256;
/// Floats ahead that are fetched.
constexpr std::size_t kAhead = 768;
/// Where the next heap of a band goes.
struct Cursor {
  float* heap = nullptr;    ///< null: points are dropped
  std::uint32_t first = 0;  ///< the points before it are another block's

  Cursor() = default;
  /// Point number `at` of an array and those behind it. Heaps are counted from its start, which lies on a cache line.
  Cursor(float* array, std::size_t at)
      : heap(array + 3 * (at - at % kHeapPoints)), first(static_cast<std::uint32_t>(at % kHeapPoints)) {}
};
using Cursors = std::array<Cursor, kKindsMax>;

/// Points that share their cell with a lower one.
struct LeftOver {
  std::span<float> room;
  std::atomic<std::size_t> points{0};
  std::atomic<bool> too_many{false};
  std::array<std::span<float>, kBandsMax> of_band{};  ///< empty: none, or they are in free cells

  /// Keeps a band's; false, and nothing kept, when there is no room.
  [[nodiscard]] bool keep(std::size_t band, const float* from, std::size_t more) {
    std::size_t at = points.load();
    do {
      if (3 * (at + more) > room.size()) return false;
    } while (!points.compare_exchange_weak(at, at + more));
    of_band[band] = room.subspan(3 * at, 3 * more);
    std::copy_n(from, 3 * more, of_band[band].data());
    return true;
  }
};

/// Among points of a cell the lowest comes first.
bool comes_before(const float* a, const float* b) {
  return std::tie(a[2], a[0], a[1]) < std::tie(b[2], b[0], b[1]);
}
void sort_points(float* xyz, std::size_t points) {
  struct Point {
    std::array<float, 3> xyz;
  };
  auto* first = reinterpret_cast<Point*>(xyz);
  std::sort(first, first + points,
            [](const Point& a, const Point& b) { return comes_before(a.xyz.data(), b.xyz.data()); });
}
/// Of cells at least as many must be free.
void put_in_free_cells(float* xyz, std::size_t points, float* cells) {
  sort_points(xyz, points);
  for (std::size_t i = 0; i < points; cells += 3)
    if (std::isnan(cells[2])) std::copy_n(xyz + 3 * i++, 3, cells);
}

}  // namespace
}  // namespace slabd::algo
#endif

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Bands of sixteen points, or what is beyond the bands: whole numbers.
class BandOf {
 public:
  explicit BandOf(const Bands& bands)
      : lattice_(bands.lattice),
        per_band_(1.0F / static_cast<float>(bands.band_rows)),
        outside_(static_cast<float>(bands.outside())),
        missing_(static_cast<float>(bands.missing())) {}
  HWY_INLINE F16 operator()(const Points16& p) const {
    const Places16 at = places(lattice_, p);
    // Half a row away from where rounding could matter.
    const F16 band = floor((at.row + f16(0.5F)) * f16(per_band_));
    return select(finite_points(p), select(inside(lattice_, at), band, f16(outside_)), f16(missing_));
  }

 private:
  const Lattice lattice_;
  const float per_band_, outside_, missing_;
};

/// Whole registers past the caches, where the memory lies on a cache line.
HWY_INLINE void write_past_caches(const float* from, std::size_t floats, float* to) {
  const Tag<float> tag;
  constexpr std::size_t kWidth = hn::MaxLanes(Tag<float>());
  if (reinterpret_cast<std::uintptr_t>(to) % (kWidth * sizeof(float)) != 0) {
    std::memcpy(to, from, floats * sizeof(float));
    return;
  }
  for (std::size_t i = 0; i < floats; i += kWidth) hn::Stream(hn::LoadU(tag, from + i), tag, to + i);
}

}  // namespace

/// Of sixteen points from each of these on: in how many sixteens do all lie near the first?
std::size_t count_near(const Cloud& cloud, const Lattice& lattice, std::size_t stride, std::size_t& looked_at) {
  constexpr float kNear = 31.0F;
  std::size_t near = 0;
  looked_at = 0;
  for (std::size_t i = 0; i + kLanes <= cloud.points; i += stride) {
    const Points16 p = load_points(cloud.xyz.data() + 3 * i);
    const Places16 at = places(lattice, p);
    const M16 there = finite_points(p) & inside(lattice, at);
    if (!all(there)) continue;
    ++looked_at;
    const M16 close = (abs(at.column - f16(first_lane(at.column))) <= f16(kNear)) &
                      (abs(at.row - f16(first_lane(at.row))) <= f16(kNear));
    near += all(close) ? 1U : 0U;
  }
  return near;
}

/// Step 1 for points first to last.
void count_bands(const Bands& bands, const float* xyz, std::size_t first, std::size_t last, std::uint32_t* count) {
  const BandOf band_of(bands);
  std::fill_n(count, bands.kinds(), 0U);
  alignas(64) std::array<std::int32_t, kLanes> band;
  for (std::size_t i = first; i < last; i += kLanes) {
    fetch_points(xyz + 3 * i + kAhead);
    store(to_int(band_of(sixteen_points(xyz, last, i))), band.data());
    const std::size_t n = std::min(kLanes, last - i);
    for (std::size_t k = 0; k < n; ++k) ++count[band[k]];
  }
}

/// Steps 2 and 3 for points first to last: each goes to its band's cursor, those of band `rest` and all behind it to
/// one, and missing ones to the one behind that. The cursors may write where points have been read.
void deal(const Bands& bands, const float* xyz, std::size_t first, std::size_t last, std::size_t rest,
          Cursors& cursors) {
  alignas(64) std::array<std::byte, kHeapStride * kKindsMax> heaps;
  // The byte of `heaps` at which each one's next point goes.
  std::array<std::uint32_t, kKindsMax> next;
  for (std::size_t to = 0; to < rest + 2; ++to)
    next[to] = static_cast<std::uint32_t>(kHeapStride * to + kPointBytes * cursors[to].first);
  const auto write = [&](std::size_t to) {
    Cursor& c = cursors[to];
    const std::size_t begin = kPointBytes * c.first;
    const std::size_t end = next[to] % kHeapStride;
    if (c.heap != nullptr) {
      const std::byte* from = heaps.data() + kHeapStride * to;
      if (end - begin == kHeapBytes)
        write_past_caches(reinterpret_cast<const float*>(from), 3 * kHeapPoints, c.heap);
      else
        std::memcpy(reinterpret_cast<std::byte*>(c.heap) + begin, from + begin, end - begin);
      c.heap += 3 * kHeapPoints;
    }
    c.first = 0;
    next[to] = static_cast<std::uint32_t>(kHeapStride * to);
  };
  const BandOf band_of(bands);
  const F16 missing = f16(static_cast<float>(bands.missing()));
  const F16 most = f16(static_cast<float>(rest));
  const F16 dropped = f16(static_cast<float>(rest + 1));
  alignas(64) std::array<std::int32_t, kAtOnce> band;
  for (std::size_t from = first; from < last; from += kAtOnce) {
    const std::size_t end = std::min(last, from + kAtOnce);
    for (std::size_t i = from; i < end; i += kLanes) {
      fetch_points(xyz + 3 * i + kAhead);
      const F16 which = band_of(sixteen_points(xyz, end, i));
      store(to_int(select(which == missing, dropped, min(which, most))), band.data() + (i - from));
    }
    const auto move = [&](std::size_t i, auto bytes) {
      const auto to = static_cast<std::size_t>(band[i - from]);
      const std::uint32_t at = next[to];
      std::memcpy(heaps.data() + at, xyz + 3 * i, bytes);
      next[to] = at + static_cast<std::uint32_t>(kPointBytes);
      if (next[to] % kHeapStride == kHeapBytes) write(to);
    };
    // What follows the last point is not ours to read.
    const std::size_t wide = std::min(end, last - 1);
    for (std::size_t i = from; i < wide; ++i) move(i, std::integral_constant<std::size_t, kMoveBytes>());
    if (wide < end) move(wide, std::integral_constant<std::size_t, kPointBytes>());
  }
  for (std::size_t to = 0; to < rest + 2; ++to) write(to);
  hwy::FlushStream();  // another thread may read them
}

/// Step 4 for one band: its points, which are lost, go to their cells, `to`. `table`: memory for the band's cells.
/// Returns how many share a cell with a lower one; these are left over.
std::size_t fill_band(const Bands& bands, std::size_t band, float* from, std::size_t points, float* to, float* table,
                      LeftOver& left) {
  const Lattice lattice = bands.lattice;
  const F16 first_row = f16(static_cast<float>(band * bands.band_rows));
  const std::size_t cells = bands.first_cell(band + 1) - bands.first_cell(band);
  std::size_t met = 0;
  alignas(64) std::array<std::int32_t, kAtOnce> cell;
  for (std::size_t first = 0; first < points; first += kAtOnce) {
    const std::size_t end = std::min(points, first + kAtOnce);
    for (std::size_t i = first; i < end; i += kLanes) {
      fetch_points(from + 3 * i + kAhead);
      const Places16 place = places(lattice, sixteen_points(from, end, i));
      const I16 c = to_int((place.row - first_row) * f16(lattice.columns) + place.column);
      store(c, cell.data() + (i - first));
    }
    for (std::size_t i = first; i < end; ++i) {
      float* there = table + 3 * static_cast<std::size_t>(cell[i - first]);
      std::array<float, 3> point;
      std::memcpy(point.data(), from + 3 * i, sizeof point);
      if (!std::isnan(there[2])) {
        if (comes_before(point.data(), there)) std::swap_ranges(point.begin(), point.end(), there);
        std::copy_n(point.data(), 3, from + 3 * met++);
      } else {
        std::memcpy(there, point.data(), sizeof point);
      }
    }
  }
  if (met > 0 && !left.keep(band, from, met)) {
    left.too_many = true;
    put_in_free_cells(from, met, table);
  }
  constexpr std::size_t kPiece = 3 * kLanes;
  for (std::size_t i = 0; i < 3 * cells; i += kPiece) {
    write_past_caches(table + i, kPiece, to + i);
    for (std::size_t k = 0; k < kPiece; k += kLanes) store(f16(kNoPoint), table + i + k);
  }
  hwy::FlushStream();
  return met;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(count_near);
HWY_EXPORT(count_bands);
HWY_EXPORT(deal);
HWY_EXPORT(fill_band);

bool is_in_order(const Cloud& cloud, const Lattice& lattice) {
  constexpr std::size_t kLooks = 1'024;
  const std::size_t stride = std::max<std::size_t>(16, cloud.points / kLooks);
  std::size_t looked_at = 0;
  const std::size_t near = HWY_DYNAMIC_DISPATCH(count_near)(cloud, lattice, stride, looked_at);
  return 2 * near >= looked_at;
}

namespace {

/// The four steps on one cloud.
class Ordering {
 public:
  Ordering(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team)
      : bands_(lattice),
        memory_(memory),
        team_(team),
        xyz_(cloud.xyz.data()),
        points_(cloud.points),
        room_(std::min(limits::kScanPointsMax, cloud.xyz.size() / 3)),
        blocks_((cloud.points + kBlock - 1) / kBlock),
        cells_(bands_.first_cell(bands_.count)),
        table_floats_(3 * bands_.cells()),
        table_word_((blocks_ * bands_.kinds() + kHeapPoints - 1) / kHeapPoints * kHeapPoints),
        left_word_(table_word_ + 2 * table_floats_) {}

  /// Step 1. False where there is no room for the other steps.
  [[nodiscard]] bool count(Ordered& found) {
    if (memory_.words.size() < left_word_) return false;
    place_ = memory_.words.data();
    team_.run(blocks_, [&](std::size_t block) {
      HWY_DYNAMIC_DISPATCH(count_bands)
      (bands_, xyz_, begin_of(block), end_of(block), place_ + block * bands_.kinds());
    });
    // Counts of each block become where in its band its first point goes.
    for (std::size_t kind = 0; kind < bands_.kinds(); ++kind)
      for (std::size_t block = 0; block < blocks_; ++block)
        count_[kind] += std::exchange(place_[block * bands_.kinds() + kind], count_[kind]);
    for (std::size_t kind = 0; kind < bands_.missing(); ++kind) found.finite += count_[kind];
    found.outside = outside_ = count_[bands_.outside()];
    if (cells_ + outside_ > room_ || kOutsideShare * outside_ > found.finite) return false;
    for (std::size_t band = 0; band < bands_.count; ++band)
      if (count_[band] > bands_.first_cell(band + 1) - bands_.first_cell(band)) return false;
    return choose_upper_bands(found.finite);
  }

  /// Step 2.
  void deal_upper_bands() {
    std::array<std::atomic<bool>, kBlocksMax> read{};
    team_.run(blocks_, [&](std::size_t block) {
      Cursors cursors;
      for (std::size_t band = 0; band < split_; ++band)
        cursors[band] = {kept_[band].array, kept_[band].at + place(block, band)};
      cursors[split_] = {xyz_, closed_[block]};
      for (std::size_t other = closed_[block] / kBlock; other < block && other * kBlock < closed_[block + 1]; ++other)
        read[other].wait(false, std::memory_order_acquire);
      HWY_DYNAMIC_DISPATCH(deal)(bands_, xyz_, begin_of(block), end_of(block), split_, cursors);
      read[block].store(true, std::memory_order_release);
      read[block].notify_all();
    });
  }
  /// Step 3.
  void deal_lower_bands() {
    team_.run(blocks_, [&](std::size_t block) {
      Cursors cursors;
      for (std::size_t band = split_; band < bands_.count; ++band)
        cursors[band] = {xyz_, bands_.first_cell(band + 1) - count_[band] + place(block, band)};
      cursors[bands_.outside()] = {xyz_, cells_ + place(block, bands_.outside())};
      HWY_DYNAMIC_DISPATCH(deal)(bands_, xyz_, closed_[block], closed_[block + 1], bands_.outside(), cursors);
    });
  }
  /// Step 4. Returns how many points the cloud has now.
  [[nodiscard]] std::size_t fill_cells(Ordered& found) {
    float* tables = ::new (memory_.words.data() + table_word_) float[2 * table_floats_];
    std::fill_n(tables, 2 * table_floats_, kNoPoint);
    const std::size_t left_max = std::min((memory_.words.size() - left_word_) / 3, room_ - cells_ - outside_);
    LeftOver left;
    left.room = {::new (memory_.words.data() + left_word_) float[3 * left_max], 3 * left_max};
    // Either thread has a table of its own.
    std::array<std::atomic<bool>, 2> taken{};
    std::atomic<std::size_t> met{0};
    team_.run(bands_.count, [&](std::size_t band) {
      std::size_t slot = 0;
      while (taken[slot].exchange(true, std::memory_order_acquire)) slot = 1 - slot;
      float* from = band < split_ ? kept_[band].array + 3 * kept_[band].at
                                  : xyz_ + 3 * (bands_.first_cell(band + 1) - count_[band]);
      met += HWY_DYNAMIC_DISPATCH(fill_band)(bands_, band, from, count_[band], xyz_ + 3 * bands_.first_cell(band),
                                             tables + slot * table_floats_, left);
      taken[slot].store(false, std::memory_order_release);
    });
    found.met = met;
    found.crowded = left.too_many;

    if (found.crowded) {
      // Which bands found room was chance: now none has.
      team_.run(bands_.count, [&](std::size_t band) {
        const std::span<float> points = left.of_band[band];
        put_in_free_cells(points.data(), points.size() / 3, xyz_ + 3 * bands_.first_cell(band));
      });
      left.points = 0;
    }
    std::copy_n(left.room.data(), 3 * left.points, xyz_ + 3 * (cells_ + outside_));
    sort_points(xyz_ + 3 * cells_, outside_ + left.points);
    return cells_ + outside_ + left.points;
  }

 private:
  [[nodiscard]] static std::size_t begin_of(std::size_t block) { return block * kBlock; }
  [[nodiscard]] std::size_t end_of(std::size_t block) const { return std::min(points_, (block + 1) * kBlock); }
  /// Where in its band, or among what is beyond, the first point of a block goes.
  [[nodiscard]] std::size_t place(std::size_t block, std::size_t kind) const {
    return place_[block * bands_.kinds() + kind];
  }
  /// As many as there is memory for, and where each block's other points close ranks.
  [[nodiscard]] bool choose_upper_bands(std::size_t finite) {
    std::size_t upper = 0;
    for (std::size_t piece = 0, used = 0; split_ < bands_.count; ++split_) {
      const std::size_t points = count_[split_];
      while (piece < memory_.points.size() && memory_.points[piece].size() / 3 - used < points) ++piece, used = 0;
      if (piece == memory_.points.size()) break;
      kept_[split_] = {memory_.points[piece].data(), used};
      used += points;
      upper += points;
    }
    for (std::size_t block = 0; block < blocks_; ++block) {
      closed_[block + 1] = closed_[block];
      for (std::size_t kind = split_; kind <= bands_.outside(); ++kind) {
        const std::size_t next = block + 1 < blocks_ ? place(block + 1, kind) : count_[kind];
        closed_[block + 1] += next - place(block, kind);
      }
    }
    // What has closed ranks must not reach into the lower bands' part of the grid.
    return finite - upper <= bands_.first_cell(split_);
  }

  const Bands bands_;
  const OrderMemory memory_;
  Team& team_;
  float* const xyz_;
  const std::size_t points_;
  const std::size_t room_;  ///< points that the cloud has room for
  const std::size_t blocks_;
  const std::size_t cells_;
  // In the memory of words: places, a table for either thread, and what is left over.
  const std::size_t table_floats_, table_word_, left_word_;

  std::uint32_t* place_ = nullptr;
  std::array<std::uint32_t, kKindsMax> count_{};  ///< points of each band, and of what is beyond
  std::size_t outside_ = 0;
  std::size_t split_ = 0;  ///< the first of the lower bands
  struct Kept {
    float* array = nullptr;
    std::size_t at = 0;  ///< the band's first point
  };
  std::array<Kept, kBandsMax> kept_{};                ///< upper bands
  std::array<std::size_t, kBlocksMax + 1> closed_{};  ///< where each block's lower points are after step 2
};

}  // namespace

bool order_points(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team, Ordered& found) {
  found = Ordered{};
  Ordering ordering(cloud, lattice, memory, team);
  if (!ordering.count(found)) return false;
  ordering.deal_upper_bands();
  ordering.deal_lower_bands();
  cloud.points = ordering.fill_cells(found);
  const auto columns = static_cast<std::size_t>(lattice.columns);
  const auto rows = static_cast<std::size_t>(lattice.rows);
  const bool organised = cloud.points == columns * rows && !found.crowded;
  cloud.width = organised ? columns : 0;
  cloud.height = organised ? rows : 0;
  return true;
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
