// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <set>

#include "emulator/slab_scene.h"

/// Slab items of an ideal measurement: the items' definitions applied to the true positions of the blocks, with a
/// simple solver and without code of algo.
namespace slabd::accuracy {

class SlabTruthItems {
 public:
  /// `displaced`: stations that are left out of the slab frame and the rows' parabolas, because they have a planted
  /// defect.
  SlabTruthItems(const Recipe& recipe, const emulator::SlabTruth& slab, const std::set<int>& displaced);

  /// True value of a slab-scope item or of the slope in the slab frame; NaN for others.
  [[nodiscard]] double value(ItemId id, int station) const;

 private:
  const Recipe& recipe_;
  const emulator::SlabTruth& slab_;
  std::array<Vec3, limits::kStationsMax> off_{};             ///< seat in the fitted frame minus nominal, slab axes
  std::array<double, limits::kStationsMax> off_parabola_{};  ///< height over the row's parabola
  Mat3 into_frame_ = Mat3::Identity();                       ///< rotation from slab axes as cast to the fitted frame
};

}  // namespace slabd::accuracy
