// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_block.h"

#include <algorithm>
#include <cmath>

#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr double kFoot_mm = 6.0;
/// Area where the block hides its own foot, or where the slab top could count as a fillet.
constexpr double kTopClearX = 112.0;
constexpr double kTopClearY = 247.0;

double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}

}  // namespace

BlockTruth scattered_truth(const Recipe& recipe, const BlockTruth& basis, double strength, std::uint64_t seed) {
  Prng random(derived_seed(seed, 300, 0));
  BlockTruth truth = basis;
  const auto half_of = [&](ItemId id) {
    const Tolerance& t = recipe.tolerance(id);
    return within(random, 0.25 * strength * (t.upper - t.lower));
  };
  truth.slope_rad += rad_from_deg(half_of(ItemId::seat_slope));
  truth.jaw_angle_inner_rad += rad_from_deg(half_of(ItemId::jaw_angle_inner));
  truth.jaw_angle_outer_rad += rad_from_deg(half_of(ItemId::jaw_angle_outer));
  truth.jaw_distance_mm += half_of(ItemId::jaw_distance);
  truth.casing_spacing_mm += half_of(ItemId::casing_spacing);
  truth.protrusion_inner_mm += half_of(ItemId::casing_protrusion_inner);
  truth.protrusion_outer_mm += half_of(ItemId::casing_protrusion_outer);
  return truth;
}

double ConcreteTruth::value(ItemId id) const {
  switch (id) {
    case ItemId::seat_slope: return deg_from_rad(block.slope_rad);
    case ItemId::seat_flatness: return flatness_form_mm;
    case ItemId::jaw_angle_inner: return deg_from_rad(block.jaw_angle_inner_rad);
    case ItemId::jaw_angle_outer: return deg_from_rad(block.jaw_angle_outer_rad);
    case ItemId::jaw_distance: return block.jaw_distance_mm;
    case ItemId::casing_spacing: return casing_spacing_mm;
    case ItemId::casing_protrusion_inner: return block.protrusion_inner_mm;
    case ItemId::casing_protrusion_outer: return block.protrusion_outer_mm;
    default: return kNoValue;
  }
}

ConcreteBlock::ConcreteBlock(const Recipe& recipe, const ConcreteOrder& order)
    : recipe_(recipe), order_(order), field_(kHalfX_mm, kHalfY_mm, order.node_mm) {
  face_.assign(field_.columns() * field_.rows(), ConcreteFace::slab_top);
  gloss_.assign(face_.size(), 0);
  truth_.block = with_defects(order.truth, order.defects);
}

std::uint64_t ConcreteBlock::seed_of(Effect effect, std::uint64_t which) const {
  return derived_seed(order_.seed, 400 + static_cast<std::uint64_t>(effect), which);
}

double ConcreteBlock::seat_z(double x, double y) const {
  return seat_per_x_ * x + seat_per_y_ * y;
}

double ConcreteBlock::along_seat(double x, double y) const {
  const double slope = truth_.block.slope_rad;
  return y * std::cos(slope) + seat_z(x, y) * std::sin(slope);
}

ConcreteBlock ConcreteBlock::cast(const Recipe& recipe, const ConcreteOrder& order) {
  ConcreteBlock block(recipe, order);
  block.cast_faces();
  if (block.truth_.block.present) {
    block.put_defects();
    block.set_rims();
    block.put_form();
    const Flatness form = block.flatness();
    block.truth_.flatness_form_mm = form.high - form.low;
    block.put_damage();
    block.put_marks();
    const Flatness raw = block.flatness();
    block.truth_.flatness_raw_mm = raw.high - raw.low;
    block.truth_.raw_low_mm = raw.low;
    block.truth_.raw_high_mm = raw.high;
  }
  block.field_.finish();
  return block;
}

void ConcreteBlock::level_top(const std::function<bool(double, double)>& seen) {
  if (strength(Effect::relief) == 0.0) return;
  constexpr double kStep = 2.0;
  PlaneSums sums;
  for (double y = -kHalfY_mm; y <= kHalfY_mm; y += kStep)
    for (double x = -kHalfX_mm; x <= kHalfX_mm; x += kStep) {
      if (std::abs(x) <= kTopClearX && std::abs(y) <= kTopClearY) continue;
      if (face_[field_.nearest(x, y)] == ConcreteFace::slab_top && seen(x, y)) sums.add(x, y, relief_.at(x, y));
    }
  const Vec3 plane = kRelief_mm * strength(Effect::relief) * sums.plane();
  for (std::size_t row = 0; row < field_.rows(); ++row)
    for (std::size_t column = 0; column < field_.columns(); ++column) {
      const std::size_t node = field_.index(column, row);
      // The fillet at the foot follows the slab top's relief.
      const bool at_foot =
          face_[node] == ConcreteFace::edge && field_.z(node) < static_cast<float>(top_z_mm_ + kFoot_mm);
      if (face_[node] == ConcreteFace::slab_top || at_foot)
        field_.z(node) -= static_cast<float>(plane.dot(Vec3(1.0, field_.x_mm(column), field_.y_mm(row))));
    }
  field_.finish();
}

