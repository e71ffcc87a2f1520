// SPDX-License-Identifier: Apache-2.0
//
// Which points are measured for which feature? The model's planes say it without any mesh: on face f, the distance to
// its edge with face g is the distance to plane g divided by the sine of the angle between the two. Keeping a margin
// there keeps fillets, mixed pixels and a small misfit of the pose out of every fit.
#include "algo/segmentation.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cassert>
#include <cmath>

#include "algo/moments.h"

namespace slabd::algo {
namespace {

FaceExtent extent_of(PointMoments& seen, double area_each_mm2) {
  seen.close_block();
  if (seen.count() == 0) return {};
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.compute(seen.scatter(), Eigen::EigenvaluesOnly);
  const double n = static_cast<double>(seen.count());
  const Eigen::Vector3d squares = solver.eigenvalues();
  return {n * area_each_mm2, std::sqrt(std::fmax(squares[2], 0.0) / n), std::sqrt(std::fmax(squares[1], 0.0) / n)};
}

}  // namespace

bool BoundedFace::holds(const Vec3& p, double gate) const {
  if (!(std::abs(plane.distance(p)) <= gate)) return false;
  for (const PlaneBound& b : bounds)
    if (b.sign * b.plane.distance(p) < b.least) return false;
  return true;
}

void RegionRules::build(const BlockModel& model, const EvaluationSettings& settings) {
  along_ = model.along_seat();
  margin_ = settings.edge_margin_mm;
  gate_ = settings.registration_gate_mm;
  crop_half_x_ = settings.crop_half_x_mm;
  crop_half_s_ = settings.crop_half_s_mm;
  const BlockGeometry& g = model.geometry();
  // A jaw rises from the seat: the seat's free side is the jaw's too. A shoulder or end cuts a face off: inside.
  seat_ = face(model, Face::seat, {Face::jaw_inner, Face::jaw_outer}, {Face::end_minus, Face::end_plus});
  jaw_inner_ = jaw(model, Face::jaw_inner, Face::shoulder_inner);
  jaw_outer_ = jaw(model, Face::jaw_outer, Face::shoulder_outer);
  top_ = model.plane(Face::top);
  constexpr std::array<Face, 4> kAround = {Face::end_minus, Face::end_plus, Face::side_inner, Face::side_outer};
  for (std::size_t i = 0; i < kAround.size(); ++i) around_[i] = bound(model, Face::top, kAround[i], 1.0);
  casing_s_ = g.casing_half_spacing_mm.value;
  casing_clear_ = 0.5 * g.casing_rim_diameter_mm.value + margin_;
  // The rim's own zone reaches beyond it, as a casing may sit half a millimetre beside its place.
  casing_reach_ = 0.5 * g.casing_rim_diameter_mm.value + 1.0;
  rim_ = model.plane(Face::rim_outer);
}

Region RegionRules::region_of(const Vec3& p) const {
  if (!FaceTable::inside(p)) return Region::none;
  const double s = along_.dot(p);
  const auto from_casing = [&] { return std::hypot(p.x(), std::abs(s) - casing_s_); };
  // Whatever stands over the crop or gapes in it hides or lacks the seat. A limit of height would make a hole in the
  // data of it, and small holes are forgiven: a bolt on the seat must not pass because it is tall.
  const bool crop = std::abs(p.x()) <= crop_half_x_ && std::abs(s) <= crop_half_s_;
  if (crop && from_casing() >= casing_clear_) return seat_.holds(p, gate_) ? Region::seat_crop : Region::seat_off;
  if (std::abs(top_.distance(p)) <= gate_) {
    // Clear of the block means clear of any one of its outer faces.
    for (const PlaneBound& b : around_)
      if (b.plane.distance(p) >= b.least) return Region::top;
    return Region::none;
  }
  if (const double radius = from_casing(); radius < casing_clear_) {
    if (radius > casing_reach_ || std::abs(rim_.distance(p)) > gate_) return Region::none;
    return s > 0.0 ? Region::casing_outer : Region::casing_inner;
  }
  if (seat_.holds(p, gate_)) return Region::seat_rest;
  if (s < 0.0 && jaw_inner_.holds(p, gate_)) return Region::jaw_inner;
  if (s > 0.0 && jaw_outer_.holds(p, gate_)) return Region::jaw_outer;
  return Region::none;
}

PlaneBound RegionRules::bound(const BlockModel& model, Face on, Face edge, double sign) const {
  const double sine = model.plane(on).n.cross(model.plane(edge).n).norm();
  return {model.plane(edge), sign, margin_ * sine};
}
BoundedFace RegionRules::face(const BlockModel& model, Face on, std::array<Face, 2> outside_of,
                              std::array<Face, 2> inside_of) const {
  return {model.plane(on),
          {bound(model, on, outside_of[0], 1.0), bound(model, on, outside_of[1], 1.0),
           bound(model, on, inside_of[0], -1.0), bound(model, on, inside_of[1], -1.0)}};
}
BoundedFace RegionRules::jaw(const BlockModel& model, Face on, Face shoulder) const {
  return {model.plane(on),
          {bound(model, on, Face::seat, 1.0), bound(model, on, shoulder, -1.0), bound(model, on, Face::end_minus, -1.0),
           bound(model, on, Face::end_plus, -1.0)}};
}

FaceExtents face_extents(const BlockModel& model, const EvaluationSettings& settings) {
  RegionRules rules;
  rules.build(model, settings);
  // Finer across the rail: a steep jaw is 8 mm wide from above.
  constexpr double kStepX = 4.0;
  constexpr double kStepY = 1.0;
  constexpr auto columns = static_cast<int>(static_cast<double>(limits::kFaceTableX) / kStepX);
  constexpr auto rows = static_cast<int>(static_cast<double>(limits::kFaceTableY) / kStepY);
  const PointMoments none(Vec3::Zero());
  PointMoments crop = none, full = none, inner = none, outer = none, top = none;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const double x = (column + 0.5) * kStepX - 0.5 * static_cast<double>(limits::kFaceTableX);
      const double y = (row + 0.5) * kStepY - 0.5 * static_cast<double>(limits::kFaceTableY);
      Face face = Face::seat;
      double z = 0.0;
      if (!model.visible(x, y, face, z)) continue;
      const Vec3 p(x, y, z);
      switch (rules.region_of(p)) {
        case Region::seat_crop: crop.add(p); [[fallthrough]];
        case Region::seat_rest: full.add(p); break;
        case Region::jaw_inner: inner.add(p); break;
        case Region::jaw_outer: outer.add(p); break;
        case Region::top: top.add(p); break;
        case Region::none:
        case Region::seat_off:
        case Region::casing_inner:
        case Region::casing_outer: break;
      }
    }
  }
  constexpr double kEach = kStepX * kStepY;
  return {extent_of(crop, kEach), extent_of(full, kEach), extent_of(inner, kEach), extent_of(outer, kEach),
          extent_of(top, kEach)};
}

Segments segment(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                 const FastTransform& T_block_scanner, std::span<std::uint8_t> label, std::span<std::uint32_t> order) {
  assert(cloud.points <= label.size() && cloud.points <= order.size());
  RegionRules rules;
  rules.build(model, settings);
  std::array<std::size_t, kRegions> count{};
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const Region region = rules.region_of(T_block_scanner(cloud.xyz.data() + 3 * i));
    label[i] = static_cast<std::uint8_t>(region);
    ++count[label[i]];
  }
  Segments segments;
  segments.order = order;
  // Region none keeps no room: start[none] == start[first region] == 0.
  for (std::size_t r = 1; r < kRegions; ++r) segments.start[r + 1] = segments.start[r] + count[r];
  std::array<std::size_t, kRegions + 1> next = segments.start;
  for (std::size_t i = 0; i < cloud.points; ++i)
    if (label[i] != 0) order[next[label[i]]++] = static_cast<std::uint32_t>(i);
  return segments;
}

}  // namespace slabd::algo
