// SPDX-License-Identifier: Apache-2.0
#include "algo/features/seat_cells.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algo/algo.h"
#include "algo/features/flatness.h"
#include "base/base.h"

namespace slabd::algo {
namespace {

constexpr float kNone = -std::numeric_limits<float>::infinity();  ///< lower than any height; -kNone is higher
constexpr std::size_t kCells = limits::kFlatnessCellsMax;
/// Radius of the disc in cells: 20 mm across in cells of half a millimetre.
constexpr int kReachMax = 20;
/// Cells around a sunk place that say how the surface goes on over it.
constexpr int kRing = 3;
/// ... and how many of them a curved surface needs, or a plane.
constexpr double kCurvedMin = 24.0;
constexpr double kPlaneMin = 8.0;
/// A sunk place is a pit if the surface around it, continued, lies so far above its bottom, as a part of what the
/// closing says: over a wide hollow it leads down to the bottom.
constexpr double kPitShare = 0.6;
/// Directions in which the width of a place is measured.
constexpr std::size_t kDirections = 8;

/// Best value within a disc about each cell, or `none`, which is worse than any value. Works on a row at a time,
/// shifted against itself by each offset within the disc.
template <typename Better>
void disc_filter(const CellGrid& grid, std::span<const float> in, std::span<float> out, int reach, float none,
                 const Better& better) {
  const auto columns = static_cast<int>(grid.columns);
  const auto rows = static_cast<int>(grid.rows);
  const double radius = reach + 0.25;
  std::fill(out.begin(), out.end(), none);
  for (int row = 0; row < rows; ++row)
    for (int r = std::max(-reach, -row); r <= std::min(reach, rows - 1 - row); ++r) {
      // Half the chord of this row of the disc.
      const int wide = std::min(static_cast<int>(std::sqrt(radius * radius - r * r)), columns - 1);
      float* best = &out[static_cast<std::size_t>(row * columns)];
      const float* from = &in[static_cast<std::size_t>((row + r) * columns)];
      for (int off = -wide; off <= wide; ++off)
        for (int c = std::max(0, -off); c < columns - std::max(0, off); ++c)
          best[c] = better(from[c + off], best[c]) ? from[c + off] : best[c];
    }
}

/// Greatest width of a group of cells over all directions. Of a cell at the rim of a steep pit only the part is sunk by
/// which it is lower than the deepest of its neighbours: `share(cell)`.
template <typename Share>
double width_of(const CellGrid& grid, std::span<const std::uint32_t> group, const Share& share) {
  std::array<double, kDirections> low;
  std::array<double, kDirections> high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  for (const std::uint32_t c : group) {
    const double beyond = (share(c) - 0.5) * grid.region.cell_mm;
    for (std::size_t d = 0; d < kDirections; ++d) {
      const double angle = kPi * static_cast<double>(d) / kDirections;
      const double at = std::cos(angle) * grid.x_of(c) + std::sin(angle) * grid.s_of(c);
      low[d] = std::min(low[d], at - beyond);
      high[d] = std::max(high[d], at + beyond);
    }
  }
  double widest = 0.0;
  for (std::size_t d = 0; d < kDirections; ++d) widest = std::max(widest, high[d] - low[d]);
  return widest;
}

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6x6 = Eigen::Matrix<double, 6, 6>;

/// A surface through the cells of a ring: z = a . (1, u, v, u^2, u v, v^2).
struct RingFit {
  double x = 0.0;
  double s = 0.0;
  Vec6 a = Vec6::Zero();
  bool ok = false;

