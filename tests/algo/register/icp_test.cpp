// SPDX-License-Identifier: Apache-2.0
//
// The passes of an ICP step against a plain loop over points, in double, one point at a time.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <tuple>
#include <vector>

#include "algo/algo.h"
#include "algo/register/icp.h"
#include "algo/register/icp_kernels.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kPoints = 2048;

/// Points on and off the nominal block, with missing ones, strays and infinities, and a slightly wrong pose.
struct Scene {
  Scene() {
    model.build(scene::p5600().block);
    table.build(model, wide, near, scratch);
    Prng prng(11);
    for (std::size_t i = 0; i < kPoints; ++i) {
      const double px = 420.0 * (prng.uniform() - 0.5);
      const double py = 620.0 * (prng.uniform() - 0.5);
      Face face = Face::seat;
      double pz = 0.0;
      if (!model.visible(px, py, face, pz)) pz = -500.0;
      pz += 0.05 * prng.normal();
      x[i] = static_cast<float>(px);
      y[i] = static_cast<float>(py);
      z[i] = static_cast<float>(pz);
      if (i % 97 == 0) x[i] = y[i] = z[i] = std::numeric_limits<float>::quiet_NaN();
      if (i % 101 == 0) x[i] = std::numeric_limits<float>::infinity();
      if (i % 103 == 0) z[i] = 1e30F;
    }
    const Pose pose = scene::displaced(0.3, -0.2, 0.05, 0.02, -0.03, 0.05);
    view.R = pose.rotation.toRotationMatrix();
    view.t = pose.translation_mm;
    for (std::size_t f = 0; f < kFaces; ++f) {
      const Plane& plane = model.planes()[f];
      view.slopes[f] = {view.R.transpose() * plane.n, plane.n.dot(view.t) - plane.d};
    }
    sample = {x, y, z, Vec3::Zero()};
  }
  [[nodiscard]] Vec3 moved(std::size_t i) const {
    return view.R * Vec3(static_cast<double>(x[i]), static_cast<double>(y[i]), static_cast<double>(z[i])) + view.t;
  }

  BlockModel model;
  FaceTable table;
  std::vector<std::uint16_t> wide = std::vector<std::uint16_t>(FaceTable::kCells);
  std::vector<std::uint16_t> near = wide;
  std::vector<std::uint16_t> scratch = wide;
  std::vector<float> x = std::vector<float>(kPoints);
  std::vector<float> y = x;
  std::vector<float> z = x;
  IcpView view;
  IcpSample sample;
};

/// Sums of a plain loop over points of a face at distance r.
void add_plain(FaceSums& sums, double x, double y, double z, double w, double v) {
  const std::array<double, FaceSums::kCount> one = {w,         w * x,     w * y,     w * z,     w * x * x,
                                                    w * x * y, w * x * z, w * y * y, w * y * z, w * z * z,
                                                    v,         v * x,     v * y,     v * z,     1.0};
  for (std::size_t k = 0; k < FaceSums::kCount; ++k) sums.s[k] += one[k];
}

/// Floats of up to 512 points have an error of 1e-6 of the sum of magnitudes; one point may be on the edge of a cell.
void expect_near(const SumsOfFaces& fast, const SumsOfFaces& plain) {
  for (std::size_t f = 0; f < kFaces; ++f) {
    EXPECT_EQ(fast[f].s[FaceSums::points], plain[f].s[FaceSums::points]) << name(static_cast<Face>(f));
    const double n = plain[f].s[FaceSums::points];
    for (std::size_t k = 0; k < FaceSums::points; ++k) {
      const double lever = k == FaceSums::w || k == FaceSums::v   ? 1.0
                           : k < FaceSums::wxx || k > FaceSums::v ? 300.0
                                                                  : 9e4;
      EXPECT_NEAR(fast[f].s[k], plain[f].s[k], 1e-4 * lever * std::max(n, 1.0))
          << name(static_cast<Face>(f)) << ", sum " << k;
      EXPECT_TRUE(std::isfinite(fast[f].s[k]));
    }
  }
}

