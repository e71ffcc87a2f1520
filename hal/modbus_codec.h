// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

/// Judging Modbus/TCP requests before libmodbus sees them. libmodbus 3.1.6 ignores the length and protocol id of a
/// request, and answers an illegal one by sleeping half a second and throwing away what other requests are waiting;
/// so every request it would refuse is refused here, and only requests it will answer at once are handed on.
/// Sections are those of "MODBUS Application Protocol Specification V1.1b3" and "MODBUS Messaging on TCP/IP V1.0b".
namespace slabd::hal {

/// Bytes up to and including the length field of the MBAP header; the length counts what follows.
inline constexpr std::size_t kMbapLengthEnd = 6;
/// Unit id and one function code; unit id and the longest PDU (253 bytes).
inline constexpr std::size_t kMbapLengthMin = 2;
inline constexpr std::size_t kMbapLengthMax = 254;

/// Exception codes, specification section 7.
enum class ModbusException : std::uint8_t {
  illegal_function = 1,
  illegal_address = 2,
  illegal_value = 3,         ///< a quantity or length out of range
  gateway_no_response = 11,  ///< no such unit behind this address
};

/// Length of the whole frame from its first kMbapLengthEnd bytes; nothing when the protocol id is not 0 or the length
/// is outside 2..254: the stream has lost its frames and must be closed.
[[nodiscard]] std::optional<std::size_t> frame_bytes(std::span<const std::uint8_t, kMbapLengthEnd> header);

struct RequestCheck {
  std::optional<ModbusException> refusal;  ///< empty: libmodbus will answer it without an exception
  bool writes = false;                     ///< changes holding registers
  bool writes_command = false;             ///< ... some of HR 10..39
};

/// Judges a whole frame (of the length `frame_bytes` gave). Allowed are: FC 3 on HR 0..39 and HR 1000..1109, FC 4 on
/// IR 0..109, FC 6, 16 and 23 (its write half) on HR 0..39; unit ids `unit_id`, 0 and 255.
[[nodiscard]] RequestCheck check_request(std::span<const std::uint8_t> frame, std::uint8_t unit_id);

inline constexpr std::size_t kExceptionFrameBytes = 9;
/// The exception reply to `frame`: same transaction, same unit, function code with its high bit set.
[[nodiscard]] std::array<std::uint8_t, kExceptionFrameBytes> exception_reply(std::span<const std::uint8_t> frame,
                                                                             ModbusException exception);

}  // namespace slabd::hal
