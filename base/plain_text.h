// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

/// Conversion of text from outside (a database, a daemon's answer, a file) for display in a terminal.
///
/// Problem: a control character in a stored text sets a terminal's title, clears the screen or starts a line. A
/// bidirectional override changes the order of the characters. Idea: each of them is replaced by its number as in C
/// ("\x1b", "\u202e"), in ASCII, so that no terminal interprets a part of it. Chinese and all other visible text is
/// unchanged.
namespace slabd {

struct CodePoint {
  char32_t value = 0;
  std::size_t bytes = 1;
  bool is_utf8 = true;  ///< false: a byte that is not valid UTF-8; `value` is its number
};

/// Returns the first code point of `text`, which is not empty.
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

/// True if a terminal may do anything but display the character in its place. These are controls (Unicode category Cc),
/// bidirectional and other invisible format characters (Cf), line and paragraph separators, and tags.
[[nodiscard]] constexpr bool is_control(char32_t c) {
  return c < 0x20 || (c >= 0x7F && c <= 0x9F) || c == 0xAD || c == 0x61C || c == 0x180E ||
         (c >= 0x200B && c <= 0x200F) || (c >= 0x2028 && c <= 0x202E) || (c >= 0x2060 && c <= 0x206F) || c == 0xFEFF ||
         (c >= 0xFFF9 && c <= 0xFFFB) || (c >= 0xE0000 && c <= 0xE007F);
}

/// Lines::kept leaves '\n' and '\t', '\r' before a '\n', and the byte order mark of a file unchanged.
enum class Lines { replaced, kept };

/// Returns `text` with every control character and every byte that is not valid UTF-8 replaced.
[[nodiscard]] std::string plain(std::string_view text, Lines lines = Lines::replaced);

/// True if plain() would change nothing.
[[nodiscard]] bool is_plain(std::string_view text, Lines lines = Lines::replaced);

}  // namespace slabd
