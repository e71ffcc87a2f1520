// SPDX-License-Identifier: Apache-2.0
//
// The command tree: parses, runs one command, returns its exit status. JSON and results go to stdout, all messages to
// stderr.
#include <fmt/core.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <utility>

#include "base/plain_text.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/study/study.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"
#include "daemon/measure.h"

namespace slabd::cli {
namespace {

constexpr const char* kFooter = R"(
Examples
  slabctl inspect scan.ply --recipe p5600.toml --block 3
  slabctl simulate --config slabd.toml --slab-no 7 --defect slope=4:1/36
  slabctl show 12 --block 4
  slabctl fit-plane cloud.xyz --compare

Exit status: 0 done (and pass), 1 inspected and not pass, 2 usage, 3 bad input,
4 daemon or device not reachable, 5 internal error, 6 refused on quality.
`slabctl help COMMAND` explains a command. The environment's SLABD_CONFIG names the
configuration of commands without --config.)";

using Arguments = std::vector<std::string>;

std::vector<std::string> command_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
    names.push_back(command->get_name());
  return names;
}

/// The command that the first words of `arguments` name.
const CLI::App* command_of(const CLI::App& app, const Arguments& arguments) {
  const CLI::App* command = &app;
  for (std::size_t i = 1; i < arguments.size(); ++i) {
    const auto below =
        command->get_subcommands([&](const CLI::App* candidate) { return candidate->get_name() == arguments[i]; });
    if (below.empty()) break;
    command = below.front();
  }
  return command;
}

/// Stops at a word instead of a command, which CLI11 reports as a surplus argument or a missing command: the message
/// suggests the nearest command.
void stop_at_unknown_command(const CLI::App& app, const Arguments& arguments) {
  const CLI::App* const command = command_of(app, arguments);
  std::size_t next = 1;  // the word after the command
  for (const CLI::App* at = command; at != &app; at = at->get_parent()) ++next;
  const bool is_group = command == &app || command->get_require_subcommand_min() > 0;
  if (!is_group || next >= arguments.size() || arguments[next].starts_with("-")) return;
  const std::string& word = arguments[next];
  const std::vector<std::string> names = command_names(*command);
  const std::string meant = nearest(word, names);
  std::string known;
  for (const std::string& name : names) known += (known.empty() ? "" : ", ") + name;
  stop(kUsage, fmt::format("unknown command '{}'{}; commands are {}", word,
                           meant.empty() ? "" : fmt::format(", did you mean '{}'?", meant), known));
}

/// `slabctl help COMMAND` is `slabctl COMMAND --help`. Options behind the command are left out.
Arguments with_help_moved(Arguments arguments) {
  if (arguments.size() < 2 || arguments[1] != "help") return arguments;
  arguments.erase(arguments.begin() + 1);
  const auto is_option = [](const std::string& word) { return word.starts_with("-"); };
  arguments.erase(std::find_if(arguments.begin() + 1, arguments.end(), is_option), arguments.end());
  arguments.emplace_back("--help");
  return arguments;
}

/// Stops at an option in front of the command: only the commands have options.
void stop_at_early_option(const CLI::App& app, const Arguments& arguments) {
  if (arguments.size() < 3 || !arguments[1].starts_with("-") || app.get_option_no_throw(arguments[1]) != nullptr)
    return;
  const std::vector<std::string> names = command_names(app);
  const auto command = std::find_first_of(arguments.begin() + 2, arguments.end(), names.begin(), names.end());
  if (command == arguments.end()) return;
  stop(kUsage, fmt::format("options come after the command: slabctl {} {}", *command, arguments[1]));
}

/// Moves --config from in front of the command to the end: only the commands have options.
Arguments with_config_last(Arguments arguments) {
  if (arguments.size() < 2 || !arguments[1].starts_with("--config")) return arguments;
  const bool has_value = arguments[1].starts_with("--config=");
  if (!has_value && arguments[1] != "--config") return arguments;
  const std::size_t words = has_value ? 1 : 2;
  if (arguments.size() <= 1 + words) return arguments;
  std::rotate(arguments.begin() + 1, arguments.begin() + 1 + static_cast<std::ptrdiff_t>(words), arguments.end());
  return arguments;
}

/// Names that are used for one thing elsewhere; a command knows one of each set.
constexpr std::array<std::array<std::string_view, 3>, 4> kSameOptions = {{
    {"--reason", "--why", "--because"},
    {"--operator", "--by", "--who"},
    {"--valid-days", "--expires-days", "--expires"},
    {"--slab-type", "--type", ""},
}};

