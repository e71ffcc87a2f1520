// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "base/base.h"

/// Rotations, matrices and the chi-square distribution. Internal to the room.
namespace slabd::calib {

// ---- small rotations as vectors: axis times angle (rad)

[[nodiscard]] Mat3 skew(const Vec3& v);

[[nodiscard]] Quat exp_rotation(const Vec3& v);

/// Rotation vector of length 0..pi.
[[nodiscard]] Vec3 log_rotation(const Quat& q);

/// d log(exp(d) exp(r)) / dd at d = 0.
[[nodiscard]] Mat3 left_jacobian_inverse(const Vec3& r);

/// Rotation closest to a matrix.
[[nodiscard]] Mat3 nearest_rotation(const Mat3& m);

/// Motion that maps `from` to `to` best, unweighted (Kabsch 1976; Arun et al. 1987). Requires three points or more, not
/// on a line.
[[nodiscard]] Pose rigid_fit(std::span<const Vec3> from, std::span<const Vec3> to);

/// Shortest rotation from one direction (any length > 0) to another.
[[nodiscard]] Quat rotation_between(const Vec3& from, const Vec3& to);

// ---- matrices of any size
//
// Plain functions, because Eigen's products and decompositions are templates: every file that uses them compiles them
// again, in the worst case for half a minute.

/// A B
[[nodiscard]] Eigen::MatrixXd product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
/// A' B
[[nodiscard]] Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
/// A V A': covariance V propagated through A.
[[nodiscard]] Eigen::MatrixXd carried(const Eigen::MatrixXd& A, const Eigen::MatrixXd& V);

/// Inverse of any square matrix; not finite if it is singular.
[[nodiscard]] Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);

/// Solution X of N X = B for a symmetric N, by L D L'.
[[nodiscard]] Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& N, const Eigen::MatrixXd& B);

/// Logarithm of |det N| of a symmetric N.
[[nodiscard]] double log_determinant(const Eigen::MatrixXd& N);

/// Shortest x that minimises |A x - b|, for any rank of A.
[[nodiscard]] Eigen::VectorXd solve_least_squares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

/// N = vectors diag(values) vectors' of a symmetric N; ascending values.
struct SymmetricParts {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
[[nodiscard]] SymmetricParts symmetric_parts(const Eigen::MatrixXd& N);

/// Singular values, descending, and right singular vectors of a matrix with at least as many rows as columns.
struct SingularParts {
  Eigen::VectorXd values;
  Eigen::MatrixXd right;
};
[[nodiscard]] SingularParts singular_parts(const Eigen::MatrixXd& A);

/// Inverse of the lower triangle L of V = L L', for a positive definite V.
[[nodiscard]] Eigen::MatrixXd inverse_cholesky(const Eigen::MatrixXd& V);

// ---- probability of a sum of squares

/// |z| of a normal variable with the same tail probability as chi-square `x` with `freedom` >= 1 degrees of freedom.
/// Also computed for probabilities far below the smallest double.
[[nodiscard]] double normal_sigmas(double x, int freedom);

/// Median of chi-square with `freedom` degrees of freedom, to a per cent.
[[nodiscard]] double chi_square_median(int freedom);

}  // namespace slabd::calib
