// SPDX-License-Identifier: Apache-2.0
//
// slabctl show on a database with constructed contents.
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "cli/exit.h"
#include "report/figures.h"
#include "storage/storage.h"
#include "tests/cli/slabctl_process.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

class Show : public Slabctl {
 protected:
  Show() {
    header_.key = 1;
    header_.slab_id = "SLAB-0042";
    header_.stations = 18;
    header_.cell_mm = 1.5;
    header_.recipe = "P5600";
    header_.guard = 1.0;
    header_.began_utime_us = 1'763'681'281'000'000;
    record_.kind = 2;
    record_.res_seq = 2;
    slab_.verdict = Verdict::not_measured;
    slab_.reason = 402;
    slab_.station_verdict.fill(Verdict::not_measured);
    slab_.station_reason.fill(402);
    open_store();
  }
  void open_store() {
    auto opened = storage::open_store({file("slabd.db"), file("spool"), 0});
    ASSERT_TRUE(opened.ok()) << opened.error().text.view();
    store_ = std::move(opened.value());
  }
  void apply(const decltype(StoreJob::what)& what) {
    const Status status = store_->apply({1, what});
    ASSERT_TRUE(status.ok()) << status.error().text.view();
  }
  /// Station 3 is measured and its block passes.
  void measure_station_3() {
    Attempt attempt;
    attempt.slab_key = header_.key;
    attempt.station = 3;
    attempt.number = 1;
    apply(AcquiredJob{attempt});
    BlockResult block = block_;
    block.station = 3;
    block.verdict = Verdict::pass;
    PlcResult record;
    record.kind = 1;
    record.res_seq = static_cast<std::uint16_t>(2 * header_.key - 1);
    record.station = 3;
    apply(BlockJob{header_.key, 1, block, record});
  }
  [[nodiscard]] Ended show(const std::string& more = "") const {
    return run("show key:" + std::to_string(header_.key) + " --db " + file("slabd.db") + " " + more);
  }
  static std::string line_of(const std::string& text, const std::string& start) {
    const std::size_t at = text.find("\n" + start);
    return at == std::string::npos ? "" : text.substr(at + 1, text.find('\n', at + 1) - at - 1);
  }

  std::unique_ptr<storage::Store> store_;
  SlabHeader header_;
  BlockResult block_;  ///< result of station 3
  SlabResult slab_;
  PlcResult record_;
};

TEST_F(Show, ended_slab_shows_final_verdicts_also_of_stations_that_were_never_scanned) {
  apply(BeginSlabJob{header_, 1, 1});
  measure_station_3();
  slab_.station_verdict[2] = Verdict::fail;  // a slab-frame item changed its pass
  slab_.station_reason[2] = 611;
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});

  const Ended ended = show("--full");
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_EQ(line_of(ended.out, "  Y > 0"), "  Y > 0     0   0   X   0   0   0   0   0   0");
  EXPECT_EQ(line_of(ended.out, "  Y < 0"), "  Y < 0     0   0   0   0   0   0   0   0   0");
  expect_mentions(line_of(ended.out, "1  "), "0 not_measured  402: no supporting block");
  expect_mentions(line_of(ended.out, "3  "), "X fail");
  expect_mentions(show("--block 1").out, "block 1: 0 not_measured  402: ");

  const json document = json::parse(show("--json").out);
  ASSERT_EQ(document["station_verdicts"].size(), 18U);
  EXPECT_EQ(document["station_verdicts"][0], (json{{"station", 1}, {"verdict", "not_measured"}, {"reason", 402}}));
  EXPECT_EQ(document["station_verdicts"][2], (json{{"station", 3}, {"verdict", "fail"}, {"reason", 611}}));
}

