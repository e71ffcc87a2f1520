// SPDX-License-Identifier: Apache-2.0
//
// The catalogue of texts contains what the sources say, and nothing else. A translation has the placeholders of its
// English text.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "report/say.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

struct Sources {
  std::set<std::string> said;      ///< texts given to say(), marked() and the doctor's findings
  std::set<std::string> literals;  ///< all literals; neighbours are one
};

bool says(std::string_view code) {
  while (!code.empty() && (code.back() == ' ' || code.back() == '\n')) code.remove_suffix(1);
  if (code.ends_with("language,")) code.remove_suffix(9);
  for (const char* call :
       {"say(", "marked(", "report.ok(", "report.note(", "report.warning(", "report.failed(", "report.unknown("})
    if (code.ends_with(call)) return true;
  return false;
}

/// Adds the literals of a file.
void read_file(const std::string& text, Sources& sources) {
  const bool may_say = text.find("/say.h\"") != std::string::npos;
  for (std::size_t at = 0; at < text.size(); ++at) {
    if (text.compare(at, 2, "//") == 0) at = std::min(text.find('\n', at), text.size() - 1);
    if (text.compare(at, 3, "'\"'") == 0) at += 3;
    if (text[at] != '"') continue;
    const std::size_t begin = at;
    std::string literal;
    while (text[at] == '"') {
      for (++at; at < text.size() && text[at] != '"'; ++at)
        literal += text[at] != '\\' ? text[at] : text[++at] == 'n' ? '\n' : text[at];
      const std::size_t next = text.find_first_not_of(" \n", at + 1);
      if (next == std::string::npos || text[next] != '"') break;
      at = next;
    }
    if (may_say && says(std::string_view(text).substr(0, begin))) sources.said.insert(literal);
    sources.literals.insert(literal);
  }
}

const Sources& sources() {
  static const Sources kSources = [] {
    Sources read;
    for (const char* room : {"base", "algo", "calib", "storage", "daemon", "report", "cli", "web"})
      for (const auto& entry : fs::recursive_directory_iterator(fs::path(places::source_dir()) / room)) {
        const fs::path extension = entry.path().extension();
        if ((extension != ".cpp" && extension != ".h") || entry.path().native().ends_with("catalogue.cpp")) continue;
        std::ifstream in(entry.path());
        read_file({std::istreambuf_iterator<char>(in), {}}, read);
      }
    return read;
  }();
  return kSources;
}

/// Placeholders by the number of their value, with their formats: "0", "1:.3f".
std::set<std::string> placeholders(std::string_view text) {
  static const std::regex kPlaceholder(R"(\{(\d*)(:[^}]*)?\})");
  std::set<std::string> found;
  const std::string whole(text);
  int next = 0;
  for (std::sregex_iterator at(whole.begin(), whole.end(), kPlaceholder), end; at != end; ++at)
    found.insert((at->str(1).empty() ? std::to_string(next++) : at->str(1)) + at->str(2));
  return found;
}

TEST(Catalogue, contains_every_text_that_is_said) {
  EXPECT_GT(sources().said.size(), 250U) << "the sources are not read";
  for (const std::string& text : sources().said)
    EXPECT_NE(report::translated(report::Language::zh, text), text) << "no translation";
}

/// The words of a text between values and punctuation.
std::vector<std::string> words_of(const std::string& text) {
  static const std::regex kBetween(R"(\s*(\{\}|[;:,])\s*)");
  std::vector<std::string> words(std::sregex_token_iterator(text.begin(), text.end(), kBetween, -1), {});
  words.erase(std::remove(words.begin(), words.end(), ""), words.end());
  return words;
}

TEST(Catalogue, lower_texts_have_the_words_of_their_sources) {
  static const std::regex kConversion("%[-+.0-9*]*(?:ll|z)?[a-zA-Z]");
  std::set<std::string> literals;
  for (const std::string& literal : sources().literals) {
    std::string text = std::regex_replace(literal, kConversion, "{}");
    for (std::size_t at = text.find("%%"); at != std::string::npos; at = text.find("%%")) text.erase(at, 1);
    literals.insert(std::move(text));
  }
  std::set<std::string_view> seen;
  for (const report::Translation& entry : report::lower_catalogue()) {
    EXPECT_TRUE(seen.insert(entry.english).second) << entry.english;
    // Some texts are joined from several literals.
    for (const std::string& words : words_of(std::string(entry.english)))
      EXPECT_TRUE(std::any_of(literals.begin(), literals.end(),
                              [&](const std::string& literal) { return literal.find(words) != std::string::npos; }))
          << "'" << words << "' of: " << entry.english;
    EXPECT_EQ(placeholders(entry.chinese), placeholders(entry.english)) << entry.english;
  }
}

TEST(Catalogue, has_no_entry_that_is_not_used_and_none_twice) {
  std::set<std::string_view> seen;
  for (const report::Translation& entry : report::catalogue()) {
    EXPECT_TRUE(sources().literals.contains(std::string(entry.english))) << entry.english;
    EXPECT_TRUE(seen.insert(entry.english).second) << entry.english;
  }
}

TEST(Catalogue, a_translation_has_the_placeholders_of_its_text) {
  for (const report::Translation& entry : report::catalogue())
    EXPECT_EQ(placeholders(entry.chinese), placeholders(entry.english)) << entry.english;
}

TEST(Catalogue, a_lower_text_is_found_by_its_words) {
  EXPECT_EQ(report::retold("top rolled -0.076 deg to the seats; seat 12 off by 3.00 mm in X"),
            "板顶面相对承轨面侧倾 -0.076°；承轨面 12 在 X 方向偏 3.00 mm");
  EXPECT_EQ(report::retold("seats span 3 pitches, the slab frame needs 6"), "承轨面跨 3 个间距，板坐标系需要 6 个");
  EXPECT_EQ(report::retold("seats span 3 pitches"), std::nullopt);
  EXPECT_EQ(report::retold("top rolled -0.076 deg to the seats; and more"), std::nullopt);
  EXPECT_EQ(report::retold(""), std::nullopt);
}

TEST(Catalogue, a_text_without_an_entry_stays_english) {
  using report::Language;
  EXPECT_EQ(report::translated(Language::zh, "no such text {}"), "no such text {}");
  EXPECT_EQ(say(Language::en, "{} of {} checks failed", 2, 9), "2 of 9 checks failed");
  EXPECT_EQ(say(Language::zh, "{} of {} checks failed", 2, 9), "9 项检查中 2 项未通过");
}

}  // namespace
}  // namespace slabd::cli
