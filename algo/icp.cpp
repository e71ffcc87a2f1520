// SPDX-License-Identifier: Apache-2.0
#include "algo/icp.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>

namespace slabd::algo {
namespace {

/// One step never moves the pose further than this.
constexpr double kStepMax_mm = 30.0;
/// Median of |r| to standard deviation, for normal errors.
constexpr double kSigmaPerMedian = 1.4826;

/// Of a point that takes no part within the single-face gate.
constexpr std::uint8_t kNoFace = 255;

double tukey(double u) {
  return (1.0 - u * u) * (1.0 - u * u);
}

/// Derivative of a distance along `n` at `p` to the six motions.
Vec6 jacobian(const Vec3& n, const Vec3& p) {
  const Vec3 lever = p.cross(n) / Icp::kLever_mm;
  Vec6 j;
  j << n.x(), n.y(), n.z(), lever.x(), lever.y(), lever.z();
  return j;
}

/// Adds weight * j j^T to the upper triangle.
void add_outer(Mat6& sum, double weight, const Vec6& j) {
  for (int a = 0; a < 6; ++a) {
    const double wj = weight * j[a];
    for (int b = a; b < 6; ++b) sum(a, b) += wj * j[b];
  }
}

Eigen::Matrix<double, 6, 6> symmetric(const Mat6& upper) {
  return Eigen::Matrix<double, 6, 6>(upper).selfadjointView<Eigen::Upper>();
}

}  // namespace

template <typename Visit>
void Icp::each_point(const Pose& pose, double gate_mm, std::size_t stride, Visit&& visit) const {
  const Mat3 R = pose.rotation.toRotationMatrix();
  const bool associated = gate_mm <= single_face_gate();
  for (std::size_t i = 0; i < sample_.size(); i += stride) {
    if (associated && faces_[i] == kNoFace) continue;
    const Vec3 p = R * sample_[i] + pose.translation_mm;
    Face face = Face::seat;
    double r = 0.0;
    if (associated) {
      face = static_cast<Face>(faces_[i]);
      r = model_.plane(face).distance(p);
      if (!(std::abs(r) < gate_mm)) continue;
    } else if (!face_of(p, gate_mm, face, r)) {
      continue;
    }
    visit(face, r, jacobian(model_.plane(face).n, p));
  }
}

void Icp::associate(const Pose& pose) {
  const Mat3 R = pose.rotation.toRotationMatrix();
  for (std::size_t i = 0; i < sample_.size(); ++i) {
    Face face = Face::seat;
    double r = 0.0;
    const bool found = face_of(R * sample_[i] + pose.translation_mm, single_face_gate(), face, r);
    faces_[i] = found ? static_cast<std::uint8_t>(face) : kNoFace;
  }
}

NormalEquations Icp::accumulate(const Pose& pose, double gate_mm, std::size_t stride, std::uint16_t faces) const {
  NormalEquations eq;
  const auto add = [&](double weight, double r, const Vec6& j) {
    eq.g += weight * r * j;
    add_outer(eq.H, weight, j);
  };
  each_point(pose, gate_mm, stride, [&](Face face, double r, const Vec6& j) {
    if ((faces & bit(face)) == 0) return;
    add(tukey(r / gate_mm), r, j);
    ++eq.points;
  });
  for (const Tie& tie : ties_) {
    const Vec3 p = pose * tie.p_scanner;
    add(tie_weight_, tie.direction.dot(p) - tie.target_mm, jacobian(tie.direction, p));
  }
  eq.H = symmetric(eq.H);
  return eq;
}

double Icp::step(Pose& pose, double gate_mm, std::size_t stride, NormalEquations& eq) const {
  eq = accumulate(pose, gate_mm, stride);
  if (eq.points < 6) return -1.0;
  // A trace of damping: a direction nothing determines then stays where it was instead of running away.
  const Mat6 damped = eq.H + 1e-9 * eq.H.trace() * Mat6::Identity();
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(damped);
  Vec6 delta = -solver.solve(Eigen::Matrix<double, 6, 1>(eq.g));
  if (solver.info() != Eigen::Success || !delta.allFinite()) return -1.0;
  const double length = delta.norm();
  if (length > kStepMax_mm) delta *= kStepMax_mm / length;
  const Vec3 turn = delta.tail<3>() / kLever_mm;
  const double angle = turn.norm();
  Pose move;
  move.translation_mm = delta.head<3>();
  if (angle > 0.0) move.rotation = Quat(Eigen::AngleAxisd(angle, Eigen::Vector3d(turn / angle)));
  pose = move * pose;
  return length;
}

Mat6 Icp::covariance(const Pose& pose, double gate_mm) const {
  std::array<double, kFaces> sum{};
  std::array<double, kFaces> count{};
  each_point(pose, gate_mm, 1, [&](Face face, double r, const Vec6&) {
    sum[static_cast<std::size_t>(face)] += r * tukey(r / gate_mm);
    count[static_cast<std::size_t>(face)] += 1.0;
  });
  Mat6 A = Mat6::Zero();
  Mat6 B = Mat6::Zero();
  each_point(pose, gate_mm, 1, [&](Face face, double r, const Vec6& j) {
    const auto f = static_cast<std::size_t>(face);
    const double u2 = r * r / (gate_mm * gate_mm);
    const double psi = r * tukey(r / gate_mm) - sum[f] / count[f];
    add_outer(A, (1.0 - u2) * (1.0 - 5.0 * u2), j);
    add_outer(B, psi * psi, j);
  });
  for (const Tie& tie : ties_) {
    const Vec6 j = jacobian(tie.direction, pose * tie.p_scanner);
    add_outer(A, tie_weight_, j);
    add_outer(B, tie_weight_ * tie_weight_ * tie.sigma_mm * tie.sigma_mm, j);
  }
  const Eigen::Matrix<double, 6, 6> inverse = symmetric(A).inverse();
  const Eigen::Matrix<double, 6, 6> C = inverse * symmetric(B) * inverse;
  const auto unit = [](int k) { return k < 3 ? 1.0 : 1.0 / kLever_mm; };
  Mat6 out;
  for (int a = 0; a < 6; ++a)
    for (int b = 0; b < 6; ++b) out(a, b) = 0.5 * (C(a, b) + C(b, a)) * unit(a) * unit(b);
  return out;
}

double Icp::noise_mm(const Pose& pose, double gate_mm, std::span<double> memory) const {
  std::size_t count = 0;
  each_point(pose, gate_mm, 1, [&](Face, double r, const Vec6&) { memory[count++] = std::abs(r); });
  if (count == 0) return kNoValue;
  const auto middle = memory.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(memory.begin(), middle, memory.begin() + static_cast<std::ptrdiff_t>(count));
  return kSigmaPerMedian * *middle;
}

}  // namespace slabd::algo
