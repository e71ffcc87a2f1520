// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/result.h"

/// What base/limits.h says of memory, enforced by the system (`slabd --seal`): nothing of the process is ever swapped
/// out or waits for a page, and it cannot grow.
namespace slabd::daemon {

/// Stack of every thread that is started after use_one_heap(). The deepest is that of measuring, with the seat's cells
/// on it (noise of cells: 484 kB and 442 kB in one call). Builds for debuggers and sanitizers have larger frames; there
/// a stack is as large as the system makes it.
inline constexpr std::size_t kThreadStackBytes = std::size_t{2} << 20U;
/// The main thread's grows on demand, and under a limit it must not have to: so much of it is touched before.
inline constexpr std::size_t kMainStackBytes = std::size_t{1} << 20U;
/// What the system keeps below the hard limit: two answers on the control socket.
inline constexpr std::uint64_t kReserveBytes = 4'000'000;

/// Before the first thread: all threads share one heap, which is never given back (otherwise the C library reserves
/// 64 MB of addresses for each thread that meets another one in malloc, at whatever moment that is), and new threads
/// get stacks of kThreadStackBytes.
void use_one_heap();

/// Locks everything that is mapped now or later into memory: stacks, code, buffers. internal: the system forbids it, or
/// allows less than what is mapped and `more_bytes` beside it; nothing is locked, and the text says how much is needed.
[[nodiscard]] Status lock_memory(std::uint64_t more_bytes);

/// From here on no more than `headroom_bytes` can be mapped beside what is mapped now. Behind them lie kReserveBytes
/// that an allocation which fails gets by std::new_handler, so that what is under way ends well; a C function gets
/// nullptr. Called once, when every thread has started; the caller's stack is written to as far as it may ever grow.
[[nodiscard]] Status limit_address_space(std::uint64_t headroom_bytes);

/// The limit holds again for whatever is asked from here on. To be called now and then; nothing where it holds.
void put_the_reserve_back();

/// Puts the reserve back. True where there is no limit, or memory for one answer on the control socket can be had
/// without it. Below 1 ms.
[[nodiscard]] bool has_room_for_an_answer();

/// How often the reserve had to be taken.
[[nodiscard]] std::uint64_t reserve_uses();

}  // namespace slabd::daemon
