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

#include "daemon/crew.h"
#include "daemon/loop.h"
#include "daemon/opening.h"
#include "tests/mock/mock.h"

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

/// Counts calls during the recovery at the start. The recovery takes as long as some idle calls of a worker.
class SlowStore final : public storage::Store {
 public:
  /// `reading`: result of the recovery.
  explicit SlowStore(Code reading) : reading_(reading) {}

  Result<std::unique_ptr<RecoveredLine>> recover() override {
    recovering_ = true;
    std::this_thread::sleep_for(std::chrono::milliseconds(350));
    recovering_ = false;
    if (reading_ != Code::ok) return error(reading_, "cannot be read");
    return std::make_unique<RecoveredLine>();
  }
  Status apply(const StoreJob& /*job*/) override { return success(); }
  Result<std::string> change(const storage::CalibrationChange& /*change*/) override {
    return error(Code::config, "not here");
  }
  Result<std::unique_ptr<LineCalibration>> calibration() override { return error(Code::config, "not here"); }
  void idle() override {
    ++idles;
    if (recovering_) ++idles_while_recovering;
  }

  Status order(const storage::CareOrder& /*order*/) override { return error(Code::config, "not here"); }
  storage::CareState care() const override { return {}; }

  std::atomic<int> idles{0};
  std::atomic<int> idles_while_recovering{0};

 private:
  Code reading_;
  std::atomic<bool> recovering_{false};
};

/// Counts readings of the clock: at least one in each turn of the loop.
class CountingClock final : public hal::Clock {
 public:
  [[nodiscard]] std::int64_t mono_ns() const override {
    ++looks_;
    return clock_.mono_ns();
  }
  [[nodiscard]] std::int64_t utime_us() const override { return clock_.utime_us(); }
  void advance(std::int64_t ns) { clock_.advance(ns); }
  /// For another thread than the loop's: waits until the loop has turned some times.
  void let_turn() const {
    const int before = looks_;
    EXPECT_TRUE(comes([this, before] { return looks_ >= before + 8; })) << "the loop has not turned within 30 s";
  }

 private:
  hal::ManualClock clock_;
  mutable std::atomic<int> looks_{0};
};

/// Real threads and queues, but without measuring.
class IdleCrew final : public Crew {
 public:
  std::unique_ptr<StoreQueue> storage(std::function<StoreDone(const StoreTask&)> work,
                                      std::function<void()> idle) override {
    return std::make_unique<Worker<StoreTask, StoreDone, limits::kWorkerQueue>>("store", std::move(work),
                                                                                std::move(idle));
  }
  std::unique_ptr<ScanQueue> scanner(std::function<ScanDone(const AcquireScan&)> work,
                                     std::function<void()> idle) override {
    return std::make_unique<Worker<AcquireScan, ScanDone, 4>>("scan", std::move(work), std::move(idle));
  }
  std::unique_ptr<MeasureQueue> measuring() override {
    return std::make_unique<Worker<MeasureBlock, BlockMeasured, 4>>(
        "measure", [](const MeasureBlock&) { return BlockMeasured{}; }, [] {});
  }
  std::span<float> slot(std::size_t /*index*/) override { return points_; }
  std::optional<std::uint32_t> points_crc32c(const AcquiredScan& /*scan*/) override { return std::nullopt; }

 private:
  std::vector<float> points_ = std::vector<float>(3);
};

struct LoopStart : ::testing::Test {
  CountingClock clock;
  hal::MockNotify notify;
  hal::MockPlc plc;
  hal::MockPose pose;
  hal::MockScanner scanner{clock};

