// SPDX-License-Identifier: Apache-2.0
#include "hal/plc/modbus_codec.h"

#include <algorithm>

namespace slabd::hal {
namespace {

// Byte positions: of the unit id in a TCP frame, and of the PDU in a serial frame.
constexpr std::size_t kUnitAt = 6;
constexpr std::size_t kRtuPduAt = 1;

enum Function : std::uint8_t {
  kReadHolding = 3,
  kReadInput = 4,
  kWriteOne = 6,
  kWriteMany = 16,
  kReadWriteMany = 23,
};

// Largest quantities that fit a PDU, specification sections 6.3, 6.4, 6.12 and 6.17.
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
  const bool of_command = asked.first <= kCommandLast && asked.first + asked.quantity > kCommandFirst;
  return {std::nullopt, true, of_command};
}

/// FC 3 and 4: function, address, quantity.
RequestCheck check_read(std::span<const std::uint8_t> pdu) {
  if (pdu.size() != 5) return refuse(ModbusException::illegal_value);
  const Registers asked{word_at(pdu, 1), word_at(pdu, 3)};
  if (asked.quantity < 1 || asked.quantity > kReadQuantityMax) return refuse(ModbusException::illegal_value);
  const bool known = pdu[0] == kReadInput ? inside(asked, 0, kInputRegisters) : readable_holding(asked);
  return known ? RequestCheck{} : refuse(ModbusException::illegal_address);
}

/// FC 6: function, address, value.
RequestCheck check_write_one(std::span<const std::uint8_t> pdu) {
  if (pdu.size() != 5) return refuse(ModbusException::illegal_value);
  const Registers asked{word_at(pdu, 1), 1};
  return writable(asked) ? written(asked) : refuse(ModbusException::illegal_address);
}

/// FC 16: function, address, quantity, byte count, values.
RequestCheck check_write_many(std::span<const std::uint8_t> pdu) {
  constexpr std::size_t kHeadBytes = 6;
  if (pdu.size() < kHeadBytes) return refuse(ModbusException::illegal_value);
  const Registers asked{word_at(pdu, 1), word_at(pdu, 3)};
  const unsigned bytes = pdu[5];
  if (asked.quantity < 1 || asked.quantity > kWriteQuantityMax || bytes != 2 * asked.quantity ||
      pdu.size() != kHeadBytes + bytes)
    return refuse(ModbusException::illegal_value);
  return writable(asked) ? written(asked) : refuse(ModbusException::illegal_address);
}

/// FC 23: function, read address, read quantity, write address, write quantity, byte count, values.
RequestCheck check_read_write(std::span<const std::uint8_t> pdu) {
  constexpr std::size_t kHeadBytes = 10;
  if (pdu.size() < kHeadBytes) return refuse(ModbusException::illegal_value);
  const Registers read{word_at(pdu, 1), word_at(pdu, 3)};
  const Registers write{word_at(pdu, 5), word_at(pdu, 7)};
  const unsigned bytes = pdu[9];
  if (read.quantity < 1 || read.quantity > kReadQuantityMax || write.quantity < 1 ||
      write.quantity > kReadWriteQuantityMax || bytes != 2 * write.quantity || pdu.size() != kHeadBytes + bytes)
    return refuse(ModbusException::illegal_value);
  if (!readable_holding(read) || !writable(write)) return refuse(ModbusException::illegal_address);
  return written(write);
}

/// The registers from `first` on in the memory that holds them; check_pdu has checked that all of them exist.
const std::uint16_t* holding_at(const RegisterBank& bank, unsigned first) {
  return first >= kMirrorFirst ? &bank.input[first - kMirrorFirst] : &bank.holding[first];
}

std::size_t put_registers(const std::uint16_t* from, unsigned quantity, std::uint8_t function,
                          std::span<std::uint8_t, kPduBytesMax> reply) {
  reply[0] = function;
  reply[1] = static_cast<std::uint8_t>(2 * quantity);
  for (std::size_t i = 0; i < quantity; ++i) {
    reply[2 + 2 * i] = static_cast<std::uint8_t>(from[i] >> 8U);
    reply[3 + 2 * i] = static_cast<std::uint8_t>(from[i] & 0xFFU);
  }
  return 2 + 2 * quantity;
}

void write_registers(std::span<const std::uint8_t> values, unsigned first, RegisterBank& bank) {
  for (std::size_t i = 0; i < values.size() / 2; ++i)
    bank.holding[first + i] = static_cast<std::uint16_t>(word_at(values, 2 * i));
}

}  // namespace

