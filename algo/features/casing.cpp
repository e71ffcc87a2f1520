// SPDX-License-Identifier: Apache-2.0
//
// Problem: find a casing's position and height. The scanner sees its flat rim and nothing inside its bore, so the bore
// shows as a round hole in the points. In each angular sector the innermost point is a fraction of the point pitch
// outside the edge. Where a patch of points is missing it is far outside; the robust circle ignores it.
//
// The gaps are uneven: where the scanner's point rows run along the edge, a whole sector can miss it by a row. But the
// edge can only be inside of every point, so the smallest gaps are the most accurate. The circle therefore gives less
// weight to points outside it (a tenth), which halves the error of its centre.
//
// The rim's height is that of its plane at the bore's axis (casing_fits.h): slurry or a drop on a rim is not part of
// it, and a dark side of a rim returns fewer points. One height is valid for the whole rim only if most of its
// circumference is in that one plane with little tilt. It is measured clear of the rim's edges, which are round and
// half visible: low places there are not damage. A lip or a crust higher than the seat is damage, because the rail pad
// would rest on it, and a rim with one has no height.
//
// The sectors are deliberately wide: in a wider sector more points compete for the innermost and the gap is smaller
// (spread ~ 1/width), which outweighs the smaller number of sectors (~ 1/sqrt(count)).
#include "algo/features/casing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algo/features/casing_fits.h"
#include "algo/features/casing_points.h"
#include "algo/median.h"
#include "algo/moments.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kSectors = limits::kRimSectors;
constexpr std::size_t kSectorsMin = kSectors / 2;
/// Spread of the edge's directions: half of the edge in one piece has 0.095; below this one axis of the centre is too
/// uncertain.
constexpr double kSpreadMin = 0.09;
/// The innermost points depend on the centre of the sectors; this many rounds are enough to converge.
constexpr int kRounds = 6;
/// ... or fewer: done if the innermost points are the same and the centre moved by at most this.
constexpr double kSettled_mm = 1e-9;
/// Search range for innermost points around the nominal bore radius.
constexpr double kSearch_mm = 2.5;
/// ... and around the nominal rim height.
constexpr double kHeightGate_mm = 1.5;
/// The scale is at least a few hundredths; otherwise a regular point pattern would decide which points are outliers.
constexpr CircleWeights kEdgeWeights = {.scale_min = 0.02, .outside_weight = 0.1};
/// Neighbouring sectors share the scanner's rows, so their gaps are not independent, as the circle's covariance
/// assumes. Measured over 400 phases and rotations of the point pattern each, at pitches of 0.2 to 0.5 mm, even,
/// jittered or stretched, with a tenth of the points missing: the true variance of the centre is 0.95 to 1.7 times the
/// independent one, and up to 2.1 times if half of the edge is hidden.
constexpr double kEdgeVariance = 1.3;
double shared_rows(double spread) {
  return kEdgeVariance * std::sqrt(std::sqrt(0.5 / spread));
}
/// Correlation of the distances to the circle of the next point and the next but one: by chance up to this many times
/// 1/sqrt(n) of their variance. That is 0.20 for 48 points; none of 1800 ideal edges reached it at pitches up to
/// 0.3 mm, and one of forty edges of drawn concrete, with 0.21 to 0.27. A part that is displaced reaches 0.35 and more,
/// so the variance grows from here to kFormSure times this correlation.
constexpr double kFormChance = 1.4;
constexpr double kFormSure = 1.5;
/// Half of the edge displaced by t moves the centre by 0.6 to 0.7 t, 2.6 to 3 times the remaining scatter. With this
/// factor twice the standard deviation covers both casings of a block displaced in opposite directions.
constexpr double kFormVariance = 4.0;
/// Distances are clipped at this many times the scatter: for the correlation, which a single wide gap must not
/// dominate, and for the estimate of the displacement. Below this scatter the centre moves by less than a scanner's own
/// form error.
constexpr double kFormAlike = 0.7;
constexpr double kFormReach = 3.0;
/// A smaller limit outside the circle: such points hardly affected it (kEdgeWeights), and where the edge is dark their
/// distances are arbitrary.
constexpr double kFormOutside = 1.0;
constexpr double kFormMin_mm = 0.03;
constexpr double kRadiusOffMax_mm = 1.0;
/// Maximum density of points in the bore at or above rim height, relative to the rim. Strays reach a few per cent, a
/// cap reaches one.
constexpr double kInBoreMax = 0.2;
constexpr std::uint32_t kRimPointsMin = 200;
/// Minimum share of the rim's points on its plane; as for planes. At either edge of the rim at most the remaining share
/// may be higher than the seat.
constexpr double kRimShareMin = 0.8;
constexpr double kLipMax = 0.2;
/// Standard deviation of the rim beyond that of the seat, which has the same noise.
constexpr double kRimFormMax_mm = 0.15;
/// Half of the circumference must have been seen.
constexpr double kRimSeenMin = 0.5;
/// Points used for the rim's height: all of them, up to a pitch of 0.2 mm.
constexpr std::size_t kRimSample = 12'288;
/// Minimum share of the circumference on one plane. The rest may be above it, covered by objects on the rim, and hardly
/// any of it below.
constexpr double kRimOnMin = 0.6;
constexpr double kRimBelowMax = 0.1;
/// Maximum rise of the rim's plane from the axis to its edge: the higher side of a rim in the middle of its tolerance
/// is then still below the seat.
constexpr double kRimTiltMax_mm = 0.25;
/// Number of points around a casing, about, that are assigned to eighths of the ring; and the minimum in an eighth for
/// it to count.
constexpr std::size_t kRingSample = 3000;
constexpr double kEighthPointsMin = 4.0;
/// The usable rim ends this far inside its nominal edge: a casing may be off its position by half a millimetre.
constexpr double kRimEdge_mm = 0.5;

