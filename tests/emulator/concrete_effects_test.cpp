// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_effects.h"

#include <gtest/gtest.h>

#include <fmt/core.h>

namespace slabd::emulator {
namespace {

TEST(ConcreteEffects, every_name_is_taken_with_its_strength) {
  EffectStrengths strengths;
  for (const EffectInfo& effect : effects()) {
    EXPECT_EQ(strengths.take(fmt::format("{}=1.5", effect.name)), std::nullopt) << effect.name;
    EXPECT_EQ(strengths[effect.effect], 1.5) << effect.name;
  }
  EXPECT_EQ(strengths.take("standoff=-2"), std::nullopt);
  EXPECT_EQ(strengths[Effect::standoff], -2.0);
}

TEST(ConcreteEffects, an_unknown_name_is_refused_with_all_names) {
  EffectStrengths strengths;
  const auto refused = strengths.take("poers=1");
  ASSERT_TRUE(refused);
  EXPECT_NE(refused->find("'poers'"), std::string::npos);
  for (const EffectInfo& effect : effects()) EXPECT_NE(refused->find(effect.name), std::string::npos) << effect.name;
}

TEST(ConcreteEffects, a_wrong_strength_is_refused_and_leaves_the_scene_unchanged) {
  EffectStrengths strengths(SurfaceKind::real);
  for (const char* text : {"voids", "voids=", "voids=x", "voids=-1", "voids=11", "voids=nan", "voids=1 "}) {
    const auto refused = strengths.take(text);
    ASSERT_TRUE(refused) << text;
    EXPECT_NE(refused->find("voids=STRENGTH"), std::string::npos) << *refused;
  }
  EXPECT_EQ(strengths[Effect::voids], 1.0);
}

TEST(ConcreteEffects, surfaces_have_the_documented_strengths) {
  const EffectStrengths ideal(SurfaceKind::ideal);
  const EffectStrengths clean(SurfaceKind::clean);
  const EffectStrengths real(SurfaceKind::real);
  for (const EffectInfo& effect : effects()) {
    EXPECT_EQ(ideal[effect.effect], effect.effect == Effect::noise ? 1.0 : 0.0) << effect.name;
    EXPECT_EQ(real[effect.effect], effect.usual) << effect.name;
    if (effect.effect == Effect::voids || effect.effect == Effect::dust) continue;
    EXPECT_EQ(clean[effect.effect], effect.usual) << effect.name;
  }
  EXPECT_EQ(clean[Effect::voids], 0.25);
  EXPECT_EQ(clean[Effect::dust], 0.2);
}

TEST(ConcreteEffects, surfaces_are_found_by_name) {
  for (const SurfaceKind kind : {SurfaceKind::ideal, SurfaceKind::clean, SurfaceKind::real}) {
    const auto found = surface_named(name(kind));
    ASSERT_TRUE(found);
    EXPECT_EQ(found.value(), kind);
  }
  const auto refused = surface_named("reel");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().text.view().find("ideal, clean, real"), std::string_view::npos);
}

TEST(ConcreteEffects, defects_are_taken_by_name_with_their_usual_size) {
  for (const ConcreteDefectInfo& defect : concrete_defects()) {
    const auto usual = parse_concrete_defect(defect.name);
    ASSERT_TRUE(usual) << defect.name;
    EXPECT_EQ(usual.value().kind, defect.kind);
    EXPECT_EQ(usual.value().size, defect.usual);
    const auto sized = parse_concrete_defect(fmt::format("{}=0.75", defect.name));
    ASSERT_TRUE(sized);
    EXPECT_EQ(sized.value().size, 0.75);
    EXPECT_FALSE(parse_concrete_defect(fmt::format("{}=big", defect.name)));
  }
  const auto refused = parse_concrete_defect("crak");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().text.view().find("crack"), std::string_view::npos);
}

TEST(ConcreteEffects, the_help_names_every_effect) {
  const std::string help = effect_help();
  for (const EffectInfo& effect : effects()) EXPECT_NE(help.find(effect.name), std::string::npos) << effect.name;
}

}  // namespace
}  // namespace slabd::emulator
