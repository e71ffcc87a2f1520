// SPDX-License-Identifier: Apache-2.0
//
// Every job that can fail in storage, every command that can come at the wrong moment, and events before the start.
// Only durable data are shown, refusals have a code, and afterwards the line continues.
#include <gtest/gtest.h>

#include "daemon/station/station.h"

#include "station_line.h"

namespace slabd::daemon {
namespace {

struct StationRefusals : StationTest {
  static constexpr std::uint16_t kJournalWrite = 502;

  void reset_fault() {
    line.plc.fault_reset = true;
    line.feed(line.plc);
    line.plc.fault_reset = false;
    line.feed(line.plc);
    line.run_for(100);
    EXPECT_EQ(line.view().fault, 0);
  }
  void expect_fault() {
    EXPECT_EQ(line.view().fault, kJournalWrite);
    EXPECT_EQ(line.view().state, PlcState::fault);
    EXPECT_FALSE(line.view().ready);
    EXPECT_FALSE(line.view().store_ok);
  }
  void refused(Code code) {
    line.run_for(20);
    EXPECT_EQ(line.view().cmd_ack, line.plc.cmd_seq);
    EXPECT_EQ(line.view().cmd_status, failed(code)) << "command " << line.plc.command;
  }
  /// The late answer to a measurement.
  BlockMeasured answer_to(const MeasureBlock& asked) {
    BlockMeasured done;
    done.id = asked.id;
    done.slot = asked.slot;
    done.block.station = asked.id.station;
    done.block.verdict = Verdict::pass;
    return done;
  }
  bool all_buffers_are_free() const {
    return std::none_of(line.station->slot_busy.begin(), line.station->slot_busy.end(), [](bool b) { return b; });
  }
};

// ---- storage fails ----

TEST_F(StationRefusals, a_session_that_could_not_be_stored_is_never_shown) {
  begin();
  const std::uint16_t session = line.view().session;
  store.fail_next = Code::journal_write;
  ++line.plc.sync_req;
  line.feed(line.plc);
  line.run_for(20);
  expect_fault();
  EXPECT_EQ(line.view().session, session);
  line.command(PlcCommand::scan, 1);
  EXPECT_EQ(line.view().refuse_code, 102) << "no session is in force";
  reset_fault();
  EXPECT_NE(line.view().session, session);
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationRefusals, a_command_that_could_not_be_stored_is_answered_and_not_carried_out) {
  begin();
  line.run_for(600);
  store.fail_next = Code::journal_write;
  line.command(PlcCommand::scan, 1);
  refused(Code::journal_write);
  expect_fault();
  EXPECT_TRUE(line.scans.empty());
  for (const PlcCommand what : {PlcCommand::scan, PlcCommand::slab_end}) {
    line.command(what, 1);
    refused(Code::journal_write);
  }
  reset_fault();
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationRefusals, a_scan_that_could_not_be_recorded_is_not_acquired_and_its_measurement_is_ignored) {
  begin();
  line.disk_syncs = false;
  line.scan(1);
  ASSERT_EQ(line.measured.size(), 1U) << "measured ahead";
  store.fail_next = Code::journal_write;
  line.sync_ends(Code::ok);
  line.run_for(40);
  expect_fault();
  EXPECT_NE(line.view().acq_seq, line.plc.cmd_seq);
  EXPECT_EQ(line.view().cmd_status, failed(Code::journal_write));
  EXPECT_EQ(line.view().table[0].verdict, Verdict::not_measured);
  EXPECT_EQ(line.view().table[0].reason, kJournalWrite);
  EXPECT_FALSE(line.view().result);
  EXPECT_EQ(line.view().stations_done, 0);
  EXPECT_TRUE(all_buffers_are_free());
  reset_fault();
  line.disk_syncs = true;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  EXPECT_EQ(line.take_results().size(), 1U);
}

TEST_F(StationRefusals, a_failed_scan_that_could_not_be_recorded_raises_the_fault) {
  begin();
  line.run_for(600);
  line.scan_code = Code::trigger_timeout;
  line.command(PlcCommand::scan, 1);
  store.fail_next = Code::journal_write;
  line.run_for(1000);
  expect_fault();
  EXPECT_EQ(line.view().cmd_status, failed(Code::trigger_timeout));
}

TEST_F(StationRefusals, a_slab_that_could_not_be_stored_has_no_verdict_and_may_be_ended_again) {
  for (const PlcCommand what : {PlcCommand::slab_end, PlcCommand::slab_abort}) {
    line.plc.slab_no = 0;
    begin();
    const std::uint16_t seq = line.command(what);
    store.fail_next = Code::journal_write;  // the command is stored, the slab is not
    line.run_for(60);
    expect_fault();
    EXPECT_EQ(line.view().cmd_ack, seq);
    EXPECT_EQ(line.view().cmd_status, failed(Code::journal_write));
    EXPECT_TRUE(line.view().slab_open);
    EXPECT_EQ(line.view().slab_verdict, Verdict::none);
    EXPECT_FALSE(line.view().result);
    reset_fault();
    line.command(what);
    line.run_for(60);
    EXPECT_FALSE(line.view().slab_open);
    EXPECT_EQ(line.view().slab_verdict, what == PlcCommand::slab_end ? Verdict::not_measured : Verdict::aborted);
    EXPECT_EQ(line.take_results().size(), 1U);
  }
}

TEST_F(StationRefusals, a_repeated_record_that_could_not_be_stored_is_not_shown) {
  begin();
  line.scan(4);
  ASSERT_EQ(line.take_results().size(), 1U);
  line.command(PlcCommand::report, 4);
  store.fail_next = Code::journal_write;
  line.run_for(20);
  // REPORT is a command and a record; if either fails, neither is shown.
  expect_fault();
  EXPECT_EQ(line.view().cmd_status, failed(Code::journal_write));
  EXPECT_FALSE(line.view().result);
  reset_fault();
  line.command(PlcCommand::report, 4);
  line.run_for(20);
  EXPECT_EQ(line.take_results().size(), 1U);
}

TEST_F(StationRefusals, an_acknowledgement_that_could_not_be_stored_shows_its_record_again_after_a_restart) {
  begin();
  line.scan(1);
  const std::uint16_t number = line.view().record.res_seq;
  store.fail_next = Code::journal_write;
  line.plc.res_ack = number;
  line.feed(line.plc);
  line.run_for(8);
  expect_fault();
  EXPECT_FALSE(line.view().result);
  line.plc = {};
  line.start();
  EXPECT_EQ(line.view().record.res_seq, number);
}

TEST_F(StationRefusals, an_acknowledgement_that_could_not_be_stored_is_stored_with_the_next_job) {
  begin();
  line.scan(1);
  const std::uint16_t number = line.view().record.res_seq;
  store.fail_next = Code::journal_write;
  line.plc.res_ack = number;
  line.feed(line.plc);
  line.run_for(8);
  reset_fault();
  line.scan(2);
  line.run_for(8);
  line.plc = {};
  line.start();
  EXPECT_NE(line.view().record.res_seq, number) << "it is known to have been taken";
  EXPECT_EQ(line.take_results().size(), 1U);
}

TEST_F(StationRefusals, an_answer_to_an_unknown_job_is_ignored) {
  begin();
  line.feed(StoreDone{60'000, Code::journal_write});
  EXPECT_EQ(line.view().fault, 0);
}

// ---- the wrong moment ----

TEST_F(StationRefusals, commands_of_another_slab_type_or_recipe_are_refused) {
  line.run_for(300);
  line.plc.recipe = 4925;
  line.command(PlcCommand::slab_begin);
  refused(Code::unknown_type);
  line.plc.recipe = 5600;
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  ASSERT_TRUE(line.view().slab_open);
  line.slab_type = 4925;
  for (const PlcCommand what : {PlcCommand::scan, PlcCommand::slab_end, PlcCommand::slab_abort}) {
    line.command(what, 1);
    refused(Code::wrong_slab);
  }
  line.slab_type = 0;  // the open one, whatever its type
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationRefusals, text_behind_the_end_of_a_slab_id_is_refused) {
  line.run_for(300);
  line.plc.slab_id = {'A', '\0', 'B'};
  line.command(PlcCommand::slab_begin);
  refused(Code::bad_id_text);
  line.plc.slab_id = {'A', '\x7f'};
  line.command(PlcCommand::slab_begin);
  refused(Code::bad_id_text);
}

TEST_F(StationRefusals, a_slab_without_its_design_sheet_cannot_begin) {
  Recipe curve = test_recipe();
  DesignSheet sheet;
  sheet.slab_id = "C-1";
  sheet.slab_type = curve.slab_type;
  sheet.stations = curve.stations();
  sheet.sha256 = "feed";
  sheet.text = "1,1,2,3,0.1;";
  StationSettings& settings = line.station->settings;
  const std::span<const Recipe> recipes = settings.recipes;
  settings.designs = std::span(&sheet, 1);
  line.run_for(300);
  const auto begun = [&](std::string_view id) {
    line.plc.slab_id.fill('\0');
    std::copy(id.begin(), id.end(), line.plc.slab_id.begin());
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    if (!line.view().slab_open) {
      EXPECT_EQ(line.view().cmd_status, failed(Code::no_design));
      return false;
    }
    line.command(PlcCommand::slab_abort);
    line.run_for(40);
    line.take_results();
    return true;
  };
  const auto header = [&]() -> const SlabHeader& { return line.station->slab.header; };
  for (const DesignUse use : {DesignUse::none, DesignUse::optional, DesignUse::required}) {
    curve.design = use;
    settings.recipes = std::span<const Recipe>(&curve, 1);
    settings.designs_faulty = false;
    EXPECT_EQ(begun("C-2"), use != DesignUse::required) << "no sheet";
    EXPECT_TRUE(begun("C-1"));
    EXPECT_EQ(header().design_sha256.view(), use == DesignUse::none ? "" : "feed");
    EXPECT_EQ(line.station->slab.facts.design.given, use != DesignUse::none);
    settings.designs_faulty = true;
    EXPECT_EQ(begun("C-2"), use == DesignUse::none) << "its sheet may be the one that cannot be read";
    sheet.stations = 16;
    EXPECT_EQ(begun("C-1"), use == DesignUse::none) << "a sheet of another slab type";
    sheet.stations = curve.stations();
  }
  settings.recipes = recipes;
}

TEST_F(StationRefusals, a_sheet_exchanged_while_its_slab_is_open_changes_nothing) {
  Recipe curve = test_recipe();
  curve.design = DesignUse::required;
  DesignSheet sheet;
  sheet.slab_id = "C-1";
  sheet.slab_type = curve.slab_type;
  sheet.stations = curve.stations();
  sheet.text = "1,1,2,3,0.1;";
  StationSettings& settings = line.station->settings;
  const std::span<const Recipe> recipes = settings.recipes;
  settings.recipes = std::span<const Recipe>(&curve, 1);
  settings.designs = std::span(&sheet, 1);
  line.run_for(300);
  std::copy_n("C-1", 3, line.plc.slab_id.begin());
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  ASSERT_TRUE(line.view().slab_open);
  sheet.text = "1,9,9,9,0.9;";
  EXPECT_EQ(line.station->slab.facts.design.at(1).offset_mm, Vec3(1, 2, 3));
  EXPECT_EQ(facts_of(line.station->slab.header).design.at(1).offset_mm, Vec3(1, 2, 3));
  settings.designs = {};
  EXPECT_EQ(facts_of(line.station->slab.header).design.at(1).offset_mm, Vec3(1, 2, 3));
  line.command(PlcCommand::slab_abort);
  line.run_for(40);
  settings.recipes = recipes;
}

TEST_F(StationRefusals, no_command_is_executed_without_enable) {
  begin();
  line.command(PlcCommand::none);
  refused(Code::unknown_command);
  line.run_for(600);
  line.plc.enable = false;
  line.plc.command = static_cast<std::uint16_t>(PlcCommand::scan);
  line.plc.station = 1;
  line.plc.cmd_seq = next_sequence(line.view().cmd_ack);
  line.feed(line.plc);
  refused(Code::not_enabled);
  EXPECT_TRUE(line.scans.empty());
}

TEST_F(StationRefusals, one_scan_at_a_time_and_no_end_before_it_is_over) {
  begin();
  line.scanner_answers = false;
  line.scan(1);
  ASSERT_EQ(line.view().state, PlcState::scanning);
  for (const PlcCommand what : {PlcCommand::scan, PlcCommand::slab_end}) {
    line.command(what, 2);
    refused(Code::busy);
  }
  EXPECT_EQ(line.scans.size(), 1U);
}

TEST_F(StationRefusals, a_station_whose_block_is_being_measured_is_not_scanned_again) {
  begin();
  line.measuring_works = false;
  line.scan(1);
  line.command(PlcCommand::scan, 1);
  refused(Code::busy);
  line.feed(answer_to(line.measured.back()));
  line.measuring_works = true;
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
}

TEST_F(StationRefusals, while_a_slab_ends_it_takes_only_an_abort) {
  begin();
  line.measuring_works = false;
  line.scan(1);
  line.command(PlcCommand::slab_end);
  line.run_for(100);
  ASSERT_TRUE(line.view().slab_open);
  ASSERT_TRUE(line.view().busy);
  for (const PlcCommand what : {PlcCommand::slab_begin, PlcCommand::scan, PlcCommand::slab_end}) {
    line.command(what, 2);
    refused(Code::busy);
  }
  line.command(PlcCommand::slab_abort);
  line.run_for(40);
  EXPECT_FALSE(line.view().slab_open) << "it does not wait for the measurement";
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
  line.feed(answer_to(line.measured.back()));
  line.run_for(40);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted) << "the late answer is dropped";
}

TEST_F(StationRefusals, an_abort_on_its_way_to_the_journal_while_the_slab_is_judged_leaves_one_end) {
  begin();
  line.scan(1);
  EXPECT_EQ(line.take_results().size(), 1U);
  line.command(PlcCommand::slab_end);
  line.run_for(4);  // journalled; the judgement is on its way
  ASSERT_TRUE(line.station->slab.judging);
  const std::uint16_t abort_seq = line.command(PlcCommand::slab_abort);
  line.run_for(40);
  EXPECT_EQ(store.slabs_ended, 1);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
  const std::vector<PlcResult> taken = line.take_results();
  ASSERT_EQ(taken.size(), 1U);
  EXPECT_EQ(taken[0].verdict, Verdict::aborted);
  EXPECT_EQ(taken[0].cmd_seq, abort_seq);
}

TEST_F(StationRefusals, a_station_cannot_be_scanned_without_limit) {
  begin();
  line.station->slab.stations[0].attempts = 0xFF;
  line.command(PlcCommand::scan, 1);
  refused(Code::attempts_used_up);
  EXPECT_EQ(line.view().table[0].attempts, 0xFF);
}

TEST_F(StationRefusals, report_has_only_records_that_there_are) {
  line.run_for(300);
  line.command(PlcCommand::report);
  refused(Code::wrong_slab);  // no slab was judged yet
  line.command(PlcCommand::report, 3);
  refused(Code::wrong_slab);  // no slab is open
  line.command(PlcCommand::report, 19);
  refused(Code::station_range);
  begin();
  line.command(PlcCommand::report, 3);
  refused(Code::wrong_slab);  // not measured
  line.command(PlcCommand::slab_end);
  line.run_for(60);
  const auto slab = line.take_results();
  ASSERT_EQ(slab.size(), 1U);
  line.command(PlcCommand::report);
  line.run_for(20);
  const auto again = line.take_results();
  ASSERT_EQ(again.size(), 1U);
  EXPECT_EQ(again[0].kind, slab[0].kind);
  EXPECT_EQ(again[0].verdict, slab[0].verdict);
  EXPECT_NE(again[0].res_seq, slab[0].res_seq);
}

TEST_F(StationRefusals, a_block_without_a_number_or_a_writer_is_not_a_command) {
  begin();
  const PlcOutputs before = line.view();
  line.plc.command = static_cast<std::uint16_t>(PlcCommand::scan);
  line.plc.station = 1;
  line.plc.cmd_seq = 0;
  line.feed(line.plc);
  line.plc.cmd_seq = next_sequence(before.cmd_ack);
  const std::uint32_t writer = line.plc.command_writer;
  line.plc.command_writer = 0;
  line.feed(line.plc);
  line.run_for(600);
  EXPECT_EQ(line.view().cmd_ack, before.cmd_ack);
  EXPECT_EQ(line.view().refused, before.refused);
  EXPECT_TRUE(line.scans.empty());
  line.plc.command_writer = writer;
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_ack, line.plc.cmd_seq);
}

TEST_F(StationRefusals, whatever_differs_under_a_number_that_is_taken_is_another_order) {
  begin();
  line.scan(1);
  std::uint32_t writer = line.plc.command_writer;
  const auto differs = [&](const auto& change) {
    PlcInputs other = line.plc;
    change(other);
    other.command_writer = ++writer;
    const std::uint16_t refused_before = line.view().refused;
    line.feed(other);
    EXPECT_EQ(line.view().refused, refused_before + 1);
    EXPECT_EQ(line.view().refuse_code, 111);
    line.station->command.refuse_code = 0;
  };
  differs([](PlcInputs& in) { ++in.slab_type; });
  differs([](PlcInputs& in) { ++in.slab_no; });
  differs([](PlcInputs& in) { in.slab_id[0] = 'Z'; });
  differs([](PlcInputs& in) { in.command = 3; });
  EXPECT_EQ(line.scans.size(), 1U);
}

TEST_F(StationRefusals, a_copy_of_a_command_from_another_connection_is_counted_and_ignored) {
  begin();
  line.scan(1);
  const PlcOutputs before = line.view();
  PlcInputs copy = line.plc;
  copy.command_writer = 8;
  line.feed(copy);
  EXPECT_EQ(line.view().refused, before.refused + 1);
  EXPECT_EQ(line.view().session, before.session);
  EXPECT_EQ(line.scans.size(), 1U);
}

// ---- before the start, and events without an answer ----

TEST(StationBeforeItsStart, is_safe_and_ignores_events) {
  StationSettings settings;
  const auto station = std::make_unique<Station>(settings);
  const auto actions = std::make_unique<Actions>();
  PlcInputs in;
  in.enable = true;
  in.heartbeat = 1;
  in.command = static_cast<std::uint16_t>(PlcCommand::slab_begin);
  in.cmd_seq = 1;
  in.command_writer = 1;
  step(*station, Tick{2 * kNsPerS, 2'000'000}, *actions);
  step(*station, in, *actions);
  EXPECT_TRUE(actions->empty());
  const PlcOutputs view = plc_view(*station);
  EXPECT_EQ(view.state, PlcState::recover);
  EXPECT_FALSE(view.ready);
  EXPECT_FALSE(view.store_ok);
  EXPECT_FALSE(view.result);
  EXPECT_EQ(view.cmd_ack, 0);
  EXPECT_EQ(view.slab_verdict, Verdict::none);
  CaptureRequest request;
  request.action = CaptureRequest::Action::begin;
  request.session = "spring";
  request.operator_name = "anna";
  request.lease_s = 60;
  step(*station, request, *actions);
  EXPECT_EQ(station->capture.refusal.code, Code::busy);
}

TEST_F(StationRefusals, an_open_slab_without_a_recipe_of_its_type_can_only_be_aborted) {
  begin();
  line.recipe.slab_type = 4925;
  line.plc = {};
  line.start();
  line.run_for(300);
  line.slab_type = 0;
  line.command(PlcCommand::scan, 1);
  refused(Code::unknown_type);
  line.command(PlcCommand::slab_abort);
  line.run_for(40);
  EXPECT_EQ(line.view().slab_verdict, Verdict::aborted);
}

TEST_F(StationRefusals, a_wall_clock_older_than_the_newest_record_is_a_warning_until_it_is_corrected) {
  begin();
  line.station->newest_time = NewestTime(line.view().utime_us + 1'000'000);
  line.run_for(8);
  EXPECT_NE(line.view().warn & kWarnClockBackwards, 0);
  EXPECT_TRUE(line.view().ready);
  line.run_for(1100);
  EXPECT_EQ(line.view().warn & kWarnClockBackwards, 0);
}

TEST_F(StationRefusals, files_without_a_request_are_a_warning) {
  begin();
  line.feed(LinkStatus{true, false, 0});
  EXPECT_TRUE(line.view().scanner_ok);
  EXPECT_EQ(line.view().warn & kWarnStrayFiles, 0);
  line.feed(LinkStatus{false, false, 2});
  EXPECT_FALSE(line.view().scanner_ok);
  EXPECT_NE(line.view().warn & kWarnStrayFiles, 0);
}

TEST_F(StationRefusals, a_result_of_another_slab_or_attempt_is_ignored) {
  begin();
  line.measuring_works = false;
  line.scan(1);
  ASSERT_EQ(line.measured.size(), 1U);
  BlockMeasured other = answer_to(line.measured[0]);
  ++other.id.slab_key;
  line.feed(other);
  other = answer_to(line.measured[0]);
  ++other.id.attempt;
  line.feed(other);
  other = answer_to(line.measured[0]);
  other.block.station = 2;
  line.feed(other);
  line.run_for(40);
  EXPECT_FALSE(line.view().result);
  SlabJudged judged;
  judged.slab_key = line.measured[0].id.slab_key;
  judged.slab.verdict = Verdict::pass;
  line.feed(judged);  // not requested
  line.run_for(40);
  EXPECT_TRUE(line.view().slab_open);
  EXPECT_EQ(line.view().slab_verdict, Verdict::none);
  line.feed(answer_to(line.measured[0]));
  line.run_for(40);
  EXPECT_TRUE(line.view().result);
}

TEST_F(StationRefusals, after_a_restart_the_last_slabs_table_distinguishes_scans_from_failures) {
  const auto row = [&](std::size_t station, std::uint8_t attempts, Verdict verdict, std::uint16_t reason) {
    PlcStationRow& r = store.line.table[station - 1];
    r.attempts = attempts;
    r.verdict = verdict;
    r.reason = reason;
  };
  row(1, 1, Verdict::pass, 0);
  row(2, 1, Verdict::not_measured, 402);  // a scan without its block
  row(3, 2, Verdict::not_measured, 203);  // no scan
  row(4, 1, Verdict::not_measured, 502);
  row(5, 1, Verdict::not_measured, 603);  // a block without an item
  row(6, 0, Verdict::not_measured, 0);    // never tried
  row(7, 1, Verdict::none, 0);
  row(8, 1, Verdict::fail, 605);
  row(9, 1, Verdict::not_measured, 401);
  line.plc = {};
  line.start();
  const PlcOutputs view = line.view();
  EXPECT_EQ(view.station_mask, 0b10010011U);
  EXPECT_EQ(view.stations_done, 4);
}

TEST_F(StationRefusals, a_slab_that_is_being_stored_accepts_no_further_result) {
  begin();
  line.command(PlcCommand::slab_end);
  for (int i = 0; i < 20 && line.station->slab.phase != SlabPhase::storing_end; ++i) line.run_for(4);
  ASSERT_EQ(line.station->slab.phase, SlabPhase::storing_end);
  EXPECT_TRUE(line.view().busy);
  for (const PlcCommand what :
       {PlcCommand::slab_begin, PlcCommand::scan, PlcCommand::slab_end, PlcCommand::slab_abort}) {
    line.command(what, 1);
    EXPECT_EQ(line.station->command.refuse_code, static_cast<std::uint16_t>(Code::busy));
  }
  line.run_for(40);
  EXPECT_FALSE(line.view().slab_open);
}

TEST_F(StationRefusals, a_full_disk_is_reported_with_the_fault_and_not_as_stored) {
  begin();
  line.station->fault = static_cast<std::uint16_t>(Code::store_full);
  EXPECT_FALSE(line.view().store_ok);
  EXPECT_FALSE(line.view().ready);
}

TEST_F(StationRefusals, storage_that_falls_behind_refuses_commands_and_keeps_acknowledgements_for_later) {
  begin();
  line.scan(1);
  ASSERT_TRUE(line.view().result);
  auto& storing = line.station->storing;
  const std::size_t before = storing.size();
  while (storing.size() + 8 <= storing.capacity()) ASSERT_TRUE(storing.push(PendingStore{}));
  line.plc.res_ack = line.view().record.res_seq;
  line.feed(line.plc);
  EXPECT_TRUE(line.view().result) << "it is requested again";
  line.command(PlcCommand::scan, 2);
  EXPECT_EQ(line.view().refuse_code, static_cast<std::uint16_t>(Code::busy));
  while (storing.size() > before) storing.erase(storing.size() - 1);
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_FALSE(line.view().result);
}

}  // namespace
}  // namespace slabd::daemon
