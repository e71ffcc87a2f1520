// SPDX-License-Identifier: Apache-2.0
//
// Packed scans: any file comes back byte for byte, and a damaged archive is named by its byte.
#include "hal/scan/packed.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "base/prng.h"
#include "hal/hal.h"
#include "hal/scan/packed_points.h"
#include "tests/hal/scan/packed_repair.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

namespace fs = std::filesystem;
using test::kBlockHead;
using test::packed_head_bytes;
using test::put_at;
using test::read_file;
using test::TemporaryFolder;
using test::with_checksums;
using test::write_file;

constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();

ByteSink into(std::string& bytes) {
  return [&bytes](std::span<const std::byte> piece) {
    bytes.append(static_cast<const char*>(static_cast<const void*>(piece.data())), piece.size());
    return success();
  };
}

struct Packed : ::testing::Test {
  TemporaryFolder folder;

  [[nodiscard]] std::string pack(const std::string& name, const std::string& content) const {
    write_file(folder / name, content);
    return pack_file(folder / name);
  }
  [[nodiscard]] static std::string pack_file(const std::string& path) {
    std::string archive;
    const Result<PackedScan> packed = pack_scan(path.c_str(), into(archive));
    EXPECT_TRUE(packed.ok()) << packed.error().text.c_str();
    EXPECT_TRUE(!packed.ok() || packed.value().packed_bytes == archive.size());
    return archive;
  }
  /// The error of an archive; empty if there is none. `restored` receives the bytes before it.
  [[nodiscard]] std::string why_not(const std::string& archive, std::string* restored = nullptr) const {
    write_file(folder / "a.slabz", archive);
    std::string bytes;
    const Result<PackedScan> unpacked = unpack_scan((folder / "a.slabz").c_str(), into(bytes));
    if (restored != nullptr) *restored = bytes;
    return unpacked.ok() ? "" : unpacked.error().text.c_str();
  }
  void expect_round_trip(const std::string& name, const std::string& content, bool is_predicted) const {
    const std::string archive = pack(name, content);
    std::string restored;
    EXPECT_EQ(why_not(archive, &restored), "") << name;
    EXPECT_TRUE(restored == content) << name;
    const Result<PackedScan> packed = packed_scan_at((folder / "a.slabz").c_str());
    ASSERT_TRUE(packed.ok()) << packed.error().text.c_str();
    EXPECT_EQ(packed.value().name, name);
    EXPECT_EQ(packed.value().bytes, content.size());
    EXPECT_EQ(packed.value().is_predicted, is_predicted) << name;
  }
};

/// A tilted plane seen along rays, with noise and missing points: organised, `width` columns.
std::vector<float> surface(std::size_t points, std::size_t width, std::uint64_t seed = 5) {
  Prng prng(seed);
  std::vector<float> xyz;
  for (std::size_t i = 0; i < points; ++i) {
    const double u = 0.0002 * static_cast<double>(i % width) - 0.2;
    const double v = 0.0002 * static_cast<double>(i / width) - 0.2;
    const double z = 800.0 / (1.0 - 0.1 * u) + 0.03 * prng.normal();
    const bool missing = prng.below(20) == 0;
    for (const double value : {u * z, v * z, z}) xyz.push_back(missing ? kMissing : static_cast<float>(value));
  }
  return xyz;
}

std::string ply_of(const std::vector<float>& xyz, const std::string& columns = "", std::size_t words = 3) {
  const std::size_t points = xyz.size() / words;
  std::string text = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(points) +
                     "\nproperty float x\nproperty float y\nproperty float z\n" + columns + "end_header\n";
  text.append(static_cast<const char*>(static_cast<const void*>(xyz.data())), xyz.size() * sizeof(float));
  return text;
}

std::string random_bytes(std::size_t count, std::uint64_t seed) {
  Prng prng(seed);
  std::string bytes;
  while (bytes.size() < count) bytes += static_cast<char>(prng.below(256));
  return bytes;
}

