// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "report/words.h"
#include "storage/storage.h"

/// Small documents of a stored slab for the page: its map, and the maps of a block. Sentences are in `language`; all
/// keys and numbers are the same in all languages.
namespace slabd::report {

/// slabd.slab_map/1 (docs/schemas/slab_map.json). Checks whether the blocks' scans still exist.
[[nodiscard]] std::string slab_map_json(const storage::SlabRecord& record, Language language);

/// slabd.block_map/1 (docs/schemas/block_map.json) of the newest measured attempt of the station. `maps`: those of this
/// attempt; empty if it has none.
[[nodiscard]] std::string block_map_json(const storage::SlabRecord& record, int station, const BlockMaps& maps,
                                         Language language);

/// The newest measured attempt of the station; nullptr if there is none. A later attempt may have failed.
[[nodiscard]] const storage::SlabBlock* newest_measured(const storage::SlabRecord& record, int station);

}  // namespace slabd::report
