// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "algo/algo.h"
#include "emulator/scan_drawing.h"
#include "emulator/slab_scene.h"

/// One block, drawn by the line emulator's geometry (which shares no code with algo) and measured as by the daemon.
namespace slabd::accuracy {

/// The shipped recipe; nullopt and a message on stderr if it cannot be read.
[[nodiscard]] std::optional<Recipe> reference_recipe();

/// Sets all scanner errors of the recipe's budget except noise to zero, so that U contains only the fits and the
/// noise.
void expect_perfect_scanner(Recipe& recipe);

/// A block with known dimensions and the true scanner pose.
struct Sight {
  emulator::StationTruth station;
  Pose T_scanner_block;  ///< true
};

/// A block with dimensions scattered over about half of their tolerances. The scanner is up to `off_mm` and `off_deg`
/// off the nominal view, per axis.
[[nodiscard]] Sight varied_sight(const Recipe& recipe, std::uint64_t seed, double off_mm = 3.0, double off_deg = 0.5);

/// Relief of concrete that was not formed by steel: smooth and random, along the scanner's Z, on every face except the
/// bearing plane. It belongs to the block and is the same in every scan.
struct RoughConcrete {
  double std_mm = 0.0;
  double length_mm = 25.0;  ///< distance at which the correlation is 1/e
  std::uint64_t seed = 1;
};

/// Draws and measures blocks; keeps its 72 MB buffer and workspace from block to block.
class BlockBench {
 public:
  explicit BlockBench(const Recipe& recipe);

  /// Draws the scan and runs every stage from `T_block_scanner_start` (default: the nominal view). Returns false if a
  /// stage failed or the scan could not be drawn; `result()` and `trouble()` contain the reason.
  [[nodiscard]] bool measure(const Sight& sight, const emulator::ScannerTraits& traits, std::uint64_t seed,
                             const Pose& T_block_scanner_start = nominal_T_block_scanner());

  /// Field error of the scanner: depths are off by +-this at both ends of the picture along its Y, in an S (cubic).
  double field_error_mm = 0.0;
  /// With std_mm 0 the block is equal to its model.
  RoughConcrete concrete;

  [[nodiscard]] const BlockResult& result() const { return inspector_.result(); }
  [[nodiscard]] const std::string& trouble() const { return trouble_; }
  /// The item; its value is NaN if it was not measured.
  [[nodiscard]] const Item& item(ItemId id) const;

 private:
  void roughen(const Sight& sight);

  Recipe recipe_;
  algo::BlockInspector inspector_;
  std::vector<float> xyz_;
  std::string trouble_;
};

}  // namespace slabd::accuracy
