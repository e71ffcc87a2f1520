// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "report/words.h"

namespace slabd::cli::watch {

/// Shows the screen on the terminal until q, Ctrl-C or the end of input; the terminal is then as it was before. Asks
/// the daemon at `socket` once a second and reads the database it names. kUsage when stdout is no terminal.
[[nodiscard]] int run(const std::string& socket, report::Language language);

}  // namespace slabd::cli::watch
