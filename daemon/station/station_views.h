// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "base/dither.h"
#include "base/fixed.h"
#include "base/limits.h"
#include "base/pose.h"

/// The pose proves the scan: from which stop a registered block was seen.
///
/// Problem: a scanner may hand out the frame before, one block's scan again and again, or scans of a log, and the
/// robot's poses may be replayed ones. Good blocks look alike, so such a scan would pass for the block that was asked
/// for.
///
/// Idea: where stops differ (`slabctl stations` plans them so), each of them sees its block in another place. The slab
/// lies somewhere near its nominal place: one rigid displacement for all blocks, which the scans of this slab show. A
/// scan is refused when its block lies where another stop would see it, within the noise, and does not lie where its
/// own stop would see it, by more than a seat may be out of place.
///
/// A seat that is out of place is a defect to be measured. Therefore a scan is never refused for less than kSeatOffMm
/// and kSeatOffRad, nor for a place that no other stop explains.
namespace slabd::daemon {

/// A seat may be this far out of place, or be turned by this much, and is measured.
inline constexpr double kSeatOffMm = 2.0;
inline constexpr double kSeatOffRad = 0.25 * kPi / 180.0;

/// One scan's block.
struct View {
  bool seen = false;
  Pose T_base_scanner;   ///< of the stop, by the robot's pose
  Pose T_base_block;     ///< nominal place of the block that this stop looks at
  Pose T_scanner_block;  ///< where the scan shows a block
};
using SlabViews = std::array<View, limits::kStationsMax>;  ///< [station - 1]

/// The views that a new one is compared with.
struct Views {
  SlabViews slab{};               ///< of the open slab, those that were accepted
  SlabViews last{};               ///< of the slab before
  FixedVector<View, 6> recent{};  ///< the last scans that showed a block, refused ones too; oldest first

  /// The open slab, if it has any view, becomes the last one.
  void begin_slab();
  void keep(int station, const View& view, bool is_refused);
};

/// What a view says of its scan.
struct ViewFinding {
  bool is_refused = false;
  int station = 0;            ///< the other stop's; 0: an earlier scan's
  bool of_last_slab = false;  ///< the block is one of the slab before
  double own_off_mm = 0.0;    ///< from where its own stop would see the block,
  double own_off_rad = 0.0;
  double other_off_mm = 0.0;  ///< and from where the other one would
  double other_off_rad = 0.0;
};

/// Compares the view of `station`'s scan with all others. Some 20 us, no heap.
[[nodiscard]] ViewFinding compare_view(const Views& views, int station, const View& view);
/// The finding in words, for the log.
[[nodiscard]] FixedString<limits::kErrorTextBytes> text_of(const ViewFinding& finding, int station);

/// Do these stops differ by so much that a view proves which of them it is from?
[[nodiscard]] bool stops_differ(const View& a, const View& b);
/// The first station, from 1, whose stop does not differ from the next one's (the last one's from the first); 0: each
/// one does, or fewer than two were seen.
[[nodiscard]] int stop_like_the_next(const SlabViews& views);

}  // namespace slabd::daemon
