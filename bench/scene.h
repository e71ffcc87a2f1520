// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "bench/peers/peer.h"
#include "emulator/scan_drawing.h"

/// The scan that everybody measures, with known truth: 2048 x 2448 points at 0.255 mm, noise 0.03 mm, 0.5 % outliers
/// 1 to 60 mm off, 2 % missing; the block is as drawn and stands (2, 2, 1) mm and 0.5 deg about (1, 1, 1) beside where
/// the start assumes it. Drawn by the emulator's geometry, which shares nothing with algo.
namespace slabd::bench {

inline constexpr double kPitchMm = 0.255;
inline constexpr std::size_t kColumns = 2048;
inline constexpr std::size_t kRows = 2448;
inline constexpr std::uint64_t kSeed = 20;

struct Scan {
  std::vector<float> xyz;  ///< NaN for missing points when organised
  std::size_t width = 0;   ///< 0 = unorganised
  std::size_t height = 0;
  [[nodiscard]] std::size_t points() const { return xyz.size() / 3; }
};

class Scene {
 public:
  /// `seed`: of noise, outliers and missing points.
  explicit Scene(const Recipe& recipe, std::uint64_t seed = kSeed);

  /// The scan of so many columns and rows over the same field. Same seed, same bits.
  [[nodiscard]] Scan draw(std::size_t columns = kColumns, std::size_t rows = kRows,
                          simulate::Projection projection = simulate::Projection::parallel) const;

  [[nodiscard]] const Pose& T_scanner_block() const { return T_scanner_block_; }
  [[nodiscard]] Truth truth() const;
  /// 1 where a point stands more than half a millimetre off the surface along the ray: outliers stand 1 mm off or more.
  /// 0 for missing points.
  [[nodiscard]] std::vector<std::uint8_t> labels(const Scan& scan) const;

  /// The bearing plane as the start sees it: outliers and a little of the jaws among its points.
  [[nodiscard]] std::vector<float> crop(const Scan& scan) const;

  /// Writes what bench/peers/peer.h lists. False, and a message on stderr, when that fails.
  [[nodiscard]] bool write(const Scan& organised, const std::string& folder) const;

 private:
  [[nodiscard]] std::vector<float> model() const;
  Recipe recipe_;
  std::uint64_t seed_;
  simulate::BlockTruth block_;
  Pose T_scanner_block_;
};

/// The points of scan.ply as text, scan_ascii.ply and scan.xyz. False, and a message on stderr, when that fails.
[[nodiscard]] bool write_as_text(const Scan& organised, const std::string& folder);

/// Without the missing points, in the order of the scan.
[[nodiscard]] Scan unorganised(const Scan& organised);
/// ... and in an order of no meaning, as from several merged views.
[[nodiscard]] Scan shuffled(const Scan& organised);

}  // namespace slabd::bench
