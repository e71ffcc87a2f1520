// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/os.h"

/// Runs slabctl as a limited process: its output goes into a file in memory, it runs at the lowest priority, and it
/// ends with its time limit, with slabd-web, or when slabd-web stops.
namespace slabd::web {

/// Largest document; a slab of 18 blocks has 0.4 MB.
inline constexpr std::uint64_t kChildOutputBytesMax = 64'000'000;
/// Address space of one process. A report maps 250 MB, most of it the fonts' files.
inline constexpr std::uint64_t kChildAddressBytesMax = 1'000'000'000;

struct ChildOrder {
  std::string program;
  std::vector<std::string> arguments;    ///< without the program's name
  std::vector<std::string> environment;  ///< "NAME=value"
  double time_s = 5.0;                   ///< processor time and time by the clock, each
  int stop_fd = -1;                      ///< becomes readable when slabd-web stops
};

struct ChildResult {
  enum class End : std::uint8_t {
    exited,       ///< by itself, with `status`
    not_started,  ///< no process or no file in memory; `sentence` contains the reason
    late,         ///< killed at its time limit
    too_large,    ///< killed because its output was longer than kChildOutputBytesMax
    crashed,      ///< ended by a signal
    stopped,      ///< killed because slabd-web stops
  };
  End end = End::not_started;
  int status = 0;  ///< exit status, or the signal of `crashed`
  Fd output;       ///< its stdout
  std::uint64_t bytes = 0;
  std::string sentence;  ///< first line of its stderr, without "slabctl: "
};

/// Runs the program to its end.
[[nodiscard]] ChildResult run_child(const ChildOrder& order);

}  // namespace slabd::web
