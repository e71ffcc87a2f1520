// SPDX-License-Identifier: Apache-2.0
//
// slabctl study as a process: on scans, stored slabs and tables.
#include <fmt/core.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/prng.h"
#include "cli/study/csv.h"
#include "cli/study/source.h"
#include "storage/storage.h"
#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;
using study::CsvTable;

class StudyTest : public Slabctl {
 protected:
  double upper_of_last_ = 1.5321;  ///< the newest inspection may have another recipe's limit
  std::string id_of_last_;         ///< empty: the same as the others

  void simulate_block(int block, const std::string& out) {
    const Ended ended = run("simulate scan --points quarter --recipe " + kRecipe + " --block " + std::to_string(block) +
                            " --out " + file(out));
    ASSERT_EQ(ended.status, 0) << ended.err;
  }

  /// Inspections of slab T-1: two blocks with slopes scattered by 0.001 deg about 1.43 and 1.45.
  void store(int inspections) {
    auto opened = storage::open_store({file("slabd.db"), file("spool"), 0});
    ASSERT_TRUE(opened.ok());
    Prng prng(11);
    for (int key = 1; key <= inspections; ++key) {
      const auto apply = [&](const decltype(StoreJob::what)& what) {
        const Status status = opened.value()->apply({1, what});
        ASSERT_TRUE(status.ok()) << status.error().text.view();
      };
      SlabHeader header;
      header.key = key;
      header.slab_id = key % 6 != 0 ? "T-1" : "T-10";
      if (key == inspections && !id_of_last_.empty()) header.slab_id.assign(id_of_last_);
      header.stations = 2;
      header.recipe = "P5600";
      header.began_utime_us = 1'763'681'281'000'000 + key;
      apply(BeginSlabJob{header, 1, 1});
      for (const int station : {1, 2}) {
        Attempt attempt;
        attempt.slab_key = key;
        attempt.station = static_cast<std::uint8_t>(station);
        attempt.number = 1;
        apply(AcquiredJob{attempt});
        BlockResult block;
        block.station = attempt.station;
        Item slope;
        slope.id = ItemId::seat_slope;
        slope.station = attempt.station;
        slope.value = (station == 1 ? 1.43 : 1.45) + 0.001 * prng.normal();
        slope.nominal = 1.432096;
        slope.lower = 1.3321;
        slope.upper = key == inspections ? upper_of_last_ : 1.5321;
        slope.U = 0.02;
        EXPECT_TRUE(block.items.push(slope));
        PlcResult record;
        record.kind = 1;
        record.res_seq = static_cast<std::uint16_t>(key * 10 + station);
        record.station = attempt.station;
        apply(BlockJob{key, 1, block, record, {}});
      }
      PlcResult record;
      record.kind = 2;
      record.res_seq = static_cast<std::uint16_t>(key * 10 + 5);
      SlabResult slab;
      if (slab_slope_for_information_) {
        Item slope;
        slope.id = ItemId::seat_slope;
        slope.station = 1;
        slope.value = 1.6;
        EXPECT_TRUE(slab.items.push(slope));
      }
      apply(SlabJob{key, slab, record, header.began_utime_us + 1'000'000});
    }
  }
  [[nodiscard]] static json parsed(const Ended& ended) { return json::parse(ended.out, nullptr, false); }

  bool slab_slope_for_information_ = false;  ///< slopes are judged against the slab's top, for each block
};

TEST_F(StudyTest, csv_reads_what_people_write_and_names_what_it_cannot_read) {
  const auto table =
      CsvTable::parse("\xEF\xBB\xBF# a comment\nid; value ;block\r\n\"a;\"\"b\"\"\" ; +1.5;3\n\n x ;;\n", "t.csv");
  ASSERT_TRUE(table.ok()) << table.error().text.view();
  EXPECT_EQ(table.value().cell(0, "id"), "a;\"b\"");
  EXPECT_EQ(table.value().number(0, "value").value(), 1.5);
  EXPECT_EQ(table.value().block(0).value(), 3);
  EXPECT_TRUE(std::isnan(table.value().number(1, "value").value()));
  EXPECT_EQ(table.value().place(1), "t.csv:5");
  const auto why = [](const char* text) {
    const auto wrong = CsvTable::parse(text, "t.csv");
    return wrong.ok() ? std::string() : std::string(wrong.error().text.view());
  };
  expect_mentions(why("a,b\n1\n"), "t.csv:2: 1 cells");
  expect_mentions(why("a,a\n1,2\n"), "two columns are named 'a'");
  expect_mentions(why("a,b\n\"1,2\n"), "t.csv:2: a quote");
  expect_mentions(why("a,b\n"), "no values");
  expect_mentions(why(""), "no values");
  const auto comma = CsvTable::parse("item;value;block\nx;1,5;19\n", "t.csv");
  expect_mentions(std::string(comma.value().number(0, "value").error().text.view()), "t.csv:2: value '1,5'");
  expect_mentions(std::string(comma.value().block(0).error().text.view()), "1..18");
  expect_mentions(std::string(comma.value().expect({"item"}, {"value"}).error().text.view()), "no column 'block'");
  expect_mentions(std::string(comma.value().expect({"run"}, {}).error().text.view()), "column missing: run");
}

