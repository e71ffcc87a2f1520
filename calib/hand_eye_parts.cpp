// SPDX-License-Identifier: Apache-2.0
//
// A set of views is as good as the direction that it determines worst. Rotations are compared with shifts at half a
// metre from the flange, the scanner's working distance.
#include "calib/hand_eye_parts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

constexpr double kLever_mm = 500.0;

Eigen::VectorXd scales_of(const Equations& equations) {
  Eigen::VectorXd scales = Eigen::VectorXd::Ones(equations.parameters());
  scales.segment<3>(3).setConstant(1.0 / kLever_mm);
  if (equations.kind() == ArtefactKind::pose) scales.segment<3>(9).setConstant(1.0 / kLever_mm);
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
  // Smaller eigenvalues are below the rounding error of the normal matrix; such a direction is not determined anyway.
  constexpr double kNothing = 1e-13;
  const double floor = kNothing * parts.values[n - 1];
  Eigen::VectorXd inverse = Eigen::VectorXd::Zero(n);
  for (int k = 0; k < n; ++k)
    if (parts.values[k] > floor) inverse[k] = 1.0 / parts.values[k];
  return carried(scales.asDiagonal() * parts.vectors, inverse.asDiagonal());
}

Degeneracy degeneracy_of(const Equations& equations, std::span<const std::size_t> chosen, const Linearised& linear) {
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
  Degeneracy degeneracy;
  degeneracy.smallest = parts.values[n - 1];
  degeneracy.condition =
      degeneracy.smallest > 0.0 ? parts.values[0] / degeneracy.smallest : std::numeric_limits<double>::infinity();
  const Eigen::VectorXd worst = parts.right.col(n - 1);
  const Eigen::Vector3d shift = worst.head<3>();
  const Eigen::Vector3d turn = worst.segment<3>(3);
  if (turn.norm() > shift.norm())
    degeneracy.text = "how the scanner is turned about its " + direction(turn) + " axis";
  else
    degeneracy.text = "where the scanner sits along the flange's " + direction(shift) + " axis";
  return degeneracy;
}

// The whitened residuals w of a set have the covariance s^2 I if the views have independent errors. If views of one
// place share a part of it, rows of the same meaning (slots) of two such views have the covariance s^2 share. Then
//
//     E |w|^2      = s^2 (F - share h)     F = rows - leverage
//     E |within|^2 = s^2 (1 - share) d     within: from the mean of its slot in its place; d degrees of freedom
//
// where h sums j N^-1 k' over pairs of rows j, k of one slot, the part of a shared error that the parameters absorb.
// Two equations give s and the share. A sandwich of squared sums of residuals would need no model. Its accuracy is
// insufficient for ten places with 30 equations and 9 parameters, with and without repeats.

namespace {

constexpr std::size_t kRowKinds = 2;  ///< rotations, positions

/// Slot of a row. Rows of the same slot have the same meaning in every view: an axis of a ball, or of the artefact's
/// rotation or origin.
int slot_of(const Equations& equations, std::size_t view, int row) {
  if (equations.kind() == ArtefactKind::pose) return row;
  return 3 * static_cast<int>(equations.view(view).balls[static_cast<std::size_t>(row / 3)].ball) + row % 3;
}

int slots(const Equations& equations) {
  return equations.kind() == ArtefactKind::pose ? 6 : 3 * static_cast<int>(equations.targets());
}

struct Slot {
  double count = 0.0;
  double sum = 0.0;
  double squares = 0.0;
  double leverage = 0.0;
  Eigen::RowVectorXd J;
};

}  // namespace

std::vector<std::vector<std::size_t>> places_of(const Equations& equations, std::span<const std::size_t> chosen) {
  std::vector<std::vector<std::size_t>> places;
  for (const std::size_t i : chosen) {
    const Pose& pose = equations.view(i).T_base_flange;
    const auto known = std::find_if(places.begin(), places.end(), [&](const std::vector<std::size_t>& place) {
      return same_place(equations.view(place.front()).T_base_flange, pose);
    });
    if (known == places.end())
      places.push_back({i});
    else
      known->push_back(i);
  }
  return places;
}

