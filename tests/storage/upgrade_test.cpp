// SPDX-License-Identifier: Apache-2.0
//
// Upgrade of a database of this program by a program of a later, invented schema version (next_versions.h).
#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>

#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "storage/files/file_checksum.h"
#include "storage/rows.h"
#include "tests/storage/next_versions.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

std::string whole(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// A connection without slabd's settings.
class Plain {
 public:
  explicit Plain(const std::string& path) { EXPECT_EQ(sqlite3_open(path.c_str(), &db_), SQLITE_OK); }
  ~Plain() { EXPECT_EQ(sqlite3_close(db_), SQLITE_OK); }
  Plain(const Plain&) = delete;
  Plain& operator=(const Plain&) = delete;

  void run(const std::string& sql) {
    EXPECT_EQ(sqlite3_exec(db_, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(db_) << " " << sql;
  }
  /// First column of all rows.
  std::vector<std::string> column(const std::string& sql) {
    std::vector<std::string> values;
    sqlite3_stmt* statement = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(db_, sql.c_str(), -1, &statement, nullptr), SQLITE_OK) << sqlite3_errmsg(db_);
    while (sqlite3_step(statement) == SQLITE_ROW)
      values.emplace_back(reinterpret_cast<const char*>(sqlite3_column_text(statement, 0)));
    sqlite3_finalize(statement);
    return values;
  }
  std::string text(const std::string& sql) { return column(sql).at(0); }

 private:
  sqlite3* db_ = nullptr;
};

class UpgradeTest : public StoreTest {
 protected:
  /// Creates slab 1, ended, and slab 2, open with station 5 measured, in a database of this program.
  void make_old() {
    open();
    for (std::int64_t key = 1; key <= 2; ++key) {
      begin(key);
      acquire(key, 5, 1);
      PlcResult record = random_record(prng_, ++res_seq_, 1);
      record.station = 5;
      blocks_.push_back(random_block(prng_, 5, Verdict::fail));
      apply(BlockJob{key, 1, blocks_.back(), record});
      if (key == 1) end(key, Verdict::fail);
    }
    close();
  }
  [[nodiscard]] std::string backup(int version = kSchemaVersion) const {
    return settings_.db_path + ".v" + std::to_string(version) + "-backup";
  }
  /// Checks that every start of an upgrading program fails for `reason`, and leaves the old database and one copy.
  void expect_refused(const std::string& reason) {
    for (int start = 0; start < 3; ++start) {
      const Result<std::unique_ptr<Store>> store = open_store(settings_);
      ASSERT_FALSE(store.ok());
      EXPECT_EQ(store.error().code, Code::journal_write);
      EXPECT_NE(store.error().text.view().find(reason), std::string_view::npos) << store.error().text.view();
    }
    EXPECT_TRUE(fs::exists(backup()));
    EXPECT_FALSE(fs::exists(backup() + ".2")) << "every start filled the disk with another copy";
    Plain db(settings_.db_path);
    EXPECT_EQ(db.text("PRAGMA user_version"), kOld);
    EXPECT_EQ(db.text("SELECT count(*) FROM pragma_table_info('slab') WHERE name = 'batch'"), "0");
    EXPECT_EQ(db.text("SELECT count(*) FROM sqlite_schema WHERE name = 'batch'"), "0");
    EXPECT_EQ(db.text("SELECT count(*) FROM block"), "2");
  }

  const std::string kOld = std::to_string(kSchemaVersion);
  const std::string kNew = std::to_string(NextVersions::kLast);
  std::vector<BlockResult> blocks_;
};

TEST_F(UpgradeTest, old_slabs_are_read_and_new_ones_written) {
  make_old();
  const NextVersions later;
  open();
  const auto line = recover();
  EXPECT_TRUE(line->slab_open);
  EXPECT_EQ(line->last_slab_key, 2);
  expect_same(line->stations[4].block, blocks_[1]);
  EXPECT_EQ(line->unacknowledged.size(), 3U);

  Result<std::optional<SlabRecord>> old = reader()->slab(1);
  ASSERT_TRUE(old.ok()) << old.error().text.view();
  ASSERT_TRUE(old.value().has_value());
  ASSERT_EQ(old.value()->blocks.size(), 1U);
  expect_same(old.value()->blocks[0].block, blocks_[0]);
  EXPECT_EQ(old.value()->summary.verdict, Verdict::fail);
  EXPECT_TRUE(old.value()->slab.items.full());

  end(2, Verdict::pass);
  begin(3);
  acquire(3, 7, 1);
  const BlockResult block = random_block(prng_, 7, Verdict::pass);
  PlcResult record = random_record(prng_, ++res_seq_, 1);
  record.station = 7;
  apply(BlockJob{3, 1, block, record});
  open();  // as after a restart
  expect_same(recover()->stations[6].block, block);
  close();
  Plain db(settings_.db_path);
  EXPECT_EQ(db.text("PRAGMA user_version"), kNew);
  EXPECT_EQ(db.column("SELECT batch FROM slab"), (std::vector<std::string>{"0", "0", "0"}));
}

TEST_F(UpgradeTest, a_database_of_a_version_between_takes_only_the_steps_after_it) {
  make_old();
  {
    const NextVersions later(NextVersions::kFirst);
    open();
    (void)recover();
    close();
  }
  {
    Plain db(settings_.db_path);
    EXPECT_EQ(db.text("PRAGMA user_version"), std::to_string(NextVersions::kFirst));
    EXPECT_EQ(db.text("SELECT count(*) FROM pragma_table_info('item') WHERE name = 'batch_U'"), "0");
    db.run("INSERT INTO batch VALUES (4, 1000)");
  }
  const NextVersions later;
  open();
  expect_same(recover()->stations[4].block, blocks_[1]);
  close();
  EXPECT_TRUE(fs::exists(backup()));
  EXPECT_TRUE(fs::exists(backup(NextVersions::kFirst)));
  Plain db(settings_.db_path);
  EXPECT_EQ(db.text("PRAGMA user_version"), kNew);
  EXPECT_EQ(db.text("SELECT number FROM batch WHERE strength IS NULL"), "4");
}

TEST_F(UpgradeTest, an_older_program_refuses_the_new_version_and_leaves_it_unchanged) {
  make_old();
  {
    const NextVersions later;
    open();
    close();
  }
  const std::string before = whole(settings_.db_path);
  const std::string told = "newer slabd (schema version " + kNew + ", this program supports up to " + kOld + ")";
  const Result<std::unique_ptr<Store>> store = open_store(settings_);
  ASSERT_FALSE(store.ok());
  EXPECT_EQ(store.error().code, Code::journal_write);
  EXPECT_NE(store.error().text.view().find(settings_.db_path), std::string_view::npos) << store.error().text.view();
  EXPECT_NE(store.error().text.view().find(told), std::string_view::npos) << store.error().text.view();
  const Result<std::unique_ptr<Reader>> early = open_reader(settings_.db_path);
  ASSERT_FALSE(early.ok());
  EXPECT_EQ(early.error().code, Code::config);
  EXPECT_NE(early.error().text.view().find(told), std::string_view::npos) << early.error().text.view();
  EXPECT_TRUE(whole(settings_.db_path) == before);
}

TEST_F(UpgradeTest, calibrations_keep_their_places_when_a_step_makes_their_table_again) {
  make_old();
  {
    Plain db(settings_.db_path);
    db.run(
        "INSERT INTO calibration VALUES (7, 'mb-000000000000', 'monitor_ball', 0, '', '{}', 'o', 'c', 'anna', 'r', "
        "'s', "
        "21.5, 'slabd', 1000, 0, '1');"
        "INSERT INTO monitor_ball VALUES ('mb-000000000000', 1, 2, 3, 19, 0.1);"
        "INSERT INTO applied VALUES (3, 'monitor_ball', 0, 0, 'mb-000000000000', '', 0, 'anna', 'new', 1001, '1')");
  }
  const NextVersions later;
  open();
  (void)recover();
  const auto kept = reader()->calibration("mb-000000000000");
  ASSERT_TRUE(kept.ok() && kept.value().has_value());
  EXPECT_EQ(kept.value()->temperature_c, 21.5);
  EXPECT_EQ(std::get<MonitorBall>(kept.value()->numbers).radius_mm, 19.0);
  ASSERT_EQ(reader()->applied(10).value().size(), 1U);
  CalibrationRecord scanner;
  ScannerNumbers numbers;
  numbers.plates = 1;
  scanner.numbers = numbers;
  const Result<std::string> id = store_->change(KeepCalibration{scanner});
  EXPECT_TRUE(id.ok()) << id.error().text.view();
  close();
  Plain db(settings_.db_path);
  EXPECT_EQ(db.text("SELECT count(*) FROM pragma_foreign_key_check"), "0");
  EXPECT_EQ(db.text("SELECT seq FROM calibration WHERE kind = 'monitor_ball'"), "7");
}

TEST_F(UpgradeTest, a_step_that_loses_a_calibration_is_not_committed) {
  make_old();
  {
    Plain db(settings_.db_path);
    db.run(
        "INSERT INTO calibration VALUES (7, 'mb-000000000000', 'monitor_ball', 0, '', '{}', 'o', 'c', 'anna', 'r', "
        "'s', 21.5, 'slabd', 1000, 0, '1');"
        "INSERT INTO monitor_ball VALUES ('mb-000000000000', 1, 2, 3, 19, 0.1)");
  }
  const NextVersions later("DROP TRIGGER calibration_is_kept; DELETE FROM calibration");
  expect_refused("calibrations that others refer to would be lost");
  Plain db(settings_.db_path);
  EXPECT_EQ(db.text("SELECT id FROM calibration"), "mb-000000000000");
  EXPECT_EQ(db.text("SELECT count(*) FROM sqlite_schema WHERE name = 'calibration_is_kept'"), "1");
}

TEST_F(UpgradeTest, copy_of_the_old_database_is_kept_next_to_it) {
  make_old();
  const NextVersions later;
  open();
  close();
  {
    Plain copy(backup());
    EXPECT_EQ(copy.text("PRAGMA user_version"), kOld);
    EXPECT_EQ(copy.text("PRAGMA integrity_check"), "ok");
    EXPECT_TRUE(check_checksum(backup()).value().present) << "and it can be proven";
    EXPECT_EQ(check_checksum(backup()).value().trouble, "");
    EXPECT_EQ(copy.text("SELECT count(*) FROM block"), "2");
    EXPECT_EQ(copy.text("SELECT count(*) FROM pragma_table_info('slab') WHERE name = 'batch'"), "0");
  }
  EXPECT_FALSE(fs::exists(backup() + ".part"));
  const std::string before = whole(backup());
  open();  // nothing is left to upgrade
  close();
  EXPECT_EQ(whole(backup()), before);
  EXPECT_FALSE(fs::exists(backup() + ".2"));
}

TEST_F(UpgradeTest, no_copy_is_ever_overwritten) {
  make_old();
  std::ofstream(backup()) << "kept by hand";
  const NextVersions later;
  open();
  close();
  EXPECT_EQ(whole(backup()), "kept by hand");
  Plain copy(backup() + ".2");
  EXPECT_EQ(copy.text("SELECT count(*) FROM block"), "2");
}

TEST_F(UpgradeTest, an_upgrade_that_fails_leaves_the_old_database_and_one_copy) {
  make_old();
  {
    Plain db(settings_.db_path);
    db.run("ALTER TABLE item ADD COLUMN batch_U REAL");  // conflicts with the last step
  }
  const NextVersions later;
  expect_refused("batch_U");
}

TEST_F(UpgradeTest, without_a_copy_the_database_is_not_changed) {
  make_old();
  fs::create_directories(backup() + ".part/in the way");
  const NextVersions later;
  const Result<std::unique_ptr<Store>> store = open_store(settings_);
  ASSERT_FALSE(store.ok());
  Plain db(settings_.db_path);
  EXPECT_EQ(db.text("PRAGMA user_version"), kOld);
  EXPECT_EQ(db.text("SELECT count(*) FROM sqlite_schema WHERE name = 'batch'"), "0");
}

class UpgradeFromTest : public UpgradeTest, public ::testing::WithParamInterface<int> {};
INSTANTIATE_TEST_SUITE_P(Version, UpgradeFromTest, ::testing::Values(NextVersions::kFirst, NextVersions::kLast));

TEST_P(UpgradeFromTest, upgraded_tables_are_those_of_a_fresh_database) {
  make_old();
  const std::string upgraded_path = settings_.db_path;
  const NextVersions later(GetParam());
  open();
  close();
  settings_.db_path = folder_.path() + "/fresh/slabd.db";
  settings_.spool_dir = folder_.path() + "/fresh/spool";
  open();
  close();
  Plain fresh(settings_.db_path);
  Plain upgraded(upgraded_path);
  EXPECT_EQ(fresh.text("PRAGMA user_version"), std::to_string(GetParam()));
  for (const std::string& table : fresh.column("SELECT name FROM sqlite_schema WHERE type = 'table'")) {
    const std::string columns =
        "SELECT name || ' ' || type || ' ' || \"notnull\" || ' ' || coalesce(dflt_value, '-') "
        "FROM pragma_table_info('" +
        table + "') ORDER BY name";
    EXPECT_EQ(upgraded.column(columns), fresh.column(columns)) << table;
  }
  EXPECT_EQ(upgraded.column("SELECT name FROM sqlite_schema ORDER BY name"),
            fresh.column("SELECT name FROM sqlite_schema ORDER BY name"));
}

TEST_F(UpgradeTest, a_reader_leaves_it_unchanged_and_reports_what_to_do) {
  make_old();
  const NextVersions later;
  const Result<std::unique_ptr<Reader>> early = open_reader(settings_.db_path);
  ASSERT_FALSE(early.ok());
  EXPECT_EQ(early.error().code, Code::config);
  EXPECT_NE(early.error().text.view().find("schema version " + kOld + " of an older slabd"), std::string_view::npos)
      << early.error().text.view();
  EXPECT_FALSE(fs::exists(backup()));
}

TEST_F(UpgradeTest, a_copy_that_does_not_fit_is_not_left_to_fill_the_disk) {
  make_old();
  const std::string before = whole(settings_.db_path);
  const NextVersions later;
  struct rlimit unlimited {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &unlimited), 0);
  ASSERT_GT(before.size(), 65'536U);
  const struct rlimit small { 65'536, unlimited.rlim_max };
  const auto old_handler = signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const bool opened = open_store(settings_).ok();
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
  signal(SIGXFSZ, old_handler);
  EXPECT_FALSE(opened);
  EXPECT_TRUE(whole(settings_.db_path) == before);
  for (const char* side : {"", ".part", ".part-journal"}) EXPECT_FALSE(fs::exists(backup() + side)) << side;
  open();
  EXPECT_EQ(recover()->last_slab_key, 2);
  EXPECT_TRUE(fs::exists(backup()));
}

TEST(BudgetColumns, are_named_after_the_parts) {
  for (std::size_t part = 0; part < kBudgetParts; ++part)
    EXPECT_EQ(kBudgetColumns[part], "budget_" + std::string(name(static_cast<BudgetPart>(part))));
}

}  // namespace
}  // namespace slabd::storage
