// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <tuple>

#include "hal/scan/lzf.h"
#include "tests/hal/scan/scan_reading.h"
#include "tests/hal/temporary_folder.h"

// One cloud, written in every supported encoding, must be read as the same bits. The encoders here share no code with
// hal/scan/scan_write.cpp, except the LZF compressor, which lzf_test.cpp tests separately.
namespace slabd::hal {
namespace {

using test::bytes_of;
using test::kMissing;
using test::Read;
using test::read_bytes;
using test::TemporaryFolder;

constexpr std::size_t kWidth = 60, kHeight = 40;

/// A grid with holes and some awkward numbers.
std::vector<float> cloud() {
  Prng prng(5);
  std::vector<float> xyz;
  for (std::size_t i = 0; i < kWidth * kHeight; ++i) {
    const bool missing = prng.below(20) == 0;
    for (int axis = 0; axis < 3; ++axis)
      xyz.push_back(missing ? kMissing
                            : static_cast<float>(prng.normal() * std::pow(10.0, double(prng.below(9)) - 4.0)));
  }
  const std::vector<float> awkward = {0.0F,
                                      -0.0F,
                                      1e-42F,
                                      std::numeric_limits<float>::max(),
                                      -1e30F,
                                      16'777'217.0F,
                                      0.1F,
                                      1.0F / 3.0F,
                                      600.0F,
                                      0.30000001192F,
                                      -123.456787109F,
                                      std::numeric_limits<float>::min()};
  std::copy(awkward.begin(), awkward.end(), xyz.begin());
  return xyz;
}

void expect_same_bits(const std::vector<float>& read, const std::vector<float>& wanted, const std::string& what) {
  ASSERT_EQ(read.size(), wanted.size()) << what;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const bool same = std::isnan(wanted[i]) ? std::isnan(read[i]) : bytes_of(read[i]) == bytes_of(wanted[i]);
    ASSERT_TRUE(same) << what << ": value " << i << " is " << read[i] << ", should be " << wanted[i];
  }
}

std::string digits(double value, int significant) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", significant, value);
  return text;
}

/// x y z of every point as the given type, with two other values between y and z if `extras`.
struct Encoding {
  bool is_double = false;
  bool big_endian = false;
  bool organised = false;
  bool extras = false;
};

template <typename Put>
void each_value(const std::vector<float>& xyz, const Encoding& e, Put put) {
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    put(xyz[i], false);
    put(xyz[i + 1], false);
    if (e.extras) put(static_cast<float>(i), true);
    put(xyz[i + 2], false);
  }
}

std::string binary_body(const std::vector<float>& xyz, const Encoding& e) {
  std::string body;
  each_value(xyz, e, [&](float v, bool extra) {
    if (extra)
      body += bytes_of(static_cast<std::uint16_t>(v), e.big_endian);
    else
      body += e.is_double ? bytes_of(double{v}, e.big_endian) : bytes_of(v, e.big_endian);
  });
  return body;
}

std::string text_body(const std::vector<float>& xyz, const Encoding& e, char separator) {
  std::string body;
  std::size_t values = 0;
  const std::size_t per_line = e.extras ? 4 : 3;
  each_value(xyz, e, [&](float v, bool) {
    body += digits(double{v}, e.is_double ? 17 : 9);
    body += ++values % per_line == 0 ? '\n' : separator;
  });
  return body;
}

std::string ply(const std::vector<float>& xyz, const Encoding& e, bool ascii) {
  const std::string type = e.is_double ? "double" : "float";
  std::string bytes = std::string("ply\nformat ") +
                      (ascii ? "ascii" : (e.big_endian ? "binary_big_endian" : "binary_little_endian")) + " 1.0\n";
  if (e.organised) bytes += "comment organized width 60 height 40\n";
  bytes += "element vertex " + std::to_string(xyz.size() / 3) + "\nproperty " + type + " x\nproperty " + type + " y\n";
  if (e.extras) bytes += "property ushort quality\n";
  bytes += "property " + type + " z\nend_header\n";
  return bytes + (ascii ? text_body(xyz, e, ' ') : binary_body(xyz, e));
}