TEST(IcpPasses, coarse_sums_are_those_of_a_plain_loop) {
  Scene s;
  s.view.cells = s.table.wide();
  constexpr double kGate = 6.0;
  SumsOfFaces fast{};
  sum_closest(s.sample, s.view, kGate, fast);
  SumsOfFaces plain{};
  for (std::size_t i = 0; i < kPoints; ++i) {
    Face face = Face::seat;
    double r = 0.0;
    const Vec3 p = s.moved(i);
    if (!p.allFinite() || !closest_face(s.model.planes(), s.table.wide_at(p), p, face, r) || !(std::abs(r) < kGate))
      continue;
    const double w = std::pow(1.0 - r * r / (kGate * kGate), 2);
    add_plain(plain[static_cast<std::size_t>(face)], static_cast<double>(s.x[i]), static_cast<double>(s.y[i]),
              static_cast<double>(s.z[i]), w, w * r);
  }
  expect_near(fast, plain);
  EXPECT_GT(plain[0].s[FaceSums::points], 300.0);
}

TEST(IcpPasses, association_counts_and_fine_sums_are_those_of_a_plain_loop) {
  Scene s;
  s.view.cells = s.table.near();
  constexpr double kGate = 3.0;
  constexpr double kLast = 0.4;
  std::vector<std::uint8_t> face(kPoints);
  std::vector<float> distance(kPoints);
  std::vector<std::uint16_t> groups(kPoints / 16);
  const Association to{face, distance, groups};
  FaceCounts counts;
  count_and_associate(s.sample, s.view, kGate, to, counts);
  Slopes still{};
  SumsOfFaces fast{};
  sum_associated(s.sample, to, still, kLast, Weights::newton, {}, fast);
  std::vector<float> sizes(kPoints);
  magnitudes(s.sample, to, still, kLast, sizes);

  FaceCounts plain;
  SumsOfFaces sums{};
  std::size_t within = 0;
  for (std::size_t i = 0; i < kPoints; ++i) {
    const Vec3 p = s.moved(i);
    Face f = Face::seat;
    double r = 0.0;
    std::uint8_t expected = kNoFace;
    if (p.allFinite() && FaceTable::inside(p)) {
      ++plain.in_field;
      const std::uint16_t seen = s.table.near_at(p);
      if (closest_face(s.model.planes(), seen, p, f, r)) {
        const auto k = static_cast<std::size_t>(f);
        plain.near_model += std::abs(r) <= kGate ? 1U : 0U;
        if (std::has_single_bit(seen)) {
          ++plain.expected[k];
          if (std::abs(r) < kGate) {
            ++plain.found[k];
            plain.sum_mm[k] += r;
            plain.sum_mm2[k] += r * r;
            expected = static_cast<std::uint8_t>(f);
          }
        }
      }
    }
    EXPECT_EQ(face[i], expected) << i;
    if (expected == kNoFace) {
      EXPECT_TRUE(std::isnan(distance[i]));
    } else {
      EXPECT_NEAR(static_cast<double>(distance[i]), r, 1e-6);
    }
    const bool takes_part = expected != kNoFace && std::abs(r) < kLast;
    EXPECT_EQ(std::isfinite(sizes[i]), takes_part) << i;
    if (!takes_part) continue;
    ++within;
    const double u2 = r * r / (kLast * kLast);
    add_plain(sums[expected], static_cast<double>(s.x[i]), static_cast<double>(s.y[i]), static_cast<double>(s.z[i]),
              (1.0 - u2) * (1.0 - 5.0 * u2), r * (1.0 - u2) * (1.0 - u2));
  }
  EXPECT_EQ(counts.in_field, plain.in_field);
  EXPECT_EQ(counts.near_model, plain.near_model);
  EXPECT_EQ(counts.expected, plain.expected);
  EXPECT_EQ(counts.found, plain.found);
  for (std::size_t f = 0; f < kFaces; ++f) {
    EXPECT_NEAR(counts.sum_mm[f], plain.sum_mm[f], 1e-4);
    EXPECT_NEAR(counts.sum_mm2[f], plain.sum_mm2[f], 1e-4);
  }
  expect_near(fast, sums);
  EXPECT_EQ(count_up_to(sizes, std::numeric_limits<float>::max()), within);
  EXPECT_GT(within, 500U);
}

