// SPDX-License-Identifier: Apache-2.0
//
// slabctl history: the newest slabs, one line each.
#include <fmt/core.h>
#include <CLI/CLI.hpp>
#include <memory>
#include <vector>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/json.h"
#include "cli/render.h"

namespace slabd::cli {
namespace {

struct Options {
  DatabaseOptions database;
  std::size_t limit = 20;
  bool json = false;
};

std::string as_json(const std::vector<storage::SlabSummary>& slabs) {
  Json json;
  json.begin_object();
  json.field("schema", "slabd.history/1");
  json.key("slabs").begin_array();
  for (const storage::SlabSummary& slab : slabs) {
    json.begin_object();
    json.field("key", slab.header.key)
        .field("slab_id", slab.header.slab_id.view())
        .field("slab_no", slab.header.slab_no);
    json.field("slab_type", slab.header.slab_type).field("recipe", slab.header.recipe.view());
    write_time(json, "began", slab.header.began_utime_us);
    write_time(json, "ended", slab.ended_utime_us);
    json.field("verdict", name(slab.verdict)).field("reason", slab.reason);
    json.field("stations_measured", slab.stations_measured).field("stations", unsigned{slab.header.stations});
    json.field("acknowledged", slab.acknowledged).end_object();
  }
  json.end_array().end_object();
  return json.text();
}

void print_slabs(const std::vector<storage::SlabSummary>& slabs) {
  const Style style = style_for(stdout);
  std::vector<std::vector<std::string>> rows = {
      {"key", "slab no", "id<", "type", "began<", "blocks", "verdict<", "reason<"}};
  for (const storage::SlabSummary& slab : slabs) {
    const bool open = slab.ended_utime_us == 0;
    rows.push_back({std::to_string(slab.header.key), std::to_string(slab.header.slab_no),
                    std::string(slab.header.slab_id.view()), std::to_string(slab.header.slab_type),
                    iso_time(slab.header.began_utime_us),
                    fmt::format("{}/{}", slab.stations_measured, slab.header.stations),
                    open ? "open" : verdict_text(slab.verdict, style), open ? "" : reason_words(slab.reason)});
  }
  fmt::print("{}", table(rows));
}

int show_history(const Options& options) {
  int exit_status = kDone;
  const auto reader = open_database(options.database, exit_status);
  if (reader == nullptr) return exit_status;
  const auto slabs = reader->slabs(options.limit);
  if (!slabs) {
    complain(fmt::format("{}", slabs.error().text.view()));
    return kNotReachable;
  }
  if (options.json) {
    fmt::print("{}", as_json(slabs.value()));
  } else {
    print_slabs(slabs.value());
  }
  return kDone;
}

}  // namespace

void DatabaseOptions::add_to(CLI::App& command) {
  auto* config_option =
      command.add_option("--config", config, "Configuration that names the database")->default_val(kDefaultConfig);
  command.add_option("--db", db, "Database, instead of the configuration's")->excludes(config_option);
}

std::unique_ptr<storage::Reader> open_database(const DatabaseOptions& options, int& exit_status) {
  std::string path = options.db;
  if (path.empty()) {
    daemon::Config config;
    if (!config_from(options.config, config)) {
      exit_status = kBadInput;
      return nullptr;
    }
    path = config.storage.db_path;
  }
  auto reader = storage::open_reader(path);
  if (reader) return std::move(reader.value());
  complain(fmt::format("{}", reader.error().text.view()));
  exit_status = kNotReachable;
  return nullptr;
}

void add_history(CLI::App& app, int& exit_status) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("history", "The newest slabs and their verdicts");
  command->footer(
      "\nReads the database while the daemon runs; changes nothing.\nExample: slabctl history --limit 50 --json");
  options->database.add_to(*command);
  command->add_option("--limit", options->limit, "How many slabs, newest first")
      ->check(CLI::Range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_flag("--json", options->json, "Print slabd.history/1 on stdout");
  command->callback([options, &exit_status] { exit_status = show_history(*options); });
}

}  // namespace slabd::cli
