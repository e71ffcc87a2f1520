// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/denoise/denoise_grid.h"

/// Judgement of an organised scan's points by definition: point by point, one comparison each, counting every
/// neighbour. Reference for algo/denoise/denoise_grid_points.cpp.
namespace slabd::algo::plain {

/// Reason to keep or remove a point: the first rule that decided.
enum class Verdict : std::uint8_t {
  missing,     ///< without height; unchanged
  calm,        ///< on the only plane of a tile with few points off it
  explained,   ///< a plane of the nine tiles around goes through it
  reigning,    ///< ... with the smaller share for the dominating plane of the tile
  beside,      ///< ... or is inside the surface at an adjacent point
  through,     ///< in company, and a surface of no tile goes through it
  alone,       ///< noise without company
  no_surface,  ///< noise in company
  damage,      ///< noise by the rules above, but connected over a length
};
inline constexpr std::size_t kVerdicts = 9;

[[nodiscard]] inline bool is_noise(Verdict verdict) {
  return verdict == Verdict::alone || verdict == Verdict::no_surface;
}

struct Judged {
  std::vector<bool> off;  ///< finite, and on none of its tile's planes
  std::vector<Verdict> verdict;
};

/// Judges the points of a grid of heights `z`, row by row. Of `work` it reads only the planes of the tiles and the
/// pitch, not masks or marks. `alike_are_one`: planes similar to a tested one are not tested, as in the rule.
[[nodiscard]] Judged judge_points(const GridLayout& grid, const GridWork& work, std::span<const float> z,
                                  bool alike_are_one = true);

}  // namespace slabd::algo::plain
