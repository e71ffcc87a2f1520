// SPDX-License-Identifier: Apache-2.0
#include "cli/watch/letters.h"

#include <algorithm>
#include <cctype>

namespace slabd::cli::watch {
namespace {

struct Letter {
  char letter;
  std::array<std::string_view, kLetterRows> rows;
};

/// Letters of the English words of all verdicts.
constexpr std::array<Letter, 16> kLetters = {{
    {' ', {"     ", "     ", "     ", "     ", "     "}},
    {'A', {" ### ", "#   #", "#####", "#   #", "#   #"}},
    {'B', {"#### ", "#   #", "#### ", "#   #", "#### "}},
    {'D', {"#### ", "#   #", "#   #", "#   #", "#### "}},
    {'E', {"#####", "#    ", "#### ", "#    ", "#####"}},
    {'F', {"#####", "#    ", "#### ", "#    ", "#    "}},
    {'I', {"#####", "  #  ", "  #  ", "  #  ", "#####"}},
    {'L', {"#    ", "#    ", "#    ", "#    ", "#####"}},
    {'M', {"#   #", "## ##", "# # #", "#   #", "#   #"}},
    {'N', {"#   #", "##  #", "# # #", "#  ##", "#   #"}},
    {'O', {" ### ", "#   #", "#   #", "#   #", " ### "}},
    {'P', {"#### ", "#   #", "#### ", "#    ", "#    "}},
    {'R', {"#### ", "#   #", "#### ", "#  # ", "#   #"}},
    {'S', {" ####", "#    ", " ### ", "    #", "#### "}},
    {'T', {"#####", "  #  ", "  #  ", "  #  ", "  #  "}},
    {'U', {"#   #", "#   #", "#   #", "#   #", " ### "}},
}};

}  // namespace

std::array<std::string, kLetterRows> large_letters(std::string_view word) {
  std::array<std::string, kLetterRows> rows;
  for (const char c : word) {
    const char capital = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    const auto found = std::find_if(kLetters.begin(), kLetters.end(),
                                    [capital](const Letter& letter) { return letter.letter == capital; });
    if (found == kLetters.end()) return {};
    for (std::size_t row = 0; row < kLetterRows; ++row) rows.at(row) += std::string(found->rows.at(row)) + " ";
  }
  return rows;
}

}  // namespace slabd::cli::watch
