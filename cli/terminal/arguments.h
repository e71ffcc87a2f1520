// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
class Option;
class Validator;
}  // namespace CLI

/// Commands and options of slabctl, over CLI11. CLI11 is a library of headers: each file that includes it compiles the
/// whole parser again, ten seconds a command. So arguments.cpp is the only one that does, and the commands use these
/// handles, whose functions have CLI11's names and meaning.
///
/// A Command and an Option are handles: a copy is the same command, it lives as long as the tree, and -> is for chains
/// (`command->add_option(...)->required()`).
namespace slabd::args {

/// What a value must be; of one option or of several.
class Check {
 public:
  explicit Check(CLI::Validator check);
  /// The words that the help shows for it.
  [[nodiscard]] Check description(const std::string& words) const;
  [[nodiscard]] const CLI::Validator& native() const { return *check_; }

 private:
  std::shared_ptr<const CLI::Validator> check_;
};

/// From `low` to `high`, both allowed.
template <typename Integer>
[[nodiscard]] Check range(Integer low, Integer high);
[[nodiscard]] Check one_of(const std::vector<std::string>& words);

class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}
  Option* operator->() { return this; }

  Option required();
  Option check(const Check& check);
  /// `complaint` says what is wrong with a value, empty: nothing.
  Option check(const std::function<std::string(const std::string&)>& complaint);
  Option excludes(const Option& other);
  Option excludes(const std::string& other);
  Option needs(const Option& other);
  Option expected(int values);
  Option expected(int least, int most);
  Option delimiter(char separator);
  /// Given several times: every value counts, not only the last.
  Option take_all();
  /// Of an option with several values: false, a word behind them is not one more.
  Option allow_extra_args(bool allowed);
  Option capture_default_str();
  Option default_val(const std::string& text);
  Option default_val(double value);
  /// One of the words, and the number beside it is the value.
  Option words(const std::vector<std::pair<std::string, std::size_t>>& numbers);
  [[nodiscard]] std::size_t count() const;
  [[nodiscard]] CLI::Option& native() const { return *option_; }

 private:
  CLI::Option* option_;
};

class Command {
 public:
  /// The root of a tree.
  explicit Command(CLI::App* root) : command_(root), exit_status_(std::make_shared<int>(0)) {}
  Command* operator->() { return this; }
  const Command* operator->() const { return this; }
  Command& operator*() { return *this; }

  /// `value` lives as long as the tree. Types: arguments.cpp.
  template <typename T>
  Option add_option(const std::string& name, T& value, const std::string& help);
  /// `value`: bool, or an integer that counts.
  template <typename T>
  Option add_flag(const std::string& name, T& value, const std::string& help);
  Command add_subcommand(const std::string& name, const std::string& help);

  Command require_subcommand(int exactly);
  Command require_subcommand(int least, int most);
  Command footer(const std::string& text);
  /// Runs if this command, and none below it, was given and everything it was given is right. Returns the exit status.
  Command runs(const std::function<int()>& run);
  /// As the command that ran returned it; 0 if none ran.
  [[nodiscard]] int exit_status() const { return *exit_status_; }
  [[nodiscard]] std::size_t count(const std::string& option) const;
  [[nodiscard]] CLI::App& native() const { return *command_; }

 private:
  Command(CLI::App* command, const Command& above) : command_(command), exit_status_(above.exit_status_) {}

  CLI::App* command_;
  std::shared_ptr<int> exit_status_;  ///< of the whole tree
};

}  // namespace slabd::args
