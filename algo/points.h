// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "base/base.h"

/// Two views of a set of points without a copy. Each fit is written once for both.
namespace slabd::algo {

/// A rigid transform unpacked for the inner loops over float points: one matrix product, no quaternion.
class FastTransform {
 public:
  explicit FastTransform(const Pose& pose) : R_(pose.rotation.toRotationMatrix()), t_(pose.translation_mm) {}

  [[nodiscard]] Vec3 operator()(const float* xyz) const {
    const double x = static_cast<double>(xyz[0]);
    const double y = static_cast<double>(xyz[1]);
    const double z = static_cast<double>(xyz[2]);
    return {R_(0, 0) * x + R_(0, 1) * y + R_(0, 2) * z + t_.x(), R_(1, 0) * x + R_(1, 1) * y + R_(1, 2) * z + t_.y(),
            R_(2, 0) * x + R_(2, 1) * y + R_(2, 2) * z + t_.z()};
  }

 private:
  Mat3 R_;
  Vec3 t_;
};

/// The points of a cloud selected by `index`, in the block frame.
struct CloudPoints {
  const float* xyz = nullptr;
  std::span<const std::uint32_t> index;
  FastTransform T_block_scanner;

  [[nodiscard]] std::size_t size() const { return index.size(); }
  [[nodiscard]] Vec3 operator[](std::size_t i) const { return T_block_scanner(xyz + 3 * std::size_t{index[i]}); }
};

/// Index of a point among the `stride` ones from j * stride on: pseudo-random and reproducible. A fixed stride would
/// hit the same few columns in the rows of many scans, and so would multiples of a constant.
[[nodiscard]] inline std::size_t thinned_index(std::size_t j, std::size_t stride) {
  std::uint64_t h = j * 0x9E37'79B9'7F4A'7C15U;
  h = (h ^ (h >> 29U)) * 0xBF58'476D'1CE4'E5B9U;
  return j * stride + static_cast<std::size_t>((h >> 40U) * stride >> 24U);
}

}  // namespace slabd::algo
