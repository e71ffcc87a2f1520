// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "base/fixed.h"
#include "base/items.h"
#include "base/pose.h"
#include "base/units.h"

/// Size and place of a scan, and the doubts that follow from them: another unit, another frame, an axis that points the
/// other way. Shared by everything that looks for something in a scan and does not find it. Pure; no heap.
namespace slabd {

/// Where the points of a scan are, in the scan's own unit taken as mm. From at most kScanPlaceSample points.
struct ScanPlace {
  std::size_t points = 0;                  ///< finite ones of the sample; 0: nothing below is set
  Vec3 low = Vec3::Constant(kNoValue);     ///< 2 % of the points are lower, axis by axis
  Vec3 high = Vec3::Constant(kNoValue);    ///< ... higher
  Vec3 median = Vec3::Constant(kNoValue);  ///< axis by axis

  [[nodiscard]] Vec3 extent() const { return high - low; }
};
inline constexpr std::size_t kScanPlaceSample = 2048;

/// Of x y z, x y z, ...; points that are not finite are left out. O(points) at most, a few microseconds.
[[nodiscard]] ScanPlace scan_place(std::span<const float> xyz);

/// A unit by which a scan could have been written instead of mm.
struct LikelyUnit {
  std::string_view name;  ///< "metres"; empty: mm, or none of the known ones
  double mm = 1.0;        ///< length of one
};
/// The unit in which a length that reads `found` is nearest to `expected_mm`: m, cm, in, um; empty while mm is right
/// within a factor of two, or no unit brings it within 1.6. cm and inches are told apart only by that.
[[nodiscard]] LikelyUnit likely_unit(double found, double expected_mm);

/// Axis along which the scanner looks at the points: "+Z", "-Z", "+X", ...; empty without points.
[[nodiscard]] std::string_view looking_along(const Vec3& median);

/// Where what was scanned should be.
struct ExpectedPlace {
  Vec3 scanner_mm = Vec3::Constant(kNoValue);  ///< scanner frame, +Z towards the part
  Vec3 base_mm = Vec3::Constant(kNoValue);     ///< the same place in another frame; NaN: not known
  std::string_view base_name = "base";         ///< of that frame
};

using ScanDoubt = FixedString<240>;
/// One sentence with extent, distance, probable unit or axes when the scan cannot be what was expected; empty when its
/// distance is right within a factor of two and it lies on the expected side of the scanner.
[[nodiscard]] ScanDoubt doubt_scan(const ScanPlace& found, const ExpectedPlace& expected);

}  // namespace slabd
