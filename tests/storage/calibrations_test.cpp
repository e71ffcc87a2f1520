// SPDX-License-Identifier: Apache-2.0
#include <sqlite3.h>

#include <functional>
#include <set>

#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class CalibrationsTest : public StoreTest {
 protected:
  CalibrationsTest() { open(); }

  CalibrationRecord hand_eye(double x_mm) {
    CalibrationRecord r;
    HandEyeNumbers numbers;
    numbers.T_flange_scanner.translation_mm = Vec3(x_mm, -0.0, 150.1234567890123);
    numbers.T_flange_scanner.rotation = Quat(0.9, 0.1, -0.3, 0.2).normalized();
    numbers.sigma_mm = 0.021;
    numbers.sigma_rad = 1.7e-5;
    r.numbers = numbers;
    r.figures = R"({"s0": 1.02})";
    r.observations = "# 20 views\n1 2 3 1 0 0 0\n";
    r.certificate = "ball 17, radius 19.0501";
    r.operator_name = "\xc3\x84nne O'Neill";
    r.robot_serial = "KR-4711";
    r.scanner_serial = "S-12";
    r.temperature_c = 21.5;
    r.software = "slabd 1.0.0";
    r.created_utime_us = 1000;
    return r;
  }
  CalibrationRecord stations(const std::string& parent, double shift_mm, std::uint16_t slab_type = 5600) {
    CalibrationRecord r = hand_eye(0.0);
    StationTable table;
    table.slab_type = slab_type;
    for (const std::size_t station : {1U, 7U, 18U}) {
      StationCorrection& c = table.station[station - 1];
      c.visits = 5;
      c.T_base_reported.translation_mm = Vec3(shift_mm, 0.2, static_cast<double>(station));
      c.T_base_flange.translation_mm = Vec3(1000.0, 2000.0, 3000.0);
      c.sigma_mm = 0.019;
      c.sigma_rad = 2e-5;
      c.spread_mm = 0.018;
    }
    r.numbers = table;
    r.parent_id = parent;
    return r;
  }
  CalibrationRecord reference_block() {
    CalibrationRecord r = hand_eye(0.0);
    r.numbers = ReferenceBlock{0.025, 2e-5, 380.01, 0.004};
    return r;
  }

  CalibrationRecord scanner(double form_half_mm, bool within_limits = true) {
    CalibrationRecord r = hand_eye(0.0);
    ScannerNumbers n;
    n.scanner = "SN \xc3\x84-7";
    n.PF_mm = 0.08;
    n.PS_mm = 0.0123456789012345;
    n.RF_mm = 0.12;
    n.form_half_mm = form_half_mm;
    n.form_length_mm = 113.7;
    n.noise_sigma_mm = 0.021;
    n.noise_correlation_mm = kNoValue;  // points without rows
    n.pitch_mm = -kNoValue;
    n.plates = 6;
    n.balls = 10;
    n.within_limits = within_limits;
    r.numbers = n;
    return r;
  }

  std::string keep(const CalibrationRecord& record) {
    const Result<std::string> id = store_->change(KeepCalibration{record});
    EXPECT_TRUE(id.ok()) << id.error().text.view();
    return id.ok() ? id.value() : "";
  }
  ChangeNote note(const std::string& why = "test") { return {"anna", why, ++utime_us_}; }
  void put_in_force(const std::string& id) {
    const Result<std::string> done = store_->change(ApplyCalibration{id, note()});
    EXPECT_TRUE(done.ok()) << done.error().text.view();
  }
  std::string refused(const CalibrationChange& change) {
    const Result<std::string> done = store_->change(change);
    EXPECT_FALSE(done.ok());
    if (done.ok()) return "";
    EXPECT_EQ(done.error().code, Code::config);
    return std::string(done.error().text.view());
  }
  /// Calibrations of the whole line.
  std::unique_ptr<CellCalibration> cell_in_force() {
    auto calibration = store_->calibration();
    EXPECT_TRUE(calibration.ok()) << calibration.error().text.view();
    return calibration.ok() ? std::move(calibration.value()) : std::make_unique<CellCalibration>();
  }
  LineCalibration in_force(std::size_t arm = 0) { return cell_in_force()->arm.at(arm); }
  /// Opens the store as that of a line with two robots, whose second scanner has the id "right".
  void with_two_arms() {
    close();
    settings_.arms.list.clear();
    ASSERT_TRUE(settings_.arms.list.push(Arm{}));
    ASSERT_TRUE(settings_.arms.list.push(Arm{PartId("2"), PartId("right")}));
    open();
  }
  static CalibrationRecord of_right(CalibrationRecord record) {
    record.scanner = "right";
    return record;
  }
  CalibrationRecord tie(const std::string& first, const std::string& second) {
    CalibrationRecord r = hand_eye(0.0);
    TieNumbers n;
    n.robot = "2";
    n.T_base_robot.translation_mm = Vec3(4000.25, -0.5, 3.0);
    n.T_base_robot.rotation = Quat(0.01, 0.0, 0.02, 1.0).normalized();
    n.centre_mm = Vec3(2000.0, 100.0, 700.0);
    n.covariance = Mat6::Identity() * 1e-4;
    n.targets = 6;
    n.rms_mm = 0.04;
    r.numbers = n;
    r.parent_id = std::string(tie_parent(CalibrationId(first), CalibrationId(second)).view());
    return r;
  }
  void on_the_disk(const std::string& sql) {
    close();
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(settings_.db_path.c_str(), &db), SQLITE_OK);
    char* message = nullptr;
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, &message), SQLITE_OK) << message;
    sqlite3_close(db);
    open();
  }

  std::int64_t utime_us_ = 10'000;
};

