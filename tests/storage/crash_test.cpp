// SPDX-License-Identifier: Apache-2.0
//
// A child process applies jobs and reports each one after apply() returned; the parent kills it at a random moment
// and looks at what is left. What was reported must be there.
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class CrashTest : public StoreTest {
 protected:
  /// Runs in the child: slabs without end, one byte per durable block.
  [[noreturn]] void work(int pipe_end, std::int64_t first_key) {
    Result<std::unique_ptr<Store>> store = open_store(settings_);
    if (!store.ok()) _exit(1);
    store_ = std::move(store.value());
    // A child begins where its parent's numbers stood, as the one before it did, and no two scans may be alike.
    prng_ = Prng(static_cast<std::uint64_t>(first_key));
    for (std::int64_t key = first_key;; ++key) {
      begin(key);
      for (int station = 1; station <= 18; ++station) {
        const std::uint16_t res_seq = scan(key, station, 1);
        if (HasFailure() || write(pipe_end, "b", 1) != 1) _exit(2);
        if (station % 3 == 0) apply(AckJob{res_seq});
      }
      const std::uint16_t res_seq = end(key, Verdict::pass);
      if (HasFailure() || write(pipe_end, "s", 1) != 1) _exit(3);
      apply(AckJob{res_seq});
    }
  }
  struct Reported {
    int blocks = 0;
    int slabs = 0;
  };
  Reported kill_after(int reports, std::int64_t first_key) {
    std::array<int, 2> ends{};
    EXPECT_EQ(pipe(ends.data()), 0);
    const pid_t child = fork();
    if (child == 0) {
      close_fd(ends[0]);
      work(ends[1], first_key);
    }
    close_fd(ends[1]);
    Reported reported;
    char what = 0;
    const auto count = [&] { (what == 's' ? reported.slabs : reported.blocks) += 1; };
    for (int i = 0; i < reports && read(ends[0], &what, 1) == 1; ++i) count();
    usleep(static_cast<useconds_t>(prng_.below(3'000)));
    EXPECT_EQ(kill(child, SIGKILL), 0);
    while (read(ends[0], &what, 1) == 1) count();  // reported before it died
    int status = 0;
    EXPECT_EQ(waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFSIGNALED(status)) << "the child ended by itself";
    close_fd(ends[0]);
    return reported;
  }
  static void close_fd(int fd) { ::close(fd); }
};

TEST_F(CrashTest, kill_9_loses_no_reported_row_and_leaves_the_file_whole) {
  std::int64_t first_key = 1;
  int blocks = 0;
  int slabs = 0;
  for (int round = 0; round < 15; ++round) {
    const Reported reported = kill_after(1 + static_cast<int>(prng_.below(40)), first_key);
    Result<std::unique_ptr<Connection>> opened = open_for_writing(settings_.db_path);
    ASSERT_TRUE(opened.ok()) << opened.error().text.view();
    Connection& db = *opened.value();
    EXPECT_EQ(db.text("PRAGMA integrity_check"), "ok");
    EXPECT_EQ(db.integer("SELECT count(*) FROM pragma_foreign_key_check"), 0);
    const std::int64_t blocks_now = db.integer("SELECT count(*) FROM block");
    const std::int64_t slabs_now = db.integer("SELECT count(*) FROM slab_result");
    EXPECT_GE(blocks_now, blocks + reported.blocks);
    EXPECT_LE(blocks_now, blocks + reported.blocks + 1) << "more than the one job in flight";
    EXPECT_GE(slabs_now, slabs + reported.slabs);
    // Whole jobs only: a block has five planes, two casings, its items and one record.
    EXPECT_EQ(db.integer("SELECT count(*) FROM plane"), 5 * blocks_now);
    EXPECT_EQ(db.integer("SELECT count(*) FROM casing"), 2 * blocks_now);
    EXPECT_EQ(db.integer("SELECT count(*) FROM item WHERE station > 0"),
              blocks_now * static_cast<std::int64_t>(kBlockItemsMax));
    EXPECT_EQ(db.integer("SELECT count(*) FROM item WHERE station = 0"),
              slabs_now * static_cast<std::int64_t>(kSlabItemsMax));
    EXPECT_EQ(db.integer("SELECT count(*) FROM result"), blocks_now + slabs_now);
    opened.value().reset();

    blocks = static_cast<int>(blocks_now);
    slabs = static_cast<int>(slabs_now);
    open();
    const auto line = recover();
    if (line->slab_open) {
      res_seq_ = line->res_seq;
      end(line->last_slab_key, Verdict::aborted);
      ++slabs;
    }
    while (!recover()->unacknowledged.empty()) apply(AckJob{recover()->unacknowledged.front().res_seq});
    first_key = line->last_slab_key + 1;
    close();
  }
  EXPECT_GT(blocks, 15);
}

/// A file size limit makes the write-ahead log's growth fail as a broken disk would.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    signal(SIGXFSZ, SIG_IGN);
    EXPECT_EQ(getrlimit(RLIMIT_FSIZE, &before_), 0);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    EXPECT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  }
  ~FileSizeLimit() { EXPECT_EQ(setrlimit(RLIMIT_FSIZE, &before_), 0); }

 private:
  rlimit before_{};
};

// What a power cut leaves while a start makes the log durable: the log spoilt, its copy whole.
TEST_F(CrashTest, a_log_that_a_power_cut_spoils_comes_back_from_its_copy_and_nobody_reads_it_before) {
  namespace fs = std::filesystem;
  open();
  begin(1);
  scan(1, 1, 1);
  const std::string log_path = settings_.db_path + "-wal";
  const std::string image = folder_.path() + "/cut/slabd.db";
  fs::create_directories(fs::path(image).parent_path());
  fs::copy_file(settings_.db_path, image);
  std::ifstream in(log_path, std::ios::binary);
  const std::string log{std::istreambuf_iterator<char>(in), {}};
  ASSERT_FALSE(log.empty());
  close();
  std::string spoilt = log;
  for (std::size_t at = 512; at < spoilt.size(); at += 4096) spoilt[at] = static_cast<char>(~spoilt[at]);
  std::string copy = "slabd: a copy of the log";
  copy.resize(512, '\0');
  std::ofstream(image + "-wal", std::ios::binary) << spoilt;
  std::ofstream(image + "-log-copy", std::ios::binary) << copy << log;
  std::ofstream(image + "-log-copy.part", std::ios::binary) << "of an earlier start";

  const auto early = open_reader(image);
  ASSERT_FALSE(early.ok());
  EXPECT_NE(early.error().text.view().find("starting slabd"), std::string_view::npos) << early.error().text.view();
  settings_.db_path = image;
  open();
  EXPECT_EQ(recover()->stations[0].phase, StationPhase::measured);
  EXPECT_FALSE(fs::exists(image + "-log-copy"));
  EXPECT_TRUE(open_reader(image).ok());
}

// The name comes back with a power cut after it was removed; by then its first sector says that it is nothing.
TEST_F(CrashTest, a_copy_of_the_log_that_was_done_with_is_not_believed_again) {
  open();
  begin(1);
  std::string copy(512 + 4096, '\0');
  close();
  std::ofstream(settings_.db_path + "-log-copy", std::ios::binary) << copy;
  open();
  EXPECT_TRUE(recover()->slab_open);
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path + "-log-copy"));
}

