// SPDX-License-Identifier: Apache-2.0
//
// Steps from sums per face (icp_kernels). A face's points share their normal n, so the weighted sums of 1, u and u u^T
// over its points (u: sample coordinates) give its whole contribution to the 6 x 6 normal matrix. u is moved into the
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

#include "algo/register/icp_kernels.h"
#include "base/prng.h"

namespace slabd::algo {
namespace {

/// Maximum length of one step.
constexpr double kStepMax_mm = 30.0;
/// Ratio of standard deviation to median of |r|, for normal errors.
constexpr double kSigmaPerMedian = 1.4826;
constexpr std::size_t kBlocks = limits::kIcpPointsMax / kIcpBlock;
static_assert(limits::kIcpPointsMax % (16 * kSampleParts) == 0 && kIcpBlock % 16 == 0);

std::size_t blocks_of(const IcpSample& sample) {
  return (sample.size() + kIcpBlock - 1) / kIcpBlock;
}
std::size_t block_size(const IcpSample& sample, std::size_t block) {
  return std::min(kIcpBlock, sample.size() - block * kIcpBlock);
}

/// Derivative of a distance along `n` at `p` with respect to the six motions.
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

// A sorted first part and a sorted sample share their memory, so sorting one resets the other to the drawn order.
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
  // Slight damping: an undetermined direction then stays unchanged instead of diverging.
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
  // The distances are stored face by face.
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
  // Positive floats have the same order as their bits, so halving the range of bits ends exactly at the median.
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

// Drawing 65 536 points from 60 MB causes as many cache misses. So the indices are drawn a row ahead and the points are
// prefetched, many at a time, before they are collected. A row fills one cache line of each part: the parts are at
// multiples of 4 KiB, and partly written lines would evict each other from the cache.

namespace {

constexpr std::size_t kColumn = limits::kIcpPointsMax;
/// Range in a slice that is searched for an existing point.
constexpr std::size_t kLooks = 16;
constexpr std::size_t kDrawBlocks = 16;
/// Slices drawn at a time: a cache line of each part and coordinate.
constexpr std::size_t kRow = 16 * kSampleParts;

IcpSample columns(std::span<float> memory, std::size_t count, const Vec3& shift) {
  return {memory.subspan(0, count), memory.subspan(kColumn, count), memory.subspan(2 * kColumn, count), shift};
}

bool is_point(const float* p) {
  return std::isfinite(p[0] + p[1] + p[2]);
}

/// Search ranges for the points of a row's slices; empty if `first` equals `last`.
struct PlacesOfRow {
  std::array<std::size_t, kRow> first, last;
};

/// Draws an index in each slice, slice by slice, and prefetches the points there.
class SlicePlaces {
 public:
  SlicePlaces(const Cloud& cloud, std::size_t slices, std::size_t slice, std::uint64_t seed)
      : cloud_(cloud),
        slices_(slices),
        slice_(slice),
        begin_(slice * cloud.points / slices),
        rest_(slice * cloud.points % slices),
        prng_(seed) {}

  void draw(PlacesOfRow& row) {
    const std::size_t whole = cloud_.points / slices_;
    const std::size_t more = cloud_.points % slices_;
    for (std::size_t k = 0; k < kRow; ++k, ++slice_) {
      row.first[k] = row.last[k] = 0;
      if (slice_ >= slices_) continue;
      // slice * points / slices without division: the accumulated remainder adds one point now and then.
      rest_ += more;
      const std::size_t carry = rest_ >= slices_ ? 1 : 0;
      rest_ -= carry * slices_;
      const std::size_t end = begin_ + whole + carry;
      const std::size_t at = begin_ + (((prng_.next() >> 32U) * (end - begin_)) >> 32U);
      begin_ = end;
      row.first[k] = at;
      row.last[k] = std::min(end, at + kLooks);
      __builtin_prefetch(&cloud_.xyz[3 * at]);
      __builtin_prefetch(&cloud_.xyz[3 * at + 2]);
    }
  }

