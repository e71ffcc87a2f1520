// SPDX-License-Identifier: Apache-2.0
//
// Power cuts, kills and failing calls at every point of the store's life, with the product's own settings. A life is a
// list of steps. After each step that was reported as done, the content of the database is known (a hash of every row
// of every table). After any failure the database must be intact and have the content of the last reported step, or of
// the one in progress. Nothing may be lost or half done.
//
// The default run covers some hundred images and points. SLABD_SURVIVAL_IMAGES, _POINTS and _SEED set more
// (script/survival).
#include <signal.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>

#include "storage/chain.h"
#include "storage/files/database.h"
#include "storage/files/quarantine.h"
#include "tests/storage/crash_disk.h"
#include "tests/storage/fast_store.h"
#include "tests/storage/next_versions.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

std::uint64_t number_from(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

/// Rows of the outbox that are not there exactly once for an entry of the chain, and the reverse.
std::int64_t outbox_faults(Connection& db) {
  const std::string sent = "kind IN ('slab', 'reopened', 'decided', 'care')";
  return db.integer("SELECT count(*) FROM slab_seal WHERE " + sent +
                    " AND (SELECT count(*) FROM outbox WHERE outbox.about = slab_seal.seq AND outbox.kind = "
                    "slab_seal.kind) <> 1") +
         db.integer("SELECT count(*) FROM outbox WHERE " + sent +
                    " AND NOT EXISTS (SELECT 1 FROM slab_seal WHERE slab_seal.seq = outbox.about AND slab_seal.kind = "
                    "outbox.kind)");
}

/// FNV-1a over every value of every row, in the order of the keys. Without the chain of results and the outbox, which
/// also contain reverted ends, and without the epoch, which is random.
std::uint64_t content_of(Connection& db) {
  EXPECT_EQ(outbox_faults(db), 0);
  std::uint64_t hash = 14695981039346656037ULL;
  const auto add = [&](const void* bytes, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i)
      hash = (hash ^ static_cast<const unsigned char*>(bytes)[i]) * 1099511628211ULL;
  };
  std::vector<std::string> tables;
  Statement names(db,
                  "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT IN ('slab_seal', 'outbox', "
                  "'epoch') ORDER BY name");
  while (names.step()) tables.emplace_back(names.text(0));
  for (const std::string& table : tables) {
    add(table.data(), table.size());
    sqlite3_stmt* rows = nullptr;
    if (sqlite3_prepare_v2(db.handle(), ("SELECT * FROM \"" + table + "\"").c_str(), -1, &rows, nullptr) != SQLITE_OK)
      throw SqlFailure{SQLITE_ERROR, sqlite3_errmsg(db.handle())};
    int result = sqlite3_step(rows);
    for (; result == SQLITE_ROW; result = sqlite3_step(rows)) {
      for (int column = 0; column < sqlite3_column_count(rows); ++column) {
        const int type = sqlite3_column_type(rows, column);
        add(&type, sizeof type);
        if (type == SQLITE_INTEGER) {
          const sqlite3_int64 value = sqlite3_column_int64(rows, column);
          add(&value, sizeof value);
        } else if (type == SQLITE_FLOAT) {
          const double value = sqlite3_column_double(rows, column);
          add(&value, sizeof value);
        } else if (type != SQLITE_NULL) {
          const void* bytes = sqlite3_column_blob(rows, column);
          add(bytes, static_cast<std::size_t>(sqlite3_column_bytes(rows, column)));
        }
      }
    }
    sqlite3_finalize(rows);
    if (result != SQLITE_DONE) throw SqlFailure{result, sqlite3_errmsg(db.handle())};
  }
  return hash;
}

class SurvivalTest : public FastStoreTest {
 protected:
  /// A step returns false if it failed; then it is repeated, as the line would.
  using Step = std::function<bool()>;

  SurvivalTest() : seed_(number_from("SLABD_SURVIVAL_SEED", 1)), prng_of_cuts_(seed_) {}