TEST_F(CalibrationsTest, no_calibration_is_in_force_in_a_fresh_database) {
  const LineCalibration line = in_force();
  EXPECT_EQ(line.source, LineCalibration::Source::missing);
  EXPECT_TRUE(line.trouble.empty());
  EXPECT_TRUE(line.tables.empty());
}

TEST_F(CalibrationsTest, an_adopted_calibration_is_used_and_does_not_prove_the_handedness) {
  put_in_force(keep(hand_eye(80.0)));
  EXPECT_TRUE(in_force().trouble.empty());
  CalibrationRecord adopted = hand_eye(81.0);
  adopted.observations = "# adopted from /etc/slabd/slabd.toml (commissioning-0123456789ab)\n";
  put_in_force(keep(adopted));
  const LineCalibration line = in_force();
  EXPECT_EQ(line.source, LineCalibration::Source::applied);
  EXPECT_NE(line.trouble.view().find("was adopted: no views prove that the scanner's frame is right-handed"),
            std::string_view::npos)
      << line.trouble.view();
}

TEST_F(CalibrationsTest, a_record_comes_back_bit_for_bit_and_under_an_id_made_of_its_numbers) {
  const CalibrationRecord given = hand_eye(80.0);
  const std::string id = keep(given);
  EXPECT_EQ(id.substr(0, 3), "he-");
  EXPECT_EQ(id.size(), 15U);
  const auto back = reader()->calibration(id);
  ASSERT_TRUE(back.ok() && back.value().has_value());
  const CalibrationRecord& r = *back.value();
  EXPECT_EQ(r.id, id);
  const auto& a = std::get<HandEyeNumbers>(given.numbers);
  const auto& b = std::get<HandEyeNumbers>(r.numbers);
  EXPECT_EQ(a.T_flange_scanner.to_array(), b.T_flange_scanner.to_array());
  EXPECT_EQ(a.sigma_mm, b.sigma_mm);
  EXPECT_EQ(a.sigma_rad, b.sigma_rad);
  EXPECT_EQ(r.figures, given.figures);
  EXPECT_EQ(r.observations, given.observations);
  EXPECT_EQ(r.certificate, given.certificate);
  EXPECT_EQ(r.operator_name, given.operator_name);
  EXPECT_EQ(r.robot_serial, given.robot_serial);
  EXPECT_EQ(r.scanner_serial, given.scanner_serial);
  EXPECT_EQ(r.temperature_c, given.temperature_c);
  EXPECT_EQ(r.software, given.software);
  EXPECT_EQ(r.created_utime_us, given.created_utime_us);

  EXPECT_EQ(keep(given), id) << "the same numbers again are the same record";
  EXPECT_NE(keep(hand_eye(80.0000000000001)), id) << "other numbers are another one, in the last digit too";
  EXPECT_EQ(reader()->calibrations().value().size(), 2U);
}

TEST_F(CalibrationsTest, the_first_characters_of_an_id_do_when_they_mean_one_record) {
  const std::string a = keep(hand_eye(1.0));
  const std::string b = keep(hand_eye(2.0));
  EXPECT_EQ(reader()->calibration(a.substr(0, 9)).value()->id, a);
  EXPECT_FALSE(reader()->calibration("he-").value().has_value()) << "two begin so";
  EXPECT_FALSE(reader()->calibration("%").value().has_value());
  EXPECT_FALSE(reader()->calibration("").value().has_value());
  EXPECT_NE(a, b);
}

TEST_F(CalibrationsTest, applied_is_used_kept_over_a_restart_and_rolled_back_step_by_step) {
  const std::string a = keep(hand_eye(1.0));
  const std::string b = keep(hand_eye(2.0));
  const std::string c = keep(hand_eye(3.0));
  for (const std::string& id : {a, b, c}) put_in_force(id);
  open();  // as after a restart
  EXPECT_EQ(in_force().id.view(), c);
  EXPECT_EQ(in_force().hand_eye.T_flange_scanner.translation_mm.x(), 3.0);
  EXPECT_EQ(recover()->calibration.arm[0].id.view(), c);

  EXPECT_EQ(store_->change(RollBackCalibration{CalibrationKind::hand_eye, 0, note()}).value(), b);
  EXPECT_EQ(in_force().id.view(), b);
  EXPECT_EQ(store_->change(RollBackCalibration{CalibrationKind::hand_eye, 0, note()}).value(), a);
  EXPECT_NE(refused(RollBackCalibration{CalibrationKind::hand_eye, 0, note()}).find("nothing to go back to"),
            std::string::npos);
  put_in_force(c);
  EXPECT_EQ(store_->change(RollBackCalibration{CalibrationKind::hand_eye, 0, note()}).value(), a);

  const auto history = reader()->applied(100);
  ASSERT_TRUE(history.ok());
  ASSERT_EQ(history.value().size(), 7U);
  EXPECT_TRUE(history.value()[0].is_rollback);
  EXPECT_EQ(history.value()[0].calibration_id, a);
  EXPECT_EQ(history.value()[0].replaced_id, c);
  EXPECT_EQ(history.value()[6].replaced_id, "");
  EXPECT_EQ(history.value()[6].note.who, "anna");
}

TEST_F(CalibrationsTest, a_repeated_apply_has_no_effect) {
  const std::string a = keep(hand_eye(1.0));
  put_in_force(a);
  put_in_force(a);
  EXPECT_EQ(reader()->applied(10).value().size(), 1U);
}

