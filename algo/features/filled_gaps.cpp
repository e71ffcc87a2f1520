// SPDX-License-Identifier: Apache-2.0
//
// Problem: the noise along the rows of a scan (noise_texture.cpp) does not show a gap that was filled from row to row,
// because each filled row repeats the noise of the rows beside it. And the lists of a face's points end at its
// evaluation region.
//
// Idea: look at the scan's grid itself, in tiles of 4 rows and 19 columns. A tile gives 64 third differences along the
// rows and 16 along the columns, and both must have noise. Some 8,000 tiles of the scan are enough: each place of 6 mm
// has about one. Successive rows of tiles begin at multiples of the golden ratio, so that tiles are spread evenly.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/features/filled_gaps.cpp"
#include <hwy/foreach_target.h>
//
#include <algorithm>
#include <bit>
#include <cmath>

#include "algo/features/filled_gaps.h"
#include "algo/lanes-inl.h"
#include "algo/points.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Points further than this from the plane are not its noise: outliers, damage, an edge.
constexpr float kReach_mm = 0.5F;
/// Neighbours are at most this far apart, and their steps are similar.
constexpr float kStepMax_mm = 3.0F;
constexpr float kStepsAlike = 0.5F;
constexpr std::size_t kBeyond = kTileColumns - kLanes;

/// Coordinates of a row of a tile: along the face (u, v) and from its plane, relative to the tile's centre.
struct TileRow {
  alignas(64) std::array<float, kLanes + kLanes> u, v, r;
};
using Tile = std::array<TileRow, kTileRows>;

/// Sixteen third differences.
struct Thirds {
  double sum = 0.0;
  std::uint32_t count = 0;
};
HWY_INLINE Thirds thirds_of(const std::array<F16, 4>& u, const std::array<F16, 4>& v, const std::array<F16, 4>& r) {
  const F16 u1 = u[1] - u[0];
  const F16 v1 = v[1] - v[0];
  const F16 size = max(abs(u1), abs(v1));
  const auto alike = [&](std::size_t k) {
    return max(abs(u[k + 1] - u[k] - u1), abs(v[k + 1] - v[k] - v1)) <= f16(kStepsAlike) * size;
  };
  const F16 reach = f16(kReach_mm);
  const M16 used = (abs(r[0]) < reach) & (abs(r[1]) < reach) & (abs(r[2]) < reach) & (abs(r[3]) < reach) &
                   (size > f16(0.0F)) & (size < f16(kStepMax_mm)) & alike(1) & alike(2);
  const F16 third = abs(r[3] - f16(3.0F) * r[2] + f16(3.0F) * r[1] - r[0]);
  return {sum_of_lanes(keep(used, third)), static_cast<std::uint32_t>(std::popcount(bits(used)))};
}

HWY_INLINE void read_row(const float* xyz, const Vec3& centre, const FaceInScan& face, double off_mm, TileRow& row) {
  const F16 x0 = f16(static_cast<float>(centre.x()));
  const F16 y0 = f16(static_cast<float>(centre.y()));
  const F16 z0 = f16(static_cast<float>(centre.z()));
  const auto along = [](const std::array<float, 3>& d, const Points16& p) {
    return f16(d[0]) * p.x + f16(d[1]) * p.y + f16(d[2]) * p.z;
  };
  for (const std::size_t from : {std::size_t{0}, kBeyond}) {
    Points16 p = load_points(xyz + 3 * from);
    p = {p.x - x0, p.y - y0, p.z - z0};
    store(along(face.directions[0], p), &row.u[from]);
    store(along(face.directions[1], p), &row.v[from]);
    store(along(face.directions[2], p) + f16(static_cast<float>(off_mm)), &row.r[from]);
  }
}

HWY_INLINE void add(const Thirds& thirds, TextureCell& cell) {
  cell.sum_mm += static_cast<float>(thirds.sum);
  cell.count += thirds.count;
}

/// Adds a tile whose centre is a point of the face to the cell of its centre.
void add_tile(const GapPass& pass, const float* xyz, const Vec3& centre, const FaceInScan& face, double off_mm,
              std::size_t cell) {
  Tile tile;
  for (std::size_t k = 0; k < kTileRows; ++k) read_row(xyz + 3 * k * pass.width, centre, face, off_mm, tile[k]);
  for (const TileRow& row : tile) {
    const auto along = [](const auto& values) {
      return std::array<F16, 4>{load(&values[0]), load(&values[1]), load(&values[2]), load(&values[3])};
    };
    add(thirds_of(along(row.u), along(row.v), along(row.r)), face.rows[cell]);
  }
  const auto across = [&](auto member) {
    return std::array<F16, 4>{load((tile[0].*member).data()), load((tile[1].*member).data()),
                              load((tile[2].*member).data()), load((tile[3].*member).data())};
  };
  add(thirds_of(across(&TileRow::u), across(&TileRow::v), across(&TileRow::r)), face.columns[cell]);
}

