// SPDX-License-Identifier: Apache-2.0
//
// Starting points of the adjustment. A closed form requires no prior knowledge of the scanner's pose and comes within a
// few per cent of the optimum, but one wrong view spoils it. Therefore it is also applied to small subsets drawn by a
// fixed generator, and the result that agrees with most views wins. Sets too small or too poor for the linear form use
// a grid of rotations. For a given rotation all other parameters are linear.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "calib/adjustment.h"
#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

constexpr std::uint64_t kSeed = 20;
constexpr std::size_t kBallSubset = 6;  // 18 equations for 15 unknowns
constexpr std::size_t kPoseSubset = 4;
constexpr std::size_t kStarts = 12;
constexpr double kRotationScale = 500.0;  // mm: scales the columns of vec R to the size of the others

using Chosen = std::vector<std::size_t>;

/// Calls f(point, target) for the points of a view: its balls, or the artefact's origin.
template <typename F>
void for_each_point(const Equations& equations, std::size_t i, F&& f) {
  const View& view = equations.view(i);
  if (equations.kind() == ArtefactKind::pose) {
    f(view.T_scanner_target.translation_mm, std::size_t{0});
    return;
  }
  for (const BallObservation& seen : view.balls) f(seen.centre_mm, seen.ball);
}

int points_in(const Equations& equations, const Chosen& chosen) {
  int points = 0;
  for (const std::size_t i : chosen) for_each_point(equations, i, [&](const Vec3&, std::size_t) { ++points; });
  return points;
}

/// Solves `R_X c + t_X - R_A' p' = -R_A' (t_A - m)`, p = p' + m, linear in (vec R_X, t_X, p'). With a known rotation it
/// solves only for the translations, else for both.
Eigen::VectorXd solve_linear(const Equations& equations, const Chosen& chosen, const Mat3* R_known) {
  const int offset = R_known == nullptr ? 9 : 0;
  const int unknowns = offset + 3 + 3 * static_cast<int>(equations.targets());
  const int rows = 3 * points_in(equations, chosen);
  Vec3 middle = Vec3::Zero();
  for (const std::size_t i : chosen)
    middle += equations.view(i).T_base_flange.translation_mm / static_cast<double>(chosen.size());
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(rows, unknowns);
  Eigen::VectorXd b(rows);
  int row = 0;
  for (const std::size_t i : chosen) {
    const Pose& A = equations.view(i).T_base_flange;
    const Mat3 R_back = A.rotation.conjugate().toRotationMatrix();
    for_each_point(equations, i, [&](const Vec3& c, std::size_t target) {
      Vec3 known = -(R_back * (A.translation_mm - middle));
      if (R_known == nullptr) {
        for (int k = 0; k < 3; ++k) M.block<3, 3>(row, 3 * k) = Mat3::Identity() * (c[k] / kRotationScale);
      } else {
        known -= *R_known * c;
      }
      M.block<3, 3>(row, offset).setIdentity();
      M.block<3, 3>(row, offset + 3 + 3 * static_cast<int>(target)) = -R_back;
      b.segment<3>(row) = Eigen::Vector3d(known);
      row += 3;
    });
  }
  return solve_least_squares(M, b);
}

