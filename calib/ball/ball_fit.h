// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "base/base.h"
#include "calib/ball/ball.h"

/// Parts of one ball's fit, for calib/ball/ball*.cpp.
namespace slabd::calib {

/// Points of the cap used in the fit. `u` are unit vectors from the centre, residuals |p - c| - R.
struct CapPoints {
  std::vector<Vec3> p_mm;  ///< scanner frame
  /// Incidence of the point's ray on the sphere; independent of the point's own depth.
  std::vector<double> incidence_rad;
};

/// A robust least-squares sphere with fixed or free radius.
struct SphereFit {
  bool ok = false;  ///< converged, with enough points kept
  Vec3 centre_mm = Vec3::Zero();
  double radius_mm = kNoValue;
  double scale_mm = kNoValue;  ///< robust standard deviation of the residuals
  double rms_mm = kNoValue;    ///< of the kept points
  std::size_t kept = 0;
  int iterations = 0;
};

/// Fits with Tukey's biweight at 4.685 robust standard deviations, re-weighted until the centre moves less than 1e-8
/// mm. Starts at `centre_mm`, `radius_mm`.
[[nodiscard]] SphereFit fit_sphere(std::span<const Vec3> points_mm, const Vec3& centre_mm, double radius_mm,
                                   bool free_radius);

/// Tukey's weight of a residual (psi / r) and the derivative of its psi.
struct TukeyWeight {
  double weight = 0.0;
  double slope = 0.0;
};
[[nodiscard]] TukeyWeight tukey(double residual_mm, double scale_mm);

/// Orthonormal axes; the third points from the ball to the viewpoint.
[[nodiscard]] Mat3 view_axes(const Vec3& centre_mm, const Vec3& viewpoint_mm);

/// Covariances of a fit from its own residuals: independent errors of points, and correlated errors of neighbours.
/// Distance is measured across the view, where a scanner's errors are correlated. `least_length_mm` > 0: all of the
/// scatter is assumed to be correlated over at least that length.
struct CapNoise {
  Mat3 cov_white_mm2 = Mat3::Constant(kNoValue);
  Mat3 cov_correlated_mm2 = Mat3::Constant(kNoValue);
  Vec3 shift_per_radius = Vec3::Constant(kNoValue);
  double radius_sigma_mm = kNoValue;  ///< uncertainty of the radius if it were free
  double correlated_mm = kNoValue;
  double correlation_length_mm = kNoValue;
};
[[nodiscard]] CapNoise cap_noise(std::span<const Vec3> points_mm, const SphereFit& fit, const Vec3& viewpoint_mm,
                                 double least_length_mm);

/// Fits one ball to the points around a candidate (within a few millimetres of its sphere) and sets all figures of the
/// report. judge_ball() applies the gates. False if the points are not a sphere of roughly this radius.
[[nodiscard]] bool measure_ball(std::span<const Vec3> near_mm, const Vec3& start_mm, const BallSettings& settings,
                                BallReport& report);

/// Half the thickness of the shell around a candidate's sphere that is searched for its points.
[[nodiscard]] double shell_mm(const BallSettings& settings);

/// Applies the gates to a measured ball; sets `refusal`, `failed` and `words`.
void judge_ball(const BallSettings& settings, BallReport& report);

/// Texts for the refusals of a whole view. `extent_mm`: extent of the scan along its longest axis; `other_radius_mm`:
/// radius of a different sphere found instead, NaN if none.
[[nodiscard]] BallWords words_not_found(const BallSettings& settings, double extent_mm, double other_radius_mm);
[[nodiscard]] BallWords words_too_many(const BallSettings& settings, std::size_t accepted);
[[nodiscard]] BallWords words_too_few(const BallSettings& settings, std::size_t accepted, const BallReport* refused);

}  // namespace slabd::calib
