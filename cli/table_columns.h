// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "hal/hal.h"

namespace CLI {
class App;
}

namespace slabd::cli {

/// Adds the option --columns to a command that reads scan files; `text` must outlive the command.
void add_columns(CLI::App& command, std::string& text);

/// The columns named by the option's checked text.
[[nodiscard]] hal::TableColumns columns_of(const std::string& text);

}  // namespace slabd::cli
