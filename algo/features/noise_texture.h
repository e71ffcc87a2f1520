// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/features/seat_points.h"

/// Detects earlier processing of a scan by a scanner's program, from the noise of neighbouring points.
namespace slabd::algo {

/// Input for one face: its points in the order of the scan, and the fitted plane, in the frame of the
/// points.
struct TextureInput {
  std::span<const SeatPoints> runs;
  Vec3 normal = Vec3::UnitZ();  ///< x, s, h
  double offset_mm = 0.0;
};

/// The largest place without noise.
struct FilledPlace {
  std::uint32_t cells = 0;  ///< 0 if none was found
  double area_mm2 = 0.0;    ///< of all such places
  double x_mm = 0.0;        ///< its middle
  double s_mm = 0.0;
  double width_mm = 0.0;  ///< its extent along x and s
  double length_mm = 0.0;
  double noisy_mm = 0.0;  ///< noise of a point at the noisier places: reached by a fifth of them
};

struct NoiseTexture {
  std::size_t looked_at = 0;   ///< number of neighbours; below kTextureMin the result is unknown
  double sigma_mm = kNoValue;  ///< of a point, without the part shared with its neighbours
  /// Variance of second differences over that of first ones, from their medians: 3 for white noise, 2 after averaging
  /// of neighbours, less after smoothing with soft borders.
  double lag_ratio = kNoValue;
  /// Median size of the first differences over their 95 % quantile: 0.34 for normal noise. Rounded values differ by
  /// nothing or by a whole step, which gives a ratio near 0, even after a smooth correction.
  double rest_ratio = kNoValue;
  double step_mm = kNoValue;  ///< 95 % quantile of the size of the first differences
  FilledPlace filled;
};

/// Rounded coordinates hide places without noise if their step is more than this many standard deviations, because
/// with less noise whole places have one value.
inline constexpr double kStepOfNoiseMax = 1.0;
inline constexpr std::size_t kTextureMin = 2'000;
/// Side of a place; fewer than four adjacent ones are chance.
inline constexpr double kTextureCell_mm = 4.0;
inline constexpr std::size_t kTextureColumns = 48;
inline constexpr std::size_t kTextureRows = 80;
inline constexpr std::size_t kTextureCells = kTextureColumns * kTextureRows;

struct TextureCell {
  float sum_mm = 0.0F;  ///< of the sizes of third differences
  std::uint32_t count = 0;
};

/// Number of points in a row that are examined together. Short, so that every place has several.
inline constexpr std::size_t kTextureStretch = 16;
inline constexpr std::size_t kTextureBins = 1'024;
using TextureBins = std::array<std::uint32_t, kTextureBins>;

/// Sums over neighbours: four points in a row.
struct TextureSums {
  std::span<TextureCell> cells;
  std::size_t count = 0;
  double sizes = 0.0;   ///< of first differences
  double third = 0.0;   ///< sizes of third differences
  TextureBins first{};  ///< first differences by size
  TextureBins second{};
};

/// Input for a face that was fitted in the block's frame.
[[nodiscard]] TextureInput input_of(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& plane);

/// Step (mm) of heights in steps although no coordinate is a multiple of one; 0 if the heights have none.
[[nodiscard]] double hidden_step_mm(const NoiseTexture& texture);

/// Less noise than this is the rounding of float coordinates.
inline constexpr double kNoiseMin_mm = 0.0005;
/// Mean size of the third differences of white noise, in standard deviations: sqrt(20) times that of a normal variable.
inline constexpr double kThirdOfNoise = 0.7979 * 4.4721;

/// Finds groups of adjacent places with hardly any noise beside the other places; at most 80 % of the face. `cells`:
/// kTextureCells, of `cell_mm` each; changes their sums.
[[nodiscard]] FilledPlace find_filled(std::span<TextureCell> cells, double cell_mm);

/// Examines about 80,000 neighbours. `cells`: kTextureCells, scratch. No heap, one thread, 0.5 ms.
[[nodiscard]] NoiseTexture look_at_texture(const TextureInput& input, std::span<TextureCell> cells);

}  // namespace slabd::algo
