// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "base/base.h"

/// Conversion of a GenICam component (EMVA Pixel Format Naming Convention 2.x, Coord3D formats) to the points of a scan
/// stream: three float32 per point, mm, row by row, NaN in all three for a missing point. Pure: no camera, no heap.
namespace slabd::gateway::genicam {

/// Organised formats with all three coordinates. Formats without A and B (Coord3D_C16) need a camera model, which only
/// the vendor has.
enum class PointFormat : std::uint8_t {
  abc32f,         ///< x y z x y z ..., float32
  abc32f_planar,  ///< all x, all y, all z
  abc16,          ///< x y z x y z ..., uint16
  abc16_planar,
};

struct FormatInfo {
  PointFormat format;
  std::uint32_t code;  ///< PFNC value, which a frame's leader contains
  const char* name;    ///< entry of the feature PixelFormat
  std::size_t coordinate_bytes;
  bool planar;
};
inline constexpr std::array<FormatInfo, 4> kPointFormats = {{
    {PointFormat::abc32f, 0x026000C0, "Coord3D_ABC32f", 4, false},
    {PointFormat::abc32f_planar, 0x026000C1, "Coord3D_ABC32f_Planar", 4, true},
    {PointFormat::abc16, 0x023000B9, "Coord3D_ABC16", 2, false},
    {PointFormat::abc16_planar, 0x023000BA, "Coord3D_ABC16_Planar", 2, true},
}};
[[nodiscard]] constexpr const FormatInfo& info(PointFormat format) {
  return kPointFormats[static_cast<std::size_t>(format)];
}
/// The format of a PFNC value; config: the text contains the value and the allowed formats.
[[nodiscard]] Result<PointFormat> point_format_of(std::uint32_t code);
/// The format of an entry of PixelFormat; config: the text contains the entry and the allowed ones.
[[nodiscard]] Result<PointFormat> point_format_named(std::string_view name);
/// "Coord3D_ABC32f, Coord3D_ABC32f_Planar, ...".
[[nodiscard]] std::string point_format_names();

/// One coordinate as the node map describes it: mm = scale * raw + offset (SFNC 2.x, Scan3dCoordinateScale, -Offset).
struct Axis {
  double scale = 1.0;  ///< mm per count
  double offset_mm = 0.0;
  bool has_invalid = false;  ///< Scan3dInvalidDataFlag
  double invalid = 0.0;      ///< Scan3dInvalidDataValue, a raw value: a point with it in this coordinate is missing
};

struct PointLayout {
  PointFormat format = PointFormat::abc32f;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::array<Axis, 3> axes;

  [[nodiscard]] std::size_t points() const { return std::size_t{width} * height; }
  /// Bytes of the component in a frame, without padding.
  [[nodiscard]] std::size_t bytes() const { return points() * 3 * info(format).coordinate_bytes; }
};
/// Checks size, scale, offset and invalid value. config: the text contains feature, value and range.
[[nodiscard]] Status check(const PointLayout& layout);

/// Byte that a frame's memory is filled with before the exposure, so that bytes that never arrived are detected and
/// bytes of an earlier frame are never measured. As float32 it is -2.9e-16 and as uint16 42 405: neither a coordinate
/// that repeats in neighbours nor a usual mark of missing points.
inline constexpr std::byte kUnwritten{0xA5};
/// Position of the first run of unwritten bytes of four points or more; raw.size() if there is none.
[[nodiscard]] std::size_t first_gap(const PointLayout& layout, std::span<const std::byte> raw);

/// Converts `raw`, layout.bytes() long, to `xyz`, 3 * layout.points() long; returns the number of points that are not
/// missing. A point of unwritten bytes is missing. Float32 with scale 1 and offset 0 keeps its bits; others are
/// computed in double and rounded once.
std::size_t convert(const PointLayout& layout, std::span<const std::byte> raw, std::span<float> xyz);

}  // namespace slabd::gateway::genicam