/// Replaces an option that the command does not know by the one of its set that it knows, with a hint.
Arguments with_known_options(const CLI::App& app, Arguments arguments) {
  const CLI::App* const command = command_of(app, arguments);
  for (std::size_t i = 1; i < arguments.size() && arguments[i] != "--"; ++i) {
    std::string& word = arguments[i];
    const std::string name = word.substr(0, word.find('='));
    if (!name.starts_with("--") || command->get_option_no_throw(name) != nullptr) continue;
    for (const auto& set : kSameOptions) {
      if (std::find(set.begin(), set.end(), name) == set.end()) continue;
      const auto known = std::find_if(set.begin(), set.end(), [&](std::string_view other) {
        return !other.empty() && command->get_option_no_throw(std::string(other)) != nullptr;
      });
      if (known == set.end()) continue;
      complain(fmt::format("hint: this command's {} is {}", name, *known));
      word = std::string(*known) + word.substr(name.size());
      break;
    }
  }
  return arguments;
}

/// The deepest command that was chosen.
const CLI::App* chosen_command(const CLI::App& app) {
  const CLI::App* command = &app;
  while (!command->get_subcommands().empty()) command = command->get_subcommands().back();
  return command;
}

/// "slabctl show".
std::string path_of(const CLI::App& command) {
  std::string path;
  for (const CLI::App* at = &command; at != nullptr; at = at->get_parent())
    path = path.empty() ? at->get_name() : at->get_name() + " " + path;
  return path;
}

/// Surplus arguments, in the order of the command line; suggests the nearest option or subcommand for each.
std::string surplus_sentence(const CLI::App& app, const Arguments& arguments) {
  const CLI::App& command = *chosen_command(app);
  Arguments options;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) options.push_back("--" + name);
  Arguments surplus = app.remaining(true);
  const auto place = [&](const std::string& word) { return std::find(arguments.begin(), arguments.end(), word); };
  for (std::string& word : surplus)
    if (word.starts_with("id:-") && place(word) == arguments.end()) word.erase(0, 3);  // marked by with_marked_ids
  std::stable_sort(surplus.begin(), surplus.end(),
                   [&](const std::string& a, const std::string& b) { return place(a) < place(b); });
  std::string text;
  for (const std::string& word : surplus) {
    const std::string name = word.substr(0, word.find('='));
    const std::string meant = nearest(name, word.starts_with("-") ? options : command_names(command));
    text += fmt::format("{}'{}'{}", text.empty() ? "" : ", ", word,
                        meant.empty() ? "" : fmt::format(" (did you mean '{}'?)", meant));
  }
  return fmt::format("not expected: {}; `{} --help` lists arguments and options", text, path_of(command));
}

/// The fault that CLI11 found, with the command and its help.
std::string usage_sentence(const CLI::App& app, const CLI::ParseError& fault) {
  const CLI::App& command = *chosen_command(app);
  const std::string path = path_of(command);
  std::string what = fault.what();
  if (command.get_require_subcommand_min() > 0 && command.get_subcommands().empty()) {
    std::string names;
    for (const std::string& name : command_names(command)) names += (names.empty() ? "" : ", ") + name;
    return fmt::format("{} needs a command: {}", path, names);
  }
  if (what == "SLAB is required")
    return fmt::format("{0} needs a slab: {0} SLAB, a key or an id; `slabctl history` lists them", path);
  if (const std::size_t excludes = what.find(" excludes "); excludes != std::string::npos)
    what = fmt::format("{} and {} cannot be given together", what.substr(0, excludes), what.substr(excludes + 10));
  return fmt::format("{}; `{} --help` lists arguments and options", what, path);
}

/// The arguments, with "id:" before slab ids that begin with "-" in commands with SLAB. CLI11 would take "-S3" for
/// options. Only one dash and no option's name or value: a mistyped --option stays an error.
Arguments with_marked_ids(const CLI::App& app, Arguments arguments) {
  const CLI::App* const command = command_of(app, arguments);
  if (command->get_option_no_throw("SLAB") == nullptr) return arguments;
  const auto option_of = [command](const std::string& word) { return command->get_option_no_throw(word); };
  for (std::size_t i = 2; i < arguments.size() && arguments[i] != "--"; ++i) {
    std::string& word = arguments[i];
    const bool may_be_id = word.size() > 1 && word[0] == '-' && word[1] != '-';
    if (!may_be_id || option_of(word) != nullptr) continue;
    const CLI::Option* const before = arguments[i - 1].starts_with("-") ? option_of(arguments[i - 1]) : nullptr;
    if (before == nullptr || before->get_items_expected_max() == 0) word = "id:" + word;
  }
  return arguments;
}

}  // namespace

