// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "algo/features/face_points.h"
#include "algo/features/plane_kernels.h"

/// The refits of a plane fit on listed points, without reading all of them each time.
namespace slabd::algo {

/// Sums over the points of `runs` that are at most `within_mm` (along h) from `tilt`. The sums are of h itself, so that
/// the same selection has the same bits with any `tilt`.
[[nodiscard]] TiltedSums tilted_sums(std::span<const SeatPoints> runs, const Tilt& tilt, float within_mm);

/// Listed points, classified for planes close to `tilt`: within the threshold (summed), near the threshold (kept one
/// by one), or beyond (dropped). So such a plane gets exactly the points within its threshold, from the few points
/// kept.
class ZonedPoints {
 public:
  /// Classifies `points` in one pass. False, without a usable result, if the threshold is too fine for floats or too
  /// many points are near it. 0.4 ns a point.
  [[nodiscard]] bool sort(const ListedPoints& points, const FlatPlane& plane, double threshold);

  [[nodiscard]] std::size_t size() const { return count_; }
  /// True if a plane beyond the limits of the zone was requested: sort again, around a plane closer to it.
  [[nodiscard]] bool asked_beyond() const { return asked_beyond_; }

  /// Adds the points within `threshold` of `plane` to `moments`.
  void add_within(const FlatPlane& plane, double threshold, PointMoments& moments) const;

  /// Capacity for kept points: five times the need of 400 000 points with normal noise. Unused memory is not written,
  /// except for the last sixteen.
  static constexpr std::size_t kEdgeMax = 8192;
  struct Edge {
    std::array<float, kEdgeMax + 16> u;
    std::array<float, kEdgeMax + 16> v;
    std::array<float, kEdgeMax + 16> r;  ///< above `tilt`
    std::size_t count = 0;
  };
  struct Box {
    float u_low, u_high, v_low, v_high;
  };

 private:
  SeatFrame frame_;
  Tilt tilt_;
  TiltedSums inner_;
  Edge edge_;
  Box box_{};
  std::size_t count_ = 0;
  double slack_mm_ = 0.0;
  mutable bool asked_beyond_ = false;
};

inline void add_within(const ZonedPoints& points, const FlatPlane& plane, double threshold, PointMoments& moments) {
  points.add_within(plane, threshold, moments);
}

}  // namespace slabd::algo
