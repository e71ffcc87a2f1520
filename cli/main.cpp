// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <exception>

#include "cli/command.h"
#include "cli/exit.h"

int main(int argc, char** argv) {
  try {
    return slabd::cli::run(argc, argv);
  } catch (const std::exception& fault) {
    slabd::cli::complain(fmt::format("internal error: {}", fault.what()));
  }
  return slabd::cli::kInternal;
}
