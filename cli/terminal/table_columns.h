// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "hal/hal.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

namespace slabd::cli {

/// Adds the option --columns to a command that reads scan files; `text` must outlive the command.
void add_columns(args::Command& command, std::string& text);

/// The columns named by the option's checked text.
[[nodiscard]] hal::TableColumns columns_of(const std::string& text);

}  // namespace slabd::cli