TEST_F(CalibrationsTest, a_calibration_that_may_not_be_used_is_never_put_in_force) {
  EXPECT_NE(refused(ApplyCalibration{"he-000000000000", note()}).find("there is no calibration"), std::string::npos);
  CalibrationRecord old = hand_eye(1.0);
  old.expires_utime_us = 5'000;
  EXPECT_NE(refused(ApplyCalibration{keep(old), note()}).find("has expired"), std::string::npos);
  EXPECT_NE(refused(ApplyCalibration{keep(hand_eye(2.0)), {"anna", "", 1}}).find("an operator and a reason"),
            std::string::npos);
  CalibrationRecord senseless = hand_eye(1.0);
  std::get<HandEyeNumbers>(senseless.numbers).sigma_mm = kNoValue;
  EXPECT_NE(refused(KeepCalibration{senseless}).find("uncertainty is not known"), std::string::npos);
  std::get<HandEyeNumbers>(senseless.numbers).sigma_mm = 0.02;
  std::get<HandEyeNumbers>(senseless.numbers).T_flange_scanner.rotation = Quat(1.0, 0.1, 0.0, 0.0);
  EXPECT_NE(refused(KeepCalibration{senseless}).find("not a rigid transform"), std::string::npos);
  EXPECT_EQ(in_force().source, LineCalibration::Source::missing);
}

TEST_F(CalibrationsTest, station_corrections_hold_for_the_hand_eye_they_were_solved_with) {
  const std::string a = keep(hand_eye(1.0));
  const std::string b = keep(hand_eye(2.0));
  put_in_force(a);
  const std::string s = keep(stations(a, 0.5));
  put_in_force(s);
  LineCalibration line = in_force();
  ASSERT_EQ(line.tables.size(), 1U);
  EXPECT_EQ(line.tables[0].id.view(), s);
  EXPECT_EQ(line.tables[0].hand_eye_id.view(), a);
  ASSERT_NE(line.table_for(5600), nullptr);
  EXPECT_EQ(line.table_for(4925), nullptr);
  EXPECT_EQ(line.table_for(5600)->table.station[6].visits, 5);
  EXPECT_EQ(line.table_for(5600)->table.station[6].T_base_reported.translation_mm, Vec3(0.5, 0.2, 7.0));
  EXPECT_EQ(line.table_for(5600)->table.station[7].visits, 0);

  put_in_force(b);  // the corrections stay and are reported as stale
  line = in_force();
  EXPECT_EQ(line.id.view(), b);
  EXPECT_EQ(line.tables[0].hand_eye_id.view(), a);
  EXPECT_NE(refused(ApplyCalibration{keep(stations(a, 0.6)), note()}).find("solve them again"), std::string::npos);
}

TEST_F(CalibrationsTest, every_slab_type_has_its_own_corrections) {
  const std::string a = keep(hand_eye(1.0));
  put_in_force(a);
  const std::string long_one = keep(stations(a, 0.5, 5600));
  const std::string first = keep(stations(a, 0.1, 4925));
  const std::string second = keep(stations(a, 0.2, 4925));
  for (const std::string& id : {long_one, first, second}) put_in_force(id);
  EXPECT_EQ(in_force().tables.size(), 2U);
  EXPECT_EQ(store_->change(RollBackCalibration{CalibrationKind::stations, 0, note()}).value(), first)
      << "of the newest change";
  EXPECT_EQ(in_force().table_for(5600)->id.view(), long_one);
  EXPECT_EQ(in_force().table_for(4925)->id.view(), first);
  EXPECT_EQ(reader()->current(CalibrationKind::stations, 4925).value()->id, first);
}

TEST_F(CalibrationsTest, an_open_slab_keeps_what_it_was_begun_with) {
  const std::string a = keep(hand_eye(1.0));
  put_in_force(a);
  const std::string s = keep(stations(a, 0.5));
  put_in_force(s);
  SlabHeader header = random_header(prng_, 1);
  header.calibration_id.assign(a);
  header.stations_id.assign(s);
  apply(BeginSlabJob{header, session_, ++cmd_seq_});
  put_in_force(keep(hand_eye(2.0)));
  open();
  const auto line = recover();
  EXPECT_EQ(line->slab_calibration.arm[0].id.view(), a);
  ASSERT_NE(line->slab_calibration.arm[0].table_for(5600), nullptr);
  EXPECT_EQ(line->slab_calibration.arm[0].table_for(5600)->id.view(), s);
  EXPECT_EQ(line->calibration.arm[0].hand_eye.T_flange_scanner.translation_mm.x(), 2.0);
}

TEST_F(CalibrationsTest, numbers_that_were_changed_on_the_disk_are_not_used) {
  const std::string a = keep(hand_eye(1.0));
  put_in_force(a);
  on_the_disk("UPDATE hand_eye SET T_flange_scanner_x = T_flange_scanner_x + 0.5");
  const LineCalibration line = in_force();
  EXPECT_EQ(line.source, LineCalibration::Source::missing);
  EXPECT_NE(line.trouble.view().find("changed after it was kept"), std::string_view::npos);
  EXPECT_EQ(fault_of(line, 0), CalibrationFault::missing);
}

TEST_F(CalibrationsTest, records_history_and_trend_can_only_grow) {
  const std::string a = keep(hand_eye(1.0));
  put_in_force(a);
  const std::string block = keep(reference_block());
  CalibrationCheck check;
  check.reference_id.assign(block);
  check.passed = true;
  ASSERT_TRUE(store_->change(KeepCheck{check}).ok());
  close();
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(settings_.db_path.c_str(), &db), SQLITE_OK);
  for (const char* sql : {"DELETE FROM applied", "UPDATE applied SET calibration_id = 'x'", "DELETE FROM calibration",
                          "UPDATE calibration SET operator_name = 'unknown'", "DELETE FROM calibration_check",
                          "UPDATE calibration_check SET passed = 1"})
    EXPECT_NE(sqlite3_exec(db, sql, nullptr, nullptr, nullptr), SQLITE_OK) << sql;
  sqlite3_close(db);
}

