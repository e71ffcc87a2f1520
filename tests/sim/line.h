// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "base/jobs.h"
#include "daemon/station/station.h"
#include "tests/sim/world.h"

/// The physical state: the slab on the line, the robot with the scanner, and the true content of every scan. Verdicts
/// of slabd, which cannot access it, are compared with it.
namespace slabd::sim {

enum class BlockTruth : std::uint8_t { good, slope, jaw, protrusion, flatness, hidden, displaced };
[[nodiscard]] inline bool is_good(BlockTruth truth) {
  return truth == BlockTruth::good;
}

/// One slab on the line, from the moment it is placed.
struct SlabTruth {
  std::uint32_t serial = 0;  ///< counts placements: the same slab placed again has a new number
  std::uint32_t slab_no = 0;
  const Recipe* recipe = nullptr;
  std::array<BlockTruth, limits::kStationsMax> blocks{};
  Pose T_base_slab;  ///< its true position
  std::int64_t placed_ns = 0;

  [[nodiscard]] bool good() const {
    for (int k = 0; k < recipe->stations(); ++k)
      if (!is_good(blocks[static_cast<std::size_t>(k)])) return false;
    return true;
  }
};

/// True content of one scan. Its number is passed through slabd like the points: in the buffer and in the spool.
struct ScanTruth {
  std::uint32_t take = 0;    ///< number of the exposure; 0: the buffer was never written
  std::uint32_t serial = 0;  ///< of the slab
  std::uint8_t block = 0;    ///< block in the scan, 0: none
  BlockTruth truth = BlockTruth::hidden;
  bool smeared = false;  ///< the robot moved during the exposure
  bool mostly_nan = false;
  Pose T_scanner_block;
  std::int64_t exposed_ns = 0;  ///< start of the exposure
};
/// Floats of a buffer that contain the number of the exposure.
inline constexpr std::size_t kTruthFloats = 4;

/// The robot: it is at a station (0: home) or travels.
class Robot {
 public:
  /// `part`: its random source. All poses are in the base frame of the line.
  Robot(World& world, std::uint64_t part, const Vec3& home_mm, const Pose& T_base_slab_nominal,
        const Pose& T_flange_scanner);

  /// Moves by the PLC's order; takes about a second.
  void go_to(const Recipe& recipe, int station);
  void go_home();
  [[nodiscard]] bool arrived() const { return world_.now_ns >= arrives_ns_; }
  /// Pose of the flange at this or a nearby moment.
  [[nodiscard]] Pose T_base_flange(std::int64_t at_ns) const;
  [[nodiscard]] Pose T_base_scanner(std::int64_t at_ns) const { return T_base_flange(at_ns) * T_flange_scanner_; }
  /// True if it moves at some time in this interval.
  [[nodiscard]] bool moves(std::int64_t from_ns, std::int64_t to_ns) const;
  /// Shakes the robot for a moment.
  void jolt(std::int64_t at_ns, std::int64_t for_ns) {
    jolt_from_ns_ = at_ns;
    jolt_to_ns_ = at_ns + for_ns;
  }

 private:
  void go(const Pose& T_base_flange);

  World& world_;
  Prng chance_;
  Pose T_base_slab_;
  Pose T_flange_scanner_;
  Pose home_;
  Pose from_;
  Pose to_;
  std::int64_t leaves_ns_ = 0;
  std::int64_t arrives_ns_ = 0;
  std::int64_t jolt_from_ns_ = 0;
  std::int64_t jolt_to_ns_ = 0;
};

/// The present state of the line.
struct Line {
  /// `robots_in`: 1 or 2, each with a scanner.
  Line(World& world_in, std::span<const Recipe> recipes_in, int robots_in);

  World& world;
  std::span<const Recipe> recipes;
  Prng chance;
  Pose T_base_slab;                            ///< as configured
  std::vector<Pose> T_base_robot;              ///< [arm]; the first is the identity
  std::vector<Pose> T_flange_scanner;          ///< [arm]
  std::vector<Robot> robots;                   ///< [arm]
  LineArms arms;                               ///< who may scan which station
  SlabTruth slab;                              ///< serial 0: the line is empty
  std::vector<ScanTruth> takes;                ///< every exposure
  std::map<std::string, std::uint32_t> spool;  ///< durable scans by path: number of the exposure
  /// Scans that measuring refused, by slab, station and attempt: their data must not reach a verdict.
  std::set<std::tuple<std::int64_t, int, int>> refused;
  std::array<std::uint32_t, 2> last_export{};  ///< the exposure that each scanner returned last, for any request

  /// Places the next slab. `again`: the last one, possibly damaged in the meantime.
  void lay_down(bool again, bool certainly_good);
  void take_away() { slab.serial = 0; }
  /// Starts an exposure; later events may still spoil its content.
  [[nodiscard]] ScanTruth& expose(std::size_t arm);
  void write(const ScanTruth& shown, std::span<float> xyz) const;
  /// The exposure in a buffer; take 0: none.
  [[nodiscard]] ScanTruth read(std::span<const float> xyz) const;
  [[nodiscard]] ScanTruth in_spool(const std::string& path) const;

 private:
  std::uint32_t serials_ = 0;
  std::uint32_t last_no_ = 0;
};

/// Replaces the inspector: returns its result for these points, as items judged by the recipe. The points contain the
/// number of their exposure, so a scan of millions of points is not needed.
void gauge(const Recipe& recipe, const daemon::MeasureBlock& job, const ScanTruth& shown, BlockResult& block);

}  // namespace slabd::sim
