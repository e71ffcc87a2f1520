// SPDX-License-Identifier: Apache-2.0
//
// The process ends while a scan is taken: its points were not seen, and a scanner that hangs may return them for any
// block.
#include <gtest/gtest.h>

#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

struct UnseenScan : StationTest {
  void die_while_scanning() {
    begin();
    line.scanner_answers = false;
    line.scan(4);
    ASSERT_EQ(line.scans.size(), 1U);
    line.start();
    line.scanner_answers = true;
    line.plc.command_writer = 0;
  }
};

TEST_F(UnseenScan, next_scan_from_the_scanner_is_discarded_and_the_block_is_still_scanned) {
  die_while_scanning();
  line.fingerprint = 0x0F01;
  line.robot_station = 4;
  line.run_for(600);
  const std::uint16_t seq = line.command(PlcCommand::scan, 4);
  for (int t = 0; t < 2'000 && line.scans.size() < 3; t += 4) {
    line.run_for(4);
    if (line.scans.size() == 2) line.fingerprint = 0x0F03;
  }
  ASSERT_EQ(line.scans.size(), 3U);
  EXPECT_EQ(line.scans[1].request.session, 0) << "no command stands behind it";
  EXPECT_EQ(line.scans[1].request.station, 4);
  EXPECT_NE(line.scans[1].request.spool_path.view(), line.scans[2].request.spool_path.view());
  EXPECT_EQ(line.scans[2].request.cmd_seq, seq);
  line.run_for(1'000);
  EXPECT_EQ(line.view().acq_seq, seq);
  EXPECT_EQ(line.dropped.size(), 1U);
  ASSERT_EQ(line.measured.size(), 1U);
  line.fingerprint = 0x0F05;
  line.scan(5);
  EXPECT_EQ(line.scans.size(), 4U) << "once";
}

TEST_F(UnseenScan, a_scanner_that_hangs_gives_the_same_twice_and_is_refused) {
  die_while_scanning();
  line.fingerprint = 0x0F01;
  line.scan(4);
  EXPECT_EQ(line.scans.size(), 3U);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
  EXPECT_TRUE(line.measured.empty());
  line.fingerprint = 0x0F03;
  line.fingerprint_thrown_away = 0x0F05;
  line.scan(4);
  EXPECT_EQ(line.view().acq_seq, line.plc.cmd_seq);
}

TEST_F(UnseenScan, a_known_scan_is_not_the_unseen_one) {
  begin();
  line.fingerprint = 0x0E01;
  line.scan(1);
  line.fingerprint = 0;
  line.scanner_answers = false;
  line.scan(4);
  line.start();
  line.scanner_answers = true;
  line.plc.command_writer = 0;
  line.fingerprint = 0x0E01;
  line.scan(4);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
  EXPECT_EQ(line.scans.back().request.session, 0);
  line.fingerprint = 0;
  const std::size_t before = line.scans.size();
  line.scan(4);
  EXPECT_EQ(line.scans.size(), before + 2) << "still not trusted";
}

/// Each way in which a request brings no new points, without a restart.
TEST_F(UnseenScan, an_undelivered_scan_is_not_used_for_another_block) {
  begin();
  std::uint64_t fingerprint = 0x0E01;
  line.fingerprint = fingerprint;
  line.scan(1);
  for (const char* way : {"timeout", "incomplete", "abort", "the last one again"}) {
    SCOPED_TRACE(way);
    const std::string what = way;
    line.scan_code = what == "timeout"      ? Code::trigger_timeout
                     : what == "incomplete" ? Code::frame_incomplete
                                            : Code::ok;
    line.scanner_answers = what != "abort";
    if (what != "the last one again") line.fingerprint = fingerprint += 2;
    line.scan(4);
    if (what == "abort") {
      line.plc.abort = true;
      line.feed(line.plc);
      line.run_for(20);
      line.plc.abort = false;
      line.feed(line.plc);
    }
    ASSERT_GE(line.view().cmd_status, kCommandFailed);
    line.scan_code = Code::ok;
    line.scanner_answers = true;

    const std::size_t before = line.scans.size();
    const std::size_t measured = line.measured.size();
    line.fingerprint = fingerprint += 2;  // may be of block 4, as far as slabd can tell
    line.robot_station = 5;
    line.run_for(600);
    const std::uint16_t seq = line.command(PlcCommand::scan, 5);
    for (int t = 0; t < 2'000 && line.scans.size() < before + 2; t += 4) {
      line.run_for(4);
      if (line.scans.size() == before + 1) line.fingerprint = fingerprint + 2;
    }
    fingerprint += 2;
    line.run_for(1'000);
    ASSERT_EQ(line.scans.size(), before + 2);
    EXPECT_EQ(line.scans[before].request.session, 0);
    EXPECT_EQ(line.view().acq_seq, seq);
    EXPECT_EQ(line.measured.size(), measured + 1);
    line.take_results();
  }
}

TEST_F(UnseenScan, a_scan_delivered_repeatedly_stays_known_after_many_discarded_ones) {
  begin();
  line.fingerprint = 0x0E01;
  line.scan(1);
  for (std::uint64_t i = 0; i < 2 * kFingerprintsKept; ++i) {
    line.fingerprint_thrown_away = 0x1001 + 2 * i;
    line.scan(2);
    ASSERT_EQ(line.view().cmd_status, failed(Code::frame_incomplete)) << i;
    if (i % 50 != 49) continue;
    line.start();
    line.plc.command_writer = 0;
    line.run_for(300);
  }
  line.fingerprint = 0x0F01;
  line.fingerprint_thrown_away = 0x0F03;
  line.scan(2);
  EXPECT_EQ(line.view().acq_seq, line.plc.cmd_seq);
}

TEST_F(UnseenScan, an_undelivered_scan_from_before_a_restart_is_not_used_after_it) {
  begin();
  line.scan_code = Code::trigger_timeout;
  line.scan(4);
  line.start();
  line.plc.command_writer = 0;
  line.scan_code = Code::ok;
  line.fingerprint = 0x0F01;
  const std::size_t before = line.scans.size();
  line.scan(5);
  ASSERT_GT(line.scans.size(), before);
  EXPECT_EQ(line.scans[before].request.session, 0);
}

TEST_F(UnseenScan, a_scanner_without_an_answer_fails_the_command_and_its_next_scan_is_discarded) {
  die_while_scanning();
  line.scan_code = Code::trigger_timeout;
  line.scan(4);
  EXPECT_EQ(line.view().cmd_status, failed(Code::trigger_timeout));
  EXPECT_EQ(line.scans.back().request.session, 0);
  line.scan_code = Code::ok;
  line.scan(4);
  EXPECT_EQ(line.view().acq_seq, line.plc.cmd_seq);
  EXPECT_EQ(line.scans.size(), 4U);
}

TEST_F(UnseenScan, abort_ends_it) {
  die_while_scanning();
  line.scanner_answers = false;
  line.scan(4);
  EXPECT_EQ(line.scans.back().request.session, 0);
  line.plc.abort = true;
  line.feed(line.plc);
  line.run_for(40);
  EXPECT_EQ(line.cancelled, 1);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  line.plc.abort = false;
  line.scanner_answers = true;
  line.scan(4);
  EXPECT_EQ(line.view().acq_seq, line.plc.cmd_seq) << "the buffer came back";
}

/// A scanner that needs `ms` for the discarded scan.
struct SlowScanner : UnseenScan {
  void throw_away_for(int ms, bool poses_go_on = true) {
    die_while_scanning();
    line.scanner_answers = false;
    line.scan(4);
    EXPECT_EQ(line.scans.back().request.timeout_ns, line.settings.scan_timeout_ns);
    line.run_for(ms);
    ScanDone done;
    done.cmd_seq = line.scans.back().request.cmd_seq;
    done.slot = line.scans.back().slot;
    done.durable = true;
    done.fingerprint = 0x0F01;
    line.robot_present = poses_go_on;
    line.run_for(poses_go_on ? 0 : 1'000);
    line.feed(done);
    line.run_for(40);
  }
};

TEST_F(SlowScanner, leaves_the_robot_its_time_to_settle) {
  line.settings.scan_timeout_ns = 15 * kNsPerS;
  line.settings.settle_timeout_ns = 5 * kNsPerS;
  throw_away_for(6'000, false);
  EXPECT_EQ(line.scans.size(), 2U) << "no pose to scan from";
  EXPECT_EQ(line.view().cmd_status, static_cast<int>(CommandStatus::acquiring));
  line.robot_present = true;
  line.run_for(2'000);
  EXPECT_EQ(line.scans.size(), 3U);
}

TEST_F(SlowScanner, with_a_lost_robot_still_answers_the_plc_in_time) {
  line.settings.scan_timeout_ns = 15 * kNsPerS;
  line.settings.settle_timeout_ns = 60 * kNsPerS;
  throw_away_for(6'000, false);
  line.run_for(12'000);
  EXPECT_EQ(line.scans.size(), 2U);
  EXPECT_EQ(line.view().cmd_status, failed(Code::pose_stale));
}

TEST_F(SlowScanner, answers_while_the_plc_waits_for_it) {
  line.settings.scan_timeout_ns = 15 * kNsPerS;
  throw_away_for(8'000);
  ASSERT_EQ(line.scans.size(), 3U);
  EXPECT_LT(line.scans.back().request.timeout_ns, 11 * kNsPerS) << "what is left of the PLC's 20 s";
  EXPECT_GT(line.scans.back().request.timeout_ns, 9 * kNsPerS);
}

TEST_F(SlowScanner, that_leaves_no_time_for_the_blocks_own_scan_is_triggered_by_the_next_command) {
  line.settings.scan_timeout_ns = 15 * kNsPerS;
  throw_away_for(12'000);
  EXPECT_EQ(line.scans.size(), 2U) << "what would be asked for in vain would have to be thrown away, too";
  EXPECT_EQ(line.view().cmd_status, failed(Code::trigger_timeout));
  line.scanner_answers = true;
  line.fingerprint = 0x0F03;
  line.start();
  line.plc.command_writer = 0;
  line.scan(4);
  ASSERT_EQ(line.scans.size(), 3U) << "also after a restart";
  EXPECT_NE(line.scans.back().request.session, 0);
  EXPECT_EQ(line.view().acq_seq, line.plc.cmd_seq);
}

/// The mark of an unseen scan must outlive all later scans.
TEST_F(UnseenScan, is_detected_after_a_restart_however_often_the_discarded_scan_was_interrupted) {
  begin();
  const auto abort_when = [this](std::size_t scans, bool decoded) {
    line.scanner_answers = false;
    line.command(PlcCommand::scan, 2);
    for (int t = 0; t < 2'000 && line.scans.size() < scans; t += 4) line.run_for(4);
    ASSERT_EQ(line.scans.size(), scans);
    ScanDone done;
    done.cmd_seq = line.scans.back().request.cmd_seq;
    done.slot = line.scans.back().slot;
    if (decoded) {
      done.fingerprint = 0x0F00U + 2 * scans + 1;
      line.feed(done);
    }
    for (const bool abort : {true, false}) {
      line.plc.abort = abort;
      line.feed(line.plc);
      line.run_for(40);
    }
  };
  line.robot_station = 2;
  line.run_for(600);
  abort_when(1, false);  // the mark is stored
  abort_when(2, true);   // the discarded scan is known, and newer than the mark
  abort_when(3, false);  // this one was not seen
  line.start();
  line.scanner_answers = true;
  line.plc.command_writer = 0;
  line.scan(3);
  ASSERT_GE(line.scans.size(), 4U);
  EXPECT_EQ(line.scans[3].request.session, 0) << "what was asked for station 2 may come now";
}

/// No fingerprint is stored after the mark while it is needed.
TEST_F(UnseenScan, the_mark_stays_when_a_worker_returns_a_known_scan_and_the_process_is_killed) {
  begin();
  line.fingerprint = 0x0E01;
  line.scan(1);
  line.worker_hangs = true;
  line.scanner_answers = false;
  line.scan(4);
  const AcquireScan asked = line.scans.back();
  line.feed(LinkStatus{false, true, 0});
  for (const bool abort : {true, false}) {
    line.plc.abort = abort;
    line.feed(line.plc);
    line.run_for(40);
  }
  EXPECT_EQ(store.seen.back(), kUnseenScan);
  store.fail_when = [](const StoreJob& job) {  // or: the process dies before it
    const auto* seen = std::get_if<SeenScanJob>(&job.what);
    return seen != nullptr && seen->fingerprint == kUnseenScan;
  };
  ScanDone done;
  done.cmd_seq = asked.request.cmd_seq;
  done.slot = asked.slot;
  done.durable = true;
  done.fingerprint = 0x0E01;
  line.feed(done);
  line.run_for(40);
  store.fail_when = {};
  EXPECT_EQ(store.seen.back(), kUnseenScan);
  line.start();
  line.worker_hangs = false;
  line.scanner_answers = true;
  line.feed(LinkStatus{true, false, 0});
  line.plc.command_writer = 0;
  line.fingerprint = 0x0F01;  // exposed for block 4
  const std::size_t before = line.scans.size();
  line.scan(5);
  ASSERT_GT(line.scans.size(), before);
  EXPECT_EQ(line.scans[before].request.session, 0) << "what was exposed for block 4 is taken for block 5";
}

TEST_F(StationTest, a_restart_between_two_scans_requests_no_further_scan) {
  begin();
  line.scan(1);
  line.start();
  line.plc.command_writer = 0;
  line.scan(2);
  EXPECT_EQ(line.scans.size(), 2U);
}

}  // namespace
}  // namespace slabd::daemon
