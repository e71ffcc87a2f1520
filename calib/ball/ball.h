// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "base/base.h"

/// Centre of a tooling ball from one raw scan. The scan contains a cap of the ball among table, post, walls and other
/// balls. The radius is fixed at its certified effective value (of the coated ball). White noise then limits the centre
/// to a micrometre, and correlated errors of neighbouring points to about 10 um. With a free radius the centre is
/// several times worse along the view, so that fit is only a check.
///
/// A wrong radius moves every centre along the view by the same amount, and no residual of a later calibration shows
/// it. Therefore a ball is accepted only if it passes every gate, and a report is not ok by default.
namespace slabd::calib {

struct BallSettings {
  double radius_mm = kNoValue;     ///< certified, effective; 1..200 mm
  double radius_sigma_mm = 0.003;  ///< standard uncertainty of the radius (k = 1)
  int count = 1;                   ///< number of balls of this radius in view, 1..16; more or fewer are rejected
  double noise_mm = 0.05;          ///< expected standard deviation of the scanner's points along their rays
  /// Smallest correlation length to assume for the points' errors; 0: as measured in the scan.
  double noise_correlation_mm = 0;
  Vec3 viewpoint_mm = Vec3::Zero();  ///< origin of the rays, scanner frame; (0, 0, -1e9) for parallel rays

  // Selection of points.
  double incidence_max_rad = rad_from_deg(60.0);  ///< between ray and surface normal
  double rim_mm = 1.5;  ///< excluded width next to an edge of the visible part, because of mixed points

  // Gates.
  double half_angle_min_rad = rad_from_deg(50.0);  ///< half angle of the cap
  double azimuth_min_rad = rad_from_deg(300.0);    ///< visible part of the cap's edge, in sectors of 10 degrees
  std::uint64_t points_min = 3000;
  double rms_max = 1.5;          ///< in multiples of noise_mm
  double radius_off_mm = 0.05;   ///< |free radius - radius|
  double kept_share_min = 0.9;   ///< share of the cap's points kept by the robust fit
  double repeat_max_mm = 0.010;  ///< standard deviation per axis of the centres of repeated shots
};

/// Reason why a ball, a view or a set of shots is not used. Only `none` is ok.
enum class BallRefusal : std::uint8_t {
  none,
  not_looked_at,  ///< also the value of zeroed memory
  no_points,      ///< the scan has no finite points
  not_found,      ///< no sphere of about this radius
  too_many,       ///< more balls of this radius than expected, so the right one is unknown
  too_few,        ///< fewer accepted balls than expected
  few_points,
  small_cap,
  azimuth,   ///< a side of the cap is hidden or cut off
  unstable,  ///< the robust fit did not converge
  noisy,     ///< residuals are larger than the scanner's noise
  spoiled,   ///< too many points off the sphere: dirt, a second surface, a damaged ball
  radius,    ///< a sphere with another radius
  repeat,    ///< shots of one view do not agree
};
[[nodiscard]] std::string_view name(BallRefusal refusal);

/// Description of the failure with figures, and its remedy. Both empty for `none`.
struct BallWords {
  FixedString<limits::kErrorTextBytes> reason;
  FixedString<limits::kErrorTextBytes> cure;
};

/// One ball in one scan, with all figures; a rejected one has the figures determined so far (else NaN).
struct BallReport {
  BallRefusal refusal = BallRefusal::not_looked_at;  ///< the first gate that failed
  FixedVector<BallRefusal, 8> failed;                ///< all failed gates
  BallWords words;                                   ///< texts of the first failed gate

  Vec3 centre_mm = Vec3::Constant(kNoValue);  ///< scanner frame
  /// Covariances of the centre, scanner axes: from independent errors of the points, and from the correlated errors of
  /// neighbours (estimated from the residuals). The second part is larger, and repeated shots do not reduce it.
  Mat3 cov_white_mm2 = Mat3::Constant(kNoValue);
  Mat3 cov_correlated_mm2 = Mat3::Constant(kNoValue);
  /// Shift of the centre per mm by which the certified radius is too large: along the view, about 1 to 1.4. It is the
  /// same in every view, so neither averaging nor residuals remove it.
  Vec3 shift_per_radius = Vec3::Constant(kNoValue);

