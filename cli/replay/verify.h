// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/fields.h"
#include "cli/recipe/recipe_source.h"
#include "cli/replay/remeasure.h"
#include "storage/compare.h"

/// Verifies that a stored slab is reproduced bit for bit, and finds changed inputs if it is not.
namespace slabd::cli {

enum class ReplayOutcome : std::uint8_t {
  identical,     ///< all stored data was reproduced
  differs,       ///< some data was not, or a scan is missing that should exist
  not_verified,  ///< not all data could be measured and judged again; the rest is identical
};
[[nodiscard]] std::string_view name(ReplayOutcome outcome);

/// An input of a measurement that differs from its record.
struct ChangedInput {
  std::string what;  ///< "software", "recipe", "calibration", "stations"
  std::string stored;
  std::string now;
};
SLABD_FIELDS(ChangedInput, what, stored, now);

struct BlockReplay {
  int station = 0;
  int attempt = 0;
  std::string scan;
  std::optional<std::uint32_t> crc32c_stored;  ///< of the points when measured; nullopt: not stored
  std::optional<std::uint32_t> crc32c_now;     ///< of the points in the file; nullopt: it could not be read
  ReplayOutcome outcome = ReplayOutcome::not_verified;
  std::string why;  ///< reason for a difference; for an identical result, signs of a changed file
  storage::Comparison comparison;
};

struct SlabReplay {
  std::int64_t key = 0;
  std::string slab_id;
  std::string recorded_recipe;  ///< name of the recipe that the slab was begun with
  Verdict verdict = Verdict::none;
  ReplayOutcome outcome = ReplayOutcome::not_verified;
  std::string recipe;  ///< path of the recipe used; "sha:..." from the database; empty if there was none
  std::vector<ChangedInput> changed;
  std::vector<BlockReplay> blocks;  ///< every attempt that was measured
  bool slab_compared = false;       ///< the slab had a verdict, and no block differs because of its scan
  storage::Comparison slab;
  std::string slab_why;
  bool scans_left = false;  ///< the slab was not measured, although it has scans

  [[nodiscard]] std::size_t figures() const;
  /// Number of scans with unchanged points, by their checksum; and of those without a stored checksum.
  [[nodiscard]] std::size_t scans_proven() const;
  [[nodiscard]] std::size_t scans_without_checksum() const;
  [[nodiscard]] std::size_t differences() const;
};

/// Measures and judges the slab again with its recipe from the recipe_store. That is the recorded one if the folder or
/// the database contains it, otherwise that of its slab type, which then is a changed input. `ChangedInput`s are found
/// by comparison with `reader`. Code::journal_write: the database cannot be read.
[[nodiscard]] Result<SlabReplay> replay_slab(storage::Reader& reader, const storage::SlabRecord& record,
                                             RecipeStore& recipe_store, Remeasurer& remeasurer);

}  // namespace slabd::cli
