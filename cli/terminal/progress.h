// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

namespace slabd::cli {

/// Progress line on a terminal: appears if the work takes longer than `after`, and is erased by the destructor. If the
/// stream is not a terminal, nothing is written. Destroy it before other output.
class ProgressNote {
 public:
  ProgressNote(std::FILE* stream, std::string text, std::chrono::milliseconds after);
  ~ProgressNote();
  ProgressNote(const ProgressNote&) = delete;
  ProgressNote& operator=(const ProgressNote&) = delete;

 private:
  std::FILE* stream_;
  bool shown_ = false;  ///< written by the thread, read after it has been joined
  std::jthread thread_;
};

/// "time left" of work with N equal pieces: "" before the first is done.
[[nodiscard]] std::string time_left(std::size_t done, std::size_t total, double seconds_so_far);

/// Progress of work with several pieces: the current one, their number, and the approximate remaining time. Writes
/// nothing for a single piece, or if the stream is not a terminal.
class ProgressCount {
 public:
  ProgressCount(std::FILE* stream, std::size_t total);
  ~ProgressCount();
  ProgressCount(const ProgressCount&) = delete;
  ProgressCount& operator=(const ProgressCount&) = delete;
  /// Begins the next piece: "reading a.ply".
  void next(const std::string& what);
  /// Call this before other output; the next piece shows the line again.
  void erase();

 private:
  std::FILE* stream_;  ///< nullptr: not a terminal
  std::size_t total_;
  std::size_t begun_ = 0;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace slabd::cli