std::string pcd_planes(const std::vector<float>& xyz, const Encoding& e) {
  std::string planes;
  for (const std::size_t axis : {0U, 1U, 3U, 2U}) {
    if (axis == 3 && !e.extras) continue;
    for (std::size_t i = 0; i < xyz.size(); i += 3) {
      if (axis == 3)
        planes += bytes_of(static_cast<std::uint16_t>(i));
      else
        planes += e.is_double ? bytes_of(double{xyz[i + axis]}) : bytes_of(xyz[i + axis]);
    }
  }
  return planes;
}

std::string pcd(const std::vector<float>& xyz, const Encoding& e, const std::string& data) {
  const std::string size = e.is_double ? "8" : "4";
  std::string bytes = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n";
  bytes += e.extras ? "FIELDS x y quality z\n" : "FIELDS x y z\n";
  bytes += "SIZE " + size + " " + size + (e.extras ? " 2 " : " ") + size + "\n";
  bytes += e.extras ? "TYPE F F U F\nCOUNT 1 1 1 1\n" : "TYPE F F F\nCOUNT 1 1 1\n";
  bytes += e.organised ? "WIDTH 60\nHEIGHT 40\n" : "WIDTH 2400\nHEIGHT 1\n";
  bytes += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2400\nDATA " + data + "\n";
  if (data == "ascii") return bytes + text_body(xyz, e, ' ');
  if (data == "binary") return bytes + binary_body(xyz, e);
  const std::string planes = pcd_planes(xyz, e);
  const std::string compressed = lzf_compress(planes);
  return bytes + bytes_of(static_cast<std::uint32_t>(compressed.size())) +
         bytes_of(static_cast<std::uint32_t>(planes.size())) + compressed;
}

/// Reading the file in pieces gives the same checksum, or the error that this is not possible.
void expect_checksum(const std::string& bytes, const std::string& name, const ScanShape& shape, std::uint32_t crc,
                     const std::string& what) {
  TemporaryFolder folder;
  const std::string path = folder / name;
  std::ofstream(path, std::ios::binary) << bytes;
  const Result<ScanChecksum> sum = read_scan_checksum(path.c_str(), LengthUnit::mm);
  ASSERT_EQ(sum.ok(), shape.in_records) << what;
  if (!sum.ok()) return;
  EXPECT_EQ(sum.value().crc32c, crc) << what;
  EXPECT_EQ(sum.value().shape.points, shape.points) << what;
  EXPECT_EQ(sum.value().shape.finite, shape.finite) << what;
  EXPECT_EQ(sum.value().shape.width, shape.width) << what;
}

void expect_cloud(const std::string& bytes, const std::string& name, bool organised, const std::string& what) {
  const std::vector<float> wanted = cloud();
  const Read r = read_bytes(bytes, name, LengthUnit::mm, wanted.size() / 3);
  ASSERT_TRUE(r.shape.ok()) << what << ": " << r.why();
  EXPECT_EQ(r.shape.value().points, kWidth * kHeight) << what;
  std::size_t finite = 0;
  for (std::size_t i = 0; i < wanted.size(); i += 3) finite += std::isnan(wanted[i]) ? 0U : 1U;
  EXPECT_EQ(r.shape.value().finite, finite) << what;
  EXPECT_EQ(r.shape.value().width, organised ? kWidth : 0U) << what;
  EXPECT_EQ(r.shape.value().height, organised ? kHeight : 0U) << what;
  expect_same_bits(r.xyz, wanted, what);
  EXPECT_EQ(points_crc32c(r.xyz), points_crc32c(wanted)) << what << ": the same checksum, whatever NaN the file has";
  expect_checksum(bytes, name, r.shape.value(), points_crc32c(wanted), what);
}

