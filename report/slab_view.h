// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "report/words.h"
#include "storage/storage.h"

/// Presentation rules for stored slabs, shared by show, report and export.
namespace slabd::report {

/// Name of a slab on the command line. A number may be a key, a SLAB_ID or, if neither exists, a SLAB_NO; "key:12",
/// "id:12" and "no:12" are explicit. Any other text, also a number with leading zeros, is a SLAB_ID.
struct SlabName {
  std::optional<std::int64_t> key;
  std::string id;                   ///< empty if the name cannot be a SLAB_ID
  std::optional<std::uint32_t> no;  ///< SLAB_NO
};
[[nodiscard]] SlabName slab_name(const std::string& wanted);
/// Error for a number that is the key of one slab and the SLAB_ID of another.
[[nodiscard]] Error two_slabs(const SlabName& name, const storage::SlabRecord& of_key);

/// Finds the slab of that name; for a SLAB_ID or SLAB_NO the newest one. Code::config if the name is ambiguous.
[[nodiscard]] Result<std::optional<storage::SlabRecord>> find_slab(storage::Reader& reader, const std::string& wanted);
/// The valid attempt of a station, which is its latest one; nullptr if there is none.
[[nodiscard]] const storage::SlabBlock* latest(const storage::SlabRecord& record, int station);

/// The result of the valid attempt; nullptr if it was not measured.
[[nodiscard]] const BlockResult* measured(const storage::SlabRecord& record, int station);

[[nodiscard]] bool is_open(const storage::SlabRecord& record);

/// True if the slab was aborted. Its slab items are not judged: position, height, spacing, and slope against the
/// slab's frame.
[[nodiscard]] bool is_aborted(const storage::SlabRecord& record);
/// True if its recipe states lengths at a reference temperature (base/thermal.h).
[[nodiscard]] bool is_at_reference(const storage::SlabRecord& record);
/// True if the item's value was changed by that.
[[nodiscard]] inline bool is_corrected(const Item& item) {
  constexpr double kLeastShown_mm = 0.0005;
  return has_value(item.measured) && std::abs(item.measured - item.value) >= kLeastShown_mm;
}

/// "rework"; empty for none.
[[nodiscard]] std::string disposition_word(Disposition disposition, Language language);
/// "2: release by concession, 2026-11-20 08:00:00+01:00: reason (authority A, second S; entered by W)".
[[nodiscard]] std::string disposition_sentence(const storage::DispositionRecord& record, Language language);

struct Shown {
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
};
/// Verdict of a station in maps and tables: the final one once the slab has ended, also for a station that was never
/// scanned; before, that of the latest attempt. For an aborted slab only the blocks' objections, never a pass.
[[nodiscard]] Shown shown(const storage::SlabRecord& record, int station);

/// True if the finding is a pit within all limits of surface_pores: one of many, and not damage.
[[nodiscard]] bool is_small_pore(const BlockResult& block, const SurfaceFinding& finding);
/// The findings of a station's latest attempt that are not small pores, the largest first.
[[nodiscard]] std::vector<SurfaceFinding> damage_of(const storage::SlabRecord& record, int station);

/// True if a slab's item of one block replaces the block's own item, that is, if it has a limit. If slopes are judged
/// against the slab top beside the seat, the slope against the slab's frame is for information.
[[nodiscard]] bool supersedes(const Item& of_slab);

/// Datum of the judged slopes of a slab that has ended: "slab_frame" or "local_slab_top". Empty if slopes were not
/// judged.
[[nodiscard]] std::string_view slope_datum(const storage::SlabRecord& record);

/// The slab's item of this block that replaces `own`, or `own` if there is none. SLAB_END computes slopes again
/// against the slab's frame; if that is the datum, only those are valid.
[[nodiscard]] const Item& final_item(const storage::SlabRecord& record, int station, const Item& own);

/// The items of the slab and its blocks, each once per place. If the slab's item has a limit, it replaces the block's
/// item of the same kind (supersedes). `blocks` by station; nullptr: not measured.
[[nodiscard]] std::vector<Item> items_in_force(std::span<const BlockResult* const> blocks, const SlabResult& slab);
[[nodiscard]] std::vector<Item> items_in_force(const storage::SlabRecord& record);

}  // namespace slabd::report
