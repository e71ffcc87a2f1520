// SPDX-License-Identifier: Apache-2.0
#include "algo/items/slab_budget.h"

#include <cmath>
#include <initializer_list>

namespace slabd::algo {
namespace {

double square(double v) {
  return v * v;
}

/// Sum of g^2 variance, where a zero gradient asks for no variance: a station that does not count may be unknown.
double weighted(const Vec3& g, const Vec3& variance) {
  double sum = 0.0;
  for (int i = 0; i < 3; ++i)
    if (g[i] != 0.0) sum += square(g[i]) * variance[i];
  return sum;
}

double times(double g_squared, double variance) {
  return g_squared == 0.0 ? 0.0 : g_squared * variance;
}

/// Root of the variances that are known.
Vec3 known(const Vec3& variance, std::initializer_list<double> sigmas) {
  double common = 0.0;
  for (const double sigma : sigmas)
    if (std::isfinite(sigma)) common += square(sigma);
  Vec3 sum = Vec3::Constant(common);
  for (int axis = 0; axis < 3; ++axis)
    if (std::isfinite(variance[axis])) sum[axis] += variance[axis];
  return sum.cwiseSqrt();
}

}  // namespace

SlabBudget::SlabBudget(const Recipe& recipe, const ScannerNumbers& verified, std::span<const StationSigma> sigmas)
    : settings_(recipe.uncertainty), scanner_(recipe.uncertainty, verified) {
  for (std::size_t i = 0; i < sigmas.size() && i < limits::kStationsMax; ++i) sigma_[i + 1] = sigmas[i];
}

void SlabBudget::set(int station, const StationErrors& errors) {
  errors_[static_cast<std::size_t>(station)] = errors;
}
void SlabBudget::set(int station, const FrameResponse& response) {
  response_[static_cast<std::size_t>(station)] = response;
}

Vec3 SlabBudget::known_p_mm(int station) const {
  return known(errors_[static_cast<std::size_t>(station)].p_noise,
               {sigma(station).position_mm, sigma(station).robot_position_mm, scanner_.place_mm(),
                settings_.reference_mm.value});
}

Vec3 SlabBudget::known_n_rad(int station) const {
  return known(errors_[static_cast<std::size_t>(station)].n_noise,
               {sigma(station).rotation_rad, sigma(station).robot_rotation_rad, scanner_.tilt_rad(),
                settings_.reference_rad.value});
}

double SlabBudget::of_roll(const SlabGradient& gradient) const {
  return std::abs(gradient.frame[3]) * u_roll_rad_;
}

Budget SlabBudget::budget(const SlabGradient& gradient, double unit) const {
  double fit = 0.0;
  double noise = 0.0;
  double scanner = 0.0;
  double calibration = 0.0;
  double robot = 0.0;
  double reference = 0.0;
  for (std::size_t k = 1; k < errors_.size(); ++k) {
    const StationErrors& e = errors_[k];
    const FrameResponse& response = response_[k];
    const StationSigma& of_station = sigma_[k];
    Vec3 gp = gradient.p[k];
    Vec3 gn = gradient.n[k];
    const Vec3& gj = gradient.jaw[k];
    for (int axis = 0; axis < 3; ++axis) gp[axis] += gradient.frame.dot(response.by_p[static_cast<std::size_t>(axis)]);
    for (int axis = 0; axis < 2; ++axis) gn[axis] += gradient.frame.dot(response.by_n[static_cast<std::size_t>(axis)]);
    if (gp.isZero(0.0) && gn.isZero(0.0) && gj.isZero(0.0)) continue;

    const double in_scan = weighted(gp, e.p_noise) + weighted(gn, e.n_noise) + weighted(gj, e.jaw_noise);
    fit += in_scan / e.noise_factor;
    noise += in_scan * (1.0 - 1.0 / e.noise_factor);

    const double at_jaw = square(e.jaw_per_shift * scanner_.place_mm()) +
                          square(e.jaw_per_tilt_mm * scanner_.tilt_rad()) +
                          square(scanner_.length_mm(e.jaw_lever.norm()));
    scanner += gp.squaredNorm() * square(scanner_.place_mm()) + gn.squaredNorm() * square(scanner_.tilt_rad()) +
               gj.squaredNorm() * at_jaw;

    const double moved = (gp + gj).squaredNorm();
    const double turned = (e.normal.cross(gn) + e.jaw_lever.cross(gj)).squaredNorm();
    calibration += moved * square(of_station.position_mm) + times(turned, square(of_station.rotation_rad));
    robot += moved * square(of_station.robot_position_mm) + times(turned, square(of_station.robot_rotation_rad));
    reference +=
        moved * square(settings_.reference_mm.value) + gn.squaredNorm() * square(settings_.reference_rad.value);
  }
  Budget budget{};
  part(budget, BudgetPart::fit) = unit * std::sqrt(fit);
  part(budget, BudgetPart::noise) = unit * std::sqrt(noise);
  part(budget, BudgetPart::scanner) = unit * std::sqrt(scanner);
  part(budget, BudgetPart::registration) = unit * of_roll(gradient);
  part(budget, BudgetPart::calibration) = unit * std::sqrt(calibration);
  part(budget, BudgetPart::robot) = unit * std::sqrt(robot);
  part(budget, BudgetPart::reference) = unit * std::sqrt(reference);
  return budget;
}

}  // namespace slabd::algo
