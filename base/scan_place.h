// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "base/fixed.h"
#include "base/items.h"
#include "base/pose.h"
#include "base/units.h"

/// Size and place of a scan, and the likely errors: another unit, another frame, a reversed axis. Used by every search
/// that does not find its object in a scan. Pure; no heap.
namespace slabd {

/// Extent of a scan's points, in the scan's own unit interpreted as mm. Computed from at most kScanPlaceSample points.
struct ScanPlace {
  std::size_t points = 0;                  ///< number of finite points in the sample; if 0, nothing below is set
  Vec3 low = Vec3::Constant(kNoValue);     ///< 2 % quantile, axis by axis
  Vec3 high = Vec3::Constant(kNoValue);    ///< 98 % quantile, axis by axis
  Vec3 median = Vec3::Constant(kNoValue);  ///< axis by axis

  [[nodiscard]] Vec3 extent() const { return high - low; }
};
inline constexpr std::size_t kScanPlaceSample = 2048;

/// Computes the place of x y z, x y z, ...; points that are not finite are skipped. At most O(points), a few
/// microseconds.
[[nodiscard]] ScanPlace scan_place(std::span<const float> xyz);

/// A unit that a scan may have been written in instead of mm.
struct LikelyUnit {
  std::string_view name;  ///< "metres"; empty if mm, or not a known unit
  double mm = 1.0;        ///< length of one unit in mm
};
/// Unit in which the length `found` is closest to `expected_mm`: m, cm, in, um. Empty if mm is right within a factor of
/// two, or if no unit is within a factor of 1.6. cm and inches differ only in this comparison.
[[nodiscard]] LikelyUnit likely_unit(double found, double expected_mm);

/// Axis along which the scanner looks at the points: "+Z", "-Z", "+X", ...; empty without points.
[[nodiscard]] std::string_view looking_along(const Vec3& median);

/// Expected place of the scanned object.
struct ExpectedPlace {
  Vec3 scanner_mm = Vec3::Constant(kNoValue);  ///< scanner frame, +Z towards the part
  Vec3 base_mm = Vec3::Constant(kNoValue);     ///< the same place in another frame; NaN if unknown
  std::string_view base_name = "base";         ///< name of that frame
};

using ScanDoubt = FixedString<240>;
/// One sentence with extent, distance, and probable unit or axes if the scan does not match the expected place. Empty
/// if its distance is right within a factor of two and it is on the expected side of the scanner.
[[nodiscard]] ScanDoubt doubt_scan(const ScanPlace& found, const ExpectedPlace& expected);

}  // namespace slabd
