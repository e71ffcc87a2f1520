// SPDX-License-Identifier: Apache-2.0
//
// Problem: find the radius of a fillet and the leg of a chamfer from cells of 1.25 mm, in which an arc of 2 mm is two
// cells wide and 0.3 mm high, and from faces that are some hundredths of a millimetre off their fitted planes.
//
// Idea: the sum of the distances over the rows next to an edge grows with the square of the radius and hardly depends
// on the position of the arc between the rows. It is compared with the same sum of a computed edge: two lines and an
// arc, sampled by the same rows and measured against the same nominal faces. The lines are the fitted faces, moved by
// the deviation of the rows just beyond the edge. Of each row the median along the edge is used, which ignores pores,
// chips and dust. A chamfer is found in the same way: a straight cut with equal legs on both faces, across the edge at
// each position; the median of the sums is used.
#include "algo/survey/surface_reference.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace slabd::algo {
namespace {

using namespace surface_cell;

constexpr std::size_t kColumns = kSurfaceColumns;
constexpr std::size_t kRows = kSurfaceRows;
/// Column half-way between the middle and an end, clear of casings and ends.
constexpr std::size_t kUsualColumn = kColumns / 4;
/// Minimum number of positions along an edge, and their minimum share of all positions of the edge.
constexpr std::size_t kPlacesMin = 10;
constexpr double kSeenUsually = 0.6;

/// Values of one row or one edge; capacity: the number of positions along an edge.
class Values {
 public:
  void clear() { count_ = places_ = 0; }
  void add(double value) {
    ++places_;
    if (!std::isnan(value)) values_[count_++] = value;
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] bool are_enough() const {
    return count_ >= kPlacesMin && static_cast<double>(count_) >= kSeenUsually * static_cast<double>(places_);
  }
  [[nodiscard]] double median() {
    const auto middle = values_.begin() + static_cast<std::ptrdiff_t>(count_ / 2);
    std::nth_element(values_.begin(), middle, values_.begin() + static_cast<std::ptrdiff_t>(count_));
    return *middle;
  }

