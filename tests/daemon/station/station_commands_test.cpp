// SPDX-License-Identifier: Apache-2.0
//
// The command interface and the queue of results: refusals, counting, and the meaning of acknowledgements.
#include <gtest/gtest.h>

#include "daemon/station/station.h"
#include "hal/plc/plc_map.h"

#include "station_line.h"

namespace slabd::daemon {
namespace {

TEST_F(StationTest, a_repeated_command_block_is_ignored) {
  begin();
  line.scan(1);
  const std::size_t scans = line.scans.size();
  for (int i = 0; i < 5; ++i) line.feed(line.plc);
  line.run_for(1000);
  EXPECT_EQ(line.scans.size(), scans);
  EXPECT_EQ(line.view().refused, 0);
}

TEST_F(StationTest, refuses_a_number_that_is_not_the_successor) {
  begin();
  const std::uint16_t ack = line.view().cmd_ack;
  line.plc.command = 2;
  line.plc.station = 1;
  line.plc.cmd_seq = static_cast<std::uint16_t>(ack + 2);
  line.feed(line.plc);
  EXPECT_EQ(line.view().cmd_ack, ack);
  EXPECT_EQ(line.view().refuse_code, 111);
  EXPECT_EQ(line.view().refuse_seq, ack + 2);
}

TEST_F(StationTest, refuses_a_stale_session_without_using_the_number_up) {
  begin();
  const std::uint16_t ack = line.view().cmd_ack;
  line.plc.command = 2;
  line.plc.station = 1;
  line.plc.cmd_seq = static_cast<std::uint16_t>(ack + 1);
  line.plc.session_echo = static_cast<std::uint16_t>(line.view().session - 1);
  line.feed(line.plc);
  EXPECT_EQ(line.view().cmd_ack, ack);
  EXPECT_EQ(line.view().refuse_code, 102);
  // The same number with the right session is accepted.
  line.plc.session_echo = line.view().session;
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_ack, ack + 1);
}

TEST_F(StationTest, session_changes_on_sync_takeover_and_heartbeat_return) {
  begin();
  std::uint16_t session = line.view().session;
  const auto changed = [&] {
    line.run_for(20);
    const bool yes = line.view().session != session;
    session = line.view().session;
    return yes;
  };
  line.plc.sync_req = 5;
  line.feed(line.plc);
  EXPECT_TRUE(changed());
  line.plc.command_writer = 2;
  line.feed(line.plc);
  EXPECT_FALSE(changed()) << "another connection that repeats the block takes nothing over";
  line.command(PlcCommand::scan, 1);
  EXPECT_TRUE(changed());
  line.plc_beats = false;
  line.run_for(3000);
  EXPECT_FALSE(line.view().plc_link_ok);
  line.command(PlcCommand::scan, 1);
  EXPECT_EQ(line.view().cmd_status, failed(Code::not_enabled));
  line.plc_beats = true;
  line.run_for(300);
  EXPECT_TRUE(changed());
  EXPECT_FALSE(changed());
}

TEST_F(StationTest, first_block_of_a_new_connection_is_refused_once) {
  begin();
  line.plc.command_writer = 9;
  const std::uint16_t seq = line.command(PlcCommand::scan, 1);
  EXPECT_EQ(line.view().refuse_code, 102);
  line.run_for(20);
  EXPECT_EQ(line.command(PlcCommand::scan, 1), seq);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_ack, seq);
}

TEST_F(StationTest, content_refusals_use_the_number_up_and_state_the_reason) {
  line.run_for(300);
  const auto refused = [&](Code code) {
    line.run_for(20);
    EXPECT_EQ(line.view().cmd_ack, line.plc.cmd_seq);
    EXPECT_EQ(line.view().cmd_status, failed(code));
    EXPECT_EQ(line.view().refuse_code, static_cast<std::uint16_t>(code));
  };
  line.command(PlcCommand::scan, 1);
  refused(Code::wrong_slab);
  line.command(static_cast<PlcCommand>(9));
  refused(Code::unknown_command);
  line.plc.crc_ok = false;
  line.command(PlcCommand::slab_begin);
  refused(Code::bad_crc);
  line.plc.crc_ok = true;
  line.plc.session_echo = static_cast<std::uint16_t>(line.view().session << 8U);  // the bytes of the block are swapped
  line.plc.cmd_seq = static_cast<std::uint16_t>(line.plc.cmd_seq << 8U);
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_EQ(line.view().refuse_code, 109) << "neither an old session nor a wrong number";
  line.plc.session_echo = line.view().session;
  line.plc.cmd_seq = line.view().cmd_ack;
  line.plc.slab_id[0] = '\x01';
  line.command(PlcCommand::slab_begin);
  refused(Code::bad_id_text);
  line.plc.slab_id[0] = 'A';
  line.recipe.slab_type = 4925;
  line.command(PlcCommand::slab_begin);
  refused(Code::unknown_type);
  line.recipe.slab_type = 5600;
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  ASSERT_TRUE(line.view().slab_open);
  line.command(PlcCommand::scan, 19);
  refused(Code::station_range);
  line.command(PlcCommand::scan, 0);
  refused(Code::station_range);
  line.plc.slab_no = 78;
  line.command(PlcCommand::scan, 1);
  refused(Code::wrong_slab);
  line.plc.slab_no = 77;
  line.command(PlcCommand::slab_begin);
  refused(Code::wrong_slab);
}

