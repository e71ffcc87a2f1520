// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <ctime>

#include "hal/plc/plc_map.h"
#include "hal/plc/plc_registers.h"

// The third cursor over the register table: it says each register in words. Documentation, `slabctl plc map` and
// `slabctl plc monitor` are made from it, so that none of them can know another map than the daemon.
namespace slabd::hal {
namespace {

using Text = RegisterText;

class Teller {
 public:
  Teller(RegisterRow::Memory memory, std::span<const std::uint16_t> image, WordOrder order, const RegisterSink& sink)
      : memory_(memory), image_(image), order_(order), sink_(sink) {}

  void u16(const Reg& reg, std::uint16_t& value) {
    value = image_[reg.address];
    Text text = number(value, reg.unit);
    // What the table says of 0 holds here too: an age nobody has told is not an age of 0 h.
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
  /// "3: 1 2 18": how many, and which.
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
    // A column may be a length in one kind of record and a plain number in the other.
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
    sink_(reason, code_text(row.reason).view());
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

void tell_inputs(const HoldingImage& image, WordOrder order, const RegisterSink& sink) {
  PlcInputs ignored;
  Teller teller(RegisterRow::Memory::holding, image, order, sink);
  walk_inputs(teller, ignored);
}

void tell_outputs(const InputImage& image, WordOrder order, const RegisterSink& sink) {
  PlcOutputs ignored;
  Teller teller(RegisterRow::Memory::input, image, order, sink);
  walk_state(teller, ignored);
  walk_record(teller, ignored.record);
  walk_slab(teller, ignored);
}

}  // namespace slabd::hal
