// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "algo/algo.h"
#include "algo/items/slab_fit.h"
#include "algo/items/uncertainty.h"

/// Uncertainty of measurements between stations. A slab item is, near its value, a sum over stations of gradients times
/// errors. The frame is a fit of the same stations, so its error is such a sum too, and every station affects an item:
///
///   v = sum_k gp_k . dp_k + gn_k . dn_k + gj_k . dj_k,   g = own + frame' (d frame / d observation k)
///
/// with dp, dn, dj the errors of station k's seat reference point, seat normal and outer jaw point, in slab axes:
///
///   dp = t_k + e_p          t_k, w_k   translation and rotation of the station's splice: one of each per station, so
///   dn = w_k x n + e_n                 common motion of point, jaw and plane cancels. They are at the block's origin;
///   dj = t_k + w_k x l + e_j           l is the jaw point relative to it
///   e                       noise inside the scan (SeatObservation::sigma_*) and the scanner's form
///
/// The station's part of the sum is |gp + gj|^2 s_t^2 + |n x gn + l x gj|^2 s_w^2.
///
/// A part of all stations of the second arm together is `tie`, the place of its robot's base. A small motion of that
/// base, t and w about the tie's centre (slab axes), displaces all their observations. With p and l + p the seat and
/// the jaw point relative to the centre and C the covariance of (t, w):
///
///   g_t = sum_k gp + gj,   g_w = sum_k p x gp + (p + l) x gj + n x gn,   u^2 = [g_t g_w]' C [g_t g_w]
///
/// The sums are over the second arm's stations. A motion common to all stations changes no item, because the frame
/// moves with it; only what is across the tie counts.
///
/// A part of all stations of one arm together is the drift of its scanner since the acceptance (uncertainty.h). It
/// displaces every block along the view by up to e d, with d the distance of the scanner. Between stations of one arm
/// that cancels. With stations of both, per arm and independent: u^2 = (e d)^2 / 3 (sum_k n . (gp + gj))^2, in the part
/// `scanner`.
///
/// One part does not come from stations: the frame's roll, if the slab's top contradicts it (check_roll). It is the
/// part `registration`, which for a slab is the frame: u = |d item / d roll| u_roll.
namespace slabd::algo {

/// One station's errors by origin. Variances in mm^2 and rad^2, per axis (slab axes; block axes differ in sign only).
struct StationErrors {
  Vec3 p_noise = Vec3::Constant(kNoValue);
  Vec3 n_noise = Vec3::Constant(kNoValue);
  Vec3 jaw_noise = Vec3::Constant(kNoValue);
  double noise_factor = kNoValue;
  Vec3 place = Vec3::Zero();      ///< of the block's origin, slab frame
  Vec3 normal = Vec3::UnitZ();    ///< of the seat
  Vec3 jaw_lever = Vec3::Zero();  ///< from the block's origin to its outer jaw point
  /// Effect of the scanner's form on the jaw point: per shift of jaw and seat, and per tilt of the seat, which
  /// determines the reference height at the jaw (mm).
  double jaw_per_shift = 1.0;
  double jaw_per_tilt_mm = 0.0;
};

/// Gradient of one item with respect to all observations; [station], 1-based.
struct SlabGradient {
  using PerStation = std::array<Vec3, limits::kStationsMax + 1>;
  PerStation p = zeros();
  PerStation n = zeros();
  PerStation jaw = zeros();
  FrameVector frame = FrameVector::Zero();  ///< with respect to a small motion of the slab frame, see FrameResponse

 private:
  static PerStation zeros() {
    PerStation z;
    z.fill(Vec3::Zero());
    return z;
  }
};

class SlabBudget {
 public:
  /// `sigmas`: [station - 1]; a station beyond the span is not calibrated.
  /// `arms`: the tie is not used before `set_tie`.
  SlabBudget(const Recipe& recipe, const SlabArms& arms, std::span<const StationSigma> sigmas);

  [[nodiscard]] const StationSigma& sigma(int station) const { return sigma_[static_cast<std::size_t>(station)]; }

