// SPDX-License-Identifier: Apache-2.0
#include "base/scan_place.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

namespace slabd {
namespace {

/// Points over 350 x 500 mm, 600 mm in front of the scanner, each transformed by `change`.
template <typename Change>
ScanPlace place_of(const Change& change) {
  std::vector<float> xyz;
  for (int i = 0; i < 5'000; ++i) {
    const Vec3 p = change(Vec3(-175.0 + 3.5 * (i % 100), -250.0 + 10.0 * (i / 100), 600.0 + (i % 7)));
    for (int k = 0; k < 3; ++k) xyz.push_back(static_cast<float>(p[k]));
  }
  return scan_place(xyz);
}

ExpectedPlace expected() {
  ExpectedPlace place;
  place.scanner_mm = Vec3(0.0, 0.0, 600.0);
  place.base_mm = Vec3(1500.0, 200.0, 570.0);
  return place;
}

std::string doubt(const ScanPlace& place) {
  return std::string(doubt_scan(place, expected()).view());
}

bool says(const std::string& text, std::string_view words) {
  return text.find(words) != std::string::npos;
}

TEST(ScanPlace, extent_and_median_leave_out_strays_and_missing_points) {
  std::vector<float> xyz;
  for (int i = 0; i < 1'000; ++i) xyz.insert(xyz.end(), {static_cast<float>(i), 5.0F, 600.0F});
  for (int i = 0; i < 10; ++i) xyz.insert(xyz.end(), {1e6F, -1e6F, 1e6F});
  for (int i = 0; i < 100; ++i) xyz.insert(xyz.end(), 3, std::numeric_limits<float>::quiet_NaN());
  const ScanPlace place = scan_place(xyz);
  EXPECT_EQ(place.points, 1'010U);
  EXPECT_NEAR(place.extent().x(), 970.0, 20.0);
  EXPECT_EQ(place.extent().y(), 0.0);
  EXPECT_EQ(place.median.z(), 600.0);
  EXPECT_EQ(scan_place({}).points, 0U);
  // Almost two samples of points: the last points must be included.
  std::vector<float> line;
  for (std::size_t i = 0; i < 2 * kScanPlaceSample - 1; ++i)
    line.insert(line.end(), {static_cast<float>(i), 5.0F, 600.0F});
  EXPECT_NEAR(scan_place(line).high.x(), 0.98 * 2.0 * kScanPlaceSample, 4.0);
}

TEST(ScanPlace, a_scan_in_its_expected_place_raises_no_doubt) {
  EXPECT_EQ(doubt(place_of([](const Vec3& p) { return p; })), "");
  EXPECT_EQ(doubt(place_of([](const Vec3& p) { return Vec3(p + Vec3(60.0, -60.0, 80.0)); })), "");
  EXPECT_EQ(doubt(scan_place({})), "");
}

TEST(ScanPlace, another_unit_is_named_with_extent_and_distance) {
  const std::string metres = doubt(place_of([](const Vec3& p) { return Vec3(p / 1000.0); }));
  EXPECT_EQ(
      metres,
      "the scan is 0.336 x 0.48 x 0.006 large, 0.603 away along +Z; expected is a block 600 mm away along +Z: the "
      "unit is probably metres; state the unit of the scan");
  EXPECT_TRUE(says(doubt(place_of([](const Vec3& p) { return Vec3(p / 10.0); })), "probably centimetres"));
  EXPECT_TRUE(says(doubt(place_of([](const Vec3& p) { return Vec3(p / 25.4); })), "probably inches"));
  EXPECT_TRUE(says(doubt(place_of([](const Vec3& p) { return Vec3(p * 1000.0); })), "probably micrometres"));
}

TEST(ScanPlace, axes_that_point_the_other_way_are_named) {
  const std::string up = doubt(place_of([](const Vec3& p) { return Vec3(p.x(), -p.y(), -p.z()); }));
  EXPECT_TRUE(says(up, "away along -Z")) << up;
  EXPECT_TRUE(says(up, "+Z must point from the scanner to the part")) << up;
  const std::string along_y = doubt(place_of([](const Vec3& p) { return Vec3(p.x(), p.z(), -p.y()); }));
  EXPECT_TRUE(says(along_y, "away along +Y")) << along_y;
  const std::string both =
      doubt(place_of([](const Vec3& p) { return Vec3(p.x() / 1000.0, -p.y() / 1000.0, -p.z() / 1000.0); }));
  EXPECT_TRUE(says(both, "probably metres, and its axes are not the scanner's")) << both;
}

TEST(ScanPlace, a_scan_in_the_base_frame_is_named_in_mm_and_in_metres) {
  const auto in_base = [](double mm) {
    return [mm](const Vec3& p) { return Vec3((Vec3(p.x(), p.y(), 600.0 - p.z()) + Vec3(1500.0, 200.0, 570.0)) / mm); };
  };
  EXPECT_TRUE(says(doubt(place_of(in_base(1.0))), "where the block is in the base frame; give the points"));
  EXPECT_TRUE(says(doubt(place_of(in_base(1000.0))), "in metres it is where the block is in the base frame"));
  // Offline the base is the block's own frame. A scan in metres is near its origin too, but far too small.
  ExpectedPlace offline = expected();
  offline.base_mm = Vec3::Zero();
  offline.base_name = "block's";
  const ScanPlace metres = place_of([](const Vec3& p) { return Vec3(p / 1000.0); });
  EXPECT_TRUE(says(std::string(doubt_scan(metres, offline).view()), "probably metres; state"));
  const ScanPlace in_block = place_of([](const Vec3& p) { return Vec3(p.x(), p.y(), p.z() - 600.0); });
  EXPECT_TRUE(says(std::string(doubt_scan(in_block, offline).view()), "in the block's frame"));
}

TEST(ScanPlace, a_unit_is_named_only_if_it_fits) {
  EXPECT_TRUE(likely_unit(600.0, 600.0).name.empty());
  EXPECT_TRUE(likely_unit(350.0, 600.0).name.empty());
  EXPECT_EQ(likely_unit(0.6, 600.0).name, "metres");
  EXPECT_TRUE(likely_unit(6.0, 600.0).name.empty()) << "no known unit";
  EXPECT_TRUE(likely_unit(0.0, 600.0).name.empty());
}

}  // namespace
}  // namespace slabd
