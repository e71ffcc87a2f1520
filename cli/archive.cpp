// SPDX-License-Identifier: Apache-2.0
//
// slabctl archive: packs the scans of stored slabs without loss into DIR/<key>/<scan>.slabz, checks packed scans, and
// restores the original files. It deletes nothing.
//
// An archive is written under a temporary name, synced, renamed, and read back. Only an archive that restored the
// original, with the points that were measured, gets the original's time of writing. An archive with that time and size
// is therefore not read again, which makes a nightly run short.
#include <fcntl.h>
#include <fmt/core.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/durable.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/replay/remeasure.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "cli/terminal/render.h"
#include "hal/scan/packed.h"
#include "report/json.h"
#include "report/table.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

struct ArchiveOptions {
  DatabaseOptions database;
  SlabChoice choice;
  std::string out;
  std::string scans_dir;
  std::vector<std::string> check;
  std::vector<std::string> unpack;
  ScanFormOptions form{.unit = "", .columns = ""};
  bool json = false;
};

enum class ScanState : std::uint8_t {
  packed,    ///< written and read back
  there,     ///< was packed before
  whole,     ///< an archive that was checked
  unpacked,  ///< the original was restored
  gone,      ///< neither scan nor archive exists
  changed,   ///< packed, but the points are not those that were measured
  refused,   ///< see `why`
};
constexpr std::array<std::string_view, 7> kStates = {"packed", "there",   "whole",  "unpacked",
                                                     "gone",   "changed", "refused"};
std::string_view name(ScanState state) {
  return kStates[static_cast<std::size_t>(state)];
}

struct ScanRow {
  std::int64_t key = 0;  ///< 0: not of a slab
  int station = 0;
  int attempt = 0;
  std::string scan;     ///< path of the original
  std::string archive;  ///< path of the packed scan
  ScanState state = ScanState::refused;
  std::string why;
  hal::PackedScan packed;
  std::optional<std::uint32_t> crc32c_stored;
  std::optional<std::uint32_t> crc32c_now;
};

void refuse(ScanRow& row, std::string why) {
  row.state = ScanState::refused;
  row.why = std::move(why);
}

