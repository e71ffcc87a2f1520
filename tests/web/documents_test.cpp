// SPDX-License-Identifier: Apache-2.0
//
// Documents of slabd-web: they are what slabctl prints, and match their published schemas.
#include <fstream>

#include "tests/web/web_process.h"
#include "web/routes.h"

namespace slabd::web {
namespace {

struct WebDocuments : WebProcess {
  /// Validates documents with the published schemas, by an independent validator.
  void validate(const std::vector<std::string>& documents) const {
    std::string paths;
    for (std::size_t i = 0; i < documents.size(); ++i)
      paths += " " + write("document-" + std::to_string(i) + ".json", documents[i]);
    const int status = std::system(("/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py " +
                                    places::source_dir() + "/docs/schemas" + paths + " >" + file("validated") + " 2>&1")
                                       .c_str());
    EXPECT_EQ(status, 0) << cli::content(file("validated"));
  }

  /// Writes list and picture of a draft as slabctl recipe from-cad does.
  void store_draft() const {
    fs::create_directories(file("recipes") + "/drafts");
    std::ofstream(file("recipes/drafts/p4925.json")) << json{
        {"schema", "slabd.cad_draft/1"},
        {"file", "slab <b>.stp"},
        {"sha256", std::string(64, 'a')},
        {"unit", "mm"},
        {"solids", 1},
        {"faces", 9},
        {"blocks", 1},
        {"reference_height_mm", 10.0},
        {"confined", true},
        {"draft", "p4925.toml"},
        {"picture", "p4925.png"},
        {"found", {{{"key", "block.cant_ratio"}, {"value", 40.0}, {"faces", {3, 7}}, {"note", "one seat"}}}},
        {"not_found", {{{"key", "slab"}, {"why", "one block"}}}},
        {"remarks", json::array({"a casing is missing"})},
        {"named_faces", {{{"name", "seat"}, {"face", 3}}}}}.dump();
    std::ofstream(file("recipes/drafts/p4925.png"), std::ios::binary) << kPicture;
  }
  const std::string kPicture = std::string("\x89PNG\r\n\x1a\n") + std::string(3, '\0') + "data";
};

TEST_F(WebDocuments, every_route_matches_its_schema) {
  header_.slab_id = "A, \"42\" <img>";
  begin();
  measure(3);
  measure(4, "--defect jaw-distance=4:0.9");
  end();
  store_draft();
  start();
  std::vector<std::string> documents;
  for (const Route& route : routes()) {
    if (route.maker == Maker::report) continue;
    std::string target(route.path);
    for (const auto& [mark, value] : {std::pair{"{key}", "1"}, std::pair{"{block}", "3"},
                                      std::pair{"{item}", "seat_slope"}, std::pair{"{draft}", "p4925"}})
      if (const std::size_t at = target.find(mark); at != std::string::npos)
        target.replace(at, std::string_view(mark).size(), value);
    if (route.maker == Maker::plant) {
      cli::expect_mentions(refused(get(target + (target.ends_with("slab") ? "?id=A" : "")), 404),
                           "no plant's database");
      continue;
    }
    if (target == "/api/v1/compare") target += "?a=1&b=1";
    if (target == "/api/v1/words") target += "?language=zh";
    const Reply reply = get(target);
    EXPECT_EQ(reply.status, 200) << target << ": " << reply.body;
    EXPECT_EQ(reply.field("content-type"), "application/json") << target;
    EXPECT_EQ(json::parse(reply.body, nullptr, false).value("schema", ""), route.schema) << target;
    documents.push_back(reply.body);
  }
  documents.push_back(get("/api/v1/slabs/1/blocks/7/map").body);  // never scanned
  documents.push_back(get("/api/v1/slabs/9").body);               // an error
  validate(documents);
  cli::expect_mentions(refused(get("/api/v1/slabs/1/blocks/7/cloud"), 404), "it was not measured");
  fs::remove(scan(4));
  cli::expect_mentions(refused(get("/api/v1/slabs/1/blocks/4/cloud"), 404), "its scan is gone");
}

TEST_F(WebDocuments, are_what_slabctl_prints) {
  begin();
  measure(3);
  end();
  start();
  const std::string more = " --config " + config();
  EXPECT_EQ(get("/api/v1/slabs/1").body, run("show key:1 --json" + more).out);
  EXPECT_EQ(get("/api/v1/slabs?limit=3").body, run("history --limit 3 --json" + more).out);
  const json map = document("/api/v1/slabs/1/map");
  EXPECT_EQ(map["verdict"], "not_measured");
  ASSERT_EQ(map["blocks"].size(), 18U);
  EXPECT_EQ(map["blocks"][2]["attempts"], 1);
  EXPECT_EQ(map["blocks"][2]["scan_kept"], true);
  EXPECT_EQ(map["blocks"][3]["attempts"], 0);
  EXPECT_EQ(map["blocks"][3]["scan_kept"], false);
  EXPECT_FALSE(map["findings"].empty());
  EXPECT_NE(document("/api/v1/slabs/1/map?language=zh")["findings"], map["findings"]);
  EXPECT_EQ(get("/api/v1/yield?by=day").body, run("yield --by day --json" + more).out);
  EXPECT_EQ(get("/api/v1/yield?by=day&language=zh").body, run("yield --by day --json --language zh" + more).out);
  EXPECT_NE(get("/api/v1/yield?by=day&language=zh").body, get("/api/v1/yield?by=day").body);

  const json maps = document("/api/v1/slabs/1/blocks/3/map");
  const json& deviation = maps["deviation"];
  ASSERT_TRUE(deviation.is_object());
  const std::size_t cells = deviation["columns"].get<std::size_t>() * deviation["rows"].get<std::size_t>();
  ASSERT_EQ(deviation["values_mm"].size(), cells);
  std::size_t seen = 0;
  double largest = 0.0;
  for (const json& value : deviation["values_mm"])
    if (!value.is_null()) {
      ++seen;
      largest = std::max(largest, std::abs(value.get<double>()));
    }
  EXPECT_GT(seen, cells / 3);
  EXPECT_LT(largest, 5.0);
  EXPECT_NEAR(deviation["origin_mm"][0].get<double>(),
              -0.5 * (deviation["columns"].get<double>() - 1.0) * deviation["cell_mm"].get<double>(), 1e-9);
  EXPECT_TRUE(maps["seat"].is_object());
  EXPECT_TRUE(document("/api/v1/slabs/1/blocks/4/map")["deviation"].is_null());
}

TEST_F(WebDocuments, a_draft_of_a_recipe_comes_with_its_picture) {
  store_draft();
  std::ofstream(file("recipes/drafts/other.json")) << "{\"schema\": \"slabd.slab/1\"}";
  std::ofstream(file("recipes/drafts/a b.json")) << "{}";
  start();
  const json list = document("/api/v1/drafts");
  ASSERT_EQ(list["drafts"].size(), 1U);
  EXPECT_EQ(list["drafts"][0]["name"], "p4925");
  EXPECT_EQ(list["drafts"][0]["found"], 1);
  EXPECT_EQ(list["drafts"][0]["not_found"], 1);
  ASSERT_EQ(list["passed_over"].size(), 2U);
  EXPECT_EQ(list["passed_over"][0]["file"], "a b.json");
  EXPECT_EQ(list["passed_over"][1]["file"], "other.json");
  EXPECT_EQ(document("/api/v1/drafts/p4925")["found"][0]["value"], 40.0);
  const Reply picture = get("/api/v1/drafts/p4925/picture.png");
  ASSERT_EQ(picture.status, 200) << picture.body;
  EXPECT_EQ(picture.field("content-type"), "image/png");
  EXPECT_EQ(picture.body, kPicture);
  cli::expect_mentions(refused(get("/api/v1/drafts/none"), 404), "no draft none");
  cli::expect_mentions(refused(get("/api/v1/drafts/none/picture.png"), 404), "no draft none");
  EXPECT_GE(get("/api/v1/drafts/other").status, 400);
  std::ofstream(file("recipes/drafts/p4925.png"), std::ios::binary) << "<svg onload=alert(1)>";
  std::ofstream(file("recipes/drafts/p5600.json")) << line::read_file(file("recipes/drafts/p4925.json"));
  cli::expect_mentions(refused(get("/api/v1/drafts/p5600/picture.png"), 404), "p5600.png");
}

TEST_F(WebDocuments, a_report_is_a_pdf) {
  store_slab();
  start();
  const Reply reply = get("/api/v1/slabs/1/report.pdf?language=zh");
  ASSERT_EQ(reply.status, 200) << reply.body;
  EXPECT_EQ(reply.field("content-type"), "application/pdf");
  EXPECT_TRUE(reply.body.starts_with("%PDF-")) << reply.body.substr(0, 20);
  EXPECT_EQ(reply.field("content-length"), std::to_string(reply.body.size()));
}

TEST_F(WebDocuments, errors_name_the_cause_and_the_cure) {
  store_slab();
  start();
  cli::expect_mentions(refused(get("/api/v1/slabs/9"), 404), "no slab with key");
  cli::expect_mentions(refused(get("/api/v1/slabs?color=red"), 400), "'color'");
  cli::expect_mentions(refused(get("/api/v1/slabs?since=9"), 400), "'since'");
  cli::expect_mentions(refused(get("/api/v1/slabs?since=99-99"), 400), "--since");
  cli::expect_mentions(refused(get("/api/v1/slabs?item=nothing"), 400), "no item 'nothing'");
  cli::expect_mentions(refused(get("/api/v1/slabs?item=nothing", "Accept-Language: zh\r\n"), 400), "请更正参数");
  cli::expect_mentions(refused(get("/api/v1/slabs?item=nothing", "Accept-Language: en,zh\r\n"), 400), "correct");
  cli::expect_mentions(refused(get("/api/v1/nothing"), 404), "docs/WEB.md");
  fs::remove(db());
  cli::expect_mentions(refused(get("/api/v1/slabs?limit=7"), 503), "there is no database");
  EXPECT_EQ(get("/healthz").body, "ok\n");
}

TEST_F(WebDocuments, without_slabd_the_status_is_unreachable_and_shows_the_last_slab) {
  store_slab();
  start();
  json status;
  for (int i = 0; i < 1'000; ++i) {
    status = document("/api/v1/status");
    if (!status["map"].is_null()) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  EXPECT_EQ(status["reachable"], false);
  EXPECT_TRUE(status["age_ms"].is_null());
  EXPECT_TRUE(status["status"].is_null());
  cli::expect_mentions(status["trouble"], "slabd does not answer on " + socket());
  EXPECT_EQ(status["map"]["key"], 1);
  ASSERT_EQ(status["last"].size(), 1U);
  EXPECT_EQ(status["slabd_web"]["language"], "en");
  cli::expect_mentions(document("/api/v1/status?language=zh")["trouble"], "slabd 在 " + socket() + " 上没有应答");
}

}  // namespace
}  // namespace slabd::web
