// SPDX-License-Identifier: Apache-2.0
//
// U of items from covariances of features. An item is a function of a few fitted features; its gradient by each of them
// is next to its formula, and a test compares every one with differences of the real item functions.
//
// A plane n.p = d with centroid c moves by a shift h along its normal and a change dn of the normal: at a position p
// its height changes by h - dn.(p - c). Shift and dn are independent, because they are taken about the centroid.
#include "algo/items/uncertainty.h"

#include <Eigen/LU>
#include <algorithm>

namespace slabd::algo {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1>;

double square(double v) {
  return v * v;
}

Item& item_of(BlockResult& result, ItemId id) {
  for (Item& i : result.items)
    if (i.id == id) return i;
  assert(false && "blank_block_items puts every block item there");
  return result.items.back();
}

double registration_variance(const Vec6& g, const RegistrationReport& registration) {
  // A registration without covariance must not affect values that do not depend on it: 0 * NaN.
  return g.isZero(0.0) ? 0.0 : g.dot(registration.covariance * g);
}

/// Variance of the spacing from the circles of both casings.
double spacing_variance_mm2(const BlockResult& result) {
  const Vec3 between = (result.casing_outer.centre - result.casing_inner.centre).normalized();
  const Vec3 by_circle(between.x(), std::hypot(between.y(), between.z()), 0.0);
  return by_circle.dot(result.casing_inner.cov_circle * by_circle) +
         by_circle.dot(result.casing_outer.cov_circle * by_circle);
}

/// The recipe's U does not consider this scan, so it is raised to the value from the circles.
void widen_spacing(BlockResult& result) {
  Item& spacing = item_of(result, ItemId::casing_spacing);
  if (!has_value(spacing.value)) return;
  const double u_mm = 2.0 * std::sqrt(spacing_variance_mm2(result));
  if (u_mm > spacing.U) spacing.U = u_mm;
}

/// Common values of the item budgets of one block.
class BlockBudget {
 public:
  BlockBudget(const Recipe& recipe, const ScannerNumbers& verified, double scanner_drift, BlockResult& result)
      : recipe_(recipe),
        result_(result),
        scanner_(recipe.uncertainty, verified),
        rounding_(result),
        drift_(std::isfinite(scanner_drift) ? scanner_drift / std::sqrt(3.0) : 0.0),
        noise_factor_(result.seat.noise_factor),
        length_reference_mm_(2.0 * recipe.block.jaw_half_distance_mm.value) {}

  void slope() {
    if (!has_value(item(ItemId::seat_slope).value)) return;
    const SlopeGradient g = slope_gradient(seat().normal, result_.slab_top.normal);
    const double fit = variance({g.seat_normal, 0.0}, seat()) + variance({g.top_normal, 0.0}, result_.slab_top);
    angle(ItemId::seat_slope, fit, by_density({g.seat_normal, 0.0}),
          drifted(square(scanner_.tilt_rad()) * (g.seat_normal.squaredNorm() + g.top_normal.squaredNorm()),
                  g.seat_normal.squaredNorm() + g.top_normal.squaredNorm()),
          rounding_.variance({g.seat_normal, 0.0}, seat()) + rounding_.variance({g.top_normal, 0.0}, result_.slab_top),
          g.registration);
  }

  void jaw_angle(ItemId id, const PlaneFit& jaw, double form_rad) {
    if (!has_value(item(id).value)) return;
    // cos(angle) = a.b; the free angle is 180 degrees less it.
    const double sine = seat().normal.cross(jaw.normal).norm();
    const PlaneGradient by_seat{jaw.normal / sine, 0.0};
    const PlaneGradient by_jaw{seat().normal / sine, 0.0};
    widen(id, deg_from_rad(form_rad));
    angle(id, variance(by_seat, seat()) + variance(by_jaw, jaw), by_density(by_seat),
          drifted(2.0 * square(scanner_.tilt_rad()) + square(form_rad), 2.0),
          rounding_.variance(by_seat, seat()) + rounding_.variance(by_jaw, jaw), Vec6::Zero());
  }

