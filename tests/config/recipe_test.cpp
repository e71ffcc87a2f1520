// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <sha256.h>

#include "config/recipe_keys.h"
#include "tests/config/text_file.h"
#include "tests/places/places.h"

namespace slabd::config {
namespace {

using Texts = std::vector<std::string>;

const std::string kP5600 = places::source_dir() + "/recipes/p5600.toml";

class RecipeTest : public ::testing::Test {
 protected:
  Texts load(const std::string& text) {
    std::vector<config::Problem> problems;
    config::load_recipe(files_.write("r.toml", text), recipe_, problems);
    return files_.texts(problems);
  }
  void load_p5600() {
    std::vector<config::Problem> problems;
    config::load_recipe(kP5600, recipe_, problems);
    ASSERT_EQ(files_.texts(problems), Texts{});
  }
  void expect_item(ItemId id, double nominal, double lower, double upper, double U, bool required) const {
    const Tolerance& t = recipe_.tolerance(id);
    const auto same = [](double a, double b) { return (std::isnan(a) && std::isnan(b)) || std::abs(a - b) < 1e-12; };
    EXPECT_TRUE(same(t.nominal.value, nominal)) << info(id).name << " nominal " << t.nominal.value;
    EXPECT_TRUE(same(t.lower, lower)) << info(id).name << " lower " << t.lower;
    EXPECT_TRUE(same(t.upper, upper)) << info(id).name << " upper " << t.upper;
    EXPECT_TRUE(same(t.U, U)) << info(id).name << " U " << t.U;
    EXPECT_EQ(t.required, required) << info(id).name;
    EXPECT_FALSE(t.confirmed) << info(id).name;
  }
  TextFiles files_;
  Recipe recipe_;
};

double slope_deg(double n) {
  return std::atan(1.0 / n) * 180.0 / kPi;
}

TEST_F(RecipeTest, p5600_geometry_is_the_reference) {
  load_p5600();
  EXPECT_EQ(recipe_.name.view(), "P5600");
  EXPECT_EQ(recipe_.slab_type, 5600);
  EXPECT_EQ(recipe_.stations(), 18);
  EXPECT_EQ(recipe_.slope_datum, SlopeDatum::slab_frame);
  EXPECT_TRUE(recipe_.remove_warp);
  EXPECT_EQ(recipe_.guard, 1.0);
  const SlabGeometry& s = recipe_.slab;
  EXPECT_EQ(s.length_mm.value, 5600);
  EXPECT_EQ(s.width_mm.value, 2500);
  EXPECT_EQ(s.thickness_mm.value, 200);
  EXPECT_EQ(s.pitch_mm.value, 630);
  EXPECT_EQ(s.first_pair_from_end_mm.value, 280);
  EXPECT_EQ(s.seat_centre_distance_mm.value, 1516);
  EXPECT_EQ(s.block_origin_z_mm.value, 30);
  const BlockGeometry& b = recipe_.block;
  EXPECT_EQ(b.cant_ratio.value, 40);
  EXPECT_EQ(b.jaw_half_distance_mm.value, 190);
  EXPECT_EQ(b.jaw_reference_height_mm.value, 10);
  EXPECT_DOUBLE_EQ(b.jaw_angle_rad.value, 110 * kPi / 180);
  EXPECT_EQ(b.shoulder_outer_z_mm.value, 29.75);
  EXPECT_EQ(b.shoulder_inner_z_mm.value, 20.25);
  EXPECT_EQ(b.end_half_length_mm.value, 105);
  EXPECT_EQ(b.side_half_width_mm.value, 240);
  EXPECT_DOUBLE_EQ(b.draft_rad.value, 10 * kPi / 180);
  EXPECT_EQ(b.slab_top_z_mm.value, -30);
  EXPECT_EQ(b.casing_half_spacing_mm.value, 116.5);
  EXPECT_EQ(b.casing_bore_diameter_mm.value, 30);
  EXPECT_EQ(b.casing_rim_diameter_mm.value, 44);
  EXPECT_EQ(b.casing_rim_height_mm.value, -0.25);
  const EvaluationSettings& e = recipe_.evaluation;
  EXPECT_EQ(e.crop_half_x_mm, 51);
  EXPECT_EQ(e.crop_half_s_mm, 75);
  EXPECT_EQ(e.cell_mm, 1.5);
  EXPECT_EQ(e.cell_points_min, 12);
  EXPECT_EQ(e.cells_missing_max, 0.05);
  EXPECT_EQ(e.defect_sigmas, 5.0);
  // First and last block of the reference: x = -2520 + 630 (i - 1), y = +-758, z = 30.
  EXPECT_TRUE(T_slab_block(recipe_, 1).translation_mm.isApprox(Vec3(-2520, 758, 30)));
  EXPECT_TRUE(T_slab_block(recipe_, 18).translation_mm.isApprox(Vec3(-2520, -758, 30)));
}

TEST_F(RecipeTest, p5600_states_what_is_assumed_of_the_measuring_system) {
  load_p5600();
  const UncertaintySettings& u = recipe_.uncertainty;
  EXPECT_TRUE(u.given);
  EXPECT_EQ(u.scanner_form_mm.value, 0.05);
  EXPECT_EQ(u.scanner_form_length_mm.value, 150);
  EXPECT_EQ(u.scanner_length_ppm.value, 50);
  EXPECT_EQ(u.reference_mm.value, 0.005);
  EXPECT_DOUBLE_EQ(u.reference_rad.value, 0.001 * kPi / 180);
  for (const Nominal& n :
       {u.scanner_form_mm, u.scanner_form_length_mm, u.scanner_length_ppm, u.reference_mm, u.reference_rad})
    EXPECT_FALSE(n.confirmed);
}

TEST_F(RecipeTest, unconfirmed_assumptions_of_the_uncertainty_are_counted) {
  load_p5600();
  const int all = unconfirmed_count(recipe_);
  std::string text = read_whole(kP5600);
  text = with(text, "scanner_length_ppm = { value = 50, confirmed = false }",
              "scanner_length_ppm = { value = 50, confirmed = true }");
  ASSERT_EQ(load(text), Texts{});
  EXPECT_EQ(unconfirmed_count(recipe_), all - 1);
}

TEST_F(RecipeTest, recipe_without_uncertainty_keeps_the_items_own_U) {
  std::string text = read_whole(kP5600);
  const std::size_t begin = text.find("[uncertainty]");
  text.erase(begin, text.find("[items.seat_slope]") - begin);
  text = with(text, "defect_sigmas = 5.0 ", "# ");
  for (const std::string item : {"seat_lateral", "seat_vertical", "seat_spacing", "large_jaw_distance", "corner_level",
                                 "warp_left", "warp_right"}) {
    // The item is required, and its uncertainty would be undefined.
    const std::string header = "[items." + item + "]\n";
    EXPECT_THAT(load(text), ::testing::Contains(::testing::HasSubstr("items." + item + ".U: missing")));
    text = with(text, header, header + "U = 0.2\n");
  }
  ASSERT_EQ(load(text), Texts{});
  EXPECT_FALSE(recipe_.uncertainty.given);
  EXPECT_EQ(recipe_.evaluation.defect_sigmas, 5.0);
  EXPECT_EQ(recipe_.tolerance(ItemId::jaw_distance).U, 0.15);
}

TEST_F(RecipeTest, p5600_items_are_the_reference) {
  load_p5600();
  const double none = kNoValue;
  expect_item(ItemId::seat_slope, slope_deg(40), slope_deg(43), slope_deg(37), 0.03, true);
  expect_item(ItemId::seat_flatness, 0, none, 1.0, 0.05, true);
  expect_item(ItemId::jaw_angle_inner, 110, 109, 111, 0.05, true);
  expect_item(ItemId::jaw_angle_outer, 110, 109, 111, 0.05, true);
  expect_item(ItemId::jaw_distance, 380, 379.5, 380.5, 0.15, true);
  expect_item(ItemId::casing_spacing, 233, 232.5, 233.5, 0.15, true);
  expect_item(ItemId::casing_protrusion_inner, -0.25, -0.5, 0, 0.15, true);
  expect_item(ItemId::casing_protrusion_outer, -0.25, -0.5, 0, 0.15, true);
  expect_item(ItemId::casing_skew_inner, 0, none, 2.0, 0.15, false);
  expect_item(ItemId::casing_skew_outer, 0, none, 2.0, 0.15, false);
  expect_item(ItemId::seat_lateral, 0, -0.5, 0.5, none, true);
  expect_item(ItemId::seat_vertical, 0, -0.5, 0.5, none, true);
  expect_item(ItemId::seat_spacing, 630, 629, 631, none, true);
  expect_item(ItemId::large_jaw_distance, 1895.38, 1894.38, 1896.38, none, true);
  expect_item(ItemId::corner_level, 0, -1, 1, none, true);
  expect_item(ItemId::warp_left, 0, -3, 3, none, true);
  expect_item(ItemId::warp_right, 0, -3, 3, none, true);
  expect_item(ItemId::seat_std, none, none, none, none, false);
}

TEST_F(RecipeTest, p5600_confirms_only_what_a_source_states) {
  load_p5600();
  EXPECT_TRUE(recipe_.block.cant_ratio.confirmed);
  EXPECT_TRUE(recipe_.slab.pitch_mm.confirmed);
  EXPECT_TRUE(recipe_.tolerance(ItemId::seat_slope).nominal.confirmed);
  EXPECT_FALSE(recipe_.block.jaw_angle_rad.confirmed);
  EXPECT_FALSE(recipe_.slab.seat_centre_distance_mm.confirmed);
  EXPECT_GT(unconfirmed_count(recipe_), 0) << "every tolerance is an assumption";
}

TEST_F(RecipeTest, a_nominal_block_passes_every_item_of_p5600) {
  load_p5600();
  for (std::size_t i = 0; i < kItemCount; ++i) {
    Item item = blank_item(recipe_, static_cast<ItemId>(i));
    if (!has_value(item.nominal)) continue;
    item.value = item.nominal;
    if (!has_value(item.U)) item.U = 0.1;  // contribution of the station sigma
    EXPECT_EQ(judge(item, recipe_.guard), Verdict::pass) << info(item.id).name;
  }
}

TEST_F(RecipeTest, sha256_is_of_the_bytes) {
  load_p5600();
  const std::string bytes = read_whole(kP5600);
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  SHA256_CTX context;
  SHA256Init(&context);
  for (const char c : bytes) SHA256Update(&context, reinterpret_cast<const std::uint8_t*>(&c), 1);
  SHA256End(&context, hex.data());
  EXPECT_EQ(recipe_.sha256.view(), hex.data());
  EXPECT_EQ(recipe_.path.view(), kP5600);
}

TEST_F(RecipeTest, short_slabs_have_eight_pairs_in_the_middle_and_the_block_of_p5600) {
  load_p5600();
  const Recipe p5600 = recipe_;
  for (const int type : {4925, 4856}) {
    SCOPED_TRACE(type);
    std::vector<config::Problem> problems;
    const std::string name = std::to_string(type);
    config::load_recipe(places::source_dir() + "/recipes/p" + name + ".toml", recipe_, problems);
    ASSERT_EQ(files_.texts(problems), Texts{});
    EXPECT_EQ(recipe_.name.view(), "P" + name);
    EXPECT_EQ(recipe_.slab_type, type);
    EXPECT_EQ(recipe_.stations(), 16);
    EXPECT_EQ(recipe_.slab.length_mm.value, type);
    EXPECT_EQ(recipe_.slab.pitch_mm.value, 617);
    // The overhang is equal at both ends.
    EXPECT_DOUBLE_EQ(T_slab_block(recipe_, 8).translation_mm.x(), -T_slab_block(recipe_, 1).translation_mm.x());
    EXPECT_EQ(T_slab_block(recipe_, 9).translation_mm.x(), T_slab_block(recipe_, 8).translation_mm.x());
    EXPECT_FALSE(recipe_.slab.length_mm.confirmed);
    EXPECT_FALSE(recipe_.slab.pitch_mm.confirmed);
    EXPECT_FALSE(recipe_.tolerance(ItemId::seat_spacing).nominal.confirmed);
    EXPECT_TRUE(recipe_.block.cant_ratio.confirmed) << "the paper states it for the family";
    // Pitch and its spacing nominal are assumptions here; for P5600 the paper states them.
    EXPECT_EQ(unconfirmed_count(recipe_), unconfirmed_count(p5600) + 1);
    EXPECT_EQ(recipe_.block.casing_half_spacing_mm.value, p5600.block.casing_half_spacing_mm.value);
    EXPECT_EQ(recipe_.evaluation.crop_half_x_mm, p5600.evaluation.crop_half_x_mm);
    for (std::size_t i = 0; i < kItemCount; ++i) {
      if (static_cast<ItemId>(i) == ItemId::seat_spacing) continue;
      const Tolerance& t = recipe_.tolerances[i];
      expect_item(static_cast<ItemId>(i), p5600.tolerances[i].nominal.value, p5600.tolerances[i].lower,
                  p5600.tolerances[i].upper, p5600.tolerances[i].U, t.required);
    }
  }
}

TEST_F(RecipeTest, every_recipe_that_is_shipped_is_good) {
  std::vector<Recipe> recipes;
  std::vector<config::Problem> problems;
  config::load_recipes(places::source_dir() + "/recipes", recipes, problems);
  EXPECT_EQ(files_.texts(problems), Texts{});
  EXPECT_EQ(recipes.size(), 3U);
}

/// Line of the first occurrence, from 1, so that the recipe may be edited without changing these tests.
std::size_t line_of(const std::string& text, const std::string& what) {
  const auto end = text.begin() + static_cast<std::ptrdiff_t>(text.find(what));
  return 1 + static_cast<std::size_t>(std::count(text.begin(), end, '\n'));
}

/// A change of p5600.toml and the expected message, where LINE is the line of the change.
struct Fault {
  const char* from;
  const char* to;
  const char* text;
};

class RecipeFaultTest : public RecipeTest, public ::testing::WithParamInterface<Fault> {};

TEST_P(RecipeFaultTest, is_named) {
  const Fault& fault = GetParam();
  const std::string text = with(read_whole(kP5600), fault.from, fault.to);
  const Texts problems = load(text);
  ASSERT_EQ(problems.size(), 1U) << (problems.size() > 1 ? problems[1] : "no problem found");
  EXPECT_EQ(problems[0], with(fault.text, "LINE", std::to_string(line_of(text, fault.to))));
}

INSTANTIATE_TEST_SUITE_P(
    P5600, RecipeFaultTest,
    ::testing::Values(
        Fault{"slabd.recipe/1", "slabd.recipe/2",
              "r.toml:LINE:10: schema: found \"slabd.recipe/2\", allowed is \"slabd.recipe/1\""},
        Fault{"name = \"P5600\"", "name = \"P56\\n00\"",
              "r.toml:LINE:8: name: found a control character, allowed is printable text on one line"},
        Fault{"slab_type = 5600 ", "slab_type = 70000 ",
              "r.toml:LINE:13: slab_type: found 70000, allowed is a whole number 1..65535"},
        Fault{"slope_datum = \"slab_frame\"", "slope_datum = \"floor\"",
              "r.toml:LINE:15: slope_datum: found \"floor\", allowed is \"slab_frame\" or \"local_slab_top\""},
        Fault{"guard = 1.0", "guard = -1", "r.toml:LINE:9: guard: found -1, allowed is a number 0..2"},
        Fault{"pairs = 9 ", "pairs = 10 ", "r.toml:LINE:9: slab.pairs: found 10, allowed is a whole number 6..9"},
        Fault{"pairs = 9 ", "pairs = 5 ", "r.toml:LINE:9: slab.pairs: found 5, allowed is a whole number 6..9"},
        Fault{
            "width_mm = { value = 2500, confirmed = false }", "width_mm = 2500",
            "r.toml:LINE:12: slab.width_mm: found 2500, allowed is { value = 1500..5000, confirmed = true or false }"},
        Fault{"width_mm = { value = 2500, confirmed = false }", "width_mm = { value = 2500 }",
              "r.toml:LINE:12: slab.width_mm.confirmed: missing; expected true or false"},
        Fault{"defect_sigmas = 5.0", "defect_sigmas = 2",
              "r.toml:LINE:17: evaluation.defect_sigmas: found 2, allowed is a number 3..20"},
        Fault{"guard = 1.0", "edges = { chamfer_mm = 1.5 }\nguard = 1.0",
              "r.toml:LINE:24: edges.chamfer_mm: found 1.5, allowed is a number 2..12"},
        Fault{"depth_max_mm = 5.0", "depth_max_mm = 0.1",
              "r.toml:LINE:16: items.surface_pores.depth_max_mm: found 0.1, allowed is a number 0.5..50"},
        Fault{"share_max = 0.02", "share_max = 2",
              "r.toml:LINE:13: items.surface_pores.share_max: found 2, allowed is a number 0.0001..1"},
        Fault{"end_half_length_mm = { value = 105,", "end_half_length_mm = { value = 109,",
              "r.toml:LINE:22: block.end_half_length_mm: found 109, allowed is at most 108 with the items "
              "surface_pores and block_damage"},
        Fault{"side_half_width_mm = { value = 240,", "side_half_width_mm = { value = 246,",
              "r.toml:LINE:22: block.side_half_width_mm: found 246, allowed is at most 245 with the items "
              "surface_pores and block_damage"},
        Fault{"scanner_form_mm = { value = 0.05,", "scanner_form_mm = { value = -0.05,",
              "r.toml:LINE:29: uncertainty.scanner_form_mm.value: found -0.05, allowed is a number 0..1"},
        Fault{"reference_deg = { value = 0.001,", "reference_deg = { value = 2,",
              "r.toml:LINE:27: uncertainty.reference_deg.value: found 2, allowed is a number 0..1"}));

TEST_F(RecipeTest, nominals_of_edges_and_limits_of_pores_are_optional) {
  const std::string whole = read_whole(kP5600);
  EXPECT_EQ(load(whole), Texts{});
  EXPECT_FALSE(has_value(recipe_.edges.fillet_seat_mm) || has_value(recipe_.edges.chamfer_mm));
  EXPECT_EQ(recipe_.pores.depth_max_mm, 5.0);
  EXPECT_EQ(recipe_.pores.share_max, 0.02);
  EXPECT_EQ(load(with(with(whole, "depth_max_mm = 5.0\n", ""), "share_max = 0.02\n", "") +
                 "\n[edges]\nfillet_seat_mm = 4\nfillet_shoulder_mm = 3.0\nchamfer_mm = 12\n"),
            Texts{});
  EXPECT_EQ(recipe_.edges.fillet_seat_mm, 4.0);
  EXPECT_EQ(recipe_.edges.fillet_shoulder_mm, 3.0);
  EXPECT_EQ(recipe_.edges.chamfer_mm, 12.0);
  EXPECT_FALSE(has_value(recipe_.pores.depth_max_mm) || has_value(recipe_.pores.share_max));
}

/// The recipe with its commented table of temperatures in force.
std::string with_thermal(std::string text) {
  const std::size_t begin = text.find("# [thermal]");
  for (std::size_t at = begin; text.compare(at, 2, "# ") == 0; at = text.find('\n', at) + 1) text.erase(at, 2);
  return text;
}

TEST_F(RecipeTest, temperatures_are_optional) {
  const std::string whole = read_whole(kP5600);
  ASSERT_EQ(load(whole), Texts{});
  EXPECT_FALSE(recipe_.thermal.given);
  const int unconfirmed = unconfirmed_count(recipe_);
  const std::size_t keys = config::keys_of(recipe_).size();
  ASSERT_EQ(load(with_thermal(whole)), Texts{});
  const ThermalSettings& t = recipe_.thermal;
  EXPECT_TRUE(t.given);
  EXPECT_EQ(t.reference_c.value, 20.0);
  EXPECT_EQ(t.cte_per_K.value, 1e-5);
  EXPECT_EQ(t.u_cte_per_K.value, 1e-6);
  EXPECT_EQ(t.u_temperature_K.value, 2.0);
  EXPECT_EQ(t.unknown_low_c.value, -10.0);
  EXPECT_EQ(t.unknown_high_c.value, 50.0);
  EXPECT_EQ(unconfirmed_count(recipe_), unconfirmed + 4) << "all but the reference";
  EXPECT_EQ(config::keys_of(recipe_).size(), keys) << "recipe diff compares the same keys of all recipes";
}

TEST_F(RecipeTest, faulty_temperatures_are_named) {
  const std::string whole = with_thermal(read_whole(kP5600));
  const auto refused = [&](const std::string& from, const std::string& to, const std::string& words) {
    EXPECT_THAT(load(with(whole, from, to)), ::testing::ElementsAre(::testing::HasSubstr(words))) << to;
  };
  const std::string range = "unknown_range_c = { value = [-10, 50], confirmed = false }";
  const std::string allowed = "allowed is { value = [low, high] within -40..90, confirmed = true or false }";
  refused(range, "unknown_range_c = { value = [50, -10], confirmed = false }", allowed);
  refused(range, "unknown_range_c = { value = [-50, 50], confirmed = false }", allowed);
  refused(range, "unknown_range_c = { value = [1, 2, 3], confirmed = false }", allowed);
  refused(range, "unknown_range_c = { value = 20, confirmed = false }", allowed);
  refused(range, "unknown_range_c = [-10, 50]", allowed);
  refused(range, "unknown_range_c = { value = [-10, 50] }", "thermal.unknown_range_c.confirmed: missing");
  refused(range, "", "thermal.unknown_range_c: missing");
  refused("cte_per_K = { value = 1.0e-5", "cte_per_K = { value = 1.0e-3", "thermal.cte_per_K.value: found 0.001");
  refused("reference_c = { value = 20", "reference_c = { value = 293", "thermal.reference_c.value: found 293");
}

TEST_F(RecipeTest, numbers_that_may_be_of_another_unit_are_doubted) {
  const std::string good = read_whole(kP5600);
  const auto doubts_of = [&](const std::string& from, const std::string& to) {
    Recipe recipe;
    std::vector<config::Problem> problems;
    std::vector<config::Problem> doubts;
    config::load_recipe(files_.write("doubted.toml", with(good, from, to)), recipe, problems, &doubts);
    EXPECT_TRUE(problems.empty()) << problems[0].text;
    return files_.texts(doubts);
  };
  EXPECT_EQ(doubts_of("cell_mm = 1.5\n", "cell_mm = 1.5\n"), Texts{});
  for (const auto& [from, to, words] :
       {std::tuple{"scanner_length_ppm = { value = 50,", "scanner_length_ppm = { value = 5e-5,", "a ratio?"},
        std::tuple{"reference_mm = { value = 0.005,", "reference_mm = { value = 5e-6,", "metres?"},
        std::tuple{"nominal = 380\ntolerance = 0.5", "nominal = 380\ntolerance = 500", "micrometres?"}}) {
    const Texts doubts = doubts_of(from, to);
    ASSERT_EQ(doubts.size(), 1U) << to;
    EXPECT_NE(doubts[0].find(words), std::string::npos) << doubts[0];
  }
}

TEST_F(RecipeTest, an_assumption_left_out_of_the_uncertainty_is_missed) {
  const Texts problems = load(with(read_whole(kP5600), "reference_mm = { value = 0.005, confirmed = false }\n", ""));
  ASSERT_EQ(problems.size(), 1U);
  EXPECT_NE(problems[0].find("uncertainty.reference_mm: missing; expected { value = 0..1, confirmed = true or false }"),
            std::string::npos)
      << problems[0];
}

TEST_F(RecipeTest, faults_name_the_nearest_key_and_the_range) {
  const std::string good = read_whole(kP5600);
  const auto places_cut = [](Texts problems) {
    for (std::string& text : problems) text.erase(0, text.find(": ") + 2);
    return problems;
  };
  const auto only = [&](const std::string& from, const std::string& to) {
    const Texts problems = places_cut(load(with(good, from, to)));
    return problems.size() == 1 ? problems[0] : "problems: " + std::to_string(problems.size());
  };
  EXPECT_EQ(only("cell_mm = 1.5\n", "cell_mm = 1.5\ncel_mm = 2\n"),
            "evaluation.cel_mm: unknown key; the nearest known one is \"cell_mm\"");
  const std::string wide = with(good, "crop_half_s_mm = 75.0", "crop_half_s_mm = 185");
  EXPECT_EQ(places_cut(load(with(wide, "cell_mm = 1.5\n", "cell_mm = 3\n"))),
            Texts{"evaluation.crop_half_s_mm: found 185 with edge_margin_mm 2, allowed is a crop inside the jaws' feet "
                  "at 186.36"});
  EXPECT_EQ(places_cut(load(with(good, "draft_deg", "draft_degrees"))),
            (Texts{"block.draft_deg: missing; expected { value = 0..45, confirmed = true or false }",
                   "block.draft_degrees: unknown key; the nearest known one is \"draft_deg\""}));
  EXPECT_EQ(only("cell_mm = 1.5\n", "cell_mm = 1.0\n"),
            "evaluation.cell_mm: found 1: the crop has 15300 such cells, allowed are 8500");
  EXPECT_EQ(only("cells_missing_max = 0.05", "cells_missing_max = 0.9"),
            "evaluation.cells_missing_max: found 0.9, allowed is a number 0..0.5");
  EXPECT_EQ(only("casing_bore_diameter_mm = { value = 30,", "casing_bore_diameter_mm = { value = 50,"),
            "block.casing_rim_diameter_mm: found 44, allowed is more than casing_bore_diameter_mm 50");
  EXPECT_EQ(only("first_pair_from_end_mm = { value = 280,", "first_pair_from_end_mm = { value = 600,"),
            "slab.pairs: the last of 9 pairs is 5640.0 mm from the end, beyond length_mm 5600.0");
  EXPECT_EQ(only("block_origin_z_mm = { value = 30,", "block_origin_z_mm = { value = 28,"),
            "slab.block_origin_z_mm: found 28.00, but [block] slab_top_z_mm -30.00 has the block's origin 30.00 above "
            "the slab top; allowed is a difference of 0.01");
  EXPECT_EQ(only("lower = \"1:43\"", "lower = \"1:30\""),
            "items.seat_slope.lower: found 1.90915 with upper 1.54816, allowed is lower < upper");
  EXPECT_EQ(only("lower = \"1:43\"", "lower = \"1:0\""),
            "items.seat_slope.lower: found \"1:0\", allowed is a number of deg within +-100000 or a slope \"1:n\" with "
            "n 1..10000");
  EXPECT_EQ(only("nominal = 380\ntolerance = 0.5", "nominal = 381\ntolerance = 0.5"),
            "items.jaw_distance.nominal: found 381.0000, but the geometry of this recipe gives 380.0000 mm; allowed is "
            "a difference of 0.01");
  EXPECT_EQ(only("nominal = 380\ntolerance = 0.5\nU = 0.15", "nominal = 380\ntolerance = 0.5\nU = 0.5"),
            "items.jaw_distance.U: found 0.5: with guard 1 no value can pass between 379.5000 and 380.5000");
  EXPECT_EQ(only("nominal = 380\ntolerance = 0.5", "nominal = 380\ntolerance = 0.5\nupper = 381"),
            "items.jaw_distance.tolerance: found together with lower or upper; allowed is either tolerance or lower "
            "and upper");
  EXPECT_EQ(only("[items.seat_flatness]\nnominal = 0\nupper = 1.0", "[items.seat_flatness]\nnominal = 0\nlower = 0.0"),
            "items.seat_flatness.upper: missing; expected a limit: without it any value above would pass");
  EXPECT_EQ(only("nominal = 380\ntolerance = 0.5", "nominal = 380\nupper = 380.5"),
            "items.jaw_distance.lower: missing; expected a limit: without it any value below would pass");
  EXPECT_EQ(only("[items.seat_flatness]\nnominal = 0\nupper = 1.0", "[items.seat_flatness]\nnominal = 0\nupper = -1.0"),
            "items.seat_flatness.nominal: found 0.0000, allowed is a nominal inside its own limits: at most -1.0000");
  EXPECT_EQ(only("cell_mm = 1.5", "cell_mm = 8"), "evaluation.cell_mm: found 8, allowed is a number 0.5..3");
  EXPECT_EQ(only("nominal = 380\n", ""),
            "items.jaw_distance.nominal: missing; expected the value that deviations are counted from");
  EXPECT_EQ(only("nominal = 380\ntolerance = 0.5\n", "nominal = 380\n"),
            "items.jaw_distance.required: found true without lower, upper or tolerance: such an item could never pass");
  EXPECT_EQ(only("[items.seat_std]\nrequired = false\nconfirmed = false\n", ""),
            "items.seat_std: missing; expected a table; an item that is not judged has required = false and no limits");
}

TEST_F(RecipeTest, an_item_that_is_information_cannot_be_made_to_judge) {
  const std::string good = read_whole(kP5600);
  const std::string before = "[items.seat_std]\nrequired = false\n";
  const auto problems_of = [&](const std::string& keys, const std::string& line) {
    const std::string text = with(good, before, "[items.seat_std]\n" + keys);
    Texts problems = load(text);
    EXPECT_EQ(problems.size(), 1U) << keys;
    if (problems.empty()) return std::string();
    EXPECT_TRUE(problems[0].starts_with("r.toml:" + std::to_string(line_of(text, line)) + ":")) << problems[0];
    return problems[0].substr(problems[0].find(": ") + 2);
  };
  const std::string never =
      ": found a limit of an item that is information and never judged; leave it out, seat_flatness is the item that "
      "judges the seat's surface";
  EXPECT_EQ(problems_of("required = false\nnominal = 0\nupper = 0.0301\n", "upper = 0.0301"),
            "items.seat_std.upper" + never);
  EXPECT_EQ(problems_of("required = false\nnominal = 0\nlower = -0.0301\n", "lower = -0.0301"),
            "items.seat_std.lower" + never);
  EXPECT_EQ(problems_of("required = false\nnominal = 0\ntolerance = 0.0301\n", "tolerance = 0.0301"),
            "items.seat_std.tolerance" + never);
  EXPECT_EQ(problems_of("required = true # info\n", "required = true # info"),
            "items.seat_std.required: found true for an item that is information and never judged; allowed is false");
  // A nominal with U but without limits is allowed; it does not judge.
  EXPECT_EQ(load(with(good, before, before + "nominal = 0.03\nU = 0.01\n")), Texts{});
}

TEST_F(RecipeTest, damaged_bytes_never_escape_as_an_exception) {
  const std::string good = read_whole(kP5600);
  Prng prng(11);
  for (int i = 0; i < 1500; ++i) {
    std::string text = good;
    for (int hit = 0; hit < 3; ++hit) text[prng.below(text.size())] = static_cast<char>(prng.below(256));
    static_cast<void>(load(text));
  }
}

/// Tests for a folder of recipes: only its current files count, not recipes loaded before.
class RecipeFolder : public RecipeTest {
 protected:
  std::string good_ = read_whole(kP5600);
  std::vector<Recipe> recipes_;
  std::vector<config::Problem> problems_;
  std::vector<storage::RecipeText> kept_;