TEST_F(CalibrationsTest, the_last_check_against_the_artefact_in_force_counts) {
  const std::string block = keep(reference_block());
  CalibrationCheck check;
  check.reference_id.assign(block);
  check.passed = false;
  check.note = "slope 0.05 deg off";
  check.slope_rad = 0.0259;
  check.utime_us = 50;
  ASSERT_TRUE(store_->change(KeepCheck{check}).ok());
  EXPECT_TRUE(in_force().block.reference_id.empty()) << "not in force yet";
  put_in_force(block);
  EXPECT_TRUE(in_force().block.failed);
  EXPECT_EQ(in_force().block.note.view(), "slope 0.05 deg off");
  EXPECT_EQ(in_force().block.since_utime_us, utime_us_);
  check.passed = true;
  check.note = "";
  check.utime_us = 60;
  ASSERT_TRUE(store_->change(KeepCheck{check}).ok());
  EXPECT_FALSE(in_force().block.failed);
  EXPECT_EQ(in_force().block.checked_utime_us, 60);
  const auto trend = reader()->checks(10);
  ASSERT_EQ(trend.value().size(), 2U);
  EXPECT_EQ(trend.value()[1].slope_rad, 0.0259);
  check.kind = CalibrationKind::monitor_ball;
  EXPECT_NE(refused(KeepCheck{check}).find("it names no monitor_ball"), std::string::npos);
}

TEST_F(CalibrationsTest, another_artefact_does_not_undo_a_failed_check) {
  const std::string first = keep(reference_block());
  put_in_force(first);
  const std::int64_t since = in_force().block.since_utime_us;
  CalibrationCheck check;
  check.reference_id.assign(first);
  check.passed = false;
  check.utime_us = 50;
  ASSERT_TRUE(store_->change(KeepCheck{check}).ok());
  CalibrationRecord other = reference_block();
  other.numbers = ReferenceBlock{0.026, 2e-5, 380.02, 0.004};
  const std::string second = keep(other);
  put_in_force(second);
  EXPECT_TRUE(in_force().block.failed);
  EXPECT_EQ(in_force().block.checked_utime_us, 50);
  put_in_force(first);
  EXPECT_TRUE(in_force().block.failed);
  EXPECT_EQ(in_force().block.since_utime_us, since) << "its first day";
  check.passed = true;
  check.utime_us = 60;
  ASSERT_TRUE(store_->change(KeepCheck{check}).ok());
  EXPECT_FALSE(in_force().block.failed);
}

TEST_F(CalibrationsTest, the_same_numbers_with_another_certificate_or_for_longer_are_another_record) {
  constexpr std::int64_t kDay_us = 86'400'000'000;
  CalibrationRecord block = reference_block();
  block.certificate = "id = A";
  block.expires_utime_us = 10 * kDay_us;
  const std::string a = keep(block);
  block.expires_utime_us += kDay_us / 2;
  EXPECT_EQ(keep(block), a) << "given again because its answer was lost";
  block.certificate = "id = B";
  const std::string b = keep(block);
  EXPECT_EQ(b, a + ".2");
  block.expires_utime_us = 700 * kDay_us;
  const std::string longer = keep(block);
  EXPECT_EQ(longer, a + ".3");
  EXPECT_EQ(keep(block), longer);
  put_in_force(longer);
  EXPECT_EQ(in_force().block.reference_id.view(), longer) << "its numbers give its id";
  const auto found = reader()->calibration(a);
  ASSERT_TRUE(found.ok() && found.value());
  EXPECT_EQ(found.value()->certificate, "id = A") << "the whole id means one record";
}

TEST_F(CalibrationsTest, an_expired_record_is_not_put_in_force_again) {
  CalibrationRecord record = hand_eye(1.0);
  record.expires_utime_us = utime_us_ + 5;
  const std::string id = keep(record);
  put_in_force(id);
  utime_us_ += 100;
  EXPECT_NE(refused(ApplyCalibration{id, note()}).find("has expired"), std::string::npos);
}

TEST_F(CalibrationsTest, a_new_record_is_put_in_force_after_a_clock_that_was_ahead) {
  constexpr std::int64_t kDay_us = 86'400'000'000;
  CalibrationRecord old_one = hand_eye(1.0);
  old_one.expires_utime_us = 365 * kDay_us;
  const std::string old_id = keep(old_one);
  put_in_force(old_id);
  // For an hour slabs were measured while the clock was two years ahead.
  on_the_disk("UPDATE line SET newest_utime_us = " + std::to_string(730 * kDay_us));
  EXPECT_NE(refused(ApplyCalibration{old_id, note()}).find("has expired"), std::string::npos);
  CalibrationRecord stale = hand_eye(3.0);
  stale.expires_utime_us = 365 * kDay_us;
  const std::string stale_id = keep(stale);
  utime_us_ += 2 * kDay_us;
  EXPECT_NE(refused(ApplyCalibration{stale_id, note()}).find("has expired"), std::string::npos) << "made days ago";
  CalibrationRecord fresh = hand_eye(2.0);
  fresh.created_utime_us = utime_us_;
  fresh.expires_utime_us = 367 * kDay_us;
  const std::string fresh_id = keep(fresh);
  put_in_force(fresh_id);
  EXPECT_EQ(in_force().id.view(), fresh_id);
  EXPECT_EQ(recover()->newest_utime_us, utime_us_) << "who calibrates says what day it is";
  utime_us_ = 400 * kDay_us;
  EXPECT_NE(refused(ApplyCalibration{fresh_id, note()}).find("has expired"), std::string::npos);
}

