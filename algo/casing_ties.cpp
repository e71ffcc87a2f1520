// SPDX-License-Identifier: Apache-2.0
//
// A casing's bore returns nothing, its flat rim and the bearing plane around it do: from above a round hole with a full
// ring. Two of them, 233 mm apart, are looked for in a raster of point counts along the strip they must lie in. A
// missing patch has no ring, plain surface has no hole, so neither is mistaken for a bore; and what is found must then
// pass as a circle of the right radius.
#include "algo/casing_ties.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/casing.h"
#include "algo/casing_strip.h"
#include "algo/points.h"

namespace slabd::algo {
namespace {

/// The hole's certain inside, and the ring around it that must be full.
constexpr double kInside_mm = 2.5;
constexpr double kRingFrom_mm = 1.5;
constexpr double kRingTo_mm = 6.0;
static_assert(4 * CasingStrips::kCells <= limits::kDeviationBins,
              "two strips of 1 mm cells, for each half of the scan");
/// Full ring and empty hole score 1 for each casing; a hole that is not empty costs three times what a ring brings.
constexpr double kHoleWeight = 3.0;
constexpr double kScoreMin = 0.5;
/// Where a fit's own covariance is missing: a tenth of a millimetre, the edge at half a millimetre's pitch.
constexpr double kSigmaUnknown_mm = 0.1;
/// Points this far outside of a rim still help to measure the casing.
constexpr double kAround_mm = 10.0;

/// The cells of a bore's inside and of the ring around it, as steps from the cell of its centre.
class BoreCells {
 public:
  explicit BoreCells(double bore_radius) {
    for (int row = -CasingStrips::kHalfRows; row < CasingStrips::kHalfRows; ++row) {
      for (int column = -CasingStrips::kHalfRows; column < CasingStrips::kHalfRows; ++column) {
        const double r = std::hypot(column + 0.5, row + 0.5);
        const bool in = r < bore_radius - kInside_mm;
        if (!in && (r < bore_radius + kRingFrom_mm || r > bore_radius + kRingTo_mm)) continue;
        const int step = row * static_cast<int>(CasingStrips::kColumns) + column;
        (void)(in ? inside_ : ring_).push(static_cast<std::int16_t>(step));
      }
    }
  }
  /// How much the surroundings of `x_mm` look like a bore, 1 at most; `usual`: points of a full cell.
  [[nodiscard]] double score(std::span<const std::uint32_t> cells, int x_mm, double usual) const {
    const double ring = fill(ring_, cells, x_mm, usual);
    const double inside = fill(inside_, cells, x_mm, usual);
    return ring - kHoleWeight * inside;
  }

