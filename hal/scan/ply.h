// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/base.h"
#include "hal/hal.h"
#include "hal/scan/text_lines.h"

/// Parses the header of a PLY file into a description of its body. Does not check the file's size: the caller compares
/// `bytes_min` and `bytes_exact` with the file before it reads a vertex.
namespace slabd::hal {

enum class PlyEncoding : std::uint8_t { ascii, little_endian, big_endian };

struct PlyProperty {
  std::uint8_t bytes = 0;        ///< size of the scalar, or of each value of the list
  std::uint8_t count_bytes = 0;  ///< size of the length in front of a list; 0 = a scalar
  bool count_signed = false;
  bool is_double = false;
  std::int8_t axis = -1;  ///< 0, 1, 2: the vertex' x, y, z
};

struct PlyElement {
  bool is_vertex = false;
  bool has_list = false;
  std::uint64_t count = 0;
  std::size_t bytes = 0;  ///< of one item in a binary body; with lists: if all of them are empty
  std::size_t first_property = 0;
  std::size_t properties = 0;
};

/// Known scanner and mesh programs write at most 5 elements and 30 properties.
inline constexpr std::size_t kPlyElementsMax = 32;
inline constexpr std::size_t kPlyPropertiesMax = 256;

struct PlyLayout {
  PlyEncoding encoding = PlyEncoding::ascii;
  std::size_t header_bytes = 0;
  std::size_t header_lines = 0;
  LineEnd line_end = LineEnd::lf;
  FixedVector<PlyElement, kPlyElementsMax> elements;       ///< in the order of the body
  FixedVector<PlyProperty, kPlyPropertiesMax> properties;  ///< of all elements
  std::uint64_t vertices = 0;
  std::uint64_t width = 0;  ///< organised: width * height == vertices; 0 = unorganised
  std::uint64_t height = 0;
  std::uint64_t bytes_min = 0;  ///< least size of the file
  bool bytes_exact = false;     ///< true if that is the exact size: a binary body without lists
  DeclaredEmulation emulation;
  DeclaredTemperature scanner;

  [[nodiscard]] std::span<const PlyProperty> of(const PlyElement& element) const {
    return {properties.data() + element.first_property, element.properties};
  }
};

/// Reads the header at the start of `head` (the first limits::kScanHeaderBytesMax bytes of the file, or all of it).
/// Accepted: ascii, binary_little_endian or binary_big_endian 1.0; one element `vertex` with float or double x, y, z,
/// beside them scalars and lists; any other elements before and after; `comment organized width W height H`; lines
/// ended by LF, CR LF or CR. A comment or obj_info that declares another unit of length than `unit` is refused.
/// frame_incomplete: the text names `file`, the header line and what is supported; too_few_points: no vertices
/// declared. No heap.
[[nodiscard]] Result<PlyLayout> parse_ply_header(std::string_view head, const char* file,
                                                 LengthUnit unit = LengthUnit::mm);

}  // namespace slabd::hal
