// SPDX-License-Identifier: Apache-2.0
//
// slabctl replay on a stored slab of three blocks: reproduced results, and the names of changed inputs.
#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>

#include "cli/replay/remeasure.h"
#include "cli/replay/what_if.h"
#include "daemon/measure.h"
#include "tests/cli/stored_slab.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

struct Replay : StoredSlab {
  void SetUp() override { make(); }
  void make() {
    begin();
    measure(3);
    measure(4, "--defect jaw-distance=4:0.9");
    measure(12);
    end();
  }
  [[nodiscard]] Ended replay(const std::string& more = "") const {
    return replay_with(places::source_dir() + "/recipes", more);
  }
  [[nodiscard]] Ended replay_with(const std::string& recipes, const std::string& more = "") const {
    return run("replay 1 --db " + db() + " --recipes " + recipes + " " + more);
  }
  [[nodiscard]] json replayed(const std::string& more = "") const {
    return json::parse(replay("--json " + more).out, nullptr, false)["slabs"][0];
  }
  /// The recipe with a text replaced, in a separate folder.
  [[nodiscard]] std::string recipe_with(const std::string& text, const std::string& other) const {
    std::string recipe = content(kRecipe);
    const std::size_t at = recipe.find(text);
    EXPECT_NE(at, std::string::npos);
    fs::create_directories(file("recipes"));
    return write("recipes/p5600.toml", recipe.replace(at, text.size(), other));
  }
  void change_byte(const std::string& path, std::size_t from_end) const {
    std::string bytes = content(path);
    bytes[bytes.size() - from_end] = static_cast<char>(bytes[bytes.size() - from_end] ^ 0x10);
    std::ofstream(path, std::ios::binary) << bytes;
  }
};

TEST_F(Replay, comes_out_again_bit_for_bit_on_one_thread_and_on_two_and_writes_nothing) {
  const std::string before = content(db());
  for (const char* threads : {"--threads 1", "--threads 2"}) {
    const Ended ended = replay(threads);
    EXPECT_EQ(ended.status, 0) << ended.out << ended.err;
    expect_mentions(ended.out, "slab 1 \"SLAB-0042\" (fail): identical: 3 of 3 scans measured again");
    expect_mentions(ended.out, "3 of 3 scans are proven by their checksum to hold the points that were measured\n");
  }
  const json slab = replayed();
  EXPECT_EQ(slab["outcome"], "identical");
  EXPECT_EQ(slab["differences"], 0);
  EXPECT_GT(slab["figures"], 3 * 500);
  EXPECT_TRUE(slab["slab"]["compared"]);
  EXPECT_EQ(slab["scans_proven"], 3);
  EXPECT_EQ(slab["blocks"][0]["crc32c_stored"], slab["blocks"][0]["crc32c_now"]);
  EXPECT_EQ(slab["blocks"][0]["crc32c_now"].get<std::string>().size(), 8U);
  EXPECT_EQ(slab["recipe"], kRecipe);
  EXPECT_EQ(content(db()), before);
}

TEST_F(Replay, a_changed_byte_in_a_scan_is_named) {
  // The middle of the file is the middle of an organised scan, which is the seat.
  change_byte(scan(4), fs::file_size(scan(4)) / 2);
  const Ended ended = replay();
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out,
                  "block 4 attempt 1: differs: the scan was changed: its points are not those that were "
                  "measured: crc32c ");
  expect_mentions(ended.out, "2 of 3 scans are proven by their checksum");
  expect_mentions(ended.out, scan(4));
  const json slab = replayed();
  EXPECT_EQ(slab["outcome"], "differs");
  EXPECT_EQ(slab["blocks"][0]["outcome"], "identical");
  EXPECT_EQ(slab["blocks"][1]["outcome"], "differs");
  EXPECT_EQ(slab["blocks"][2]["outcome"], "identical");
}

