// SPDX-License-Identifier: Apache-2.0
//
// Steps from sums per face (icp_kernels). A face's points share their normal n, so with the weighted sums of 1, u and
// u u^T over its points (u: sample coordinates) its whole share in the 6 x 6 normal matrix follows: u is moved into the
// block frame as a mean and a scatter, and the derivative of a distance to the six motions is (n, p x n).
//
// Every pass runs in blocks of 4096 points, merged in their order.
#include "algo/register/icp.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace slabd::algo {
namespace {

/// One step never moves the pose further than this.
constexpr double kStepMax_mm = 30.0;
/// Median of |r| to standard deviation, for normal errors.
constexpr double kSigmaPerMedian = 1.4826;
constexpr std::size_t kBlocks = limits::kIcpPointsMax / kIcpBlock;
static_assert(limits::kIcpPointsMax % (16 * kSampleParts) == 0 && kIcpBlock % 16 == 0);

std::size_t blocks_of(const IcpSample& sample) {
  return (sample.size() + kIcpBlock - 1) / kIcpBlock;
}
std::size_t block_size(const IcpSample& sample, std::size_t block) {
  return std::min(kIcpBlock, sample.size() - block * kIcpBlock);
}

/// Derivative of a distance along `n` at `p` to the six motions.
Vec6 jacobian(const Vec3& n, const Vec3& p) {
  const Vec3 lever = p.cross(n) / Icp::kLever_mm;
  Vec6 j;
  j << n.x(), n.y(), n.z(), lever.x(), lever.y(), lever.z();
  return j;
}

}  // namespace

Icp::Icp(const BlockModel& model, const FaceTable& table, const EvaluationSettings& settings, const Cloud& cloud,
         const Pose& T_block_scanner, const IcpMemory& memory, Team& team)
    : model_(model), table_(table), settings_(settings), memory_(memory), team_(team) {
  drawn_ = sample_ = draw_sample(cloud, T_block_scanner.inverse().translation_mm, memory.points, team);
  first_part_ = first_part_as_drawn();
  association_ = {memory.labels.first(sample_.size()), memory.distances.first(sample_.size()),
                  std::span(groups_).first(sample_.size() / 16)};
}

IcpView Icp::view(const Pose& pose, std::span<const std::uint16_t> cells) const {
  IcpView v;
  v.R = pose.rotation.toRotationMatrix();
  v.t = v.R * sample_.shift + pose.translation_mm;
  for (std::size_t f = 0; f < kFaces; ++f) {
    const Plane& plane = model_.planes()[f];
    v.slopes[f] = {v.R.transpose() * plane.n, plane.n.dot(v.t) - plane.d};
  }
  v.cells = cells;
  return v;
}

Slopes Icp::moved_since_association(const Pose& pose) const {
  const Slopes now = view(pose, {}).slopes;
  Slopes moved = view(associated_at_, {}).slopes;
  for (std::size_t f = 0; f < kFaces; ++f) moved[f] = {now[f].n - moved[f].n, now[f].d - moved[f].d};
  return moved;
}

double Icp::coarse_step(Pose& pose, double gate_mm, NormalEquations& eq) const {
  SumsOfFaces sums;
  sum_closest(first_part_, view(pose, table_.wide()), gate_mm, sums);
  eq = equations(pose, sums, kPoseFaces);
  return solve(eq, pose);
}

FaceCounts Icp::count(const IcpSample& sample, const Pose& pose, const Association& to) const {
  const IcpView v = view(pose, table_.near());
  std::array<FaceCounts, kBlocks> of_block{};
  team_.run(blocks_of(sample), [&](std::size_t b) {
    const std::size_t first = b * kIcpBlock;
    const std::size_t size = block_size(sample, b);
    count_and_associate(sample.part(first, size), v, single_face_gate(),
                        to.face.empty() ? Association{} : to.part(first, size), of_block[b]);
  });
  FaceCounts all;
  for (std::size_t b = 0; b < blocks_of(sample); ++b) all.add(of_block[b]);
  return all;
}

FaceCounts Icp::coarse_counts(const Pose& pose) const {
  return count(first_part_, pose, {});
}

FaceCounts Icp::counts(const Pose& pose) const {
  return count(sample_, pose, {});
}

// A sorted first part and a sorted sample lie in the same memory, so to sort one puts the other back to as it was
// drawn.
void Icp::sort_first_part(const Pose& pose) {
  sample_ = drawn_;
  first_part_ = sort_by_face(first_part_as_drawn(), view(pose, table_.near()), memory_.points, memory_.labels, team_);
}

void Icp::sort(const Pose& pose) {
  first_part_ = first_part_as_drawn();
  sample_ = sort_by_face(drawn_, view(pose, table_.near()), memory_.points, memory_.labels, team_);
}

FaceCounts Icp::associate(const Pose& pose) {
  associated_at_ = pose;
  return count(sample_, pose, association_);
}

