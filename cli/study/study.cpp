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

Recipe ScanOptions::load() const {
  if (recipe.empty()) stop(kUsage, "scans are measured with a recipe: --recipe FILE");
  return recipe_from(recipe);
}

void add_same_part(args::Command& command, std::string& why) {
  command.add_option(
      "--same-part", why,
      "Why slabs of different ids, or scans of different blocks, are one part all the same; it is printed "
      "with the study. Without it they are refused");
}

Exit exit_of(Judgement judgement) {
  return judgement == Judgement::capable || judgement == Judgement::not_judged ? kDone : kNotPass;
}

Assignment parse_assignment(const std::string& option, const std::string& text) {
  const std::size_t equals = text.find('=');
  Assignment read{text.substr(0, equals)};
  const std::string number = equals == std::string::npos ? "" : text.substr(equals + 1);
  const char* const end = number.data() + number.size();
  const auto [rest, fault] = std::from_chars(number.data(), end, read.value);
  if (number.empty() || fault != std::errc{} || rest != end || !std::isfinite(read.value) || read.item.empty())
    stop(kUsage, fmt::format("{} '{}': expected ITEM=VALUE, such as seat_slope=1.4321", option, text));
  return read;
}

}  // namespace slabd::cli::study

namespace slabd::cli {

void add_study(args::Command& app) {
  args::Command group =
      app.add_subcommand("study", "How good is the measuring: repeats, gauge R&R, against a laboratory");
  group->require_subcommand(1);
  study::add_repeat(*group);
  study::add_grr(*group);
  study::add_compare(*group);
}

}  // namespace slabd::cli
