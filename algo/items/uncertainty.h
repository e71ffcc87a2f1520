// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/block_model.h"
#include "base/base.h"
#include "base/calibration.h"

/// The uncertainty budget (GUM): every item's U = 2 sqrt(sum of its parts squared), each part a standard uncertainty in
/// the item's unit. The parts, and where they come from:
///
///   fit           The features' white-noise covariances (PlaneFit, CasingFeature), carried through the item's formula
///                 by its gradient g: u^2 = g' C g. Features are fitted to different points, so theirs add in squares.
///                 And the seat's density: where more points returned from one part than from another, a bowed seat
///                 leans to that part. With d the difference between the seat weighed by area and by points
///                 (SeatFeature::by_area), half width g d: u^2 = (g d)^2 / 3.
///                 And the bumps on a seat: no scan tells a burr, which a straightedge feels, from a grain of dust or
///                 mortar that goes with the next broom. With b what narrow low bumps add to the flatness
///                 (Flatness::bumps_mm), half width b: u^2 = b^2 / 3.
///   noise         A scanner's neighbouring points err together. SeatFeature::noise_factor f says how much more a
///                 mean then varies than white noise would make it: u^2 = (f - 1) fit^2, of what noise gives the fit.
///   scanner       The recipe's specification and, where the scanner was verified, what was found; of every term below
///                 the larger: a lucky verification must not make a specification smaller, a scanner that is worse
///                 than specified must make U larger. The form error, half width a over the length L, and its length
///                 error p:
///                   tilt of one feature           a / (sqrt(3) L)                     rad, per axis
///                   position of one place         a / sqrt(3)                         mm, per axis
///                   two places d apart            a / sqrt(3) min(sqrt(2), d / L)     mm: close ones err together
///                   length l                      p l / sqrt(3), found: PS / sqrt(3)  mm: not how it grows
///                 All rectangular. Tilts of different features count as independent, and a difference between two
///                 places takes the features' tilts in already.
///                 And the step to which the scan's coordinates were rounded (CoordinateRounding), where there is one;
///                 and the waves and the bend that the jaws' own profiles show (form_tilts_rad in jaw.h).
///   registration  The pose only says where the section x = 0 lies and where X points: u^2 = g' C g with
///                 RegistrationReport::covariance, times f as above. Slab frame: its roll, where the slab's top
///                 contradicts it (slab_budget.h).
///   calibration   Scanner on flange and station (StationSigma): one translation and one rotation per station,
///   robot         shared by everything seen in that station's scan, independent between stations; hence only items
///                 of the slab frame have these two parts (slab_budget.h).
///   reference     Angles: reference_rad. Lengths l inside one scan: reference_mm min(1, l / jaw distance), because an
///                 artefact gives the scale, and its error shrinks with the length. Slab frame: reference_mm per
///                 axis and station, the coordinates of the mastered seats.
///
/// A part that is not finite gives no budget: the item keeps the recipe's U, or none, and is then indeterminate.
namespace slabd::algo {

/// Standard uncertainties by origin, [BudgetPart].
using Budget = std::array<double, kBudgetParts>;
[[nodiscard]] inline double& part(Budget& budget, BudgetPart p) {
  return budget[static_cast<std::size_t>(p)];
}

/// The scanner's part: of each term the larger of what the recipe specifies and what was verified (`verified` without
/// figures: the specification alone, to the bit); see above.
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
  Form found_;  ///< zero: nothing
  double relative_length_;
  double found_length_mm_ = 0.0;  ///< of any length: a ball says nothing of how it grows
};

/// SeatFeature::noise_factor that follows from the verified correlation length in a scan of so many points per mm^2:
/// exponential correlation exp(-r / L) sums up to 2 pi L^2 times the density over the plane; one that falls off as a
/// Gaussian to half of that, so this errs on the large side. At least 1; 1 when nothing was verified.
[[nodiscard]] double verified_noise_factor(const ScannerNumbers& verified, double points_per_mm2);

/// How a value moves with one fitted plane: by `normal` for a change of its normal (about the centroid), by `height`
/// for a shift along it.
struct PlaneGradient {
  Vec3 normal = Vec3::Zero();
  double height = 0.0;
};
/// Variance that white noise of the fit gives the value. NaN when the fit has no covariance.
[[nodiscard]] double variance(const PlaneGradient& g, const PlaneFit& plane);

/// Variance of a value that moves by g . d between the seat weighed by points and by area; see above.
[[nodiscard]] double variance(const PlaneGradient& g, const PlaneShift& by_area);

