// SPDX-License-Identifier: Apache-2.0
#include "tests/daemon/station/station_truth_line.h"

#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

constexpr std::int64_t kTurn_ms = 10;
constexpr int kTurnsPerBeat = 20;
/// One place of the daemon's queue is reserved for a change of calibration.
constexpr std::size_t kStoreQueue = limits::kWorkerQueue - 1;
/// The PLC waits 20 s for a scan.
constexpr int kOrderTurns = 2'500;
/// Turns after which a view, its lease and a worker that hangs have ended.
constexpr int kRestTurns = 8'000;

}  // namespace

TruthLine::TruthLine(std::uint64_t seed)
    : chance_(seed), disk_(chance_, store_), scanner_(chance_), measuring_(chance_) {
  settings_.recipes = std::span(&recipe_, 1);
  settings_.calibration_id = "cal";
  settings_.spool_dir = "/spool";
  start();
}

void TruthLine::violated(const std::string& what) {
  if (violation_.empty()) violation_ = "step " + std::to_string(figures_.steps) + ": " + what;
}

// ---- the process ---------------------------------------------------------------------------------------------------

void TruthLine::start() {
  disk_.process_ends();
  scanner_.process_ends();
  measuring_.process_ends();
  std::erase_if(refused_, [](const auto& scan) { return scan.second; });  // its number is used again
  scanner_.worker_hangs = false;
  station_ = std::make_unique<Station>(settings_);
  plc_.command_writer = 0;
  RecoveredLine line = store_.recover();
  // Found by the header's id, as in the database.
  if (!(line.slab.calibration_id == settings_.calibration_id))
    line.slab_calibration.arm[0] = calibration_named(line.slab.calibration_id);
  feed(Recovered{&line});
}

void TruthLine::feed(const Event& event) {
  ++figures_.steps;
  step(*station_, event, actions_);
  const std::vector<Action> actions(actions_.begin(), actions_.end());
  for (const Action& action : actions) std::visit([this](const auto& what) { carry_out(what); }, action);
  if (a_restart_would_be_deceived())
    violated("a restart would take a scan of " + scanner_.holds().text() + " for what it asks for");
  if (!judged_) return;
  const SlabJudged judged = *judged_;
  judged_.reset();
  feed(judged);
}

void TruthLine::carry_out(const StoreJob& job) {
  disk_.push(job);
  if (disk_.waiting() > kStoreQueue) violated("the storage worker's queue overflows");
  check_refused(job);
  const auto* acquired = std::get_if<AcquiredJob>(&job.what);
  if (acquired == nullptr) return;
  ++figures_.scans_recorded;
  const Attempt& attempt = acquired->attempt;
  const ExposureTruth truth = scanner_.truth_of(acquired->fingerprint);
  if (!truth.is_of(attempt.slab_key, attempt.station))
    violated("station " + std::to_string(attempt.station) + " of slab " + std::to_string(attempt.slab_key) +
             " is recorded with a scan of " + truth.text());
}

void TruthLine::measured(const BlockMeasured& done) {
  const ScanKey scan{done.id.slab_key, done.id.station, done.id.attempt};
  const Acquisition& a = station_->acquisition;
  const bool in_hand = done.id.is_attempt_of(id_of(a.attempt)) && a.phase != Acquisition::Phase::storing;
  if (done.refused == Code::ok) {
    refused_.erase(scan);  // measured again, after a restart
  } else {
    ++figures_.refused;
    refused_[scan] = in_hand;
  }
  feed(done);
}

void TruthLine::check_refused(const StoreJob& job) {
  if (const auto* acquired = std::get_if<AcquiredJob>(&job.what)) {
    const auto found = refused_.find({acquired->attempt.slab_key, acquired->attempt.station, acquired->attempt.number});
    if (found != refused_.end() && found->second)
      violated("a scan of station " + std::to_string(acquired->attempt.station) + " is recorded that was refused");
  } else if (const auto* block = std::get_if<BlockJob>(&job.what)) {
    const bool reads_303 = block->record.verdict == Verdict::not_measured &&
                           block->record.reason == static_cast<std::uint16_t>(Code::frame_incomplete);
    if (refused_.contains({block->slab_key, block->block.station, block->attempt}) && !reads_303)
      violated("station " + std::to_string(block->block.station) + " has a result of a scan that was refused");
  }
}

void TruthLine::carry_out(const AcquireScan& action) {
  if (scanner_.is_asked()) violated("a second scan is requested before the first one came");
  if (measuring_.uses(action.slot)) violated("a scan is to come into a buffer that is measured");
  const bool is_own = action.request.session == 0;
  const bool is_view = is_own && in_maintenance(*station_);
  if (is_own) ++(is_view ? figures_.views_asked : figures_.scans_thrown_away);
  const OpenSlab& slab = station_->slab;
  ExposureTruth before_the_lens;
  before_the_lens.slab_key = slab.phase == SlabPhase::none ? 0 : slab.header.key;
  before_the_lens.station = robot_station_;
  scanner_.ask(action, before_the_lens, store_.seen);
}

void TruthLine::carry_out(const CancelScan& /*action*/) {
  if (scanner_.is_asked()) scanner_.cancel();
}

void TruthLine::carry_out(const MeasureBlock& action) {
  figures_.reloads += action.reload ? 1 : 0;
  if (measuring_.uses(action.slot)) violated("two blocks are measured in one buffer");
  if (scanner_.writes_into(action.slot)) violated("a buffer is measured while the scanner writes it");
  const ExposureTruth truth = action.reload ? scanner_.in_file(action.scan_path) : scanner_.in_slot(action.slot);
  if (!truth.is_of(action.id.slab_key, action.id.station))
    violated("station " + std::to_string(action.id.station) + " of slab " + std::to_string(action.id.slab_key) +
             " is measured on a scan of " + truth.text());
  measuring_.push(action);
}