  std::uint64_t points_near = 0;           ///< on the sphere within the search gate, at any incidence
  std::uint64_t points_offered = 0;        ///< of these, inside the incidence limit and the rim
  std::uint64_t points_used = 0;           ///< of these, with weight in the robust fit
  double half_angle_rad = kNoValue;        ///< half angle of the cap used: median over the visible sectors
  double azimuth_rad = kNoValue;           ///< sum of the sectors that reach within 10 degrees of the half-angle gate
  double rms_mm = kNoValue;                ///< radial residuals of the used points
  double kept_share = kNoValue;            ///< used / offered
  double radius_free_mm = kNoValue;        ///< from the fit with free radius, as a check
  double radius_free_sigma_mm = kNoValue;  ///< including correlated noise
  Vec3 centre_free_mm = Vec3::Constant(kNoValue);
  double correlated_mm = kNoValue;          ///< standard deviation of the correlated error of neighbouring points
  double correlation_length_mm = kNoValue;  ///< distance at which the correlation has fallen to 1/e
  Vec3 missing_side = Vec3::Zero();         ///< unit vector towards the missing sectors, or zero
  bool converged = false;
  int iterations = 0;

  [[nodiscard]] bool ok() const { return refusal == BallRefusal::none; }
  /// Random part: white and correlated.
  [[nodiscard]] Mat3 cov_mm2() const { return cov_white_mm2 + cov_correlated_mm2; }
};

/// All balls of one scan. If rejected (not_found, too_few, too_many), `balls` still contains the reports of the
/// examined ones, best first.
struct BallView {
  BallRefusal refusal = BallRefusal::not_looked_at;
  BallWords words;
  std::uint64_t points = 0;
  std::uint64_t finite = 0;
  std::vector<BallReport> balls;  ///< accepted ones first, each group by decreasing points_used

  [[nodiscard]] bool ok() const { return refusal == BallRefusal::none; }
};

/// Finds the balls in a scan. `xyz` contains 3 floats per point (mm, scanner frame, NaN = missing), in any order, at
/// most limits::kScanPointsMax points. config: settings out of range, or a length that is not a multiple of 3. Faults
/// of the scan itself are refusals with texts, not errors. The same scan gives the same bits. About 0.3 s of one core
/// and 40 MB for 5 million points.
[[nodiscard]] Result<BallView> find_balls(std::span<const float> xyz, const BallSettings& settings);

/// One view from repeated shots at one pose (usually three).
struct BallShots {
  BallRefusal refusal = BallRefusal::not_looked_at;
  BallWords words;
  int shots = 0;
  Vec3 centre_mm = Vec3::Constant(kNoValue);  ///< mean of the shots
  /// Covariance of the mean. The white part decreases with the number of shots; the correlated part depends on scanner
  /// and place, and does not.
  Mat3 cov_mm2 = Mat3::Constant(kNoValue);
  double repeat_mm = kNoValue;  ///< standard deviation of one shot per axis; NaN for a single shot
  int worst_shot = 0;           ///< shot farthest from the mean, 1, 2, ...

  [[nodiscard]] bool ok() const { return refusal == BallRefusal::none; }
};

/// Averages the shots. Rejected if any shot is (with its text and number), or if they scatter by more than
/// `settings.repeat_max_mm`. An empty span is rejected.
[[nodiscard]] BallShots average_shots(std::span<const BallReport> shots, const BallSettings& settings);

/// Check of the radius. A wrong radius moves every centre along the view, and with it the scanner on the flange.
/// Neither residuals nor a repeated calibration reveal this error, but the free radius of many views does.
struct RadiusCheck {
  int views = 0;               ///< number of accepted views with a free radius
  double mean_mm = kNoValue;   ///< mean free radius; NaN below two views
  double sigma_mm = kNoValue;  ///< uncertainty of the mean, from the scatter of the views
  double shift_mm = kNoValue;  ///< shift of the centres towards the scanner (-) or away (+), if the mean is right
  bool suspicious = false;
  bool covered = false;  ///< suspicious, but within the certificate's own uncertainty (k = 2)
  BallWords words;       ///< set if suspicious
};

/// Checks the certified radius. Suspicious if there are at least five views and their mean differs by more than three
/// of its own sigmas and 0.01 mm. An uncertain certificate does not change that, because the scans are then more
/// accurate.
[[nodiscard]] RadiusCheck check_radius(std::span<const BallReport> balls, const BallSettings& settings);
/// Shift of a centre along the view per mm of radius error, for a cap of this half angle.
[[nodiscard]] double shift_per_radius(double half_angle_rad);

}  // namespace slabd::calib
