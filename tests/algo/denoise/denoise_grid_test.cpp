// SPDX-License-Identifier: Apache-2.0
//
// The kernels that judge an organised scan skip work that cannot change their result: by marks of tiles, rows of
// sixteen, quick tests of the planes around. Here they are compared with the rules applied to every point.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "algo/denoise/denoise.h"
#include "algo/denoise/denoise_grid.h"
#include "base/prng.h"
#include "denoise_grid_plain.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct Scan {
  std::size_t columns = 0;
  std::size_t rows = 0;
  std::vector<float> xyz;
};

/// Memory for one grid, without any spare byte.
struct Memory {
  explicit Memory(const GridLayout& grid) : keep(grid.work_bytes()), surface(2 * grid.tiles()) {}
  [[nodiscard]] DenoiseWorkspace work() { return {{}, keep, {}, surface}; }

  std::vector<std::uint8_t> keep;
  std::vector<TilePlane> surface;
};

/// Disturbances of a scan, as shares of all points.
struct Litter {
  double missing;   ///< points
  double outliers;  ///< single ones ...
  double clumps;    ///< ... and clumps of up to fourteen, half a millimetre to nine off
  double holes;     ///< discs with hardly any points
};

/// A surface in columns and rows with the features of a block: tilted planes, steps of five millimetres and of one, a
/// ramp at 70 degrees and a cliff of about 85, a wave, a saw, rods, a crack and a fin of a line or two.
struct Relief {
  double columns, rows;
  double pitch_mm;
  double cliff;  ///< slope
  double bend;   ///< mm per point squared: planes of adjacent tiles are almost the same

  [[nodiscard]] double z_mm(double column, double row) const {
    const double x = column / columns;
    const double y = row / rows;
    double z = 0.03 * column * pitch_mm - 0.02 * row * pitch_mm + bend * (column * column + row * row);
    if (x > 0.45) z += 5.0;
    if (y > 0.6) z -= 1.0;
    if (x > 0.7 && x < 0.8) z += 2.75 * pitch_mm * (column - 0.7 * columns);
    if (x >= 0.8) z += 2.75 * pitch_mm * 0.1 * columns;
    if (x >= 0.85) z -= std::min(cliff * pitch_mm * (column - 0.85 * columns), 100.0);
    if (x < 0.3 && y < 0.4) z += 3.0 * std::sin(0.4 * row * pitch_mm);
    if (x < 0.3 && y > 0.7) z += 0.03 * std::fmod(column, 16.0);
    if (std::abs(column - 0.6 * columns) < 2.0 && y < 0.5) z -= 4.0;
    if (std::abs(row - 0.2 * rows) < 3.0 && x > 0.3 && x < 0.6) z -= 2.0;
    if (std::abs(column - 0.1 * columns - 0.3 * row) < 1.0 && y > 0.5 && y < 0.8) z += 2.5;
    if (std::abs(row - 0.9 * rows) < 0.6 && x > 0.1 && x < 0.9) z -= 4.0;
    return z;
  }
};

Scan strewn(std::size_t columns, std::size_t rows, double focus_mm, const Litter& litter, std::uint64_t seed) {
  Prng prng(seed);
  const Relief relief{static_cast<double>(columns), static_cast<double>(rows), 0.15 + 0.6 * prng.uniform(),
                      8.0 + 8.0 * prng.uniform(), std::max(0.0, 0.0016 * prng.uniform() - 0.0008)};
  const auto width = static_cast<int>(columns);
  const auto height = static_cast<int>(rows);
  std::vector<double> z(columns * rows);
  const auto at = [&](int column, int row) -> double& {
    return z[static_cast<std::size_t>(row) * columns + static_cast<std::size_t>(column)];
  };
  const auto within = [&](int column, int row) { return column >= 0 && row >= 0 && column < width && row < height; };
  const auto somewhere = [&](double share, auto&& f) {
    const auto count = static_cast<int>(share * static_cast<double>(z.size()));
    for (int i = 0; i < count; ++i)
      f(static_cast<int>(prng.below(columns)), static_cast<int>(prng.below(rows)),
        (prng.uniform() < 0.5 ? -1.0 : 1.0) * (0.5 + 8.5 * prng.uniform() * prng.uniform()));
  };
  for (int r = 0; r < height; ++r)
    for (int c = 0; c < width; ++c)
      at(c, r) = relief.z_mm(c, r) + (prng.uniform() < 0.05 ? 0.15 : 0.03) * prng.normal();
  somewhere(litter.holes, [&](int column, int row, double) {
    for (int r = row - 6; r <= row + 6; ++r)
      for (int c = column - 6; c <= column + 6; ++c)
        if (within(c, r) && prng.uniform() < 0.85) at(c, r) = kNoPlane;
  });
  somewhere(litter.outliers, [&](int c, int r, double off) { at(c, r) += off; });
  somewhere(litter.clumps, [&](int column, int row, double off) {
    const double depth = at(column, row) + off;
    const auto size = 2 + prng.below(13);
    for (std::uint64_t k = 0; k < size; ++k) {
      if (within(column, row)) at(column, row) = depth + 0.1 * prng.normal();
      (prng.uniform() < 0.6 ? column : row) += prng.uniform() < 0.7 ? 1 : -1;
    }
  });
  Scan scan{columns, rows, std::vector<float>(3 * z.size())};
  for (int r = 0; r < height; ++r) {
    for (int c = 0; c < width; ++c) {
      float* p = &scan.xyz[3 * (static_cast<std::size_t>(r) * columns + static_cast<std::size_t>(c))];
      const double depth = 600.0 + at(c, r);
      const double wider = focus_mm > 0.0 ? depth / focus_mm : 1.0;
      p[0] = static_cast<float>((c - 0.5 * width) * relief.pitch_mm * wider);
      p[1] = static_cast<float>((r - 0.5 * height) * relief.pitch_mm * wider);
      p[2] = static_cast<float>(depth);
      const double what = prng.uniform();
      if (what < litter.missing)
        p[0] = p[1] = p[2] = kNoPlane;
      else if (what < litter.missing + 0.001)
        p[2] = kNoPlane;
      else if (what < litter.missing + 0.0015)
        p[2] = prng.uniform() < 0.5 ? kInfinity : -kInfinity;
      else if (what < litter.missing + 0.0018)
        p[2] = std::numeric_limits<float>::max();
    }
  }
  return scan;
}

