// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/base.h"

namespace slabd::hal {

/// Makes the open file `fd`, known as `name` in the folder `from_folder`, durable at `path`: syncs it, makes missing
/// folders, moves it there (copies it when `path` is on another file system, or it has other names), syncs the folders.
/// When it returns the file survives a power cut. store_full: the disk is full; journal_write: anything else;
/// frame_incomplete: `name` is no longer the file that `fd` is. What lies at `path` already stays (journal_write).
/// After an error nothing of this scan is left at `path`. No heap.
[[nodiscard]] Status spool_file(int fd, int from_folder, const char* name, const PathText& path);

}  // namespace slabd::hal
