// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "base/base.h"
#include "storage/storage.h"

/// Changing calibrations from outside the process.
namespace slabd::daemon {

/// slabctl leaves a change as a file in this folder, because one control line could not hold a record, and tells the
/// daemon its name.
[[nodiscard]] std::string change_folder(const std::string& db_path);
/// A change as JSON, and back; NaN is null, and every digit comes back. config: what is wrong with the text.
[[nodiscard]] std::string change_json(const storage::CalibrationChange& change);
[[nodiscard]] Result<storage::CalibrationChange> parse_change(std::string_view json);

}  // namespace slabd::daemon
