// SPDX-License-Identifier: Apache-2.0
//
// Problem: a scanner that gives an earlier exposure again, in another format, order or pose, shows a block that is not
// at the station. Equal points are found by a checksum; this finds equal noise.
//
// Idea: what two exposures can have in common is smooth over a few cells: the block's form and texture, the scanner's
// ripple and lens error. Noise is not. So the mean heights of 4 x 4 cells are differenced three times along both axes,
//
//     d = sum_ij k_i k_j h_ij,    k = 1, -3, 3, -1,
//
// which takes out every surface of second degree in x or s exactly, and of a wave of length L the part
// (2 sin(pi cell / L))^6: 0.2 % of the amplitude at L = 8 mm, while white noise grows by 20. The sign of d is kept, so
// that a pore, a grain of dust or an outlier counts no more than any other place. Signs are compared place by place in
// the block's frame: registration repeats to a hundredth of a millimetre, a fiftieth of a cell.
//
// A scan is not decided upon where it holds no noise: d below kFlat_mm is the rounding of its float coordinates.
#include "algo/features/noise_print.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/features/cell_sums.h"

namespace slabd::algo {
namespace {

/// Points further than this from the seat are no noise of it: outliers, damage, an edge.
constexpr float kReach_mm = 0.5F;
constexpr float kUnitsPerMm = 1e5F;
/// A cell with more points than this is left out: its sum could overflow.
constexpr std::uint32_t kCellPointsMax = 32'768;
static_assert(kCellPointsMax * kReach_mm * kUnitsPerMm < 2e9F);
/// Float coordinates of 1 m are rounded to 0.06 um, which makes up to 0.5 um of d.
constexpr double kFlat_mm = 0.002;
/// Points to the mm^2 from which the fine grid is used: four to a cell, and a few percent of cells with one.
constexpr double kFineDensity = 12.0;
constexpr std::array<double, 4> kThird = {1.0, -3.0, 3.0, -1.0};

void sum_up(std::span<const SeatPoints> runs, const CellLayout& layout, std::span<NoiseCell> cells) {
  std::fill(cells.begin(), cells.end(), NoiseCell{});
  std::array<std::int32_t, kCellGroup> cell;
  std::array<float, kCellGroup> height;
  for (const SeatPoints& run : runs) {
    for (std::size_t at = 0; at < run.size(); at += kCellGroup) {
      const std::size_t count = std::min(kCellGroup, run.size() - at);
      place_in_cells({run.x.subspan(at, count), run.s.subspan(at, count), run.h.subspan(at, count)}, layout, cell,
                     height);
      for (std::size_t i = 0; i < count; ++i) {
        if (!(std::abs(height[i]) < kReach_mm)) continue;
        NoiseCell& sum = cells[static_cast<std::size_t>(cell[i])];
        if (sum.points < kCellPointsMax)
          sum.height += static_cast<std::int32_t>(std::floor(height[i] * kUnitsPerMm + 0.5F));
        ++sum.points;
      }
    }
  }
}

/// Returns how many places are known.
template <typename Signs>
std::uint32_t take_signs(const CellLayout& layout, std::span<const NoiseCell> cells, Signs& signs) {
  const auto columns = static_cast<std::size_t>(layout.columns);
  std::uint32_t known = 0;
  std::array<std::array<double, limits::kNoiseWindowX_mm * 2>, 4> mean;
  std::array<std::array<bool, limits::kNoiseWindowX_mm * 2>, 4> seen;
  // Points outside of the window are counted to its border, which is left out.
  for (std::size_t r = 1; r + 1 < Signs::kRows; ++r) {
    for (std::size_t i = 0; i < 4; ++i) {
      const NoiseCell* row = &cells[(2 * r + i) * columns];
      for (std::size_t c = 0; c < columns; ++c) {
        seen[i][c] = row[c].points > 0 && row[c].points < kCellPointsMax;
        mean[i][c] = seen[i][c] ? static_cast<double>(row[c].height) / static_cast<double>(row[c].points) : 0.0;
      }
    }
    for (std::size_t c = 1; c + 1 < Signs::kColumns; ++c) {
      bool all = true;
      double d = 0.0;
      for (std::size_t i = 0; i < 4; ++i) {
        double of_row = 0.0;
        for (std::size_t j = 0; j < 4; ++j) {
          all = all && seen[i][2 * c + j];
          of_row += kThird[j] * mean[i][2 * c + j];
        }
        d += kThird[i] * of_row;
      }
      if (!all || std::abs(d) < kFlat_mm * static_cast<double>(kUnitsPerMm)) continue;
      signs.set(r * Signs::kColumns + c, d > 0.0);
      ++known;
    }
  }
  return known;
}

}  // namespace

void make_noise_print(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& seat,
                      const FlatnessRegion& region, std::span<NoiseCell> cells, Team& team, NoisePrint& out) {
  out = {};
  CellLayout layout;
  layout.half_x_mm = static_cast<float>(limits::kNoiseWindowX_mm) / 2.0F;
  layout.half_s_mm = static_cast<float>(limits::kNoiseWindowS_mm) / 2.0F;
  layout.by_x = static_cast<float>(seat.normal.dot(frame.along_rail));
  layout.by_s = static_cast<float>(seat.normal.dot(frame.along_seat));
  layout.by_h = static_cast<float>(seat.normal.dot(frame.up));
  layout.offset_mm = static_cast<float>(seat.normal.dot(frame.origin) - seat.offset_mm);
  if (!(layout.by_h > 0.5F)) return;
  const auto with_cells = [&](double cell_mm) {
    CellLayout cells_of = layout;
    cells_of.cells_per_mm = static_cast<float>(1.0 / cell_mm);
    cells_of.columns = static_cast<std::int32_t>(static_cast<double>(limits::kNoiseWindowX_mm) / cell_mm);
    cells_of.rows = static_cast<std::int32_t>(static_cast<double>(limits::kNoiseWindowS_mm) / cell_mm);
    return cells_of;
  };
  std::size_t points = 0;
  for (const SeatPoints& run : runs) points += run.size();
  const double density = static_cast<double>(points) / (4.0 * region.half_x_mm * region.half_s_mm);
  std::uint32_t coarse = 0;
  team.run(density >= kFineDensity ? 2 : 1, [&](std::size_t which) {
    if (which == 0) {
      const std::span<NoiseCell> own = cells.subspan(kNoiseFineCells, kNoiseCoarseCells);
      sum_up(runs, with_cells(0.75), own);
      coarse = take_signs(with_cells(0.75), own, out.coarse);
    } else {
      const std::span<NoiseCell> own = cells.first(kNoiseFineCells);
      sum_up(runs, with_cells(0.5), own);
      static_cast<void>(take_signs(with_cells(0.5), own, out.fine));
    }
  });
  // With fewer places nothing could be compared.
  if (coarse < limits::kNoisePlacesMin)
    out = {};
  else
    out.places = coarse;
}

}  // namespace slabd::algo
