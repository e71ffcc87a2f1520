// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/parse.h"

#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <limits>

#include "cli/exit.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli {
namespace {

/// Accepts a finite number from `low` to `high`; `range` is their text in errors and in the help.
CLI::Validator finite_within(double low, double high, const std::string& range) {
  return {[=](std::string& text) {
            // Decimal only, because strtod also accepts 0x19.
            const char* first = text.data() + (text.starts_with("+") && !text.starts_with("+-") ? 1 : 0);
            double value = kNoValue;
            const auto [stop, fault] = std::from_chars(first, text.data() + text.size(), value);
            const bool number = fault == std::errc{} && stop == text.data() + text.size() && std::isfinite(value);
            return number && value >= low && value <= high ? std::string()
                                                           : fmt::format("\"{}\" is not a number {}", text, range);
          },
          range};
}

/// Removes leading zeros. It has no description, because the help contains the option's range.
template <typename Integer>
CLI::Validator decimal_digits() {
  return {[](std::string& text) {
            Integer value = 0;
            const auto [stop, fault] = std::from_chars(text.data(), text.data() + text.size(), value);
            if (fault != std::errc{} || stop != text.data() + text.size())
              return fmt::format("\"{}\" is not a whole number from {} to {}", text,
                                 std::numeric_limits<Integer>::min(), std::numeric_limits<Integer>::max());
            text = fmt::format("{}", value);
            return std::string();
          },
          ""};
}

void read_whole_numbers_of(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();
    if (type.find('{') != std::string::npos) continue;  // words that represent numbers
    if (type.starts_with("UINT"))
      option->transform(decimal_digits<std::uint64_t>());
    else if (type.starts_with("INT"))
      option->transform(decimal_digits<std::int64_t>());
  }
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; })) read_whole_numbers_of(*command);
}

}  // namespace

Result<Pose> parse_pose(std::string_view text) {
  constexpr std::string_view kSeparators = " ,\t";
  constexpr std::array kNames = {"x", "y", "z", "qw", "qx", "qy", "qz"};
  std::array<double, 7> numbers{};
  std::size_t count = 0;
  for (std::size_t at = text.find_first_not_of(kSeparators); at != std::string_view::npos;
       at = text.find_first_not_of(kSeparators, at)) {
    const std::size_t end = std::min(text.find_first_of(kSeparators, at), text.size());
    if (count == numbers.size()) return error(Code::config, "more than 7 numbers; expected x y z qw qx qy qz");
    const auto [stop, fault] = std::from_chars(text.data() + at, text.data() + end, numbers[count]);
    if (fault != std::errc{} || stop != text.data() + end || !std::isfinite(numbers[count]))
      return error(Code::config, "number %zu (%s) is '%.*s'; expected x y z qw qx qy qz", count + 1, kNames[count],
                   static_cast<int>(end - at), text.data() + at);
    ++count;
    at = end;
  }
  if (count != numbers.size()) return error(Code::config, "%zu numbers; expected x y z qw qx qy qz", count);
  const double length = std::hypot(std::hypot(numbers[3], numbers[4]), std::hypot(numbers[5], numbers[6]));
  if (std::abs(length - 1.0) > 1e-3)
    return error(Code::config, "the quaternion's length is %.6f, allowed 0.999..1.001", length);
  return Pose::from_array(numbers);
}

Result<std::int64_t> parse_time(std::string_view text, std::int64_t now_utime_us) {
  const auto wrong = [&] {
    return error(Code::config, "'%.*s' is not a time; expected 2026-11-20, 2026-11-20T23:28:01Z, 30m, 12h or 7d",
                 static_cast<int>(std::min<std::size_t>(text.size(), 60)), text.data());
  };
  if (!text.empty() && text.find_first_not_of("0123456789") == text.size() - 1) {
    std::int64_t count = 0;
    const auto [stop, fault] = std::from_chars(text.data(), text.data() + text.size() - 1, count);
    const std::int64_t seconds = text.back() == 'd' ? 86'400 : text.back() == 'h' ? 3'600 : text.back() == 'm' ? 60 : 0;
    if (fault != std::errc{} || stop != text.data() + text.size() - 1 || seconds == 0 || count > 100'000'000)
      return wrong();
    return now_utime_us - count * seconds * 1'000'000;
  }
  // Positions of a date's digits; all other characters must match.
  constexpr std::string_view kForm = "0000-00-00T00:00:00Z";
  if (text.size() != 10 && text.size() != kForm.size()) return wrong();
  for (std::size_t i = 0; i < text.size(); ++i)
    if (kForm[i] == '0' ? (text[i] < '0' || text[i] > '9') : text[i] != kForm[i]) return wrong();
  const auto number = [&](std::size_t from, std::size_t count) {
    int value = 0;
    for (std::size_t i = from; i < from + count && i < text.size(); ++i) value = 10 * value + (text[i] - '0');
    return value;
  };
  const std::chrono::year_month_day day{std::chrono::year(number(0, 4)),
                                        std::chrono::month(static_cast<unsigned>(number(5, 2))),
                                        std::chrono::day(static_cast<unsigned>(number(8, 2)))};
  const int hour = number(11, 2);
  const int minute = number(14, 2);
  const int second = number(17, 2);
  if (!day.ok() || hour > 23 || minute > 59 || second > 59) return wrong();
  if (text.size() == 10) {
    // A day of lists and of groups by day is a day of the reader's time zone.
    std::tm midnight{};
    midnight.tm_year = number(0, 4) - 1900;
    midnight.tm_mon = number(5, 2) - 1;
    midnight.tm_mday = number(8, 2);
    midnight.tm_isdst = -1;
    return std::int64_t{1'000'000} * std::mktime(&midnight);
  }
  const auto time = std::chrono::sys_days(day) + std::chrono::hours(hour) + std::chrono::minutes(minute) +
                    std::chrono::seconds(second);
  return std::chrono::duration_cast<std::chrono::microseconds>(time.time_since_epoch()).count();
}

