// SPDX-License-Identifier: Apache-2.0
//
// A set of views is as good as the direction it determines worst. Rotations are compared with shifts at half a metre
// from the flange, where the scanner looks.
#include "calib/weakness.h"

#include <cmath>
#include <limits>

#include "calib/matrices.h"

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
    normal += transposed_product(J, J);
  }
  const SymmetricParts parts = symmetric_parts(normal);
  // Rounding in the normal matrix hides what is this much smaller; a direction like that is not determined anyway.
  constexpr double kNothing = 1e-13;
  const double floor = kNothing * parts.values[n - 1];
  Eigen::VectorXd inverse = Eigen::VectorXd::Zero(n);
  for (int k = 0; k < n; ++k)
    if (parts.values[k] > floor) inverse[k] = 1.0 / parts.values[k];
  return carried(scales.asDiagonal() * parts.vectors, inverse.asDiagonal());
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
  const SingularParts parts = singular_parts(J);
  Weakness weakness;
  weakness.smallest = parts.values[n - 1];
  weakness.condition =
      weakness.smallest > 0.0 ? parts.values[0] / weakness.smallest : std::numeric_limits<double>::infinity();
  const Eigen::VectorXd worst = parts.right.col(n - 1);
  const Eigen::Vector3d shift = worst.head<3>();
  const Eigen::Vector3d turn = worst.segment<3>(3);
  if (turn.norm() > shift.norm())
    weakness.text = "how the scanner is turned about its " + direction(turn) + " axis";
  else
    weakness.text = "where the scanner sits along the flange's " + direction(shift) + " axis";
  return weakness;
}

}  // namespace slabd::calib