TEST_F(CalibrationsTest, a_scanners_acceptance_is_read_back_bit_for_bit_and_is_in_force_together_with_the_hand_eye) {
  const CalibrationRecord given = scanner(0.061);
  const std::string id = keep(given);
  EXPECT_EQ(id.substr(0, 3), "sc-");
  EXPECT_EQ(keep(given), id);
  const auto back = reader()->calibration(id);
  ASSERT_TRUE(back.ok() && back.value().has_value());
  EXPECT_EQ(calibration_id(*back.value()), id) << "a NaN is a NaN, whatever its sign was";
  const auto& a = std::get<ScannerNumbers>(given.numbers);
  const auto& b = std::get<ScannerNumbers>(back.value()->numbers);
  EXPECT_EQ(b.scanner.view(), a.scanner.view());
  for (const auto& [x, y] : {std::pair{a.PF_mm, b.PF_mm},
                             {a.PS_mm, b.PS_mm},
                             {a.RF_mm, b.RF_mm},
                             {a.form_half_mm, b.form_half_mm},
                             {a.form_length_mm, b.form_length_mm},
                             {a.noise_sigma_mm, b.noise_sigma_mm}})
    EXPECT_EQ(x, y);
  EXPECT_FALSE(has_value(b.noise_correlation_mm));
  EXPECT_FALSE(has_value(b.pitch_mm));
  EXPECT_EQ(b.plates, 6);
  EXPECT_EQ(b.balls, 10);
  EXPECT_TRUE(b.within_limits);

  EXPECT_TRUE(in_force().scanner.id.empty()) << "kept is not in force";
  put_in_force(id);
  const LineCalibration line = in_force();
  EXPECT_EQ(line.scanner.id.view(), id);
  EXPECT_EQ(line.scanner.numbers.form_half_mm, 0.061);
  EXPECT_FALSE(line.scanner.failed);
  EXPECT_EQ(line.source, LineCalibration::Source::missing) << "it concerns the scanner, not its position";
  EXPECT_TRUE(line.trouble.empty()) << "commissioning values still count";
}

TEST_F(CalibrationsTest, a_scanner_that_was_not_looked_at_enough_or_is_out_of_its_limits_is_not_put_in_force) {
  const auto refusal = [&](const CalibrationRecord& record) { return refused(ApplyCalibration{keep(record), note()}); };
  CalibrationRecord few = scanner(0.05);
  std::get<ScannerNumbers>(few.numbers).plates = 5;
  EXPECT_NE(refusal(few).find("in 5 places"), std::string::npos);
  few = scanner(0.05);
  std::get<ScannerNumbers>(few.numbers).balls = 9;
  EXPECT_NE(refusal(few).find("the ball in 9"), std::string::npos);
  few = scanner(0.05);
  std::get<ScannerNumbers>(few.numbers).balls = 0;
  EXPECT_NE(refusal(few).find("no scan of a ball"), std::string::npos);
  few = scanner(0.05);
  std::get<ScannerNumbers>(few.numbers).plates = 0;
  EXPECT_NE(refusal(few).find("no scan of a plate"), std::string::npos);
  few = scanner(0.05);
  std::get<ScannerNumbers>(few.numbers).PS_mm = kNoValue;
  EXPECT_NE(refusal(few).find("not all known"), std::string::npos);
  EXPECT_NE(refusal(scanner(0.05, false)).find("out of the limits"), std::string::npos);
  CalibrationRecord nonsense = scanner(-0.05);
  EXPECT_NE(refused(KeepCalibration{nonsense}).find("not negative"), std::string::npos);
  EXPECT_TRUE(in_force().scanner.id.empty());
}

TEST_F(CalibrationsTest, a_verification_out_of_limits_is_remembered_until_a_later_one_is_put_in_force) {
  const std::string first = keep(scanner(0.05));
  put_in_force(first);
  keep(scanner(0.30, false));
  EXPECT_EQ(in_force().scanner.id.view(), first);
  EXPECT_TRUE(in_force().scanner.failed);
  EXPECT_EQ(acceptance_state(in_force().scanner, 1), AcceptanceState::failed);
  EXPECT_EQ(keep(scanner(0.05)), first);
  put_in_force(first);
  EXPECT_TRUE(in_force().scanner.failed) << "the same figures again prove nothing new";
  const std::string later = keep(scanner(0.051));
  put_in_force(later);
  EXPECT_FALSE(in_force().scanner.failed);
  EXPECT_EQ(store_->change(RollBackCalibration{CalibrationKind::scanner, 0, note()}).value(), first);
  EXPECT_TRUE(in_force().scanner.failed) << "going back cures nothing";
}

TEST_F(CalibrationsTest, a_spare_scanner_out_of_its_limits_does_not_affect_the_accepted_one) {
  put_in_force(keep(scanner(0.05)));
  CalibrationRecord spare = scanner(0.30, false);
  std::get<ScannerNumbers>(spare.numbers).scanner = "spare";
  keep(spare);
  EXPECT_FALSE(in_force().scanner.failed);
  std::get<ScannerNumbers>(spare.numbers).scanner = "";
  keep(spare);
  EXPECT_TRUE(in_force().scanner.failed) << "it is unknown which one it was";
}

TEST_F(CalibrationsTest, a_scanners_figures_that_were_edited_on_the_disk_are_not_used_and_the_line_continues) {
  const std::string hand = keep(hand_eye(80.0));
  put_in_force(hand);
  const std::string id = keep(scanner(0.061));
  put_in_force(id);
  SlabHeader header;
  header.key = 1;
  header.slab_id = "with";
  header.stations = 18;
  header.calibration_id = "commissioning-1";
  header.scanner_id.assign(id);
  ASSERT_TRUE(store_->apply({1, BeginSlabJob{header, 1, 1}}).ok());
  open();
  const auto recovered = recover();
  EXPECT_EQ(recovered->slab_calibration.arm[0].scanner.numbers.form_half_mm, 0.061)
      << "also of a slab that was begun with commissioning values";
  EXPECT_EQ(recovered->slab.scanner_id.view(), id);
  on_the_disk("UPDATE scanner_acceptance SET form_half_mm = 0.001");
  const LineCalibration line = in_force();
  EXPECT_TRUE(line.scanner.id.empty());
  EXPECT_FALSE(has_value(line.scanner.numbers.form_half_mm));
  EXPECT_NE(line.scanner.trouble.view().find("were changed"), std::string_view::npos);
  EXPECT_TRUE(line.trouble.empty());
  EXPECT_EQ(line.id.view(), hand);
}

