// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "algo/algo.h"
#include "algo/moments.h"
#include "algo/points.h"

/// The plane fits behind `fit_plane` and `fit_plane_lsq`, over any set of points with `size()` and `[i]`. Defined in
/// plane.cpp for std::span<const Vec3> and CloudPoints, so that millions of points need no copy.
namespace slabd::algo {

template <typename Points>
[[nodiscard]] PlaneFit fit_plane_over(const Points& points, const Vec3& up, const PlaneSettings& settings);

template <typename Points>
[[nodiscard]] PlaneFit fit_plane_lsq_over(const Points& points, const Vec3& up);

extern template PlaneFit fit_plane_over(const std::span<const Vec3>&, const Vec3&, const PlaneSettings&);
extern template PlaneFit fit_plane_over(const CloudPoints&, const Vec3&, const PlaneSettings&);
extern template PlaneFit fit_plane_lsq_over(const std::span<const Vec3>&, const Vec3&);
extern template PlaneFit fit_plane_lsq_over(const CloudPoints&, const Vec3&);

/// Robust standard deviation of `abs_residuals` (re-ordered, infinities allowed): 1.4826 MAD over the `share` that is
/// trusted, then the same over what lies within three of it, until it no longer shrinks. Contamination inflates a
/// plain MAD (at 50 % outliers it is the largest inlier); the repetition takes that back.
[[nodiscard]] double robust_sigma(std::span<double> abs_residuals, double share);

}  // namespace slabd::algo
