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

/// Kernels of an ICP step over the sample, sixteen points at a time. A step needs no sum per point and unknown: all
/// points of a face have the same normal, so the sums of weights, distances and coordinates per face are sufficient.
namespace slabd::algo {

/// Points as float columns relative to `shift` (scanner frame, whole millimetres, near the block), so that a float
/// resolves 1e-5 mm. NaN marks a missing point. The columns have the same length, a multiple of sixteen.
struct IcpSample {
  std::span<float> x, y, z;
  Vec3 shift = Vec3::Zero();
  [[nodiscard]] std::size_t size() const { return x.size(); }
  /// A part of the sample; `first` and `count` are multiples of sixteen.
  [[nodiscard]] IcpSample part(std::size_t first, std::size_t count) const {
    return {x.subspan(first, count), y.subspan(first, count), z.subspan(first, count), shift};
  }
};

/// Points of a block of work. Blocks are merged in their order, so the result does not depend on the threads.
inline constexpr std::size_t kIcpBlock = 4096;
/// Face number of a point that is not used.
inline constexpr std::uint8_t kNoFace = 255;

/// Sums over the used points u (sample coordinates) of one face. `w` is the weight in the normal matrix, `v` the weight
/// in the gradient: the distance times its weight.
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

/// Counts of the points explained by a pose, overall and per face. Points with a single face around them count for it.
struct FaceCounts {
  std::size_t in_field = 0;    ///< within the face table
  std::size_t near_model = 0;  ///< ... and within the gate of a face visible near there
  std::array<std::size_t, kFaces> expected{};
  std::array<std::size_t, kFaces> found{};
  std::array<double, kFaces> sum_mm{};
  std::array<double, kFaces> sum_mm2{};
  void add(const FaceCounts& other);
};

/// Position of the points: a pose, the distances to all faces under it, and the visible faces per cell.
struct IcpView {
  Mat3 R = Mat3::Identity();
  Vec3 t = Vec3::Zero();  ///< block frame <- sample coordinates: R u + t
  Slopes slopes{};
  std::span<const std::uint16_t> cells;  ///< faces by cell, limits::kFaceTableX * limits::kFaceTableY
};

/// Association of a part of the sample. `face`: kNoFace for unused points, whose `distance_mm` is NaN; `groups`: bits
/// of the faces in each sixteen points.
struct Association {
  std::span<std::uint8_t> face;
  std::span<float> distance_mm;
  std::span<std::uint16_t> groups;
  [[nodiscard]] Association part(std::size_t first, std::size_t count) const {
    return {face.subspan(first, count), distance_mm.subspan(first, count), groups.subspan(first / 16, count / 16)};
  }
};

/// Associates each point with the closest face visible around it and sums those within the gate (Tukey's weight). For
/// steps from afar: the distances are floats, accurate to 1e-4 mm.
void sum_closest(const IcpSample& points, const IcpView& view, double gate_mm, SumsOfFaces& sums);

/// Counts the points explained by the pose. If `to` is not empty, associates the points within the gate that have a
/// single face around them, with distances as accurate as the scan. At most kIcpBlock points.
void count_and_associate(const IcpSample& points, const IcpView& view, double gate_mm, const Association& to,
                         FaceCounts& counts);

/// Sort key of each point: number of the face near it; kFaces + the last number if there are several, 2 * kFaces for
/// none. In this order neighbours in the sample belong to one face.
void sort_keys(const IcpSample& points, const IcpView& view, std::span<std::uint8_t> keys);

enum class Weights : std::uint8_t {
  tukey,   ///< w = (1 - u^2)^2: re-weighted least squares, always downhill
  newton,  ///< w = (1 - u^2)(1 - 5 u^2), the true second derivative: quadratic convergence near the end
  scatter  ///< w = (v - mean of its face)^2: effect of the noise on the sums
};
/// Sums the associated points within the gate. Their distances are those of the association plus the effect of the
/// motion since then (`moved`): small numbers, so floats are accurate enough.
void sum_associated(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                    Weights weights, const std::array<double, kFaces>& means, SumsOfFaces& sums);

/// |distance| of the associated points; infinity for unused ones.
void magnitudes(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                std::span<float> out);
/// Number of values that are at most `limit`; sizes are multiples of sixteen.
std::size_t count_up_to(std::span<const float> values, float limit);

/// Parts of the sample, each covering the whole scan; the coarse steps use the first one.
inline constexpr std::size_t kSampleParts = 8;
inline constexpr std::size_t kSampleFloats = 6 * limits::kIcpPointsMax;

/// Draws one point from each of equal slices of the scan: even coverage, no aliasing with the scan lines. Slice i goes
/// to part i % kSampleParts; NaN if it has no point near the drawn index. `shift`: approximate position of the block in
/// the scanner frame. `memory`: kSampleFloats. A few tenths of a millisecond, for the scan's cache misses.
[[nodiscard]] IcpSample draw_sample(const Cloud& cloud, const Vec3& shift, std::span<float> memory, Team& team);

/// Index range in the cloud that contains a point of a drawn sample (not of a sorted one).
struct SliceOfScan {
  std::size_t first = 0;
  std::size_t points = 0;
};
[[nodiscard]] SliceOfScan slice_of(const Cloud& cloud, const IcpSample& sample, std::size_t i);

/// Sorts each block of the sample by the face near its points under `view` (`memory` of draw_sample). It makes
/// neighbours of one face likely, but no result depends on it. `keys`: a byte per point.
[[nodiscard]] IcpSample sort_by_face(const IcpSample& sample, const IcpView& view, std::span<float> memory,
                                     std::span<std::uint8_t> keys, Team& team);

}  // namespace slabd::algo
