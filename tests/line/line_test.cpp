// SPDX-License-Identifier: Apache-2.0
//
// The real daemon and the emulated line as processes, over real Modbus/TCP, real LCM multicast, real scan files and a
// real database.
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/limits.h"
#include "database.h"
#include "processes.h"
#include "tests/places/places.h"
#include "tests/places/ports.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

using Json = nlohmann::json;

struct LineTest : testing::Test {
  Box box;

  void SetUp() override {
    box.start();
    ASSERT_TRUE(box.ready()) << box.log();
  }
  void TearDown() override {
    if (HasFailure()) std::fprintf(stderr, "---- slabd ----\n%s", box.log().c_str());
  }
  Box::Answer simulate(std::vector<std::string> args, const std::string& points = "quarter") {
    std::vector<std::string> all = {"simulate", "--config", box.config.native(), "--points", points};
    all.insert(all.end(), args.begin(), args.end());
    return box.slabctl(all);
  }
  Json status() const {
    const Box::Answer answer = box.slabctl({"status", "--config", box.config.native(), "--json"});
    EXPECT_EQ(answer.exit_status, 0) << answer.err;
    return Json::parse(answer.out, nullptr, false);
  }
  /// Stops the emulator with SIGSTOP once `blocks` blocks are measured and no measurement is in progress: a block whose
  /// measurement is killed is not measured again. False if that is not the case now; the emulator then goes on. Polled
  /// by wait_until.
  [[nodiscard]] bool stands_still(const Process& line, std::int64_t blocks) const {
    const fs::path db = box.dir / "slabd.db";
    if (query(db, "SELECT count(*) FROM block") < blocks) return false;
    line.signal(SIGSTOP);
    const auto is_measured = [&] { return query(db, "SELECT count(*) FROM attempt WHERE phase = 'acquired'") == 0; };
    if (places::wait_until(is_measured, std::chrono::seconds(5))) return true;
    line.signal(SIGCONT);
    return false;
  }
  /// The same in the middle of a scan, which is requested and not delivered.
  [[nodiscard]] bool stands_in_a_scan(const Process& line, std::int64_t blocks) const {
    const auto is_requested = [&] {
      const auto has_file = [&](const char* folder, const char* extension) {
        std::error_code gone;
        for (fs::directory_iterator file(box.dir / "drop" / folder, gone), end; !gone && file != end;
             file.increment(gone))
          if (file->path().extension() == extension) return true;
        return false;
      };
      return has_file("request", ".json") && !has_file("inbox", ".ply");
    };
    if (!is_requested() || !stands_still(line, blocks)) return false;
    if (is_requested()) return true;
    line.signal(SIGCONT);
    return false;
  }
  /// Polls until `done`; false if that takes longer than a line does on a loaded computer.
  [[nodiscard]] static bool wait_until(const std::function<bool()>& done) {
    return places::wait_until(done, std::chrono::minutes(5));
  }
};

TEST_F(LineTest, full_size_slab_passes_and_memory_is_flat) {
  // All memory is allocated before the first scan; base/limits.h contains its size.
  EXPECT_GE(1024 * status()["memory"]["rss_kb"].get<std::size_t>(), limits::kInspectionBytes);
  const Box::Answer first = simulate({"--slab-no", "1", "--slab-id", "FULL-1"}, "full");
  ASSERT_EQ(first.exit_status, 0) << first.out << first.err;
  const auto expect_within_the_promise = [this] {
    const std::size_t peak_kb = status()["memory"]["peak_kb"];
    if (!kSanitized) {
      EXPECT_LE(1024 * peak_kb, limits::kInspectionBytes + limits::kProcessBytes);
    }
  };
  expect_within_the_promise();
  const std::int64_t first_kb = anonymous_kb(box.pid());
  ASSERT_GT(first_kb, 0);
  const Box::Answer more = simulate({"--slab-no", "2", "--slabs", "4", "--seed", "2"}, "quarter");
  ASSERT_EQ(more.exit_status, 0) << more.out << more.err;
  expect_within_the_promise();
  if (!kSanitized) {
    EXPECT_LT(anonymous_kb(box.pid()), first_kb + 2048);
  }

  const Box::Answer shown = box.slabctl({"show", "FULL-1", "--config", box.config.native(), "--json"});
  ASSERT_EQ(shown.exit_status, 0) << shown.err;
  EXPECT_NE(shown.out.find("FULL-1"), std::string::npos);
  EXPECT_EQ(box.stop(), 0);
}

