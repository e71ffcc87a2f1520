// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "report/table.h"
#include "storage/storage.h"

/// Stored items as a table (RFC 4180): one row for each item of each slab, columns that only ever grow at the end.
namespace slabd::cli {

/// The first column of every row: which columns there are. A column that changes meaning or place makes the next one.
inline constexpr const char* kItemRowsVersion = "slabd.items/1";

/// The heading, with its line end.
[[nodiscard]] std::string item_heading();
/// Rows of the valid attempt of each block, by station, then of the slab.
[[nodiscard]] std::string item_rows(const storage::SlabRecord& record, TableFor reader);

}  // namespace slabd::cli
