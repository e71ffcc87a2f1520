// SPDX-License-Identifier: Apache-2.0
//
// Problem: find the pitch and phase of a scanner's evenly spaced rays. They are even over x and y if parallel, over x /
// z and y / z if they come from one point.
//
// Idea: a sample of some thousand points, sorted along an axis, shows the columns (or rows) as steps. Their pitch and
// phase come from a line through the steps. Of the two kinds of rays, the one with the smaller misfit is used.
//
// Invariant: the sample is chosen by the points' coordinates, not by their index, and is sorted before use. So the
// result does not depend on the order of the points or the number of threads.
#include "algo/denoise/lattice.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numeric>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/denoise/lattice.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/denoise/denoise_grid.h"

#ifndef SLABD_ALGO_LATTICE_ONCE
#define SLABD_ALGO_LATTICE_ONCE
namespace slabd::algo {
namespace {

/// The sampled points of all threads; points beyond the capacity are only counted.
struct Sample {
  float* x = nullptr;
  float* y = nullptr;
  float* z = nullptr;
  std::atomic<std::size_t> points{0};

  void add(const float* p) {
    if (!std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2])) return;
    const std::size_t i = points.fetch_add(1, std::memory_order_relaxed);
    if (i < kLatticeSampleMax) x[i] = p[0], y[i] = p[1], z[i] = p[2];
  }
};

}  // namespace
}  // namespace slabd::algo
#endif

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

