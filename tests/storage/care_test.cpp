// SPDX-License-Identifier: Apache-2.0
//
// Copies and retention by the daemon's writer, between its jobs.
#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "storage/files/backup.h"
#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;
using Phase = CareState::Phase;

class CareTest : public StoreTest {
 protected:
  void quiet(int looks) {
    for (int i = 0; i < looks; ++i) store_->idle();
  }
  /// Creates slabs that are ended, acknowledged and without scans.
  void slabs(std::int64_t first, std::int64_t last) {
    for (std::int64_t key = first; key <= last; ++key) {
      begin(key);
      scan_without_file(key, 1, 1);
      acknowledge(end(key, Verdict::pass));
    }
  }
  /// Creates a measured and acknowledged attempt with maps, whose scan has been deleted.
  void scan_without_file(std::int64_t key, int station, int number) {
    accept(PlcCommand::scan, station, key);
    apply(AcquiredJob{attempt(key, station, number)});
    PlcResult record = random_record(prng_, ++res_seq_, 1);
    record.station = static_cast<std::uint16_t>(station);
    record.cmd_seq = cmd_seq_;
    apply(BlockJob{key, static_cast<std::uint8_t>(number), random_block(prng_, station, Verdict::pass), record,
                   random_maps(prng_)});
    acknowledge(res_seq_);
  }
  [[nodiscard]] std::int64_t count(const std::string& table) const {
    Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
    EXPECT_TRUE(db.ok());
    return db.value()->integer("SELECT count(*) FROM " + table);
  }
  [[nodiscard]] std::string copy_path() const { return folder_.path() + "/copy.db"; }
};

TEST_F(CareTest, a_copy_holds_what_was_committed_before_and_while_it_was_made) {
  open();
  (void)recover();
  slabs(1, 19);
  begin(20);
  for (int station = 1; station <= 18; ++station)
    for (int attempt = 1; attempt <= 4; ++attempt) scan_without_file(20, station, attempt);
  acknowledge(end(20, Verdict::pass));
  ASSERT_TRUE(store_->order(BackupOrder{copy_path()}).ok());
  quiet(4);  // the first piece
  ASSERT_EQ(store_->care().backup, Phase::under_way);
  EXPECT_FALSE(fs::exists(copy_path())) << "it has its name only when it is whole";
  slabs(21, 22);
  quiet(40);
  const CareState state = store_->care();
  EXPECT_EQ(state.backup, Phase::done) << state.backup_error;
  EXPECT_EQ(state.backup_pages, state.backup_pages_all);
  EXPECT_FALSE(fs::exists(copy_path() + ".part"));
  EXPECT_FALSE(fs::exists(copy_path() + "-wal"));
  const Result<DatabaseReport> report = check_database(copy_path(), true);
  ASSERT_TRUE(report.ok()) << report.error().text.view();
  EXPECT_EQ(report.value().trouble, "");
  EXPECT_EQ(report.value().slabs, 22);
  EXPECT_EQ(report.value().newest_key, 22);
  EXPECT_EQ(report.value().version, kSchemaVersion);
  EXPECT_FALSE(fs::exists(copy_path() + "-wal")) << "looking at a copy changes nothing";
}

// slabctl gives up if the count stays the same for two minutes, in which 1.2 GB are read for the checksum.
TEST_F(CareTest, the_count_of_pages_changes_with_each_piece_of_the_copy_and_of_its_checksum) {
  open();
  (void)recover();
  slabs(1, 1);
  close();
  {
    Connection db(settings_.db_path, SQLITE_OPEN_READWRITE);
    db.execute("INSERT INTO recipe_text VALUES (hex(zeroblob(32)), 'large.toml', hex(zeroblob(2500000)), 1)");
  }
  open();
  (void)recover();
  ASSERT_TRUE(store_->order(BackupOrder{copy_path()}).ok());
  quiet(4);  // the first piece
  CareState before = store_->care();
  ASSERT_EQ(before.backup, Phase::under_way);
  ASSERT_GT(before.backup_pages, 0);
  int copied = 1;
  int read = 0;
  for (int piece = 0; piece < 100 && before.backup == Phase::under_way; ++piece) {
    quiet(1);
    const CareState after = store_->care();
    EXPECT_LE(after.backup_pages, after.backup_pages_all);
    if (after.backup == Phase::under_way) {
      EXPECT_NE(after.backup_pages, before.backup_pages) << "piece " << piece;
    }
    (read > 0 || after.backup_pages < before.backup_pages ? read : copied) += 1;
    before = after;
  }
  EXPECT_EQ(before.backup, Phase::done) << before.backup_error;
  EXPECT_EQ(before.backup_pages, before.backup_pages_all);
  EXPECT_GT(copied, 3);
  EXPECT_GT(read, 3);
}

