// SPDX-License-Identifier: Apache-2.0
//
// A 38.1 mm ball on its post above a table, scanned with a pitch of 0.255 mm and 0.05 mm of noise along the rays. The
// study measures the scatter of centre and free radius for caps of several sizes, with white and with correlated
// noise. It also compares the scatter with the reported covariance.
#include <fmt/core.h>
#include <cmath>

#include "calib/calib.h"
#include "tests/accuracy/studies.h"
#include "tests/calib/ball_scan.h"

namespace slabd::accuracy {
namespace {

constexpr double kRadius = 19.05;

struct Case {
  const char* what;
  double cap_deg;
  double correlation_mm;
  double along_um;  ///< limits: the floor of a fixed-radius fit
  double across_um;
};
constexpr std::array kCases = {Case{"cap 30 deg", 30.0, 0.0, 1.0, 3.4}, Case{"cap 45 deg", 45.0, 0.0, 0.7, 1.6},
                               Case{"cap 60 deg", 60.0, 0.0, 0.6, 1.0}, Case{"cap 75 deg", 75.0, 0.0, 0.55, 0.8},
                               Case{"cap 60 deg, noise correlated over 2 mm", 60.0, 2.0, 9.0, 16.0}};

calib::BallScene scene_of(std::uint64_t seed, double correlation_mm) {
  calib::BallScene scene;
  scene.seed = seed;
  Prng random(77 * seed);
  const auto within = [&](double a) { return a * (2.0 * random.uniform() - 1.0); };
  const Vec3 c(within(10.0), within(10.0), 510.0 + within(10.0));
  scene.balls = {{c, kRadius}};
  scene.posts = {{c + Vec3(0.0, 0.0, 15.0), c + Vec3(10.0, 5.0, 100.0), 6.0}};
  scene.planes = {{Vec3::UnitZ(), 600.0}};
  scene.half_width_mm = 36.0;
  scene.pitch_mm = 0.255;
  scene.correlation_mm = correlation_mm;
  scene.flyer_share = 0.3;
  scene.missing_share = 0.01;
  return scene;
}

/// The gates are wide enough to accept small caps.
calib::BallSettings settings_of(const Case& c) {
  calib::BallSettings s;
  s.radius_mm = kRadius;
  s.incidence_max_rad = rad_from_deg(c.cap_deg);
  s.half_angle_min_rad = rad_from_deg(std::min(50.0, c.cap_deg - 8.0));
  s.points_min = 1000;
  s.radius_off_mm = 0.3;
  return s;
}

bool one_case(const Case& c, const StudyOptions& options, Table& table) {
  const int count = options.cases(100, 10);
  Vec3 sum = Vec3::Zero();
  Vec3 squares = Vec3::Zero();
  Vec3 promised = Vec3::Zero();
  double radius_sum = 0.0;
  double radius_squares = 0.0;
  int refused = 0;
  for (int i = 0; i < count; ++i) {
    const calib::BallScene scene = scene_of(options.first + static_cast<std::uint64_t>(i), c.correlation_mm);
    const Result<calib::BallView> view = calib::find_balls(calib::draw(scene), settings_of(c));
    if (!view) {
      fmt::print(stderr, "ball: {}\n", view.error().text.view());
      return false;
    }
    if (!view.value().ok()) {
      ++refused;
      continue;
    }
    const calib::BallReport& ball = view.value().balls[0];
    Mat3 axes;  // rows: two across the view, one along it
    axes.row(2) = scene.balls[0].centre_mm.normalized();
    axes.row(0) = Vec3::UnitY().cross(Vec3(axes.row(2))).normalized();
    axes.row(1) = Vec3(axes.row(2)).cross(Vec3(axes.row(0)));
    const Vec3 e = 1e3 * (axes * (ball.centre_mm - scene.balls[0].centre_mm));
    sum += e;
    squares += e.cwiseProduct(e);
    promised += 1e6 * (axes * ball.cov_mm2() * axes.transpose()).diagonal();
    const double off = 1e3 * (ball.radius_free_mm - kRadius);
    radius_sum += off;
    radius_squares += off * off;
  }
  const double n = std::max(1, count - refused);
  const Vec3 mean = sum / n;
  const Vec3 sd = (squares / n - mean.cwiseProduct(mean)).cwiseMax(0.0).cwiseSqrt();
  const auto across = [](const Vec3& v) { return std::sqrt(0.5 * (v.x() * v.x() + v.y() * v.y())); };
  const Vec3 says = (promised / n).cwiseSqrt();
  const std::string what = c.what;
  table.at_most(what + ": refused", refused, 0, "");
  table.at_most(what + ": centre along the view, standard deviation", sd.z(), c.along_um, "um");
  table.tell(what + ": ... its covariance says", says.z(), "um");
  table.at_most(what + ": centre across the view, standard deviation", across(sd), c.across_um, "um");
  table.tell(what + ": ... its covariance says", across(says), "um");
  // The mean over all scans must be within 3.5 of its own standard errors.
  table.at_most(what + ": bias along the view over its standard error", std::abs(mean.z()) / (sd.z() / std::sqrt(n)),
                3.5, "");
  table.tell(what + ": free radius, bias", radius_sum / n, "um");
  table.tell(what + ": free radius, standard deviation",
             std::sqrt(std::max(0.0, radius_squares / n - radius_sum * radius_sum / n / n)), "um");
  return true;
}

}  // namespace

bool ball_study(const StudyOptions& options, Table& table) {
  for (const Case& c : kCases)
    if (!one_case(c, options, table)) return false;
  return true;
}

}  // namespace slabd::accuracy
