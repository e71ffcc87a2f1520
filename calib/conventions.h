// SPDX-License-Identifier: Apache-2.0
#pragma once

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
enum class Misreading : std::uint8_t { none, convention, units };

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

struct ConventionReport {
  std::vector<Hypothesis> tried;  ///< [0] is "as stated"; best first after it
  bool stated_fits = true;
  /// Index of the only other reading that explains the views, or 0. When several fit as well as it (they cannot be told
  /// apart by these views), the first of them.
  std::size_t fits = 0;
};

/// Tries all readings. Needs at least 5 views; with fewer, or when rotations are too small to tell, nothing is claimed:
/// stated_fits stays true. A reading is named only if what is stated is off by more than 3 sigmas and the reading
/// explains the views at least five times as well.
[[nodiscard]] ConventionReport test_conventions(ArtefactKind kind, std::span<const View> views,
                                                const StatedNoise& noise);

}  // namespace slabd::calib
