// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "storage/storage.h"

/// What is said of a stored slab, whoever says it: show, report and export alike.
namespace slabd::cli {

/// What somebody calls a slab by. A number may be a key, a SLAB_ID or, where neither is there, a SLAB_NO; "key:12",
/// "id:12" and "no:12" say which. Anything else, also a number with zeros in front, is a SLAB_ID.
struct SlabName {
  std::optional<std::int64_t> key;
  std::string id;                   ///< empty: none is meant
  std::optional<std::uint32_t> no;  ///< SLAB_NO
};
[[nodiscard]] SlabName slab_name(const std::string& wanted);
/// What to say when a number is the key of one slab and the SLAB_ID of another.
[[nodiscard]] Error two_slabs(const SlabName& name, const storage::SlabRecord& of_key);

/// The slab of that name; of a SLAB_ID or SLAB_NO the newest one. config: the name means two slabs.
[[nodiscard]] Result<std::optional<storage::SlabRecord>> find_slab(storage::Reader& reader, const std::string& wanted);
/// The valid attempt of a station: its latest one; nullptr when there is none.
[[nodiscard]] const storage::SlabBlock* latest(const storage::SlabRecord& record, int station);

/// The result of the valid attempt; nullptr if it was not measured.
[[nodiscard]] const BlockResult* measured(const storage::SlabRecord& record, int station);

[[nodiscard]] bool is_open(const storage::SlabRecord& record);

/// Then nobody judged the slab's items: position, height, spacing, and slope against the slab's frame.
[[nodiscard]] bool is_aborted(const storage::SlabRecord& record);

struct Shown {
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
};
/// What maps and tables say of a station: the final verdict once the slab has ended, also of a station that was never
/// scanned; the latest attempt's own before. Of an aborted slab what its blocks have against them, never a pass.
[[nodiscard]] Shown shown(const storage::SlabRecord& record, int station);

/// A pit within all limits of surface_pores is a small pore: one of many, and nothing to look at.
[[nodiscard]] bool is_small_pore(const BlockResult& block, const SurfaceFinding& finding);
/// The findings of a station's latest attempt that are not small pores, the largest first.
[[nodiscard]] std::vector<SurfaceFinding> damage_of(const storage::SlabRecord& record, int station);

/// Does a slab's item of one block take the place of the block's own? Only if it was judged, that is, has a limit:
/// where slopes are judged against the slab top beside the seat, the one against the slab's frame is for information.
[[nodiscard]] bool supersedes(const Item& of_slab);

/// "slab_frame" or "local_slab_top": what the slopes of a slab that has ended were judged against. Empty: they were
/// not.
[[nodiscard]] std::string_view slope_datum(const storage::SlabRecord& record);

/// The slab's own item of this block that takes the place of `own`, which was judged by the block alone; `own` when
/// there is none: SLAB_END computes slopes anew against the slab's frame, and where that is the datum only those count.
[[nodiscard]] const Item& final_item(const storage::SlabRecord& record, int station, const Item& own);

/// The items of the slab and its blocks, each once per place: of the slope, which a block judges against its own slab
/// top and the slab against its frame, the slab's where it counts. `blocks` by station, nullptr: not measured.
[[nodiscard]] std::vector<Item> items_in_force(std::span<const BlockResult* const> blocks, const SlabResult& slab);
[[nodiscard]] std::vector<Item> items_in_force(const storage::SlabRecord& record);

}  // namespace slabd::cli