 private:
  std::array<double, kRows> values_;
  std::size_t count_ = 0;
  std::size_t places_ = 0;
};

/// The size at which the increasing function `sum(size)` reaches `wanted`; `low` if that is smaller, NaN if it is above
/// `high`.
template <typename Sum>
double size_with(const Sum& sum, double wanted, double low, double high) {
  if (!(wanted <= sum(high))) return kNoValue;
  constexpr int kHalvings = 14;  // to a thousandth of a millimetre
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (sum(middle) < wanted ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

// ---- fillets -----------------------------------------------------------------------------------------------------

/// A face in the section x = 0: z over y.
struct Line {
  double at_origin = 0.0;
  double per_mm = 0.0;
  [[nodiscard]] double z(double y) const { return at_origin + per_mm * y; }
};

/// Two lines and the arc of this radius tangent to both. The edge is concave if the right line is steeper upward.
class RoundedCorner {
 public:
  RoundedCorner(const Line& left, const Line& right, double radius) : left_(left), right_(right), radius_(radius) {
    concave_ = right.per_mm > left.per_mm;
    const double up = concave_ ? 1.0 : -1.0;
    const double left_slant = std::sqrt(1.0 + left.per_mm * left.per_mm);
    const double right_slant = std::sqrt(1.0 + right.per_mm * right.per_mm);
    const double left_origin = left.at_origin + up * radius * left_slant;
    const double right_origin = right.at_origin + up * radius * right_slant;
    centre_y_ = (left_origin - right_origin) / (right.per_mm - left.per_mm);
    centre_z_ = left_origin + left.per_mm * centre_y_;
    from_ = centre_y_ + up * radius * left.per_mm / left_slant;
    to_ = centre_y_ + up * radius * right.per_mm / right_slant;
  }
  [[nodiscard]] double z(double y) const {
    if (y <= from_) return left_.z(y);
    if (y >= to_) return right_.z(y);
    const double off = y - centre_y_;
    const double half = std::sqrt(std::max(0.0, radius_ * radius_ - off * off));
    return concave_ ? centre_z_ - half : centre_z_ + half;
  }

 private:
  Line left_;
  Line right_;
  double radius_;
  bool concave_ = false;
  double centre_y_ = 0.0;
  double centre_z_ = 0.0;
  double from_ = 0.0;
  double to_ = 0.0;
};

/// One edge along the rail between two faces: `low` is nearer to the seat's middle.
class FilletSearch {
 public:
  FilletSearch(const BlockModel& model, const SurfaceTable& table, const std::array<FacePlane, kFaces>& planes,
               const SurfaceField& field)
      : model_(model), table_(table), planes_(planes), field_(field) {}

  /// False if the edge was not seen.
  [[nodiscard]] bool find(Face low, Face high, std::uint16_t near_edge, bool outer, EdgeFeature& edge) {
    low_ = low;
    high_ = high;
    if (!look(near_edge, outer, edge.n)) return false;
    // Along each face, from the edge to the end of an arc of 1 mm.
    const double cosine = model_.plane(low).n.dot(model_.plane(high).n);
    const double tangent = std::sqrt((1.0 - cosine) / (1.0 + cosine));
    // The closer to the arc the faces' level is taken, the less their form matters. So the first search uses the
    // largest possible arc, the next ones the extent of the previous result.
    double reach_mm = kSurfaceEdge_mm;
    constexpr int kRounds = 3;
    for (int round = 0; round < kRounds; ++round) {
      const Line left = line_of(outer ? low : high, reach_mm);
      const Line right = line_of(outer ? high : low, reach_mm);
      const double sign = right.per_mm > left.per_mm ? 1.0 : -1.0;
      const auto drawn = [&](double radius) { return sign * drawn_sum(RoundedCorner(left, right, radius), reach_mm); };
      edge.radius_mm = size_with(drawn, sign * seen_sum(reach_mm), 0.0, kRadiusMax_mm);
      if (!has_value(edge.radius_mm)) return false;
      reach_mm = std::clamp(edge.radius_mm * tangent + kSurfaceCell_mm, 2.0 * kSurfaceCell_mm, kSurfaceEdge_mm);
    }
    return edge.radius_mm >= kRadiusMin_mm;
  }

 private:
  static constexpr double kRadiusMin_mm = 1.0;
  static constexpr double kRadiusMax_mm = 12.0;
  static constexpr std::size_t kRowsBeyond = 6;
  struct Row {
    Face face = Face::seat;
    double y_mm = 0.0;
    double from_edge_mm = 0.0;  ///< along the face
    double median_mm = 0.0;
  };

  /// Reads the rows of both faces near the edge and slightly further. False if too little was seen near it.
  [[nodiscard]] bool look(std::uint16_t near_edge, bool outer, std::uint32_t& places) {
    const Line low = nominal_line(low_);
    const Line high = nominal_line(high_);
    const double edge_y_mm = (low.at_origin - high.at_origin) / (high.per_mm - low.per_mm);
    count_ = 0;
    places = kColumns;
    bool any = false;
    const auto [first, end] = table_.rows();
    for (std::size_t k = first; k < end; ++k) {
      const std::uint16_t entry = table_.cells()[k * kColumns + kUsualColumn];
      Row row{face_of(entry), surface_y_mm(k), 0.0, 0.0};
      if (!is_judged(entry) || (row.face != low_ && row.face != high_) || (row.y_mm > 0.0) != outer) continue;
      row.from_edge_mm = std::abs(row.y_mm - edge_y_mm) / model_.plane(row.face).n.z();
      const bool is_near = (entry & near_edge) != 0;
      const double beyond_mm = row.from_edge_mm - kSurfaceEdge_mm;
      const bool is_beyond = !is_near_edge(entry) && beyond_mm < static_cast<double>(kRowsBeyond) * kSurfaceCell_mm;
      if (!is_near && !is_beyond) continue;
      if (!look_along(k) || count_ == rows_.size()) {
        if (is_near) return false;
        continue;
      }
      if (is_near) places = std::min(places, static_cast<std::uint32_t>(values_.count()));
      any = any || is_near;
      row.median_mm = values_.median();
      rows_[count_++] = row;
    }
    return any;
  }
  /// Fills `values_` with a row. False if too little of it was seen.
  [[nodiscard]] bool look_along(std::size_t row) {
    values_.clear();
    for (std::size_t i = row * kColumns; i < (row + 1) * kColumns; ++i) {
      const std::uint16_t entry = table_.cells()[i];
      if (is_judged(entry) && end_of(entry) == kFar) values_.add(static_cast<double>(field_.off[i]));
    }
    return values_.are_enough();
  }
  [[nodiscard]] Line nominal_line(Face face) const {
    const Plane& nominal = model_.plane(face);
    return {nominal.d / nominal.n.z(), -nominal.n.y() / nominal.n.z()};
  }
  /// The fitted face, moved and tilted to the nearest rows of it beyond `reach_mm`, because a shoulder undulates. A jaw
  /// has too few rows for that, and is flat.
  [[nodiscard]] Line line_of(Face face, double reach_mm) const {
    const bool is_jaw = face == Face::jaw_inner || face == Face::jaw_outer;
    const double slant = 1.0 / model_.plane(face).n.z();
    const double end_mm = reach_mm + static_cast<double>(kRowsBeyond) * kSurfaceCell_mm * slant;
    double count = 0.0;
    double sum = 0.0;
    double sum_y = 0.0;
    double sum_yy = 0.0;
    double sum_ym = 0.0;
    double origin = 0.0;
    for (std::size_t i = 0; i < count_; ++i) {
      if (rows_[i].face != face || rows_[i].from_edge_mm <= reach_mm || rows_[i].from_edge_mm > end_mm) continue;
      if (count == 0.0) origin = rows_[i].y_mm;
      const double y = rows_[i].y_mm - origin;
      count += 1.0;
      sum += rows_[i].median_mm;
      sum_y += y;
      sum_yy += y * y;
      sum_ym += y * rows_[i].median_mm;
    }
    double level = 0.0;
    double turn = 0.0;
    if (count > 0.0) {
      const double spread = sum_yy - sum_y * sum_y / count;
      if (!is_jaw && count >= 4.0) turn = (sum_ym - sum_y * sum / count) / spread;
      level = sum / count - turn * (sum_y / count + origin);
    }
    const Line nominal = nominal_line(face);
    const FacePlane& fitted = planes_[static_cast<std::size_t>(face)];
    return {nominal.at_origin + (fitted.a0 + level) * slant, nominal.per_mm + (fitted.ay + turn) * slant};
  }
  [[nodiscard]] double seen_sum(double reach_mm) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < count_; ++i)
      if (rows_[i].from_edge_mm <= reach_mm) sum += rows_[i].median_mm;
    return sum;
  }
  /// Sum of the medians expected for this corner.
  [[nodiscard]] double drawn_sum(const RoundedCorner& corner, double reach_mm) const {
    constexpr int kParts = 10;
    double sum = 0.0;
    for (std::size_t i = 0; i < count_; ++i) {
      if (rows_[i].from_edge_mm > reach_mm) continue;
      const FacePlane& fitted = planes_[static_cast<std::size_t>(rows_[i].face)];
      for (int part = 0; part < kParts; ++part) {
        const double y = rows_[i].y_mm + ((part + 0.5) / kParts - 0.5) * kSurfaceCell_mm;
        const Vec3 p(0.0, y, corner.z(y));
        const double to_low = model_.plane(low_).distance(p);
        const double to_high = model_.plane(high_).distance(p);
        sum += ((std::abs(to_low) <= std::abs(to_high) ? to_low : to_high) - fitted.at(0.0, y)) / kParts;
      }
    }
    return sum;
  }

  const BlockModel& model_;
  const SurfaceTable& table_;
  const std::array<FacePlane, kFaces>& planes_;
  const SurfaceField& field_;
  Face low_ = Face::seat;
  Face high_ = Face::jaw_inner;
  std::array<Row, 48> rows_{};
  std::size_t count_ = 0;
  Values values_;
};

// ---- chamfers ----------------------------------------------------------------------------------------------------

/// Distances from the edge that are examined, one cell each. Nearer cells contain points beyond the edge; cells beyond
/// the longest leg show the face's deviation from its plane.
constexpr std::size_t kFirstLine = 1;
constexpr std::size_t kLines = 7;
constexpr std::size_t kLinesBeyond = 10;
constexpr double from_edge_mm(std::size_t line) {
  return (static_cast<double>(line) + 0.5) * kSurfaceCell_mm;
}

/// Expected sum of the lines: a cut with legs of this length on both faces, whose normals have this `cosine`.
double drawn_chamfer(double leg, double cosine) {
  const double sine = std::sqrt(1.0 - cosine * cosine);
  const double fall = sine / (1.0 + cosine);
  double sum = 0.0;
  for (std::size_t line = kFirstLine; line < kLines; ++line) {
    const double distance = from_edge_mm(line);
    const double depth = std::max(0.0, leg - distance) * fall;
    sum += std::min(depth, distance * sine + depth * cosine);
  }
  return sum;
}

/// `place(k, line)`: distance from the face there, NaN if not seen; `there(k)`: true if the edge bounds the face there.
template <typename There, typename Place>
bool find_chamfer(std::size_t length, double cosine, const There& there, const Place& place, EdgeFeature& edge) {
  Values sums;
  for (std::size_t k = 0; k < length; ++k) {
    if (!there(k)) continue;
    double near = 0.0;
    double beyond = 0.0;
    for (std::size_t line = kFirstLine; line < kLines; ++line) near += place(k, from_edge_mm(line));
    for (std::size_t line = kLines; line < kLinesBeyond; ++line) beyond += place(k, from_edge_mm(line));
    constexpr double kShare = static_cast<double>(kLines - kFirstLine) / static_cast<double>(kLinesBeyond - kLines);
    sums.add(kShare * beyond - near);
  }
  if (!sums.are_enough()) return false;
  constexpr double kLegMin_mm = 2.0;
  constexpr double kLegMax_mm = 9.0;
  edge.chamfer_mm = size_with([&](double leg) { return drawn_chamfer(leg, cosine); }, sums.median(), 0.0, kLegMax_mm);
  edge.n = static_cast<std::uint32_t>(sums.count());
  return edge.chamfer_mm >= kLegMin_mm;
}

EdgeFace named(Face face) {
  switch (face) {
    case Face::jaw_inner: return EdgeFace::jaw_inner;
    case Face::jaw_outer: return EdgeFace::jaw_outer;
    case Face::shoulder_inner: return EdgeFace::shoulder_inner;
    case Face::shoulder_outer: return EdgeFace::shoulder_outer;
    case Face::end_minus: return EdgeFace::end_minus;
    case Face::end_plus: return EdgeFace::end_plus;
    case Face::side_inner: return EdgeFace::side_inner;
    case Face::side_outer: return EdgeFace::side_outer;
    case Face::seat:
    case Face::top:
    case Face::rim_inner:
    case Face::rim_outer: break;
  }
  return EdgeFace::seat;
}

EdgeFeature edge_between(Face face, Face other) {
  EdgeFeature edge;
  edge.face = named(face);
  edge.face_to = named(other);
  return edge;
}

using Edges = FixedVector<EdgeFeature, kEdgesMax>;

void learn_fillets(FilletSearch& search, Edges& edges) {
  for (const auto& [low, high, near_edge] :
       {std::tuple(Face::seat, Face::jaw_inner, kFoot), std::tuple(Face::seat, Face::jaw_outer, kFoot),
        std::tuple(Face::jaw_inner, Face::shoulder_inner, kUpperEdge),
        std::tuple(Face::jaw_outer, Face::shoulder_outer, kUpperEdge)}) {
    EdgeFeature edge = edge_between(low, high);
    const bool outer = high == Face::jaw_outer || high == Face::shoulder_outer;
    if (search.find(low, high, near_edge, outer, edge)) (void)edges.push(edge);
  }
}

void learn_chamfers(const BlockModel& model, const SurfaceTable& table, const SurfaceField& field, Edges& edges) {
  const std::span<const std::uint16_t> cells = table.cells();
  // Jaws are too short between their own edges.
  for (const Face face : {Face::seat, Face::shoulder_inner, Face::shoulder_outer}) {
    for (const Face end : {Face::end_minus, Face::end_plus}) {
      EdgeFeature edge = edge_between(face, end);
      const double sign = end == Face::end_plus ? 1.0 : -1.0;
      const auto there = [&](std::size_t row) {
        const std::uint16_t entry = cells[row * kColumns + kUsualColumn];
        return is_judged(entry) && face_of(entry) == face && !is_near_edge(entry);
      };
      const auto place = [&](std::size_t row, double distance) {
        const double x = sign * (table.end_mm(row) - distance);
        return static_cast<double>(
            field.off_between((x + kSurfaceHalfX_mm) / kSurfaceCell_mm - 0.5, row * kColumns, 1));
      };
      if (find_chamfer(kRows, model.plane(face).n.dot(model.plane(end).n), there, place, edge)) (void)edges.push(edge);
    }
  }
  for (const bool outer : {false, true}) {
    const Face face = outer ? Face::shoulder_outer : Face::shoulder_inner;
    const Face side = outer ? Face::side_outer : Face::side_inner;
    EdgeFeature edge = edge_between(face, side);
    const double sign = outer ? 1.0 : -1.0;
    const double middle = sign * (table.side_mm(outer) - from_edge_mm(kLinesBeyond));
    const auto row = static_cast<std::size_t>((middle + kSurfaceHalfY_mm) / kSurfaceCell_mm);
    const auto there = [&](std::size_t column) {
      const std::uint16_t entry = cells[row * kColumns + column];
      return is_judged(entry) && face_of(entry) == face && !is_near_edge(entry);
    };
    const auto place = [&](std::size_t column, double distance) {
      const double y = sign * (table.side_mm(outer) - distance);
      return static_cast<double>(field.off_between((y + kSurfaceHalfY_mm) / kSurfaceCell_mm - 0.5, column, kColumns));
    };
    if (find_chamfer(kColumns, model.plane(face).n.dot(model.plane(side).n), there, place, edge))
      (void)edges.push(edge);
  }
}

}  // namespace

void fit_edges(const BlockModel& model, const SurfaceTable& table, const std::array<FacePlane, kFaces>& planes,
               const SurfaceField& field, Team& team, Edges& edges) {
  edges.clear();
  Edges chamfers;
  team.run(2, [&](std::size_t half) {
    if (half == 1) return learn_chamfers(model, table, field, chamfers);
    FilletSearch search(model, table, planes, field);
    learn_fillets(search, edges);
  });
  for (const EdgeFeature& edge : chamfers) (void)edges.push(edge);
}

}  // namespace slabd::algo
