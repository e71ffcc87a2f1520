// SPDX-License-Identifier: Apache-2.0
#include "hal/robot/lcm_wire.h"

#include <arpa/inet.h>
#include <net/if.h>
#include <algorithm>
#include <array>
#include <bot_core/rigid_transform_t.hpp>
#include <charconv>
#include <cmath>
#include <cstring>
#include <optional>
#include <slabd/flange_pose_t.hpp>

// Problem: liblcm's receive path allocates on a sender's word and two crafted datagrams kill the process. Idea: a pose
// is one datagram of known length, so compare that length first; every read after it is inside. The members are then
// decoded by the code lcm-gen made, which checks the fingerprint. Invariants: no read beyond the datagram, no heap,
// and `sample` changes only when the whole datagram is good.
namespace slabd::hal {
namespace {

enum Flag : std::uint32_t {
  kMeasured = 1U << 0U,
  kStopped = 1U << 1U,
  kRunning = 1U << 2U,
  kEstop = 1U << 3U,
  kEmulated = 1U << 4U
};

std::uint32_t big_endian_u32(const std::byte* at) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value = (value << 8U) | std::to_integer<std::uint32_t>(at[i]);
  return value;
}

/// The payload of `payload_bytes` on `channel`, or an empty span.
std::span<const std::byte> payload_of(std::span<const std::byte> datagram, std::string_view channel,
                                      std::size_t payload_bytes) {
  const std::size_t payload_at = kLc02HeaderBytes + channel.size() + 1;
  if (channel.size() > kLcmChannelMax || datagram.size() != payload_at + payload_bytes) return {};
  if (big_endian_u32(datagram.data()) != kLc02ShortMagic) return {};
  const std::byte* name = datagram.data() + kLc02HeaderBytes;
  if (std::memcmp(name, channel.data(), channel.size()) != 0 || name[channel.size()] != std::byte{0}) return {};
  return datagram.subspan(payload_at);
}

template <typename Message>
bool decode(std::span<const std::byte> payload, Message& message) {
  return !payload.empty() &&
         message.decode(payload.data(), 0, static_cast<int>(payload.size())) == static_cast<int>(payload.size());
}

/// The members that both types have; counts what is wrong with them.
template <typename Message>
bool take_pose(const Message& message, PoseSample& sample, PoseLinkCounters& counters) {
  double trans2_m2 = 0.0;
  double norm2 = 0.0;
  bool finite = true;
  for (const double t : message.trans) {
    finite = finite && std::isfinite(t);
    trans2_m2 += t * t;
  }
  for (const double q : message.quat) {
    finite = finite && std::isfinite(q);
    norm2 += q * q;
  }
  std::uint64_t* fault = nullptr;
  // Squares of huge numbers are infinite and fail the comparisons as they should.
  if (!finite)
    fault = &counters.not_finite;
  else if (!(std::abs(std::sqrt(norm2) - 1.0) <= kQuaternionNormTolerance))
    fault = &counters.not_unit;
  else if (!(trans2_m2 <= kFlangeReachMaxM * kFlangeReachMaxM))
    fault = &counters.out_of_reach;
  if (fault != nullptr) {
    ++*fault;
    ++counters.malformed;
    return false;
  }
  sample.utime_us = message.utime;
  sample.T_base_flange.translation_mm =
      Vec3(mm_from_m(message.trans[0]), mm_from_m(message.trans[1]), mm_from_m(message.trans[2]));
  sample.T_base_flange.rotation = Quat(message.quat[0], message.quat[1], message.quat[2], message.quat[3]).normalized();
  return true;
}

void take_rest(const flange_pose_t& message, PoseSample& sample) {
  sample.seq = message.seq;
  sample.base_id = message.base_id;
  sample.tool_id = message.tool_id;
  const auto flags = static_cast<std::uint32_t>(message.flags);
  sample.measured = (flags & kMeasured) != 0;
  sample.stopped = (flags & kStopped) != 0;
  sample.running = (flags & kRunning) != 0;
  sample.estop = (flags & kEstop) != 0;
  sample.emulated = (flags & kEmulated) != 0;
  sample.commanded = !sample.measured;
}

constexpr std::size_t kFingerprintBytes = 8;

struct KnownType {
  PoseType type;
  std::uint64_t fingerprint;
  std::size_t bytes;  ///< of the payload
};
std::array<KnownType, 2> known_types() {
  return {{{PoseType::flange_pose, static_cast<std::uint64_t>(flange_pose_t::getHash()), kPosePayloadBytes},
           {PoseType::rigid_transform, static_cast<std::uint64_t>(bot_core::rigid_transform_t::getHash()),
            kRigidTransformPayloadBytes}}};
}

}  // namespace

