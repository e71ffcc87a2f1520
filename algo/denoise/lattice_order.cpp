// SPDX-License-Identifier: Apache-2.0
//
// Problem: a cloud whose order has no meaning (merged views, a program that sorts by something else) costs every pass
// one cache miss per point. Moving each point to its place in the grid of its rays first costs less than one such pass,
// and gives an organised scan. The cloud fills its buffer, and the free memory holds just over half of it. Idea:
//
//  1. The grid's rows are divided into bands that fit into the second-level cache. Points are scattered into buckets
//     ("buckets") of sixty-four points of one band. A full bucket is stored in the next free place
//     (algo/denoise/point_buckets.h): buckets of the first bands in the free memory, those of the last bands at the
//     front of the cloud, over points already read. So no counting pass is needed; at the end the places are sorted by
//     band.
//  2. Band by band, each point is stored in its cell in a small table that stays in the cache, and the whole table is
//     copied to its place in the cloud. The last bands come first: their places are at the rear, where all points have
//     been read. Then the front is free for the first bands.
//
// This step is limited by memory bandwidth, so no memory is read only to be overwritten: buckets are whole cache lines,
// and buckets and tables of step 2 are written with non-temporal stores.
//
// Invariants: each place, and each band's part of the grid, is written by one thread. The lowest point of a cell stays,
// in any order; the remaining points are sorted. Two failures are detected only after scattering: a band has more
// points than cells, or more points share a cell than the memory holds. Then all points are sorted in the cloud.
// Therefore no point is ever lost, and the result does not depend on the order.
#include "algo/denoise/lattice.h"

#include <hwy/cache_control.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <new>
#include <span>
#include <tuple>
#include <type_traits>
#include <utility>

#include "algo/denoise/point_buckets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/denoise/lattice_order.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/denoise/lattice_cells-inl.h"
#include "algo/lanes-inl.h"
// clang-format on

#ifndef SLABD_ALGO_LATTICE_ORDER_ONCE
#define SLABD_ALGO_LATTICE_ORDER_ONCE
namespace slabd::algo {
namespace {

constexpr std::size_t kBandsMax = kKindsMax - 2;
/// Cells of a band: their points take less than half a megabyte, unless a single row is larger.
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
  /// Kinds beyond the bands: points outside the table, and missing ones.
  [[nodiscard]] std::size_t outside() const { return count; }
  [[nodiscard]] std::size_t missing() const { return count + 1; }
  [[nodiscard]] std::size_t kinds() const { return count + 2; }
  /// First cell of a band; for the band after the last one, the number of all cells.
  [[nodiscard]] std::size_t first_cell(std::size_t band) const { return columns * std::min(rows, band * band_rows); }
  [[nodiscard]] std::size_t cells() const { return columns * band_rows; }
};

/// Points are moved in units of this size.
constexpr std::size_t kMoveBytes = 4 * sizeof(float);
static_assert(kBucketBytes - kPointBytes + kMoveBytes <= Scatter::kStride);
/// The "bucket full" branch mispredicts about once per bucket. So the targets of this many points are computed before
/// the first of them is moved.
constexpr std::size_t kAtOnce = 256;
/// Prefetch distances, in buckets and in floats.
constexpr std::size_t kBucketsAhead = 8;
constexpr std::size_t kAhead = 768;

/// Points that share their cell with a lower one.
struct LeftOver {
  std::span<float> room;
  std::atomic<std::size_t> points{0};
  std::atomic<bool> too_many{false};

  /// Reserves memory for more points; null if it is full.
  [[nodiscard]] float* take(std::size_t more) {
    std::size_t at = points.load();
    do {
      if (3 * (at + more) > room.size()) return nullptr;
    } while (!points.compare_exchange_weak(at, at + more));
    return room.data() + 3 * at;
  }
};

/// Counts of sampled points.
struct SampledPlaces {
  std::size_t points = 0, finite = 0;
  std::size_t outside = 0;  ///< finite, but outside the table
};

/// Order of points in a cell: the lowest comes first.
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

}  // namespace
}  // namespace slabd::algo
#endif

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Bands of sixteen points, or the kinds beyond the bands, as whole numbers.
class BandOf {
 public:
  explicit BandOf(const Bands& bands)
      : lattice_(bands.lattice),
        per_band_(1.0F / static_cast<float>(bands.band_rows)),
        outside_(static_cast<float>(bands.outside())),
        missing_(static_cast<float>(bands.missing())) {}
  HWY_INLINE F16 operator()(const Points16& p) const {
    const Places16 at = places(lattice_, p);
    // Adds half a row, so that rounding cannot change the band.
    const F16 band = floor((at.row + f16(0.5F)) * f16(per_band_));
    return select(finite_points(p), select(inside(lattice_, at), band, f16(outside_)), f16(missing_));
  }

