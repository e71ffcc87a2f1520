// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/register/icp_kernels.h"
#include "base/team.h"

namespace slabd::algo {

/// Parts of the sample that each look at the whole scan: the first one serves the coarse steps.
inline constexpr std::size_t kSampleParts = 8;
inline constexpr std::size_t kSampleFloats = 6 * limits::kIcpPointsMax;

/// One point from each of equal slices of the scan: even coverage, no aliasing with the scan lines. Slice i goes to
/// part i % kSampleParts. A slice without a point near the place drawn gives NaN. `shift`: roughly where the block is
/// in the scanner frame. `memory`: kSampleFloats. A few tenths of a millisecond, for the scan's cache misses.
[[nodiscard]] IcpSample draw_sample(const Cloud& cloud, const Vec3& shift, std::span<float> memory, Team& team);

/// Where a point of a drawn sample (not of a sorted one) lies in the cloud: somewhere in this stretch.
struct SliceOfScan {
  std::size_t first = 0;
  std::size_t points = 0;
};
[[nodiscard]] SliceOfScan slice_of(const Cloud& cloud, const IcpSample& sample, std::size_t i);

/// Sorts each block of the sample by the face its points are near under `view` (block's `memory` as drawn). Only makes
/// neighbours of one face likely: nothing relies on it. `keys`: a byte per point.
[[nodiscard]] IcpSample sort_by_face(const IcpSample& sample, const IcpView& view, std::span<float> memory,
                                     std::span<std::uint8_t> keys, Team& team);

}  // namespace slabd::algo
