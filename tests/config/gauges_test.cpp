// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include "tests/config/text_file.h"
#include "tests/places/places.h"

namespace slabd::config {
namespace {

using Texts = std::vector<std::string>;

constexpr const char* kLine =
    "[cell]\nT_base_slab = [1000, 0, 500, 1, 0, 0, 0]\n"
    "[calibration]\nT_flange_scanner = [0, 0, 120.5, 1, 0, 0, 0]\n";

const std::string kGauge =
    "[[gauge]]\nname = \"length_left\"\nunit = \"mm\"\nsource = \"plc:40\"\nu = 0.08\nvalid_s = 300\n"
    "master = { value = 5600.012, u = 0.02, every_h = 12, limit = 0.1 }\n";

class GaugesTest : public ::testing::Test {
 protected:
  Texts load(const std::string& text) {
    std::vector<Problem> problems;
    load_config(files_.write("slabd.toml", text), config_, problems);
    return files_.texts(problems);
  }
  TextFiles files_;
  Config config_;
};

TEST_F(GaugesTest, a_gauge_is_read_with_all_its_keys) {
  ASSERT_EQ(load(kLine + kGauge), Texts{});
  ASSERT_EQ(config_.gauges.size(), 1U);
  const GaugeSettings& gauge = config_.gauges[0];
  EXPECT_EQ(gauge.name.view(), "length_left");
  EXPECT_EQ(gauge.unit, ItemUnit::mm);
  EXPECT_EQ(gauge.link, GaugeLink::plc);
  EXPECT_EQ(gauge.plc_index, 0);
  EXPECT_EQ(gauge.scale, 1.0);
  EXPECT_EQ(gauge.u, 0.08);
  EXPECT_EQ(gauge.valid_ns, 300 * kNsPerS);
  EXPECT_TRUE(gauge.master.given);
  EXPECT_EQ(gauge.master.value, 5600.012);
  EXPECT_EQ(gauge.master.every_us, 12 * 3'600'000'000LL);
  EXPECT_FALSE(gauge.has_range());
  EXPECT_TRUE(config_.plc.gauges);
  ASSERT_EQ(config_.gauge_senders.size(), 1U) << "this computer";
}

TEST_F(GaugesTest, every_source_is_read) {
  ASSERT_EQ(load(kLine + with(kGauge, "\"plc:40\"", "\"plc:HR70\"")), Texts{});
  EXPECT_EQ(config_.gauges[0].plc_index, 15);
  ASSERT_EQ(load(kLine + with(kGauge, "\"plc:40\"", "\"modbus:10.0.0.5:502/255/65534\"")), Texts{});
  EXPECT_EQ(config_.gauges[0].host.view(), "10.0.0.5");
  EXPECT_EQ(config_.gauges[0].port, 502);
  EXPECT_EQ(config_.gauges[0].unit_id, 255);
  EXPECT_EQ(config_.gauges[0].address, 65534);
  EXPECT_FALSE(config_.plc.gauges);
  ASSERT_EQ(load(kLine + with(kGauge, "\"plc:40\"", "\"udp:5005\"") + "[gauges]\nallow = [\"192.168.7.0/24\"]\n"),
            Texts{});
  EXPECT_EQ(config_.gauges[0].port, 5005);
  EXPECT_EQ(config_.gauge_senders[0].mask, 0xFFFFFF00U);
  ASSERT_EQ(load(kLine + std::string("[[gauge]]\nname = \"tape\"\nunit = \"mm\"\nsource = \"operator\"\nu = 0.5\n")),
            Texts{})
      << "a person's instrument is checked elsewhere";
  EXPECT_EQ(config_.gauges[0].link, GaugeLink::manual);
  EXPECT_FALSE(config_.gauges[0].master.given);
}

TEST_F(GaugesTest, a_measuring_range_contains_the_master) {
  ASSERT_EQ(load(kLine + kGauge + "range = [5590, 5610.5]\n"), Texts{});
  EXPECT_TRUE(config_.gauges[0].has_range());
  EXPECT_EQ(config_.gauges[0].low, 5590.0);
  EXPECT_EQ(config_.gauges[0].high, 5610.5);
  for (const char* range : {"[5610, 5590]", "[5600]", "5600", "[\"a\", 5700]", "[5590, 1e6]"})
    EXPECT_THAT(load(kLine + kGauge + "range = " + range + "\n"),
                testing::Contains(testing::HasSubstr("gauge.range: found")))
        << range;
  EXPECT_THAT(load(kLine + kGauge + "range = [10, 20]\n"),
              testing::Contains(testing::HasSubstr("allowed is a range that contains the master, 5600.012")));
}

TEST_F(GaugesTest, the_number_of_an_instrument_has_a_format) {
  const std::string modbus = with(kGauge, "\"plc:40\"", "\"modbus:10.0.0.5:502/1/120\"");
  ASSERT_EQ(load(kLine + modbus), Texts{});
  EXPECT_EQ(config_.gauges[0].format, GaugeFormat::i32);
  EXPECT_FALSE(config_.gauges[0].low_word_first);
  ASSERT_EQ(load("[plc]\nword_order = \"cdab\"\n" + (kLine + modbus)), Texts{});
  EXPECT_TRUE(config_.gauges[0].low_word_first) << "as the PLC's";
  ASSERT_EQ(load(kLine + modbus + "format = \"f32\"\nregisters = \"input\"\nword_order = \"cdab\"\n"), Texts{});
  EXPECT_EQ(config_.gauges[0].format, GaugeFormat::f32);
  EXPECT_TRUE(config_.gauges[0].input_register);
  EXPECT_TRUE(config_.gauges[0].low_word_first);
}

TEST_F(GaugesTest, every_fault_is_named_with_line_key_and_allowed_range) {
  struct Case {
    std::string from;
    std::string to;
    std::string problem;  ///< part of it
  };
  const std::vector<Case> cases = {
      {"name = \"length_left\"\n", "", "slabd.toml:5:1: gauge.name: missing"},
      {"\"length_left\"", "\"Length\"", "slabd.toml:6:8: gauge.name: found \"Length\", allowed are up to 32"},
      {"unit = \"mm\"\n", "", "gauge.unit: missing; expected \"mm\" or \"deg\""},
      {"\"mm\"", "\"inch\"", "slabd.toml:7:8: gauge.unit"},
      {"\"plc:40\"", "\"plc:41\"", "gauge.source: found \"plc:41\", allowed is \"plc:40\" to \"plc:70\" (even)"},
      {"\"plc:40\"", "\"plc:72\"", "gauge.source: found \"plc:72\""},
      {"\"plc:40\"", "\"plc:HR\"", "gauge.source: found \"plc:HR\""},
      {"\"plc:40\"", "\"modbus:10.0.0.5/1/120\"", "gauge.source: found \"modbus:10.0.0.5/1/120\""},
      {"\"plc:40\"", "\"modbus:host:502/1/120\"", "gauge.source: found \"modbus:host:502/1/120\""},
      {"\"plc:40\"", "\"modbus:10.0.0.5:502/1/65535\"", "gauge.source: found register 65535, allowed with format i32"},
      {"\"plc:40\"", "\"udp:0\"", "gauge.source: found \"udp:0\""},
      {"\"plc:40\"", "\"file:x\"", "gauge.source: found \"file:x\""},
      {"u = 0.08\n", "", "gauge.u: missing"},
      {"u = 0.08\n", "u = 0\n", "gauge.u: found 0"},
      {"valid_s = 300", "valid_s = 0", "gauge.valid_s: found 0"},
      {"valid_s = 300", "scale = 0", "gauge.scale: found 0, allowed is any other number"},
      {"valid_s = 300", "format = \"i16\"", "gauge.format: has no meaning with this source"},
      {"valid_s = 300", "valid = 300", "gauge.valid: unknown key"},
      {"master = { value = 5600.012, u = 0.02, every_h = 12, limit = 0.1 }\n", "", "gauge.master: missing"},
      {", every_h = 12", "", "gauge.master.every_h: missing"},
      {", limit = 0.1", ", limit = 0", "gauge.master.limit: found 0"},
  };
  for (const Case& c : cases) {
    const Texts problems = load(kLine + with(kGauge, c.from, c.to));
    EXPECT_THAT(problems, testing::Contains(testing::HasSubstr(c.problem))) << c.from << " -> " << c.to;
    EXPECT_EQ(config_.gauges.size(), 0U) << "a faulty gauge is left out";
  }
}

TEST_F(GaugesTest, two_gauges_do_not_share_a_name_or_a_source) {
  const std::string right = with(kGauge, "length_left", "length_right");
  EXPECT_THAT(load(kLine + kGauge + kGauge), testing::Contains(testing::HasSubstr("found two gauges length_left")));
  EXPECT_THAT(load(kLine + kGauge + right),
              testing::Contains(testing::HasSubstr("found length_left and length_right with the same source, plc:40")));
  EXPECT_EQ(load(kLine + kGauge + with(right, "plc:40", "plc:42")), Texts{});
  EXPECT_THAT(files_.texts(config_.doubts),
              testing::Contains(testing::HasSubstr("length_left and length_right with masters of the same size")));
  EXPECT_EQ(load(kLine + kGauge + with(with(right, "plc:40", "plc:42"), "5600.012", "5601.5")), Texts{});
  EXPECT_THAT(files_.texts(config_.doubts), testing::Not(testing::Contains(testing::HasSubstr("masters of the same"))));
}

TEST_F(GaugesTest, more_gauges_than_registers_are_refused) {
  std::string text = kLine;
  for (int i = 0; i < 17; ++i)
    text += with(with(kGauge, "length_left", "g" + std::to_string(i)), "plc:40", "udp:" + std::to_string(5000 + i));
  EXPECT_THAT(load(text), testing::Contains(testing::HasSubstr("gauge: found 17, allowed are 16")));
  EXPECT_THAT(load(kLine + std::string("[gauge]\nname = \"a\"\n")),
              testing::Contains(testing::HasSubstr("gauge: found one table, allowed are [[gauge]] tables")));
}

// ---- formulas of a recipe ----------------------------------------------------------------------------------------

const std::string kItem =
    "\n[items.slab_length]\nformula = \"mean(length_left, length_right)\"\nnominal = 5600\ntolerance = 3\n"
    "required = true\nconfirmed = false\n";

class FormulaTest : public ::testing::Test {
 protected:
  Texts load(const std::string& item, const GaugeList* gauges = nullptr) {
    const std::string text = read_whole(places::source_dir() + "/recipes/p5600.toml") + item;
    std::filesystem::create_directory(files_.folder() + "/recipes");
    files_.write("recipes/r.toml", text);
    std::vector<Problem> problems;
    load_recipes(files_.folder() + "/recipes", recipes_, problems, nullptr, nullptr, gauges);
    Texts texts = files_.texts(problems);
    std::erase_if(texts, [](const std::string& one) { return one.find("no usable recipe") != std::string::npos; });
    return texts;
  }
  TextFiles files_;
  std::vector<Recipe> recipes_;
};

TEST_F(FormulaTest, an_item_of_gauges_is_read_with_its_formula) {
  ASSERT_EQ(load(kItem), Texts{});
  ASSERT_EQ(recipes_.size(), 1U);
  const Recipe& recipe = recipes_[0];
  EXPECT_EQ(text_of(recipe.formula(ItemId::slab_length)).view(), "mean(length_left, length_right)");
  EXPECT_TRUE(recipe.tolerance(ItemId::slab_length).given);
  EXPECT_FALSE(recipe.tolerance(ItemId::slab_width).given);
  EXPECT_EQ(recipe.tolerance(ItemId::slab_length).lower, 5597.0);
}

TEST_F(FormulaTest, every_fault_of_an_item_is_named) {
  struct Case {
    std::string from;
    std::string to;
    std::string problem;
  };
  const std::vector<Case> cases = {
      {"formula = \"mean(length_left, length_right)\"\n", "", "items.slab_length.formula: missing"},
      {"mean(length_left, length_right)", "sum(length_left, length_right)", "the form \"sum\" is unknown"},
      {"mean(length_left, length_right)", "difference(length_left)", "difference has 1 gauges, allowed are 2"},
      {"tolerance = 3\n", "tolerance = 3\nU = 0.1\n", "items.slab_length.U: found U of an item that gauges measure"},
      {"nominal = 5600\n", "nominal = 5500\n", "the geometry of this recipe gives 5600.0000 mm"},
      {"tolerance = 3\n", "", "found true without lower, upper or tolerance"},
  };
  for (const Case& c : cases)
    EXPECT_THAT(load(with(kItem, c.from, c.to)), testing::Contains(testing::HasSubstr(c.problem))) << c.to;
  EXPECT_THAT(load("\n[items.bottom_flatness]\nformula = \"range(a, b)\"\nnominal = 1\nupper = 3\nrequired = true\n"
                   "confirmed = false\n"),
              testing::Contains(testing::HasSubstr("items.bottom_flatness.nominal")));
}

TEST_F(FormulaTest, a_flatness_with_a_sign_needs_both_limits) {
  const auto flatness = [&](const std::string& formula, const std::string& limits) {
    return load("\n[items.bottom_flatness]\nformula = \"" + formula + "\"\nnominal = 0\n" + limits +
                "\nrequired = true\nconfirmed = false\n");
  };
  for (const char* formula : {"difference(a, b)", "mean(a, b)"}) {
    EXPECT_THAT(flatness(formula, "upper = 3"),
                testing::ElementsAre(testing::HasSubstr("items.bottom_flatness.lower: missing")))
        << formula;
    EXPECT_EQ(flatness(formula, "tolerance = 3"), Texts{});
  }
  EXPECT_EQ(flatness("range(a, b)", "upper = 3"), Texts{});
  EXPECT_EQ(flatness("plane4_flatness(a, b, c, d)", "upper = 3"), Texts{});
}

TEST_F(FormulaTest, the_gauges_of_a_formula_must_be_those_of_the_line) {
  GaugeList gauges;
  GaugeSettings gauge;
  gauge.name = "length_left";
  ASSERT_TRUE(gauges.push(gauge));
  EXPECT_THAT(
      load(kItem, &gauges),
      testing::ElementsAre(testing::AllOf(
          testing::HasSubstr("items.slab_length.formula: names the gauge length_right, allowed are the [[gauge]]"),
          testing::HasSubstr("length_left"), testing::HasSubstr("recipes/r.toml:"))));
  EXPECT_TRUE(recipes_.empty()) << "the recipe is not used";
  gauge.name = "length_right";
  gauge.unit = ItemUnit::deg;
  ASSERT_TRUE(gauges.push(gauge));
  EXPECT_THAT(load(kItem, &gauges),
              testing::Contains(testing::HasSubstr("length_right, whose unit is deg; allowed are gauges in mm")));
  gauges.back().unit = ItemUnit::mm;
  EXPECT_EQ(load(kItem, &gauges), Texts{});
}

TEST_F(FormulaTest, small_differences_need_gauges_with_a_measuring_range) {
  GaugeList gauges;
  GaugeSettings gauge;
  for (const char* name : {"a", "b"}) {
    gauge.name = name;
    ASSERT_TRUE(gauges.push(gauge));
  }
  const std::string item =
      "\n[items.bottom_flatness]\nformula = \"range(a, b)\"\nnominal = 0\nupper = 3\nrequired = true\n"
      "confirmed = false\n";
  EXPECT_THAT(load(item, &gauges), testing::Contains(testing::HasSubstr("names the gauge a without `range`")));
  for (GaugeSettings& each : gauges) {
    each.low = 40.0;
    each.high = 60.0;
  }
  EXPECT_EQ(load(item, &gauges), Texts{});
}

}  // namespace
}  // namespace slabd::config