TEST(ScanFormats, one_cloud_has_the_same_bits_from_every_format_float_and_double_organised_and_not) {
  const std::vector<float> xyz = cloud();
  for (const bool is_double : {false, true})
    for (const bool organised : {false, true})
      for (const bool extras : {false, true}) {
        Encoding e{is_double, false, organised, extras};
        const std::string what = std::string(is_double ? " double" : " float") + (organised ? " organised" : "") +
                                 (extras ? " with extras" : "");
        expect_cloud(ply(xyz, e, true), "a.ply", organised, "ply ascii" + what);
        expect_cloud(ply(xyz, e, false), "a.ply", organised, "ply little" + what);
        expect_cloud(pcd(xyz, e, "ascii"), "a.pcd", organised, "pcd ascii" + what);
        expect_cloud(pcd(xyz, e, "binary"), "a.pcd", organised, "pcd binary" + what);
        expect_cloud(pcd(xyz, e, "binary_compressed"), "a.pcd", organised, "pcd compressed" + what);
        e.big_endian = true;
        expect_cloud(ply(xyz, e, false), "a.ply", organised, "ply big" + what);
      }
  for (const bool is_double : {false, true})
    for (const char separator : {' ', '\t', ',', ';'})
      for (const std::string name : {"a.xyz", "a.asc", "a.txt", "a.csv", "a.XYZ"})
        expect_cloud(text_body(xyz, {is_double, false, false, false}, separator), name, false,
                     name + " between '" + separator + "'");
}

TEST(ScanFormats, output_of_write_scan_is_read_back_bit_by_bit) {
  TemporaryFolder folder;
  const std::vector<float> wanted = cloud();
  for (const ScanFormat format : kScanFormats)
    for (const bool organised : {false, true}) {
      const std::string what(name(format));
      const std::string path = folder / (what + "." + std::string(extension(format)));
      ASSERT_TRUE(write_scan(path.c_str(), format, wanted, organised ? kWidth : 0, organised ? kHeight : 0).ok())
          << what;
      std::vector<float> xyz(wanted.size());
      const Result<ScanShape> shape = read_scan(path.c_str(), LengthUnit::mm, xyz);
      ASSERT_TRUE(shape.ok()) << what << ": " << shape.error().text.c_str();
      const bool can_say = format != ScanFormat::xyz && format != ScanFormat::csv;
      EXPECT_EQ(shape.value().width, organised && can_say ? kWidth : 0U) << what;
      EXPECT_EQ(shape.value().height, organised && can_say ? kHeight : 0U) << what;
      expect_same_bits(xyz, wanted, what);
    }
}

TEST(ScanFormats, an_emulated_scan_declares_itself_and_its_block_in_every_format) {
  TemporaryFolder folder;
  const std::vector<float> wanted = cloud();
  for (const ScanFormat format : kScanFormats) {
    const std::string what(name(format));
    const std::string path = folder / (what + "." + std::string(extension(format)));
    const auto read = [&](WrittenBy by) {
      EXPECT_TRUE(write_scan(path.c_str(), format, wanted, 0, 0, by).ok()) << what;
      std::vector<float> xyz(wanted.size());
      const Result<ScanShape> shape = read_scan(path.c_str(), LengthUnit::mm, xyz);
      EXPECT_TRUE(shape.ok()) << what << ": " << (shape.ok() ? "" : shape.error().text.c_str());
      expect_same_bits(xyz, wanted, what);
      return shape.ok() ? shape.value() : ScanShape{};
    };
    EXPECT_FALSE(read({}).emulated) << what;
    EXPECT_TRUE(read({.emulator = true}).emulated) << what;
    EXPECT_EQ(read({.emulator = true}).emulated_block, 0) << what;
    const ScanShape of_block = read({.emulator = true, .block = 17});
    EXPECT_TRUE(of_block.emulated) << what;
    EXPECT_EQ(of_block.emulated_block, 17) << what;
  }
}

TEST(ScanFormats, a_scan_declares_the_scanners_temperature_in_every_format) {
  TemporaryFolder folder;
  const std::vector<float> wanted = cloud();
  for (const ScanFormat format : kScanFormats) {
    const std::string what(name(format));
    const std::string path = folder / (what + "." + std::string(extension(format)));
    for (const double temperature_c : {31.25, -40.0, 125.0, kNoValue}) {
      ASSERT_TRUE(write_scan(path.c_str(), format, wanted, 0, 0,
                             {.emulator = true, .block = 17, .scanner_temperature_c = temperature_c})
                      .ok())
          << what;
      std::vector<float> xyz(wanted.size());
      const Result<ScanShape> shape = read_scan(path.c_str(), LengthUnit::mm, xyz);
      ASSERT_TRUE(shape.ok()) << what << ": " << shape.error().text.c_str();
      expect_same_bits(xyz, wanted, what);
      EXPECT_TRUE(shape.value().emulated) << what;
      if (std::isnan(temperature_c)) {
        EXPECT_TRUE(std::isnan(shape.value().scanner_temperature_c)) << what;
      } else {
        EXPECT_EQ(shape.value().scanner_temperature_c, temperature_c) << what;
      }
    }
  }
}

