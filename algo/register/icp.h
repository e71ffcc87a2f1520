// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "algo/register/casing_ties.h"
#include "algo/register/icp_kernels.h"
#include "base/base.h"
#include "base/team.h"

namespace slabd::algo {

using Vec6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;

/// Gauss-Newton normal equations of one step: H * motion = -g. Motions are (x, y, z, turn about X, Y, Z) in the block
/// frame about its origin, turns as lengths at the end of a lever of 150 mm, so that all six are of like effect.
struct NormalEquations {
  Mat6 H = Mat6::Zero();
  Vec6 g = Vec6::Zero();
  std::size_t points = 0;
};

/// Memory, owned by the inspector.
struct IcpMemory {
  std::span<float> points;         ///< kSampleFloats
  std::span<float> distances;      ///< 2 * limits::kIcpPointsMax
  std::span<std::uint8_t> labels;  ///< 2 * limits::kIcpPointsMax
};

/// Point-to-plane ICP of a sample (scanner frame) to the block model with Tukey weights. All members cost one pass over
/// the sample (some 30 us) or less.
class Icp {
 public:
  static constexpr double kLever_mm = 150.0;

  /// Draws the sample. `T_block_scanner`: roughly where the block is.
  Icp(const BlockModel& model, const FaceTable& table, const EvaluationSettings& settings, const Cloud& cloud,
      const Pose& T_block_scanner, const IcpMemory& memory, Team& team);

  /// Before steps from afar: makes them fast. Changes no result but by rounding; undone by sort(), and undoes it. After
  /// either of them the points have to be given to their faces anew (associate).
  void sort_first_part(const Pose& T_block_scanner);

  /// One Gauss-Newton step from afar: each point of the sample's first part to the closest face in reach. Returns the
  /// step's length, negative if unsolvable.
  double coarse_step(Pose& T_block_scanner, double gate_mm, NormalEquations& eq) const;
  /// How the pose explains the first part, and the whole sample.
  [[nodiscard]] FaceCounts coarse_counts(const Pose& T_block_scanner) const;
  [[nodiscard]] FaceCounts counts(const Pose& T_block_scanner) const;

  /// Once the pose is roughly known: makes the passes that follow fast. Changes no result but by rounding.
  void sort(const Pose& T_block_scanner);

  /// Gives each point to its face for the steps that follow: within `single_face_gate` and only where a single face is
  /// near. Between two calls the steps work on one smooth problem, which has a fixed point; points that change sides
  /// with every step have none.
  /// Returns what counts() would: it is known by then.
  FaceCounts associate(const Pose& T_block_scanner);

  /// One step with the associated points within `gate_mm`. Weights::newton converges faster but only close to the end.
  double step(Pose& T_block_scanner, double gate_mm, Weights weights, NormalEquations& eq) const;

  [[nodiscard]] double single_face_gate() const { return settings_.registration_gate_mm; }

  /// Ties take part in every further step, each with the weight of so many points.
  void hold(const FixedVector<Tie, 4>& ties, double points_each) {
    ties_ = ties;
    tie_weight_ = points_each;
  }

  /// The normal equations of the last steps with the points of some faces (bits) only, and the ties.
  [[nodiscard]] NormalEquations information(const Pose& T_block_scanner, double gate_mm, std::uint16_t faces) const;

  /// The largest of the faces' median distances, of a part of the sample; faces with fewer than `points_min` points
  /// there say nothing. Zero when none says anything.
  [[nodiscard]] double worst_median_mm(std::size_t points_min) const;

  /// How far a motion carries the rim of the block.
  [[nodiscard]] static double length_mm(const Pose& motion) {
    return motion.translation_mm.norm() + kLever_mm * angle_between_rad(motion.rotation, Quat::Identity());
  }

  /// Covariance of the pose at its fixed point (RegistrationReport::covariance), by the M-estimator's sandwich
  /// A^-1 B A^-1 (Huber 1981): A sums psi', B the scatter of psi face by face. So neither the weights, nor faces on
  /// which the noise is seen at a slant, nor a face a little off the model make it say more or less than the noise.
  [[nodiscard]] Mat6 covariance(const Pose& T_block_scanner, double gate_mm) const;

  /// Robust standard deviation of the distances that take part at `gate_mm`.
  [[nodiscard]] double noise_mm(const Pose& T_block_scanner, double gate_mm) const;

  /// The sample as it was drawn.
  [[nodiscard]] const IcpSample& sample() const { return drawn_; }
  /// A few points of the sample, evenly from the whole scan (scanner frame). Returns how many.
  std::size_t take(std::span<Vec3> points) const;

 private:
  [[nodiscard]] IcpSample first_part_as_drawn() const { return drawn_.part(0, drawn_.size() / kSampleParts); }
  [[nodiscard]] IcpView view(const Pose& pose, std::span<const std::uint16_t> cells) const;
  [[nodiscard]] Slopes moved_since_association(const Pose& pose) const;
  [[nodiscard]] FaceCounts count(const IcpSample& sample, const Pose& pose, const Association& to) const;
  [[nodiscard]] SumsOfFaces sums(const Pose& pose, double gate_mm, Weights weights,
                                 const std::array<double, kFaces>& means = {}) const;
  [[nodiscard]] NormalEquations equations(const Pose& pose, const SumsOfFaces& sums, std::uint16_t faces) const;
  static double solve(NormalEquations& eq, Pose& pose);

  const BlockModel& model_;
  const FaceTable& table_;
  const EvaluationSettings& settings_;
  IcpMemory memory_;
  Team& team_;
  IcpSample drawn_;       ///< in the order of the scan, part by part
  IcpSample sample_;      ///< sorted, or as drawn
  IcpSample first_part_;  ///< for the coarse steps: sorted, or as drawn
  std::array<std::uint16_t, limits::kIcpPointsMax / 16> groups_{};
  Association association_;
  Pose associated_at_;
  FixedVector<Tie, 4> ties_;
  double tie_weight_ = 0.0;
};

}  // namespace slabd::algo
