// SPDX-License-Identifier: Apache-2.0
#include "hal/plc/plc_map.h"

#include <cmath>

#include "hal/plc/plc_registers.h"

// Problem: two sides must agree on 150 registers, and an error in one place of a hand-written codec is found on the
// line. Idea: each memory is listed exactly once (plc_registers.h), as calls on a cursor; one cursor writes registers,
// the other reads them. Invariants: a register is named once; nothing else in slabd knows an address.
namespace slabd::hal {
namespace {

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

/// Lengths and angles go in thousandths; station numbers and counts as they are.
double deviation_scale(std::size_t index, bool of_slab) {
  const bool plain = of_slab && *kDeviations[index].slab_unit == '\0';
  return plain ? 1.0 : kThousandths;
}

/// Writes registers from values.
class Encoder {
 public:
  Encoder(std::span<std::uint16_t> image, WordOrder order) : image_(image), order_(order) {}

  void u16(const Reg& reg, std::uint16_t value) { image_[reg.address] = value; }
  void code(const Reg& reg, std::uint16_t value) { u16(reg, value); }
  template <typename Words>
  void flags(const Reg& reg, std::uint16_t value, const Words&) {
    u16(reg, value);
  }
  void items(const Reg& reg, std::uint16_t value) { u16(reg, value); }
  void stations(const Reg& reg, std::uint32_t value) { u32(reg, value); }
  void command_status(const Reg& reg, std::uint16_t value) { u16(reg, value); }
  template <typename Words>
  void word(const Reg& reg, std::uint16_t value, const Words&) {
    u16(reg, value);
  }
  void scaled(const Reg& reg, std::uint16_t value, double) { u16(reg, value); }
  void bit(const Reg& reg, unsigned bit, bool value) {
    if (value) image_[reg.address] = static_cast<std::uint16_t>(image_[reg.address] | (1U << bit));
  }
  void u32(const Reg& reg, std::uint32_t value) { wide(reg.address, 2, value); }
  void time_us(const Reg& reg, std::int64_t value) { wide(reg.address, 4, static_cast<std::uint64_t>(value)); }
  void fixed(const Reg& reg, double value) { image_[reg.address] = register_from(value, kThousandths); }
  void deviation(std::size_t index, double value, bool of_slab) {
    image_[kDeviationFirst + index] = register_from(value, deviation_scale(index, of_slab));
  }
  void constant(const Reg& reg, std::uint16_t value) { u16(reg, value); }
  void constant32(const Reg& reg, std::uint32_t value) { u32(reg, value); }
  template <typename Enum, typename Words>
  void enumerated(const Reg& reg, Enum value, Enum /*last*/, const Words&) {
    u16(reg, static_cast<std::uint16_t>(value));
  }
  void text(const Reg& reg, const std::array<char, limits::kSlabIdBytes>& characters) {
    for (std::size_t i = 0; i < characters.size(); i += 2) {
      const auto high = static_cast<unsigned char>(characters[i]);
      const auto low = static_cast<unsigned char>(characters[i + 1]);
      image_[reg.address + i / 2] = static_cast<std::uint16_t>((high << 8U) | low);
    }
  }
  void row(std::uint16_t address, std::size_t /*station*/, const PlcStationRow& row) {
    image_[address] = static_cast<std::uint16_t>((static_cast<unsigned>(row.verdict) << 8U) | row.attempts);
    image_[address + 1U] = row.reason;
  }
  void reserved(const Reg&, unsigned) {}
  void computed(const Reg&) {}

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

  void u16(const Reg& reg, std::uint16_t& value) { value = image_[reg.address]; }
  void code(const Reg& reg, std::uint16_t& value) { u16(reg, value); }
  template <typename Words>
  void flags(const Reg& reg, std::uint16_t& value, const Words&) {
    u16(reg, value);
  }
  void items(const Reg& reg, std::uint16_t& value) { u16(reg, value); }
  void stations(const Reg& reg, std::uint32_t& value) { u32(reg, value); }
  void command_status(const Reg& reg, std::uint16_t& value) { u16(reg, value); }
  template <typename Words>
  void word(const Reg& reg, std::uint16_t& value, const Words&) {
    u16(reg, value);
  }
  void scaled(const Reg& reg, std::uint16_t& value, double) { u16(reg, value); }
  void bit(const Reg& reg, unsigned bit, bool& value) { value = ((unsigned{image_[reg.address]} >> bit) & 1U) != 0; }
  void u32(const Reg& reg, std::uint32_t& value) { value = static_cast<std::uint32_t>(wide(reg, 2)); }
  void time_us(const Reg& reg, std::int64_t& value) { value = static_cast<std::int64_t>(wide(reg, 4)); }
  void fixed(const Reg& reg, double& value) { value = value_from(image_[reg.address], kThousandths); }
  void deviation(std::size_t index, double& value, bool of_slab) {
    value = value_from(image_[kDeviationFirst + index], deviation_scale(index, of_slab));
  }
  void constant(const Reg& reg, std::uint16_t value) {
    if (image_[reg.address] != value) refuse(reg, image_[reg.address], value);
  }
  void constant32(const Reg& reg, std::uint32_t value) {
    const auto found = static_cast<std::uint32_t>(wide(reg, 2));
    if (found != value) refuse(reg, found, value);
  }
  template <typename Enum, typename Words>
  void enumerated(const Reg& reg, Enum& value, Enum last, const Words&) {
    known(reg.address, image_[reg.address], value, last);
  }
  void text(const Reg& reg, std::array<char, limits::kSlabIdBytes>& characters) {
    for (std::size_t i = 0; i < characters.size(); i += 2) {
      const std::uint16_t word = image_[reg.address + i / 2];
      characters[i] = static_cast<char>(word >> 8U);
      characters[i + 1] = static_cast<char>(word & 0xFFU);
    }
  }
  void row(std::uint16_t address, std::size_t /*station*/, PlcStationRow& row) {
    known(address, static_cast<std::uint16_t>(image_[address] >> 8U), row.verdict, Verdict::indeterminate);
    row.attempts = static_cast<std::uint8_t>(image_[address] & 0xFFU);
    row.reason = image_[address + 1U];
  }
  void reserved(const Reg&, unsigned) {}
  void computed(const Reg&) {}

  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] const Error& error() const { return error_; }

 private:
  std::uint64_t wide(const Reg& reg, std::size_t words) const { return wide_value(image_, reg.address, words, order_); }
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
  void refuse(const Reg& reg, std::uint32_t found, std::uint32_t expected) {
    if (!ok_) return;
    ok_ = false;
    error_ = slabd::error(Code::config, "IR %u holds 0x%X, register map 1.0 in this word order has 0x%X there",
                          unsigned{reg.address}, found, expected);
  }

  std::span<const std::uint16_t> image_;
  WordOrder order_;
  bool ok_ = true;
  Error error_;
};

std::uint16_t command_crc(const HoldingImage& image) {
  return crc16_modbus(std::span(image).subspan(kCommandFirst, kCommandCrc - kCommandFirst));
}

std::uint16_t record_crc(const InputImage& image) {
  return crc16_modbus(std::span(image).subspan(kRecordFirst, kRecordCrc - kRecordFirst));
}

}  // namespace

std::uint16_t crc16_modbus(std::span<const std::uint16_t> registers) {
  unsigned crc = 0xFFFF;
  for (const std::uint16_t word : registers) crc = crc16_step(crc16_step(crc, word >> 8U), word & 0xFFU);
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
