// SPDX-License-Identifier: Apache-2.0
//
// Problem: a rounded coordinate is wrong by up to half a step, equally for all points of a line of the scan. Noise does
// not reveal it: on a face parallel to an axis all points are rounded alike and scatter less than before.
//
// Idea: rounded values are multiples of a step, to the precision of a float. Two searches, each on a sample:
//   - A list of the steps that writers use (decimals of mm, parts of an inch, powers of two), as multiples from zero. A
//     step is accepted if nine values of ten are multiples, so a few other points do not hide it.
//   - Any other step, from any origin: the greatest common divisor of the differences between neighbouring values, by
//     Euclid's algorithm with a tolerance.
//
// A scan with parallel rays has an even raster along two axes, and its step is the raster's pitch, without any
// rounding. Such a raster is accepted if the third axis does not have the same step (a writer rounds all three alike),
// no node of the raster has two points, and its lines have equal numbers of points (rounding a raster to another step
// leaves lines empty or doubles them). If the axes are the columns and rows of an organised scan, one step per line,
// the sample is enough to show it. A line profiler has a step along its travel only, X or Y, and its profiles have
// equal numbers of points; a writer does not round only one axis of three.
//
// A raster that was filled from the nearest points is not exact: a height is that of a place up to half of the original
// points' distance away. If the original points were further apart than the raster, neighbours have exactly the same
// height, and their distance counts as the step.
#include "algo/survey/coordinate_step.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "algo/points.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kSample = 4'096;
constexpr std::size_t kFirstLook = 256;
/// Minimum share of the values that a step explains.
constexpr double kShareMin = 0.9;
/// Two steps are equal up to this relative difference.
constexpr double kSameStep = 0.02;

/// Steps of writers, mm, the coarsest first.
constexpr std::array kUsualSteps = {25.4,    12.7,  10.0,  5.0,    2.54,    2.5,   2.0,       1.27,     1.0,
                                    0.5,     0.254, 0.25,  0.2,    0.127,   0.125, 0.1,       0.0625,   0.05,
                                    0.0254,  0.025, 0.02,  0.0127, 0.0125,  0.01,  0.03125,   0.015625, 0.0078125,
                                    0.00508, 0.005, 0.004, 0.0025, 0.00254, 0.002, 0.00390625};

struct Sample {
  std::array<std::array<float, kSample>, 3> values{};
  std::array<std::array<std::uint32_t, kSample>, 2> line{};  ///< column and row, of an organised scan
  std::size_t count = 0;
  std::size_t tries = 0;
};

/// Draws points all over the cloud, in an order unrelated to its rows and columns.
void draw(const Cloud& cloud, Sample& sample) {
  constexpr std::size_t kTries = 4 * kSample;
  while (sample.tries < kTries && sample.count < kSample) {
    const auto fraction = static_cast<std::uint32_t>(++sample.tries * 0x9E37'79B9U);
    const auto index = static_cast<std::size_t>((std::uint64_t{fraction} * cloud.points) >> 32U);
    const float* p = cloud.xyz.data() + 3 * index;
    if (!std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2])) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) sample.values[axis][sample.count] = p[axis];
    if (cloud.width != 0) {
      sample.line[0][sample.count] = static_cast<std::uint32_t>(index % cloud.width);
      sample.line[1][sample.count] = static_cast<std::uint32_t>(index / cloud.width);
    }
    ++sample.count;
  }
}

/// Largest distance of a rounded value from its multiple: one float step, and one more if the unit was converted.
double precision_of(std::span<const float> values) {
  float largest = 0.0F;
  for (const float v : values) largest = std::max(largest, std::abs(v));
  return 1.6 * static_cast<double>(std::nextafter(largest, std::numeric_limits<float>::infinity()) - largest);
}

/// True if enough of the values are multiples of `step`.
bool are_multiples(std::span<const float> values, double step, double precision) {
  std::size_t good = values.size();
  for (const float v : values) {
    const double k = static_cast<double>(v) / step;
    if (std::abs(k - std::floor(k + 0.5)) * step <= precision) continue;
    if (static_cast<double>(--good) / static_cast<double>(values.size()) < kShareMin) return false;
  }
  return true;
}

