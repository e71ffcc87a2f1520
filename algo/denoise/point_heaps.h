// SPDX-License-Identifier: Apache-2.0
//
// Buckets ("heaps") of points of one kind each, for algo/denoise/lattice_order.cpp: many small arrays in little memory.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

#include "base/limits.h"

namespace slabd::algo {

/// Points of a bucket: sixty-four are twelve cache lines. Buckets are at random addresses, and reading one waits for
/// its first lines; with half the size that happens twice as often.
inline constexpr std::size_t kPointBytes = 3 * sizeof(float);
inline constexpr std::size_t kHeapPoints = 64;
inline constexpr std::size_t kHeapFloats = 3 * kHeapPoints;
inline constexpr std::size_t kHeapBytes = kHeapPoints * kPointBytes;
/// Maximum number of kinds of points.
inline constexpr std::size_t kKindsMax = 255;

/// Points are dealt in blocks of kBlockHeaps buckets. A block starts when the one kBlocksAtOnce before it is done.
inline constexpr std::size_t kBlockHeaps = 64;
inline constexpr std::size_t kBlock = kBlockHeaps * kHeapPoints;
inline constexpr std::size_t kBlocksMax = (limits::kScanPointsMax + kBlock - 1) / kBlock;
inline constexpr std::size_t kBlocksAtOnce = 4;

/// Number of the place of one bucket.
using Place = std::uint32_t;

/// A thread's reserved places at one end of the memory; it reserves several at a time.
struct PlaceRun {
  std::size_t next = 0, end = 0;
};
inline constexpr std::size_t kPlaceRun = 8;

/// One thread's partly filled buckets, and the counts of its full ones. Large: located in the workspace.
struct Dealer {
  /// A bucket of each kind begins at multiples of this. The bytes between buckets are overwritten, because points are
  /// moved sixteen bytes at a time.
  static constexpr std::size_t kStride = 1'024;

  std::array<std::byte, kStride * kKindsMax> heaps;
  std::array<std::uint32_t, kKindsMax> next;  ///< byte offset in `heaps` of each kind's next point
  std::array<std::uint32_t, kKindsMax> full;  ///< stored full buckets of each kind
  PlaceRun kept, front;
  std::size_t blocks_done = 0;  ///< blocks known to be done

  void clear() {
    for (std::size_t kind = 0; kind < kKindsMax; ++kind) next[kind] = static_cast<std::uint32_t>(kStride * kind);
    full.fill(0);
    kept = front = {};
    blocks_done = 0;
  }
  /// Number of points of a kind in its partly filled bucket.
  [[nodiscard]] std::size_t begun(std::size_t kind) const { return next[kind] % kStride / kPointBytes; }
  [[nodiscard]] const float* heap(std::size_t kind) const {
    return reinterpret_cast<const float*>(heaps.data() + kStride * kind);
  }
  [[nodiscard]] std::size_t points(std::size_t kind) const { return kHeapPoints * full[kind] + begun(kind); }
};

/// Places for buckets, and the kind of bucket in each. "Kept" places are in free memory, "front" places over points at
/// the front of the cloud that have been read.
///
/// Invariant: every bucket has a place. The buckets hold at most the points read, and the front has as many places as
/// the completed blocks. So only the buckets of the last kBlocksAtOnce blocks need other places, which spare() covers.
class HeapPlaces {
 public:
  /// Kept places beyond those for the intended points: for partly filled buckets, and for full buckets while the front
  /// has no free place.
  static constexpr std::size_t spare(std::size_t kinds) {
    return 2 * kinds + kBlocksAtOnce * kBlockHeaps + 5 * kPlaceRun;
  }

  HeapPlaces(float* front, std::array<std::span<float>, 3> kept) : front_(front), kept_(kept) {}

  /// Sets the number of usable kept and front places; `kinds` has an entry for each.
  void use(std::size_t kept, std::size_t front, std::uint8_t* kinds) {
    kept_max_ = kept;
    front_max_ = front;
    kinds_ = kinds;
    std::fill_n(kinds, kept + front, kNothing);
  }
  [[nodiscard]] std::size_t kept_room() const {
    std::size_t heaps = 0;
    for (const std::span<float>& piece : kept_) heaps += piece.size() / kHeapFloats;
    return heaps;
  }

  /// Marks a block as read. Its writes are visible to every thread that takes a place afterwards.
  void block_is_done(std::size_t block) {
    done_[block].store(true, std::memory_order_release);
    done_[block].notify_all();
  }
  /// Waits until block `block` may start.
  void wait_for_turn(std::size_t block) const {
    if (block >= kBlocksAtOnce) done_[block - kBlocksAtOnce].wait(false, std::memory_order_acquire);
  }

