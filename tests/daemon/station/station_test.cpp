// SPDX-License-Identifier: Apache-2.0
#include "daemon/station/station.h"

#include <gtest/gtest.h>

#include <memory>

#include "hal/plc/plc_map.h"

#include "station_line.h"

namespace slabd::daemon {
namespace {

TEST_F(StationTest, takes_a_slab_from_begin_to_an_acknowledged_verdict) {
  begin();
  for (int k = 1; k <= 18; ++k) {
    line.scan(k);
    EXPECT_EQ(line.view().stations_done, k);
    const auto records = line.take_results();
    ASSERT_EQ(records.size(), 1U) << k;
    EXPECT_EQ(records[0].station, k);
    EXPECT_EQ(records[0].verdict, Verdict::pass);
    EXPECT_EQ(records[0].slab_no, 77U);
  }
  EXPECT_EQ(line.view().slab_verdict, Verdict::none);
  const std::uint16_t seq = line.command(PlcCommand::slab_end);
  line.run_for(40);
  EXPECT_EQ(line.view().cmd_ack, seq);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.view().slab_verdict, Verdict::pass);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().stations_done, 18);
  EXPECT_EQ(line.view().station_mask, 0x3FFFFU);
  const auto records = line.take_results();
  ASSERT_EQ(records.size(), 1U);
  EXPECT_EQ(records[0].kind, 2);
  EXPECT_EQ(line.view().state, PlcState::idle);
}

TEST_F(StationTest, stops_that_are_alike_are_a_warning_bit_and_stops_that_differ_are_not) {
  line.blocks_are_found = true;
  const auto warning_after_a_slab = [&] {
    begin();
    for (int k = 1; k <= 18; ++k) {
      line.scan(k);
      line.take_results();
    }
    line.command(PlcCommand::slab_end);
    line.run_for(40);
    EXPECT_EQ(line.view().slab_verdict, Verdict::pass);
    line.take_results();
    return (line.view().warn & kWarnStopsAlike) != 0;
  };
  EXPECT_TRUE(warning_after_a_slab());
  line.dither = {};
  EXPECT_FALSE(warning_after_a_slab());
}

TEST(StationOfAnotherType, slab_of_eight_pairs_ends_with_sixteen_stations) {
  MemoryStore store;
  Line line(store, short_recipe());
  line.run_for(300);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  ASSERT_TRUE(line.view().slab_open);
  EXPECT_EQ(line.view().slab_type, 4925);
  for (int k = 1; k <= 16; ++k) {
    line.scan(k);
    EXPECT_EQ(line.view().stations_done, k);
    ASSERT_EQ(line.take_results().size(), 1U) << k;
  }
  const std::uint16_t beyond = line.command(PlcCommand::scan, 17);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_ack, beyond);
  EXPECT_EQ(line.view().cmd_status, failed(Code::station_range));

  line.command(PlcCommand::slab_end);
  line.run_for(40);
  EXPECT_EQ(line.view().slab_verdict, Verdict::pass);
  EXPECT_EQ(line.view().station_mask, 0xFFFFU);
  hal::InputImage image{};
  hal::encode_outputs(line.view(), hal::WordOrder::abcd, image);
  for (std::size_t row = 0; row < 16; ++row) EXPECT_EQ(image[70 + 2 * row], 0x0101) << "pass, one attempt";
  for (std::size_t address = 102; address < 106; ++address) EXPECT_EQ(image[address], 0) << "rows 17 and 18";
  EXPECT_EQ(image[106], 1);

  // After a restart the daemon shows the same stations only.
  line.start();
  EXPECT_EQ(line.view().slab_verdict, Verdict::pass);
}

TEST_F(StationTest, robot_may_leave_only_when_cloud_and_pose_are_durable) {
  begin();
  line.run_for(600);
  const std::uint16_t seq = line.command(PlcCommand::scan, 1);
  bool stored_before = false;
  for (int i = 0; i < 300 && line.view().acq_seq != seq; ++i) {
    line.run_for(4);
    stored_before = std::any_of(store.applied.begin(), store.applied.end(),
                                [](const StoreJob& job) { return std::holds_alternative<AcquiredJob>(job.what); });
  }
  ASSERT_EQ(line.view().acq_seq, seq);
  EXPECT_TRUE(line.view().acquired);
  EXPECT_TRUE(stored_before);
}

