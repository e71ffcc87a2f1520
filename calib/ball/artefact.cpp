// SPDX-License-Identifier: Apache-2.0
//
// From ball centres to the pose of their frame. Distances do not depend on the pose, so they say which ball is which;
// when two ways fit, none is taken. The pose is the weighted least-squares one: the centres' covariances, which are
// long across or along the view, and the certificate's uncertainty, turned into the target's frame.
#include "calib/ball/artefact.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "calib/ball/artefact_match.h"
#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

constexpr int kSteps = 10;

using Mat36 = Eigen::Matrix<double, 3, 6, Eigen::DontAlign>;
using Vec6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;

Pose small_motion(const Vec6& xi) {
  const Vec3 turn = xi.tail<3>();
  const double angle = turn.norm();
  Pose motion;
  motion.translation_mm = xi.head<3>();
  if (angle > 0.0) motion.rotation = Quat(Eigen::AngleAxisd(angle, turn / angle));
  return motion;
}

/// How the place of a target point, in target axes, changes with a small motion of the target.
Mat36 place_by_motion(const Vec3& p_target) {
  Mat36 j;
  j.leftCols<3>() = Mat3::Identity();
  j.rightCols<3>() = -skew(p_target);
  return j;
}

struct Measured {
  std::vector<Vec3> centres_mm;  ///< scanner frame, in the certificate's order
  std::vector<Mat3> cov_mm2;
};

/// Gauss-Newton on the six small motions; three steps suffice from the start above.
bool fit_pose(const ArtefactCertificate& certificate, const Measured& measured, TargetPose& target) {
  Pose pose = rigid_fit(certificate.balls_mm, measured.centres_mm);
  for (int step = 0; step < kSteps; ++step) {
    const Mat3 turn = pose.rotation.toRotationMatrix();
    Mat6 normal = Mat6::Zero();
    Vec6 right = Vec6::Zero();
    for (std::size_t k = 0; k < certificate.balls_mm.size(); ++k) {
      const Vec3& certified = certificate.balls_mm[k];
      const Vec3 off = pose.inverse() * measured.centres_mm[k] - certified;
      const Mat3 own = turn.transpose() * measured.cov_mm2[k] * turn;
      const Mat3 covariance = own + certificate.sigma_mm * certificate.sigma_mm * Mat3::Identity();
      const Mat3 weight = covariance.inverse();
      const Mat36 j = place_by_motion(certified);
      normal += j.transpose() * weight * j;
      right += j.transpose() * weight * off;
    }
    const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver{Eigen::Matrix<double, 6, 6>(normal)};
    if (solver.info() != Eigen::Success || !solver.isPositive()) return false;
    const Vec6 xi = solver.solve(Eigen::Matrix<double, 6, 1>(right));
    if (!xi.allFinite()) return false;
    pose = pose * small_motion(xi);
    target.covariance = solver.solve(Eigen::Matrix<double, 6, 6>::Identity());
    if (xi.head<3>().norm() < 1e-10 && xi.tail<3>().norm() < 1e-13) break;
  }
  target.T_scanner_target = pose;
  return pose.all_finite() && target.covariance.allFinite();
}

/// Distances of balls to each other, rising, as text: what a person compares first.
std::string distances_text(std::span<const Vec3> balls) {
  std::vector<double> distances;
  for (std::size_t i = 0; i < balls.size(); ++i)
    for (std::size_t j = i + 1; j < balls.size(); ++j) distances.push_back((balls[i] - balls[j]).norm());
  std::sort(distances.begin(), distances.end());
  std::string text;
  for (std::size_t i = 0; i < std::min<std::size_t>(distances.size(), 6); ++i) {
    FixedString<24> one;
    one.printf("%s%.2f", i == 0 ? "" : ", ", distances[i]);
    text += one.view();
  }
  return text;
}

