// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>

#include "hal/scan/lzf.h"
#include "hal/scan/pcd.h"
#include "tests/hal/scan/scan_reading.h"

namespace slabd::hal {
namespace {

using test::bytes_of;
using test::expect_points;
using test::kMissing;

const std::string kFields = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n";
const std::string kTwo = "WIDTH 2\nHEIGHT 1\nPOINTS 2\n";
const std::string kSix =
    bytes_of(1.0F) + bytes_of(2.0F) + bytes_of(3.0F) + bytes_of(4.0F) + bytes_of(5.0F) + bytes_of(6.0F);

void expect_refused(const std::string& bytes, const std::string& expected, Code code = Code::frame_incomplete) {
  test::expect_refused(bytes, expected, "scan.pcd", code);
}

std::string compressed(const std::string& planes) {
  const std::string stream = lzf_compress(planes);
  return bytes_of(static_cast<std::uint32_t>(stream.size())) + bytes_of(static_cast<std::uint32_t>(planes.size())) +
         stream;
}

TEST(Pcd, versions_and_abbreviations_as_programs_write_them) {
  for (const std::string version : {"VERSION 0.7\n", "VERSION .7\n", "VERSION 0.6\n", "VERSION .6\n", ""})
    expect_points("# .PCD v.7 - Point Cloud Data file format\n" + version + kFields + kTwo + "DATA binary\n" + kSix,
                  "a.pcd", {1, 2, 3, 4, 5, 6});
  // Without COUNT and POINTS, with CR LF, a blank line and the statements in another order.
  expect_points(
      "VERSION 0.7\r\nHEIGHT 1\r\nWIDTH 2\r\n\r\nTYPE F F F\r\nSIZE 4 4 4\r\nFIELDS x y z\r\nDATA ascii\r\n"
      "1 2 3\r\n4 5 6",
      "A.PCD", {1, 2, 3, 4, 5, 6});
}

TEST(Pcd, other_fields_of_any_size_type_and_count_are_stepped_over) {
  const std::string head =
      "VERSION 0.7\nFIELDS rgb z _ x normal y\nSIZE 4 8 1 4 4 4\nTYPE U F U F F F\nCOUNT 1 1 3 1 3 1\n" + kTwo;
  std::string binary;
  for (const float k : {1.0F, 2.0F})
    binary += "RGBA" + bytes_of(double{3 * k}) + "pad" + bytes_of(k) + std::string(12, 'n') + bytes_of(2 * k);
  expect_points(head + "DATA binary\n" + binary, "a.pcd", {1, 2, 3, 2, 4, 6});
  const std::string planes = "RGBARGBA" + bytes_of(3.0) + bytes_of(6.0) + "padpad" + bytes_of(1.0F) + bytes_of(2.0F) +
                             std::string(24, 'n') + bytes_of(2.0F) + bytes_of(4.0F);
  expect_points(head + "DATA binary_compressed\n" + compressed(planes), "a.pcd", {1, 2, 3, 2, 4, 6});
  expect_points(head + "DATA ascii\n4294967295 3 0 0 0 1 nan nan nan 2\nx 6 y y y 2 n n n 4\n", "a.pcd",
                {1, 2, 3, 2, 4, 6});
}

TEST(Pcd, missing_points_and_what_is_not_finite) {
  expect_points(kFields + kTwo + "DATA ascii\nnan nan nan\n1 -inf 3\n", "a.pcd",
                {kMissing, kMissing, kMissing, kMissing, kMissing, kMissing});
  std::string binary = kSix;
  binary.replace(8, 4, bytes_of(kMissing));
  expect_points(kFields + kTwo + "DATA binary\n" + binary, "a.pcd", {kMissing, kMissing, kMissing, 4, 5, 6});
}

TEST(Pcd, organised_when_it_has_rows) {
  const auto shape = [](const std::string& sides) {
    const test::Read r = test::read_bytes(kFields + sides + "DATA binary\n" + kSix, "a.pcd");
    EXPECT_TRUE(r.shape.ok()) << r.why();
    return r.shape ? r.shape.value() : ScanShape{};
  };
  EXPECT_EQ(shape("WIDTH 1\nHEIGHT 2\n").height, 2U);
  EXPECT_EQ(shape("WIDTH 1\nHEIGHT 2\n").width, 1U);
  EXPECT_EQ(shape(kTwo).width, 0U) << "HEIGHT 1 is PCD's way to say unorganised";
}

TEST(Pcd, points_stay_in_the_frame_they_are_stored_in) {
  expect_points(kFields + kTwo + "VIEWPOINT 100 200 300 0.7071068 0.7071068 0 0\nDATA binary\n" + kSix, "a.pcd",
                {1, 2, 3, 4, 5, 6});
  expect_refused(kFields + kTwo + "VIEWPOINT 0 0 0 1 0 0\nDATA binary\n" + kSix, "seven numbers");
  expect_refused(kFields + kTwo + "VIEWPOINT 0 0 0 nan 0 0 0\nDATA binary\n" + kSix, "seven numbers");
}

TEST(Pcd, wrong_counts_are_refused_before_they_are_used) {
  for (const std::string width : {"3", "5000000", "2147483648", "1099511627776"})
    expect_refused(kFields + "WIDTH " + width + "\nHEIGHT 1\nDATA binary\n" + kSix,
                   width.size() > 12 ? "2^31" : "requires");
  expect_refused(kFields + "WIDTH 2147483648\nHEIGHT 2147483648\nDATA binary\n" + kSix, "2^40");
  for (const std::string width : {"-1", "1099511627777", "99999999999999999999", "2.0", "2x", "", "2 2"})
    expect_refused(kFields + "WIDTH " + width + "\nHEIGHT 1\nDATA binary\n" + kSix, "header line 5: not a count");
  expect_refused(kFields + "WIDTH 2\nHEIGHT 1\nPOINTS 3\nDATA binary\n" + kSix, "POINTS 3 is not WIDTH 2 * HEIGHT 1");
  expect_refused(kFields + "WIDTH 0\nHEIGHT 1\nDATA binary\n", "no points", Code::too_few_points);
  expect_refused(kFields + kTwo + "DATA binary\n" + kSix + "x", ": 1 byte too many behind the data");
  expect_refused(kFields + "WIDTH 4\nHEIGHT 1\nDATA ascii\n1 2 3\n4 5 6\n", "requires at least");
  expect_refused(kFields + "WIDTH 65\nHEIGHT 1\nDATA binary\n" + std::string(65 * 12, '\0'),
                 "65 points, allowed are at most 64");
}

TEST(Pcd, text_that_does_not_fit_the_header_names_its_line) {
  const std::string head = kFields + kTwo + "DATA ascii\n";  // 8 lines
  expect_refused(head + "1.5 2 3\n4 5\n", "line 10: 2 values, the header declares 3");
  expect_refused(head + "1 2 3 4\n4 5 6\n", "line 9: \"4\": more values than the 3");
  expect_refused(head + "1.00000 2 3\n\n", "line 10: the file ends here, after 1 of 2 points");
  expect_refused(head + "1 2 3\n4 5 6\n7 8 9\n", "line 11: \"7 8 9\": more points than the 2");
  expect_refused(head + "1 2 3\n4 5,5 6\n", "line 10, column 3: \"5,5\" is not a number");
  expect_points(head + "\n1 2 3\n\n 4\t5  6 \n\n", "a.pcd", {1, 2, 3, 4, 5, 6});
}

TEST(Pcd, wrong_compressed_lengths_are_refused) {
  const std::string head = kFields + kTwo + "DATA binary_compressed\n";
  const std::string good = compressed(kSix);
  const auto u32 = [](std::size_t v) { return bytes_of(static_cast<std::uint32_t>(v)); };
  const std::string stream = good.substr(8);
  expect_points(head + good, "a.pcd", {1, 3, 5, 2, 4, 6});
  expect_refused(head + good.substr(0, 7), "requires at least");
  expect_refused(head + good.substr(0, good.size() - 1), "bytes of compressed data, the file has");
  expect_refused(head + good + "x", ": 1 byte too many behind the data");
  expect_refused(head + u32(4'294'967'295U) + u32(24) + stream, "4294967295 bytes of compressed data");
  expect_refused(head + u32(stream.size()) + u32(25) + stream, "data of 25 bytes, the header's points need 24");
  expect_refused(head + u32(stream.size()) + u32(4'294'967'295U) + stream, "data of 4294967295 bytes");
  const std::string more = lzf_compress(kSix + "1234");
  expect_refused(head + u32(more.size()) + u32(24) + more, "decode to more bytes");
  const std::string less = lzf_compress(kSix.substr(0, 20));
  expect_refused(head + u32(less.size()) + u32(24) + less, "decode to fewer bytes");
}

TEST(Pcd, zeros_behind_the_data_as_pcls_writer_leaves_them_are_read) {
  const std::string header =
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n" + kFields + kTwo + "VIEWPOINT 0 0 0 1 0 0 0\nDATA ";
  const std::string packed = compressed(kSix);
  // PCL sets the file's length to a memory page plus the data, without the header.
  for (const std::size_t page : {4'096U, 16'384U, 65'536U}) {
    std::string binary = header + "binary\n" + kSix;
    binary.resize(page + kSix.size(), '\0');
    expect_points(binary, "a.pcd", {1, 2, 3, 4, 5, 6});
    std::string squeezed = header + "binary_compressed\n" + packed;
    squeezed.resize(page + packed.size(), '\0');
    expect_points(squeezed, "a.pcd", {1, 3, 5, 2, 4, 6});
    for (std::string* bytes : {&binary, &squeezed}) {
      bytes->back() = '\x01';
      expect_refused(*bytes, " bytes too many behind the data that the header announces");
    }
  }
  const std::string whole = header + "binary\n" + kSix;
  expect_points(whole + std::string(65'536, '\0'), "a.pcd", {1, 2, 3, 4, 5, 6});
  expect_refused(whole + std::string(65'537, '\0'),
                 "byte " + std::to_string(whole.size()) + ": 65537 bytes too many behind the data");
  expect_points(whole + "\n", "a.pcd", {1, 2, 3, 4, 5, 6});
  expect_refused(whole.substr(0, whole.size() - 1), "the file ends here, its header requires");
}

TEST(Pcd, the_drop_folder_agrees_with_the_reader_on_what_is_whole) {
  const std::string binary = kFields + kTwo + "DATA binary\n" + kSix;
  const std::string squeezed = kFields + kTwo + "DATA binary_compressed\n" + compressed(kSix);
  for (const std::string& bytes : {binary, squeezed}) {
    const std::string zeros(4'000, '\0');
    const auto complete = [](const std::string& content) {
      return is_complete_scan(test::memory_file(content).get(), "a.pcd", LengthUnit::mm);
    };
    EXPECT_TRUE(complete(bytes));
    EXPECT_TRUE(complete(bytes + zeros));
    EXPECT_TRUE(complete(bytes + "\n"));
    EXPECT_FALSE(complete(bytes + zeros + "x"));
    EXPECT_FALSE(complete(bytes + std::string(65'537, '\0')));
    EXPECT_FALSE(complete(bytes.substr(0, bytes.size() - 1)));
    EXPECT_EQ(bytes_of_data(test::memory_file(bytes + zeros).get(), "a.pcd", LengthUnit::mm), bytes.size());
    EXPECT_EQ(bytes_of_data(test::memory_file(bytes.substr(0, bytes.size() - 1)).get(), "a.pcd", LengthUnit::mm),
              bytes.size() - 1);
    EXPECT_FALSE(lacks_bytes(test::memory_file(bytes + zeros).get(), "a.pcd", LengthUnit::mm));
  }
}

TEST(Pcd, forms_of_text_that_other_programs_write) {
  const std::string text = kFields + kTwo + "DATA ascii\n1 2 3\n4 5 6\n";
  std::string cr = text;
  std::replace(cr.begin(), cr.end(), '\n', '\r');
  expect_points(cr, "a.pcd", {1, 2, 3, 4, 5, 6});
  expect_points("\xEF\xBB\xBF" + text, "a.pcd", {1, 2, 3, 4, 5, 6});
  expect_points("\xEF\xBB\xBF" + kFields + kTwo + "DATA binary\n" + kSix, "a.pcd", {1, 2, 3, 4, 5, 6});
  std::string big_endian;
  for (const char c : text) big_endian += std::string{'\0', c};
  expect_refused("\xFE\xFF" + big_endian, "UTF-16 text");
  expect_refused(big_endian, "UTF-16 text");
  expect_refused(kFields + kTwo + "DATA ascii\n1,5 2 3\n4 5 6\n",
                 "line 9, column 1: \"1,5\" is not a number (a decimal comma is not read");
  expect_refused(kFields + kTwo + "DATA ascii\n1.5,2,3\n4,5,6\n", "values are separated by blanks");
  expect_refused(kFields + kTwo + "VIEWPOINT 0,0 0 0 1 0 0 0\nDATA ascii\n1 2 3\n4 5 6\n",
                 "VIEWPOINT \"0,0\" (expected: seven numbers with decimal points)");
}

TEST(Pcd, unsupported_features_are_named) {
  const std::string tail = kTwo + "DATA binary\n" + kSix;
  expect_refused("", "0 bytes, the file is empty");
  expect_refused("\n", "not a PCD file");
  expect_refused("ply\nformat ascii 1.0\n", "header line 1: unknown statement \"ply\"");
  expect_refused("VERSION 0.5\n" + kFields + tail, "unknown PCD version \"0.5\"");
  expect_refused(kFields + kTwo + "DATA text\n", "unknown DATA \"text\" (supported: ascii, binary, binary_compressed)");
  expect_refused("FIELDS x y\nSIZE 4 4\nTYPE F F\n" + tail, "FIELDS lacks x, y or z");
  expect_refused("FIELDS x y z x\nSIZE 4 4 4 4\nTYPE F F F F\n" + tail, "second field \"x\"");
  expect_refused("FIELDS x y z\nSIZE 4 4 4\nTYPE F I F\n" + tail, "unsupported coordinate \"y\"");
  expect_refused("FIELDS x y z\nSIZE 4 4 2\nTYPE F F F\n" + tail, "unsupported coordinate \"z\"");
  expect_refused("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 2 1\n" + tail, "unsupported coordinate \"y\"");
  expect_refused("FIELDS x y z\nSIZE 4 4 3\nTYPE F F F\n" + tail, "SIZE \"3\" (allowed: 1, 2, 4, 8)");
  expect_refused("FIELDS x y z\nSIZE 4 4 4\nTYPE F F D\n" + tail, "TYPE \"D\" (allowed: F, I, U)");
  expect_refused("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 0\n" + tail, "COUNT \"0\"");
  expect_refused("FIELDS x y z\nSIZE 4 4\nTYPE F F F\n" + tail, "3 FIELDS, but 2 SIZE, 3 TYPE, 0 COUNT");
  expect_refused("FIELDS x y z\nSIZE 4 4 4 4\nTYPE F F F\n" + tail, "3 FIELDS, but 4 SIZE");
  expect_refused(kFields + "SIZE 4 4 4\n" + tail, "a second line of this kind");
  expect_refused(kFields + "FIELDS x y z\n" + tail, "second FIELDS line");
  expect_refused(kFields + "WIDTH 2\n" + tail, "second line \"WIDTH\"");
  expect_refused("FIELDS x y z other\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 4096\n" + tail, "more than 4096 bytes");
  expect_refused(kFields + "WIDTH 2\nDATA binary\n" + kSix, "no WIDTH or no HEIGHT");
  expect_refused("FIELDS\n" + tail, "FIELDS without a name");
  expect_refused(kTwo + "DATA binary\n", "no FIELDS line before DATA");
  std::string many = "FIELDS";
  for (int i = 0; i < 65; ++i) many += " f";
  expect_refused(many + "\n", "too many fields");
}

TEST(Pcd, every_cut_header_is_refused) {
  const std::string whole = "# .PCD v0.7\nVERSION 0.7\n" + kFields + kTwo + "VIEWPOINT 0 0 0 1 0 0 0\nDATA binary\n";
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes)
    EXPECT_FALSE(parse_pcd_header(whole.substr(0, bytes), "cut.pcd", LengthUnit::mm).ok()) << bytes;
  EXPECT_TRUE(parse_pcd_header(whole, "whole.pcd", LengthUnit::mm).ok());
}

}  // namespace
}  // namespace slabd::hal