/// Answered before any other event, as in the daemon.
void TruthLine::carry_out(const JudgeSlab& action) {
  judged_.emplace();
  judged_->slab_key = action.slab_key;
  judged_->slab.verdict = Verdict::pass;
  for (std::size_t i = 0; i < static_cast<std::size_t>(recipe_.stations()); ++i) {
    const StationRecord& record = station_->slab.stations[i];
    const bool is_measured = record.phase == StationPhase::measured;
    const Verdict verdict = is_measured ? record.block.verdict : Verdict::not_measured;
    judged_->slab.station_verdict[i] = verdict;
    if (verdict != Verdict::pass) judged_->slab.verdict = verdict;
  }
}

// ---- a turn --------------------------------------------------------------------------------------------------------

void TruthLine::turn() {
  ++turn_;
  now_ns_ += kTurn_ms * kNsPerMs;
  utime_us_ += kTurn_ms * 1'000;
  feed(Tick{now_ns_, utime_us_});
  const bool hangs = scanner_.worker_hangs;
  feed(LinkStatus{!hangs, hangs && scanner_.is_asked(), 0});
  if (poses_come_) send_poses();
  for (const StoreDone& done : disk_.turn()) feed(done);
  if (const auto done = scanner_.turn(now_ns_)) feed(*done);
  if (const auto done = measuring_.turn()) measured(*done);
  if (turn_ % kTurnsPerBeat != 0) return;
  ++plc_.heartbeat;
  feed(plc_);
}

void TruthLine::send_poses() {
  for (int of_turn = 0; of_turn < 2; ++of_turn) {
    PoseSample sample;
    sample.arrival_ns = now_ns_;
    sample.utime_us = now_ns_ / 1'000 + of_turn * 4'000;
    sample.seq = ++pose_seq_;
    sample.T_base_flange = T_slab_block(recipe_, robot_station_) * nominal_T_block_scanner();
    feed(sample);
  }
}

void TruthLine::live(int turns) {
  for (int t = 0; t < turns && violation_.empty(); ++t) {
    turn();
    act_as_plc();
    act_as_maintenance();
    let_things_go_wrong();
  }
}

// ---- the last slab -------------------------------------------------------------------------------------------------

void TruthLine::mend_everything() {
  scanner_.is_frozen = false;
  scanner_.worker_hangs = false;
  scanner_.all_is_well = true;
  measuring_.all_is_well = true;
  disk_.fails = false;
  disk_.is_slow = false;
  disk_.all_is_well = true;
  poses_come_ = true;
  press_abort(false);
  CellCalibration calibration;
  calibration.arm[0] = calibration_named("he-3");
  feed(CalibrationChanged{&calibration});
}

template <typename Done>
bool TruthLine::run_until(const Done& done, int turns_max) {
  for (int t = 0; t < turns_max && !done() && violation_.empty(); ++t) {
    turn();
    acknowledge();
  }
  return done();
}

/// True if the command has succeeded.
bool TruthLine::order_and_wait(PlcCommand what, int station_no) {
  if (--orders_left_ < 0) return false;
  order(what, station_no);
  (void)run_until([this] { return plc_view(*station_).cmd_ack == plc_.cmd_seq && is_at_rest(); }, kOrderTurns);
  const PlcOutputs view = plc_view(*station_);
  return view.cmd_ack == plc_.cmd_seq && view.cmd_status == static_cast<std::uint16_t>(CommandStatus::done);
}

bool TruthLine::scan_every_block() {
  constexpr int kTries = 4;
  for (int block = 1; block <= recipe_.stations(); ++block) {
    bool is_scanned = false;
    for (int tries = 0; tries < kTries && !is_scanned; ++tries) is_scanned = order_and_wait(PlcCommand::scan, block);
    if (!is_scanned) return false;
  }
  return true;
}

void TruthLine::pass_a_slab(int orders_max) {
  mend_everything();
  orders_left_ = orders_max;
  (void)run_until([this] { return is_at_rest() && !in_maintenance(*station_); }, kRestTurns);
  bool has_passed = false;
  while (!has_passed && orders_left_ > 0 && violation_.empty()) {
    reset_fault();
    (void)run_until([this] { return is_at_rest(); }, kOrderTurns);
    if (plc_view(*station_).slab_open)
      (void)order_and_wait(PlcCommand::slab_abort);
    else if (order_and_wait(PlcCommand::slab_begin) && scan_every_block() && order_and_wait(PlcCommand::slab_end))
      has_passed = plc_view(*station_).slab_verdict == Verdict::pass;
  }
  figures_.orders = orders_max - orders_left_;
  if (!has_passed) violated("no slab passes within " + std::to_string(orders_max) + " orders");
  check_nothing_is_left();
}

bool TruthLine::is_at_rest() const {
  const bool slots_free = !station_->slot_busy[0] && !station_->slot_busy[1];
  return station_->storing.empty() && station_->measuring == 0 && slots_free && !station_->arms[0].abandoned.waits &&
         !plc_view(*station_).busy;
}

void TruthLine::check_nothing_is_left() {
  if (!is_at_rest()) violated("a job, a measurement, a buffer or a scan that was given up is left over");
  if (!station_->unsaved_fingerprints.empty() || !station_->unsaved_acks.empty())
    violated("something that a failing disk kept back is never stored");
  if (station_->arms[0].scan_unseen) violated("the scanner is not trusted though it gave a whole slab");
  if (store_.refused != 0) violated(std::to_string(store_.refused) + " jobs were refused by the database");
}

}  // namespace slabd::daemon
