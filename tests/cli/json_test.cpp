// SPDX-License-Identifier: Apache-2.0
#include "cli/json.h"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

namespace slabd::cli {
namespace {

nlohmann::json parsed(const Json& json) {
  const auto document = nlohmann::json::parse(json.text(), nullptr, false);
  EXPECT_FALSE(document.is_discarded()) << json.text();
  return document;
}

TEST(JsonWriter, nan_and_infinity_become_null) {
  Json json;
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
    Json json;
    json.begin_array().value(number).end_array();
    EXPECT_EQ(parsed(json)[0].get<double>(), number);
  }
}

TEST(JsonWriter, any_bytes_make_valid_json) {
  const std::string nasty =
      std::string("quote\" back\\ newline\n bell\a bad\xff\xc0\x80 cut\xe4\xb8 ok\xe4\xb8\xad nul") + '\0';
  Json json;
  json.begin_object().field("text", std::string_view(nasty)).end_object();
  const auto text = parsed(json)["text"].get<std::string>();
  EXPECT_NE(text.find("quote\" back\\ newline\n bell\a"), std::string::npos);
  EXPECT_NE(text.find("ok\xe4\xb8\xad"), std::string::npos);
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
  Json json;
  json.begin_array();
  write_item(json, item);
  write_item(json, item, true);
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

TEST(JsonWriter, a_block_that_was_never_measured_says_so_everywhere) {
  Json json;
  json.begin_object();
  write_block(json, BlockResult{});
  json.end_object();
  const auto document = parsed(json);
  EXPECT_EQ(document["verdict"], "none");
  EXPECT_EQ(document["registration"]["status"], "none");
  EXPECT_TRUE(document["features"]["seat"]["flatness_mm"].is_null());
  EXPECT_EQ(document["registration"]["T_scanner_block"].size(), 4U);
  EXPECT_EQ(document["registration"]["deviation"]["within_sigma"].size(), 6U);
}

TEST(JsonWriter, times_are_utc_or_null) {
  EXPECT_EQ(iso_time(1'763'681'281'000'000), "2025-11-20T23:28:01Z");
  Json json;
  json.begin_object();
  write_time(json, "never", 0);
  json.end_object();
  EXPECT_TRUE(parsed(json)["never"].is_null());
}

}  // namespace
}  // namespace slabd::cli
