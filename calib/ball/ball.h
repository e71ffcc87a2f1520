// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "base/base.h"

/// Where the centre of a tooling ball is, from one raw scan of it. The scanner sees a cap of the ball among table,
/// post, walls and other balls. With the radius held at its certified effective value (of the ball as coated) the
/// centre is known to a micrometre from white noise and to about 10 um from what neighbouring points err in common; a
/// free radius is several times worse along the view and serves as a check only.
///
/// A wrong radius moves every centre along the view by the same amount, and no residual of a later calibration can show
/// it. So a ball is accepted only when it passes every gate, and a report never says ok by default.
namespace slabd::calib {

struct BallSettings {
  double radius_mm = kNoValue;       ///< certified, effective; 1..200 mm
  double radius_sigma_mm = 0.003;    ///< standard uncertainty of it (k = 1)
  int count = 1;                     ///< balls of this radius in view, 1..16; more or fewer are refused
  double noise_mm = 0.05;            ///< expected standard deviation of the scanner's points along their rays
  double noise_correlation_mm = 0;   ///< least length over which they are taken to err in common; 0 = as the scan shows
  Vec3 viewpoint_mm = Vec3::Zero();  ///< where the rays come from, scanner frame; (0, 0, -1e9) for parallel rays

  // Which points count.
  double incidence_max_rad = rad_from_deg(60.0);  ///< between ray and surface normal
  double rim_mm = 1.5;                            ///< next to an edge of what is seen: mixed points

  // Gates.
  double half_angle_min_rad = rad_from_deg(50.0);  ///< of the cap
  double azimuth_min_rad = rad_from_deg(300.0);    ///< of the cap's edge that must be seen, in sectors of 10 degrees
  std::uint64_t points_min = 3000;
  double rms_max = 1.5;          ///< times noise_mm
  double radius_off_mm = 0.05;   ///< |free radius - radius|
  double kept_share_min = 0.9;   ///< of the cap's points that the robust fit keeps
  double repeat_max_mm = 0.010;  ///< standard deviation per axis of the centres of repeated shots
};

/// Why a ball, a view or a set of shots is not used. `none` is the only ok.
enum class BallRefusal : std::uint8_t {
  none,
  not_looked_at,  ///< zeroed memory
  no_points,      ///< nothing finite in the scan
  not_found,      ///< no sphere of about this radius
  too_many,       ///< more balls of this radius than expected: which one is meant is not known
  too_few,        ///< fewer balls than expected passed
  few_points,
  small_cap,
  azimuth,   ///< a side of the cap is hidden or cut off
  unstable,  ///< the robust fit found no resting place
  noisy,     ///< residuals larger than the scanner's noise
  spoiled,   ///< too many points off the sphere: dirt, a second surface, a damaged ball
  radius,    ///< a sphere, but of another radius
  repeat,    ///< shots of one view do not agree
};
[[nodiscard]] std::string_view name(BallRefusal refusal);

/// What happened, with figures, and what to do about it. Both empty for `none`.
struct BallWords {
  FixedString<limits::kErrorTextBytes> reason;
  FixedString<limits::kErrorTextBytes> cure;
};

/// One ball in one scan: every figure, also of a refused one as far as it was determined (else NaN).
struct BallReport {
  BallRefusal refusal = BallRefusal::not_looked_at;  ///< the first gate that failed
  FixedVector<BallRefusal, 8> failed;                ///< all of them
  BallWords words;                                   ///< of the first

  Vec3 centre_mm = Vec3::Constant(kNoValue);  ///< scanner frame
  /// Covariances of the centre, scanner axes: from what every point errs by itself, and from what neighbouring points
  /// err in common (as the residuals show it). The second part is the larger one, and repeated shots do not reduce it.
  Mat3 cov_white_mm2 = Mat3::Constant(kNoValue);
  Mat3 cov_correlated_mm2 = Mat3::Constant(kNoValue);
  /// Shift of the centre per mm that the certified radius is too large: along the view, about 1 to 1.4. The same in
  /// every view, so neither averaging nor residuals take it away.
  Vec3 shift_per_radius = Vec3::Constant(kNoValue);

