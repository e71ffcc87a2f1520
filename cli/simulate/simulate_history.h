// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// `slabctl simulate history`: a database with years of emulated slabs, and their planted effects beside it.
namespace slabd::cli::simulate {

void add_simulate_history(args::Command& simulate);

}  // namespace slabd::cli::simulate
