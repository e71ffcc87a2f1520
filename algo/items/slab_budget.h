// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "algo/algo.h"
#include "algo/items/slab_fit.h"
#include "algo/items/uncertainty.h"

/// Uncertainty of what is measured between stations. A slab item is, near its value, a sum over stations of gradients
/// times errors; the frame is a fit of the same stations, so its error is one too and an item feels every station:
///
///   v = sum_k gp_k . dp_k + gn_k . dn_k + gj_k . dj_k,   g = own + frame' (d frame / d observation k)
///
/// with dp, dn, dj the errors of station k's seat reference point, seat normal and outer jaw point, in slab axes:
///
///   dp = t_k + e_p          t_k, w_k   translation and rotation of the station's splice: one of each per station, so
///   dn = w_k x n + e_n                 what moves point, jaw and plane alike cancels between them. They hold at the
///   dj = t_k + w_k x l + e_j           block's origin; l is the jaw point from there
///   e                       noise inside the scan (SeatObservation::sigma_*) and the scanner's form
///
/// The station's part of the sum is |gp + gj|^2 s_t^2 + |n x gn + l x gj|^2 s_w^2.
///
/// What no station explains is the frame's roll where the slab's top contradicts it (witness_roll). It is the part
/// `registration`, which for a slab is the frame: u = |d item / d roll| u_roll.
namespace slabd::algo {

/// One station's errors by origin. Variances in mm^2 and rad^2, per axis (slab axes; block axes differ in sign only).
struct StationErrors {
  Vec3 p_noise = Vec3::Constant(kNoValue);
  Vec3 n_noise = Vec3::Constant(kNoValue);
  Vec3 jaw_noise = Vec3::Constant(kNoValue);
  double noise_factor = kNoValue;
  Vec3 normal = Vec3::UnitZ();    ///< of the seat
  Vec3 jaw_lever = Vec3::Zero();  ///< from the block's origin to its outer jaw point
  /// What the scanner's form makes of the jaw point: per shift of jaw and seat, and per tilt of the seat, which
  /// carries the reference height out to the jaw (mm).
  double jaw_per_shift = 1.0;
  double jaw_per_tilt_mm = 0.0;
};

/// Gradient of one item by everything that was observed; [station], 1-based.
struct SlabGradient {
  using PerStation = std::array<Vec3, limits::kStationsMax + 1>;
  PerStation p = zeros();
  PerStation n = zeros();
  PerStation jaw = zeros();
  FrameVector frame = FrameVector::Zero();  ///< by a small motion of the slab frame, see FrameResponse

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
  SlabBudget(const Recipe& recipe, const ScannerNumbers& verified, std::span<const StationSigma> sigmas);

  [[nodiscard]] const StationSigma& sigma(int station) const { return sigma_[static_cast<std::size_t>(station)]; }

  /// Takes one station's errors over; call for every observed station before `known_*` or `budget`.
  void set(int station, const StationErrors& errors);
  /// How the frame answers to the stations; without it the frame counts as free of error.
  void set(int station, const FrameResponse& response);
  /// Standard uncertainty of the frame's roll about X beyond what the stations make of it.
  void set_roll(double u_rad) { u_roll_rad_ = u_rad; }

  /// What the frame's roll adds to an item (k = 1, mm or rad); also where there is no budget.
  [[nodiscard]] double of_roll(const SlabGradient& gradient) const;

  /// Standard uncertainties of point and normal, all origins that are known together: the weights of the slab fit.
  [[nodiscard]] Vec3 known_p_mm(int station) const;
  [[nodiscard]] Vec3 known_n_rad(int station) const;

  /// The item's parts, lengths in mm, angles in rad (`unit` converts). Not finite when something needed is unknown.
  [[nodiscard]] Budget budget(const SlabGradient& gradient, double unit) const;

 private:
  UncertaintySettings settings_;
  ScannerModel scanner_;
  std::array<StationSigma, limits::kStationsMax + 1> sigma_{};  ///< [station]
  std::array<StationErrors, limits::kStationsMax + 1> errors_{};
  std::array<FrameResponse, limits::kStationsMax + 1> response_{};
  double u_roll_rad_ = 0.0;
};

/// What the slab's top says of the fitted frame's roll (about X). Seats cannot say it: a row that is too high looks to
/// them like a slab that is rolled.
struct RollWitness {
  bool seen = false;           ///< enough of the top is seen beside both rows
  double roll_rad = 0.0;       ///< of the top in the slab frame, nominally 0
  double explained_rad = 0.0;  ///< what chance and an ordinary slab may show
  double u_rad = 0.0;          ///< standard uncertainty of the frame's roll that follows
};

/// The top's roll is the mean of the two rows' medians: what both rows show alike in their own axes (a camber, slopes
/// that are too steep everywhere) cancels, and so does what a scanner that is turned round with the block shows. The
/// variance beyond what is explained counts: u^2 = roll^2 - explained^2, or 0.
///
/// `known`: the stations' uncertainties, as the fit takes them. No heap.
[[nodiscard]] RollWitness witness_roll(const Recipe& recipe, std::span<const BlockResult> blocks,
                                       const Pose& T_base_slab, const SlabBudget& known);

}  // namespace slabd::algo
