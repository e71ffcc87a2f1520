// SPDX-License-Identifier: Apache-2.0
//
// A cloud in an order of no meaning (merged views, a program that sorts by something else) costs every pass a cache
// miss a point. Bringing it into the lattice's order first costs less than one such pass, and all that follow find
// neighbours beside each other. The cloud fills its buffer, and free memory holds just over half of it; so:
//
//  1. The table's rows are cut into bands whose points fit the second-level cache, and each block of the scan counts
//  how
//     many points it has for each band: now every point's band has its place in the sorted cloud.
//  2. The points of the upper bands, at least half of all, go into the free memory, band by band; the others close
//  ranks
//     at the front of the cloud, which leaves its rear free.
//  3. The others go from there to the rear, each to its band's place.
//  4. Band by band, in the cache: each point's number is noted in its cell, then the cells are gone through and the
//     points written to their places; first the upper bands, from the free memory to the front, then the lower ones, by
//     way of a copy.
//
// Invariants: where a block writes is counted beforehand, so blocks share nothing. In step 2 a block closes ranks over
// blocks before it and waits until those have been read; blocks are begun in their order, so the first unfinished one
// never waits. In a band, the order of the points it is given does not show.
#include "algo/lattice_order.h"

#include <hwy/cache_control.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <tuple>
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

constexpr std::size_t kBlock = 1U << 16U;
constexpr std::size_t kBlocksMax = (limits::kScanPointsMax + kBlock - 1) / kBlock;
/// Bands of rows, and one more for the points without a cell.
constexpr std::size_t kBandsMax = 255;
/// Cells of a band: points, copies and numbers are half a megabyte.
constexpr std::size_t kBandCells = 1U << 15U;
constexpr std::uint32_t kNoPoint = ~0U;

struct Bands {
  explicit Bands(const Lattice& of)
      : lattice(of), columns(static_cast<std::size_t>(of.columns)), rows(static_cast<std::size_t>(of.rows)) {
    band_rows = std::max({std::size_t{1}, kBandCells / columns, (rows + kBandsMax - 1) / kBandsMax});
    count = (rows + band_rows - 1) / band_rows;
  }
  Lattice lattice;
  std::size_t columns, rows;
  std::size_t band_rows = 1;
  std::size_t count = 0;  ///< the number of the band of points without a cell
  [[nodiscard]] std::size_t cells() const { return columns * band_rows; }
};

/// Where the next point of each band goes.
using Cursors = std::array<float*, kBandsMax + 1>;

/// Among points of a cell the lowest comes first.
bool comes_before(const float* a, const float* b) {
  return std::tie(a[2], a[0], a[1]) < std::tie(b[2], b[0], b[1]);
}

}  // namespace
}  // namespace slabd::algo
#endif

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Bands of sixteen points: whole numbers.
class BandOf {
 public:
  explicit BandOf(const Bands& bands)
      : lattice_(bands.lattice),
        per_band_(1.0F / static_cast<float>(bands.band_rows)),
        without_(static_cast<float>(bands.count)) {}
  HWY_INLINE F16 operator()(const Points16& p) const {
    const Places16 at = places(lattice_, p);
    // Half a row away from where rounding could matter.
    const F16 band = floor((at.row + f16(0.5F)) * f16(per_band_));
    return select(finite_points(p) & inside(lattice_, at), band, f16(without_));
  }

 private:
  const Lattice lattice_;
  const float per_band_, without_;
};

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
  std::fill_n(count, bands.count + 1, 0U);
  alignas(64) std::array<std::int32_t, kLanes> band;
  for (std::size_t i = first; i < last; i += kLanes) {
    store(to_int(band_of(sixteen_points(xyz, last, i))), band.data());
    const std::size_t n = std::min(kLanes, last - i);
    for (std::size_t k = 0; k < n; ++k) ++count[band[k]];
  }
}