/// Another program holds the database, so opening it waits for two seconds and is repeated.
TEST_F(LineTest, stopping_does_not_wait_until_the_database_is_open) {
  ASSERT_TRUE(wait_until([this] { return status()["state"] != "recover"; }));
  EXPECT_EQ(box.stop(), 0);
  sqlite3* handle = nullptr;
  ASSERT_EQ(sqlite3_open((box.dir / "slabd.db").c_str(), &handle), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(handle, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  const auto is_stopped_while_opening = [this] {
    box.start();
    EXPECT_TRUE(wait_until([this] {
      return box.slabctl({"status", "--config", box.config.native(), "--json"}).exit_status == 0;
    }));
    EXPECT_EQ(box.stop(), 0);
    return box.log().find("stopped while the database was being opened") != std::string::npos;
  };
  EXPECT_TRUE(wait_until(is_stopped_while_opening));
  sqlite3_close(handle);
  box.start();
  ASSERT_TRUE(box.ready());
  EXPECT_TRUE(wait_until([this] { return status()["state"] == "idle"; })) << "and the database is as it was";
  EXPECT_EQ(box.stop(), 0);
}

TEST_F(LineTest, planted_defects_fail_their_blocks_and_no_other) {
  const Box::Answer answer = simulate(
      {"--slab-no", "3", "--mould", "12", "--defect", "slope=4:1/35", "--defect", "jaw-distance=11:0.9", "--json"});
  ASSERT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  // The PLC's station table decides: exactly blocks 4 and 11 failed, and so did the slab.
  const fs::path db = box.dir / "slabd.db";
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'fail'"), 2);
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'fail' AND station IN (4, 11)"), 2);
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'pass'"), 16);
  EXPECT_EQ(query(db, "SELECT count(*) FROM slab_result WHERE verdict = 'fail'"), 1);
  EXPECT_EQ(query(db, "SELECT mould FROM slab"), 12);
}

TEST_F(LineTest, a_failed_slab_that_was_turned_to_pass_while_slabd_was_stopped_is_named) {
  const Box::Answer answer = simulate({"--slab-no", "3", "--slab-id", "TURNED", "--defect", "slope=4:1/35"});
  ASSERT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  const Json chain = status()["chain"];
  const std::string head = chain["sha256"];
  const std::string entry = std::to_string(chain["entries"].get<int>());
  EXPECT_TRUE(box.logs("is sealed: entry " + entry + " of the chain of results, SHA-256 " + head))
      << "the journal is the witness";
  const auto check = [&] { return box.slabctl({"db", "check", "--config", box.config.native(), "--entry", entry}); };
  const Box::Answer before = check();
  EXPECT_EQ(before.exit_status, 0) << before.out << before.err;
  EXPECT_NE(before.out.find("1 slabs are as they were sealed"), std::string::npos) << before.out;
  EXPECT_NE(before.out.find("entry " + entry + ", SHA-256 " + head), std::string::npos) << before.out;
  EXPECT_EQ(box.stop(), 0);

  sqlite3* handle = nullptr;
  ASSERT_EQ(sqlite3_open((box.dir / "slabd.db").c_str(), &handle), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(handle,
                         "UPDATE slab_result SET verdict = 'pass', reason = 0; UPDATE station_result SET verdict = "
                         "'pass', reason = 0",
                         nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(handle);
  const Box::Answer turned = check();
  EXPECT_EQ(turned.exit_status, 3) << turned.out << turned.err;
  EXPECT_NE(
      turned.out.find("ALTERED: slab key 1 (number 3, \"TURNED\") was altered: table slab_result, station_result"),
      std::string::npos)
      << turned.out;
  EXPECT_EQ(box.slabctl({"db", "backup", "--config", box.config.native()}).exit_status, 3) << "every night";
}

TEST_F(LineTest, a_slab_that_was_begun_under_the_type_of_its_twin_does_not_pass_and_its_type_is_named) {
  const Json alike = status()["alike_recipes"];
  ASSERT_EQ(alike.size(), 1U);
  EXPECT_EQ(alike[0]["a"], "P4856");
  EXPECT_EQ(alike[0]["b"], "P4925");
  EXPECT_TRUE(box.logs("P4856 and P4925 have the same blocks and differ only in the slab's ends"));

  // A field of view of 580 mm reaches past both ends. With a quarter of the points the flatness has no value then.
  const std::vector<std::string> wide = {"--field-x-mm", "580", "--slab-type", "4856", "--move-s", "0"};
  std::vector<std::string> wrong = {"--slab-no",  "8",    "--slab-id",         "TWIN",
                                    "--begin-as", "4925", "--scans-per-block", "1"};
  wrong.insert(wrong.end(), wide.begin(), wide.end());
  const Box::Answer answer = simulate(wrong);
  EXPECT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  const fs::path db = box.dir / "slabd.db";
  EXPECT_EQ(query(db, "SELECT count(*) FROM slab_result WHERE verdict = 'not_measured'"), 1);
  EXPECT_TRUE(box.logs("[106] station 3: the slab was begun as type 4925 (P4925), but its top ends 26"))
      << "two inner blocks show that the scanner sees further";
  EXPECT_TRUE(box.logs("as on type 4856 (P4856, 268.5 mm)"));

  const std::size_t said = box.log().size();
  std::vector<std::string> right = {"--slab-no", "9", "--slab-id", "RIGHT"};
  right.insert(right.end(), wide.begin(), wide.end());
  const Box::Answer rightly_begun = simulate(right);
  EXPECT_EQ(rightly_begun.exit_status, 1) << rightly_begun.out << rightly_begun.err;
  const auto rightly = [&](const std::string& what) {
    return query(db, ("SELECT count(*) FROM " + what + " AND slab_key = 2").c_str());
  };
  EXPECT_EQ(rightly("slab_result WHERE reason = 601"), 1) << "the same slab, rightly begun: only its flatness";
  EXPECT_EQ(rightly("block WHERE reason = 601"), 16);
  EXPECT_EQ(box.log().find("[106]", said), std::string::npos);
}

TEST_F(LineTest, a_missing_block_is_not_measured_and_so_is_the_slab) {
  const Box::Answer answer = simulate({"--slab-no", "4", "--defect", "missing=7", "--scans-per-block", "1"});
  EXPECT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  const fs::path db = box.dir / "slabd.db";
  EXPECT_EQ(query(db, "SELECT count(*) FROM slab_result WHERE verdict = 'not_measured'"), 1);
  EXPECT_EQ(query(db, "SELECT count(*) FROM block WHERE station = 7 AND verdict = 'pass'"), 0);
}

TEST_F(LineTest, killed_in_mid_slab_keeps_what_was_acquired_and_finishes) {
  const fs::path db = box.dir / "slabd.db";
  {
    const auto line = box.simulate({"--slab-no", "5", "--slab-id", "KILLED"});
    ASSERT_TRUE(wait_until([&] { return !line->running() || stands_still(*line, 7); }))
        << "seven blocks were not measured\n"
        << read_file(box.dir / "simulate.err");
    ASSERT_TRUE(line->running()) << read_file(box.dir / "simulate.err");
    box.kill_hard();
    line->signal(SIGCONT);
    line->signal(SIGINT);
    line->wait();
  }
  const std::int64_t measured = query(db, "SELECT count(*) FROM block");
  EXPECT_GE(measured, 7);
  EXPECT_EQ(query(db, "SELECT count(*) FROM slab_result"), 0);

  box.start();
  ASSERT_TRUE(box.ready());
  const Box::Answer answer = simulate({"--slab-no", "5", "--slab-id", "KILLED"});
  EXPECT_EQ(answer.exit_status, 0) << answer.out << answer.err;
  EXPECT_EQ(query(db, "SELECT count(*) FROM slab"), 1);
  EXPECT_EQ(query(db, "SELECT count(*) FROM slab_result WHERE verdict = 'pass'"), 1);
  // Acquired scans were not repeated. Attempts without a scan do not count: one pause of the robot's poses fails one.
  EXPECT_EQ(query(db, "SELECT count(*) FROM attempt WHERE phase = 'measured'"), 18);
}

TEST_F(LineTest, daemon_survives_files_that_are_not_scans) {
  const fs::path inbox = box.dir / "drop/inbox";
  ASSERT_TRUE(wait_until([&] { return fs::exists(inbox); })) << "slabd did not make the inbox";
  std::ofstream(inbox / "1-999.ply") << "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nend_header\n";
  std::ofstream(inbox / "0-0.ply") << std::string(100'000, '\0');
  const Box::Answer answer = simulate({"--slab-no", "6"});
  EXPECT_EQ(answer.exit_status, 0) << answer.out << answer.err;
  EXPECT_TRUE(fs::exists(box.dir / "drop/stray"));
  EXPECT_EQ(status()["links"]["scanner"]["strays"].get<int>(), 2);
}

TEST_F(LineTest, a_slab_is_finished_among_strays_old_files_and_half_ones_at_every_step) {
  const fs::path drop = box.dir / "drop";
  ASSERT_TRUE(wait_until([&] { return fs::exists(drop / "inbox"); })) << "slabd did not make the inbox";
  const auto line = box.simulate({"--slab-no", "9", "--defect", "slope=11:1/35"});
  std::uint32_t turn = 0;
  std::string kept;  // a scan that answered an earlier request
  while (line->running()) {
    std::error_code gone;
    for (const auto& entry : fs::directory_iterator(drop / "request", gone)) {
      const std::string stem = entry.path().stem();
      const std::size_t dash = stem.find('-');
      if (dash == std::string::npos || stem.starts_with(".")) continue;
      const int seq = std::stoi(stem.substr(dash + 1));
      const std::string session = stem.substr(0, dash + 1);
      switch (turn++ % 5) {
        case 0: std::ofstream(drop / "inbox" / (stem + ".ply.part")) << "ply\nformat"; break;
        case 1: std::ofstream(drop / "inbox" / "Scan 001.ply") << "ply\n"; break;
        case 2: std::ofstream(drop / "inbox" / (session + std::to_string(seq - 1) + ".ply")) << kept; break;
        case 3: std::ofstream(drop / "inbox" / (session + std::to_string(seq + 1) + ".ply")) << kept; break;
        default: fs::create_directory(drop / "inbox" / ("folder" + std::to_string(turn)), gone);
      }
    }
    if (kept.empty())
      for (const auto& entry : fs::recursive_directory_iterator(box.dir / "spool", gone))
        if (entry.path().extension() == ".ply" && entry.file_size(gone) < 20'000'000) kept = read_file(entry.path());
    std::this_thread::sleep_for(std::chrono::milliseconds(7));
  }
  EXPECT_EQ(line->wait(), 1) << read_file(box.dir / "simulate.err");
  const fs::path db = box.dir / "slabd.db";
  // Copies of other blocks' scans were present all the time, and still the right block failed.
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'pass'"), 17);
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'fail' AND station = 11"), 1);
  EXPECT_GT(status()["links"]["scanner"]["strays"].get<int>(), 5);
}

TEST_F(LineTest, killed_while_a_scan_is_taken_has_one_more_taken_and_discarded) {
  const fs::path db = box.dir / "slabd.db";
  {
    const auto line = box.simulate({"--slab-no", "23", "--slab-id", "UNSEEN"});
    ASSERT_TRUE(wait_until([&] { return !line->running() || stands_in_a_scan(*line, 3); }))
        << "no SCAN was seen under way\n"
        << read_file(box.dir / "simulate.err");
    ASSERT_TRUE(line->running()) << read_file(box.dir / "simulate.err");
    box.kill_hard();
    line->signal(SIGCONT);
    line->signal(SIGINT);
    line->wait();
  }
  box.start();
  ASSERT_TRUE(box.ready());
  const Box::Answer answer = simulate({"--slab-no", "23", "--slab-id", "UNSEEN"});
  EXPECT_EQ(answer.exit_status, 0) << answer.out << answer.err;
  EXPECT_TRUE(box.logs("one more scan is taken first")) << box.log();
  EXPECT_EQ(query(db, "SELECT count(*) FROM slab_result WHERE verdict = 'pass'"), 1);
  for (const auto& entry : fs::recursive_directory_iterator(box.dir / "spool"))
    EXPECT_EQ(entry.path().native().find("unseen"), std::string::npos) << entry.path();
}

// A scanner fault persists over a restart of slabd: the first answer to every other request is a scan of block 1, under
// the new name. Block 5 has a planted slope, so it passes only if its scan is mistaken.
TEST_F(LineTest, a_scan_from_before_a_restart_is_not_accepted_for_another_block_after_it) {
  const fs::path db = box.dir / "slabd.db";
  std::string kept;
  std::string kept_name;
  {
    const auto line = box.simulate({"--slab-no", "21", "--defect", "slope=5:1/35"});
    ASSERT_TRUE(wait_until([&] { return !line->running() || stands_in_a_scan(*line, 2); }))
        << "two blocks were not measured\n"
        << read_file(box.dir / "simulate.err");
    ASSERT_TRUE(line->running()) << read_file(box.dir / "simulate.err");
    box.kill_hard();
    line->signal(SIGCONT);
    line->signal(SIGINT);
    line->wait();
  }
  for (const auto& entry : fs::recursive_directory_iterator(box.dir / "spool"))
    if (entry.path().extension() == ".ply" && kept.empty()) {
      kept = read_file(entry.path());
      kept_name = entry.path().filename();
    }
  ASSERT_FALSE(kept.empty());
  const auto inspect_with_old_answers = [&](const char* slab) {
    // More tries than one for each old answer: on a busy computer poses may come late, too.
    const auto line = box.simulate({"--slab-no", slab, "--defect", "slope=5:1/35", "--scans-per-block", "8"});
    const fs::path ready = box.dir / "drop/inbox/ready.part";
    std::string answered;
    for (std::uint32_t turn = 0; line->running(); std::this_thread::sleep_for(std::chrono::milliseconds(1))) {
      if (!fs::exists(ready)) std::ofstream(ready) << kept;
      std::error_code gone;
      for (const auto& entry : fs::directory_iterator(box.dir / "drop/request", gone)) {
        const std::string stem = entry.path().stem();
        if (stem.starts_with(".") || stem == answered) continue;
        if (stem.starts_with("0-")) continue;  // discarded in any case
        answered = stem;
        if (turn++ % 2 != 0) continue;
        line->signal(SIGSTOP);  // prevents that its own scan comes first
        fs::last_write_time(ready, fs::file_time_type::clock::now(), gone);
        fs::rename(ready, box.dir / "drop/inbox" / (stem + ".ply"), gone);
        for (int i = 0; i < 1'000 && fs::exists(entry.path(), gone); ++i)
          std::this_thread::sleep_for(std::chrono::milliseconds(1));
        line->signal(SIGCONT);
        break;
      }
    }
    EXPECT_EQ(line->wait(), 1) << read_file(box.dir / "simulate.err");
  };
  const auto refused = [&] {
    const std::string log = box.log();
    int count = 0;
    for (std::size_t at = 0; (at = log.find("points of an earlier scan again", at)) != std::string::npos; ++at) ++count;
    return count;
  };
  box.start();
  ASSERT_TRUE(box.ready());
  inspect_with_old_answers("21");  // between two blocks of one slab
  const int in_the_slab = refused();
  EXPECT_GT(in_the_slab, 0);
  EXPECT_EQ(box.stop(), 0);
  box.start();
  ASSERT_TRUE(box.ready());
  inspect_with_old_answers("22");  // and between two slabs
  EXPECT_GT(refused(), in_the_slab);
  // Scans differ in their number of points. The old scan counts once, and was refused from the first time.
  const std::string old_scan =
      "SELECT count(*) FROM attempt WHERE scan_finite = (SELECT scan_finite FROM attempt "
      "WHERE scan_path LIKE '%" +
      kept_name + "') AND ";
  EXPECT_EQ(query(db, old_scan + "phase != 'failed'"), 1);
  constexpr int kRepeated = 303;
  EXPECT_EQ(query(db, old_scan + "code NOT IN (0, " + std::to_string(kRepeated) + ")"), 0);
  EXPECT_GE(query(db, old_scan + "code = " + std::to_string(kRepeated)), 2);
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'pass'"), 34);
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'fail' AND station = 5"), 2);
}

/// A line whose scans arrive over TCP.
struct StreamLineTest : LineTest {
  std::uint16_t scanner_port = places::own_port();
  void SetUp() override {
    std::string text = read_file(box.config);
    const std::size_t begin = text.find("drop_dir");
    text.replace(begin, text.find('\n', begin) - begin,
                 "backend = \"tcp\"\nlisten = \"127.0.0.1:" + std::to_string(scanner_port) + "\"");
    std::ofstream(box.config) << text;
    LineTest::SetUp();
  }
};

TEST_F(StreamLineTest, a_slab_is_finished_over_tcp_from_planned_stations) {
  const Box::Answer plan =
      box.slabctl({"stations", "--config", box.config.native(), "--krl", (box.dir / "SLABPTS").native(), "--json"});
  ASSERT_EQ(plan.exit_status, 0) << plan.out << plan.err;
  EXPECT_EQ(Json::parse(plan.out)["stations"].size(), 18U);
  EXPECT_NE(status()["links"]["scanner"]["text"].get<std::string>().find("no gateway"), std::string::npos);
  const Box::Answer answer = simulate({"--slab-no", "7", "--scanner", "tcp", "--stations",
                                       (box.dir / "SLABPTS.dat").native(), "--defect", "slope=4:1/35"});
  EXPECT_EQ(answer.exit_status, 1) << answer.out << answer.err;
  const fs::path db = box.dir / "slabd.db";
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'pass'"), 17);
  EXPECT_EQ(query(db, "SELECT count(*) FROM station_result WHERE verdict = 'fail' AND station = 4"), 1);
  // A scan prepared for one station is never used for another, so no second attempt was needed, except after a pause of
  // the robot's poses or of the scanner on a computer with other work.
  EXPECT_EQ(query(db, "SELECT count(*) FROM attempt WHERE phase = 'measured'"), 18);
  EXPECT_EQ(query(db, "SELECT count(*) FROM attempt WHERE code NOT IN (0, 202, 203, 302)"), 0);
  EXPECT_LE(query(db, "SELECT count(*) FROM attempt WHERE phase <> 'measured'"), 4);
  const Box::Answer taught = box.slabctl(
      {"stations", "--config", box.config.native(), "--taught", (box.dir / "SLABPTS.dat").native(), "--json"});
  EXPECT_EQ(taught.exit_status, 0) << taught.err;
  EXPECT_LT(Json::parse(taught.out)["stations"][17]["taught_off_mm"].get<double>(), 1e-4);
  const Box::Answer wrong = simulate({"--scanner", "drop"});
  EXPECT_EQ(wrong.exit_status, 2);
  EXPECT_EQ(box.stop(), 0);
}

TEST(FaultyConfiguration, a_good_file_is_distinguished_from_a_computer_without_recipes) {
  Box box;
  const auto check = [&box] {
    Process process({places::slabd(), "--config", box.config.native(), "--check"}, box.dir / "check.out",
                    box.dir / "check.err");
    return process.wait();
  };
  EXPECT_EQ(check(), 0) << read_file(box.dir / "check.err");
  std::string text = read_file(box.config);
  text.replace(text.find("/recipes"), 8, "/nowhere");
  std::ofstream(box.config) << text;
  EXPECT_EQ(check(), 3);
  EXPECT_NE(read_file(box.dir / "check.out").find(": ok, but not the recipes it names"), std::string::npos);
  EXPECT_NE(read_file(box.dir / "check.err").find("/nowhere: the recipe folder cannot be read"), std::string::npos);
  std::ofstream(box.config, std::ios::app) << "[scaner]\n";
  fs::remove(box.dir / "check.out");
  EXPECT_EQ(check(), 3);
  EXPECT_EQ(read_file(box.dir / "check.out"), "") << "nothing is ok";
}

TEST(FaultyConfiguration, shows_the_plc_fault_504_and_names_the_line) {
  Box box;
  std::ofstream(box.config, std::ios::app) << "[scaner]\n";
  const Box::Answer check = box.slabctl({"config", "check", box.config.native()});
  EXPECT_EQ(check.exit_status, 3);
  EXPECT_NE(check.err.find("slabd.toml:"), std::string::npos) << check.err;
  EXPECT_NE(check.err.find("scanner"), std::string::npos) << check.err;
  box.start();
  ASSERT_TRUE(box.ready()) << box.log();
  const Box::Answer run = box.slabctl({"simulate", "--config", box.config.native()});
  EXPECT_EQ(run.exit_status, 3);
  EXPECT_TRUE(box.running());
  EXPECT_EQ(box.stop(), 0);
}

}  // namespace
}  // namespace slabd::line
