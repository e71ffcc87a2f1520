// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/base.h"
#include "hal/hal.h"

/// Format of LCM's short message, as liblcm sends it (lcm/udpm_util.h):
///
///   bytes 0..3   magic "LC02", big-endian 0x4c433032
///   bytes 4..7   sequence number of the sending process, not used
///   then         channel, NUL-terminated, at most 63 characters
///   then         the encoded message: 8 bytes fingerprint, the members, all big-endian
///
/// `decode_pose_datagram` is declared in hal/hal.h.
namespace slabd::hal {

inline constexpr std::uint32_t kLc02ShortMagic = 0x4C433032;
inline constexpr std::size_t kLc02HeaderBytes = 8;
/// First datagram of a message that does not fit into one datagram: 20 bytes, then channel and payload as above.
inline constexpr std::uint32_t kLc03FragmentMagic = 0x4C433033;
inline constexpr std::size_t kLc03HeaderBytes = 20;
inline constexpr std::size_t kLcmChannelMax = 63;
/// Fingerprint and members of slabd.flange_pose_t.
inline constexpr std::size_t kPosePayloadBytes = 92;
/// Fingerprint and members of bot_core.rigid_transform_t.
inline constexpr std::size_t kRigidTransformPayloadBytes = 72;
static_assert(kLc02HeaderBytes + kLcmChannelMax + 1 + kPosePayloadBytes < limits::kLcmDatagramMax,
              "a pose on the longest channel must fit the receive buffer, or it would arrive cut");

/// Description of a message on the configured channel that is not of the configured type.
using OtherTypeText = FixedString<192>;
/// "a message of type bot_core.rigid_transform_t on FLANGE_POSE, where [pose] type = ..."; empty for another channel,
/// another protocol, or a message of the right type and length.
[[nodiscard]] OtherTypeText other_type_on(std::span<const std::byte> datagram, std::string_view channel, PoseType type);

/// Suffix of the channel of a bridge's messages about why it has no poses; it follows the pose channel's name. The
/// payload is the text.
inline constexpr std::string_view kBridgeWordSuffix = "_WORD";
/// "the bridge reports: no packets ..."; empty for a datagram of any other channel. Non-printable characters (except
/// UTF-8) become question marks.
[[nodiscard]] OtherTypeText bridge_word_on(std::span<const std::byte> datagram, std::string_view channel);

/// Deviation of a quaternion from unit length above which it is a fault of the sender, not rounding.
inline constexpr double kQuaternionNormTolerance = 1e-3;
/// Upper limit of the reach of this line's robots from their root.
inline constexpr double kFlangeReachMaxM = 10.0;

/// LCM's UDP multicast address, `udpm://group:port?ttl=N[&recv_buf_size=N]`.
struct LcmUrl {
  std::uint32_t group = 0;  ///< IPv4, host byte order; 224.0.0.0/4
  std::uint16_t port = 0;
  std::uint8_t ttl = 0;  ///< of senders; a listener only checks it
  std::uint32_t recv_buf_bytes = 1U << 20U;
};

/// Parses a URL. Unlike liblcm it requires group and port. config: the text names the wrong part and the allowed
/// values.
[[nodiscard]] Result<LcmUrl> parse_lcm_url(std::string_view url);

/// A channel of 1..63 characters without NUL; config otherwise.
[[nodiscard]] Status check_lcm_channel(std::string_view channel);
/// An IPv4 address or a name that an interface may have, whether or not this computer has it; config otherwise.
[[nodiscard]] Status check_lcm_interface(std::string_view interface);

}  // namespace slabd::hal
