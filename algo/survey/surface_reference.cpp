// SPDX-License-Identifier: Apache-2.0
//
// Problem: no cast block is its model. Faces lie off by some tenths, edges carry chamfers and fillets that differ from
// block to block and along one edge, shoulders undulate. All of that is good concrete.
//
// Idea: expect of a cell what the scan shows of its like. The face is the fitted plane. A strip along an edge is
// expected to look like the median of all strips at the same distance from that edge. What remains is form, which is
// smooth: its means over squares of 20 mm, interpolated, are taken away too.
#include "algo/survey/surface_reference.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace slabd::algo {
namespace {

using namespace surface_cell;

constexpr std::size_t kColumns = limits::kSurfaceColumns;
constexpr std::size_t kRows = limits::kSurfaceRows;
constexpr std::size_t kCells = limits::kSurfaceCells;

Face face_of(std::uint16_t entry) {
  return static_cast<Face>(entry & kFaceBits);
}
std::size_t end_of(std::uint16_t entry) {
  return entry >> kEndShift & kFar;
}
std::size_t side_of(std::uint16_t entry) {
  return entry >> kSideShift & kFar;
}
/// `use(i)` for the cells of the block, row by row; of its lower or upper half where `half` is 0 or 1.
template <typename Use>
void for_cells_of(const SurfaceTable& table, const Use& use, int half = -1) {
  const auto [first, end] = table.rows();
  const auto [left, right] = table.columns();
  const std::size_t middle = (first + end) / 2;
  for (std::size_t row = half == 1 ? middle : first; row < (half == 0 ? middle : end); ++row)
    for (std::size_t i = row * kColumns + left; i < row * kColumns + right; ++i) use(i);
}
/// End and side faces are seen at a grazing angle, if at all.
bool is_judged(std::uint16_t entry) {
  const Face face = face_of(entry);
  return (entry & kFaceBits) != kNoFace && (face == Face::seat || face == Face::jaw_inner || face == Face::jaw_outer ||
                                            face == Face::shoulder_inner || face == Face::shoulder_outer);
}
bool is_near_edge(std::uint16_t entry) {
  return (entry & (kFoot | kUpperEdge)) != 0 || end_of(entry) != kFar || side_of(entry) != kFar;
}

/// Median of distances up to 8 mm, to a sixteenth of one: counts, so that it costs little and is the same everywhere.
class Median {
 public:
  void clear() {
    bins_.fill(0);
    count_ = 0;
  }
  void add(float mm) {
    const float place = std::clamp((mm + kRange_mm) * kPerMm, 0.0F, static_cast<float>(kBins - 1));
    ++bins_[static_cast<std::size_t>(place)];
    ++count_;
  }
  [[nodiscard]] std::uint32_t count() const { return count_; }
  [[nodiscard]] double value() const {
    std::uint32_t below = 0;
    for (std::size_t i = 0; i < kBins; ++i) {
      below += bins_[i];
      if (2 * below >= count_) return (static_cast<double>(i) + 0.5) / static_cast<double>(kPerMm) - 8.0;
    }
    return 0.0;
  }

 private:
  static constexpr std::size_t kBins = 256;
  static constexpr float kRange_mm = 8.0F;
  static constexpr float kPerMm = 16.0F;
  std::array<std::uint32_t, kBins> bins_{};
  std::uint32_t count_ = 0;
};

/// Heights over a nominal face as a plane in (x, y).
struct FacePlane {
  double a0 = 0.0;
  double ax = 0.0;
  double ay = 0.0;
  [[nodiscard]] double at(double x, double y) const { return a0 + ax * x + ay * y; }
};

/// A fitted plane over the nominal one.
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

/// Means of the cells, as far as they are seen.
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

  /// Least squares over the cells of a face that lie within a window of the plane before, three times.
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
  std::array<std::array<std::size_t, 2>, kFaces> rows_{};  ///< in which each face lies: begin and end
};

