// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/features/face_points.h"
#include "algo/features/seat_points.h"
#include "base/base.h"

namespace slabd::algo {

// Where a jaw is flat. Between its foot and its top a cast jaw begins with a fillet and ends with a rounding, both of
// a radius that the mould has and wear changes, and in the corner at its foot light is thrown from one face to the
// other, which lifts what a projector measures there. The scan shows it: the profile of the jaw, up its height, leaves
// the straight line.

/// Of a jaw, along its height, in the coordinate s of its points' frame: the two edges of the model.
struct FaceEdges {
  double foot_s_mm = 0.0;  ///< with the bearing plane
  double top_s_mm = 0.0;   ///< with the shoulder
  [[nodiscard]] double length_mm() const { return std::abs(top_s_mm - foot_s_mm); }
  [[nodiscard]] double s_at(double from_foot_mm) const {
    return foot_s_mm + (top_s_mm > foot_s_mm ? from_foot_mm : -from_foot_mm);
  }
};

/// Heights above a plane by the distance from the foot, one median a millimetre.
struct FaceProfile {
  static constexpr double kStep_mm = 1.0;
  static constexpr std::size_t kSteps = 48;
  std::array<double, kSteps> height_mm{};
  std::array<double, kSteps> sigma_mm{};  ///< of the median; 0: too few points
  [[nodiscard]] bool seen(std::size_t k) const { return sigma_mm[k] > 0.0; }
  [[nodiscard]] static double from_foot_mm(std::size_t k) { return (static_cast<double>(k) + 0.5) * kStep_mm; }
};

/// Distances from the foot between which the face is flat.
struct FlatStrip {
  double from_mm = 0.0;
  double to_mm = 0.0;
  bool narrowed = false;       ///< less than what was offered is flat
  double form_tilt_rad = 0.0;  ///< standard uncertainty of the face's tilt by its own profile
  double wave_mm2 = 0.0;       ///< variance of its waves, from what of the profile is independent; 0: unknown
  double lever_mm2 = 0.0;      ///< sum of the squares of the profile's places about their middle
  double bend_rad = 0.0;       ///< largest angle between the strip and another straight piece of a bent face; else 0
};

/// The middle of the face, which even a fillet of 12 mm radius leaves flat.
[[nodiscard]] FlatStrip middle_of(const FaceEdges& edges);

/// The profile of `points` over `plane` (unit normal and offset, block frame). No heap.
[[nodiscard]] FaceProfile profile_of(const ListedPoints& points, const FlatPlane& plane, const FaceEdges& edges);

/// From the middle of the face outwards as long as the profile stays on the straight line through what is flat already.
/// `margin_mm`: nothing nearer to an edge was offered. `ripple_mm`: amplitude of the scanner's periodic error on this
/// face, along its normal.
[[nodiscard]] FlatStrip find_flat_strip(const FaceProfile& profile, const FaceEdges& edges, double margin_mm,
                                        double ripple_mm = 0.0);

/// Standard uncertainties of both jaws' tilts by their own profiles. One scanner has seen both and one mould has cast
/// both, so their waves are alike: a wave that one strip is too short to show is in the other's.
[[nodiscard]] std::array<double, 2> form_tilts_rad(const FlatStrip& inner, const FlatStrip& outer);

/// The points of a strip, copied to `memory` (three floats each; of more than there is room for, every so many-th).
[[nodiscard]] SeatPoints points_of_strip(const ListedPoints& points, const FaceEdges& edges, const FlatStrip& strip,
                                         std::span<float> memory);

/// Where the model's jaw meets the bearing plane and the shoulder.
[[nodiscard]] FaceEdges edges_of_jaw(const BlockModel& model, Face jaw, Face shoulder);

/// What is asked of a jaw's points.
struct JawTask {
  const ListedPoints& points;
  Vec3 up;          ///< normal of the model's jaw
  FaceEdges edges;  ///< of the model
  double margin_mm = 0.0;
  PlaneSettings settings;
  const FaceRaster& raster;
  const PlaceCounts& off;   ///< points in the jaw's place that were not offered, as they lie too far off
  std::span<float> memory;  ///< for the points of the flat strip
  double ripple_mm = 0.0;   ///< amplitude of the scanner's periodic error along the normal of this jaw
};

struct JawFit {
  PlaneFit plane;
  FlatStrip strip;
};

/// The plane of a jaw's flat strip. Where all of it is flat to the margins it is the plane of all of its points, to the
/// bit. Refused where less of the area than inlier_share_min lies on it. No heap; 0.5 ms for 20 000 points.
[[nodiscard]] JawFit measure_jaw(const JawTask& task);

}  // namespace slabd::algo
