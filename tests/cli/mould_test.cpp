// SPDX-License-Identifier: Apache-2.0
//
// The commands of the moulds on a database that slabctl itself has filled: effects are those that were planted, the
// documents follow their schemas, and a reset begins a new epoch.
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>

#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

class Mould : public Slabctl {
 protected:
  [[nodiscard]] Ended history(const std::string& more) const {
    return run("simulate history --recipe " + kRecipe + " --out " + file("slabd.db") + " " + more);
  }
  [[nodiscard]] Ended mould(const std::string& more) const {
    return run("mould " + more + " --db " + file("slabd.db"));
  }
  /// Validates the documents with the published schemas.
  [[nodiscard]] bool is_valid(const std::string& documents) const {
    return std::system(("/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py " +
                        places::source_dir() + "/docs/schemas " + documents)
                           .c_str()) == 0;
  }
  [[nodiscard]] std::string config() const {
    return write("slabd.toml",
                 "[scanner]\ndrop_dir = \"drop\"\n[storage]\ndb = \"slabd.db\"\nspool_dir = \"spool\"\n"
                 "[recipes]\ndir = \"" +
                     places::source_dir() +
                     "/recipes\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[control]\nsocket = "
                     "\"control.sock\"\n");
  }
};

/// Mould (0: the line), item, station.
using At = std::tuple<int, std::string, int>;

int number(const json& value) {
  return value.is_null() ? 0 : value.get<int>();
}

std::map<At, double> planted(const json& truth) {
  std::map<At, double> list;
  const double days = truth["days"];
  for (const json& effect : truth["effects"])
    // Wear counts with its mean.
    list[{number(effect["mould"]), effect["item"], number(effect["station"])}] =
        effect["bias"].get<double>() + 0.5 * days * effect["change_per_day"].get<double>();
  return list;
}