  /// Takes a place for a bucket: at the front if wanted and available, else a kept one. If no kept place is left, the
  /// front takes the bucket, and overfull() is true from then on.
  [[nodiscard]] Place take(Dealer& dealer, bool at_front) {
    if (at_front && (any(dealer.front) || reserve_front(dealer))) return front_place(dealer);
    if (any(dealer.kept) || reserve_kept(dealer)) return static_cast<Place>(dealer.kept.next++);
    overfull_.store(true, std::memory_order_relaxed);
    if (!any(dealer.front)) reserve_front(dealer);
    return front_place(dealer);
  }
  void note(Place place, std::size_t kind) {
    if (place < kept_max_ + front_max_) kinds_[place] = static_cast<std::uint8_t>(kind);
  }
  /// Lists the places of all buckets by kind. `first`: start of each kind; the function moves it to the kind's end.
  void sort_by_kind(std::array<std::uint32_t, kKindsMax>& first, Place* sorted) const {
    for (Place place = 0; place < kept_max_ + front_max_; ++place)
      if (kinds_[place] != kNothing) sorted[first[kinds_[place]]++] = place;
  }
  [[nodiscard]] float* at(Place place) const {
    std::size_t heap = place;
    if (heap >= kept_max_) return front_ + kHeapFloats * (heap - kept_max_);
    std::size_t piece = 0;
    for (; heap >= kept_[piece].size() / kHeapFloats; ++piece) heap -= kept_[piece].size() / kHeapFloats;
    return kept_[piece].data() + kHeapFloats * heap;
  }
  [[nodiscard]] bool overfull() const { return overfull_.load(std::memory_order_relaxed); }
  /// Number of taken kept places, including those reserved by a dealer.
  [[nodiscard]] std::size_t kept_taken() const { return std::min(kept_max_, kept_taken_.load()); }
  [[nodiscard]] std::size_t kept_left() const { return kept_max_ - kept_taken(); }
  [[nodiscard]] std::size_t front_taken() const { return front_taken_.load(); }
  [[nodiscard]] Place first_at_front() const { return static_cast<Place>(kept_max_); }

 private:
  static constexpr std::uint8_t kNothing = 0xFF;
  static_assert(kKindsMax <= kNothing);

  static bool any(const PlaceRun& run) { return run.next != run.end; }
  Place front_place(Dealer& dealer) { return static_cast<Place>(kept_max_ + dealer.front.next++); }

  bool reserve_kept(Dealer& dealer) {
    const std::size_t first = kept_taken_.fetch_add(kPlaceRun, std::memory_order_relaxed);
    if (first >= kept_max_) return false;
    dealer.kept = {first, std::min(kept_max_, first + kPlaceRun)};
    return true;
  }
  bool reserve_front(Dealer& dealer) {
    std::size_t first = front_taken_.load(std::memory_order_relaxed);
    do {
      if (!overfull() && first + kPlaceRun > front_max_) return false;
      while (first + kPlaceRun > dealer.blocks_done * kBlockHeaps) {
        if (!done_[dealer.blocks_done].load(std::memory_order_acquire)) return false;
        ++dealer.blocks_done;
      }
    } while (!front_taken_.compare_exchange_weak(first, first + kPlaceRun, std::memory_order_relaxed));
    dealer.front = {first, first + kPlaceRun};
    return true;
  }

  float* const front_;
  const std::array<std::span<float>, 3> kept_;
  std::size_t kept_max_ = 0, front_max_ = 0;
  std::uint8_t* kinds_ = nullptr;
  std::array<std::atomic<bool>, kBlocksMax + 1> done_{};
  std::atomic<std::size_t> kept_taken_{0}, front_taken_{0};
  std::atomic<bool> overfull_{false};
};

/// A partly filled bucket; points = 0 if empty.
struct BegunHeap {
  Place place = 0;
  std::size_t points = 0;
};
/// Stores a thread's partly filled bucket of a kind.
inline BegunHeap put_begun_heap(Dealer& dealer, HeapPlaces& heaps, std::size_t kind, bool at_front) {
  const std::size_t points = dealer.begun(kind);
  if (points == 0) return {};
  const Place place = heaps.take(dealer, at_front);
  std::copy_n(dealer.heap(kind), 3 * points, heaps.at(place));
  return {place, points};
}

/// Iterates over the buckets of one kind: the full ones, then the partly filled ones of both threads.
class HeapsOfKind {
 public:
  HeapsOfKind(const HeapPlaces& places, std::span<const Place> full, const std::array<BegunHeap, 2>& begun)
      : places_(&places), full_(full), begun_(begun) {}
  /// The points of the next bucket; empty after the last one.
  std::span<float> next() {
    if (!full_.empty()) {
      const Place place = full_.front();
      full_ = full_.subspan(1);
      return {places_->at(place), kHeapFloats};
    }
    BegunHeap& begun = begun_[begun_[0].points == 0 ? 1 : 0];
    if (begun.points == 0) return {};
    const std::size_t points = std::exchange(begun.points, 0);
    return {places_->at(begun.place), 3 * points};
  }

 private:
  const HeapPlaces* places_;
  std::span<const Place> full_;
  std::array<BegunHeap, 2> begun_;
};

/// Iterates over the points of one kind, in the order of their buckets.
class PointsOfHeaps {
 public:
  explicit PointsOfHeaps(const HeapsOfKind& heaps) : heaps_(heaps) {}
  /// The next point, which must exist.
  float* next() {
    if (left_.empty()) left_ = heaps_.next();
    return std::exchange(left_, left_.subspan(3)).data();
  }

 private:
  HeapsOfKind heaps_;
  std::span<float> left_;
};

}  // namespace slabd::algo
