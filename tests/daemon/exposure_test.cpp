// SPDX-License-Identifier: Apache-2.0
//
// The exposure of block 6 is repeated as that of block 7, through files and the readers of the line.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "daemon/workers.h"
#include "tests/algo/each_set.h"
#include "tests/algo/scene.h"
#include "tests/config/text_file.h"
#include "tests/places/places.h"

namespace slabd::daemon {
namespace {

using hal::ScanFormat;

struct Scan {
  std::vector<float> xyz;
  std::size_t width = 0;
  std::size_t height = 0;

  [[nodiscard]] std::size_t points() const { return xyz.size() / 3; }
  /// Without its grid, as in files that list only the points that returned.
  [[nodiscard]] Scan listed() const {
    Scan list;
    for (std::size_t i = 0; i < points(); ++i)
      if (std::isfinite(xyz[3 * i])) list.xyz.insert(list.xyz.end(), &xyz[3 * i], &xyz[3 * i] + 3);
    return list;
  }
};

class Exposures : public ::testing::Test {
 protected:
  Exposures() {
    std::vector<config::Problem> problems;
    config::load_recipe(places::source_dir() + "/recipes/p5600.toml", recipes_.emplace_back(), problems);
    EXPECT_TRUE(problems.empty());
    workers_ = new_workers(1, false);
  }
  [[nodiscard]] std::unique_ptr<Workers> new_workers(int threads, bool simulation) const {
    return make_workers(recipes_, hal::LengthUnit::mm, *clock_, threads, simulation);
  }
  Scan expose(std::uint64_t seed, const scene::Block& block = {}, const Pose& displacement = {}) {
    scene::Scan how;
    how.seed = seed;
    how.organised = true;
    how.noise_mm = noise_mm_;
    how.pitch_mm = pitch_mm_;
    how.field_x_mm = 260.0;  // the block and little more
    how.displacement = displacement;
    scene::Cloud cloud = scene::take(block, how);
    T_block_scanner_ = cloud.T_block_scanner;
    return {std::move(cloud.xyz), cloud.width, cloud.height};
  }
  std::string write(const Scan& scan, ScanFormat format = ScanFormat::ply) const {
    const std::string path = files_.folder() + "/scan." + std::string(hal::extension(format));
    EXPECT_TRUE(hal::write_scan(path.c_str(), format, scan.xyz, scan.width, scan.height).ok());
    return path;
  }
  /// Measures the stored scan of a block as the daemon does.
  BlockMeasured measure(const std::string& path, std::uint8_t station, std::int64_t slab_key = 1,
                        std::uint8_t attempt = 1) {
    MeasureBlock job;
    job.id = {slab_key, station, attempt};
    job.reload = true;
    job.scan_path.assign(path);
    job.basis.recipe = recipes_.data();
    job.T_base_scanner = T_slab_block(recipes_[0], station) * nominal_T_block_scanner();
    const std::unique_ptr<MeasureQueue> queue = workers_->measuring();
    EXPECT_TRUE(queue->push(job));
    queue->drain();
    auto done = std::make_unique<BlockMeasured>();
    EXPECT_TRUE(queue->next(*done));
    EXPECT_EQ(done->block.registration.status, RegistrationStatus::converged) << done->block.registration.note.view();
    return *done;
  }
  void expect_refused(const std::string& path, const char* what) {
    const BlockMeasured done = measure(path, 7);
    EXPECT_FALSE(done.noise.empty()) << what;
    EXPECT_EQ(done.refused, Code::frame_incomplete) << what;
    EXPECT_NE(done.refused_text.view().find("slab key 1, station 6, scan 1 "), std::string::npos)
        << what << ": " << done.refused_text.view();
    EXPECT_EQ(done.block.verdict, Verdict::not_measured) << what;
  }
  void expect_new(const std::string& path, std::uint8_t station, const char* what, std::int64_t slab_key = 1) {
    const BlockMeasured done = measure(path, station, slab_key);
    EXPECT_EQ(done.refused, Code::ok) << what << ": " << done.refused_text.view();
  }

