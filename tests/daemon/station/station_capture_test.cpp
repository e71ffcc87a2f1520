// SPDX-License-Identifier: Apache-2.0
//
// Maintenance: views for a calibration with the line's own robot and scanner, and the PLC's registers meanwhile.
#include <gtest/gtest.h>

#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

constexpr std::uint16_t kRefused107 = 0x8000 + 107;

class CaptureTest : public ::testing::Test {
 protected:
  CaptureTest() { line_.decodes_first = true; }

  const Error& ask(CaptureRequest::Action action, const char* session = "spring", bool take_over = false,
                   const char* scan = "") {
    CaptureRequest request;
    request.action = action;
    request.session = session;
    request.operator_name = "anna";
    request.uid = 1000;
    request.lease_s = 60;
    request.take_over = take_over;
    request.scan = scan;
    line_.feed(request);
    return line_.station->capture.refusal;
  }
  void begin(const char* session = "spring") {
    const Error& why = ask(CaptureRequest::Action::begin, session);
    ASSERT_EQ(why.code, Code::ok) << why.text.view();
  }
  /// One view, from the request to its end.
  const CaptureShot& shoot(int ms = 2'500) {
    const Error& why = ask(CaptureRequest::Action::shoot);
    EXPECT_EQ(why.code, Code::ok) << why.text.view();
    line_.run_for(ms);
    return line_.station->capture.shot;
  }
  /// Waits until the scanner has a request and owes its answer.
  void ask_scanner() {
    line_.scanner_answers = false;
    ask(CaptureRequest::Action::shoot);
    line_.run_for(1'100);
    ASSERT_EQ(line_.scans.size(), 1U);
  }
  static bool says(const FixedString<limits::kErrorTextBytes>& text, std::string_view part) {
    return text.view().find(part) != std::string_view::npos;
  }
  /// The scanner's answer to request `index`: a complete, durable scan.
  ScanDone scanned(std::size_t index) const {
    ScanDone done;
    done.cmd_seq = line_.scans[index].request.cmd_seq;
    done.slot = line_.scans[index].slot;
    done.durable = true;
    done.scan.path = "/spool/capture/1-1.ply";
    done.scan.taken_mono_ns = line_.station->now_ns;
    return done;
  }
  bool all_buffers_are_free() const {
    return std::none_of(line_.station->slot_busy.begin(), line_.station->slot_busy.end(), [](bool b) { return b; });
  }

  MemoryStore store_;
  Line line_{store_};
};

using Action = CaptureRequest::Action;

TEST_F(CaptureTest, a_view_is_the_mean_of_a_second_of_standing_still_and_of_the_scan) {
  begin();
  EXPECT_EQ(line_.view().state, PlcState::maintenance);
  EXPECT_FALSE(line_.view().ready);
  line_.robot_shakes = true;
  line_.robot_shake_mm = 0.008;
  const CaptureShot& shot = shoot();
  ASSERT_TRUE(shot.done);
  ASSERT_EQ(shot.code, Code::ok) << shot.text.view();
  EXPECT_EQ(shot.number, 1U);
  EXPECT_NEAR(shot.spread_mm, 0.008, 1e-9);
  EXPECT_GE(shot.last.arrival_ns - shot.first.arrival_ns, kNsPerS);
  EXPECT_EQ(shot.samples, static_cast<std::uint32_t>(shot.last.seq - shot.first.seq + 1));
  const Vec3 stood = (T_slab_block(line_.recipe, 1) * nominal_T_block_scanner()).translation_mm;
  EXPECT_NEAR(shot.T_base_flange.translation_mm.y(), stood.y() + 0.004, 1e-4);
  ASSERT_EQ(line_.scans.size(), 1U);
  EXPECT_EQ(line_.scans[0].request.session, 0) << "the PLC's sessions are never 0: no answer can be mixed up";
  EXPECT_EQ(line_.scans[0].request.station, 0);
  EXPECT_TRUE(shot.scan_path.view().starts_with("/spool/capture/"));
  EXPECT_TRUE(line_.dropped.empty());
  EXPECT_TRUE(all_buffers_are_free());
  EXPECT_TRUE(line_.measured.empty());
  EXPECT_EQ(line_.view().state, PlcState::maintenance) << "until it is ended";
  EXPECT_EQ(ask(Action::end).code, Code::ok);
  EXPECT_EQ(line_.view().state, PlcState::idle);
  EXPECT_TRUE(line_.view().ready);
}

TEST_F(CaptureTest, poses_of_before_the_request_do_not_count) {
  begin();
  line_.run_for(3'000);
  ask(Action::shoot);
  line_.run_for(980);
  EXPECT_TRUE(line_.scans.empty());
  line_.run_for(60);
  EXPECT_EQ(line_.scans.size(), 1U);
}

TEST_F(CaptureTest, an_arm_that_swings_by_more_than_a_hundredth_is_refused_with_what_moved) {
  begin();
  line_.robot_shakes = true;
  line_.robot_shake_mm = 0.012;  // accepted by the gate for production
  const CaptureShot& shot = shoot(10'000);
  ASSERT_TRUE(shot.done);
  EXPECT_EQ(shot.code, Code::not_settled);
  EXPECT_TRUE(says(shot.text, "0.012 mm along base y")) << shot.text.view();
  EXPECT_TRUE(line_.scans.empty());
  line_.robot_shakes = false;
  EXPECT_EQ(shoot().code, Code::ok) << "shooting is simply repeated";
  EXPECT_EQ(line_.station->capture.shot.number, 2U);
}

TEST_F(CaptureTest, a_slow_turn_is_seen_as_well) {
  begin();
  ask(Action::shoot);
  for (int i = 0; i < 2'500; ++i) {
    line_.robot_turn_rad = i * rad_from_deg(0.0004);  // 0.1 deg/s
    line_.run_for(4);
  }
  const CaptureShot& shot = line_.station->capture.shot;
  ASSERT_TRUE(shot.done);
  EXPECT_EQ(shot.code, Code::not_settled);
  EXPECT_TRUE(says(shot.text, "about base z")) << shot.text.view();
}

TEST_F(CaptureTest, a_view_with_motion_during_the_scan_is_refused_and_its_scan_is_deleted) {
  begin();
  line_.robot_moves_mm = 0.015;
  ask_scanner();
  line_.feed(scanned(0));
  line_.run_for(100);
  const CaptureShot& shot = line_.station->capture.shot;
  ASSERT_TRUE(shot.done);
  EXPECT_EQ(shot.code, Code::moved_during_scan);
  EXPECT_TRUE(says(shot.text, "0.015 mm along base x")) << shot.text.view();
  ASSERT_EQ(line_.dropped.size(), 1U);
  EXPECT_EQ(line_.dropped[0], "/spool/capture/1-1.ply");
  EXPECT_TRUE(all_buffers_are_free());
}

TEST_F(CaptureTest, poses_lost_during_the_scan_do_not_prove_standstill) {
  begin();
  ask_scanner();
  line_.lose_poses(3);
  line_.run_for(20);
  line_.feed(scanned(0));
  line_.run_for(100);
  EXPECT_EQ(line_.station->capture.shot.code, Code::pose_stale);
  EXPECT_EQ(line_.dropped.size(), 1U);
}

TEST_F(CaptureTest, poses_that_stop_are_named) {
  begin();
  line_.robot_present = false;
  EXPECT_EQ(shoot(10'000).code, Code::pose_stale);
  EXPECT_TRUE(line_.scans.empty());
}

TEST_F(CaptureTest, another_tool_is_refused_by_name) {
  begin();
  line_.robot_tool = 3;
  const CaptureShot& shot = shoot(10'000);
  EXPECT_EQ(shot.code, Code::wrong_frame);
  EXPECT_TRUE(says(shot.text, "tool 3 are active")) << shot.text.view();
}

TEST_F(CaptureTest, the_scanners_error_text_is_reported) {
  begin();
  line_.scan_code = Code::trigger_timeout;
  const CaptureShot& shot = shoot();
  EXPECT_EQ(shot.code, Code::trigger_timeout);
  EXPECT_EQ(shot.text.view(), "as the test wants it");
  EXPECT_TRUE(all_buffers_are_free());
  line_.scan_code = Code::ok;
  EXPECT_EQ(shoot().code, Code::frame_incomplete);  // may be the scan that was given up
  EXPECT_EQ(shoot().code, Code::ok);
  EXPECT_NE(line_.scans[0].request.cmd_seq, line_.scans[1].request.cmd_seq);
}

TEST_F(CaptureTest, no_view_is_requested_while_the_disk_hangs_and_the_store_queue_keeps_room) {
  begin();
  line_.disk_answers = false;
  for (int view = 0; view < 80; ++view) {
    ask(Action::shoot);
    line_.run_for(15'000);
    ASSERT_TRUE(line_.station->capture.shot.done) << view;
    EXPECT_EQ(line_.station->capture.shot.code, Code::deadline);
  }
  EXPECT_TRUE(line_.scans.empty());
  EXPECT_LE(line_.station->storing.size() + 7, line_.station->storing.capacity());
}

TEST_F(CaptureTest, a_repeated_view_is_not_accepted_as_a_scan_of_a_block) {
  begin();
  line_.fingerprint = 4711;
  ASSERT_EQ(shoot().code, Code::ok);
  ask(Action::end);
  line_.start();  // a restart must not change that
  line_.run_for(300);
  line_.command(PlcCommand::slab_begin);
  line_.run_for(20);
  line_.scan(1);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::frame_incomplete));
  EXPECT_EQ(line_.view().stations_done, 0);
  line_.fingerprint = 4712;
  line_.fingerprint_thrown_away = 4714;
  line_.scan(1);
  EXPECT_EQ(line_.view().stations_done, 1);
}

TEST_F(CaptureTest, the_points_of_an_earlier_scan_are_not_accepted_as_a_view) {
  for (const bool first_decoded : {true, false}) {
    line_.decodes_first = first_decoded;
    begin();
    line_.fingerprint = first_decoded ? 1 : 2;
    ASSERT_EQ(shoot().code, Code::ok);
    const CaptureShot& again = shoot();
    EXPECT_EQ(again.code, Code::frame_incomplete);
    EXPECT_TRUE(says(again.text, "restart the scanner program")) << again.text.view();
    ASSERT_FALSE(line_.dropped.empty());
    EXPECT_EQ(line_.dropped.back(), line_.scans.back().request.spool_path.view());
    EXPECT_TRUE(all_buffers_are_free());
    // The requested scan may still come.
    line_.fingerprint = 0;
    EXPECT_EQ(shoot().code, Code::frame_incomplete);
    EXPECT_TRUE(says(line_.station->capture.shot.text, "take the view again"));
    EXPECT_EQ(shoot().code, Code::ok);
    ask(Action::end);
  }
}

TEST_F(CaptureTest, an_unseen_scan_is_not_a_view_and_the_view_is_not_a_scan_of_a_block) {
  line_.command(PlcCommand::slab_begin);
  line_.run_for(20);
  line_.scan_code = Code::trigger_timeout;
  line_.scan(4);
  ASSERT_EQ(line_.view().cmd_status, failed(Code::trigger_timeout));
  line_.scan_code = Code::ok;
  line_.command(PlcCommand::slab_abort);
  line_.run_for(100);
  begin();
  line_.fingerprint = 4711;  // block 4's points, late
  EXPECT_EQ(shoot().code, Code::frame_incomplete);
  EXPECT_TRUE(says(line_.station->capture.shot.text, "not received")) << line_.station->capture.shot.text.view();
  ASSERT_FALSE(line_.dropped.empty());
  EXPECT_EQ(line_.dropped.back(), line_.scans.back().request.spool_path.view());
  EXPECT_TRUE(all_buffers_are_free());
  line_.fingerprint = 4712;
  EXPECT_EQ(shoot().code, Code::ok);
}

TEST_F(CaptureTest, a_view_that_ends_before_the_scanner_was_asked_costs_no_scan) {
  for (const bool by_end : {false, true}) {
    begin();
    line_.disk_answers = false;
    ask(Action::shoot);
    line_.run_for(2'500);
    ASSERT_TRUE(line_.scans.empty());
    ask(by_end ? Action::end : Action::keep);
    if (!by_end) {
      line_.plc.abort = true;
      line_.feed(line_.plc);
      line_.plc.abort = false;
      line_.feed(line_.plc);
    }
    line_.disk_answers = true;
    line_.run_for(100);
    EXPECT_FALSE(line_.station->arms[0].scan_unseen);
    if (by_end) begin();
    EXPECT_EQ(shoot().code, Code::ok);
    ask(Action::end);
    line_.scans.clear();
  }
}

TEST_F(CaptureTest, an_emulated_line_may_give_a_view_twice) {
  line_.settings.simulation = true;
  line_.start();
  line_.run_for(300);
  begin();
  line_.fingerprint = 4711;
  EXPECT_EQ(shoot().code, Code::ok);
  EXPECT_EQ(shoot().code, Code::ok);
}

TEST_F(CaptureTest, commands_of_the_plc_are_refused_in_maintenance) {
  begin();
  std::uint16_t seq = line_.command(PlcCommand::slab_begin);
  line_.run_for(20);
  EXPECT_EQ(line_.view().cmd_ack, seq) << "content is refused, the number is used up";
  EXPECT_EQ(line_.view().cmd_status, kRefused107);
  seq = line_.command(PlcCommand::scan, 1);
  line_.run_for(20);
  EXPECT_EQ(line_.view().cmd_ack, seq);
  EXPECT_EQ(line_.view().cmd_status, kRefused107);
  EXPECT_TRUE(line_.scans.empty());
  ask(Action::end);
  line_.command(PlcCommand::slab_begin);
  line_.run_for(20);
  EXPECT_TRUE(line_.view().slab_open);
}

TEST_F(CaptureTest, an_open_slab_is_named_and_stays_alone) {
  line_.command(PlcCommand::slab_begin);
  line_.run_for(20);
  line_.scan(1);
  const Error& why = ask(Action::begin);
  EXPECT_EQ(why.code, Code::busy);
  EXPECT_TRUE(says(why.text, "slab 77")) << why.text.view();
  EXPECT_TRUE(says(why.text, "1 of 18 stations")) << why.text.view();
  EXPECT_TRUE(says(why.text, "SLAB_ABORT"));
  EXPECT_EQ(line_.view().state, PlcState::slab_open);
}

TEST_F(CaptureTest, a_slab_on_its_way_into_the_journal_comes_first) {
  line_.command(PlcCommand::slab_begin);  // not stored yet
  EXPECT_EQ(ask(Action::begin).code, Code::busy);
  line_.run_for(20);
  EXPECT_TRUE(line_.view().slab_open);
}

TEST_F(CaptureTest, a_line_without_a_calibration_may_be_calibrated_and_shows_the_fault) {
  store_.line.calibration.arm[0].id = "he-1";
  store_.line.calibration.arm[0].trouble = "the numbers were changed";
  line_.start();
  ASSERT_EQ(line_.view().fault, 503);
  begin();
  EXPECT_EQ(line_.view().state, PlcState::maintenance);
  EXPECT_EQ(line_.view().fault, 503);
  EXPECT_EQ(shoot().code, Code::ok);
}

TEST_F(CaptureTest, any_other_fault_comes_first) {
  line_.station->fault = 502;
  const Error& why = ask(Action::begin);
  EXPECT_EQ(why.code, Code::journal_write);
  EXPECT_TRUE(says(why.text, "fault 502")) << why.text.view();
}

TEST_F(CaptureTest, a_killed_session_releases_the_line) {
  begin();
  EXPECT_EQ(shoot().code, Code::ok);
  line_.run_for(58'000);
  EXPECT_EQ(line_.view().state, PlcState::maintenance);
  line_.run_for(3'000);
  EXPECT_EQ(line_.view().state, PlcState::idle);
  EXPECT_EQ(ask(Action::shoot).code, Code::wrong_slab);
  EXPECT_TRUE(line_.scans.size() == 1);
}

TEST_F(CaptureTest, a_session_that_continues_keeps_the_line) {
  begin();
  for (int i = 0; i < 4; ++i) {
    line_.run_for(50'000);
    EXPECT_EQ(ask(Action::keep).code, Code::ok);
  }
  EXPECT_EQ(line_.view().state, PlcState::maintenance);
}

TEST_F(CaptureTest, the_same_session_continues_and_another_waits_or_takes_over) {
  begin();
  EXPECT_EQ(shoot().code, Code::ok);
  begin();  // the previous slabctl was killed
  EXPECT_EQ(line_.station->capture.shot.number, 1U) << "and finds its last view";
  EXPECT_FALSE(line_.station->capture.shot.scan_path.empty());
  const Error& why = ask(Action::begin, "autumn");
  EXPECT_EQ(why.code, Code::busy);
  EXPECT_TRUE(says(why.text, "\"spring\" of anna")) << why.text.view();
  ask(Action::end, "autumn");
  EXPECT_EQ(line_.view().state, PlcState::maintenance) << "another session cannot be ended";
  EXPECT_EQ(ask(Action::begin, "autumn", true).code, Code::ok);
  EXPECT_EQ(line_.station->capture.session.view(), "autumn");
  EXPECT_EQ(ask(Action::keep).code, Code::wrong_slab);
}

TEST_F(CaptureTest, one_view_at_a_time) {
  begin();
  ask(Action::shoot);
  EXPECT_EQ(ask(Action::shoot).code, Code::busy);
  EXPECT_EQ(ask(Action::begin, "autumn", true).code, Code::busy) << "no takeover in the middle of a view";
  line_.run_for(2'000);
  EXPECT_EQ(line_.station->capture.shot.code, Code::ok);
  EXPECT_EQ(line_.scans.size(), 1U);
}

TEST_F(CaptureTest, ABORT_ends_the_view_and_not_the_session) {
  begin();
  ask_scanner();
  line_.plc.abort = true;
  line_.feed(line_.plc);
  line_.run_for(20);
  EXPECT_EQ(line_.cancelled, 1);
  EXPECT_EQ(line_.station->capture.shot.code, Code::interrupted);
  EXPECT_EQ(line_.view().state, PlcState::maintenance);
  EXPECT_TRUE(all_buffers_are_free());
  line_.plc.abort = false;
  line_.feed(line_.plc);
  // The cancelled scan may still come.
  line_.scanner_answers = true;
  EXPECT_EQ(shoot().code, Code::frame_incomplete);
  EXPECT_EQ(shoot().code, Code::ok);
}

TEST_F(CaptureTest, ending_in_the_middle_of_a_scan_waits_for_its_buffer) {
  begin();
  ask_scanner();
  ask(Action::end);
  EXPECT_EQ(line_.view().state, PlcState::maintenance) << "the worker still writes";
  line_.run_for(20);
  EXPECT_EQ(line_.view().state, PlcState::idle);
  EXPECT_TRUE(all_buffers_are_free());
}

TEST_F(CaptureTest, a_restarted_daemon_is_idle) {
  begin();
  ask(Action::shoot);
  line_.run_for(500);
  line_.start();
  EXPECT_EQ(line_.view().state, PlcState::idle);
  EXPECT_EQ(ask(Action::keep).code, Code::wrong_slab);
}

TEST_F(CaptureTest, only_views_are_released) {
  begin();
  for (const char* path :
       {"/spool/1/01-1.ply", "/spool/capture", "/spool/capture/", "/spool/capture/../1/01-1.ply", "/spool/capture/..",
        "/spool/capturing/1-1.ply", "/etc/passwd", "", "/spool/capture/a/1.ply"})
    EXPECT_EQ(ask(Action::release, "spring", false, path).code, Code::config) << path;
  EXPECT_TRUE(line_.dropped.empty());
  EXPECT_EQ(ask(Action::release, "spring", false, "/spool/capture/17-3.ply").code, Code::ok);
  ASSERT_EQ(line_.dropped.size(), 1U);
  ask(Action::end);
  EXPECT_EQ(ask(Action::release, "spring", false, "/spool/capture/17-4.ply").code, Code::ok)
      << "a session that is over still takes its scans";
}

TEST_F(CaptureTest, nonsense_is_refused) {
  CaptureRequest request;
  request.action = Action::begin;
  request.session = "a";
  request.operator_name = "b";
  for (const std::int64_t lease_s : {std::int64_t{0}, std::int64_t{9}, std::int64_t{3601}, INT64_MAX, INT64_MIN}) {
    request.lease_s = lease_s;
    line_.feed(request);
    EXPECT_EQ(line_.station->capture.refusal.code, Code::config);
  }
  request.lease_s = 60;
  request.session = "line\nfeed";
  line_.feed(request);
  EXPECT_EQ(line_.station->capture.refusal.code, Code::config);
  EXPECT_EQ(line_.view().state, PlcState::idle);
}

TEST_F(CaptureTest, a_view_without_a_free_buffer_fails_with_that_reason) {
  begin();
  line_.station->slot_busy.fill(true);
  const CaptureShot& shot = shoot(12'000);
  ASSERT_TRUE(shot.done);
  EXPECT_EQ(shot.code, Code::deadline);
  EXPECT_TRUE(says(shot.text, "no buffer")) << shot.text.view();
  EXPECT_TRUE(line_.scans.empty());
  EXPECT_EQ(line_.view().state, PlcState::maintenance);
}

TEST_F(CaptureTest, a_view_without_poses_after_the_scan_is_refused) {
  begin();
  ask_scanner();
  line_.robot_present = false;
  line_.feed(scanned(0));
  line_.run_for(500);
  EXPECT_FALSE(line_.station->capture.shot.done) << "one may still come";
  line_.run_for(1'000);
  EXPECT_TRUE(line_.station->capture.shot.done);
  EXPECT_EQ(line_.station->capture.shot.code, Code::pose_stale);
  EXPECT_TRUE(says(line_.station->capture.shot.text, "no pose arrived after the scan"));
  EXPECT_EQ(line_.dropped.size(), 1U);
  EXPECT_TRUE(all_buffers_are_free());
}

TEST_F(CaptureTest, another_tool_during_the_scan_is_refused_by_name) {
  begin();
  ask_scanner();
  line_.robot_tool = 3;
  line_.run_for(20);
  line_.feed(scanned(0));
  line_.run_for(40);
  EXPECT_EQ(line_.station->capture.shot.code, Code::wrong_frame);
  EXPECT_EQ(line_.dropped.size(), 1U);
}

TEST_F(CaptureTest, ABORT_counts_before_the_scan_and_after_it) {
  begin();
  const auto abort = [&] {
    line_.plc.abort = true;
    line_.feed(line_.plc);
    line_.plc.abort = false;
    line_.feed(line_.plc);
    EXPECT_EQ(line_.station->capture.shot.code, Code::interrupted);
    EXPECT_TRUE(line_.station->capture.shot.done);
    EXPECT_EQ(line_.view().state, PlcState::maintenance);
  };
  ask(Action::shoot);
  line_.run_for(500);
  abort();  // while it is settling
  EXPECT_TRUE(line_.scans.empty());

  ask_scanner();
  line_.robot_present = false;
  line_.feed(scanned(0));
  line_.run_for(100);
  abort();  // while it waits for a pose
  EXPECT_EQ(line_.dropped.size(), 1U) << "a view that is refused leaves no scan";
  EXPECT_TRUE(all_buffers_are_free());
}

TEST_F(CaptureTest, a_scan_that_was_whole_before_its_ABORT_is_deleted) {
  begin();
  ask_scanner();
  line_.plc.abort = true;
  line_.feed(line_.plc);
  line_.feed(scanned(0));  // the worker had finished before the cancellation; its answer belongs to no request
  line_.run_for(40);
  EXPECT_EQ(line_.station->capture.shot.code, Code::interrupted);
  ASSERT_EQ(line_.dropped.size(), 1U);
  EXPECT_TRUE(all_buffers_are_free());
}

TEST_F(CaptureTest, a_session_that_ends_while_its_view_is_checked_leaves_no_scan) {
  begin();
  ask_scanner();
  line_.robot_present = false;
  line_.feed(scanned(0));
  line_.run_for(100);
  ask(Action::end);
  EXPECT_EQ(line_.view().state, PlcState::idle);
  EXPECT_EQ(line_.dropped.size(), 1U);
  EXPECT_TRUE(all_buffers_are_free());
}

TEST_F(CaptureTest, another_session_cannot_begin_while_one_waits_for_its_buffer) {
  begin();
  line_.scanner_answers = false;
  ask(Action::shoot);
  line_.run_for(1'100);
  ask(Action::end);  // waits for the worker's answer
  EXPECT_EQ(ask(Action::begin, "autumn", true).code, Code::busy);
  EXPECT_EQ(ask(Action::keep).code, Code::wrong_slab) << "it has been ended";
}

TEST_F(CaptureTest, answers_to_other_requests_are_ignored) {
  begin();
  ask_scanner();
  ScanDone other = scanned(0);
  ++other.cmd_seq;
  line_.feed(other);
  other = scanned(0);
  other.slot = static_cast<std::uint8_t>(1 - other.slot);
  line_.feed(other);
  line_.run_for(40);
  EXPECT_FALSE(line_.station->capture.shot.done);
  line_.feed(scanned(0));
  line_.run_for(40);
  EXPECT_EQ(line_.station->capture.shot.code, Code::ok);
}

TEST_F(CaptureTest, a_scanner_that_fails_without_a_message_is_reported_by_its_code) {
  begin();
  ask_scanner();
  ScanDone done = scanned(0);
  done.code = Code::trigger_timeout;
  line_.feed(done);
  EXPECT_EQ(line_.station->capture.shot.code, Code::trigger_timeout);
  EXPECT_EQ(line_.station->capture.shot.text.view(), describe(Code::trigger_timeout));
}

TEST_F(CaptureTest, names_without_letters_are_refused) {
  CaptureRequest request;
  request.action = Action::begin;
  request.lease_s = 60;
  request.session = "spring";
  for (const char* name : {"", "an\x7f", "a\tb"}) {
    request.operator_name = name;
    line_.feed(request);
    EXPECT_EQ(line_.station->capture.refusal.code, Code::config) << name;
  }
  request.session = "";
  request.operator_name = "anna";
  line_.feed(request);
  EXPECT_EQ(line_.station->capture.refusal.code, Code::config);
  EXPECT_EQ(line_.view().state, PlcState::idle);
}

TEST_F(CaptureTest, limits_wider_than_the_default_are_used_and_reported) {
  line_.settings.capture.stable_mm = 0.05;
  line_.start();
  begin();
  line_.robot_shakes = true;
  line_.robot_shake_mm = 0.03;
  EXPECT_EQ(shoot().code, Code::ok);
}

}  // namespace
}  // namespace slabd::daemon