class StationIdTest : public StationTest {
 protected:
  static IdPattern pattern(const char* expression) {
    const Result<IdPattern> compiled = IdPattern::compile(expression);
    EXPECT_TRUE(compiled.ok()) << expression;
    return compiled.value();
  }
  void SetUp() override {
    line.settings.id_pattern = &id_;
    line.settings.mould_from_id = &mould_;
    line.plc = {};
    line.start();
    line.run_for(300);
  }
  /// CMD_STATUS of SLAB_BEGIN with this id and MOULD; an opened slab is aborted again.
  std::uint16_t begin_with(std::string_view id, std::uint16_t mould) {
    line.plc.slab_id.fill('\0');
    std::copy(id.begin(), id.end(), line.plc.slab_id.begin());
    line.plc.mould = mould;
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    const std::uint16_t status = line.view().cmd_status;
    EXPECT_EQ(line.view().slab_open, status == 4);
    if (!line.view().slab_open) return status;
    opened_ = line.station->slab.header.mould;
    line.command(PlcCommand::slab_abort);
    line.run_for(60);
    line.take_results();
    return status;
  }

  const IdPattern id_ = pattern("C3-\\d{4}(?:-M\\w+)?");
  const IdPattern mould_ = pattern("-M(\\w+)$");
  int opened_ = -1;  ///< mould of the last slab that was opened
};

TEST_F(StationIdTest, an_id_of_another_form_is_refused) {
  EXPECT_EQ(begin_with("C3-0001", 0), 4);
  for (const char* id : {"", "C3-001", "c3-0001", "C3-0001-", "XC3-0001", "C3-0001 "})
    EXPECT_EQ(begin_with(id, 0), failed(Code::bad_id_text)) << id;
  EXPECT_EQ(line.view().refuse_code, 108);
}

TEST_F(StationIdTest, the_mould_comes_from_the_id_or_from_the_plc_and_both_must_agree) {
  const auto opened = [&](std::string_view id, std::uint16_t mould) {
    opened_ = -1;
    EXPECT_EQ(begin_with(id, mould), 4) << id;
    return opened_;
  };
  EXPECT_EQ(opened("C3-0001-M012", 0), 12) << "the PLC does not send it";
  EXPECT_EQ(opened("C3-0001", 7), 7) << "the id does not name it";
  EXPECT_EQ(opened("C3-0001-M12", 12), 12);
  EXPECT_EQ(opened("C3-0001", 0), 0) << "unknown";
  EXPECT_EQ(opened("C3-0001-M0", 7), 7) << "0 is unknown";
  EXPECT_EQ(opened("C3-0001-M65535", 0), 65535);
  EXPECT_EQ(begin_with("C3-0001-M12", 13), failed(Code::unknown_mould));
  EXPECT_EQ(line.view().refuse_code, 113);
  EXPECT_EQ(begin_with("C3-0001-M65536", 0), failed(Code::unknown_mould));
  EXPECT_EQ(begin_with("C3-0001-M1a", 0), failed(Code::unknown_mould));
  EXPECT_EQ(begin_with("C3-0001-M1a", 1), failed(Code::unknown_mould));
}

TEST_F(StationIdTest, two_chips_with_different_ids_are_refused) {
  line.plc.second_chip = 0x1234;
  EXPECT_EQ(begin_with("C3-0001", 0), 4);
  line.plc.chips_agree = false;
  EXPECT_EQ(begin_with("C3-0001", 0), failed(Code::bad_id_text));
  line.plc.chips_agree = true;
  line.plc.second_chip = 0;
  EXPECT_EQ(begin_with("C3-0001", 0), 4) << "not read";
  line.settings.second_chip_required = true;
  line.start();
  line.run_for(300);
  EXPECT_EQ(begin_with("C3-0001", 0), failed(Code::bad_id_text)) << "not read";
  line.plc.second_chip = 0x1234;
  EXPECT_EQ(begin_with("C3-0001", 0), 4);
}

