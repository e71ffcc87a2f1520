// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

/// Every scan in these tests has 1000 bytes, every slab two scans.
class SpoolTest : public StoreTest {
 protected:
  std::uint16_t whole_slab(std::int64_t key, Verdict verdict) {
    begin(key);
    scan(key, 1, 1);
    scan(key, 2, 1);
    return end(key, verdict);
  }
  [[nodiscard]] std::string kept() const {
    std::string keys;
    for (int key = 1; key <= 9; ++key)
      if (std::filesystem::exists(settings_.spool_dir + "/" + std::to_string(key) + "/1-1.ply"))
        keys += std::to_string(key);
    return keys;
  }
};

TEST_F(SpoolTest, without_a_budget_everything_is_kept) {
  open();
  for (std::int64_t key = 1; key <= 5; ++key) acknowledge(whole_slab(key, Verdict::pass));
  EXPECT_EQ(kept(), "12345");
}

TEST_F(SpoolTest, oldest_acknowledged_passes_go_first_then_the_others) {
  settings_.spool_budget_bytes = 100'000;
  open();
  acknowledge(whole_slab(1, Verdict::fail));
  acknowledge(whole_slab(2, Verdict::pass));
  acknowledge(whole_slab(3, Verdict::indeterminate));
  acknowledge(whole_slab(4, Verdict::pass));
  const std::uint16_t waiting = whole_slab(5, Verdict::pass);
  begin(6);
  scan(6, 1, 1);
  EXPECT_EQ(kept(), "123456");

  settings_.spool_budget_bytes = 1;
  open();
  std::string seen;
  for (int i = 0; i < 8; ++i) {
    apply(AckJob{0});  // acknowledges nothing, but triggers trimming of the spool
    seen += kept() + " ";
  }
  EXPECT_EQ(seen, "13456 1356 356 56 56 56 56 56 ")
      << "one slab a time; never an unacknowledged slab and never the open one";
  acknowledge(waiting);
  EXPECT_EQ(kept(), "6") << "slab 5 may go once its last record is acknowledged";
  EXPECT_EQ(store_->spool_trouble(), "");
}

TEST_F(SpoolTest, deletes_only_down_to_the_budget_and_keeps_the_records) {
  settings_.spool_budget_bytes = 4000;
  open();
  for (std::int64_t key = 1; key <= 4; ++key) acknowledge(whole_slab(key, Verdict::pass));
  EXPECT_EQ(kept(), "34");
  EXPECT_FALSE(std::filesystem::exists(settings_.spool_dir + "/1")) << "the slab's folder goes with its scans";
  Result<std::optional<SlabRecord>> record = reader()->slab(1);
  ASSERT_TRUE(record.ok() && record.value().has_value());
  EXPECT_EQ(record.value()->blocks.size(), 2U);
  EXPECT_EQ(record.value()->blocks[0].block.items.size(), kBlockItemsMax);
  Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
  ASSERT_TRUE(db.ok());
  EXPECT_EQ(db.value()->integer("SELECT count(*) FROM attempt WHERE slab_key = 1 AND scan_state = 'deleted'"), 2);
  EXPECT_EQ(db.value()->integer("SELECT count(*) FROM attempt WHERE slab_key = 3 AND scan_state = 'kept'"), 2);
}

TEST_F(SpoolTest, pinned_slab_is_kept_until_its_pin_is_removed) {
  settings_.spool_budget_bytes = 100'000;
  open();
  for (std::int64_t key = 1; key <= 3; ++key) acknowledge(whole_slab(key, Verdict::pass));
  const std::string pin = settings_.spool_dir + "/1/pin.json";
  std::ofstream(pin) << "{}";
  settings_.spool_budget_bytes = 1;
  open();
  for (int i = 0; i < 5; ++i) apply(AckJob{0});
  EXPECT_EQ(kept(), "1");
  EXPECT_EQ(store_->spool_trouble(), "");
  std::filesystem::remove(pin);
  apply(AckJob{0});
  EXPECT_EQ(kept(), "");
}

