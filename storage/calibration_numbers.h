// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "storage/storage.h"

/// What the numbers of a calibration say about themselves.
namespace slabd::storage {

/// "he", "st", "rb", "mb", "sc": how ids of this kind begin.
[[nodiscard]] std::string_view id_prefix(CalibrationKind kind);

/// What keeps these numbers from being used, as the rest of a sentence; empty: nothing.
[[nodiscard]] std::string nonsense_in(const CalibrationRecord& record);

/// Is `record.id` the id of its numbers?
[[nodiscard]] bool numbers_give_id(const CalibrationRecord& record);

}  // namespace slabd::storage
