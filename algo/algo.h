// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string_view>

#include "base/base.h"
#include "base/calibration.h"
#include "base/team.h"

/// The measuring interface: scan in, items out. Pure: no file, clock or log, and no heap after construction. The same
/// scan, recipe and start pose give the same bits with one thread or two and with every instruction set.
namespace slabd {
struct NoisePrint;
}

namespace slabd::algo {

// ---- the machine -----------------------------------------------------------------------------------------------

/// Instruction sets for which the kernels are compiled. `best` selects the best one that the processor supports.
enum class InstructionSet : std::uint8_t { best, avx512, avx2, sse4, plain };
/// For tests and benchmarks: selects the instruction set for every later measurement of the whole process. Returns
/// false, and selects `best`, if the processor does not support it.
[[nodiscard]] bool limit_instruction_set(InstructionSet set);
/// Name of the set in use, such as "AVX2".
[[nodiscard]] std::string_view instruction_set();

// ---- the scan --------------------------------------------------------------------------------------------------

/// A scan in the scanner frame (mm): x y z, x y z, ... as float32; NaN marks a missing point. Measuring works in place:
/// `denoise` sets noise points to NaN and keeps size, width, height and order. Only a scan whose order has no meaning
/// gets the size, width, height and order of its recovered grid, if `xyz` has room for it.
struct Cloud {
  std::span<float> xyz;
  std::size_t points = 0;  ///< 3 * points <= xyz.size()
  std::size_t width = 0;   ///< organised: width * height == points before denoising; 0 = unorganised
  std::size_t height = 0;
};

// ---- planes (paper 3.1) ---------------------------------------------------------------------------------------

/// Minimum support of a plane by its inliers. The defaults require nothing.
struct PlaneSupport {
  std::uint64_t inliers_min = 3;
  double wide_mm = 0.0;    ///< least standard deviation along the in-plane direction of the largest spread
  double narrow_mm = 0.0;  ///< ... and across that direction
  /// Largest standard error of the tilt from noise: std_mm / (spread across * sqrt(inliers)).
  double tilt_sigma_max_rad = std::numeric_limits<double>::infinity();
};

struct PlaneSettings {
  double contamination = 0.5;      ///< epsilon of eq. (8)
  double confidence = 1.0 - 1e-6;  ///< P of eq. (8)
  double threshold_mm = 0.0;       ///< inlier distance; 0 = three robust standard deviations of the best hypothesis
  double threshold_min_mm = 0.0;   ///< not less than this: rounded coordinates may all be on the plane
  double inlier_share_min = 0.0;   ///< below it `ok` is false
  PlaneSupport support{};          ///< below it `ok` is false
  /// Largest tilt that may depend on where the threshold cuts, as on a face that undulates or sinks towards an edge.
  double bend_max_rad = 0.0;
  /// Largest shift (root mean square over the inliers) that may. A finite one makes the fit state its `bend`; infinity
  /// is for a face of which only the direction is used.
  double bend_max_mm = std::numeric_limits<double>::infinity();
  std::uint64_t seed = 1;
  int refits_max = 20;
};

/// Solves paper eq. (8) for K: hypotheses needed so that one is free of outliers with probability P; at least 1.
[[nodiscard]] int hypotheses_needed(double contamination, double confidence, int points_per_hypothesis);

/// The paper's improved RANSAC on points (mm). Draws K hypotheses on a stratified sample and chooses the one with the
/// least truncated squared error (MSAC). Then refits by orthogonal least squares and re-selects on all points until the
/// inlier set no longer changes. Orientation: `normal` has a positive dot product with `up`. Needs at least 3 points.
/// ok = false if there are too few points, they are degenerate, no fixed point within refits_max exists, or the share
/// or support is below its limit. Also if the points are not one plane with outliers: a second surface in the zone of a
/// given threshold, another plane with four fifths as many points, or a plane that depends on where the threshold cuts
/// (algo/features/plane_steps.h). Surfaces closer than about five standard deviations of the noise count as one. The
/// figures reached are filled in anyway. `std_mm` is of the inliers: 1.3 % below the noise at a threshold of three
/// standard deviations; the covariances allow for it. No heap; O(K * sample + refits * points).
[[nodiscard]] PlaneFit fit_plane(std::span<const Vec3> points, const Vec3& up, const PlaneSettings& settings);

/// Orthogonal least squares on all points: blocked, shifted sums in double, symmetric eigenproblem. ok = false if there
/// are fewer than 3 points or all are on one line.
[[nodiscard]] PlaneFit fit_plane_lsq(std::span<const Vec3> points, const Vec3& up);

/// The classical RANSAC of the paper's comparison (Table 1), for comparisons only: of K planes through three random
/// points, returns the one with the most points within the threshold, without a refit. Its error is that of three
/// points, about ten times that of the improved fit. `iterations` is 0, the covariances are NaN. Settings (threshold_mm
/// = 0 too; `support` and `refits_max` are not used) and orientation as for `fit_plane`. ok = false if there are fewer
/// than 3 points, no three of them make a plane, or the share is below its limit. No heap; O(K * points).
[[nodiscard]] PlaneFit fit_plane_ransac(std::span<const Vec3> points, const Vec3& up, const PlaneSettings& settings);

// ---- one block -------------------------------------------------------------------------------------------------

/// Mean distances of the points to the block model per cell, from a sixteenth of the points. The cells are stored row
/// by row, starting at the lowest x and y of the block frame.
struct DeviationMap {
  std::size_t columns = 0;  ///< along x
  std::size_t rows = 0;     ///< along y
  double cell_mm = 0.0;
  std::span<const std::int64_t> sum_nm;  ///< of the points near the model
  std::span<const std::uint32_t> count;

