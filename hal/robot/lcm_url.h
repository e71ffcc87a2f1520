// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "base/base.h"

namespace slabd::hal {

/// LCM's UDP multicast address, `udpm://group:port?ttl=N[&recv_buf_size=N]`.
struct LcmUrl {
  std::uint32_t group = 0;  ///< IPv4, host byte order; 224.0.0.0/4
  std::uint16_t port = 0;
  std::uint8_t ttl = 0;  ///< of senders; a listener only checks it
  std::uint32_t recv_buf_bytes = 1U << 20U;
};

/// Everything must be said: no default group or port, unlike liblcm. config: the text names the part that is wrong
/// and what is allowed.
[[nodiscard]] Result<LcmUrl> parse_lcm_url(std::string_view url);

/// A channel of 1..63 characters without NUL; config otherwise.
[[nodiscard]] Status check_lcm_channel(std::string_view channel);
/// An IPv4 address or a name that an interface may have, whether or not this computer has it; config otherwise.
[[nodiscard]] Status check_lcm_interface(std::string_view interface);

}  // namespace slabd::hal