void fill_residuals(const ArtefactCertificate& certificate, const Measured& measured, ArtefactReport& report) {
  const Pose T_target_scanner = report.target.T_scanner_target.inverse();
  const auto count = static_cast<double>(certificate.balls_mm.size());
  Vec3 mean = Vec3::Zero();
  for (const Vec3& p : certificate.balls_mm) mean += p / count;
  double squares = 0.0;
  double stretch = 0.0;
  double spread = 0.0;
  double variance = 0.0;
  report.residual_max_mm = -1.0;
  for (std::size_t k = 0; k < certificate.balls_mm.size(); ++k) {
    const Vec3& certified = certificate.balls_mm[k];
    const Vec3 off = T_target_scanner * measured.centres_mm[k] - certified;
    report.residuals_mm.push_back(off);
    squares += off.squaredNorm();
    if (off.norm() > report.residual_max_mm) {
      report.residual_max_mm = off.norm();
      report.worst_ball = static_cast<int>(k) + 1;
    }
    stretch += off.dot(certified - mean);
    spread += (certified - mean).squaredNorm();
    variance += (measured.cov_mm2[k].trace() / 3.0 + certificate.sigma_mm * certificate.sigma_mm) / count;
  }
  report.residual_rms_mm = std::sqrt(squares / count);
  report.scale_ppm = 1e6 * stretch / spread;
  report.scale_sigma_ppm = 1e6 * std::sqrt(variance / spread);
  report.distance_off_max_mm = 0.0;
  for (std::size_t i = 0; i < certificate.balls_mm.size(); ++i)
    for (std::size_t j = i + 1; j < certificate.balls_mm.size(); ++j) {
      const double certified = (certificate.balls_mm[i] - certificate.balls_mm[j]).norm();
      const double seen = (measured.centres_mm[i] - measured.centres_mm[j]).norm();
      report.distance_off_max_mm = std::max(report.distance_off_max_mm, std::abs(seen - certified));
    }
}

void refuse(ArtefactReport& report, ArtefactRefusal why, std::string_view cure) {
  report.refusal = why;
  report.words.cure.assign(cure);
}

}  // namespace

std::string_view name(ArtefactRefusal refusal) {
  switch (refusal) {
    case ArtefactRefusal::none: return "none";
    case ArtefactRefusal::not_looked_at: return "not_looked_at";
    case ArtefactRefusal::balls: return "balls";
    case ArtefactRefusal::no_match: return "no_match";
    case ArtefactRefusal::ambiguous: return "ambiguous";
    case ArtefactRefusal::residual: return "residual";
  }
  return "?";
}

Mat3 TargetPose::point_covariance(const Vec3& p_target) const {
  const Mat36 j = T_scanner_target.rotation.toRotationMatrix() * place_by_motion(p_target);
  return j * covariance * j.transpose();
}

double TargetPose::sigma_mm(const Vec3& p_target) const {
  return std::sqrt(point_covariance(p_target).trace() / 3.0);
}

double TargetPose::sigma_rad() const {
  return std::sqrt(covariance.bottomRightCorner<3, 3>().trace() / 3.0);
}

Assignments assign_by_distance(std::span<const Vec3> certified, std::span<const Vec3> measured, double off_mm) {
  Assignments all;
  std::vector<int> chosen;
  std::vector<bool> taken(measured.size(), false);
  const auto fits = [&](std::size_t next) {
    for (std::size_t k = 0; k < chosen.size(); ++k) {
      const double there = (certified[k] - certified[chosen.size()]).norm();
      const double here = (measured[static_cast<std::size_t>(chosen[k])] - measured[next]).norm();
      if (!(std::abs(here - there) <= off_mm)) return false;
    }
    return true;
  };
  // Depth first, lower indices first; a wrong branch ends at its second or third ball.
  const auto descend = [&](const auto& self) -> void {
    if (chosen.size() == certified.size()) {
      all.found.push_back(chosen);
      return;
    }
    for (std::size_t next = 0; next < measured.size() && all.found.size() < 2; ++next) {
      if (taken[next] || !fits(next)) continue;
      taken[next] = true;
      chosen.push_back(static_cast<int>(next));
      self(self);
      chosen.pop_back();
      taken[next] = false;
    }
  };
  descend(descend);
  return all;
}

