// SPDX-License-Identifier: Apache-2.0
//
// Fillets and chamfers measured on drawn scans of concrete, compared with the drawn radii and legs.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "algo/algo.h"
#include "emulator/block_drawing.h"
#include "tests/algo/block_inspection.h"

namespace slabd::algo {
namespace {

using emulator::Effect;
using emulator::EffectStrengths;
using emulator::SurfaceKind;

Recipe with_pores() {
  Recipe recipe = scene::p5600();
  Tolerance& t = recipe.tolerances[static_cast<std::size_t>(ItemId::surface_pores)];
  t.given = true;
  t.nominal = {0.0, true};
  t.upper = 10.0;
  t.U = 1.0;
  recipe.edges = {4.0, 3.0, kNoValue};
  return recipe;
}

struct Measured {
  emulator::ConcreteTruth truth;
  BlockResult block;
};

/// Points beyond `view_to_mm` along the rail are left out.
Measured measured(const EffectStrengths& effects, std::uint64_t seed, double view_to_mm = 1e9) {
  const Recipe recipe = with_pores();
  emulator::ConcreteOrder order;
  order.effects = effects;
  order.seed = seed;
  order.truth = emulator::scattered_truth(recipe, emulator::nominal_truth(recipe), effects[Effect::cast], seed);
  const emulator::ConcreteView view = emulator::concrete_view(effects, seed);
  emulator::ConcreteScanner scanner;
  scanner.seed = seed;
  std::vector<float> xyz;
  const emulator::ConcreteScan scan = emulator::draw_concrete(recipe, order, view.T_scanner_block, scanner, seed, xyz);
  const Pose T_block_scanner = view.T_scanner_block.inverse();
  for (std::size_t i = 0; i < xyz.size(); i += 3)
    if ((T_block_scanner * Vec3(xyz[i], xyz[i + 1], xyz[i + 2])).x() > view_to_mm)
      std::fill_n(xyz.begin() + static_cast<std::ptrdiff_t>(i), 3, std::nanf(""));
  BlockInspector inspector(2);
  inspector.use(recipe);
  inspector.begin(1, Pose::identity(), view.T_block_scanner_reported);
  Cloud cloud{xyz, xyz.size() / 3, scan.drawn.width, scan.drawn.height};
  EXPECT_TRUE(inspector.denoise(cloud) && inspector.register_to_model(cloud) && inspector.extract(cloud));
  return {scan.truth, inspector.result()};
}

const EdgeFeature* edge_of(const BlockResult& block, EdgeFace face, EdgeFace face_to) {
  for (const EdgeFeature& edge : block.edges)
    if (edge.face == face && edge.face_to == face_to) return &edge;
  return nullptr;
}

struct Fillet {
  EdgeFace face;
  EdgeFace face_to;
  std::size_t drawn;  ///< index in ConcreteTruth::fillet_mm
};
constexpr std::array<Fillet, 4> kFillets = {{{EdgeFace::seat, EdgeFace::jaw_inner, 1},
                                             {EdgeFace::seat, EdgeFace::jaw_outer, 2},
                                             {EdgeFace::jaw_inner, EdgeFace::shoulder_inner, 0},
                                             {EdgeFace::jaw_outer, EdgeFace::shoulder_outer, 3}}};

TEST(EdgeShapes, radii_of_2_to_10_mm_are_learned) {
  int learned = 0;
  for (const double strength : {0.7, 1.0, 1.5, 2.0})
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      EffectStrengths effects(SurfaceKind::real);
      effects.set(Effect::fillet, strength);
      const Measured scan = measured(effects, seed);
      for (const Fillet& fillet : kFillets) {
        const double drawn_mm = scan.truth.fillet_mm[fillet.drawn];
        const EdgeFeature* edge = edge_of(scan.block, fillet.face, fillet.face_to);
        SCOPED_TRACE(::testing::Message() << "strength " << strength << ", seed " << seed << ", "
                                          << name(fillet.face_to) << ": drawn " << drawn_mm);
        if (drawn_mm < 2.0 || drawn_mm > 10.0) continue;
        ASSERT_NE(edge, nullptr);
        // Light in the corners raises the measured fillet.
        EXPECT_NEAR(edge->radius_mm, drawn_mm, 0.05 * drawn_mm + 0.65);
        EXPECT_FALSE(has_value(edge->chamfer_mm));
        EXPECT_EQ(edge->nominal_mm, fillet.face == EdgeFace::seat ? 4.0 : 3.0);
        EXPECT_GT(edge->n, 100U);
        ++learned;
      }
    }
  EXPECT_GT(learned, 20);
}

TEST(EdgeShapes, legs_of_3_to_8_mm_are_learned) {
  for (const double strength : {0.75, 1.0, 1.5, 2.0})
    for (std::uint64_t seed = 1; seed <= 1; ++seed) {
      EffectStrengths effects(SurfaceKind::real);
      effects.set(Effect::chamfer, strength);
      // A shoulder's end is 40 mm wide, so wear there changes the leg itself.
      effects.set(Effect::wear, 0.0);
      const Measured scan = measured(effects, seed);
      std::size_t legs = 0;
      for (const EdgeFeature& edge : scan.block.edges) {
        if (!has_value(edge.chamfer_mm)) continue;
        SCOPED_TRACE(::testing::Message() << "strength " << strength << ", seed " << seed << ", " << name(edge.face)
                                          << "/" << name(edge.face_to));
        // The block's ends and shoulders are cast up to 0.4 mm off their position.
        const bool at_side = edge.face_to == EdgeFace::side_inner || edge.face_to == EdgeFace::side_outer;
        EXPECT_NEAR(edge.chamfer_mm, scan.truth.chamfer_mm, at_side ? 0.35 : 1.0);
        EXPECT_FALSE(has_value(edge.radius_mm) || has_value(edge.nominal_mm));
        ++legs;
      }
      EXPECT_GE(legs, 6U);
    }
}

TEST(EdgeShapes, omit_sharp_edges_and_edges_beyond_the_view) {
  scene::Scan scan;
  scan.pitch_mm = 0.35;
  scan.organised = true;
  scan.displacement = scene::displaced(1.2, -0.8, 0.5, 0.15, -0.2, 0.1);
  for (const EdgeFeature& edge : inspect(scene::take({}, scan), with_pores()).edges)
    ADD_FAILURE() << name(edge.face) << "/" << name(edge.face_to) << ": " << edge.radius_mm << ", " << edge.chamfer_mm
                  << " of a block without fillets and chamfers";

  const Measured cut = measured(EffectStrengths(SurfaceKind::clean), 1, 95.0);
  EXPECT_NE(edge_of(cut.block, EdgeFace::seat, EdgeFace::end_minus), nullptr);
  for (const EdgeFeature& edge : cut.block.edges) EXPECT_NE(edge.face_to, EdgeFace::end_plus) << name(edge.face);
}

}  // namespace
}  // namespace slabd::algo
