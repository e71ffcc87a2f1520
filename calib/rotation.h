// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "base/base.h"

/// Small rotations as vectors: axis times angle (rad). Internal to the room.
namespace slabd::calib {

[[nodiscard]] Mat3 skew(const Vec3& v);

[[nodiscard]] Quat exp_rotation(const Vec3& v);

/// Length 0..pi.
[[nodiscard]] Vec3 log_rotation(const Quat& q);

/// d log(exp(d) exp(r)) / dd at d = 0.
[[nodiscard]] Mat3 left_jacobian_inverse(const Vec3& r);

/// The rotation nearest to a matrix.
[[nodiscard]] Mat3 nearest_rotation(const Mat3& m);

/// The motion that takes `from` to `to` best, unweighted (Kabsch 1976; Arun et al. 1987). Three points or more, not on
/// a line.
[[nodiscard]] Pose rigid_fit(std::span<const Vec3> from, std::span<const Vec3> to);

/// The shortest rotation that takes one direction (any length > 0) to another.
[[nodiscard]] Quat rotation_between(const Vec3& from, const Vec3& to);

}  // namespace slabd::calib