  [[nodiscard]] std::string of_type(int type) const {
    return with(good_, "slab_type = 5600 ", "slab_type = " + std::to_string(type) + " ");
  }
  [[nodiscard]] std::vector<int> types() {
    problems_.clear();
    config::load_recipes(files_.folder(), recipes_, problems_, &kept_);
    EXPECT_EQ(kept_.size(), recipes_.size());
    std::vector<int> types;
    for (const Recipe& recipe : recipes_) types.push_back(recipe.slab_type);
    return types;
  }
};

TEST_F(RecipeFolder, is_read_in_order_and_leaves_faulty_recipes_out) {
  files_.write("c.toml", of_type(3));
  files_.write("a.toml", of_type(1));
  files_.write("b.toml", "slab_type = 2\nschema = 1\n");
  files_.write("notes.txt", "not a recipe");
  files_.write(".a.toml", "what an editor left");
  EXPECT_EQ(types(), (std::vector<int>{1, 3}));
  for (const std::size_t i : {0U, 1U}) {
    EXPECT_EQ(kept_[i].text, of_type(i == 0 ? 1 : 3));
    EXPECT_EQ(kept_[i].sha256, recipes_[i].sha256);
    EXPECT_EQ(kept_[i].name, recipes_[i].name);
  }
  const Texts texts = files_.texts(problems_);
  EXPECT_TRUE(texts.front().starts_with("b.toml:2:10: schema: found 1")) << texts.front();
}

TEST_F(RecipeFolder, uses_neither_of_two_files_of_a_type) {
  files_.write("p5600-new.toml", of_type(5600));
  files_.write("p5600.toml", of_type(5600));
  files_.write("p4900.toml", of_type(4900));
  EXPECT_EQ(types(), std::vector<int>{4900});
  EXPECT_EQ(files_.texts(problems_), Texts{"p5600.toml: slab_type: 5600 is also the type of p5600-new.toml; allowed is "
                                           "one file for each type, and of these none is used"});
}

TEST_F(RecipeFolder, a_file_with_a_slip_does_not_bring_back_the_one_before) {
  files_.write("p4900.toml", of_type(4900));
  files_.write("z-old.toml", of_type(5600));
  for (const char* slip : {"guard = 1.O", "guard = ", "[[["}) {
    files_.write("p5600.toml", of_type(5600) + "\n" + slip + "\n");
    EXPECT_EQ(types(), std::vector<int>{4900}) << slip;
    EXPECT_TRUE(
        files_.texts(problems_).back().starts_with("z-old.toml: slab_type: 5600 is also the type of p5600.toml"));
  }
}

TEST_F(RecipeFolder, no_recipe_is_used_while_the_folder_has_a_file_without_a_type) {
  files_.write("z-old.toml", of_type(5600));
  for (const std::string& text :
       {std::string(), std::string("schema = 1\n"), with(good_, "slab_type = 5600 ", "slab_type = \"5600\" "),
        with(good_, "slab_type = 5600 ", "slab_type = 56000000 "), with(good_, "slab_type = 5600 ", "slab_type = 0 "),
        with(good_, "slab_type = 5600 ", "slab_type = 56_00 x "), with(good_, "slab_type = 5600 ", "slab_typ = 5600 "),
        std::string(storage::kRecipeTextBytes + 1, '\n')}) {
    files_.write("p5600.toml", text);
    EXPECT_EQ(types(), std::vector<int>{}) << text.substr(0, 200);
    EXPECT_EQ(files_.texts(problems_).back(),
              "p5600.toml: its slab_type cannot be read, so it may be the better recipe for any type: no recipe is "
              "used until it is corrected or moved out of the folder");
  }
  std::filesystem::remove(files_.folder() + "/p5600.toml");
  std::filesystem::create_symlink("nowhere", files_.folder() + "/p5600.toml");
  EXPECT_EQ(types(), std::vector<int>{});
}

TEST_F(RecipeTest, a_recipe_from_its_bytes_is_the_one_from_its_file) {
  load_p5600();
  const Recipe& from_file = recipe_;
  Recipe from_bytes;
  std::vector<config::Problem> problems;
  config::parse_recipe("sha256 " + std::string(from_file.sha256.view()), read_whole(kP5600), from_bytes, problems);
  EXPECT_TRUE(problems.empty());
  EXPECT_EQ(from_bytes.sha256, from_file.sha256);
  EXPECT_EQ(from_bytes.slab.pitch_mm.value, from_file.slab.pitch_mm.value);
  EXPECT_TRUE(from_bytes.path.view().starts_with("sha256 "));
}

TEST_F(RecipeTest, a_recipe_that_is_too_long_to_be_kept_is_refused) {
  const std::string good = read_whole(kP5600);
  for (const std::size_t bytes : {storage::kRecipeTextBytes, storage::kRecipeTextBytes + 1}) {
    files_.write("long.toml", good + std::string(bytes - good.size(), '\n'));
    Recipe recipe;
    std::vector<config::Problem> problems;
    config::load_recipe(files_.folder() + "/long.toml", recipe, problems);
    EXPECT_EQ(problems.empty(), bytes == storage::kRecipeTextBytes) << bytes;
    if (problems.empty()) continue;
    EXPECT_NE(problems[0].text.find("found 65537 bytes, allowed are 65536"), std::string::npos) << problems[0].text;
  }
}

TEST_F(RecipeTest, folder_without_recipes_is_a_problem) {
  std::vector<Recipe> recipes;
  std::vector<config::Problem> problems;
  config::load_recipes(files_.folder(), recipes, problems);
  ASSERT_EQ(problems.size(), 1U);
  EXPECT_EQ(problems[0].text, files_.folder() + ": no usable recipe (*.toml) in this folder; slabd cannot measure");
  problems.clear();
  config::load_recipes(files_.folder() + "/none", recipes, problems);
  ASSERT_EQ(problems.size(), 1U) << "said once";
  EXPECT_EQ(problems[0].text, files_.folder() +
                                  "/none: the recipe folder cannot be read: No such file or directory; it is [recipes] "
                                  "dir of the configuration, and slabd's package fills it");
}

}  // namespace
}  // namespace slabd::config
