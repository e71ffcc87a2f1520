// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "calib/ball/ball.h"

/// A target with a measured full pose. It is a frame of three or more balls with certified coordinates, or the
/// reference block registered by the measuring core. Balls are identified only by their distances, so a frame with
/// ambiguous distances is rejected before use.
namespace slabd::calib {

inline constexpr std::size_t kArtefactBallsMin = 3;
inline constexpr std::size_t kArtefactBallsMax = 8;

/// Pose of a target in one view, with its uncertainty: input of the hand-eye solver for any kind of target.
struct TargetPose {
  Pose T_scanner_target;
  /// Covariance of the small motion from the measured to the true pose: T_true = T_scanner_target * motion. Order: x,
  /// y, z in mm, rotation about X, Y, Z in rad; target frame, about the target's origin. Random part, k = 1.
  Mat6 covariance = Mat6::Constant(kNoValue);

  /// Covariance (mm^2, scanner axes) of a point given in the target's frame.
  [[nodiscard]] Mat3 point_covariance(const Vec3& p_target) const;
  /// Root mean square over the axes of translation (at `p_target`) and of rotation.
  [[nodiscard]] double sigma_mm(const Vec3& p_target = Vec3::Zero()) const;
  [[nodiscard]] double sigma_rad() const;
};

/// Certificate of an artefact from a calibration laboratory; its coordinates define the target frame.
struct ArtefactCertificate {
  FixedString<64> id;
  FixedString<16> date;  ///< date of the certificate, YYYY-MM-DD
  FixedString<64> issuer;
  double ball_radius_mm = kNoValue;        ///< effective radius of the coated balls, the same for all
  double ball_radius_sigma_mm = kNoValue;  ///< k = 1
  double sigma_mm = kNoValue;              ///< coordinate of a ball per axis, k = 1
  double temperature_c = 20.0;             ///< temperature at which the coordinates are valid
  std::vector<Vec3> balls_mm;              ///< target frame
};

/// Reads the text form (docs/TARGETS.md): one `key = value` per line, `#` comments.
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
/// config: an unknown, repeated or missing key, or a number that is invalid or out of range. Also balls closer than
/// their diameter, all on a line, or with distances too similar to identify them. The text contains `file_name`:line
/// and the allowed values. Pure: `text` is the content, `file_name` is for messages.
[[nodiscard]] Result<ArtefactCertificate> parse_certificate(std::string_view text, std::string_view file_name);

/// Text form of a certificate; parse_certificate() reads it back.
[[nodiscard]] std::string certificate_text(const ArtefactCertificate& certificate);

struct ArtefactSettings {
  BallSettings ball;             ///< radius and count are taken from the certificate
  double distance_off_mm = 0.3;  ///< largest difference of a measured distance between two balls from the certified one
  double residual_max_mm = 0.05;  ///< largest residual of any ball after the rigid fit
};

/// Reason why the pose of an artefact is not used.
enum class ArtefactRefusal : std::uint8_t {
  none,
  not_looked_at,
  balls,      ///< not enough accepted balls; the balls' own texts contain the reason
  no_match,   ///< the distances do not match the certificate
  ambiguous,  ///< more than one assignment of the balls fits
  residual,   ///< assigned, but a ball is not at its certified place
};
[[nodiscard]] std::string_view name(ArtefactRefusal refusal);

/// Pose of an artefact in one scan, with all figures.
struct ArtefactReport {
  ArtefactRefusal refusal = ArtefactRefusal::not_looked_at;
  BallWords words;
  BallView view;  ///< balls found in the scan; empty if centres were given

  TargetPose target;
  std::vector<int> assigned;       ///< [certified ball] = index of the measured ball
  std::vector<Vec3> residuals_mm;  ///< [certified ball], target axes: measured minus certified
  double residual_rms_mm = kNoValue;
  double residual_max_mm = kNoValue;
  int worst_ball = 0;                     ///< 1, 2, ... in the order of the certificate
  double distance_off_max_mm = kNoValue;  ///< largest difference of a measured distance from the certified one
  double scale_ppm = kNoValue;            ///< measured over certified length, minus 1: a diagnosis, never applied
  double scale_sigma_ppm = kNoValue;

  [[nodiscard]] bool ok() const { return refusal == ArtefactRefusal::none; }
};

/// Assigns the accepted balls to the certificate by their distances and fits the pose by weighted least squares. The
/// weights are the covariances of the balls and of the certificate. More or fewer balls than in the certificate are
/// rejected.
[[nodiscard]] ArtefactReport locate_artefact(std::span<const BallReport> balls, const ArtefactCertificate& certificate,
                                             const ArtefactSettings& settings);

/// Runs find_balls() with the certificate's radius and count, then locate_artefact(). config as find_balls().
[[nodiscard]] Result<ArtefactReport> find_artefact(std::span<const float> xyz, const ArtefactCertificate& certificate,
                                                   const ArtefactSettings& settings);

}  // namespace slabd::calib
