// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/plain_rows.h"

#include <array>
#include <bit>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <limits>

#include "hal/scan/scan_points.h"
#include "hal/scan/text_lines.h"

// Problem: 130 MB of text are 15 million numbers. A reader that tests each character and mispredicts the end of every
// number takes half a second. Idea: process eight characters as one 64-bit word. The number of digits is the position
// of the first byte that is not a digit; three multiplications give their value for any number of digits. So a number
// costs a dozen operations in front of the decimal point and a dozen after it, without a branch that depends on its
// length. Its value m * 10^k is then one exact integer times one exact power of ten. Invariant: in doubt the row is not
// plain, and it is left to the ordinary reader.
namespace slabd::hal {
namespace {

static_assert(std::endian::native == std::endian::little, "the first character is the lowest byte");

constexpr std::array<std::uint64_t, 17> integer_powers() {
  std::array<std::uint64_t, 17> power{};
  power[0] = 1;
  for (std::size_t k = 1; k < power.size(); ++k) power[k] = 10 * power[k - 1];
  return power;
}
constexpr std::array<std::uint64_t, 17> kIntegerPowers = integer_powers();
/// 10^22 is the largest power of ten that a double represents exactly.
constexpr int kExactPowerMax = 22;
constexpr std::array<double, kExactPowerMax + 1> kPowers = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                                            1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                                            1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
/// 2^64 * 10^18 is less than the largest float.
constexpr int kUpwardPowerMax = 18;

struct Digits {
  std::uint64_t value = 0;
  unsigned count = 0;  ///< 0..8
};

/// Digits, at most eight, that start at `text`.
[[gnu::always_inline]] inline Digits digits_at(const char* text) {
  std::uint64_t word = 0;
  std::memcpy(&word, text, sizeof word);
  word ^= 0x3030'3030'3030'3030U;  // digits are now 0..9, all other characters are larger
  // The high bit of every byte above 9; a carry reaches only bytes after one that is already marked.
  const std::uint64_t others = ((word + 0x7676'7676'7676'7676U) | word) & 0x8080'8080'8080'8080U;
  const unsigned count = static_cast<unsigned>(std::countr_zero(others)) / 8;  // 64 / 8 if all are digits
  // Shifts out the characters after the digits and fills with zeros in front.
  word = count == 0 ? 0 : word << (64 - 8 * count);
  word = word * 10 + (word >> 8U);  // pairs, in every second byte
  constexpr std::uint64_t kPairs = 0x0000'00FF'0000'00FFU;
  word = (((word & kPairs) * (100 + (1'000'000ULL << 32U))) + (((word >> 16U) & kPairs) * (1 + (10'000ULL << 32U)))) >>
         32U;
  return {word, count};
}

/// m * 10^exponent, with its sign.
struct Decimal {
  std::uint64_t m = 0;
  int exponent = 0;
  bool negative = false;
  bool missing = false;  ///< "nan"
};

/// Digits in front of the decimal point, at most eight, one by one. Their number hardly changes from row to row, so the
/// branch is predicted and the processor does not wait for the count.
[[gnu::always_inline]] inline const char* whole_digits(const char* p, std::uint64_t& value, unsigned& count) {
  value = 0;
  for (count = 0; count < 8; ++count, ++p) {
    const unsigned digit = static_cast<unsigned char>(*p) - unsigned{'0'};
    if (digit > 9) break;
    value = 10 * value + digit;
  }
  return p;
}

/// Reads one number; returns its end, or null if it is not plain. Looks at most 40 bytes ahead.
[[gnu::always_inline]] inline const char* scan_decimal(const char* p, Decimal& number) {
  number.negative = false;
  if (*p == '-') {
    number.negative = true;
    ++p;
  } else if (*p == '+') {
    ++p;
  }
  unsigned whole = 0;
  unsigned decimals = 0;
  p = whole_digits(p, number.m, whole);
  const bool has_point = *p == '.';
  if (has_point) {
    ++p;
    const Digits part = digits_at(p);
    p += part.count;
    decimals = part.count;
    const std::uint64_t in_front = number.m;
    number.m = in_front * kIntegerPowers[part.count] + part.value;
    if (part.count == 8) {
      const Digits more = digits_at(p);
      p += more.count;
      decimals += more.count;
      // 3 digits and 16 are less than 2^64.
      if (more.count != 0 && in_front > 999) return nullptr;
      number.m = number.m * kIntegerPowers[more.count] + more.value;
    }
  }
  number.exponent = -static_cast<int>(decimals);
  number.missing = false;
  if (whole + decimals == 0) {
    number.missing = (p[0] | 0x20) == 'n' && (p[1] | 0x20) == 'a' && (p[2] | 0x20) == 'n' && !has_point;
    return number.missing ? p + 3 : nullptr;
  }
  if ((*p | 0x20) == 'e') {
    ++p;
    const bool downward = *p == '-';
    p += *p == '-' || *p == '+' ? 1 : 0;
    const Digits power = digits_at(p);
    if (power.count == 0 || power.count > 3) return nullptr;
    p += power.count;
    number.exponent += downward ? -static_cast<int>(power.value) : static_cast<int>(power.value);
  }
  return p;
}

/// False if the rounding is not certain; fast_float is used then.
template <typename Real>
[[gnu::always_inline]] inline bool round_exactly(const Decimal& number, double mm_per_unit, Real& out) {
  if (number.missing) {
    out = std::numeric_limits<Real>::quiet_NaN();
    return true;
  }
  if (number.exponent < -kExactPowerMax || number.exponent > kUpwardPowerMax) return false;
  double value = static_cast<double>(number.m);
  if (number.exponent < 0) {
    value /= kPowers[static_cast<std::size_t>(-number.exponent)];
  } else {
    value *= kPowers[static_cast<std::size_t>(number.exponent)];
  }
  constexpr std::uint64_t kExactMax = std::uint64_t{1} << 53U;
  if (std::same_as<Real, float> && mm_per_unit == 1.0) {
    // Two roundings of at most half a unit each (m as a double, the power): `value` is at most 4 steps of a double from
    // the number. If no midpoint between two floats (the 29 bits a float lacks: 1 0000...) is that near, both round to
    // the same float. The result is a normal float or zero: 1e-22 <= value < 2e37.
    constexpr std::uint64_t kLacking = (std::uint64_t{1} << 29U) - 1;
    constexpr std::uint64_t kHalfWay = std::uint64_t{1} << 28U;
    constexpr std::uint64_t kSteps = 8;
    const std::uint64_t below = std::bit_cast<std::uint64_t>(value) & kLacking;
    if (below - (kHalfWay - kSteps) <= 2 * kSteps) return false;
    out = static_cast<Real>(number.negative ? -value : value);
    return true;
  }
  // m and the power are exact, so one rounding gives the nearest double (Clinger 1990).
  if (number.m > kExactMax) return false;
  out = coordinate_mm<Real>(number.negative ? -value : value, mm_per_unit);
  return true;
}

/// Text, form and unit of one call.
template <typename Real>
class PlainReader {
 public:
  PlainReader(std::string_view text, const PlainRowForm& form, double mm_per_unit)
      : begin_(text.data()), end_(text.data() + text.size()), form_(form), mm_(mm_per_unit) {}

  template <bool kBlanks>
  PlainRows read(Real* xyz, std::size_t rows_max) const {
    PlainRows done;
    for (const char* p = begin_; done.rows < rows_max; ++done.rows, xyz += 3) {
      p = row<kBlanks>(p, xyz);
      if (p == nullptr) break;
      done.bytes = static_cast<std::size_t>(p - begin_);
    }
    return done;
  }

 private:
  [[nodiscard]] bool is_blank(char c) const { return c == ' ' || (c == '\t' && form_.separator != Separator::tab); }
  [[nodiscard]] const char* past_blanks(const char* p) const {
    while (p < end_ && is_blank(*p)) ++p;
    return p;
  }

  /// Reads one row and returns the start of the next; null if it is not plain.
  template <bool kBlanks>
  const char* row(const char* p, Real* xyz) const {
    p = past_blanks(p);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (end_ - p < static_cast<std::ptrdiff_t>(kPlainRowTail)) return nullptr;
      Decimal number;
      p = scan_decimal(p, number);
      if (p == nullptr || !round_exactly(number, mm_, xyz[axis])) return nullptr;
      if (axis == 2) break;
      if constexpr (kBlanks) {
        if (!is_blank(*p)) return nullptr;
        ++p;
      } else {
        p = past_blanks(p);
        if (p == end_ || *p != static_cast<char>(form_.separator)) return nullptr;
        ++p;
      }
      p = past_blanks(p);
    }
    return *p == '\n' && form_.words_more == 0 ? p + 1 : line_end<kBlanks>(p);
  }

  /// Returns the start of the next row from the end of z.
  template <bool kBlanks>
  const char* line_end(const char* p) const {
    p = form_.any_more ? any_more<kBlanks>(p) : words_more(p);
    if (p == nullptr || p == end_) return nullptr;
    if (*p == '\r') ++p;
    return p != end_ && *p == '\n' ? p + 1 : nullptr;
  }

  const char* words_more(const char* p) const {
    for (std::size_t word = 0; word < form_.words_more; ++word) {
      const char* const begin = past_blanks(p);
      if (begin == p) return nullptr;
      for (p = begin; p < end_ && !is_blank(*p) && *p != '\r' && *p != '\n';) ++p;
      if (begin == p) return nullptr;
    }
    return past_blanks(p);
  }

  /// Skips the rest of the line, if z ends at a separator.
  template <bool kBlanks>
  const char* any_more(const char* p) const {
    const char* const behind = past_blanks(p);
    if (behind == end_) return nullptr;
    if (*behind == '\r' || *behind == '\n') return behind;
    const bool field_ends = kBlanks ? behind != p : *behind == static_cast<char>(form_.separator);
    if (!field_ends) return nullptr;
    const auto room = std::min<std::size_t>(static_cast<std::size_t>(end_ - behind), kTextLineBytesMax / 2);
    const char* const newline = static_cast<const char*>(std::memchr(behind, '\n', room));
    if (newline == nullptr) return nullptr;
    // Lost parts of a disk are read as zeros: rows may be missing between here and the end of that line.
    if (std::memchr(behind, '\0', static_cast<std::size_t>(newline - behind)) != nullptr) return nullptr;
    return newline[-1] == '\r' ? newline - 1 : newline;
  }

  const char* begin_;
  const char* end_;
  PlainRowForm form_;
  double mm_;
};

}  // namespace

template <typename Real>
PlainRows read_plain_rows(std::string_view text, const PlainRowForm& form, double mm_per_unit, Real* xyz,
                          std::size_t rows_max) {
  const PlainReader<Real> reader(text, form, mm_per_unit);
  return form.separator == Separator::blanks ? reader.template read<true>(xyz, rows_max)
                                             : reader.template read<false>(xyz, rows_max);
}

template PlainRows read_plain_rows(std::string_view, const PlainRowForm&, double, float*, std::size_t);
template PlainRows read_plain_rows(std::string_view, const PlainRowForm&, double, double*, std::size_t);

}  // namespace slabd::hal
