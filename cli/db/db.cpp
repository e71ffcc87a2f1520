// SPDX-License-Identifier: Apache-2.0
//
// slabctl db: operations on the whole database. Only one process may write it: while the daemon runs, it carries out
// the orders. Restoring requires a stopped daemon; the database lock prevents its start.
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <compare>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <thread>

#include "base/durable.h"
#include "cli/client/calibration_change.h"
#include "cli/client/control.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "report/json.h"
#include "storage/chain.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

constexpr auto kPollEvery = std::chrono::milliseconds(200);
/// Polls without progress of a copy after which the daemon counts as blocked, longer than any slab needs.
constexpr int kStillPollsMax = 600;

struct Options {
  std::string config;
  std::string file;
  std::string out;
  std::string why;
  std::string operator_name;
  std::int64_t keep_slabs = 0;
  std::optional<std::int64_t> keep_failed_slabs;
  int keep = 0;
  bool full = false;
  bool fresh = false;
  bool lose_calibrations = false;
  bool unproven = false;
  bool json = false;
  std::int64_t entry = 0;  ///< entry of the chain whose checksum is printed; 0: none
};

/// The daemon's slabd.care/1.
struct CareAnswer {
  struct Work {
    std::string state;  ///< none, under_way, done, failed
    std::string path;
    std::int64_t done = 0;  ///< pages copied or read for the checksum; slabs deleted
    std::string error;
  };
  Work backup;
  Work prune;
};

CareAnswer::Work work_of(const nlohmann::json& all, const char* name, const char* count) {
  CareAnswer::Work work;
  const nlohmann::json& j = all.at(name);
  work.state = j.value("state", "");
  work.path = j.value("path", "");
  work.done = j.value(count, std::int64_t{0});
  work.error = j.value("error", "");
  return work;
}

/// Code::scanner_offline: the answer is invalid; Code::config: the daemon rejected the request, the text contains the
/// reason.
Result<CareAnswer> parse_care(const std::string& line) {
  try {
    const nlohmann::json j = nlohmann::json::parse(line);
    if (j.contains("error")) return error(Code::config, "slabd refused: %s", j.value("error", "").c_str());
    return CareAnswer{work_of(j, "backup", "pages"), work_of(j, "prune", "slabs")};
  } catch (const nlohmann::json::exception&) {
    return error(Code::scanner_offline, "slabd gave an answer that is none: is it older than slabctl?");
  }
}

int fail(const Error& why) {
  complain(why.text.view());
  return exit_for(why.code);
}

std::string megabytes(std::int64_t bytes) {
  return fmt::format("{:.1f} MB", static_cast<double>(bytes) / 1e6);
}

// ---- check, verify -----------------------------------------------------------------------------------------------

/// True for names such as "slabd-20260314T015900.123Z.db". Copies with other names were made by a user and are neither
/// counted nor deleted.
bool is_backup_name(const std::string& name) {
  constexpr std::string_view kForm = "slabd-00000000T000000.000Z.db";
  if (name.size() != kForm.size()) return false;
  for (std::size_t i = 0; i < kForm.size(); ++i) {
    const bool digit = name[i] >= '0' && name[i] <= '9';
    if (kForm[i] == '0' ? !digit : name[i] != kForm[i]) return false;
  }
  return true;
}

/// Backups of a database. `ec`: their folder cannot be read.
std::vector<std::string> backups_of(const std::string& db_path, std::error_code& ec) {
  std::vector<std::string> found;
  const std::string folder = fs::path(db_path).parent_path().string() + "/backups";
  for (fs::directory_iterator entry(folder, ec), end; !ec && entry != end; entry.increment(ec))
    if (is_backup_name(entry->path().filename().string())) found.push_back(entry->path().string());
  if (ec == std::errc::no_such_file_or_directory) ec.clear();
  return found;
}

