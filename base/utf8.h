// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace slabd {

struct CodePoint {
  char32_t value = 0;
  std::size_t bytes = 1;
  bool is_utf8 = true;  ///< false: a byte that is none of it, `value` is its number
};

/// What stands at the front of `text`, which is not empty.
[[nodiscard]] inline CodePoint code_point_at(std::string_view text) {
  const auto byte = [text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const char32_t lead = byte(0);
  const std::size_t bytes = lead < 0xC2 ? 1 : lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : lead < 0xF5 ? 4 : 1;
  const CodePoint stray{lead, 1, lead < 0x80};
  if (bytes == 1 || bytes > text.size()) return stray;
  char32_t value = lead & (0x7FU >> bytes);
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) return stray;
    value = value << 6U | (byte(i) & 0x3FU);
  }
  constexpr std::array<char32_t, 5> kLeast = {0, 0, 0x80, 0x800, 0x1'0000};
  const bool surrogate = value >= 0xD800 && value <= 0xDFFF;
  if (value < kLeast[bytes] || value > 0x10'FFFF || surrogate) return stray;
  return {value, bytes, true};
}

}  // namespace slabd
