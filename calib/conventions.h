// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/base.h"
#include "calib/observations.h"

/// Test of the stated conventions of poses. Typical mistakes are another order of the angles, a transposed matrix, a
/// quaternion with another first element, metres for millimetres, or an inverse. Wrong poses fit badly or only in part.
/// All such readings are tried, and the one that fits is reported.
namespace slabd::calib {

/// Property changed by a reading.
enum class ConventionError : std::uint8_t {
  none,
  convention,
  units,
  handedness,  ///< an axis of the scanner is mirrored
  pairing,     ///< a target belongs to the flange pose of another line
};

/// Formats declared in the tables; empty if no table was read (a session). A cure never proposes a format that is
/// already declared.
struct DeclaredFormats {
  std::optional<PoseFormat> flange;
  std::optional<PoseFormat> target;
};

/// One reading of the views.
struct Hypothesis {
  std::string name;  ///< "as stated", "flange angles are X-Y-Z, not Z-Y-X of (A, B, C)", ...
  std::string cure;  ///< instruction for correcting the file
  ConventionError changes = ConventionError::none;
  double angle_mismatch_deg = kNoValue;  ///< pose: median over pairs of |angle(A_ij) - angle(B_ij)|
  double pitch_mismatch_mm = kNoValue;   ///< pose: median over pairs of the difference of shifts along the motion axes
  double residual_mm = kNoValue;         ///< median over views
  double residual_deg = kNoValue;        ///< pose
  double sigmas = kNoValue;              ///< robust size of the residuals over the stated noise: about 1 if right
};

/// The largest group of views with the same target although the flange moved. That is impossible for an artefact fixed
/// in the cell.
struct SameTarget {
  std::vector<std::size_t> views;  ///< indices, ascending; none if fewer than two
  double moved_mm = 0.0;           ///< largest distance between two of their flange poses
  double turned_rad = 0.0;         ///< largest rotation between two of their flange poses
};
/// Finds such a group. Ball: equal to 1e-6 mm. Pose: equal within five sigmas of the stated target noise, with flange
/// poses farther apart than ten sigmas.
[[nodiscard]] SameTarget same_target(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise);

struct ConventionReport {
  std::vector<Hypothesis> tried;  ///< [0] is "as stated"; then best first
  bool stated_fits = true;
  /// Index of the only other reading that explains the views, or 0. If several fit equally well (these views cannot
  /// distinguish them), the first of them.
  std::size_t fits = 0;
};

/// Largest residuals of a proposed reading, in multiples of the stated noise.
inline constexpr double kReadingFitsSigmas = 3.0;

/// Tries all readings. Requires at least 5 views; with fewer, or if the rotations are too small, stated_fits stays
/// true. A reading is reported only under two conditions. The stated one must be wrong by more than 3 sigmas, or
/// contradict many views. The other must explain the views at least five times better, and within kReadingFitsSigmas.
[[nodiscard]] ConventionReport test_conventions(ArtefactKind kind, std::span<const View> views,
                                                const StatedNoise& noise, const DeclaredFormats& declared = {});

}  // namespace slabd::calib
