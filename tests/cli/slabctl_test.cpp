// SPDX-License-Identifier: Apache-2.0
//
// slabctl as a process: exit status, stdout and stderr.
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>

#include "base/limits.h"
#include "base/pose.h"
#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

TEST_F(Slabctl, version_and_help_are_done) {
  const Ended version = run("--version");
  EXPECT_EQ(version.status, 0);
  EXPECT_TRUE(std::regex_match(version.out, std::regex(R"(slabd \d+\.\d+\.\d+\+(unknown|g[0-9a-f]{7,}(\.dirty)?)\n)")))
      << version.out;
  for (const char* command : {"", "inspect", "fit-plane", "status", "history", "show", "simulate", "simulate scan",
                              "simulate plane", "config check", "recipe check", "recipe show"}) {
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

TEST_F(Slabctl, help_comes_before_or_after_the_command) {
  EXPECT_EQ(run("help").out, run("--help").out);
  for (const char* command : {"show", "simulate scan", "calibrate"}) {
    const Ended help = run("help " + std::string(command));
    EXPECT_EQ(help.status, 0);
    EXPECT_EQ(help.out, run(std::string(command) + " --help").out);
  }
  const Ended unknown = run("help shwo");
  EXPECT_EQ(unknown.status, 2);
  expect_mentions(unknown.err, "did you mean 'show'?");
}

TEST_F(Slabctl, surplus_arguments_are_named_in_their_order_with_the_nearest_option) {
  const Ended words = run("status first second");
  EXPECT_EQ(words.status, 2);
  EXPECT_NE(words.err.find("not expected: 'first', 'second'"), std::string::npos) << words.err;
  const Ended option = run("report 1 --out x.pdf --languge=zh");
  EXPECT_EQ(option.status, 2);
  EXPECT_NE(option.err.find("'--languge=zh' (did you mean '--language'?)"), std::string::npos) << option.err;
  EXPECT_NE(option.err.find("`slabctl report --help`"), std::string::npos) << option.err;
  const Ended command = run("db chekc");
  EXPECT_EQ(command.status, 2);
  EXPECT_NE(command.err.find("did you mean 'check'?"), std::string::npos) << command.err;
}

TEST_F(Slabctl, slips_are_answered_with_the_right_command) {
  const std::string recipe = places::source_dir() + "/recipes/p5600.toml";
  const std::pair<const char*, const char*> slips[] = {
      {"--json history", "options come after the command: slabctl history --json"},
      {"show", "slabctl show needs a slab: slabctl show SLAB, a key or an id; `slabctl history` lists them"},
      {"show 2 -b 3", "not expected: '-b' (did you mean '--block'?), '3'"},
      {"show 2 --block 19", "--block: found 19, allowed is 1 to 18"},
      {"db", "slabctl db needs a command: "},
      {"status --json --watch", "cannot be given together"},
      {"history --verdict FAIL",
       "found FAIL, allowed is pass, fail, not_measured, aborted, indeterminate; did you mean fail?"},
      {"history --item slope", "did you mean 'seat_slope'?"},
      {"history --since 7d --until 14d", "--since 7d is not before --until 14d"}};
  for (const auto& [command, answer] : slips) {
    const Ended ended = run(command);
    EXPECT_EQ(ended.status, 2) << command;
    expect_mentions(ended.err, answer);
  }
  expect_mentions(run("help show --block").out, "Usage");
  EXPECT_EQ(run("metrics --zzzzzz").err.find("did you mean"), std::string::npos) << "nothing is near";
  const Ended other = run("history --db " + recipe);
  EXPECT_EQ(other.status, 3);
  expect_mentions(other.err, "p5600.toml is not a database of slabd");
}

TEST_F(Slabctl, the_word_of_another_command_for_the_same_option_is_accepted_with_a_hint) {
  const Ended ended = run("trend seat_slope --type=5600 --db " + file("none.db"));
  expect_mentions(ended.err, "hint: this command's --type is --slab-type");
  EXPECT_EQ(ended.status, run("trend seat_slope --slab-type 5600 --db " + file("none.db")).status);
  EXPECT_EQ(run("inspect --why x").status, 2) << "the command has no such option under any name";
}

TEST_F(Slabctl, configuration_is_named_before_or_after_the_command_or_by_the_environment) {
  const std::string config = write("named.toml", "nonsense = 1\n");
  const Ended after = run("doctor --config " + config);
  EXPECT_NE(after.out.find("named.toml:1"), std::string::npos) << after.out << after.err;
  EXPECT_EQ(run("--config " + config + " doctor").out, after.out);
  EXPECT_EQ(run("--config=" + config + " doctor").out, after.out);
  ASSERT_EQ(::setenv("SLABD_CONFIG", config.c_str(), 1), 0);
  const Ended by_environment = run("doctor");
  ASSERT_EQ(::unsetenv("SLABD_CONFIG"), 0);
  EXPECT_EQ(by_environment.out, after.out);
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

TEST_F(Slabctl, perspective_scan_with_correlated_noise_is_described_in_its_truth_and_is_measured) {
  const Ended drawn = simulate_scan(
      "far.ply", "--perspective --noise-correlation-mm 0.8 --noise-shape exponential --defect chip=3:0.5");
  ASSERT_EQ(drawn.status, 0) << drawn.err;
  std::ifstream file_in(file("far.json"));
  const json truth = json::parse(file_in);
  EXPECT_EQ(truth["perspective"], true);
  EXPECT_EQ(truth["noise_correlation"], 0.8);
  EXPECT_EQ(truth["chip"], 0.5);
  EXPECT_TRUE(truth["glove"].is_null());
  EXPECT_NEAR(truth["flatness"].get<double>(), 0.5, 0.01);

  const Ended measured = run("inspect " + file("far.ply") + " --recipe " + kRecipe + " --block 3 --json");
  const json block = json::parse(measured.out);
  EXPECT_EQ(block["registration"]["status"], "converged");
  for (const json& item : block["items"])
    if (item["id"] == "seat_slope") {
      EXPECT_NEAR(item["value"].get<double>(), truth["slope_deg"].get<double>(), 0.01);
    }
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

/// A stopped daemon still has a connection queue, and clients that gave up remain in it.
TEST_F(Slabctl, a_daemon_that_accepts_no_request_is_status_4_without_waiting) {
  const std::string path = file("deaf.sock");
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  ASSERT_LT(path.size(), sizeof address.sun_path);
  path.copy(address.sun_path, path.size());
  const auto* where = static_cast<const sockaddr*>(static_cast<const void*>(&address));
  const int deaf = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(::bind(deaf, where, sizeof address), 0);
  ASSERT_EQ(::listen(deaf, 0), 0);
  const int first = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(::connect(first, where, sizeof address), 0) << "fills the queue";
  ::close(first);

  const auto begin = std::chrono::steady_clock::now();
  const Ended asked = run("status --socket " + path);
  EXPECT_EQ(asked.status, 4);
  EXPECT_NE(asked.err.find("takes no question within 3 s"), std::string::npos) << asked.err;
  const Ended figures = run("metrics --socket " + path);
  EXPECT_EQ(figures.status, 4);
  EXPECT_NE(figures.out.find("\nslabd_up 0\n"), std::string::npos) << figures.out;
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
  ::close(deaf);
}

TEST_F(Slabctl, output_that_does_not_fit_on_a_full_disk_is_not_reported_as_done) {
  // Outputs larger and smaller than the buffer.
  for (const std::string& command : {"recipe show " + kRecipe + " --json", std::string("plc codes")}) {
    EXPECT_EQ(run(command).status, 0) << command;
    const int status = std::system((places::slabctl() + " " + command + " >/dev/full 2>" + file("full")).c_str());
    EXPECT_EQ(WEXITSTATUS(status), 4) << command;
    EXPECT_NE(content(file("full")).find("could not be written"), std::string::npos) << content(file("full"));
  }
  const int status = std::system((places::slabctl() + " --version >/dev/full 2>" + file("full")).c_str());
  EXPECT_EQ(WEXITSTATUS(status), 4);
}

TEST_F(Slabctl, recipe_show_gives_every_nominal_with_its_confirmation) {
  const Ended shown = run("recipe show --json " + kRecipe);
  ASSERT_EQ(shown.status, 0);
  const json document = json::parse(shown.out);
  EXPECT_EQ(document["schema"], "slabd.recipe/1");
  EXPECT_EQ(document["slab_type"], 5600);
  EXPECT_NEAR(document["nominals"]["block.jaw_angle_deg"]["value"].get<double>(), 110.0, 1e-9);
  EXPECT_EQ(document["nominals"]["block.cant_ratio"]["confirmed"], true);
  EXPECT_EQ(document["items"].size(), 20U);
  EXPECT_EQ(document["nominals"]["uncertainty.scanner_form_mm"]["value"], 0.05);
  EXPECT_EQ(document["nominals"]["uncertainty.reference_deg"]["confirmed"], false);
  EXPECT_EQ(document["uncertainty_budget"], true);
  EXPECT_EQ(document["defect_sigmas"], 5.0);
  expect_mentions(shown.err, "assumed");
  const Ended text = run("recipe show " + kRecipe);
  expect_mentions(text.out, "uncertainty.scanner_length_ppm");
  expect_mentions(text.out, "defects beyond 5 sigma");
}

TEST_F(Slabctl, inspect_names_the_assumptions_of_the_uncertainty) {
  ASSERT_EQ(simulate_scan("scan.ply", "--casting 0").status, 0);
  const Ended ended = run("inspect " + file("scan.ply") + " --recipe " + kRecipe + " --block 3");
  expect_mentions(ended.err,
                  "uncertainty.scanner_form_mm, uncertainty.scanner_form_length_mm, "
                  "uncertainty.scanner_length_ppm, uncertainty.reference_mm, uncertainty.reference_deg");
}

TEST_F(Slabctl, checks_give_their_findings_as_json) {
  const std::string broken = write("broken.toml", "schema = \"slabd.recipe/1\"\nname = [\n");
  const Ended good = run("recipe check --json " + kRecipe);
  EXPECT_EQ(good.status, 0);
  json document = json::parse(good.out);
  EXPECT_EQ(document["schema"], "slabd.check/1");
  EXPECT_EQ(document["ok"], true);
  EXPECT_EQ(document["problems"], json::array());
  ASSERT_EQ(document["recipes"].size(), 1U);
  EXPECT_EQ(document["recipes"][0]["slab_type"], 5600);
  EXPECT_GT(document["recipes"][0]["unconfirmed"].get<int>(), 0);

  const Ended mixed = run("recipe check --json " + broken + " " + kRecipe);
  EXPECT_EQ(mixed.status, 3);
  document = json::parse(mixed.out);
  EXPECT_EQ(document["ok"], false);
  EXPECT_EQ(document["files"], json::array({broken, kRecipe}));
  ASSERT_EQ(document["problems"].size(), 1U);
  expect_mentions(document["problems"][0].get<std::string>(), "broken.toml:");
  expect_mentions(mixed.err, "broken.toml:");
  EXPECT_EQ(document["recipes"].size(), 1U) << "the good one";

  const Ended shown = run("recipe show --json " + broken);
  EXPECT_EQ(shown.status, 3);
  document = json::parse(shown.out);
  EXPECT_EQ(document["schema"], "slabd.check/1");
  EXPECT_EQ(document["ok"], false);
  EXPECT_EQ(run("recipe show " + broken).out, "");

  const std::string poses =
      "[cell]\nT_base_slab = [0, 0, 0, 1, 0, 0, 0]\n[calibration]\nT_flange_scanner = [0, 0, 0, 1, 0, 0, 0]\n";
  const std::string recipes = "[recipes]\ndir = \"" + fs::path(kRecipe).parent_path().string() + "\"\n";
  const Ended config = run("config check --json " + write("good.toml", poses + recipes));
  EXPECT_EQ(config.status, 0) << config.err;
  document = json::parse(config.out);
  EXPECT_EQ(document["ok"], true);
  EXPECT_EQ(document["commissioning_calibration"], true);
  EXPECT_GT(document["recipes"].size(), 0U);

  const Ended no_recipes = run("config check --json " + write("bad.toml", poses + "[recipes]\ndir = \"none\"\n"));
  EXPECT_EQ(no_recipes.status, 3);
  EXPECT_EQ(json::parse(no_recipes.out)["ok"], false);
  const Ended no_poses = run("config check --json " + write("bad.toml", recipes));
  EXPECT_EQ(no_poses.status, 3);
  // The scanner's pose may come from an applied calibration instead; the slab's pose is only in the configuration.
  EXPECT_EQ(json::parse(no_poses.out)["problems"].size(), 1U);
}

TEST_F(Slabctl, a_scan_in_another_unit_or_frame_is_refused_with_its_extent_distance_unit_and_axes) {
  ASSERT_EQ(simulate_scan("scan.xyz", "--seed 7 --nominal-view --unorganised --perspective").status, 0);
  std::ifstream in(file("scan.xyz"));
  std::vector<Vec3> points;
  for (Vec3 p; in >> p.x() >> p.y() >> p.z();) points.push_back(p);
  ASSERT_GT(points.size(), 100'000U);
  const auto refused = [&](const auto& change) {
    std::string text;
    for (std::size_t i = 0; i < points.size(); i += 4) {
      const Vec3 p = change(points[i]);
      std::array<char, 96> line{};
      std::snprintf(line.data(), line.size(), "%.6f %.6f %.6f\n", p.x(), p.y(), p.z());
      text += line.data();
    }
    const Ended ended = run("inspect " + write("other.xyz", text) + " --recipe " + kRecipe + " --block 3");
    EXPECT_EQ(ended.status, 1);
    return ended.err;
  };
  const std::string metres = refused([](const Vec3& p) { return Vec3(p / 1000.0); });
  expect_mentions(metres, "large, 0.6");
  expect_mentions(metres, "the unit is probably metres");
  expect_mentions(refused([](const Vec3& p) { return Vec3(p / 10.0); }), "the unit is probably centimetres");
  expect_mentions(refused([](const Vec3& p) { return Vec3(p / 25.4); }), "the unit is probably inches");
  const std::string up = refused([](const Vec3& p) { return Vec3(p.x(), -p.y(), -p.z()); });
  expect_mentions(up, "away along -Z");
  expect_mentions(up, "+Z must point from the scanner to the part");
  expect_mentions(refused([](const Vec3& p) { return Vec3(p.x(), -p.y(), 600.0 - p.z()); }),
                  "it is where the block is in the block's frame");
  expect_mentions(refused([](const Vec3& p) { return Vec3(p.y(), p.x(), p.z()); }),
                  "and the block extends along Y: the two may be exchanged, or the scanner is turned");
  expect_mentions(refused([](const Vec3& p) { return Vec3(-p.x(), -p.y(), p.z()); }), "turned or other type?");
}

TEST_F(Slabctl, damage_planted_on_concrete_is_found) {
  ASSERT_EQ(simulate_scan("chip.ply", "--seed 7 --surface real --damage chip_jaw").status, 0);
  const Ended chip = run("inspect " + file("chip.ply") + " --recipe " + kRecipe + " --block 3");
  EXPECT_EQ(chip.status, 1);
  expect_mentions(chip.out, "finding: chip on the outer ");
  const Ended ideal = simulate_scan("chip.ply", "--damage chip_jaw");
  EXPECT_EQ(ideal.status, 2);
  expect_mentions(ideal.err, "--damage chip_jaw: needs --surface real or clean");
  const Ended unknown = simulate_scan("chip.ply", "--surface real --damage slope=1");
  EXPECT_EQ(unknown.status, 2);
  expect_mentions(unknown.err, "chip_corner   12 corner of the outer shoulder broken out, mm");
}

TEST_F(Slabctl, a_configuration_check_doubts_what_cannot_be_meant) {
  const std::string rest = "[recipes]\ndir = \"" + fs::path(kRecipe).parent_path().string() + "\"\n";
  const std::string poses = "[cell]\nT_base_slab = [1.5, 0.2, 0.57, 1, 0, 0, 0]\n";
  const Ended metres = run("config check --json " + write("metres.toml", poses + rest));
  EXPECT_EQ(metres.status, 0);
  expect_mentions(metres.err, "metres.toml:2:15: cell.T_base_slab: found x, y, z of at most 1.5 mm, metres?");
  const json document = json::parse(metres.out);
  ASSERT_EQ(document["doubts"].size(), 2U);
  expect_mentions(document["doubts"][1].get<std::string>(), "P4856 and P4925 have the same blocks");
  const Ended windows =
      run("config check " + write("windows.toml", poses + rest + "[scanner]\ndrop_dir = 'C:\\scans'\n"));
  EXPECT_EQ(windows.status, 3);
  expect_mentions(windows.err, "a path of Windows");
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

TEST_F(Slabctl, a_scan_is_measured_the_same_in_every_format_it_can_be_written_in) {
  ASSERT_EQ(simulate_scan("scan.ply", "").status, 0);
  const std::string rest = " --json --recipe " + kRecipe + " --block 3";
  const json wanted = json::parse(run("inspect " + file("scan.ply") + rest).out)["features"];
  const std::vector<std::pair<std::string, std::string>> written = {
      {"a.ply", "ply-ascii"}, {"a.pcd", "pcd-compressed"}, {"a.txt", ""}};
  for (const auto& [name, format] : written) {
    ASSERT_EQ(simulate_scan(name, format.empty() ? "" : "--format " + format).status, 0) << name;
    const Ended ended = run("inspect " + file(name) + rest);
    ASSERT_EQ(ended.err.find(name + ":"), std::string::npos) << ended.err;
    EXPECT_EQ(json::parse(ended.out)["features"], wanted) << name;
  }
}

TEST_F(Slabctl, a_scan_is_not_written_under_a_name_that_could_not_be_read_again) {
  for (const char* more : {"--format pcd", "--format csv", "--format stl"}) {
    const Ended ended = simulate_scan("scan.ply", more);
    EXPECT_EQ(ended.status, 2) << more;
    expect_mentions(ended.err, "--format");
  }
  const Ended ended = simulate_scan("scan.stl", "");
  EXPECT_EQ(ended.status, 2);
  expect_mentions(ended.err, ".ply, .pcd, .xyz, .asc, .txt or .csv");
  EXPECT_FALSE(fs::exists(file("scan.stl")));
}

TEST_F(Slabctl, good_block_passes_with_status_0_and_a_readable_table) {
  ASSERT_EQ(simulate_scan("scan.ply", "--casting 0 --unorganised").status, 0);
  const Ended ended = run("inspect " + file("scan.ply") + " --recipe " + kRecipe + " --block 3");
  EXPECT_EQ(ended.status, 0) << ended.out << ended.err;
  expect_mentions(ended.out, "seat_slope [deg]");
  expect_mentions(ended.out, "not visible to the block scans");
  EXPECT_EQ(ended.out.find('\x1b'), std::string::npos) << "no colour without a terminal";
  expect_mentions(ended.err, "assumed, not confirmed");
}

TEST_F(Slabctl, deviation_map_is_a_table_of_the_places_that_were_seen) {
  ASSERT_EQ(simulate_scan("scan.ply", "--defect chip=3:0.8").status, 0);
  const std::string inspect = "inspect " + file("scan.ply") + " --recipe " + kRecipe + " --block 3 --deviation-map ";
  const Ended ended = run(inspect + file("map.csv"));
  EXPECT_EQ(ended.err.find("deviation-map"), std::string::npos) << ended.err;
  std::ifstream map(file("map.csv"));
  std::string line;
  ASSERT_TRUE(std::getline(map, line));
  EXPECT_EQ(line, "x_mm,y_mm,deviation_mm,points");
  std::size_t cells = 0;
  double lowest = 0.0;
  while (std::getline(map, line)) {
    double x = 0.0;
    double y = 0.0;
    double deviation = 0.0;
    unsigned points = 0;
    ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%u", &x, &y, &deviation, &points), 4) << line;
    ++cells;
    EXPECT_GT(points, 0U) << line;
    EXPECT_LT(std::abs(x), 200.0) << line;
    EXPECT_LT(std::abs(y), 300.0) << line;
    EXPECT_EQ(std::fmod(std::abs(x), 4.0), 2.0) << "the middle of a 4 mm cell: " << line;
    if (std::abs(x) < 51.0 && std::abs(y) < 75.0) lowest = std::min(lowest, deviation);
  }
  // The block is 210 x 480 mm and the scan contains some of the slab around it; the bores are empty.
  EXPECT_GT(cells, 210U * 480U / 16U * 9U / 10U);
  EXPECT_LT(cells, 360U * 520U / 16U);
  EXPECT_LT(lowest, -0.2) << "the chip";

  for (const std::string& where : {file("no-such-folder/map.csv"), std::string("/dev/full")}) {
    const Ended refused = run(inspect + where);
    EXPECT_EQ(refused.status, 3) << where;
    expect_mentions(refused.err, "--deviation-map " + where + " cannot be written: ");
    expect_mentions(refused.out, "block 3: ");
  }
}

TEST_F(Slabctl, deviation_map_of_a_block_that_was_not_found_is_not_written) {
  std::string points;
  for (int i = 0; i < 60'000; ++i) points += std::to_string(i % 300) + ' ' + std::to_string(i / 300) + " 600\n";
  const Ended ended = run("inspect " + write("plate.xyz", points) + " --recipe " + kRecipe +
                          " --block 3 --deviation-map " + file("map.csv"));
  EXPECT_EQ(ended.status, 1);
  expect_mentions(ended.err, "map.csv: not written, the block was not found");
  EXPECT_FALSE(fs::exists(file("map.csv")));
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_F(Slabctl, an_inspection_keeps_within_the_memory_that_the_limits_add_up_to) {
  // All memory is allocated and written at the start, whatever the scan's size, so a small scan is enough.
  ASSERT_EQ(simulate_scan("scan.ply", "").status, 0);
  constexpr std::size_t kOneScan = limits::kScanSlotBytes + limits::kWorkspaceBytes;
  // The kernel refuses more. The 24 MB contain the stack of the second thread and the heap, and no pages of the
  // program's file: how many of those are resident depends on the page cache and is nothing that slabctl decides.
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_DATA, &before), 0);
  const rlimit allowed{.rlim_cur = kOneScan + 24'000'000, .rlim_max = before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &allowed), 0);  // a child inherits it
  const Ended ended = run("inspect " + file("scan.ply") + " --recipe " + kRecipe + " --block 3");
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &before), 0);
  ASSERT_LE(ended.status, 1) << ended.err;

  rusage used{};
  ASSERT_EQ(getrusage(RUSAGE_CHILDREN, &used), 0);  // the largest child; CTest gives each test a process
  const auto resident = 1024 * static_cast<std::size_t>(used.ru_maxrss);
  EXPECT_GE(resident, kOneScan);
  EXPECT_LE(resident, 160'000'000U);
}
#endif

TEST_F(Slabctl, plc_monitor_connects_to_an_ipv4_address_with_a_port_and_nothing_else) {
  for (const char* address :
       {"localhost:1502", "127.0.0.1:1502abc", "127.0.0.1:0", "127.0.0.1:65536", "127.0.0.1", ":1"}) {
    const Ended refused = run("plc monitor --once --config none.toml --connect " + std::string(address));
    EXPECT_EQ(refused.status, 2) << address;
    expect_mentions(refused.err, "an IPv4 address and a port from 1 to 65535");
  }
  EXPECT_EQ(run("plc monitor --once --config none.toml --connect 127.0.0.1:1").status, 4) << "no server at this port";
}

TEST_F(Slabctl, one_thread_and_two_inspect_to_the_same_digits) {
  ASSERT_EQ(simulate_scan("scan.ply", "--defect chip=3:0.4").status, 0);
  const std::string rest = "inspect " + file("scan.ply") + " --json --recipe " + kRecipe + " --block 3 --threads ";
  json one = json::parse(run(rest + "1").out);
  json two = json::parse(run(rest + "2").out);
  ASSERT_TRUE(one.contains("timing_ms") && two.contains("timing_ms"));
  one.erase("timing_ms");
  two.erase("timing_ms");
  EXPECT_EQ(one.dump(), two.dump());
  EXPECT_EQ(run(rest + "3").status, 2);
  EXPECT_EQ(run(rest + "0").status, 2);
}

}  // namespace
}  // namespace slabd::cli
