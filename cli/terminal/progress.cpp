// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/progress.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
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
  std::fputs("\r\x1b[K", stream_);  // carriage return, erase to the end of the line
  std::fflush(stream_);
}

std::string time_left(std::size_t done, std::size_t total, double seconds_so_far) {
  if (done == 0 || done >= total) return {};
  const double left_s = seconds_so_far / static_cast<double>(done) * static_cast<double>(total - done);
  if (left_s < 99.5) return fmt::format("about {:.0f} s left", std::max(left_s, 1.0));
  if (left_s < 5'970.0) return fmt::format("about {:.0f} min left", left_s / 60.0);
  return fmt::format("about {:.1f} h left", left_s / 3'600.0);
}

ProgressCount::ProgressCount(std::FILE* stream, std::size_t total)
    : stream_(total > 1 && isatty(fileno(stream)) != 0 ? stream : nullptr), total_(total) {}

ProgressCount::~ProgressCount() {
  erase();
}

void ProgressCount::next(const std::string& what) {
  const std::size_t done = begun_++;
  if (stream_ == nullptr) return;
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  const std::string left = time_left(done, total_, seconds);
  fmt::print(stream_, "\r\x1b[K{} of {}: {}{}{}", begun_, total_, what, left.empty() ? "" : "; ", left);
  std::fflush(stream_);
}

void ProgressCount::erase() {
  if (stream_ == nullptr || begun_ == 0) return;
  std::fputs("\r\x1b[K", stream_);
  std::fflush(stream_);
}

}  // namespace slabd::cli
