// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "base/base.h"
#include "base/team.h"

/// What an ICP step asks of the sample, sixteen points at a time. A step needs no sum per point and unknown: all points
/// of a face have the same normal, so the sums of weights, distances and coordinates of each face say everything.
namespace slabd::algo {

/// Points as float columns relative to `shift` (scanner frame, whole millimetres, near the block), so that a float
/// holds them to 1e-5 mm. NaN: no point. The columns are as long as each other, a multiple of sixteen.
struct IcpSample {
  std::span<float> x, y, z;
  Vec3 shift = Vec3::Zero();
  [[nodiscard]] std::size_t size() const { return x.size(); }
  /// A part of it; `first` and `count` are multiples of sixteen.
  [[nodiscard]] IcpSample part(std::size_t first, std::size_t count) const {
    return {x.subspan(first, count), y.subspan(first, count), z.subspan(first, count), shift};
  }
};

/// Points of a block of work. Blocks are merged in their order, so the threads do not show in the result.
inline constexpr std::size_t kIcpBlock = 4096;
/// Of a point that takes no part.
inline constexpr std::uint8_t kNoFace = 255;

/// Sums over the points u (sample coordinates) of one face that take part. `w` weighs the normal matrix, `v` is what
/// each point pulls with: its distance times its weight.
struct FaceSums {
  enum : std::size_t { w, wx, wy, wz, wxx, wxy, wxz, wyy, wyz, wzz, v, vx, vy, vz, points, kCount };
  std::array<double, kCount> s{};
  void add(const FaceSums& other) {
    for (std::size_t k = 0; k < kCount; ++k) s[k] += other.s[k];
  }
};
using SumsOfFaces = std::array<FaceSums, kFaces>;

/// Distance of a point to a face: n.u + d.
struct Slope {
  Vec3 n = Vec3::Zero();
  double d = 0.0;
};
using Slopes = std::array<Slope, kFaces>;

/// How a pose explains points, overall and face by face; points whose surroundings show a single face vote for it.
struct FaceCounts {
  std::size_t in_field = 0;    ///< within the face table
  std::size_t near_model = 0;  ///< ... and within the gate of a face seen near there
  std::array<std::size_t, kFaces> expected{};
  std::array<std::size_t, kFaces> found{};
  std::array<double, kFaces> sum_mm{};
  std::array<double, kFaces> sum_mm2{};
  void add(const FaceCounts& other);
};

/// Where the points stand: a pose, the distances to all faces under it, and which faces are seen where.
struct IcpView {
  Mat3 R = Mat3::Identity();
  Vec3 t = Vec3::Zero();  ///< block frame <- sample coordinates: R u + t
  Slopes slopes{};
  std::span<const std::uint16_t> cells;  ///< faces by cell, limits::kFaceTableX * limits::kFaceTableY
};

/// Association of a part of the sample. `face`: kNoFace for points that take no part, `distance_mm` NaN then; `groups`:
/// bits of the faces in each sixteen points.
struct Association {
  std::span<std::uint8_t> face;
  std::span<float> distance_mm;
  std::span<std::uint16_t> groups;
  [[nodiscard]] Association part(std::size_t first, std::size_t count) const {
    return {face.subspan(first, count), distance_mm.subspan(first, count), groups.subspan(first / 16, count / 16)};
  }
};

/// Gives each point to the closest face seen around its place and sums up those within the gate (Tukey's weight).
/// For steps from afar: the distances are floats, good to 1e-4 mm.
void sum_closest(const IcpSample& points, const IcpView& view, double gate_mm, SumsOfFaces& sums);

/// Counts what the pose explains; where `to` is not empty, gives the points within the gate whose surroundings show a
/// single face to it, with distances as exact as the scan. At most kIcpBlock points.
void count_and_associate(const IcpSample& points, const IcpView& view, double gate_mm, const Association& to,
                         FaceCounts& counts);

/// Number of the face near each point's place, of several kFaces + the last one's, 2 * kFaces where none is: the order
/// that makes neighbours in the sample of one face.
void sort_keys(const IcpSample& points, const IcpView& view, std::span<std::uint8_t> keys);

enum class Weights : std::uint8_t {
  tukey,   ///< w = (1 - u^2)^2: re-weighted least squares, always downhill
  newton,  ///< w = (1 - u^2)(1 - 5 u^2), the true second derivative: quadratic at the end
  scatter  ///< w = (v - mean of its face)^2: what the noise does to the sums
};
/// Sums of the associated points within the gate. Their distances are those of the association and what the motion
/// since then adds (`moved`): small numbers, so floats do.
void sum_associated(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                    Weights weights, const std::array<double, kFaces>& means, SumsOfFaces& sums);

/// |distance| of the associated points; infinity for those that take no part.
void magnitudes(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                std::span<float> out);
/// How many are at most `limit`; sizes are multiples of sixteen.
std::size_t count_up_to(std::span<const float> values, float limit);

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
