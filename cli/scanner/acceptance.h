// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"

/// Acceptance figures of a scanner from scans of a flat plate and of a ball, in the terms of VDI/VDE 2634 part 2
/// (area-scanning systems). Pure functions of scans (mm, 3 floats a point, NaN = missing).
///
///   PF  probing error form: range of the radial distances of the points from their least-squares sphere
///   PS  probing error size: diameter of that sphere minus the certified one
///   RF  flatness measurement error: range of the signed distances of the points from their least-squares plane
///
/// As the guideline allows, up to 3 in 1000 points, the furthest ones, are left out of each range.
namespace slabd::cli {

inline constexpr double kRejectedShareMax = 0.003;
inline constexpr double kBesideShareMax = 0.1;  ///< share of the points within kBesideGates gates of a plate
inline constexpr double kBesideGates = 5.0;

struct AcceptanceSettings {
  double gate_mm = 1.0;  ///< points further from the plate or the sphere belong to other objects
  double incidence_max_rad = rad_from_deg(60.0);  ///< on the ball
  double form_cell_mm = 10.0;  ///< cell size for averaging the noise before the scanner's form is computed
  std::uint64_t seed = 1;      ///< seed of the search for the plate's plane
};

/// Correlation of the noise of neighbouring points. The form (a surface of 4th order) is removed first.
struct NoiseFigures {
  double sigma_mm = kNoValue;        ///< standard deviation of one point, along the plate's normal
  double correlation_mm = kNoValue;  ///< along a row: distance at which the correlation is 1/e; NaN: rows too short
  double pitch_mm = kNoValue;        ///< between neighbours of a row
};

struct PlateFigures {
  std::size_t points = 0;                     ///< on the plate
  std::size_t rejected = 0;                   ///< number of them left out of RF
  Vec3 centre_mm = Vec3::Constant(kNoValue);  ///< centre of the points on the plate
  Vec3 normal = Vec3::Constant(kNoValue);     ///< towards the scanner
  double length_mm = kNoValue;                ///< longest distance across the well-filled cells
  double RF_mm = kNoValue;
  double rms_mm = kNoValue;        ///< of all points on the plate
  double form_half_mm = kNoValue;  ///< half the range of the cell means: the part that does not average out
  NoiseFigures noise;
};
/// Code::too_few_points: fewer than 10,000 points of one plane. Code::block_not_found: more than kBesideShareMax of
/// the points near the plane are not on it. The plane is then a section of a curved surface, or other objects are next
/// to the plate.
[[nodiscard]] Result<PlateFigures> judge_plate(std::span<const float> xyz, const ScanShape& shape,
                                               const AcceptanceSettings& settings);

struct BallFigures {
  std::size_t points = 0;
  std::size_t rejected = 0;
  Vec3 centre_mm = Vec3::Constant(kNoValue);
  double radius_mm = kNoValue;
  double PF_mm = kNoValue;
  double PS_mm = kNoValue;
  double rms_mm = kNoValue;
};
/// `diameter_mm` is the certified one. Code::block_not_found: the scan does not contain such a ball; the text has the
/// reason.
[[nodiscard]] Result<BallFigures> judge_ball(std::span<const float> xyz, double diameter_mm,
                                             const AcceptanceSettings& settings);

// Two scans are of one place if the artefact was hardly moved between them: such scans cover little of the volume.
inline constexpr double kPlaceApart_mm = 10.0;
inline constexpr double kPlaceApart_rad = rad_from_deg(5.0);  ///< angle between the plates' normals

}  // namespace slabd::cli
