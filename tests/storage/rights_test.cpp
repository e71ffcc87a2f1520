// SPDX-License-Identifier: Apache-2.0
//
// A person of the group can read, but not write, the database in every state in which slabd leaves it.
//
// The person is a separate process, forked before this one opens the database. Under root it becomes another user in
// the group of the database. Without root it stays the same user, and write permissions are removed from files and
// folder while it reads, which is the same for SQLite.
#include <fcntl.h>
#include <grp.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "storage/chain.h"
#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

constexpr uid_t kOtherUser = 65'534;
constexpr gid_t kOtherGroup = 65'534;
constexpr gid_t kGroup = 64'321;  ///< group of the database; needs no name

bool is_root() {
  return geteuid() == 0;
}

/// Without root a file already belongs to this user.
void give(const std::string& path, uid_t owner) {
  EXPECT_EQ(is_root() ? chown(path.c_str(), owner, kGroup) : 0, 0) << std::strerror(errno);
}

void set_mode(const std::string& path, mode_t mode) {
  EXPECT_EQ(chmod(path.c_str(), mode), 0) << path << ": " << std::strerror(errno);
}

/// A separate process that answers each line with one line.
class Person {
 public:
  template <typename Answer>
  explicit Person(Answer answer) {
    EXPECT_EQ(pipe2(to_.data(), O_CLOEXEC), 0);
    EXPECT_EQ(pipe2(from_.data(), O_CLOEXEC), 0);
    child_ = fork();
    if (child_ != 0) {
      ::close(to_[0]);
      ::close(from_[1]);
      return;
    }
    ::close(to_[1]);
    ::close(from_[0]);
    if (is_root() && (setgroups(1, &kGroup) != 0 || setresgid(kOtherGroup, kOtherGroup, kOtherGroup) != 0 ||
                      setresuid(kOtherUser, kOtherUser, kOtherUser) != 0))
      _exit(1);
    for (std::string line = read_line(to_[0]); !line.empty(); line = read_line(to_[0]))
      write_line(from_[1], answer(line) + " ");
    _exit(0);
  }
  ~Person() {
    ::close(to_[1]);
    ::close(from_[0]);
    int status = 0;
    waitpid(child_, &status, 0);
    EXPECT_EQ(status, 0);
  }
  Person(const Person&) = delete;
  Person& operator=(const Person&) = delete;

  std::string ask(const std::string& line) {
    write_line(to_[1], line);
    std::string answer = read_line(from_[0]);
    EXPECT_FALSE(answer.empty()) << "the reading process has ended";
    if (!answer.empty()) answer.pop_back();
    return answer;
  }

