// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace slabd::algo {

/// Index of a point among the `stride` ones that begin at j * stride. As good as drawn, and always the same: a fixed
/// stride meets the rows of many a scan in the same few columns, and so do multiples of a constant.
[[nodiscard]] inline std::size_t thinned_index(std::size_t j, std::size_t stride) {
  std::uint64_t h = j * 0x9E37'79B9'7F4A'7C15U;
  h = (h ^ (h >> 29U)) * 0xBF58'476D'1CE4'E5B9U;
  return j * stride + static_cast<std::size_t>((h >> 40U) * stride >> 24U);
}

}  // namespace slabd::algo
