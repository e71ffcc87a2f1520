// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "base/fixed.h"
#include "base/result.h"

/// The chain of results: each ended slab is sealed in the transaction of its end by the SHA-256 of its rows, chained
/// with the seal before. Found is what was changed behind slabd's back without making the chain anew. Who can write the
/// database file can also make the chain anew; only a head that was noted elsewhere (journal, metrics, paper) shows
/// that.
namespace slabd::storage {

class Store;

/// The newest entry. A noted head is found again in the chain by its number of entries.
struct ChainHead {
  std::int64_t entries = 0;  ///< 0: none
  FixedString<64> sha256;    ///< hex
};
/// As of the last job. Callable from any thread; empty for a store that keeps no chain.
[[nodiscard]] ChainHead chain_head(const Store& store);

struct ChainReport {
  std::string trouble;        ///< the first thing that was altered, in words; empty: nothing
  std::int64_t altered = 0;   ///< how many such things
  std::int64_t entries = 0;   ///< 0: there is no chain (a new database)
  std::int64_t sealed = 0;    ///< slabs whose rows were compared with their seal
  std::int64_t unsealed = 0;  ///< ended slabs without a seal: the chain was deleted after their end
  std::int64_t pruned = 0;    ///< slabs that retention took away since then
  std::string head;           ///< SHA-256 of the newest entry, hex
  std::string asked;          ///< SHA-256 of the entry that was asked for, hex; empty: there is no such entry
};
/// Computes the whole chain and the digest of every sealed slab again, and the checksums of recipes and calibrations.
/// Reads only. `entry`: the number of one whose checksum is wanted. config, journal_write: the file cannot be read.
[[nodiscard]] Result<ChainReport> check_chain(const std::string& path, std::int64_t entry = 0);

}  // namespace slabd::storage
