// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"

/// What a scanner makes of a flat plate and of a ball, in the terms of VDI/VDE 2634 part 2 (area-scanning systems).
/// Pure: scans in (mm, 3 floats a point, NaN = missing), figures out.
///
///   PF  probing error form: range of the radial distances of the points from their least-squares sphere
///   PS  probing error size: diameter of that sphere minus the certified one
///   RF  flatness measurement error: range of the signed distances of the points from their least-squares plane
///
/// As the guideline allows, up to 3 in 1000 points, the furthest ones, are left out of each range.
namespace slabd::cli {

inline constexpr double kRejectedShareMax = 0.003;
inline constexpr double kBesideShareMax = 0.1;  ///< of the points within kBesideGates gates of a plate
inline constexpr double kBesideGates = 5.0;

struct AcceptanceSettings {
  double gate_mm = 1.0;  ///< further from the plate, or the sphere, than this is something else in the scan
  double incidence_max_rad = rad_from_deg(60.0);  ///< on the ball
  double form_cell_mm = 10.0;                     ///< noise is averaged over this before the scanner's form is taken
  std::uint64_t seed = 1;                         ///< of the search for the plate's plane
};

/// How the noise of neighbouring points hangs together. Form (what a surface of 4th order follows) is taken out first.
struct NoiseFigures {
  double sigma_mm = kNoValue;        ///< of one point, along the plate's normal
  double correlation_mm = kNoValue;  ///< along a row: where the correlation has fallen to 1/e; NaN: no rows
  double pitch_mm = kNoValue;        ///< between neighbours of a row
};

struct PlateFigures {
  std::size_t points = 0;                     ///< on the plate
  std::size_t rejected = 0;                   ///< of these left out of RF
  Vec3 centre_mm = Vec3::Constant(kNoValue);  ///< of these
  Vec3 normal = Vec3::Constant(kNoValue);     ///< towards the scanner
  double length_mm = kNoValue;                ///< longest way across the cells that are well filled
  double RF_mm = kNoValue;
  double rms_mm = kNoValue;        ///< of all points on the plate
  double form_half_mm = kNoValue;  ///< half the range of the means of cells: what does not average away
  NoiseFigures noise;
};
/// too_few_points: fewer than 10,000 points of one plane. block_not_found: more than kBesideShareMax of the points near
/// the plane are not on it, so what was found is a slice of something bent, or other things stand beside the plate.
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
/// `diameter_mm` certified. block_not_found: there is no such ball in the scan; the text says why.
[[nodiscard]] Result<BallFigures> judge_ball(std::span<const float> xyz, double diameter_mm,
                                             const AcceptanceSettings& settings);

// Two scans look at one place when the artefact hardly moved in between: many of them say little about the volume.
inline constexpr double kPlaceApart_mm = 10.0;
inline constexpr double kPlaceApart_rad = rad_from_deg(5.0);  ///< of a plate's normal

}  // namespace slabd::cli
