// SPDX-License-Identifier: Apache-2.0
//
// Results of power cuts and failing writes, case by case. survival_test.cpp tests that reported data survives a kill at
// any call.
#include <signal.h>
#include <sys/resource.h>

#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class CrashTest : public StoreTest {};

/// A file size limit makes the growth of the write-ahead log fail like a broken disk.
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

// State after a power cut while a start makes the log durable: the log is damaged, its copy is intact.
TEST_F(CrashTest, a_log_that_a_power_cut_spoils_is_restored_from_its_copy_and_not_read_before) {
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
  EXPECT_NE(early.error().text.view().find("start slabd to recover"), std::string_view::npos)
      << early.error().text.view();
  settings_.db_path = image;
  open();
  EXPECT_EQ(recover()->stations[0].phase, StationPhase::measured);
  EXPECT_FALSE(fs::exists(image + "-log-copy"));
  EXPECT_TRUE(open_reader(image).ok());
}

// A power cut may restore the removed name, but the first sector is already cleared.
TEST_F(CrashTest, a_copy_of_the_log_that_was_done_with_is_not_used_again) {
  open();
  begin(1);
  std::string copy(512 + 4096, '\0');
  close();
  std::ofstream(settings_.db_path + "-log-copy", std::ios::binary) << copy;
  open();
  EXPECT_TRUE(recover()->slab_open);
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path + "-log-copy"));
}

TEST_F(CrashTest, failed_write_is_reported_and_the_next_job_opens_the_file_again) {
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

TEST_F(CrashTest, a_running_store_begins_no_new_history_when_its_file_was_removed) {
  open();
  begin(1);
  const std::uint16_t record = scan(1, 1, 1);
  {
    const FileSizeLimit limit(4096);
    ASSERT_FALSE(try_apply(AckJob{record}).ok());
  }
  // The disk is unmounted: only the empty mount folder remains.
  const std::string folder = std::filesystem::path(settings_.db_path).parent_path().string();
  std::filesystem::rename(folder, folder + "-unmounted");
  std::filesystem::create_directory(folder);
  const Status status = try_apply(AckJob{record});
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().text.view().find("not the file any more"), std::string_view::npos)
      << status.error().text.view();
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path));
  // The same with an empty file, and with another database.
  std::ofstream(settings_.db_path).close();
  EXPECT_FALSE(try_apply(AckJob{record}).ok());
  EXPECT_EQ(std::filesystem::file_size(settings_.db_path), 0U);
  std::filesystem::remove_all(folder);
  std::filesystem::rename(folder + "-unmounted", folder);
  apply(AckJob{record});
  EXPECT_TRUE(recover()->slab_open);
}

/// The writer has the file open, so commits to a removed file succeed and are lost with the process.
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
  /// Trouble detected by idle() within a second.
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

TEST_F(TakenAwayTest, no_record_is_reported_as_written_until_the_file_is_back) {
  EXPECT_EQ(idle_trouble(), "");
  move_away("-away");
  EXPECT_TRUE(is_refused(AckJob{record_}));
  EXPECT_FALSE(std::filesystem::exists(settings_.db_path)) << "nor is a new history started";
  put_back("-away");
  EXPECT_EQ(idle_trouble(), "");
  apply(AckJob{record_});
  EXPECT_EQ(recover()->stations[0].phase, StationPhase::measured);
}

TEST_F(TakenAwayTest, another_file_under_its_name_is_not_used) {
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
  // Nothing is deleted based on this database, and the order reports the reason.
  ASSERT_TRUE(store_->order(PruneOrder{1000, {}}).ok());
  store_->idle();
  EXPECT_EQ(store_->care().prune, CareState::Phase::failed);
  EXPECT_NE(store_->care().prune_error.find("slabctl db backup"), std::string::npos);
  // A job rejected meanwhile is settled in the copy, as its failure was reported to the PLC.
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
