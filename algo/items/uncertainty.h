// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/block_model.h"
#include "base/base.h"
#include "base/calibration.h"

/// The uncertainty budget (GUM): every item's U = 2 sqrt(sum of its parts squared), each part a standard uncertainty in
/// the item's unit. The parts and their origins:
///
///   fit           The features' white-noise covariances (PlaneFit, CasingFeature), propagated by the gradient g of the
///                 item's formula: u^2 = g' C g. Features are fitted to different points, so theirs add in squares.
///                 Also the seat's density: if one part of a bowed seat returned more points than another, the fitted
///                 plane follows that part. With d the difference between the seat weighted by area and by points
///                 (SeatFeature::by_area), half width g d: u^2 = (g d)^2 / 3. The same for a plane that depends on
///                 where its threshold cuts (PlaneFit::bend).
///                 Also the bumps on a seat: a scan cannot distinguish a burr, which a straightedge touches, from a
///                 grain of dust or mortar that can be swept off. With b the contribution of narrow low bumps to the
///                 flatness (Flatness::bumps_mm), half width b: u^2 = b^2 / 3.
///   noise         Errors of neighbouring scanner points are correlated. SeatFeature::noise_factor f is the variance of
///                 a mean relative to white noise: u^2 = (f - 1) fit^2, for the noise part of the fit.
///   scanner       The recipe's specification and, if the scanner was verified, the verified values. Of every term
///                 below the larger counts: a lucky verification must not reduce a specification, and a scanner worse
///                 than specified must increase U. The form error, half width a over the length L, and its length error
///                 p:
///                   tilt of one feature           a / (sqrt(3) L)                     rad, per axis
///                   position of one place         a / sqrt(3)                         mm, per axis
///                   two places d apart            a / sqrt(3) min(sqrt(2), d / L)     mm: near ones are correlated
///                   length l                      p l / sqrt(3), verified: PS / sqrt(3)  mm: independent of l
///                 Temperature: with e the half width of a length's relative error since the acceptance
///                 (Attempt::scanner_drift), two places d apart are displaced against each other by up to e d in any
///                 direction. In addition to the above, by root sum of squares:
///                   length l                      e l / sqrt(3)                       mm
///                   tilt of one feature           e / sqrt(3)                         rad, per axis
///                   two places d apart            e d / sqrt(3)                       mm; flatness as well
///                 All rectangular. Tilts of different features count as independent, and a difference between two
///                 places already contains the features' tilts.
///                 Also the step to which the scan's coordinates were rounded (CoordinateRounding), if there is one,
///                 and the waves and the bend in the jaws' own profiles (form_tilts_rad in jaw.h).
///   registration  The pose only defines the position of the section x = 0 and the direction of X: u^2 = g' C g with
///                 RegistrationReport::covariance, times f as above. Slab frame: its roll, if the slab's top
///                 contradicts it (slab_budget.h).
///   calibration   Scanner on flange and station (StationSigma): one translation and one rotation per station,
///   robot         common to all points of that station's scan, independent between stations; so only items
///                 of the slab frame have these two parts (slab_budget.h).
///   reference     Angles: reference_rad. Lengths l inside one scan: reference_mm min(1, l / jaw distance), because an
///                 artefact gives the scale, and its error decreases with the length. Slab frame: reference_mm per
///                 axis and station, the coordinates of the mastered seats.
///
///   tie           The second robot's base in the base frame, common to all its stations; only items between stations of
///                 two robots have it (slab_budget.h).
///
/// If a part is not finite, the item has no budget: U is the recipe's or that of the known parts, whichever is larger.
/// Without one in the recipe there is none, and the item is indeterminate.
namespace slabd::algo {

/// Standard uncertainties by origin, [BudgetPart].
using Budget = std::array<double, kBudgetParts>;
[[nodiscard]] inline double& part(Budget& budget, BudgetPart p) {
  return budget[static_cast<std::size_t>(p)];
}

/// The scanner's part: for each term the larger of the specified and the verified value (`verified` without figures:
/// exactly the specification); see above.
class ScannerModel {
 public:
  explicit ScannerModel(const UncertaintySettings& settings, const ScannerNumbers& verified = {});
  [[nodiscard]] double tilt_rad() const { return std::max(specified_.tilt_rad(), found_.tilt_rad()); }
  [[nodiscard]] double place_mm() const { return std::max(specified_.place_mm, found_.place_mm); }
  [[nodiscard]] double difference_mm(double distance_mm) const;
  [[nodiscard]] double length_mm(double length_mm) const {
    return std::max(relative_length_ * std::abs(length_mm), found_length_mm_);
  }

