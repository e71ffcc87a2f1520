// SPDX-License-Identifier: Apache-2.0
//
// slabctl as a process: exit status, stdout and stderr.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

const std::string kRecipe = std::string(SLABD_SOURCE_DIR) + "/recipes/p5600.toml";

struct Ended {
  int status = -1;
  std::string out;
  std::string err;
};

std::string content(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class Slabctl : public ::testing::Test {
 protected:
  Slabctl() {
    std::string pattern = (fs::temp_directory_path() / "slabctl-test-XXXXXX").string();
    dir_ = mkdtemp(pattern.data());
  }
  ~Slabctl() override { fs::remove_all(dir_); }

  [[nodiscard]] std::string file(const std::string& name) const { return (dir_ / name).string(); }
  [[nodiscard]] std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(file(name), std::ios::binary) << text;
    return file(name);
  }
  /// Runs `slabctl arguments` through the shell.
  [[nodiscard]] Ended run(const std::string& arguments) const {
    const std::string command = std::string(SLABCTL) + " " + arguments + " >" + file("out") + " 2>" + file("err");
    Ended ended;
    const int status = std::system(command.c_str());
    ended.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    ended.out = content(file("out"));
    ended.err = content(file("err"));
    return ended;
  }
  [[nodiscard]] Ended simulate_scan(const std::string& out, const std::string& more) const {
    return run("simulate scan --points quarter --recipe " + kRecipe + " --block 3 --out " + file(out) + " " + more);
  }

  fs::path dir_;
};

void expect_mentions(const std::string& text, const std::string& words) {
  EXPECT_NE(text.find(words), std::string::npos) << "expected '" << words << "' in:\n" << text;
}

TEST_F(Slabctl, version_and_help_are_done) {
  const Ended version = run("--version");
  EXPECT_EQ(version.status, 0);
  expect_mentions(version.out, "slabd ");
  for (const char* command : {"", "inspect", "status", "history", "show", "simulate", "simulate scan", "config check",
                              "recipe check", "recipe show"}) {
    const Ended help = run(std::string(command) + " --help");
    EXPECT_EQ(help.status, 0) << command;
    expect_mentions(help.out, "Usage");
  }
}

TEST_F(Slabctl, wrong_use_is_status_2_and_says_what_was_meant) {
  EXPECT_EQ(run("").status, 2);
  const Ended typo = run("simulat");
  EXPECT_EQ(typo.status, 2);
  expect_mentions(typo.err, "did you mean 'simulate'?");
  EXPECT_EQ(run("inspect").status, 2);
  EXPECT_EQ(run("--no-such-option").status, 2);
  EXPECT_EQ(run("status --config a --socket b").status, 2);
  EXPECT_EQ(run("config").status, 2);
  const Ended unit = run("inspect x.ply --recipe y.toml --block 1 --unit inch");
  EXPECT_EQ(unit.status, 2);
  EXPECT_EQ(unit.out, "");
}

TEST_F(Slabctl, missing_and_broken_files_are_status_3_and_named) {
  EXPECT_EQ(run("recipe check " + file("none.toml")).status, 3);
  const std::string broken = write("broken.toml", "schema = \"slabd.recipe/1\"\nname = [\n");
  const Ended recipe = run("recipe check " + broken);
  EXPECT_EQ(recipe.status, 3);
  expect_mentions(recipe.err, "broken.toml:");
  const Ended config = run("config check " + write("slabd.toml", "[plc]\nliste = \"127.0.0.1:1502\"\n"));
  EXPECT_EQ(config.status, 3);
  expect_mentions(config.err, "slabd.toml:");
  expect_mentions(config.err, "listen");

  const Ended scan =
      run("inspect " + write("scan.ply", "ply\nformat ascii 9.9\n") + " --recipe " + kRecipe + " --block 3");
  EXPECT_EQ(scan.status, 3);
  expect_mentions(scan.err, "scan.ply");
  EXPECT_EQ(run("inspect " + file("none.ply") + " --recipe " + kRecipe + " --block 3").status, 3);
}

TEST_F(Slabctl, block_outside_the_recipe_is_refused_with_the_range) {
  for (const char* block : {"0", "19", "-1"}) {
    const Ended ended = run("inspect " + file("scan.ply") + " --recipe " + kRecipe + " --block " + block);
    EXPECT_EQ(ended.status, 2) << block;
    expect_mentions(ended.err, "1..18");
  }
}

TEST_F(Slabctl, bad_pose_and_bad_defect_are_wrong_use) {
  const Ended pose = run("inspect x.ply --recipe " + kRecipe + " --block 3 --T-block-scanner '0 0 600 0 0 0 0'");
  EXPECT_EQ(pose.status, 2);
  expect_mentions(pose.err, "--T-block-scanner");
  const Ended defect = simulate_scan("scan.ply", "--defect slope=3:5");
  EXPECT_EQ(defect.status, 2);
  expect_mentions(defect.err, "20..200");
  EXPECT_FALSE(fs::exists(file("scan.ply")));
}

TEST_F(Slabctl, unreachable_daemon_and_database_are_status_4) {
  const Ended status = run("status --socket " + file("control.sock"));
  EXPECT_EQ(status.status, 4);
  expect_mentions(status.err, "control.sock");
  EXPECT_EQ(status.out, "");
  EXPECT_EQ(run("history --db " + file("none.db")).status, 4);
  EXPECT_EQ(run("show 1 --db " + file("none.db")).status, 4);
  EXPECT_FALSE(fs::exists(file("none.db"))) << "a reading command must not make a database";
}

