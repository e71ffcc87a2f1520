// SPDX-License-Identifier: Apache-2.0
//
// Problem: items cover only parts of the faces. Half a seat that is sunk next to the evaluation region, or a broken
// corner, changes none of them.
//
// Idea: a raster of small cells over each face, around the fitted plane. Each cell counts how many of an even selection
// of the scan's points are on the face, above and below it, at any height. A cell is displaced if at least half of its
// points are off the face by more than a limit, and missing if it has none although the scan continues beyond it.
// Connected cells make an area; one above limits::kFindingArea_mm2 is a finding.
//
// Few blocks have damage, and a pass over the scan costs a tenth of its measurement. So the results of the survey are
// tested first: the deviation map over the seat and the listed points of the jaws. If no place has too few points near
// the model or is off its face, no area of the minimum size can be displaced or missing.
//
// Counts and sums are integers, so the result does not depend on their order or the number of threads.
#include "algo/survey/surface_findings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "algo/points.h"

namespace slabd::algo {
namespace {

using namespace findings;

constexpr std::size_t kFaceCount = 3;
constexpr std::size_t kCellsMax = 17'000;

struct Cell {
  std::uint32_t seen = 0;
  std::uint32_t high = 0;
  std::uint32_t low = 0;
  std::int32_t off_um = 0;  ///< sum over the high and low points
};
static_assert(sizeof(Cell) == 4 * sizeof(float));

/// Extent of the scan's points, in squares of the block frame.
constexpr double kSquare_mm = 5.0;
constexpr std::size_t kSquaresX = 60;
constexpr std::size_t kSquaresY = 120;
constexpr std::size_t kSquares = kSquaresX * kSquaresY;
static_assert(2 * (4 * kCellsMax + kSquares) + 2 * kCellsMax <= kFindingFloats);

/// A face and its raster: u along the rail, v across it on the face, h above it.
struct Raster {
  bool used = false;
  Vec3 origin = Vec3::Zero();
  Vec3 v_axis = Vec3::UnitY();
  Vec3 normal = Vec3::UnitZ();
  double offset_mm = 0.0;
  double v_origin = 0.0;  ///< v of a point p is v_axis . p less this
  double u_low = 0.0;
  double v_low = 0.0;
  std::size_t columns = 0;
  std::size_t rows = 0;
  std::size_t first = 0;  ///< index of the first cell

  [[nodiscard]] std::size_t cells() const { return columns * rows; }
  /// Cell of (u, v); cells() outside the raster.
  [[nodiscard]] std::size_t cell_of(double u, double v) const {
    const double column = (u - u_low) * (1.0 / kCell_mm);
    const double row = (v - v_low) * (1.0 / kCell_mm);
    if (!(column >= 0.0 && row >= 0.0 && column < static_cast<double>(columns) && row < static_cast<double>(rows)))
      return cells();
    return static_cast<std::size_t>(row) * columns + static_cast<std::size_t>(column);
  }
  [[nodiscard]] double u_of(std::size_t cell) const {
    return u_low + (static_cast<double>(cell % columns) + 0.5) * kCell_mm;
  }
  [[nodiscard]] double v_of(std::size_t cell) const {
    return v_low + (static_cast<double>(cell / columns) + 0.5) * kCell_mm;
  }
  /// Centre of a cell on the face.
  [[nodiscard]] Vec3 place(std::size_t cell) const { return origin + u_of(cell) * Vec3::UnitX() + v_of(cell) * v_axis; }

