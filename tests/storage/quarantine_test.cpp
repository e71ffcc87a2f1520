// SPDX-License-Identifier: Apache-2.0
//
// A damaged database is moved to quarantine completely, and only a person can begin a new history.
#include "storage/files/quarantine.h"

#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

std::string whole(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class QuarantineTest : public StoreTest {
 protected:
  void live(std::int64_t slabs = 1) {
    open();
    (void)recover();
    for (std::int64_t key = 1; key <= slabs; ++key) {
      begin(key);
      for (int station = 1; station <= 18; ++station) {
        acquire(key, station, 1);
        PlcResult record = random_record(prng_, ++res_seq_, 1);
        record.cmd_seq = cmd_seq_;
        apply(BlockJob{key, 1, random_block(prng_, station, Verdict::pass), record, random_maps(prng_)});
      }
      acknowledge(end(key, Verdict::pass));
    }
    close();
  }
  void damage() const {
    std::fstream file(settings_.db_path, std::ios::in | std::ios::out | std::ios::binary);
    const auto size = static_cast<std::streamoff>(fs::file_size(settings_.db_path));
    ASSERT_GT(size, 10 * 4096);
    for (std::streamoff page = 5; page < size / 4096; ++page) {
      file.seekp(page * 4096);
      file << std::string(2048, '\x5a');
    }
  }
  [[nodiscard]] std::string refusal() const {
    const Result<std::unique_ptr<Store>> store = open_store(settings_);
    if (store.ok()) return "opened";
    EXPECT_EQ(store.error().code, Code::journal_write);
    return std::string(store.error().text.view());
  }
  [[nodiscard]] std::vector<std::string> folders() const {
    std::vector<std::string> found;
    for (const auto& entry : fs::directory_iterator(fs::path(settings_.db_path).parent_path()))
      if (entry.path().filename().string().find(".quarantine-") != std::string::npos)
        found.push_back(entry.path().string());
    return found;
  }
};

TEST_F(QuarantineTest, a_damaged_database_is_set_aside_byte_for_byte_and_no_new_one_is_begun) {
  live();
  damage();
  const std::string before = whole(settings_.db_path);
  const std::string text = refusal();
  EXPECT_NE(text.find("was damaged"), std::string::npos) << text;
  EXPECT_NE(text.find("slabctl db restore"), std::string::npos) << text;
  ASSERT_EQ(folders().size(), 1U);
  EXPECT_NE(text.find(folders()[0]), std::string::npos) << text;
  EXPECT_EQ(whole(folders()[0] + "/slabd.db"), before);
  for (int start = 0; start < 3; ++start) EXPECT_NE(refusal().find("in quarantine"), std::string::npos);
  EXPECT_EQ(folders().size(), 1U);
  const Result<std::unique_ptr<Reader>> reader = open_reader(settings_.db_path);
  ASSERT_FALSE(reader.ok());
  EXPECT_NE(reader.error().text.view().find("in quarantine"), std::string_view::npos) << reader.error().text.view();
  EXPECT_FALSE(is_unused(settings_.db_path));
}

TEST_F(QuarantineTest, the_log_of_a_damaged_database_is_moved_with_it_unread) {
  live();
  // A log that its writer never moved into the database, as after a kill.
  open();
  begin(2);
  const std::string log = whole(settings_.db_path + "-wal");
  const std::string log_path = settings_.db_path + "-wal";
  ASSERT_FALSE(log.empty());
  const std::string database = whole(settings_.db_path);
  close();
  std::ofstream(settings_.db_path, std::ios::binary) << database;
  std::ofstream(log_path, std::ios::binary) << log;
  damage();
  const std::string damaged = whole(settings_.db_path);
  EXPECT_NE(refusal().find("was damaged"), std::string::npos);
  ASSERT_EQ(folders().size(), 1U);
  EXPECT_EQ(whole(folders()[0] + "/slabd.db"), damaged) << "the log was moved into it";
  EXPECT_EQ(whole(folders()[0] + "/slabd.db-wal"), log);
  EXPECT_FALSE(fs::exists(log_path));
}

TEST_F(QuarantineTest, damage_found_while_the_daemon_runs_ends_in_quarantine_too) {
  live(10);
  open();
  (void)recover();
  damage();
  std::string answers;
  // More pages than the cache holds.
  for (std::int64_t key = 1; key <= 10; ++key)
    for (int station = 1; station <= 18; station += 3) {
      const Status status =
          try_apply(BlockJob{key, 1, random_block(prng_, station, Verdict::pass), random_record(prng_, 500, 1), {}});
      if (!status.ok()) answers += std::string(status.error().text.view()) + "\n";
    }
  EXPECT_NE(answers.find("malformed"), std::string::npos) << answers;
  EXPECT_NE(answers.find("quarantine"), std::string::npos) << answers;
  EXPECT_EQ(folders().size(), 1U);
}

TEST_F(QuarantineTest, no_database_is_made_where_something_shows_that_there_was_one) {
  live();
  open();
  begin(2);
  const std::string log = whole(settings_.db_path + "-wal");
  close();
  const std::string scan = scan_file(1, 1, 1, 100);
  fs::remove(settings_.db_path);
  std::string text = refusal();
  EXPECT_NE(text.find(settings_.spool_dir + "/1 shows that there was one"), std::string::npos) << text;
  fs::remove_all(settings_.spool_dir);

  std::ofstream(settings_.db_path + "-wal", std::ios::binary) << log;
  text = refusal();
  EXPECT_NE(text.find("slabd.db-wal shows"), std::string::npos) << text;
  EXPECT_EQ(whole(settings_.db_path + "-wal"), log) << "SQLite would have deleted it";
  fs::remove(settings_.db_path + "-wal");

  const Result<std::string> folder = backup_folder(settings_.db_path);
  ASSERT_TRUE(folder.ok());
  std::ofstream(folder.value() + "/slabd-x.db") << "a backup";
  EXPECT_NE(refusal().find("slabd-x.db shows"), std::string::npos);
  fs::remove_all(folder.value());
  EXPECT_EQ(refusal(), "opened");
}

TEST_F(QuarantineTest, remains_of_a_stopped_creation_are_not_a_sign_of_an_earlier_database) {
  fs::create_directories(fs::path(settings_.db_path).parent_path());
  fs::create_directories(settings_.spool_dir + "/1");
  std::ofstream(settings_.db_path).flush();
  open();
  begin(1);
  const std::string log = whole(settings_.db_path + "-wal");
  close();
  for (const std::size_t bytes : {0U, 20U, 32U, 40U, 3000U, 32U + 24U}) {
    fs::remove(settings_.db_path);
    std::ofstream(settings_.db_path + "-wal", std::ios::binary) << log.substr(0, bytes);
    EXPECT_EQ(refusal(), "opened") << "no transaction is in the first " << bytes << " bytes of a log";
  }
}

TEST_F(QuarantineTest, a_file_that_is_not_ours_is_never_moved) {
  fs::create_directories(fs::path(settings_.db_path).parent_path());
  std::ofstream(settings_.db_path) << std::string(8192, 'z');
  EXPECT_NE(refusal().find("file is not a database"), std::string::npos);
  EXPECT_TRUE(folders().empty());
  EXPECT_EQ(whole(settings_.db_path), std::string(8192, 'z'));
}

}  // namespace
}  // namespace slabd::storage
