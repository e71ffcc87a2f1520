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

/// A line whose robot has errors, mastered and then used as by the daemon: visits from the inspected mastered slab,
/// corrections from the visits, splices by base/calibration.h, one fit of the slab with the uncertainty of each
/// splice. Blocks are either drawn and measured from full scans or computed from the truth.
namespace slabd::accuracy {

struct LineTraits {
  std::uint64_t seed = 1;
  double absolute_mm = 0.7;  ///< smooth robot error over 500 mm, standard deviation per axis; in rotation over 1.5 m
  double repeat_mm = 0.017;  ///< new at every visit, per axis; in rotation over 1.5 m
  int visits = 5;
  Pose X_error;  ///< error of the hand-eye calibration: used = true * error
};

/// One production slab, judged with or without corrections.
struct JudgedSlab {
  SlabResult result;
  std::vector<Splice> splices;
  double seats_rms_mm = 0.0;  ///< rms of the seats in space relative to the truth, after the best rigid motion of all
};

class MasteredLine {
 public:
  /// Measures block `k` of a slab with the assumed scanner pose `T_base_scanner`.
  using Measure = std::function<BlockResult(const emulator::SlabTruth& slab, int k, const Pose& T_base_scanner)>;

  MasteredLine(const Recipe& recipe, const LineTraits& traits, Measure measure);

  /// Masters the line with `visits` visits of the mastered slab; false if the corrections were rejected (`why`).
  [[nodiscard]] bool master(std::string& why);
  [[nodiscard]] const calib::StationsSolution& solution() const { return solution_; }

  /// Casts slab `number` and judges it. `corrected` false: hand-eye calibration only, with the robot's absolute
  /// accuracy.
  [[nodiscard]] JudgedSlab judge(std::uint32_t number, bool corrected, emulator::SlabTruth& truth);

  [[nodiscard]] static emulator::Cell cell();

 private:
  [[nodiscard]] emulator::SlabVariation variation(std::uint32_t number, bool same_slab) const;
  [[nodiscard]] emulator::SlabTruth cast(std::uint32_t number, bool same_slab) const;

  const Recipe& recipe_;
  LineTraits traits_;
  Measure measure_;
  LineCalibration calibration_;
  calib::StationsSolution solution_;
};

/// Computes the block result without a scan: the true features in the frame to which the block would register, with
/// white noise as from a full scan.
[[nodiscard]] BlockResult features_of(const Recipe& recipe, const emulator::SlabTruth& slab, int k,
                                      const Pose& T_base_scanner, Prng& random);

}  // namespace slabd::accuracy
