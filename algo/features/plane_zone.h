// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "algo/features/face_points.h"
#include "algo/features/plane_kernels.h"

/// The refits of a plane fit on listed points, without going over all of them each time.
namespace slabd::algo {

/// Sums over the points of `runs` that are at most `within_mm` (along h) from `tilt`. They are of h itself, so that the
/// same selection gives the same bits whatever `tilt` selected it.
[[nodiscard]] TiltedSums tilted_sums(std::span<const SeatPoints> runs, const Tilt& tilt, float within_mm);

/// Listed points, sorted by what any plane close to `tilt` makes of them: within the threshold (summed up), near where
/// the threshold cuts (kept one by one), beyond (forgotten). So such a plane finds exactly the points within its
/// threshold, from the few that are kept.
class ZonedPoints {
 public:
  /// One pass over `points`. False, and of no use, when the threshold is too fine for floats or too many points lie
  /// near where it cuts. 0.4 ns a point.
  [[nodiscard]] bool sort(const ListedPoints& points, const FlatPlane& plane, double threshold);

  [[nodiscard]] std::size_t size() const { return count_; }
  /// A plane further off than the zone allows was asked for: sort again, around a plane closer to it.
  [[nodiscard]] bool asked_beyond() const { return asked_beyond_; }

  /// Adds the points within `threshold` of `plane` to `moments`.
  void add_within(const FlatPlane& plane, double threshold, PointMoments& moments) const;

  /// Room for the points that are kept: five times what 400 000 points with normal noise need. What is not read is not
  /// written either, but for the last sixteen.
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