TEST_F(Replay, a_missing_a_cut_and_another_scan_are_distinguished) {
  fs::remove(scan(3));
  fs::resize_file(scan(4), fs::file_size(scan(4)) - 1);
  ASSERT_EQ(run("simulate scan --points quarter --seed 9 --recipe " + kRecipe + " --block 12 --out " + scan(12)).status,
            0);
  const Ended ended = replay();
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "block 3 attempt 1: differs: its scan is not there");
  expect_mentions(ended.out, "block 4 attempt 1: differs: " + scan(4));
  expect_mentions(ended.out, "block 12 attempt 1: differs: the scan was changed: it holds ");
}

TEST_F(Replay, scans_that_were_moved_away_are_found_in_the_archive) {
  fs::create_directories(file("archive"));
  fs::rename(file("spool/1"), file("archive/1"));
  EXPECT_EQ(replay().status, 1);
  const Ended ended = replay("--scans " + file("archive"));
  EXPECT_EQ(ended.status, 0) << ended.out;
  expect_mentions(ended.out, "identical");
}

TEST_F(Replay, a_recipe_whose_file_was_removed_comes_from_the_database) {
  fs::create_directories(file("empty"));
  const Ended ended = replay_with(file("empty"));
  EXPECT_EQ(ended.status, 0) << ended.out << ended.err;
  expect_mentions(ended.out, "identical: 3 of 3 scans measured again");
  expect_mentions(ended.out, "recipe P5600 is no longer in the folder; measured with what the database has kept (sha:");
  // Another file with the same name and type does not matter.
  static_cast<void>(recipe_with("crop_half_x_mm = 51.0", "crop_half_x_mm = 50.0"));
  const json slab = json::parse(replay_with(file("recipes"), "--json").out, nullptr, false)["slabs"][0];
  EXPECT_EQ(slab["outcome"], "identical");
  EXPECT_TRUE(slab["changed"].empty()) << slab["changed"];
  EXPECT_EQ(slab["recipe"], "sha:" + std::string(recipe_.sha256.view()));
}

TEST_F(Replay, the_recipe_of_a_slab_is_shown_byte_for_byte_and_compared) {
  const std::string database = " --db " + db();
  const std::string sha256(recipe_.sha256.view());
  EXPECT_EQ(run("recipe show --slab SLAB-0042" + database).out, content(kRecipe));
  EXPECT_EQ(run("recipe show --sha256 " + sha256.substr(0, 6) + database).out, content(kRecipe));
  EXPECT_EQ(json::parse(run("recipe show --slab 1 --json" + database).out, nullptr, false)["sha256"], sha256);
  EXPECT_EQ(run("recipe show --slab 77" + database).status, 3);
  EXPECT_EQ(run("recipe show --sha256 0123" + database).status, 3);
  EXPECT_EQ(run("recipe show --slab 1 --sha256 " + sha256 + database).status, 2);
  EXPECT_EQ(run("recipe show").status, 2);

  const std::string wider = recipe_with("nominal = 380\ntolerance = 0.5", "nominal = 380\ntolerance = 2");
  for (const std::string& a : {std::string("slab:SLAB-0042"), "sha:" + sha256.substr(0, 8)}) {
    const json diff = json::parse(run("recipe diff " + a + " " + wider + " --json" + database).out, nullptr, false);
    ASSERT_EQ(diff["differences"].size(), 2U) << a;
    EXPECT_EQ(diff["differences"][0]["key"], "items.jaw_distance.lower");
    EXPECT_EQ(diff["a"]["sha256"], sha256);
  }
  EXPECT_EQ(run("recipe diff slab:77 " + wider + database).status, 3);
  const Ended same = run("replay 1 --recipe slab:1" + database);
  EXPECT_EQ(same.status, 0) << same.err;
  EXPECT_EQ(same.out.find(" -> "), std::string::npos) << same.out;
}

TEST_F(Replay, nothing_is_decided_from_a_scan_that_was_changed) {
  change_byte(scan(4), fs::file_size(scan(4)) / 2);
  const Ended ended = run("replay --all --db " + db() + " --recipe " + kRecipe);
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "block 4: the scan was changed: its points are not those that were measured");
}

