// SPDX-License-Identifier: Apache-2.0
//
// slabctl recipe drafts: the drafts from CAD models in one folder, for a person and for the page.
#include <fcntl.h>
#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <memory>

#include "base/durable.h"
#include "base/os.h"
#include "base/plain_text.h"
#include "cli/cad/cad_commands.h"
#include "cli/cad/cad_findings.h"
#include "cli/cad/cad_process.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "config/config.h"
#include "report/figures.h"
#include "report/json.h"
#include "report/table.h"

namespace slabd::cli {
namespace {

constexpr std::size_t kFileBytesMax = 8'000'000;
constexpr std::size_t kNameBytesMax = 64;

struct Options {
  std::string config;
  std::string dir;
  std::string name;
  std::string picture;
  bool json = false;
};

struct Listed {
  std::string name;
  std::int64_t written_utime_us = 0;
  CadDraft draft;
};

struct PassedOver {
  std::string file;
  std::string why;
};

/// A draft's name is part of addresses of the page.
bool is_name(std::string_view name) {
  constexpr std::string_view kAllowed = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
  return !name.empty() && name.size() <= kNameBytesMax && name.front() != '.' && name.front() != '-' &&
         name.find_first_not_of(kAllowed) == std::string_view::npos;
}

std::string folder_of(const Options& options) {
  if (!options.dir.empty()) return options.dir;
  config::Config config;
  std::vector<config::Problem> problems;
  config::load_config(options.config, config, problems);
  for (const config::Problem& problem : problems) complain(problem.text);
  return (std::filesystem::path(config.recipes_dir) / "drafts").string();
}

Result<Listed> read_draft(const std::string& folder, const std::string& name) {
  const std::string path = (std::filesystem::path(folder) / (name + ".json")).string();
  const Result<std::string> bytes = read_bounded(path, kFileBytesMax);
  if (!bytes) return bytes.error();
  Result<CadDraft> draft = parse_draft(bytes.value());
  if (!draft) return error(draft.error().code, "%s: %s", path.c_str(), draft.error().text.c_str());
  return Listed{name, file_state(AT_FDCWD, path.c_str()).changed_ns / 1'000, std::move(draft.value())};
}

int list(const Options& options, const std::string& folder) {
  std::vector<Listed> drafts;
  std::vector<PassedOver> passed_over;
  std::error_code fault;
  for (std::filesystem::directory_iterator it(folder, fault), end; !fault && it != end; it.increment(fault)) {
    if (it->path().extension() != ".json") continue;
    const std::string name = it->path().stem().string();
    if (!is_name(name)) {
      passed_over.push_back({plain(it->path().filename().string()),
                             "a draft's name has 1 to 64 letters, digits, '.', '_' or '-', and begins with a letter, "
                             "a digit or '_'"});
      continue;
    }
    if (Result<Listed> draft = read_draft(folder, name))
      drafts.push_back(std::move(draft.value()));
    else
      passed_over.push_back({plain(it->path().filename().string()), plain(draft.error().text.view())});
  }
  if (fault && fault != std::errc::no_such_file_or_directory)
    stop(kBadInput, fmt::format("{}: {}", folder, fault.message()));
  std::sort(drafts.begin(), drafts.end(), [](const Listed& a, const Listed& b) {
    return a.written_utime_us != b.written_utime_us ? a.written_utime_us > b.written_utime_us : a.name < b.name;
  });
  std::sort(passed_over.begin(), passed_over.end(),
            [](const PassedOver& a, const PassedOver& b) { return a.file < b.file; });
  if (options.json) {
    report::Json json("slabd.recipe_drafts/1");
    json.field("folder", folder);
    json.list("drafts", drafts, [&](const Listed& one) {
      json.field("name", one.name).field("written_utime_us", one.written_utime_us).field("file", one.draft.file);
      json.field("sha256", one.draft.sha256).field("blocks", one.draft.findings.blocks);
      json.field("found", one.draft.findings.found.size()).field("not_found", one.draft.findings.not_found.size());
      json.field("remarks", one.draft.findings.remarks.size());
    });
    json.list("passed_over", passed_over,
              [&](const PassedOver& one) { json.field("file", one.file).field("why", one.why); });
    fmt::print("{}", json.text());
    return kDone;
  }
  report::Table table{"draft", "written<", "from<", "blocks", "found", "not found"};
  for (const Listed& one : drafts)
    table.add(one.name, report::local_time(one.written_utime_us), one.draft.file, one.draft.findings.blocks,
              one.draft.findings.found.size(), one.draft.findings.not_found.size());
  fmt::print("{}", drafts.empty() ? fmt::format("no drafts in {}\n", folder) : report::text_of(table));
  for (const PassedOver& one : passed_over) complain(fmt::format("{} passed over: {}", one.file, one.why));
  return kDone;
}

void copy_picture(const std::string& folder, const std::string& name, const std::string& path) {
  constexpr std::string_view kPng = "\x89PNG\r\n\x1a\n";
  const std::string from = (std::filesystem::path(folder) / (name + ".png")).string();
  const std::string bytes = need(read_bounded(from, kFileBytesMax), kBadInput);
  if (!bytes.starts_with(kPng)) stop(kBadInput, fmt::format("{}: expected is a PNG picture", from));
  OutFile out(path);
  out.write(bytes);
  need(out.close(), kBadInput);
}

int drafts(const Options& options) {
  const std::string folder = folder_of(options);
  if (options.name.empty()) {
    if (!options.picture.empty()) stop(kUsage, "--picture needs the name of a draft");
    return list(options, folder);
  }
  if (!is_name(options.name) || !std::filesystem::exists(std::filesystem::path(folder) / (options.name + ".json")))
    stop(kBadInput, fmt::format("no draft {} in {}", plain(options.name), folder));
  if (!options.picture.empty()) {
    copy_picture(folder, options.name, options.picture);
    return kDone;
  }
  const Listed one = need(read_draft(folder, options.name), kBadInput);
  fmt::print("{}", options.json ? json_of(one.draft) : text_of(one.draft));
  return kDone;
}

}  // namespace

void add_recipe_drafts(args::Command& recipe) {
  auto options = std::make_shared<Options>();
  args::Command command = recipe.add_subcommand("drafts", "Drafts of recipes from CAD models");
  command->footer(
      "\nThe drafts that slabctl recipe from-cad has written into the folder `drafts` of [recipes] dir; the page "
      "shows\n"
      "the same list with the pictures, at /drafts.\n"
      "Examples: slabctl recipe from-cad slab.stp --out /etc/slabd/recipes/drafts/p4925.toml\n"
      "          slabctl recipe drafts\n"
      "          slabctl recipe drafts p4925");
  command->add_option("NAME", options->name, "Print what this draft was made from");
  args::Option config = command->add_option("--config", options->config, "Configuration that names the recipe folder")
                            ->default_val(default_config());
  command->add_option("--dir", options->dir, "Folder with the drafts, instead of the configuration's")
      ->excludes(config);
  command->add_option("--picture", options->picture, "Copy the draft's picture into this .png file");
  command->add_flag("--json", options->json, "Print slabd.recipe_drafts/1, of a draft slabd.cad_draft/1, on stdout");
  command->runs([options] { return drafts(*options); });
}

}  // namespace slabd::cli