 private:
  static constexpr std::size_t kMost = CasingStrips::kRows * CasingStrips::kRows;
  using Steps = FixedVector<std::int16_t, kMost>;
  static double fill(const Steps& steps, std::span<const std::uint32_t> cells, int x_mm, double usual) {
    const int centre =
        CasingStrips::kHalfRows * static_cast<int>(CasingStrips::kColumns) + x_mm + CasingStrips::kHalfColumns;
    double sum = 0.0;
    for (const std::int16_t step : steps)
      sum += std::min(1.0, static_cast<double>(cells[static_cast<std::size_t>(centre + step)]) / usual);
    return sum / std::max(static_cast<double>(steps.size()), 1.0);
  }
  Steps inside_;
  Steps ring_;
};

/// Mean count of the cells that have any.
double usual_count(std::span<const std::uint32_t> cells) {
  double points = 0.0, full = 0.0;
  for (const std::uint32_t c : cells) {
    points += c;
    full += c > 0 ? 1.0 : 0.0;
  }
  return std::max(points, 1.0) / std::max(full, 1.0);
}

/// From the block frame to the seat's, both at the block's origin but for the height.
CasingStrips strips_of(const BlockModel& model, const Pose& T_block_scanner) {
  const Plane& seat = model.plane(Face::seat);
  Mat3 rows;
  rows.row(0) = Vec3::UnitX();
  rows.row(1) = model.along_seat();
  rows.row(2) = seat.n;
  CasingStrips strips;
  strips.R_seat_scanner = rows * T_block_scanner.rotation.toRotationMatrix();
  strips.t_seat_scanner = rows * T_block_scanner.translation_mm - Vec3(0.0, 0.0, seat.d);
  strips.half_spacing_mm = model.geometry().casing_half_spacing_mm.value;
  return strips;
}

/// count_strips, one half of the cloud on each thread. The counts are the first 2 * kCells; returns the points counted.
std::span<std::uint32_t> count_both_halves(const Cloud& cloud, const CasingStrips& strips,
                                           const CasingTiesWorkspace& work, Team& team) {
  constexpr std::size_t kBoth = 2 * CasingStrips::kCells;
  const std::array<std::size_t, 3> from = {0, cloud.points / 2, cloud.points};
  std::array<std::size_t, 2> counted{};
  team.run(2, [&](std::size_t half) {
    const std::size_t points = from[half + 1] - from[half];
    const Cloud part{cloud.xyz.subspan(3 * from[half], 3 * points), points, 0, 0};
    counted[half] =
        count_strips(part, strips, work.index.subspan(from[half], points), work.counts.subspan(half * kBoth, kBoth));
  });
  for (std::size_t k = 0; k < kBoth; ++k) work.counts[k] += work.counts[kBoth + k];
  for (std::size_t k = 0; k < counted[1]; ++k)
    work.index[counted[0] + k] = work.index[from[1] + k] + static_cast<std::uint32_t>(from[1]);
  return work.index.first(counted[0] + counted[1]);
}

/// The bores in a raster along the rail.
struct BoresFound {
  std::optional<double> off_mm;
  std::span<std::uint32_t> strip_points;  ///< all points of the strips
};

BoresFound find_bores(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                      const Pose& T_block_scanner, const CasingTiesWorkspace& work, Team& team) {
  const std::span<std::uint32_t> inner = work.counts.first(CasingStrips::kCells);
  const std::span<std::uint32_t> outer = work.counts.subspan(CasingStrips::kCells, CasingStrips::kCells);
  BoresFound found;
  found.strip_points = count_both_halves(cloud, strips_of(model, T_block_scanner), work, team);
  const BoreCells bore(0.5 * model.geometry().casing_bore_diameter_mm.value);
  const double usual = 0.5 * (usual_count(inner) + usual_count(outer));
  const int reach = std::min(static_cast<int>(settings.window_mm), CasingStrips::kShiftMax_mm);
  double best_score = kScoreMin;
  for (int k = 0; k <= 2 * reach; ++k) {
    const int x_mm = k % 2 == 0 ? k / 2 : -(k + 1) / 2;
    const double score = std::max(bore.score(inner, x_mm, usual), 0.0) + std::max(bore.score(outer, x_mm, usual), 0.0);
    if (score <= best_score) continue;
    best_score = score;
    found.off_mm = x_mm;
  }
  return found;
}

/// Distance from the origin along the seat.
double along_seat(const Cloud& cloud, const CasingStrips& strips, std::uint32_t i) {
  const float* f = &cloud.xyz[3 * std::size_t{i}];
  const auto row = strips.R_seat_scanner.row(1);
  return row[0] * static_cast<double>(f[0]) + row[1] * static_cast<double>(f[1]) + row[2] * static_cast<double>(f[2]) +
         strips.t_seat_scanner.y();
}

/// Keeps, in place, the points within `reach_mm` of either casing along both axes of the seat.
std::span<const std::uint32_t> near_casings(const Cloud& cloud, std::span<std::uint32_t> index,
                                            const CasingStrips& strips, double reach_mm) {
  const Mat3& R = strips.R_seat_scanner;
  std::size_t kept = 0;
  for (const std::uint32_t i : index) {
    const float* f = &cloud.xyz[3 * std::size_t{i}];
    const Vec3 p(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
    const double x = R(0, 0) * p.x() + R(0, 1) * p.y() + R(0, 2) * p.z() + strips.t_seat_scanner.x();
    if (std::abs(x) <= reach_mm &&
        std::abs(std::abs(along_seat(cloud, strips, i)) - strips.half_spacing_mm) <= reach_mm)
      index[kept++] = i;
  }
  return index.first(kept);
}

/// Those on one side. All of them would do as well, only slower; so they do where `room` is short.
std::span<const std::uint32_t> on_side(const Cloud& cloud, std::span<const std::uint32_t> index,
                                       const CasingStrips& strips, bool outside, std::span<std::uint32_t> room) {
  if (room.size() < index.size()) return index;
  std::size_t kept = 0;
  for (const std::uint32_t i : index)
    if ((along_seat(cloud, strips, i) >= 0.0) == outside) room[kept++] = i;
  return room.first(kept);
}

}  // namespace

std::optional<double> casings_off_mm(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                                     const Pose& T_block_scanner, const CasingTiesWorkspace& work, Team& team) {
  return find_bores(cloud, model, settings, T_block_scanner, work, team).off_mm;
}

CasingTies tie_to_casings(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                          const Pose& T_block_scanner, const CasingTiesWorkspace& work, Team& team) {
  const BlockGeometry& g = model.geometry();
  const double bore_radius = 0.5 * g.casing_bore_diameter_mm.value;
  const double rim_radius = 0.5 * g.casing_rim_diameter_mm.value;
  const Plane& seat = model.plane(Face::seat);

  CasingTies found{T_block_scanner, {}};
  const BoresFound bores = find_bores(cloud, model, settings, T_block_scanner, work, team);
  if (!bores.off_mm) return found;
  found.T_block_scanner.translation_mm.x() -= *bores.off_mm;

  PlaneFit bearing;
  bearing.ok = true;
  bearing.normal = seat.n;
  bearing.offset_mm = seat.d;
  const CasingStrips strips = strips_of(model, found.T_block_scanner);
  const auto near = near_casings(cloud, bores.strip_points, strips, rim_radius + kAround_mm);
  const FastTransform transform(found.T_block_scanner);
  // Room behind them for the points of each casing.
  const std::span<std::uint32_t> room = work.index.subspan(near.size());
  std::array<CasingFeature, 2> casings;
  team.run(casings.size(), [&](std::size_t side) {
    const bool outside = side == 1;
    const CloudPoints points{
        cloud.xyz.data(),
        on_side(cloud, near, strips, outside, room.subspan(side * (room.size() / 2), room.size() / 2)), transform};
    casings[side] = measure_casing(points, {model.casing_centre(outside), bore_radius, rim_radius,
                                            g.casing_rim_height_mm.value, settings.edge_margin_mm, bearing});
  });
  const Pose back = found.T_block_scanner.inverse();
  for (std::size_t side = 0; side < casings.size(); ++side) {
    const CasingFeature& casing = casings[side];
    const Vec3 nominal = model.casing_centre(side == 1);
    if (!casing.ok) continue;
    const auto sigma = [&](int k) {
      const double variance = casing.cov_circle(k, k);
      return variance > 0.0 && std::isfinite(variance) ? std::sqrt(variance) : kSigmaUnknown_mm;
    };
    const Vec3 p_scanner = back * casing.centre;
    (void)found.ties.push({p_scanner, Vec3::UnitX(), nominal.x(), sigma(0)});
    (void)found.ties.push({p_scanner, model.along_seat(), model.along_seat().dot(nominal), sigma(1)});
  }
  return found;
}

}  // namespace slabd::algo
