// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/base.h"
#include "emulator/block_scene.h"
#include "emulator/defects.h"
#include "emulator/robot_error.h"

/// One slab on the emulated line as it really is, beside what the robot says: all truth, decided by a seed before the
/// first scan. Nothing here changes while the line runs, so peers read it from their threads without locks.
namespace slabd::simulate {

/// What is random about a slab, all of it uniform within the given amplitude.
struct SlabVariation {
  std::uint64_t seed = 1;       ///< of the line; the robot's error depends on it alone
  std::uint32_t slab_no = 0;    ///< together with the seed decides casting and placement
  double casting = 1.0;         ///< scatter of the blocks' dimensions, times kCastingScatter*; 0 = as drawn
  double placement_mm = 2.5;    ///< slab in the cell, X and Y; Z half of it
  double placement_deg = 0.06;  ///< about Z; about X and Y a third of it
  double robot_mm = 0.017;      ///< the flange's real position against the reported one, the same for every slab
  /// 0: robot_mm is the amplitude of one wave over the cell. Else the error is a random smooth field: robot_mm is its
  /// standard deviation per axis, and places this far apart have errors with the correlation exp(-1/2) (RobotError).
  double robot_length_mm = 0.0;
  /// Stops differ from station to station as slabctl stations plans them, up to this; 0: all are alike. Taught points
  /// are driven to as they are.
  double dither_mm = 0.0;
  double dither_deg = 0.0;
  bool same_slab = false;  ///< casting and placement do not depend on slab_no: one slab, not touched between rounds
  // Repeatability: normally distributed per axis, new for every station of every slab.
  double robot_sigma_mm = 0.0;
  double robot_sigma_deg = 0.0;
};

struct StationTruth {
  BlockTruth block;
  Vec3 offset_slab_mm = Vec3::Zero();  ///< of the block against its nominal place, slab axes
  double noise_mm = 0.03;
  double outlier_share = 0.005;
  /// Flatness of a block of real concrete, set after it was drawn; NaN: follows from `block`.
  double flatness_mm = kNoValue;
  Pose T_slab_block;            ///< real
  Pose T_base_flange_real;      ///< where the flange stands for this station
  Pose T_base_flange_reported;  ///< what the robot says
};

struct SlabTruth {
  Pose T_base_slab;             ///< where the slab lies
  std::uint64_t scan_seed = 0;  ///< noise, outliers and gaps of its scans
  std::uint64_t cast_seed = 0;  ///< what is on its concrete
  std::uint8_t stations = 0;
  std::array<StationTruth, limits::kStationsMax> station{};  ///< [station - 1]

  [[nodiscard]] const StationTruth& at(int station_number) const {
    return station[static_cast<std::size_t>(station_number - 1)];
  }
};

/// The cell the slab lies in, from the daemon's configuration.
struct Cell {
  Pose T_base_slab;            ///< nominal
  Pose T_flange_scanner;       ///< taken as true
  std::vector<Pose> taught{};  ///< where the robot drives to, station by station; empty: straight above each block
};

/// Casts the slab. config when a defect names a block that the recipe does not have.
[[nodiscard]] Result<SlabTruth> cast_slab(const Recipe& recipe, const Cell& cell, const SlabVariation& variation,
                                          std::span<const Defect> defects);

/// Where the scanner really sees block `station`.
[[nodiscard]] Pose T_scanner_block(const SlabTruth& slab, const Cell& cell, int station);

/// The true value of a block item in the item's unit, or of seat_lateral / seat_vertical as planted (before any slab
/// fit shares it out); NaN for items the scene does not determine.
[[nodiscard]] double true_value(const Recipe& recipe, const StationTruth& station, ItemId id);

/// The true value of an item between seats or of the whole slab, from where the blocks really stand: seat_spacing
/// (`station` and the next), large_jaw_distance (`station` and the one across), corner_level, warp_left, warp_right.
/// None of them changes with the frame that the slab is put into. NaN for other items and missing blocks.
[[nodiscard]] double true_slab_value(const Recipe& recipe, const SlabTruth& slab, ItemId id, int station = 0);

/// Independent stream of random numbers for one purpose: the same (seed, a, b) always gives the same stream.
[[nodiscard]] std::uint64_t derived_seed(std::uint64_t seed, std::uint64_t a, std::uint64_t b);

}  // namespace slabd::simulate
