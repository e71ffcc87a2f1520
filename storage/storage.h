// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"

/// SQLite: what was commanded, acquired, measured and decided. The daemon holds the only writer; slabctl reads.
namespace slabd::storage {

inline constexpr int kApplicationId = 0x534C4142;  // "SLAB"
inline constexpr int kSchemaVersion = 2;

struct StoreSettings {
  std::string db_path;
  std::string spool_dir;
  /// SLAB_BEGIN is refused below this much free space on the spool disk: two slabs of 18 x 60 MB.
  std::uint64_t spool_free_bytes_min = 2'300'000'000;
  /// Bytes of scans the spool may hold; beyond it the scans (never the records) of the oldest acknowledged slabs are
  /// deleted, passed ones first. 0 = keep everything.
  std::uint64_t spool_budget_bytes = 0;
};

/// The writer. One object, one thread. Every apply() is one transaction, durable when it returns
/// (synchronous=EXTRA, then WAL). A write error closes the file; the next call opens it anew, with quick_check, before
/// it does anything. A job given again because its answer was an error replaces what the first one may have left.
class Store {
 public:
  virtual ~Store() = default;
  /// Reads what a restarted daemon must know and marks interrupted commands (one transaction); then deletes scans of
  /// the newest slab that were spooled and never recorded. Call it once, before the first scan. More unacknowledged
  /// results than RecoveredLine holds stay unacknowledged, the newest of them, until the next restart.
  [[nodiscard]] virtual Result<std::unique_ptr<RecoveredLine>> recover() = 0;
  /// Codes: store_full (disk, or less than spool_free_bytes_min at a slab's begin), journal_write (anything else).
  [[nodiscard]] virtual Status apply(const StoreJob& job) = 0;
  /// Why old scans could not be deleted to keep the spool budget; empty when all is well. Never fails a job.
  [[nodiscard]] virtual std::string_view spool_trouble() const { return {}; }
};

/// Opens or creates the database (folders too, mode 2770). One of an older schema version is copied to
/// `<db>.v<version>-backup` and then brought up to date in one transaction. journal_write when it cannot be opened, is
/// open for writing elsewhere, is damaged, another application's (application_id), or newer than this program
/// (user_version); the text names the file and the figures.
[[nodiscard]] Result<std::unique_ptr<Store>> open_store(const StoreSettings& settings);

// ---- reading (slabctl; short read-only transactions, never checkpoints) -------------------------------------------

struct SlabSummary {
  SlabHeader header;
  std::int64_t ended_utime_us = 0;  ///< 0 = still open
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  int stations_measured = 0;
  bool acknowledged = false;
};

struct SlabBlock {
  Attempt attempt;
  StationPhase phase = StationPhase::empty;
  std::uint16_t code = 0;
  BlockResult block;
  Verdict final_verdict = Verdict::none;  ///< after SLAB_END, slab items included
  std::uint16_t final_reason = 0;
};

struct SlabRecord {
  SlabSummary summary;
  SlabResult slab;                ///< items empty until SLAB_END
  std::vector<SlabBlock> blocks;  ///< every attempt, by station and number; the latest of a station is the valid one
};

class Reader {
 public:
  virtual ~Reader() = default;
  /// Newest first.
  [[nodiscard]] virtual Result<std::vector<SlabSummary>> slabs(std::size_t limit) = 0;
  /// By key, or by the newest slab with this SLAB_ID.
  [[nodiscard]] virtual Result<std::optional<SlabRecord>> slab(std::int64_t key) = 0;
  [[nodiscard]] virtual Result<std::optional<std::int64_t>> find(std::string_view slab_id) = 0;
};
/// config when the file does not exist, is no slabd database, or is one of an older or newer schema version (a reader
/// changes nothing; the daemon's start brings an older one up to date).
[[nodiscard]] Result<std::unique_ptr<Reader>> open_reader(const std::string& db_path);

}  // namespace slabd::storage
