// SPDX-License-Identifier: Apache-2.0
//
// A backup replaces the current database: missing data is reported, and never invented.
#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "storage/files/log_copy.h"
#include "storage/files/quarantine.h"
#include "tests/storage/next_versions.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

class RestoreTest : public StoreTest {
 protected:
  void SetUp() override {
    open();
    (void)recover();
    begin(1);
    apply(AckJob{scan(1, 1, 1)});
    apply(AckJob{end(1, Verdict::pass)});
    begin(2);
    scan(2, 1, 1);
    close();
    ASSERT_TRUE(back_up_database(settings_.db_path, backup_).ok());
    open();
    (void)recover();
    end(2, Verdict::fail);
    begin(3);
    apply(AckJob{end(3, Verdict::pass)});
    close();
  }
  [[nodiscard]] Status restore(const std::string& from, bool lose_calibrations = false) {
    return restore_database(settings_,
                            {from, {"anna", "the disk broke", 1'700'000'000'000'000}, 4711, lose_calibrations});
  }
  /// Applies a hand-eye calibration to the current database.
  void calibrate(double height_mm = 150.0) {
    open();
    CalibrationRecord record;
    HandEyeNumbers numbers;
    numbers.T_flange_scanner.translation_mm = Vec3(1.0, 2.0, height_mm);
    numbers.sigma_mm = 0.02;
    numbers.sigma_rad = 1e-5;
    record.numbers = numbers;
    record.figures = "{}";
    record.operator_name = "anna";
    const Result<std::string> kept = store_->change(KeepCalibration{record});
    ASSERT_TRUE(kept.ok()) << kept.error().text.view();
    const Result<std::string> applied =
        store_->change(ApplyCalibration{kept.value(), {"anna", "the scanner was knocked", 1'700'000'000'000'000}});
    ASSERT_TRUE(applied.ok()) << applied.error().text.view();
    close();
  }
  [[nodiscard]] std::vector<std::string> left_in_folder() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(fs::path(settings_.db_path).parent_path()))
      names.push_back(entry.path().filename().string());
    return names;
  }

  std::string backup_ = folder_.path() + "/backup.db";
};

TEST_F(RestoreTest, the_backup_is_used_and_the_history_records_a_gap) {
  ASSERT_TRUE(restore(backup_).ok());
  open();
  const auto line = recover();
  EXPECT_EQ(line->session, 4711);
  EXPECT_EQ(line->res_seq, 4711) << "RES_ACK may stand at a record that is not in the backup";
  EXPECT_EQ(line->last_slab_key, 3) << "key 3 was used by a slab that is not in the backup";
  EXPECT_FALSE(line->slab_open) << "what was open yesterday is not open now";
  EXPECT_EQ(line->slab_verdict, Verdict::aborted);
  const auto gaps = reader()->gaps();
  ASSERT_TRUE(gaps.ok());
  ASSERT_EQ(gaps.value().size(), 1U);
  EXPECT_EQ(gaps.value()[0].what, HistoryGap::What::restored);
  EXPECT_EQ(gaps.value()[0].note.who, "anna");
  EXPECT_EQ(gaps.value()[0].note.why, "the disk broke");
  EXPECT_EQ(gaps.value()[0].source, backup_);
  EXPECT_EQ(gaps.value()[0].slab_key, 3);
  EXPECT_EQ(gaps.value()[0].kept_key, 2) << "slab 3 alone is missing";
  const auto slab = reader()->slab(1);
  ASSERT_TRUE(slab.ok() && slab.value().has_value());
  EXPECT_EQ(slab.value()->summary.verdict, Verdict::pass);
  begin(4);
  apply(AckJob{scan(4, 1, 1)});
  const std::uint16_t newest = res_seq_;
  close();
  open();
  EXPECT_EQ(recover()->res_seq, newest) << "of the newest record";
  close();
  const auto report = check_database(settings_.db_path, true);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report.value().trouble, "");
}

TEST_F(RestoreTest, the_first_scan_after_it_is_not_accepted_as_new) {
  for (const std::string& from : {backup_, std::string()}) {
    ASSERT_TRUE(restore(from).ok());
    open();
    std::uint64_t newest = 0;
    const auto line = recover();
    for (const std::uint64_t fingerprint : line->fingerprints)
      if (fingerprint != 0) newest = fingerprint;
    EXPECT_EQ(newest, kUnseenScan) << from;
    close();
  }
}

TEST_F(RestoreTest, scans_that_only_the_lost_database_recorded_are_kept) {
  // Slab 2 was open when the backup was made; station 2 was scanned after that.
  const std::string later = scan_file(2, 2, 1, 1000);
  ASSERT_TRUE(restore(backup_).ok());
  open();
  (void)recover();
  EXPECT_TRUE(fs::exists(later));
}

TEST_F(RestoreTest, calibrations_are_not_lost_without_a_word) {
  calibrate();
  for (const std::string& from : {backup_, std::string()}) {
    const Status status = restore(from);
    ASSERT_FALSE(status.ok()) << from;
    EXPECT_EQ(status.error().code, Code::config);
    EXPECT_NE(status.error().text.view().find("1 change of calibrations"), std::string_view::npos)
        << status.error().text.view();
    EXPECT_NE(status.error().text.view().find("--lose-calibrations"), std::string_view::npos);
  }
  ASSERT_TRUE(restore(backup_, true).ok());
  open();
  EXPECT_EQ(recover()->slab_verdict, Verdict::aborted);
}

TEST_F(RestoreTest, decisions_and_resets_are_not_lost_without_a_word) {
  open();
  DispositionRecord decision;
  decision.slab_key = 2;
  decision.utime_us = 1'700'000'000'000'000;
  decision.who = decision.authority = "mei";
  decision.decision = Disposition::scrap;
  decision.reason = "burr at block 4";
  ASSERT_TRUE(store_->change(KeepDisposition{decision}).ok());
  close();
  const Status status = restore(backup_);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().text.view().find("lost: 1 decision about a slab. "), std::string_view::npos)
      << status.error().text.view();
  const std::string now = folder_.path() + "/now.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, now).ok());
  EXPECT_TRUE(restore(now).ok()) << "it is in the backup";
  EXPECT_TRUE(restore(backup_, true).ok());
}

TEST_F(RestoreTest, calibrations_are_not_exchanged_for_as_many_others_without_a_word) {
  // A backup with a calibration; then an older one is restored and the line is calibrated again: one change in each.
  calibrate(150.0);
  const std::string then = folder_.path() + "/then.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, then).ok());
  ASSERT_TRUE(restore(backup_, true).ok());
  calibrate(151.0);
  const Status status = restore(then);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::config);
  EXPECT_NE(status.error().text.view().find("1 change of calibrations"), std::string_view::npos)
      << status.error().text.view();
  // If the backup contains all changes, nothing is lost.
  const std::string now = folder_.path() + "/now.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, now).ok());
  EXPECT_TRUE(restore(now).ok());
}

TEST_F(RestoreTest, an_interrupted_one_without_a_database_begins_no_history) {
  for (const char* left : {".restored.part", ".restored"}) {
    settings_.db_path = folder_.path() + "/disk" + left + "/slabd.db";
    settings_.spool_dir = folder_.path() + "/disk" + left + "/spool";
    fs::create_directories(settings_.spool_dir);
    std::ofstream(settings_.db_path + left) << "half of a backup";
    const auto store = open_store(settings_);
    ASSERT_FALSE(store.ok()) << left;
    EXPECT_NE(store.error().text.view().find("shows that there was one"), std::string_view::npos)
        << store.error().text.view();
    EXPECT_FALSE(fs::exists(settings_.db_path)) << left;
    // Repeated with a backup that cannot be upgraded: the remaining file is small, but still proves the database.
    {
      const NextVersions later("ALTER TABLE nowhere ADD COLUMN a");
      const Status status = restore(backup_);
      ASSERT_FALSE(status.ok());
      EXPECT_NE(status.error().text.view().find("nowhere"), std::string_view::npos) << status.error().text.view();
    }
    EXPECT_LT(file_bytes(settings_.db_path + ".restored"), 1000);
    EXPECT_FALSE(open_store(settings_).ok()) << left;
    ASSERT_TRUE(restore(backup_).ok());
    EXPECT_FALSE(fs::exists(settings_.db_path + ".restored")) << "it is the database now";
    open();
    EXPECT_EQ(recover()->last_slab_key, 2);
    close();
  }
}

TEST_F(RestoreTest, a_failed_one_leaves_no_file) {
  settings_.db_path = folder_.path() + "/disk/slabd.db";
  fs::create_directories(folder_.path() + "/disk");
  for (const char* side : {"-wal", "-shm", "-journal", kLogCopy}) {
    const std::string stray = settings_.db_path + side;
    std::ofstream(stray) << "of whom?";
    const Status status = restore(backup_);
    ASSERT_FALSE(status.ok()) << side;
    EXPECT_NE(status.error().text.view().find("without its database"), std::string_view::npos)
        << status.error().text.view();
    for (const std::string& name : left_in_folder())
      EXPECT_EQ(name.find(kRestored), std::string::npos) << name << " stays, with " << side;
    EXPECT_TRUE(fs::exists(stray)) << "an operator has to look at it";
    fs::remove(stray);
  }
  ASSERT_TRUE(restore(backup_).ok());
}

TEST_F(RestoreTest, a_backup_that_cannot_be_upgraded_leaves_no_file_and_the_database_unchanged) {
  {
    const NextVersions later("ALTER TABLE nowhere ADD COLUMN a");
    const Status status = restore(backup_);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().text.view().find("nowhere"), std::string_view::npos) << status.error().text.view();
  }
  for (const std::string& name : left_in_folder()) EXPECT_EQ(name.find(kRestored), std::string::npos) << name;
  open();
  EXPECT_EQ(recover()->last_slab_key, 3);
}