ArtefactReport locate_artefact(std::span<const BallReport> balls, const ArtefactCertificate& certificate,
                               const ArtefactSettings& settings) {
  ArtefactReport report;
  if (const Status checked = check_certificate(certificate); !checked) {
    report.words.reason = checked.error().text;
    refuse(report, ArtefactRefusal::ambiguous, "use a certificate of an artefact whose balls can be told apart");
    return report;
  }
  std::vector<Vec3> centres;
  std::vector<int> numbers;
  for (std::size_t i = 0; i < balls.size(); ++i) {
    if (!balls[i].ok()) continue;
    centres.push_back(balls[i].centre_mm);
    numbers.push_back(static_cast<int>(i));
  }
  const std::size_t wanted = certificate.balls_mm.size();
  if (centres.size() != wanted) {
    report.words.reason.printf("%zu balls were accepted, the artefact %s has %zu", centres.size(),
                               certificate.id.c_str(), wanted);
    refuse(report, ArtefactRefusal::balls, "make all its balls visible, and no other ball of the same radius");
    return report;
  }
  const Assignments ways = assign_by_distance(certificate.balls_mm, centres, settings.distance_off_mm);
  if (ways.found.empty()) {
    report.words.reason.printf("the balls are %s mm apart, by the certificate %s they are %s mm (allowed is %.2f off)",
                               distances_text(centres).c_str(), certificate.id.c_str(),
                               distances_text(certificate.balls_mm).c_str(), settings.distance_off_mm);
    refuse(report, ArtefactRefusal::no_match,
           "use the certificate of this artefact; check that its balls are tight, and that scan and certificate are in "
           "mm");
    return report;
  }
  if (ways.found.size() > 1) {
    report.words.reason.printf("the balls fit the certificate %s in more than one order", certificate.id.c_str());
    refuse(report, ArtefactRefusal::ambiguous, "allow less difference of distances, or use a less regular artefact");
    return report;
  }
  Measured measured;
  for (const int which : ways.found[0]) {
    const int ball = numbers[static_cast<std::size_t>(which)];
    report.assigned.push_back(ball);
    measured.centres_mm.push_back(balls[static_cast<std::size_t>(ball)].centre_mm);
    measured.cov_mm2.push_back(balls[static_cast<std::size_t>(ball)].cov_mm2());
  }
  if (!fit_pose(certificate, measured, report.target)) {
    report.words.reason = "no pose follows from these balls: their uncertainty is not known";
    refuse(report, ArtefactRefusal::balls, "scan again");
    return report;
  }
  fill_residuals(certificate, measured, report);
  if (!(report.residual_max_mm < settings.residual_max_mm)) {
    report.words.reason.printf(
        "ball %d lies %.3f mm from its certified place, allowed is %.3f (distances are off by up to %.3f mm, scale "
        "%+.0f ppm)",
        report.worst_ball, report.residual_max_mm, settings.residual_max_mm, report.distance_off_max_mm,
        report.scale_ppm);
    refuse(report, ArtefactRefusal::residual,
           std::abs(report.scale_ppm) > 5.0 * report.scale_sigma_ppm && std::abs(report.scale_ppm) > 200.0
               ? "the distances are all too long or too short: have the scanner's scale checked, and the temperature"
               : "check that the balls are clean and tight on their frame, and the date of the certificate");
    return report;
  }
  report.refusal = ArtefactRefusal::none;
  return report;
}

Result<ArtefactReport> find_artefact(std::span<const float> xyz, const ArtefactCertificate& certificate,
                                     const ArtefactSettings& settings) {
  BallSettings ball = settings.ball;
  ball.radius_mm = certificate.ball_radius_mm;
  ball.radius_sigma_mm = certificate.ball_radius_sigma_mm;
  ball.count = static_cast<int>(certificate.balls_mm.size());
  Result<BallView> view = find_balls(xyz, ball);
  if (!view) return view.error();
  if (!view.value().ok()) {
    ArtefactReport report;
    report.refusal = ArtefactRefusal::balls;
    report.words = view.value().words;
    report.view = std::move(view.value());
    return report;
  }
  ArtefactReport report = locate_artefact(view.value().balls, certificate, settings);
  report.view = std::move(view.value());
  return report;
}

}  // namespace slabd::calib
