// SPDX-License-Identifier: Apache-2.0
//
// Problem: chamfers and fillets differ between blocks and along one edge, and a chip is deeper than that only locally.
//
// Idea: a strip along an edge is expected to look like the others of its kind. Along a jaw's foot and upper edge that
// is the median of the row. Along the block's ends and sides, which wear, it is the median of the edge nearby. The
// length of a chamfer is expected to follow a parabola through its lengths on both sides.
#include "algo/survey/surface_reference.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

namespace slabd::algo {
namespace {

using namespace surface_cell;

constexpr std::size_t kColumns = kSurfaceColumns;
constexpr std::size_t kRows = kSurfaceRows;

/// Median of distances up to 8 mm, with a resolution of 1/16 mm: a histogram, so it is fast and the same on every
/// machine.
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

constexpr double kRaised_mm = 0.5;     ///< limit above an outer edge: flash is at most this high
constexpr double kFillet_mm = 3.0;     ///< limit at an inner edge, in both directions
constexpr double kFootLow_mm = 0.5;    ///< limit below a jaw's foot, which a fillet only fills: lower is a groove
constexpr double kSeenUsually = 0.6;   ///< share of a strip's cells that must be seen before a gap in it is one
constexpr std::uint32_t kLikeMin = 8;  ///< minimum cells of a strip

struct Strip {
  bool known = false;
  double expected_mm = 0.0;
};

/// Upper median of a few values that are numbers. Counts those that it may still be against all, because sorting
/// mispredicts a branch at nearly every step.
float median_of_few(std::span<const float> values) {
  const auto rank = static_cast<std::uint32_t>(values.size() / 2);
  float low = -std::numeric_limits<float>::infinity();
  float high = std::numeric_limits<float>::infinity();
  for (const float value : values) {
    if (value <= low || value >= high) continue;
    std::uint32_t below = 0;
    std::uint32_t up_to = 0;
    for (const float other : values) {
      below += other < value ? 1U : 0U;
      up_to += other <= value ? 1U : 0U;
    }
    if (below <= rank && rank < up_to) return value;
    (below > rank ? high : low) = value;
  }
  return 0.0F;
}

/// Usual profile of an outer edge at one distance from it: the median over 45 mm of the edge, every 10 mm.
class EdgeLine {
 public:
  /// `there(k)`: true if such an edge exists at the k-th cell along it; `value(k)`: distance from the face, NaN if not
  /// seen.
  template <typename There, typename Value>
  void read(std::size_t length, const There& there, const Value& value) {
    length_ = length;
    for (std::size_t k = 0; k < length; ++k) {
      there_[k] = there(k);
      value_[k] = there_[k] ? value(k) : std::numeric_limits<float>::quiet_NaN();
    }
  }
  void learn(double lowest) {
    knots_ = length_ / kKnot + 1;
    for (std::size_t knot = 0; knot < knots_; ++knot) knot_[knot] = median_at(knot * kKnot, lowest);
    // A broken corner returns too few points for a median: there the values 20 mm further on are used.
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
  /// Profile of the edge 9 to 15 mm from the corner in which it ends near `k`: wear changes an edge over 30 mm and
  /// more, and a chip in a corner is shorter.
  [[nodiscard]] Strip near_corner(std::size_t k, double lowest) const {
    constexpr std::size_t kFirst = 7, kCount = 5;
    const bool goes_up = k < length_ / 2;
    std::size_t corner = k;
    while (corner > 0 && corner + 1 < length_ && there_[goes_up ? corner - 1 : corner + 1])
      corner = goes_up ? corner - 1 : corner + 1;
    std::array<float, kCount> seen;
    std::size_t count = 0;
    for (std::size_t i = kFirst; i < kFirst + kCount; ++i) {
      if (!goes_up && corner < i) break;
      const std::size_t cell = goes_up ? corner + i : corner - i;
      if (cell < length_ && !std::isnan(value_[cell])) seen[count++] = value_[cell];
    }
    if (2 * count <= kCount) return at(k);
    const auto median = static_cast<double>(median_of_few(std::span(seen).first(count)));
    return {true, std::clamp(median, lowest, kRaised_mm)};
  }
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
    const auto median = static_cast<double>(median_of_few(std::span(seen).first(count)));
    return {true, std::clamp(median, lowest, kRaised_mm)};
  }

