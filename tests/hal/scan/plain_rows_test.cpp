// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/plain_rows.h"

#include <gtest/gtest.h>

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "hal/scan/text_lines.h"
#include "tests/hal/scan/scan_reading.h"

// Compares the fast path of tables with the C library, number by number: the same bits, or left to the slow path.
namespace slabd::hal {
namespace {

using test::bytes_of;

/// Numbers in the spellings of programs, people and attackers.
std::string spelling(Prng& prng) {
  const auto digits = [&](std::uint64_t count) {
    std::string text;
    for (std::uint64_t i = 0; i < count; ++i) text += static_cast<char>('0' + prng.below(10));
    return text;
  };
  char text[400];
  const double value = prng.normal() * std::pow(10.0, static_cast<double>(prng.below(9)) - 4.0);
  switch (prng.below(8)) {
    case 0: std::snprintf(text, sizeof text, "%.*f", static_cast<int>(prng.below(12)), value); return text;
    case 1: std::snprintf(text, sizeof text, "%.9g", static_cast<double>(static_cast<float>(value))); return text;
    case 2: std::snprintf(text, sizeof text, "%.17g", value); return text;
    case 3: std::snprintf(text, sizeof text, "%.*e", static_cast<int>(prng.below(20)), value); return text;
    case 4:  // half way between two floats, or close to it, where double rounding fails
    {
      const auto f = static_cast<float>(value);
      const double middle = 0.5 * (double{f} + double{std::nextafter(f, INFINITY)});
      std::snprintf(text, sizeof text, "%.*f", 3 + static_cast<int>(prng.below(40)), middle);
      return text;
    }
    case 5: return (prng.below(2) == 0 ? "-" : "+") + digits(prng.below(12)) + "." + digits(1 + prng.below(22));
    case 6: {
      std::string number = digits(1 + prng.below(4));
      if (prng.below(2) == 0) number += "." + digits(prng.below(18));
      std::snprintf(text, sizeof text, "%s%c%d", number.c_str(), prng.below(2) == 0 ? 'e' : 'E',
                    static_cast<int>(prng.below(120)) - 60);
      return text;
    }
    default: {
      static const char* const kOdd[] = {"nan",
                                         "NaN",
                                         "-nan",
                                         "+nan",
                                         "0",
                                         "-0",
                                         "-0.0",
                                         "00012.50",
                                         "1.",
                                         ".5",
                                         "1e-45",
                                         "1e-40",
                                         "1.17549435e-38",
                                         "3.4028235e38",
                                         "3.4028236e38",
                                         "1e39",
                                         "16777217",
                                         "16777219",
                                         "9007199254740993",
                                         "18446744073709551615",
                                         "0.00000000000000000000001",
                                         "123456789.123456789",
                                         "99999999.5",
                                         "1e22",
                                         "-1e-22",
                                         "1e23",
                                         "8.5e+18"};
      return kOdd[prng.below(std::size(kOdd))];
    }
  }
}

template <typename Real>
bool same_bits(Real a, Real b) {
  return std::isnan(a) ? std::isnan(b) : bytes_of(a) == bytes_of(b);
}

/// Result of the C library: the value nearest to the text.
void plainly(const std::string& text, double mm_per_unit, float& value) {
  value = mm_per_unit == 1.0 ? std::strtof(text.c_str(), nullptr)
                             : static_cast<float>(std::strtod(text.c_str(), nullptr) * mm_per_unit);
}
void plainly(const std::string& text, double mm_per_unit, double& value) {
  value = std::strtod(text.c_str(), nullptr) * mm_per_unit;
}

/// Reads `count` rows at a time, so that fast and slow rows are mixed. Returns the share read on the fast path.
template <typename Real>
double compare_numbers(int numbers, double mm_per_unit, std::uint64_t seed) {
  Prng prng(seed);
  int plain_rows = 0;
  const std::string tail(kPlainRowTail, '\n');
  for (int i = 0; i < numbers / 3; ++i) {
    const std::array<std::string, 3> word = {spelling(prng), spelling(prng), spelling(prng)};
    std::array<Real, 3> fast{};
    const PlainRows plain = read_plain_rows(word[0] + " " + word[1] + " " + word[2] + "\n" + tail, PlainRowForm{},
                                            mm_per_unit, fast.data(), 1);
    plain_rows += plain.rows == 1 ? 1 : 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      Real expected{};
      plainly(word[axis], mm_per_unit, expected);
      Real slow{};
      EXPECT_TRUE(parse_coordinate(word[axis], mm_per_unit, slow)) << word[axis];
      EXPECT_TRUE(same_bits(slow, expected)) << word[axis] << " slow " << slow << " expected " << expected;
      EXPECT_TRUE(plain.rows == 0 || same_bits(fast[axis], expected))
          << word[axis] << " fast " << fast[axis] << " expected " << expected;
      if (testing::Test::HasFailure()) return 0.0;
    }
  }
  return 3.0 * plain_rows / numbers;
}

TEST(PlainRows, numbers_have_the_bits_that_the_c_library_gives_them) {
  EXPECT_GT(compare_numbers<float>(1'500'000, 1.0, 1), 0.2);
  EXPECT_GT(compare_numbers<double>(600'000, 1.0, 2), 0.1);
  EXPECT_GT(compare_numbers<float>(300'000, 1000.0, 3), 0.1);
  EXPECT_GT(compare_numbers<double>(300'000, 0.001, 4), 0.1);
}

TEST(PlainRows, floats_written_with_the_fewest_digits_are_read_back_and_mostly_by_the_fast_path) {
  Prng prng(5);
  std::string text;
  std::vector<float> wanted;
  for (int i = 0; i < 300'000; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto value = static_cast<float>((prng.uniform() - 0.5) * 1'400.0);
      wanted.push_back(value);
      char number[40];
      const auto end = std::to_chars(number, number + sizeof number, value).ptr;
      text.append(number, end);
      text += axis == 2 ? '\n' : ' ';
    }
  }
  text.append(kPlainRowTail, '\n');
  std::vector<float> read(wanted.size());
  std::size_t rows = 0;
  std::string_view rest = text;
  int stops = 0;
  while (rows < 300'000) {
    const PlainRows plain = read_plain_rows(rest, PlainRowForm{}, 1.0, &read[3 * rows], 300'000 - rows);
    rest.remove_prefix(plain.bytes);
    rows += plain.rows;
    if (rows == 300'000) break;
    ASSERT_LT(++stops, 100) << "left to the slow way";
    const std::string_view line = rest.substr(0, rest.find('\n'));
    std::string_view words = line;
    for (std::size_t axis = 0; axis < 3; ++axis)
      ASSERT_TRUE(parse_coordinate(take_word(words), 1.0, read[3 * rows + axis])) << line;
    rest.remove_prefix(line.size() + 1);
    ++rows;
  }
  EXPECT_EQ(read, wanted);
}

/// Number of rows that the fast path reads from `text`; the buffer is just large enough for them.
std::size_t rows_of(const std::string& text, const PlainRowForm& form) {
  std::vector<float> xyz(3 * 16);
  const PlainRows plain = read_plain_rows(text + std::string(kPlainRowTail, 'x'), form, 1.0, xyz.data(), 16);
  EXPECT_TRUE(plain.bytes == 0 || text[plain.bytes - 1] == '\n');
  return plain.rows;
}

TEST(PlainRows, only_rows_of_the_form_are_taken) {
  const PlainRowForm three;
  const PlainRowForm table{Separator::blanks, true, 0};
  const PlainRowForm colour{Separator::blanks, false, 3};
  const PlainRowForm comma{Separator::comma, true, 0};
  const PlainRowForm tab{Separator::tab, true, 0};
  EXPECT_EQ(rows_of("1 2 3\r\n  -4\t5   6 \n7 8 9\n", three), 3U);
  EXPECT_EQ(rows_of("1 2 3\n4 5 6 7\n", three), 1U);
  EXPECT_EQ(rows_of("1 2 3 # note\n4 5 6 7 8\n1 2 3x\n", table), 2U);
  EXPECT_EQ(rows_of("1 2 3 255 0 7\n4 5 6 7 8 \r\n1 2 3 4 5 6 7\n", colour), 1U);
  EXPECT_EQ(rows_of("1,2,3\n4 , 5,6,rest\n1;2;3\n", comma), 2U);
  EXPECT_EQ(rows_of("1\t2\t3\n4 \t5\t6\tmore\n\t2\t3\n", tab), 2U);
  for (const std::string row : {"\n1 2 3\n", "# 1 2 3\n", "1 2\n3 4 5\n", "1,2 3 4\n", "1 2 3,\n", "a 2 3\n",
                                "1.2.3 4 5\n", "1e 2 3\n", "1 2 0x3\n", "- 2 3\n", "+-1 2 3\n", ". 2 3\n", "1 2 3",
                                "1 2 nan(ind)\n", "1 2 3\r4 5 6\n", "inf 2 3\n", "1..2 3 4\n", ".nan 1 2\n"})
    EXPECT_EQ(rows_of(row, three), 0U) << row;
}

TEST(PlainRows, reads_no_byte_after_the_end_of_the_text) {
  // Each text ends directly before an inaccessible page.
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  auto* const two =
      static_cast<char*>(mmap(nullptr, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  ASSERT_NE(static_cast<void*>(two), MAP_FAILED);
  ASSERT_EQ(mprotect(two + page, page, PROT_NONE), 0);
  Prng prng(6);
  for (int i = 0; i < 20'000; ++i) {
    std::string text;
    for (std::uint64_t rows = prng.below(5) + 1; rows > 0; --rows)
      text += spelling(prng) + " " + spelling(prng) + std::string(prng.below(30), ' ') + " " + spelling(prng) + "\n";
    text.resize(text.size() - prng.below(std::min<std::size_t>(text.size(), 60)));
    char* const begin = two + page - text.size();
    std::memcpy(begin, text.data(), text.size());
    std::array<float, 3 * 8> xyz{};
    const PlainRows plain = read_plain_rows({begin, text.size()}, PlainRowForm{}, 1.0, xyz.data(), 8);
    ASSERT_LE(plain.bytes, text.size());
  }
  munmap(two, 2 * page);
}

TEST(PlainRows, a_scan_reads_the_same_with_and_without_them) {
  // The same rows once plain and once with a column in front, which only the slow path reads.
  Prng prng(7);
  std::string plain = "# scan\r\nx y z i\n";
  std::string other = "# scan\r\ni x y z\n";
  for (int i = 0; i < 40'000; ++i) {
    const std::string row = spelling(prng) + " " + spelling(prng) + " " + spelling(prng);
    const std::string end = prng.below(3) == 0 ? "\r\n" : "\n";
    plain += row + " 7" + end;
    other += "7 " + row + end;
    if (prng.below(50) == 0) plain += "# between\n";
    if (prng.below(50) == 0) other += "\n";
  }
  plain.pop_back();
  for (const LengthUnit unit : {LengthUnit::mm, LengthUnit::m, LengthUnit::um}) {
    const test::Read a = test::read_bytes(plain, "a.xyz", unit, 40'000);
    const test::Read b = test::read_bytes(other, "b.xyz", unit, 40'000);
    ASSERT_TRUE(a.shape.ok() && b.shape.ok()) << a.why() << b.why();
    EXPECT_EQ(a.shape.value().points, 40'000U);
    EXPECT_EQ(a.shape.value().finite, b.shape.value().finite);
    EXPECT_GT(a.shape.value().finite, 10'000U);
    for (std::size_t i = 0; i < a.xyz.size(); ++i) ASSERT_TRUE(same_bits(a.xyz[i], b.xyz[i])) << i;
  }
}

TEST(PlainRows, an_error_behind_many_of_them_names_its_line) {
  std::string rows;
  for (int i = 0; i < 50'000; ++i) rows += "1.25 -2.5 3.125\n";
  const test::Read wrong = test::read_bytes(rows + "1 2 x\n", "a.xyz", LengthUnit::mm, 60'000);
  EXPECT_NE(wrong.why().find("line 50001, column 5: \"x\" is not a number"), std::string::npos) << wrong.why();
  const test::Read many = test::read_bytes(rows, "a.xyz", LengthUnit::mm, 40'000);
  EXPECT_NE(many.why().find("line 40001: more than 40000 points"), std::string::npos) << many.why();
  const std::string header =
      "ply\nformat ascii 1.0\nelement vertex 50\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  test::expect_refused(header + rows.substr(0, 49 * 16) + "1 2\n", "line 57: fewer values", "a.ply");
  test::expect_refused(header + rows.substr(0, 49 * 16), "line 56: the file ends here, after 49 of 50", "a.ply");
  test::expect_refused(header + rows.substr(0, 51 * 16), "line 58: ", "a.ply");
}

TEST(TextLines, a_last_line_without_an_end_is_longer_than_all_before_it) {
  test::expect_points("1 2 3 4\n111.5 222.25 333.125", "a.xyz", {1, 2, 3, 111.5F, 222.25F, 333.125F});
  test::expect_points("#\n111.5 222.25 333.125", "a.xyz", {111.5F, 222.25F, 333.125F});
}

}  // namespace
}  // namespace slabd::hal
