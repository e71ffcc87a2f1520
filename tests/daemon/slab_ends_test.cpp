// SPDX-License-Identifier: Apache-2.0
//
// P4856 and P4925 have the same blocks in the same places; only the slab's ends differ.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "base/prng.h"
#include "config/config.h"
#include "daemon/slab_ends.h"
#include "daemon/workers.h"
#include "tests/algo/scene.h"
#include "tests/config/text_file.h"
#include "tests/places/places.h"

namespace slabd::daemon {
namespace {

constexpr double kShort_mm = 268.5;
constexpr double kLong_mm = 303.0;
constexpr double kNoEnd = 1e9;
constexpr double kWide_mm = 660.0;

Recipe recipe_of(const std::string& name) {
  Recipe recipe;
  std::vector<config::Problem> problems;
  config::load_recipe(places::source_dir() + "/recipes/" + name, recipe, problems);
  EXPECT_TRUE(problems.empty());
  return recipe;
}

/// Surface beyond the slab's end.
enum class Beyond { nothing, floor, next_slab };

struct Seen {
  scene::Cloud cloud;
  Pose T_block_scanner;
};

/// A scan of a block whose slab ends at -`minus_mm` and at `plus_mm`.
Seen scan(double minus_mm, double plus_mm, std::uint64_t seed, Beyond beyond = Beyond::nothing,
          double field_x_mm = kWide_mm, double pitch_mm = 1.5, double focus_mm = 0.0) {
  Prng random(seed + 1);
  const auto within = [&](double amplitude) { return amplitude * (2.0 * random.uniform() - 1.0); };
  scene::Scan how;
  how.seed = seed;
  how.pitch_mm = pitch_mm;
  how.field_x_mm = field_x_mm;
  how.organised = true;
  how.focus_mm = focus_mm;
  how.displacement = scene::displaced(within(4.0), within(4.0), within(4.0), within(0.5), within(0.5), within(0.5));
  Seen seen{scene::take({}, how), {}};
  seen.T_block_scanner = seen.cloud.T_block_scanner;
  const Pose back = seen.T_block_scanner.inverse();
  for (std::size_t i = 0; i < seen.cloud.xyz.size(); i += 3) {
    float* p = &seen.cloud.xyz[i];
    Vec3 q = seen.T_block_scanner * Vec3(double{p[0]}, double{p[1]}, double{p[2]});
    const double over_mm = std::max(-minus_mm - q.x(), q.x() - plus_mm);
    if (!(over_mm > 0.0)) continue;
    if (beyond == Beyond::nothing || (beyond == Beyond::next_slab && over_mm < 12.0)) {
      p[0] = p[1] = p[2] = std::numeric_limits<float>::quiet_NaN();
    } else if (beyond == Beyond::floor) {
      q.z() -= 200.0;
      const Vec3 lower = back * q;
      for (int k = 0; k < 3; ++k) p[k] = static_cast<float>(lower[k]);
    }
  }
  return seen;
}

TopView view_of(const Seen& seen, const Recipe& recipe) {
  return look_at_top(seen.cloud.xyz, seen.T_block_scanner, recipe.block);
}

class SlabEndsTest : public ::testing::Test {
 protected:
  SlabEndsTest() : recipes_{recipe_of("p4856.toml"), recipe_of("p4925.toml"), recipe_of("p5600.toml")} {}

  /// First finding of a slab of 8 pairs that ends `end_mm` beyond its outermost blocks, begun as `recipe`.
  SlabEnds::Finding slab(const Recipe& recipe, double end_mm, std::uint64_t seed, Beyond beyond,
                         double field_x_mm = kWide_mm) {
    ends_.use(recipes_, recipe);
    EXPECT_TRUE(ends_.is_needed());
    for (int k = 1; k <= recipe.stations(); ++k) {
      const bool minus = k == 1 || k == 9;
      const bool plus = k == 8 || k == 16;
      // One scan of an inner block per slab is enough.
      if (!minus && !plus && k % 8 != 2 && k % 8 != 3) continue;
      const std::uint64_t of_scan = seed * 100 + static_cast<std::uint64_t>(k);
      const Seen seen = scan(minus ? end_mm : kNoEnd, plus ? end_mm : kNoEnd, of_scan, beyond, field_x_mm, 3.0);
      const SlabEnds::Finding finding = ends_.note(static_cast<std::int64_t>(seed), k, view_of(seen, recipe));
      if (finding.other != nullptr) return finding;
    }
    return {};
  }

  const Recipe& p4856() const { return recipes_[0]; }
  const Recipe& p4925() const { return recipes_[1]; }

