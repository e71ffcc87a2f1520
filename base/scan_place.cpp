// SPDX-License-Identifier: Apache-2.0
//
// A scan in metres, in the robot's base frame or with Z towards the scanner contains the block, but a search in mm
// along +Z does not find it. Extent and distance reveal the cause: a block is never 0.6 mm away.
#include "base/scan_place.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace slabd {
namespace {

constexpr double kQuantile = 0.02;
constexpr double kRightFactor = 2.0;
constexpr double kUnitFactor = 1.6;
/// A scan is in the base frame if it is closer than this to the block's place there, and farther than this from its
/// place in the scanner frame.
constexpr double kNear_mm = 200.0;
/// Size range of a scan of a block.
constexpr double kSizeMin_mm = 100.0;
constexpr double kSizeMax_mm = 2'000.0;

constexpr std::array kUnits = {LikelyUnit{"metres", 1000.0}, LikelyUnit{"centimetres", 10.0},
                               LikelyUnit{"inches", 25.4}, LikelyUnit{"micrometres", 0.001}};

}  // namespace

ScanPlace scan_place(std::span<const float> xyz) {
  const std::size_t points = xyz.size() / 3;
  const std::size_t stride = std::max<std::size_t>(1, (points + kScanPlaceSample - 1) / kScanPlaceSample);
  std::array<std::array<float, kScanPlaceSample>, 3> sample;
  ScanPlace place;
  for (std::size_t i = 0; i < points && place.points < kScanPlaceSample; i += stride) {
    const float* p = xyz.data() + 3 * i;
    if (!std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2])) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) sample[axis][place.points] = p[axis];
    ++place.points;
  }
  if (place.points == 0) return place;
  const auto tail = static_cast<std::size_t>(kQuantile * static_cast<double>(place.points));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto begin = sample[axis].begin();
    std::sort(begin, begin + static_cast<std::ptrdiff_t>(place.points));
    const auto at = static_cast<int>(axis);
    place.low[at] = double{sample[axis][tail]};
    place.high[at] = double{sample[axis][place.points - 1 - tail]};
    place.median[at] = double{sample[axis][place.points / 2]};
  }
  return place;
}

LikelyUnit likely_unit(double found, double expected_mm) {
  const auto off = [&](double mm) { return std::abs(std::log(found * mm / expected_mm)); };
  if (!(found > 0.0) || !(expected_mm > 0.0) || off(1.0) <= std::log(kRightFactor)) return {};
  LikelyUnit best;
  double least = std::log(kUnitFactor);
  for (const LikelyUnit& unit : kUnits) {
    if (!(off(unit.mm) <= least)) continue;
    least = off(unit.mm);
    best = unit;
  }
  return best;
}

std::string_view looking_along(const Vec3& median) {
  constexpr std::array<std::string_view, 6> kNames = {"+X", "-X", "+Y", "-Y", "+Z", "-Z"};
  if (!median.allFinite()) return {};
  int axis = 0;
  for (int k = 1; k < 3; ++k)
    if (std::abs(median[k]) > std::abs(median[axis])) axis = k;
  return kNames[static_cast<std::size_t>(2 * axis + (median[axis] < 0.0 ? 1 : 0))];
}

ScanDoubt doubt_scan(const ScanPlace& found, const ExpectedPlace& expected) {
  ScanDoubt doubt;
  if (found.points == 0 || !expected.scanner_mm.allFinite()) return doubt;
  const Vec3 extent = found.extent();
  const double distance = found.median.norm();
  const double expected_mm = expected.scanner_mm.norm();
  doubt.printf("the scan is %.3g x %.3g x %.3g large, %.3g away along %s; expected is a block %.0f mm away along +Z: ",
               extent.x(), extent.y(), extent.z(), distance, looking_along(found.median).data(), expected_mm);
  // In the base frame the distance does not determine the unit.
  const bool known_base = expected.base_mm.allFinite();
  for (const double mm : {1.0, 1000.0}) {
    const Vec3 place = found.median * mm;
    const double size_mm = extent.maxCoeff() * mm;
    if (!known_base || !(size_mm >= kSizeMin_mm) || !(size_mm <= kSizeMax_mm)) continue;
    if (!((place - expected.base_mm).norm() < kNear_mm) || !((place - expected.scanner_mm).norm() > kNear_mm)) continue;
    doubt.append(mm == 1.0 ? "it is where the block is in the " : "in metres it is where the block is in the ");
    doubt.append(expected.base_name);
    doubt.append(mm == 1.0 ? " frame; give the points in the scanner's frame"
                           : " frame; give mm in the scanner's frame");
    return doubt;
  }
  const LikelyUnit unit = likely_unit(distance, expected_mm);
  const bool unit_right = std::abs(std::log(distance / expected_mm)) <= std::log(kRightFactor);
  const bool side_right = found.median.dot(expected.scanner_mm) > 0.5 * distance * expected_mm;
  if (unit_right && side_right) return {};
  if (!unit.name.empty()) {
    doubt.append("the unit is probably ");
    doubt.append(unit.name);
    if (side_right) {
      doubt.append("; state the unit of the scan");
      return doubt;
    }
    doubt.append(", and ");
  } else if (!unit_right) {
    doubt.append(side_right ? "wrong distance, unit or frame" : "wrong distance, unit or frame, and ");
    if (side_right) return doubt;
  }
  doubt.append("its axes are not the scanner's: +Z must point from the scanner to the part");
  return doubt;
}

}  // namespace slabd
