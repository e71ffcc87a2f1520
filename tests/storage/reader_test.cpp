// SPDX-License-Identifier: Apache-2.0
#include <sqlite3.h>
#include <sys/stat.h>

#include <atomic>
#include <filesystem>
#include <thread>

#include "storage/files/database.h"
#include "tests/places/wait.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class ReaderTest : public StoreTest {};

TEST_F(ReaderTest, missing_file_is_named) {
  const Result<std::unique_ptr<Reader>> reader = open_reader(folder_.path() + "/none.db");
  ASSERT_FALSE(reader.ok());
  EXPECT_EQ(reader.error().code, Code::config);
  EXPECT_EQ(reader.error().text.view(),
            "there is no database " + folder_.path() + "/none.db: slabd has not run with it yet, or the path is wrong");
  EXPECT_FALSE(std::filesystem::exists(folder_.path() + "/none.db")) << "a reader must not create it";
}

TEST_F(ReaderTest, a_path_that_is_not_a_regular_file_is_named_and_does_not_block) {
  const std::string fifo = folder_.path() + "/fifo.db";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  const Result<std::unique_ptr<Reader>> reader = open_reader(fifo);
  ASSERT_FALSE(reader.ok());
  EXPECT_NE(std::string(reader.error().text.view()).find("is a FIFO, not a database file"), std::string::npos)
      << reader.error().text.view();
  StoreSettings settings;
  settings.db_path = fifo;
  settings.spool_dir = folder_.path() + "/spool-of-fifo";
  const auto store = open_store(settings);
  ASSERT_FALSE(store.ok());
  EXPECT_NE(std::string(store.error().text.view()).find("is a FIFO"), std::string::npos) << store.error().text.view();
}

TEST_F(ReaderTest, lists_newest_first_and_finds_by_the_newest_id) {
  open();
  for (std::int64_t key = 1; key <= 5; ++key) {
    BeginSlabJob job{random_header(prng_, key), 1, ++cmd_seq_};
    job.slab.slab_id.assign(key == 2 || key == 4 ? "TWICE" : "ONCE-" + std::to_string(key));
    apply(job);
    scan(key, 1, 1);
    acquire(key, 1, 2);  // a station that was scanned again but not measured yet counts as not measured
    scan(key, 2, 1);
    if (key == 5) break;
    const std::uint16_t res_seq = end(key, Verdict::pass);
    if (key == 3) acknowledge(res_seq);
  }
  const auto read = reader();
  ASSERT_NE(read, nullptr);
  Result<std::vector<SlabSummary>> list = read->slabs(3);
  ASSERT_TRUE(list.ok()) << list.error().text.view();
  ASSERT_EQ(list.value().size(), 3U);
  EXPECT_EQ(list.value()[0].header.key, 5);
  EXPECT_EQ(list.value()[0].ended_utime_us, 0) << "still open";
  EXPECT_EQ(list.value()[0].verdict, Verdict::none);
  EXPECT_EQ(list.value()[0].stations_measured, 1);
  EXPECT_EQ(list.value()[1].header.key, 4);
  EXPECT_EQ(list.value()[1].verdict, Verdict::pass);
  EXPECT_FALSE(list.value()[1].acknowledged);
  EXPECT_EQ(list.value()[2].header.key, 3);
  EXPECT_TRUE(list.value()[2].acknowledged);
  EXPECT_EQ(read->find_id("TWICE").value(), (std::vector<std::int64_t>{4, 2}));
  EXPECT_EQ(read->find_id("ONCE-1").value(), std::vector<std::int64_t>{1});
  EXPECT_TRUE(read->find_id("NEVER").value().empty());
  EXPECT_FALSE(read->slab(99).value().has_value());
  const std::uint32_t no = read->slab(3).value()->summary.header.slab_no;
  EXPECT_EQ(read->find_no(no).value(), std::vector<std::int64_t>{3});
  EXPECT_TRUE(read->find_no(no + 1'000'000).value().empty());
}