/// State of the chain; unknown if the file is damaged.
const char* chain_state(const storage::DatabaseReport& report, const storage::ChainReport& chain) {
  if (!report.trouble.empty()) return "unknown";
  if (!chain.trouble.empty()) return "altered";
  return chain.entries == 0 ? "none" : "whole";
}

void tell_chain(const storage::ChainReport& chain, std::int64_t entry) {
  if (!chain.trouble.empty())
    fmt::print("ALTERED: {}{}\n", chain.trouble,
               chain.altered > 1 ? fmt::format(" (and {} more)", chain.altered - 1) : "");
  if (chain.entries == 0) {
    fmt::print("no chain of results: nothing proves that its values are those that were measured\n");
    return;
  }
  if (chain.trouble.empty())
    fmt::print("chain of results: {} slabs are as they were sealed at their end\n", chain.sealed);
  if (chain.unsealed > 0)
    fmt::print("{} slabs ended before there was a chain and have no seal: of them nothing is proven\n", chain.unsealed);
  fmt::print("newest entry {}, SHA-256 {}: compare it with the journal, or note it elsewhere\n", chain.entries,
             chain.head);
  if (entry != 0)
    fmt::print("entry {}, SHA-256 {}\n", entry, chain.asked.empty() ? "none: no such entry" : chain.asked);
}

/// `is_backup`: the file should have a checksum.
int tell(const std::string& path, const storage::DatabaseReport& report, const storage::ChainReport& chain,
         const Options& options, bool is_backup) {
  const bool whole = report.trouble.empty();
  if (options.json) {
    report::Json json("slabd.database/1");
    json.field("file", path).field("whole", whole).field("trouble", report.trouble).field("full", options.full);
    json.field("version", report.version).field("slabs", report.slabs).field("oldest_key", report.oldest_key);
    json.field("newest_key", report.newest_key).field("newest_utime_us", report.newest_utime_us);
    json.field("bytes", report.bytes).field("log_bytes", report.log_bytes);
    json.field("checksum", !whole ? "unknown" : report.has_checksum ? "good" : "none").key("chain").begin_object();
    json.field("state", chain_state(report, chain)).field("trouble", chain.trouble).field("altered", chain.altered);
    json.field("entries", chain.entries).field("sealed", chain.sealed).field("unsealed", chain.unsealed);
    json.field("pruned", chain.pruned).field("head", chain.head).field("asked", chain.asked);
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}: {}\n", path, whole ? "whole" : "NOT WHOLE: " + report.trouble);
    if (whole && report.has_checksum) fmt::print("byte for byte what was written: length and SHA-256 are right\n");
    if (whole && !report.has_checksum && is_backup)
      fmt::print(
          "NOT PROVABLE: it has no checksum (another program made it), and a value in it may have changed unseen\n");
    fmt::print("schema version {}, {} slabs ({}..{}), newest record {}, {}{}\n", report.version, report.slabs,
               report.oldest_key, report.newest_key, report::iso_time(report.newest_utime_us), megabytes(report.bytes),
               report.log_bytes > 0 ? fmt::format(" and a log of {}", megabytes(report.log_bytes)) : "");
    if (whole) tell_chain(chain, options.entry);
  }
  return whole && chain.trouble.empty() ? kDone : kBadInput;
}

/// An error is a return value: `check` still lists the backups.
int examine(const std::string& path, const Options& options, bool is_backup) {
  const Result<storage::DatabaseReport> report = storage::check_database(path, options.full);
  if (!report.ok()) return fail(report.error());
  if (!report.value().trouble.empty()) return tell(path, report.value(), {}, options, is_backup);
  const Result<storage::ChainReport> chain = storage::check_chain(path, options.entry);
  return chain.ok() ? tell(path, report.value(), chain.value(), options, is_backup) : fail(chain.error());
}

struct KnownBackup {
  std::int64_t slab_key = 0;  ///< newest slab that it contains
  fs::file_time_type written;
  std::string path;
  auto operator<=>(const KnownBackup&) const = default;
};

