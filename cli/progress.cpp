// SPDX-License-Identifier: Apache-2.0
#include "cli/progress.h"

#include <unistd.h>

#include <condition_variable>
#include <mutex>

namespace slabd::cli {

ProgressNote::ProgressNote(std::FILE* stream, std::string text, std::chrono::milliseconds after) : stream_(stream) {
  if (isatty(fileno(stream)) == 0) return;
  thread_ = std::jthread([this, text = std::move(text), after](const std::stop_token& stop) {
    std::mutex mutex;
    std::unique_lock lock(mutex);
    std::condition_variable_any stopped;
    stopped.wait_for(lock, stop, after, [] { return false; });
    if (stop.stop_requested()) return;
    std::fputs(text.c_str(), stream_);
    std::fflush(stream_);
    shown_ = true;
  });
}

ProgressNote::~ProgressNote() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  thread_.join();
  if (!shown_) return;
  std::fputs("\r\x1b[K", stream_);  // to the line's start, erase to its end
  std::fflush(stream_);
}

}  // namespace slabd::cli
