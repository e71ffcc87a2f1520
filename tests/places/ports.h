// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// Ports of the tests. A port that the kernel chose and that was closed again belongs to whoever asks next, and a
/// daemon that is stopped and started needs its own back; several suites run side by side on one computer.
namespace slabd::places {

/// A number that is this process's alone until it ends, as TCP and as UDP port: nobody listens on it now, and neither
/// another test of any clone nor a socket that leaves the choice to the kernel gets it. For multicast it is enough to
/// give every line a port of its own, whatever its group. Holds one descriptor.
[[nodiscard]] std::uint16_t own_port();

}  // namespace slabd::places