/// A jaw of which too little is left to be measured has a plane all the same.
bool is_known(const PlaneFit& plane) {
  return plane.ok || plane.doubt == PlaneDoubt::share || plane.doubt == PlaneDoubt::area;
}

/// The deepest chamfer that counts as one. Cast ones of 4 mm nominally wear to up to 7.6 mm.
double deepest_chamfer_mm(double from_edge_mm) {
  constexpr double kChamfer_mm = 8.0;
  return std::max(0.0, kChamfer_mm - from_edge_mm);
}
/// Steps from the edge that chamfers of 4 mm nominally take: 5.6 mm.
constexpr std::size_t kChamferSteps = 4;
constexpr double kRaised_mm = 0.5;     ///< of an outer edge: flash, and no more than that
constexpr double kFillet_mm = 3.0;     ///< of an inner edge, either way
constexpr double kSeenUsually = 0.6;   ///< share of a strip's cells that must be seen before a gap in it is one
constexpr std::uint32_t kLikeMin = 8;  ///< cells of a strip

struct Strip {
  bool known = false;
  double expected_mm = 0.0;
};

/// What is usual along an outer edge at one distance from it: the median over 45 mm of the edge, every 10 mm.
class EdgeLine {
 public:
  /// `there(k)`: is there such an edge at the k-th cell along it; `value(k)`: off the face there, NaN: not seen.
  template <typename There, typename Value>
  void learn(std::size_t length, double lowest, const There& there, const Value& value) {
    length_ = length;
    knots_ = length / kKnot + 1;
    for (std::size_t k = 0; k < length; ++k) {
      there_[k] = there(k);
      value_[k] = there_[k] ? value(k) : std::numeric_limits<float>::quiet_NaN();
    }
    for (std::size_t knot = 0; knot < knots_; ++knot) knot_[knot] = median_at(knot * kKnot, lowest);
    // A corner that is broken out returns too little to be learned from: there the edge is as it is 20 mm further on.
    const std::array<Strip, kKnotsMax> learned = knot_;
    for (std::size_t knot = 0; knot < knots_; ++knot) {
      constexpr std::size_t kFurther = 2;
      for (std::size_t off = 1; off <= kFurther && !knot_[knot].known; ++off) {
        if (knot >= off && learned[knot - off].known)
          knot_[knot] = learned[knot - off];
        else if (knot + off < knots_ && learned[knot + off].known)
          knot_[knot] = learned[knot + off];
      }
    }
  }
  [[nodiscard]] float value(std::size_t k) const { return value_[k]; }
  [[nodiscard]] Strip at(std::size_t k) const {
    const std::size_t knot = std::min(k / kKnot, knots_ - 1);
    const Strip& here = knot_[knot];
    const Strip& next = knot_[std::min(knot + 1, knots_ - 1)];
    if (!here.known || !next.known) return here.known ? here : next;
    const double part = static_cast<double>(k % kKnot) / static_cast<double>(kKnot);
    return {true, here.expected_mm + part * (next.expected_mm - here.expected_mm)};
  }

 private:
  static constexpr std::size_t kKnot = 8;
  static constexpr std::size_t kHalf = 18;
  static constexpr std::size_t kKnotsMax = kRows / kKnot + 1;

  [[nodiscard]] Strip median_at(std::size_t middle, double lowest) const {
    std::array<float, 2 * kHalf + 1> seen;
    std::size_t count = 0;
    std::uint32_t cells = 0;
    for (std::size_t k = middle - std::min(middle, kHalf); k <= middle + kHalf && k < length_; ++k) {
      if (!there_[k]) continue;
      ++cells;
      if (!std::isnan(value_[k])) seen[count++] = value_[k];
    }
    if (count < kLikeMin || static_cast<double>(count) < kSeenUsually * static_cast<double>(cells)) return {};
    const auto median = seen.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(seen.begin(), median, seen.begin() + static_cast<std::ptrdiff_t>(count));
    return {true, std::clamp(static_cast<double>(*median), lowest, kRaised_mm)};
  }

