// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "algo/algo.h"
#include "base/calibration.h"
#include "calib/calib.h"
#include "emulator/slab_scene.h"

/// A line with a robot that is off, mastered and then used as the daemon uses it: visits from the inspected mastered
/// slab, corrections from the visits, splices by base/calibration.h, one fit of the slab with what each splice is
/// worth. What a scan shows is either drawn and measured in full, or put together from the truth.
namespace slabd::accuracy {

struct LineTraits {
  std::uint64_t seed = 1;
  double absolute_mm = 0.7;  ///< smooth robot error over 500 mm, standard deviation per axis; in rotation over 1.5 m
  double repeat_mm = 0.017;  ///< new at every visit, per axis; in rotation over 1.5 m
  int visits = 5;
  Pose X_error;  ///< what the hand-eye calibration is wrong by: used = true * error
};

/// One production slab, judged with or without corrections.
struct JudgedSlab {
  SlabResult result;
  std::vector<Splice> splices;
  double seats_rms_mm = 0.0;  ///< seats in space against the truth after the best rigid motion of all
};

class MasteredLine {
 public:
  /// Measures block `k` of a slab with the scanner taken to stand at `T_base_scanner`.
  using Measure = std::function<BlockResult(const simulate::SlabTruth& slab, int k, const Pose& T_base_scanner)>;

  MasteredLine(const Recipe& recipe, const LineTraits& traits, Measure measure);

  /// The mastered slab goes through `visits` times; false when the corrections were refused (`why`).
  [[nodiscard]] bool master(std::string& why);
  [[nodiscard]] const calib::StationsSolution& solution() const { return solution_; }

  /// Casts slab `number` and judges it. `corrected` false: the hand-eye alone, with the robot's absolute accuracy.
  [[nodiscard]] JudgedSlab judge(std::uint32_t number, bool corrected, simulate::SlabTruth& truth);

  [[nodiscard]] static simulate::Cell cell();

 private:
  [[nodiscard]] simulate::SlabVariation variation(std::uint32_t number, bool same_slab) const;
  [[nodiscard]] simulate::SlabTruth cast(std::uint32_t number, bool same_slab) const;

  const Recipe& recipe_;
  LineTraits traits_;
  Measure measure_;
  LineCalibration calibration_;
  calib::StationsSolution solution_;
};

/// Measures without a scan: the features as they really are, in the frame the block would register to, with white noise
/// of a full scan's size.
[[nodiscard]] BlockResult features_of(const Recipe& recipe, const simulate::SlabTruth& slab, int k,
                                      const Pose& T_base_scanner, Prng& random);

}  // namespace slabd::accuracy
