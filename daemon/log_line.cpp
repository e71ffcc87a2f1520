// SPDX-License-Identifier: Apache-2.0
// One line of the log, to the journal with its fields or to stderr.
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>

#include "base/plain_text.h"
#include "daemon/log_outlet.h"
#include "daemon/workers.h"
#include "hal/system/journal.h"

namespace slabd::daemon {
namespace {

std::atomic<std::uint64_t> untold_lines = 0;

/// Reports lost lines once the journal accepts lines again.
void tell_untold() {
  const std::uint64_t lines = untold_lines.exchange(0, std::memory_order_relaxed);
  if (lines == 0) return;
  LogLine line;
  line.level = LogLine::Level::warning;
  line.text.printf("%llu lines are missing here: the journal did not take them",
                   static_cast<unsigned long long>(lines));
  say_line(line);
}

/// Converts the text to one line of valid UTF-8. File names may contain line ends and invalid bytes, which the journal
/// would show as "blob data". A text that was cut may end within a character.
FixedString<limits::kErrorTextBytes> visible(std::string_view text) {
  FixedString<limits::kErrorTextBytes> line;
  while (!text.empty()) {
    const CodePoint c = code_point_at(text);
    const bool control = c.value < 0x20 || (c.value >= 0x7F && c.value < 0xA0);
    line.append(control || !c.is_utf8 ? std::string_view("?") : text.substr(0, c.bytes));
    text.remove_prefix(c.bytes);
  }
  return line;
}

}  // namespace

void say_line(const LogLine& line) {
  // Under a service manager a line is sent to the journal with its fields; on a terminal the level is written as a
  // word.
  static const bool in_journal = hal::stderr_is_journal();
  static const hal::Journal journal;
  hal::Priority priority = hal::Priority::info;
  const char* word = "info";
  switch (line.level) {
    case LogLine::Level::info: break;
    case LogLine::Level::warning:
      priority = hal::Priority::warning;
      word = "warning";
      break;
    case LogLine::Level::error:
      priority = hal::Priority::error;
      word = "error";
      break;
  }
  const FixedString<limits::kErrorTextBytes> said = visible(line.text.view());
  if (in_journal && journal.say(priority, line.code, said.view())) return tell_untold();
  FixedString<16> prefix;
  if (in_journal) {
    prefix.printf("<%u>", static_cast<unsigned>(priority));
  } else {
    prefix.printf("%s: ", word);
  }
  FixedString<640> text;
  if (line.code != 0) {
    text.printf("%sslabd: [%u] %s\n", prefix.c_str(), line.code, said.c_str());
  } else {
    text.printf("%sslabd: %s\n", prefix.c_str(), said.c_str());
  }
  if (!in_journal) return put_log(text.view());
  // The same journal reads stderr. If it does not read, the line is dropped and counted, so that the loop does not
  // block.
  const ssize_t sent = ::send(STDERR_FILENO, text.c_str(), text.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  if (sent >= 0) return;
  untold_lines.fetch_add(1, std::memory_order_relaxed);
  count_lost_lines(1);
}

}  // namespace slabd::daemon