  std::array<float, kRows> value_{};
  std::array<bool, kRows> there_{};
  std::array<Strip, kKnotsMax> knot_{};
  std::size_t knots_ = 1;
  std::size_t length_ = 0;
};

/// How far a chamfer reaches along the edge. Wear changes that by several millimetres, but smoothly, over 50 mm and
/// more; a chip is shorter. So at each place it is expected to be what the parabola through it 8 to 20 mm away, on both
/// sides, says.
class Chamfer {
 public:
  /// `bends`: the edge goes on at another face here.
  void set(std::size_t k, bool bends, bool known, double leg_mm) {
    bends_[k + 1] = bends_[k] + (bends ? 1U : 0U);
    sum_[k + 1] = sum_[k] + (known ? leg_mm : 0.0);
    count_[k + 1] = count_[k] + (known ? 1U : 0U);
  }
  /// Not known near the end of an edge or a bend, nor between dropouts.
  [[nodiscard]] Strip at(std::size_t k, std::size_t length) const {
    if (k < kFarHigh || k + kFarHigh >= length || bends_[k + kFarHigh + 1] != bends_[k - kFarHigh + 1]) return {};
    std::array<double, 4> m{};
    const auto mean = [&](std::size_t from, std::size_t to, double& value) {
      const std::uint32_t count = count_[to + 1] - count_[from];
      value = (sum_[to + 1] - sum_[from]) / static_cast<double>(count);
      return count >= 2;
    };
    if (!mean(k - kFarHigh, k - kFarLow, m[0]) || !mean(k - kNearHigh, k - kNearLow, m[1]) ||
        !mean(k + kNearLow, k + kNearHigh, m[2]) || !mean(k + kFarLow, k + kFarHigh, m[3]))
      return {};
    constexpr double kNear2 = 0.25 * (kNearLow + kNearHigh) * (kNearLow + kNearHigh);
    constexpr double kFar2 = 0.25 * (kFarLow + kFarHigh) * (kFarLow + kFarHigh);
    const double near = 0.5 * (m[1] + m[2]);
    const double far = 0.5 * (m[0] + m[3]);
    return {true, std::min((kFar2 * near - kNear2 * far) / (kFar2 - kNear2), kLongest_mm)};
  }

 private:
  static constexpr std::size_t kNearLow = 7, kNearHigh = 10, kFarLow = 11, kFarHigh = 16;
  static constexpr double kLongest_mm = 8.0;
  std::array<std::uint32_t, kRows + 1> bends_{};
  std::array<double, kRows + 1> sum_{};
  std::array<std::uint32_t, kRows + 1> count_{};
};

/// The lines along one edge, at distances of a cell each. Between them they are interpolated: the draft of the end
/// faces moves the edge over the raster, and a chamfer changes by a cell's width from one cell to the next.
class Edge {
 public:
  static constexpr std::size_t kLines = kSurfaceEdgeSteps + 1;
  static constexpr double from_edge_mm(std::size_t line) { return (static_cast<double>(line) + 0.5) * kSurfaceCell_mm; }

  /// `there(k)`: the face with this edge at the k-th cell along it, kNoFace: none; `value(k, distance)`: off that face,
  /// at a distance from the edge.
  template <typename There, typename Value>
  void learn(std::size_t length, const There& there, const Value& value) {
    length_ = length;
    for (std::size_t line = 0; line < kLines; ++line) {
      const double distance = from_edge_mm(line);
      lines_[line].learn(
          length, -deepest_chamfer_mm(distance), [&](std::size_t k) { return there(k) != kNoFace; },
          [&](std::size_t k) { return value(k, distance); });
    }
    for (std::size_t k = 0; k < length; ++k) set_chamfer(k, k > 0 && there(k) != there(k - 1));
  }
  [[nodiscard]] Strip at(std::size_t k, double distance) const {
    const double place = std::clamp(distance / kSurfaceCell_mm - 0.5, 0.0, static_cast<double>(kLines - 1));
    const std::size_t line = std::min(static_cast<std::size_t>(place), kLines - 2);
    const Strip low = lines_[line].at(k);
    const Strip high = lines_[line + 1].at(k);
    if (!low.known || !high.known) return {};
    const double part = place - static_cast<double>(line);
    return {true, low.expected_mm + part * (high.expected_mm - low.expected_mm)};
  }
  /// What the chamfer beside this place lets expect.
  [[nodiscard]] Strip beside(std::size_t k, double distance) const {
    if (distance < kSaturated_mm) return {};
    const Strip leg = chamfer_.at(k, length_);
    return {leg.known, -std::max(0.0, leg.expected_mm - distance)};
  }

