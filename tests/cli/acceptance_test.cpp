// SPDX-License-Identifier: Apache-2.0
#include "cli/scanner/acceptance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/prng.h"
#include "emulator/scan_drawing.h"
#include "emulator/solid_scene.h"

namespace slabd::cli {
namespace {

/// A scan drawn by the emulator, with noise along the rays and a bend of the field.
struct Scene {
  emulator::Solids solids;
  double noise_mm = 0.03;
  double correlation_mm = 0.0;
  double bend_mm = 0.0;  ///< depth of a bowl over the field's half diagonal
  double scale = 1.0;    ///< scale of all coordinates
  double outlier_share = 0.002;
  std::vector<float> xyz;
  ScanShape shape;

  void draw(std::uint64_t seed) {
    emulator::Picture picture;
    picture.field_x_mm = 200.0;
    picture.field_y_mm = 200.0;
    picture.clear(600, 600);
    picture.draw(solids);
    emulator::ScannerTraits traits;
    traits.columns = traits.rows = 600;
    traits.field_x_mm = traits.field_y_mm = 200.0;
    traits.noise_correlation_mm = correlation_mm;
    const std::vector<float> common = correlation_mm > 0.0 ? emulator::noise_field(traits, seed) : std::vector<float>();
    Prng prng(seed);
    xyz.clear();
    for (std::size_t row = 0; row < picture.rows; ++row)
      for (std::size_t column = 0; column < picture.columns; ++column) {
        const std::size_t at = row * picture.columns + column;
        const Vec3 ray = picture.ray(column, row);
        double depth = static_cast<double>(picture.depth_mm[at]);
        const double noise = common.empty() ? prng.normal() : static_cast<double>(common[at]);
        depth += noise_mm * noise + bend_mm * (std::pow(ray.x() * 6.0, 2) + std::pow(ray.y() * 6.0, 2)) / 2.0;
        if (prng.uniform() < outlier_share) depth += 20.0 * prng.uniform();
        for (int axis = 0; axis < 3; ++axis) xyz.push_back(static_cast<float>(scale * depth * ray[axis]));
      }
    shape = {picture.rows * picture.columns, 0, picture.columns, picture.rows};
  }
};

Scene plate() {
  Scene scene;
  scene.solids.plates.push_back({Vec3(5.0, -3.0, 600.0), Vec3(70.0, 0.0, 8.0), Vec3(0.0, 60.0, -5.0)});
  return scene;
}
Scene ball(const Vec3& centre) {
  Scene scene;
  scene.solids.balls.push_back({centre, 25.0});
  return scene;
}

TEST(ScannerAcceptance, a_plates_noise_is_found_whatever_the_seed) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    Scene scene = plate();
    scene.draw(seed);
    const Result<PlateFigures> figures = judge_plate(scene.xyz, scene.shape, {});
    ASSERT_TRUE(figures.ok()) << figures.error().text.view();
    const PlateFigures& f = figures.value();
    EXPECT_NEAR(f.noise.sigma_mm, 0.03, 0.003) << seed;
    EXPECT_EQ(f.noise.correlation_mm, 0.0) << "every point errs by itself";
    EXPECT_NEAR(f.noise.pitch_mm, 1.0 / 3.0, 0.01);
    // 99.7 % of a normal distribution are within 2.968 standard deviations.
    EXPECT_NEAR(f.RF_mm, 2.0 * 2.968 * 0.03, 0.005) << seed;
    EXPECT_LT(f.form_half_mm, 0.006) << "cells of 900 points";
    EXPECT_NEAR(f.length_mm, 184.0, 4.0);
    EXPECT_LE(f.rejected, f.points * 3 / 1000);
  }
}

TEST(ScannerAcceptance, how_far_neighbours_err_together_is_found) {
  for (const double correlation_mm : {1.0, 2.0, 4.0})
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      Scene scene = plate();
      scene.correlation_mm = correlation_mm;
      scene.outlier_share = 0.0;
      scene.draw(seed);
      const Result<PlateFigures> figures = judge_plate(scene.xyz, scene.shape, {});
      ASSERT_TRUE(figures.ok());
      EXPECT_NEAR(figures.value().noise.sigma_mm, 0.03, 0.003);
      EXPECT_NEAR(figures.value().noise.correlation_mm, correlation_mm, 0.12 * correlation_mm) << seed;
    }
}

TEST(ScannerAcceptance, a_scanner_that_bends_surfaces_is_distinguished_from_one_that_is_noisy) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    Scene scene = plate();
    scene.bend_mm = 0.2;  // over +-70 mm x +-60 mm of +-100 mm: a bowl of about 0.085 mm
    scene.draw(seed);
    const Result<PlateFigures> figures = judge_plate(scene.xyz, scene.shape, {});
    ASSERT_TRUE(figures.ok());
    EXPECT_NEAR(figures.value().form_half_mm, 0.040, 0.008) << seed;
    EXPECT_NEAR(figures.value().noise.sigma_mm, 0.03, 0.003) << "form is not noise";
    EXPECT_EQ(figures.value().noise.correlation_mm, 0.0);
  }
}

TEST(ScannerAcceptance, a_ball_is_measured_as_large_as_it_is_and_its_range_is_that_of_the_noise) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Vec3 centre(30.0 - 15.0 * static_cast<double>(seed), 10.0, 580.0 + 10.0 * static_cast<double>(seed));
    Scene scene = ball(centre);
    scene.draw(seed);
    const Result<BallFigures> figures = judge_ball(scene.xyz, 50.0, {});
    ASSERT_TRUE(figures.ok()) << figures.error().text.view();
    const BallFigures& f = figures.value();
    EXPECT_LT((f.centre_mm - centre).norm(), 0.01);
    EXPECT_NEAR(f.PS_mm, 0.0, 0.006) << seed;
    EXPECT_GT(f.PF_mm, 0.12);
    EXPECT_LT(f.PF_mm, 0.24);
  }
}

TEST(ScannerAcceptance, a_scanner_that_sees_everything_too_large_shows_in_the_size) {
  Scene scene = ball(Vec3(0.0, 0.0, 600.0));
  scene.scale = 1.001;
  scene.draw(5);
  const Result<BallFigures> figures = judge_ball(scene.xyz, 50.0, {});
  ASSERT_TRUE(figures.ok()) << figures.error().text.view();
  EXPECT_NEAR(figures.value().PS_mm, 0.050, 0.006);
}

TEST(ScannerAcceptance, a_scan_that_does_not_show_the_artefact_does_not_give_a_figure) {
  Scene scene = ball(Vec3(0.0, 0.0, 600.0));
  scene.draw(6);
  EXPECT_FALSE(judge_ball(scene.xyz, 30.0, {}).ok()) << "another ball";
  scene.solids = {};
  scene.outlier_share = 0.0;
  scene.draw(6);
  EXPECT_FALSE(judge_plate(scene.xyz, scene.shape, {}).ok());
  EXPECT_FALSE(judge_ball(scene.xyz, 50.0, {}).ok());
  EXPECT_FALSE(judge_plate({}, {}, {}).ok());
}

}  // namespace
}  // namespace slabd::cli
