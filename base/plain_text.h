// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "base/utf8.h"

/// Text from outside (a database, a daemon's answer, a file) as people may see it in a terminal.
///
/// Problem: a control character in a stored text sets a terminal's title, clears the screen or begins a line of its
/// own; a bidirectional override shows characters in another order. Idea: each of them is replaced by its number as in
/// C ("\x1b", "\u202e"), in ASCII, so that no terminal reads a part of the replacement as a control character. Chinese
/// and every other visible text stays as it is.
namespace slabd {

/// True if a terminal may do something else with the character than show it in its place: controls (Unicode category
/// Cc), bidirectional and other invisible format characters (Cf), line and paragraph separators, tags.
[[nodiscard]] constexpr bool is_control(char32_t c) {
  return c < 0x20 || (c >= 0x7F && c <= 0x9F) || c == 0xAD || c == 0x61C || c == 0x180E ||
         (c >= 0x200B && c <= 0x200F) || (c >= 0x2028 && c <= 0x202E) || (c >= 0x2060 && c <= 0x206F) || c == 0xFEFF ||
         (c >= 0xFFF9 && c <= 0xFFFB) || (c >= 0xE0000 && c <= 0xE007F);
}

/// Lines stay: '\n' and '\t', '\r' before a '\n', and the byte order mark of a file.
enum class Lines { replaced, kept };

/// `text` with every control character and every byte that is not UTF-8 replaced.
[[nodiscard]] std::string plain(std::string_view text, Lines lines = Lines::replaced);

/// True if plain() would change nothing.
[[nodiscard]] bool is_plain(std::string_view text, Lines lines = Lines::replaced);

}  // namespace slabd
