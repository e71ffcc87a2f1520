// SPDX-License-Identifier: Apache-2.0
//
// Measuring detects that a scan is of another exposure than the requested one (BlockMeasured::refused). Before the scan
// is acquired that ends the SCAN, with the robot still at the station; afterwards it is the block's result.
#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

struct RefusedScan : StationTest {
  /// A SCAN of this station, until the points are in the buffer and the disk is still writing.
  void scan_to_buffer(int station_no) {
    line.disk_syncs = false;
    line.scan(station_no);
    ASSERT_EQ(line.view().state, PlcState::scanning);
    ASSERT_EQ(line.measured.size(), 1U);
  }
  const FailedAttemptJob* last_failed() const {
    const FailedAttemptJob* last = nullptr;
    for (const StoreJob& job : store.applied)
      if (const auto* failed = std::get_if<FailedAttemptJob>(&job.what)) last = failed;
    return last;
  }
  bool said(const std::string& part) const {
    return std::any_of(line.logged.begin(), line.logged.end(),
                       [&](const std::string& text) { return text.find(part) != std::string::npos; });
  }
};

TEST_F(RefusedScan, fails_with_303_and_is_never_acquired) {
  begin();
  const std::uint16_t acquired_before = line.view().acq_seq;
  line.refuses = Code::frame_incomplete;
  line.fingerprint = 4711;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
  EXPECT_EQ(line.view().acq_seq, acquired_before);
  EXPECT_EQ(line.view().record.res_seq, 0) << "a failed command has no result";
  ASSERT_NE(last_failed(), nullptr);
  EXPECT_EQ(last_failed()->code, static_cast<std::uint16_t>(Code::frame_incomplete));
  EXPECT_EQ(last_failed()->attempt.station, 1);
  EXPECT_EQ(last_failed()->fingerprint, 4711U) << "the same points are refused when they come again";
  EXPECT_EQ(store.line.stations[0].phase, StationPhase::failed);
  EXPECT_TRUE(said("another exposure than the requested one"));
  line.refuses = Code::ok;
  line.fingerprint = 4713;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.view().record.verdict, Verdict::pass);
}

TEST_F(RefusedScan, fails_when_the_disk_has_it_and_not_while_the_scanner_still_writes) {
  begin();
  line.measuring_works = false;
  scan_to_buffer(1);
  line.refuses = Code::frame_incomplete;
  line.measuring_ends();
  line.run_for(200);
  EXPECT_EQ(line.view().state, PlcState::scanning);
  line.sync_ends(Code::ok);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
}

TEST_F(RefusedScan, is_waited_for_before_the_robot_may_leave) {
  begin();
  line.measuring_works = false;
  line.robot_station = 1;
  line.run_for(600);
  line.command(PlcCommand::scan, 1);
  line.run_for(300);
  ASSERT_EQ(line.measured.size(), 1U);
  EXPECT_EQ(line.view().cmd_status, 2) << "durable, not measured: not acquired yet";
  line.refuses = Code::frame_incomplete;
  line.measuring_ends();
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
}

TEST_F(RefusedScan, whose_measurement_takes_long_is_acquired_and_then_has_the_result_not_measured_303) {
  begin();
  line.measuring_works = false;
  line.scan(1);
  ASSERT_EQ(line.view().cmd_status, 3) << "acquired half a second after the exposure";
  line.refuses = Code::frame_incomplete;
  line.block_verdict = Verdict::pass;
  line.measuring_ends();
  line.run_for(20);
  const PlcResult record = line.view().record;
  EXPECT_EQ(record.station, 1);
  EXPECT_EQ(record.verdict, Verdict::not_measured);
  EXPECT_EQ(record.reason, static_cast<std::uint16_t>(Code::frame_incomplete));
  EXPECT_EQ(store.line.stations[0].block.verdict, Verdict::not_measured);
  EXPECT_TRUE(said("another exposure than the requested one"));
}

TEST_F(RefusedScan, that_is_measured_after_a_restart_has_the_result_not_measured_303) {
  begin();
  line.measuring_works = false;
  line.scan(2);
  line.measuring_works = true;
  line.refuses = Code::frame_incomplete;
  store.restart_computer();
  line.start();
  line.run_for(100);
  EXPECT_EQ(store.line.stations[1].phase, StationPhase::measured);
  EXPECT_EQ(store.line.stations[1].block.verdict, Verdict::not_measured);
  EXPECT_EQ(store.line.stations[1].block.reason, static_cast<std::uint16_t>(Code::frame_incomplete));
}

TEST_F(RefusedScan, that_was_interrupted_leaves_no_file) {
  begin();
  line.measuring_works = false;
  line.robot_station = 1;
  line.run_for(600);
  line.command(PlcCommand::scan, 1);
  line.run_for(300);
  ASSERT_EQ(line.measured.size(), 1U);
  line.plc.abort = true;
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  line.refuses = Code::frame_incomplete;
  line.measuring_ends();
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  EXPECT_EQ(line.view().record.res_seq, 0);
  EXPECT_FALSE(line.station->slot_busy[0]);
}

}  // namespace
}  // namespace slabd::daemon
