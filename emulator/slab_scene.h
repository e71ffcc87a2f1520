// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/base.h"
#include "base/limits.h"
#include "emulator/block_scene.h"
#include "emulator/defects.h"
#include "emulator/robot_error.h"

/// One slab on the emulated line: its truth and the poses that the robot reports, determined by a seed before the
/// first scan. The data does not change while the line runs, so peers read it from their threads without locks.
namespace slabd::emulator {

/// Random part of a slab, uniform within the given amplitudes.
struct SlabVariation {
  std::uint64_t seed = 1;       ///< seed of the line; the robot's error depends only on it
  std::uint32_t slab_no = 0;    ///< determines casting and placement together with the seed
  double casting = 1.0;         ///< scatter of the blocks' dimensions, times kScatter*; 0: as drawn
  double placement_mm = 2.5;    ///< slab in the cell, X and Y; Z half of it
  double placement_deg = 0.06;  ///< about Z; about X and Y a third of it
  double robot_mm = 0.017;      ///< the flange's real position relative to the reported one, the same for every slab
  /// 0: robot_mm is the amplitude of one wave over the cell. Otherwise the error is a random smooth field: robot_mm is
  /// its standard deviation per axis, and the errors at this distance have the correlation exp(-1/2) (RobotError).
  double robot_length_mm = 0.0;
  /// Largest offset between the stops of the stations, as planned by slabctl stations; 0: all are alike. Taught points
  /// are used as they are.
  double dither_mm = 0.0;
  double dither_deg = 0.0;
  double expansion = 0.0;  ///< relative, of the whole slab by its temperature
  SlabDesign design{};     ///< of a curve slab
  bool same_slab = false;  ///< casting and placement do not depend on slab_no: one slab, untouched between rounds
  // Repeatability: normally distributed per axis, new for every station of every slab.
  double robot_sigma_mm = 0.0;
  double robot_sigma_deg = 0.0;
};

/// Flange pose of one robot at a station, in this robot's own base.
struct Stop {
  Pose T_base_flange_real;
  Pose T_base_flange_reported;
};

struct StationTruth {
  BlockTruth block;
  Vec3 offset_slab_mm = Vec3::Zero();  ///< offset of the block from its designed position, slab axes
  double noise_mm = 0.03;
  double outlier_share = 0.005;
  /// Flatness of a block of real concrete, set after it was drawn; NaN: follows from `block`.
  double flatness_mm = kNoValue;
  Pose T_slab_block;                                 ///< real
  Pose T_base_flange_real;                           ///< real flange pose of the first robot at this station
  Pose T_base_flange_reported;                       ///< pose that it reports
  std::array<Stop, limits::kArmsMax - 1> further{};  ///< of the other robots: [arm - 1]

  [[nodiscard]] Stop stop(std::size_t arm) const {
    return arm == 0 ? Stop{T_base_flange_real, T_base_flange_reported} : further[arm - 1];
  }
};

struct SlabTruth {
  Pose T_base_slab;             ///< real pose of the slab
  double expansion = 0.0;       ///< relative, of everything below, by the slab's temperature
  std::uint64_t scan_seed = 0;  ///< noise, outliers and gaps of its scans
  std::uint64_t cast_seed = 0;  ///< marks on its concrete
  std::uint8_t stations = 0;
  std::array<StationTruth, limits::kStationsMax> station{};  ///< [station - 1]
  /// Reported flange pose beside the slab, from where no block is in view; [arm], in this robot's own base.
  std::array<Pose, limits::kArmsMax> aside{};

  [[nodiscard]] const StationTruth& at(int station_number) const {
    return station[static_cast<std::size_t>(station_number - 1)];
  }
};

/// A robot after the first, with its scanner.
struct FurtherArm {
  Pose T_base_robot;       ///< its base in the line's base, as tied
  Pose T_base_robot_real;  ///< where its base is
  Pose T_flange_scanner;   ///< taken as true
};

/// The cell of the slab, from the daemon's configuration.
struct Cell {
  Pose T_base_slab;                   ///< nominal
  Pose T_flange_scanner;              ///< taken as true
  std::vector<Pose> taught{};         ///< the first robot's targets by station; empty: straight above each block
  std::vector<FurtherArm> further{};  ///< arms after the first: [arm - 1]
};

/// Casts the slab. Code::config if a defect names a block that the recipe does not have.
[[nodiscard]] Result<SlabTruth> cast_slab(const Recipe& recipe, const Cell& cell, const SlabVariation& variation,
                                          std::span<const Defect> defects);

/// Real pose of block `station` in the frame of this arm's scanner, which stops at the station.
[[nodiscard]] Pose T_scanner_block(const SlabTruth& slab, const Cell& cell, int station, std::size_t arm = 0);

/// A base that is off its tied place by a motion of exactly this size, in a random direction: a turn by `deg` about a
/// random axis through `centre_mm` (line's base), then a shift by `mm`.
[[nodiscard]] Pose moved_base(const Pose& T_base_robot, const Vec3& centre_mm, double mm, double deg,
                              std::uint64_t seed);

/// The true value of a block item in the item's unit, or of seat_lateral / seat_vertical as planted, before any slab
/// fit. NaN for items that the scene does not determine.
[[nodiscard]] double true_value(const Recipe& recipe, const StationTruth& station, ItemId id);

/// The true value of an item between seats or of the whole slab, from the real positions of the blocks: seat_spacing
/// (`station` and the next), large_jaw_distance (`station` and the one across), corner_level, warp_left, warp_right.
/// None of them depends on the slab's frame. NaN for other items and missing blocks.
[[nodiscard]] double true_slab_value(const Recipe& recipe, const SlabTruth& slab, ItemId id, int station = 0);

/// Seed of an independent random stream for one purpose: the same (seed, a, b) always gives the same stream.
[[nodiscard]] std::uint64_t derived_seed(std::uint64_t seed, std::uint64_t a, std::uint64_t b);

}  // namespace slabd::emulator