double usual_step(std::span<const float> values, double precision) {
  double best = 0.0;
  for (const double step : kUsualSteps) {
    if (step <= best || step < 16.0 * precision) continue;
    if (are_multiples(values.first(std::min(kFirstLook, values.size())), step, precision) &&
        are_multiples(values, step, precision))
      best = step;
  }
  return best;
}

/// The step between sorted values, for any step and origin; 0 if there is none.
double common_step(std::span<const float> sorted, double precision) {
  constexpr std::size_t kDifferencesMin = 32;
  constexpr double kBadShare = 0.02;
  constexpr double kSteps = 64.0;  // a difference of more steps is too inaccurate for one
  constexpr int kRounds = 12;
  const double alike = 2.0 * precision;
  const double least = std::max(kCoordinateStepMin_mm, 16.0 * precision);
  std::array<double, kSample> differences;
  std::size_t count = 0;
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    const double d = static_cast<double>(sorted[i]) - static_cast<double>(sorted[i - 1]);
    if (d > alike) differences[count++] = d;
  }
  if (count < kDifferencesMin) return 0.0;
  const std::span<double> d = std::span(differences).first(count);
  // Most values have no step; this is detected before sorting.
  std::nth_element(d.begin(), d.begin() + static_cast<std::ptrdiff_t>(count / 20), d.end());
  double step = d[count / 20];
  if (step < least) return 0.0;
  std::sort(d.begin(), d.end());
  std::array<double, kSample> left;
  for (int round = 0; round < kRounds; ++round) {
    if (step < least) return 0.0;
    // Small differences first, so that their steps are counted correctly.
    for (const double within : {4.0, 16.0, kSteps}) {
      double products = 0.0;
      double squares = 0.0;
      for (const double x : d) {
        const double k = std::floor(x / step + 0.5);
        if (k < 1.0) continue;
        if (k > within) break;
        if (std::abs(x - k * step) > alike) continue;
        products += k * x;
        squares += k * k;
      }
      if (squares > 0.0) step = products / squares;
    }
    std::size_t asked = 0;
    std::size_t bad = 0;
    for (const double x : d) {
      const double k = std::floor(x / step + 0.5);
      if (k > kSteps) break;
      ++asked;
      const double off = std::abs(x - k * step);
      if (off > alike) left[bad++] = off;
    }
    if (asked < kDifferencesMin) return 0.0;
    if (static_cast<double>(bad) <= kBadShare * static_cast<double>(asked)) return step;
    std::nth_element(left.begin(), left.begin() + static_cast<std::ptrdiff_t>(bad / 20),
                     left.begin() + static_cast<std::ptrdiff_t>(bad));
    step = left[bad / 20];
  }
  return 0.0;
}

/// Radix sort, least significant digit first, because it has no branch to mispredict.
void sort(std::span<float> values) {
  constexpr unsigned kDigit = 11;
  constexpr std::size_t kDigits = std::size_t{1} << kDigit;
  constexpr std::uint32_t kSign = 1U << 31U;
  std::array<std::array<std::uint32_t, kSample>, 2> keys;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto bits = std::bit_cast<std::uint32_t>(values[i]);
    keys[0][i] = (bits & kSign) != 0 ? ~bits : bits | kSign;
  }
  for (unsigned pass = 0; pass < 3; ++pass) {
    const auto digit = [&](std::uint32_t key) { return key >> (kDigit * pass) & (kDigits - 1); };
    const std::span<const std::uint32_t> from = std::span(keys[pass % 2]).first(values.size());
    std::array<std::uint32_t, kDigits + 1> place{};
    for (const std::uint32_t key : from) ++place[digit(key) + 1];
    for (std::size_t d = 1; d < kDigits; ++d) place[d] += place[d - 1];
    for (const std::uint32_t key : from) keys[1 - pass % 2][place[digit(key)]++] = key;
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::uint32_t key = keys[1][i];
    values[i] = std::bit_cast<float>((key & kSign) != 0 ? key & ~kSign : ~key);
  }
}

double step_of(std::span<float> values) {
  const double precision = precision_of(values);
  const double usual = usual_step(values, precision);
  sort(values);
  const double common = common_step(values, precision);
  // 0.14 mm is a multiple of 0.02 too. Near a usual step, the exact value is used instead of the estimate.
  return common > 1.5 * usual ? common : usual;
}

