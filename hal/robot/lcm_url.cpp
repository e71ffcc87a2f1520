// SPDX-License-Identifier: Apache-2.0
#include "hal/robot/lcm_url.h"

#include <arpa/inet.h>
#include <net/if.h>

#include <charconv>
#include <optional>

#include "hal/robot/lc02_reader.h"

namespace slabd::hal {
namespace {

constexpr std::uint32_t kReceiveBufferMax = 64U << 20U;

std::optional<std::uint32_t> number_from(std::string_view text, std::uint32_t low, std::uint32_t high) {
  std::uint32_t value = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failed != std::errc{} || end != text.data() + text.size() || value < low || value > high) return std::nullopt;
  return value;
}

/// Takes the text up to `separator`, or all of it, off the front of `rest`.
std::string_view take_until(std::string_view& rest, char separator) {
  const std::size_t end = rest.find(separator);
  const std::string_view part = rest.substr(0, end);
  rest = end == std::string_view::npos ? std::string_view{} : rest.substr(end + 1);
  return part;
}

Error refuse(std::string_view url, const char* part, std::string_view found, const char* allowed) {
  const FixedString<128> whole(url);
  const FixedString<64> shown(found);
  return error(Code::config, "lcm url \"%s\": %s \"%s\", allowed: %s", whole.c_str(), part, shown.c_str(), allowed);
}

std::optional<std::uint32_t> multicast_group(std::string_view text) {
  const FixedString<INET_ADDRSTRLEN> terminated(text);
  in_addr address{};
  if (text.size() >= INET_ADDRSTRLEN || inet_pton(AF_INET, terminated.c_str(), &address) != 1) return std::nullopt;
  const std::uint32_t group = ntohl(address.s_addr);
  constexpr std::uint32_t kMulticastPrefix = 0xE;
  if (group >> 28U != kMulticastPrefix) return std::nullopt;
  return group;
}

}  // namespace

Result<LcmUrl> parse_lcm_url(std::string_view url) {
  constexpr std::string_view kScheme = "udpm://";
  if (url.substr(0, kScheme.size()) != kScheme)
    return refuse(url, "provider", url.substr(0, url.find(':')), "udpm://group:port?ttl=N");
  std::string_view options = url.substr(kScheme.size());
  std::string_view endpoint = take_until(options, '?');
  const std::string_view group_text = take_until(endpoint, ':');

  LcmUrl parsed;
  const auto group = multicast_group(group_text);
  if (!group) return refuse(url, "group", group_text, "an IPv4 multicast address, 224.0.0.0 to 239.255.255.255");
  parsed.group = *group;
  const auto port = number_from(endpoint, 1, 65535);
  if (!port) return refuse(url, "port", endpoint, "1 to 65535");
  parsed.port = static_cast<std::uint16_t>(*port);

  bool ttl_seen = false;
  while (!options.empty()) {
    std::string_view value = take_until(options, '&');
    const std::string_view key = take_until(value, '=');
    if (key == "ttl") {
      const auto ttl = number_from(value, 0, 255);
      if (!ttl) return refuse(url, "ttl", value, "0 (this computer), 1 (this network) to 255");
      parsed.ttl = static_cast<std::uint8_t>(*ttl);
      ttl_seen = true;
    } else if (key == "recv_buf_size") {
      const auto bytes = number_from(value, 4096, kReceiveBufferMax);
      if (!bytes) return refuse(url, "recv_buf_size", value, "4096 to 67108864 bytes");
      parsed.recv_buf_bytes = *bytes;
    } else {
      return refuse(url, "option", key, "ttl, recv_buf_size");
    }
  }
  if (!ttl_seen) return refuse(url, "options lack", "ttl", "?ttl=0 (this computer), ?ttl=1 (this network) to ?ttl=255");
  return parsed;
}

Status check_lcm_channel(std::string_view channel) {
  if (channel.empty() || channel.size() > kLcmChannelMax || channel.find('\0') != std::string_view::npos)
    return error(Code::config, "lcm channel is empty, too long or holds a NUL, allowed 1..%zu characters",
                 kLcmChannelMax);
  return success();
}

Status check_lcm_interface(std::string_view interface) {
  const FixedString<INET_ADDRSTRLEN> terminated(interface);
  in_addr address{};
  if (interface.size() < INET_ADDRSTRLEN && inet_pton(AF_INET, terminated.c_str(), &address) == 1) return success();
  if (interface.size() < IF_NAMESIZE && interface.find_first_of("/ \t\n") == std::string_view::npos) return success();
  const FixedString<64> shown(interface);
  return error(Code::config, "lcm interface \"%s\" is neither an IPv4 address nor an interface name (1..%d characters)",
               shown.c_str(), IF_NAMESIZE - 1);
}

}  // namespace slabd::hal
