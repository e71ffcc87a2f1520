// SPDX-License-Identifier: Apache-2.0
//
// Write permissions of the daemon are derived from file mode and user, because the current user is often root and can
// write everywhere. Disk speed is measured on the disk itself: the time until a scan and a commit are durable counts,
// not that of the page cache.
#include <fcntl.h>
#include <fmt/core.h>
#include <grp.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <optional>
#include <thread>
#include <vector>

#include "base/os.h"
#include "cli/doctor/doctor.h"
#include "cli/terminal/say.h"
#include "config/designs.h"
#include "storage/storage.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// Size of a scan, and the longest time to the disk without a wait of the robot, which moves for about 4 s.
constexpr std::size_t kScanBytes = 64U << 20U;
constexpr double kScanSlow_s = 2.0;
/// The PLC waits for a commit with every command.
constexpr int kCommits = 16;
constexpr double kCommitSlow_ms = 50.0;
constexpr std::uint64_t kDatabaseFreeMin = 1'000'000'000;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// A file that exists as long as this.
class File {
 public:
  File(const std::string& path, int flags) : path_(path), fd_(::open(path.c_str(), flags | O_CLOEXEC, 0600)) {}
  ~File() {
    if (fd_.is_open()) ::unlink(path_.c_str());
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  [[nodiscard]] int fd() const { return fd_.get(); }

 private:
  std::string path_;
  Fd fd_;
};

/// The folder itself, or its nearest existing parent.
fs::path existing(fs::path path) {
  std::error_code none;
  while (!path.empty() && !fs::exists(path, none) && path != path.parent_path()) path = path.parent_path();
  return path.empty() ? fs::path(".") : path;
}

/// Group of the scanner software's user; created by the package.
constexpr const char* kScanGroup = "slabd-scan";

/// Write permissions of other users than the daemon.
struct Rights {
  const char* mode;
  const char* group;  ///< nullptr: the daemon's group
};
constexpr Rights kOwnerWrites = {"2750", nullptr};
constexpr Rights kScannerWrites = {"2770", kScanGroup};

/// True if the daemon can write to the folder.
bool examine_folder(const char* check, const std::string& folder, const DaemonUser& account, const Rights& rights,
                    Examination& report) {
  const fs::path there = existing(folder);
  struct stat file {};
  if (::stat(there.c_str(), &file) != 0) {
    report.failed(check, say("{}: {}", folder, quote(std::strerror(errno))), say("make the folder"));
    return false;
  }
  constexpr unsigned kWriteAndEnter = 3;
  const bool writable = may(account, file, kWriteAndEnter);
  if (!S_ISDIR(file.st_mode)) {
    report.failed(check, say("{} is not a folder", there.string()), say("remove it or name another one"));
    return false;
  }
  const std::string group = rights.group != nullptr ? rights.group : account.name;
  if (!writable && there != fs::path(folder)) {
    // The parent is of the system or of a share that is not mounted, and must not be handed over.
    report.failed(check, say("{} does not exist, and {} cannot make it", folder, account.name),
                  say("if it belongs on another disk or a share, mount that first; otherwise {}",
                      fmt::format("install -d -o {} -g {} -m {} {}", account.name, group, rights.mode, folder)));
    return false;
  }
  if (!writable) {
    report.failed(check, say("{} is not writable for {}", folder, account.name),
                  fmt::format("chown {}:{} {} && chmod {} {}", account.name, group, folder, rights.mode, folder));
    return false;
  }
  // The mode does not show a disk that the kernel has made read-only, as it does with a damaged one.
  if (struct statvfs disk{}; ::statvfs(there.c_str(), &disk) == 0 && (disk.f_flag & ST_RDONLY) != 0) {
    report.failed(check, say("{} is on a disk that is read-only", there.string()),
                  say("findmnt -T {} names it; journalctl -k shows whether it is damaged; then mount it writable",
                      there.string()));
    return false;
  }
  if (there != fs::path(folder)) {
    report.note(check, say("{} does not exist yet; {} can make it", folder, account.name));
    return true;
  }
  report.ok(check, say("{}, writable for {}", folder, account.name));
  return true;
}

/// Group and others may only read results and scans, because a writer could change a verdict while slabd is stopped.
void examine_rights(const char* check, const std::string& path, const DaemonUser& account, Examination& report) {
  struct stat file {};
  if (::stat(path.c_str(), &file) != 0) return;
  constexpr unsigned kWrite = 2;
  if (!S_ISDIR(file.st_mode) && !may(account, file, kWrite))
    report.failed(check, say("{} is not writable for {}", path, account.name),
                  fmt::format("chown {}:{} {}", account.name, account.name, path));
  constexpr mode_t kGroupWrites = 0020;
  constexpr mode_t kOthersWrite = 0002;
  if ((file.st_mode & (kGroupWrites | kOthersWrite)) == 0) return;
  const group* const name = ::getgrgid(file.st_gid);
  const std::string who = (file.st_mode & kOthersWrite) != 0 ? say("every user")
                          : name != nullptr                  ? say("every member of group {}", name->gr_name)
                                                             : say("every member of group {}", file.st_gid);
  report.warning(check, say("{} may write {}: a verdict could be changed unseen", who, path),
                 fmt::format("chmod g-w,o-w {}", path));
}

/// The scanner software needs access to the drop folder only.
void examine_drop_group(const std::string& drop_dir, const std::string& db_folder, const DaemonUser& account,
                        Examination& report) {
  struct stat drop {};
  struct stat database {};
  if (account.name != kDaemonUser || ::getgrnam(kScanGroup) == nullptr) return;
  if (::stat(drop_dir.c_str(), &drop) != 0 || ::stat(db_folder.c_str(), &database) != 0) return;
  if (drop.st_gid == database.st_gid)
    report.warning(
        "scan drop", say("{} belongs to the group that may read the database", drop_dir),
        say("chgrp -R {} {}, and put the scanner software's user into that group alone", kScanGroup, drop_dir));
}

struct Free {
  std::uint64_t bytes = 0;
  std::optional<std::uint64_t> files;  ///< number of files that can be created; nullopt: unlimited
};

std::optional<Free> free_of(const std::string& folder) {
  struct statvfs disk {};
  if (::statvfs(existing(folder).c_str(), &disk) != 0) return std::nullopt;
  Free free{static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize, std::nullopt};
  if (disk.f_files > 0) free.files = disk.f_favail;
  return free;
}

std::string gigabytes(std::uint64_t bytes) {
  return fmt::format("{:.1f} GB", static_cast<double>(bytes) / 1e9);
}

void examine_space(const char* check, const std::string& folder, std::uint64_t least, std::uint64_t for_long,
                   const std::string& what, Examination& report) {
  constexpr std::uint64_t kFilesMin = 1'000;  // the scans of about thirty slabs
  const std::optional<Free> free = free_of(folder);
  if (!free) {
    report.unknown(check, say("{}: {}", folder, quote(std::strerror(errno))));
  } else if (free->files && *free->files < kFilesMin) {
    report.failed(check,
                  say("{} free for {}, but room for {} more files only: the inodes are used up", gigabytes(free->bytes),
                      what, *free->files),
                  say("df -i; delete small files, or name another disk in [storage]"));
  } else if (free->bytes < least) {
    report.failed(check, say("{} free for {}, less than {}", gigabytes(free->bytes), what, gigabytes(least)),
                  say("free some space, or name another disk in [storage]"));
  } else if (free->bytes < for_long) {
    report.warning(check, say("{} free for {}", gigabytes(free->bytes), what),
                   say("set [storage] spool_budget_gb below what is free, so that old scans make room"));
  } else {
    report.ok(check, say("{} free for {}", gigabytes(free->bytes), what));
  }
}

/// Duration of an operation, or errno of its failure.
struct Timed {
  double time = 0.0;
  int fault = 0;  ///< errno
};

/// Seconds until one scan, written like in the spool, is durable.
Timed scan_durable_s(const std::string& folder) {
  const File file(folder + "/.doctor", O_CREAT | O_TRUNC | O_WRONLY);
  if (file.fd() < 0) return {0.0, errno};
  std::vector<char> piece(1U << 20U);
  // Not zeros, because some disks do not write them.
  for (std::size_t i = 0; i < piece.size(); ++i) piece[i] = static_cast<char>((i * 2654435761U) >> 13U);
  const Clock::time_point start = Clock::now();
  for (std::size_t written = 0; written < kScanBytes; written += piece.size())
    if (!write_all(file.fd(), piece.data(), piece.size())) return {0.0, errno};
  if (::fdatasync(file.fd()) != 0) return {0.0, errno};
  return {seconds_since(start), 0};
}

/// Median time of some small synced writes, ms.
Timed commit_ms(const std::string& folder) {
  const File file(folder + "/.doctor", O_CREAT | O_TRUNC | O_WRONLY);
  if (file.fd() < 0) return {0.0, errno};
  std::array<double, kCommits> times{};
  const std::array<char, 4096> page{};
  for (double& time : times) {
    const Clock::time_point start = Clock::now();
    if (!write_all(file.fd(), page.data(), page.size())) return {0.0, errno};
    if (::fdatasync(file.fd()) != 0) return {0.0, errno};
    time = 1e3 * seconds_since(start);
  }
  std::sort(times.begin(), times.end());
  return {times[times.size() / 2], 0};
}

/// Reports a failed write: a disk error, or missing permissions of the user.
void tell_unwritten(const char* check, const std::string& folder, int fault, Examination& report) {
  const std::string saw = say("{}: {}", folder, quote(std::strerror(fault)));
  if (fault == EROFS || fault == EIO || fault == ENOSPC || fault == EDQUOT)
    report.failed(check, saw, say("free some space, or repair the disk; journalctl -k"));
  else
    report.unknown(check, saw, say("run slabctl doctor as root or as the daemon's user"));
}

void examine_speed(const config::Config& config, const std::string& db_folder, Examination& report) {
  const std::string spool = existing(config.storage.spool_dir).string();
  if (const Timed scan = scan_durable_s(spool); scan.fault != 0) {
    tell_unwritten("disk speed", spool, scan.fault, report);
  } else {
    const std::string saw = say("a scan of 64 MB is durable in {:.2f} s ({:.0f} MB/s)", scan.time, 67.1 / scan.time);
    if (scan.time > kScanSlow_s)
      report.warning("disk speed", saw,
                     say("the robot waits for the disk at every station: use an SSD for [storage] spool_dir"));
    else
      report.ok("disk speed", saw);
  }
  const std::string folder = existing(db_folder).string();
  if (const Timed commit = commit_ms(folder); commit.fault != 0) {
    tell_unwritten("commit time", folder, commit.fault, report);
  } else {
    const std::string saw = say("a small write is durable in {:.1f} ms", commit.time);
    if (commit.time > kCommitSlow_ms)
      report.warning("commit time", saw,
                     say("the PLC waits for a commit with every command: put [storage] db on an SSD"));
    else
      report.ok("commit time", saw);
  }
}

/// Reports a transaction that another program keeps open. The daemon's own ones take milliseconds, so a holder is
/// checked twice.
void examine_foreign_lock(const std::string& db_path, Examination& report) {
  const std::string holder = storage::foreign_lock(db_path);
  if (holder.empty()) return;
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  if (storage::foreign_lock(db_path) != holder) return;
  report.failed("database lock", say("{} holds {}: slabd cannot write it", holder, db_path),
                say("end that program, or its transaction; readers use `.open --readonly` or slabctl"));
}

void examine_recipes(const config::Config& config, std::vector<Recipe>& recipes, Examination& report) {
  std::vector<config::Problem> problems;
  config::load_recipes(config.recipes_dir, recipes, problems, nullptr, nullptr, &config.gauges);
  for (const config::Problem& problem : problems)
    report.failed("recipe", quote(problem.text), say("correct the file; slabctl recipe check FILE"));
  std::string types;
  for (const Recipe& recipe : recipes)
    types += fmt::format("{}{} ({})", types.empty() ? "" : ", ", recipe.name.view(), recipe.slab_type);
  if (!recipes.empty()) report.ok("recipes", say("{} in {}", types, config.recipes_dir));
  for (const Recipe& recipe : recipes)
    if (unconfirmed_count(recipe) != 0)
      report.warning(
          "recipe",
          say("{}: {} nominals or tolerances are not confirmed", recipe.name.view(), unconfirmed_count(recipe)),
          say("compare with the drawing; slabctl recipe show {} lists them", recipe.path.view()));
  const bool is_used =
      std::ranges::any_of(recipes, [](const Recipe& recipe) { return recipe.design != DesignUse::none; });
  if (is_used && config.designs_dir.empty())
    report.failed("design sheets", say("a recipe uses design sheets, and [design] dir names no folder"),
                  say("name the folder of the sheets in [design] dir"));
  const config::DesignSet designs = config::load_designs(config.designs_dir);
  for (const config::Problem& problem : designs.problems)
    report.failed("design sheets", quote(problem.text), say("correct the file; slabctl design check FILE"));
  if (!config.designs_dir.empty() && designs.problems.empty())
    report.ok("design sheets", say("{} slabs in {}", designs.sheets.size(), config.designs_dir));
}

}  // namespace

