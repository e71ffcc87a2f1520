// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/fixed.h"
#include "hal/hal.h"

namespace slabd::hal {

/// What a PLC's answers have wrong that makes each of them useless: their transaction numbers, or that all come too
/// late. Asks it twice over a connection of its own, reads whatever comes and takes up to six times `timeout_ns`.
/// Empty: nothing of this kind.
[[nodiscard]] FixedString<160> fault_of_answers(const PlcSettings& settings);

}  // namespace slabd::hal