TEST(IcpPasses, sorting_keeps_every_point_and_brings_faces_together) {
  Scene s;
  s.view.cells = s.table.near();
  std::vector<float> memory(kSampleFloats);
  std::vector<std::uint8_t> keys(kPoints);
  Team team(1);
  const IcpSample sorted = sort_by_face(s.sample, s.view, memory, keys, team);
  const auto bits_of = [](const IcpSample& sample) {
    std::vector<std::array<std::uint32_t, 3>> all;
    for (std::size_t i = 0; i < sample.size(); ++i)
      all.push_back({std::bit_cast<std::uint32_t>(sample.x[i]), std::bit_cast<std::uint32_t>(sample.y[i]),
                     std::bit_cast<std::uint32_t>(sample.z[i])});
    std::sort(all.begin(), all.end());
    return all;
  };
  EXPECT_EQ(bits_of(sorted), bits_of(s.sample));
  std::vector<std::uint8_t> face(kPoints);
  std::vector<float> distance(kPoints);
  std::vector<std::uint16_t> groups(kPoints / 16);
  FaceCounts counts;
  count_and_associate(sorted, s.view, 3.0, {face, distance, groups}, counts);
  std::size_t mixed = 0;
  for (const std::uint16_t g : groups) mixed += std::popcount(g) > 1 ? 1U : 0U;
  EXPECT_LE(mixed, kFaces) << "each face ends in the middle of sixteen points once";
}

TEST(IcpPasses, sort_keys_are_those_of_a_plain_loop) {
  Scene s;
  s.view.cells = s.table.near();
  std::vector<std::uint8_t> keys(kPoints);
  sort_keys(s.sample, s.view, keys);
  std::array<std::size_t, 3> seen{};
  std::size_t differ = 0;
  for (std::size_t i = 0; i < kPoints; ++i) {
    const Vec3 p = s.moved(i);
    const unsigned faces = p.allFinite() ? s.table.near_at(p) : 0U;
    const int number = static_cast<int>(std::bit_width(faces)) - 1;
    const int few = std::min(std::popcount(faces), 2);
    const int key = few == 0 ? 2 * static_cast<int>(kFaces) : few == 1 ? number : number + static_cast<int>(kFaces);
    ++seen[static_cast<std::size_t>(few)];
    differ += keys[i] == key ? 0U : 1U;
  }
  EXPECT_LE(differ, 1U) << "one point may stand on the edge of a cell";
  for (const std::size_t points : seen) EXPECT_GT(points, 50U);
}

TEST(Icp, sorted_or_as_drawn_the_passes_come_to_the_same) {
  Scene s;
  // Enough points that both threads have blocks to sort, in the first part too.
  constexpr std::size_t kTimes = 40;
  static_assert(kTimes * kPoints >= limits::kIcpPointsMax && limits::kIcpPointsMax / kSampleParts > kIcpBlock);
  std::vector<float> xyz;
  for (std::size_t i = 0; i < kTimes * kPoints; ++i)
    for (const auto* c : {&s.x, &s.y, &s.z}) xyz.push_back((*c)[i % kPoints]);
  const EvaluationSettings settings = scene::p5600().evaluation;
  std::vector<float> points(kSampleFloats);
  std::vector<float> distances(2 * limits::kIcpPointsMax);
  std::vector<std::uint8_t> labels(2 * limits::kIcpPointsMax);
  for (const int threads : {1, 2}) {
    Team team(threads);
    const Pose start = scene::displaced(0.3, -0.2, 0.05, 0.02, -0.03, 0.05);
    Icp icp(s.model, s.table, settings, {xyz, kTimes * kPoints, 0, 0}, start, {points, distances, labels}, team);
    const auto counted = [](const FaceCounts& c) { return std::tuple(c.in_field, c.near_model, c.expected, c.found); };
    const auto coarse = counted(icp.coarse_counts(start));
    const auto whole = counted(icp.counts(start));
    Pose plain = start;
    NormalEquations eq;
    const double plain_mm = icp.coarse_step(plain, 6.0, eq);
    ASSERT_GT(plain_mm, 0.01);
    // Each undoes the other, in any order.
    for (const bool first_part : {true, false, true, true, false, false}) {
      if (first_part)
        icp.sort_first_part(start);
      else
        icp.sort(start);
      EXPECT_EQ(counted(icp.coarse_counts(start)), coarse) << first_part;
      EXPECT_EQ(counted(icp.counts(start)), whole) << first_part;
      Pose pose = start;
      EXPECT_NEAR(icp.coarse_step(pose, 6.0, eq), plain_mm, 1e-5) << first_part;
      EXPECT_LT(Icp::length_mm(pose * plain.inverse()), 1e-5) << first_part;
    }
  }
}

