// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/recipe.h"
#include "cli/study/repeatability.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

namespace slabd::cli {

/// `slabctl study`, like the commands of cli/command.h.
void add_study(args::Command& app, int& exit_status);

}  // namespace slabd::cli

/// The verbs of `slabctl study`.
namespace slabd::cli::study {

void add_repeat(args::Command& study, int& exit_status);
void add_grr(args::Command& study, int& exit_status);
void add_compare(args::Command& study, int& exit_status);

/// How scans are to be measured.
struct ScanOptions {
  std::string recipe;
  std::string unit = "mm";
  int threads = 1;
  void add_to(args::Command& command);
  /// False, and said, when there is no recipe or a wrong one.
  [[nodiscard]] bool load(Recipe& out, int& exit_status) const;
};

/// --same-part WHY.
void add_same_part(args::Command& command, std::string& why);

/// 0 capable or nothing judged, 1 else.
[[nodiscard]] int exit_of(Judgement judgement);

/// "item=value": false, and said, when it is none or names no item.
[[nodiscard]] bool parse_assignment(const std::string& option, const std::string& text, std::string& item,
                                    double& value);

}  // namespace slabd::cli::study