bool same_step(double a, double b) {
  return std::abs(a - b) <= kSameStep * std::max(a, b);
}

/// Lines of a raster along one axis.
struct Lines {
  double first = 0.0;
  double per_mm = 0.0;
  std::size_t count = 0;
  [[nodiscard]] std::size_t of(float v) const {
    const double k = (static_cast<double>(v) - first) * per_mm + 0.5;
    return k >= 0.0 && k < static_cast<double>(count) ? static_cast<std::size_t>(k) : count;
  }
};

Lines lines_of(const Sample& sample, std::size_t axis, double step) {
  const auto& values = sample.values[axis];
  const auto [low, high] =
      std::minmax_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(sample.count));
  Lines lines;
  lines.first = static_cast<double>(*low);
  lines.per_mm = 1.0 / step;
  const double count = (static_cast<double>(*high) - lines.first) * lines.per_mm + 1.5;
  lines.count = count < static_cast<double>(kStepScratch / 2) ? static_cast<std::size_t>(count) : 0;
  return lines;
}

constexpr std::size_t kLinesMin = 64;

/// Spacing of the values of an axis along the columns or the rows of an organised scan.
struct GridAxis {
  double pitch_mm = 0.0;  ///< 0 if not even
  bool is_of_rows = false;
  std::size_t lines = 0;  ///< from the first to the last one
};

/// Uses the sample as drawn, not sorted.
GridAxis grid_axis_of(const Cloud& cloud, const Sample& sample, std::size_t axis) {
  if (cloud.width == 0) return {};
  const std::span<const float> values = std::span(sample.values[axis]).first(sample.count);
  const double alike = 2.0 * precision_of(values);
  for (const bool of_rows : {false, true}) {
    const std::span<const std::uint32_t> line = std::span(sample.line[of_rows ? 1 : 0]).first(sample.count);
    const auto [low, high] = std::minmax_element(line.begin(), line.end());
    const std::uint32_t steps = *high - *low;
    if (steps + 1 < kLinesMin) continue;
    const auto origin = static_cast<double>(values[static_cast<std::size_t>(low - line.begin())]);
    const auto end = static_cast<double>(values[static_cast<std::size_t>(high - line.begin())]);
    const double pitch_mm = (end - origin) / static_cast<double>(steps);
    const auto is_on_line = [&](std::size_t i) {
      const double expected = origin + pitch_mm * static_cast<double>(line[i] - *low);
      return std::abs(static_cast<double>(values[i]) - expected) <= alike;
    };
    std::size_t on_line = 0;
    while (on_line < sample.count && is_on_line(on_line)) ++on_line;
    if (on_line == sample.count) return {std::abs(pitch_mm), of_rows, steps + 1};
  }
  return {};
}

/// True if these two axes are the grid of an organised scan, one step per line, and few points are missing. Then the
/// coordinates were not rounded, and the points of the lines need not be counted.
bool is_grid(const GridAxis& a, const GridAxis& b, double step_a, double step_b, const Sample& sample) {
  constexpr double kSeenMin = 0.8;
  const auto is_step = [](const GridAxis& axis, double step) {
    return axis.pitch_mm > 0.0 && axis.lines < kStepScratch / 2 &&
           std::abs(axis.pitch_mm - step) * static_cast<double>(axis.lines) < 0.5 * step;
  };
  return is_step(a, step_a) && is_step(b, step_b) && a.is_of_rows != b.is_of_rows &&
         static_cast<double>(sample.count) >= kSeenMin * static_cast<double>(sample.tries);
}

/// True for the middle half, where a field of view has no corners.
bool is_inner(std::size_t k, std::size_t count) {
  return 4 * k >= count && 4 * k < 3 * count;
}

constexpr std::size_t kLookedOfALine = 120;  // a quarter of them is in the middle half, with 13 % chance variation
/// With many missing points, chance alone makes lines uneven: then this many points are examined.
constexpr std::size_t kLookedInDoubt = 960;

