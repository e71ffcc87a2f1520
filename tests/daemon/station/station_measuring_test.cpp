// SPDX-License-Identifier: Apache-2.0
//
// A measurement during which the process ends, SLAB_ABORT during a measurement, counting of attempts, and a display
// that writes back the command block.
#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

struct StationMeasuring : StationTest {
  /// Station 1 is acquired, and its measurement does not end.
  void acquire_and_hang() {
    begin();
    line.measuring_works = false;
    line.scan(1);
    line.run_for(1000);
    ASSERT_EQ(store.line.stations[0].phase, StationPhase::acquired);
    ASSERT_EQ(line.measured.size(), 1U);
  }
  bool said(const std::string& part) const {
    return std::any_of(line.logged.begin(), line.logged.end(),
                       [&](const std::string& text) { return text.find(part) != std::string::npos; });
  }
};

TEST_F(StationMeasuring, is_marked_in_the_database_while_it_lasts) {
  acquire_and_hang();
  EXPECT_NE(store.line.stations[0].measuring_since_ns, 0);
  line.measuring_ends();
  line.run_for(20);
  EXPECT_EQ(store.line.stations[0].phase, StationPhase::measured);
  EXPECT_EQ(store.line.stations[0].measuring_since_ns, 0);
}

TEST_F(StationMeasuring, is_not_marked_when_it_ends_before_the_scan_is_durable) {
  begin();
  line.scan(1);
  for (const StoreJob& job : store.applied) {
    const auto* acquired = std::get_if<AcquiredJob>(&job.what);
    if (acquired != nullptr) {
      EXPECT_EQ(acquired->measuring_since_ns, 0);
    }
  }
  EXPECT_EQ(line.view().record.verdict, Verdict::pass);
}

TEST_F(StationMeasuring, is_not_restarted_without_a_command_for_a_scan_that_ended_the_process) {
  acquire_and_hang();
  line.measured.clear();
  line.measuring_works = true;
  line.start();
  line.run_for(200);
  EXPECT_TRUE(line.measured.empty());
  EXPECT_EQ(line.view().record.station, 1);
  EXPECT_EQ(line.view().record.verdict, Verdict::not_measured);
  EXPECT_EQ(line.view().record.reason, static_cast<std::uint16_t>(Code::deadline));
  EXPECT_TRUE(said("slabd ended while it measured this scan"));
  (void)line.take_results();
  line.scan(1);
  EXPECT_EQ(line.view().record.verdict, Verdict::pass) << "asked for, it is scanned and measured again";
}

TEST_F(StationMeasuring, begins_again_after_a_restart_of_the_computer_and_is_marked_first) {
  acquire_and_hang();
  // The monotonic clock restarts with the computer, so the mark has a future time.
  store.line.stations[0].measuring_since_ns += 3'600 * kNsPerS;
  line.measured.clear();
  line.start();
  line.run_for(200);
  ASSERT_EQ(line.measured.size(), 1U);
  EXPECT_TRUE(line.measured[0].reload);
  EXPECT_TRUE(std::holds_alternative<MeasuringJob>(store.applied.back().what));
  line.start();
  line.run_for(200);
  EXPECT_EQ(line.measured.size(), 1U) << "this time the process ended alone";
}

TEST_F(StationMeasuring, begins_again_when_the_last_process_took_its_mark_away) {
  acquire_and_hang();
  ASSERT_EQ(store.apply(StoreJob{0, MeasuringJob{store.line.slab.key, 1, 1, 0}}), Code::ok);
  line.measured.clear();
  line.measuring_works = true;
  line.start();
  line.run_for(200);
  EXPECT_EQ(line.measured.size(), 1U);
  EXPECT_EQ(line.view().record.verdict, Verdict::pass);
}

TEST_F(StationMeasuring, is_not_waited_for_by_slab_abort) {
  acquire_and_hang();
  line.command(PlcCommand::slab_abort);
  line.run_for(40);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
  EXPECT_TRUE(line.station->slot_busy[line.measured[0].slot]) << "the measuring still works on the buffer";
  line.measuring_ends();
  line.run_for(20);
  EXPECT_FALSE(line.station->slot_busy[line.measured[0].slot]);
  EXPECT_EQ(line.station->measuring, 0U);
  EXPECT_EQ(line.take_results().size(), 1U) << "the late answer is dropped";
}

TEST_F(StationMeasuring, slab_abort_that_was_accepted_is_finished_after_a_restart) {
  begin();
  line.disk_answers = false;
  const std::uint16_t seq = line.command(PlcCommand::slab_abort);
  CommandJob accepted;
  accepted.session = line.view().session;
  accepted.cmd_seq = seq;
  accepted.command = static_cast<std::uint16_t>(PlcCommand::slab_abort);
  accepted.slab_key = store.line.slab.key;
  ASSERT_EQ(store.apply(StoreJob{0, accepted}), Code::ok);
  line.disk_answers = true;
  line.start();
  line.run_for(100);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
  EXPECT_EQ(line.view().record.cmd_seq, seq);
  EXPECT_EQ(line.view().cmd_ack, seq);
  EXPECT_EQ(line.view().cmd_status, static_cast<std::uint16_t>(CommandStatus::done));
  EXPECT_EQ(store.slabs_ended, 1);
}

