// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <string_view>

namespace slabd::cli::watch {

inline constexpr std::size_t kLetterRows = 5;
inline constexpr std::size_t kLetterColumns = 6;  ///< with the gap behind it

/// The word in large letters of '#', row by row, kLetterColumns for each letter; empty if it contains a letter that no
/// verdict has.
[[nodiscard]] std::array<std::string, kLetterRows> large_letters(std::string_view word);

}  // namespace slabd::cli::watch
