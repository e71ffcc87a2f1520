// SPDX-License-Identifier: Apache-2.0
#include "storage/retention.h"

#include <algorithm>
#include <array>

#include "storage/storage.h"

namespace slabd::storage {
namespace {

/// In the order of their references; a block takes its planes, casings and maps along.
constexpr std::array kTables = {"item",    "block",          "attempt",     "result",
                                "command", "station_result", "slab_result", "slab"};

}  // namespace

Retention::Retention(Connection& db)
    : db_(db),
      newest_to_go_(db, "SELECT slab_key FROM slab ORDER BY slab_key DESC LIMIT 1 OFFSET ?1"),
      candidate_(db,
                 "SELECT slab_key FROM slab JOIN slab_result USING (slab_key) WHERE slab_key <= ?1 "
                 "AND NOT EXISTS (SELECT 1 FROM result WHERE result.slab_key = slab.slab_key AND acknowledged = 0) "
                 "AND NOT EXISTS (SELECT 1 FROM attempt WHERE attempt.slab_key = slab.slab_key "
                 "AND scan_state IN ('kept', 'deleting')) ORDER BY slab_key LIMIT 1"),
      note_(db, "UPDATE line SET pruned_slabs = pruned_slabs + 1, pruned_key = max(pruned_key, ?1)") {}

bool Retention::take_one(std::int64_t keep_slabs) {
  Transaction transaction(db_, "BEGIN IMMEDIATE");
  newest_to_go_.bind(1, std::max(keep_slabs, kKeepSlabsMin));
  if (!newest_to_go_.step()) return false;
  const std::int64_t newest = newest_to_go_.integer(0);
  newest_to_go_.reset();
  if (!candidate_.bind(1, newest).step()) return false;
  const std::int64_t key = candidate_.integer(0);
  candidate_.reset();
  for (const char* table : kTables)
    db_.execute(std::string("DELETE FROM ") + table + " WHERE slab_key = " + std::to_string(key));
  note_.bind(1, key).run();
  transaction.commit();
  return true;
}

}  // namespace slabd::storage