TEST(ScanFormats, a_temperature_that_no_scanner_has_is_refused_with_line_and_range) {
  TemporaryFolder folder;
  for (const std::string value : {"warm", "-40.1", "304.4", "nan", ""}) {
    const std::string ply = "ply\nformat ascii 1.0\ncomment scanner_temperature_c " + value +
                            "\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
                            "1 2 3\n";
    const std::string pcd = "# scanner_temperature_c: " + value +
                            "\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\n"
                            "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA ascii\n1 2 3\n";
    const std::string xyz_text = "1 2 3\n4 5 6\n# scanner_temperature_c = " + value + "\n";
    for (const auto& [file, bytes, line] : {std::tuple{"a.ply", ply, 3}, {"a.pcd", pcd, 1}, {"a.xyz", xyz_text, 3}}) {
      const std::string path = folder / file;
      std::ofstream(path, std::ios::binary) << bytes;
      std::vector<float> xyz(6);
      const Result<ScanShape> shape = read_scan(path.c_str(), LengthUnit::mm, xyz);
      ASSERT_FALSE(shape.ok()) << file << " " << value;
      EXPECT_EQ(shape.error().code, Code::frame_incomplete);
      EXPECT_NE(shape.error().text.view().find("line " + std::to_string(line) + ": scanner_temperature_c \"" + value +
                                               "\", allowed is a number of -40..125 deg C"),
                std::string_view::npos)
          << shape.error().text.view();
    }
  }
}

TEST(ScanFormats, a_shape_that_does_not_fit_is_not_written) {
  TemporaryFolder folder;
  const std::vector<float> xyz(3 * 6, 1.0F);
  for (const ScanFormat format : kScanFormats) {
    EXPECT_EQ(write_scan((folder / "a").c_str(), format, xyz, 4, 2).error().code, Code::config) << name(format);
    EXPECT_EQ(write_scan((folder / "a").c_str(), format, std::span(xyz).first(4), 0, 0).error().code, Code::config);
    EXPECT_FALSE(std::filesystem::exists(folder / "a"));
    EXPECT_FALSE(write_scan((folder / "no/a").c_str(), format, xyz, 0, 0).ok());
  }
}

TEST(ScanFormats, formats_are_found_by_name_and_by_extension) {
  for (const ScanFormat format : kScanFormats) EXPECT_EQ(scan_format_named(name(format)), format);
  EXPECT_EQ(scan_format_named("stl"), std::nullopt);
  EXPECT_EQ(scan_format_of("/a.b/scan.PCD"), ScanFormat::pcd);
  EXPECT_EQ(scan_format_of("scan.ply"), ScanFormat::ply);
  EXPECT_EQ(scan_format_of("scan.Asc"), ScanFormat::xyz);
  EXPECT_EQ(scan_format_of("scan.txt"), ScanFormat::xyz);
  EXPECT_EQ(scan_format_of("scan.csv"), ScanFormat::csv);
  EXPECT_EQ(scan_format_of("folder.ply/scan"), std::nullopt);
  EXPECT_EQ(scan_format_of("scan.ply.part"), std::nullopt);
}

TEST(ScanFormats, units_become_mm_and_doubles_are_rounded_once) {
  const std::string um = "-1 0.5 123456.789\n";
  test::expect_points(um, "a.xyz", {-0.001F, 0.0005F, 123.456789F}, LengthUnit::um);
  const std::string head = "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA binary\n";
  test::expect_points(head + bytes_of(0.123456789) + bytes_of(-2.0) + bytes_of(3e-3), "a.pcd",
                      {123.456789F, -2000.0F, 3.0F}, LengthUnit::m);
}