 private:
  const Lattice lattice_;
  const float per_band_, outside_, missing_;
};

/// Writes whole registers with non-temporal stores if the target is aligned; otherwise copies.
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

/// Samples sixteen points at every `stride`: counts the samples in which all points are near the first.
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

/// Samples sixteen points at every `stride`: counts the finite ones and those outside the table.
SampledPlaces count_outside(const Cloud& cloud, const Lattice& lattice, std::size_t stride) {
  SampledPlaces seen;
  for (std::size_t i = 0; i + kLanes <= cloud.points; i += stride) {
    const Points16 p = load_points(cloud.xyz.data() + 3 * i);
    const std::uint32_t finite = bits(finite_points(p));
    seen.points += kLanes;
    seen.finite += static_cast<std::size_t>(std::popcount(finite));
    seen.outside += static_cast<std::size_t>(std::popcount(finite & ~bits(inside(lattice, places(lattice, p)))));
  }
  return seen;
}

/// Step 1 for points first to last: moves each to its band's bucket. Full buckets of band `split` and of the bands
/// after it are stored at the front.
void scatter(const Bands& bands, const float* xyz, std::size_t first, std::size_t last, std::size_t split,
             Scatter& scatter, BucketPlaces& buckets) {
  const auto put_away = [&](std::size_t kind) {
    scatter.next[kind] = static_cast<std::uint32_t>(Scatter::kStride * kind);
    if (kind == bands.missing()) return;
    const Place place = buckets.take(scatter, kind >= split);
    write_past_caches(reinterpret_cast<const float*>(scatter.buckets.data() + Scatter::kStride * kind), kBucketFloats,
                      buckets.at(place));
    buckets.note(place, kind);
    ++scatter.full[kind];
  };
  const BandOf band_of(bands);
  alignas(64) std::array<std::int32_t, kAtOnce> band;
  for (std::size_t from = first; from < last; from += kAtOnce) {
    const std::size_t end = std::min(last, from + kAtOnce);
    for (std::size_t i = from; i < end; i += kLanes) {
      fetch_points(xyz + 3 * i + kAhead);
      store(to_int(band_of(sixteen_points(xyz, end, i))), band.data() + (i - from));
    }
    const auto move = [&](std::size_t i, auto bytes) {
      const auto to = static_cast<std::size_t>(band[i - from]);
      const std::uint32_t at = scatter.next[to];
      std::memcpy(scatter.buckets.data() + at, xyz + 3 * i, bytes);
      const std::uint32_t behind = at + static_cast<std::uint32_t>(kPointBytes);
      scatter.next[to] = behind;
      if (behind % Scatter::kStride == kBucketBytes) put_away(to);
    };
    // Memory beyond the last point does not belong to the cloud.
    const std::size_t wide = std::min(end, last - 1);
    for (std::size_t i = from; i < wide; ++i) move(i, std::integral_constant<std::size_t, kMoveBytes>());
    if (wide < end) move(wide, std::integral_constant<std::size_t, kPointBytes>());
  }
  hwy::FlushStream();  // another thread may read them
}

