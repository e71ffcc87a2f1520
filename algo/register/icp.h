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

/// Gauss-Newton normal equations of one step: H * motion = -g. Motions are (x, y, z, rotation about X, Y, Z) in the
/// block frame about its origin. Rotations are lengths at a lever of 150 mm, so that all six have similar effects.
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

/// Point-to-plane ICP of a sample (scanner frame) to the block model with Tukey weights. Every member function costs at
/// most one pass over the sample (about 30 us).
class Icp {
 public:
  static constexpr double kLever_mm = 150.0;

  /// Draws the sample. `T_block_scanner`: approximate position of the block.
  Icp(const BlockModel& model, const FaceTable& table, const EvaluationSettings& settings, const Cloud& cloud,
      const Pose& T_block_scanner, const IcpMemory& memory, Team& team);

  /// Sorts the first part, which makes coarse steps fast. Results change only by rounding. It undoes sort() and vice
  /// versa; after either of them the points must be associated again (associate).
  void sort_first_part(const Pose& T_block_scanner);

  /// One Gauss-Newton step from afar: associates each point of the sample's first part with the closest face in reach.
  /// Returns the step's length, negative if unsolvable.
  double coarse_step(Pose& T_block_scanner, double gate_mm, NormalEquations& eq) const;
  /// Counts of the points explained by the pose, for the first part and for the whole sample.
  [[nodiscard]] FaceCounts coarse_counts(const Pose& T_block_scanner) const;
  [[nodiscard]] FaceCounts counts(const Pose& T_block_scanner) const;

  /// Sorts the sample near the final pose, which makes later passes fast. Results change only by rounding.
  void sort(const Pose& T_block_scanner);

  /// Associates each point with a face for the following steps: within `single_face_gate` and only if a
  /// single face is near. Between two calls the steps solve one smooth problem, which has a fixed point;
  /// with a new association in every step there would be none. Returns the same as counts(), without extra
  /// cost.
  FaceCounts associate(const Pose& T_block_scanner);

  /// One step with the associated points within `gate_mm`. Weights::newton converges faster, but only near the end.
  double step(Pose& T_block_scanner, double gate_mm, Weights weights, NormalEquations& eq) const;

  [[nodiscard]] double single_face_gate() const { return settings_.registration_gate_mm; }

  /// Adds ties to every further step, each with the weight of `points_each` points.
  void hold(const FixedVector<Tie, 4>& ties, double points_each) {
    ties_ = ties;
    tie_weight_ = points_each;
  }

  /// The normal equations of the last steps, with the points of some faces (bits) only, and the ties.
  [[nodiscard]] NormalEquations information(const Pose& T_block_scanner, double gate_mm, std::uint16_t faces) const;

  /// The largest of the faces' median distances, from a part of the sample; faces with fewer than `points_min` points
  /// there are ignored. Zero if all are.
  [[nodiscard]] double worst_median_mm(std::size_t points_min) const;

  /// Distance by which a motion moves the rim of the block.
  [[nodiscard]] static double length_mm(const Pose& motion) {
    return motion.translation_mm.norm() + kLever_mm * angle_between_rad(motion.rotation, Quat::Identity());
  }

  /// Covariance of the pose at its fixed point (RegistrationReport::covariance), by the M-estimator's sandwich A^-1 B
  /// A^-1 (Huber 1981): A sums psi', B the scatter of psi face by face. So weights, faces with oblique noise, and faces
  /// slightly off the model do not bias it; it depends only on the noise.
  [[nodiscard]] Mat6 covariance(const Pose& T_block_scanner, double gate_mm) const;

  /// Robust standard deviation of the distances within `gate_mm`.
  [[nodiscard]] double noise_mm(const Pose& T_block_scanner, double gate_mm) const;

  /// The sample as it was drawn.
  [[nodiscard]] const IcpSample& sample() const { return drawn_; }
  /// Copies a few points of the sample, distributed over the whole scan (scanner frame). Returns their number.
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
