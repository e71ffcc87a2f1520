// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/recipe.h"
#include "config/config.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// The commands of slabctl. Each adds itself to the tree; when the user chose it, it runs and leaves its exit status
/// (cli/exit.h) in `exit_status`. The command's options live as long as the tree.
namespace slabd::cli {

inline constexpr const char* kDefaultConfig = "/etc/slabd/slabd.toml";

void add_inspect(args::Command& app, int& exit_status);
void add_fit_plane(args::Command& app, int& exit_status);
void add_config(args::Command& app, int& exit_status);
void add_recipe(args::Command& app, int& exit_status);
void add_status(args::Command& app, int& exit_status);
void add_doctor(args::Command& app, int& exit_status);
void add_robot(args::Command& app, int& exit_status);
void add_scanner(args::Command& app, int& exit_status);
void add_stations(args::Command& app, int& exit_status);
void add_history(args::Command& app, int& exit_status);
void add_show(args::Command& app, int& exit_status);
void add_report(args::Command& app, int& exit_status);
void add_trend(args::Command& app, int& exit_status);
void add_completion(args::Command& app, int& exit_status);
void add_simulate(args::Command& app, int& exit_status);
void add_calibrate(args::Command& app, int& exit_status);
void add_plc(args::Command& app, int& exit_status);
void add_db(args::Command& app, int& exit_status);
void add_metrics(args::Command& app, int& exit_status);

/// The whole tree.
void add_commands(args::Command& app, int& exit_status);

/// Parses and runs a command line; returns the exit status. Nothing but this and the commands knows CLI11.
[[nodiscard]] int run(int argc, const char* const* argv);

/// Prints every problem as one line on stderr; true when there was none.
[[nodiscard]] bool report_problems(const std::vector<daemon::Problem>& problems);

/// Loads a recipe for a command that needs one; false when there were problems (printed).
[[nodiscard]] bool recipe_from(const std::string& path, Recipe& recipe);

/// Loads a configuration; false when there were problems (printed).
[[nodiscard]] bool config_from(const std::string& path, daemon::Config& config);

/// Warns on stderr while a verdict depends on unconfirmed nominals or tolerances, and names the assumptions of the
/// measuring system that U rests on.
void warn_unconfirmed(const Recipe& recipe);

/// The candidate that differs from `word` in the fewest letters, empty when none is near.
[[nodiscard]] std::string nearest(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace slabd::cli
