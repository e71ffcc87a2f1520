// SPDX-License-Identifier: Apache-2.0
#include "gateway/genicam/points.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

namespace slabd::gateway::genicam {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

template <typename Number>
std::vector<std::byte> bytes_of(const std::vector<Number>& numbers) {
  std::vector<std::byte> bytes(numbers.size() * sizeof(Number));
  std::memcpy(bytes.data(), numbers.data(), bytes.size());
  return bytes;
}

template <typename Number>
std::vector<float> converted(PointLayout layout, const std::vector<Number>& raw) {
  layout.width = static_cast<std::uint32_t>(raw.size() / 3);
  layout.height = 1;
  std::vector<float> xyz(raw.size());
  (void)convert(layout, bytes_of(raw), xyz);
  return xyz;
}

std::string text(const Status& status) {
  return status ? "" : std::string(status.error().text.view());
}

TEST(GenicamPoints, float_points_keep_their_bits) {
  const std::vector<float> raw = {0.1F, -0.0F, 600.123F, 1e-40F, 3.0F, 4.0F};
  const std::vector<float> xyz = converted(PointLayout{}, raw);
  EXPECT_EQ(std::memcmp(raw.data(), xyz.data(), raw.size() * sizeof(float)), 0);
}

TEST(GenicamPoints, a_coordinate_that_is_not_finite_makes_the_point_missing) {
  const std::vector<float> xyz =
      converted(PointLayout{}, std::vector<float>{1, 2, 3, kNaN, 2, 3, 1, INFINITY, 3, 1, 2, kNaN});
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(std::isfinite(xyz[static_cast<std::size_t>(i)]));
  for (int i = 3; i < 12; ++i) EXPECT_TRUE(std::isnan(xyz[static_cast<std::size_t>(i)])) << i;
}

TEST(GenicamPoints, the_invalid_value_of_any_coordinate_makes_the_point_missing) {
  PointLayout layout;
  layout.axes[2].has_invalid = true;
  layout.axes[2].invalid = -1.0;
  const std::vector<float> xyz = converted(layout, std::vector<float>{1, 2, -1, -1, 2, 3});
  EXPECT_TRUE(std::isnan(xyz[0]) && std::isnan(xyz[1]) && std::isnan(xyz[2]));
  EXPECT_EQ(xyz[3], -1.0F) << "a value of another coordinate";
}

TEST(GenicamPoints, sixteen_bit_points_are_scale_times_count_plus_offset) {
  PointLayout layout;
  layout.format = PointFormat::abc16;
  layout.axes = {Axis{0.01, -300.0, true, 0.0}, Axis{0.02, -300.0, true, 0.0}, Axis{0.005, 400.0, true, 0.0}};
  const std::vector<float> xyz = converted(layout, std::vector<std::uint16_t>{30'000, 1, 65'535, 5, 5, 0});
  EXPECT_EQ(xyz[0], 0.0F);
  EXPECT_EQ(xyz[1], static_cast<float>(0.02 * 1.0 - 300.0));
  EXPECT_EQ(xyz[2], static_cast<float>(0.005 * 65'535.0 + 400.0));
  EXPECT_TRUE(std::isnan(xyz[3]) && std::isnan(xyz[4]) && std::isnan(xyz[5]));
}

TEST(GenicamPoints, planar_formats_hold_one_coordinate_after_the_other) {
  PointLayout layout;
  layout.format = PointFormat::abc32f_planar;
  const std::vector<float> xyz = converted(layout, std::vector<float>{1, 2, 10, 20, 100, 200});
  EXPECT_EQ(xyz, (std::vector<float>{1, 10, 100, 2, 20, 200}));
}

TEST(GenicamPoints, bytes_that_never_arrived_are_missing_points_and_a_gap) {
  PointLayout layout;
  layout.width = 100;
  layout.height = 10;
  std::vector<float> points(3'000);
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = static_cast<float>(i);
  const std::vector<std::byte> whole = bytes_of(points);
  EXPECT_EQ(first_gap(layout, whole), whole.size());
  std::vector<float> xyz(points.size());
  for (std::size_t begin = 0; begin + 48 <= whole.size(); begin += 13) {
    std::vector<std::byte> torn = whole;
    std::fill_n(torn.begin() + static_cast<std::ptrdiff_t>(begin), 48, kUnwritten);
    ASSERT_LE(first_gap(layout, torn), begin);
    ASSERT_LT(convert(layout, torn, xyz), layout.points());
  }
  std::vector<std::byte> one = whole;
  std::fill_n(one.begin() + 24, 12, kUnwritten);
  EXPECT_EQ(first_gap(layout, one), one.size()) << "one point may look like that";
  EXPECT_EQ(convert(layout, one, xyz), layout.points() - 1);
}

TEST(GenicamPoints, a_layout_that_is_not_allowed_is_refused_with_its_feature) {
  PointLayout layout;
  layout.width = 2'448;
  layout.height = 2'048;
  EXPECT_TRUE(check(layout));
  PointLayout other = layout;
  other.width = 0;
  EXPECT_NE(text(check(other)).find("Width and Height: found 0"), std::string::npos);
  other.width = 0xFFFFFFFF, other.height = 0xFFFFFFFF;
  EXPECT_NE(text(check(other)).find("allowed are 6000000"), std::string::npos);
  for (const double scale : {0.0, 1e6, static_cast<double>(kNaN)}) {
    other = layout;
    other.axes[1].scale = scale;
    EXPECT_NE(text(check(other)).find("Scan3dCoordinateScale of CoordinateB"), std::string::npos) << scale;
  }
  other = layout;
  other.axes[2].offset_mm = 1e9;
  EXPECT_NE(text(check(other)).find("Scan3dCoordinateOffset of CoordinateC"), std::string::npos);
  other = layout;
  other.axes[2].scale = -1.0;
  EXPECT_NE(text(check(other)).find("mirrors the scan"), std::string::npos);
  other.axes[1].scale = -1.0;
  EXPECT_TRUE(check(other)) << "two negative scales turn the points";
}

TEST(GenicamPoints, formats_are_found_by_code_and_by_name) {
  for (const FormatInfo& known : kPointFormats) {
    EXPECT_EQ(point_format_of(known.code).value(), known.format);
    EXPECT_EQ(point_format_named(known.name).value(), known.format);
    EXPECT_EQ(info(known.format).code, known.code);
  }
  EXPECT_NE(text(point_format_of(0x01080001).ok() ? success() : Status(point_format_of(0x01080001).error()))
                .find("0x01080001, allowed are Coord3D_ABC32f"),
            std::string::npos);
  EXPECT_FALSE(point_format_named("Coord3D_C16"));
}

}  // namespace
}  // namespace slabd::gateway::genicam
