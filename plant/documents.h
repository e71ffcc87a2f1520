// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "storage/outbox.h"
#include "storage/storage.h"

/// Documents for the plant's database, made from the line's database when they are sent. Their form may change with the
/// software; the checksum of the row does not.
namespace slabd::plant {

/// The document of a row: slabd.plant_slab/1, plant_decisions/1 or plant_record/1. A plant_record/1 without content
/// takes the place of a slab that is no longer stored, or whose end was taken back since. Errors as Reader::slab().
[[nodiscard]] Result<std::string> document_of(const storage::OutboxRow& row, storage::Reader& reader,
                                              storage::Outbox& outbox);

/// The document of an ended slab. `slab_epoch`: in which it was first sent.
[[nodiscard]] std::string slab_document(const storage::SlabRecord& slab, const std::string& slab_epoch);

}  // namespace slabd::plant
