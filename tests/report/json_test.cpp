// SPDX-License-Identifier: Apache-2.0
#include "report/json.h"
#include "base/fields.h"
#include "report/figures.h"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

namespace slabd::cli {
namespace {

nlohmann::json parsed(const report::Json& json) {
  const auto document = nlohmann::json::parse(json.text(), nullptr, false);
  EXPECT_FALSE(document.is_discarded()) << json.text();
  return document;
}

TEST(JsonWriter, nan_and_infinity_become_null) {
  report::Json json;
  json.begin_object();
  json.field("nan", kNoValue).field("inf", std::numeric_limits<double>::infinity()).field("one", 1.0);
  const std::array<double, 2> list = {kNoValue, -0.5};
  json.field("list", std::span<const double>(list)).end_object();
  const auto document = parsed(json);
  EXPECT_TRUE(document["nan"].is_null());
  EXPECT_TRUE(document["inf"].is_null());
  EXPECT_EQ(document["one"], 1.0);
  EXPECT_TRUE(document["list"][0].is_null());
  EXPECT_EQ(document["list"][1], -0.5);
}

TEST(JsonWriter, numbers_come_back_bit_for_bit) {
  const double numbers[] = {-0.024992190241, 1.0 / 3.0, 6.02e23, 5e-324, -0.0};
  for (const double number : numbers) {
    report::Json json;
    json.begin_array().value(number).end_array();
    EXPECT_EQ(parsed(json)[0].get<double>(), number);
  }
}

TEST(JsonWriter, any_bytes_make_valid_json) {
  const std::string nasty =
      std::string("quote\" back\\ newline\n bell\a bad\xff\xc0\x80 cut\xe4\xb8 ok\xe4\xb8\xad nul") + '\0';
  report::Json json;
  json.begin_object().field("text", std::string_view(nasty)).end_object();
  const auto text = parsed(json)["text"].get<std::string>();
  EXPECT_NE(text.find("quote\" back\\ newline\n bell\a"), std::string::npos);
  EXPECT_NE(text.find("ok\xe4\xb8\xad"), std::string::npos);
}

struct Turn {
  double turn_rad = kPi;
  Vec3 off_mm = Vec3(1.0, 2.0, kNoValue);
  std::optional<int> count;
  Verdict verdict = Verdict::pass;
};
SLABD_FIELDS(Turn, turn_rad, off_mm, count, verdict);

TEST(JsonWriter, a_record_is_the_object_of_its_fields_with_angles_in_degrees) {
  report::Json json("slabd.turns/1");
  json.field("turns", std::vector<Turn>(2)).key("pose").begin_object().field("matrix", Pose{}.matrix());
  const auto document = parsed(json);
  EXPECT_EQ(document["schema"], "slabd.turns/1");
  EXPECT_EQ(document["turns"].size(), 2U);
  const nlohmann::json turn = {
      {"turn_deg", 180.0}, {"off_mm", {1.0, 2.0, nullptr}}, {"count", nullptr}, {"verdict", "pass"}};
  EXPECT_EQ(document["turns"][1], turn);
  EXPECT_EQ(document["pose"]["matrix"][3], nlohmann::json::array({0, 0, 0, 1})) << "what is open is closed";
}

TEST(JsonWriter, items_carry_the_agreed_keys_and_null_for_what_was_not_measured) {
  Item item;
  item.id = ItemId::seat_slope;
  item.verdict = Verdict::not_measured;
  item.nominal = 1.432;
  item.lower = 1.3;
  item.upper = 1.5;
  item.U = 0.03;
  item.station = 4;
  report::Json json;
  json.begin_array();
  report::write_item(json, item);
  report::write_item(json, item, true);
  json.end_array();
  const auto document = parsed(json);
  for (const char* key : {"id", "unit", "nominal", "value", "deviation", "lower", "upper", "U", "verdict"})
    EXPECT_TRUE(document[0].contains(key)) << key;
  EXPECT_EQ(document[0]["id"], "seat_slope");
  EXPECT_EQ(document[0]["unit"], "deg");
  EXPECT_EQ(document[0]["verdict"], "not_measured");
  EXPECT_TRUE(document[0]["value"].is_null());
  EXPECT_TRUE(document[0]["deviation"].is_null());
  EXPECT_TRUE(document[0].contains("ratio_n"));
  EXPECT_FALSE(document[0].contains("stations"));
  EXPECT_EQ(document[1]["stations"], nlohmann::json::array({4}));
}

TEST(JsonWriter, a_block_that_was_never_measured_is_marked_everywhere) {
  report::Json json;
  json.begin_object();
  report::write_block(json, BlockResult{}, kNoValue);
  json.end_object();
  const auto document = parsed(json);
  EXPECT_EQ(document["verdict"], "none");
  EXPECT_EQ(document["registration"]["status"], "none");
  EXPECT_TRUE(document["features"]["seat"]["flatness_mm"].is_null());
  EXPECT_EQ(document["registration"]["T_scanner_block"].size(), 4U);
  EXPECT_EQ(document["registration"]["deviation"]["within_sigma"].size(), 6U);
}

TEST(JsonWriter, an_item_has_its_uncertainty_budget_and_its_conformance_probability) {
  Item item;
  item.id = ItemId::jaw_distance;
  item.value = 380.5;
  item.nominal = 380.0;
  item.lower = 379.5;
  item.upper = 380.5;
  item.U = 0.1;
  report::Json json;
  json.begin_array();
  report::write_item(json, item);
  item.budget[static_cast<std::size_t>(BudgetPart::scanner)] = 0.04;
  item.budget[static_cast<std::size_t>(BudgetPart::fit)] = 0.03;
  report::write_item(json, item);
  json.end_array();
  const auto document = parsed(json);
  EXPECT_TRUE(document[0]["budget"].is_null()) << "U is the recipe's";
  EXPECT_NEAR(document[0]["conformance_probability"].get<double>(), 0.5, 1e-9);
  const auto& budget = document[1]["budget"];
  EXPECT_EQ(budget.size(), kBudgetParts);
  EXPECT_EQ(budget["scanner"], 0.04);
  EXPECT_EQ(budget["fit"], 0.03);
  for (const char* part : {"noise", "registration", "calibration", "robot", "reference", "tie"})
    EXPECT_EQ(budget[part], 0.0) << part;
}

TEST(JsonWriter, precision_of_every_feature_is_written) {
  BlockResult block;
  block.registration.noise_mm = 0.03;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j) block.registration.covariance(i, j) = 10 * i + j;
  block.seat.noise_factor = 1.5;
  block.seat.flatness_noise_mm = 0.028;
  block.seat.flatness_mm = 0.1;
  block.seat.flatness_closed_mm = 0.1;
  block.seat.flatness_raw_mm = 0.4;
  block.seat.defect = {0.15, 12, 27.0, -0.4, 10.0, -20.0};
  block.jaw_outer.normal = Vec3::UnitZ();
  block.jaw_outer.centroid = Vec3(1, 2, 3);
  block.jaw_outer.sigma_offset_mm = 0.001;
  block.jaw_outer.cov_normal = Vec3(4e-8, 9e-8, 16e-8).asDiagonal();
  block.jaw_inner.doubt = PlaneDoubt::rival;
  block.seat.plane.ok = true;
  block.casing_inner.ok = true;
  block.casing_outer.doubt = CasingDoubt::rim_crust;
  block.casing_inner.inlier_fraction = 0.9;
  block.casing_inner.edge_rms_mm = 0.02;
  block.casing_inner.rim_std_mm = 0.031;
  block.casing_inner.sigma_height_mm = 0.002;
  block.casing_inner.cov_circle = Mat3::Identity();
  report::Json json;
  json.begin_object();
  report::write_block(json, block, 1.5);
  json.end_object();
  const auto document = parsed(json);
  EXPECT_EQ(document["registration"]["noise_mm"], 0.03);
  EXPECT_EQ(document["registration"]["covariance"].size(), 6U);
  EXPECT_EQ(document["registration"]["covariance"][2], nlohmann::json::array({20, 21, 22, 23, 24, 25}));
  const auto& seat = document["features"]["seat"];
  EXPECT_EQ(seat["flatness_operator"], "cell mean 1.5 mm, least-squares plane, closed from above");
  EXPECT_EQ(seat["noise_factor"], 1.5);
  EXPECT_EQ(seat["flatness_noise_mm"], 0.028);
  EXPECT_EQ(seat["defect"], (nlohmann::json{{"limit_mm", 0.15},
                                            {"cells", 12},
                                            {"area_mm2", 27.0},
                                            {"height_mm", -0.4},
                                            {"x_mm", 10.0},
                                            {"s_mm", -20.0}}));
  const auto& jaw = document["features"]["jaw_outer"];
  EXPECT_EQ(jaw["centroid_mm"], nlohmann::json::array({1, 2, 3}));
  EXPECT_EQ(jaw["sigma_offset_mm"], 0.001);
  EXPECT_NEAR(jaw["sigma_normal"][2].get<double>(), 4e-4, 1e-12);
  EXPECT_EQ(jaw["cov_normal"][1][1], 9e-8);
  const auto& casing = document["features"]["casing_inner"];
  EXPECT_EQ(casing["edge_rms_mm"], 0.02);
  EXPECT_EQ(casing["rim_std_mm"], 0.031);
  EXPECT_EQ(casing["inlier_fraction"], 0.9);
  EXPECT_EQ(casing["sigma_height_mm"], 0.002);
  EXPECT_EQ(casing["cov_circle"].size(), 3U);
  EXPECT_TRUE(seat["doubt"].is_null());
  EXPECT_TRUE(casing["doubt"].is_null());
  EXPECT_EQ(document["features"]["jaw_inner"]["doubt"], "rival");
  EXPECT_EQ(document["features"]["casing_outer"]["doubt"], "rim_crust");

  report::Json without;
  without.begin_object();
  report::write_block(without, BlockResult{}, kNoValue);
  without.end_object();
  const auto unknown = parsed(without);
  EXPECT_TRUE(unknown["features"]["seat"]["defect"].is_null()) << "not computed is not 'no defect'";
  EXPECT_EQ(unknown["features"]["seat"]["flatness_operator"], "cell mean, least-squares plane");
  EXPECT_EQ(unknown["features"]["seat"]["doubt"], "not_fitted");
  EXPECT_EQ(unknown["features"]["casing_inner"]["doubt"], "not_measured");
  EXPECT_TRUE(unknown["registration"]["covariance"][5][5].is_null());
}

TEST(JsonWriter, times_are_utc_or_null) {
  EXPECT_EQ(report::iso_time(1'763'681'281'000'000), "2025-11-20T23:28:01Z");
  report::Json json;
  json.begin_object();
  report::write_time(json, "never", 0);
  json.end_object();
  EXPECT_TRUE(parsed(json)["never"].is_null());
}

}  // namespace
}  // namespace slabd::cli
