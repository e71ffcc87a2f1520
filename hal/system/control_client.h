// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

/// Client of the daemon's control socket: one JSON line in each direction. Used by slabctl and slabd-web, which choose
/// the words for a fault.
namespace slabd::hal {

struct ControlAnswer {
  enum class Fault : std::uint8_t {
    none,
    system,        ///< `error_number` contains errno
    not_accepted,  ///< a process listens, but does not accept connections
    silent,        ///< connected, but no answer in time
    closed,        ///< the connection was closed before the end of the line
    too_long,      ///< the answer is longer than limits::kControlLineBytes
  };
  Fault fault = Fault::none;
  int error_number = 0;
  std::string line;  ///< without its newline

  [[nodiscard]] bool ok() const { return fault == Fault::none; }
};

/// Sends `line` (with its newline) to the socket at `path` and returns the answer. Each step waits at most
/// `timeout_ms`.
[[nodiscard]] ControlAnswer ask_control(const std::string& path, std::string_view line, int timeout_ms);

/// Connects to the socket at `path` and disconnects; returns 0 or errno. EAGAIN: a process listens, but does not accept
/// connections. `process` (may be null) receives the listening process as reported by the kernel, 0 if unknown.
[[nodiscard]] int try_control(const std::string& path, int timeout_ms, std::int64_t* process);

}  // namespace slabd::hal