void AddTiles(const GapPass& pass) {
  constexpr auto kColumns = static_cast<double>(kTextureColumns);
  constexpr auto kRows = static_cast<double>(kTextureRows);
  const FastTransform to_block(pass.T_block_scanner);
  for (std::size_t tile_row = pass.tile_row; tile_row < pass.tile_row_end; ++tile_row) {
    const std::uint64_t fraction = static_cast<std::uint32_t>(tile_row) * 0x9E37'79B9U & 0xFFFF'FFFFU;
    const float* row = pass.xyz + 3 * kTileRows * tile_row * pass.width;
    for (std::size_t column = fraction * pass.apart >> 32U; column + kTileColumns <= pass.width; column += pass.apart) {
      const float* xyz = row + 3 * column;
      const float* middle = xyz + 3 * (pass.width + kTileColumns / 2);
      if (!std::isfinite(middle[0]) || !std::isfinite(middle[1]) || !std::isfinite(middle[2])) continue;
      const Vec3 p = to_block(middle);
      for (const FaceInScan& face : pass.faces) {
        if (!face.used) continue;
        const double off_mm = face.plane.dot(p) - face.plane_offset;
        if (std::abs(off_mm) >= static_cast<double>(kReach_mm)) continue;
        const double u = (face.u.dot(p) - face.u_offset) / kGapCell_mm + kColumns / 2.0;
        const double v = (face.v.dot(p) - face.v_offset) / kGapCell_mm + kRows / 2.0;
        if (!(u >= 0.0 && u < kColumns && v >= 0.0 && v < kRows)) continue;
        const std::size_t cell = kTextureColumns * static_cast<std::size_t>(v) + static_cast<std::size_t>(u);
        add_tile(pass, xyz,
                 {static_cast<double>(middle[0]), static_cast<double>(middle[1]), static_cast<double>(middle[2])}, face,
                 off_mm, cell);
      }
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(AddTiles);
namespace {

constexpr std::size_t kTilesWanted = 8'000;

FaceInScan in_scan(const GapFace& face, const Pose& T_block_scanner, std::span<TextureCell> rows,
                   std::span<TextureCell> columns) {
  FaceInScan in;
  in.used = face.plane != nullptr;
  if (!in.used) return in;
  in.u = face.frame.along_rail;
  in.v = face.frame.along_seat;
  in.plane = face.plane->normal;
  in.u_offset = in.u.dot(face.frame.origin);
  in.v_offset = in.v.dot(face.frame.origin);
  in.plane_offset = face.plane->offset_mm;
  const Eigen::Quaterniond to_scanner = T_block_scanner.rotation.conjugate();
  const std::array<Vec3, 3> directions{to_scanner * in.u, to_scanner * in.v, to_scanner * in.plane};
  for (std::size_t i = 0; i < directions.size(); ++i)
    for (std::size_t c = 0; c < 3; ++c)
      in.directions[i][c] = static_cast<float>(directions[i][static_cast<Eigen::Index>(c)]);
  in.rows = rows;
  in.columns = columns;
  return in;
}

/// Mean size of all third differences.
double mean_of(std::span<const TextureCell> cells) {
  double sum = 0.0;
  double count = 0.0;
  for (const TextureCell& cell : cells) {
    sum += static_cast<double>(cell.sum_mm);
    count += cell.count;
  }
  return count > 0.0 ? sum / count : 0.0;
}

}  // namespace

FilledGaps find_filled_gaps(const Cloud& cloud, const Pose& T_block_scanner, const GapFaces& faces,
                            std::span<TextureCell> cells, Team& team) {
  FilledGaps gaps;
  if (cloud.width < kTileColumns || cloud.height < kTileRows) return gaps;
  std::fill_n(cells.begin(), kGapCells, TextureCell{});
  const auto raster = [&](std::size_t face, std::size_t half, bool columns) {
    return cells.subspan(((face * 2 + half) * 2 + (columns ? 1 : 0)) * kTextureCells, kTextureCells);
  };
  const std::size_t tile_rows = cloud.height / kTileRows;
  const std::size_t tiles = tile_rows * (cloud.width / kTileColumns);
  const std::size_t apart = kTileColumns * std::max<std::size_t>(1, tiles / kTilesWanted);
  team.run(2, [&](std::size_t half) {
    GapPass pass{
        cloud.xyz.data(), cloud.width, half == 0 ? 0 : tile_rows / 2, half == 0 ? tile_rows / 2 : tile_rows, apart,
        T_block_scanner,  {}};
    for (std::size_t i = 0; i < kGapFaces; ++i)
      pass.faces[i] = in_scan(faces[i], T_block_scanner, raster(i, half, false), raster(i, half, true));
    HWY_DYNAMIC_DISPATCH(AddTiles)(pass);
  });
  for (std::size_t i = 0; i < kGapFaces; ++i)
    for (const bool columns : {false, true}) {
      const std::span<TextureCell> sums = raster(i, 0, columns);
      const std::span<const TextureCell> second = raster(i, 1, columns);
      for (std::size_t k = 0; k < kTextureCells; ++k) {
        sums[k].sum_mm += second[k].sum_mm;
        sums[k].count += second[k].count;
      }
      if (!(mean_of(sums) > kNoiseMin_mm * kThirdOfNoise)) continue;
      const FilledPlace found = find_filled(sums, kGapCell_mm);
      if (found.cells > gaps[i].cells || !columns) gaps[i] = found;
    }
  return gaps;
}

}  // namespace slabd::algo

#endif
