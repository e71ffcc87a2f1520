// SPDX-License-Identifier: Apache-2.0
//
// slabctl export: independent readers (tests/cli/read_exports.py) parse its output. An independent validator
// (tests/cli/validate_json.py) checks every JSON document with its published schema.
#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/durable.h"
#include "tests/cli/stored_slab.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

struct Export : StoredSlab {
  /// Three blocks, and an id that a CSV must quote.
  void store_slab() {
    header_.slab_id = "A, \"42\"";
    begin();
    measure(3);
    measure(4, "--defect jaw-distance=4:0.9");
    measure(12);
    end();
  }
  [[nodiscard]] Ended python(const std::string& arguments) const {
    const int status = std::system(("/usr/bin/python3 " + places::source_dir() + "/tests/cli/" + arguments + " >" +
                                    file("py.out") + " 2>" + file("py.err"))
                                       .c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, content(file("py.out")), content(file("py.err"))};
  }
  [[nodiscard]] json read(const std::string& kind, const std::string& path) const {
    const Ended ended = python("read_exports.py " + kind + " " + path);
    EXPECT_EQ(ended.status, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }
  [[nodiscard]] std::string recipes() const { return " --recipes " + places::source_dir() + "/recipes"; }
};

TEST_F(Export, a_table_has_one_row_for_each_item_and_reads_as_rfc_4180) {
  store_slab();
  const Ended ended = run("export --all --bom --db " + db() + " --out " + file("items.csv"));
  ASSERT_EQ(ended.status, 0) << ended.err;
  const json table = read("csv", file("items.csv"));
  EXPECT_TRUE(table["bom"]);
  EXPECT_EQ(table["columns"].size(), 44U);
  const json document = json::parse(run("show 1 --json --db " + db()).out);
  std::size_t items = document["items"].size();
  for (const json& block : document["blocks"])
    items += stations_[block["station"].get<std::size_t>() - 1].block.items.size();
  EXPECT_EQ(table["rows"].size(), items);
  const json* jaw = nullptr;
  for (const json& row : table["rows"]) {
    EXPECT_EQ(row["version"], "slabd.items/1");
    EXPECT_EQ(row["slab_id"], "A, \"42\"");
    if (row["item"] == "jaw_distance" && row["station"] == "4") jaw = &row;
  }
  ASSERT_NE(jaw, nullptr);
  EXPECT_EQ((*jaw)["verdict"], "fail");
  EXPECT_EQ((*jaw)["scope"], "block");
  const Item* stored =
      find_item(stations_[3].block.items.begin(), stations_[3].block.items.end(), ItemId::jaw_distance);
  ASSERT_NE(stored, nullptr);
  EXPECT_EQ(std::stod((*jaw)["value"].get<std::string>()), stored->value);  // every digit
  EXPECT_EQ(std::stod((*jaw)["U"].get<std::string>()), stored->U);
  // An item that was not measured has an empty value, never 0.
  for (const json& row : table["rows"]) EXPECT_TRUE(row["verdict"] != "not_measured" || row["value"] == "") << row;
  EXPECT_EQ(run("export 1 --db " + db()).out, content(file("items.csv")).substr(3));
}

TEST_F(Export, temperature_age_mould_and_slope_datum_are_written) {
  header_.temperature_dk = 2931;
  header_.age_h = 26;
  header_.mould = 12;
  header_.emulated = kEmulatedScan;
  begin();
  measure(3);
  const auto document = [&] { return json::parse(run("export 1 --format json --db " + db()).out); };
  EXPECT_TRUE(document()["slope_datum"].is_null()) << "the slab has not ended";
  end();
  const json slab = document();
  EXPECT_EQ(slab["slab_temperature_k"], 293.1);
  EXPECT_EQ(slab["slab_age_h"], 26);
  EXPECT_EQ(slab["mould"], 12);
  EXPECT_EQ(slab["slope_datum"], "slab_frame");
  EXPECT_EQ(slab["T_flange_scanner"], (json{0.0, 80.0, 150.0, 1.0, 0.0, 0.0, 0.0}));
  ASSERT_EQ(run("export 1 --out " + file("items.csv") + " --db " + db()).status, 0);
  const json table = read("csv", file("items.csv"));
  const auto& columns = table["columns"];
  ASSERT_GT(columns.size(), 8U);
  EXPECT_EQ(columns[columns.size() - 11], "scanner_id") << "new columns come at the end";
  EXPECT_EQ(columns.back(), "tie_id");
  for (const json& row : table["rows"]) {
    EXPECT_EQ(row["slab_temperature_k"], "293.1");
    EXPECT_EQ(row["slab_age_h"], "26");
    EXPECT_EQ(row["mould"], "12");
    EXPECT_EQ(row["slope_datum"], "slab_frame");
    EXPECT_EQ(row["scanner"], row["scope"] == "block" ? "1" : "");
    EXPECT_EQ(row["emulated"], "1");
  }
}

TEST_F(Export, values_that_the_plc_did_not_send_are_absent) {
  recipe_.slope_datum = SlopeDatum::local_slab_top;
  begin();
  measure(3);
  end();
  const json slab = json::parse(run("export 1 --format json --db " + db()).out);
  EXPECT_TRUE(slab["slab_temperature_k"].is_null());
  EXPECT_TRUE(slab["slab_age_h"].is_null());
  EXPECT_TRUE(slab["mould"].is_null());
  EXPECT_EQ(slab["slope_datum"], "local_slab_top");
  ASSERT_EQ(run("export 1 --out " + file("items.csv") + " --db " + db()).status, 0);
  for (const json& row : read("csv", file("items.csv"))["rows"]) {
    EXPECT_EQ(row["slab_temperature_k"], "");
    EXPECT_EQ(row["slab_age_h"], "");
    EXPECT_EQ(row["mould"], "");
    EXPECT_EQ(row["slope_datum"], "local_slab_top");
  }
}

TEST_F(Export, choices_and_wrong_use) {
  store_slab();
  EXPECT_EQ(run("export --db " + db()).status, 2);
  EXPECT_EQ(run("export --all --out x.xls --db " + db()).status, 2);
  EXPECT_EQ(run("export --all --bom --format json --db " + db()).status, 2);
  EXPECT_EQ(run("export 9 --db " + db()).status, 3);
  EXPECT_EQ(run("export --all --out " + file("none/x.csv") + " --db " + db()).status, 3);
  const std::string heading = run("export --verdict pass --db " + db()).out;
  EXPECT_EQ(std::count(heading.begin(), heading.end(), '\n'), 1);
  const json all = json::parse(run("export --since 2025-11-20 --slab-type 5600 --format json --db " + db()).out);
  EXPECT_EQ(all["schema"], "slabd.export/1");
  ASSERT_EQ(all["slabs"].size(), 1U);
  EXPECT_EQ(all["slabs"][0], json::parse(run("export 1 --format json --db " + db()).out));
  EXPECT_TRUE(json::parse(run("export --until 2025-11-20 --format json --db " + db()).out)["slabs"].empty());
  EXPECT_TRUE(json::parse(run("export --until 1970-01-01 --format json --db " + db()).out)["slabs"].empty());
  EXPECT_EQ(run("export 1 1 key:1 'A, \"42\"' --db " + db()).out, run("export 1 --db " + db()).out) << "one slab, once";
}

TEST_F(Export, clouds_are_read_by_others_and_lie_where_they_should) {
  store_slab();
  const Ended block = run("export cloud 1 --block 3 --out " + file("block.ply") + " --db " + db() + recipes());
  ASSERT_EQ(block.status, 0) << block.err;
  const json of_block = read("cloud", file("block.ply"));
  EXPECT_GT(of_block["points"], 1'000'000);
  EXPECT_LT(of_block["median_abs_deviation_mm"], 0.2);
  EXPECT_LT(std::abs(of_block["seat_mean_mm"].get<double>()), 0.1);
  EXPECT_GT(of_block["seat_points"], 100'000);

  const Ended slab = run("export cloud 1 --voxel 4 --out " + file("slab.ply") + " --db " + db() + recipes());
  ASSERT_EQ(slab.status, 0) << slab.err;
  expect_mentions(slab.err, "left out: block 1: no scan of it");
  const json of_slab = read("cloud", file("slab.ply"));
  EXPECT_EQ(of_slab["stations"], (json{3, 4, 12}));
  EXPECT_LT(of_slab["points"], 200'000);
  // Stations 3 and 4 are at y = 758, station 12 is opposite: x = -2520 + 630 (i - 1), heights from the slab's top to a
  // shoulder.
  EXPECT_NEAR(of_slab["low"][0].get<double>(), -1260.0 - 170.0, 120.0);
  EXPECT_NEAR(of_slab["low"][1].get<double>(), -758.0 - 270.0, 120.0);
  EXPECT_NEAR(of_slab["high"][1].get<double>(), 758.0 + 270.0, 120.0);
  EXPECT_NEAR(of_slab["low"][2].get<double>(), 0.0, 5.0);
  EXPECT_NEAR(of_slab["high"][2].get<double>(), 60.0, 5.0);

  EXPECT_EQ(run("export cloud 1 --block 7 --out " + file("x.ply") + " --db " + db() + recipes()).status, 3);
  EXPECT_FALSE(fs::exists(file("x.ply")));
  EXPECT_FALSE(fs::exists(file("x.ply.part")));

  // Another scan under the name of the one that was measured.
  fs::copy_file(scan(4), scan(3), fs::copy_options::overwrite_existing);
  const Ended other = run("export cloud 1 --block 3 --out " + file("x.ply") + " --db " + db() + recipes());
  EXPECT_EQ(other.status, 3) << other.out;
  expect_mentions(other.err, "its points are not those that were measured");
  EXPECT_FALSE(fs::exists(file("x.ply")));
  const Ended rest = run("export cloud 1 --voxel 4 --out " + file("rest.ply") + " --db " + db() + recipes());
  EXPECT_EQ(rest.status, 0) << rest.err;
  expect_mentions(rest.err, "left out: block 3: its scan was changed");
  EXPECT_EQ(read("cloud", file("rest.ply"))["stations"], (json{4, 12}));
}

TEST_F(Export, models_are_closed_and_as_large_as_the_recipe_says) {
  for (const char* extension : {".stl", ".ply"}) {
    const std::string block = file(std::string("block") + extension);
    ASSERT_EQ(run("export model " + kRecipe + " --block --out " + block).status, 0);
    const json of_block = read("mesh", block);
    EXPECT_EQ(of_block["open_edges"], 0) << extension;
    EXPECT_NEAR(of_block["high"][0].get<double>(), 105.0 + 30.0 * std::tan(rad_from_deg(10.0)), 1e-3);
    EXPECT_NEAR(of_block["low"][1].get<double>(), -240.0 - 30.0 * std::tan(rad_from_deg(10.0)), 1e-3);
    EXPECT_NEAR(of_block["low"][2].get<double>(), -30.0, 1e-3);
    EXPECT_NEAR(of_block["high"][2].get<double>(), 29.75, 1e-3);
    const double block_volume = of_block["volume_mm3"];
    // About 210 x 490 mm and 30 mm high; shoulders add volume, bores remove it.
    EXPECT_NEAR(block_volume, 210.0 * 490.0 * 36.0, 0.15 * 210.0 * 490.0 * 36.0);

    const std::string slab = file(std::string("slab") + extension);
    ASSERT_EQ(run("export model " + kRecipe + " --out " + slab).status, 0);
    const json of_slab = read("mesh", slab);
    EXPECT_EQ(of_slab["open_edges"], 0) << extension;
    EXPECT_NEAR(of_slab["volume_mm3"].get<double>(), 5600.0 * 2500.0 * 200.0 + 18.0 * block_volume, 5e5);
    EXPECT_NEAR(of_slab["high"][0].get<double>(), 2800.0, 1e-3);
  }
  EXPECT_EQ(run("export model " + kRecipe + " --out " + file("x.obj")).status, 3);
}

TEST_F(Export, reasons_are_the_same_table_in_every_form_the_most_frequent_first) {
  store_slab();
  const std::string command = "reasons --since 2025-11-20 --db " + db();
  const json document = json::parse(run(command + " --json").out);
  const json& rows = document["reasons"];
  ASSERT_FALSE(rows.empty());
  EXPECT_EQ(document["slabs"], 1);
  EXPECT_TRUE(std::is_sorted(rows.rbegin(), rows.rend(), [](auto& a, auto& b) { return a["count"] < b["count"]; }));
  EXPECT_NEAR(rows.back()["cumulative_percent"], 100.0, 1e-9);
  const std::string csv = run(command + " --csv").out;
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), static_cast<std::ptrdiff_t>(rows.size() + 1));
  const std::string item = rows.front()["item"];
  for (const char* form : {"", " --csv", " --html"}) expect_mentions(run(command + form).out, item);
  EXPECT_EQ(json::parse(run("reasons --until 2025-11-20 --json --db " + db()).out)["reasons"], json::array());
}

TEST_F(Export, every_json_document_is_what_its_published_schema_says) {
  store_slab();
  const std::string recipes_dir = places::source_dir() + "/recipes";
  const std::string config =
      write("slabd.toml", "[plc]\nlisten = \"127.0.0.1:1502\"\n[recipes]\ndir = \"" + recipes_dir +
                              "\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[storage]\ndb = \"" + db() +
                              "\"\nspool_dir = \"" + file("spool") +
                              "\"\n[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n"
                              "station_sigma_mm = 0.02\nstation_sigma_deg = 0.001\n");
  const std::string other = recipes_dir + "/p4925.toml";
  ASSERT_EQ(simulate_scan("none.ply", "--defect missing=3").status, 0);
  ASSERT_EQ(run("simulate plane --out " + file("plane.xyz")).status, 0);
  ASSERT_EQ(run("stations --config " + config + " --krl " + file("PTS")).status, 0);
  const std::string in_db = " --db " + db();
  std::string documents;
  int count = 0;
  for (const std::string& command : {"show 1" + in_db,
                                     "show 1 --block 4" + in_db,
                                     "history" + in_db,
                                     "reasons" + in_db,
                                     "trend" + in_db,
                                     "trend jaw_distance" + in_db,
                                     "trend seat_lateral" + in_db,
                                     "yield" + in_db,
                                     "yield --by type" + in_db,
                                     "compare 1 1" + in_db,
                                     "compare --period 2025-11-01..2025-12-01 --period 2025-11-02..2025-12-01" + in_db,
                                     "trend seat_slope --block 3" + in_db,
                                     "replay 1" + in_db + recipes(),
                                     "replay 1" + in_db + " --recipes " + dir_.string(),
                                     "replay 1 --recipe " + kRecipe + in_db,
                                     "recipe show " + kRecipe,
                                     "recipe show " + other,
                                     "recipe check " + kRecipe,
                                     "recipe check " + config,
                                     "recipe diff " + kRecipe + " " + other,
                                     "recipe diff " + kRecipe + " " + kRecipe + in_db,
                                     "config check " + config,
                                     "config check --config " + config,
                                     "inspect " + scan(3) + " --block 3 --recipe " + kRecipe,
                                     "inspect " + file("none.ply") + " --block 3 --recipe " + kRecipe,
                                     "fit-plane " + file("plane.xyz"),
                                     "fit-plane " + file("plane.xyz") + " --compare",
                                     "fit-plane " + file("plane.xyz") + " --compare --threshold 0.03 --set 1 2 1",
                                     std::string("plc map"),
                                     std::string("plc codes"),
                                     "stations --config " + config,
                                     "stations --config " + config + " --taught " + file("PTS.dat")}) {
    const Ended ended = run(command + " --json");
    EXPECT_FALSE(ended.out.empty()) << command << ended.err;
    documents += " " + write("document-" + std::to_string(++count) + ".json", ended.out);
  }
  for (const std::string& command : {"export 1" + in_db, "export --all" + in_db})
    documents += " " + write("document-" + std::to_string(++count) + ".json", run(command + " --format json").out);
  const Ended valid = python("validate_json.py " + places::source_dir() + "/docs/schemas" + documents);
  EXPECT_EQ(valid.status, 0) << valid.out << valid.err;
  expect_mentions(valid.out, "34 documents, 0 faults");
}

TEST_F(Export, an_id_that_a_spreadsheet_would_compute_is_neutral_unless_a_program_asks_for_it_raw) {
  header_.slab_id = "=1+1";
  begin();
  measure(3);
  end();
  const Ended plain = run("export 1 --raw --out " + file("plain.csv") + " --db " + db());
  ASSERT_EQ(plain.status, 0) << plain.err;
  const json table = read("csv", file("plain.csv"));
  ASSERT_FALSE(table["rows"].empty());
  for (const json& row : table["rows"]) EXPECT_EQ(row["slab_id"], "=1+1");
  bool negative = false;
  for (const char* option : {"", "--bom "}) {
    ASSERT_EQ(run(std::string("export 1 ") + option + "--out " + file("excel.csv") + " --db " + db()).status, 0);
    const json excel = read("csv", file("excel.csv"));
    for (const json& row : excel["rows"]) {
      EXPECT_EQ(row["slab_id"], "'=1+1");
      const std::string deviation = row["deviation"];
      EXPECT_EQ(deviation.find('\''), std::string::npos) << "a negative number is a number";
      negative = negative || deviation.starts_with("-");
    }
  }
  EXPECT_TRUE(negative);
  const Ended json_export = run("export 1 --format json --db " + db());
  expect_mentions(json_export.out, "\"=1+1\"");
  EXPECT_EQ(run("export --all --raw --format json --db " + db()).status, 2);
}

TEST_F(Export, a_list_of_points_replaces_no_other_unasked) {
  const std::string config =
      write("slabd.toml", "[plc]\nlisten = \"127.0.0.1:1502\"\n[recipes]\ndir = \"" + places::source_dir() +
                              "/recipes\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[storage]\ndb = \"" +
                              db() + "\"\nspool_dir = \"" + file("spool") +
                              "\"\n[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n"
                              "station_sigma_mm = 0.02\nstation_sigma_deg = 0.001\n");
  const std::string what = "stations --config " + config + " --krl " + file("PTS");
  const Ended first = run(what);
  EXPECT_NE(first.status, 3) << first.err;
  const std::string points = content(file("PTS.dat"));
  expect_mentions(points, "STATION1[1]");
  std::ofstream(file("PTS.src")) << "touched up by hand";
  fs::remove(file("PTS.dat"));
  const Ended again = run(what);
  EXPECT_EQ(again.status, 3);
  expect_mentions(again.err, "PTS.src exists already; name another, or say --overwrite");
  EXPECT_FALSE(fs::exists(file("PTS.dat"))) << "neither of the two is written";
  EXPECT_EQ(content(file("PTS.src")), "touched up by hand");
  EXPECT_EQ(run(what + " --overwrite").status, first.status);
  EXPECT_EQ(content(file("PTS.dat")), points);
  expect_mentions(content(file("PTS.src")), "PTS");
}

TEST_F(Export, the_validator_finds_a_key_too_many_and_a_wrong_type) {
  const std::string good = run("plc codes --json").out;
  json document = json::parse(good);
  const std::string schemas = places::source_dir() + "/docs/schemas ";
  EXPECT_EQ(python("validate_json.py " + schemas + write("good.json", good)).status, 0);
  document["more"] = 1;
  EXPECT_EQ(python("validate_json.py " + schemas + write("more.json", document.dump())).status, 1);
  document.erase("more");
  document["schema"] = "slabd.plc_codes/2";
  EXPECT_EQ(python("validate_json.py " + schemas + write("version.json", document.dump())).status, 1);
}

/// Files in a separate folder.
class OutFileTest : public ::testing::Test {
 protected:
  OutFileTest() {
    std::string pattern = (fs::temp_directory_path() / "slabd-out-XXXXXX").string();
    folder_ = ::mkdtemp(pattern.data());
  }
  ~OutFileTest() override { fs::remove_all(folder_); }
  [[nodiscard]] std::string file(const std::string& name) const { return (folder_ / name).string(); }
  [[nodiscard]] std::ptrdiff_t files() const {
    return std::distance(fs::directory_iterator(folder_), fs::directory_iterator());
  }
  static Status put(const std::string& path, const std::string& text, OutFile::Kind kind = {}) {
    OutFile out(path, kind);
    out.write(text);
    return out.close();
  }

