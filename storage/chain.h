// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "base/fixed.h"
#include "base/result.h"

/// Chain of results. Each ended slab is sealed in the transaction of its end by the SHA-256 of its rows, chained with
/// the previous seal. This detects changes made without recomputing the chain. A person who can write the database file
/// can also recompute the chain. Only a head that was recorded elsewhere (journal, metrics, paper) reveals that.
namespace slabd::storage {

class Store;

/// The newest entry. A recorded head can be found in the chain by its number of entries.
struct ChainHead {
  std::int64_t entries = 0;  ///< 0 if the chain is empty
  FixedString<64> sha256;    ///< hex
};
/// Head after the last job. Callable from any thread; empty for a store without a chain.
[[nodiscard]] ChainHead chain_head(const Store& store);

struct ChainReport {
  std::string trouble;        ///< description of the first alteration found; empty if none
  std::int64_t altered = 0;   ///< number of alterations
  std::int64_t entries = 0;   ///< 0: the chain does not exist yet (a new database)
  std::int64_t sealed = 0;    ///< number of slabs compared with their seal
  std::int64_t unsealed = 0;  ///< ended slabs without a seal: the chain was deleted after they ended
  std::int64_t pruned = 0;    ///< slabs removed by retention since then
  std::string head;           ///< SHA-256 of the newest entry, hex
  std::string asked;          ///< SHA-256 of the requested entry, hex; empty if it does not exist
};
/// Recomputes the whole chain, the digest of every sealed slab, and the checksums of recipes and calibrations. Reads
/// only. `entry`: number of an entry whose checksum is returned. config, journal_write: the file cannot be read.
[[nodiscard]] Result<ChainReport> check_chain(const std::string& path, std::int64_t entry = 0);

}  // namespace slabd::storage
