// SPDX-License-Identifier: Apache-2.0
#include "calib/mathematics.h"

#include <Eigen/Dense>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "base/units.h"

namespace slabd::calib {

Mat3 skew(const Vec3& v) {
  Mat3 m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Quat exp_rotation(const Vec3& v) {
  const double angle = v.norm();
  const double half = 0.5 * angle;
  // sin(half) / angle, by its series if the quotient would lose digits.
  const double s = angle > 1e-4 ? std::sin(half) / angle : 0.5 - half * half / 12.0;
  return Quat(std::cos(half), s * v.x(), s * v.y(), s * v.z());
}

Vec3 log_rotation(const Quat& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const Vec3 v = sign * q.vec();
  const double s = v.norm();
  const double half = std::atan2(s, sign * q.w());
  return s > 1e-9 ? Vec3(v * (2.0 * half / s)) : Vec3(v * 2.0);
}

Mat3 left_jacobian_inverse(const Vec3& r) {
  const double angle = r.norm();
  const Mat3 S = skew(r);
  const double k = angle > 1e-3 ? 1.0 / (angle * angle) - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle))
                                : 1.0 / 12.0 + angle * angle / 720.0;
  return Mat3::Identity() - 0.5 * S + k * S * S;
}

Mat3 nearest_rotation(const Mat3& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(Eigen::Matrix3d(m), Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  flip(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  return svd.matrixU() * flip * svd.matrixV().transpose();
}

Pose rigid_fit(std::span<const Vec3> from, std::span<const Vec3> to) {
  Vec3 from_mean = Vec3::Zero();
  Vec3 to_mean = Vec3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    from_mean += from[i];
    to_mean += to[i];
  }
  from_mean /= static_cast<double>(from.size());
  to_mean /= static_cast<double>(to.size());
  Mat3 H = Mat3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) H += (to[i] - to_mean) * (from[i] - from_mean).transpose();
  Pose pose;
  pose.rotation = Quat(nearest_rotation(H)).normalized();
  pose.translation_mm = to_mean - pose.rotation * from_mean;
  return pose;
}

Quat rotation_between(const Vec3& from, const Vec3& to) {
  const Vec3 a = from.normalized();
  const Vec3 b = to.normalized();
  const Vec3 axis = a.cross(b);
  const double w = 1.0 + a.dot(b);
  // Opposite directions: a rotation by 180 degrees about any axis perpendicular to them.
  if (w < 1e-12) {
    const Vec3 normal = a.unitOrthogonal();
    return Quat(0.0, normal.x(), normal.y(), normal.z());
  }
  return Quat(w, axis.x(), axis.y(), axis.z()).normalized();
}

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

Matrix product(const Matrix& A, const Matrix& B) {
  return A * B;
}

Matrix transposed_product(const Matrix& A, const Matrix& B) {
  return A.transpose() * B;
}

Matrix carried(const Matrix& A, const Matrix& V) {
  return A * V * A.transpose();
}

Matrix inverse(const Matrix& A) {
  return A.inverse();
}

Matrix solve_symmetric(const Matrix& N, const Matrix& B) {
  return N.ldlt().solve(B);
}

double log_determinant(const Matrix& N) {
  return N.ldlt().vectorD().array().abs().log().sum();
}

Vector solve_least_squares(const Matrix& A, const Vector& b) {
  return A.completeOrthogonalDecomposition().solve(b);
}

SymmetricParts symmetric_parts(const Matrix& N) {
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(N);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

SingularParts singular_parts(const Matrix& A) {
  const Eigen::JacobiSVD<Matrix> svd(A, Eigen::ComputeThinV);
  return {svd.singularValues(), svd.matrixV()};
}

Matrix inverse_cholesky(const Matrix& V) {
  return V.llt().matrixL().solve(Matrix::Identity(V.rows(), V.cols()));
}

// The upper tail of chi-square with n degrees of freedom is a finite sum: with h = x / 2
//
//     n even: exp(-h) sum_{j < n/2} h^j / j!
//     n odd:  erfc(sqrt h) + exp(-h) sum_{j < (n-1)/2} h^(j + 1/2) / Gamma(j + 3/2)
//
// All values are logarithms, so that a residual of a thousand sigmas differs from one of two thousand.

namespace {

/// log(erfc(z)), z >= 0.
double log_erfc(double z) {
  if (z < 20.0) return std::log(std::erfc(z));
  return -z * z - std::log(z * std::sqrt(kPi)) + std::log1p(-0.5 / (z * z));
}

double log_sum(double a, double b) {
  const double high = std::max(a, b);
  return high + std::log(std::exp(a - high) + std::exp(b - high));
}

double log_tail(double x, int freedom) {
  const double h = 0.5 * x;
  const double log_h = std::log(h);
  const bool odd = freedom % 2 == 1;
  double sum = odd ? log_erfc(std::sqrt(h)) : -h;
  for (int j = odd ? 0 : 1; j < freedom / 2; ++j) {
    const double power = odd ? j + 0.5 : j;
    sum = log_sum(sum, power * log_h - h - std::lgamma(power + 1.0));
  }
  return sum;
}

}  // namespace

double normal_sigmas(double x, int freedom) {
  if (!std::isfinite(x) || freedom < 1) return x;
  if (x <= 0.0) return 0.0;
  const double wanted = log_tail(x, freedom);
  double low = 0.0;
  double high = std::sqrt(x) + 1.0;  // more degrees of freedom make the same sum more probable
  for (int k = 0; k < 80; ++k) {
    const double middle = 0.5 * (low + high);
    (log_erfc(middle / std::sqrt(2.0)) > wanted ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

double chi_square_median(int freedom) {
  const double n = freedom;
  const double third = 1.0 - 2.0 / (9.0 * n);
  return n * third * third * third;
}

}  // namespace slabd::calib
