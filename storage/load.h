// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/jobs.h"
#include "storage/files/sqlite.h"
#include "storage/rows.h"

namespace slabd::storage {

struct StoredAttempt {
  Attempt attempt;
  AttemptState state;
};

/// Reads whole records, for recovery and for the reader. Each call must be inside the caller's transaction. Throws
/// SqlFailure.
class Loader {
 public:
  explicit Loader(Connection& db);

  [[nodiscard]] std::optional<SlabHeader> slab(std::int64_t slab_key);
  /// False if the slab has not ended; then `out` and `ended_utime_us` are unchanged.
  [[nodiscard]] bool slab_result(std::int64_t slab_key, SlabResult& out, std::int64_t& ended_utime_us);
  /// Attempts of a slab, by station, then number.
  [[nodiscard]] std::vector<StoredAttempt> attempts(std::int64_t slab_key);
  /// False if nothing was measured; then `out` is unchanged.
  [[nodiscard]] bool block(const BlockKey& key, BlockResult& out);
  /// Reads the maps; maps that were not stored are empty.
  void maps(const BlockKey& key, BlockMaps& out);

 private:
  template <std::size_t N>
  void items(const BlockKey& key, FixedVector<Item, N>& out);

  Statement slab_;
  Statement arms_;
  Statement slab_result_;
  Statement station_results_;
  Statement attempts_;
  Statement block_;
  Statement planes_;
  Statement casings_;
  Statement findings_;
  Statement edges_;
  Statement items_;
  Statement maps_;
  Statement gauges_;
};

/// Closed range of ids of unacknowledged results that did not fit into RecoveredLine. They are not shown to the PLC
/// before the next restart, so no acknowledgement may refer to them, although newer results are shown.
struct HeldBack {
  std::int64_t first_id = 1;
  std::int64_t last_id = 0;  ///< below first_id if empty
};

/// Newest slab key ever used, according to the database. Throws SqlFailure.
[[nodiscard]] std::int64_t newest_key_used(Connection& db);

/// Fills the state required by a restarted daemon. Call it inside a transaction, after the unfinished commands were
/// marked as interrupted. Throws SqlFailure.
[[nodiscard]] HeldBack read_line(Connection& db, RecoveredLine& line);

}  // namespace slabd::storage