TEST_F(RestoreTest, a_backup_of_an_older_version_is_brought_up_to_date_without_another_copy) {
  const NextVersions later;
  const Status status = restore(backup_);
  ASSERT_TRUE(status.ok()) << status.error().text.view();
  for (const std::string& name : left_in_folder()) EXPECT_EQ(name.find("-backup"), std::string::npos) << name;
  EXPECT_EQ(check_database(settings_.db_path, true).value().version, NextVersions::kLast);
  open();
  EXPECT_EQ(recover()->slab_verdict, Verdict::aborted);
}

TEST_F(RestoreTest, remains_of_an_interrupted_restore_are_not_a_backup) {
  const std::string left = settings_.db_path + ".restored";
  fs::copy_file(backup_, left);
  const Status status = restore(left);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::config) << status.error().text.view();
  EXPECT_TRUE(fs::exists(left)) << "it may be the only one";
  ASSERT_TRUE(restore(backup_).ok());
}

TEST_F(RestoreTest, repeated_after_an_interruption_still_reports_what_would_be_lost) {
  calibrate();
  // Interrupted after the database was moved to quarantine, before the backup was renamed.
  ASSERT_TRUE(quarantine(settings_.db_path, kReplaced).ok());
  const std::string note = quarantine_note(settings_.db_path).value();
  EXPECT_EQ(note.find("damaged"), std::string::npos) << note;
  const Status status = restore(backup_);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::config);
  EXPECT_NE(status.error().text.view().find("1 change of calibrations"), std::string_view::npos)
      << status.error().text.view();
  ASSERT_TRUE(restore(backup_, true).ok());
  open();
  EXPECT_EQ(recover()->last_slab_key, 3) << "key 3 was used by a slab that is not in the backup";
}

