// SPDX-License-Identifier: Apache-2.0
//
// Databases of every older schema version, made with the old schema's own text, meet this program.
#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>

#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "storage/files/file_checksum.h"
#include "storage/rows.h"
#include "tests/places/places.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

std::string whole(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// One connection without any of our settings.
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
  /// The first column of all rows.
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

/// What a record written before version 9 knows.
BlockResult before_version_9(BlockResult block) {
  block.scan.step_mm = Vec3::Zero();
  block.findings.clear();
  block.edges.clear();
  block.pores = {};
  for (PlaneFit* plane :
       {&block.seat.plane, &block.seat.full_plane, &block.jaw_inner, &block.jaw_outer, &block.slab_top})
    plane->doubt = PlaneFit{}.doubt;
  for (CasingFeature* casing : {&block.casing_inner, &block.casing_outer}) casing->doubt = CasingFeature{}.doubt;
  for (double* x : {&block.seat.flatness_closed_mm, &block.seat.flatness_raw_mm, &block.seat.flatness_trimmed_mm})
    *x = kNoValue;
  return block;
}

/// What a record written by version 1 knows.
BlockResult without_news(BlockResult block) {
  const BlockResult fresh;
  block = before_version_9(block);
  block.registration.noise_mm = fresh.registration.noise_mm;
  block.registration.covariance = fresh.registration.covariance;
  for (PlaneFit* plane :
       {&block.seat.plane, &block.seat.full_plane, &block.jaw_inner, &block.jaw_outer, &block.slab_top}) {
    plane->centroid = PlaneFit{}.centroid;
    plane->sigma_offset_mm = PlaneFit{}.sigma_offset_mm;
    plane->cov_normal = PlaneFit{}.cov_normal;
  }
  for (CasingFeature* casing : {&block.casing_inner, &block.casing_outer}) {
    const CasingFeature old = *casing;
    *casing = {};
    casing->ok = old.ok;
    casing->centre = old.centre;
    casing->radius_mm = old.radius_mm;
    casing->height_mm = old.height_mm;
    casing->edge_points = old.edge_points;
    casing->rim_points = old.rim_points;
  }
  block.seat.noise_factor = fresh.seat.noise_factor;
  block.seat.flatness_noise_mm = fresh.seat.flatness_noise_mm;
  block.seat.defect = fresh.seat.defect;
  block.observation.sigma_p_mm = fresh.observation.sigma_p_mm;
  block.observation.sigma_jaw_mm = fresh.observation.sigma_jaw_mm;
  block.observation.sigma_n_rad = fresh.observation.sigma_n_rad;
  block.observation.sigma_top_n_rad = fresh.observation.sigma_top_n_rad;
  for (Item& item : block.items) item.budget = {};
  return block;
}

class UpgradeTest : public StoreTest {
 protected:
  void make_version_1() { make_version(1); }
  /// Slab 1 ended, slab 2 open with station 5 measured; then everything `version` would have kept of it, in a database
  /// of that version at `settings_.db_path`.
  void make_version(int version) {
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
    const std::string newer = settings_.db_path;
    settings_.db_path = folder_.path() + "/old/slabd.db";
    fs::create_directories(folder_.path() + "/old");
    Plain db(settings_.db_path);
    db.run("PRAGMA journal_mode = WAL");
    db.run(whole(places::source_dir() + "/tests/storage/schema_v" + std::to_string(version) + ".sql"));
    db.run("PRAGMA application_id = 1397506370; PRAGMA user_version = " + std::to_string(version));
    db.run("DELETE FROM line; ATTACH '" + newer + "' AS newer");
    for (const std::string& table : db.column("SELECT name FROM main.sqlite_schema WHERE type = 'table'")) {
      const std::string names = joined(db.column("SELECT name FROM pragma_table_info('" + table + "', 'main')"), ", ");
      db.run("INSERT INTO main." + table + " (" + names + ") SELECT " + names + " FROM newer." + table);
    }
  }
  [[nodiscard]] std::string backup() const { return settings_.db_path + ".v1-backup"; }

  std::vector<BlockResult> blocks_;
};

TEST_F(UpgradeTest, old_slabs_are_read_and_new_ones_written) {
  make_version_1();
  open();
  const auto line = recover();
  EXPECT_TRUE(line->slab_open);
  EXPECT_EQ(line->last_slab_key, 2);
  expect_same(line->stations[4].block, without_news(blocks_[1]));
  EXPECT_EQ(line->unacknowledged.size(), 3U);

  Result<std::optional<SlabRecord>> old = reader()->slab(1);
  ASSERT_TRUE(old.ok()) << old.error().text.view();
  ASSERT_TRUE(old.value().has_value());
  ASSERT_EQ(old.value()->blocks.size(), 1U);
  expect_same(old.value()->blocks[0].block, without_news(blocks_[0]));
  EXPECT_EQ(old.value()->summary.verdict, Verdict::fail);
  EXPECT_TRUE(old.value()->slab.items.full());
  for (const Item& item : old.value()->slab.items)
    for (const double part : item.budget) EXPECT_EQ(part, 0.0) << "no budget was computed";

  end(2, Verdict::pass);
  begin(3);
  acquire(3, 7, 1);
  const BlockResult block = random_block(prng_, 7, Verdict::pass);
  PlcResult record = random_record(prng_, ++res_seq_, 1);
  record.station = 7;
  apply(BlockJob{3, 1, block, record});
  open();  // as after a restart
  expect_same(recover()->stations[6].block, block);
}

TEST_F(UpgradeTest, slabs_of_version_2_keep_everything_and_say_that_no_splice_was_recorded) {
  make_version(2);
  open();
  const auto line = recover();
  ASSERT_TRUE(line->slab_open);
  expect_same(line->stations[4].block, before_version_9(blocks_[1]));
  EXPECT_EQ(line->stations[4].attempt.splice.source, SpliceSource::none);
  EXPECT_FALSE(has_value(line->stations[4].attempt.splice.calibration_mm)) << "nobody may take it for calibrated";
  EXPECT_EQ(line->stations[4].attempt.splice.T_base_reported.to_array(), Pose::identity().to_array());
  EXPECT_TRUE(line->slab.stations_id.empty());
  EXPECT_EQ(line->calibration.source, LineCalibration::Source::missing);
  EXPECT_TRUE(line->calibration.trouble.empty()) << "nothing was ever applied: the configuration's values count";
  EXPECT_TRUE(fs::exists(settings_.db_path + ".v2-backup"));
}

TEST_F(UpgradeTest, blocks_of_version_3_have_no_maps_and_new_ones_have) {
  make_version(3);
  open();
  const auto line = recover();
  expect_same(line->stations[4].block, before_version_9(blocks_[1]));
  Result<std::unique_ptr<BlockMaps>> maps = reader()->maps(2, 5, 1);
  ASSERT_TRUE(maps.ok()) << maps.error().text.view();
  EXPECT_TRUE(maps.value()->registration.empty() && maps.value()->seat.empty());
  acquire(2, 6, 1);
  PlcResult record = random_record(prng_, ++res_seq_, 1);
  record.station = 6;
  const BlockJob job{2, 1, random_block(prng_, 6, Verdict::pass), record, random_maps(prng_)};
  apply(job);
  maps = reader()->maps(2, 6, 1);
  ASSERT_TRUE(maps.ok()) << maps.error().text.view();
  expect_same(maps.value()->seat, job.maps.seat);
}

TEST_F(UpgradeTest, scans_of_version_6_have_no_checksum_and_new_ones_may) {
  make_version(6);
  open();
  const auto line = recover();
  EXPECT_FALSE(line->stations[4].attempt.points_crc32c.has_value());
  accept(PlcCommand::scan, 6, 2);
  Attempt a = attempt(2, 6, 1);
  a.points_crc32c = 0xFFFF'FFFFU;
  apply(AcquiredJob{a});
  EXPECT_EQ(recover()->stations[5].attempt.points_crc32c, 0xFFFF'FFFFU);
}

TEST_F(UpgradeTest, calibrations_keep_their_places_when_their_table_is_made_anew_for_the_scanners_acceptance) {
  make_version(7);
  {
    Plain db(settings_.db_path);
    db.run(
        "INSERT INTO calibration VALUES (7, 'mb-000000000000', 'monitor_ball', 0, '', '{}', 'o', 'c', 'anna', 'r', "
        "'s', "
        "21.5, 'slabd', 1000, 0);"
        "INSERT INTO monitor_ball VALUES ('mb-000000000000', 1, 2, 3, 19, 0.1);"
        "INSERT INTO applied VALUES (3, 'monitor_ball', 0, 0, 'mb-000000000000', '', 0, 'anna', 'new', 1001)");
  }
  open();
  EXPECT_TRUE(recover()->slab.scanner_id.empty()) << "older slabs were measured without an acceptance";
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

TEST_F(UpgradeTest, copy_of_the_old_database_stays_beside_it) {
  make_version_1();
  open();
  close();
  {
    Plain copy(backup());
    EXPECT_EQ(copy.text("PRAGMA user_version"), "1");
    EXPECT_EQ(copy.text("PRAGMA integrity_check"), "ok");
    EXPECT_TRUE(check_checksum(backup()).value().present) << "and it can be proven";
    EXPECT_EQ(check_checksum(backup()).value().trouble, "");
    EXPECT_EQ(copy.text("SELECT count(*) FROM block"), "2");
    EXPECT_EQ(copy.text("SELECT count(*) FROM pragma_table_info('casing')"), "12");
  }
  EXPECT_FALSE(fs::exists(backup() + ".part"));
  const std::string before = whole(backup());
  open();  // nothing left to do
  close();
  EXPECT_EQ(whole(backup()), before);
  EXPECT_FALSE(fs::exists(backup() + ".2"));
}

TEST_F(UpgradeTest, no_copy_is_ever_overwritten) {
  make_version_1();
  std::ofstream(backup()) << "kept by somebody";
  open();
  close();
  EXPECT_EQ(whole(backup()), "kept by somebody");
  Plain copy(backup() + ".2");
  EXPECT_EQ(copy.text("SELECT count(*) FROM block"), "2");
}

TEST_F(UpgradeTest, an_upgrade_that_fails_leaves_the_old_database_and_one_copy) {
  make_version_1();
  {
    Plain db(settings_.db_path);
    db.run("ALTER TABLE item ADD COLUMN budget_reference REAL");  // in the way of the last step
  }
  for (int start = 0; start < 3; ++start) {
    const Result<std::unique_ptr<Store>> store = open_store(settings_);
    ASSERT_FALSE(store.ok());
    EXPECT_EQ(store.error().code, Code::journal_write);
    EXPECT_NE(store.error().text.view().find("budget_reference"), std::string_view::npos) << store.error().text.view();
  }
  EXPECT_TRUE(fs::exists(backup()));
  EXPECT_FALSE(fs::exists(backup() + ".2")) << "every start filled the disk with another copy";
  Plain db(settings_.db_path);
  EXPECT_EQ(db.text("PRAGMA user_version"), "1");
  EXPECT_EQ(db.text("SELECT count(*) FROM pragma_table_info('plane') WHERE name = 'sigma_offset_mm'"), "0");
  EXPECT_EQ(db.text("SELECT count(*) FROM block"), "2");
}

TEST_F(UpgradeTest, without_a_copy_nothing_is_changed) {
  make_version_1();
  fs::create_directories(backup() + ".part/in the way");
  const Result<std::unique_ptr<Store>> store = open_store(settings_);
  ASSERT_FALSE(store.ok());
  Plain db(settings_.db_path);
  EXPECT_EQ(db.text("PRAGMA user_version"), "1");
}

class UpgradeFromTest : public UpgradeTest, public ::testing::WithParamInterface<int> {};
INSTANTIATE_TEST_SUITE_P(Version, UpgradeFromTest, ::testing::Range(1, kSchemaVersion));

TEST_P(UpgradeFromTest, upgraded_tables_are_those_of_a_fresh_database) {
  open();
  close();
  const std::string fresh_path = settings_.db_path;
  make_version(GetParam());
  open();
  close();
  Plain fresh(fresh_path);
  Plain upgraded(settings_.db_path);
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

TEST_F(UpgradeTest, a_reader_changes_nothing_and_says_what_to_do) {
  make_version_1();
  const Result<std::unique_ptr<Reader>> early = open_reader(settings_.db_path);
  ASSERT_FALSE(early.ok());
  EXPECT_EQ(early.error().code, Code::config);
  EXPECT_NE(early.error().text.view().find("schema version 1 of an older slabd"), std::string_view::npos)
      << early.error().text.view();
  EXPECT_FALSE(fs::exists(backup()));
}

TEST_F(UpgradeTest, a_copy_that_does_not_fit_is_not_left_to_fill_the_disk) {
  make_version_1();
  const std::string before = whole(settings_.db_path);
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