  /// Starts a loop on `store` and turns it for half a second, and until it was idle `idle` times.
  void live(SlowStore& store, int idle) {
    const Ports ports{plc, pose, scanner, &store, nullptr, clock, notify};
    Loop loop(ports, StationSettings{}, std::make_unique<IdleCrew>(), LoopFigures{});
    loop.start();
    for (int i = 0; i < 50 || (i < 6'000 && store.idles < idle); ++i) loop.turn(10);
    loop.finish();
  }
};

TEST_F(LoopStart, no_other_access_to_the_database_occurs_while_it_is_read) {
  SlowStore store(Code::ok);
  live(store, 1);
  EXPECT_EQ(store.idles_while_recovering, 0);
  EXPECT_GT(store.idles, 0) << "afterwards the storage thread looks after it";
}

TEST_F(LoopStart, a_database_that_could_not_be_read_is_left_alone) {
  SlowStore store(Code::journal_write);
  live(store, 0);
  EXPECT_EQ(store.idles, 0);
}

TEST_F(LoopStart, storage_that_cannot_be_used_is_a_fault_that_says_why_and_is_tried_again) {
  for (const auto& [reading, fault] :
       {std::pair{Code::store_full, Code::store_full}, std::pair{Code::journal_write, Code::journal_write},
        std::pair{Code::config, Code::journal_write}, std::pair{Code::internal, Code::journal_write}}) {
    EXPECT_EQ(fault_without_store(error(reading, "why")), fault);
    SlowStore store(reading);
    const Ports ports{plc, pose, scanner, &store, nullptr, clock, notify};
    Loop loop(ports, StationSettings{}, std::make_unique<IdleCrew>(), LoopFigures{});
    loop.start();
    loop.turn(0);
    EXPECT_EQ(plc.published.back().fault, static_cast<int>(fault));
    EXPECT_FALSE(plc.published.back().store_ok);
    EXPECT_FALSE(loop.wants_store(5 * kNsPerS));
    clock.advance(5 * kNsPerS);
    EXPECT_TRUE(loop.wants_store(5 * kNsPerS)) << "fault " << static_cast<int>(fault);
    loop.finish();
  }
}

TEST_F(LoopStart, storage_is_not_tried_again_for_a_fault_reset_that_is_held_down) {
  SlowStore store(Code::journal_write);
  bool held = false;
  const Ports ports{plc, pose, scanner, &store, nullptr, clock, notify, &held};
  const auto write = [this](bool fault_reset) {
    PlcInputs image;
    image.fault_reset = fault_reset;
    plc.write(image);
  };
  const auto wants_store_after = [&](bool fault_reset) {
    Loop loop(ports, StationSettings{}, std::make_unique<IdleCrew>(), LoopFigures{});
    loop.start();
    write(fault_reset);
    write(fault_reset);
    loop.turn(0);
    const bool wants = loop.wants_store(5 * kNsPerS);
    loop.finish();
    return wants;
  };
  EXPECT_TRUE(wants_store_after(true)) << "an edge";
  EXPECT_FALSE(wants_store_after(true)) << "still down, as the next loop learns from the one before";
  const auto open_in_vain = [&] {
    static_cast<void>(open_beside_the_line(
        [this]() -> Result<std::unique_ptr<storage::Store>> {
          clock.let_turn();
          return error(Code::journal_write, "not yet");
        },
        ports, StationSettings{}, LoopFigures{}, std::atomic<bool>{false}));
  };
  write(false);  // released while the database is opened
  open_in_vain();
  EXPECT_TRUE(wants_store_after(true)) << "an edge again";
  open_in_vain();
  EXPECT_FALSE(wants_store_after(true)) << "held all the time";
  write(false);
  write(true);
  open_in_vain();
  EXPECT_TRUE(wants_store_after(true)) << "pressed while the database was opened";
  EXPECT_FALSE(wants_store_after(true)) << "once";
}

TEST(Fingerprint, sees_x_y_and_z_of_scans_of_every_size) {
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
  std::atomic<bool> stop{false};
  std::atomic<bool> finish{false};
  const Ports ports{plc, pose, scanner, nullptr, nullptr, clock, notify};
  std::atomic<bool> returned{false};
  std::unique_ptr<Result<std::unique_ptr<storage::Store>>> opened;
  std::thread waiting([&] {
    opened = open_beside_the_line(
        [&]() -> Result<std::unique_ptr<storage::Store>> {
          EXPECT_TRUE(comes([&] { return finish.load(); })) << "the test has not ended within 30 s";
          return std::unique_ptr<storage::Store>(std::make_unique<SlowStore>(Code::ok));
        },
        ports, StationSettings{}, LoopFigures{}, stop);
    returned = true;
  });
  clock.let_turn();
  EXPECT_FALSE(returned);
  finish = true;
  const bool ended = comes([&] { return returned.load(); });
  stop = true;
  waiting.join();
  ASSERT_TRUE(ended) << "the loop has not taken the opened database within 30 s";
  ASSERT_TRUE(opened != nullptr && opened->ok());
  ASSERT_FALSE(plc.published.empty());
  EXPECT_EQ(plc.published.back().state, PlcState::recover);
  EXPECT_FALSE(plc.published.back().ready);
  EXPECT_FALSE(plc.published.back().store_ok);
  EXPECT_EQ(plc.published.back().slab_verdict, Verdict::none);
}

/// Sends one request after `looks` turns without one, and stores the answer.
class OneQuestion final : public hal::ControlPort {
 public:
  explicit OneQuestion(std::string question, int looks = 0) : question_(std::move(question)), looks_(looks) {}
  std::size_t poll_fds(std::span<pollfd> /*fds*/) override { return 0; }
  bool next(std::int64_t /*mono_ns*/, std::string_view& line) override {
    if (asked_ || looks_-- > 0) return false;
    asked_ = true;
    line = question_;
    return true;
  }
  void reply(std::string_view json) override { answer = json; }
  std::uint32_t peer_uid() const override { return kUidUnknown; }

  std::string answer;

 private:
  std::string question_;
  int looks_;
  bool asked_ = false;
};

TEST_F(LoopStart, a_recovery_that_failed_is_in_the_status_with_its_reason) {
  SlowStore store(Code::journal_write);
  OneQuestion control(R"({"verb":"status"})", 5);
  const Ports ports{plc, pose, scanner, &store, &control, clock, notify};
  Loop loop(ports, StationSettings{}, std::make_unique<IdleCrew>(), LoopFigures{});
  loop.start();
  for (int i = 0; i < 20; ++i) loop.turn(10);  // the session's job succeeds without a database
  loop.finish();
  EXPECT_NE(control.answer.find(R"("text":"cannot be read")"), std::string::npos) << control.answer;
}

TEST_F(LoopStart, state_and_figures_are_reported_while_the_database_is_opened) {
  const auto ask = [&](const char* question) {
    OneQuestion control(question);
    const Ports ports{plc, pose, scanner, nullptr, &control, clock, notify};
    static_cast<void>(open_beside_the_line(
        [this]() -> Result<std::unique_ptr<storage::Store>> {
          clock.let_turn();
          return error(Code::journal_write, "not yet");
        },
        ports, StationSettings{}, LoopFigures{}, std::atomic<bool>{false}));
    return control.answer;
  };
  EXPECT_NE(ask(R"({"verb":"status"})").find(R"("state":"recover")"), std::string::npos);
  const std::string figures = ask(R"({"verb":"metrics"})");
  EXPECT_NE(figures.find(R"("schema":"slabd.metrics/1")"), std::string::npos) << figures;
  EXPECT_NE(figures.find("slabd_store_ok 0"), std::string::npos) << figures;
  EXPECT_NE(ask(R"({"verb":"backup"})").find("ask again"), std::string::npos);
}

TEST_F(LoopStart, stopping_does_not_wait_for_the_database) {
  const std::atomic<bool> stop{true};
  const Ports ports{plc, pose, scanner, nullptr, nullptr, clock, notify};
  const auto finish = std::make_shared<std::atomic<bool>>(false);
  const auto opened = open_beside_the_line(
      [finish]() -> Result<std::unique_ptr<storage::Store>> {
        (void)comes([&] { return finish->load(); });
        return error(Code::journal_write, "no client left");
      },
      ports, StationSettings{}, LoopFigures{}, stop);
  EXPECT_EQ(opened, nullptr);
  *finish = true;
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
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
