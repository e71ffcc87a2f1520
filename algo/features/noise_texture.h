// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/features/seat_points.h"

/// What a scanner's program has done to a scan before slabd read it, by the noise of points that are neighbours.
namespace slabd::algo {

/// A face whose noise is looked at: its points in the order of the scan, and the plane that was fitted through them, in
/// the frame of the points.
struct TextureQuestion {
  std::span<const SeatPoints> runs;
  Vec3 normal = Vec3::UnitZ();  ///< x, s, h
  double offset_mm = 0.0;
};

/// The largest place without noise.
struct FilledPlace {
  std::uint32_t cells = 0;  ///< 0: none
  double area_mm2 = 0.0;    ///< of all such places
  double x_mm = 0.0;        ///< its middle
  double s_mm = 0.0;
  double width_mm = 0.0;  ///< its extent along x and s
  double length_mm = 0.0;
};

struct NoiseTexture {
  std::size_t looked_at = 0;   ///< neighbours; with fewer than kTextureMin nothing is known
  double sigma_mm = kNoValue;  ///< of a point, as far as its neighbours do not share it
  /// Variance of second differences over that of first ones, by their medians: 3 for white noise, 2 after a mean of
  /// neighbours, less after a smoothing with soft borders.
  double lag_ratio = kNoValue;
  /// Median of the first differences' sizes over the size that 95 % of them stay below: 0.34 for normal noise. Values
  /// that were rounded differ by nothing or by a whole step: towards 0, whatever smooth correction came after.
  double rest_ratio = kNoValue;
  double step_mm = kNoValue;  ///< the size that 95 % of the first differences stay below
  FilledPlace filled;
};

/// Rounded coordinates hide places without noise where their step is more than this many standard deviations: less
/// noise leaves whole places on one value.
inline constexpr double kStepOfNoiseMax = 2.0;
inline constexpr std::size_t kTextureMin = 2'000;
/// Side of a place; less than four of them in a row are chance.
inline constexpr double kTextureCell_mm = 4.0;
inline constexpr std::size_t kTextureColumns = 48;
inline constexpr std::size_t kTextureRows = 80;
inline constexpr std::size_t kTextureCells = kTextureColumns * kTextureRows;

struct TextureCell {
  float sum_mm = 0.0F;  ///< of the sizes of third differences
  std::uint32_t count = 0;
};

/// Points in a row that are looked at together. Short, so that every place has several.
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

/// Of a face that was fitted in the block's frame.
[[nodiscard]] TextureQuestion question_of(std::span<const SeatPoints> runs, const SeatFrame& frame,
                                          const PlaneFit& plane);

/// Heights that stand in steps at least this large (mm), though no coordinate is a multiple of one; 0: they do not.
[[nodiscard]] double hidden_step_mm(const NoiseTexture& texture);

/// Looks at some 80,000 neighbours. `cells`: kTextureCells, scratch. No heap, one thread, 0.5 ms.
[[nodiscard]] NoiseTexture look_at_texture(const TextureQuestion& question, std::span<TextureCell> cells);

}  // namespace slabd::algo
