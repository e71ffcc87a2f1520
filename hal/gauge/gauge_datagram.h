// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

/// Text of a gauge hub in a UDP datagram: one line for each value, "NAME VALUE SEQ SLAB_NO", separated by blanks.
///
///     length_left 5600.123 17 10042
///
/// VALUE is a number up to 1e9 before the gauge's scale, SEQ 1..4294967295 changes with every measurement, SLAB_NO is
/// the slab that was measured, 0 if the hub does not know it. Empty lines are skipped.
namespace slabd::hal {

struct GaugeLine {
  std::string_view name;  ///< part of the text
  double number = 0.0;    ///< may be "nan": the gauge has no value
  std::uint32_t seq = 0;
  std::uint32_t slab_no = 0;
};

/// Parses one line without its end; nullopt if it has another form. No heap.
[[nodiscard]] std::optional<GaugeLine> parse_gauge_line(std::string_view line);

/// Removes the next line from the front of `text`, without LF or CR LF.
[[nodiscard]] std::string_view next_line(std::string_view& text);

}  // namespace slabd::hal