TEST_F(StationTest, a_scanner_that_gives_an_earlier_scan_again_has_not_scanned) {
  begin();
  line.fingerprint = 4711;
  line.scan(1);
  EXPECT_EQ(line.view().stations_done, 1);
  line.scan(2);  // the scanner hangs
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
  EXPECT_EQ(line.view().stations_done, 1);
  EXPECT_EQ(line.measured.size(), 1U) << "nothing is measured ahead";
  line.decodes_first = false;  // the same if the points are reported only once durable
  line.scan(2);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
  line.fingerprint = 4713;
  line.fingerprint_thrown_away = 4715;  // perhaps of block 2, from the earlier request
  line.scan(2);
  EXPECT_EQ(line.view().stations_done, 2);
}

TEST_F(StationTest, the_checksum_of_a_scan_is_stored_with_its_attempt) {
  begin();
  line.points_crc32c = 0xFFFF'FFFEU;
  line.scan(1);
  line.points_crc32c.reset();
  line.scan(2);
  std::vector<std::optional<std::uint32_t>> stored;
  for (const StoreJob& job : store.applied)
    if (const auto* acquired = std::get_if<AcquiredJob>(&job.what)) stored.push_back(acquired->attempt.points_crc32c);
  ASSERT_EQ(stored.size(), 2U);
  EXPECT_EQ(stored[0], 0xFFFF'FFFEU);
  EXPECT_FALSE(stored[1].has_value());
}

TEST_F(StationTest, an_earlier_scan_is_refused_after_a_restart) {
  begin();
  line.fingerprint = 4711;
  line.scan(1);
  line.fingerprint = 4712;
  line.robot_moves_mm = 0.5;
  line.scan(2);  // refused, and must not count for any other block
  line.robot_moves_mm = 0.0;
  EXPECT_EQ(line.view().stations_done, 1);
  line.start();
  line.run_for(300);
  for (const std::uint64_t old : {4711U, 4712U}) {
    line.fingerprint = old;
    line.scan(2);
    EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete)) << old;
  }
  line.fingerprint = 4713;
  line.fingerprint_thrown_away = 4715;
  line.scan(2);
  EXPECT_EQ(line.view().stations_done, 2);
}

TEST_F(StationTest, an_earlier_scan_is_refused_after_a_disk_failure) {
  begin();
  line.fingerprint = 4711;
  store.fail_when = [](const StoreJob& job) {
    return std::holds_alternative<AcquiredJob>(job.what) || std::holds_alternative<FailedAttemptJob>(job.what) ||
           std::holds_alternative<SeenScanJob>(job.what);
  };
  line.scan(1);
  EXPECT_EQ(line.view().stations_done, 0);
  store.fail_when = nullptr;
  line.plc.fault_reset = true;
  line.feed(line.plc);
  line.plc.fault_reset = false;
  line.feed(line.plc);
  line.fingerprint = 4712;
  line.scan(1);
  EXPECT_EQ(line.view().stations_done, 1);
  line.start();
  line.run_for(300);
  line.fingerprint = 4711;
  line.scan(2);
  EXPECT_EQ(line.view().cmd_status, failed(Code::frame_incomplete));
  EXPECT_EQ(line.view().stations_done, 1);
}

TEST_F(StationTest, an_emulated_line_may_be_one_without_noise) {
  line.settings.simulation = true;
  line.start();
  begin();
  line.fingerprint = 4711;
  line.scan(1);
  line.scan(2);
  EXPECT_EQ(line.view().stations_done, 2);
}

// ---- emulation -----------------------------------------------------------------------------------------------------

