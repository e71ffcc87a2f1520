// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/fields.h"
#include "cli/recipe/recipe_source.h"
#include "cli/replay/remeasure.h"
#include "storage/compare.h"

/// Does a stored slab come out again, bit for bit? And if not, what is not as it was?
namespace slabd::cli {

enum class ReplayOutcome : std::uint8_t {
  identical,     ///< everything that was stored came out again
  differs,       ///< something did not, or a scan that should be there is not
  not_verified,  ///< not everything could be measured and judged again; what could be is identical
};
[[nodiscard]] std::string_view name(ReplayOutcome outcome);

/// Something that a measurement rests on is not what is recorded.
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
  std::optional<std::uint32_t> crc32c_stored;  ///< of the points when they were measured; none: not kept
  std::optional<std::uint32_t> crc32c_now;     ///< of those that the file holds; none: it could not be read
  ReplayOutcome outcome = ReplayOutcome::not_verified;
  std::string why;  ///< of what is not identical; of an identical one what is odd about its file
  storage::Comparison comparison;
};

struct SlabReplay {
  SlabHeader header;
  Verdict verdict = Verdict::none;
  ReplayOutcome outcome = ReplayOutcome::not_verified;
  std::string recipe;  ///< path of what it was measured again with; "sha:..." out of the database; empty: nothing
  std::vector<ChangedInput> changed;
  std::vector<BlockReplay> blocks;  ///< every attempt that was measured
  bool slab_compared = false;       ///< it had ended with a verdict, and no block differs in what its scan was
  storage::Comparison slab;
  std::string slab_why;
  bool scans_left = false;  ///< nothing was measured, though it has scans that are there

  [[nodiscard]] std::size_t figures() const;
  /// Scans whose points are those that were measured, by their checksum; and those of which none was kept.
  [[nodiscard]] std::size_t scans_proven() const;
  [[nodiscard]] std::size_t scans_without_checksum() const;
  [[nodiscard]] std::size_t differences() const;
};

/// Measures and judges the slab again with its recipe off the shelf: the very one that was recorded if it is there or
/// in the database, else the one of its slab type, which is then a changed input. `ChangedInput`s are found against
/// `reader`. journal_write: the database cannot be read.
[[nodiscard]] Result<SlabReplay> replay_slab(storage::Reader& reader, const storage::SlabRecord& record,
                                             RecipeShelf& shelf, Remeasurer& remeasurer);

}  // namespace slabd::cli