/// The block from above, with steep jaws and end faces and with outliers in clumps.
Scan block(double pitch_mm, double focus_mm, double outlier_far_mm) {
  scene::Scan how;
  how.pitch_mm = pitch_mm;
  how.focus_mm = focus_mm;
  how.outlier_share = 0.01;
  how.outlier_far_mm = outlier_far_mm;
  how.outlier_clump = 6;
  how.tail_share = 0.05;
  how.organised = true;
  how.displacement = scene::displaced(2.0, -3.0, 0.0, focus_mm > 0.0 ? 4.0 : 0.0, -1.0, 2.0);
  scene::Cloud cloud = scene::take({}, how);
  return {cloud.width, cloud.height, std::move(cloud.xyz)};
}

/// Adds a patch at random depths: it has no surface and no connected group, so it is noise in every bit.
Scan with_patch(Scan scan, std::size_t column, std::size_t row, std::size_t width, std::size_t height) {
  Prng prng(width);
  for (std::size_t r = row; r < row + height; ++r)
    for (std::size_t c = column; c < column + width; ++c)
      scan.xyz[3 * (r * scan.columns + c) + 2] += static_cast<float>(200.0 * prng.uniform() - 100.0);
  return scan;
}

/// Few sides are whole tiles; some scans are several bands of tiles.
std::vector<Scan> scans() {
  const Litter tidy{0.02, 0.002, 0.0002, 0.0};
  const Litter usual{0.02, 0.01, 0.001, 0.0005};
  const Litter wild{0.3, 0.03, 0.006, 0.002};
  std::vector<Scan> all = {
      strewn(64, 64, 0.0, usual, 1), strewn(67, 71, 0.0, wild, 2), strewn(113, 525, 600.0, tidy, 3),
      strewn(250, 90, 0.0, {}, 4),   block(1.3, 0.0, 60.0),        block(1.1, 600.0, 5.0)};
  // Whole words of noise after hundreds of single ones.
  all.push_back(with_patch(strewn(320, 300, 0.0, {0.0, 0.03, 0.0, 0.0}, 6), 64, 40, 192, 100));
  Prng prng(5);
  for (std::uint64_t seed = 10; seed < 90; ++seed) {
    const std::size_t columns = 64 + prng.below(200);
    const std::size_t rows = 64 + prng.below(250);
    all.push_back(strewn(columns, rows, seed % 2 == 0 ? 600.0 : 0.0, std::array{tidy, usual, wild}[seed % 3], seed));
  }
  return all;
}

std::vector<float> heights(const Scan& scan) {
  std::vector<float> z(scan.xyz.size() / 3);
  for (std::size_t i = 0; i < z.size(); ++i) z[i] = scan.xyz[3 * i + 2];
  return z;
}

bool bit(const GridMask& mask, const GridLayout& grid, std::size_t point) {
  const auto column = static_cast<int>(point % grid.columns);
  const auto row = static_cast<int>(point / grid.columns);
  return ((mask.tile(column / GridLayout::kTileColumns, row) >> (column % GridLayout::kTileColumns)) & 1U) != 0;
}

/// A scan with the planes that the first step gave its tiles, and the resulting masks.
struct Seen {
  explicit Seen(const Scan& taken)
      : scan(taken),
        z(heights(scan)),
        grid(scan.columns, scan.rows),
        memory(grid),
        work(grid, scan.xyz.data(), nullptr, memory.work()) {
    Team team(1);
    work.measure_pitch(grid);
    accepted = algo::judge_grid(grid, work, team);
    for (std::size_t i = 0; i < z.size(); ++i) off.push_back(bit(work.off, grid, i));
    if (accepted) keep_noise_groups(grid, work, team);
  }