 private:
  /// Closer to the edge the end face is the nearest face, and the distance to it says little about the chamfer.
  static constexpr double kSaturated_mm = 2.5;

  /// By the outermost line that the chamfer reaches.
  void set_chamfer(std::size_t k, bool bends) {
    constexpr float kReached_mm = 0.4F;
    std::size_t seen = 0;
    double leg = kSaturated_mm;
    bool reached = false;
    for (std::size_t line = kLines; line-- > 0 && from_edge_mm(line) >= kSaturated_mm;) {
      const float off = lines_[line].value(k);
      if (std::isnan(off)) continue;
      ++seen;
      if (reached || !(off < -kReached_mm)) continue;
      leg = from_edge_mm(line) - static_cast<double>(off);
      reached = true;
    }
    constexpr std::size_t kSeenMin = 3;
    chamfer_.set(k, bends, seen >= kSeenMin, leg);
  }

  std::array<EdgeLine, kLines> lines_;
  Chamfer chamfer_;
  std::size_t length_ = 0;
};

/// Off the face between the centres of two cells in a line of the raster; NaN where one was not seen.
float between_cells(const SurfaceField& field, double place, std::size_t first, std::size_t stride) {
  const auto low = static_cast<std::size_t>(place);
  const auto part = static_cast<float>(place - static_cast<double>(low));
  const float a = field.off[first + low * stride];
  return a + part * (field.off[first + (low + 1) * stride] - a);
}

