// SPDX-License-Identifier: Apache-2.0
//
// Idea: a casing's bore returns no points; its flat rim and the bearing plane around it do. From above this is a round
// hole with a full ring. Two of them, 233 mm apart, are searched along their nominal line. A missing patch has no ring
// and plain surface has no hole, so neither is mistaken for a bore. The hole found must then fit a circle of the right
// radius.
//
// ICP's sample is dense enough for the search: about a hundred of its points would be in the area of the hole. It also
// gives the grid range of the casings in an organised scan. So the fit, which needs every point around the casings,
// reads only a fortieth of the scan.
#include "algo/register/casing_ties.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "algo/features/casing.h"

namespace slabd::algo {
namespace {

constexpr int kShiftMax_mm = 100;
/// The part that is certainly inside the hole, and the ring around it that must be full.
constexpr double kInside_mm = 2.5;
constexpr double kRingFrom_mm = 1.5;
constexpr double kRingTo_mm = 6.0;
/// Full ring and empty hole score 1 for each casing; points in the hole cost three times the score of a ring.
constexpr double kHoleWeight = 3.0;
constexpr double kScoreMin = 0.5;
/// Positions whose score is lower than the best by at most this count as equal: the middle of them is used, ...
constexpr double kScoreAlike = 0.1;
/// ... as far as they are neighbours: twice the tolerance of hole and ring.
constexpr int kAlike_mm = 4;
/// Minimum number of points expected in the area of a hole: fewer may be missing by chance (12: six in a million).
constexpr double kHolePointsMin = 12.0;
/// Used if a fit has no covariance: a tenth of a millimetre, the edge at a pitch of half a millimetre.
constexpr double kSigmaUnknown_mm = 0.1;
/// Points this far outside a rim are still used for measuring the casing.
constexpr double kAround_mm = 10.0;
/// Margin of a grid range: points between those of the sample may be further out by some of its pitches.
constexpr double kMarginPitches = 4.0;
constexpr double kMarginMax_mm = 16.0;

/// Transform from the scanner's frame to the seat's.
CasingStrips strips_of(const BlockModel& model, const Pose& T_block_scanner) {
  const SeatFrame frame = SeatFrame::of(model);
  Mat3 rows;
  rows.row(0) = frame.along_rail;
  rows.row(1) = frame.along_seat;
  rows.row(2) = frame.up;
  CasingStrips strips;
  strips.R_seat_scanner = rows * T_block_scanner.rotation.toRotationMatrix();
  strips.t_seat_scanner = rows * (T_block_scanner.translation_mm - frame.origin);
  strips.half_spacing_mm = model.geometry().casing_half_spacing_mm.value;
  return strips;
}

/// The sample's points along the line of each casing.
struct StripSample {
  std::array<StripPlaces, 2> places;  ///< inner, outer
};

double reach_mm(const BlockModel& model) {
  return 0.5 * model.geometry().casing_rim_diameter_mm.value + kAround_mm;
}

StripSample take_strips(const IcpSample& sample, const BlockModel& model, const Pose& T_block_scanner,
                        std::span<float> room, Team& team) {
  constexpr std::size_t kColumn = limits::kIcpPointsMax + 16;
  const CasingStrips strips = strips_of(model, T_block_scanner);
  StripSample taken;
  team.run(2, [&](std::size_t side) {
    const auto column = [&](std::size_t k) { return room.subspan((3 * side + k) * kColumn, kColumn); };
    StripPlaces& to = taken.places[side];
    to = {column(0), column(1), column(2)};
    const double half_s_mm = reach_mm(model) + kMarginMax_mm;
    const std::size_t count = places_in_box(sample, strips, {side == 1, kShiftMax_mm + half_s_mm, half_s_mm}, to);
    to = {to.x.first(count), to.s.first(count), to.number.first(count)};
  });
  return taken;
}

/// A number for every position x = -kShiftMax_mm .. kShiftMax_mm along the line.
using Profile = std::array<int, 2 * kShiftMax_mm + 1>;

/// Number of points within `radius_mm` of each position; each point contributes to one range of positions.
Profile count_within(const StripPlaces& points, double radius_mm) {
  const auto radius = static_cast<float>(radius_mm);
  constexpr auto kEnd = static_cast<float>(kShiftMax_mm);
  std::array<int, 2 * kShiftMax_mm + 2> change{};
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    const float left = radius * radius - points.s[i] * points.s[i];
    if (!(left > 0.0F)) continue;
    const float half = std::sqrt(left);
    const float from = std::ceil(std::max(points.x[i] - half, -kEnd));
    const float to = std::floor(std::min(points.x[i] + half, kEnd));
    if (from > to) continue;
    ++change[static_cast<std::size_t>(static_cast<int>(from) + kShiftMax_mm)];
    --change[static_cast<std::size_t>(static_cast<int>(to) + kShiftMax_mm + 1)];
  }
  Profile count{};
  int now = 0;
  for (std::size_t k = 0; k < count.size(); ++k) count[k] = now += change[k];
  return count;
}

double ring_area_mm2(double inner_mm, double outer_mm) {
  return std::numbers::pi * (outer_mm * outer_mm - inner_mm * inner_mm);
}

struct BoresFound {
  std::optional<double> off_mm;
  double per_mm2 = 0.0;  ///< density of the sample on the bearing plane
};

BoresFound find_bores(const StripSample& strips, double bore_radius_mm, double window_mm) {
  const double hole_mm2 = ring_area_mm2(0.0, bore_radius_mm - kInside_mm);
  const double ring_mm2 = ring_area_mm2(bore_radius_mm + kRingFrom_mm, bore_radius_mm + kRingTo_mm);
  std::array<Profile, 2> hole;
  std::array<Profile, 2> ring;
  std::array<int, 2 * Profile().size()> rings;
  for (std::size_t side = 0; side < 2; ++side) {
    hole[side] = count_within(strips.places[side], bore_radius_mm - kInside_mm);
    ring[side] = count_within(strips.places[side], bore_radius_mm + kRingTo_mm);
    const Profile inside = count_within(strips.places[side], bore_radius_mm + kRingFrom_mm);
    for (std::size_t k = 0; k < inside.size(); ++k) ring[side][k] -= inside[k];
    std::copy(ring[side].begin(), ring[side].end(), rings.begin() + static_cast<std::ptrdiff_t>(side * inside.size()));
  }
  // A full ring: the number exceeded at a tenth of the positions.
  const auto full = rings.begin() + static_cast<std::ptrdiff_t>(rings.size() / 10);
  std::nth_element(rings.begin(), full, rings.end(), std::greater<>());
  BoresFound found;
  found.per_mm2 = static_cast<double>(*full) / ring_mm2;
  if (!(found.per_mm2 * hole_mm2 >= kHolePointsMin)) return found;

  const auto score = [&](int x_mm) {
    const auto k = static_cast<std::size_t>(x_mm + kShiftMax_mm);
    double sum = 0.0;
    for (std::size_t side = 0; side < 2; ++side) {
      const double around = std::min(1.0, ring[side][k] / (found.per_mm2 * ring_mm2));
      const double inside = std::min(1.0, hole[side][k] / (found.per_mm2 * hole_mm2));
      sum += std::max(around - kHoleWeight * inside, 0.0);
    }
    return sum;
  };
  const int reach = std::min(static_cast<int>(window_mm), kShiftMax_mm);
  double best_score = kScoreMin;
  int best_mm = 0;
  for (int k = 0; k <= 2 * reach; ++k) {
    const int x_mm = k % 2 == 0 ? k / 2 : -(k + 1) / 2;
    if (score(x_mm) <= best_score) continue;
    best_score = score(x_mm);
    best_mm = x_mm;
  }
  if (best_score <= kScoreMin) return found;
  double sum = 0.0, alike = 0.0;
  for (int x_mm = std::max(best_mm - kAlike_mm, -reach); x_mm <= std::min(best_mm + kAlike_mm, reach); ++x_mm) {
    if (score(x_mm) < best_score - kScoreAlike) continue;
    sum += x_mm;
    alike += 1.0;
  }
  found.off_mm = sum / alike;
  return found;
}

/// The part of an organised cloud that contains the points within `half_mm` of (off_mm, 0), according to the sample.
CloudPart part_around(const Cloud& cloud, const IcpSample& sample, const StripPlaces& places, double off_mm,
                      double half_mm) {
  std::size_t row_first = cloud.height, row_last = 0, column_first = cloud.width, column_last = 0;
  for (std::size_t i = 0; i < places.x.size(); ++i) {
    if (std::abs(static_cast<double>(places.x[i]) - off_mm) > half_mm ||
        std::abs(static_cast<double>(places.s[i])) > half_mm)
      continue;
    const SliceOfScan slice = slice_of(cloud, sample, static_cast<std::size_t>(places.number[i]));
    const std::size_t last = slice.first + slice.points - 1;
    const bool one_row = slice.first / cloud.width == last / cloud.width;
    row_first = std::min(row_first, slice.first / cloud.width);
    row_last = std::max(row_last, last / cloud.width);
    column_first = std::min(column_first, one_row ? slice.first % cloud.width : 0);
    column_last = std::max(column_last, one_row ? last % cloud.width : cloud.width - 1);
  }
  if (row_first > row_last || column_first > column_last) return {};
  return {row_first * cloud.width + column_first, column_last - column_first + 1, row_last - row_first + 1,
          cloud.width};
}

}  // namespace

