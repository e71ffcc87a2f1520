// SPDX-License-Identifier: Apache-2.0
#include "algo/survey/surface_raster.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace slabd::algo {
namespace {

/// Margin around a casing's rim: mortar, caps and their shadows.
constexpr double kCasingRim_mm = 6.0;

}  // namespace

void SurfaceTable::build(const BlockModel& model, std::span<std::uint16_t> cells) {
  using namespace surface_cell;
  assert(cells.size() >= kSurfaceCells);
  cells_ = cells.first(kSurfaceCells);
  const BlockGeometry& geometry = model.geometry();
  rows_ = {kSurfaceRows, 0};
  columns_ = {kSurfaceColumns, 0};
  double z_before = 0.0;
  for (std::size_t row = 0; row < kSurfaceRows; ++row) {
    const double y = surface_y_mm(row);
    const auto height = [&](Face face) { return model.plane(face).z_at(0.0, y); };
    const bool outer = y > 0.0;
    const double z = std::min(height(outer ? Face::shoulder_outer : Face::shoulder_inner),
                              std::max(height(Face::seat), height(outer ? Face::jaw_outer : Face::jaw_inner)));
    across_mm_[row] = row == 0 ? 0.0 : across_mm_[row - 1] + std::hypot(kSurfaceCell_mm, z - z_before);
    z_before = z;
    const Plane& end = model.plane(Face::end_plus);
    end_mm_[row] = (end.d - end.n.y() * y - end.n.z() * z) / end.n.x();
  }
  for (const bool outer : {false, true}) {
    const Plane& side = model.plane(outer ? Face::side_outer : Face::side_inner);
    const double z = model.plane(outer ? Face::shoulder_outer : Face::shoulder_inner).z_at(0.0, 0.0);
    side_mm_[outer ? 1 : 0] = std::abs((side.d - side.n.z() * z) / side.n.y());
  }
  const double clear_mm = 0.5 * geometry.casing_rim_diameter_mm.value + kCasingRim_mm;
  for (std::size_t row = 0; row < kSurfaceRows; ++row) {
    for (std::size_t column = 0; column < kSurfaceColumns; ++column) {
      std::uint16_t& cell = cells_[row * kSurfaceColumns + column];
      cell = kNoFace;
      const double x = surface_x_mm(column);
      const double y = surface_y_mm(row);
      Face face = Face::seat;
      double z = 0.0;
      if (!model.visible(x, y, face, z)) continue;
      const Vec3 p(x, y, z);
      const double beside = std::abs(model.along_seat().dot(p)) - geometry.casing_half_spacing_mm.value;
      if (face == Face::top || face == Face::rim_inner || face == Face::rim_outer ||
          x * x + beside * beside < clear_mm * clear_mm)
        continue;
      rows_ = {std::min(rows_[0], row), std::max(rows_[1], row + 1)};
      columns_ = {std::min(columns_[0], column), std::max(columns_[1], column + 1)};
      const Vec3& n = model.plane(face).n;
      const auto to_edge = [&](Face other) {
        const Plane& plane = model.plane(other);
        return std::abs(plane.distance(p)) / n.cross(plane.n).norm();
      };
      const auto steps = [](double mm) {
        const auto whole = static_cast<std::size_t>(mm / kSurfaceCell_mm);
        return whole < kSurfaceEdgeSteps ? static_cast<std::uint16_t>(whole) : kFar;
      };
      const bool on_shoulder = face == Face::shoulder_inner || face == Face::shoulder_outer;
      const bool on_jaw = face == Face::jaw_inner || face == Face::jaw_outer;
      std::uint16_t end = kFar;
      std::uint16_t side = kFar;
      bool foot = false;
      bool upper = false;
      if (face == Face::seat || on_jaw || on_shoulder)
        end = steps(std::min(to_edge(Face::end_minus), to_edge(Face::end_plus)));
      if (on_shoulder) {
        const bool outer = face == Face::shoulder_outer;
        side = steps(to_edge(outer ? Face::side_outer : Face::side_inner));
        upper = to_edge(outer ? Face::jaw_outer : Face::jaw_inner) < kSurfaceEdge_mm;
      }
      if (face == Face::seat) foot = std::min(to_edge(Face::jaw_inner), to_edge(Face::jaw_outer)) < kSurfaceEdge_mm;
      if (on_jaw) {
        const Face shoulder = face == Face::jaw_outer ? Face::shoulder_outer : Face::shoulder_inner;
        foot = to_edge(Face::seat) < kSurfaceEdge_mm;
        upper = to_edge(shoulder) < kSurfaceEdge_mm;
      }
      cell = static_cast<std::uint16_t>(static_cast<unsigned>(face) | unsigned{end} << kEndShift |
                                        unsigned{side} << kSideShift | (foot ? unsigned{kFoot} : 0U) |
                                        (upper ? unsigned{kUpperEdge} : 0U));
    }
  }
}

}  // namespace slabd::algo
