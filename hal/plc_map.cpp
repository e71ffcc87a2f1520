// SPDX-License-Identifier: Apache-2.0
#include "hal/plc_map.h"

#include <cmath>
#include <concepts>
#include <type_traits>

// Problem: two sides must agree on 150 registers, and an error in one place of a hand-written codec is found on the
// line. Idea: each memory is listed exactly once, in `walk_...`, as calls on a cursor; one cursor writes registers,
// the other reads them. Invariants: a register is named once; nothing else in slabd knows an address.
namespace slabd::hal {
namespace {

/// 1 mm = 1000 um, 1 deg = 1000 millidegrees: one factor for both units.
constexpr double kThousandths = 1000.0;
constexpr double kPlain = 1.0;

constexpr std::uint16_t kRecordFirst = 30;
constexpr std::uint16_t kRecordCrc = 62;
constexpr std::uint16_t kRecordCopy = 63;
constexpr std::uint16_t kCommandCrc = 37;

std::uint16_t register_from(double value, double scale) {
  if (std::isnan(value)) return kNoRegisterValue;
  const double scaled = std::nearbyint(value * scale);
  const double limited = std::fmin(std::fmax(scaled, -32767.0), 32767.0);
  return static_cast<std::uint16_t>(static_cast<std::int16_t>(limited));
}

double value_from(std::uint16_t word, double scale) {
  if (word == kNoRegisterValue) return kNoValue;
  return static_cast<double>(static_cast<std::int16_t>(word)) / scale;
}

/// Where the i-th of `words` 16-bit parts lies: part 0 is the most significant one.
constexpr std::size_t part_address(std::size_t address, std::size_t words, std::size_t part, WordOrder order) {
  return address + (order == WordOrder::abcd ? part : words - 1 - part);
}

/// Writes registers from values.
class Encoder {
 public:
  Encoder(std::span<std::uint16_t> image, WordOrder order) : image_(image), order_(order) {}

  void u16(std::size_t address, std::uint16_t value) { image_[address] = value; }
  void bit(std::size_t address, unsigned bit, bool value) {
    if (value) image_[address] = static_cast<std::uint16_t>(image_[address] | (1U << bit));
  }
  void u32(std::size_t address, std::uint32_t value) { wide(address, 2, value); }
  void time_us(std::size_t address, std::int64_t value) { wide(address, 4, static_cast<std::uint64_t>(value)); }
  void fixed(std::size_t address, double value, double scale) { image_[address] = register_from(value, scale); }
  void constant(std::size_t address, std::uint16_t value) { u16(address, value); }
  void constant32(std::size_t address, std::uint32_t value) { u32(address, value); }
  template <typename Enum>
  void enumerated(std::size_t address, Enum value, Enum /*last*/) {
    u16(address, static_cast<std::uint16_t>(value));
  }
  void text(std::size_t address, const std::array<char, limits::kSlabIdBytes>& characters) {
    for (std::size_t i = 0; i < characters.size(); i += 2) {
      const auto high = static_cast<unsigned char>(characters[i]);
      const auto low = static_cast<unsigned char>(characters[i + 1]);
      image_[address + i / 2] = static_cast<std::uint16_t>((high << 8U) | low);
    }
  }
  void row(std::size_t address, const PlcStationRow& row) {
    image_[address] = static_cast<std::uint16_t>((static_cast<unsigned>(row.verdict) << 8U) | row.attempts);
    image_[address + 1] = row.reason;
  }

 private:
  void wide(std::size_t address, std::size_t words, std::uint64_t value) {
    for (std::size_t part = 0; part < words; ++part) {
      const std::size_t shift = 16 * (words - 1 - part);
      image_[part_address(address, words, part, order_)] = static_cast<std::uint16_t>(value >> shift);
    }
  }

  std::span<std::uint16_t> image_;
  WordOrder order_;
};

/// Reads values from registers and remembers the first register that holds something the map does not know.
class Decoder {
 public:
  Decoder(std::span<const std::uint16_t> image, WordOrder order) : image_(image), order_(order) {}

  void u16(std::size_t address, std::uint16_t& value) { value = image_[address]; }
  void bit(std::size_t address, unsigned bit, bool& value) { value = ((unsigned{image_[address]} >> bit) & 1U) != 0; }
  void u32(std::size_t address, std::uint32_t& value) { value = static_cast<std::uint32_t>(wide(address, 2)); }
  void time_us(std::size_t address, std::int64_t& value) { value = static_cast<std::int64_t>(wide(address, 4)); }
  void fixed(std::size_t address, double& value, double scale) { value = value_from(image_[address], scale); }
  void constant(std::size_t address, std::uint16_t value) {
    if (image_[address] != value) refuse(address, image_[address], value);
  }
  void constant32(std::size_t address, std::uint32_t value) {
    const auto found = static_cast<std::uint32_t>(wide(address, 2));
    if (found != value) refuse(address, found, value);
  }
  template <typename Enum>
  void enumerated(std::size_t address, Enum& value, Enum last) {
    known(address, image_[address], value, last);
  }
  void text(std::size_t address, std::array<char, limits::kSlabIdBytes>& characters) {
    for (std::size_t i = 0; i < characters.size(); i += 2) {
      const std::uint16_t word = image_[address + i / 2];
      characters[i] = static_cast<char>(word >> 8U);
      characters[i + 1] = static_cast<char>(word & 0xFFU);
    }
  }
  void row(std::size_t address, PlcStationRow& row) {
    known(address, static_cast<std::uint16_t>(image_[address] >> 8U), row.verdict, Verdict::indeterminate);
    row.attempts = static_cast<std::uint8_t>(image_[address] & 0xFFU);
    row.reason = image_[address + 1];
  }

  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] const Error& error() const { return error_; }

