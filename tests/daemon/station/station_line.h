// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <optional>
#include <vector>

#include "base/dither.h"
#include "daemon/station/station.h"
#include "tests/daemon/station/memory_store.h"

/// A whole line around the station, without threads, files or time. It has a PLC that keeps the written rules, a robot
/// at rest, a scanner, a worker and a database. A test can make each of them fail. Time advances only in `run_for`.
namespace slabd::daemon {

inline Recipe test_recipe() {
  Recipe recipe;
  recipe.name = "P5600";
  recipe.slab_type = 5600;
  recipe.sha256 = "abc";
  recipe.slab.pairs = 9;
  recipe.slab.length_mm.value = 5600;
  recipe.slab.pitch_mm.value = 630;
  recipe.slab.first_pair_from_end_mm.value = 280;
  recipe.slab.seat_centre_distance_mm.value = 1516;
  recipe.slab.block_origin_z_mm.value = 30;
  return recipe;
}

/// Another slab type with other figures: 8 pairs.
inline Recipe short_recipe() {
  Recipe recipe = test_recipe();
  recipe.name = "P4925";
  recipe.slab_type = 4925;
  recipe.slab.pairs = 8;
  recipe.slab.length_mm.value = 4925;
  recipe.slab.pitch_mm.value = 617;
  recipe.slab.first_pair_from_end_mm.value = 303;
  return recipe;
}

class Line {
 public:
  explicit Line(MemoryStore& store_in, const Recipe& recipe_in = test_recipe()) : store(store_in), recipe(recipe_in) {
    start();
  }

  // ---- faults that a test can set ----
  bool robot_present = true;
  bool numbers_slabs = true;
  double robot_off_mm = 0.0;    ///< distance from the commanded station
  double robot_moves_mm = 0.0;  ///< while a scan is taken
  bool robot_shakes = false;
  bool robot_says_stopped = false;
  bool robot_emulated = false;
  bool robot_commanded = false;  ///< its poses are not measured
  bool scan_emulated = false;
  double scanner_temperature_c = kNoValue;  ///< as the scans declare it
  double robot_shake_mm = 0.2;
  double robot_turn_rad = 0.0;    ///< about base Z
  Dither dither{0.0, 0.0};        ///< the stops; all alike at first
  bool blocks_are_found = false;  ///< measurements have the pose of the block
  std::int16_t robot_tool = 0;    ///< active on the controller
  Code scan_code = Code::ok;
  bool worker_hangs = false;  ///< the scanner's worker, in a call that cannot be cancelled
  bool scanner_answers = true;
  bool disk_syncs = true;         ///< false: the scan is in the buffer, and `sync_ends` decides when and how it
                                  ///< continues
  std::uint64_t fingerprint = 0;  ///< of the next scans' points
  std::uint64_t fingerprint_thrown_away = 0;  ///< of discarded scans; 0: as for the others
  std::optional<std::uint32_t> points_crc32c{};
  bool decodes_first = true;    ///< false: the points are not reported before they are durable
  bool measuring_works = true;  ///< false: MeasureBlock is never answered
  Verdict block_verdict = Verdict::pass;
  Code refuses = Code::ok;  ///< result of measuring
  // The second robot and its scanner, if settings.arms lists them.
  Pose T_base_robot_2;
  int robot_2_station = 0;  ///< where it stands; 0: it looks at no block
  Code scan_code_2 = Code::ok;
  bool scanner_2_answers = true;
  bool plc_beats = true;
  bool disk_answers = true;  ///< false: jobs wait without end, as on a disk that hangs

  MemoryStore& store;
  Recipe recipe;
  std::uint16_t slab_type = recipe.slab_type;  ///< as requested by the PLC, whether or not the daemon has it
  StationSettings settings;
  std::unique_ptr<Station> station;
  PlcInputs plc;
  std::vector<MeasureBlock> measured;
  std::vector<AcquireScan> scans;
  int cancelled = 0;
  std::vector<std::string> dropped;  ///< views' scans that were deleted
  std::vector<std::string> logged;
  int robot_station = 1;

  /// A new process on the same database.
  void start() {
    settings.recipes = std::span(&recipe, 1);
    settings.calibration_id = "cal";
    settings.spool_dir = "/spool";
    station = std::make_unique<Station>(settings);
    pending_.clear();
    const RecoveredLine line = store.recover();
    feed(Recovered{&line});
    run_for(20);
  }

  PlcOutputs view() const { return plc_view(*station); }

  /// Ends the writing of the current scan, with this code.
  void sync_ends(Code code) {
    syncing_.code = code;
    feed(syncing_);
  }

