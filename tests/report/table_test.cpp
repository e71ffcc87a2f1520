// SPDX-License-Identifier: Apache-2.0
#include "report/table.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "report/content.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

report::Table example() {
  report::Table table{{"item<", "item"}, {"value", "value"}, {"times", "count"}, {"note?", "note"}, "verdict<"};
  table.title = "Two items";
  table.add("slope", report::Cell(1.0 / 3.0, 3), 2, "", Verdict::fail);
  table.add("=1+1, \"x\"", report::Cell(kNoValue, 3), 0, "", report::Cell(Verdict::none, ""));
  return table;
}

TEST(Table, a_terminal_has_rounded_numbers_and_symbols_and_no_empty_optional_column) {
  EXPECT_EQ(report::text_of(example()),
            "item       value  times  verdict\n"
            "--------------------------------\n"
            "slope      0.333      2  X fail\n"
            "=1+1, \"x\"      -      0  .\n");
}

TEST(Table, a_csv_has_every_digit_and_the_columns_with_a_name_and_no_formula) {
  const report::Table table = example();
  EXPECT_EQ(report::csv_heading(table), "item,value,count,note\r\n");
  EXPECT_EQ(report::csv_rows(table, report::TableFor::spreadsheet),
            "slope,0.3333333333333333,2,\r\n\"'=1+1, \"\"x\"\"\",,0,\r\n");
  EXPECT_EQ(report::csv_rows(table, report::TableFor::program),
            "slope,0.3333333333333333,2,\r\n\"=1+1, \"\"x\"\"\",,0,\r\n");
}

TEST(Table, json_has_numbers_as_numbers_and_null_for_what_is_not_there) {
  report::Json json("slabd.example/1");
  report::write_rows(json, "rows", example());
  const auto rows = nlohmann::json::parse(json.text())["rows"];
  EXPECT_EQ(rows[0], nlohmann::json({{"item", "slope"}, {"value", 1.0 / 3.0}, {"count", 2}, {"note", nullptr}}));
  EXPECT_TRUE(rows[1]["value"].is_null());
}

TEST(Table, html_has_a_caption_scopes_and_the_row_of_a_verdict) {
  report::Report page;
  page.sections.emplace_back().parts.emplace_back(example());
  const std::string html = report::html(page);
  for (const char* part : {"<caption>Two items</caption>", "<th scope=\"row\" class=\"words\">slope</th><td>0.333</td>",
                           "<tr class=\"fail\">", "✗ fail", "=1+1, &quot;x&quot;"})
    EXPECT_NE(html.find(part), std::string::npos) << part << html;
  EXPECT_EQ(html.find("note"), std::string::npos);
}

}  // namespace
}  // namespace slabd::cli
