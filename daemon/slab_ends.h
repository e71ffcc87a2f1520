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

/// Two slab types may have the same seats and differ only in the position of the slab's ends. A slab begun under the
/// wrong type would pass, unless the scans at its ends show which type it is.
namespace slabd::daemon {

/// Two recipes whose blocks and their relative positions are the same within a casting's tolerances: a slab of one
/// type, measured as the other, shows no error.
struct AlikeRecipes {
  const Recipe* a = nullptr;
  const Recipe* b = nullptr;
  /// True if the slab's ends differ by enough for scans to distinguish them, if the scans reach that far. False: no
  /// scan distinguishes the types.
  bool ends_differ = false;
};
/// All such pairs, by ascending slab type. The pointers refer to `recipes`.
[[nodiscard]] std::vector<AlikeRecipes> alike_recipes(std::span<const Recipe> recipes);
/// One sentence for the log, the status and checks.
[[nodiscard]] FixedString<limits::kErrorTextBytes> text_of(const AlikeRecipes& alike);

/// The slab top next to one block, along the rail: [0] towards -x of the block, [1] towards +x.
struct TopView {
  bool seen = false;
  std::array<double, 2> reach_mm{};  ///< from the block to the end of its top or of the scan; 0: not seen
  std::array<double, 2> last_mm{};   ///< to the last top that was seen, also after gaps
  std::array<bool, 2> goes_on{};     ///< there are points beyond that end, lower or after a gap
  double axis_x_mm = 0.0;            ///< intersection of the scanner's axis with the top
  double distance_mm = 0.0;          ///< along that axis
  Vec3 turned = Vec3::UnitX();       ///< the scanner's x axis in the block's frame
};
/// Profile of the top from the points of a registered scan. `xyz`: scanner frame, NaN for missing points. No heap; uses
/// at most 600,000 points.
[[nodiscard]] TopView look_at_top(std::span<const float> xyz, const Pose& T_block_scanner, const BlockGeometry& block);

/// Compares the slab ends in the scans of one slab with its recipe and with similar recipes. Used by the measuring
/// thread only; no heap.
class SlabEnds {
 public:
  struct Finding {
    const Recipe* other = nullptr;  ///< the recipe that matches the end, unlike the slab's own; null: no contradiction
    int station = 0;                ///< station whose scan shows the end
    double seen_mm = 0.0;           ///< from the block to the end of the top
    double own_mm = 0.0;            ///< according to the slab's recipe
    double other_mm = 0.0;
    bool top_goes_on = false;  ///< the top was seen beyond the own end, but its own end was not seen
  };

  /// Sets the recipe of the next slabs. Clears all views.
  void use(std::span<const Recipe> recipes, const Recipe& recipe);
  /// True if other recipes differ from this one only in the slab's ends.
  [[nodiscard]] bool is_needed() const { return !rivals_.empty(); }
  /// Stores the view of the scan of `station` and checks all ends seen so far. Another slab key clears the earlier
  /// views.
  [[nodiscard]] Finding note(std::int64_t slab_key, int station, const TopView& view);
  /// After the slab's last station: how far the scans reached if each end was scanned and no scan reached an end. NaN
  /// if an end was seen, or if not all stations were noted.
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
