// SPDX-License-Identifier: Apache-2.0
//
// slabctl recipe diff: keys, and the verdicts of another recipe for stored values.
#include "cli/recipe/recipe_diff.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>

#include "config/recipe_keys.h"
#include "tests/cli/stored_slab.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

struct RecipeDiff : StoredSlab {
  [[nodiscard]] std::string recipe_with(const std::string& text, const std::string& other) const {
    std::string recipe = content(kRecipe);
    const std::size_t at = recipe.find(text);
    EXPECT_NE(at, std::string::npos);
    return write("other.toml", recipe.replace(at, text.size(), other));
  }
  [[nodiscard]] json diff(const std::string& other, const std::string& more = "") const {
    const Ended ended = run("recipe diff " + kRecipe + " " + other + " --json " + more);
    EXPECT_EQ(ended.status, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }
};

TEST_F(RecipeDiff, names_each_key_once_and_what_it_changes) {
  EXPECT_TRUE(diff(recipe_with("# CRTS III", "# Comment"))["differences"].empty());
  const auto only = [&](const std::string& text, const std::string& other) {
    const json differences = diff(recipe_with(text, other))["differences"];
    EXPECT_EQ(differences.size(), 1U) << differences;
    return differences.empty() ? json() : differences[0];
  };
  EXPECT_EQ(only("guard = 1.0", "guard = 0.5"),
            (json{{"key", "guard"}, {"a", "1"}, {"b", "0.5"}, {"effect", "verdict"}}));
  EXPECT_EQ(only("remove_warp = true", "remove_warp = false")["effect"], "slab");
  EXPECT_EQ(only("crop_half_x_mm = 51.0", "crop_half_x_mm = 50.0")["effect"], "measured");
  EXPECT_EQ(only("tolerance = 0.5\nU = 0.15", "tolerance = 0.5\nU = 0.1")["effect"], "verdict");
  EXPECT_EQ(only("upper = \"1:37\"\nU = 0.03", "upper = \"1:37\"\nU = 0.02")["effect"], "measured")
      << "it also says which planes count";
  EXPECT_EQ(only("scanner_length_ppm = { value = 50,", "scanner_length_ppm = { value = 20,")["effect"], "measured");
  EXPECT_EQ(only("length_mm = { value = 5600, confirmed = false", "length_mm = { value = 5600, confirmed = true"),
            (json{{"key", "slab.length_mm.confirmed"}, {"a", "false"}, {"b", "true"}, {"effect", "none"}}));
  const json wider = diff(recipe_with("nominal = 380\ntolerance = 0.5", "nominal = 380\ntolerance = 2"));
  ASSERT_EQ(wider["differences"].size(), 2U);
  EXPECT_EQ(wider["differences"][0]["key"], "items.jaw_distance.lower");
  EXPECT_EQ(wider["differences"][1],
            (json{{"key", "items.jaw_distance.upper"}, {"a", "380.5"}, {"b", "382"}, {"effect", "verdict"}}));
  EXPECT_TRUE(wider["stored"].is_null());
}

TEST_F(RecipeDiff, the_same_recipe_makes_the_same_of_every_stored_value) {
  begin();
  measure(3);
  measure(4, "--defect jaw-distance=4:0.9");
  measure(12);
  end();
  const json same = diff(kRecipe, "--db " + db());
  EXPECT_EQ(same["stored"]["judged_with_a"], 1);
  EXPECT_EQ(same["stored"]["slabs"]["count"], 1);
  EXPECT_EQ(same["stored"]["slabs"]["changed"], 0);
  EXPECT_TRUE(same["stored"]["changed"].empty()) << same["stored"]["changed"];

  // With wider limits the fourth block passes; with narrower ones the others also fail. Their U does not change.
  const json wider =
      diff(recipe_with("nominal = 380\ntolerance = 0.5", "nominal = 380\ntolerance = 2"), "--db " + db());
  ASSERT_EQ(wider["stored"]["changed"].size(), 1U);
  const json& item = wider["stored"]["changed"][0]["items"][0];
  EXPECT_EQ(item["id"], "jaw_distance");
  EXPECT_EQ(item["station"], 4);
  EXPECT_EQ(item["stored"]["verdict"], "fail");
  EXPECT_EQ(item["now"]["verdict"], "pass");
  EXPECT_EQ(item["stored"]["value"], item["now"]["value"]);
  EXPECT_EQ(item["stored"]["U"], item["now"]["U"]);
}

TEST_F(RecipeDiff, differences_that_need_scans_are_reported) {
  begin();
  measure(3);
  end();
  const Ended ended = run("recipe diff " + kRecipe + " " +
                          recipe_with("crop_half_x_mm = 51.0", "crop_half_x_mm = 50.0") + " --db " + db());
  EXPECT_EQ(ended.status, 0);
  expect_mentions(ended.err, "1 differences change what is measured");
  expect_mentions(ended.out, "evaluation.crop_half_x_mm");
  // Slabs of another type cannot be judged.
  const Ended other =
      run("recipe diff " + kRecipe + " " + places::source_dir() + "/recipes/p4925.toml --slab-type 5600 --db " + db());
  expect_mentions(other.out, "left out: slab 1 \"SLAB-0042\": it has 18 blocks, the recipe 16");
}

/// A slab with one block that has only this item, without a budget and stored with `U`.
storage::SlabRecord stored_item(ItemId id, double value, double U) {
  Item item;
  item.id = id;
  item.station = 1;
  item.value = value;
  item.U = U;
  storage::SlabBlock block;
  block.phase = StationPhase::measured;
  block.attempt.station = 1;
  block.attempt.number = 1;
  block.block.station = 1;
  static_cast<void>(block.block.items.push(item));
  storage::SlabRecord record;
  record.summary.header.stations = 18;
  record.blocks.push_back(block);
  return record;
}

TEST_F(RecipeDiff, share_of_the_scan_in_U_is_kept) {
  Recipe b = recipe_;
  const auto set_U = [&](double U) { b.tolerances[static_cast<std::size_t>(ItemId::casing_spacing)].U = U; };
  Recipe with_smaller_U = recipe_;  // the recipe of the measurement
  with_smaller_U.tolerances[static_cast<std::size_t>(ItemId::casing_spacing)].U = 0.1;
  struct Now {
    double U = kNoValue;
    Verdict verdict = Verdict::none;
    int unknown = 0;
  };
  const auto now = [&](double value, double U, const Recipe* measured_with) {
    Now out;
    const Item item =
        rejudged(stored_item(ItemId::casing_spacing, value, U), b, measured_with, out.unknown)[0].block.items[0];
    out.U = item.U;
    out.verdict = item.verdict;
    return out;
  };
  const auto expect = [](const Now& is, double U, Verdict verdict, int unknown) {
    SCOPED_TRACE(fmt::format("U {} {}, expected {} {}", is.U, name(is.verdict), U, name(verdict)));
    EXPECT_TRUE(is.U == U || (!has_value(is.U) && !has_value(U)));
    EXPECT_EQ(is.verdict, verdict);
    EXPECT_EQ(is.unknown, unknown);
  };
  // Limits 232.5 .. 233.5. A stored U above the recipe's 0.1 is the U from the scan, which applies if b has a smaller
  // one.
  set_U(0.1);
  expect(now(233.3, 0.25, &with_smaller_U), 0.25, Verdict::indeterminate, 0);
  set_U(0.05);
  expect(now(233.3, 0.25, &with_smaller_U), 0.25, Verdict::indeterminate, 0);
  // The recipe of the measurement is unknown, or the stored U is the recipe's: the U from the scan may be smaller.
  expect(now(233.3, 0.25, nullptr), 0.25, Verdict::indeterminate, 1);
  expect(now(233.42, 0.1, &with_smaller_U), 0.1, Verdict::indeterminate, 1);
  expect(now(233.1, 0.25, nullptr), 0.25, Verdict::pass, 0);  // the same with either U
  // A larger U of b applies, and a missing one remains missing. Without a stored U the U from the scan is unknown.
  set_U(0.3);
  expect(now(233.1, 0.25, nullptr), 0.3, Verdict::pass, 0);
  expect(now(233.1, kNoValue, nullptr), 0.3, Verdict::pass, 1);
  expect(now(233.4, kNoValue, nullptr), 0.3, Verdict::indeterminate, 0);
  set_U(kNoValue);
  expect(now(233.1, 0.25, nullptr), kNoValue, Verdict::indeterminate, 0);
}

// A U whose known parts were larger than that of the recipe.
TEST_F(RecipeDiff, flatness_keeps_the_U_that_was_above_the_recipe) {
  Recipe b = recipe_;
  Tolerance& flatness = b.tolerances[static_cast<std::size_t>(ItemId::seat_flatness)];
  flatness.U = 0.05;
  const double value = flatness.upper - 0.07;
  int unknown = 0;
  const auto judged = [&](double U) { return rejudged(stored_item(ItemId::seat_flatness, value, U), b, &b, unknown); };
  EXPECT_EQ(judged(0.08)[0].block.items[0].verdict, Verdict::indeterminate);
  EXPECT_EQ(judged(0.05)[0].block.items[0].verdict, Verdict::pass);
  EXPECT_EQ(unknown, 0);
}

TEST_F(RecipeDiff, verdicts_that_only_scans_can_tell_are_counted) {
  recipe_.uncertainty.given = false;
  begin();
  measure(3);
  end();
  std::string without_budget = content(kRecipe);
  const std::size_t at = without_budget.find("[uncertainty]");
  without_budget.erase(at, without_budget.find("[items.seat_slope]") - at);
  // Items whose U came only from the budget need a U in the recipe.
  for (const char* item : {"seat_lateral", "seat_vertical", "seat_spacing", "large_jaw_distance", "corner_level",
                           "warp_left", "warp_right"}) {
    const std::string header = std::string("[items.") + item + "]\n";
    without_budget.insert(without_budget.find(header) + header.size(), "U = 0.2\n");
  }
  const std::size_t U = without_budget.find("tolerance = 0.5\nU = 0.15");
  without_budget.replace(U, 24, "tolerance = 0.2\nU = 0.05");
  const Ended ended = run("recipe diff " + kRecipe + " " + write("b.toml", without_budget) + " --json --db " + db());
  EXPECT_EQ(ended.status, 0) << ended.err;
  expect_mentions(ended.err, "warning: 1 verdicts of block items rest on what a scan adds to b's smaller U");
  EXPECT_EQ(json::parse(ended.out, nullptr, false)["stored"]["unknown_U"], 1);
}

TEST_F(RecipeDiff, a_filter_of_slabs_needs_a_database_to_be_heard) {
  for (const char* filter : {"--since garbage", "--until 7d", "--slab-type 5600", "--verdict pass"}) {
    const Ended ended = run("recipe diff " + kRecipe + " " + kRecipe + " " + filter);
    EXPECT_EQ(ended.status, 2) << filter;
    expect_mentions(ended.err, "say --db or --config too");
  }
}

TEST_F(RecipeDiff, every_key_is_named_once) {
  std::set<std::string> keys;
  for (const config::RecipeKey& key : config::keys_of(recipe_)) EXPECT_TRUE(keys.insert(key.key).second) << key.key;
  EXPECT_TRUE(keys.contains("items.seat_slope.upper"));
  EXPECT_TRUE(keys.contains("uncertainty.reference_deg"));
}

}  // namespace
}  // namespace slabd::cli
