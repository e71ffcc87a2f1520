// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fmt/core.h>

#include <cmath>
#include <cstdlib>
#include <functional>

#include "base/prng.h"
#include "hal/scan/text_lines.h"
#include "tests/hal/scan/scan_reading.h"

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
        "+1 2. 3\n4e0 5.0E+0 .6e1\n", "1 2 3 # note\n4 5 6\n", "\n\r\n  \n1 2 3\n4 5 6\n", "1 2 3\r4 5 6\r",
        "1;2;3\r4;5;6", "1 2 3\r\r\n4 5 6\r\r\n"}) {
    expect_points(text, "a.xyz", {1, 2, 3, 4, 5, 6});
    expect_points(text, "a.csv", {1, 2, 3, 4, 5, 6});
  }
}

TEST(TextPoints, zeros_where_lines_were_are_refused_also_behind_what_is_read) {
  // Content of a file with a lost or unwritten block: the hole covers whole lines.
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
  expect_points("1 2 3\n4 \t5\t 6\n", "a.xyz", {1, 2, 3, 4, 5, 6});  // a tab counts as a blank where blanks separate
}

TEST(TextPoints, names_in_the_first_line_select_the_columns_of_x_y_z) {
  for (const std::string text :
       {"x,y,z\n1,2,3\n", "z,x,y\n3,1,2\n", "id;Y;quality;Z;X\n9;2;0,5;3;1\n", "\"X\",\"Y\",\"Z\"\n1,2,3\n",
        "x [mm] y [mm] z [mm] i\n1 2 3 4\n", "X (mm)\tY (mm)\tZ (mm)\n1\t2\t3\n", "# scan 7\nx y z\n1 2 3\n",
        "x_mm,y_mm,z_mm\n1,2,3\n", "r,z,x,y\n9,3,1,2,8\n"})
    expect_points(text, "a.csv", {1, 2, 3});
  expect_refused("east,north,height\n1,2,3\n",
                 "line 1: no column is named x, y or z: rename three, or choose them with "
                 "--columns A,B,C (on the line: scanner.columns = \"A,B,C\"); the names are \"east,north,height\"");
  expect_refused("\"no\",\"names\",\"known\"\n1,2,3\n", "line 1: no column is named x, y or z");
  expect_refused("intensity,PosX,PosY,PosZ\n12,1,2,3\n",
                 "choose them with --columns PosX,PosY,PosZ (on the line: "
                 "scanner.columns = \"PosX,PosY,PosZ\"); the names are");
  expect_refused("lz [mm];lx [mm];ly [mm]\n3;1;2\n", "choose them with --columns lx,ly,lz (on the line: ");
  expect_refused("Messung am Block\n1 2 3\n", "a line that names no columns begins with #");
  expect_refused("x,y,height\n1,2,3\n", "line 1: of x, y and z only 2");
  expect_refused("x,y,z,x\n1,2,3,4\n", "line 1: a second column named \"x\"");
  expect_refused("x,y,z\nx,y,z\n1,2,3\n", "line 2, column 1: \"x\" is not a number");
  expect_refused("1,2,3\nx,y,z\n", "line 2, column 1: \"x\" is not a number");
  expect_refused("id,a,x,y,z\n1,2,3,4\n", "line 2: 4 columns, needed are 5");
  // A unit does not need a comment mark.
  expect_points("Units: mm\n1 2 3\n", "a.csv", {1, 2, 3});
  expect_refused("Units: m\n1 2 3\n", "line 1: the file declares unit \"m\", but \"mm\" is configured");
}