  /// Stores one station's errors; call for every observed station before `known_*` or `budget`.
  void set(int station, const StationErrors& errors);
  /// Sets the frame's response to the station; without it the frame counts as free of error.
  void set(int station, const FrameResponse& response);
  /// Sets the standard uncertainty of the frame's roll about X beyond that from the stations.
  void set_roll(double u_rad) { u_roll_rad_ = u_rad; }

  /// Sets the tie of the second arm in the frame of the slab. Without it an item across the arms has no budget.
  void set_tie(const TieNumbers& tie, const Pose& T_base_slab);

  /// Contribution of the tie to an item (k = 1, mm or rad). 0 on a slab that one arm scanned; not finite if the tie is
  /// required and its covariance is not known.
  [[nodiscard]] double of_tie(const SlabGradient& gradient) const;

  /// Contribution of the frame's roll to an item (k = 1, mm or rad); also available without a budget.
  [[nodiscard]] double of_roll(const SlabGradient& gradient) const;

  /// Standard uncertainties of point and normal, from all known origins: the weights of the slab fit.
  [[nodiscard]] Vec3 known_p_mm(int station) const;
  [[nodiscard]] Vec3 known_n_rad(int station) const;

  /// The item's parts, lengths in mm, angles in rad (`unit` converts). Not finite if a required value is unknown.
  [[nodiscard]] Budget budget(const SlabGradient& gradient, double unit) const;

 private:
  /// Gradients of an item by one station's observations, the motion of the frame included.
  struct AtStation {
    Vec3 p;
    Vec3 n;
    Vec3 jaw;
    [[nodiscard]] bool is_zero() const { return p.isZero(0.0) && n.isZero(0.0) && jaw.isZero(0.0); }
  };
  [[nodiscard]] AtStation at_station(const SlabGradient& gradient, std::size_t k) const;
  /// Variance (mm^2) by the drift of the arms' scanners against each other; 0 on a slab that one arm scanned.
  [[nodiscard]] double between_scanners(const SlabGradient& gradient) const;
  [[nodiscard]] const ScannerModel& scanner_at(std::size_t k) const { return scanner_[sigma_[k].arm]; }

  UncertaintySettings settings_;
  std::array<ScannerModel, limits::kArmsMax> scanner_;          ///< [arm]
  std::array<StationSigma, limits::kStationsMax + 1> sigma_{};  ///< [station]
  std::array<StationErrors, limits::kStationsMax + 1> errors_{};
  std::array<FrameResponse, limits::kStationsMax + 1> response_{};
  double distance_mm_ = nominal_T_block_scanner().translation_mm.norm();
  double u_roll_rad_ = 0.0;
  Mat6 tie_ = Mat6::Constant(kNoValue);  ///< covariance in slab axes, about tie_centre_
  Vec3 tie_centre_ = Vec3::Zero();       ///< slab frame
};

/// Comparison of the fitted frame's roll (about X) with the slab's top. Seats cannot detect a roll error: to them, a
/// row that is too high looks like a rolled slab.
struct RollCheck {
  bool seen = false;           ///< enough of the top is seen beside both rows
  double roll_rad = 0.0;       ///< of the top in the slab frame, nominally 0
  double explained_rad = 0.0;  ///< expected from chance and an ordinary slab
  double u_rad = 0.0;          ///< resulting standard uncertainty of the frame's roll
};

/// Compares the slab's top with the frame. The top's roll is the mean of the two rows' medians. Effects common to both
/// rows in their own axes (a camber, slopes that are too steep everywhere) cancel, as do errors of a scanner that turns
/// with the block. The variance beyond the explained one counts: u^2 = roll^2 - explained^2, or 0.
///
/// `known`: the stations' uncertainties, as the fit uses them. No heap.
[[nodiscard]] RollCheck check_roll(const Recipe& recipe, std::span<const BlockResult> blocks, const Pose& T_base_slab,
                                   const SlabBudget& known);

}  // namespace slabd::algo
