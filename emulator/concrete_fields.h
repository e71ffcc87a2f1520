// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "base/base.h"

/// Random fields over a rectangle of a plane, sampled once on a coarse raster and interpolated.
namespace slabd::emulator {

/// A rectangle centred on the origin and the raster of a field over it. mm.
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

/// A smooth random function of one length, within -1..1: the wear along an edge.
class EdgeVariation {
 public:
  explicit EdgeVariation(std::uint64_t seed);
  [[nodiscard]] double at(double t_mm) const;

 private:
  static constexpr std::size_t kWaves = 5;
  std::array<double, kWaves> per_mm_{};
  std::array<double, kWaves> phase_{};
};

/// Least-squares plane h = a + b x + c y of the added points.
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
  /// a, b, c; zero if there are fewer than three points.
  [[nodiscard]] Vec3 plane() const;

 private:
  double n_ = 0.0, x_ = 0.0, y_ = 0.0, h_ = 0.0, xx_ = 0.0, xy_ = 0.0, yy_ = 0.0, xh_ = 0.0, yh_ = 0.0;
};

// A surface z(x, y) sampled on a square raster, and its intersections with rays.
//
// A ray from above first passes tiles whose highest point is below it, several millimetres a step. Then it passes the
// nodes one by one until it is below the surface; a secant finds the point in that step. Walls steeper than the raster
// are one raster step wide.

class HeightField {
 public:
  /// All heights 0. Half sizes about the origin, mm.
  HeightField(double half_x_mm, double half_y_mm, double step_mm);

  [[nodiscard]] std::size_t columns() const { return columns_; }
  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] double step_mm() const { return step_mm_; }
  [[nodiscard]] double x_mm(std::size_t column) const { return static_cast<double>(column) * step_mm_ - half_x_mm_; }
  [[nodiscard]] double y_mm(std::size_t row) const { return static_cast<double>(row) * step_mm_ - half_y_mm_; }
  [[nodiscard]] std::size_t index(std::size_t column, std::size_t row) const { return row * columns_ + column; }
  [[nodiscard]] float& z(std::size_t index) { return z_[index]; }
  [[nodiscard]] float z(std::size_t index) const { return z_[index]; }

  /// The nodes within `half_mm` of (x, y) along both axes: first and one past the last.
  struct Window {
    std::size_t column_from = 0, column_to = 0, row_from = 0, row_to = 0;
  };
  [[nodiscard]] Window window(double x_mm, double y_mm, double half_mm) const {
    return window(x_mm - half_mm, x_mm + half_mm, y_mm - half_mm, y_mm + half_mm);
  }
  [[nodiscard]] Window window(double x_from_mm, double x_to_mm, double y_from_mm, double y_to_mm) const;
  /// Index of the node nearest to (x, y); beyond the edge that of the edge.
  [[nodiscard]] std::size_t nearest(double x_mm, double y_mm) const;

  /// Bilinear height; beyond the edge the height of the edge.
  [[nodiscard]] double height_mm(double x_mm, double y_mm) const { return sample(x_mm, y_mm).z; }
  /// dz/dx and dz/dy of the cell at (x, y).
  struct Slope {
    double per_x = 0.0;
    double per_y = 0.0;
  };
  [[nodiscard]] Slope slope(double x_mm, double y_mm) const;

  /// Finds the tiles' highest points. Call it after the last change of a height.
  void finish();

  /// Smallest t >= 0 at which from + t * along is on the surface; NaN if the ray does not descend or starts below it.
  [[nodiscard]] double first_met(const Vec3& from, const Vec3& along) const;
  /// True if the surface does not intersect the line between `point` (on it) and `eye` (above everything).
  [[nodiscard]] bool sees(const Vec3& eye, const Vec3& point) const;

 private:
  struct Sample {
    double z = 0.0;
    std::size_t at = 0;  ///< index of the cell's first node
    double u = 0.0;      ///< place in the cell, 0..1
    double v = 0.0;
  };
  [[nodiscard]] Sample sample(double x_mm, double y_mm) const;
  /// Highest point within at least one tile of (x, y).
  [[nodiscard]] double highest_near(double x_mm, double y_mm) const;

  double half_x_mm_;
  double half_y_mm_;
  double step_mm_;
  double per_mm_;
  std::size_t columns_;
  std::size_t rows_;
  std::vector<float> z_;
  std::size_t tile_columns_ = 0;
  std::size_t tile_rows_ = 0;
  std::vector<float> highest_;  ///< of each tile with its eight neighbours
  double highest_mm_ = 0.0;     ///< of the whole surface
  double lowest_mm_ = 0.0;
};

}  // namespace slabd::emulator