  void span_over(double u_half, double v_from, double v_to) {
    const double u = 2.0 * u_half;
    const double v = v_to - v_from;
    if (!(u >= kCell_mm) || !(v >= kCell_mm)) return;
    columns = static_cast<std::size_t>(u / kCell_mm);
    rows = static_cast<std::size_t>(v / kCell_mm);
    u_low = -0.5 * static_cast<double>(columns) * kCell_mm;
    v_low = v_from + 0.5 * (v - static_cast<double>(rows) * kCell_mm);
    used = true;
  }
};

/// v of the intersection of two planes, on the face of `raster`, in the section x = 0.
double v_at(const Raster& raster, const Vec3& normal, double offset_mm) {
  return (offset_mm - normal.dot(raster.origin)) / normal.dot(raster.v_axis);
}

Raster raster_on(const PlaneFit& plane) {
  Raster raster;
  raster.normal = plane.normal;
  raster.offset_mm = plane.offset_mm;
  // Direction in the face and in the section x = 0.
  const double ny = plane.normal.y();
  const double nz = plane.normal.z();
  const double in_section = ny * ny + nz * nz;
  raster.v_axis = Vec3(0.0, nz, -ny) / std::sqrt(in_section);
  raster.origin = Vec3(0.0, plane.offset_mm * ny / in_section, plane.offset_mm * nz / in_section);
  raster.v_origin = raster.v_axis.dot(raster.origin);
  return raster;
}

/// Input of the search.
struct Search {
  FastTransform T_block_scanner;
  std::array<Raster, kFaceCount> faces;  ///< [FindingFace]
  double casing_s = 0.0;
  double casing_clear = 0.0;
  Vec3 along_seat = Vec3::UnitY();
};

/// The counts of one thread.
struct Counts {
  std::span<Cell> cells;
  std::span<std::uint32_t> squares;
};

std::size_t square_of(double x, double y) {
  const double column = x * (1.0 / kSquare_mm) + 0.5 * static_cast<double>(kSquaresX);
  const double row = y * (1.0 / kSquare_mm) + 0.5 * static_cast<double>(kSquaresY);
  if (!(column >= 0.0 && row >= 0.0 && column < static_cast<double>(kSquaresX) && row < static_cast<double>(kSquaresY)))
    return kSquares;
  return static_cast<std::size_t>(row) * kSquaresX + static_cast<std::size_t>(column);
}

void count_point(const Search& search, const Vec3& p, const Counts& counts) {
  const std::size_t square = square_of(p.x(), p.y());
  if (square == kSquares) return;
  ++counts.squares[square];
  // Between the jaws' feet is the seat, beyond them a jaw: a point belongs to one face, at any height.
  const auto count_on = [&](const Raster& face) {
    if (!face.used) return false;
    const std::size_t cell = face.cell_of(p.x(), face.v_axis.dot(p) - face.v_origin);
    if (cell == face.cells()) return false;
    const double h = face.normal.dot(p) - face.offset_mm;
    if (!(std::abs(h) <= kReach_mm)) return true;
    Cell& sum = counts.cells[face.first + cell];
    ++sum.seen;
    if (std::abs(h) <= kDisplaced_mm) return true;
    ++(h > 0.0 ? sum.high : sum.low);
    sum.off_um += static_cast<std::int32_t>(1000.0 * h);
    return true;
  };
  if (count_on(search.faces[static_cast<std::size_t>(FindingFace::seat)])) return;
  count_on(search.faces[static_cast<std::size_t>(p.y() > 0.0 ? FindingFace::jaw_outer : FindingFace::jaw_inner)]);
}

enum class Mark : std::uint8_t { whole, high, low, missing };

/// First and last square with points, per row and column of the squares.
class Field {
 public:
  explicit Field(std::span<const std::uint32_t> squares) {
    along_x_.fill({kSquaresX, 0});
    along_y_.fill({kSquaresY, 0});
    for (std::size_t i = 0; i < kSquares; ++i) {
      if (squares[i] < kSeenMin) continue;
      const std::size_t column = i % kSquaresX;
      const std::size_t row = i / kSquaresX;
      along_x_[row] = {std::min(along_x_[row].first, column), std::max(along_x_[row].second, column)};
      along_y_[column] = {std::min(along_y_[column].first, row), std::max(along_y_[column].second, row)};
    }
  }
  /// True if there are points on all four sides of this position.
  [[nodiscard]] bool surrounds(const Vec3& p) const {
    const std::size_t square = square_of(p.x(), p.y());
    if (square == kSquares) return false;
    const std::size_t column = square % kSquaresX;
    const std::size_t row = square / kSquaresX;
    return along_x_[row].first < column && column < along_x_[row].second && along_y_[column].first < row &&
           row < along_y_[column].second;
  }