RequestCheck check_pdu(std::span<const std::uint8_t> pdu) {
  switch (pdu[0]) {
    case kReadHolding:
    case kReadInput: return check_read(pdu);
    case kWriteOne: return check_write_one(pdu);
    case kWriteMany: return check_write_many(pdu);
    case kReadWriteMany: return check_read_write(pdu);
    default: return refuse(ModbusException::illegal_function);
  }
}

std::size_t answer_pdu(std::span<const std::uint8_t> pdu, RegisterBank& bank,
                       std::span<std::uint8_t, kPduBytesMax> reply) {
  const unsigned first = word_at(pdu, 1);
  const unsigned second = word_at(pdu, 3);  // a quantity, or the value of FC 6
  switch (pdu[0]) {
    case kReadHolding: return put_registers(holding_at(bank, first), second, kReadHolding, reply);
    case kReadInput: return put_registers(&bank.input[first], second, kReadInput, reply);
    case kReadWriteMany:
      write_registers(pdu.subspan(10), word_at(pdu, 5), bank);
      return put_registers(holding_at(bank, first), second, kReadWriteMany, reply);
    case kWriteOne: bank.holding[first] = static_cast<std::uint16_t>(second); break;
    default: write_registers(pdu.subspan(6), first, bank); break;
  }
  std::copy_n(pdu.begin(), 5, reply.begin());  // both writes answer with function, address and value or quantity
  return 5;
}

std::array<std::uint8_t, kExceptionPduBytes> exception_pdu(std::uint8_t function, ModbusException exception) {
  constexpr unsigned kExceptionBit = 0x80;
  return {static_cast<std::uint8_t>(function | kExceptionBit), static_cast<std::uint8_t>(exception)};
}

std::optional<std::size_t> frame_bytes(std::span<const std::uint8_t, kMbapLengthEnd> header) {
  const unsigned protocol = word_at(header, 2);
  const unsigned length = word_at(header, 4);
  if (protocol != 0 || length < kMbapLengthMin || length > kMbapLengthMax) return std::nullopt;
  return kMbapLengthEnd + length;
}

RequestCheck check_request(std::span<const std::uint8_t> frame, std::uint8_t unit_id) {
  const std::uint8_t unit = frame[kUnitAt];
  if (unit != unit_id && unit != 0 && unit != 255) return refuse(ModbusException::gateway_no_response);
  return check_pdu(frame.subspan(kMbapBytes));
}

std::uint16_t crc16_of_bytes(std::span<const std::uint8_t> bytes) {
  unsigned crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) crc = crc16_step(crc, byte);
  return static_cast<std::uint16_t>(crc);
}

std::size_t rtu_request_bytes(std::span<const std::uint8_t> begin) {
  constexpr std::size_t kAround = kRtuPduAt + kRtuCrcBytes;
  if (begin.size() <= kRtuPduAt) return 0;
  const auto with_values = [&](std::size_t head) -> std::size_t {
    return begin.size() < kRtuPduAt + head ? 0 : kAround + head + begin[kRtuPduAt + head - 1];
  };
  switch (begin[kRtuPduAt]) {
    case kReadHolding:
    case kReadInput:
    case kWriteOne: return kAround + 5;
    case kWriteMany: return with_values(6);
    case kReadWriteMany: return with_values(10);
    default: return 0;
  }
}

bool rtu_intact(std::span<const std::uint8_t> frame) {
  if (frame.size() < kRtuBytesMin) return false;
  const std::uint16_t crc = crc16_of_bytes(frame.first(frame.size() - kRtuCrcBytes));
  return frame[frame.size() - 2] == (crc & 0xFFU) && frame[frame.size() - 1] == crc >> 8U;
}

std::size_t rtu_close(std::span<std::uint8_t, kRtuBytesMax> frame, std::size_t bytes) {
  const std::uint16_t crc = crc16_of_bytes(frame.first(bytes));
  frame[bytes] = static_cast<std::uint8_t>(crc & 0xFFU);
  frame[bytes + 1] = static_cast<std::uint8_t>(crc >> 8U);
  return bytes + kRtuCrcBytes;
}

}  // namespace slabd::hal
