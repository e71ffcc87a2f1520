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

/// Register map 1.0: the two memories a PLC and slabd share, and the only place that knows their addresses, scales
/// and word order. Addresses are zero-based PDU addresses.
///
///   holding registers 0..39   written by the PLC    (FC 6, 16, 23), read back by FC 3
///   input registers 0..109    written by slabd      (FC 4), mirrored read-only at holding registers 1000..1109
///
/// Each memory is listed once (plc_registers.h) and walked in both directions, so that what the daemon encodes is what
/// the emulated PLC and the tools decode. No heap, no I/O; a few hundred nanoseconds each.
namespace slabd::hal {

inline constexpr std::size_t kHoldingRegisters = 40;
inline constexpr std::size_t kInputRegisters = 110;
/// Holding registers HR 10..39 carry a command; whoever writes one of them owns the command desk.
inline constexpr std::uint16_t kCommandFirst = 10;
inline constexpr std::uint16_t kCommandLast = 39;
/// HR 39, CMD_SEQ: written last, a command runs when it changes.
inline constexpr std::uint16_t kCommandSeqAddress = 39;
/// Where FC 3 finds the input registers, for PLCs that cannot read them by FC 4.
inline constexpr std::uint16_t kMirrorFirst = 1000;

inline constexpr std::uint16_t kMapMagic = 0x534C;  ///< IR 0, "SL"
inline constexpr std::uint16_t kMapVersion = 0x0100;
inline constexpr std::uint32_t kWordProbe = 0x12345678;  ///< IR 2-3, proves the word order at commissioning
/// "No value" of a 16-bit deviation; numbers saturate at +-32767.
inline constexpr std::uint16_t kNoRegisterValue = 0x8000;

using HoldingImage = std::array<std::uint16_t, kHoldingRegisters>;
using InputImage = std::array<std::uint16_t, kInputRegisters>;

// ---- the daemon's directions ------------------------------------------------------------------------------------

/// What the PLC reads. Every register is written; reserved ones are 0. mm and deg become um and millidegrees, rounded
/// to nearest, saturated at +-32767; NaN becomes 0x8000. RES_SEQ is written at IR 30 and IR 63, CRC-16/Modbus over
/// IR 30..61 at IR 62.
void encode_outputs(const PlcOutputs& outputs, WordOrder order, InputImage& image);

/// What the PLC has written, SLAB_ID without blanks and NULs around it; `command_writer` is left 0 for the server to
/// fill in. Every memory decodes: what is
/// out of range is the station's to refuse. `crc_ok` is true when CMD_CRC is 0 or matches HR 10..36.
[[nodiscard]] PlcInputs decode_inputs(const HoldingImage& image, WordOrder order);

// ---- the other side's directions (emulated PLC, tools) ----------------------------------------------------------

/// What a PLC writes to command slabd. CMD_CRC is computed when `with_crc`, else 0 (not used).
void encode_inputs(const PlcInputs& inputs, WordOrder order, bool with_crc, HoldingImage& image);

/// What a PLC understands of the input registers. config when MAGIC, MAP_VERSION or WORD_PROBE are not those of this
/// map and word order, or a register holds a value the map does not know: the text names it. Deviations come back
/// with the resolution of the registers. The record is taken as it is; ask `record_intact` first.
[[nodiscard]] Result<PlcOutputs> decode_outputs(const InputImage& image, WordOrder order);

/// True when IR 30..63 hold a whole record: RES_SEQ not 0 and equal to its copy, CRC right. A PLC that reads the
/// registers in pieces must check this; all-zero memory is never intact.
[[nodiscard]] bool record_intact(const InputImage& image);

// ---- in words (documentation, tools) ------------------------------------------------------------------------------

using RegisterText = FixedString<320>;  ///< sixteen names of items

/// A row of the register table. Texts are valid during the call of the sink only.
struct RegisterRow {
  enum class Memory : std::uint8_t { holding, input } memory = Memory::holding;
  std::uint16_t address = 0;
  std::size_t count = 1;                    ///< registers
  int bit = -1;                             ///< of a single bit, else -1
  int series = 0;                           ///< 1..18 in the station table, else 0
  std::string_view type;                    ///< "u16", "i16 / 1000", ...; "" = reserved
  std::string_view name;                    ///< "PLC_HEARTBEAT"; IR 42..55: the item of the record's kind
  std::string_view unit;                    ///< of the value, "" = a number
  std::string_view meaning;                 ///< one sentence
  std::string_view since;                   ///< version of the map
  std::span<const std::string_view> words;  ///< what 0, 1, ... mean
  std::string_view slab_name;               ///< IR 42..55: the item when the record is about a slab
  std::string_view slab_unit;
};
using RegisterSink = std::function<void(const RegisterRow& row, std::string_view value)>;

/// Every register in order of address, with its value in words. No value is refused: what the map does not know is
/// called unknown, a wrong constant wrong.
void tell_inputs(const HoldingImage& image, WordOrder order, const RegisterSink& sink);
void tell_outputs(const InputImage& image, WordOrder order, const RegisterSink& sink);

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
/// One byte more in a CRC-16/Modbus, which begins with 0xFFFF.
[[nodiscard]] constexpr unsigned crc16_step(unsigned crc, unsigned byte) {
  return (crc >> 8U) ^ kCrc16OfByte[(crc ^ byte) & 0xFFU];
}
/// CRC-16/Modbus over registers in wire order, high byte first.
[[nodiscard]] std::uint16_t crc16_modbus(std::span<const std::uint16_t> registers);

}  // namespace slabd::hal