struct EmulationTest : StationTest {
  /// STATUS bit 11 and WARN bit 13 are one.
  [[nodiscard]] bool is_shown() const {
    const PlcOutputs view = line.view();
    EXPECT_EQ(view.simulation, (view.warn & kWarnEmulation) != 0);
    return view.simulation;
  }
  void end() {
    line.command(PlcCommand::slab_end);
    line.run_for(40);
    ASSERT_FALSE(line.view().slab_open);
  }
};

TEST_F(EmulationTest, a_real_line_shows_none) {
  begin();
  line.scan(1);
  EXPECT_FALSE(is_shown());
  EXPECT_EQ(line.take_results().at(0).emulated, 0);
  end();
  EXPECT_FALSE(is_shown());
  EXPECT_EQ(store.line.slab_emulated, 0);
}

TEST_F(EmulationTest, a_stored_emulated_pass_is_not_shown_as_a_real_one_after_emulation_is_switched_off) {
  line.settings.simulation = true;
  line.start();
  begin();
  line.scan(1);
  end();
  EXPECT_TRUE(is_shown());
  line.settings.simulation = false;
  line.start();
  line.run_for(300);
  EXPECT_EQ(line.view().record.res_seq, 1) << "the station's record, not acknowledged";
  EXPECT_TRUE(is_shown());
  EXPECT_EQ(line.take_results().size(), 2U);
  EXPECT_EQ(line.view().record.res_seq, 0);
  EXPECT_EQ(line.view().table_slab_no, 77U);
  EXPECT_TRUE(is_shown()) << "the verdict stands in the table still";
  // The verdict on request has it too.
  line.command(PlcCommand::report, 0);
  line.run_for(40);
  EXPECT_EQ(line.view().record.kind, 2);
  EXPECT_EQ(line.view().record.emulated, kEmulatedLine);
  line.take_results();
  line.plc.slab_no = 78;
  begin();
  EXPECT_FALSE(is_shown()) << "a real slab is open";
}

TEST_F(EmulationTest, an_open_slab_that_began_emulated_stays_so_after_a_restart) {
  line.settings.simulation = true;
  line.start();
  begin();
  line.settings.simulation = false;
  line.start();
  line.run_for(300);
  ASSERT_TRUE(line.view().slab_open);
  EXPECT_TRUE(is_shown());
  line.fingerprint_thrown_away = 5;
  line.fingerprint = 4711;
  line.scan(1);
  EXPECT_EQ(line.take_results().at(0).emulated, kEmulatedLine);
  end();
  EXPECT_EQ(store.line.slab_emulated, kEmulatedLine);
}

TEST_F(EmulationTest, one_emulated_scan_makes_the_slab_an_emulated_one) {
  const struct {
    bool Line::*what;
    unsigned bit;
  } causes[] = {{&Line::robot_emulated, kEmulatedRobot},
                {&Line::robot_commanded, kCommandedPoses},
                {&Line::scan_emulated, kEmulatedScan}};
  std::uint32_t slab_no = 100;
  for (const auto& [what, bit] : causes) {
    line.plc.slab_no = slab_no++;
    begin();
    line.scan(1);
    EXPECT_FALSE(is_shown()) << bit;
    line.*what = true;
    line.scan(2);
    EXPECT_TRUE(is_shown()) << bit;
    EXPECT_EQ(store.line.stations[0].attempt.emulated, 0);
    EXPECT_EQ(store.line.stations[1].attempt.emulated, bit);
    line.*what = false;
    line.scan(2);
    EXPECT_EQ(store.line.stations[1].attempt.emulated, 0);
    EXPECT_TRUE(is_shown()) << "an earlier attempt was emulated";
    end();
    EXPECT_EQ(line.take_results().back().emulated, bit);
    line.start();
    EXPECT_TRUE(is_shown()) << bit;
    line.run_for(300);
  }
}

TEST_F(EmulationTest, a_robot_that_declares_itself_is_shown_before_any_slab) {
  line.robot_emulated = true;
  line.run_for(40);
  EXPECT_TRUE(is_shown());
  line.robot_emulated = false;
  line.run_for(40);
  EXPECT_FALSE(is_shown());
}