/// Uncertainty from coordinates that were rounded to steps q of the scanner's axes (ScanCounts::step_mm). The error of
/// a coordinate is rectangular, q / sqrt(12), and alike for all points of a stretch of a face: until the coordinate has
/// passed two steps, and over two rows of the scan. With S the sum over the n points of the squared weights that a
/// value gives them (the variance that white noise of 1 mm gives it), m the number of stretches across the face's
/// narrow side and N the face's normal in the scanner frame: u^2 = sum over the axes of (q N)^2 / 12 * n S / max(1, m).
/// With one stretch that is the worst that any error of up to q / 2 a point can do, because |sum w e| <= q / 2 * sqrt(n
/// S).
class CoordinateRounding {
 public:
  explicit CoordinateRounding(const BlockResult& result);
  [[nodiscard]] bool any() const { return any_; }
  /// Variance of a value that moves by g with this plane. 0 without a step; NaN where the plane knows no noise.
  [[nodiscard]] double variance(const PlaneGradient& g, const PlaneFit& plane) const;
  /// Variance of one place along `direction` (block frame): no averaging. mm^2.
  [[nodiscard]] double place_mm2(const Vec3& direction) const;
  /// Variance of a circle's centre along one axis of its plane, whose normal is `normal`. Its edge counts as eight
  /// arcs with an error of their own. mm^2.
  [[nodiscard]] double centre_mm2(const Vec3& normal) const;

 private:
  Vec3 step_mm_;
  Mat3 R_scanner_block_ = Mat3::Identity();
  double pitch_mm_ = 0.0;  ///< of the points over the seat
  bool any_ = false;
};

/// Where a jaw plane is met at the reference height above the fitted seat, in the section x = 0 of the registered
/// frame: p solves A p = b with the rows of A the section's, the seat's and the jaw's normal.
struct JawPoint {
  Vec3 p = Vec3::Zero();
  Mat3 A_inverse = Mat3::Zero();
};
/// Where the registered frame's Z axis meets the seat.
[[nodiscard]] inline Vec3 middle_of_seat(const PlaneFit& seat) {
  return {0.0, 0.0, seat.offset_mm / seat.normal.z()};
}
[[nodiscard]] JawPoint jaw_point(const PlaneFit& seat, const PlaneFit& jaw, double reference_height_mm);

/// How direction . p of a jaw point moves with everything it is made of.
struct JawGradient {
  PlaneGradient seat;
  PlaneGradient jaw;
  Eigen::Matrix<double, 6, 1> registration = Eigen::Matrix<double, 6, 1>::Zero();
};
[[nodiscard]] JawGradient gradient(const JawPoint& point, const Vec3& direction, const PlaneFit& seat,
                                   const PlaneFit& jaw);

/// Tilt of the seat against the slab top about X, and how it moves. All but the registration's X is free of it.
struct SlopeGradient {
  Vec3 seat_normal = Vec3::Zero();
  Vec3 top_normal = Vec3::Zero();
  Eigen::Matrix<double, 6, 1> registration = Eigen::Matrix<double, 6, 1>::Zero();
};
[[nodiscard]] SlopeGradient slope_gradient(const Vec3& seat_normal, const Vec3& top_normal);

/// What must be added to a flatness so that the seat's own flatness is covered from below with 95 %, as a multiple of
/// `noise_mm` (what a flat seat would read): 1 + 4.2 / (a c) as long as the seat may be flat, with a = sqrt(2 ln n)
/// and c the mean range of n standard normal values (its standard deviation is 1.81 / a, its 95 % quantile 1.75 of
/// them higher, 3.2 / a; cells of a real scan hold unequal numbers of points, which widens the range by another 1 / a);
/// 0.95 when the form stands clear of the noise, as its extremes then lie in fewer cells. In between linear in
/// flatness / noise. Measured on bows, waves, saddles, steps, bumps and chips of every height.
[[nodiscard]] double flatness_noise_multiple(double flatness_mm, double noise_mm, std::uint32_t cells);

/// U = 2 sqrt(sum of squares) and the budget into `item`; when a part is not finite or all are zero the item keeps U
/// and an all-zero budget, and the answer is false.
bool settle(const Budget& budget, Item& item);

/// How far the form of its own faces leaves a scan's items open.
struct FormDoubt {
  /// Standard uncertainty of the inner and the outer jaw's tilt (form_tilts_rad).
  std::array<double, 2> jaw_rad{};
  /// What narrow bumps add to the flatness (Flatness::bumps_mm); 0 where the recipe judges the raw one.
  double bumps_mm = 0.0;
};

/// Budget and U of every block item that has a value. seat_std always (its U is its sampling error,
/// std sqrt(f / (2 (n - 1))) per standard deviation); the others when the recipe's uncertainty is given, else they
/// keep the recipe's U, made no less than what circles and density say. Needs the values (compute_block_items).
void compute_block_budget(const Recipe& recipe, const ScannerNumbers& verified, const FormDoubt& form,
                          BlockResult& result);

/// Fills observation.sigma_*: what the scanner's noise (correlation included) and the seat's density leave in this
/// scan, in block axes. Form error, calibration and robot are the slab's to add. NaN where a covariance is missing.
void compute_observation_sigma(const BlockGeometry& geometry, CasingKind casings, BlockResult& result);

}  // namespace slabd::algo