/// Backups by age, oldest first: by newest slab, then by write time. The name is not used, because a clock that was
/// ahead would sort it last for years. Unreadable backups are left out, because their age is unknown.
std::vector<KnownBackup> by_age(const std::vector<std::string>& backups) {
  std::vector<KnownBackup> sorted;
  for (const std::string& path : backups) {
    const Result<std::int64_t> key = storage::newest_slab_key(path);
    std::error_code gone;
    const fs::file_time_type written = fs::last_write_time(path, gone);
    if (key.ok() && !gone) sorted.push_back({key.value(), written, path});
  }
  std::sort(sorted.begin(), sorted.end());
  return sorted;
}

int check(const Options& options) {
  const config::Config config = config_from(options.config);
  const int status = examine(config.storage.db_path, options, false);
  if (options.json) return status;
  std::error_code ec;
  const auto backups = backups_of(config.storage.db_path, ec);
  if (ec) {
    complain(fmt::format("backups cannot be looked for: {}", ec.message()));
  } else if (backups.empty()) {
    fmt::print("no backup: make one with slabctl db backup\n");
  } else {
    const std::vector<KnownBackup> sorted = by_age(backups);
    fmt::print("{} backups, {}\n", backups.size(),
               sorted.empty() ? "none of which can be read"
                              : fmt::format("newest {} (slabs up to {})", sorted.back().path, sorted.back().slab_key));
  }
  return status;
}

// ---- backup ------------------------------------------------------------------------------------------------------

Result<CareAnswer> ask_care(const config::Config& config, const std::string& line) {
  const Result<std::string> answer = ask_daemon(config.control_socket, line + "\n");
  if (!answer.ok()) return answer.error();
  return parse_care(answer.value());
}

/// Makes a backup through the daemon; returns its path. Stops with kRefused if the daemon cannot take the order now,
/// for example while it opens its database: no copy was made, and a later call may succeed.
Result<std::string> backup_by_daemon(const config::Config& config) {
  Result<CareAnswer> care = ask_care(config, R"({"verb":"backup"})");
  std::int64_t last = -1;
  for (int still = 0; care.ok() && care.value().backup.state == "under_way"; ++still) {
    if (still > kStillPollsMax)
      return error(Code::scanner_offline, "slabd has accepted the order but reports no result; see slabctl status");
    if (care.value().backup.done != last) still = 0;
    last = care.value().backup.done;
    std::this_thread::sleep_for(kPollEvery);
    care = ask_care(config, R"({"verb":"care"})");
  }
  if (!care.ok() && care.error().code == Code::config) stop(kRefused, care.error());
  if (!care.ok()) return care.error();
  if (care.value().backup.state != "done")
    return error(Code::journal_write, "the backup failed: %s", care.value().backup.error.c_str());
  return care.value().backup.path;
}

Result<std::string> backup_offline(const config::Config& config) {
  if (const Result<std::string> folder = storage::backup_folder(config.storage.db_path); !folder.ok())
    return folder.error();
  Result<std::string> path = storage::backup_path(config.storage.db_path, wall_clock_us());
  if (!path.ok()) return path;
  if (Status status = storage::back_up_database(config.storage.db_path, path.value()); !status.ok())
    return status.error();
  return path;
}

/// Deletes old backups except `made`, which was just checked, and the newest of the others. Unreadable files remain
/// and do not count.
[[nodiscard]] int drop_old_backups(const config::Config& config, const std::string& made, int keep) {
  std::error_code unseen;  // on an error there is nothing to delete
  auto backups = backups_of(config.storage.db_path, unseen);
  std::erase_if(backups,
                [&](const std::string& path) { return fs::path(path).filename() == fs::path(made).filename(); });
  const std::vector<KnownBackup> sorted = by_age(backups);
  int status = kDone;
  for (std::size_t i = 0; i + static_cast<std::size_t>(keep) <= sorted.size(); ++i) {
    std::error_code ec;
    fs::remove(sorted[i].path, ec);
    if (ec) {
      complain(fmt::format("{} cannot be deleted: {}{}", sorted[i].path, ec.message(),
                           ec == std::errc::read_only_file_system
                               ? " (a service writes only to the ReadWritePaths= of its unit; systemctl edit "
                                 "slabd-backup)"
                               : ""));
      status = exit_for(Code::journal_write);
    } else {
      fmt::print(stderr, "deleted {}\n", sorted[i].path);
    }
  }
  return status;
}

