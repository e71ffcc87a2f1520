// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/base.h"
#include "hal/hal.h"

/// Values as people write them on the command line.
namespace slabd::cli {

/// "x y z qw qx qy qz" (mm, unit quaternion within 1e-3), separated by blanks or commas. config: what is wrong, and
/// the allowed range.
[[nodiscard]] Result<Pose> parse_pose(std::string_view text);

/// A moment (UTC), as us since 1970: "2026-11-20", "2026-11-20T23:28:01Z", or so long before `now_utime_us`: "30m",
/// "12h", "7d". config: what was expected.
[[nodiscard]] Result<std::int64_t> parse_time(std::string_view text, std::int64_t now_utime_us);

[[nodiscard]] std::optional<hal::LengthUnit> length_unit(std::string_view name);

}  // namespace slabd::cli