TEST(ScanFormats, a_unit_that_a_file_declares_must_be_the_configured_one) {
  const std::string ply_head = "ply\nformat ascii 1.0\n";
  const std::string ply_tail =
      "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
  for (const std::string line : {"comment unit m", "comment Units: meters", "comment length unit = metres",
                                 "comment units are in m", "obj_info unit m", "comment UNITS [m]"}) {
    const std::string bytes = ply_head + line + "\n" + ply_tail;
    test::expect_refused(bytes, "line 3: the file declares unit \"", "a.ply");
    test::expect_refused(bytes, "but \"um\" is configured", "a.ply", Code::frame_incomplete, LengthUnit::um);
    test::expect_points(bytes, "a.ply", {1000, 2000, 3000}, LengthUnit::m);
  }
  for (const std::string line : {"comment unit mm", "comment unit 4 of the line", "comment made with units", "comment",
                                 "comment units in mm", "comment unit: MM.", "comment units: furlongs"})
    test::expect_points(ply_head + line + "\n" + ply_tail, "a.ply", {1, 2, 3});
  for (const std::string unit : {"cm", "inches", "in", "ft", "yards"})
    for (const LengthUnit configured : {LengthUnit::mm, LengthUnit::m, LengthUnit::um})
      test::expect_refused(ply_head + "comment units " + unit + "\n" + ply_tail, "the file declares unit \"" + unit,
                           "a.ply", Code::frame_incomplete, configured);
  const std::string pcd_tail = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3\n";
  test::expect_refused("# unit: m\n" + pcd_tail, "line 1: the file declares unit \"m\", but \"mm\" is configured",
                       "a.pcd");
  test::expect_points("# unit: um\n" + pcd_tail, "a.pcd", {0.001F, 0.002F, 0.003F}, LengthUnit::um);
  test::expect_refused("1 2 3\n// unit: m\n", "line 2: the file declares unit \"m\"", "a.xyz");
  test::expect_refused("x [m];y [m];z [m]\n1;2;3\n", "line 1: the file declares unit \"m\"", "a.csv");
  test::expect_refused("x_um,y_um,z_um\n1,2,3\n", "line 1: the file declares unit \"um\"", "a.csv");
  test::expect_points("\"X [mm]\";\"Y [mm]\";\"Z [mm]\"\n1;2;3\n", "a.csv", {1, 2, 3});
}

TEST(ScanInDouble, every_family_keeps_every_digit_and_the_unit) {
  const TemporaryFolder folder;
  const std::vector<double> wanted = {1.0 / 3.0, -2.0 / 7.0, 1e-12, kMissing, 0.0, 1.0, 16'777'217.0, 0.1, -1e300};
  std::string table;
  std::string bytes;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    table += digits(wanted[i], 17) + (i % 3 == 2 ? "\n" : " ");
    bytes += bytes_of(wanted[i]);
  }
  const std::string ply =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty double x\n"
      "property double y\nproperty double z\nend_header\n";
  const std::string pcd =
      "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\nHEIGHT 1\n"
      "POINTS 3\nDATA binary\n";
  for (const auto& [name, content] : {std::pair("p.xyz", table), {"p.ply", ply + bytes}, {"p.pcd", pcd + bytes}}) {
    const std::string path = folder / name;
    test::write_file(path, content);
    std::vector<double> xyz(wanted.size());
    const Result<ScanShape> shape = read_scan(path.c_str(), LengthUnit::mm, std::span<double>(xyz));
    ASSERT_TRUE(shape.ok()) << shape.error().text.view();
    EXPECT_EQ(shape.value().finite, 2U) << name;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const bool in_missing_point = i / 3 == 1;
      EXPECT_TRUE(in_missing_point ? std::isnan(xyz[i]) : xyz[i] == wanted[i]) << name << " " << i << " " << xyz[i];
    }
    ASSERT_TRUE(read_scan(path.c_str(), LengthUnit::m, std::span<double>(xyz)).ok());
    EXPECT_EQ(xyz[0], 1.0 / 3.0 * 1000.0) << name;
  }
}

}  // namespace
}  // namespace slabd::hal
