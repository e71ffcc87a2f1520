// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "hal/hal.h"

/// PLY, PCD and text scans have no field for a unit of length, so it is configured. Some programs write it into a
/// comment or a column name all the same; then it must agree with the configuration.
namespace slabd::hal {

[[nodiscard]] double mm_per(LengthUnit unit);
[[nodiscard]] const char* name(LengthUnit unit);

/// `text` is what follows the comment's mark. A declaration is "unit", "units", "length unit" or "length_unit", in any
/// case, then a known name of a unit of length (mm, millimetres, m, meters, um, microns, cm, inch, ...), with ':', '=',
/// "is" or "in" between them or not. False: it declares another unit than `configured` (also one that slabd cannot be
/// configured for); `found` is then its word. Comments that declare nothing are for people.
[[nodiscard]] bool comment_agrees(std::string_view text, LengthUnit configured, std::string_view& found);

/// `text` declares a unit that has a known name.
[[nodiscard]] bool declares_unit(std::string_view text);

/// The same for the bare name of a unit, as in a column headed "x [mm]"; an unknown name agrees with everything.
[[nodiscard]] bool unit_name_agrees(std::string_view word, LengthUnit configured);

/// "file: line n: the file says unit "found", but it is to be read in mm ..."
[[nodiscard]] Error unit_contradicted(const char* file, std::size_t line, std::string_view found,
                                      LengthUnit configured);

/// What a comment declares whose first word is "emulated": "emulated by slabctl simulate, block 3".
struct DeclaredEmulation {
  bool emulated = false;
  std::uint8_t block = 0;  ///< 0: not said

  void take(std::string_view comment);
};

}  // namespace slabd::hal
