// SPDX-License-Identifier: Apache-2.0
//
// The design model (paper 2.2) as twelve planes instead of a mesh: a point's distance to the model is one dot product,
// exact, and every feature to be measured is one of the planes. Section x = const, outward to the right:
//
//                    ____ shoulder inner           shoulder outer ____
//                   /    \                                       /    |
//        side inner/      \ jaw inner                 jaw outer /     \ side outer
//                 /        \_____ rim ____ seat ____ rim ______/       |
//   _____ top ___/                                                     \___ top ____
#include "algo/block_model.h"

#include <algorithm>
#include <cmath>

namespace slabd::algo {
namespace {

Plane through(const Vec3& normal, const Vec3& p) {
  const Vec3 n = normal.normalized();
  return {n, n.dot(p)};
}

/// OR over a window of +-reach cells along one axis of the table.
void spread(std::span<const std::uint16_t> from, std::span<std::uint16_t> to, int reach, bool along_x) {
  constexpr int width = static_cast<int>(limits::kFaceTableX);
  constexpr int height = static_cast<int>(limits::kFaceTableY);
  const int length = along_x ? width : height;
  const std::size_t stride = along_x ? 1 : limits::kFaceTableX;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int here = along_x ? x : y;
      const std::size_t cell = static_cast<std::size_t>(y) * limits::kFaceTableX + static_cast<std::size_t>(x);
      std::uint16_t seen = 0;
      const int first = std::max(here - reach, 0);
      const int last = std::min(here + reach, length - 1);
      const std::uint16_t* p = from.data() + cell - static_cast<std::size_t>(here - first) * stride;
      for (int i = first; i <= last; ++i, p += stride) seen = static_cast<std::uint16_t>(seen | *p);
      to[cell] = seen;
    }
  }
}

}  // namespace

std::string_view name(Face face) {
  constexpr std::array<std::string_view, kFaces> kNames = {
      "seat",        "inner jaw",  "outer jaw",  "inner shoulder", "outer shoulder", "end face -x",
      "end face +x", "inner side", "outer side", "slab top",       "inner rim",      "outer rim"};
  return kNames[static_cast<std::size_t>(face)];
}

void BlockModel::build(const BlockGeometry& geometry) {
  geometry_ = geometry;
  const auto set = [&](Face face, const Vec3& normal, const Vec3& p) {
    planes_[static_cast<std::size_t>(face)] = through(normal, p);
  };
  const double cant = std::atan(1.0 / geometry.cant_ratio.value);
  const Vec3 n_seat(0.0, -std::sin(cant), std::cos(cant));
  along_seat_ = Vec3(0.0, std::cos(cant), std::sin(cant));
  set(Face::seat, n_seat, Vec3::Zero());

  // A jaw rises outward at the jaw angle to the seat. Its free side is inward and up.
  const double angle = geometry.jaw_angle_rad.value;
  for (const double side : {-1.0, 1.0}) {
    const Vec3 outward = side * along_seat_;
    const Vec3 foot = geometry.jaw_half_distance_mm.value * outward + geometry.jaw_reference_height_mm.value * n_seat;
    set(side > 0.0 ? Face::jaw_outer : Face::jaw_inner, -std::sin(angle) * outward - std::cos(angle) * n_seat, foot);
  }

  set(Face::shoulder_inner, Vec3::UnitZ(), Vec3(0.0, 0.0, geometry.shoulder_inner_z_mm.value));
  set(Face::shoulder_outer, Vec3::UnitZ(), Vec3(0.0, 0.0, geometry.shoulder_outer_z_mm.value));
  const double c = std::cos(geometry.draft_rad.value);
  const double s = std::sin(geometry.draft_rad.value);
  const double end = geometry.end_half_length_mm.value;
  const double width = geometry.side_half_width_mm.value;
  set(Face::end_minus, Vec3(-c, 0.0, s), Vec3(-end, 0.0, 0.0));
  set(Face::end_plus, Vec3(c, 0.0, s), Vec3(end, 0.0, 0.0));
  set(Face::side_inner, Vec3(0.0, -c, s), Vec3(0.0, -width, 0.0));
  set(Face::side_outer, Vec3(0.0, c, s), Vec3(0.0, width, 0.0));
  set(Face::top, Vec3::UnitZ(), Vec3(0.0, 0.0, geometry.slab_top_z_mm.value));
  const Vec3 rim = geometry.casing_rim_height_mm.value * n_seat;
  set(Face::rim_inner, n_seat, rim);
  set(Face::rim_outer, n_seat, rim);
}