TEST_F(CrashTest, failed_write_is_reported_and_the_next_job_opens_the_file_anew) {
  open();
  begin(1);
  scan(1, 1, 1);
  acquire(1, 2, 1);
  const BlockJob job{1, 1, random_block(prng_, 2, Verdict::pass), random_record(prng_, ++res_seq_, 1)};
  {
    const FileSizeLimit limit(4096);
    const Status status = try_apply(job);
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, Code::journal_write);
    EXPECT_NE(status.error().text.view().find(settings_.db_path), std::string_view::npos);
    EXPECT_FALSE(try_apply(AckJob{1}).ok()) << "still broken: nothing may be reported as written";
  }
  auto line = recover();
  EXPECT_EQ(line->stations[0].phase, StationPhase::measured);
  EXPECT_EQ(line->stations[1].phase, StationPhase::acquired);
  EXPECT_EQ(line->unacknowledged.size(), 1U);
  apply(job);
  line = recover();
  EXPECT_EQ(line->stations[1].phase, StationPhase::measured);
  EXPECT_EQ(line->unacknowledged.size(), 2U);
}

TEST_F(CrashTest, a_running_store_begins_no_new_history_where_its_file_is_gone) {
  open();
  begin(1);
  const std::uint16_t record = scan(1, 1, 1);
  {
    const FileSizeLimit limit(4096);
    ASSERT_FALSE(try_apply(AckJob{record}).ok());
  }
  // The disk goes away: what is left is the empty folder it was mounted on.
  const std::string folder = std::filesystem::path(settings_.db_path).parent_path().string();
  std::filesystem::rename(folder, folder + "-unmounted");
  std::filesystem::create_directory(folder);
  const Status status = try_apply(AckJob{record});
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().text.view().find("not the file any more"), std::string_view::npos)
      << status.error().text.view();
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path));
  // Nor in an empty file, nor in another database.
  std::ofstream(settings_.db_path).close();
  EXPECT_FALSE(try_apply(AckJob{record}).ok());
  EXPECT_EQ(std::filesystem::file_size(settings_.db_path), 0U);
  std::filesystem::remove_all(folder);
  std::filesystem::rename(folder + "-unmounted", folder);
  apply(AckJob{record});
  EXPECT_TRUE(recover()->slab_open);
}