/// A slab without stored checksums and without the recipe's file.
struct ReplayUnproven : Replay {
  void SetUp() override {
    keeps_proof_ = false;
    make();
  }
};

TEST_F(ReplayUnproven, a_scan_without_a_checksum_is_reported) {
  const Ended ended = replay();
  EXPECT_EQ(ended.status, 0) << ended.out;
  expect_mentions(ended.out,
                  "0 of 3 scans are proven by their checksum to hold the points that were measured; of 3 none "
                  "was kept");
  EXPECT_TRUE(replayed()["blocks"][0]["crc32c_stored"].is_null());
  change_byte(scan(4), fs::file_size(scan(4)) / 2);
  expect_mentions(replay().out,
                  "block 4 attempt 1: differs: no recorded input differs: the scan's content was changed after it was "
                  "acquired (no checksum was kept of it), or this ");
}

TEST_F(ReplayUnproven, nothing_is_decided_from_a_scan_of_another_shape) {
  ASSERT_EQ(run("simulate scan --points quarter --seed 9 --recipe " + kRecipe + " --block 12 --out " + scan(12)).status,
            0);
  const Ended ended = run("replay --all --db " + db() + " --recipe " + kRecipe);
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "block 12: the scan was changed: it holds ");
}

TEST_F(ReplayUnproven, a_recipe_that_was_not_kept_is_reported_as_missing) {
  fs::create_directories(file("empty"));
  const Ended ended = replay_with(file("empty"));
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "another recipe: recorded P5600");
  expect_mentions(ended.out, "without a recipe nothing can be measured");
  const Ended shown = run("recipe show --slab 1 --db " + db());
  EXPECT_EQ(shown.status, 3);
  expect_mentions(shown.err, "slab 1 was begun with P5600 by slabd ");
}

TEST_F(ReplayUnproven, another_recipe_is_named_whether_it_changes_figures_or_not) {
  static_cast<void>(recipe_with("# CRTS III", "# Comment"));
  const Ended comment = replay_with(file("recipes"));
  EXPECT_EQ(comment.status, 0) << comment.out;
  expect_mentions(comment.out, "another recipe: recorded P5600 (sha256 " + std::string(recipe_.sha256.view()));

  static_cast<void>(recipe_with("crop_half_x_mm = 51.0", "crop_half_x_mm = 50.0"));
  const Ended crop = replay_with(file("recipes"));
  EXPECT_EQ(crop.status, 1);
  expect_mentions(crop.out, "another recipe: recorded P5600");
  expect_mentions(crop.out, "block 3 attempt 1: differs: measured with another recipe");
}

TEST_F(Replay, another_recipe_decides) {
  const std::string wider = recipe_with("nominal = 380\ntolerance = 0.5", "nominal = 380\ntolerance = 2.0");
  const Ended ended = run("replay --all --db " + db() + " --recipe " + wider);
  EXPECT_EQ(ended.status, 0) << ended.err;
  expect_mentions(ended.out, "fail -> not_measured: 1");
  const json document = json::parse(run("replay --all --db " + db() + " --recipe " + wider + " --json").out);
  EXPECT_EQ(document["schema"], "slabd.what_if/1");
  EXPECT_EQ(document["slabs"]["count"], 1);
  ASSERT_EQ(document["changed"].size(), 1U);
  EXPECT_EQ(document["changed"][0]["items"][0]["id"], "jaw_distance");
  EXPECT_EQ(document["changed"][0]["items"][0]["station"], 4);
  EXPECT_EQ(document["changed"][0]["items"][0]["stored"]["verdict"], "fail");
  EXPECT_EQ(document["changed"][0]["items"][0]["now"]["verdict"], "pass");
}

