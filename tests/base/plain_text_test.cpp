// SPDX-License-Identifier: Apache-2.0
#include "base/plain_text.h"

#include <gtest/gtest.h>

namespace slabd {
namespace {

TEST(PlainText, visible_text_of_any_language_stays) {
  for (const char* text : {"", "GOOD-1", "slab 5600 / 12", "轨道板 2", "Ã¤öü ✓ ✗ ∅", "=1+1"}) {
    EXPECT_EQ(plain(text), text);
    EXPECT_TRUE(is_plain(text));
  }
}

TEST(PlainText, control_characters_become_numbers) {
  EXPECT_EQ(plain("\x1b]0;title\a"), "\\x1b]0;title\\x07");
  EXPECT_EQ(plain("a\x1b[2Jb"), "a\\x1b[2Jb");
  EXPECT_EQ(plain("\xc2\x9b"
                  "2J"),
            "\\x9b2J")
      << "C1: one character begins a sequence";
  EXPECT_EQ(plain("\x7f"), "\\x7f");
  EXPECT_EQ(plain("PASS\nforged line"), "PASS\\nforged line");
  EXPECT_EQ(plain("a\r\nb\tc"), "a\\r\\nb\\tc");
}

TEST(PlainText, characters_that_reorder_or_hide_text_become_numbers) {
  EXPECT_EQ(plain("\u202e"
                  "SSAP"),
            "\\u202eSSAP");
  EXPECT_EQ(plain("a\u200bb"), "a\\u200bb");
  EXPECT_EQ(plain("\u2066x\u2069"), "\\u2066x\\u2069");
  EXPECT_EQ(plain("\U000E0041"), "\\U000e0041");
}

TEST(PlainText, bytes_that_are_not_utf8_become_numbers) {
  EXPECT_EQ(plain("\xff\xfe"), "\\xff\\xfe");
  EXPECT_EQ(plain("\xe4\xb8"), "\\xe4\\xb8") << "the beginning of a character";
  EXPECT_EQ(plain("\xc0\x9b"), "\\xc0\\x9b") << "an overlong form";
}

TEST(PlainText, line_breaks_are_kept_on_request) {
  EXPECT_EQ(plain("a\n\tb\r\nc", Lines::kept), "a\n\tb\r\nc");
  EXPECT_EQ(plain("a\rb", Lines::kept), "a\\rb") << "a lone carriage return overwrites the line";
  EXPECT_FALSE(is_plain("a\x1b", Lines::kept));
}

}  // namespace
}  // namespace slabd