 private:
  struct Form {
    double place_mm = 0.0;
    double length_mm = 1.0;
    [[nodiscard]] double tilt_rad() const { return place_mm / length_mm; }
    [[nodiscard]] double difference_mm(double distance_mm) const;
  };
  Form specified_;
  Form found_;  ///< zero if not verified
  double relative_length_;
  double found_length_mm_ = 0.0;  ///< for any length: a ball does not show how the error grows with it
};

/// SeatFeature::noise_factor from the verified correlation length L in a scan with this density: exponential
/// correlation exp(-r / L) has the integral 2 pi L^2 over the plane, times the density. A Gaussian one has half of
/// that, so this value is conservative. At least 1; 1 if nothing was verified.
[[nodiscard]] double verified_noise_factor(const ScannerNumbers& verified, double points_per_mm2);

/// Gradient of a value with respect to one fitted plane: `normal` for a change of its normal (about the centroid),
/// `height` for a shift along it.
struct PlaneGradient {
  Vec3 normal = Vec3::Zero();
  double height = 0.0;
};
/// Variance of the value from white noise of the fit. NaN if the fit has no covariance.
[[nodiscard]] double variance(const PlaneGradient& g, const PlaneFit& plane);

/// Variance of a value that changes by g . d between the seat weighted by points and by area; see above.
[[nodiscard]] double variance(const PlaneGradient& g, const PlaneShift& by_area);

/// Uncertainty from coordinates rounded to steps q of the scanner's axes (ScanCounts::step_mm). The error of a
/// coordinate is rectangular, q / sqrt(12), and equal for all points of a stretch of a face: the length over which
/// the coordinate changes by two steps, at least two rows of the scan. With S the sum over the n points of their
/// squared weights in a value (its variance from white noise of 1 mm), m the number of stretches across the face's
/// narrow side and N the face's normal in the scanner frame: u^2 = sum over the axes of (q N)^2 / 12 * n S / max(1,
/// m). With one stretch that is the worst effect of any error of up to q / 2 a point, because |sum w e| <= q / 2 *
/// sqrt(n S).
class CoordinateRounding {
 public:
  explicit CoordinateRounding(const BlockResult& result);
  [[nodiscard]] bool any() const { return any_; }
  /// Variance of a value that moves by g with this plane. 0 without a step; NaN if the plane has no noise estimate.
  [[nodiscard]] double variance(const PlaneGradient& g, const PlaneFit& plane) const;
  /// Variance of one position along `direction` (block frame), without averaging. mm^2.
  [[nodiscard]] double place_mm2(const Vec3& direction) const;
  /// Variance of a circle's centre along one axis of its plane with normal `normal`. Its edge counts as eight arcs with
  /// independent errors. mm^2.
  [[nodiscard]] double centre_mm2(const Vec3& normal) const;

