// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "base/base.h"
#include "calib/ball/ball.h"

/// The parts of one ball's fit, for calib/ball/ball*.cpp.
namespace slabd::calib {

/// The cap as the fit used it. `u` are unit vectors from the centre, residuals |p - c| - R.
struct CapPoints {
  std::vector<Vec3> p_mm;             ///< scanner frame
  std::vector<double> incidence_rad;  ///< of the point's ray on the sphere; does not depend on the point's own depth
};

/// A robust least-squares sphere, radius fixed or free.
struct SphereFit {
  bool ok = false;  ///< converged, with enough points kept
  Vec3 centre_mm = Vec3::Zero();
  double radius_mm = kNoValue;
  double scale_mm = kNoValue;  ///< robust standard deviation of the residuals
  double rms_mm = kNoValue;    ///< of the points kept
  std::size_t kept = 0;
  int iterations = 0;
};

/// Tukey's biweight at 4.685 robust standard deviations, re-weighted until the centre moves less than 1e-8 mm. Starts
/// at `centre_mm`, `radius_mm`.
[[nodiscard]] SphereFit fit_sphere(std::span<const Vec3> points_mm, const Vec3& centre_mm, double radius_mm,
                                   bool free_radius);

/// Tukey's weight of a residual (psi / r) and the derivative of its psi.
struct TukeyWeight {
  double weight = 0.0;
  double slope = 0.0;
};
[[nodiscard]] TukeyWeight tukey(double residual_mm, double scale_mm);

/// Orthonormal axes across the direction from the ball to the viewpoint, which is the third.
[[nodiscard]] Mat3 view_axes(const Vec3& centre_mm, const Vec3& viewpoint_mm);

/// Covariances of a fit from its own residuals: what every point errs by itself, and what neighbours err in common.
/// Neighbourhood is distance across the view, where a scanner's errors hang together. `least_length_mm` > 0: all of the
/// scatter is taken to hang together over at least that length.
struct CapNoise {
  Mat3 cov_white_mm2 = Mat3::Constant(kNoValue);
  Mat3 cov_correlated_mm2 = Mat3::Constant(kNoValue);
  Vec3 shift_per_radius = Vec3::Constant(kNoValue);
  double radius_sigma_mm = kNoValue;  ///< of the radius, were it free
  double correlated_mm = kNoValue;
  double correlation_length_mm = kNoValue;
};
[[nodiscard]] CapNoise cap_noise(std::span<const Vec3> points_mm, const SphereFit& fit, const Vec3& viewpoint_mm,
                                 double least_length_mm);

/// Fits one ball to the points around a candidate (those within some millimetres of its sphere) and fills every figure
/// of the report; gates are judge_ball()'s. False: this is no sphere of anything like this radius.
[[nodiscard]] bool measure_ball(std::span<const Vec3> near_mm, const Vec3& start_mm, const BallSettings& settings,
                                BallReport& report);

/// Half the thickness of the shell around a candidate's sphere in which its points are looked for.
[[nodiscard]] double shell_mm(const BallSettings& settings);

/// Applies the gates to a measured ball: `refusal`, `failed` and `words`.
void judge_ball(const BallSettings& settings, BallReport& report);

/// Words for the refusals of a whole view. `extent_mm`: of the scan along its longest axis; `other_radius_mm`: of the
/// sphere that is there instead, NaN if none.
[[nodiscard]] BallWords words_not_found(const BallSettings& settings, double extent_mm, double other_radius_mm);
[[nodiscard]] BallWords words_too_many(const BallSettings& settings, std::size_t accepted);
[[nodiscard]] BallWords words_too_few(const BallSettings& settings, std::size_t accepted, const BallReport* refused);

}  // namespace slabd::calib
