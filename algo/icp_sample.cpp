// SPDX-License-Identifier: Apache-2.0
#include "algo/icp_sample.h"

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

IcpSample columns(std::span<float> memory, std::size_t count, const Vec3& shift) {
  return {memory.subspan(0, count), memory.subspan(kColumn, count), memory.subspan(2 * kColumn, count), shift};
}

bool is_point(const float* p) {
  return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

}  // namespace

IcpSample draw_sample(const Cloud& cloud, const Vec3& shift, std::span<float> memory, Team& team) {
  const std::size_t slices = std::min(cloud.points, limits::kIcpPointsMax);
  const std::size_t per_part = (slices + 16 * kSampleParts - 1) / (16 * kSampleParts) * 16;
  const Vec3 whole = shift.array().round();
  const IcpSample sample = columns(memory, per_part * kSampleParts, whole);
  const std::array<float, 3> from = {static_cast<float>(whole.x()), static_cast<float>(whole.y()),
                                     static_cast<float>(whole.z())};
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  const std::size_t padded = sample.size();
  team.run(kDrawBlocks, [&](std::size_t block) {
    Prng prng(0x5eedU + block);
    for (std::size_t i = block * padded / kDrawBlocks; i < (block + 1) * padded / kDrawBlocks; ++i) {
      const std::size_t to = i % kSampleParts * per_part + i / kSampleParts;
      sample.x[to] = sample.y[to] = sample.z[to] = kNone;
      if (i >= slices) continue;
      const std::size_t first = i * cloud.points / slices;
      const std::size_t last = (i + 1) * cloud.points / slices;
      std::size_t at = first + (((prng.next() >> 32U) * (last - first)) >> 32U);
      const std::size_t end = std::min(last, at + kLooks);
      while (at < end && !is_point(&cloud.xyz[3 * at])) ++at;
      if (at == end) continue;
      sample.x[to] = cloud.xyz[3 * at] - from[0];
      sample.y[to] = cloud.xyz[3 * at + 1] - from[1];
      sample.z[to] = cloud.xyz[3 * at + 2] - from[2];
    }
  });
  return sample;
}

IcpSample sort_by_face(const IcpSample& sample, const IcpView& view, std::span<float> memory,
                       std::span<std::uint8_t> keys, Team& team) {
  const IcpSample sorted = columns(memory.subspan(3 * kColumn), sample.size(), sample.shift);
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
