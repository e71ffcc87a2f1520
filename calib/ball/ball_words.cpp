// SPDX-License-Identifier: Apache-2.0
//
// Gates, and texts of the refusals: the failed figure, its limit, and the remedy. Only the first failed gate in the
// order below is reported, because later ones are often its consequences.
#include <cmath>
#include <tuple>

#include "calib/ball/ball_fit.h"

namespace slabd::calib {
namespace {

/// Scanner axis closest to a direction: "+X", "-Y", ...
const char* side_name(const Vec3& direction) {
  static constexpr const char* kNames[3][2] = {{"+X", "-X"}, {"+Y", "-Y"}, {"+Z", "-Z"}};
  int axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  return kNames[axis][direction[axis] < 0.0 ? 1 : 0];
}

BallWords explain(BallRefusal refusal, const BallSettings& s, const BallReport& r) {
  BallWords words;
  switch (refusal) {
    case BallRefusal::radius:
      words.reason.printf(
          "a sphere of radius %.3f mm (uncertainty %.3f) is there, not of %.3f mm: %+.3f mm, allowed is %.3f",
          r.radius_free_mm, 2.0 * r.radius_free_sigma_mm, s.radius_mm, r.radius_free_mm - s.radius_mm, s.radius_off_mm);
      if (std::abs(r.radius_free_mm - s.radius_mm) > 10.0 * s.radius_off_mm)
        words.cure = "give the certified radius (not the diameter) of this ball, or mount the ball it belongs to";
      else
        words.cure =
            "clean the ball, renew its coating and have the effective radius certified as coated; check the scanner's "
            "own calibration if every ball shows this deviation";
      break;
    case BallRefusal::few_points:
      words.reason.printf("%llu points on the cap, needed are %llu", static_cast<unsigned long long>(r.points_used),
                          static_cast<unsigned long long>(s.points_min));
      words.cure = "move nearer, scan at full resolution, take a larger ball, or expose longer on a matt ball";
      break;
    case BallRefusal::small_cap:
      words.reason.printf("the cap seen reaches %.0f degrees from its middle, needed are %.0f",
                          deg_from_rad(r.half_angle_rad), deg_from_rad(s.half_angle_min_rad));
      words.cure = "make the flanks visible: coat the ball matt, expose longer, keep shields and the post out of view";
      break;
    case BallRefusal::azimuth:
      words.reason.printf("the cap is seen over %.0f of 360 degrees, needed are %.0f; missing is the side towards %s",
                          deg_from_rad(r.azimuth_rad), deg_from_rad(s.azimuth_min_rad), side_name(r.missing_side));
      words.cure.printf(
          "move the whole ball into the picture and clear what hides its side towards scanner %s from camera or "
          "projector",
          side_name(r.missing_side));
      break;
    case BallRefusal::unstable:
      words.reason.printf("the robust fit did not converge in %d steps (%llu points)", r.iterations,
                          static_cast<unsigned long long>(r.points_used));
      words.cure = "clean the ball and remove what touches it in the picture, then scan again";
      break;
    case BallRefusal::noisy:
      words.reason.printf(
          "the points scatter by %.3f mm about the sphere, expected is %.3f and allowed %.1f times that", r.rms_mm,
          s.noise_mm, s.rms_max);
      words.cure =
          "stop any vibration (robot settled? brakes?), shade the ball from lamps, renew the matt coating, or state "
          "the scanner's real noise";
      break;
    case BallRefusal::spoiled:
      words.reason.printf("only %.0f %% of the cap's points lie on the sphere, needed are %.0f %%",
                          100.0 * r.kept_share, 100.0 * s.kept_share_min);
      words.cure = "clean the ball; look for a dent, tape, a label or a reflection on it";
      break;
    default: break;
  }
  return words;
}

}  // namespace

void judge_ball(const BallSettings& s, BallReport& r) {
  r.failed.clear();
  const auto gate = [&](bool passed, BallRefusal refusal) {
    if (!passed) std::ignore = r.failed.push(refusal);  // there is space for every gate
  };
  // NaN fails every gate.
  gate(r.half_angle_rad >= s.half_angle_min_rad, BallRefusal::small_cap);
  gate(r.azimuth_rad >= s.azimuth_min_rad - 1e-9, BallRefusal::azimuth);
  gate(r.points_used >= s.points_min, BallRefusal::few_points);
  gate(std::abs(r.radius_free_mm - s.radius_mm) < s.radius_off_mm, BallRefusal::radius);
  gate(r.kept_share >= s.kept_share_min, BallRefusal::spoiled);
  gate(r.rms_mm < s.rms_max * s.noise_mm, BallRefusal::noisy);
  gate(r.converged && r.centre_mm.allFinite() && r.cov_mm2().allFinite(), BallRefusal::unstable);
  // A quarter of a cap determines the radius poorly, so only a large difference counts.
  const bool other_ball = std::abs(r.radius_free_mm - s.radius_mm) > 10.0 * s.radius_off_mm &&
                          std::abs(r.radius_free_mm - s.radius_mm) > 5.0 * r.radius_free_sigma_mm;
  r.refusal = r.failed.empty() ? BallRefusal::none : other_ball ? BallRefusal::radius : r.failed[0];
  r.words = explain(r.refusal, s, r);
}

BallWords words_not_found(const BallSettings& settings, double extent_mm, double other_radius_mm) {
  BallWords words;
  if (extent_mm < settings.radius_mm) {
    words.reason.printf("the whole scan is %.3g mm across, less than the ball's radius of %.3f mm", extent_mm,
                        settings.radius_mm);
    words.cure = "state the unit the scan is really in (--unit m, perhaps)";
    return words;
  }
  if (has_value(other_radius_mm)) {
    words.reason.printf("no ball of radius %.3f mm is in the scan, but a sphere of radius %.2f mm is",
                        settings.radius_mm, other_radius_mm);
    words.cure = "give the radius, not the diameter, or mount the ball that the radius belongs to";
    return words;
  }
  words.reason.printf("no ball of radius %.3f mm is in the scan", settings.radius_mm);
  words.cure =
      "bring the ball into the middle of the picture, at the scanner's working distance, and check radius and unit of "
      "the scan (mm)";
  return words;
}

BallWords words_too_many(const BallSettings& settings, std::size_t accepted) {
  BallWords words;
  words.reason.printf("%zu balls of radius %.3f mm are in the scan, expected is %d: the intended one is unknown",
                      accepted, settings.radius_mm, settings.count);
  words.cure = "cover or remove the others, or state how many there are";
  return words;
}

BallWords words_too_few(const BallSettings& settings, std::size_t accepted, const BallReport* refused) {
  BallWords words;
  if (refused == nullptr) {
    words.reason.printf("%zu of %d balls of radius %.3f mm were found", accepted, settings.count, settings.radius_mm);
    words.cure = "move all balls into the picture and clear what hides them";
    return words;
  }
  words.reason.printf("%zu of %d balls were accepted; another at (%.0f, %.0f, %.0f): %s", accepted, settings.count,
                      refused->centre_mm.x(), refused->centre_mm.y(), refused->centre_mm.z(),
                      refused->words.reason.c_str());
  words.cure = refused->words.cure;
  return words;
}

}  // namespace slabd::calib
