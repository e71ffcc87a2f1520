// SPDX-License-Identifier: Apache-2.0
//
// Problem: a cast block differs from its model. Faces are off by some tenths of a millimetre, edges have chamfers and
// fillets that differ between blocks and along one edge, shoulders undulate. All of that is good concrete.
//
// Idea: the expected value of a cell comes from similar cells of the scan. The face is the fitted plane. A strip along
// an edge is expected to look like the median of all strips at the same distance from that edge. The remainder is form,
// which is smooth: its means over squares of 20 mm, interpolated, are subtracted too.
#include "algo/survey/surface_reference.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace slabd::algo {
namespace {

using namespace surface_cell;

constexpr std::size_t kColumns = kSurfaceColumns;
constexpr std::size_t kRows = kSurfaceRows;

/// A fitted plane relative to the nominal one.
FacePlane plane_over(const Plane& nominal, const PlaneFit& fit) {
  const auto height = [&](double x, double y) {
    return fit.offset_mm - fit.normal.dot(Vec3(x, y, nominal.z_at(x, y)));
  };
  const double y0 = nominal.d * nominal.n.y();
  FacePlane plane;
  plane.ax = (height(100.0, y0) - height(-100.0, y0)) / 200.0;
  plane.ay = (height(0.0, y0 + 100.0) - height(0.0, y0 - 100.0)) / 200.0;
  plane.a0 = height(0.0, y0) - plane.ay * y0;
  return plane;
}

/// Mean distances of the seen cells.
class Means {
 public:
  Means(const SurfaceTable& table, std::span<const SurfaceCell> cells, SurfaceField& field)
      : whole_(table), table_(table.cells()), cells_(cells), field_(field) {
    find_usual();
  }

  [[nodiscard]] bool is_seen(std::size_t i) const {
    const double usual = field_.usual[static_cast<std::size_t>(face_of(table_[i]))];
    const auto count = static_cast<double>(cells_[i].count);
    return count >= 2.0 && count >= kSurfaceSeenShare * usual;
  }
  [[nodiscard]] double mean_mm(std::size_t i) const {
    return kSurfaceUnit_mm * static_cast<double>(cells_[i].sum) / static_cast<double>(cells_[i].count);
  }

  /// Least squares over the cells of a face within a window of the previous plane, three times.
  [[nodiscard]] FacePlane fit(Face face) const {
    FacePlane plane;
    for (const double window_mm : {1.5, 0.7, 0.5}) {
      Mat3 A = Mat3::Zero();
      Vec3 b = Vec3::Zero();
      double count = 0.0;
      const std::array<std::size_t, 2> rows = rows_[static_cast<std::size_t>(face)];
      for (std::size_t i = rows[0] * kColumns; i < rows[1] * kColumns; ++i) {
        if ((table_[i] & kFaceBits) != static_cast<unsigned>(face) || is_near_edge(table_[i]) || !is_seen(i)) continue;
        // Centred and scaled, so that the equations are well conditioned.
        const double x = surface_x_mm(i % kColumns);
        const double y = surface_y_mm(i / kColumns);
        const double r = mean_mm(i);
        if (std::abs(r - plane.at(x, y)) > window_mm) continue;
        const Vec3 v(1.0, x, y);
        A += v * v.transpose();
        b += r * v;
        count += 1.0;
      }
      constexpr double kCellsMin = 50.0;
      if (count < kCellsMin) break;
      const Vec3 solution = A.inverse() * b;
      if (!solution.allFinite()) break;
      plane = {solution.x(), solution.y(), solution.z()};
    }
    return plane;
  }

 private:
  void find_usual() {
    constexpr std::size_t kMost = 128;
    std::array<std::array<std::uint32_t, kMost>, kFaces> counts{};
    std::array<std::uint32_t, kFaces> seen{};
    rows_.fill({kRows, 0});
    for_cells_of(whole_, [&](std::size_t i) {
      const std::uint16_t entry = table_[i];
      if ((entry & kFaceBits) == kNoFace || end_of(entry) != kFar || cells_[i].count == 0) return;
      const auto face = static_cast<std::size_t>(face_of(entry));
      rows_[face] = {std::min(rows_[face][0], i / kColumns), std::max(rows_[face][1], i / kColumns + 1)};
      ++counts[face][std::min<std::size_t>(cells_[i].count, kMost - 1)];
      ++seen[face];
    });
    for (std::size_t face = 0; face < kFaces; ++face) {
      std::uint32_t below = 0;
      field_.usual[face] = 0.0;
      for (std::size_t n = 0; n < kMost && seen[face] != 0; ++n) {
        below += counts[face][n];
        if (2 * below < seen[face]) continue;
        field_.usual[face] = static_cast<double>(n);
        break;
      }
    }
  }

