// SPDX-License-Identifier: Apache-2.0
#include "gateway/genicam/points.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace slabd::gateway::genicam {
namespace {

static_assert(std::endian::native == std::endian::little, "GenICam pixels are little-endian and are copied");

constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();
/// Names of the coordinates in the node map, for messages.
constexpr std::array<const char*, 3> kAxisNames = {"CoordinateA", "CoordinateB", "CoordinateC"};
/// Largest |scale| and |offset|: a scanner's coordinates are within metres, and 65 535 counts of 1 mm are 65 m. A value
/// beyond is a register that was read in another unit or byte order.
constexpr double kScaleMax = 1e3;
constexpr double kOffsetMax_mm = 1e5;

/// Number of coordinates with a negative scale.
unsigned axes_negative(const PointLayout& layout) {
  unsigned count = 0;
  for (const Axis& axis : layout.axes) count += axis.scale < 0.0 ? 1U : 0U;
  return count;
}

template <typename Raw>
struct Pixel {
  Raw x, y, z;
};

template <typename Raw>
bool is_unwritten(const Pixel<Raw>& p) {
  std::array<std::byte, sizeof p> bytes;
  std::memcpy(bytes.data(), &p, sizeof p);
  for (const std::byte b : bytes)
    if (b != kUnwritten) return false;
  return true;
}

/// mm of a raw value; NaN if it is the invalid one. NaN as the invalid value needs no comparison.
template <typename Raw>
float millimetres(const Axis& axis, Raw raw) {
  const auto value = static_cast<double>(raw);
  if (axis.has_invalid && value == axis.invalid) return kMissing;
  if constexpr (std::is_same_v<Raw, float>)
    if (axis.scale == 1.0 && axis.offset_mm == 0.0) return raw;
  return static_cast<float>(axis.scale * value + axis.offset_mm);
}

template <typename Raw>
std::size_t convert_as(const PointLayout& layout, std::span<const std::byte> raw, std::span<float> xyz) {
  const std::size_t points = layout.points();
  const bool planar = info(layout.format).planar;
  const std::size_t step = planar ? sizeof(Raw) : 3 * sizeof(Raw);
  const std::size_t plane = planar ? points * sizeof(Raw) : sizeof(Raw);
  std::size_t finite = 0;
  for (std::size_t i = 0; i < points; ++i) {
    Pixel<Raw> p;
    std::memcpy(&p.x, &raw[i * step], sizeof(Raw));
    std::memcpy(&p.y, &raw[i * step + plane], sizeof(Raw));
    std::memcpy(&p.z, &raw[i * step + 2 * plane], sizeof(Raw));
    const float x = millimetres(layout.axes[0], p.x);
    const float y = millimetres(layout.axes[1], p.y);
    const float z = millimetres(layout.axes[2], p.z);
    const bool is_there = std::isfinite(x) && std::isfinite(y) && std::isfinite(z) && !is_unwritten(p);
    xyz[3 * i] = is_there ? x : kMissing;
    xyz[3 * i + 1] = is_there ? y : kMissing;
    xyz[3 * i + 2] = is_there ? z : kMissing;
    finite += is_there ? 1 : 0;
  }
  return finite;
}

}  // namespace

std::string point_format_names() {
  std::string names;
  for (const FormatInfo& known : kPointFormats) names += (names.empty() ? "" : ", ") + std::string(known.name);
  return names;
}

Result<PointFormat> point_format_of(std::uint32_t code) {
  for (const FormatInfo& known : kPointFormats)
    if (known.code == code) return known.format;
  return error(Code::config, "the frame's pixel format is 0x%08X, allowed are %s", code, point_format_names().c_str());
}

Result<PointFormat> point_format_named(std::string_view name) {
  for (const FormatInfo& known : kPointFormats)
    if (known.name == name) return known.format;
  return error(Code::config, "feature PixelFormat: found %.*s, allowed are %s", static_cast<int>(name.size()),
               name.data(), point_format_names().c_str());
}

Status check(const PointLayout& layout) {
  if (layout.width == 0 || layout.height == 0)
    return error(Code::config, "features Width and Height: found %u and %u, allowed are numbers above 0", layout.width,
                 layout.height);
  if (layout.width > limits::kScanPointsMax || layout.height > limits::kScanPointsMax ||
      layout.points() > limits::kScanPointsMax)
    return error(Code::config, "features Width and Height: %u x %u points, allowed are %zu in all", layout.width,
                 layout.height, limits::kScanPointsMax);
  for (std::size_t i = 0; i < layout.axes.size(); ++i) {
    const Axis& axis = layout.axes[i];
    if (!(std::abs(axis.scale) > 0.0 && std::abs(axis.scale) <= kScaleMax))
      return error(Code::config, "feature Scan3dCoordinateScale of %s: found %g, allowed is above 0 and at most %g",
                   kAxisNames[i], axis.scale, kScaleMax);
    if (!(std::abs(axis.offset_mm) <= kOffsetMax_mm))
      return error(Code::config, "feature Scan3dCoordinateOffset of %s: found %g, allowed is -%g to %g", kAxisNames[i],
                   axis.offset_mm, kOffsetMax_mm, kOffsetMax_mm);
  }
  // Left-handed coordinates are a mirrored slab, which a scan alone does not show.
  if ((axes_negative(layout) & 1U) != 0)
    return error(Code::config,
                 "feature Scan3dCoordinateScale: an odd number of the scales %g, %g, %g is negative, which "
                 "mirrors the scan; allowed are all positive, or two negative",
                 layout.axes[0].scale, layout.axes[1].scale, layout.axes[2].scale);
  return success();
}

std::size_t first_gap(const PointLayout& layout, std::span<const std::byte> raw) {
  constexpr std::size_t kGapPoints = 4;  // of a real surface, neighbours differ in one coordinate at least
  const std::size_t run = kGapPoints * 3 * info(layout.format).coordinate_bytes;
  // Each run of this length contains a multiple of half of it, and begins less than that before it.
  for (std::size_t i = 0; i < raw.size(); i += run / 2) {
    if (raw[i] != kUnwritten) continue;
    std::size_t begin = i;
    std::size_t end = i;
    while (begin > 0 && raw[begin - 1] == kUnwritten) --begin;
    while (end < raw.size() && raw[end] == kUnwritten && end - begin < run) ++end;
    if (end - begin >= run) return begin;
  }
  return raw.size();
}

std::size_t convert(const PointLayout& layout, std::span<const std::byte> raw, std::span<float> xyz) {
  assert(raw.size() == layout.bytes() && xyz.size() == 3 * layout.points());
  return info(layout.format).coordinate_bytes == sizeof(float) ? convert_as<float>(layout, raw, xyz)
                                                               : convert_as<std::uint16_t>(layout, raw, xyz);
}

}  // namespace slabd::gateway::genicam
