// SPDX-License-Identifier: Apache-2.0
//
// A scan without its grid: the fast method with notes and blocks against the plain one, point by point.
#include "algo/denoise/lattice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "algo/denoise/denoise.h"
#include "algo/denoise/denoise_grid.h"
#include "algo/denoise/point_buckets.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

struct Memory {
  std::vector<std::uint32_t> order = std::vector<std::uint32_t>(limits::kScanPointsMax);
  std::vector<std::uint8_t> keep = std::vector<std::uint8_t>(limits::kScanPointsMax);
  std::vector<std::uint32_t> cells = std::vector<std::uint32_t>(limits::kDenoiseCellsMax + 1);
  std::vector<TilePlane> surface = std::vector<TilePlane>(limits::kDenoiseCellsMax);
  [[nodiscard]] DenoiseWorkspace work() { return {order, keep, cells, surface}; }
};

Cloud view(std::vector<float>& xyz) {
  return {xyz, xyz.size() / 3, 0, 0};
}

bool find(std::vector<float>& xyz, int threads, Lattice& lattice) {
  std::vector<float> memory(kLatticeFloats);
  Team team(threads);
  return find_lattice(view(xyz), memory, team, lattice);
}

std::vector<float> scan(double focus_mm, double pitch_mm = 0.5) {
  scene::Scan scan;
  scan.pitch_mm = pitch_mm;
  scan.focus_mm = focus_mm;
  scan.outlier_share = 0.01;
  scan.outlier_far_mm = 5.0;
  scan.displacement = scene::displaced(2.0, -3.0, 0.0, 2.0, -1.0, 2.0);
  return scene::take({}, scan).xyz;
}

std::vector<float> shuffled(const std::vector<float>& xyz, std::uint64_t seed = 3) {
  std::vector<std::size_t> at(xyz.size() / 3);
  for (std::size_t i = 0; i < at.size(); ++i) at[i] = i;
  Prng prng(seed);
  for (std::size_t i = at.size(); i > 1; --i) std::swap(at[i - 1], at[prng.below(i)]);
  std::vector<float> out;
  for (const std::size_t i : at) out.insert(out.end(), {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]});
  return out;
}

std::vector<float> backwards(const std::vector<float>& xyz) {
  std::vector<float> out;
  for (std::size_t i = xyz.size() / 3; i-- > 0;) out.insert(out.end(), {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]});
  return out;
}

