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
//
// Sixteen quadruples, which begin at consecutive points, are processed together.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/features/noise_texture.cpp"
#include <hwy/foreach_target.h>
//
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "algo/features/noise_texture.h"
#include "algo/lanes-inl.h"
#include "algo/median.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

/// Points further than this from the plane are not its noise: outliers, damage, an edge.
constexpr float kReach_mm = 0.5F;
/// Neighbours are at most this far apart, and their steps are similar.
constexpr float kStepMax_mm = 3.0F;
constexpr float kStepsAlike = 0.5F;
/// A quadruple starts at each point of a stretch, and extends beyond it by this.
constexpr std::size_t kBeyond = 3;
static_assert(kTextureStretch == kLanes);

/// Sixteen quadruples: sizes of their first and third differences, the bins of the first and the second ones, and the
/// cell. Bit k is set if the k-th consists of neighbours in one row, and if it is in a cell.
struct Fours {
  alignas(64) std::array<float, kLanes> first, third;
  alignas(64) std::array<std::int32_t, kLanes> first_bin, second_bin, cell;
  std::uint32_t used = 0;
  std::uint32_t in_cell = 0;
};

class Look {
 public:
  Look(const TextureInput& input, float per_bin)
      : n_{f16(static_cast<float>(input.normal.x())), f16(static_cast<float>(input.normal.y())),
           f16(static_cast<float>(input.normal.z()))},
        offset_(f16(static_cast<float>(input.offset_mm))),
        per_bin_(f16(per_bin)) {}

  /// Calls `use(fours)` for the chosen stretches of a run that begins `at` points after the first one.
  template <typename Use>
  HWY_INLINE void over(const SeatPoints& run, std::size_t at, std::uint32_t apart, const Use& use) const {
    if (run.size() <= kBeyond) return;
    const std::size_t last = run.size() - kBeyond;
    for (std::size_t i = 0; i < last;) {
      const std::size_t stretch = (at + i) / kLanes;
      const std::size_t end = std::min((stretch + 1) * kLanes - at, last);
      if (is_chosen(stretch, apart)) use(look(run, i, end - i));
      i = end;
    }
  }

