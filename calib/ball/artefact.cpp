// SPDX-License-Identifier: Apache-2.0
//
// Computes the pose of a frame from its ball centres. Distances do not depend on the pose, so they identify the balls;
// if two assignments fit, the artefact is rejected. The pose is fitted by weighted least squares. The weights are the
// covariances of the centres, which are elongated across or along the view, and the certificate's uncertainty, rotated
// into the target's frame.
#include "calib/ball/artefact.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <utility>

#include "calib/key_lines.h"
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

/// Derivative of a target point's place (target axes) by a small motion of the target.
Mat36 place_by_motion(const Vec3& p_target) {
  Mat36 j;
  j.leftCols<3>() = Mat3::Identity();
  j.rightCols<3>() = -skew(p_target);
  return j;
}

struct Measured {
  std::vector<Vec3> centres_mm;  ///< scanner frame, in the order of the certificate
  std::vector<Mat3> cov_mm2;
};

/// Gauss-Newton on the six small motions; three steps are enough from rigid_fit().
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

/// Distances between balls, ascending, as text for comparison by a person.
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

/// Smallest ambiguity of distances that is accepted. Measured distances may differ by 0.3 mm, twice that must still
/// identify the balls, and there is some reserve.
constexpr double kTellApart_mm = 1.0;

struct Assignments {
  /// [certified] = index of the measured ball. At most two assignments are searched, to detect an ambiguity.
  std::vector<std::vector<int>> found;
};

/// Assignments (at most two) of different measured balls to the certified ones for which all distances agree within
/// `off_mm`.
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

// Reader of an artefact's certificate. All later calibrations depend on it, so it is read strictly. Unknown, missing or
// repeated keys are errors, and so is a frame with ambiguous balls.

constexpr const char* kKeys =
    "id, date, issuer, ball_radius_mm, ball_radius_U_mm, U_mm, coverage_factor, temperature_c, ball";
constexpr double kCoordinateMost_mm = 3000.0;
/// Smallest height of the flattest triangle; with less, the rotation about its long side is not determined.
constexpr double kHeightLeast_mm = 20.0;

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

/// Line without its comment; a # between quotes is kept.
std::string_view without_comment(std::string_view line) {
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"') quoted = !quoted;
    if (line[i] == '#' && !quoted) return line.substr(0, i);
  }
  return line;
}

/// config: fewer than three balls or more than eight; balls that touch, are on a line, or cannot be identified.
Status check_certificate(const ArtefactCertificate& c) {
  const std::vector<Vec3>& balls = c.balls_mm;
  if (balls.size() < kArtefactBallsMin || balls.size() > kArtefactBallsMax)
    return error(Code::config, "%zu balls: an artefact has %zu to %zu", balls.size(), kArtefactBallsMin,
                 kArtefactBallsMax);
  double longest = 0.0;
  std::pair<std::size_t, std::size_t> ends;
  for (std::size_t i = 0; i < balls.size(); ++i)
    for (std::size_t j = i + 1; j < balls.size(); ++j) {
      const double distance = (balls[i] - balls[j]).norm();
      if (!(distance > 2.0 * c.ball_radius_mm))
        return error(Code::config, "balls %zu and %zu are %.3f mm apart, less than their diameter", i + 1, j + 1,
                     distance);
      if (distance > longest) {
        longest = distance;
        ends = {i, j};
      }
    }
  const Vec3 along = (balls[ends.second] - balls[ends.first]).normalized();
  double height = 0.0;
  for (const Vec3& p : balls) height = std::max(height, (p - balls[ends.first]).cross(along).norm());
  if (!(height > kHeightLeast_mm))
    return error(Code::config,
                 "the balls lie on a line within %.1f mm: one must be at least %g mm off it, or the frame can turn "
                 "about that line",
                 height, kHeightLeast_mm);
  const Assignments own = assign_by_distance(balls, balls, kTellApart_mm);
  if (own.found.size() > 1) {
    std::size_t k = 0;
    while (own.found[0][k] == own.found[1][k]) ++k;
    return error(Code::config,
                 "balls %d and %d cannot be distinguished by their distances: distances must differ by more than %g mm",
                 own.found[0][k] + 1, own.found[1][k] + 1, kTellApart_mm);
  }
  return success();
}

