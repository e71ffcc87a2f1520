// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/accuracy/table.h"

/// The accuracy program compares the measuring core with the limit that the data allow. Each study makes scans (or
/// clouds, or slabs) with known truth, measures them as the daemon does and compares the errors with a goal. Too long
/// for the test suite; `script/accuracy` builds and runs it.
///
/// A new study is a function here, its file in CMakeLists.txt and a line in the list of main.cpp.
namespace slabd::accuracy {

/// Options of the study of real concrete.
struct RealOptions {
  std::string surface = "real";      ///< ideal, clean or real
  std::vector<std::string> effects;  ///< NAME=STRENGTH, override the surface's
  std::vector<std::string> defects;  ///< NAME=SIZE, or NAME for the usual size
  bool table = false;                ///< one line for each increased effect and each defect
  bool markdown = false;             ///< the table as in docs/ACCURACY.md
  bool each = false;                 ///< also every scan, one line each
  bool full_grid = false;            ///< 2048 x 2448 instead of 1000 x 1428
  double step_mm = 0.0;              ///< coordinates are rounded to this
  std::string out;                   ///< folder for the scans (PLY) and their truth (JSON); empty: not written
};

struct StudyOptions {
  bool quick = false;       ///< a tenth of the cases: a preview, not evidence
  int seeds = 0;            ///< number of cases, 0 = the study's default
  std::uint64_t first = 1;  ///< first seed; another one gives another sample of the same study
  bool as_json = false;     ///< only the table goes to stdout, as JSON
  RealOptions real;

  /// The number of cases: `seeds` if given, else `full` or, quick, a tenth of it (at least `least`).
  [[nodiscard]] int cases(int full, int least = 2) const {
    if (seeds > 0) return seeds;
    return quick ? (full / 10 > least ? full / 10 : least) : full;
  }
};

// Each study fills the table and returns false only if it could not be carried out, with the reason on stderr. The
// table contains missed goals.

/// Full-size scans of one block of varied geometry: errors of every item, and coverage of U.
[[nodiscard]] bool block_study(const StudyOptions& options, Table& table);
/// The same with rays from one centre: hidden end faces, shadows, and denser points on near parts of the block.
[[nodiscard]] bool perspective_study(const StudyOptions& options, Table& table);
/// The same with noise correlated over 1 mm: coverage of U.
[[nodiscard]] bool correlated_study(const StudyOptions& options, Table& table);
/// Several series of ten scans of one block: range of std and flatness of the ten.
[[nodiscard]] bool repeat_study(const StudyOptions& options, Table& table);
/// Whole slabs of 18 full-size scans with robot repeatability and perfect calibration: slab items relative to the
/// truth, coverage of U. Then slabs with one planted defect each: it must be found at the right seat, and the
/// neighbours must pass.
[[nodiscard]] bool slab_study(const StudyOptions& options, Table& table);
/// Slabs of -10 to 60 deg C with and without their temperature: every length at 20 deg C relative to the truth.
[[nodiscard]] bool warm_study(const StudyOptions& options, Table& table);
/// A robot with an error of 0.7 mm and a repeatability of 0.017 mm: mastered in five rounds, corrected, used. Seats
/// with and without corrections relative to the truth, coverage of U in both cases; from features for many robots,
/// from full-size scans for a few.
[[nodiscard]] bool stations_study(const StudyOptions& options, Table& table);
/// Registration from random starts: the allowed error of the start, and the number of converged wrong poses.
[[nodiscard]] bool basin_study(const StudyOptions& options, Table& table);
/// Registration on the nominal block with white noise: reported covariance relative to the errors.
[[nodiscard]] bool pose_study(const StudyOptions& options, Table& table);
/// Denoising over a grid of pitches, views and outliers: remaining outliers, and lost surface points.
[[nodiscard]] bool denoise_study(const StudyOptions& options, Table& table);
/// The set-up of the paper's Table 1: a, b, c of z = ax + by + c from least squares, classical and improved RANSAC.
[[nodiscard]] bool plane_study(const StudyOptions& options, Table& table);

/// Correlation of the noise of scans: the largest of different exposures, the least of one exposure in another form,
/// and the rate of false alarms.
[[nodiscard]] bool exposures_study(const StudyOptions& options, Table& table);

/// Slab types that differ only in the slab's ends: rejected under the wrong type, never under their own.
[[nodiscard]] bool ends_study(const StudyOptions& options, Table& table);

/// A tooling ball in caps of several sizes: scatter of its centre relative to the floor of a fixed-radius fit, and to
/// the reported covariance.
[[nodiscard]] bool ball_study(const StudyOptions& options, Table& table);

/// Slabs at the level of fitted features, errors drawn from the stated distributions: coverage of every item's U, and
/// its mean relative to the U for 95 % coverage.
[[nodiscard]] bool coverage_study(const StudyOptions& options, Table& table);

/// Scans of real concrete: errors and coverage of every item, verdicts of good blocks, detected and missed defects.
[[nodiscard]] bool real_study(const StudyOptions& options, Table& table);
/// The paper's seats (Table 5, Fig. 17) and registration deviations (Table 4) on drawn concrete.
[[nodiscard]] bool paper_study(const StudyOptions& options, Table& table);

/// Hand-eye sets with planted truth: error in the field of view relative to the optimum's and to the prediction, and
/// the reasons for rejecting sets without a valid calibration.
[[nodiscard]] bool handeye_study(const StudyOptions& options, Table& table);
/// Calibrations from suggested poses alone, compared with random views by the usual advice.
[[nodiscard]] bool guide_study(const StudyOptions& options, Table& table);

}  // namespace slabd::accuracy