  std::vector<Recipe> recipes_;
  SlabEnds ends_;
};

TEST_F(SlabEndsTest, the_end_of_the_top_is_found_to_a_few_millimetres) {
  for (const Beyond beyond : {Beyond::nothing, Beyond::floor, Beyond::next_slab}) {
    const TopView view = view_of(scan(kShort_mm, kNoEnd, 3, beyond), p4856());
    EXPECT_NEAR(view.reach_mm[0], kShort_mm, 3.0);
    EXPECT_EQ(view.goes_on[0], beyond != Beyond::nothing);
    EXPECT_GT(view.reach_mm[1], 310.0);
    EXPECT_FALSE(view.goes_on[1]) << "the edge of the picture";
    EXPECT_NEAR(view.distance_mm, 630.0, 10.0);
  }
}

TEST_F(SlabEndsTest, a_slab_of_the_other_type_is_found_with_any_object_beyond_its_end) {
  for (const Beyond beyond : {Beyond::nothing, Beyond::floor, Beyond::next_slab}) {
    const SlabEnds::Finding short_one = slab(p4925(), kShort_mm, 1, beyond);
    ASSERT_EQ(short_one.other, &recipes_[0]);
    EXPECT_NEAR(short_one.seen_mm, kShort_mm, 3.0);
    const auto text = text_of(short_one, p4925());
    EXPECT_NE(text.view().find("begun as type 4925 (P4925), but its top ends"), std::string_view::npos) << text.view();
    EXPECT_NE(text.view().find("as on type 4856 (P4856, 268.5 mm)"), std::string_view::npos) << text.view();

    const SlabEnds::Finding long_one = slab(p4856(), kLong_mm, 1, beyond);
    ASSERT_EQ(long_one.other, &recipes_[1]);
    EXPECT_EQ(long_one.station, 1);
  }
}

TEST_F(SlabEndsTest, a_slab_of_its_own_type_is_never_refused) {
  for (const Beyond beyond : {Beyond::nothing, Beyond::floor, Beyond::next_slab})
    for (std::uint64_t seed = 1; seed <= 4; ++seed)
      for (const double off_mm : {-6.0, 0.0, 5.0}) {
        EXPECT_EQ(slab(p4856(), kShort_mm + off_mm, seed, beyond).other, nullptr) << seed << " " << off_mm;
        EXPECT_TRUE(std::isnan(ends_.blind_reach_mm()));
        EXPECT_EQ(slab(p4925(), kLong_mm + off_mm, seed, beyond).other, nullptr) << seed << " " << off_mm;
      }
}

TEST_F(SlabEndsTest, missing_points_count_only_where_inner_blocks_show_a_longer_range) {
  ends_.use(recipes_, p4925());
  const auto note = [&](int station, double minus_mm, double field_x_mm) {
    return ends_.note(7, station, view_of(scan(minus_mm, kNoEnd, 5, Beyond::nothing, field_x_mm), p4925()));
  };
  EXPECT_EQ(note(1, kShort_mm, kWide_mm).other, nullptr) << "this may be the edge of the picture";
  EXPECT_EQ(note(2, kNoEnd, kWide_mm).other, nullptr) << "one inner block is not enough";
  EXPECT_EQ(note(3, kNoEnd, kWide_mm).station, 1);
  EXPECT_EQ(ends_.note(8, 3, view_of(scan(kNoEnd, kNoEnd, 5), p4925())).other, nullptr)
      << "another slab starts from nothing";

  // A field of view that happens to end where the other type does.
  ends_.use(recipes_, p4925());
  for (int k = 1; k <= 4; ++k) EXPECT_EQ(note(k, kNoEnd, 2.0 * kShort_mm).other, nullptr);
}

TEST_F(SlabEndsTest, a_gap_across_the_slab_before_its_end_is_not_its_end) {
  ends_.use(recipes_, p4925());
  Seen seen = scan(kLong_mm, kNoEnd, 9);
  for (std::size_t i = 0; i < seen.cloud.xyz.size(); i += 3) {
    float* p = &seen.cloud.xyz[i];
    const double x = (seen.T_block_scanner * Vec3(double{p[0]}, double{p[1]}, double{p[2]})).x();
    if (x < -kShort_mm && x > -kShort_mm - 15.0) p[0] = p[1] = p[2] = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_EQ(ends_.note(1, 2, view_of(scan(kNoEnd, kNoEnd, 1), p4925())).other, nullptr);
  EXPECT_EQ(ends_.note(1, 3, view_of(scan(kNoEnd, kNoEnd, 2), p4925())).other, nullptr);
  EXPECT_EQ(ends_.note(1, 1, view_of(seen, p4925())).other, nullptr);
}

TEST_F(SlabEndsTest, scans_that_do_not_reach_the_ends_are_reported) {
  EXPECT_EQ(slab(p4925(), kShort_mm, 2, Beyond::nothing, 350.0).other, nullptr);
  ends_.use(recipes_, p4925());
  for (int k = 1; k <= 16; ++k) {
    EXPECT_TRUE(std::isnan(ends_.blind_reach_mm())) << "not all stations were seen";
    (void)ends_.note(1, k, view_of(scan(kNoEnd, kNoEnd, 1, Beyond::nothing, 350.0), p4925()));
  }
  EXPECT_NEAR(ends_.blind_reach_mm(), 175.0, 8.0);
}

TEST_F(SlabEndsTest, recipes_that_differ_only_in_the_ends_or_not_at_all_are_named) {
  std::vector<AlikeRecipes> alike = alike_recipes(recipes_);
  ASSERT_EQ(alike.size(), 1U) << "P5600 has another pitch and more blocks";
  EXPECT_TRUE(alike[0].ends_differ);
  EXPECT_EQ(
      text_of(alike[0]).view(),
      "P4856 and P4925 have the same blocks and differ only in the slab's ends (268.5 and 303 mm from the "
      "outermost block): scans that do not reach 284.5 mm cannot tell them apart, and a slab begun under the wrong "
      "type is not noticed");

  recipes_.push_back(p4856());
  recipes_.back().name = "P4856B";
  recipes_.back().slab_type = 4857;
  recipes_.back().slab.width_mm.value = 2400.0;
  alike = alike_recipes(recipes_);
  ASSERT_EQ(alike.size(), 3U);
  EXPECT_TRUE(alike[1].ends_differ);
  EXPECT_TRUE(alike[2].ends_differ);
  EXPECT_FALSE(alike[0].ends_differ);
  EXPECT_EQ(
      text_of(alike[0]).view(),
      "P4856 and P4856B have the same blocks and slab ends: no scan distinguishes them, and a slab begun under the "
      "wrong type is not noticed");

  recipes_.back().block.jaw_angle_rad.value += rad_from_deg(2.0);
  EXPECT_EQ(alike_recipes(recipes_).size(), 1U) << "another jaw angle shows";
}

TEST_F(SlabEndsTest, a_slab_type_without_a_twin_is_not_looked_at) {
  ends_.use(recipes_, recipes_[2]);
  EXPECT_FALSE(ends_.is_needed());
}

TEST_F(SlabEndsTest, the_measuring_thread_refuses_the_scan_that_shows_another_types_end) {
  const std::unique_ptr<hal::Clock> clock = hal::make_system_clock();
  const std::unique_ptr<Workers> workers = make_workers(recipes_, hal::LengthUnit::mm, *clock, 1);
  const config::TextFiles files;
  const auto measure = [&](const Recipe& begun_as, std::int64_t slab_key) {
    const Seen seen = scan(kShort_mm, kNoEnd, 11, Beyond::floor, 620.0, 0.8, 600.0);
    const std::string path = files.folder() + "/scan.ply";
    EXPECT_TRUE(
        hal::write_scan(path.c_str(), hal::ScanFormat::ply, seen.cloud.xyz, seen.cloud.width, seen.cloud.height).ok());
    MeasureBlock job;
    job.id = {slab_key, 1, 1};
    job.reload = true;
    job.scan_path.assign(path);
    job.basis.recipe = &*std::find_if(recipes_.begin(), recipes_.end(),
                                      [&](const Recipe& recipe) { return recipe.slab_type == begun_as.slab_type; });
    job.T_base_scanner = T_slab_block(begun_as, 1) * nominal_T_block_scanner();
    const std::unique_ptr<MeasureQueue> queue = workers->measuring();
    EXPECT_TRUE(queue->push(job));
    queue->drain();
    auto done = std::make_unique<BlockMeasured>();
    EXPECT_TRUE(queue->next(*done));
    return done;
  };
  const auto own = measure(p4856(), 1);
  EXPECT_EQ(own->refused, Code::ok) << own->refused_text.view();
  EXPECT_EQ(own->block.registration.status, RegistrationStatus::converged);
  const auto other = measure(p4925(), 1);
  EXPECT_EQ(other->refused, Code::unknown_type);
  EXPECT_EQ(other->block.verdict, Verdict::not_measured);
  EXPECT_NE(other->refused_text.view().find("P4856"), std::string_view::npos) << other->refused_text.view();
}

}  // namespace
}  // namespace slabd::daemon