TEST_F(Replay, wrong_use_is_said) {
  EXPECT_EQ(run("replay --db " + db()).status, 2);
  EXPECT_EQ(run("replay 1 --all --db " + db()).status, 2);
  EXPECT_EQ(run("replay 77 --db " + db()).status, 3);
  EXPECT_EQ(run("replay 1 --verify --recipe x.toml --db " + db()).status, 2);
  EXPECT_EQ(run("replay --all --since yesterday --db " + db()).status, 2);
  EXPECT_EQ(run("replay 1 --db " + file("none.db")).status, 4);
}

/// Compares records with the actual inputs.
struct ReplayOther : StoredSlab {
  [[nodiscard]] std::string config() const {
    return write("slabd.toml",
                 "[plc]\nlisten = \"127.0.0.1:1502\"\n[recipes]\ndir = \"" + places::source_dir() +
                     "/recipes\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[storage]\ndb = \"" + db() +
                     "\"\nspool_dir = \"" + file("spool") +
                     "\"\n[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\nstation_sigma_mm = 0.02\n"
                     "station_sigma_deg = 0.001\n");
  }
};

TEST_F(ReplayOther, another_software_or_calibration_is_named) {
  header_.software = "slabd 0.0.9";
  header_.calibration_id = "he-0123456789ab";
  header_.scanner_id = "sc-0123456789ab";
  begin();
  measure(3);
  end();
  const Ended ended = run("replay 1 --db " + db() + " --recipes " + places::source_dir() + "/recipes --threads 1");
  EXPECT_EQ(ended.status, 0) << ended.out;
  expect_mentions(ended.out, "another software: recorded slabd 0.0.9; now slabd ");
  expect_mentions(ended.out, "another calibration: recorded he-0123456789ab; now the database holds no such record");
  expect_mentions(ended.out,
                  "another scanner acceptance: recorded sc-0123456789ab; now the database holds no such record");
}

TEST_F(ReplayOther, another_scan_that_reproduces_every_figure_is_not_a_proof) {
  crc_error_ = 1;
  begin();
  measure(3);
  end();
  const Ended ended = run("replay 1 --db " + db() + " --recipes " + places::source_dir() + "/recipes");
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "block 3 attempt 1: differs: the scan was changed: its points are not those");
  expect_mentions(ended.out, "; no stored figure shows it");
}

TEST_F(ReplayOther, a_stored_figure_that_was_edited_is_found) {
  begin();
  measure(3);
  stations_[2].block.items[0].value += 1e-12;
  end();
  BlockJob edited;
  store_ = std::move(storage::open_store({db(), file("spool"), 0}).value());
  edited.slab_key = 1;
  edited.attempt = 1;
  edited.block = stations_[2].block;
  edited.record.kind = 1;
  edited.record.res_seq = 2000;
  edited.record.station = 3;
  apply(edited);
  store_.reset();
  const Ended ended = run("replay 1 --db " + db() + " --recipes " + places::source_dir() + "/recipes");
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "item seat_slope 3 value: stored ");
  const std::string version(daemon::software_version().view());
  const bool named = !version.ends_with(".dirty") && !version.ends_with("unknown");
  expect_mentions(ended.out, std::string("the scan's points are those that were measured: ") +
                                 (named ? "this build measures otherwise" : "this may be another build: "));
}

