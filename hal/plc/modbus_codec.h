// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "hal/plc/plc_map.h"

/// Checks and answers Modbus requests without libmodbus. The server half of libmodbus 3.1.6 ignores the length and
/// protocol id of a request. It answers an illegal request by sleeping for half a second and discarding other waiting
/// requests. Sections are those of "MODBUS Application Protocol Specification V1.1b3", "MODBUS Messaging on TCP/IP
/// V1.0b" and "MODBUS over Serial Line V1.02".
namespace slabd::hal {

/// The longest PDU: a function code and 252 bytes.
inline constexpr std::size_t kPduBytesMax = 253;

/// Exception codes, specification section 7.
enum class ModbusException : std::uint8_t {
  illegal_function = 1,
  illegal_address = 2,
  illegal_value = 3,  ///< a quantity or length out of range
  device_failure = 4,
  gateway_no_response = 11,  ///< the unit does not exist behind this address
};

struct RequestCheck {
  std::optional<ModbusException> refusal;  ///< empty: `answer_pdu` answers the request
  bool writes = false;                     ///< changes holding registers
  bool writes_command = false;             ///< ... including some of HR 10..39
};

/// Checks a PDU (function code and data, at least one byte). Allowed are FC 3 on HR 0..74 and HR 1000..1109, FC 4 on IR
/// 0..109, and FC 6, 16 and 23 (its write half) on HR 0..74.
[[nodiscard]] RequestCheck check_pdu(std::span<const std::uint8_t> pdu);

/// The two register memories. A reply is built from one bank at one moment, so no value is torn.
struct RegisterBank {
  HoldingImage holding{};
  InputImage input{};
};

/// Executes a PDU that `check_pdu` accepted: changes `bank` if it writes (before it reads, as in section 6.17), fills
/// `reply` and returns its length.
[[nodiscard]] std::size_t answer_pdu(std::span<const std::uint8_t> pdu, RegisterBank& bank,
                                     std::span<std::uint8_t, kPduBytesMax> reply);
/// Exception reply to `function`.
inline constexpr std::size_t kExceptionPduBytes = 2;
[[nodiscard]] std::array<std::uint8_t, kExceptionPduBytes> exception_pdu(std::uint8_t function,
                                                                         ModbusException exception);

// ---- TCP ---------------------------------------------------------------------------------------------------------

/// Bytes up to and including the length field of the MBAP header; the length counts the bytes that follow.
inline constexpr std::size_t kMbapLengthEnd = 6;
/// The whole header: the length field and the unit id.
inline constexpr std::size_t kMbapBytes = 7;
/// Unit id and one function code; unit id and the longest PDU.
inline constexpr std::size_t kMbapLengthMin = 2;
inline constexpr std::size_t kMbapLengthMax = 1 + kPduBytesMax;

/// Length of the whole frame from its first kMbapLengthEnd bytes. nullopt if the protocol id is not 0 or the length is
/// outside 2..254: frame synchronisation is lost and the stream must be closed.
[[nodiscard]] std::optional<std::size_t> frame_bytes(std::span<const std::uint8_t, kMbapLengthEnd> header);

/// Checks a whole frame (of length `frame_bytes`): its unit id must be `unit_id`, 0 or 255, and its PDU allowed.
[[nodiscard]] RequestCheck check_request(std::span<const std::uint8_t> frame, std::uint8_t unit_id);

// ---- serial line -------------------------------------------------------------------------------------------------

/// Address, PDU, CRC; serial line specification, section 2.5.1.
inline constexpr std::size_t kRtuBytesMax = 1 + kPduBytesMax + 2;
inline constexpr std::size_t kRtuBytesMin = 4;
inline constexpr std::size_t kRtuCrcBytes = 2;

/// CRC-16/Modbus; its low byte is sent first.
[[nodiscard]] std::uint16_t crc16_of_bytes(std::span<const std::uint8_t> bytes);

/// Length of a request from its first bytes (the address and following). 0 if more bytes are needed, and for functions
/// that slabd does not serve.
[[nodiscard]] std::size_t rtu_request_bytes(std::span<const std::uint8_t> begin);
/// True if the frame is long enough and its last two bytes are the CRC of the preceding ones.
[[nodiscard]] bool rtu_intact(std::span<const std::uint8_t> frame);
/// Appends the CRC to `frame[0..bytes)`; returns the new length.
[[nodiscard]] std::size_t rtu_close(std::span<std::uint8_t, kRtuBytesMax> frame, std::size_t bytes);

}  // namespace slabd::hal
