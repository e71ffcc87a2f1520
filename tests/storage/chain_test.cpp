// SPDX-License-Identifier: Apache-2.0
//
// Changes made without slabd are found and reported; slabd's own operations keep the chain intact.
#include "storage/chain.h"

#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "storage/files/database.h"
#include "storage/jobs.h"
#include "storage/seals.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

/// A connection without slabd's settings: a person with sqlite3.
class Person {
 public:
  explicit Person(const std::string& path) { EXPECT_EQ(sqlite3_open(path.c_str(), &db_), SQLITE_OK); }
  ~Person() { EXPECT_EQ(sqlite3_close(db_), SQLITE_OK); }
  Person(const Person&) = delete;
  Person& operator=(const Person&) = delete;
  /// Returns false if the database rejects the statement.
  bool tries(const std::string& sql) { return sqlite3_exec(db_, sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK; }
  void does(const std::string& sql) { EXPECT_TRUE(tries(sql)) << sqlite3_errmsg(db_) << " " << sql; }

 private:
  sqlite3* db_ = nullptr;
};

std::string hex(const Sha256& sum) {
  std::string text;
  for (const std::uint8_t byte : sum) {
    std::array<char, 3> two{};
    std::snprintf(two.data(), two.size(), "%02x", byte);
    text += two.data();
  }
  return text;
}

class ChainTest : public StoreTest {
 protected:
  ChainTest() {
    // In memory if possible, because these tests do not depend on the disk.
    settings_.db_path = fast_.path() + "/db/slabd.db";
    settings_.spool_dir = fast_.path() + "/spool";
    settings_.spool_free_bytes_min = 1;
  }

  void start() {
    open();
    (void)recover();
  }
  /// Creates a slab with rows in all tables: a failed and a measured attempt, findings, maps, a repeated record.
  void slab(std::int64_t key, Verdict verdict = Verdict::pass) {
    begin(key, static_cast<std::uint32_t>(100 + key));
    accept(PlcCommand::scan, 2, key);
    apply(FailedAttemptJob{attempt(key, 2, 1), 303, 0});
    accept(PlcCommand::scan, 2, key);
    apply(AcquiredJob{attempt(key, 2, 2)});
    PlcResult record = random_record(prng_, ++res_seq_, 1);
    record.station = 2;
    record.cmd_seq = cmd_seq_;
    BlockResult block = random_block(prng_, 2, verdict);
    if (block.findings.empty()) (void)block.findings.push(SurfaceFinding{});
    if (block.edges.empty()) (void)block.edges.push(EdgeFeature{});
    apply(BlockJob{key, 2, block, record, random_maps(prng_)});
    acknowledge(end(key, verdict));
  }
  void empty_slabs(std::int64_t first, std::int64_t last) {
    for (std::int64_t key = first; key <= last; ++key) {
      begin(key);
      acknowledge(end(key, Verdict::pass));
    }
  }
  void quiet(int looks) {
    for (int i = 0; i < looks; ++i) store_->idle();
  }
  [[nodiscard]] ChainReport report(const std::string& path = {}, std::int64_t entry = 0) const {
    const Result<ChainReport> chain = check_chain(path.empty() ? settings_.db_path : path, entry);
    EXPECT_TRUE(chain.ok()) << chain.error().text.view();
    return chain.ok() ? chain.value() : ChainReport{};
  }
  [[nodiscard]] std::string trouble() const { return report().trouble; }
  /// Creates slabs 1 to 3 and a complete copy after slabd has stopped.
  void three_slabs() {
    start();
    for (std::int64_t key = 1; key <= 3; ++key) slab(key, key == 2 ? Verdict::fail : Verdict::pass);
    close();
    fs::copy_file(settings_.db_path, whole_);
    fs::remove(settings_.db_path + "-wal");
    fs::remove(settings_.db_path + "-shm");
  }
  /// Result of the check after a person's change of the database of three_slabs().
  std::string after(const std::string& sql) {
    fs::copy_file(whole_, settings_.db_path, fs::copy_options::overwrite_existing);
    Person(settings_.db_path).does("PRAGMA ignore_check_constraints = ON; " + sql);
    return trouble();
  }

