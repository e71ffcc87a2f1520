// SPDX-License-Identifier: Apache-2.0
//
// A network share hangs and blocks the scanner's worker in a call that cannot be interrupted. The line must get its
// answer, the buffer must not be used otherwise, and the worker's late scan must not count for any block.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

constexpr LinkStatus kHangs{false, true, 0};
constexpr LinkStatus kWorks{true, false, 0};
constexpr LinkStatus kSpoolHangs{false, true, 0, true};

struct StationHangTest : StationTest {
  void SetUp() override {
    begin();
    line.worker_hangs = true;
    line.scanner_answers = false;
    line.scan(1);
    ASSERT_EQ(line.view().state, PlcState::scanning);
    asked = line.scans.back();
    line.feed(kHangs);
  }
  /// The worker returns with the result of its old request.
  void come_back(Code code) {
    line.worker_hangs = false;
    line.scanner_answers = true;
    line.feed(kWorks);
    ScanDone done;
    done.cmd_seq = asked.request.cmd_seq;
    done.slot = asked.slot;
    done.code = code;
    done.scan.path = asked.request.spool_path;
    done.scan.shape = {1000, 900, 0, 0};
    done.fingerprint = fingerprint;
    if (code == Code::ok) line.feed(done);  // decoded
    done.durable = true;
    line.feed(done);
    line.run_for(40);
  }
  [[nodiscard]] bool all_buffers_are_free() const {
    return std::none_of(line.station->slot_busy.begin(), line.station->slot_busy.end(), [](bool b) { return b; });
  }
  AcquireScan asked;
  std::uint64_t fingerprint = 0;  ///< of the worker's scan
};