TEST_F(StudyTest, repeat_of_a_table_gives_the_reference_figures) {
  std::string text = "item,value\n";
  for (const char* value : {"10.00", "10.01", "9.99", "10.02", "10.00", "9.98", "10.01", "10.00", "9.99", "10.01"})
    text += std::string("pin,") + value + "\n";
  const std::string values = write("values.csv", text);
  const Ended ended = run("study repeat --values " + values + " --reference pin=10 --tolerance pin=0.5 --json");
  EXPECT_EQ(ended.status, 1) << "ten runs are too few\n" << ended.err;
  const json study = parsed(ended);
  ASSERT_TRUE(study.is_object()) << ended.out;
  EXPECT_EQ(study["schema"], "slabd.study_repeat/1");
  EXPECT_EQ(study["judgement"], "undecided");
  const json pin = study["characteristics"][0];
  EXPECT_EQ(pin["n"], 10);
  EXPECT_NEAR(pin["std"].get<double>(), 0.011972190, 5e-10);
  EXPECT_NEAR(pin["gauge"]["cg"].get<double>(), 1.392115, 5e-7);
  EXPECT_NEAR(pin["gauge"]["cgk"].get<double>(), 1.364273, 5e-7);
  const Ended shown = run("study repeat --values " + values + " --reference pin=10 --tolerance pin=0.5");
  expect_mentions(shown.out, "too few runs: 10 of 50");
  expect_mentions(shown.out, "1.39");
  expect_mentions(shown.err, "0.69 .. 1.83");
}

TEST_F(StudyTest, repeat_of_a_table_counts_what_was_not_measured) {
  const std::string values = write("values.csv", "run,item,block,value\n1,a,1,5\n2,a,1,\n3,a,1,7\n1,b,2,1\n2,b,2,2\n");
  const json study = parsed(run("study repeat --values " + values + " --json"));
  ASSERT_EQ(study["characteristics"].size(), 2U);
  EXPECT_EQ(study["characteristics"][0]["missing"], 1);
  EXPECT_TRUE(study["characteristics"][0]["values"][1].is_null());
  EXPECT_EQ(study["characteristics"][0]["range"], 2.0);
  EXPECT_EQ(study["characteristics"][1]["missing"], 1) << "run 3 does not have it at all";
  const Ended twice = run("study repeat --values " + write("twice.csv", "run,item,value\n1,a,5\n1,a,6\n"));
  EXPECT_EQ(twice.status, 3);
  expect_mentions(twice.err, "twice.csv:3: run 1 has a twice");
}

TEST_F(StudyTest, repeat_of_a_block_that_no_run_measured_is_undecided_if_requested) {
  std::string text = "run,item,block,value,lower,upper\n";
  for (int run = 1; run <= 50; ++run) {
    text += std::to_string(run) + ",slope,1," + std::to_string(1.43 + 0.0001 * (run % 7)) + ",1.33,1.53\n";
    text += std::to_string(run) + ",slope,2,,1.33,1.53\n";
  }
  const std::string what = "study repeat --values " + write("values.csv", text);
  EXPECT_EQ(run(what + " --reference slope@1=1.4303").status, 0);
  const Ended ended = run(what + " --reference slope=1.4303");
  EXPECT_EQ(ended.status, 1) << ended.out;
  expect_mentions(ended.out, "not measured in 50 of 50 runs");
  const json study = parsed(run(what + " --reference slope=1.4303 --json"));
  EXPECT_EQ(study["judgement"], "undecided");
  EXPECT_EQ(study["characteristics"][1]["missing"], 50);
  EXPECT_EQ(run(what + " --reference slope=1.4303 --out " + file("study.html")).status, 1);
  EXPECT_EQ(parsed(run(what + " --json"))["characteristics"].size(), 1U) << "not requested";
}

TEST_F(StudyTest, repeat_with_a_reference_and_no_tolerance_is_undecided) {
  std::string text = "item,value,upper\n";
  for (int run = 1; run <= 50; ++run) text += "flatness," + std::to_string(0.1 + 0.001 * (run % 7)) + ",0.3\n";
  const std::string what = "study repeat --values " + write("values.csv", text) + " --reference flatness=0.103";
  const Ended ended = run(what);
  EXPECT_EQ(ended.status, 1) << ended.out;
  expect_mentions(ended.out, "undecided: no tolerance");
  EXPECT_EQ(run(what + " --tolerance flatness=0.3").status, 0);
}

TEST_F(StudyTest, a_table_with_limits_that_are_none_or_not_the_same_is_refused_by_its_lines) {
  const Ended turned = run("study repeat --reference a=1 --values " +
                           write("turned.csv", "item,value,lower,upper\na,1,1,2\na,1.1,2,1\na,1.2,1,2\n"));
  EXPECT_EQ(turned.status, 3);
  expect_mentions(turned.err, "turned.csv:3: lower 2 is not below upper 1");
  const Ended flat = run("study repeat --values " + write("flat.csv", "item,value,lower,upper\na,1,1,1\na,1.1,1,1\n"));
  EXPECT_EQ(flat.status, 3);
  expect_mentions(flat.err, "flat.csv:2: lower 1 is not below upper 1");
  const Ended two = run("study repeat --reference a=1 --values " +
                        write("two.csv", "item,value,lower,upper\na,1,1,2\nb,1,5,6\na,1.1,1,2\na,1.2,1,2000\n"));
  EXPECT_EQ(two.status, 3);
  expect_mentions(two.err, "two.csv:2 and");
  expect_mentions(two.err, "two.csv:5: limits of a are 1 .. 2 and 1 .. 2000");
  const Ended hole = run("study repeat --values " + write("hole.csv", "item,value,upper\na,1,2\na,1.1,\n"));
  EXPECT_EQ(hole.status, 3);
  expect_mentions(hole.err, "are at most 2 and none");
}

