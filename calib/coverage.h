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

/// What the views so far cover, and where to drive next: for the person at the robot, after every view.
namespace slabd::calib {

/// Directions the scanner can look in beside straight down, as seen by somebody at the robot's foot who looks along
/// base +X: away, away and left, left (base +Y), back and left, back, back and right, right, away and right.
inline constexpr std::size_t kSectors = 8;
/// Places of the target in the view: near, mid and far, each with middle, +x +y, -x +y, -x -y, +x -y.
inline constexpr std::size_t kPlaces = 5;
inline constexpr std::size_t kDepths = 3;
inline constexpr double kTiltCountsDeg = 10.0;  ///< a view that is tilted less belongs to no sector

struct CoverageSettings {
  FieldOfView fov;
  Vec3 down_base = -Vec3::UnitZ();  ///< where the scanner looks in production
  double target_radius_mm = 0.0;    ///< of what must be whole in the view; an artefact's reach
  std::size_t goal = 20;            ///< views
  std::vector<Pose> taken;          ///< flange poses not to suggest again, beside those of the views: held-out ones
};

/// What is covered. `views` are those that take part in the fit.
struct Coverage {
  std::size_t views = 0;
  std::array<double, 3> rotation_spread_axes_deg{0.0, 0.0, 0.0};  ///< descending; the last should reach 15
  std::array<bool, kSectors> sectors{};
  std::array<bool, kPlaces * kDepths> cells{};  ///< [depth * kPlaces + place]
  /// Predicted point error with these views, times max(1, s0) once there is one; NaN: not determined yet.
  double point_sigma_mm = kNoValue;

  [[nodiscard]] std::size_t sectors_seen() const;
  [[nodiscard]] std::size_t cells_seen() const;
};

/// A pose to drive to.
struct Suggestion {
  Pose T_base_flange;
  double tilt_deg = 0.0;   ///< of the scanner's axis against straight down ...
  std::size_t sector = 0;  ///< ... towards this side
  double roll_deg = 0.0;   ///< about the scanner's axis, against the first view
  std::size_t place = 0;   ///< of the target in the view; 0: the middle
  std::size_t depth = 0;
  Vec3 target_scanner = Vec3::Zero();  ///< where the target will be seen
  double place_sigma_mm = kNoValue;    ///< how well that is known, the worst axis
  double point_sigma_mm = kNoValue;    ///< as Coverage::point_sigma_mm, with this view; NaN: still not determined
};

struct Guide {
  Coverage coverage;
  bool solved = false;                   ///< the estimate is the solution of these views; else it leans on the start
  std::optional<Pose> T_flange_scanner;  ///< the present estimate; empty: neither views nor a start say anything
  double misfit_mm = kNoValue;     ///< the views miss each other by far more than stated, rms; no error is predicted
  std::optional<Suggestion> next;  ///< empty: no view yet (the target's place is not known), or no estimate
};

/// Looks at what is there and proposes the next view. `start`: roughly where the scanner sits (within some 30 mm and 10
/// degrees), nullptr when nobody knows; then suggestions begin with the sixth view. Pure; the same views give the same
/// suggestion. About 50 ms.
[[nodiscard]] Guide guide_next(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise,
                               const CoverageSettings& settings, const Pose* start);

/// The scanner's axis of a view against straight down, deg.
[[nodiscard]] double tilt_deg(const Pose& T_base_flange, const Pose& T_flange_scanner, const Vec3& down_base);

// In words, for the person at the robot.

[[nodiscard]] std::string sector_words(std::size_t sector);                   ///< "to the left"
[[nodiscard]] std::string place_words(std::size_t place, std::size_t depth);  ///< "in the +x +y corner, near"
/// "tilt 25 deg to the left (the scanner looks towards base +Y), ball in the near +x +y corner of the view, roll +45"
[[nodiscard]] std::string suggestion_words(const Suggestion& suggestion, ArtefactKind kind);
/// One line for everything that is not covered yet; empty: nothing is missing.
[[nodiscard]] std::vector<std::string> missing_words(const Coverage& coverage, ArtefactKind kind);

}  // namespace slabd::calib