TEST_F(StationTest, next_scan_may_begin_while_the_last_one_is_measured) {
  begin();
  line.measuring_works = false;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 3);
  EXPECT_FALSE(line.view().busy);
  line.scan(2);
  EXPECT_EQ(line.view().cmd_status, 3);
  EXPECT_EQ(line.measured.size(), 2U);
  EXPECT_NE(line.measured[0].slot, line.measured[1].slot);
  // Both buffers contain unmeasured blocks: the third scan waits until its deadline.
  line.scan(3);
  line.run_for(9000);
  EXPECT_EQ(line.view().cmd_status, failed(Code::deadline));
}

TEST_F(StationTest, a_block_is_measured_while_its_scan_is_stored_and_shown_when_it_is_durable) {
  begin();
  line.disk_syncs = false;
  line.scan(1);
  ASSERT_EQ(line.measured.size(), 1U);
  EXPECT_EQ(line.measured[0].id.cmd_seq, line.plc.cmd_seq);
  EXPECT_EQ(line.measured[0].shape.finite, 900U);
  EXPECT_EQ(line.view().state, PlcState::scanning);
  EXPECT_NE(line.view().acq_seq, line.plc.cmd_seq);
  EXPECT_FALSE(line.view().result);
  EXPECT_EQ(line.view().table[0].verdict, Verdict::none);
  for (const StoreJob& job : store.applied) EXPECT_FALSE(std::holds_alternative<BlockJob>(job.what));

  line.sync_ends(Code::ok);
  line.run_for(40);
  EXPECT_EQ(line.view().acq_seq, line.plc.cmd_seq);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.measured.size(), 1U);
  const auto records = line.take_results();
  ASSERT_EQ(records.size(), 1U);
  EXPECT_EQ(records[0].verdict, Verdict::pass);
  EXPECT_EQ(records[0].cmd_seq, line.plc.cmd_seq);
}

TEST_F(StationTest, measurement_of_a_scan_that_was_not_stored_is_dropped) {
  begin();
  for (const bool measured_in_time : {true, false}) {
    line.disk_syncs = false;
    line.measuring_works = measured_in_time;
    const std::size_t measurements = line.measured.size();
    line.scan(3);
    ASSERT_EQ(line.measured.size(), measurements + 1);
    const MeasureBlock in_hand = line.measured.back();
    line.sync_ends(Code::store_full);
    line.run_for(40);
    EXPECT_EQ(line.view().cmd_status, failed(Code::store_full));
    EXPECT_EQ(line.view().table[2].reason, 501);

    // The next attempt is another scan; the late answer to the first one is not its result.
    line.disk_syncs = true;
    line.measuring_works = true;
    line.block_verdict = Verdict::fail;
    if (!measured_in_time) {
      BlockMeasured late;
      late.id = in_hand.id;
      late.slot = in_hand.slot;
      late.block.station = 3;
      late.block.verdict = Verdict::pass;
      line.command(PlcCommand::scan, 3);
      line.run_for(500);
      line.feed(late);
      line.run_for(500);
    } else {
      line.scan(3);
    }
    EXPECT_EQ(line.view().cmd_status, 4);
    EXPECT_EQ(line.view().table[2].verdict, Verdict::fail);
    const auto records = line.take_results();
    ASSERT_EQ(records.size(), 1U);
    EXPECT_EQ(records[0].verdict, Verdict::fail);
    line.block_verdict = Verdict::pass;
  }
  // Both buffers are free again: two more scans can be taken at once.
  line.measuring_works = false;
  line.scan(4);
  line.scan(5);
  EXPECT_EQ(line.view().station_mask, 0b11100U);
}

TEST_F(StationTest, aborting_a_scan_on_its_way_to_the_disk_drops_what_was_measured_of_it) {
  begin();
  line.disk_syncs = false;
  line.scan(1);
  ASSERT_EQ(line.measured.size(), 1U);
  line.plc.abort = true;
  line.feed(line.plc);
  line.run_for(40);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  EXPECT_EQ(line.view().table[0].verdict, Verdict::not_measured);
  EXPECT_FALSE(line.view().result);
}