std::string default_config() {
  const char* const named = std::getenv("SLABD_CONFIG");
  return named != nullptr && named[0] != '\0' ? named : "/etc/slabd/slabd.toml";
}

void complain(std::string_view sentence) {
  // The sentence may contain text from a file or a database; some sentences have several lines.
  fmt::print(stderr, "slabctl: {}\n", plain(sentence, Lines::kept));
}

void stop(Exit status, std::string_view sentence) {
  throw Stop{status, std::string(sentence)};
}

void stop(Exit status, const Error& why) {
  stop(status, retold(why.text.view()));
}

void stop(const Error& why) {
  stop(exit_for(why.code), why);
}

std::string nearest(const std::string& word, const std::vector<std::string>& candidates) {
  const std::string_view bare = std::string_view(word).substr(std::min(word.find_first_not_of('-'), word.size()));
  if (bare.empty()) return "";
  // An abbreviation: the only candidate with a part that begins so.
  const auto has_part = [&](const std::string& candidate) {
    for (std::size_t at = candidate.find(bare); at != std::string::npos; at = candidate.find(bare, at + 1))
      if (at == 0 || candidate[at - 1] == '-' || candidate[at - 1] == '_') return true;
    return false;
  };
  const auto first = std::find_if(candidates.begin(), candidates.end(), has_part);
  if (first != candidates.end() && std::find_if(first + 1, candidates.end(), has_part) == candidates.end())
    return *first;
  std::string best;
  std::size_t best_distance = bare.size() / 3 + 2;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = config::edit_distance(word, candidate);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = candidate;
  }
  return best;
}

bool report_problems(const std::vector<config::Problem>& problems) {
  for (const config::Problem& problem : problems) fmt::print(stderr, "{}\n", plain(problem.text, Lines::kept));
  return problems.empty();
}

Recipe recipe_from(const std::string& path) {
  Recipe recipe;
  std::vector<config::Problem> problems;
  config::load_recipe(path, recipe, problems);
  if (!report_problems(problems)) stop(kBadInput);
  return recipe;
}

bool config_from(const std::string& path, config::Config& config) {
  std::vector<config::Problem> problems;
  config::load_config(path, config, problems);
  return report_problems(problems);
}

config::Config config_from(const std::string& path) {
  config::Config config;
  if (!config_from(path, config)) stop(kBadInput);
  return config;
}

void add_commands(args::Command& app) {
  add_inspect(app);
  add_fit_plane(app);
  add_design(app);
  add_disposition(app);
  add_status(app);
  add_commission(app);
  add_doctor(app);
  add_robot(app);
  add_scanner(app);
  add_stations(app);
  add_history(app);
  add_show(app);
  add_report(app);
  add_reasons(app);
  add_trend(app);
  add_gauge(app);
  add_mould(app);
  add_compare(app);
  add_yield(app);
  add_replay(app);
  add_export(app);
  add_archive(app);
  add_pin(app);
  add_study(app);
  add_simulate(app);
  add_calibrate(app);
  add_plc(app);
  add_db(app);
  add_metrics(app);
  add_web(app);
  add_config(app);
  add_recipe(app);
  add_completion(app);
  read_whole_numbers_decimally(app);
}

int run(int argc, const char* const* argv) {
  CLI::App app("slabctl: maintenance of slabd, the track-slab inspection daemon.", "slabctl");
  app.footer(kFooter);
  app.set_version_flag("--version", std::string(daemon::software_version().view()));
  app.require_subcommand(0, 1);
  args::Command root(&app);
  add_commands(root);

  Arguments arguments = with_config_last(with_help_moved(Arguments(argv, argv + argc)));
  try {
    stop_at_early_option(app, arguments);
    stop_at_unknown_command(app, arguments);
    arguments = with_known_options(app, std::move(arguments));
    const Arguments marked = with_marked_ids(app, arguments);
    Arguments reversed(marked.rbegin(), marked.rend());  // CLI11 takes them from the back
    if (!reversed.empty()) reversed.pop_back();          // the program's name
    app.parse(std::move(reversed));
  } catch (const CLI::ExtrasError&) {
    complain(surplus_sentence(app, arguments));
    return kUsage;
  } catch (const CLI::ParseError& parse_error) {
    // --help and --version also arrive here, with status 0.
    if (parse_error.get_exit_code() == 0) return app.exit(parse_error) == 0 ? kDone : kUsage;
    complain(usage_sentence(app, parse_error));
    return kUsage;
  } catch (const Stop& end) {
    if (!end.sentence.empty()) complain(end.sentence);
    return end.status;
  }
  if (argc < 2) {
    fmt::print(stderr, "{}", app.help());
    return kUsage;
  }
  return root.exit_status();
}

}  // namespace slabd::cli
