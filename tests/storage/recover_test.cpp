// SPDX-License-Identifier: Apache-2.0
//
// State recovered by a restarted daemon, in every phase of a slab. Each state is built through apply(), then the store
// is closed and opened again.
#include <filesystem>
#include <fstream>

#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

constexpr std::uint16_t kInterrupted = 0x8000 + 110;

class RecoverTest : public StoreTest {
 protected:
  void SetUp() override {
    open();
    apply(SessionJob{session_});
  }
  std::unique_ptr<RecoveredLine> restart() {
    open();
    return recover();
  }
  std::uint64_t newest_fingerprint() {
    std::uint64_t newest = 0;
    const auto line = restart();
    for (const std::uint64_t fingerprint : line->fingerprints)
      if (fingerprint != 0) newest = fingerprint;
    return newest;
  }
};

TEST_F(RecoverTest, fresh_database_recovers_no_slab) {
  open();
  const auto line = restart();
  EXPECT_EQ(line->session, 1) << "the one SetUp stored";
  EXPECT_EQ(line->cmd_ack, 0);
  EXPECT_EQ(line->cmd_status, 0);
  EXPECT_EQ(line->acq_seq, 0);
  EXPECT_EQ(line->res_seq, 0);
  EXPECT_EQ(line->last_slab_key, 0);
  EXPECT_FALSE(line->slab_open);
  EXPECT_EQ(line->slab.key, 0);
  EXPECT_EQ(line->slab_verdict, Verdict::none);
  EXPECT_TRUE(line->unacknowledged.empty());
}

