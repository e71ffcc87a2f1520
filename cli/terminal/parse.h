// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "hal/hal.h"

namespace slabd::args {
class Command;
class Check;
}  // namespace slabd::args

/// Values as people write them on the command line.
namespace slabd::cli {

/// "x y z qw qx qy qz" (mm, unit quaternion within 1e-3), separated by blanks or commas. config: what is wrong, and
/// the allowed range.
[[nodiscard]] Result<Pose> parse_pose(std::string_view text);

/// A moment (UTC), as us since 1970: "2026-11-20", "2026-11-20T23:28:01Z", or so long before `now_utime_us`: "30m",
/// "12h", "7d". config: what was expected.
[[nodiscard]] Result<std::int64_t> parse_time(std::string_view text, std::int64_t now_utime_us);

/// The same of an option, before now; 0 if it was not given. Stops if it is not a moment.
[[nodiscard]] std::int64_t time_of(const char* option, const std::string& text);
/// The words that name a verdict of a stored slab, and the verdict of one; nullopt: of any other word.
[[nodiscard]] std::vector<std::string> verdict_names();
[[nodiscard]] std::optional<Verdict> verdict_from_name(std::string_view name);
[[nodiscard]] std::optional<hal::LengthUnit> length_unit(std::string_view name);

/// Checks of an option that takes a decimal number; every such option has one of them (tests/cli/options_test.cpp).
/// CLI11's own Range lets "nan" through, and a limit that is NaN holds nothing back.
[[nodiscard]] args::Check within(double low, double high);
[[nodiscard]] args::Check at_least(double low);
/// For one without a range: any number but NaN and infinity.
[[nodiscard]] args::Check finite_number();

/// Gives every option below `app` that takes a whole number plain decimal digits: CLI11 reads 011 as nine and 0x10 as
/// sixteen, as C does, and the largest number for one that is too large.
void read_whole_numbers_decimally(const args::Command& app);

/// Of an option that asks a person why: something must be said.
[[nodiscard]] args::Check some_words();

/// How the scan files of a command are written: its options --unit and --columns. An empty text takes the
/// configuration's.
struct ScanFormOptions {
  std::string unit = "mm";
  std::string columns;
  /// Adds both options; this object must outlive the command.
  void add_to(args::Command& command);
  /// `otherwise` holds what was not given.
  [[nodiscard]] hal::ScanForm form(hal::ScanForm otherwise = {}) const;
};

}  // namespace slabd::cli