OtherTypeText other_type_on(std::span<const std::byte> datagram, std::string_view channel, PoseType type) {
  OtherTypeText text;
  if (datagram.size() < kLc02HeaderBytes) return text;
  const std::uint32_t magic = big_endian_u32(datagram.data());
  if (magic != kLc02ShortMagic && magic != kLc03FragmentMagic) return text;
  const std::size_t name_at = magic == kLc02ShortMagic ? kLc02HeaderBytes : kLc03HeaderBytes;
  const std::size_t payload_at = name_at + channel.size() + 1;
  if (datagram.size() < payload_at) return text;
  const std::byte* name = datagram.data() + name_at;
  if (std::memcmp(name, channel.data(), channel.size()) != 0 || name[channel.size()] != std::byte{0}) return text;

  const std::string_view expected = kPoseTypes[static_cast<std::size_t>(type)];
  const int shown = static_cast<int>(channel.size());
  const std::span<const std::byte> payload = datagram.subspan(payload_at);
  if (magic == kLc03FragmentMagic) {
    text.printf("a message in fragments (LC03), which no %s is, on %.*s", expected.data(), shown, channel.data());
    return text;
  }
  if (payload.size() < kFingerprintBytes) {
    text.printf("a message of %zu bytes on %.*s, too short for any type", payload.size(), shown, channel.data());
    return text;
  }
  const std::uint64_t fingerprint =
      std::uint64_t{big_endian_u32(payload.data())} << 32U | big_endian_u32(payload.data() + 4);
  for (const KnownType& known : known_types()) {
    if (known.fingerprint != fingerprint) continue;
    if (known.type == type && payload.size() == known.bytes) return text;
    if (known.type == type)
      text.printf("a message of type %s with %zu bytes instead of %zu on %.*s", expected.data(), payload.size(),
                  known.bytes, shown, channel.data());
    else
      text.printf("a message of type %s ([pose] type is %s) on %.*s",
                  kPoseTypes[static_cast<std::size_t>(known.type)].data(), expected.data(), shown, channel.data());
    return text;
  }
  text.printf("a message of another type than %s (fingerprint 0x%016llx, %zu bytes) on %.*s", expected.data(),
              static_cast<unsigned long long>(fingerprint), payload.size(), shown, channel.data());
  return text;
}

OtherTypeText bridge_word_on(std::span<const std::byte> datagram, std::string_view channel) {
  OtherTypeText text;
  const std::size_t name_bytes = channel.size() + kBridgeWordSuffix.size();
  const std::size_t payload_at = kLc02HeaderBytes + name_bytes + 1;
  if (datagram.size() <= payload_at || big_endian_u32(datagram.data()) != kLc02ShortMagic) return text;
  const std::byte* name = datagram.data() + kLc02HeaderBytes;
  if (std::memcmp(name, channel.data(), channel.size()) != 0 ||
      std::memcmp(name + channel.size(), kBridgeWordSuffix.data(), kBridgeWordSuffix.size()) != 0 ||
      name[name_bytes] != std::byte{0})
    return text;
  std::array<char, OtherTypeText::capacity() + 1> word{};
  const std::span<const std::byte> payload =
      datagram.subspan(payload_at, std::min(datagram.size() - payload_at, word.size() - 1));
  for (std::size_t i = 0; i < payload.size(); ++i) {
    const char c = static_cast<char>(payload[i]);
    word[i] = (c >= 0 && c < ' ') || c == '\x7f' ? '?' : c;
  }
  text.printf("the bridge says: %s;", word.data());
  return text;
}

bool decode_pose_datagram(std::span<const std::byte> datagram, std::string_view channel, PoseSample& sample,
                          PoseLinkCounters& counters, PoseType type) {
  PoseSample fresh;
  fresh.arrival_ns = sample.arrival_ns;
  flange_pose_t flange{};
  bot_core::rigid_transform_t rigid{};
  bool good = false;
  switch (type) {
    case PoseType::flange_pose:
      if (!decode(payload_of(datagram, channel, kPosePayloadBytes), flange)) break;
      if (!take_pose(flange, fresh, counters)) return false;
      take_rest(flange, fresh);
      good = true;
      break;
    case PoseType::rigid_transform:
      if (!decode(payload_of(datagram, channel, kRigidTransformPayloadBytes), rigid)) break;
      if (!take_pose(rigid, fresh, counters)) return false;
      good = true;
      break;
  }
  if (!good) {
    ++counters.foreign;
    return false;
  }
  sample = fresh;
  ++counters.accepted;
  return true;
}

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