 private:
  Vec3 step_mm_;
  Mat3 R_scanner_block_ = Mat3::Identity();
  double pitch_mm_ = 0.0;  ///< of the points over the seat
  bool any_ = false;
};

/// Intersection of a jaw plane with the plane at the reference height above the fitted seat and the section x = 0 of
/// the registered frame: p solves A p = b; the rows of A are the normals of the section, the seat and the jaw.
struct JawPoint {
  Vec3 p = Vec3::Zero();
  Mat3 A_inverse = Mat3::Zero();
};
/// Intersection of the registered frame's Z axis with the seat.
[[nodiscard]] inline Vec3 middle_of_seat(const PlaneFit& seat) {
  return {0.0, 0.0, seat.offset_mm / seat.normal.z()};
}
[[nodiscard]] JawPoint jaw_point(const PlaneFit& seat, const PlaneFit& jaw, double reference_height_mm);

/// Gradient of direction . p of a jaw point with respect to all its inputs.
struct JawGradient {
  PlaneGradient seat;
  PlaneGradient jaw;
  Eigen::Matrix<double, 6, 1> registration = Eigen::Matrix<double, 6, 1>::Zero();
};
[[nodiscard]] JawGradient gradient(const JawPoint& point, const Vec3& direction, const PlaneFit& seat,
                                   const PlaneFit& jaw);

/// Tilt of the seat relative to the slab top about X, and its gradient. Of the registration only X affects it.
struct SlopeGradient {
  Vec3 seat_normal = Vec3::Zero();
  Vec3 top_normal = Vec3::Zero();
  Eigen::Matrix<double, 6, 1> registration = Eigen::Matrix<double, 6, 1>::Zero();
};
[[nodiscard]] SlopeGradient slope_gradient(const Vec3& seat_normal, const Vec3& top_normal);

/// Amount to add to a flatness so that the seat's own flatness is covered from below with 95 %, as a multiple of
/// `noise_mm` (the reading of a flat seat). It is 1 + 4.2 / (a c) as long as the seat may be flat, with a = sqrt(2 ln
/// n) and c the mean range of n standard normal values. (The range has standard deviation 1.81 / a and its 95 %
/// quantile 1.75 of them higher, 3.2 / a; unequal numbers of points per cell widen it by another 1 / a.) It is 0.95 if
/// the form is clearly above the noise, because its extremes are then in fewer cells; linear in flatness / noise in
/// between. Measured on bows, waves, saddles, steps, bumps and chips of every height.
[[nodiscard]] double flatness_noise_multiple(double flatness_mm, double noise_mm, std::uint32_t cells);

/// Writes U = 2 sqrt(sum of squares) and the budget into `item`. If a part is not finite, the item's own U stays, or
/// becomes that of the finite parts if it is smaller; if all are zero, it stays. The budget is then all-zero, and the
/// function returns false.
bool settle(const Budget& budget, Item& item);

/// Uncertainty of a scan's items from the form of its own faces.
struct FormDoubt {
  /// Standard uncertainty of the inner and the outer jaw's tilt (form_tilts_rad).
  std::array<double, 2> jaw_rad{};
  /// Contribution of narrow bumps to the flatness (Flatness::bumps_mm); 0 if the recipe judges the raw one.
  double bumps_mm = 0.0;
  /// Half width of the seat's form: of a wave with the scatter of the fitted points beyond their own noise.
  double seat_mm = 0.0;
};

/// Computes budget and U of every block item with a value. seat_std always (its U is its sampling error, std sqrt(f /
/// (2 (n - 1))) per standard deviation). The others if the recipe's uncertainty is given; otherwise they keep the
/// recipe's U, raised to the values from circles and density. Needs the values (compute_block_items). `scanner_drift`:
/// e above; NaN or 0: no such part.
void compute_block_budget(const Recipe& recipe, const ScannerNumbers& verified, const FormDoubt& form,
                          BlockResult& result, double scanner_drift = kNoValue);

/// Fills observation.sigma_*, in block axes: effect of the scanner's noise (correlation included) and the seat's
/// density in this scan. The slab adds form error, calibration and robot. NaN if a covariance is missing.
void compute_observation_sigma(const BlockGeometry& geometry, CasingKind casings, BlockResult& result);

}  // namespace slabd::algo
