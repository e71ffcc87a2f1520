// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/features/plane_kernels.h"
#include "algo/features/seat_points.h"
#include "algo/moments.h"
#include "algo/survey/survey_pass.h"

/// Points of a face from the survey, in the form read by the plane fits (plane_fit.h).
namespace slabd::algo {

/// Frame of any face that contains the rail's direction, like SeatFrame for the seat.
[[nodiscard]] inline SeatFrame frame_of(const Plane& face) {
  return {face.d * face.n, Vec3::UnitX(), face.n.cross(Vec3::UnitX()), face.n};
}

/// A list of points, in runs.
struct ListedPoints {
  SeatFrame frame;
  std::span<const SeatPoints> runs;
  std::size_t count = 0;

  [[nodiscard]] std::size_t size() const { return count; }
  struct Place {
    const SeatPoints* run;
    std::size_t k;  ///< index in the run
  };
  /// Fast for ascending `i`.
  [[nodiscard]] Place place_of(std::size_t i) const {
    if (i < run_start_) run_ = run_start_ = 0;
    while (i - run_start_ >= runs[run_].size()) run_start_ += runs[run_++].size();
    return {&runs[run_], i - run_start_};
  }
  /// The point in the block frame.
  [[nodiscard]] Vec3 at(const Place& place) const {
    const SeatPoints& run = *place.run;
    return frame.in_block(static_cast<double>(run.x[place.k]), static_cast<double>(run.s[place.k]),
                          static_cast<double>(run.h[place.k]));
  }
  [[nodiscard]] Vec3 operator[](std::size_t i) const { return at(place_of(i)); }

 private:
  mutable std::size_t run_ = 0;
  mutable std::size_t run_start_ = 0;
};

/// Prefetches a point for draw_sample: the lists are long and no longer in the cache.
[[nodiscard]] inline ListedPoints::Place ask_for_point(const ListedPoints& points, std::size_t i) {
  const ListedPoints::Place place = points.place_of(i);
  __builtin_prefetch(&place.run->x[place.k]);
  __builtin_prefetch(&place.run->s[place.k]);
  __builtin_prefetch(&place.run->h[place.k]);
  return place;
}
[[nodiscard]] inline Vec3 point_at(const ListedPoints& points, const ListedPoints::Place& place) {
  return points.at(place);
}

/// A large face. Points well within the threshold of the surveyed plane are summed, those near the threshold are
/// listed, and those beyond are only counted. So any plane close to that one gets exactly the points within the
/// threshold.
struct SummedPoints {
  SeatFrame frame;
  Tilt tilt;
  TiltedSums inner;
  std::span<const SeatPoints> edge;  ///< h: above `tilt`
  std::size_t count = 0;
  double slack_mm = 0.0;              ///< maximum distance, along h, of a plane from `tilt` over the face
  mutable bool asked_beyond = false;  ///< a plane further off was requested: survey again with it

  [[nodiscard]] std::size_t size() const { return count; }
};

/// `plane` as heights over the face; `stretch` converts a distance to a length along h.
struct LocalPlane {
  double a0, a1, a2, stretch;
  LocalPlane(const SeatFrame& frame, const FlatPlane& plane);
  [[nodiscard]] Tilt tilt() const { return {static_cast<float>(a0), static_cast<float>(a1), static_cast<float>(a2)}; }
};

/// Adds the sums in the frame of the face to `moments` of the block frame.
void add_tilted(const SeatFrame& frame, const Tilt& tilt, const TiltedSums& sums, PointMoments& moments);

/// Adds the points within `threshold` of `plane` to `moments`.
void add_within(const ListedPoints& points, const FlatPlane& plane, double threshold, PointMoments& moments);
void add_within(const SummedPoints& points, const FlatPlane& plane, double threshold, PointMoments& moments);

}  // namespace slabd::algo