TEST_F(StationTest, without_patterns_any_printable_id_is_taken_and_the_mould_is_the_plcs) {
  line.plc.mould = 12;
  begin();
  EXPECT_EQ(line.station->slab.header.mould, 12);
  EXPECT_EQ(store.line.slab.mould, 12) << "it is stored with the slab";
  line.plc.mould = 13;  // MOULD of another command has no effect
  line.scan(1);
  EXPECT_EQ(line.station->slab.header.mould, 12);
}

TEST_F(StationTest, a_temperature_that_no_slab_has_is_named_and_counts_as_unknown) {
  const auto named = [&](std::uint16_t temperature_dk) {
    line.plc.slab_temperature_dk = temperature_dk;
    line.logged.clear();
    begin();
    EXPECT_EQ(line.station->slab.header.temperature_dk, temperature_dk) << "stored as it was sent";
    const bool found = std::any_of(line.logged.begin(), line.logged.end(), [](const std::string& text) {
      return text.find("SLAB_TEMPERATURE (HR 32) is ") != std::string::npos;
    });
    line.command(PlcCommand::slab_abort);
    line.run_for(60);
    line.take_results();
    return found;
  };
  EXPECT_FALSE(named(0)) << "unknown";
  EXPECT_FALSE(named(2'932)) << "20 deg C";
  EXPECT_FALSE(named(2'432)) << "-29.95 deg C";
  EXPECT_TRUE(named(2'431)) << "-30.05 deg C";
  EXPECT_FALSE(named(3'531)) << "79.95 deg C";
  EXPECT_TRUE(named(3'532)) << "80.05 deg C";
  EXPECT_TRUE(named(250)) << "25 deg C in 0.1 deg C";
}

TEST_F(StationTest, a_plc_that_never_acknowledges_fills_the_queue_and_nothing_is_lost) {
  begin();
  int accepted = 0;
  for (int i = 0; i < 80; ++i) {
    line.scan(1 + i % 18);
    if (line.view().cmd_status != 4) break;
    ++accepted;
  }
  EXPECT_EQ(line.view().cmd_status, failed(Code::busy));
  EXPECT_EQ(line.take_results().size(), static_cast<std::size_t>(accepted));
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationTest, a_full_queue_refuses_everything_that_would_need_a_place_in_it) {
  begin();
  for (int i = 0; line.view().results_pending + 2U <= limits::kResultQueueMax && i < 100; ++i) {
    line.scan(1 + i % 18);
    if (line.view().cmd_status != 4) break;
  }
  // The slab's own record keeps its place; further records do not fit.
  line.command(PlcCommand::report, 1);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_status, failed(Code::busy));
  line.command(PlcCommand::slab_end);
  line.run_for(60);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.view().results_pending, limits::kResultQueueMax);
  for (const PlcCommand what : {PlcCommand::slab_begin, PlcCommand::report}) {
    line.command(what);
    line.run_for(20);
    EXPECT_EQ(line.view().cmd_status, failed(Code::busy));
  }
  EXPECT_EQ(line.take_results().size(), limits::kResultQueueMax);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_TRUE(line.view().slab_open);
}

TEST_F(StationTest, a_flood_of_session_changes_is_one_change_at_a_time) {
  begin();
  const std::size_t before = store.applied.size();
  for (int i = 0; i < 1000; ++i) {
    ++line.plc.sync_req;
    line.feed(line.plc);
  }
  EXPECT_EQ(store.applied.size(), before + 1);
  line.run_for(20);
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationTest, a_result_carries_the_number_of_the_scan_it_was_measured_from) {
  begin();
  line.measuring_works = false;
  line.scan(1);
  line.scan(2);
  const std::uint16_t first_seq = line.measured.at(1).id.cmd_seq;
  line.measuring_works = true;
  line.plc = {};
  line.start();  // both clouds are durable and not measured
  line.run_for(4);
  line.command(PlcCommand::scan, 2);  // while they are measured again
  line.run_for(2000);
  line.scan(2);
  int of_first = 0;
  for (const PlcResult& record : line.take_results()) of_first += record.cmd_seq == first_seq ? 1 : 0;
  EXPECT_LE(of_first, 1);
  std::map<std::uint16_t, int> seen;
  for (const StoreJob& job : store.applied)
    if (const auto* block = std::get_if<BlockJob>(&job.what)) ++seen[block->record.cmd_seq];
  for (const auto& [seq, count] : seen) EXPECT_EQ(count, 1) << "CMD_SEQ " << seq;
}

TEST_F(StationTest, report_shows_a_record_again_under_a_new_number) {
  begin();
  line.scan(4);
  const PlcResult first = line.take_results().at(0);
  line.command(PlcCommand::report, 4);
  line.run_for(20);
  const auto again = line.take_results();
  ASSERT_EQ(again.size(), 1U);
  EXPECT_EQ(again[0].station, 4);
  EXPECT_EQ(again[0].cmd_seq, first.cmd_seq);
  EXPECT_NE(again[0].res_seq, first.res_seq);
}

TEST_F(StationTest, counter_wraps_past_65535_without_using_zero) {
  store.line.cmd_ack = 0xFFFF;
  line.plc = {};
  line.start();
  line.run_for(300);
  EXPECT_EQ(line.command(PlcCommand::slab_begin), 1);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_ack, 1);
  EXPECT_TRUE(line.view().slab_open);
}

// RES_ACK is a level. Its value before a record is shown does not refer to that record.
TEST_F(StationTest, a_record_never_gets_the_number_that_res_ack_holds) {
  begin();
  line.plc.res_ack = 1;  // a database was restored, or the PLC counts ahead
  line.feed(line.plc);
  line.scan(1);
  ASSERT_TRUE(line.view().result);
  EXPECT_EQ(line.view().record.res_seq, 2);
  line.run_for(1000);
  EXPECT_TRUE(line.view().result) << "it was not read yet";
  EXPECT_EQ(line.take_results().size(), 1U);
}

TEST_F(StationTest, a_res_ack_that_came_before_its_record_was_shown_does_not_take_it_away) {
  begin();
  line.robot_station = 1;
  line.run_for(600);
  line.command(PlcCommand::scan, 1);
  const auto stored_block = [&] {
    return !store.applied.empty() && std::holds_alternative<BlockJob>(store.applied.back().what);
  };
  for (int i = 0; i < 500 && !stored_block(); ++i) line.run_for(4);
  ASSERT_TRUE(stored_block());
  ASSERT_FALSE(line.view().result) << "numbered and on its way to the disk";
  const std::uint16_t number = std::get<BlockJob>(store.applied.back().what).record.res_seq;
  line.plc.res_ack = number;
  line.feed(line.plc);
  line.run_for(1000);
  ASSERT_TRUE(line.view().result);
  EXPECT_EQ(line.view().record.res_seq, number);
  line.plc.res_ack = 0;
  line.feed(line.plc);
  EXPECT_EQ(line.take_results().size(), 1U);
}

TEST_F(StationTest, a_record_shown_again_after_a_restart_is_acknowledged_by_the_value_of_res_ack) {
  begin();
  line.scan(1);
  ASSERT_EQ(line.view().record.res_seq, 1);
  line.start();
  ASSERT_EQ(line.view().record.res_seq, 1);
  line.plc.res_ack = 1;
  line.feed(line.plc);
  line.start();
  EXPECT_FALSE(line.view().result);
}

TEST_F(StationTest, a_number_that_came_too_early_is_taken_when_it_is_written_again) {
  begin();
  line.run_for(600);
  const std::uint16_t ack = line.view().cmd_ack;
  line.command(PlcCommand::scan, 1);  // on its way to the journal
  ++line.plc.command_writes;
  line.plc.station = 2;
  line.plc.cmd_seq = static_cast<std::uint16_t>(ack + 2);
  line.feed(line.plc);
  EXPECT_EQ(line.view().refuse_code, 111);
  line.run_for(1500);
  EXPECT_EQ(line.view().cmd_ack, ack + 1) << "refused, and not written again since";
  EXPECT_EQ(line.view().cmd_status, 4);
  ++line.plc.command_writes;
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_ack, ack + 2);
}

TEST_F(StationTest, another_order_under_a_number_that_is_taken_is_refused_and_not_silently_dropped) {
  begin();
  line.scan(1);
  const PlcOutputs before = line.view();
  PlcInputs other = line.plc;
  other.command_writer = 2;
  other.station = 5;
  line.feed(other);
  EXPECT_EQ(line.view().refused, before.refused + 1);
  EXPECT_EQ(line.view().refuse_code, 111);
  EXPECT_EQ(line.view().refuse_seq, other.cmd_seq);
  EXPECT_EQ(line.view().cmd_ack, before.cmd_ack);
  EXPECT_EQ(line.scans.size(), 1U);
}

TEST_F(StationTest, a_late_copy_of_a_command_is_counted_and_ignored) {
  begin();
  line.scan(1);
  const PlcOutputs before = line.view();
  PlcInputs late = line.plc;
  late.session_echo = static_cast<std::uint16_t>(late.session_echo - 1U);
  line.feed(late);
  EXPECT_EQ(line.view().refused, before.refused + 1);
  EXPECT_EQ(line.view().refuse_code, before.refuse_code);
  EXPECT_EQ(line.view().cmd_status, before.cmd_status);
  EXPECT_EQ(line.view().session, before.session);
  EXPECT_EQ(line.scans.size(), 1U);
}

}  // namespace
}  // namespace slabd::daemon