TEST(TextPoints, names_in_a_comment_above_the_points_also_select_the_columns_of_x_y_z) {
  for (const std::string text :
       {"//X Y Z\n1 2 3\n", "//Z Y X\n3 2 1\n", "# Z,Y,X\n3,2,1\n", "# z y x\n3,2,1\n", "//id X Y Z\n9 1 2 3\n",
        "# columns: id x y z\n9 1 2 3\n", "# id;\"Z [mm]\";y_mm;X (mm);\n9;3;2;1;\n", "# z y x\n# scan 7\n\n3 2 1\n",
        "# a b c\n# z y x\n3 2 1\n", "# z y x\nx y z\n1 2 3\n", "# z [mm] y [mm] x [mm]\n3 2 1\n",
        "//X Y Z R G B Scalar field\n1 2 3 4 5 6 7\n"})
    expect_points(text, "a.asc", {1, 2, 3});
  // Sentences, and comments below the first point.
  for (const std::string text :
       {"# x y z are in the scanner's frame\n1 2 3\n", "# z up, y across, x along\n1 2 3\n",
        "# x: along, y: across\n1 2 3\n", "# the axes z, y and x\n1,2,3\n", "# x\n1 2 3\n", "# z y\n1 2 3\n"})
    expect_points(text, "a.asc", {1, 2, 3});
  expect_points("1 2 3\n# z y x\n4 5 6\n", "a.xyz", {1, 2, 3, 4, 5, 6});
  expect_refused("//id X Y Z\n9 1 2 3 4\n",
                 "line 2: 5 columns, but the comment on line 1 names 4, and x, y, z are not its first three");
  expect_refused("# x y z x\n1 2 3 4\n", "line 1: a second column named \"x\"");
  expect_refused("# z [m] y [m] x [m]\n3 2 1\n", "line 1: the file declares unit \"m\"");
  expect_refused("# id x y z\n9 1 2 3\n9 1 2\n", "line 3: 3 columns, needed are 4");
}

TEST(TextPoints, an_absent_or_non_finite_coordinate_is_a_missing_point) {
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
  const std::string wide(
      "1\0 \0"
      "2\0 \0"
      "3\0\n\0",
      12);
  expect_refused("\xFF\xFE" + wide, "UTF-16 text, two bytes for each character: save it as UTF-8 or ASCII");
  expect_refused(wide, "UTF-16 text");
  expect_refused("\xFE\xFF" + std::string(1, '\0') + wide.substr(0, 11), "UTF-16 text");
}

TEST(TextPoints, a_first_line_that_is_a_broken_point_is_not_read_as_names) {
  expect_refused("1.2.3 x y\n1 2 3\n", "line 1, column 1: \"1.2.3\" is not a number");
  expect_refused("x 2 3\n1 2 3\n", "line 1, column 1: \"x\" is not a number");
  expect_refused("12\n1 2 3\n", "line 1 announces 12 points, the file has 1");
  expect_refused("1.5\n1 2 3\n", "line 1: 1 columns, needed are 3");
}

TEST(TextPoints, a_count_in_the_first_line_is_compared_with_the_number_of_lines) {
  for (const std::string text :
       {"2\n1 2 3\n4 5 6\n", "# scan 7\n 2 \n1,2,3\n4,5,6", "//X Y Z\n2\n1 2 3\n4 5 6\n", "x y z\n2\n1 2 3\n4 5 6\n",
        "2\nx;y;z\n1;2;3\n4;5;6\n", "2\r\n1 2 3\r\n4 5 6\r\n", "2\r1 2 3\r4 5 6\r",
        "\xEF\xBB\xBF"
        "2\n1 2 3\n\n4 5 6\n"})
    expect_points(text, "a.asc", {1, 2, 3, 4, 5, 6});
  expect_points("2\n1 2 3\nnan nan nan\n", "a.asc", {1, 2, 3, kMissing, kMissing, kMissing});
  expect_refused("3\n1 2 3\n4 5 6\n",
                 "line 1 announces 3 points, the file has 2: it was cut, or is still being written");
  expect_refused("# scan\n1\n1 2 3\n4 5 6\n", "line 2 announces 1 points, the file has 2");
  expect_refused("65\n1 2 3\n", "line 1: 65 points, allowed are at most 64");
  expect_refused("2\n2\n1 2 3\n4 5 6\n", "line 2: 1 columns, needed are 3");
  expect_refused("1 2 3\n2\n4 5 6\n", "line 2: 1 columns, needed are 3");
  expect_refused("2\n", "no points", Code::too_few_points);
  // Many rows, which take another path.
  std::string many;
  for (int i = 0; i < 60; ++i) many += "1.25 2.5 3.75\n";
  EXPECT_TRUE(test::read_bytes("60\n" + many, "a.asc").shape.ok());
  expect_refused("61\n" + many, "line 1 announces 61 points, the file has 60");
}

