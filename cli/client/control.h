// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/result.h"

/// Talking to the running daemon over its control socket: one JSON line each way.
namespace slabd::cli {

/// Sends one line (with its newline) and returns the answer's line. scanner_offline: nobody listens at `path`, or
/// nobody answers within 3 s; the text says what to look at.
[[nodiscard]] Result<std::string> ask_daemon(const std::string& path, std::string_view line);

/// The process that listens at `path`, as the kernel knows it; 0: nobody, or not to be had.
[[nodiscard]] std::int64_t daemon_process(const std::string& path);

/// Does a daemon listen at `path`, and work with its database? In fault 504 it only says so and opens none.
[[nodiscard]] bool daemon_has_database(const std::string& path);

}  // namespace slabd::cli