  const SurfaceTable& whole_;
  std::span<const std::uint16_t> table_;
  std::span<const SurfaceCell> cells_;
  SurfaceField& field_;
  std::array<std::array<std::size_t, 2>, kFaces> rows_{};  ///< rows of each face: begin and end
};

/// True also for a jaw of which too little remains to be measured: it has a plane.
bool is_known(const PlaneFit& plane) {
  return plane.ok || plane.doubt == PlaneDoubt::share || plane.doubt == PlaneDoubt::area;
}

/// From this distance on some of a cell's points are not on its surface: form and fillets are below it.
float off_limit_mm(SurfaceZone zone) {
  return zone == SurfaceZone::face ? kSurfaceOff_mm : zone == SurfaceZone::shoulder ? 0.3F : 0.5F;
}

/// Share of a cell that is off, if the mean is off by `off_mm`: for a share c at depth d and the rest at zero, mean and
/// mean square are c d and c d^2.
float cover_of(const SurfaceCell& cell, float off_mm) {
  const auto count = static_cast<double>(cell.count);
  const auto off = static_cast<double>(off_mm);
  const double mean = kSurfaceUnit_mm * static_cast<double>(cell.sum) / count;
  const double reference = mean - off;
  const double square = kSurfaceUnit_mm * kSurfaceUnit_mm * static_cast<double>(cell.squares) / count -
                        2.0 * reference * mean + reference * reference;
  return square > 0.0 ? static_cast<float>(std::min(1.0, off * off / square)) : 1.0F;
}

/// Means over squares, without damage.
class LocalForm {
 public:
  LocalForm(const SurfaceTable& table, const SurfaceField& field) {
    std::array<float, kSquares> sums{};
    std::array<std::uint32_t, kSquares> counts{};
    const auto [first, end] = table.rows();
    const auto [left, right] = table.columns();
    for (std::size_t row = first; row < end; ++row) {
      for (std::size_t column = left; column < right; ++column) {
        const std::size_t i = row * kColumns + column;
        // False for a cell that was not seen.
        if (!(std::abs(field.off[i]) < kClear_mm) || field.zone[i] == SurfaceZone::none) continue;
        const std::size_t square = row / kSide * kAcross + column / kSide;
        sums[square] += field.off[i];
        ++counts[square];
      }
    }
    for (std::size_t k = 0; k < kSquares; ++k)
      means_[k] = counts[k] < kCellsMin ? 0.0F : sums[k] / static_cast<float>(counts[k]);
    for (std::size_t column = 0; column < kColumns; ++column) place(column, kAcross, low_[column], part_[column]);
  }
  static constexpr std::size_t kSide = 16;  ///< cells of a square: 20 mm
  static constexpr std::size_t kAcross = (kColumns + kSide - 1) / kSide;
  using Row = std::array<float, kAcross>;

  /// Form of one row at the middles of the squares.
  [[nodiscard]] Row row(std::size_t number) const {
    std::size_t low = 0;
    float part = 0.0F;
    place(number, kAlong, low, part);
    Row form;
    for (std::size_t k = 0; k < kAcross; ++k) {
      const float* m = means_.data() + low * kAcross + k;
      form[k] = m[0] + part * (m[kAcross] - m[0]);
    }
    return form;
  }
  [[nodiscard]] float at(const Row& form, std::size_t column) const {
    const std::size_t low = low_[column];
    return form[low] + part_[column] * (form[low + 1] - form[low]);
  }

 private:
  static constexpr std::size_t kAlong = (kRows + kSide - 1) / kSide;
  static constexpr std::size_t kSquares = kAcross * kAlong;
  static constexpr float kClear_mm = 0.8F;  ///< larger distances are damage, not form
  static constexpr std::uint32_t kCellsMin = 60;

