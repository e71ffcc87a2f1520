// SPDX-License-Identifier: Apache-2.0
//
// The stages of one block and the floors with which they are compared.
//
// Measuring changes the scan (points off the surface become NaN), so each sample begins with a copy of the scan into
// the buffer of huge pages, which is not timed. The points are then where a scanner's driver or a decoder would have
// written them, which is called "warm". "Cold": a gigabyte of other memory was read in between.
#include "bench/stages.h"

#include <benchmark/benchmark.h>
#include <fmt/core.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <iostream>
#include <limits>
#include <memory>
#include <thread>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "base/pages.h"
#include "bench/floor.h"
#include "hal/hal.h"

namespace slabd::bench {
namespace {

constexpr std::size_t kScanFloats = 3 * limits::kScanPointsMax;
constexpr std::size_t kOtherFloats = std::size_t{1} << 28U;  // 1 GiB

/// A second thread that busy-waits for its half of a pass, because waking a sleeping thread would cost as much as the
/// pass.
class SecondThread {
 public:
  SecondThread() : thread_([this] { serve(); }) {}
  ~SecondThread() {
    state_ = kQuit;
    state_.notify_one();
    thread_.join();
  }
  SecondThread(const SecondThread&) = delete;
  SecondThread& operator=(const SecondThread&) = delete;

  /// Wakes the thread. It busy-waits from the return of this call until `rest`.
  void attend() {
    state_ = kCalled;
    state_.notify_one();
    while (state_.load(std::memory_order_acquire) != kAttending) {
    }
  }
  void rest() { state_ = kAsleep; }
  template <class Work>
  void run_both(const Work& work) {
    work_ = [](const void* context, int half) { (*static_cast<const Work*>(context))(half); };
    context_ = &work;
    state_.store(kWorking, std::memory_order_release);
    work(0);
    while (state_.load(std::memory_order_acquire) != kAttending) {
    }
  }

 private:
  static constexpr int kAsleep = 0, kCalled = 1, kAttending = 2, kWorking = 3, kQuit = 4;
  void serve() {
    for (;;) {
      switch (state_.load(std::memory_order_acquire)) {
        case kAsleep: state_.wait(kAsleep); break;
        case kCalled: state_.store(kAttending, std::memory_order_release); break;
        case kAttending: break;
        case kWorking:
          work_(context_, 1);
          state_.store(kAttending, std::memory_order_release);
          break;
        default: return;
      }
    }
  }
  std::atomic<int> state_{kAsleep};
  void (*work_)(const void*, int) = nullptr;
  const void* context_ = nullptr;
  std::thread thread_;
};

/// Feature that a point is measured for; the other faces are only compared with the model.
enum class Feature : std::uint8_t { bearing_plane, casings, jaws, slab_top, other_faces };

struct Bench {
  Bench(const StageOptions& stage_options, const Recipe& the_recipe, const Scene& the_scene, const Scan& the_scan,
        Samples& the_samples)
      : options(stage_options),
        recipe(the_recipe),
        organised(the_scan),
        in_scan_order(unorganised(the_scan)),
        without_order(shuffled(the_scan)),
        perspective(the_scene.draw(kColumns, kRows, emulator::Projection::perspective)),
        crop_floats(the_scene.crop(in_scan_order)),
        samples(the_samples),
        pages(2 * limits::array_bytes(kScanFloats, sizeof(float)) + limits::array_bytes(kOtherFloats, sizeof(float))),
        buffer(pages.take<float>(kScanFloats)),
        copy(pages.take<float>(kScanFloats)),
        other(pages.take<float>(kOtherFloats)),
        one(1),
        two(2) {
    one.use(recipe);
    two.use(recipe);
    for (std::size_t i = 0; i + 2 < crop_floats.size(); i += 3)
      crop.emplace_back(static_cast<double>(crop_floats[i]), static_cast<double>(crop_floats[i + 1]),
                        static_cast<double>(crop_floats[i + 2]));
  }

  algo::BlockInspector& inspector(int threads) { return threads == 1 ? one : two; }

  /// Copies the scan as drawn into the buffer.
  algo::Cloud load(const Scan& scan) {
    std::memcpy(buffer.data(), scan.xyz.data(), scan.xyz.size() * sizeof(float));
    return {buffer, scan.points(), scan.width, scan.height};
  }
  void evict() { sink = sink + read_pass(other); }

