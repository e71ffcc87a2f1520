// SPDX-License-Identifier: Apache-2.0
//
// Two robots with a scanner each: who scans which station, and what one may do while the other cannot.
#include <gtest/gtest.h>

#include "base/jobs.h"
#include "daemon/station/parts.h"
#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

LineCalibration hand_eye(const char* id) {
  LineCalibration c;
  c.source = LineCalibration::Source::applied;
  c.id = id;
  c.hand_eye.sigma_mm = 0.02;
  c.hand_eye.sigma_rad = 1e-5;
  return c;
}

Pose base_of_second() {
  Pose T_base_robot;
  T_base_robot.translation_mm = Vec3(3'000.0, 2'500.0, -4.0);
  T_base_robot.rotation = Quat(Eigen::AngleAxisd(2.5, Vec3::UnitZ()));
  return T_base_robot;
}

/// Stations 1 to 9 belong to robot 1, 10 to 18 to robot 2; station 9 may be scanned by both.
struct ArmsTest : testing::Test {
  ArmsTest() {
    CellCalibration& calibration = store_.line.calibration;
    calibration.arm[0] = hand_eye("he-1");
    calibration.arm[1] = hand_eye("he-2");
    calibration.arm[1].hand_eye.T_flange_scanner.translation_mm = Vec3(7.0, 0.0, 0.0);
    calibration.tie.id = "ti-1";
    calibration.tie.numbers.robot = "2";
    calibration.tie.numbers.T_base_robot = base_of_second();
    calibration.tie.hand_eye_id = {CalibrationId("he-1"), CalibrationId("he-2")};
    line_.T_base_robot_2 = base_of_second();
    LineArms& arms = line_.settings.arms;
    EXPECT_TRUE(arms.list.push(Arm{PartId("2"), PartId("right")}));
    for (std::size_t i = 8; i < arms.of_station.size(); ++i) {
      if (i > 8) arms.of_station[i].clear();
      EXPECT_TRUE(arms.of_station[i].push(1));
    }
    EXPECT_TRUE(line_.settings.more_arms.push(StationArmSettings{}));
    start();
  }
  void start() {
    line_.start();
    line_.run_for(300);
  }
  void begin() {
    line_.command(PlcCommand::slab_begin);
    line_.run_for(20);
    ASSERT_TRUE(line_.view().slab_open);
  }
  /// SCAN with robot 2 at the station; robot 1 stays where it is.
  std::uint16_t scan_by_second(int station, int ms = 1000) {
    line_.robot_2_station = station;
    line_.run_for(600);
    const std::uint16_t seq = line_.command(PlcCommand::scan, station);
    line_.run_for(ms);
    return seq;
  }
  [[nodiscard]] bool says(std::string_view text) const {
    return std::any_of(line_.logged.begin(), line_.logged.end(),
                       [&](const std::string& line) { return line.find(text) != std::string::npos; });
  }
  [[nodiscard]] const StationRecord& record(int station) const {
    return line_.station->slab.stations.at(static_cast<std::size_t>(station - 1));
  }
  void expect_scanned(int station, int arm) {
    EXPECT_EQ(record(station).phase, StationPhase::measured) << station;
    EXPECT_EQ(record(station).attempt.arm, arm) << station;
    EXPECT_EQ(record(station).attempt.by, line_.settings.arms.list[static_cast<std::size_t>(arm)]) << station;
  }

  MemoryStore store_;
  Line line_{store_};
};

TEST_F(ArmsTest, a_station_is_scanned_by_its_robot_and_its_place_is_in_the_base_frame) {
  begin();
  EXPECT_EQ(store_.line.slab.calibration_id.view(), "he-1");
  ASSERT_EQ(store_.line.slab.more_arms.size(), 1U);
  EXPECT_EQ(store_.line.slab.more_arms[0].by, (Arm{PartId("2"), PartId("right")}));
  EXPECT_EQ(store_.line.slab.more_arms[0].calibration_id.view(), "he-2");
  EXPECT_EQ(store_.line.slab.tie_id.view(), "ti-1");

  line_.scan(1);
  expect_scanned(1, 0);
  EXPECT_EQ(line_.scans.back().arm, 0);
  EXPECT_EQ(line_.scans.back().request.by, Arm{});
  EXPECT_FALSE(record(1).attempt.splice.tied);

  (void)scan_by_second(10);
  expect_scanned(10, 1);
  EXPECT_EQ(line_.scans.back().arm, 1);
  EXPECT_EQ(line_.scans.back().request.by, (Arm{PartId("2"), PartId("right")}));
  const Attempt& attempt = record(10).attempt;
  EXPECT_TRUE(attempt.splice.tied);
  const Pose T_base_flange = T_slab_block(line_.recipe, 10) * nominal_T_block_scanner();
  EXPECT_NEAR((base_of_second() * attempt.T_base_flange).translation_mm.x(), T_base_flange.translation_mm.x(), 1e-6)
      << "as robot 2 reports it, in its own base";
  Pose T_flange_scanner;
  T_flange_scanner.translation_mm = Vec3(7.0, 0.0, 0.0);
  const Pose expected = T_base_flange * T_flange_scanner;
  const MeasureBlock& measured = line_.measured.back();
  EXPECT_EQ(measured.arm, 1);
  EXPECT_LT((measured.T_base_scanner.translation_mm - expected.translation_mm).norm(), 1e-6);
  EXPECT_LT(angle_between_rad(measured.T_base_scanner.rotation, expected.rotation), 1e-9);
  EXPECT_EQ(stored_T_base_scanner(store_.line.slab, attempt).to_array(), measured.T_base_scanner.to_array());
  EXPECT_TRUE(measured.basis.has_tie);
}