  /// All jobs are created before the life begins, so that every life of a seed is the same.
  void make_life(int slabs, int stations) {
    steps_.clear();
    steps_.push_back([this] {
      store_.reset();  // as the daemon does if the database cannot be read at its start
      Result<std::unique_ptr<Store>> store = open_store(settings_);
      if (!store.ok()) return false;
      store_ = std::move(store.value());
      return store_->recover().ok();
    });
    job(SessionJob{7});
    for (int slab = 1; slab <= slabs; ++slab) {
      const std::int64_t key = slab;
      SlabHeader header = random_header(prng_, key);
      job(BeginSlabJob{header, session_, ++cmd_seq_});
      for (int station = 1; station <= stations; ++station) {
        ++cmd_seq_;
        job(CommandJob{session_, cmd_seq_, static_cast<std::uint16_t>(PlcCommand::scan),
                       static_cast<std::uint8_t>(station), key, 1000});
        Attempt a = random_attempt(prng_, key, station, 1);
        a.session = session_;
        a.cmd_seq = cmd_seq_;
        // The times of a slab are consecutive. A time far ahead counts only after a second one in the same run, and a
        // failing call may separate them.
        a.scan_utime_us = header.began_utime_us + 1'000'000 * station;
        job(AcquiredJob{a});
        PlcResult record = random_record(prng_, ++res_seq_, 1);
        record.station = static_cast<std::uint16_t>(station);
        record.cmd_seq = cmd_seq_;
        record.scan_utime_us = a.scan_utime_us;
        job(BlockJob{key, 1, random_block(prng_, station, Verdict::pass), record, random_maps(prng_)});
        job(AckJob{res_seq_});
        if (station % 2 == 0) quiet();
      }
      job(CommandJob{session_, ++cmd_seq_, static_cast<std::uint16_t>(PlcCommand::slab_end), 0, key, 2000});
      PlcResult record = random_record(prng_, ++res_seq_, 2);
      record.cmd_seq = cmd_seq_;
      const Verdict verdict = slab % 2 == 0 ? Verdict::fail : Verdict::pass;
      job(SlabJob{key, random_slab(prng_, verdict), record, 3000});
      job(AckJob{res_seq_});
      if (verdict == Verdict::fail) decide(key);
    }
  }
  void job(const decltype(StoreJob::what)& what) {
    auto kept = std::make_shared<StoreJob>(StoreJob{1, what});
    steps_.push_back([this, kept] { return store_ != nullptr && store_->apply(*kept).ok(); });
  }
  /// A decision of quality about a slab; repeated, it counts as added.
  void decide(std::int64_t key) {
    DispositionRecord decision;
    decision.slab_key = key;
    decision.utime_us = 4'000;
    decision.who = decision.authority = "mei";
    decision.decision = Disposition::rework;
    decision.reason = "burr at block 4";
    steps_.push_back([this, decision] { return store_ != nullptr && store_->change(KeepDisposition{decision}).ok(); });
  }
  /// Adds an idle period to the previous step: the log is moved into the database.
  void quiet() {
    Step before = steps_.back();
    steps_.back() = [this, before] {
      if (!before()) return false;
      for (int i = 0; i < 5; ++i) store_->idle();
      return true;
    };
  }

  /// Stores the content after each step of an undisturbed life; [0] is that of a new database.
  void learn_contents() {
    contents_.clear();
    {
      const TemporaryFolder elsewhere;
      const std::string path = elsewhere.path() + "/slabd.db";
      contents_.push_back(content_at(path));
    }
    for (const Step& step : steps_) {
      ASSERT_TRUE(step());
      contents_.push_back(content_at(settings_.db_path, true));
    }
    close();
    fs::remove_all(fs::path(settings_.db_path).parent_path());
    fs::remove_all(settings_.spool_dir);
  }
  static std::uint64_t content_at(const std::string& path, bool beside_writer = false) {
    Result<std::unique_ptr<Connection>> db = beside_writer ? open_for_reading(path) : open_for_writing(path);
    if (!db.ok()) throw std::runtime_error(std::string(db.error().text.view()));
    return content_of(*db.value());
  }

