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

/// Scan in, items out. Pure: no file, clock or log, and no heap after construction. The same scan, recipe and start
/// pose give the same bits, on one thread or two and on every instruction set.
namespace slabd {
struct NoisePrint;
}

namespace slabd::algo {

// ---- the machine -----------------------------------------------------------------------------------------------

/// What the kernels were compiled for; the best one that the machine has is taken.
enum class InstructionSet : std::uint8_t { best, avx512, avx2, sse4, plain };
/// For tests and benchmarks: everything measured from now on, in the whole process, uses this set. False, and `best`,
/// when the machine does not have it.
[[nodiscard]] bool limit_instruction_set(InstructionSet set);
/// Name of the set in use, such as "AVX2".
[[nodiscard]] std::string_view instruction_set();

// ---- the scan --------------------------------------------------------------------------------------------------

/// A scan in the scanner frame (mm): x y z, x y z, ... as float32; NaN marks a missing point. Measuring works in place:
/// `denoise` sets what it takes out to NaN; size, width, height and order stay. Only a scan whose order has no meaning
/// gets all of these anew, those of its grid, where `xyz` has room for that.
struct Cloud {
  std::span<float> xyz;
  std::size_t points = 0;  ///< 3 * points <= xyz.size()
  std::size_t width = 0;   ///< organised: width * height == points before denoising; 0 = unorganised
  std::size_t height = 0;
};

// ---- planes (paper 3.1) ---------------------------------------------------------------------------------------

/// What the inliers must amount to before a plane counts; the defaults ask for nothing.
struct PlaneSupport {
  std::uint64_t inliers_min = 3;
  double wide_mm = 0.0;    ///< least standard deviation along the direction in the plane they reach furthest in
  double narrow_mm = 0.0;  ///< ... and across it
  /// Largest standard error of the tilt from noise: std_mm / (spread across * sqrt(inliers)).
  double tilt_sigma_max_rad = std::numeric_limits<double>::infinity();
};

struct PlaneSettings {
  double contamination = 0.5;      ///< epsilon of eq. (8)
  double confidence = 1.0 - 1e-6;  ///< P of eq. (8)
  double threshold_mm = 0.0;       ///< inlier distance; 0 = three robust standard deviations of the best hypothesis
  double threshold_min_mm = 0.0;   ///< not less than this: rounded coordinates may all lie on the plane
  double inlier_share_min = 0.0;   ///< below it `ok` is false
  PlaneSupport support{};          ///< below it `ok` is false
  /// Of a face whose direction alone is used: this much tilt may hang on where the threshold cuts, as it does on a face
  /// that undulates.
  double bend_max_rad = 0.0;
  std::uint64_t seed = 1;
  int refits_max = 20;
};

/// Paper eq. (8) solved for K: hypotheses so that one of them is free of outliers with probability P, at least 1.
[[nodiscard]] int hypotheses_needed(double contamination, double confidence, int points_per_hypothesis);

/// The paper's improved RANSAC on points (mm): K hypotheses on a stratified sample, least truncated squared error
/// (MSAC) as the choice, then refit by orthogonal least squares and re-select on all points until the inlier set
/// stands still. Orientation: `normal` has a positive dot product with `up`. Needs at least 3 points.
/// ok = false: too few points, degenerate, no fixed point within refits_max, share or support below the limit, or the
/// points are not one plane with outliers: a second surface in the zone of a given threshold, another plane that holds
/// four fifths as many points, a place that hangs on where the threshold cuts (algo/features/plane_steps.h). Surfaces
/// closer together than about five standard deviations of the noise count as one. The figures reached are still filled
/// in. `std_mm` is of what the threshold left: 1.3 % below the noise at three standard deviations; the covariances
/// allow for it. No heap; O(K * sample + refits * points).
[[nodiscard]] PlaneFit fit_plane(std::span<const Vec3> points, const Vec3& up, const PlaneSettings& settings);

/// Orthogonal least squares on all points: blocked, shifted double sums, symmetric eigenproblem. ok = false when
/// fewer than 3 points or all on a line.
[[nodiscard]] PlaneFit fit_plane_lsq(std::span<const Vec3> points, const Vec3& up);

/// The classical RANSAC of the paper's comparison (Table 1), for comparisons only: of K planes through three random
/// points the one with the most points within the threshold, as it is, no refit. Its error is that of three points,
/// about ten times the improved fit's. `iterations` is 0, covariances stay NaN. Same settings (threshold_mm = 0
/// as for `fit_plane`; `support` and `refits_max` are not used), same orientation. ok = false: fewer than 3 points, no
/// three of them make a plane, share below the limit. No heap; O(K * points).
[[nodiscard]] PlaneFit fit_plane_ransac(std::span<const Vec3> points, const Vec3& up, const PlaneSettings& settings);

// ---- one block -------------------------------------------------------------------------------------------------

/// Mean distances of the points to the block model by place, from a sixteenth of the points. Cells row by row, the
/// first at the lowest x and y of the block frame.
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
  /// NaN where nothing was seen.
  [[nodiscard]] double mean_mm(std::size_t cell) const {
    return count[cell] == 0 ? kNoValue : 1e-6 * static_cast<double>(sum_nm[cell]) / static_cast<double>(count[cell]);
  }
};

