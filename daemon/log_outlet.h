// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

/// Writes lines to stderr on its own thread, from a fixed queue. A write blocks if stderr is a full pipe, a stopped
/// terminal or a file on a disk that hangs. Then the loop, Modbus and heartbeat would stop too. Lines that do not fit
/// are dropped and counted.
namespace slabd::daemon {

/// After this call put_log() never waits. Call it once, before other threads are busy.
void start_log_outlet();
/// Writes one line with its line end, from any thread. Before start_log_outlet() it is written at once.
void put_log(std::string_view line);
/// Waits until everything is written, at most `wait_ms`. False: stderr is not read.
bool flush_log(int wait_ms);
/// Lines lost since the start, including those that the journal did not accept.
[[nodiscard]] std::uint64_t log_lines_lost();
void count_lost_lines(std::uint64_t lines);

}  // namespace slabd::daemon
