// SPDX-License-Identifier: Apache-2.0
//
// Problem: chamfers and fillets differ from block to block and along one edge, and a chip is deeper than that only
// where it is.
//
// Idea: a strip along an edge is expected to look like the others of its kind. Along a jaw's foot and upper edge that
// is the median of the row. Along the block's ends and sides, which wear, it is the median of the edge nearby; and a
// chamfer is expected to be as long as a parabola through its length on both sides says.
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

constexpr double kRaised_mm = 0.5;     ///< of an outer edge: flash, and no more than that
constexpr double kFillet_mm = 3.0;     ///< of an inner edge, either way
constexpr double kSeenUsually = 0.6;   ///< share of a strip's cells that must be seen before a gap in it is one
constexpr std::uint32_t kLikeMin = 8;  ///< cells of a strip

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

/// What is usual along an outer edge at one distance from it: the median over 45 mm of the edge, every 10 mm.
class EdgeLine {
 public:
  /// `there(k)`: is there such an edge at the k-th cell along it; `value(k)`: off the face there, NaN: not seen.
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
  /// What the edge is like 9 to 15 mm from the corner in which it ends near `k`: wear changes an edge over 30 mm and
  /// more, and what is broken out of a corner reaches less far along it.
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
  /// ... where the block's chamfers are usually that long.
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
  /// Steps from the edge that a chamfer takes, worn or not; and those that the longest of them reach.
  [[nodiscard]] std::size_t chamfer_steps() const { return chamfer_steps_; }
  [[nodiscard]] std::size_t reach_steps() const { return reach_steps_; }
  /// How much the legs differ along the edge: half of what lies between the shortest and the longest tenth of them.
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
  /// What the chamfer beside this place lets expect.
  [[nodiscard]] Strip beside(std::size_t k, double distance) const {
    if (distance < kSaturated_mm) return {};
    const Strip leg = chamfer_.at(k, length_, longest_mm_);
    return {leg.known, -std::max(0.0, leg.expected_mm - distance)};
  }

 private:
  /// Closer to the edge the end face is the nearest face, and the distance to it says little about the chamfer.
  static constexpr double kSaturated_mm = 2.5;
  static constexpr std::size_t kLegsMin = 40;
  /// Worn, a cast chamfer is up to this many times its usual length.
  static constexpr double kWornLongest = 1.9;
  static constexpr double kWornUsually = 1.4;
  /// The same for one of 4 mm nominally, which is what an edge has that says nothing.
  static constexpr std::size_t kChamferSteps = 4;
  static constexpr std::size_t kReachSteps = 6;
  static constexpr double kLongest_mm = 8.0;

  [[nodiscard]] double lowest_mm(double distance) const { return -std::max(0.0, longest_mm_ - distance); }

  /// How far the chamfer reaches, by the outermost line that is low all the way from the edge.
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

/// Of the four edges the second smallest: that of the cast chamfers even where both ends are broken out.
template <typename Of>
double second_smallest(const std::array<Edge, 2>& ends, const std::array<Edge, 2>& sides, const Of& of) {
  std::array<double, 4> values = {of(ends[0]), of(ends[1]), of(sides[0]), of(sides[1])};
  std::sort(values.begin(), values.end());
  return values[1];
}

/// By how much more than usual the chamfers of this block differ along themselves, from 1 on: cast ones of 4 mm have a
/// spread of up to 1.4 mm.
double wear_of(const std::array<Edge, 2>& ends, const std::array<Edge, 2>& sides) {
  constexpr double kUsualSpread_mm = 1.4;
  constexpr double kWearMax = 2.5;
  const double spread = second_smallest(ends, sides, [](const Edge& edge) { return edge.leg_spread_mm(); });
  return std::clamp(spread / kUsualSpread_mm, 1.0, kWearMax);
}

}  // namespace

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
          return field.off_between((x + kSurfaceHalfX_mm) / kSurfaceCell_mm - 0.5, row * kColumns, 1);
        });
    sides[high].learn(
        kColumns, [&](std::size_t column) { return side_face[high][column]; },
        [&](std::size_t column, double distance) {
          const double y = sign * (whole.side_mm(high == 1) - distance);
          return field.off_between((y + kSurfaceHalfY_mm) / kSurfaceCell_mm - 0.5, column, kColumns);
        });
  });

  const double usual_mm = second_smallest(ends, sides, [](const Edge& edge) { return edge.usual_leg_mm(); });
  team.run(2, [&](std::size_t high) {
    ends[high].learn_lines(usual_mm);
    sides[high].learn_lines(usual_mm);
  });
  field.edge_wear = wear_of(ends, sides);
  const auto take_away = [&](std::size_t i) {
    field.face_off[i] = field.off[i];
    const std::uint16_t entry = table[i];
    if (!is_judged(entry)) return;
    const Edge& end = ends[high_x(i)];
    const Edge& side = sides[high_y(i)];
    const bool at_end = end_of(entry) < end.reach_steps();
    const bool at_side = side_of(entry) < side.reach_steps();
    const bool inner = (entry & (kFoot | kUpperEdge)) != 0;
    if (!inner && !at_end && !at_side) return;
    if (field.zone[i] != SurfaceZone::none && (at_end || at_side))
      field.zone[i] = at_end && at_side ? SurfaceZone::corner
                      : end_of(entry) < end.chamfer_steps() || side_of(entry) < side.chamfer_steps()
                          ? SurfaceZone::outer_edge
                          : SurfaceZone::behind_edge;
    const std::size_t row = i / kColumns;
    const std::size_t column = i % kColumns;
    const double from_end = whole.end_mm(row) - std::abs(surface_x_mm(column));
    const double from_side = whole.side_mm(high_y(i) == 1) - std::abs(surface_y_mm(row));
    constexpr Strip kNothing{true, 0.0};
    const Strip by_end = at_end ? end.at(row, from_end, at_side) : kNothing;
    const Strip by_side = at_side ? side.at(column, from_side, at_end) : kNothing;
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

}  // namespace slabd::algo