 private:
  const Cloud& cloud_;
  std::size_t slices_;
  std::size_t slice_;
  std::size_t begin_;  ///< start of the slice, and the remainder of its division
  std::size_t rest_;
  Prng prng_;
};

/// The drawn points of a row, part by part.
struct PointsOfRow {
  using Part = std::array<float, kRow / kSampleParts>;
  std::array<Part, kSampleParts> x, y, z;
};

/// Collects the first existing point at or after each index, else NaN.
void collect(const Cloud& cloud, const PlacesOfRow& places, const std::array<float, 3>& from, PointsOfRow& to) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t k = 0; k < kRow; ++k) {
    const std::size_t part = k % kSampleParts;
    const std::size_t i = k / kSampleParts;
    std::size_t at = places.first[k];
    while (at < places.last[k] && !is_point(&cloud.xyz[3 * at])) ++at;
    const bool found = at < places.last[k];
    const float* p = found ? &cloud.xyz[3 * at] : nullptr;
    to.x[part][i] = found ? p[0] - from[0] : kNone;
    to.y[part][i] = found ? p[1] - from[1] : kNone;
    to.z[part][i] = found ? p[2] - from[2] : kNone;
  }
}

}  // namespace

IcpSample draw_sample(const Cloud& cloud, const Vec3& shift, std::span<float> memory, Team& team) {
  const std::size_t slices = std::min(cloud.points, limits::kIcpPointsMax);
  const std::size_t rows = (slices + kRow - 1) / kRow;
  const std::size_t per_part = rows * (kRow / kSampleParts);
  const Vec3 whole = shift.array().round();
  IcpSample sample = columns(memory, rows * kRow, whole);
  const std::array<float, 3> from = {static_cast<float>(whole.x()), static_cast<float>(whole.y()),
                                     static_cast<float>(whole.z())};
  team.run(kDrawBlocks, [&](std::size_t block) {
    const std::size_t end_row = (block + 1) * rows / kDrawBlocks;
    std::size_t row = block * rows / kDrawBlocks;
    if (row == end_row) return;
    SlicePlaces places(cloud, slices, row * kRow, 0x5eedU + block);
    std::array<PlacesOfRow, 2> ahead;
    places.draw(ahead[row % 2]);
    for (; row < end_row; ++row) {
      if (row + 1 < end_row) places.draw(ahead[(row + 1) % 2]);
      PointsOfRow points;
      collect(cloud, ahead[row % 2], from, points);
      for (std::size_t part = 0; part < kSampleParts; ++part) {
        const std::size_t to = part * per_part + row * (kRow / kSampleParts);
        std::copy(points.x[part].begin(), points.x[part].end(), &sample.x[to]);
        std::copy(points.y[part].begin(), points.y[part].end(), &sample.y[to]);
        std::copy(points.z[part].begin(), points.z[part].end(), &sample.z[to]);
      }
    }
  });
  return sample;
}

SliceOfScan slice_of(const Cloud& cloud, const IcpSample& sample, std::size_t i) {
  const std::size_t slices = std::min(cloud.points, limits::kIcpPointsMax);
  const std::size_t per_part = sample.size() / kSampleParts;
  const std::size_t slice = i % per_part * kSampleParts + i / per_part;
  const std::size_t first = slice * cloud.points / slices;
  const std::size_t end = std::min(cloud.points, (slice + 1) * cloud.points / slices);
  return {first, end - first};
}

IcpSample sort_by_face(const IcpSample& sample, const IcpView& view, std::span<float> memory,
                       std::span<std::uint8_t> keys, Team& team) {
  IcpSample sorted = columns(memory.subspan(3 * kColumn), sample.size(), sample.shift);
  team.run((sample.size() + kIcpBlock - 1) / kIcpBlock, [&](std::size_t block) {
    const std::size_t first = block * kIcpBlock;
    const std::size_t count = std::min(kIcpBlock, sample.size() - first);
    const std::span<std::uint8_t> key = keys.subspan(first, count);
    sort_keys(sample.part(first, count), view, key);
    std::array<std::uint32_t, 2 * kFaces + 2> start{};
    for (const std::uint8_t k : key) ++start[k + 1U];
    for (std::size_t k = 1; k < start.size(); ++k) start[k] += start[k - 1];
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t to = first + start[key[i]]++;
      sorted.x[to] = sample.x[first + i];
      sorted.y[to] = sample.y[first + i];
      sorted.z[to] = sample.z[first + i];
    }
  });
  return sorted;
}

}  // namespace slabd::algo
