// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// Ports for tests. The kernel may assign a closed port to another process, but a restarted daemon needs the same port
/// again. Several suites run simultaneously on one computer.
namespace slabd::places {

/// A port number reserved for this process until it ends, as TCP and as UDP port. No process listens on it now, no
/// other test of any clone gets it, and the kernel does not assign it. For multicast a separate port for each line is
/// sufficient, whatever its group. Holds one descriptor.
[[nodiscard]] std::uint16_t own_port();

}  // namespace slabd::places
