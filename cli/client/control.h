// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/result.h"

/// Client of the running daemon's control socket: one JSON line in each direction.
namespace slabd::cli {

/// Sends one line (with its newline) and returns the answer's line. Code::scanner_offline if the daemon does not
/// listen at `path` or does not answer within 3 s; the text contains the cure.
[[nodiscard]] Result<std::string> ask_daemon(const std::string& path, std::string_view line);

/// Process that listens at `path`, as reported by the kernel; 0 if there is none or it is unknown.
[[nodiscard]] std::int64_t daemon_process(const std::string& path);

/// True if a daemon listens at `path` and works with its database. In fault 504 it does not open the database.
[[nodiscard]] bool daemon_has_database(const std::string& path);

}  // namespace slabd::cli