TEST_F(StationHangTest, a_scan_ends_301_before_the_plc_gives_up_and_the_slab_stays_open) {
  line.run_for(17'000);
  EXPECT_EQ(line.view().state, PlcState::scanning) << "it may still come";
  line.run_for(2'600);
  EXPECT_EQ(line.view().cmd_status, failed(Code::scanner_offline));
  EXPECT_TRUE(line.view().slab_open);
  EXPECT_FALSE(line.view().scanner_ok);
  EXPECT_EQ(line.view().fault, 0);
  EXPECT_TRUE(line.measured.empty());
}

TEST_F(StationHangTest, a_worker_that_only_takes_its_time_is_waited_for) {
  line.feed(kWorks);
  line.run_for(60'000);
  EXPECT_EQ(line.view().state, PlcState::scanning);
  EXPECT_EQ(line.cancelled, 0);
}

TEST_F(StationHangTest, ABORT_is_answered_at_once) {
  line.plc.abort = true;
  line.feed(line.plc);
  line.run_for(40);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  EXPECT_TRUE(line.view().slab_open);
}

TEST_F(StationHangTest, no_scan_is_requested_meanwhile_and_its_buffer_stays_reserved) {
  line.run_for(20'000);
  const std::size_t asked_before = line.scans.size();
  EXPECT_TRUE(line.station->slot_busy[asked.slot]);
  for (int again = 0; again < 2; ++again) {
    line.scan(2);
    line.run_for(8'000);
    EXPECT_EQ(line.view().cmd_status, failed(Code::scanner_offline)) << "the settle time, not longer";
  }
  line.feed(kWorks);  // requests are possible again, but the answer to the first one is still missing
  line.scan(2);
  line.run_for(8'000);
  EXPECT_EQ(line.view().cmd_status, failed(Code::scanner_offline));
  EXPECT_EQ(line.scans.size(), asked_before);
  EXPECT_TRUE(line.station->slot_busy[asked.slot]);
}

TEST_F(StationHangTest, a_scan_that_comes_after_it_was_given_up_is_dropped_and_measured_nowhere) {
  line.run_for(20'000);
  come_back(Code::ok);
  EXPECT_TRUE(line.measured.empty());
  ASSERT_EQ(line.dropped.size(), 1U);
  EXPECT_EQ(line.dropped[0], asked.request.spool_path.view());
  EXPECT_TRUE(all_buffers_are_free());
  EXPECT_EQ(line.view().stations_done, 0);
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4) << "and the line goes on";
  EXPECT_EQ(line.measured.size(), 1U);
}

TEST_F(StationHangTest, a_scan_that_was_given_up_is_not_accepted_as_a_later_scan) {
  line.run_for(20'000);
  fingerprint = 4711;
  come_back(Code::ok);
  line.fingerprint = 4711;  // the scanner repeats it, under a name that is expected
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
  EXPECT_EQ(line.view().stations_done, 0);
  line.fingerprint = 4712;
  line.fingerprint_thrown_away = 4714;
  line.scan(1);
  EXPECT_EQ(line.view().stations_done, 1);
}

TEST_F(StationHangTest, an_error_that_comes_after_it_was_given_up_frees_the_buffer) {
  line.run_for(20'000);
  come_back(Code::trigger_timeout);
  EXPECT_TRUE(line.dropped.empty());
  EXPECT_TRUE(all_buffers_are_free());
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationHangTest, the_slab_can_be_aborted_and_the_next_begun_while_it_hangs) {
  line.run_for(20'000);
  line.command(PlcCommand::slab_abort);
  line.run_for(60);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
  come_back(Code::ok);
  line.take_results();
  begin();
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.measured.size(), 1U) << "of the new slab alone";
}

TEST_F(StationHangTest, a_hang_that_ends_in_time_has_no_effect) {
  line.run_for(5'000);
  line.worker_hangs = false;
  line.feed(kWorks);
  ScanDone done;
  done.cmd_seq = asked.request.cmd_seq;
  done.slot = asked.slot;
  done.durable = true;
  done.scan.path = asked.request.spool_path;
  done.scan.shape = {1000, 900, 0, 0};
  done.scan.taken_mono_ns = line.station->now_ns;
  line.feed(done);
  line.run_for(60);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.measured.size(), 1U);
}

/// A scan that was decoded before its copy to the spool hung is being measured; the buffer belongs to the measurement.
TEST(StationHang, result_of_an_early_measurement_is_discarded_and_its_buffer_is_released) {
  MemoryStore store;
  Line line{store};
  line.run_for(300);
  line.command(PlcCommand::slab_begin);
  line.run_for(60);
  line.decodes_first = true;
  line.disk_syncs = false;
  line.worker_hangs = true;
  line.scan(1);
  ASSERT_EQ(line.measured.size(), 1U);
  line.feed(kHangs);
  line.run_for(20'000);
  EXPECT_EQ(line.view().cmd_status, failed(Code::scanner_offline));
  EXPECT_EQ(line.view().stations_done, 0);
  EXPECT_EQ(line.view().record.res_seq, 0) << "nothing of it is shown";
  line.feed(kWorks);
  line.sync_ends(Code::ok);
  line.run_for(40);
  EXPECT_EQ(line.dropped.size(), 1U);
  EXPECT_FALSE(line.station->slot_busy[0] || line.station->slot_busy[1]);
}

TEST(StationHang, a_disk_that_does_not_store_the_scan_is_502_and_is_logged) {
  MemoryStore store;
  Line line{store};
  line.run_for(300);
  line.command(PlcCommand::slab_begin);
  line.run_for(60);
  line.disk_syncs = false;
  line.worker_hangs = true;
  line.scan(1);
  line.feed(kSpoolHangs);
  line.run_for(20'000);
  EXPECT_EQ(line.view().cmd_status, failed(Code::journal_write));
  EXPECT_EQ(line.view().fault, 0) << "the database is well";
  const auto said = [&](const char* what) {
    return std::any_of(line.logged.begin(), line.logged.end(),
                       [&](const std::string& text) { return text.find(what) != std::string::npos; });
  };
  EXPECT_TRUE(said("the disk of the spool"));
  EXPECT_FALSE(said("network share"));
  line.scan(2);
  line.run_for(8'000);
  EXPECT_EQ(line.view().cmd_status, failed(Code::journal_write)) << "and so is every SCAN while it hangs";
  line.feed(kWorks);
  line.worker_hangs = false;
  line.sync_ends(Code::ok);
  line.disk_syncs = true;
  line.run_for(40);
  line.scan(2);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST(StationHang, a_view_for_a_calibration_ends_too_and_its_scan_is_dropped) {
  MemoryStore store;
  Line line{store};
  line.run_for(300);
  CaptureRequest request;
  request.session = "spring";
  request.operator_name = "anna";
  request.lease_s = 300;
  request.action = CaptureRequest::Action::begin;
  line.feed(request);
  line.worker_hangs = true;
  line.scanner_answers = false;
  request.action = CaptureRequest::Action::shoot;
  line.feed(request);
  line.run_for(2'500);
  ASSERT_EQ(line.scans.size(), 1U);
  line.feed(kHangs);
  line.run_for(40'000);
  const CaptureShot& shot = line.station->capture.shot;
  EXPECT_TRUE(shot.done);
  EXPECT_EQ(shot.code, Code::scanner_offline);
  EXPECT_TRUE(line.station->slot_busy[line.scans[0].slot]);
  ScanDone late;
  late.cmd_seq = line.scans[0].request.cmd_seq;
  late.slot = line.scans[0].slot;
  late.durable = true;
  late.scan.path = line.scans[0].request.spool_path;
  line.feed(kWorks);
  line.feed(late);
  EXPECT_EQ(line.dropped.size(), 1U);
  EXPECT_FALSE(line.station->slot_busy[line.scans[0].slot]);
}

}  // namespace
}  // namespace slabd::daemon