/// Steps 2 and 3 for points first to last: each goes to its band's cursor, those of `beyond` and the bands behind it
/// all to one. The cursors may write where points have been read.
void deal(const Bands& bands, const float* xyz, std::size_t first, std::size_t last, std::size_t beyond,
          Cursors& cursors) {
  constexpr std::size_t kAhead = 32;  // floats; without fetching ahead this takes twice as long
  const BandOf band_of(bands);
  const F16 most = f16(static_cast<float>(beyond));
  alignas(64) std::array<std::int32_t, kLanes> band;
  for (std::size_t i = first; i < last; i += kLanes) {
    store(to_int(min(band_of(sixteen_points(xyz, last, i)), most)), band.data());
    const std::size_t n = std::min(kLanes, last - i);
    for (std::size_t k = 0; k < n; ++k) {
      float*& to = cursors[static_cast<std::size_t>(band[k])];
      // By way of registers: source and target may be the same place.
      std::array<float, 3> point;
      std::memcpy(point.data(), xyz + 3 * (i + k), sizeof point);
      std::memcpy(to, point.data(), sizeof point);
      to += 3;
      hwy::Prefetch(to + kAhead);
    }
  }
}

/// Step 4 for one band: `points` points to `to`. `at`: memory for the band's cells.
void sort_band(const Bands& bands, std::size_t band, const float* from, std::size_t points, float* to,
               std::uint32_t* at) {
  const Lattice lattice = bands.lattice;
  const F16 first_row = f16(static_cast<float>(band * bands.band_rows));
  std::fill_n(at, bands.cells(), kNoPoint);
  float* behind = to + 3 * points;  // where the points go that share a cell with a lower one
  alignas(64) std::array<std::int32_t, kLanes> cell;
  for (std::size_t i = 0; i < points; i += kLanes) {
    const Places16 place = places(lattice, sixteen_points(from, points, i));
    store(to_int((place.row - first_row) * f16(lattice.columns) + place.column), cell.data());
    const std::size_t n = std::min(kLanes, points - i);
    for (std::size_t k = 0; k < n; ++k) {
      std::uint32_t& there = at[cell[k]];
      std::size_t here = i + k;
      if (there != kNoPoint) {
        std::size_t other = there;
        if (comes_before(from + 3 * other, from + 3 * here)) std::swap(here, other);
        behind -= 3;
        std::copy_n(from + 3 * other, 3, behind);
      }
      there = static_cast<std::uint32_t>(here);
    }
  }
  float* end = to;
  for (std::size_t c = 0; c < bands.cells(); ++c) {
    if (at[c] == kNoPoint) continue;
    std::memcpy(end, from + 3 * std::size_t{at[c]}, 3 * sizeof(float));
    end += 3;
  }
  // Few, if it is a lattice at all.
  struct Point {
    std::array<float, 3> xyz;
  };
  auto* rest = reinterpret_cast<Point*>(end);
  std::sort(rest, rest + (points - static_cast<std::size_t>(end - to) / 3),
            [](const Point& a, const Point& b) { return comes_before(a.xyz.data(), b.xyz.data()); });
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(count_near);
HWY_EXPORT(count_bands);
HWY_EXPORT(deal);
HWY_EXPORT(sort_band);

bool is_in_order(const Cloud& cloud, const Lattice& lattice) {
  constexpr std::size_t kLooks = 1'024;
  const std::size_t stride = std::max<std::size_t>(16, cloud.points / kLooks);
  std::size_t looked_at = 0;
  const std::size_t near = HWY_DYNAMIC_DISPATCH(count_near)(cloud, lattice, stride, looked_at);
  return 2 * near >= looked_at;
}

bool order_points(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team) {
  const Bands bands(lattice);
  const std::size_t stride = bands.count + 1;
  const std::size_t blocks = (cloud.points + kBlock - 1) / kBlock;
  float* xyz = cloud.xyz.data();
  const auto begin_of = [](std::size_t block) { return block * kBlock; };
  const auto end_of = [&](std::size_t block) { return std::min(cloud.points, (block + 1) * kBlock); };
  if (memory.words.size() < kOrderWords || blocks * stride + 2 * bands.cells() > kOrderWords) return false;

  // Counts of each block become where in its band its first point goes.
  std::uint32_t* place = memory.words.data();
  team.run(blocks, [&](std::size_t block) {
    HWY_DYNAMIC_DISPATCH(count_bands)(bands, xyz, begin_of(block), end_of(block), place + block * stride);
  });
  std::array<std::size_t, kBandsMax + 2> start{};  // of each band in the sorted cloud
  for (std::size_t band = 0; band <= bands.count; ++band) {
    std::uint32_t points = 0;
    for (std::size_t block = 0; block < blocks; ++block) points += std::exchange(place[block * stride + band], points);
    start[band + 1] = start[band] + points;
  }

  // The upper bands are as many as there is room for.
  std::array<float*, kBandsMax> kept{};
  std::size_t split = 0;  // the first of the lower bands
  for (std::size_t piece = 0, used = 0; split < bands.count; ++split) {
    const std::size_t floats = 3 * (start[split + 1] - start[split]);
    while (piece < memory.points.size() && memory.points[piece].size() - used < floats) ++piece, used = 0;
    if (piece == memory.points.size()) break;
    kept[split] = memory.points[piece].data() + used;
    used += floats;
  }
  if (2 * start[split] < cloud.points) return false;
  const std::span<float> copies = memory.points[0];  // free again when the upper bands are sorted
  for (std::size_t band = split; band < bands.count; ++band)
    if (3 * (start[band + 1] - start[band]) > copies.size() / 2) return false;
  std::array<std::size_t, kBlocksMax + 1> closed{};
  for (std::size_t block = 0; block < blocks; ++block) {
    std::size_t points = end_of(block) - begin_of(block);
    for (std::size_t band = 0; band < split; ++band) {
      const std::uint32_t next = block + 1 < blocks ? place[(block + 1) * stride + band]
                                                    : static_cast<std::uint32_t>(start[band + 1] - start[band]);
      points -= next - place[block * stride + band];
    }
    closed[block + 1] = closed[block] + points;
  }

  std::array<std::atomic<bool>, kBlocksMax> read{};
  team.run(blocks, [&](std::size_t block) {
    Cursors cursors{};
    for (std::size_t band = 0; band < split; ++band) cursors[band] = kept[band] + 3 * place[block * stride + band];
    cursors[split] = xyz + 3 * closed[block];
    for (std::size_t other = closed[block] / kBlock; other < block && other * kBlock < closed[block + 1]; ++other)
      read[other].wait(false, std::memory_order_acquire);
    HWY_DYNAMIC_DISPATCH(deal)(bands, xyz, begin_of(block), end_of(block), split, cursors);
    read[block].store(true, std::memory_order_release);
    read[block].notify_all();
  });
  team.run(blocks, [&](std::size_t block) {
    Cursors cursors{};
    for (std::size_t band = split; band <= bands.count; ++band)
      cursors[band] = xyz + 3 * (start[band] + place[block * stride + band]);
    HWY_DYNAMIC_DISPATCH(deal)(bands, xyz, closed[block], closed[block + 1], bands.count, cursors);
  });

  // Either thread has cells, and a copy, of its own.
  std::array<std::atomic<bool>, 2> taken{};
  const auto sort = [&](std::size_t band, bool copied) {
    std::size_t slot = 0;
    while (taken[slot].exchange(true, std::memory_order_acquire)) slot = 1 - slot;
    float* to = xyz + 3 * start[band];
    const std::size_t points = start[band + 1] - start[band];
    const float* from = kept[band];
    if (copied) {
      float* copy = copies.data() + slot * (copies.size() / 2);
      std::copy_n(to, 3 * points, copy);
      from = copy;
    }
    HWY_DYNAMIC_DISPATCH(sort_band)
    (bands, band, from, points, to, place + blocks * stride + slot * bands.cells());
    taken[slot].store(false, std::memory_order_release);
  };
  team.run(split, [&](std::size_t band) { sort(band, false); });
  team.run(bands.count - split, [&](std::size_t band) { sort(split + band, true); });
  return true;
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
