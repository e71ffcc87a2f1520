// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "hal/text_lines.h"
#include "tests/hal/scan_reading.h"

namespace slabd::hal {
namespace {

using test::expect_points;
using test::kMissing;

void expect_refused(const std::string& bytes, const std::string& expected, Code code = Code::frame_incomplete) {
  for (const std::string name : {"scan.xyz", "scan.csv"}) test::expect_refused(bytes, expected, name, code);
}

TEST(TextPoints, separators_comments_extra_columns_and_line_ends) {
  for (const std::string text :
       {"1 2 3\n4 5 6\n", "1,2,3\n4,5,6", "1;2;3\r\n4;5;6\r\n", "1\t2\t3\n4\t5\t6\n", "  1   2  3  \n\n\n4 5   6\n",
        "1, 2, 3\n4 ,5 , 6\n", "1 ; 2; 3\n4;5;6", "# by hand\n1 2 3\n  // more\n4 5 6\n",
        "\xEF\xBB\xBF"
        "1 2 3\n4 5 6\n",
        "1 2 3 255 0 0 label\n4 5 6\n", "1,2,3,,nothing\n4,5,6,7\n", "1;2;3;0,5\n4;5;6;0,5\n",
        "+1 2. 3\n4e0 5.0E+0 .6e1\n", "1 2 3 # note\n4 5 6\n", "\n\r\n  \n1 2 3\n4 5 6\n",
        "\"no\",\"names\",\"known\"\n1,2,3\n4,5,6\n"}) {
    expect_points(text, "a.xyz", {1, 2, 3, 4, 5, 6});
    expect_points(text, "a.csv", {1, 2, 3, 4, 5, 6});
  }
}

TEST(TextPoints, zeros_where_lines_were_are_refused_also_behind_what_is_read) {
  // As a file reads that lost a block, or whose block was never written: the hole takes whole lines with it.
  const std::string hole(40, '\0');
  for (const char separator : {' ', ',', ';', '\t'}) {
    std::string rows;
    for (int i = 0; i < 60; ++i)
      rows += std::string("1.5") + separator + "2.5" + separator + "3.5" + separator + "77" + separator + "1.25\n";
    std::string holed = rows;
    holed.replace(5 * 20 + 14, hole.size(), hole);  // within the fourth column of line 6
    expect_refused(holed, "line 6: column 15: a byte 0");
    rows.replace(rows.size() - 5, 2, 2, '\0');  // in the last line
    expect_refused(rows, "line 60: column ");
  }
  expect_refused("# scan 7" + hole + "\n1 2 3\n", "line 1: column 9: a byte 0");
}

TEST(TextPoints, the_first_line_chooses_the_separator_for_all) {
  expect_refused("1 2 3\n4,5,6\n", "line 2, column 1: \"4,5,6\" is not a number");
  expect_refused("1,2,3\n4 5 6\n", "line 2, column 1: \"4 5 6\" is not a number");
  expect_refused("1;2;3\n4,5,6\n", "line 2, column 1: \"4,5,6\" is not a number");
  expect_refused("1\t2\t3\n4 5\t6\n", "line 2, column 1: \"4 5\" is not a number");
  expect_points("1 2 3\n4 \t5\t 6\n", "a.xyz", {1, 2, 3, 4, 5, 6});  // a tab is a blank where blanks separate
}

TEST(TextPoints, names_in_the_first_line_say_where_x_y_z_are) {
  for (const std::string text :
       {"x,y,z\n1,2,3\n", "z,x,y\n3,1,2\n", "id;Y;quality;Z;X\n9;2;0,5;3;1\n", "\"X\",\"Y\",\"Z\"\n1,2,3\n",
        "x [mm] y [mm] z [mm] i\n1 2 3 4\n", "X (mm)\tY (mm)\tZ (mm)\n1\t2\t3\n", "# scan 7\nx y z\n1 2 3\n",
        "x_mm,y_mm,z_mm\n1,2,3\n", "east,north,height\n1,2,3\n", "r,z,x,y\n9,3,1,2,8\n"})
    expect_points(text, "a.csv", {1, 2, 3});
  expect_refused("x,y,height\n1,2,3\n", "line 1: of x, y and z only 2");
  expect_refused("x,y,z,x\n1,2,3,4\n", "line 1: a second column named \"x\"");
  expect_refused("x,y,z\nx,y,z\n1,2,3\n", "line 2, column 1: \"x\" is not a number");
  expect_refused("1,2,3\nx,y,z\n", "line 2, column 1: \"x\" is not a number");
  expect_refused("id,a,x,y,z\n1,2,3,4\n", "line 2: 4 columns, needed are 5");
  // A unit needs no comment's mark.
  expect_points("Units: mm\n1 2 3\n", "a.csv", {1, 2, 3});
  expect_refused("Units: m\n1 2 3\n", "line 1: the file says unit \"m\", but \"mm\" is configured");
}

TEST(TextPoints, names_in_a_comment_above_the_points_say_where_x_y_z_are_too) {
  for (const std::string text :
       {"//X Y Z\n1 2 3\n", "//Z Y X\n3 2 1\n", "# Z,Y,X\n3,2,1\n", "# z y x\n3,2,1\n", "//id X Y Z\n9 1 2 3\n",
        "# columns: id x y z\n9 1 2 3\n", "# id;\"Z [mm]\";y_mm;X (mm);\n9;3;2;1;\n", "# z y x\n# scan 7\n\n3 2 1\n",
        "# a b c\n# z y x\n3 2 1\n", "# z y x\nx y z\n1 2 3\n", "# z [mm] y [mm] x [mm]\n3 2 1\n",
        "//X Y Z R G B Scalar field\n1 2 3 4 5 6 7\n"})
    expect_points(text, "a.asc", {1, 2, 3});
  // Sentences, and what stands below the first point.
  for (const std::string text :
       {"# x y z are in the scanner's frame\n1 2 3\n", "# z up, y across, x along\n1 2 3\n",
        "# x: along, y: across\n1 2 3\n", "# the axes z, y and x\n1,2,3\n", "# x\n1 2 3\n", "# z y\n1 2 3\n"})
    expect_points(text, "a.asc", {1, 2, 3});
  expect_points("1 2 3\n# z y x\n4 5 6\n", "a.xyz", {1, 2, 3, 4, 5, 6});
  expect_refused("//id X Y Z\n9 1 2 3 4\n",
                 "line 2: 5 columns, but the comment on line 1 names 4, and x, y, z are not its first three");
  expect_refused("# x y z x\n1 2 3 4\n", "line 1: a second column named \"x\"");
  expect_refused("# z [m] y [m] x [m]\n3 2 1\n", "line 1: the file says unit \"m\"");
  expect_refused("# id x y z\n9 1 2 3\n9 1 2\n", "line 3: 3 columns, needed are 4");
}

TEST(TextPoints, what_is_not_there_or_not_finite_is_a_missing_point) {
  for (const std::string line : {"nan,nan,nan", "NaN,2,3", "1,NAN,3", "1,2,-nan", "1,inf,3", "1,-Inf,3", "infinity,2,3",
                                 ",,", "1,,3", "1,2,", " , 2 , 3", "1.#QNAN,2,3", "1,-1.#IND00,3", "1,2,1.#INF",
                                 "nan(ind),2,3", "-nan(ind),2,3", "1e999,2,3", "1,2,1e300"})
    expect_points("7,8,9\n" + line + "\n4,5,6\n", "a.csv", {7, 8, 9, kMissing, kMissing, kMissing, 4, 5, 6});
  expect_points("1\t\t3\n", "a.txt", {kMissing, kMissing, kMissing});
  expect_points("nan nan nan\n1 2 3\n", "a.xyz", {kMissing, kMissing, kMissing, 1, 2, 3});
}

TEST(TextPoints, a_malformed_number_names_line_column_and_text) {
  expect_refused("1 2 3\n4 5.6.7 8\n", "line 2, column 3: \"5.6.7\" is not a number");
  expect_refused("# c\n1,2,abc\n", "line 2, column 5: \"abc\" is not a number");
  for (const std::string word : {"1.2.3", "1e", "--1", "+-1", "0x10", "1_000", "1'000", "12mm", "1d3", "NaN1", "e5",
                                 ".", "-", "+", "1.#XYZ", "nan(", "\xD9\xA1"})
    test::expect_refused("1 2 3\n1 2 " + word + "\n", "line 2, column 5: \"", "scan.xyz");
  test::expect_refused(std::string("1 2 3\n1 \0 3\n", 12), "line 2, column 3: \"?\" is not a number", "scan.xyz");
  test::expect_refused("\xFF\xFE" + std::string("1\0 \0"
                                                "2\0 \0"
                                                "3\0\n\0",
                                                12),
                       "line 1, column 1", "scan.xyz");
  test::expect_refused("1 2 3\r4 5 6\r", "is not a number", "scan.xyz");
}

TEST(TextPoints, a_first_line_that_is_a_broken_point_is_not_taken_for_names) {
  expect_refused("1.2.3 x y\n1 2 3\n", "line 1, column 1: \"1.2.3\" is not a number");
  expect_refused("x 2 3\n1 2 3\n", "line 1, column 1: \"x\" is not a number");
  expect_refused("5000000\n1 2 3\n", "line 1: 1 columns, needed are 3");
}

TEST(TextPoints, a_decimal_comma_is_recognised_and_refused) {
  for (const std::string line : {"1,5 2,5 3,5", "1,5;2,5;3,5", "1,5\t2,5\t3,5", "0,5 1 2", "-1,25 2 3", "1 2,5 3"})
    expect_refused(line + "\n" + line + "\n", "decimal comma is not read: save the scan with decimal points");
}

TEST(TextPoints, too_few_columns_and_too_many_points) {
  expect_refused("1 2 3\n4 5\n", "line 2: 2 columns, needed are 3");
  expect_refused("1 2\n", "line 1: 2 columns");
  std::string many;
  for (int i = 0; i < 65; ++i) many += "1 2 3\n";
  expect_refused(many, "line 65: more than 64 points");
  expect_points(many.substr(6), "a.xyz", [] {
    std::vector<float> xyz;
    for (int i = 0; i < 64; ++i) xyz.insert(xyz.end(), {1, 2, 3});
    return xyz;
  }());
}

TEST(TextPoints, nothing_at_all_is_too_few) {
  for (const std::string text : {"\n\n", "# nothing\n", "x,y,z\n", "   "})
    expect_refused(text, "no points", Code::too_few_points);
  expect_refused("", "0 bytes, nothing was written");
}

TEST(TextPoints, long_lines_have_a_limit_and_say_so) {
  expect_points("1 2 3" + std::string(30'000, ' ') + "\n4 5 6\n", "a.xyz", {1, 2, 3, 4, 5, 6});
  expect_points("#" + std::string(32'000, 'c') + "\n1 2 3 " + std::string(32'000, 'e') + "\n", "a.xyz", {1, 2, 3});
  expect_refused("1 2 3\n" + std::string(1'000'000, '1') + "\n", "line 2: longer than 32768 bytes");
  expect_refused("1 2 3\n" + std::string(1'000'000, '\0'), "line 2: longer than 32768 bytes");
  test::expect_refused("1 2 3\n" + std::string(1'000, '7') + "x 2 3\n", "line 2, column 1: \"7777", "scan.xyz");
}

TEST(TextPoints, lines_across_the_read_window_have_no_seam) {
  std::string text;
  std::vector<float> wanted;
  for (int i = 0; i < 60'000; ++i) {
    const auto v = static_cast<float>(i) * 0.37F;
    char line[80];
    std::snprintf(line, sizeof line, "%.9g %.9g %.9g\n", double{v}, double{-v}, double{v + 0.5F});
    text += line;
    wanted.insert(wanted.end(), {v, -v, v + 0.5F});
  }
  ASSERT_GT(text.size(), 4 * limits::kScanReadBytes);
  const test::Read r = test::read_bytes(text, "a.xyz", LengthUnit::mm, 60'000);
  ASSERT_TRUE(r.shape.ok()) << r.why();
  EXPECT_TRUE(r.xyz == wanted);
}

TEST(TextPoints, numbers_are_read_as_the_c_library_reads_them) {
  Prng prng(11);
  for (int i = 0; i < 200'000; ++i) {
    char text[64];
    const double v = prng.normal() * std::pow(10.0, static_cast<double>(prng.below(40)) - 20.0);
    std::snprintf(text, sizeof text, prng.below(2) == 0 ? "%.*g" : "%.*f", static_cast<int>(prng.below(20)), v);
    double read = 0.0;
    ASSERT_TRUE(parse_number(text, read)) << text;
    ASSERT_EQ(read, std::strtod(text, nullptr)) << text;
  }
}

}  // namespace
}  // namespace slabd::hal
