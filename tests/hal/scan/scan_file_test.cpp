// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "hal/hal.h"
#include "hal/scan/ply.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

using test::TemporaryFolder;
using test::write_file;

constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();

template <typename T>
std::string bytes_of(T value, bool big_endian = false) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  if (big_endian) bytes = {bytes.rbegin(), bytes.rend()};
  return bytes;
}

std::string header(const std::string& format, const std::string& body) {
  return "ply\nformat " + format + " 1.0\n" + body + "end_header\n";
}

const std::string kFloatXyz = "property float x\nproperty float y\nproperty float z\n";
const std::string kLittle = "binary_little_endian";

struct Read {
  std::vector<float> xyz;
  Result<ScanShape> shape;
};

Read read(const std::string& path, LengthUnit unit = LengthUnit::mm, std::size_t capacity_points = 64) {
  std::vector<float> xyz(3 * capacity_points, -1.0F);
  Result<ScanShape> shape = read_scan(path.c_str(), unit, xyz);
  return {std::move(xyz), std::move(shape)};
}

/// Expects that the file is rejected with a text that contains `expected`.
void expect_refused(const std::string& bytes, const std::string& expected, Code code = Code::frame_incomplete,
                    const std::string& name = "scan.ply") {
  TemporaryFolder folder;
  write_file(folder / name, bytes);
  const Read r = read(folder / name);
  ASSERT_FALSE(r.shape.ok()) << expected;
  EXPECT_EQ(r.shape.error().code, code);
  EXPECT_NE(r.shape.error().text.view().find(expected), std::string_view::npos) << r.shape.error().text.c_str();
  EXPECT_NE(r.shape.error().text.view().find(name), std::string_view::npos) << r.shape.error().text.c_str();
}

TEST(ScanFile, written_points_are_read_back_bit_by_bit) {
  TemporaryFolder folder;
  const std::vector<float> xyz = {1.5F, -2.25F, 600.0F, kMissing, kMissing, kMissing, 0.1F, 0.2F, 0.3F};
  ASSERT_TRUE(write_ply((folder / "a.ply").c_str(), xyz, 0, 0).ok());
  const Read r = read(folder / "a.ply");
  ASSERT_TRUE(r.shape.ok()) << r.shape.error().text.c_str();
  EXPECT_EQ(r.shape.value().points, 3U);
  EXPECT_EQ(r.shape.value().finite, 2U);
  EXPECT_EQ(r.shape.value().width, 0U);
  for (std::size_t i : {0U, 1U, 2U, 6U, 7U, 8U}) EXPECT_EQ(r.xyz[i], xyz[i]);
  for (std::size_t i : {3U, 4U, 5U}) EXPECT_TRUE(std::isnan(r.xyz[i]));
  EXPECT_EQ(r.xyz[9], -1.0F) << "nothing is written beyond the points";
}

TEST(ScanFile, organised_shape_is_written_and_read) {
  TemporaryFolder folder;
  const std::vector<float> xyz(3 * 6, 1.0F);
  ASSERT_TRUE(write_ply((folder / "a.ply").c_str(), xyz, 3, 2).ok());
  const Read r = read(folder / "a.ply");
  ASSERT_TRUE(r.shape.ok());
  EXPECT_EQ(r.shape.value().width, 3U);
  EXPECT_EQ(r.shape.value().height, 2U);
  EXPECT_EQ(write_ply((folder / "b.ply").c_str(), xyz, 4, 2).error().code, Code::config);
  EXPECT_FALSE(std::filesystem::exists(folder / "b.ply"));
}

TEST(ScanFile, pieces_larger_than_the_read_buffer_join_without_a_seam) {
  TemporaryFolder folder;
  const std::size_t points = 3 * limits::kScanReadBytes / 12 + 7;
  std::vector<float> xyz(3 * points);
  for (std::size_t i = 0; i < xyz.size(); ++i) xyz[i] = static_cast<float>(i);
  ASSERT_TRUE(write_ply((folder / "direct.ply").c_str(), xyz, 0, 0).ok());
  const Read direct = read(folder / "direct.ply", LengthUnit::mm, points);
  ASSERT_TRUE(direct.shape.ok());
  EXPECT_EQ(direct.xyz, xyz);
  // The same points with a colour byte after each take the other path.
  std::string bytes =
      header(kLittle, "element vertex " + std::to_string(points) + "\n" + kFloatXyz + "property uchar red\n");
  for (std::size_t i = 0; i < points; ++i)
    bytes += bytes_of(xyz[3 * i]) + bytes_of(xyz[3 * i + 1]) + bytes_of(xyz[3 * i + 2]) + "r";
  write_file(folder / "pieces.ply", bytes);
  const Read pieces = read(folder / "pieces.ply", LengthUnit::mm, points);
  ASSERT_TRUE(pieces.shape.ok());
  EXPECT_EQ(pieces.xyz, xyz);
}

