// SPDX-License-Identifier: Apache-2.0
//
// Jobs that returned an error are reported as not done, but some of them are in the log nevertheless. Results that were
// not shown to the PLC must not appear later, in records or in the history. A failure that was reported to the PLC must
// be recorded as a failure.
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <string>

#include "tests/storage/crash_disk.h"
#include "tests/storage/fast_store.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

using AnsweredWithAnError = FastStoreTest;

// The commit of a slab's end returns an error, but is sometimes in the log nevertheless. As long as the end was not
// reported, the slab is open: a block that is scanned again must not find its slab passed.
TEST_F(AnsweredWithAnError, an_end_is_taken_back_by_the_next_job) {
  // The call that leaves it in the log depends on the pages written, so all calls are tried, some of them repeatedly.
  int in_the_log = 0;
  std::int64_t key = 0;
  for (int turn = 0; turn < 120; ++turn) {
    const std::uint64_t point = 1 + static_cast<std::uint64_t>(turn) % 30;
    for (const bool restarted : {true, false}) {
      crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);  // only files opened from here on count
      open();
      begin(++key);
      accept(PlcCommand::slab_end, 0, key);
      SlabResult slab;
      slab.verdict = Verdict::pass;
      PlcResult record = random_record(prng_, ++res_seq_, 2);
      crash_disk::fail(root_, point, 12, EIO, false);
      const bool failed = !try_apply(SlabJob{key, slab, record, 3000}).ok();
      (void)crash_disk::heal();
      if (failed && restarted) {
        close();
        open();
        in_the_log += recover()->slab_open ? 0 : 1;
      } else if (failed) {
        apply(SessionJob{++session_});
        EXPECT_EQ(reader()->slab(key).value()->summary.ended_utime_us, 0) << "call " << point;
        close();
        open();
        const auto line = recover();
        EXPECT_TRUE(line->slab_open) << "call " << point;
        EXPECT_EQ(line->cmd_status, kCommandFailed + static_cast<int>(Code::interrupted)) << "call " << point;
        for (; !line->unacknowledged.empty(); line->unacknowledged.pop())
          EXPECT_NE(line->unacknowledged.front().res_seq, res_seq_) << "call " << point;
      }
      if (recover()->slab_open) end(key, Verdict::fail);
      acknowledge(res_seq_);
      close();
    }
  }
  EXPECT_GT(in_the_log, 0) << "no such end has ever been in the log: this test cannot fail";
}

// A passed block returns an error, its commit is sometimes in the log nevertheless, and the PLC has the station scanned
// again. A record that was never shown to the PLC must not appear after a restart, because it would replace a newer
// one.
TEST_F(AnsweredWithAnError, a_block_is_taken_back_by_the_next_job) {
  constexpr std::uint64_t kNever = ~std::uint64_t{0} >> 1U;
  const auto pass = [this](std::int64_t key, int station) {
    PlcResult record = random_record(prng_, ++res_seq_, 1);
    record.station = static_cast<std::uint16_t>(station);
    record.cmd_seq = cmd_seq_;
    return try_apply(BlockJob{key, 1, random_block(prng_, station, Verdict::pass), record}).ok();
  };
  int in_the_log = 0;
  std::int64_t key = 0;
  for (int turn = 0; turn < 80; ++turn) {
    for (const bool restarted : {true, false}) {
      crash_disk::fail(root_, kNever, 1, EIO, false);  // only files opened from here on count
      open();
      begin(++key);
      acquire(key, 3, 1);
      crash_disk::fail(root_, kNever, 1, EIO, false);
      EXPECT_TRUE(pass(key, 3));
      // The next block makes about the same number of calls; the last of them leave it in the log.
      const std::uint64_t point = crash_disk::heal() + 20 - static_cast<std::uint64_t>(turn) % 40;
      acquire(key, 4, 1);
      crash_disk::fail(root_, point, 12, EIO, false);
      const bool failed = !pass(key, 4);
      (void)crash_disk::heal();
      if (failed && restarted) {
        close();
        open();
        in_the_log += recover()->stations[3].phase == StationPhase::measured ? 1 : 0;
      } else if (failed) {
        acquire(key, 4, 2);
        EXPECT_EQ(reader()->slab(key).value()->blocks.at(1).phase, StationPhase::acquired) << "call " << point;
        apply(AckJob{measure(key, 4, 2, Verdict::fail)});
        close();
        open();
        const auto line = recover();
        for (; !line->unacknowledged.empty(); line->unacknowledged.pop())
          EXPECT_NE(line->unacknowledged.front().station, 4) << "call " << point << " shows what was never an answer";
        EXPECT_EQ(line->stations[3].block.verdict, Verdict::fail) << "call " << point;
      }
      const std::uint16_t last = end(key, Verdict::fail);
      acknowledge(last);
      close();
    }
  }
  EXPECT_GT(in_the_log, 0) << "no such block has ever been in the log: this test cannot fail";
}

