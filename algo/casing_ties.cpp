// SPDX-License-Identifier: Apache-2.0
//
// A casing's bore returns nothing, its flat rim and the bearing plane around it do: from above a round hole with a full
// ring. Two of them, 233 mm apart, are looked for in a raster of point counts along the strip they must lie in. A
// missing patch has no ring, plain surface has no hole, so neither is mistaken for a bore; and what is found must then
// pass as a circle of the right radius.
#include "algo/casing_ties.h"

#include <algorithm>
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
static_assert(2 * CasingStrips::kCells <= limits::kDeviationBins, "two strips of 1 mm cells");
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

/// Keeps, in place, the points within `reach_mm` of either casing along both axes of the seat.
std::span<const std::uint32_t> near_casings(const Cloud& cloud, std::span<std::uint32_t> index,
                                            const CasingStrips& strips, double reach_mm) {
  const Mat3& R = strips.R_seat_scanner;
  std::size_t kept = 0;
  for (const std::uint32_t i : index) {
    const float* f = &cloud.xyz[3 * std::size_t{i}];
    const Vec3 p(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
    const double x = R(0, 0) * p.x() + R(0, 1) * p.y() + R(0, 2) * p.z() + strips.t_seat_scanner.x();
    const double s = R(1, 0) * p.x() + R(1, 1) * p.y() + R(1, 2) * p.z() + strips.t_seat_scanner.y();
    if (std::abs(x) <= reach_mm && std::abs(std::abs(s) - strips.half_spacing_mm) <= reach_mm) index[kept++] = i;
  }
  return index.first(kept);
}

}  // namespace

CasingTies tie_to_casings(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                          const Pose& T_block_scanner, const CasingTiesWorkspace& work) {
  const BlockGeometry& g = model.geometry();
  const double bore_radius = 0.5 * g.casing_bore_diameter_mm.value;
  const double rim_radius = 0.5 * g.casing_rim_diameter_mm.value;
  const Plane& seat = model.plane(Face::seat);
  const std::span<std::uint32_t> inner = work.counts.first(CasingStrips::kCells);
  const std::span<std::uint32_t> outer = work.counts.subspan(CasingStrips::kCells, CasingStrips::kCells);

  CasingTies found{T_block_scanner, {}};
  const std::size_t strip_points =
      count_strips(cloud, strips_of(model, T_block_scanner), work.index, work.counts.first(2 * CasingStrips::kCells));
  const BoreCells bore(bore_radius);
  const double usual = 0.5 * (usual_count(inner) + usual_count(outer));
  const int reach = std::min(static_cast<int>(settings.window_mm), CasingStrips::kShiftMax_mm);
  double best_score = kScoreMin;
  int best_mm = 0;
  for (int k = 0; k <= 2 * reach; ++k) {
    const int x_mm = k % 2 == 0 ? k / 2 : -(k + 1) / 2;
    const double score = std::max(bore.score(inner, x_mm, usual), 0.0) + std::max(bore.score(outer, x_mm, usual), 0.0);
    if (score <= best_score) continue;
    best_score = score;
    best_mm = x_mm;
  }
  if (!(best_score > kScoreMin)) return found;
  found.T_block_scanner.translation_mm.x() -= best_mm;

  PlaneFit bearing;
  bearing.ok = true;
  bearing.normal = seat.n;
  bearing.offset_mm = seat.d;
  const CloudPoints points{cloud.xyz.data(),
                           near_casings(cloud, work.index.first(strip_points), strips_of(model, found.T_block_scanner),
                                        rim_radius + kAround_mm),
                           FastTransform(found.T_block_scanner)};
  const Pose back = found.T_block_scanner.inverse();
  for (const bool outside : {false, true}) {
    const Vec3 nominal = model.casing_centre(outside);
    const CasingFeature casing = measure_casing(
        points, {nominal, bore_radius, rim_radius, g.casing_rim_height_mm.value, settings.edge_margin_mm, bearing});
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
