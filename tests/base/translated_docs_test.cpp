// SPDX-License-Identifier: Apache-2.0
//
// The Chinese pages have the headings, the commands, the tables and their numbers of the English pages, and no English
// sentence.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "tests/places/places.h"

namespace slabd {
namespace {

struct Pair {
  std::string folder;
  std::string name;
};
const std::array<Pair, 6> kPairs = {{{"/", "README"},
                                     {"/docs/", "OPERATOR"},
                                     {"/docs/", "MAINTENANCE"},
                                     {"/docs/", "QUALITY"},
                                     {"/docs/", "MOULDS"},
                                     {"/docs/", "CALIBRATION"}}};
constexpr std::size_t kShortLine = 40;

using Words = std::vector<std::string>;

struct Page {
  std::string text;
  std::vector<std::size_t> headings;  ///< level of each
  Words code;                         ///< lines of code blocks, without comments
  std::vector<Words> tables;          ///< rows of each
  Words prose;                        ///< all other lines and the tables' rows
};

std::string without_comment(const std::string& line) {
  static const std::regex kComment("(^|\\s+)#.*$|\\s+$");
  return std::regex_replace(line, kComment, "");
}

void take_prose(Page& page, const std::string& line, bool table_before) {
  page.prose.push_back(line);
  if (line.front() == '#') page.headings.push_back(line.find_first_not_of('#'));
  if (line.front() != '|') return;
  if (!table_before) page.tables.emplace_back();
  page.tables.back().push_back(line);
}

Page read_page(const std::string& path) {
  Page page;
  std::ifstream in(path);
  page.text = {std::istreambuf_iterator<char>(in), {}};
  std::istringstream lines(page.text);
  bool fenced = false;
  bool code = false;
  char before = 0;
  for (std::string line; std::getline(lines, line); before = line.empty() ? '\0' : line.front()) {
    const bool fence = line.rfind("```", 0) == 0;
    if (fence) fenced = !fenced;
    if (line.empty() || fence) continue;
    // An indented block begins after an empty line and may contain empty lines.
    code = fenced || (line.rfind("    ", 0) == 0 && (code || before == '\0'));
    if (!code) {
      take_prose(page, line, before == '|');
    } else if (const std::string command = without_comment(line); !command.empty()) {
      page.code.push_back(command);
    }
  }
  return page;
}

Page english(const Pair& pair) {
  return read_page(places::source_dir() + pair.folder + pair.name + ".md");
}

Page chinese(const Pair& pair) {
  return read_page(places::source_dir() + pair.folder + pair.name + ".zh.md");
}

/// Sorted, each as often as it occurs; the expression's last group if it has one.
Words matches(const std::string& text, const std::regex& expression) {
  Words found;
  for (std::sregex_iterator at(text.begin(), text.end(), expression), end; at != end; ++at)
    found.push_back(at->str(at->size() - 1));
  std::sort(found.begin(), found.end());
  return found;
}

Words numbers(const std::string& text) {
  static const std::regex kNumber("([0-9]+(?:[.,][0-9]+)*)");
  return matches(text, kNumber);
}

/// Commands, options, keys and paths within the text. The words of the screen are not among them.
Words inline_code(const Page& page) {
  static const std::regex kSpan("`([^`]+)`");
  static const std::regex kCommand("^slab(d|ctl)|[-/_=\\[]");
  std::string text;
  for (const std::string& line : page.prose) text += line + " ";
  Words spans = matches(text, kSpan);
  spans.erase(std::remove_if(spans.begin(), spans.end(),
                             [](const std::string& span) { return !std::regex_search(span, kCommand); }),
              spans.end());
  return spans;
}

Words missing(const Words& wanted, const Words& present) {
  Words result;
  std::set_difference(wanted.begin(), wanted.end(), present.begin(), present.end(), std::back_inserter(result));
  return result;
}

/// The first bytes of U+4000 to U+9FFF in UTF-8; none of them occurs later in a character.
bool has_chinese(const std::string& line) {
  return std::any_of(line.begin(), line.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte >= 0xE4 && byte <= 0xE9;
  });
}

bool has_english_prose(const std::string& line) {
  static const std::regex kCode("`[^`]*`");
  static const std::regex kFiveWords("([A-Za-z]+,? ){4}[A-Za-z]");
  return (line.size() > kShortLine && !has_chinese(line)) ||
         std::regex_search(std::regex_replace(line, kCode, ""), kFiveWords);
}

TEST(TranslatedDocs, each_page_links_to_the_other) {
  for (const Pair& pair : kPairs) {
    EXPECT_NE(english(pair).text.find("](" + pair.name + ".zh.md)"), std::string::npos) << pair.name;
    EXPECT_NE(chinese(pair).text.find("](" + pair.name + ".md)"), std::string::npos) << pair.name;
  }
}

TEST(TranslatedDocs, the_headings_have_the_same_levels) {
  for (const Pair& pair : kPairs) {
    EXPECT_FALSE(english(pair).headings.empty()) << pair.name;
    EXPECT_EQ(chinese(pair).headings, english(pair).headings) << pair.name;
  }
}

TEST(TranslatedDocs, the_commands_are_the_same) {
  std::size_t lines = 0;
  for (const Pair& pair : kPairs) {
    const Page page = english(pair);
    lines += page.code.size();
    EXPECT_EQ(chinese(pair).code, page.code) << pair.name;
    EXPECT_EQ(missing(inline_code(page), inline_code(chinese(pair))), Words{}) << pair.name;
  }
  EXPECT_GT(lines, 8U) << "code blocks are not recognised";
}

TEST(TranslatedDocs, the_tables_have_the_same_rows_with_the_same_numbers) {
  for (const Pair& pair : kPairs) {
    const Page page = english(pair);
    const Page translated = chinese(pair);
    ASSERT_EQ(translated.tables.size(), page.tables.size()) << pair.name;
    EXPECT_FALSE(page.tables.empty()) << pair.name;
    for (std::size_t i = 0; i < page.tables.size(); ++i) {
      ASSERT_EQ(translated.tables[i].size(), page.tables[i].size()) << pair.name << ", table " << i + 1;
      for (std::size_t k = 0; k < page.tables[i].size(); ++k)
        EXPECT_EQ(missing(numbers(page.tables[i][k]), numbers(translated.tables[i][k])), Words{})
            << pair.name << ": " << translated.tables[i][k];
    }
  }
}

TEST(TranslatedDocs, no_sentence_is_left_in_english) {
  for (const Pair& pair : kPairs) {
    for (const std::string& line : chinese(pair).prose)
      EXPECT_FALSE(has_english_prose(line)) << pair.name << ": " << line;
    const Words prose = english(pair).prose;
    EXPECT_TRUE(std::any_of(prose.begin(), prose.end(), has_english_prose)) << pair.name << " is not in English";
  }
}

}  // namespace
}  // namespace slabd