TEST_F(StationTest, a_robot_that_moved_during_the_scan_is_not_measured_ahead) {
  begin();
  line.robot_moves_mm = 1.0;
  line.disk_syncs = false;
  line.scan(1);
  EXPECT_TRUE(line.measured.empty());
  line.sync_ends(Code::ok);
  line.run_for(40);
  EXPECT_EQ(line.view().cmd_status, failed(Code::moved_during_scan));
  EXPECT_TRUE(line.measured.empty());
}

TEST_F(StationTest, measuring_begins_with_the_durable_scan_if_its_points_were_not_announced_before) {
  begin();
  line.decodes_first = false;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  ASSERT_EQ(line.measured.size(), 1U);
  EXPECT_FALSE(line.measured[0].reload);
  EXPECT_EQ(line.take_results().size(), 1U);
}

TEST_F(StationTest, a_result_that_could_not_be_stored_is_not_shown) {
  begin();
  line.run_for(600);
  line.command(PlcCommand::scan, 1);
  for (int i = 0; i < 400; ++i) {
    line.run_for(4);
    if (!store.applied.empty() && std::holds_alternative<AcquiredJob>(store.applied.back().what)) break;
  }
  store.fail_next = Code::journal_write;  // the block's own commit
  line.run_for(100);
  EXPECT_EQ(line.view().fault, 502);
  EXPECT_EQ(line.view().record.res_seq, 0);
  EXPECT_EQ(line.view().table[0].verdict, Verdict::none);
  // The cloud is durable: after the fault is reset the block is measured again, from the disk.
  line.plc.fault_reset = true;
  line.feed(line.plc);
  line.run_for(100);
  EXPECT_EQ(line.view().fault, 0);
  ASSERT_EQ(line.measured.size(), 2U);
  EXPECT_TRUE(line.measured[1].reload);
  EXPECT_EQ(line.take_results().size(), 1U);
}

