// SPDX-License-Identifier: Apache-2.0
//
// A set of views is as good as the direction it determines worst. Rotations are compared with shifts at half a metre
// from the flange, where the scanner looks.
#include "calib/weakness.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <cmath>
#include <limits>

namespace slabd::calib {
namespace {

constexpr double kLeverMm = 500.0;

Eigen::VectorXd scales_of(const Equations& equations) {
  Eigen::VectorXd scales = Eigen::VectorXd::Ones(equations.parameters());
  scales.segment<3>(3).setConstant(1.0 / kLeverMm);
  if (equations.kind() == ArtefactKind::pose) scales.segment<3>(9).setConstant(1.0 / kLeverMm);
  return scales;
}

std::string direction(const Eigen::Vector3d& v) {
  const Eigen::Vector3d unit = v.normalized();
  int axis = 0;
  unit.cwiseAbs().maxCoeff(&axis);
  constexpr double kAlong = 0.95;
  FixedString<64> text;
  if (std::abs(unit[axis]) > kAlong)
    text.printf("%c", "xyz"[axis]);
  else
    text.printf("(%.2f, %.2f, %.2f)", unit[0], unit[1], unit[2]);
  return std::string(text.view());
}

}  // namespace

Eigen::MatrixXd parameter_covariance(const Equations& equations, std::span<const std::size_t> chosen,
                                     const Linearised& linear) {
  const Eigen::VectorXd scales = scales_of(equations);
  const int n = equations.parameters();
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
  for (const std::size_t i : chosen) {
    const Eigen::MatrixXd J = linear.J[i] * scales.asDiagonal();
    normal += J.transpose() * J;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(normal);
  // Rounding in the normal matrix hides what is this much smaller; a direction like that is not determined anyway.
  constexpr double kNothing = 1e-13;
  const double floor = kNothing * solver.eigenvalues()[n - 1];
  Eigen::VectorXd inverse = Eigen::VectorXd::Zero(n);
  for (int k = 0; k < n; ++k)
    if (solver.eigenvalues()[k] > floor) inverse[k] = 1.0 / solver.eigenvalues()[k];
  const Eigen::MatrixXd V = scales.asDiagonal() * solver.eigenvectors();
  return V * inverse.asDiagonal() * V.transpose();
}

Weakness weakness_of(const Equations& equations, std::span<const std::size_t> chosen, const Linearised& linear) {
  const int n = equations.parameters();
  int rows = 0;
  for (const std::size_t i : chosen) rows += equations.rows(i);
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(std::max(rows, n), n);
  int row = 0;
  for (const std::size_t i : chosen) {
    J.middleRows(row, equations.rows(i)) = linear.J[i] * scales_of(equations).asDiagonal();
    row += equations.rows(i);
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(J, Eigen::ComputeThinV);
  Weakness weakness;
  weakness.smallest = svd.singularValues()[n - 1];
  weakness.condition =
      weakness.smallest > 0.0 ? svd.singularValues()[0] / weakness.smallest : std::numeric_limits<double>::infinity();
  const Eigen::VectorXd worst = svd.matrixV().col(n - 1);
  const Eigen::Vector3d shift = worst.head<3>();
  const Eigen::Vector3d turn = worst.segment<3>(3);
  if (turn.norm() > shift.norm())
    weakness.text = "how the scanner is turned about its " + direction(turn) + " axis";
  else
    weakness.text = "where the scanner sits along the flange's " + direction(shift) + " axis";
  return weakness;
}

}  // namespace slabd::calib
