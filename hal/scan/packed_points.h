// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/base.h"

/// Predictor of the packed archive: turns a block of points into planes of bytes that compress well, and back, with the
/// same bits. hal/scan/packed.cpp compresses the planes.
namespace slabd::hal {

/// Points whose record is a number of float32 words, little-endian, x, y and z among them.
struct PackedRecord {
  std::uint8_t words = 0;                ///< of one record; 0: the file has no such points
  std::array<std::uint8_t, 3> xyz = {};  ///< words of x, y, z
  std::uint32_t row = 0;                 ///< points of a row; 0: not organised

  [[nodiscard]] std::size_t bytes() const { return std::size_t{4} * words; }
};
/// x, y, z with normals, colours and other columns. Wider records are packed without the predictor.
inline constexpr std::size_t kPackedWordsMax = 16;
/// Points of one block: 26 rows of a full-size scan. Half of it costs 2 % in size, twice of it gains 1 %.
inline constexpr std::size_t kPackedPointsMax = 65'536;

/// How the points of one block were predicted.
struct PointCoding {
  std::uint8_t rays = 0;     ///< bit 0: x, bit 1: y were predicted from z along the rays of the scanner
  std::uint8_t missing = 0;  ///< how the block writes a missing point: index of kMissingWords
};
/// Bits of x, y and z of a missing point: the NaN of most programs, zeros, the NaN of x86 arithmetic.
inline constexpr std::array<std::uint32_t, 3> kMissingWords = {0x7FC0'0000U, 0U, 0xFFC0'0000U};

/// Buffers for one block; 9 MB at most.
class PointPlanes {
 public:
  explicit PointPlanes(const PackedRecord& record) : record_(record) {}

  /// Splits `records` (whole records, at most kPackedPointsMax) into planes(). `first`: number of points in the file
  /// before them.
  [[nodiscard]] PointCoding split(std::span<const std::byte> records, std::uint64_t first);
  /// Planes of the last split(), to be compressed one by one: a bit for each missing point, then for each word its
  /// lowest to highest byte.
  [[nodiscard]] std::span<const std::span<const std::byte>> planes() const { return planes_; }

  /// Restores `records` from the planes in one piece. False if they are not the planes of that number of points;
  /// `records` is undefined then.
  [[nodiscard]] bool join(PointCoding coding, std::span<const std::byte> planes, std::uint64_t first,
                          std::span<std::byte> records);

 private:
  template <typename Use>
  void walk(Use use) const;
  [[nodiscard]] bool is_missing(std::size_t i) const { return (unsigned{mask_[i / 8]} >> (i % 8) & 1U) != 0; }
  [[nodiscard]] std::uint32_t predicted(std::size_t i, bool left, bool up) const;
  [[nodiscard]] std::uint32_t predicted_by_ray(std::size_t i, bool left, bool up, bool corner,
                                               std::uint32_t otherwise) const;
  void begin(std::size_t points, std::uint64_t first);
  void find_missing(std::span<const std::byte> records, PointCoding& coding);
  void keep_depth();
  bool split_word(std::span<const std::byte> records, std::size_t word, bool may_use_rays);
  void add_planes(std::span<const std::uint32_t> residuals);
  void join_word(std::size_t word, bool by_ray, std::span<const std::byte> planes, std::uint32_t missing,
                 std::span<std::byte> records);
  /// Order of the words: z first, because x and y are predicted from it.
  [[nodiscard]] std::size_t word_in_order(std::size_t place) const;
  [[nodiscard]] bool is_coordinate(std::size_t word) const;

  PackedRecord record_;
  std::size_t points_ = 0;
  std::uint64_t first_ = 0;
  std::size_t missing_count_ = 0;
  std::vector<std::uint8_t> mask_;      ///< a bit for each point, set if it is missing
  std::vector<std::uint32_t> values_;   ///< of the current word, in the order of the numbers
  std::vector<double> depth_;           ///< z
  std::vector<double> ratio_;           ///< x / z or y / z
  std::vector<std::uint32_t> by_left_;  ///< residuals of both predictors
  std::vector<std::uint32_t> by_ray_;
  std::vector<std::byte> bytes_;
  std::vector<std::span<const std::byte>> planes_;
};

}  // namespace slabd::hal
