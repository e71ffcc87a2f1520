// SPDX-License-Identifier: Apache-2.0
//
// The calibration in force, as seen by the PLC and in the records.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

constexpr std::uint16_t kRefused503 = 0x8000 + 503;

LineCalibration hand_eye(const char* id, double x_mm = 0.0) {
  LineCalibration c;
  c.source = LineCalibration::Source::applied;
  c.id = id;
  c.hand_eye.T_flange_scanner.translation_mm = Vec3(x_mm, 0.0, 0.0);
  c.hand_eye.sigma_mm = 0.02;
  c.hand_eye.sigma_rad = 1e-5;
  return c;
}

/// Every station of the test slab is mastered at the test robot's position.
LineCalibration mastered(const char* id, const Recipe& recipe) {
  LineCalibration c = hand_eye(id);
  StationsInForce table;
  table.id = "st-1";
  table.hand_eye_id = id;
  table.table.slab_type = recipe.slab_type;
  for (int k = 1; k <= recipe.stations(); ++k) {
    StationCorrection& s = table.table.station[static_cast<std::size_t>(k - 1)];
    s.visits = 5;
    s.T_base_flange = T_slab_block(recipe, k) * nominal_T_block_scanner();
    s.T_base_reported.translation_mm = Vec3(0.25, 0.0, 0.5);
    s.sigma_mm = 0.02;
    s.sigma_rad = 1e-5;
  }
  EXPECT_TRUE(c.tables.push(table));
  return c;
}

LineCalibration with_scanner(const char* id, double form_half_mm) {
  LineCalibration c = hand_eye("he-1");
  c.scanner.id = id;
  c.scanner.numbers.form_half_mm = form_half_mm;
  c.scanner.numbers.within_limits = true;
  return c;
}

/// Puts it in force for the next slab.
void change(Line& line, const LineCalibration& calibration) {
  CellCalibration cell;
  cell.arm[0] = calibration;
  line.feed(CalibrationChanged{&cell});
}

bool says(const std::vector<std::string>& lines, std::string_view text) {
  return std::any_of(lines.begin(), lines.end(),
                     [&](const std::string& line) { return line.find(text) != std::string::npos; });
}

const SlabHeader& begun(const MemoryStore& store) {
  return store.line.slab;
}

TEST(StationCalibration, commissioning_values_are_used_with_a_warning_until_one_is_applied) {
  MemoryStore store;
  Line line(store);
  EXPECT_NE(line.view().warn & kWarnCommissioningCalibration, 0);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_EQ(begun(store).calibration_id.view(), "cal");
  line.scan(1);
  EXPECT_EQ(store.line.stations[0].attempt.splice.source, SpliceSource::commissioning);

  MemoryStore applied;
  applied.line.calibration.arm[0] = hand_eye("he-1", 5.0);
  Line other(applied);
  EXPECT_EQ(other.view().warn & kWarnCommissioningCalibration, 0);
  other.command(PlcCommand::slab_begin);
  other.run_for(20);
  EXPECT_EQ(begun(applied).calibration_id.view(), "he-1");
  EXPECT_EQ(begun(applied).T_flange_scanner.translation_mm.x(), 5.0);
}

TEST(StationCalibration, handedness_is_unproven_until_a_calibration_is_applied_and_the_open_slab_has_ended) {
  MemoryStore store;
  Line line(store);
  EXPECT_NE(line.view().warn & kWarnHandednessUnproven, 0);
  EXPECT_TRUE(says(line.logged, "nothing proves that the scanner's frame is right-handed"));
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  const LineCalibration now = hand_eye("he-1");
  change(line, now);
  line.run_for(20);
  EXPECT_EQ(line.view().warn & kWarnCommissioningCalibration, 0);
  EXPECT_NE(line.view().warn & kWarnHandednessUnproven, 0) << "the open slab is measured with the values it began with";
  line.scan(1);
  line.command(PlcCommand::slab_end);
  line.run_for(100);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().warn & kWarnHandednessUnproven, 0);

  MemoryStore applied;
  applied.line.calibration.arm[0] = hand_eye("he-1");
  Line other(applied);
  EXPECT_EQ(other.view().warn & kWarnHandednessUnproven, 0);
  EXPECT_FALSE(says(other.logged, "right-handed"));

  MemoryStore adopted;
  adopted.line.calibration.arm[0] = hand_eye("he-2");
  adopted.line.calibration.arm[0].trouble = "he-2 was adopted: no views prove that the scanner's frame is right-handed";
  Line third(adopted);
  EXPECT_NE(third.view().warn & kWarnHandednessUnproven, 0);
  EXPECT_EQ(third.view().warn & kWarnCommissioningCalibration, 0);
  EXPECT_EQ(third.view().fault, 0) << "it is used all the same";
  EXPECT_TRUE(says(third.logged, "he-2 was adopted: no views prove"));
}