SharedErrors shared_errors(const Equations& equations, std::span<const std::size_t> chosen, const Linearised& linear) {
  const std::vector<std::vector<std::size_t>> places = places_of(equations, chosen);
  SharedErrors shared;
  shared.repeats = places.size() < chosen.size();
  if (!shared.repeats) return shared;

  const Eigen::MatrixXd inverse = parameter_covariance(equations, chosen, linear);
  double squares = 0.0;
  double freedom = 0.0;
  std::array<double, kRowKinds> within{};
  std::array<double, kRowKinds> within_freedom{};
  std::array<double, kRowKinds> followed{};  // h
  for (const std::vector<std::size_t>& place : places) {
    std::vector<Slot> seen(static_cast<std::size_t>(slots(equations)));
    for (const std::size_t i : place)
      for (int row = 0; row < equations.rows(i); ++row) {
        Slot& slot = seen[static_cast<std::size_t>(slot_of(equations, i, row))];
        const Eigen::RowVectorXd J = linear.J[i].row(row);
        const double w = linear.w[i][row];
        slot.J = slot.count > 0.0 ? Eigen::RowVectorXd(slot.J + J) : J;
        slot.count += 1.0;
        slot.sum += w;
        slot.squares += w * w;
        slot.leverage += carried(J, inverse).value();
      }
    for (std::size_t k = 0; k < seen.size(); ++k) {
      const Slot& slot = seen[k];
      if (slot.count < 1.0) continue;
      squares += slot.squares;
      freedom += slot.count - slot.leverage;
      if (slot.count < 2.0) continue;
      const std::size_t part = static_cast<int>(k) < equations.rotation_rows() ? 0 : 1;
      within[part] += std::max(0.0, slot.squares - slot.sum * slot.sum / slot.count);
      within_freedom[part] += slot.count - 1.0;
      followed[part] += carried(slot.J, inverse).value() - slot.leverage;
    }
  }

  // Redundancy if every place were one view, with each equation counted as often as it was repeated.
  constexpr double kSome = 0.5;
  double rest = freedom;
  double left = squares;
  std::array<double, kRowKinds> anew{};  // independent part of the variance
  for (std::size_t k = 0; k < kRowKinds; ++k) {
    anew[k] = within_freedom[k] > 0.0 ? within[k] / within_freedom[k] : 0.0;
    rest -= followed[k];
    left -= anew[k] * followed[k];
  }
  std::array<double, kRowKinds> share{1.0, 1.0};
  const bool tells = rest > kSome && left > 0.0;
  for (std::size_t k = 0; k < kRowKinds && tells; ++k) share[k] = std::clamp(1.0 - anew[k] * rest / left, 0.0, 1.0);
  double expected = freedom;
  for (std::size_t k = 0; k < kRowKinds; ++k) expected -= share[k] * followed[k];
  if (equations.rotation_rows() == 0) share[0] = 0.0;
  shared.rotation_share = share[0];
  shared.position_share = share[1];
  double pairs = 0.0;
  for (const std::vector<std::size_t>& place : places) pairs += static_cast<double>(place.size() * (place.size() - 1));
  shared.design_effect = 1.0 + pairs / static_cast<double>(chosen.size()) * std::max(share[0], share[1]);
  if (tells && expected > kSome) shared.size = std::sqrt(squares / expected);
  return shared;
}

Eigen::MatrixXd covariance_of_estimate(const Equations& equations, std::span<const std::size_t> chosen,
                                       const Linearised& linear, const State& state, const Weighing& weighing,
                                       const Weighing& errors, const SharedErrors& shared) {
  const Eigen::MatrixXd N_inverse = parameter_covariance(equations, chosen, linear);
  const auto parameters = N_inverse.rows();
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(parameters, parameters);
  for (const std::vector<std::size_t>& place : places_of(equations, chosen)) {
    Eigen::MatrixXd together = Eigen::MatrixXd::Zero(parameters, slots(equations));
    for (const std::size_t i : place) {
      // w = L^-1 r has the covariance (L^-1 K) (L^-1 K)' if r has K K'.
      const Eigen::MatrixXd K = inverse(equations.whitener(i, state, errors));
      Eigen::MatrixXd scores = transposed_product(linear.J[i], product(equations.whitener(i, state, weighing), K));
      if (place.size() > 1)
        for (int row = 0; row < scores.cols(); ++row) {
          const double share = row < equations.rotation_rows() ? shared.rotation_share : shared.position_share;
          together.col(slot_of(equations, i, row)) += std::sqrt(share) * scores.col(row);
          scores.col(row) *= std::sqrt(1.0 - share);
        }
      sum += product(scores, scores.transpose());
    }
    if (place.size() > 1) sum += product(together, together.transpose());
  }
  return carried(N_inverse, sum);
}

// The covariance of a view's residual is a sum of three known matrices with unknown factors,
//
//     V = a V_position + b V_robot_rotation + c V_target_rotation.
//
// With P = W - W J N^-1 J' W, W = V^-1, N = J' W J, restricted maximum likelihood requires r' P V_k P r = tr(P V_k) for
// each k. The ratio of both sides is the correction of the factor, which stays positive. Views are independent, so
// every sum is over 6 x 6 blocks.

