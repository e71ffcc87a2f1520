// SPDX-License-Identifier: Apache-2.0
#include "hal/plc/plc_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

namespace slabd::hal {
namespace {

PlcResult station_result() {
  PlcResult record;
  record.res_seq = 0x0102;
  record.kind = 1;
  record.cmd_seq = 77;
  record.station = 9;
  record.slab_no = 0xDEADBEEF;
  record.verdict = Verdict::fail;
  record.reason = 604;
  record.fail_mask = 0x0010;
  record.open_mask = 0x0300;
  record.flatness_mm = 0.4321;
  record.std_mm = 0.0296;
  for (std::size_t i = 0; i < kPlcDeviations; ++i)
    record.deviation[i] = (i % 2 == 0 ? 1.0 : -1.0) * 0.1 * double(i + 1);
  record.deviation[11] = kNoValue;
  record.points = 4'987'654;
  record.scan_utime_us = 0x0001'0203'0405'0607;
  return record;
}

PlcOutputs busy_outputs() {
  PlcOutputs out;
  out.heartbeat = 4711;
  out.ready = true;
  out.acquired = true;
  out.pose_ok = true;
  out.simulation = true;
  out.state = PlcState::scanning;
  out.fault = 301;
  out.warn = 5;
  out.session = 65535;
  out.cmd_ack = 12;
  out.cmd_status = 0x8000 + 203;
  out.acq_seq = 11;
  out.current_station = 10;
  out.slab_no = 0x12345;
  out.slab_type = 5600;
  out.stations_done = 17;
  out.station_mask = 0x3FFFE;
  out.results_pending = 2;
  out.refused = 3;
  out.utime_us = 1'700'000'000'123'456;
  out.refuse_code = 102;
  out.refuse_seq = 9;
  out.disposition = Disposition::rework;
  out.disposition_seq = 7;
  out.record = station_result();
  for (std::size_t i = 0; i < limits::kStationsMax; ++i)
    out.table[i] = {Verdict::pass, static_cast<std::uint8_t>(i + 1), static_cast<std::uint16_t>(600 + i)};
  out.slab_verdict = Verdict::indeterminate;
  out.slab_reason = 610;
  out.table_slab_no = 0xFFFF0001;
  return out;
}

TEST(PlcMap, crc_is_crc16_modbus) {
  // Read holding registers 0x6B..0x6D of slave 0x11, the usual example frame: 11 03 00 6B 00 03, then 76 87 (low
  // first).
  const std::array<std::uint16_t, 3> request = {0x1103, 0x006B, 0x0003};
  EXPECT_EQ(crc16_modbus(request), 0x8776);
  // Not zero for zeros, so all-zero memory has a wrong checksum.
  const std::array<std::uint16_t, 1> zero = {0x0000};
  EXPECT_EQ(crc16_modbus(zero), 0xB001);
}

TEST(PlcMap, input_registers_have_the_addresses_of_the_map) {
  InputImage image;
  encode_outputs(busy_outputs(), WordOrder::abcd, image);
  EXPECT_EQ(image[0], 0x534C);
  EXPECT_EQ(image[1], 0x0101);
  EXPECT_EQ(image[2], 0x1234);
  EXPECT_EQ(image[3], 0x5678);
  EXPECT_EQ(image[4], 4711);
  EXPECT_EQ(image[5], (1U << 0U) | (1U << 2U) | (1U << 7U) | (1U << 11U));
  EXPECT_EQ(image[6], 5);
  EXPECT_EQ(image[7], 301);
  EXPECT_EQ(image[8], 5);
  EXPECT_EQ(image[9], 65535);
  EXPECT_EQ(image[10], 12);
  EXPECT_EQ(image[11], 0x80CB);
  EXPECT_EQ(image[12], 11);
  EXPECT_EQ(image[13], 10);
  EXPECT_EQ(image[14], 0x0001);
  EXPECT_EQ(image[15], 0x2345);
  EXPECT_EQ(image[16], 5600);
  EXPECT_EQ(image[17], 17);
  EXPECT_EQ(image[18], 0x0003);
  EXPECT_EQ(image[19], 0xFFFE);
  EXPECT_EQ(image[20], 2);
  EXPECT_EQ(image[21], 3);
  EXPECT_EQ(image[22], 0x0006);  // 1 700 000 000 123 456 = 0x60A2418202240
  EXPECT_EQ(image[23], 0x0A24);
  EXPECT_EQ(image[24], 0x1820);
  EXPECT_EQ(image[25], 0x2240);
  EXPECT_EQ(image[26], 102);
  EXPECT_EQ(image[27], 9);
  EXPECT_EQ(image[28], 3);
  EXPECT_EQ(image[29], 7);
}

TEST(PlcMap, result_record_has_the_addresses_of_the_map) {
  InputImage image;
  encode_outputs(busy_outputs(), WordOrder::abcd, image);
  EXPECT_EQ(image[30], 0x0102);
  EXPECT_EQ(image[31], 1);
  EXPECT_EQ(image[32], 77);
  EXPECT_EQ(image[33], 9);
  EXPECT_EQ(image[34], 0xDEAD);
  EXPECT_EQ(image[35], 0xBEEF);
  EXPECT_EQ(image[36], 2);
  EXPECT_EQ(image[37], 604);
  EXPECT_EQ(image[38], 0x0010);
  EXPECT_EQ(image[39], 0x0300);
  EXPECT_EQ(image[40], 432);  // 0.4321 mm = 432.1 um
  EXPECT_EQ(image[41], 30);   // 0.0296 mm = 29.6 um
  EXPECT_EQ(image[42], 100);
  EXPECT_EQ(image[43], 0xFF38);  // -200
  EXPECT_EQ(image[52], 1100);
  EXPECT_EQ(image[53], 0x8000);  // none
  EXPECT_EQ(image[55], 0xFA88);  // -1400
  EXPECT_EQ(image[56], 0x004C);  // 4 987 654 = 0x4C1B06
  EXPECT_EQ(image[57], 0x1B06);
  EXPECT_EQ(image[58], 0x0001);
  EXPECT_EQ(image[59], 0x0203);
  EXPECT_EQ(image[60], 0x0405);
  EXPECT_EQ(image[61], 0x0607);
  EXPECT_EQ(image[63], 0x0102);
  for (std::size_t i = 64; i < 70; ++i) EXPECT_EQ(image[i], 0) << i;
  EXPECT_EQ(image[70], 0x0101);
  EXPECT_EQ(image[71], 600);
  EXPECT_EQ(image[104], 0x0112);
  EXPECT_EQ(image[105], 617);
  EXPECT_EQ(image[106], 5);
  EXPECT_EQ(image[107], 610);
  EXPECT_EQ(image[108], 0xFFFF);
  EXPECT_EQ(image[109], 0x0001);
}

TEST(PlcMap, word_order_swaps_words_and_never_bytes) {
  InputImage image;
  encode_outputs(busy_outputs(), WordOrder::cdab, image);
  EXPECT_EQ(image[2], 0x5678);
  EXPECT_EQ(image[3], 0x1234);
  EXPECT_EQ(image[34], 0xBEEF);
  EXPECT_EQ(image[35], 0xDEAD);
  EXPECT_EQ(image[58], 0x0607);
  EXPECT_EQ(image[61], 0x0001);
  EXPECT_EQ(image[4], 4711);
  EXPECT_TRUE(record_intact(image));
}

TEST(PlcMap, slab_record_carries_station_numbers_plain) {
  PlcOutputs out;
  out.record.kind = 2;
  out.record.res_seq = 1;
  out.record.deviation = {0.5, -0.25, 0.125, -1.2, 4.0, 0.9, 7.0, 0.031, 18.0, -0.4, 2.0, 0.6, 13.0, 3.0};
  InputImage image;
  encode_outputs(out, WordOrder::abcd, image);
  const std::array<int, 14> expected = {500, -250, 125, -1200, 4, 900, 7, 31, 18, -400, 2, 600, 13, 3};
  for (std::size_t i = 0; i < 14; ++i) EXPECT_EQ(static_cast<std::int16_t>(image[42 + i]), expected[i]) << 42 + i;
  const Result<PlcOutputs> back = decode_outputs(image, WordOrder::abcd);
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(back.value().record.deviation, out.record.deviation);
}

TEST(PlcMap, deviations_saturate_and_never_turn_into_none) {
  PlcOutputs out;
  out.record.deviation[0] = 1e9;
  out.record.deviation[1] = -1e9;
  out.record.deviation[2] = -32.768;
  out.record.deviation[3] = std::numeric_limits<double>::infinity();
  out.record.flatness_mm = 40.0;
  InputImage image;
  encode_outputs(out, WordOrder::abcd, image);
  EXPECT_EQ(image[42], 0x7FFF);
  EXPECT_EQ(image[43], 0x8001);
  EXPECT_EQ(image[44], 0x8001);
  EXPECT_EQ(image[45], 0x7FFF);
  EXPECT_EQ(image[40], 0x7FFF);
  EXPECT_EQ(image[41], 0x8000);
}

TEST(PlcMap, outputs_come_back_as_they_went) {
  for (const WordOrder order : {WordOrder::abcd, WordOrder::cdab}) {
    const PlcOutputs out = busy_outputs();
    InputImage image;
    encode_outputs(out, order, image);
    const Result<PlcOutputs> decoded = decode_outputs(image, order);
    ASSERT_TRUE(decoded.ok()) << decoded.error().text.c_str();
    const PlcOutputs& back = decoded.value();
    EXPECT_EQ(back.utime_us, out.utime_us);
    EXPECT_EQ(back.record.scan_utime_us, out.record.scan_utime_us);
    EXPECT_TRUE(has_value(back.record.deviation[0]));
    EXPECT_FALSE(has_value(back.record.deviation[11]));
    EXPECT_NEAR(back.record.flatness_mm, 0.432, 1e-12);
    EXPECT_EQ(back.state, out.state);
    EXPECT_EQ(back.ready, true);
    EXPECT_EQ(back.busy, false);
    EXPECT_EQ(back.simulation, true);
    EXPECT_EQ(back.table[17].reason, 617);
    // Encoding the decoded values gives the same registers: no value was lost or exchanged.
    InputImage again;
    encode_outputs(back, order, again);
    EXPECT_EQ(again, image);
  }
}

TEST(PlcMap, all_zero_memory_never_reads_as_pass_nor_as_a_record) {
  const InputImage zero{};
  EXPECT_FALSE(record_intact(zero));
  const Result<PlcOutputs> decoded = decode_outputs(zero, WordOrder::abcd);
  ASSERT_FALSE(decoded.ok());
  EXPECT_NE(decoded.error().text.view().find("IR 0"), std::string_view::npos);
  // Also if the rest of the map is present: blank record, table and slab verdict are "none".
  InputImage blank;
  encode_outputs(PlcOutputs{}, WordOrder::abcd, blank);
  EXPECT_FALSE(record_intact(blank));
  EXPECT_NE(blank[36], static_cast<std::uint16_t>(Verdict::pass));
  for (std::size_t i = 70; i < 106; ++i) EXPECT_EQ(blank[i], 0);
  EXPECT_EQ(blank[106], 0);
}

TEST(PlcMap, wrong_word_order_is_noticed) {
  InputImage image;
  encode_outputs(busy_outputs(), WordOrder::abcd, image);
  const Result<PlcOutputs> decoded = decode_outputs(image, WordOrder::cdab);
  ASSERT_FALSE(decoded.ok());
  EXPECT_NE(decoded.error().text.view().find("IR 2"), std::string_view::npos);
}

TEST(PlcMap, an_unknown_verdict_is_refused_by_name_of_its_register) {
  InputImage image;
  encode_outputs(busy_outputs(), WordOrder::abcd, image);
  image[70] = 0x0601;
  const Result<PlcOutputs> decoded = decode_outputs(image, WordOrder::abcd);
  ASSERT_FALSE(decoded.ok());
  EXPECT_STREQ(decoded.error().text.c_str(), "IR 70 holds 6, allowed 0..5");
}

TEST(PlcMap, a_torn_record_is_not_intact) {
  InputImage whole;
  encode_outputs(busy_outputs(), WordOrder::abcd, whole);
  ASSERT_TRUE(record_intact(whole));
  for (std::size_t i = 30; i <= 63; ++i) {
    for (unsigned bit = 0; bit < 16; ++bit) {
      InputImage torn = whole;
      torn[i] = static_cast<std::uint16_t>(torn[i] ^ (1U << bit));
      EXPECT_FALSE(record_intact(torn)) << "IR " << i << " bit " << bit;
    }
  }
}

HoldingImage scan_command() {
  HoldingImage image{};
  image[0] = 321;
  image[1] = 0x0005;
  image[2] = 44;
  image[3] = 2;
  image[10] = 2;
  image[11] = 18;
  image[12] = 5600;
  image[13] = 1;
  image[14] = 0x0001;
  image[15] = 0x0002;
  image[16] = 0x5335;  // "S5"
  image[17] = 0x3600;  // "6" and the padding
  image[32] = 2931;
  image[33] = 72;
  image[34] = 12;
  image[38] = 9;
  image[39] = 65535;
  return image;
}

TEST(PlcMap, holding_registers_have_the_addresses_of_the_map) {
  const PlcInputs inputs = decode_inputs(scan_command(), WordOrder::abcd);
  EXPECT_EQ(inputs.heartbeat, 321);
  EXPECT_TRUE(inputs.enable);
  EXPECT_FALSE(inputs.abort);
  EXPECT_TRUE(inputs.fault_reset);
  EXPECT_EQ(inputs.res_ack, 44);
  EXPECT_EQ(inputs.sync_req, 2);
  EXPECT_EQ(inputs.command, 2);
  EXPECT_EQ(inputs.station, 18);
  EXPECT_EQ(inputs.slab_type, 5600);
  EXPECT_EQ(inputs.recipe, 1);
  EXPECT_EQ(inputs.slab_no, 0x00010002U);
  EXPECT_STREQ(inputs.slab_id.data(), "S56");
  EXPECT_EQ(inputs.slab_temperature_dk, 2931);
  EXPECT_EQ(inputs.slab_age_h, 72);
  EXPECT_EQ(inputs.mould, 12);
  EXPECT_EQ(inputs.session_echo, 9);
  EXPECT_EQ(inputs.cmd_seq, 65535);
  EXPECT_TRUE(inputs.crc_ok);  // 0: not used
  EXPECT_EQ(inputs.command_writer, 0U);
  EXPECT_EQ(decode_inputs(scan_command(), WordOrder::cdab).slab_no, 0x00020001U);
}

TEST(PlcMap, command_crc_guards_exactly_registers_10_to_36) {
  HoldingImage image = scan_command();
  image[37] = crc16_modbus(std::span(image).subspan(10, 27));
  ASSERT_NE(image[37], 0);
  ASSERT_TRUE(decode_inputs(image, WordOrder::abcd).crc_ok);
  for (std::size_t i = 0; i < image.size(); ++i) {
    if (i == 37) continue;
    HoldingImage changed = image;
    changed[i] = static_cast<std::uint16_t>(changed[i] ^ 0x0100U);
    EXPECT_EQ(decode_inputs(changed, WordOrder::abcd).crc_ok, i < 10 || i > 36) << "HR " << i;
  }
}

// A PLC of map 1.0 writes 0 to HR 34, and its checksum covers it.
TEST(PlcMap, a_command_of_map_1_0_has_an_unknown_mould) {
  HoldingImage image = scan_command();
  image[34] = 0;
  image[37] = crc16_modbus(std::span(image).subspan(10, 27));
  const PlcInputs inputs = decode_inputs(image, WordOrder::abcd);
  EXPECT_TRUE(inputs.crc_ok);
  EXPECT_EQ(inputs.mould, 0);
  EXPECT_EQ(inputs.slab_age_h, 72);
}

TEST(PlcMap, the_second_chip_agrees_if_its_checksum_is_that_of_the_id_as_written) {
  HoldingImage image = scan_command();
  const auto agree = [&](std::uint16_t second_chip) {
    image[35] = second_chip;
    const PlcInputs inputs = decode_inputs(image, WordOrder::cdab);
    EXPECT_EQ(inputs.second_chip, second_chip);
    return inputs.chips_agree;
  };
  EXPECT_TRUE(agree(0)) << "not read";
  const std::uint16_t same = crc16_modbus(std::span(image).subspan(16, 16));
  ASSERT_NE(same, 0);
  EXPECT_TRUE(agree(same));
  EXPECT_FALSE(agree(static_cast<std::uint16_t>(same ^ 1U)));
  image[31] = 0x0020;  // a blank at its end is in the one chip only
  EXPECT_FALSE(agree(same));
  EXPECT_EQ(second_chip_of("C3-0001"), second_chip_of(std::string("C3-0001").append(25, '\0')));
  EXPECT_NE(second_chip_of("C3-0001"), second_chip_of("C3-0010"));
}

TEST(PlcMap, blanks_and_NULs_around_a_slab_id_are_not_part_of_it) {
  using namespace std::string_literals;
  const auto read = [](const std::string& text) {
    PlcInputs inputs;
    std::copy(text.begin(), text.end(), inputs.slab_id.begin());
    HoldingImage image;
    encode_inputs(inputs, WordOrder::abcd, true, image);
    const PlcInputs back = decode_inputs(image, WordOrder::abcd);
    EXPECT_TRUE(back.crc_ok) << "of what was sent";
    return std::string(back.slab_id.begin(), back.slab_id.end());
  };
  const auto filled = [](std::string text) {
    text.resize(limits::kSlabIdBytes);
    return text;
  };
  EXPECT_EQ(read("S-47" + std::string(28, ' ')), filled("S-47"));
  EXPECT_EQ(read(std::string(28, ' ') + "S-47"), filled("S-47"));
  EXPECT_EQ(read("\0 S 47 \0  "s), filled("S 47")) << "what is inside stays";
  EXPECT_EQ(read("A\0B "s), filled("A\0B"s)) << "for the station to refuse";
  EXPECT_EQ(read(std::string(32, ' ')), filled("")) << "no id";
  EXPECT_EQ(read(std::string(32, 'x')), std::string(32, 'x'));
}

TEST(PlcMap, gauges_are_32_bit_thousandths_in_the_configured_word_order) {
  HoldingImage image{};
  image[40] = 0x0055;  // 5 600 076 um, high word first
  image[41] = 0x734C;
  image[42] = 0xFFFF;  // -1 um
  image[43] = 0xFFFF;
  image[70] = 0x8000;
  image[72] = 7;
  image[73] = 0x0001;
  image[74] = 0x0002;
  const PlcInputs inputs = decode_inputs(image, WordOrder::abcd);
  EXPECT_EQ(inputs.gauge_thousandths[0], 5'600'076);
  EXPECT_EQ(inputs.gauge_thousandths[1], -1);
  EXPECT_EQ(inputs.gauge_thousandths[15], kNoGaugeRegister);
  EXPECT_EQ(inputs.gauge_seq, 7);
  EXPECT_EQ(inputs.gauge_slab_no, 0x00010002U);
  const PlcInputs other = decode_inputs(image, WordOrder::cdab);
  EXPECT_EQ(other.gauge_thousandths[0], 0x734C'0055);
  EXPECT_EQ(other.gauge_slab_no, 0x00020001U);
}

TEST(PlcMap, inputs_come_back_as_they_went) {
  for (const WordOrder order : {WordOrder::abcd, WordOrder::cdab}) {
    for (const bool with_crc : {false, true}) {
      PlcInputs inputs = decode_inputs(scan_command(), order);
      std::memcpy(inputs.slab_id.data(), "ABCDEFGHIJKLMNOPQRSTUVWXYZ012345", 32);
      HoldingImage image;
      encode_inputs(inputs, order, with_crc, image);
      EXPECT_EQ(image[16], 0x4142);
      EXPECT_EQ(image[31], 0x3435);
      EXPECT_EQ(image[37] != 0, with_crc);
      const PlcInputs back = decode_inputs(image, order);
      EXPECT_TRUE(back.crc_ok);
      EXPECT_EQ(back.slab_id, inputs.slab_id);
      EXPECT_EQ(back.slab_no, inputs.slab_no);
      HoldingImage again;
      encode_inputs(back, order, with_crc, again);
      EXPECT_EQ(again, image);
    }
  }
}

}  // namespace
}  // namespace slabd::hal
