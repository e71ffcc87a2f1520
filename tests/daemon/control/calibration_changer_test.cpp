// SPDX-License-Identifier: Apache-2.0
//
// A change of calibrations from its file to the database.
#include "daemon/control/calibration_changer.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <limits>

#include "config/config.h"

namespace slabd::daemon {
namespace {

namespace fs = std::filesystem;
using namespace storage;

CalibrationRecord record() {
  CalibrationRecord r;
  StationTable table;
  table.slab_type = 5600;
  for (const std::size_t i : {0U, 17U}) {
    StationCorrection& c = table.station[i];
    c.visits = 5;
    c.T_base_reported.translation_mm = Vec3(0.1, -0.0, 1.0 / 3.0);
    c.T_base_reported.rotation = Quat(0.9999, 0.01, -0.003, 1e-17).normalized();
    c.T_base_flange.translation_mm = Vec3(1e3 / 7.0, 2.0, 3.0);
    c.sigma_mm = 0.0193;
    c.sigma_rad = 1.1e-5;
  }
  r.numbers = table;
  r.parent_id = "he-000000000001";
  r.figures = "{\"a\": \"\\u00e4\"}";
  r.observations = "visit = 1\n\"quoted\"\ttab";
  r.operator_name = "\xc3\x84nne";
  r.expires_utime_us = std::numeric_limits<std::int64_t>::max();
  return r;
}

TEST(CalibrationChangeJson, every_bit_comes_back) {
  const CalibrationRecord given = record();
  const auto back = parse_change(change_json(KeepCalibration{given}));
  ASSERT_TRUE(back.ok()) << back.error().text.view();
  const CalibrationRecord& r = std::get<KeepCalibration>(back.value()).record;
  EXPECT_EQ(calibration_id(r), calibration_id(given));
  EXPECT_EQ(std::get<StationTable>(r.numbers).station[17].T_base_reported.to_array(),
            std::get<StationTable>(given.numbers).station[17].T_base_reported.to_array());
  EXPECT_TRUE(std::isnan(std::get<StationTable>(r.numbers).station[0].spread_mm));
  EXPECT_TRUE(std::isnan(r.temperature_c));
  EXPECT_EQ(r.observations, given.observations);
  EXPECT_EQ(r.operator_name, given.operator_name);
  EXPECT_EQ(r.expires_utime_us, given.expires_utime_us);

  const auto apply = parse_change(change_json(ApplyCalibration{"st-1", {"anna", "why \"not\"", 77}}));
  ASSERT_TRUE(apply.ok());
  EXPECT_EQ(std::get<ApplyCalibration>(apply.value()).note.why, "why \"not\"");
  const auto rollback = parse_change(change_json(RollBackCalibration{CalibrationKind::stations, 5600, {"a", "b", 1}}));
  ASSERT_TRUE(rollback.ok());
  EXPECT_EQ(std::get<RollBackCalibration>(rollback.value()).slab_type, 5600);
  const auto reset = parse_change(change_json(ResetMould{7, 5'000'000'000, {"anna", "shims set", 77}}));
  ASSERT_TRUE(reset.ok());
  EXPECT_EQ(std::get<ResetMould>(reset.value()).mould, 7);
  EXPECT_EQ(std::get<ResetMould>(reset.value()).from_utime_us, 5'000'000'000);
  EXPECT_EQ(std::get<ResetMould>(reset.value()).note.why, "shims set");
  const auto pin = parse_change(change_json(KeepPin{12, "{\"reason\": \"x\"}\n"}));
  ASSERT_TRUE(pin.ok());
  EXPECT_EQ(std::get<KeepPin>(pin.value()).slab_key, 12);
  EXPECT_EQ(std::get<KeepPin>(pin.value()).text, "{\"reason\": \"x\"}\n");
  KeepGaugeCheck gauge;
  gauge.check.gauge = "width_front";
  gauge.check.value = 2500.0 + 0.1 / 3.0;
  gauge.check.master_value = 2500.0;
  gauge.check.master_u = 0.02;
  gauge.check.within = 0.1;
  gauge.note = {"anna", "after the knock", 77};
  gauge.check.source = "udp:5005";
  const auto gauged = parse_change(change_json(gauge));
  ASSERT_TRUE(gauged.ok()) << gauged.error().text.view();
  EXPECT_EQ(std::get<KeepGaugeCheck>(gauged.value()).check.value, gauge.check.value);
  EXPECT_EQ(std::get<KeepGaugeCheck>(gauged.value()).check.gauge, gauge.check.gauge);
  EXPECT_EQ(std::get<KeepGaugeCheck>(gauged.value()).note.utime_us, 77);
  EXPECT_EQ(std::get<KeepGaugeCheck>(gauged.value()).check.source.view(), "udp:5005");
  CalibrationCheck check;
  check.reference_id = "rb-1";
  check.note = "slope off";
  check.slope_rad = 0.1 / 3.0;
  const auto kept = parse_change(change_json(KeepCheck{check}));
  ASSERT_TRUE(kept.ok());
  EXPECT_EQ(std::get<KeepCheck>(kept.value()).check.slope_rad, check.slope_rad);
  EXPECT_TRUE(std::isnan(std::get<KeepCheck>(kept.value()).check.off_mm.x()));
}

TEST(CalibrationChangeJson, a_tie_keeps_every_bit) {
  TieNumbers numbers;
  numbers.robot = "right";
  numbers.T_base_robot = {Quat(0.1, 0.2, -0.3, 0.9).normalized(), Vec3(0.1, 1.0 / 3.0, 3'000.7)};
  numbers.centre_mm = Vec3(1.0 / 7.0, -2.0, 3.0);
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column < 6; ++column) numbers.covariance(row, column) = 1e-6 / (1 + row + column);
  numbers.covariance(5, 5) = kNoValue;
  numbers.targets = 7;
  numbers.rms_mm = 0.1 / 3.0;
  CalibrationRecord tie;
  tie.numbers = numbers;
  tie.parent_id = "he-1+he-2";
  const auto kept = parse_change(change_json(KeepCalibration{tie}));
  ASSERT_TRUE(kept.ok()) << kept.error().text.view();
  const CalibrationRecord& back = std::get<KeepCalibration>(kept.value()).record;
  EXPECT_EQ(back.parent_id, tie.parent_id);
  const auto& read = std::get<TieNumbers>(back.numbers);
  EXPECT_EQ(read.robot, numbers.robot);
  EXPECT_EQ(read.T_base_robot.to_array(), numbers.T_base_robot.to_array());
  EXPECT_TRUE(read.centre_mm == numbers.centre_mm);
  EXPECT_TRUE(read.covariance.topRows<5>() == numbers.covariance.topRows<5>());
  EXPECT_TRUE(std::isnan(read.covariance(5, 5)));
  EXPECT_EQ(read.targets, 7);
  EXPECT_EQ(read.rms_mm, numbers.rms_mm);
  EXPECT_EQ(storage::calibration_id(back), storage::calibration_id(tie));
}

TEST(CalibrationChangeJson, anything_else_is_an_error_and_no_change) {
  const std::string good = change_json(KeepCalibration{record()});
  for (const std::string text : {"", "[]", "{}", "{\"schema\":\"slabd.calibration_change/1\"}", "null", "\xff"})
    EXPECT_FALSE(parse_change(text).ok()) << text;
  Prng prng(3);
  for (int i = 0; i < 500; ++i) {
    std::string text = good;
    for (std::uint64_t hits = 1 + prng.below(3); hits > 0; --hits)
      text[prng.below(text.size())] = static_cast<char>(prng.below(256));
    static_cast<void>(parse_change(text));
  }
}

class CalibrationChangerTest : public ::testing::Test {
 protected:
  CalibrationChangerTest() {
    fs::remove_all(dir_);
    fs::create_directories(dir_);
    auto store = open_store({(dir_ / "slabd.db").native(), (dir_ / "spool").native(), 0});
    EXPECT_TRUE(store.ok());
    store_ = std::move(store.value());
    changer_ = std::make_unique<CalibrationChanger>(change_folder((dir_ / "slabd.db").native()));
  }
  ~CalibrationChangerTest() override { fs::remove_all(dir_); }

  void leave(const std::string& name, const std::string& text) { std::ofstream(dir_ / "changes" / name) << text; }
  /// Lays a file and has it carried out, as the loop and the storage thread do.
  const CellCalibration* carry_out(const std::string& name) {
    const Status laid = changer_->accept(name, 1000);
    EXPECT_TRUE(laid.ok()) << laid.error().text.view();
    EXPECT_TRUE(changer_->is_waiting());
    changer_->started();
    EXPECT_FALSE(changer_->is_done());
    changer_->carry_out(store_.get());
    return changer_->finish();
  }
  CalibrationRecord hand_eye() {
    CalibrationRecord r;
    r.numbers = HandEyeNumbers{{Quat::Identity(), Vec3(0.0, 80.0, 150.0)}, 0.02, 1e-5};
    return r;
  }

  fs::path dir_ = fs::temp_directory_path() / ("slabd-changer-" + std::to_string(::getpid()));
  std::unique_ptr<Store> store_;
  std::unique_ptr<CalibrationChanger> changer_;
};

TEST_F(CalibrationChangerTest, a_change_is_applied_and_its_file_is_deleted) {
  leave("1.json", change_json(KeepCalibration{hand_eye()}));
  const CellCalibration* kept = carry_out("1.json");
  ASSERT_TRUE(changer_->succeeded()) << changer_->error().text.view();
  ASSERT_NE(kept, nullptr);
  EXPECT_EQ(kept->arm[0].source, LineCalibration::Source::missing) << "kept is not applied";
  const std::string id(changer_->id().view());
  EXPECT_FALSE(fs::exists(dir_ / "changes" / "1.json"));
  leave("2.json", change_json(ApplyCalibration{id, {"anna", "test", 5}}));
  const CellCalibration* applied = carry_out("2.json");
  ASSERT_NE(applied, nullptr);
  EXPECT_EQ(applied->arm[0].id.view(), id);
  const auto reader = open_reader((dir_ / "slabd.db").native());
  EXPECT_EQ(reader.value()->applied(1).value().at(0).note.who, "anna (uid 1000)") << "who asked stands in the history";
}

TEST_F(CalibrationChangerTest, a_change_names_its_scanner) {
  KeepCalibration keep{hand_eye()};
  keep.record.scanner = "right";
  const auto kept = parse_change(change_json(keep));
  ASSERT_TRUE(kept.ok()) << kept.error().text.view();
  EXPECT_EQ(std::get<KeepCalibration>(kept.value()).record.scanner, "right");
  const auto applied = parse_change(change_json(ApplyCalibration{"he-1", {"anna", "test", 5}, "right"}));
  ASSERT_TRUE(applied.ok());
  EXPECT_EQ(std::get<ApplyCalibration>(applied.value()).scanner, "right");
  const auto back =
      parse_change(change_json(RollBackCalibration{CalibrationKind::tie, 0, {"anna", "test", 5}, "right"}));
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(std::get<RollBackCalibration>(back.value()).kind, CalibrationKind::tie);
  EXPECT_EQ(std::get<RollBackCalibration>(back.value()).scanner, "right");
}

/// A store that writes, but answers with an error, like a disk that fails during a commit.
class DoubtfulStore : public Store {
 public:
  explicit DoubtfulStore(Store& store) : store_(store) {}
  Result<std::unique_ptr<RecoveredLine>> recover() override { return store_.recover(); }
  Status apply(const StoreJob& job) override { return store_.apply(job); }
  Result<std::string> change(const CalibrationChange& change) override {
    EXPECT_TRUE(store_.change(change).ok());
    return error(Code::journal_write, "disk I/O error");
  }
  Result<std::unique_ptr<CellCalibration>> calibration() override { return store_.calibration(); }
  Status order(const CareOrder& order) override { return store_.order(order); }
  CareState care() const override { return store_.care(); }

 private:
  Store& store_;
};

TEST_F(CalibrationChangerTest, after_a_failed_change_the_line_uses_what_is_in_the_database) {
  leave("1.json", change_json(KeepCalibration{hand_eye()}));
  (void)carry_out("1.json");
  const std::string id(changer_->id().view());
  DoubtfulStore doubtful(*store_);
  leave("2.json", change_json(ApplyCalibration{id, {"anna", "test", 5}}));
  ASSERT_TRUE(changer_->accept("2.json", 1000).ok());
  changer_->started();
  changer_->carry_out(&doubtful);
  const CellCalibration* now = changer_->finish();
  EXPECT_FALSE(changer_->succeeded());
  EXPECT_NE(changer_->error().text.view().find("made nevertheless"), std::string_view::npos);
  ASSERT_NE(now, nullptr);
  EXPECT_EQ(now->arm[0].id.view(), id);
}

TEST_F(CalibrationChangerTest, a_refused_change_has_no_effect_and_names_the_reason) {
  leave("a.json", change_json(ApplyCalibration{"he-none", {"anna", "test", 5}}));
  EXPECT_EQ(carry_out("a.json"), nullptr);
  EXPECT_TRUE(changer_->is_done());
  EXPECT_FALSE(changer_->succeeded());
  EXPECT_NE(changer_->error().text.view().find("there is no calibration"), std::string_view::npos);
  EXPECT_EQ(carry_out("not-there.json"), nullptr);
  EXPECT_FALSE(changer_->succeeded());
  leave("b.json", "garbage");
  EXPECT_EQ(carry_out("b.json"), nullptr);
  EXPECT_EQ(changer_->error().code, Code::config);
}

TEST_F(CalibrationChangerTest, only_plain_names_of_files_in_its_folder_are_taken) {
  for (const char* name : {"", "../slabd.db", "/etc/passwd", ".hidden", "a/b", "a b", "x\n"})
    EXPECT_FALSE(changer_->accept(name, 1000).ok()) << name;
  EXPECT_FALSE(changer_->accept("good.json", 0xFFFF'FFFF).ok()) << "not requested";
  fs::create_symlink(dir_ / "slabd.db", dir_ / "changes" / "link.json");
  EXPECT_EQ(carry_out("link.json"), nullptr);
  EXPECT_FALSE(changer_->succeeded());
}

TEST_F(CalibrationChangerTest, one_change_at_a_time) {
  leave("1.json", change_json(KeepCalibration{hand_eye()}));
  ASSERT_TRUE(changer_->accept("1.json", 1).ok());
  const Status second = changer_->accept("2.json", 1);
  ASSERT_FALSE(second.ok());
  EXPECT_NE(second.error().text.view().find("under way"), std::string_view::npos);
}

TEST_F(CalibrationChangerTest, without_a_database_the_change_is_refused) {
  leave("1.json", change_json(KeepCalibration{hand_eye()}));
  ASSERT_TRUE(changer_->accept("1.json", 1).ok());
  changer_->started();
  changer_->carry_out(nullptr);
  EXPECT_EQ(changer_->finish(), nullptr);
  EXPECT_FALSE(changer_->succeeded());
}

}  // namespace
}  // namespace slabd::daemon
