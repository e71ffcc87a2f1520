// SPDX-License-Identifier: Apache-2.0
//
// Problem: every byte of a scan, 60 MB for each block, passes this checksum on the way from trigger to verdict.
// Idea: the processor's instruction processes eight bytes a cycle, but its latency is three cycles. So three stretches
// of the same length are processed in parallel. A table with the effect of appended zero bytes on a checksum combines
// the three results (Gopal et al., Intel 2011). Without the instruction, slicing by eight is used (Kounavis and Berry
// 2008). Both give the same value.
#include "hal/system/crc32c.h"

#include <array>
#include <bit>
#include <cstring>

#ifdef __x86_64__
#include <nmmintrin.h>
#endif

namespace slabd::hal {
namespace {

static_assert(std::endian::native == std::endian::little, "eight bytes are read as one little-endian number");

using Row = std::array<std::uint32_t, 256>;

constexpr std::array<Row, 8> make_tables() {
  std::array<Row, 8> tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1U) ^ ((crc & 1U) != 0 ? 0x82F6'3B78U : 0U);
    tables[0][i] = crc;
  }
  for (std::size_t t = 1; t < 8; ++t)
    for (std::size_t i = 0; i < 256; ++i) tables[t][i] = (tables[t - 1][i] >> 8U) ^ tables[0][tables[t - 1][i] & 255U];
  return tables;
}

constexpr std::array<Row, 8> kTables = make_tables();

constexpr std::uint32_t byte_by_byte(std::uint32_t crc, std::byte b) {
  return (crc >> 8U) ^ kTables[0][(crc ^ std::to_integer<std::uint32_t>(b)) & 255U];
}

std::uint64_t word_at(const std::byte* from) {
  std::uint64_t word = 0;
  std::memcpy(&word, from, sizeof word);
  return word;
}

std::uint32_t by_tables(std::span<const std::byte> bytes, std::uint32_t crc) {
  while (bytes.size() >= 8) {
    const std::uint64_t word = word_at(bytes.data()) ^ crc;
    crc = 0;
    for (std::size_t i = 0; i < 8; ++i) crc ^= kTables[7 - i][(word >> (8 * i)) & 255U];
    bytes = bytes.subspan(8);
  }
  for (const std::byte b : bytes) crc = byte_by_byte(crc, b);
  return crc;
}

#ifdef __x86_64__

/// Bytes of one of the three stretches. A piece of a scan has many of them, and combining them (eight look-ups) costs
/// little in comparison.
constexpr std::size_t kStretch = 2'048;

/// [k][b]: checksum after kStretch zero bytes if its byte k is b and the others are zero.
constexpr std::array<Row, 4> make_shifts() {
  // The checksum is linear: 32 columns, one for each bit, squared until they represent kStretch bytes.
  std::array<std::uint32_t, 32> columns{};
  for (std::size_t bit = 0; bit < 32; ++bit) columns[bit] = byte_by_byte(std::uint32_t{1} << bit, std::byte{0});
  const auto times = [](const std::array<std::uint32_t, 32>& m, std::uint32_t vector) {
    std::uint32_t sum = 0;
    for (std::size_t bit = 0; bit < 32; ++bit)
      if (((vector >> bit) & 1U) != 0) sum ^= m[bit];
    return sum;
  };
  for (std::size_t bytes = 1; bytes < kStretch; bytes *= 2) {
    std::array<std::uint32_t, 32> squared{};
    for (std::size_t bit = 0; bit < 32; ++bit) squared[bit] = times(columns, columns[bit]);
    columns = squared;
  }
  std::array<Row, 4> shifts{};
  for (std::size_t k = 0; k < 4; ++k)
    for (std::uint32_t b = 0; b < 256; ++b) shifts[k][b] = times(columns, b << (8 * k));
  return shifts;
}
static_assert(std::has_single_bit(kStretch), "squaring doubles");

constexpr std::array<Row, 4> kShifts = make_shifts();

std::uint32_t shifted(std::uint64_t crc) {
  return kShifts[0][crc & 255U] ^ kShifts[1][(crc >> 8U) & 255U] ^ kShifts[2][(crc >> 16U) & 255U] ^
         kShifts[3][(crc >> 24U) & 255U];
}

__attribute__((target("sse4.2"))) std::uint32_t by_instruction(std::span<const std::byte> bytes, std::uint32_t crc) {
  const std::byte* from = bytes.data();
  std::size_t left = bytes.size();
  for (; left >= 3 * kStretch; left -= 3 * kStretch, from += 3 * kStretch) {
    std::uint64_t a = crc;
    std::uint64_t b = 0;
    std::uint64_t c = 0;
    for (std::size_t i = 0; i < kStretch; i += 8) {
      a = _mm_crc32_u64(a, word_at(from + i));
      b = _mm_crc32_u64(b, word_at(from + kStretch + i));
      c = _mm_crc32_u64(c, word_at(from + 2 * kStretch + i));
    }
    crc = shifted(shifted(a) ^ b) ^ static_cast<std::uint32_t>(c);
  }
  std::uint64_t rest = crc;
  for (; left >= 8; left -= 8, from += 8) rest = _mm_crc32_u64(rest, word_at(from));
  crc = static_cast<std::uint32_t>(rest);
  for (; left > 0; --left, ++from) crc = _mm_crc32_u8(crc, std::to_integer<std::uint8_t>(*from));
  return crc;
}

bool has_instruction() {
  static const bool has = __builtin_cpu_supports("sse4.2") != 0;
  return has;
}

#endif

}  // namespace

std::uint32_t crc32c(std::span<const std::byte> bytes, std::uint32_t before) {
#ifdef __x86_64__
  if (has_instruction()) return ~by_instruction(bytes, ~before);
#endif
  return crc32c_by_tables(bytes, before);
}

std::uint32_t crc32c_by_tables(std::span<const std::byte> bytes, std::uint32_t before) {
  return ~by_tables(bytes, ~before);
}

}  // namespace slabd::hal