  TemporaryFolder fast_{"/dev/shm"};
  std::string whole_ = fast_.path() + "/whole.db";
};

std::vector<std::string> split(std::string_view names) {
  std::vector<std::string> list;
  for (std::size_t at = 0; at < names.size();) {
    const std::size_t end = std::min(names.find(", ", at), names.size());
    list.emplace_back(names.substr(at, end - at));
    at = end + 2;
  }
  return list;
}

TEST_F(ChainTest, every_column_of_every_table_of_a_slab_is_sealed) {
  three_slabs();
  ASSERT_EQ(trouble(), "");
  int columns = 0;
  for (const SealedTable& table : sealed_tables(kSealForm)) {
    const std::string name(table.name);
    for (const std::string& column : split(table.columns)) {
      if (column == "slab_key") continue;
      ++columns;

      const std::string changed =
          "CASE typeof(" + column + ") WHEN 'text' THEN " + column + " || '.' WHEN 'blob' THEN " + "zeroblob(length(" +
          column + ")) WHEN 'integer' THEN " + column + " + 1000 WHEN 'real' THEN coalesce(nullif(" + column +
          " * (1.0 + 1e-15), " + column + "), " + column +
          " + 1.0) ELSE (SELECT CASE type WHEN 'REAL' THEN 0.5 WHEN 'TEXT' " +
          "THEN '' ELSE 1 END FROM pragma_table_info('" + name + "') WHERE name = '" + column + "') END";
      const std::string said = after("UPDATE " + name + " SET " + column + " = " + changed + " WHERE slab_key = 2" +
                                     std::string(table.where));
      EXPECT_NE(said.find("slab key 2 (number 102"), std::string::npos) << name << "." << column << ": " << said;
      EXPECT_NE(said.find("was altered: table " + name), std::string::npos) << name << "." << column << ": " << said;
    }
  }
  EXPECT_GT(columns, 300);
}

TEST_F(ChainTest, columns_that_are_not_sealed_are_those_that_change_after_the_end) {
  three_slabs();
  Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
  ASSERT_TRUE(db.ok());
  std::set<std::string> left;
  for (const SealedTable& table : sealed_tables(kSealForm)) {
    Statement names(*db.value(), "SELECT name FROM pragma_table_info('" + std::string(table.name) + "')");
    const std::vector<std::string> sealed = split(table.columns);
    while (names.step())
      if (std::find(sealed.begin(), sealed.end(), names.text(0)) == sealed.end())
        left.insert(std::string(table.name) + "." + std::string(names.text(0)));
  }
  EXPECT_EQ(left, (std::set<std::string>{"attempt.measuring_since_ns", "attempt.scan_state", "result.acknowledged"}));
  // All tables with a slab's rows are sealed, except the journal of commands and data across slabs.
  Statement tables(*db.value(),
                   "SELECT m.name FROM sqlite_schema AS m WHERE m.type = 'table' AND EXISTS (SELECT 1 FROM "
                   "pragma_table_info(m.name) WHERE name = 'slab_key') ORDER BY m.name");
  std::set<std::string> unsealed;
  while (tables.step()) {
    const std::string name(tables.text(0));
    bool found = false;
    for (const SealedTable& table : sealed_tables(kSealForm)) found = found || table.name == name;
    if (!found) unsealed.insert(name);
  }
  EXPECT_EQ(unsealed, (std::set<std::string>{"care", "command", "disposition", "noise_print", "outbox"}))
      << "care has entries of its own; decisions come after the end; the outbox has the entries of the chain";
}

TEST_F(ChainTest, rows_that_are_taken_away_or_put_in_are_found) {
  three_slabs();
  for (const char* table : {"item", "finding", "edge", "plane", "casing", "map", "station_result", "slab_result",
                            "attempt", "block", "slab_arm"}) {
    const std::string said = after(std::string("DELETE FROM ") + table + " WHERE slab_key = 3");
    EXPECT_NE(said.find("slab key 3 (number 103"), std::string::npos) << table << ": " << said;
    EXPECT_NE(said.find(table), std::string::npos) << said;
  }
  EXPECT_NE(after("DELETE FROM result WHERE slab_key = 1 AND kind = 2").find("slab key 1 "), std::string::npos);
  EXPECT_NE(after("INSERT INTO station_result VALUES (1, 18, 'pass', 0) ON CONFLICT DO UPDATE SET verdict = 'pas'")
                .find("table station_result"),
            std::string::npos);
  EXPECT_NE(after("INSERT INTO finding (slab_key, station, attempt, position, kind, face) "
                  "VALUES (1, 2, 2, 77, 'pit', 'seat')")
                .find("table finding"),
            std::string::npos);
}

TEST_F(ChainTest, a_verdict_that_was_turned_in_all_its_places_is_found) {
  three_slabs();
  const std::string said = after(
      "UPDATE slab_result SET verdict = 'pass', reason = 0 WHERE slab_key = 2; UPDATE station_result SET verdict = "
      "'pass', reason = 0 WHERE slab_key = 2; UPDATE result SET verdict = 'pass', reason = 0, fail_mask = 0 WHERE "
      "slab_key = 2");
  EXPECT_NE(said.find("slab key 2 (number 102"), std::string::npos) << said;
  EXPECT_NE(said.find("slab_result, station_result"), std::string::npos) << said;
  EXPECT_NE(said.find("result"), std::string::npos) << said;
}

TEST_F(ChainTest, the_first_altered_slab_is_named_and_the_others_are_counted) {
  three_slabs();
  EXPECT_NE(after("UPDATE item SET value = 1.0 WHERE slab_key IN (3, 2)").find("slab key 2 "), std::string::npos);
  EXPECT_EQ(report().altered, 2);
  EXPECT_EQ(report().sealed, 3);
}

TEST_F(ChainTest, a_deleted_slab_is_named) {
  three_slabs();
  std::string all;
  for (const char* table : {"item", "map", "finding", "edge", "casing", "plane", "block", "attempt", "result",
                            "command", "station_result", "slab_result", "slab_arm", "slab"})
    all += std::string("DELETE FROM ") + table + " WHERE slab_key = 2; ";
  const std::string said = after(all);
  EXPECT_NE(said.find("slab key 2 (number 102"), std::string::npos) << said;
  EXPECT_NE(said.find("was deleted"), std::string::npos) << said;
}

TEST_F(ChainTest, an_added_slab_is_named) {
  three_slabs();
  const std::string copy =
      "CREATE TEMP TABLE s AS SELECT * FROM slab WHERE slab_key = 1; UPDATE s SET slab_key = 9; "
      "INSERT INTO slab SELECT * FROM s; CREATE TEMP TABLE r AS SELECT * FROM slab_result WHERE slab_key = 1; "
      "UPDATE r SET slab_key = 9; INSERT INTO slab_result SELECT * FROM r";
  const std::string said = after(copy);
  EXPECT_NE(said.find("slab key 9 (number 101"), std::string::npos) << said;
  EXPECT_NE(said.find("it was added, or its seal was deleted"), std::string::npos) << said;
  const std::string open = after(
      "CREATE TEMP TABLE s AS SELECT * FROM slab WHERE slab_key IN (1, 3); UPDATE s SET slab_key = 6 + slab_key; "
      "INSERT INTO slab SELECT * FROM s");
  EXPECT_NE(open.find("slab key 7 "), std::string::npos) << open;
}

TEST_F(ChainTest, the_database_itself_refuses_to_change_a_seal) {
  three_slabs();
  Person person(settings_.db_path);
  EXPECT_FALSE(person.tries("UPDATE slab_seal SET rows_sha256 = zeroblob(32) WHERE about = 2"));
  EXPECT_FALSE(person.tries("DELETE FROM slab_seal WHERE about = 2"));
  EXPECT_EQ(trouble(), "");
}

TEST_F(ChainTest, an_altered_seal_is_named) {
  three_slabs();
  const std::string open = "DROP TRIGGER slab_seal_stays; DROP TRIGGER slab_seal_is_kept; ";
  for (const char* change :
       {"rows_sha256 = zeroblob(32)", "sha256 = zeroblob(32)", "slab_no = 5", "slab_id = 'x'", "utime_us = 7",
        "form = 1", "rows_sha256 = zeroblob(31)", "tables = zeroblob(length(tables))"}) {
    const std::string said = after(open + "UPDATE slab_seal SET " + change + " WHERE about = 2 AND kind = 'slab'");
    EXPECT_NE(said.find("the seal of slab key 2 "), std::string::npos) << change << ": " << said;
    EXPECT_NE(said.find("was altered"), std::string::npos) << change << ": " << said;
  }
  EXPECT_NE(after(open + "UPDATE slab_seal SET kind = 'pruned' WHERE about = 2 AND kind = 'slab'").find("slab key 2 "),
            std::string::npos);
  EXPECT_NE(after(open + "DELETE FROM slab_seal WHERE about = 2 AND kind = 'slab'").find("of the chain are missing"),
            std::string::npos);
  EXPECT_NE(after(open + "DELETE FROM slab_seal WHERE about = 3 AND kind = 'slab'").find("slab key 3 (number 103"),
            std::string::npos)
      << "the newest seal leaves no gap, but a slab without a seal";
  EXPECT_NE(after(open + "DELETE FROM slab_seal WHERE seq = 1").find("of the chain are missing"), std::string::npos);
}

TEST_F(ChainTest, a_row_and_its_seal_changed_together_break_the_chain_behind_them) {
  three_slabs();
  // The seal of the altered rows is recomputed, as a person with that knowledge could do, but not the rest of the
  // chain.
  ASSERT_NE(after("UPDATE slab_result SET verdict = 'pass' WHERE slab_key = 2"), "");
  Result<std::unique_ptr<Connection>> db = open_any_version(settings_.db_path);
  ASSERT_TRUE(db.ok());
  const std::string rows = hex(digest_of(SlabDigests(*db.value(), kSealForm).of(2)));
  db.value().reset();
  Person(settings_.db_path)
      .does("DROP TRIGGER slab_seal_stays; UPDATE slab_seal SET tables = x'', rows_sha256 = x'" + rows +
            "' WHERE about = 2 AND kind = 'slab'");
  EXPECT_NE(trouble().find("the seal of slab key 2 "), std::string::npos) << trouble();
}

TEST_F(ChainTest, a_seal_of_the_first_form_is_still_checked) {
  three_slabs();
  // The newest seal, as a program before the second form made it: without the robots and scanners.
  Result<std::unique_ptr<Connection>> db = open_any_version(settings_.db_path);
  ASSERT_TRUE(db.ok());
  const std::vector<Sha256> tables = SlabDigests(*db.value(), 1).of(3);
  ASSERT_EQ(tables.size() + 1, sealed_tables(kSealForm).size()) << "slab_arm";
  SealEntry entry;
  Sha256 before{};
  {
    // Its end lets go of the database.
    Statement row(*db.value(),
                  "SELECT s.seq, s.about, s.slab_no, s.slab_id, s.utime_us, before.sha256 FROM slab_seal AS s JOIN "
                  "slab_seal AS before ON before.seq = s.seq - 1 WHERE s.about = 3 AND s.kind = 'slab'");
    ASSERT_TRUE(row.step());
    entry.seq = row.integer(0);
    entry.kind = "slab";
    entry.form = 1;
    entry.about = row.integer(1);
    entry.slab_no = row.integer(2);
    entry.slab_id = row.stored_text(3);
    entry.utime_us = row.integer(4);
    entry.rows = digest_of(tables);
    std::copy(row.bytes(5).begin(), row.bytes(5).end(), before.begin());
  }
  ASSERT_EQ(entry.seq, db.value()->integer("SELECT max(seq) FROM slab_seal")) << "no later entry depends on it";
  db.value().reset();
  std::string digests;
  for (const Sha256& table : tables) digests += hex(table);
  const std::string first_form = "DROP TRIGGER slab_seal_stays; UPDATE slab_seal SET form = 1, rows_sha256 = x'" +
                                 hex(entry.rows) + "', sha256 = x'" + hex(seal_of(before, entry)) + "', tables = x'" +
                                 digests + "' WHERE seq = " + std::to_string(entry.seq) + "; ";
  EXPECT_EQ(after(first_form), "");
  EXPECT_NE(after(first_form + "UPDATE attempt SET scan_points = 1 WHERE slab_key = 3").find("table attempt"),
            std::string::npos);
  EXPECT_EQ(after(first_form + "UPDATE attempt SET robot = 'x' WHERE slab_key = 3"), "")
      << "the first form has no such column";
  EXPECT_NE(after(first_form + "UPDATE attempt SET robot = 'x' WHERE slab_key = 2").find("table attempt"),
            std::string::npos);
}

TEST_F(ChainTest, decisions_about_slabs_are_sealed) {
  start();
  slab(1);
  slab(2, Verdict::fail);
  slab(3, Verdict::indeterminate);
  DispositionRecord decision;
  decision.slab_key = 2;
  decision.utime_us = 1'700'000'000'000'000;
  decision.who = decision.authority = "mei";
  decision.reason = "burr at block 4";
  for (const Disposition what : {Disposition::hold, Disposition::hold, Disposition::scrap}) {
    decision.decision = what;
    ASSERT_TRUE(store_->change(KeepDisposition{decision}).ok());
  }
  close();
  fs::copy_file(settings_.db_path, whole_);
  EXPECT_EQ(trouble(), "");
  EXPECT_EQ(report().entries, 1 + 3 + 2) << "the same decision again adds nothing";
  const std::string open = "DROP TRIGGER disposition_stays; DROP TRIGGER disposition_is_kept; ";
  const std::string altered = "the decisions about slab key 2 (number 102";
  for (const char* change :
       {"UPDATE disposition SET decision = 'release_by_concession' WHERE n = 2", "DELETE FROM disposition WHERE n = 2",
        "DELETE FROM disposition", "UPDATE disposition SET authority = 'li' WHERE n = 1",
        "INSERT INTO disposition VALUES (2, 3, 1, 'a', 'rework', 'b', 'c', '')"})
    EXPECT_NE(after(open + change).find(altered), std::string::npos) << change << ": " << trouble();
  EXPECT_NE(after("INSERT INTO disposition VALUES (3, 1, 1, 'a', 'rework', 'b', 'c', '')")
                .find("a decision about slab key 3 was added"),
            std::string::npos);
  EXPECT_NE(after("DROP TRIGGER slab_seal_is_kept; DELETE FROM slab_seal WHERE seq = 6").find(altered),
            std::string::npos);
  EXPECT_EQ(after("SELECT 1"), "");
}

TEST_F(ChainTest, legitimate_changes_after_the_end_do_not_alter_the_chain) {
  settings_.spool_budget_bytes = 1;
  start();
  begin(1);
  accept(PlcCommand::scan, 1, 1);
  Attempt with_scan = attempt(1, 1, 1);
  with_scan.scan_path.assign(scan_file(1, 1, 1, 5'000));
  apply(AcquiredJob{with_scan});
  acknowledge(measure(1, 1, 1));
  const std::uint16_t last = end(1, Verdict::fail);
  EXPECT_EQ(trouble(), "") << "nothing is acknowledged yet";
  acknowledge(last);
  accept(PlcCommand::report, 0, 1);
  apply(ReportJob{random_record(prng_, ++res_seq_, 2)});
  acknowledge(res_seq_);
  apply(MeasuringJob{1, 1, 1, 77});
  quiet(10);
  EXPECT_FALSE(fs::exists(with_scan.scan_path.c_str())) << "its scan was deleted for the budget";
  EXPECT_EQ(trouble(), "");
  EXPECT_EQ(report().sealed, 1);
}

TEST_F(ChainTest, fifty_random_slabs_stay_whole_after_restarts_pruning_a_backup_and_a_restore) {
  start();
  const std::array verdicts = {Verdict::pass, Verdict::fail, Verdict::indeterminate, Verdict::aborted};
  for (std::int64_t key = 1; key <= 50; ++key) {
    slab(key, verdicts[prng_.below(verdicts.size())]);
    if (key % 10 == 0) start();
  }
  EXPECT_EQ(trouble(), "");
  EXPECT_EQ(report().sealed, 50);
  const ChainHead witnessed = chain_head(*store_);
  EXPECT_EQ(witnessed.entries, 51) << "and the beginning";
  EXPECT_EQ(report().head, witnessed.sha256.view());
  // Some hundred more: older slabs are pruned, as far as their random scans are gone.
  empty_slabs(51, 145);
  ASSERT_TRUE(store_->order(PruneOrder{kKeepSlabsMin, kKeepSlabsMin}).ok());
  quiet(60);
  ASSERT_GT(store_->care().pruned_slabs, 3);
  const ChainReport pruned = report();
  EXPECT_EQ(pruned.trouble, "");
  EXPECT_EQ(pruned.pruned, store_->care().pruned_slabs);
  EXPECT_EQ(pruned.sealed, 145 - pruned.pruned);
  EXPECT_EQ(report({}, witnessed.entries).asked, witnessed.sha256.view()) << "a head that was noted is found again";
  EXPECT_EQ(chain_head(*store_).sha256.view(), pruned.head);
  // The running daemon's own backup.
  const std::string backup = fast_.path() + "/backup.db";
  ASSERT_TRUE(store_->order(BackupOrder{backup}).ok());
  quiet(200);
  ASSERT_EQ(store_->care().backup, CareState::Phase::done) << store_->care().backup_error;
  EXPECT_EQ(report(backup).trouble, "");
  EXPECT_EQ(report(backup).head, pruned.head);
  slab(146);
  close();
  ASSERT_TRUE(restore_database(settings_, {backup, {"anna", "disk", 1'700'000'000'000'000}, 4711}).ok());
  start();
  slab(147);
  const ChainReport restored = report();
  EXPECT_EQ(restored.trouble, "");
  EXPECT_EQ(restored.sealed, pruned.sealed + 1);
  EXPECT_EQ(report({}, pruned.entries).asked, pruned.head) << "it goes on from the backup's";
}

TEST_F(ChainTest, a_slab_that_a_restore_ends_is_sealed) {
  start();
  slab(1);
  begin(2);
  close();
  const std::string backup = fast_.path() + "/backup.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, backup).ok());
  ASSERT_TRUE(restore_database(settings_, {backup, {"anna", "disk", 1'700'000'000'000'000}, 4711}).ok());
  EXPECT_EQ(trouble(), "");
  EXPECT_EQ(report().sealed, 2);
  Person(settings_.db_path).does("DROP TRIGGER care_stays; UPDATE care SET why = 'no reason'");
  EXPECT_NE(trouble().find("gap 1 of the history was altered"), std::string::npos) << trouble();
}

TEST_F(ChainTest, a_history_that_is_started_again_begins_a_chain) {
  start();
  slab(1);
  close();
  ASSERT_TRUE(restore_database(settings_, {"", {"anna", "disk", 1'700'000'000'000'000}, 4711}).ok());
  start();
  slab(2);
  const ChainReport anew = report();
  EXPECT_EQ(anew.trouble, "");
  EXPECT_EQ(anew.sealed, 1);
  EXPECT_EQ(anew.entries, 3) << "the beginning, the gap, the slab";
}

TEST_F(ChainTest, an_altered_backup_is_restored_only_with_an_explicit_option) {
  three_slabs();
  ASSERT_NE(after("UPDATE item SET value = 1.0 WHERE slab_key = 2"), "");
  const std::string backup = fast_.path() + "/backup.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, backup).ok());
  RestoreOrder order{backup, {"anna", "disk", 1'700'000'000'000'000}, 4711};
  const Status refused = restore_database(settings_, order);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, Code::config);
  EXPECT_NE(refused.error().text.view().find("was altered before it was backed up: slab key 2"), std::string_view::npos)
      << refused.error().text.view();
  order.accept_unproven = true;
  EXPECT_TRUE(restore_database(settings_, order).ok());
}

TEST_F(ChainTest, slabs_from_before_the_chain_are_unsealed_and_not_broken) {
  three_slabs();
  // The whole chain is deleted; it begins again at the next start.
  ASSERT_EQ(after("DROP TRIGGER slab_seal_is_kept; DELETE FROM slab_seal"), "");
  EXPECT_EQ(report().unsealed, 3);
  EXPECT_EQ(report().entries, 0);
  Person(settings_.db_path)
      .does("CREATE TRIGGER slab_seal_is_kept BEFORE DELETE ON slab_seal BEGIN SELECT RAISE(ABORT, 'never'); END");
  start();
  slab(4);
  EXPECT_EQ(trouble(), "");
  EXPECT_EQ(report().unsealed, 3);
  EXPECT_EQ(report().sealed, 1);
}

TEST_F(ChainTest, an_end_that_was_taken_back_and_given_again_is_whole) {
  start();
  slab(1);
  begin(2);
  (void)scan(2, 1, 1);
  (void)end(2, Verdict::pass);
  close();
  {
    // Same operation as the store's for an end that returned an error.
    Result<std::unique_ptr<Connection>> db = open_for_writing(settings_.db_path);
    ASSERT_TRUE(db.ok());
    const HeldBack nothing;
    Jobs jobs(*db.value(), settings_, nothing);
    Transaction transaction(*db.value(), "BEGIN IMMEDIATE");
    jobs.undo_end(2);
    transaction.commit();
  }
  EXPECT_EQ(trouble(), "");
  EXPECT_EQ(report().sealed, 1);
  start();
  (void)end(2, Verdict::fail);
  EXPECT_EQ(trouble(), "");
  EXPECT_EQ(report().sealed, 2);
}

TEST_F(ChainTest, an_altered_recipe_text_is_named) {
  const std::string text = "slope = 1\n";
  Digest digest;
  digest.bytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  RecipeText recipe;
  recipe.sha256.assign(hex(digest.take()));
  recipe.name.assign("p5600");
  recipe.text = text;
  settings_.recipe_texts = {recipe};
  start();
  SlabHeader header = random_header(prng_, 1);
  header.recipe_sha256 = recipe.sha256;
  apply(BeginSlabJob{header, session_, ++cmd_seq_});
  close();
  EXPECT_EQ(trouble(), "");
  Person(settings_.db_path)
      .does("DROP TRIGGER recipe_text_stays; UPDATE recipe_text SET text = replace(text, '1', '2')");
  EXPECT_NE(trouble().find("recipe p5600 "), std::string::npos) << trouble();
}

TEST_F(ChainTest, an_altered_calibration_is_named) {
  start();
  CalibrationRecord record;
  HandEyeNumbers numbers;
  numbers.T_flange_scanner.translation_mm = Vec3(1.0, 2.0, 150.25);
  numbers.sigma_mm = 0.02;
  numbers.sigma_rad = 1e-5;
  record.numbers = numbers;
  record.figures = "{}";
  record.operator_name = "anna";
  ASSERT_TRUE(store_->change(KeepCalibration{record}).ok());
  close();
  EXPECT_EQ(trouble(), "");
  Person(settings_.db_path).does("UPDATE hand_eye SET T_flange_scanner_z = 151.25");
  EXPECT_NE(trouble().find("calibration he-"), std::string::npos) << trouble();
}

TEST_F(ChainTest, control_characters_of_an_altered_database_do_not_reach_the_report) {
  three_slabs();
  const std::string said =
      after("DROP TRIGGER slab_seal_stays; UPDATE slab_seal SET slab_id = char(27) || ']0;x' WHERE about = 2");
  EXPECT_NE(said, "");
  EXPECT_EQ(said.find('\x1b'), std::string::npos);
}

}  // namespace
}  // namespace slabd::storage