  /// Checks the files at `root`: intact, and with the content of step `done` or the next. Returns that step.
  std::size_t expect_survived(const std::string& root, std::size_t done, const std::string& what) {
    const std::string path = root + "/db/slabd.db";
    try {
      Result<std::unique_ptr<Connection>> db = open_for_writing(path);
      if (!db.ok()) {
        ADD_FAILURE() << what << ": " << db.error().text.view();
        ++corrupt_;
        return done;
      }
      if (const std::string answer = db.value()->text("PRAGMA integrity_check"); answer != "ok") {
        ADD_FAILURE() << what << ": " << answer;
        ++corrupt_;
      }
      const Result<ChainReport> chain = check_chain(path);
      if (!chain.ok() || !chain.value().trouble.empty()) {
        ADD_FAILURE() << what << ": " << (chain.ok() ? chain.value().trouble : std::string(chain.error().text.view()));
        ++corrupt_;
      }
      const std::uint64_t content = content_of(*db.value());
      for (std::size_t step = done; step <= std::min(done + 1, contents_.size() - 1); ++step)
        if (contents_[step] == content) return step;
    } catch (const SqlFailure& failure) {
      ADD_FAILURE() << what << ": " << failure.text;
      ++corrupt_;
      return done;
    }
    ++lost_;
    ADD_FAILURE() << what << ": the content is neither that of step " << done << ", which was reported, nor the next";
    return done;
  }

  /// Checks that a daemon starts with the remaining files and works.
  void expect_goes_on(const std::string& root, const std::string& what) {
    StoreSettings settings = settings_;
    settings.db_path = root + "/db/slabd.db";
    settings.spool_dir = root + "/spool";
    Result<std::unique_ptr<Store>> store = open_store(settings);
    ASSERT_TRUE(store.ok()) << what << ": " << store.error().text.view();
    EXPECT_TRUE(store.value()->recover().ok()) << what;
    EXPECT_TRUE(store.value()->apply(StoreJob{1, SessionJob{99}}).ok()) << what;
    store.value().reset();
    store = open_store(settings);
    ASSERT_TRUE(store.ok()) << what << ": " << store.error().text.view();
    const auto line = store.value()->recover();
    ASSERT_TRUE(line.ok()) << what;
    EXPECT_EQ(line.value()->session, 99) << what;
  }

  std::uint64_t seed_;
  Prng prng_of_cuts_;
  std::vector<Step> steps_;
  std::vector<std::uint64_t> contents_;
  int corrupt_ = 0;
  int lost_ = 0;
};

DiskLog record(const std::string& root, const std::vector<std::function<bool()>>& steps) {
  crash_disk::watch(root);
  for (const auto& step : steps) {
    EXPECT_TRUE(step());
    crash_disk::mark();
  }
  return crash_disk::stop();
}

class PowerCutTest : public SurvivalTest, public ::testing::WithParamInterface<NameModel> {};
INSTANTIATE_TEST_SUITE_P(Names, PowerCutTest, ::testing::Values(NameModel::ordered, NameModel::strict),
                         [](const auto& model) { return model.param == NameModel::ordered ? "ordered" : "strict"; });

TEST_P(PowerCutTest, leaves_a_whole_database_with_every_reported_step) {
  const std::uint64_t images = number_from("SLABD_SURVIVAL_IMAGES", 300) / 2;
  make_life(2, 4);
  learn_contents();
  const DiskLog log = record(root_, steps_);
  close();
  ASSERT_GT(log.changes.size(), 200U) << "the disk saw nothing: are the calls still taken over?";
  std::printf("seed %llu, %zu changes, %zu steps, %llu images\n", static_cast<unsigned long long>(seed_),
              log.changes.size(), steps_.size(), static_cast<unsigned long long>(images));
  std::uint64_t under_way = 0;
  for (std::uint64_t i = 0; i < images && !HasFailure(); ++i) {
    // All points first, then again.
    const std::size_t end =
        images <= log.changes.size() ? 1 + i * (log.changes.size() - 1) / images : 1 + i % log.changes.size();
    const std::size_t done = log.marks_before(end);
    const std::string root = images_ + "/cut";
    image_after(log, end, GetParam(), prng_of_cuts_).write_to(root);
    const std::string what = "cut after change " + std::to_string(end) + ", image " + std::to_string(i);
    if (expect_survived(root, done, what) != done) ++under_way;
    if (i % 5 == 0) expect_goes_on(root, what);
    fs::remove_all(root);
  }
  EXPECT_EQ(corrupt_, 0);
  EXPECT_EQ(lost_, 0);
  EXPECT_GT(under_way, 0U) << "no image kept a step that was not reported yet: too friendly a disk";
}