/// Points per call of a pass; their heights then fit on the stack.
constexpr std::size_t kPiece = 1024;

/// Plane coordinates around the nominal centre: x along the rail, y across, height above the fitted seat.
class CasingFrame {
 public:
  CasingFrame(const CasingTask& task, const SeatFrame& seat) {
    const Vec3& n = task.seat.normal;
    const Vec3 at = seat.in_seat(task.centre);
    axes_.x_mm = static_cast<float>(at[0]);
    axes_.s_mm = static_cast<float>(at[1]);
    const Vec3 place = seat.in_block(static_cast<double>(axes_.x_mm), static_cast<double>(axes_.s_mm), 0.0);
    const double height = n.dot(place) - task.seat.offset_mm;
    origin_ = place - height * n;
    ex_ = (Vec3::UnitX() - n.x() * n).normalized();
    ey_ = n.cross(ex_);
    const auto factors = [&](const Vec3& v) {
      return std::array{static_cast<float>(v.dot(seat.along_rail)), static_cast<float>(v.dot(seat.along_seat)),
                        static_cast<float>(v.dot(seat.up))};
    };
    axes_.across = factors(ex_);
    axes_.along = factors(ey_);
    axes_.up = factors(n);
    axes_.up_mm = static_cast<float>(height);
  }
  [[nodiscard]] const CasingAxes& axes() const { return axes_; }
  [[nodiscard]] Vec3 in_block(const Vec2& q) const { return origin_ + q.x() * ex_ + q.y() * ey_; }

 private:
  CasingAxes axes_;
  Vec3 origin_;
  Vec3 ex_;
  Vec3 ey_;
};

/// Calls `look(piece)` for all points, at most kPiece at a time.
template <typename Look>
void for_each_piece(std::span<const SeatPoints> runs, const SeatFrame&, const Look& look) {
  for (const SeatPoints& run : runs) {
    for (std::size_t first = 0; first < run.size(); first += kPiece) {
      const std::size_t count = std::min(kPiece, run.size() - first);
      look({run.x.subspan(first, count), run.s.subspan(first, count), run.h.subspan(first, count)});
    }
  }
}

/// The same for points that are still in the cloud.
template <typename Look>
void for_each_piece(const CloudPoints& cloud, const SeatFrame& seat, const Look& look) {
  std::array<float, kPiece> x;
  std::array<float, kPiece> s;
  std::array<float, kPiece> h;
  for (std::size_t first = 0; first < cloud.size(); first += kPiece) {
    const std::size_t count = std::min(kPiece, cloud.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3 p = seat.in_seat(cloud[first + i]);
      x[i] = static_cast<float>(p[0]);
      s[i] = static_cast<float>(p[1]);
      h[i] = static_cast<float>(p[2]);
    }
    look(SeatPoints{std::span(x).first(count), std::span(s).first(count), std::span(h).first(count)});
  }
}

/// Calls `look(x, y, height)` in the casing's frame for every `every`-th point.
template <typename Points, typename Look>
void for_all(const Points& points, const SeatFrame& seat, const CasingAxes& a, const Look& look,
             std::size_t every = 1) {
  std::size_t next = 0;
  for_each_piece(points, seat, [&](const SeatPoints& piece) {
    for (; next < piece.size(); next += every) {
      const float dx = piece.x[next] - a.x_mm;
      const float ds = piece.s[next] - a.s_mm;
      const float dh = piece.h[next];
      look(a.across[0] * dx + a.across[1] * ds + a.across[2] * dh, a.along[0] * dx + a.along[1] * ds + a.along[2] * dh,
           a.up[0] * dx + a.up[1] * ds + a.up[2] * dh + a.up_mm);
    }
    next -= piece.size();
  });
}