  [[nodiscard]] static Vec6 terms(double u, double v, bool curved) {
    Vec6 t = Vec6::Zero();
    t.head<3>() << 1.0, u, v;
    if (curved) t.tail<3>() << u * u, u * v, v * v;
    return t;
  }
  [[nodiscard]] double at(double px, double ps) const { return a.dot(terms(px - x, ps - s, true)); }
};

}  // namespace

Closing close_pits(const CellGrid& grid, std::span<const std::uint32_t> cell, std::span<const double> height,
                   const PitSize& size, std::span<std::uint32_t> mark, std::span<std::uint32_t> stack,
                   std::span<double> closed) {
  Closing result;
  std::copy(height.begin(), height.end(), closed.begin());
  const std::size_t cells = grid.cells();
  std::array<float, kCells> raw;
  std::array<float, kCells> closing;
  std::array<float, kCells> between;
  std::array<std::uint16_t, kCells> number;
  const std::span<float> f = std::span(raw).first(cells);
  const std::span<float> c = std::span(closing).first(cells);
  std::fill(f.begin(), f.end(), kNone);
  for (std::size_t k = 0; k < cell.size(); ++k) {
    f[cell[k]] = static_cast<float>(height[k]);
    number[cell[k]] = static_cast<std::uint16_t>(k);
  }
  const int reach = std::min(static_cast<int>(std::lround(0.5 * size.width_mm / grid.region.cell_mm)), kReachMax);
  const std::span<float> room = std::span(between).first(cells);
  disc_filter(grid, f, room, reach, kNone, [](float a, float b) { return a > b; });
  std::replace(room.begin(), room.end(), kNone, -kNone);
  disc_filter(grid, room, c, reach, -kNone, [](float a, float b) { return a < b; });
  std::replace(c.begin(), c.end(), -kNone, kNone);

  for (std::size_t i = 0; i < cells; ++i)
    mark[i] = f[i] != kNone && static_cast<double>(c[i] - f[i]) > size.least_mm ? kLow : kPlain;
  // Groups lose their marks when they are found; who is sunk is asked of the heights.
  const auto sunk = [&](std::size_t i) { return static_cast<double>(c[i] - f[i]) > size.least_mm; };
  const auto share_sunk = [&](std::size_t i) {
    const std::size_t column = i % grid.columns;
    const std::size_t row = i / grid.columns;
    float deepest = 0.0F;
    for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, grid.rows - 1); ++r)
      for (std::size_t k = column - std::min<std::size_t>(column, 1); k <= std::min(column + 1, grid.columns - 1); ++k)
        if (const std::size_t j = r * grid.columns + k; f[j] != kNone) deepest = std::max(deepest, c[j] - f[j]);
    return static_cast<double>((c[i] - f[i]) / deepest);
  };
  for_each_group(grid, kLow, mark, stack, [&](std::span<const std::uint32_t> group) {
    if (width_of(grid, group, share_sunk) > size.width_mm) return;
    RingFit ring;
    std::size_t low_column = grid.columns, high_column = 0, low_row = grid.rows, high_row = 0;
    for (const std::uint32_t i : group) {
      ring.x += grid.x_of(i) / static_cast<double>(group.size());
      ring.s += grid.s_of(i) / static_cast<double>(group.size());
      low_column = std::min(low_column, i % grid.columns);
      high_column = std::max(high_column, i % grid.columns);
      low_row = std::min(low_row, i / grid.columns);
      high_row = std::max(high_row, i / grid.columns);
    }
    double n = 0.0;
    double mean = 0.0;
    Vec3 aside = Vec3::Zero();
    const auto for_ring = [&](const auto& use) {
      for (std::size_t row = low_row - std::min<std::size_t>(low_row, kRing);
           row <= std::min(high_row + kRing, grid.rows - 1); ++row)
        for (std::size_t column = low_column - std::min<std::size_t>(low_column, kRing);
             column <= std::min(high_column + kRing, grid.columns - 1); ++column) {
          const std::size_t i = row * grid.columns + column;
          if (f[i] != kNone && !sunk(i)) use(i);
        }
    };
    for_ring([&](std::size_t i) {
      n += 1.0;
      mean += static_cast<double>(f[i]);
      aside += Vec3(grid.x_of(i) - ring.x, grid.s_of(i) - ring.s, 0.0);
    });
    if (n < kPlaneMin) return;
    mean /= n;
    // Beside the border of the region the ring lies on one side only, and what is curved there leads anywhere.
    const bool curved = n >= kCurvedMin && (aside / n).norm() < grid.region.cell_mm;
    const bool level = (aside / n).norm() > 2.0 * grid.region.cell_mm;
    Mat6x6 A = Mat6x6::Identity() * 1e-9;
    Vec6 b = Vec6::Zero();
    for_ring([&](std::size_t i) {
      const Vec6 t = RingFit::terms(grid.x_of(i) - ring.x, grid.s_of(i) - ring.s, curved);
      A += t * t.transpose();
      b += (static_cast<double>(f[i]) - mean) * t;
    });
    if (!level) ring.a = A.ldlt().solve(b);
    if (!ring.a.allFinite()) return;
    double below_closing = 0.0;
    double below_ring = 0.0;
    for (const std::uint32_t i : group) {
      const double over = mean + ring.at(grid.x_of(i), grid.s_of(i));
      below_closing = std::max(below_closing, static_cast<double>(c[i] - f[i]));
      below_ring = std::max(below_ring, over - static_cast<double>(f[i]));
    }
    if (below_ring < kPitShare * below_closing || below_ring > size.most_mm) return;
    ++result.pits;
    for (const std::uint32_t i : group) {
      const double over = mean + ring.at(grid.x_of(i), grid.s_of(i));
      double& to = closed[number[i]];
      to = std::max(to, std::min(over, static_cast<double>(c[i])));
    }
  });
  return result;
}