Chosen everything(const Equations& equations) {
  Chosen all(equations.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// X and targets for a given rotation: t_X from the chosen views, each target as the median of its places in all views.
State complete(const Equations& equations, const Chosen& chosen, const Mat3& R_X) {
  State state;
  state.X.rotation = Quat(R_X).normalized();
  state.X.translation_mm = solve_linear(equations, chosen, &R_X).head<3>();
  state.targets.resize(equations.targets());
  for (std::size_t target = 0; target < equations.targets(); ++target) {
    std::array<std::vector<double>, 3> places;
    for (std::size_t i = 0; i < equations.size(); ++i)
      for_each_point(equations, i, [&](const Vec3& c, std::size_t of) {
        if (of != target) return;
        const Vec3 p = equations.view(i).T_base_flange * (state.X * c);
        for (std::size_t k = 0; k < 3; ++k) places[k].push_back(p[static_cast<int>(k)]);
      });
    for (std::size_t k = 0; k < 3; ++k)
      state.targets[target].translation_mm[static_cast<int>(k)] = places[k].empty() ? 0.0 : median(places[k]);
  }
  if (equations.kind() == ArtefactKind::pose) {
    // Selects the orientation of the target with the smallest median distance to those of the other views.
    double best = std::numeric_limits<double>::infinity();
    std::vector<Quat> turned;
    for (std::size_t i = 0; i < equations.size(); ++i)
      turned.push_back(equations.view(i).T_base_flange.rotation * state.X.rotation *
                       equations.view(i).T_scanner_target.rotation);
    for (const Quat& q : turned) {
      std::vector<double> angles;
      angles.reserve(turned.size());
      for (const Quat& other : turned) angles.push_back(angle_between_rad(q, other));
      if (const double m = median(angles); m < best) {
        best = m;
        state.targets[0].rotation = q.normalized();
      }
    }
  }
  return state;
}

/// Solves `(R_B' kron R_A) vec R_X - vec R_Z = 0` for the direction in which all views agree best.
Mat3 rotation_by_kronecker(const Equations& equations, const Chosen& chosen) {
  using Matrix9 = Eigen::Matrix<double, 9, 9>;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(18, 18);
  for (const std::size_t i : chosen) {
    const Mat3 R_A = equations.view(i).T_base_flange.rotation.toRotationMatrix();
    const Mat3 R_B = equations.view(i).T_scanner_target.rotation.toRotationMatrix();
    Matrix9 K;
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) K.block<3, 3>(3 * row, 3 * column) = R_B(column, row) * R_A;
    normal.topLeftCorner<9, 9>() += Matrix9::Identity();  // K'K = I, because K is orthogonal
    normal.topRightCorner<9, 9>() -= K.transpose();
    normal.bottomLeftCorner<9, 9>() -= K;
    normal.bottomRightCorner<9, 9>() += Matrix9::Identity();
  }
  const SymmetricParts parts = symmetric_parts(normal);
  Mat3 R;
  for (int k = 0; k < 9; ++k) R(k % 3, k / 3) = parts.vectors(k, 0);
  return nearest_rotation(R.determinant() < 0.0 ? Mat3(-R) : R);
}

Mat3 rotation_by_closed_form(const Equations& equations, const Chosen& chosen) {
  if (equations.kind() == ArtefactKind::pose) return rotation_by_kronecker(equations, chosen);
  const Eigen::VectorXd x = solve_linear(equations, chosen, nullptr);
  Mat3 R;
  for (int k = 0; k < 9; ++k) R(k % 3, k / 3) = x[k];
  return nearest_rotation(R);
}

/// The 24 rotations that permute the axes.
std::vector<Mat3> net_of_rotations() {
  std::vector<Mat3> net;
  for (int x = 0; x < 3; ++x)
    for (int y = 0; y < 3; ++y)
      for (const double sx : {1.0, -1.0})
        for (const double sy : {1.0, -1.0}) {
          if (x == y) continue;
          Mat3 R;
          R.col(0) = sx * Vec3::Unit(x);
          R.col(1) = sy * Vec3::Unit(y);
          R.col(2) = Vec3(R.col(0)).cross(Vec3(R.col(1)));
          net.push_back(R);
        }
  return net;
}

/// Logarithm of Cauchy's loss, which gives little weight to distant views.
double misfit(const Equations& equations, const Weighing& weighing, const State& state) {
  double sum = 0.0;
  Eigen::VectorXd r;
  for (std::size_t i = 0; i < equations.size(); ++i) {
    equations.residual(i, state, r, nullptr);
    sum += std::log1p(product(equations.whitener(i, state, weighing), r).squaredNorm() / equations.rows(i));
  }
  return sum;
}

Chosen draw(const Equations& equations, std::size_t count, Prng& random) {
  Chosen all = everything(equations);
  for (std::size_t k = 0; k < count; ++k) std::swap(all[k], all[k + random.below(all.size() - k)]);
  all.resize(count);
  std::sort(all.begin(), all.end());
  return all;
}

}  // namespace

double robust_size(const Equations& equations, const Weighing& weighing, const State& state) {
  std::vector<double> normalised;
  Eigen::VectorXd r;
  for (std::size_t i = 0; i < equations.size(); ++i) {
    equations.residual(i, state, r, nullptr);
    normalised.push_back(product(equations.whitener(i, state, weighing), r).squaredNorm() /
                         chi_square_median(equations.rows(i)));
  }
  return std::sqrt(median(std::move(normalised)));
}

std::vector<State> starting_points(const Equations& equations, const Weighing& weighing, int subsets) {
  const Chosen all = everything(equations);
  const std::size_t subset = equations.kind() == ArtefactKind::ball ? kBallSubset : kPoseSubset;
  struct Start {
    double misfit;
    State state;
  };
  std::vector<Start> starts;
  const auto offer = [&](const Chosen& chosen, const Mat3& R) {
    const State state = complete(equations, chosen, R);
    starts.push_back({misfit(equations, weighing, state), state});
  };
  offer(all, rotation_by_closed_form(equations, all));
  Prng random(kSeed);
  if (equations.size() > subset)
    for (int k = 0; k < subsets; ++k) {
      const Chosen some = draw(equations, subset, random);
      offer(some, rotation_by_closed_form(equations, some));
    }
  if (equations.kind() == ArtefactKind::ball)
    for (const Mat3& R : net_of_rotations()) offer(all, R);
  std::stable_sort(starts.begin(), starts.end(), [](const Start& a, const Start& b) { return a.misfit < b.misfit; });

  // Starts with nearly the same rotation lead to the same solution, so only different ones are kept.
  constexpr double kSame_rad = 0.02;
  std::vector<State> best;
  for (const Start& start : starts) {
    const bool known = std::any_of(best.begin(), best.end(), [&](const State& other) {
      return angle_between_rad(other.X.rotation, start.state.X.rotation) < kSame_rad;
    });
    if (!known) best.push_back(start.state);
    if (best.size() == kStarts) break;
  }
  return best;
}

}  // namespace slabd::calib