  void jaw_distance(const std::array<double, 2>& form_rad) {
    const Item& distance = item(ItemId::jaw_distance);
    if (!has_value(distance.value)) return;
    const double height = recipe_.block.jaw_reference_height_mm.value;
    const JawPoint inner = jaw_point(seat(), result_.jaw_inner, height);
    const JawPoint outer = jaw_point(seat(), result_.jaw_outer, height);
    const Vec3 along = (outer.p - inner.p).normalized();
    const JawGradient g_outer = gradient(outer, along, seat(), result_.jaw_outer);
    const JawGradient g_inner = gradient(inner, -along, seat(), result_.jaw_inner);
    const PlaneGradient g_seat{g_outer.seat.normal + g_inner.seat.normal, g_outer.seat.height + g_inner.seat.height};
    const double fit =
        variance(g_seat, seat()) + variance(g_outer.jaw, result_.jaw_outer) + variance(g_inner.jaw, result_.jaw_inner);
    // The two jaws against each other, the seat between them against both, and tilts as far as their levers contribute.
    const double jaw_steepness = std::max(std::abs(g_outer.jaw.height), std::abs(g_inner.jaw.height));
    const double form =
        square(form_rad[1]) * g_outer.jaw.normal.squaredNorm() + square(form_rad[0]) * g_inner.jaw.normal.squaredNorm();
    widen(ItemId::jaw_distance, std::sqrt(form));
    const double scanner =
        square(jaw_steepness * scanner_.difference_mm(distance.value)) +
        square(g_seat.height * scanner_.difference_mm(0.5 * distance.value)) +
        square(scanner_.tilt_rad()) * (g_outer.jaw.normal.squaredNorm() + g_inner.jaw.normal.squaredNorm()) +
        square(scanner_.length_mm(distance.value)) + form;
    length(ItemId::jaw_distance, distance.value, fit, by_density(g_seat), drifted(scanner, square(distance.value)),
           rounding_.variance(g_seat, seat()) + rounding_.variance(g_outer.jaw, result_.jaw_outer) +
               rounding_.variance(g_inner.jaw, result_.jaw_inner),
           Vec6(g_outer.registration + g_inner.registration));
  }

  void casing_spacing() {
    const Item& spacing = item(ItemId::casing_spacing);
    if (!has_value(spacing.value)) return;
    // A circle's covariance comes from the scatter of its own edge, so no noise factor is applied.
    put(ItemId::casing_spacing, spacing_variance_mm2(result_), 0.0,
        drifted(square(scanner_.difference_mm(spacing.value)) + square(scanner_.length_mm(spacing.value)),
                square(spacing.value)),
        2.0 * rounding_.centre_mm2(seat().normal), Vec6::Zero(), square(reference_mm(spacing.value)), 1.0, 1.0);
  }

  void casing_protrusion(ItemId id, const CasingFeature& casing, double seat_form_mm) {
    const Item& protrusion = item(id);
    if (!has_value(protrusion.value)) return;
    const Vec3 from_centroid = casing.centre - seat().centroid;
    const PlaneGradient by_seat{from_centroid, -1.0};
    const double fit = square(casing.sigma_height_mm) + variance(by_seat, seat());
    const double form_mm = seen_form_mm(seat_form_mm);
    widen(id, form_mm);
    length(
        id, protrusion.value, fit, by_density(by_seat),
        drifted(square(std::max(scanner_.difference_mm(from_centroid.norm()), form_mm)), from_centroid.squaredNorm()),
        rounding_.place_mm2(seat().normal) + rounding_.variance(by_seat, seat()), Vec6::Zero());
  }

