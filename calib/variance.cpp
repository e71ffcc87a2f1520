// SPDX-License-Identifier: Apache-2.0
//
// The covariance of a view's residual is a sum of three known matrices with unknown factors,
//
//     V = a V_position + b V_robot_rotation + c V_target_rotation.
//
// With P = W - W J N^-1 J' W, W = V^-1, N = J' W J, restricted maximum likelihood asks for r' P V_k P r = tr(P V_k) for
// each k. The ratio of both sides is the next factor's correction; factors stay positive, and views being independent
// every sum is over 6 x 6 blocks.
#include "calib/variance.h"

#include <array>
#include <cmath>
#include <vector>

#include "calib/matrices.h"

namespace slabd::calib {
namespace {

constexpr std::size_t kParts = 3;
using Factors = std::array<double, kParts>;

/// One view: residual, derivative, and the covariance's parts for noise as stated.
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
  // One common factor has a closed form: all corrections weighed by their traces; iterating it settles at once.
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