TEST_F(StationTest, a_robot_that_no_longer_sends_stopped_is_logged) {
  begin();
  line.robot_says_stopped = true;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  const auto told = [&] {
    return std::any_of(line.logged.begin(), line.logged.end(), [](const std::string& text) {
      return text.find("the robot set the stopped flag") != std::string::npos;
    });
  };
  line.robot_says_stopped = false;
  line.scan(2);
  line.run_for(12'000);
  EXPECT_EQ(line.view().cmd_status, failed(Code::not_settled));
  EXPECT_TRUE(told());
  line.logged.clear();
  line.robot_present = false;
  line.run_for(1'100);
  line.robot_present = true;
  line.scan(2);
  EXPECT_EQ(line.view().cmd_status, 4) << "another bridge, which does not know the flag";
  EXPECT_FALSE(told());
}

TEST_F(StationTest, each_way_a_scan_can_fail_has_its_code_and_the_slab_continues) {
  begin();
  const auto expect_failed = [&](Code code) {
    line.scan(1);
    line.run_for(12'000);
    EXPECT_EQ(line.view().cmd_status, failed(code));
    EXPECT_EQ(line.view().table[0].verdict, Verdict::not_measured);
    EXPECT_EQ(line.view().table[0].reason, static_cast<std::uint16_t>(code));
    EXPECT_EQ(line.view().station_mask, 0U);
    EXPECT_FALSE(line.view().busy);
  };
  line.robot_present = false;
  expect_failed(Code::pose_stale);
  line.robot_present = true;
  line.robot_shakes = true;
  expect_failed(Code::not_settled);
  line.robot_shakes = false;
  line.robot_off_mm = 200.0;
  expect_failed(Code::outside_window);
  line.robot_off_mm = 0.0;
  line.robot_moves_mm = 0.2;
  expect_failed(Code::moved_during_scan);
  line.robot_moves_mm = 0.0;
  line.scan_code = Code::trigger_timeout;
  expect_failed(Code::trigger_timeout);
  line.scan_code = Code::frame_incomplete;
  expect_failed(Code::frame_incomplete);
  line.scan_code = Code::ok;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.view().table[0].verdict, Verdict::pass);
  EXPECT_EQ(line.view().table[0].attempts, 2)
      << "the scanner was not asked, did not answer, or was to be cleared first";
}

TEST_F(StationTest, a_failed_second_scan_takes_the_first_ones_pass_away) {
  begin();
  line.scan(1);
  ASSERT_EQ(line.view().table[0].verdict, Verdict::pass);
  line.scan_code = Code::frame_incomplete;
  line.scan(1);
  EXPECT_EQ(line.view().table[0].verdict, Verdict::not_measured);
  EXPECT_EQ(line.view().table[0].attempts, 2);
}

TEST_F(StationTest, a_slab_with_a_block_missing_never_passes) {
  begin();
  for (int k = 1; k <= 17; ++k) {
    line.scan(k);
    line.take_results();
  }
  line.command(PlcCommand::slab_end);
  line.run_for(40);
  EXPECT_EQ(line.view().slab_verdict, Verdict::not_measured);
}

TEST_F(StationTest, slab_end_waits_for_the_block_being_measured) {
  begin();
  line.measuring_works = false;
  line.scan(1);
  line.command(PlcCommand::slab_end);
  line.run_for(500);
  EXPECT_TRUE(line.view().slab_open);
  EXPECT_EQ(line.view().slab_verdict, Verdict::none);
  const MeasureBlock asked = line.measured.back();
  BlockMeasured done;
  done.id = asked.id;
  done.slot = asked.slot;
  done.block.station = asked.id.station;
  done.block.verdict = Verdict::fail;
  line.feed(done);
  line.run_for(40);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().slab_verdict, Verdict::fail);
}

TEST_F(StationTest, abort_ends_the_current_scan_and_keeps_the_slab) {
  begin();
  line.scanner_answers = false;
  line.scan(1);
  ASSERT_EQ(line.view().state, PlcState::scanning);
  line.plc.abort = true;
  line.feed(line.plc);
  line.run_for(40);
  EXPECT_EQ(line.cancelled, 1);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  EXPECT_TRUE(line.view().slab_open);
  line.plc.abort = false;
  line.scanner_answers = true;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationTest, a_scan_in_another_buffer_than_the_assigned_one_is_ignored) {
  begin();
  line.scanner_answers = false;
  line.scan(1);
  ASSERT_EQ(line.view().state, PlcState::scanning);
  const AcquireScan& asked = line.scans.back();
  ScanDone done;
  done.cmd_seq = asked.request.cmd_seq;
  done.slot = static_cast<std::uint8_t>(1 - asked.slot);
  done.durable = true;
  done.scan.path = asked.request.spool_path;
  done.scan.shape = {1000, 900, 0, 0};
  line.feed(done);
  line.run_for(40);
  EXPECT_EQ(line.view().state, PlcState::scanning) << "still waiting for its own";
  EXPECT_TRUE(line.measured.empty());
  done.slot = asked.slot;
  line.feed(done);
  line.run_for(40);
  EXPECT_EQ(line.measured.size(), 1U);
}

// A block's pass is provisional: only SLAB_END judges height, spacing and slope in the slab's frame.
TEST_F(StationTest, slab_abort_reads_aborted_and_no_block_of_it_passed) {
  begin();
  line.scan(1);
  line.block_verdict = Verdict::fail;
  line.scan(2);
  line.take_results();
  EXPECT_EQ(line.view().table[0].verdict, Verdict::pass);
  line.command(PlcCommand::slab_abort);
  line.run_for(60);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().table[0].verdict, Verdict::none);
  EXPECT_EQ(line.view().table[0].attempts, 1) << "it was scanned";
  EXPECT_EQ(line.view().table[1].verdict, Verdict::fail) << "what it has against it stays";
}

