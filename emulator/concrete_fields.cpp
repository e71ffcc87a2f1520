// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_fields.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "emulator/scan_drawing.h"

namespace slabd::simulate {

std::size_t RasterField::columns_of(const FieldSize& size) {
  return static_cast<std::size_t>(std::ceil(2.0 * size.half_x_mm / size.step_mm)) + 1;
}

std::size_t RasterField::rows_of(const FieldSize& size) {
  return static_cast<std::size_t>(std::ceil(2.0 * size.half_y_mm / size.step_mm)) + 1;
}

RasterField::RasterField(const FieldSize& size, std::vector<float> heights)
    : size_(size),
      columns_(columns_of(size)),
      rows_(rows_of(size)),
      per_mm_(1.0 / size.step_mm),
      heights_(std::move(heights)) {
  assert(heights_.size() == columns_ * rows_);
}

RasterField RasterField::grain(const FieldSize& size, double length_mm, std::uint64_t seed) {
  ScannerTraits raster;
  raster.columns = columns_of(size);
  raster.rows = rows_of(size);
  raster.field_x_mm = size.step_mm * static_cast<double>(raster.columns);
  raster.field_y_mm = size.step_mm * static_cast<double>(raster.rows);
  raster.noise_correlation_mm = length_mm;
  return {size, noise_field(raster, seed)};
}

RasterField RasterField::waves(const FieldSize& size, double shortest_mm, double longest_mm, int count,
                               std::uint64_t seed) {
  const std::size_t columns = columns_of(size);
  const std::size_t rows = rows_of(size);
  std::vector<float> heights(columns * rows, 0.0F);
  const double amplitude = std::sqrt(2.0 / count);
  Prng random(seed);
  for (int wave = 0; wave < count; ++wave) {
    const double length = shortest_mm + (longest_mm - shortest_mm) * (wave + random.uniform()) / count;
    const double direction = 2.0 * kPi * random.uniform();
    const double phase = 2.0 * kPi * random.uniform();
    const double kx = 2.0 * kPi / length * std::cos(direction) * size.step_mm;
    const double ky = 2.0 * kPi / length * std::sin(direction) * size.step_mm;
    // cos(a + b) from tables of one row and one column: no cosine per node.
    std::vector<float> cos_x(columns);
    std::vector<float> sin_x(columns);
    for (std::size_t i = 0; i < columns; ++i) {
      cos_x[i] = static_cast<float>(amplitude * std::cos(kx * static_cast<double>(i)));
      sin_x[i] = static_cast<float>(amplitude * std::sin(kx * static_cast<double>(i)));
    }
    for (std::size_t row = 0; row < rows; ++row) {
      const auto c = static_cast<float>(std::cos(ky * static_cast<double>(row) + phase));
      const auto s = static_cast<float>(std::sin(ky * static_cast<double>(row) + phase));
      float* out = &heights[row * columns];
      for (std::size_t i = 0; i < columns; ++i) out[i] += cos_x[i] * c - sin_x[i] * s;
    }
  }
  return {size, std::move(heights)};
}

double RasterField::at(double x_mm, double y_mm) const {
  if (heights_.empty()) return 0.0;
  const double column = std::clamp((x_mm + size_.half_x_mm) * per_mm_, 0.0, static_cast<double>(columns_ - 1) - 1e-9);
  const double row = std::clamp((y_mm + size_.half_y_mm) * per_mm_, 0.0, static_cast<double>(rows_ - 1) - 1e-9);
  const auto c = static_cast<std::size_t>(column);
  const auto r = static_cast<std::size_t>(row);
  const auto u = static_cast<float>(column - static_cast<double>(c));
  const auto v = static_cast<float>(row - static_cast<double>(r));
  const float* low = &heights_[r * columns_ + c];
  const float* high = low + columns_;
  return static_cast<double>((1.0F - v) * (low[0] + u * (low[1] - low[0])) + v * (high[0] + u * (high[1] - high[0])));
}

EdgeVariation::EdgeVariation(std::uint64_t seed) {
  Prng random(seed);
  for (std::size_t i = 0; i < kWaves; ++i) {
    per_mm_[i] = 2.0 * kPi / (30.0 + 170.0 * random.uniform());
    phase_[i] = 2.0 * kPi * random.uniform();
  }
}

double EdgeVariation::at(double t_mm) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < kWaves; ++i) sum += std::sin(per_mm_[i] * t_mm + phase_[i]);
  return std::clamp(0.45 * sum, -1.0, 1.0);
}

Vec3 PlaneSums::plane() const {
  if (n_ < 3.0) return Vec3::Zero();
  Mat3 normal;
  normal << n_, x_, y_, x_, xx_, xy_, y_, xy_, yy_;
  return normal.ldlt().solve(Vec3(h_, xh_, yh_));
}

}  // namespace slabd::simulate