bool same(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

/// True if both have the same points, bit by bit, in any order. Slow, so it is used only for the first of results that
/// are equal bit by bit.
bool same_points(const std::vector<float>& a, const std::vector<float>& b) {
  const auto sorted = [](const std::vector<float>& xyz) {
    std::vector<std::array<std::uint32_t, 3>> points(xyz.size() / 3);
    std::memcpy(points.data(), xyz.data(), xyz.size() * sizeof(float));
    std::sort(points.begin(), points.end());
    return points;
  };
  return sorted(a) == sorted(b);
}

/// Adds invalid points at intervals: points that meet another one in its cell, missing and incomplete ones, and ones
/// outside the table. The total number is odd.
std::vector<float> with_nasty_points(const std::vector<float>& drawn, double focus) {
  const float infinite = std::numeric_limits<float>::infinity();
  std::vector<float> nasty;
  Prng prng(8);
  for (std::size_t i = 0; i < drawn.size(); i += 3) {
    const float* p = &drawn[i];
    nasty.insert(nasty.end(), p, p + 3);
    const double what = prng.uniform();
    if (what < 0.002) {
      const float z = p[2] + static_cast<float>(2.0 * prng.uniform() - 1.0);
      const float scale = focus > 0.0 ? z / p[2] : 1.0F;
      nasty.insert(nasty.end(), {p[0] * scale, p[1] * scale, z});
    } else if (what < 0.004) {
      nasty.insert(nasty.end(), {kNaN, kNaN, kNaN});
    } else if (what < 0.005) {
      nasty.insert(nasty.end(), {p[0], kNaN, p[2]});
    } else if (what < 0.006) {
      nasty.insert(nasty.end(), {p[0], p[1], infinite});
    } else if (what < 0.0063) {
      nasty.insert(nasty.end(), {p[0] + 1e4F, p[1], p[2]});
    } else if (what < 0.009) {
      nasty.insert(nasty.end(), {p[0], p[1], p[2]});
    }
  }
  for (int i = 0; i < 40; ++i) nasty.insert(nasty.end(), {kNaN, kNaN, kNaN});
  while (nasty.size() / 3 % 16 != 1) nasty.insert(nasty.end(), {drawn[0], drawn[1], drawn[2]});
  return nasty;
}

/// The plain version of denoise_lattice, point by point.
struct Plain {
  std::uint64_t finite = 0, taken = 0;

  void run(std::vector<float>& xyz, const Lattice& lattice, const DenoiseWorkspace& memory) {
    const auto columns = static_cast<std::size_t>(lattice.columns);
    const auto rows = static_cast<std::size_t>(lattice.rows);
    std::vector<float> table(columns * rows, kNaN);
    const auto cell_of = [&](const float* p, std::size_t& column, std::size_t& row) {
      const float c = std::floor(((lattice.central ? p[0] / p[2] : p[0]) - lattice.x0) * lattice.per_x);
      const float r = std::floor(((lattice.central ? p[1] / p[2] : p[1]) - lattice.y0) * lattice.per_y);
      if (!(c >= 0.0F && c < lattice.columns && r >= 0.0F && r < lattice.rows)) return false;
      column = static_cast<std::size_t>(c), row = static_cast<std::size_t>(r);
      return true;
    };
    const auto each = [&](auto&& f) {
      for (float* p = xyz.data(); p != xyz.data() + xyz.size(); p += 3)
        if (std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2])) f(p);
    };
    std::size_t c = 0, r = 0;
    each([&](float* p) {
      ++finite;
      if (!cell_of(p, c, r)) return;
      float& there = table[r * columns + c];
      if (!(there <= p[2])) there = p[2];
    });
    const GridLayout grid(columns, rows);
    GridWork judged(grid, nullptr, table.data(), memory);
    judged.per_column_mm = lattice.away_mm / lattice.per_x;
    judged.per_row_mm = lattice.away_mm / lattice.per_y;
    Team team(1);
    ASSERT_TRUE(judge_grid(grid, judged, team));
    keep_noise_groups(grid, judged, team);
    each([&](float* p) {
      bool noise = true;
      if (cell_of(p, c, r)) {
        const auto column = static_cast<int>(c), row = static_cast<int>(r);
        noise = ((judged.noise.tile(column / 16, row) >> (column % 16)) & 1U) != 0;
        if (p[2] != table[r * columns + c]) {
          noise = true;
          for (int i = 0; i < 2; ++i) {
            const TilePlane& plane = judged.planes(column / 16, row / 8)[i];
            const float z = plane.z + plane.per_column * (static_cast<float>(column % 16) - 7.5F) +
                            plane.per_row * (static_cast<float>(row % 8) - 3.5F);
            if (std::abs(p[2] - z) <= grid_gate_mm(plane.per_column, plane.per_row)) noise = false;
          }
        }
      }
      if (noise) ++taken, p[0] = p[1] = p[2] = kNaN;
    });
    for (std::size_t i = 0; i < xyz.size(); i += 3)
      if (!std::isfinite(xyz[i]) || !std::isfinite(xyz[i + 1]) || !std::isfinite(xyz[i + 2]))
        xyz[i] = xyz[i + 1] = xyz[i + 2] = kNaN;
  }
};

TEST(Lattice, is_the_same_in_whatever_order_the_points_come_and_on_two_threads) {
  for (const double focus : {0.0, 600.0}) {
    std::vector<float> xyz = scan(focus);
    std::vector<float> mixed = shuffled(xyz);
    Lattice one, two, other;
    ASSERT_TRUE(find(xyz, 1, one));
    ASSERT_TRUE(find(xyz, 2, two));
    ASSERT_TRUE(find(mixed, 2, other));
    EXPECT_EQ(one.central, focus > 0.0);
    EXPECT_NEAR(static_cast<double>(one.away_mm / one.per_x), 0.5, focus > 0.0 ? 0.05 : 1e-4);
    EXPECT_NEAR(static_cast<double>(one.away_mm / one.per_y), 0.5, focus > 0.0 ? 0.05 : 1e-4);
    EXPECT_TRUE(one == two);
    EXPECT_TRUE(one == other);
  }
}