TEST_F(RestoreTest, previous_database_is_kept_in_quarantine) {
  ASSERT_TRUE(restore(backup_).ok());
  int kept = 0;
  for (const std::string& name : left_in_folder())
    if (name.find(".quarantine-") != std::string::npos) {
      const auto report =
          check_database(fs::path(settings_.db_path).parent_path().string() + "/" + name + "/slabd.db", true);
      ASSERT_TRUE(report.ok()) << report.error().text.view();
      EXPECT_EQ(report.value().slabs, 3);
      ++kept;
    }
  EXPECT_EQ(kept, 1);
}

TEST_F(RestoreTest, is_refused_while_the_daemon_runs) {
  open();
  const Status status = restore(backup_);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().text.view().find("already open for writing"), std::string_view::npos);
  EXPECT_EQ(recover()->last_slab_key, 3);
}

TEST_F(RestoreTest, an_incomplete_backup_leaves_the_database_unchanged) {
  {
    std::fstream file(backup_, std::ios::in | std::ios::out | std::ios::binary);
    for (std::streamoff page = 5; page < 12; ++page) file.seekp(page * 4096) << std::string(3000, 'x');
  }
  const Status status = restore(backup_);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().text.view().find("not whole"), std::string_view::npos) << status.error().text.view();
  open();
  EXPECT_EQ(recover()->last_slab_key, 3);
}

