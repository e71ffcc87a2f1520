// SPDX-License-Identifier: Apache-2.0
//
// The survey computes everything in one pass in floats. Here every result is compared with the plain method: region by
// region, in double, with as many passes as needed.
#include "algo/survey/survey.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "algo/features/plane_fit.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

/// The part of the inspector's memory that the survey needs.
struct Bench {
  Recipe recipe = scene::p5600();
  BlockModel model;
  FaceTable faces;
  SurveyTable table;
  std::vector<std::uint16_t> wide = std::vector<std::uint16_t>(FaceTable::kCells);
  std::vector<std::uint16_t> near = wide;
  std::vector<std::uint16_t> scratch = wide;
  std::vector<std::uint32_t> cells = std::vector<std::uint32_t>(SurveyTable::kCells);
  std::vector<float> memory = std::vector<float>(3 * PointPool::kPiece * limits::kSurveyPiecesMax);
  std::vector<std::uint32_t> next = std::vector<std::uint32_t>(limits::kSurveyPiecesMax);
  std::vector<std::uint32_t> count = next;
  std::vector<SurveySums> blocks = std::vector<SurveySums>(limits::kSurveyBlocksMax);
  std::vector<SeatPoints> runs = std::vector<SeatPoints>(limits::kSurveyPiecesMax);
  std::array<std::vector<std::int64_t>, 2> map_sum;
  std::array<std::vector<std::uint32_t>, 2> map_count;
  std::array<PlaneStart, kLargeFaces> start;
  PointPool pool{memory, next, count};

  Bench() {
    for (auto& m : map_sum) m.resize(limits::kDeviationMapCells);
    for (auto& m : map_count) m.resize(limits::kDeviationMapCells);
    model.build(recipe.block);
    faces.build(model, wide, near, scratch);
    table.build(model, faces, recipe.evaluation, cells);
  }

  MapSums map(std::size_t i) {
    return {std::span(map_sum[i]).first(limits::kDeviationMapCells),
            std::span(map_count[i]).first(limits::kDeviationMapCells)};
  }
  Survey run(const Cloud& cloud, const Pose& T_block_scanner, int threads = 1) {
    Team team(threads);
    Survey survey;
    survey_scan(cloud, {model, table, recipe.evaluation, T_block_scanner, {}},
                {pool, blocks, runs, {map(0), map(1)}, start}, team, survey);
    return survey;
  }
};

/// All results of the survey, computed in the plain way.
struct Plain {
  std::vector<std::uint8_t> label;
  std::vector<std::uint32_t> order;
  Segments segments;
  FastTransform transform;
  const float* xyz;
  std::vector<double> distances;

  Plain(Bench& bench, const Cloud& cloud, const Pose& T_block_scanner)
      : label(cloud.points), order(cloud.points), transform(T_block_scanner), xyz(cloud.xyz.data()) {
    segments = segment(cloud, bench.model, bench.recipe.evaluation, transform, label, order);
    for (std::size_t i = 0; i < cloud.points; ++i) {
      const Vec3 p = transform(xyz + 3 * i);
      Face face = Face::seat;
      double r = 0.0;
      if (closest_face(bench.model.planes(), bench.faces.near_at(p), p, face, r) &&
          std::abs(r) < bench.recipe.evaluation.registration_gate_mm)
        distances.push_back(r);
    }
  }
  [[nodiscard]] PlaneFit fit(std::span<const std::uint32_t> index, const Vec3& up) const {
    return fit_plane_over(CloudPoints{xyz, index, transform}, up, PlaneSettings{});
  }
};

/// Points that may change sides, because they are within float rounding of a border.
constexpr double kAtBorders = 3.0;

void expect_same_regions(const Survey& survey, const Plain& plain) {
  const auto expect_near = [](std::uint64_t got, std::size_t want, const char* what) {
    EXPECT_NEAR(static_cast<double>(got), static_cast<double>(want), kAtBorders) << what;
  };
  const auto size = [&](Region region) { return plain.segments.of(region).size(); };
  expect_near(survey.of(PointList::seat_crop).size(), size(Region::seat_crop), "crop");
  expect_near(survey.of(PointList::seat_off).size(), size(Region::seat_off), "off the seat");
  expect_near(survey.of(PointList::jaw_inner).size(), size(Region::jaw_inner), "inner jaw");
  expect_near(survey.of(PointList::jaw_outer).size(), size(Region::jaw_outer), "outer jaw");
  expect_near(survey.of(PointList::casing_inner).size(), size(Region::casing_inner), "inner casing");
  expect_near(survey.of(PointList::casing_outer).size(), size(Region::casing_outer), "outer casing");
  expect_near(survey.points_off(0), size(Region::jaw_off_inner), "in place of the inner jaw");
  expect_near(survey.points_off(1), size(Region::jaw_off_outer), "in place of the outer jaw");
  expect_near(survey.large[0].points, plain.segments.full_seat().size(), "seat");
  expect_near(survey.large[1].points, size(Region::top), "top");
}