/// Takes away what is usual along the edges. `off` holds the distances to the faces.
void take_edges_away(const SurfaceTable& whole, Team& team, SurfaceField& field) {
  const std::span<const std::uint16_t> table = whole.cells();
  // Inner edges run along the rail, row by row.
  std::array<Strip, kRows> rows;
  Median median;
  for (std::size_t row = 0; row < kRows; ++row) {
    median.clear();
    std::uint32_t cells = 0;
    for (std::size_t i = row * kColumns; i < (row + 1) * kColumns; ++i) {
      if (!is_judged(table[i]) || end_of(table[i]) != kFar || (table[i] & (kFoot | kUpperEdge)) == 0) continue;
      ++cells;
      if (field.seen(i)) median.add(field.off[i]);
    }
    if (median.count() >= kLikeMin && static_cast<double>(median.count()) >= kSeenUsually * static_cast<double>(cells))
      rows[row] = {true, std::clamp(median.value(), -kFillet_mm, kFillet_mm)};
  }

  const auto high_x = [](std::size_t i) { return std::size_t{i % kColumns >= kColumns / 2}; };
  const auto high_y = [](std::size_t i) { return std::size_t{i / kColumns >= kRows / 2}; };
  std::array<Edge, 2> ends;
  std::array<Edge, 2> sides;
  std::array<std::uint16_t, kRows> end_face;
  std::array<std::array<std::uint16_t, kColumns>, 2> side_face;
  end_face.fill(kNoFace);
  for (auto& side : side_face) side.fill(kNoFace);
  for_cells_of(whole, [&](std::size_t i) {
    if (!is_judged(table[i])) return;
    if (end_of(table[i]) != kFar) end_face[i / kColumns] = table[i] & kFaceBits;
    if (side_of(table[i]) != kFar) side_face[high_y(i)][i % kColumns] = table[i] & kFaceBits;
  });
  team.run(2, [&](std::size_t high) {
    const double sign = high == 0 ? -1.0 : 1.0;
    ends[high].learn(
        kRows, [&](std::size_t row) { return end_face[row]; },
        [&](std::size_t row, double distance) {
          const double x = sign * (whole.end_mm(row) - distance);
          return between_cells(field, (x + kSurfaceHalfX_mm) / kSurfaceCell_mm - 0.5, row * kColumns, 1);
        });
    sides[high].learn(
        kColumns, [&](std::size_t column) { return side_face[high][column]; },
        [&](std::size_t column, double distance) {
          const double y = sign * (whole.side_mm(high == 1) - distance);
          return between_cells(field, (y + kSurfaceHalfY_mm) / kSurfaceCell_mm - 0.5, column, kColumns);
        });
  });

  const auto take_away = [&](std::size_t i) {
    field.face_off[i] = field.off[i];
    const std::uint16_t entry = table[i];
    if (!is_judged(entry)) return;
    const bool at_end = end_of(entry) != kFar;
    const bool at_side = side_of(entry) != kFar;
    const bool inner = (entry & (kFoot | kUpperEdge)) != 0;
    if (!inner && !at_end && !at_side) return;
    const std::size_t row = i / kColumns;
    const std::size_t column = i % kColumns;
    const double from_end = whole.end_mm(row) - std::abs(surface_x_mm(column));
    const double from_side = whole.side_mm(high_y(i) == 1) - std::abs(surface_y_mm(row));
    const Edge& end = ends[high_x(i)];
    const Edge& side = sides[high_y(i)];
    constexpr Strip kNothing{true, 0.0};
    const Strip by_end = at_end ? end.at(row, from_end) : kNothing;
    const Strip by_side = at_side ? side.at(column, from_side) : kNothing;
    const Strip by_row = inner ? rows[row] : kNothing;
    if (!by_end.known || !by_side.known || !by_row.known) {
      field.zone[i] = SurfaceZone::none;
      return;
    }
    // Two chamfers meet in a corner: the deeper one is seen. A fillet's height is in the line along the end as well.
    const double expected = std::min(by_end.expected_mm, by_side.expected_mm) + (at_end ? 0.0 : by_row.expected_mm);
    Strip line;
    if (at_end != at_side) line = at_end ? end.beside(row, from_end) : side.beside(column, from_side);
    const bool corner = at_end && at_side;
    const bool beside = at_end || at_side;
    field.face_off[i] -= beside && !corner && !line.known
                             ? std::numeric_limits<float>::quiet_NaN()
                             : static_cast<float>(line.known ? line.expected_mm : expected);
    field.off[i] -= static_cast<float>(expected);
  };
  team.run(2, [&](std::size_t half) { for_cells_of(whole, take_away, static_cast<int>(half)); });
}

/// From here on a cell takes part of its points from something else than its surface: form and fillets stay below.
float off_limit_mm(SurfaceZone zone) {
  return zone == SurfaceZone::face ? kSurfaceOff_mm : zone == SurfaceZone::shoulder ? 0.3F : 0.5F;
}