// Minimum zone of thousands of points, exactly and in fixed memory.
//
// The thinnest zone of any set touches it in three points on one side and one on the other, or in two and two. Of a
// few points it can therefore be found by trying every such contact: the normal is the cross product of two
// connections. The few points that matter are found by cutting planes: solve for the active points, look which points
// of the whole set stick out of that zone most, take them in, repeat. The width for the active points can only be
// too small, the width of the whole set along the found normal only too large: when they meet, both are the answer.

namespace {

/// Ten points start it and two join per pass; flat surfaces end with about eleven.
constexpr std::size_t kActiveMax = 40;

struct Extremes {
  double width = 0.0;
  std::size_t low = 0;
  std::size_t high = 0;
};

Extremes extremes_along(std::span<const Vec3> points, const Vec3& n, const Vec3& origin) {
  Extremes e;
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double h = n.dot(points[i] - origin);
    if (h < low) {
      low = h;
      e.low = i;
    }
    if (h > high) {
      high = h;
      e.high = i;
    }
  }
  e.width = high - low;
  return e;
}

struct ActiveSet {
  std::array<std::size_t, kActiveMax> index{};
  std::array<Vec3, kActiveMax> points{};
  std::size_t size = 0;

  [[nodiscard]] bool holds(std::size_t i) const {
    return std::find(index.begin(), index.begin() + static_cast<std::ptrdiff_t>(size), i) !=
           index.begin() + static_cast<std::ptrdiff_t>(size);
  }
  /// False when it is full.
  bool add(std::size_t i, const Vec3& p) {
    if (holds(i)) return true;
    if (size == kActiveMax) return false;
    index[size] = i;
    points[size++] = p;
    return true;
  }
};

/// Thinnest zone of the active points by trying every contact: the cross products of all pairs of connections.
double thinnest(const ActiveSet& active, const Vec3& origin, Vec3& normal) {
  const std::span<const Vec3> points(active.points.data(), active.size);
  double best = std::numeric_limits<double>::infinity();
  const std::size_t pairs = active.size * active.size;
  const auto connection = [&](std::size_t pair, Vec3& v) {
    const std::size_t i = pair / active.size;
    const std::size_t j = pair % active.size;
    v = points[j] - points[i];
    return i < j;
  };
  for (std::size_t a = 0; a < pairs; ++a) {
    Vec3 u;
    if (!connection(a, u)) continue;
    for (std::size_t b = a + 1; b < pairs; ++b) {
      Vec3 v;
      if (!connection(b, v)) continue;
      Vec3 n = u.cross(v);
      const double length = n.norm();
      if (!(length > 1e-12 * u.norm() * v.norm())) continue;
      n /= length;
      // Width with early exit, as most contacts lose at once.
      double low = 0.0;
      double high = 0.0;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double h = n.dot(points[i] - origin);
        if (i == 0) low = high = h;
        low = std::min(low, h);
        high = std::max(high, h);
        if (high - low >= best) break;
      }
      if (high - low < best) {
        best = high - low;
        normal = n;
      }
    }
  }
  return best;
}

}  // namespace

double minimum_zone_mm(std::span<const Vec3> points) {
  if (points.size() < 4) return kNoValue;
  const PlaneFit plane = fit_plane_lsq(points, Vec3::UnitZ());
  if (!plane.ok) return kNoValue;
  const Vec3 origin = points[0];

  // Start: the extremes of the least-squares plane, and of that plane tilted a little in four directions.
  double extent = 0.0;
  for (const Vec3& p : points) extent = std::max(extent, (p - origin).norm());
  const Vec3 u = plane.normal.unitOrthogonal();
  const Vec3 v = plane.normal.cross(u);
  const double tilt = std::max(extremes_along(points, plane.normal, origin).width / extent, 1e-9);
  ActiveSet active;
  for (const Vec3& lean : {Vec3(Vec3::Zero()), Vec3(tilt * u), Vec3(-tilt * u), Vec3(tilt * v), Vec3(-tilt * v)}) {
    const Extremes e = extremes_along(points, (plane.normal + lean).normalized(), origin);
    active.add(e.low, points[e.low]);
    active.add(e.high, points[e.high]);
  }
  // A zone needs four contacts: fill up from the set, whichever points they are.
  for (std::size_t i = 0; i < points.size() && active.size < 4; ++i) active.add(i, points[i]);

  for (;;) {
    Vec3 normal = plane.normal;
    const double small = thinnest(active, origin, normal);
    if (!std::isfinite(small)) return kNoValue;
    const Extremes full = extremes_along(points, normal, origin);
    if (full.width <= small) return small;
    if (active.holds(full.low) && active.holds(full.high)) return full.width;
    if (!active.add(full.low, points[full.low]) || !active.add(full.high, points[full.high])) return kNoValue;
  }
}

}  // namespace slabd::algo
