// SPDX-License-Identifier: Apache-2.0
//
// The daemon's own loop, with its real workers, algorithms and database, on scripted ports: one whole slab without a
// socket, and with time advanced by the test.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <functional>

#include "algo/algo.h"
#include "daemon/loop.h"
#include "emulator/scan_drawing.h"
#include "tests/mock/mock.h"
#include "tests/places/places.h"

namespace slabd::daemon {
namespace {

namespace fs = std::filesystem;

const algo::StationSigma kSigma{0.02, rad_from_deg(0.001), 0.017, rad_from_deg(0.001)};

struct MockLineTest : testing::Test {
  fs::path dir = fs::temp_directory_path() / ("slabd-mock-" + std::to_string(::getpid()));
  const char* recipe_file = "p5600.toml";
  std::vector<Recipe> recipes{1};
  hal::ManualClock clock;
  hal::MockNotify notify;
  hal::MockPlc plc;
  hal::MockPose pose;
  hal::MockScanner scanner{clock};
  const Ports ports{plc, pose, scanner, nullptr, nullptr, clock, notify};
  StationSettings settings;
  std::unique_ptr<Loop> loop;
  PlcInputs inputs;
  std::int32_t pose_seq = 0;
  int robot_station = 1;

  void SetUp() override {
    fs::remove_all(dir);
    fs::create_directories(dir / "spool/1");  // the scripted scanner writes there and does not make folders
    std::vector<config::Problem> problems;
    config::load_recipe(places::source_dir() + "/recipes/" + recipe_file, recipes[0], problems);
    ASSERT_TRUE(problems.empty()) << problems[0].text;
    settings.recipes = recipes;
    settings.calibration_id = "test";
    settings.spool_dir = std::string_view((dir / "spool").native());
    settings.splice.commissioning_mm = kSigma.position_mm;
    settings.splice.commissioning_rad = kSigma.rotation_rad;
    settings.splice.repeatability_mm = kSigma.robot_position_mm;
    settings.splice.repeatability_rad = kSigma.robot_rotation_rad;
    make_loop([this](std::atomic<bool>&) {
      return storage::open_store({(dir / "slabd.db").native(), (dir / "spool").native(), 0});
    });
    inputs.enable = true;
    inputs.command_writer = 1;
    inputs.slab_no = 4711;
    inputs.slab_type = recipes[0].slab_type;
  }
  void TearDown() override {
    loop.reset();
    fs::remove_all(dir);
  }