TEST_F(StationTest, restart_keeps_acquired_blocks_and_shows_unacknowledged_results_again) {
  begin();
  line.scan(1);  // measured, not acknowledged
  const std::uint16_t res_seq = line.view().record.res_seq;
  ASSERT_NE(res_seq, 0);
  line.measuring_works = false;
  line.scan(2);  // acquired, not measured
  line.scanner_answers = false;
  line.scan(3);  // accepted, not acquired
  const std::uint16_t session = line.view().session;
  const std::uint16_t ack = line.view().cmd_ack;

  line.measuring_works = true;
  line.scanner_answers = true;
  line.measured.clear();
  const std::size_t scans = line.scans.size();
  line.plc = {};
  store.restart_computer();
  line.start();
  line.run_for(100);
  EXPECT_NE(line.view().session, session);
  EXPECT_EQ(line.view().cmd_ack, ack);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  EXPECT_TRUE(line.view().slab_open);
  EXPECT_EQ(line.view().station_mask, 0b011U);
  EXPECT_EQ(line.view().record.res_seq, res_seq);
  ASSERT_EQ(line.measured.size(), 1U);
  EXPECT_TRUE(line.measured[0].reload);
  EXPECT_EQ(line.measured[0].id.station, 2);
  EXPECT_EQ(line.scans.size(), scans);  // slabd does not repeat a scan on its own initiative
  EXPECT_EQ(line.view().table[2].verdict, Verdict::not_measured);
  EXPECT_EQ(line.view().table[2].reason, 110);

  line.run_for(300);
  line.scan(3);
  EXPECT_EQ(line.view().cmd_status, 4);
  const auto records = line.take_results();
  EXPECT_EQ(records.size(), 3U);
}

TEST_F(StationTest, an_open_slab_of_a_recipe_that_changed_can_only_be_aborted) {
  begin();
  line.recipe.sha256 = "changed";
  line.plc = {};
  line.start();
  line.run_for(300);
  line.command(PlcCommand::scan, 1);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::unknown_type));
  line.command(PlcCommand::slab_end);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::unknown_type));
  line.command(PlcCommand::slab_abort);
  line.run_for(40);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
}

TEST_F(StationTest, abort_counts_while_the_scan_is_on_its_way_to_the_journal_and_while_it_is_held) {
  begin();
  line.run_for(600);
  line.command(PlcCommand::scan, 1);
  line.plc.abort = true;
  line.feed(line.plc);  // before the journal has answered
  line.plc.abort = false;
  line.feed(line.plc);
  line.run_for(40);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  line.plc.abort = true;
  line.feed(line.plc);
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, failed(Code::interrupted));
  EXPECT_TRUE(line.scans.empty());
}

TEST_F(StationTest, a_scan_that_comes_before_the_robot_has_left_waits_for_it) {
  begin();
  line.scan(1);
  line.take_results();
  line.command(PlcCommand::scan, 2);  // the robot is still at station 1
  line.run_for(400);
  EXPECT_EQ(line.view().state, PlcState::settling);
  line.robot_station = 2;
  line.run_for(1000);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.scans.back().request.station, 2);
}

TEST_F(StationTest, a_config_fault_shows_itself_and_refuses_work) {
  line.settings.fault = Code::config;
  line.plc = {};
  line.start();
  line.run_for(300);
  EXPECT_EQ(line.view().state, PlcState::fault);
  EXPECT_EQ(line.view().fault, 504);
  EXPECT_FALSE(line.view().ready);
  // The content of the database is unknown, so missing calibration and acceptance are not reported.
  EXPECT_EQ(line.view().warn, 0);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::config));
}

TEST_F(StationTest, without_its_database_no_command_says_that_no_slab_is_open) {
  line.station = std::make_unique<Station>(line.settings);
  line.feed(NotRecovered{Code::journal_write});
  line.run_for(300);
  for (const PlcCommand command :
       {PlcCommand::slab_begin, PlcCommand::scan, PlcCommand::slab_end, PlcCommand::slab_abort, PlcCommand::report}) {
    line.command(command);
    line.run_for(20);
    EXPECT_EQ(line.view().cmd_status, failed(Code::journal_write)) << static_cast<int>(command);
  }
}

TEST_F(StationTest, a_full_disk_refuses_the_slab_before_it_begins) {
  line.run_for(300);
  store.fail_next = Code::store_full;
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::store_full));
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().fault, 0);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_TRUE(line.view().slab_open);
}

}  // namespace
}  // namespace slabd::daemon