TEST_F(SpoolTest, remaining_scans_of_a_slab_pinned_during_their_deletion_are_kept) {
  settings_.spool_budget_bytes = 100'000;
  open();
  for (std::int64_t key = 1; key <= 2; ++key) acknowledge(whole_slab(key, Verdict::pass));
  close();
  {
    // Killed after marking the scans and before deleting the second file; then a person pins the slab and slabd
    // restarts.
    Result<std::unique_ptr<Connection>> db = open_for_writing(settings_.db_path);
    ASSERT_TRUE(db.ok());
    db.value()->execute("UPDATE attempt SET scan_state = 'deleting' WHERE slab_key = 1");
  }
  std::filesystem::remove(settings_.spool_dir + "/1/1-1.ply");
  const std::string pin = settings_.spool_dir + "/1/pin.json";
  std::ofstream(pin) << "{}";
  settings_.spool_budget_bytes = 1;
  open();
  for (int i = 0; i < 4; ++i) apply(AckJob{0});
  EXPECT_TRUE(std::filesystem::exists(settings_.spool_dir + "/1/2-1.ply"));
  EXPECT_FALSE(std::filesystem::exists(settings_.spool_dir + "/2"));
  EXPECT_EQ(store_->spool_trouble(), "");
  {
    Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
    ASSERT_TRUE(db.ok());
    EXPECT_EQ(db.value()->text("SELECT group_concat(scan_state) FROM attempt WHERE slab_key = 1"), "deleted,kept");
  }
  std::filesystem::remove(pin);
  apply(AckJob{0});
  EXPECT_FALSE(std::filesystem::exists(settings_.spool_dir + "/1"));
}

TEST_F(SpoolTest, file_outside_the_spool_is_never_touched) {
  settings_.spool_budget_bytes = 1;
  const std::string precious = scan_file(1, 1, 1, 5000);
  settings_.spool_dir = folder_.path() + "/another";
  open();
  begin(1);
  accept(PlcCommand::scan, 1, 1);
  Attempt a = attempt(1, 1, 1);
  a.scan_path.assign(precious);
  apply(AcquiredJob{a});
  measure(1, 1, 1);
  acknowledge(end(1, Verdict::pass));
  apply(AckJob{0});
  EXPECT_TRUE(std::filesystem::exists(precious));
}

TEST_F(SpoolTest, scan_that_cannot_be_deleted_is_reported_and_tried_again) {
  settings_.spool_budget_bytes = 1;
  open();
  begin(1);
  scan(1, 1, 1);
  const std::string path = settings_.spool_dir + "/1/1-1.ply";
  // A folder in place of the file cannot be unlinked, not even by root.
  ASSERT_TRUE(std::filesystem::remove(path));
  ASSERT_TRUE(std::filesystem::create_directory(path));
  acknowledge(end(1, Verdict::pass));
  EXPECT_NE(store_->spool_trouble().find("1-1.ply cannot be deleted"), std::string_view::npos)
      << store_->spool_trouble();
  ASSERT_TRUE(std::filesystem::remove(path));
  apply(AckJob{0});
  EXPECT_EQ(store_->spool_trouble(), "");
  EXPECT_FALSE(std::filesystem::exists(settings_.spool_dir + "/1"));
}

TEST_F(SpoolTest, a_scan_that_cannot_be_deleted_keeps_no_other_from_going) {
  settings_.spool_budget_bytes = 100'000;
  open();
  for (std::int64_t key = 1; key <= 3; ++key) acknowledge(whole_slab(key, Verdict::pass));
  const std::string stuck = settings_.spool_dir + "/1/1-1.ply";
  ASSERT_TRUE(std::filesystem::remove(stuck));
  ASSERT_TRUE(std::filesystem::create_directory(stuck));
  settings_.spool_budget_bytes = 1;
  open();
  for (int i = 0; i < 4; ++i) apply(AckJob{0});
  EXPECT_FALSE(std::filesystem::exists(settings_.spool_dir + "/2"));
  EXPECT_FALSE(std::filesystem::exists(settings_.spool_dir + "/3"));
  EXPECT_NE(store_->spool_trouble().find("1-1.ply cannot be deleted"), std::string_view::npos)
      << store_->spool_trouble();
}

