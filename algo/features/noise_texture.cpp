// SPDX-License-Identifier: Apache-2.0
//
// Problem: many scanner programs fill gaps, smooth, round and resample before they write. A filled gap shows a perfect
// surface where nothing was seen; an average over neighbours makes a bump of a single wrong point. The points alone
// look right.
//
// Idea: measured points have noise of their own, computed points do not. Along a row of the scan the distances r of the
// points from the face's plane are differenced,
//
//     d1 = r2 - r1,    d2 = r3 - 2 r2 + r1,    d3 = r4 - 3 r3 + 3 r2 - r1,
//
// which removes the surface's form. The mean size of d3 per place is the noise there. On real concrete and on drawn
// blocks, no place of 4 mm has less than 0.75 of the usual noise; a filled one has almost none. The ratio of d2 to d1
// shows how far neighbours share their noise, and the distribution of d1 whether heights are in steps.
// drawn blocks no place of 4 mm has less than 0.75 of the usual one, a filled one has nothing. The sizes of d2 against
// those of d1 say how far neighbours share their noise, and the distribution of d1 whether heights stand in steps.
#include "algo/features/noise_texture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algo/median.h"

namespace slabd::algo {
namespace {

/// Points further than this from the plane are not its noise: outliers, damage, an edge.
constexpr float kReach_mm = 0.5F;
/// Neighbours are at most this far apart, and their steps are similar.
constexpr float kStepMax_mm = 3.0F;
constexpr float kStepsAlike = 0.5F;
constexpr std::size_t kLooked = 80'000;
/// Points in a row that are looked at together. Short, so that every place has several.
constexpr std::size_t kStretch = 16;
/// Less noise than this is the rounding of float coordinates.
constexpr double kNoiseMin_mm = 0.0005;
/// Of the usual noise: a place with less was computed.
constexpr float kFilledShare = 0.3F;
constexpr std::uint32_t kCellCountMin = 12;
constexpr std::uint32_t kFilledCellsMin = 4;
/// Sizes of differences: bins of a fiftieth of the first ones' mean.
constexpr std::size_t kBins = 1'024;
constexpr double kBinsPerMean = 50.0;
/// Mean size of a normal variable, and the factor of d3 on white noise.
constexpr double kMeanSize = 0.7979;
constexpr double kThirdDifference = 4.4721;

class Look {
 public:
  Look(const TextureQuestion& question, std::span<TextureCell> cells)
      : normal_(question.normal.cast<float>()), offset_(static_cast<float>(question.offset_mm)), cells_(cells) {
    std::fill(cells_.begin(), cells_.end(), TextureCell{});
  }

  /// Four points from `i` on, if they are neighbours in one row.
  template <typename Use>
  void four(const SeatPoints& run, std::size_t i, const Use& use) const {
    std::array<float, 4> r;
    for (std::size_t k = 0; k < 4; ++k) {
      r[k] = normal_.x() * run.x[i + k] + normal_.y() * run.s[i + k] + normal_.z() * run.h[i + k] - offset_;
      if (!(std::abs(r[k]) < kReach_mm)) return;
    }
    const float x1 = run.x[i + 1] - run.x[i];
    const float s1 = run.s[i + 1] - run.s[i];
    const float step = std::max(std::abs(x1), std::abs(s1));
    if (!(step > 0.0F && step < kStepMax_mm)) return;
    for (std::size_t k = 1; k < 3; ++k) {
      const float x2 = run.x[i + k + 1] - run.x[i + k];
      const float s2 = run.s[i + k + 1] - run.s[i + k];
      if (std::max(std::abs(x2 - x1), std::abs(s2 - s1)) > kStepsAlike * step) return;
    }
    use(r, run.x[i + 1], run.s[i + 1]);
  }