/// The writer has the file open, so every commit in a file that was taken away succeeds, and is gone with the process.
class TakenAwayTest : public CrashTest {
 protected:
  void SetUp() override {
    open();
    begin(1);
    record_ = scan(1, 1, 1);
    copy_ = folder_.path() + "/copy.db";
    std::filesystem::copy_file(settings_.db_path, copy_);
  }
  [[nodiscard]] bool is_refused(const decltype(StoreJob::what)& what) {
    const Status status = try_apply(what);
    return !status.ok() && status.error().code == Code::journal_write &&
           status.error().text.view().find("slabctl db backup") != std::string_view::npos;
  }
  /// What idle() finds within a second.
  [[nodiscard]] std::string idle_trouble() {
    for (int i = 0; i < 12; ++i) store_->idle();
    return std::string(store_->trouble());
  }
  void move_away(const char* to) {
    for (const char* side : {"", "-wal", "-shm"})
      std::filesystem::rename(settings_.db_path + side, settings_.db_path + to + side);
  }
  void put_back(const char* from) {
    for (const char* side : {"", "-wal", "-shm"})
      std::filesystem::rename(settings_.db_path + from + side, settings_.db_path + side);
  }

  std::uint16_t record_ = 0;
  std::string copy_;
};

TEST_F(TakenAwayTest, nothing_is_told_to_be_written_until_the_file_is_back) {
  EXPECT_EQ(idle_trouble(), "");
  move_away("-away");
  EXPECT_TRUE(is_refused(AckJob{record_}));
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path)) << "nor is a history begun anew";
  put_back("-away");
  EXPECT_EQ(idle_trouble(), "");
  apply(AckJob{record_});
  EXPECT_EQ(recover()->stations[0].phase, StationPhase::measured);
}

TEST_F(TakenAwayTest, another_file_under_its_name_is_not_taken_for_it) {
  move_away("-away");
  std::filesystem::copy_file(copy_, settings_.db_path);
  EXPECT_TRUE(is_refused(AckJob{record_}));
  EXPECT_FALSE(store_->change(KeepCheck{}).ok());
  EXPECT_NE(idle_trouble(), "");
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path + "-wal")) << "the other file is not even opened";
}

TEST_F(TakenAwayTest, a_log_that_is_deleted_takes_its_commits_along) {
  std::filesystem::remove(settings_.db_path + "-wal");
  EXPECT_TRUE(is_refused(AckJob{record_}));
}

TEST_F(TakenAwayTest, is_found_without_a_job_and_what_is_open_can_be_saved) {
  acquire(1, 2, 1);
  for (const char* side : {"", "-wal", "-shm"}) std::filesystem::remove(settings_.db_path + side);
  EXPECT_NE(idle_trouble().find("slabctl db backup"), std::string::npos);
  // Nothing is taken away on its word, and whoever ordered that is told.
  ASSERT_TRUE(store_->order(PruneOrder{1000, {}}).ok());
  store_->idle();
  EXPECT_EQ(store_->care().prune, CareState::Phase::failed);
  EXPECT_NE(store_->care().prune_error.find("slabctl db backup"), std::string::npos);
  // A job that was refused meanwhile is settled in the copy: the PLC was told that it failed.
  EXPECT_TRUE(is_refused(FailedAttemptJob{attempt(1, 3, 1), 205}));
  const std::string saved = folder_.path() + "/saved.db";
  ASSERT_TRUE(store_->order(BackupOrder{saved}).ok());
  for (int i = 0; i < 100 && store_->care().backup == CareState::Phase::under_way; ++i) store_->idle();
  ASSERT_EQ(store_->care().backup, CareState::Phase::done) << store_->care().backup_error;
  close();
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path));
  std::filesystem::copy_file(saved, settings_.db_path);
  open();
  const auto line = recover();
  EXPECT_EQ(line->stations[0].phase, StationPhase::measured);
  EXPECT_EQ(line->stations[1].phase, StationPhase::acquired);
}

}  // namespace
}  // namespace slabd::storage