  /// Noise and form error can both only increase a flatness, so they are added linearly, U = m N + 1.645 u_form. So
  /// that U remains twice the root sum of squares, the part `noise` contains the mixed term 2 fit scanner of that
  /// square.
  void flatness(double bumps_mm) {
    Item& flatness = item(ItemId::seat_flatness);
    if (!has_value(flatness.value)) return;
    // A filter spreads a wrong point into a bump. In a smoothed scan, or one whose steps hide a filter, any part of the
    // flatness may be wrong points.
    const ScanCounts& scan = result_.scan;
    const bool hidden = !has_value(scan.lag_ratio) && !scan.step_mm.isZero();
    const bool smoothed = hidden || scan.lag_ratio < kSmoothedLagRatio;
    const double doubt_mm = smoothed ? std::max(0.0, flatness.value - result_.seat.flatness_noise_mm) : 0.0;
    const double bumps = std::hypot(bumps_mm / std::sqrt(3.0), 0.5 * doubt_mm);
    widen(ItemId::seat_flatness, bumps);
    if (!recipe_.uncertainty.given) return;
    const double region_mm = 2.0 * std::max(recipe_.evaluation.crop_half_x_mm, recipe_.evaluation.crop_half_s_mm);
    const double noise_mm = result_.seat.flatness_noise_mm;
    Budget budget{};
    const double fit = 0.5 * noise_mm * flatness_noise_multiple(flatness.value, noise_mm, result_.seat.grid_points);
    // Highest and lowest cell may both be off by half a step.
    const double scanner =
        std::sqrt(drifted(square(0.5 * 1.645 * scanner_.difference_mm(region_mm)), square(0.5 * 1.645 * region_mm)) +
                  4.0 * rounding_.place_mm2(seat().normal));
    part(budget, BudgetPart::fit) = std::hypot(fit, bumps);
    part(budget, BudgetPart::noise) = std::sqrt(2.0 * fit * scanner);
    part(budget, BudgetPart::scanner) = scanner;
    part(budget, BudgetPart::reference) = reference_mm(region_mm);
    settle(budget, flatness);
  }

 private:
  [[nodiscard]] const PlaneFit& seat() const { return result_.seat.plane; }
  /// Adds the drift with temperature to a variance of the scanner. Without a drift the bits are unchanged.
  [[nodiscard]] double drifted(double scanner, double gradient2) const {
    return drift_ == 0.0 ? scanner : scanner + square(drift_) * gradient2;
  }
  Item& item(ItemId id) { return item_of(result_, id); }
  /// Standard uncertainty between two distant places from the form of the seat, if that is more than twice the stated
  /// form of the scanner; else 0. It may also be the block's own form: the scan does not distinguish them.
  [[nodiscard]] double seen_form_mm(double half_mm) const {
    constexpr double kClear_mm = 0.1;
    const double stated_mm = std::sqrt(3.0) * scanner_.place_mm();
    return half_mm > std::max(kClear_mm, 2.0 * stated_mm) ? half_mm * std::sqrt(2.0 / 3.0) : 0.0;
  }
  /// The recipe's U does not consider the form of this block either, so it is raised.
  void widen(ItemId id, double u) {
    if (2.0 * u > item(id).U) item(id).U = 2.0 * u;
  }
  [[nodiscard]] double by_density(const PlaneGradient& by_seat) const {
    return variance(by_seat, result_.seat.by_area) + variance(by_seat, seat().bend);
  }
  [[nodiscard]] double reference_mm(double length_mm) const {
    return recipe_.uncertainty.reference_mm.value * std::min(1.0, std::abs(length_mm) / length_reference_mm_);
  }
  /// Variances in rad^2.
  void angle(ItemId id, double fit, double density, double scanner, double rounding, const Vec6& by_registration) {
    put(id, fit, density, scanner, rounding, by_registration, square(recipe_.uncertainty.reference_rad.value),
        deg_from_rad(1.0), noise_factor_);
  }
  /// Variances in mm^2.
  void length(ItemId id, double length_mm, double fit, double density, double scanner, double rounding,
              const Vec6& by_registration) {
    put(id, fit, density, scanner, rounding, by_registration, square(reference_mm(length_mm)), 1.0, noise_factor_);
  }
  void put(ItemId id, double fit, double density, double scanner, double rounding, const Vec6& by_registration,
           double reference, double unit, double noise_factor) {
    // The recipe's U does not consider this seat's density or this scan's coordinate steps either, so it is raised.
    const double u_density = unit * std::sqrt(density + rounding);
    if (2.0 * u_density > item(id).U) item(id).U = 2.0 * u_density;
    if (!std::isfinite(rounding)) item(id).U = kNoValue;
    if (!recipe_.uncertainty.given) return;
    Budget budget{};
    part(budget, BudgetPart::fit) = unit * std::sqrt(fit + density);
    part(budget, BudgetPart::noise) = unit * std::sqrt((noise_factor - 1.0) * fit);
    part(budget, BudgetPart::scanner) = unit * std::sqrt(scanner + rounding);
    part(budget, BudgetPart::registration) =
        unit * std::sqrt(noise_factor_ * registration_variance(by_registration, result_.registration));
    part(budget, BudgetPart::reference) = unit * std::sqrt(reference);
    settle(budget, item(id));
  }