SumsOfFaces Icp::sums(const Pose& pose, double gate_mm, Weights weights,
                      const std::array<double, kFaces>& means) const {
  const Slopes moved = moved_since_association(pose);
  std::array<SumsOfFaces, kBlocks> of_block;
  team_.run(blocks_of(sample_), [&](std::size_t b) {
    const std::size_t first = b * kIcpBlock;
    const std::size_t size = block_size(sample_, b);
    of_block[b] = SumsOfFaces{};
    sum_associated(sample_.part(first, size), association_.part(first, size), moved, gate_mm, weights, means,
                   of_block[b]);
  });
  SumsOfFaces all{};
  for (std::size_t b = 0; b < blocks_of(sample_); ++b)
    for (std::size_t f = 0; f < kFaces; ++f) all[f].add(of_block[b][f]);
  return all;
}

NormalEquations Icp::equations(const Pose& pose, const SumsOfFaces& sums, std::uint16_t faces) const {
  NormalEquations eq;
  const Mat3 R = pose.rotation.toRotationMatrix();
  const Vec3 t = R * sample_.shift + pose.translation_mm;
  for (std::size_t f = 0; f < kFaces; ++f) {
    if ((faces & bit(static_cast<Face>(f))) == 0 || sums[f].s[FaceSums::points] == 0.0) continue;
    const auto& s = sums[f].s;
    const Vec3& n = model_.planes()[f].n;
    // Sums in the block frame, p = R u + t.
    const Vec3 Ru = R * Vec3(s[FaceSums::wx], s[FaceSums::wy], s[FaceSums::wz]);
    Mat3 uu;
    uu << s[FaceSums::wxx], s[FaceSums::wxy], s[FaceSums::wxz], s[FaceSums::wxy], s[FaceSums::wyy], s[FaceSums::wyz],
        s[FaceSums::wxz], s[FaceSums::wyz], s[FaceSums::wzz];
    const double w = s[FaceSums::w];
    const Vec3 p = Ru + w * t;
    const Mat3 pp = R * uu * R.transpose() + Ru * t.transpose() + t * Ru.transpose() + w * t * t.transpose();
    const double v = s[FaceSums::v];
    const Vec3 vp = R * Vec3(s[FaceSums::vx], s[FaceSums::vy], s[FaceSums::vz]) + v * t;
    // p x n = N p
    Mat3 N;
    N << 0.0, n.z(), -n.y(), -n.z(), 0.0, n.x(), n.y(), -n.x(), 0.0;
    eq.H.topLeftCorner<3, 3>() += w * n * n.transpose();
    eq.H.topRightCorner<3, 3>() += n * (N * p).transpose() / kLever_mm;
    eq.H.bottomRightCorner<3, 3>() += N * pp * N.transpose() / (kLever_mm * kLever_mm);
    eq.g.head<3>() += v * n;
    eq.g.tail<3>() += N * vp / kLever_mm;
    eq.points += static_cast<std::size_t>(s[FaceSums::points]);
  }
  eq.H.bottomLeftCorner<3, 3>() = eq.H.topRightCorner<3, 3>().transpose().eval();
  return eq;
}

