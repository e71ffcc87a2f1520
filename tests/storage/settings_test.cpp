// SPDX-License-Identifier: Apache-2.0
#include <sqlite3.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class SettingsTest : public StoreTest {
 protected:
  /// Creates a database of another application.
  void make(const std::string& sql) {
    std::filesystem::create_directories(folder_.path() + "/db");
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(settings_.db_path.c_str(), &db), SQLITE_OK);
    ASSERT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
    ASSERT_EQ(sqlite3_close(db), SQLITE_OK);
  }
  [[nodiscard]] std::string refusal() const {
    const Result<std::unique_ptr<Store>> store = open_store(settings_);
    if (store.ok()) return "opened";
    EXPECT_EQ(store.error().code, Code::journal_write);
    return std::string(store.error().text.view());
  }
};

std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

int mode_of(const std::string& path) {
  struct stat there {};
  EXPECT_EQ(stat(path.c_str(), &there), 0);
  return static_cast<int>(there.st_mode & 07777U);
}

TEST_F(SettingsTest, a_user_without_read_permission_gets_a_hint_about_the_group) {
  ASSERT_TRUE(open_store(settings_).ok());
  const std::string folder = folder_.path() + "/db";
  for (const std::string& path : {folder_.path(), folder}) ASSERT_EQ(chmod(path.c_str(), 0755), 0);
  ASSERT_EQ(chmod(settings_.db_path.c_str(), 0), 0);
  const pid_t child = fork();
  if (child == 0) {
    if (geteuid() == 0 && setresuid(65'534, 65'534, 65'534) != 0) _exit(9);  // root would be permitted everything
    const auto reader = open_reader(settings_.db_path);
    _exit(!reader.ok() && reader.error().text.view().find("are you in its group?") != std::string_view::npos ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}

/// Another program with an open transaction, like sqlite3 in a terminal after BEGIN IMMEDIATE.
class OtherProgram {
 public:
  explicit OtherProgram(const std::string& db_path) {
    std::array<int, 2> ready{};
    EXPECT_EQ(pipe(ready.data()), 0);
    pid_ = fork();
    if (pid_ == 0) {
      sqlite3* db = nullptr;
      const bool locked = sqlite3_open(db_path.c_str(), &db) == SQLITE_OK &&
                          sqlite3_exec(db, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr) == SQLITE_OK;
      const char answer = locked ? 'y' : 'n';
      (void)!write(ready[1], &answer, 1);
      while (true) pause();
    }
    char answer = 0;
    EXPECT_EQ(read(ready[0], &answer, 1), 1);
    EXPECT_EQ(answer, 'y');
    close(ready[0]);
    close(ready[1]);
  }
  ~OtherProgram() {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  OtherProgram(const OtherProgram&) = delete;
  OtherProgram& operator=(const OtherProgram&) = delete;
  [[nodiscard]] std::string process() const { return "(process " + std::to_string(pid_) + ")"; }

 private:
  pid_t pid_ = 0;
};

TEST_F(SettingsTest, a_job_that_another_program_locks_out_names_that_program) {
  Result<std::unique_ptr<Store>> store = open_store(settings_);
  ASSERT_TRUE(store.ok());
  {
    const OtherProgram other(settings_.db_path);
    EXPECT_NE(foreign_lock(settings_.db_path).find(other.process()), std::string::npos);
    const Status status = store.value()->apply({1, SessionJob{7}});
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, Code::journal_write);
    EXPECT_NE(status.error().text.view().find(other.process()), std::string_view::npos) << status.error().text.view();
    EXPECT_NE(status.error().text.view().find("end that program"), std::string_view::npos);
  }
  EXPECT_EQ(foreign_lock(settings_.db_path), "");
  const Status again = store.value()->apply({1, SessionJob{7}});
  EXPECT_TRUE(again.ok()) << "the connection is as good as before";
}

TEST_F(SettingsTest, a_second_writer_names_the_first_one) {
  const Result<std::unique_ptr<Store>> store = open_store(settings_);
  ASSERT_TRUE(store.ok());
  EXPECT_NE(refusal().find("(process " + std::to_string(getpid()) + ")"), std::string::npos) << refusal();
}

TEST_F(SettingsTest, settings_are_in_force_on_the_writing_connection) {
  Result<std::unique_ptr<Connection>> opened = open_for_writing(settings_.db_path);
  ASSERT_TRUE(opened.ok()) << opened.error().text.view();
  Connection& db = *opened.value();
  EXPECT_EQ(db.integer("PRAGMA application_id"), kApplicationId);
  EXPECT_EQ(db.integer("PRAGMA user_version"), kSchemaVersion);
  EXPECT_EQ(db.integer("PRAGMA synchronous"), 3) << "EXTRA";
  EXPECT_EQ(db.text("PRAGMA journal_mode"), "wal");
  EXPECT_EQ(db.text("PRAGMA locking_mode"), "normal");
  EXPECT_EQ(db.integer("PRAGMA wal_autocheckpoint"), 4096) << "16 MB of log";
  EXPECT_EQ(db.integer("PRAGMA journal_size_limit"), 16'777'216);
  EXPECT_EQ(db.integer("PRAGMA foreign_keys"), 1);
  EXPECT_EQ(db.integer("PRAGMA trusted_schema"), 0);
  EXPECT_EQ(db.integer("PRAGMA cell_size_check"), 1);
  EXPECT_EQ(db.integer("PRAGMA mmap_size"), 0);
  EXPECT_EQ(db.integer("PRAGMA cache_size"), -2048);
  EXPECT_GT(db.integer("PRAGMA busy_timeout"), 0);
  int defensive = 0;
  EXPECT_EQ(sqlite3_db_config(db.handle(), SQLITE_DBCONFIG_DEFENSIVE, -1, &defensive), SQLITE_OK);
  EXPECT_EQ(defensive, 1);
}

/// Number of pages in the database file, without those only in its log.
std::int64_t pages_in_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::array<unsigned char, 32> header{};
  file.read(reinterpret_cast<char*>(header.data()), header.size());
  std::int64_t pages = 0;
  for (std::size_t i = 28; i < 32; ++i) pages = 256 * pages + header[i];
  return pages;
}

TEST_F(SettingsTest, the_log_is_moved_into_the_database_after_an_idle_time) {
  open();
  (void)recover();
  begin(1);
  for (int i = 0; i < 10; ++i) store_->idle();
  const std::int64_t before = pages_in_file(settings_.db_path);
  for (int station = 1; station <= 6; ++station) {
    scan(1, station, 1);
    store_->idle();  // between jobs: not yet
  }
  EXPECT_EQ(pages_in_file(settings_.db_path), before);
  for (int i = 0; i < 10; ++i) store_->idle();
  EXPECT_GT(pages_in_file(settings_.db_path), before);
}

TEST_F(SettingsTest, every_table_is_strict) {
  open();
  Result<std::unique_ptr<Connection>> opened = open_for_reading(settings_.db_path);
  ASSERT_TRUE(opened.ok());
  EXPECT_GE(opened.value()->integer("SELECT count(*) FROM pragma_table_list WHERE schema = 'main' AND strict = 1"), 11);
  EXPECT_EQ(opened.value()->text("SELECT name FROM pragma_table_list WHERE schema = 'main' AND type = 'table' "
                                 "AND strict = 0 AND name NOT LIKE 'sqlite_%'"),
            "");
}

TEST_F(SettingsTest, folders_and_files_are_open_to_the_group_for_reading_only) {
  const mode_t before = umask(077);
  open();
  umask(before);
  EXPECT_EQ(mode_of(folder_.path() + "/db"), 02750);
  EXPECT_EQ(mode_of(settings_.spool_dir), 02750);
  EXPECT_EQ(mode_of(settings_.db_path), 0640);
  EXPECT_EQ(mode_of(settings_.db_path + "-wal"), 0640) << "a reader of the group needs the log too";
  EXPECT_EQ(mode_of(settings_.db_path + "-shm"), 0640) << "and its index";
  EXPECT_EQ(mode_of(settings_.db_path + ".writer"), 0600) << "who can open it could keep slabd from starting";
}

TEST_F(SettingsTest, existing_folders_keep_their_mode) {
  std::filesystem::create_directories(folder_.path() + "/db");
  ASSERT_EQ(chmod((folder_.path() + "/db").c_str(), 0700), 0);
  open();
  EXPECT_EQ(mode_of(folder_.path() + "/db"), 0700);
}

TEST_F(SettingsTest, foreign_database_is_refused_and_left_alone) {
  make("PRAGMA application_id = 1234; CREATE TABLE theirs (a)");
  const std::string text = refusal();
  EXPECT_NE(text.find(settings_.db_path), std::string::npos) << text;
  EXPECT_NE(text.find("another application (application_id 1234, expected 1397506628)"), std::string::npos) << text;
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path + "-wal")) << "it was switched to our journal mode";
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(settings_.db_path.c_str(), &db), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(db, "SELECT a FROM theirs", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
}

TEST_F(SettingsTest, a_database_with_other_tables_is_named_with_the_cure) {
  ASSERT_TRUE(open_store(settings_).ok());
  make("ALTER TABLE gauge_check RENAME COLUMN master_value TO master_size");
  const Result<std::unique_ptr<Reader>> reader = open_reader(settings_.db_path);
  ASSERT_TRUE(reader.ok()) << reader.error().text.view();
  const auto checks = reader.value()->gauge_checks("", 10);
  ASSERT_FALSE(checks.ok());
  for (const char* part : {"with other tables (no such column: ", "master_value", "slabctl db restore --fresh"})
    EXPECT_NE(checks.error().text.view().find(part), std::string_view::npos) << checks.error().text.view();
}

TEST_F(SettingsTest, a_database_of_a_test_version_is_refused_with_a_reason_and_left_unchanged) {
  for (const char* version : {"1", "9"}) {
    make("PRAGMA application_id = 1397506370; CREATE TABLE IF NOT EXISTS slab (a); INSERT INTO slab VALUES (7)");
    make(std::string("PRAGMA user_version = ") + version);
    const std::string before = bytes_of(settings_.db_path);
    const std::string text = refusal();
    EXPECT_NE(text.find(settings_.db_path), std::string::npos) << text;
    EXPECT_NE(text.find(std::string("test version of slabd before 1.0 wrote it (schema version ") + version + ")"),
              std::string::npos)
        << text;
    EXPECT_NE(text.find("slabctl db restore --fresh"), std::string::npos) << text;
    const Result<std::unique_ptr<Reader>> reader = open_reader(settings_.db_path);
    ASSERT_FALSE(reader.ok());
    EXPECT_EQ(reader.error().code, Code::config);
    EXPECT_EQ(reader.error().text.view(), text) << "readers say the same";
    const Result<DatabaseReport> report = check_database(settings_.db_path, true);
    ASSERT_FALSE(report.ok());
    EXPECT_EQ(report.error().code, Code::config);
    EXPECT_TRUE(bytes_of(settings_.db_path) == before);
    EXPECT_FALSE(std::filesystem::exists(settings_.db_path + "-wal")) << "it was switched to our journal mode";
  }
  // The remedy in the message works: a new database is created, and the old one is kept.
  const std::string before = bytes_of(settings_.db_path);
  const Status fresh = restore_database(settings_, {"", {"anna", "1.0 is here", 1'700'000'000'000'000}, 4711});
  ASSERT_TRUE(fresh.ok()) << fresh.error().text.view();
  open();
  EXPECT_EQ(recover()->session, 4711);
  std::string kept;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path() + "/db"))
    if (entry.path().string().find(".quarantine-") != std::string::npos) kept = entry.path().string() + "/slabd.db";
  EXPECT_TRUE(bytes_of(kept) == before) << kept;
}

TEST_F(SettingsTest, database_with_tables_and_no_application_id_is_foreign) {
  make("CREATE TABLE theirs (a)");
  EXPECT_NE(refusal().find("application_id 0"), std::string::npos);
}

TEST_F(SettingsTest, newer_schema_is_refused) {
  open();
  close();
  const std::string newer = std::to_string(kSchemaVersion + 1);
  make("PRAGMA user_version = " + newer);
  const std::string text = refusal();
  const std::string told =
      "newer slabd (schema version " + newer + ", this program supports up to " + std::to_string(kSchemaVersion) + ")";
  EXPECT_NE(text.find(told), std::string::npos) << text;
  const Result<std::unique_ptr<Reader>> reader = open_reader(settings_.db_path);
  ASSERT_FALSE(reader.ok());
  EXPECT_NE(reader.error().text.view().find("newer slabd"), std::string_view::npos);
}

TEST_F(SettingsTest, file_that_is_not_a_database_is_refused) {
  std::filesystem::create_directories(folder_.path() + "/db");
  std::ofstream(settings_.db_path) << std::string(8192, 'z');
  const std::string text = refusal();
  EXPECT_NE(text.find("file is not a database"), std::string::npos) << text;
}

TEST_F(SettingsTest, second_writer_is_refused) {
  open();
  const std::string text = refusal();
  EXPECT_NE(text.find("already open for writing"), std::string::npos) << text;
  close();
  EXPECT_EQ(refusal(), "opened");
}

TEST_F(SettingsTest, an_open_writer_is_detected) {
  EXPECT_FALSE(is_written_elsewhere(settings_.db_path));
  open();
  EXPECT_TRUE(is_written_elsewhere(settings_.db_path));
  close();
  EXPECT_FALSE(is_written_elsewhere(settings_.db_path));
}

TEST_F(SettingsTest, unusable_path_is_named) {
  std::ofstream(folder_.path() + "/db") << "a file where a folder should be";
  const std::string text = refusal();
  EXPECT_NE(text.find("is not a folder"), std::string::npos) << text;
}

TEST_F(SettingsTest, a_linked_folder_is_as_good_as_any_and_a_linked_file_is_named) {
  namespace fs = std::filesystem;
  fs::create_directory(folder_.path() + "/disk");
  fs::create_directory_symlink(folder_.path() + "/disk", folder_.path() + "/linked");
  settings_.db_path = folder_.path() + "/linked/slabd.db";
  open();
  begin(1);
  EXPECT_EQ(recover()->last_slab_key, 1);
  close();
  ASSERT_TRUE(back_up_database(settings_.db_path, folder_.path() + "/linked/copy.db").ok());
  EXPECT_TRUE(fs::exists(folder_.path() + "/disk/copy.db"));

  fs::create_symlink(folder_.path() + "/disk/slabd.db", folder_.path() + "/slabd.db");
  settings_.db_path = folder_.path() + "/slabd.db";
  const std::string text = refusal();
  EXPECT_NE(text.find(folder_.path() + "/slabd.db is a link to " + folder_.path() + "/disk/slabd.db"),
            std::string::npos)
      << text;
}

TEST_F(SettingsTest, slab_begin_is_refused_when_the_spool_disk_is_nearly_full) {
  settings_.spool_free_bytes_min = std::uint64_t{1} << 62U;
  open();
  const Status status = try_apply(BeginSlabJob{random_header(prng_, 1), 1, 1});
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::store_full);
  EXPECT_NE(status.error().text.view().find(settings_.spool_dir), std::string_view::npos);
  EXPECT_EQ(recover()->last_slab_key, 0) << "nothing may be journaled";
  EXPECT_EQ(recover()->cmd_ack, 0);
  apply(SessionJob{7});  // all other jobs still work
}

TEST_F(SettingsTest, slab_begins_when_there_is_space_for_it) {
  open();
  const Result<std::uint64_t> free = free_bytes(settings_.spool_dir);
  ASSERT_TRUE(free.ok());
  settings_.spool_free_bytes_min = free.value() / 2;
  open();
  begin(1);
}

TEST(Folders, path_must_be_below_the_spool) {
  EXPECT_TRUE(lies_below("/spool/1/01-1.ply", "/spool"));
  EXPECT_TRUE(lies_below("/spool/1/01-1.ply", "/spool/"));
  EXPECT_FALSE(lies_below("/spool", "/spool"));
  EXPECT_FALSE(lies_below("/spool/", "/spool"));
  EXPECT_FALSE(lies_below("/spool2/1.ply", "/spool"));
  EXPECT_FALSE(lies_below("/spool/../etc/passwd", "/spool"));
  EXPECT_FALSE(lies_below("/etc/passwd", "/spool"));
  EXPECT_FALSE(lies_below("", "/spool"));
  EXPECT_FALSE(lies_below("/etc/passwd", ""));
}

}  // namespace
}  // namespace slabd::storage
