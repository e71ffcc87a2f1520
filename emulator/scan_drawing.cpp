// SPDX-License-Identifier: Apache-2.0
#include "emulator/scan_drawing.h"

#include <algorithm>
#include <cmath>

namespace slabd::emulator {
namespace {

/// Standard normal deviates as 2^16 equally likely values, the quantiles of the distribution: one table look-up per
/// point instead of a logarithm and a cosine. The tails end at +-4.3 sigma.
const std::vector<float>& normal_table() {
  static const std::vector<float> table = [] {
    constexpr std::size_t kSize = 1U << 16U;
    std::vector<float> values(kSize);
    double z = -4.4;
    for (std::size_t i = 0; i < kSize; ++i) {
      const double p = (static_cast<double>(i) + 0.5) / static_cast<double>(kSize);
      // Newton on the distribution function, started at the previous quantile (below the root, where it is convex on
      // the left half; a few steps suffice everywhere).
      for (int step = 0; step < 60; ++step) {
        const double excess = 0.5 * std::erfc(-z / std::sqrt(2.0)) - p;
        const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * kPi);
        const double move = std::clamp(excess / density, -0.1, 0.1);
        z -= move;
        if (std::abs(move) < 1e-12) break;
      }
      values[i] = static_cast<float>(z);
    }
    return values;
  }();
  return table;
}

std::vector<float> white_field(std::size_t count, std::uint64_t seed) {
  const std::vector<float>& normals = normal_table();
  std::vector<float> field(count);
  Prng random(seed);
  for (std::size_t i = 0; i < count; i += 4) {
    std::uint64_t bits = random.next();
    for (std::size_t k = i; k < std::min(i + 4, count); ++k, bits >>= 16U) field[k] = normals[bits & 0xFFFFU];
  }
  return field;
}

/// One row or column of first-order autoregression, stationary from its first value on.
struct Recursion {
  explicit Recursion(double step_over_length)
      : keep(static_cast<float>(std::exp(-step_over_length))),
        add(static_cast<float>(std::sqrt(-std::expm1(-2.0 * step_over_length)))) {}
  float keep;
  float add;
};

std::vector<float> exponential_field(std::size_t columns, std::size_t rows, double step_x, double step_y,
                                     std::uint64_t seed) {
  std::vector<float> field = white_field(columns * rows, seed);
  const Recursion along_row(step_x);
  const Recursion along_column(step_y);
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t i = row * columns + 1; i < (row + 1) * columns; ++i)
      field[i] = along_row.keep * field[i - 1] + along_row.add * field[i];
  for (std::size_t i = columns; i < field.size(); ++i)
    field[i] = along_column.keep * field[i - columns] + along_column.add * field[i];
  return field;
}

/// White noise through a Gaussian filter of L / 2 has the correlation exp(-r^2 / L^2); weights of unit power.
std::vector<float> gaussian_weights(double step_over_length) {
  const int reach = static_cast<int>(std::ceil(2.0 / step_over_length));  // four standard deviations
  std::vector<float> weights;
  double power = 0.0;
  for (int i = -reach; i <= reach; ++i) {
    const double u = 2.0 * i * step_over_length;
    weights.push_back(static_cast<float>(std::exp(-0.5 * u * u)));
    power += std::exp(-u * u);
  }
  for (float& weight : weights) weight /= static_cast<float>(std::sqrt(power));
  return weights;
}

std::vector<float> gaussian_field(std::size_t columns, std::size_t rows, double step_x, double step_y,
                                  std::uint64_t seed) {
  const std::vector<float> across = gaussian_weights(step_x);
  const std::vector<float> down = gaussian_weights(step_y);
  const std::size_t wide = columns + across.size() - 1;
  const std::size_t high = rows + down.size() - 1;
  const std::vector<float> white = white_field(wide * high, seed);
  std::vector<float> rows_done(columns * high, 0.0F);
  for (std::size_t row = 0; row < high; ++row)
    for (std::size_t k = 0; k < across.size(); ++k)
      for (std::size_t column = 0; column < columns; ++column)
        rows_done[row * columns + column] += across[k] * white[row * wide + column + k];
  std::vector<float> field(columns * rows, 0.0F);
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t k = 0; k < down.size(); ++k)
      for (std::size_t column = 0; column < columns; ++column)
        field[row * columns + column] += down[k] * rows_done[(row + k) * columns + column];
  return field;
}

}  // namespace