  const Recipe& recipe_;
  BlockResult& result_;
  ScannerModel scanner_;
  CoordinateRounding rounding_;
  double drift_;  ///< standard uncertainty of a length's relative error by the scanner's temperature
  double noise_factor_;
  double length_reference_mm_;
};

/// The sampling error of a standard deviation from n values with correlation factor f: n / f values count.
void budget_seat_std(BlockResult& result) {
  Item& item = item_of(result, ItemId::seat_std);
  const PlaneFit& seat = result.seat.plane;
  if (!has_value(item.value) || seat.inliers < 2) return;
  // Without the factor, the inliers of one flatness cell count as one value.
  const double factor = has_value(result.seat.noise_factor)
                            ? result.seat.noise_factor
                            : static_cast<double>(seat.inliers) / std::max(1.0, double(result.seat.grid_points));
  Budget budget{};
  const double white = item.value / std::sqrt(2.0 * (static_cast<double>(seat.inliers) - 1.0));
  part(budget, BudgetPart::fit) = white;
  part(budget, BudgetPart::noise) = white * std::sqrt(std::max(factor, 1.0) - 1.0);
  settle(budget, item);
}

}  // namespace

namespace {

/// Extent of a fitted plane's inliers, from its covariance: cov_normal is std^2 / (n s^2) for the standard deviation s
/// of the points along each of the two directions. A face of uniform density is sqrt(12) standard deviations long.
struct Spread {
  double narrow_mm = kNoValue;  ///< length of the shorter side
  double area_mm2 = kNoValue;
};
Spread spread_of(const PlaneFit& plane) {
  const Mat3& c = plane.cov_normal;
  const double sum = c.trace();
  const double product =
      c(0, 0) * c(1, 1) - square(c(0, 1)) + c(0, 0) * c(2, 2) - square(c(0, 2)) + c(1, 1) * c(2, 2) - square(c(1, 2));
  const double apart = std::sqrt(std::max(0.0, 0.25 * square(sum) - product));
  const double mean_square = square(plane.std_mm) / static_cast<double>(plane.inliers);
  return {std::sqrt(12.0 * mean_square / (0.5 * sum + apart)), 12.0 * mean_square / std::sqrt(std::max(product, 0.0))};
}

}  // namespace

ScannerModel::ScannerModel(const UncertaintySettings& settings, const ScannerNumbers& verified)
    : specified_{settings.scanner_form_mm.value / std::sqrt(3.0), settings.scanner_form_length_mm.value},
      relative_length_(1e-6 * settings.scanner_length_ppm.value / std::sqrt(3.0)) {
  if (std::isfinite(verified.form_half_mm) && verified.form_length_mm > 0.0)
    found_ = {verified.form_half_mm / std::sqrt(3.0), verified.form_length_mm};
  if (std::isfinite(verified.PS_mm)) found_length_mm_ = std::abs(verified.PS_mm) / std::sqrt(3.0);
}

double ScannerModel::Form::difference_mm(double distance_mm) const {
  return place_mm * std::min(std::sqrt(2.0), std::abs(distance_mm) / length_mm);
}

double ScannerModel::difference_mm(double distance_mm) const {
  return std::max(specified_.difference_mm(distance_mm), found_.difference_mm(distance_mm));
}