/// Means over squares, with what is damage left out.
class LocalForm {
 public:
  LocalForm(const SurfaceTable& table, const SurfaceField& field) {
    std::array<double, kSquares> sums{};
    std::array<std::uint32_t, kSquares> counts{};
    for_cells_of(table, [&](std::size_t i) {
      if (field.zone[i] == SurfaceZone::none || !(std::abs(field.off[i]) < kClear_mm)) return;
      const std::size_t square = i / kColumns / kSide * kAcross + i % kColumns / kSide;
      sums[square] += static_cast<double>(field.off[i]);
      ++counts[square];
    });
    for (std::size_t k = 0; k < kSquares; ++k)
      means_[k] = counts[k] < kCellsMin ? 0.0F : static_cast<float>(sums[k] / static_cast<double>(counts[k]));
  }
  /// Between the centres of the squares.
  [[nodiscard]] float at(std::size_t cell) const {
    const auto place = [](std::size_t k, std::size_t squares, std::size_t& low, float& part) {
      const float centre = (static_cast<float>(k) + 0.5F) / static_cast<float>(kSide) - 0.5F;
      const float inside = std::clamp(centre, 0.0F, static_cast<float>(squares - 1));
      low = std::min(static_cast<std::size_t>(inside), squares - 2);
      part = inside - static_cast<float>(low);
    };
    std::size_t column = 0;
    std::size_t row = 0;
    float u = 0.0F;
    float v = 0.0F;
    place(cell % kColumns, kAcross, column, u);
    place(cell / kColumns, kAlong, row, v);
    const float* m = means_.data() + row * kAcross + column;
    const float low = m[0] + u * (m[1] - m[0]);
    const float high = m[kAcross] + u * (m[kAcross + 1] - m[kAcross]);
    return low + v * (high - low);
  }

 private:
  static constexpr std::size_t kSide = 16;  ///< cells of a square: 20 mm
  static constexpr std::size_t kAcross = (kColumns + kSide - 1) / kSide;
  static constexpr std::size_t kAlong = (kRows + kSide - 1) / kSide;
  static constexpr std::size_t kSquares = kAcross * kAlong;
  static constexpr float kClear_mm = 0.8F;  ///< further off lies damage, which is not form
  static constexpr std::uint32_t kCellsMin = 60;
  std::array<float, kSquares> means_;
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
  plane(Face::shoulder_inner) = means.fit(Face::shoulder_inner);
  plane(Face::shoulder_outer) = means.fit(Face::shoulder_outer);

  std::fill(field.zone.begin(), field.zone.end(), SurfaceZone::none);
  const auto take_face_away = [&](std::size_t i) {
    field.off[i] = std::numeric_limits<float>::quiet_NaN();
    const std::uint16_t entry = entries[i];
    if (!is_judged(entry)) return;
    const Face face = face_of(entry);
    const bool on_shoulder = face == Face::shoulder_inner || face == Face::shoulder_outer;
    if (field.usual[static_cast<std::size_t>(face)] == 0.0) return;
    const std::size_t step = std::min(end_of(entry), side_of(entry));
    if (end_of(entry) < kSurfaceEdgeSteps && side_of(entry) < kSurfaceEdgeSteps)
      field.zone[i] = SurfaceZone::corner;
    else if (step < kSurfaceEdgeSteps)
      field.zone[i] = step < kChamferSteps ? SurfaceZone::outer_edge : SurfaceZone::behind_edge;
    else if ((entry & kUpperEdge) != 0)
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
  take_edges_away(table, team, field);
  const LocalForm form(table, field);
  const auto finish = [&](std::size_t i) {
    field.cover[i] = 0.0F;
    field.whole[i] = 0.0F;
    if (field.zone[i] == SurfaceZone::none) return;
    const double usual = field.usual[static_cast<std::size_t>(face_of(entries[i]))];
    const auto count = static_cast<double>(cells[i].count);
    double cover = 0.0;
    if (field.seen(i)) {
      field.off[i] -= form.at(i);
      const double mean = means.mean_mm(i);
      const double off = static_cast<double>(field.off[i]);
      const double reference = mean - off;
      const double square = kSurfaceUnit_mm * kSurfaceUnit_mm * static_cast<double>(cells[i].squares) / count -
                            2.0 * reference * mean + reference * reference;
      // Of a share c at depth d, and the rest at none, mean and mean square are c d and c d^2.
      cover = square > 0.0 ? std::min(1.0, off * off / square) : 1.0;
      field.cover[i] = static_cast<float>(cover);
      if (!(field.off[i] < -off_limit_mm(field.zone[i]))) cover = 0.0;
    }
    field.whole[i] = static_cast<float>(count * (1.0 - cover) / usual);
  };
  team.run(2, [&](std::size_t half) { for_cells_of(table, finish, static_cast<int>(half)); });
}

}  // namespace slabd::algo