TEST_F(StudyTest, repeat_of_runs_that_two_recipes_judged_is_not_capable_by_the_newer_one) {
  upper_of_last_ = 3.0;
  store(60);  // the 60th is T-10
  const std::string what =
      "study repeat --slab T-1 --slab T-10 --same-part relabelled --db " + file("slabd.db") + " --block 1 --json ";
  const Ended mixed = run(what + "--reference seat_slope=1.43");
  EXPECT_EQ(mixed.status, 1) << mixed.out;
  const json study = parsed(mixed);
  EXPECT_EQ(study["judgement"], "undecided");
  EXPECT_TRUE(study["characteristics"][0]["gauge"]["tolerance"].is_null());
  expect_mentions(mixed.err, "limits are 1.3321 .. 1.5321 in 1 (T-1) and 1.3321 .. 3 in 60 (T-10)");
  EXPECT_EQ(run(what + "--reference seat_slope=1.43 --tolerance seat_slope=0.2").status, 0) << "one tolerance for all";
  EXPECT_EQ(run(what).status, 0) << "without a reference nothing is judged";
}

TEST_F(StudyTest, repeat_of_a_stored_slab_takes_every_inspection_of_that_id_and_no_other) {
  store(6);
  const Ended ended = run("study repeat --slab T-1 --db " + file("slabd.db") + " --json");
  EXPECT_EQ(ended.status, 0) << ended.err;
  const json study = parsed(ended);
  EXPECT_EQ(study["runs"], json::array({"1 (T-1)", "2 (T-1)", "3 (T-1)", "4 (T-1)", "5 (T-1)"}));
  ASSERT_EQ(study["characteristics"].size(), 2U);
  EXPECT_EQ(study["characteristics"][1]["block"], 2);
  EXPECT_NEAR(study["characteristics"][1]["mean"].get<double>(), 1.45, 0.003);
  const Ended again =
      run("study repeat --slab 1 --slab key:1 --slab 2 --slab T-1 --db " + file("slabd.db") + " --json");
  EXPECT_EQ(parsed(again)["runs"].size(), 5U) << "every inspection once, whatever it is called";
  const Ended none = run("study repeat --slab T-2 --db " + file("slabd.db"));
  EXPECT_EQ(none.status, 3);
  expect_mentions(none.err, "T-2");
}

TEST_F(StudyTest, a_value_for_information_does_not_take_the_place_of_the_one_that_was_judged) {
  slab_slope_for_information_ = true;
  store(60);
  const Ended ended =
      run("study repeat --slab T-1 --block 1 --reference seat_slope=1.43 --json --db " + file("slabd.db"));
  EXPECT_EQ(ended.status, 0) << ended.err;
  const json study = parsed(ended);
  EXPECT_NEAR(study["characteristics"][0]["mean"].get<double>(), 1.43, 0.003);
  EXPECT_NEAR(study["characteristics"][0]["gauge"]["tolerance"].get<double>(), 0.2, 1e-9);
}

TEST_F(StudyTest, repeat_calls_a_good_gauge_capable_and_a_biased_one_not) {
  store(60);
  const std::string what = "study repeat --slab T-1 --db " + file("slabd.db") + " --json ";
  const Ended good = run(what + "--block 1 --reference seat_slope=1.43");
  EXPECT_EQ(good.status, 0) << good.err;
  EXPECT_EQ(parsed(good)["judgement"], "capable");
  const Ended biased = run(what + "--reference seat_slope@1=1.43 --reference seat_slope@2=1.43");
  EXPECT_EQ(biased.status, 1);
  EXPECT_EQ(parsed(biased)["judgement"], "not_capable") << "block 2 is 0.02 deg off, a tenth of T";
  const Ended few = run(what + "--runs 49 --block 1 --reference seat_slope=1.43");
  EXPECT_EQ(few.status, 1);
  EXPECT_EQ(parsed(few)["judgement"], "undecided");
}

TEST_F(StudyTest, repeat_of_scans_measures_them_and_tells_one_scan_copied_from_two) {
  for (const char* seed : {"1", "2"})
    ASSERT_EQ(
        simulate_scan(std::string("scan") + seed + ".ply", std::string("--nominal-view --casting 0 --seed ") + seed)
            .status,
        0);
  fs::create_directory(file("scans"));
  fs::rename(file("scan1.ply"), file("scans/a.ply"));
  fs::rename(file("scan2.ply"), file("scans/b.ply"));
  const std::string what = "study repeat " + file("scans") + " --recipe " + kRecipe + " --block 3 --json";
  const Ended two = run(what);
  EXPECT_EQ(two.status, 0) << two.err;
  const json study = parsed(two);
  ASSERT_TRUE(study.is_object()) << two.out << two.err;
  bool slope = false;
  for (const json& c : study["characteristics"]) {
    if (c["item"] != "seat_slope") continue;
    slope = true;
    EXPECT_EQ(c["n"], 2);
    EXPECT_NEAR(c["mean"].get<double>(), 1.432096, 0.001);
    EXPECT_GT(c["range"].get<double>(), 0.0);
    EXPECT_LT(c["range"].get<double>(), 0.002);
  }
  EXPECT_TRUE(slope);
  EXPECT_EQ(two.err.find("taken twice"), std::string::npos) << two.err;
  fs::copy(file("scans/a.ply"), file("scans/c.ply"));
  const Ended copied = run(what);
  expect_mentions(copied.err, "one scan taken twice");
  expect_mentions(copied.err, "c.ply");
}

// ---- one part ------------------------------------------------------------------------------------------------------