TEST(ScanFile, both_byte_orders_float_and_double_and_other_properties) {
  for (const bool big : {false, true}) {
    TemporaryFolder folder;
    std::string bytes = header(big ? "binary_big_endian" : kLittle,
                               "comment made by hand\nobj_info nothing\nelement vertex 2\nproperty uchar red\n"
                               "property double z\nproperty float32 x\nproperty short quality\nproperty float64 y\n");
    for (const double k : {1.0, 2.0})
      bytes += "R" + bytes_of(k * 30.0, big) + bytes_of(static_cast<float>(k * 10.0), big) +
               bytes_of(std::int16_t{7}, big) + bytes_of(k * 20.0, big);
    write_file(folder / "a.ply", bytes);
    const Read r = read(folder / "a.ply");
    ASSERT_TRUE(r.shape.ok()) << r.shape.error().text.c_str();
    EXPECT_EQ(r.shape.value().points, 2U);
    const std::vector<float> expected = {10, 20, 30, 20, 40, 60};
    for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(r.xyz[i], expected[i]) << i << (big ? " big" : " little");
  }
}

TEST(ScanFile, units_become_mm) {
  TemporaryFolder folder;
  const std::vector<float> xyz = {0.5F, 0.25F, -1.0F};
  ASSERT_TRUE(write_ply((folder / "float.ply").c_str(), xyz, 0, 0).ok());
  EXPECT_EQ(read(folder / "float.ply", LengthUnit::m).xyz[0], 500.0F);
  EXPECT_EQ(read(folder / "float.ply", LengthUnit::um).xyz[2], -0.001F);
  write_file(folder / "double.ply",
             header(kLittle, "element vertex 1\nproperty double x\nproperty double y\nproperty double z\n") +
                 bytes_of(0.123456789) + bytes_of(-2.0) + bytes_of(3e-3));
  const Read metres = read(folder / "double.ply", LengthUnit::m);
  ASSERT_TRUE(metres.shape.ok());
  EXPECT_EQ(metres.xyz[0], 123.456789F) << "converted as double, rounded once";
  EXPECT_EQ(metres.xyz[1], -2000.0F);
  EXPECT_EQ(metres.xyz[2], 3.0F);
}

TEST(ScanFile, whatever_is_not_finite_is_missing_in_all_three_coordinates) {
  TemporaryFolder folder;
  const float inf = std::numeric_limits<float>::infinity();
  const float huge = std::numeric_limits<float>::max();
  const std::vector<float> xyz = {1, 2, kMissing, inf, 0, 0, 0, -inf, 0, huge, 0, 0, 4, 5, 6};
  ASSERT_TRUE(write_ply((folder / "a.ply").c_str(), xyz, 0, 0).ok());
  const Read r = read(folder / "a.ply", LengthUnit::m);  // huge metres overflow in mm
  ASSERT_TRUE(r.shape.ok());
  EXPECT_EQ(r.shape.value().finite, 1U);
  for (std::size_t i = 0; i < 12; ++i) EXPECT_TRUE(std::isnan(r.xyz[i])) << i;
  EXPECT_EQ(r.xyz[12], 4000.0F);
}

TEST(ScanFile, carriage_returns_in_the_header_are_taken) {
  TemporaryFolder folder;
  write_file(folder / "a.PLY",
             "ply\r\nformat binary_little_endian 1.0\r\nelement vertex 1\r\nproperty float x\r\nproperty float y\r\n"
             "property float z\r\nend_header\r\n" +
                 bytes_of(1.0F) + bytes_of(2.0F) + bytes_of(3.0F));
  const Read r = read(folder / "a.PLY");
  ASSERT_TRUE(r.shape.ok()) << r.shape.error().text.c_str();
  EXPECT_EQ(r.xyz[2], 3.0F);
}

TEST(ScanFile, elements_before_and_after_the_vertices_are_stepped_over) {
  TemporaryFolder folder;
  const std::string vertex = bytes_of(1.0F) + bytes_of(2.0F) + bytes_of(3.0F);
  const std::string camera = "element camera 2\nproperty double focus\nproperty uchar id\n";
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  const std::string head = header(kLittle, camera + "element vertex 1\n" + kFloatXyz + face);
  write_file(folder / "a.ply", head + std::string(18, 'c') + vertex + "\x03" + std::string(12, 'i'));
  const Read r = read(folder / "a.ply");
  ASSERT_TRUE(r.shape.ok()) << r.shape.error().text.c_str();
  EXPECT_EQ(r.shape.value().points, 1U);
  EXPECT_EQ(r.xyz[0], 1.0F);
  // A face stores at least its count.
  expect_refused(head + std::string(18, 'c') + vertex, "requires at least");
}

