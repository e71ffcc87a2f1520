// SPDX-License-Identifier: Apache-2.0
//
// One scan, all its balls: candidates from the whole scan, the points near each of them, a fit and its gates. What is
// not a sphere at all is dropped; a sphere that fails a gate stays in the report with its figures.
#include "calib/ball/ball.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/ball/ball_fit.h"
#include "calib/ball/ball_seed.h"

namespace slabd::calib {
namespace {

constexpr double kRadiusLeastMm = 1.0;
constexpr double kRadiusMostMm = 200.0;
constexpr int kCountMost = 16;
/// Candidates beyond the balls wanted: posts, other balls, corners.
constexpr std::size_t kCandidatesSpare = 8;
constexpr int kRadiusViewsMin = 5;
constexpr double kRadiusOffLeastMm = 0.010;
/// Points looked at for one candidate: a cap of a full scan has 60 000.
constexpr std::size_t kNearMax = 1U << 20U;

Status check(std::span<const float> xyz, const BallSettings& s) {
  if (xyz.size() % 3 != 0 || xyz.size() / 3 > limits::kScanPointsMax)
    return error(Code::config, "a scan has 3 numbers a point and at most %zu points, got %zu numbers",
                 limits::kScanPointsMax, xyz.size());
  if (!(s.radius_mm >= kRadiusLeastMm && s.radius_mm <= kRadiusMostMm))
    return error(Code::config, "ball radius %g mm: must be within %g .. %g", s.radius_mm, kRadiusLeastMm,
                 kRadiusMostMm);
  if (s.count < 1 || s.count > kCountMost)
    return error(Code::config, "number of balls %d: must be within 1 .. %d", s.count, kCountMost);
  if (!(s.noise_mm > 0.0 && s.noise_mm <= 1.0))
    return error(Code::config, "scanner noise %g mm: must be above 0 and at most 1", s.noise_mm);
  if (!(s.noise_correlation_mm >= 0.0 && s.noise_correlation_mm <= 20.0))
    return error(Code::config, "noise correlation %g mm: must be within 0 .. 20", s.noise_correlation_mm);
  if (!(s.radius_sigma_mm >= 0.0 && s.radius_sigma_mm <= 1.0))
    return error(Code::config, "uncertainty of the ball radius %g mm: must be within 0 .. 1", s.radius_sigma_mm);
  if (!s.viewpoint_mm.allFinite()) return error(Code::config, "the viewpoint is not finite");
  return success();
}

/// The points of the scan within `half_mm` of a sphere, in the scan's order.
void gather(std::span<const float> xyz, const Vec3& centre_mm, double radius_mm, double half_mm,
            std::vector<Vec3>& near) {
  near.clear();
  const auto reach = static_cast<float>(radius_mm + half_mm);
  const double low = std::max(0.0, radius_mm - half_mm);
  const Eigen::Vector3f c = centre_mm.cast<float>();
  for (std::size_t i = 0; i + 2 < xyz.size() && near.size() < kNearMax; i += 3) {
    const bool inside = std::abs(xyz[i] - c.x()) < reach && std::abs(xyz[i + 1] - c.y()) < reach &&
                        std::abs(xyz[i + 2] - c.z()) < reach;
    if (!inside) continue;
    const Vec3 p = Eigen::Vector3f(xyz[i], xyz[i + 1], xyz[i + 2]).cast<double>();
    const double distance2 = (p - centre_mm).squaredNorm();
    if (distance2 > low * low && distance2 < (radius_mm + half_mm) * (radius_mm + half_mm)) near.push_back(p);
  }
}

/// All spheres of about the radius, judged; the same sphere once.
std::vector<BallReport> measure_all(std::span<const float> xyz, const BallSettings& settings) {
  const std::vector<BallCandidate> candidates = ball_candidates(
      xyz, settings.radius_mm, settings.viewpoint_mm, static_cast<std::size_t>(2 * settings.count) + kCandidatesSpare);
  // The votes' centre is good to a few per cent of the radius, and the radius may be that far off as well.
  const double half_mm = 0.1 * settings.radius_mm + 2.0 * shell_mm(settings);
  std::vector<Vec3> near;
  std::vector<BallReport> balls;
  for (const BallCandidate& candidate : candidates) {
    BallReport ball;
    gather(xyz, candidate.centre_mm, settings.radius_mm, half_mm, near);
    if (!measure_ball(near, candidate.centre_mm, settings, ball)) continue;
    const bool known = std::any_of(balls.begin(), balls.end(), [&](const BallReport& other) {
      return (other.centre_mm - ball.centre_mm).norm() < settings.radius_mm;
    });
    if (known) continue;
    judge_ball(settings, ball);
    balls.push_back(ball);
  }
  std::stable_sort(balls.begin(), balls.end(), [](const BallReport& a, const BallReport& b) {
    return a.ok() != b.ok() ? a.ok() : a.points_used > b.points_used;
  });
  return balls;
}

/// A diameter given for a radius, or the other way round: the ball is there at half or twice the size. NaN: it is not.
double radius_of_another(std::span<const float> xyz, const BallSettings& settings) {
  for (const double factor : {0.5, 2.0}) {
    BallSettings other = settings;
    other.radius_mm = factor * settings.radius_mm;
    if (!check(xyz, other)) continue;
    for (const BallReport& ball : measure_all(xyz, other))
      if (ball.ok() || ball.refusal == BallRefusal::radius) return ball.radius_free_mm;
  }
  return kNoValue;
}

}  // namespace

std::string_view name(BallRefusal refusal) {
  switch (refusal) {
    case BallRefusal::none: return "none";
    case BallRefusal::not_looked_at: return "not_looked_at";
    case BallRefusal::no_points: return "no_points";
    case BallRefusal::not_found: return "not_found";
    case BallRefusal::too_many: return "too_many";
    case BallRefusal::too_few: return "too_few";
    case BallRefusal::few_points: return "few_points";
    case BallRefusal::small_cap: return "small_cap";
    case BallRefusal::azimuth: return "azimuth";
    case BallRefusal::unstable: return "unstable";
    case BallRefusal::noisy: return "noisy";
    case BallRefusal::spoiled: return "spoiled";
    case BallRefusal::radius: return "radius";
    case BallRefusal::repeat: return "repeat";
  }
  return "?";
}

Result<BallView> find_balls(std::span<const float> xyz, const BallSettings& settings) {
  if (const Status checked = check(xyz, settings); !checked) return checked.error();
  BallView view;
  view.points = xyz.size() / 3;
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high = -low;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    const Vec3 p = Eigen::Vector3f(xyz[i], xyz[i + 1], xyz[i + 2]).cast<double>();
    if (!p.allFinite()) continue;
    ++view.finite;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  if (view.finite == 0) {
    view.refusal = BallRefusal::no_points;
    view.words.reason.printf("the scan has no points (%llu places, all missing)",
                             static_cast<unsigned long long>(view.points));
    view.words.cure = "check exposure and working distance, and that the scanner's shutter is open";
    return view;
  }
  view.balls = measure_all(xyz, settings);
  const auto wanted = static_cast<std::size_t>(settings.count);
  const auto accepted = static_cast<std::size_t>(
      std::count_if(view.balls.begin(), view.balls.end(), [](const BallReport& ball) { return ball.ok(); }));
  if (accepted == wanted) {
    view.refusal = BallRefusal::none;
  } else if (accepted > wanted) {
    view.refusal = BallRefusal::too_many;
    view.words = words_too_many(settings, accepted);
  } else if (view.balls.empty()) {
    view.refusal = BallRefusal::not_found;
    view.words = words_not_found(settings, (high - low).maxCoeff(), radius_of_another(xyz, settings));
  } else if (wanted == 1) {
    view.refusal = view.balls[0].refusal;
    view.words = view.balls[0].words;
  } else {
    view.refusal = BallRefusal::too_few;
    view.words = words_too_few(settings, accepted, accepted < view.balls.size() ? &view.balls[accepted] : nullptr);
  }
  return view;
}

BallShots average_shots(std::span<const BallReport> shots, const BallSettings& settings) {
  BallShots mean;
  mean.shots = static_cast<int>(shots.size());
  if (shots.empty()) {
    mean.refusal = BallRefusal::no_points;
    mean.words.reason = "no shot was taken";
    mean.words.cure = "scan the ball";
    return mean;
  }
  for (std::size_t i = 0; i < shots.size(); ++i) {
    if (shots[i].ok()) continue;
    mean.refusal = shots[i].refusal;
    mean.worst_shot = static_cast<int>(i) + 1;
    mean.words.reason.printf("shot %zu of %zu: %s", i + 1, shots.size(), shots[i].words.reason.c_str());
    mean.words.cure = shots[i].words.cure;
    return mean;
  }
  const auto count = static_cast<double>(shots.size());
  mean.centre_mm.setZero();
  Mat3 white = Mat3::Zero();
  Mat3 correlated = Mat3::Zero();
  for (const BallReport& shot : shots) {
    mean.centre_mm += shot.centre_mm / count;
    white += shot.cov_white_mm2 / (count * count);
    correlated += shot.cov_correlated_mm2 / count;
  }
  mean.cov_mm2 = white + correlated;
  double squares = 0.0;
  double worst = -1.0;
  for (std::size_t i = 0; i < shots.size(); ++i) {
    const double off = (shots[i].centre_mm - mean.centre_mm).norm();
    squares += off * off;
    if (off > worst) {
      worst = off;
      mean.worst_shot = static_cast<int>(i) + 1;
    }
  }
  if (shots.size() > 1) mean.repeat_mm = std::sqrt(squares / (3.0 * (count - 1.0)));
  if (shots.size() > 1 && !(mean.repeat_mm < settings.repeat_max_mm)) {
    mean.refusal = BallRefusal::repeat;
    mean.words.reason.printf(
        "%zu shots scatter by %.4f mm per axis, allowed is %.4f; shot %d lies %.4f mm off the mean", shots.size(),
        mean.repeat_mm, settings.repeat_max_mm, mean.worst_shot, worst);
    mean.words.cure =
        "wait until the robot has settled, check that ball and post are tight, shade lamps, and take the shots again";
    return mean;
  }
  mean.refusal = BallRefusal::none;
  return mean;
}

// Least squares of dr + dz cos(phi) = 0 over the cap's area: means of cos and cos^2 over it.
double shift_per_radius(double half_angle_rad) {
  const double c = std::cos(half_angle_rad);
  return 1.5 * (1.0 + c) / (1.0 + c + c * c);
}

RadiusCheck check_radius(std::span<const BallReport> balls, const BallSettings& settings) {
  RadiusCheck check;
  double sum = 0.0;
  double shift = 0.0;
  for (const BallReport& ball : balls) {
    if (!ball.ok() || !has_value(ball.radius_free_mm)) continue;
    ++check.views;
    sum += ball.radius_free_mm;
    shift += ball.shift_per_radius.norm();
  }
  if (check.views < 2) return check;
  check.mean_mm = sum / check.views;
  double squares = 0.0;
  for (const BallReport& ball : balls)
    if (ball.ok() && has_value(ball.radius_free_mm))
      squares += (ball.radius_free_mm - check.mean_mm) * (ball.radius_free_mm - check.mean_mm);
  check.sigma_mm = std::sqrt(squares / (check.views * (check.views - 1.0)));
  const double off = settings.radius_mm - check.mean_mm;
  check.shift_mm = off * shift / check.views;
  check.suspicious =
      check.views >= kRadiusViewsMin && std::abs(off) > 3.0 * check.sigma_mm && std::abs(off) > kRadiusOffLeastMm;
  const double certified_mm = 2.0 * settings.radius_sigma_mm;
  check.covered = check.suspicious && std::abs(off) <= certified_mm;
  if (check.suspicious) {
    check.words.reason.printf(
        "over %d scans the ball shows a radius of %.4f +- %.4f mm, certified are %.4f: if the scans are right, every "
        "centre lies %.3f mm too %s the scanner, and the calibration with it; no residual will show that",
        check.views, check.mean_mm, 2.0 * check.sigma_mm, settings.radius_mm, std::abs(check.shift_mm),
        check.shift_mm > 0.0 ? "far from" : "near to");
    if (check.covered) {
      FixedString<64> covered;
      covered.printf("; the certificate's own uncertainty (%.4f mm, k = 2) covers it", certified_mm);
      check.words.reason.append(covered.view());
    }
    check.words.cure =
        "have the effective radius of the ball certified as coated, and measure a step or plane artefact to tell the "
        "ball's radius from an error of the scanner";
  }
  return check;
}

}  // namespace slabd::calib