double Icp::solve(NormalEquations& eq, Pose& pose) {
  if (eq.points < 6) return -1.0;
  // A trace of damping: a direction nothing determines then stays where it was instead of running away.
  const Mat6 damped = eq.H + 1e-9 * eq.H.trace() * Mat6::Identity();
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(damped);
  if (solver.info() != Eigen::Success || !solver.isPositive()) return -1.0;
  Vec6 delta = -solver.solve(Eigen::Matrix<double, 6, 1>(eq.g));
  if (!delta.allFinite()) return -1.0;
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

double Icp::step(Pose& pose, double gate_mm, Weights weights, NormalEquations& eq) const {
  eq = equations(pose, sums(pose, gate_mm, weights), kPoseFaces);
  for (const Tie& tie : ties_) {
    const Vec3 p = pose * tie.p_scanner;
    const Vec6 j = jacobian(tie.direction, p);
    eq.H += tie_weight_ * j * j.transpose();
    eq.g += tie_weight_ * (tie.direction.dot(p) - tie.target_mm) * j;
  }
  return solve(eq, pose);
}

NormalEquations Icp::information(const Pose& pose, double gate_mm, std::uint16_t faces) const {
  NormalEquations eq = equations(pose, sums(pose, gate_mm, Weights::tukey), faces & kPoseFaces);
  for (const Tie& tie : ties_) {
    const Vec6 j = jacobian(tie.direction, pose * tie.p_scanner);
    eq.H += tie_weight_ * j * j.transpose();
  }
  return eq;
}

double Icp::worst_median_mm(std::size_t points_min) const {
  // Face by face, one behind the other.
  std::array<std::size_t, kFaces + 1> end{};
  for (std::size_t i = 0; i < association_.face.size(); i += kSampleParts)
    if (association_.face[i] < kFaces) ++end[association_.face[i] + 1U];
  for (std::size_t f = 0; f < kFaces; ++f) end[f + 1] += end[f];
  const std::span<float> found = memory_.distances.subspan(limits::kIcpPointsMax);
  for (std::size_t i = 0; i < association_.face.size(); i += kSampleParts)
    if (association_.face[i] < kFaces) found[end[association_.face[i]]++] = std::abs(association_.distance_mm[i]);
  double worst = 0.0;
  std::size_t first = 0;
  for (std::size_t f = 0; f < kFaces; ++f) {
    const std::span<float> own = found.subspan(first, end[f] - first);
    first = end[f];
    if ((kPoseFaces & bit(static_cast<Face>(f))) == 0) continue;
    if (own.size() < std::max<std::size_t>(points_min, 1)) continue;
    const auto middle = own.begin() + static_cast<std::ptrdiff_t>(own.size() / 2);
    std::nth_element(own.begin(), middle, own.end());
    worst = std::max(worst, static_cast<double>(*middle));
  }
  return worst;
}

Mat6 Icp::covariance(const Pose& pose, double gate_mm) const {
  const SumsOfFaces slope = sums(pose, gate_mm, Weights::newton);
  std::array<double, kFaces> means{};
  for (std::size_t f = 0; f < kFaces; ++f)
    if (slope[f].s[FaceSums::points] > 0.0) means[f] = slope[f].s[FaceSums::v] / slope[f].s[FaceSums::points];
  Mat6 A = equations(pose, slope, kPoseFaces).H;
  Mat6 B = equations(pose, sums(pose, gate_mm, Weights::scatter, means), kPoseFaces).H;
  for (const Tie& tie : ties_) {
    const Vec6 j = jacobian(tie.direction, pose * tie.p_scanner);
    A += tie_weight_ * j * j.transpose();
    B += tie_weight_ * tie_weight_ * tie.sigma_mm * tie.sigma_mm * j * j.transpose();
  }
  const Eigen::Matrix<double, 6, 6> inverse = Eigen::Matrix<double, 6, 6>(A).inverse();
  const Eigen::Matrix<double, 6, 6> C = inverse * Eigen::Matrix<double, 6, 6>(B) * inverse;
  const auto unit = [](int k) { return k < 3 ? 1.0 : 1.0 / kLever_mm; };
  Mat6 out;
  for (int a = 0; a < 6; ++a)
    for (int b = 0; b < 6; ++b) out(a, b) = 0.5 * (C(a, b) + C(b, a)) * unit(a) * unit(b);
  return out;
}

double Icp::noise_mm(const Pose& pose, double gate_mm) const {
  const Slopes moved = moved_since_association(pose);
  const std::span<float> all = memory_.distances.subspan(limits::kIcpPointsMax, sample_.size());
  std::array<std::size_t, kBlocks> of_block{};
  const auto count_all = [&](float limit) {
    std::size_t count = 0;
    for (std::size_t b = 0; b < blocks_of(sample_); ++b)
      count += count_up_to(all.subspan(b * kIcpBlock, block_size(sample_, b)), limit);
    return count;
  };
  team_.run(blocks_of(sample_), [&](std::size_t b) {
    const std::size_t first = b * kIcpBlock;
    const std::size_t size = block_size(sample_, b);
    magnitudes(sample_.part(first, size), association_.part(first, size), moved, gate_mm, all.subspan(first, size));
    of_block[b] = count_up_to(all.subspan(first, size), std::numeric_limits<float>::max());
  });
  std::size_t count = 0;
  for (const std::size_t n : of_block) count += n;
  if (count == 0) return kNoValue;
  // Positive floats are ordered as their bits are: halving the range of bits ends at the median itself.
  std::uint32_t low = 0;
  auto high = std::bit_cast<std::uint32_t>(static_cast<float>(gate_mm));
  while (low < high) {
    const std::uint32_t middle = low + (high - low) / 2;
    if (count_all(std::bit_cast<float>(middle)) > count / 2)
      high = middle;
    else
      low = middle + 1;
  }
  return kSigmaPerMedian * static_cast<double>(std::bit_cast<float>(low));
}

std::size_t Icp::take(std::span<Vec3> points) const {
  const std::size_t part = drawn_.size() / kSampleParts;
  const auto is_there = [&](std::size_t i) { return drawn_.x[i] == drawn_.x[i]; };
  std::size_t there = 0;
  for (std::size_t i = 0; i < part; ++i) there += is_there(i) ? 1U : 0U;
  const std::size_t wanted = std::min(there, points.size());
  std::size_t count = 0;
  std::size_t seen = 0;
  for (std::size_t i = 0; i < part && count < wanted; ++i) {
    if (!is_there(i)) continue;
    if (seen++ < count * there / wanted) continue;
    points[count++] = sample_.shift + Vec3(static_cast<double>(drawn_.x[i]), static_cast<double>(drawn_.y[i]),
                                           static_cast<double>(drawn_.z[i]));
  }
  return count;
}

}  // namespace slabd::algo