TEST_F(CareTest, one_copy_at_a_time_and_none_over_an_existing_file) {
  open();
  (void)recover();
  ASSERT_TRUE(store_->order(BackupOrder{copy_path()}).ok());
  EXPECT_EQ(store_->order(BackupOrder{copy_path()}).error().code, Code::busy);
  quiet(10);
  ASSERT_EQ(store_->care().backup, Phase::done);
  ASSERT_TRUE(store_->order(BackupOrder{copy_path()}).ok());
  quiet(10);
  EXPECT_EQ(store_->care().backup, Phase::failed);
  EXPECT_NE(store_->care().backup_error.find("exists already"), std::string::npos);
  ASSERT_TRUE(store_->order(BackupOrder{folder_.path() + "/no folder/copy.db"}).ok());
  quiet(10);
  EXPECT_EQ(store_->care().backup, Phase::failed);
  begin(1);  // jobs continue
}

TEST_F(CareTest, needed_and_free_space_of_a_copy_are_reported_to_a_tenth_of_a_megabyte) {
  const Status status = check_room(folder_.path(), 1'000'000'000'000'050'000, "a copy");
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::store_full);
  const std::string text(status.error().text.view());
  EXPECT_NE(text.find("a copy needs 1000000000000.1 MB free, and " + folder_.path() + " has "), std::string::npos)
      << text;
  EXPECT_EQ(text[text.size() - 5], '.') << text;
  EXPECT_TRUE(check_room(folder_.path(), 0, "nothing").ok());
}

TEST_F(CareTest, a_copy_reserves_room_only_on_the_disk_of_the_scans) {
  TemporaryFolder other_disk("/dev/shm");
  if (share_a_disk(folder_.path(), other_disk.path())) GTEST_SKIP() << "this machine has one file system";
  settings_.spool_free_bytes_min = std::uint64_t{1} << 62U;  // more than any disk has
  const auto copy = [&] {
    open();
    (void)recover();
    EXPECT_TRUE(store_->order(BackupOrder{copy_path()}).ok());
    quiet(10);
    return store_->care();
  };
  const CareState refused = copy();
  EXPECT_EQ(refused.backup, Phase::failed);
  EXPECT_NE(refused.backup_error.find("with 200 MB left for a day's records and the room for the next slab's scans"),
            std::string::npos)
      << refused.backup_error;
  settings_.spool_dir = other_disk.path();
  const CareState made = copy();
  EXPECT_EQ(made.backup, Phase::done) << made.backup_error;
}

TEST_F(CareTest, a_partial_copy_left_by_a_kill_is_removed_at_the_next_start_and_one_under_way_stays) {
  open();
  (void)recover();
  slabs(1, 3);
  close();
  const std::string folder = fs::path(settings_.db_path).parent_path().string() + "/backups/";
  const std::string left = folder + "slabd-20260314T015900.123Z.db.part";
  std::ofstream(left) << "of a moment ago";
  const std::string somebodys = folder + "notes.part";
  std::ofstream(somebodys) << "precious";
  Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
  ASSERT_TRUE(db.ok());
  Backup under_way(*db.value(), folder + "slabd-20260314T020000.123Z.db", 0);
  EXPECT_FALSE(under_way.step(1));
  open();
  EXPECT_FALSE(fs::exists(left));
  EXPECT_TRUE(fs::exists(somebodys));
  EXPECT_TRUE(fs::exists(folder + "slabd-20260314T020000.123Z.db.part"));
  while (!under_way.step(-1)) {
  }
  EXPECT_EQ(check_database(folder + "slabd-20260314T020000.123Z.db", true).value().trouble, "");
}