// Second power cut while the database is recovered.
TEST_P(PowerCutTest, during_the_restart_after_a_power_cut_loses_no_record) {
  const std::uint64_t cuts = number_from("SLABD_SURVIVAL_IMAGES", 300) / 60;
  make_life(1, 3);
  learn_contents();
  const DiskLog log = record(root_, steps_);
  close();
  for (std::uint64_t i = 0; i < cuts && !HasFailure(); ++i) {
    const std::size_t end = log.changes.size() / 4 + prng_of_cuts_.below(log.changes.size() * 3 / 4);
    const std::size_t done = log.marks_before(end);
    const std::string first = images_ + "/first";
    image_after(log, end, GetParam(), prng_of_cuts_).write_to(first);
    StoreSettings settings = settings_;
    settings.db_path = first + "/db/slabd.db";
    settings.spool_dir = first + "/spool";
    crash_disk::watch(first);
    { const auto store = open_store(settings); }
    const DiskLog restart = crash_disk::stop();
    for (int again = 0; again < 6; ++again) {
      const std::string second = images_ + "/second";
      const std::size_t cut = prng_of_cuts_.below(restart.changes.size() + 1);
      image_after(restart, cut, GetParam(), prng_of_cuts_).write_to(second);
      (void)expect_survived(second, done,
                            "cut after " + std::to_string(end) + ", and again after " + std::to_string(cut));
      fs::remove_all(second);
    }
    fs::remove_all(first);
  }
}

// The file at the database's path is either the database with its log, or the quarantine's note. With the note, the
// rest is moved at the next start. A database without its log must never be there, because it would open without an
// error.
TEST_P(PowerCutTest, during_a_quarantine_never_parts_a_database_from_its_log) {
  make_life(1, 3);
  for (const Step& step : steps_) ASSERT_TRUE(step());
  const DiskImage running = DiskImage::read_from(root_);
  close();
  const std::string name = "db/slabd.db";
  ASSERT_FALSE(running.files.at(name + "-wal").empty());
  fs::remove_all(root_);
  running.write_to(root_);
  crash_disk::watch(root_);
  ASSERT_TRUE(quarantine(settings_.db_path, "test").ok());
  const DiskLog log = crash_disk::stop();
  int untouched = 0;
  int noted = 0;
  for (std::size_t end = 0; end <= log.changes.size(); ++end)
    for (int i = 0; i < 12; ++i) {
      DiskImage image = image_after(log, end, GetParam(), prng_of_cuts_);
      const std::string path = images_ + "/cut/" + name;
      image.write_to(images_ + "/cut");
      if (image.files.at(name) == running.files.at(name)) {
        EXPECT_EQ(image.files[name + "-wal"], running.files.at(name + "-wal")) << end;
        ++untouched;
      } else {
        EXPECT_TRUE(quarantine_note(path).has_value()) << end;
        EXPECT_FALSE(open_for_writing(path).ok());
        EXPECT_FALSE(fs::exists(path + "-wal"));
        ++noted;
      }
      fs::remove_all(images_ + "/cut");
    }
  EXPECT_GT(untouched, 0);
  EXPECT_GT(noted, 0);
}

// The database is either the old or the restored one, or a note prevents the daemon from starting.
TEST_P(PowerCutTest, while_a_backup_is_restored_leaves_one_of_both_or_a_note) {
  make_life(2, 2);
  for (const Step& step : steps_) ASSERT_TRUE(step());
  close();
  const std::string backup = images_ + "/backup.db";
  ASSERT_TRUE(back_up_database(settings_.db_path, backup).ok());
  const std::uint64_t before = content_at(settings_.db_path);
  crash_disk::watch(root_);
  ASSERT_TRUE(restore_database(settings_, {backup, {"anna", "test", 5}, 99}).ok());
  const DiskLog log = crash_disk::stop();
  const std::uint64_t after = content_at(settings_.db_path);
  ASSERT_NE(before, after);
  const std::uint64_t images = number_from("SLABD_SURVIVAL_IMAGES", 300) / 3;
  std::array<int, 3> seen{};
  for (std::uint64_t i = 0; i < images && !HasFailure(); ++i) {
    const std::size_t end = log.changes.size() * (i + 1) / images;
    image_after(log, end, GetParam(), prng_of_cuts_).write_to(images_ + "/cut");
    const std::string path = images_ + "/cut/db/slabd.db";
    if (quarantine_note(path)) {
      EXPECT_FALSE(open_for_writing(path).ok());
      EXPECT_TRUE(fs::exists(path));
      ++seen[1];
    } else {
      const std::uint64_t content = content_at(path);
      EXPECT_TRUE(content == before || content == after) << "cut after change " << end;
      ++seen[content == before ? 0 : 2];
    }
    fs::remove_all(images_ + "/cut");
  }
  EXPECT_GT(seen[0], 0);
  EXPECT_GT(seen[2], 0);
}