ConcreteBlock::Flatness ConcreteBlock::flatness() const {
  const EvaluationSettings& e = recipe_.evaluation;
  const double slope = truth_.block.slope_rad;
  const auto columns = static_cast<std::size_t>(std::lround(2.0 * e.crop_half_x_mm / e.cell_mm));
  const auto rows = static_cast<std::size_t>(std::lround(2.0 * e.crop_half_s_mm / e.cell_mm));
  std::vector<double> sum(columns * rows, 0.0);
  std::vector<double> count(columns * rows, 0.0);
  const HeightField::Window w = field_.window(0.0, 0.0, e.crop_half_s_mm + 1.0);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const double x = field_.x_mm(column);
      const double y = field_.y_mm(row);
      const double cell_x = (x + e.crop_half_x_mm) / e.cell_mm;
      const double cell_s = (along_seat(x, y) + e.crop_half_s_mm) / e.cell_mm;
      if (cell_x < 0.0 || cell_s < 0.0) continue;
      const auto c = static_cast<std::size_t>(cell_x);
      const auto r = static_cast<std::size_t>(cell_s);
      if (c >= columns || r >= rows) continue;
      const double off = static_cast<double>(field_.z(field_.index(column, row))) - seat_z(x, y);
      sum[r * columns + c] += off * std::cos(slope);
      count[r * columns + c] += 1.0;
    }
  PlaneSums sums;
  const auto each = [&](const auto& visit) {
    for (std::size_t r = 0; r < rows; ++r)
      for (std::size_t c = 0; c < columns; ++c)
        if (count[r * columns + c] > 0.0)
          visit((static_cast<double>(c) + 0.5) * e.cell_mm - e.crop_half_x_mm,
                (static_cast<double>(r) + 0.5) * e.cell_mm - e.crop_half_s_mm,
                sum[r * columns + c] / count[r * columns + c]);
  };
  each([&](double x, double s, double h) { sums.add(x, s, h); });
  const Vec3 plane = sums.plane();
  Flatness flat{1e9, -1e9};
  each([&](double x, double s, double h) {
    const double off = h - plane.dot(Vec3(1.0, x, s));
    flat.low = std::min(flat.low, off);
    flat.high = std::max(flat.high, off);
  });
  return flat;
}

SectionArc SectionArc::between(const SectionLine& left, const SectionLine& right, double radius) {
  SectionArc arc;
  arc.radius = radius;
  arc.side = right.per_mm > left.per_mm ? -1.0 : 1.0;
  const double up = -arc.side;  // the centre is above a concave corner and below a convex one
  const double left_slant = std::hypot(1.0, left.per_mm);
  const double right_slant = std::hypot(1.0, right.per_mm);
  // The centre has the distance `radius` from both lines.
  const double left_origin = left.at_origin + up * radius * left_slant;
  const double right_origin = right.at_origin + up * radius * right_slant;
  arc.centre_t = (left_origin - right_origin) / (right.per_mm - left.per_mm);
  arc.centre_z = left_origin + left.per_mm * arc.centre_t;
  arc.from = arc.centre_t + up * radius * left.per_mm / left_slant;
  arc.to = arc.centre_t + up * radius * right.per_mm / right_slant;
  return arc;
}

void Section::round(const std::array<double, 4>& radius_mm) {
  arcs[0] = SectionArc::between(shoulder_inner, jaw_inner, radius_mm[0]);
  arcs[1] = SectionArc::between(jaw_inner, seat, radius_mm[1]);
  arcs[2] = SectionArc::between(seat, jaw_outer, radius_mm[2]);
  arcs[3] = SectionArc::between(jaw_outer, shoulder_outer, radius_mm[3]);
}

Section::Point Section::at(double y) const {
  if (y >= arcs[1].to && y <= arcs[2].from) return {seat.z(y), ConcreteFace::seat};
  const bool outer = y > arcs[2].from;
  const SectionArc& foot = outer ? arcs[2] : arcs[1];
  const SectionArc& brow = outer ? arcs[3] : arcs[0];
  if (y > foot.from && y < foot.to) return {foot.z(y), ConcreteFace::edge};
  if (y > brow.from && y < brow.to) return {brow.z(y), ConcreteFace::edge};
  if (outer)
    return y < brow.from ? Point{jaw_outer.z(y), ConcreteFace::jaw_outer}
                         : Point{shoulder_outer.z(y), ConcreteFace::shoulder_outer};
  return y > brow.to ? Point{jaw_inner.z(y), ConcreteFace::jaw_inner}
                     : Point{shoulder_inner.z(y), ConcreteFace::shoulder_inner};
}

}  // namespace slabd::emulator
