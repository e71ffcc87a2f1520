// SPDX-License-Identifier: Apache-2.0
#include "hal/modbus_codec.h"

#include "hal/plc_map.h"

namespace slabd::hal {
namespace {

// Byte places in a frame: MBAP header, unit id, then the PDU.
constexpr std::size_t kUnitAt = 6;
constexpr std::size_t kFunctionAt = 7;

enum Function : std::uint8_t {
  kReadHolding = 3,
  kReadInput = 4,
  kWriteOne = 6,
  kWriteMany = 16,
  kReadWriteMany = 23,
};

// Quantity limits, specification sections 6.3, 6.4, 6.12 and 6.17: what fits a PDU.
constexpr unsigned kReadQuantityMax = 125;
constexpr unsigned kWriteQuantityMax = 123;
constexpr unsigned kReadWriteQuantityMax = 121;

unsigned word_at(std::span<const std::uint8_t> frame, std::size_t at) {
  return (unsigned{frame[at]} << 8U) | unsigned{frame[at + 1]};
}

struct Registers {
  unsigned first = 0;
  unsigned quantity = 0;
};

bool inside(const Registers& asked, unsigned first, unsigned count) {
  return asked.first >= first && asked.first - first < count && asked.quantity <= count - (asked.first - first);
}

bool readable_holding(const Registers& asked) {
  return inside(asked, 0, kHoldingRegisters) || inside(asked, kMirrorFirst, kInputRegisters);
}
bool writable(const Registers& asked) {
  return inside(asked, 0, kHoldingRegisters);
}

RequestCheck refuse(ModbusException exception) {
  return {exception, false, false};
}

RequestCheck written(const Registers& asked) {
  return {std::nullopt, true, asked.first + asked.quantity > kCommandFirst};
}

/// FC 3 and 4: function, address, quantity.
RequestCheck check_read(std::span<const std::uint8_t> frame) {
  if (frame.size() != kFunctionAt + 5) return refuse(ModbusException::illegal_value);
  const Registers asked{word_at(frame, kFunctionAt + 1), word_at(frame, kFunctionAt + 3)};
  if (asked.quantity < 1 || asked.quantity > kReadQuantityMax) return refuse(ModbusException::illegal_value);
  const bool known = frame[kFunctionAt] == kReadInput ? inside(asked, 0, kInputRegisters) : readable_holding(asked);
  return known ? RequestCheck{} : refuse(ModbusException::illegal_address);
}

/// FC 6: function, address, value.
RequestCheck check_write_one(std::span<const std::uint8_t> frame) {
  if (frame.size() != kFunctionAt + 5) return refuse(ModbusException::illegal_value);
  const Registers asked{word_at(frame, kFunctionAt + 1), 1};
  return writable(asked) ? written(asked) : refuse(ModbusException::illegal_address);
}

/// FC 16: function, address, quantity, byte count, values.
RequestCheck check_write_many(std::span<const std::uint8_t> frame) {
  constexpr std::size_t kHeadBytes = 6;
  if (frame.size() < kFunctionAt + kHeadBytes) return refuse(ModbusException::illegal_value);
  const Registers asked{word_at(frame, kFunctionAt + 1), word_at(frame, kFunctionAt + 3)};
  const unsigned bytes = frame[kFunctionAt + 5];
  if (asked.quantity < 1 || asked.quantity > kWriteQuantityMax || bytes != 2 * asked.quantity ||
      frame.size() != kFunctionAt + kHeadBytes + bytes)
    return refuse(ModbusException::illegal_value);
  return writable(asked) ? written(asked) : refuse(ModbusException::illegal_address);
}

/// FC 23: function, read address, read quantity, write address, write quantity, byte count, values.
RequestCheck check_read_write(std::span<const std::uint8_t> frame) {
  constexpr std::size_t kHeadBytes = 10;
  if (frame.size() < kFunctionAt + kHeadBytes) return refuse(ModbusException::illegal_value);
  const Registers read{word_at(frame, kFunctionAt + 1), word_at(frame, kFunctionAt + 3)};
  const Registers write{word_at(frame, kFunctionAt + 5), word_at(frame, kFunctionAt + 7)};
  const unsigned bytes = frame[kFunctionAt + 9];
  if (read.quantity < 1 || read.quantity > kReadQuantityMax || write.quantity < 1 ||
      write.quantity > kReadWriteQuantityMax || bytes != 2 * write.quantity ||
      frame.size() != kFunctionAt + kHeadBytes + bytes)
    return refuse(ModbusException::illegal_value);
  if (!readable_holding(read) || !writable(write)) return refuse(ModbusException::illegal_address);
  return written(write);
}

}  // namespace

std::optional<std::size_t> frame_bytes(std::span<const std::uint8_t, kMbapLengthEnd> header) {
  const unsigned protocol = word_at(header, 2);
  const unsigned length = word_at(header, 4);
  if (protocol != 0 || length < kMbapLengthMin || length > kMbapLengthMax) return std::nullopt;
  return kMbapLengthEnd + length;
}

RequestCheck check_request(std::span<const std::uint8_t> frame, std::uint8_t unit_id) {
  const std::uint8_t unit = frame[kUnitAt];
  if (unit != unit_id && unit != 0 && unit != 255) return refuse(ModbusException::gateway_no_response);
  switch (frame[kFunctionAt]) {
    case kReadHolding:
    case kReadInput: return check_read(frame);
    case kWriteOne: return check_write_one(frame);
    case kWriteMany: return check_write_many(frame);
    case kReadWriteMany: return check_read_write(frame);
    default: return refuse(ModbusException::illegal_function);
  }
}

std::array<std::uint8_t, kExceptionFrameBytes> exception_reply(std::span<const std::uint8_t> frame,
                                                               ModbusException exception) {
  constexpr std::uint8_t kLength = 3;  // unit, function, exception
  constexpr unsigned kExceptionBit = 0x80;
  return {frame[0],
          frame[1],
          0,
          0,
          0,
          kLength,
          frame[kUnitAt],
          static_cast<std::uint8_t>(frame[kFunctionAt] | kExceptionBit),
          static_cast<std::uint8_t>(exception)};
}

}  // namespace slabd::hal
