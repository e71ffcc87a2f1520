// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/fixed.h"
#include "hal/hal.h"

namespace slabd::hal {

/// Finds a fault that makes all of a PLC's answers useless: wrong transaction numbers, or answers that always come too
/// late. Sends two requests over its own connection, reads all data that arrives and takes up to six times
/// `timeout_ns`. Empty if no such fault was found.
[[nodiscard]] FixedString<160> fault_of_answers(const PlcSettings& settings);

}  // namespace slabd::hal
