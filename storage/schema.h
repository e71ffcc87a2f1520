// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::storage {

/// The text of schema.sql, compiled in.
[[nodiscard]] const char* schema_sql();
/// The text of upgrade_<from>_to_<from + 1>.sql, 1 <= from < kSchemaVersion.
[[nodiscard]] const char* upgrade_sql(int from);

}  // namespace slabd::storage
