// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "hal/hal.h"

namespace slabd::cli::args {
class Command;
class Check;
}  // namespace slabd::cli::args

/// Parsers for values on the command line.
namespace slabd::cli {

/// Parses "x y z qw qx qy qz" (mm, unit quaternion within 1e-3), separated by blanks or commas. Code::config: the
/// fault and the allowed range.
[[nodiscard]] Result<Pose> parse_pose(std::string_view text);

/// Parses a time as us since 1970: "2026-11-20" (begin of the day in the computer's time zone), "2026-11-20T23:28:01Z",
/// or an interval before `now_utime_us`: "30m", "12h", "7d". Code::config: the expected form.
[[nodiscard]] Result<std::int64_t> parse_time(std::string_view text, std::int64_t now_utime_us);

/// The time of an option, with intervals before now; 0 if it was not given. Stops if it is invalid.
[[nodiscard]] std::int64_t time_of(const char* option, const std::string& text);
/// The names of verdicts of a stored slab, and the verdict of a name; nullopt if the name is unknown.
[[nodiscard]] std::vector<std::string> verdict_names();
[[nodiscard]] std::optional<Verdict> verdict_from_name(std::string_view name);
[[nodiscard]] std::optional<hal::LengthUnit> length_unit(std::string_view name);

/// Validators of options with a decimal number; every such option has one of them (tests/cli/options_test.cpp).
/// CLI11's own Range accepts "nan", and a limit that is NaN restricts nothing.
[[nodiscard]] args::Check within(double low, double high);
[[nodiscard]] args::Check at_least(double low);
/// Without a range: any number except NaN and infinity.
[[nodiscard]] args::Check finite_number();

/// Makes all options below `app` with a whole number accept only decimal digits. CLI11 reads 011 as nine and 0x10 as
/// sixteen, as C does, and replaces a too large number by the largest one.
void read_whole_numbers_decimally(const args::Command& app);

/// Requires a text that is not blank, for options that ask for a reason.
[[nodiscard]] args::Check some_words();

/// The options --unit and --columns of a command that reads scan files. If a text is empty, the configuration's value
/// applies.
struct ScanFormOptions {
  std::string unit = "mm";
  std::string columns;
  /// Adds both options; this object must outlive the command.
  void add_to(args::Command& command);
  /// `otherwise` contains the values that were not given.
  [[nodiscard]] hal::ScanForm form(hal::ScanForm otherwise = {}) const;
  /// The values that were not given become those of `form`.
  void complete_from(const hal::ScanForm& form);
};

}  // namespace slabd::cli
