// SPDX-License-Identifier: Apache-2.0
//
// Rows for the plant's database: in the transaction of their subject, never changed, and kept.
#include "storage/outbox.h"

#include <sqlite3.h>

#include <algorithm>
#include <set>

#include "storage/chain.h"
#include "storage/files/database.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class OutboxTest : public StoreTest {
 protected:
  void SetUp() override {
    open();
    (void)recover();
  }
  [[nodiscard]] std::vector<OutboxRow> rows() const {
    auto outbox = open_outbox(settings_.db_path);
    EXPECT_TRUE(outbox.ok());
    return outbox.value()->rows_after(0, 10'000).value();
  }
  [[nodiscard]] std::vector<std::string> kinds() const {
    std::vector<std::string> list;
    for (const OutboxRow& row : rows()) list.push_back(row.kind);
    return list;
  }
  [[nodiscard]] std::string epoch() const {
    return open_outbox(settings_.db_path).value()->epochs().value().back().uuid;
  }
  void quiet(int looks) {
    for (int i = 0; i < looks; ++i) store_->idle();
  }
  /// True if a statement of another program is refused.
  [[nodiscard]] bool refuses(const std::string& sql) const {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open(settings_.db_path.c_str(), &db), SQLITE_OK);
    const bool refused = sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_CONSTRAINT_TRIGGER ||
                         sqlite3_extended_errcode(db) == SQLITE_CONSTRAINT_TRIGGER;
    sqlite3_close(db);
    return refused;
  }
  void slab(std::int64_t key, Verdict verdict) {
    begin(key);
    scan(key, 1, 1, verdict);
    const std::uint16_t res_seq = end(key, verdict);
    acknowledge(res_seq);
  }
  [[nodiscard]] KeepDisposition decision(std::int64_t key) const {
    KeepDisposition keep;
    keep.record.slab_key = key;
    keep.record.who = "anna";
    keep.record.decision = Disposition::rework;
    keep.record.reason = "burr";
    keep.record.authority = "Li Wei";
    keep.record.utime_us = 5;
    return keep;
  }
};

