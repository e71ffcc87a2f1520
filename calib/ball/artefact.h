// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "calib/ball/ball.h"

/// A target whose whole pose is seen: three or more balls on a frame with certified coordinates, or the reference block
/// as the measuring core registers it. Balls are told apart by their distances alone, so a frame whose balls could be
/// confused is refused before it is used.
namespace slabd::calib {

inline constexpr std::size_t kArtefactBallsMin = 3;
inline constexpr std::size_t kArtefactBallsMax = 8;

/// How well the target of one view is known: the pose enters the hand-eye solver as it is, whatever the target.
struct TargetPose {
  Pose T_scanner_target;
  /// Of the small motion (x, y, z in mm, rotation about X, Y, Z in rad; target frame, about the target's origin) that
  /// takes the pose found to the true one: T_true = T_scanner_target * motion. Random part, k = 1.
  Mat6 covariance = Mat6::Constant(kNoValue);

  /// Covariance (mm^2, scanner axes) of the place of a point given in the target's frame.
  [[nodiscard]] Mat3 point_covariance(const Vec3& p_target) const;
  /// Root mean square over the axes of translation (at `p_target`) and of rotation.
  [[nodiscard]] double sigma_mm(const Vec3& p_target = Vec3::Zero()) const;
  [[nodiscard]] double sigma_rad() const;
};

/// What a calibration laboratory says about an artefact; coordinates define the target frame.
struct ArtefactCertificate {
  FixedString<64> id;
  FixedString<16> date;  ///< of the certificate, YYYY-MM-DD
  FixedString<64> issuer;
  double ball_radius_mm = kNoValue;        ///< effective, as coated, the same for all balls
  double ball_radius_sigma_mm = kNoValue;  ///< k = 1
  double sigma_mm = kNoValue;              ///< of a ball's coordinate per axis, k = 1
  double temperature_c = 20.0;             ///< at which the coordinates hold
  std::vector<Vec3> balls_mm;              ///< target frame
};

/// Reads the text form (docs/CALIBRATION.md): one `key = value` a line, `#` comments.
///
///     id = three-ball-01
///     date = 2026-03-14
///     issuer = "DKD-K-00000"          # optional
///     ball_radius_mm = 19.050
///     ball_radius_U_mm = 0.004        # expanded, k = coverage_factor
///     U_mm = 0.006                    # expanded uncertainty of a coordinate
///     coverage_factor = 2
///     temperature_c = 20.0            # optional, 20 if absent
///     ball = 0.000 0.000 0.000        # at least three lines, at most eight
///     ball = 200.012 0.004 0.000
///     ball = 60.003 170.021 -0.012
///
/// config: unknown, repeated or missing key, a number that is not one or out of range, balls nearer to each other than
/// their diameter, all on a line, or so alike in their distances that they cannot be told apart; the text names
/// `file_name`:line and what is allowed. Pure: `text` is the content, `file_name` is for messages.
[[nodiscard]] Result<ArtefactCertificate> parse_certificate(std::string_view text, std::string_view file_name);

/// The text form of a certificate; parse_certificate() reads it back.
[[nodiscard]] std::string certificate_text(const ArtefactCertificate& certificate);

struct ArtefactSettings {
  BallSettings ball;              ///< radius and count come from the certificate
  double distance_off_mm = 0.3;   ///< a measured distance between two balls may differ by this from the certified one
  double residual_max_mm = 0.05;  ///< of any ball after the rigid fit
};

/// Why the pose of an artefact is not used.
enum class ArtefactRefusal : std::uint8_t {
  none,
  not_looked_at,
  balls,      ///< not enough balls accepted; their own words say why
  no_match,   ///< the distances are not those of the certificate
  ambiguous,  ///< more than one way to assign the balls fits
  residual,   ///< assigned, but a ball is not where the certificate says
};
[[nodiscard]] std::string_view name(ArtefactRefusal refusal);

/// The pose of an artefact in one scan, with every figure.
struct ArtefactReport {
  ArtefactRefusal refusal = ArtefactRefusal::not_looked_at;
  BallWords words;
  BallView view;  ///< what was found in the scan; empty when centres were given

  TargetPose target;
  std::vector<int> assigned;       ///< [certified ball] = index of the measured ball
  std::vector<Vec3> residuals_mm;  ///< [certified ball], target axes: measured minus certified
  double residual_rms_mm = kNoValue;
  double residual_max_mm = kNoValue;
  int worst_ball = 0;                     ///< 1, 2, ... in the certificate's order
  double distance_off_max_mm = kNoValue;  ///< largest difference of a measured distance from the certified one
  double scale_ppm = kNoValue;            ///< measured over certified length, minus 1: a diagnosis, never applied
  double scale_sigma_ppm = kNoValue;

  [[nodiscard]] bool ok() const { return refusal == ArtefactRefusal::none; }
};

/// Assigns the accepted balls to the certificate by their distances and fits the pose by weighted least squares (the
/// balls' covariances and the certificate's). More balls than the certificate has are refused, as are fewer.
[[nodiscard]] ArtefactReport locate_artefact(std::span<const BallReport> balls, const ArtefactCertificate& certificate,
                                             const ArtefactSettings& settings);

/// find_balls() with the certificate's radius and count, then locate_artefact(). config as find_balls().
[[nodiscard]] Result<ArtefactReport> find_artefact(std::span<const float> xyz, const ArtefactCertificate& certificate,
                                                   const ArtefactSettings& settings);

}  // namespace slabd::calib
