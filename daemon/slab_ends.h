// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/fixed.h"
#include "base/limits.h"
#include "base/recipe.h"

/// Two slab types may have the same seats and differ only in where the slab ends. A slab that was begun under the other
/// type passes then, unless the scans at its ends show which of the two it is.
namespace slabd::daemon {

/// Two recipes whose blocks, and their places to one another, are the same within a casting's tolerances: a slab of one
/// type, measured as the other, shows nothing wrong.
struct AlikeRecipes {
  const Recipe* a = nullptr;
  const Recipe* b = nullptr;
  /// The slab ends at places that scans tell apart, if they reach so far. False: no scan tells the two apart.
  bool ends_differ = false;
};
/// Of all pairs, by ascending slab type. Pointers into `recipes`.
[[nodiscard]] std::vector<AlikeRecipes> alike_recipes(std::span<const Recipe> recipes);
/// One sentence for the log, the status and checks.
[[nodiscard]] FixedString<limits::kErrorTextBytes> text_of(const AlikeRecipes& alike);

/// The slab top beside one block, along the rail: [0] towards -x of the block, [1] towards +x.
struct TopView {
  bool seen = false;
  std::array<double, 2> reach_mm{};  ///< from the block to where its top or the scan ends; 0: not seen
  std::array<double, 2> last_mm{};   ///< to the last top that was seen, behind gaps too
  std::array<bool, 2> goes_on{};     ///< there are points beyond that end, lower or behind a gap
  double axis_x_mm = 0.0;            ///< where the scanner's axis meets the top
  double distance_mm = 0.0;          ///< along that axis
  Vec3 turned = Vec3::UnitX();       ///< the scanner's x axis in the block's frame
};
/// `xyz`: points of a registered scan, scanner frame, NaN for missing ones. No heap; looks at 600,000 points at most.
[[nodiscard]] TopView look_at_top(std::span<const float> xyz, const Pose& T_block_scanner, const BlockGeometry& block);

/// Holds the slab ends that the scans of one slab show against its recipe and those that are like it. Belongs to the
/// measuring thread; no heap.
class SlabEnds {
 public:
  struct Finding {
    const Recipe* other = nullptr;  ///< the recipe that the end fits, unlike the slab's own; null: no contradiction
    int station = 0;                ///< whose scan shows the end
    double seen_mm = 0.0;           ///< from the block to the end of the top
    double own_mm = 0.0;            ///< by the slab's recipe
    double other_mm = 0.0;
    bool top_goes_on = false;  ///< the top was seen beyond the own end, and not to where it ends
  };

  /// The slabs to come have this recipe. Forgets everything.
  void use(std::span<const Recipe> recipes, const Recipe& recipe);
  /// There are recipes that only the slab's ends tell from this one.
  [[nodiscard]] bool is_needed() const { return !rivals_.empty(); }
  /// Notes what the scan of `station` shows and looks at all ends seen so far. Another slab key begins anew.
  [[nodiscard]] Finding note(std::int64_t slab_key, int station, const TopView& view);
  /// After the slab's last station: a scan of each end was noted, and none reached an end. How far they reached; NaN:
  /// an end was seen, or not all stations were noted.
  [[nodiscard]] double blind_reach_mm() const;

 private:
  static constexpr std::size_t kRivalsMax = 16;
  [[nodiscard]] bool end_was_proven(int station, std::size_t side, double other_mm) const;

  const Recipe* recipe_ = nullptr;
  FixedVector<const Recipe*, kRivalsMax> rivals_;
  std::int64_t slab_key_ = 0;
  std::array<TopView, limits::kStationsMax> views_{};  ///< [station - 1]
};
[[nodiscard]] FixedString<limits::kErrorTextBytes> text_of(const SlabEnds::Finding& finding, const Recipe& own);

}  // namespace slabd::daemon
