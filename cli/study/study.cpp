// SPDX-License-Identifier: Apache-2.0
//
// slabctl study: what the paper did once by hand to show how good it is, for a quality engineer on his own line.
#include "cli/study/study.h"

#include <fmt/core.h>
#include <charconv>
#include <cmath>
#include <vector>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli::study {

void ScanOptions::add_to(args::Command& command) {
  command.add_option("--recipe", recipe, "Recipe of the slab type, to measure scans with");
  command.add_option("--unit", unit, "Unit of the scans: mm, m or um")
      ->check(args::one_of({"mm", "m", "um"}))
      ->capture_default_str();
  threads = daemon::default_measure_threads();
  command.add_option("--threads", threads, "Threads that measure; the results are the same")
      ->check(args::range(1, 2))
      ->capture_default_str();
}

bool ScanOptions::load(Recipe& out, int& exit_status) const {
  if (recipe.empty()) {
    complain("scans are measured with a recipe: --recipe FILE");
    exit_status = kUsage;
    return false;
  }
  if (!recipe_from(recipe, out)) {
    exit_status = kBadInput;
    return false;
  }
  return true;
}

void add_same_part(args::Command& command, std::string& why) {
  command.add_option(
      "--same-part", why,
      "Why slabs of different ids, or scans of different blocks, are one part all the same; it is printed "
      "with the study. Without it they are refused");
}

int exit_of(Judgement judgement) {
  return judgement == Judgement::capable || judgement == Judgement::not_judged ? kDone : kNotPass;
}

bool parse_assignment(const std::string& option, const std::string& text, std::string& item, double& value) {
  const std::size_t equals = text.find('=');
  item = text.substr(0, equals);
  const std::string number = equals == std::string::npos ? "" : text.substr(equals + 1);
  const auto [stop, fault] = std::from_chars(number.data(), number.data() + number.size(), value);
  if (number.empty() || fault != std::errc{} || stop != number.data() + number.size() || !std::isfinite(value) ||
      item.empty()) {
    complain(fmt::format("{} '{}': expected ITEM=VALUE, such as seat_slope=1.4321", option, text));
    return false;
  }
  return true;
}

}  // namespace slabd::cli::study

namespace slabd::cli {

void add_study(args::Command& app, int& exit_status) {
  args::Command group =
      app.add_subcommand("study", "How good is the measuring: repeats, gauge R&R, against a laboratory");
  group->require_subcommand(1);
  study::add_repeat(*group, exit_status);
  study::add_grr(*group, exit_status);
  study::add_compare(*group, exit_status);
}

}  // namespace slabd::cli
