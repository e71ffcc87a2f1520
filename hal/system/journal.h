// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "base/fixed.h"
#include "base/os.h"

/// Writes lines to the system's journal with machine-readable fields. The protocol is one datagram of FIELD=value
/// lines, so no library and no heap is needed.
namespace slabd::hal {

/// Severities of syslog.
enum class Priority : std::uint8_t { error = 3, warning = 4, info = 6 };

/// MESSAGE_ID of a code: `journalctl MESSAGE_ID=...` finds every line about it, and systemd/slabd.catalog explains it.
/// 0: lines without a code.
[[nodiscard]] FixedString<32> message_id(std::uint16_t code);

/// True if stderr is connected to the journal ($JOURNAL_STREAM names this stream).
[[nodiscard]] bool stderr_is_journal();

class Journal {
 public:
  /// `socket_path`: the journal's socket. It is opened at the first line.
  explicit Journal(const char* socket_path = "/run/systemd/journal/socket");

  /// Sends PRIORITY, MESSAGE, MESSAGE_ID, SLABD_CODE, SYSLOG_IDENTIFIER. False if the journal did not accept it; use
  /// another output then. Never blocks; callable from any thread.
  [[nodiscard]] bool say(Priority priority, std::uint16_t code, std::string_view message) const;

 private:
  Fd fd_;
  FixedString<107> path_;
};

}  // namespace slabd::hal