TEST_F(Mould, effects_are_those_that_were_planted_in_the_history) {
  ASSERT_EQ(history("--slabs 240 --moulds 6 --seed 3").status, 0) << content(file("err"));
  const json truth = json::parse(content(file("slabd.truth.json")));
  const std::map<At, double> effects = planted(truth);
  EXPECT_EQ(truth["slabs"], 240);
  const Ended listed = mould("list --json");
  ASSERT_EQ(listed.status, 0) << listed.err;
  const json document = json::parse(listed.out);
  ASSERT_TRUE(is_valid(write("list.json", listed.out) + " " + file("slabd.truth.json")));
  ASSERT_EQ(document["moulds"].size(), 6U);
  EXPECT_TRUE(document["emulated"].get<bool>());
  std::size_t slabs = 0;
  int judged = 0;
  int within = 0;
  int found = 0;
  int wrong = 0;
  const auto judge = [&](int mould, const json& effect) {
    const auto at = effects.find({mould, effect["item"], number(effect["station"])});
    const double expected = at != effects.end() ? at->second : 0.0;
    ++judged;
    if (std::abs(effect["bias"].get<double>() - expected) <= effect["U"].get<double>()) ++within;
    const bool signal = effect["signal"] == (mould == 0 ? "line" : "mould");
    if (at == effects.end()) wrong += signal ? 1 : 0;
    if (at != effects.end()) found += signal ? 1 : 0;
  };
  for (const json& one : document["moulds"]) {
    slabs += one["slabs"].get<std::size_t>();
    EXPECT_EQ(one["epoch"], 1);
    for (const json& effect : one["effects"])
      if (effect["item"] != "seat_flatness") judge(one["mould"], effect);
  }
  for (const json& effect : document["line_effects"])
    if (effect["item"] != "seat_flatness") judge(0, effect);
  EXPECT_EQ(slabs, 240U);
  EXPECT_GT(judged, 1'200);
  EXPECT_GT(within, 0.92 * judged) << "wear is not scatter";
  EXPECT_GT(found, 30);
  EXPECT_LE(wrong, 3);
}

TEST_F(Mould, a_sheet_in_every_form_and_a_reset) {
  ASSERT_EQ(history("--slabs 100 --moulds 4 --days 60").status, 0) << content(file("err"));
  expect_mentions(mould("list").out, "mould");
  expect_mentions(mould("list --language zh").out, "模具");
  const Ended shown = mould("show 2 --full");
  expect_mentions(shown.out, "mould 2, epoch 1, slab type 5600");
  expect_mentions(shown.out, "seat, height [mm]");
  EXPECT_EQ(mould("show 77").status, 3);
  expect_mentions(mould("show 77").err, "no ended slab of mould 77");
  EXPECT_EQ(mould("show 0").status, 2);
  for (const char* name : {"sheet.pdf", "sheet.html", "sheet.csv", "sheet-zh.pdf", "sheet-zh.html"}) {
    const std::string language = std::string(name).find("zh") != std::string::npos ? " --language zh" : "";
    const Ended written = mould("sheet 2 --out " + file(name) + language);
    EXPECT_EQ(written.status, 0) << written.err;
    EXPECT_GT(content(file(name)).size(), 500U) << name;
  }
  EXPECT_EQ(content(file("sheet.pdf")).substr(0, 5), "%PDF-");
  expect_mentions(content(file("sheet.html")), "Sheet of a mould");
  expect_mentions(content(file("sheet-zh.html")), "模具调整单");
  const std::string csv = content(file("sheet.csv"));
  EXPECT_EQ(csv.substr(0, csv.find('\r')),
            "station,n,shim_mm,height_bias_mm,height_U_mm,slope_shim_mm_per_100,slope_bias_mm_per_100,"
            "slope_U_mm_per_100,action");
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 19);
  EXPECT_EQ(mould("sheet 2 --out sheet.txt").status, 2);

  // Half of the slabs were cast after the reset.
  const std::string reset = "mould reset 2 --why 'shims set' --config " + config() + " --operator anna --since 30d";
  const Ended done = run(reset);
  ASSERT_EQ(done.status, 0) << done.err;
  expect_mentions(done.out, "mould-2-epoch-2");
  EXPECT_EQ(run("mould reset 77 --why x --config " + config()).status, 3);
  EXPECT_EQ(run("mould reset 2 --why ' ' --config " + config()).status, 2);
  const Ended listed = mould("show 2 --json");
  const json document = json::parse(listed.out);
  ASSERT_TRUE(is_valid(write("show.json", listed.out)));
  ASSERT_EQ(document["moulds"].size(), 2U);
  EXPECT_EQ(document["moulds"][0]["epoch"], 1);
  EXPECT_FALSE(document["moulds"][0]["current"].get<bool>());
  EXPECT_EQ(document["moulds"][1]["epoch"], 2);
  EXPECT_TRUE(document["moulds"][1]["current"].get<bool>());
  ASSERT_EQ(document["resets"].size(), 1U);
  EXPECT_EQ(document["resets"][0]["who"], "anna");
  EXPECT_LT(document["moulds"][0]["last_utime"], document["resets"][0]["from_utime"]);
  EXPECT_GE(document["moulds"][1]["first_utime"], document["resets"][0]["from_utime"]);
  expect_mentions(mould("show 2").out, "shims set");
  expect_mentions(mould("sheet 2 --epoch 1 --out " + file("old.csv")).err, "was reset after these slabs were cast");
  EXPECT_EQ(mould("sheet 2 --epoch 3 --out " + file("old.csv")).status, 3);
}

TEST_F(Mould, the_history_is_a_whole_database_and_is_never_overwritten) {
  ASSERT_EQ(history("--slabs 30 --moulds 3").status, 0) << content(file("err"));
  const Ended again = history("--slabs 30 --moulds 3");
  EXPECT_EQ(again.status, 3);
  expect_mentions(again.err, "exists; a history is written to a new database only");
  const Ended check = run("db check --config " + config());
  EXPECT_EQ(check.status, 0) << check.out << check.err;
  const json slabs = json::parse(run("history --limit 100 --json --db " + file("slabd.db")).out);
  EXPECT_EQ(slabs["slabs"].size(), 30U);
  EXPECT_EQ(run("report 7 --db " + file("slabd.db") + " --out " + file("7.pdf")).status, 0);
  const json trend = json::parse(run("trend seat_vertical --json --mould 2 --db " + file("slabd.db")).out);
  EXPECT_EQ(trend["mould"], 2);
  EXPECT_GT(trend["slabs"].get<int>(), 2);
  EXPECT_LT(trend["slabs"].get<int>(), 30);
}

}  // namespace
}  // namespace slabd::cli