 private:
  /// Selects one stretch of `apart`, pseudo-randomly: with rows of an unlucky length every `apart`th stretch would be
  /// in the same columns.
  static HWY_INLINE bool is_chosen(std::size_t stretch, std::uint32_t apart) {
    return static_cast<std::uint32_t>(std::uint64_t{stretch} * 0x9E37'79B9'7F4A'7C15U >> 32U) % apart == 0;
  }
  /// Quadruples that begin at the `count` points from the i-th on.
  HWY_INLINE Fours look(const SeatPoints& run, std::size_t i, std::size_t count) const {
    if (count == kLanes) return look(&run.x[i], &run.s[i], &run.h[i]);
    std::array<std::array<float, kLanes + kBeyond>, 3> room{};
    std::copy_n(&run.x[i], count + kBeyond, room[0].begin());
    std::copy_n(&run.s[i], count + kBeyond, room[1].begin());
    std::copy_n(&run.h[i], count + kBeyond, room[2].begin());
    Fours fours = look(room[0].data(), room[1].data(), room[2].data());
    fours.used &= (1U << count) - 1U;
    return fours;
  }
  HWY_INLINE Fours look(const float* x, const float* s, const float* h) const {
    const auto off = [&](std::size_t k) {
      return n_[0] * load(x + k) + n_[1] * load(s + k) + n_[2] * load(h + k) - offset_;
    };
    const auto step = [](const float* v, std::size_t k) { return load(v + k + 1) - load(v + k); };
    const F16 r0 = off(0), r1 = off(1), r2 = off(2), r3 = off(3);
    const F16 x1 = step(x, 0);
    const F16 s1 = step(s, 0);
    const F16 size = max(abs(x1), abs(s1));
    const auto alike = [&](std::size_t k) {
      return max(abs(step(x, k) - x1), abs(step(s, k) - s1)) <= f16(kStepsAlike) * size;
    };
    const F16 reach = f16(kReach_mm);
    Fours fours;
    fours.used = bits((abs(r0) < reach) & (abs(r1) < reach) & (abs(r2) < reach) & (abs(r3) < reach) &
                      (size > f16(0.0F)) & (size < f16(kStepMax_mm)) & alike(1) & alike(2));
    const F16 d1 = abs(r1 - r0);
    const F16 d2 = abs(r2 - f16(2.0F) * r1 + r0);
    store(d1, fours.first.data());
    store(abs(r3 - f16(3.0F) * r2 + f16(3.0F) * r1 - r0), fours.third.data());
    const auto bin_of = [&](const F16& d) {
      return to_int(min(d * per_bin_, f16(static_cast<float>(kTextureBins - 1))));
    };
    store(bin_of(d1), fours.first_bin.data());
    store(bin_of(d2), fours.second_bin.data());
    constexpr float kPerCell = 1.0F / static_cast<float>(kTextureCell_mm);
    constexpr auto kColumns = static_cast<float>(kTextureColumns);
    constexpr auto kRows = static_cast<float>(kTextureRows);
    const F16 column = load(x + 1) * f16(kPerCell) + f16(kColumns / 2.0F);
    const F16 row = load(s + 1) * f16(kPerCell) + f16(kRows / 2.0F);
    const F16 zero = f16(0.0F);
    const M16 inside = (column >= zero) & (column < f16(kColumns)) & (row >= zero) & (row < f16(kRows));
    fours.in_cell = bits(inside);
    store(to_int(keep(inside, floor(row) * f16(kColumns) + floor(column))), fours.cell.data());
    return fours;
  }

  std::array<F16, 3> n_;
  F16 offset_;
  F16 per_bin_;
};

/// Counts the chosen quadruples of a run and adds up the sizes of their first differences.
void AddSizes(const TextureInput& input, const SeatPoints& run, std::size_t at, std::uint32_t apart,
              TextureSums& sums) {
  Look(input, 0.0F).over(run, at, apart, [&](const Fours& fours) {
    sums.count += static_cast<std::size_t>(std::popcount(fours.used));
    for (std::uint32_t left = fours.used; left != 0; left &= left - 1)
      sums.sizes += static_cast<double>(fours.first[static_cast<std::size_t>(std::countr_zero(left))]);
  });
}

/// Adds the chosen quadruples of a run to everything but `sums.sizes`.
void AddFours(const TextureInput& input, const SeatPoints& run, std::size_t at, std::uint32_t apart, float per_bin,
              TextureSums& sums) {
  double third = sums.third;
  Look(input, per_bin).over(run, at, apart, [&](const Fours& fours) {
    sums.count += static_cast<std::size_t>(std::popcount(fours.used));
    for (std::uint32_t left = fours.used; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      third += static_cast<double>(fours.third[k]);
      ++sums.first[static_cast<std::size_t>(fours.first_bin[k])];
      ++sums.second[static_cast<std::size_t>(fours.second_bin[k])];
    }
    for (std::uint32_t left = fours.used & fours.in_cell; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      TextureCell& cell = sums.cells[static_cast<std::size_t>(fours.cell[k])];
      cell.sum_mm += fours.third[k];
      ++cell.count;
    }
  });
  sums.third = third;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(AddSizes);
HWY_EXPORT(AddFours);
namespace {

constexpr std::size_t kLooked = 80'000;
/// Share of the noise of half of the places: a place with less was computed. If half of the face was, the noisier
/// fifth shows it; noise may differ between places, so the share is smaller.
constexpr double kFilledShare = 0.3;
constexpr double kFilledShareOfNoisy = 0.1;
constexpr std::uint32_t kCellCountMin = 12;
constexpr std::uint32_t kFilledCellsMin = 4;
/// Bins for the sizes of differences: a fiftieth of the mean first difference.
constexpr double kBinsPerMean = 50.0;

/// Quantile of the differences: the size below which this share of them is.
double size_of_share(const TextureBins& bins, double share, std::size_t count, double bin_mm) {
  const double wanted = share * static_cast<double>(count);
  double below = 0.0;
  for (std::size_t i = 0; i < kTextureBins; ++i) {
    const auto here = static_cast<double>(bins[i]);
    if (below + here >= wanted) return bin_mm * (static_cast<double>(i) + (wanted - below) / here);
    below += here;
  }
  return bin_mm * static_cast<double>(kTextureBins);
}

NoiseTexture texture_of(const TextureSums& sums, double bin_mm) {
  NoiseTexture texture;
  texture.looked_at = sums.count;
  if (sums.count < kTextureMin) return texture;
  texture.sigma_mm = sums.third / static_cast<double>(sums.count) / kThirdOfNoise;
  const double usual_mm = size_of_share(sums.first, 0.5, sums.count, bin_mm);
  const double ratio = size_of_share(sums.second, 0.5, sums.count, bin_mm) / usual_mm;
  texture.lag_ratio = ratio * ratio;
  texture.step_mm = size_of_share(sums.first, 0.95, sums.count, bin_mm);
  texture.rest_ratio = usual_mm / texture.step_mm;
  return texture;
}

/// Mean size of the third differences in a place; NaN if too few were examined.
float mean_of(const TextureCell& cell) {
  return cell.count < kCellCountMin ? std::numeric_limits<float>::quiet_NaN()
                                    : cell.sum_mm / static_cast<float>(cell.count);
}

/// Means of the third differences that half and a fifth of the places reach.
struct UsualThirds {
  double half_mm = 0.0;
  double fifth_mm = 0.0;
};
UsualThirds usual_thirds(std::span<const TextureCell> cells) {
  std::array<double, kTextureCells> means;
  std::size_t count = 0;
  for (const TextureCell& cell : cells)
    if (const float mean = mean_of(cell); has_value(static_cast<double>(mean)))
      means[count++] = static_cast<double>(mean);
  if (count == 0) return {};
  const std::span<const double> all = std::span(means).first(count);
  return {median_of(all), value_at_rank(all, count * 4 / 5)};
}

}  // namespace

TextureInput input_of(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& plane) {
  const Vec3& n = plane.normal;
  return {
      runs, {n.dot(frame.along_rail), n.dot(frame.along_seat), n.dot(frame.up)}, plane.offset_mm - n.dot(frame.origin)};
}

double hidden_step_mm(const NoiseTexture& texture) {
  // On real concrete, with grain, dust and noise of three times the usual, the ratio is 0.28 or more.
  constexpr double kStepped = 0.12;
  return texture.rest_ratio < kStepped ? texture.step_mm : 0.0;
}

FilledPlace find_filled(std::span<TextureCell> cells, double cell_mm) {
  const UsualThirds usual = usual_thirds(cells);
  const auto limit = static_cast<float>(std::max(kFilledShare * usual.half_mm, kFilledShareOfNoisy * usual.fifth_mm));
  FilledPlace largest;
  double area_mm2 = 0.0;
  std::array<std::uint16_t, kTextureCells> waiting;
  // Marks counted ones by a negative sum.
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
    area_mm2 += static_cast<double>(count) * cell_mm * cell_mm;
    if (count <= largest.cells) continue;
    const auto middle = [cell_mm](std::size_t low, std::size_t high, std::size_t all) {
      return cell_mm * 0.5 * (static_cast<double>(low + high + 1) - static_cast<double>(all));
    };
    largest.cells = static_cast<std::uint32_t>(count);
    largest.x_mm = middle(low_column, high_column, kTextureColumns);
    largest.s_mm = middle(low_row, high_row, kTextureRows);
    largest.width_mm = cell_mm * static_cast<double>(high_column + 1 - low_column);
    largest.length_mm = cell_mm * static_cast<double>(high_row + 1 - low_row);
  }
  largest.area_mm2 = area_mm2;
  largest.noisy_mm = usual.fifth_mm / kThirdOfNoise;
  return largest;
}

NoiseTexture look_at_texture(const TextureInput& input, std::span<TextureCell> cells) {
  std::size_t points = 0;
  for (const SeatPoints& run : input.runs) points += run.size();
  const auto every = static_cast<std::uint32_t>(std::max<std::size_t>(1, points / kLooked));
  const auto for_runs = [&](const auto& add) {
    std::size_t at = 0;  // of all runs' points
    for (const SeatPoints& run : input.runs) {
      add(run, at);
      at += run.size();
    }
  };
  // Finds the size of the bins.
  TextureSums sums{cells};
  for_runs([&](const SeatPoints& run, std::size_t at) {
    HWY_DYNAMIC_DISPATCH(AddSizes)(input, run, at, 32 * every, sums);
  });
  const double mean = sums.count == 0 ? 0.0 : sums.sizes / static_cast<double>(sums.count);
  if (!(mean > 0.0)) return {};
  const double bin_mm = mean / kBinsPerMean;
  std::fill(cells.begin(), cells.end(), TextureCell{});
  sums.count = 0;
  for_runs([&](const SeatPoints& run, std::size_t at) {
    HWY_DYNAMIC_DISPATCH(AddFours)(input, run, at, every, static_cast<float>(1.0 / bin_mm), sums);
  });
  NoiseTexture texture = texture_of(sums, bin_mm);
  if (!(texture.sigma_mm > kNoiseMin_mm)) return texture;
  texture.filled = find_filled(cells, kTextureCell_mm);
  return texture;
}

}  // namespace slabd::algo

#endif