/// True if nearly every line in the middle has as many points as the lines around it.
bool are_even(std::span<const std::uint32_t> points) {
  constexpr double kUneven = 0.4;        // of a line against those around it
  constexpr double kUnevenShare = 0.01;  // of all lines
  constexpr std::size_t kAround = 4;
  std::size_t lines = 0;
  std::size_t uneven = 0;
  for (std::size_t k = kAround; k + kAround < points.size(); ++k) {
    if (!is_inner(k - kAround, points.size()) || !is_inner(k + kAround, points.size())) continue;
    double around = 0.0;
    for (std::size_t i = k - kAround; i <= k + kAround; ++i) around += static_cast<double>(points[i]);
    around /= static_cast<double>(2 * kAround + 1);
    ++lines;
    if (std::abs(static_cast<double>(points[k]) - around) > kUneven * around) ++uneven;
  }
  return static_cast<double>(uneven) <= kUnevenShare * static_cast<double>(lines);
}

/// Calls `use(p)` for a selection of the existing points, one of every `stride`.
template <typename Use>
void for_points_of(const Cloud& cloud, std::size_t stride, const Use& use) {
  for (std::size_t j = 0; (j + 1) * stride <= cloud.points; ++j) {
    const float* p = cloud.xyz.data() + 3 * thinned_index(j, stride);
    if (std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2])) use(p);
  }
}

/// True if these two axes are the scanner's own raster.
bool is_raster(const Cloud& cloud, const Sample& sample, std::size_t a, std::size_t b, const Vec3& step,
               std::size_t looked_of_a_line, std::span<std::uint32_t> scratch) {
  // Half of the points may be missing; a lower density means that the step is a writer's, finer than the raster.
  constexpr double kNodesMin = 0.2;
  constexpr double kNodesMax = 1.05;
  const Lines rows = lines_of(sample, a, step[static_cast<Eigen::Index>(a)]);
  const Lines columns = lines_of(sample, b, step[static_cast<Eigen::Index>(b)]);
  if (rows.count < kLinesMin || columns.count < kLinesMin) return false;
  const std::span<std::uint32_t> row_points = scratch.first(rows.count);
  const std::span<std::uint32_t> column_points = scratch.subspan(rows.count, columns.count);
  std::fill(row_points.begin(), row_points.end(), 0U);
  std::fill(column_points.begin(), column_points.end(), 0U);
  const std::size_t stride =
      std::max<std::size_t>(1, cloud.points / (looked_of_a_line * std::max(rows.count, columns.count)));
  std::size_t inside = 0;
  for_points_of(cloud, stride, [&](const float* p) {
    const std::size_t row = rows.of(p[a]);
    const std::size_t column = columns.of(p[b]);
    if (row == rows.count || column == columns.count) return;
    if (!is_inner(row, rows.count) || !is_inner(column, columns.count)) return;
    ++row_points[row];
    ++column_points[column];
    ++inside;
  });
  const double nodes = 0.25 * static_cast<double>(rows.count) * static_cast<double>(columns.count);
  const double held = static_cast<double>(inside) * static_cast<double>(stride) / nodes;
  return held >= kNodesMin && held <= kNodesMax && are_even(row_points) && are_even(column_points);
}

/// True if this axis is the travel of the scanner, or of the block, from profile to profile.
bool is_travel(const Cloud& cloud, const Sample& sample, std::size_t axis, const Vec3& step,
               std::span<std::uint32_t> scratch) {
  const Lines profiles = lines_of(sample, axis, step[static_cast<Eigen::Index>(axis)]);
  if (profiles.count < kLinesMin) return false;
  const std::span<std::uint32_t> points = scratch.first(profiles.count);
  std::fill(points.begin(), points.end(), 0U);
  for_points_of(cloud, std::max<std::size_t>(1, cloud.points / (kLookedOfALine * profiles.count)), [&](const float* p) {
    const std::size_t profile = profiles.of(p[axis]);
    if (profile < profiles.count) ++points[profile];
  });
  return are_even(points);
}

