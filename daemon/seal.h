// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/result.h"

/// Enforces the memory figures of base/limits.h through the system (`slabd --seal`): no page of the process is ever
/// swapped out or loaded later, and the process cannot grow.
namespace slabd::daemon {

/// Stack of every thread started after use_one_heap(). The deepest stack is that of measuring, including the seat's
/// cells (noise of cells: 484 kB and 442 kB in one call). Builds for debuggers and sanitizers have larger frames; there
/// the stack has the system's default size.
inline constexpr std::size_t kThreadStackBytes = std::size_t{2} << 20U;
/// The main thread's stack grows on demand, which a limit could prevent; so this much of it is touched in advance.
inline constexpr std::size_t kMainStackBytes = std::size_t{1} << 20U;
/// Reserve below the hard limit: two answers on the control socket.
inline constexpr std::uint64_t kReserveBytes = 4'000'000;

/// Call it before the first thread starts. All threads share one heap, which is never returned to the system, and new
/// threads get stacks of kThreadStackBytes. Otherwise the C library reserves 64 MB of addresses for each thread that
/// contends in malloc, at an unpredictable time.
void use_one_heap();

/// Locks all present and future mappings into memory: stacks, code, buffers. internal: the system forbids it, or allows
/// less than the present mappings plus `more_bytes`. Then no memory is locked, and the text contains the required size.
[[nodiscard]] Status lock_memory(std::uint64_t more_bytes);

/// Limits further mappings to `headroom_bytes`. Above them are kReserveBytes: an allocation that fails gets them
/// through std::new_handler, so that work in progress ends well; a C function gets nullptr. Call it once, after every
/// thread has started. It writes to the caller's stack up to its final size.
[[nodiscard]] Status limit_address_space(std::uint64_t headroom_bytes);

/// Restores the limit after the reserve was used. Call it now and then; it has no effect if the limit holds.
void put_the_reserve_back();

/// Restores the reserve. True without a limit, or if memory for one answer on the control socket is available without
/// the reserve. Below 1 ms.
[[nodiscard]] bool has_room_for_an_answer();

/// Number of times the reserve was used.
[[nodiscard]] std::uint64_t reserve_uses();

}  // namespace slabd::daemon
