// SPDX-License-Identifier: Apache-2.0
#include "algo/register/block_ends.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "algo/points.h"

namespace slabd::algo {
namespace {

/// Places along the rail, a millimetre each, counted from -kReach_mm.
constexpr int kReach_mm = 256;
using Profile = std::array<double, 2 * kReach_mm>;

/// Points this far from the bearing plane belong to it.
constexpr double kHeight_mm = 3.0;
/// Clear of the jaws' feet, whatever their fillets.
constexpr double kClear_mm = 15.0;
/// A place has the whole bearing plane when it has this part of what most places have.
constexpr double kHalf = 0.5;
/// Fewer points of the sample in a millimetre are too few to see an end.
constexpr double kPointsMin = 8.0;
/// Places without a bearing plane between two with one: a strap, a dark stroke.
constexpr int kGap_mm = 25;
/// Beyond an end, between these distances, the slab's top must be seen, with this part of the usual points: else the
/// field of view ends, and not the block.
constexpr int kBeyondFrom_mm = 8;
constexpr int kBeyondTo_mm = 20;
constexpr double kBeyondShare = 0.3;
/// Ends may be this much nearer together or further apart than nominal.
constexpr double kLengthOff_mm = 10.0;
/// What a chamfer usually takes of the bearing plane.
constexpr double kChamfer_mm = 2.0;
constexpr double kBothSigma_mm = 0.5;
constexpr double kOneSigma_mm = 2.0;

}  // namespace

std::optional<Tie> tie_to_ends(const IcpSample& sample, const BlockModel& model, const EvaluationSettings& settings,
                               const Pose& T_block_scanner) {
  const Plane& seat = model.plane(Face::seat);
  const double half_s_mm = model.geometry().jaw_half_distance_mm.value - kClear_mm;
  const Mat3 R = T_block_scanner.rotation.toRotationMatrix();
  const Vec3 t = R * sample.shift + T_block_scanner.translation_mm;
  Profile on_seat{};
  Profile any{};
  for (std::size_t i = 0; i < sample.size(); ++i) {
    if (!(sample.x[i] == sample.x[i])) continue;
    const Vec3 p =
        R * Vec3(static_cast<double>(sample.x[i]), static_cast<double>(sample.y[i]), static_cast<double>(sample.z[i])) +
        t;
    if (!(std::abs(model.along_seat().dot(p)) <= half_s_mm) || !(std::abs(p.x()) < kReach_mm)) continue;
    const auto place = static_cast<std::size_t>(std::floor(p.x()) + kReach_mm);
    any[place] += 1.0;
    if (std::abs(seat.distance(p)) <= kHeight_mm) on_seat[place] += 1.0;
  }
  // What a place in the middle of the block has.
  Profile sorted = on_seat;
  const double half_length_mm = model.geometry().end_half_length_mm.value;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(half_length_mm);
  std::nth_element(sorted.begin(), middle, sorted.end(), std::greater<>());
  const double full = *middle;
  if (!(full >= kPointsMin)) return std::nullopt;

  // The longest stretch with a bearing plane.
  int best_from = 0;
  int best_to = -1;
  int from = -1;
  int to = -1;
  for (int k = 0; k < 2 * kReach_mm; ++k) {
    if (on_seat[static_cast<std::size_t>(k)] < kHalf * full) continue;
    if (from < 0 || k - to > kGap_mm) from = k;
    to = k;
    if (to - from > best_to - best_from) {
      best_from = from;
      best_to = to;
    }
  }
  if (best_to < best_from) return std::nullopt;
  const auto count = [&](int k) { return k < 0 || k >= 2 * kReach_mm ? 0.0 : on_seat[static_cast<std::size_t>(k)]; };
  // Between a place that has half of it and the next one that has not.
  const auto edge_mm = [&](int last, int step) {
    const double inside = count(last);
    const double outside = count(last + step);
    const double part = inside > outside ? std::clamp((inside - kHalf * full) / (inside - outside), 0.0, 1.0) : 0.5;
    return static_cast<double>(last - kReach_mm) + 0.5 + step * part;
  };
  const auto is_end = [&](int last, int step) {
    double beyond = 0.0;
    for (int k = kBeyondFrom_mm; k < kBeyondTo_mm; ++k) {
      const int place = last + step * k;
      if (place >= 0 && place < 2 * kReach_mm) beyond += any[static_cast<std::size_t>(place)];
    }
    return beyond >= kBeyondShare * full * (kBeyondTo_mm - kBeyondFrom_mm);
  };
  const double low_mm = edge_mm(best_from, -1);
  const double high_mm = edge_mm(best_to, 1);
  const bool low = is_end(best_from, -1);
  const bool high = is_end(best_to, 1);
  double off_mm = 0.0;
  double sigma_mm = kBothSigma_mm;
  if (low && high) {
    if (std::abs(high_mm - low_mm + 2.0 * (kChamfer_mm - half_length_mm)) > kLengthOff_mm) return std::nullopt;
    off_mm = 0.5 * (low_mm + high_mm);
  } else if (low || high) {
    off_mm = low ? low_mm + half_length_mm - kChamfer_mm : high_mm - half_length_mm + kChamfer_mm;
    sigma_mm = kOneSigma_mm;
  } else {
    return std::nullopt;
  }
  if (!(std::abs(off_mm) <= settings.window_mm)) return std::nullopt;
  return Tie{T_block_scanner.inverse() * Vec3(off_mm, 0.0, 0.0), Vec3::UnitX(), 0.0, sigma_mm};
}

Tie tie_to_robot(const Pose& T_block_scanner_by_robot) {
  return {T_block_scanner_by_robot.inverse().translation_mm, Vec3::UnitX(), 0.0, kRobotAlongRailSigma_mm};
}

}  // namespace slabd::algo