double verified_noise_factor(const ScannerNumbers& verified, double points_per_mm2) {
  const double length_mm = verified.noise_correlation_mm;
  if (!std::isfinite(length_mm) || !std::isfinite(points_per_mm2)) return 1.0;
  return std::max(1.0, 2.0 * kPi * length_mm * length_mm * points_per_mm2);
}

CoordinateRounding::CoordinateRounding(const BlockResult& result)
    : step_mm_(result.scan.step_mm), any_(result.scan.step_mm.maxCoeff() > 0.0) {
  if (!any_) return;
  R_scanner_block_ = result.registration.T_scanner_block.rotation.toRotationMatrix();
  if (const Spread seat = spread_of(result.seat.plane); seat.area_mm2 > 0.0)
    pitch_mm_ = std::sqrt(seat.area_mm2 / static_cast<double>(result.seat.plane.inliers));
}

double CoordinateRounding::variance(const PlaneGradient& g, const PlaneFit& plane) const {
  if (!any_) return 0.0;
  const auto n = static_cast<double>(plane.inliers);
  const Spread spread = spread_of(plane);
  const double weights = slabd::algo::variance(g, plane) / square(plane.std_mm);
  const double row_mm = pitch_mm_ > 0.0 ? spread.area_mm2 / (n * pitch_mm_) : spread.narrow_mm;
  const Vec3 normal = R_scanner_block_ * plane.normal;
  double sum = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    if (step_mm_[axis] == 0.0) continue;
    // Largest rate of change of this coordinate along the face.
    const double rise = std::sqrt(std::max(0.0, 1.0 - square(normal[axis])));
    const double stretch_mm = 2.0 * std::max(step_mm_[axis] / std::max(rise, 1e-6), row_mm);
    const double stretches = std::max(1.0, spread.narrow_mm / stretch_mm);
    sum += square(step_mm_[axis] * normal[axis]) / 12.0 / stretches;
  }
  return sum * n * weights;
}

double CoordinateRounding::place_mm2(const Vec3& direction) const {
  if (!any_) return 0.0;
  return (R_scanner_block_ * direction).cwiseProduct(step_mm_).squaredNorm() / 12.0;
}

double CoordinateRounding::centre_mm2(const Vec3& normal) const {
  if (!any_) return 0.0;
  constexpr double kArcs = 8.0;
  const Vec3 n = R_scanner_block_ * normal;
  double in_plane = 0.0;
  for (int axis = 0; axis < 3; ++axis) in_plane += square(step_mm_[axis]) * (1.0 - square(n[axis]));
  return 2.0 / kArcs * in_plane / 12.0;
}

double variance(const PlaneGradient& g, const PlaneFit& plane) {
  const double by_tilt = g.normal.dot(plane.cov_normal * g.normal);
  return by_tilt + (g.height == 0.0 ? 0.0 : square(g.height * plane.sigma_offset_mm));
}

double variance(const PlaneGradient& g, const PlaneShift& by_area) {
  return square(g.normal.dot(by_area.normal) + g.height * by_area.height_mm) / 3.0;
}

JawPoint jaw_point(const PlaneFit& seat, const PlaneFit& jaw, double reference_height_mm) {
  Mat3 A;
  A.row(0) = Vec3::UnitX();
  A.row(1) = seat.normal;
  A.row(2) = jaw.normal;
  JawPoint point;
  point.A_inverse = A.inverse();
  point.p = point.A_inverse * Vec3(0.0, seat.offset_mm + reference_height_mm, jaw.offset_mm);
  return point;
}

JawGradient gradient(const JawPoint& point, const Vec3& direction, const PlaneFit& seat, const PlaneFit& jaw) {
  // dp = A^-1 (db - dA p); db of a plane is its shift plus dn.c.
  const Vec3 q = point.A_inverse.transpose() * direction;
  JawGradient g;
  g.seat = {-q[1] * (point.p - seat.centroid), q[1]};
  g.jaw = {-q[2] * (point.p - jaw.centroid), q[2]};
  // The true section: moved by x along X, its normal rotated to (1, rz, -ry).
  g.registration << q[0], 0.0, 0.0, 0.0, q[0] * point.p.z(), -q[0] * point.p.y();
  return g;
}

