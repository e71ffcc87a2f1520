// SPDX-License-Identifier: Apache-2.0
//
// Decisions of quality: only added, only about slabs that did not pass, and the verdict stays.
#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <set>

#include "storage/files/sqlite.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class DispositionTest : public StoreTest {
 protected:
  void slab(std::int64_t key, std::optional<Verdict> verdict) {
    begin(key);
    if (verdict) end(key, *verdict);
  }
  static KeepDisposition decision(std::int64_t key, Disposition what) {
    DispositionRecord record;
    record.slab_key = key;
    record.utime_us = 1'700'000'000'000'000;
    record.who = "mei";
    record.decision = what;
    record.reason = "burr at block 4";
    record.authority = "Li Wei";
    return {record};
  }
  SlabRecord stored(std::int64_t key) { return *reader()->slab(key).value(); }
  std::string refused(const KeepDisposition& change) {
    const Result<std::string> done = store_->change(change);
    EXPECT_FALSE(done.ok());
    EXPECT_EQ(done.error().code, Code::config);
    return std::string(done.error().text.view());
  }
};

TEST_F(DispositionTest, decisions_are_added_and_the_verdict_stays) {
  open();
  slab(1, Verdict::fail);
  const SlabRecord before = stored(1);
  ASSERT_EQ(store_->change(decision(1, Disposition::hold)).value(), "disposition 1 of slab 1: hold");
  ASSERT_EQ(store_->change(decision(1, Disposition::hold)).value(), "disposition 1 of slab 1: hold")
      << "the same again";
  ASSERT_EQ(store_->change(decision(1, Disposition::scrap)).value(), "disposition 2 of slab 1: scrap");
  const SlabRecord after = stored(1);
  EXPECT_EQ(after.summary.verdict, before.summary.verdict);
  EXPECT_EQ(after.slab.station_verdict, before.slab.station_verdict);
  ASSERT_EQ(after.dispositions.size(), 2U);
  EXPECT_EQ(after.dispositions[0].n, 1);
  EXPECT_EQ(after.dispositions[0].reason, "burr at block 4");
  EXPECT_EQ(after.dispositions[1].decision, Disposition::scrap);
  EXPECT_EQ(after.summary.disposition, Disposition::scrap);
  SlabFilter filter;
  EXPECT_EQ(reader()->slabs(filter).value().at(0).disposition, Disposition::scrap);
  filter.disposition = Disposition::scrap;
  EXPECT_EQ(reader()->slabs(filter).value().size(), 1U);
  filter.disposition = Disposition::hold;
  EXPECT_TRUE(reader()->slabs(filter).value().empty()) << "hold is no longer in force";
  open();
  EXPECT_EQ(recover()->disposition, Disposition::scrap) << "shown to the PLC again";
}

TEST_F(DispositionTest, a_slab_that_passed_or_is_open_has_none) {
  open();
  slab(1, Verdict::pass);
  slab(2, std::nullopt);
  EXPECT_NE(refused(decision(1, Disposition::release_by_concession)).find("slab 1 passed"), std::string::npos);
  EXPECT_NE(refused(decision(2, Disposition::hold)).find("slab 2 is still open"), std::string::npos);
  EXPECT_NE(refused(decision(3, Disposition::hold)).find("slab 3 is not stored"), std::string::npos);
  EXPECT_TRUE(stored(1).dispositions.empty());
}

TEST_F(DispositionTest, needs_its_words) {
  open();
  slab(1, Verdict::fail);
  const auto without = [&](auto&& change) {
    KeepDisposition keep = decision(1, Disposition::rework);
    change(keep.record);
    return refused(keep);
  };
  EXPECT_NE(without([](DispositionRecord& d) { d.reason = " "; }).find("the reason is missing"), std::string::npos);
  EXPECT_NE(without([](DispositionRecord& d) { d.authority = ""; }).find("the authority is missing"),
            std::string::npos);
  EXPECT_NE(without([](DispositionRecord& d) { d.who = ""; }).find("person"), std::string::npos);
  EXPECT_NE(without([](DispositionRecord& d) { d.reason = "a\nb"; }).find("control character"), std::string::npos);
  EXPECT_NE(without([](DispositionRecord& d) { d.reason = std::string(500, 'x'); }).find("500 bytes"),
            std::string::npos);
  EXPECT_NE(without([](DispositionRecord& d) { d.decision = Disposition::none; }).find("allowed decisions"),
            std::string::npos);
  for (const char* same : {"Li Wei", "li  wei", " LI WEI "})
    EXPECT_NE(without([&](DispositionRecord& d) { d.second = same; }).find("two persons"), std::string::npos) << same;
  EXPECT_NE(without([](DispositionRecord& d) { d.reason = "\u200B"; }).find("visible text"), std::string::npos);
}