  fs::path folder_;
};

TEST_F(OutFileTest, a_link_stays_and_the_file_it_means_is_replaced) {
  fs::create_directory(file("elsewhere"));
  fs::create_symlink("elsewhere/real.csv", file("link.csv"));
  fs::create_symlink("link.csv", file("link-to-link.csv"));
  for (const char* name : {"link.csv", "link-to-link.csv"}) {
    ASSERT_TRUE(put(file(name), name)) << "the first time nothing is there yet";
    EXPECT_TRUE(fs::is_symlink(file("link.csv")));
    EXPECT_TRUE(fs::is_symlink(file("link-to-link.csv")));
    EXPECT_EQ(content(file("elsewhere/real.csv")), name);
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(file("elsewhere")), fs::directory_iterator()), 1);
  EXPECT_EQ(files(), 3);
  fs::create_symlink("round", file("round"));
  EXPECT_FALSE(put(file("round"), "x")) << "a circle";
  EXPECT_TRUE(fs::is_symlink(file("round")));
}

TEST_F(OutFileTest, a_pipe_is_written_into_and_stays_a_pipe) {
  ASSERT_EQ(::mkfifo(file("pipe").c_str(), 0600), 0);
  // Opened for both directions, so that neither side blocks.
  const int reader = ::open(file("pipe").c_str(), O_RDWR | O_NONBLOCK);
  ASSERT_GE(reader, 0);
  for (const bool synced : {false, true}) {
    ASSERT_TRUE(put(file("pipe"), "through", {.synced = synced}));
    std::array<char, 100> got{};
    ASSERT_EQ(::read(reader, got.data(), got.size()), 7);
    EXPECT_STREQ(got.data(), "through");
  }
  const Status again = put(file("pipe"), "head", {.rewritten = true});
  ASSERT_FALSE(again) << "a pipe cannot go back";
  expect_mentions(std::string(again.error().text.view()), "it must be a separate file");
  ::close(reader);
  EXPECT_TRUE(fs::is_fifo(file("pipe")));
  EXPECT_EQ(files(), 1);
  EXPECT_FALSE(put(folder_.string(), "x")) << "a folder";
}