TEST_F(ReaderTest, a_slab_id_that_was_stored_with_blanks_is_found_without_them) {
  open();
  for (const auto& [key, id] : {std::pair{1, "S-4711                      "}, {2, "  S-4711"}, {3, "S-47110"}}) {
    BeginSlabJob job{random_header(prng_, key), 1, ++cmd_seq_};
    job.slab.slab_id.assign(id);
    apply(job);
    end(key, Verdict::pass);
  }
  EXPECT_EQ(reader()->find_id("S-4711").value(), (std::vector<std::int64_t>{2, 1}));
}

TEST_F(ReaderTest, control_characters_reach_people_as_numbers_and_programs_as_stored) {
  open();
  BeginSlabJob job{random_header(prng_, 1), 1, ++cmd_seq_};
  job.slab.slab_id.assign("A-1");
  apply(job);
  close();
  // The daemon rejects such an id, but a database from elsewhere can contain it.
  const std::string hostile = "A\x1b]0;owned\x07\n9 PASS";
  {
    Connection db(settings_.db_path, SQLITE_OPEN_READWRITE);
    Statement change(db, "UPDATE slab SET slab_id = ?");
    change.bind(1, hostile);
    ASSERT_FALSE(change.step());
  }
  for (const auto& [text_for, shown] : {std::pair{TextFor::people, std::string("A\\x1b]0;owned\\x07\\n9 PASS")},
                                        std::pair{TextFor::programs, hostile}}) {
    Result<std::unique_ptr<Reader>> read = open_reader(settings_.db_path, text_for);
    ASSERT_TRUE(read.ok()) << read.error().text.view();
    const Result<std::vector<SlabSummary>> list = read.value()->slabs(3);
    ASSERT_TRUE(list.ok()) << list.error().text.view();
    ASSERT_EQ(list.value().size(), 1U);
    EXPECT_EQ(list.value()[0].header.slab_id.view(), shown.substr(0, limits::kSlabIdBytes));
  }
}

TEST_F(ReaderTest, reads_after_the_daemon_has_ended) {
  open();
  begin(1);
  scan(1, 1, 1);
  close();
  EXPECT_EQ(reader()->slabs(10).value().size(), 1U);
  open();
  EXPECT_EQ(recover()->last_slab_key, 1);
}

TEST_F(ReaderTest, cannot_write) {
  open();
  Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
  ASSERT_TRUE(db.ok());
  EXPECT_THROW(db.value()->execute("UPDATE line SET session = 9"), SqlFailure);
  EXPECT_EQ(recover()->session, 0);
}

TEST_F(ReaderTest, reads_whole_slabs_while_the_daemon_writes) {
  open();
  begin(1);
  std::atomic<bool> stop = false;
  std::atomic<int> looks = 0;
  std::jthread writer([&] {
    for (std::int64_t key = 1; key <= 6; ++key) {
      // On a loaded computer the reader may begin late.
      if (key == 6) {
        EXPECT_TRUE(places::wait_until([&] { return looks > 1; }));
      }
      if (key > 1) begin(key);
      for (int station = 1; station <= 18; ++station) scan(key, station, 1);
      end(key, Verdict::pass);
    }
    stop = true;
  });
  const auto read = reader();
  do {
    Result<std::vector<SlabSummary>> list = read->slabs(100);
    ASSERT_TRUE(list.ok()) << list.error().text.view();
    for (const SlabSummary& slab : list.value()) {
      Result<std::optional<SlabRecord>> record = read->slab(slab.header.key);
      ASSERT_TRUE(record.ok()) << record.error().text.view();
      if (slab.ended_utime_us != 0) {
        EXPECT_EQ(record.value()->blocks.size(), 18U);
      }
      for (const SlabBlock& block : record.value()->blocks)
        if (block.phase == StationPhase::measured) {
          EXPECT_TRUE(block.block.items.full());
        }
    }
    ++looks;
  } while (!stop);
  writer.join();
  EXPECT_EQ(read->slabs(100).value().size(), 6U);
  EXPECT_GT(looks, 1);
}

}  // namespace
}  // namespace slabd::storage
