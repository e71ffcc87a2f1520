// SPDX-License-Identifier: Apache-2.0
//
// slabctl completion and slabctl manual: shell completion and the manual page. Both are generated from the command
// tree, so they always contain all options.
#include <fmt/core.h>
#include <CLI/CLI.hpp>

#include <memory>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "config/config.h"
#include "daemon/measure.h"

namespace slabd::cli {
namespace {

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_name().empty(); });
}

std::vector<const CLI::Option*> options_of(const CLI::App& app) {
  return app.get_options([](const CLI::Option*) { return true; });
}

/// Calls f(path, app) for the program and all subcommands; `path` is "slabctl calibrate solve".
template <typename F>
void for_each_command(const CLI::App& app, const std::string& path, const F& f) {
  f(path, app);
  for (const CLI::App* command : commands_of(app)) for_each_command(*command, path + " " + command->get_name(), f);
}

std::vector<std::string> words_after(const CLI::App& app) {
  std::vector<std::string> words;
  for (const CLI::App* command : commands_of(app)) words.push_back(command->get_name());
  for (const CLI::Option* option : options_of(app))
    for (const std::string& name : option->get_lnames()) words.push_back("--" + name);
  return words;
}

/// One case per command contains its candidates; all other words complete file names.
std::string bash_script(const CLI::App& app) {
  std::string cases;
  for_each_command(app, "slabctl", [&](const std::string& path, const CLI::App& command) {
    std::string words;
    for (const std::string& word : words_after(command)) words += (words.empty() ? "" : " ") + word;
    cases += fmt::format("    '{}') words='{}' ;;\n", path, words);
  });
  std::string paths;
  for_each_command(app, "slabctl", [&](const std::string& path, const CLI::App&) { paths += "|" + path; });
  return fmt::format(
      "# slabctl completion for bash; load it with: source <(slabctl completion bash)\n"
      "_slabctl() {{\n"
      "  local path=slabctl word words known='{}|'\n"
      "  for word in \"${{COMP_WORDS[@]:1:COMP_CWORD-1}}\"; do\n"
      "    [[ $known == *\"|$path $word|\"* ]] && path+=\" $word\"\n"
      "  done\n"
      "  case $path in\n{}  esac\n"
      "  COMPREPLY=($(compgen -W \"$words\" -- \"${{COMP_WORDS[COMP_CWORD]}}\"))\n"
      "  [ ${{#COMPREPLY[@]}} -gt 0 ] || COMPREPLY=($(compgen -f -- \"${{COMP_WORDS[COMP_CWORD]}}\"))\n"
      "}}\n"
      "complete -o filenames -F _slabctl slabctl\n",
      paths, cases);
}

std::string zsh_script(const CLI::App& app) {
  return "#compdef slabctl\n# slabctl completion for zsh; load it with: source <(slabctl completion zsh)\n"
         "autoload -U +X bashcompinit && bashcompinit\n" +
         bash_script(app);
}

/// Text in single quotes of fish.
std::string fish_quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'' || c == '\\') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out + "'";
}

std::string fish_script(const CLI::App& app) {
  std::string text = "# slabctl completion for fish; load it with: slabctl completion fish | source\n";
  for_each_command(app, "slabctl", [&](const std::string& path, const CLI::App& command) {
    // All words of the path were typed, and no word of a subcommand below it.
    std::string when;
    for (std::size_t at = path.find(' '); at != std::string::npos; at = path.find(' ', at + 1)) {
      const std::string word = path.substr(at + 1, path.find(' ', at + 1) - at - 1);
      when += (when.empty() ? "" : "; and ") + ("__fish_seen_subcommand_from " + word);
    }
    std::string deeper;
    for (const CLI::App* below : commands_of(command)) deeper += " " + below->get_name();
    std::string here = when;
    if (!deeper.empty()) here += (here.empty() ? "" : "; and ") + ("not __fish_seen_subcommand_from" + deeper);
    for (const CLI::App* below : commands_of(command))
      text += fmt::format("complete -c slabctl -f -n {} -a {} -d {}\n", fish_quoted(here), below->get_name(),
                          fish_quoted(below->get_description()));
    for (const CLI::Option* option : options_of(command))
      for (const std::string& name : option->get_lnames())
        text += fmt::format("complete -c slabctl -n {} -l {}{} -d {}\n", fish_quoted(here), name,
                            option->get_items_expected_max() > 0 ? " -r" : "", fish_quoted(option->get_description()));
  });
  return text;
}

/// Text of a manual page: escapes control characters at the beginning of a line, and minus signs.
std::string roff(const std::string& text) {
  std::string out;
  bool line_start = true;
  for (const char c : text) {
    if (line_start && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
    line_start = c == '\n';
  }
  return out;
}

std::string manual_page(const CLI::App& app) {
  std::string text = fmt::format(
      ".TH SLABCTL 1 \"\" \"{}\" \"slabd\"\n.SH NAME\nslabctl \\- maintenance of slabd, the track\\-slab inspection "
      "daemon\n.SH SYNOPSIS\n.B slabctl\n.I COMMAND\n[\\fIOPTIONS\\fR]\n.SH COMMANDS\n",
      daemon::software_version().view());
  for_each_command(app, "slabctl", [&](const std::string& path, const CLI::App& command) {
    if (&command == &app) return;
    text += fmt::format(".SS \"{}\"\n{}\n", roff(path), roff(command.get_description()));
    for (const CLI::Option* option : options_of(command)) {
      const std::string name = option->get_positional() ? option->get_name(true) : option->get_name(false, true);
      const std::string type = option->get_items_expected_max() > 0 && !option->get_positional()
                                   ? " \\fI" + roff(option->get_type_name()) + "\\fR"
                                   : "";
      text += fmt::format(".TP\n\\fB{}\\fR{}\n{}", roff(name), type, roff(option->get_description()));
      if (!option->get_default_str().empty()) text += fmt::format(" (default {})", roff(option->get_default_str()));
      text += "\n";
    }
    if (!command.get_footer().empty()) text += fmt::format(".PP\n.nf\n{}\n.fi\n", roff(command.get_footer()));
  });
  return text + fmt::format(".SH EXAMPLES AND EXIT STATUS\n.nf\n{}\n.fi\n", roff(app.get_footer()));
}

}  // namespace

void add_completion(args::Command& app) {
  auto shell = std::make_shared<std::string>();
  args::Command completion = app.add_subcommand("completion", "Shell completion for bash, zsh or fish, on stdout");
  completion->footer(
      "\nExamples: source <(slabctl completion bash)\n"
      "          slabctl completion fish > ~/.config/fish/completions/slabctl.fish");
  completion->add_option("SHELL", *shell, "bash, zsh or fish")
      ->required()
      ->check(args::one_of({"bash", "zsh", "fish"}));
  completion->runs([shell, &app = app.native()] {
    fmt::print("{}", *shell == "bash" ? bash_script(app) : *shell == "zsh" ? zsh_script(app) : fish_script(app));
    return kDone;
  });
  args::Command manual = app.add_subcommand("manual", "The manual page of all commands, in roff, on stdout");
  manual->footer("\nExample: slabctl manual | man -l -");
  manual->runs([&app = app.native()] {
    fmt::print("{}", manual_page(app));
    return kDone;
  });
}

}  // namespace slabd::cli
