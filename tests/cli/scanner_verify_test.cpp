// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/prng.h"
#include "hal/hal.h"
#include "slabctl_process.h"

namespace slabd::cli {
namespace {

/// Writes the scan of a plate at 600 mm with noise of 0.02 mm.
void write_plate(const std::string& path, std::size_t side = 300, bool smoothed = false) {
  Prng prng(5);
  std::vector<double> noise(side * side);
  for (double& n : noise) n = 0.02 * prng.normal();
  const auto smooth = [&](std::size_t row, std::size_t column) {
    double sum = 0.0;
    for (std::size_t i = row; i < row + 3; ++i)
      for (std::size_t j = column; j < column + 3; ++j) sum += noise[(i % side) * side + j % side] / 3.0;
    return sum;
  };
  std::vector<float> xyz;
  for (std::size_t row = 0; row < side; ++row)
    for (std::size_t column = 0; column < side; ++column) {
      xyz.push_back(0.4F * static_cast<float>(column) - 60.0F);
      xyz.push_back(0.4F * static_cast<float>(row) - 60.0F);
      xyz.push_back(static_cast<float>(600.0 + (smoothed ? smooth(row, column) : noise[row * side + column])));
    }
  ASSERT_TRUE(hal::write_ply(path.c_str(), xyz, side, side).ok());
}

using ScannerVerify = Slabctl;

TEST_F(ScannerVerify, figures_are_printed_kept_and_found_again_and_limits_decide_the_exit_status) {
  const std::string plate = file("plate.ply");
  write_plate(plate);
  const std::string config = write("slabd.toml", "[storage]\ndb = \"" + file("slabd.db") + "\"\nspool_dir = \"" +
                                                     file("spool") + "\"\n[control]\nsocket = \"" + file("none.sock") +
                                                     "\"\n[cell]\nT_base_slab = [0,0,0,1,0,0,0]\n");
  const Ended good =
      run("scanner verify --plate " + plate + " --limit-rf-mm 0.2 --scanner SN7 --keep --config " + config + " --json");
  ASSERT_EQ(good.status, 0) << good.err;
  const auto record = nlohmann::json::parse(good.out);
  EXPECT_EQ(record["schema"], "slabd.scanner_verification/1");
  EXPECT_NEAR(record["plates"][0]["noise_sigma_mm"].get<double>(), 0.02, 0.001);
  EXPECT_TRUE(record["PF_mm"].is_null()) << "no ball, no figure";
  expect_mentions(record["uncertainty"].get<std::string>(), "scanner_form_mm = { value = ");

  const Ended bad = run("scanner verify --plate " + plate + " --limit-rf-mm 0.05 --keep --config " + config);
  EXPECT_EQ(bad.status, 6) << bad.err;
  expect_mentions(bad.out, "OUT OF LIMITS");
  expect_mentions(bad.err, "6 places");
  const Ended no_ball = run("scanner verify --plate " + plate + " --limit-pf-mm 0.5");
  EXPECT_EQ(no_ball.status, 2) << "a limit of what is not looked at would judge nothing";
  expect_mentions(no_ball.err, "--ball");

  const Ended history = run("scanner history --json --config " + config);
  ASSERT_EQ(history.status, 0) << history.err;
  const auto kept = nlohmann::json::parse(history.out)["records"];
  ASSERT_EQ(kept.size(), 2U);
  EXPECT_EQ(kept[0]["id"].get<std::string>().substr(0, 3), "sc-");
  EXPECT_EQ(kept[0]["in_force"], false);
  EXPECT_EQ(kept[0]["scanner"], "SN7");
  EXPECT_EQ(kept[0]["within_limits"], true);
  EXPECT_EQ(kept[1]["within_limits"], false);
}

TEST_F(ScannerVerify, a_record_is_of_scans_in_the_unit_of_the_configuration) {
  const std::string plate = file("plate.ply");
  write_plate(plate);
  const std::string config =
      write("slabd.toml", "[scanner]\nunit = \"m\"\n[storage]\ndb = \"" + file("slabd.db") + "\"\nspool_dir = \"" +
                              file("spool") + "\"\n[control]\nsocket = \"" + file("none.sock") +
                              "\"\n[cell]\nT_base_slab = [0,0,0,1,0,0,0]\n");
  const std::string keep = "scanner verify --plate " + plate + " --keep --config " + config;
  EXPECT_NE(run(keep).status, 0) << "the plate would be 120 m wide";
  const Ended given = run(keep + " --unit mm");
  EXPECT_EQ(given.status, 0) << given.err;
}

TEST_F(ScannerVerify, an_emulated_plate_and_ball_rehearse_the_acceptance) {
  const auto drawn = [&](const char* kind, int views) {
    const std::string folder = file(kind);
    const Ended set = run(fmt::format("simulate calibration --kind {} --views {} --out {}", kind, views, folder));
    EXPECT_EQ(set.status, 0) << set.err;
    std::string files;
    for (int view = 1; view <= views; ++view) files += fmt::format(" {}/view_{:02}.ply", folder, view);
    return files;
  };
  const Ended verified = run("scanner verify --plate" + drawn("plate", 6) + " --ball" + drawn("ball", 10) +
                             " --diameter-mm 50.8 --limit-rf-mm 0.3 --limit-pf-mm 0.3 --limit-ps-mm 0.05 --json");
  ASSERT_EQ(verified.status, 0) << verified.err << verified.out;
  const auto record = nlohmann::json::parse(verified.out);
  EXPECT_EQ(record["refusal"], "") << "six places of the plate, ten of the ball";
  EXPECT_NEAR(record["noise_sigma_mm"].get<double>(), 0.03, 0.003);
}

TEST_F(ScannerVerify, the_budget_takes_the_shortest_length_because_the_same_form_tilts_more_over_it) {
  const std::string large = file("large.ply");
  const std::string small = file("small.ply");
  write_plate(large, 400);
  write_plate(small, 200);
  const Ended both = run("scanner verify --plate " + large + " " + small + " --json");
  ASSERT_EQ(both.status, 0) << both.err;
  const auto record = nlohmann::json::parse(both.out);
  EXPECT_NEAR(record["plates"][1]["length_mm"].get<double>(), 112.6, 0.5);
  expect_mentions(record["uncertainty"].get<std::string>(), "scanner_form_length_mm = { value = 113");
}

TEST_F(ScannerVerify, a_scanner_program_that_smooths_is_named) {
  const std::string plain = file("plain.ply");
  const std::string smoothed = file("smoothed.ply");
  write_plate(plain);
  write_plate(smoothed, 300, true);
  EXPECT_EQ(run("scanner verify --plate " + plain).err.find("smooths"), std::string::npos);
  const std::string told = run("scanner verify --plate " + smoothed).err;
  expect_mentions(told, "smoothed.ply: neighbours share their noise over ");
  expect_mentions(told, "switch that off and verify again");
}

TEST_F(ScannerVerify, a_plate_that_is_bent_out_of_the_gate_is_not_accepted_as_a_plate) {
  std::vector<float> xyz;
  for (int row = 0; row < 300; ++row)
    for (int column = 0; column < 300; ++column) {
      const double x = 0.4 * column - 60.0;
      const double y = 0.4 * row - 60.0;
      for (const double v : {x, y, 600.0 + 6.0 * (x * x + y * y) / 3'600.0}) xyz.push_back(static_cast<float>(v));
    }
  ASSERT_TRUE(hal::write_ply(file("bowl.ply").c_str(), xyz, 300, 300).ok());
  const Ended bowl = run("scanner verify --plate " + file("bowl.ply"));
  EXPECT_EQ(bowl.status, 3) << bowl.out;
  expect_mentions(bowl.err, "the plate is not flat");
}

TEST_F(ScannerVerify, missing_arguments_and_files_are_reported) {
  EXPECT_EQ(run("scanner verify").status, 2);
  EXPECT_EQ(run("scanner verify --ball x.ply").status, 2);
  EXPECT_EQ(run("scanner verify --plate /nowhere/x.ply").status, 3);
}

}  // namespace
}  // namespace slabd::cli
