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

// Flat part of a jaw. Between its foot and its top a cast jaw begins with a fillet and ends with a rounding. Both radii
// come from the mould and change with wear. In the corner at its foot light is reflected between the faces, which
// raises a projector's readings there. In the scan the profile of the jaw along its height leaves the straight line at
// these places.

/// The two model edges of a jaw along its height, as coordinate s of its points' frame.
struct FaceEdges {
  double foot_s_mm = 0.0;  ///< edge with the bearing plane
  double top_s_mm = 0.0;   ///< edge with the shoulder
  [[nodiscard]] double length_mm() const { return std::abs(top_s_mm - foot_s_mm); }
  [[nodiscard]] double s_at(double from_foot_mm) const {
    return foot_s_mm + (top_s_mm > foot_s_mm ? from_foot_mm : -from_foot_mm);
  }
};

/// Heights above a plane by the distance from the foot, one median per millimetre.
struct FaceProfile {
  static constexpr double kStep_mm = 1.0;
  static constexpr std::size_t kSteps = 48;
  std::array<double, kSteps> height_mm{};
  std::array<double, kSteps> sigma_mm{};  ///< of the median; 0 if there are too few points
  [[nodiscard]] bool seen(std::size_t k) const { return sigma_mm[k] > 0.0; }
  [[nodiscard]] static double from_foot_mm(std::size_t k) { return (static_cast<double>(k) + 0.5) * kStep_mm; }
};

/// Range of distances from the foot in which the face is flat.
struct FlatStrip {
  double from_mm = 0.0;
  double to_mm = 0.0;
  bool narrowed = false;       ///< true if only a part of the offered strip is flat
  double form_tilt_rad = 0.0;  ///< standard uncertainty of the face's tilt from its own profile
  double wave_mm2 = 0.0;       ///< variance of its waves, from the independent part of the profile; 0: unknown
  double lever_mm2 = 0.0;      ///< sum of the squared positions of the profile about their middle
  double bend_rad = 0.0;       ///< largest angle between the strip and another straight piece of a bent face; else 0
};

/// The middle of the face, flat even with a fillet of 12 mm radius.
[[nodiscard]] FlatStrip middle_of(const FaceEdges& edges);

/// The profile of `points` above `plane` (unit normal and offset, block frame). No heap.
[[nodiscard]] FaceProfile profile_of(const ListedPoints& points, const FlatPlane& plane, const FaceEdges& edges);

/// Extends the strip from the middle of the face while the profile stays on the straight line through the strip so far.
/// `margin_mm`: excluded at either edge. `ripple_mm`: amplitude of the scanner's periodic error on this face, along its
/// normal.
[[nodiscard]] FlatStrip find_flat_strip(const FaceProfile& profile, const FaceEdges& edges, double margin_mm,
                                        double ripple_mm = 0.0);

/// Standard uncertainties of both jaws' tilts from their own profiles. One scanner and one mould made both, so their
/// waves are similar: a wave too long for one strip shows in the other.
[[nodiscard]] std::array<double, 2> form_tilts_rad(const FlatStrip& inner, const FlatStrip& outer);

/// Copies the points of a strip to `memory` (three floats each); if it is too small, every N-th point.
[[nodiscard]] SeatPoints points_of_strip(const ListedPoints& points, const FaceEdges& edges, const FlatStrip& strip,
                                         std::span<float> memory);

/// Edges of the model's jaw with the bearing plane and the shoulder.
[[nodiscard]] FaceEdges edges_of_jaw(const BlockModel& model, Face jaw, Face shoulder);

/// Input of `measure_jaw`.
struct JawTask {
  const ListedPoints& points;
  Vec3 up;          ///< normal of the model's jaw
  FaceEdges edges;  ///< of the model
  double margin_mm = 0.0;
  PlaneSettings settings;
  const FaceRaster& raster;
  const PlaceCounts& off;   ///< points at the jaw's place too far off to be offered
  std::span<float> memory;  ///< for the points of the flat strip
  double ripple_mm = 0.0;   ///< amplitude of the scanner's periodic error along the normal of this jaw
};

struct JawFit {
  PlaneFit plane;
  FlatStrip strip;
};

/// Fits the plane of a jaw's flat strip. If all of it is flat up to the margins, the result is bitwise the plane of all
/// points. Refused if less than inlier_share_min of the area is on it. No heap; 0.5 ms for 20 000 points.
[[nodiscard]] JawFit measure_jaw(const JawTask& task);

}  // namespace slabd::algo