int back_up(const Options& options) {
  const config::Config config = config_from(options.config);
  if (!options.out.empty()) {
    // A link counts as existing, wherever it points.
    std::error_code ec;
    const fs::file_status there = fs::symlink_status(options.out, ec);
    if (fs::status_known(there) ? fs::exists(there) : static_cast<bool>(ec))
      stop(kBadInput, fs::status_known(there)
                          ? fmt::format("{} exists already; nothing was done", options.out)
                          : fmt::format("{} cannot be looked at: {}; nothing was done", options.out, ec.message()));
    need(check_links(options.out));
  }
  const std::string made =
      need(daemon_has_database(config.control_socket) ? backup_by_daemon(config) : backup_offline(config));
  std::string path = made;
  if (!options.out.empty()) {
    const std::string part = options.out + ".part";
    std::error_code ec;
    fs::remove(part, ec);  // remainder of an interrupted copy
    Status copied = copy_synced(path, part);
    if (copied.ok()) copied = rename_durably(part, options.out);
    if (!copied.ok()) {
      fs::remove(part, ec);
      complain(fmt::format("the backup is {}; no further copy was made", path));
      stop(copied.error());
    }
    path = options.out;
  }
  Options thorough = options;
  thorough.full = true;
  const int status = examine(path, thorough, true);
  if (status != kDone || options.keep == 0) return status;
  return drop_old_backups(config, made, options.keep);
}

// ---- restore, prune ----------------------------------------------------------------------------------------------

int restore(const Options& options) {
  if (options.file.empty() != options.fresh)
    stop(kUsage, options.fresh ? "--fresh begins with an empty history and takes no backup"
                               : "which backup? Or --fresh, to begin with an empty history");
  const config::Config config = config_from(options.config);
  if (daemon_has_database(config.control_socket))
    stop(kRefused, "slabd runs; stop it first (systemctl stop slabd): its database cannot be replaced under its hands");
  storage::RestoreOrder order;
  order.from = options.file.empty() ? "" : fs::absolute(options.file).string();
  order.note = {options.operator_name.empty() ? default_operator() : options.operator_name, options.why,
                wall_clock_us()};
  order.lose_calibrations = options.lose_calibrations;
  order.accept_unproven = options.unproven;
  std::random_device chance;
  order.session = static_cast<std::uint16_t>(1 + chance() % 65'000);
  need(storage::restore_database(config.storage, order));
  fmt::print("{} is in place; what was there before, if anything, is in quarantine beside it. Start slabd.\n",
             order.from.empty() ? "an empty history" : order.from);
  if (!order.from.empty()) fmt::print("Slabs measured after that backup are missing, and the history records it.\n");
  fmt::print(
      "Calibrations and their checks are {}: look at slabctl calibrate history, and check the hand-eye (slabctl "
      "calibrate "
      "check) before the next slab. The first SCAN takes two scans.\n",
      order.from.empty() ? "gone, and those of the configuration are in force" : "those of the backup as well");
  return kDone;
}

int prune(const Options& options) {
  const config::Config config = config_from(options.config);
  if (daemon_has_database(config.control_socket)) {
    const std::string failed = options.keep_failed_slabs
                                   ? fmt::format(R"(,"keep_failed_slabs":{})", *options.keep_failed_slabs)
                                   : std::string();
    Result<CareAnswer> care =
        ask_care(config, fmt::format(R"({{"verb":"prune","keep_slabs":{}{}}})", options.keep_slabs, failed));
    while (care.ok() && care.value().prune.state == "under_way") {
      std::this_thread::sleep_for(kPollEvery);
      care = ask_care(config, R"({"verb":"care"})");
    }
    if (!care.ok()) stop(care.error());
    if (care.value().prune.state != "done")
      stop(kNotReachable, fmt::format("pruning failed: {}", care.value().prune.error));
    fmt::print("{} slabs taken away\n", care.value().prune.done);
    return kDone;
  }
  const std::unique_ptr<storage::Store> store = need(storage::open_store(config.storage));
  need(store->order(storage::PruneOrder{options.keep_slabs, options.keep_failed_slabs}));
  while (store->care().prune == storage::CareState::Phase::under_way) store->idle();
  const storage::CareState care = store->care();
  if (care.prune != storage::CareState::Phase::done) stop(kNotReachable, care.prune_error);
  fmt::print("{} slabs taken away\n", care.pruned_slabs);
  return kDone;
}

}  // namespace

