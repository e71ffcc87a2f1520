// SPDX-License-Identifier: Apache-2.0
#include "daemon/log_outlet.h"

#include <poll.h>
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <mutex>
#include <thread>

#include "base/fixed.h"

namespace slabd::daemon {
namespace {

using Line = FixedString<768>;
/// More lines than slabd logs while a whole slab is inspected; 50 kB.
constexpr std::size_t kLines = 64;

struct Outlet {
  std::mutex mutex;
  std::condition_variable wake;
  std::condition_variable written;
  FixedQueue<Line, kLines> lines;
  std::uint64_t lost = 0;  ///< since the last line that fitted
  bool writing = false;
};

/// Never destroyed, because the thread may be writing when the process ends.
Outlet& outlet() {
  static auto* const one = new Outlet;
  return *one;
}
std::atomic<bool> g_started{false};
std::atomic<std::uint64_t> g_lost{0};

/// False if the reader has closed stderr.
bool write_all(std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(STDERR_FILENO, text.data(), text.size());
    if (n > 0) {
      text.remove_prefix(static_cast<std::size_t>(n));
      continue;
    }
    if (n < 0 && errno == EINTR) continue;
    if (n >= 0 || errno != EAGAIN) return false;
    pollfd fd{STDERR_FILENO, POLLOUT, 0};
    ::poll(&fd, 1, -1);
  }
  return true;
}

void write_lines() {
  pthread_setname_np(pthread_self(), "slabd-log");
  Outlet& out = outlet();
  Line line;
  std::unique_lock lock(out.mutex);
  for (;;) {
    out.wake.wait(lock, [&out] { return !out.lines.empty(); });
    line = out.lines.front();
    out.lines.pop();
    out.writing = true;
    lock.unlock();
    if (!write_all(line.view())) count_lost_lines(1);
    lock.lock();
    out.writing = false;
    if (out.lines.empty()) out.written.notify_all();
  }
}

}  // namespace

void start_log_outlet() {
  if (g_started.exchange(true)) return;
  (void)outlet();
  std::thread(write_lines).detach();
}

void put_log(std::string_view line) {
  if (!g_started) {
    (void)std::fwrite(line.data(), 1, line.size(), stderr);
    return;
  }
  Outlet& out = outlet();
  const std::lock_guard lock(out.mutex);
  // The second place is reserved for the note about lost lines.
  if (out.lines.size() + 2 > kLines) {
    ++out.lost;
    count_lost_lines(1);
    return;
  }
  if (out.lost != 0) {
    Line note;
    note.printf("warning: slabd: %llu lines are missing here: stderr was not read\n",
                static_cast<unsigned long long>(out.lost));
    out.lost = 0;
    (void)out.lines.push(note);
  }
  Line text{line};
  if (text.size() < line.size()) {
    // A long line is cut and keeps its line end.
    Line cut{line.substr(0, Line::capacity() - 1)};
    cut.append("\n");
    text = cut;
  }
  (void)out.lines.push(text);
  out.wake.notify_one();
}

bool flush_log(int wait_ms) {
  if (!g_started) return true;
  Outlet& out = outlet();
  std::unique_lock lock(out.mutex);
  return out.written.wait_for(lock, std::chrono::milliseconds(wait_ms),
                              [&out] { return out.lines.empty() && !out.writing; });
}

std::uint64_t log_lines_lost() {
  return g_lost;
}
void count_lost_lines(std::uint64_t lines) {
  g_lost += lines;
}

}  // namespace slabd::daemon