 private:
  static constexpr std::uint32_t kSeenMin = 3;  ///< points in a square; strays are fewer
  std::array<std::pair<std::size_t, std::size_t>, kSquaresY> along_x_;
  std::array<std::pair<std::size_t, std::size_t>, kSquaresX> along_y_;
};

bool near_casing(const Search& search, const Raster& face, std::size_t cell) {
  const double s = std::abs(search.along_seat.dot(face.place(cell)));
  const double clear = search.casing_clear + 0.75 * kCell_mm;
  const double beside = s - search.casing_s;
  const double x = face.u_of(cell);
  return x * x + beside * beside < clear * clear;
}

/// Points in a usual cell of the face. Below the minimum no cell counts as missing.
double usual_points(std::span<const Cell> cells) {
  std::array<std::uint32_t, 64> histogram{};
  std::uint32_t seen = 0;
  for (const Cell& cell : cells) {
    if (cell.seen == 0) continue;
    ++histogram[std::min<std::size_t>(cell.seen, histogram.size() - 1)];
    ++seen;
  }
  std::uint32_t below = 0;
  for (std::size_t n = 0; n < histogram.size(); ++n) {
    below += histogram[n];
    if (2 * below > seen) return static_cast<double>(n);
  }
  return 0.0;
}

/// One area of connected cells.
struct Area {
  const Raster& face;
  FindingFace name;
  Mark mark;
  std::span<const std::uint32_t> cells;
  std::span<const Cell> counts;
};

SurfaceFinding describe_area(const Search& search, const Area& area) {
  constexpr double kCrackWidth_mm = 2.0 * kCell_mm;
  constexpr double kCrackAspect = 6.0;
  const Raster& face = area.face;
  SurfaceFinding f;
  f.face = area.name;
  std::size_t column_low = face.columns;
  std::size_t column_high = 0;
  std::size_t row_low = face.rows;
  std::size_t row_high = 0;
  std::size_t empty = 0;
  double deepest = 0.0;
  double volume = 0.0;
  Vec3 middle = Vec3::Zero();
  for (const std::uint32_t c : area.cells) {
    column_low = std::min(column_low, c % face.columns);
    column_high = std::max(column_high, c % face.columns);
    row_low = std::min(row_low, c / face.columns);
    row_high = std::max(row_high, c / face.columns);
    middle += face.place(c);
    const Cell& cell = area.counts[c];
    const std::uint32_t off = cell.high + cell.low;
    if (off == 0) {
      ++empty;
      continue;
    }
    const double depth = 1e-3 * std::abs(static_cast<double>(cell.off_um)) / static_cast<double>(off);
    deepest = std::max(deepest, depth);
    volume += kCell_mm * kCell_mm * depth;
  }
  middle /= static_cast<double>(area.cells.size());
  f.x_mm = middle.x();
  f.s_mm = search.along_seat.dot(middle);
  f.z_mm = middle.z();
  f.length_mm = static_cast<double>(column_high - column_low + 1) * kCell_mm;
  f.width_mm = static_cast<double>(row_high - row_low + 1) * kCell_mm;
  f.area_mm2 = static_cast<double>(area.cells.size()) * kCell_mm * kCell_mm;
  if (deepest > 0.0) {
    f.depth_mm = deepest;
    f.volume_mm3 = volume;
  }
  const bool at_edge = column_low == 0 || column_high + 1 == face.columns || row_low == 0 || row_high + 1 == face.rows;
  const double narrow = std::min(f.length_mm, f.width_mm);
  if (area.mark == Mark::high)
    f.kind = FindingKind::bump;
  else if (2 * empty > area.cells.size())
    f.kind = FindingKind::missing;
  else if (narrow <= kCrackWidth_mm && std::max(f.length_mm, f.width_mm) >= kCrackAspect * narrow)
    f.kind = FindingKind::crack;
  else
    f.kind = at_edge ? FindingKind::chip : FindingKind::pit;
  return f;
}

/// Adds a finding; if the list is full, replaces the smallest if this one is larger.
void keep(const SurfaceFinding& finding, BlockResult& result) {
  auto& list = result.findings;
  if (!list.push(finding)) {
    if (!(finding.area_mm2 > list[list.size() - 1].area_mm2)) return;
    list[list.size() - 1] = finding;
  }
  for (std::size_t i = list.size() - 1; i > 0 && list[i].area_mm2 > list[i - 1].area_mm2; --i)
    std::swap(list[i], list[i - 1]);
}

/// Marks the cells of a face and reports each connected area of marked ones, corners included.
void find_areas(const Search& search, FindingFace name, std::span<const Cell> cells, const Field& field,
                std::span<std::uint32_t> marks, std::span<std::uint32_t> stack, BlockResult& result) {
  constexpr double kUsualMin = 4.0;
  constexpr std::uint32_t kOffMin = 2;
  const Raster& face = search.faces[static_cast<std::size_t>(name)];
  const bool judge_missing = usual_points(cells) >= kUsualMin;
  for (std::size_t c = 0; c < face.cells(); ++c) {
    const Cell& cell = cells[c];
    Mark mark = Mark::whole;
    if (name == FindingFace::seat && near_casing(search, face, c))
      mark = Mark::whole;
    else if (cell.seen == 0)
      mark = judge_missing && field.surrounds(face.place(c)) ? Mark::missing : Mark::whole;
    else if (cell.low >= kOffMin && 2 * cell.low >= cell.seen)
      mark = Mark::low;
    else if (cell.high >= kOffMin && 2 * cell.high >= cell.seen)
      mark = Mark::high;
    marks[c] = static_cast<std::uint32_t>(mark);
  }
  // A hole is partly visible: its floor is low, and the part hidden by its walls is missing.
  const auto kind = [&](std::size_t c) {
    const auto mark = static_cast<Mark>(marks[c]);
    return mark == Mark::missing ? Mark::low : mark;
  };
  for (std::size_t first = 0; first < face.cells(); ++first) {
    const Mark wanted = kind(first);
    if (wanted == Mark::whole) continue;
    std::size_t found = 0;
    marks[first] = static_cast<std::uint32_t>(Mark::whole);
    stack[found++] = static_cast<std::uint32_t>(first);
    for (std::size_t next = 0; next < found; ++next) {
      const std::size_t column = stack[next] % face.columns;
      const std::size_t row = stack[next] / face.columns;
      for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, face.rows - 1); ++r) {
        for (std::size_t k = column - std::min<std::size_t>(column, 1); k <= std::min(column + 1, face.columns - 1);
             ++k) {
          const std::size_t neighbour = r * face.columns + k;
          if (kind(neighbour) != wanted) continue;
          marks[neighbour] = static_cast<std::uint32_t>(Mark::whole);
          stack[found++] = static_cast<std::uint32_t>(neighbour);
        }
      }
    }
    if (static_cast<double>(found) * kCell_mm * kCell_mm < limits::kFindingArea_mm2) continue;
    keep(describe_area(search, {face, name, wanted, stack.first(found), cells}), result);
  }
}

