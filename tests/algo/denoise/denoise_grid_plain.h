// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/denoise/denoise_grid.h"

/// The judging of an organised scan's points written down as it is meant: point by point, one comparison each, every
/// neighbour counted. What algo/denoise/denoise_grid_points.cpp must agree with.
namespace slabd::algo::plain {

/// Why a point stays or goes: the first rule that decided.
enum class Verdict : std::uint8_t {
  missing,     ///< no height; is left as it is
  calm,        ///< on the only plane of a tile that has few points off it
  explained,   ///< a plane of the nine tiles around goes through it
  reigning,    ///< ... with the smaller share that will do for the plane that reigns in the tile
  beside,      ///< ... or stands around a point next to it
  through,     ///< in company, and a surface of no tile goes through it
  alone,       ///< noise without company
  no_surface,  ///< noise in company
  damage,      ///< noise by the rules above that hangs together over a length
};
inline constexpr std::size_t kVerdicts = 9;

[[nodiscard]] inline bool is_noise(Verdict verdict) {
  return verdict == Verdict::alone || verdict == Verdict::no_surface;
}

struct Judged {
  std::vector<bool> off;  ///< finite, and on none of its tile's planes
  std::vector<Verdict> verdict;
};

/// Judges the points of a grid of heights `z`, row by row. Of `work` it reads the planes of the tiles and the pitch; no
/// mask and no mark. `alike_are_one`: a plane that is much like one that was asked is not asked, as the rule has it.
[[nodiscard]] Judged judge_points(const GridLayout& grid, const GridWork& work, std::span<const float> z,
                                  bool alike_are_one = true);

}  // namespace slabd::algo::plain