 private:
  std::uint64_t wide(std::size_t address, std::size_t words) const {
    std::uint64_t value = 0;
    for (std::size_t part = 0; part < words; ++part)
      value = (value << 16U) | image_[part_address(address, words, part, order_)];
    return value;
  }
  template <typename Enum>
  void known(std::size_t address, std::uint16_t found, Enum& value, Enum last) {
    if (found <= static_cast<std::uint16_t>(last)) {
      value = static_cast<Enum>(found);
    } else if (ok_) {
      ok_ = false;
      error_ = slabd::error(Code::config, "IR %zu holds %u, allowed 0..%u", address, unsigned{found},
                            static_cast<unsigned>(last));
    }
  }
  void refuse(std::size_t address, std::uint32_t found, std::uint32_t expected) {
    if (!ok_) return;
    ok_ = false;
    error_ = slabd::error(Code::config, "IR %zu holds 0x%X, register map 1.0 in this word order has 0x%X there",
                          address, found, expected);
  }

  std::span<const std::uint16_t> image_;
  WordOrder order_;
  bool ok_ = true;
  Error error_;
};

template <typename Value, typename Of>
concept ValueOrConst = std::same_as<std::remove_const_t<Value>, Of>;

// ---- holding registers: the PLC's half ---------------------------------------------------------------------------

/// `inputs` is const while encoding. HR 4..9 and 34..36 are reserved, HR 37 (CMD_CRC) is added by the caller.
template <typename Cursor, ValueOrConst<PlcInputs> Inputs>
void walk_inputs(Cursor& io, Inputs& inputs) {
  io.u16(0, inputs.heartbeat);  // PLC_HEARTBEAT, any change at least every 500 ms
  io.bit(1, 0, inputs.enable);  // PLC_CONTROL
  io.bit(1, 1, inputs.abort);
  io.bit(1, 2, inputs.fault_reset);
  io.u16(2, inputs.res_ack);   // RES_ACK, copy of RES_SEQ once stored in the PLC
  io.u16(3, inputs.sync_req);  // SYNC_REQ, changed by the PLC after its restart

  io.u16(10, inputs.command);    // CMD
  io.u16(11, inputs.station);    // STATION 1..18
  io.u16(12, inputs.slab_type);  // SLAB_TYPE 5600, ...
  io.u16(13, inputs.recipe);     // RECIPE, 0 = by type
  io.u32(14, inputs.slab_no);    // SLAB_NO
  io.text(16, inputs.slab_id);   // SLAB_ID, 16 registers, first character in the high byte, NUL padded
  io.u16(32, inputs.slab_temperature_dk);
  io.u16(33, inputs.slab_age_h);
  io.u16(38, inputs.session_echo);  // SESSION_ECHO
  io.u16(39, inputs.cmd_seq);       // CMD_SEQ, last
}

std::uint16_t command_crc(const HoldingImage& image) {
  return crc16_modbus(std::span(image).subspan(kCommandFirst, kCommandCrc - kCommandFirst));
}

// ---- input registers: slabd's half -------------------------------------------------------------------------------

template <typename Cursor, ValueOrConst<PlcOutputs> Outputs>
void walk_state(Cursor& io, Outputs& out) {
  io.constant(0, kMapMagic);
  io.constant(1, kMapVersion);
  io.constant32(2, kWordProbe);
  io.u16(4, out.heartbeat);  // HEARTBEAT, +1 every 500 ms
  io.bit(5, 0, out.ready);   // STATUS
  io.bit(5, 1, out.busy);
  io.bit(5, 2, out.acquired);  //   robot may move
  io.bit(5, 3, out.result);
  io.bit(5, 4, out.slab_open);
  io.bit(5, 5, out.fault_present);
  io.bit(5, 6, out.warn_present);
  io.bit(5, 7, out.pose_ok);
  io.bit(5, 8, out.scanner_ok);
  io.bit(5, 9, out.plc_link_ok);
  io.bit(5, 10, out.store_ok);
  io.bit(5, 11, out.simulation);
  io.enumerated(6, out.state, PlcState::maintenance);
  io.u16(7, out.fault);
  io.u16(8, out.warn);
  io.u16(9, out.session);
  io.u16(10, out.cmd_ack);
  io.u16(11, out.cmd_status);  // CommandStatus, or 0x8000 + code
  io.u16(12, out.acq_seq);     // CMD_SEQ whose cloud and pose are durable: robot may leave
  io.u16(13, out.current_station);
  io.u32(14, out.slab_no);
  io.u16(16, out.slab_type);
  io.u16(17, out.stations_done);
  io.u32(18, out.station_mask);
  io.u16(20, out.results_pending);
  io.u16(21, out.refused);
  io.time_us(22, out.utime_us);  // UTIME, us since epoch
  io.u16(26, out.refuse_code);
  io.u16(27, out.refuse_seq);
}

/// Kind 2 carries station numbers and a count, not lengths, at these places of IR 42..55.
constexpr std::array<bool, kPlcDeviations> kSlabPlainNumber = {false, false, false, false, true,  false, true,
                                                               false, true,  false, true,  false, true,  true};
constexpr std::uint16_t kKindSlab = 2;

/// IR 30..61. RES_SEQ's copy (IR 63) and the CRC (IR 62) are added by the caller.
template <typename Cursor, ValueOrConst<PlcResult> Record>
void walk_record(Cursor& io, Record& record) {
  io.u16(30, record.res_seq);  // RES_SEQ, 0 = no record
  io.u16(31, record.kind);     // 1 station, 2 slab
  io.u16(32, record.cmd_seq);
  io.u16(33, record.station);
  io.u32(34, record.slab_no);
  io.enumerated(36, record.verdict, Verdict::indeterminate);
  io.u16(37, record.reason);  // 600 + lowest failing item, or a code
  io.u16(38, record.fail_mask);
  io.u16(39, record.open_mask);  // indeterminate or not measured
  io.fixed(40, record.flatness_mm, kThousandths);
  io.fixed(41, record.std_mm, kThousandths);
  for (std::size_t i = 0; i < kPlcDeviations; ++i) {
    const bool plain = record.kind == kKindSlab && kSlabPlainNumber[i];
    io.fixed(42 + i, record.deviation[i], plain ? kPlain : kThousandths);
  }
  io.u32(56, record.points);
  io.time_us(58, record.scan_utime_us);
}

template <typename Cursor, ValueOrConst<PlcOutputs> Outputs>
void walk_slab(Cursor& io, Outputs& out) {
  for (std::size_t station = 0; station < limits::kStationsMax; ++station)
    io.row(70 + 2 * station, out.table[station]);  // verdict << 8 | attempts, reason
  io.enumerated(106, out.slab_verdict, Verdict::indeterminate);
  io.u16(107, out.slab_reason);
  io.u32(108, out.table_slab_no);
}

std::uint16_t record_crc(const InputImage& image) {
  return crc16_modbus(std::span(image).subspan(kRecordFirst, kRecordCrc - kRecordFirst));
}

}  // namespace

