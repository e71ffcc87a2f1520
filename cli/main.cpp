// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>

#include "cli/command.h"
#include "cli/exit.h"

int main(int argc, char** argv) {
  using namespace slabd::cli;
  try {
    const int status = run(argc, argv);
    // The last output is written here; an error, for example a full disk, must be reported.
    const bool flushed = std::fflush(stdout) == 0;
    if (flushed && std::ferror(stdout) == 0) return status;
    // If an earlier write failed, errno does not contain its reason.
    complain(fmt::format("what was printed could not be written{}",
                         flushed ? std::string() : fmt::format(": {}", std::strerror(errno))));
    return kNotReachable;
  } catch (const std::exception& fault) {
    if (std::ferror(stdout) == 0) {
      complain(fmt::format("internal error: {}", fault.what()));
      return kInternal;
    }
    complain(fmt::format("what was printed could not be written: {}", fault.what()));
  }
  return kNotReachable;
}