  void add(const std::array<float, 4>& r, float x, float s, float per_bin) {
    const float d1 = r[1] - r[0];
    const float d2 = r[2] - 2.0F * r[1] + r[0];
    const float d3 = std::abs(r[3] - 3.0F * r[2] + 3.0F * r[1] - r[0]);
    ++count_;
    third_ += static_cast<double>(d3);
    ++first_[std::min(static_cast<std::size_t>(std::abs(d1) * per_bin), kBins - 1)];
    ++second_[std::min(static_cast<std::size_t>(std::abs(d2) * per_bin), kBins - 1)];
    constexpr float kPerCell = 1.0F / static_cast<float>(kTextureCell_mm);
    const float column = x * kPerCell + static_cast<float>(kTextureColumns) / 2.0F;
    const float row = s * kPerCell + static_cast<float>(kTextureRows) / 2.0F;
    if (!(column >= 0.0F && column < static_cast<float>(kTextureColumns) && row >= 0.0F &&
          row < static_cast<float>(kTextureRows)))
      return;
    TextureCell& cell = cells_[static_cast<std::size_t>(row) * kTextureColumns + static_cast<std::size_t>(column)];
    cell.sum_mm += d3;
    ++cell.count;
  }

  [[nodiscard]] NoiseTexture answer(double bin_mm) const {
    NoiseTexture texture;
    texture.looked_at = count_;
    if (count_ < kTextureMin) return texture;
    texture.sigma_mm = third_ / static_cast<double>(count_) / kMeanSize / kThirdDifference;
    const double usual_mm = size_of_share(first_, 0.5, bin_mm);
    const double ratio = size_of_share(second_, 0.5, bin_mm) / usual_mm;
    texture.lag_ratio = ratio * ratio;
    texture.step_mm = size_of_share(first_, 0.95, bin_mm);
    texture.rest_ratio = usual_mm / texture.step_mm;
    return texture;
  }

 private:
  /// The size that this share of the differences stays below.
  [[nodiscard]] double size_of_share(const std::array<std::uint32_t, kBins>& bins, double share, double bin_mm) const {
    const double wanted = share * static_cast<double>(count_);
    double below = 0.0;
    for (std::size_t i = 0; i < kBins; ++i) {
      const auto here = static_cast<double>(bins[i]);
      if (below + here >= wanted) return bin_mm * (static_cast<double>(i) + (wanted - below) / here);
      below += here;
    }
    return bin_mm * static_cast<double>(kBins);
  }

