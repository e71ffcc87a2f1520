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

/// Commands and options of slabctl, based on CLI11. CLI11 is header-only: each file that includes it compiles the
/// whole parser again, ten seconds a command. Therefore only arguments.cpp includes it. The commands use these
/// handles, whose functions have CLI11's names and meaning.
///
/// A Command and an Option are handles: a copy is the same command and is valid as long as the tree. The operator ->
/// allows chains (`command->add_option(...)->required()`).
namespace slabd::cli::args {

/// Validator of a value, for one option or several.
class Check {
 public:
  explicit Check(CLI::Validator check);
  /// Sets its words in the help.
  [[nodiscard]] Check description(const std::string& words) const;
  [[nodiscard]] const CLI::Validator& native() const { return *check_; }

 private:
  std::shared_ptr<const CLI::Validator> check_;
};

/// From `low` to `high`, both included.
template <typename Integer>
[[nodiscard]] Check range(Integer low, Integer high);
[[nodiscard]] Check one_of(const std::vector<std::string>& words);

class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}
  Option* operator->() { return this; }

  Option required();
  Option check(const Check& check);
  /// `complaint` returns the error of a value, empty if it is valid.
  Option check(const std::function<std::string(const std::string&)>& complaint);
  Option excludes(const Option& other);
  Option excludes(const std::string& other);
  Option needs(const Option& other);
  Option expected(int values);
  Option expected(int least, int most);
  Option delimiter(char separator);
  /// If the option is given several times, every value counts, not only the last.
  Option take_all();
  /// For an option with several values; false: a following word is not a further value.
  Option allow_extra_args(bool allowed);
  Option capture_default_str();
  Option default_val(const std::string& text);
  Option default_val(double value);
  /// The option accepts one of the words; its value is the number paired with the word.
  Option words(const std::vector<std::pair<std::string, std::size_t>>& numbers);
  [[nodiscard]] std::size_t count() const;
  [[nodiscard]] CLI::Option& native() const { return *option_; }

 private:
  CLI::Option* option_;
};

class Command {
 public:
  /// Wraps the root of a tree.
  explicit Command(CLI::App* root) : command_(root), exit_status_(std::make_shared<int>(0)) {}
  Command* operator->() { return this; }
  const Command* operator->() const { return this; }
  Command& operator*() { return *this; }

  /// `value` must live as long as the tree. Types: arguments.cpp.
  template <typename T>
  Option add_option(const std::string& name, T& value, const std::string& help);
  /// `value`: bool, or an integer that counts the occurrences.
  template <typename T>
  Option add_flag(const std::string& name, T& value, const std::string& help);
  Command add_subcommand(const std::string& name, const std::string& help);

  Command require_subcommand(int exactly);
  Command require_subcommand(int least, int most);
  Command footer(const std::string& text);
  /// `run` is called if this command was given without a subcommand and all arguments are valid. It returns the exit
  /// status.
  Command runs(const std::function<int()>& run);
  /// Exit status of the command that ran; 0 if none did.
  [[nodiscard]] int exit_status() const { return *exit_status_; }
  [[nodiscard]] std::size_t count(const std::string& option) const;
  [[nodiscard]] CLI::App& native() const { return *command_; }

 private:
  Command(CLI::App* command, const Command& above) : command_(command), exit_status_(above.exit_status_) {}

  CLI::App* command_;
  std::shared_ptr<int> exit_status_;  ///< of the whole tree
};

}  // namespace slabd::cli::args