SlopeGradient slope_gradient(const Vec3& n, const Vec3& top_normal) {
  const Vec3& z = top_normal;
  const Vec3 across = Vec3::UnitX() - z.x() * z;
  const double m = across.norm();
  const Vec3 x = across / m;
  const Vec3 y = z.cross(x);
  const double nx = n.dot(x);
  const double ny = n.dot(y);
  const double nz = n.dot(z);
  const double square_sum = ny * ny + nz * nz;
  SlopeGradient g;
  g.seat_normal = (ny * z - nz * y) / square_sum;
  // Rotating z also rotates y, and rotates x and y about z if X is not perpendicular to it (kappa).
  const double kappa = z.x() / m;
  g.top_normal = (square_sum - kappa * nz * nx) / square_sum * y + ny * nx / square_sum * x;
  // X rotated to (1, rz, -ry).
  const double by_x = nz * nx / (m * square_sum);
  g.registration << 0.0, 0.0, 0.0, 0.0, -by_x * y.z(), by_x * y.y();
  return g;
}

double flatness_noise_multiple(double flatness_mm, double noise_mm, std::uint32_t cells) {
  constexpr double kEuler = 0.5772156649015329;
  constexpr double kFormClear = 1.5;  ///< flatness / noise from which the form is clearly above the noise
  constexpr double kFormMultiple = 0.95;
  const double n = std::max(static_cast<double>(cells), 10.0);
  const double a = std::sqrt(2.0 * std::log(n));
  const double mean_range = 2.0 * a - (std::log(std::log(n)) + std::log(4.0 * kPi) - 2.0 * kEuler) / a;
  const double flat = 1.0 + 4.2 / (a * mean_range);
  // Up to this reading the seat may be flat.
  const double flat_until = flat + 0.02;
  const double reading = flatness_mm / noise_mm;
  const double along = std::clamp((reading - flat_until) / (kFormClear - flat_until), 0.0, 1.0);
  return flat + along * (kFormMultiple - flat);
}

bool settle(const Budget& budget, Item& item) {
  double squares = 0.0;
  for (const double u : budget) squares += u * u;
  item.budget = {};
  if (!std::isfinite(squares)) {
    double known = 0.0;
    for (const double u : budget)
      if (std::isfinite(u)) known += u * u;
    // No U stays none; fmax would take the number.
    if (has_value(item.U)) item.U = std::fmax(item.U, 2.0 * std::sqrt(known));
    return false;
  }
  if (!(squares > 0.0)) return false;
  item.budget = budget;
  item.U = 2.0 * std::sqrt(squares);
  return true;
}

void compute_block_budget(const Recipe& recipe, const ScannerNumbers& verified, const FormDoubt& form,
                          BlockResult& result, double scanner_drift) {
  budget_seat_std(result);
  widen_spacing(result);
  BlockBudget budget(recipe, verified, scanner_drift, result);
  budget.flatness(form.bumps_mm);
  budget.slope();
  budget.jaw_angle(ItemId::jaw_angle_inner, result.jaw_inner, form.jaw_rad[0]);
  budget.jaw_angle(ItemId::jaw_angle_outer, result.jaw_outer, form.jaw_rad[1]);
  budget.jaw_distance(form.jaw_rad);
  if (recipe.uncertainty.given) budget.casing_spacing();
  budget.casing_protrusion(ItemId::casing_protrusion_inner, result.casing_inner, form.seat_mm);
  budget.casing_protrusion(ItemId::casing_protrusion_outer, result.casing_outer, form.seat_mm);
}

