// SPDX-License-Identifier: Apache-2.0
//
// Sorting needs three values first: the extent of the field (strays may be anywhere), its density, and a cell size that
// does not exceed the maximum number of cells. Each is found by counting, so the results do not depend on the order of
// the points.
#include "algo/denoise/point_grid.h"

#include <cmath>

namespace slabd::algo {
namespace {

/// Size of the bins that count the field's extent, +-1 km.
constexpr float kExtentBin_mm = 4.0F;
/// The central 98 % along each axis, and a twentieth more on each side; strays beyond are counted in the border cells.
constexpr std::size_t kTailShare = 100;
constexpr float kMarginShare = 0.05F;
/// Density is measured in cells that contain at least this many points each.
constexpr float kDensityCell_mm = 4.0F;
constexpr std::uint32_t kDensityPoints = 16;
constexpr int kDensityDoublings = 8;

bool missing(const float* p) {
  return std::isnan(p[0]);
}

}  // namespace

void PointGrid::find_extent(const float* xyz, std::size_t points) {
  const std::span<std::uint32_t> bins = cell_start_.first(limits::kDenoiseCellsMax);
  const int half = static_cast<int>(bins.size() / 2);
  const auto along = [&](std::size_t axis, float& low, float& high) {
    std::fill(bins.begin(), bins.end(), 0U);
    std::size_t finite = 0;
    for (std::size_t i = 0; i < points; ++i) {
      if (missing(xyz + 3 * i)) continue;
      ++finite;
      ++bins[static_cast<std::size_t>(
          clamped(xyz[3 * i + axis] / kExtentBin_mm + static_cast<float>(half), static_cast<int>(bins.size())))];
    }
    const std::size_t tail = finite / kTailShare;
    std::size_t first = 0;
    for (std::size_t seen = bins[0]; seen <= tail; seen += bins[first]) ++first;
    std::size_t last = bins.size() - 1;
    for (std::size_t seen = bins[last]; seen <= tail; seen += bins[last]) --last;
    low = kExtentBin_mm * static_cast<float>(static_cast<int>(first) - half);
    high = kExtentBin_mm * static_cast<float>(static_cast<int>(last) + 1 - half);
    const float margin = kMarginShare * (high - low) + kExtentBin_mm;
    low -= margin;
    high += margin;
  };
  along(0, x0_, x1_);
  along(1, y0_, y1_);
}

/// Sets columns and rows of cells of at least `cell_mm`, at most limits::kDenoiseCellsMax cells.
void PointGrid::lay_out(float cell_mm) {
  const double wide_mm = static_cast<double>(x1_) - static_cast<double>(x0_);
  const double high_mm = static_cast<double>(y1_) - static_cast<double>(y0_);
  const auto cells_max = static_cast<double>(limits::kDenoiseCellsMax);
  // Two per cent more than the area requires, and at least what the longer side requires: nearly never too many cells.
  double mm = std::max(static_cast<double>(cell_mm), 1.02 * std::sqrt(wide_mm * high_mm / cells_max));
  mm = std::max(mm, 4.0 * std::max(wide_mm, high_mm) / cells_max);
  const auto count = [&](double length_mm) { return std::max(1, static_cast<int>(std::ceil(length_mm / mm))); };
  columns_ = count(wide_mm);
  rows_ = count(high_mm);
  while (cells() > limits::kDenoiseCellsMax) {
    mm *= 1.1;
    columns_ = count(wide_mm);
    rows_ = count(high_mm);
  }
  per_mm_ = static_cast<float>(1.0 / mm);
}

/// Counts the points of cell c in cell_start_[c + 1].
void PointGrid::count_points(const float* xyz, std::size_t points) {
  std::fill(cell_start_.begin(), cell_start_.begin() + static_cast<std::ptrdiff_t>(cells() + 1), 0U);
  for (std::size_t i = 0; i < points; ++i)
    if (!missing(xyz + 3 * i)) ++cell_start_[cell_of(xyz + 3 * i) + 1];
}

void PointGrid::find_pitch(const float* xyz, std::size_t points) {
  float cell_mm = kDensityCell_mm;
  for (int doubling = 0;; ++doubling, cell_mm *= 2.0F) {  // NOLINT(cert-flp30-c): doubling is exact
    lay_out(cell_mm);
    count_points(xyz, points);
    const auto begin = cell_start_.begin() + 1;
    const auto end = std::remove(begin, begin + static_cast<std::ptrdiff_t>(cells()), 0U);
    const auto middle = begin + (end - begin) / 2;
    std::nth_element(begin, middle, end);
    pitch_mm_ = 1.0F / (per_mm_ * std::sqrt(static_cast<float>(*middle)));
    if (*middle >= kDensityPoints || cells() == 1 || doubling == kDensityDoublings) return;
  }
}

/// Counting sort: the points of cell c are order_[start[c] .. start[c + 1]).
void PointGrid::sort_points(const float* xyz, std::size_t points) {
  count_points(xyz, points);
  const std::span<std::uint32_t> start = cell_start_.first(cells() + 1);
  for (std::size_t c = 0; c < cells(); ++c) start[c + 1] += start[c];
  // Filled from the back: each cell's end moves to its start.
  const std::uint32_t sorted = start[cells()];
  for (std::size_t i = points; i-- > 0;)
    if (!missing(xyz + 3 * i)) order_[--start[cell_of(xyz + 3 * i) + 1]] = static_cast<std::uint32_t>(i);
  for (std::size_t c = 0; c < cells(); ++c) start[c] = start[c + 1];
  start[cells()] = sorted;
}

void PointGrid::build(const float* xyz, std::size_t points, float cell_pitches) {
  find_extent(xyz, points);
  find_pitch(xyz, points);
  lay_out(cell_pitches * pitch_mm_);
  sort_points(xyz, points);
}

void PointGrid::widen(const float* xyz, std::size_t points, float times, float cell_pitches) {
  pitch_mm_ *= times;
  lay_out(cell_pitches * pitch_mm_);
  sort_points(xyz, points);
}

}  // namespace slabd::algo
