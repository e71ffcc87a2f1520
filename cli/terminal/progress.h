// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

namespace slabd::cli {

/// A line for somebody who waits at a terminal: appears when the work takes longer than `after`, is erased when the
/// object goes. Elsewhere than on a terminal nothing is written. Destroy it before anything else is said.
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

/// "time left" of work that is a number of like pieces: "" before the first is done.
[[nodiscard]] std::string time_left(std::size_t done, std::size_t total, double seconds_so_far);

/// The same for work of many pieces: which one, of how many, and about how long it will take yet. Says nothing for a
/// single piece, nor elsewhere than on a terminal.
class ProgressCount {
 public:
  ProgressCount(std::FILE* stream, std::size_t total);
  ~ProgressCount();
  ProgressCount(const ProgressCount&) = delete;
  ProgressCount& operator=(const ProgressCount&) = delete;
  /// The next piece begins: "reading a.ply".
  void next(const std::string& what);
  /// Before anything else is written; the next piece shows the line again.
  void erase();

 private:
  std::FILE* stream_;  ///< nullptr: nobody looks
  std::size_t total_;
  std::size_t begun_ = 0;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace slabd::cli