void compute_observation_sigma(const BlockGeometry& geometry, CasingKind casings, BlockResult& result) {
  SeatObservation& o = result.observation;
  const PlaneFit& seat = result.seat.plane;
  const double f = result.seat.noise_factor;
  const PlaneShift& by_area = result.seat.by_area;
  const auto spread = [f](const Mat3& covariance, const Vec3& density) -> Vec3 {
    return (f * covariance.diagonal() + density).cwiseSqrt();
  };
  const CoordinateRounding rounding(result);
  const auto rounded_normal = [&](const PlaneFit& plane) -> Vec3 {
    Vec3 v = Vec3::Zero();
    for (int axis = 0; axis < 3; ++axis) v[axis] = rounding.variance({Vec3::Unit(axis), 0.0}, plane);
    return v;
  };
  const auto shifted = [](const PlaneShift& shift) -> Vec3 { return shift.normal.cwiseAbs2() / 3.0; };
  if (seat.ok) o.sigma_n_rad = spread(seat.cov_normal, shifted(by_area) + shifted(seat.bend) + rounded_normal(seat));
  if (result.slab_top.ok) o.sigma_top_n_rad = spread(result.slab_top.cov_normal, rounded_normal(result.slab_top));
  if (o.ok && casings == CasingKind::capped) {
    const Vec3 middle = middle_of_seat(seat);
    const PlaneGradient height{middle - seat.centroid, -1.0};
    const double of_plane = f * variance(height, seat) + variance(height, by_area) + variance(height, seat.bend) +
                            rounding.variance(height, seat);
    // Intersection of the registered frame's Z axis with the plane: it moves with the frame, and up and down with the
    // plane.
    for (int axis = 0; axis < 3; ++axis) {
      const bool up = axis == 2;
      const Vec3 along = up ? Vec3(Vec3::UnitZ() - seat.normal / seat.normal.z()) : Vec3(Vec3::Unit(axis));
      Vec6 by_frame;
      by_frame << along, middle.cross(along);
      o.sigma_p_mm[axis] = std::sqrt(f * registration_variance(by_frame, result.registration) +
                                     (up ? of_plane / square(seat.normal.z()) : 0.0));
    }
  } else if (o.ok) {
    const CasingFeature& inner = result.casing_inner;
    const CasingFeature& outer = result.casing_outer;
    // Mid-point of the circles in the seat plane (x, s), and the plane's height there. A circle's covariance already
    // contains the noise's correlation.
    const Vec3 middle = 0.5 * (inner.centre + outer.centre);
    Mat3 local = 0.25 * (inner.cov_circle + outer.cov_circle);
    local.row(2).setZero();
    local.col(2).setZero();
    const PlaneGradient height{middle - seat.centroid, -1.0};
    local(2, 2) = f * variance(height, seat);
    Mat3 axes;
    axes.col(2) = seat.normal;
    axes.col(0) = (Vec3::UnitX() - seat.normal.x() * seat.normal).normalized();
    axes.col(1) = axes.col(2).cross(axes.col(0));
    const double rounded_centre = 0.5 * rounding.centre_mm2(seat.normal);
    const double rounded_height = rounding.variance(height, seat);
    const Vec3 rest =
        (variance(height, by_area) + variance(height, seat.bend) + rounded_height) * seat.normal.cwiseAbs2() +
        rounded_centre * (Vec3::Ones() - seat.normal.cwiseAbs2());
    o.sigma_p_mm = (Mat3(axes * local * axes.transpose()).diagonal() + rest).cwiseSqrt();
  }
  if (o.jaw_ok) {
    const JawPoint point = jaw_point(seat, result.jaw_outer, geometry.jaw_reference_height_mm.value);
    for (int axis = 0; axis < 3; ++axis) {
      const JawGradient g = gradient(point, Vec3::Unit(axis), seat, result.jaw_outer);
      // The position of the section along X is not a property of the jaw.
      const double section = axis == 0 ? 0.0 : registration_variance(g.registration, result.registration);
      const double fit = variance(g.seat, seat) + variance(g.jaw, result.jaw_outer);
      o.sigma_jaw_mm[axis] = std::sqrt(f * (fit + section) + variance(g.seat, by_area) + variance(g.seat, seat.bend) +
                                       rounding.variance(g.seat, seat) + rounding.variance(g.jaw, result.jaw_outer));
    }
  }
}

}  // namespace slabd::algo