TEST_F(CareTest, a_database_that_cannot_be_opened_here_is_not_called_damaged) {
  open();
  (void)recover();
  slabs(1, 1);
  close();
  fs::copy_file(settings_.db_path, copy_path());  // without a checksum, which any change would invalidate
  const auto set_version = [&](int version) {
    Connection db(copy_path(), SQLITE_OPEN_READWRITE);
    db.execute("PRAGMA user_version = " + std::to_string(version));
  };
  set_version(kSchemaVersion + 1);
  const Result<DatabaseReport> newer = check_database(copy_path(), true);
  ASSERT_FALSE(newer.ok()) << newer.value().trouble;
  EXPECT_EQ(newer.error().code, Code::config);
  EXPECT_NE(newer.error().text.view().find("written by a newer slabd"), std::string_view::npos);
  set_version(kSchemaVersion);
  EXPECT_EQ(check_database(copy_path(), true).value().trouble, "");
  // A slabd database damaged from its second sector on is reported as damaged.
  std::fstream(copy_path(), std::ios::in | std::ios::out | std::ios::binary).seekp(100) << std::string(4000, 'x');
  const Result<DatabaseReport> spoilt = check_database(copy_path(), true);
  ASSERT_TRUE(spoilt.ok()) << spoilt.error().text.view();
  EXPECT_NE(spoilt.value().trouble, "");
}

TEST_F(CareTest, a_folder_that_may_not_be_looked_into_is_not_called_empty) {
  // A circle of links simulates a folder of another group, which root could read.
  fs::create_symlink(folder_.path() + "/circle", folder_.path() + "/circle");
  const auto reader = open_reader(folder_.path() + "/circle/slabd.db");
  ASSERT_FALSE(reader.ok());
  EXPECT_NE(reader.error().text.view().find("cannot look for database"), std::string_view::npos)
      << reader.error().text.view();
  EXPECT_NE(open_reader(folder_.path() + "/none/slabd.db").error().text.view().find("there is no database"),
            std::string_view::npos);
}

TEST_F(CareTest, a_copy_without_a_daemon) {
  open();
  (void)recover();
  slabs(1, 3);
  close();
  ASSERT_TRUE(back_up_database(settings_.db_path, copy_path()).ok());
  const Result<DatabaseReport> report = check_database(copy_path(), true);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report.value().trouble, "");
  EXPECT_EQ(report.value().slabs, 3);
}

TEST_F(CareTest, commands_given_between_slabs_go_with_the_slabs_around_them) {
  settings_.keep_slabs = kKeepSlabsMin;
  open();
  (void)recover();
  for (std::int64_t key = 1; key <= kKeepSlabsMin + 5; ++key) {
    slabs(key, key);
    accept(PlcCommand::report, 0, 0);
    PlcResult again = random_record(prng_, ++res_seq_, 2);
    apply(ReportJob{again});
    acknowledge(res_seq_);
  }
  EXPECT_EQ(count("command WHERE slab_key IS NULL"), kKeepSlabsMin + 5);
  quiet(30);
  ASSERT_EQ(count("slab"), kKeepSlabsMin);
  EXPECT_EQ(count("command WHERE slab_key IS NULL"), kKeepSlabsMin);
  EXPECT_EQ(recover()->cmd_ack, cmd_seq_);
}

TEST_F(CareTest, slabs_beyond_keep_slabs_are_deleted_and_the_gap_is_recorded) {
  settings_.keep_slabs = kKeepSlabsMin;
  open();
  (void)recover();
  slabs(1, kKeepSlabsMin + 5);
  quiet(30);
  EXPECT_EQ(count("slab"), kKeepSlabsMin);
  for (const char* table : {"block", "attempt", "slab_result"}) EXPECT_EQ(count(table), kKeepSlabsMin) << table;
  EXPECT_EQ(count("plane"), 5 * kKeepSlabsMin);
  const Result<DatabaseReport> report = check_database(settings_.db_path, true);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report.value().trouble, "");
  EXPECT_EQ(report.value().oldest_key, 6);
  const auto gaps = reader()->gaps();
  ASSERT_TRUE(gaps.ok());
  ASSERT_EQ(gaps.value().size(), 1U);
  EXPECT_EQ(gaps.value()[0].what, HistoryGap::What::pruned);
  EXPECT_EQ(gaps.value()[0].slabs, 5);
  EXPECT_EQ(gaps.value()[0].slab_key, 5);
  EXPECT_EQ(recover()->last_slab_key, kKeepSlabsMin + 5);
}