std::optional<double> casings_off_mm(const IcpSample& sample, const BlockModel& model,
                                     const EvaluationSettings& settings, const Pose& T_block_scanner,
                                     std::span<float> room, Team& team) {
  return find_bores(take_strips(sample, model, T_block_scanner, room, team),
                    0.5 * model.geometry().casing_bore_diameter_mm.value, settings.window_mm)
      .off_mm;
}

CasingTies tie_to_casings(const Cloud& cloud, const IcpSample& sample, const BlockModel& model,
                          const EvaluationSettings& settings, const Pose& T_block_scanner, std::span<float> room,
                          Team& team) {
  const BlockGeometry& g = model.geometry();
  const double bore_radius = 0.5 * g.casing_bore_diameter_mm.value;
  const double rim_radius = 0.5 * g.casing_rim_diameter_mm.value;
  const Plane& seat = model.plane(Face::seat);

  CasingTies found{T_block_scanner, {}};
  const StripSample along = take_strips(sample, model, T_block_scanner, room, team);
  const BoresFound bores = find_bores(along, bore_radius, settings.window_mm);
  if (!bores.off_mm) return found;
  found.T_block_scanner.translation_mm.x() -= *bores.off_mm;

  // An organised cloud: the surroundings of each casing. Any other: two halves.
  const bool organised = cloud.width > 0 && cloud.width * cloud.height == cloud.points;
  const double margin_mm = std::min(kMarginPitches / std::sqrt(bores.per_mm2), kMarginMax_mm);
  const CasingStrips strips = strips_of(model, found.T_block_scanner);
  const std::span<float> points_room = room.subspan(6 * (limits::kIcpPointsMax + 16));
  std::array<SeatPoints, 2> runs;
  team.run(runs.size(), [&](std::size_t k) {
    const std::size_t from = k * (cloud.points / 2);
    const std::size_t count = k == 0 ? cloud.points / 2 : cloud.points - from;
    const CloudPart part = organised
                               ? part_around(cloud, sample, along.places[k], *bores.off_mm, reach_mm(model) + margin_mm)
                               : CloudPart{from, count, 1, 0};
    const std::size_t column = points_room.size() / 6;
    const auto room_of = [&](std::size_t axis) { return points_room.subspan((3 * k + axis) * column, column); };
    runs[k] = points_around_casings(cloud, part, strips, reach_mm(model), {room_of(0), room_of(1), room_of(2)});
  });

  PlaneFit bearing;
  bearing.ok = true;
  bearing.normal = seat.n;
  bearing.offset_mm = seat.d;
  std::array<CasingFeature, 2> casings;
  team.run(casings.size(), [&](std::size_t side) {
    const auto around = organised ? std::span(runs).subspan(side, 1) : std::span(runs);
    casings[side] = measure_casing(around, SeatFrame::of(model),
                                   {model.casing_centre(side == 1), bore_radius, rim_radius,
                                    g.casing_rim_height_mm.value, settings.edge_margin_mm, bearing});
  });
  const Pose back = found.T_block_scanner.inverse();
  for (std::size_t side = 0; side < casings.size(); ++side) {
    const CasingFeature& casing = casings[side];
    const Vec3 nominal = model.casing_centre(side == 1);
    if (!is_located(casing)) continue;
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