TEST_F(CalibrationsTest, each_scanner_has_its_own_calibrations) {
  const std::string left = keep(hand_eye(1.0));
  const std::string right = keep(of_right(hand_eye(2.0)));
  put_in_force(left);
  put_in_force(right);
  EXPECT_EQ(in_force().id.view(), left) << "without [[scanner]] the first one's are in force";
  EXPECT_EQ(in_force(1).source, LineCalibration::Source::missing);
  with_two_arms();
  EXPECT_EQ(in_force(0).id.view(), left);
  EXPECT_EQ(in_force(1).id.view(), right);
  EXPECT_EQ(in_force(1).hand_eye.T_flange_scanner.translation_mm.x(), 2.0);

  const std::string right_table = keep(of_right(stations(right, 0.5)));
  put_in_force(right_table);
  EXPECT_TRUE(in_force(0).tables.empty());
  ASSERT_NE(in_force(1).table_for(5600), nullptr);
  EXPECT_EQ(in_force(1).table_for(5600)->id.view(), right_table);
  EXPECT_NE(refused(ApplyCalibration{keep(of_right(stations(left, 0.5))), note()}).find("solve them again"),
            std::string::npos)
      << "the hand-eye of the other scanner";

  const std::string accepted = keep(of_right(scanner(0.05)));
  put_in_force(accepted);
  EXPECT_TRUE(in_force(0).scanner.id.empty());
  EXPECT_EQ(in_force(1).scanner.id.view(), accepted);
  keep(scanner(0.30, false));
  EXPECT_FALSE(in_force(1).scanner.failed) << "a verification of the first scanner";
  keep(of_right(scanner(0.30, false)));
  EXPECT_TRUE(in_force(1).scanner.failed);

  const std::string block = keep(of_right(reference_block()));
  put_in_force(block);
  CalibrationCheck check;
  check.reference_id.assign(block);
  check.passed = false;
  check.utime_us = 50;
  ASSERT_TRUE(store_->change(KeepCheck{check}).ok());
  EXPECT_FALSE(in_force(0).block.failed);
  EXPECT_TRUE(in_force(1).block.failed);
  EXPECT_EQ(recover()->calibration.arm[1].id.view(), right);
}

TEST_F(CalibrationsTest, the_scanner_is_part_of_an_id_unless_it_is_the_first) {
  const std::string first = keep(hand_eye(1.0));
  const std::string right = keep(of_right(hand_eye(1.0)));
  EXPECT_NE(first, right) << "equal numbers of two scanners are two calibrations";
  const auto back = reader()->calibration(right);
  ASSERT_TRUE(back.ok() && back.value().has_value());
  EXPECT_EQ(back.value()->scanner, "right");
  EXPECT_EQ(calibration_id(*back.value()), right);
  EXPECT_EQ(reader()->calibration(first).value()->scanner, "1");
  on_the_disk("DROP TRIGGER calibration_stays; UPDATE calibration SET scanner = '1' WHERE scanner = 'right'");
  EXPECT_NE(refused(ApplyCalibration{right, note()}).find("were changed"), std::string::npos);
}

TEST_F(CalibrationsTest, a_calibration_is_applied_and_rolled_back_for_its_scanner) {
  const std::string a = keep(hand_eye(1.0));
  const std::string b = keep(hand_eye(2.0));
  const std::string c = keep(of_right(hand_eye(3.0)));
  const std::string d = keep(of_right(hand_eye(4.0)));
  for (const std::string& id : {a, c, d, b}) put_in_force(id);
  with_two_arms();
  EXPECT_NE(refused(ApplyCalibration{a, note(), "right"}).find("it is of scanner 1, not of scanner right"),
            std::string::npos);
  ASSERT_TRUE(store_->change(ApplyCalibration{d, note(), "right"}).ok());
  EXPECT_EQ(store_->change(RollBackCalibration{CalibrationKind::hand_eye, 0, note(), "right"}).value(), c);
  EXPECT_EQ(in_force(0).id.view(), b) << "the other scanner keeps its own";
  EXPECT_EQ(in_force(1).id.view(), c);
  EXPECT_EQ(reader()->applied(1).value().at(0).scanner, "right");
  EXPECT_EQ(reader()->current(CalibrationKind::hand_eye, 0, "right").value()->id, c);
  EXPECT_EQ(reader()->current(CalibrationKind::hand_eye).value()->id, b);
  EXPECT_EQ(reader()->line_calibration("right").value()->id.view(), c);
  EXPECT_EQ(reader()->cell_calibration(settings_.arms).value()->arm[1].id.view(), c);
}

