// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/recipe.h"
#include "config/config.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// The commands of slabctl. Each adds itself to the tree; if the user chose it, it runs and returns its exit status
/// (cli/exit.h), or ends by stop(). The command's options live as long as the tree.
namespace slabd::cli {

/// Configuration of commands without --config: the environment's SLABD_CONFIG, else /etc/slabd/slabd.toml.
[[nodiscard]] std::string default_config();

void add_inspect(args::Command& app);
void add_fit_plane(args::Command& app);
void add_config(args::Command& app);
void add_recipe(args::Command& app);
void add_design(args::Command& app);
void add_disposition(args::Command& app);
void add_status(args::Command& app);
void add_doctor(args::Command& app);
void add_robot(args::Command& app);
void add_scanner(args::Command& app);
void add_stations(args::Command& app);
void add_history(args::Command& app);
void add_show(args::Command& app);
void add_report(args::Command& app);
void add_reasons(args::Command& app);
void add_trend(args::Command& app);
void add_compare(args::Command& app);
void add_gauge(args::Command& app);
void add_mould(args::Command& app);
void add_yield(args::Command& app);
void add_replay(args::Command& app);
void add_export(args::Command& app);
void add_archive(args::Command& app);
/// Adds `pin` and `unpin`.
void add_pin(args::Command& app);
void add_study(args::Command& app);
void add_commission(args::Command& app);
void add_completion(args::Command& app);
void add_simulate(args::Command& app);
void add_calibrate(args::Command& app);
void add_plc(args::Command& app);
void add_db(args::Command& app);
void add_metrics(args::Command& app);
/// Adds `web user`.
void add_web(args::Command& app);
/// Subcommands of `recipe` and `scanner`.
void add_recipe_reload(args::Command& recipe);
void add_scanner_send(args::Command& scanner);
void add_scanner_verify(args::Command& scanner);
void add_scanner_warm_up(args::Command& scanner);

/// Adds all commands.
void add_commands(args::Command& app);

/// Parses and runs a command line; returns the exit status. Only this function and the commands use CLI11.
[[nodiscard]] int run(int argc, const char* const* argv);

/// Prints every problem as one line on stderr; true if there were none.
[[nodiscard]] bool report_problems(const std::vector<config::Problem>& problems);

/// The recipe or the configuration of a command that needs one. Prints problems and stops.
[[nodiscard]] Recipe recipe_from(const std::string& path);
[[nodiscard]] config::Config config_from(const std::string& path);

/// The same for a command that works with a partial configuration. Returns false and prints the problems if there were
/// any.
[[nodiscard]] bool config_from(const std::string& path, config::Config& config);

/// Warns on stderr if a verdict depends on unconfirmed nominals or tolerances, and names the assumptions of U about
/// the measuring system.
void warn_unconfirmed(const Recipe& recipe);

/// The candidate that differs from `word` in the fewest letters; empty if none is similar.
[[nodiscard]] std::string nearest(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace slabd::cli
