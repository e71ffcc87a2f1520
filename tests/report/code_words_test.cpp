// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "base/calibration.h"
#include "base/plc.h"
#include "report/words.h"

namespace slabd::report {
namespace {

bool has_chinese(std::string_view text) {
  return std::any_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) >= 0xE4; });
}

TEST(CodeWords, every_code_has_a_chinese_text_with_its_cure) {
  const std::string_view unknown = describe(static_cast<Code>(1));
  int codes = 0;
  for (std::uint16_t number = 100; number < kReasonItemBase; ++number) {
    const auto code = static_cast<Code>(number);
    if (describe(code) == unknown) continue;
    ++codes;
    EXPECT_TRUE(has_chinese(meaning(code, Language::zh))) << number;
    EXPECT_TRUE(has_chinese(cure_words(code, Language::zh))) << number;
    EXPECT_EQ(meaning(code, Language::en), describe(code));
    EXPECT_EQ(cure_words(code, Language::en), cure(code));
    EXPECT_TRUE(has_chinese(reason_sentence(number, Language::zh))) << number;
  }
  EXPECT_GE(codes, 31);
}

TEST(CodeWords, a_command_that_a_cure_names_is_named_in_chinese_too) {
  int commands = 0;
  for (std::uint16_t number = 100; number < kReasonItemBase; ++number) {
    const auto code = static_cast<Code>(number);
    const std::string_view english = cure(code);
    for (std::size_t begin = english.find('`'); begin != std::string_view::npos;) {
      const std::size_t end = english.find('`', begin + 1);
      const std::string_view command = english.substr(begin + 1, end - begin - 1);
      ++commands;
      EXPECT_NE(cure_words(code, Language::zh).find(command), std::string_view::npos) << number << ": " << command;
      begin = english.find('`', end + 1);
    }
  }
  EXPECT_GE(commands, 3);
}

TEST(CodeWords, a_full_disk_may_be_the_databases) {
  EXPECT_NE(cure_words(Code::store_full, Language::zh).find("数据库"), std::string_view::npos);
}

TEST(CodeWords, every_warning_has_a_chinese_text) {
  for (unsigned bit = 0; bit < 16; ++bit)
    EXPECT_TRUE(has_chinese(warning_zh(static_cast<std::uint16_t>(1U << bit)))) << bit;
  EXPECT_EQ(warning_zh(0), "");
}

TEST(CodeWords, a_state_that_is_not_known_is_shown_as_it_is) {
  EXPECT_TRUE(has_chinese(state_word("scanning", Language::zh)));
  EXPECT_EQ(state_word("scanning", Language::en), "scanning");
  EXPECT_EQ(state_word("dreaming", Language::zh), "dreaming");
}

}  // namespace
}  // namespace slabd::report