std::string table(int rows, int columns, const std::string& first = "") {
  std::string text;
  for (int row = 0; row < rows; ++row) {
    text += first.empty() ? "" : std::to_string(row + std::stoi(first)) + ",";
    for (int column = 0; column < columns; ++column)
      text += (column == 0 ? "" : ",") + std::to_string(20.5 + column + row);
    text += "\n";
  }
  return text;
}

TEST(TextPoints, a_height_map_and_a_first_column_that_counts_rows_are_not_points) {
  expect_refused(table(40, 60), "line 1: 60 columns: a height map, not points");
  expect_refused("# heights in mm\n" + table(40, 60), "line 2: 60 columns: a height map, not points");
  expect_refused(table(40, 25), "25 columns: a height map");
  expect_refused(table(40, 24), "all 24 columns hold the same kind of number: a height map");
  EXPECT_TRUE(test::read_bytes(table(40, 3), "a.csv").shape.ok()) << "three columns are x, y, z";
  for (const std::string first : {"0", "1", "1000"}) {
    expect_refused(
        table(40, 3, first),
        "of 4 columns the first numbers the points and is not x: choose the columns, as with --columns 2,3,4");
    EXPECT_TRUE(test::read_bytes("x,y,z,i\n" + table(40, 3, first), "a.csv").shape.ok()) << "its names say so";
    EXPECT_TRUE(test::read_bytes(table(40, 2, first), "a.csv").shape.ok()) << "three columns are x, y, z";
    EXPECT_TRUE(test::read_bytes(table(40, 3, first) + "7,8,9,9\n", "a.csv").shape.ok()) << "a coordinate";
  }
}

/// Points of a grid with its indices in front; every `gap`th is missing.
std::string grid(const std::function<std::string(int, int)>& in_front, int gap = 1000) {
  std::string text;
  for (int row = 0; row < 8; ++row)
    for (int column = 0; column < 8; ++column)
      if ((8 * row + column) % gap != gap - 1)
        text += in_front(row, column) +
                fmt::format("{:.3f} {:.3f} {:.3f} 90\n", 2.5 * column - 12, 2.5 * row - 15, 499.5 + 0.01 * column);
  return text;
}

TEST(TextPoints, numbers_of_points_and_of_their_rows_and_columns_are_not_read_as_coordinates) {
  const std::string index =
      "the first two are a point's row and column and not x and y: choose the columns, as with --columns 3,4,5";
  for (const int gap : {1000, 7}) {
    expect_refused(grid([](int row, int column) { return fmt::format("{} {} ", row, column); }, gap), index);
    expect_refused(grid([](int row, int column) { return fmt::format("{} {} ", column + 1, row + 1); }, gap), index);
  }
  expect_refused(grid([](int row, int column) { return fmt::format("{} ", 5000 + 8 * row + column); }, 11),
                 "the first numbers the points");
  EXPECT_TRUE(test::read_bytes(grid([](int, int) { return ""; }), "a.xyz").shape.ok());
  // A grid of whole millimetres contains coordinates: three columns, or four with a brightness.
  std::string raster;
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) raster += fmt::format("{} {} 499.{} 90\n", x, y, x + y);
  EXPECT_TRUE(test::read_bytes(raster, "a.xyz").shape.ok());
}

