// SPDX-License-Identifier: Apache-2.0
#include "base/id_pattern.h"

#include <gtest/gtest.h>

#include <array>
#include <ctime>
#include <regex>
#include <string>

#include "base/prng.h"

namespace slabd {
namespace {

IdPattern compiled(const std::string& expression) {
  const Result<IdPattern> pattern = IdPattern::compile(expression);
  EXPECT_TRUE(pattern.ok()) << expression << ": " << (pattern.ok() ? "" : pattern.error().text.c_str());
  return pattern.ok() ? pattern.value() : IdPattern();
}

TEST(IdPattern, matches_whole_ids) {
  const IdPattern id = compiled("C3-[0-9]{4}(?:-(?:L|R))?");
  for (const char* good : {"C3-0001", "C3-4155-L", "C3-4155-R"}) EXPECT_TRUE(id.matches(good)) << good;
  for (const char* bad : {"", "C3-", "C3-415", "C3-41555", "C3-4155-", "C3-4155-LR", "xC3-4155", "C3-4155 ", "c3-4155"})
    EXPECT_FALSE(id.matches(bad)) << bad;
}

TEST(IdPattern, finds_the_group_anywhere_in_the_text) {
  EXPECT_EQ(compiled("M([0-9]+)").first_group("S-7-M012-x"), "012");
  EXPECT_EQ(compiled("^M([0-9]+)").first_group("S-M012"), std::nullopt);
  EXPECT_EQ(compiled("^.-(\\d\\d)-.*$").first_group("S-34-99"), "34");
  EXPECT_EQ(compiled("(?:M(\\d+)|S)-").first_group("S-7"), std::nullopt) << "the group is not a part of the match";
  EXPECT_EQ(compiled("M(\\d*)").first_group("M"), "") << "an empty one is";
  EXPECT_EQ(compiled("(?:(\\d)x)+").first_group("1x2x3x"), "3") << "the last one of a repeated group";
  EXPECT_EQ(compiled("(\\d+?)\\d*").first_group("123"), "1");
  EXPECT_EQ(compiled("(\\d{2,3})").first_group("12345"), "123");
  EXPECT_EQ(compiled("(a|ab)(c|bcd)").first_group("abcd"), "a") << "the first alternative that leads to a match";
}

TEST(IdPattern, counts_groups_that_capture) {
  EXPECT_EQ(compiled("abc").groups(), 0);
  EXPECT_EQ(compiled("a(b)(?:c)").groups(), 1);
  EXPECT_EQ(compiled("((a)b){3}").groups(), 2);
}

TEST(IdPattern, names_what_is_wrong_and_where) {
  const auto fault = [](const std::string& expression) {
    const Result<IdPattern> pattern = IdPattern::compile(expression);
    EXPECT_FALSE(pattern.ok()) << expression;
    return pattern.ok() ? std::string() : std::string(pattern.error().text.view());
  };
  EXPECT_EQ(fault(""), "has 0 characters, allowed are 1..128");
  EXPECT_EQ(fault(std::string(129, 'a')), "has 129 characters, allowed are 1..128");
  EXPECT_EQ(fault("ab(c"), "character 5: the ) of a group is missing");
  EXPECT_EQ(fault("ab)c"), "character 3: found ) without (");
  EXPECT_EQ(fault("*a"),
            "character 1: found a repetition without anything in front of it; write \\ before a literal one");
  EXPECT_EQ(fault("a**"), "character 3: found a repetition of a repetition; put the first one in (?: )");
  EXPECT_EQ(fault("a{3,2}"), "character 7: found {m,n} with n smaller than m");
  EXPECT_EQ(fault("a{x}"), "character 3: allowed in { } are {m}, {m,} and {m,n}");
  EXPECT_EQ(fault("a{33}"), "character 5: found a larger number of repetitions than 32");
  EXPECT_EQ(fault("[9-0]"), "character 5: found a range in the wrong order, or of a class");
  EXPECT_EQ(fault("[abc"), "character 5: the ] of a set is missing");
  EXPECT_EQ(fault("[[:digit:]]"),
            "character 2: found a named class such as [:digit:], allowed are ranges such as 0-9 and \\d");
  EXPECT_EQ(fault("(a)\\1"), "character 5: allowed after \\ are d, D, w, W, s, S and punctuation");
  EXPECT_EQ(fault("(?=a)b"), "character 3: found (?, allowed is (?: for a group that does not capture");
  EXPECT_EQ(fault("Mo\xCC\x88"), "character 3: found a character that is not printable ASCII");
  EXPECT_NE(fault("(?:(?:a{32}){32}){32}").find("too large"), std::string::npos);
  EXPECT_NE(fault(std::string(17, '(') + "a" + std::string(17, ')')).find("inside one another"), std::string::npos);
}

// (a+)+b takes std::regex 2^32 steps for 32 characters.
TEST(IdPattern, takes_little_time_whatever_the_expression) {
  const std::string text(32, 'a');
  const std::clock_t began = std::clock();  // of the process: other programs do not count
  for (const char* slow : {"(a+)+b", "(a*)*b", "(?:a|a)*b", "(?:a?){32}a{32}b", "(?:(?:a*)*)*b"}) {
    EXPECT_FALSE(compiled(slow).matches(text)) << slow;
    EXPECT_EQ(compiled(slow).first_group(text), std::nullopt) << slow;
  }
  EXPECT_TRUE(compiled("(?:a?){32}a{32}").matches(text));
  EXPECT_LT(std::clock() - began, CLOCKS_PER_SEC);
}

/// An expression of characters a, b, c, nested to `depth`; with at most one group that captures.
std::string random_expression(Prng& prng, int depth, bool& captures) {
  std::string text;
  for (std::uint64_t parts = 1 + prng.below(3); parts > 0; --parts) {
    switch (depth > 0 ? prng.below(7) : prng.below(4)) {
      case 0: text += "a"; break;
      case 1: text += "b"; break;
      case 2: text += "[ac]"; break;
      case 3: text += "."; break;
      case 4:
        text += captures ? "(?:" : "(";
        captures = true;
        text += random_expression(prng, depth - 1, captures) + ")";
        break;
      case 5: text += "(?:" + random_expression(prng, depth - 1, captures) + ")"; break;
      default:
        text += "(?:" + random_expression(prng, depth - 1, captures) + "|" +
                random_expression(prng, depth - 1, captures) + ")";
    }
    constexpr std::array kRepetitions = {"", "", "", "", "*", "+", "?", "{2}", "{1,2}", "{2,}", "*?", "+?", "??"};
    text += kRepetitions.at(prng.below(kRepetitions.size()));
  }
  return text;
}

TEST(IdPattern, is_the_one_of_the_standard_library) {
  Prng prng(7);
  int compared = 0;
  int matching = 0;
  for (int i = 0; i < 3'000; ++i) {
    bool captures = false;
    const std::string expression = random_expression(prng, 2, captures);
    if (expression.size() > IdPattern::kTextBytesMax) continue;
    const Result<IdPattern> pattern = IdPattern::compile(expression);
    if (!pattern.ok()) {
      EXPECT_NE(pattern.error().text.view().find("too large"), std::string_view::npos)
          << expression << ": " << pattern.error().text.view();
      continue;
    }
    // Without this flag of GCC's library some of these expressions take minutes.
    const std::regex standard(expression, std::regex::ECMAScript | std::regex_constants::__polynomial);
    for (int k = 0; k < 6; ++k) {
      std::string text;
      for (std::uint64_t n = prng.below(8); n > 0; --n) text += static_cast<char>('a' + prng.below(3));
      ++compared;
      const bool whole = std::regex_match(text, standard);
      matching += whole ? 1 : 0;
      ASSERT_EQ(pattern.value().matches(text), whole) << expression << " and " << text;
    }
  }
  EXPECT_GT(compared, 15'000);
  EXPECT_GT(matching, 1'000);
}

}  // namespace
}  // namespace slabd
