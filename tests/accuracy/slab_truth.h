// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <set>

#include "emulator/slab_scene.h"

/// What a perfect instrument would report of a slab: the items' definitions applied to where the blocks really stand,
/// by a plain solver and without a line of algo.
namespace slabd::accuracy {

class SlabTruthItems {
 public:
  /// `displaced`: stations that the slab frame and the rows' parabolas must not follow, because a defect was planted
  /// there.
  SlabTruthItems(const Recipe& recipe, const simulate::SlabTruth& slab, const std::set<int>& displaced);

  /// True value of a slab-scope item or of the slope in the slab frame; NaN for others.
  [[nodiscard]] double value(ItemId id, int station) const;

 private:
  const Recipe& recipe_;
  const simulate::SlabTruth& slab_;
  std::array<Vec3, limits::kStationsMax> off_{};             ///< seat in the fitted frame minus nominal, slab axes
  std::array<double, limits::kStationsMax> off_parabola_{};  ///< height over the row's parabola
  Mat3 into_frame_ = Mat3::Identity();                       ///< rotation from slab axes as cast to the fitted frame
};

}  // namespace slabd::accuracy
