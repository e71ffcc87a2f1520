// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <bit>
#include <vector>

#include "algo/block_model.h"
#include "scene.h"

namespace slabd::algo {
namespace {

BlockModel p5600_model() {
  BlockModel model;
  model.build(scene::p5600().block);
  return model;
}

TEST(BlockModel, has_the_jaws_where_the_drawing_has_them) {
  const BlockModel model = p5600_model();
  const Plane& seat = model.plane(Face::seat);
  const Vec3 outer = 190.0 * model.along_seat() + 10.0 * seat.n;
  const Vec3 inner = -190.0 * model.along_seat() + 10.0 * seat.n;
  EXPECT_NEAR(model.plane(Face::jaw_outer).distance(outer), 0.0, 1e-12);
  EXPECT_NEAR(model.plane(Face::jaw_inner).distance(inner), 0.0, 1e-12);
  for (const Face jaw : {Face::jaw_inner, Face::jaw_outer}) {
    EXPECT_NEAR(180.0 - deg_from_rad(angle_between_rad(seat.n, model.plane(jaw).n)), 110.0, 1e-10);
    EXPECT_GT(model.plane(jaw).distance(Vec3(0.0, 0.0, 5.0)), 0.0) << "the free side holds the rail";
  }
  EXPECT_NEAR(seat.n.y() / seat.n.z(), -1.0 / 40.0, 1e-15);
}

TEST(BlockModel, shows_the_surface_an_independent_scene_shows) {
  const BlockModel model = p5600_model();
  scene::Scan scan;
  scan.noise_mm = 0.0;
  scan.outlier_share = 0.0;
  scan.missing_share = 0.0;
  scan.pitch_mm = 0.7;
  scan.organised = true;
  const scene::Cloud cloud = scene::take({}, scan);
  std::size_t seen = 0;
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    const float* f = cloud.xyz.data() + 3 * i;
    const double x_scan = (static_cast<double>(i % cloud.width) + 0.5) * 0.7 - 175.0;
    const double y_scan = (static_cast<double>(i / cloud.width) + 0.5) * 0.7 - 250.0;
    const Vec3 ray = cloud.T_block_scanner * Vec3(x_scan, y_scan, 0.0);
    Face face = Face::seat;
    double z = 0.0;
    const bool visible = model.visible(ray.x(), ray.y(), face, z);
    ASSERT_EQ(visible, !std::isnan(f[0])) << ray.x() << " " << ray.y();
    if (!visible) continue;
    const Vec3 p =
        cloud.T_block_scanner * Vec3(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
    ASSERT_NEAR(p.z(), z, 1e-3) << ray.x() << " " << ray.y();
    ++seen;
  }
  EXPECT_GT(seen, 300000U);
}

TEST(FaceTable, contains_every_face_within_its_reach_and_none_beyond) {
  const BlockModel model = p5600_model();
  std::vector<std::uint16_t> wide(FaceTable::kCells);
  std::vector<std::uint16_t> near(FaceTable::kCells);
  std::vector<std::uint16_t> scratch(FaceTable::kCells);
  FaceTable table;
  table.build(model, wide, near, scratch);
  Prng prng(1);
  for (int i = 0; i < 3000; ++i) {
    const Vec3 p(380.0 * (prng.uniform() - 0.5), 580.0 * (prng.uniform() - 0.5), 0.0);
    Face face = Face::seat;
    double z = 0.0;
    const Vec3 beside = p + Vec3(1.9 * (2.0 * prng.uniform() - 1.0), 1.9 * (2.0 * prng.uniform() - 1.0), 0.0);
    if (model.visible(beside.x(), beside.y(), face, z)) {
      EXPECT_TRUE((table.near_at(p) & bit(face)) != 0) << p.transpose();
    }
    const Vec3 far = p + Vec3(24.0 * (2.0 * prng.uniform() - 1.0), 24.0 * (2.0 * prng.uniform() - 1.0), 0.0);
    if (FaceTable::inside(far) && model.visible(far.x(), far.y(), face, z)) {
      EXPECT_TRUE((table.wide_at(p) & bit(face)) != 0) << p.transpose();
    }
  }
  EXPECT_EQ(table.near_at(Vec3(0.0, 0.0, 0.0)), bit(Face::seat));
  EXPECT_EQ(table.near_at(Vec3(190.0, 0.0, 0.0)), bit(Face::top));
  EXPECT_EQ(table.near_at(Vec3(0.0, 116.0, 0.0)), 0) << "a bore returns nothing";
  EXPECT_EQ(table.near_at(Vec3(201.0, 0.0, 0.0)), 0);
  EXPECT_EQ(table.near_at(Vec3(kNoValue, 0.0, 0.0)), 0);
}

}  // namespace
}  // namespace slabd::algo