TEST_F(SpoolTest, scans_of_a_spool_that_was_somewhere_else_neither_count_nor_go) {
  settings_.spool_budget_bytes = 100'000;
  open();
  for (std::int64_t key = 1; key <= 3; ++key) acknowledge(whole_slab(key, Verdict::pass));
  const std::string before = settings_.spool_dir;
  settings_.spool_dir = folder_.path() + "/larger";
  settings_.spool_budget_bytes = 4000;
  open();
  for (std::int64_t key = 4; key <= 6; ++key) acknowledge(whole_slab(key, Verdict::pass));
  EXPECT_EQ(kept(), "56");
  EXPECT_EQ(store_->spool_trouble(), "");
  for (const char* name : {"/1/1-1.ply", "/3/2-1.ply"}) EXPECT_TRUE(std::filesystem::exists(before + name)) << name;
  // With the old path again they count and are deleted.
  settings_.spool_dir = before;
  open();
  acknowledge(whole_slab(7, Verdict::pass));
  EXPECT_FALSE(std::filesystem::exists(before + "/1"));
  EXPECT_TRUE(std::filesystem::exists(before + "/7"));
}

TEST_F(SpoolTest, a_smaller_budget_is_met_while_the_store_is_idle) {
  open();
  for (std::int64_t key = 1; key <= 4; ++key) acknowledge(whole_slab(key, Verdict::pass));
  settings_.spool_budget_bytes = 2000;
  open();
  (void)recover();
  for (int i = 0; i < 12; ++i) store_->idle();
  EXPECT_EQ(kept(), "4");
}

TEST_F(SpoolTest, a_slab_that_is_refused_for_lack_of_room_makes_what_may_go_go) {
  settings_.spool_budget_bytes = 2000;
  open();
  for (std::int64_t key = 1; key <= 2; ++key) acknowledge(whole_slab(key, Verdict::pass));
  const std::string pin = settings_.spool_dir + "/2/pin.json";
  std::ofstream(pin) << "{}";
  acknowledge(whole_slab(3, Verdict::pass));
  settings_.spool_free_bytes_min = std::uint64_t{1} << 62U;
  settings_.spool_budget_bytes = 1;
  open();
  for (int i = 0; i < 12; ++i) store_->idle();
  EXPECT_EQ(kept(), "2");
  std::filesystem::remove(pin);
  for (int i = 0; i < 12; ++i) store_->idle();
  EXPECT_EQ(kept(), "2") << "no work was reported";
  const Status status = try_apply(BeginSlabJob{random_header(prng_, 5), session_, ++cmd_seq_});
  EXPECT_EQ(status.error().code, Code::store_full);
  for (int i = 0; i < 12; ++i) store_->idle();
  EXPECT_EQ(kept(), "");
}

class OrphanTest : public SpoolTest {
 protected:
  /// The slab begins at the epoch by default, so that every file in the spool is newer.
  void begin_at(std::int64_t key, std::int64_t began_utime_us = 0) {
    BeginSlabJob job{random_header(prng_, key), session_, ++cmd_seq_};
    job.slab.began_utime_us = began_utime_us;
    apply(job);
  }
  void restart() {
    open();
    ASSERT_FALSE(recover()->slab.key == 0);
  }
};

TEST_F(OrphanTest, scan_that_was_spooled_and_never_recorded_is_deleted_at_the_next_start) {
  open();
  begin_at(1);
  scan(1, 1, 1);
  scan(1, 1, 2);
  acquire(1, 2, 1);
  accept(PlcCommand::scan, 3, 1);
  const std::string orphan = scan_file(1, 3, 1, 1000);  // then the power fails
  const std::string copied_halfway = scan_file(1, 3, 2, 1000) + ".part";
  std::filesystem::rename(settings_.spool_dir + "/1/3-2.ply", copied_halfway);
  const std::string thrown_away = settings_.spool_dir + "/1/3-1-unseen.ply";
  std::ofstream(thrown_away) << "points";
  restart();
  EXPECT_FALSE(std::filesystem::exists(thrown_away));
  EXPECT_FALSE(std::filesystem::exists(orphan));
  EXPECT_FALSE(std::filesystem::exists(copied_halfway));
  for (const char* recorded : {"1-1.ply", "1-2.ply", "2-1.ply"})
    EXPECT_TRUE(std::filesystem::exists(settings_.spool_dir + "/1/" + recorded)) << recorded;
  EXPECT_EQ(store_->spool_trouble(), "");
}

