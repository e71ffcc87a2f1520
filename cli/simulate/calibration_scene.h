// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "calib/calib.h"
#include "emulator/block_scene.h"
#include "emulator/robot_error.h"
#include "emulator/scan_drawing.h"

/// Calibration scene of the emulated scanner: a tooling ball on its post, an artefact of three balls, a flat plate, or
/// the reference block, with a table, a wall, a rod and a foreign ball. Scans have noise of both kinds, mixed points at
/// edges, and shadows of the projector. The seed determines everything, and the truth is known.
///
/// The code shares nothing with calib's ball finding, so that the emulator and the measurement do not share errors.
namespace slabd::cli::simulate {

enum class TargetKind : std::uint8_t { ball, artefact, block, plate };
[[nodiscard]] std::string_view name(TargetKind kind);

struct CalibrationTraits {
  TargetKind kind = TargetKind::ball;
  std::uint64_t seed = 1;
  double ball_radius_mm = 25.4;
  /// The target's origin and axes in the base frame, Z up: centre of the ball or plate, the certificate's frame, the
  /// block frame.
  Pose T_base_target{Quat::Identity(), Vec3(1500.0, 200.0, 600.0)};
  Pose T_flange_scanner{Quat(0.9961947, 0.0, 0.0871557, 0.0).normalized(), Vec3(40.0, -25.0, 180.0)};
  emulator::RobotErrorTraits robot{1, 0.0, 500.0, -1.0, 0.017, -1.0};
  bool clutter = true;
};

/// One scan of the scene. Pixels are evenly spaced in the picture, rays go through the scanner's origin.
struct CalibrationScanTraits {
  std::size_t columns = 640;           ///< 2048 for a full scan
  std::size_t rows = 768;              ///< 2448
  double noise_mm = 0.03;              ///< white, along the ray
  double correlated_mm = 0.0;          ///< noise that neighbouring points share ...
  double correlation_length_mm = 2.0;  ///< ... over this length, at the nominal stand-off
  double flyer_share = 0.3;            ///< of the pixels at an edge: is between front and back
  double outlier_share = 0.0005;
  double missing_share = 0.01;
  double projector_mm = 100.0;  ///< distance of the projector from the camera along X; 0: no shadows
  /// Share of the ball (of every ball) hidden behind a plate, from the side of scanner +X; 0: none.
  double hidden_share = 0.0;
  bool organised = true;

  /// 5 million points.
  [[nodiscard]] static CalibrationScanTraits full() {
    CalibrationScanTraits traits;
    traits.columns = 2048;
    traits.rows = 2448;
    return traits;
  }
};

class CalibrationScene {
 public:
  /// Code::config: a radius outside 5..60 mm, or kind block without a recipe.
  [[nodiscard]] static Result<CalibrationScene> make(const CalibrationTraits& traits, const Recipe* recipe = nullptr);

  [[nodiscard]] const CalibrationTraits& traits() const { return traits_; }
  [[nodiscard]] const emulator::RobotError& robot() const { return robot_; }
  /// Kind artefact: the laboratory's values (here without error); kind ball: one ball at the origin; else no ball.
  [[nodiscard]] const calib::ArtefactCertificate& certificate() const { return certificate_; }

  /// Views that a good operator would choose, as T_base_flange reported by the controller: tilts of 20..35 degrees to
  /// all sides, rolls of +-90, the target in the middle and the corners of the picture, near, mid and far.
  [[nodiscard]] std::vector<Pose> plan_views(int count) const;

  /// Real pose of the target in the scanner's frame when the controller reports `T_base_flange` on visit `visit`.
  [[nodiscard]] Pose T_scanner_target(const Pose& T_base_flange, std::uint64_t visit) const;

  /// Draws the scan from there into `xyz` (3 floats a point, resized). Code::config: the target is not in front of the
  /// scanner. The same arguments give the same bits; `shot` changes only the scan's noise. Takes about 0.1 s, and 1 s
  /// for a full scan.
  [[nodiscard]] Result<emulator::DrawnScan> draw(const Pose& T_base_flange, std::uint64_t visit,
                                                 const CalibrationScanTraits& scan, std::vector<float>& xyz,
                                                 std::uint64_t shot = 0) const;

 private:
  CalibrationScene() = default;

  CalibrationTraits traits_;
  emulator::RobotError robot_;
  calib::ArtefactCertificate certificate_;
  std::optional<Recipe> recipe_;
};

}  // namespace slabd::cli::simulate
