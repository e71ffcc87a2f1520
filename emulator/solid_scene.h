// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "base/base.h"

/// Balls, posts and plates, and their first intersection with a ray. For scenes that are built in one frame and viewed
/// from another.
namespace slabd::emulator {

struct Ball {
  Vec3 centre_mm;
  double radius_mm;
};
/// The lateral surface of a cylinder; its ends are open.
struct Post {
  Vec3 from_mm;
  Vec3 to_mm;
  double radius_mm;
};
/// A rectangle without thickness: centre and half its sides.
struct Plate {
  Vec3 centre_mm;
  Vec3 half_a_mm;
  Vec3 half_b_mm;
};

struct Solids {
  std::vector<Ball> balls;
  std::vector<Post> posts;
  std::vector<Plate> plates;

  /// The same objects in another frame.
  [[nodiscard]] Solids in_frame(const Pose& T_frame_here) const;

  /// The first t > `beyond` at which from + t * along meets an object; infinity if there is none.
  [[nodiscard]] double first_met(const Vec3& from, const Vec3& along, double beyond) const;
};

/// Depths (z, mm) of all objects in a picture seen from the origin along +Z. Pixel (column, row) is the ray through
/// (x, y, distance_mm) with x, y evenly spaced over the field; NaN if the ray meets no object. Each object is drawn
/// only in the window that it can cover.
struct Picture {
  std::size_t columns = 0;
  std::size_t rows = 0;
  double field_x_mm = 350.0;
  double field_y_mm = 500.0;
  double distance_mm = 600.0;
  std::vector<float> depth_mm;  ///< row by row

  /// Direction of a pixel's ray, z = 1.
  [[nodiscard]] Vec3 ray(std::size_t column, std::size_t row) const {
    const double x = ((static_cast<double>(column) + 0.5) / static_cast<double>(columns) - 0.5) * field_x_mm;
    const double y = ((static_cast<double>(row) + 0.5) / static_cast<double>(rows) - 0.5) * field_y_mm;
    return {x / distance_mm, y / distance_mm, 1.0};
  }
  void clear(std::size_t wide, std::size_t high);
  /// Draws over objects that are further away.
  void draw(const Solids& solids_scanner);
};

}  // namespace slabd::emulator