  StageOptions options;
  Recipe recipe;
  const Scan& organised;
  Scan in_scan_order;
  Scan without_order;
  Scan perspective;
  std::vector<float> crop_floats;
  std::vector<Vec3> crop;
  std::vector<std::unique_ptr<Scan>> sized;
  std::vector<Feature> features;  ///< feature of each point of the organised scan
  Samples& samples;
  Pages pages;
  std::span<float> buffer;
  std::span<float> copy;
  std::span<float> other;
  algo::BlockInspector one;
  algo::BlockInspector two;
  SecondThread second;
  volatile float sink = 0.0F;
};

Bench* g_bench = nullptr;

int repetitions(int full) {
  return g_bench->options.quick ? std::max(3, full / 4) : full;
}

/// Adds one sample per iteration under `name`, to Google Benchmark's results and to `samples`. `work` receives a
/// stopwatch that has just been started; `prepare` and `after` are not timed.
template <class Prepare, class Work, class After>
void stage(const std::string& name, int threads, int full_repetitions, const Prepare& prepare, const Work& work,
           const After& after) {
  const std::string key = fmt::format("{}/{}", name, threads);
  benchmark::RegisterBenchmark(key.c_str(),
                               [key, threads, prepare, work, after](benchmark::State& state) {
                                 for ([[maybe_unused]] auto _ : state) {
                                   prepare();
                                   Stopwatch watch;
                                   work(watch);
                                   const Sample sample = watch.total(threads);
                                   after();
                                   g_bench->samples[key].push_back(sample);
                                   state.SetIterationTime(1e-3 * sample.wall_ms);
                                 }
                               })
      ->UseManualTime()
      ->Unit(benchmark::kMillisecond)
      ->Iterations(1)
      ->Repetitions(repetitions(full_repetitions))
      ->ReportAggregatesOnly();
}

template <class Prepare, class Work>
void stage(const std::string& name, int threads, int full_repetitions, const Prepare& prepare, const Work& work) {
  stage(name, threads, full_repetitions, prepare, work, [] {});
}

// ---- floors -----------------------------------------------------------------------------------------------------

std::span<const float> half_of(std::span<const float> floats, int half) {
  const std::size_t middle = floats.size() / 2 / 16 * 16;
  return half == 0 ? floats.first(middle) : floats.subspan(middle);
}

template <class Prepare, class Pass>
void floor_stage(const std::string& name, const Prepare& prepare, const Pass& pass) {
  constexpr int kRepetitions = 41;
  const std::size_t floats = g_bench->organised.xyz.size();
  stage(name, 1, kRepetitions, prepare,
        [floats, pass](Stopwatch&) { pass(g_bench->buffer.first(floats), g_bench->copy.first(floats)); });
  const auto prepare_two = [prepare] {
    prepare();
    g_bench->second.attend();
  };
  stage(name, 2, kRepetitions, prepare_two, [floats, pass](Stopwatch& watch) {
    watch.restart();
    const std::span<const float> from = g_bench->buffer.first(floats);
    const std::span<float> to = g_bench->copy.first(floats);
    const std::size_t middle = half_of(from, 0).size();
    g_bench->second.run_both(
        [&](int half) { pass(half_of(from, half), half == 0 ? to.first(middle) : to.subspan(middle)); });
  });
}

void register_floors() {
  const auto read = [](std::span<const float> from, std::span<float>) {
    const float sum = read_pass(from);
    benchmark::DoNotOptimize(sum);
  };
  const auto copy = [](std::span<const float> from, std::span<float> to) {
    std::memcpy(to.data(), from.data(), from.size() * sizeof(float));
  };
  // The scan was just written and read once: the warmest possible state.
  const auto warm = [] {
    g_bench->second.rest();
    const algo::Cloud cloud = g_bench->load(g_bench->organised);
    g_bench->sink = g_bench->sink + read_pass(cloud.xyz.first(3 * cloud.points));
  };
  const auto cold = [] {
    g_bench->second.rest();
    (void)g_bench->load(g_bench->organised);
    g_bench->evict();
  };
  floor_stage("floor/read_warm", warm, read);
  floor_stage("floor/read_cold", cold, read);
  floor_stage("floor/memcpy_warm", warm, copy);
  floor_stage("floor/memcpy_cold", cold, copy);
}

// ---- the block --------------------------------------------------------------------------------------------------

/// Measures the whole block as the daemon runs it, with each of its stages as a separate sample.
void measure(const std::string& key, int threads, algo::Cloud cloud, Stopwatch& watch) {
  algo::BlockInspector& inspector = g_bench->inspector(threads);
  Samples& samples = g_bench->samples;
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  Status status = inspector.denoise(cloud);
  const Sample denoise = watch.lap(threads);
  if (status) status = inspector.register_to_model(cloud);
  const Sample registering = watch.lap(threads);
  if (status) status = inspector.extract(cloud);
  inspector.judge(status ? Code::ok : status.error().code);
  const Sample extract = watch.lap(threads);
  if (!status) {
    fmt::print(stderr, "bench: {}: {}\n", key, status.error().text.view());
    std::exit(1);
  }
  samples[fmt::format("{}/denoise/{}", key, threads)].push_back(denoise);
  samples[fmt::format("{}/register/{}", key, threads)].push_back(registering);
  samples[fmt::format("{}/extract/{}", key, threads)].push_back(extract);
}

void block_stage(const std::string& name, const Scan& scan, int threads, int full_repetitions) {
  g_bench->second.rest();
  auto cloud = std::make_shared<algo::Cloud>();
  stage(
      name, threads, full_repetitions,
      [cloud, &scan] {
        g_bench->second.rest();
        *cloud = g_bench->load(scan);
      },
      [cloud, name, threads](Stopwatch& watch) { measure(name, threads, *cloud, watch); });
}

void register_blocks() {
  constexpr int kRepetitions = 21;
  for (const int threads : {1, 2}) {
    block_stage("block/organised", g_bench->organised, threads, kRepetitions);
    block_stage("block/in_scan_order", g_bench->in_scan_order, threads, kRepetitions);
    block_stage("block/shuffled", g_bench->without_order, threads, kRepetitions);
    block_stage("block/perspective", g_bench->perspective, threads, kRepetitions);
  }
  stage(
      "plane", 1, kRepetitions, [] {},
      [](Stopwatch&) {
        algo::PlaneSettings settings;
        settings.threshold_mm = kPlaneInlier_mm;
        const PlaneFit fit = algo::fit_plane(g_bench->crop, Vec3(0.0, 0.0, -1.0), settings);
        benchmark::DoNotOptimize(fit.ok);
      });
}

// ---- reading ----------------------------------------------------------------------------------------------------

algo::Cloud read(const std::string& path, int threads) {
  const Result<ScanShape> shape =
      hal::read_scan(path.c_str(), hal::LengthUnit::mm, g_bench->buffer, g_bench->inspector(threads).team());
  if (!shape) {
    fmt::print(stderr, "bench: {}\n", shape.error().text.view());
    std::exit(1);
  }
  return {g_bench->buffer, shape.value().points, shape.value().width, shape.value().height};
}

void register_reading() {
  const auto path = [](const char* file) { return g_bench->options.folder + "/" + file; };
  const auto reading = [](const std::string& name, const std::string& file, int full_repetitions, bool cold,
                          int threads) {
    stage(
        name, threads, full_repetitions,
        [cold] {
          g_bench->second.rest();
          if (cold) g_bench->evict();
        },
        [file, threads](Stopwatch&) { (void)read(file, threads); });
  };
  for (const int threads : {1, 2}) {
    reading("read/ply", path("scan.ply"), 21, false, threads);
    // The scan of the floors, with its missing points.
    reading("read/ply_organised_cold", path("scan_organised.ply"), 21, true, threads);
    reading("read/ply_organised", path("scan_organised.ply"), 21, false, threads);
  }
  reading("read/ply_ascii", path("scan_ascii.ply"), 9, false, 1);
  reading("read/xyz", path("scan.xyz"), 9, false, 1);
  for (const int threads : {1, 2}) {
    for (const char* file : {"scan.ply", "scan_organised.ply"}) {
      const std::string name =
          std::string("file_to_verdict/") + (file == std::string("scan.ply") ? "ply" : "ply_organised");
      stage(
          name, threads, 11, [] { g_bench->second.rest(); },
          [full = path(file), name, threads](Stopwatch& watch) {
            const algo::Cloud cloud = read(full, threads);
            g_bench->samples[fmt::format("{}/read/{}", name, threads)].push_back(watch.lap(threads));
            measure(name, threads, cloud, watch);
          });
    }
  }
}

// ---- instruction sets -------------------------------------------------------------------------------------------

/// Instruction sets of this machine that slabd has code for. The limit is removed again.
std::vector<algo::InstructionSet> usable_sets() {
  using algo::InstructionSet;
  std::vector<InstructionSet> sets;
  for (const InstructionSet set :
       {InstructionSet::avx512, InstructionSet::avx2, InstructionSet::sse4, InstructionSet::plain})
    if (algo::limit_instruction_set(set)) sets.push_back(set);
  (void)algo::limit_instruction_set(InstructionSet::best);
  return sets;
}

std::string name_of(algo::InstructionSet set) {
  (void)algo::limit_instruction_set(set);
  const std::string name(algo::instruction_set());
  (void)algo::limit_instruction_set(algo::InstructionSet::best);
  return name;
}

void register_sets() {
  for (const algo::InstructionSet set : usable_sets()) {
    for (const auto& [order, scan] : {std::pair("organised", &g_bench->organised),
                                      std::pair("in_scan_order", static_cast<const Scan*>(&g_bench->in_scan_order))}) {
      const std::string name = fmt::format("sets/{}, {}", name_of(set), order);
      auto cloud = std::make_shared<algo::Cloud>();
      stage(
          name, 1, 11,
          [cloud, set, scan = scan] {
            g_bench->second.rest();
            *cloud = g_bench->load(*scan);
            (void)algo::limit_instruction_set(set);
          },
          [cloud, name](Stopwatch& watch) { measure(name, 1, *cloud, watch); },
          [] { (void)algo::limit_instruction_set(algo::InstructionSet::best); });
    }
  }
}

// ---- growth -----------------------------------------------------------------------------------

/// Feature of each point by the truth; an outlier has the feature of the face behind it.
std::vector<Feature> features_of(const Scan& scan, const Recipe& recipe, const Pose& T_block_scanner) {
  algo::BlockModel model;
  model.build(recipe.block);
  const double casing_s = recipe.block.casing_half_spacing_mm.value;
  // The rim and the margin around it within which points count as rim points.
  const double rim = 0.5 * recipe.block.casing_rim_diameter_mm.value + recipe.evaluation.edge_margin_mm;
  const Mat3 R = T_block_scanner.rotation.toRotationMatrix();
  std::vector<Feature> features(scan.points(), Feature::other_faces);
  for (std::size_t i = 0; i < scan.points(); ++i) {
    const Vec3 p = R * Vec3(static_cast<double>(scan.xyz[3 * i]), static_cast<double>(scan.xyz[3 * i + 1]),
                            static_cast<double>(scan.xyz[3 * i + 2])) +
                   T_block_scanner.translation_mm;
    algo::Face face = algo::Face::seat;
    double z = 0.0;
    if (!p.allFinite() || !model.visible(p.x(), p.y(), face, z)) continue;
    const bool in_rim = face == algo::Face::rim_inner || face == algo::Face::rim_outer;
    if (in_rim || (face == algo::Face::seat && std::hypot(p.x(), std::abs(p.y()) - casing_s) <= rim))
      features[i] = Feature::casings;
    else if (face == algo::Face::seat)
      features[i] = Feature::bearing_plane;
    else if (face == algo::Face::jaw_inner || face == algo::Face::jaw_outer)
      features[i] = Feature::jaws;
    else if (face == algo::Face::top)
      features[i] = Feature::slab_top;
  }
  return features;
}

/// Measures a registered scan that contains only the features up to `last`.
void feature_stage(const std::string& name, Feature last) {
  auto cloud = std::make_shared<algo::Cloud>();
  stage(
      name, 1, 7,
      [cloud, name, last] {
        g_bench->second.rest();
        *cloud = g_bench->load(g_bench->organised);
        g_bench->one.begin(1, Pose::identity(), nominal_T_block_scanner());
        Status status = g_bench->one.denoise(*cloud);
        if (status) status = g_bench->one.register_to_model(*cloud);
        if (!status) {
          fmt::print(stderr, "bench: {}: {}\n", name, status.error().text.view());
          std::exit(1);
        }
        for (std::size_t i = 0; i < cloud->points; ++i)
          if (g_bench->features[i] > last) std::fill_n(&cloud->xyz[3 * i], 3, std::numeric_limits<float>::quiet_NaN());
      },
      [cloud, name](Stopwatch&) {
        const Status status = g_bench->one.extract(*cloud);
        g_bench->one.judge(status ? Code::ok : status.error().code);
        if (status) return;
        fmt::print(stderr, "bench: {}: {}\n", name, status.error().text.view());
        std::exit(1);
      },
      [name, last] {
        const BlockResult& result = g_bench->one.result();
        const bool casings = result.casing_inner.ok && result.casing_outer.ok;
        const bool jaws = result.jaw_inner.ok && result.jaw_outer.ok;
        if (casings == (last >= Feature::casings) && jaws == (last >= Feature::jaws) &&
            result.slab_top.ok == (last >= Feature::slab_top))
          return;
        fmt::print(stderr, "bench: {}: not the features that were left\n", name);
        std::exit(1);
      });
}

void register_growth(const Scene& scene) {
  if (g_bench->options.quick) return;
  // The same field with more rows and columns, up to the capacity; a larger scan is rejected.
  for (const double million : {0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0}) {
    if (1e6 * million > static_cast<double>(limits::kScanPointsMax)) break;
    const double scale = std::sqrt(1e6 * million / static_cast<double>(kColumns * kRows));
    const auto columns = static_cast<std::size_t>(scale * static_cast<double>(kColumns));
    const auto rows = static_cast<std::size_t>(scale * static_cast<double>(kRows));
    g_bench->sized.push_back(std::make_unique<Scan>(scene.draw(columns, rows)));
    block_stage(fmt::format("growth/points {:4.1f} M", million), *g_bench->sized.back(), 1, 7);
  }
  g_bench->features = features_of(g_bench->organised, g_bench->recipe, scene.T_scanner_block().inverse());
  for (const auto& [name, last] :
       {std::pair("1 the bearing plane", Feature::bearing_plane), std::pair("2 and its casings", Feature::casings),
        std::pair("3 and the jaws", Feature::jaws), std::pair("4 and the slab top", Feature::slab_top),
        std::pair("5 and the other faces", Feature::other_faces)})
    feature_stage(fmt::format("growth/features, registered scan: {}", name), last);
  // The same scan measured with other recipes: evaluated part of the seat, and possible distance of the block from the
  // robot's pose. Building the model for a recipe is not timed, because the daemon does it once per slab type.
  const auto recipe_stage = [](const std::string& name, const Recipe& recipe) {
    auto cloud = std::make_shared<algo::Cloud>();
    stage(
        name, 1, 7,
        [cloud, recipe] {
          g_bench->second.rest();
          g_bench->one.use(recipe);
          *cloud = g_bench->load(g_bench->organised);
        },
        [cloud, name](Stopwatch& watch) { measure(name, 1, *cloud, watch); },
        [] { g_bench->one.use(g_bench->recipe); });
  };
  struct Region {
    double half_x_mm, half_s_mm, cell_mm;
  };
  for (const Region& region : {Region{25.0, 37.0, 1.5}, Region{51.0, 75.0, 1.5}, Region{75.0, 100.0, 2.0}}) {
    Recipe recipe = g_bench->recipe;
    recipe.evaluation.crop_half_x_mm = region.half_x_mm;
    recipe.evaluation.crop_half_s_mm = region.half_s_mm;
    recipe.evaluation.cell_mm = region.cell_mm;
    recipe_stage(fmt::format("growth/seat region {:.0f} x {:.0f} mm, cells of {} mm", 2.0 * region.half_x_mm,
                             2.0 * region.half_s_mm, region.cell_mm),
                 recipe);
  }
  for (const double window_mm : {20.0, 60.0, 100.0}) {
    Recipe recipe = g_bench->recipe;
    recipe.evaluation.window_mm = window_mm;
    recipe_stage(fmt::format("growth/search window {:.0f} mm", window_mm), recipe);
  }
}

}  // namespace

std::vector<std::string> instruction_sets() {
  std::vector<std::string> names;
  for (const algo::InstructionSet set : usable_sets()) names.push_back(name_of(set));
  return names;
}

void register_stages(const StageOptions& options, const Recipe& recipe, const Scene& scene, const Scan& organised,
                     Samples& samples) {
  static Bench bench(options, recipe, scene, organised, samples);
  g_bench = &bench;
  register_floors();
  register_blocks();
  register_reading();
  register_sets();
  register_growth(scene);
}

void run_stages(const StageOptions& options) {
  static const bool initialised = [] {
    static char program[] = "slabd_bench";
    static char interleave[] = "--benchmark_enable_random_interleaving=true";
    char* arguments[] = {program, interleave};
    int count = 2;
    benchmark::Initialize(&count, arguments);
    return true;
  }();
  (void)initialised;
  // Google Benchmark's own table is printed to stderr: stdout belongs to the report.
  benchmark::ConsoleReporter reporter(benchmark::ConsoleReporter::OO_None);
  reporter.SetOutputStream(&std::cerr);
  reporter.SetErrorStream(&std::cerr);
  benchmark::RunSpecifiedBenchmarks(&reporter, options.filter.empty() ? "." : options.filter);
}

}  // namespace slabd::bench