// slabd had reasons that are not in the points: the scans before, or the end of the process.
TEST_F(ReplayOther, a_scan_that_slabd_did_not_use_is_neither_a_difference_nor_judged) {
  begin();
  measure(3);
  measure(4);
  for (const auto& [station, code] : {std::pair(3, Code::frame_incomplete), std::pair(4, Code::deadline)}) {
    BlockJob refused;
    refused.slab_key = 1;
    refused.attempt = 1;
    refused.block.station = static_cast<std::uint8_t>(station);
    refused.block.verdict = Verdict::not_measured;
    refused.block.reason = static_cast<std::uint16_t>(code);
    refused.record.kind = 1;
    refused.record.res_seq = static_cast<std::uint16_t>(2'000 + station);
    refused.record.station = refused.block.station;
    apply(refused);
    stations_[static_cast<std::size_t>(station - 1)].block = refused.block;
  }
  end();
  const std::string recipes = " --db " + db() + " --recipes " + places::source_dir() + "/recipes";
  const Ended ended = run("replay 1 --verify" + recipes);
  expect_mentions(ended.out, "slabd did not use this scan, or ended while it measured it (reason 303)");
  expect_mentions(ended.out, "(reason 405)");
  EXPECT_EQ(ended.out.find("differs"), std::string::npos) << ended.out;
  const json judged = json::parse(run("replay 1 --recipe " + kRecipe + " --json --db " + db()).out, nullptr, false);
  EXPECT_EQ(judged["slabs"]["count"], 1);
  EXPECT_EQ(judged["changed"].size(), 0U) << judged;
}

TEST(ScanForms, are_those_of_each_scanner_unless_given_for_all) {
  config::Config config;
  config.arms.list[0].scanner = "left";
  Arm right;
  right.scanner = "right";
  ASSERT_TRUE(config.arms.list.push(right));
  config.more_arms.emplace_back();
  config.scanner.form.unit = hal::LengthUnit::m;
  Attempt attempt;
  const auto unit_of = [&](const ScanForms& forms, const char* scanner) {
    attempt.by.scanner = scanner;
    return forms.of(attempt).unit;
  };
  const ScanForms forms(config, ScanFormOptions{.unit = "", .columns = ""});
  EXPECT_EQ(unit_of(forms, "left"), hal::LengthUnit::m);
  EXPECT_EQ(unit_of(forms, "right"), hal::LengthUnit::mm);
  EXPECT_EQ(unit_of(forms, "removed"), hal::LengthUnit::m);
  EXPECT_EQ(forms.unit(), "m+mm");
  EXPECT_EQ(forms.columns(), "");
  const ScanForms given(config, ScanFormOptions{.unit = "um", .columns = ""});
  EXPECT_EQ(unit_of(given, "right"), hal::LengthUnit::um);
  EXPECT_EQ(given.unit(), "um");
}

TEST_F(ReplayOther, recipe_values_in_the_header_are_compared) {
  header_.guard = 0.25;
  ++header_.unconfirmed;
  begin();
  measure(3);
  end();
  const Ended ended = run("replay 1 --db " + db() + " --recipes " + places::source_dir() + "/recipes");
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "    guard: stored 0.25, now 1\n");
  expect_mentions(ended.out, "    unconfirmed: stored ");
}

TEST_F(ReplayOther, a_slab_that_is_still_open_is_not_identical) {
  begin();
  measure(3);
  store_.reset();
  const Ended ended = run("replay 1 --db " + db() + " --recipes " + places::source_dir() + "/recipes");
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.out, "slab 1 \"SLAB-0042\" (none): not_verified: 1 of 1 scans measured again");
  expect_mentions(ended.out, "the slab is still open");
}

TEST_F(ReplayOther, a_slab_with_scans_and_no_recipe_is_not_passed_over_among_many) {
  begin();
  measure(3);
  end();
  const std::string all = "replay --all --db " + db() + " --recipes " + places::source_dir() + "/recipes";
  EXPECT_EQ(run(all).status, 0);
  header_.key = 2;
  header_.slab_type = 9'999;
  header_.recipe_sha256.assign(std::string(64, '0'));
  begin();
  fs::copy(file("spool/1"), file("spool/2"));
  Attempt attempt;
  attempt.slab_key = 2;
  attempt.station = 3;
  attempt.number = 1;
  attempt.session = 1;
  attempt.cmd_seq = 4;
  attempt.scan_path.assign(file("spool/2/03-1.ply"));
  apply(AcquiredJob{attempt});
  BlockJob block;
  block.slab_key = 2;
  block.attempt = 1;
  block.block = stations_[2].block;
  block.record.kind = 1;
  block.record.res_seq = 2000;
  block.record.station = 3;
  apply(block);
  SlabJob slab;
  slab.slab_key = 2;
  slab.slab.verdict = Verdict::not_measured;
  slab.record.kind = 2;
  slab.record.res_seq = 2001;
  slab.ended_utime_us = 1'763'682'999'000'000;
  apply(slab);
  store_.reset();
  const Ended ended = run(all);
  EXPECT_EQ(ended.status, 1) << ended.out;
  expect_mentions(ended.out, "identical 1, differ 0, not verified 1");
  expect_mentions(ended.err, "of the slabs not verified 1 could be measured: only the recipe is missing");
  fs::remove_all(file("spool/2"));
  EXPECT_EQ(run(all).status, 0) << "its scans are pruned";
}