// The same without a further job, because a fault may last for hours. The history, an export and a copy of the database
// must not contain an unreported end.
TEST_F(AnsweredWithAnError, an_end_is_taken_back_in_a_quiet_moment) {
  int in_the_log = 0;
  std::int64_t key = 0;
  const std::string copy = settings_.db_path + "-copy";
  for (int turn = 0; turn < 120; ++turn) {
    // Every call once, then those near the end of the commit repeatedly: two of five leave an end in the log.
    const auto call = static_cast<std::uint64_t>(turn);
    const std::uint64_t point = turn < 30 ? 1 + call : 16 + call % 9;
    crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);  // only files opened from here on count
    open();
    begin(++key);
    acquire(key, 5, 1);
    EXPECT_NE(measure(key, 5, 1), 0);
    accept(PlcCommand::slab_end, 0, key);
    SlabResult slab;
    slab.verdict = Verdict::pass;
    const PlcResult record = random_record(prng_, ++res_seq_, 2);
    crash_disk::fail(root_, point, 12, EIO, false);
    const bool failed = !try_apply(SlabJob{key, slab, record, 3000}).ok();
    (void)crash_disk::heal();
    if (failed) {
      ASSERT_TRUE(store_->order(BackupOrder{copy}).ok());
      in_the_log += reader()->slab(key).value()->summary.ended_utime_us != 0 ? 1 : 0;
      for (int look = 0; look < 200 && store_->care().backup == CareState::Phase::under_way; ++look) store_->idle();
      EXPECT_EQ(reader()->slab(key).value()->summary.ended_utime_us, 0) << "call " << point;
      ASSERT_EQ(store_->care().backup, CareState::Phase::done);
      const auto copied = open_reader(copy);
      ASSERT_TRUE(copied.ok());
      EXPECT_EQ(copied.value()->slab(key).value()->summary.ended_utime_us, 0) << "call " << point;
      fs::remove(copy);
      // Everything is settled: a new end stays.
      const std::uint16_t last = end(key, Verdict::fail);
      apply(SessionJob{++session_});
      EXPECT_EQ(reader()->slab(key).value()->slab.verdict, Verdict::fail);
      acknowledge(last);
    } else {
      acknowledge(res_seq_);
    }
    close();
  }
  EXPECT_GT(in_the_log, 0) << "no such end has ever been in the log: this test cannot fail";
}

// While the disk rejects writes, unsettled data is not copied.
TEST_F(AnsweredWithAnError, changes_that_cannot_be_rolled_back_are_not_copied) {
  crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);
  open();
  begin(1);
  accept(PlcCommand::slab_end, 0, 1);
  SlabResult slab;
  slab.verdict = Verdict::pass;
  crash_disk::fail(root_, 1, crash_disk::kAllThatFollow, EIO, false);
  ASSERT_FALSE(try_apply(SlabJob{1, slab, random_record(prng_, ++res_seq_, 2), 3000}).ok());
  ASSERT_TRUE(store_->order(BackupOrder{settings_.db_path + "-copy"}).ok());
  for (int look = 0; look < 120; ++look) store_->idle();
  EXPECT_EQ(store_->care().backup, CareState::Phase::under_way);
  (void)crash_disk::heal();
  for (int look = 0; look < 120; ++look) store_->idle();
  EXPECT_EQ(store_->care().backup, CareState::Phase::done);
}

// A scan that failed or was rejected by the disk is reported to the PLC and not repeated. The database must record the
// failure, because otherwise an earlier attempt would decide the verdict.
TEST_F(AnsweredWithAnError, an_attempt_is_a_failed_one_with_the_next_job) {
  std::int64_t key = 0;
  int in_the_log = 0;
  for (int turn = 0; turn < 60; ++turn) {
    const std::uint64_t point = 1 + static_cast<std::uint64_t>(turn) % 20;
    for (const bool acquired : {true, false}) {
      for (const bool quiet : {true, false}) {
        crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);
        open();
        begin(++key);
        EXPECT_NE(scan(key, 4, 1), 0);
        const std::uint16_t first = cmd_seq_;
        const std::string path = scan_file(key, 4, 2, 1'000);
        accept(PlcCommand::scan, 4, key);
        Attempt second = attempt(key, 4, 2);
        second.scan_path = PathText(path);
        crash_disk::fail(root_, point, 12, EIO, false);
        const Status told =
            acquired ? try_apply(AcquiredJob{second, 99})
                     : try_apply(FailedAttemptJob{second, static_cast<std::uint16_t>(Code::interrupted), kUnseenScan});
        (void)crash_disk::heal();
        if (!told.ok()) {
          in_the_log += reader()->slab(key).value()->blocks.size() == 2 ? 1 : 0;
          if (quiet)
            for (int look = 0; look < 10; ++look) store_->idle();
          else
            accept(PlcCommand::scan, 5, key);
          const auto slab = reader()->slab(key);
          ASSERT_EQ(slab.value()->blocks.size(), 2U) << "call " << point;
          EXPECT_EQ(slab.value()->blocks[1].phase, StationPhase::failed);
          EXPECT_EQ(slab.value()->blocks[1].attempt.scan_path.view(), path) << "the file must be counted";
          close();
          open();
          const auto line = recover();
          EXPECT_EQ(line->stations[3].attempts, 2);
          EXPECT_EQ(line->acq_seq, first) << "the robot was never told to go on from the second";
          EXPECT_EQ(line->stations[3].phase, StationPhase::failed);
          EXPECT_EQ(line->stations[3].code, static_cast<int>(acquired ? told.error().code : Code::interrupted));
        }
        acknowledge(end(key, Verdict::fail));
        close();
      }
    }
  }
  EXPECT_GT(in_the_log, 0);
}

