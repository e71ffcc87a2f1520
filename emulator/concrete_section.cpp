// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_section.h"

namespace slabd::simulate {

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

}  // namespace slabd::simulate