TEST_F(RestoreTest, starting_with_an_empty_database_is_also_a_gap_and_uses_no_old_key) {
  const std::string scan = scan_file(9, 1, 1, 100);
  ASSERT_TRUE(restore("").ok());
  open();
  const auto line = recover();
  EXPECT_EQ(line->res_seq, 4711);
  EXPECT_EQ(line->last_slab_key, 9) << "scans of slab 9 lie in the spool";
  EXPECT_FALSE(line->slab_open);
  const auto gaps = reader()->gaps();
  ASSERT_TRUE(gaps.ok());
  ASSERT_EQ(gaps.value().size(), 1U);
  EXPECT_EQ(gaps.value()[0].what, HistoryGap::What::begun_anew);
  EXPECT_TRUE(fs::exists(scan));
}

TEST_F(RestoreTest, after_a_quarantine_restoring_brings_the_line_back) {
  {
    std::fstream file(settings_.db_path, std::ios::in | std::ios::out | std::ios::binary);
    for (std::streamoff page = 5; page < 10; ++page) file.seekp(page * 4096) << std::string(2048, '\x5a');
  }
  ASSERT_FALSE(open_store(settings_).ok());
  ASSERT_FALSE(open_store(settings_).ok());
  ASSERT_TRUE(restore(backup_).ok());
  open();
  EXPECT_EQ(recover()->slab_verdict, Verdict::aborted);
}

TEST_F(RestoreTest, a_gap_without_lost_slabs_is_recorded_for_a_backup_with_every_slab) {
  const std::string newer = folder_.path() + "/newer.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, newer).ok());
  ASSERT_TRUE(restore(newer).ok());
  open();
  (void)recover();
  auto gap = reader()->gaps().value()[0];
  EXPECT_EQ(gap.slab_key, 3);
  EXPECT_EQ(gap.kept_key, 3);
  begin(4);
  apply(AckJob{end(4, Verdict::pass)});
  gap = reader()->gaps().value()[0];
  EXPECT_EQ(gap.kept_key, 3) << "slab 4 came afterwards";
}

TEST_F(RestoreTest, can_be_repeated_and_is_recorded_again) {
  ASSERT_TRUE(restore(backup_).ok());
  ASSERT_TRUE(restore(backup_).ok());
  open();
  EXPECT_EQ(reader()->gaps().value().size(), 1U) << "the backup knows nothing of the first time";
  EXPECT_EQ(recover()->last_slab_key, 3);
}

}  // namespace
}  // namespace slabd::storage