  std::array<float, kRows> value_{};
  std::array<bool, kRows> there_{};
  std::array<Strip, kKnotsMax> knot_{};
  std::size_t knots_ = 1;
  std::size_t length_ = 0;
};

/// Length of a chamfer's leg along the edge. Wear changes it by several millimetres, but smoothly, over 50 mm and more;
/// a chip is shorter. So the expected value at each position is that of the parabola through the legs 8 to 20 mm away
/// on both sides.
class Chamfer {
 public:
  /// `bends`: the edge continues at another face here.
  void set(std::size_t k, bool bends, bool known, double leg_mm) {
    bends_[k + 1] = bends_[k] + (bends ? 1U : 0U);
    sum_[k + 1] = sum_[k] + (known ? leg_mm : 0.0);
    count_[k + 1] = count_[k] + (known ? 1U : 0U);
  }
  /// Unknown near the end of an edge or a bend, and between dropouts.
  [[nodiscard]] Strip at(std::size_t k, std::size_t length, double longest_mm) const {
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
    return {true, std::min((kFar2 * near - kNear2 * far) / (kFar2 - kNear2), longest_mm)};
  }

 private:
  static constexpr std::size_t kNearLow = 7, kNearHigh = 10, kFarLow = 11, kFarHigh = 16;
  std::array<std::uint32_t, kRows + 1> bends_{};
  std::array<double, kRows + 1> sum_{};
  std::array<std::uint32_t, kRows + 1> count_{};
};

/// The lines along one edge, at distances of a cell each. Between them they are interpolated: the draft of the end
/// faces moves the edge over the raster, and a chamfer changes by a cell's width between adjacent cells.
class Edge {
 public:
  static constexpr std::size_t kLines = kSurfaceEdgeSteps + 1;
  static constexpr double from_edge_mm(std::size_t line) { return (static_cast<double>(line) + 0.5) * kSurfaceCell_mm; }

  /// `there(k)`: the face with this edge at the k-th cell along it, kNoFace if there is none; `value(k, distance)`:
  /// distance from that face, at a distance from the edge.
  template <typename There, typename Value>
  void learn(std::size_t length, const There& there, const Value& value) {
    length_ = length;
    for (std::size_t line = 0; line < kLines; ++line)
      lines_[line].read(
          length, [&](std::size_t k) { return there(k) != kNoFace; },
          [&](std::size_t k) { return value(k, from_edge_mm(line)); });
    std::size_t legs = 0;
    for (std::size_t k = 0; k < length; ++k) {
      const Strip leg = leg_at(k);
      chamfer_.set(k, k > 0 && there(k) != there(k - 1), leg.known, leg.expected_mm);
      if (leg.known) legs_[legs++] = static_cast<float>(leg.expected_mm);
    }
    learn_legs(std::span(legs_).first(legs));
  }
  /// The lines, for the usual leg length of the block's chamfers.
  void learn_lines(double usual_mm) {
    longest_mm_ = std::max(longest_mm_, kWornLongest * usual_mm);
    const auto steps = [](double mm, std::size_t least) {
      return std::clamp(static_cast<std::size_t>(mm / kSurfaceCell_mm), least, kSurfaceEdgeSteps);
    };
    chamfer_steps_ = steps(kWornUsually * usual_mm, chamfer_steps_);
    reach_steps_ = steps(kWornLongest * usual_mm, reach_steps_);
    for (std::size_t line = 0; line < kLines; ++line) lines_[line].learn(lowest_mm(from_edge_mm(line)));
  }
  [[nodiscard]] double usual_leg_mm() const { return usual_leg_mm_; }
  /// Steps from the edge covered by a usual chamfer, worn or not; and by the longest ones.
  [[nodiscard]] std::size_t chamfer_steps() const { return chamfer_steps_; }
  [[nodiscard]] std::size_t reach_steps() const { return reach_steps_; }
  /// Variation of the legs along the edge: half of the difference between the shortest and the longest tenth.
  [[nodiscard]] double leg_spread_mm() const { return leg_spread_mm_; }

  [[nodiscard]] Strip at(std::size_t k, double distance, bool in_corner) const {
    const double place = std::clamp(distance / kSurfaceCell_mm - 0.5, 0.0, static_cast<double>(kLines - 1));
    const std::size_t line = std::min(static_cast<std::size_t>(place), kLines - 2);
    const auto on = [&](std::size_t which) {
      return in_corner ? lines_[which].near_corner(k, lowest_mm(from_edge_mm(which))) : lines_[which].at(k);
    };
    const Strip low = on(line);
    const Strip high = on(line + 1);
    if (!low.known || !high.known) return {};
    const double part = place - static_cast<double>(line);
    return {true, low.expected_mm + part * (high.expected_mm - low.expected_mm)};
  }
  /// Expected depth from the chamfer next to this position.
  [[nodiscard]] Strip line_near(std::size_t k, double distance) const {
    if (distance < kSaturated_mm) return {};
    const Strip leg = chamfer_.at(k, length_, longest_mm_);
    return {leg.known, -std::max(0.0, leg.expected_mm - distance)};
  }

