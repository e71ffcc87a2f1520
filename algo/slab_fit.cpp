// SPDX-License-Identifier: Apache-2.0
//
// One frame for the whole slab, from the seats themselves. A plain least-squares fit would share a displaced seat's
// error with all its neighbours: 0.8 mm at one corner turns the frame, and seats that are in place are reported off.
// So the fit is robust, and the scale that decides what is "displaced" comes from the seats' own scatter, never below
// the uncertainty of a station. A warped slab scatters a lot in height, which widens the height scale and nothing else.
#include "algo/slab_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>

namespace slabd::algo {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

/// x, y, z of the reference point (mm) and the two tilts of the seat (rad).
constexpr std::size_t kChannels = 5;
/// Smallest scales: below them differences are noise whatever the seats say.
constexpr double kScaleMin_mm = 0.02;
constexpr double kScaleMin_rad = 2e-4;
constexpr int kHuberSteps = 15;
constexpr int kStepsMax = 200;
constexpr double kLever_mm = 1000.0;

using Residuals = std::array<std::array<double, limits::kStationsMax>, kChannels>;

/// Least-squares pose of all points (Kabsch): the plain fit and the start of the robust one. T_slab_base.
Pose plain_fit(std::span<const SeatSighting> seats) {
  Vec3 centre_base = Vec3::Zero();
  Vec3 centre_slab = Vec3::Zero();
  for (const SeatSighting& s : seats) {
    centre_base += s.p_base;
    centre_slab += s.p_slab;
  }
  centre_base /= static_cast<double>(seats.size());
  centre_slab /= static_cast<double>(seats.size());
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  for (const SeatSighting& s : seats) H += (s.p_slab - centre_slab) * (s.p_base - centre_base).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(H, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d D = Eigen::Matrix3d::Identity();
  D(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Matrix3d R = svd.matrixU() * D * svd.matrixV().transpose();
  Pose T_slab_base;
  T_slab_base.rotation = Quat(R).normalized();
  T_slab_base.translation_mm = centre_slab - T_slab_base.rotation * centre_base;
  return T_slab_base;
}

double position_rms(std::span<const SeatSighting> seats, const Pose& T_slab_base) {
  double squares = 0.0;
  for (const SeatSighting& s : seats) squares += (T_slab_base * s.p_base - s.p_slab).squaredNorm();
  return std::sqrt(squares / static_cast<double>(seats.size()));
}

void residuals_of(std::span<const SeatSighting> seats, const Pose& T_slab_base, Residuals& r) {
  for (std::size_t i = 0; i < seats.size(); ++i) {
    const Vec3 dp = T_slab_base * seats[i].p_base - seats[i].p_slab;
    const Vec3 dn = T_slab_base.rotation * seats[i].n_base - seats[i].n_slab;
    r[0][i] = dp.x();
    r[1][i] = dp.y();
    r[2][i] = dp.z();
    r[3][i] = dn.x();
    r[4][i] = dn.y();
  }
}

double median_abs(const std::array<double, limits::kStationsMax>& r, std::size_t count) {
  std::array<double, limits::kStationsMax> a{};
  for (std::size_t i = 0; i < count; ++i) a[i] = std::abs(r[i]);
  const auto middle = a.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(a.begin(), middle, a.begin() + static_cast<std::ptrdiff_t>(count));
  return *middle;
}

/// First Huber, which cannot lose its way from a bad start; then Tukey, under which a displaced seat has no pull.
double weight_of(double r, double scale, bool tukey) {
  const double u = std::abs(r) / scale;
  if (!tukey) return u <= 1.345 ? 1.0 : 1.345 / u;
  const double v = u / 4.685;
  return v < 1.0 ? (1.0 - v * v) * (1.0 - v * v) : 0.0;
}

}  // namespace

SlabFitReport fit_slab(std::span<const SeatSighting> seats, const StationSigma& sigma) {
  SlabFitReport report;
  report.seats = static_cast<std::uint8_t>(seats.size());
  if (seats.size() < 3 || seats.size() > limits::kStationsMax) {
    report.note.printf("%zu seats, 3 to %zu can be fitted", seats.size(), limits::kStationsMax);
    return report;
  }
  Pose T_slab_base = plain_fit(seats);
  report.plain_rms_mm = position_rms(seats, T_slab_base);

  const double floor_mm = std::isfinite(sigma.position_mm) ? std::max(sigma.position_mm, kScaleMin_mm) : kScaleMin_mm;
  const double floor_rad =
      std::isfinite(sigma.rotation_rad) ? std::max(sigma.rotation_rad, kScaleMin_rad) : kScaleMin_rad;
  Residuals r;
  std::array<double, kChannels> scale{};
  double position_squares = 0.0;
  double position_weight = 0.0;
  for (report.iterations = 1; report.iterations <= kStepsMax; ++report.iterations) {
    residuals_of(seats, T_slab_base, r);
    const bool tukey = report.iterations > kHuberSteps;
    // The scales follow for a while and then stand, so that the steps can come to rest.
    if (report.iterations <= 4 * kHuberSteps)
      for (std::size_t c = 0; c < kChannels; ++c)
        scale[c] = std::max(1.4826 * median_abs(r[c], seats.size()), c < 3 ? floor_mm : floor_rad);

    Mat6 H = Mat6::Zero();
    Vec6 g = Vec6::Zero();
    position_squares = position_weight = 0.0;
    for (std::size_t i = 0; i < seats.size(); ++i) {
      const Vec3 p = T_slab_base * seats[i].p_base;
      const Vec3 n = T_slab_base.rotation * seats[i].n_base;
      for (std::size_t c = 0; c < kChannels; ++c) {
        const bool position = c < 3;
        const Vec3 axis = Vec3::Unit(static_cast<Eigen::Index>(position ? c : c - 3));
        Vec6 j;
        j.head<3>() = position ? axis : Vec3(Vec3::Zero());
        j.tail<3>() = (position ? p : n).cross(axis) / kLever_mm;
        const double robust = weight_of(r[c][i], scale[c], tukey);
        const double w = robust / (scale[c] * scale[c]);
        H += w * j * j.transpose();
        g += w * r[c][i] * j;
        if (!position) continue;
        position_squares += robust * r[c][i] * r[c][i];
        position_weight += robust;
      }
    }
    const Eigen::LDLT<Mat6> solver(H);
    const Vec6 delta = -solver.solve(g);
    if (solver.info() != Eigen::Success || !delta.allFinite() || !(solver.rcond() > 1e-12)) {
      report.note = "the seats do not fix the slab's pose";
      return report;
    }
    const Vec3 turn = delta.tail<3>() / kLever_mm;
    Pose move;
    move.translation_mm = delta.head<3>();
    const double angle = turn.norm();
    if (angle > 0.0) move.rotation = Quat(Eigen::AngleAxisd(angle, Eigen::Vector3d(turn / angle)));
    T_slab_base = move * T_slab_base;
    if (report.iterations > 4 * kHuberSteps && delta.norm() < 1e-9) {
      report.ok = true;
      break;
    }
  }
  if (!report.ok) report.note.printf("the slab's pose still moves after %d steps", kStepsMax);
  // Three components per seat: per-seat root mean square, comparable with the plain one.
  report.rms_mm = position_weight > 0.0 ? std::sqrt(3.0 * position_squares / position_weight) : kNoValue;
  report.T_base_slab = T_slab_base.inverse();
  return report;
}

}  // namespace slabd::algo