void expect_same_statistics(const Survey& survey, const Plain& plain) {
  const auto n = static_cast<double>(plain.distances.size());
  double mean = 0.0;
  for (const double r : plain.distances) mean += r / n;
  double squares = 0.0;
  for (const double r : plain.distances) squares += (r - mean) * (r - mean);
  const double sigma = std::sqrt(squares / (n - 1.0));
  // A point at the gate or between two cells may be counted differently.
  EXPECT_NEAR(static_cast<double>(survey.deviation.count), n, 3.0);
  EXPECT_NEAR(survey.deviation.mean_mm, mean, 1e-5);
  EXPECT_NEAR(survey.deviation.std_mm, sigma, 1e-5);
  for (std::size_t k = 0; k < 6; ++k) {
    const auto within = std::count_if(plain.distances.begin(), plain.distances.end(),
                                      [&](double r) { return std::abs(r) <= static_cast<double>(k + 1) * sigma; });
    EXPECT_NEAR(survey.deviation.within_sigma[k], static_cast<double>(within) / n, 3e-4) << k + 1 << " sigma";
  }
}

/// Expects that `listed` has the points of `index` in their order, to the precision of floats.
void expect_same_points(const ListedPoints& listed, const Plain& plain, Region region) {
  const auto index = plain.segments.of(region);
  std::size_t i = 0;
  std::size_t odd = 0;
  for (std::size_t k = 0; k < index.size(); ++k) {
    const Vec3 q = plain.transform(plain.xyz + 3 * std::size_t{index[k]});
    if (i < listed.size() && (listed[i] - q).norm() < 1e-4)
      ++i;
    else if (i + 1 < listed.size() && (listed[i + 1] - q).norm() < 1e-4)
      i += 2, ++odd;
    else
      ++odd;
  }
  EXPECT_LE(odd, static_cast<std::size_t>(kAtBorders));
  EXPECT_NEAR(static_cast<double>(i), static_cast<double>(listed.size()), kAtBorders);
}

void expect_same_plane(const char* face, const PlaneFit& fit, const PlaneFit& want) {
  SCOPED_TRACE(face);
  ASSERT_TRUE(want.ok) << want.iterations << " " << want.inliers << " of " << want.points << " " << want.std_mm;
  ASSERT_TRUE(fit.ok) << fit.iterations << " " << fit.inliers << " of " << fit.points << " " << fit.std_mm;
  // The threshold comes from another sample: one point in a hundred may differ, which moves the plane within its
  // uncertainty.
  EXPECT_NEAR(fit.offset_mm, want.offset_mm, 2.0 * want.sigma_offset_mm + 1e-5);
  EXPECT_NEAR(static_cast<double>(fit.points), static_cast<double>(want.points), kAtBorders);
  EXPECT_LT((fit.normal - want.normal).norm(), 2.0 * std::sqrt(want.cov_normal.trace()) + 1e-8);
  EXPECT_NEAR(fit.std_mm, want.std_mm, 0.02 * want.std_mm);
}