TEST_F(Show, an_emulated_slab_is_marked_in_show_history_export_trend_and_their_json) {
  const std::string db = " --db " + file("slabd.db");
  for (const bool emulated : {false, true}) {
    header_.key = emulated ? 2 : 1;
    header_.emulated = static_cast<std::uint8_t>(emulated ? kEmulatedLine | kEmulatedScan : 0U);
    apply(BeginSlabJob{header_, 1, 1});
    apply(SlabJob{header_.key, slab_, record_, 1'763'681'999'000'000});
    const std::string key = std::to_string(header_.key);
    EXPECT_EQ(show().out.find("EMULATED ([line] simulation = true, scan emulated): no verdict on concrete") == 0U,
              emulated)
        << show().out;
    const json document = json::parse(show("--json").out);
    EXPECT_EQ(document["emulated"], emulated);
    EXPECT_EQ(document["emulation"], emulated ? (json{"line", "scan"}) : json::array());
    const std::string history = run("history" + db).out;
    EXPECT_EQ(history.find("EMULATED") != std::string::npos, emulated) << history;
    const json slabs = json::parse(run("history --json" + db).out)["slabs"];
    EXPECT_EQ(slabs[0]["emulated"], emulated);
  }
}

TEST_F(Show, the_mould_is_shown_and_found_and_an_unknown_one_is_nothing) {
  const std::string db = " --db " + file("slabd.db");
  for (const std::uint16_t mould : {std::uint16_t{0}, std::uint16_t{12}}) {
    header_.key = mould == 0 ? 1 : 2;
    header_.mould = mould;
    apply(BeginSlabJob{header_, 1, 1});
    apply(SlabJob{header_.key, slab_, record_, 1'763'681'999'000'000});
    EXPECT_EQ(show().out.find("  mould 12\n") != std::string::npos, mould != 0) << show().out;
    EXPECT_EQ(json::parse(show("--json").out)["mould"], mould == 0 ? json() : json(12));
    EXPECT_EQ(run("history" + db).out.find("mould") != std::string::npos, mould != 0);
    const json slabs = json::parse(run("history --json" + db).out)["slabs"];
    EXPECT_EQ(slabs[0]["mould"], mould == 0 ? json() : json(12));
  }
  const json of_12 = json::parse(run("history --json --mould 12" + db).out)["slabs"];
  ASSERT_EQ(of_12.size(), 1U);
  EXPECT_EQ(of_12[0]["key"], 2);
  expect_mentions(run("history --mould 13" + db).out, "no slab fits these conditions");
  EXPECT_EQ(run("history --mould 0" + db).status, 2);
}

TEST_F(Show, open_slab_shows_what_is_known_so_far) {
  apply(BeginSlabJob{header_, 1, 1});
  measure_station_3();
  const Ended ended = show();
  EXPECT_EQ(line_of(ended.out, "  Y > 0"), "  Y > 0     .   .   +   .   .   .   .   .   .");
  expect_mentions(ended.out, "still open");
  expect_mentions(show("--block 1").out, "block 1 was not scanned\n");
  EXPECT_EQ(show("--block 1").out.find("block 1: "), std::string::npos);
}

// A block's objections remain valid; its pass was provisional.
TEST_F(Show, no_block_of_an_aborted_slab_passes) {
  for (const bool old_version : {false, true}) {
    if (old_version) {
      header_.key = 2;
      record_.res_seq = 4;
    }
    apply(BeginSlabJob{header_, 1, static_cast<std::uint16_t>(header_.key)});
    measure_station_3();
    Attempt attempt;
    attempt.slab_key = header_.key;
    attempt.number = 1;
    attempt.station = 4;
    apply(FailedAttemptJob{attempt, 402});
    attempt.station = 5;
    apply(AcquiredJob{attempt});
    slab_ = {};
    slab_.verdict = Verdict::aborted;
    slab_.reason = 110;
    slab_.station_verdict[8] = Verdict::fail;
    if (old_version) slab_.station_verdict[2] = Verdict::pass;
    apply(SlabJob{header_.key, slab_, record_, 1'763'681'999'000'000});
    const Ended ended = show();
    EXPECT_EQ(line_of(ended.out, "  Y > 0"), "  Y > 0     .   .   .   0   .   .   .   .   X");
    expect_mentions(ended.out, "slab items: none; the slab was aborted: position, height, spacing and slope");
    EXPECT_EQ(ended.out.find("before SLAB_END"), std::string::npos);
    expect_mentions(show("--block 3").out, "block 3: . none  the slab was aborted");
    expect_mentions(show("--block 5").out, "attempt 1: scanned, not measured: the slab was aborted");
    const json document = json::parse(show("--json").out);
    EXPECT_EQ(document["station_verdicts"][2]["verdict"], "none");
    EXPECT_EQ(document["station_verdicts"][3]["verdict"], "not_measured");
    EXPECT_EQ(document["blocks"][0]["final_verdict"], "none");
  }
}

TEST_F(Show, a_block_that_was_not_found_has_no_numbers_and_no_zeros_instead) {
  apply(BeginSlabJob{header_, 1, 1});
  block_.registration.status = RegistrationStatus::degenerate;
  measure_station_3();
  expect_mentions(show("--block 3").out, "seat normal -\n");
  const json document = json::parse(show("--json").out);
  const json& features = document["blocks"][0]["result"]["features"];
  const json nothing = json::array({nullptr, nullptr, nullptr});
  EXPECT_EQ(features["seat"]["normal"], nothing);
  EXPECT_EQ(features["seat"]["centroid_mm"], nothing);
  EXPECT_EQ(features["jaw_inner"]["normal"], nothing);
  EXPECT_EQ(features["jaw_inner"]["centroid_mm"], nothing);
  EXPECT_EQ(features["casing_outer"]["centre_mm"], nothing);
  const Ended cloud = show("--block 3 --cloud --json");
  EXPECT_EQ(cloud.status, 3);
  expect_mentions(cloud.err, "no cloud of slab 1 block 3: the block was not found in its scan");
}

// Two types differ in blocks and limits.
TEST_F(Show, a_trend_is_that_of_one_type) {
  for (std::int64_t key = 1; key <= 3; ++key) {
    header_.key = key;
    header_.slab_type = key == 2 ? 4925 : 5600;
    record_.res_seq = static_cast<std::uint16_t>(100 + key);
    apply(BeginSlabJob{header_, 1, static_cast<std::uint16_t>(key)});
    Item item;
    item.id = ItemId::jaw_distance;
    item.value = 380.0 + static_cast<double>(key);
    block_.items.clear();
    ASSERT_TRUE(block_.items.push(item));
    measure_station_3();
    apply(SlabJob{key, slab_, record_, 1'763'681'999'000'000});
  }
  const auto trend = [&](const std::string& more) {
    return run("trend jaw_distance --block 3 --db " + file("slabd.db") + " " + more);
  };
  json document = json::parse(trend("--json").out);
  EXPECT_EQ(document["slab_type"], 5600);
  ASSERT_EQ(document["series"].size(), 2U);
  EXPECT_EQ(document["series"][0]["value"], 381.0);
  EXPECT_EQ(document["series"][1]["value"], 383.0);
  expect_mentions(trend("").out, "2 slabs of type 5600");
  expect_mentions(trend("").out, "slabs of other types are left out: 5600 is the newest slab's");
  document = json::parse(trend("--json --slab-type 4925").out);
  EXPECT_EQ(document["slab_type"], 4925);
  EXPECT_EQ(document["series"].size(), 1U);
  EXPECT_EQ(trend("--slab-type 5600").out.find("other types"), std::string::npos);
  document = json::parse(trend("--json --slab-type 1").out);
  EXPECT_EQ(document["slab_type"], nullptr);
}

TEST_F(Show, report_warns_of_unconfirmed_nominals_and_of_a_missing_guard_band) {
  header_.unconfirmed = 12;
  header_.guard = 0.0;
  apply(BeginSlabJob{header_, 1, 1});
  const Ended ended = show();
  expect_mentions(ended.out,
                  "warning: 12 nominals and tolerances of the recipe were not confirmed when this slab was judged\n");
  expect_mentions(ended.out, "simple acceptance: guard band 0\n");
  const json document = json::parse(show("--json").out);
  EXPECT_EQ(document["unconfirmed"], 12);
  EXPECT_EQ(document["guard"], 0.0);
}

TEST_F(Show, a_note_of_the_slab_frame_is_a_warning_in_every_form) {
  const std::string note = "top rolled -0.076 deg to the seats; seat 12 off by 3.00 mm in X";
  apply(BeginSlabJob{header_, 1, 1});
  slab_.fit.ok = true;
  slab_.fit.note.assign(note);
  ASSERT_EQ(slab_.fit.note.view(), note) << "it fits";
  Item slope;
  slope.station = 1;
  ASSERT_TRUE(slab_.items.push(slope));
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});
  expect_mentions(show().out, "warning: " + note + "\n");
  EXPECT_EQ(json::parse(show("--json").out)["slab_fit"]["note"], note);
  const std::string out = file("report.html");
  const Ended report = run("report 1 --db " + file("slabd.db") + " --language en --out " + out);
  ASSERT_EQ(report.status, 0) << report.err;
  std::ifstream html(out);
  const std::string written((std::istreambuf_iterator<char>(html)), std::istreambuf_iterator<char>());
  expect_mentions(written, "slab frame: " + note);
}

TEST_F(Show, confirmed_recipe_with_a_guard_band_gets_no_warning) {
  apply(BeginSlabJob{header_, 1, 1});
  const Ended ended = show();
  EXPECT_EQ(ended.out.find("warning"), std::string::npos) << ended.out;
  EXPECT_EQ(ended.out.find("simple acceptance"), std::string::npos) << ended.out;
  EXPECT_EQ(json::parse(show("--json").out)["guard"], 1.0);
}

// A screen of 24 lines shows verdict, findings and map.
TEST_F(Show, begins_with_the_findings_and_fits_a_screen) {
  header_.unconfirmed = 12;
  header_.emulated = kEmulatedScan;
  apply(BeginSlabJob{header_, 1, 1});
  Item item;
  item.id = ItemId::jaw_distance;
  item.value = 380.9;
  item.lower = 379.5;
  item.upper = 380.5;
  item.U = 0.05;
  item.verdict = Verdict::fail;
  ASSERT_TRUE(block_.items.push(item));
  measure_station_3();
  slab_.fit.ok = true;
  slab_.fit.note.assign("top rolled");
  slab_.station_verdict[2] = Verdict::fail;
  slab_.station_reason[2] = 604;
  for (int station = 1; station <= 18; ++station) {
    Item height;
    height.id = ItemId::seat_vertical;
    height.station = static_cast<std::uint8_t>(station);
    height.verdict = Verdict::fail;
    height.value = 1.0;
    ASSERT_TRUE(slab_.items.push(height));
  }
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});
  const std::string text = show().out;
  EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 24) << text;
  const std::size_t finding = text.find("X Block 3, jaw distance: 380.900 mm, limits 379.500 .. 380.500, U 0.050");
  ASSERT_NE(finding, std::string::npos) << text;
  EXPECT_LT(finding, text.find("  Y > 0"));
  expect_mentions(text, "(--full shows them)");
  EXPECT_EQ(show("--full").out.find("(--full shows them)"), std::string::npos);
}

TEST_F(Show, a_block_has_one_slope_with_the_datum_that_decides) {
  for (const bool in_slab_frame : {true, false}) {
    header_.key = in_slab_frame ? 1 : 2;
    record_.res_seq = static_cast<std::uint16_t>(10 * header_.key);
    apply(BeginSlabJob{header_, 1, static_cast<std::uint16_t>(header_.key)});
    Item own;
    own.value = 1.41;
    Item slope;
    slope.station = 3;
    slope.value = 1.47;
    (in_slab_frame ? slope : own).upper = 1.5;
    block_.items.clear();
    ASSERT_TRUE(block_.items.push(own));
    measure_station_3();
    slab_.items.clear();
    ASSERT_TRUE(slab_.items.push(slope));
    apply(SlabJob{header_.key, slab_, record_, 1'763'681'999'000'000});
    const std::string text = show("--block 3").out;
    expect_mentions(text, in_slab_frame ? "1.4700" : "1.4100");
    EXPECT_EQ(text.find(in_slab_frame ? "1.4100" : "1.4700"), std::string::npos) << text;
    expect_mentions(text, in_slab_frame ? "datum that decides: slab_frame" : "datum that decides: local_slab_top");
  }
}

TEST_F(Show, slab_of_eight_pairs_has_a_map_of_two_by_eight) {
  header_.stations = 16;
  header_.recipe = "P4925";
  apply(BeginSlabJob{header_, 1, 1});
  measure_station_3();
  for (std::size_t i = 16; i < 18; ++i) slab_.station_verdict[i] = Verdict::none;
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});
  const Ended ended = show();
  EXPECT_EQ(line_of(ended.out, "            1"), "            1   2   3   4   5   6   7   8");
  EXPECT_EQ(line_of(ended.out, "  Y > 0"), "  Y > 0     0   0   0   0   0   0   0   0");
  EXPECT_EQ(line_of(ended.out, "           16"), "           16  15  14  13  12  11  10   9");
  EXPECT_EQ(line_of(ended.out, "17 "), "");
  EXPECT_EQ(json::parse(show("--json").out)["station_verdicts"].size(), 16U);
  EXPECT_EQ(show("--block 16").status, 0);
  const Ended beyond = show("--block 17");
  EXPECT_EQ(beyond.status, 2);
  expect_mentions(beyond.err, "1..16");
}

TEST_F(Show, U_is_taken_apart_and_every_part_has_a_source) {
  storage::CalibrationRecord acceptance;
  ScannerNumbers numbers;
  numbers.PF_mm = numbers.RF_mm = 0.1;
  numbers.form_half_mm = 0.0612;
  numbers.form_length_mm = 113.0;
  numbers.PS_mm = 0.0123;
  numbers.plates = kPlatePlacesMin;
  numbers.balls = kBallPlacesMin;
  numbers.within_limits = true;
  acceptance.numbers = numbers;
  const Result<std::string> id = store_->change(storage::KeepCalibration{acceptance});
  ASSERT_TRUE(id.ok()) << id.error().text.view();
  header_.scanner_id.assign(id.value());
  header_.calibration_id = "he-123";
  apply(BeginSlabJob{header_, 1, 1});
  Item item;
  item.id = ItemId::jaw_distance;
  item.value = 380.0;
  item.U = 0.1;
  item.budget[static_cast<std::size_t>(BudgetPart::scanner)] = 0.04;
  item.budget[static_cast<std::size_t>(BudgetPart::fit)] = 0.03;
  ASSERT_TRUE(block_.items.push(item));
  measure_station_3();
  const Ended text = show("--block 3");
  expect_mentions(text.out, "U from, k = 1");
  expect_mentions(text.out, "0.04000");
  expect_mentions(text.out, "the larger of recipe P5600 and acceptance " + id.value() +
                                " (form +-0.0612 mm over 113 mm, size 0.0123 mm, noise correlated over not known)");
  expect_mentions(show("--full").out, "scanner acceptance " + id.value());
  EXPECT_EQ(json::parse(show("--json").out)["scanner_id"], id.value());
  for (const char* language : {"en", "zh"}) {
    const std::string out = file(std::string(language) + ".html");
    const Ended report = run("report 1 --db " + file("slabd.db") + " --language " + language + " --out " + out);
    ASSERT_EQ(report.status, 0) << report.err;
    std::ifstream html(out);
    const std::string written((std::istreambuf_iterator<char>(html)), std::istreambuf_iterator<char>());
    expect_mentions(written, id.value());
    expect_mentions(written, "0.04000");
    expect_mentions(written, language == std::string("en")
                                 ? "Uncertainty budget"
                                 : "\xe4\xb8\x8d\xe7\xa1\xae\xe5\xae\x9a\xe5\xba\xa6\xe9\xa2\x84\xe7\xae\x97");
  }
}

TEST_F(Show, computed_values_of_a_block_come_back_from_the_database) {
  apply(BeginSlabJob{header_, 1, 1});
  block_.registration.covariance.setIdentity();
  block_.seat.flatness_mm = 0.06;
  block_.seat.flatness_noise_mm = 0.03;
  block_.seat.defect = {0.15, 3, 6.75, 0.21, 1.0, 2.0};
  Item item;
  item.id = ItemId::jaw_distance;
  item.value = 380.0;
  item.budget[0] = 0.01;
  ASSERT_TRUE(block_.items.push(item));
  measure_station_3();
  const Ended text = show("--block 3");
  expect_mentions(text.out,
                  "flatness from cell mean 1.5 mm, least-squares plane; a perfectly flat seat would read 0.030 mm");
  expect_mentions(text.out,
                  "defect: 6.8 mm2 standing out up to 0.210 mm at x 1.0 mm, s 2.0 mm (3 cells beyond 0.150 mm)");
  const json document = json::parse(show("--block 3 --json").out);
  EXPECT_EQ(document["cell_mm"], 1.5);
  const json& result = document["blocks"][0]["result"];
  EXPECT_EQ(result["registration"]["covariance"][3][3], 1.0);
  EXPECT_EQ(result["features"]["seat"]["flatness_operator"], "cell mean 1.5 mm, least-squares plane");
  EXPECT_EQ(result["features"]["seat"]["defect"]["cells"], 3);
  EXPECT_EQ(result["items"][0]["budget"]["fit"], 0.01);
}

TEST_F(Show, a_number_that_means_two_slabs_is_refused_as_ambiguous) {
  header_.slab_id = "FIRST";
  apply(BeginSlabJob{header_, 1, 1});
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});
  header_.slab_id = "1";
  header_.key = 2;
  apply(BeginSlabJob{header_, 1, 2});
  const auto shown = [&](const std::string& name) { return run("show " + name + " --db " + file("slabd.db")); };
  const Ended both = shown("1");
  EXPECT_EQ(both.status, kBadInput);
  EXPECT_NE(both.err.find("key:1 or id:1"), std::string::npos) << both.err;
  EXPECT_NE(both.err.find("FIRST"), std::string::npos) << both.err;
  EXPECT_NE(shown("key:1").out.find("FIRST"), std::string::npos);
  EXPECT_EQ(shown("id:1").out.find("FIRST"), std::string::npos);
  EXPECT_EQ(shown("id:1").status, kDone);
  EXPECT_EQ(shown("key:x").status, kBadInput);
}

TEST_F(Show, an_id_that_begins_with_a_dash_is_taken_by_every_command_with_a_slab) {
  header_.slab_id = "-S3";
  apply(BeginSlabJob{header_, 1, 1});
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});
  const std::string db = "--db " + file("slabd.db") + " ";
  for (const std::string& arguments :
       {"show -S3 " + db, "show " + db + "-S3", "show " + db + "-- -S3", "show " + db + "' -S3  '",
        "show " + db + "--json -S3", "export -S3 " + db, "report " + db + "-S3 --out " + file("dash.html")}) {
    const Ended ended = run(arguments);
    EXPECT_EQ(ended.status, kDone) << arguments << ": " << ended.err;
    if (arguments.starts_with("show")) expect_mentions(ended.out, "-S3");
  }
  const Ended unknown = run("show -X9 " + db);
  EXPECT_EQ(unknown.status, kBadInput);
  expect_mentions(unknown.err, "-X9");
  EXPECT_EQ(run("show --jsn 1 " + db).status, kUsage) << "a mistyped option is not an id";
  EXPECT_EQ(run("show -h").status, kDone);
  EXPECT_EQ(run("pin -S3 --reason x --config " + file("none.toml")).status, kBadInput)
      << "the configuration is missing";
  EXPECT_EQ(run("history -S3 " + db).status, kUsage) << "has no SLAB";
}