TEST_F(CareTest, the_rows_of_a_slab_are_deleted_without_reading_whole_tables) {
  open();
  (void)recover();
  close();
  Connection db(settings_.db_path, SQLITE_OPEN_READWRITE);
  db.execute("PRAGMA foreign_keys = ON");  // references to a deleted row are searched too
  for (const char* table : {"item", "gauge_value", "block", "attempt", "result", "command", "station_result",
                            "slab_result", "slab_arm", "slab", "disposition"}) {
    Statement plan(db, std::string("EXPLAIN QUERY PLAN DELETE FROM ") + table + " WHERE slab_key = 1");
    int lines = 0;
    for (; plan.step(); ++lines) EXPECT_TRUE(plan.text(3).starts_with("SEARCH ")) << table << ": " << plan.text(3);
    EXPECT_GT(lines, 0) << table;
  }
}

/// Creates slabs that are ended and acknowledged with this verdict, without scans.
class FailedSlabsTest : public CareTest {
 protected:
  void ended(std::int64_t first, std::int64_t last, Verdict verdict) {
    for (std::int64_t key = first; key <= last; ++key) {
      begin(key);
      acknowledge(end(key, verdict));
    }
  }
  [[nodiscard]] bool is_there(std::int64_t key) { return reader()->slab(key).value().has_value(); }
};

TEST_F(FailedSlabsTest, outlive_passed_ones_up_to_their_limit) {
  settings_.keep_slabs = kKeepSlabsMin;
  settings_.keep_failed_slabs = kKeepSlabsMin;
  open();
  (void)recover();
  ended(1, 3, Verdict::fail);
  ended(4, 5, Verdict::pass);
  ended(6, kKeepSlabsMin + 3, Verdict::fail);  // together with the first three, 101 that did not pass
  ended(kKeepSlabsMin + 4, 2 * kKeepSlabsMin + 3, Verdict::pass);
  quiet(30);
  EXPECT_EQ(count("slab"), 2 * kKeepSlabsMin) << "the newest 100, and 100 of those that did not pass";
  EXPECT_FALSE(is_there(1)) << "the 101st that did not pass";
  EXPECT_TRUE(is_there(2));
  EXPECT_TRUE(is_there(3));
  EXPECT_FALSE(is_there(4));
  EXPECT_FALSE(is_there(5));
  EXPECT_TRUE(is_there(6));
  EXPECT_TRUE(is_there(kKeepSlabsMin + 4)) << "the oldest of the newest 100";
  ended(2 * kKeepSlabsMin + 4, 2 * kKeepSlabsMin + 4, Verdict::fail);
  quiet(30);
  EXPECT_FALSE(is_there(2)) << "now there is another one that did not pass";
  EXPECT_FALSE(is_there(kKeepSlabsMin + 4)) << "and one more slab at all";
  EXPECT_TRUE(is_there(3));
  EXPECT_TRUE(is_there(kKeepSlabsMin + 5));
  EXPECT_EQ(check_database(settings_.db_path, true).value().trouble, "");
  EXPECT_EQ(reader()->gaps().value()[0].slabs, 5);
}

TEST_F(FailedSlabsTest, are_all_that_did_not_pass_and_with_0_all_of_them_stay) {
  settings_.keep_slabs = kKeepSlabsMin;
  settings_.keep_failed_slabs = 0;
  open();
  (void)recover();
  ended(1, 1, Verdict::fail);
  ended(2, 2, Verdict::indeterminate);
  ended(3, 3, Verdict::pass);
  ended(4, 4, Verdict::not_measured);
  ended(5, 5, Verdict::aborted);
  ended(6, kKeepSlabsMin + 6, Verdict::fail);
  quiet(30);
  EXPECT_EQ(count("slab"), kKeepSlabsMin + 5);
  EXPECT_FALSE(is_there(3));
}

TEST_F(FailedSlabsTest, a_manual_prune_keeps_the_number_that_is_given) {
  open();
  (void)recover();
  ended(1, kKeepSlabsMin + 2, Verdict::fail);
  ended(kKeepSlabsMin + 3, 2 * kKeepSlabsMin + 2, Verdict::pass);
  EXPECT_EQ(store_->order(PruneOrder{kKeepSlabsMin, kKeepSlabsMin - 1}).error().code, Code::config);
  ASSERT_TRUE(store_->order(PruneOrder{kKeepSlabsMin, 0}).ok());
  quiet(10);
  EXPECT_EQ(store_->care().pruned_slabs, 0) << "none of those that did not pass";
  ASSERT_TRUE(store_->order(PruneOrder{kKeepSlabsMin, kKeepSlabsMin + 1}).ok());
  quiet(10);
  EXPECT_EQ(store_->care().pruned_slabs, 1);
  ASSERT_TRUE(store_->order(PruneOrder{kKeepSlabsMin}).ok());
  quiet(10);
  EXPECT_EQ(store_->care().pruned_slabs, 1) << "as many as of all";
  EXPECT_FALSE(is_there(2));
  EXPECT_TRUE(is_there(3));
}

