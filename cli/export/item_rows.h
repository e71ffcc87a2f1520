// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "storage/storage.h"

/// Stored items as a table (RFC 4180): one row for each item of each slab, columns that only ever grow at the end.
namespace slabd::cli {

/// The first column of every row: which columns there are. A column that changes meaning or place makes the next one.
inline constexpr const char* kItemRowsVersion = "slabd.items/1";

/// The heading, with its line end.
[[nodiscard]] std::string item_heading();
/// Who will open the table. A spreadsheet program takes a text that begins with = + - @ or a control character for a
/// formula and computes it; in a table for one, the default, it gets an apostrophe before it. A program gets the text
/// as it is. Numbers are the same for both.
enum class TableFor : std::uint8_t { program, spreadsheet };
/// Rows of the valid attempt of each block, by station, then of the slab.
[[nodiscard]] std::string item_rows(const storage::SlabRecord& record, TableFor reader);

/// A field as RFC 4180 wants it: in quotes, which are doubled, when it holds a quote, a comma or a line end.
[[nodiscard]] std::string csv_field(std::string_view text);

}  // namespace slabd::cli
