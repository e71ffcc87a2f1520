// SPDX-License-Identifier: Apache-2.0
#include "emulator/solid_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace slabd::emulator {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

/// First root beyond `beyond` of |f + t a| = radius.
double meet_round(const Vec3& f, const Vec3& a, double radius, double beyond) {
  const double aa = a.squaredNorm();
  const double half_b = f.dot(a);
  const double discriminant = half_b * half_b - aa * (f.squaredNorm() - radius * radius);
  if (!(discriminant > 0.0) || aa == 0.0) return kNever;
  const double t = (-half_b - std::sqrt(discriminant)) / aa;
  return t > beyond ? t : kNever;
}

double meet(const Ball& ball, const Vec3& from, const Vec3& along, double beyond) {
  return meet_round(from - ball.centre_mm, along, ball.radius_mm, beyond);
}

double meet(const Post& post, const Vec3& from, const Vec3& along, double beyond) {
  const Vec3 axis = post.to_mm - post.from_mm;
  const double length2 = axis.squaredNorm();
  const Vec3 f = from - post.from_mm;
  const double t =
      meet_round(f - f.dot(axis) / length2 * axis, along - along.dot(axis) / length2 * axis, post.radius_mm, beyond);
  if (t == kNever) return kNever;
  const double share = (f + t * along).dot(axis) / length2;
  return share >= 0.0 && share <= 1.0 ? t : kNever;
}

double meet(const Plate& plate, const Vec3& from, const Vec3& along, double beyond) {
  const Vec3 normal = plate.half_a_mm.cross(plate.half_b_mm);
  const double slant = normal.dot(along);
  if (slant == 0.0) return kNever;
  const double t = normal.dot(plate.centre_mm - from) / slant;
  if (!(t > beyond)) return kNever;
  const Vec3 p = from + t * along - plate.centre_mm;
  const bool inside = std::abs(p.dot(plate.half_a_mm)) <= plate.half_a_mm.squaredNorm() &&
                      std::abs(p.dot(plate.half_b_mm)) <= plate.half_b_mm.squaredNorm();
  return inside ? t : kNever;
}

/// Part of the picture that a few balls around an object can cover.
struct Window {
  std::size_t column_first = 0, column_end = 0, row_first = 0, row_end = 0;
};
Window window_of(const Picture& picture, const std::vector<Ball>& around) {
  double low_x = kNever;
  double low_y = kNever;
  double high_x = -kNever;
  double high_y = -kNever;
  for (const Ball& ball : around) {
    const double nearest = ball.centre_mm.z() - ball.radius_mm;
    if (nearest < 1.0) return {0, picture.columns, 0, picture.rows};  // next to or behind the scanner: all of it
    // Larger than the ball's outline from any side: its radius at its nearest depth, and the slant of its centre.
    const double scale = picture.distance_mm / ball.centre_mm.z();
    const Vec3 middle = ball.centre_mm * scale;
    const double slant = ball.centre_mm.norm() / ball.centre_mm.z();
    const double reach = 1.05 * slant * slant * picture.distance_mm * ball.radius_mm / nearest;
    low_x = std::min(low_x, middle.x() - reach);
    low_y = std::min(low_y, middle.y() - reach);
    high_x = std::max(high_x, middle.x() + reach);
    high_y = std::max(high_y, middle.y() + reach);
  }
  const auto index = [](double at_mm, double field_mm, std::size_t count) {
    const double place = (at_mm / field_mm + 0.5) * static_cast<double>(count);
    return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(count)));
  };
  return {index(low_x, picture.field_x_mm, picture.columns),
          std::min(picture.columns, index(high_x, picture.field_x_mm, picture.columns) + 1),
          index(low_y, picture.field_y_mm, picture.rows),
          std::min(picture.rows, index(high_y, picture.field_y_mm, picture.rows) + 1)};
}

template <typename Thing>
void draw_thing(Picture& picture, const Thing& thing, const std::vector<Ball>& around) {
  const Window window = window_of(picture, around);
  for (std::size_t row = window.row_first; row < window.row_end; ++row)
    for (std::size_t column = window.column_first; column < window.column_end; ++column) {
      const double t = meet(thing, Vec3::Zero(), picture.ray(column, row), 0.0);
      float& depth = picture.depth_mm[row * picture.columns + column];
      if (t < kNever && !(depth <= static_cast<float>(t))) depth = static_cast<float>(t);
    }
}

}  // namespace

Solids Solids::in_frame(const Pose& T_frame_here) const {
  Solids moved = *this;
  for (Ball& ball : moved.balls) ball.centre_mm = T_frame_here * ball.centre_mm;
  for (Post& post : moved.posts) {
    post.from_mm = T_frame_here * post.from_mm;
    post.to_mm = T_frame_here * post.to_mm;
  }
  for (Plate& plate : moved.plates) {
    plate.centre_mm = T_frame_here * plate.centre_mm;
    plate.half_a_mm = T_frame_here.rotation * plate.half_a_mm;
    plate.half_b_mm = T_frame_here.rotation * plate.half_b_mm;
  }
  return moved;
}

double Solids::first_met(const Vec3& from, const Vec3& along, double beyond) const {
  double first = kNever;
  for (const Ball& ball : balls) first = std::min(first, meet(ball, from, along, beyond));
  for (const Post& post : posts) first = std::min(first, meet(post, from, along, beyond));
  for (const Plate& plate : plates) first = std::min(first, meet(plate, from, along, beyond));
  return first;
}

void Picture::clear(std::size_t wide, std::size_t high) {
  columns = wide;
  rows = high;
  depth_mm.assign(wide * high, std::numeric_limits<float>::quiet_NaN());
}

void Picture::draw(const Solids& solids) {
  for (const Plate& plate : solids.plates)
    draw_thing(*this, plate, {{plate.centre_mm, plate.half_a_mm.norm() + plate.half_b_mm.norm()}});
  for (const Post& post : solids.posts)
    draw_thing(*this, post, {{post.from_mm, post.radius_mm}, {post.to_mm, post.radius_mm}});
  for (const Ball& ball : solids.balls) draw_thing(*this, ball, {ball});
}

}  // namespace slabd::emulator
