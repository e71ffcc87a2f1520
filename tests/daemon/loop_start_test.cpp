// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/loop.h"
#include "daemon/recipe_watch.h"
#include "daemon/workers.h"
#include "tests/mock/mock.h"
#include "tests/places/places.h"

namespace slabd::daemon {
namespace {

/// True if `what` becomes true within 30 s.
template <typename What>
[[nodiscard]] bool comes(const What& what) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (!what()) {
    if (std::chrono::steady_clock::now() >= end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

/// A database on the disk: how it reads, and the accesses to it.
struct Database {
  Code reading = Code::ok;  ///< result of the recovery
  std::atomic<int> recoveries{0};
  std::atomic<int> idles{0};
  std::atomic<int> idles_while_recovering{0};
};

/// Counts calls during the recovery at the start. The recovery takes as long as some idle calls of a worker.
class SlowStore final : public storage::Store {
 public:
  explicit SlowStore(Database& database) : database_(database) {}

  Result<std::unique_ptr<RecoveredLine>> recover() override {
    ++database_.recoveries;
    recovering_ = true;
    std::this_thread::sleep_for(std::chrono::milliseconds(350));
    recovering_ = false;
    if (database_.reading != Code::ok) return error(database_.reading, "cannot be read");
    return std::make_unique<RecoveredLine>();
  }
  Status apply(const StoreJob& /*job*/) override { return success(); }
  Result<std::string> change(const storage::CalibrationChange& /*change*/) override {
    return error(Code::config, "not here");
  }
  Result<std::unique_ptr<CellCalibration>> calibration() override { return error(Code::config, "not here"); }
  void idle() override {
    ++database_.idles;
    if (recovering_) ++database_.idles_while_recovering;
  }

  Status order(const storage::CareOrder& /*order*/) override { return error(Code::config, "not here"); }
  storage::CareState care() const override { return {}; }

 private:
  Database& database_;
  std::atomic<bool> recovering_{false};
};

StoreOpener opener(Database& database) {
  return [&database](std::atomic<bool>&) -> Result<std::unique_ptr<storage::Store>> {
    return std::unique_ptr<storage::Store>(std::make_unique<SlowStore>(database));
  };
}

/// A database whose opening takes until `finish`, and then fails.
struct LongOpening {
  [[nodiscard]] StoreOpener opener() {
    return [this](std::atomic<bool>&) -> Result<std::unique_ptr<storage::Store>> {
      ++tries;
      EXPECT_TRUE(comes([this] { return finish.load(); })) << "the test has not ended within 30 s";
      return error(Code::journal_write, "not yet");
    };
  }
  std::atomic<int> tries{0};
  std::atomic<bool> finish{false};
};

/// Real threads and queues, but without measuring.
class IdleWorkers final : public Workers {
 public:
  std::unique_ptr<StoreQueue> storage(std::function<StoreAnswer(const StoreTask&)> work,
                                      std::function<void()> idle) override {
    return std::make_unique<Worker<StoreTask, StoreAnswer, limits::kWorkerQueue>>("store", std::move(work),
                                                                                  std::move(idle));
  }
  std::unique_ptr<ScanQueue> scanner(std::size_t /*arm*/, std::function<ScanDone(const AcquireScan&)> work,
                                     std::function<void()> idle) override {
    return std::make_unique<Worker<AcquireScan, ScanDone, 4>>("scan", std::move(work), std::move(idle));
  }
  std::unique_ptr<MeasureQueue> measuring() override {
    return std::make_unique<Worker<MeasureBlock, BlockMeasured, 4>>(
        "measure", [](const MeasureBlock&) { return BlockMeasured{}; }, [] {});
  }
  std::span<float> slot(std::size_t /*index*/) override { return points_; }
  std::optional<std::uint32_t> points_crc32c(const AcquiredScan& /*scan*/, std::size_t /*arm*/) override {
    return std::nullopt;
  }

 private:
  std::vector<float> points_ = std::vector<float>(3);
};

struct LoopStart : ::testing::Test {
  hal::ManualClock clock;
  hal::MockNotify notify;
  hal::MockPlc plc;
  hal::MockPose pose;
  hal::MockScanner scanner{clock};

  const Ports ports{plc, pose, scanner, nullptr, nullptr, clock, notify};

  /// Starts a loop on `database` and turns it for half a second, and until it was idle `idle` times.
  void live(Database& database, int idle) {
    Loop loop(ports, StationSettings{}, opener(database), std::make_unique<IdleWorkers>(), LoopFigures{});
    loop.start();
    for (int i = 0; i < 50 || (i < 6'000 && database.idles < idle); ++i) loop.turn(10);
    loop.finish();
  }
  /// Turns until the store is open or was not usable.
  static void open(Loop& loop) {
    for (int i = 0; i < 3'000 && loop.is_opening(); ++i) loop.turn(10);
    EXPECT_FALSE(loop.is_opening()) << "the store has not been opened within 30 s";
  }
};

TEST_F(LoopStart, no_other_access_to_the_database_occurs_while_it_is_read) {
  Database database;
  live(database, 1);
  EXPECT_EQ(database.idles_while_recovering, 0);
  EXPECT_GT(database.idles, 0) << "afterwards the storage thread looks after it";
}

TEST_F(LoopStart, a_database_that_could_not_be_read_is_left_alone) {
  Database database;
  database.reading = Code::journal_write;
  live(database, 0);
  EXPECT_EQ(database.idles, 0);
}

TEST_F(LoopStart, unusable_storage_is_a_fault_with_a_reason_and_is_tried_again) {
  for (const auto& [reading, fault] :
       {std::pair{Code::store_full, Code::store_full}, std::pair{Code::journal_write, Code::journal_write},
        std::pair{Code::config, Code::journal_write}, std::pair{Code::internal, Code::journal_write}}) {
    EXPECT_EQ(fault_without_store(error(reading, "why")), fault);
    Database database;
    database.reading = reading;
    Loop loop(ports, StationSettings{}, opener(database), std::make_unique<IdleWorkers>(), LoopFigures{});
    loop.start();
    open(loop);
    loop.turn(0);
    EXPECT_EQ(plc.published.back().fault, static_cast<int>(fault));
    EXPECT_FALSE(plc.published.back().store_ok);
    clock.advance(5 * kNsPerS - 1);
    loop.turn(0);
    EXPECT_FALSE(loop.is_opening());
    clock.advance(1);
    loop.turn(0);
    open(loop);
    EXPECT_EQ(database.recoveries, 2) << "fault " << static_cast<int>(fault);
    loop.finish();
  }
}

TEST_F(LoopStart, each_try_to_open_the_store_waits_longer_than_the_one_before) {
  LongOpening database;
  database.finish = true;
  Loop loop(ports, StationSettings{}, database.opener(), std::make_unique<IdleWorkers>(), LoopFigures{});
  loop.start();
  for (const std::int64_t wait_s : {5, 10, 20, 40, 80, 160, 300, 300}) {
    open(loop);
    const int before = database.tries;
    clock.advance(wait_s * kNsPerS - 1);
    loop.turn(0);
    EXPECT_FALSE(loop.is_opening()) << wait_s << " s";
    clock.advance(1);
    loop.turn(0);
    open(loop);
    EXPECT_EQ(database.tries, before + 1) << wait_s << " s";
  }
  loop.finish();
}

TEST_F(LoopStart, the_scanner_is_left_alone_until_it_is_this_process_s_own) {
  std::atomic<bool> is_free{false};
  std::atomic<int> tries{0};
  const StoreOpener open_if_free = [&](std::atomic<bool>& ours) -> Result<std::unique_ptr<storage::Store>> {
    ++tries;
    if (is_free) ours = true;
    return error(Code::busy, "another daemon works with it");
  };
  Loop loop(ports, StationSettings{}, open_if_free, std::make_unique<IdleWorkers>(), LoopFigures{});
  loop.start();
  for (int round = 1; round <= 3; ++round) {
    open(loop);
    EXPECT_EQ(tries, round) << "the other daemon may end at any time, so the tries do not become rare";
    for (int i = 0; i < 30; ++i) loop.turn(10);
    EXPECT_EQ(plc.published.back().fault, static_cast<int>(Code::config));
    EXPECT_EQ(scanner.idle_count, 0);
    clock.advance(5 * kNsPerS);
    loop.turn(0);
  }
  open(loop);
  is_free = true;
  clock.advance(5 * kNsPerS);
  for (int i = 0; i < 3'000 && scanner.idle_count == 0; ++i) loop.turn(10);
  EXPECT_GT(scanner.idle_count, 0);
  loop.finish();
}

TEST_F(LoopStart, each_arm_has_its_own_poses_scanner_and_worker) {
  hal::MockPose pose_2;
  hal::MockScanner scanner_2{clock};
  Ports both = ports;
  ASSERT_TRUE(both.more_arms.push({&pose_2, &scanner_2}));
  StationSettings settings;
  ASSERT_TRUE(settings.arms.list.push(Arm{PartId("2"), PartId("right")}));
  ASSERT_TRUE(settings.more_arms.push(StationArmSettings{}));
  const auto opener_of_all = [](Database& database) -> StoreOpener {
    return [&database](std::atomic<bool>& scanner_is_ours) -> Result<std::unique_ptr<storage::Store>> {
      scanner_is_ours = true;
      return std::unique_ptr<storage::Store>(std::make_unique<SlowStore>(database));
    };
  };
  Database database;
  scanner.is_hung = true;
  Loop loop(both, settings, opener_of_all(database), std::make_unique<IdleWorkers>(), LoopFigures{});
  loop.start();
  open(loop);
  PoseSample sample;
  sample.arrival_ns = clock.mono_ns();
  sample.seq = 11;
  pose.push(sample);
  sample.seq = 22;
  pose_2.push(sample);
  const Station& station = loop.station();
  for (int i = 0; i < 3'000 && (scanner_2.idle_count == 0 || station.arms[1].gate.newest() == nullptr); ++i)
    loop.turn(10);
  ASSERT_NE(station.arms[0].gate.newest(), nullptr);
  ASSERT_NE(station.arms[1].gate.newest(), nullptr);
  EXPECT_EQ(station.arms[0].gate.newest()->seq, 11);
  EXPECT_EQ(station.arms[1].gate.newest()->seq, 22);
  EXPECT_EQ(station.arms[1].gate.newest()->arm, 1);
  EXPECT_TRUE(station.arms[0].links.scanner_hangs);
  EXPECT_FALSE(station.arms[1].links.scanner_hangs);
  EXPECT_GT(scanner_2.idle_count, 0) << "each worker looks after its own scanner";
  loop.finish();
  EXPECT_FALSE(loop.wait_for_scanner_thread()) << "one of them hangs";
  scanner.is_hung = false;
  EXPECT_TRUE(loop.wait_for_scanner_thread());
}

TEST_F(LoopStart, storage_is_not_tried_again_for_a_fault_reset_that_is_held_down) {
  LongOpening database;
  database.finish = true;
  Loop loop(ports, StationSettings{}, database.opener(), std::make_unique<IdleWorkers>(), LoopFigures{});
  const auto write = [&](bool fault_reset) {
    PlcInputs image;
    image.fault_reset = fault_reset;
    plc.write(image);
    plc.write(image);
    loop.turn(0);
    loop.turn(0);
  };
  /// Tries caused by one more image of the PLC.
  const auto tries_after = [&](bool fault_reset) {
    const int before = database.tries;
    write(fault_reset);
    open(loop);
    loop.turn(0);
    open(loop);
    return database.tries - before;
  };
  loop.start();
  open(loop);
  EXPECT_EQ(tries_after(true), 1) << "an edge";
  EXPECT_EQ(tries_after(true), 0) << "still down";
  EXPECT_EQ(tries_after(false), 0) << "released";

  /// Tries after the one that the clock causes, during which the PLC writes `images`.
  const auto more_tries = [&](std::initializer_list<bool> images) {
    const int before = database.tries;
    database.finish = false;
    clock.advance(3600 * kNsPerS);
    loop.turn(0);
    EXPECT_TRUE(loop.is_opening());
    for (const bool image : images) write(image);
    EXPECT_TRUE(loop.is_opening());
    database.finish = true;
    open(loop);
    loop.turn(0);
    open(loop);
    return database.tries - before - 1;
  };
  EXPECT_EQ(tries_after(true), 1) << "an edge again";
  EXPECT_EQ(more_tries({true}), 0) << "held all the time";
  EXPECT_EQ(more_tries({false}), 0) << "released while the database was opened";
  EXPECT_EQ(more_tries({true}), 1) << "pressed while the database was opened";
  EXPECT_EQ(tries_after(true), 0) << "once";
  loop.finish();
}

TEST(Fingerprint, depends_on_x_y_and_z_of_scans_of_every_size) {
  // Scans of every size are the beginnings of the largest.
  constexpr std::size_t kPointsEnd = 1'100'000;
  std::vector<float> xyz(3 * kPointsEnd);
  for (std::size_t i = 0; i < xyz.size(); ++i) xyz[i] = static_cast<float>(i);
  std::array<std::vector<float>, 3> moved = {xyz, xyz, xyz};
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t i = axis; i < xyz.size(); i += 3) moved[axis][i] += 0.5F;
  for (std::size_t points = 900'000; points < kPointsEnd; points += 1'500) {
    const std::uint64_t first = fingerprint_of(std::span(xyz).first(3 * points));
    EXPECT_NE(first, 0U);
    for (std::size_t axis = 0; axis < 3; ++axis)
      EXPECT_NE(fingerprint_of(std::span(moved[axis]).first(3 * points)), first) << points << " points, axis " << axis;
  }
}

TEST_F(LoopStart, while_the_database_is_opened_the_plc_reads_recover_and_a_heartbeat) {
  LongOpening database;
  Loop loop(ports, StationSettings{}, database.opener(), std::make_unique<IdleWorkers>(), LoopFigures{});
  loop.start();
  EXPECT_EQ(notify.ready_count, 1);
  std::uint16_t heartbeat = 0;
  int fed = 0;
  // Longer than a worker may be stuck.
  for (int second = 0; second < 80; ++second) {
    clock.advance(kNsPerS);
    PlcInputs image;
    image.heartbeat = static_cast<std::uint16_t>(second);
    image.command = static_cast<std::uint16_t>(PlcCommand::slab_begin);
    image.command_writer = image.command_writes = image.cmd_seq = 1;
    plc.write(image);
    for (int turn = 0; turn < 2; ++turn) loop.turn(20);
    ASSERT_TRUE(loop.is_opening());
    if (second == 70) fed = notify.watchdog_count;
    const PlcOutputs& view = plc.published.back();
    EXPECT_EQ(view.state, PlcState::recover);
    EXPECT_FALSE(view.ready);
    EXPECT_FALSE(view.store_ok);
    EXPECT_EQ(view.slab_verdict, Verdict::none);
    EXPECT_EQ(view.cmd_ack, 0);
    EXPECT_EQ(view.refused, 0);
    EXPECT_NE(std::exchange(heartbeat, view.heartbeat), view.heartbeat);
  }
  EXPECT_GT(notify.watchdog_count, fed) << "the storage thread is not stuck";
  EXPECT_EQ(notify.last_status, "the database is being opened and checked");
  database.finish = true;
  open(loop);
  loop.finish();
}

/// Sends one request unless it is held back, and stores the answer.
class OneQuestion final : public hal::ControlPort {
 public:
  explicit OneQuestion(std::string question) : question_(std::move(question)) {}
  std::size_t poll_fds(std::span<pollfd> /*fds*/) override { return 0; }
  bool next(std::int64_t /*mono_ns*/, std::string_view& line) override {
    if (asked_ || hold) return false;
    asked_ = true;
    line = question_;
    return true;
  }
  void reply(std::string_view json) override { answer = json; }
  std::uint32_t peer_uid() const override { return kUidUnknown; }

  std::string answer;
  bool hold = false;

 private:
  std::string question_;
  bool asked_ = false;
};

TEST_F(LoopStart, a_recovery_that_failed_is_in_the_status_with_its_reason) {
  Database database;
  database.reading = Code::journal_write;
  OneQuestion control(R"({"verb":"status"})");
  const Ports asked{plc, pose, scanner, nullptr, &control, clock, notify};
  Loop loop(asked, StationSettings{}, opener(database), std::make_unique<IdleWorkers>(), LoopFigures{});
  loop.start();
  control.hold = true;
  open(loop);
  for (int i = 0; i < 10; ++i) loop.turn(10);  // the session's job succeeds without a database
  control.hold = false;
  loop.turn(10);
  loop.finish();
  EXPECT_NE(control.answer.find(R"("text":"cannot be read")"), std::string::npos) << control.answer;
}

TEST_F(LoopStart, state_and_figures_are_reported_while_the_database_is_opened) {
  const auto ask = [&](const char* question) {
    LongOpening database;
    OneQuestion control(question);
    const Ports asked{plc, pose, scanner, nullptr, &control, clock, notify};
    Loop loop(asked, StationSettings{}, database.opener(), std::make_unique<IdleWorkers>(), LoopFigures{});
    loop.start();
    loop.turn(0);
    EXPECT_TRUE(loop.is_opening());
    database.finish = true;
    open(loop);
    loop.finish();
    return control.answer;
  };
  EXPECT_NE(ask(R"({"verb":"status"})").find(R"("state":"recover")"), std::string::npos);
  const std::string figures = ask(R"({"verb":"metrics"})");
  EXPECT_NE(figures.find(R"("schema":"slabd.metrics/1")"), std::string::npos) << figures;
  EXPECT_NE(figures.find("slabd_store_ok 0"), std::string::npos) << figures;
  for (const char* question :
       {R"({"verb":"backup"})", R"({"verb":"calibration"})", R"({"verb":"recipes","reload":true})",
        R"({"verb":"calibration_change","file":"x"})", R"({"verb":"capture","action":"begin"})"})
    EXPECT_NE(ask(question).find("repeat the request"), std::string::npos) << question;
}

TEST_F(LoopStart, a_reload_of_the_recipes_in_a_fault_is_refused_with_its_cause_and_cure) {
  const auto refusal = [&](const StationSettings& settings, Code reading) {
    Database database;
    database.reading = reading;
    RecipeWatch watch(places::source_dir() + "/recipes", std::make_shared<RecipeSet>(), 5);
    Ports watched = ports;
    watched.recipes = &watch;
    Loop loop(watched, settings, opener(database), std::make_unique<IdleWorkers>(), LoopFigures{});
    loop.start();
    open(loop);
    EXPECT_TRUE(watch.order_reload());
    for (int i = 0; i < 3'000 && watch.reload() != RecipeWatch::Reload::refused; ++i) loop.turn(10);
    loop.finish();
    EXPECT_EQ(watch.reload(), RecipeWatch::Reload::refused);
    return std::string(watch.reload_text().view());
  };
  EXPECT_EQ(refusal({}, Code::store_full),
            "slabd is in fault 501 (a disk is full, or has no room for two more slabs); try again when it is cleared: "
            "free space on the disk of the scans or of the database; `journalctl -u slabd` shows which");
  EXPECT_EQ(refusal({}, Code::journal_write),
            "slabd is in fault 502 (the database or the spool of scans could not be written, or the database is "
            "damaged or not there); try again when it is cleared: `slabctl status` and `journalctl -u slabd` say "
            "which; check the disk and its mount, then reset the fault")
      << "the steps of the cure that fit";
  EXPECT_EQ(refusal({}, Code::busy),
            "slabd is in fault 504 (the configuration is not usable); try again when it is cleared: run `slabctl "
            "config check`; it names file and line")
      << "another daemon works with the folder, and may end";
  StationSettings settings;
  settings.fault = Code::config;
  EXPECT_EQ(refusal(settings, Code::ok),
            "slabd is in fault 504 (the configuration is not usable), which only a restart clears: run `slabctl "
            "config check`; it names file and line");
}

/// Under a service manager stderr is a stream that the journal reads.
[[noreturn]] void talk_to_a_journal_that_does_not_read() {
  std::array<int, 2> ends{};
  struct stat there {};
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0 || fstat(ends[0], &there) != 0) std::_Exit(2);
  dup2(ends[0], STDERR_FILENO);
  const std::string stream = std::to_string(there.st_dev) + ":" + std::to_string(there.st_ino);
  setenv("JOURNAL_STREAM", stream.c_str(), 1);
  LogLine line;
  line.text = "one of many";
  for (int i = 0; i < 20'000; ++i) say_line(line);
  std::_Exit(0);
}

TEST(SayLine, does_not_block_on_a_journal_that_does_not_read) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(talk_to_a_journal_that_does_not_read(), ::testing::ExitedWithCode(0), "");
}

TEST(SayLine, a_name_of_a_file_cannot_make_lines_of_its_own) {
  unsetenv("JOURNAL_STREAM");
  LogLine line;
  line.text = "inbox/a\nerror: slabd: [502] \x1b[2J\xc2\x9b\xff\xe8\xbd\xa8 was moved";
  ::testing::internal::CaptureStderr();
  say_line(line);
  EXPECT_EQ(::testing::internal::GetCapturedStderr(),
            "info: slabd: inbox/a?error: slabd: [502] ?[2J??\xe8\xbd\xa8 was moved\n");
  line.text.clear();
  while (line.text.size() < line.text.capacity()) line.text.append("\xe8\xbd\xa8");
  ::testing::internal::CaptureStderr();
  say_line(line);
  const std::string said = ::testing::internal::GetCapturedStderr();
  EXPECT_TRUE(said.ends_with("\xe8\xbd\xa8??\n")) << "320 bytes end within a character";
}

}  // namespace
}  // namespace slabd::daemon
