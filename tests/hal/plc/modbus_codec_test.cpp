// SPDX-License-Identifier: Apache-2.0
#include "hal/plc/modbus_codec.h"

#include <gtest/gtest.h>

#include <vector>

#include "base/prng.h"

namespace slabd::hal {
namespace {

using Bytes = std::vector<std::uint8_t>;

void put(Bytes& bytes, unsigned word) {
  bytes.push_back(static_cast<std::uint8_t>(word >> 8U));
  bytes.push_back(static_cast<std::uint8_t>(word & 255U));
}

Bytes frame(std::uint8_t unit, const Bytes& pdu) {
  Bytes bytes = {0x12, 0x34, 0, 0};
  put(bytes, static_cast<unsigned>(pdu.size() + 1));
  bytes.push_back(unit);
  bytes.insert(bytes.end(), pdu.begin(), pdu.end());
  return bytes;
}

Bytes read_pdu(std::uint8_t function, unsigned first, unsigned quantity) {
  Bytes pdu = {function};
  put(pdu, first);
  put(pdu, quantity);
  return pdu;
}

Bytes write_pdu(unsigned first, unsigned quantity) {
  Bytes pdu = read_pdu(16, first, quantity);
  pdu.push_back(static_cast<std::uint8_t>(2 * quantity));
  pdu.resize(pdu.size() + 2 * quantity);
  return pdu;
}

Bytes read_write_pdu(unsigned read_first, unsigned read_quantity, unsigned first, unsigned quantity) {
  Bytes pdu = read_pdu(23, read_first, read_quantity);
  put(pdu, first);
  put(pdu, quantity);
  pdu.push_back(static_cast<std::uint8_t>(2 * quantity));
  pdu.resize(pdu.size() + 2 * quantity);
  return pdu;
}

/// Exception code of the answer; 0 if it was served.
int refusal(const Bytes& pdu, std::uint8_t unit = 1) {
  const RequestCheck check = check_request(frame(unit, pdu), 1);
  EXPECT_FALSE(check.refusal && (check.writes || check.writes_command));
  return check.refusal ? static_cast<int>(*check.refusal) : 0;
}

/// True if every register of [first, first + quantity) is in [low, high); checked one at a time.
bool all_inside(unsigned first, unsigned quantity, unsigned low, unsigned high) {
  for (unsigned r = first; r < first + quantity; ++r)
    if (r < low || r >= high) return false;
  return true;
}

TEST(ModbusCodec, reads_are_allowed_exactly_where_the_map_is) {
  for (unsigned first = 0; first < 1200; first += (first < 130 || first > 980) ? 1 : 50) {
    for (const unsigned quantity : {1U, 2U, 30U, 75U, 76U, 109U, 110U, 111U, 125U}) {
      const bool holding = all_inside(first, quantity, 0, 75) || all_inside(first, quantity, 1000, 1110);
      EXPECT_EQ(refusal(read_pdu(3, first, quantity)), holding ? 0 : 2) << first << " " << quantity;
      EXPECT_EQ(refusal(read_pdu(4, first, quantity)), all_inside(first, quantity, 0, 110) ? 0 : 2)
          << first << " " << quantity;
    }
  }
  EXPECT_EQ(refusal(read_pdu(4, 0xFFFF, 125)), 2) << "must not wrap";
}

TEST(ModbusCodec, quantities_outside_the_standard_are_exception_3) {
  for (const unsigned quantity : {0U, 126U, 255U, 0x8000U, 0xFFFFU}) {
    EXPECT_EQ(refusal(read_pdu(3, 0, quantity)), 3) << quantity;
    EXPECT_EQ(refusal(read_pdu(4, 0, quantity)), 3) << quantity;
  }
  EXPECT_EQ(refusal(write_pdu(0, 0)), 3);
  EXPECT_EQ(refusal(write_pdu(0, 124)), 3);
  EXPECT_EQ(refusal(read_write_pdu(0, 1, 0, 122)), 3);
  EXPECT_EQ(refusal(read_write_pdu(0, 126, 0, 1)), 3);
  EXPECT_EQ(refusal(read_write_pdu(0, 0, 0, 1)), 3);
}

TEST(ModbusCodec, writes_are_allowed_exactly_to_the_plcs_registers_and_mark_the_command_block) {
  for (unsigned first = 0; first < 1110; ++first) {
    for (const unsigned quantity : {1U, 4U, 10U, 11U, 30U, 35U, 75U, 76U}) {
      const RequestCheck check = check_request(frame(1, write_pdu(first, quantity)), 1);
      const bool inside = all_inside(first, quantity, 0, 75);
      EXPECT_EQ(!check.refusal.has_value(), inside) << first << " " << quantity;
      if (!inside) {
        EXPECT_EQ(*check.refusal, ModbusException::illegal_address);
        continue;
      }
      EXPECT_TRUE(check.writes);
      EXPECT_EQ(check.writes_command, !all_inside(first, quantity, 0, 10) && !all_inside(first, quantity, 40, 75))
          << first << " " << quantity;
      const RequestCheck both = check_request(frame(1, read_write_pdu(1000, 110, first, quantity)), 1);
      EXPECT_EQ(both.writes_command, check.writes_command);
    }
    EXPECT_EQ(refusal(read_pdu(6, first, 7)), first < 75 ? 0 : 2);
  }
  EXPECT_EQ(refusal(read_write_pdu(0, 76, 0, 1)), 2);
  EXPECT_FALSE(check_request(frame(1, read_pdu(3, 0, 40)), 1).writes);
}

TEST(ModbusCodec, every_other_function_is_exception_1) {
  for (unsigned function = 0; function < 256; ++function) {
    Bytes pdu = read_pdu(static_cast<std::uint8_t>(function), 0, 1);
    const bool known = function == 3 || function == 4 || function == 6 || function == 16 || function == 23;
    EXPECT_EQ(refusal(pdu) == 1, !known) << function;
    EXPECT_EQ(refusal({static_cast<std::uint8_t>(function)}), known ? 3 : 1) << "a PDU of one byte, " << function;
  }
}

TEST(ModbusCodec, a_length_that_does_not_fit_the_function_is_exception_3) {
  for (Bytes pdu :
       {read_pdu(3, 0, 1), read_pdu(4, 0, 1), read_pdu(6, 0, 1), write_pdu(0, 2), read_write_pdu(0, 1, 0, 2)}) {
    const Bytes good = pdu;
    EXPECT_EQ(refusal(good), 0);
    pdu.push_back(0);
    EXPECT_EQ(refusal(pdu), 3);
    for (std::size_t bytes = 1; bytes < good.size(); ++bytes)
      EXPECT_EQ(refusal(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(bytes))), 3);
  }
  Bytes wrong_count = write_pdu(0, 2);
  wrong_count[5] = 2;
  EXPECT_EQ(refusal(wrong_count), 3);
}

TEST(ModbusCodec, only_its_own_unit_0_and_255_are_answered) {
  for (unsigned unit = 0; unit < 256; ++unit) {
    const bool ours = unit == 1 || unit == 0 || unit == 255;
    EXPECT_EQ(refusal(read_pdu(4, 0, 1), static_cast<std::uint8_t>(unit)), ours ? 0 : 11) << unit;
  }
}

TEST(ModbusCodec, frame_length_is_accepted_between_2_and_254_under_protocol_0_only) {
  for (unsigned length = 0; length < 0x10000; ++length) {
    const std::array<std::uint8_t, 6> head = {
        9, 9, 0, 0, static_cast<std::uint8_t>(length >> 8U), static_cast<std::uint8_t>(length & 255U)};
    const auto bytes = frame_bytes(head);
    ASSERT_EQ(bytes.has_value(), length >= 2 && length <= 254) << length;
    ASSERT_EQ(bytes.value_or(6 + length), 6 + length);
  }
  EXPECT_FALSE(frame_bytes(std::array<std::uint8_t, 6>{0, 1, 0, 1, 0, 6}).has_value());
  EXPECT_FALSE(frame_bytes(std::array<std::uint8_t, 6>{0, 1, 1, 0, 0, 6}).has_value());
}

TEST(ModbusCodec, refusals_are_the_standards) {
  const std::array<std::uint8_t, 2> expected = {0x84, 3};
  EXPECT_EQ(exception_pdu(4, ModbusException::illegal_value), expected);
}

Bytes answered(const Bytes& pdu, RegisterBank& bank) {
  EXPECT_FALSE(check_pdu(pdu).refusal.has_value());
  std::array<std::uint8_t, kPduBytesMax> reply{};
  const std::size_t bytes = answer_pdu(pdu, bank, reply);
  return {reply.begin(), reply.begin() + static_cast<std::ptrdiff_t>(bytes)};
}

RegisterBank numbered_bank() {
  RegisterBank bank;
  for (std::size_t i = 0; i < bank.holding.size(); ++i) bank.holding[i] = static_cast<std::uint16_t>(0x0100 + i);
  for (std::size_t i = 0; i < bank.input.size(); ++i) bank.input[i] = static_cast<std::uint16_t>(0x2000 + i);
  return bank;
}

TEST(ModbusCodec, every_register_answers_with_its_own_value_on_every_way) {
  RegisterBank bank = numbered_bank();
  for (unsigned i = 0; i < 110; ++i) {
    const Bytes value = {2, 0x20, static_cast<std::uint8_t>(i)};
    Bytes expected = {4};
    expected.insert(expected.end(), value.begin(), value.end());
    EXPECT_EQ(answered(read_pdu(4, i, 1), bank), expected);
    expected[0] = 3;
    EXPECT_EQ(answered(read_pdu(3, 1000 + i, 1), bank), expected) << "mirrored";
  }
  for (unsigned i = 0; i < 40; ++i)
    EXPECT_EQ(answered(read_pdu(3, i, 1), bank), (Bytes{3, 2, 1, static_cast<std::uint8_t>(i)}));
  const Bytes all = answered(read_pdu(4, 0, 110), bank);
  ASSERT_EQ(all.size(), 222U);
  EXPECT_EQ(all[1], 220);
  EXPECT_EQ(all[221], 109);
}

TEST(ModbusCodec, writes_change_only_the_registers_that_they_name) {
  RegisterBank bank = numbered_bank();
  const RegisterBank before = bank;
  EXPECT_EQ(answered({6, 0, 39, 0xAB, 0xCD}, bank), (Bytes{6, 0, 39, 0xAB, 0xCD}));
  EXPECT_EQ(bank.holding[39], 0xABCD);
  bank.holding[39] = before.holding[39];
  EXPECT_EQ(bank.holding, before.holding);
  EXPECT_EQ(answered({16, 0, 10, 0, 2, 4, 1, 2, 3, 4}, bank), (Bytes{16, 0, 10, 0, 2}));
  EXPECT_EQ(bank.holding[10], 0x0102);
  EXPECT_EQ(bank.holding[11], 0x0304);
  EXPECT_EQ(bank.holding[12], before.holding[12]);
  // FC 23 writes first (specification 6.17), so the read returns the new value.
  EXPECT_EQ(answered({23, 0, 0, 0, 2, 0, 1, 0, 1, 2, 0x77, 0x66}, bank), (Bytes{23, 4, 1, 0, 0x77, 0x66}));
  EXPECT_EQ(bank.input, before.input);
}

TEST(ModbusRtu, lengths_come_from_the_first_bytes) {
  const auto length = [](Bytes begin) { return rtu_request_bytes(begin); };
  EXPECT_EQ(length({17}), 0U);
  EXPECT_EQ(length({17, 4}), 8U);
  EXPECT_EQ(length({17, 6}), 8U);
  EXPECT_EQ(length({17, 16, 0, 0, 0}), 0U) << "not known yet";
  EXPECT_EQ(length({17, 16, 0, 0, 0, 2, 4}), 13U);
  EXPECT_EQ(length({17, 23, 0, 0, 0, 1, 0, 0, 0, 1, 2}), 15U);
  EXPECT_EQ(length({17, 7, 0x4C, 0x22}), 0U) << "not served";
}

TEST(ModbusRtu, the_checksum_is_the_standards) {
  // Serial line specification, appendix B: the CRC of 02 07 is 0x1241, sent as 41 12.
  std::array<std::uint8_t, kRtuBytesMax> frame = {0x02, 0x07};
  ASSERT_EQ(rtu_close(frame, 2), 4U);
  EXPECT_EQ(frame[2], 0x41);
  EXPECT_EQ(frame[3], 0x12);
  const auto whole = std::span<const std::uint8_t>(frame).first(4);
  EXPECT_TRUE(rtu_intact(whole));
  EXPECT_FALSE(rtu_intact(whole.first(3)));
  for (std::size_t i = 0; i < 4; ++i)
    for (unsigned bit = 0; bit < 8; ++bit) {
      frame[i] = static_cast<std::uint8_t>(frame[i] ^ (1U << bit));
      EXPECT_FALSE(rtu_intact(whole));
      frame[i] = static_cast<std::uint8_t>(frame[i] ^ (1U << bit));
    }
}

}  // namespace
}  // namespace slabd::hal