TEST_F(SurvivalTest, a_disk_that_forgets_what_was_synced_is_noticed) {
  make_life(1, 2);
  learn_contents();
  DiskLog log = record(root_, steps_);
  close();
  const auto is_sync = [](const DiskChange& change) {
    return change.kind == DiskChange::Kind::sync || change.kind == DiskChange::Kind::sync_folder;
  };
  const std::size_t marks = log.marks_before(log.changes.size());
  log.changes.erase(std::remove_if(log.changes.begin(), log.changes.end(), is_sync), log.changes.end());
  int noticed = 0;
  for (int i = 0; i < 40; ++i) {
    const std::string root = images_ + "/lying";
    image_after(log, log.changes.size(), NameModel::ordered, prng_of_cuts_).write_to(root);
    const std::string path = root + "/db/slabd.db";
    const auto db = open_for_writing(path);
    bool whole = db.ok();
    try {
      whole = whole && content_of(*db.value()) == contents_[marks];
    } catch (const SqlFailure&) {
      whole = false;
    }
    noticed += whole ? 0 : 1;
    fs::remove_all(root);
  }
  EXPECT_GT(noticed, 10) << "the test cannot fail";
}

/// Selects the points to test: `wanted` of `total`, evenly.
std::vector<std::uint64_t> points_of(std::uint64_t total, std::uint64_t wanted, std::uint64_t seed) {
  std::vector<std::uint64_t> points;
  const std::uint64_t step = std::max<std::uint64_t>(1, total / std::max<std::uint64_t>(1, wanted));
  for (std::uint64_t point = 1 + seed % step; point <= total; point += step) points.push_back(point);
  return points;
}

TEST_F(SurvivalTest, kill_9_at_every_call_loses_no_reported_step) {
  make_life(1, 4);
  learn_contents();
  crash_disk::kill_at(root_, ~std::uint64_t{0} >> 1U);
  for (const Step& step : steps_) ASSERT_TRUE(step());
  const std::uint64_t calls = crash_disk::heal();
  close();
  fs::remove_all(root_ + "/db");
  fs::remove_all(settings_.spool_dir);
  int killed = 0;
  const auto points = points_of(calls, number_from("SLABD_SURVIVAL_POINTS", 60), seed_);
  for (const std::uint64_t point : points) {
    std::array<int, 2> ends{};
    ASSERT_EQ(pipe(ends.data()), 0);
    const pid_t child = fork();
    if (child == 0) {
      crash_disk::kill_at(root_, point);
      for (const Step& step : steps_) {
        if (!step()) _exit(1);
        if (write(ends[1], "d", 1) != 1) _exit(2);
      }
      _exit(0);
    }
    ::close(ends[1]);
    std::size_t done = 0;
    char byte = 0;
    while (read(ends[0], &byte, 1) == 1) ++done;
    ::close(ends[0]);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << "at call " << point << ": " << status;
    ++killed;
    (void)expect_survived(root_, done, "killed at call " + std::to_string(point));
    expect_goes_on(root_, "killed at call " + std::to_string(point));
    fs::remove_all(root_ + "/db");
    fs::remove_all(settings_.spool_dir);
    if (HasFailure()) break;
  }
  std::printf("seed %llu: killed at %d of %llu calls\n", static_cast<unsigned long long>(seed_), killed,
              static_cast<unsigned long long>(calls));
}

/// A file with the journal mode of a backup, as it is after `slabctl db restore`.
void make_as_restored(const StoreSettings& settings) {
  ASSERT_TRUE(open_store(settings).ok());
  Connection db(settings.db_path, SQLITE_OPEN_READWRITE);
  ASSERT_EQ(db.text("PRAGMA journal_mode = DELETE"), "delete");
}