Vec3 BlockModel::casing_centre(bool outer) const {
  return (outer ? 1.0 : -1.0) * geometry_.casing_half_spacing_mm.value * along_seat_;
}

bool BlockModel::visible(double x, double y, Face& face, double& z) const {
  const auto height = [&](Face f) { return plane(f).z_at(x, y); };
  const auto lower = [&](Face f, double value) {
    if (value < z) {
      z = value;
      face = f;
    }
  };
  const auto higher = [&](Face f, double value) {
    if (value > z) {
      z = value;
      face = f;
    }
  };
  const bool outer = y > 0.0;
  face = Face::seat;
  z = height(Face::seat);
  higher(Face::jaw_inner, height(Face::jaw_inner));
  higher(Face::jaw_outer, height(Face::jaw_outer));

  if (face == Face::seat) {
    const Vec3 p(x, y, z);
    const double along = along_seat_.dot(p - casing_centre(outer));
    const double bore_mm = 0.5 * geometry_.casing_bore_diameter_mm.value;
    const double rim_mm = 0.5 * geometry_.casing_rim_diameter_mm.value;
    // The root is taken near the casing only.
    const double reach_mm = std::max(bore_mm, rim_mm);
    if (x * x + along * along < 1.001 * reach_mm * reach_mm) {
      const double radius = std::hypot(x, along);
      if (radius < bore_mm) return false;
      if (radius < rim_mm) {
        face = outer ? Face::rim_outer : Face::rim_inner;
        z = height(face);
      }
    }
  }
  const Face shoulder = outer ? Face::shoulder_outer : Face::shoulder_inner;
  lower(shoulder, height(shoulder));
  // End and side faces are nearly vertical: above the slab they only limit the extent of the block.
  for (const Face f : {Face::end_minus, Face::end_plus, Face::side_inner, Face::side_outer}) lower(f, height(f));
  higher(Face::top, height(Face::top));
  return true;
}

void FaceTable::build(const BlockModel& model, std::span<std::uint16_t> wide, std::span<std::uint16_t> near,
                      std::span<std::uint16_t> scratch) {
  // Nine samples per cell: a cell that contains an edge shows both faces.
  for (std::size_t row = 0; row < limits::kFaceTableY; ++row) {
    for (std::size_t column = 0; column < limits::kFaceTableX; ++column) {
      std::uint16_t seen = 0;
      for (int k = 0; k < 9; ++k) {
        const double x = static_cast<double>(column) - kHalfX + 0.5 * static_cast<double>(k % 3);
        const double y = static_cast<double>(row) - kHalfY + 0.5 * static_cast<double>(k / 3);
        Face face = Face::seat;
        double z = 0.0;
        if (model.visible(x, y, face, z)) seen = static_cast<std::uint16_t>(seen | bit(face));
      }
      wide[row * limits::kFaceTableX + column] = seen;
    }
  }
  spread(wide, scratch, kNear_mm, true);
  spread(scratch, near, kNear_mm, false);
  spread(near, scratch, kWide_mm - kNear_mm, true);
  spread(scratch, wide, kWide_mm - kNear_mm, false);
  wide_ = wide;
  near_ = near;
}

}  // namespace slabd::algo