/// True also for a jaw of which too little remains to be measured: it has a plane.
bool is_known(const PlaneFit& plane) {
  return plane.ok || plane.doubt == PlaneDoubt::share || plane.doubt == PlaneDoubt::area;
}

/// Rasters of seat and jaws without their rims.
std::array<Raster, kFaceCount> rasters_of(const BlockModel& model, const BlockResult& result) {
  const BlockGeometry& geometry = model.geometry();
  // End faces lean inward: the higher a face extends, the shorter it is.
  const auto half_length = [&](double z) {
    return geometry.end_half_length_mm.value - std::max(z, 0.0) * std::tan(geometry.draft_rad.value) - kRim_mm;
  };
  std::array<Raster, kFaceCount> faces;
  Raster& seat = faces[static_cast<std::size_t>(FindingFace::seat)];
  seat = raster_on(result.seat.plane);
  const auto foot = [&](const PlaneFit& jaw, Face nominal) {
    const Plane& plane = model.plane(nominal);
    return is_known(jaw) ? v_at(seat, jaw.normal, jaw.offset_mm) : v_at(seat, plane.n, plane.d);
  };
  const double foot_inner = foot(result.jaw_inner, Face::jaw_inner);
  const double foot_outer = foot(result.jaw_outer, Face::jaw_outer);
  const double highest = std::max(std::abs(foot_inner), std::abs(foot_outer)) * std::abs(seat.v_axis.z());
  seat.span_over(half_length(highest), foot_inner + kRim_mm, foot_outer - kRim_mm);
  const auto jaw = [&](FindingFace name, const PlaneFit& fit, double shoulder_z) {
    if (!is_known(fit)) return;
    Raster& face = faces[static_cast<std::size_t>(name)];
    face = raster_on(fit);
    const double a = v_at(face, result.seat.plane.normal, result.seat.plane.offset_mm);
    const double b = v_at(face, Vec3::UnitZ(), shoulder_z);
    face.span_over(half_length(shoulder_z), std::min(a, b) + kRim_mm, std::max(a, b) - kRim_mm);
  };
  jaw(FindingFace::jaw_inner, result.jaw_inner, geometry.shoulder_inner_z_mm.value);
  jaw(FindingFace::jaw_outer, result.jaw_outer, geometry.shoulder_outer_z_mm.value);
  std::size_t first = 0;
  for (Raster& face : faces) {
    face.first = first;
    if (!face.used) continue;
    if (face.cells() > kCellsMax - first) {
      face.used = false;
      continue;
    }
    first += face.cells();
  }
  return faces;
}

