// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "algo/algo.h"
#include "algo/features/noise_texture.h"
#include "base/team.h"

/// Detects gaps that a scanner's program filled, anywhere on a face and in both directions of the scan's grid.
namespace slabd::algo {

/// A face: its frame and its fitted plane, in the block frame.
struct GapFace {
  SeatFrame frame;
  const PlaneFit* plane = nullptr;  ///< null: the face is not examined
};
/// Seat, inner and outer jaw.
inline constexpr std::size_t kGapFaces = 3;
using GapFaces = std::array<GapFace, kGapFaces>;
using FilledGaps = std::array<FilledPlace, kGapFaces>;

/// Side of a place.
inline constexpr double kGapCell_mm = 6.0;
/// Along the rows and along the columns, of each half of the scan.
inline constexpr std::size_t kGapRasters = 4;
inline constexpr std::size_t kGapCells = kGapFaces * kGapRasters * kTextureCells;

inline constexpr std::size_t kTileRows = 4;
inline constexpr std::size_t kTileColumns = 19;

/// A face as a pass over the scan reads it.
struct FaceInScan {
  bool used = false;
  Vec3 u, v, plane;  ///< block frame; `plane` is the fitted plane's normal
  double u_offset = 0.0;
  double v_offset = 0.0;
  double plane_offset = 0.0;
  std::array<std::array<float, 3>, 3> directions{};  ///< u, v and plane in the scanner frame
  std::span<TextureCell> rows, columns;              ///< sums over differences along them
};
struct GapPass {
  const float* xyz = nullptr;
  std::size_t width = 0;
  std::size_t tile_row = 0;  ///< first row of tiles, and the one after the last
  std::size_t tile_row_end = 0;
  std::size_t apart = 0;  ///< columns from one tile to the next in a row of tiles
  Pose T_block_scanner;
  std::array<FaceInScan, kGapFaces> faces;
};

/// The largest places without noise of each face, in its frame; none if the scan is not organised. `cells`: kGapCells,
/// scratch. No heap; 0.5 ms on two threads; the result does not depend on their number.
[[nodiscard]] FilledGaps find_filled_gaps(const Cloud& cloud, const Pose& T_block_scanner, const GapFaces& faces,
                                          std::span<TextureCell> cells, Team& team);

}  // namespace slabd::algo