  /// Ends the oldest measurement that was held back (measuring_works).
  void measuring_ends() {
    const MeasureBlock measure = measured.front();
    measured.erase(measured.begin());
    feed(measurement_of(measure));
  }

  /// Called around every step, for tests that observe single steps.
  void (*before_step)() = nullptr;
  void (*after_step)() = nullptr;

  void feed(const Event& event) {
    if (before_step != nullptr) before_step();
    step(*station, event, actions_);
    if (after_step != nullptr) after_step();
    const std::vector<Action> actions(actions_.begin(), actions_.end());
    for (const Action& action : actions) carry_out(action);
  }

  /// Ticks of 4 ms with poses, heartbeat and the answers that have become due.
  void run_for(int ms) {
    for (int t = 0; t < ms; t += 4) {
      now_ns_ += 4 * kNsPerMs;
      feed(Tick{now_ns_, now_ns_ / 1000 + 1'000'000});
      if (robot_present) feed(pose());
      if (settings.arms.several()) feed(pose_of_second());
      if (plc_beats && now_ns_ - beat_ns_ > 250 * kNsPerMs) {
        beat_ns_ = now_ns_;
        ++plc.heartbeat;
        feed(plc);
      }
      std::deque<Event> due;
      due.swap(pending_);
      for (const Event& event : due) feed(event);
    }
  }

  /// Sends the PLC's next command, by the rules; returns its number.
  std::uint16_t command(PlcCommand what, int station_no = 0) {
    plc.enable = true;
    if (plc.heartbeat == 0) ++plc.heartbeat;
    plc.command = static_cast<std::uint16_t>(what);
    plc.station = static_cast<std::uint16_t>(station_no);
    plc.slab_type = slab_type;
    if (plc.slab_no == 0 && numbers_slabs) plc.slab_no = 77;
    plc.session_echo = view().session;
    plc.cmd_seq = next_sequence(view().cmd_ack);
    if (plc.command_writer == 0) plc.command_writer = 1;
    feed(plc);
    return plc.cmd_seq;
  }
  void scan(int station_no) {
    robot_station = station_no;
    run_for(600);
    command(PlcCommand::scan, station_no);
    run_for(1000);
  }
  /// The next poses never arrive.
  void lose_poses(int count) { pose_seq_ += count; }
  /// Takes and acknowledges every waiting record.
  std::vector<PlcResult> take_results() {
    std::vector<PlcResult> taken;
    while (view().record.res_seq != 0) {
      taken.push_back(view().record);
      plc.res_ack = view().record.res_seq;
      feed(plc);
      run_for(8);
    }
    return taken;
  }

 private:
  PoseSample pose() {
    PoseSample sample;
    sample.arrival_ns = now_ns_;
    sample.utime_us = now_ns_ / 1000 + 1'000'000;  // the same clock as slabd's
    sample.tool_id = robot_tool;
    sample.stopped = robot_says_stopped;
    sample.emulated = robot_emulated;
    sample.commanded = robot_commanded;
    sample.seq = ++pose_seq_;
    const Pose T_base_block = T_slab_block(recipe, robot_station);
    sample.T_base_flange = T_base_block * dithered(nominal_T_block_scanner(), robot_station, dither);
    sample.T_base_flange.translation_mm.x() += robot_off_mm;
    if (robot_shakes) sample.T_base_flange.translation_mm.y() += (pose_seq_ % 2) * robot_shake_mm;
    const Quat turn(Eigen::AngleAxisd(robot_turn_rad, Vec3::UnitZ()));
    sample.T_base_flange.rotation = turn * sample.T_base_flange.rotation;
    if (exposing_) sample.T_base_flange.translation_mm.x() += robot_moves_mm;
    return sample;
  }

