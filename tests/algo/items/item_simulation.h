// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "base/calibration.h"

/// Slabs at the level of fitted features: known geometry, errors drawn from the distributions stated in the budget, and
/// the real item functions on top. A slab costs a millisecond, so thousands of them can test U.
namespace slabd::simulation {

/// One block as built: deviations from the recipe's nominal.
struct BuiltBlock {
  Pose displacement;  ///< of the block at its position, in its own axes
  double slope_rad = 0.0;
  double cross_slope_rad = 0.0;  ///< about the slab's Y
  double jaw_angle_inner_rad = 0.0;
  double jaw_angle_outer_rad = 0.0;
  double jaw_yaw_inner_rad = 0.0;  ///< jaw faces not exactly along the rail
  double jaw_yaw_outer_rad = 0.0;
  double jaw_distance_mm = 0.0;
  double jaw_shift_mm = 0.0;  ///< both jaws outward along the seat
  double casing_spacing_mm = 0.0;
  double rim_inner_mm = 0.0;
  double rim_outer_mm = 0.0;
  double top_tilt_x_rad = 0.0;
  double top_tilt_y_rad = 0.0;
  double bow_mm = 0.0;  ///< peak to valley of the seat's own form, see FormShape
  int form_shape = 0;   ///< 0..3: along the rail, across, wave, saddle
};

/// Errors of the measurement, all as standard deviations or half widths of the stated distributions.
struct Errors {
  // White noise of the fits.
  double seat_offset_mm = 0.0002;
  double seat_tilt_rad = 4e-6;
  double jaw_offset_mm = 0.0006;
  double jaw_tilt_rad = 6e-5;
  double top_offset_mm = 0.0002;
  double top_tilt_rad = 1e-6;
  double circle_mm = 0.003;
  double rim_mm = 0.0008;
  double noise_mm = 0.03;     ///< of single points: seat_std
  double cell_mm = 0.005;     ///< of the means of flatness cells
  double noise_factor = 4.0;  ///< variances of means relative to white noise
  // Registration: x, y, z, rotations about X, Y, Z.
  std::array<double, 6> registration = {0.003, 0.001, 0.0005, 4e-6, 6e-6, 1e-5};
  // Each is zero for a perfect component.
  double scanner = 1.0;    ///< times the recipe's specification
  double station = 1.0;    ///< times the StationSigma
  double tie = 1.0;        ///< times the covariance of the tie, as a standard deviation
  double reference = 1.0;  ///< times the recipe's
  bool flatness = false;   ///< simulate cells; else flatness has no value
  std::uint32_t points = 236'000;
};

/// No errors at all: the measurement equals the truth.
[[nodiscard]] Errors none();

/// A slab with random deviations inside the tolerances; the same seed gives the same slab.
struct BuiltSlab {
  std::vector<BuiltBlock> blocks;  ///< [station - 1]
};
[[nodiscard]] BuiltSlab nominal(const Recipe& recipe);
[[nodiscard]] BuiltSlab varied(const Recipe& recipe, Prng& prng);

struct Measured {
  std::vector<BlockResult> blocks;  ///< judged, [station - 1]
  SlabResult slab;
};

/// Stations of the second of two robots, and the tie between them.
struct SecondRobot {
  std::array<bool, limits::kStationsMax> scans{};  ///< [station - 1]
  TieNumbers tie;
};
/// A tie with independent errors: `sigma_mm` per axis in the middle of the targets, `sigma_rad` per axis.
[[nodiscard]] TieNumbers independent_tie(double sigma_mm, double sigma_rad, const Vec3& centre_mm);

/// Errors of a scanner at the outer jaw, -1..1 of their half widths. They belong to a place of its image, so that all
/// of its blocks have the same.
struct OuterJawErrors {
  double place = 0.0;
  double length = 0.0;
  double tilt_a = 0.0;
  double tilt_b = 0.0;
};
/// One for each arm.
using ScannersAtJaw = std::array<OuterJawErrors, limits::kArmsMax>;
[[nodiscard]] ScannersAtJaw outer_jaw_errors(Prng& prng);

/// Measures a built slab: features with errors, block items, budgets, observations, slab items.
class Line {
 public:
  Line(const Recipe& recipe, const algo::StationSigma& sigma, const std::optional<SecondRobot>& second = {});

  /// `scanners`: nullptr for a block by itself.
  [[nodiscard]] BlockResult measure_block(int station, const BuiltBlock& built, const Errors& errors, Prng& prng,
                                          const ScannersAtJaw* scanners = nullptr) const;
  [[nodiscard]] Measured measure(const BuiltSlab& slab, const Errors& errors, Prng& prng) const;

  /// True motion of the second robot's base from where the tie puts it, base frame.
  [[nodiscard]] Pose tie_error(const Errors& errors, Prng& prng) const;
  /// As if the second robot stood elsewhere: displaces what it observed.
  void displace(const Pose& motion, std::vector<BlockResult>& blocks) const;
  /// Computes the slab's items from its blocks.
  void inspect(std::span<const BlockResult> blocks, SlabResult& out) const;

  [[nodiscard]] const Recipe& recipe() const { return recipe_; }
  [[nodiscard]] const algo::BlockModel& model() const { return model_; }
  [[nodiscard]] const algo::StationSigma& sigma() const { return sigma_; }
  [[nodiscard]] static Pose T_base_slab();

 private:
  Recipe recipe_;
  algo::BlockModel model_;
  algo::StationSigma sigma_;
  std::optional<SecondRobot> second_;
};

/// The recipe of the tests with the reference recipe's [uncertainty]: form 0.05 mm over 150 mm, 50 ppm, reference
/// 0.005 mm and 0.001 degrees.
[[nodiscard]] Recipe recipe_with_uncertainty();

// ---- coverage of U --------------------------------------------------------------------------------------------

/// Result for one item kind over many slabs.
struct Coverage {
  ItemId id = ItemId::seat_slope;
  bool slab_frame = false;  ///< seat_slope exists in both
  std::size_t count = 0;
  std::size_t covered = 0;
  double mean_U = 0.0;
  double needed = 0.0;  ///< empirical 95 % quantile of the error (one-sided for flatness)
  double rms = 0.0;
  std::array<double, kBudgetParts> budget{};  ///< root mean squares

  [[nodiscard]] double share() const { return static_cast<double>(covered) / static_cast<double>(count); }
  [[nodiscard]] double waste() const { return mean_U / needed; }
};

/// Builds `slabs` varied slabs, measures each with and without errors and compares, item by item. `flatness_every`:
/// flatness is simulated for one station in this number (its cells cost the most). Slab items of slabs whose rough top
/// contradicts the frame are left out: their U contains it.
[[nodiscard]] std::vector<Coverage> coverage(const Line& line, const Errors& errors, int slabs, std::uint64_t seed,
                                             int flatness_every);

}  // namespace slabd::simulation
