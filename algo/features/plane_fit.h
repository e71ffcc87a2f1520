// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string_view>

#include "algo/algo.h"
#include "algo/features/face_points.h"
#include "algo/features/plane_steps.h"
#include "algo/features/seat_points.h"
#include "algo/moments.h"
#include "algo/points.h"

/// The plane fits behind `fit_plane` and `fit_plane_lsq`, over any set of points with `size()` and `[i]`. Instantiated
/// in plane_fit.cpp for std::span<const Vec3> and CloudPoints, so that millions of points need no copy.
namespace slabd::algo {

/// Start of a fit from a sample, before all points are read: the plane and the inlier distance.
struct PlaneStart {
  PlaneSample sample;
  PlaneSearch search;
  FlatPlane plane;
  double threshold_mm = 0.0;
  Vec3 shift = Vec3::Zero();  ///< origin of the sums
  bool found = false;
  bool doubtful = false;  ///< a second surface in the zone of a given threshold
};
template <typename Points>
void begin_fit(const Points& points, const Vec3& up, const PlaneSettings& settings, PlaneStart& start);
/// Refits on all points until the inlier set no longer changes, then tests for doubts. `points` may differ from those
/// of the start, but must be of the same surface.
template <typename Points>
[[nodiscard]] PlaneFit finish_fit(const Points& points, const PlaneSettings& settings, const PlaneStart& start);

/// Both steps.
template <typename Points>
[[nodiscard]] PlaneFit fit_plane_over(const Points& points, const Vec3& up, const PlaneSettings& settings);

/// The same, in one pass over the points (plane_zone.h).
[[nodiscard]] PlaneFit fit_plane_over(const ListedPoints& points, const Vec3& up, const PlaneSettings& settings,
                                      PlaneStart& start);
[[nodiscard]] PlaneFit fit_plane_over(const ListedPoints& points, const Vec3& up, const PlaneSettings& settings);

/// Refuses a plane that was ok so far.
inline void refuse(PlaneFit& fit, PlaneDoubt why) {
  if (fit.ok) fit.doubt = why;
  fit.ok = false;
}

/// Share of `fit`'s inliers with equal weight for every seen place, independent of its number of points: a share of the
/// points equals that of the area only if the density is uniform. `off`: points of each place that were not offered to
/// the fit; `points`: number of offered points. Computed from the sample, so accurate to a hundredth.
[[nodiscard]] double share_by_area(const PlaneStart& start, const PlaneFit& fit, const SeatFrame& frame,
                                   const FaceRaster& raster, const PlaceCounts& off, std::size_t points);

template <typename Points>
[[nodiscard]] PlaneFit fit_plane_lsq_over(const Points& points, const Vec3& up);

extern template PlaneFit fit_plane_over(const std::span<const Vec3>&, const Vec3&, const PlaneSettings&);
extern template PlaneFit fit_plane_over(const CloudPoints&, const Vec3&, const PlaneSettings&);
extern template void begin_fit(const ListedPoints&, const Vec3&, const PlaneSettings&, PlaneStart&);
extern template PlaneFit finish_fit(const SummedPoints&, const PlaneSettings&, const PlaneStart&);
extern template PlaneFit fit_plane_lsq_over(const std::span<const Vec3>&, const Vec3&);
extern template PlaneFit fit_plane_lsq_over(const CloudPoints&, const Vec3&);

/// Robust standard deviation of `abs_residuals` (infinities allowed): 1.4826 MAD over the trusted `share`, then the
/// same over the residuals within three of it, until it no longer decreases. Contamination inflates a plain MAD (at 50
/// % outliers it is the largest inlier); the iteration corrects this.
[[nodiscard]] double robust_sigma(std::span<const double> abs_residuals, double share);

}  // namespace slabd::algo
