// SPDX-License-Identifier: Apache-2.0
//
// slabctl recipe reload: makes the running daemon load its recipe folder between two slabs. The daemon checks the
// whole folder first; if it is invalid, the previous recipes remain in force.
#include "cli/command.h"

#include <fmt/core.h>

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "cli/client/control.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "config/config.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

constexpr auto kPollEvery = std::chrono::milliseconds(100);
/// A folder on a network share may be slow; a share that hangs is not waited for.
constexpr int kPollsMax = 300;

struct Options {
  std::string config;
  std::string socket;
  bool look_only = false;
  bool as_json = false;
};

json ask(const std::string& socket, const char* line) {
  json answer = json::parse(need(ask_daemon(socket, line), kNotReachable), nullptr, false);
  if (answer.is_object() && answer.value("schema", "") == "slabd.recipes/1") return answer;
  if (answer.is_object() && answer.contains("error") && answer["error"].is_string())
    stop(kRefused, answer["error"].get<std::string>());
  stop(kNotReachable, "the daemon gave an answer that this slabctl cannot read");
}

std::string state_text(const json& answer) {
  std::string text;
  for (const json& recipe : answer["in_use"])
    text += fmt::format("in use: {}, slab type {}, sha256 {:.12}, {}\n", recipe.value("name", ""),
                        recipe.value("slab_type", 0), recipe.value("sha256", ""), recipe.value("file", ""));
  for (const json& difference : answer["differs"]) {
    text += fmt::format("{}: {}", difference.value("file", ""), difference.value("what", ""));
    if (const std::string problem = difference.value("problem", ""); !problem.empty())
      text += fmt::format(": {}", problem);
    text += "\n";
    for (const json& key : difference["keys"]) text += fmt::format("  {}\n", key.get<std::string>());
  }
  if (answer["differs"].empty()) text += "the folder holds what is in use\n";
  return text;
}

int reload(const Options& options) {
  std::string socket = options.socket;
  if (socket.empty()) {
    config::Config config;
    std::vector<config::Problem> problems;
    config::load_config(options.config, config, problems);
    for (const config::Problem& problem : problems) complain(problem.text);
    socket = config.control_socket;
  }
  json answer =
      ask(socket, options.look_only ? "{\"verb\":\"recipes\"}\n" : "{\"verb\":\"recipes\",\"reload\":true}\n");
  const auto state = [&answer] { return answer["reload"].value("state", ""); };
  for (int polls = 0; !options.look_only && (state() == "checking" || state() == "checked"); ++polls) {
    if (polls == kPollsMax) stop(kNotReachable, "the daemon still reads the recipe folder; ask again with --look");
    std::this_thread::sleep_for(kPollEvery);
    answer = ask(socket, "{\"verb\":\"recipes\"}\n");
  }
  if (options.as_json)
    fmt::print("{}\n", answer.dump(-1, ' ', false, json::error_handler_t::replace));
  else
    fmt::print("{}", state_text(answer));
  if (!options.look_only && state() != "done")
    stop(kRefused, answer["reload"].value("text", "the recipes were not taken up"));
  return kDone;
}

}  // namespace

void add_recipe_reload(args::Command& recipe) {
  auto options = std::make_shared<Options>();
  args::Command command = recipe.add_subcommand("reload", "Have the running daemon take up its recipe folder");
  command->footer(
      "\nThe daemon reads and checks the folder and takes all of it up between two slabs. While a slab is open, or "
      "when\n"
      "any file is faulty, it refuses (exit status 6), and the recipes in use stay in force.\n"
      "Examples: slabctl recipe reload\n"
      "          slabctl recipe reload --look");
  args::Option config = command->add_option("--config", options->config, "Configuration that names the control socket")
                            ->default_val(default_config());
  command->add_option("--socket", options->socket, "Control socket, instead of the configuration's")->excludes(config);
  command->add_flag("--look", options->look_only, "Only print what is in use and what the folder holds otherwise");
  command->add_flag("--json", options->as_json, "Print slabd.recipes/1 on stdout");
  command->runs([options] { return reload(*options); });
}

}  // namespace slabd::cli
