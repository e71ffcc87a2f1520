// SPDX-License-Identifier: Apache-2.0
#include "algo/features/jaw.h"

#include <Eigen/LU>

#include "algo/features/plane_fit.h"

namespace slabd::algo {

FaceEdges edges_of_jaw(const BlockModel& model, Face jaw, Face shoulder) {
  const SeatFrame frame = frame_of(model.plane(jaw));
  Mat3 A;
  A.row(0) = Vec3::UnitX();
  A.row(1) = frame.up;
  const auto at_edge_with = [&](Face face) {
    const Plane& plane = model.plane(face);
    A.row(2) = plane.n;
    return frame.in_seat(A.inverse() * Vec3(0.0, model.plane(jaw).d, plane.d))[1];
  };
  return {at_edge_with(Face::seat), at_edge_with(shoulder)};
}

JawFit measure_jaw(const JawTask& task) {
  JawFit jaw;
  PlaneStart start;
  SeatPoints kept;
  const auto fit_strip = [&](const FlatStrip& strip) {
    kept = points_of_strip(task.points, task.edges, strip, task.memory);
    ListedPoints points;
    points.frame = task.points.frame;
    points.runs = std::span(&kept, 1);
    points.count = kept.size();
    return fit_plane_over(points, task.up, task.settings, start);
  };
  jaw.plane = fit_plane_over(task.points, task.up, task.settings, start);
  const bool all_of_it = jaw.plane.ok;
  // A plane that a large fillet has bent, or that was refused for it, says nothing of what is flat.
  if (const PlaneFit middle = all_of_it ? jaw.plane : fit_strip(middle_of(task.edges)); middle.ok || all_of_it) {
    const FaceProfile profile = profile_of(task.points, {middle.normal, middle.offset_mm}, task.edges);
    jaw.strip = find_flat_strip(profile, task.edges, task.margin_mm, task.ripple_mm);
    if (jaw.strip.narrowed) jaw.plane = fit_strip(jaw.strip);
  }
  const std::size_t offered = jaw.strip.narrowed ? kept.size() : task.points.size();
  if (jaw.plane.ok && share_by_area(start, jaw.plane, task.points.frame, task.raster, task.off, offered) <
                          task.settings.inlier_share_min)
    refuse(jaw.plane, PlaneDoubt::area);
  return jaw;
}

}  // namespace slabd::algo