TEST(ScanFile, a_file_of_another_length_than_its_header_declares_is_refused) {
  const std::string whole = header(kLittle, "element vertex 3\n" + kFloatXyz) + std::string(36, '\0');
  for (std::size_t cut = 1; cut <= 36; ++cut)
    expect_refused(whole.substr(0, whole.size() - cut), "byte " + std::to_string(whole.size() - cut));
  expect_refused(whole + "x", "byte " + std::to_string(whole.size()) + ": 1 byte too many");
  TemporaryFolder folder;
  write_file(folder / "a.ply", whole);
  EXPECT_TRUE(read(folder / "a.ply").shape.ok());
}

TEST(ScanFile, every_cut_header_is_refused) {
  const std::string whole = header(kLittle, "comment organized width 1 height 1\nelement vertex 1\n" + kFloatXyz);
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
    const auto layout = parse_ply_header(std::string_view(whole).substr(0, bytes), "cut.ply");
    EXPECT_FALSE(layout.ok()) << bytes;
  }
  EXPECT_TRUE(parse_ply_header(whole, "whole.ply").ok());
}

TEST(ScanFile, wrong_counts_are_refused_before_they_are_used) {
  for (const std::string count : {"4", "5000000", "1099511627776"})
    expect_refused(header(kLittle, "element vertex " + count + "\n" + kFloatXyz) + std::string(36, '\0'), "requires");
  for (const std::string count : {"-1", "1099511627777", "18446744073709551616", "3.0", "0x3", "", "3x"})
    expect_refused(header(kLittle, "element vertex " + count + "\n" + kFloatXyz) + std::string(36, '\0'),
                   "header line 3: element count");
  // Together beyond 64 bits, each alone below the limit.
  std::string many;
  for (int i = 0; i < 1500; ++i) many += "element e 1099511627776\nproperty double a\nproperty double b\n";
  EXPECT_FALSE(parse_ply_header(header(kLittle, many), "many.ply").ok());
}

TEST(ScanFile, more_points_than_fit_are_refused) {
  TemporaryFolder folder;
  const std::vector<float> xyz(3 * 65, 1.0F);
  ASSERT_TRUE(write_ply((folder / "a.ply").c_str(), xyz, 0, 0).ok());
  const Read r = read(folder / "a.ply");
  ASSERT_FALSE(r.shape.ok());
  EXPECT_NE(r.shape.error().text.view().find("65 points, allowed are at most 64"), std::string_view::npos);
  EXPECT_EQ(r.xyz[0], -1.0F);
}

TEST(ScanFile, no_points_at_all_is_too_few) {
  expect_refused(header(kLittle, "element vertex 0\n" + kFloatXyz), "no points", Code::too_few_points);
}

TEST(ScanFile, unsupported_features_are_named) {
  const std::string body(12, '\0');
  const std::string vertex = "element vertex 1\n";
  expect_refused(header("binary_middle_endian", vertex + kFloatXyz) + body, "unknown format");
  expect_refused("ply\nformat binary_little_endian 2.0\n", "line 2: unknown PLY version \"2.0\"");
  expect_refused("plx\n", "byte 0: not a PLY file");
  expect_refused("", "0 bytes, the file is empty");
  expect_refused(header(kLittle, vertex + "property list float int n\n" + kFloatXyz) + body,
                 "line 4: list counted by type \"float\"");
  expect_refused(header(kLittle, vertex + "property list uchar float x\n") + body, "line 4: a list as coordinate");
  expect_refused(header(kLittle, vertex + "property half x\n") + body, "line 4: unknown property type \"half\"");
  expect_refused(header(kLittle, vertex + "property int x\nproperty float y\nproperty float z\n") + body,
                 "line 4: coordinate of type \"int\"");
  expect_refused(header(kLittle, vertex + "property float x\nproperty float y\n") + body, "lacks property x, y or z");
  expect_refused(header(kLittle, vertex + kFloatXyz + "property float x\n") + body + body, "second property \"x\"");
  expect_refused(header(kLittle, vertex + kFloatXyz + vertex + kFloatXyz) + body + body, "second element \"vertex\"");
  expect_refused(header(kLittle, "property float x\n") + body, "property before any element");
  expect_refused(header(kLittle, "") + body, "no element vertex");
  expect_refused("ply\nelement vertex 1\n" + kFloatXyz + "end_header\n" + body, "no format line");
  expect_refused(header(kLittle, "elephant\n"), "line 3: unknown statement \"elephant\"");
  expect_refused("solid", "format \"stl\" is not supported (supported: .ply, .pcd, .xyz, .asc, .txt, .csv)",
                 Code::frame_incomplete, "scan.stl");
  expect_refused("1 2 3", "format \"\" is not supported", Code::frame_incomplete, "scan");
}

