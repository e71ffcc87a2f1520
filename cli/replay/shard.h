// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "cli/replay/shard_files.h"

/// A replay in shards: several processes measure parts of one selection, on one machine or several, and write their
/// results into one folder. slabctl replay --merge prints what one process would have printed.
namespace slabd::cli {

/// Shard `index` (from 1) of `count`.
struct Shard {
  int index = 1;
  int count = 1;
  /// The same on every machine: from the SHA-256 of the key.
  [[nodiscard]] bool contains(std::int64_t key) const;
};
inline constexpr int kShardsMax = 100'000;
/// Parses "2/8"; nullopt if it is not a shard.
[[nodiscard]] std::optional<Shard> parse_shard(std::string_view text);

/// SHA-256 of this program if its version names no commit, because such a version belongs to many builds; otherwise
/// empty. Stops if the program cannot be read.
[[nodiscard]] std::string build_sha256();

/// Lowers the priority of this process and of threads that it creates later, if a daemon listens at `control_socket`:
/// processors and disks serve the inspection first. An error is ignored; the shard then runs with its own priority.
void give_way_to_line(const std::string& control_socket);

struct ShardRun {
  Shard shard;
  std::string out;             ///< folder; created if it does not exist
  std::string control_socket;  ///< of the daemon on this machine; empty: it is not asked
};
/// Measures the slabs of the shard that have no file yet and writes their files. Returns the exit status of a replay of
/// these slabs; kDone if the shard has none. `measure` measures one slab.
/// Stops if the folder belongs to another selection, if a file cannot be written, and if a slab is open on the line.
[[nodiscard]] int run_shard(const ShardRun& run, const Selection& selection, const ReplayHead& head,
                            const std::function<ReplayRecord(std::int64_t)>& measure);

/// Prints the result of all shards in the folder `dir`, byte for byte as one process does; returns its exit status.
/// Stops if a slab is missing, and if a file is damaged or belongs to another build, recipe or option.
[[nodiscard]] int merge_shards(const std::string& dir, bool as_json);

}  // namespace slabd::cli