/// Step 2 for one band: moves its points to their cells, `to`. The buckets are overwritten. `table`: memory for the
/// band's cells. Returns the number of points that share a cell with a lower one. These go to `left`, or to free cells
/// if `left` is full.
std::size_t fill_band(const Bands& bands, std::size_t band, const BucketsOfKind& buckets, float* to, float* table,
                      LeftOver& left) {
  const Lattice lattice = bands.lattice;
  const F16 first_row = f16(static_cast<float>(band * bands.band_rows));
  const std::size_t cells = bands.first_cell(band + 1) - bands.first_cell(band);
  // Points that share a cell are written back over points already read.
  PointsOfBuckets met_to(buckets), met_from(buckets);
  std::size_t met = 0;
  const auto put = [&](float* from, std::int32_t cell) {
    float* there = table + 3 * static_cast<std::size_t>(cell);
    std::array<float, 3> point;
    std::memcpy(point.data(), from, sizeof point);
    if (!std::isnan(there[2])) {
      if (comes_before(point.data(), there)) std::swap_ranges(point.begin(), point.end(), there);
      std::copy_n(point.data(), 3, met_to.next());
      ++met;
    } else {
      std::memcpy(there, point.data(), sizeof point);
    }
  };
  // Buckets are at random addresses, so they are prefetched.
  BucketsOfKind unread = buckets;
  std::array<std::span<float>, kBucketsAhead> fetched;
  const auto fetch = [&] {
    const std::span<float> bucket = unread.next();
    for (std::size_t i = 0; i < bucket.size(); i += 3 * kLanes) fetch_points(bucket.data() + i);
    return bucket;
  };
  for (std::span<float>& bucket : fetched) bucket = fetch();
  alignas(64) std::array<std::int32_t, kBucketPoints> cell;
  for (std::size_t k = 0; !fetched[k].empty(); k = (k + 1) % kBucketsAhead) {
    const std::span<float> bucket = std::exchange(fetched[k], fetch());
    const std::size_t points = bucket.size() / 3;
    for (std::size_t i = 0; i < points; i += kLanes) {
      const Places16 place = places(lattice, sixteen_points(bucket.data(), points, i));
      store(to_int((place.row - first_row) * f16(lattice.columns) + place.column), cell.data() + i);
    }
    for (std::size_t i = 0; i < points; ++i) put(bucket.data() + 3 * i, cell[i]);
  }
  if (float* room = left.take(met); room != nullptr) {
    for (std::size_t k = 0; k < met; ++k) std::copy_n(met_from.next(), 3, room + 3 * k);
  } else {
    left.too_many = true;
    float* free_cell = table;
    for (std::size_t k = 0; k < met; ++k) {
      while (!std::isnan(free_cell[2])) free_cell += 3;
      std::copy_n(met_from.next(), 3, free_cell);
    }
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
HWY_EXPORT(count_outside);
HWY_EXPORT(scatter);
HWY_EXPORT(fill_band);

bool is_in_order(const Cloud& cloud, const Lattice& lattice) {
  constexpr std::size_t kLooks = 1'024;
  const std::size_t stride = std::max<std::size_t>(16, cloud.points / kLooks);
  std::size_t looked_at = 0;
  const std::size_t near = HWY_DYNAMIC_DISPATCH(count_near)(cloud, lattice, stride, looked_at);
  return 2 * near >= looked_at;
}

namespace {

/// Runs the two steps on one cloud.
class Ordering {
 public:
  Ordering(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team)
      : bands_(lattice),
        cloud_(cloud),
        team_(team),
        words_(memory.words),
        xyz_(cloud.xyz.data()),
        room_(std::min(limits::kScanPointsMax, cloud.xyz.size() / 3)),
        cells_(bands_.first_cell(bands_.count)),
        places_(xyz_, memory.points) {}

  /// True if the memory suffices, as far as this is predictable before points are moved.
  [[nodiscard]] bool is_possible() {
    // The first bands hold half of the cells, or fewer if the free memory is smaller: then the grid must not be full.
    const std::size_t spare = BucketPlaces::spare(bands_.kinds());
    if (cells_ > room_ || places_.kept_room() < spare) return false;
    const std::size_t kept_points = kBucketPoints * (places_.kept_room() - spare);
    while (split_ < bands_.count && 2 * bands_.first_cell(split_) < cells_ &&
           bands_.first_cell(split_ + 1) <= kept_points)
      ++split_;
    const std::size_t kept_cells = bands_.first_cell(split_);
    if (2 * kept_cells < std::min(cells_, cloud_.points)) return false;

    const std::size_t kept = (kept_cells + kBucketPoints - 1) / kBucketPoints + spare;
    const std::size_t front = kept_cells / kBucketPoints;
    table_word_ = whole_lines(kept + front);
    left_word_ =
        table_word_ + whole_lines(std::max(2 * 3 * bands_.cells(), words_for(2 * sizeof(Scatter) + kept + front)));
    if (words_.size() < left_word_) return false;
    scattering_ = reinterpret_cast<std::byte*>(words_.data() + table_word_);
    places_.use(kept, front, reinterpret_cast<std::uint8_t*>(scattering_ + 2 * sizeof(Scatter)));

    constexpr std::size_t kLooks = 4'096;
    const std::size_t stride = std::max<std::size_t>(16, cloud_.points / kLooks);
    const SampledPlaces seen = HWY_DYNAMIC_DISPATCH(count_outside)(cloud_, bands_.lattice, stride);
    constexpr std::size_t kSure = 3;
    if (kOutsideShare * seen.outside > kSure * seen.finite) return false;
    // The margin is larger than any sampling error.
    return seen.points == 0 || cloud_.points / seen.points * seen.finite <= cells_ + cells_ / 32;
  }

  /// Step 1. False if the points are not those of a lattice, or do not fit.
  [[nodiscard]] bool scatter_points(Ordered& found) {
    const std::size_t blocks = (cloud_.points + kBlock - 1) / kBlock;
    for (std::size_t slot = 0; slot < 2; ++slot) {
      scatters_[slot] = ::new (scattering_ + slot * sizeof(Scatter)) Scatter;
      scatters_[slot]->clear();
    }
    team_.run(blocks, [&](std::size_t block) {
      places_.wait_for_turn(block);
      const Slots::Slot slot(slots_);
      HWY_DYNAMIC_DISPATCH(scatter)
      (bands_, xyz_, block * kBlock, std::min(cloud_.points, (block + 1) * kBlock), split_, *scatters_[slot.number],
       places_);
      places_.block_is_done(block);
    });
    // Partly filled buckets need a place too.
    bool fits = !places_.overfull() && places_.kept_left() >= 2 * bands_.kinds() + 2 * kPlaceRun;
    for (std::size_t kind = 0; kind < bands_.missing(); ++kind) {
      const std::size_t points = scatters_[0]->points(kind) + scatters_[1]->points(kind);
      found.finite += points;
      if (kind == bands_.outside())
        found.outside = outside_ = points;
      else
        fits = fits && points <= bands_.first_cell(kind + 1) - bands_.first_cell(kind);
    }
    return fits && cells_ + outside_ <= room_ && kOutsideShare * outside_ <= found.finite;
  }
  /// Copies all scattered points back into the cloud, sorted.
  void take_back_scattered() {
    // Reserved places that were not used are cleared.
    for (Scatter* scatter : scatters_) {
      for (std::size_t place = scatter->kept.next; place < scatter->kept.end; ++place) clear(place);
      for (std::size_t place = scatter->front.next; place < scatter->front.end; ++place)
        clear(places_.first_at_front() + place);
    }
    Collected points(xyz_);
    points.add(xyz_, kBucketPoints * places_.front_taken());
    for (std::size_t place = 0; place < places_.kept_taken(); ++place)
      points.add(places_.at(static_cast<Place>(place)), kBucketPoints);
    for (const Scatter* scatter : scatters_)
      for (std::size_t kind = 0; kind < bands_.missing(); ++kind)
        points.add(scatter->bucket(kind), scatter->begun(kind));
    points.finish(cloud_);
  }

  /// Step 2. On return the cloud has its points. False if more points share a cell than the memory holds.
  [[nodiscard]] bool fill_cells(Ordered& found) {
    list_buckets();
    // From here on the tables use the scatters' memory.
    const std::size_t table_floats = 3 * bands_.cells();
    float* tables = ::new (words_.data() + table_word_) float[2 * table_floats];
    std::fill_n(tables, 2 * table_floats, kNoPoint);
    const std::size_t left_max = std::min((words_.size() - left_word_) / 3, room_ - cells_ - outside_);
    LeftOver left;
    left.room = {::new (words_.data() + left_word_) float[3 * left_max], 3 * left_max};
    std::atomic<std::size_t> met{0};
    const auto fill = [&](std::size_t first, std::size_t last) {
      team_.run(last - first, [&](std::size_t k) {
        const std::size_t band = first + k;
        const Slots::Slot slot(slots_);
        met += HWY_DYNAMIC_DISPATCH(fill_band)(bands_, band, buckets_of(band), xyz_ + 3 * bands_.first_cell(band),
                                               tables + slot.number * table_floats, left);
      });
    };
    fill(split_, bands_.count);
    PointsOfBuckets from(buckets_of(bands_.outside()));
    for (std::size_t i = 0; i < outside_; ++i) std::copy_n(from.next(), 3, xyz_ + 3 * (cells_ + i));
    fill(0, split_);
    found.met = met;

    const std::size_t ordered = cells_ + outside_;
    if (left.too_many) {
      Collected points(xyz_);
      points.add(xyz_, ordered);
      points.add(left.room.data(), left.points);
      points.finish(cloud_);
      return false;
    }
    std::copy_n(left.room.data(), 3 * left.points, xyz_ + 3 * ordered);
    cloud_.points = ordered + left.points;
    sort_points(xyz_ + 3 * cells_, cloud_.points - cells_);
    return true;
  }

 private:
  /// Each of the two threads has its own memory.
  struct Slots {
    std::array<std::atomic<bool>, 2> taken{};
    struct Slot {
      explicit Slot(Slots& of) : slots(of) {
        while (slots.taken[number].exchange(true, std::memory_order_acquire)) number = 1 - number;
      }
      ~Slot() { slots.taken[number].store(false, std::memory_order_release); }
      Slot(const Slot&) = delete;
      Slot& operator=(const Slot&) = delete;
      Slots& slots;
      std::size_t number = 0;
    };
  };
  /// Points copied back to the cloud; the write position never passes the read position.
  class Collected {
   public:
    explicit Collected(float* xyz) : xyz_(xyz) {}
    void add(const float* from, std::size_t points) {
      for (const float* p = from; p < from + 3 * points; p += 3)
        if (!std::isnan(p[2])) std::copy_n(p, 3, xyz_ + 3 * points_++);
    }
    void finish(Cloud& cloud) {
      sort_points(xyz_, points_);
      std::fill(xyz_ + 3 * points_, xyz_ + 3 * cloud.points, kNoPoint);
      cloud.width = cloud.height = 0;
    }

   private:
    float* const xyz_;
    std::size_t points_ = 0;
  };
  /// Lists the places of full buckets by kind, and those of partly filled ones.
  void list_buckets() {
    std::uint32_t first = 0;
    std::array<std::uint32_t, kKindsMax> behind{};
    for (std::size_t kind = 0; kind < bands_.missing(); ++kind) {
      first_[kind] = behind[kind] = first;
      first += scatters_[0]->full[kind] + scatters_[1]->full[kind];
      for (std::size_t slot = 0; slot < 2; ++slot)
        begun_[kind][slot] = put_partial_bucket(*scatters_[slot], places_, kind, kind >= split_);
    }
    first_[bands_.missing()] = first;
    places_.sort_by_kind(behind, words_.data());
  }
  [[nodiscard]] BucketsOfKind buckets_of(std::size_t kind) const {
    return {places_, std::span<const Place>(words_).subspan(first_[kind], first_[kind + 1] - first_[kind]),
            begun_[kind]};
  }
  [[nodiscard]] static std::size_t words_for(std::size_t bytes) { return (bytes + 3) / 4; }
  [[nodiscard]] static std::size_t whole_lines(std::size_t words) { return (words + 15) / 16 * 16; }
  void clear(std::size_t place) { std::fill_n(places_.at(static_cast<Place>(place)), kBucketFloats, kNoPoint); }

  const Bands bands_;
  Cloud& cloud_;
  Team& team_;
  const std::span<std::uint32_t> words_;
  float* const xyz_;
  const std::size_t room_;  ///< capacity of the cloud in points
  const std::size_t cells_;
  BucketPlaces places_;
  std::size_t split_ = 0;  ///< the first of the last bands
  // In the memory of `words`, after the list of buckets: first the scatters, then tables; and points left over.
  std::size_t table_word_ = 0, left_word_ = 0;
  std::byte* scattering_ = nullptr;
  std::array<Scatter*, 2> scatters_{};
  Slots slots_;
  std::array<std::uint32_t, kKindsMax> first_{};  ///< start of each kind in the list of buckets
  std::array<std::array<PartialBucket, 2>, kKindsMax> begun_{};
  std::size_t outside_ = 0;
};

}  // namespace

bool order_points(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team, Ordered& found) {
  found = Ordered{};
  Ordering ordering(cloud, lattice, memory, team);
  if (!ordering.is_possible()) return false;
  if (!ordering.scatter_points(found)) {
    ordering.take_back_scattered();
    return false;
  }
  if (!ordering.fill_cells(found)) return false;
  const auto columns = static_cast<std::size_t>(lattice.columns);
  const auto rows = static_cast<std::size_t>(lattice.rows);
  const bool organised = cloud.points == columns * rows;
  cloud.width = organised ? columns : 0;
  cloud.height = organised ? rows : 0;
  return true;
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
