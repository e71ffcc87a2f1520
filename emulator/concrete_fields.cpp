// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_fields.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "emulator/scan_drawing.h"

namespace slabd::emulator {

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
    // cos(a + b) from tables of one row and one column, without a cosine per node.
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

namespace {

constexpr std::size_t kTileNodes = 16;
/// Height by which a surface point is lifted for the visibility test, so that it does not hide itself.
constexpr double kLift_mm = 0.02;
/// Rays steeper than this count as this slanted when a step is chosen.
constexpr double kSlantMin = 1e-4;
constexpr double kOnSurface_mm = 1e-6;
constexpr int kSecantsMax = 40;

}  // namespace

HeightField::HeightField(double half_x_mm, double half_y_mm, double step_mm)
    : half_x_mm_(half_x_mm),
      half_y_mm_(half_y_mm),
      step_mm_(step_mm),
      per_mm_(1.0 / step_mm),
      columns_(static_cast<std::size_t>(std::ceil(2.0 * half_x_mm / step_mm)) + 1),
      rows_(static_cast<std::size_t>(std::ceil(2.0 * half_y_mm / step_mm)) + 1),
      z_(columns_ * rows_, 0.0F) {}

HeightField::Window HeightField::window(double x_from, double x_to, double y_from, double y_to) const {
  const auto first = [&](double from, double half, std::size_t count) {
    return static_cast<std::size_t>(std::clamp(std::ceil((from + half) * per_mm_), 0.0, static_cast<double>(count)));
  };
  const auto last = [&](double to, double half, std::size_t count) {
    return static_cast<std::size_t>(
        std::clamp(std::floor((to + half) * per_mm_) + 1.0, 0.0, static_cast<double>(count)));
  };
  return {first(x_from, half_x_mm_, columns_), last(x_to, half_x_mm_, columns_), first(y_from, half_y_mm_, rows_),
          last(y_to, half_y_mm_, rows_)};
}

std::size_t HeightField::nearest(double x_mm, double y_mm) const {
  const double column = std::clamp((x_mm + half_x_mm_) * per_mm_ + 0.5, 0.0, static_cast<double>(columns_ - 1));
  const double row = std::clamp((y_mm + half_y_mm_) * per_mm_ + 0.5, 0.0, static_cast<double>(rows_ - 1));
  return index(static_cast<std::size_t>(column), static_cast<std::size_t>(row));
}

HeightField::Sample HeightField::sample(double x_mm, double y_mm) const {
  const double column = std::clamp((x_mm + half_x_mm_) * per_mm_, 0.0, static_cast<double>(columns_ - 1) - 1e-9);
  const double row = std::clamp((y_mm + half_y_mm_) * per_mm_, 0.0, static_cast<double>(rows_ - 1) - 1e-9);
  const auto c = static_cast<std::size_t>(column);
  const auto r = static_cast<std::size_t>(row);
  Sample found{0.0, index(c, r), column - static_cast<double>(c), row - static_cast<double>(r)};
  const float* low = &z_[found.at];
  const float* high = low + columns_;
  const double a = static_cast<double>(low[0]) + found.u * static_cast<double>(low[1] - low[0]);
  const double b = static_cast<double>(high[0]) + found.u * static_cast<double>(high[1] - high[0]);
  found.z = a + found.v * (b - a);
  return found;
}

HeightField::Slope HeightField::slope(double x_mm, double y_mm) const {
  const Sample s = sample(x_mm, y_mm);
  const auto z = [&](std::size_t further) { return static_cast<double>(z_[s.at + further]); };
  return {((1.0 - s.v) * (z(1) - z(0)) + s.v * (z(columns_ + 1) - z(columns_))) * per_mm_,
          ((1.0 - s.u) * (z(columns_) - z(0)) + s.u * (z(columns_ + 1) - z(1))) * per_mm_};
}

void HeightField::finish() {
  tile_columns_ = (columns_ + kTileNodes - 1) / kTileNodes;
  tile_rows_ = (rows_ + kTileNodes - 1) / kTileNodes;
  std::vector<float> own(tile_columns_ * tile_rows_, -1e9F);
  const auto [low, high] = std::minmax_element(z_.begin(), z_.end());
  lowest_mm_ = static_cast<double>(*low);
  highest_mm_ = static_cast<double>(*high);
  for (std::size_t row = 0; row < rows_; ++row) {
    float* tiles = &own[row / kTileNodes * tile_columns_];
    for (std::size_t column = 0; column < columns_; ++column)
      tiles[column / kTileNodes] = std::max(tiles[column / kTileNodes], z_[index(column, row)]);
  }
  highest_.assign(own.size(), -1e9F);
  for (std::size_t row = 0; row < tile_rows_; ++row)
    for (std::size_t column = 0; column < tile_columns_; ++column)
      for (std::size_t r = row == 0 ? 0 : row - 1; r < std::min(row + 2, tile_rows_); ++r)
        for (std::size_t c = column == 0 ? 0 : column - 1; c < std::min(column + 2, tile_columns_); ++c) {
          float& highest = highest_[row * tile_columns_ + column];
          highest = std::max(highest, own[r * tile_columns_ + c]);
        }
}

double HeightField::highest_near(double x_mm, double y_mm) const {
  const double column = std::clamp((x_mm + half_x_mm_) * per_mm_ + 0.5, 0.0, static_cast<double>(columns_ - 1));
  const double row = std::clamp((y_mm + half_y_mm_) * per_mm_ + 0.5, 0.0, static_cast<double>(rows_ - 1));
  return static_cast<double>(highest_[static_cast<std::size_t>(row) / kTileNodes * tile_columns_ +
                                      static_cast<std::size_t>(column) / kTileNodes]);
}

double HeightField::first_met(const Vec3& from, const Vec3& along) const {
  const double down = -along.z();
  if (!(down > 0.0)) return kNoValue;
  const double aside = std::max(std::hypot(along.x(), along.y()), kSlantMin * down);
  // A step of at least one tile sideways before the tile map is read again; half a node less for the rounding to a
  // node.
  const double tile_t = (static_cast<double>(kTileNodes) - 1.0) * step_mm_ / aside;
  const double node_t = step_mm_ / aside;
  const double last_t = (from.z() - lowest_mm_ + 1.0) / down;
  double t = std::max(0.0, (from.z() - highest_mm_ - kLift_mm) / down);
  double above_t = t;
  double above = from.z() - down * t - height_mm(from.x() + along.x() * t, from.y() + along.y() * t);
  if (above < 0.0) return kNoValue;
  double below_t = t;
  double below = above;
  while (true) {
    const double z = from.z() - down * t;
    const double highest = highest_near(from.x() + along.x() * t, from.y() + along.y() * t);
    const double free_t = (z - highest) / down;
    t += free_t > 1e-3 / down ? std::min(free_t, tile_t) : node_t;
    if (t > last_t) t = last_t;
    const double gap = from.z() - down * t - height_mm(from.x() + along.x() * t, from.y() + along.y() * t);
    if (gap <= 0.0) {
      below_t = t;
      below = gap;
      break;
    }
    above_t = t;
    above = gap;
    if (t >= last_t) return kNoValue;
  }
  // Regula falsi with the Illinois rule: the value of a retained end is halved.
  int kept = 0;
  for (int i = 0; i < kSecantsMax; ++i) {
    t = above_t + (below_t - above_t) * above / (above - below);
    const double gap = from.z() - down * t - height_mm(from.x() + along.x() * t, from.y() + along.y() * t);
    if (std::abs(gap) < kOnSurface_mm || below_t - above_t < kOnSurface_mm) break;
    if (gap > 0.0) {
      above_t = t;
      above = gap;
      if (kept == 1) below *= 0.5;
      kept = 1;
    } else {
      below_t = t;
      below = gap;
      if (kept == -1) above *= 0.5;
      kept = -1;
    }
  }
  return t;
}

bool HeightField::sees(const Vec3& eye, const Vec3& point) const {
  const Vec3 along = eye - point;
  const double up = along.z();
  if (!(up > 0.0)) return false;
  const double aside = std::max(std::hypot(along.x(), along.y()), kSlantMin * up);
  const double tile_t = (static_cast<double>(kTileNodes) - 1.0) * step_mm_ / aside;
  const double node_t = step_mm_ / aside;
  const double free_t = (highest_mm_ - point.z()) / up;
  double t = 0.0;
  while (t < free_t) {
    const double x = point.x() + along.x() * t;
    const double y = point.y() + along.y() * t;
    const double z = point.z() + up * t + kLift_mm;
    if (z >= highest_near(x, y)) {
      t += tile_t;
      continue;
    }
    if (z < height_mm(x, y)) return false;
    t += node_t;
  }
  return true;
}

}  // namespace slabd::emulator
