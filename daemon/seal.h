// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "base/result.h"

/// Locks the process into memory (`slabd --seal`): no page is ever swapped out or loaded later. MemoryMax of the
/// service manager limits the memory.
namespace slabd::daemon {

/// Stack of every thread started after use_one_heap(). The deepest stack is that of measuring, including the seat's
/// cells (noise of cells: 484 kB and 442 kB in one call). Builds for debuggers and sanitizers have larger frames; there
/// the stack has the system's default size.
inline constexpr std::size_t kThreadStackBytes = std::size_t{2} << 20U;
/// The main thread's stack grows on demand, and a lock does not load pages above its present end. Therefore this part
/// of it is touched in advance.
inline constexpr std::size_t kMainStackBytes = std::size_t{1} << 20U;

/// Call it before the first thread starts. All threads share one heap, which is never returned to the system, and new
/// threads get stacks of kThreadStackBytes. Otherwise the C library reserves 64 MB of addresses for each thread that
/// contends in malloc, at an unpredictable time.
void use_one_heap();

/// Locks all present and future mappings into memory: stacks, code, buffers. Call it on the main thread after every
/// thread has started. internal: the system forbids it, or allows less than the present mappings and 20 MB for later
/// ones. Then no memory is locked, and the text contains the required size.
[[nodiscard]] Status lock_memory();

}  // namespace slabd::daemon