TEST_F(SurvivalTest, kill_9_at_every_call_of_an_opening_leaves_what_is_read_or_named_as_unused_or_unfinished) {
  const std::string path = settings_.db_path;
  for (const bool restored : {false, true}) {
    SCOPED_TRACE(restored ? "restored" : "new");
    const auto begin = [&] {
      fs::remove_all(root_ + "/db");
      fs::remove_all(settings_.spool_dir);
      if (restored) make_as_restored(settings_);
    };
    begin();
    crash_disk::kill_at(root_, ~std::uint64_t{0} >> 1U);
    ASSERT_TRUE(open_store(settings_).ok());
    const std::uint64_t calls = crash_disk::heal();
    int half_written = 0;
    for (std::uint64_t point = 1; point <= calls && !HasFailure(); ++point) {
      SCOPED_TRACE("killed at call " + std::to_string(point));
      begin();
      const pid_t child = fork();
      if (child == 0) {
        crash_disk::kill_at(root_, point);
        _exit(open_store(settings_).ok() ? 0 : 1);
      }
      int status = 0;
      ASSERT_EQ(waitpid(child, &status, 0), child);
      const auto first = open_reader(path);
      if (is_unfinished(path)) {
        EXPECT_FALSE(first.ok());
        EXPECT_NE(first.error().text.view().find("start slabd"), std::string::npos) << first.error().text.view();
        half_written += fs::exists(path + "-journal") ? 1 : 0;
        EXPECT_EQ(is_unused(path), !restored);
      } else {
        EXPECT_TRUE(first.ok() || is_unused(path)) << first.error().text.view();
        EXPECT_FALSE(restored && is_unused(path));
      }
      EXPECT_TRUE(open_store(settings_).ok());
      EXPECT_FALSE(is_unfinished(path));
      EXPECT_TRUE(open_reader(path).ok());
    }
    EXPECT_GT(half_written, 0) << "the test cannot fail";
  }
}

struct Trouble {
  const char* name;
  int error_number;
  bool with_reads;
  std::uint64_t calls;  ///< number of consecutive failing calls
};

class FailingCallTest : public SurvivalTest, public ::testing::WithParamInterface<Trouble> {};
INSTANTIATE_TEST_SUITE_P(Disk, FailingCallTest,
                         ::testing::Values(Trouble{"one_io_error", EIO, true, 1}, Trouble{"io_errors", EIO, true, 12},
                                           Trouble{"one_refusal_for_space", ENOSPC, false, 1},
                                           Trouble{"full", ENOSPC, false, 12}, Trouble{"read_only", EROFS, false, 6}),
                         [](const auto& trouble) { return trouble.param.name; });

TEST_P(FailingCallTest, at_every_call_is_reported_or_mended_and_a_repeat_brings_the_slab_to_the_same_end) {
  const Trouble& trouble = GetParam();
  make_life(1, 3);
  learn_contents();
  crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, trouble.with_reads);
  for (const Step& step : steps_) ASSERT_TRUE(step());
  const std::uint64_t calls = crash_disk::heal();
  close();
  fs::remove_all(root_ + "/db");
  fs::remove_all(settings_.spool_dir);
  const auto points = points_of(calls, number_from("SLABD_SURVIVAL_POINTS", 60) / 2, seed_);
  int reported = 0;
  for (const std::uint64_t point : points) {
    crash_disk::fail(root_, point, trouble.calls, trouble.error_number, trouble.with_reads);
    for (std::size_t i = 0; i < steps_.size(); ++i) {
      bool done = false;
      for (int attempt = 0; attempt < 25 && !done; ++attempt) {
        done = steps_[i]();
        reported += done ? 0 : 1;
      }
      ASSERT_TRUE(done) << "step " << i << " never works again after call " << point << " failed";
    }
    EXPECT_TRUE(crash_disk::has_hit());
    (void)crash_disk::heal();
    close();
    const std::size_t last = contents_.size() - 1;
    EXPECT_EQ(expect_survived(root_, last, "call " + std::to_string(point) + " failed"), last);
    fs::remove_all(root_ + "/db");
    fs::remove_all(settings_.spool_dir);
    if (HasFailure()) break;
  }
  EXPECT_GT(reported, 0) << "no failure was ever reported: are the calls still taken over?";
  std::printf("%s: %zu of %llu calls failed, %d times reported\n", trouble.name, points.size(),
              static_cast<unsigned long long>(calls), reported);
}

