// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "algo/algo.h"
#include "emulator/scan_drawing.h"
#include "emulator/slab_scene.h"

/// One block drawn by the line emulator's geometry (which shares nothing with algo) and measured as the daemon
/// measures it.
namespace slabd::accuracy {

/// The shipped recipe; nothing (and a message on stderr) when it cannot be read.
[[nodiscard]] std::optional<Recipe> reference_recipe();

/// Tells the recipe's budget that the scanner and its reference have no error but noise, so that U is what the fits
/// and the noise explain.
void expect_perfect_scanner(Recipe& recipe);

/// A block with known dimensions, seen by a scanner from a known place.
struct Sight {
  simulate::StationTruth station;
  Pose T_scanner_block;  ///< true
};

/// Block of a rough casting (dimensions scattered over about half of their tolerances), seen from up to `off_mm` and
/// `off_deg` beside the nominal view, per axis.
[[nodiscard]] Sight varied_sight(const Recipe& recipe, std::uint64_t seed, double off_mm = 3.0, double off_deg = 0.5);

/// What concrete looks like where no steel has formed it: a smooth random relief, along the scanner's rays, on every
/// face but the bearing plane. It belongs to the block: every scan of it sees the same.
struct RoughConcrete {
  double std_mm = 0.0;
  double length_mm = 25.0;  ///< distance at which two heights have 1/e in common
  std::uint64_t seed = 1;
};

/// Draws and measures; keeps the 72 MB of buffer and the workspace from block to block.
class BlockBench {
 public:
  explicit BlockBench(const Recipe& recipe);

  /// Draws the scan and runs every stage from `T_block_scanner_start` (default: the nominal view). False when a stage
  /// failed or the scan could not be drawn; `result()` and `trouble()` say how.
  [[nodiscard]] bool measure(const Sight& sight, const simulate::ScannerTraits& traits, std::uint64_t seed,
                             const Pose& T_block_scanner_start = nominal_T_block_scanner());

  /// The scanner's field is bent: depths are off by +-this at both ends of the picture along its Y, in an S (cubic).
  double field_error_mm = 0.0;
  /// std_mm 0: the block is its model.
  RoughConcrete concrete;

  [[nodiscard]] const BlockResult& result() const { return inspector_.result(); }
  [[nodiscard]] const std::string& trouble() const { return trouble_; }
  /// The item's value; NaN when not measured.
  [[nodiscard]] const Item& item(ItemId id) const;

 private:
  void roughen(const Sight& sight);

  Recipe recipe_;
  algo::BlockInspector inspector_;
  std::vector<float> xyz_;
  std::string trouble_;
};

}  // namespace slabd::accuracy
