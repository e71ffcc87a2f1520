// SPDX-License-Identifier: Apache-2.0
#include "base/calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/jobs.h"

namespace slabd {
namespace {

constexpr std::int64_t kNow = 1'000'000;

LineCalibration applied() {
  LineCalibration c;
  c.source = LineCalibration::Source::applied;
  c.id = "he-1";
  c.hand_eye.sigma_mm = 0.02;
  c.hand_eye.sigma_rad = 1e-5;
  StationsInForce table;
  table.id = "st-1";
  table.hand_eye_id = "he-1";
  table.table.slab_type = 5600;
  StationCorrection& s = table.table.station[2];
  s.visits = 5;
  s.T_base_reported.translation_mm = Vec3(0.7, 0.0, -0.3);
  s.T_base_flange.translation_mm = Vec3(1000.0, 0.0, 900.0);
  s.sigma_mm = 0.02;
  s.sigma_rad = 1e-5;
  EXPECT_TRUE(c.tables.push(table));
  return c;
}

SpliceSettings robot() {
  SpliceSettings s;
  s.absolute_mm = 0.7;
  s.absolute_rad = 5e-4;
  s.repeatability_mm = 0.017;
  s.commissioning_mm = 0.03;
  s.commissioning_rad = 2e-5;
  return s;
}

Pose at(double x_mm, double turn_rad = 0.0) {
  Pose pose;
  pose.translation_mm = Vec3(x_mm, 0.0, 900.0);
  pose.rotation = rotation_from_kuka_abc(turn_rad, 0.0, 0.0);
  return pose;
}

Splice splice(const LineCalibration& c, const Pose& T_base_flange, int station = 3, std::uint16_t slab_type = 5600) {
  return splice_for(c, robot(), slab_type, station, T_base_flange, 700.0, kNow);
}

TEST(Splice, near_the_mastered_pose_is_corrected_with_the_uncertainty_of_the_visits) {
  const Splice s = splice(applied(), at(1000.5));
  EXPECT_EQ(s.source, SpliceSource::corrected);
  EXPECT_EQ(s.T_base_reported.translation_mm, Vec3(0.7, 0.0, -0.3));
  EXPECT_DOUBLE_EQ(s.off_mm, 0.5);
  EXPECT_DOUBLE_EQ(std::hypot(s.robot_mm, s.calibration_mm), 0.02 * std::sqrt(1.0 + 1.0 / 5.0));
}

TEST(Splice, away_from_the_mastered_pose_is_hand_eye_alone_with_the_robots_absolute_accuracy) {
  for (const Pose& pose : {at(1001.5), at(1000.0, rad_from_deg(0.06))}) {
    const Splice s = splice(applied(), pose);
    EXPECT_EQ(s.source, SpliceSource::outside_gate);
    EXPECT_EQ(s.T_base_reported.translation_mm, Vec3::Zero());
    EXPECT_TRUE(has_value(s.off_mm)) << "the distance is known";
    EXPECT_DOUBLE_EQ(s.robot_mm, std::hypot(0.7, 5e-4 * 700.0)) << "a turned flange shifts the block by its lever";
    EXPECT_GE(s.calibration_mm, 0.02);
  }
}

TEST(Splice, corrections_of_another_hand_eye_are_stale) {
  LineCalibration c = applied();
  c.id = "he-2";
  EXPECT_EQ(splice(c, at(1000.0)).source, SpliceSource::stale);
}

TEST(Splice, corrections_expire) {
  LineCalibration c = applied();
  c.tables[0].expires_utime_us = kNow;
  EXPECT_EQ(splice(c, at(1000.0)).source, SpliceSource::expired);
  c.tables[0].expires_utime_us = kNow + 1;
  EXPECT_EQ(splice(c, at(1000.0)).source, SpliceSource::corrected);
}

TEST(Splice, other_stations_and_slab_types_were_not_mastered) {
  EXPECT_EQ(splice(applied(), at(1000.0), 4).source, SpliceSource::not_mastered);
  EXPECT_EQ(splice(applied(), at(1000.0), 3, 4925).source, SpliceSource::not_mastered);
}

TEST(Splice, has_unknown_accuracy_for_a_robot_without_a_specification) {
  SpliceSettings silent;
  const Splice s = splice_for(applied(), silent, 5600, 4, at(1000.0), 700.0, kNow);
  EXPECT_TRUE(std::isnan(s.robot_mm)) << "items of the slab frame are then indeterminate";
}

TEST(Splice, commissioning_values_keep_their_own_word) {
  LineCalibration c;
  c.source = LineCalibration::Source::commissioning;
  const Splice s = splice(c, at(1000.0));
  EXPECT_EQ(s.source, SpliceSource::commissioning);
  EXPECT_EQ(s.calibration_mm, 0.03);
  EXPECT_EQ(s.robot_mm, 0.017);
}

TEST(Splice, zeroed_memory_has_no_splice) {
  const Splice s = splice(LineCalibration{}, at(1000.0));
  EXPECT_EQ(s.source, SpliceSource::none);
  EXPECT_TRUE(std::isnan(s.calibration_mm));
}

/// Two arms whose bases are tied.
CellCalibration tied() {
  CellCalibration c;
  c.arm[0] = applied();
  c.arm[1] = applied();
  c.arm[1].id = "he-2";
  c.arm[1].tables[0].hand_eye_id = "he-2";
  c.tie.id = "ti-1";
  c.tie.numbers.robot = "right";
  c.tie.numbers.T_base_robot.translation_mm = Vec3(4000.0, 1.0, -2.0);
  c.tie.hand_eye_id = {c.arm[0].id, c.arm[1].id};
  return c;
}

TEST(Splice, a_scan_of_the_second_arm_is_tied_to_the_base_frame) {
  const CellCalibration c = tied();
  const Splice first = splice_for(c, 0, robot(), 5600, 3, at(1000.0), 700.0, kNow);
  EXPECT_EQ(first.source, SpliceSource::corrected);
  EXPECT_FALSE(first.tied);
  EXPECT_EQ(first.T_base_robot.to_array(), Pose::identity().to_array());
  const Splice second = splice_for(c, 1, robot(), 5600, 3, at(1000.0), 700.0, kNow);
  EXPECT_EQ(second.source, SpliceSource::corrected) << "by the table of its own scanner";
  EXPECT_TRUE(second.tied);
  EXPECT_EQ(second.T_base_robot.translation_mm, Vec3(4000.0, 1.0, -2.0));
  CellCalibration loose = c;
  loose.tie = {};
  EXPECT_EQ(splice_for(loose, 1, robot(), 5600, 3, at(1000.0), 700.0, kNow).source, SpliceSource::none);
}

TEST(Splice, the_place_of_the_scanner_is_that_of_its_arm) {
  SlabHeader slab;
  slab.T_flange_scanner.translation_mm = Vec3(1.0, 0.0, 0.0);
  SlabArm arm;
  arm.T_flange_scanner.translation_mm = Vec3(0.0, 10.0, 0.0);
  ASSERT_TRUE(slab.more_arms.push(arm));
  Attempt attempt;
  attempt.T_base_flange.translation_mm = Vec3(100.0, 0.0, 0.0);
  attempt.splice.source = SpliceSource::corrected;
  attempt.splice.T_base_reported.translation_mm = Vec3(0.0, 0.0, 0.5);
  EXPECT_EQ(stored_T_base_scanner(slab, attempt).translation_mm, Vec3(101.0, 0.0, 0.5));
  attempt.arm = 1;
  attempt.splice.tied = true;
  attempt.splice.T_base_robot.rotation = Quat(0.0, 0.0, 0.0, 1.0);  // half a turn about Z
  attempt.splice.T_base_robot.translation_mm = Vec3(4000.0, 0.0, 0.0);
  EXPECT_LT((stored_T_base_scanner(slab, attempt).translation_mm - Vec3(3900.0, -10.0, 0.5)).norm(), 1e-12);
  attempt.arm = 2;
  EXPECT_FALSE(stored_T_base_scanner(slab, attempt).all_finite()) << "the slab has no such arm";
}

TEST(Tie, belongs_to_the_two_hand_eye_calibrations_it_was_solved_with) {
  CellCalibration c = tied();
  const PartId right("right");
  EXPECT_EQ(fault_of_tie(c, right, kNow), TieFault::none);
  EXPECT_EQ(fault_of_tie(c, PartId("2"), kNow), TieFault::stale) << "of another robot";
  c.tie.expires_utime_us = kNow;
  EXPECT_EQ(fault_of_tie(c, right, kNow), TieFault::expired);
  EXPECT_EQ(fault_of_tie(c, right, kNow - 1), TieFault::none);
  c.arm[0].id = "he-9";
  EXPECT_EQ(fault_of_tie(c, right, kNow - 1), TieFault::stale);
  c.tie.trouble = "changed";
  EXPECT_EQ(fault_of_tie(c, right, kNow - 1), TieFault::unusable);
  c.tie = {};
  EXPECT_EQ(fault_of_tie(c, right, kNow), TieFault::missing);
  for (const auto fault : {TieFault::missing, TieFault::unusable, TieFault::stale, TieFault::expired})
    EXPECT_NE(describe(fault, c).view().find("slabctl calibrate tie"), std::string_view::npos) << "the cure is named";
  EXPECT_TRUE(describe(TieFault::none, c).empty());
}

TEST(Tie, has_a_parent_of_two_ids) {
  EXPECT_EQ(tie_parent("he-1", "he-2").view(), "he-1+he-2");
  const auto both = hand_eyes_of_tie("he-1+commissioning-0123456789ab");
  ASSERT_TRUE(both.has_value());
  EXPECT_EQ((*both)[0].view(), "he-1");
  EXPECT_EQ((*both)[1].view(), "commissioning-0123456789ab");
  for (const char* wrong : {"", "he-1", "+", "he-1+", "+he-2", "he-1+he-2+he-3"})
    EXPECT_FALSE(hand_eyes_of_tie(wrong).has_value()) << wrong;
}

TEST(LineArms, has_one_arm_for_every_station_unless_configured) {
  const LineArms arms;
  ASSERT_EQ(arms.list.size(), 1U);
  EXPECT_EQ(arms.list[0].robot.view(), "1");
  EXPECT_EQ(arms.list[0].scanner.view(), "1");
  EXPECT_FALSE(arms.several());
  for (const ArmChoice& choice : arms.of_station) {
    ASSERT_EQ(choice.size(), 1U);
    EXPECT_EQ(choice[0], 0);
  }
}

TEST(CalibrationFault, missing_expired_and_failed_checks_keep_slabs_from_beginning) {
  EXPECT_EQ(fault_of(LineCalibration{}, kNow), CalibrationFault::missing);
  LineCalibration c = applied();
  EXPECT_EQ(fault_of(c, kNow), CalibrationFault::none);
  c.expires_utime_us = kNow;
  EXPECT_EQ(fault_of(c, kNow), CalibrationFault::expired);
  EXPECT_EQ(fault_of(c, kNow - 1), CalibrationFault::none);
  c.expires_utime_us = 0;
  c.ball.failed = true;
  EXPECT_EQ(fault_of(c, kNow), CalibrationFault::check_failed);
  for (const auto fault : {CalibrationFault::missing, CalibrationFault::expired, CalibrationFault::check_failed})
    EXPECT_NE(describe(fault, c).view().find("slabctl calibrate"), std::string_view::npos) << "the cure is named";
}

TEST(CheckDue, counts_from_the_last_check_or_from_taking_the_artefact_into_use) {
  LineCalibration::Watch watch;
  EXPECT_FALSE(overdue(watch, 100, kNow)) << "no artefact, nothing due";
  watch.reference_id = "rb-1";
  watch.since_utime_us = 1'000;
  EXPECT_FALSE(overdue(watch, 100, 1'100));
  EXPECT_TRUE(overdue(watch, 100, 1'101));
  watch.checked_utime_us = 1'050;
  EXPECT_FALSE(overdue(watch, 100, 1'150));
  EXPECT_TRUE(overdue(watch, 100, 1'151));
  watch.since_utime_us = 1'140;
  EXPECT_TRUE(overdue(watch, 100, 1'151)) << "another artefact does not count as a check";
  EXPECT_FALSE(overdue(watch, 0, kNow)) << "interval 0: never";
  constexpr std::int64_t kHour_us = 3'600'000'000;
  watch.checked_utime_us = kNow + kHour_us;
  EXPECT_FALSE(overdue(watch, 100, kNow)) << "the clock was set back a little";
  watch.checked_utime_us = kNow + kHour_us + 1;
  EXPECT_TRUE(overdue(watch, 100, kNow)) << "the clock was wrong: the time of the check is unknown";
}

TEST(CalibrationKind, has_a_word_that_comes_back) {
  for (std::size_t i = 0; i < kCalibrationKinds; ++i) {
    const auto kind = static_cast<CalibrationKind>(i);
    EXPECT_EQ(calibration_kind_named(name(kind)), kind);
  }
  EXPECT_FALSE(calibration_kind_named("hand-eye").has_value());
}

TEST(ScannerAcceptance, is_valid_while_it_is_neither_out_of_limits_nor_too_old) {
  ScannerInForce scanner;
  EXPECT_EQ(acceptance_state(scanner, 1), AcceptanceState::never);
  scanner.id = "sc-1";
  scanner.numbers.within_limits = true;
  EXPECT_EQ(acceptance_state(scanner, 1), AcceptanceState::verified);
  scanner.expires_utime_us = 100;
  EXPECT_EQ(acceptance_state(scanner, 99), AcceptanceState::verified);
  EXPECT_EQ(acceptance_state(scanner, 100), AcceptanceState::expired);
  scanner.failed = true;
  EXPECT_EQ(acceptance_state(scanner, 100), AcceptanceState::failed);
  scanner.failed = false;
  scanner.numbers.within_limits = false;
  EXPECT_EQ(acceptance_state(scanner, 1), AcceptanceState::failed);
  for (const auto& [standing, word] : {std::pair{AcceptanceState::verified, "verified"},
                                       {AcceptanceState::never, "never"},
                                       {AcceptanceState::expired, "expired"},
                                       {AcceptanceState::failed, "failed"},
                                       {AcceptanceState::other_temperature, "other_temperature"}})
    EXPECT_EQ(name(standing), word);
}

TEST(ScannerDrift, grows_with_the_distance_from_the_acceptances_temperature_and_is_unknown_without_both) {
  ScannerNumbers accepted;
  const ScannerDriftSettings settings;
  EXPECT_TRUE(std::isnan(scanner_drift(settings, accepted, 31.0)));
  EXPECT_FALSE(is_outside_temperature(settings, accepted, 100.0));
  accepted.temperature_c = 30.0;
  EXPECT_TRUE(std::isnan(scanner_drift(settings, accepted, kNoValue)));
  EXPECT_FALSE(is_outside_temperature(settings, accepted, kNoValue));
  EXPECT_EQ(scanner_drift(settings, accepted, 30.0), 0.0);
  EXPECT_DOUBLE_EQ(scanner_drift(settings, accepted, 40.0), 250e-6);
  EXPECT_DOUBLE_EQ(scanner_drift(settings, accepted, 20.0), 250e-6);
  EXPECT_FALSE(is_outside_temperature(settings, accepted, 45.0));
  EXPECT_TRUE(is_outside_temperature(settings, accepted, 45.1));
  EXPECT_TRUE(is_outside_temperature(settings, accepted, 14.9));
}

TEST(ScannerAcceptance, at_another_temperature_is_a_state_of_its_own_and_the_weakest) {
  ScannerInForce scanner;
  EXPECT_EQ(acceptance_state(scanner, 1, true), AcceptanceState::never);
  scanner.id = "sc-1";
  scanner.numbers.within_limits = true;
  scanner.expires_utime_us = 100;
  EXPECT_EQ(acceptance_state(scanner, 99, true), AcceptanceState::other_temperature);
  EXPECT_EQ(acceptance_state(scanner, 100, true), AcceptanceState::expired);
}

}  // namespace
}  // namespace slabd
