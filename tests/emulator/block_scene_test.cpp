// SPDX-License-Identifier: Apache-2.0
//
// Compares the drawn block with a brute-force model: a predicate for points inside the block, and rays that advance in
// small steps.
#include "emulator/block_scene.h"
#include "emulator/scan_drawing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/config/reference_recipe.h"

namespace slabd::emulator {
namespace {

Recipe recipe() {
  return cli::reference_recipe();
}

BlockTruth odd_truth(const Recipe& r) {
  BlockTruth truth = nominal_truth(r);
  truth.slope_rad = std::atan(1.0 / 36.0);
  truth.jaw_angle_inner_rad = rad_from_deg(108.7);
  truth.jaw_angle_outer_rad = rad_from_deg(111.9);
  truth.jaw_distance_mm = 381.4;
  truth.casing_spacing_mm = 231.5;
  truth.protrusion_inner_mm = -0.6;
  truth.protrusion_outer_mm = 0.7;
  truth.slab_top_shift_mm = -1.5;
  return truth;
}

Pose odd_view() {
  Pose off;
  off.translation_mm = Vec3(1.7, -1.1, 3.0);
  off.rotation = rotation_from_kuka_abc(0.02, -0.011, 0.008);
  return (nominal_T_block_scanner() * off).inverse();
}

/// The drawing as a predicate, block frame: z = max(slab top, min(end faces, side faces, shoulder, max(bearing plane,
/// jaw face))), the seat drilled at the casings. 2: in a bore, where no ray returns.
int solid(const Recipe& r, const BlockTruth& t, const Vec3& p) {
  const BlockGeometry& b = r.block;
  const double draft = std::tan(b.draft_rad.value);
  if (p.z() < b.slab_top_z_mm.value + t.slab_top_shift_mm) return 1;
  const double c = std::cos(t.slope_rad);
  const double s = std::sin(t.slope_rad);
  const double along = p.y() * c + p.z() * s;    // outward on the bearing plane
  const double height = -p.y() * s + p.z() * c;  // above it
  for (const bool outer : {false, true}) {
    const double centre = (outer ? 0.5 : -0.5) * t.casing_spacing_mm;
    const double rim = outer ? t.protrusion_outer_mm : t.protrusion_inner_mm;
    const double radius = std::hypot(p.x(), along - centre);
    if (radius < 0.5 * b.casing_bore_diameter_mm.value && height < rim) return 2;
    if (radius < 0.5 * b.casing_rim_diameter_mm.value) return height < rim ? 1 : 0;
  }
  const bool inside_outline = std::abs(p.x()) < b.end_half_length_mm.value - p.z() * draft &&
                              std::abs(p.y()) < b.side_half_width_mm.value - p.z() * draft;
  if (!inside_outline) return 0;
  // At the broken corner the block's surface is deeper by this.
  const double broken = p.x() > 57.0 && p.y() > 155.0 ? t.corner_mm : 0.0;
  if (broken > 0.0) {
    const double z = p.z() + broken;
    const double high = -p.y() * s + z * c;
    const double face = 0.5 * t.jaw_distance_mm +
                        (high - b.jaw_reference_height_mm.value) * std::tan(t.jaw_angle_outer_rad - kPi / 2.0);
    return high < 0.0 || (p.y() * c + z * s > face && z < b.shoulder_outer_z_mm.value) ? 1 : 0;
  }
  if (height < (p.x() > 55.0 ? -t.sunk_mm : 0.0)) return 1;
  const double half = 0.5 * t.jaw_distance_mm;
  const double reference = b.jaw_reference_height_mm.value;
  const double outer_face = half + (height - reference) * std::tan(t.jaw_angle_outer_rad - kPi / 2.0);
  const double inner_face = -half - (height - reference) * std::tan(t.jaw_angle_inner_rad - kPi / 2.0);
  if (along > outer_face && p.z() < b.shoulder_outer_z_mm.value) return 1;
  if (along < inner_face && p.z() < b.shoulder_inner_z_mm.value) return 1;
  return 0;
}

/// First depth at which the ray is inside; NaN in a bore. Steps of 0.05 mm, then bisection.
double march(const Recipe& r, const BlockTruth& t, const Pose& T_scanner_block, Projection projection, double x,
             double y) {
  const Pose T_block_scanner = T_scanner_block.inverse();
  const auto at = [&](double z) {
    const double magnified = projection == Projection::parallel ? 1.0 : z / 600.0;
    return solid(r, t, T_block_scanner * Vec3(magnified * x, magnified * y, z));
  };
  for (double z = 450.0; z < 900.0; z += 0.05) {
    const int inside = at(z);
    if (inside == 2) return kNoValue;
    if (inside == 0) continue;
    double above = z - 0.05;
    double below = z;
    for (int i = 0; i < 30; ++i) {
      const double middle = 0.5 * (above + below);
      (at(middle) == 0 ? above : below) = middle;
    }
    return below;
  }
  ADD_FAILURE() << "the ray at " << x << ", " << y << " hits nothing";
  return kNoValue;
}

void compare_with_marching(const BlockTruth& truth, const Pose& T_scanner_block, int rays,
                           Projection projection = Projection::parallel) {
  const Recipe r = recipe();
  const auto surface = BlockSurface::make(r, truth, T_scanner_block, projection);
  ASSERT_TRUE(surface) << surface.error().text.c_str();
  Prng random(20);
  int disagree = 0;
  for (int i = 0; i < rays; ++i) {
    const double x = 350.0 * (random.uniform() - 0.5);
    const double y = 500.0 * (random.uniform() - 0.5);
    const double expected = march(r, truth, T_scanner_block, projection, x, y);
    const double drawn = surface.value().depth_mm(x, y);
    if (std::isnan(expected) && std::isnan(drawn)) continue;
    if (!(std::abs(expected - drawn) < 1e-6)) ++disagree;
  }
  // Rays that graze a casing's 0.25 mm wall are drawn without the wall.
  EXPECT_LE(disagree, rays / 500);
}

TEST(BlockScene, nominal_block_is_what_marching_rays_find) {
  compare_with_marching(nominal_truth(recipe()), nominal_T_block_scanner().inverse(), 4000);
}

TEST(BlockScene, sunk_seat_and_broken_corner_are_what_marching_rays_find) {
  BlockTruth sunk = nominal_truth(recipe());
  sunk.sunk_mm = 10.0;
  compare_with_marching(sunk, nominal_T_block_scanner().inverse(), 4000);
  BlockTruth broken = nominal_truth(recipe());
  broken.corner_mm = 15.0;
  compare_with_marching(broken, nominal_T_block_scanner().inverse(), 4000);
}

TEST(BlockScene, odd_block_from_an_odd_view_is_what_marching_rays_find) {
  compare_with_marching(odd_truth(recipe()), odd_view(), 4000);
}

TEST(BlockScene, perspective_rays_find_what_marching_finds_shadows_and_hidden_faces_included) {
  compare_with_marching(odd_truth(recipe()), odd_view(), 4000, Projection::perspective);
}

TEST(BlockScene, tilted_view_finds_what_marching_finds_though_it_cannot_see_every_face) {
  Pose tilt;
  tilt.rotation = rotation_from_kuka_abc(0.0, rad_from_deg(13.0), rad_from_deg(12.0));
  for (const Projection projection : {Projection::parallel, Projection::perspective})
    compare_with_marching(odd_truth(recipe()), (nominal_T_block_scanner() * tilt).inverse(), 2000, projection);
}

TEST(BlockScene, perspective_points_are_on_their_rays_and_on_the_block) {
  const Recipe r = recipe();
  const auto surface =
      BlockSurface::make(r, nominal_truth(r), nominal_T_block_scanner().inverse(), Projection::perspective);
  ASSERT_TRUE(surface);
  const double depth = surface.value().depth_mm(40.0, 60.0);
  const Vec3 p = surface.value().point(40.0, 60.0, depth, 0.0);
  EXPECT_NEAR(p.x() / p.z(), 40.0 / 600.0, 1e-12);
  const Vec3 on_block = nominal_T_block_scanner() * p;
  EXPECT_NEAR(on_block.z(), on_block.y() / 40.0, 1e-9);
  EXPECT_NEAR((surface.value().point(40.0, 60.0, depth, 2.0) - p).norm(), 2.0, 1e-12);
}

TEST(BlockScene, missing_block_shows_only_the_slab_top) {
  const Recipe r = recipe();
  BlockTruth truth = nominal_truth(r);
  truth.present = false;
  const auto surface = BlockSurface::make(r, truth, nominal_T_block_scanner().inverse());
  ASSERT_TRUE(surface);
  for (const double y : {-240.0, -100.0, 0.0, 117.0, 240.0}) EXPECT_DOUBLE_EQ(surface.value().depth_mm(10.0, y), 630.0);
}

TEST(BlockScene, block_behind_the_scanner_is_refused) {
  const Recipe r = recipe();
  Pose below;
  below.translation_mm = Vec3(0.0, 0.0, 600.0);
  for (const Pose& view : {below, Pose::identity()}) {
    const auto refused = BlockSurface::make(r, nominal_truth(r), view);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().text.view().find("in front of the scanner"), std::string_view::npos);
  }
}

TEST(BlockScene, chip_and_burr_are_where_they_were_planted) {
  const Recipe r = recipe();
  BlockTruth truth = nominal_truth(r);
  truth.chip_mm = 0.3;
  truth.burr_mm = 0.2;
  const Pose view = nominal_T_block_scanner().inverse();
  const auto plain = BlockSurface::make(r, nominal_truth(r), view);
  const auto spoilt = BlockSurface::make(r, truth, view);
  ASSERT_TRUE(plain && spoilt);
  // The scanner's Y is minus the block's; the seat rises 1:40, so 0.3 mm along the normal are 0.3001 along Z.
  const auto lift = [&](double x, double y) { return plain.value().depth_mm(x, -y) - spoilt.value().depth_mm(x, -y); };
  EXPECT_NEAR(lift(20.0, -30.0), -0.3, 2e-4);
  EXPECT_NEAR(lift(-20.0, 40.0), 0.2, 2e-4);
  EXPECT_EQ(lift(0.0, 0.0), 0.0);
  EXPECT_NEAR(true_flatness_mm(r, truth), 0.5, 0.005);
}

TEST(BlockScene, glove_and_cable_are_in_front_of_the_block_only) {
  const Recipe r = recipe();
  BlockTruth truth = nominal_truth(r);
  truth.glove_s_mm = 100.0;
  truth.cable_x_mm = -40.0;
  for (const Projection projection : {Projection::parallel, Projection::perspective}) {
    const auto plain = BlockSurface::make(r, nominal_truth(r), nominal_T_block_scanner().inverse(), projection);
    const auto strewn = BlockSurface::make(r, truth, nominal_T_block_scanner().inverse(), projection);
    ASSERT_TRUE(plain && strewn);
    // On the glove's top, 15 mm above a seat that is 2.5 mm high there; on the cable, 40 mm above the origin.
    EXPECT_NEAR(strewn.value().depth_mm(0.0, -100.0), 600.0 - 2.5 - 15.0, 1.5);
    const double x = projection == Projection::parallel ? -40.0 : -40.0 * 600.0 / 560.0;
    EXPECT_NEAR(strewn.value().depth_mm(x, 50.0), 560.0, 0.3);
    EXPECT_EQ(strewn.value().depth_mm(60.0, 50.0), plain.value().depth_mm(60.0, 50.0));
  }
}

/// Correlation of the field with itself, shifted by `shift` columns.
double correlation(const std::vector<float>& field, std::size_t columns, std::size_t shift) {
  double sum = 0.0;
  double power = 0.0;
  for (std::size_t i = 0; i + shift < field.size(); ++i) {
    if (i % columns + shift >= columns) continue;
    sum += static_cast<double>(field[i]) * static_cast<double>(field[i + shift]);
    power += static_cast<double>(field[i]) * static_cast<double>(field[i]);
  }
  return sum / power;
}

TEST(BlockScene, correlated_noise_has_its_standard_deviation_and_falls_to_1_over_e_at_its_length) {
  ScannerTraits traits;
  traits.columns = 700;  // 0.5 mm apart
  traits.rows = 1000;
  traits.noise_correlation_mm = 2.0;
  for (const NoiseShape shape : {NoiseShape::gaussian, NoiseShape::exponential}) {
    traits.noise_shape = shape;
    const std::vector<float> field = noise_field(traits, 3);
    ASSERT_EQ(field.size(), 700U * 1000U);
    double power = 0.0;
    for (const float v : field) power += static_cast<double>(v) * static_cast<double>(v);
    EXPECT_NEAR(std::sqrt(power / 700'000.0), 1.0, 0.02);
    EXPECT_NEAR(correlation(field, 700, 4), std::exp(-1.0), 0.02);
    EXPECT_NEAR(correlation(field, 700, 2), shape == NoiseShape::gaussian ? std::exp(-0.25) : std::exp(-0.5), 0.02);
    EXPECT_NEAR(correlation(field, 700, 20), 0.0, 0.02);
  }
}

TEST(BlockScene, dome_raises_the_seat_by_its_height_and_its_flatness_is_known) {
  const Recipe r = recipe();
  BlockTruth truth = nominal_truth(r);
  truth.bump_mm = 0.4;
  const auto flat = BlockSurface::make(r, nominal_truth(r), nominal_T_block_scanner().inverse());
  const auto domed = BlockSurface::make(r, truth, nominal_T_block_scanner().inverse());
  ASSERT_TRUE(flat && domed);
  EXPECT_NEAR(flat.value().depth_mm(0, 0) - domed.value().depth_mm(0, 0), 0.4, 1e-3);
  EXPECT_NEAR(true_flatness_mm(r, truth), 0.4, 0.01);
  EXPECT_EQ(true_flatness_mm(r, nominal_truth(r)), 0.0);
}

struct Statistics {
  DrawnScan drawn;
  double mean_mm = 0.0;
  double std_mm = 0.0;
  std::size_t far = 0;
  double far_max_mm = 0.0;
};

Statistics draw_missing_block(const ScannerTraits& traits, std::uint64_t seed) {
  const Recipe r = recipe();
  BlockTruth truth = nominal_truth(r);
  truth.present = false;  // a plane, so that every deviation is due to the scanner
  const auto surface = BlockSurface::make(r, truth, nominal_T_block_scanner().inverse());
  Statistics s;
  std::vector<float> xyz;
  s.drawn = draw_scan(surface.value(), traits, seed, xyz);
  double sum = 0.0;
  double sum2 = 0.0;
  std::size_t near_count = 0;
  for (std::size_t i = 2; i < xyz.size(); i += 3) {
    const double d = static_cast<double>(xyz[i]) - 630.0;
    if (!std::isfinite(d)) continue;
    if (std::abs(d) > 0.5) {
      ++s.far;
      s.far_max_mm = std::max(s.far_max_mm, std::abs(d));
      continue;
    }
    sum += d;
    sum2 += d * d;
    ++near_count;
  }
  s.mean_mm = sum / static_cast<double>(near_count);
  s.std_mm = std::sqrt(sum2 / static_cast<double>(near_count));
  return s;
}

TEST(BlockScene, noise_outliers_and_gaps_have_the_stated_shares) {
  ScannerTraits traits;
  traits.columns /= 2;
  traits.rows /= 2;
  const double rays = static_cast<double>(traits.columns * traits.rows);
  const Statistics s = draw_missing_block(traits, 5);
  EXPECT_NEAR(s.std_mm, 0.03, 0.0002);
  EXPECT_NEAR(s.mean_mm, 0.0, 0.0002);
  EXPECT_NEAR(static_cast<double>(s.drawn.missing) / rays, 0.02, 0.001);
  EXPECT_NEAR(static_cast<double>(s.drawn.outliers) / static_cast<double>(s.drawn.valid), 0.005, 0.0005);
  EXPECT_EQ(s.far, s.drawn.outliers);
  EXPECT_GT(s.far_max_mm, 59.0);
  EXPECT_LE(s.far_max_mm, 60.001);
}

TEST(BlockScene, same_seed_same_bits_other_seed_other_bits) {
  const Recipe r = recipe();
  const auto surface = BlockSurface::make(r, nominal_truth(r), nominal_T_block_scanner().inverse());
  ScannerTraits traits;
  traits.columns = 100;
  traits.rows = 120;
  traits.organised = false;
  std::vector<float> first;
  std::vector<float> again;
  std::vector<float> other;
  const DrawnScan drawn = draw_scan(surface.value(), traits, 9, first);
  std::ignore = draw_scan(surface.value(), traits, 9, again);
  std::ignore = draw_scan(surface.value(), traits, 10, other);
  EXPECT_EQ(first, again);
  EXPECT_NE(first, other);
  EXPECT_EQ(drawn.width, 0U);
  EXPECT_EQ(first.size(), 3 * drawn.valid);
  EXPECT_EQ(drawn.valid + drawn.missing + drawn.no_return, traits.columns * traits.rows);
}

TEST(BlockScene, organised_scan_keeps_its_grid_and_bores_return_nothing) {
  const Recipe r = recipe();
  const auto surface = BlockSurface::make(r, nominal_truth(r), nominal_T_block_scanner().inverse());
  ScannerTraits traits;
  traits.columns = 700;
  traits.rows = 1000;
  std::vector<float> xyz;
  const DrawnScan drawn = draw_scan(surface.value(), traits, 1, xyz);
  EXPECT_EQ(drawn.width * drawn.height * 3, xyz.size());
  // Two bores of 30 mm on pixels of 0.5 x 0.5 mm.
  EXPECT_NEAR(static_cast<double>(drawn.no_return), 2.0 * kPi * 15.0 * 15.0 / 0.25, 60.0);
}

}  // namespace
}  // namespace slabd::emulator