TEST_F(OutboxTest, each_subject_has_a_row_in_its_own_transaction) {
  begin(1);
  scan(1, 1, 1);
  EXPECT_EQ(kinds(), std::vector<std::string>{}) << "nothing is final yet";
  scan(1, 1, 2, Verdict::fail);
  acknowledge(end(1, Verdict::fail));
  ASSERT_TRUE(store_->change(decision(1)).ok());
  ASSERT_TRUE(
      store_
          ->keep_events({{LineEvent::Kind::started, 0, "slabd 1.0.0", 7}, {LineEvent::Kind::fault, 402, "no scan", 8}})
          .ok());
  EXPECT_EQ(kinds(), (std::vector<std::string>{"remeasured", "slab", "decided", "event", "event"}));
  const std::vector<OutboxRow> list = rows();
  EXPECT_EQ(list[0].about, 1'002);
  EXPECT_EQ(list[1].slab_key, 1);
  EXPECT_EQ(list[3].slab_key, 0);
  auto outbox = open_outbox(settings_.db_path);
  const StoredRow event = outbox.value()->subject(list[4]).value().value();
  EXPECT_EQ(event[1].name, "kind");
  EXPECT_EQ(std::get<std::string>(event[1].value), "fault");
  EXPECT_EQ(std::get<std::int64_t>(event[2].value), 402);
  EXPECT_EQ(outbox.value()->epoch_of_slab(1).value(), epoch());
  EXPECT_EQ(outbox.value()->epoch_of_slab(2).value(), "");
}

TEST_F(OutboxTest, a_master_check_of_a_gauge_is_sent) {
  KeepGaugeCheck keep;
  keep.check.gauge = "length_left";
  keep.check.value = 5600.05;
  keep.check.master_value = 5600.0;
  keep.check.master_u = 0.02;
  keep.check.within = 0.1;
  keep.note = {"anna", "", 7};
  keep.check.source = "plc:40";
  ASSERT_TRUE(store_->change(keep).ok());
  EXPECT_EQ(kinds(), std::vector<std::string>{"gauge_check"});
  const StoredRow row = open_outbox(settings_.db_path).value()->subject(rows()[0]).value().value();
  EXPECT_EQ(row[1].name, "gauge");
  EXPECT_EQ(std::get<std::string>(row[1].value), "length_left");
}

TEST_F(OutboxTest, a_job_that_fails_leaves_no_row) {
  slab(1, Verdict::fail);
  const std::size_t before = rows().size();
  EXPECT_FALSE(store_->change(decision(2)).ok());
  EXPECT_EQ(rows().size(), before);
}

TEST_F(OutboxTest, checksums_do_not_change_when_the_contents_do) {
  slab(1, Verdict::fail);
  const std::vector<OutboxRow> before = rows();
  ASSERT_TRUE(store_->change(decision(1)).ok());
  slab(2, Verdict::pass);
  close();
  open();
  (void)recover();
  const std::vector<OutboxRow> after = rows();
  ASSERT_GT(after.size(), before.size());
  std::set<std::string> different;
  for (const OutboxRow& row : after) different.insert(row.sha256);
  EXPECT_EQ(different.size(), after.size());
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_EQ(after[i].sha256, before[i].sha256);
}

TEST_F(OutboxTest, a_row_of_a_seal_has_its_place_in_the_chain) {
  slab(1, Verdict::pass);
  quiet(10);
  EXPECT_EQ(rows().back().sha256, chain_head(*store_).sha256.view());
}

TEST_F(OutboxTest, other_programs_cannot_change_it) {
  slab(1, Verdict::fail);
  ASSERT_TRUE(store_->keep_events({{LineEvent::Kind::started, 0, "slabd", 7}}).ok());
  close();
  for (const char* sql :
       {"UPDATE outbox SET kind = 'care'", "DELETE FROM outbox", "INSERT OR REPLACE INTO outbox SELECT * FROM outbox",
        "UPDATE epoch SET began_utime_us = 0", "DELETE FROM epoch", "INSERT OR REPLACE INTO epoch SELECT * FROM epoch",
        "UPDATE event SET code = 1", "DELETE FROM event", "INSERT OR REPLACE INTO event SELECT * FROM event"})
    EXPECT_TRUE(refuses(sql)) << sql;
}

TEST_F(OutboxTest, rows_that_arrived_are_noted_and_the_backlog_is_known) {
  slab(1, Verdict::pass);
  slab(2, Verdict::pass);
  quiet(10);
  Backlog behind = store_->care().backlog;
  EXPECT_EQ(behind.epoch, epoch());
  EXPECT_EQ(behind.newest_seq, 2);
  EXPECT_EQ(behind.sent_seq, 0);
  EXPECT_GT(behind.oldest_utime_us, 0);
  EXPECT_EQ(store_->order(SentOrder{std::string(32, '0'), 1}).error().code, Code::config) << "another epoch";
  EXPECT_EQ(store_->order(SentOrder{behind.epoch, 3}).error().code, Code::config) << "that row does not exist";
  EXPECT_EQ(store_->order(SentOrder{behind.epoch, -1}).error().code, Code::config);
  ASSERT_TRUE(store_->order(SentOrder{behind.epoch, 2}).ok());
  ASSERT_TRUE(store_->order(SentOrder{behind.epoch, 1}).ok()) << "late, and without effect";
  quiet(10);
  behind = store_->care().backlog;
  EXPECT_EQ(behind.sent_seq, 2);
  EXPECT_EQ(behind.oldest_utime_us, 0);
  EXPECT_EQ(open_outbox(settings_.db_path).value()->sent_seq().value(), 2);
  EXPECT_EQ(rows().size(), 2U) << "rows stay, to be sent again";
}

TEST_F(OutboxTest, retention_keeps_what_was_not_sent) {
  close();
  settings_.keep_slabs = kKeepSlabsMin;
  settings_.keep_failed_slabs = kKeepSlabsMin;
  settings_.keep_unsent = true;
  open();
  (void)recover();
  constexpr std::int64_t kSlabs = kKeepSlabsMin + 5;
  for (std::int64_t key = 1; key <= kSlabs; ++key) {
    begin(key);
    acknowledge(end(key, Verdict::not_measured));
  }
  quiet(40);
  const auto stored = [&] { return reader()->slabs(1'000).value().size(); };
  EXPECT_EQ(stored(), static_cast<std::size_t>(kSlabs));
  ASSERT_TRUE(store_->order(SentOrder{epoch(), 3}).ok());
  quiet(40);
  EXPECT_EQ(stored(), static_cast<std::size_t>(kSlabs - 3)) << "slabs 1 to 3 were sent";
}

TEST_F(OutboxTest, a_restored_history_goes_on_in_another_epoch) {
  slab(1, Verdict::pass);
  const std::string copy = folder_.path() + "/copy.db";
  close();
  ASSERT_TRUE(back_up_database(settings_.db_path, copy).ok());
  const std::string first = epoch();
  open();
  (void)recover();
  slab(2, Verdict::pass);
  close();
  RestoreOrder order;
  order.from = copy;
  order.note = {"anna", "disk", 9'000'000};
  order.session = 77;
  ASSERT_TRUE(restore_database(settings_, order).ok());
  const auto epochs = open_outbox(settings_.db_path).value()->epochs().value();
  ASSERT_EQ(epochs.size(), 2U);
  EXPECT_EQ(epochs[0].uuid, first);
  EXPECT_NE(epochs[1].uuid, first);
  const std::vector<OutboxRow> list = rows();
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0].epoch, first) << "what was sent before keeps its number and epoch";
  EXPECT_EQ(list[1].kind, "care");
  EXPECT_EQ(list[1].epoch, epochs[1].uuid);
  auto outbox = open_outbox(settings_.db_path);
  const StoredRow care = outbox.value()->subject(list[1]).value().value();
  EXPECT_EQ(std::get<std::string>(care[1].value), "restored");
}

}  // namespace
}  // namespace slabd::storage