/// 400 points of a scan with noise, 20 in a profile; `line(i, xyz)` adds the other columns of point i.
std::string scan_of(const std::function<std::string(int, const std::string&)>& line) {
  Prng random(7);
  std::string text;
  for (int i = 0; i < 400; ++i)
    text += line(i, fmt::format("{:.4f} {:.4f} {:.4f}", 2.5 * (i % 20) - 25.0 + 0.1 * random.normal(),
                                2.5 * (i / 20) - 25.0 + 0.1 * random.normal(), 600.0 + 0.02 * random.normal())) +
            "\n";
  return text;
}
void expect_columns_refused(const std::string& text, const std::string& what, const std::string& three) {
  const test::Read r = test::read_bytes(text, "a.txt", LengthUnit::mm, 400);
  ASSERT_FALSE(r.shape.ok()) << "should be refused: " << what;
  EXPECT_NE(r.why().find(what), std::string::npos) << r.why();
  EXPECT_NE(r.why().find("--columns " + three + " ("), std::string::npos) << r.why();
}
void expect_read(const std::string& text, const std::string& what) {
  const test::Read r = test::read_bytes(text, "a.txt", LengthUnit::mm, 2'000);
  EXPECT_TRUE(r.shape.ok()) << what << ": " << r.why();
}

TEST(TextPoints, a_first_column_that_climbs_or_falls_evenly_is_not_x) {
  const std::string number = "the first numbers the points and is not x";
  const std::string time = "the first climbs or falls evenly, as a time does, and is not x";
  const auto in_front = [](const std::function<std::string(int)>& first) {
    return scan_of([&first](int i, const std::string& xyz) { return first(i) + " " + xyz; });
  };
  expect_columns_refused(in_front([](int i) { return fmt::format("{}", 7 + 3 * i); }), number, "2,3,4");
  expect_columns_refused(in_front([](int i) { return fmt::format("{}", 9000 - i); }), number, "2,3,4");
  expect_columns_refused(in_front([](int i) { return fmt::format("{}.0", i + i / 15); }), number, "2,3,4");
  for (const double start : {0.0, 12'345.0, 1'234'567.0, 1'700'000'000.0})  // a float holds the last two coarsely
    expect_columns_refused(in_front([start](int i) { return fmt::format("{:.4f}", start + 0.004 * i); }), time,
                           "2,3,4");
  expect_columns_refused(in_front([](int i) { return fmt::format("{:.4f}", 50.0 - 0.004 * i - 0.0003 * (i % 3)); }),
                         time, "2,3,4");
  expect_columns_refused(in_front([](int i) { return fmt::format("{} 3", i); }), number, "3,4,5");
  expect_columns_refused(in_front([](int i) { return fmt::format("{} {:.3f}", i, 0.004 * i); }), number, "3,4,5");
}

TEST(TextPoints, a_column_with_the_same_value_in_every_line_is_not_a_coordinate) {
  expect_columns_refused(scan_of([](int, const std::string& xyz) { return "3 " + xyz; }),
                         "the first is the same in every line and is not x", "2,3,4");
  expect_columns_refused(scan_of([](int, const std::string& xyz) { return "3 17.5 " + xyz + " 90"; }),
                         "the first is the same in every line and is not x", "3,4,5");
  expect_columns_refused(scan_of([](int, const std::string& xyz) {
                           return xyz.substr(0, xyz.find(' ')) + " 0" + xyz.substr(xyz.find(' ')) + " 90";
                         }),
                         "the second is the same in every line and is not y", "1,3,4");
}

TEST(TextPoints, a_colour_or_a_brightness_in_front_is_not_a_coordinate) {
  const auto colour = [](int i) { return fmt::format("{} {} {}", i % 256, 7 * i % 256, 13 * i % 256); };
  const std::string named = "are a colour and not coordinates";
  expect_columns_refused(scan_of([&](int i, const std::string& xyz) { return colour(i) + " " + xyz; }), named, "4,5,6");
  expect_columns_refused(scan_of([&](int, const std::string& xyz) { return "128 128 128 " + xyz; }), named, "4,5,6");
  expect_columns_refused(scan_of([&](int i, const std::string& xyz) { return colour(i) + " 255 " + xyz; }), named,
                         "5,6,7");
  expect_columns_refused(
      scan_of([](int i, const std::string& xyz) { return fmt::format("{} {}", 7 * i * i % 251, xyz); }),
      "the first has whole numbers in no order, as a brightness does, and is not x", "2,3,4");
  expect_columns_refused(scan_of([](int i, const std::string& xyz) { return fmt::format("{} {}", 120 + i % 9, xyz); }),
                         "the first has whole numbers in no order, as a brightness does, and is not x", "2,3,4");
}

TEST(TextPoints, two_or_three_points_a_line_are_named) {
  std::vector<std::string> points;
  static_cast<void>(scan_of([&points](int, const std::string& xyz) {
    points.push_back(xyz);
    return xyz;
  }));
  for (const std::size_t side_by_side : {2U, 3U}) {
    std::string text;
    for (std::size_t i = 0; i + side_by_side <= 390; ++i)
      text += points[i] + ((i + 1) % side_by_side == 0 ? "\n" : " ");
    expect_columns_refused(text, fmt::format("{} points side by side, x,y,z,x,y,z", side_by_side), "1,2,3");
  }
}

TEST(TextPoints, right_tables_with_more_columns_are_read) {
  const auto behind = [](const std::function<std::string(int)>& more) {
    return scan_of([&more](int i, const std::string& xyz) { return xyz + " " + more(i); });
  };
  expect_read(behind([](int) { return "0 0 1"; }), "normals");
  expect_read(behind([](int i) {
                return fmt::format("{:.4f} 0 {:.4f}", 0.01 * (i % 9), -std::sqrt(1 - 1e-4 * (i % 9) * (i % 9)));
              }),
              "normals");
  expect_read(behind([](int i) { return fmt::format("{} {} {}", i % 256, 7 * i % 256, 13 * i % 256); }), "colours");
  expect_read(behind([](int i) { return fmt::format("{}", i); }), "numbers behind");
  expect_read(behind([](int) { return "3"; }), "a scan number behind");
  expect_read(behind([](int i) { return fmt::format("{:.4f}", 1e9 + 0.004 * i); }), "times behind");
  // A line profiler: x climbs evenly within a profile and repeats; y is constant in it.
  std::string profiles;
  std::string turning;
  std::string rows;
  std::string columns;
  std::string whole;
  for (int i = 0; i < 1'000; ++i) {
    const double z = 600 + 0.01 * (i * 37 % 11);
    profiles += fmt::format("{:.3f} {:.3f} {:.4f} 90\n", 0.17 * (i % 500), 1.0 * (i / 500), z);
    const int back = (i / 250) % 2 == 0 ? i % 250 : 249 - i % 250;
    turning += fmt::format("{:.3f} {:.3f} {:.4f} 90\n", 0.17 * back, 1.0 * (i / 250), z);
    rows += fmt::format("{:.2f} {:.2f} {:.4f} {}\n", 0.25 * (i % 40), 0.25 * (i / 40), z, i);
    columns += fmt::format("{:.2f} {:.2f} {:.4f} {}\n", 0.25 * (i / 40), 0.25 * (i % 40), z, i);
    whole += fmt::format("{} {} {} 0.0 0.6 0.8\n", 3 * (i % 40), 3 * (i / 40), 10 + i * 37 % 11);
  }
  expect_read(profiles, "profiles");
  std::string pixels;
  for (int i = 0; i < 1'000; ++i)
    pixels += fmt::format("{} {:.3f} {:.4f} 90.5\n", i % 25, 0.37 * (i / 25) + 0.013, 600.001 + 0.01 * (i * 37 % 11));
  expect_read(pixels, "profiles by pixels");
  expect_read(turning, "profiles to and fro");
  expect_read(rows, "a raster by rows");
  expect_read(columns, "a raster by columns");
  expect_read(whole, "whole coordinates with normals");
  std::string one;
  for (int i = 0; i < 1'000; ++i) one += fmt::format("{:.3f} {}.000 {:.4f}\n", 0.17 * i, i, 600 + 0.01 * (i % 7));
  expect_read(one, "three columns");
  for (const std::string columns_of : {"4,5,6", "3,4,5"}) {
    // Chosen columns are not questioned.
    const std::string text = scan_of([](int i, const std::string& xyz) { return fmt::format("{} 3 {} 7", i, xyz); });
    std::vector<float> xyz(3 * 400);
    Team alone(1);
    const Fd fd = test::memory_file(text);
    EXPECT_TRUE(
        read_scan_fd(fd.get(), "a.txt", {LengthUnit::mm, parse_table_columns(columns_of).value()}, xyz, alone).ok());
  }
}

TEST(TextPoints, whole_numbers_above_lines_with_decimals_are_a_header_and_not_a_point) {
  const std::string scan = scan_of([](int, const std::string& xyz) { return xyz; });
  const auto points_of = [](const std::string& text) {
    const test::Read r = test::read_bytes(text, "a.asc", LengthUnit::mm, 401);
    return r.shape.ok() ? fmt::format("{}", r.shape.value().points) : r.why();
  };
  for (const std::string header : {"1 2 3\n", "0 1 2\n", "1;2;3\n", "# scan\n1 2 3\n", "20 20 400\n", "1\t2\t3\r\n"})
    EXPECT_EQ(points_of(header + scan), "400") << header;
  EXPECT_NE(points_of("21 19 399\n" + scan).find("line 1 announces 399 points, the file has 400"), std::string::npos);
  EXPECT_NE(points_of("20 30 600\n" + scan).find("line 1: 600 points, allowed are at most 401"), std::string::npos);
  for (const std::string header : {"2026 11 28\n", "20 20 1\n", "20 20 400 5\n", "1 2 3 4 6\n"})
    EXPECT_NE(points_of(header + scan)
                  .find("line 1: \"" + header.substr(0, header.size() - 1) +
                        "\": whole numbers above lines with decimals are a header"),
              std::string::npos)
        << points_of(header + scan);
  // Other widths hide the columns behind the header.
  const std::string wide = scan_of([](int i, const std::string& xyz) { return fmt::format("{} {}", i, xyz); });
  EXPECT_NE(points_of("20 20 400\n" + wide).find("the first numbers the points"), std::string::npos);
  // Points: missing, below zero, in a raster of whole numbers, or with too few lines to tell.
  for (const std::string point : {"0 0 0\n", "99999 99999 99999\n", "-1 2 3\n", "1.0 2.0 3.0\n"})
    EXPECT_EQ(points_of(point + scan), "401") << point;
  std::string raster = "0 0 600\n";
  for (int i = 1; i < 100; ++i) raster += fmt::format("{} {} 600.{}\n", i % 10, i / 10, i);
  EXPECT_EQ(points_of(raster), "100");
}

TEST(TextPoints, a_header_of_column_numbers_is_not_read_as_a_point) {
  std::string rows;
  for (int i = 0; i < 30; ++i) rows += fmt::format("{},-{}.25,2.5,499.5\n", i, i);
  expect_refused(",0,1,2\n" + rows, "of 4 columns the first numbers the points");
  expect_points("0,1,2\n1.5,2.5,3.5\n", "a.csv", {1.5, 2.5, 3.5});
  expect_points("0 1 2\n1.5 2.5 3.5\n", "a.xyz", {0, 1, 2, 1.5, 2.5, 3.5});
}

TEST(TextPoints, points_side_by_side_are_distinguished_from_a_height_map) {
  std::string row;
  for (int i = 0; i < 40; ++i) row += fmt::format("{}{:.2f},-36.25,499.{:02}", i == 0 ? "" : ",", 2.5 * i - 48, i);
  expect_refused(row + "\n" + row + "\n", "120 columns: the points of a row side by side, x,y,z,x,y,z");
}

TEST(TextPoints, quoted_numbers_are_numbers_and_names_are_shown_as_they_are) {
  expect_points("\"x\",\"y\",\"z\"\n\"1\",\"2.5\",\"-3\"\n", "a.csv", {1, 2.5, -3});
  expect_refused("X\u5750\u6807,Y\u5750\u6807,Z\u5750\u6807,n\n1,2,3,4\n",
                 "or choose them with --columns 1,2,3 (on the line: scanner.columns = \"1,2,3\"); the names are "
                 "\"X\u5750\u6807,Y\u5750\u6807");
  expect_refused("a\x1B,b,c\n1,2,3\n", "the names are \"a?,b,c\" (a line that names no columns");
  const std::string not_utf8 = "?,b,c\" (this text is not UTF-8, perhaps GBK: save it as UTF-8, or choose by number)";
  expect_refused("a\xD7\xF8,b,c\n1,2,3\n", "the names are \"a?" + not_utf8);
}

TEST(TextPoints, names_in_a_comment_that_are_not_x_y_z_are_refused) {
  expect_refused("# intensity,PosX,PosY,PosZ\n12,1,2,3\n",
                 "line 2: the comment on line 1 names the columns, none of them x, y or z");
  expect_refused("//intensity PosX PosY PosZ\n12 1 2 3\n", "the comment on line 1 names the columns");
  expect_refused("# a;b;c;d\n12;1;2;3\n", "the comment on line 1 names the columns");
  for (const std::string text : {"# PosX,PosY,PosZ,intensity\n1,2,3,12\n", "# seen by the left scanner\n1 2 3 12\n",
                                 "# first, second, third\n1,2,3\n", "# a, sentence, of, commas\n1 2 3 4\n"})
    expect_points(text, "a.csv", {1, 2, 3});
}

std::string refusal_of(const std::string& text, const std::string& columns, const std::string& name = "a.csv") {
  std::vector<float> xyz(3 * 64);
  Team alone(1);
  const Result<TableColumns> chosen = parse_table_columns(columns);
  if (!chosen) return chosen.error().text.c_str();
  const Fd fd = test::memory_file(text);
  const Result<ScanShape> shape = read_scan_fd(fd.get(), name.c_str(), {LengthUnit::mm, chosen.value()}, xyz, alone);
  if (!shape) return shape.error().text.c_str();
  EXPECT_EQ(xyz[0], 1.0F) << text;
  EXPECT_EQ(xyz[1], 2.0F) << text;
  EXPECT_EQ(xyz[2], 3.0F) << text;
  return "";
}

TEST(TextPoints, columns_are_chosen_by_name_or_by_number) {
  const std::string named = "intensity,PosX [mm],\"PosY\",PosZ\n12,1,2,3\n";
  for (const std::string columns : {"PosX,PosY,PosZ", "posx, posy ,POSZ", "2,3,4", "PosX,3,PosZ"})
    EXPECT_EQ(refusal_of(named, columns), "");
  for (const std::string text :
       {"9 1 2 3\n", "# i a b c\n9 1 2 3\n", "1\n9 1 2 3\n", "# scan of block four\n9 1 2 3\n", "x y z i\n9 1 2 3\n"})
    EXPECT_EQ(refusal_of(text, "2,3,4"), "");
  EXPECT_EQ(refusal_of("# i PosZ PosY PosX\n9 3 2 1\n", "PosX,PosY,PosZ"), "");
  EXPECT_EQ(refusal_of("i;z;y;x\n9;3;2;1\n", "x,y,z"), "");
  EXPECT_EQ(refusal_of("a.csv: 12 columns\n1,2,3\n", "1,2,3").substr(0, 13), "a.csv: line 1");
  const auto holds = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  holds(refusal_of(named, "PosX,PosY,PosW"), "line 1: no column is named \"PosW\", the names are \"intensity,PosX");
  holds(refusal_of("9 1 2 3\n", "PosX,PosY,PosZ"), "this table does not name its columns: choose them by number");
  holds(refusal_of("9 1 2\n", "2,3,4"), "line 1: 3 columns, needed are 4");
  holds(refusal_of("i,PosX [m],PosY,PosZ\n9,1,2,3\n", "PosX,PosY,PosZ"), "the file declares unit \"m\"");
  for (const std::string& columns : {std::string(), std::string("x"), std::string("x,y"), std::string("x,y,z,i"),
                                     std::string(",,"), std::string("1,2,"), std::string(41, 'x') + ",y,z"})
    holds(refusal_of(named, columns), "expected are three names or numbers");
}

TEST(TextPoints, a_decimal_comma_is_recognised_and_refused) {
  for (const std::string line : {"1,5 2,5 3,5", "1,5;2,5;3,5", "1,5\t2,5\t3,5", "0,5 1 2", "-1,25 2 3", "1 2,5 3"})
    expect_refused(line + "\n" + line + "\n", "decimal comma is not read: save the scan with decimal points");
  const std::string quoted = "\"-49,9866\",\"-49,9153\",\"600,0020\"\n";
  for (const std::string& first : {std::string("x,y,z\n"), std::string()})
    expect_refused(first + quoted, "decimal comma is not read: save the scan with decimal points");
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

TEST(TextPoints, an_empty_file_has_too_few_points) {
  for (const std::string text : {"\n\n", "# nothing\n", "x,y,z\n", "   ", "Units: mm\n"})
    expect_refused(text, "no points", Code::too_few_points);
  expect_refused("", "0 bytes, the file is empty");
}

TEST(TextPoints, length_of_lines_is_limited_and_the_error_states_the_limit) {
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
