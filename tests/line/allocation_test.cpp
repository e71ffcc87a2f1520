// SPDX-License-Identifier: Apache-2.0
//
// After the start no step from a trigger to a verdict uses the heap. Each step is run once to warm up and then counted;
// the first tests show that the counter works.
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <thread>
#include <vector>

#include "config/config.h"
#include "daemon/worker.h"
#include "emulator/scan_drawing.h"
#include "hal/plc/plc_map.h"
#include "heap_count.h"
#include "tests/daemon/station/station_line.h"

#include "algo/algo.h"
#include "daemon/measure.h"
#include "slabd/flange_pose_t.hpp"
#include "tests/places/places.h"
#include "tests/places/wait.h"

namespace slabd {
namespace {

namespace fs = std::filesystem;

Recipe p5600() {
  Recipe recipe;
  std::vector<config::Problem> problems;
  config::load_recipe(places::source_dir() + "/recipes/p5600.toml", recipe, problems);
  EXPECT_TRUE(problems.empty());
  return recipe;
}

/// A folder that is removed with the test.
struct TempDir {
  fs::path path = fs::temp_directory_path() / ("slabd-alloc-" + std::to_string(::getpid()));
  TempDir() { fs::create_directories(path); }
  ~TempDir() { fs::remove_all(path); }
};

/// A scan of the nominal block on disk, a quarter of the real size.
fs::path scan_file(const TempDir& dir, const Recipe& recipe, std::uint64_t seed) {
  const auto surface =
      emulator::BlockSurface::make(recipe, emulator::nominal_truth(recipe), nominal_T_block_scanner().inverse());
  EXPECT_TRUE(surface.ok());
  emulator::ScannerTraits traits;
  traits.columns = 1024;
  traits.rows = 1224;
  std::vector<float> xyz;
  const emulator::DrawnScan scan = emulator::draw_scan(surface.value(), traits, seed, xyz);
  const fs::path path = dir.path / (std::to_string(seed) + ".ply");
  EXPECT_TRUE(hal::write_ply(path.c_str(), xyz, scan.width, scan.height).ok());
  return path;
}

TEST(HeapCount, counts_an_allocation) {
  HeapCount count;
  EXPECT_EQ(count.calls(), 0U);
  const auto* const one = new std::vector<int>(3);
  EXPECT_EQ(count.calls(), 2U);
  delete one;
  void* two = std::malloc(8);
  two = std::realloc(two, 80'000);
  EXPECT_EQ(count.calls(), 4U);
  std::free(two);
}

TEST(HeapCount, includes_another_thread_if_enabled) {
  std::atomic<bool> go{false};
  std::thread other([&] {
    if (!places::wait_until([&] { return go.load(); })) return;
    void* volatile one = std::malloc(100);
    std::free(one);
    go = false;
  });
  const auto wait_for_other = [&] {
    go = true;
    return places::wait_until([&] { return !go; });
  };
  const HeapCount count(HeapCount::Of::every_thread);
  EXPECT_EQ(count.calls(), 0U);
  const bool has_allocated = wait_for_other();
  EXPECT_GE(count.calls(), 1U);
  EXPECT_TRUE(has_allocated) << "the other thread has not run";
  other.join();
}

TEST(HeapCount, counts_an_allocation_inside_a_measurement) {
  HeapCount count;
  std::string grows = "a worker that logs by std::string would look like this";
  grows += " and be found";
  EXPECT_GT(count.calls(), 0U);
}

TEST(Allocation, none_from_scan_file_to_block_verdict) {
  const Recipe recipe = p5600();
  const TempDir dir;
  const fs::path first = scan_file(dir, recipe, 1);
  const fs::path second = scan_file(dir, recipe, 2);
  const auto clock = hal::make_system_clock();
  algo::BlockInspector inspector(2);
  inspector.use(recipe);
  std::vector<float> buffer(limits::kScanPointsMax * 3);
  Verdict verdict = Verdict::none;
  BlockMaps maps;
  const auto measure = [&](const fs::path& path) {
    const Result<ScanShape> shape = hal::read_scan(path.c_str(), hal::LengthUnit::mm, buffer);
    if (!shape.ok()) return;
    algo::Cloud cloud{buffer, shape.value().points, shape.value().width, shape.value().height};
    const Status status = daemon::measure_block(inspector, *clock, 1, Pose::identity(), nominal_T_block_scanner(),
                                                cloud, shape.value(), 0.0);
    verdict = status.ok() ? inspector.result().verdict : Verdict::none;
    daemon::pack_maps(inspector, maps);
  };
  measure(first);
  {
    const HeapCount count(HeapCount::Of::every_thread);
    inspector.use(recipe);
    measure(second);
    EXPECT_EQ(count.calls(), 0U);
  }
  EXPECT_EQ(verdict, Verdict::pass);
  // The packed maps can be drawn: most of the crop was seen, and it is as flat as the block.
  const std::optional<std::vector<float>> seat = unpack_map(maps.seat);
  ASSERT_TRUE(seat.has_value());
  std::size_t seen = 0;
  for (const float height_mm : *seat) {
    if (std::isnan(height_mm)) continue;
    ++seen;
    EXPECT_LT(std::abs(height_mm), 0.1F);
  }
  EXPECT_EQ(seen, inspector.result().seat.grid_points) << "the cells of the map are those of flatness";
  EXPECT_EQ(maps.seat.step_mm, limits::kSeatMapStep_mm) << "an ordinary map must not need a wider step";
  EXPECT_EQ(maps.registration.step_mm, limits::kDeviationMapStep_mm);
  EXPECT_TRUE(unpack_map(maps.registration).has_value());
  RecordProperty("registration_bytes", static_cast<int>(maps.registration.bytes.size()));
  RecordProperty("seat_bytes", static_cast<int>(maps.seat.bytes.size()));
}

TEST(Allocation, none_when_the_slab_is_judged) {
  const Recipe recipe = p5600();
  std::vector<BlockResult> blocks(recipe.stations());
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const Pose T = T_slab_block(recipe, static_cast<int>(i + 1));
    blocks[i].station = static_cast<std::uint8_t>(i + 1);
    blocks[i].verdict = Verdict::pass;
    blocks[i].observation.ok = true;
    blocks[i].observation.p_base = T.translation_mm;
    blocks[i].observation.n_base = T.rotation * Vec3(0, -0.025, 1).normalized();
  }
  SlabResult result;
  HeapCount count;
  algo::inspect_slab(recipe, blocks, {0.02, 1e-5}, Pose::identity(), result);
  EXPECT_EQ(count.calls(), 0U);
  EXPECT_GT(result.items.size(), 0U);
}

/// Heap calls of the steps of a line. The line calls plain functions, so there is one counter.
struct CountedSteps {
  explicit CountedSteps(daemon::Line& line) {
    calls = 0;
    line.before_step = [] { counting = std::make_unique<HeapCount>(); };
    line.after_step = [] {
      calls += counting->calls();
      counting.reset();
    };
  }
  inline static std::uint64_t calls = 0;
  inline static std::unique_ptr<HeapCount> counting;
};

TEST(Allocation, none_in_the_cycle_of_a_whole_slab) {
  daemon::MemoryStore store;
  daemon::Line line(store);
  const CountedSteps steps(line);
  line.run_for(300);
  line.command(PlcCommand::slab_begin);
  for (int station = 1; station <= 18; ++station) {
    line.scan(station);
    line.take_results();
  }
  line.command(PlcCommand::slab_end);
  line.run_for(40);
  EXPECT_EQ(line.view().slab_verdict, Verdict::pass);
  EXPECT_EQ(CountedSteps::calls, 0U);
}

TEST(Allocation, none_in_the_cycle_of_a_slab_by_two_robots) {
  daemon::MemoryStore store;
  CellCalibration& calibration = store.line.calibration;
  for (std::size_t arm = 0; arm < 2; ++arm) {
    calibration.arm[arm].source = LineCalibration::Source::applied;
    calibration.arm[arm].id = arm == 0 ? "he-1" : "he-2";
    calibration.arm[arm].hand_eye.sigma_mm = 0.02;
    calibration.arm[arm].hand_eye.sigma_rad = 1e-5;
    calibration.tie.hand_eye_id[arm] = calibration.arm[arm].id;
  }
  calibration.tie.id = "ti-1";
  calibration.tie.numbers.robot = "2";
  calibration.tie.numbers.T_base_robot = Pose::identity();
  daemon::Line line(store);
  line.T_base_robot_2 = Pose::identity();
  LineArms& arms = line.settings.arms;
  ASSERT_TRUE(arms.list.push(Arm{PartId("2"), PartId("2")}));
  for (std::size_t i = 9; i < arms.of_station.size(); ++i) {
    arms.of_station[i].clear();
    ASSERT_TRUE(arms.of_station[i].push(1));
  }
  ASSERT_TRUE(line.settings.more_arms.push(daemon::StationArmSettings{}));
  line.start();
  const CountedSteps steps(line);
  line.run_for(300);
  line.command(PlcCommand::slab_begin);
  for (int station = 1; station <= 18; ++station) {
    if (station < 10) {
      line.scan(station);
    } else {
      line.robot_2_station = station;
      line.run_for(600);
      line.command(PlcCommand::scan, station);
      line.run_for(1'000);
    }
    line.take_results();
  }
  line.command(PlcCommand::slab_end);
  line.run_for(40);
  EXPECT_EQ(line.view().slab_verdict, Verdict::pass);
  EXPECT_EQ(store.line.slab.more_arms.size(), 1U);
  EXPECT_EQ(CountedSteps::calls, 0U);
}

TEST(Allocation, none_when_a_pose_is_decoded) {
  slabd::flange_pose_t pose{};
  pose.quat[0] = 1.0;
  std::vector<std::byte> datagram(8 + sizeof "FLANGE_POSE" + static_cast<std::size_t>(pose.getEncodedSize()));
  const unsigned char magic[] = {0x4c, 0x43, 0x30, 0x32, 0, 0, 0, 1};
  std::memcpy(datagram.data(), magic, sizeof magic);
  std::memcpy(datagram.data() + 8, "FLANGE_POSE", sizeof "FLANGE_POSE");
  pose.encode(datagram.data(), 8 + sizeof "FLANGE_POSE", pose.getEncodedSize());
  PoseSample sample;
  hal::PoseLinkCounters counters;
  HeapCount count;
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(hal::decode_pose_datagram(datagram, "FLANGE_POSE", sample, counters));
  EXPECT_EQ(count.calls(), 0U);
}

TEST(Allocation, none_when_the_scanner_answers) {
  const Recipe recipe = p5600();
  const TempDir dir;
  const fs::path scan = scan_file(dir, recipe, 3);
  const auto clock = hal::make_system_clock();
  hal::ScanDropSettings settings;
  settings.drop_dir = std::string_view((dir.path / "drop").native());
  fs::create_directories(dir.path / "drop");
  auto scanner = hal::make_scan_drop(settings, *clock);
  ASSERT_TRUE(scanner.ok());
  scanner.value()->idle();
  ASSERT_TRUE(scanner.value()->online());
  std::vector<float> buffer(limits::kScanPointsMax * 3);
  const std::atomic<bool> cancel{false};
  for (std::uint16_t seq = 1; seq <= 2; ++seq) {
    std::thread dropper([&] {
      const fs::path request = dir.path / "drop/request" / ("1-" + std::to_string(seq) + ".json");
      ASSERT_TRUE(places::wait_until([&] { return fs::exists(request); })) << "there is no request " << request;
      const fs::path inbox = dir.path / "drop/inbox";
      fs::copy_file(scan, inbox / "writing.tmp");
      fs::rename(inbox / "writing.tmp", inbox / ("1-" + std::to_string(seq) + ".ply"));
    });
    ScanRequest request;
    request.session = 1;
    request.cmd_seq = seq;
    request.station = 1;
    request.spool_path.printf("%s/spool/%u", dir.path.c_str(), seq);
    const HeapCount count;
    const auto acquired = scanner.value()->acquire(request, buffer, cancel, [](const AcquiredScan&) {});
    const std::uint64_t calls = count.calls();
    dropper.join();
    ASSERT_TRUE(acquired.ok()) << acquired.error().text.c_str();
    EXPECT_TRUE(seq == 1 || calls == 0) << calls;
  }
}

TEST(Allocation, none_when_the_plc_image_is_served) {
  PlcOutputs outputs;
  hal::InputImage image{};
  hal::HoldingImage holding{};
  HeapCount count;
  hal::encode_outputs(outputs, hal::WordOrder::abcd, image);
  const PlcInputs inputs = hal::decode_inputs(holding, hal::WordOrder::abcd);
  EXPECT_EQ(inputs.cmd_seq, 0);
  EXPECT_EQ(count.calls(), 0U);
}

TEST(Allocation, none_in_a_workers_queues) {
  struct Big {
    std::array<double, 100> payload{};
  };
  std::atomic<std::uint64_t> on_thread{0};
  daemon::Worker<Big, Big, 4> worker(
      "test",
      [&](const Big& job) {
        const HeapCount count;
        Big done = job;
        on_thread += count.calls();
        return done;
      },
      [] {});
  ASSERT_TRUE(worker.push({}));
  worker.drain();
  HeapCount count;
  ASSERT_TRUE(worker.push({}));
  worker.drain();
  Big done;
  EXPECT_TRUE(worker.next(done));
  EXPECT_EQ(count.calls(), 0U);
  EXPECT_EQ(on_thread, 0U);
}

}  // namespace
}  // namespace slabd