TEST_F(RecoverTest, session_is_the_last_one_stored) {
  apply(SessionJob{65'535});
  apply(SessionJob{3});
  EXPECT_EQ(restart()->session, 3);
}

TEST_F(RecoverTest, begun_slab_is_open_and_its_command_done) {
  const BeginSlabJob job{random_header(prng_, 1), session_, 41};
  apply(job);
  const auto line = restart();
  EXPECT_TRUE(line->slab_open);
  expect_same(line->slab, job.slab);
  EXPECT_EQ(line->last_slab_key, 1);
  EXPECT_EQ(line->cmd_ack, 41);
  EXPECT_EQ(line->cmd_status, 4);
  EXPECT_EQ(line->newest_utime_us, job.slab.began_utime_us);
  for (const StationRecord& station : line->stations) EXPECT_EQ(station.phase, StationPhase::empty);
}

TEST_F(RecoverTest, an_emulated_attempt_marks_its_slab_for_good) {
  SlabHeader header = random_header(prng_, 1);
  header.emulated = 0;
  apply(BeginSlabJob{header, session_, 1});
  Attempt attempt = random_attempt(prng_, 1, 4, 1);
  attempt.emulated = 0;
  attempt.fingerprint.reset();  // the same points would be rejected
  apply(AcquiredJob{attempt});
  EXPECT_EQ(restart()->slab.emulated, 0);
  attempt.station = 5;
  attempt.emulated = kEmulatedRobot;
  apply(AcquiredJob{attempt});
  attempt.station = 6;
  attempt.emulated = kEmulatedScan;
  apply(AcquiredJob{attempt});
  attempt.number = 2;
  attempt.emulated = 0;
  apply(AcquiredJob{attempt});
  EXPECT_EQ(restart()->slab.emulated, kEmulatedRobot | kEmulatedScan);
  PlcResult record = random_record(prng_, 9, 2);
  apply(SlabJob{1, random_slab(prng_, Verdict::pass), record, 1});
  const auto line = restart();
  EXPECT_EQ(line->slab_emulated, kEmulatedRobot | kEmulatedScan);
  EXPECT_EQ(line->slab_record.emulated, record.emulated);
}

TEST_F(RecoverTest, accepted_scan_is_interrupted_and_its_station_failed) {
  begin(1);
  accept(PlcCommand::scan, 4, 1);
  const auto line = restart();
  EXPECT_EQ(line->cmd_ack, cmd_seq_);
  EXPECT_EQ(line->cmd_status, kInterrupted);
  EXPECT_EQ(line->acq_seq, 0);
  EXPECT_EQ(line->stations[3].phase, StationPhase::failed);
  EXPECT_EQ(line->stations[3].code, 110);
  EXPECT_EQ(line->stations[3].attempts, 1);

  const auto again = restart();
  EXPECT_EQ(again->cmd_status, kInterrupted);
  EXPECT_EQ(again->stations[3].attempts, 1) << "a second restart must not count a second attempt";

  scan(1, 4, 2);
  EXPECT_EQ(restart()->stations[3].phase, StationPhase::measured);
}

TEST_F(RecoverTest, acquired_scan_waits_to_be_measured_from_its_path) {
  begin(1);
  accept(PlcCommand::scan, 4, 1);
  const Attempt a = attempt(1, 4, 1);
  apply(AcquiredJob{a});
  const auto line = restart();
  EXPECT_EQ(line->cmd_status, 3);
  EXPECT_EQ(line->acq_seq, cmd_seq_);
  EXPECT_EQ(line->stations[3].phase, StationPhase::acquired);
  expect_same(line->stations[3].attempt, a);
  EXPECT_EQ(line->stations[3].attempts, 1);
}

TEST_F(RecoverTest, the_mark_of_a_measurement_stays_until_it_is_stored_or_taken_away) {
  begin(1);
  accept(PlcCommand::scan, 4, 1);
  apply(AcquiredJob{attempt(1, 4, 1), 0, 77});
  EXPECT_EQ(restart()->stations[3].measuring_since_ns, 77);
  apply(MeasuringJob{1, 4, 1, 0});
  EXPECT_EQ(restart()->stations[3].measuring_since_ns, 0);
  apply(MeasuringJob{1, 4, 1, 99});
  EXPECT_EQ(restart()->stations[3].measuring_since_ns, 99);
  scan(1, 4, 2);
  apply(MeasuringJob{1, 4, 2, 5});
  const auto line = restart();
  EXPECT_EQ(line->stations[3].phase, StationPhase::measured);
  EXPECT_EQ(line->stations[3].measuring_since_ns, 0) << "a measured block is not marked late";
}

TEST_F(RecoverTest, an_attempt_that_the_scanner_was_not_asked_for_does_not_count_and_is_replaced) {
  begin(1);
  for (int i = 0; i < 3; ++i) {
    accept(PlcCommand::scan, 4, 1);
    FailedAttemptJob failed{attempt(1, 4, 1), 202, 0};
    failed.attempt.asked = false;
    apply(failed);
    const auto line = restart();
    EXPECT_EQ(line->stations[3].attempts, 0);
    EXPECT_EQ(line->stations[3].phase, StationPhase::failed);
    EXPECT_EQ(line->stations[3].code, 202);
  }
  scan(1, 4, 1);
  const auto line = restart();
  EXPECT_EQ(line->stations[3].attempts, 1);
  EXPECT_EQ(line->stations[3].phase, StationPhase::measured);
}

TEST_F(RecoverTest, an_accepted_slab_abort_is_left_to_be_finished) {
  begin(1);
  accept(PlcCommand::slab_abort, 0, 1);
  const std::uint16_t seq = cmd_seq_;
  for (int start = 0; start < 2; ++start) {
    const auto line = restart();
    EXPECT_EQ(line->abort_seq, seq);
    EXPECT_EQ(line->cmd_status, 1);
    EXPECT_TRUE(line->slab_open);
  }
  accept(PlcCommand::scan, 4, 1);
  EXPECT_EQ(restart()->abort_seq, 0) << "the line went on";
}

TEST_F(RecoverTest, an_accepted_slab_end_of_the_open_slab_is_remembered) {
  begin(1);
  EXPECT_FALSE(restart()->end_was_given);
  accept(PlcCommand::slab_end, 0, 1);
  EXPECT_TRUE(restart()->end_was_given);
  accept(PlcCommand::scan, 4, 1);
  EXPECT_TRUE(restart()->end_was_given);
}

TEST_F(RecoverTest, an_unseen_scan_is_listed_among_the_fingerprints_until_another_scan_is_seen) {
  begin(1);
  apply(SeenScanJob{7});
  EXPECT_EQ(newest_fingerprint(), 7U);
  accept(PlcCommand::slab_end, 0, 1);
  EXPECT_EQ(newest_fingerprint(), 7U) << "only a SCAN takes a scan";
  for (int i = 0; i < 3; ++i) {
    accept(PlcCommand::scan, 4, 1);
    EXPECT_EQ(newest_fingerprint(), kUnseenScan);
    EXPECT_EQ(newest_fingerprint(), kUnseenScan) << "not over with the next start";
    apply(SeenScanJob{static_cast<std::uint64_t>(9 + 2 * i)});
    EXPECT_EQ(newest_fingerprint(), static_cast<std::uint64_t>(9 + 2 * i));
  }
  const auto line = restart();
  const auto kept = std::count(line->fingerprints.begin(), line->fingerprints.end(), kUnseenScan);
  EXPECT_EQ(kept, 1) << "it takes one place";
}

TEST_F(RecoverTest, an_unseen_scan_of_another_scanner_stays_the_newest_fingerprint) {
  begin(1);
  accept(PlcCommand::scan, 4, 1);
  apply(FailedAttemptJob{attempt(1, 4, 1), 302, kUnseenScan});
  for (std::uint8_t number = 1; number <= 70; ++number) {
    const std::uint64_t fingerprint = 101U + 2U * number;
    accept(PlcCommand::scan, 13, 1);
    if (number % 7 == 0)
      apply(FailedAttemptJob{attempt(1, 13, number), 303, fingerprint, true});
    else
      apply(AcquiredJob{attempt(1, 13, number), fingerprint, 0, true, true});
  }
  EXPECT_EQ(newest_fingerprint(), kUnseenScan);
}

TEST_F(RecoverTest, the_newest_fingerprints_come_back_oldest_first) {
  EXPECT_EQ(restart()->fingerprints[0], 0U);
  begin(1);
  std::uint64_t next = 0xFFFF'FFFF'0000'0000;  // above the range of a signed number
  for (int number = 1; number <= 70; ++number) {
    accept(PlcCommand::scan, 4, 1);
    Attempt a = attempt(1, 4, static_cast<std::uint8_t>(number));
    if (number % 3 == 0) {
      apply(FailedAttemptJob{a, 303, next++});
    } else {
      apply(AcquiredJob{a, next++});
    }
    if (number == 3) {
      EXPECT_EQ(restart()->fingerprints[3], 0U) << "three and no more";
    }
  }
  apply(SeenScanJob{next++});  // a calibration view
  accept(PlcCommand::scan, 4, 1);
  apply(FailedAttemptJob{attempt(1, 4, 71), 205});  // no scan arrived
  accept(PlcCommand::scan, 4, 1);
  apply(AcquiredJob{attempt(1, 4, 72), next - 1});  // recorded again because the first one returned an error
  const auto line = restart();
  for (std::size_t i = 0; i < kFingerprintsKept; ++i)
    EXPECT_EQ(line->fingerprints[i], next - kFingerprintsKept + i) << i;
}

TEST_F(RecoverTest, measured_station_comes_back_whole) {
  begin(1);
  acquire(1, 4, 1);
  const BlockResult block = random_block(prng_, 4, Verdict::indeterminate);
  PlcResult record = random_record(prng_, 9, 1);
  apply(BlockJob{1, 1, block, record});
  const auto line = restart();
  EXPECT_EQ(line->cmd_status, 4);
  EXPECT_EQ(line->acq_seq, cmd_seq_);
  EXPECT_EQ(line->res_seq, 9);
  EXPECT_EQ(line->stations[3].phase, StationPhase::measured);
  expect_same(line->stations[3].block, block);
  ASSERT_EQ(line->unacknowledged.size(), 1U);
  expect_same(line->unacknowledged.front(), record);
}

TEST_F(RecoverTest, failed_scan_keeps_its_code) {
  begin(1);
  accept(PlcCommand::scan, 4, 1);
  apply(FailedAttemptJob{attempt(1, 4, 1), 203});
  const auto line = restart();
  EXPECT_EQ(line->cmd_status, 0x8000 + 203);
  EXPECT_EQ(line->stations[3].phase, StationPhase::failed);
  EXPECT_EQ(line->stations[3].code, 203);
}

TEST_F(RecoverTest, pipelined_scan_leaves_the_earlier_block_to_be_measured) {
  begin(1);
  acquire(1, 1, 1);
  accept(PlcCommand::scan, 2, 1);
  const auto line = restart();
  EXPECT_EQ(line->stations[0].phase, StationPhase::acquired);
  EXPECT_EQ(line->stations[1].phase, StationPhase::failed);
  EXPECT_EQ(line->acq_seq, cmd_seq_ - 1);
  EXPECT_EQ(line->cmd_ack, cmd_seq_);
  EXPECT_EQ(line->cmd_status, kInterrupted);
}

TEST_F(RecoverTest, failed_rescan_takes_the_place_of_an_old_pass) {
  begin(1);
  scan(1, 4, 1, Verdict::pass);
  accept(PlcCommand::scan, 4, 1);
  apply(FailedAttemptJob{attempt(1, 4, 2), 302});
  auto line = restart();
  EXPECT_EQ(line->stations[3].phase, StationPhase::failed);
  EXPECT_EQ(line->stations[3].attempts, 2);
  EXPECT_EQ(line->stations[3].attempt.number, 1) << "the latest acquired one";
  EXPECT_EQ(line->stations[3].block.verdict, Verdict::none);

  accept(PlcCommand::scan, 4, 1);  // interrupted by the restart
  line = restart();
  EXPECT_EQ(line->stations[3].phase, StationPhase::failed);
  EXPECT_EQ(line->stations[3].code, 110);
  EXPECT_EQ(line->stations[3].attempts, 3);

  acquire(1, 4, 4);
  EXPECT_EQ(restart()->stations[3].phase, StationPhase::acquired);
  measure(1, 4, 4, Verdict::fail);
  line = restart();
  EXPECT_EQ(line->stations[3].phase, StationPhase::measured);
  EXPECT_EQ(line->stations[3].block.verdict, Verdict::fail);
  Result<std::optional<SlabRecord>> record = reader()->slab(1);
  ASSERT_TRUE(record.ok() && record.value().has_value());
  EXPECT_EQ(record.value()->blocks.size(), 4U) << "all attempts are kept";
}

TEST_F(RecoverTest, scan_that_was_never_carried_out_does_not_displace_a_later_one) {
  // The journal entry reached the disk although its commit returned an error; the PLC repeated the command.
  begin(1);
  accept(PlcCommand::scan, 4, 1);
  scan(1, 4, 1, Verdict::pass);
  const auto line = restart();
  EXPECT_EQ(line->stations[3].phase, StationPhase::measured);
  EXPECT_EQ(line->stations[3].attempts, 1);
  EXPECT_EQ(line->cmd_status, 4);
}

TEST_F(RecoverTest, interrupted_slab_end_leaves_the_slab_open) {
  begin(1);
  scan(1, 1, 1);
  accept(PlcCommand::slab_end, 0, 1);
  const auto line = restart();
  EXPECT_TRUE(line->slab_open);
  EXPECT_EQ(line->cmd_status, kInterrupted);
  EXPECT_EQ(line->stations[0].phase, StationPhase::measured);
  EXPECT_EQ(line->stations[0].attempts, 1);
}

TEST_F(RecoverTest, ended_slab_shows_its_table_until_the_next_end) {
  begin(1, 1001);
  scan(1, 1, 1);
  scan(1, 2, 1);
  scan(1, 2, 2);
  accept(PlcCommand::slab_end, 0, 1);
  const SlabResult slab = random_slab(prng_, Verdict::not_measured);
  PlcResult record = random_record(prng_, ++res_seq_, 2);
  apply(SlabJob{1, slab, record, 5});
  for (int pass = 0; pass < 2; ++pass) {
    const auto line = restart();
    EXPECT_EQ(line->slab_open, pass == 1);
    EXPECT_EQ(line->slab.key, pass == 0 ? 1 : 2);
    EXPECT_EQ(line->cmd_status, 4);
    EXPECT_EQ(line->slab_verdict, Verdict::not_measured);
    EXPECT_EQ(line->slab_reason, slab.reason);
    EXPECT_EQ(line->table_slab_no, 1001U);
    for (std::size_t i = 0; i < 18; ++i) {
      EXPECT_EQ(line->table[i].verdict, slab.station_verdict[i]);
      EXPECT_EQ(line->table[i].reason, slab.station_reason[i]);
      EXPECT_EQ(line->table[i].attempts, i == 0 ? 1 : i == 1 ? 2 : 0);
    }
    expect_same(line->slab_record, record);
    if (pass == 0) begin(2, 1002);
  }
}

TEST_F(RecoverTest, aborted_slab_is_closed_as_aborted) {
  begin(1);
  scan(1, 1, 1);
  accept(PlcCommand::slab_abort, 0, 1);
  SlabResult slab;
  slab.verdict = Verdict::aborted;
  slab.reason = 110;
  slab.station_verdict[0] = Verdict::pass;  // as earlier versions stored it
  slab.station_verdict[1] = Verdict::fail;
  PlcResult record = random_record(prng_, ++res_seq_, 2);
  record.verdict = Verdict::aborted;
  apply(SlabJob{1, slab, record, 5});
  const auto line = restart();
  EXPECT_EQ(line->table[0].verdict, Verdict::none);
  EXPECT_EQ(line->table[1].verdict, Verdict::fail);
  EXPECT_FALSE(line->slab_open);
  EXPECT_EQ(line->slab_verdict, Verdict::aborted);
  EXPECT_EQ(line->cmd_status, 4);
  begin(2);
}

TEST_F(RecoverTest, repeated_report_is_one_more_record_and_closes_its_command) {
  begin(1);
  scan(1, 1, 1);
  const std::uint16_t slab_seq = end(1, Verdict::pass);
  auto line = recover();
  const PlcResult original = line->slab_record;
  EXPECT_EQ(original.res_seq, slab_seq);
  acknowledge(slab_seq);
  accept(PlcCommand::report, 0, 0);
  PlcResult repeat = original;
  repeat.res_seq = ++res_seq_;
  apply(ReportJob{repeat});
  line = restart();
  EXPECT_EQ(line->cmd_status, 4);
  EXPECT_EQ(line->res_seq, res_seq_);
  ASSERT_EQ(line->unacknowledged.size(), 1U);
  expect_same(line->unacknowledged.front(), repeat);
  expect_same(line->slab_record, original);
}

TEST_F(RecoverTest, newest_wall_clock_survives_a_clock_that_went_back) {
  begin(1);
  constexpr std::int64_t kHour_us = 3'600'000'000;
  const std::int64_t years_later = std::int64_t{1} << 60U;
  CommandJob command{session_, ++cmd_seq_, 2, 1, 1, years_later};
  apply(command);
  command.cmd_seq = ++cmd_seq_;
  command.utime_us = years_later + kHour_us;
  apply(command);
  command.cmd_seq = ++cmd_seq_;
  command.utime_us = 5;
  apply(command);
  EXPECT_EQ(restart()->newest_utime_us, years_later + kHour_us);
  EXPECT_EQ(recover()->cmd_ack, cmd_seq_) << "commands are ordered by entry, not by time";
}

TEST_F(RecoverTest, a_clock_that_was_ahead_for_a_moment_leaves_no_mark) {
  begin(1);
  const std::int64_t before = restart()->newest_utime_us;
  CommandJob command{session_, ++cmd_seq_, 2, 1, 1, before + 500 * 86'400'000'000};
  apply(command);
  command.cmd_seq = ++cmd_seq_;
  command.utime_us = before + 60'000'000;
  apply(command);
  EXPECT_EQ(restart()->newest_utime_us, before + 60'000'000);
}

/// A SCAN counts as soon as it is accepted, even if its failure could not be recorded and other scans followed.
TEST_F(RecoverTest, a_station_given_up_for_a_new_scan_has_no_old_pass_whatever_was_scanned_since) {
  begin(1);
  scan(1, 3, 1);
  accept(PlcCommand::scan, 3, 1);
  scan(1, 4, 1);
  auto line = restart();
  EXPECT_EQ(line->stations[2].phase, StationPhase::failed);
  EXPECT_EQ(line->stations[2].attempts, 2);
  EXPECT_EQ(line->stations[3].phase, StationPhase::measured);
  scan(1, 3, 3);
  line = restart();
  EXPECT_EQ(line->stations[2].phase, StationPhase::measured);
}

/// SLAB_END returned an error but is in the log: a record that the PLC has never read.
TEST_F(RecoverTest, an_acknowledgement_is_of_the_record_shown_and_of_no_earlier_one) {
  begin(1);
  acquire(1, 1, 1);
  const std::uint16_t unseen = end(1, Verdict::aborted);
  apply(AckJob{measure(1, 1, 1)});
  auto line = restart();
  EXPECT_FALSE(line->slab_open);
  ASSERT_EQ(line->unacknowledged.size(), 1U);
  EXPECT_EQ(line->unacknowledged[0].res_seq, unseen);
  apply(AckJob{unseen});
  EXPECT_TRUE(restart()->unacknowledged.empty());
}

TEST_F(RecoverTest, results_beyond_the_queue_wait_for_the_next_restart_unacknowledged) {
  begin(1);
  std::vector<std::uint16_t> all;
  for (std::size_t i = 0; i < limits::kResultQueueMax + 3; ++i)
    all.push_back(scan(1, static_cast<int>(i % 18) + 1, static_cast<int>(i / 18) + 1));
  auto line = restart();
  ASSERT_EQ(line->unacknowledged.size(), limits::kResultQueueMax);
  EXPECT_EQ(line->unacknowledged.front().res_seq, all.front()) << "the oldest are kept";

  apply(AckJob{all[limits::kResultQueueMax + 1]});  // never shown, so it cannot be meant
  EXPECT_EQ(recover()->unacknowledged.size(), limits::kResultQueueMax);

  // The PLC acknowledges all records shown, including new measurements that are newer than the three.
  for (std::size_t i = 0; i < limits::kResultQueueMax; ++i) apply(AckJob{all[i]});
  const std::uint16_t newer = scan(1, 7, 50);
  const std::uint16_t newest = scan(1, 8, 50);
  apply(AckJob{newer});
  line = restart();
  ASSERT_EQ(line->unacknowledged.size(), 4U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(line->unacknowledged[i].res_seq, all[limits::kResultQueueMax + i]) << "was never shown";
  EXPECT_EQ(line->unacknowledged[3].res_seq, newest);

  acknowledge(all.back());
  line = restart();
  ASSERT_EQ(line->unacknowledged.size(), 1U) << "once shown, they are acknowledged like any other";
  EXPECT_EQ(line->unacknowledged[0].res_seq, newest);
  apply(AckJob{newest});
  EXPECT_TRUE(restart()->unacknowledged.empty());
}

/// A simple model of the line next to the store: after every job, recover() must agree with the model.
TEST_F(RecoverTest, long_random_day_agrees_with_a_model) {
  struct Model {
    std::int64_t slab = 0;
    bool open = false;
    std::array<StationPhase, 18> phase{};
    std::array<int, 18> attempts{};
    std::vector<std::uint16_t> waiting;
  } model;
  for (int turn = 0; turn < 300; ++turn) {
    const std::uint64_t dice = prng_.below(10);
    if (!model.open) {
      begin(++model.slab);
      model.open = true;
      model.phase.fill(StationPhase::empty);
      model.attempts.fill(0);
    } else if (dice == 0) {
      model.waiting.push_back(end(model.slab, Verdict::fail));
      model.open = false;
    } else if (dice < 3 && !model.waiting.empty()) {
      const std::size_t upto = prng_.below(model.waiting.size());
      apply(AckJob{model.waiting[upto]});
      model.waiting.erase(model.waiting.begin() + static_cast<std::ptrdiff_t>(upto));
    } else if (model.waiting.size() < 50) {
      const int station = 1 + static_cast<int>(prng_.below(18));
      const auto i = static_cast<std::size_t>(station - 1);
      const int number = ++model.attempts[i];
      if (dice < 5) {
        accept(PlcCommand::scan, station, model.slab);
        apply(FailedAttemptJob{attempt(model.slab, station, number), 301});
        model.phase[i] = StationPhase::failed;
      } else if (dice < 6) {
        acquire(model.slab, station, number);
        model.phase[i] = StationPhase::acquired;
      } else if (dice < 7) {
        accept(PlcCommand::scan, station, model.slab);
        model.phase[i] = StationPhase::failed;  // by the restart below
      } else {
        model.waiting.push_back(scan(model.slab, station, number));
        model.phase[i] = StationPhase::measured;
      }
    }
    const auto line = prng_.below(4) == 0 ? restart() : recover();
    ASSERT_EQ(line->slab_open, model.open);
    ASSERT_EQ(line->last_slab_key, model.slab);
    ASSERT_EQ(line->cmd_ack, cmd_seq_);
    ASSERT_EQ(line->res_seq, res_seq_);
    ASSERT_EQ(line->unacknowledged.size(), model.waiting.size());
    for (std::size_t i = 0; i < model.waiting.size(); ++i) ASSERT_EQ(line->unacknowledged[i].res_seq, model.waiting[i]);
    for (std::size_t i = 0; model.open && i < 18; ++i) {
      ASSERT_EQ(line->stations[i].phase, model.phase[i]) << "turn " << turn << " station " << i + 1;
      ASSERT_EQ(line->stations[i].attempts, model.attempts[i]);
    }
  }
}

// A backup that was copied into place manually, or a disk that was reset.
TEST_F(RecoverTest, a_database_older_than_its_spool_gives_no_key_a_second_time) {
  begin(1);
  scan(1, 1, 1);
  end(1, Verdict::pass);
  close();
  const std::string backup = folder_.path() + "/backup.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, backup).ok());
  open();
  (void)recover();
  for (const std::int64_t key : {2, 10}) {
    begin(key);
    scan(key, 1, 1);
    end(key, Verdict::pass);
  }
  close();
  EXPECT_TRUE(open_store(settings_).ok()) << "in step with its spool";
  for (const char* side : {"", "-wal", "-shm"}) std::filesystem::remove(settings_.db_path + side);
  std::filesystem::copy_file(backup, settings_.db_path);
  const auto refused = open_store(settings_);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, Code::journal_write);
  const std::string_view text = refused.error().text.view();
  EXPECT_NE(text.find("slabs up to 1, and " + settings_.spool_dir + "/10"), std::string_view::npos) << text;
  EXPECT_NE(text.find("slabctl db restore"), std::string_view::npos) << text;
  // The existing database is the newest one left.
  ASSERT_TRUE(restore_database(
                  settings_, {settings_.db_path, {"anna", "the disk broke", 1'700'000'000'000'000}, 4711, false, true})
                  .ok());
  open();
  EXPECT_EQ(recover()->last_slab_key, 10);
}

TEST_F(RecoverTest, folders_of_digits_without_scans_are_not_slabs) {
  begin(1);
  for (const char* name : {"/20261123/photos", "/2"}) std::filesystem::create_directories(settings_.spool_dir + name);
  std::ofstream(settings_.spool_dir + "/20261123/04.jpg") << "a look at the fixture";
  EXPECT_EQ(restart()->last_slab_key, 1);
}

}  // namespace
}  // namespace slabd::storage
