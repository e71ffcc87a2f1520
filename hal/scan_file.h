// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "base/base.h"
#include "hal/hal.h"

/// Reading a scan from a descriptor that is already open, for the drop directory, which must decode, sync and move
/// the very same file.
namespace slabd::hal {

/// As `read_scan`; `name` (with its extension) is only used to choose the format and in error texts. `fd` stays open.
[[nodiscard]] Result<ScanShape> read_scan_fd(int fd, const char* name, LengthUnit unit, std::span<float> xyz);

/// Opens the regular file `name` below the folder `folder` (AT_FDCWD: `name` is a path) for reading, without following
/// a link. frame_incomplete: it is none; the text shows it as `shown`. The caller owns the descriptor.
[[nodiscard]] Result<int> open_scan(int folder, const char* name, const char* shown);

}  // namespace slabd::hal