/// State while a certificate is read.
class Reader {
 public:
  explicit Reader(std::string_view file_name) : file_(file_name) {}

  Status read_line(std::string_view text, int line) {
    line_ = line;
    text = trimmed(without_comment(text));
    if (text.empty()) return success();
    const std::size_t equals = text.find('=');
    if (equals == std::string_view::npos) return fault("'key = value' expected");
    const std::string_view key = trimmed(text.substr(0, equals));
    const std::string_view value = trimmed(text.substr(equals + 1));
    if (key == "ball") return read_ball(value);
    for (Words& words : words_)
      if (key == words.key) return read_words(words, value);
    for (Number& field : numbers_)
      if (key == field.key) return read_number(field, value);
    return error(Code::config, "%s:%d: unknown key '%.*s'; keys are %s", file_.c_str(), line_,
                 static_cast<int>(std::min<std::size_t>(key.size(), 40)), key.data(), kKeys);
  }

  Result<ArtefactCertificate> finish() {
    for (const Words& words : words_)
      if (words.required && !words.seen) return missing(words.key);
    for (const Number& field : numbers_)
      if (field.required && !field.seen) return missing(field.key);
    ArtefactCertificate& c = certificate_;
    c.id = words_[0].value;
    c.date.assign(words_[1].value.view());
    c.issuer = words_[2].value;
    if (!is_date(c.date.view()))
      return error(Code::config, "%s:%d: date '%s': must be a day as YYYY-MM-DD", file_.c_str(), words_[1].line,
                   c.date.c_str());
    c.ball_radius_mm = numbers_[0].value;
    const double coverage = numbers_[3].value;
    c.ball_radius_sigma_mm = numbers_[1].value / coverage;
    c.sigma_mm = numbers_[2].value / coverage;
    c.temperature_c = numbers_[4].value;
    if (const Status checked = check_certificate(c); !checked)
      return error(Code::config, "%s: %s", file_.c_str(), checked.error().text.c_str());
    return std::move(certificate_);
  }

 private:
  struct Words {
    const char* key;
    bool required;
    bool seen = false;
    int line = 0;
    FixedString<64> value{};
  };
  struct Number {
    const char* key;
    bool required;
    double low;
    double high;
    double value;
    bool seen = false;
  };

  Status fault(const char* what) const { return error(Code::config, "%s:%d: %s", file_.c_str(), line_, what); }
  Error missing(const char* key) const {
    return error(Code::config, "%s: the key %s is missing; keys are %s", file_.c_str(), key, kKeys);
  }

  Status read_words(Words& words, std::string_view value) {
    if (words.seen) return error(Code::config, "%s:%d: %s is given twice", file_.c_str(), line_, words.key);
    if (value.size() >= 2 && value.front() == '"' && value.back() == '"') value = value.substr(1, value.size() - 2);
    if (value.empty() || value.size() > words.value.capacity() || value.find('"') != std::string_view::npos)
      return error(Code::config, "%s:%d: %s must be 1 to %zu characters", file_.c_str(), line_, words.key,
                   words.value.capacity());
    if (std::any_of(value.begin(), value.end(),
                    [](char c) { return std::iscntrl(static_cast<unsigned char>(c)) != 0; }))
      return error(Code::config, "%s:%d: %s holds control characters", file_.c_str(), line_, words.key);
    words.seen = true;
    words.line = line_;
    words.value.assign(value);
    return success();
  }