TEST(IcpSample, takes_every_part_from_the_whole_scan_and_skips_what_is_missing) {
  // x counts the points; every second run of 40 is missing.
  constexpr std::size_t kScan = 1'000'003;
  std::vector<float> xyz(3 * kScan);
  for (std::size_t i = 0; i < kScan; ++i) {
    const bool missing = i / 40 % 2 == 1;
    for (std::size_t k = 0; k < 3; ++k)
      xyz[3 * i + k] = missing ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(i);
  }
  std::vector<float> memory(kSampleFloats);
  Team team(1);
  const IcpSample sample = draw_sample({xyz, kScan, 0, 0}, Vec3(100.2, 100.0, 99.9), memory, team);
  ASSERT_EQ(sample.size(), limits::kIcpPointsMax);
  const std::size_t part = sample.size() / kSampleParts;
  for (std::size_t p = 0; p < kSampleParts; ++p) {
    std::size_t there = 0;
    double last = -1.0;
    for (std::size_t i = p * part; i < (p + 1) * part; ++i) {
      if (std::isnan(sample.x[i])) continue;
      ++there;
      const double number = static_cast<double>(sample.x[i]) + 100.0;
      EXPECT_GT(number, last);
      last = number;
      EXPECT_EQ(sample.x[i], sample.y[i]);
      const SliceOfScan slice = slice_of({xyz, kScan, 0, 0}, sample, i);
      EXPECT_LE(slice.first, static_cast<std::size_t>(number));
      EXPECT_LT(static_cast<std::size_t>(number), slice.first + slice.points);
      EXPECT_LE(slice.points, kScan / sample.size() + 1);
    }
    EXPECT_GT(there, part / 2);
    EXPECT_GT(last, 0.99 * static_cast<double>(kScan));
  }
}

/// The sample by definition: slice by slice, in the order of the scan.
std::vector<Vec3> plainly_drawn(std::span<const float> xyz, std::size_t points, const Vec3& shift) {
  constexpr std::size_t kRow = 16 * kSampleParts;
  constexpr std::size_t kBlocks = 16;
  const std::size_t slices = std::min(points, limits::kIcpPointsMax);
  const std::size_t rows = (slices + kRow - 1) / kRow;
  const std::size_t part = rows * 16;
  std::vector<Vec3> drawn(rows * kRow, Vec3::Constant(std::numeric_limits<double>::quiet_NaN()));
  for (std::size_t block = 0; block < kBlocks; ++block) {
    Prng prng(0x5eedU + block);
    for (std::size_t i = block * rows / kBlocks * kRow; i < std::min((block + 1) * rows / kBlocks * kRow, slices);
         ++i) {
      const std::size_t first = i * points / slices;
      const std::size_t last = (i + 1) * points / slices;
      const std::size_t at = first + (((prng.next() >> 32U) * (last - first)) >> 32U);
      for (std::size_t k = at; k < std::min(last, at + 16); ++k) {
        const Vec3 p(xyz[3 * k], xyz[3 * k + 1], xyz[3 * k + 2]);
        if (!p.allFinite()) continue;
        drawn[i % kSampleParts * part + i / kSampleParts] = p - shift;
        break;
      }
    }
  }
  return drawn;
}

TEST(IcpSample, is_what_a_plain_loop_draws_on_one_thread_and_on_two) {
  for (const std::size_t points :
       {std::size_t{1}, std::size_t{127}, std::size_t{128}, std::size_t{1500}, std::size_t{65'535}, std::size_t{65'536},
        std::size_t{65'537}, std::size_t{300'001}}) {
    // Integers, so that floats are exact; every second run of 40 and the end are missing.
    std::vector<float> xyz(3 * points);
    for (std::size_t i = 0; i < points; ++i) {
      const bool missing = i / 40 % 2 == 1 || i + 7 > points;
      xyz[3 * i] = static_cast<float>(i);
      xyz[3 * i + 1] = missing ? std::numeric_limits<float>::infinity() : static_cast<float>(2 * i);
      xyz[3 * i + 2] = static_cast<float>(i % 100);
    }
    const Vec3 shift(100.0, 50.0, -20.0);
    const std::vector<Vec3> plain = plainly_drawn(xyz, points, shift);
    for (const int threads : {1, 2}) {
      std::vector<float> memory(kSampleFloats, 7.0F);
      Team team(threads);
      const IcpSample sample = draw_sample({xyz, points, 0, 0}, shift, memory, team);
      ASSERT_EQ(sample.size(), plain.size());
      std::size_t different = 0;
      for (std::size_t i = 0; i < plain.size(); ++i) {
        const Vec3 p(sample.x[i], sample.y[i], sample.z[i]);
        different += p == plain[i] || (p.array().isNaN().all() && plain[i].array().isNaN().all()) ? 0U : 1U;
      }
      EXPECT_EQ(different, 0U) << points << " points, " << threads << " threads";
    }
  }
}

}  // namespace
}  // namespace slabd::algo