TEST_F(StudyTest, slabs_of_different_ids_are_not_repeats_of_one_part_unless_the_user_gives_a_reason) {
  id_of_last_ = "T-2";
  store(3);
  const std::string what = "study repeat --slab key:1 --slab key:3 --db " + file("slabd.db");
  const Ended refused = run(what);
  EXPECT_EQ(refused.status, 3) << refused.out;
  expect_mentions(refused.err, "2 slabs of different ids are taken for one part: 'T-1', 'T-2'");
  expect_mentions(refused.err, "--same-part");
  EXPECT_EQ(refused.out, "");
  EXPECT_EQ(run("study repeat --slab key:1 --slab key:2 --db " + file("slabd.db")).status, 0) << "both are T-1";

  const Ended said = run(what + " --same-part 'T-2 is T-1 with a new label' --out " + file("r.html"));
  EXPECT_EQ(said.status, 0) << said.err;
  expect_mentions(said.out, "--same-part \"T-2 is T-1 with a new label\"");
  expect_mentions(said.out, "'T-1', 'T-2'");
  expect_mentions(content(file("r.html")), "T-2 is T-1 with a new label");
  const json study = parsed(run(what + " --same-part WHY --json"));
  EXPECT_EQ(study["same_part"]["why"], "WHY");
  EXPECT_EQ(study["same_part"]["differs"].size(), 1U);
  EXPECT_TRUE(parsed(run("study repeat --slab T-1 --json --db " + file("slabd.db")))["same_part"].is_null());
}

TEST_F(StudyTest, grr_and_compare_take_no_other_slab_or_block_for_the_same_part) {
  id_of_last_ = "T-2";
  store(4);
  const std::string db = " --db " + file("slabd.db");
  const std::string plan = write("plan.csv", "appraiser,trial,slab\nA,1,key:1\nA,2,key:2\nB,1,key:3\nB,2,key:4\n");
  const Ended grr = run("study grr " + plan + db);
  EXPECT_EQ(grr.status, 3);
  expect_mentions(grr.err, "'T-1', 'T-2'");
  const Ended said = run("study grr " + plan + " --same-part relabelled" + db);
  EXPECT_EQ(said.status, 1) << said.err;
  expect_mentions(said.out, "relabelled");

  simulate_block(4, "any.ply");
  const std::string contact = write("cmm.csv", "id,item,block,value\nS,seat_slope,3,1.43\n");
  const std::string scans = write("scans.csv", "id,block,scan\nS,3,any.ply\n");
  const Ended compare = run("study compare " + contact + " --scans " + scans + " --recipe " + kRecipe);
  EXPECT_EQ(compare.status, 3);
  expect_mentions(compare.err, "any.ply is of block 4 by its comment, and is measured as block 3");
}

TEST_F(StudyTest, the_blocks_of_one_slab_are_not_repeats_of_one_block) {
  fs::create_directory(file("spool"));
  simulate_block(3, "spool/03-1.ply");
  simulate_block(4, "spool/04-1.ply");
  const std::string what = "study repeat " + file("spool") + " --recipe " + kRecipe + " --block 3";
  const Ended refused = run(what);
  EXPECT_EQ(refused.status, 3) << refused.out;
  expect_mentions(refused.err, "04-1.ply is of block 4 by its comment, and is measured as block 3");
  EXPECT_EQ(refused.err.find("03-1.ply is of"), std::string::npos) << refused.err;
  const Ended said = run(what + " --same-part 'to see what happens' --json");
  EXPECT_EQ(said.status, 0) << said.err;
  EXPECT_EQ(parsed(said)["emulation"], (json{"scan"}));
}

TEST(SamePart, the_name_of_a_scan_states_its_block_or_nothing) {
  using study::block_in_name;
  EXPECT_EQ(block_in_name("/var/lib/slabd/spool/7/03-1.ply"), 3);
  EXPECT_EQ(block_in_name("18-255.pcd"), 18);
  EXPECT_EQ(block_in_name("Block7.ply"), 7);
  EXPECT_EQ(block_in_name("run2_station-12.xyz"), 12);
  EXPECT_EQ(block_in_name("seat 5 again.ply"), 5);
  EXPECT_EQ(block_in_name("scan04.ply"), std::nullopt);
  EXPECT_EQ(block_in_name("40213-7.ply"), std::nullopt) << "a session and a number";
  EXPECT_EQ(block_in_name("19-1.ply"), std::nullopt);
  EXPECT_EQ(block_in_name("blocks.ply"), std::nullopt);
  EXPECT_EQ(block_in_name("block123.ply"), std::nullopt);
}

TEST_F(StudyTest, repeat_says_what_is_missing_or_misspelt) {
  EXPECT_EQ(run("study repeat").status, 2);
  const std::string values = write("values.csv", "item,value\na,1\na,2\n");
  const Ended both = run("study repeat scan.ply --values " + values);
  EXPECT_EQ(both.status, 2);
  const Ended slip = run("study repeat --values " + values + " --item aa");
  EXPECT_EQ(slip.status, 2);
  expect_mentions(slip.err, "did you mean 'a'?");
  EXPECT_EQ(run("study repeat --values " + values + " --reference a").status, 2);
  EXPECT_EQ(run("study repeat --values " + values + " --tolerance a=-1").status, 2);
  EXPECT_EQ(run("study repeat --values " + file("none.csv")).status, 3);
  const Ended one = run("study repeat --values " + write("one.csv", "item,value\na,1\n"));
  EXPECT_EQ(one.status, 3);
  expect_mentions(one.err, "two runs at least");
  const Ended block = run("study repeat scan.ply --recipe " + kRecipe);
  EXPECT_EQ(block.status, 2);
  expect_mentions(block.err, "--block");
}

// ---- gauge R&R -----------------------------------------------------------------------------------------------------