TEST_F(CalibrationsTest, a_tie_is_stale_with_another_hand_eye_calibration) {
  with_two_arms();
  const std::string left = keep(hand_eye(1.0));
  const std::string right = keep(of_right(hand_eye(2.0)));
  put_in_force(left);
  const std::string id = keep(tie(left, right));
  EXPECT_NE(refused(ApplyCalibration{id, note()}).find("tie again"), std::string::npos) << "right is not in force";
  put_in_force(right);
  EXPECT_EQ(fault_of_tie(*cell_in_force(), PartId("2"), 1), TieFault::missing);
  put_in_force(id);
  std::unique_ptr<CellCalibration> now = cell_in_force();
  EXPECT_EQ(now->tie.id.view(), id);
  EXPECT_EQ(now->tie.numbers.targets, 6);
  EXPECT_EQ(fault_of_tie(*now, PartId("2"), 1), TieFault::none);
  EXPECT_EQ(fault_of_tie(*now, PartId("3"), 1), TieFault::stale) << "another robot stands there";
  EXPECT_EQ(reader()->cell_calibration(settings_.arms).value()->tie.id.view(), id);

  const std::string other = keep(of_right(hand_eye(2.5)));
  put_in_force(other);
  EXPECT_EQ(fault_of_tie(*cell_in_force(), PartId("2"), 1), TieFault::stale);
  EXPECT_NE(refused(ApplyCalibration{keep(tie(right, left)), note()}).find("tie again"), std::string::npos);
  put_in_force(right);
  EXPECT_EQ(fault_of_tie(*cell_in_force(), PartId("2"), 1), TieFault::none) << "the one it was solved with is back";
  EXPECT_EQ(fault_of_tie(recover()->calibration, PartId("2"), 1), TieFault::none);
}

TEST_F(CalibrationsTest, a_tie_that_was_changed_on_the_disk_is_not_used) {
  with_two_arms();
  const std::string left = keep(hand_eye(1.0));
  const std::string right = keep(of_right(hand_eye(2.0)));
  put_in_force(left);
  put_in_force(right);
  put_in_force(keep(tie(left, right)));
  on_the_disk("UPDATE tie_numbers SET T_base_robot_x = T_base_robot_x + 1.0");
  const std::unique_ptr<CellCalibration> now = cell_in_force();
  EXPECT_EQ(fault_of_tie(*now, PartId("2"), 1), TieFault::unusable);
  EXPECT_NE(describe(TieFault::unusable, *now).view().find("were changed after it was kept"), std::string_view::npos);
}

TEST_F(CalibrationsTest, a_tie_comes_back_bit_for_bit_and_is_rolled_back) {
  with_two_arms();
  const std::string left = keep(hand_eye(80.0));
  const std::string right = keep(of_right(hand_eye(-80.0)));
  put_in_force(left);
  put_in_force(right);
  CalibrationRecord given = tie(left, right);
  auto& numbers = std::get<TieNumbers>(given.numbers);
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column <= row; ++column)
      numbers.covariance(row, column) = numbers.covariance(column, row) =
          (row == column ? 1.0 : 0.1) * 1.234567890123e-5 / (1 + row + column);
  given.observations = "# robot 1: flange poses, ball centres, names\n1 2 3 1 0 0 0\n";
  const std::string id = keep(given);
  EXPECT_EQ(id.substr(0, 3), "ti-");
  const auto back = reader()->calibration(id);
  ASSERT_TRUE(back.ok() && back.value().has_value());
  EXPECT_EQ(back.value()->kind(), CalibrationKind::tie);
  EXPECT_EQ(back.value()->parent_id, left + "+" + right);
  EXPECT_EQ(back.value()->observations, given.observations);
  const auto& read = std::get<TieNumbers>(back.value()->numbers);
  EXPECT_EQ(read.robot.view(), "2");
  // Minus zero is stored as zero.
  for (std::size_t i = 0; i < 7; ++i)
    EXPECT_EQ(read.T_base_robot.to_array()[i], numbers.T_base_robot.to_array()[i] + 0.0) << i;
  EXPECT_TRUE(read.centre_mm == numbers.centre_mm);
  EXPECT_TRUE(read.covariance == numbers.covariance);
  EXPECT_EQ(read.targets, 6);
  EXPECT_EQ(read.rms_mm, 0.04);
  EXPECT_EQ(keep(given), id) << "kept already";

  put_in_force(id);
  numbers.rms_mm = 0.05;
  const std::string later = keep(given);
  EXPECT_NE(later, id);
  put_in_force(later);
  EXPECT_EQ(cell_in_force()->tie.id.view(), later);
  const Result<std::string> rolled = store_->change(RollBackCalibration{CalibrationKind::tie, 0, note(), "1"});
  ASSERT_TRUE(rolled.ok()) << rolled.error().text.view();
  EXPECT_EQ(rolled.value(), id);
  EXPECT_EQ(cell_in_force()->tie.id.view(), id);
  EXPECT_TRUE(cell_in_force()->tie.numbers.covariance == numbers.covariance);
}

TEST_F(CalibrationsTest, a_tie_of_numbers_that_make_no_sense_is_not_kept) {
  const auto refused_with = [&](const std::function<void(TieNumbers&)>& change) {
    CalibrationRecord record = tie("he-1", "he-2");
    change(std::get<TieNumbers>(record.numbers));
    return refused(KeepCalibration{record});
  };
  EXPECT_NE(refused_with([](TieNumbers& n) { n.robot = ""; }).find("names no robot"), std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.T_base_robot.rotation = Quat(2.0, 0.0, 0.0, 0.0); }).find("rigid"),
            std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.T_base_robot.translation_mm.x() = 1e6; }).find("more than 50 m"),
            std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.centre_mm.x() = kNoValue; }).find("middle of its targets"),
            std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.covariance.setConstant(kNoValue); }).find("covariance is not known"),
            std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.covariance(2, 2) = 0.0; }).find("covariance is not known"),
            std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.covariance(0, 1) = 1e-5; }).find("six errors"), std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.covariance(0, 1) = n.covariance(1, 0) = 1.0; }).find("six errors"),
            std::string::npos);
  EXPECT_NE(refused_with([](TieNumbers& n) { n.targets = 3; }).find("fewer than 4 balls"), std::string::npos);
}