  Scan scan;
  std::vector<float> z;
  GridLayout grid;
  Memory memory;
  GridWork work;
  std::vector<bool> off;
  bool accepted = false;
};

TEST(DenoiseGrid, takes_out_exactly_what_the_plain_rules_take_out) {
  std::array<std::size_t, plain::kVerdicts> met{};
  int number = 0;
  for (const Scan& scan : scans()) {
    SCOPED_TRACE(number++);
    Seen seen(scan);
    ASSERT_TRUE(seen.accepted);
    const plain::Judged judged = plain::judge_points(seen.grid, seen.work, seen.z);
    std::vector<float> expected = scan.xyz;
    std::uint64_t finite = 0;
    std::uint64_t taken = 0;
    for (std::size_t i = 0; i < seen.z.size(); ++i) {
      ++met[static_cast<std::size_t>(judged.verdict[i])];
      if (judged.verdict[i] != plain::Verdict::missing) ++finite;
      if (!plain::is_noise(judged.verdict[i])) continue;
      ++taken;
      std::fill_n(&expected[3 * i], 3, kNoPlane);
    }
    std::size_t off_differs = 0;
    std::size_t noise_differs = 0;
    for (std::size_t i = 0; i < seen.z.size(); ++i) {
      off_differs += judged.off[i] != seen.off[i] ? 1U : 0U;
      noise_differs += plain::is_noise(judged.verdict[i]) != bit(seen.work.noise, seen.grid, i) ? 1U : 0U;
    }
    EXPECT_EQ(off_differs, 0U);
    EXPECT_EQ(noise_differs, 0U);

    for (const int threads : {1, 2}) {
      Team team(threads);
      for (const InstructionSet set :
           {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2, InstructionSet::best}) {
        if (!limit_instruction_set(set)) continue;
        Memory memory(seen.grid);
        std::vector<float> xyz = scan.xyz;
        Cloud cloud{xyz, xyz.size() / 3, scan.columns, scan.rows};
        ScanCounts counts;
        ASSERT_TRUE(denoise_grid(cloud, memory.work(), team, counts));
        EXPECT_EQ(counts.points_finite, finite);
        EXPECT_EQ(counts.isolated_removed, taken);
        EXPECT_EQ(counts.points_kept, finite - taken);
        EXPECT_EQ(std::memcmp(xyz.data(), expected.data(), xyz.size() * sizeof(float)), 0)
            << threads << " threads, instruction set " << static_cast<int>(set);
      }
      ASSERT_TRUE(limit_instruction_set(InstructionSet::best));
    }

    // A table of heights is judged like the scan.
    Memory memory(seen.grid);
    GridWork table(seen.grid, nullptr, seen.z.data(), memory.work());
    table.per_column_mm = seen.work.per_column_mm;
    table.per_row_mm = seen.work.per_row_mm;
    Team team(1);
    ASSERT_TRUE(judge_grid(seen.grid, table, team));
    keep_noise_groups(seen.grid, table, team);
    std::size_t table_differs = 0;
    for (std::size_t i = 0; i < seen.z.size(); ++i)
      table_differs += plain::is_noise(judged.verdict[i]) != bit(table.noise, seen.grid, i) ? 1U : 0U;
    EXPECT_EQ(table_differs, 0U);
  }
  // Each rule decided some points.
  for (std::size_t verdict = 0; verdict < met.size(); ++verdict) {
    RecordProperty("verdict_" + std::to_string(verdict), static_cast<int>(met[verdict]));
    EXPECT_GE(met[verdict], 20U) << "verdict " << verdict;
  }
}

TEST(DenoiseGrid, loses_hardly_a_point_by_asking_one_of_planes_that_are_alike) {
  // The kernels test only one of several similar planes. Points on another of them alone are removed, unless they are
  // connected; one that is not may be what made a group long.
  const auto on_no_plane = [](plain::Verdict v) { return plain::is_noise(v) || v == plain::Verdict::damage; };
  std::size_t finite = 0;
  std::size_t lost = 0;
  for (const Scan& scan : scans()) {
    const Seen seen(scan);
    ASSERT_TRUE(seen.accepted);
    const plain::Judged one = plain::judge_points(seen.grid, seen.work, seen.z);
    const plain::Judged each = plain::judge_points(seen.grid, seen.work, seen.z, false);
    for (std::size_t i = 0; i < seen.z.size(); ++i) {
      finite += one.verdict[i] != plain::Verdict::missing ? 1U : 0U;
      lost += on_no_plane(one.verdict[i]) && !on_no_plane(each.verdict[i]) ? 1U : 0U;
      ASSERT_FALSE(on_no_plane(each.verdict[i]) && !on_no_plane(one.verdict[i]));
    }
  }
  EXPECT_LE(static_cast<double>(lost), 1e-4 * static_cast<double>(finite));
  EXPECT_GT(lost, 0U);
}

}  // namespace
}  // namespace slabd::algo
