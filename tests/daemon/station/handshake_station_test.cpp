// SPDX-License-Identifier: Apache-2.0
//
// The model of the handshake is valid for slabd only if slabd behaves like the model. So the real station, on a
// database in memory, and the model run through the same long random lives. After every step the PLC must read the same
// from both.
#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <optional>

#include "base/prng.h"
#include "tests/daemon/station/handshake_model.h"
#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

using handshake::Frame;
using handshake::Rules;
using handshake::Slabd;
using handshake::Status;

/// slabd's station with an open slab, whose answers are controlled by the test.
class RealSlabd {
 public:
  RealSlabd(const RealSlabd&) = delete;
  RealSlabd& operator=(const RealSlabd&) = delete;
  explicit RealSlabd(std::uint16_t start_number) {
    store_.line.session = store_.line.cmd_ack = start_number;
    settings_.recipes = std::span(&recipe_, 1);
    settings_.calibration_id = "cal";
    settings_.spool_dir = "/spool";
    boot();
    answer_all();
    plc_.enable = true;
    Frame begin;
    begin.seq = next_sequence(store_.line.cmd_ack);
    begin.session = view().session;
    plc_.slab_no = 77;
    plc_.slab_type = 5600;
    plc_.command_writer = 1;
    plc_.heartbeat = 1;
    send(PlcCommand::slab_begin, begin);
    answer_all();
  }

  [[nodiscard]] PlcOutputs view() const { return plc_view(*station_); }