  /// Centre of a cell.
  [[nodiscard]] double x_mm(std::size_t column) const {
    return (static_cast<double>(column) + 0.5 - 0.5 * static_cast<double>(columns)) * cell_mm;
  }
  [[nodiscard]] double y_mm(std::size_t row) const {
    return (static_cast<double>(row) + 0.5 - 0.5 * static_cast<double>(rows)) * cell_mm;
  }
  /// NaN if no point was seen in the cell.
  [[nodiscard]] double mean_mm(std::size_t cell) const {
    return count[cell] == 0 ? kNoValue : 1e-6 * static_cast<double>(sum_nm[cell]) / static_cast<double>(count[cell]);
  }
};

struct CellSum;

/// Mean heights above the fitted seat plane per cell of the evaluation region, the cells of flatness. Stored row by
/// row, a row along the rail, starting at the lowest x and s. Without columns if the seat was not measured.
struct SeatMap {
  std::size_t columns = 0;  ///< along x
  std::size_t rows = 0;     ///< along the seat
  double cell_mm = 0.0;
  std::uint32_t points_min = 0;
  std::span<const CellSum> cells;

  /// NaN if the cell has too few points.
  [[nodiscard]] double mean_mm(std::size_t column, std::size_t row) const;
};

/// Measures one block. Construct once (allocates the whole workspace, limits::kWorkspaceBytes), then `use` a recipe and
/// run the stages in order for each scan. The caller measures the time. Not thread-safe; one per worker.
class BlockInspector {
 public:
  /// `threads`: 1, or 2 for a helper thread that shares the work. The results are the same.
  explicit BlockInspector(int threads = 1);
  ~BlockInspector();
  BlockInspector(const BlockInspector&) = delete;
  BlockInspector& operator=(const BlockInspector&) = delete;

  /// The measuring threads, also for the reader that loads the scan before. Do not use them while a stage runs.
  [[nodiscard]] Team& team();

  /// Builds the block model and its closest-face table; about 80 ms. No heap.
  void use(const Recipe& recipe);

  /// Ends the running stage soon, with deadline, and the stages after it. Callable from any thread; begin() resets it.
  /// For slow computers: the cost of a scan is bounded by counted work, the same on every computer.
  void give_up();

  /// Starts a block: clears the result, stores the station (1..18, only carried through) and the start pose: base frame
  /// <- block's nominal, and scanner in the base frame (splicing: T_base_flange * T_flange_scanner). Offline scans pass
  /// T_base_block = identity and T_base_scanner = T_block_scanner. `verified`: figures of the scanner's acceptance. U
  /// takes them where they are worse than the recipe's specification; empty without an acceptance.
  /// `slab`: temperature and design of the slab; a seat that is
  /// designed with another slope or height than the last one takes 80 ms more. `scanner_drift`: of this scan
  /// (base/calibration.h); NaN: U contains none.
  void begin(int station, const Pose& T_base_block, const Pose& T_base_scanner, const ScannerNumbers& verified = {},
             const SlabFacts& slab = {}, double scanner_drift = kNoValue);

  /// Sets isolated points, through which no surface goes at the scan's own pitch, to NaN in place. too_few_points if
  /// fewer than limits::kScanPointsMin remain, frame_incomplete if `points` does not fit the buffer. 2 ns a point for
  /// organised scans, 50 to 100 ns otherwise.
  [[nodiscard]] Status denoise(Cloud& cloud);

