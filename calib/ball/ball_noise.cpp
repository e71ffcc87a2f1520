// SPDX-License-Identifier: Apache-2.0
//
// Uncertainty of the centre. Ten thousand points with independent errors would determine it to half a micrometre. A
// scanner's errors are correlated over several pixels, so the effective number of points is smaller: with 2 mm of
// correlation the centre is ten times worse.
//
// The covariance is the sandwich A^-1 B A^-1 of an M-estimator (A = sum psi' g g', g = gradient of the residual). B is
// the sum over pairs of points of the covariance of their errors. That covariance is estimated from the residuals: in a
// raster across the view, mean products of residuals by distance, up to where they are insignificant. The fit uses
// three of about ninety degrees of freedom. Errors longer than a third of the cap are not detectable in the fit; they
// appear only as scatter between views.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "calib/ball/ball_fit.h"

namespace slabd::calib {
namespace {

using Vec4 = Eigen::Matrix<double, 4, 1, Eigen::DontAlign>;
using Mat44 = Eigen::Matrix<double, 4, 4, Eigen::DontAlign>;

/// Largest correlation distance as a share of the ball's radius; beyond it the fit absorbs the errors.
constexpr double kLagMax = 0.45;
/// Largest number of raster cells across the cap: 1e6 products.
constexpr double kCellsAcross = 64.0;
/// Smallest significant correlation in standard errors.
constexpr double kSignificant = 3.0;

struct RasterCell {
  double n = 0.0;
  double sum = 0.0;       ///< sum of residuals
  double squares = 0.0;   ///< sum of their squares
  Vec4 g = Vec4::Zero();  ///< sum of weighted gradients
};

/// The cap in cells across the view.
struct Raster {
  int size = 0;
  double cell_mm = 0.0;
  std::vector<RasterCell> cells;
  [[nodiscard]] const RasterCell* at(int x, int y) const {
    if (x < 0 || y < 0 || x >= size || y >= size) return nullptr;
    const RasterCell& cell =
        cells[static_cast<std::size_t>(y) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x)];
    return cell.n > 0.0 ? &cell : nullptr;
  }
};

/// Calls visit(cell, other cell, distance bin) for every pair of filled cells up to `lags` cells apart, each once.
template <typename Visit>
void each_pair(const Raster& raster, int lags, const Visit& visit) {
  for (int y = 0; y < raster.size; ++y)
    for (int x = 0; x < raster.size; ++x) {
      const RasterCell* const a = raster.at(x, y);
      if (a == nullptr) continue;
      for (int dy = 0; dy <= lags; ++dy)
        for (int dx = dy == 0 ? 1 : -lags; dx <= lags; ++dx) {
          const auto bin = static_cast<std::size_t>(std::lround(std::hypot(dx, dy)));
          if (bin > static_cast<std::size_t>(lags)) continue;
          if (const RasterCell* const b = raster.at(x + dx, y + dy); b != nullptr) visit(*a, *b, bin);
        }
    }
}

/// Covariance of two points' errors by their distance in cells; 0 from where it is insignificant. [0] is for points of
/// the same cell.
std::vector<double> covariance_by_distance(const Raster& raster, int lags, double variance) {
  std::vector<double> products(static_cast<std::size_t>(lags) + 1, 0.0);
  std::vector<double> pairs(products.size(), 0.0);
  for (const RasterCell& cell : raster.cells) {
    products[0] += 0.5 * (cell.sum * cell.sum - cell.squares);
    pairs[0] += 0.5 * (cell.n * cell.n - cell.n);
  }
  each_pair(raster, lags, [&](const RasterCell& a, const RasterCell& b, std::size_t bin) {
    products[bin] += a.sum * b.sum;
    pairs[bin] += a.n * b.n;
  });
  std::vector<double> covariance(products.size(), 0.0);
  for (std::size_t bin = 0; bin < products.size(); ++bin) {
    if (pairs[bin] < 1.0) break;
    const double value = products[bin] / pairs[bin];
    if (value < kSignificant * variance / std::sqrt(pairs[bin])) break;
    covariance[bin] = value;
  }
  return covariance;
}

}  // namespace

