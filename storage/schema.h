// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::storage {

/// The text of schema.sql, compiled in.
[[nodiscard]] const char* schema_sql();

}  // namespace slabd::storage