/// False if only SQLite has the cause: it reports a sync without free space as an I/O error.
bool expect_told_as_full(const Error& told) {
  if (told.text.view().find(std::strerror(ENOSPC)) == std::string_view::npos) return false;
  EXPECT_EQ(told.code, Code::store_full) << told.text.view();
  return true;
}

// A person frees space on code 501, and looks for a damaged database on code 502.
TEST_F(SurvivalTest, a_backup_on_a_full_disk_reports_the_full_disk) {
  const std::string copy = root_ + "/copy.db";
  open();
  begin(1);
  int told = 0;
  for (std::uint64_t point = 1;; ++point) {
    crash_disk::fail(root_, point, crash_disk::kAllThatFollow, ENOSPC, false);
    const Status status = back_up_database(settings_.db_path, copy);
    const bool hit = crash_disk::has_hit();
    (void)crash_disk::heal();
    if (!hit) break;
    fs::remove(copy);
    ASSERT_FALSE(status.ok());
    told += expect_told_as_full(status.error()) ? 1 : 0;
  }
  EXPECT_GT(told, 3) << "are the calls still taken over?";
}

TEST_F(SurvivalTest, a_backup_that_fails_leaves_no_file) {
  fs::create_directories(root_ + "/copies");
  const std::string copy = root_ + "/copies/copy.db";
  open();
  begin(1);
  int failed = 0;
  for (std::uint64_t point = 1;; ++point) {
    crash_disk::fail(root_, point, 1, EIO, true);
    const Status status = back_up_database(settings_.db_path, copy);
    const bool hit = crash_disk::has_hit();
    (void)crash_disk::heal();
    // The sync of the folder follows the renaming of the copy.
    EXPECT_TRUE(fs::exists(copy) || !status.ok()) << "call " << point;
    if (fs::exists(copy)) {
      EXPECT_EQ(content_at(copy, true), content_at(settings_.db_path, true)) << "call " << point;
    }
    EXPECT_FALSE(fs::exists(copy + ".part")) << "call " << point;
    fs::remove(copy);
    failed += status.ok() ? 0 : 1;
    if (!hit) break;
  }
  EXPECT_GT(failed, 10) << "are the calls still taken over?";
}

TEST_F(SurvivalTest, a_copy_before_an_upgrade_on_a_full_disk_reports_the_full_disk) {
  const std::string old_text = schema().sql;
  const NextVersions later;
  int told = 0;
  for (std::uint64_t point = 1;; ++point) {
    fs::remove_all(root_ + "/db");
    fs::create_directories(root_ + "/db");
    {
      Connection old(settings_.db_path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
      old.execute(old_text);
      old.execute("PRAGMA application_id = " + std::to_string(kApplicationId));
      old.execute("PRAGMA user_version = " + std::to_string(kSchemaVersion));
    }
    crash_disk::fail(root_, point, crash_disk::kAllThatFollow, ENOSPC, false);
    const Result<std::unique_ptr<Store>> store = open_store(settings_);
    const bool hit = crash_disk::has_hit();
    (void)crash_disk::heal();
    if (!hit) break;
    if (store.ok() || store.error().text.view().find("-backup") == std::string_view::npos) continue;
    told += expect_told_as_full(store.error()) ? 1 : 0;
  }
  EXPECT_GT(told, 2) << "are the calls still taken over?";
}

// SQLite's check reports a failed read with the same words as damage. An intact database must stay in place when reads
// fail while it is opened, for any duration, and must open when the disk works again.
TEST_F(SurvivalTest, reads_that_fail_set_no_whole_database_aside) {
  make_life(1, 3);
  for (const Step& step : steps_) ASSERT_TRUE(step());
  close();
  crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, true);
  ASSERT_TRUE(open_store(settings_).ok());
  const std::uint64_t calls = crash_disk::heal();
  int refused = 0;
  for (const std::uint64_t in_a_row : {1U, 2U, 5U, 100U, 1'000'000U})
    for (const std::uint64_t point : points_of(calls, number_from("SLABD_SURVIVAL_POINTS", 60), seed_)) {
      crash_disk::fail(root_, point, in_a_row, EIO, true);
      refused += open_store(settings_).ok() ? 0 : 1;
      (void)crash_disk::heal();
      for (const auto& entry : fs::directory_iterator(root_ + "/db"))
        ASSERT_EQ(entry.path().string().find("quarantine"), std::string::npos)
            << "calls " << point << " and " << in_a_row - 1 << " after it failed";
      ASSERT_TRUE(open_store(settings_).ok()) << "calls " << point << " and " << in_a_row - 1 << " after it failed";
    }
  EXPECT_GT(refused, 0);
  std::printf("reads that fail: %llu calls, %d times refused\n", static_cast<unsigned long long>(calls), refused);
}

