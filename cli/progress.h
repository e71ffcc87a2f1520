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

}  // namespace slabd::cli