struct CellSum;

/// Mean heights over the fitted seat plane by cell of the evaluation region, the cells that flatness is made of. Cells
/// row by row, a row along the rail, the first at the lowest x and s. Without columns: the seat was not measured.
struct SeatMap {
  std::size_t columns = 0;  ///< along x
  std::size_t rows = 0;     ///< along the seat
  double cell_mm = 0.0;
  std::uint32_t points_min = 0;
  std::span<const CellSum> cells;

  /// NaN where too few points were seen.
  [[nodiscard]] double mean_mm(std::size_t column, std::size_t row) const;
};

/// Measures one block. Construct once (allocates the whole workspace, limits::kWorkspaceBytes), then `use` a recipe
/// and run the stages in order for each scan; the caller times them. Not thread-safe; one per worker.
class BlockInspector {
 public:
  /// `threads`: 1, or 2 for a helper that shares the work; the results are the same.
  explicit BlockInspector(int threads = 1);
  ~BlockInspector();
  BlockInspector(const BlockInspector&) = delete;
  BlockInspector& operator=(const BlockInspector&) = delete;

  /// The threads that measure, for whoever reads the scan first. Not while a stage runs.
  [[nodiscard]] Team& team();

  /// Builds the block model and its closest-face table; about 80 ms. No heap.
  void use(const Recipe& recipe);

  /// Ends the stage under way soon, with deadline, and those after it. Callable from any thread; forgotten by begin().
  /// For a computer that is too slow: what a scan may cost is bounded by counted work, the same on every computer.
  void give_up();

  /// Starts a block: clears the result, notes the station (1..18, only carried through) and the pose to start from:
  /// base frame <- block's nominal, and scanner in the base frame (splicing: T_base_flange * T_flange_scanner).
  /// Offline scans pass T_base_block = identity and T_base_scanner = T_block_scanner. `verified`: the scanner's
  /// acceptance, which U takes where it is worse than the recipe's specification; without figures nothing is known.
  void begin(int station, const Pose& T_base_block, const Pose& T_base_scanner, const ScannerNumbers& verified = {});

  /// Sets points that no surface goes through (judged at the scan's own pitch) to NaN, in place. too_few_points when
  /// fewer than limits::kScanPointsMin are left, frame_incomplete when `points` does not fit the buffer. 2 ns a
  /// point organised, 50 to 100 ns otherwise.
  [[nodiscard]] Status denoise(Cloud& cloud);

  /// Finds the block: ICP to the analytic model from the spliced pose, else from a search of the recipe's window; the
  /// casings where no end face is seen. block_not_found when rejected or degenerate, fit_failed at the iteration limit,
  /// no_pose when the start is not finite; the report in `result()` says why. 5 ms near, 30 ms from afar.
  [[nodiscard]] Status register_to_model(const Cloud& cloud);

  /// Segments by model, fits every feature, computes the items that could be measured; the others stay without a
  /// value. block_not_found unless registration converged, fit_failed without a seat plane. About 4 ns a point.
  [[nodiscard]] Status extract(const Cloud& cloud);

  /// Verdict of the block from what is there: call it after the last stage that succeeded, with that stage's code.
  /// Never pass unless every required item is measured and within its guarded limits.
  void judge(Code code);

  /// Of the block measured last, empty where it was not found; valid until the next one begins.
  [[nodiscard]] DeviationMap deviation_map() const;
  /// Of the block measured last; valid until the next one begins.
  [[nodiscard]] SeatMap seat_map() const;
  /// The noise of the exposure measured last (base/noise_print.h), after `extract` and before the next block begins.
  /// Empty where the seat was not measured, or was seen by too few points. No heap; 0.5 ms.
  void noise_print(NoisePrint& out);
  [[nodiscard]] const BlockResult& result() const;
  [[nodiscard]] BlockResult& result();

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

// ---- the slab --------------------------------------------------------------------------------------------------

/// Uncertainty of one station's splice in the base frame, standard (k = 1); NaN = not calibrated: slab-frame items
/// are then indeterminate.
struct StationSigma {
  double position_mm = kNoValue;   ///< of the calibration, per axis
  double rotation_rad = kNoValue;  ///< per axis
  /// Robot repeatability where `position_mm` and `rotation_rad` do not contain it already.
  double robot_position_mm = 0.0;
  double robot_rotation_rad = 0.0;
};

/// One robust rigid fit of all seats to the slab model and the slab-frame items. `blocks` holds one entry per station
/// (index station - 1); an entry with verdict none is a missing station. Fewer than 12 seats, one row only or fewer
/// than 4 pitches: slab-frame items not measured. The slab passes only if every station is measured and passes.
/// `verified`: the scanner's acceptance, as in BlockInspector::begin. No heap.
void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, const StationSigma& sigma,
                  const Pose& T_base_slab_nominal, SlabResult& out, const ScannerNumbers& verified = {});
/// The same with what each station was spliced with, [station - 1]: one outside its calibration's reach is known less
/// well and counts less in the slab frame. A station beyond the span is not calibrated.
void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, std::span<const StationSigma> sigmas,
                  const Pose& T_base_slab_nominal, SlabResult& out, const ScannerNumbers& verified = {});

}  // namespace slabd::algo
