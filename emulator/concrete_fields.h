// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "base/base.h"

/// Random fields over a rectangle of a plane, each sampled once on a coarse raster and interpolated.
namespace slabd::simulate {

/// A rectangle centred on the origin and the raster that a field over it is kept on. mm.
struct FieldSize {
  double half_x_mm = 0.0;
  double half_y_mm = 0.0;
  double step_mm = 1.0;
};

/// Heights on a raster; bilinear between its nodes, constant beyond its edges.
class RasterField {
 public:
  RasterField() = default;
  RasterField(const FieldSize& size, std::vector<float> heights);

  /// Standard deviation 1, correlation exp(-(r / length)^2): sand grain, clumps, thickness of a crust.
  [[nodiscard]] static RasterField grain(const FieldSize& size, double length_mm, std::uint64_t seed);
  /// A sum of waves with wavelengths evenly spread over the range and directions over the circle; standard deviation 1.
  [[nodiscard]] static RasterField waves(const FieldSize& size, double shortest_mm, double longest_mm, int count,
                                         std::uint64_t seed);

  [[nodiscard]] bool empty() const { return heights_.empty(); }
  /// 0 if empty.
  [[nodiscard]] double at(double x_mm, double y_mm) const;
  [[nodiscard]] static std::size_t columns_of(const FieldSize& size);
  [[nodiscard]] static std::size_t rows_of(const FieldSize& size);

 private:
  FieldSize size_;
  std::size_t columns_ = 0;
  std::size_t rows_ = 0;
  double per_mm_ = 1.0;
  std::vector<float> heights_;
};

/// A smooth random function of one length, within -1..1: how an edge is worn along its course.
class EdgeVariation {
 public:
  explicit EdgeVariation(std::uint64_t seed);
  [[nodiscard]] double at(double t_mm) const;

 private:
  static constexpr std::size_t kWaves = 5;
  std::array<double, kWaves> per_mm_{};
  std::array<double, kWaves> phase_{};
};

/// Least-squares plane h = a + b x + c y of what is added.
class PlaneSums {
 public:
  void add(double x, double y, double h) {
    n_ += 1.0;
    x_ += x;
    y_ += y;
    h_ += h;
    xx_ += x * x;
    xy_ += x * y;
    yy_ += y * y;
    xh_ += x * h;
    yh_ += y * h;
  }
  /// a, b, c; zero with fewer than three points.
  [[nodiscard]] Vec3 plane() const;

 private:
  double n_ = 0.0, x_ = 0.0, y_ = 0.0, h_ = 0.0, xx_ = 0.0, xy_ = 0.0, yy_ = 0.0, xh_ = 0.0, yh_ = 0.0;
};

}  // namespace slabd::simulate