 private:
  /// Closer to the edge the end face is the nearest face, and the distance to it hardly depends on the chamfer.
  static constexpr double kSaturated_mm = 2.5;
  static constexpr std::size_t kLegsMin = 40;
  /// A worn cast chamfer has up to this many times its usual length.
  static constexpr double kWornLongest = 1.9;
  static constexpr double kWornUsually = 1.4;
  /// The same for a nominal chamfer of 4 mm, the default for an edge without data.
  static constexpr std::size_t kChamferSteps = 4;
  static constexpr std::size_t kReachSteps = 6;
  static constexpr double kLongest_mm = 8.0;

  [[nodiscard]] double lowest_mm(double distance) const { return -std::max(0.0, longest_mm_ - distance); }

  /// Leg of the chamfer, from the outermost line that is low all the way from the edge.
  [[nodiscard]] Strip leg_at(std::size_t k) const {
    constexpr float kReached_mm = 0.4F;
    std::size_t seen = 0;
    double leg = kSaturated_mm;
    bool ended = false;
    for (std::size_t line = 0; line < kLines; ++line) {
      const float off = lines_[line].value(k);
      if (from_edge_mm(line) < kSaturated_mm || std::isnan(off)) continue;
      ++seen;
      ended = ended || !(off < -kReached_mm);
      if (!ended) leg = from_edge_mm(line) - static_cast<double>(off);
    }
    constexpr std::size_t kSeenMin = 3;
    return {seen >= kSeenMin, leg};
  }

  void learn_legs(std::span<float> legs) {
    if (legs.size() < kLegsMin) return;
    const auto quantile = [&](std::size_t tenths) {
      const auto at = legs.begin() + static_cast<std::ptrdiff_t>(legs.size() * tenths / 10);
      std::nth_element(legs.begin(), at, legs.end());
      return static_cast<double>(*at);
    };
    usual_leg_mm_ = quantile(5);
    leg_spread_mm_ = 0.5 * (quantile(9) - quantile(1));
  }

  std::array<EdgeLine, kLines> lines_;
  Chamfer chamfer_;
  std::array<float, kRows> legs_{};
  std::size_t length_ = 0;
  std::size_t chamfer_steps_ = kChamferSteps;
  std::size_t reach_steps_ = kReachSteps;
  double longest_mm_ = kLongest_mm;
  double usual_leg_mm_ = 0.0;
  double leg_spread_mm_ = 0.0;
};

/// The second smallest value of the four edges: that of the cast chamfers even if both ends are broken.
template <typename Of>
double second_smallest(const std::array<Edge, 2>& ends, const std::array<Edge, 2>& sides, const Of& of) {
  std::array<double, 4> values = {of(ends[0]), of(ends[1]), of(sides[0]), of(sides[1])};
  std::sort(values.begin(), values.end());
  return values[1];
}

/// Variation of the block's chamfers along their edges relative to the usual one, at least 1: cast ones of 4 mm have a
/// spread of up to 1.4 mm.
double wear_of(const std::array<Edge, 2>& ends, const std::array<Edge, 2>& sides) {
  constexpr double kUsualSpread_mm = 1.4;
  constexpr double kWearMax = 2.5;
  const double spread = second_smallest(ends, sides, [](const Edge& edge) { return edge.leg_spread_mm(); });
  return std::clamp(spread / kUsualSpread_mm, 1.0, kWearMax);
}

std::size_t high_x(std::size_t cell) {
  return std::size_t{cell % kColumns >= kColumns / 2};
}
std::size_t high_y(std::size_t cell) {
  return std::size_t{cell / kColumns >= kRows / 2};
}

/// The inner edges, which run along the rail: the expected height of each row.
std::array<Strip, kRows> inner_edges(std::span<const std::uint16_t> table, const SurfaceField& field) {
  std::array<Strip, kRows> rows;
  Median median;
  for (std::size_t row = 0; row < kRows; ++row) {
    median.clear();
    std::uint32_t cells = 0;
    bool has_upper_edge = false;
    for (std::size_t i = row * kColumns; i < (row + 1) * kColumns; ++i) {
      if (!is_judged(table[i]) || end_of(table[i]) != kFar || (table[i] & (kFoot | kUpperEdge)) == 0) continue;
      ++cells;
      has_upper_edge = has_upper_edge || (table[i] & kUpperEdge) != 0;
      if (field.seen(i)) median.add(field.off[i]);
    }
    const double lowest_mm = has_upper_edge ? -kFillet_mm : -kFootLow_mm;
    if (median.count() >= kLikeMin && static_cast<double>(median.count()) >= kSeenUsually * static_cast<double>(cells))
      rows[row] = {true, std::clamp(median.value(), lowest_mm, kFillet_mm)};
  }
  return rows;
}

/// The block's outer edges; of two, the first one is at low coordinates.
struct OuterEdges {
  std::array<Edge, 2> ends;
  std::array<Edge, 2> sides;
};

OuterEdges outer_edges(const SurfaceTable& whole, Team& team, const SurfaceField& field) {
  const std::span<const std::uint16_t> table = whole.cells();
  OuterEdges edges;
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
    edges.ends[high].learn(
        kRows, [&](std::size_t row) { return end_face[row]; },
        [&](std::size_t row, double distance) {
          const double x = sign * (whole.end_mm(row) - distance);
          return field.off_between((x + kSurfaceHalfX_mm) / kSurfaceCell_mm - 0.5, row * kColumns, 1);
        });
    edges.sides[high].learn(
        kColumns, [&](std::size_t column) { return side_face[high][column]; },
        [&](std::size_t column, double distance) {
          const double y = sign * (whole.side_mm(high == 1) - distance);
          return field.off_between((y + kSurfaceHalfY_mm) / kSurfaceCell_mm - 0.5, column, kColumns);
        });
  });