namespace {

constexpr std::size_t kParts = 3;
using Factors = std::array<double, kParts>;

/// One view: residual, derivative, and the parts of its covariance for the stated noise.
struct Block {
  Eigen::VectorXd r;
  Eigen::MatrixXd J;
  std::array<Eigen::MatrixXd, kParts> V;
};

struct Step {
  Factors corrections{};
  double likelihood = 0.0;  ///< twice its logarithm, without constants
};

Step evaluate(const std::vector<Block>& blocks, const Factors& factors) {
  const auto parameters = blocks.front().J.cols();
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(parameters, parameters);
  Eigen::VectorXd g = Eigen::VectorXd::Zero(parameters);
  std::array<Eigen::MatrixXd, kParts> G;
  G.fill(N);
  std::vector<Eigen::MatrixXd> weights;
  Step step;
  Factors traces{};
  for (const Block& block : blocks) {
    Eigen::MatrixXd V = Eigen::MatrixXd::Zero(block.r.size(), block.r.size());
    for (std::size_t k = 0; k < kParts; ++k) V += factors[k] * block.V[k];
    const Eigen::MatrixXd L_inverse = inverse_cholesky(V);
    const Eigen::MatrixXd W = transposed_product(L_inverse, L_inverse);
    const Eigen::MatrixXd WJ = product(W, block.J);
    N += transposed_product(block.J, WJ);
    g += transposed_product(WJ, block.r);
    for (std::size_t k = 0; k < kParts; ++k) {
      G[k] += transposed_product(WJ, product(block.V[k], WJ));
      traces[k] += W.cwiseProduct(block.V[k]).sum();  // both are symmetric
    }
    step.likelihood += 2.0 * L_inverse.diagonal().array().log().sum();
    weights.push_back(W);
  }
  const Eigen::VectorXd beta = solve_symmetric(N, g);
  step.likelihood -= log_determinant(N);
  Factors squares{};
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const Eigen::VectorXd e = blocks[i].r - product(blocks[i].J, beta);
    const Eigen::VectorXd We = product(weights[i], e);
    step.likelihood -= e.dot(We);
    for (std::size_t k = 0; k < kParts; ++k) squares[k] += We.dot(product(blocks[i].V[k], We).col(0));
  }
  for (std::size_t k = 0; k < kParts; ++k) {
    const double trace = traces[k] - solve_symmetric(N, G[k]).trace();
    step.corrections[k] = trace > 0.0 ? squares[k] / trace : 1.0;
  }
  return step;
}

}  // namespace

Components estimate_components(const Equations& equations, std::span<const std::size_t> kept, const State& state,
                               const Weighing& stated) {
  const auto times = [&](double position, double robot_rotation, double target_rotation) {
    return Weighing{stated.noise, position, robot_rotation, target_rotation, stated.lever};
  };
  std::vector<Block> blocks;
  for (const std::size_t i : kept) {
    Block block;
    equations.residual(i, state, block.r, &block.J);
    block.V = {equations.covariance(i, state, times(1.0, 0.0, 0.0)),
               equations.covariance(i, state, times(0.0, 1.0, 0.0)),
               equations.covariance(i, state, times(0.0, 0.0, 1.0))};
    blocks.push_back(std::move(block));
  }
  // One common factor has a closed form: all corrections weighted by their traces; one iteration is enough.
  constexpr int kStepsMax = 300;
  constexpr double kSettled = 1e-4;
  constexpr double kFactorMin = 1e-6;
  double squares = 0.0;
  for (const Block& block : blocks) squares += static_cast<double>(block.r.size());
  const double freedom = squares - equations.parameters();
  Components components{times(1.0, 1.0, 1.0), 0.0};
  if (!(freedom > static_cast<double>(kParts))) return components;

  double chi2 = 0.0;
  for (std::size_t k = 0; k < kept.size(); ++k)
    chi2 += (equations.whitener(kept[k], state, times(1.0, 1.0, 1.0)) * blocks[k].r).squaredNorm();
  const double common = std::max(chi2 / freedom, kFactorMin);
  Factors factors = {common, common, common};
  Step step = evaluate(blocks, factors);
  const double as_stated = step.likelihood;
  for (int n = 0; n < kStepsMax; ++n) {
    double change = 0.0;
    for (std::size_t k = 0; k < kParts; ++k) {
      const double next = std::max(factors[k] * step.corrections[k], kFactorMin);
      change = std::max(change, std::abs(std::log(next / factors[k])));
      factors[k] = next;
    }
    step = evaluate(blocks, factors);
    if (change < kSettled) break;
  }
  components.gain = step.likelihood - as_stated;
  components.weighing = times(std::sqrt(factors[0]), std::sqrt(factors[1]), std::sqrt(factors[2]));
  return components;
}

}  // namespace slabd::calib