TEST_F(Slabctl, recipe_show_gives_every_nominal_with_its_confirmation) {
  const Ended shown = run("recipe show --json " + kRecipe);
  ASSERT_EQ(shown.status, 0);
  const json document = json::parse(shown.out);
  EXPECT_EQ(document["schema"], "slabd.recipe/1");
  EXPECT_EQ(document["slab_type"], 5600);
  EXPECT_NEAR(document["nominals"]["block.jaw_angle_deg"]["value"].get<double>(), 110.0, 1e-9);
  EXPECT_EQ(document["nominals"]["block.cant_ratio"]["confirmed"], true);
  EXPECT_EQ(document["items"].size(), 18U);
  expect_mentions(shown.err, "assumed");
}

TEST_F(Slabctl, simulated_scan_is_measured_as_planted) {
  ASSERT_EQ(simulate_scan("scan.ply", "--seed 7 --defect jaw-distance=3:-0.9 --defect protrusion-outer=3:0.1").status,
            0);
  const json truth = json::parse(content(file("scan.json")));
  EXPECT_EQ(truth["T_scanner_block"].size(), 4U);
  const Ended ended = run("inspect " + file("scan.ply") + " --json --recipe " + kRecipe + " --block 3");
  EXPECT_EQ(ended.status, 1) << "the jaw distance is out of tolerance";
  const json document = json::parse(ended.out);

  EXPECT_EQ(document["verdict"], "fail");
  EXPECT_EQ(document["reason"], 604);
  EXPECT_EQ(document["registration"]["status"], "converged");
  for (const char* key : {"points_read", "points_finite", "isolated_removed", "points_kept"})
    EXPECT_GT(document["scan"][key].get<double>(), 0.0) << key;
  EXPECT_EQ(document["scan"]["points_finite"], truth["valid"]);
  for (const char* key : {"count", "mean_mm", "std_mm"})
    EXPECT_TRUE(document["registration"]["deviation"][key].is_number()) << key;
  EXPECT_EQ(document["registration"]["deviation"]["within_sigma"].size(), 6U);
  for (const char* key : {"points", "grid_points", "inlier_fraction", "std_mm", "flatness_mm", "flatness_min_zone_mm"})
    EXPECT_TRUE(document["features"]["seat"][key].is_number()) << key;
  for (const char* key : {"read", "denoise", "register", "extract", "total"})
    EXPECT_TRUE(document["timing_ms"][key].is_number()) << key;

  const std::map<std::string, const char*> truth_key = {{"seat_slope", "slope_deg"},
                                                        {"jaw_angle_inner", "jaw_angle_in"},
                                                        {"jaw_angle_outer", "jaw_angle_out"},
                                                        {"jaw_distance", "jaw_distance"},
                                                        {"casing_spacing", "casing_spacing"},
                                                        {"casing_protrusion_inner", "protrusion_in"},
                                                        {"casing_protrusion_outer", "protrusion_out"}};
  std::size_t compared = 0;
  for (const json& item : document["items"]) {
    EXPECT_FALSE(item.contains("stations"));
    const auto found = truth_key.find(item["id"].get<std::string>());
    if (found == truth_key.end()) continue;
    ++compared;
    ASSERT_TRUE(item["value"].is_number()) << found->first;
    const double allowed = item["unit"] == "deg" ? 0.01 : 0.05;
    EXPECT_NEAR(item["value"].get<double>(), truth[found->second].get<double>(), allowed) << found->first;
    EXPECT_NEAR(item["deviation"].get<double>(), item["value"].get<double>() - item["nominal"].get<double>(), 1e-9);
  }
  EXPECT_EQ(compared, truth_key.size());

  const json& normal = document["features"]["seat"]["normal"];
  EXPECT_NEAR(normal[1].get<double>(), -std::sin(truth["slope_deg"].get<double>() * 3.14159265358979 / 180.0), 2e-4);
}

TEST_F(Slabctl, missing_block_is_not_measured_and_not_a_pass) {
  ASSERT_EQ(simulate_scan("scan.ply", "--defect missing=3").status, 0);
  const Ended ended = run("inspect " + file("scan.ply") + " --json --recipe " + kRecipe + " --block 3");
  EXPECT_EQ(ended.status, 1);
  const json document = json::parse(ended.out);
  EXPECT_EQ(document["verdict"], "not_measured");
  for (const json& item : document["items"]) EXPECT_TRUE(item["value"].is_null()) << item["id"];
}

TEST_F(Slabctl, good_block_passes_with_status_0_and_a_readable_table) {
  ASSERT_EQ(simulate_scan("scan.ply", "--casting 0 --unorganised").status, 0);
  const Ended ended = run("inspect " + file("scan.ply") + " --recipe " + kRecipe + " --block 3");
  EXPECT_EQ(ended.status, 0) << ended.out << ended.err;
  expect_mentions(ended.out, "seat_slope [deg]");
  expect_mentions(ended.out, "not visible to the block scans");
  EXPECT_EQ(ended.out.find('\x1b'), std::string::npos) << "no colour where there is no terminal";
  expect_mentions(ended.err, "assumed, not confirmed");
}

}  // namespace