TEST_F(ArmsTest, a_robot_at_the_station_of_the_other_scans_nothing) {
  begin();
  line_.robot_2_station = 3;
  line_.robot_off_mm = 500.0;
  line_.robot_station = 3;
  line_.run_for(600);
  line_.command(PlcCommand::scan, 3);
  line_.run_for(9'000);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::outside_window));
  EXPECT_TRUE(line_.scans.empty());
}

TEST_F(ArmsTest, a_station_of_both_is_scanned_by_the_robot_that_looks_at_it) {
  begin();
  line_.robot_station = 1;
  (void)scan_by_second(9);
  expect_scanned(9, 1);
  line_.robot_2_station = 0;
  line_.scan(9);
  expect_scanned(9, 0);
  (void)scan_by_second(9);
  expect_scanned(9, 0);  // both look at it: the usual one
}

TEST_F(ArmsTest, a_robot_that_comes_after_the_command_is_still_seen) {
  begin();
  line_.robot_station = 1;
  line_.run_for(300);
  line_.command(PlcCommand::scan, 9);
  line_.run_for(200);
  line_.robot_2_station = 9;
  line_.run_for(1'500);
  expect_scanned(9, 1);
}

TEST_F(ArmsTest, a_scanner_that_is_offline_is_named_and_the_other_goes_on) {
  begin();
  line_.scan_code_2 = Code::scanner_offline;
  (void)scan_by_second(10);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::scanner_offline));
  EXPECT_EQ(record(10).phase, StationPhase::failed);
  EXPECT_TRUE(says("station 10 (robot 2, scanner right): scan 1 failed"));
  EXPECT_TRUE(line_.view().ready);
  line_.scan(1);
  expect_scanned(1, 0);
  line_.robot_2_station = 0;
  line_.scan(9);
  expect_scanned(9, 0);
}

