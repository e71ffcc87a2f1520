// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "bench/samples.h"

/// Common part of all programs of the comparison, slabd's own included: task, clocks, and the truth for scoring. Only
/// standard types are used, because every library has its own flags and Eigen alignment.
///
/// The task is a folder written by the driver (bench/scene.h describes its scan):
///     scan.ply      the scan as binary PLY, missing points left out; scan_organised.ply: with its grid
///     labels.u8     1 for every point of scan.ply that is an outlier
///     model.f32     the model's surface, x y z nx ny nz, block frame, one point per 1.5 mm
///     clean.f32     the scan on 1.5 mm voxels, freed of outliers by the true labels, x y z, scanner frame
///     crop.f32      the bearing plane's points, x y z, scanner frame, outliers and a little of the jaws among them
///     truth.f64     T_block_scanner as it is and as the start assumes (4x4 by rows), the seat's normal in the block
namespace slabd::bench {

/// A rigid transform by rows: p_a = T_a_b p_b.
using Rigid = std::array<double, 16>;
using Direction = std::array<double, 3>;

struct Truth {
  Rigid T_block_scanner{};
  Rigid T_block_scanner_start{};
  Direction seat_normal_block{};
};

/// Settings that all programs share, so that they do the same work.
inline constexpr double kVoxel_mm = 1.5;
inline constexpr double kIcpGate_mm = 6.0;
inline constexpr int kIcpIterationsMax = 50;
inline constexpr int kSorNeighbours = 20;
inline constexpr double kSorSigmas = 2.0;
inline constexpr double kPlaneInlier_mm = 0.10;
/// Crop of the bearing plane in the block's frame: |x|, |y| and the distance to the nominal plane are below these
/// limits.
inline constexpr double kCropX_mm = 95.0;
inline constexpr double kCropY_mm = 185.0;
inline constexpr double kCropZ_mm = 12.0;
inline constexpr double kSlope = 1.0 / 40.0;

/// One run of one program on one task; prints its results as one line of JSON on stdout.
class Peer {
 public:
  /// Parses `peer --folder F --job J [--repeats N] [--threads N]`; ends the process with a message on any other
  /// command line.
  Peer(int argc, char** argv, std::string name, std::string version);

  [[nodiscard]] const std::string& job() const { return job_; }
  [[nodiscard]] int repeats() const { return repeats_; }
  [[nodiscard]] int threads() const { return threads_; }
  [[nodiscard]] const Truth& truth() const { return truth_; }
  [[nodiscard]] std::string path(const std::string& file) const { return folder_ + "/" + file; }
  /// Contents of a file of the folder as numbers; ends the process if it cannot be read.
  [[nodiscard]] std::vector<float> floats(const std::string& file) const;
  [[nodiscard]] std::vector<std::uint8_t> labels() const;

  /// Starts the clocks of one repetition.
  void begin();
  /// Assigns the time since `begin` or the last lap to `stage`.
  void lap(const std::string& stage);
  /// Stops the clocks. Later work (scoring) is not timed.
  void end();

  void score_pose(const Rigid& T_block_scanner);
  /// Scores the normal of the seat plane, in the scanner's frame, either sign.
  void score_normal(const Direction& normal_scanner);
  /// `kept[i]`: point i of scan.ply was kept.
  void score_denoising(const std::vector<bool>& kept);
  /// Stores the largest value of all repetitions, or NaN if one of them is NaN.
  void figure(const std::string& name, double value);

  /// Prints the line. Returns the exit status.
  [[nodiscard]] int print() const;

 private:
  struct Repeat {
    std::vector<std::pair<std::string, Sample>> stages;
    Sample total;
    double allocations = -1.0;  ///< -1: not counted
  };
  std::string name_, version_, folder_, job_;
  int repeats_ = 1;
  int threads_ = 1;
  Truth truth_;
  std::vector<Repeat> runs_;
  std::vector<std::pair<std::string, double>> figures_;
  Stopwatch watch_;
  std::uint64_t heap_calls_ = 0;
};

/// a * b of rigid transforms, and the inverse.
[[nodiscard]] Rigid product(const Rigid& a, const Rigid& b);
[[nodiscard]] Rigid inverse(const Rigid& T);
[[nodiscard]] Direction rotated(const Rigid& T, const Direction& v);

/// A plane n.p = d with its inliers. refit_plane replaces it by the orthogonal least-squares fit of the points within
/// `reach_mm`, as careful users of a library do after RANSAC. Double precision, one pass per step, until the number of
/// inliers no longer changes or `steps_max` is reached. Points are `stride` floats or doubles apart, x y z first.
/// spread_about computes peak to valley and standard deviation.
struct PlaneAnswer {
  Direction normal{};
  double offset_mm = 0.0;
  std::size_t inliers = 0;
  double std_mm = 0.0;
  double peak_to_valley_mm = 0.0;
};
template <class Number>
void refit_plane(const Number* xyz, std::size_t points, std::size_t stride, double reach_mm, PlaneAnswer& plane);
template <class Number>
void spread_about(const Number* xyz, std::size_t points, std::size_t stride, double reach_mm, PlaneAnswer& plane);

}  // namespace slabd::bench