TEST_F(ReplayOther, a_pin_lies_beside_the_scans_and_says_why) {
  begin();
  std::ofstream(scan(1)) << "points";
  Attempt attempt;
  attempt.slab_key = 1;
  attempt.station = attempt.number = 1;
  attempt.session = attempt.cmd_seq = 1;
  attempt.scan_path.assign(scan(1));
  apply(AcquiredJob{attempt});
  const std::string of_slab = " SLAB-0042 --config " + config();
  EXPECT_EQ(run("pin" + of_slab).status, 2) << "a reason is required";
  EXPECT_EQ(run("unpin" + of_slab).status, 3) << "it is not pinned";
  const Ended pinned = run("pin" + of_slab + " --reason 'complaint 17'");
  EXPECT_EQ(pinned.status, 0) << pinned.err;
  const json pin = json::parse(content(file("spool/1/pin.json")), nullptr, false);
  EXPECT_EQ(pin["reason"], "complaint 17");
  EXPECT_EQ(pin["key"], 1);
  EXPECT_EQ(pin["who"], "root");
  const auto shown = [&] { return json::parse(run("pin" + of_slab + " --show --json").out, nullptr, false); };
  EXPECT_EQ(shown()["pin"]["reason"], "complaint 17");
  EXPECT_EQ(shown()["scans"], 1);
  EXPECT_EQ(shown()["scans_there"], 1);
  expect_mentions(run("pin" + of_slab + " --show").out, "complaint 17; 1 of 1 scans are there");
  EXPECT_EQ(run("unpin" + of_slab).status, 0);
  EXPECT_TRUE(shown()["pin"].is_null());
  EXPECT_FALSE(fs::exists(file("spool/1/pin.json")));
  // Pinning a slab whose scans are missing must fail.
  std::vector<fs::path> scans;
  for (const auto& entry : fs::directory_iterator(file("spool/1"))) scans.push_back(entry.path());
  ASSERT_FALSE(scans.empty());
  std::ofstream(file("spool/1/notes.txt")) << "of a person";
  for (const fs::path& scan : scans) fs::remove(scan);
  const Ended too_late = run("pin" + of_slab + " --reason late");
  EXPECT_EQ(too_late.status, 3) << too_late.out;
  expect_mentions(too_late.err, "its scans are gone");
  EXPECT_FALSE(fs::exists(file("spool/1/pin.json")));
  fs::remove_all(file("spool/1"));
  expect_mentions(run("pin" + of_slab + " --reason late").err, "its scans are gone");
}

TEST_F(ReplayOther, the_newest_backup_is_the_one_that_knows_the_newest_slab) {
  begin();
  end();
  ASSERT_EQ(run("db backup --config " + config()).status, 0);
  const fs::path folder = file("backups");
  const fs::path ahead = folder / "slabd-20991231T000000.000Z.db";  // made while the clock was wrong
  fs::rename(fs::directory_iterator(folder)->path(), ahead);
  header_.key = 2;
  begin();
  store_.reset();
  ASSERT_EQ(run("db backup --config " + config()).status, 0);
  std::string newest;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path() != ahead) newest = entry.path().native();
  const Ended checked = run("db check --config " + config());
  EXPECT_EQ(checked.status, 0) << checked.err;
  expect_mentions(checked.out, "2 backups, newest " + newest + " (slabs up to 2)");
}

