// SPDX-License-Identifier: Apache-2.0
//
// A backup is either byte for byte as written, or reported as damaged.
#include <sqlite3.h>

#include <filesystem>
#include <fstream>

#include "storage/files/database.h"
#include "storage/files/file_checksum.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

class ChecksumTest : public StoreTest {
 protected:
  void SetUp() override {
    open();
    (void)recover();
    for (std::int64_t key = 1; key <= 3; ++key) {
      begin(key);
      acknowledge(scan(key, 1, 1));
      acknowledge(end(key, Verdict::pass));
    }
    close();
    ASSERT_TRUE(back_up_database(settings_.db_path, backup_).ok());
  }
  [[nodiscard]] static std::string content(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void put(const std::string& bytes) const { std::ofstream(spoilt_, std::ios::binary | std::ios::trunc) << bytes; }
  [[nodiscard]] Status restore(const std::string& from, bool accept_unproven = false) const {
    RestoreOrder order{from, {"anna", "the disk broke", 1'700'000'000'000'000}, 4711};
    order.accept_unproven = accept_unproven;
    return restore_database(settings_, order);
  }
  void expect_damaged(const std::string& what) const {
    const Result<DatabaseReport> report = check_database(spoilt_, true);
    ASSERT_TRUE(report.ok()) << what << ": " << report.error().text.view();
    EXPECT_NE(report.value().trouble, "") << what;
    EXPECT_FALSE(report.value().has_checksum) << what;
    const Status status = restore(spoilt_, true);
    ASSERT_FALSE(status.ok()) << what;
    EXPECT_NE(status.error().text.view().find("is not whole"), std::string_view::npos) << status.error().text.view();
  }

  std::string backup_ = folder_.path() + "/backup.db";
  std::string spoilt_ = folder_.path() + "/spoilt.db";
};

TEST_F(ChecksumTest, a_flipped_bit_anywhere_in_a_backup_is_damage_and_is_not_restored) {
  const std::string whole = content(backup_);
  std::vector<std::size_t> places;
  for (std::size_t i = 0; i < 100; i += 4) places.push_back(i);  // SQLite's header
  for (std::size_t i = 1; i <= kChecksumLineBytes; i += 5) places.push_back(whole.size() - i);
  for (int i = 0; i < 150; ++i) places.push_back(static_cast<std::size_t>(prng_.next() % whole.size()));
  for (const std::size_t place : places) {
    std::string spoilt = whole;
    spoilt[place] = static_cast<char>(spoilt[place] ^ (1 << prng_.next() % 8));
    put(spoilt);
    expect_damaged("byte " + std::to_string(place));
    if (HasFatalFailure()) return;
  }
}

TEST_F(ChecksumTest, a_backup_with_bytes_cut_off_or_added_is_damage_and_is_not_restored) {
  const std::string whole = content(backup_);
  for (const std::size_t cut : {std::size_t{1}, std::size_t{8}, kChecksumLineBytes - 1, kChecksumLineBytes,
                                kChecksumLineBytes + 1, std::size_t{4096}, whole.size() / 2}) {
    put(whole.substr(0, whole.size() - cut));
    expect_damaged("cut by " + std::to_string(cut));
  }
  for (const std::size_t more : {1U, 8U, 4096U}) {
    put(whole + std::string(more, '\0'));
    expect_damaged("longer by " + std::to_string(more));
  }
}

TEST_F(ChecksumTest, a_whole_backup_is_proven_and_can_be_copied) {
  fs::copy_file(backup_, spoilt_);
  const Result<DatabaseReport> report = check_database(spoilt_, true);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report.value().trouble, "");
  EXPECT_TRUE(report.value().has_checksum);
  EXPECT_EQ(report.value().slabs, 3);
  EXPECT_EQ(content(backup_), content(spoilt_)) << "reading it changes nothing";
  ASSERT_TRUE(restore(spoilt_).ok());
  open();
  EXPECT_EQ(recover()->last_slab_key, 3);
}

TEST_F(ChecksumTest, a_copy_without_a_checksum_is_restored_only_when_that_is_accepted) {
  fs::copy_file(settings_.db_path, spoilt_);
  const Result<DatabaseReport> report = check_database(spoilt_, true);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report.value().trouble, "");
  EXPECT_FALSE(report.value().has_checksum);
  const Status refused = restore(spoilt_);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, Code::config);
  EXPECT_NE(refused.error().text.view().find("has no checksum"), std::string_view::npos);
  EXPECT_NE(refused.error().text.view().find("--unproven"), std::string_view::npos) << "the cure is named";
  EXPECT_TRUE(restore(spoilt_, true).ok());
}

TEST_F(ChecksumTest, a_log_next_to_a_backup_is_damage) {
  for (const char* side : {"-wal", "-journal"}) {
    std::ofstream(backup_ + side) << "of another database";
    EXPECT_NE(check_database(backup_, true).value().trouble.find("exists next to it"), std::string::npos) << side;
    fs::remove(backup_ + side);
  }
}

TEST_F(ChecksumTest, a_backup_that_was_restored_or_copied_into_place_is_a_database_again) {
  const auto is_database = [&] {
    open();
    (void)recover();
    close();
    const Result<FileChecksum> checksum = check_checksum(settings_.db_path);
    ASSERT_TRUE(checksum.ok());
    EXPECT_FALSE(checksum.value().present);
    EXPECT_EQ(checksum.value().trouble, "");
    EXPECT_EQ(check_database(settings_.db_path, true).value().trouble, "");
    fs::remove(spoilt_);
    ASSERT_TRUE(back_up_database(settings_.db_path, spoilt_).ok());
    EXPECT_TRUE(check_database(spoilt_, true).value().has_checksum);
  };
  ASSERT_TRUE(restore(backup_).ok());
  is_database();
  for (const char* side : {"", "-wal", "-shm"}) fs::remove(settings_.db_path + side);
  fs::copy_file(backup_, settings_.db_path);
  is_database();
}

TEST_F(ChecksumTest, the_line_is_text_with_the_length_and_the_sha256_of_what_is_before_it) {
  const std::string whole = content(backup_);
  const std::string line = whole.substr(whole.size() - kChecksumLineBytes);
  EXPECT_TRUE(line.starts_with("\nslabd backup, checksum 1: 0000000")) << line;
  EXPECT_NE(line.find(std::to_string(whole.size() - kChecksumLineBytes) + " bytes "), std::string::npos) << line;
  EXPECT_TRUE(line.ends_with(" \n")) << line;
}

}  // namespace
}  // namespace slabd::storage
