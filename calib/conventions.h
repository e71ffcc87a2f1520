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

/// Do the poses mean what the file says? A robot's angles in another order, a transposed matrix, a quaternion that
/// starts with the wrong number, metres for millimetres, an inverse: each fits nothing, or worse, fits half. Every such
/// reading is tried and the one that fits is named.
namespace slabd::calib {

/// What a reading changes.
enum class Misreading : std::uint8_t {
  none,
  convention,
  units,
  handedness,  ///< an axis of the scanner is mirrored
  pairing,     ///< a target belongs to another line's flange pose
};

/// What the tables declare about themselves; empty where no table was read (a session). A cure never proposes what the
/// table declares already.
struct DeclaredFormats {
  std::optional<PoseFormat> flange;
  std::optional<PoseFormat> target;
};

/// One reading of the views.
struct Hypothesis {
  std::string name;  ///< "as stated", "flange angles are X-Y-Z, not Z-Y-X of (A, B, C)", ...
  std::string cure;  ///< how to write the file instead
  Misreading changes = Misreading::none;
  double angle_mismatch_deg = kNoValue;  ///< pose: median over pairs of |angle(A_ij) - angle(B_ij)|
  double pitch_mismatch_mm =
      kNoValue;                    ///< pose: median over pairs of the motions' shift along their own axes, compared
  double residual_mm = kNoValue;   ///< median over views
  double residual_deg = kNoValue;  ///< pose
  double sigmas = kNoValue;        ///< robust size of the residuals over the stated noise: about 1 when right
};

/// The largest group of views whose target is the same although the flange moved. An artefact that is fixed in the cell
/// cannot look so.
struct SameTarget {
  std::vector<std::size_t> views;  ///< indices, ascending; fewer than two: none
  double moved_mm = 0.0;           ///< largest distance between two of their flange poses
  double turned_rad = 0.0;         ///< largest rotation between two of them
};
/// Ball: equal to 1e-6 mm. Pose: equal within five sigmas of the stated target noise, with flange poses that are
/// further apart than ten.
[[nodiscard]] SameTarget same_target(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise);

struct ConventionReport {
  std::vector<Hypothesis> tried;  ///< [0] is "as stated"; best first after it
  bool stated_fits = true;
  /// Index of the only other reading that explains the views, or 0. When several fit as well as it (they cannot be told
  /// apart by these views), the first of them.
  std::size_t fits = 0;
};

/// Residuals of a reading that is proposed are at most this many times the stated noise.
inline constexpr double kReadingFitsSigmas = 3.0;

/// Tries all readings. Needs at least 5 views; with fewer, or when rotations are too small to tell, nothing is claimed:
/// stated_fits stays true. A reading is named only if what is stated is off by more than 3 sigmas, or contradicts many
/// views, and the reading explains the views at least five times as well and to within kReadingFitsSigmas.
[[nodiscard]] ConventionReport test_conventions(ArtefactKind kind, std::span<const View> views,
                                                const StatedNoise& noise, const DeclaredFormats& declared = {});

}  // namespace slabd::calib