TEST_F(ReplayOther, backups_of_a_clock_that_was_ahead_are_not_kept_at_the_cost_of_newer_ones) {
  begin();
  end();
  const fs::path folder = file("backups");
  const std::string back_up = "db backup --config " + config();
  ASSERT_EQ(run(back_up).status, 0);
  // Two backups of nights with the clock ahead, and one unreadable backup.
  const fs::path stale = folder / "slabd-20991230T000000.000Z.db";
  fs::rename(fs::directory_iterator(folder)->path(), stale);
  fs::copy_file(stale, folder / "slabd-20991231T000000.000Z.db");
  const std::string unreadable = write("backups/slabd-20200101T000000.000Z.db", "of a disk that was full");
  header_.key = 2;
  begin();
  store_.reset();
  const Ended yesterday = run(back_up + " --keep 2");
  ASSERT_EQ(yesterday.status, 0) << yesterday.err;
  std::string real;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().native() != unreadable && entry.path().filename().native().find("slabd-2099") != 0)
      real = entry.path().native();
  ASSERT_EQ(run(back_up + " --keep 2").status, 0);
  EXPECT_TRUE(fs::exists(real)) << "it knows slab 2; those from 2099 do not";
  EXPECT_FALSE(fs::exists(stale));
  EXPECT_FALSE(fs::exists(folder / "slabd-20991231T000000.000Z.db"));
  EXPECT_TRUE(fs::exists(unreadable));
}

TEST_F(ReplayOther, a_further_copy_that_cannot_be_examined_is_reported_before_anything_is_done) {
  begin();
  store_.reset();
  fs::create_symlink(file("circle"), file("circle"));
  fs::create_symlink(file("nowhere"), file("dangling"));
  const std::string back_up = "db backup --config " + config() + " --out ";
  const Ended circle = run(back_up + file("circle/copy.db"));
  EXPECT_EQ(circle.status, 3) << circle.err;
  expect_mentions(circle.err, "circle/copy.db cannot be looked at");
  for (const char* link : {"circle", "dangling"}) {
    const Ended there = run(back_up + file(link));
    EXPECT_EQ(there.status, 3) << there.err;
    expect_mentions(there.err, "exists already");
  }
  EXPECT_TRUE(fs::is_empty(file("backups"))) << "nothing was done";
}

using Checksum = Slabctl;

TEST_F(Checksum, the_python_of_the_documents_gives_it) {
  const std::string quality = content(places::source_dir() + "/docs/QUALITY.md");
  const std::string fence = "```python\n";
  const std::size_t begin = quality.find(fence) + fence.size();
  const std::string script = write("crc.py", quality.substr(begin, quality.find("```", begin) - begin));
  std::vector<float> xyz;
  for (int i = 0; i < 600; ++i) xyz.push_back(0.37F * static_cast<float>(i) - 50.0F);
  xyz[33] = xyz[34] = xyz[35] = -std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(hal::write_ply(file("a.ply").c_str(), xyz, 0, 0).ok());
  ASSERT_EQ(std::system(("/usr/bin/python3 " + script + " " + file("a.ply") + " > " + file("crc.txt")).c_str()), 0);
  char wanted[16];
  std::snprintf(wanted, sizeof wanted, "%08x\n", hal::points_crc32c(xyz));
  EXPECT_EQ(content(file("crc.txt")), wanted);
}

TEST(WhatIf, counts_verdicts_that_differ_once_for_each_place) {
  VerdictTally tally;
  tally.add(Verdict::pass, Verdict::pass);
  tally.add(Verdict::pass, Verdict::fail);
  tally.add(Verdict::pass, Verdict::fail);
  EXPECT_EQ(tally.count, 3);
  EXPECT_EQ(tally.changed(), 2);
}

}  // namespace
}  // namespace slabd::cli
