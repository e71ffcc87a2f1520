// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "report/words.h"
#include "storage/storage.h"

/// Objections to a stored slab, in the order in which people decide: damage, which a person can check at once, then
/// failed items, then what was not measured, then undecided items. Equal objections to several blocks are one entry, so
/// that a partial slab has a few sentences and not one for each item.
namespace slabd::report {

struct Finding {
  Verdict verdict = Verdict::none;
  std::vector<int> stations;  ///< the blocks; empty: the slab
  std::optional<Item> item;   ///< the item that did not pass, if it has a value
  std::string what;           ///< "seat slope: 1.6366 deg, limits ..., U ...", without the place
};

[[nodiscard]] std::vector<Finding> findings_of(const storage::SlabRecord& record, Language language);
/// "Block 4, seat slope: ...", "Blocks 1-6, 8: ...".
[[nodiscard]] std::string sentence_of(const Finding& finding, Language language);
/// "1-6, 8, 11-18" of rising numbers.
[[nodiscard]] std::string ranges_text(const std::vector<int>& numbers);

/// True if the block has an objection of its own, so that its evidence belongs into the report.
[[nodiscard]] bool is_objected(const std::vector<Finding>& findings, int station);

}  // namespace slabd::report
