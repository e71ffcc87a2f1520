// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/base.h"
#include "calib/hand_eye.h"
#include "calib/observations.h"

/// Coverage of the views so far and the next pose to drive to, for the person at the robot after every view.
namespace slabd::calib {

/// Directions in which the scanner can be tilted from straight down, as seen from the robot's base along base +X. In
/// this order: away, away and left, left (base +Y), back and left, back, back and right, right, away and right.
inline constexpr std::size_t kSectors = 8;
/// Places of the target in the view: near, mid and far, each with middle, +x +y, -x +y, -x -y, +x -y.
inline constexpr std::size_t kPlaces = 5;
inline constexpr std::size_t kDepths = 3;
inline constexpr double kTiltCounts_deg = 10.0;  ///< smallest tilt of a view that counts for a sector

struct CoverageSettings {
  FieldOfView fov;
  Vec3 down_base = -Vec3::UnitZ();  ///< direction of the scanner's axis in production
  double target_radius_mm = 0.0;    ///< radius that must be completely in the view; the extent of an artefact
  std::size_t goal = 20;            ///< views
  /// Flange poses, in addition to those of the views, that are not suggested again: held-out ones.
  std::vector<Pose> taken;
};

/// Coverage of `views`, those that take part in the fit.
struct Coverage {
  std::size_t views = 0;
  std::array<double, 3> rotation_spread_axes_deg{0.0, 0.0, 0.0};  ///< descending; the last one should reach 15
  std::array<bool, kSectors> sectors{};
  std::array<bool, kPlaces * kDepths> cells{};  ///< [depth * kPlaces + place]
  /// Predicted point error with these views, times max(1, s0) if known; NaN if not determined yet.
  double point_sigma_mm = kNoValue;

  [[nodiscard]] std::size_t sectors_seen() const;
  [[nodiscard]] std::size_t cells_seen() const;
};

/// A pose to drive to.
struct Suggestion {
  Pose T_base_flange;
  double tilt_deg = 0.0;   ///< tilt of the scanner's axis from straight down ...
  std::size_t sector = 0;  ///< ... towards this side
  double roll_deg = 0.0;   ///< rotation about the scanner's axis, relative to the first view
  std::size_t place = 0;   ///< place of the target in the view; 0: the middle
  std::size_t depth = 0;
  Vec3 target_scanner = Vec3::Zero();  ///< expected place of the target
  double place_sigma_mm = kNoValue;    ///< uncertainty of that place, worst axis
  double point_sigma_mm = kNoValue;  ///< as Coverage::point_sigma_mm, including this view; NaN if still not determined
};

struct Guide {
  Coverage coverage;
  bool solved = false;  ///< the estimate is the solution of these views; otherwise it depends on the start
  std::optional<Pose> T_flange_scanner;  ///< the present estimate; nullopt if neither views nor a start determine one
  double misfit_mm = kNoValue;     ///< rms if the views disagree by far more than stated; then no error is predicted
  std::optional<Suggestion> next;  ///< nullopt without a view (the target's place is unknown) or without an estimate
};

/// Evaluates the views and proposes the next one. `start`: approximate pose of the scanner (within about 30 mm and 10
/// degrees), or nullptr if unknown; then suggestions begin with the sixth view. Pure; the same views give the same
/// suggestion. About 50 ms.
[[nodiscard]] Guide guide_next(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise,
                               const CoverageSettings& settings, const Pose* start);

/// Angle of a view's scanner axis from straight down, deg.
[[nodiscard]] double tilt_deg(const Pose& T_base_flange, const Pose& T_flange_scanner, const Vec3& down_base);

// Texts for the person at the robot.

[[nodiscard]] std::string sector_words(std::size_t sector);                   ///< "to the left"
[[nodiscard]] std::string place_words(std::size_t place, std::size_t depth);  ///< "in the +x +y corner, near"
/// Text such as "tilt 25 deg to the left (the scanner looks towards base +Y), ball in the near +x +y corner of the
/// view, roll +45".
[[nodiscard]] std::string suggestion_words(const Suggestion& suggestion, ArtefactKind kind);
/// Texts of the gaps in the coverage; empty if there are none. Below kViewsMin views only the rotation is reported.
[[nodiscard]] std::vector<std::string> missing_words(const Coverage& coverage, ArtefactKind kind);

}  // namespace slabd::calib