  Status read_number(Number& field, std::string_view value) {
    if (field.seen) return error(Code::config, "%s:%d: %s is given twice", file_.c_str(), line_, field.key);
    double v = 0.0;
    if (!number_from(value, v) || v < field.low || v > field.high)
      return error(Code::config, "%s:%d: %s must be a number within %g .. %g", file_.c_str(), line_, field.key,
                   field.low, field.high);
    field.seen = true;
    field.value = v;
    return success();
  }

  Status read_ball(std::string_view value) {
    Vec3 p;
    for (int axis = 0; axis < 3; ++axis) {
      value = trimmed(value);
      const std::size_t end = std::min(value.find_first_of(" \t,"), value.size());
      if (!number_from(value.substr(0, end), p[axis]) || std::abs(p[axis]) > kCoordinateMost_mm)
        return error(Code::config, "%s:%d: ball must be three coordinates x y z in mm, each within +-%g", file_.c_str(),
                     line_, kCoordinateMost_mm);
      value.remove_prefix(end);
      value = trimmed(value);
      if (axis < 2 && !value.empty() && value.front() == ',') value.remove_prefix(1);
    }
    if (!value.empty()) return fault("ball must be three coordinates x y z in mm and nothing after them");
    if (certificate_.balls_mm.size() == kArtefactBallsMax)
      return error(Code::config, "%s:%d: an artefact has at most %zu balls", file_.c_str(), line_, kArtefactBallsMax);
    certificate_.balls_mm.push_back(p);
    return success();
  }

  std::string file_;
  int line_ = 0;
  ArtefactCertificate certificate_;
  std::array<Words, 3> words_ = {Words{"id", true}, Words{"date", true}, Words{"issuer", false}};
  std::array<Number, 5> numbers_ = {
      Number{"ball_radius_mm", true, 1.0, 200.0, kNoValue}, Number{"ball_radius_U_mm", true, 0.0, 1.0, kNoValue},
      Number{"U_mm", true, 0.0, 1.0, kNoValue}, Number{"coverage_factor", true, 1.0, 4.0, kNoValue},
      Number{"temperature_c", false, -20.0, 60.0, 20.0}};
};

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

ArtefactReport locate_artefact(std::span<const BallReport> balls, const ArtefactCertificate& certificate,
                               const ArtefactSettings& settings) {
  ArtefactReport report;
  if (const Status checked = check_certificate(certificate); !checked) {
    report.words.reason = checked.error().text;
    refuse(report, ArtefactRefusal::ambiguous, "use a certificate of an artefact whose balls can be distinguished");
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
        "ball %d is %.3f mm from its certified place, allowed is %.3f (distances are off by up to %.3f mm, scale "
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

Result<ArtefactCertificate> parse_certificate(std::string_view text, std::string_view file_name) {
  Reader reader(file_name);
  for (int line = 1; !text.empty(); ++line) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    if (const Status read = reader.read_line(text.substr(0, end), line); !read) return read.error();
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return reader.finish();
}

std::string certificate_text(const ArtefactCertificate& c) {
  std::string text;
  const auto add = [&](const char* key, double value) {
    text.append(key).append(" = ").append(number_text(value)).append("\n");
  };
  const auto quoted = [&](const char* key, std::string_view value) {
    text.append(key).append(" = \"").append(value).append("\"\n");
  };
  quoted("id", c.id.view());
  quoted("date", c.date.view());
  if (!c.issuer.empty()) quoted("issuer", c.issuer.view());
  // Written with k = 1 to keep all digits.
  add("coverage_factor", 1.0);
  add("ball_radius_mm", c.ball_radius_mm);
  add("ball_radius_U_mm", c.ball_radius_sigma_mm);
  add("U_mm", c.sigma_mm);
  add("temperature_c", c.temperature_c);
  for (const Vec3& p : c.balls_mm)
    text += "ball = " + number_text(p.x()) + " " + number_text(p.y()) + " " + number_text(p.z()) + "\n";
  return text;
}

}  // namespace slabd::calib