TEST(Survey, finds_what_the_plain_way_finds) {
  Bench bench;
  struct View {
    double focus_mm;
    bool wide;  ///< wider than the table, and longer
  };
  for (const View& view : {View{0.0, false}, View{900.0, false}, View{0.0, true}}) {
    const double focus_mm = view.focus_mm;
    scene::Scan scan;
    scan.organised = focus_mm > 0.0 || view.wide;
    scan.focus_mm = focus_mm;
    if (view.wide) {
      scan.field_x_mm = 447.0;
      scan.field_y_mm = 643.0;
    }
    // As after denoising; the planes' doubts treat many single points as a second surface.
    scan.outlier_share = 0.0;
    scan.displacement = scene::displaced(2.0, -1.5, 1.0, 0.3, -0.2, 0.4);
    scene::Cloud drawn = scene::take(scene::Block{}, scan);
    const Cloud cloud = drawn.view();
    const Survey survey = bench.run(cloud, drawn.T_block_scanner);
    const Plain plain(bench, cloud, drawn.T_block_scanner);
    expect_same_regions(survey, plain);
    expect_same_statistics(survey, plain);
    expect_same_points(survey.of(PointList::seat_crop), plain, Region::seat_crop);
    expect_same_points(survey.of(PointList::jaw_inner), plain, Region::jaw_inner);
    expect_same_points(survey.of(PointList::casing_outer), plain, Region::casing_outer);
    const auto index = plain.segments.full_seat();
    expect_same_plane("seat", survey.large[0], plain.fit(index, bench.model.plane(Face::seat).n));
    expect_same_plane("slab top", survey.large[1], plain.fit(plain.segments.of(Region::top), Vec3::UnitZ()));
    // From one point above the middle the jaws are not visible.
    if (focus_mm == 0.0)
      expect_same_plane("outer jaw",
                        fit_plane_over(survey.of(PointList::jaw_outer), bench.model.plane(Face::jaw_outer).n, {}),
                        plain.fit(plain.segments.of(Region::jaw_outer), bench.model.plane(Face::jaw_outer).n));
  }
}

TEST(Survey, accepts_points_in_any_order) {
  Bench bench;
  scene::Scan scan;
  scan.pitch_mm = 0.8;
  scene::Cloud drawn = scene::take(scene::Block{}, scan);
  const Cloud cloud = drawn.view();
  Prng prng(7);
  for (std::size_t i = cloud.points - 1; i > 0; --i)
    std::swap_ranges(drawn.xyz.begin() + static_cast<std::ptrdiff_t>(3 * i),
                     drawn.xyz.begin() + static_cast<std::ptrdiff_t>(3 * i + 3),
                     drawn.xyz.begin() + static_cast<std::ptrdiff_t>(3 * prng.below(i)));
  // A few points that are missing, incomplete or far too large.
  for (int i = 0; i < 200; ++i) drawn.xyz[prng.below(drawn.xyz.size())] = std::numeric_limits<float>::quiet_NaN();
  for (int i = 0; i < 200; ++i) drawn.xyz[prng.below(drawn.xyz.size())] = std::numeric_limits<float>::infinity();
  for (int i = 0; i < 200; ++i) drawn.xyz[prng.below(drawn.xyz.size())] = -3e38F;
  const Survey survey = bench.run(cloud, drawn.T_block_scanner);
  const Plain plain(bench, cloud, drawn.T_block_scanner);
  expect_same_regions(survey, plain);
  expect_same_statistics(survey, plain);
}

TEST(Survey, returns_the_same_on_two_threads) {
  Bench bench;
  scene::Cloud drawn = scene::take(scene::Block{}, scene::Scan{});
  const Survey one = bench.run(drawn.view(), drawn.T_block_scanner, 1);
  const auto map_one = bench.map_sum[0];
  const Vec3 last_one = one.of(PointList::seat_crop)[one.of(PointList::seat_crop).size() - 1];
  const Survey two = bench.run(drawn.view(), drawn.T_block_scanner, 2);
  EXPECT_EQ(one.deviation.std_mm, two.deviation.std_mm);
  EXPECT_EQ(one.deviation.within_sigma, two.deviation.within_sigma);
  for (std::size_t i = 0; i < kLargeFaces; ++i) {
    EXPECT_EQ(one.large[i].normal, two.large[i].normal);
    EXPECT_EQ(one.large[i].offset_mm, two.large[i].offset_mm);
  }
  EXPECT_EQ(map_one, bench.map_sum[0]);
  EXPECT_EQ(last_one, two.of(PointList::seat_crop)[two.of(PointList::seat_crop).size() - 1]);
}

TEST(Survey, maps_a_dent_where_it_is) {
  Bench bench;
  scene::Block block;
  block.bump_mm = -0.4;
  block.bump_radius_mm = 12.0;
  scene::Cloud drawn = scene::take(block, scene::Scan{});
  (void)bench.run(drawn.view(), drawn.T_block_scanner);
  const DeviationMap map{limits::kFaceTableX / limits::kDeviationMapCell_mm,
                         limits::kFaceTableY / limits::kDeviationMapCell_mm,
                         static_cast<double>(limits::kDeviationMapCell_mm), bench.map_sum[0], bench.map_count[0]};
  int dented = 0;
  for (std::size_t row = 0; row < map.rows; ++row)
    for (std::size_t column = 0; column < map.columns; ++column) {
      const double from = std::hypot(map.x_mm(column) - block.bump_x_mm, map.y_mm(row) - block.bump_s_mm);
      const std::size_t cell = row * map.columns + column;
      if (from < 9.0 && map.count[cell] > 0) {
        ++dented;
        EXPECT_NEAR(map.mean_mm(cell), -0.4, 0.1);
      }
      if (from > 16.0 && from < 30.0 && map.count[cell] > 0) {
        EXPECT_NEAR(map.mean_mm(cell), 0.0, 0.1);
      }
    }
  EXPECT_GT(dented, 8);
}