/// The handbook's data as a plan; lines that begin with `leave_out` are left out.
std::string aiag_plan(const std::string& leave_out = "-") {
  const char* rows[9] = {
      ".29 -.56 1.34 .47 -.80 .02 .59 -.31 2.26 -1.36",   ".41 -.68 1.17 .50 -.92 -.11 .75 -.20 1.99 -1.25",
      ".64 -.58 1.27 .64 -.84 -.21 .66 -.17 2.01 -1.31",  ".08 -.47 1.19 .01 -.56 -.20 .47 -.63 1.80 -1.68",
      ".25 -1.22 .94 1.03 -1.20 .22 .55 .08 2.12 -1.62",  ".07 -.68 1.34 .20 -1.28 .06 .83 -.34 2.19 -1.50",
      ".04 -1.38 .88 .14 -1.46 -.29 .02 -.46 1.77 -1.49", "-.11 -1.13 1.09 .20 -1.07 -.67 .01 -.56 1.45 -1.77",
      "-.15 -.96 .67 .11 -1.45 -.49 .21 -.49 1.87 -2.16"};
  std::string text = "part,appraiser,trial,value\n";
  for (int row = 0; row < 9; ++row) {
    std::istringstream values(rows[row]);
    std::string value;
    for (int part = 1; values >> value; ++part) {
      const std::string line = std::to_string(part) + "," + "ABC"[row / 3] + "," + std::to_string(row % 3 + 1) + ",";
      if (line != leave_out) text += line + value + "\n";
    }
  }
  return text;
}

TEST_F(StudyTest, grr_of_the_handbook_gives_its_figures) {
  const std::string plan = write("plan.csv", aiag_plan());
  const Ended ended = run("study grr " + plan + " --json");
  EXPECT_EQ(ended.status, 1) << "27.86 % and four categories" << ended.err;
  const json study = parsed(ended);
  ASSERT_TRUE(study.is_object()) << ended.out;
  EXPECT_EQ(study["schema"], "slabd.study_grr/1");
  const json item = study["items"][0];
  EXPECT_EQ(item["anova"]["pooled"], true);
  EXPECT_NEAR(item["anova"]["components"]["GRR"].get<double>(), 0.302372, 5e-7);
  EXPECT_NEAR(item["anova"]["components"]["percent_of_variation"].get<double>(), 27.86, 0.005);
  EXPECT_NEAR(item["average_range"]["components"]["percent_of_variation"].get<double>(), 26.68, 0.005);
  EXPECT_NEAR(item["average_range"]["components"]["ndc"].get<double>(), 5.09, 0.005);
  EXPECT_TRUE(item["anova"]["components"]["percent_of_tolerance"].is_null());
  const Ended wide = run("study grr " + plan + " --tolerance value=20");
  EXPECT_EQ(wide.status, 0) << "9.07 % of the tolerance";
  expect_mentions(wide.out, "+ capable");
  expect_mentions(wide.out, "interaction pooled");
  EXPECT_EQ(run("study grr " + plan + " --tolerance value=10").status, 1) << "18 %: a decision of people";
}

/// Encodings of Chinese Excel: GBK, or UTF-16 with a byte-order mark.
TEST_F(StudyTest, a_table_in_chinese_excels_encodings_is_read_with_its_names) {
  for (const auto& [name, in_gbk] : {std::pair{"\u5f20\u4e09", true}, {"\u674e\u56db", false}}) {
    std::string table = aiag_plan();
    for (std::size_t at = 0; (at = table.find(",A,", at)) != std::string::npos;)
      table.replace(at, 3, in_gbk ? ",\xD5\xC5\xC8\xFD," : ",@@,");
    if (!in_gbk) {
      std::string wide = "\xFF\xFE";
      for (std::size_t i = 0; i < table.size(); ++i) {
        const bool is_name = table.compare(i, 2, "@@") == 0;
        wide += is_name ? std::string("\x4E\x67\xDB\x56") : std::string{table[i], '\0'};
        i += is_name ? 1 : 0;
      }
      table = wide;
    }
    const Ended chinese = run("study grr " + write("chinese.csv", table) + " --tolerance value=20 --json");
    EXPECT_LE(chinese.status, 1) << chinese.err;
    expect_mentions(chinese.out, name);
  }
  expect_mentions(run("study grr " + write("broken.csv", aiag_plan() + "7,\xFF\xFF,2,0.5\n")).err,
                  "is neither UTF-8 nor GB18030");
}

TEST_F(StudyTest, grr_names_the_cell_that_is_missing_and_the_one_given_twice) {
  const Ended hole = run("study grr " + write("hole.csv", aiag_plan("7,B,2,")));
  EXPECT_EQ(hole.status, 3);
  expect_mentions(hole.err, "part 7, appraiser B, trial 2 is missing");
  const Ended twice = run("study grr " + write("twice.csv", aiag_plan() + "7,B,2,0.5\n"));
  EXPECT_EQ(twice.status, 3);
  expect_mentions(twice.err, "twice.csv:92 both give part 7, appraiser B, trial 2");
  const Ended one = run("study grr " + write("one.csv", "part,appraiser,trial,value\n1,A,1,5\n2,A,1,6\n"));
  EXPECT_EQ(one.status, 3);
  expect_mentions(one.err, "two of each at least");
  const Ended empty =
      run("study grr " + write("empty.csv", "part,appraiser,trial,value\n1,A,1,5\n1,A,2,\n2,A,1,5\n2,A,2,5\n"));
  expect_mentions(empty.err, "was not measured (" + file("empty.csv") + ":3)");
  expect_mentions(run("study grr " + write("wrong.csv", "part,trial,value\n1,1,5\n")).err, "column missing: appraiser");
}

TEST_F(StudyTest, grr_says_one_cause_of_several_items_once) {
  std::string plan = "part,appraiser,trial,item,value\n";
  for (const char* item : {"a", "b", "c", "d"})
    for (const char* part : {"1", "2"}) plan += fmt::format("{},A,1,{},5\n", part, item);
  EXPECT_EQ(run("study grr " + write("one.csv", plan)).err,
            "slabctl: all 4 items: 2 parts, 1 appraisers, 1 trials; two of each at least\n");
  plan += "1,A,1,a,6\n";
  const Ended two = run("study grr " + write("two.csv", plan));
  expect_mentions(two.err, "slabctl: b, c, d: 2 parts, 1 appraisers");
  expect_mentions(two.err, "slabctl: a: ");
}