TEST_F(OutFileTest, a_file_of_slabds_own_does_not_follow_a_link_that_another_user_created) {
  std::ofstream(file("victim")) << "untouched";
  fs::create_symlink("victim", file("own"));
  ASSERT_TRUE(write_durably(file("own"), "new"));
  EXPECT_FALSE(fs::is_symlink(file("own")));
  EXPECT_EQ(content(file("own")), "new");
  EXPECT_EQ(content(file("victim")), "untouched");
}

// As root a process follows links of all users; without root the test cannot create a link of another user.
TEST_F(OutFileTest, a_link_of_another_user_is_followed_only_where_that_user_could_not_have_planted_it) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give a link to another user";
  constexpr uid_t kOther = 65'534;
  const auto expect = [&](bool followed, const std::string& out, const std::string& what) {
    std::ofstream(file("victim")) << "untouched";
    const Status status = put(out, "new");
    EXPECT_EQ(status.ok(), followed) << what;
    EXPECT_EQ(content(file("victim")), followed ? "new" : "untouched") << what;
    EXPECT_EQ(check_links(out).ok(), followed) << what;
    if (!followed) expect_mentions(std::string(status.error().text.view()), "belongs to user nobody");
    if (!followed) expect_mentions(std::string(status.error().text.view()), "not followed");
  };
  const fs::path shared = file("shared");
  fs::create_directory(shared);
  const std::string link = (shared / "out.csv").string();
  fs::create_symlink(file("victim"), link);
  ASSERT_EQ(::lchown(link.c_str(), kOther, kOther), 0);
  ASSERT_EQ(::chmod(shared.c_str(), 01777), 0);
  expect(false, link, "a sticky folder as /tmp");
  ASSERT_EQ(::chmod(shared.c_str(), 0775), 0);
  expect(false, link, "a folder of a group");
  ASSERT_EQ(::chmod(shared.c_str(), 0755), 0);
  expect(true, link, "only root can write to the folder");
  ASSERT_EQ(::chown(shared.c_str(), kOther, kOther), 0);
  expect(false, link, "the folder of the other user");
  ASSERT_EQ(::lchown(link.c_str(), 0, 0), 0);
  expect(true, link, "the caller's own link");
  const std::string folder_link = (shared / "folder").string();
  fs::create_directory_symlink(folder_, folder_link);
  ASSERT_EQ(::lchown(folder_link.c_str(), kOther, kOther), 0);
  expect(false, folder_link + "/victim", "a link on the way");
}

