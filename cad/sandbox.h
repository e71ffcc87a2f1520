// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Confinement of the process before it reads a file from outside. slabctl sets the limits of memory, time and file
/// sizes (cli/cad); this adds the system calls that reading a file does not need.
namespace slabd::cad {

/// From now on the process cannot open a network connection, start a program or a process, or open, create, rename or
/// remove a file for writing: these system calls end with EPERM. The open files 0, 1 and 2 stay usable. False if the
/// kernel does not allow filters, as in some containers; then only slabctl's limits apply.
[[nodiscard]] bool confine();

}  // namespace slabd::cad
