// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "base/base.h"

/// Accurate sums over five million points. The textbook "sum of squares minus square of sums" loses all its digits if
/// points are metres from the origin with a spread of hundredths of a millimetre. Here every value is taken relative to
/// a shift close to the data and summed in blocks of 4096, so that the summands have similar sizes. The blocks also fix
/// the order of addition, hence the bits of the result.
namespace slabd::algo {

inline constexpr std::size_t kSumBlock = 4096;

/// Count, mean and second moments of points.
class PointMoments {
 public:
  explicit PointMoments(const Vec3& shift) : shift_(shift) {}

  void add(const Vec3& p) {
    const double x = p.x() - shift_.x();
    const double y = p.y() - shift_.y();
    const double z = p.z() - shift_.z();
    block_[0] += x;
    block_[1] += y;
    block_[2] += z;
    block_[3] += x * x;
    block_[4] += x * y;
    block_[5] += x * z;
    block_[6] += y * y;
    block_[7] += y * z;
    block_[8] += z * z;
    if (++in_block_ == kSumBlock) close_block();
  }

  /// Completes the sums. Call once after the last `add`, before reading.
  void close_block() {
    for (std::size_t i = 0; i < total_.size(); ++i) total_[i] += block_[i];
    block_.fill(0.0);
    count_ += in_block_;
    in_block_ = 0;
  }

  /// Adds sums computed elsewhere about the same shift: x y z, xx xy xz, yy yz, zz.
  void add_sums(const std::array<double, 9>& sums, std::size_t count) {
    for (std::size_t i = 0; i < total_.size(); ++i) total_[i] += sums[i];
    count_ += count;
  }

  [[nodiscard]] const Vec3& shift() const { return shift_; }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] Vec3 mean() const {
    const double n = static_cast<double>(count_);
    return shift_ + Vec3(total_[0], total_[1], total_[2]) / n;
  }
  /// Sum of (p - mean)(p - mean)^T.
  [[nodiscard]] Mat3 scatter() const {
    const double n = static_cast<double>(count_);
    const Vec3 s(total_[0], total_[1], total_[2]);
    Mat3 q;
    q << total_[3], total_[4], total_[5], total_[4], total_[6], total_[7], total_[5], total_[7], total_[8];
    return q - s * s.transpose() / n;
  }

 private:
  Vec3 shift_;
  std::array<double, 9> block_{};
  std::array<double, 9> total_{};
  std::size_t in_block_ = 0;
  std::size_t count_ = 0;
};

/// Count, mean and variance of numbers.
class ScalarMoments {
 public:
  explicit ScalarMoments(double shift) : shift_(shift) {}

  void add(double value) {
    const double v = value - shift_;
    block_sum_ += v;
    block_squares_ += v * v;
    if (++in_block_ == kSumBlock) close_block();
  }
  /// Completes the sums. Call once after the last `add`, before reading.
  void close_block() {
    sum_ += block_sum_;
    squares_ += block_squares_;
    count_ += in_block_;
    block_sum_ = block_squares_ = 0.0;
    in_block_ = 0;
  }

  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] double mean() const { return shift_ + sum_ / static_cast<double>(count_); }
  /// Sum of squared deviations from the mean over (count - lost); NaN if count <= lost.
  [[nodiscard]] double variance(std::size_t lost) const {
    if (count_ <= lost) return kNoValue;
    const double scatter = squares_ - sum_ * sum_ / static_cast<double>(count_);
    return std::fmax(scatter, 0.0) / static_cast<double>(count_ - lost);
  }

 private:
  double shift_;
  double block_sum_ = 0.0;
  double block_squares_ = 0.0;
  double sum_ = 0.0;
  double squares_ = 0.0;
  std::size_t in_block_ = 0;
  std::size_t count_ = 0;
};

}  // namespace slabd::algo
