// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string_view>

#include "base/base.h"
#include "hal/hal.h"

/// Register map 1.1: the two memories that the PLC and slabd share. Only this file defines their addresses, scales and
/// word order. Addresses are zero-based PDU addresses.
///
///   holding registers 0..74   written by the PLC    (FC 6, 16, 23), read back by FC 3
///   input registers 0..109    written by slabd      (FC 4), mirrored read-only at holding registers 1000..1109
///
/// Each memory is listed once (plc_registers.h), and the list is used to encode and to decode. So the emulated PLC and
/// the tools decode exactly what the daemon encodes. No heap, no I/O; a few hundred nanoseconds each.
namespace slabd::hal {

inline constexpr std::size_t kHoldingRegisters = 75;
/// HR 0..39, all that a PLC without gauges has: as client slabd reads only these then.
inline constexpr std::size_t kHoldingWithoutGauges = 40;
inline constexpr std::size_t kInputRegisters = 110;
/// Holding registers HR 10..39 carry a command; the connection that writes one of them owns the command block.
inline constexpr std::uint16_t kCommandFirst = 10;
inline constexpr std::uint16_t kCommandLast = 39;
/// HR 40..74, the gauges: 16 values, GAUGE_SEQ written last, GAUGE_SLAB_NO. Any connection that may write may write
/// them; the command block does not contain them.
inline constexpr std::uint16_t kGaugeFirst = 40;
inline constexpr std::uint16_t kGaugeSeqAddress = 72;
inline constexpr std::uint16_t kGaugeSlabNoAddress = 73;
static_assert(kGaugeFirst + 2 * limits::kGaugesMax == kGaugeSeqAddress && kGaugeSlabNoAddress + 2 == kHoldingRegisters);
/// HR 39, CMD_SEQ: written last; a change of its value starts the command.
inline constexpr std::uint16_t kCommandSeqAddress = 39;
/// First holding register of the mirrored input registers, for PLCs that cannot read them by FC 4.
inline constexpr std::uint16_t kMirrorFirst = 1000;

inline constexpr std::uint16_t kMapMagic = 0x534C;  ///< IR 0, "SL"
/// Map 1.1. A map 1.x only adds registers where 1.0 has reserved ones, so a PLC of 1.0 works with it.
inline constexpr std::uint16_t kMapVersion = 0x0101;
inline constexpr std::uint32_t kWordProbe = 0x12345678;  ///< IR 2-3, proves the word order at commissioning
/// "No value" of a 16-bit deviation; numbers saturate at +-32767.
inline constexpr std::uint16_t kNoRegisterValue = 0x8000;

using HoldingImage = std::array<std::uint16_t, kHoldingRegisters>;
using InputImage = std::array<std::uint16_t, kInputRegisters>;

// ---- the daemon's directions ------------------------------------------------------------------------------------

/// Encodes the registers that the PLC reads. Every register is written; reserved ones are 0. mm and deg become um and
/// millidegrees, rounded to nearest, saturated at +-32767; NaN becomes 0x8000. RES_SEQ is written at IR 30 and IR 63,
/// CRC-16/Modbus over IR 30..61 at IR 62.
void encode_outputs(const PlcOutputs& outputs, WordOrder order, InputImage& image);

/// Decodes what the PLC has written. Blanks and NULs around SLAB_ID are removed; `command_writer` is left 0 for the
/// server to fill in. Any memory content decodes; the station checks the ranges. `crc_ok` is true if CMD_CRC is 0 or
/// matches HR 10..36, `chips_agree` if SECOND_CHIP is 0 or matches HR 16..31 as written.
[[nodiscard]] PlcInputs decode_inputs(const HoldingImage& image, WordOrder order);

// ---- the other side's directions (emulated PLC, tools) ----------------------------------------------------------

/// Encodes what a PLC writes to slabd. CMD_CRC is computed if `with_crc` is true, else 0 (not used).
void encode_inputs(const PlcInputs& inputs, WordOrder order, bool with_crc, HoldingImage& image);

/// SECOND_CHIP (HR 35) of a PLC that read this id in the second chip; for one id of 65,536 it is 0, "not read".
[[nodiscard]] std::uint16_t second_chip_of(std::string_view id);

/// Decodes the input registers as a PLC does. config if MAGIC, MAP_VERSION or WORD_PROBE do not match this map and word
/// order, or if a register value is outside the map; the text names the register. Deviations have the resolution of the
/// registers. The record is not checked; call `record_intact` first.
[[nodiscard]] Result<PlcOutputs> decode_outputs(const InputImage& image, WordOrder order);

/// True if IR 30..63 hold a complete record: RES_SEQ is not 0 and equals its copy, and the CRC is right. A PLC that
/// reads the registers in pieces must check this; all-zero memory is not a complete record.
[[nodiscard]] bool record_intact(const InputImage& image);

// ---- as text (documentation, tools) --------------------------------------------------------------------------------

using RegisterText = FixedString<320>;  ///< sixteen names of items

/// A row of the register table. Texts are valid during the call of the sink only.
struct RegisterRow {
  enum class Memory : std::uint8_t { holding, input } memory = Memory::holding;
  std::uint16_t address = 0;
  std::size_t count = 1;                    ///< registers
  int bit = -1;                             ///< of a single bit, else -1
  int series = 0;                           ///< 1, 2, ... in the station table and in the gauges' values, else 0
  int series_rows = 0;                      ///< how many there are, two registers apart
  std::string_view type;                    ///< "u16", "i16 / 1000", ...; "" = reserved
  std::string_view name;                    ///< "PLC_HEARTBEAT"; IR 42..55: the item for the record's kind
  std::string_view unit;                    ///< of the value, "" = a number
  std::string_view meaning;                 ///< one sentence
  std::string_view since;                   ///< version of the map
  std::span<const std::string_view> words;  ///< meanings of 0, 1, ...
  std::string_view slab_name;               ///< IR 42..55: the item if the record describes a slab
  std::string_view slab_unit;
};
using RegisterSink = std::function<void(const RegisterRow& row, std::string_view value)>;

/// Every register in order of address, with its value as text. Any value is accepted: a value outside the map is shown
/// as unknown, a wrong constant as wrong.
void list_inputs(const HoldingImage& image, WordOrder order, const RegisterSink& sink);
void list_outputs(const InputImage& image, WordOrder order, const RegisterSink& sink);

/// CRC-16/Modbus (reflected 0x8005) of one byte.
[[nodiscard]] constexpr std::array<std::uint16_t, 256> crc16_table() {
  std::array<std::uint16_t, 256> table{};
  for (unsigned i = 0; i < table.size(); ++i) {
    unsigned c = i;
    for (int bit = 0; bit < 8; ++bit) c = (c & 1U) != 0 ? (c >> 1U) ^ 0xA001U : c >> 1U;
    table[i] = static_cast<std::uint16_t>(c);
  }
  return table;
}
inline constexpr std::array<std::uint16_t, 256> kCrc16OfByte = crc16_table();
/// Adds one byte to a CRC-16/Modbus, which starts with 0xFFFF.
[[nodiscard]] constexpr unsigned crc16_step(unsigned crc, unsigned byte) {
  return (crc >> 8U) ^ kCrc16OfByte[(crc ^ byte) & 0xFFU];
}
/// CRC-16/Modbus over registers in wire order, high byte first.
[[nodiscard]] std::uint16_t crc16_modbus(std::span<const std::uint16_t> registers);

}  // namespace slabd::hal
