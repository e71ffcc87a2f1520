// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/points.h"

namespace slabd::algo {

/// Feature for which a point is used. `seat_off` is a point above or below the evaluation region, too far off
/// for its plane; `jaw_off_..` the same for a jaw. Over a casing's rim every point belongs to the casing, at
/// any height. Adjacent values are used together: off and crop for flatness, crop and rest for the full
/// plane.
enum class Region : std::uint8_t {
  none,
  seat_off,
  seat_crop,
  seat_rest,
  jaw_inner,
  jaw_outer,
  top,
  casing_inner,
  casing_outer,
  jaw_off_inner,
  jaw_off_outer,
};
inline constexpr std::size_t kRegions = 11;

/// One side of an edge: `sign` * distance to the plane of `edge` >= least.
struct EdgeRule {
  Face edge = Face::seat;
  double sign = 1.0;
  double least = 0.0;
  double per_off = 0.0;     ///< growth of that distance per mm off the face, along its normal ...
  double per_height = 0.0;  ///< ... and along z
};
/// A face, and the edges that bound it.
struct FaceRule {
  Face face = Face::seat;
  std::array<EdgeRule, 4> edges;
};
/// The rules as numbers, mm. Distances are those to the model's planes; s is measured along the seat.
struct RegionNumbers {
  double gate = 0.0;   ///< largest distance of a point from its face
  double depth = 0.0;  ///< search range of a layer or a hole along a jaw's normal: behind it the block ends
  double crop_half_x = 0.0;
  double crop_half_s = 0.0;
  FaceRule seat, jaw_inner, jaw_outer;
  std::array<EdgeRule, 4> around_block;  ///< a point of the slab top is outside one of them
  double casing_s = 0.0;
  double casing_clear = 0.0;  ///< radius of the area excluded from the seat
  double casing_reach = 0.0;  ///< radius of the area measured for the rim
};

/// Divides the space around the block by the model (paper 2.2): a point belongs to a face if it is within
/// registration_gate_mm of it and at least edge_margin_mm, measured on the face, away from every edge. Over the
/// evaluation region every point belongs to the seat, over a rim to the casing and over a jaw to the jaw, at any
/// height: objects at a feature's place must count as points that are not on it.
class RegionRules {
 public:
  void build(const BlockModel& model, const EvaluationSettings& settings);
  /// Region of a point in the block frame.
  [[nodiscard]] Region region_of(const Vec3& p) const;

  [[nodiscard]] const RegionNumbers& numbers() const { return n_; }

 private:
  [[nodiscard]] bool holds(const FaceRule& rule, const Vec3& p) const;
  [[nodiscard]] bool stands_over(const FaceRule& rule, const Vec3& p) const;

  std::array<Plane, kFaces> planes_;
  Vec3 along_ = Vec3::UnitY();
  RegionNumbers n_;
};

/// Indices of the cloud's points, grouped by region.
struct Segments {
  std::span<std::uint32_t> order;
  std::array<std::size_t, kRegions + 1> start{};

  [[nodiscard]] std::span<std::uint32_t> of(Region region) const {
    const auto r = static_cast<std::size_t>(region);
    return order.subspan(start[r], start[r + 1] - start[r]);
  }
  [[nodiscard]] std::span<std::uint32_t> full_seat() const { return with_next(Region::seat_crop); }
  [[nodiscard]] std::span<std::uint32_t> over_crop() const { return with_next(Region::seat_off); }

 private:
  [[nodiscard]] std::span<std::uint32_t> with_next(Region region) const {
    const auto r = static_cast<std::size_t>(region);
    return order.subspan(start[r], start[r + 2] - start[r]);
  }
};

/// Divides a registered cloud by RegionRules in the plain way; reference for tests of the survey. Points of no region
/// are left out of `order`. `label` and `order` need an entry per point. O(points).
[[nodiscard]] Segments segment(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                               const FastTransform& T_block_scanner, std::span<std::uint8_t> label,
                               std::span<std::uint32_t> order);

/// Visible extent of a face from above, without edge margins.
struct FaceExtent {
  double area_mm2 = 0.0;  ///< in the projection on (x, y), as a scan from above samples it
  double wide_mm = 0.0;   ///< standard deviations on the face, along its principal directions
  double narrow_mm = 0.0;
};
struct FaceExtents {
  FaceExtent seat_crop;
  FaceExtent full_seat;
  FaceExtent jaw_inner;
  FaceExtent jaw_outer;
  FaceExtent top;  ///< up to the limits of the face table
};

/// Samples the model on a raster. No heap, about 10 ms.
[[nodiscard]] FaceExtents face_extents(const BlockModel& model, const EvaluationSettings& settings);

}  // namespace slabd::algo