// 512 points in a row, and every 32nd sixteen: one per row, the same in all rows if each block begins with it.
TEST(Survey, scouts_all_of_a_face_whatever_the_width_of_the_scan) {
  Bench bench;
  scene::Scan scan;
  scan.organised = true;
  scan.field_x_mm = 409.6;
  scan.pitch_mm = 0.8;
  scan.pitch_ratio = 0.25;
  scan.field_y_mm = 502.0;
  scene::Cloud drawn = scene::take(scene::Block{}, scan);
  ASSERT_EQ(drawn.width, 512U);
  ASSERT_EQ(drawn.view().points / 40'000, 32U) << "no such scan any more";
  const Survey survey = bench.run(drawn.view(), drawn.T_block_scanner);
  for (const LargeFace face : {LargeFace::seat, LargeFace::top}) {
    const PlaneFit& fit = survey.large[static_cast<std::size_t>(face)];
    EXPECT_TRUE(fit.ok) << static_cast<int>(face) << ", " << fit.inliers;
  }
}

// The last position below the edge of the field rounds to the edge when half of the field is added.
TEST(Survey, maps_points_at_the_edge_of_the_field_within_it) {
  const float x_max = std::nextafter(200.0F, 0.0F);
  const float y_max = std::nextafter(300.0F, 0.0F);
  const struct {
    float x, y;
    std::size_t column, row;
  } places[] = {{10.0F, y_max, 52, 149},  {10.0F, -y_max, 52, 0},  {x_max, 290.0F, 99, 147},
                {-x_max, 290.0F, 0, 147}, {x_max, y_max, 99, 149}, {-x_max, -y_max, 0, 0}};
  for (const auto& place : places) {
    Bench bench;
    constexpr std::size_t kGuard = 200;
    for (auto& m : bench.map_sum) m.resize(limits::kDeviationMapCells + kGuard);
    for (auto& m : bench.map_count) m.resize(limits::kDeviationMapCells + kGuard);
    std::vector<float> xyz;
    Face face = Face::seat;
    double z = 0.0;
    ASSERT_TRUE(bench.model.visible(static_cast<double>(place.x), static_cast<double>(place.y), face, z));
    for (int i = 0; i < 64; ++i) xyz.insert(xyz.end(), {place.x, place.y, static_cast<float>(z)});
    (void)bench.run({xyz, 64, 0, 0}, Pose::identity());
    const auto& count = bench.map_count[0];
    const std::size_t columns = limits::kFaceTableX / limits::kDeviationMapCell_mm;
    for (std::size_t cell = 0; cell < count.size(); ++cell)
      EXPECT_EQ(count[cell], cell == place.row * columns + place.column ? 4U : 0U)
          << "cell " << cell << " for (" << place.x << ", " << place.y << ")";
  }
}

TEST(Survey, is_empty_without_points) {
  Bench bench;
  std::vector<float> xyz(3 * 70'000, std::numeric_limits<float>::quiet_NaN());
  const Survey survey = bench.run({xyz, 70'000, 0, 0}, Pose::identity());
  EXPECT_EQ(survey.deviation.count, 0U);
  EXPECT_FALSE(survey.large[0].ok);
  EXPECT_FALSE(survey.large[1].ok);
  EXPECT_EQ(survey.of(PointList::seat_crop).size(), 0U);
}

TEST(Survey, owns_up_to_a_lack_of_room) {
  Bench bench;
  // Far more points over the crop than in any scan of a block.
  std::vector<float> xyz;
  Prng prng(3);
  for (std::size_t i = 0; i < 2'500'000; ++i)
    for (const double v : {100.0 * prng.uniform() - 50.0, 140.0 * prng.uniform() - 70.0, 50.0 + prng.uniform()})
      xyz.push_back(static_cast<float>(v));
  EXPECT_TRUE(bench.run({xyz, xyz.size() / 3, 0, 0}, Pose::identity()).overflown);
}

}  // namespace
}  // namespace slabd::algo