// An opening reads and writes the log, and the storage thread is idle ten times a second.
TEST_F(SurvivalTest, a_disk_that_rejects_every_write_is_tried_a_few_times_in_a_hundred_idle_calls) {
  const auto reject_writes = [&] { crash_disk::fail(root_, 1, crash_disk::kAllThatFollow, EIO, false); };
  const auto keep = [&](std::int64_t utime_us) {
    return store_->keep_events({{LineEvent::Kind::fault, 502, "disk", utime_us}}).ok();
  };
  crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);  // only files opened from here on count
  open();
  begin(1);
  reject_writes();
  EXPECT_FALSE(try_apply(SessionJob{2}).ok());  // closes the file
  reject_writes();
  EXPECT_FALSE(try_apply(SessionJob{2}).ok());
  const std::uint64_t calls_per_opening = crash_disk::heal();
  ASSERT_GT(calls_per_opening, 0U);
  reject_writes();
  for (int i = 0; i < 100; ++i) {
    EXPECT_FALSE(keep(1));
    store_->idle();
  }
  const std::uint64_t calls = crash_disk::heal();
  EXPECT_GE(calls, calls_per_opening);
  EXPECT_LE(calls, 6 * calls_per_opening) << "by the events and the outbox, and to settle the job";

  crash_disk::fail(root_, ~std::uint64_t{0} >> 1U, 1, EIO, false);
  int looks = 0;
  for (; looks < 60 && !keep(1); ++looks) store_->idle();
  EXPECT_LE(looks, 50) << "without a job";
  reject_writes();
  EXPECT_FALSE(try_apply(SessionJob{3}).ok());
  EXPECT_FALSE(keep(2));
  (void)crash_disk::heal();
  EXPECT_FALSE(keep(2)) << "not at once";
  apply(SessionJob{4});
  EXPECT_TRUE(keep(2)) << "a job opens the file at once";
  const auto db = open_for_reading(settings_.db_path);
  ASSERT_TRUE(db.ok()) << db.error().text.view();
  EXPECT_EQ(db.value()->integer("SELECT count(*) FROM event"), 2);
}

// The two parts of `script/survival --strace`. One is a life in a given folder, which writes a byte for every reported
// step; the other is the check after a kill. Without that folder each part is an undisturbed life.
class StraceTest : public SurvivalTest {
 protected:
  StraceTest() {
    if (const char* folder = std::getenv("SLABD_SURVIVAL_FOLDER"); folder != nullptr) {
      root_ = folder;
      settings_.db_path = root_ + "/db/slabd.db";
      settings_.spool_dir = root_ + "/spool";
    }
    make_life(1, 2);
  }
  void live() {
    std::ofstream reported(root_ + "/reported");
    for (const Step& step : steps_) {
      ASSERT_TRUE(step());
      reported << 'd' << std::flush;
    }
  }
};

TEST_F(StraceTest, lives) {
  live();
}

TEST_F(StraceTest, is_whole) {
  if (!fs::exists(root_ + "/db")) live();
  close();
  const std::string given = settings_.db_path;
  settings_.db_path = images_ + "/learn/db/slabd.db";
  learn_contents();
  settings_.db_path = given;
  const std::size_t done = fs::exists(root_ + "/reported") ? fs::file_size(root_ + "/reported") : 0;
  (void)expect_survived(root_, done, "after " + std::to_string(done) + " reported steps");
  expect_goes_on(root_, "after the kill");
}

}  // namespace
}  // namespace slabd::storage