Search search_for(const BlockModel& model, const Pose& T_block_scanner, const BlockResult& result) {
  const BlockGeometry& geometry = model.geometry();
  return {FastTransform(T_block_scanner), rasters_of(model, result), geometry.casing_half_spacing_mm.value,
          0.5 * geometry.casing_rim_diameter_mm.value + kCasingRim_mm, model.along_seat()};
}

/// Tests groups of 2 x 2 cells of the deviation map: too few points near the model, or off the fitted seat. Damage of
/// the minimum area covers at least half of such a group at any position.
bool seat_is_suspicious(const Search& search, const BlockModel& model, const DeviationMap& map,
                        const BlockResult& result) {
  constexpr double kFew = 0.6;
  constexpr double kOff_mm = 0.4;
  const Raster& seat = search.faces[static_cast<std::size_t>(FindingFace::seat)];
  if (!seat.used || map.columns == 0) return seat.used;
  const Plane& nominal = model.plane(Face::seat);
  const double x_limit = -seat.u_low;
  const double v_high = seat.v_low + static_cast<double>(seat.rows) * kCell_mm;
  const double half = 0.5 * map.cell_mm;
  /// True if any part of the cell is searched. A cell of the map that extends into the rim may be low by its chamfer:
  /// this costs a full search without findings.
  const auto asked = [&](std::size_t column, std::size_t row) {
    const double x = map.x_mm(column);
    const double y = map.y_mm(row);
    const double v = seat.v_axis.dot(Vec3(x, y, nominal.z_at(x, y))) - seat.v_origin;
    const double beside = std::abs(v) - search.casing_s;
    const double clear = search.casing_clear + 1.5 * half;
    return std::abs(x) - half < x_limit && v + half > seat.v_low && v - half < v_high &&
           x * x + beside * beside > clear * clear;
  };
  double points = 0.0;
  double seen = 0.0;
  for (std::size_t row = 0; row < map.rows; ++row) {
    for (std::size_t column = 0; column < map.columns; ++column) {
      const std::uint32_t count = map.count[row * map.columns + column];
      if (count == 0 || !asked(column, row)) continue;
      points += static_cast<double>(count);
      seen += 1.0;
    }
  }
  if (seen == 0.0) return true;
  const double usual = 4.0 * points / seen;
  for (std::size_t row = 0; row + 1 < map.rows; ++row) {
    for (std::size_t column = 0; column + 1 < map.columns; ++column) {
      if (!asked(column, row) || !asked(column + 1, row) || !asked(column, row + 1) || !asked(column + 1, row + 1))
        continue;
      double count = 0.0;
      double sum_mm = 0.0;
      for (const std::size_t cell : {row * map.columns + column, row * map.columns + column + 1,
                                     (row + 1) * map.columns + column, (row + 1) * map.columns + column + 1}) {
        count += static_cast<double>(map.count[cell]);
        sum_mm += 1e-6 * static_cast<double>(map.sum_nm[cell]);
      }
      if (count < kFew * usual) return true;
      // The map's distances are relative to the model; this is the fitted seat's distance from it.
      const double x = map.x_mm(column) + half;
      const double y = map.y_mm(row) + half;
      const double expected_mm =
          result.seat.plane.offset_mm - result.seat.plane.normal.dot(Vec3(x, y, nominal.z_at(x, y)));
      if (std::abs(sum_mm / count - expected_mm) > kOff_mm) return true;
    }
  }
  return false;
}

/// True if there are cells with too few points near the model, or with half of them off the fitted jaw.
bool jaw_is_suspicious(const Raster& face, const PlaneFit& fit, const ListedPoints& points, std::span<Cell> cells) {
  constexpr double kFew = 0.4;
  constexpr std::size_t kCellsMin = 4;
  if (!face.used) return false;
  std::fill(cells.begin(), cells.end(), Cell{});
  const LocalPlane plane(points.frame, {fit.normal, fit.offset_mm});
  const double v_shift = face.v_origin - face.v_axis.dot(points.frame.origin);
  const double along = face.v_axis.dot(points.frame.along_seat) > 0.0 ? 1.0 : -1.0;
  for (const SeatPoints& run : points.runs) {
    for (std::size_t i = 0; i < run.size(); ++i) {
      const auto u = static_cast<double>(run.x[i]);
      const auto s = static_cast<double>(run.s[i]);
      const std::size_t cell = face.cell_of(u, along * s - v_shift);
      if (cell == face.cells()) continue;
      const double off = static_cast<double>(run.h[i]) - (plane.a0 + plane.a1 * u + plane.a2 * s);
      ++cells[cell].seen;
      if (std::abs(off) > kDisplaced_mm) ++cells[cell].low;
    }
  }
  double seen = 0.0;
  double total = 0.0;
  for (const Cell& cell : cells) {
    if (cell.seen == 0) continue;
    seen += 1.0;
    total += static_cast<double>(cell.seen);
  }
  if (seen == 0.0) return true;
  std::size_t suspicious = 0;
  for (const Cell& cell : cells)
    if (static_cast<double>(cell.seen) < kFew * total / seen || 2 * cell.low >= cell.seen) ++suspicious;
  return suspicious >= kCellsMin;
}