TEST_F(OutFileTest, two_writers_of_one_file_leave_the_whole_file_of_the_last_one) {
  const std::string path = file("both.csv");
  const std::string first(3'000'000, 'a');
  const std::string second(2'000'000, 'b');
  {
    OutFile a(path);
    OutFile b(path);
    for (std::size_t at = 0; at < second.size(); at += 100'000) {
      a.write(first.substr(at, 100'000));
      b.write(second.substr(at, 100'000));
    }
    ASSERT_TRUE(b.close());
    EXPECT_EQ(content(path), second);
    a.write(first.substr(second.size()));
    ASSERT_TRUE(a.close());
    EXPECT_EQ(content(path), first);
    OutFile given_up(path);
    given_up.write("not finished");
  }
  EXPECT_EQ(content(path), first);
  EXPECT_EQ(files(), 1) << "nothing is left beside it";
}

TEST_F(OutFileTest, a_new_file_has_the_mode_of_any_other_program) {
  const mode_t before = ::umask(027);
  ASSERT_TRUE(put(file("plain"), "x"));
  ASSERT_TRUE(put(file("shared"), "x", {.mode = 0664}));
  ::umask(before);
  EXPECT_EQ(fs::status(file("plain")).permissions(), fs::perms(0640));
  EXPECT_EQ(fs::status(file("shared")).permissions(), fs::perms(0664));
}

TEST_F(OutFileTest, target_of_standard_output_is_not_replaced_under_it) {
  const std::string path = file("log");
  std::ofstream(path) << "kept\n";
  const pid_t child = ::fork();
  if (child == 0) {
    // slabctl ... --out log >> log
    const int log = ::open(path.c_str(), O_WRONLY | O_APPEND);
    ::dup2(log, STDOUT_FILENO);
    const bool good = put(path, "figures\n").ok() && ::write(STDOUT_FILENO, "after\n", 6) == 6;
    ::_exit(good ? 0 : 1);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(content(path), "kept\nfigures\nafter\n");
}

TEST_F(OutFileTest, rewritten_output_does_not_go_to_a_file_that_others_also_write) {
  const std::string path = file("log");
  std::ofstream(path) << "kept\n";
  const pid_t child = ::fork();
  if (child == 0) {
    const int log = ::open(path.c_str(), O_WRONLY | O_APPEND);
    ::dup2(log, STDOUT_FILENO);
    bool refused = true;
    for (const std::string& out : {std::string("-"), std::string("/dev/stdout"), path})
      refused = refused && !put(out, "figures\n", {.rewritten = true}).ok();
    ::_exit(refused ? 0 : 1);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(content(path), "kept\n");
  EXPECT_TRUE(put(file("new"), "x", {.rewritten = true}));
  EXPECT_TRUE(put(file("new"), "x", {.rewritten = true})) << "one that is replaced";
}

TEST_F(Export, failed_write_to_standard_output_is_reported_once) {
  store_slab();
  for (const char* slabs : {"--all", "--verdict pass"}) {  // larger and smaller than the output buffer
    const std::string command =
        places::slabctl() + " export " + slabs + " --db " + db() + " >/dev/full 2>" + file("full");
    const int status = std::system(command.c_str());
    EXPECT_EQ(WEXITSTATUS(status), 3) << slabs;
    EXPECT_EQ(content(file("full")), "slabctl: - cannot be written: No space left on device\n");
  }
}

TEST_F(Export, a_cloud_is_not_written_where_it_cannot_be_whole) {
  store_slab();
  const std::string cloud = "export cloud 1 --block 3 --db " + db() + recipes() + " --out ";
  for (const char* out : {"-", "/dev/stdout"}) {
    const Ended ended = run(cloud + out);
    EXPECT_EQ(ended.status, 3) << out;
    EXPECT_EQ(ended.out, "");
    expect_mentions(ended.err, std::string(out == std::string("-") ? "standard output" : out) +
                                   " cannot be written: it must be a separate file, because its head is written last");
  }
}

TEST_F(Export, reports_metrics_and_tables_go_through_a_link_and_into_a_pipe) {
  store_slab();
  fs::create_directory(file("kept"));
  fs::create_symlink("kept/figures.prom", file("slabd.prom"));
  fs::create_symlink("kept/report.html", file("report.html"));
  fs::create_symlink("kept/report.png", file("report.png"));
  EXPECT_EQ(run("metrics --socket " + file("none.sock") + " --out " + file("slabd.prom")).status, 4);
  expect_mentions(content(file("kept/figures.prom")), "slabd_up 0");
  ASSERT_EQ(run("report 1 --db " + db() + " --out " + file("report.html")).status, 0);
  ASSERT_EQ(run("report 1 --db " + db() + " --page 1 --out " + file("report.png")).status, 0);
  expect_mentions(content(file("kept/report.html")), "</html>");
  EXPECT_EQ(content(file("kept/report.png")).substr(1, 3), "PNG");
  for (const char* name : {"slabd.prom", "report.html", "report.png"}) EXPECT_TRUE(fs::is_symlink(file(name))) << name;

  ASSERT_EQ(run("export 1 --db " + db() + " --format csv --out " + file("table.csv")).status, 0);
  ASSERT_EQ(::mkfifo(file("pipe").c_str(), 0600), 0);
  const std::string reader = "timeout 60 cat " + file("pipe") + " > " + file("piped.csv") + " &";
  ASSERT_EQ(std::system(reader.c_str()), 0);
  ASSERT_EQ(run("export 1 --db " + db() + " --format csv --out " + file("pipe")).status, 0);
  for (int i = 0; i < 6'000 && content(file("piped.csv")).size() < fs::file_size(file("table.csv")); ++i)
    ::usleep(10'000);
  EXPECT_EQ(content(file("piped.csv")), content(file("table.csv")));
  EXPECT_TRUE(fs::is_fifo(file("pipe")));
}

TEST(OutFile, a_size_limit_is_reported_and_leaves_nothing) {
  const fs::path folder = fs::temp_directory_path() / ("slabd-limit-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const pid_t child = ::fork();
  if (child == 0) {
    const rlimit limit{10'000, 10'000};
    if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) ::_exit(9);
    OutFile out((folder / "cloud.ply").string());
    out.write(std::string(1'000'000, 'x'));
    const Status status = out.close();
    ::_exit(!status.ok() && status.error().text.view().find("File too large") != std::string_view::npos ? 0 : 1);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  EXPECT_TRUE(fs::is_empty(folder));
  fs::remove_all(folder);
}

TEST(OutFile, a_signal_leaves_neither_the_file_nor_its_beginning) {
  const fs::path folder = fs::temp_directory_path() / ("slabd-out-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const std::string path = (folder / "cloud.ply").string();
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    std::ofstream(path) << "of before";
    const pid_t child = ::fork();
    if (child == 0) {
      OutFile out(path);
      out.write(std::string(1'000'000, 'x'));
      ::raise(number);
      ::_exit(0);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == number) << "it ends as it would have";
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1);
    std::ifstream in(path);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), "of before");
  }
  fs::remove_all(folder);
}

}  // namespace
}  // namespace slabd::cli