TEST_F(ArmsTest, links_are_up_while_one_arm_has_both) {
  const auto link = [this](bool online, std::uint8_t arm) {
    LinkStatus status;
    status.scanner_online = online;
    status.arm = arm;
    line_.feed(status);
  };
  link(false, 0);
  link(true, 1);
  EXPECT_TRUE(line_.view().pose_ok);
  EXPECT_TRUE(line_.view().scanner_ok);
  EXPECT_TRUE(line_.view().ready);
  link(false, 1);
  EXPECT_FALSE(line_.view().scanner_ok);
  link(true, 0);
  line_.robot_present = false;
  line_.run_for(2'000);
  EXPECT_FALSE(line_.view().pose_ok) << "a scanner without its robot, and a robot without its scanner";
}

TEST_F(ArmsTest, a_scanner_that_hangs_stops_only_its_own_arm) {
  begin();
  line_.scanner_2_answers = false;
  line_.worker_hangs = true;
  (void)scan_by_second(10, 100);
  ASSERT_EQ(line_.scans.size(), 1U);
  LinkStatus hangs;
  hangs.scanner_hangs = true;
  hangs.arm = 1;
  line_.feed(hangs);
  line_.run_for(20'000);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::scanner_offline));
  EXPECT_TRUE(says("no further scan is requested until it responds again"));
  EXPECT_TRUE(says("(robot 2, scanner right)"));

  line_.scan(1);
  expect_scanned(1, 0);
  line_.scan(2);
  expect_scanned(2, 0);
  (void)scan_by_second(11, 9'000);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::scanner_offline));
  EXPECT_EQ(line_.scans.size(), 3U) << "no request waits behind the one that hangs";

  ScanDone late;
  late.arm = 1;
  late.cmd_seq = line_.scans.front().request.cmd_seq;
  late.slot = line_.scans.front().slot;
  late.code = Code::interrupted;
  late.durable = true;
  line_.scanner_2_answers = true;
  line_.worker_hangs = false;
  line_.feed(late);
  hangs.scanner_hangs = false;
  line_.feed(hangs);
  for (const bool busy : line_.station->slot_busy) EXPECT_FALSE(busy);
  (void)scan_by_second(11);
  EXPECT_EQ(record(11).attempt.arm, 1);
  EXPECT_EQ(record(11).phase, StationPhase::measured);
}

TEST_F(ArmsTest, an_unseen_scan_of_one_scanner_costs_only_that_one_a_further_scan) {
  begin();
  line_.scan_code_2 = Code::trigger_timeout;
  (void)scan_by_second(10);
  line_.scan_code_2 = Code::ok;
  line_.fingerprint = 4'711;
  line_.scan(1);
  EXPECT_NE(line_.scans.back().request.session, 0);
  EXPECT_EQ(line_.scans.size(), 2U);
  line_.fingerprint = 4'713;
  line_.fingerprint_thrown_away = 4'715;
  (void)scan_by_second(10, 2'000);
  ASSERT_EQ(line_.scans.size(), 4U);
  EXPECT_EQ(line_.scans[2].request.session, 0) << "one is discarded first";
  EXPECT_EQ(line_.scans[2].arm, 1);
  expect_scanned(10, 1);
}

TEST_F(ArmsTest, without_a_tie_only_the_stations_of_the_first_robot_are_scanned) {
  for (const bool missing : {true, false}) {
    store_ = MemoryStore{};
    store_.line.calibration.arm[0] = hand_eye("he-1");
    store_.line.calibration.arm[1] = hand_eye("he-2");
    if (!missing) {
      store_.line.calibration.tie.id = "ti-1";
      store_.line.calibration.tie.numbers.robot = "2";
      store_.line.calibration.tie.hand_eye_id = {CalibrationId("he-1"), CalibrationId("he-3")};
    }
    line_.scans.clear();
    line_.logged.clear();
    line_.plc = {};
    start();
    EXPECT_TRUE(says("robot 2, scanner right: "));
    EXPECT_EQ(line_.view().fault, 0) << "the other arm may scan";
    begin();
    EXPECT_TRUE(store_.line.slab.tie_id.empty());
    (void)scan_by_second(10);
    EXPECT_EQ(line_.view().cmd_status, failed(Code::calibration_missing)) << missing;
    EXPECT_TRUE(line_.scans.empty());
    line_.scan(1);
    expect_scanned(1, 0);
    line_.scan(9);
    expect_scanned(9, 0);
  }
}

TEST_F(ArmsTest, without_the_first_calibration_only_the_second_robot_scans) {
  store_.line.calibration.arm[0].trouble = "the numbers were changed";
  store_.line.calibration.arm[0].source = LineCalibration::Source::missing;
  start();
  EXPECT_EQ(line_.view().fault, 0);
  EXPECT_TRUE(says("robot 1, scanner 1: no usable calibration"));
  begin();
  EXPECT_TRUE(store_.line.slab.calibration_id.empty());
  line_.scan(1);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::calibration_missing));
  (void)scan_by_second(10);
  expect_scanned(10, 1);
  (void)scan_by_second(9);
  expect_scanned(9, 1);
}

TEST_F(ArmsTest, without_any_calibration_no_slab_begins) {
  store_.line.calibration.arm[0].trouble = "the numbers were changed";
  store_.line.calibration.arm[0].source = LineCalibration::Source::missing;
  store_.line.calibration.tie = {};
  start();
  EXPECT_EQ(line_.view().fault, static_cast<std::uint16_t>(Code::calibration_missing));
  EXPECT_FALSE(line_.view().ready);
}

TEST_F(ArmsTest, a_tie_that_expires_during_a_slab_is_used_to_its_end) {
  store_.line.calibration.tie.expires_utime_us = 4'000'000;  // the line's clock starts at two seconds
  start();
  begin();
  line_.run_for(3'000);
  (void)scan_by_second(10);
  expect_scanned(10, 1);
  EXPECT_TRUE(arm_fault(*line_.station, 1).any()) << "for the next slab";
}

TEST_F(ArmsTest, a_restart_in_mid_slab_keeps_the_scans_of_both_and_goes_on) {
  begin();
  line_.scan(1);
  line_.measuring_works = false;
  (void)scan_by_second(10);
  ASSERT_EQ(record(10).phase, StationPhase::acquired);
  const MeasureBlock before = line_.measured.back();
  ASSERT_EQ(before.arm, 1);

  store_.line.slab_calibration = store_.line.calibration;  // found by storage through the header's ids
  store_.line.calibration.tie = {};
  store_.line.calibration.arm[1] = hand_eye("he-9");
  store_.restart_computer();  // the mark of its measurement proves nothing
  line_.measuring_works = true;
  start();
  line_.run_for(200);
  expect_scanned(1, 0);
  expect_scanned(10, 1);
  const MeasureBlock& again = line_.measured.back();
  EXPECT_TRUE(again.reload);
  EXPECT_EQ(again.arm, 1);
  EXPECT_EQ(again.T_base_scanner.to_array(), before.T_base_scanner.to_array()) << "the same bits";
  (void)scan_by_second(11);
  expect_scanned(11, 1);
  EXPECT_EQ(line_.view().fault, 0);
}

TEST_F(ArmsTest, a_restart_with_other_arms_refuses_the_stations_of_an_arm_that_the_slab_does_not_have) {
  begin();
  (void)scan_by_second(10);
  store_.line.slab_calibration = store_.line.calibration;
  line_.settings.arms.list[1].scanner = "spare";
  start();
  EXPECT_EQ(record(10).phase, StationPhase::measured);
  (void)scan_by_second(11);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::calibration_missing));
  line_.scan(1);
  expect_scanned(1, 0);
}

TEST_F(ArmsTest, a_restart_with_exchanged_scanners_refuses_the_stations_of_both_arms) {
  begin();
  store_.line.slab_calibration = store_.line.calibration;
  std::swap(line_.settings.arms.list[0].scanner, line_.settings.arms.list[1].scanner);
  start();
  line_.scan(1);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::calibration_missing)) << "no hand-eye of another scanner is used";
  (void)scan_by_second(11);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::calibration_missing));
}