bool is_suspicious(const Search& search, const BlockModel& model, const SurveyedSurface& surveyed,
                   std::span<float> memory, const BlockResult& result) {
  if (seat_is_suspicious(search, model, surveyed.map, result)) return true;
  auto* cells = reinterpret_cast<Cell*>(memory.data());
  const Raster& inner = search.faces[static_cast<std::size_t>(FindingFace::jaw_inner)];
  const Raster& outer = search.faces[static_cast<std::size_t>(FindingFace::jaw_outer)];
  return jaw_is_suspicious(inner, result.jaw_inner, *surveyed.jaws[0], {cells, inner.cells()}) ||
         jaw_is_suspicious(outer, result.jaw_outer, *surveyed.jaws[1], {cells, outer.cells()});
}

}  // namespace

void find_surface_damage(const Cloud& cloud, const BlockModel& model, const Pose& T_block_scanner,
                         const SurveyedSurface& surveyed, std::span<float> memory, Team& team, BlockResult& result) {
  result.findings.clear();
  if (!result.seat.plane.ok) return;
  const Search search = search_for(model, T_block_scanner, result);
  if (!is_suspicious(search, model, surveyed, memory, result)) return;

  auto* cells = reinterpret_cast<Cell*>(memory.data());
  auto* numbers = reinterpret_cast<std::uint32_t*>(memory.data() + 2 * 4 * kCellsMax);
  const std::array<Counts, 2> counts = {Counts{{cells, kCellsMax}, {numbers, kSquares}},
                                        Counts{{cells + kCellsMax, kCellsMax}, {numbers + kSquares, kSquares}}};
  const double most = std::clamp(surveyed.points_per_mm2 * kCell_mm * kCell_mm / kInCell, 1.0, 1e6);
  const std::size_t stride = std::clamp<std::size_t>(cloud.points / kLooked, 1, static_cast<std::size_t>(most));
  const std::size_t looked = cloud.points / stride;
  team.run(2, [&](std::size_t half) {
    std::fill(counts[half].cells.begin(), counts[half].cells.end(), Cell{});
    std::fill(counts[half].squares.begin(), counts[half].squares.end(), 0U);
    for (std::size_t j = half * looked / 2; j < (half + 1) * looked / 2; ++j) {
      // Avoids the same column of every row.
      const float* p = cloud.xyz.data() + 3 * thinned_index(j, stride);
      if (std::isnan(p[0]) || std::isnan(p[1]) || std::isnan(p[2])) continue;
      count_point(search, search.T_block_scanner(p), counts[half]);
    }
  });
  for (std::size_t c = 0; c < kCellsMax; ++c) {
    Cell& sum = counts[0].cells[c];
    const Cell& other = counts[1].cells[c];
    sum.seen += other.seen;
    sum.high += other.high;
    sum.low += other.low;
    sum.off_um += other.off_um;
  }
  for (std::size_t i = 0; i < kSquares; ++i) counts[0].squares[i] += counts[1].squares[i];

  const Field field(counts[0].squares);
  const std::span<std::uint32_t> marks{numbers + 2 * kSquares, kCellsMax};
  // The second thread's cells are no longer needed.
  const std::span<std::uint32_t> stack{reinterpret_cast<std::uint32_t*>(cells + kCellsMax), kCellsMax};
  for (std::size_t f = 0; f < kFaceCount; ++f) {
    const Raster& face = search.faces[f];
    if (!face.used) continue;
    find_areas(search, static_cast<FindingFace>(f), counts[0].cells.subspan(face.first, face.cells()), field, marks,
               stack, result);
  }
}

}  // namespace slabd::algo
