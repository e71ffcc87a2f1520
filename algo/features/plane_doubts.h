// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "algo/features/hypotheses.h"

/// What can make a plane confident and wrong: structure among the points instead of noise. All on the sample.
namespace slabd::algo {

/// Does the zone of +-`threshold` around the best plane hold two surfaces, one beside or above the other, with next to
/// nothing in between? A plane through both is nobody's plane. If so, `level` becomes the plane of the stronger one and
/// `threshold` its own three robust standard deviations. A bow, a wave or a roof is one surface; two that lie closer
/// together than about four standard deviations of the noise look like a noisier one.
[[nodiscard]] bool find_level(const PlaneSample& sample, const PlaneSearch& search, double reach, Residuals& scratch,
                              FlatPlane& level, double& threshold);

/// Do the points leave open which plane is meant: is there, among the points further than `threshold` from `plane`,
/// another plane that holds at least four fifths as many points, a fifth of them its own?
[[nodiscard]] bool has_rival(const PlaneSample& sample, const PlaneSearch& search, const FlatPlane& plane,
                             double threshold);

/// Does the plane owe its place to where the threshold happens to cut? A second surface three to four standard
/// deviations away leans on the plane from one side; with the threshold a quarter wider the plane then moves by more
/// than a tenth of a standard deviation. Where it then tilts by no more than `tilt_max_rad` (and that is not 0), it
/// does not count.
[[nodiscard]] bool bends_with_threshold(const PlaneSample& sample, const FlatPlane& plane, double threshold,
                                        double tilt_max_rad);

}  // namespace slabd::algo
