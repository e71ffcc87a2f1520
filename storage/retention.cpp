// SPDX-License-Identifier: Apache-2.0
#include "storage/retention.h"

#include <algorithm>
#include <array>

#include "storage/seals.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

/// In the order of their references; a block takes its planes, casings and maps along.
constexpr std::array kTables = {"item",    "block",          "attempt",     "result",
                                "command", "station_result", "slab_result", "slab"};

}  // namespace

Retention::Retention(Connection& db)
    : db_(db),
      newest_(db, "SELECT slab_key FROM slab ORDER BY slab_key DESC LIMIT 1 OFFSET ?1"),
      newest_failed_(
          db, "SELECT slab_key FROM slab_result WHERE verdict <> 'pass' ORDER BY slab_key DESC LIMIT 1 OFFSET ?1"),
      candidate_(db,
                 "SELECT slab_key FROM slab JOIN slab_result USING (slab_key) WHERE slab_key <= ?1 "
                 "AND (verdict = 'pass' OR slab_key <= ?2) "
                 "AND NOT EXISTS (SELECT 1 FROM result WHERE result.slab_key = slab.slab_key AND acknowledged = 0) "
                 "AND NOT EXISTS (SELECT 1 FROM attempt WHERE attempt.slab_key = slab.slab_key "
                 "AND scan_state IN ('kept', 'deleting')) ORDER BY slab_key LIMIT 1"),
      drop_of_no_slab_(db,
                       "DELETE FROM command WHERE slab_key IS NULL "
                       "AND id < (SELECT min(id) FROM command WHERE slab_key IS NOT NULL)"),
      note_(db, "UPDATE line SET pruned_slabs = pruned_slabs + 1, pruned_key = max(pruned_key, ?1)") {}

std::int64_t Retention::key_at(Statement& newest_first, std::int64_t offset) {
  if (!newest_first.bind(1, offset).step()) return 0;
  const std::int64_t key = newest_first.integer(0);
  newest_first.reset();
  return key;
}

bool Retention::take_one(std::int64_t keep_slabs, std::int64_t keep_failed_slabs) {
  Transaction transaction(db_, "BEGIN IMMEDIATE");
  const std::int64_t newest = key_at(newest_, std::max(keep_slabs, kKeepSlabsMin));
  if (newest == 0) return false;
  const std::int64_t newest_failed = keep_failed_slabs == 0 ? 0 : key_at(newest_failed_, keep_failed_slabs);
  if (!candidate_.bind(1, newest).bind(2, newest_failed).step()) return false;
  const std::int64_t key = candidate_.integer(0);
  candidate_.reset();
  Seals(db_).prune(key);
  for (const char* table : kTables)
    db_.execute(std::string("DELETE FROM ") + table + " WHERE slab_key = " + std::to_string(key));
  drop_of_no_slab_.run();
  note_.bind(1, key).run();
  transaction.commit();
  return true;
}

}  // namespace slabd::storage