/// The same for about kRingSample points.
template <typename Points, typename Look>
void for_some(const Points& points, const SeatFrame& seat, const CasingAxes& a, const Look& look) {
  std::size_t all = 0;
  for_each_piece(points, seat, [&](const SeatPoints& piece) { all += piece.size(); });
  for_all(points, seat, a, look, 1 + all / kRingSample);
}

/// Variance of the centre, along either axis, from edge displacement over a part of the circumference: a crescent of
/// mortar, a dark side. The fitted circle follows it, so hardly any of it remains in the distances from which the
/// covariance is computed. But the remainder is correlated from sector to sector, as gaps between points are only by
/// chance.
double edge_form_mm2(std::span<const Vec2> edge, const Circle& circle) {
  if (!(circle.scatter > kFormMin_mm)) return 0.0;
  const auto n = static_cast<double>(edge.size());
  std::array<double, kSectors> off;
  for (std::size_t i = 0; i < edge.size(); ++i) off[i] = (edge[i] - circle.centre).norm() - circle.radius;
  std::array<double, kSectors> sorted = off;
  const double usual = median_of(std::span(sorted).first(edge.size()));
  const auto within = [&](std::size_t i, double scatters) {
    const double reach = scatters * circle.scatter;
    return std::clamp(off[i % edge.size()] - usual, -reach, std::min(reach, kFormOutside * circle.scatter));
  };
  double middle = 0.0;
  for (std::size_t i = 0; i < edge.size(); ++i) middle += within(i, kFormAlike) / n;
  const auto lean = [&](std::size_t i) { return within(i, kFormAlike) - middle; };
  double leaning = 0.0;
  double shared = 0.0;
  double moved = 0.0;
  for (std::size_t i = 0; i < edge.size(); ++i) {
    leaning += lean(i) * lean(i);
    shared += 0.5 * lean(i) * (lean(i + 1) + lean(i + 2));
    moved += within(i, kFormReach) * within(i, kFormReach);
  }
  if (!(leaning > 0.0)) return 0.0;
  const double chance = kFormChance / std::sqrt(n);
  const double belief = std::clamp((shared / leaning - chance) / ((kFormSure - 1.0) * chance), 0.0, 1.0);
  return belief * kFormVariance * moved / n;
}

/// Share of a ring's points between its heights, with equal weight for each eighth of the ring: if one side of a ring
/// is dark, most points come from the other side.
class RingByArea {
 public:
  explicit RingByArea(const CasingRing& ring)
      : ring_(ring), inner2_(ring.inner_mm * ring.inner_mm), outer2_(ring.outer_mm * ring.outer_mm) {}

  /// Adds a point; coordinates from the ring's centre.
  void add(float x, float y, float height) {
    const float radius2 = x * x + y * y;
    if (!(radius2 >= inner2_ && radius2 < outer2_)) return;
    const std::size_t eighth = (x < 0.0F ? 4U : 0U) + (y < 0.0F ? 2U : 0U) + (std::abs(x) < std::abs(y) ? 1U : 0U);
    all_[eighth] += 1.0;
    if (height >= ring_.low_mm && height <= ring_.high_mm) within_[eighth] += 1.0;
  }
  [[nodiscard]] double share() const {
    double seen = 0.0;
    double share = 0.0;
    for (std::size_t k = 0; k < all_.size(); ++k) {
      if (all_[k] < kEighthPointsMin) continue;
      seen += 1.0;
      share += within_[k] / all_[k];
    }
    return seen > 0.0 ? share / seen : 0.0;
  }

 private:
  CasingRing ring_;
  float inner2_;
  float outer2_;
  std::array<double, 8> all_{};
  std::array<double, 8> within_{};
};

struct EdgePoints {
  std::array<Vec2, kSectors> points;
  std::size_t size = 0;
  [[nodiscard]] std::span<const Vec2> view() const { return {points.data(), size}; }
  [[nodiscard]] bool operator==(const EdgePoints& other) const {
    return std::equal(view().begin(), view().end(), other.view().begin(), other.view().end());
  }
};

