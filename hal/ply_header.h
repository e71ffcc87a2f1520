// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/base.h"

/// The text at the start of a PLY file, turned into byte positions. Nothing in it is believed about the file's size:
/// the caller compares `bytes_min` and `bytes_exact` with the file before it reads a vertex.
namespace slabd::hal {

struct PlyLayout {
  bool big_endian = false;
  std::uint64_t vertex_offset = 0;  ///< first byte of the first vertex
  std::uint64_t vertices = 0;
  std::size_t stride = 0;  ///< bytes of one vertex
  /// Of x, y and z inside a vertex.
  struct Coordinate {
    std::size_t offset = 0;
    bool is_double = false;
  };
  std::array<Coordinate, 3> xyz;
  std::uint64_t width = 0;  ///< organised: width * height == vertices; 0 = unorganised
  std::uint64_t height = 0;
  std::uint64_t bytes_min = 0;  ///< the file has at least so many bytes
  bool bytes_exact = false;     ///< and not one more (no list element follows whose length only its content tells)
};

/// A vertex longer than this is not a scanner's: room for 64 doubles beside x, y, z.
inline constexpr std::size_t kPlyStrideMax = 536;
/// Counts beyond this are refused before anything is multiplied with them (2^40 * stride fits 64 bits with room).
inline constexpr std::uint64_t kPlyCountMax = std::uint64_t{1} << 40U;

/// Reads the header at the start of `head` (the first limits::kScanHeaderBytesMax bytes of the file, or all of it).
/// Accepted: binary_little_endian or binary_big_endian 1.0; one element `vertex` of scalar properties with float or
/// double x, y, z; `comment organized width W height H`; other elements before the vertices when they are scalar, and
/// any after them. frame_incomplete: the text names `file`, the header line and what is supported; too_few_points: no
/// vertices declared. No heap.
[[nodiscard]] Result<PlyLayout> parse_ply_header(std::string_view head, const char* file);

}  // namespace slabd::hal
