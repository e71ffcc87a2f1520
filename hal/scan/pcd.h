// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/base.h"
#include "hal/hal.h"
#include "hal/scan/text_lines.h"

/// Parses the header of a PCD file (Point Cloud Library file format, versions 0.6 and 0.7) into the positions of x, y
/// and z. Does not check the file's size: the caller compares `bytes_min` and `bytes_exact`.
namespace slabd::hal {

enum class PcdData : std::uint8_t { ascii, binary, binary_compressed };

struct PcdLayout {
  PcdData data = PcdData::ascii;
  std::size_t header_bytes = 0;
  std::size_t header_lines = 0;
  LineEnd line_end = LineEnd::lf;
  std::uint64_t points = 0;
  std::uint64_t width = 0;  ///< organised (HEIGHT > 1): width * height == points; 0 = unorganised
  std::uint64_t height = 0;
  std::size_t stride = 0;  ///< bytes of one point in binary data
  std::size_t values = 0;  ///< numbers of one point as text
  struct Coordinate {
    std::size_t offset = 0;  ///< bytes before it in a point; times `points`: bytes before its plane when compressed
    std::size_t column = 0;  ///< values before it in a line
    bool is_double = false;
  };
  std::array<Coordinate, 3> xyz;
  std::uint64_t bytes_min = 0;  ///< least size of the file
  bool bytes_exact = false;     ///< true if that is the exact size (binary)
  DeclaredEmulation emulation;
  DeclaredTemperature scanner;
};

/// Compressed data begin with two 32-bit lengths: of the compressed and of the decompressed bytes.
inline constexpr std::size_t kPcdCompressedPrefixBytes = 8;
/// Largest number of fields of one point; PCL's widest point types have about 20.
inline constexpr std::size_t kPcdFieldsMax = 64;

/// Reads the header at the start of `head` (the first limits::kScanHeaderBytesMax bytes of the file, or all of it).
/// Accepted: FIELDS with x, y, z of TYPE F, SIZE 4 or 8, COUNT 1, any others beside them; WIDTH, HEIGHT; POINTS equal
/// to their product; DATA ascii, binary, binary_compressed. VIEWPOINT is checked and not applied: points stay in the
/// frame they are stored in, the scanner's. A comment that declares another unit of length than `unit` is refused.
/// frame_incomplete: the text names `file`, the header line and what is supported; too_few_points: no points declared.
/// No heap.
[[nodiscard]] Result<PcdLayout> parse_pcd_header(std::string_view head, const char* file, LengthUnit unit);

}  // namespace slabd::hal