TEST_F(Show, an_id_that_was_given_twice_names_the_other_slab) {
  header_.slab_id = "TWICE";
  apply(BeginSlabJob{header_, 1, 1});
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});
  const auto shown = [&](const std::string& name) { return run("show " + name + " --db " + file("slabd.db")); };
  EXPECT_EQ(shown("TWICE").out.find("was given"), std::string::npos);
  header_.key = 2;
  apply(BeginSlabJob{header_, 1, 2});
  expect_mentions(shown("TWICE").out, "this SLAB_ID was given 2 times: also key 1");
  expect_mentions(shown("key:1").out, "this SLAB_ID was given 2 times: also key 2");
}

TEST_F(Show, a_history_that_is_cut_is_marked) {
  for (const std::uint16_t key : std::initializer_list<std::uint16_t>{1, 2, 3}) {
    header_.key = key;
    apply(BeginSlabJob{header_, 1, key});
    record_.res_seq = key;
    apply(SlabJob{key, slab_, record_, 1'763'681'999'000'000});
  }
  const auto history = [&](const std::string& more) { return run("history --db " + file("slabd.db") + more); };
  EXPECT_NE(history(" --limit 2").out.find("! more than 2: --limit"), std::string::npos);
  EXPECT_EQ(history(" --limit 3").out.find("more than"), std::string::npos);
  const json cut = json::parse(history(" --limit 2 --json").out);
  EXPECT_EQ(cut["more"], true);
  ASSERT_EQ(cut["slabs"].size(), 2U);
  EXPECT_EQ(cut["slabs"][0]["key"], 3) << "the newest stay";
  EXPECT_EQ(json::parse(history(" --json").out)["more"], false);
}

TEST_F(Show, slope_in_the_slabs_frame_names_its_station) {
  apply(BeginSlabJob{header_, 1, 1});
  measure_station_3();
  Item slope;
  slope.id = ItemId::seat_slope;
  slope.station = 3;
  slope.verdict = Verdict::pass;
  slope.value = 1.43;
  ASSERT_TRUE(slab_.items.push(slope));
  apply(SlabJob{1, slab_, record_, 1'763'681'999'000'000});
  expect_mentions(show("--full").out, "seat_slope [deg] 3 ");
  expect_mentions(show("--block 3").out, "seat_slope [deg] 3 ");
  EXPECT_EQ(json::parse(show("--json").out)["items"][0]["stations"], json::array({3}));
}

}  // namespace
}  // namespace slabd::cli
