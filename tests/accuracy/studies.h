// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/accuracy/table.h"

/// The accuracy program: is the measuring core as good as the data allow? Each study makes scans (or clouds, or slabs)
/// with known truth, measures them as the daemon does and holds the errors against a goal. Too long for the test
/// suite; `script/accuracy` builds and runs it.
///
/// A new study is a function here, its file in CMakeLists.txt and a line in the list of main.cpp.
namespace slabd::accuracy {

/// Choice of what the study of real concrete draws.
struct RealOptions {
  std::string surface = "real";      ///< ideal, clean or real
  std::vector<std::string> effects;  ///< NAME=STRENGTH over the surface's
  std::vector<std::string> defects;  ///< NAME=SIZE, or NAME for the usual size
  bool table = false;                ///< every effect raised and every defect, one line each
  bool markdown = false;             ///< the table as in docs/MEASURING.md
  bool each = false;                 ///< also every scan, one line each
  bool full_grid = false;            ///< 2048 x 2448 instead of 1000 x 1428
  double step_mm = 0.0;              ///< coordinates rounded to this
  std::string out;                   ///< folder for the scans (PLY) and their truth (JSON); empty: none
};

struct StudyOptions {
  bool quick = false;       ///< a tenth of the cases: for a look, not for a claim
  int seeds = 0;            ///< how many cases, 0 = the study's own number
  std::uint64_t first = 1;  ///< the first seed; another one is another sample of the same study
  bool as_json = false;     ///< nothing but the table goes to stdout, as JSON
  RealOptions real;

  /// The number of cases: `seeds` if given, else `full` or, quick, a tenth of it (at least `least`).
  [[nodiscard]] int cases(int full, int least = 2) const {
    if (seeds > 0) return seeds;
    return quick ? (full / 10 > least ? full / 10 : least) : full;
  }
};

// Each fills the table and returns false only when it could not be carried out (it has then said why on stderr).
// Goals that are missed stand in the table.

/// Full-size scans of one block of varied geometry: errors of every item, and whether U covers them.
[[nodiscard]] bool block_study(const StudyOptions& options, Table& table);
/// The same with rays from one centre: hidden end faces, shadows, points closer together where the block is closer.
[[nodiscard]] bool perspective_study(const StudyOptions& options, Table& table);
/// The same with noise that hangs together over 1 mm: does the stated U still cover?
[[nodiscard]] bool correlated_study(const StudyOptions& options, Table& table);
/// Ten scans of one block, several times over: how far do std and flatness of the ten lie apart?
[[nodiscard]] bool repeat_study(const StudyOptions& options, Table& table);
/// Whole slabs of 18 full-size scans with robot repeatability and perfect calibration: slab items against the truth,
/// coverage of U; then slabs with one planted defect each: found, at the right seat, neighbours untouched?
[[nodiscard]] bool slab_study(const StudyOptions& options, Table& table);
/// A robot that is off by 0.7 mm and comes back to 0.017 mm: mastered in five rounds, corrected, used. Seats with and
/// without corrections against the truth, coverage of U in both cases; from features for many robots, from full-size
/// scans for a few.
[[nodiscard]] bool stations_study(const StudyOptions& options, Table& table);
/// Registration from random starts: how far off may the robot be, and is a wrong pose ever called converged?
[[nodiscard]] bool basin_study(const StudyOptions& options, Table& table);
/// Registration on the nominal block with white noise: is the reported covariance that of the errors?
[[nodiscard]] bool pose_study(const StudyOptions& options, Table& table);
/// Denoising over a grid of pitches, views and outliers: what is left of them, what is lost of the surface.
[[nodiscard]] bool denoise_study(const StudyOptions& options, Table& table);
/// The set-up of the paper's Table 1: a, b, c of z = ax + by + c from least squares, classical and improved RANSAC.
[[nodiscard]] bool plane_study(const StudyOptions& options, Table& table);

/// The noise of scans against that of other ones: the largest correlation of different exposures, the least of one that
/// is given again in another form, and the rate of false alarms.
[[nodiscard]] bool exposures_study(const StudyOptions& options, Table& table);

/// Slab types that differ only in the slab's ends: refused under the wrong type, never under their own.
[[nodiscard]] bool ends_study(const StudyOptions& options, Table& table);

/// A tooling ball in caps of several sizes: scatter of its centre against the floor of a fixed-radius fit, and whether
/// the reported covariance is true.
[[nodiscard]] bool ball_study(const StudyOptions& options, Table& table);

/// Slabs at the level of fitted features, errors drawn from the stated distributions: coverage of every item's U and
/// its mean against what 95 % coverage needs.
[[nodiscard]] bool coverage_study(const StudyOptions& options, Table& table);

/// Scans of real concrete: errors and coverage of every item, verdicts of good blocks, defects noticed and missed.
[[nodiscard]] bool real_study(const StudyOptions& options, Table& table);
/// The paper's seats (Table 5, Fig. 17) and registration deviations (Table 4) on drawn concrete.
[[nodiscard]] bool paper_study(const StudyOptions& options, Table& table);

/// Hand-eye sets with planted truth: error in the field of view against the optimum's, whether the predicted error is
/// true, and whether sets that carry no calibration are refused for the right reason.
[[nodiscard]] bool handeye_study(const StudyOptions& options, Table& table);
/// Calibrations driven by the suggested poses alone, against views drawn by the usual advice.
[[nodiscard]] bool guide_study(const StudyOptions& options, Table& table);

}  // namespace slabd::accuracy
