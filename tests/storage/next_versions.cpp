// SPDX-License-Identifier: Apache-2.0
#include "tests/storage/next_versions.h"

#include <gtest/gtest.h>

#include <string_view>

namespace slabd::storage {
namespace {

constexpr std::string_view kNewTable =
    "CREATE TABLE batch (number INTEGER PRIMARY KEY, made_utime_us INTEGER NOT NULL) STRICT;\n";
constexpr std::string_view kOldKinds = "'tie'))";
constexpr std::string_view kNewKinds = "'tie', 'batch'))";

void replace(std::string& text, std::string_view what, std::string_view with) {
  const std::size_t at = text.find(what);
  ASSERT_NE(at, std::string::npos) << what;
  text.replace(at, what.size(), with);
}

/// Text from `begin` to the first `end` after it, both included.
std::string part_of(std::string_view text, std::string_view begin, std::string_view end) {
  const std::size_t from = text.find(begin);
  const std::size_t to = text.find(end, from);
  EXPECT_NE(to, std::string_view::npos) << begin;
  return std::string(text.substr(from, to + end.size() - from));
}

/// Adds a column after the last one of a table in `text`.
void add_column(std::string& text, const std::string& table, const std::string& last_column,
                const std::string& column) {
  const std::string before = part_of(text, "CREATE TABLE " + table + " (", last_column);
  replace(text, before, before + ", " + column);
}

std::string first_step() {
  return std::string(kNewTable) + "ALTER TABLE slab ADD COLUMN batch INTEGER NOT NULL DEFAULT 0;";
}

}  // namespace

std::string NextVersions::second_step() {
  const std::string_view now = schema().sql;
  std::string table = part_of(now, "CREATE TABLE calibration (", ") STRICT;");
  replace(table, "CREATE TABLE calibration (", "CREATE TABLE calibration_new (");
  replace(table, kOldKinds, kNewKinds);
  return "ALTER TABLE batch ADD COLUMN strength REAL;\n" + table +
         "INSERT INTO calibration_new SELECT * FROM calibration;\n"
         "DROP TRIGGER calibration_stays;\nDROP TRIGGER calibration_is_kept;\nDROP TABLE calibration;\n"
         "ALTER TABLE calibration_new RENAME TO calibration;\n" +
         part_of(now, "CREATE TRIGGER calibration_stays", "END;") +
         part_of(now, "CREATE TRIGGER calibration_is_kept", "END;") +
         part_of(now, "CREATE TRIGGER calibration_is_new", "END;") + "ALTER TABLE item ADD COLUMN batch_U REAL;";
}

std::string NextVersions::fresh_text(int last) {
  std::string text = schema().sql;
  text += kNewTable;
  add_column(text, "slab", "emulated           INTEGER NOT NULL", "batch INTEGER NOT NULL DEFAULT 0");
  if (last == kFirst) return text;
  add_column(text, "batch", "made_utime_us INTEGER NOT NULL", "strength REAL");
  add_column(text, "item", "budget_tie REAL", "batch_U REAL");
  replace(text, kOldKinds, kNewKinds);
  return text;
}

NextVersions::NextVersions(int last, const std::string& second)
    : text_(fresh_text(last)),
      steps_([&] {
        std::vector<std::string> steps(schema().steps.begin(), schema().steps.end());
        steps.push_back(first_step());
        if (last == kLast) steps.push_back(second);
        return steps;
      }()),
      step_texts_([&] {
        std::vector<const char*> texts;
        for (const std::string& step : steps_) texts.push_back(step.c_str());
        return texts;
      }()),
      schema_{last, text_.c_str(), step_texts_},
      in_force_(schema_) {}

}  // namespace slabd::storage