void add_db(args::Command& app) {
  args::Command group = app.add_subcommand("db", "Look after the database: check, back up, restore, prune");
  group->require_subcommand(1);
  auto options = std::make_shared<Options>();
  const auto verb = [&](const char* name, const char* what, int (*run)(const Options&)) {
    args::Command command = group->add_subcommand(name, what);
    command->runs([options, run] { return run(*options); });
    return command;
  };
  const auto with_config = [&](args::Command command) {
    command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
    return command;
  };
  args::Command command = with_config(verb("check", "Is the database whole? Reads while the daemon runs", check));
  command->add_flag("--full", options->full, "Indices against tables as well; slower");
  command->add_flag("--json", options->json, "Print slabd.database/1 on stdout");
  const auto with_entry = [&options](args::Command reading) {
    reading
        ->add_option("--entry", options->entry,
                     "Print the checksum of this entry of the chain of results, to compare it with the journal")
        ->check(args::range(std::int64_t{1}, std::int64_t{1'000'000'000}));
  };
  with_entry(command);

  command =
      with_config(verb("backup", "Copy the database (through the daemon while it runs) and check the copy", back_up));
  command->add_option("--out", options->out, "A further copy, on another disk");
  command->add_option("--keep", options->keep, "Delete all but the newest N backups afterwards")
      ->check(args::range(1, 10'000));
  command->add_flag("--json", options->json, "Print slabd.database/1 of the copy on stdout");

  command = verb("verify", "Is this backup whole? Changes nothing", [](const Options& o) {
    Options thorough = o;
    thorough.full = true;
    return examine(o.file, thorough, true);
  });
  command->add_option("FILE", options->file, "A backup")->required();
  with_entry(command);
  command->add_flag("--json", options->json, "Print slabd.database/1 on stdout");

  command = with_config(verb("restore", "Put a backup in the place of the database; slabd must be stopped", restore));
  command->add_option("FILE", options->file, "A backup");
  command->add_flag("--fresh", options->fresh, "Begin with an empty history instead");
  command->add_flag("--lose-calibrations", options->lose_calibrations,
                    "Even if the backup lacks calibrations, checks, dispositions or resets of moulds");
  command->add_flag("--unproven", options->unproven,
                    "Even if the backup has no checksum (another program made it), or was altered before it was made");
  command->add_option("--reason", options->why, "Why, for the history")->required()->check(some_words());
  command->add_option("--operator", options->operator_name, "Name of the operator (default: your login)");

  command = with_config(verb("prune", "Take away the records of old slabs whose scans are gone", prune));
  command->add_option("--keep-slabs", options->keep_slabs, "Number of newest slabs to keep")
      ->required()
      ->check(args::range(storage::kKeepSlabsMin, std::int64_t{1'000'000'000}));
  command->add_option("--keep-failed-slabs", options->keep_failed_slabs,
                      "Number of newest slabs to keep that did not pass, 0: all of them; default: [storage] "
                      "keep_failed_slabs, or as many as --keep-slabs where keep_slabs is 0");
}

}  // namespace slabd::cli