  /// Index of the first of the two squares around a cell, and relative distance from its middle.
  static void place(std::size_t cell, std::size_t squares, std::size_t& low, float& part) {
    const float middle = (static_cast<float>(cell) + 0.5F) / static_cast<float>(kSide) - 0.5F;
    const float inside = std::clamp(middle, 0.0F, static_cast<float>(squares - 1));
    low = std::min(static_cast<std::size_t>(inside), squares - 2);
    part = inside - static_cast<float>(low);
  }

  std::array<float, kSquares> means_;
  std::array<std::size_t, kColumns> low_;
  std::array<float, kColumns> part_;
};

}  // namespace

void compare_with_expected(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const BlockResult& result, Team& team, SurfaceField& field) {
  const std::span<const std::uint16_t> entries = table.cells();
  const Means means(table, cells, field);
  std::array<FacePlane, kFaces> planes;
  const auto plane = [&](Face face) -> FacePlane& { return planes[static_cast<std::size_t>(face)]; };
  const auto fitted = [&](Face face, const PlaneFit& fit) {
    plane(face) = is_known(fit) ? plane_over(model.plane(face), fit) : means.fit(face);
  };
  fitted(Face::seat, result.seat.plane);
  fitted(Face::jaw_inner, result.jaw_inner);
  fitted(Face::jaw_outer, result.jaw_outer);
  team.run(2, [&](std::size_t outer) {
    const Face shoulder = outer == 0 ? Face::shoulder_inner : Face::shoulder_outer;
    plane(shoulder) = means.fit(shoulder);
  });

  std::fill(field.zone.begin(), field.zone.end(), SurfaceZone::none);
  const auto take_face_away = [&](std::size_t i) {
    field.off[i] = std::numeric_limits<float>::quiet_NaN();
    const std::uint16_t entry = entries[i];
    if (!is_judged(entry)) return;
    const Face face = face_of(entry);
    const bool on_shoulder = face == Face::shoulder_inner || face == Face::shoulder_outer;
    if (field.usual[static_cast<std::size_t>(face)] == 0.0) return;
    if ((entry & kUpperEdge) != 0)
      field.zone[i] = SurfaceZone::upper_edge;
    else if ((entry & kFoot) != 0)
      field.zone[i] = SurfaceZone::foot;
    else
      field.zone[i] = on_shoulder ? SurfaceZone::shoulder : SurfaceZone::face;
    if (means.is_seen(i))
      field.off[i] =
          static_cast<float>(means.mean_mm(i) - plane(face).at(surface_x_mm(i % kColumns), surface_y_mm(i / kColumns)));
  };
  team.run(2, [&](std::size_t half) { for_cells_of(table, take_face_away, static_cast<int>(half)); });
  fit_edges(model, table, planes, field, team, field.edges);
  exclude_edges(table, team, field);
  const LocalForm form(table, field);
  std::array<float, kFaces> per_usual{};
  for (std::size_t face = 0; face < kFaces; ++face)
    if (field.usual[face] > 0.0) per_usual[face] = static_cast<float>(1.0 / field.usual[face]);
  const auto finish = [&](std::size_t i, const LocalForm::Row& local) {
    field.cover[i] = 0.0F;
    field.whole[i] = 0.0F;
    if (field.zone[i] == SurfaceZone::none) return;
    float whole = static_cast<float>(cells[i].count) * per_usual[entries[i] & kFaceBits];
    if (field.seen(i)) {
      field.off[i] -= form.at(local, i % kColumns);
      if (std::abs(field.off[i]) >= kSurfaceOff_mm) {
        const float cover = cover_of(cells[i], field.off[i]);
        field.cover[i] = cover;
        if (field.off[i] < -off_limit_mm(field.zone[i])) whole *= 1.0F - cover;
      }
    }
    field.whole[i] = whole;
  };
  team.run(2, [&](std::size_t half) {
    const auto [first, end] = table.rows();
    const auto [left, right] = table.columns();
    const std::size_t middle = (first + end) / 2;
    for (std::size_t row = half == 0 ? first : middle; row < (half == 0 ? middle : end); ++row) {
      const LocalForm::Row local = form.row(row);
      for (std::size_t column = left; column < right; ++column) finish(row * kColumns + column, local);
    }
  });
}

}  // namespace slabd::algo
