// SPDX-License-Identifier: Apache-2.0
//
// Assignment of points to features, from the model's planes without a mesh: on face f, the distance to its edge with
// face g is the distance to plane g divided by the sine of the angle between the two. A margin there keeps fillets,
// mixed pixels and a small error of the pose out of every fit.
#include "algo/survey/segmentation.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cassert>
#include <cmath>

#include "algo/moments.h"

namespace slabd::algo {
namespace {

/// Less than the thickness of a shoulder, whose far side would otherwise look like a hole in the jaw.
constexpr double kJawDepth_mm = 12.0;

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

void RegionRules::build(const BlockModel& model, const EvaluationSettings& settings) {
  const double margin = settings.edge_margin_mm;
  const auto edge = [&](Face on, Face with, double sign) {
    const Vec3& n = model.plane(on).n;
    const Vec3& m = model.plane(with).n;
    return EdgeRule{with, sign, margin * n.cross(m).norm(), n.dot(m), m.z() / n.z()};
  };
  const auto face = [&](Face on, std::array<Face, 2> outside_of, std::array<Face, 2> inside_of) {
    return FaceRule{on,
                    {edge(on, outside_of[0], 1.0), edge(on, outside_of[1], 1.0), edge(on, inside_of[0], -1.0),
                     edge(on, inside_of[1], -1.0)}};
  };
  const auto jaw = [&](Face on, Face shoulder) {
    return FaceRule{on,
                    {edge(on, Face::seat, 1.0), edge(on, shoulder, -1.0), edge(on, Face::end_minus, -1.0),
                     edge(on, Face::end_plus, -1.0)}};
  };
  for (std::size_t f = 0; f < kFaces; ++f) planes_[f] = model.planes()[f];
  along_ = model.along_seat();
  n_.gate = settings.registration_gate_mm;
  n_.depth = kJawDepth_mm;
  n_.crop_half_x = settings.crop_half_x_mm;
  n_.crop_half_s = settings.crop_half_s_mm;
  // A jaw rises from the seat, so the seat is on the jaw's free side. A shoulder or end face cuts a face off: inside.
  n_.seat = face(Face::seat, {Face::jaw_inner, Face::jaw_outer}, {Face::end_minus, Face::end_plus});
  n_.jaw_inner = jaw(Face::jaw_inner, Face::shoulder_inner);
  n_.jaw_outer = jaw(Face::jaw_outer, Face::shoulder_outer);
  constexpr std::array<Face, 4> kAround = {Face::end_minus, Face::end_plus, Face::side_inner, Face::side_outer};
  for (std::size_t i = 0; i < kAround.size(); ++i) n_.around_block[i] = edge(Face::top, kAround[i], 1.0);
  const BlockGeometry& g = model.geometry();
  n_.casing_s = g.casing_half_spacing_mm.value;
  n_.casing_clear = 0.5 * g.casing_rim_diameter_mm.value + margin;
  // The rim's own zone extends beyond it, because a casing may be off its position by half a millimetre.
  n_.casing_reach = 0.5 * g.casing_rim_diameter_mm.value + 1.0;
}

bool RegionRules::holds(const FaceRule& rule, const Vec3& p) const {
  const auto distance = [&](Face f) { return planes_[static_cast<std::size_t>(f)].distance(p); };
  if (!(std::abs(distance(rule.face)) <= n_.gate)) return false;
  for (const EdgeRule& e : rule.edges)
    if (e.sign * distance(e.edge) < e.least) return false;
  return true;
}

/// True for a point further from the face than the gate that is nearest to this face, or above or below it.
bool RegionRules::stands_over(const FaceRule& rule, const Vec3& p) const {
  const auto distance = [&](Face f) { return planes_[static_cast<std::size_t>(f)].distance(p); };
  const double off = distance(rule.face);
  if (std::abs(off) <= n_.gate) return false;
  bool near = std::abs(off) <= n_.depth;
  bool above = true;
  for (const EdgeRule& e : rule.edges) {
    near = near && e.sign * (distance(e.edge) - e.per_off * off) >= e.least;
    above = above && e.sign * (distance(e.edge) - e.per_height * off) >= e.least;
  }
  return near || above;
}

Region RegionRules::region_of(const Vec3& p) const {
  if (!FaceTable::inside(p)) return Region::none;
  const auto distance = [&](Face f) { return planes_[static_cast<std::size_t>(f)].distance(p); };
  const double s = along_.dot(p);
  const double casing_s = std::abs(s) - n_.casing_s;
  const double radius2 = p.x() * p.x() + casing_s * casing_s;
  const bool clear = radius2 >= n_.casing_clear * n_.casing_clear;
  // Objects on the crop and holes in it hide or lack the seat. With a height limit such points would leave a hole in
  // the data, and small holes are accepted: a bolt on the seat must not pass because it is tall.
  const bool crop = std::abs(p.x()) <= n_.crop_half_x && std::abs(s) <= n_.crop_half_s;
  if (crop && clear) return holds(n_.seat, p) ? Region::seat_crop : Region::seat_off;
  if (radius2 <= n_.casing_reach * n_.casing_reach) return s > 0.0 ? Region::casing_outer : Region::casing_inner;
  if (std::abs(distance(Face::top)) <= n_.gate) {
    // Clear of the block means clear of any one of its outer faces.
    for (const EdgeRule& e : n_.around_block)
      if (distance(e.edge) >= e.least) return Region::top;
    return Region::none;
  }
  if (!clear) return Region::none;
  if (holds(n_.seat, p)) return Region::seat_rest;
  if (s < 0.0 && holds(n_.jaw_inner, p)) return Region::jaw_inner;
  if (s > 0.0 && holds(n_.jaw_outer, p)) return Region::jaw_outer;
  if (stands_over(n_.jaw_inner, p)) return Region::jaw_off_inner;
  if (stands_over(n_.jaw_outer, p)) return Region::jaw_off_outer;
  return Region::none;
}

FaceExtents face_extents(const BlockModel& model, const EvaluationSettings& settings) {
  RegionRules rules;
  rules.build(model, settings);
  // Finer across the rail, because a steep jaw is 8 mm wide from above.
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
        case Region::casing_outer:
        case Region::jaw_off_inner:
        case Region::jaw_off_outer: break;
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
  // Region none takes no memory: start[none] == start[first region] == 0.
  for (std::size_t r = 1; r < kRegions; ++r) segments.start[r + 1] = segments.start[r] + count[r];
  std::array<std::size_t, kRegions + 1> next = segments.start;
  for (std::size_t i = 0; i < cloud.points; ++i)
    if (label[i] != 0) order[next[label[i]]++] = static_cast<std::uint32_t>(i);
  return segments;
}

}  // namespace slabd::algo
