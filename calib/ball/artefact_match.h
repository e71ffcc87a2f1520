// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "base/base.h"
#include "calib/ball/artefact.h"

/// Which measured ball is which certified one. Internal to calib.
namespace slabd::calib {

/// A certificate whose balls fit each other in another order within this is refused: measured distances may be off by
/// 0.3 mm, twice that must still tell the balls apart, and some is kept in reserve.
inline constexpr double kTellApartMm = 1.0;

struct Assignments {
  /// [certified] = index of the measured ball; at most two are looked for: none, the one, or not unique.
  std::vector<std::vector<int>> found;
};

/// Every way, up to two, to give each certified ball another measured one so that all distances agree within `off_mm`.
[[nodiscard]] Assignments assign_by_distance(std::span<const Vec3> certified, std::span<const Vec3> measured,
                                             double off_mm);

/// config: fewer than three balls or more than eight, balls that touch, lie on a line, or cannot be told apart.
[[nodiscard]] Status check_certificate(const ArtefactCertificate& certificate);

}  // namespace slabd::calib