CasingRing ring(const Vec2& centre, double inner_mm, double outer_mm, double low_mm, double high_mm) {
  return {static_cast<float>(centre.x()), static_cast<float>(centre.y()), static_cast<float>(inner_mm),
          static_cast<float>(outer_mm),   static_cast<float>(low_mm),     static_cast<float>(high_mm)};
}

/// The innermost point of each sector around `centre`.
template <typename Points>
EdgePoints innermost(const Points& points, const SeatFrame& seat, const CasingTask& task, const CasingFrame& frame,
                     const Vec2& centre) {
  const CasingRing near_edge = ring(centre, task.bore_radius_mm - kSearch_mm,
                                    std::min(task.bore_radius_mm + kSearch_mm, task.rim_radius_mm - kRimEdge_mm),
                                    task.rim_height_mm - kHeightGate_mm, task.rim_height_mm + kHeightGate_mm);
  Innermost found(near_edge);
  for_each_piece(points, seat, [&](const SeatPoints& piece) { find_innermost(piece, frame.axes(), near_edge, found); });
  EdgePoints edge;
  for (std::size_t k = 0; k < kSectors; ++k)
    if (found.seen(k, near_edge))
      edge.points[edge.size++] = Vec2(static_cast<double>(found.x[k]), static_cast<double>(found.y[k]));
  return edge;
}

/// True if the circle contains a hole at the height of the rim. Objects deep in a bore are accepted: its edge is
/// visible all the same.
template <typename Points>
bool is_hole(const Points& points, const SeatFrame& seat, const CasingTask& task, const CasingFrame& frame,
             const Circle& circle) {
  const double low_mm = task.rim_height_mm - kHeightGate_mm;
  const double high_mm = std::numeric_limits<float>::max();
  const CasingRing inside = ring(circle.centre, 0.0, task.bore_radius_mm - kSearch_mm, low_mm, high_mm);
  const CasingRing around = ring(circle.centre, task.bore_radius_mm + kSearch_mm, task.rim_radius_mm, low_mm, high_mm);
  std::array<float, kPiece> heights;
  const auto per_mm2 = [&](const CasingRing& where) {
    std::size_t count = 0;
    for_each_piece(points, seat,
                   [&](const SeatPoints& piece) { count += heights_in_ring(piece, frame.axes(), where, heights); });
    return static_cast<double>(count) /
           static_cast<double>(where.outer_mm * where.outer_mm - where.inner_mm * where.inner_mm);
  };
  return per_mm2(inside) <= kInBoreMax * per_mm2(around);
}

/// Measures the height of the rim around the measured centre, clear of its inner and outer edge. Returns a doubt if the
/// height is not valid for the whole rim.
template <typename Points>
CasingDoubt measure_rim(const Points& points, const SeatFrame& seat, const CasingTask& task, const CasingFrame& frame,
                        const Vec2& centre, CasingFeature& casing) {
  const double width = task.rim_radius_mm - task.bore_radius_mm;
  const double margin = std::min(task.edge_margin_mm, 0.25 * width);
  constexpr float kAny = std::numeric_limits<float>::max();
  const CasingRing clear = ring(centre, task.bore_radius_mm + margin, task.rim_radius_mm - margin, -kAny, kAny);
  std::array<float, kPiece> heights;
  const auto count_in = [&](const CasingRing& where) {
    std::size_t count = 0;
    for_each_piece(points, seat,
                   [&](const SeatPoints& piece) { count += heights_in_ring(piece, frame.axes(), where, heights); });
    return count;
  };
  const std::size_t count = count_in(clear);
  if (count < kRimPointsMin) return CasingDoubt::rim_points;

  std::array<RimPoint, kRimSample> sample;
  std::size_t sampled = 0;
  std::size_t number = 0;
  const std::size_t every = 1 + count / (kRimSample + 1);
  for_all(points, seat, frame.axes(), [&](float x, float y, float height) {
    x -= clear.centre_x_mm;
    y -= clear.centre_y_mm;
    const float radius2 = x * x + y * y;
    if (!(radius2 >= clear.inner_mm * clear.inner_mm && radius2 < clear.outer_mm * clear.outer_mm)) return;
    if (number++ % every == 0 && sampled < sample.size()) sample[sampled++] = {x, y, height};
  });
  const RimHeight rim = rim_height(std::span(sample).first(sampled));
  casing.rim_points = static_cast<std::uint32_t>(rim.points * every);
  if (!rim.ok) return CasingDoubt::rim_form;
  casing.height_mm = rim.height_mm;
  casing.rim_std_mm = rim.std_mm;
  casing.sigma_height_mm = rim.sigma_mm;

  // Uses the seat's noise, not the rim's own scatter.
  const double seat_mm = has_value(task.seat.std_mm) ? task.seat.std_mm : 0.0;
  const double over_mm = std::max(rim.height_mm, 0.0) + std::max(4.0 * seat_mm, kRimFormMax_mm);
  // From inside the bore, over which a lip may project, up to the rim's nominal edge. If a casing is off its position,
  // the points there are seat, at the height of the rim.
  const CasingRing at_bore =
      ring(centre, task.bore_radius_mm - kRadiusOffMax_mm, task.bore_radius_mm + margin, over_mm, kAny);
  const CasingRing at_rim = ring(centre, task.rim_radius_mm - margin, task.rim_radius_mm, over_mm, kAny);
  const auto has_lip = [&](CasingRing edge, const RingByArea& over_by_area) {
    const std::size_t over = count_in(edge);
    edge.low_mm = -kAny;
    return static_cast<double>(over) > kLipMax * static_cast<double>(count_in(edge)) || over_by_area.share() > kLipMax;
  };
  RingByArea over_at_bore(at_bore);
  RingByArea over_at_rim(at_rim);
  for_some(points, seat, frame.axes(), [&](float x, float y, float height) {
    over_at_bore.add(x - clear.centre_x_mm, y - clear.centre_y_mm, height);
    over_at_rim.add(x - clear.centre_x_mm, y - clear.centre_y_mm, height);
  });
  if (rim.crust_mm > 0.0 || has_lip(at_bore, over_at_bore) || has_lip(at_rim, over_at_rim))
    return CasingDoubt::rim_crust;
  if (casing.rim_points < kRimPointsMin) return CasingDoubt::rim_points;
  const bool even = rim.share_seen >= kRimSeenMin && rim.share_on >= kRimOnMin && rim.share_below <= kRimBelowMax &&
                    rim.share_points >= kRimShareMin && rim.tilt * task.rim_radius_mm <= kRimTiltMax_mm &&
                    rim.std_mm <= std::hypot(seat_mm, kRimFormMax_mm);
  return even ? CasingDoubt::none : CasingDoubt::rim_form;
}

