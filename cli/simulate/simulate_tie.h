// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// `slabctl simulate tie`: the tables from which slabctl calibrate tie solves the place of the second robot's base.
namespace slabd::cli::simulate {

void add_simulate_tie(args::Command& simulate);

}  // namespace slabd::cli::simulate
