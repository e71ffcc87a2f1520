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
#include "algo/points.h"

namespace slabd::algo {
namespace {

/// Points this far from the bearing plane belong to the strip: rims are sunk by less than a millimetre.
constexpr double kHeight_mm = 3.0;
/// The hole's certain inside, and the ring around it that must be full.
constexpr double kInside_mm = 2.5;
constexpr double kRingFrom_mm = 1.5;
constexpr double kRingTo_mm = 6.0;
/// Half width of the strip: bore, ring and a few millimetres.
constexpr int kHalfRows = 30;
constexpr int kShiftMax_mm = 100;
constexpr int kHalfColumns = kShiftMax_mm + kHalfRows;
constexpr std::size_t kRows = 2 * kHalfRows;
constexpr std::size_t kColumns = 2 * kHalfColumns;
static_assert(2 * kRows * kColumns <= limits::kDeviationBins, "two strips of 1 mm cells");
/// Full ring and empty hole score 1 for each casing; a hole that is not empty costs three times what a ring brings.
constexpr double kHoleWeight = 3.0;
constexpr double kScoreMin = 0.5;
/// Where a fit's own covariance is missing: a tenth of a millimetre, the edge at half a millimetre's pitch.
constexpr double kSigmaUnknown_mm = 0.1;

/// Point counts in 1 mm cells around the nominal place of one casing: columns along the rail, rows along the seat.
class Strip {
 public:
  Strip(std::span<std::uint32_t> cells, double s0) : cells_(cells), s0_(s0) {
    std::fill(cells_.begin(), cells_.end(), 0U);
  }

  bool add(double x, double s) {
    const double column = std::floor(x) + kHalfColumns;
    const double row = std::floor(s - s0_) + kHalfRows;
    if (!(column >= 0.0 && column < static_cast<double>(kColumns) && row >= 0.0 && row < static_cast<double>(kRows)))
      return false;
    ++cells_[static_cast<std::size_t>(row) * kColumns + static_cast<std::size_t>(column)];
    return true;
  }

  /// How much the surroundings of `x_mm` look like a bore of this radius, 1 at most; `usual`: points of a full cell.
  [[nodiscard]] double score(int x_mm, double bore_radius, double usual) const {
    double inside = 0.0, inside_cells = 0.0, ring = 0.0, ring_cells = 0.0;
    for (int row = -kHalfRows; row < kHalfRows; ++row) {
      for (int column = -kHalfRows; column < kHalfRows; ++column) {
        const double r = std::hypot(column + 0.5, row + 0.5);
        const bool in = r < bore_radius - kInside_mm;
        if (!in && (r < bore_radius + kRingFrom_mm || r > bore_radius + kRingTo_mm)) continue;
        const auto at = static_cast<std::size_t>(row + kHalfRows) * kColumns +
                        static_cast<std::size_t>(x_mm + column + kHalfColumns);
        const double fill = std::min(1.0, static_cast<double>(cells_[at]) / usual);
        (in ? inside : ring) += fill;
        (in ? inside_cells : ring_cells) += 1.0;
      }
    }
    return ring / std::max(ring_cells, 1.0) - kHoleWeight * inside / std::max(inside_cells, 1.0);
  }

  /// Mean count of the cells that have any.
  [[nodiscard]] double usual() const {
    double points = 0.0, cells = 0.0;
    for (const std::uint32_t c : cells_) {
      points += c;
      cells += c > 0 ? 1.0 : 0.0;
    }
    return std::max(points, 1.0) / std::max(cells, 1.0);
  }

 private:
  std::span<std::uint32_t> cells_;
  double s0_;
};

}  // namespace

CasingTies tie_to_casings(const Cloud& cloud, const BlockModel& model, const EvaluationSettings& settings,
                          const Pose& T_block_scanner, const CasingTiesWorkspace& work) {
  const BlockGeometry& g = model.geometry();
  const double s0 = g.casing_half_spacing_mm.value;
  const double bore_radius = 0.5 * g.casing_bore_diameter_mm.value;
  const Plane& seat = model.plane(Face::seat);
  Strip inner(work.counts.first(kRows * kColumns), -s0);
  Strip outer(work.counts.subspan(kRows * kColumns, kRows * kColumns), s0);

  CasingTies found{T_block_scanner, {}};
  std::size_t strip_points = 0;
  const FastTransform at_start(T_block_scanner);
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const Vec3 p = at_start(cloud.xyz.data() + 3 * i);
    if (!(std::abs(seat.distance(p)) <= kHeight_mm)) continue;  // missing points neither
    const double s = model.along_seat().dot(p);
    if ((s < 0.0 ? inner : outer).add(p.x(), s)) work.index[strip_points++] = static_cast<std::uint32_t>(i);
  }
  const double usual = 0.5 * (inner.usual() + outer.usual());
  const int reach = std::min(static_cast<int>(settings.window_mm), kShiftMax_mm);
  double best_score = kScoreMin;
  int best_mm = 0;
  for (int k = 0; k <= 2 * reach; ++k) {
    const int x_mm = k % 2 == 0 ? k / 2 : -(k + 1) / 2;
    const double score =
        std::max(inner.score(x_mm, bore_radius, usual), 0.0) + std::max(outer.score(x_mm, bore_radius, usual), 0.0);
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
  const CloudPoints points{cloud.xyz.data(), work.index.first(strip_points), FastTransform(found.T_block_scanner)};
  const Pose back = found.T_block_scanner.inverse();
  for (const bool outside : {false, true}) {
    const Vec3 nominal = model.casing_centre(outside);
    const CasingFeature casing =
        measure_casing(points, {nominal, bore_radius, 0.5 * g.casing_rim_diameter_mm.value,
                                g.casing_rim_height_mm.value, settings.edge_margin_mm, bearing});
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