DaemonUser daemon_user() {
  DaemonUser account;
  account.uid = ::geteuid();
  const passwd* entry = ::getpwnam(kDaemonUser);
  if (entry == nullptr) entry = ::getpwuid(::geteuid());
  if (entry == nullptr) return account;
  account.name = entry->pw_name;
  account.uid = entry->pw_uid;
  int count = 64;
  account.groups.resize(static_cast<std::size_t>(count));
  ::getgrouplist(entry->pw_name, entry->pw_gid, account.groups.data(), &count);
  account.groups.resize(static_cast<std::size_t>(std::clamp(count, 0, 64)));
  return account;
}

bool may(const DaemonUser& account, const struct stat& file, unsigned want) {
  if (account.uid == 0) return true;
  const unsigned mode = file.st_mode;
  if (file.st_uid == account.uid) return (mode >> 6U & want) == want;
  if (std::find(account.groups.begin(), account.groups.end(), file.st_gid) != account.groups.end())
    return (mode >> 3U & want) == want;
  return (mode & want) == want;
}

bool examine_files(const std::string& config_path, config::Config& config, std::vector<Recipe>& recipes,
                   Examination& report) {
  std::vector<config::Problem> problems;
  config::load_config(config_path, config, problems);
  for (const config::Problem& problem : problems)
    report.failed("configuration", quote(problem.text), say("correct the file; slabd --config FILE --check"));
  if (!problems.empty()) return false;
  report.ok("configuration", config_path);
  if (config.simulation)
    report.note("configuration",
                say("[line] simulation = true: STATUS bit 11 reports to the PLC that the line is emulated"),
                say("set it to false on a real line"));
  examine_recipes(config, recipes, report);
  return true;
}