CapNoise cap_noise(std::span<const Vec3> points_mm, const SphereFit& fit, const Vec3& viewpoint_mm,
                   double least_length_mm) {
  CapNoise noise;
  const Mat3 axes = view_axes(fit.centre_mm, viewpoint_mm);
  // Cells of at least two pitches, so that most contain a few points.
  const double reach = fit.radius_mm;
  const double pitch = std::sqrt(kPi * 0.75 * reach * reach / static_cast<double>(std::max<std::size_t>(fit.kept, 1)));
  Raster raster;
  raster.cell_mm = std::max(2.0 * pitch, 2.0 * reach / kCellsAcross);
  raster.size = 2 * static_cast<int>(std::ceil(1.1 * reach / raster.cell_mm)) + 1;
  raster.cells.resize(static_cast<std::size_t>(raster.size) * static_cast<std::size_t>(raster.size));

  Mat44 slope = Mat44::Zero();   // sum of psi' g g'
  Mat44 square = Mat44::Zero();  // sum of psi^2 g g'
  Vec3 drift = Vec3::Zero();     // sum of psi' u
  double squares = 0.0;
  double kept = 0.0;
  for (const Vec3& p : points_mm) {
    const Vec3 d = p - fit.centre_mm;
    const double length = d.norm();
    const double residual = length - fit.radius_mm;
    const TukeyWeight w = tukey(residual, fit.scale_mm);
    if (w.weight == 0.0 || length == 0.0) continue;
    const Vec4 g(d.x() / length, d.y() / length, d.z() / length, 1.0);
    slope += w.slope * g * g.transpose();
    square += w.weight * w.weight * residual * residual * g * g.transpose();
    drift += w.slope * Vec3(g.head<3>());
    squares += residual * residual;
    kept += 1.0;
    const int half = raster.size / 2;
    const int x = std::clamp(static_cast<int>(std::lround(d.dot(axes.col(0)) / raster.cell_mm)) + half, 0, 2 * half);
    const int y = std::clamp(static_cast<int>(std::lround(d.dot(axes.col(1)) / raster.cell_mm)) + half, 0, 2 * half);
    RasterCell& cell =
        raster.cells[static_cast<std::size_t>(y) * static_cast<std::size_t>(raster.size) + static_cast<std::size_t>(x)];
    cell.n += 1.0;
    cell.sum += residual;
    cell.squares += residual * residual;
    cell.g += w.weight * g;
  }
  const Eigen::LDLT<Eigen::Matrix4d> slope4{Eigen::Matrix4d(slope)};
  const Eigen::LDLT<Eigen::Matrix3d> slope3{Eigen::Matrix3d(slope.topLeftCorner<3, 3>())};
  if (kept < 10.0 || slope3.info() != Eigen::Success || !slope3.isPositive()) return noise;
  const double variance = squares / (kept - 3.0);

  const int lags = std::max(1, static_cast<int>(kLagMax * reach / raster.cell_mm));
  std::vector<double> covariance = covariance_by_distance(raster, lags, variance);
  noise.correlated_mm = std::sqrt(covariance[0]);
  noise.correlation_length_mm = 0.0;
  for (std::size_t bin = 0; bin < covariance.size() && covariance[bin] > covariance[0] / std::exp(1.0); ++bin)
    noise.correlation_length_mm = (static_cast<double>(bin) + 0.5) * raster.cell_mm;
  if (least_length_mm > 0.0)
    for (std::size_t bin = 0; bin < covariance.size(); ++bin) {
      const double over = static_cast<double>(bin) * raster.cell_mm / least_length_mm;
      covariance[bin] = std::max(covariance[bin], variance * std::exp(-over * over));
    }

  const double common = std::min(1.0, covariance[0] / variance);
  const Mat44 alone = (1.0 - common) * square;
  Mat44 together = common * square;
  if (covariance[0] > 0.0) {
    for (const RasterCell& cell : raster.cells)
      if (cell.n > 1.0) together += covariance[0] * (1.0 - 1.0 / cell.n) * cell.g * cell.g.transpose();
    each_pair(raster, lags, [&](const RasterCell& a, const RasterCell& b, std::size_t bin) {
      if (covariance[bin] == 0.0) return;
      const Mat44 product = a.g * b.g.transpose();
      together += covariance[bin] * (product + product.transpose());
    });
  }
  const auto between = [](const auto& outer, const auto& inner) {
    using Mat = Eigen::Matrix<double, std::decay_t<decltype(inner)>::RowsAtCompileTime,
                              std::decay_t<decltype(inner)>::RowsAtCompileTime>;
    const Mat half = outer.solve(Mat(inner));
    return Mat(outer.solve(Mat(half.transpose())));
  };
  const Eigen::Matrix3d alone3 = alone.topLeftCorner<3, 3>();
  const Eigen::Matrix3d together3 = together.topLeftCorner<3, 3>();
  noise.cov_white_mm2 = between(slope3, alone3);
  noise.cov_correlated_mm2 = between(slope3, together3);
  // A covariance truncated at a distance may be indefinite; negative eigenvalues are sampling errors of zero.
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> split{Eigen::Matrix3d(noise.cov_correlated_mm2)};
  noise.cov_correlated_mm2 =
      split.eigenvectors() * split.eigenvalues().cwiseMax(0.0).asDiagonal() * split.eigenvectors().transpose();
  noise.shift_per_radius = -slope3.solve(Eigen::Vector3d(drift));
  if (slope4.info() == Eigen::Success && slope4.isPositive()) {
    const Eigen::Matrix4d free = between(slope4, Eigen::Matrix4d(alone + together));
    noise.radius_sigma_mm = std::sqrt(std::max(0.0, free(3, 3)));
  }
  return noise;
}

}  // namespace slabd::calib