  const double usual_mm =
      second_smallest(edges.ends, edges.sides, [](const Edge& edge) { return edge.usual_leg_mm(); });
  team.run(2, [&](std::size_t high) {
    edges.ends[high].learn_lines(usual_mm);
    edges.sides[high].learn_lines(usual_mm);
  });
  return edges;
}

/// Subtracts from one cell what its edges are expected to look like.
class EdgeSubtraction {
 public:
  EdgeSubtraction(const SurfaceTable& whole, const OuterEdges& edges, const std::array<Strip, kRows>& rows,
                  SurfaceField& field)
      : whole_(whole), edges_(edges), rows_(rows), field_(field) {}

  void operator()(std::size_t i) const {
    field_.face_off[i] = field_.off[i];
    const std::uint16_t entry = whole_.cells()[i];
    if (!is_judged(entry)) return;
    const Edge& end = edges_.ends[high_x(i)];
    const Edge& side = edges_.sides[high_y(i)];
    const bool at_end = end_of(entry) < end.reach_steps();
    const bool at_side = side_of(entry) < side.reach_steps();
    const bool inner = (entry & (kFoot | kUpperEdge)) != 0;
    if (!inner && !at_end && !at_side) return;
    if (field_.zone[i] != SurfaceZone::none && (at_end || at_side))
      field_.zone[i] = at_end && at_side ? SurfaceZone::corner
                       : end_of(entry) < end.chamfer_steps() || side_of(entry) < side.chamfer_steps()
                           ? SurfaceZone::outer_edge
                           : SurfaceZone::behind_edge;
    const std::size_t row = i / kColumns;
    const std::size_t column = i % kColumns;
    const double from_end = whole_.end_mm(row) - std::abs(surface_x_mm(column));
    const double from_side = whole_.side_mm(high_y(i) == 1) - std::abs(surface_y_mm(row));
    constexpr Strip kNothing{true, 0.0};
    const Strip by_end = at_end ? end.at(row, from_end, at_side) : kNothing;
    const Strip by_side = at_side ? side.at(column, from_side, at_end) : kNothing;
    const Strip by_row = inner ? rows_[row] : kNothing;
    if (!by_end.known || !by_side.known || !by_row.known) {
      field_.zone[i] = SurfaceZone::none;
      return;
    }
    // Two chamfers meet in a corner: the deeper one is visible. The line along the end also contains a fillet's height.
    const double expected = std::min(by_end.expected_mm, by_side.expected_mm) + (at_end ? 0.0 : by_row.expected_mm);
    Strip line;
    if (at_end != at_side) line = at_end ? end.line_near(row, from_end) : side.line_near(column, from_side);
    const bool corner = at_end && at_side;
    const bool outer = at_end || at_side;
    field_.face_off[i] -= outer && !corner && !line.known
                              ? std::numeric_limits<float>::quiet_NaN()
                              : static_cast<float>(line.known ? line.expected_mm : expected);
    field_.off[i] -= static_cast<float>(expected);
  }

 private:
  const SurfaceTable& whole_;
  const OuterEdges& edges_;
  const std::array<Strip, kRows>& rows_;
  SurfaceField& field_;
};

}  // namespace

void exclude_edges(const SurfaceTable& whole, Team& team, SurfaceField& field) {
  const std::array<Strip, kRows> rows = inner_edges(whole.cells(), field);
  const OuterEdges edges = outer_edges(whole, team, field);
  field.edge_wear = wear_of(edges.ends, edges.sides);
  const EdgeSubtraction subtract(whole, edges, rows, field);
  team.run(2, [&](std::size_t half) { for_cells_of(whole, subtract, static_cast<int>(half)); });
}

}  // namespace slabd::algo
