// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>

#include "algo/algo.h"
#include "algo/features/face_points.h"
#include "algo/features/plane_fit.h"
#include "algo/points.h"
#include "algo/survey/segmentation.h"
#include "algo/survey/survey_pass.h"
#include "base/team.h"

/// All data of a registered scan, from one pass over it: the points of each feature (rules in segmentation.h), the
/// deviation of the scan from the model, and the sums for the plane fits.
namespace slabd::algo {

/// The recipe's part: region of each place near the block.
class SurveyTable {
 public:
  static constexpr std::size_t kCells = FaceTable::kCells;
  /// Largest distance of a point from its face for which the table's region is valid. Narrow, so that slanting borders
  /// cross few cells; wide enough for noise and form.
  static constexpr double kBand_mm = 0.5;

  /// `cells`: kCells, owned by the caller. No heap, about 60 ms.
  void build(const BlockModel& model, const FaceTable& faces, const EvaluationSettings& settings,
             std::span<std::uint32_t> cells);

  [[nodiscard]] const RegionRules& rules() const { return rules_; }
  [[nodiscard]] std::span<const std::uint32_t> cells() const { return cells_; }
  [[nodiscard]] double band_mm() const { return band_mm_; }

 private:
  RegionRules rules_;
  std::span<std::uint32_t> cells_;
  double band_mm_ = kBand_mm;
};

/// Memory for `survey_scan`, owned by the inspector.
struct SurveyWorkspace {
  PointPool& pool;
  std::span<SurveySums> blocks;  ///< limits::kSurveyBlocksMax
  std::span<SeatPoints> runs;    ///< limits::kSurveyPiecesMax
  std::array<MapSums, 2> map;    ///< kDeviationMapCells each (limits)
  std::array<PlaneStart, kLargeFaces>& start;
  /// kSurfaceCells for each of the two threads; the first one has the sums afterwards. Empty if not wanted.
  std::array<std::span<SurfaceCell>, 2> surface{};
};

/// Input of the survey of one scan.
struct SurveyInput {
  const BlockModel& model;
  const SurveyTable& table;
  const EvaluationSettings& settings;
  Pose T_block_scanner;
  std::array<PlaneSettings, kLargeFaces> large;  ///< for the fits of the large faces
  double seat_mm2 = 0.0;                         ///< area of the whole seat in the projection on (x, y)
};

struct Survey {
  DeviationStats deviation;
  std::array<PlaneFit, kLargeFaces> large;
  std::array<ListedPoints, kPointLists> lists;  ///< their runs are in the workspace
  std::array<FaceRaster, 2> jaw{};              ///< places of the inner and the outer jaw ...
  std::array<PlaceCounts, 2> jaw_off{};         ///< ... and the points there that are too far off
  /// True if there were more points to list than memory; the lists and fits are then invalid.
  bool overflown = false;
  /// All points over the evaluation region: those on the seat, then those off it.
  [[nodiscard]] std::span<const SeatPoints> over_crop() const {
    const std::span<const SeatPoints> on = of(PointList::seat_crop).runs;
    return {on.data(), on.size() + of(PointList::seat_off).runs.size()};
  }
  [[nodiscard]] std::uint64_t points_off(std::size_t jaw_number) const {
    return std::accumulate(jaw_off[jaw_number].begin(), jaw_off[jaw_number].end(), std::uint64_t{0});
  }
  [[nodiscard]] const ListedPoints& of(PointList list) const { return lists[static_cast<std::size_t>(list)]; }
};

/// Surveys the points of `cloud` (NaN: missing) in any order. The same result with one or two threads. No heap; about
/// 0.6 ns a point.
void survey_scan(const Cloud& cloud, const SurveyInput& input, const SurveyWorkspace& work, Team& team, Survey& survey);

}  // namespace slabd::algo