template <typename Points>
CasingFeature measure(const Points& points, const SeatFrame& seat, const CasingTask& task) {
  CasingFeature casing;
  casing.doubt = CasingDoubt::edge;
  const CasingFrame frame(task, seat);
  Circle circle;
  EdgePoints edge;
  for (int round = 0; round < kRounds; ++round) {
    const Vec2 centre = circle.ok ? circle.centre : Vec2(Vec2::Zero());
    const EdgePoints before = edge;
    edge = innermost(points, seat, task, frame, centre);
    casing.edge_points = static_cast<std::uint32_t>(edge.size);
    if (edge.size < kSectorsMin) return casing;
    circle = fit_circle_robust(edge.view(), centre, kEdgeWeights);
    casing.inlier_fraction = circle.weight / static_cast<double>(kSectors);
    if (!circle.ok || circle.weight < 0.4 * static_cast<double>(kSectors) || circle.spread < kSpreadMin) return casing;
    // The same points and the same circle: another round would change nothing.
    if (edge == before && (circle.centre - centre).norm() <= kSettled_mm) break;
  }
  casing.doubt = std::abs(circle.radius - task.bore_radius_mm) > kRadiusOffMax_mm ? CasingDoubt::radius
                 : is_hole(points, seat, task, frame, circle)                     ? CasingDoubt::none
                                                                                  : CasingDoubt::no_hole;
  if (casing.doubt != CasingDoubt::none) return casing;
  casing.centre = frame.in_block(circle.centre);
  casing.radius_mm = circle.radius;
  casing.edge_rms_mm = circle.scatter;
  casing.cov_circle = shared_rows(circle.spread) * circle.covariance;
  casing.cov_circle.diagonal().head<2>().array() += edge_form_mm2(edge.view(), circle);
  casing.doubt = measure_rim(points, seat, task, frame, circle.centre, casing);
  casing.ok = casing.doubt == CasingDoubt::none;
  return casing;
}

}  // namespace

CasingFeature measure_casing(std::span<const SeatPoints> runs, const SeatFrame& frame, const CasingTask& task) {
  return measure(runs, frame, task);
}

CasingFeature measure_casing(const CloudPoints& points, const CasingTask& task) {
  // Any frame along the seat is suitable; near the casing floats have the finest resolution.
  const Vec3& n = task.seat.normal;
  const Vec3 along_rail = (Vec3::UnitX() - n.x() * n).normalized();
  return measure(points, {task.centre, along_rail, n.cross(along_rail), n}, task);
}

}  // namespace slabd::algo
