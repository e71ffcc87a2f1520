// SPDX-License-Identifier: Apache-2.0
//
// The checksum that proves years later that a scan's points are the measured ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <limits>

#include "base/prng.h"
#include "hal/hal.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

using test::TemporaryFolder;

constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();

/// More than one piece of the reader, and not a multiple of it.
std::vector<float> cloud(std::size_t points = 10'007) {
  Prng prng(11);
  std::vector<float> xyz;
  for (std::size_t i = 0; i < points; ++i) {
    const bool missing = prng.below(5) == 0;
    for (int axis = 0; axis < 3; ++axis) xyz.push_back(missing ? kMissing : static_cast<float>(prng.normal()));
  }
  return xyz;
}

std::uint32_t of_file(const std::string& path) {
  const Result<ScanChecksum> sum = read_scan_checksum(path.c_str(), LengthUnit::mm);
  EXPECT_TRUE(sum.ok()) << sum.error().text.c_str();
  return sum.ok() ? sum.value().crc32c : 0;
}

TEST(ScanChecksum, is_what_ten_lines_of_python_give) {
  // docs/QUALITY.md
  EXPECT_EQ(points_crc32c(std::vector<float>{1, 2, 3, kMissing, kMissing, kMissing, -0.5F, 0, 600.25F}), 0x1119'580AU);
  EXPECT_EQ(points_crc32c({}), 0U);
}

TEST(ScanChecksum, pieces_one_behind_the_other_are_the_whole) {
  const std::vector<float> xyz = cloud();
  const std::span<const float> all(xyz);
  for (const std::size_t cut : {0U, 3U, 12'288U, 12'291U, 30'021U})
    EXPECT_EQ(points_crc32c(all.subspan(cut), points_crc32c(all.first(cut))), points_crc32c(all)) << cut;
}

TEST(ScanChecksum, any_bit_of_any_coordinate_counts_and_no_bit_of_a_missing_point) {
  const std::vector<float> xyz = cloud(300);
  const std::uint32_t whole = points_crc32c(xyz);
  for (std::size_t i = 0; i < xyz.size(); ++i)
    for (const std::uint32_t bit : {0U, 13U, 31U}) {
      std::vector<float> other = xyz;
      other[i] = std::bit_cast<float>(std::bit_cast<std::uint32_t>(xyz[i]) ^ 1U << bit);
      EXPECT_EQ(points_crc32c(other) == whole, std::isnan(xyz[i])) << i << " bit " << bit;
    }
}

TEST(ScanChecksum, an_order_counts) {
  std::vector<float> xyz = cloud(300);
  const std::uint32_t whole = points_crc32c(xyz);
  std::rotate(xyz.begin(), xyz.begin() + 3, xyz.end());
  EXPECT_NE(points_crc32c(xyz), whole);
}

TEST(ScanChecksum, read_from_a_file_equals_that_of_its_points) {
  TemporaryFolder folder;
  const std::vector<float> xyz = cloud();
  for (const ScanFormat format : {ScanFormat::ply, ScanFormat::ply_be, ScanFormat::pcd}) {
    const std::string path = folder / (std::string(name(format)) + "." + std::string(extension(format)));
    ASSERT_TRUE(write_scan(path.c_str(), format, xyz, 0, 0).ok());
    EXPECT_EQ(of_file(path), points_crc32c(xyz)) << name(format);
    // The measured points are those in the buffer after reading.
    std::vector<float> read(xyz.size());
    const Result<ScanShape> shape = read_scan(path.c_str(), LengthUnit::mm, read);
    ASSERT_TRUE(shape.ok());
    EXPECT_TRUE(shape.value().in_records);
    EXPECT_EQ(points_crc32c(read), points_crc32c(xyz)) << name(format);
  }
}

TEST(ScanChecksum, is_of_millimetres) {
  TemporaryFolder folder;
  const std::vector<float> metres = {0.25F, 0.5F, 0.125F};
  ASSERT_TRUE(write_ply((folder / "a.ply").c_str(), metres, 0, 0).ok());
  const Result<ScanChecksum> sum = read_scan_checksum((folder / "a.ply").c_str(), LengthUnit::m);
  ASSERT_TRUE(sum.ok());
  EXPECT_EQ(sum.value().crc32c, points_crc32c(std::vector<float>{250, 500, 125}));
}

TEST(ScanChecksum, files_that_are_not_records_are_refused_by_name) {
  TemporaryFolder folder;
  for (const ScanFormat format :
       {ScanFormat::ply_ascii, ScanFormat::pcd_ascii, ScanFormat::pcd_compressed, ScanFormat::xyz, ScanFormat::csv}) {
    const std::string path = folder / (std::string(name(format)) + "." + std::string(extension(format)));
    ASSERT_TRUE(write_scan(path.c_str(), format, cloud(), 0, 0).ok());
    const Result<ScanChecksum> sum = read_scan_checksum(path.c_str(), LengthUnit::mm);
    ASSERT_FALSE(sum.ok()) << name(format);
    EXPECT_NE(sum.error().text.view().find(path), std::string_view::npos) << sum.error().text.c_str();
    std::vector<float> read(cloud().size());
    EXPECT_FALSE(read_scan(path.c_str(), LengthUnit::mm, read).value().in_records) << name(format);
  }
}

TEST(ScanChecksum, a_torn_or_deleted_file_has_none) {
  TemporaryFolder folder;
  const std::string path = folder / "a.ply";
  ASSERT_TRUE(write_ply(path.c_str(), cloud(), 0, 0).ok());
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 1);
  EXPECT_FALSE(read_scan_checksum(path.c_str(), LengthUnit::mm).ok());
  std::filesystem::remove(path);
  EXPECT_FALSE(read_scan_checksum(path.c_str(), LengthUnit::mm).ok());
}

}  // namespace
}  // namespace slabd::hal