void examine_disk(const config::Config& config, bool with_speed, Examination& report) {
  const DaemonUser account = daemon_user();
  if (account.name != kDaemonUser)
    report.note("user", say("user {} does not exist; permissions are checked for {}", kDaemonUser, account.name),
                say("the package makes it; without it the daemon runs as who starts it"));
  const std::string db_folder = fs::path(config.storage.db_path).parent_path().string();
  const bool database = examine_folder("database", db_folder.empty() ? "." : db_folder, account, kOwnerWrites, report);
  const bool spool = examine_folder("scans", config.storage.spool_dir, account, kOwnerWrites, report);
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    const config::ArmSettings& settings = config.arm(arm);
    if (settings.scanner_backend != hal::ScannerBackend::drop) continue;
    (void)examine_folder("scan drop", settings.scanner.drop_dir.c_str(), account, kScannerWrites, report);
    examine_drop_group(settings.scanner.drop_dir.c_str(), db_folder, account, report);
  }
  for (const char* side : {"", "-wal", "-shm"})
    examine_rights("database", config.storage.db_path + side, account, report);
  examine_rights("database", db_folder.empty() ? "." : db_folder, account, report);
  examine_rights("scans", config.storage.spool_dir, account, report);
  if (database) examine_foreign_lock(config.storage.db_path, report);
  if (database)
    examine_space("database disk", db_folder, kDatabaseFreeMin, 2 * kDatabaseFreeMin, say("records"), report);
  if (spool) {
    const std::uint64_t least = config.storage.spool_free_bytes_min;
    const std::uint64_t budget = config.storage.spool_budget_bytes;
    const std::uint64_t for_long = budget == 0 ? 20 * least : least;
    examine_space("scan disk", config.storage.spool_dir, least, for_long, say("scans"), report);
  }
  if (database && spool && with_speed) examine_speed(config, db_folder, report);
}

}  // namespace slabd::cli
