// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

/// Linear algebra on matrices of any size, as plain functions: Eigen's products and decompositions are templates, and
/// every file that writes them compiles them again, half a minute in the worst. Internal to the room.
namespace slabd::calib {

/// A B
[[nodiscard]] Eigen::MatrixXd product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
/// A' B
[[nodiscard]] Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
/// A V A', the covariance V carried through A.
[[nodiscard]] Eigen::MatrixXd carried(const Eigen::MatrixXd& A, const Eigen::MatrixXd& V);

/// Of any square matrix; not finite where it is singular.
[[nodiscard]] Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);

/// The X of N X = B for a symmetric N, by L D L'.
[[nodiscard]] Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& N, const Eigen::MatrixXd& B);

/// Of |det N| of a symmetric N.
[[nodiscard]] double log_determinant(const Eigen::MatrixXd& N);

/// The shortest x for which |A x - b| is least, whatever the rank of A.
[[nodiscard]] Eigen::VectorXd solve_least_squares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

/// N = vectors diag(values) vectors' of a symmetric N; values ascend.
struct SymmetricParts {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
[[nodiscard]] SymmetricParts symmetric_parts(const Eigen::MatrixXd& N);

/// Singular values, descending, and the right singular vectors of a matrix with no fewer rows than columns.
struct SingularParts {
  Eigen::VectorXd values;
  Eigen::MatrixXd right;
};
[[nodiscard]] SingularParts singular_parts(const Eigen::MatrixXd& A);

/// The inverse of the lower triangle L of V = L L', for a positive definite V.
[[nodiscard]] Eigen::MatrixXd inverse_cholesky(const Eigen::MatrixXd& V);

}  // namespace slabd::calib
