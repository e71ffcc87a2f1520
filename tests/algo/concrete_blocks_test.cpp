// SPDX-License-Identifier: Apache-2.0
//
// Whole blocks of real concrete drawn by the emulator: good ones pass, and broken ones do not. Each seed is a scan that
// was once judged wrongly.
#include <gtest/gtest.h>

#include "algo/algo.h"
#include "emulator/block_drawing.h"
#include "emulator/slab_scene.h"
#include "tests/config/reference_recipe.h"

namespace slabd::algo {
namespace {

using emulator::ConcreteDefect;
using emulator::EffectStrengths;

/// Draws and measures blocks one after the other in the same memory.
class Concrete : public ::testing::Test {
 protected:
  Concrete() { inspector_.use(recipe_); }

  const BlockResult& measured(std::uint64_t seed, const std::vector<std::string>& effects = {},
                              const std::vector<std::string>& defects = {}) {
    EffectStrengths strengths(emulator::SurfaceKind::real);
    for (const std::string& text : effects) EXPECT_FALSE(strengths.take(text));
    emulator::ConcreteOrder order;
    order.effects = strengths;
    order.seed = seed;
    for (const std::string& text : defects) {
      const auto defect = emulator::parse_concrete_defect(text);
      EXPECT_TRUE(defect) << text;
      if (defect) order.defects.push_back(defect.value());
    }
    order.truth =
        emulator::scattered_truth(recipe_, emulator::nominal_truth(recipe_), strengths[emulator::Effect::cast], seed);
    const emulator::ConcreteView view = emulator::concrete_view(strengths, seed);
    emulator::ConcreteScanner scanner;
    scanner.seed = seed;
    const emulator::ConcreteScan scan = emulator::draw_concrete(recipe_, order, view.T_scanner_block, scanner,
                                                                emulator::derived_seed(seed, 8, 0), xyz_);
    inspector_.begin(1, Pose::identity(), view.T_block_scanner_reported);
    Cloud cloud{xyz_, xyz_.size() / 3, scan.drawn.width, scan.drawn.height};
    Status status = inspector_.denoise(cloud);
    if (status) status = inspector_.register_to_model(cloud);
    if (status) status = inspector_.extract(cloud);
    EXPECT_TRUE(status);
    inspector_.judge(status ? Code::ok : status.error().code);
    return inspector_.result();
  }

  Recipe recipe_ = cli::reference_recipe();
  BlockInspector inspector_;
  std::vector<float> xyz_;
};

std::string names_of_not_passed(const BlockResult& result) {
  std::string names;
  for (const Item& item : result.items)
    if (item.required && item.verdict != Verdict::pass) names += std::string(info(item.id).name) + " ";
  return names;
}

TEST_F(Concrete, good_blocks_pass) {
  for (const std::uint64_t seed : {
           3001U,   // chamfer at the seat's end worn 1.2 mm deeper over 10 mm
           3044U,   // the same, twice
           5010U,   // a pore of 7 mm behind the chamfer at the seat's end
           7010U,   // a pore in that chamfer
           3117U,   // a corner with two worn chamfers
           3083U,   // a corner at the end of the field of view
           16354U,  // a side at the end of the field of view
           3047U,   // an undulating slab top whose plane depends on the threshold by 0.006 deg
       }) {
    const BlockResult& result = measured(seed);
    EXPECT_EQ(result.verdict, Verdict::pass) << "seed " << seed << ": " << names_of_not_passed(result);
  }
}

TEST_F(Concrete, good_blocks_pass_with_one_thing_worse_than_usual) {
  for (const auto& [seed, effect] : {
           std::pair(3002U, "wear=2"),     // chamfers of 1 to 7 mm
           std::pair(3009U, "chamfer=2"),  // of 5 to 11 mm
           std::pair(3006U, "drops=1"),    // up to 1.3 mm high
           std::pair(3009U, "grain=2"),    // grain whose valleys joined a pore
       }) {
    const BlockResult& result = measured(seed, {effect});
    EXPECT_EQ(result.verdict, Verdict::pass)
        << "seed " << seed << ", " << effect << ": " << names_of_not_passed(result);
  }
}

TEST_F(Concrete, chips_are_damage) {
  for (const auto& [seed, chip] :
       {std::pair(3010U, "chip_seat=10"), std::pair(3005U, "chip_seat=10"), std::pair(3008U, "chip_corner=12"),
        std::pair(3019U, "chip_corner=12"), std::pair(3043U, "chip_corner=12"), std::pair(3004U, "chip_jaw=10")}) {
    const BlockResult& result = measured(seed, {}, {chip});
    const Item* damage = find_item(result.items.begin(), result.items.end(), ItemId::block_damage);
    ASSERT_NE(damage, nullptr);
    EXPECT_NE(damage->verdict, Verdict::pass) << "seed " << seed << ": " << chip;
  }
}

}  // namespace
}  // namespace slabd::algo