std::uint16_t crc16_modbus(std::span<const std::uint16_t> registers) {
  unsigned crc = 0xFFFF;
  const auto eat = [&crc](unsigned byte) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ 0xA001U : crc >> 1U;
  };
  for (const std::uint16_t word : registers) {
    eat(word >> 8U);
    eat(word & 0xFFU);
  }
  return static_cast<std::uint16_t>(crc);
}

void encode_outputs(const PlcOutputs& outputs, WordOrder order, InputImage& image) {
  image.fill(0);
  Encoder io(image, order);
  walk_state(io, outputs);
  walk_record(io, outputs.record);
  image[kRecordCrc] = record_crc(image);
  image[kRecordCopy] = outputs.record.res_seq;
  walk_slab(io, outputs);
}

Result<PlcOutputs> decode_outputs(const InputImage& image, WordOrder order) {
  PlcOutputs outputs;
  Decoder io(image, order);
  walk_state(io, outputs);
  walk_record(io, outputs.record);
  walk_slab(io, outputs);
  if (!io.ok()) return io.error();
  return outputs;
}

bool record_intact(const InputImage& image) {
  return image[kRecordFirst] != 0 && image[kRecordFirst] == image[kRecordCopy] &&
         image[kRecordCrc] == record_crc(image);
}

PlcInputs decode_inputs(const HoldingImage& image, WordOrder order) {
  PlcInputs inputs;
  Decoder io(image, order);
  walk_inputs(io, inputs);
  inputs.crc_ok = image[kCommandCrc] == 0 || image[kCommandCrc] == command_crc(image);
  return inputs;
}

void encode_inputs(const PlcInputs& inputs, WordOrder order, bool with_crc, HoldingImage& image) {
  image.fill(0);
  Encoder io(image, order);
  walk_inputs(io, inputs);
  if (with_crc) image[kCommandCrc] = command_crc(image);
}

}  // namespace slabd::hal