TEST(StationCalibration, an_applied_calibration_that_cannot_be_used_is_never_replaced_by_commissioning_values) {
  MemoryStore store;
  store.line.calibration.arm[0].id = "he-1";
  store.line.calibration.arm[0].trouble = "the numbers were changed";
  Line line(store);
  EXPECT_EQ(line.view().fault, 503);
  EXPECT_EQ(line.view().state, PlcState::fault);
  const std::uint16_t seq = line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_EQ(line.view().cmd_ack, seq);
  EXPECT_EQ(line.view().cmd_status, kRefused503);
  EXPECT_FALSE(line.view().slab_open);
}

TEST(StationCalibration, an_expired_one_refuses_the_next_slab_and_finishes_the_open_one) {
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  store.line.calibration.arm[0].expires_utime_us = 4'000'000;  // the line's clock starts at two seconds
  Line line(store);
  EXPECT_EQ(line.view().fault, 0);
  line.command(PlcCommand::slab_begin);
  line.run_for(5'000);
  EXPECT_EQ(line.view().fault, 0) << "a slab that was begun is finished";
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  line.command(PlcCommand::slab_end);
  line.run_for(100);
  EXPECT_FALSE(line.view().slab_open);
  EXPECT_EQ(line.view().fault, 503);
  line.plc.fault_reset = true;
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_EQ(line.view().fault, 503) << "a reset does not make it younger";
}

TEST(StationCalibration, a_failed_check_stops_the_line_and_a_passed_one_releases_it) {
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  Line line(store);
  LineCalibration now = hand_eye("he-1");
  now.block.reference_id = "rb-1";
  now.block.failed = true;
  change(line, now);
  EXPECT_EQ(line.view().fault, 503);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_FALSE(line.view().slab_open);
  now.block.failed = false;
  change(line, now);
  EXPECT_EQ(line.view().fault, 0);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_TRUE(line.view().slab_open);
}

TEST(StationCalibration, an_overdue_check_is_a_warning) {
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  store.line.calibration.arm[0].block.reference_id = "rb-1";
  store.line.calibration.arm[0].block.since_utime_us = 2'000'000;
  Line line(store);
  line.station->settings.check_interval_us = 3'000'000;
  line.run_for(1'000);
  EXPECT_EQ(line.view().warn & kWarnCheckOverdue, 0);
  line.run_for(4'000);
  EXPECT_NE(line.view().warn & kWarnCheckOverdue, 0);
  EXPECT_EQ(line.view().fault, 0);
}

TEST(StationCalibration, a_change_waits_for_the_next_slab) {
  MemoryStore store;
  store.line.calibration.arm[0] = mastered("he-1", test_recipe());
  Line line(store);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_EQ(begun(store).stations_id.view(), "st-1");
  line.scan(1);
  const LineCalibration other = hand_eye("he-2", 7.0);
  change(line, other);
  line.scan(2);
  for (const std::size_t i : {0U, 1U}) {
    EXPECT_EQ(store.line.stations[i].attempt.splice.source, SpliceSource::corrected) << i;
    const Vec3 nominal =
        (T_slab_block(line.recipe, static_cast<int>(i + 1)) * nominal_T_block_scanner()).translation_mm;
    EXPECT_LT((line.measured[i].T_base_scanner.translation_mm - nominal - Vec3(0.25, 0.0, 0.5)).norm(), 1e-9);
  }
  line.command(PlcCommand::slab_end);
  line.run_for(100);
  line.take_results();
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_EQ(begun(store).calibration_id.view(), "he-2");
  EXPECT_TRUE(begun(store).stations_id.empty());
  EXPECT_EQ(begun(store).T_flange_scanner.translation_mm.x(), 7.0);
}

TEST(StationCalibration, a_slab_begin_on_its_way_to_the_database_keeps_the_calibration_it_names) {
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  Line line(store);
  line.command(PlcCommand::slab_begin);  // journalled, not yet answered
  const LineCalibration other = hand_eye("he-2");
  change(line, other);
  line.run_for(20);
  ASSERT_TRUE(line.view().slab_open);
  EXPECT_EQ(line.station->slab.header.calibration_id.view(), "he-1");
  EXPECT_EQ(line.station->slab.calibration.arm[0].id.view(), "he-1");
  EXPECT_EQ(line.station->calibration.arm[0].id.view(), "he-2");
}

TEST(StationCalibration, a_restart_continues_with_the_open_slabs_calibration) {
  MemoryStore store;
  store.line.calibration.arm[0] = mastered("he-1", test_recipe());
  {
    Line line(store);
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    line.scan(1);
  }
  store.line.slab_calibration = store.line.calibration;  // found by storage through the header's ids
  store.line.calibration.arm[0] = hand_eye("he-2", 7.0);
  Line again(store);
  again.scan(2);
  EXPECT_EQ(store.line.stations[1].attempt.splice.source, SpliceSource::corrected);
  EXPECT_EQ(again.station->slab.calibration.arm[0].id.view(), "he-1");
}

TEST(StationCalibration, stale_corrections_are_not_used_and_not_named) {
  MemoryStore store;
  store.line.calibration.arm[0] = mastered("he-1", test_recipe());
  store.line.calibration.arm[0].id = "he-2";
  Line line(store);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_TRUE(begun(store).stations_id.empty());
  line.scan(1);
  EXPECT_EQ(store.line.stations[0].attempt.splice.source, SpliceSource::stale);
  EXPECT_NE(line.view().warn & kWarnStationsNotCorrected, 0);
}

TEST(StationCalibration, outside_the_gate_the_scan_is_spliced_without_its_correction_and_marked) {
  MemoryStore store;
  store.line.calibration.arm[0] = mastered("he-1", test_recipe());
  Line line(store);
  line.station->settings.splice.absolute_mm = 0.7;
  line.station->settings.splice.absolute_rad = 5e-4;
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  line.robot_off_mm = 2.0;
  line.scan(3);
  const Splice& splice = store.line.stations[2].attempt.splice;
  EXPECT_EQ(splice.source, SpliceSource::outside_gate);
  EXPECT_NEAR(splice.off_mm, 2.0, 1e-6);
  EXPECT_NEAR(splice.robot_mm, std::hypot(0.7, 5e-4 * 600.0), 1e-3);
  const Vec3 reported = store.line.stations[2].attempt.T_base_flange.translation_mm;
  EXPECT_LT((line.measured.back().T_base_scanner.translation_mm - reported).norm(), 1e-9);
  EXPECT_NE(line.view().warn & kWarnStationsNotCorrected, 0);
}

TEST(StationCalibration, a_new_one_ends_what_a_clock_that_was_ahead_has_let_expire) {
  constexpr std::int64_t kYear_us = 365 * std::int64_t{86'400'000'000};
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  store.line.calibration.arm[0].expires_utime_us = kYear_us;
  store.line.newest_utime_us = 2 * kYear_us;
  Line line(store);
  EXPECT_EQ(line.view().fault, 503);
  LineCalibration fresh = hand_eye("he-2");
  fresh.expires_utime_us = kYear_us + 1;
  change(line, fresh);
  line.run_for(20);
  line.plc.fault_reset = true;
  line.feed(line.plc);
  line.run_for(20);
  EXPECT_EQ(line.view().fault, 0);
}

/// The database accepts them and follows the clock; the station must do so without a restart.
TEST(StationCalibration, corrections_and_an_acceptance_made_after_a_clock_that_was_ahead_are_used_at_once) {
  constexpr std::int64_t kDay_us = 86'400'000'000;
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  store.line.newest_utime_us = 200 * kDay_us;
  Line line(store);
  ASSERT_NE(line.view().warn & kWarnClockBackwards, 0);
  for (const bool table : {true, false}) {
    SCOPED_TRACE(table ? "corrections" : "acceptance");
    line.station->newest_time = NewestTime(200 * kDay_us);
    LineCalibration fresh = table ? mastered("he-1", line.recipe) : with_scanner("sc-1", 0.06);
    (table ? fresh.tables[0].expires_utime_us : fresh.scanner.expires_utime_us) = 90 * kDay_us;
    change(line, fresh);
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    ASSERT_TRUE(line.view().slab_open);
    EXPECT_EQ(begun(store).stations_id.view(), table ? "st-1" : "");
    EXPECT_EQ(line.view().warn & kWarnScannerNotVerified, table ? kWarnScannerNotVerified : 0);
    line.command(PlcCommand::slab_abort);
    line.run_for(100);
    line.take_results();
  }
}

TEST(StationCalibration, corrections_that_expired_are_not_used_and_not_named) {
  MemoryStore store;
  store.line.calibration.arm[0] = mastered("he-1", test_recipe());
  store.line.calibration.arm[0].tables[0].expires_utime_us = 1;
  Line line(store);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_TRUE(begun(store).stations_id.empty());
  line.scan(1);
  EXPECT_EQ(store.line.stations[0].attempt.splice.source, SpliceSource::expired);
  EXPECT_NE(line.view().warn & kWarnStationsNotCorrected, 0);
}

TEST(StationCalibration, a_slab_is_measured_with_the_corrections_it_was_begun_with) {
  for (const bool expired_at_first : {false, true}) {
    SCOPED_TRACE(expired_at_first ? "a clock that was ahead when the slab began" : "expired amid the slab");
    MemoryStore store;
    store.line.calibration.arm[0] = mastered("he-1", test_recipe());
    Line line(store);
    const std::int64_t now_us = line.station->utime_us;
    auto& expires_us = line.station->calibration.arm[0].tables[0].expires_utime_us;
    expires_us = expired_at_first ? 1 : now_us + 1'000'000'000;
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    ASSERT_EQ(begun(store).stations_id.empty(), expired_at_first);
    const SpliceSource as_begun = expired_at_first ? SpliceSource::expired : SpliceSource::corrected;
    line.scan(1);
    EXPECT_EQ(store.line.stations[0].attempt.splice.source, as_begun);
    line.station->slab.calibration.arm[0].tables[0].expires_utime_us = expired_at_first ? INT64_MAX : 1;
    line.scan(2);
    EXPECT_EQ(store.line.stations[1].attempt.splice.source, as_begun);
  }
}

TEST(StationCalibration, corrections_that_will_expire_are_used_until_then) {
  MemoryStore store;
  store.line.calibration.arm[0] = mastered("he-1", test_recipe());
  store.line.calibration.arm[0].tables[0].expires_utime_us = INT64_MAX;
  Line line(store);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_EQ(begun(store).stations_id.view(), "st-1");
}

TEST(StationCalibration, a_station_that_was_never_mastered_among_others_that_were_is_a_warning) {
  MemoryStore store;
  store.line.calibration.arm[0] = mastered("he-1", test_recipe());
  store.line.calibration.arm[0].tables[0].table.station[1] = {};
  Line line(store);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  line.scan(1);
  EXPECT_EQ(line.view().warn & kWarnStationsNotCorrected, 0);
  line.scan(2);
  EXPECT_EQ(store.line.stations[1].attempt.splice.source, SpliceSource::not_mastered);
  EXPECT_NE(line.view().warn & kWarnStationsNotCorrected, 0);
}

TEST(StationCalibration, an_overdue_check_of_the_ball_is_a_warning_too) {
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  store.line.calibration.arm[0].ball.reference_id = "ball-1";
  store.line.calibration.arm[0].ball.since_utime_us = 2'000'000;
  Line line(store);
  line.station->settings.check_interval_us = 3'000'000;
  line.run_for(5'000);
  EXPECT_NE(line.view().warn & kWarnCheckOverdue, 0);
}

TEST(StationCalibration, a_calibration_that_fails_during_a_slab_stops_the_line_after_it) {
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  Line line(store);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  LineCalibration now = hand_eye("he-2");
  now.block.reference_id = "rb-1";
  now.block.failed = true;
  change(line, now);
  line.run_for(100);
  EXPECT_EQ(line.view().fault, 0) << "a slab that was begun is finished";
  line.scan(1);
  EXPECT_EQ(line.view().cmd_status, 4);
  line.command(PlcCommand::slab_end);
  line.run_for(100);
  EXPECT_EQ(line.view().fault, 503);
}

TEST(StationCalibration, a_line_with_neither_an_applied_nor_a_configured_calibration_begins_no_slab) {
  MemoryStore store;
  Line line(store);
  line.station->settings.calibration_id = "";
  const LineCalibration nothing;
  change(line, nothing);
  EXPECT_EQ(line.view().fault, 503);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_FALSE(line.view().slab_open);
}

TEST(StationCalibration, a_scanner_that_was_not_verified_is_only_a_warning) {
  MemoryStore store;
  store.line.calibration.arm[0] = hand_eye("he-1");
  Line line(store);
  EXPECT_NE(line.view().warn & kWarnScannerNotVerified, 0);
  EXPECT_EQ(line.view().fault, 0);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  EXPECT_TRUE(line.view().slab_open);
  EXPECT_TRUE(begun(store).scanner_id.empty());
  line.scan(1);
  ASSERT_FALSE(line.measured.empty());
  EXPECT_FALSE(has_value(line.measured.back().basis.verified[0].form_half_mm)) << "the recipe's specification alone";
}

TEST(StationCalibration, a_scanner_far_from_the_temperature_of_its_acceptance_measures_with_more_U_and_a_warning) {
  MemoryStore store;
  store.line.calibration.arm[0] = with_scanner("sc-1", 0.06);
  store.line.calibration.arm[0].scanner.numbers.temperature_c = 30.0;
  Line line(store);
  line.command(PlcCommand::slab_begin);
  line.run_for(20);
  line.scan(1);
  ASSERT_FALSE(line.measured.empty());
  EXPECT_TRUE(std::isnan(line.measured.back().scanner_drift)) << "the scan declares no temperature";
  EXPECT_EQ(line.view().warn & kWarnScannerNotVerified, 0);
  line.scanner_temperature_c = 40.0;
  line.scan(2);
  EXPECT_DOUBLE_EQ(line.measured.back().scanner_drift, 250e-6);
  EXPECT_DOUBLE_EQ(line.station->slab.stations[1].attempt.scanner_drift, 250e-6) << "stored for a replay";
  EXPECT_EQ(line.view().warn & kWarnScannerNotVerified, 0) << "within the range";
  line.scanner_temperature_c = 45.5;
  line.scan(3);
  EXPECT_DOUBLE_EQ(line.measured.back().scanner_drift, 25e-6 * 15.5);
  EXPECT_NE(line.view().warn & kWarnScannerNotVerified, 0);
  line.scanner_temperature_c = 35.0;
  line.scan(4);
  EXPECT_EQ(line.view().warn & kWarnScannerNotVerified, 0);
}

TEST(StationCalibration, a_slab_is_measured_with_the_acceptance_it_was_begun_with_also_over_a_restart) {
  MemoryStore store;
  store.line.calibration.arm[0] = with_scanner("sc-1", 0.06);
  {
    Line line(store);
    EXPECT_EQ(line.view().warn & kWarnScannerNotVerified, 0);
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    EXPECT_EQ(begun(store).scanner_id.view(), "sc-1");
    const LineCalibration next = with_scanner("sc-2", 0.09);
    change(line, next);
    line.scan(1);
    EXPECT_EQ(line.measured.back().basis.verified[0].form_half_mm, 0.06) << "the change is for the next slab";
    EXPECT_EQ(line.station->slab.calibration.arm[0].scanner.id.view(), "sc-1");
  }
  store.line.slab_calibration.arm[0] = with_scanner("sc-1", 0.06);
  store.line.calibration.arm[0] = with_scanner("sc-2", 0.09);
  Line restarted(store);
  restarted.scan(2);
  EXPECT_EQ(restarted.measured.back().basis.verified[0].form_half_mm, 0.06);
}

TEST(StationCalibration, an_acceptance_that_is_too_old_or_was_followed_by_a_failure_warns_and_stays_in_use) {
  for (const bool failed : {false, true}) {
    MemoryStore store;
    store.line.calibration.arm[0] = with_scanner("sc-1", 0.06);
    store.line.calibration.arm[0].scanner.failed = failed;
    if (!failed) store.line.calibration.arm[0].scanner.expires_utime_us = 1'000'000;  // the clock starts at two seconds
    Line line(store);
    EXPECT_NE(line.view().warn & kWarnScannerNotVerified, 0) << failed;
    EXPECT_EQ(line.view().fault, 0);
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    EXPECT_EQ(begun(store).scanner_id.view(), "sc-1");
    line.scan(1);
    EXPECT_EQ(line.measured.back().basis.verified[0].form_half_mm, 0.06) << "U does not fall because a day has passed";
  }
}

}  // namespace
}  // namespace slabd::daemon
