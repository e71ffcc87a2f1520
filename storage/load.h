// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

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

}  // namespace slabd::storage
