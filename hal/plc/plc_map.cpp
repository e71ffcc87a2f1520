// SPDX-License-Identifier: Apache-2.0
#include "hal/plc/plc_map.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <ctime>

#include "hal/plc/plc_registers.h"

// Problem: two sides must agree on 150 registers, and an error in one line of a hand-written codec is found only on the
// line. Idea: each memory is listed exactly once (plc_registers.h), as calls on a cursor; one cursor writes registers,
// another reads them. Invariants: a register is defined once; no other part of slabd contains an address.
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

/// Lengths and angles are stored in thousandths; station numbers and counts are stored unscaled.
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
  void gauge(std::size_t index, std::int32_t value) {
    wide(kGaugeFirst + 2 * index, 2, static_cast<std::uint32_t>(value));
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

/// Reads values from registers and remembers the first register with a value outside the map.
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
  void gauge(std::size_t index, std::int32_t& value) {
    value =
        static_cast<std::int32_t>(static_cast<std::uint32_t>(wide_value(image_, kGaugeFirst + 2 * index, 2, order_)));
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
    error_ = slabd::error(Code::config, "IR %u holds 0x%X, register map 1.1 in this word order has 0x%X there",
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

std::span<const std::uint16_t> slab_id_registers(const HoldingImage& image) {
  return std::span(image).subspan(kSlabIdFirst, limits::kSlabIdBytes / 2);
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

namespace {

/// Removes padding: most PLCs fill a text of fixed length with blanks, some in front.
void trim(std::array<char, limits::kSlabIdBytes>& text) {
  const auto fills = [](char c) { return c == ' ' || c == '\0'; };
  const auto first = std::find_if_not(text.begin(), text.end(), fills);
  const auto last = std::find_if_not(text.rbegin(), std::make_reverse_iterator(first), fills).base();
  std::fill(std::copy(first, last, text.begin()), text.end(), '\0');
}

}  // namespace

PlcInputs decode_inputs(const HoldingImage& image, WordOrder order) {
  PlcInputs inputs;
  Decoder io(image, order);
  walk_inputs(io, inputs);
  trim(inputs.slab_id);
  inputs.chips_agree = inputs.second_chip == 0 || inputs.second_chip == crc16_modbus(slab_id_registers(image));
  inputs.crc_ok = image[kCommandCrc] == 0 || image[kCommandCrc] == command_crc(image);
  return inputs;
}

void encode_inputs(const PlcInputs& inputs, WordOrder order, bool with_crc, HoldingImage& image) {
  image.fill(0);
  Encoder io(image, order);
  walk_inputs(io, inputs);
  if (with_crc) image[kCommandCrc] = command_crc(image);
}

std::uint16_t second_chip_of(std::string_view id) {
  PlcInputs inputs;
  std::copy_n(id.begin(), std::min(id.size(), inputs.slab_id.size()), inputs.slab_id.begin());
  HoldingImage image;
  encode_inputs(inputs, WordOrder::abcd, false, image);
  return crc16_modbus(slab_id_registers(image));
}

// The third cursor over the register table: describes each register in text. Documentation, `slabctl plc map` and
// `slabctl plc monitor` are made from it, so they always match the daemon's map.

namespace {

using Text = RegisterText;

class RegisterPrinter {
 public:
  RegisterPrinter(RegisterRow::Memory memory, std::span<const std::uint16_t> image, WordOrder order,
                  const RegisterSink& sink)
      : memory_(memory), image_(image), order_(order), sink_(sink) {}

  void u16(const Reg& reg, std::uint16_t& value) {
    value = image_[reg.address];
    Text text = number(value, reg.unit);
    // The meaning of 0 in the table applies here too: an unknown age is not an age of 0 h.
    if (value == 0 && std::string_view(reg.meaning).ends_with("0 = unknown")) text = "unknown";
    tell(reg, 1, "u16", text);
  }
  void code(const Reg& reg, std::uint16_t& value) {
    value = image_[reg.address];
    tell(reg, 1, "u16", code_text(value));
  }
  template <typename Words>
  void flags(const Reg& reg, std::uint16_t& value, const Words& words) {
    value = image_[reg.address];
    tell(reg, 1, "u16",
         set_bits(value, [&](unsigned bit) { return bit < words.size() ? words[bit] : std::string_view("UNKNOWN"); }),
         words);
  }
  void items(const Reg& reg, std::uint16_t& value) {
    value = image_[reg.address];
    tell(reg, 1, "u16", set_bits(value, [](unsigned bit) { return info(static_cast<ItemId>(bit)).name; }));
  }
  /// "3: 1 2 18": number of stations, and their numbers.
  void stations(const Reg& reg, std::uint32_t& value) {
    value = static_cast<std::uint32_t>(wide_value(image_, reg.address, 2, order_));
    Text text;
    text.printf("%d", std::popcount(value));
    for (unsigned bit = 0; bit < 32; ++bit) {
      FixedString<8> station;
      station.printf("%s%u", text.view().find(':') == std::string_view::npos ? ": " : " ", bit + 1);
      if ((value >> bit & 1U) != 0) text.append(station.view());
    }
    tell(reg, 2, "u32", text);
  }
  void command_status(const Reg& reg, std::uint16_t& value) {
    value = image_[reg.address];
    Text text;
    if (value >= kCommandFailed) {
      text = "failed: ";
      text.append(code_text(static_cast<std::uint16_t>(value - kCommandFailed)).view());
    } else {
      text = in_words(value, kStatusWords);
    }
    tell(reg, 1, "u16", text, kStatusWords);
  }
  template <typename Words>
  void word(const Reg& reg, std::uint16_t& value, const Words& words) {
    value = image_[reg.address];
    tell(reg, 1, "u16", in_words(value, words), words);
  }
  void scaled(const Reg& reg, std::uint16_t& value, double scale) {
    value = image_[reg.address];
    Text text;
    text.printf("%.1f %s", static_cast<double>(value) / scale, reg.unit);
    if (value == 0) text = "unknown";
    tell(reg, 1, "u16 / 10", text);
  }
  void bit(const Reg& reg, unsigned bit, bool& value) {
    value = ((unsigned{image_[reg.address]} >> bit) & 1U) != 0;
    RegisterRow row = begin(reg, 1, "bit");
    row.bit = static_cast<int>(bit);
    sink_(row, value ? "1" : "0");
  }
  void u32(const Reg& reg, std::uint32_t& value) {
    value = static_cast<std::uint32_t>(wide_value(image_, reg.address, 2, order_));
    tell(reg, 2, "u32", number(value, reg.unit));
  }
  void time_us(const Reg& reg, std::int64_t& value) {
    value = static_cast<std::int64_t>(wide_value(image_, reg.address, 4, order_));
    tell(reg, 4, "u64", time_text(value));
  }
  void fixed(const Reg& reg, double& value) {
    static_cast<void>(value);
    tell(reg, 1, "i16 / 1000", length(reg.address, reg.unit));
  }
  void deviation(std::size_t index, double& value, bool of_slab) {
    static_cast<void>(value);
    const DeviationColumn& column = kDeviations[index];
    Reg reg{static_cast<std::uint16_t>(kDeviationFirst + index), of_slab ? column.slab_name : column.station_name,
            of_slab ? column.slab_unit : column.station_unit, ""};
    // A column may be a length in one kind of record and an unscaled number in the other.
    const bool station_scaled = *column.station_unit != '\0';
    const bool slab_scaled = *column.slab_unit != '\0';
    const char* const type = station_scaled == slab_scaled ? (station_scaled ? "i16 / 1000" : "i16")
                             : station_scaled              ? "i16 / 1000; slab: i16"
                                                           : "i16; slab: i16 / 1000";
    RegisterRow row = begin(reg, 1, type);
    row.slab_name = column.slab_name;
    row.slab_unit = column.slab_unit;
    sink_(row, length(reg.address, reg.unit).view());
  }
  void constant(const Reg& reg, std::uint16_t expected) {
    const std::uint16_t found = image_[reg.address];
    tell(reg, 1, "u16", constant_text(found, expected, 4));
  }
  void constant32(const Reg& reg, std::uint32_t expected) {
    const auto found = static_cast<std::uint32_t>(wide_value(image_, reg.address, 2, order_));
    tell(reg, 2, "u32", constant_text(found, expected, 8));
  }
  template <typename Enum, typename Words>
  void enumerated(const Reg& reg, Enum& value, Enum last, const Words& words) {
    static_assert(std::tuple_size_v<Words> > 0);
    const std::uint16_t found = image_[reg.address];
    if (found <= static_cast<std::uint16_t>(last)) value = static_cast<Enum>(found);
    tell(reg, 1, "u16", in_words(found, words), words);
  }
  void text(const Reg& reg, std::array<char, limits::kSlabIdBytes>& characters) {
    Text text = "\"";
    for (std::size_t i = 0; i < characters.size(); ++i) {
      const unsigned word = image_[reg.address + i / 2];
      const auto c = static_cast<char>(i % 2 == 0 ? word >> 8U : word & 0xFFU);
      if (c == '\0') break;
      const char shown = c >= 0x20 && c < 0x7F ? c : '?';
      text.append(std::string_view(&shown, 1));
    }
    text.append("\"");
    tell(reg, limits::kSlabIdBytes / 2, "ASCII", text);
  }
  void row(std::uint16_t address, std::size_t station, PlcStationRow& row) {
    row.attempts = static_cast<std::uint8_t>(image_[address] & 0xFFU);
    row.reason = image_[address + 1U];
    FixedString<16> name;
    name.printf("STATION_%zu", station + 1);
    const Reg first{address, name.c_str(), "", "high byte: verdict, low byte: attempts"};
    RegisterRow told = begin(first, 1, "u8, u8");
    told.series = static_cast<int>(station) + 1;
    told.series_rows = static_cast<int>(limits::kStationsMax);
    told.words = kVerdictWords;
    Text text = in_words(static_cast<std::uint16_t>(image_[address] >> 8U), kVerdictWords);
    FixedString<32> attempts;
    attempts.printf(", %u attempt%s", unsigned{row.attempts}, row.attempts == 1 ? "" : "s");
    text.append(attempts.view());
    sink_(told, text.view());
    FixedString<32> reason_name;
    reason_name.printf("STATION_%zu_REASON", station + 1);
    const Reg second{static_cast<std::uint16_t>(address + 1), reason_name.c_str(), "", "why; 0 = none"};
    RegisterRow reason = begin(second, 1, "u16");
    reason.series = told.series;
    reason.series_rows = told.series_rows;
    sink_(reason, code_text(row.reason).view());
  }
  void gauge(std::size_t index, std::int32_t& value) {
    const auto address = static_cast<std::uint16_t>(kGaugeFirst + 2 * index);
    value = static_cast<std::int32_t>(static_cast<std::uint32_t>(wide_value(image_, address, 2, order_)));
    FixedString<16> name;
    name.printf("GAUGE_%zu", index + 1);
    const Reg reg{address, name.c_str(), "mm", "value of a gauge in um (or 0.001 deg); 0x80000000 = none", kSince11};
    RegisterRow row = begin(reg, 2, "i32 / 1000");
    row.series = static_cast<int>(index) + 1;
    row.series_rows = static_cast<int>(limits::kGaugesMax);
    Text text = "-";
    if (value != kNoGaugeRegister) text.printf("%.3f", static_cast<double>(value) / kThousandths);
    sink_(row, text.view());
  }
  void reserved(const Reg& reg, unsigned count) { tell(reg, count, "", {}); }
  void computed(const Reg& reg) {
    Text text;
    text.printf("0x%04X", unsigned{image_[reg.address]});
    tell(reg, 1, "u16", text);
  }

 private:
  RegisterRow begin(const Reg& reg, std::size_t count, const char* type) const {
    RegisterRow row;
    row.memory = memory_;
    row.address = reg.address;
    row.count = count;
    row.type = type;
    row.name = reg.name;
    row.unit = reg.unit;
    row.meaning = reg.meaning;
    row.since = reg.since;
    return row;
  }
  void tell(const Reg& reg, std::size_t count, const char* type, const Text& text,
            std::span<const std::string_view> words = {}) const {
    RegisterRow row = begin(reg, count, type);
    row.words = words;
    sink_(row, text.view());
  }

  static Text number(std::uint64_t value, const char* unit) {
    Text text;
    text.printf("%llu%s%s", static_cast<unsigned long long>(value), *unit == '\0' ? "" : " ", unit);
    return text;
  }
  Text length(std::size_t address, const char* unit) const {
    Text text;
    const std::uint16_t word = image_[address];
    if (word == kNoRegisterValue) return "-";
    const int value = static_cast<std::int16_t>(word);
    if (*unit == '\0') {
      text.printf("%d", value);
    } else {
      text.printf("%.3f %s%s", static_cast<double>(value) / kThousandths, unit,
                  value == 32767 || value == -32767 ? " or more" : "");
    }
    return text;
  }
  /// "0x0003 first, second"
  template <typename Name>
  static Text set_bits(std::uint16_t value, Name&& name) {
    Text text;
    if (value == 0) return "0";
    text.printf("0x%04X", unsigned{value});
    const char* before = " ";
    for (unsigned bit = 0; bit < 16; ++bit) {
      if ((unsigned{value} >> bit & 1U) == 0) continue;
      text.append(before);
      text.append(name(bit));
      before = ", ";
    }
    return text;
  }
  static Text in_words(std::uint16_t value, std::span<const std::string_view> words) {
    Text text;
    text.printf("%u ", unsigned{value});
    text.append(value < words.size() ? words[value] : std::string_view("UNKNOWN"));
    return text;
  }
  static Text code_text(std::uint16_t code) {
    Text text;
    if (code == 0) return "0";
    text.printf("%u ", unsigned{code});
    if (const std::optional<ItemId> item = item_from_reason(code)) {
      text.append(info(*item).name);
    } else {
      text.append(describe(static_cast<Code>(code)));
    }
    return text;
  }
  static Text constant_text(std::uint32_t found, std::uint32_t expected, int digits) {
    Text text;
    text.printf("0x%0*X%s", digits, found, found == expected ? "" : "  WRONG");
    return text;
  }
  static Text time_text(std::int64_t utime_us) {
    Text text;
    if (utime_us == 0) return "never";
    const std::time_t seconds = utime_us / 1'000'000;
    std::tm utc{};
    gmtime_r(&seconds, &utc);
    text.printf("%04d-%02d-%02dT%02d:%02d:%02d.%03dZ", utc.tm_year + 1900, utc.tm_mon + 1, utc.tm_mday, utc.tm_hour,
                utc.tm_min, utc.tm_sec, static_cast<int>(utime_us / 1000 % 1000));
    return text;
  }

  RegisterRow::Memory memory_;
  std::span<const std::uint16_t> image_;
  WordOrder order_;
  const RegisterSink& sink_;
};

}  // namespace

void list_inputs(const HoldingImage& image, WordOrder order, const RegisterSink& sink) {
  PlcInputs ignored;
  RegisterPrinter printer(RegisterRow::Memory::holding, image, order, sink);
  walk_inputs(printer, ignored);
}

void list_outputs(const InputImage& image, WordOrder order, const RegisterSink& sink) {
  PlcOutputs ignored;
  RegisterPrinter printer(RegisterRow::Memory::input, image, order, sink);
  walk_state(printer, ignored);
  walk_record(printer, ignored.record);
  walk_slab(printer, ignored);
}

}  // namespace slabd::hal
