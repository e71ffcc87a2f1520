// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/hal/scan/scan_reading.h"

// PLY files with text, lists, and elements around the vertices; scan_file_test.cpp covers the rest.
namespace slabd::hal {
namespace {

using test::bytes_of;
using test::expect_points;
using test::kMissing;

void expect_refused(const std::string& bytes, const std::string& expected, Code code = Code::frame_incomplete) {
  test::expect_refused(bytes, expected, "scan.ply", code);
}

std::string head(const std::string& format, const std::string& body) {
  return "ply\nformat " + format + " 1.0\n" + body + "end_header\n";
}

const std::string kXyz = "property float x\nproperty float y\nproperty float z\n";
const std::string kTwo = "element vertex 2\n" + kXyz;
const std::string kLittle = "binary_little_endian";
const std::string kBig = "binary_big_endian";

std::string point(float x, float y, float z, bool big = false) {
  return bytes_of(x, big) + bytes_of(y, big) + bytes_of(z, big);
}

TEST(Ply, text_as_programs_write_it) {
  expect_points(head("ascii", kTwo) + "1 2 3\n4 5 6\n", "a.ply", {1, 2, 3, 4, 5, 6});
  expect_points(head("ascii", kTwo) + "1 2 3 \n\n 4\t5  6", "a.ply", {1, 2, 3, 4, 5, 6});
  expect_points(
      "ply\r\nformat ascii 1.0\r\nelement vertex 1\r\nproperty double z\r\nproperty uchar red\r\nproperty "
      "float x\r\nproperty int y2\r\nproperty float64 y\r\nend_header\r\n3 255 1 -7 2\r\n",
      "a.ply", {1, 2, 3});
  for (const std::string blank : {" ", "\t", "  \r"}) {
    std::string header;
    for (const char c : head("ascii", kTwo)) header += c == '\n' ? blank + c : std::string(1, c);
    expect_points(header + "1 2 3\n4 5 6\n", "a.ply", {1, 2, 3, 4, 5, 6});
  }
  expect_points(head("ascii", "comment organized point cloud by Foo\n" + kTwo) + "1 2 3\n4 5 6\n", "a.ply",
                {1, 2, 3, 4, 5, 6});
  expect_points(head("ascii", kTwo) + "nan 2 3\n1 -inf 3\n", "a.ply",
                {kMissing, kMissing, kMissing, kMissing, kMissing, kMissing});
}

TEST(Ply, text_organised_with_missing_points) {
  const test::Read r =
      test::read_bytes(head("ascii", "comment organized width 1 height 2\n" + kTwo) + "nan nan nan\n4 5 6\n", "a.ply");
  ASSERT_TRUE(r.shape.ok()) << r.why();
  EXPECT_EQ(r.shape.value().width, 1U);
  EXPECT_EQ(r.shape.value().height, 2U);
  EXPECT_EQ(r.shape.value().finite, 1U);
}

TEST(Ply, text_that_does_not_fit_the_header_names_its_line) {
  const std::string two = head("ascii", kTwo);  // 7 lines
  expect_refused(two + "1.5 2 3\n4 5\n", "line 9: fewer values than");
  expect_refused(two + "1 2 3 4\n4 5 6\n", "line 8: \"4\": more values than");
  expect_refused(two + "1.0000 2 3\n", "line 8: the file ends here, after 1 of 2");
  expect_refused(two + "1 2 3\n4 5 6\n7 8 9\n", "line 10: \"7 8 9\": the file continues");
  expect_refused(two + "1 2 3\n4 five 6\n", "line 9, column 3: \"five\" is not a number");
  expect_refused(two + "1,2,3\n4,5,6\n", "line 8, column 1: \"1,2,3\" is not a number");
  expect_refused(head("ascii", "element vertex 1000000\n" + kXyz) + "1 2 3\n", "requires at least 6000105");
  expect_refused(head("ascii", "element vertex 65\n" + kXyz) + std::string(400, '1'),
                 "65 points, allowed are at most 64");
}

TEST(Ply, text_with_lists_and_other_elements) {
  const std::string vertices =
      "element vertex 2\nproperty float x\nproperty list uchar int seen_by\nproperty float y\nproperty float z\n";
  const std::string around =
      "element camera 1\nproperty float focus\n" + vertices +
      "element face 1\nproperty list uchar int vertex_indices\nelement strip 1\nproperty list int int vertex_indices\n";
  const std::string strip = "300000" + [] {
    std::string indices;
    for (int i = 0; i < 300'000; ++i) indices += " 0";
    return indices;
  }();
  const std::string rows = "50.0\n1 0 2 3\n4 3 7 8 9 5 6\n3 0 1 1\n";
  expect_points(head("ascii", around) + rows + strip + "\n", "a.ply", {1, 2, 3, 4, 5, 6});
  expect_points(head("ascii", around) + rows + strip, "a.ply", {1, 2, 3, 4, 5, 6});
  const std::string lists = head("ascii", vertices);  // 8 lines
  expect_refused(lists + "1 0 2 3\n4 3 7 8 9 5\n", "line 10: fewer values");
  expect_refused(lists + "1 0 2 3\n4 4294967295 7 8 9 5\n", "line 10: fewer values");
  expect_refused(lists + "1 0 2 3\n4 -1 5 6\n", "line 10, column 3: \"-1\" is not a number (the length of a list)");
  expect_refused(lists + "1 0 2 3\n4 2.0 7 8 5 6\n", "the length of a list");
  expect_refused(head("ascii", around) + rows, "after 0 of 1 items");
}

TEST(Ply, lists_within_the_vertices_are_stepped_over) {
  for (const bool big : {false, true}) {
    const std::string h = head(big ? kBig : kLittle,
                               "element vertex 2\nproperty float x\nproperty list uchar int a\nproperty "
                               "float y\nproperty list int double b\nproperty float z\n");
    const auto vertex = [&](float k, std::uint8_t a, std::int32_t b) {
      return bytes_of(k, big) + bytes_of(a) + std::string(4U * a, 'a') + bytes_of(2 * k, big) + bytes_of(b, big) +
             std::string(8U * static_cast<unsigned>(b), 'b') + bytes_of(3 * k, big);
    };
    expect_points(h + vertex(1, 0, 0) + vertex(2, 255, 70'000), "a.ply", {1, 2, 3, 2, 4, 6});
    const std::string torn = h + vertex(1, 3, 2) + vertex(2, 3, 2);
    for (std::size_t cut = 1; cut < torn.size() - h.size(); ++cut) {
      const test::Read r = test::read_bytes(torn.substr(0, torn.size() - cut), "a.ply");
      EXPECT_FALSE(r.shape.ok()) << cut;
    }
    expect_refused(torn + "x", ": 1 byte too many behind the data");
  }
}

TEST(Ply, lists_longer_than_the_file_or_negative_are_refused) {
  const std::string h = "element vertex 1\n" + kXyz;
  for (const std::string type : {"uint", "int"}) {
    const std::string bytes = head(kLittle, h + "property list " + type + " double n\n") + point(1, 2, 3) +
                              "\xFF\xFF\xFF\xFF" + std::string(64, 'x');
    expect_refused(bytes, type == "uint" ? "item 0 has a list of 4294967295 values, 64 bytes are left" : "negative");
  }
  expect_refused(head(kLittle, h + "property list uint64 double n\n") + point(1, 2, 3) + std::string(8, '\xFF'),
                 "a list of 18446744073709551615 values");
  expect_refused(head(kBig, h + "element face 3\nproperty list char int v\n") + point(1, 2, 3, true) +
                     std::string(1, '\x80') + std::string(9, '\0'),
                 "negative");
}

TEST(Ply, elements_with_lists_before_and_after_the_vertices) {
  for (const bool big : {false, true}) {
    const std::string h =
        head(big ? kBig : kLittle,
             "element range_grid 3\nproperty list uchar int vertex_indices\nproperty short s\n" + kTwo +
                 "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float uv\n"
                 "element note 4\nproperty int16 n\n");
    const auto grid = [&](std::uint8_t n) { return bytes_of(n) + std::string(4U * n, 'i') + "ss"; };
    const auto face = [&](std::uint8_t n) {
      return bytes_of(n) + std::string(4U * n, 'i') + bytes_of(n) + std::string(4U * n, 'f');
    };
    const std::string bytes = h + grid(1) + grid(0) + grid(1) + point(1, 2, 3, big) + point(4, 5, 6, big) + face(3) +
                              face(4) + std::string(8, 'n');
    expect_points(bytes, "a.ply", {1, 2, 3, 4, 5, 6});
    expect_refused(bytes.substr(0, bytes.size() - 1), "the file ends within its data");
    expect_refused(bytes + "xx", ": 2 bytes too many behind the data");
    expect_points(bytes + "\n", "a.ply", {1, 2, 3, 4, 5, 6});
  }
}

TEST(Ply, elements_without_properties_take_no_room) {
  expect_points(head("ascii", "element nothing 5\n" + kTwo) + "1 2 3\n4 5 6\n", "a.ply", {1, 2, 3, 4, 5, 6});
  expect_points(head(kLittle, "element nothing 1099511627776\n" + kTwo) + point(1, 2, 3) + point(4, 5, 6), "a.ply",
                {1, 2, 3, 4, 5, 6});
}

/// The bytes as a C runtime in text mode writes them.
std::string in_text_mode(const std::string& bytes) {
  std::string out;
  for (const char c : bytes) {
    if (c == '\n') out += '\r';
    out += c;
  }
  return out;
}

TEST(Ply, a_line_end_or_zeros_behind_binary_data_are_not_part_of_it) {
  const std::string whole = head(kLittle, kTwo) + point(1, 2, 3) + point(4, 5, 6);
  for (const std::string& tail :
       {std::string("\n"), std::string("\r\n"), std::string(1, '\0'), std::string(65'536, '\0')})
    expect_points(whole + tail, "a.ply", {1, 2, 3, 4, 5, 6});
  expect_refused(whole + "\n\n", "byte " + std::to_string(whole.size()) + ": 2 bytes too many behind the data");
  expect_refused(whole + " ", ": 1 byte too many behind the data that the header announces");
  expect_refused(whole + std::string(65'537, '\0'), ": 65537 bytes too many");
  expect_refused(whole + std::string(30, '\0') + "x", ": 31 bytes too many");
}

TEST(Ply, binary_data_written_in_text_mode_are_named_as_that) {
  const std::string whole = head(kLittle, kTwo) + "\n23\n" + bytes_of(2.0F) + "\n234" + point(4, 5, 6);
  ASSERT_EQ(whole.size(), head(kLittle, kTwo).size() + 24);
  expect_refused(in_text_mode(whole),
                 ": 3 bytes too many behind the data that the header announces (every LF has a CR "
                 "before it: binary data were written in text mode");
  // One LF without a CR: the file has another fault.
  const test::Read r = test::read_bytes(in_text_mode(whole) + "\n", "a.ply");
  EXPECT_NE(r.why().find(": 4 bytes too many"), std::string::npos) << r.why();
  EXPECT_EQ(r.why().find("text mode"), std::string::npos) << r.why();
}

TEST(Ply, lines_that_end_with_cr_alone_are_read) {
  const auto with_cr = [](std::string text) {
    std::replace(text.begin(), text.end(), '\n', '\r');
    return text;
  };
  expect_points(
      with_cr(head("ascii", "comment scan 7\nelement camera 1\nproperty float f\n" + kTwo) + "50\n1 2 3\n4 5 6\n"),
      "a.ply", {1, 2, 3, 4, 5, 6});
  expect_points(with_cr(head("ascii", kTwo) + "1 2 3\n4 5 6"), "a.ply", {1, 2, 3, 4, 5, 6});
  expect_refused(with_cr(head("ascii", kTwo) + "1 2 3\n4 5 six\n"), "line 9, column 5: \"six\" is not a number");
  // The first byte of the data is an LF.
  const std::string first = "\n23\x41";
  float x = 0.0F;
  std::memcpy(&x, first.data(), 4);
  expect_points(with_cr(head(kLittle, kTwo)) + point(x, 2, 3) + point(4, 5, 6), "a.ply", {x, 2, 3, 4, 5, 6});
  expect_points(in_text_mode(head(kLittle, kTwo)) + point(x, 2, 3) + point(4, 5, 6), "a.ply", {x, 2, 3, 4, 5, 6});
}

TEST(Ply, a_byte_order_mark_is_stepped_over_and_utf16_is_named) {
  const std::string mark = "\xEF\xBB\xBF";
  expect_points(mark + head("ascii", kTwo) + "1 2 3\n4 5 6\n", "a.ply", {1, 2, 3, 4, 5, 6});
  const std::string binary = mark + head(kLittle, kTwo) + point(1, 2, 3) + point(4, 5, 6);
  expect_points(binary, "a.ply", {1, 2, 3, 4, 5, 6});
  expect_refused(binary + "x", ": 1 byte too many");
  expect_refused(binary.substr(0, binary.size() - 1), "requires " + std::to_string(binary.size()) + " bytes");
  std::string wide;
  for (const char c : head("ascii", kTwo) + "1 2 3\n4 5 6\n") wide += std::string{c, '\0'};
  expect_refused("\xFF\xFE" + wide, "UTF-16 text, two bytes for each character: save it as UTF-8 or ASCII");
  expect_refused(wide, "UTF-16 text");
}

TEST(Ply, a_decimal_comma_is_named) {
  expect_refused(head("ascii", kTwo) + "1,5 2,5 3,5\n",
                 "line 8, column 1: \"1,5\" is not a number (a decimal comma is not "
                 "read: save the scan with decimal points)");
  expect_refused(head("ascii", kTwo) + "1,2,3\n4,5,6\n",
                 "\"1,2,3\" is not a number (values are separated by blanks here)");
}

TEST(Ply, headers_have_bounds) {
  std::string many;
  for (int i = 0; i < 33; ++i) many += "element e 0\nproperty char a\n";
  expect_refused(head(kLittle, many), "too many elements");
  std::string wide = "element vertex 1\n";
  for (int i = 0; i < 257; ++i) wide += "property char a\n";
  expect_refused(head(kLittle, wide), "too many properties");
  expect_refused("ply\nformat ascii 1.0\n" + std::string(1'000'000, 'c'),
                 "no end_header line in the first 16384 bytes");
  std::string endless = "ply\nformat ascii 1.0\n";
  while (endless.size() < 1'000'000) endless += "comment and on\n";
  expect_refused(endless, "no end_header line in the first 16384 bytes");
}

}  // namespace
}  // namespace slabd::hal
