// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/base.h"

/// Planted faults, `name=K:VALUE` on the command line: block K is cast, placed or scanned wrongly by a known amount.
/// Faults of the whole slab are written `name=VALUE`.
/// Faults of the whole slab are written `name=VALUE`.
namespace slabd::emulator {

enum class DefectKind : std::uint8_t {
  slope,
  jaw_angle_inner,
  jaw_angle_outer,
  jaw_distance,
  protrusion_inner,
  protrusion_outer,
  casing_spacing,
  bump,
  chip,
  burr,
  sunk_seat,
  broken_corner,
  missing,
  outliers,
  noise,
  glove,
  cable,
  robot,
  along,
  lateral,
  vertical,
  large_jaw,
  corner_level,
  warp_left,
  warp_right,
};

struct Defect {
  DefectKind kind{};
  int station = 0;     ///< 0: the whole slab
  double value = 0.0;  ///< as written: mm, deg, a share, or n of 1:n
};

/// Parses one `--defect`. Code::config on failure; the text names the option, the expected form and the allowed range.
[[nodiscard]] Result<Defect> parse_defect(std::string_view text);

/// Help text: every kind with its unit, range and meaning, one per line.
[[nodiscard]] std::string defect_help();

}  // namespace slabd::emulator
