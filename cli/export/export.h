// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::args {
class Command;
}  // namespace slabd::args

namespace slabd::cli {

/// `slabctl export`, as the commands of cli/command.h.
void add_export(args::Command& app);

}  // namespace slabd::cli
