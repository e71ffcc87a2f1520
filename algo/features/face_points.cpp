// SPDX-License-Identifier: Apache-2.0
#include "algo/features/face_points.h"

#include "algo/features/plane_zone.h"

namespace slabd::algo {
namespace {

/// The table's half lengths: no point of a face lies further out.
constexpr double kHalfX = 0.5 * static_cast<double>(limits::kFaceTableX);
constexpr double kHalfV = 0.5 * static_cast<double>(limits::kFaceTableY);

double furthest_between(const LocalPlane& plane, const Tilt& tilt) {
  return std::abs(plane.a0 - static_cast<double>(tilt.a0)) +
         std::abs(plane.a1 - static_cast<double>(tilt.a1)) * kHalfX +
         std::abs(plane.a2 - static_cast<double>(tilt.a2)) * kHalfV;
}

}  // namespace

LocalPlane::LocalPlane(const SeatFrame& frame, const FlatPlane& plane) {
  const double up = plane.n.dot(frame.up);
  a0 = (plane.d - plane.n.dot(frame.origin)) / up;
  a1 = -plane.n.dot(frame.along_rail) / up;
  a2 = -plane.n.dot(frame.along_seat) / up;
  stretch = 1.0 / std::abs(up);
}

void add_tilted(const SeatFrame& frame, const Tilt& tilt, const TiltedSums& sums, PointMoments& moments) {
  // p = origin + a0 up + A (u, v, r), with A = (along_rail + a1 up, along_seat + a2 up, up).
  Mat3 A;
  A.col(0) = frame.along_rail + static_cast<double>(tilt.a1) * frame.up;
  A.col(1) = frame.along_seat + static_cast<double>(tilt.a2) * frame.up;
  A.col(2) = frame.up;
  const Vec3 w = frame.origin + static_cast<double>(tilt.a0) * frame.up - moments.shift();
  const std::array<double, 9>& s = sums.sums;
  Mat3 Q;
  Q << s[3], s[4], s[5], s[4], s[6], s[7], s[5], s[7], s[8];
  const Vec3 linear = A * Vec3(s[0], s[1], s[2]);
  const Vec3 first = linear + sums.count * w;
  const Mat3 second =
      A * Q * A.transpose() + linear * w.transpose() + w * linear.transpose() + sums.count * w * w.transpose();
  moments.add_sums({first.x(), first.y(), first.z(), second(0, 0), second(0, 1), second(0, 2), second(1, 1),
                    second(1, 2), second(2, 2)},
                   static_cast<std::size_t>(sums.count));
}

void add_within(const ListedPoints& points, const FlatPlane& plane, double threshold, PointMoments& moments) {
  const LocalPlane local(points.frame, plane);
  add_tilted(points.frame, Tilt{},
             tilted_sums(points.runs, local.tilt(), static_cast<float>(threshold * local.stretch)), moments);
}

void add_within(const SummedPoints& points, const FlatPlane& plane, double threshold, PointMoments& moments) {
  const LocalPlane local(points.frame, plane);
  // Also when it is not a number.
  if (!(furthest_between(local, points.tilt) <= points.slack_mm)) points.asked_beyond = true;
  TiltedSums sums = points.inner;
  const Tilt between{static_cast<float>(local.a0 - static_cast<double>(points.tilt.a0)),
                     static_cast<float>(local.a1 - static_cast<double>(points.tilt.a1)),
                     static_cast<float>(local.a2 - static_cast<double>(points.tilt.a2))};
  sums += tilted_sums(points.edge, between, static_cast<float>(threshold * local.stretch));
  add_tilted(points.frame, points.tilt, sums, moments);
}

}  // namespace slabd::algo
