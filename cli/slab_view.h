// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "storage/storage.h"

/// What is said of a stored slab, whoever says it: show, report and export alike.
namespace slabd::cli {

/// A number is a key; anything else, and a number that is no key, is a SLAB_ID: the newest slab of that name.
[[nodiscard]] Result<std::optional<storage::SlabRecord>> find_slab(storage::Reader& reader, const std::string& wanted);

/// The valid attempt of a station: its latest one; nullptr when there is none.
[[nodiscard]] const storage::SlabBlock* latest(const storage::SlabRecord& record, int station);

[[nodiscard]] bool is_open(const storage::SlabRecord& record);

struct Shown {
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
};
/// What maps and tables say of a station: the final verdict once the slab has ended, also of a station that was never
/// scanned; the latest attempt's own before.
[[nodiscard]] Shown shown(const storage::SlabRecord& record, int station);

/// The slab's own item of this block that takes the place of `own`, which was judged by the block alone; `own` when
/// there is none: SLAB_END computes slopes anew against the slab's frame, and only those count.
[[nodiscard]] const Item& final_item(const storage::SlabRecord& record, int station, const Item& own);

}  // namespace slabd::cli
