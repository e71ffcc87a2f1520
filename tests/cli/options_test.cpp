// SPDX-License-Identifier: Apache-2.0
//
// Requirements for the options of all commands, including future ones.
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "cli/command.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli {
namespace {

/// Calls `see` for every option of the tree below `app`, with its command path.
void visit(CLI::App& app, const std::string& path, const std::function<void(const std::string&, CLI::Option&)>& see) {
  for (CLI::Option* option : app.get_options()) see(path + " " + option->get_name(), *option);
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; }))
    visit(*command, path + " " + command->get_name(), see);
}

/// The error of the option for `text`, given the required number of times; empty if it is accepted.
std::string refusal(CLI::Option& option, const std::string& text) {
  option.clear();
  for (int i = 0; i < option.get_items_expected_min(); ++i) option.add_result(text);
  try {
    option.run_callback();
  } catch (const CLI::Error& refused) {
    return refused.what();
  }
  return {};
}

TEST(Options, no_decimal_number_may_be_nan_or_infinite) {
  CLI::App app("slabctl");
  args::Command root(&app);
  add_commands(root);
  int numbers = 0;
  visit(app, "slabctl", [&](const std::string& path, CLI::Option& option) {
    if (!option.get_type_name().starts_with("FLOAT")) return;
    ++numbers;
    for (const char* text : {"nan", "-nan", "NAN", "inf", "-inf", "1e999", "0x19", "0x1p-5", ""})
      EXPECT_NE(refusal(option, text), "") << path << " takes '" << text << "'";
  });
  EXPECT_GT(numbers, 60) << "the tree is not seen whole";
}

TEST(Options, whole_numbers_are_decimal) {
  CLI::App app("slabctl");
  args::Command root(&app);
  add_commands(root);
  int numbers = 0;
  visit(app, "slabctl", [&](const std::string& path, CLI::Option& option) {
    const std::string type = option.get_type_name();
    if (!(type.starts_with("INT") || type.starts_with("UINT")) || type.find('{') != std::string::npos) return;
    ++numbers;
    for (const char* text : {"0x1", "0b1", "1e1", "1.0", "+1", " 1", "", "99999999999999999999"})
      EXPECT_NE(refusal(option, text), "") << path << " takes '" << text << "'";
  });
  EXPECT_GT(numbers, 50) << "the tree is not seen whole";
  CLI::Option* block = app.get_subcommand("show")->get_option("--block");
  EXPECT_EQ(refusal(*block, "011"), "");
  EXPECT_EQ(block->as<int>(), 11);
  EXPECT_EQ(refusal(*block, "09"), "") << "no octal number at all";
  CLI::Option* seed = app.get_subcommand("fit-plane")->get_option("--seed");
  EXPECT_EQ(refusal(*seed, "-1"), "--seed: \"-1\" is not a whole number from 0 to 18446744073709551615");
  EXPECT_EQ(refusal(*seed, "010"), "");
  EXPECT_EQ(seed->as<std::uint64_t>(), 10U);
}

TEST(Options, that_require_a_reason_reject_blank_text) {
  CLI::App app("slabctl");
  args::Command root(&app);
  add_commands(root);
  int reasons = 0;
  visit(app, "slabctl", [&](const std::string& path, CLI::Option& option) {
    if (option.get_name() != "--reason" && option.get_name() != "--reason") return;
    ++reasons;
    for (const char* text : {"", " ", "\t\n"})
      EXPECT_NE(refusal(option, text), "") << path << " takes '" << text << "'";
    EXPECT_EQ(refusal(option, "complaint 17"), "") << path;
  });
  EXPECT_GE(reasons, 5);
}

TEST(Options, a_refused_number_is_answered_with_the_option_and_its_range) {
  CLI::App app("slabctl");
  args::Command root(&app);
  add_commands(root);
  CLI::Option* limit = app.get_subcommand("scanner")->get_subcommand("verify")->get_option("--limit-pf-mm");
  EXPECT_EQ(refusal(*limit, "nan"), "--limit-pf-mm: \"nan\" is not a number in [0 - 10]");
  EXPECT_EQ(refusal(*limit, "10.5"), "--limit-pf-mm: \"10.5\" is not a number in [0 - 10]");
  EXPECT_EQ(refusal(*limit, "0.02"), "");
}

}  // namespace
}  // namespace slabd::cli