  Eigen::Vector3f normal_;
  float offset_;
  std::span<TextureCell> cells_;
  std::size_t count_ = 0;
  std::array<std::uint32_t, kBins> first_{};  ///< by size
  std::array<std::uint32_t, kBins> second_{};
  double third_ = 0.0;
};

/// One stretch of `apart`, in no order: rows of a fitting length would put every `apart`th into the same columns.
bool is_chosen(std::size_t stretch, std::size_t apart) {
  return (std::uint64_t{stretch} * 0x9E37'79B9'7F4A'7C15U >> 32U) % apart == 0;
}

/// Mean size of the third differences in a place; NaN if too few were examined.
float mean_of(const TextureCell& cell) {
  return cell.count < kCellCountMin ? std::numeric_limits<float>::quiet_NaN()
                                    : cell.sum_mm / static_cast<float>(cell.count);
}

/// The usual noise of a place: the median of all.
float usual_of(std::span<const TextureCell> cells) {
  std::array<double, kTextureCells> means;
  std::size_t count = 0;
  for (const TextureCell& cell : cells)
    if (const float mean = mean_of(cell); has_value(static_cast<double>(mean)))
      means[count++] = static_cast<double>(mean);
  return count == 0 ? 0.0F : static_cast<float>(median_of(std::span(means).first(count)));
}

/// Finds groups of adjacent places with hardly any noise. Marks counted ones by a negative sum.
FilledPlace filled_places(std::span<TextureCell> cells, float limit) {
  FilledPlace largest;
  double area_mm2 = 0.0;
  std::array<std::uint16_t, kTextureCells> waiting;
  const auto is_filled = [&](std::size_t i) { return cells[i].sum_mm >= 0.0F && mean_of(cells[i]) < limit; };
  for (std::size_t start = 0; start < cells.size(); ++start) {
    if (!is_filled(start)) continue;
    std::size_t count = 0;
    std::size_t low_column = kTextureColumns;
    std::size_t high_column = 0;
    std::size_t low_row = kTextureRows;
    std::size_t high_row = 0;
    std::size_t left = 0;
    const auto take = [&](std::size_t i) {
      cells[i].sum_mm = -1.0F;
      waiting[left++] = static_cast<std::uint16_t>(i);
    };
    take(start);
    while (left > 0) {
      const std::size_t i = waiting[--left];
      const std::size_t column = i % kTextureColumns;
      const std::size_t row = i / kTextureColumns;
      ++count;
      low_column = std::min(low_column, column);
      high_column = std::max(high_column, column);
      low_row = std::min(low_row, row);
      high_row = std::max(high_row, row);
      if (column > 0 && is_filled(i - 1)) take(i - 1);
      if (column + 1 < kTextureColumns && is_filled(i + 1)) take(i + 1);
      if (row > 0 && is_filled(i - kTextureColumns)) take(i - kTextureColumns);
      if (row + 1 < kTextureRows && is_filled(i + kTextureColumns)) take(i + kTextureColumns);
    }
    if (count < kFilledCellsMin) continue;
    area_mm2 += static_cast<double>(count) * kTextureCell_mm * kTextureCell_mm;
    if (count <= largest.cells) continue;
    const auto middle = [](std::size_t low, std::size_t high, std::size_t all) {
      return kTextureCell_mm * 0.5 * (static_cast<double>(low + high + 1) - static_cast<double>(all));
    };
    largest.cells = static_cast<std::uint32_t>(count);
    largest.x_mm = middle(low_column, high_column, kTextureColumns);
    largest.s_mm = middle(low_row, high_row, kTextureRows);
    largest.width_mm = kTextureCell_mm * static_cast<double>(high_column + 1 - low_column);
    largest.length_mm = kTextureCell_mm * static_cast<double>(high_row + 1 - low_row);
  }
  largest.area_mm2 = area_mm2;
  return largest;
}

}  // namespace

TextureQuestion question_of(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& plane) {
  const Vec3& n = plane.normal;
  return {
      runs, {n.dot(frame.along_rail), n.dot(frame.along_seat), n.dot(frame.up)}, plane.offset_mm - n.dot(frame.origin)};
}

double hidden_step_mm(const NoiseTexture& texture) {
  // On real concrete, with grain, dust and noise of three times the usual, the ratio is 0.28 or more.
  constexpr double kStepped = 0.12;
  return texture.rest_ratio < kStepped ? texture.step_mm : 0.0;
}

NoiseTexture look_at_texture(const TextureQuestion& question, std::span<TextureCell> cells) {
  std::size_t points = 0;
  for (const SeatPoints& run : question.runs) points += run.size();
  const std::size_t every = std::max<std::size_t>(1, points / kLooked);
  Look look(question, cells);
  const auto for_fours = [&](std::size_t apart, const auto& use) {
    std::size_t at = 0;  // of all runs' points
    for (const SeatPoints& run : question.runs) {
      for (std::size_t i = 0; i + 4 <= run.size();) {
        const std::size_t stretch = (at + i) / kStretch;
        const std::size_t end = (stretch + 1) * kStretch - at;
        if (!is_chosen(stretch, apart)) {
          i = end;
          continue;
        }
        for (; i < end && i + 4 <= run.size(); ++i) look.four(run, i, use);
      }
      at += run.size();
    }
  };
  // How fine the bins have to be.
  double size = 0.0;
  std::size_t count = 0;
  for_fours(32 * every, [&](const std::array<float, 4>& r, float, float) {
    size += static_cast<double>(std::abs(r[1] - r[0]));
    ++count;
  });
  const double mean = count == 0 ? 0.0 : size / static_cast<double>(count);
  if (!(mean > 0.0)) return {};
  const double bin_mm = mean / kBinsPerMean;
  for_fours(every, [&](const std::array<float, 4>& r, float x, float s) {
    look.add(r, x, s, static_cast<float>(1.0 / bin_mm));
  });
  NoiseTexture texture = look.answer(bin_mm);
  if (!(texture.sigma_mm > kNoiseMin_mm)) return texture;
  texture.filled = filled_places(cells, kFilledShare * usual_of(cells));
  return texture;
}

}  // namespace slabd::algo