  double noise_mm_ = 0.03;
  double pitch_mm_ = 0.4;
  config::TextFiles files_;
  std::vector<Recipe> recipes_;
  std::unique_ptr<hal::Clock> clock_ = hal::make_system_clock();
  std::unique_ptr<Workers> workers_;
  Pose T_block_scanner_;
};

/// Text with three decimals, as viewers export.
std::string text_of(const config::TextFiles& files, const Scan& scan) {
  std::string path = files.folder() + "/scan.xyz";
  std::FILE* file = std::fopen(path.c_str(), "w");
  for (std::size_t i = 0; i < scan.points(); ++i)
    std::fprintf(file, "%.3f %.3f %.3f\n", static_cast<double>(scan.xyz[3 * i]),
                 static_cast<double>(scan.xyz[3 * i + 1]), static_cast<double>(scan.xyz[3 * i + 2]));
  EXPECT_EQ(std::fclose(file), 0);
  return path;
}

template <typename Change>
Scan changed(Scan scan, const Change& change) {
  for (float& x : scan.xyz) x = change(x);
  return scan;
}

Scan reversed(const Scan& scan) {
  Scan back;
  for (std::size_t i = scan.points(); i-- > 0;) back.xyz.insert(back.xyz.end(), &scan.xyz[3 * i], &scan.xyz[3 * i] + 3);
  return back;
}

Scan moved(Scan scan, const Pose& by) {
  for (std::size_t i = 0; i < scan.points(); ++i) {
    float* f = &scan.xyz[3 * i];
    const Vec3 p = by * Vec3(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
    for (int axis = 0; axis < 3; ++axis) f[axis] = static_cast<float>(p[axis]);
  }
  return scan;
}

/// Depths filtered over 3 x 3 pixels, or more; missing points stay missing.
Scan filtered(const Scan& scan, bool median, std::size_t reach = 1) {
  Scan out = scan;
  for (std::size_t r = reach; r + reach < scan.height; ++r) {
    for (std::size_t c = reach; c + reach < scan.width; ++c) {
      std::array<float, 81> near{};
      std::size_t n = 0;
      for (std::size_t i = r - reach; i <= r + reach; ++i)
        for (std::size_t j = c - reach; j <= c + reach; ++j)
          if (const float z = scan.xyz[3 * (i * scan.width + j) + 2]; std::isfinite(z)) near[n++] = z;
      float& z = out.xyz[3 * (r * scan.width + c) + 2];
      if (!std::isfinite(z)) continue;
      std::sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(n));
      float sum = 0.0F;
      for (std::size_t k = 0; k < n; ++k) sum += near[k];
      z = median ? near[n / 2] : sum / static_cast<float>(n);
    }
  }
  return out;
}

Scan decimated(const Scan& scan) {
  Scan out;
  out.width = (scan.width + 1) / 2;
  out.height = (scan.height + 1) / 2;
  for (std::size_t r = 0; r < scan.height; r += 2)
    for (std::size_t c = 0; c < scan.width; c += 2) {
      const float* p = &scan.xyz[3 * (r * scan.width + c)];
      out.xyz.insert(out.xyz.end(), p, p + 3);
    }
  return out;
}

TEST_F(Exposures, an_exposure_that_is_given_again_in_another_form_is_refused_whatever_block_it_is_to_be) {
  const Scan six = expose(6);
  const Scan list = six.listed();
  expect_new(write(six), 6, "block 6");
  expect_refused(write(list), "without its grid");
  expect_refused(write(reversed(list)), "in reverse order");
  Scan one_less = list;
  one_less.xyz.resize(one_less.xyz.size() - 3);
  expect_refused(write(one_less), "one point less");
  Scan last_bit = six;
  const std::size_t some = 3 * (six.height / 2 * six.width + six.width / 2) + 2;
  last_bit.xyz[some] = std::nextafter(last_bit.xyz[some], 0.0F);
  expect_refused(write(last_bit), "a last bit changed");
  expect_refused(text_of(files_, list), "text with three decimals");
  expect_refused(write(six, ScanFormat::pcd_compressed), "as PCD");
  Prng prng(1);
  expect_refused(
      write(changed(
          six, [&](float x) { return static_cast<float>(static_cast<double>(x) + 2e-6 * (prng.uniform() - 0.5)); })),
      "jitter of 1e-6 mm");
  expect_refused(write(changed(six, [](float x) { return std::round(100.0F * x) / 100.0F; })), "rounded to 0.01 mm");
  Pose by;
  by.translation_mm = Vec3(3.0, -2.0, 1.5);
  by.rotation = rotation_from_kuka_abc(rad_from_deg(1.0), rad_from_deg(0.3), rad_from_deg(-0.4));
  // About the centre of the block, so that it stays in the window.
  Pose centre;
  centre.translation_mm = Vec3(0.0, 0.0, 600.0);
  expect_refused(write(moved(six, centre * by * centre.inverse())), "moved by millimetres and a degree");
  expect_refused(write(filtered(six, false)), "mean of 3 x 3");
  expect_refused(write(filtered(six, true)), "median of 3 x 3");
  expect_refused(write(decimated(six)), "every second row and column");
}

TEST_F(Exposures, a_refused_scan_is_not_remembered_and_the_next_exposure_is_measured) {
  expect_new(write(expose(6)), 6, "block 6");
  expect_refused(write(reversed(expose(6).listed())), "block 6 again");
  expect_refused(write(expose(6)), "and again: still that of block 6");
  expect_new(write(expose(7)), 7, "block 7");
}

TEST_F(Exposures, a_scan_that_is_smoothed_unlike_those_before_is_refused) {
  for (std::uint8_t station = 1; station <= 3; ++station)
    expect_new(write(expose(station)), station, "as the scanner writes");
  const BlockMeasured done = measure(write(filtered(expose(3), false, 2)), 4);
  EXPECT_EQ(done.refused, Code::frame_incomplete);
  EXPECT_NE(done.refused_text.view().find("it was smoothed unlike them"), std::string::npos)
      << done.refused_text.view();
  EXPECT_EQ(done.block.verdict, Verdict::not_measured);
  expect_new(write(expose(4)), 4, "as the scanner writes again");

  // A scanner whose program always smooths is used as it is.
  workers_ = new_workers(1, false);
  for (std::uint8_t station = 1; station <= 5; ++station)
    expect_new(write(filtered(expose(station), false, 2)), station, "always smoothed");
}

TEST_F(Exposures, independent_scans_are_measured_also_of_the_same_block_in_the_same_pose) {
  // Texture of concrete and the scanner's ripple, which both scans have in common.
  scene::Block block;
  block.relief_mm = [](double x, double s) {
    return 0.010 * std::sin(2.0 * kPi * s / 3.0) + 0.010 * std::sin(2.1 * x + 0.7 * s) * std::cos(0.9 * x - 1.7 * s);
  };
  noise_mm_ = 0.013;
  expect_new(write(expose(1, block)), 1, "first");
  expect_new(write(expose(2, block)), 2, "the same block in the same pose, as another station");
  expect_new(write(expose(3, block)), 1, "the same station of another slab", 2);
  expect_new(write(expose(4)), 3, "another block");
  scene::Block steep;
  steep.cant_ratio = 35.0;
  expect_new(write(expose(5, steep)), 7, "another slope");
}

TEST_F(Exposures, a_scan_without_noise_is_neither_new_nor_old) {
  noise_mm_ = 0.0;
  const std::string path = write(expose(1));
  for (std::uint8_t station = 1; station <= 2; ++station) {
    MeasureBlock job;
    job.id.station = station;
    job.reload = true;
    job.scan_path.assign(path);
    job.basis.recipe = recipes_.data();
    job.T_base_scanner = T_slab_block(recipes_[0], station) * nominal_T_block_scanner();
    const std::unique_ptr<MeasureQueue> queue = workers_->measuring();
    ASSERT_TRUE(queue->push(job));
    queue->drain();
    auto done = std::make_unique<BlockMeasured>();
    ASSERT_TRUE(queue->next(*done));
    EXPECT_TRUE(has_value(done->block.seat.flatness_mm));
    EXPECT_TRUE(done->noise.empty());
    EXPECT_EQ(done->refused, Code::ok);
  }
}

TEST_F(Exposures, the_same_scan_may_be_measured_again_and_is_recognised_after_a_restart) {
  const Scan six = expose(6);
  const std::string path = write(six);
  const auto first = std::make_unique<BlockMeasured>(measure(path, 6));
  ASSERT_EQ(first->refused, Code::ok);
  KeptNoise kept{1, 6, 1, {}};
  ASSERT_TRUE(from_bytes(to_bytes(first->noise), kept.print));

  workers_ = new_workers(1, false);
  workers_->remember({&kept, 1});
  expect_new(path, 6, "the stored scan of the same attempt");
  expect_refused(write(reversed(six.listed())), "the same exposure");
  EXPECT_EQ(measure(path, 6, 2).refused, Code::frame_incomplete) << "as the same station of the next slab";
  EXPECT_EQ(measure(path, 6, 1, 2).refused, Code::frame_incomplete) << "as the next scan of the same station";
}

TEST_F(Exposures, an_emulated_line_may_give_the_same_noise_again) {
  const std::string path = write(expose(6));
  workers_ = new_workers(1, true);
  expect_new(path, 6, "first");
  expect_new(path, 7, "again");
}

TEST_F(Exposures, a_print_has_the_same_bits_on_one_thread_and_two_and_on_every_instruction_set) {
  pitch_mm_ = 0.2;  // dense: both grids
  const std::string path = write(expose(1));
  const NoisePrintBytes one = to_bytes(measure(path, 1).noise);
  workers_ = new_workers(2, false);
  EXPECT_EQ(to_bytes(measure(path, 1).noise), one);
  const auto fine = std::make_unique<NoisePrint>();
  ASSERT_TRUE(from_bytes(one, *fine));
  EXPECT_TRUE(std::any_of(fine->fine.known.begin(), fine->fine.known.end(), [](std::uint64_t w) { return w != 0; }));
  slabd::testing::on_each_set([&] { EXPECT_EQ(to_bytes(measure(path, 1).noise), one); });
}

TEST(KnownExposures, the_oldest_makes_room_and_an_attempt_has_one_place) {
  const auto known = std::make_unique<KnownExposures>();
  const auto exposure = [](std::int64_t key) {
    auto made = std::make_unique<KeptNoise>();
    made->slab_key = key;
    made->station = made->attempt = 1;
    Prng prng(static_cast<std::uint64_t>(key));
    for (std::size_t i = 0; i < 4'000; ++i) made->print.coarse.set(i, prng.below(2) == 0);
    made->print.places = 4'000;
    return made;
  };
  constexpr auto kKept = static_cast<std::int64_t>(limits::kNoisePrintsKept);
  for (std::int64_t key = 1; key <= kKept; ++key) known->add(*exposure(key));
  known->add(*exposure(5));  // measured again
  double correlation = 0.0;
  const auto again = [&](std::int64_t key) {
    auto made = exposure(key);
    made->slab_key = 1'000;
    return known->same_as(*made, correlation);
  };
  EXPECT_EQ(known->same_as(*exposure(5), correlation), nullptr) << "not with itself";
  ASSERT_NE(again(1), nullptr);
  EXPECT_EQ(again(1)->slab_key, 1);
  EXPECT_EQ(correlation, 1.0);
  known->add(*exposure(kKept + 1));
  EXPECT_EQ(again(1), nullptr);
  EXPECT_NE(again(2), nullptr);
  EXPECT_NE(again(kKept + 1), nullptr);
}

}  // namespace
}  // namespace slabd::daemon
