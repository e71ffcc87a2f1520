// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

/// Lines for stderr. Where stderr is a pipe that is full, a terminal that is stopped or a file on a disk that hangs, a
/// write waits, and the loop would wait with it: Modbus and heartbeat would stop. So a thread of its own writes, from a
/// fixed queue. What does not fit is dropped and counted.
namespace slabd::daemon {

/// From here on put_log() never waits. Once, before other threads are busy.
void start_log_outlet();
/// One line with its line end, from any thread. Before start_log_outlet() it is written at once.
void put_log(std::string_view line);
/// Waits until everything is written, at most so long. False: stderr is not read.
bool flush_log(int wait_ms);
/// Lines lost since the start, also those that the journal did not take.
[[nodiscard]] std::uint64_t log_lines_lost();
void count_lost_lines(std::uint64_t lines);

}  // namespace slabd::daemon
