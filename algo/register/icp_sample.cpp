// SPDX-License-Identifier: Apache-2.0
//
// 65 536 points out of 60 MB are as many cache misses. So the places are drawn a row ahead and the memory is asked for
// them; it has them ready, many at a time, when they are collected. A row fills one cache line of each part, for the
// parts lie multiples of 4 KiB apart, and lines written bit by bit would push each other out of the cache.
#include "algo/register/icp_sample.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/prng.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kColumn = limits::kIcpPointsMax;
/// How far a slice is searched for a point that is there.
constexpr std::size_t kLooks = 16;
constexpr std::size_t kDrawBlocks = 16;
/// Slices drawn in one go: a cache line of each part and coordinate.
constexpr std::size_t kRow = 16 * kSampleParts;

IcpSample columns(std::span<float> memory, std::size_t count, const Vec3& shift) {
  return {memory.subspan(0, count), memory.subspan(kColumn, count), memory.subspan(2 * kColumn, count), shift};
}

bool is_point(const float* p) {
  return std::isfinite(p[0] + p[1] + p[2]);
}

/// Where the points of a row's slices are looked for; none where `first` is `last`.
struct PlacesOfRow {
  std::array<std::size_t, kRow> first, last;
};

/// Draws a place in each slice, slice by slice, and asks the memory for the points there.
class SlicePlaces {
 public:
  SlicePlaces(const Cloud& cloud, std::size_t slices, std::size_t slice, std::uint64_t seed)
      : cloud_(cloud),
        slices_(slices),
        slice_(slice),
        begin_(slice * cloud.points / slices),
        rest_(slice * cloud.points % slices),
        prng_(seed) {}

  void draw(PlacesOfRow& row) {
    const std::size_t whole = cloud_.points / slices_;
    const std::size_t more = cloud_.points % slices_;
    for (std::size_t k = 0; k < kRow; ++k, ++slice_) {
      row.first[k] = row.last[k] = 0;
      if (slice_ >= slices_) continue;
      // slice * points / slices without dividing: what is left over adds up to one more point now and then.
      rest_ += more;
      const std::size_t carry = rest_ >= slices_ ? 1 : 0;
      rest_ -= carry * slices_;
      const std::size_t end = begin_ + whole + carry;
      const std::size_t at = begin_ + (((prng_.next() >> 32U) * (end - begin_)) >> 32U);
      begin_ = end;
      row.first[k] = at;
      row.last[k] = std::min(end, at + kLooks);
      __builtin_prefetch(&cloud_.xyz[3 * at]);
      __builtin_prefetch(&cloud_.xyz[3 * at + 2]);
    }
  }

 private:
  const Cloud& cloud_;
  std::size_t slices_;
  std::size_t slice_;
  std::size_t begin_;  ///< of the slice, and what its division left over
  std::size_t rest_;
  Prng prng_;
};

/// Part by part.
struct PointsOfRow {
  using Part = std::array<float, kRow / kSampleParts>;
  std::array<Part, kSampleParts> x, y, z;
};

/// The first point there is at or behind each place, else NaN.
void collect(const Cloud& cloud, const PlacesOfRow& places, const std::array<float, 3>& from, PointsOfRow& to) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t k = 0; k < kRow; ++k) {
    const std::size_t part = k % kSampleParts;
    const std::size_t i = k / kSampleParts;
    std::size_t at = places.first[k];
    while (at < places.last[k] && !is_point(&cloud.xyz[3 * at])) ++at;
    const bool found = at < places.last[k];
    const float* p = found ? &cloud.xyz[3 * at] : nullptr;
    to.x[part][i] = found ? p[0] - from[0] : kNone;
    to.y[part][i] = found ? p[1] - from[1] : kNone;
    to.z[part][i] = found ? p[2] - from[2] : kNone;
  }
}

}  // namespace

IcpSample draw_sample(const Cloud& cloud, const Vec3& shift, std::span<float> memory, Team& team) {
  const std::size_t slices = std::min(cloud.points, limits::kIcpPointsMax);
  const std::size_t rows = (slices + kRow - 1) / kRow;
  const std::size_t per_part = rows * (kRow / kSampleParts);
  const Vec3 whole = shift.array().round();
  IcpSample sample = columns(memory, rows * kRow, whole);
  const std::array<float, 3> from = {static_cast<float>(whole.x()), static_cast<float>(whole.y()),
                                     static_cast<float>(whole.z())};
  team.run(kDrawBlocks, [&](std::size_t block) {
    const std::size_t end_row = (block + 1) * rows / kDrawBlocks;
    std::size_t row = block * rows / kDrawBlocks;
    if (row == end_row) return;
    SlicePlaces places(cloud, slices, row * kRow, 0x5eedU + block);
    std::array<PlacesOfRow, 2> ahead;
    places.draw(ahead[row % 2]);
    for (; row < end_row; ++row) {
      if (row + 1 < end_row) places.draw(ahead[(row + 1) % 2]);
      PointsOfRow points;
      collect(cloud, ahead[row % 2], from, points);
      for (std::size_t part = 0; part < kSampleParts; ++part) {
        const std::size_t to = part * per_part + row * (kRow / kSampleParts);
        std::copy(points.x[part].begin(), points.x[part].end(), &sample.x[to]);
        std::copy(points.y[part].begin(), points.y[part].end(), &sample.y[to]);
        std::copy(points.z[part].begin(), points.z[part].end(), &sample.z[to]);
      }
    }
  });
  return sample;
}

SliceOfScan slice_of(const Cloud& cloud, const IcpSample& sample, std::size_t i) {
  const std::size_t slices = std::min(cloud.points, limits::kIcpPointsMax);
  const std::size_t per_part = sample.size() / kSampleParts;
  const std::size_t slice = i % per_part * kSampleParts + i / per_part;
  const std::size_t first = slice * cloud.points / slices;
  const std::size_t end = std::min(cloud.points, (slice + 1) * cloud.points / slices);
  return {first, end - first};
}

IcpSample sort_by_face(const IcpSample& sample, const IcpView& view, std::span<float> memory,
                       std::span<std::uint8_t> keys, Team& team) {
  IcpSample sorted = columns(memory.subspan(3 * kColumn), sample.size(), sample.shift);
  team.run((sample.size() + kIcpBlock - 1) / kIcpBlock, [&](std::size_t block) {
    const std::size_t first = block * kIcpBlock;
    const std::size_t count = std::min(kIcpBlock, sample.size() - first);
    const std::span<std::uint8_t> key = keys.subspan(first, count);
    sort_keys(sample.part(first, count), view, key);
    std::array<std::uint32_t, 2 * kFaces + 2> start{};
    for (const std::uint8_t k : key) ++start[k + 1U];
    for (std::size_t k = 1; k < start.size(); ++k) start[k] += start[k - 1];
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t to = first + start[key[i]]++;
      sorted.x[to] = sample.x[first + i];
      sorted.y[to] = sample.y[first + i];
      sorted.z[to] = sample.z[first + i];
    }
  });
  return sorted;
}

}  // namespace slabd::algo
