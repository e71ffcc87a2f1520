// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

/// The section x = const of a block: shoulder, jaw, bearing plane, jaw, shoulder as straight lines z(y), with arcs of a
/// circle where two of them meet. Exact: a fillet of radius r is a circle that touches both lines.
namespace slabd::simulate {

/// The part of the block that a point of its surface belongs to. `edge`: a fillet or a chamfer.
enum class ConcreteFace : std::uint8_t {
  slab_top,
  end,
  side,
  shoulder_inner,
  shoulder_outer,
  jaw_inner,
  jaw_outer,
  seat,
  edge,
  rim_inner,
  rim_outer,
  cap,
  strap,
  beyond,  ///< beyond the end of the slab: nothing returns
};

struct SectionLine {
  double at_origin = 0.0;
  double per_mm = 0.0;
  [[nodiscard]] double z(double t) const { return at_origin + per_mm * t; }
};

/// An arc between two lines, from the point where it touches the left one to where it touches the right one. Radius 0:
/// both are the intersection.
struct SectionArc {
  double from = 0.0;
  double to = 0.0;
  double centre_t = 0.0;
  double centre_z = 0.0;
  double radius = 0.0;
  double side = -1.0;  ///< -1: the lower half of the circle (concave corner), +1: the upper (convex corner)

  /// `left` and `right` must not be parallel. Concave where the right one climbs more than the left.
  [[nodiscard]] static SectionArc between(const SectionLine& left, const SectionLine& right, double radius);
  [[nodiscard]] double z(double t) const {
    const double d = t - centre_t;
    return centre_z + side * std::sqrt(std::fmax(0.0, radius * radius - d * d));
  }
};

/// One section. Arcs from the inner shoulder outward: shoulder/jaw, jaw/seat, seat/jaw, jaw/shoulder.
struct Section {
  SectionLine shoulder_inner, jaw_inner, seat, jaw_outer, shoulder_outer;
  std::array<SectionArc, 4> arcs;

  /// Places the arcs.
  void round(const std::array<double, 4>& radius_mm);
  struct Point {
    double z = 0.0;
    ConcreteFace face = ConcreteFace::seat;
  };
  [[nodiscard]] Point at(double y) const;
};

}  // namespace slabd::simulate
