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

/// Reads whole records back, for recovery and for the reader. Each call belongs into the caller's transaction.
/// Throws SqlFailure.
class Loader {
 public:
  explicit Loader(Connection& db);

  [[nodiscard]] std::optional<SlabHeader> slab(std::int64_t slab_key);
  /// False: the slab has not ended; `out` and `ended_utime_us` are untouched.
  [[nodiscard]] bool slab_result(std::int64_t slab_key, SlabResult& out, std::int64_t& ended_utime_us);
  /// By station, then number.
  [[nodiscard]] std::vector<StoredAttempt> attempts(std::int64_t slab_key);
  /// False: nothing was measured; `out` is untouched.
  [[nodiscard]] bool block(const BlockKey& key, BlockResult& out);
  /// Maps that were not kept stay empty.
  void maps(const BlockKey& key, BlockMaps& out);

 private:
  template <std::size_t N>
  void items(const BlockKey& key, FixedVector<Item, N>& out);

  Statement slab_;
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
};

/// Unacknowledged results that did not fit into RecoveredLine: ids in this closed range. The PLC is not shown them
/// before the next restart, so that no acknowledgement may mean them, although newer results are shown meanwhile.
struct HeldBack {
  std::int64_t first_id = 1;
  std::int64_t last_id = 0;  ///< below first_id: none
};

/// The newest slab key that was ever used, as far as the database knows. Throws SqlFailure.
[[nodiscard]] std::int64_t newest_key_used(Connection& db);

/// Fills what a restarted daemon must know. Call it inside a transaction, after the unfinished commands have been
/// marked interrupted. Throws SqlFailure.
[[nodiscard]] HeldBack read_line(Connection& db, RecoveredLine& line);

}  // namespace slabd::storage