TEST_F(StudyTest, grr_is_never_capable_by_limits_that_are_none_or_not_the_same) {
  const auto with_limits = [](const std::string& usual, const std::string& line_7) {
    std::istringstream lines(aiag_plan());
    std::string text;
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number)
      text += line + (number == 1 ? ",lower,upper" : number == 7 ? line_7 : usual) + "\n";
    return text;
  };
  EXPECT_EQ(run("study grr " + write("good.csv", with_limits(",-10,10", ",-10,10"))).status, 0);
  const Ended turned = run("study grr " + write("turned.csv", with_limits(",10,-10", ",10,-10")));
  EXPECT_EQ(turned.status, 3) << turned.out;
  expect_mentions(turned.err, "turned.csv:2: lower 10 is not below upper -10");
  const std::string two = write("two.csv", with_limits(",-10,10", ",-1000,1000"));
  const Ended differ = run("study grr " + two);
  EXPECT_EQ(differ.status, 3) << differ.out;
  expect_mentions(differ.err, "limits are -10 .. 10 at " + file("two.csv") + ":2 and -1000 .. 1000 at " + two + ":7");
  EXPECT_EQ(run("study grr " + two + " --tolerance value=20").status, 0) << "the study's own tolerance";
}

TEST_F(StudyTest, grr_of_slabs_that_two_recipes_judged_is_refused) {
  upper_of_last_ = 3.0;
  store(4);
  const std::string plan = write("plan.csv", "slab,appraiser,trial\n1,early,1\n2,early,2\n3,late,1\n4,late,2\n");
  const Ended ended = run("study grr " + plan + " --db " + file("slabd.db"));
  EXPECT_EQ(ended.status, 3) << ended.out;
  expect_mentions(ended.err,
                  "seat_slope: limits are 1.3321 .. 1.5321 at " + plan + ":2 and 1.3321 .. 3 at " + plan + ":5");
}

TEST_F(StudyTest, grr_of_stored_slabs_takes_their_blocks_for_parts) {
  store(4);
  const std::string plan = write("plan.csv", "slab,appraiser,trial\n1,early,1\n2,early,2\n3,late,1\n4,late,2\n");
  const Ended ended = run("study grr " + plan + " --db " + file("slabd.db") + " --json");
  EXPECT_EQ(ended.status, 1) << "two parts are too few\n" << ended.err;
  const json study = parsed(ended);
  ASSERT_EQ(study["items"].size(), 1U) << ended.out;
  EXPECT_EQ(study["items"][0]["item"], "seat_slope");
  EXPECT_EQ(study["items"][0]["parts"], json::array({"1", "2"}));
  EXPECT_EQ(study["items"][0]["appraisers"], json::array({"early", "late"}));
  EXPECT_NEAR(study["items"][0]["tolerance"].get<double>(), 0.2, 1e-9) << "the recipe's";
  EXPECT_EQ(study["items"][0]["judgement"], "undecided");
  EXPECT_LT(study["items"][0]["anova"]["components"]["GRR"].get<double>(), 0.004);
  const Ended vague =
      run("study grr " + write("vague.csv", "slab,appraiser,trial\nT-1,a,1\n") + " --db " + file("slabd.db"));
  EXPECT_EQ(vague.status, 3);
  expect_mentions(vague.err, "4 inspections; name the key");
  const std::string again = write("again.csv", "slab,appraiser,trial\n1,early,1\n2,early,2\n3,late,1\n1,late,2\n");
  const Ended copied = run("study grr " + again + " --db " + file("slabd.db"));
  EXPECT_EQ(copied.status, 3) << "one inspection as two appraisers";
  expect_mentions(copied.err, "one measurement used twice");
}

TEST_F(StudyTest, grr_of_stored_slabs_block_by_block_uses_each_block_once) {
  store(4);
  const std::string heading = "slab,appraiser,trial,block\n";
  std::string lines;
  for (const char* of_slab : {"1,early,1,", "2,early,2,", "3,late,1,", "4,late,2,"})
    for (const char* block : {"1", "2"}) lines += of_slab + std::string(block) + "\n";
  const std::string db = " --db " + file("slabd.db") + " --json";
  const Ended by_block = run("study grr " + write("plan.csv", heading + lines) + db);
  EXPECT_EQ(by_block.status, 1) << "two parts are too few\n" << by_block.err;
  const Ended whole =
      run("study grr " + write("whole.csv", "slab,appraiser,trial\n1,early,1\n2,early,2\n3,late,1\n4,late,2\n") + db);
  EXPECT_EQ(parsed(by_block)["items"], parsed(whole)["items"]);
  for (const char* again : {"key:1,late,3,2", "1,late,3,"}) {
    const Ended twice = run("study grr " + write("twice.csv", heading + lines + again + "\n") + db);
    EXPECT_EQ(twice.status, 3) << again;
    expect_mentions(twice.err, "twice.csv:10: slab ");
    expect_mentions(twice.err, "one measurement used twice");
  }
}

