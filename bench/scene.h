// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "bench/peers/peer.h"
#include "emulator/scan_drawing.h"

/// The scan that all programs measure, with known truth: 2048 x 2448 points at 0.255 mm, noise 0.03 mm, 0.5 % outliers
/// 1 to 60 mm off, 2 % missing. The block is as drawn, displaced from the assumed start by (2, 2, 1) mm and 0.5 deg
/// about (1, 1, 1). The emulator draws it; its geometry shares no code with algo.
namespace slabd::bench {

inline constexpr double kPitch_mm = 0.255;
inline constexpr std::size_t kColumns = 2048;
inline constexpr std::size_t kRows = 2448;
inline constexpr std::uint64_t kSeed = 20;

struct Scan {
  std::vector<float> xyz;  ///< NaN for missing points if organised
  std::size_t width = 0;   ///< 0 = unorganised
  std::size_t height = 0;
  [[nodiscard]] std::size_t points() const { return xyz.size() / 3; }
};

class Scene {
 public:
  /// `seed`: seed of the noise, outliers and missing points.
  explicit Scene(const Recipe& recipe, std::uint64_t seed = kSeed);

  /// Draws the scan with this number of columns and rows over the same field. The same seed gives the same bits.
  [[nodiscard]] Scan draw(std::size_t columns = kColumns, std::size_t rows = kRows,
                          emulator::Projection projection = emulator::Projection::parallel) const;

  [[nodiscard]] const Pose& T_scanner_block() const { return T_scanner_block_; }
  [[nodiscard]] Truth truth() const;
  /// 1 if a point is more than half a millimetre off the surface along the ray: outliers are at least 1 mm off. 0 for
  /// missing points.
  [[nodiscard]] std::vector<std::uint8_t> labels(const Scan& scan) const;

  /// Points of the bearing plane cropped with the start pose, with outliers and a few points of the jaws.
  [[nodiscard]] std::vector<float> crop(const Scan& scan) const;

  /// Writes the files listed in bench/peers/peer.h. Returns false and prints to stderr on failure.
  [[nodiscard]] bool write(const Scan& organised, const std::string& folder) const;

 private:
  [[nodiscard]] std::vector<float> model() const;
  Recipe recipe_;
  std::uint64_t seed_;
  emulator::BlockTruth block_;
  Pose T_scanner_block_;
};

/// Writes the points of scan.ply as text, scan_ascii.ply and scan.xyz. Returns false and prints to stderr on failure.
[[nodiscard]] bool write_as_text(const Scan& organised, const std::string& folder);

/// The scan without the missing points, in the same order.
[[nodiscard]] Scan unorganised(const Scan& organised);
/// The same in random order, as from several merged views.
[[nodiscard]] Scan shuffled(const Scan& organised);

}  // namespace slabd::bench