std::vector<float> noise_field(const ScannerTraits& traits, std::uint64_t seed) {
  const double length = traits.noise_correlation_mm;
  if (length <= 0.0) return white_field(traits.columns * traits.rows, seed);
  const double step_x = traits.field_x_mm / static_cast<double>(traits.columns) / length;
  const double step_y = traits.field_y_mm / static_cast<double>(traits.rows) / length;
  return traits.noise_shape == NoiseShape::gaussian
             ? gaussian_field(traits.columns, traits.rows, step_x, step_y, seed)
             : exponential_field(traits.columns, traits.rows, step_x, step_y, seed);
}

DrawnScan draw_scan(const BlockSurface& surface, const ScannerTraits& traits, std::uint64_t seed,
                    std::vector<float>& xyz) {
  const std::vector<float>& normals = normal_table();
  // Shares as 16-bit thresholds: steps of 1/65536, too fine to be detected in one scan.
  const auto missing_below = static_cast<std::uint32_t>(std::lround(traits.missing_share * 65536.0));
  const auto outlier_below = static_cast<std::uint32_t>(std::lround(traits.outlier_share * 65536.0));
  const double outlier_span = (kOutlierMax_mm - kOutlierMin_mm) / 32768.0;
  const float missing_point = std::numeric_limits<float>::quiet_NaN();
  constexpr std::uint64_t kNoiseStream = 0x6E6F697365U;  // independent of the stream for the rays
  const bool correlated = traits.noise_correlation_mm > 0.0;
  const std::vector<float> field = correlated ? noise_field(traits, seed ^ kNoiseStream) : std::vector<float>{};

  xyz.resize(traits.columns * traits.rows * 3);
  Prng random(seed);
  DrawnScan drawn;
  const double step_x = traits.field_x_mm / static_cast<double>(traits.columns);
  const double step_y = traits.field_y_mm / static_cast<double>(traits.rows);
  std::size_t at = 0;
  for (std::size_t row = 0; row < traits.rows; ++row) {
    const double y = (static_cast<double>(row) + 0.5) * step_y - 0.5 * traits.field_y_mm;
    for (std::size_t column = 0; column < traits.columns; ++column) {
      const double x = (static_cast<double>(column) + 0.5) * step_x - 0.5 * traits.field_x_mm;
      // One draw is used for all decisions about a ray, 16 bits each.
      const std::uint64_t bits = random.next();
      const double depth = surface.depth_mm(x, y);
      const bool no_return = std::isnan(depth);
      const bool missing = (bits & 0xFFFFU) < missing_below;
      drawn.no_return += no_return ? 1U : 0U;
      drawn.missing += (missing && !no_return) ? 1U : 0U;
      if (no_return || missing) {
        if (!traits.organised) continue;
        xyz[at++] = missing_point;
        xyz[at++] = missing_point;
        xyz[at++] = missing_point;
        continue;
      }
      double further = 0.0;
      if (((bits >> 16U) & 0xFFFFU) < outlier_below) {
        const double size = static_cast<double>((bits >> 48U) & 0x7FFFU) * outlier_span + kOutlierMin_mm;
        further = (bits >> 63U) != 0 ? size : -size;
        ++drawn.outliers;
      } else {
        const float unit = correlated ? field[row * traits.columns + column] : normals[(bits >> 32U) & 0xFFFFU];
        further = traits.noise_mm * static_cast<double>(unit);
      }
      const Vec3 p = surface.point(x, y, depth, further);
      xyz[at++] = static_cast<float>(p.x());
      xyz[at++] = static_cast<float>(p.y());
      xyz[at++] = static_cast<float>(p.z());
      ++drawn.valid;
    }
  }
  xyz.resize(at);
  if (traits.organised) {
    drawn.width = traits.columns;
    drawn.height = traits.rows;
  }
  return drawn;
}

}  // namespace slabd::emulator
