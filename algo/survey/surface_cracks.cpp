// SPDX-License-Identifier: Apache-2.0
//
// Problem: a crack is narrower than a cell of the raster, and may return no points at all. In any one cell it is not to
// be told from noise.
//
// Idea: it is long. Two cells wide and three long (4 mm) is a window; what its surface lacks beside the windows at its
// left and right is evidence. Evidence less a limit is summed up along the best path, by dynamic programming: noise
// comes to nothing within a few steps, a crack of 25 mm does not. What is compact, as a pore or a drop of water, does
// not reach the length.
#include "algo/survey/surface_cracks.h"

#include <algorithm>
#include <cmath>

namespace slabd::algo {
namespace {

/// Lacking share of a window from which it speaks for a crack, at least. A crack of 0.8 mm takes 0.32; the grid of a
/// scan of 0.35 mm pitch makes it 0.06 (1 sigma).
constexpr float kLimitMin = 0.15F;
/// Pixels of 0.5 mm lie in steps against the cells: every few windows a whole line of them lacks up to 0.2. The limit
/// is so much of what is exceeded by one window in twenty.
constexpr float kOfScatter = 1.25F;
/// With a higher limit a crack of 0.8 mm is not told from the grid.
constexpr float kLimitMax = 0.26F;
/// No window speaks for more than this, so that a hole is not a crack.
constexpr float kMost = 0.45F;
/// Sum over a path from which it is a crack, and its least length in steps: 26 mm.
constexpr float kStrengthMin = 1.5F;
constexpr std::size_t kStepsMin = 7;
/// Mean over a path beyond the limit, and how straight it is: a path through an area that returns unevenly has neither.
constexpr float kMeanMin = 0.035F;
constexpr double kStraight = 0.7;
constexpr float kAside = 0.025F;  ///< cost of a cell to the side
/// Cells between a window and those beside it.
constexpr std::size_t kGap = 1;
constexpr std::size_t kWidth = 2;
constexpr std::size_t kReach = 3;  ///< how far a path may move in a step
constexpr float kWholeMin = 0.5F;  ///< of a window beside, so that the lack is not its own

struct Node {
  float strength = 0.0F;
  std::uint8_t from = 0;  ///< kReach + how far the path moved; kStart: it begins here
  static constexpr std::uint8_t kStart = 255;
};

/// The raster read along either axis.
struct View {
  const SurfaceField& field;
  bool along_y;
  std::size_t across;
  std::size_t steps;

