// SPDX-License-Identifier: Apache-2.0
//
// Buckets of points of one kind each, for algo/denoise/lattice_order.cpp: many small arrays in little memory.
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
inline constexpr std::size_t kBucketPoints = 64;
inline constexpr std::size_t kBucketFloats = 3 * kBucketPoints;
inline constexpr std::size_t kBucketBytes = kBucketPoints * kPointBytes;
/// Maximum number of kinds of points.
inline constexpr std::size_t kKindsMax = 255;

/// Points are scattered in blocks of kBlockBuckets buckets. A block starts when the one kBlocksAtOnce before it is
/// done.
inline constexpr std::size_t kBlockBuckets = 64;
inline constexpr std::size_t kBlock = kBlockBuckets * kBucketPoints;
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
struct Scatter {
  /// A bucket of each kind begins at multiples of this. The bytes between buckets are overwritten, because points are
  /// moved sixteen bytes at a time.
  static constexpr std::size_t kStride = 1'024;

  std::array<std::byte, kStride * kKindsMax> buckets;
  std::array<std::uint32_t, kKindsMax> next;  ///< byte offset in `buckets` of each kind's next point
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
  [[nodiscard]] const float* bucket(std::size_t kind) const {
    return reinterpret_cast<const float*>(buckets.data() + kStride * kind);
  }
  [[nodiscard]] std::size_t points(std::size_t kind) const { return kBucketPoints * full[kind] + begun(kind); }
};

/// Places for buckets, and the kind of bucket in each. "Kept" places are in free memory, "front" places over points at
/// the front of the cloud that have been read.
///
/// Invariant: every bucket has a place. The buckets hold at most the points read, and the front has as many places as
/// the completed blocks. So only the buckets of the last kBlocksAtOnce blocks need other places, which spare() covers.
class BucketPlaces {
 public:
  /// Kept places beyond those for the intended points: for partly filled buckets, and for full buckets while the front
  /// has no free place.
  static constexpr std::size_t spare(std::size_t kinds) {
    return 2 * kinds + kBlocksAtOnce * kBlockBuckets + 5 * kPlaceRun;
  }

  BucketPlaces(float* front, std::array<std::span<float>, 3> kept) : front_(front), kept_(kept) {}

  /// Sets the number of usable kept and front places; `kinds` has an entry for each.
  void use(std::size_t kept, std::size_t front, std::uint8_t* kinds) {
    kept_max_ = kept;
    front_max_ = front;
    kinds_ = kinds;
    std::fill_n(kinds, kept + front, kNothing);
  }
  [[nodiscard]] std::size_t kept_room() const {
    std::size_t buckets = 0;
    for (const std::span<float>& piece : kept_) buckets += piece.size() / kBucketFloats;
    return buckets;
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
  [[nodiscard]] Place take(Scatter& scatter, bool at_front) {
    if (at_front && (any(scatter.front) || reserve_front(scatter))) return front_place(scatter);
    if (any(scatter.kept) || reserve_kept(scatter)) return static_cast<Place>(scatter.kept.next++);
    overfull_.store(true, std::memory_order_relaxed);
    if (!any(scatter.front)) reserve_front(scatter);
    return front_place(scatter);
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
    std::size_t bucket = place;
    if (bucket >= kept_max_) return front_ + kBucketFloats * (bucket - kept_max_);
    std::size_t piece = 0;
    for (; bucket >= kept_[piece].size() / kBucketFloats; ++piece) bucket -= kept_[piece].size() / kBucketFloats;
    return kept_[piece].data() + kBucketFloats * bucket;
  }
  [[nodiscard]] bool overfull() const { return overfull_.load(std::memory_order_relaxed); }
  /// Number of taken kept places, including those reserved by a scatter.
  [[nodiscard]] std::size_t kept_taken() const { return std::min(kept_max_, kept_taken_.load()); }
  [[nodiscard]] std::size_t kept_left() const { return kept_max_ - kept_taken(); }
  [[nodiscard]] std::size_t front_taken() const { return front_taken_.load(); }
  [[nodiscard]] Place first_at_front() const { return static_cast<Place>(kept_max_); }

 private:
  static constexpr std::uint8_t kNothing = 0xFF;
  static_assert(kKindsMax <= kNothing);

  static bool any(const PlaceRun& run) { return run.next != run.end; }
  Place front_place(Scatter& scatter) { return static_cast<Place>(kept_max_ + scatter.front.next++); }

  bool reserve_kept(Scatter& scatter) {
    const std::size_t first = kept_taken_.fetch_add(kPlaceRun, std::memory_order_relaxed);
    if (first >= kept_max_) return false;
    scatter.kept = {first, std::min(kept_max_, first + kPlaceRun)};
    return true;
  }
  bool reserve_front(Scatter& scatter) {
    std::size_t first = front_taken_.load(std::memory_order_relaxed);
    do {
      if (!overfull() && first + kPlaceRun > front_max_) return false;
      while (first + kPlaceRun > scatter.blocks_done * kBlockBuckets) {
        if (!done_[scatter.blocks_done].load(std::memory_order_acquire)) return false;
        ++scatter.blocks_done;
      }
    } while (!front_taken_.compare_exchange_weak(first, first + kPlaceRun, std::memory_order_relaxed));
    scatter.front = {first, first + kPlaceRun};
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
struct PartialBucket {
  Place place = 0;
  std::size_t points = 0;
};
/// Stores a thread's partly filled bucket of a kind.
inline PartialBucket put_partial_bucket(Scatter& scatter, BucketPlaces& buckets, std::size_t kind, bool at_front) {
  const std::size_t points = scatter.begun(kind);
  if (points == 0) return {};
  const Place place = buckets.take(scatter, at_front);
  std::copy_n(scatter.bucket(kind), 3 * points, buckets.at(place));
  return {place, points};
}

/// Iterates over the buckets of one kind: the full ones, then the partly filled ones of both threads.
class BucketsOfKind {
 public:
  BucketsOfKind(const BucketPlaces& places, std::span<const Place> full, const std::array<PartialBucket, 2>& begun)
      : places_(&places), full_(full), begun_(begun) {}
  /// The points of the next bucket; empty after the last one.
  std::span<float> next() {
    if (!full_.empty()) {
      const Place place = full_.front();
      full_ = full_.subspan(1);
      return {places_->at(place), kBucketFloats};
    }
    PartialBucket& begun = begun_[begun_[0].points == 0 ? 1 : 0];
    if (begun.points == 0) return {};
    const std::size_t points = std::exchange(begun.points, 0);
    return {places_->at(begun.place), 3 * points};
  }

 private:
  const BucketPlaces* places_;
  std::span<const Place> full_;
  std::array<PartialBucket, 2> begun_;
};

/// Iterates over the points of one kind, in the order of their buckets.
class PointsOfBuckets {
 public:
  explicit PointsOfBuckets(const BucketsOfKind& buckets) : buckets_(buckets) {}
  /// The next point, which must exist.
  float* next() {
    if (left_.empty()) left_ = buckets_.next();
    return std::exchange(left_, left_.subspan(3)).data();
  }

 private:
  BucketsOfKind buckets_;
  std::span<float> left_;
};

}  // namespace slabd::algo
