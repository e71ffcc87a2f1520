// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "base/dither.h"
#include "base/fixed.h"
#include "base/limits.h"
#include "base/pose.h"

/// Checks by the pose from which stop a registered block was seen.
///
/// Problem: a scanner may return the previous frame, one block's scan repeatedly, or recorded scans, and the robot's
/// poses may be replayed. Good blocks look alike, so such a scan would pass for the requested block.
///
/// Idea: if stops differ (`slabctl stations` plans them so), each of them sees its block in another position. The slab
/// is near its nominal place: one rigid displacement for all blocks, which the scans of this slab show. A scan is
/// refused if two conditions hold. Its block is where another stop would see it, within the noise; and it is not where
/// its own stop would see it, by more than a seat may be out of place.
///
/// A seat that is out of place is a defect to be measured. Therefore a scan is never refused for less than kSeatOff_mm
/// and kSeatOff_rad, nor for a position that matches no other stop.
namespace slabd::daemon {

/// Displacement and rotation of a seat up to which it is always measured.
inline constexpr double kSeatOff_mm = 2.0;
inline constexpr double kSeatOff_rad = 0.25 * kPi / 180.0;

/// Block of one scan.
struct View {
  bool seen = false;
  Pose T_base_scanner;   ///< of the stop, from the robot's pose
  Pose T_base_block;     ///< nominal pose of the stop's block
  Pose T_scanner_block;  ///< pose of the block in the scan
};
using SlabViews = std::array<View, limits::kStationsMax>;  ///< [station - 1]

/// Earlier views, for comparison with a new one.
struct Views {
  SlabViews slab{};               ///< accepted views of the open slab
  SlabViews last{};               ///< of the preceding slab
  FixedVector<View, 6> recent{};  ///< the last scans that showed a block, including refused ones; oldest first

  /// Makes the open slab the last one, if it has any view.
  void begin_slab();
  void keep(int station, const View& view, bool is_refused);
};

/// Result of a comparison.
struct ViewFinding {
  bool is_refused = false;
  int station = 0;            ///< the other stop; 0: an earlier scan
  bool of_last_slab = false;  ///< the block is one of the preceding slab
  double own_off_mm = 0.0;    ///< from the position that its own stop would see
  double own_off_rad = 0.0;
  double other_off_mm = 0.0;  ///< from the position that the other stop would see
  double other_off_rad = 0.0;
};

/// Compares the view of `station`'s scan with all others. About 20 us, no heap.
[[nodiscard]] ViewFinding compare_view(const Views& views, int station, const View& view);
/// The finding in words, for the log.
[[nodiscard]] FixedString<limits::kErrorTextBytes> text_of(const ViewFinding& finding, int station);

/// True if these stops differ by enough for a view to prove which one it is from.
[[nodiscard]] bool stops_differ(const View& a, const View& b);
/// The first station, from 1, whose stop does not differ from the next one's (the last one's from the first). 0 if all
/// differ, or if fewer than two were seen.
[[nodiscard]] int stop_like_the_next(const SlabViews& views);

}  // namespace slabd::daemon
