// SPDX-License-Identifier: Apache-2.0
//
// slabctl scanner history: the verifications that were kept, oldest first.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/scanner/scanner.h"

namespace slabd::cli {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

std::string number(const json& record, const char* key) {
  const json value = record.value(key, json(nullptr));
  return value.is_number() ? fmt::format("{:.4f}", value.get<double>()) : "-";
}

int history(const std::string& config_path, bool as_json) {
  daemon::Config config;
  if (!config_from(config_path, config)) return kBadInput;
  std::vector<fs::path> files;
  std::error_code none;  // no folder: nothing was ever kept
  for (const fs::directory_entry& entry : fs::directory_iterator(scanner_records(config), none))
    if (entry.path().extension() == ".json") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  json all = {{"schema", "slabd.scanner_history/1"}, {"records", json::array()}};
  if (!as_json)
    fmt::print("{:22} {:16} {:>9} {:>9} {:>9} {:>9}  limits\n", "time", "scanner", "PF", "|PS|", "RF", "form");
  for (const fs::path& path : files) {
    std::ifstream file(path, std::ios::binary);
    const json record = json::parse(file, nullptr, false);
    if (!record.is_object() || record.value("schema", "") != "slabd.scanner_verification/1") {
      complain(fmt::format("{}: not a slabd.scanner_verification/1", path.string()));
      return kBadInput;
    }
    all["records"].push_back(record);
    if (as_json) continue;
    fmt::print("{:22} {:16} {:>9} {:>9} {:>9} {:>9}  {}\n", record.value("utc", "-"), record.value("scanner", "-"),
               number(record, "PF_mm"), number(record, "PS_abs_mm"), number(record, "RF_mm"),
               number(record, "form_half_mm"), record.value("within_limits", false) ? "within" : "OUT");
  }
  if (as_json) fmt::print("{}\n", all.dump(2));
  return kDone;
}

}  // namespace

std::string scanner_records(const daemon::Config& config) {
  return (fs::path(config.storage.db_path).parent_path() / "scanner").string();
}

void add_scanner_history(CLI::App& scanner, int& exit_status) {
  struct Options {
    std::string config;
    bool as_json = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = scanner.add_subcommand("history", "The verifications that were kept, oldest first");
  command->footer("\nmm. Example: slabctl scanner history");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(kDefaultConfig);
  command->add_flag("--json", options->as_json, "Print slabd.scanner_history/1");
  command->callback([options, &exit_status] { exit_status = history(options->config, options->as_json); });
}

}  // namespace slabd::cli
