// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "base/base.h"
#include "base/team.h"

/// Search for the block in the station's window. The results are accurate enough to start an ICP.
namespace slabd::algo {

/// Heights by cell, row by row.
struct HeightRaster {
  std::span<const float> cells;
  int columns = 0;
  int rows = 0;
  float beyond = 0.0F;  ///< height outside the raster
};

/// Cells of the raster and heights of points. The arrays have a multiple of sixteen elements; a NaN height marks a
/// missing point.
struct PlacedPoints {
  std::span<const std::int32_t> column;
  std::span<const std::int32_t> row;
  std::span<const float> z;
};

/// Number of points within `gate_mm` of the raster's height when moved by whole cells and `rise_mm`. Returns `to_beat`
/// as soon as the number cannot exceed it. About 20 ns for each sixteen points.
[[nodiscard]] int count_explained(const HeightRaster& raster, const PlacedPoints& points, int x_cells, int y_cells,
                                  float rise_mm, float gate_mm, int to_beat);

/// The model's height seen from above, on a raster as coarse as the search's steps, so that moving the block by one
/// step is an offset of one cell.
class HeightMap {
 public:
  static constexpr int kCell_mm = 4;
  static constexpr int kColumns = static_cast<int>(limits::kFaceTableX) / kCell_mm;
  static constexpr int kRows = static_cast<int>(limits::kFaceTableY) / kCell_mm;
  static_assert(static_cast<std::size_t>(kColumns * kRows) == limits::kHeightMapCells);

  /// `cells`: limits::kHeightMapCells, owned by the caller.
  void build(const BlockModel& model, std::span<float> cells);

  /// Heights; the slab top outside the raster, and far below everything inside a bore.
  [[nodiscard]] HeightRaster raster() const { return {cells_, kColumns, kRows, beyond_}; }

 private:
  std::span<const float> cells_;
  float beyond_ = 0.0F;
};

/// A start pose and the number of sampled points it explains.
struct StartPose {
  Pose T_block_scanner;
  int points = 0;
};
inline constexpr std::size_t kStartPosesMax = 6;
using StartPoses = FixedVector<StartPose, kStartPosesMax>;

/// The best poses within the window around `T_block_scanner`, best first: one for each assignment of a large level
/// plane of the scan to bearing plane or slab top. `sample`: points in the scanner frame. Empty if the scan has no
/// level plane. Deterministic, no heap; about 20 ms for any start, half of it on two threads.
[[nodiscard]] StartPoses search_block(const BlockModel& model, const HeightMap& heights,
                                      const EvaluationSettings& settings, const Pose& T_block_scanner,
                                      std::span<const Vec3> sample, Team& team);

}  // namespace slabd::algo