  /// Starts a loop and turns it until the store is open, or cannot be opened.
  void make_loop(const StoreOpener& opener) {
    loop.reset();
    ScanForms forms;
    ASSERT_TRUE(forms.push(hal::LengthUnit::mm));
    loop = std::make_unique<Loop>(ports, settings, opener, forms, 2, LoopFigures{});
    loop->start();
    open();
  }
  void open() const {
    for (int i = 0; i < 30'000 && loop->is_opening(); ++i) loop->turn(1);
    ASSERT_FALSE(loop->is_opening());
  }

  void answer_scan(const emulator::BlockTruth& truth, std::uint64_t seed) {
    const auto surface = emulator::BlockSurface::make(recipes[0], truth, nominal_T_block_scanner().inverse());
    ASSERT_TRUE(surface.ok());
    emulator::ScannerTraits traits;
    traits.columns = 1024;
    traits.rows = 1224;
    std::vector<float> xyz;
    const emulator::DrawnScan scan = emulator::draw_scan(surface.value(), traits, seed, xyz);
    scanner.answer_with(std::move(xyz), scan.width, scan.height);
  }

  /// Runs turns of 4 ms of scripted time until `done`, at most `turns`.
  bool turn_until(const std::function<bool()>& done, int turns = 20'000) {
    for (int i = 0; i < turns; ++i) {
      if (done()) return true;
      clock.advance(4 * kNsPerMs);
      PoseSample sample;
      sample.arrival_ns = clock.mono_ns();
      sample.utime_us = clock.utime_us();
      sample.seq = ++pose_seq;
      sample.T_base_flange = T_slab_block(recipes[0], robot_station) * nominal_T_block_scanner();
      pose.push(sample);
      if (i % 60 == 0) {
        ++inputs.heartbeat;
        plc.write(inputs);
      }
      loop->turn(1);
    }
    return done();
  }
  PlcOutputs view() const { return plc_view(loop->station()); }

  bool command(PlcCommand what, int station = 0) {
    EXPECT_TRUE(turn_until([&] { return view().plc_link_ok; }));
    inputs.command = static_cast<std::uint16_t>(what);
    inputs.station = static_cast<std::uint16_t>(station);
    inputs.session_echo = view().session;
    inputs.cmd_seq = next_sequence(view().cmd_ack);
    plc.write(inputs);
    return turn_until([&] { return view().cmd_ack == inputs.cmd_seq; });
  }
  bool scan(int station) {
    robot_station = station;
    return command(PlcCommand::scan, station) &&
           turn_until([&] { return view().acq_seq == inputs.cmd_seq || view().cmd_status >= kCommandFailed; }) &&
           view().acq_seq == inputs.cmd_seq;
  }
  void take_a_whole_slab() {
    ASSERT_TRUE(turn_until([&] { return view().session != 0; }));
    ASSERT_TRUE(command(PlcCommand::slab_begin));
    for (int station = 1; station <= recipes[0].stations(); ++station) {
      answer_scan(emulator::nominal_truth(recipes[0]), static_cast<std::uint64_t>(station));
      ASSERT_TRUE(scan(station)) << station << " status " << view().cmd_status;
      take_result();
    }
    ASSERT_TRUE(command(PlcCommand::slab_end));
    ASSERT_TRUE(turn_until([&] { return !view().slab_open; }));
  }
  storage::SlabRecord stored_slab() {
    auto reader = storage::open_reader((dir / "slabd.db").native());
    EXPECT_TRUE(reader.ok()) << reader.error().text.c_str();
    if (!reader.ok()) return {};
    auto record = reader.value()->slab(1);
    EXPECT_TRUE(record.ok() && record.value().has_value());
    return record.ok() && record.value() ? *record.value() : storage::SlabRecord{};
  }
  void take_result() {
    ASSERT_TRUE(turn_until([&] { return view().record.res_seq != 0; }));
    inputs.res_ack = view().record.res_seq;
    plc.write(inputs);
    turn_until([&] { return view().record.res_seq != inputs.res_ack; }, 100);
  }
};

TEST_F(MockLineTest, takes_a_slab_to_pass_and_leaves_it_in_the_database) {
  take_a_whole_slab();
  EXPECT_EQ(view().slab_verdict, Verdict::pass) << view().slab_reason;

  const storage::SlabRecord record = stored_slab();
  EXPECT_EQ(record.summary.verdict, Verdict::pass);
  EXPECT_EQ(record.summary.header.slab_no, 4711U);
  EXPECT_EQ(record.summary.stations_measured, 18);
}

struct MockLineOfP4925 : MockLineTest {
  MockLineOfP4925() { recipe_file = "p4925.toml"; }
};

TEST_F(MockLineOfP4925, a_slab_of_eight_pairs_passes_with_its_own_nominals) {
  take_a_whole_slab();
  EXPECT_EQ(view().slab_verdict, Verdict::pass) << view().slab_reason;
  EXPECT_EQ(view().stations_done, 16);
  for (const std::size_t row : {16U, 17U}) EXPECT_EQ(view().table[row].verdict, Verdict::none);

  const storage::SlabRecord record = stored_slab();
  EXPECT_EQ(record.summary.stations_measured, 16);
  EXPECT_EQ(record.slab.fit.seats, 16);
  int spacings = 0;
  for (const Item& item : record.slab.items) {
    EXPECT_LE(item.station, 16);
    EXPECT_LE(item.station_to, 16);
    if (item.id != ItemId::seat_spacing) continue;
    ++spacings;
    EXPECT_NEAR(item.value, 617.0, 0.05) << item.station;
  }
  EXPECT_EQ(spacings, 14);
}

/// NaN equals NaN.
bool same(double a, double b) {
  return a == b || (std::isnan(a) && std::isnan(b));
}

TEST_F(MockLineOfP4925, judging_what_the_database_holds_gives_the_verdict_that_was_given) {
  take_a_whole_slab();
  const storage::SlabRecord record = stored_slab();
  std::array<BlockResult, 16> blocks;
  ASSERT_EQ(record.blocks.size(), blocks.size());
  for (const storage::SlabBlock& stored : record.blocks) blocks[stored.block.station - 1U] = stored.block;
  SlabResult again;
  algo::inspect_slab(recipes[0], blocks, kSigma, record.summary.header.T_base_slab, again);

  EXPECT_EQ(again.verdict, record.slab.verdict);
  EXPECT_EQ(again.station_verdict, record.slab.station_verdict);
  EXPECT_EQ(again.fit.T_base_slab.to_array(), record.slab.fit.T_base_slab.to_array());
  ASSERT_EQ(again.items.size(), record.slab.items.size());
  for (std::size_t i = 0; i < again.items.size(); ++i) {
    const Item& a = again.items[i];
    const Item& b = record.slab.items[i];
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.verdict, b.verdict) << info(a.id).name;
    EXPECT_TRUE(same(a.value, b.value)) << info(a.id).name << " " << a.value << " " << b.value;
    EXPECT_TRUE(same(a.U, b.U)) << info(a.id).name << " " << a.U << " " << b.U;
    for (std::size_t part = 0; part < kBudgetParts; ++part)
      EXPECT_EQ(a.budget[part], b.budget[part]) << info(a.id).name << " " << name(static_cast<BudgetPart>(part));
  }
}

TEST_F(MockLineTest, a_block_that_is_not_there_never_passes) {
  ASSERT_TRUE(turn_until([&] { return view().session != 0; }));
  ASSERT_TRUE(command(PlcCommand::slab_begin));
  emulator::BlockTruth nothing = emulator::nominal_truth(recipes[0]);
  nothing.present = false;
  answer_scan(nothing, 5);
  ASSERT_TRUE(scan(1));
  ASSERT_TRUE(turn_until([&] { return view().record.res_seq != 0; }));
  EXPECT_EQ(view().record.verdict, Verdict::not_measured);
  EXPECT_EQ(view().record.reason, 402);
  EXPECT_EQ(view().table[0].verdict, Verdict::not_measured);
}

TEST_F(MockLineTest, a_scanner_that_hangs_is_abandoned_on_abort) {
  ASSERT_TRUE(turn_until([&] { return view().session != 0; }));
  ASSERT_TRUE(command(PlcCommand::slab_begin));
  scanner.hang_until_cancelled();
  robot_station = 1;
  ASSERT_TRUE(command(PlcCommand::scan, 1));
  ASSERT_TRUE(turn_until([&] { return view().state == PlcState::scanning; }));
  inputs.abort = true;
  plc.write(inputs);
  ASSERT_TRUE(turn_until([&] { return view().cmd_status >= kCommandFailed; }));
  EXPECT_EQ(view().cmd_status, kCommandFailed + 110);
  EXPECT_TRUE(view().slab_open);
}

/// The disk fails at the start: the loop runs without a store, in fault 502, or 501 if it is full.
struct MockLineWhoseStoreFails : MockLineTest, testing::WithParamInterface<Code> {
  void SetUp() override {
    MockLineTest::SetUp();
    make_loop([this](std::atomic<bool>&) -> Result<std::unique_ptr<storage::Store>> {
      ++tries;
      if (!is_repaired) return error(GetParam(), "the disk failed");
      fs::create_directories(dir / "new/spool");
      return storage::open_store({(dir / "new/slabd.db").native(), (dir / "new/spool").native(), 0});
    });
  }
  std::atomic<int> tries{0};
  std::atomic<bool> is_repaired{false};
};
INSTANTIATE_TEST_SUITE_P(, MockLineWhoseStoreFails, testing::Values(Code::store_full, Code::journal_write),
                         [](const auto& code) { return "fault_" + std::to_string(static_cast<int>(code.param)); });

TEST_P(MockLineWhoseStoreFails, retries_the_store_after_a_delay_and_at_a_reset_of_the_fault) {
  EXPECT_EQ(view().fault, static_cast<int>(GetParam()));
  EXPECT_FALSE(view().store_ok);
  EXPECT_FALSE(view().ready);
  loop->turn(0);
  EXPECT_FALSE(loop->is_opening());
  clock.advance(5 * kNsPerS);
  loop->turn(0);
  open();
  EXPECT_EQ(tries, 2);
  clock.advance(5 * kNsPerS);
  loop->turn(0);
  EXPECT_FALSE(loop->is_opening()) << "each try waits longer";
  inputs.fault_reset = true;
  plc.write(inputs);
  loop->turn(0);
  loop->turn(0);
  open();
  EXPECT_EQ(tries, 3);
}

/// The command remains in the registers until the PLC writes another one, and the first session of a new database is 1.
TEST_P(MockLineWhoseStoreFails, a_command_refused_meanwhile_is_not_carried_out_when_the_database_is_available) {
  ASSERT_TRUE(turn_until([&] { return view().session != 0 && view().fault != 0; }));
  EXPECT_GT(view().session, 0x8000);
  ASSERT_TRUE(command(PlcCommand::slab_begin));
  ASSERT_EQ(view().cmd_status, kCommandFailed + static_cast<int>(GetParam()));

  is_repaired = true;
  clock.advance(5 * kNsPerS);
  loop->turn(0);
  open();
  for (int i = 0; i < 30'000 && view().session == 0; ++i) loop->turn(1);  // the PLC writes once the session is shown
  ASSERT_EQ(view().session, 1);
  EXPECT_FALSE(turn_until([&] { return view().slab_open; }, 200));
  EXPECT_EQ(view().fault, 0) << "nothing but the session keeps it from being carried out";
}

struct MockLineWithoutConfig : MockLineTest {
  void SetUp() override {
    MockLineTest::SetUp();
    settings.fault = Code::config;
    make_loop([this](std::atomic<bool>&) -> Result<std::unique_ptr<storage::Store>> {
      ++tries;
      return error(Code::journal_write, "not opened");
    });
  }
  std::atomic<int> tries{0};
};
TEST_F(MockLineWithoutConfig, a_faulty_configuration_is_not_retried) {
  inputs.fault_reset = true;
  plc.write(inputs);
  loop->turn(0);
  clock.advance(3600 * kNsPerS);
  loop->turn(0);
  EXPECT_EQ(view().fault, 504);
  EXPECT_FALSE(loop->is_opening());
  EXPECT_EQ(tries, 0);
}

}  // namespace
}  // namespace slabd::daemon
