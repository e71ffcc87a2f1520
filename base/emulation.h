// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

/// Parts of the line that were not the real ones. A slab, an attempt and a record hold them as bits; 0: all were real,
/// as far as they say. A result with any bit set is not a verdict on concrete, whatever it reads.
namespace slabd {

inline constexpr unsigned kEmulatedLine = 1U << 0U;    ///< [line] simulation = true
inline constexpr unsigned kEmulatedRobot = 1U << 1U;   ///< the poses declare themselves emulated (flags, bit 4)
inline constexpr unsigned kCommandedPoses = 1U << 2U;  ///< the poses are not measured (flags, bit 0 is missing)
inline constexpr unsigned kEmulatedScan = 1U << 3U;    ///< the scan declares itself emulated (comment or header)

/// By bit; as JSON, metrics and exports name them.
inline constexpr std::array<std::string_view, 4> kEmulationNames = {"line", "robot", "poses", "scan"};

}  // namespace slabd