  /// Finds the block by ICP to the analytic model: from the spliced pose, then from a search of the recipe's window;
  /// uses the casings if no end face is seen. block_not_found if rejected or degenerate, fit_failed at the iteration
  /// limit, no_pose if the start is not finite; the report in `result()` has the reason. 5 ms near, 30 ms from afar.
  [[nodiscard]] Status register_to_model(const Cloud& cloud);

  /// Segments by model, fits every feature and computes the measurable items; the others have no value. block_not_found
  /// if registration did not converge, fit_failed without a seat plane. About 4 ns a point.
  [[nodiscard]] Status extract(const Cloud& cloud);

  /// Computes the verdict of the block from the available results. Call it after the last stage that succeeded, with
  /// that stage's code. Never passes unless every required item is measured and within its guarded limits.
  void judge(Code code);

  /// Deviation map of the last block; empty if it was not found. Valid until the next block begins.
  [[nodiscard]] DeviationMap deviation_map() const;
  /// Seat map of the last block. Valid until the next block begins.
  [[nodiscard]] SeatMap seat_map() const;
  /// The noise print of the last exposure (base/noise_print.h), between `extract` and the start of the next block.
  /// Empty if the seat was not measured or has too few points. No heap; 0.5 ms.
  void noise_print(NoisePrint& out);
  [[nodiscard]] const BlockResult& result() const;
  [[nodiscard]] BlockResult& result();

 private:
  struct Workspace;
  struct BlockFit;
  void build_model(const SeatDesign& seat);
  // The parts of extract.
  [[nodiscard]] Status fit_faces(const Cloud& cloud, BlockFit& fit);
  [[nodiscard]] Status measure_seat_and_casings(const Cloud& cloud, BlockFit& fit);
  void compute_items(const Cloud& cloud, const BlockFit& fit);
  [[nodiscard]] Error seat_refused() const;

  std::unique_ptr<Workspace> work_;
};

// ---- the slab --------------------------------------------------------------------------------------------------

/// Standard uncertainty (k = 1) of one station's splice in the base frame. NaN = not calibrated: slab-frame items are
/// then indeterminate.
struct StationSigma {
  double position_mm = kNoValue;   ///< of the calibration, per axis
  double rotation_rad = kNoValue;  ///< per axis
  /// Robot repeatability, unless `position_mm` and `rotation_rad` already contain it.
  double robot_position_mm = 0.0;
  double robot_rotation_rad = 0.0;
  double scanner_drift = kNoValue;  ///< of its scan, as in BlockInspector::begin
  std::uint8_t arm = 0;             ///< arm that scanned it (base/arm.h)
};

/// The arms with which a slab was scanned.
struct SlabArms {
  /// `verified_in`: [arm]. Without a default, so that `{}` is an acceptance without figures.
  SlabArms(std::span<const ScannerNumbers> verified_in, const TieNumbers* tie_in)
      : verified(verified_in), tie(tie_in) {}

  std::span<const ScannerNumbers> verified;  ///< figures of each scanner's acceptance, as in BlockInspector::begin
  /// Tie of the second arm's robot to the base frame. nullptr: its covariance is not known, and an item between the
  /// stations of two arms has no U.
  const TieNumbers* tie;
};

/// Computes one robust rigid fit of all seats to the slab model, and the slab-frame items. `blocks` has one entry per
/// station (index station - 1); verdict none marks a missing station. With fewer than 12 seats, only one row or fewer
/// than 4 pitches, slab-frame items are not measured. The slab passes only if every station is measured and passes.
/// `verified` and `slab` as in BlockInspector::begin. No heap.
void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, const StationSigma& sigma,
                  const Pose& T_base_slab_nominal, SlabResult& out, const ScannerNumbers& verified = {},
                  const SlabFacts& slab = {});
/// The same with one sigma per station, [station - 1]. A station outside the reach of its calibration has a larger
/// sigma and less weight in the slab frame. A station beyond the span is not calibrated.
void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, std::span<const StationSigma> sigmas,
                  const Pose& T_base_slab_nominal, SlabResult& out, const ScannerNumbers& verified = {},
                  const SlabFacts& slab = {});
/// The same for stations scanned by several arms: StationSigma::arm selects the scanner's figures. Items between
/// stations of different arms contain the uncertainty of the tie (BudgetPart::tie).
void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, std::span<const StationSigma> sigmas,
                  const Pose& T_base_slab_nominal, SlabResult& out, const SlabArms& arms, const SlabFacts& slab);

}  // namespace slabd::algo