/// Share of the columns (or rows, whichever follow each other along `axis`) of an organised scan that repeat the column
/// before: their heights are exactly the same. 0 if equal heights are not those of whole columns: a median of
/// neighbours also repeats heights, but in no order.
double share_that_repeats(const Cloud& cloud, std::size_t axis, std::size_t height, double step) {
  constexpr double kInOrderMin = 0.8;
  std::size_t pairs = 0;
  std::size_t repeated = 0;
  std::size_t in_order = 0;
  for (const auto [along, across] :
       {std::array{std::size_t{1}, cloud.width}, std::array{cloud.width, std::size_t{1}}}) {
    if (cloud.points <= along + across) continue;
    for (std::size_t i = 0; i < kSample; ++i) {
      const auto fraction = static_cast<std::uint32_t>((i + 1) * 0x9E37'79B9U);
      const auto index = static_cast<std::size_t>((std::uint64_t{fraction} * (cloud.points - along - across)) >> 32U);
      const float* p = cloud.xyz.data() + 3 * index;
      const float* q = p + 3 * along;
      const double apart_mm = std::abs(static_cast<double>(q[axis]) - static_cast<double>(p[axis]));
      // False for a point that is missing.
      if (!(std::abs(apart_mm - step) < 0.1 * step)) continue;
      ++pairs;
      if (p[height] != q[height]) continue;
      ++repeated;
      if (p[3 * across + height] == q[3 * across + height]) ++in_order;
    }
  }
  const bool whole = static_cast<double>(in_order) >= kInOrderMin * static_cast<double>(repeated);
  return pairs < kFirstLook || !whole ? 0.0 : static_cast<double>(repeated) / static_cast<double>(pairs);
}

/// Distance of the original points if an organised raster of this step took each height from the nearest one; 0 if no
/// heights repeat. Heights with noise repeat once in thousands of points.
double resampled_from(const Cloud& cloud, std::size_t axis, std::size_t height, double step) {
  constexpr double kRepeatsMin = 0.02;
  constexpr double kRepeatsMax = 0.85;  // more are heights without any noise, level to the axis
  if (cloud.width == 0) return 0.0;
  const double share = share_that_repeats(cloud, axis, height, step);
  return share < kRepeatsMin || share > kRepeatsMax ? 0.0 : step / (1.0 - share);
}

}  // namespace

Vec3 find_coordinate_step(const Cloud& cloud, std::span<std::uint32_t> scratch) {
  Vec3 step = Vec3::Zero();
  Sample sample;
  draw(cloud, sample);
  if (sample.count < kFirstLook) return step;
  std::array<GridAxis, 3> grid;
  for (std::size_t axis = 0; axis < 3; ++axis) grid[axis] = grid_axis_of(cloud, sample, axis);
  for (std::size_t axis = 0; axis < 3; ++axis)
    step[static_cast<Eigen::Index>(axis)] = step_of(std::span(sample.values[axis]).first(sample.count));
  for (std::size_t third = 0; third < 3; ++third) {
    const std::size_t a = third == 0 ? 1 : 0;
    const std::size_t b = third == 2 ? 1 : 2;
    double& step_a = step[static_cast<Eigen::Index>(a)];
    double& step_b = step[static_cast<Eigen::Index>(b)];
    const double step_third = step[static_cast<Eigen::Index>(third)];
    if (step_a == 0.0 || step_b == 0.0 || same_step(step_a, step_third) || same_step(step_b, step_third)) continue;
    if (!is_grid(grid[a], grid[b], step_a, step_b, sample) &&
        !is_raster(cloud, sample, a, b, step, kLookedOfALine, scratch) &&
        !is_raster(cloud, sample, a, b, step, kLookedInDoubt, scratch))
      continue;
    // Heights in steps repeat by themselves.
    const bool is_exact = step_third == 0.0;
    const double from_a = is_exact ? resampled_from(cloud, a, third, step_a) : 0.0;
    const double from_b = is_exact ? resampled_from(cloud, b, third, step_b) : 0.0;
    step_a = from_a;
    step_b = from_b;
    break;
  }
  for (Eigen::Index axis = 0; axis < 2; ++axis)
    if (step[axis] != 0.0 && step[1 - axis] == 0.0 && step.z() == 0.0 &&
        is_travel(cloud, sample, static_cast<std::size_t>(axis), step, scratch))
      step[axis] = 0.0;
  return step;
}

}  // namespace slabd::algo