TEST_F(StudyTest, grr_passes_over_no_name_that_fits_nothing) {
  const std::string plan = write("plan.csv", aiag_plan());
  for (const char* option : {"--tolerance valeu=20", "--item valeu", "--item value --item valeu"}) {
    const Ended ended = run("study grr " + plan + " --tolerance value=20 " + option);
    EXPECT_EQ(ended.status, 2) << option << ended.out;
    expect_mentions(ended.err, "'valeu' was not measured here, did you mean 'value'?");
  }
  // Without its own tolerance, an item of one part only would be left out.
  std::istringstream usual(aiag_plan());
  std::string text;
  for (std::string line; std::getline(usual, line);) text += line + (text.empty() ? ",item" : ",value") + "\n";
  const std::string two = write("two.csv", text + "1,A,1,0.2,warp\n1,A,2,0.3,warp\n");
  EXPECT_EQ(run("study grr " + two + " --tolerance value=20").status, 0);
  const Ended one_part = run("study grr " + two + " --tolerance value=20 --tolerance warp=5");
  EXPECT_EQ(one_part.status, 3) << one_part.out;
  expect_mentions(one_part.err, "warp: 1 parts");
}

// ---- comparison with a laboratory ----------------------------------------------------------------------------------

TEST_F(StudyTest, compare_of_two_tables_gives_errors_limits_and_line) {
  std::string contact = "id,block,item,value,U\n";
  std::string ours = "id,block,item,value,U\n";
  const double off[6] = {0.01, -0.02, 0.03, 0.00, -0.01, 0.05};
  for (int i = 0; i < 6; ++i) {
    const std::string thing = "S" + std::to_string(i) + "," + std::to_string(i + 1) + ",jaw_distance,";
    contact += thing + std::to_string(379.5 + 0.2 * i) + ",0.01\n";
    ours += thing + std::to_string(379.5 + 0.2 * i + off[i]) + ",0.05\n";
  }
  const std::string measured = write("measured.csv", contact);
  contact += "S9,1,jaw_distance,380,0.01\n";
  ours += "S1,2,seat_slope,1.43,0.02\n";
  const std::string what = "study compare " + write("contact.csv", contact) + " --values " + write("ours.csv", ours);
  const Ended ended = run(what + " --json");
  EXPECT_EQ(ended.status, 0) << ended.err;
  expect_mentions(ended.err, "not measured by slabd: S9, jaw_distance, block 1");
  expect_mentions(ended.err, "not in the contact table: S1, seat_slope, block 2");
  const json study = parsed(ended);
  EXPECT_EQ(study["schema"], "slabd.study_compare/1");
  const json item = study["items"][0];
  EXPECT_NEAR(item["errors"]["mean"]["value"].get<double>(), 0.01, 1e-9);
  EXPECT_NEAR(item["errors"]["max_abs"].get<double>(), 0.05, 1e-9);
  EXPECT_NEAR(item["errors"]["mean_abs"].get<double>(), 0.02, 1e-9);
  EXPECT_NEAR(item["errors"]["en_max"].get<double>(), 0.05 / std::hypot(0.05, 0.01), 1e-6);
  EXPECT_EQ(item["regression"]["ok"], true);
  EXPECT_NEAR(item["regression"]["variance_ratio"].get<double>(), 25.0, 1e-9);
  EXPECT_NEAR(item["regression"]["slope"]["value"].get<double>(), 1.0, 0.05);
  EXPECT_NEAR(study["all_mm"]["max_abs"].get<double>(), 0.05, 1e-9);
  EXPECT_EQ(study["only_reference"].size(), 1U);
  const Ended shown = run(what);
  expect_mentions(shown.out, "S5 block 6");
  EXPECT_EQ(run(what + " --max-error jaw_distance=0.04").status, 1);
  EXPECT_EQ(run(what + " --max-error jaw_distance=0.08").status, 1) << "the intervals reach beyond: undecided";
  EXPECT_EQ(run("study compare " + measured + " --values " + file("ours.csv") + " --max-error jaw_distance=1").status,
            0);
  const Ended seven = run(what + " --max-error jaw_distance=1");
  EXPECT_EQ(seven.status, 1) << "what is hard to measure may be what is measured wrong";
  expect_mentions(seven.out, "undecided: 1 of 7 not measured");
  EXPECT_EQ(run(what + " --max-error jaw=1").status, 2);
  const Ended slip = run(what + " --item jaw_distance --item jaw");
  EXPECT_EQ(slip.status, 2);
  expect_mentions(slip.err, "--item: 'jaw' was not compared");
  const Ended copied = run("study compare " + measured + " --values " + measured + " --max-error jaw_distance=1");
  EXPECT_EQ(copied.status, 1) << copied.out;
  expect_mentions(copied.out, "undecided: all errors are the same");
  // A table made from the other by adding 0.05 is rejected as well, although 0.05 is not a machine number.
  std::string apart = "id,block,item,value,U\n";
  for (int i = 0; i < 6; ++i)
    apart += "S" + std::to_string(i) + "," + std::to_string(i + 1) + ",jaw_distance," +
             std::to_string(379.55 + 0.2 * i) + ",0.05\n";
  const Ended shifted =
      run("study compare " + measured + " --values " + write("apart.csv", apart) + " --max-error jaw_distance=1");
  EXPECT_EQ(shifted.status, 1) << shifted.out;
  expect_mentions(shifted.out, "undecided: all errors are the same");
}

TEST_F(StudyTest, compare_refuses_a_name_of_two_slabs_and_two_names_of_one) {
  id_of_last_ = "1";
  store(5);
  const auto compared = [&](const std::string& ids) {
    return run("study compare " + write("contact.csv", "id,block,item,value\n" + ids) + " --db " + file("slabd.db"));
  };
  const Ended two = compared("1,1,seat_slope,1.43\n2,1,seat_slope,1.43\n3,1,seat_slope,1.43\n");
  EXPECT_EQ(two.status, 3) << two.out;
  expect_mentions(two.err, "say key:1 or id:1");
  const Ended one = compared("key:4,1,seat_slope,1.43\nT-1,1,seat_slope,1.43\nkey:2,1,seat_slope,1.43\n");
  EXPECT_EQ(one.status, 3) << one.out;
  expect_mentions(one.err, "'T-1' and 'key:4' both mean the slab of key 4");
  EXPECT_EQ(compared("key:1,1,seat_slope,1.43\nid:1,1,seat_slope,1.43\nkey:2,1,seat_slope,1.43\n").status, 0);
}