TEST_F(FailedSlabsTest, do_not_outlive_the_budget_of_the_disk_and_records_do_not_go_before_scans) {
  settings_.keep_slabs = kKeepSlabsMin;
  settings_.keep_failed_slabs = 0;
  settings_.spool_budget_bytes = 100'000;
  open();
  (void)recover();
  for (const auto& [key, verdict] : {std::pair{1, Verdict::fail}, {2, Verdict::pass}, {3, Verdict::fail}}) {
    begin(key);
    scan(key, 1, 1);
    acknowledge(end(key, verdict));
  }
  ended(4, kKeepSlabsMin + 4, Verdict::pass);
  quiet(20);
  const auto scan_of = [&](int key) {
    return fs::exists(settings_.spool_dir + "/" + std::to_string(key) + "/1-1.ply");
  };
  EXPECT_TRUE(is_there(2)) << "its scan is kept";
  settings_.spool_budget_bytes = 1'500;
  open();
  for (int i = 0; i < 4; ++i) apply(AckJob{0});
  EXPECT_FALSE(scan_of(2)) << "passed ones first";
  EXPECT_FALSE(scan_of(1)) << "and then the oldest that did not pass: the budget counts";
  EXPECT_TRUE(scan_of(3));
  quiet(20);
  EXPECT_FALSE(is_there(2));
  EXPECT_TRUE(is_there(1)) << "its records stay without the scan";
}

TEST_F(CareTest, slabs_with_scans_or_unseen_results_stay_and_so_do_the_newest) {
  open();
  (void)recover();
  begin(1);
  scan(1, 1, 1);  // never acknowledged
  end(1, Verdict::fail);
  begin(2);
  accept(PlcCommand::scan, 1, 2);
  Attempt kept = attempt(2, 1, 1);
  kept.scan_path.assign(scan_file(2, 1, 1, 1000));
  apply(AcquiredJob{kept});
  acknowledge(measure(2, 1, 1));
  acknowledge(end(2, Verdict::pass));
  slabs(3, kKeepSlabsMin + 4);
  EXPECT_EQ(store_->order(PruneOrder{5}).error().code, Code::config) << "fewer than the least are never kept";
  ASSERT_TRUE(store_->order(PruneOrder{kKeepSlabsMin}).ok());
  quiet(40);
  EXPECT_EQ(store_->care().prune, Phase::done);
  EXPECT_EQ(store_->care().pruned_slabs, 2) << "slabs 3 and 4";
  Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
  ASSERT_TRUE(db.ok());
  EXPECT_EQ(db.value()->integer("SELECT count(*) FROM slab WHERE slab_key IN (1, 2)"), 2);
  EXPECT_EQ(db.value()->integer("SELECT count(*) FROM slab WHERE slab_key IN (3, 4)"), 0);
}

TEST_F(CareTest, without_an_order_and_without_a_limit_no_slab_is_removed) {
  open();
  (void)recover();
  slabs(1, kKeepSlabsMin + 3);
  quiet(50);
  EXPECT_EQ(count("slab"), kKeepSlabsMin + 3);
  EXPECT_TRUE(reader()->gaps().value().empty());
}

TEST_F(CareTest, a_second_process_reads_while_the_daemon_writes_and_never_changes_a_byte) {
  open();
  (void)recover();
  slabs(1, 2);
  const auto stamp = [&](const char* side) {
    const std::string path = settings_.db_path + side;
    return std::pair(fs::file_size(path), fs::last_write_time(path));
  };
  for (int round = 0; round < 5; ++round) {
    const auto database = stamp("");
    const auto log = stamp("-wal");
    {
      const auto reading = reader();
      EXPECT_TRUE(reading->slabs(100).ok());
      EXPECT_TRUE(check_database(settings_.db_path, true).ok());
    }
    EXPECT_EQ(stamp(""), database);
    EXPECT_EQ(stamp("-wal"), log);
    slabs(3 + round, 3 + round);
    quiet(6);
  }
}

}  // namespace
}  // namespace slabd::storage
