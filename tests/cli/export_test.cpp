// SPDX-License-Identifier: Apache-2.0
//
// slabctl export: what it writes is read by readers that know nothing of slabd (tests/cli/read_exports.py), and every
// JSON document is held against its published schema by an independent validator (tests/cli/validate_json.py).
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/export/out_file.h"
#include "tests/cli/stored_slab.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

struct Export : StoredSlab {
  /// Three blocks; with a name that a table must put in quotes.
  void store_slab() {
    header_.slab_id = "A, \"42\"";
    begin();
    measure(3);
    measure(4, "--defect jaw-distance=4:0.9");
    measure(12);
    end();
  }
  [[nodiscard]] Ended python(const std::string& arguments) const {
    const int status = std::system(("/usr/bin/python3 " + std::string(SLABD_SOURCE_DIR) + "/tests/cli/" + arguments +
                                    " >" + file("py.out") + " 2>" + file("py.err"))
                                       .c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, content(file("py.out")), content(file("py.err"))};
  }
  [[nodiscard]] json read(const std::string& kind, const std::string& path) const {
    const Ended ended = python("read_exports.py " + kind + " " + path);
    EXPECT_EQ(ended.status, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }
  [[nodiscard]] std::string recipes() const { return " --recipes " + std::string(SLABD_SOURCE_DIR) + "/recipes"; }
};

TEST_F(Export, a_table_has_one_row_for_each_item_and_reads_as_rfc_4180) {
  store_slab();
  const Ended ended = run("export --all --bom --db " + db() + " --out " + file("items.csv"));
  ASSERT_EQ(ended.status, 0) << ended.err;
  const json table = read("csv", file("items.csv"));
  EXPECT_TRUE(table["bom"]);
  EXPECT_EQ(table["columns"].size(), 34U);
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
  // An item that was not measured has no value, and none is 0.
  for (const json& row : table["rows"]) EXPECT_TRUE(row["verdict"] != "not_measured" || row["value"] == "") << row;
  EXPECT_EQ(run("export 1 --db " + db()).out, content(file("items.csv")).substr(3));
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
  const json all = json::parse(run("export --since 2025-11-20 --type 5600 --format json --db " + db()).out);
  EXPECT_EQ(all["schema"], "slabd.export/1");
  ASSERT_EQ(all["slabs"].size(), 1U);
  EXPECT_EQ(all["slabs"][0], json::parse(run("export 1 --format json --db " + db()).out));
  EXPECT_TRUE(json::parse(run("export --until 2025-11-20 --format json --db " + db()).out)["slabs"].empty());
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
  expect_mentions(slab.err, "left out: block 1: there is no scan of it");
  const json of_slab = read("cloud", file("slab.ply"));
  EXPECT_EQ(of_slab["stations"], (json{3, 4, 12}));
  EXPECT_LT(of_slab["points"], 200'000);
  // Stations 3 and 4 lie at y = 758, station 12 across: x = -2520 + 630 (i - 1), heights from the slab's top to a
  // shoulder.
  EXPECT_NEAR(of_slab["low"][0].get<double>(), -1260.0 - 170.0, 120.0);
  EXPECT_NEAR(of_slab["low"][1].get<double>(), -758.0 - 270.0, 120.0);
  EXPECT_NEAR(of_slab["high"][1].get<double>(), 758.0 + 270.0, 120.0);
  EXPECT_NEAR(of_slab["low"][2].get<double>(), 0.0, 5.0);
  EXPECT_NEAR(of_slab["high"][2].get<double>(), 60.0, 5.0);

  EXPECT_EQ(run("export cloud 1 --block 7 --out " + file("x.ply") + " --db " + db() + recipes()).status, 3);
  EXPECT_FALSE(fs::exists(file("x.ply")));
  EXPECT_FALSE(fs::exists(file("x.ply.part")));
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
    // About 210 x 490 mm and 30 mm high, shoulders more, bores less.
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

TEST_F(Export, every_json_document_is_what_its_published_schema_says) {
  store_slab();
  const std::string recipes_dir = std::string(SLABD_SOURCE_DIR) + "/recipes";
  const std::string config =
      write("slabd.toml", "[plc]\nlisten = \"127.0.0.1:1502\"\n[recipes]\ndir = \"" + recipes_dir +
                              "\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[storage]\ndb = \"" + db() +
                              "\"\nspool_dir = \"" + file("spool") +
                              "\"\n[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n"
                              "station_sigma_mm = 0.02\nstation_sigma_deg = 0.001\n");
  const std::string other = recipes_dir + "/p4925.toml";
  ASSERT_EQ(simulate_scan("none.ply", "--defect missing=3").status, 0);
  ASSERT_EQ(run("simulate plane --out " + file("plane.xyz")).status, 0);
  const std::string in_db = " --db " + db();
  std::string documents;
  int count = 0;
  for (const std::string& command : {"show 1" + in_db,
                                     "show 1 --block 4" + in_db,
                                     "history" + in_db,
                                     "trend jaw_distance" + in_db,
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
                                     "inspect " + scan(3) + " --block 3 --recipe " + kRecipe,
                                     "inspect " + file("none.ply") + " --block 3 --recipe " + kRecipe,
                                     "fit-plane " + file("plane.xyz"),
                                     "fit-plane " + file("plane.xyz") + " --compare --threshold 0.03 --set 1 2 1",
                                     std::string("plc map"),
                                     std::string("plc codes"),
                                     "stations --config " + config}) {
    const Ended ended = run(command + " --json");
    EXPECT_FALSE(ended.out.empty()) << command << ended.err;
    documents += " " + write("document-" + std::to_string(++count) + ".json", ended.out);
  }
  for (const std::string& command : {"export 1" + in_db, "export --all" + in_db})
    documents += " " + write("document-" + std::to_string(++count) + ".json", run(command + " --format json").out);
  const Ended valid = python("validate_json.py " + std::string(SLABD_SOURCE_DIR) + "/docs/schemas" + documents);
  EXPECT_EQ(valid.status, 0) << valid.out << valid.err;
  expect_mentions(valid.out, "24 documents, 0 faults");
}

TEST_F(Export, the_validator_finds_a_key_too_many_and_a_wrong_type) {
  const std::string good = run("plc codes --json").out;
  json document = json::parse(good);
  const std::string schemas = std::string(SLABD_SOURCE_DIR) + "/docs/schemas ";
  EXPECT_EQ(python("validate_json.py " + schemas + write("good.json", good)).status, 0);
  document["more"] = 1;
  EXPECT_EQ(python("validate_json.py " + schemas + write("more.json", document.dump())).status, 1);
  document.erase("more");
  document["schema"] = "slabd.plc_codes/2";
  EXPECT_EQ(python("validate_json.py " + schemas + write("version.json", document.dump())).status, 1);
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