  PoseSample pose_of_second() {
    PoseSample sample;
    sample.arm = 1;
    sample.arrival_ns = now_ns_;
    sample.utime_us = now_ns_ / 1000 + 1'000'000;
    sample.seq = ++pose_2_seq_;
    Pose T_base_flange;
    T_base_flange.translation_mm = Vec3(0.0, 0.0, 5'000.0);
    if (robot_2_station != 0)
      T_base_flange =
          T_slab_block(recipe, robot_2_station) * dithered(nominal_T_block_scanner(), robot_2_station, dither);
    sample.T_base_flange = T_base_robot_2.inverse() * T_base_flange;
    return sample;
  }

  void carry_out(const Action& action) {
    if (const auto* job = std::get_if<StoreJob>(&action)) {
      if (!disk_answers) return;
      pending_.push_back(StoreDone{job->ticket, store.apply(*job)});
    } else if (const auto* acquire = std::get_if<AcquireScan>(&action)) {
      scans.push_back(*acquire);
      exposing_ = true;
      if (acquire->arm == 0 ? !scanner_answers : !scanner_2_answers) return;
      ScanDone done = answer(*acquire);
      if (decodes_first && done.code == Code::ok) pending_.push_back(done);
      done.durable = true;
      if (disk_syncs)
        pending_.push_back(done);
      else
        syncing_ = done;
    } else if (const auto* cancel = std::get_if<CancelScan>(&action)) {
      ++cancelled;
      exposing_ = false;
      if (worker_hangs) return;
      ScanDone done;
      done.arm = cancel->arm;
      done.cmd_seq = scans.back().request.cmd_seq;
      done.slot = scans.back().slot;
      done.code = Code::interrupted;
      done.durable = true;
      pending_.push_back(done);
    } else if (const auto* measure = std::get_if<MeasureBlock>(&action)) {
      measured.push_back(*measure);
      exposing_ = false;
      if (measuring_works) pending_.push_back(measurement_of(*measure));
    } else if (const auto* drop = std::get_if<DropScan>(&action)) {
      dropped.emplace_back(drop->path.view());
    } else if (const auto* said = std::get_if<LogLine>(&action)) {
      logged.emplace_back(said->text.view());
    } else if (const auto* judge = std::get_if<JudgeSlab>(&action)) {
      SlabJudged judged;
      judged.slab_key = judge->slab_key;
      judged.slab.verdict = Verdict::pass;
      judged.slab.gauges = judge->basis.slab.gauges;
      for (int i = 0; i < recipe.stations(); ++i) {
        const StationRecord& record = station->slab.stations[static_cast<std::size_t>(i)];
        const Verdict v = record.phase == StationPhase::measured ? record.block.verdict : Verdict::not_measured;
        judged.slab.station_verdict[static_cast<std::size_t>(i)] = v;
        if (v != Verdict::pass && judged.slab.verdict != Verdict::fail) judged.slab.verdict = v;
      }
      pending_.push_back(judged);
    }
  }

  [[nodiscard]] BlockMeasured measurement_of(const MeasureBlock& measure) const {
    BlockMeasured done;
    done.id = measure.id;
    done.slot = measure.slot;
    done.block.station = measure.id.station;
    done.block.verdict = block_verdict;
    if (blocks_are_found) {
      done.block.registration.status = RegistrationStatus::converged;
      done.block.registration.T_scanner_block =
          dithered(nominal_T_block_scanner(), measure.id.station, dither).inverse();
    }
    done.refused = refuses;
    if (refuses != Code::ok) done.refused_text = "another exposure than the requested one";
    return done;
  }

  ScanDone answer(const AcquireScan& acquire) const {
    ScanDone done;
    done.cmd_seq = acquire.request.cmd_seq;
    done.slot = acquire.slot;
    done.arm = acquire.arm;
    done.code = acquire.arm == 0 ? scan_code : scan_code_2;
    if (done.code != Code::ok) done.text = "as the test wants it";
    done.scan.path = acquire.request.spool_path;
    done.scan.taken_mono_ns = now_ns_ + 4 * kNsPerMs;
    done.scan.shape = {1000, 900, 0, 0};
    done.scan.shape.emulated = scan_emulated;
    done.scan.shape.scanner_temperature_c = scanner_temperature_c;
    done.fingerprint =
        acquire.request.session == 0 && fingerprint_thrown_away != 0 ? fingerprint_thrown_away : fingerprint;
    done.points_crc32c = points_crc32c;
    return done;
  }

  std::int64_t now_ns_ = kNsPerS;
  std::int64_t beat_ns_ = 0;
  std::int32_t pose_seq_ = 0;
  std::int32_t pose_2_seq_ = 0;
  bool exposing_ = false;
  ScanDone syncing_;
  std::unique_ptr<Actions> actions_of_a_step_ = std::make_unique<Actions>();  ///< too large for the stack
  Actions& actions_ = *actions_of_a_step_;
  std::deque<Event> pending_;
};

/// CMD_STATUS of a failed command.
constexpr std::uint16_t failed(Code code) {
  return static_cast<std::uint16_t>(kCommandFailed + static_cast<std::uint16_t>(code));
}

/// A separate line, with an open slab after begin().
struct StationTest : testing::Test {
  MemoryStore store;
  Line line{store};

  void begin() {
    line.run_for(300);
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    ASSERT_TRUE(line.view().slab_open);
  }
};

}  // namespace slabd::daemon