TEST_F(ArmsTest, a_restart_with_another_first_scanner_refuses_its_stations) {
  begin();
  line_.scan(1);
  expect_scanned(1, 0);
  store_.line.slab_calibration = store_.line.calibration;
  line_.settings.arms.list[0].scanner = "spare";
  start();
  line_.scan(2);
  EXPECT_EQ(line_.view().cmd_status, failed(Code::calibration_missing));
  (void)scan_by_second(11);
  expect_scanned(11, 1);
}

TEST_F(ArmsTest, a_restart_with_another_first_scanner_is_noticed_before_its_first_scan) {
  for (const bool is_another : {false, true}) {
    begin();
    store_.line.slab_calibration = store_.line.calibration;
    store_.line.slab_calibration.arm[0].of_scanner = is_another ? "broken" : line_.settings.arms.list[0].scanner.view();
    start();
    line_.scan(1);
    EXPECT_EQ(line_.view().cmd_status == failed(Code::calibration_missing), is_another);
    line_.command(PlcCommand::slab_abort);
    line_.run_for(500);
  }
}

TEST_F(ArmsTest, a_view_is_taken_by_the_scanner_that_is_named) {
  CaptureRequest request;
  request.action = CaptureRequest::Action::begin;
  request.session = "tie";
  request.operator_name = "anna";
  request.lease_s = 300;
  line_.feed(request);
  EXPECT_EQ(line_.station->capture.refusal.code, Code::config);
  EXPECT_NE(line_.station->capture.refusal.text.view().find("1, right"), std::string_view::npos)
      << line_.station->capture.refusal.text.view();
  request.scanner = "left";
  line_.feed(request);
  EXPECT_EQ(line_.station->capture.refusal.code, Code::config);
  request.scanner = "right";
  line_.feed(request);
  ASSERT_EQ(line_.station->capture.refusal.code, Code::ok) << line_.station->capture.refusal.text.view();
  line_.robot_2_station = 12;
  line_.robot_shakes = true;  // the other robot
  line_.run_for(100);
  request.action = CaptureRequest::Action::shoot;
  line_.feed(request);
  line_.run_for(3'000);
  const CaptureShot& shot = line_.station->capture.shot;
  ASSERT_TRUE(shot.done);
  ASSERT_EQ(shot.code, Code::ok) << shot.text.view();
  EXPECT_EQ(line_.scans.back().arm, 1);
  EXPECT_EQ(line_.scans.back().request.by.scanner.view(), "right");
  const Pose T_base_flange = T_slab_block(line_.recipe, 12) * nominal_T_block_scanner();
  EXPECT_LT(((base_of_second() * shot.T_base_flange).translation_mm - T_base_flange.translation_mm).norm(), 1e-6);
}

TEST_F(ArmsTest, another_hand_eye_makes_the_tie_stale_for_the_next_slab) {
  begin();
  CellCalibration next = store_.line.calibration;
  next.arm[1].id = "he-9";
  line_.feed(CalibrationChanged{&next});
  line_.run_for(20);
  (void)scan_by_second(10);
  expect_scanned(10, 1);
  EXPECT_EQ(arm_fault(*line_.station, 1).tie, TieFault::stale);
  EXPECT_TRUE(says("calibration he-9 is in force from the next slab on (robot 2, scanner right)"));
}

}  // namespace
}  // namespace slabd::daemon
