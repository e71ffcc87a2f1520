// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/recipe.h"
#include "cli/exit.h"
#include "cli/study/repeatability.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

namespace slabd::cli {

/// `slabctl study`, like the commands of cli/command.h.
void add_study(args::Command& app);

}  // namespace slabd::cli

/// The verbs of `slabctl study`.
namespace slabd::cli::study {

void add_repeat(args::Command& study);
void add_grr(args::Command& study);
void add_compare(args::Command& study);

/// How scans are to be measured.
struct ScanOptions {
  std::string recipe;
  std::string unit = "mm";
  int threads = 1;
  void add_to(args::Command& command);
  /// Stops if there is no recipe or a wrong one.
  [[nodiscard]] Recipe load() const;
};

/// --same-part WHY.
void add_same_part(args::Command& command, std::string& why);

/// 0 capable or nothing judged, 1 else.
[[nodiscard]] Exit exit_of(Judgement judgement);

struct Assignment {
  std::string item;
  double value = 0.0;
};
/// "item=value"; stops if it is none or names no item.
[[nodiscard]] Assignment parse_assignment(const std::string& option, const std::string& text);

}  // namespace slabd::cli::study
