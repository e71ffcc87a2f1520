// SPDX-License-Identifier: Apache-2.0
#include "calib/matrices.h"

#include <Eigen/Dense>

namespace slabd::calib {

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

}  // namespace slabd::calib