TEST_F(CalibrationsTest, corrections_of_the_second_robot_are_stale_with_another_tie) {
  with_two_arms();
  const std::string left = keep(hand_eye(1.0));
  const std::string right = keep(of_right(hand_eye(2.0)));
  put_in_force(left);
  put_in_force(right);
  const auto with = [&](std::size_t arm) {
    const auto cell = cell_in_force();
    const StationsInForce* table = cell->arm.at(arm).table_for(5600);
    return table == nullptr ? "none" : std::string(table->hand_eye_id.view());
  };
  put_in_force(keep(of_right(stations(right, 0.4))));
  EXPECT_EQ(with(1), right);
  const std::string first = keep(tie(left, right));
  put_in_force(first);
  EXPECT_EQ(with(1), "") << "they were placed without one";
  CalibrationRecord of_slab = of_right(stations(right, 0.5));
  of_slab.certificate = "frame = slab   # the slab's own axes; \"base\": measured in the robot's base\n";
  const std::string tied = keep(of_slab);
  put_in_force(tied);
  put_in_force(keep(stations(left, 0.5)));
  EXPECT_EQ(with(1), right);
  CalibrationRecord other = tie(left, right);
  std::get<TieNumbers>(other.numbers).T_base_robot.translation_mm.x() += 2.0;
  put_in_force(keep(other));
  EXPECT_EQ(with(1), "");
  EXPECT_EQ(with(0), "") << "both robots refer to one place of the mastered slab";
  ASSERT_TRUE(store_->change(RollBackCalibration{CalibrationKind::tie, 0, note(), "1"}).ok());
  EXPECT_EQ(with(1), right);
  EXPECT_EQ(with(0), left);
  // Solved with one tie, put in force with another one.
  const std::string late = keep(of_right(stations(right, 0.7)));
  put_in_force(keep(other));
  put_in_force(late);
  EXPECT_EQ(with(1), "");
  ASSERT_TRUE(store_->change(RollBackCalibration{CalibrationKind::tie, 0, note(), "1"}).ok());
  EXPECT_EQ(with(1), right);
  // The same numbers with another end, and corrections that need no tie.
  CalibrationRecord longer = tie(left, right);
  longer.expires_utime_us = 90'000'000'000;
  put_in_force(keep(longer));
  EXPECT_EQ(with(1), right);
  CalibrationRecord in_base = of_right(stations(right, 0.6));
  in_base.certificate = "id = m\nframe = base  # not of the slab\n";
  put_in_force(keep(in_base));
  std::get<TieNumbers>(other.numbers).T_base_robot.translation_mm.x() += 1.0;
  put_in_force(keep(other));
  EXPECT_EQ(with(1), right);
}

TEST_F(CalibrationsTest, an_open_slab_keeps_the_calibrations_of_both_arms_and_the_tie) {
  with_two_arms();
  const std::string left = keep(hand_eye(1.0));
  const std::string right = keep(of_right(hand_eye(2.0)));
  put_in_force(left);
  put_in_force(right);
  const std::string table = keep(of_right(stations(right, 0.5)));
  const std::string accepted = keep(of_right(scanner(0.05)));
  const std::string tied = keep(tie(left, right));
  for (const std::string& id : {table, accepted, tied}) put_in_force(id);
  SlabHeader header = random_header(prng_, 1);
  header.calibration_id.assign(left);
  header.stations_id.clear();
  header.scanner_id.clear();
  header.tie_id.assign(tied);
  header.more_arms[0].by = settings_.arms.list[1];
  header.more_arms[0].calibration_id.assign(right);
  header.more_arms[0].stations_id.assign(table);
  header.more_arms[0].scanner_id.assign(accepted);
  apply(BeginSlabJob{header, session_, ++cmd_seq_});
  put_in_force(keep(of_right(hand_eye(5.0))));
  open();
  const auto line = recover();
  expect_same(line->slab, header);
  EXPECT_EQ(line->slab_calibration.arm[0].id.view(), left);
  EXPECT_EQ(line->slab_calibration.arm[1].id.view(), right);
  ASSERT_NE(line->slab_calibration.arm[1].table_for(5600), nullptr);
  EXPECT_EQ(line->slab_calibration.arm[1].scanner.id.view(), accepted);
  EXPECT_EQ(line->slab_calibration.tie.id.view(), tied);
  EXPECT_EQ(fault_of_tie(line->slab_calibration, PartId("2"), 1), TieFault::none);
  EXPECT_EQ(fault_of_tie(line->calibration, PartId("2"), 1), TieFault::stale);
}

TEST_F(CalibrationsTest, an_interrupted_scan_names_its_arm_only_if_one_arm_scans_the_station) {
  with_two_arms();
  close();
  for (std::size_t i = 0; i < limits::kStationsMax; ++i) {
    ArmChoice& choice = settings_.arms.of_station.at(i);
    choice.clear();
    ASSERT_TRUE(choice.push(i < 9 ? 0 : 1));
    if (i == 4) {
      ASSERT_TRUE(choice.push(1));
    }
  }
  open();
  for (const int station : {3, 5, 12}) {
    const std::int64_t key = station;
    begin(key);
    accept(PlcCommand::scan, station, key);
    open();
    (void)recover();
    const auto record = reader()->slab(key);
    ASSERT_TRUE(record.ok() && record.value().has_value());
    ASSERT_EQ(record.value()->blocks.size(), 1U);
    const Attempt& attempt = record.value()->blocks[0].attempt;
    EXPECT_EQ(attempt.by.scanner.view(), station == 3 ? "1" : station == 5 ? "" : "right");
    EXPECT_EQ(attempt.arm, station == 12 ? 1 : 0);
    end(key, Verdict::not_measured);
  }
}

}  // namespace
}  // namespace slabd::storage