/// Samples points by a hash: the bits of the three coordinates are combined, and about one in mask + 1 (a power of two)
/// matches the wanted bits. The points are not split for this: every number is combined with the next two, and only the
/// results that begin at an x count.
void take_sample(const float* xyz, std::size_t points, std::int32_t mask, Sample& sample) {
  // Round coordinates end in zeros, so the wanted bits are not zeros.
  const I16 wanted = i16(0x2AAAAAAA & mask);
  const I16 looked_at = i16(mask);
  // Lanes that contain an x, in the first, second and third sixteen numbers of sixteen points.
  constexpr std::array<std::uint32_t, 3> kFirst = {0x9249, 0x4924, 0x2492};
  constexpr std::size_t kAhead = 768;  // floats
  const auto choose = [&](const float* from) {
    for (std::size_t v = 0; v < 3; ++v) {
      const float* p = from + kLanes * v;
      const I16 all = bit_xor(pattern(load(p)), bit_xor(pattern(load(p + 1)), pattern(load(p + 2))));
      std::uint32_t chosen = bits(is_zero(bit_xor(bit_and(all, looked_at), wanted))) & kFirst[v];
      for (; chosen != 0; chosen &= chosen - 1) sample.add(p + std::countr_zero(chosen));
    }
  };
  std::size_t i = 0;
  for (; i + kLanes < points; i += kLanes) {
    fetch_points(xyz + 3 * i + kAhead);
    choose(xyz + 3 * i);
  }
  // The last points, copied into a padded buffer.
  std::array<float, 3 * kLanes + 2> last;
  last.fill(kNoPlane);
  std::copy_n(xyz + 3 * i, 3 * (points - i), last.data());
  choose(last.data());
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(take_sample);

namespace {

/// With fewer points the steps do not show.
constexpr std::size_t kSampleMin = 2'048;
/// Points that a thread processes as one task.
constexpr std::size_t kPiece = 1U << 17U;
/// Mean distance of points from the middle of their column or row, in pitches; 0.25 for random points. Below the second
/// limit the other kind of rays is not tried.
constexpr double kMisfitMax = 0.1;
constexpr double kMisfitSure = 0.01;
/// Samples at either end that may be strays; and columns or rows added beyond the others: a fiftieth and eight.
constexpr std::size_t kStrays = 4;
constexpr double kMarginShare = 0.02;
constexpr double kMargin = 8.0;

/// Radix sort of n finite numbers, in a third of the time of a comparison sort. `room`: n numbers as well.
void sort_numbers(float* value, std::size_t n, float* room) {
  constexpr unsigned kDigitBits = 11;
  constexpr std::uint32_t kSign = 1U << 31U;
  // Maps floats to integers of the same order.
  const auto key = [](float v) {
    const auto bits = std::bit_cast<std::uint32_t>(v);
    return (bits & kSign) != 0 ? ~bits : bits | kSign;
  };
  for (unsigned shift = 0; shift < 32; shift += kDigitBits) {
    const auto digit = [&](float v) { return (key(v) >> shift) & ((1U << kDigitBits) - 1U); };
    std::array<std::uint32_t, (1U << kDigitBits) + 1> start{};
    for (std::size_t i = 0; i < n; ++i) ++start[digit(value[i]) + 1];
    std::partial_sum(start.begin(), start.end(), start.begin());
    for (std::size_t i = 0; i < n; ++i) room[start[digit(value[i])]++] = value[i];
    std::copy_n(room, n, value);
  }
}

/// Evenly spaced columns or rows: number k at origin + k * pitch.
struct Steps {
  double origin = 0.0;
  double pitch = 0.0;
  double misfit = 1.0;  ///< in pitches
  double first = 0.0;   ///< number of the first column or row
  double count = 0.0;
};

/// Finds the steps in `value`: n coordinates, sorted; `room`: n numbers as well.
bool find_steps(const float* value, std::size_t n, float* room, Steps& steps) {
  const std::size_t from = n / 256;
  const std::size_t to = n - n / 256;
  // The difference of consecutive values is nearly zero, or one pitch, rarely several.
  const std::size_t differences = to - from - 1;
  for (std::size_t i = 0; i < differences; ++i) room[i] = value[from + i + 1] - value[from + i];
  constexpr std::size_t kLargest = 32;
  float* end = room + differences;
  std::nth_element(room, end - kLargest, end);
  const float large = *(end - kLargest);
  const auto median_above = [&](float least) {
    float* first = std::partition(room, end, [&](float d) { return d <= least; });
    if (first == end) return 0.0F;
    std::nth_element(first, first + (end - first) / 2, end);
    return first[(end - first) / 2];
  };
  double pitch = static_cast<double>(median_above(large / 6.0F));
  pitch = static_cast<double>(median_above(static_cast<float>(0.5 * pitch)));
  if (!(pitch > 1e-6 * std::abs(static_cast<double>(value[to - 1]))) || !std::isfinite(pitch)) return false;

  // Steps are counted from each value to the next, with a phase that follows them slowly. Then a line is fitted through
  // all of them, and through the values that it assigns to steps.
  double origin = static_cast<double>(value[from]);
  for (int pass = 0; pass < 4; ++pass) {
    constexpr double kFollow = 0.1;
    const bool follow = pass < 2;
    double phase = origin;
    if (follow) phase = static_cast<double>(value[from]);
    double k = 0.0, count = 0.0, sum_k = 0.0, sum_v = 0.0, sum_kk = 0.0, sum_kv = 0.0;
    for (std::size_t i = from; i < to; ++i) {
      const double v = static_cast<double>(value[i]) - static_cast<double>(value[from]);
      double number = 0.0;
      if (follow) {
        const double step = std::floor((static_cast<double>(value[i]) - phase) / pitch + 0.5);
        k += step;
        phase += step * pitch;
        phase += kFollow * (static_cast<double>(value[i]) - phase);
        number = k;
      } else {
        number = std::floor((static_cast<double>(value[i]) - origin) / pitch + 0.5);
      }
      count += 1.0;
      sum_k += number;
      sum_v += v;
      sum_kk += number * number;
      sum_kv += number * v;
    }
    const double det = sum_kk - sum_k * sum_k / count;
    if (!(det > 0.0)) return false;
    pitch = (sum_kv - sum_k * sum_v / count) / det;
    origin = static_cast<double>(value[from]) + (sum_v - pitch * sum_k) / count;
    if (!(pitch > 0.0)) return false;
  }
  const auto number = [&](std::size_t i) { return std::floor((static_cast<double>(value[i]) - origin) / pitch + 0.5); };
  double off = 0.0;
  for (std::size_t i = from; i < to; ++i)
    off += std::abs(static_cast<double>(value[i]) - origin - pitch * number(i)) / pitch;
  steps.origin = origin;
  steps.pitch = pitch;
  steps.misfit = off / static_cast<double>(to - from);
  const double last = number(n - 1 - kStrays);
  steps.first = number(kStrays);
  steps.count = last - steps.first + 1.0;
  const double margin = std::floor(kMarginShare * steps.count) + kMargin;
  steps.first -= margin;
  steps.count += 2.0 * margin;
  return true;
}

/// Rounds up to whole tiles, so that no row of a table ends inside one.
bool whole_tiles(const Steps& x, const Steps& y, Lattice& lattice) {
  const auto whole = [](double count, double tile) { return tile * std::ceil(count / tile); };
  const double columns = whole(x.count, GridLayout::kTileColumns);
  const double rows = whole(y.count, GridLayout::kTileRows);
  if (columns < static_cast<double>(GridLayout::kColumnsMin) || rows < static_cast<double>(GridLayout::kRowsMin))
    return false;
  if (!(columns * rows <= static_cast<double>(limits::kScanPointsMax))) return false;
  lattice.columns = static_cast<float>(columns);
  lattice.rows = static_cast<float>(rows);
  lattice.x0 = static_cast<float>(x.origin + (x.first - 0.5) * x.pitch);
  lattice.y0 = static_cast<float>(y.origin + (y.first - 0.5) * y.pitch);
  lattice.per_x = static_cast<float>(1.0 / x.pitch);
  lattice.per_y = static_cast<float>(1.0 / y.pitch);
  return true;
}

/// Columns and rows of one kind of rays.
struct Rays {
  Steps x, y;
  [[nodiscard]] double misfit() const { return std::max(x.misfit, y.misfit); }
};

}  // namespace

bool find_lattice(const Cloud& cloud, std::span<float> memory, Team& team, Lattice& lattice) {
  if (memory.size() < kLatticeFloats || cloud.points < kSampleMin) return false;
  const auto room = [&](std::size_t k) { return memory.data() + k * kLatticeSampleMax; };
  Sample sample;
  sample.x = room(0), sample.y = room(1), sample.z = room(2);
  // Samples about half of the capacity.
  std::size_t share = 1;
  while (cloud.points / share > kLatticeSampleMax / 2) share *= 2;
  team.run((cloud.points + kPiece - 1) / kPiece, [&](std::size_t piece) {
    const std::size_t first = piece * kPiece;
    HWY_DYNAMIC_DISPATCH(take_sample)
    (cloud.xyz.data() + 3 * first, std::min(kPiece, cloud.points - first), static_cast<std::int32_t>(share - 1),
     sample);
  });
  const std::size_t n = sample.points;
  if (n < kSampleMin || n > kLatticeSampleMax) return false;

  const auto find = [&](bool central, Rays& rays) {
    team.run(2, [&](std::size_t axis) {
      float* value = room(3 + 2 * axis);
      const float* from = axis == 0 ? sample.x : sample.y;
      for (std::size_t i = 0; i < n; ++i) value[i] = central ? from[i] / sample.z[i] : from[i];
      if (!std::all_of(value, value + n, [](float v) { return std::isfinite(v); })) return;
      sort_numbers(value, n, room(4 + 2 * axis));
      Steps steps;
      if (find_steps(value, n, room(4 + 2 * axis), steps)) (axis == 0 ? rays.x : rays.y) = steps;
    });
  };
  Rays parallel, central;
  find(false, parallel);
  if (parallel.misfit() > kMisfitSure) find(true, central);
  lattice.central = central.misfit() < parallel.misfit();
  const Rays& rays = lattice.central ? central : parallel;
  if (!(rays.misfit() <= kMisfitMax)) return false;
  if (lattice.central) {
    std::nth_element(sample.z, sample.z + n / 2, sample.z + n);
    lattice.away_mm = std::abs(sample.z[n / 2]);
  }
  return whole_tiles(rays.x, rays.y, lattice);
}

}  // namespace slabd::algo
#endif  // HWY_ONCE
