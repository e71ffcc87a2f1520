// SPDX-License-Identifier: Apache-2.0
//
// slabctl scanner: the command group, and its history: the verifications in the database, oldest first.
#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

std::string number(const json& record, const char* key, int decimals = 4) {
  const json value = record.value(key, json(nullptr));
  return value.is_number() ? fmt::format("{:.{}f}", value.get<double>(), decimals) : "-";
}

bool is_verification(const json& record) {
  if (!record.is_object()) return false;
  // A value that is not a string would throw below.
  for (const char* key : {"schema", "utc", "scanner", "id"})
    if (const auto at = record.find(key); at != record.end() && !at->is_string()) return false;
  return record.value("schema", "") == "slabd.scanner_verification/1";
}

void add_records(const config::Config& config, std::vector<json>& records) {
  const std::unique_ptr<storage::Reader> reader = open_records(config);
  if (reader == nullptr) return;
  const auto all = need(reader->calibrations(), kNotReachable);
  std::vector<std::string> in_force;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm)
    if (const auto now = need(reader->current(CalibrationKind::scanner, 0, scanner_of_arm(config, arm)), kNotReachable))
      in_force.push_back(now->id);
  // The database returns the newest first; records of the same second keep their order.
  for (auto it = all.rbegin(); it != all.rend(); ++it) {
    const storage::CalibrationRecord& kept = *it;
    if (kept.kind() != CalibrationKind::scanner) continue;
    json record = json::parse(kept.figures, nullptr, false);
    if (!is_verification(record)) record = {{"schema", "slabd.scanner_verification/1"}};
    record["id"] = kept.id;
    record["scanner_id"] = kept.scanner;
    record["in_force"] = std::find(in_force.begin(), in_force.end(), kept.id) != in_force.end();
    record["expires"] = kept.expires_utime_us == 0 ? json(nullptr) : json(report::iso_time(kept.expires_utime_us));
    records.push_back(std::move(record));
  }
}

int history(const std::string& config_path, bool as_json) {
  const config::Config config = config_from(config_path);
  std::vector<json> records;
  add_records(config, records);
  std::stable_sort(records.begin(), records.end(),
                   [](const json& a, const json& b) { return a.value("utc", "") < b.value("utc", ""); });
  if (as_json) {
    fmt::print("{}\n", json{{"schema", "slabd.scanner_history/1"}, {"records", records}}.dump(2));
    return kDone;
  }
  const bool several = config.arms.several();
  if (several) fmt::print("{:8} ", "id");
  fmt::print("{:22} {:16} {:>9} {:>9} {:>9} {:>9} {:>6} {:7} {:16} {}\n", "time", "scanner", "PF", "|PS|", "RF", "form",
             "deg C", "limits", "record", "");
  for (const json& record : records) {
    if (several) fmt::print("{:8} ", record.value("scanner_id", "-"));
    fmt::print("{:22} {:16} {:>9} {:>9} {:>9} {:>9} {:>6} {:7} {:16} {}\n", record.value("utc", "-"),
               record.value("scanner", "-"), number(record, "PF_mm"), number(record, "PS_abs_mm"),
               number(record, "RF_mm"), number(record, "form_half_mm"), number(record, "temperature_c", 1),
               record.value("within_limits", false) ? "within" : "OUT", record.value("id", ""),
               record.value("in_force", false) ? "in force" : "");
  }
  return kDone;
}

void add_scanner_history(args::Command& scanner) {
  struct Options {
    std::string config;
    bool as_json = false;
  };
  auto options = std::make_shared<Options>();
  args::Command command = scanner.add_subcommand("history", "The verifications that were kept, oldest first");
  command->footer("\nmm. Example: slabctl scanner history");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  command->add_flag("--json", options->as_json, "Print slabd.scanner_history/1");
  command->runs([options] { return history(options->config, options->as_json); });
}

}  // namespace

void add_scanner(args::Command& app) {
  args::Command scanner = app.add_subcommand(
      "scanner", "The scanner: send a scan as a gateway does, verify its accuracy, wait until it is warm");
  scanner->require_subcommand(1);
  add_scanner_send(*scanner);
  add_scanner_verify(*scanner);
  add_scanner_history(*scanner);
  add_scanner_warm_up(*scanner);
}

}  // namespace slabd::cli
