// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string_view>

#include "base/base.h"
#include "hal/hal.h"

/// Values as people write them on the command line.
namespace slabd::cli {

/// "x y z qw qx qy qz" (mm, unit quaternion within 1e-3), separated by blanks or commas. config: what is wrong, and
/// the allowed range.
[[nodiscard]] Result<Pose> parse_pose(std::string_view text);

[[nodiscard]] std::optional<hal::LengthUnit> length_unit(std::string_view name);

}  // namespace slabd::cli