bool is_file(const std::string& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

/// Stops if writing fails: the folder is full or gone, and the next file would fail too.
Status write_to(OutFile& out, std::span<const std::byte> bytes) {
  out.write(bytes.data(), bytes.size());
  return out.good() ? success() : out.close(Code::journal_write);
}

void set_time(const std::string& path, const struct stat& original) {
  const std::array<timespec, 2> times = {original.st_mtim, original.st_mtim};
  // Without the time the next run checks the archive again.
  static_cast<void>(::utimensat(AT_FDCWD, path.c_str(), times.data(), 0));
}

bool same_time(const struct stat& a, const struct stat& b) {
  return a.st_mtim.tv_sec == b.st_mtim.tv_sec && a.st_mtim.tv_nsec == b.st_mtim.tv_nsec;
}

/// Makes the folder of a slab. `out` must exist: it may be a share that is not mounted.
void make_folder(const std::string& out, const fs::path& folder) {
  std::error_code fault;
  if (!fs::is_directory(out, fault)) stop(kNotReachable, fmt::format("--out {}: the folder is not there", out));
  if (fs::is_directory(folder, fault)) return;
  if (!fs::create_directory(folder, fault))
    stop(kNotReachable, fmt::format("{} cannot be made: {}", folder.string(), fault.message()));
  need(sync_folder(out), kNotReachable);
}

// ---- free space ---------------------------------------------------------------------------------------------------

/// Left free on the disk of the database, as by a backup: the records of a day.
constexpr std::uint64_t kRecordsBytes = 200'000'000;

/// True if both folders use the same free space. `other` may not exist.
bool share_a_disk(const std::string& folder, const std::string& other) {
  struct stat a {};
  struct stat b {};
  if (::stat(other.c_str(), &b) != 0) return errno != ENOENT;
  struct statvfs room_a {};
  struct statvfs room_b {};
  if (::stat(folder.c_str(), &a) != 0 || ::statvfs(folder.c_str(), &room_a) != 0 ||
      ::statvfs(other.c_str(), &room_b) != 0)
    return true;
  // Subvolumes have their own device numbers, but the same free-space figures.
  return a.st_dev == b.st_dev || (room_a.f_frsize == room_b.f_frsize && room_a.f_blocks == room_b.f_blocks &&
                                  room_a.f_bfree == room_b.f_bfree && room_a.f_files == room_b.f_files);
}

/// Bytes to leave free on the disk of `out`. Without those of the spool slabd begins no slab (fault 501). 0: the disk
/// has neither the database nor the spool.
std::uint64_t bytes_to_leave(const ArchiveOptions& options, const config::Config& config) {
  const bool is_configured = options.database.db.empty();
  const fs::path db = is_configured ? config.storage.db_path : options.database.db;
  const std::string db_folder = db.has_parent_path() ? db.parent_path().string() : ".";
  // Without a configuration the spool is taken to be next to the database, as in a new installation.
  const std::string spool = is_configured ? config.storage.spool_dir : db_folder;
  return (share_a_disk(options.out, db_folder) ? kRecordsBytes : 0) +
         (share_a_disk(options.out, spool) ? config.storage.spool_free_bytes_min : 0);
}

/// Stops if a file of `bytes` would take space that slabd needs.
void require_room(const std::string& out, std::uint64_t bytes, std::uint64_t leave_bytes) {
  struct statvfs disk {};
  if (leave_bytes == 0 || ::statvfs(out.c_str(), &disk) != 0) return;
  const std::uint64_t free = static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize;
  if (free >= leave_bytes && free - leave_bytes >= bytes) return;
  constexpr double kMb = 1e6;
  stop(kNotReachable,
       fmt::format("--out {}: a scan of {:.1f} MB, with {:.1f} MB left for slabd on the same disk, needs {:.1f} MB "
                   "free, and {:.1f} MB are free",
                   out, static_cast<double>(bytes) / kMb, static_cast<double>(leave_bytes) / kMb,
                   static_cast<double>(bytes + leave_bytes) / kMb, static_cast<double>(free) / kMb));
}

// ---- packing -----------------------------------------------------------------------------------------------------

/// Reads the archive back and compares it with `sha256`. False: `row` has the reason.
bool is_proven(ScanRow& row, const std::string& sha256, hal::LengthUnit unit) {
  const Result<hal::CheckedScan> checked = hal::check_packed_scan(row.archive.c_str(), unit);
  if (!checked) {
    refuse(row, std::string(checked.error().text.view()));
    return false;
  }
  row.packed = checked.value().packed;
  row.crc32c_now = checked.value().points_crc32c;
  if (row.packed.sha256 == sha256) return true;
  refuse(row, fmt::format("{} holds another file ({:.12}, the scan is {:.12}); it is not replaced", row.archive,
                          row.packed.sha256, sha256));
  return false;
}

/// False: the archive was read back, and its points are not those that were measured; `row` has the reason. Such an
/// archive does not get the original's time: it is read at each run, and reported.
bool holds_the_measured(ScanRow& row) {
  if (!row.crc32c_stored || !row.crc32c_now || row.crc32c_stored == row.crc32c_now) return true;
  row.state = ScanState::changed;
  row.why = fmt::format("the points are not those that were measured: crc32c {:08x} stored, {:08x} now",
                        *row.crc32c_stored, *row.crc32c_now);
  return false;
}

/// The archive exists: is it of this scan?
void compare_with_archive(ScanRow& row, const struct stat& original, const struct stat& archive, hal::LengthUnit unit) {
  row.state = ScanState::there;
  const Result<hal::PackedScan> packed = hal::packed_scan_at(row.archive.c_str());
  if (!packed) return refuse(row, std::string(packed.error().text.view()));
  row.packed = packed.value();
  if (same_time(original, archive) && row.packed.bytes == static_cast<std::uint64_t>(original.st_size)) return;
  const FileDigest digest = need(digest_of(row.scan), kNotReachable);
  if (is_proven(row, digest.sha256, unit) && holds_the_measured(row)) set_time(row.archive, original);
}

void write_archive(ScanRow& row, const struct stat& original, hal::LengthUnit unit) {
  std::string sha256;
  {
    OutFile out(row.archive, {.synced = true, .of_slabd = true});
    const auto packed =
        hal::pack_scan(row.scan.c_str(), [&out](std::span<const std::byte> bytes) { return write_to(out, bytes); });
    if (!packed && exit_for(packed.error().code) == kNotReachable) stop(packed.error());
    if (!packed) return refuse(row, std::string(packed.error().text.view()));
    need(out.close(Code::journal_write));
    sha256 = packed.value().sha256;
  }
  if (!is_proven(row, sha256, unit)) {
    ::unlink(row.archive.c_str());
    return;
  }
  row.state = ScanState::packed;
  if (holds_the_measured(row)) set_time(row.archive, original);
}

/// Packs the scan of one attempt below `out`. `leave_bytes`: see bytes_to_leave().
ScanRow pack(const storage::SlabBlock& stored, std::int64_t key, const ArchiveOptions& options, const ScanForms& forms,
             std::uint64_t leave_bytes) {
  const hal::LengthUnit unit = forms.of(stored.attempt).unit;
  ScanRow row;
  row.key = key;
  row.station = stored.attempt.station;
  row.attempt = stored.attempt.number;
  row.crc32c_stored = stored.attempt.points_crc32c;
  row.scan = scan_at(stored, options.scans_dir);
  const fs::path folder = fs::path(options.out) / std::to_string(key);
  const std::string name = fs::path(stored.attempt.scan_path.view()).filename().string();
  row.archive = (folder / name).string() + std::string(hal::kPackedExtension);
  struct stat original {};
  struct stat archive {};
  const bool has_archive = ::stat(row.archive.c_str(), &archive) == 0;
  if (row.scan.ends_with(hal::kPackedExtension) || ::stat(row.scan.c_str(), &original) != 0) {
    row.state = has_archive ? ScanState::there : ScanState::gone;
    if (!has_archive) return row;
    // It is the only copy now.
    if (const auto packed = hal::packed_scan_at(row.archive.c_str()); packed)
      row.packed = packed.value();
    else
      refuse(row, std::string(packed.error().text.view()));
    return row;
  }
  std::error_code ignored;
  if (fs::equivalent(fs::path(row.scan).parent_path(), folder, ignored)) {
    refuse(row, fmt::format("--out {}: it holds the scans themselves, and slabd deletes there", options.out));
    return row;
  }
  if (has_archive) {
    compare_with_archive(row, original, archive, unit);
  } else {
    require_room(options.out, static_cast<std::uint64_t>(original.st_size), leave_bytes);
    make_folder(options.out, folder);
    write_archive(row, original, unit);
  }
  return row;
}

std::vector<ScanRow> pack_slabs(const ArchiveOptions& options) {
  config::Config config;
  if (options.database.db.empty()) config = config_from(options.database.config);
  const ScanForms forms(config, options.form);
  const auto reader = open_database(options.database);
  const std::vector<std::int64_t> keys = chosen_slabs(*reader, options.choice);
  std::error_code ignored;
  if (!fs::is_directory(options.out, ignored))
    stop(kNotReachable, fmt::format("--out {}: the folder is not there", options.out));
  const std::uint64_t leave_bytes = bytes_to_leave(options, config);
  std::vector<ScanRow> rows;
  ProgressCount progress(stderr, keys.size());
  for (const std::int64_t key : keys) {
    progress.next(fmt::format("packing slab {}", key));
    const auto record = need(reader->slab(key), kNotReachable);
    if (!record) continue;
    for (const storage::SlabBlock& stored : record->blocks)
      if (!stored.attempt.scan_path.empty()) rows.push_back(pack(stored, key, options, forms, leave_bytes));
  }
  progress.erase();
  return rows;
}

// ---- packed files ------------------------------------------------------------------------------------------------

ScanRow check(const std::string& file, hal::LengthUnit unit) {
  ScanRow row;
  row.archive = file;
  const Result<hal::CheckedScan> checked = hal::check_packed_scan(file.c_str(), unit);
  if (!checked) {
    refuse(row, std::string(checked.error().text.view()));
    return row;
  }
  row.state = ScanState::whole;
  row.packed = checked.value().packed;
  row.crc32c_now = checked.value().points_crc32c;
  return row;
}

ScanRow unpack(const std::string& file, const std::string& out_dir) {
  ScanRow row;
  row.archive = file;
  const Result<hal::PackedScan> packed = hal::packed_scan_at(file.c_str());
  if (!packed) {
    refuse(row, std::string(packed.error().text.view()));
    return row;
  }
  row.packed = packed.value();
  row.scan = (fs::path(out_dir) / row.packed.name).string();
  if (is_file(row.scan)) {
    const FileDigest digest = need(digest_of(row.scan), kNotReachable);
    row.state = ScanState::there;
    if (digest.sha256 != row.packed.sha256)
      refuse(row, fmt::format("{} is another file; it is not replaced", row.scan));
    return row;
  }
  OutFile out(row.scan, {.synced = true, .of_slabd = true});
  const auto restored =
      hal::unpack_scan(file.c_str(), [&out](std::span<const std::byte> bytes) { return write_to(out, bytes); });
  if (!restored && exit_for(restored.error().code) == kNotReachable) stop(restored.error());
  if (!restored) {
    refuse(row, std::string(restored.error().text.view()));
    return row;
  }
  need(out.close(Code::journal_write));
  struct stat archive {};
  if (::stat(file.c_str(), &archive) == 0) set_time(row.scan, archive);
  row.state = ScanState::unpacked;
  return row;
}

// ---- output --------------------------------------------------------------------------------------------------------

struct Total {
  double seconds = 0.0;  ///< of the whole run
  std::uint64_t bytes = 0;
  std::uint64_t packed_bytes = 0;
  std::array<std::size_t, kStates.size()> scans{};

  Total(const std::vector<ScanRow>& rows, double run_s) : seconds(run_s) {
    for (const ScanRow& row : rows) {
      bytes += row.packed.bytes;
      packed_bytes += row.packed.packed_bytes;
      ++scans[static_cast<std::size_t>(row.state)];
    }
  }
  [[nodiscard]] std::size_t of(ScanState state) const { return scans[static_cast<std::size_t>(state)]; }
};

double ratio(std::uint64_t bytes, std::uint64_t packed_bytes) {
  return packed_bytes == 0 ? kNoValue : static_cast<double>(bytes) / static_cast<double>(packed_bytes);
}

std::string as_json(const std::vector<ScanRow>& rows, const Total& total) {
  report::Json json("slabd.archive/1");
  json.list("scans", rows, [&](const ScanRow& row) {
    const bool of_slab = row.key != 0;
    json.field("key", report::only_if(of_slab, row.key)).field("station", report::only_if(of_slab, row.station));
    json.field("attempt", report::only_if(of_slab, row.attempt)).field("state", name(row.state));
    json.field("why", row.why).field("scan", row.scan).field("archive", row.archive);
    const bool known = row.packed.packed_bytes != 0;
    json.field("bytes", report::only_if(known, row.packed.bytes));
    json.field("packed_bytes", report::only_if(known, row.packed.packed_bytes));
    json.field("ratio", ratio(row.packed.bytes, row.packed.packed_bytes));
    json.field("sha256", report::only_if(known, row.packed.sha256));
    report::write_crc32c(json, "crc32c_stored", row.crc32c_stored);
    report::write_crc32c(json, "crc32c_now", row.crc32c_now);
  });
  json.field("bytes", total.bytes).field("packed_bytes", total.packed_bytes);
  json.field("ratio", ratio(total.bytes, total.packed_bytes)).field("seconds", total.seconds);
  return json.text();
}

/// `all`: also scans that did not have to be packed.
std::string as_text(const std::vector<ScanRow>& rows, const Total& total, bool all) {
  report::Table table{"slab?", "scan<", "bytes", "packed", "ratio", "state<"};
  for (const ScanRow& row : rows) {
    if (!all && (row.state == ScanState::there || row.state == ScanState::gone)) continue;
    const fs::path shown(row.key != 0 ? row.scan : row.archive);
    table.add(row.key == 0 ? report::Cell("") : report::Cell(row.key), shown.filename().string(), row.packed.bytes,
              row.packed.packed_bytes, report::Cell(ratio(row.packed.bytes, row.packed.packed_bytes), 2),
              name(row.state));
  }
  std::string text = table.rows.empty() ? "" : report::text_of(table, style_for(stdout));
  std::string counts;
  for (std::size_t i = 0; i < kStates.size(); ++i)
    if (total.scans[i] > 0) counts += fmt::format("{}{} {}", counts.empty() ? "" : ", ", kStates[i], total.scans[i]);
  text += rows.empty() ? "no scan\n"
                       : fmt::format("{}; {} bytes packed into {}, {:.2f} to 1; {:.1f} s\n", counts, total.bytes,
                                     total.packed_bytes, ratio(total.bytes, total.packed_bytes), total.seconds);
  return text;
}

std::vector<ScanRow> work(const ArchiveOptions& options) {
  if (options.check.empty() && options.unpack.empty()) return pack_slabs(options);
  std::vector<ScanRow> rows;
  std::error_code ignored;
  if (!options.unpack.empty() && !fs::is_directory(options.out, ignored))
    stop(kNotReachable, fmt::format("--out {}: the folder is not there", options.out));
  ProgressCount progress(stderr, options.check.size() + options.unpack.size());
  for (const std::string& file : options.check) {
    progress.next("checking " + file);
    rows.push_back(check(file, options.form.form().unit));
  }
  for (const std::string& file : options.unpack) {
    progress.next("unpacking " + file);
    rows.push_back(unpack(file, options.out));
  }
  progress.erase();
  return rows;
}

int archive(const ArchiveOptions& options) {
  const bool of_files = !options.check.empty() || !options.unpack.empty();
  if (of_files && (!options.choice.slabs.empty() || options.choice.has_filter()))
    stop(kUsage, "--check and --unpack take packed files; slabs cannot be chosen with them");
  if (options.out.empty() && options.check.empty()) stop(kUsage, "--out DIR is required: the folder to write to");
  const auto start = std::chrono::steady_clock::now();
  const std::vector<ScanRow> rows = work(options);
  const Total total(rows, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  const bool is_named = of_files || !options.choice.slabs.empty();
  fmt::print("{}", options.json ? as_json(rows, total) : as_text(rows, total, is_named));
  for (const ScanRow& row : rows)
    if (!row.why.empty()) complain(row.why);
  if (total.of(ScanState::refused) > 0) return kBadInput;
  // Old scans are deleted regularly: a scan that is gone is a finding only if its slab was named.
  const bool lacks = is_named && total.of(ScanState::gone) > 0;
  return lacks || total.of(ScanState::changed) > 0 ? kNotPass : kDone;
}

}  // namespace

void add_archive(args::Command& app) {
  auto options = std::make_shared<ArchiveOptions>();
  args::Command command = app.add_subcommand("archive", "Pack the scans of slabs without loss, check and unpack them");
  command->footer(
      "\nEvery scan of the slabs becomes DIR/KEY/SCAN.slabz, which restores the file byte for byte. Each is read back\n"
      "before it is reported. Scans are not deleted, archives are not replaced. A scan that was packed before is left\n"
      "out. `replay`, `export cloud` and `inspect` read packed scans: --scans DIR.\n"
      "Exit status 0: done; 1: a scan of a named slab is gone, or the points of one are not those that were measured;\n"
      "3: an archive is damaged (the byte is named) or holds another file; 4: the folder cannot be written, or it is\n"
      "on a disk of slabd, which would have too little space left for the next slab.\n"
      "Examples: slabctl archive SLAB-0042 --out /mnt/archive\n"
      "          slabctl archive --until 7d --out /mnt/archive\n"
      "          slabctl archive --check /mnt/archive/12/*.slabz\n"
      "          slabctl archive --unpack /mnt/archive/12/03-1.ply.slabz --out /tmp\n"
      "          slabctl replay 12 --verify --scans /mnt/archive");
  options->choice.add_to(*command);
  options->database.add_to(*command);
  command->add_option("--out", options->out, "Folder for the packed scans, or for the unpacked ones; it must exist");
  command->add_option("--scans", options->scans_dir, "A copy of the spool, for scans that were moved away");
  args::Option check_option = command->add_option("--check", options->check, "Check these packed scans; writes nothing")
                                  ->expected(1, 1'000'000);
  command->add_option("--unpack", options->unpack, "Restore the originals of these packed scans")
      ->expected(1, 1'000'000)
      ->excludes(check_option);
  options->form.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.archive/1 on stdout");
  command->runs([options] { return archive(*options); });
}

}  // namespace slabd::cli