  std::uint64_t points_near = 0;           ///< on the sphere within the search gate, whatever their incidence
  std::uint64_t points_offered = 0;        ///< of these inside incidence limit and rim
  std::uint64_t points_used = 0;           ///< of these with weight in the robust fit
  double half_angle_rad = kNoValue;        ///< of the cap used: median over the sectors seen
  double azimuth_rad = kNoValue;           ///< sum of the sectors that reach to 10 degrees short of the half-angle gate
  double rms_mm = kNoValue;                ///< radial, of the points used
  double kept_share = kNoValue;            ///< used / offered
  double radius_free_mm = kNoValue;        ///< of the fit with free radius: a check
  double radius_free_sigma_mm = kNoValue;  ///< with correlated noise
  Vec3 centre_free_mm = Vec3::Constant(kNoValue);
  double correlated_mm = kNoValue;          ///< standard deviation of what neighbouring points have in common
  double correlation_length_mm = kNoValue;  ///< distance at which that has fallen to 1/e
  Vec3 missing_side = Vec3::Zero();         ///< where the sectors not seen lie: unit vector, or zero
  bool converged = false;
  int iterations = 0;

  [[nodiscard]] bool ok() const { return refusal == BallRefusal::none; }
  /// Random part: white and correlated.
  [[nodiscard]] Mat3 cov_mm2() const { return cov_white_mm2 + cov_correlated_mm2; }
};

/// All balls of one scan. Refused (not_found, too_few, too_many): `balls` still holds the reports of what was looked
/// at, best first.
struct BallView {
  BallRefusal refusal = BallRefusal::not_looked_at;
  BallWords words;
  std::uint64_t points = 0;
  std::uint64_t finite = 0;
  std::vector<BallReport> balls;  ///< the accepted ones first, each group by falling points_used

  [[nodiscard]] bool ok() const { return refusal == BallRefusal::none; }
};

/// Finds the balls in a scan: `xyz` holds 3 floats a point (mm, scanner frame, NaN = missing), in any order, at most
/// limits::kScanPointsMax of them. config: settings out of range, or a length that is not a multiple of 3. Everything
/// about the scan itself is a refusal with words, not an error. Same scan, same bits. About 0.3 s of one core and 40 MB
/// for 5 million points.
[[nodiscard]] Result<BallView> find_balls(std::span<const float> xyz, const BallSettings& settings);

/// One view from repeated shots of one pose (three are usual).
struct BallShots {
  BallRefusal refusal = BallRefusal::not_looked_at;
  BallWords words;
  int shots = 0;
  Vec3 centre_mm = Vec3::Constant(kNoValue);  ///< mean
  /// Of the mean: the white part falls with the number of shots, the correlated part belongs to scanner and place and
  /// does not.
  Mat3 cov_mm2 = Mat3::Constant(kNoValue);
  double repeat_mm = kNoValue;  ///< standard deviation of one shot per axis; NaN for a single shot
  int worst_shot = 0;           ///< the one furthest from the mean, 1, 2, ...

  [[nodiscard]] bool ok() const { return refusal == BallRefusal::none; }
};

/// The mean of the shots; refused when any of them is (its words, with its number), or when they scatter by more than
/// `settings.repeat_max_mm`. An empty span is refused.
[[nodiscard]] BallShots average_shots(std::span<const BallReport> shots, const BallSettings& settings);

/// The one error that neither a residual nor a repetition of the calibration shows: a radius that is not the ball's
/// moves every centre along the view, and the scanner on the flange with it. The free radius of many views shows it.
struct RadiusCheck {
  int views = 0;               ///< accepted ones with a free radius
  double mean_mm = kNoValue;   ///< of the free radius; NaN below two views
  double sigma_mm = kNoValue;  ///< of the mean, from the views' scatter
  double shift_mm =
      kNoValue;  ///< by which the centres lie too near to the scanner (-) or too far (+), if the mean is right
  bool suspicious = false;
  bool covered = false;  ///< suspicious, but within what the certificate says itself (k = 2)
  BallWords words;       ///< when suspicious
};

/// Suspicious from five views on: the mean is further from the certified radius than three of its own sigmas and a
/// hundredth of a millimetre. A certificate that is uncertain does not make it less so: the scans know better then.
[[nodiscard]] RadiusCheck check_radius(std::span<const BallReport> balls, const BallSettings& settings);
/// By how much a centre is shifted along the view for each mm that the held radius is wrong, on a cap this wide.
[[nodiscard]] double shift_per_radius(double half_angle_rad);

}  // namespace slabd::calib