TEST(Lattice, is_none_in_too_few_points_and_in_points_without_columns) {
  std::vector<float> few = {0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 0.0F};
  std::vector<float> one_place;
  std::vector<float> anywhere;
  std::vector<float> missing(3 * 40'000, kNaN);
  Prng prng(5);
  for (int i = 0; i < 40'000; ++i) {
    one_place.insert(one_place.end(), {1.0F, 2.0F, 600.0F});
    for (int k = 0; k < 3; ++k) anywhere.push_back(static_cast<float>(600.0 * prng.uniform()));
  }
  Lattice lattice;
  for (std::vector<float>* xyz : {&few, &one_place, &anywhere, &missing}) EXPECT_FALSE(find(*xyz, 1, lattice));
}

TEST(DenoiseLattice, keeps_what_the_plain_way_keeps) {
  Memory memory;
  for (const double focus : {0.0, 600.0}) {
    const std::vector<float> drawn = scan(focus);
    const std::vector<float> nasty = with_nasty_points(drawn, focus);
    const std::array<std::vector<float>, 4> scans = {drawn, nasty, backwards(nasty), shuffled(nasty)};
    for (const std::vector<float>& scan : scans) {
      std::vector<float> xyz = scan;
      Lattice lattice;
      ASSERT_TRUE(find(xyz, 1, lattice)) << focus;
      std::vector<float> plain = scan;
      Plain by_point;
      by_point.run(plain, lattice, memory.work());
      std::vector<float> first;
      for (const int threads : {1, 2}) {
        for (const InstructionSet set :
             {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2, InstructionSet::best}) {
          if (!limit_instruction_set(set)) continue;
          xyz = scan;
          Cloud cloud = view(xyz);
          Team team(threads);
          ScanCounts counts;
          ASSERT_TRUE(denoise_lattice(cloud, memory.work(), team, counts));
          EXPECT_EQ(counts.points_finite, by_point.finite);
          EXPECT_EQ(counts.isolated_removed, by_point.taken);
          EXPECT_EQ(counts.points_kept, by_point.finite - by_point.taken);
          if (first.empty()) {
            first = xyz;
            // Only the shuffled scan is brought into another order.
            EXPECT_TRUE(&scan == &scans.back() ? same_points(first, plain) : same(first, plain)) << focus << " mm";
          }
          EXPECT_TRUE(same(xyz, first)) << focus << " mm, " << threads << " threads";
        }
        ASSERT_TRUE(limit_instruction_set(InstructionSet::best));
      }
    }
  }
}

/// A cloud with spare capacity after its points. All instances share one memory, so use one at a time.
struct Roomy {
  std::vector<float>& xyz = memory();
  Cloud cloud;
  explicit Roomy(const std::vector<float>& points, std::size_t room = limits::kScanPointsMax) {
    xyz.assign(points.begin(), points.end());
    xyz.resize(3 * room, 7.0F);
    cloud = {xyz, points.size() / 3, 0, 0};
  }
  static std::vector<float>& memory() {
    static std::vector<float> memory;
    return memory;
  }
  [[nodiscard]] std::vector<float> all() const {
    return {xyz.begin(), xyz.begin() + static_cast<std::ptrdiff_t>(3 * cloud.points)};
  }
};

bool is_finite(const float* p) {
  return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}
std::vector<float> finite_ones(const std::vector<float>& xyz) {
  std::vector<float> out;
  for (std::size_t i = 0; i < xyz.size(); i += 3)
    if (is_finite(&xyz[i])) out.insert(out.end(), &xyz[i], &xyz[i] + 3);
  return out;
}

/// Number of a point's cell; -1 if it has none.
std::ptrdiff_t cell_of(const Lattice& lattice, const float* p) {
  const float c = std::floor(((lattice.central ? p[0] / p[2] : p[0]) - lattice.x0) * lattice.per_x);
  const float r = std::floor(((lattice.central ? p[1] / p[2] : p[1]) - lattice.y0) * lattice.per_y);
  if (!(c >= 0.0F && c < lattice.columns && r >= 0.0F && r < lattice.rows)) return -1;
  return static_cast<std::ptrdiff_t>(r) * static_cast<std::ptrdiff_t>(lattice.columns) + static_cast<std::ptrdiff_t>(c);
}

TEST(DenoiseLattice, keeps_of_an_ordered_cloud_what_the_plain_way_keeps) {
  Memory memory;
  for (const double focus : {0.0, 600.0}) {
    const std::vector<float> drawn = scan(focus);
    for (const bool nasty : {false, true}) {
      const std::vector<float> mixed = shuffled(nasty ? with_nasty_points(drawn, focus) : drawn);
      std::vector<float> plain = mixed;
      Lattice lattice;
      ASSERT_TRUE(find(plain, 1, lattice));
      Plain by_point;
      by_point.run(plain, lattice, memory.work());
      std::vector<float> first;
      for (const int threads : {1, 2}) {
        for (const InstructionSet set :
             {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2, InstructionSet::best}) {
          if (!limit_instruction_set(set)) continue;
          Roomy roomy(mixed);
          Team team(threads);
          ScanCounts counts;
          ASSERT_TRUE(denoise_lattice(roomy.cloud, memory.work(), team, counts));
          EXPECT_EQ(counts.points_finite, by_point.finite);
          EXPECT_EQ(counts.isolated_removed, by_point.taken);
          EXPECT_EQ(counts.points_kept, by_point.finite - by_point.taken);
          const std::vector<float> kept = roomy.all();
          // An organised scan, unless points share a cell.
          EXPECT_EQ(roomy.cloud.width * roomy.cloud.height, nasty ? 0 : roomy.cloud.points);
          if (first.empty()) {
            first = kept;
            EXPECT_TRUE(same_points(finite_ones(first), finite_ones(plain))) << focus << " mm";
          }
          EXPECT_TRUE(same(kept, first)) << focus << " mm, " << threads << " threads";
        }
        ASSERT_TRUE(limit_instruction_set(InstructionSet::best));
      }
    }
  }
}

TEST(LatticeOrder, gives_each_point_its_cell_whatever_the_order_was) {
  for (const double focus : {0.0, 600.0}) {
    const std::vector<float> nasty = with_nasty_points(scan(focus), focus);
    std::vector<float> xyz = nasty;
    Lattice lattice;
    ASSERT_TRUE(find(xyz, 1, lattice));
    EXPECT_TRUE(is_in_order(view(xyz), lattice));
    const auto cells = static_cast<std::size_t>(lattice.columns * lattice.rows);
    std::vector<float> half(xyz.size() / 2 + 300'000), third(half.size() / 3 + 100'000);
    std::vector<std::uint32_t> words(limits::kDenoiseCellsMax);
    const std::size_t finite = finite_ones(nasty).size() / 3;
    std::vector<float> first;
    for (const std::uint64_t seed : {3U, 4U}) {
      const std::vector<float> mixed = shuffled(nasty, seed);
      for (const int threads : {1, 2}) {
        for (const bool in_pieces : {false, true}) {
          Roomy roomy(mixed, 2 * cells);
          EXPECT_FALSE(is_in_order(roomy.cloud, lattice));
          Team team(threads);
          OrderMemory memory{{std::span(half), {}, {}}, words};
          std::vector<float> second(third.size()), last(third.size());
          if (in_pieces) memory.points = {std::span(third), std::span(second), std::span(last)};
          Ordered found;
          ASSERT_TRUE(order_points(roomy.cloud, lattice, memory, team, found));
          EXPECT_TRUE(is_in_order(roomy.cloud, lattice));
          const std::vector<float> ordered = roomy.all();
          EXPECT_EQ(found.finite, finite);
          EXPECT_EQ(ordered.size() / 3, cells + found.met + found.outside);
          if (first.empty()) {
            first = ordered;
            EXPECT_TRUE(same_points(finite_ones(first), finite_ones(nasty)));
          }
          EXPECT_TRUE(same(ordered, first)) << focus << " mm, " << threads << " threads";
        }
      }
    }
    std::size_t met = 0, outside = 0;
    for (std::size_t i = 0; i < first.size() / 3; ++i) {
      const float* p = &first[3 * i];
      if (i < cells) {
        // The cell's own point, or a missing one.
        if (is_finite(p)) {
          ASSERT_EQ(cell_of(lattice, p), static_cast<std::ptrdiff_t>(i));
        } else {
          ASSERT_TRUE(std::isnan(p[0]) && std::isnan(p[1]) && std::isnan(p[2]));
        }
        continue;
      }
      const std::ptrdiff_t cell = cell_of(lattice, p);
      if (cell < 0) {
        ++outside;
      } else {
        ++met;
        ASSERT_LE(first[static_cast<std::size_t>(3 * cell + 2)], p[2]);
      }
    }
    EXPECT_GT(met, 100U);
    EXPECT_GT(outside, 10U);
  }
}

TEST(LatticeOrder, makes_an_organised_scan_of_a_cloud_whose_rays_never_meet) {
  const std::vector<float> drawn = scan(0.0);
  Roomy roomy(shuffled(drawn));
  std::vector<float> half(drawn.size() / 2 + 300'000);
  std::vector<std::uint32_t> words(limits::kDenoiseCellsMax);
  Lattice lattice;
  std::vector<float> xyz = drawn;
  ASSERT_TRUE(find(xyz, 1, lattice));
  Team team(2);
  Ordered found;
  ASSERT_TRUE(order_points(roomy.cloud, lattice, {{std::span(half), {}, {}}, words}, team, found));
  EXPECT_EQ(roomy.cloud.width, static_cast<std::size_t>(lattice.columns));
  EXPECT_EQ(roomy.cloud.height, static_cast<std::size_t>(lattice.rows));
  EXPECT_EQ(roomy.cloud.points, roomy.cloud.width * roomy.cloud.height);
}

/// Adds a second point in every `every`-th cell of the upper half.
std::vector<float> crowded(const std::vector<float>& drawn, std::size_t every) {
  std::vector<float> crowded = drawn;
  for (std::size_t i = 0; i < drawn.size() / 2; i += 3 * every)
    crowded.insert(crowded.end(), {drawn[i], drawn[i + 1], drawn[i + 2] + 0.25F});
  return crowded;
}

struct DrawnOnALattice {
  std::vector<float> drawn;
  Lattice lattice;
  std::size_t cells = 0;
};
DrawnOnALattice drawn_on_a_lattice() {
  DrawnOnALattice all;
  all.drawn = scan(0.0);
  std::vector<float> xyz = all.drawn;
  EXPECT_TRUE(find(xyz, 1, all.lattice));
  all.cells = static_cast<std::size_t>(all.lattice.columns * all.lattice.rows);
  return all;
}

/// Expects a refusal without lost points, in an order independent of the original one.
void expect_given_back(const std::vector<float>& points, const Lattice& lattice, std::size_t room, std::size_t memory) {
  std::vector<float> half(memory);
  std::vector<std::uint32_t> words(limits::kDenoiseCellsMax);
  std::vector<float> first;
  for (int run = 0; run < 4; ++run) {
    const std::vector<float> mixed = shuffled(points, static_cast<std::uint64_t>(run));
    Roomy roomy(mixed, room);
    Team team(1 + run % 2);
    Ordered found;
    roomy.cloud.width = points.size() / 3;  // as a header may say
    roomy.cloud.height = 1;
    ASSERT_FALSE(order_points(roomy.cloud, lattice, {{std::span(half), {}, {}}, words}, team, found));
    EXPECT_EQ(roomy.cloud.width, 0U);
    ASSERT_EQ(roomy.cloud.points, points.size() / 3);
    const std::vector<float> back = roomy.all();
    if (first.empty()) {
      first = back;
      EXPECT_TRUE(same_points(finite_ones(first), finite_ones(points)));
    }
    EXPECT_TRUE(same(back, first)) << "run " << run;
    EXPECT_FALSE(same(back, mixed)) << "nothing was tried";
  }
}

TEST(LatticeOrder, loses_no_point_where_more_share_a_cell_than_there_is_room_for) {
  const auto [drawn, lattice, cells] = drawn_on_a_lattice();
  const std::vector<float> points = crowded(drawn, 15);
  for (const std::size_t points_left : {std::size_t{0}, std::size_t{1'000}, std::size_t{10'000}})
    expect_given_back(points, lattice, cells + points_left, points.size());
}

/// The points in the rows [first, last).
std::vector<float> in_rows(const std::vector<float>& drawn, const Lattice& lattice, float first, float last) {
  std::vector<float> out;
  for (std::size_t i = 0; i < drawn.size(); i += 3) {
    const float row = std::floor((drawn[i + 1] - lattice.y0) * lattice.per_y);
    if (row >= first && row < last) out.insert(out.end(), &drawn[i], &drawn[i] + 3);
  }
  return out;
}

TEST(LatticeOrder, loses_no_point_where_a_band_has_more_of_them_than_cells) {
  const auto [drawn, lattice, cells] = drawn_on_a_lattice();
  // A strip of rows is there four times; the rest of the scan only where it is far from it. Strips at either end.
  for (const bool at_end : {false, true}) {
    const float strip = std::floor(lattice.rows / 8.0F);
    const float first = at_end ? lattice.rows - 2.0F * strip : strip;
    const std::vector<float> dense = in_rows(drawn, lattice, first, first + strip);
    std::vector<float> points =
        in_rows(drawn, lattice, at_end ? 0.0F : lattice.rows / 2.0F, at_end ? lattice.rows / 2.0F : lattice.rows);
    for (int copy = 0; copy < 4; ++copy)
      for (std::size_t i = 0; i < dense.size(); i += 3)
        points.insert(points.end(), {dense[i], dense[i + 1], dense[i + 2] + 0.01F * static_cast<float>(copy)});
    ASSERT_LT(points.size() / 3, cells);
    expect_given_back(points, lattice, cells + points.size() / 3, 3 * cells / 2 + 300'000);
  }
}

TEST(LatticeOrder, loses_no_point_where_too_many_are_outside) {
  const auto [drawn, lattice, cells] = drawn_on_a_lattice();
  // One in 1 300: too few for a sample to detect them reliably.
  std::vector<float> points = drawn;
  for (std::size_t i = 0; i < drawn.size(); i += std::size_t{3} * 1'300)
    points.insert(points.end(), {drawn[i] + 5'000.0F, drawn[i + 1], drawn[i + 2]});
  expect_given_back(points, lattice, 2 * cells, points.size());
}

TEST(LatticeOrder, gives_each_point_its_cell_whichever_half_of_the_grid_comes_first) {
  const auto [drawn, lattice, cells] = drawn_on_a_lattice();
  const std::vector<float> low = shuffled(in_rows(drawn, lattice, -1e6F, lattice.rows / 2.0F));
  const std::vector<float> high = shuffled(in_rows(drawn, lattice, lattice.rows / 2.0F, 1e6F));
  // Exactly the required memory, in pieces.
  const std::size_t spare = 3 * kBucketPoints * (BucketPlaces::spare(kKindsMax) + 2);
  const std::size_t needed = 3 * (cells / 2 + (std::size_t{1} << 15U)) + spare;
  std::vector<float> one(needed / 2), two(needed / 4), three(needed / 4 + 3 * kBucketFloats);
  std::vector<std::uint32_t> words(limits::kDenoiseCellsMax);
  std::vector<float> first;
  for (const bool low_first : {true, false}) {
    std::vector<float> points = low_first ? low : high;
    points.insert(points.end(), (low_first ? high : low).begin(), (low_first ? high : low).end());
    for (const int threads : {1, 2}) {
      Roomy roomy(points, cells + 1'000);
      Team team(threads);
      Ordered found;
      ASSERT_TRUE(order_points(roomy.cloud, lattice, {{one, two, three}, words}, team, found)) << low_first;
      if (first.empty()) {
        first = roomy.all();
        EXPECT_TRUE(same_points(finite_ones(first), drawn));
      }
      EXPECT_TRUE(same(roomy.all(), first)) << low_first << ", " << threads << " threads";
    }
  }
}

/// A point in the middle of each of the cells, in a random order. Every `doubled`-th cell, if not 0, has a second one
/// instead of the next cell's.
std::vector<float> one_in_each_cell(const Lattice& lattice, std::size_t points_max, std::size_t doubled) {
  const auto columns = static_cast<std::size_t>(lattice.columns);
  const std::size_t cells = columns * static_cast<std::size_t>(lattice.rows);
  constexpr std::size_t kStep = 1'999'993;  // a prime
  std::vector<float> xyz;
  xyz.reserve(3 * points_max);
  for (std::size_t k = 0; k < cells; ++k) {
    std::size_t at = k * kStep % cells;
    const bool second = doubled != 0 && at % doubled == 1;
    if (second) --at;
    xyz.insert(xyz.end(), {(static_cast<float>(at % columns) + 0.5F) / lattice.per_x,
                           (static_cast<float>(at / columns) + 0.5F) / lattice.per_y, second ? 601.0F : 600.0F});
  }
  return xyz;
}

TEST(LatticeOrder, has_room_for_the_largest_scans) {
  // The inspector's memory, in its pieces.
  std::vector<float> order(limits::kScanPointsMax), surface(3 * limits::kDenoiseCellsMax);
  std::vector<float> keep(limits::kScanPointsMax / sizeof(float));
  std::vector<std::uint32_t> words(limits::kDenoiseCellsMax);
  struct Size {
    float columns, rows;
    std::size_t doubled;
  };
  // Nearly the maximum size of a scan; and nearly the maximum number of points that share a cell.
  for (const Size size : {Size{2'432.0F, 2'432.0F, 0}, Size{2'448.0F, 2'048.0F, 102}}) {
    Lattice lattice;
    lattice.per_x = lattice.per_y = 4.0F;
    lattice.columns = size.columns;
    lattice.rows = size.rows;
    std::vector<float> xyz = one_in_each_cell(lattice, limits::kScanPointsMax, size.doubled);
    const std::size_t cells = xyz.size() / 3;
    xyz.resize(3 * limits::kScanPointsMax);
    Cloud cloud{xyz, cells, 0, 0};
    Team team(2);
    Ordered found;
    ASSERT_TRUE(order_points(cloud, lattice, {{order, surface, keep}, words}, team, found)) << size.columns;
    EXPECT_EQ(found.met, size.doubled == 0 ? 0 : cells / size.doubled);
    EXPECT_EQ(cloud.points, cells + found.met);
    std::size_t in_place = 0;
    for (std::size_t i = 0; i < cells; ++i)
      in_place += cell_of(lattice, &xyz[3 * i]) == static_cast<std::ptrdiff_t>(i) && xyz[3 * i + 2] == 600.0F ? 1U : 0U;
    EXPECT_EQ(in_place, cells - found.met);
  }
}

TEST(DenoiseLattice, keeps_the_same_whatever_room_there_is_for_the_grid) {
  Memory memory;
  const std::vector<float> drawn = scan(0.0);
  const std::vector<float> points = crowded(drawn, 80);
  std::vector<float> xyz = points;
  Lattice lattice;
  ASSERT_TRUE(find(xyz, 1, lattice));
  const auto cells = static_cast<std::size_t>(lattice.columns * lattice.rows);
  const auto kept_with = [&](const std::vector<float>& scan, std::size_t room, const DenoiseWorkspace& work) {
    Roomy roomy(scan, std::max(room, scan.size() / 3));
    Team team(2);
    ScanCounts counts;
    EXPECT_TRUE(denoise_lattice(roomy.cloud, work, team, counts));
    EXPECT_EQ(counts.points_kept, finite_ones(roomy.all()).size() / 3);
    return finite_ones(roomy.all());
  };
  const std::vector<float> mixed = shuffled(points);
  const std::vector<float> kept = kept_with(points, 0, memory.work());
  // No memory, too little for the remainder, and enough; and a workspace only as large as the points.
  for (const std::size_t room : {std::size_t{0}, cells + 10, limits::kScanPointsMax})
    EXPECT_TRUE(same_points(kept_with(mixed, room, memory.work()), kept)) << room;
  DenoiseWorkspace small = memory.work();
  small.order = small.order.first(cells);
  small.keep = small.keep.first(cells);
  EXPECT_TRUE(same_points(kept_with(mixed, limits::kScanPointsMax, small), kept));
}

TEST(LatticeOrder, leaves_the_cloud_alone_without_room) {
  const std::vector<float> mixed = shuffled(scan(0.0));
  std::vector<float> xyz = mixed;
  Lattice lattice;
  ASSERT_TRUE(find(xyz, 1, lattice));
  const auto cells = static_cast<std::size_t>(lattice.columns * lattice.rows);
  std::vector<float> enough(xyz.size()), little(xyz.size() / 2 - xyz.size() / 16);
  std::vector<std::uint32_t> words(limits::kDenoiseCellsMax);
  Team team(1);
  Ordered found;
  const auto refused = [&](std::size_t room, std::span<float> points, std::span<std::uint32_t> memory) {
    Roomy roomy(mixed, room);
    EXPECT_FALSE(order_points(roomy.cloud, lattice, {{points, {}, {}}, memory}, team, found));
    EXPECT_TRUE(same(roomy.all(), mixed));
    EXPECT_EQ(roomy.cloud.width, 0U);
  };
  refused(cells, little, words);
  refused(cells, enough, {});
  refused(cells - 1, enough, words);
  Roomy roomy(mixed, cells);
  EXPECT_TRUE(order_points(roomy.cloud, lattice, {{std::span(enough), {}, {}}, words}, team, found));
}

}  // namespace
}  // namespace slabd::algo