  void receive(const Frame& frame) { send(PlcCommand::scan, frame); }
  void enable(bool on) {
    plc_.enable = on;
    feed(plc_);
  }
  void lose_heartbeat() {
    beats_ = false;
    for (int t = 0; t < 2'600; t += 4) tick(false);
  }
  void hear_heartbeat() {
    beats_ = true;
    ++plc_.heartbeat;
    feed(plc_);
  }
  void synchronise() {
    ++plc_.sync_req;
    feed(plc_);
  }
  /// Kind of the oldest unanswered store job.
  [[nodiscard]] std::optional<PendingStore::Kind> oldest() const {
    if (answers_.empty()) return std::nullopt;
    for (const PendingStore& pending : station_->storing)
      if (pending.ticket == answers_.front().ticket) return pending.kind;
    return std::nullopt;
  }
  void answer_oldest() {
    const StoreDone done = answers_.front();
    answers_.pop_front();
    feed(done);
    answer_quiet_ones();
  }
  /// The robot has stopped at the commanded station and the scanner answers.
  bool scan(Code code, bool refused = false) {
    robot_ = station_->acquisition.station;
    for (int t = 0; t < 2'000 && !request_; t += 4) tick(true);
    // After a death during a scan, or a failed scan, an additional scan is requested first; it is discarded.
    if (request_ && request_->request.session == 0 && code == Code::ok) {
      answer_scanner(Code::ok);
      for (int t = 0; t < 2'000 && !request_; t += 4) tick(true);
    }
    if (!request_) return false;
    if (refused) measure_ahead_and_refuse();
    answer_scanner(code);
    for (int t = 0; t < 40; t += 4) tick(true);
    // The robot is silent until the next scan, so that acquisitions do not run ahead of the test.
    for (int t = 0; t < 3'000; t += 4) tick(false);
    answer_quiet_ones();
    return true;
  }
  /// The points are measured before the scan is durable, and belong to another exposure.
  void measure_ahead_and_refuse() {
    const std::uint8_t station = station_->acquisition.station;
    feed(scan_done(Code::ok));
    for (int t = 0; t < 40; t += 4) tick(true);
    measured(station, Code::frame_incomplete);
  }
  [[nodiscard]] ScanDone scan_done(Code code) const {
    ScanDone done;
    done.cmd_seq = request_->request.cmd_seq;
    done.slot = request_->slot;
    done.code = code;
    done.scan.path = request_->request.spool_path;
    done.scan.shape = {1000, 900, 0, 0};
    done.scan.taken_mono_ns = now_ns_;
    return done;
  }
  void answer_scanner(Code code) {
    ScanDone done = scan_done(code);
    done.durable = true;
    request_.reset();
    feed(done);
  }
  [[nodiscard]] bool is_measuring(std::uint8_t station) const {
    return std::any_of(measuring_.begin(), measuring_.end(), [&](const auto& m) { return m.id.station == station; });
  }
  void measured(std::uint8_t station, Code refused = Code::ok) {
    const auto found =
        std::find_if(measuring_.begin(), measuring_.end(), [&](const auto& m) { return m.id.station == station; });
    BlockMeasured done;
    done.id = found->id;
    done.slot = found->slot;
    done.block.station = station;
    done.block.verdict = Verdict::pass;
    done.refused = refused;
    measuring_.erase(found);
    feed(done);
    answer_quiet_ones();
  }
  void acknowledge() {
    plc_.res_ack = view().record.res_seq;
    feed(plc_);
    answer_quiet_ones();
  }
  void die_and_start() { boot(); }

 private:
  void boot() {
    station_ = std::make_unique<Station>(settings_);
    answers_.clear();
    measuring_.clear();
    request_.reset();
    // The model measures acquired scans again; a process that crashed alone would not (station_measuring_test).
    store_.restart_computer();
    const RecoveredLine line = store_.recover();
    feed(Recovered{&line});
    // The PLC's memory is unchanged: its heartbeat continues, and its block is not written again.
    plc_.command_writer = 0;
    tick(false);
    if (!beats_) plc_.heartbeat = 0;  // the heartbeat is also missing in this process
    feed(plc_);
    answer_quiet_ones();
  }
  void send(PlcCommand command, const Frame& frame) {
    plc_.command = static_cast<std::uint16_t>(command);
    plc_.station = frame.station;
    plc_.session_echo = frame.session;
    plc_.cmd_seq = frame.seq;
    plc_.command_writer = frame.writer;
    feed(plc_);
  }
  void tick(bool robot) {
    now_ns_ += 4 * kNsPerMs;
    feed(Tick{now_ns_, now_ns_ / 1000 + 1'000'000});
    if (beats_ && now_ns_ % (200 * kNsPerMs) == 0) {
      ++plc_.heartbeat;
      feed(plc_);
    }
    if (!robot) return;
    PoseSample sample;
    sample.arrival_ns = now_ns_;
    sample.utime_us = now_ns_ / 1000;
    sample.seq = ++pose_;
    sample.T_base_flange = T_slab_block(recipe_, robot_) * nominal_T_block_scanner();
    feed(sample);
  }
  void feed(const Event& event) {
    step(*station_, event, actions_);
    const std::vector<Action> actions(actions_.begin(), actions_.end());
    for (const Action& action : actions) {
      if (const auto* job = std::get_if<StoreJob>(&action))
        answers_.push_back(StoreDone{job->ticket, store_.apply(*job)});
      else if (const auto* acquire = std::get_if<AcquireScan>(&action))
        request_ = *acquire;
      else if (const auto* measure = std::get_if<MeasureBlock>(&action))
        measuring_.push_back(*measure);
    }
  }
  void answer_all() {
    while (!answers_.empty()) answer_oldest();
  }
  /// Answers jobs whose answers do not change the model's state: results, acknowledgements, failed scans.
  void answer_quiet_ones() {
    for (std::size_t i = 0; i < answers_.size();) {
      const auto pending = std::find_if(station_->storing.begin(), station_->storing.end(),
                                        [&](const PendingStore& p) { return p.ticket == answers_[i].ticket; });
      const PendingStore::Kind kind = pending->kind;
      const bool quiet = kind == PendingStore::Kind::block || kind == PendingStore::Kind::ack ||
                         kind == PendingStore::Kind::failed_attempt || kind == PendingStore::Kind::seen_scan;
      if (!quiet) {
        ++i;
        continue;
      }
      const StoreDone done = answers_[i];
      answers_.erase(answers_.begin() + static_cast<std::ptrdiff_t>(i));
      feed(done);
      i = 0;
    }
  }

  MemoryStore store_;
  Recipe recipe_ = test_recipe();
  StationSettings settings_;
  std::unique_ptr<Station> station_;
  PlcInputs plc_;
  std::deque<StoreDone> answers_;
  std::vector<MeasureBlock> measuring_;
  std::optional<AcquireScan> request_;
  std::unique_ptr<Actions> actions_of_a_step_ = std::make_unique<Actions>();  ///< too large for the stack
  Actions& actions_ = *actions_of_a_step_;
  std::int64_t now_ns_ = kNsPerS;
  std::int32_t pose_ = 0;
  int robot_ = 1;
  bool beats_ = true;
};

Status status_of(const PlcOutputs& view) {
  if (view.cmd_status >= kCommandFailed) return Status::failed;
  switch (static_cast<CommandStatus>(view.cmd_status)) {
    case CommandStatus::accepted:
    case CommandStatus::acquiring: return Status::accepted;
    // For the PLC the two are the same: the robot may leave.
    case CommandStatus::acquired:
    case CommandStatus::done: return Status::acquired;
    default: return Status::none;
  }
}

constexpr std::size_t kKinds = 10;

/// One life of station and model, in parallel.
class Lives {
 public:
  Lives(const Rules& rules, Prng& prng) : rules_(rules), prng_(prng) {
    // The model starts in the station's state.
    const PlcOutputs at = real_.view();
    model_.session = model_.session_next = model_.session_stored = at.session;
    model_.ack = model_.ack_stored = at.cmd_ack;
    model_.status = model_.status_stored = status_of(at);
    model_.acquired = model_.acquired_stored = at.acq_seq;
    model_.judged = {at.cmd_ack, at.session, 0, handshake::kPlc};
    model_.writer = handshake::kPlc;
  }

  /// Runs random steps; returns the first difference in the PLC's registers, or an empty text. `done` counts kinds of
  /// steps.
  std::string live(int steps, std::array<int, kKinds>& done) {
    std::string differs = difference("the beginning");
    for (int n = 0; n < steps && differs.empty(); ++n) {
      std::size_t kind = 0;
      const char* what = step(kind);
      if (what == nullptr) continue;
      ++done[kind];
      differs = difference(what);
    }
    return differs;
  }

 private:
  [[nodiscard]] bool scanned(std::size_t station) const {
    return model_.has[station - 1U] != handshake::Has::nothing || model_.cloud_in_memory_only[station - 1U];
  }

  [[nodiscard]] std::string difference(const char* after) const {
    const PlcOutputs view = real_.view();
    std::string text;
    const auto compare = [&](const char* what, long station, long model) {
      if (station != model && text.empty())
        text = std::string("after ") + after + ": " + what + " of the station " + std::to_string(station) +
               ", of the model " + std::to_string(model);
    };
    compare("SESSION", view.session, model_.session);
    compare("CMD_ACK", view.cmd_ack, model_.ack);
    compare("CMD_STATUS", static_cast<long>(status_of(view)), static_cast<long>(model_.status));
    compare("ACQ_SEQ", view.acq_seq, model_.acquired);
    compare("BUSY", view.busy, model_.busy());
    compare("the result's station", view.record.station, model_.results.front());
    for (std::size_t i = 0; i < handshake::kStations; ++i) {
      // A scan on its way to the database is in it, but not yet shown.
      if (model_.phase == Slabd::Phase::storing && model_.command.station == i + 1) continue;
      compare("the table", view.station_mask >> i & 1U, model_.has[i] != handshake::Has::nothing ? 1 : 0);
    }
    return text;
  }

  /// Name of the step; nullptr if it was not possible.
  const char* step(std::size_t& kind) {
    const auto station = static_cast<std::uint8_t>(1 + prng_.below(handshake::kStations));
    switch (prng_.below(11)) {
      case 0:
      case 1: kind = 0; return send(station);
      case 2: kind = 1; return send_old();
      case 3:
        kind = 2;
        model_.synchronise(rules_);
        real_.synchronise();
        return "SYNC_REQ";
      case 4:
      case 5: kind = 3; return database_answers();
      case 6: kind = 4; return scan();
      case 7:
        if (prng_.below(3) != 0) {
          kind = 5;
          return measure(station);
        }
        kind = 6;
        if (model_.results.front() == 0 || real_.view().record.res_seq == 0) return nullptr;
        model_.acknowledged();
        real_.acknowledge();
        return "RES_ACK";
      case 8:
        kind = 8;
        if (prng_.below(4) != 0) return nullptr;
        model_.enable = !model_.enable;
        real_.enable(model_.enable);
        return "ENABLE";
      case 9: kind = 9; return heartbeat();
      default:
        kind = 7;
        if (prng_.below(4) != 0) return nullptr;
        model_.die();
        model_.start(rules_);
        real_.die_and_start();
        return "a death";
    }
  }
  /// Sends the right block, or nearly. The model's PLC never orders a station twice.
  const char* send(std::uint8_t station) {
    Frame frame{next_sequence(model_.ack), model_.session, station};
    if (prng_.below(6) == 0) frame.seq = static_cast<std::uint16_t>(frame.seq + prng_.below(5) - 2);
    if (prng_.below(6) == 0) frame.session = static_cast<std::uint16_t>(frame.session - prng_.below(3));
    if (frame.seq == 0 || scanned(station)) return nullptr;
    if (prng_.below(8) == 0) frame.writer = handshake::kStranger;
    model_.receive(frame, rules_);
    real_.receive(frame);
    old_.push_back(frame);
    if (old_.size() > 4) old_.pop_front();
    return "a block";
  }
  const char* heartbeat() {
    if (!model_.heard) {
      model_.hear_heartbeat(rules_);
      real_.hear_heartbeat();
      return "the heartbeat again";
    }
    // Settling takes time in which the robot of this test is silent, so it is allowed only without a waiting command.
    if (model_.busy() || prng_.below(6) != 0) return nullptr;
    model_.lose_heartbeat();
    real_.lose_heartbeat();
    return "a lost heartbeat";
  }
  const char* send_old() {
    if (old_.empty()) return nullptr;
    const Frame frame = old_[prng_.below(old_.size())];
    if (scanned(frame.station)) return nullptr;
    model_.receive(frame, rules_);
    real_.receive(frame);
    return "an old block";
  }
  const char* database_answers() {
    const auto kind = real_.oldest();
    if (!kind) return nullptr;
    real_.answer_oldest();
    if (*kind == PendingStore::Kind::session)
      model_.session_was_stored();
    else if (*kind == PendingStore::Kind::command)
      model_.command_was_stored();
    else if (*kind != PendingStore::Kind::measuring)  // a mark in the database, invisible to the PLC
      model_.scan_was_stored();
    return "an answer of the database";
  }
  const char* scan() {
    if (model_.phase != Slabd::Phase::acquiring) return nullptr;
    // No scan came, or measuring refuses it: for the model the two are the same.
    const bool refused = prng_.below(8) == 0;
    const bool fails = prng_.below(4) == 0;
    fails || refused ? model_.scan_failed() : model_.scan(rules_);
    const bool asked = real_.scan(fails && !refused ? Code::trigger_timeout : Code::ok, refused);
    return asked ? "a scan" : "a scan without a request";
  }
  const char* measure(std::uint8_t station) {
    const bool has_cloud = model_.has[station - 1U] == handshake::Has::cloud;
    if (!real_.is_measuring(station) || !has_cloud || model_.phase == Slabd::Phase::storing) return nullptr;
    // A scan refused after ACQUIRED has a result too.
    model_.measured(station - 1U);
    real_.measured(station, prng_.below(8) == 0 ? Code::frame_incomplete : Code::ok);
    return "a result";
  }

  const Rules rules_;
  Prng& prng_;
  RealSlabd real_{65'530};
  Slabd model_;
  std::deque<Frame> old_;
};

TEST(HandshakeOfStation, the_model_and_the_station_show_the_plc_the_same) {
  std::array<int, kKinds> done{};
  for (std::uint64_t seed = 1; seed <= 2'000; ++seed) {
    Prng prng(seed);
    ASSERT_EQ(Lives(Rules{}, prng).live(150, done), "") << "seed " << seed;
  }
  for (std::size_t i = 0; i < done.size(); ++i) EXPECT_GT(done[i], 500) << "kind of step " << i;
}

class HandshakeOfStationWithout : public testing::TestWithParam<bool Rules::*> {};

TEST_P(HandshakeOfStationWithout, one_rule_the_model_differs_from_the_station) {
  Rules rules;
  rules.*GetParam() = false;
  std::array<int, kKinds> done{};
  std::string differs;
  for (std::uint64_t seed = 1; seed <= 200 && differs.empty(); ++seed) {
    Prng prng(seed);
    differs = Lives(rules, prng).live(150, done);
  }
  EXPECT_NE(differs, "");
}

INSTANTIATE_TEST_SUITE_P(AnyRuleOfSlabd, HandshakeOfStationWithout,
                         testing::Values(&Rules::number_is_successor, &Rules::session_is_echoed,
                                         &Rules::session_changes_at_start, &Rules::session_changes_on_request,
                                         &Rules::session_is_durable_first, &Rules::scan_is_durable_first,
                                         &Rules::result_is_kept, &Rules::enable_is_required,
                                         &Rules::one_connection_commands, &Rules::never_scans_by_itself,
                                         &Rules::session_changes_when_heard_again));

}  // namespace
}  // namespace slabd::daemon