TEST_F(OrphanTest, scans_of_the_same_slab_in_a_newer_database_are_kept_and_reported) {
  open();
  begin_at(1);
  scan(1, 1, 1);
  accept(PlcCommand::scan, 2, 1);
  const std::string under_way = scan_file(1, 2, 1, 1000);
  // The slab continued after this, and this database is a copy made before.
  const std::vector<std::string> later = {scan_file(1, 3, 1, 1000), scan_file(1, 1, 2, 1000)};
  restart();
  EXPECT_FALSE(std::filesystem::exists(under_way));
  for (const std::string& path : later) EXPECT_TRUE(std::filesystem::exists(path)) << path;
  EXPECT_THAT(std::string(store_->spool_trouble()), ::testing::HasSubstr("/1 holds 2 scans of attempts that are not"));
}

TEST_F(OrphanTest, only_scans_in_the_newest_slabs_own_folder_are_judged) {
  open();
  begin_at(1);
  scan(1, 1, 1);
  acknowledge(end(1, Verdict::pass));
  begin_at(2);
  scan(2, 1, 1);
  std::vector<std::string> kept = {scan_file(1, 5, 1, 10)};  // an older slab
  for (const char* name : {"/5-1.ply", "/2/notes.txt", "/2/5.ply", "/2/-1.ply", "/2/5-.ply", "/2/5-1", "/2/.5-1.ply"}) {
    kept.push_back(settings_.spool_dir + name);
    std::ofstream(kept.back()) << "precious";
  }
  const std::string precious = folder_.path() + "/precious";
  std::ofstream(precious) << "precious";
  kept.push_back(settings_.spool_dir + "/2/6-1.ply");
  std::filesystem::create_symlink(precious, kept.back());
  kept.push_back(settings_.spool_dir + "/2/7-1.ply");
  std::filesystem::create_directory(kept.back());
  kept.push_back(precious);
  restart();
  for (const std::string& path : kept) EXPECT_TRUE(std::filesystem::exists(path)) << path;
}

TEST_F(OrphanTest, recorded_scan_is_kept_when_the_spool_is_known_by_another_path) {
  open();
  begin_at(1);
  scan(1, 1, 1);
  const std::string path = settings_.spool_dir + "/1/1-1.ply";
  const std::string other = folder_.path() + "/other";
  std::filesystem::create_directory_symlink(settings_.spool_dir, other);
  settings_.spool_dir = other;
  restart();
  EXPECT_TRUE(std::filesystem::exists(path));
}

TEST_F(OrphanTest, folder_that_leads_out_of_the_spool_is_not_entered) {
  open();
  begin_at(1);
  const std::string outside = folder_.path() + "/outside";
  std::filesystem::create_directory(outside);
  std::ofstream(outside + "/1-1.ply") << "precious";
  std::filesystem::create_directory_symlink(outside, settings_.spool_dir + "/1");
  restart();
  EXPECT_TRUE(std::filesystem::exists(outside + "/1-1.ply"));
}

TEST_F(OrphanTest, no_file_of_a_pinned_slab_is_deleted) {
  open();
  begin_at(1);
  scan(1, 1, 1);
  const std::string orphan = scan_file(1, 3, 1, 1000);
  std::ofstream(settings_.spool_dir + "/1/pin.json") << "{}";
  restart();
  EXPECT_TRUE(std::filesystem::exists(orphan));
}

TEST_F(OrphanTest, scans_of_a_lost_database_are_not_judged_by_the_new_one) {
  open();
  const std::string of_another_life = scan_file(1, 5, 1, 10);
  begin_at(1, std::int64_t{1} << 60U);  // later than any file
  restart();
  EXPECT_TRUE(std::filesystem::exists(of_another_life));
}

}  // namespace
}  // namespace slabd::storage