 private:
  static void write_line(int fd, const std::string& line) {
    const std::string text = line + "\n";
    EXPECT_EQ(write(fd, text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  static std::string read_line(int fd) {
    std::string line;
    for (char c = 0; read(fd, &c, 1) == 1 && c != '\n';) line += c;
    return line;
  }

  std::array<int, 2> to_{};
  std::array<int, 2> from_{};
  pid_t child_ = 0;
};

/// Reads like any program that uses SQLite.
std::string plain_count(const std::string& path) {
  sqlite3* db = nullptr;
  std::string answer;
  sqlite3_stmt* rows = nullptr;
  if (sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READONLY, nullptr) == SQLITE_OK &&
      sqlite3_prepare_v2(db, "SELECT count(*) FROM slab", -1, &rows, nullptr) == SQLITE_OK &&
      sqlite3_step(rows) == SQLITE_ROW)
    answer = std::to_string(sqlite3_column_int(rows, 0));
  else
    answer = sqlite3_errmsg(db);
  sqlite3_finalize(rows);
  sqlite3_close(db);
  return answer;
}

/// Actions of the person, selected by the first word. One reader stays open between requests.
class Reading {
 public:
  explicit Reading(std::string path) : path_(std::move(path)) {}
  std::string operator()(const std::string& line) {
    if (line == "plain") return plain_count(path_);
    if (line == "check") return check();
    if (line == "write") return write_all();
    if (line == "keep") return keep();
    if (line == "again") return count(*kept_);
    const Result<std::unique_ptr<Reader>> reader = open_reader(path_);
    return reader.ok() ? count(*reader.value()) : std::string(reader.error().text.view());
  }

 private:
  static std::string count(Reader& reader) {
    const auto slabs = reader.slabs(1'000);
    return slabs.ok() ? std::to_string(slabs.value().size()) : std::string(slabs.error().text.view());
  }
  std::string keep() {
    Result<std::unique_ptr<Reader>> reader = open_reader(path_);
    if (!reader.ok()) return std::string(reader.error().text.view());
    kept_ = std::move(reader.value());
    return count(*kept_);
  }
  [[nodiscard]] std::string check() const {
    const Result<DatabaseReport> report = check_database(path_, true);
    const Result<ChainReport> chain = check_chain(path_);
    if (!report.ok()) return std::string(report.error().text.view());
    if (!chain.ok()) return std::string(chain.error().text.view());
    return report.value().trouble + chain.value().trouble + std::to_string(chain.value().sealed);
  }
  /// Tries all writes and returns the names of those that succeeded.
  [[nodiscard]] std::string write_all() const {
    std::string done;
    for (const char* side : {"", "-wal", "-shm", ".writer"}) {
      const std::string file = path_ + side;
      if (const int fd = ::open(file.c_str(), O_RDWR); fd >= 0) done += std::string("open") + side + " ";
      if (std::rename(file.c_str(), (file + "-moved").c_str()) == 0) done += std::string("rename") + side + " ";
      if (unlink(file.c_str()) == 0) done += std::string("unlink") + side + " ";
      if (chmod(file.c_str(), 0666) == 0) done += std::string("chmod") + side + " ";
    }
    if (const int fd = ::open((path_ + ".writer").c_str(), O_RDONLY); fd >= 0) done += "lock ";
    if (const int fd = ::open((path_ + "-journal").c_str(), O_RDWR | O_CREAT, 0666); fd >= 0) done += "journal ";
    sqlite3* db = nullptr;
    if (sqlite3_open(path_.c_str(), &db) == SQLITE_OK &&
        sqlite3_exec(db, "UPDATE slab_result SET verdict = 'pass'", nullptr, nullptr, nullptr) == SQLITE_OK)
      done += "update ";
    sqlite3_close(db);
    return done;
  }

  std::string path_;
  std::unique_ptr<Reader> kept_;
};

class RightsTest : public StoreTest {
 protected:
  RightsTest() {
    settings_.spool_free_bytes_min = 1;
    fs::create_directory(db_folder_);
    set_mode(folder_.path(), 0711);
    give(db_folder_, geteuid());
    set_mode(db_folder_, 02750);
  }
  void start() {
    open();
    (void)recover();
  }
  void slabs(std::int64_t first, std::int64_t last) {
    for (std::int64_t key = first; key <= last; ++key) {
      begin(key);
      acknowledge(end(key, Verdict::fail));
    }
  }
  /// Sends a request with read-only permissions.
  std::string ask(Person& person, const std::string& what) {
    if (is_root()) return person.ask(what);
    for (const auto& file : fs::directory_iterator(db_folder_))
      if (file.is_regular_file()) set_mode(file.path(), 0440);
    set_mode(db_folder_, 0550);
    std::string answer = person.ask(what);
    set_mode(db_folder_, 02750);
    for (const auto& file : fs::directory_iterator(db_folder_))
      if (file.is_regular_file()) set_mode(file.path(), 0640);
    return answer;
  }
  /// Copies the files as a kill or a power cut leaves them, while slabd has them open.
  void killed_here(const std::string& to) {
    fs::create_directory(to);
    for (const char* side : {"", "-wal", "-shm"}) {
      const std::string file = to + "/slabd.db" + side;
      fs::copy_file(settings_.db_path + side, file);
      give(file, geteuid());
      set_mode(file, 0640);
    }
    give(to, geteuid());
    set_mode(to, 02750);
  }

  std::string db_folder_ = folder_.path() + "/db";
};

TEST_F(RightsTest, a_person_of_the_group_reads_while_slabd_writes) {
  Person person{Reading(settings_.db_path)};
  start();
  EXPECT_EQ(ask(person, "read"), "0");
  for (std::int64_t key = 1; key <= 6; ++key) {
    slabs(key, key);
    EXPECT_EQ(ask(person, "read"), std::to_string(key));
    EXPECT_EQ(ask(person, "plain"), std::to_string(key));
    if (key % 2 == 0)
      for (int look = 0; look < 8; ++look) store_->idle();  // moves the log into the database
    EXPECT_EQ(ask(person, "read"), std::to_string(key));
  }
  EXPECT_EQ(ask(person, "check"), "6");
}

TEST_F(RightsTest, a_person_of_the_group_reads_while_slabd_is_stopped) {
  Person person{Reading(settings_.db_path)};
  start();
  slabs(1, 3);
  close();
  EXPECT_EQ(file_bytes(settings_.db_path + "-wal"), 0);
  EXPECT_EQ(ask(person, "read"), "3");
  EXPECT_EQ(ask(person, "plain"), "3") << "any SQLite";
  EXPECT_EQ(ask(person, "check"), "3");
}

TEST_F(RightsTest, a_database_that_an_older_slabd_left_without_side_files_is_read) {
  Person person{Reading(settings_.db_path)};
  start();
  slabs(1, 2);
  close();
  fs::remove(settings_.db_path + "-wal");
  fs::remove(settings_.db_path + "-shm");
  EXPECT_EQ(ask(person, "read"), "2");
  EXPECT_EQ(ask(person, "check"), "2");
  std::ofstream(settings_.db_path + "-shm") << std::string(32'768, '\0');  // only one of the two
  ASSERT_EQ(chmod((settings_.db_path + "-shm").c_str(), 0644), 0);
  EXPECT_EQ(ask(person, "read"), "2");
}

TEST_F(RightsTest, a_log_with_commits_and_an_unfinished_frame_is_read_after_a_kill) {
  const std::string there = folder_.path() + "/killed";
  Person person{Reading(there + "/slabd.db")};
  start();
  slabs(1, 2);
  for (int look = 0; look < 8; ++look) store_->idle();
  slabs(3, 5);
  ASSERT_GT(file_bytes(settings_.db_path + "-wal"), 0);
  killed_here(there);
  const std::string log = there + "/slabd.db-wal";
  std::ofstream(log, std::ios::app | std::ios::binary) << std::string(1'777, '\x5a');
  const std::int64_t bytes = file_bytes(log);
  db_folder_ = there;
  EXPECT_EQ(ask(person, "read"), "5");
  EXPECT_EQ(ask(person, "plain"), "5");
  EXPECT_EQ(ask(person, "check"), "5");
  EXPECT_EQ(file_bytes(log), bytes) << "reading changes nothing";
  // A power cut may leave arbitrary bytes in the index, which SQLite then rebuilds in memory.
  std::fstream(there + "/slabd.db-shm", std::ios::in | std::ios::out | std::ios::binary) << std::string(4'096, '\x77');
  EXPECT_EQ(ask(person, "read"), "5");
}

TEST_F(RightsTest, a_log_without_its_index_is_refused_with_a_reason_and_never_left_out) {
  const std::string there = folder_.path() + "/killed";
  Person person{Reading(there + "/slabd.db")};
  start();
  slabs(1, 5);
  killed_here(there);
  fs::remove(there + "/slabd.db-shm");
  db_folder_ = there;
  const std::string said = ask(person, "read");
  EXPECT_NE(said.find("log (-wal) without its index (-shm)"), std::string::npos) << said;
}

TEST_F(RightsTest, a_reader_that_stays_open_reads_what_a_restarted_slabd_writes) {
  Person person{Reading(settings_.db_path)};
  start();
  slabs(1, 1);
  EXPECT_EQ(ask(person, "keep"), "1");
  close();
  EXPECT_EQ(ask(person, "again"), "1");
  start();
  slabs(2, 3);
  EXPECT_EQ(ask(person, "again"), "3");
  for (int look = 0; look < 8; ++look) store_->idle();
  slabs(4, 4);
  EXPECT_EQ(ask(person, "again"), "4");
}

TEST_F(RightsTest, a_member_of_the_group_cannot_write_whether_slabd_runs_or_not) {
  Person person{Reading(settings_.db_path)};
  start();
  slabs(1, 1);
  if (is_root()) {
    EXPECT_EQ(person.ask("write"), "");
    close();
    EXPECT_EQ(person.ask("write"), "");
  }
  close();
  for (const char* side : {"", "-wal", "-shm", ".writer"}) {
    struct stat file {};
    ASSERT_EQ(stat((settings_.db_path + side).c_str(), &file), 0) << side;
    EXPECT_EQ(file.st_mode & 0027U, 0U) << side;
  }
}

TEST_F(RightsTest, files_that_an_older_slabd_opened_to_the_group_are_closed_at_the_start) {
  start();
  slabs(1, 1);
  close();
  for (const char* side : {"", "-wal", "-shm"}) ASSERT_EQ(chmod((settings_.db_path + side).c_str(), 0664), 0);
  start();
  for (const char* side : {"", "-wal", "-shm"}) {
    struct stat file {};
    ASSERT_EQ(stat((settings_.db_path + side).c_str(), &file), 0) << side;
    EXPECT_EQ(file.st_mode & 07777U, 0640U) << side;
  }
}

TEST_F(RightsTest, files_created_by_root_belong_to_the_owner_of_the_folder) {
  const uid_t owner = is_root() ? kOtherUser : geteuid();
  give(db_folder_, owner);
  start();
  slabs(1, 1);
  const Result<std::string> backups = backup_folder(settings_.db_path);
  ASSERT_TRUE(backups.ok());
  const std::string copy = backups.value() + "/copy.db";
  close();
  ASSERT_TRUE(back_up_database(settings_.db_path, copy).ok());
  for (const std::string& path : {settings_.db_path, settings_.db_path + "-wal", settings_.db_path + "-shm",
                                  settings_.db_path + ".writer", backups.value(), copy}) {
    struct stat file {};
    ASSERT_EQ(stat(path.c_str(), &file), 0) << path;
    EXPECT_EQ(file.st_uid, owner) << path << ": slabd could not write it";
  }
}

TEST_F(RightsTest, a_database_that_changes_while_it_is_read_without_locks_is_refused) {
  start();
  slabs(1, 1);
  close();
  fs::remove(settings_.db_path + "-wal");
  fs::remove(settings_.db_path + "-shm");
  Connection db(settings_.db_path, Connection::ReadUnchanged{});
  {
    Transaction moment(db, "BEGIN");
    EXPECT_EQ(db.integer("SELECT count(*) FROM slab"), 1);
    moment.commit();
  }
  start();  // slabd creates a log
  Transaction moment(db, "BEGIN");
  EXPECT_EQ(db.integer("SELECT count(*) FROM slab"), 1);
  try {
    moment.commit();
    ADD_FAILURE() << "it was believed";
  } catch (const SqlFailure& failure) {
    EXPECT_NE(failure.text.find("changed while it was read"), std::string::npos) << failure.text;
  }
}

TEST_F(RightsTest, a_path_with_signs_of_a_uri_is_read_without_locks) {
  const std::string folder = folder_.path() + "/a?b#c%20 d";
  fs::create_directory(folder);
  start();
  slabs(1, 2);
  close();
  fs::copy_file(settings_.db_path, folder + "/slabd.db");
  Connection db(folder + "/slabd.db", Connection::ReadUnchanged{});
  EXPECT_EQ(db.integer("SELECT count(*) FROM slab"), 2);
}

}  // namespace
}  // namespace slabd::storage
