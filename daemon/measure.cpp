// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cassert>

#include "algo/algo.h"
#include "base/scan_place.h"
#include "config/config.h"
#include "daemon/commit.h"
#include "daemon/measure.h"

namespace slabd::daemon {

namespace {

/// Detects exchanged axes: a scan that is far longer along the rail than across it. Blocks are more than twice as long
/// across.
ScanDoubt doubt_turn(const ScanPlace& place, const Pose& T_scanner_block) {
  constexpr double kLonger = 1.25;
  constexpr std::array kNames = {'X', 'Y', 'Z'};
  const auto axis_of = [&](const Vec3& of_block) {
    Eigen::Index axis = 0;
    (T_scanner_block.rotation * of_block).cwiseAbs().maxCoeff(&axis);
    return axis;
  };
  ScanDoubt doubt;
  const Eigen::Index rail = axis_of(Vec3::UnitX());
  const Eigen::Index across = axis_of(Vec3::UnitY());
  const Vec3 extent = place.extent();
  if (place.points > 0 && extent[rail] > kLonger * extent[across])
    doubt.printf(
        "the scan is %.0f mm long along %c and %.0f along %c, and the block extends along %c: the two may be "
        "exchanged, or the scanner is turned",
        extent[rail], kNames[static_cast<std::size_t>(rail)], extent[across], kNames[static_cast<std::size_t>(across)],
        kNames[static_cast<std::size_t>(across)]);
  return doubt;
}

/// Adds a probable cause to an error. A block that was not found may be visible in another unit or frame; coordinates
/// that seem rounded may be fine in their own unit. `place` is that of the scan as it was read.
Error named_cause(const Error& why, const ScanPlace& place, const Pose& T_base_block, const Pose& T_base_scanner) {
  if (why.code != Code::block_not_found && why.code != Code::too_few_points && why.code != Code::fit_failed &&
      why.code != Code::frame_incomplete)
    return why;
  const Pose T_scanner_block = T_base_scanner.inverse() * T_base_block;
  ExpectedPlace expected;
  expected.scanner_mm = T_scanner_block.translation_mm;
  expected.base_mm = T_base_block.translation_mm;
  // Offline the robot is missing, and the block's frame replaces its base frame.
  if (expected.base_mm.norm() == 0.0) expected.base_name = "block's";
  ScanDoubt doubt = doubt_scan(place, expected);
  if (doubt.empty() && why.code == Code::block_not_found) doubt = doubt_turn(place, T_scanner_block);
  if (doubt.empty()) return why;
  if (why.code == Code::frame_incomplete) return error(why.code, "%s; %s", doubt.c_str(), why.text.c_str());
  return error(why.code, "%s; %s", why.text.c_str(), doubt.c_str());
}

}  // namespace

Status measure_block(algo::BlockInspector& inspector, const hal::Clock& clock, int station, const Pose& T_base_block,
                     const Pose& T_base_scanner, algo::Cloud cloud, const ScanShape& read, double read_ms,
                     const ScannerNumbers& verified, const SlabFacts& slab, double scanner_drift) {
  inspector.begin(station, T_base_block, T_base_scanner, verified, slab, scanner_drift);
  StageTimes times;
  times.read_ms = read_ms;
  std::int64_t stage_start_ns = clock.mono_ns();
  const auto lap_ms = [&] {
    const std::int64_t now_ns = clock.mono_ns();
    const double lap = ms_from_ns(now_ns - stage_start_ns);
    stage_start_ns = now_ns;
    return lap;
  };

  const ScanPlace place = scan_place(cloud.xyz.first(std::min(3 * cloud.points, cloud.xyz.size())));
  Status status = inspector.denoise(cloud);
  times.denoise_ms = lap_ms();
  if (status.ok()) {
    status = inspector.register_to_model(cloud);
    times.register_ms = lap_ms();
  }
  if (status.ok()) status = inspector.extract(cloud);
  inspector.judge(status.ok() ? Code::ok : status.error().code);
  times.extract_ms = lap_ms();
  times.total_ms = times.read_ms + times.denoise_ms + times.register_ms + times.extract_ms;

  BlockResult& result = inspector.result();
  result.scan.points_read = read.points;
  result.scan.points_finite = read.finite;
  result.times = times;
  if (!status.ok()) return named_cause(status.error(), place, T_base_block, T_base_scanner);
  return status;
}

void judge_slab(const SlabBasis& basis, std::span<const StationRecord> stations, std::span<BlockResult> blocks,
                SlabResult& out) {
  const Recipe& recipe = *basis.recipe;
  assert(stations.size() <= limits::kStationsMax && blocks.size() >= recipe.stations());
  std::array<algo::StationSigma, limits::kStationsMax> sigmas;
  for (std::size_t i = 0; i < stations.size() && i < blocks.size(); ++i) {
    const StationRecord& record = stations[i];
    if (record.phase == StationPhase::measured) {
      blocks[i] = record.block;
    } else {
      blocks[i] = {};
      blocks[i].station = static_cast<std::uint8_t>(i + 1);
      if (record.phase == StationPhase::failed) {
        blocks[i].verdict = Verdict::not_measured;
        blocks[i].reason = record.code;
      }
    }
    // The splice that each scan was measured with, from its attempt.
    const Splice& splice = record.attempt.splice;
    sigmas[i] = {splice.calibration_mm, splice.calibration_rad, splice.robot_mm, splice.robot_rad,
                 record.attempt.scanner_drift, record.attempt.arm};
  }
  const algo::SlabArms arms{basis.verified, basis.has_tie ? &basis.tie : nullptr};
  algo::inspect_slab(recipe, blocks.first(recipe.stations()), sigmas, basis.T_base_slab, out, arms, basis.slab);
}

void pack_maps(const algo::BlockInspector& inspector, BlockMaps& maps) {
  maps = {};
  const algo::DeviationMap deviations = inspector.deviation_map();
  if (deviations.columns == 0 || inspector.result().registration.deviation.count == 0) return;
  pack_map(
      deviations.columns, deviations.rows, deviations.cell_mm, limits::kDeviationMapStep_mm,
      [&](std::size_t column, std::size_t row) { return deviations.mean_mm(row * deviations.columns + column); },
      maps.registration);
  const algo::SeatMap seat = inspector.seat_map();
  pack_map(
      seat.columns, seat.rows, seat.cell_mm, limits::kSeatMapStep_mm,
      [&](std::size_t column, std::size_t row) { return seat.mean_mm(column, row); }, maps.seat);
}

FixedString<64> software_version() {
  FixedString<64> text;
  text.printf("slabd %s+%s", SLABD_VERSION, commit());
  return text;
}

}  // namespace slabd::daemon