TEST_F(StationMeasuring, slab_abort_is_interrupted_by_a_restart_when_the_line_went_on) {
  begin();
  CommandJob abort;
  abort.session = line.view().session;
  abort.cmd_seq = 500;
  abort.command = static_cast<std::uint16_t>(PlcCommand::slab_abort);
  abort.slab_key = store.line.slab.key;
  ASSERT_EQ(store.apply(StoreJob{0, abort}), Code::ok);
  line.scan(1);
  line.start();
  line.run_for(100);
  EXPECT_TRUE(line.view().slab_open);
}

struct StationAttempts : StationTest {};

TEST_F(StationAttempts, do_not_count_while_no_scan_can_be_asked_for) {
  begin();
  line.robot_present = false;
  for (int i = 0; i < 300; ++i) {
    line.command(PlcCommand::scan, 1);
    line.run_for(9'000);
    ASSERT_EQ(line.view().cmd_status & kCommandFailed, kCommandFailed) << i;
    ASSERT_NE(line.view().refuse_code, 501);
  }
  EXPECT_EQ(line.view().table[0].attempts, 0);
  line.robot_present = true;
  line.scan(1);
  EXPECT_EQ(line.view().record.verdict, Verdict::pass);
  EXPECT_EQ(line.view().table[0].attempts, 1);
}

TEST_F(StationAttempts, do_not_count_while_the_scanner_is_away) {
  begin();
  for (const Code away : {Code::scanner_offline, Code::trigger_timeout}) {
    line.scan_code = away;
    for (int i = 0; i < 150; ++i) {
      line.scan(1);
      ASSERT_EQ(line.view().cmd_status, failed(away)) << i;
    }
  }
  line.scan_code = Code::ok;
  line.scan(1);
  EXPECT_EQ(line.view().record.verdict, Verdict::pass);
  EXPECT_EQ(line.view().table[0].attempts, 1);
}

TEST_F(StationAttempts, have_a_limit_with_its_own_message) {
  begin();
  line.station->slab.stations[0].attempts = 0xFF;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, failed(Code::attempts_used_up));
  EXPECT_EQ(line.view().refuse_code, 115);
}

struct Display : StationTest {
  /// Another connection writes this block.
  void write_back(PlcInputs block) {
    block.command_writer = 2;
    ++block.command_writes;
    block.heartbeat = line.plc.heartbeat;
    line.feed(block);
    line.run_for(20);
  }
};

TEST_F(Display, that_writes_the_command_block_back_late_costs_no_session) {
  begin();
  const PlcInputs old = line.plc;
  line.scan(1);
  const std::uint16_t session = line.view().session;
  for (int i = 0; i < 5; ++i) write_back(old);
  EXPECT_EQ(line.view().session, session);
  line.scan(2);
  EXPECT_EQ(line.view().session, session);
  EXPECT_EQ(line.view().table[1].verdict, Verdict::pass);
}

TEST_F(Display, that_writes_the_block_back_while_it_is_being_recorded_costs_no_session) {
  begin();
  line.run_for(600);
  const std::uint16_t session = line.view().session;
  line.command(PlcCommand::scan, 1);
  write_back(line.plc);
  line.run_for(1'000);
  EXPECT_EQ(line.view().session, session);
  EXPECT_EQ(line.view().table[0].verdict, Verdict::pass);
}

TEST_F(Display, that_writes_a_stale_block_back_costs_no_session) {
  begin();
  PlcInputs stale = line.plc;
  stale.cmd_seq = next_sequence(line.view().cmd_ack);
  --stale.session_echo;
  const std::uint16_t session = line.view().session;
  for (int i = 0; i < 5; ++i) write_back(stale);
  EXPECT_EQ(line.view().session, session);
}

TEST_F(Display, that_gives_a_command_of_its_own_still_changes_the_session_and_is_refused) {
  begin();
  PlcInputs own = line.plc;
  own.command = static_cast<std::uint16_t>(PlcCommand::scan);
  own.station = 3;
  own.cmd_seq = next_sequence(line.view().cmd_ack);
  own.session_echo = line.view().session;
  const std::uint16_t session = line.view().session;
  write_back(own);
  EXPECT_NE(line.view().session, session);
  EXPECT_EQ(line.view().refuse_code, static_cast<std::uint16_t>(Code::stale_session));
  EXPECT_TRUE(line.scans.empty());
}

}  // namespace
}  // namespace slabd::daemon
