// SPDX-License-Identifier: Apache-2.0
#include "daemon/workers.h"

#include <gtest/gtest.h>

#include "tests/config/text_file.h"
#include "tests/places/places.h"

namespace slabd::daemon {
namespace {

/// Handling of a block at the daemon's start if its scan was durable and its result was not.
class Reload : public testing::Test {
 protected:
  Reload() {
    std::vector<config::Problem> problems;
    recipes_.resize(1);
    config::load_recipe(places::source_dir() + "/recipes/p5600.toml", recipes_[0], problems);
    EXPECT_TRUE(problems.empty());
    for (int i = 0; i < 300; ++i) xyz_.push_back(static_cast<float>(i));
    path_ = files_.folder() + "/scan.ply";
    write();
    workers_ = make_workers(recipes_, hal::LengthUnit::mm, *clock_, 1);
  }
  void write() const { ASSERT_TRUE(hal::write_ply(path_.c_str(), xyz_, 10, 10).ok()); }
  BlockMeasured measure(std::optional<std::uint32_t> points_crc32c) {
    MeasureBlock job;
    job.id = {.station = 1, .attempt = 1};
    job.reload = true;
    job.scan_path.assign(path_);
    job.points_crc32c = points_crc32c;
    job.basis.recipe = recipes_.data();
    const std::unique_ptr<MeasureQueue> queue = workers_->measuring();
    EXPECT_TRUE(queue->push(job));
    queue->drain();
    BlockMeasured done;
    EXPECT_TRUE(queue->next(done));
    return done;
  }

  config::TextFiles files_;
  std::vector<Recipe> recipes_;
  std::vector<float> xyz_;
  std::string path_;
  std::unique_ptr<hal::Clock> clock_ = hal::make_system_clock();
  std::unique_ptr<Workers> workers_;
};

TEST_F(Reload, a_scan_that_was_changed_since_it_was_acquired_is_not_measured) {
  const std::uint32_t acquired = hal::points_crc32c(xyz_);
  const auto too_few = static_cast<std::uint16_t>(Code::too_few_points);
  EXPECT_EQ(measure(acquired).block.reason, too_few) << "a hundred points, read and judged";
  EXPECT_EQ(measure(std::nullopt).block.reason, too_few) << "a scan of which no checksum was kept";

  xyz_[151] += 0.001F;
  write();
  const BlockMeasured changed = measure(acquired);
  EXPECT_EQ(changed.block.verdict, Verdict::not_measured);
  EXPECT_EQ(changed.block.reason, static_cast<std::uint16_t>(Code::frame_incomplete));
  EXPECT_EQ(changed.block.station, 1);
  EXPECT_EQ(changed.slot, 0) << "the buffer comes back";
}

}  // namespace
}  // namespace slabd::daemon