TEST_F(StudyTest, compare_of_stored_slabs_takes_the_newest_or_the_mean_of_several) {
  store(5);
  const std::string contact = write("contact.csv",
                                    "id;block;item;value\nT-1;1;seat_slope;1.43\nT-1;2;seat_slope;1.45\nT-1;2;jaw_"
                                    "distance;380\nT-7;1;seat_slope;1.43\n");
  const std::string what = "study compare " + contact + " --db " + file("slabd.db") + " --json";
  const Ended newest = run(what);
  EXPECT_EQ(newest.status, 0) << newest.err;
  expect_mentions(newest.err, "not measured by slabd: T-1, jaw_distance, block 2");
  expect_mentions(newest.err, "not measured by slabd: T-7, seat_slope, block 1");
  const json one = parsed(newest);
  const json mean = parsed(run(what + " --runs 5"));
  const json runs = parsed(run("study repeat --slab T-1 --db " + file("slabd.db") + " --json"));
  EXPECT_EQ(one["items"][0]["pairs"][0]["value"], runs["characteristics"][0]["values"][4]);
  EXPECT_NEAR(mean["items"][0]["pairs"][0]["value"].get<double>(), runs["characteristics"][0]["mean"].get<double>(),
              1e-12);
  const Ended none =
      run("study compare " + write("none.csv", "id,item,value\nX,warp_left,1\n") + " --db " + file("slabd.db"));
  EXPECT_EQ(none.status, 3);
  EXPECT_EQ(
      run("study compare " + write("bad.csv", "id,item,value,U\nX,warp_left,1,-1\n") + " --db " + file("slabd.db"))
          .status,
      3);
}

// ---- documents -----------------------------------------------------------------------------------------------------

TEST_F(StudyTest, documents_say_the_figures_of_the_terminal_in_every_form_and_language) {
  store(12);
  const std::string db = " --db " + file("slabd.db");
  const std::string plan = write("plan.csv", "slab,appraiser,trial\n1,early,1\n2,early,2\n3,late,1\n4,late,2\n");
  const std::string contact =
      write("contact.csv", "id,block,item,value\nT-1,1,seat_slope,1.43\nT-1,2,seat_slope,1.45\n");
  for (const std::string& what :
       {std::string("repeat --slab T-1 --reference seat_slope=1.43"), "grr " + plan, "compare " + contact}) {
    for (const char* extension : {".html", ".pdf", ".svg"}) {
      const std::string out = file(std::string("study") + extension);
      const Ended ended = run("study " + what + db + " --out " + out);
      EXPECT_LE(ended.status, 1) << what << ended.err;
      const std::string text = content(out);
      EXPECT_GT(text.size(), 2000U) << what << extension;
      EXPECT_TRUE(text.starts_with(extension == std::string(".pdf") ? "%PDF" : "<")) << text.substr(0, 20);
      fs::remove(out);
    }
  }
  const json study =
      parsed(run("study repeat --slab T-1 --reference seat_slope=1.43 --json --out " + file("a.html") + db));
  const std::string html = content(file("a.html"));
  for (const json& c : study["characteristics"]) {
    char cg[32];
    std::snprintf(cg, sizeof cg, ">%.2f<", c["gauge"]["cg"].get<double>());
    expect_mentions(html, cg);
  }
  expect_mentions(html, "undecided");
  static_cast<void>(
      run("study repeat --slab T-1 --reference seat_slope=1.43 --language zh --out " + file("zh.html") + db));
  expect_mentions(content(file("zh.html")), "未定");
  const Ended wrong = run("study repeat --slab T-1 --out study.doc" + db);
  EXPECT_EQ(wrong.status, 2);
  expect_mentions(wrong.err, ".pdf, .html");
}

TEST_F(StudyTest, every_document_holds_against_its_published_schema) {
  store(5);
  const std::string db = " --db " + file("slabd.db");
  const std::string contact =
      write("contact.csv", "id,block,item,value\nT-1,1,seat_slope,1.43\nT-9,2,seat_slope,1.45\n");
  std::string many = "id,item,value,U\n";
  for (int i = 0; i < 8; ++i) many += "S" + std::to_string(i) + ",warp_left," + std::to_string(i) + ",0.1\n";
  const std::string table = write("many.csv", many);
  std::string documents;
  int count = 0;
  for (const std::string& what :
       {"repeat --slab T-1" + db, "repeat --slab T-1 --reference seat_slope=1.43" + db,
        "grr " + write("plan.csv", aiag_plan()),
        "grr " + write("stored.csv", "slab,appraiser,trial\n1,a,1\n2,a,2\n3,b,1\n4,b,2\n") + db,
        "compare " + contact + db, "compare " + table + " --values " + table + " --max-error warp_left=1"})
    documents += " " + write("document-" + std::to_string(++count) + ".json", run("study " + what + " --json").out);
  const auto validate = [&](const std::string& files) {
    return std::system(("/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py " +
                        places::source_dir() + "/docs/schemas" + files + " >" + file("py.out") + " 2>" + file("py.err"))
                           .c_str());
  };
  EXPECT_EQ(validate(documents), 0) << content(file("py.out")) << content(file("py.err"));
  expect_mentions(content(file("py.out")), "6 documents, 0 faults");
  json wrong = parsed(run("study grr " + file("plan.csv") + " --json"));
  wrong["items"][0]["anova"]["pooled"] = "yes";
  EXPECT_NE(validate(" " + write("wrong.json", wrong.dump())), 0);
}

}  // namespace
}  // namespace slabd::cli
