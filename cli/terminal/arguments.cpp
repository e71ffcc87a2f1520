// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/arguments.h"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <optional>

namespace slabd::cli::args {

Check::Check(CLI::Validator check) : check_(std::make_shared<const CLI::Validator>(std::move(check))) {}

Check Check::description(const std::string& words) const {
  return Check(check_->description(words));
}

template <typename Integer>
Check range(Integer low, Integer high) {
  const auto complaint = [low, high](std::string& text) {
    Integer value{};
    if (CLI::detail::lexical_cast(text, value) && value >= low && value <= high) return std::string();
    return "found " + text + ", allowed is " + std::to_string(low) + " to " + std::to_string(high);
  };
  return Check(CLI::Validator(complaint, CLI::Range(low, high).get_description()));
}
template Check range(int, int);
template Check range(std::size_t, std::size_t);
template Check range(std::int64_t, std::int64_t);

Check one_of(const std::vector<std::string>& words) {
  const auto complaint = [words](std::string& text) {
    if (std::find(words.begin(), words.end(), text) != words.end()) return std::string();
    std::string allowed;
    std::string meant;
    for (const std::string& word : words) {
      allowed += (allowed.empty() ? "" : ", ") + word;
      const std::size_t same =
          static_cast<std::size_t>(std::mismatch(word.begin(), word.end(), text.begin(), text.end(),
                                                 [](char a, char b) {
                                                   return std::tolower(static_cast<unsigned char>(a)) ==
                                                          std::tolower(static_cast<unsigned char>(b));
                                                 })
                                       .first -
                                   word.begin());
      if (meant.empty() && same >= 3) meant = word;
    }
    return "found " + text + ", allowed is " + allowed + (meant.empty() ? "" : "; did you mean " + meant + "?");
  };
  return Check(CLI::Validator(complaint, CLI::IsMember(words).get_description()));
}

Option Option::required() {
  option_->required();
  return *this;
}
Option Option::check(const Check& check) {
  option_->check(check.native());
  return *this;
}
Option Option::check(const std::function<std::string(const std::string&)>& complaint) {
  option_->check(complaint);
  return *this;
}
Option Option::excludes(const Option& other) {
  option_->excludes(other.option_);
  return *this;
}
Option Option::excludes(const std::string& other) {
  option_->excludes(other);
  return *this;
}
Option Option::needs(const Option& other) {
  option_->needs(other.option_);
  return *this;
}
Option Option::expected(int values) {
  option_->expected(values);
  return *this;
}
Option Option::expected(int least, int most) {
  option_->expected(least, most);
  return *this;
}
Option Option::delimiter(char separator) {
  option_->delimiter(separator);
  return *this;
}
Option Option::take_all() {
  option_->take_all();
  return *this;
}
Option Option::allow_extra_args(bool allowed) {
  option_->allow_extra_args(allowed);
  return *this;
}
Option Option::capture_default_str() {
  option_->capture_default_str();
  return *this;
}
Option Option::default_val(const std::string& text) {
  option_->default_val(text);
  return *this;
}
Option Option::default_val(double value) {
  option_->default_val(value);
  return *this;
}
Option Option::words(const std::vector<std::pair<std::string, std::size_t>>& numbers) {
  option_->transform(CLI::CheckedTransformer(numbers));
  return *this;
}
std::size_t Option::count() const {
  return option_->count();
}

template <typename T>
Option Command::add_option(const std::string& name, T& value, const std::string& help) {
  return Option(command_->add_option(name, value, help));
}
template Option Command::add_option(const std::string&, std::string&, const std::string&);
template Option Command::add_option(const std::string&, std::vector<std::string>&, const std::string&);
template Option Command::add_option(const std::string&, std::vector<double>&, const std::string&);
template Option Command::add_option(const std::string&, int&, const std::string&);
template Option Command::add_option(const std::string&, std::uint16_t&, const std::string&);
template Option Command::add_option(const std::string&, std::uint32_t&, const std::string&);
template Option Command::add_option(const std::string&, std::size_t&, const std::string&);
template Option Command::add_option(const std::string&, std::int64_t&, const std::string&);
template Option Command::add_option(const std::string&, std::optional<std::int64_t>&, const std::string&);
template Option Command::add_option(const std::string&, double&, const std::string&);

template <typename T>
Option Command::add_flag(const std::string& name, T& value, const std::string& help) {
  return Option(command_->add_flag(name, value, help));
}
template Option Command::add_flag(const std::string&, bool&, const std::string&);

Command Command::add_subcommand(const std::string& name, const std::string& help) {
  return Command(command_->add_subcommand(name, help), *this);
}
Command Command::require_subcommand(int exactly) {
  command_->require_subcommand(exactly);
  return *this;
}
Command Command::require_subcommand(int least, int most) {
  command_->require_subcommand(static_cast<std::size_t>(least), static_cast<std::size_t>(most));
  return *this;
}
Command Command::footer(const std::string& text) {
  command_->footer(text);
  return *this;
}
Command Command::runs(const std::function<int()>& run) {
  command_->callback([command = command_, run, status = exit_status_] {
    if (command->get_subcommands().empty()) *status = run();
  });
  return *this;
}
std::size_t Command::count(const std::string& option) const {
  return command_->count(option);
}

}  // namespace slabd::cli::args