TEST_F(DispositionTest, two_persons_if_the_configuration_asks_for_them) {
  settings_.second_person = true;
  open();
  slab(1, Verdict::indeterminate);
  KeepDisposition keep = decision(1, Disposition::release_by_concession);
  EXPECT_NE(refused(keep).find("the second person is missing"), std::string::npos);
  keep.record.second = "Wang Fang";
  EXPECT_TRUE(store_->change(keep).ok());
  EXPECT_EQ(stored(1).dispositions.at(0).second, "Wang Fang");
}

TEST_F(DispositionTest, a_pin_is_written_for_a_person_who_may_not_write_next_to_the_scans) {
  open();
  slab(1, Verdict::fail);
  const std::string folder = settings_.spool_dir + "/1";
  const auto refusal = [&](const KeepPin& pin) {
    const Result<std::string> done = store_->change(pin);
    EXPECT_FALSE(done.ok());
    return std::string(done.error().text.view());
  };
  EXPECT_NE(refusal({1, "{}"}).find("its scans are gone"), std::string::npos);
  EXPECT_NE(refusal({-1, "{}"}).find("its scans are gone"), std::string::npos);
  std::filesystem::create_directories(folder);
  ASSERT_EQ(store_->change(KeepPin{1, "{\"reason\": \"complaint 17\"}"}).value(), "pinned slab 1");
  std::ifstream pin(folder + "/pin.json");
  std::string text;
  std::getline(pin, text);
  EXPECT_EQ(text, "{\"reason\": \"complaint 17\"}");
  EXPECT_NE(refusal({1, std::string(9'000, 'x')}).find("9000 bytes"), std::string::npos);
  ASSERT_EQ(store_->change(KeepPin{1, ""}).value(), "unpinned slab 1");
  EXPECT_FALSE(std::filesystem::exists(folder + "/pin.json"));
  EXPECT_NE(refusal({1, ""}).find("is not pinned"), std::string::npos);
}

TEST_F(DispositionTest, no_other_program_changes_or_deletes_one) {
  open();
  slab(1, Verdict::fail);
  slab(2, Verdict::pass);
  ASSERT_TRUE(store_->change(decision(1, Disposition::hold)).ok());
  close();
  const auto runs = [&](const char* sql) {
    try {
      Connection db(settings_.db_path, SQLITE_OPEN_READWRITE);
      db.execute(sql);
      return true;
    } catch (const SqlFailure&) {
      return false;
    }
  };
  for (const char* sql : {"UPDATE disposition SET decision = 'scrap'", "DELETE FROM disposition",
                          "INSERT INTO disposition VALUES (2, 1, 0, 'x', 'release_by_concession', 'x', 'x', '')",
                          "INSERT INTO disposition VALUES (1, 2, 0, 'x', 'pass', 'x', 'x', '')",
                          "INSERT INTO disposition VALUES (1, 2, 0, 'x', 'hold', '', 'x', '')",
                          "INSERT OR REPLACE INTO disposition VALUES (1, 1, 0, 'x', 'scrap', 'x', 'x', '')"})
    EXPECT_FALSE(runs(sql)) << sql;
  EXPECT_EQ(stored(1).dispositions.size(), 1U);
}

// INSERT OR REPLACE runs no trigger of DELETE, so a table whose rows stay needs one of INSERT too.
TEST_F(DispositionTest, every_table_whose_rows_stay_refuses_to_replace_one) {
  open();
  close();
  Connection db(settings_.db_path, SQLITE_OPEN_READONLY);
  const auto triggers = [&](const char* ending) {
    std::set<std::string> tables;
    Statement rows(db, "SELECT tbl_name FROM sqlite_schema WHERE type = 'trigger' AND name = tbl_name || ?1");
    for (rows.bind(1, std::string_view(ending)); rows.step();) tables.emplace(rows.text(0));
    return tables;
  };
  EXPECT_EQ(triggers("_is_new"), triggers("_is_kept"));
  EXPECT_EQ(triggers("_is_kept").size(), 12U);
}

}  // namespace
}  // namespace slabd::storage