// The log cannot grow, so unsettled jobs cannot be settled. The log's content can still be moved into the database,
// which frees space.
TEST_F(AnsweredWithAnError, a_full_disk_does_not_keep_the_log_from_being_used_again) {
  crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);  // only files opened from here on count
  open();
  const std::int64_t slabs = kKeepSlabsMin + 30;
  for (std::int64_t key = 1; key <= slabs; ++key) {
    begin(key);
    EXPECT_NE(scan(key, 4, 1), 0);
    acknowledge(end(key, Verdict::pass));
  }
  // Free pages, as in a pruned database, and a log that is used to its end.
  ASSERT_TRUE(store_->order(PruneOrder{kKeepSlabsMin, kKeepSlabsMin}).ok());
  for (int look = 0; look < 60; ++look) store_->idle();
  ASSERT_EQ(store_->care().prune, CareState::Phase::done);
  const std::int64_t key = slabs + 1;
  begin(key);
  const std::string log = settings_.db_path + "-wal";
  for (const auto size = fs::file_size(log); fs::file_size(log) == size;) apply(SessionJob{++session_});
  accept(PlcCommand::scan, 3, key);
  const Attempt third = attempt(key, 3, 1);
  crash_disk::fill(root_);
  const Status told = try_apply(AcquiredJob{third, 7});
  ASSERT_FALSE(told.ok());
  EXPECT_EQ(told.error().code, Code::store_full);
  for (int look = 0; look < 100; ++look) store_->idle();
  const Status again = try_apply(SessionJob{++session_});
  EXPECT_TRUE(again.ok()) << "FAULT_RESET: " << again.error().text.view();
  EXPECT_EQ(reader()->slab(key).value()->blocks.at(0).phase, StationPhase::failed);
  (void)crash_disk::heal();
}

// A job that contradicts the database does so every time, and must not block later jobs.
TEST_F(AnsweredWithAnError, a_contradicting_attempt_does_not_stop_the_store) {
  crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);
  open();
  begin(1);
  accept(PlcCommand::scan, 4, 1);
  Attempt of_no_slab = attempt(1, 4, 1);
  of_no_slab.slab_key = 77;
  EXPECT_FALSE(try_apply(AcquiredJob{of_no_slab, 5}).ok());
  EXPECT_TRUE(try_apply(SessionJob{++session_}).ok());
  // The same after a disk failure, so that the job has to be settled.
  crash_disk::fail(root_, 1, crash_disk::kAllThatFollow, EIO, false);
  EXPECT_FALSE(try_apply(AcquiredJob{of_no_slab, 5}).ok());
  (void)crash_disk::heal();
  (void)try_apply(SessionJob{++session_});
  EXPECT_TRUE(try_apply(SessionJob{++session_}).ok());
  acknowledge(end(1, Verdict::fail));
}

// A report returns an error, and its repeated record is sometimes in the log. The next job removes it, and after a
// restart the PLC reads that its command failed.
TEST_F(AnsweredWithAnError, a_report_is_taken_back_by_the_next_job) {
  int in_the_log = 0;
  open();
  begin(1);
  acknowledge(scan(1, 4, 1, Verdict::pass));
  close();
  for (int turn = 0; turn < 120; ++turn) {
    const std::uint64_t point = 1 + static_cast<std::uint64_t>(turn) % 30;
    for (const bool restarted : {true, false}) {
      crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);  // only files opened from here on count
      open();
      accept(PlcCommand::report, 4, 1);
      const PlcResult record = random_record(prng_, ++res_seq_, 1);
      crash_disk::fail(root_, point, 12, EIO, false);
      const bool failed = !try_apply(ReportJob{record}).ok();
      (void)crash_disk::heal();
      if (failed && !restarted) apply(SessionJob{++session_});
      close();
      open();
      const auto line = recover();
      if (failed && !restarted) {
        EXPECT_TRUE(line->unacknowledged.empty()) << "call " << point;
        EXPECT_EQ(line->cmd_status, kCommandFailed + static_cast<int>(Code::interrupted)) << "call " << point;
      } else if (!line->unacknowledged.empty()) {
        in_the_log += failed ? 1 : 0;
        acknowledge(res_seq_);
      }
      close();
    }
  }
  EXPECT_GT(in_the_log, 0) << "no such report has ever been in the log: this test cannot fail";
}

}  // namespace
}  // namespace slabd::storage