  [[nodiscard]] std::size_t cell(std::size_t step, std::size_t k, std::size_t at) const {
    const std::size_t along = kCrackStep * step + k;
    return along_y ? along * kSurfaceColumns + at : at * kSurfaceColumns + along;
  }
  /// Along an edge the surface is bent, which is no crack; a crack may reach a jaw's foot, though.
  [[nodiscard]] bool is_asked(std::size_t cell) const {
    const SurfaceZone zone = field.zone[cell];
    return zone == SurfaceZone::face || zone == SurfaceZone::shoulder ||
           (along_y && (zone == SurfaceZone::foot || zone == SurfaceZone::upper_edge));
  }
};

/// Share of the surface in each cell of a step, its three cells together; negative: not asked.
void gather(const View& view, std::size_t step, std::span<float> whole) {
  for (std::size_t at = 0; at < view.across; ++at) {
    float sum = 0.0F;
    for (std::size_t k = 0; k < kCrackStep; ++k) {
      const std::size_t cell = view.cell(step, k, at);
      sum = view.is_asked(cell) ? sum + view.field.whole[cell] : -100.0F;
    }
    whole[at] = sum / static_cast<float>(kCrackStep);
  }
}

/// What the window at `at` lacks beside its neighbours, or a negative number.
float lack(std::span<const float> whole, std::size_t at) {
  constexpr std::size_t kFlank = kWidth + kGap;
  if (at < kFlank || at + kFlank + kWidth > whole.size()) return -1.0F;
  const auto window = [&](std::size_t i) { return 0.5F * (whole[i] + whole[i + 1]); };
  const float here = window(at);
  const float left = window(at - kFlank);
  const float right = window(at + kFlank);
  if (here < 0.0F || left < kWholeMin || right < kWholeMin) return -1.0F;
  // An area that returns less is bordered by a step, not by a line.
  const float beside = std::min(0.5F * (left + right), 1.15F * std::min(left, right));
  return std::min(1.0F - here / beside, kMost);
}

/// What one window in twenty lacks more than.
float usual_lack(std::span<const float> lacks) {
  constexpr std::size_t kBins = 128;
  constexpr float kBinsPerShare = static_cast<float>(kBins) / kMost;
  std::array<std::uint32_t, kBins> counts{};
  std::uint32_t asked = 0;
  for (const float lack : lacks) {
    if (lack <= -1.0F) continue;
    ++asked;
    ++counts[std::min(static_cast<std::size_t>(std::max(lack, 0.0F) * kBinsPerShare), kBins - 1)];
  }
  std::uint32_t above = 0;
  for (std::size_t k = kBins; k-- > 0;) {
    above += counts[k];
    if (20 * above >= asked) return static_cast<float>(k + 1) / kBinsPerShare;
  }
  return 0.0F;
}

bool is_straight(const CrackPath& path) {
  const auto steps = static_cast<double>(kCrackStep);
  double length = 0.0;
  for (std::size_t k = 1; k < path.steps; ++k)
    length += std::hypot(steps, static_cast<double>(path.at[k]) - static_cast<double>(path.at[k - 1]));
  const double across = static_cast<double>(path.at[path.steps - 1U]) - static_cast<double>(path.at[0]);
  return std::hypot(steps * (path.steps - 1), across) >= kStraight * length;
}

}  // namespace

bool find_cracks(const SurfaceField& field, bool along_y, std::span<std::byte> memory, CrackPaths& paths) {
  paths.clear();
  const View view{field, along_y, along_y ? kSurfaceColumns : kSurfaceRows,
                  (along_y ? kSurfaceRows : kSurfaceColumns) / kCrackStep};
  constexpr std::size_t kWindows = kSurfaceCells / kCrackStep;
  static_assert(kWindows * (sizeof(Node) + sizeof(float)) <= kCrackBytes);
  static_assert(kSurfaceRows / kCrackStep <= CrackPath::kStepsMax);
  auto* nodes = reinterpret_cast<Node*>(memory.data());
  auto* lacks = reinterpret_cast<float*>(memory.data() + kWindows * sizeof(Node));
  std::array<float, std::max(kSurfaceRows, kSurfaceColumns)> whole;
  for (std::size_t step = 0; step < view.steps; ++step) {
    gather(view, step, std::span(whole).first(view.across));
    for (std::size_t at = 0; at < view.across; ++at)
      lacks[step * view.across + at] = lack(std::span(whole).first(view.across), at);
  }

  const float limit =
      std::max(kLimitMin, kOfScatter * usual_lack(std::span<const float>(lacks, view.steps * view.across)));
  if (limit > kLimitMax) return false;

  // A strong path may be too short to be a crack; then it is passed over.
  for (std::size_t tries = 0; tries < 2 * kCracksMax && paths.size() < kCracksMax; ++tries) {
    std::size_t best = 0;
    float strongest_before = 0.0F;
    for (std::size_t step = 0; step < view.steps; ++step) {
      float strongest = 0.0F;
      for (std::size_t at = 0; at < view.across; ++at) {
        const std::size_t i = step * view.across + at;
        Node node{0.0F, Node::kStart};
        // Hardly a window has evidence, and hardly a path goes on.
        if (lacks[i] - limit + strongest_before <= 0.0F) {
          nodes[i] = node;
          continue;
        }
        if (strongest_before > 0.0F) {
          const Node* before = nodes + (step - 1) * view.across;
          const std::size_t low = at - std::min(at, kReach);
          const std::size_t high = std::min(at + kReach, view.across - 1);
          for (std::size_t k = low; k <= high; ++k) {
            const float strength = before[k].strength - kAside * static_cast<float>(k > at ? k - at : at - k);
            if (strength > node.strength) node = {strength, static_cast<std::uint8_t>(kReach + k - at)};
          }
        }
        node.strength = std::max(0.0F, node.strength + lacks[i] - limit);
        if (node.strength == 0.0F) node.from = Node::kStart;
        nodes[i] = node;
        strongest = std::max(strongest, node.strength);
        if (node.strength > nodes[best].strength) best = i;
      }
      strongest_before = strongest;
    }
    if (!(nodes[best].strength >= kStrengthMin)) return true;
    CrackPath path;
    path.along_y = along_y;
    path.strength = static_cast<double>(nodes[best].strength);
    std::size_t step = best / view.across;
    std::size_t at = best % view.across;
    // From its end to its beginning, and then turned round. What was followed is not found again.
    for (;;) {
      path.at[path.steps++] = static_cast<std::uint16_t>(at);
      path.first = static_cast<std::uint16_t>(step);
      float& own = lacks[step * view.across + at];
      path.missing += static_cast<double>(std::max(own, 0.0F)) * static_cast<double>(kWidth * kCrackStep);
      const std::uint8_t from = nodes[step * view.across + at].from;
      const std::size_t low = at - std::min(at, 2 * kReach);
      const std::size_t high = std::min(at + 2 * kReach, view.across - 1);
      for (std::size_t k = low; k <= high; ++k)
        lacks[step * view.across + k] = std::min(lacks[step * view.across + k], 0.0F);
      if (from == Node::kStart || step == 0) break;
      at = at + from - kReach;
      --step;
    }
    std::reverse(path.at.begin(), path.at.begin() + path.steps);
    if (path.steps >= kStepsMin && path.strength >= static_cast<double>(kMeanMin) * path.steps && is_straight(path))
      (void)paths.push(path);
  }
  return true;
}

}  // namespace slabd::algo