TEST_F(Packed, every_format_comes_back_byte_for_byte) {
  const std::vector<float> xyz = surface(30'000, 200);
  for (const ScanFormat format : kScanFormats) {
    const std::string name = std::string("scan.") + std::string(extension(format));
    ASSERT_TRUE(write_scan((folder / name).c_str(), format, xyz, 200, 150).ok());
    const bool is_predicted = format == ScanFormat::ply || format == ScanFormat::pcd;
    expect_round_trip(name, read_file(folder / name), is_predicted);
  }
}

TEST_F(Packed, a_scan_along_rays_is_packed_to_less_than_a_third) {
  const std::string path = folder / "scan.ply";
  ASSERT_TRUE(write_scan(path.c_str(), ScanFormat::ply, surface(200'000, 1'000), 1'000, 200).ok());
  EXPECT_LT(pack_file(path).size() * 3, fs::file_size(path));
}

TEST_F(Packed, blocks_of_every_size_come_back) {
  for (const std::size_t points : {1U, 2U, 65'535U, 65'536U, 65'537U, 140'000U})
    for (const std::size_t width : {1U, 7U, 70'000U}) {
      const std::size_t whole = (points + width - 1) / width * width;
      if (whole > 200'000) continue;
      ASSERT_TRUE(
          write_scan((folder / "n.ply").c_str(), ScanFormat::ply, surface(whole, width), width, whole / width).ok());
      expect_round_trip("n.ply", read_file(folder / "n.ply"), true);
    }
}

TEST_F(Packed, any_bits_of_a_number_come_back) {
  const float inf = std::numeric_limits<float>::infinity();
  std::vector<float> values = {0.0F,
                               -0.0F,
                               inf,
                               -inf,
                               kMissing,
                               -kMissing,
                               std::bit_cast<float>(0x7FA0'1234U),
                               std::bit_cast<float>(0xFFFF'FFFFU),
                               std::numeric_limits<float>::denorm_min(),
                               -std::numeric_limits<float>::denorm_min(),
                               std::numeric_limits<float>::max(),
                               std::numeric_limits<float>::lowest(),
                               1.0F,
                               -800.5F};
  std::vector<float> xyz;
  Prng prng(3);
  for (int i = 0; i < 3 * 5'000; ++i) xyz.push_back(values[prng.below(static_cast<std::uint32_t>(values.size()))]);
  // Runs of each way to write a missing point.
  for (const std::uint32_t bits : kMissingWords) xyz.insert(xyz.end(), 3 * 1'000, std::bit_cast<float>(bits));
  expect_round_trip("odd.ply", ply_of(xyz), true);
  expect_round_trip("zeros.ply", ply_of(std::vector<float>(3 * 70'000)), true);
  expect_round_trip("missing.ply", ply_of(std::vector<float>(3 * 70'000, kMissing)), true);
  std::string noise = ply_of(std::vector<float>(3 * 20'000));
  noise.replace(noise.size() - 240'000, 240'000, random_bytes(240'000, 9));
  expect_round_trip("noise.ply", noise, true);
}

TEST_F(Packed, further_columns_and_another_order_come_back) {
  const std::vector<float> xyz = surface(70'000, 300);
  std::vector<float> wide;
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3)
    wide.insert(wide.end(), {xyz[i], xyz[i + 1], xyz[i + 2], static_cast<float>(i), 0.5F});
  expect_round_trip("wide.ply", ply_of(wide, "property float nx\nproperty int id\n", 5), true);
  // z first, then a column, then y and x.
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement other 2\nproperty uchar a\nelement vertex 2\nproperty float z\n"
      "property uint c\nproperty float y\nproperty float x\nelement tail 1\nproperty short b\nend_header\n";
  text += random_bytes(2 + 2 * 16 + 2, 4);
  expect_round_trip("order.ply", text, true);
  // Columns that are not four bytes wide, and double: by zstd alone.
  std::string odd = ply_of(surface(10, 10), "property uchar c\n");
  expect_round_trip("odd.ply", odd + std::string(10, 'c'), false);
}

TEST_F(Packed, files_that_are_not_scans_come_back) {
  for (const char* name : {"a.ply", "a.pcd", "a.xyz", "a.bin", "noextension"}) {
    expect_round_trip(name, "", false);
    expect_round_trip(name, "x", false);
    expect_round_trip(name, random_bytes(3'000'000, 7), false);
    expect_round_trip(name, std::string(2'500'000, ' '), false);
  }
  // A scan that was cut, and one with a tail of zeros.
  const std::string scan = ply_of(surface(1'000, 10));
  expect_round_trip("cut.ply", scan.substr(0, scan.size() - 1), false);
  expect_round_trip("tail.ply", scan + std::string(4'096, '\0'), true);
  expect_round_trip("unit.ply", "ply\ncomment unit m\n" + scan.substr(4), true);
}

TEST_F(Packed, a_packed_scan_is_read_as_its_original) {
  const std::vector<float> points = surface(30'000, 200);
  for (const ScanFormat format : {ScanFormat::ply, ScanFormat::pcd, ScanFormat::xyz}) {
    const std::string path = folder / (std::string("03-1.") + std::string(extension(format)));
    ASSERT_TRUE(write_scan(path.c_str(), format, points, 200, 150).ok());
    const std::string packed = path + ".slabz";
    write_file(packed, pack_file(path));
    std::vector<float> a(points.size());
    std::vector<float> b(points.size());
    const auto original = read_scan(path.c_str(), LengthUnit::mm, a);
    const auto again = read_scan(packed.c_str(), LengthUnit::mm, b);
    ASSERT_TRUE(original.ok() && again.ok()) << again.error().text.c_str();
    EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0);
    EXPECT_EQ(again.value().width, original.value().width);
    EXPECT_EQ(again.value().finite, original.value().finite);
    const auto sum = read_scan_checksum(packed.c_str(), LengthUnit::mm);
    const auto checked = check_packed_scan(packed.c_str(), LengthUnit::mm);
    ASSERT_TRUE(checked.ok()) << checked.error().text.c_str();
    EXPECT_EQ(sum.ok(), format != ScanFormat::xyz);
    EXPECT_EQ(checked.value().points_crc32c.has_value(), sum.ok());
    if (sum.ok()) {
      EXPECT_EQ(sum.value().crc32c, points_crc32c(a));
      EXPECT_EQ(checked.value().points_crc32c, sum.value().crc32c);
    }
  }
}

TEST_F(Packed, an_error_in_the_original_is_reported_as_of_the_original) {
  const std::string path = folder / "torn.ply";
  write_file(path, "ply\nformat binary_little_endian 1.0\n");
  write_file(path + ".slabz", pack_file(path));
  std::vector<float> xyz(30);
  const auto read = read_scan((path + ".slabz").c_str(), LengthUnit::mm, xyz);
  ASSERT_FALSE(read.ok());
  EXPECT_NE(read.error().text.view().find("torn.ply.slabz: torn.ply: no end_header"), std::string_view::npos)
      << read.error().text.c_str();
}

/// Byte number in an error text; npos if there is none.
std::size_t byte_named(const std::string& why) {
  const std::size_t at = why.find(": byte ");
  return at == std::string::npos ? at : std::stoul(why.substr(at + 7));
}

TEST_F(Packed, every_damaged_byte_is_refused_with_a_byte_at_or_before_it) {
  const std::string whole = pack("small.ply", ply_of(surface(60, 10)));
  for (std::size_t i = 0; i < whole.size(); ++i)
    for (const unsigned change : {0x01U, 0x80U, 0xFFU}) {
      std::string archive = whole;
      archive[i] = static_cast<char>(static_cast<unsigned char>(archive[i]) ^ change);
      const std::string why = why_not(archive);
      ASSERT_NE(why, "") << i;
      EXPECT_LE(byte_named(why), i) << why;
    }
}

TEST_F(Packed, every_damaged_byte_with_correct_checksums_is_refused_or_harmless) {
  const std::string content = ply_of(surface(60, 10));
  const std::string whole = pack("small.ply", content);
  for (std::size_t i = 0; i < whole.size(); ++i)
    for (const unsigned change : {0x01U, 0x80U, 0xFFU}) {
      std::string archive = whole;
      archive[i] = static_cast<char>(static_cast<unsigned char>(archive[i]) ^ change);
      std::string restored;
      const std::string why = why_not(with_checksums(archive), &restored);
      EXPECT_LE(restored.size(), content.size() + 1'000'000) << i;
      EXPECT_TRUE(why.empty() ? restored == content : byte_named(why) != std::string::npos) << i << " " << why;
    }
}

TEST_F(Packed, every_cut_and_every_addition_is_refused) {
  const std::string whole = pack("small.ply", ply_of(surface(60, 10)));
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string why = why_not(whole.substr(0, size));
    ASSERT_NE(why, "") << size;
    EXPECT_LE(byte_named(why), size) << why;
  }
  EXPECT_EQ(byte_named(why_not(whole + "x")), whole.size());
}

TEST_F(Packed, blocks_that_are_swapped_left_out_or_repeated_are_refused) {
  const std::string whole = pack("text.xyz", random_bytes(3U << 20U, 2));
  const std::size_t first = packed_head_bytes(whole);
  const std::size_t size = kBlockHead + test::number_at(whole, first + 8, 4);
  const std::string a = whole.substr(first, size);
  const std::string b = whole.substr(first + size, size);
  const std::string rest = whole.substr(first + 2 * size);
  const std::string head = whole.substr(0, first);
  for (const std::string& archive : {head + b + a + rest, head + b + rest, head + a + a + rest, head + a + rest}) {
    EXPECT_NE(why_not(archive).find("the checksum is wrong"), std::string::npos);
    EXPECT_NE(why_not(with_checksums(archive)), "");
  }
}

TEST_F(Packed, sizes_are_compared_with_their_limits_before_memory_is_taken) {
  const std::string whole = pack("small.ply", ply_of(surface(60, 10)));
  const std::size_t block = packed_head_bytes(whole);
  struct Change {
    std::size_t at;
    std::uint32_t number;
    const char* expected;
  };
  for (const Change& change :
       std::vector<Change>{{16, 0xFFFF'FFFFU, "byte 16: the original is larger than allowed"},
                           {20, 1, "byte 16: the original is larger than allowed"},
                           {16, 100, "damaged: more data than the head states"},
                           {16, 10'000, "the data end after"},
                           {8, 0x0303'0002U, "byte 8: version 2 of the format, this slabd reads version 1"},
                           {10, 0x0101'0003U, "byte 10: a layout of points"},
                           {10, 0x0201'00FFU, "byte 10: a layout of points"},
                           {block + 4, 0xFFFF'FFFFU, "a block of impossible size"},
                           {block + 4, 0, "a block of impossible size"},
                           {block + 8, 0xFFFF'FFFFU, "a block of impossible packed size"},
                           {block + 8, 0, "a block of impossible packed size"},
                           {block + 8, 1'000'000, "the archive ends within this block"}}) {
    std::string archive = whole;
    put_at(archive, change.at, change.number);
    const std::string why = why_not(with_checksums(archive));
    EXPECT_NE(why.find(change.expected), std::string::npos) << change.at << " " << change.number << ": " << why;
  }
}

TEST_F(Packed, a_name_that_leads_elsewhere_is_refused) {
  const std::string whole = pack("abcd.ply", "x");
  for (const std::string& name :
       {std::string("../d.ply"), std::string("/bcd.ply"), std::string("a\ncd.ply"), std::string("a\0cd.ply", 8)}) {
    std::string archive = whole;
    archive.replace(32, 8, name);
    EXPECT_NE(why_not(with_checksums(archive)).find("is not a file name"), std::string::npos);
  }
}

TEST_F(Packed, an_archive_is_not_packed_again_and_a_folder_is_not_a_scan) {
  write_file(folder / "a.ply.slabz", pack("a.ply", "x"));
  std::string bytes;
  const auto again = pack_scan((folder / "a.ply.slabz").c_str(), into(bytes));
  ASSERT_FALSE(again.ok());
  EXPECT_NE(again.error().text.view().find("it is packed already"), std::string_view::npos);
  EXPECT_FALSE(pack_scan(folder.string().c_str(), into(bytes)).ok());
  EXPECT_FALSE(pack_scan((folder / "missing.ply").c_str(), into(bytes)).ok());
  EXPECT_FALSE(unpack_scan((folder / "a.ply").c_str(), into(bytes)).ok());
}

TEST_F(Packed, the_error_of_the_receiver_ends_the_work) {
  const std::string path = folder / "a.ply";
  write_file(path, ply_of(surface(200'000, 100)));
  write_file(path + ".slabz", pack_file(path));
  int calls = 0;
  const ByteSink full = [&calls](std::span<const std::byte>) -> Status {
    return ++calls < 3 ? success() : Status(error(Code::store_full, "full"));
  };
  const auto packed = pack_scan(path.c_str(), full);
  ASSERT_FALSE(packed.ok());
  EXPECT_EQ(packed.error().code, Code::store_full);
  EXPECT_EQ(calls, 3);
  calls = 0;
  const auto unpacked = unpack_scan((path + ".slabz").c_str(), full);
  ASSERT_FALSE(unpacked.ok());
  EXPECT_EQ(unpacked.error().code, Code::store_full);
  EXPECT_EQ(calls, 3);
}

}  // namespace
}  // namespace slabd::hal