std::int64_t time_of(const char* option, const std::string& text) {
  if (text.empty()) return 0;
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const Result<std::int64_t> time =
      parse_time(text, std::chrono::duration_cast<std::chrono::microseconds>(now).count());
  if (!time) stop(kUsage, std::string(option) + ": " + std::string(time.error().text.view()));
  return time.value();
}

namespace {
constexpr std::array kVerdicts = {Verdict::pass, Verdict::fail, Verdict::not_measured, Verdict::aborted,
                                  Verdict::indeterminate};
}  // namespace

std::vector<std::string> verdict_names() {
  std::vector<std::string> names;
  for (const Verdict verdict : kVerdicts) names.emplace_back(name(verdict));
  return names;
}

std::optional<Verdict> verdict_from_name(std::string_view wanted) {
  for (const Verdict verdict : kVerdicts)
    if (name(verdict) == wanted) return verdict;
  return std::nullopt;
}

std::optional<hal::LengthUnit> length_unit(std::string_view name) {
  if (name == "mm") return hal::LengthUnit::mm;
  if (name == "m") return hal::LengthUnit::m;
  if (name == "um") return hal::LengthUnit::um;
  return std::nullopt;
}

args::Check within(double low, double high) {
  return args::Check(finite_within(low, high, fmt::format("in [{} - {}]", low, high)));
}

args::Check at_least(double low) {
  const std::string range = fmt::format("at least {}", low);
  return args::Check(finite_within(low, std::numeric_limits<double>::max(), "of " + range).description(range));
}

args::Check finite_number() {
  constexpr double kLargest = std::numeric_limits<double>::max();
  CLI::Validator check = finite_within(-kLargest, kLargest, "that is finite");
  return args::Check(check.description(""));
}

void read_whole_numbers_decimally(const args::Command& app) {
  read_whole_numbers_of(app.native());
}

args::Check some_words() {
  CLI::Validator check(
      [](std::string& text) {
        return text.find_first_not_of(" \t\r\n") == std::string::npos ? std::string("empty; say why in a few words")
                                                                      : std::string();
      },
      "");
  return args::Check(check);
}

void ScanFormOptions::add_to(args::Command& command) {
  args::Option of_unit =
      command.add_option("--unit", unit,
                         unit.empty() ? "Unit of the scans: mm, m or um; default: the configuration's, or mm"
                                      : "Unit of the scans: mm, m or um; a file that declares another unit is refused");
  of_unit.check(args::one_of({"mm", "m", "um"}));
  if (!unit.empty()) of_unit.capture_default_str();
  command
      .add_option("--columns", columns,
                  "Columns of x, y and z in tables (.xyz .asc .txt .csv), by name or by number from 1, as in "
                  "PosX,PosY,PosZ or 2,3,4")
      ->check([](const std::string& given) {
        const Result<hal::TableColumns> parsed = hal::parse_table_columns(given);
        return parsed.ok() ? std::string() : std::string(parsed.error().text.view());
      });
}

hal::ScanForm ScanFormOptions::form(hal::ScanForm otherwise) const {
  if (!unit.empty()) otherwise.unit = *length_unit(unit);
  if (!columns.empty()) otherwise.columns = hal::parse_table_columns(columns).value();
  return otherwise;
}

void ScanFormOptions::complete_from(const hal::ScanForm& form) {
  for (const char* word : {"mm", "m", "um"})
    if (unit.empty() && length_unit(word) == form.unit) unit = word;
  if (!columns.empty() || form.columns.empty()) return;
  const auto& [x, y, z] = form.columns.xyz;
  columns = fmt::format("{},{},{}", x.view(), y.view(), z.view());
}

}  // namespace slabd::cli
