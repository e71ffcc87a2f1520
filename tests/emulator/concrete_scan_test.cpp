// SPDX-License-Identifier: Apache-2.0
#include "emulator/block_drawing.h"

#include <gtest/gtest.h>

#include <cstring>

#include "tests/config/reference_recipe.h"

namespace slabd::emulator {
namespace {

ConcreteScanner coarse_scanner() {
  ConcreteScanner scanner;
  scanner.columns = 300;
  scanner.rows = 430;
  return scanner;
}

std::vector<float> drawn(const Recipe& recipe, const EffectStrengths& effects, std::uint64_t seed = 1,
                         const ConcreteScanner& scanner = coarse_scanner()) {
  ConcreteOrder order;
  order.truth = nominal_truth(recipe);
  order.effects = effects;
  order.seed = seed;
  order.node_mm = 0.5;
  std::vector<float> xyz;
  (void)draw_concrete(recipe, order, concrete_view(effects, seed).T_scanner_block, scanner, seed, xyz);
  return xyz;
}

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST(ConcreteScan, without_effects_it_is_the_polyhedron) {
  const Recipe recipe = cli::reference_recipe();
  const ConcreteScanner scanner = coarse_scanner();
  const std::vector<float> xyz = drawn(recipe, EffectStrengths());
  const auto surface =
      BlockSurface::make(recipe, nominal_truth(recipe), nominal_T_block_scanner().inverse(), Projection::perspective);
  ASSERT_TRUE(surface);
  std::size_t compared = 0;
  std::size_t far = 0;
  for (std::size_t i = 0; i < xyz.size() / 3; ++i) {
    const double x = ((static_cast<double>(i % scanner.columns) + 0.5) / 300.0 - 0.5) * scanner.field_x_mm;
    const double y = ((static_cast<double>(i / scanner.columns) + 0.5) / 430.0 - 0.5) * scanner.field_y_mm;
    const double depth = surface.value().depth_mm(x, y);
    ASSERT_EQ(std::isnan(depth), std::isnan(xyz[3 * i + 2])) << i;
    if (std::isnan(depth)) continue;
    ++compared;
    far += std::abs(static_cast<double>(xyz[3 * i + 2]) - depth) > 1e-3 ? 1U : 0U;
  }
  EXPECT_GT(compared, 120'000U);
  // Next to an edge the height field is wrong by a part of its raster.
  EXPECT_LT(static_cast<double>(far), 0.02 * static_cast<double>(compared));
}

TEST(ConcreteScan, the_same_arguments_give_the_same_bits) {
  const Recipe recipe = cli::reference_recipe();
  const EffectStrengths real(SurfaceKind::real);
  EXPECT_TRUE(same_bits(drawn(recipe, real), drawn(recipe, real)));
  EXPECT_FALSE(same_bits(drawn(recipe, real), drawn(recipe, real, 2)));
}

TEST(ConcreteScan, every_effect_changes_the_scan) {
  const Recipe recipe = cli::reference_recipe();
  const std::vector<float> usual = drawn(recipe, EffectStrengths(SurfaceKind::real));
  for (const EffectInfo& effect : effects()) {
    EffectStrengths changed(SurfaceKind::real);
    changed.set(effect.effect, effect.usual == 0.0 ? 1.0 : 0.0);
    EXPECT_FALSE(same_bits(usual, drawn(recipe, changed))) << effect.name;
  }
}

TEST(ConcreteScan, misfit_loses_the_grid_and_a_step_rounds) {
  const Recipe recipe = cli::reference_recipe();
  ConcreteOrder order;
  order.truth = nominal_truth(recipe);
  order.effects = EffectStrengths(SurfaceKind::ideal);
  order.node_mm = 0.5;
  ConcreteScanner scanner = coarse_scanner();
  scanner.step_mm = 0.5;
  std::vector<float> xyz;
  const Pose view = nominal_T_block_scanner().inverse();
  EXPECT_EQ(draw_concrete(recipe, order, view, scanner, 1, xyz).drawn.width, 300U);
  for (const float v : xyz) {
    if (!std::isfinite(v)) continue;
    ASSERT_EQ(2.0F * v, std::round(2.0F * v));
  }
  order.effects.set(Effect::misfit, 1.0);
  const ConcreteScan merged = draw_concrete(recipe, order, view, scanner, 1, xyz);
  EXPECT_EQ(merged.drawn.width, 0U);
  EXPECT_EQ(3 * merged.drawn.valid, xyz.size());
}

TEST(ConcreteScan, blocks_of_the_line_keep_their_planted_defects) {
  const Recipe recipe = cli::reference_recipe();
  StationTruth station;
  station.block = nominal_truth(recipe);
  ScannerTraits traits;
  traits.columns = 200;
  traits.rows = 286;
  traits.concrete.emplace(SurfaceKind::real);
  const Pose view = nominal_T_block_scanner().inverse();
  std::vector<float> xyz;
  const auto good = draw_block(recipe, station, view, traits, 1, 1, xyz);
  ASSERT_TRUE(good && good.value().concrete);
  station.block.bump_mm = 2.0;
  station.outlier_share = 0.1;
  const auto domed = draw_block(recipe, station, view, traits, 1, 1, xyz);
  ASSERT_TRUE(domed && domed.value().concrete);
  EXPECT_GT(domed.value().concrete->flatness_form_mm, good.value().concrete->flatness_form_mm + 1.0);
  EXPECT_GT(domed.value().scan.outliers, 50 * good.value().scan.outliers);
  station.block.present = false;
  const auto absent = draw_block(recipe, station, view, traits, 1, 1, xyz);
  ASSERT_TRUE(absent);
  float nearest = 1e9F;
  for (std::size_t i = 2; i < xyz.size(); i += 3)
    if (std::isfinite(xyz[i])) nearest = std::min(nearest, xyz[i]);
  EXPECT_GT(nearest, 590.0F);
}

}  // namespace
}  // namespace slabd::emulator