TEST(ScanFile, organised_comment_must_fit_the_vertices) {
  const std::string body(24, '\0');
  const auto with = [&](const std::string& comment) {
    return header(kLittle, "comment organized" + comment + "\nelement vertex 2\n" + kFloatXyz) + body;
  };
  expect_refused(with(" width 2 height 2"), "width 2 height 2 is not the vertex count 2");
  expect_refused(with(" width 0 height 2"), "line 3: malformed comment organized");
  expect_refused(with(" width 2"), "malformed comment organized");
  expect_refused(with(" 2 1"), "malformed comment organized");
  expect_refused(with(" height 1 width 2"), "malformed comment organized");
  expect_refused(with(" width 2 height 1 depth 1"), "malformed comment organized");
  expect_refused(with(" width 4294967296 height 4294967296"), "malformed comment organized");
  expect_refused(with(" width 2 height 1\ncomment organized width 1 height 2"), "second comment organized");
}

TEST(ScanFile, links_folders_and_missing_files_are_refused) {
  TemporaryFolder folder;
  const std::vector<float> xyz = {1, 2, 3};
  ASSERT_TRUE(write_ply((folder / "real.ply").c_str(), xyz, 0, 0).ok());
  std::filesystem::create_symlink(folder / "real.ply", folder / "link.ply");
  std::filesystem::create_directory(folder / "folder.ply");
  ASSERT_EQ(mkfifo((folder / "pipe.ply").c_str(), 0600), 0);
  const std::vector<std::pair<std::string, std::string>> cases = {{"link.ply", "links are not followed"},
                                                                  {"folder.ply", "not a regular file"},
                                                                  {"pipe.ply", "not a regular file"},
                                                                  {"none.ply", "No such file"}};
  for (const auto& [name, why] : cases) {
    const Read r = read(folder / name);
    ASSERT_FALSE(r.shape.ok()) << name;
    EXPECT_EQ(r.shape.error().code, Code::frame_incomplete);
    EXPECT_NE(r.shape.error().text.view().find(why), std::string_view::npos) << r.shape.error().text.c_str();
  }
}

TEST(ScanFile, random_headers_are_read_or_refused_without_reading_past_the_file) {
  // Lines inserted into, and removed from, a good header. An accepted file must meet all guarantees.
  const std::vector<std::string> lines = {"format binary_big_endian 1.0\n",
                                          "element vertex 3\n",
                                          "element face 2\n",
                                          "property float x\n",
                                          "property double y\n",
                                          "property float z\n",
                                          "property list uchar int i\n",
                                          "comment organized width 3 height 1\n",
                                          "property uchar red\n",
                                          "comment hello\n",
                                          "obj_info \n",
                                          "\n",
                                          "element vertex 0\n",
                                          "element pose 7\n"};
  Prng prng(20240611);
  int accepted = 0;
  for (int round = 0; round < 20'000; ++round) {
    std::vector<std::string> good = {"element vertex 3\n", "property float x\n", "property double y\n",
                                     "property float z\n"};
    for (std::size_t changes = prng.below(4); changes > 0; --changes) {
      const auto at = good.begin() + static_cast<std::ptrdiff_t>(prng.below(good.size()));
      if (good.size() > 1 && prng.below(4) == 0) {
        good.erase(at);
      } else {
        good.insert(at, lines[prng.below(lines.size())]);
      }
    }
    std::string text = "ply\nformat binary_little_endian 1.0\n";
    for (const std::string& line : good) text += line;
    text += "end_header\n";
    if (prng.below(4) == 0) text[prng.below(text.size())] = static_cast<char>(prng.below(256));
    const auto layout = parse_ply_header(text, "random.ply");
    if (!layout.ok()) continue;
    ++accepted;
    const PlyLayout& l = layout.value();
    EXPECT_GT(l.vertices, 0U);
    std::uint64_t bytes = l.header_bytes;
    for (const PlyElement& element : l.elements) {
      bytes += element.count * element.bytes;
      ASSERT_LE(element.first_property + element.properties, l.properties.size()) << text;
    }
    EXPECT_EQ(bytes, l.bytes_min) << text;
  }
  EXPECT_GT(accepted, 1000) << "the generator never reaches the end of the parser";
}

}  // namespace
}  // namespace slabd::hal
