// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "algo/casing_ties.h"
#include "base/base.h"

namespace slabd::algo {

using Vec6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;

/// Gauss-Newton normal equations of one step: H * motion = -g. Motions are (x, y, z, turn about X, Y, Z) in the block
/// frame about its origin, turns as lengths at the end of a lever of 150 mm, so that all six are of like effect.
struct NormalEquations {
  Mat6 H = Mat6::Zero();
  Vec6 g = Vec6::Zero();
  std::size_t points = 0;
};

/// Point-to-plane ICP of a sample (scanner frame) to the block model with Tukey weights.
class Icp {
 public:
  static constexpr double kLever_mm = 150.0;

  /// `faces`: memory for a face per sampled point.
  Icp(const BlockModel& model, const FaceTable& table, const EvaluationSettings& settings, std::span<const Vec3> sample,
      std::span<std::uint8_t> faces)
      : model_(model), table_(table), settings_(settings), sample_(sample), faces_(faces) {}

  /// Gives each point to its face for the steps within `single_face_gate`. Between two calls those steps work on one
  /// smooth problem, which has a fixed point; points that change sides with every step have none.
  void associate(const Pose& T_block_scanner);

  /// One Gauss-Newton step at `gate` on every `stride`-th point; returns the step's length, negative if unsolvable.
  double step(Pose& T_block_scanner, double gate_mm, std::size_t stride, NormalEquations& eq) const;

  /// The face of a point in the block frame: up to `single_face_gate` only where a single one is near, beyond it the
  /// closest of those in reach.
  [[nodiscard]] bool face_of(const Vec3& p, double gate_mm, Face& face, double& distance) const {
    const bool far = gate_mm > single_face_gate();
    const std::uint16_t candidates = far ? table_.wide_at(p) : table_.near_at(p);
    return (far || std::has_single_bit(candidates)) && closest_face(model_.planes(), candidates, p, face, distance) &&
           std::abs(distance) < gate_mm;
  }
  [[nodiscard]] double single_face_gate() const { return settings_.registration_gate_mm; }

  /// Ties take part in every further step, each with the weight of so many points.
  void hold(const FixedVector<Tie, 4>& ties, double points_each) {
    ties_ = ties;
    tie_weight_ = points_each;
  }

  /// The normal equations of the last steps with the points of some faces (bits) only, and the ties.
  [[nodiscard]] NormalEquations information(const Pose& T_block_scanner, double gate_mm, std::uint16_t faces) const {
    return accumulate(T_block_scanner, gate_mm, 1, faces);
  }

  /// How far a motion carries the rim of the block.
  [[nodiscard]] static double length_mm(const Pose& motion) {
    return motion.translation_mm.norm() + kLever_mm * angle_between_rad(motion.rotation, Quat::Identity());
  }

  /// Covariance of the pose at its fixed point (RegistrationReport::covariance), by the M-estimator's sandwich
  /// A^-1 B A^-1 (Huber 1981): A sums psi', B the scatter of psi face by face. So neither the weights, nor faces on
  /// which the noise is seen at a slant, nor a face a little off the model make it say more or less than the noise.
  [[nodiscard]] Mat6 covariance(const Pose& T_block_scanner, double gate_mm) const;

  /// Robust standard deviation of the distances that take part at `gate_mm`. `memory`: one for each sampled point.
  [[nodiscard]] double noise_mm(const Pose& T_block_scanner, double gate_mm, std::span<double> memory) const;

 private:
  [[nodiscard]] NormalEquations accumulate(const Pose& pose, double gate_mm, std::size_t stride,
                                           std::uint16_t faces = kAllFaces) const;
  /// Calls visit(face, distance, jacobian) for the points that take part.
  template <typename Visit>
  void each_point(const Pose& pose, double gate_mm, std::size_t stride, Visit&& visit) const;

  const BlockModel& model_;
  const FaceTable& table_;
  const EvaluationSettings& settings_;
  std::span<const Vec3> sample_;
  std::span<std::uint8_t> faces_;
  FixedVector<Tie, 4> ties_;
  double tie_weight_ = 0.0;
};

}  // namespace slabd::algo
